"""Identify stiffnesses of joints from positions of motors and links, and torques.

Problem: theta / N - q = tau / K + h sign(qd) + e qd + c + n, per joint: deflections of springs of stiffness K by
torques tau; h of hysteresis, e by which encoders of motors are ahead of those of links, c of encoders that are not at
zero. Deflections are regressed on torques: the other way around, noise of encoders would make K too small.

Algorithm: least squares on averages over cells, with deviations by the spectra of the residuals and the halves of the
log (see `noise_spectra`), at times without the delay of the torques, which the reverse regression shows. Noise of
torques makes 1 / K too small by its share of their power. What is left of deflections bounds it: deviations hold that.

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
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, warn
from jounce.core.progress import stage
from jounce.engine import along
from jounce.engine.engine import Engine, R, with_mechanism
from jounce.identification.averaging import CELLS_PER_PERIOD, CellAverages, force_band, number_cells, weighted_means
from jounce.identification.delays import pose_without_delays
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
    positions.check_single_screws(m, "identify_stiffness()")
    soft, e = _soften(m, rotor)
    gears = joint_data.number_per_coordinate(m, "gear", gear, np.ones(n))
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
    soft = joint_data.with_elasticity(m, ElasticParameters(stiffness=None if e else 1.0, rotor=rotor, coupling=level))
    assert soft.elasticity is not None
    return soft, soft.elasticity


def _read_deflection(
    m: Mechanism, links: Motion, motors: Motion, gears: np.ndarray
) -> tuple[Motion, tuple[np.ndarray, np.ndarray]]:
    """The motion of the links, and the times and deflections (N, n) of their samples; gear ratios are checked."""
    path, ahead = (along.check_motion(m, motion) for motion in (links, motors))
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
    modelled = along.forces_along(soft, path, t, 0)
    q, qd, q2d = modelled.rates
    model = modelled.forces[0][:, -soft.n :]
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
    for name, unit, *of_joint, K in zip(m.coordinates, coordinates.units(m), values, spreads, own, strict=True):
        force = "N m" if unit == "rad" else "N"
        kinds = (("stiffness", f"{force}/{unit}", K), ("hysteresis", force, 0.0), ("encoder delay", "s", 0.0))
        for (kind, of, model), x, s in zip(kinds, *of_joint, strict=True):
            row = f"{name} {kind}", of, float(x), float(s), float(model), bool(s <= abs(x))
            table.append(IdentifiedParameter(*row))
    return tuple(table)


@dataclass(frozen=True, eq=False)
class SpringFit:
    """A fit of the deflections of each joint on some of its columns."""

    x: np.ndarray  # (n, k)
    deviations: np.ndarray  # (n, k)
    rest: np.ndarray  # (n,) mean squares that are left
    variance: np.ndarray  # (n,) of the first column
    whole: Regression

    @property
    def share(self) -> np.ndarray:
        """Mean squares (n,) that are left to those that torques explain: the share of noise in torques is no larger."""
        return self.rest / np.maximum(self.x[:, 0] ** 2 * self.variance, np.finfo(float).tiny)

    def certain(self, column: int, deviations: float) -> np.ndarray:
        """Whether coefficients (n,) of a column have more than some deviations."""
        return np.abs(self.x[:, column]) > deviations * self.deviations[:, column]


@dataclass(frozen=True, eq=False)
class Doubts:
    """What is said of a log, and what it adds to deviations."""

    notes: list[str]
    spread: np.ndarray  # (n,) of 1 / K, or relative
    joints: np.ndarray  # (n,) whether something is wrong with these


def fit_columns(cells: CellAverages, kinds: Sequence[int]) -> SpringFit:
    """The regression of right sides (C, n) on some kinds of columns of each joint."""
    n = cells.off.shape[1]
    columns = (cells.Y.shape[-1] // n * np.arange(n)[:, None] + kinds).ravel()
    fit = fit_forces(cells, columns, None, known=False)
    first = np.stack([cells.Y[:, j, columns[j * len(kinds)]] for j in range(n)], axis=1)
    total = cells.counts.sum(axis=0).clip(1)
    mean = (cells.counts * first).sum(axis=0) / total
    variance = (cells.counts * (first - mean) ** 2).sum(axis=0) / total
    rest = (cells.counts * (cells.off - cells.Y[..., columns] @ fit.x) ** 2).sum(axis=0) / total
    deviations = np.sqrt(np.diag(fit.covariance).reshape(n, -1))
    return SpringFit(fit.x.reshape(n, -1), deviations, rest, variance, fit)


# What may be wrong with the numbers of a log.
def check_positions(names: Sequence[str], link: np.ndarray, motor: np.ndarray, gears: np.ndarray) -> None:
    """Raise `JounceError` where motors (N, n), over gear ratios (n,), are not those of their links (N, n)."""
    _check_copies(names, link, motor)
    q, theta = link - link.mean(axis=0), motor - motor.mean(axis=0)
    # motors that are far nearer to another link than to theirs
    apart = np.sqrt(((theta[:, :, None] - q[:, None]) ** 2).mean(axis=0))  # (n, n) of motors to links
    own, nearest = np.diag(apart), apart.argmin(axis=1)
    if (other := apart.min(axis=1) < MAX_NEARER_SHARE * own).any():
        follow = join_names(f"that of {names[j]} follows {names[nearest[j]]}" for j in _true_places(other))
        cure = "expected the columns of motors, and those of links, in the order of the joints"
        raise JounceError(f"motors follow the links of other joints: {follow}; {cure}")
    # motors that turn more or less than their links
    both, squares = (q * theta).mean(axis=0), (q**2).mean(axis=0)
    ratios = both / np.where(squares > 0, squares, 1.0)
    is_rigid = both**2 > MIN_GEAR_CORRELATION**2 * squares * (theta**2).mean(axis=0)
    off = is_rigid & (np.abs(ratios - 1) > MAX_GEAR_ERROR) & (own > MAX_DEFLECTION)
    if not off.any():
        return
    factors = np.abs(np.log(np.abs(ratios[off])))  # 180 / pi, or its inverse, of angles in different units
    in_degrees = np.abs(factors - np.log(DEGREES_PER_RAD)) < MAX_DEGREES_ERROR
    degrees = "; or all positions in rad, as 57.3 is 180 / pi" if in_degrees.any() else ""
    cures = join_names(f"{gears[j] * ratios[j]:.3g} of {names[j]}" for j in _true_places(off))
    expected = f"gear ratios ({Remedy('gear=', '--gear [JOINT=]N')}), which are about {cures}"
    raise JounceError(f"motors do not move as their links do; expected {expected}{degrees}")


def _check_copies(names: Sequence[str], link: np.ndarray, motor: np.ndarray) -> None:
    """Raise `JounceError` where positions of a motor (N, n) are those of its link: no spring is that stiff."""
    same = (np.ptp(motor - link, axis=0) == 0) & (np.ptp(link, axis=0) > 0)
    if same.all():
        cure = f"expected those of encoders in front of the springs, {Remedy('motors=', '--motors PATTERN')}"
        raise JounceError(f"positions of motors are those of links, of {join_names(names)}; {cure}")


def torque_doubts(names: Sequence[str], given: Measurements, model: np.ndarray, cells: CellAverages) -> Doubts:
    """What is said of torques by those of the model (N, n), and the shares by which stiffnesses may be off with them.

    These are infinite where torques are known to be wrong: saturated, or of another joint.

    Cells hold averages of torques, with the columns of the model, sign(qd), qd, 1, and the models of all joints.
    """
    n, measured = len(names), (given.weights > 0).any(axis=0)
    if not measured.any():
        return Doubts([], np.zeros(n), np.zeros(n, dtype=bool))
    ends = [_end_of_range(*x) for x in zip(given.forces.T, given.weights.T, model.T, strict=True)]
    constant, clipped = (measured & np.array([end == kind for end in ends]) for kind in ("constant", "clipped"))
    # gains, where the model explains torques
    fit, none = fit_columns(cells, range(COLUMNS)), fit_columns(cells, range(1, COLUMNS))
    gain, others = fit.x[:, 0], np.arange(n)
    told = measured & ~constant & ~clipped
    unlike = told & (fit.rest > MAX_UNEXPLAINED_SHARE**2 * none.rest)
    off = np.abs(gain - 1)
    if (unlike | (told & (off > MAX_GAIN_ERROR))).any():
        others = _joints_of_torques(cells, np.minimum(fit.rest, (1 - MIN_OTHER_SHARE) * none.rest))
    swapped = told & (others != np.arange(n))
    certain = told & ~unlike & ~swapped & (off > MIN_CERTAIN_DEVIATIONS * fit.deviations[:, 0])
    notes = name_joints(names, constant, "torques of {} are constant; expected measured ones that vary")
    notes += name_joints(
        names, clipped, "torques of {} stay at an end of their range; expected no saturated sensors, or NaN there"
    )
    if swapped.any():
        follow = join_names(f"those of {names[j]} are like {names[others[j]]}'s" for j in _true_places(swapped))
        cure = "expected columns in the order of the joints"
        notes.append(f"torques follow the model's of other joints: {follow}; {cure}")
    cure = "expected those of these joints, positions in rad or m, times in s, and the load of the log in the model"
    notes += name_joints(names, unlike & ~swapped, f"torques of {{}} do not follow the model's; {cure}")
    notes += _gain_notes(names, np.where(certain, gain, 1.0))
    spread = np.where(clipped | swapped, np.inf, np.abs(1 / np.where(certain, gain, 1.0) - 1))
    return Doubts(notes, spread, constant | clipped | unlike | swapped)


def _gain_notes(names: Sequence[str], gain: np.ndarray) -> list[str]:
    """What is said of torques that are some times (n,) those of the model."""
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
    for which, what, cure in kinds:
        if which.any():
            sizes = join_names(f"{gain[j]:.3g} at {names[j]}" for j in _true_places(which))
            notes.append(f"torques seem to have {what}: they are those of the model times {sizes}; {cure}")
    return notes


def _joints_of_torques(cells: CellAverages, limits: np.ndarray) -> np.ndarray:
    """The joints (n,) whose torques of the model explain measured ones: others leave far less than limits (n,)."""
    n = len(limits)
    left = np.stack([fit_columns(cells, (*range(1, COLUMNS), COLUMNS + k)).rest for k in range(n)], axis=1)
    return np.where(left.min(axis=1) < MAX_OTHER_REMAINDER * limits, left.argmin(axis=1), np.arange(n))


def _end_of_range(torques: np.ndarray, weights: np.ndarray, model: np.ndarray) -> str:
    """Whether torques (N,) of a joint are "constant", or "clipped": many at an end while those of the model vary."""
    there = weights > 0
    torques, model = torques[there], model[there]
    values, counts = np.unique(torques, return_counts=True)
    if len(values) < 2:
        return "constant"
    for value, end, inside in ((values[0], *counts[:2]), (values[-1], *counts[:-3:-1])):
        varies = np.ptp(model[torques == value]) > MIN_CLIPPED_RANGE * np.ptp(model)
        if varies and end > max(MAX_CLIPPED_SHARE * len(torques), MIN_CLIPPED_RATIO * inside):
            return "clipped"
    return ""


def deflection_doubts(
    names: Sequence[str], springs: CellAverages, fit: SpringFit, doubted: np.ndarray, gears: np.ndarray
) -> Doubts:
    """What deflections follow besides torques, and by how much that moves 1 / K.

    Nothing is said of joints that are doubted (n,) for other reasons, as wrong torques make deflections follow all.
    """
    c, e = fit.x[:, 0], fit.x[:, SPEED]
    fits = [fit_columns(springs, (*range(COLUMNS), k)) for k in SUSPECTS]
    certain = np.array([x.certain(-1, MIN_CERTAIN_DEVIATIONS) for x in fits])
    moved = np.array([np.abs(c - x.x[:, 0]) for x in fits]) * certain
    left = np.where(certain, [x.rest for x in fits], np.inf)
    late = ~doubted & fit.certain(SPEED, MIN_CERTAIN_DEVIATIONS) & (np.abs(e) > MAX_ENCODER_DELAY)
    # of each joint, the column that explains most
    best, joints = left.argmin(axis=0), np.arange(len(c))
    found = ~doubted & ~late & (left[best, joints] < MAX_REMAINDER_RATIO * fit.rest)
    found &= moved[best, joints] > MIN_DOUBTED_SHIFT * np.abs(c)
    text_of = np.array([*SUSPECTS.values()])[best]
    ratios = 1 + fits[0].x[:, -1]
    still = found & (best == 0) & (np.abs(ratios) < MAX_STILL_RATIO)
    cure = "expected positions of motors, which are not deflections already"
    notes = name_joints(names, still, f"motors of {{}} do not move with their links; {cure}")
    for text in dict.fromkeys(SUSPECTS.values()):
        which = found & ~still & (text_of == text)
        if text == SUSPECTS[GEAR]:
            of = join_names(f"{gears[j] * ratios[j]:.5g} of {names[j]}" for j in _true_places(which))
            text += f", {Remedy('gear=', '--gear')}, which are about {of}"
        notes += name_joints(names, which, f"deflections of {{}} {text}")
    if late.any():
        of = join_names(f"{-1e3 * e[j]:.3g} ms at {names[j]}" for j in _true_places(late))
        cure = "expected positions of one clock, and torques without damping"
        notes.append(f"motors seem to come after their links, by {of}; {cure}")
    return Doubts(notes, np.sqrt(np.sum(np.square(moved), axis=0)), found | late)


def _true_places(which: np.ndarray) -> list[int]:
    """The places where a mask is true."""
    found: list[int] = np.flatnonzero(which).tolist()
    return found


def name_joints(names: Sequence[str], which: np.ndarray, text: str) -> list[str]:
    """A text with the names of some coordinates; none of none."""
    return [text.format(join_names(np.array(names)[which]))] if which.any() else []
