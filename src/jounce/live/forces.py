"""Compute live forces from estimated rates, with deviations, links, broken limits.

Deviations of Q, Qd, Q2d follow from those of the rates, by partial derivatives. Links on elastic joints are one step of
``q = theta - Q(q, qd, q2d) / K`` from the rates of their motors. A limit counts as broken where a rate or a force is
beyond it by more than two deviations; the bounds of a robot are arranged once (`judged_limits`), and compared with
every sample (`find_broken`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jounce.core import cures, scalars
from jounce.core.errors import JounceError
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.limits.ratios import SIGNS, build_scale
from jounce.model.limits import LIMIT_KINDS, Limits

SIGNAL_TIME = 1.0  # s, over which the mean square of Q2d is taken


class LiveForces(NamedTuple):
    """Forces and their rates: (n,), N m or N, per s, per s^2.

    `LiveRates.forces` returns them. `deviations` are the standard deviations of the three. `certain` says whose Q2d has
    a smaller deviation than its size, and than its rms over the last second without noise.

    Examples
    --------
    >>> import jounce
    >>> live = jounce.load("planar2r").live(1e-3, lag=0, bandwidth=10, noise=1e-5)
    >>> for _ in range(1000):
    ...     _ = live.update([0.1, 0.2])
    >>> found = live.forces()
    >>> found.Q.round(1), found.certain
    (array([28.9,  9.4]), array([False, False]))
    """

    Q: np.ndarray
    Qd: np.ndarray
    Q2d: np.ndarray
    deviations: tuple[np.ndarray, np.ndarray, np.ndarray]
    certain: np.ndarray


class LiveLinks(NamedTuple):
    """Rates of the links: q, qd, q2d (n,), rad or m, per s, per s^2.

    `LiveRates.links` returns them, with what they are worth, (3, n): `deviations` are standard deviations, by those of
    theta; `error` estimates the second order in 1/K, which is left out, to a few times, as it takes further rates for
    those of a motion of one frequency, the bandwidth at most.

    Examples
    --------
    >>> import jounce
    >>> jounce.load("planar2r").elastic(900, rotor=0.1).live(1e-3).links().error.shape
    (3, 2)
    """

    q: np.ndarray
    qd: np.ndarray
    q2d: np.ndarray
    deviations: np.ndarray
    error: np.ndarray


def linearize_forces(robot: Engine, rates: tuple[np.ndarray, ...]) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return Q, Qd, Q2d and their partial derivatives: (3, n), at rates q to q4d (n,).

    Forces are NaN before the rates are known.
    """
    # Partial derivatives are computed in any case, so that native code is compiled before the first sample.
    is_known = bool(np.isfinite(rates[0]).all())
    states = rates if is_known else (np.zeros(robot.n),) * len(rates)
    forces = np.array(compute(robot, "inverse_dynamics", states))
    if not is_known:
        forces = np.full_like(forces, np.nan)
    return forces, compute(robot, "inverse_dynamics_partials", states)


def linear_variances(partials: Sequence[np.ndarray], covariance: np.ndarray) -> np.ndarray:
    """Return variances (k, n) of functions of the rates, by partial derivatives.

    To first order: ``dQ = sum_j P[j] dq^(j)`` with P[j] (n, n), and the errors of different joints are independent.
    """
    # All functions by the rates of each joint, (joint, function, n, rate); rows times the joint's covariance add up.
    n, count = covariance.shape[:2]
    by_joint = np.zeros((n, len(partials), n, count))
    for k, P in enumerate(partials):
        by_joint[:, k, :, : len(P)] = P.transpose(2, 1, 0)
    rows = by_joint.reshape(n, -1, count)
    return np.asarray(((rows @ covariance) * rows).sum(axis=(0, 2)).reshape(len(partials), -1))


def estimate_links(robot: Engine, rates: tuple[np.ndarray, ...], covariance: np.ndarray, omega: float) -> LiveLinks:
    """Estimate the links from rates theta to theta4d (n,) of their motors.

    With covariances (n, 5, 5) of these rates, and the bandwidth omega, rad/s.
    """
    e = robot.mechanism.elasticity
    if e is None or any(e.springs) or e.level is not None:
        expected = f"elastic joints with linear springs, no dampers and {cures.SPONG_COUPLING}"
        raise JounceError(f"links() of {robot.name!r}; expected {expected}: robot.elastic(stiffness, rotor)")
    # Deflections delta = theta - q = Q / K and their rates (3, n), and their partial derivatives by theta, ...
    compliance = scalars.reciprocal(e.stiffness)
    forces, partials = linearize_forces(robot, rates)
    delta, D = compliance * forces, [compliance[:, None] * P for P in partials]
    # The second order of the kth rate of q is the sum of D[k][j] times that of delta: sizes, as terms may cancel.
    first, second, third, fourth = np.abs(rates[1:])
    # Of A sin(w t) these are A^2 w^4 and A^2 w^6.
    slow, fast = (second**2 + first * third).sum(), (third**2 + second * fourth).sum()
    if slow != 0:
        omega = min(omega, np.sqrt(fast / slow))
    fastest = np.hypot(delta[2], omega * delta[1])
    size = np.array([*np.abs(delta), omega * fastest, omega**2 * fastest])
    error = np.array([np.einsum("aij,aj->i", np.abs(P), size[: len(P)]) for P in D])
    # Links q = theta - delta, whose partial derivatives are 1 - D.
    shares = [np.eye(robot.n) * (np.arange(len(P)) == k)[:, None, None] - P for k, P in enumerate(D)]
    q, qd, q2d = rates[:3] - delta
    return LiveLinks(q, qd, q2d, np.sqrt(linear_variances(shares, covariance)), error)


CERTAIN_DEVIATIONS = 2.0  # beyond a bound
JUDGED_KINDS = (*LIMIT_KINDS.motion, *LIMIT_KINDS.effort)  # in the order of the deviations of rates and forces
_SIGN_COLUMN = np.array(SIGNS)[:, None]


class BrokenLimit(NamedTuple):
    """A limit that a joint breaks: the value, its standard deviation, and the bound."""

    limit: str
    joint: str
    value: float
    deviation: float
    bound: float


class JudgedLimits(NamedTuple):
    """The limits of a robot that are judged live, arranged once.

    `bounds` (kinds, 2, n) are upper and negative lower ones, `rows` the places of the kinds in `JUDGED_KINDS`,
    `tolerant` the bounds with room for rounding. `less_gravity` (3, 1) is 1 where bounds of Q, Qd, Q2d are of the force
    without gravity, else 0.
    """

    limits: Limits
    kinds: tuple[str, ...]
    rows: list[int]
    bounds: np.ndarray
    tolerant: np.ndarray
    less_gravity: np.ndarray


def judged_limits(robot: Engine) -> JudgedLimits:
    """Arrange the limits of motion, effort and its rates."""
    from jounce.limits.joints import joint_limits  # imported here: forces alone take no limits

    limits = joint_limits(robot.mechanism)
    kinds = tuple(kind for kind in JUDGED_KINDS if kind in limits.kinds)
    scales = [build_scale(limits.bounds(kind), kind) for kind in kinds]
    shape = len(kinds), len(SIGNS), robot.n
    bounds = np.array([[scale.bound(sign) for sign in SIGNS] for scale in scales]).reshape(shape)
    tolerant = np.array([[scale.tolerant(sign) for sign in SIGNS] for scale in scales]).reshape(shape)
    rows = [JUDGED_KINDS.index(kind) for kind in kinds]
    less_gravity = np.array([[float(kind in limits.without_gravity)] for kind in LIMIT_KINDS.effort])
    return JudgedLimits(limits, kinds, rows, bounds, tolerant, less_gravity)


def find_broken(
    robot: Engine, judged: JudgedLimits, rates: Sequence[np.ndarray], rate_deviations: np.ndarray, forces: LiveForces
) -> list[BrokenLimit]:
    """Find the limits that values break by more than two deviations.

    `rate_deviations` (5, n) are those of the rates; NaN breaks no limit.
    """
    if len(judged.kinds) == 0:
        return []
    # Values and deviations (8, n) of q to q4d and Q, Qd, Q2d, of which the judged kinds are some: (kinds, 1, n).
    values = np.array([*rates, *forces[:3]])
    if judged.less_gravity.any():
        values[-len(LIMIT_KINDS.effort) :] -= judged.less_gravity * compute(robot, "gravity_forces", rates[:3])
    deviations = np.array([*rate_deviations, *forces.deviations])
    x, x_deviations = values[judged.rows, None], deviations[judged.rows, None]
    # (kinds, 2, n), by either side.
    is_broken = _SIGN_COLUMN * x - CERTAIN_DEVIATIONS * x_deviations > judged.tolerant
    if not is_broken.any():
        return []
    return [
        BrokenLimit(
            judged.kinds[k],
            robot.joint_names[j],
            float(x[k, 0, j]),
            float(x_deviations[k, 0, j]),
            float(SIGNS[side] * judged.bounds[k, side, j]),
        )
        for k, side, j in np.argwhere(is_broken)
    ]
