"""Least squares over positive definite matrices that stay near given ones, by a primal-dual interior-point method.

Over positive definite S_b (4, 4) and variables d, some of which are not negative,

    f = |r|^2 / 2 + weight (sum of tr S_b - log det S_b - 4 over b + |d - own|^2 / 2),   r = C S + R d - y,

is minimised. The term in S_b is the divergence from the unit matrix: convex, zero there, infinite where S_b is
singular. At the minimum, with multipliers X_b,

    C^T r + weight 1 = X,    S X = mu 1,    mu = weight.

Newton's method follows the solutions of these equations from larger mu. With G such that S = G D G^T and
D = G^T X G for a diagonal D (Nesterov's and Todd's scaling), a step ``S + G Z G^T`` minimises

    |r + C G Z G^T + R (d - d_now)|^2 / 2 + |Z|^2 / 2 - tr((mu D^-1 - weight G^T G) Z) + weight |d - own|^2 / 2:

linear least squares, bounded in d alone, in which information is not squared.

M. J. Todd, K. C. Toh and R. H. Tütüncü, "On the Nesterov-Todd direction in semidefinite programming", SIAM Journal on
Optimization 8, 1998.
"""

from dataclasses import dataclass

import numpy as np

from jounce._typing import Floats
from jounce.errors import JounceError

STEPS = 300
LEAST = 0.1  # of the mean of S X, to be reached by a step
FARTHEST = 0.9  # of the way to singular matrices
CONVERGED = 1e-8  # relative steps, of which the next would be smaller than rounding
ROUNDING = 1e-12  # relative changes of f that end the search if the steps do not become smaller
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


def minimum(problem: Problem) -> tuple[Floats, Floats]:
    """Return a root V of S = V V^T, and d, where f has its minimum.

    Raises
    ------
    JounceError : if that takes too many steps.
    """
    one = np.tile(np.eye(4), (problem.C.shape[1], 1, 1))
    V, d, t, last = one, problem.own, 1.0, np.inf
    start = max(problem.weight, np.abs(np.einsum("k,kbij->bij", _residual(problem, V, d), problem.C)).max())
    W = np.sqrt(start) * one  # X = W W^T
    for _ in range(STEPS):
        _, s, turn = np.linalg.svd(W.mT @ V)
        G, D, sizes = V @ turn.mT / np.sqrt(s)[:, None], s[:, None] * one, np.sqrt(s[:, :, None] * s[:, None])
        mu = max(problem.weight, max(LEAST, 1 - t) * float(np.mean(s * s)))
        Z, new = _step(problem, G, s, d, mu)
        back = mu * np.linalg.inv(D) - D - Z
        nearest = min(np.linalg.eigvalsh(change / sizes).min() for change in (Z, back))
        t = 1.0 if nearest > -FARTHEST else -FARTHEST / nearest
        V, W = G @ np.linalg.cholesky(D + t * Z), np.linalg.solve(G.mT, np.linalg.cholesky(D + t * back))
        d = d + t * (new - d)
        change, r = float(np.abs(Z / sizes).max()), _residual(problem, V, d)
        rounding = last / 2 < change and mu * change**2 < ROUNDING * (mu + r @ r / 2)
        if mu == problem.weight and t == 1 and (change < CONVERGED or rounding):
            return V, d
        last = change
    raise JounceError(f"no physically consistent parameters within {STEPS} steps; expected a larger weight")


def _residual(problem: Problem, V: Floats, d: Floats) -> Floats:
    return np.asarray(np.einsum("kbij,bij->k", problem.C, V @ V.mT) + problem.R @ d - problem.y)


def _step(problem: Problem, G: Floats, s: Floats, d: Floats, mu: float) -> tuple[Floats, Floats]:
    """Return Z, and d after the step."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import lsq_linear

    J = _entries(G.mT @ problem.C @ G).reshape(len(problem.y), len(_NORM) * len(G))
    r = _residual(problem, G * np.sqrt(s)[:, None], d)
    wanted = _entries(mu / s[:, None] * np.eye(4) - problem.weight * G.mT @ G).ravel()
    w, n = np.sqrt(problem.weight), J.shape[1]
    A = np.block([[J, problem.R], [np.diag(np.repeat([1.0, w], [n, len(d)]))]])
    b = np.concatenate([-r, wanted, w * (problem.own - d)])
    T = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    A, b = T[: n + len(d), :-1], T[: n + len(d), -1]
    step = np.zeros(len(d))
    if len(step):
        least = np.where(problem.positive, -d, -np.inf)
        step = lsq_linear(A[n:, n:], b[n:], (least, np.inf), method="bvls").x
    z = solve_triangular(A[:n, :n], b[:n] - A[:n, n:] @ step)
    Z = np.zeros((len(G), 4, 4))
    Z[:, _ROWS, _COLUMNS] = Z[:, _COLUMNS, _ROWS] = z.reshape(-1, 10) / _NORM
    return Z, np.where(problem.positive, np.maximum(d + step, 0.0), d + step)


def _entries(S: Floats) -> Floats:
    """The entries of symmetric matrices, as vectors of the same norm: (..., 4, 4) to (..., 10)."""
    return np.asarray(S[..., _ROWS, _COLUMNS] * _NORM)
