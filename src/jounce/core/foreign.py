"""Values from elsewhere: text, masked arrays, NA of pandas, CasADi matrices, spatial vectors of Pinocchio."""

import math
import sys
from typing import Any

import numpy as np

from jounce.core.errors import JounceError


def parse_finite(text: str) -> float | None:
    """Parse a finite decimal number, or return None.

    1_000 and digits of other scripts are not accepted.
    """
    if "_" in text or not text.isascii():
        return None
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def refuse_spatial(x: Any, what: str) -> None:
    """Raise `JounceError` for spatial vectors of Pinocchio, or lists of them.

    NumPy takes them in their own order, (linear; angular).
    """
    if isinstance(x, np.ndarray):
        return
    entries = x if type(x) in (list, tuple) or type(x).__name__.startswith("StdVec") else (x,)
    if any(hasattr(type(entry), "angular") and hasattr(type(entry), "linear") for entry in entries):
        came = f"{what} is of type {type(x).__name__}, whose array is (linear; angular)"
        raise JounceError(f"{came}; expected (angular; linear): numpy.concatenate([x.angular, x.linear])")


def fill_masked(x: Any) -> Any:
    """Return `x` with NaN where it is masked.

    Lists may hold masked arrays.
    """
    if _is_masked(x) and x.dtype.kind in "biufO":
        kind = x.dtype if x.dtype.kind == "O" else np.result_type(x.dtype, np.float64)
        return np.ma.filled(x.astype(kind), np.nan)
    if type(x) in (list, tuple) and has_mask(x):
        return [fill_masked(part) for part in x]
    return x


def has_mask(x: Any) -> bool:
    """Return whether an array, or one in a list, has a mask."""
    return _is_masked(x) or (type(x) in (list, tuple) and any(map(has_mask, x)))


def _is_masked(x: Any) -> bool:
    masked = sys.modules.get("numpy.ma")  # slow to import, and whoever made a masked array has imported it
    return masked is not None and isinstance(x, masked.MaskedArray)


def fill_missing(array: np.ndarray) -> np.ndarray:
    """Return an array with NaN in place of NA of pandas."""
    # Without pandas there is no NA.
    pandas = sys.modules.get("pandas")
    if pandas is None or array.dtype.kind != "O":
        return array
    return np.asarray(np.frompyfunc(lambda v: np.nan if v is pandas.NA else v, 1, 1)(array), dtype=object)


def from_casadi(x: Any, what: str) -> np.ndarray:
    """Return the entries of a CasADi matrix, `SX` or numbers.

    They are (n,) of a column or a row, else (m, n).
    """
    if type(x).__name__ not in ("SX", "DM"):
        cure = "expected SX, or call with it what robot.casadi_function returns"
        raise JounceError(f"{what} is a CasADi {type(x).__name__}; {cure}")
    array = np.empty(x.shape, dtype=object)
    for index in np.ndindex(*x.shape):
        array[index] = x[index] if type(x).__name__ == "SX" else float(x[index])
    return array.ravel() if 1 in x.shape else array
