"""Identification of the stiffness of joints from the positions of motors and links, and the torques between them.

Problem: theta / N - q = tau / K + h sign(qd) + e qd + c + n, per joint: deflections of springs of stiffness K by
torques tau; h of hysteresis, e by which encoders of motors are ahead of those of links, c of encoders that are not at
zero. Deflections are regressed on torques: the other way around, noise of encoders would make K too small.

Algorithm: least squares on averages over cells, with deviations by the spectra of the residuals and the halves of the
log (see `noise_spectra`), at times without the delay of the torques, which the reverse regression shows. Noise of
torques makes 1 / K too small by its share of their power. What is left of deflections bounds it: deviations hold that.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.arguments.elasticity import ElasticParameters, number_per_coordinate, with_elasticity
from jounce.core.errors import JounceError, warn
from jounce.core.progress import stage
from jounce.engine.along import check_motion, forces_along
from jounce.engine.engine import Engine, R, with_mechanism
from jounce.identification.averaging import CELLS_PER_PERIOD, CellAverages, force_band, number_cells, weighted_means
from jounce.identification.delays import pose_without_delays
from jounce.identification.measured_logs import MeasuredLog
from jounce.identification.measurements import Measurements, check_measurements
from jounce.identification.result import Identification
from jounce.identification.result_tables import IdentifiedParameter
from jounce.identification.spring_checks import (
    COLUMNS,
    check_positions,
    deflection_doubts,
    fit_columns,
    name_joints,
    torque_doubts,
)
from jounce.model.coordinates import coordinate_units
from jounce.model.elasticity import Elasticity
from jounce.model.mechanism import Mechanism
from jounce.model.positions import check_single_screws
from jounce.motion.motion import Motion

MIN_DEVIATIONS = 4.0  # of 1 / K: with fewer, K has no upper bound worth a number
CELLS_PER_LOG = 16  # at least, four for each unknown of a joint


@dataclass(frozen=True, eq=False)
class SpringProblem:
    """The deflections of springs, and the reverse regression, whose residuals show a delay of torques."""

    samples: Measurements  # measured torques
    width: float  # of the cells, s
    cells: CellAverages  # of the reverse regression
    springs: CellAverages  # deflections by the columns of each joint
    band: float  # of the torques of the model, Hz
    deflection: np.ndarray  # (N, n)
    rows: np.ndarray  # (N, n, 8) columns of each joint
    torques: CellAverages  # measured torques by those of the model
    model: np.ndarray  # (N, n) torques of the model

    @property
    def columns(self) -> np.ndarray:
        """All columns of the reverse regression."""
        return np.arange(self.cells.Y.shape[-1])


@stage("identification of springs")
def identify_stiffness(
    robot: R, links: Motion, motors: Motion, gear: object, rotor: object, delay: float | None
) -> Identification[R]:
    """Identify stiffnesses, see `Robot.identify_stiffness`."""
    m, n = robot.mechanism, robot.n
    check_single_screws(m, "identify_stiffness()")
    soft, e = _soften(m, rotor)
    gears = number_per_coordinate(m, "gear", gear, np.ones(n))
    path, deflection = _read_deflection(m, links, motors, gears)
    engine = with_mechanism(robot, soft)
    log = _read_torques(m, path, deflection[0])
    [posed], [late], [said] = pose_without_delays(
        lambda logs: [_pose(engine, e, path, deflection, logs[0].given)], [log], delay
    )
    springs = posed.springs
    fit = fit_columns(springs, range(COLUMNS))
    x, c = fit.x, fit.x[:, 0]
    forces = torque_doubts(m.coordinates, posed.samples, posed.model, posed.torques)
    others = deflection_doubts(m.coordinates, springs, fit, forces.joints, gears)
    # deviations of 1 / K: with the noise of torques and what deflections follow besides, then with errors of torques
    spread = np.hypot(np.hypot(fit.deviations[:, 0], c * fit.share), others.spread)
    seen = (np.abs(c) > MIN_DEVIATIONS * spread) & np.isfinite(forces.spread)
    spread = np.hypot(spread, c * np.where(seen, forces.spread, 0.0))
    suspected = [*forces.notes, *others.notes]
    _check_signs(m, np.where(seen, c, 0.0), suspected)
    missing = (posed.samples.weights == 0).all(axis=0)
    text = "torques of {} are not measured: the model's serve, as wrong as its masses are"
    notes = [*said, *suspected, *name_joints(m.coordinates, missing, text)]
    text = "the log does not determine the stiffness of {}; expected torques that vary and explain deflections"
    notes += name_joints(m.coordinates, ~seen, text)
    for text in notes:
        warn(text)
    own = e.stiffness if m.elasticity is not None else np.full(n, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.where(seen, [1 / c, x[:, 1] / c, -x[:, 2]], np.nan)
        spreads = np.where(seen, [spread / c**2, fit.deviations[:, 1] / c, fit.deviations[:, 2]], np.inf)
    table = _table(m, values.T, spreads.T, own)
    return Identification(
        robot=with_mechanism(robot, replace(soft, elasticity=replace(e, stiffness=np.where(seen, values[0], own)))),
        table=table,
        covariance=np.diag([row.deviation**2 for row in table]),
        rank=fit.whole.rank - n,  # without c
        condition=fit.whole.condition,
        deviations=fit.whole.deviations,
        residuals=(),
        span=(float(posed.samples.t[0]), float(posed.samples.t[-1])),
        band=posed.band,
        cell=posed.width,
        samples=len(posed.samples.t),
        cells=len(springs.off),
        delay=late,
        t=posed.samples.t,
        measured=posed.deflection,
        model=posed.model / own,
        predicted=np.einsum("tjk,jk->tj", posed.rows[..., :COLUMNS], x),
        notes=tuple(notes),
    )


def _soften(m: Mechanism, rotor: object) -> tuple[Mechanism, Elasticity]:
    """The mechanism with elastic joints; `JounceError` where rotors have no inertia, or springs are not linear."""
    e = m.elasticity
    if e is not None and e.springs:
        raise JounceError(f"{m.name!r} has springs that are not linear, or have dampers; expected linear ones or none")
    level = "spong" if e is None or e.level is None else e.level
    soft = with_elasticity(m, ElasticParameters(stiffness=None if e else 1.0, rotor=rotor, coupling=level))
    assert soft.elasticity is not None
    return soft, soft.elasticity


def _read_deflection(
    m: Mechanism, links: Motion, motors: Motion, gears: np.ndarray
) -> tuple[Motion, tuple[np.ndarray, np.ndarray]]:
    """The motion of the links, and the times and deflections (N, n) of their samples; gear ratios are checked."""
    path, ahead = (check_motion(m, motion) for motion in (links, motors))
    (t, q), (times, theta) = (x.samples or (x.times, x(x.times, 0)[0]) for x in (path, ahead))
    inside = (t >= times[0]) & (t <= times[-1])
    t, q = t[inside], q[inside]
    if len(t) < CELLS_PER_LOG:
        raise JounceError(f"motors and links share {len(t)} times; expected {CELLS_PER_LOG} or more, of one log")
    if not (np.isfinite(gears) & (gears != 0)).all():
        raise JounceError(f"gear is {gears.tolist()}; expected speeds of motors over those of joints, which are not 0")
    theta = np.stack([np.interp(t, times, x) for x in theta.T], axis=1) / gears
    check_positions(m.coordinates, q, theta, gears)
    return path, (t, theta - q)


def _read_torques(m: Mechanism, path: Motion, t: np.ndarray) -> MeasuredLog:
    """The log with measured torques; all of weight 0 without any."""
    given = Measurements(t, *np.zeros((2, len(t), m.n)))
    if path.torques is not None:
        given = check_measurements(m, path, None, None, None, None)
        if not given.forces.any():
            cure = "expected measured ones, N m or N at the joints, or no columns"
            raise JounceError(f"all torques of the log are 0; {cure}")
        inside = (given.t >= t[0]) & (given.t <= t[-1])
        given = Measurements(given.t[inside], given.forces[inside, -m.n :], given.weights[inside, -m.n :])
    return MeasuredLog("", path, given, np.ones(len(given.t), dtype=bool))


def _pose(
    soft: Engine, e: Elasticity, path: Motion, log: tuple[np.ndarray, np.ndarray], given: Measurements
) -> SpringProblem:
    """The problem with torques at given times."""
    t, there = given.t, given.weights.any(axis=0)
    along = forces_along(soft, path, t, 0)
    q, qd, q2d = along.rates
    model = along.forces[0][:, -soft.n :]
    tau, weights = np.where(there, given.forces, model), np.where(there, given.weights, 1.0)
    deflection = np.stack([np.interp(t, log[0], x) for x in log[1].T], axis=1)
    noise = np.maximum((path.deviations(t, 1) or (0.0, 0.0))[1], np.finfo(float).tiny)
    known = qd / np.hypot(qd, noise), qd, np.ones_like(qd)  # no direction where noise decides on it
    off = tau - tau.mean(axis=0)
    rows = np.stack([tau, *known, q, q2d, off**2, off**3], axis=-1)
    band = force_band(t, model, qd, e.eps)
    width = min(1 / (CELLS_PER_PERIOD * band) if band else np.inf, (t[-1] - t[0]) / CELLS_PER_LOG)
    place = number_cells(t, width)
    reverse = _average(np.stack([deflection, *known], axis=-1), tau, given.weights, place)
    springs, seen = _average(rows, deflection, weights, place), np.where(weights > 0, deflection, np.nan)
    others = np.broadcast_to(model[:, None], (*model.shape, soft.n))
    compared = np.concatenate([np.stack([model, *known], axis=-1), others], axis=-1)
    torques = _average(compared, given.forces, given.weights, place)
    return SpringProblem(given, width, reverse, springs, band, seen, rows, torques, model)


def _average(rows: np.ndarray, right: np.ndarray, weights: np.ndarray, place: np.ndarray) -> CellAverages:
    """Averages over cells of equations of n joints with k columns (N, n, k) each."""
    means = np.stack([weighted_means(x, weights, place)[0] for x in np.moveaxis(rows, -1, 0)], axis=-1)
    off, counts = weighted_means(right, weights, place)
    blocks = (means[:, :, None] * np.eye(off.shape[1])[..., None]).reshape(*off.shape, -1)
    return CellAverages(blocks, off, np.zeros_like(off), counts, np.zeros_like(off))


def _check_signs(m: Mechanism, c: np.ndarray, doubts: Sequence[str]) -> None:
    """Raise `JounceError` unless all of what is known of 1 / K (n,) is positive, and something is known."""
    swapped = "expected motors in the columns of motors, and links in those of links: they seem to be swapped"
    negative = f"the stiffness of {{}} is negative; {'; '.join(doubts) or swapped}"
    if (c < 0).any():
        raise JounceError(*name_joints(m.coordinates, c < 0, negative))
    if not c.any():
        cure = "; ".join(doubts) or "expected torques that vary, and deflections above the noise that follow them"
        raise JounceError(f"the log determines the stiffness of no joint; {cure}")


def _table(m: Mechanism, values: np.ndarray, spreads: np.ndarray, own: np.ndarray) -> tuple[IdentifiedParameter, ...]:
    """The parameters (n, 3) of springs, with their deviations, next to the stiffnesses that the robot had."""
    table = []
    for name, unit, *of_joint, K in zip(m.coordinates, coordinate_units(m), values, spreads, own, strict=True):
        force = "N m" if unit == "rad" else "N"
        kinds = (("stiffness", f"{force}/{unit}", K), ("hysteresis", force, 0.0), ("encoder delay", "s", 0.0))
        for (kind, of, model), x, s in zip(kinds, *of_joint, strict=True):
            row = f"{name} {kind}", of, float(x), float(s), float(model), bool(s <= abs(x))
            table.append(IdentifiedParameter(*row))
    return tuple(table)
