"""Orientations as robot files state them: angles of roll, pitch and yaw, axes of any length."""

import math

import numpy as np

from jounce.core.errors import warn
from jounce.model import coordinates
from jounce.model.frame import UNIT_ROUNDING


def from_rpy(angles: np.ndarray, place: str) -> np.ndarray:
    """The rotation matrix ``Rz(yaw) Ry(pitch) Rx(roll)`` of the angles (roll, pitch, yaw) in rad.

    Angles of more than a turn look like degrees: a warning names the place that states them.
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
    """The unit vector along an axis, which is left as it is where its length is 1; None where it is 0."""
    if not axis.any():
        return None
    if abs(math.hypot(*axis) - 1) <= UNIT_ROUNDING:
        return axis
    scaled = axis / np.abs(axis).max()  # first, so that no length is too long or too short to be squared
    return scaled / np.linalg.norm(scaled)
