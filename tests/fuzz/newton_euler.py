"""An oracle: the laws of Newton and Euler for every body in inertial axes, along Taylor series in time in long doubles.

x(t) = sum_k x[k] t^k: the first axis of an array counts Taylor coefficients, the second states. No twist, no wrench, no
recursion: poses as rotations and displacements, momenta, their rates, moments about axes.

Shares with jounce: nothing.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np

LONG = np.longdouble


@dataclass(frozen=True)
class Body:
    """A body and the joint that carries it, in the body's own axes; `parent` -1 is the ground."""

    parent: int
    rotation: np.ndarray  # (3, 3) of the body's axes in those of its parent, at rest
    position: np.ndarray  # (3,) of its origin
    axis: np.ndarray  # (3,), of length 1
    point: np.ndarray  # (3,) on the axis
    pitch: float | None  # m/rad; None where the joint slides along its axis
    mass: float
    com: np.ndarray  # (3,)
    inertia: np.ndarray  # (3, 3) about the centre of mass


@dataclass(frozen=True)
class Tree:
    """Bodies, each after its parent; joint variables are theta = coupling q + offset."""

    bodies: tuple[Body, ...]
    gravity: np.ndarray
    coupling: np.ndarray  # (nb, n)
    offset: np.ndarray  # (nb,)


def forces(tree: Tree, q: Sequence[np.ndarray], W: Sequence[np.ndarray] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Q and its rates at states q, qd, ..., each (N, n), as (order + 1, N, n); and the size of what they add up.

    `W`, Wd, ... (N, nb, 6) are what bodies exert on their environment, moments and forces in body axes.
    """
    theta = _coefficients(q) @ tree.coupling.T.astype(LONG)
    theta[0] += tree.offset
    loads = _coefficients(W) if W else None
    poses = _poses(tree, theta)
    F, N, sizes = zip(*(_demand(tree, i, poses[i], loads) for i in range(len(tree.bodies))), strict=True)
    F, N, sizes = list(F), list(N), list(sizes)
    for i, body in reversed(list(enumerate(tree.bodies))):
        if body.parent >= 0:
            for sums in (F, N, sizes):
                sums[body.parent] = sums[body.parent] + sums[i]
    along = [_along(body, *poses[i], F[i], N[i]) for i, body in enumerate(tree.bodies)]
    scale = np.array([factorial(k) for k in range(len(along[0]))], LONG)
    Q = np.stack(along, axis=-1) @ tree.coupling.astype(LONG)
    size = np.stack(sizes, axis=-1) @ abs(tree.coupling).astype(LONG)
    return Q * scale[:, None, None], size * scale[:, None, None]


def _coefficients(rates: Sequence[np.ndarray]) -> np.ndarray:
    return np.stack([np.asarray(x, LONG) / factorial(k) for k, x in enumerate(rates)])


def _series_product(f: Callable, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The coefficients of f(x(t), y(t)), where f is linear in both."""
    count = min(len(x), len(y))
    z = f(x[0], y[:count])
    for i in range(1, count):
        z[i:] += f(x[i], y[: count - i])
    return z


def _rate(x: np.ndarray) -> np.ndarray:
    return np.stack([k * x[k] for k in range(1, len(x))])


def _apply(R: np.ndarray, v: np.ndarray) -> np.ndarray:
    return (R @ v[..., None])[..., 0]


def _dot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return (x * y).sum(axis=-1)


def _sin_cos(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From s' = c x' and c' = -s x'."""
    s, c = [np.sin(x[0])], [np.cos(x[0])]
    for k in range(1, len(x)):
        s.append(sum(j * x[j] * c[k - j] for j in range(1, k + 1)) / k)
        c.append(-sum(j * x[j] * s[k - j] for j in range(1, k + 1)) / k)
    return np.stack(s), np.stack(c)


def _poses(tree: Tree, theta: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotations (K, N, 3, 3) and origins (K, N, 3) of the bodies in inertial axes."""
    poses = []
    for i, body in enumerate(tree.bodies):
        R, p = _turn(body, theta[..., i])
        A = body.rotation.astype(LONG)
        R, p = A @ R, p @ A.T
        p[0] += body.position
        if body.parent >= 0:
            R_p, p_p = poses[body.parent]
            R, p = _series_product(np.matmul, R_p, R), p_p + _series_product(_apply, R_p, p)
        poses.append((R, p))
    return poses


def _turn(body: Body, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the joint makes of the axes and the origin of the body, seen from where they are at rest."""
    e, x, one = body.axis.astype(LONG), body.point.astype(LONG), np.eye(3, dtype=LONG)
    if body.pitch is None:
        R = np.zeros((*theta.shape, 3, 3), LONG)
        R[0] = one
        return R, theta[..., None] * e
    s, c = _sin_cos(theta)
    E = np.cross(e, one).T  # E v = e x v
    s, c = s[..., None, None], c[..., None, None]
    R = s * E + c * (one - np.outer(e, e))  # Rodrigues' formula
    R[0] += np.outer(e, e)
    p = body.pitch * theta[..., None] * e - R @ x
    p[0] += x
    return R, p


def _demand(tree: Tree, i: int, pose: tuple[np.ndarray, np.ndarray], loads: np.ndarray | None) -> tuple:
    """The force and the moment about the inertial origin that a body takes, and the size of its terms."""
    (R, p), body = pose, tree.bodies[i]
    c = p + R @ body.com.astype(LONG)
    f = body.mass * _rate(_rate(c))
    f[0] -= body.mass * tree.gravity.astype(LONG)
    spin = _series_product(lambda x, y: x @ y.mT, _rate(R), R)  # w x, skew
    w = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
    inertia = _series_product(lambda x, y: x @ y.mT, R @ body.inertia.astype(LONG), R)
    n = _rate(_series_product(_apply, inertia, w))
    N = n + _series_product(np.cross, c, f)
    size = _series_product(np.multiply, _length(c), _length(f)) + _length(n)
    if loads is not None:
        moment, force = (_series_product(_apply, R, loads[..., i, part]) for part in (slice(3), slice(3, 6)))
        f, N = f + force, N + moment + _series_product(np.cross, p, force)
        size = size + _series_product(np.multiply, _length(p), _length(force)) + _length(moment)
    return f, N, size + _length(f)


def _length(x: np.ndarray) -> np.ndarray:
    return np.sqrt(_dot(x, x))


def _along(body: Body, R: np.ndarray, p: np.ndarray, F: np.ndarray, N: np.ndarray) -> np.ndarray:
    """What the joint does of a force and a moment about the inertial origin."""
    e = R @ body.axis.astype(LONG)
    if body.pitch is None:
        return _series_product(_dot, e, F)
    a = p + R @ body.point.astype(LONG)
    return _series_product(_dot, e, N - _series_product(np.cross, a, F)) + body.pitch * _series_product(_dot, e, F)
