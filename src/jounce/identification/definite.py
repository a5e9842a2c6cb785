"""Least squares over positive definite matrices that stay near given ones, by Newton's method.

Over positive definite S_b (4, 4) and variables d, some of which are not negative,

    f = |r|^2 / 2 + weight (sum of tr S_b - log det S_b - 4 over b + |d - own|^2 / 2),   r = C S + R d - y,

is minimised. The term in S_b is the divergence from the unit matrix: convex, zero there, infinite where S_b is
singular. With ``S = V (1 + Z) V^T`` near ``V V^T``, f is to second order in Z and d the squared residual of linear
equations,

    |r(V V^T, d) + C V Z V^T|^2 / 2 + weight (|Z + V^T V - 1|^2 + |d - own|^2) / 2 + constant,

so that a step is a least-squares problem, bounded in d alone, in which information is not squared. f / weight is
self-concordant: from any start, steps that are shortened until they descend end near the only minimum, where full ones
converge quadratically.

Y. Nesterov and A. Nemirovskii, "Interior-point polynomial algorithms in convex programming", SIAM, 1994.
"""

from dataclasses import dataclass

import numpy as np

from jounce._typing import Floats
from jounce.errors import JounceError

STEPS = 1000
NEAR, THERE = 1e-2, 1e-8  # descents, over the weight, below which full steps converge, and the last step is taken
_ROWS, _COLUMNS = np.triu_indices(4)
_NORM = np.where(_ROWS == _COLUMNS, 1.0, np.sqrt(2.0))  # so that ten entries have the norm of the symmetric matrix


@dataclass(frozen=True, eq=False)
class Problem:
    """What is minimised."""

    C: Floats  # (k, bodies, 4, 4), symmetric
    R: Floats  # (k, drives)
    y: Floats  # (k,)
    own: Floats  # (drives,)
    positive: np.ndarray  # (drives,), whether d is not negative
    weight: float


@dataclass(frozen=True, eq=False)
class Point:
    """Matrices S = V V^T, and variables d."""

    V: Floats  # (bodies, 4, 4)
    d: Floats  # (drives,)


def minimum(problem: Problem) -> Point:
    """Find where f has its minimum.

    Raises
    ------
    JounceError : if that takes too many steps.
    """
    at = Point(np.tile(np.eye(4), (problem.C.shape[1], 1, 1)), problem.own)
    for _ in range(STEPS):
        Z, d, descent = _newton_step(problem, at)
        if descent <= NEAR * problem.weight:
            at = _moved(at, Z, d, 1.0)
            if descent <= THERE * problem.weight:
                return at
            continue
        t = min(1.0, -0.95 / min(np.linalg.eigvalsh(Z).min(), -0.1))
        f = _value(problem, at)
        while _value(problem, new := _moved(at, Z, d, t)) > f - 0.1 * t * descent:
            t /= 2
        at = new
    raise JounceError(f"no physically consistent parameters within {STEPS} steps; expected a larger weight")


def _value(problem: Problem, at: Point) -> float:
    S, r, off = at.V @ at.V.mT, _residual(problem, at), at.d - problem.own
    near = np.trace(S, axis1=1, axis2=2) - np.linalg.slogdet(S)[1] - 4
    return float(r @ r / 2 + problem.weight * (near.sum() + off @ off / 2))


def _residual(problem: Problem, at: Point) -> Floats:
    return np.asarray(np.einsum("kbij,bij->k", problem.C, at.V @ at.V.mT) + problem.R @ at.d - problem.y)


def _moved(at: Point, Z: Floats, d: Floats, t: float) -> Point:
    return Point(at.V @ np.linalg.cholesky(np.eye(4) + t * Z), at.d + t * (d - at.d))


def _newton_step(problem: Problem, at: Point) -> tuple[Floats, Floats, float]:
    """Return Z and d of the minimum of f to second order, and by how much it is lower."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import lsq_linear

    J = _entries(at.V.mT @ problem.C @ at.V).reshape(len(problem.y), -1)
    off = np.concatenate([_entries(at.V.mT @ at.V - np.eye(4)).ravel(), at.d - problem.own])
    w, n = np.sqrt(problem.weight), J.shape[1]
    A = np.block([[J, problem.R], [w * np.eye(len(off))]])
    b = -np.append(_residual(problem, at), w * off)
    T = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    A, b = T[:-1, :-1], T[:-1, -1]
    step = np.zeros(len(at.d))
    if len(step):
        least = np.where(problem.positive, -at.d, -np.inf)
        step = lsq_linear(A[n:, n:], b[n:], (least, np.inf), method="bvls").x
    z = solve_triangular(A[:n, :n], b[:n] - A[:n, n:] @ step)
    change = A @ np.append(z, step)
    Z = np.zeros((len(at.V), 4, 4))
    Z[:, _ROWS, _COLUMNS] = Z[:, _COLUMNS, _ROWS] = z.reshape(-1, 10) / _NORM
    d = np.where(problem.positive, np.maximum(at.d + step, 0.0), at.d + step)
    return Z, d, float(change @ (b - change / 2))


def _entries(S: Floats) -> Floats:
    """The entries of symmetric matrices, as vectors of the same norm: (..., 4, 4) to (..., 10)."""
    return np.asarray(S[..., _ROWS, _COLUMNS] * _NORM)
