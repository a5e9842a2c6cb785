"""Least squares over positive definite matrices that stay near given ones, by a primal-dual interior-point method.

Over positive definite S_b (4, 4) and variables d, some of which are not negative,

    f = |r|^2 / 2 + weight (sum of tr S_b - log det S_b - 4 over b + |d - own|^2 / 2),   r = C S + R d - y,

is minimised. The term in S_b is the divergence from the unit matrix: convex, zero there, infinite where S_b is
singular. At the minimum, with multipliers X_b,

    C^T r + weight 1 = X,    S X = mu 1,    mu = weight.

Newton's method follows the solutions of these equations from larger mu. With G such that S = G D G^T and
D = G^T X G for a diagonal D (Nesterov's and Todd's scaling), a step ``S + G Z G^T`` minimises

    |C (S + G Z G^T) + R d - y|^2 / 2 + |Z|^2 / 2 - tr((mu D^-1 - weight G^T G) Z) + weight |d - own|^2 / 2:

linear least squares, bounded in d alone, in which information is not squared.

M. J. Todd, K. C. Toh and R. H. Tütüncü, "On the Nesterov-Todd direction in semidefinite programming", SIAM Journal on
Optimization 8, 1998.
"""

from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.typing import Floats

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
    V, t, last = one, 1.0, np.inf
    slope = np.einsum("k,kbij->bij", problem.R @ problem.own - _off(problem, V), problem.C)
    W = np.sqrt(max(problem.weight, np.abs(slope).max())) * one  # X = W W^T
    for _ in range(STEPS):
        _, s, turn = np.linalg.svd(W.mT @ V)
        G, D, sizes = V @ turn.mT / np.sqrt(s)[:, None], s[:, None] * one, np.sqrt(s[:, :, None] * s[:, None])
        mu = max(problem.weight, max(LEAST, 1 - t) * float(np.mean(s * s)))
        Z, d = _step(problem, G, s, mu)
        back = mu * np.linalg.inv(D) - D - Z
        nearest = min(np.linalg.eigvalsh(change / sizes).min() for change in (Z, back))
        t = 1.0 if nearest > -FARTHEST else -FARTHEST / nearest
        V, W = G @ np.linalg.cholesky(D + t * Z), np.linalg.solve(G.mT, np.linalg.cholesky(D + t * back))
        change, r = float(np.abs(Z / sizes).max()), problem.R @ d - _off(problem, V)
        rounding = last / 2 < change and mu * change**2 < ROUNDING * (mu + r @ r / 2)
        if mu == problem.weight and t == 1 and (change < CONVERGED or rounding):
            return V, d
        last = change
    raise JounceError(f"no physically consistent parameters within {STEPS} steps; expected a smaller prior")


def _step(problem: Problem, G: Floats, s: Floats, mu: float) -> tuple[Floats, Floats]:
    """Return Z, and d after the step."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    J = _entries(G.mT @ problem.C @ G).reshape(len(problem.y), len(_NORM) * len(G))
    target = _entries(mu / s[:, None] * np.eye(4) - problem.weight * G.mT @ G).ravel()
    order = np.argsort(problem.positive, kind="stable")  # those with bounds last, to be found from the last rows alone
    w, n, size = np.sqrt(problem.weight), J.shape[1], J.shape[1] + len(order)
    A = np.block([[J, problem.R[:, order]], [np.diag(np.repeat([1.0, w], [n, len(order)]))]])
    b = np.concatenate([_off(problem, G * np.sqrt(s)[:, None]), target, w * problem.own[order]])
    T = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    k = size - np.count_nonzero(problem.positive)
    bounded = nnls(T[k:size, k:size], T[k:size, -1])[0] if k < size else np.zeros(0)
    x = np.append(solve_triangular(T[:k, :k], T[:k, -1] - T[:k, k:size] @ bounded), bounded)
    z, d = x[:n], x[n:][np.argsort(order)]
    Z = np.zeros((len(G), 4, 4))
    Z[:, _ROWS, _COLUMNS] = Z[:, _COLUMNS, _ROWS] = z.reshape(-1, 10) / _NORM
    return Z, d


def _off(problem: Problem, V: Floats) -> Floats:
    """What R d has to be, y - C S."""
    return np.asarray(problem.y - np.einsum("kbij,bij->k", problem.C, V @ V.mT))


def _entries(S: Floats) -> Floats:
    """The entries of symmetric matrices, as vectors of the same norm: (..., 4, 4) to (..., 10)."""
    return np.asarray(S[..., _ROWS, _COLUMNS] * _NORM)
