"""Robots with a ball, planar or free joint between two revolute ones, or on the ground before one."""

import numpy as np

import jounce
from jounce.model import screws
from jounce.spatial import groups
from jounce.spatial.lie import Ad
from support.robots import random_inertia, random_pose


def amid(kind: str, ground: bool = False, seed: int = 5) -> jounce.Robot:
    """Joints "turn" and "tip", and "ankle" of a kind between them, whose frame is not that of its body.

    On the ground it is the first one, and there is no "turn".
    """
    rng, group, axis = np.random.default_rng(seed), groups.GROUPS[kind], np.array([0, 0, 1.0, 0, 0, 0])
    frame = random_pose(rng)
    X = [axis, *(Ad(frame) @ group.X).T, axis]
    owners = [0, *[1] * len(group.axes), 2]
    names = ["turn", *(f"ankle.{name}" for name in group.velocities), "tip"]
    first = int(ground)
    count = 3 - first
    return jounce.Robot(
        screws.from_screws(
            np.stack([random_pose(rng) for _ in range(count)]),
            np.stack(X[first:]),
            np.stack([random_inertia(rng, 1.5) for _ in range(count)]),
            range(-1, count - 1),
            screws.ScrewOptions(
                owners=[owner - first for owner in owners[first:]], joint_names=names[first:], name=kind
            ),
        )
    )
