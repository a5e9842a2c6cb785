"""The motion of the base as a caller gives it, its pose C and its twist V with rates, checked, as arrays.

The twist is (angular; linear), in the axes of the base and about its origin; its rates are those of these components.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jounce.arguments import names
from jounce.arguments.rates import rates_in
from jounce.core.errors import JounceError, quoted
from jounce.core.scalars import FLOAT, Array, asarray, is_jax, is_numeric, is_traced, shaped
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import hat, rotation
from jounce.spatial.series import rate_name

NOT_A_POSE = 1e-6  # what rounding to six or seven digits leaves of an orthogonal matrix


def terms_of(base: object) -> tuple[Any, ...]:
    """Return the terms of the motion of a base; a tuple has all of them, anything else is the pose alone."""
    rates = rates_in(base)
    return () if base is None else (base,) if rates is None else rates


def base_of(mechanism: Mechanism, base: object, count: int, what: str) -> list[Array]:
    """Return the `count` terms C, V, Vd, ... that a quantity takes, the pose (..., 4, 4), the others (..., 6)."""
    terms = terms_of(base)
    if len(terms) != count or any(term is None for term in terms):
        raise _miscounted(mechanism, terms, count, what)
    arrays = [asarray(term, f"{_label(k)} of base") for k, term in enumerate(terms)]
    for k, (term, array) in enumerate(zip(terms, arrays, strict=True)):
        if any(isinstance(name, str) for name in names.listed_in(term) or ()):
            raise JounceError(f"base: {_label(k)} names its entries; expected an array in the order (angular; linear)")
        shape, parts = ((6,), ", (angular; linear)") if k else ((4, 4), ", a pose, body to inertial frame")
        shaped(array, shape, f"base: {_label(k)}", parts)
    check_pose(arrays[0])
    return arrays


def check_pose(C: Array) -> None:
    """Raise `JounceError` unless matrices (..., 4, 4) of numbers are poses; NaN passes."""
    if is_jax(C) and not is_traced(C):
        C = np.asarray(C)
    if not is_numeric(C):
        return
    off = not_a_pose(C if C.dtype == FLOAT else C.astype(float))
    if (off > NOT_A_POSE).any():
        at = np.unravel_index(np.nanargmax(off), off.shape)
        where = f" of sample {', '.join(map(str, at))}" if at else ""
        raise JounceError(
            f"base: C{where} is no pose: [R, r; 0, 1] with an orthogonal R of determinant 1 is missed by {off[at]:.2g};"
            f" expected {NOT_A_POSE:g} at most"
        )


def not_a_pose(C: np.ndarray) -> np.ndarray:
    """How far matrices (..., 4, 4) are from poses: the largest entry of R^T R - 1, of det R - 1 and of the last row."""
    return np.maximum.reduce([np.abs(part).max(axis=(-2, -1)) for part in misses(C)])


def misses(C: Array) -> tuple[Array, ...]:
    """What vanishes of poses (..., 4, 4): R^T R - 1, det R - 1, and what the last row is besides 0, 0, 0, 1."""
    R = rotation(C)
    x, y, z = (R[..., k : k + 1] for k in range(3))
    one = np.eye(4, dtype=int)
    return R.mT @ R - one[:3, :3], (hat(x[..., 0]) @ y).mT @ z - 1, C[..., 3:, :] - one[3:]


def _label(k: int) -> str:
    return rate_name("V", k - 1) if k else "C"


def _miscounted(mechanism: Mechanism, terms: Sequence[Any], count: int, what: str) -> JounceError:
    takes = ", ".join(map(_label, range(count))) if count < 5 else f"C, V, ..., {_label(count - 1)}"
    takes = f"base=({takes})" if count > 1 else "base=C"
    if not terms:
        return JounceError(
            f"base is None, yet {mechanism.name!r} floats; {what} takes {takes}: pose, twist and its rates"
        )
    missing = [_label(k) for k, term in enumerate(terms) if term is None]
    if missing:
        return JounceError(f"base: {missing[0]} is None; {what} takes {takes}, none of them left out")
    if isinstance(terms[0], Mapping | str):
        return JounceError(f"base is {quoted(terms[0])}; {what} takes {takes}")
    alone = "C alone, as a list is one array" if isinstance(terms[0], list) else "C alone"
    given = f"{len(terms)} terms, up to {_label(len(terms) - 1)}" if len(terms) > 1 else alone
    return JounceError(f"base gives {given}; {what} with these rates of q takes {takes}")
