"""The robots that are measured, and states for them."""

from functools import cache

import numpy as np

import jounce
from jounce.spatial.lie import pose

Rates = tuple[np.ndarray, ...]  # q, qd, q2d, ..., each (states, n)
GENERAL = "7 joints at no special angles"  # beside the iiwa, whose right angles save operations
ARMS = ("iiwa14", GENERAL)


@cache
def states(n: int, count: int, order: int) -> Rates:
    """So many states, with the rates that forces of an order take; the same arrays for all that ask."""
    rng = np.random.default_rng(n)
    return tuple(np.ascontiguousarray(rng.uniform(-1, 1, (count, n))) for _ in range(order + 3))


def load(name: str) -> jounce.Robot:
    """A bundled robot or one of a file, or the general arm."""
    return chain(7) if name == GENERAL else jounce.load(name)


def chain(n: int) -> jounce.Robot:
    """A chain of n revolute joints, axes at no special angles, links of 0.1 m and 0.5 kg."""
    rng = np.random.default_rng(7)
    B, M = [], []
    for _ in range(n):
        c, s = np.cos(angle := rng.uniform(0.3, 1.2)), np.sin(angle)
        B.append(pose(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), np.array([[0.1], [0], [0.03]])))
        M.append(jounce.inertia_matrix(0.5, rng.uniform(-0.05, 0.05, 3), np.diag([2e-3, 3e-3, 4e-3])))
    return jounce.Robot.from_screws(B, [[0, 0, 1, 0, 0, 0]] * n, M, name=f"chain of {n}")


def start_of_iiwa(n: int) -> jounce.Robot:
    """The first n joints of the iiwa."""
    m = jounce.load("iiwa14").mechanism
    return jounce.Robot.from_screws(m.B[:n], m.X[:n], m.M[:n], gravity=m.gravity, name=f"first {n} joints of the iiwa")
