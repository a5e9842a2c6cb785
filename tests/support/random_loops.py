"""Random robots with closed loops: frames are placed where they meet, independent coordinates are chosen by rank."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

import jounce
from jounce.arguments.loops import build_loop
from jounce.dynamics import loop_assembly
from jounce.model.drive_trains import AMOUNTS, DRIVE_TERMS
from jounce.model.frame import Frame
from jounce.model.loops import Closure
from jounce.spatial import lie
from support.robots import floating, random_mechanism, random_pose, random_rotation
from support.units import SI, Units, coordinate_factors, in_units

R, P, H = "revolute", "prismatic", "helical"
LOOPED: dict[str, dict[str, Any]] = {  # the arguments of `random_closed`
    "cylindrical with mimic joint and drives": {
        "parent": [-1, 0, 1, 2, 3, -1, 5], "kinds": [R] * 7, "loops": [(4, 6, "cylindrical")], "mimic": True,
        "drives": True,
    },
    "prismatic with drives": {
        "parent": [-1, 0, 1, 2, 3, 4, 5], "kinds": [R] * 7, "loops": [(6, -1, "prismatic")], "drives": True,
    },
    "revolute": {"parent": [-1, 0, 1, -1, 3, 4, 5], "kinds": [R, R, R, R, P, R, H], "loops": [(2, 6, "revolute")]},
    "fixed to a floating base": {
        "parent": [-1, 0, 1, 2, 3, 4, 5], "kinds": [R] * 7, "loops": [(6, -1, "fixed")], "floats": True,
    },
    "two that share joints": {
        "parent": [-1, 0, 1, 2, 3, 1, 5, 6], "kinds": [R, R, P, R, R, R, H, R],
        "loops": [(4, 7, "planar"), (2, 6, "spherical")],
    },
}  # fmt: skip


@cache
def looped(name: str) -> jounce.Robot:
    """One of these robots."""
    return random_closed(np.random.default_rng(1), **LOOPED[name])


def random_closed(
    rng: np.random.Generator,
    parent: list[int],
    kinds: list[str],
    loops: list[tuple[int, int, str]],
    mimic: bool = False,
    drives: bool = False,
    floats: bool = False,
    units: Units = SI,
) -> jounce.Robot:
    """The closed robot of a random tree, with loops (body, body, joint) that are closed at a random configuration."""
    nb = len(parent)
    m = random_mechanism(rng, parent, kinds, [*rng.uniform(0.5, 3, nb)], mimic)
    if drives:
        terms = {name: rng.uniform(0.1, 1, nb) for name in (*(AMOUNTS[term] for term in DRIVE_TERMS), "rest")}
        data = {"gravity": m.gravity, "G": m.G, "g": m.g, "drives": terms}
        m = jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, **data).with_drives(eps=0.5).mechanism
    q = rng.uniform(-1, 1, m.n)
    C = [np.eye(4), *jounce.Robot(m).poses(q, method="recursion")]
    frames, stated = [], []
    for k, (a, b, joint) in enumerate(loops):
        T = random_pose(rng)
        frames += [Frame(f"a{k}", a, T), Frame(f"b{k}", b, lie.inverse(C[b + 1]) @ C[a + 1] @ T)]
        stated.append((f"a{k}", f"b{k}", joint, random_rotation(rng)[0]))
    m = replace(m, frames=tuple(frames))
    m = floating(m, rng) if floats else m
    independent = _independent(m, stated, q)
    return jounce.Robot(in_units(m, units)).closed(stated, independent, start=q * coordinate_factors(m, units))


def _independent(m: Any, loops: list[tuple[str, str, str, np.ndarray]], q: np.ndarray) -> list[str]:
    """The coordinates that are left when those with the largest pivots of the constraints are not."""
    everything = tuple(range(m.n))
    closure = Closure(m.coordinates, m.G, m.g, everything, q, everything, np.ones(m.n))
    m = replace(m, loops=tuple(build_loop(m, *given) for given in loops), closure=closure)
    A, dependent = loop_assembly.scaled_constraints(m, q[None])[0], []
    for _ in range(np.linalg.matrix_rank(A, rtol=1e-8)):
        dependent.append(int(np.argmax(np.linalg.norm(A, axis=0))))
        e = A[:, dependent[-1]] / np.linalg.norm(A[:, dependent[-1]])
        A = A - np.outer(e, e @ A)
    return [name for j, name in enumerate(m.coordinates) if j not in dependent]
