"""Which calls native code serves: float64 arrays of NumPy, on a robot of numbers, where llvmlite is at hand."""

import warnings
from collections.abc import Sequence
from functools import cache, lru_cache

import numpy as np

from jounce._scalars import FLOAT, Array, is_numeric
from jounce.errors import JounceError, JounceWarning, no_such
from jounce.kernel.kernel import Kernel, compiled
from jounce.kernel.quantity import Quantity
from jounce.mechanism import DATA, Mechanism
from jounce.paths import COMPILED


def serving(
    mechanism: Mechanism, name: str, method: str | None, order: int, q: Sequence[Array], W: Sequence[Array]
) -> Kernel | None:
    """The kernel of a quantity, or None where another path must do it.

    Raises
    ------
    JounceError : where ``method="kernel"`` asks for what no kernel serves.
    """
    if name not in COMPILED or method not in (None, "kernel"):
        return None
    plain = all(type(x) is np.ndarray and x.dtype is FLOAT for x in (*q, *W))
    quantity = Quantity(name, order, bool(W), mechanism.n, mechanism.nb)
    if plain and quantity.compilable and _numeric(mechanism) and available():
        return compiled(mechanism, quantity)
    if method == "kernel":
        raise _unserved(quantity)
    return None


def ahead(mechanism: Mechanism, name: str, order: int, loaded: bool) -> Kernel:
    """The kernel that a user asks for by name."""
    if name not in COMPILED:
        raise no_such("quantity for native code", name, COMPILED)
    if not isinstance(order, int) or isinstance(order, bool) or order < 0:
        raise JounceError(f"order is {order!r}; expected 0, 1, 2, ...")
    if loaded and name != "inverse_dynamics":
        raise JounceError(f"{name} takes no wrenches")
    quantity = Quantity(name, order, bool(loaded), mechanism.n, mechanism.nb)
    if not (quantity.compilable and _numeric(mechanism) and available()):
        raise _unserved(quantity)
    return compiled(mechanism, quantity)


def _unserved(quantity: Quantity) -> JounceError:
    most = f"of at most {quantity.most} bodies for {quantity.name}"
    return JounceError(f"native code takes float64 arrays of NumPy and a robot of numbers, {most}, and llvmlite")


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


@lru_cache(maxsize=128)
def _numeric(mechanism: Mechanism) -> bool:
    return all(is_numeric(getattr(mechanism, name)) for name in DATA)
