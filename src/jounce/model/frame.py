"""Frames fixed on bodies."""

from dataclasses import dataclass

from jounce.core.scalars import Array


@dataclass(frozen=True)
class Frame:
    """A named frame fixed on a body (-1: the ground), `T` its pose in the body frame."""

    name: str
    body: int
    T: Array
