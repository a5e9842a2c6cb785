"""The recursive Newton-Euler algorithm with two time derivatives, as Buondonno and De Luca differentiate it.

Classical vectors stand where the paper has twists: angular velocities and accelerations of points, with their
derivatives, outward; forces and moments with theirs, inward. A dot is the derivative of a vector in space, and all of
them are written in the axes of their body.

G. Buondonno, A. De Luca, "A Recursive Newton-Euler Algorithm for Robots with Elastic Joints and its Application to
Control", IROS 2015; "Efficient Computation of Inverse Dynamics and Feedback Linearization for VSA-Based Robots", IEEE
Robotics and Automation Letters 1(2), 2016. Written from the mathematics, for revolute joints about axes through the
origins of their bodies.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb
from typing import Any

import numpy as np

from jounce import JounceError, Mechanism
from jounce.core.scalars import cos, sin
from jounce.spatial.inertia import moments
from jounce.spatial.lie import hat

Vectors = list[Any]  # a vector and its derivatives


@dataclass(frozen=True)
class Link:
    """The constants of a body: pose in its parent at q = 0, axis, mass, centre of mass and inertia about it."""

    parent: int
    R: np.ndarray
    r: np.ndarray
    z: np.ndarray
    m: float
    c: np.ndarray
    inertia: np.ndarray


def links(mechanism: Mechanism) -> list[Link]:
    """The constants of all bodies."""
    if mechanism.X[:, 3:].any() or not np.array_equal(mechanism.G, np.eye(mechanism.n)):
        raise JounceError(f"{mechanism.name}: the recursion supports revolute joints about axes through the origins")
    m, h, _ = (np.asarray(x, dtype=float) for x in moments(mechanism.M))
    m, c = m.reshape(-1), h.reshape(-1, 3) / m.reshape(-1, 1)
    inertia = mechanism.M[:, :3, :3] + m[:, None, None] * (hat(c) @ hat(c))
    B, axes = mechanism.B, mechanism.X[:, :3]
    return [Link(p, B[i, :3, :3], B[i, :3, 3], axes[i], m[i], c[i], inertia[i]) for i, p in enumerate(mechanism.parent)]


def inverse_dynamics(bodies: Sequence[Link], gravity: np.ndarray, rates: Sequence[Any]) -> list[Any]:
    """Q, Qd, ... of the coordinates and their rates q, qd, q2d, ..., each (n,), of scalars of any type."""
    order = len(rates) - 3
    still: Vectors = [np.zeros(3, dtype=int)] * (order + 2)
    rotations, arms, axes, forces, moments_of = [], [], [], [], []
    moving: list[tuple[Vectors, Vectors]] = []  # angular velocity; acceleration of the origin
    for i, body in enumerate(bodies):
        rotation = body.R @ _turn(body.z, rates[0][i])  # to the parent's axes
        w_p, a_p = moving[body.parent] if body.parent >= 0 else (still, [-gravity, *still[:order]])
        arm = _differentiate(body.r, w_p, order + 2)  # to the origin of the body
        w = [rotation.T @ x for x in w_p]
        z = _differentiate(body.z, w, order + 1)  # the axis is fixed in the parent too
        w = [w[k] + sum(comb(k, j) * z[j] * rates[k - j + 1][i] for j in range(k + 1)) for k in range(order + 2)]
        a = [rotation.T @ (a_p[k] + arm[k + 2]) for k in range(order + 1)]
        centre = _differentiate(body.c, w, order + 2)
        f = [body.m * (a[k] + centre[k + 2]) for k in range(order + 1)]  # Newton
        forces.append(f)
        moments_of.append([x + y for x, y in zip(_euler(body.inertia, w, order), _moments(centre, f), strict=True)])
        rotations.append(rotation)
        arms.append(arm)
        axes.append(z)
        moving.append((w, a))
    for i in reversed(range(len(bodies))):
        if (p := bodies[i].parent) >= 0:
            f, n = ([rotations[i] @ x for x in vectors[i]] for vectors in (forces, moments_of))
            forces[p] = [x + y for x, y in zip(forces[p], f, strict=True)]
            moments_of[p] = [x + y + z for x, y, z in zip(moments_of[p], n, _moments(arms[i], f), strict=True)]
    return [
        np.array(
            [sum(comb(k, j) * (z[j] @ n[k - j]) for j in range(k + 1)) for z, n in zip(axes, moments_of, strict=True)]
        )
        for k in range(order + 1)
    ]  # tau = z . n


def _turn(z: np.ndarray, q: Any) -> Any:
    """Rotation about a unit vector, after Euler and Rodrigues."""
    return np.eye(3, dtype=int) + hat(z) * sin(q) + hat(z) @ hat(z) * (1 - cos(q))


def _differentiate(x: Any, w: Vectors, highest: int) -> Vectors:
    """A vector fixed in a body that turns with w, and its derivatives: x' = w x x."""
    found = [x]
    for k in range(highest):
        found.append(_leibniz(w, found, k))
    return found


def _moments(arm: Vectors, f: Vectors) -> Vectors:
    """The moment of a force at the end of an arm, arm x f, and its derivatives."""
    return [_leibniz(arm, f, k) for k in range(len(f))]


def _euler(inertia: np.ndarray, w: Vectors, order: int) -> Vectors:
    """The rate of the angular momentum L = I w about the centre of mass, and its derivatives.

    In the axes of the body I is constant: the components of L change by I times those of w. Components of a vector x
    change by x' - w x x.
    """
    components, x = [], w
    for _ in range(order + 2):
        components.append(x[0])
        x = [x[k + 1] - _leibniz(w, x, k) for k in range(len(x) - 1)]
    found, x = [], [inertia @ v for v in components]
    for _ in range(order + 1):
        x = [x[k + 1] + _leibniz(components, x, k) for k in range(len(x) - 1)]
        found.append(x[0])
    return found


def _leibniz(x: Vectors, y: Vectors, k: int) -> Any:
    """The k-th derivative of x cross y."""
    return sum(comb(k, j) * _cross(x[j], y[k - j]) for j in range(k + 1))


def _cross(x: Any, y: Any) -> Any:
    return np.array([x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]])
