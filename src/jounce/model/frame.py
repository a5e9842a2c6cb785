"""Frames fixed on bodies."""

from dataclasses import dataclass

from jounce.core.scalars import Array

UNIT_ROUNDING = 1e-15  # what rounding leaves of exact 0 and 1 in rotations, axes and pitches


@dataclass(frozen=True)
class Frame:
    """A named frame fixed on a body (-1: the ground), `T` its pose in the body frame."""

    name: str
    body: int
    T: Array
