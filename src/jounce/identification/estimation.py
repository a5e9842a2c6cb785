"""Identification of the inertial parameters and drive terms of a robot from a motion and measured forces."""

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from jounce.core.errors import JounceError, listed, one_of, quoted, warn
from jounce.core.scalars import asarray, is_finite
from jounce.core.typing import ArrayLike, DriveColumn, DriveColumns, Equations
from jounce.engine.along import checked_motion
from jounce.engine.engine import R, like
from jounce.identification.measurements import measurements
from jounce.identification.physical import ConsistentParameters, consistent_parameters
from jounce.identification.problem import model_of, problem
from jounce.identification.regression import regression, solve
from jounce.identification.residuals import residuals
from jounce.identification.result import Identification
from jounce.identification.suspicions import suspicions, unexplained
from jounce.identification.table import IdentifiedParameter, parameter_table
from jounce.model.drives import AMOUNTS, OFFSET, TERMS, select_columns
from jounce.model.inertial import with_parameters
from jounce.motion.motion import Motion

DRIVES: tuple[DriveColumn, ...] = ("damping", "friction", "offset")
PRIOR = 0.3  # relative: about as good as models of CAD are
FIRMEST = 1e-9  # prior: no model is better, and squares of smaller ones overflow


def identify(
    robot: R,
    motion: Motion,
    forces: ArrayLike | None = None,
    *,
    t: ArrayLike | None = None,
    drives: DriveColumns = DRIVES,
    eps: float | None = None,
    span: tuple[float, float] | None = None,
    band: float | None = None,
    weights: ArrayLike | None = None,
    deviations: ArrayLike | None = None,
    prior: float = PRIOR,
    method: Equations = "inverse_dynamics",
) -> Identification[R]:
    """Identify the inertial parameters and drive terms of a robot from a motion and the forces measured along it.

    Q = Y p is linear in the inertial parameters p and in those of drive terms. Weighted least squares find the base
    parameters, the combinations that the forces depend on, with standard deviations; each force has the variance of its
    residuals. Regressor and forces are averaged over cells of half a period of the motion's highest frequency, and
    the variances are those of the residuals at the frequencies of the motion, so that serially correlated noise
    does not make the deviations too small. The identified robot has bodies that can exist: the nearest to the data, and
    to the model's own values where the data say little.

    Parameters
    ----------
    robot : Robot
        With a first guess of its inertial parameters, such as those of its CAD model.
    motion : Motion
        As for `Robot.forces_along`, with q, qd, q2d; of a log, `jounce.load_motion` smooths it. Wrenches that it holds
        act, and if its positions have standard deviations, what follows from these weighs the forces.
    forces : (N, nv), optional
        Measured forces at `t`, N m or N, NaN for those not measured; by default the torques of the motion's log.
    t : (N,), optional
        Times of the forces, s; by default ``motion.times``.
    drives : bool, str or iterable of str, optional
        Drive terms to identify: "armature", "damping", "friction", "spring", "offset". Others that act in the robot
        keep their values.
    eps : float, optional
        Smoothing velocity of Coulomb friction, rad/s or m/s; by default that of each joint.
    span : (float, float), optional
        Times in s between which the data are used; the others test the result. By default all are used.
    band : float, optional
        Highest frequency of the forces in Hz; by default the one below which 99 % of the power of the model's is.
    weights : (nv,) or (N, nv), optional
        Factors of the inverse variances, 0 or more; 0 leaves forces out.
    deviations : float, (nv,) or (N, nv), optional
        Standard deviations of independent errors of the forces, N m or N; by default residuals tell them.
    prior : float, optional
        Relative standard deviation of the model's own inertial parameters: how near to them the bodies stay.
    method : {"inverse_dynamics", "momentum", "power"}, optional
        The equations. Those of momentum and power need no q2d: the balance of the generalized momentum, one row per
        force, and that of the energy, one row for all forces, which must all be measured. Both sides are filtered.

    Returns
    -------
    Identification

    Raises
    ------
    JounceError
        If there are no forces, a shape is wrong, a force is infinite, times do not increase or are outside of the
        motion, a weight is negative, or there are fewer measurements than parameters.

    Warns
    -----
    JounceWarning
        If the data do not see some of the parameters, or forces seem to have the wrong sign or unit.

    References
    ----------
    M. Gautier, W. Khalil, "On the Identification of the Inertial Parameters of Robots", IEEE Conference on Decision and
    Control, 1988. C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca, "Dynamic Identification of the Franka
    Emika Panda Robot With Retrieval of Feasible Parameters Using Penalty-Based Optimization", IEEE Robotics and
    Automation Letters 4(4), 2019.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("iiwa14")
    >>> motion = jounce.load_motion("paper", robot)
    >>> p = robot.inertial_parameters
    >>> Q = robot.with_inertial_parameters(1.2 * p).forces_along(motion, order=0).forces[0]
    >>> found = jounce.identify(robot, motion, Q)
    >>> found.rank, len(found.names)
    (64, 64)
    """
    one_of("method", method, get_args(Equations))
    terms = select_columns(drives)
    model = model_of(robot, terms, eps)
    if not is_finite(prior) or not prior >= FIRMEST:
        raise JounceError(f"prior is {quoted(prior)}; expected a relative standard deviation, {FIRMEST:g} or more")
    path = checked_motion(model.mechanism, motion)
    given = measurements(model.mechanism, path, forces, t, weights, deviations)
    posed = problem(model, path, terms, given, _inside(span, given.t), band, method)
    weighed = regression(posed.cells, posed.columns, known=deviations is not None)
    information = weighed.information[np.ix_(posed.columns, posed.columns)]
    solution = solve(information, weighed.right[posed.columns])
    table = parameter_table(posed, solution, weighed.variances)
    notes = [*suspicions(posed, method), *_unseen(table, solution.rank)]
    for text in notes:
        warn(text)
    found = consistent_parameters(
        model.mechanism, posed.base, information, posed.own + solution.x, terms, weight=float(prior) ** -2
    )
    predicted = posed.predicted(found.parameters, found.values[posed.base.count :])
    rows, times = residuals(posed, predicted), given.t[posed.used]
    notes += (left := unexplained(rows))
    for text in left:
        warn(text)
    return Identification(
        robot=_identified(model, terms, found),
        offsets=found.drives.get(OFFSET, np.zeros(model.mechanism.nb)),
        table=table,
        covariance=solution.covariance,
        rank=solution.rank,
        condition=solution.condition,
        deviations=weighed.deviations,
        residuals=rows,
        span=(float(times[0]), float(times[-1])),
        band=posed.band,
        cell=posed.width,
        samples=len(times),
        cells=len(posed.cells.off),
        t=given.t,
        measured=np.where(given.weights > 0, given.forces, np.nan),
        model=posed.model,
        predicted=predicted,
        notes=(*notes, *_bodies(found)),
    )


def _inside(span: tuple[float, float] | None, t: np.ndarray) -> np.ndarray:
    """Which of the times are used."""
    if span is None:
        return np.ones(len(t), dtype=bool)
    times = np.asarray(asarray(span, "span"))
    if times.shape != (2,) or times.dtype.kind != "f":
        raise JounceError(f"span is {quoted(span)}; expected two times in s")
    first, last = times
    inside = (t >= first) & (t <= last)
    if not inside.any():
        raise JounceError(f"span is {quoted(span)}; expected times from {t[0]:.6g} to {t[-1]:.6g} s, which forces have")
    return inside


def _identified(robot: R, terms: Sequence[DriveColumn], found: ConsistentParameters) -> R:
    """The robot with what was found; its drive terms act."""
    m = with_parameters(robot.mechanism, found.parameters)
    values = {AMOUNTS[term]: x for term, x in found.drives.items() if term != OFFSET}
    acting = tuple(term for term in TERMS if term in {*m.acting, *terms})
    return like(robot, replace(m, drives=replace(m.drives, **values), acting=acting))


def _unseen(table: Sequence[IdentifiedParameter], rank: int) -> list[str]:
    """What to know of parameters that the data do not see."""
    unseen = [row.name for row in table if not row.seen]
    if not unseen:
        return []
    return [
        f"the data do not see {listed(unseen)}: deviations exceed sizes (rank {rank} of {len(table)}); a faster or"
        " longer motion of more joints sees them"
    ]


def _bodies(found: ConsistentParameters) -> list[str]:
    """What to know of the bodies."""
    said = {"have no mass, and keep none": found.massless, "were thin, and got an inside": found.thickened}
    return [f"bodies that {what}: {listed(which)}" for what, which in said.items() if which]
