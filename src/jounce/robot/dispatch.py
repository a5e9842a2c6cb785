"""Calls of a robot's methods: arguments are checked, and the first backend that accepts a call runs it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from math import inf
from types import NoneType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from jounce._scalars import FLOAT, Array, is_numeric
from jounce.arguments import loads, rates, requests, wrenches
from jounce.dynamics import drive_terms
from jounce.dynamics.computation import Computation, Port, coordinate_ports
from jounce.dynamics.loads import exerted
from jounce.dynamics.quantities import FORCES, QUANTITIES, Quantity
from jounce.errors import JounceError, one_of, quoted, warn
from jounce.model.mechanism import DATA, Mechanism, cast_model
from jounce.native import plan
from jounce.native.jit import host
from jounce.native.kernel import Kernel, compiled
from jounce.native.plan import LongCompilationError, obstacle
from jounce.robot.generic import batch_shape, checked_out, computed, evaluate, is_fit, results_into
from jounce.spatial.series import Series, columns

if TYPE_CHECKING:
    from jounce.robot.robot import Robot

NATIVE = "kernel"  # the method that is native code
PATIENCE = 3.0  # seconds that a call may take to compile native code that nobody asked for

Form = tuple[Any, ...]  # of a call: what it asks for, and the types of what it gives


@dataclass(frozen=True, eq=False)
class Kernels:
    """The native code of one robot, dropped with it.

    `known` holds the kernel of a computation, or why there is none; `ready` what serves plain calls of a form, and how
    many rates of the coordinates that takes.
    """

    known: dict[Computation, tuple[Kernel | None, str | None]] = field(default_factory=dict)
    ready: dict[Form, tuple[Kernel, int]] = field(default_factory=dict)


class Call(NamedTuple):
    """What a method of a robot is called with, checked."""

    robot: "Robot"
    computation: Computation
    arrays: Sequence[Array]  # q, qd, ..., W, Wd, ...
    method: str | None
    out: Any
    threads: int
    form: Form | None  # of a plain call: on NumPy's own arrays, on one thread


class Backend(NamedTuple):
    """One way to run calls: `prepare` gives what it runs a call with, or says why it cannot run it."""

    prepare: Callable[[Call], tuple[Any, str | None]]
    run: Callable[[Call, Any], Any]


def compute(
    robot: "Robot",
    name: str,
    given: Sequence[Any],
    *,
    wrench: Any = None,
    body: str | None = None,
    frame: str = "body",
    method: str | None = None,
    out: Any = None,
    threads: int = 1,
) -> Any:
    """A quantity along given rates of the coordinates, by the first backend that accepts the call."""
    terms = wrench if type(wrench) is tuple else () if wrench is None else (wrench,)
    form = (name, body, frame, method, type(threads), threads, *map(type, given), type(wrench), *map(type, terms))
    try:  # the short way, of calls like an earlier one: NumPy itself checks shapes and kinds of numbers
        kernel, count = robot._kernels.ready[form]
        arrays = (*given[:count], *terms)
        if out is None:
            return kernel.ufunc(*arrays)
        into = tuple(out) if type(out) in (tuple, list) else (out,)
        if is_fit(into, arrays[0].shape[:-1] + kernel.shapes[1][0]):
            return kernel.ufunc(*arrays, out=into)
    except (FloatingPointError, Warning):  # where np.errstate or a filter asks for it
        raise
    except Exception:  # the long way serves all others, and says what is wrong with them
        pass
    plain = {type(x) for x in (*given, *terms)} <= {np.ndarray, NoneType} and type(threads) is int and threads == 1
    asked = _checked_arguments(robot.mechanism, name, given, wrench, body, frame, method)
    return _run(Call(robot, *asked, method, out, threads, form if plain else None))


def _checked_arguments(
    mechanism: Mechanism, name: str, given: Sequence[Any], wrench: Any, body: str | None, frame: str, method: str | None
) -> tuple[Computation, list[Array]]:
    """What a caller asks for, and the arrays that it takes."""
    quantity = QUANTITIES[name]
    q = rates.rates_of(given, quantity.rates, mechanism)
    order = len(q) - quantity.rates
    W = wrenches.wrenches_of(mechanism, wrench, order, q)
    if method is not None:
        one_of(f"method for {name}", method, [*quantity.methods, NATIVE])
    if body is not None or frame != "body":
        requests.place(mechanism, name, body, frame)
    return requests.known(name, order, bool(W), body, frame), [*q, *W]


def _run(call: Call) -> Any:
    """The results of the first backend that accepts a call."""
    reasons = []
    for backend in BACKENDS:
        ready, refusal = backend.prepare(call)
        if refusal is None:
            return backend.run(call, ready)
        reasons.append(refusal)
    cure = f"use method={_default(call.computation.quantity)!r}" if call.method == NATIVE else "leave threads out"
    raise JounceError(f"{': '.join(reversed(reasons))}; {cure}")


def drive_forces(mechanism: Mechanism, given: Sequence[Any], terms: Sequence[str], out: Any) -> Any:
    """The forces of drive terms along given rates of the coordinates, whether or not they act."""
    q = rates.rates_of(given, FORCES.rates, mechanism)
    model, ports = cast_model(mechanism, q), coordinate_ports(mechanism.n, len(q), FORCES.rates)

    def law(arrays: Sequence[Array]) -> Series:
        return drive_terms.forces(model, columns(arrays), terms).map(lambda Q: Q[..., 0])

    return results_into(evaluate(law, ports, q, len(q) - FORCES.rates, 4 * model.nb), out)


def wrench_of_load(
    mechanism: Mechanism, given: Sequence[Any], body: str, force: Any, torque: Any, frame: str, point: Any
) -> Any:
    """The wrenches that bodies exert where a load acts on one of them, along given rates of the coordinates."""
    q = rates.rates_of(given, 1, mechanism)
    place, load = loads.place_of(frame, point, force), loads.load_of(force, torque, len(q) - 1, q)
    model = cast_model(mechanism, [*q, *load])
    ports = [*coordinate_ports(model.n, len(q), 1), *(Port(f"load[{k}]", (1, 6), "load", k) for k in range(len(load)))]

    def law(arrays: Sequence[Array]) -> Series:
        terms = Series.of([x.swapaxes(-1, -2) for x in arrays[len(q) :]])
        return exerted(model, columns(arrays[: len(q)]), terms, body, frame, place)

    return results_into(evaluate(law, ports, [*q, *load], len(q) - 1, 6 * model.nb), None)


def compile_ahead(robot: "Robot", computation: Computation) -> Kernel:
    """The kernel that a user asks for, however long it takes to compile."""
    kernel, refusal = _kernel(robot, computation, inf)
    if kernel is None:
        raise JounceError(f"native code {refusal}; use method={_default(computation.quantity)!r}")
    return kernel


def _default(quantity: Quantity) -> str:
    """The method that serves all arrays."""
    return next(iter(quantity.methods))


def _prepare_native(call: Call) -> tuple[Kernel | None, str | None]:
    """The kernel that serves a call; who names native code waits for it."""
    if call.method not in (None, NATIVE):
        return None, f"method={call.method!r} is not native code"
    for x in call.arrays:
        if type(x) is not np.ndarray or (x.dtype is not FLOAT and x.dtype != FLOAT):  # unpickled, it is another object
            came = x.dtype if type(x) is np.ndarray else type(x).__name__
            return None, f"native code takes float64 arrays of NumPy, not {came}"
    kernel, refusal = _kernel(call.robot, call.computation, PATIENCE if call.method is None else inf)
    if kernel is not None and call.form is not None:
        call.robot._kernels.ready[call.form] = kernel, call.computation.rates
    return kernel, refusal and f"native code {refusal}"


def _run_native(call: Call, kernel: Kernel) -> Any:
    """The results of native code, written straight into `out` where it is given."""
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
    """The method that serves a call."""
    method = call.method or _default(call.computation.quantity)
    if method == NATIVE:
        return method, f"method={NATIVE!r} is not available"
    if isinstance(call.threads, int | np.integer) and not isinstance(call.threads, bool) and call.threads == 1:
        return method, None
    return method, f"threads={quoted(call.threads)} needs native code, which is not available"


def _run_generic(call: Call, method: str) -> Any:
    """The results of a method's law on arrays of any scalar type."""
    model = cast_model(call.robot.mechanism, call.arrays)
    return results_into(computed(call.computation, method, model, call.arrays), call.out)


BACKENDS = (Backend(_prepare_native, _run_native), Backend(_prepare_generic, _run_generic))  # the first that accepts


def _kernel(robot: "Robot", computation: Computation, patience: float) -> tuple[Kernel | None, str | None]:
    """The kernel, or why there is none, as the end of a sentence about native code."""
    known = robot._kernels.known.get(computation)
    if known is None or (known[0] is None and patience > PATIENCE):
        known = robot._kernels.known[computation] = _compiled(robot.mechanism, computation, patience)
    return known


def _compiled(mechanism: Mechanism, computation: Computation, patience: float) -> tuple[Kernel | None, str | None]:
    if refusal := native_obstacle(mechanism, computation):
        return None, refusal
    try:
        return compiled(mechanism, computation, patience), None
    except LongCompilationError:
        asked = f"native code for {computation.name} of {mechanism.name!r} to order {computation.order}"
        warn(
            f"{asked} takes longer than {PATIENCE:g} s to compile, so the slower recursion in NumPy is used;"
            f" robot.compile({', '.join(computation.keywords())}) compiles it once"
        )
        return None, f"takes longer than {PATIENCE:g} s to compile"


def native_obstacle(mechanism: Mechanism, computation: Computation) -> str | None:
    """Why native code cannot serve a computation, as the end of a sentence about native code."""
    if found := obstacle(computation):
        return found
    if not all(is_numeric(getattr(mechanism, data)) for data in DATA):
        return "is for robots of numbers; this robot holds symbols"
    if not available():
        return "needs llvmlite, which cannot be imported"
    size = plan.scratch_size(computation, mechanism, host().lanes)
    if size > plan.LIMIT:
        return f"works in up to {plan.LIMIT / 2**20:.3g} MiB of scratch memory; this takes {size / 2**20:.3g} MiB"
    return None


@cache
def available() -> bool:
    """Whether llvmlite can be imported; said once where it cannot."""
    try:
        import llvmlite.binding  # noqa: F401
    except (ImportError, OSError) as error:
        warn(f"no native code, the recursion serves instead: llvmlite cannot be imported ({error})")
        return False
    return True
