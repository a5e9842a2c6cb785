"""Check the poses that a caller gives: how far matrices are from poses."""

from typing import Any

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import FLOAT, Array, is_jax, is_numeric, is_traced
from jounce.spatial.lie import hat, rotation

POSE_TOLERANCE = 1e-6  # max abs(R^T R - I), or of a length less 1: what rounding to six or seven digits leaves


def check_pose(C: Array, what: str = "base: C") -> None:
    """Raise `JounceError` unless matrices (..., 4, 4) are poses.

    Symbols and NaN pass.
    """
    if is_jax(C) and not is_traced(C):
        C = np.asarray(C)
    if not is_numeric(C):
        return
    errors = pose_error(C if C.dtype == FLOAT else C.astype(float))
    if (errors > POSE_TOLERANCE).any():
        index, sample = worst_sample(errors)
        pose = "[R, r; 0, 1] with an orthogonal R of determinant 1"
        missed = f"{pose} is missed by {errors[index]:.2g}; expected {POSE_TOLERANCE:g} at most"
        raise JounceError(f"{what}{sample} is no pose: {missed}")


def worst_sample(errors: np.ndarray) -> tuple[Any, str]:
    """Return the index of the largest error, and its sample for messages."""
    index = np.unravel_index(np.nanargmax(errors), errors.shape)
    return index, "" if len(index) == 0 else f" of sample {', '.join(map(str, index))}"


def pose_error(C: np.ndarray) -> np.ndarray:
    """Return how far matrices (..., 4, 4) are from poses.

    It is the largest entry of R^T R - 1, of det R - 1 and of the last row less (0, 0, 0, 1).
    """
    return np.maximum.reduce([np.abs(part).max(axis=(-2, -1)) for part in pose_residuals(C)])


def pose_residuals(C: Array) -> tuple[Array, ...]:
    """Return the residuals of matrices (..., 4, 4), which vanish for poses.

    They are R^T R - 1, det R - 1, and the last row less (0, 0, 0, 1).
    """
    R = rotation(C)
    x, y, z = (R[..., k : k + 1] for k in range(3))
    identity = np.eye(4, dtype=int)
    # det R = (x cross y) . z of its columns.
    return R.mT @ R - identity[:3, :3], (hat(x[..., 0]) @ y).mT @ z - 1, C[..., 3:, :] - identity[3:]
