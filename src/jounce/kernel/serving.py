"""Which calls native code serves: float64 arrays of NumPy, on a robot of numbers, where llvmlite is at hand."""

import warnings
from collections.abc import Sequence
from functools import cache, lru_cache

import numpy as np

from jounce._scalars import FLOAT, Array, is_numeric
from jounce.errors import JounceError, JounceWarning, one_of, true_or_false
from jounce.kernel.kernel import Kernel, compiled
from jounce.kernel.quantity import Quantity
from jounce.mechanism import DATA, Mechanism
from jounce.paths import COMPILED
from jounce.rates import checked_order


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
    kernel, obstacle = _kernel(mechanism, name, order, bool(W))
    if kernel is None and method == "kernel":
        raise JounceError(f"no native code: {obstacle}")
    return kernel


def ahead(mechanism: Mechanism, name: str, order: int, loaded: bool) -> Kernel:
    """The kernel that a user asks for by name."""
    one_of("quantity for native code", name, COMPILED)
    order = checked_order(order)
    if true_or_false("wrench", loaded, "whether calls take any") and name != "inverse_dynamics":
        raise JounceError(f"{name} takes no wrenches")
    kernel, obstacle = _kernel(mechanism, name, order, loaded)
    if kernel is None:
        raise JounceError(f"no native code: {obstacle}")
    return kernel


@lru_cache(maxsize=128)
def _kernel(mechanism: Mechanism, name: str, order: int, loaded: bool) -> tuple[Kernel | None, str | None]:
    """The kernel, or why there is none."""
    quantity = Quantity(name, order, loaded, mechanism.n, mechanism.nb)
    if quantity.obstacle:
        return None, quantity.obstacle
    if not all(is_numeric(getattr(mechanism, data)) for data in DATA):
        return None, "the robot holds symbols"
    if not available():
        return None, "llvmlite cannot be imported"
    return compiled(mechanism, quantity), None


@cache
def available() -> bool:
    """Whether llvmlite can be imported; said once where it cannot."""
    try:
        import llvmlite.binding  # noqa: F401
    except (ImportError, OSError) as error:
        text = f"no native code, the recursion serves instead: llvmlite cannot be imported ({error})"
        warnings.warn(text, JounceWarning, stacklevel=6)
        return False
    return True
