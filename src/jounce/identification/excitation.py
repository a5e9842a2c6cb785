"""Excitation: the motion within all limits whose forces tell most about the parameters of a robot."""

from dataclasses import dataclass, replace

import numpy as np

from jounce._scalars import asarray, is_finite
from jounce._typing import ArrayLike, DriveColumn, DriveColumns
from jounce.errors import JounceError, listed, quoted
from jounce.identification.harmonics import FEWEST, Harmonics
from jounce.identification.information import Information, information
from jounce.identification.room import room_of
from jounce.identification.search import Progress, Search, reaches_of
from jounce.limits.check import Check, CheckedLimit
from jounce.model.coordinates import coordinate_limits, coordinate_units
from jounce.model.drives import select_columns
from jounce.model.limits import KINDS, MOTION_KINDS, MOTOR_KINDS, Limits
from jounce.motion import Motion
from jounce.robot import Robot

MOST, MANY = 50, 1000  # harmonics; starts and periods: more are slips of the pen
TYPICAL = 4  # rows of typical states per column of the regressor, by which columns are found that depend on others
SINGULAR = 1e5  # condition number from which on parameters cannot be told from each other
DRAWN = 30  # times that a motion is drawn to a pose at rest, until it is within the limits between its points too
LEAST = 1e-4  # of its size, by which it is drawn at first


@dataclass(frozen=True, repr=False)
class Excitation:
    """A motion that excites the parameters of a robot. `jounce.excite` makes one.

    Attributes
    ----------
    motion : Motion
        The Fourier series; every period starts and ends at rest, q4d = 0 included.
    criterion : float
        log det of the information matrix, the time mean of Y^T W Y: Y the regressor of `parameters` in SI units, W the
        weights of the forces.
    condition : float
        Condition number of W^(1/2) Y, its columns of unit length.
    parameters : tuple of str
        The base parameters and drive terms that forces along the motion tell.
    unseen : tuple of str
        Those that no motion of this robot tells from them.
    check : Check
        Every limit along the motion, between samples too.
    notes : tuple of str
        What was assumed, in words.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(lower=-2, upper=2, velocity=3, effort=[60, 20])
    >>> found = jounce.excite(robot, period=4, harmonics=4, starts=2)
    >>> found.check.ok, found.unseen, len(found.parameters)
    (True, (), 6)
    """

    motion: Motion
    criterion: float
    condition: float
    parameters: tuple[str, ...]
    unseen: tuple[str, ...]
    check: Check
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        told = f"{len(self.parameters)} parameters, condition {self.condition:.4g}"
        return f"<Excitation: {self.motion.duration:g} s, {told}; worst: {self.check.worst}>"

    @property
    def limits(self) -> tuple[CheckedLimit, ...]:
        """Of each kind of limit the one that the motion uses most."""
        table = self.check.table
        kinds = dict.fromkeys(row.limit for row in table)
        return tuple(max((row for row in table if row.limit == kind), key=lambda row: row.ratio) for kind in kinds)

    def __str__(self) -> str:
        rows = [("limit", "joint", "worst", "bound", "unit", "ratio", "at t")]
        for row in self.limits:
            numbers = f"{row.value:.6g}", f"{row.bound:.6g}", row.unit, f"{row.ratio:.4f}", f"{row.t:.4f}"
            rows.append((row.words, row.joint, *numbers))
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        return "\n".join([
            self.motion.source,
            f"{len(self.parameters)} parameters seen, unseen: {listed(self.unseen) or '-'}",
            f"log det of the information matrix {self.criterion:.6g}, condition number {self.condition:.4g}",
            *self.notes,
            "",
            *("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows),
        ])  # fmt: skip


def excite(
    robot: Robot,
    *,
    period: float = 10.0,
    periods: int = 1,
    harmonics: int = 5,
    drives: DriveColumns = False,
    weights: ArrayLike | None = None,
    reach: float = np.pi,
    margin: float = 0.01,
    starts: int = 5,
    seed: int = 0,
    progress: Progress | None = None,
) -> Excitation:
    """Find a motion whose forces tell most about the base parameters of a robot, within all its limits.

    Every coordinate follows a Fourier series with the same base frequency, and starts and ends at rest with all rates
    up to q4d zero, so that Q2d has no jump. The series minimizes -log det of the information
    matrix, the time mean of ``Y^T W Y``, with the regressor Y of the base parameters: the volume of the confidence
    ellipsoid of identified parameters, whatever their units. All limits that the robot states hold, between samples
    too; obstacles and the robot's own links are not seen: position limits keep it from them.

    Parameters
    ----------
    robot : Robot
        With limits, see `Robot.with_limits`. Drive terms that act enter its effort limits.
    period : float, optional
        Of the series, s.
    periods : int, optional
        How often the motion repeats it.
    harmonics : int, optional
        Of the series, 3 to 50.
    drives : bool, str or iterable of str, optional
        Drive terms that are to be identified too, as `Robot.regressor` takes them: "armature", "damping", "friction",
        "spring", "offset"; True for all.
    weights : (n,), optional
        Relative inverse variances of the measured forces; 0 leaves one out. By default the inverse squares of the
        effort limits; equal if a coordinate has none.
    reach : float, optional
        How far a revolute joint without position limits moves to either side of 0 (or away from its only limit, twice
        as far), rad.
    margin : float, optional
        Share of each limit that is left.
    starts, seed : int, optional
        Number of random series to start from, and the seed of their generator.
    progress : callable, optional
        It is called with the number of starts that are done, and of all.

    Returns
    -------
    Excitation
        The `motion`, the `criterion`, the `condition` number, the parameters seen and unseen, and the `check` of all
        limits.

    Raises
    ------
    JounceError
        If the robot floats or states no limit of a rate or force, an argument is out of range, a prismatic joint has
        no position limits, limits leave no room to move, or the motion does not tell the parameters from each other.

    References
    ----------
    J. Swevers, C. Ganseman, D. B. Tukel, J. De Schutter, H. Van Brussel, "Optimal Robot Excitation and Identification",
    IEEE Transactions on Robotics and Automation 13(5), 1997.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(lower=-2, upper=2, velocity=3, effort=[60, 20])
    >>> found = jounce.excite(robot, period=4, harmonics=4, starts=2, drives="friction")
    >>> found.check.ok, found.parameters[-1]
    (True, 'joint2 friction')
    """
    count, rng = _whole("starts", starts, 1, MANY), np.random.default_rng(_whole("seed", seed, 0))
    times = _number("period", period, "s"), _whole("periods", periods, 1, MANY)
    series = Harmonics(*times, _whole("harmonics", harmonics, FEWEST, MOST))
    search, notes = _search(robot, series, select_columns(drives), weights, reach, margin, rng)
    rest = search.rest(rng)
    x, motion, found = _within(search, search.best(count, rng, progress), rest)
    rates, told = search.rates(x), search.information
    condition = told.condition(rates)
    if not condition <= SINGULAR:
        raise JounceError(
            f"the motion does not tell the {len(told.names)} parameters from each other (condition number"
            f" {condition:.2g}); expected more than {harmonics} harmonics, or wider limits"
        )
    return Excitation(motion, told.log_det(rates), condition, told.names, told.unseen, found, notes)


def _search(
    robot: object,
    series: Harmonics,
    terms: tuple[DriveColumn, ...],
    weights: ArrayLike | None,
    reach: object,
    margin: object,
    rng: np.random.Generator,
) -> tuple[Search, tuple[str, ...]]:
    """What is searched for the arguments of a caller, checked, and notes on what is assumed."""
    if not isinstance(robot, Robot):
        raise JounceError(f"excite() expects a jounce.Robot, got {type(robot).__name__}")
    if robot.mechanism.base:
        raise JounceError(f"the base of {quoted(robot.name)} floats; expected one at rest, load(..., base='fixed')")
    left = float(margin) if is_finite(margin) else -1.0  # type: ignore[arg-type]
    if not 0 <= left < 1:
        raise JounceError(f"margin is {quoted(margin)}; expected a share of the limits, 0 <= margin < 1")
    if robot.mechanism.closure:
        raise JounceError(f"the loops of {quoted(robot.name)} are closed; expected a robot without loops")
    limits, notes = _bounded_positions(robot, _number("reach", reach, "rad"))
    kinds = [kind for kind in limits.kinds if kind not in MOTOR_KINDS]
    _check_limits(robot, limits, kinds)
    room = room_of(robot, limits, kinds)
    reaches = reaches_of(limits, series, room.order)
    if not reaches[1].any():
        raise JounceError(f"the limits of {quoted(robot.name)} let no joint move; expected room for one at least")
    middle = limits.bounds("position").mean(axis=0)
    inverse, equal = _weights(robot, limits, weights)
    told = _told(robot, terms, inverse, middle, reaches, rng)
    return Search(series, told, room, middle, reaches, 1 - left), (*notes, *equal)


def _bounded_positions(robot: Robot, reach: float) -> tuple[Limits, list[str]]:
    """The limits of the coordinates with two bounds of every position, and notes on those that were added."""
    limits, units = coordinate_limits(robot.mechanism), coordinate_units(robot.mechanism)
    lower, upper = limits.bounds("position").copy()
    bare = ~(np.isfinite(lower) & np.isfinite(upper))
    for j in np.flatnonzero(bare):
        if units[j] == "m":
            raise JounceError(
                f"prismatic joint {quoted(robot.joint_names[j])} has no range; state one with"
                " robot.with_limits(lower=..., upper=...) (--limits)"
            )
    first = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2 * reach, -reach))
    last = np.where(np.isfinite(upper), upper, first + 2 * reach)
    table = limits.table.copy()
    table[KINDS.index("position")] = first, last
    notes = [
        f"joint {quoted(robot.joint_names[j])} states no range of positions; it is kept within"
        f" {first[j]:.6g} to {last[j]:.6g} rad"
        for j in np.flatnonzero(bare)
    ]
    return replace(limits, table=table), notes


def _check_limits(robot: Robot, limits: Limits, kinds: list[str]) -> None:
    """Raise `JounceError` where nothing limits how fast a robot moves, or a force has no room on one side."""
    if kinds == [MOTION_KINDS[0]]:
        raise JounceError(
            f"{quoted(robot.name)} states no limit of a rate or a force, and an excitation would go as far as it can;"
            " state some with robot.with_limits(velocity=..., effort=...) (--limits)"
        )
    for kind in kinds:
        zero = (limits.bounds(kind) == 0).any(axis=0)
        if kind not in MOTION_KINDS and zero.any():
            joint = quoted(robot.joint_names[int(zero.argmax())])
            raise JounceError(f"a limit of {kind} of joint {joint} is 0; expected room on both sides of 0")


def _weights(robot: Robot, limits: Limits, given: ArrayLike | None) -> tuple[np.ndarray, list[str]]:
    """The weights (n,) of the forces, and a note where efforts do not give them."""
    if given is None:
        effort = np.abs(limits.bounds("effort")).max(axis=0)
        if np.isfinite(effort).all():
            return 1 / effort**2, []
        return np.ones(robot.n), ["not every joint states an effort limit: forces have equal weights"]
    weights = np.asarray(asarray(given, "weights"))
    if weights.dtype.kind != "f" or weights.shape != (robot.n,):
        raise JounceError(f"weights have shape {weights.shape}; expected numbers ({robot.n},), one per coordinate")
    if not (np.isfinite(weights).all() and (weights >= 0).all() and weights.any()):
        worst = weights[~((weights >= 0) & np.isfinite(weights))]
        came = f"a weight is {worst[0]:g}" if worst.size else "all weights are 0"
        raise JounceError(f"{came}; expected inverse variances: 0, which leaves a force out, or more")
    return weights.astype(float), []


def _told(
    robot: Robot,
    terms: tuple[DriveColumn, ...],
    weights: np.ndarray,
    middle: np.ndarray,
    reaches: np.ndarray,
    rng: np.random.Generator,
) -> Information:
    """The information of motions that go as far as the limits let them."""
    count = TYPICAL * (10 * len(robot.body_names) + len(terms) * robot.mechanism.nb) // robot.n + 1
    states = rng.uniform(-1, 1, (3, count, robot.n)) * reaches[:3, None]
    states[0] = middle + np.where(reaches[1] > 0, states[0], states[0, 0])  # a joint that stands still, anywhere
    found = information(robot, terms, weights, tuple(states))
    if not found.names:
        raise JounceError(f"no parameter of {quoted(robot.name)} enters the forces of joints that move")
    return found


def _within(search: Search, x: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, Motion, Check]:
    """A series drawn to a pose at rest as far as limits between its points need it, with its motion and the check."""
    robot, centre, size = search.information.robot, np.zeros_like(x), 1.0
    centre[0] = rest
    for i in range(DRAWN):
        near = centre + size * (x - centre)
        motion = search.series.motion(near, robot.joint_names)
        found = robot.check(motion.with_step(search.series.step))
        if found.worst.ratio <= search.share:
            return near, motion, found
        size *= 1 - max(1 - search.share / found.worst.ratio, min(LEAST * 2**i, 0.5))
    raise JounceError(f"no excitation is found within the limits; the nearest one has {found.worst}")


def _number(name: str, given: object, unit: str) -> float:
    if not is_finite(given) or not given > 0:  # type: ignore[operator]
        raise JounceError(f"{name} is {quoted(given)}; expected a number of {unit} > 0")
    return float(given)  # type: ignore[arg-type]


def _whole(name: str, given: object, least: int, most: int | None = None) -> int:
    if isinstance(given, bool) or not isinstance(given, int | np.integer) or not least <= given <= (most or given):
        raise JounceError(f"{name} is {quoted(given)}; expected {least}{f' to {most}' if most else ' or more'}")
    return int(given)
