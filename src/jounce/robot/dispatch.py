"""Which calls native code serves: float64 arrays of NumPy, on a robot of numbers, where llvmlite is at hand."""

from collections.abc import Sequence
from functools import cache, lru_cache
from math import inf

import numpy as np

from jounce._scalars import FLOAT, Array, is_numeric
from jounce.arguments.rates import checked_order
from jounce.dynamics.quantities import COMPILED
from jounce.errors import JounceError, one_of, true_or_false, warn
from jounce.model.mechanism import DATA, Mechanism
from jounce.native import memory
from jounce.native.kernel import Kernel, compiled
from jounce.native.quantity import LongCompilationError, Quantity
from jounce.native.target import host

PATIENCE = 3.0  # seconds that a call may take to compile native code that nobody asked for


def serving(
    mechanism: Mechanism, name: str, method: str | None, order: int, q: Sequence[Array], W: Sequence[Array]
) -> Kernel | None:
    """The kernel of a quantity, or None where another path must do it.

    Raises
    ------
    JounceError : where ``method="kernel"`` asks for what no kernel serves.
    """
    if name not in COMPILED or not (method is None or (isinstance(method, str) and method == "kernel")):
        return None
    for x in (*q, *W):
        if type(x) is not np.ndarray or (x.dtype is not FLOAT and x.dtype != FLOAT):  # unpickled, it is another object
            if method == "kernel":
                raise JounceError("native code takes float64 arrays of NumPy")
            return None
    kernel, obstacle = _kernel(mechanism, name, order, bool(W), PATIENCE if method is None else inf)
    if kernel is None and method == "kernel":
        raise JounceError(f"no native code: {obstacle}")
    return kernel


def ahead(mechanism: Mechanism, name: str, order: int, loaded: bool) -> Kernel:
    """The kernel that a user asks for by name."""
    one_of("quantity for native code", name, COMPILED)
    order = checked_order(order)
    if true_or_false("wrench", loaded, "whether calls take any") and name != "inverse_dynamics":
        raise JounceError(f"{name} takes no wrenches")
    kernel, obstacle = _kernel(mechanism, name, order, loaded, inf)
    if kernel is None:
        raise JounceError(f"no native code: {obstacle}")
    return kernel


@lru_cache(maxsize=128)
def _kernel(
    mechanism: Mechanism, name: str, order: int, loaded: bool, patience: float
) -> tuple[Kernel | None, str | None]:
    """The kernel, or why there is none."""
    quantity = Quantity(name, order, loaded, mechanism.n, mechanism.nb)
    if quantity.obstacle:
        return None, quantity.obstacle
    if not all(is_numeric(getattr(mechanism, data)) for data in DATA):
        return None, "the robot holds symbols"
    if not available():
        return None, "llvmlite cannot be imported"
    size = memory.scratch_size(quantity, mechanism.parent, host().lanes)
    if size > memory.LIMIT:
        limit = f"more than the limit of {memory.LIMIT / 2**20:g} MiB"
        return None, f"it needs {size / 2**20:.3g} MiB of scratch memory, {limit}; use method='recursion'"
    try:
        kernel = compiled(mechanism, quantity, patience)
    except LongCompilationError:
        text = (
            f"native code for {name} of {mechanism.name!r} to order {order} takes longer than {PATIENCE:g} s to compile"
        )
        options = [f"order={order}", *["wrench=True"] * loaded, *[f"quantity={name!r}"] * (name != "inverse_dynamics")]
        warn(f"{text}, so the slower recursion in NumPy is used; robot.compile({', '.join(options)}) compiles it once")
        return None, text
    if patience > PATIENCE:
        _kernel.cache_clear()  # now calls that did not wait have it too
    return kernel, None


@cache
def available() -> bool:
    """Whether llvmlite can be imported; said once where it cannot."""
    try:
        import llvmlite.binding  # noqa: F401
    except (ImportError, OSError) as error:
        warn(f"no native code, the recursion serves instead: llvmlite cannot be imported ({error})")
        return False
    return True
