"""Converts orientations of robot files: roll, pitch and yaw, and axes of any length."""

import math

import numpy as np

from jounce.core.errors import warn
from jounce.model import coordinates
from jounce.model.frame import UNIT_ROUNDING


def from_rpy(angles: np.ndarray, place: str) -> np.ndarray:
    """Return the rotation matrix ``Rz(yaw) Ry(pitch) Rx(roll)`` of angles in rad.

    The angles are (roll, pitch, yaw). Angles of more than a turn look like degrees: a warning names the place that
    states them.
    """
    if np.abs(angles).max() > coordinates.MIN_DEGREES_ANGLE:
        warn(f"{place}: rpy is {angles.round(6).tolist()}, more than a turn; expected angles in rad")
    roll, pitch, yaw = angles
    return _rotation_about(2, yaw) @ _rotation_about(1, pitch) @ _rotation_about(0, roll)


def _rotation_about(axis: int, angle: float) -> np.ndarray:
    j, k = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[j, j] = R[k, k] = np.cos(angle)
    R[k, j] = np.sin(angle)
    R[j, k] = -R[k, j]
    return R


def unit_direction(axis: np.ndarray) -> np.ndarray | None:
    """Return the unit vector along an axis, None for zeros.

    An axis of length 1 is left as it is.
    """
    if not axis.any():
        return None
    if abs(math.hypot(*axis) - 1) <= UNIT_ROUNDING:
        return axis
    # No length is too long or too short to be squared then.
    scaled = axis / np.abs(axis).max()
    return scaled / np.linalg.norm(scaled)
