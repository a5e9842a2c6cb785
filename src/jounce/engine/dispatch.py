"""Calls of a robot's methods: arguments are checked, and the first backend that accepts a call runs it."""

import sys
from collections.abc import Callable, Sequence
from functools import cache
from math import inf
from types import NoneType
from typing import Any, NamedTuple

import numpy as np

from jounce._scalars import FLOAT, Array, broadcast, concatenate, is_jax, is_numeric
from jounce._typing import DriveColumn
from jounce.arguments import loads, positions, rates, requests, wrenches
from jounce.arguments.base import base_of
from jounce.dynamics import drive_terms, elastic
from jounce.dynamics.branches import without_ratios
from jounce.dynamics.computation import Computation, Port
from jounce.dynamics.loads import wrench_of
from jounce.dynamics.loops import closed_motion
from jounce.dynamics.loops import law as closed_law
from jounce.dynamics.mobility import is_singular, may_be_singular
from jounce.dynamics.newton import Step
from jounce.dynamics.quantities import FORCES, Quantity, row_of
from jounce.dynamics.state import State
from jounce.engine import digits
from jounce.engine.engine import Engine, Form, Ready
from jounce.engine.generic import as_tuple, batch_shape, checked_out, compute_by_method, evaluate, is_fit, results_into
from jounce.errors import JounceError, one_of, quoted, warn
from jounce.model.casting import cast_model
from jounce.model.mechanism import Mechanism
from jounce.native import closing, plan
from jounce.native.closing import NativeStep
from jounce.native.jit import host
from jounce.native.kernel import Kernel, compile_kernel
from jounce.native.plan import PATIENCE, LongCompilationError, obstacle
from jounce.native.poses import are_poses
from jounce.spatial.series import Series, rate_name

NATIVE = "kernel"  # the method that is native code


class Call(NamedTuple):
    """The checked arguments of a call of a robot's method."""

    robot: Engine
    computation: Computation
    arrays: Sequence[Array]  # q, qd, ..., W, Wd, ...
    method: str | None
    out: Any
    threads: int
    form: Form | None  # of a plain call: on NumPy's own arrays, on one thread


class Backend(NamedTuple):
    """One way to run calls: `prepare` returns what `run` needs, or the reason that it cannot run the call.

    The reason is empty if another backend serves such arrays.
    """

    prepare: Callable[[Call], tuple[Any, str | None]]
    run: Callable[[Call, Any], Any]


def compute(
    robot: Engine,
    name: str,
    given: Sequence[Any],
    *,
    wrench: Any = None,
    base: Any = None,
    body: str | None = None,
    frame: str = "body",
    method: str | None = None,
    out: Any = None,
    threads: int = 1,
) -> Any:
    """Compute a quantity for given rates of the coordinates with the first backend that accepts the call."""
    terms: Sequence[Any] = wrench if type(wrench) is tuple else () if wrench is None else (wrench,)
    moved: Sequence[Any] = base if type(base) is tuple else () if base is None else (base,)
    form = (name, body, frame, method, type(threads), threads, *map(type, given), type(wrench), *map(type, terms))
    if moved:
        form = (*form, type(base), *map(type, moved))
    try:  # the short way, of calls like an earlier one: NumPy itself checks shapes and kinds of numbers
        kernel, count, limit = robot._kernels.ready[form]
        arrays = (*given[:count], *terms, *moved)
        if robot.mechanism.closure:
            arrays = _with_dependent(robot, arrays, limit)
        if moved and not are_poses(moved[0]):
            raise LookupError  # NaN, or what `check_pose` refuses
        if out is None:
            return kernel.ufunc(*arrays)
        into = tuple(out) if type(out) in (tuple, list) else (out,)
        if is_fit(into, arrays[0].shape[:-1], kernel.shapes[1]):
            return kernel.ufunc(*arrays, out=into)
    except (FloatingPointError, Warning):  # where np.errstate or a filter asks for it
        raise
    except Exception:  # the long way serves all others, and says what is wrong with them
        pass
    plain = {type(x) for x in (*given, *terms, *moved)} <= {np.ndarray, NoneType} and type(threads) is int
    natively = isinstance(method, str | None) and method in (None, NATIVE)
    step = closing_step(robot) if robot.mechanism.closure and natively else None
    asked, given = checked_arguments(robot.mechanism, name, given, wrench, base, body, frame, method, step)
    lasting = plain and threads == 1 and asked.base == bool(moved) and not _needs_inverse(robot, asked)
    return _run(Call(robot, asked, given, method, out, threads, form if lasting else None))


def closing_step(robot: Engine) -> NativeStep | None:
    """Return the step in native code that closes the loops of a robot, if there is one."""
    steps = robot._kernels.steps
    if not steps:
        steps.append(closing.native_step(robot.mechanism) if robot.mechanism.is_numeric and available() else None)
    return steps[0]


def _with_dependent(robot: Engine, arrays: Sequence[Any], limit: float) -> tuple[Any, ...]:
    """Return the arrays of a plain call of a closed robot with the independent coordinates first, the others last.

    Raises
    ------
    LookupError : if the condition number of the constraints exceeds a limit.
    """
    step, q = closing_step(robot), arrays[0]
    try:
        if step is None:
            raise LookupError
        u, d = step.close(q, limit)
    except LookupError:
        u, whole = positions.split(robot.mechanism, q)
        d = positions.dependent_of(robot.mechanism, u, whole, step)
        if digits.displaced(robot.mechanism, u, d, limit, step) is not None:
            raise
    return u, *arrays[1:], d


def checked_arguments(
    mechanism: Mechanism,
    name: str,
    given: Sequence[Any],
    wrench: Any,
    base: Any,
    body: str | None,
    frame: str,
    method: str | None,
    step: Step | None = None,
) -> tuple[Computation, list[Array]]:
    """Check the arguments of a call, and return its computation and input arrays; `step` closes the loops."""
    more = requests.more_rates(mechanism, name)
    quantity = row_of(name, more)
    given, whole = positions.split_rates(mechanism, given)
    q = rates.rates_of(given, quantity.rates, mechanism, quantity.input_names, quantity.coordinate_inputs(len(given)))
    order = len(q) - quantity.rates
    requests.check_rates(name, order)
    W = wrenches.wrenches_of(mechanism, wrench, order, q, quantity.wrench_rates)
    moves = base is not None or mechanism.base is not None
    if method is not None:
        one_of("method", method, [*quantity.methods, NATIVE], name)
        if moves and method != NATIVE and not quantity.methods[method].base:
            raise JounceError(f"method={method!r} has no base that moves; use method='closed_form'")
    if body is not None or frame != "body":
        requests.place(mechanism, name, body, frame)
    requests.check_existence(mechanism, name, moves)
    if quantity.forces:
        requests.check_invertible(mechanism, name)
    enters = moves and requests.takes_base(name, frame)
    asked = requests.known(name, order, bool(W), body, frame, more, enters)
    d = _dependent(mechanism, q[0], whole, step)
    if base is None and not enters:
        return asked, [*q, *W, *d]
    C = base_of(mechanism, base, asked.base_terms(mechanism), f"{name} of order {order}")  # wrong ones never pass
    return asked, [*q, *W, *C, *d] if enters else [*q, *W, *d]


def _dependent(mechanism: Mechanism, q: Array, whole: Any, step: Step | None = None) -> list[Array]:
    """The last array of all computations of closed robots: the dependent coordinates."""
    return [positions.dependent_of(mechanism, q, whole, step)] if mechanism.closure else []


def _run(call: Call) -> Any:
    """Run a call; of a closed robot near singular positions once more, to see which digits there are."""
    robot, asked = call.robot, call.computation
    if robot.mechanism.closure:
        m, names = _with_constraints(robot, asked), asked.quantity.names(asked.order)
        step = closing_step(robot) if call.method in (None, NATIVE) and m is robot.mechanism else None

        def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
            return as_tuple(_run_by_backend(call._replace(arrays=arrays, out=None, form=None)))

        results = digits.certain_results(m, asked, names, call.arrays, run, step)
        if results is not None:
            return results_into(results, call.out)
    return _run_by_backend(call)


def _with_constraints(robot: Engine, asked: Computation) -> Mechanism:
    """Return a closed robot with the constraints that a computation solves."""
    return without_ratios(robot.mechanism) if asked.quantity.all_constraints else robot.mechanism


def _run_by_backend(call: Call) -> Any:
    """Run a call with the first backend that accepts it."""
    reasons = []
    for backend in BACKENDS:
        ready, refusal = backend.prepare(call)
        if refusal is None:
            found = backend.run(call, ready)
            return _infinite_where_singular(call, found) if _needs_inverse(call.robot, call.computation) else found
        reasons += [refusal] if refusal else []
    cure = f"use method={_default(call.computation.quantity)!r}" if call.method == NATIVE else "leave threads out"
    raise JounceError(f"{': '.join(reversed(reasons))}; {cure}")


def _needs_inverse(robot: Engine, computation: Computation) -> bool:
    """Whether a quantity takes the inverse of a mass matrix that may be singular at some positions."""
    return bool(computation.quantity.forces) and robot.mechanism.is_numeric and may_be_singular(robot.mechanism)


def _infinite_where_singular(call: Call, found: Any) -> Any:
    """Results that are infinite, with NumPy's warning, where pivots of the mass matrix are rounding instead of zero."""
    m = call.robot.mechanism
    at = [call.arrays[0], *(call.arrays[-1:] if m.closure else [])]
    if not all(map(is_numeric, call.arrays)):
        return found
    M = _run_by_backend(Call(call.robot, Computation("mass_matrix", 0), at, None, None, 1, None))
    regular = 1.0 - is_singular(M)
    if not regular.all():
        for array, port in zip(as_tuple(found), call.computation.signature(m).outputs, strict=True):
            np.divide(array, regular.reshape(regular.shape + (1,) * len(port.shape)), out=array)
    return found


def drive_forces(mechanism: Mechanism, given: Sequence[Any], terms: Sequence[str], out: Any) -> Any:
    """Compute the forces of drive terms for given rates of the coordinates, whether or not the terms act in Q."""

    def law(m: Mechanism, q: Series) -> Series:
        forces = drive_terms.behind_base(m, drive_terms.forces(m, q, terms), (-2,))
        return forces.map(lambda Q: Q[..., 0])

    forces = _of_drives(mechanism, FORCES.name, given, 4 * mechanism.nb, law)
    return results_into(tuple(Q[..., -mechanism.n :] for Q in forces), out)


def _of_drives(
    mechanism: Mechanism, name: str, given: Sequence[Any], width: int, law: Callable[[Mechanism, Series], Series]
) -> tuple[Array, ...]:
    """Compute what drives contribute to a quantity, by their law, for given rates of the coordinates."""
    row, (given, whole) = row_of(name), positions.split_rates(mechanism, given)
    q = rates.rates_of(given, row.rates, mechanism)
    model, asked = cast_model(mechanism, q), Computation(name, len(q) - row.rates)

    def on_tree(m: Mechanism, x: State) -> Series:
        return law(m, x.q)

    of_drives = closed_law(on_tree, row.shape, None) if model.closure else on_tree
    arrays, ports = [*q, *_dependent(mechanism, q[0], whole)], asked.signature(model).inputs

    def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
        return evaluate(lambda x: of_drives(model, asked.state(model, x)), ports, arrays, asked.count, width)

    return digits.certain_results(mechanism, asked, row.names(asked.order), arrays, run) or run(arrays)


def regressor(
    robot: Engine, name: str, given: Sequence[Any], terms: Sequence[DriveColumn], out: Any = None, **options: Any
) -> Any:
    """Compute a regressor for given rates of the coordinates, with columns of drive terms behind its own."""
    if not terms:
        return compute(robot, name, given, out=out, **options)
    own, m = as_tuple(compute(robot, name, given, **options)), robot.mechanism
    of_units: Callable[..., Series] = getattr(drive_terms, name)
    added = _of_drives(m, name, given, m.nb * m.nv * len(terms), lambda m, q: of_units(m, q, terms))
    axes = [len(row_of(name).shape)] * 2
    pairs = (broadcast(pair, axes, ["Y", "drives"]) for pair in zip(own, added, strict=True))
    return results_into(tuple(concatenate(pair, axis=-1) for pair in pairs), out)


def wrench_of_load(
    mechanism: Mechanism,
    given: Sequence[Any],
    base: Any,
    body: str,
    force: Any,
    torque: Any,
    frame: str,
    point: Any,
) -> Any:
    """Compute the wrenches W that correspond to a load on a body, for given rates of the coordinates."""
    given, whole = positions.split_rates(mechanism, given)
    q = rates.rates_of(given, 1, mechanism)
    place, load = loads.place_of(frame, point, force), loads.load_of(force, torque, len(q) - 1, q)
    moving = base is not None or (mechanism.base is not None and frame == "world")
    poses = Computation("poses", len(q) - 1, base=moving)
    C = base_of(mechanism, base, len(q), "wrench") if moving else []
    model = cast_model(mechanism, [*q, *C, *load])
    first, last = len(q) + len(C), len(q) + len(C) + len(load)  # the places of loads among the arrays
    ports = list(poses.signature(model).inputs)
    ports[first:first] = [Port(f"load[{k}]", (1, 6), "load", k) for k in range(len(load))]

    def law(arrays: Sequence[Array]) -> Series:
        terms = Series.of([x.swapaxes(-1, -2) for x in arrays[first:last]])
        x = poses.state(model, [*arrays[:first], *arrays[last:]])
        on_tree = closed_motion(model, x).q if model.closure else x.q
        return wrench_of(model.tree, on_tree, x.motion_of_base, terms, body, frame, place)

    def run(arrays: Sequence[Array]) -> tuple[Array, ...]:
        return evaluate(law, ports, arrays, len(q), 6 * model.nb)

    arrays = [*q, *C, *load, *_dependent(mechanism, q[0], whole)]
    asked, names = Computation("twists", len(q) - 1), [rate_name("W", k) for k in range(len(q))]  # as many axes
    return results_into(digits.certain_results(mechanism, asked, names, arrays, run) or run(arrays), None)


def compile_ahead(robot: Engine, computation: Computation) -> Kernel:
    """Compile a kernel on request, regardless of the compile time."""
    kernel, refusal = _kernel(robot, computation, inf)
    if kernel is None:
        cure = "choose a lower order" if computation.product else f"use method={_default(computation.quantity)!r}"
        raise JounceError(f"native code {refusal}; {cure}")
    return kernel


def _default(quantity: Quantity) -> str:
    """Return the name of the default method, which accepts arrays of any type."""
    return next(iter(quantity.methods))


def _prepare_native(call: Call) -> tuple[Kernel | None, str | None]:
    """Return the kernel for a call; only an explicit method="kernel" waits for a long compilation."""
    if call.method not in (None, NATIVE):
        return None, f"method={call.method!r} is not native code"
    for x in call.arrays:
        if type(x) is not np.ndarray or (x.dtype is not FLOAT and x.dtype != FLOAT):  # unpickled, it is another object
            came = x.dtype if type(x) is np.ndarray else type(x).__name__
            return None, "" if is_jax(x) else f"native code needs NumPy arrays of float64, got {came}"
    kernel, refusal = _kernel(call.robot, call.computation, PATIENCE if call.method is None else inf)
    m = call.robot.mechanism
    if kernel is not None and call.form is not None and _with_constraints(call.robot, call.computation) is m:
        limit = digits.max_condition(call.computation)
        call.robot._kernels.ready[call.form] = Ready(kernel, call.computation.rates, limit)
    return kernel, refusal and f"native code {refusal}"


def _run_native(call: Call, kernel: Kernel) -> Any:
    """Run native code, which writes directly into `out` if it is given."""
    signature = kernel.signature
    if call.out is not None:
        batch = batch_shape(signature.inputs, call.arrays)
        shapes = [(*batch, *port.shape) for port in signature.outputs]
        results = kernel(*call.arrays, out=checked_out(call.out, shapes, FLOAT), threads=call.threads)
        return call.out if isinstance(call.out, np.ndarray) else results
    try:
        return kernel(*call.arrays, threads=call.threads)
    except JounceError:
        batch_shape(signature.inputs, call.arrays)  # which says what does not fit
        raise


def _prepare_generic(call: Call) -> tuple[str, str | None]:
    """Return the method for a call."""
    method = call.method or _default(call.computation.quantity)
    if method == NATIVE:
        return method, f"method={NATIVE!r} is not available"
    if isinstance(call.threads, int | np.integer) and not isinstance(call.threads, bool) and call.threads == 1:
        return method, None
    return method, f"threads={quoted(call.threads)} needs native code, which is not available"


def _run_generic(call: Call, method: str) -> Any:
    """Run a method on arrays of any scalar type."""
    model = cast_model(call.robot.mechanism, call.arrays)
    return results_into(compute_by_method(call.computation, method, model, call.arrays), call.out)


def _prepare_jax(call: Call) -> tuple[Any, str | None]:
    """Return the request of a call on arrays of JAX, which native code of the same kernels serves."""
    if call.method not in (None, NATIVE) or not any(map(is_jax, call.arrays)):
        return None, ""
    try:
        from jounce.engine import primitive
    except ImportError:
        return None, f"native code supports JAX from 0.8 on, not {sys.modules['jax'].__version__}"
    if refusal := primitive.obstacle(call.arrays):
        return None, f"native code {refusal}"
    if type(call.threads) is not int or call.threads != 1:
        return None, "native code for JAX runs on one thread"
    _, refusal = _kernel(call.robot, call.computation, inf)  # XLA takes longer to compile the traced law
    return primitive.request_of(call.robot.mechanism, call.computation), refusal and f"native code {refusal}"


def _run_jax(call: Call, request: Any) -> Any:
    """Run the primitive of JAX for a quantity."""
    from jounce.engine import primitive

    return results_into(primitive.compute(request, call.arrays), call.out)


BACKENDS = (  # the first that accepts
    Backend(_prepare_native, _run_native),
    Backend(_prepare_jax, _run_jax),
    Backend(_prepare_generic, _run_generic),
)


def _kernel(robot: Engine, computation: Computation, patience: float) -> tuple[Kernel | None, str | None]:
    """Return the kernel of a computation, or the reason that there is no kernel."""
    known = robot._kernels.known.get(computation)
    if known is None or (known[0] is None and patience > PATIENCE):
        known = robot._kernels.known[computation] = _compile(robot.mechanism, computation, patience)
    return known


def _compile(mechanism: Mechanism, computation: Computation, patience: float) -> tuple[Kernel | None, str | None]:
    if refusal := native_obstacle(mechanism, computation):
        return None, refusal
    try:
        return compile_kernel(mechanism, computation, patience), None
    except LongCompilationError:
        asked = f"native code for {computation.name} of {mechanism.name!r} to order {computation.order}"
        warn(
            f"{asked} takes longer than {PATIENCE:g} s to compile, so the slower recursion in NumPy is used;"
            f" robot.compile({', '.join(computation.keywords())}) compiles it once"
        )
        return None, f"takes longer than {PATIENCE:g} s to compile"


def native_obstacle(mechanism: Mechanism, computation: Computation) -> str | None:
    """Return why native code does not support a computation, as the end of a sentence about native code, or None."""
    if found := obstacle(computation, mechanism):
        return found
    if not mechanism.is_numeric:
        return "needs a robot of numbers; this one contains symbols"
    if not available():
        return "needs llvmlite, which cannot be imported"
    if computation.quantity.elastic and (found := elastic.native_obstacle(mechanism)):
        return found
    size = plan.scratch_size(computation, mechanism, host().lanes)
    if size > plan.LIMIT:
        return f"is limited to {plan.LIMIT / 2**20:.3g} MiB of scratch memory; this call needs {size / 2**20:.3g} MiB"
    return None


@cache
def available() -> bool:
    """Return whether llvmlite can be imported; warn once if it cannot."""
    try:
        import llvmlite.binding  # noqa: F401
    except (ImportError, OSError) as error:
        warn(f"native code is not available, the recursion is used instead: llvmlite cannot be imported ({error})")
        return False
    return True
