"""Calls of a robot's methods: arguments are checked, and the first backend that accepts a call runs it."""

from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from math import inf
from typing import Any, NamedTuple

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
from jounce.robot.generic import batch_shape, checked_out, computed, evaluate, results_into
from jounce.spatial.series import Series, columns

NATIVE = "kernel"  # the method that is native code
PATIENCE = 3.0  # seconds that a call may take to compile native code that nobody asked for


class Call(NamedTuple):
    """What a method of a robot is called with, checked."""

    mechanism: Mechanism
    computation: Computation
    arrays: Sequence[Array]  # q, qd, ..., W, Wd, ...
    method: str | None
    out: Any
    threads: int


class Backend(NamedTuple):
    """One way to run calls: it accepts those for which `refusal` is None, and says of others why it cannot run them."""

    refusal: Callable[[Call], str | None]
    run: Callable[[Call], Any]


def compute(
    mechanism: Mechanism,
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
    quantity = QUANTITIES[name]
    q = rates.rates_of(given, quantity.rates, mechanism)
    order = len(q) - quantity.rates
    W = () if wrench is None else wrenches.wrenches_of(mechanism, wrench, order, q)
    if method is not None:
        one_of(f"method for {name}", method, [*quantity.methods, NATIVE])
    if body is not None or frame != "body":
        requests.place(mechanism, name, body, frame)
    call = Call(mechanism, requests.known(name, order, bool(W), body, frame), [*q, *W], method, out, threads)
    for backend in BACKENDS:
        if backend.refusal(call) is None:
            return backend.run(call)
    reasons = ": ".join(str(backend.refusal(call)) for backend in reversed(BACKENDS))
    cure = f"use method={_default(quantity)!r}" if method == NATIVE else "leave threads out"
    raise JounceError(f"{reasons}; {cure}")


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
    place, load = loads.place_of(frame, point), loads.load_of(force, torque, len(q) - 1, q)
    model = cast_model(mechanism, [*q, *load])
    ports = [*coordinate_ports(model.n, len(q), 1), *(Port(f"load[{k}]", (1, 6), "load", k) for k in range(len(load)))]

    def law(arrays: Sequence[Array]) -> Series:
        terms = Series.of([x.swapaxes(-1, -2) for x in arrays[len(q) :]])
        return exerted(model, columns(arrays[: len(q)]), terms, body, frame, place)

    return results_into(evaluate(law, ports, [*q, *load], len(q) - 1, 6 * model.nb), None)


def compile_ahead(mechanism: Mechanism, computation: Computation) -> Kernel:
    """The kernel that a user asks for, however long it takes to compile."""
    kernel, refusal = _kernel(mechanism, computation, inf)
    if kernel is None:
        raise JounceError(f"native code {refusal}; use method={_default(computation.quantity)!r}")
    return kernel


def _default(quantity: Quantity) -> str:
    """The method that serves all arrays."""
    return next(iter(quantity.methods))


def _kernel_of(call: Call) -> tuple[Kernel | None, str | None]:
    """The kernel that serves a call, or why there is none; who names native code waits for it."""
    return _kernel(call.mechanism, call.computation, PATIENCE if call.method is None else inf)


def _native_refusal(call: Call) -> str | None:
    if call.method not in (None, NATIVE):
        return f"method={call.method!r} is not native code"
    for x in call.arrays:
        if type(x) is not np.ndarray or (x.dtype is not FLOAT and x.dtype != FLOAT):  # unpickled, it is another object
            came = x.dtype if type(x) is np.ndarray else type(x).__name__
            return f"native code takes float64 arrays of NumPy, not {came}"
    refusal = _kernel_of(call)[1]
    return refusal and f"native code {refusal}"


def _run_native(call: Call) -> Any:
    """The results of native code, written straight into `out` where it is given."""
    kernel = _kernel_of(call)[0]
    assert kernel is not None
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


def _generic_refusal(call: Call) -> str | None:
    if call.method == NATIVE:
        return f"method={NATIVE!r} is not available"
    if isinstance(call.threads, int | np.integer) and not isinstance(call.threads, bool) and call.threads == 1:
        return None
    return f"threads={quoted(call.threads)} needs native code, which is not available"


def _run_generic(call: Call) -> Any:
    """The results of a method's law on arrays of any scalar type."""
    method = call.method or _default(call.computation.quantity)
    model = cast_model(call.mechanism, call.arrays)
    return results_into(computed(call.computation, method, model, call.arrays), call.out)


BACKENDS = (Backend(_native_refusal, _run_native), Backend(_generic_refusal, _run_generic))  # the first that accepts


@lru_cache(maxsize=512)
def _kernel(mechanism: Mechanism, computation: Computation, patience: float) -> tuple[Kernel | None, str | None]:
    """The kernel, or why there is none, as the end of a sentence about native code."""
    if refusal := native_obstacle(mechanism, computation):
        return None, refusal
    try:
        kernel = compiled(mechanism, computation, patience)
    except LongCompilationError:
        asked = f"native code for {computation.name} of {mechanism.name!r} to order {computation.order}"
        warn(
            f"{asked} takes longer than {PATIENCE:g} s to compile, so the slower recursion in NumPy is used;"
            f" robot.compile({', '.join(computation.keywords())}) compiles it once"
        )
        return None, f"takes longer than {PATIENCE:g} s to compile"
    if patience > PATIENCE:
        _kernel.cache_clear()  # calls that did not wait have it now too
    return kernel, None


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
