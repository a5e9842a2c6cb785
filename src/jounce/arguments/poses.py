"""Poses that a caller gives, checked: how far matrices are from poses."""

from typing import Any

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import FLOAT, Array, is_jax, is_numeric, is_traced
from jounce.spatial.lie import hat, rotation

POSE_TOLERANCE = 1e-6  # max abs(R^T R - I), or of a length less 1: what rounding to six or seven digits leaves


def check_pose(C: Array, what: str = "base: C") -> None:
    """Raise `JounceError` unless matrices (..., 4, 4) of numbers are poses; NaN passes."""
    if is_jax(C) and not is_traced(C):
        C = np.asarray(C)
    if not is_numeric(C):
        return
    off = pose_error(C if C.dtype == FLOAT else C.astype(float))
    if (off > POSE_TOLERANCE).any():
        at, where = worst_sample(off)
        pose = "[R, r; 0, 1] with an orthogonal R of determinant 1"
        missed = f"{pose} is missed by {off[at]:.2g}; expected {POSE_TOLERANCE:g} at most"
        raise JounceError(f"{what}{where} is no pose: {missed}")


def worst_sample(errors: np.ndarray) -> tuple[Any, str]:
    """The index of the largest of some errors, and where it is, as messages say it."""
    at = np.unravel_index(np.nanargmax(errors), errors.shape)
    return at, f" of sample {', '.join(map(str, at))}" if at else ""


def pose_error(C: np.ndarray) -> np.ndarray:
    """How far matrices (..., 4, 4) are from poses: the largest entry of R^T R - 1, of det R - 1 and of the last row."""
    return np.maximum.reduce([np.abs(part).max(axis=(-2, -1)) for part in pose_residuals(C)])


def pose_residuals(C: Array) -> tuple[Array, ...]:
    """What vanishes of poses (..., 4, 4): R^T R - 1, det R - 1, and what the last row is besides 0, 0, 0, 1."""
    R = rotation(C)
    x, y, z = (R[..., k : k + 1] for k in range(3))
    one = np.eye(4, dtype=int)
    return R.mT @ R - one[:3, :3], (hat(x[..., 0]) @ y).mT @ z - 1, C[..., 3:, :] - one[3:]
