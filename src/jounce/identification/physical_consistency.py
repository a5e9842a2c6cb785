"""Fit inertial parameters of bodies that can exist, nearest to what data say.

Moments of mass ``Pi = [[P, h], [h^T, m]]`` (4, 4) of a body, its pseudo-inertia, are those of a distribution of mass
where they are positive definite (semidefinite: of a flat body, or of points). Data are given by their information
matrix A about parameters z, the base parameters and those of drive terms, and by the estimate z* of least squares
without conditions: elsewhere the squared residual is larger by ``(z - z*)^T A (z - z*)``. The parameters found minimise

    (z - z*)^T A (z - z*) / 2 + weight (sum of D(Pi_b, Pi0_b) over the bodies b + sum of ((d - d0) / s)^2 / 2)

over positive definite Pi_b and drive parameters d, which are not negative but for springs and offsets. Here
``D(Pi, Pi0) = tr(Pi0^-1 Pi) - log det(Pi0^-1 Pi) - 4`` is the divergence from the robot's own pseudo-inertias, which
neither frames nor units change, d0 are the robot's own drive parameters, and forces of s are as large as all. The
function is convex: its only minimum is found from any start.

A is in units of the variance of the measurements, so the weight has a meaning, whatever the robot: near Pi0, D is half
the square of the relative change of second moments, so that 1 / sqrt(weight) is their relative standard deviation if
the robot's own values are read as measurements. It is large by default: parameters that the data know to a factor of
two or better follow the data, within a tenth of their deviations; where the data say less, the robot's own values
decide, and where they say nothing these remain. Where the data ask for bodies that cannot exist, D keeps the bodies
inside, and the squared residual is larger than the smallest of bodies that can exist by about 8 weight for each.

P. M. Wensing, S. Kim and J.-J. E. Slotine, "Linear matrix inequalities for physically consistent inertial parameter
identification", IEEE Robotics and Automation Letters 3, 2018; T. Lee, P. M. Wensing and F. C. Park, "Geometric robot
dynamic identification: a convex programming approach", IEEE Transactions on Robotics 36, 2020.

`fit_consistent_parameters` and `fit_consistent_body` are the doors. Each writes Pi_b = T_b S_b T_b^T with the roots T_b
of Pi0_b, and calls `minimise` once, which finds positive definite S_b (4, 4) and variables d of the least

    f = |r|^2 / 2 + weight (sum of tr S_b - log det S_b - 4 over b + |d - own|^2 / 2),   r = C S + R d - y.

The term in S_b is the divergence from the unit matrix: convex, zero there, infinite where S_b is singular. At the
minimum, with multipliers X_b,

    C^T r + weight 1 = X,    S X = mu 1,    mu = weight.

Algorithm: a primal-dual interior-point method. Newton's method follows the solutions of these equations from larger mu.
With G such that S = G D G^T and D = G^T X G for a diagonal D (the scaling of M. J. Todd, K. C. Toh and R. H. Tütüncü,
"On the Nesterov-Todd direction in semidefinite programming", SIAM Journal on Optimization 8, 1998), a step
``S + G Z G^T`` minimises

    |C (S + G Z G^T) + R d - y|^2 / 2 + |Z|^2 / 2 - tr((mu D^-1 - weight G^T G) Z) + weight |d - own|^2 / 2:

linear least squares, bounded in d alone, in which information is not squared.

Invariants: S = V V^T and X = W W^T are positive definite, as no step reaches singular matrices; mu never falls below
weight. Failure: `JounceError` after MAX_INTERIOR_POINT_STEPS, where weight is so small against the data that the
minimum is singular to rounding.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core import errors
from jounce.core.errors import JounceError
from jounce.core.scalars import Array
from jounce.core.typing import DriveTerm, Floats
from jounce.dynamics.base_parameters import BaseParameters
from jounce.model import drive_trains
from jounce.model.mechanism import Mechanism, robot_size
from jounce.spatial import inertia

DEFAULT_DIVERGENCE_WEIGHT = 1e-2  # in units of half the squared residual over the variance: a prior of 10
MIN_RELATIVE_MOMENT = 1e-6  # of second moments to the largest: a body with less is flat, or made of points
RAISED_RELATIVE_MOMENT = 1e-3  # that such a body gets, to have an inside: one thirtieth as thick as wide
POINT_MASS_TOLERANCE = 1e-9  # of the squared length of a robot: smaller second moments per mass are rounding
MAX_INTERIOR_POINT_STEPS = 300  # most data take 10 to 20
MIN_MU_RATIO = 0.1  # of the mu that a step aims at to the mean of S X: with smaller ones steps end at the boundary
MAX_SHARE_TO_BOUNDARY = 0.9  # of the way to singular matrices that a step goes, so that S and X stay definite
INTERIOR_POINT_STEP_TOLERANCE = 1e-8  # relative; Newton squares it, so that the next step would be rounding
DECREMENT_TOLERANCE = 1e-12  # relative change of f that ends the search where rounding keeps steps large
_UPPER_ROWS, _UPPER_COLUMNS = np.triu_indices(4)
# factors that give the ten entries the norm of the symmetric matrix
_ENTRY_FACTORS = np.where(_UPPER_ROWS == _UPPER_COLUMNS, 1.0, np.sqrt(2.0))


@dataclass(frozen=True, eq=False)
class ConsistentParameters:
    """Inertial parameters of bodies that can exist, with parameters of drive terms, fitted to data."""

    parameters: Floats  # (10 nb,) as `Robot.inertial_parameters`
    drives: Mapping[DriveTerm, Floats]  # (joints,) of each drive term
    values: Floats  # (k,) the same as base parameters, followed by the parameters of the drive terms
    massless: tuple[str, ...]  # bodies without mass, which stay so
    thickened: tuple[str, ...]  # flat, point-like or impossible bodies, for which nearby ones stand


def fit_consistent_parameters(
    mechanism: Mechanism,
    base: BaseParameters,
    information: Floats,
    estimate: Floats,
    terms: Sequence[DriveTerm] = (),
    *,
    weight: float = DEFAULT_DIVERGENCE_WEIGHT,
) -> ConsistentParameters:
    """Fit physically consistent inertial parameters, and parameters of drive terms, to data.

    `information` (k, k) is A = sum of Y^T W Y over the samples, W the inverse covariance of the forces, of the base
    parameters followed by those of the drive terms, one of each joint for every term; it may be singular. `estimate`
    (k,) is z*, which minimises the squared residual: A z* = sum of Y^T W Q; any such where A is singular.

    Raises `JounceError` if a body has moments but no mass, or a negative mass; if none has mass; without a minimum.
    """
    Pi = inertia.moment_matrix(mechanism.M)
    massive = _massive_bodies(mechanism, Pi)
    start = _raise_moments(Pi[massive], robot_size(mechanism))
    thickened = massive[(start != Pi[massive]).any(axis=(1, 2))]
    T = np.asarray(np.linalg.cholesky(start))
    d, R = _drive_values(mechanism, terms), _information_root(information)
    size = np.linalg.norm(R, axis=0)[base.count :]  # of the forces of each drive parameter
    everything = max(1.0, np.linalg.norm(R @ estimate), np.linalg.norm(R @ np.append(base.values, d)))
    seen = np.diag(information)[base.count :] > 0  # the others stay as they are
    scale = everything / size[seen]
    by_body = (R[:, : base.count] @ base.matrix).reshape(len(R), len(Pi), len(inertia.INERTIAL_PARAMETERS))[:, massive]
    problem = SemidefiniteProblem(
        C=np.asarray(np.einsum("kbp,bijp->kbij", by_body, _entry_derivatives(T))),
        R=R[:, base.count :][:, seen] * scale,
        y=R @ estimate,
        own=d[seen] / scale,
        positive=np.repeat(
            [drive_trains.AMOUNTS[term] not in drive_trains.SIGNED_PARAMETERS for term in terms], len(mechanism.joints)
        ).astype(bool)[seen],
        weight=weight,
    )
    V, d[seen] = minimise(problem)
    d[seen] *= scale
    Pi[massive] = (root := T @ V) @ root.mT
    p = inertia.parameters(inertia.from_moment_matrix(Pi)).ravel()
    names = np.array(mechanism.bodies)
    return ConsistentParameters(
        parameters=p,
        drives=dict(zip(terms, d.reshape(-1, len(mechanism.joints)), strict=True)),
        values=np.append(base.matrix @ p, d),
        massless=tuple(np.delete(names, massive).tolist()),
        thickened=tuple(names[thickened].tolist()),
    )


def fit_consistent_body(estimate: Floats, information: Floats, prior: Floats, weight: float) -> Floats:
    """The inertial parameters (10,) of a body that can exist, near to an estimate and to moments of mass (4, 4)."""
    T, R = np.linalg.cholesky(prior), _information_root(information)
    C = np.einsum("kp,ijp->kij", R, _entry_derivatives(T))[:, None]
    none = np.zeros(0)
    problem = SemidefiniteProblem(C, np.zeros((len(R), 0)), R @ estimate, none, none.astype(bool), weight)
    root = T @ minimise(problem)[0][0]
    return np.asarray(inertia.parameters(inertia.from_moment_matrix(root @ root.T)))


def _massive_bodies(mechanism: Mechanism, Pi: Floats) -> np.ndarray:
    """The places of the bodies that have mass; those without must not have moments."""
    start = "physically consistent parameters start from the robot's own: state"
    for name, of_body in zip(mechanism.bodies, Pi, strict=True):
        if of_body[3, 3] < 0 or (of_body[3, 3] == 0 and of_body.any()):
            came = f"body {errors.shorten(name)!r} has mass {of_body[3, 3]:g} kg and moments"
            raise JounceError(f"{came}; {start} a mass, or no inertia")
    massive = np.flatnonzero(Pi[:, 3, 3])
    if not massive.size:
        raise JounceError(f"{mechanism.name}: no body has mass; {start} a rough mass and inertia for each body")
    return massive


def _raise_moments(Pi: Floats, length: float) -> Floats:
    """Pseudo-inertias, with second moments about the COM raised where they are singular or those of no body."""
    m = Pi[:, 3:, 3:]
    c = Pi[:, :3, 3:] / m
    size, axes = np.linalg.eigh(Pi[:, :3, :3] - m * c @ c.mT)
    whole = m[:, 0] * length**2
    largest = np.where(size[:, 2:] > POINT_MASS_TOLERANCE * whole, size[:, 2:], whole)
    raised = Pi.copy()
    raised[:, :3, :3] = axes * np.maximum(size, RAISED_RELATIVE_MOMENT * largest)[:, None] @ axes.mT + m * c @ c.mT
    return np.where((size[:, :1] < MIN_RELATIVE_MOMENT * largest)[..., None], raised, Pi)


def _drive_values(mechanism: Mechanism, terms: Sequence[DriveTerm]) -> Floats:
    """The robot's own parameters of drive terms."""
    return np.concatenate([np.zeros(0), *(getattr(mechanism.drives, drive_trains.AMOUNTS[term]) for term in terms)])


def _information_root(information: Floats) -> Floats:
    """R of ``A = R^T R``, without directions of which A holds no more than rounding: (rank, k)."""
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0, size, 1.0)
    w, V = np.linalg.eigh(information / size / size[:, None])
    kept = w > len(w) * np.finfo(float).eps * w.max(initial=0.0)
    return np.sqrt(w[kept, None]) * V.T[kept] * size


def _entry_derivatives(T: Array) -> Array:
    """The derivatives of inertial parameters by the entries of symmetric S in ``Pi = T S T^T``: (..., 4, 4, 10)."""
    unit = np.eye(16).reshape(4, 4, 4, 4)
    moments = T[..., None, None, :, :] @ (unit + unit.mT) @ T[..., None, None, :, :].mT / 2
    return inertia.parameters(inertia.from_moment_matrix(moments))


# The minimum, by an interior-point method.
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
