"""Identification of the inertial parameters and drive terms of a robot from a motion and measured forces."""

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from jounce._scalars import is_finite
from jounce._typing import ArrayLike, DriveColumn, DriveColumns, Equations
from jounce.errors import JounceError, listed, one_of, quoted, warn
from jounce.identification.cells import CELLS, band_of, cells_of, regressors
from jounce.identification.filtered import FILTERED
from jounce.identification.measurements import Measurements, measurements
from jounce.identification.physical import ConsistentParameters, consistent_parameters
from jounce.identification.regression import regression, solve
from jounce.identification.residuals import residuals
from jounce.identification.result import Identification
from jounce.identification.suspicions import suspicions
from jounce.identification.table import IdentifiedParameter, drive_sizes, inertial_sizes, parameter_table
from jounce.model.coordinates import force_names, force_units
from jounce.model.drives import AMOUNTS, OFFSET, TERMS, select_columns, with_eps
from jounce.model.inertial import with_parameters
from jounce.model.mechanism import Mechanism
from jounce.motion.motion import Motion
from jounce.robot.along import checked_motion
from jounce.robot.robot import Robot

DRIVES: tuple[DriveColumn, ...] = ("damping", "friction", "offset")
PRIOR = 0.3  # relative: as good as models of CAD are
ROWS = 4  # cells of all forces per parameter, at least


def identify(
    robot: Robot,
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
) -> Identification:
    """Identify the inertial parameters and drive terms of a robot from a motion and the forces measured along it.

    Q = Y p is linear in the inertial parameters p and in those of drive terms. Weighted least squares find the base
    parameters, the combinations that the forces depend on, with standard deviations; each force has the variance of its
    residuals. Regressor and forces are averaged over cells of a quarter of a period of the motion's highest frequency,
    and the variances are those of the residuals at the frequencies of the motion, so that serially correlated noise
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
        If there are no forces, a shape is wrong, times do not increase, a weight is negative, or there are fewer
        measurements than parameters.

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
    start = _start(robot, terms, eps)
    m, base, names = start.mechanism, start.base_parameters(), force_names(start.mechanism)
    path = checked_motion(m, motion)
    given = measurements(m, path, forces, t, weights, deviations)
    weight = _positive(prior, "prior", "a relative standard deviation") ** -2
    inside = _inside(span, given.t)
    used = given.part(inside)
    chosen = np.append(base.columns, len(base.parameters) + np.arange(len(terms) * m.nb))
    _check_enough(used, len(chosen))
    band = band_of(start, path, used) if band is None else _positive(band, "band", "a frequency in Hz")
    width = _width(used, band, len(chosen))
    along = start.forces_along(path, given.t, order=0)
    model, spread = along.forces[0], None if along.deviations is None else along.deviations[0][inside]
    if method in FILTERED:
        cells = FILTERED[method](start, path, used, terms, width, band)
    else:
        cells = cells_of(start, path, used, model[inside], spread, terms, width)
    weighed = regression(cells, chosen, known=deviations is not None)
    information = weighed.information[np.ix_(chosen, chosen)]
    solution = solve(information, weighed.right[chosen])
    own = np.append(base.values, _acting(m, terms))
    sizes = np.append(inertial_sizes(m, base), drive_sizes(cells, weighed.variances, chosen[base.count :]))
    table = parameter_table(m, base, terms, own, solution, sizes)
    suspicious = [*suspicions(cells, names), *_unseen(table, solution.rank)]
    for text in suspicious:
        warn(text)
    found = consistent_parameters(m, base, information, own + solution.x, terms, weight=weight)
    identified, offsets = _identified(start, terms, found)
    change = np.append(found.parameters - start.inertial_parameters, found.values[base.count :] - own[base.count :])
    predicted = model + np.concatenate([Y @ change for _, Y in regressors(start, path, given.t, terms)])
    rows = [
        row
        for part, which in (("used", inside), ("rest", ~inside))
        for row in residuals(part, given.part(which), model[which], predicted[which], width, names, force_units(m))
    ]
    return Identification(
        robot=identified,
        offsets=offsets,
        table=table,
        covariance=solution.covariance,
        rank=solution.rank,
        condition=solution.condition,
        deviations=weighed.deviations,
        residuals=tuple(rows),
        span=(float(used.t[0]), float(used.t[-1])),
        band=band,
        cell=width,
        samples=len(used.t),
        cells=len(cells.off),
        t=given.t,
        measured=np.where(given.weights > 0, given.forces, np.nan),
        model=model,
        predicted=predicted,
        notes=(*suspicious, *_bodies(found)),
    )


def _start(robot: Robot, terms: Sequence[DriveColumn], eps: float | None) -> Robot:
    """The robot as its regressor sees it."""
    if not isinstance(robot, Robot):
        raise JounceError(f"identify() expects a jounce.Robot, got {type(robot).__name__}; jounce.load makes one")
    if robot.mechanism.elasticity is not None and set(terms) - {"spring", OFFSET}:
        raise JounceError(
            f"{robot.name} has elastic joints: its drives act on motors, not on links; drives=False identifies links"
            " from the torques of the springs"
        )
    if eps is None:
        return robot
    if "friction" not in terms:
        raise JounceError(f"eps={quoted(eps)} is of friction, which drives={quoted(list(terms))} does not identify")
    return Robot(replace(robot.mechanism, drives=with_eps(robot.drives, eps)))


def _inside(span: tuple[float, float] | None, t: np.ndarray) -> np.ndarray:
    """Which of the times are used."""
    if span is None:
        return np.ones(len(t), dtype=bool)
    try:
        first, last = map(float, span)
    except (TypeError, ValueError):
        raise JounceError(f"span is {quoted(span)}; expected two times in s") from None
    inside = (t >= first) & (t <= last)
    if not inside.any():
        raise JounceError(f"span is {quoted(span)}; expected times from {t[0]:.6g} to {t[-1]:.6g} s, which forces have")
    return inside


def _positive(given: float, label: str, meaning: str) -> float:
    if not is_finite(given) or not given > 0:
        raise JounceError(f"{label} is {quoted(given)}; expected {meaning} above 0")
    return float(given)


def _check_enough(used: Measurements, parameters: int) -> None:
    count = np.count_nonzero(used.weights)
    if count < parameters:
        raise JounceError(
            f"{len(used.t)} samples hold {count} measured forces for {parameters} parameters; expected a longer motion,"
            " or fewer drives="
        )


def _width(used: Measurements, band: float, parameters: int) -> float:
    """The width of cells that a band needs, and as many cells as the parameters do."""
    duration = float(used.t[-1] - used.t[0])
    forces = np.count_nonzero(used.weights.any(axis=0))
    return min(1 / (CELLS * band) if band else np.inf, duration * forces / (ROWS * parameters)) or 1.0


def _acting(m: Mechanism, terms: Sequence[DriveColumn]) -> np.ndarray:
    """The drive parameters with which the model's own forces are computed."""
    own = [getattr(m.drives, AMOUNTS[term]) if term in m.acting else np.zeros(m.nb) for term in terms]
    return np.concatenate([np.zeros(0), *own])


def _identified(start: Robot, terms: Sequence[DriveColumn], found: ConsistentParameters) -> tuple[Robot, np.ndarray]:
    """The robot with what was found, whose drive terms act, and the offsets, which robots do not state."""
    m = with_parameters(start.mechanism, found.parameters)
    values = {AMOUNTS[term]: x for term, x in found.drives.items() if term != OFFSET}
    acting = tuple(term for term in TERMS if term in {*m.acting, *terms})
    offsets = found.drives.get(OFFSET, np.zeros(m.nb))
    return Robot(replace(m, drives=replace(m.drives, **values), acting=acting)), offsets


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
