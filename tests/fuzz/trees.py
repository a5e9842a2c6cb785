"""Random trees and forests for the oracle, the robots of jounce that they are, and arrays in odd layouts."""

from dataclasses import replace

import numpy as np

import jounce
from fuzz.newton_euler import Body, Tree
from support.robots import random_rotation
from support.units import SI, UNITS, Units

KINDS = ("revolute", "prismatic", "helical")


def random_tree(rng: np.random.Generator, nb: int) -> Tree:
    """A chain, tree or forest of any joints; some follow others, some bodies have no mass, some trees are plain."""
    reach = int(rng.choice([1, 3, nb]))  # how far back a parent is
    plain = rng.random() < 0.3  # right angles and many zeros, of which compiled code is cleared
    bodies = tuple(_random_body(rng, i, max(-1, i - reach), plain) for i in range(nb))
    gravity = np.array([0, 0, -9.81]) if plain else rng.normal(size=3) * 6
    return Tree(bodies, gravity, *_coupling(rng, nb))


def _random_body(rng: np.random.Generator, i: int, first: int, plain: bool) -> Body:
    kind, rotation = rng.choice(KINDS), _quarter_turns(rng) if plain else random_rotation(rng)
    position, point, com = (
        np.zeros(3) if plain and rng.random() < 0.5 else rng.uniform(-0.5, 0.5, 3) for _ in range(3)
    )
    axis = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1]) if plain else random_rotation(rng)[0]
    mass = 0.0 if rng.random() < 0.15 else 10 ** rng.uniform(-2, 2)
    second = np.diag(rng.uniform(0, 0.1, 3) * (rng.random() < 0.8))  # moments of the distribution of mass; or a point
    turn = np.eye(3) if plain else random_rotation(rng)
    return Body(
        parent=int(rng.integers(first, i)) if i else -1,
        rotation=rotation,
        position=position,
        axis=axis,
        point=point,
        pitch={"revolute": 0.0, "prismatic": None, "helical": rng.uniform(-0.3, 0.3)}[kind],
        mass=mass,
        com=com,
        inertia=mass * turn @ (np.trace(second) * np.eye(3) - second) @ turn.T,
    )


def random_units(rng: np.random.Generator) -> Units:
    """SI units as often as others of length and mass."""
    return SI if rng.random() < 0.5 else UNITS[rng.integers(len(UNITS))]


def tree_in_units(tree: Tree, u: Units) -> Tree:
    """The tree in other units of length and mass; its coordinates have none, as slides are lengths times these."""
    bodies = tuple(
        replace(
            body,
            position=body.position * u.length,
            point=body.point * u.length,
            pitch=body.pitch and body.pitch * u.length,
            mass=body.mass * u.mass,
            com=body.com * u.length,
            inertia=body.inertia * u.of(2, 1),
        )
        for body in tree.bodies
    )
    slides = np.array([u.length if body.pitch is None else 1.0 for body in tree.bodies])
    return Tree(bodies, tree.gravity * u.length, tree.coupling * slides[:, None], tree.offset * slides)


def _quarter_turns(rng: np.random.Generator) -> np.ndarray:
    R = np.eye(3)[rng.permutation(3)] * rng.choice([-1.0, 1.0], 3)
    return R * np.linalg.det(R)


def _coupling(rng: np.random.Generator, nb: int) -> tuple[np.ndarray, np.ndarray]:
    """The identity, joints that follow others, or any linear coupling."""
    kind = rng.choice(["none", "mimic", "any"])
    if kind == "none" or nb == 1:
        return np.eye(nb), np.zeros(nb)
    if kind == "any":
        return rng.uniform(-1, 1, (nb, rng.integers(1, nb + 1))), rng.uniform(-1, 1, nb)
    leads = rng.random(nb) < 0.7
    leads[rng.integers(nb)] = True
    coupling = np.zeros((nb, leads.sum()))
    coupling[leads] = np.eye(leads.sum())
    for i in np.flatnonzero(~leads):
        coupling[i, rng.integers(leads.sum())] = rng.uniform(-2, 2)
    return coupling, np.where(leads, 0.0, rng.uniform(-1, 1, nb))


def robot_of_tree(tree: Tree) -> jounce.Robot:
    """The same robot, by its screws."""
    rest, zero = np.tile(np.eye(4), (len(tree.bodies), 1, 1)), np.zeros(3)
    for B, body in zip(rest, tree.bodies, strict=True):
        B[:3, :3], B[:3, 3] = body.rotation, body.position
    X = [
        [*zero, *body.axis] if body.pitch is None
        else [*body.axis, *(np.cross(body.point, body.axis) + body.pitch * body.axis)]
        for body in tree.bodies
    ]  # fmt: skip
    M = [jounce.inertia_matrix(body.mass, body.com, body.inertia) for body in tree.bodies]
    parents = [body.parent for body in tree.bodies]
    return jounce.Robot.from_screws(rest, X, M, parents, gravity=tree.gravity, G=tree.coupling, g=tree.offset)


def laid_out(rng: np.random.Generator, x: np.ndarray) -> np.ndarray:
    """The same numbers in another layout: of Fortran, with gaps, backwards, at an odd address, not to be written."""
    kind = rng.choice(["as it is", "fortran", "gaps", "backwards", "odd address", "read-only"])
    if kind == "fortran":
        return np.asfortranarray(x)
    if kind == "gaps":
        wide = np.full([2 * k for k in x.shape], np.nan)
        part = wide[tuple(slice(None, None, 2) for _ in x.shape)]
        part[...] = x
        return part
    if kind == "backwards":
        turned = tuple(slice(None, None, -1) for _ in x.shape)
        return x[turned].copy()[turned]
    if kind == "odd address":
        moved = np.empty(x.nbytes + 1, np.uint8)[1:].view(x.dtype).reshape(x.shape)
        moved[...] = x
        return moved
    if kind == "read-only":
        x = x.copy()
        x.flags.writeable = False
    return x
