"""Fit inertial parameters of bodies that can exist to data.

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
    """Parameters of bodies that can exist and of drive terms."""

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
    # Bodies with mass: S_b = 1 stands for the robot's own Pi0_b = T_b T_b^T, with an inside where they have none.
    Pi = inertia.moment_matrix(mechanism.M)
    massive = _massive_bodies(mechanism, Pi)
    start = _raise_moments(Pi[massive], robot_size(mechanism))
    thickened = massive[(start != Pi[massive]).any(axis=(1, 2))]
    T = np.asarray(np.linalg.cholesky(start))
    # The data: (z - z*)^T A (z - z*) = |R z - R z*|^2.
    d, R = _drive_values(mechanism, terms), _information_root(information)
    # Drive parameters over s: those that the data do not determine stay as they are, and a unit of each other one
    # makes forces as large as all.
    determined = np.diag(information)[base.count :] > 0
    force_sizes = np.linalg.norm(R, axis=0)[base.count :]
    all_forces = max(1.0, np.linalg.norm(R @ estimate), np.linalg.norm(R @ np.append(base.values, d)))
    scale = all_forces / force_sizes[determined]
    # R z by inertial parameters of each body, (k, bodies, 10), then by entries of S_b: (k, bodies, 4, 4).
    all_bodies = (R[:, : base.count] @ base.matrix).reshape(len(R), len(Pi), len(inertia.INERTIAL_PARAMETERS))
    unsigned = [drive_trains.AMOUNTS[term] not in drive_trains.SIGNED_PARAMETERS for term in terms]
    problem = SemidefiniteProblem(
        C=np.asarray(np.einsum("kbp,bijp->kbij", all_bodies[:, massive], _entry_derivatives(T))),
        R=R[:, base.count :][:, determined] * scale,
        y=R @ estimate,
        own=d[determined] / scale,
        positive=np.repeat(unsigned, len(mechanism.joints)).astype(bool)[determined],
        weight=weight,
    )
    V, d[determined] = minimise(problem)
    # Back to bodies, Pi_b = T_b V_b V_b^T T_b^T, and to drive parameters in their units.
    d[determined] *= scale
    root = T @ V
    Pi[massive] = root @ root.mT
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
    """Fit one body that can exist to an estimate and a prior.

    The prior are moments of mass (4, 4); returns inertial parameters (10,).
    """
    # The same problem of one body, without drive parameters.
    T, R = np.linalg.cholesky(prior), _information_root(information)
    C = np.einsum("kp,ijp->kij", R, _entry_derivatives(T))[:, None]
    no_drives = np.zeros(0)
    problem = SemidefiniteProblem(C, np.zeros((len(R), 0)), R @ estimate, no_drives, no_drives.astype(bool), weight)
    root = T @ minimise(problem)[0][0]
    return np.asarray(inertia.parameters(inertia.from_moment_matrix(root @ root.T)))


def _massive_bodies(mechanism: Mechanism, Pi: Floats) -> np.ndarray:
    """Return the places of bodies with mass: `JounceError` for moments without."""
    start = "physically consistent parameters start from the robot's own: state"
    for name, moments in zip(mechanism.bodies, Pi, strict=True):
        mass = moments[3, 3]
        if mass < 0 or (mass == 0 and moments.any()):
            came = f"body {errors.shorten(name)!r} has mass {mass:g} kg and moments"
            raise JounceError(f"{came}; {start} a mass, or no inertia")
    massive = np.flatnonzero(Pi[:, 3, 3])
    if massive.size == 0:
        raise JounceError(f"{mechanism.name}: no body has mass; {start} a rough mass and inertia for each body")
    return massive


def _raise_moments(Pi: Floats, length: float) -> Floats:
    """Raise second moments about the COM where they are not positive definite."""
    # Second moments P - m c c^T about the COM c, along their principal axes.
    m = Pi[:, 3:, 3:]
    c = Pi[:, :3, 3:] / m
    size, axes = np.linalg.eigh(Pi[:, :3, :3] - m * c @ c.mT)
    # Held against the largest of the body, or against a body as long as the robot if it is a point.
    robot_moment = m[:, 0] * length**2
    largest = np.where(size[:, 2:] > POINT_MASS_TOLERANCE * robot_moment, size[:, 2:], robot_moment)
    raised = Pi.copy()
    raised[:, :3, :3] = axes * np.maximum(size, RAISED_RELATIVE_MOMENT * largest)[:, None] @ axes.mT + m * c @ c.mT
    return np.where((size[:, :1] < MIN_RELATIVE_MOMENT * largest)[..., None], raised, Pi)


def _drive_values(mechanism: Mechanism, terms: Sequence[DriveTerm]) -> Floats:
    """Return the robot's own parameters of drive terms."""
    return np.concatenate([np.zeros(0), *(getattr(mechanism.drives, drive_trains.AMOUNTS[term]) for term in terms)])


def _information_root(information: Floats) -> Floats:
    """Return R of ``A = R^T R``, without directions of rounding alone: (rank, k)."""
    # Eigenvalues of A with ones on its diagonal, so that units of parameters do not decide what is rounding.
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0, size, 1.0)
    w, V = np.linalg.eigh(information / size / size[:, None])
    informed = w > len(w) * np.finfo(float).eps * w.max(initial=0.0)
    return np.sqrt(w[informed, None]) * V.T[informed] * size


def _entry_derivatives(T: Array) -> Array:
    """Return derivatives of inertial parameters by entries of S: (..., 4, 4, 10).

    Pi = T S T^T with a symmetric S: an entry and its mirror image have half each.
    """
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
    """Find the minimum of f: return a root V of S = V V^T, and d.

    Each round is a step of Newton's method for the equations with one mu. Raise `JounceError` after too many.
    """
    # The start: S = 1, and a multiple of 1 for X that is as large as the slope of the residual.
    one = np.tile(np.eye(4), (problem.C.shape[1], 1, 1))
    V, t, last = one, 1.0, np.inf
    slope = np.einsum("k,kbij->bij", problem.R @ problem.own - _residual_target(problem, V), problem.C)
    W = np.sqrt(max(problem.weight, np.abs(slope).max())) * one  # X = W W^T
    for _ in range(MAX_INTERIOR_POINT_STEPS):
        # Scaling: S = G D G^T and D = G^T X G with a diagonal D = diag(s), by the singular values s of W^T V. `sizes`
        # (bodies, 4, 4) are sqrt(s_i s_j), over which changes of D are relative.
        _, s, turn = np.linalg.svd(W.mT @ V)
        G, D, sizes = V @ turn.mT / np.sqrt(s)[:, None], s[:, None] * one, np.sqrt(s[:, :, None] * s[:, None])
        # mu: the more the last step was cut short, the closer to the mean of S X, whose eigenvalues are s^2.
        mu = max(problem.weight, max(MIN_MU_RATIO, 1 - t) * float(np.mean(s * s)))
        Z, d = _newton_step(problem, G, s, mu)
        # S X = mu 1 holds to first order with the step Z_of_X of X for which Z + Z_of_X = mu D^-1 - D.
        Z_of_X = mu * np.linalg.inv(D) - D - Z
        # The largest share t of the steps of S and X after which both are definite: an eigenvalue -1 of a relative
        # change makes one of them singular.
        nearest = min(np.linalg.eigvalsh(change / sizes).min() for change in (Z, Z_of_X))
        t = 1.0 if nearest > -MAX_SHARE_TO_BOUNDARY else -MAX_SHARE_TO_BOUNDARY / nearest
        V, W = G @ np.linalg.cholesky(D + t * Z), np.linalg.solve(G.mT, np.linalg.cholesky(D + t * Z_of_X))
        # Convergence: only of full steps at the final mu, that are small, or that no longer fall and whose decrease of
        # f is rounding.
        change, r = float(np.abs(Z / sizes).max()), problem.R @ d - _residual_target(problem, V)
        rounding = last / 2 < change and mu * change**2 < DECREMENT_TOLERANCE * (mu + r @ r / 2)
        if mu == problem.weight and t == 1 and (change < INTERIOR_POINT_STEP_TOLERANCE or rounding):
            return V, d
        last = change
    steps = f"within {MAX_INTERIOR_POINT_STEPS} steps"
    raise JounceError(f"no physically consistent parameters {steps}; expected a smaller prior")


def _newton_step(problem: SemidefiniteProblem, G: Floats, s: Floats, mu: float) -> tuple[Floats, Floats]:
    """Return the step Z of D, and d after the step: (bodies, 4, 4), (drives,).

    It is the least-squares problem of the module's head: once per round.
    """
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    # Rows C G Z G^T by the entries z (10 bodies,) of Z: (k, bodies, 4, 4) -> (k, 10 bodies). Completing the square,
    # |Z|^2 / 2 - tr(target Z) asks z for the target, mu D^-1 - weight G^T G.
    J = _to_vectors(G.mT @ problem.C @ G).reshape(len(problem.y), len(_ENTRY_FACTORS) * len(G))
    target = _to_vectors(mu / s[:, None] * np.eye(4) - problem.weight * G.mT @ G).ravel()
    # One problem |A (z, d) - b| of least squares: rows of the data, those of z, and those of d at its own values. A QR
    # factorisation eliminates z and the unbounded d: bounded variables stand last, and are left to the last rows.
    order = np.argsort(problem.positive, kind="stable")
    w, n, size = np.sqrt(problem.weight), J.shape[1], J.shape[1] + len(order)
    A = np.block([[J, problem.R[:, order]], [np.diag(np.repeat([1.0, w], [n, len(order)]))]])
    b = np.concatenate([_residual_target(problem, G * np.sqrt(s)[:, None]), target, w * problem.own[order]])
    T = np.asarray(np.linalg.qr(np.column_stack([A, b]), mode="r"))
    k = size - np.count_nonzero(problem.positive)
    bounded = np.zeros(0)
    if k < size:
        bounded = nnls(T[k:size, k:size], T[k:size, -1])[0]
    # The others follow from the bounded ones, whatever these are.
    x = np.append(solve_triangular(T[:k, :k], T[:k, -1] - T[:k, k:size] @ bounded), bounded)
    z, d = x[:n], x[n:][np.argsort(order)]
    # Vectors back to symmetric matrices, (10 bodies,) -> (bodies, 4, 4).
    Z = np.zeros((len(G), 4, 4))
    Z[:, _UPPER_ROWS, _UPPER_COLUMNS] = Z[:, _UPPER_COLUMNS, _UPPER_ROWS] = z.reshape(-1, 10) / _ENTRY_FACTORS
    return Z, d


def _residual_target(problem: SemidefiniteProblem, V: Floats) -> Floats:
    """Return y - C S, which R d approaches: (k,), of S = V V^T."""
    return np.asarray(problem.y - np.einsum("kbij,bij->k", problem.C, V @ V.mT))


def _to_vectors(S: Floats) -> Floats:
    """Return symmetric matrices as vectors of the same norm: (..., 4, 4) -> (..., 10)."""
    return np.asarray(S[..., _UPPER_ROWS, _UPPER_COLUMNS] * _ENTRY_FACTORS)
