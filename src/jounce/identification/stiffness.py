"""Identify stiffnesses of joints from positions or deflections, and torques.

Problem: theta / N - q = tau / K + h sign(qd) + e qd + c + n, per joint: deflections of springs of stiffness K by
torques tau; h of hysteresis, e by which encoders of motors are ahead of those of links, c of encoders that are not at
zero. Deflections are regressed on torques: the other way around, noise of encoders would make K too small.

Algorithm: least squares on averages over cells, with deviations by the spectra of the residuals and the halves of the
log (see `noise_spectra`), at times without the delay of the torques, which the reverse regression shows. Noise of
torques makes 1 / K too small by its share of their power. What is left of deflections bounds it: deviations hold that.

Sensors behind gears measure deflections themselves, q - theta / N, which then stand in the place of the motors.

`identify_stiffness` is the door. What may be wrong with the numbers of a log is looked for on the way, once each:

1. Positions (`check_positions`): motors theta are within deflections of their links q. Those that are nearer to another
   link are in its column; those that turn more or less than their links, theta = r q, lack a gear ratio or have another
   unit.
2. Torques (`torque_doubts`): measured ones are compared with those Q of the model, tau = g Q + h sign(qd) + d qd + c.
   What Q leaves is another load or another column, and g != 1 another load or another scale: K is off by g, so
   deviations hold g - 1.
3. Deflections (`deflection_doubts`): each further column that they may follow is fitted alone, as that of a gear ratio
   which is not exact, and what the best one explains is named. Deviations of 1 / K hold by how much any of them moves
   1 / K.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.arguments import joint_data
from jounce.arguments.joint_data import ElasticParameters
from jounce.core import cures
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, warn
from jounce.core.progress import stage
from jounce.engine import along
from jounce.engine.engine import Engine, R, with_mechanism
from jounce.identification.averaging import CELLS_PER_PERIOD, CellAverages, force_band, number_cells, weighted_means
from jounce.identification.delays import pose_without_delays
from jounce.identification.force_checks import scale_notes
from jounce.identification.measurements import MeasuredLog, Measurements, check_measurements
from jounce.identification.regression import Regression, fit_forces
from jounce.identification.result import Identification, IdentifiedParameter
from jounce.model import coordinates, positions
from jounce.model.elasticity import Elasticity
from jounce.model.mechanism import Mechanism
from jounce.motion.motion import Motion

MIN_DEVIATIONS = 4.0  # of 1 / K: with fewer, K has no upper bound worth a number
CELLS_PER_LOG = 16  # at least, four for each unknown of a joint
MIN_CERTAIN_DEVIATIONS = 4.0  # of coefficients that are named: chance makes one of 16,000 that large
MAX_DEFLECTION = 0.05  # rad or m: a larger standard deviation is held against the motion of the link
MIN_GEAR_CORRELATION = 0.98  # of motors and links, whose ratio is that of a gear then
MAX_GEAR_ERROR = 0.5  # of this ratio: a spring that gives way as far hardly holds its link up
DEGREES_PER_RAD = 180 / np.pi
MAX_DEGREES_ERROR = 0.2  # of the logarithm of a ratio of degrees to rad: soft springs change it by less
MAX_NEARER_SHARE = 0.2  # of a motor's distance to its link: it follows the link that is as near
MAX_GAIN_ERROR = 0.05  # of torques to those of the model: sensors and masses are hardly better
MAX_UNEXPLAINED_SHARE = 0.5  # of torques: what the model leaves beyond it is more than friction or wrong masses
MAX_SIZE_RATIO = 10.0  # of torques to those of the model, beyond which the unit is suspected: no masses are that wrong
MIN_OTHER_SHARE = 0.5  # of the squares of torques that the model's of another joint explain: columns are swapped
MAX_OTHER_REMAINDER = 0.1  # of what is left then to what the model's of the joint itself leave
MAX_CLIPPED_SHARE = 0.02  # of samples at one end of the range: more than peaks of smooth torques have there
MIN_CLIPPED_RANGE = 0.02  # of the model's torques in that time to all of them: it is no rest of the robot
MIN_CLIPPED_RATIO = 10.0  # of their number to that one step inside: a coarse sensor has 2.4 times as many at peaks
MAX_STILL_RATIO = 0.1  # of the motion of motors to that of links: no motor, as it is not a spring that moves it
MAX_ENCODER_DELAY = 0.01  # s: beyond it q is no longer linear in time, and deflections of 1e-4 rad are wrong
MIN_DOUBTED_SHIFT = 0.005  # of 1 / K by another column: a smaller one is in the deviation, and not named
MAX_REMAINDER_RATIO = 0.8  # of mean squares with another column: what that stands for is suspected
COLUMNS = 4  # tau, sign(qd), qd, 1
SPEED = 2  # the place of qd, whose coefficient is the time by which encoders are apart
GEAR = 4  # the place of q
SUSPECTS = {  # further columns: what deflections that follow them are, and what is expected
    GEAR: "move with their links; expected exact gear ratios",
    5: "follow accelerations; expected torques of the springs, behind the gears, without the inertia of rotors",
    6: "follow powers of torques: springs are not linear, and K is a mean",
    7: "follow powers of torques: springs are not linear, and K is a mean",
}


@dataclass(frozen=True, eq=False)
class SpringProblem:
    """The deflections of springs, and the reverse regression.

    Residuals of the reverse regression show a delay of torques.
    """

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


@dataclass(frozen=True, eq=False)
class SpringLog:
    """A log of springs: of links, and of motors or deflections."""

    links: Motion
    motors: Motion | None
    deflections: Motion | None  # of links less gears
    gear: object  # of a caller: speeds of motors over those of joints

    def __post_init__(self) -> None:
        motors, deflections = cures.option_name("motors"), cures.option_name("deflections")
        if (self.motors is None) == (self.deflections is None):
            came = "neither motors nor deflections" if self.motors is None else "both motors and deflections"
            raise JounceError(f"{came} are given; expected one of {motors} and {deflections}")
        if self.motors is None and not (np.isscalar(self.gear) and self.gear == 1.0):
            raise JounceError(f"{cures.option_name('gear')} is of positions of motors; leave it out with {deflections}")


@stage("identification of springs")
def identify_stiffness(
    robot: R, given: SpringLog, rotor: object, delay: float | None, as_given: bool
) -> Identification[R]:
    """Identify stiffnesses, see `Robot.identify_stiffness`."""
    m, n = robot.mechanism, robot.n
    positions.check_single_screws(m, "identify_stiffness()")
    soft, e = _soften(m, rotor)
    gears = joint_data.number_per_coordinate(m, "gear", given.gear, np.ones(n))
    path, deflection = _read_deflection(m, given, gears)
    engine = with_mechanism(robot, soft)
    log = _read_torques(m, path, deflection[0])

    # The problem at times without the delay of the torques, which the reverse regression shows.
    def pose(logs: Sequence[MeasuredLog]) -> list[SpringProblem]:
        return [_pose(engine, e, path, deflection, logs[0].measurements)]

    [posed], [late], [delay_notes] = pose_without_delays(pose, [log], delay)
    # Deflections on the columns tau, sign(qd), qd, 1 of each joint: x (n, 4), of which c = 1 / K are the first.
    springs = posed.springs
    torque_values = np.stack([posed.samples.forces, posed.model, posed.rows[..., 1 + SPEED]])
    odd_scale = scale_notes(m.coordinates, posed.samples.weights, torque_values, as_given)
    fit = fit_columns(springs, range(COLUMNS))
    x, c = fit.x, fit.x[:, 0]
    torques = torque_doubts(m.coordinates, posed.samples, posed.model, posed.torques)
    deflections = deflection_doubts(
        m.coordinates, springs, fit, torques.joints, None if given.motors is None else gears
    )
    # Deviations of 1 / K: with the noise of torques and what deflections follow besides, by which a joint is seen; then
    # with errors of torques, which are shares of 1 / K.
    deviations = np.hypot(np.hypot(fit.deviations[:, 0], c * fit.share), deflections.deviations)
    seen = (np.abs(c) > MIN_DEVIATIONS * deviations) & np.isfinite(torques.deviations)
    deviations = np.hypot(deviations, c * np.where(seen, torques.deviations, 0.0))
    doubts = [*torques.notes, *deflections.notes]
    swapped = "expected motors in the columns of motors, and links in those of links: they seem to be swapped"
    if given.motors is None:
        swapped = "expected deflections of links less gears, and torques of the drives: one of them has the other sign"
    _check_signs(m, np.where(seen, c, 0.0), doubts, swapped)
    missing = (posed.samples.weights == 0).all(axis=0)
    text = "torques of {} are not measured: those of the model are used, with the errors of its masses"
    notes = [*delay_notes, *odd_scale, *doubts, *name_joints(m.coordinates, missing, text)]
    text = "the log does not determine the stiffness of {}; expected torques that vary and explain deflections"
    notes += name_joints(m.coordinates, ~seen, text)
    for text in notes:
        warn(text)
    # From x to stiffness 1 / c, hysteresis h K and delay -e of the encoders; of c the deviation of 1 / c is s / c^2.
    # Joints that are not seen keep the stiffness that the robot has.
    model_stiffness = e.stiffness if m.elasticity is not None else np.full(n, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.where(seen, [1 / c, x[:, 1] / c, -x[:, 2]], np.nan)
        spreads = np.where(seen, [deviations / c**2, fit.deviations[:, 1] / c, fit.deviations[:, 2]], np.inf)
    table = _table(m, values.T, spreads.T, model_stiffness)
    stiffness = np.where(seen, values[0], model_stiffness)
    return Identification(
        robot=with_mechanism(robot, replace(soft, elasticity=replace(e, stiffness=stiffness))),
        table=table,
        covariance=np.diag([row.deviation**2 for row in table]),
        rank=fit.whole.rank - n,  # without encoders that are not at zero
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
        model=posed.model / model_stiffness,
        predicted=np.einsum("tjk,jk->tj", posed.rows[..., :COLUMNS], x),
        notes=tuple(notes),
    )


def _soften(m: Mechanism, rotor: object) -> tuple[Mechanism, Elasticity]:
    """Return the mechanism with elastic joints, and their elasticity.

    Raise `JounceError` where rotors have no inertia, or springs are not linear.
    """
    e = m.elasticity
    if e is not None and len(e.springs) > 0:
        raise JounceError(f"{m.name!r} has springs that are not linear, or have dampers; expected linear ones or none")
    # Rigid joints get springs of any stiffness, to be identified; rotors turn at their speed against the links.
    level = "spong" if e is None or e.level is None else e.level
    stiffness = 1.0 if e is None else None
    soft = joint_data.with_elasticity(m, ElasticParameters(stiffness=stiffness, rotor=rotor, coupling=level))
    assert soft.elasticity is not None
    return soft, soft.elasticity


def _read_deflection(m: Mechanism, given: SpringLog, gears: np.ndarray) -> tuple[Motion, tuple[np.ndarray, np.ndarray]]:
    """Return the motion of the links, and times and deflections of samples.

    Gear ratios and columns are checked.
    """
    path = along.check_motion(m, given.links)
    (t, q) = _samples(path)
    if given.deflections is not None:
        if path.torques is None:
            cure = Remedy("named by torques='tau{number}' of jounce.load_motion", "named by --torques 'tau{number}'")
            came = "deflections without measured torques say nothing of stiffness"
            raise JounceError(f"{came}; expected columns such as tau_JOINT or JOINT.effort, {cure}")
        times, measured = _samples(along.check_motion(m, given.deflections))
        inside = (t >= times[0]) & (t <= times[-1])
        _check_count(int(inside.sum()), "deflections and links")
        # The motors would be at q less the deflection.
        return path, (t[inside], np.stack([-np.interp(t[inside], times, x) for x in measured.T], axis=1))
    assert given.motors is not None, "a log has motors or deflections"
    times, theta = _samples(along.check_motion(m, given.motors))
    # Deflections theta / N - q at the times of the links, as far as motors have samples around.
    inside = (t >= times[0]) & (t <= times[-1])
    t, q = t[inside], q[inside]
    _check_count(len(t), "motors and links")
    if not (np.isfinite(gears) & (gears != 0)).all():
        raise JounceError(f"gear is {gears.tolist()}; expected speeds of motors over those of joints, which are not 0")
    theta = np.stack([np.interp(t, times, x) for x in theta.T], axis=1) / gears
    check_positions(m.coordinates, q, theta, gears)
    return path, (t, theta - q)


def _check_count(count: int, what: str) -> None:
    """Raise `JounceError` for logs that share few times."""
    if count < CELLS_PER_LOG:
        raise JounceError(f"{what} share {count} times; expected {CELLS_PER_LOG} or more, of one log")


def _samples(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Return times and positions of the samples of a motion."""
    if motion.samples is not None:
        return motion.samples
    return motion.times, motion(motion.times, 0)[0]


def _read_torques(m: Mechanism, path: Motion, t: np.ndarray) -> MeasuredLog:
    """Return the log with measured torques, of weight 0 without any."""
    measured = Measurements(t, *np.zeros((2, len(t), m.n)))
    if path.torques is not None:
        measured = check_measurements(m, path, None, None, None, None)
        if not measured.forces.any():
            cure = "expected measured ones, N m or N at the joints, or no columns"
            raise JounceError(f"all torques of the log are 0; {cure}")
        # Torques of the joints alone, at times with deflections.
        inside = (measured.t >= t[0]) & (measured.t <= t[-1])
        measured = Measurements(measured.t[inside], measured.forces[inside, -m.n :], measured.weights[inside, -m.n :])
    return MeasuredLog("", path, measured, np.ones(len(measured.t), dtype=bool))


def _pose(
    soft: Engine, e: Elasticity, path: Motion, log: tuple[np.ndarray, np.ndarray], measured: Measurements
) -> SpringProblem:
    """Pose the problem with torques at the times of measurements."""
    t, has_sensor = measured.t, measured.weights.any(axis=0)
    modelled = along.forces_along(soft, path, t, 0)
    q, qd, q2d = modelled.rates
    # Torques of the springs: measured ones, or those of the model at joints without a sensor.
    model = modelled.forces[0][:, -soft.n :]
    tau, weights = np.where(has_sensor, measured.forces, model), np.where(has_sensor, measured.weights, 1.0)
    deflection = np.stack([np.interp(t, log[0], x) for x in log[1].T], axis=1)
    # The columns of h, e and c. sign(qd) is smoothed where noise of qd decides on the direction.
    qd_deviations = path.deviations(t, 1)
    noise = 0.0 if qd_deviations is None else qd_deviations[1]
    sign = qd / np.hypot(qd, np.maximum(noise, np.finfo(float).tiny))
    common = sign, qd, np.ones_like(qd)
    # Columns of each joint, (N, n, 8): these, and the suspects, among them powers of torques about their mean.
    centred = tau - tau.mean(axis=0)
    rows = np.stack([tau, *common, q, q2d, centred**2, centred**3], axis=-1)
    # Cells for the band of the model's torques, but enough of them.
    band = force_band(t, model, qd, e.eps)
    width = (t[-1] - t[0]) / CELLS_PER_LOG
    if band > 0:
        width = min(1 / (CELLS_PER_PERIOD * band), width)
    place = number_cells(t, width)
    # Three regressions on the same cells: torques on deflections, deflections on torques, and measured torques on those
    # of the model, of the joint itself and of all joints.
    reverse = _average(np.stack([deflection, *common], axis=-1), tau, measured.weights, place)
    springs = _average(rows, deflection, weights, place)
    model_of_all = np.broadcast_to(model[:, None], (*model.shape, soft.n))
    compared = np.concatenate([np.stack([model, *common], axis=-1), model_of_all], axis=-1)
    torques = _average(compared, measured.forces, measured.weights, place)
    used_deflection = np.where(weights > 0, deflection, np.nan)
    return SpringProblem(measured, width, reverse, springs, band, used_deflection, rows, torques, model)


def _average(rows: np.ndarray, right: np.ndarray, weights: np.ndarray, place: np.ndarray) -> CellAverages:
    """Average equations of joints with columns over cells: (N, n, k)."""
    means = np.stack([weighted_means(x, weights, place)[0] for x in np.moveaxis(rows, -1, 0)], axis=-1)
    off, counts = weighted_means(right, weights, place)
    # Each joint has columns of its own: (C, n, k) -> block rows (C, n, n k).
    blocks = (means[:, :, None] * np.eye(off.shape[1])[..., None]).reshape(*off.shape, -1)
    return CellAverages(blocks, off, np.zeros_like(off), counts, np.zeros_like(off))


def _check_signs(m: Mechanism, c: np.ndarray, doubts: Sequence[str], swapped: str) -> None:
    """Raise `JounceError` for negative stiffnesses, or if none is seen."""
    causes = "; ".join(doubts)
    if (c < 0).any():
        cure = causes if len(doubts) > 0 else swapped
        raise JounceError(*name_joints(m.coordinates, c < 0, f"the stiffness of {{}} is negative; {cure}"))
    if not c.any():
        vary = "expected torques that vary, and deflections above the noise that follow them"
        cure = causes if len(doubts) > 0 else vary
        raise JounceError(f"the log determines the stiffness of no joint; {cure}")


def _table(
    m: Mechanism, values: np.ndarray, deviations: np.ndarray, model_stiffness: np.ndarray
) -> tuple[IdentifiedParameter, ...]:
    """Return the table of the parameters (n, 3) of springs, with deviations."""
    table = []
    for j, (name, unit) in enumerate(zip(m.coordinates, coordinates.units(m), strict=True)):
        force = "N m" if unit == "rad" else "N"
        kinds = (
            ("stiffness", f"{force}/{unit}", model_stiffness[j]),
            ("hysteresis", force, 0.0),
            ("encoder delay", "s", 0.0),
        )
        for (kind, kind_unit, model), x, s in zip(kinds, values[j], deviations[j], strict=True):
            row = f"{name} {kind}", kind_unit, float(x), float(s), float(model), bool(s <= abs(x))
            table.append(IdentifiedParameter(*row))
    return tuple(table)


@dataclass(frozen=True, eq=False)
class SpringFit:
    """A fit of each joint's right side on some of its columns."""

    x: np.ndarray  # (n, k)
    deviations: np.ndarray  # (n, k)
    rest: np.ndarray  # (n,) mean squares of residuals
    variance: np.ndarray  # (n,) of the first column
    whole: Regression

    @property
    def share(self) -> np.ndarray:
        """The mean squares (n,) of residuals over those that torques explain.

        The share of noise in the power of torques is no larger.
        """
        return self.rest / np.maximum(self.x[:, 0] ** 2 * self.variance, np.finfo(float).tiny)

    def certain(self, column: int, deviations: float) -> np.ndarray:
        """Return whether coefficients (n,) of a column have more than some deviations."""
        return np.abs(self.x[:, column]) > deviations * self.deviations[:, column]


@dataclass(frozen=True, eq=False)
class Doubts:
    """Notes on a log, and what its errors add to deviations."""

    notes: list[str]
    deviations: np.ndarray  # (n,) of 1 / K, or relative
    joints: np.ndarray  # (n,) whether something is wrong with a joint


def fit_columns(cells: CellAverages, kinds: Sequence[int]) -> SpringFit:
    """Fit the right sides of cells on some kinds of columns."""
    # The places of these kinds among the columns (C, n, n k) of all joints.
    n = cells.off.shape[1]
    columns = (cells.Y.shape[-1] // n * np.arange(n)[:, None] + kinds).ravel()
    fit = fit_forces(cells, columns, None, known=False)
    # Weighted means over the cells of each joint: the variance of its first column, and its mean square residual.
    first = np.stack([cells.Y[:, j, columns[j * len(kinds)]] for j in range(n)], axis=1)
    total = cells.counts.sum(axis=0).clip(1)
    mean = (cells.counts * first).sum(axis=0) / total
    variance = (cells.counts * (first - mean) ** 2).sum(axis=0) / total
    rest = (cells.counts * (cells.off - cells.Y[..., columns] @ fit.x) ** 2).sum(axis=0) / total
    deviations = np.sqrt(np.diag(fit.covariance).reshape(n, -1))
    return SpringFit(fit.x.reshape(n, -1), deviations, rest, variance, fit)


# What may be wrong with the numbers of a log.
def check_positions(names: Sequence[str], link: np.ndarray, motor: np.ndarray, gears: np.ndarray) -> None:
    """Raise `JounceError` where motors do not follow their links.

    Both are (N, n); motors are over gear ratios (n,).
    """
    _check_copies(names, link, motor)
    q, theta = link - link.mean(axis=0), motor - motor.mean(axis=0)
    # Motors that are far nearer to another link than to their own: distances (n, n) of motors to links.
    distances = np.sqrt(((theta[:, :, None] - q[:, None]) ** 2).mean(axis=0))
    own_distances, nearest = np.diag(distances), distances.argmin(axis=1)
    is_swapped = distances.min(axis=1) < MAX_NEARER_SHARE * own_distances
    if is_swapped.any():
        follow = join_names(f"that of {names[j]} follows {names[nearest[j]]}" for j in _true_places(is_swapped))
        cure = "expected the columns of motors, and those of links, in the order of the joints"
        raise JounceError(f"motors follow the links of other joints: {follow}; {cure}")
    # Motors that turn more or less than their links, theta = r q, closely and by more than springs give way.
    products, squares = (q * theta).mean(axis=0), (q**2).mean(axis=0)
    ratios = products / np.where(squares > 0, squares, 1.0)
    is_rigid = products**2 > MIN_GEAR_CORRELATION**2 * squares * (theta**2).mean(axis=0)
    has_gear = is_rigid & (np.abs(ratios - 1) > MAX_GEAR_ERROR) & (own_distances > MAX_DEFLECTION)
    if not has_gear.any():
        return
    # 180 / pi, or its inverse, is the ratio of angles in different units.
    factors = np.abs(np.log(np.abs(ratios[has_gear])))
    in_degrees = np.abs(factors - np.log(DEGREES_PER_RAD)) < MAX_DEGREES_ERROR
    degrees = "; or all positions in rad, as 57.3 is 180 / pi" if in_degrees.any() else ""
    cures = join_names(f"{gears[j] * ratios[j]:.3g} of {names[j]}" for j in _true_places(has_gear))
    expected = f"gear ratios ({Remedy('gear=', '--gear [JOINT=]N')}), which are about {cures}"
    raise JounceError(f"motors do not move as their links do; expected {expected}{degrees}")


def _check_copies(names: Sequence[str], link: np.ndarray, motor: np.ndarray) -> None:
    """Raise `JounceError` where all motors are copies of their links."""
    # No spring is that stiff.
    is_copy = (np.ptp(motor - link, axis=0) == 0) & (np.ptp(link, axis=0) > 0)
    if is_copy.all():
        cure = f"expected those of encoders in front of the springs, {Remedy('motors=', '--motors PATTERN')}"
        raise JounceError(f"positions of motors are those of links, of {join_names(names)}; {cure}")


def torque_doubts(names: Sequence[str], samples: Measurements, model: np.ndarray, cells: CellAverages) -> Doubts:
    """Compare measured torques with those of the model (N, n).

    Deviations are shares by which stiffnesses may be off with the torques: infinite where torques are known to be
    wrong, saturated or of another joint. Cells hold averages of torques, with the columns of the model, sign(qd), qd,
    1, and the models of all joints.
    """
    n, measured = len(names), (samples.weights > 0).any(axis=0)
    if not measured.any():
        return Doubts([], np.zeros(n), np.zeros(n, dtype=bool))
    # Sensors that stand still or saturate.
    ends = [_end_of_range(*x) for x in zip(samples.forces.T, samples.weights.T, model.T, strict=True)]
    constant, clipped = (measured & np.array([end == kind for end in ends]) for kind in ("constant", "clipped"))
    varying = measured & ~constant & ~clipped
    # Gains g of tau = g Q + h sign(qd) + d qd + c, and whether Q explains torques, next to a fit without Q.
    fit, fit_without = fit_columns(cells, range(COLUMNS)), fit_columns(cells, range(1, COLUMNS))
    gain, joints_of_torques = fit.x[:, 0], np.arange(n)
    unlike = varying & (fit.rest > MAX_UNEXPLAINED_SHARE**2 * fit_without.rest)
    gain_errors = np.abs(gain - 1)
    # Where something is wrong, torques of another joint may explain them better: the columns are swapped.
    if (unlike | (varying & (gain_errors > MAX_GAIN_ERROR))).any():
        limits = np.minimum(fit.rest, (1 - MIN_OTHER_SHARE) * fit_without.rest)
        joints_of_torques = _joints_of_torques(cells, limits)
    swapped = varying & (joints_of_torques != np.arange(n))
    certain = varying & ~unlike & ~swapped & (gain_errors > MIN_CERTAIN_DEVIATIONS * fit.deviations[:, 0])
    notes = name_joints(names, constant, "torques of {} are constant; expected measured ones that vary")
    notes += name_joints(
        names, clipped, "torques of {} stay at an end of their range; expected no saturated sensors, or NaN there"
    )
    if swapped.any():
        pairs = [(names[j], names[joints_of_torques[j]]) for j in _true_places(swapped)]
        follow = join_names(f"those of {name} are like {other}'s" for name, other in pairs)
        cure = "expected columns in the order of the joints"
        notes.append(f"torques follow the model's of other joints: {follow}; {cure}")
    cure = "expected those of these joints, positions in rad or m, times in s, and the load of the log in the model"
    notes += name_joints(names, unlike & ~swapped, f"torques of {{}} do not follow the model's; {cure}")
    # A certain gain g makes 1 / K wrong by the share 1 / g - 1.
    certain_gain = np.where(certain, gain, 1.0)
    notes += _gain_notes(names, certain_gain)
    shares = np.where(clipped | swapped, np.inf, np.abs(1 / certain_gain - 1))
    return Doubts(notes, shares, constant | clipped | unlike | swapped)


def _gain_notes(names: Sequence[str], gain: np.ndarray) -> list[str]:
    """Return notes on torques that are gains times the model's."""
    # The sign first, then sizes that no mass makes, then those of a scale or a load.
    opposed = gain < 0
    odd = ~opposed & (np.abs(np.log(np.abs(gain))) > np.log(MAX_SIZE_RATIO))
    scale = ~opposed & ~odd & (np.abs(gain - 1) > MAX_GAIN_ERROR)
    kinds = (
        (opposed, "the wrong sign", "expected Q = M q2d + C qd + Qgrav, which the drives exert on the robot"),
        (odd, "the wrong unit", "expected N m or N at the joints, behind the gears"),
        (
            scale,
            "the wrong scale, or the model another load",
            "expected those of these joints, as K is off as they are",
        ),
    )
    notes = []
    for mask, what, cure in kinds:
        if mask.any():
            sizes = join_names(f"{gain[j]:.3g} at {names[j]}" for j in _true_places(mask))
            notes.append(f"torques seem to have {what}: they are those of the model times {sizes}; {cure}")
    return notes


def _joints_of_torques(cells: CellAverages, limits: np.ndarray) -> np.ndarray:
    """Return the joints (n,) whose torques of the model explain measured ones.

    A joint's own serve, unless those of another leave far less than limits (n,).
    """
    # Mean squares (n, n) of measured torques that the model's of joint k leave.
    n = len(limits)
    remainders = np.stack([fit_columns(cells, (*range(1, COLUMNS), COLUMNS + k)).rest for k in range(n)], axis=1)
    return np.where(remainders.min(axis=1) < MAX_OTHER_REMAINDER * limits, remainders.argmin(axis=1), np.arange(n))


def _end_of_range(torques: np.ndarray, weights: np.ndarray, model: np.ndarray) -> str:
    """Return "constant" or "clipped" of such torques of a joint, else "".

    Clipped are those of which many are at an end of their range, while those of the model vary.
    """
    measured = weights > 0
    torques, model = torques[measured], model[measured]
    values, counts = np.unique(torques, return_counts=True)
    if len(values) < 2:
        return "constant"
    # Either end: how many samples are there, and one step inside.
    for value, end, inside in ((values[0], *counts[:2]), (values[-1], *counts[:-3:-1])):
        varies = np.ptp(model[torques == value]) > MIN_CLIPPED_RANGE * np.ptp(model)
        if varies and end > max(MAX_CLIPPED_SHARE * len(torques), MIN_CLIPPED_RATIO * inside):
            return "clipped"
    return ""


def deflection_doubts(
    names: Sequence[str], springs: CellAverages, fit: SpringFit, doubted: np.ndarray, gears: np.ndarray | None
) -> Doubts:
    """Find what deflections follow besides torques, with shifts of 1 / K.

    Gear ratios are None where deflections are measured. Nothing is said of joints that are doubted (n,) for other
    reasons, as wrong torques make deflections follow all.
    """
    # One fit for each suspect column: whether it is certain, how far it moves 1 / K, and what it leaves: (suspects, n).
    c, e = fit.x[:, 0], fit.x[:, SPEED]
    fits = [fit_columns(springs, (*range(COLUMNS), k)) for k in SUSPECTS]
    certain = np.array([suspect.certain(-1, MIN_CERTAIN_DEVIATIONS) for suspect in fits])
    shifts = np.array([np.abs(c - suspect.x[:, 0]) for suspect in fits]) * certain
    remainders = np.where(certain, [suspect.rest for suspect in fits], np.inf)
    late = ~doubted & fit.certain(SPEED, MIN_CERTAIN_DEVIATIONS) & (np.abs(e) > MAX_ENCODER_DELAY)
    # The column of each joint that explains most; it is named if it explains much and moves 1 / K. Late encoders make
    # deflections follow other columns too.
    best, joints = remainders.argmin(axis=0), np.arange(len(c))
    suspected = ~doubted & ~late & (remainders[best, joints] < MAX_REMAINDER_RATIO * fit.rest)
    suspected &= shifts[best, joints] > MIN_DOUBTED_SHIFT * np.abs(c)
    best_texts = np.array([*SUSPECTS.values()])[best]
    # Deflections theta - q that follow r - 1 times q are those of motors r q; with r = 0 they are no motors at all.
    ratios = 1 + fits[0].x[:, -1]
    still = suspected & (best == 0) & (np.abs(ratios) < MAX_STILL_RATIO) & (gears is not None)
    cure = f"expected positions of motors, or deflections by {Remedy('deflections=', '--deflections PATTERN')}"
    notes = name_joints(names, still, f"motors of {{}} do not move with their links; {cure}")
    for text in dict.fromkeys(SUSPECTS.values()):
        mask = suspected & ~still & (best_texts == text)
        if text == SUSPECTS[GEAR] and gears is None:
            text = "move with their links; expected deflections, without a share of the positions"
        elif text == SUSPECTS[GEAR] and gears is not None:
            exact = join_names(f"{gears[j] * ratios[j]:.5g} of {names[j]}" for j in _true_places(mask))
            text += f", {Remedy('gear=', '--gear')}, which are about {exact}"
        notes += name_joints(names, mask, f"deflections of {{}} {text}")
    if late.any():
        delays = join_names(f"{-1e3 * e[j]:.3g} ms at {names[j]}" for j in _true_places(late))
        cure = "expected positions of one clock, and torques without damping"
        what = "deflections follow velocities, as if they came" if gears is None else "motors seem to come"
        notes.append(f"{what} after their links, by {delays}; {cure}")
    # Deviations of 1 / K hold the shifts by all certain columns, named or not.
    return Doubts(notes, np.sqrt(np.sum(np.square(shifts), axis=0)), suspected | late)


def _true_places(mask: np.ndarray) -> list[int]:
    """Return the places where a mask is true."""
    places: list[int] = np.flatnonzero(mask).tolist()
    return places


def name_joints(names: Sequence[str], mask: np.ndarray, text: str) -> list[str]:
    """Return a text with the names of some coordinates, if any."""
    if not mask.any():
        return []
    return [text.format(join_names(np.array(names)[mask]))]
