"""Random robots with balls, planar and free joints."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import jounce
from jounce.spatial import groups
from jounce.spatial.lie import Ad
from support.robots import random_inertia, random_pose, random_screw

TREES = {  # kinds of joints, and parents
    "ball": (["ball"], [-1]),
    "planar": (["planar"], [-1]),
    "free": (["free"], [-1]),
    "branches": (
        ["revolute", "ball", "planar", "free", "revolute", "ball", "prismatic", "helical"],
        [-1, 0, 0, 1, 2, 4, 3, 5],
    ),
    "forest": (["ball", "free", "revolute", "planar", "ball"], [-1, -1, 1, 0, 2]),
}


def screw_robot(name: str, seed: int = 0, *, floats: bool = False, tilted: bool = False) -> jounce.Robot:
    """One of `TREES` with random bodies; `tilted` puts the frames of bodies anywhere but on their joints."""
    return random_robot(*TREES[name], np.random.default_rng(seed), floats, tilted, gravity=[0.5, -1.0, -9.5])


def random_robot(
    kinds: Sequence[str], parents: Sequence[int], rng: np.random.Generator, floats: bool, tilted: bool, **data: Any
) -> jounce.Robot:
    """A robot of random bodies on joints of some kinds, with other data of `from_screws`."""
    X, owners = [], []
    for i, kind in enumerate(kinds):
        if kind in groups.GROUPS:
            own = (Ad(random_pose(rng)) if tilted else np.eye(6)) @ groups.GROUPS[kind].X
        else:
            own = random_screw(rng, kind)[:, None]
        X.append(own.T)
        owners += [i] * own.shape[1]
    return jounce.Robot.from_screws(
        [random_pose(rng) for _ in kinds],
        np.concatenate(X),
        [random_inertia(rng, rng.uniform(0.5, 2)) for _ in kinds],
        parents,
        owners=owners,
        base=random_inertia(rng, 3.0) if floats else None,
        **data,
    )
