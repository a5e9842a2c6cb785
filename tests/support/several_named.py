"""Robots whose revolute joints have a ball, a planar and a free joint amid them, named as files name them."""

import numpy as np

from jounce.spatial import groups
from support.several_screws import random_robot

KINDS = {"hip": "revolute", "ankle": "ball", "toe": "revolute", "deck": "planar", "lid": "revolute", "box": "free"}
PARENTS = [-1, 0, 1, 1, 3, 2]


def named_robot(kinds=KINDS, parents=PARENTS, *, name="amid", floats=False, tilted=True):
    """A robot of named joints of some kinds with random bodies; `tilted` puts their frames anywhere but on these."""
    names = [
        label
        for joint, kind in kinds.items()
        for label in ([f"{joint}.{x}" for x in groups.GROUPS[kind].velocities] if kind in groups.GROUPS else [joint])
    ]
    rng = np.random.default_rng(7)
    return random_robot([*kinds.values()], parents, rng, floats, tilted, joint_names=names, name=name)


def named_chain(length, kind="ball"):
    """Revolute joints one behind the other, the middle one of another kind."""
    kinds = {f"j{i}": kind if i == length // 2 else "revolute" for i in range(length)}
    return named_robot(kinds, range(-1, length - 1), name="chain")


def states(robot, count, *batch, seed=0):
    """Random positions, quaternions of any length, and velocities with so many rates in all."""
    rng = np.random.default_rng(seed)
    return [rng.normal(size=(*batch, robot.nq)), *rng.uniform(-1, 1, (count - 1, *batch, robot.nv))]
