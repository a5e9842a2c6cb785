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

Algorithm: M. J. Todd, K. C. Toh and R. H. Tütüncü, "On the Nesterov-Todd direction in semidefinite programming", SIAM
Journal on Optimization 8, 1998. Invariants: S = V V^T and X = W W^T are positive definite, as no step reaches singular
matrices; mu never falls below weight. Failure: `JounceError` after MAX_INTERIOR_POINT_STEPS, where weight is so small
against the data that the minimum is singular to rounding.
"""

from dataclasses import dataclass

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.typing import Floats

MAX_INTERIOR_POINT_STEPS = 300  # most data take 10 to 20
MIN_MU_RATIO = 0.1  # of the mu that a step aims at to the mean of S X: with smaller ones steps end at the boundary
MAX_SHARE_TO_BOUNDARY = 0.9  # of the way to singular matrices that a step goes, so that S and X stay definite
INTERIOR_POINT_STEP_TOLERANCE = 1e-8  # relative; Newton squares it, so that the next step would be rounding
DECREMENT_TOLERANCE = 1e-12  # relative change of f that ends the search where rounding keeps steps large
_UPPER_ROWS, _UPPER_COLUMNS = np.triu_indices(4)
# factors that give the ten entries the norm of the symmetric matrix
_ENTRY_FACTORS = np.where(_UPPER_ROWS == _UPPER_COLUMNS, 1.0, np.sqrt(2.0))


@dataclass(frozen=True, eq=False)
class SemidefiniteProblem:
    """The terms of f."""

    C: Floats  # (k, bodies, 4, 4), symmetric
    R: Floats  # (k, drives)
    y: Floats  # (k,)
    own: Floats  # (drives,)
    positive: np.ndarray  # (drives,), whether d is not negative
    weight: float


def minimise(problem: SemidefiniteProblem) -> tuple[Floats, Floats]:
    """Return a root V of S = V V^T, and d, where f has its minimum; raise `JounceError` after too many steps."""
    # the start: S = 1, and a multiple of 1 for X that is as large as the slope of the residual
    one = np.tile(np.eye(4), (problem.C.shape[1], 1, 1))
    V, t, last = one, 1.0, np.inf
    slope = np.einsum("k,kbij->bij", problem.R @ problem.own - _residual_target(problem, V), problem.C)
    W = np.sqrt(max(problem.weight, np.abs(slope).max())) * one  # X = W W^T
    for _ in range(MAX_INTERIOR_POINT_STEPS):
        # scaling: S = G D G^T, D = G^T X G
        _, s, turn = np.linalg.svd(W.mT @ V)
        G, D, sizes = V @ turn.mT / np.sqrt(s)[:, None], s[:, None] * one, np.sqrt(s[:, :, None] * s[:, None])
        # mu: the more the last step was cut short, the closer to the mean of S X
        mu = max(problem.weight, max(MIN_MU_RATIO, 1 - t) * float(np.mean(s * s)))
        Z, d = _newton_step(problem, G, s, mu)
        # the largest share of the step Z of S, and of the step `back` of X, after which both are definite
        back = mu * np.linalg.inv(D) - D - Z
        nearest = min(np.linalg.eigvalsh(change / sizes).min() for change in (Z, back))
        t = 1.0 if nearest > -MAX_SHARE_TO_BOUNDARY else -MAX_SHARE_TO_BOUNDARY / nearest
        V, W = G @ np.linalg.cholesky(D + t * Z), np.linalg.solve(G.mT, np.linalg.cholesky(D + t * back))
        # convergence: only of full steps at the final mu
        change, r = float(np.abs(Z / sizes).max()), problem.R @ d - _residual_target(problem, V)
        rounding = last / 2 < change and mu * change**2 < DECREMENT_TOLERANCE * (mu + r @ r / 2)
        if mu == problem.weight and t == 1 and (change < INTERIOR_POINT_STEP_TOLERANCE or rounding):
            return V, d
        last = change
    steps = f"within {MAX_INTERIOR_POINT_STEPS} steps"
    raise JounceError(f"no physically consistent parameters {steps}; expected a smaller prior")


def _newton_step(problem: SemidefiniteProblem, G: Floats, s: Floats, mu: float) -> tuple[Floats, Floats]:
    """Return Z, and d after the step."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    J = _to_vectors(G.mT @ problem.C @ G).reshape(len(problem.y), len(_ENTRY_FACTORS) * len(G))
    target = _to_vectors(mu / s[:, None] * np.eye(4) - problem.weight * G.mT @ G).ravel()
    # one least-squares problem in (z, d); the triangular factor leaves bounded variables, the last, to the last rows
    order = np.argsort(problem.positive, kind="stable")
    w, n, size = np.sqrt(problem.weight), J.shape[1], J.shape[1] + len(order)
    A = np.block([[J, problem.R[:, order]], [np.diag(np.repeat([1.0, w], [n, len(order)]))]])
    b = np.concatenate([_residual_target(problem, G * np.sqrt(s)[:, None]), target, w * problem.own[order]])
    T = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    k = size - np.count_nonzero(problem.positive)
    bounded = nnls(T[k:size, k:size], T[k:size, -1])[0] if k < size else np.zeros(0)
    x = np.append(solve_triangular(T[:k, :k], T[:k, -1] - T[:k, k:size] @ bounded), bounded)
    z, d = x[:n], x[n:][np.argsort(order)]
    Z = np.zeros((len(G), 4, 4))
    Z[:, _UPPER_ROWS, _UPPER_COLUMNS] = Z[:, _UPPER_COLUMNS, _UPPER_ROWS] = z.reshape(-1, 10) / _ENTRY_FACTORS
    return Z, d


def _residual_target(problem: SemidefiniteProblem, V: Floats) -> Floats:
    """y - C S, which R d approaches."""
    return np.asarray(problem.y - np.einsum("kbij,bij->k", problem.C, V @ V.mT))


def _to_vectors(S: Floats) -> Floats:
    """The entries of symmetric matrices, as vectors of the same norm: (..., 4, 4) to (..., 10)."""
    return np.asarray(S[..., _UPPER_ROWS, _UPPER_COLUMNS] * _ENTRY_FACTORS)
