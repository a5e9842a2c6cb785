"""Robots whose revolute joints have a ball, a planar and a free joint amid them, named as files name them."""

import numpy as np
from robots import random_inertia, random_pose, random_screw

import jounce
from jounce.spatial.groups import GROUPS
from jounce.spatial.lie import Ad

KINDS = {"hip": "revolute", "ankle": "ball", "toe": "revolute", "deck": "planar", "lid": "revolute", "box": "free"}
PARENTS = [-1, 0, 1, 1, 3, 2]


def amid(kinds=KINDS, parents=PARENTS, *, name="amid", floats=False, tilted=True):
    """A robot of named joints of some kinds with random bodies; `tilted` puts their frames anywhere but on these."""
    rng = np.random.default_rng(7)
    X, names, owners = [], [], []
    for i, (joint, kind) in enumerate(kinds.items()):
        group = GROUPS.get(kind)
        if group is None:
            own = random_screw(rng, kind)[:, None]
        else:
            own = Ad(random_pose(rng)) @ group.X if tilted else group.X
        X.append(own.T)
        names += [joint] if group is None else [f"{joint}.{velocity}" for velocity in group.velocities]
        owners += [i] * own.shape[1]
    return jounce.Robot.from_screws(
        [random_pose(rng) for _ in kinds],
        np.concatenate(X),
        [random_inertia(rng, rng.uniform(0.5, 2)) for _ in kinds],
        parents,
        owners=owners,
        joint_names=names,
        base=random_inertia(rng, 3.0) if floats else None,
        name=name,
    )


def chain(length, kind="ball"):
    """Revolute joints one behind the other, the middle one of another kind."""
    kinds = {f"j{i}": kind if i == length // 2 else "revolute" for i in range(length)}
    return amid(kinds, range(-1, length - 1), name="chain")


def states(robot, count, *batch, seed=0):
    """Random positions, quaternions of any length, and velocities with so many rates in all."""
    rng = np.random.default_rng(seed)
    return [rng.normal(size=(*batch, robot.nq)), *rng.uniform(-1, 1, (count - 1, *batch, robot.nv))]
