"""Run a call by native code, or by a method.

Native code serves arrays of NumPy, and those of JAX within its functions; methods serve arrays of any scalar type.
`run_by_backend` is the door: the first of `BACKENDS` that accepts a call runs it. Each one says why it refuses, and the
reasons of all are the message if none accepts. Kernels are found once per computation and kept with the robot.
"""

import sys
from collections.abc import Callable, Sequence
from functools import cache
from math import inf
from typing import Any, NamedTuple

import numpy as np

from jounce.arguments.convert import NATIVE
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value, warn
from jounce.core.scalars import FLOAT, Array, is_jax
from jounce.dynamics import elastic
from jounce.dynamics.computation import Computation
from jounce.dynamics.loop_branches import without_ratios
from jounce.dynamics.quantities import Quantity
from jounce.dynamics.quantities.row import CUT_JOINTS, ELASTIC
from jounce.engine import generic_methods
from jounce.engine.engine import Engine
from jounce.model.mechanism import Mechanism, cast_model
from jounce.native import laws, memory_layout
from jounce.native.jit import host
from jounce.native.kernel import Kernel, compile_kernel
from jounce.native.laws import NativeStep
from jounce.native.memory_layout import LongCompilationError


class Call(NamedTuple):
    """The checked arguments of a call of a robot's method."""

    robot: Engine
    computation: Computation
    arrays: Sequence[Array]  # q, qd, ..., W, Wd, ...
    method: str | None = None
    out: Any = None
    threads: int = 1
    presence: Sequence[Array] = ()  # of contacts that come and leave, (N, contacts) with rates


class Backend(NamedTuple):
    """One way to run calls.

    `prepare` returns what `run` needs, and None; or anything, and the reason that it cannot run the call. The reason is
    empty if another backend serves such arrays.
    """

    prepare: Callable[[Call], tuple[Any, str | None]]
    run: Callable[[Call, Any], Any]


def closing_step(robot: Engine) -> NativeStep | None:
    """Return the native step that closes the loops, or None."""
    steps, m = robot._kernels.steps, robot.mechanism
    # Compiled once per robot: the list holds the step, or None.
    if len(steps) == 0:
        is_native = m.is_numeric and m.takes_dependent and is_available()
        steps.append(laws.native_step(m) if is_native else None)
    return steps[0]


def with_constraints(robot: Engine, computation: Computation) -> Mechanism:
    """Return a closed robot with the constraints that a computation solves."""
    # Forces in cut joints take all loops as they are, also those that fixed ratios close.
    return without_ratios(robot.mechanism) if CUT_JOINTS in computation.quantity.needs else robot.mechanism


def compile_ahead(robot: Engine, computation: Computation) -> Kernel:
    """Compile a kernel on request, regardless of the compile time."""
    kernel, refusal = _find_kernel(robot, computation, inf)
    if kernel is None:
        cure = "choose a lower order" if computation.product else f"use method={default_method(computation.quantity)!r}"
        raise JounceError(f"native code {refusal}; {cure}")
    return kernel


def default_method(quantity: Quantity) -> str:
    """Return the name of the default method, for arrays of any type."""
    return next(iter(quantity.laws))


def _prepare_native(call: Call) -> tuple[Kernel | None, str | None]:
    """Return the kernel for a call, or a refusal."""
    if call.method not in (None, NATIVE):
        return None, f"method={call.method!r} is not native code"
    # An identity is compared faster than types. The type of unpickled arrays is another object.
    for x in call.arrays:
        if type(x) is not np.ndarray or (x.dtype is not FLOAT and x.dtype != FLOAT):
            came = x.dtype if type(x) is np.ndarray else type(x).__name__
            return None, "" if is_jax(x) else f"native code needs NumPy arrays of float64, got {came}"
    # Only an explicit method="kernel" waits for a long compilation.
    patience = memory_layout.MAX_COMPILE_SECONDS if call.method is None else inf
    kernel, refusal = _find_kernel(call.robot, call.computation, patience)
    return kernel, None if refusal is None else f"native code {refusal}"


def _run_native(call: Call, kernel: Kernel) -> Any:
    """Run native code, which writes directly into `out` if it is given."""
    signature = kernel.signature
    # NumPy checks little of `out`: shapes, masks and shared memory are checked before.
    if call.out is not None:
        batch = generic_methods.batch_shape(signature.inputs, call.arrays)
        shapes = [(*batch, *port.shape) for port in signature.outputs]
        results = kernel(*call.arrays, out=generic_methods.check_out(call.out, shapes, FLOAT), threads=call.threads)
        return call.out if isinstance(call.out, np.ndarray) else results
    try:
        return kernel(*call.arrays, threads=call.threads)
    # If shapes do not broadcast, this says so by the names of the arrays; any other error stays.
    except JounceError:
        generic_methods.batch_shape(signature.inputs, call.arrays)
        raise


def _prepare_generic(call: Call) -> tuple[str, str | None]:
    """Return the method that runs a call, or a refusal."""
    method = default_method(call.computation.quantity) if call.method is None else call.method
    if method == NATIVE:
        return method, f"method={NATIVE!r} is not available"
    if isinstance(call.threads, int | np.integer) and not isinstance(call.threads, bool) and call.threads == 1:
        return method, None
    return method, f"threads={quote_value(call.threads)} needs native code, which is not available"


def _run_generic(call: Call, method: str) -> Any:
    """Run a method on arrays of any scalar type."""
    model = cast_model(call.robot.mechanism, call.arrays)
    return generic_methods.write_results(
        generic_methods.compute_by_method(call.computation, method, model, call.arrays), call.out
    )


def _prepare_jax(call: Call) -> tuple[Any, str | None]:
    """Return the request of a call on arrays of JAX."""
    if call.method not in (None, NATIVE) or not any(map(is_jax, call.arrays)):
        return None, ""
    try:
        from jounce.engine import primitive
    except ImportError:
        return None, f"native code supports JAX from 0.8 on, not {sys.modules['jax'].__version__}"
    obstacle = primitive.obstacle(call.arrays)
    if obstacle is not None:
        return None, f"native code {obstacle}"
    if type(call.threads) is not int or call.threads != 1:
        return None, "native code for JAX runs on one thread"
    # Whatever time native code takes to compile, XLA takes longer to compile the traced law.
    _, refusal = _find_kernel(call.robot, call.computation, inf)
    request = primitive.request_of(call.robot.mechanism, call.computation)
    return request, None if refusal is None else f"native code {refusal}"


def _run_jax(call: Call, request: Any) -> Any:
    """Run the primitive of JAX."""
    from jounce.engine import primitive

    return generic_methods.write_results(primitive.compute(request, call.arrays), call.out)


BACKENDS = (  # the first that accepts
    Backend(_prepare_native, _run_native),
    Backend(_prepare_jax, _run_jax),
    Backend(_prepare_generic, _run_generic),
)


def run_by_backend(call: Call) -> Any:
    """Run a call with the first backend that accepts it."""
    reasons = []
    for backend in BACKENDS:
        ready, refusal = backend.prepare(call)
        if refusal is None:
            return backend.run(call, ready)
        if refusal != "":
            reasons.append(refusal)
    # The last refusal is the reason in the end: it begins the message.
    cure = f"use method={default_method(call.computation.quantity)!r}" if call.method == NATIVE else "leave threads out"
    raise JounceError(f"{': '.join(reversed(reasons))}; {cure}")


def _find_kernel(robot: Engine, computation: Computation, patience: float) -> tuple[Kernel | None, str | None]:
    """Return the kernel of a computation, or a refusal."""
    # A refusal is kept too. One by a limited patience is tried again with more of it.
    known = robot._kernels.known.get(computation)
    if known is None or (known[0] is None and patience > memory_layout.MAX_COMPILE_SECONDS):
        known = robot._kernels.known[computation] = _compile(robot.mechanism, computation, patience)
    return known


def _compile(mechanism: Mechanism, computation: Computation, patience: float) -> tuple[Kernel | None, str | None]:
    """Compile a kernel; warn if that would take too long.

    Then the slower recursion is used.
    """
    obstacle = native_obstacle(mechanism, computation)
    if obstacle is not None:
        return None, obstacle
    try:
        return compile_kernel(mechanism, computation, patience), None
    except LongCompilationError:
        code = f"native code for {computation.name} of {mechanism.name!r} to order {computation.order}"
        once = Remedy(f"; robot.compile({', '.join(computation.keywords())}) compiles it once")
        warn(
            f"{code} takes longer than {memory_layout.MAX_COMPILE_SECONDS:g} s to compile, so the slower recursion in"
            f" NumPy is used{once}"
        )
        return None, f"takes longer than {memory_layout.MAX_COMPILE_SECONDS:g} s to compile"


def native_obstacle(mechanism: Mechanism, computation: Computation) -> str | None:
    """Return why native code does not support a computation, or None.

    The reason is the end of a sentence that begins with "native code".
    """
    obstacle = memory_layout.obstacle(computation, mechanism)
    if obstacle is not None:
        return obstacle
    if not mechanism.is_numeric:
        return "needs a robot of numbers; this one contains symbols"
    if not is_available():
        return "needs llvmlite, which cannot be imported"
    if ELASTIC in computation.quantity.needs:
        obstacle = elastic.native_obstacle(mechanism)
        if obstacle is not None:
            return obstacle
    size = memory_layout.scratch_size(computation, mechanism, host().lanes)
    if size > memory_layout.MAX_SCRATCH_BYTES:
        limit, needed = (f"{x / 2**20:.3g} MiB" for x in (memory_layout.MAX_SCRATCH_BYTES, size))
        return f"is limited to {limit} of scratch memory; this call needs {needed}"
    return None


@cache
def is_available() -> bool:
    """Return whether llvmlite can be imported; warn once if it cannot."""
    try:
        import llvmlite.binding  # noqa: F401
    except (ImportError, OSError) as error:
        warn(f"native code is not available, the recursion is used instead: llvmlite cannot be imported ({error})")
        return False
    return True
