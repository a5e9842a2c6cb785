"""Planar robots with closed loops of any lengths: five-bars and four-bars of rods, and circles that intersect.

Shares with jounce: nothing, in `elbows` and `elbows_along`.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import jounce
from jounce.model.frame import Frame

Z = [0, 0, 1, 0, 0, 0]


def shift(x: float, turn: float = 0.0) -> np.ndarray:
    """The pose at a distance along x, turned about z."""
    T = np.eye(4)
    T[0, 3] = x
    T[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    return T


def rods(
    chains: Sequence[tuple[int, float, Sequence[float]]], damping: float = 0.0, zeros: Sequence[float] = ()
) -> jounce.Robot:
    """The tree of rods of 1 kg in the x-y plane: per chain its carrier, the place of its pin, lengths of its rods.

    Frames "end0", "end1", ... are at the ends of the chains; `zeros` are added to all coordinates.
    """
    parent, B, lengths, frames = [], [], [], []
    for k, (carrier, place, chain) in enumerate(chains):
        for i, length in enumerate(chain):
            parent.append(len(parent) - 1 if i else carrier)
            B.append(shift(chain[i - 1] if i else place, -zeros[len(B)] if zeros else 0.0))
            lengths.append(length)
        frames.append(Frame(f"end{k}", len(parent) - 1, shift(chain[-1])))
    M = [jounce.inertia_matrix(1.0, [x / 2, 0, 0], np.diag([1e-4, x**2 / 12, x**2 / 12])) for x in lengths]
    drives = {"damping": np.full(len(parent), damping)}
    tree = jounce.Robot.from_screws(B, [Z] * len(parent), M, parent, gravity=[0, -9.81, 0], drives=drives).mechanism
    return jounce.Robot(replace(tree, frames=tuple(frames)))


def fivebar(base: float, left: Sequence[float], right: Sequence[float], start: Sequence[float]) -> jounce.Robot:
    """The closed five-bar with shoulders at 0 and `base` on the x axis; its coordinates are 0 and 2."""
    tree = rods([(-1, 0.0, left), (-1, base, right)])
    names = tree.joint_names
    return tree.closed([("end0", "end1")], [names[0], names[2]], start=start)


def fourbar(
    ground: float, crank: float, coupler: float, rocker: float, start: Sequence[float], **options: Any
) -> jounce.Robot:
    """The closed four-bar, moved by its crank; start is crank, coupler and rocker, relative angles."""
    tree = rods([(-1, 0.0, [crank, coupler]), (-1, ground, [rocker])], **options)
    return tree.closed([("end0", "end1")], [tree.joint_names[0]], start=np.add(start, options.get("zeros", 0.0)))


def palletizer() -> jounce.Robot:
    """A parallelogram whose coupler moves a rocker by a rod: one loop with constant ratios, and one without."""
    tree = rods([(-1, 0.0, [0.5, 1.0]), (-1, 1.0, [0.5]), (1, 0.7, [0.9]), (-1, 1.5, [0.8])])
    loops = [("end0", "end1"), ("end2", "end3")]
    return tree.closed(loops, [tree.joint_names[0]], start=[0.7, -0.7, 0.7, 0.4, 1.0])


def unit(angle: np.ndarray) -> np.ndarray:
    """The direction (..., 2) of an angle."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def elbows(
    base: float, left: Sequence[float], right: Sequence[float], shoulders: np.ndarray, side: int
) -> tuple[np.ndarray, np.ndarray]:
    """The elbow angles (..., 2) of a five-bar from circles that intersect, and how far within reach it is.

    `side` says on which side of the line of the elbows the circles meet. The reach is the square of half the chord of
    the circles, negative where they do not meet.
    """
    a, b = shoulders[..., 0], shoulders[..., 1]
    first, second = left[0] * unit(a), right[0] * unit(b) + [base, 0]
    across = second - first
    square = (across**2).sum(-1)
    along = (left[1] ** 2 - right[1] ** 2 + square) / 2  # times the distance
    reach = left[1] ** 2 - along**2 / square
    normal = np.stack([-across[..., 1], across[..., 0]], axis=-1)
    tip = (along / square)[..., None] * across
    tip = first + tip + (side * np.sqrt(np.maximum(reach, 0) / square))[..., None] * normal
    angles = [np.arctan2(*np.moveaxis(tip - elbow, -1, 0)[::-1]) for elbow in (first, second)]
    return np.stack(angles, axis=-1) - shoulders, reach


def elbows_along(
    base: float, left: Sequence[float], right: Sequence[float], start: np.ndarray, stop: np.ndarray, side: int
) -> tuple[np.ndarray, float]:
    """How far (2,) the elbows turn along the straight line between two pairs of shoulders, and the least reach."""
    s = np.linspace(0, 1, 4001)[:, None]
    shoulders = start + s * (stop - start)
    turned, reach = elbows(base, left, right, shoulders, side)
    whole = np.unwrap(turned + shoulders, axis=0) - shoulders
    return whole[-1] - whole[0], float(reach.min())
