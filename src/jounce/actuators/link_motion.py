"""Recover the motion of the links from that of their motors.

Encoders on the motors measure the motion theta of motors.

Problem: q(t) of ``q + delta(Q(q, qd, q2d)) = theta(t)``, with the deflections delta of the springs, ``Q / K`` of linear
ones. Links on springs swing by themselves too, at their locked-rotor resonances, the roots of ``det(K - w^2 M) = 0``;
motors that stand still do not show that. Sought is the motion without it, which is one of a lower frequency.

Algorithm: collocation [1]. q is a spline of degree 9 over the breaks of theta or, where these follow what is near the
lowest resonance, over even ones that do not; Newton's method with the partial derivatives of Q solves the equation at
as many points as there are coefficients, with a banded matrix. A component of frequency f of theta is multiplied by
``1 / (1 - f^2 / f_r^2)``, and so are its deviations.

Failure: `JounceError` where Newton's method does not converge, and where between the points the motors move otherwise
than the links found let them: theta then has components near the resonance or above.

[1] C. de Boor, B. Swartz, Collocation at Gaussian points, SIAM Journal on Numerical Analysis 10 (1973).
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jounce.arguments import requests
from jounce.core import cures, scalars
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.dynamics import joint_springs
from jounce.dynamics.quantities import QUANTITIES, find_row
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates
from jounce.model import coordinates
from jounce.model.mechanism import robot_size
from jounce.motion import least_squares
from jounce.motion.curves import Curve
from jounce.motion.motion import Motion
from jounce.motion.sample_curves import SmoothedCurve
from jounce.motion.spline import SplineCurve

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

MEASURED_MOTORS = Remedy("measured='motors'", "--measured motors")
MAX_BAND_TO_RESONANCE = 0.8  # of the links' motion: at its end errors of theta are multiplied by 1 / (1 - 0.8^2) = 2.8
_POSTURES = 500  # along the motion, by which the lowest resonance is judged
_MAX_LINK_STEPS = 30  # of Newton's method, which takes four to six where springs are linear
_LINK_TOLERANCE = 1e-11  # of the positions, rad or m per size: the last step of Newton's method
MAX_MISSED_SHARE = 0.05  # of the largest deflection of a spring, by which motors may move otherwise: so is Q then
_MISSED_DEVIATIONS = 3.0  # standard deviations of theta, below which that is noise
_MASS, _PARTIALS = QUANTITIES["mass_matrix"], QUANTITIES["inverse_dynamics_partials"]


@dataclass(frozen=True, eq=False)
class LinkCurve(SplineCurve):
    """The spline of the links, and what its deviations come from.

    They are the deviations of `theta` and the error `missed` (n,) of the links, which changes with `frequency`, times
    `gains` (T, n, n) at `times` (T,).
    """

    theta: Curve
    times: np.ndarray
    gains: np.ndarray
    frequency: float
    missed: np.ndarray

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Return standard deviations of the values and derivatives.

        As if all components were at the end of the band.
        """
        # An exact theta has deviations 0; if its deviations end at a lower derivative, those of the links do too.
        of_theta = self.theta.deviations(t, order)
        if of_theta is None:
            if self.theta.deviations(t, 0) is not None:
                return None
            of_theta = [np.zeros((len(t), 1))] * (order + 1)
        # theta's and the error's, both times the gains of resonance: variances (N, n) add up over the motors.
        gains = self.gains[np.searchsorted(self.times, t).clip(max=len(self.times) - 1)]
        missed = [self.missed * (2 * np.pi * self.frequency) ** k for k in range(order + 1)]
        rates = [np.hypot(*pair) for pair in zip(of_theta, missed, strict=True)]
        return [np.sqrt(np.matmul(gains**2, rate[..., None] ** 2)[..., 0]) for rate in rates]


def recover_links(robot: Engine, theta: Motion) -> Motion:
    """Recover the motion of the links whose motors move by theta."""
    requests.check_existence(robot.mechanism, "motor_positions", theta.base_curve is not None, str(MEASURED_MOTORS))
    e = joint_springs.elasticity_of(robot.mechanism)
    if len(e.pairs) > 0 or robot.mechanism.floats:
        came = "floats" if robot.mechanism.floats else f"has two at {robot.joint_names[e.pairs[0]]}"
        raise JounceError(f"{MEASURED_MOTORS} needs one motor per joint and a fixed base; {robot.name!r} {came}")
    # The lowest resonance along the motion: the largest eigenvalue of K^-1/2 M K^-1/2 is 1 / w^2. All joints may be
    # rigid, without one.
    t, compliance = np.linspace(theta.start, theta.stop, _POSTURES), scalars.reciprocal(e.stiffness)
    inertia = MotionStates.sample(robot, theta, t, [(_MASS, 0)]).compute(robot, _MASS.name)[0]
    root = np.sqrt(compliance)
    with np.errstate(divide="ignore"):
        resonance = float(1 / np.sqrt(np.linalg.eigvalsh(root[:, None] * inertia * root)[:, -1].max())) / (2 * np.pi)
    # The spline of the links, its band, and the gains (1 - w^2 K^-1 M)^-1 of errors at the end of the band.
    breaks = _choose_breaks(theta, MAX_BAND_TO_RESONANCE * resonance)
    band = 0.5 / np.diff(breaks).min()
    gains = np.linalg.inv(np.eye(robot.n) - (2 * np.pi * band) ** 2 * compliance[:, None] * inertia)
    spline = _collocate(robot, theta, breaks, compliance)
    # Between the points of collocation, motors move otherwise by this much.
    missed = _find_missed(robot, theta, _with_spline(theta, spline), breaks, resonance)
    curve = LinkCurve(spline, theta.start, theta.stop, theta.curve, t, gains, 2 * band, missed)
    note = (
        f"links from motors behind springs, up to {band:.3g} Hz; how they swing by themselves, from {resonance:.3g} Hz"
        " on, motors do not show"
    )
    notes = [*theta.notes, note]
    if theta.torques is not None:
        notes.append("measured torques count as those of the links, Q")
    source = f"motors: {theta.source}"
    return replace(theta, curve=curve, source=source, notes=tuple(notes), samples=None, residual=None, grid=theta.times)


def _choose_breaks(theta: Motion, highest: float) -> np.ndarray:
    """Choose breaks of a spline without components above a frequency.

    They are those of theta, or even ones.
    """
    # A smoothed theta has the band of its breaks; where that is low enough, links have the same.
    if isinstance(theta.curve, SmoothedCurve):
        theta_breaks = np.unique(theta.curve.spline.t)
        if 0.5 / np.diff(theta_breaks).min() <= highest:
            return theta_breaks
    # Two breaks per period of the highest frequency, and no more coefficients than times.
    count = min(2 * theta.duration * highest, len(theta.times) - least_squares.BASIS_WIDTH)
    return np.linspace(theta.start, theta.stop, max(1, int(count)) + 1)


def _with_spline(theta: Motion, spline: "BSpline") -> Motion:
    return replace(theta, curve=SplineCurve(spline, theta.start, theta.stop))


def _collocate(robot: Engine, theta: Motion, breaks: np.ndarray, compliance: np.ndarray) -> "BSpline":
    """Find the spline q whose motor positions are theta at some points.

    The points of collocation are as many as coefficients; each round is a step of Newton's method for all of them.
    """
    from scipy.interpolate import BSpline
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import spsolve

    # Points at the means of ten knots each (Greville's abscissae), where B-splines have their centres; values and two
    # derivatives of the ten B-splines at each point.
    knots, n = least_squares.pad_knots(breaks), robot.n
    greville = np.lib.stride_tricks.sliding_window_view(knots[1:-1], least_squares.FIT_DEGREE).mean(axis=1)
    t = greville.clip(theta.start, theta.stop)
    bases = [least_squares.basis(t, breaks, k) for k in range(3)]
    # Entries (P, n, 10, n) of the matrix: by point, joint, B-spline and its joint.
    columns = (bases[0][1][:, None, None] + np.arange(least_squares.BASIS_WIDTH)[:, None]) * n + np.arange(n)
    rows, shape = np.arange(len(t) * n).reshape(-1, n)[:, :, None, None], (len(t), n, least_squares.BASIS_WIDTH, n)
    indices = [np.broadcast_to(index, shape).ravel() for index in (rows, columns[:, None])]
    # Start with the coefficients of theta's values: links near to their motors.
    c = goal = theta(t, 0)[0]
    sizes = np.where(np.array(coordinates.units(robot.mechanism)) == "m", robot_size(robot.mechanism), 1.0)
    for _ in range(_MAX_LINK_STEPS):
        # Partial derivatives of q + delta(Q) by q, qd, q2d: (3, P, n, n), those of Q over K and 1 for q itself.
        motion = _with_spline(theta, BSpline(knots, c, least_squares.FIT_DEGREE))
        states = MotionStates.sample(robot, motion, t, [(_PARTIALS, 0)])
        factors = compliance[:, None] * np.moveaxis(states.compute(robot, _PARTIALS.name)[0], 1, 0)
        factors[0] += np.eye(n)
        # By the coefficients: each partial derivative times the derivatives of the B-splines, in a banded matrix.
        entries = sum(A[:, :, None] * B[:, None, :, None] for A, (B, _) in zip(factors, bases, strict=True))
        matrix = csc_matrix((entries.ravel(), indices), shape=(rows.size, rows.size))
        step = spsolve(matrix, (goal - _motor_positions(robot, motion, t)).ravel()).reshape(-1, n)
        c = c + step
        if not (np.abs(step) > _LINK_TOLERANCE * np.maximum(sizes, np.abs(c).max(axis=0))).any():
            return BSpline(knots, c, least_squares.FIT_DEGREE)
    raise JounceError(
        f"{MEASURED_MOTORS}: no motion of the links was found by Newton's method; expected motors that move slower than"
        f" the links swing on their springs; a lower {cures.option_name('bandwidth')} smooths them more"
    )


def _motor_positions(robot: Engine, motion: Motion, t: np.ndarray) -> np.ndarray:
    row = find_row("motor_positions", requests.count_more_rates(robot.mechanism, "motor_positions"))
    return np.asarray(MotionStates.sample(robot, motion, t, [(row, 0)]).compute(robot, row.name)[0])


def _find_missed(robot: Engine, theta: Motion, motion: Motion, breaks: np.ndarray, resonance: float) -> np.ndarray:
    """Return by how much (n,) motors move otherwise, beyond noise.

    Raise `JounceError` where that is more than Q can bear.
    """
    # Amid the breaks, where points of collocation are far.
    t = (breaks[1:] + breaks[:-1]) / 2
    motors, links = theta(t, 0)[0], motion(t, 0)[0]
    missed = np.abs(motors - _motor_positions(robot, motion, t))
    deviations = theta.deviations(t, 0)
    if deviations is not None:
        missed *= missed > _MISSED_DEVIATIONS * deviations[0]
    if missed.max() > MAX_MISSED_SHARE * np.abs(motors - links).max():
        i, j = np.unravel_index(missed.argmax(), missed.shape)
        raise JounceError(
            f"{MEASURED_MOTORS}: the motor of joint {quote_value(robot.joint_names[j])} moves too fast for the links to"
            f" follow, by {missed[i, j]:.2g} at t = {t[i]:.6g} s: links swing on their springs from {resonance:.3g} Hz"
            f" on; expected slower motors, stiffer springs, or a lower {cures.option_name('bandwidth')}"
        )
    return np.asarray(missed.max(axis=0))
