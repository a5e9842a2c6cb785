"""Find the motion within limits whose forces determine parameters best.

`excite` is the door, and `ExcitationOptions` are what a caller states. `prepare_search` makes the search of them:
ranges of all positions, weights of forces, the parameters that motions as wide as the limits separate.
`ExcitationSearch` finds a series that may exceed limits between its points; `_shrink_into_limits` draws it to a pose at
rest until the check of limits, which sees all times, finds it within them. An `Excitation` holds that motion and its
check.
"""

from dataclasses import dataclass, field, replace
from math import pi

import numpy as np

from jounce.core import scalars
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.typing import ArrayLike, DriveTerm, DriveTerms
from jounce.engine.engine import Engine
from jounce.identification.excitation_search import (
    MIN_HARMONICS,
    ExcitationSearch,
    Harmonics,
    Progress,
    build_barrier,
    build_information,
    motion_reaches,
)
from jounce.limits.check import check
from jounce.limits.verdicts import Check, CheckedLimit
from jounce.model import body_parameters, coordinates, drive_trains, positions
from jounce.model.limits import LIMIT_KINDS, Limits
from jounce.model.transmissions import describe_followers
from jounce.motion import Motion

MAX_HARMONICS = 50  # more are slips of the pen
MAX_REPETITIONS = 1000  # of starts, and of periods: likewise
MAX_CONDITION = 1e5  # of W^(1/2) Y: beyond it the data do not separate the parameters
MAX_SHRINK_STEPS = 30  # towards a pose at rest, until a motion is within the limits between its points too
MIN_SHRINKAGE = 1e-4  # of the size, in the first step; it doubles from step to step
TYPICAL_ROWS_PER_COLUMN = 4  # of the regressor of random states, so that only dependent columns depend in these


@dataclass(frozen=True, repr=False)
class Excitation:
    """A motion that excites the parameters of a robot. `Robot.excite` makes one.

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
        The base parameters and drive terms that forces along the motion determine.
    unseen : tuple of str
        Those that no motion of this robot separates from them.
    check : Check
        Every limit along the motion, between samples too.
    notes : tuple of str
        What was assumed, in words.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(lower=-2, upper=2, velocity=3, effort=[60, 20])
    >>> found = robot.excite(period=4, harmonics=4, starts=2)
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
        size = f"{len(self.parameters)} parameters, condition {self.condition:.4g}"
        return f"<Excitation: {self.motion.duration:g} s, {size}; worst: {self.check.worst}>"

    @property
    def limits(self) -> tuple[CheckedLimit, ...]:
        """The limit of each kind that the motion uses most."""
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
            f"{len(self.parameters)} parameters seen, unseen: {join_names(self.unseen) or '-'}",
            f"log det of the information matrix {self.criterion:.6g}, condition number {self.condition:.4g}",
            *self.notes,
            "",
            *("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows),
        ])  # fmt: skip


@dataclass(frozen=True, eq=False)
class ExcitationOptions:
    """The options of `Robot.excite`, checked where they need no robot."""

    period: float = 10.0
    periods: int = 1
    harmonics: int = 5
    drives: DriveTerms = False
    weights: ArrayLike | None = None  # checked with the limits, which give them by default
    reach: float = pi
    margin: float = 0.01
    payload: bool | str = False
    starts: int = 5
    seed: int = 0
    terms: tuple[DriveTerm, ...] = field(init=False)  # the drive terms that are determined too

    def __post_init__(self) -> None:
        check_whole_number("starts", self.starts, 1, MAX_REPETITIONS)
        check_whole_number("seed", self.seed, 0)
        check_number("period", self.period, "s")
        check_whole_number("periods", self.periods, 1, MAX_REPETITIONS)
        check_whole_number("harmonics", self.harmonics, MIN_HARMONICS, MAX_HARMONICS)
        check_number("reach", self.reach, "rad")
        if not scalars.is_finite(self.margin) or not 0 <= self.margin < 1:
            raise JounceError(f"margin is {quote_value(self.margin)}; expected a share of the limits, 0 <= margin < 1")
        object.__setattr__(self, "terms", drive_trains.select_terms(self.drives, drive_trains.DRIVE_TERMS))

    @property
    def series(self) -> Harmonics:
        """The series whose amplitudes are sought."""
        return Harmonics(float(self.period), int(self.periods), int(self.harmonics))


def excite(robot: Engine, options: ExcitationOptions, progress: Progress | None = None) -> Excitation:
    """Find the motion that excites a robot within its limits, see `Robot.excite`."""
    # One generator serves typical states, the pose at rest and the starts, in this order: a seed gives one motion.
    rng = np.random.default_rng(int(options.seed))
    search, notes = prepare_search(robot, options, rng)
    rest = search.find_rest(rng)
    best = search.find_best(int(options.starts), rng, progress)
    x, motion, limit_check = _shrink_into_limits(search, best, rest)
    # The criterion and the condition are those of the motion as it was shrunk.
    rates, information = search.rates(x), search.information
    condition = information.condition(rates)
    if not condition <= MAX_CONDITION:
        cure = f"expected a longer period, more than {options.harmonics} harmonics, or wider limits"
        came = f"{len(information.names)} parameters (condition number {condition:.2g})"
        raise JounceError(f"the motion does not separate the {came}; {cure}")
    names, unseen = information.names, information.unseen
    return Excitation(motion, information.log_det(rates), condition, names, unseen, limit_check, notes)


def _shrink_into_limits(search: ExcitationSearch, x: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, Motion, Check]:
    """Draw a series to a pose at rest until limits hold.

    Returns its amplitudes, its motion, and the check of the limits.
    """
    robot, centre, size = search.information.robot, np.zeros_like(x), 1.0
    centre[0] = rest
    # Limits hold at rest, so that some share of the series does too: it shrinks by the excess, and faster and faster.
    for i in range(MAX_SHRINK_STEPS):
        shrunk = centre + size * (x - centre)
        motion = search.series.motion(shrunk, robot.joint_names)
        limit_check = check(robot, motion.with_step(search.series.step))
        if limit_check.worst.ratio <= search.share:
            return shrunk, motion, limit_check
        size *= 1 - max(1 - search.share / limit_check.worst.ratio, min(MIN_SHRINKAGE * 2**i, 0.5))
    raise JounceError(f"no excitation is found within the limits; the nearest one has {limit_check.worst}")


# The search that options of a caller make.
def prepare_search(
    robot: Engine, options: ExcitationOptions, rng: np.random.Generator
) -> tuple[ExcitationSearch, tuple[str, ...]]:
    """Prepare the search that options ask for, with notes on assumptions."""
    load = None
    if options.payload is not False:
        body = None if options.payload is True else options.payload
        load = body_parameters.find_load_frame(robot.mechanism, body).body
    if robot.mechanism.floats:
        fixed = Remedy("load(..., base='fixed')", "--base fixed")
        cure = f"expected one at rest, {fixed}"
        raise JounceError(f"the base of {quote_value(robot.name)} floats; {cure}")
    if robot.mechanism.closure:
        has, cure = "loops that are closed", ""
        if len(robot.mechanism.loops) == 0:
            has, cure = describe_followers(robot.mechanism)
        raise JounceError(
            f"{quote_value(robot.name)} has {has}; expected a robot without: excite() is of its joints{cure}"
        )
    positions.check_single_screws(robot.mechanism, "excite()")
    # Limits that the barrier takes: those of positions always, as positions without bounds get some.
    limits, position_notes = _bounded_positions(robot, float(options.reach))
    # Sums over all joints are left to the check of the result, which is made as small as they need.
    kinds = [kind for kind in limits.kinds if kind not in (*LIMIT_KINDS.motor, *LIMIT_KINDS.totals)]
    _check_limits(robot, limits, kinds)
    barrier = build_barrier(robot, limits, kinds)
    # How far q and its rates may go: (order + 1, n), about the middle of the range.
    reaches = motion_reaches(limits, options.series, barrier.order)
    if not reaches[1].any():
        raise JounceError(f"the limits of {quote_value(robot.name)} let no joint move; expected room for one at least")
    middle = limits.bounds("position").mean(axis=0)
    # The parameters that motions as wide as this separate.
    weights, weight_notes = _weights(robot, limits, options.weights)
    states = _typical_states(robot, options.terms, middle, reaches, rng)
    information = build_information(robot, options.terms, weights, states, load)
    if len(information.names) == 0:
        raise JounceError(f"no parameter of {quote_value(robot.name)} enters the forces of joints that move")
    share = 1 - float(options.margin)
    search = ExcitationSearch(options.series, information, barrier, middle, reaches, share)
    return search, (*position_notes, *weight_notes)


def _bounded_positions(robot: Engine, reach: float) -> tuple[Limits, list[str]]:
    """Return limits that bound every position, and notes on added bounds."""
    limits, units = coordinates.limits(robot.mechanism), coordinates.units(robot.mechanism)
    lower, upper = limits.bounds("position").copy()
    bare = ~(np.isfinite(lower) & np.isfinite(upper))
    # A rail may be of any length: no range of it can be assumed.
    for j in np.flatnonzero(bare):
        if units[j] == "m":
            cure = f"state one with {Remedy('robot.with_limits(lower=..., upper=...)', '--limits FILE')}"
            raise JounceError(f"prismatic joint {quote_value(robot.joint_names[j])} has no range; {cure}")
    # The range is 2 reach wide: from the only bound, or about 0.
    first = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - 2 * reach, -reach))
    last = np.where(np.isfinite(upper), upper, first + 2 * reach)
    table = limits.table.copy()
    table[[*LIMIT_KINDS].index("position")] = first, last
    notes = [
        f"joint {quote_value(robot.joint_names[j])} states no range of positions; it is kept within"
        f" {first[j]:.6g} to {last[j]:.6g} rad"
        for j in np.flatnonzero(bare)
    ]
    return replace(limits, table=table), notes


def _check_limits(robot: Engine, limits: Limits, kinds: list[str]) -> None:
    """Raise `JounceError` for missing limits, or bounds of forces of 0."""
    if kinds == [LIMIT_KINDS.motion[0]]:
        came = "states no limit of a rate or a force, and an excitation would go as far as it can"
        cure = f"state some with {Remedy('robot.with_limits(velocity=..., effort=...)', '--limits FILE')}"
        raise JounceError(f"{quote_value(robot.name)} {came}; {cure}")
    # A rate may be bounded by 0, which holds a joint still; the barrier of a force has no inside then.
    for kind in kinds:
        zero = (limits.bounds(kind) == 0).any(axis=0)
        if kind not in LIMIT_KINDS.motion and zero.any():
            joint = quote_value(robot.joint_names[int(zero.argmax())])
            way = Remedy(f"robot.with_limits({kind}=...)", "--limits FILE")
            cure = f"expected room on both sides of 0: state another with {way}"
            raise JounceError(f"a limit of {kind} of joint {joint} is 0; {cure}")


def _weights(robot: Engine, limits: Limits, given: ArrayLike | None) -> tuple[np.ndarray, list[str]]:
    """Return the weights (n,) of forces, with a note on equal ones."""
    # Sensors are as good as their ranges are large: inverse squares of the efforts.
    if given is None:
        effort = np.abs(limits.bounds("effort")).max(axis=0)
        if np.isfinite(effort).all():
            return 1 / effort**2, []
        return np.ones(robot.n), ["not every joint states an effort limit: forces have equal weights"]
    weights = np.asarray(scalars.asarray(given, "weights"))
    if weights.dtype.kind != "f" or weights.shape != (robot.n,):
        raise JounceError(f"weights have shape {weights.shape}; expected numbers ({robot.n},), one per coordinate")
    if not (np.isfinite(weights).all() and (weights >= 0).all() and weights.any()):
        worst = weights[~((weights >= 0) & np.isfinite(weights))]
        came = f"a weight is {worst[0]:g}" if worst.size > 0 else "all weights are 0"
        raise JounceError(f"{came}; expected inverse variances: 0, which leaves a force out, or more")
    return weights.astype(float), []


def _typical_states(
    robot: Engine, terms: tuple[DriveTerm, ...], middle: np.ndarray, reaches: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, ...]:
    """Return random states of motions as wide as the limits: q, qd, q2d (M, n)."""
    columns = 10 * len(robot.body_names) + len(terms) * len(robot.mechanism.joints)
    count = TYPICAL_ROWS_PER_COLUMN * columns // robot.n + 1
    states = rng.uniform(-1, 1, (3, count, robot.n)) * reaches[:3, None]
    # A joint that stands still does so at one position, which may be anywhere.
    states[0] = middle + np.where(reaches[1] > 0, states[0], states[0, 0])
    return tuple(states)


def check_number(name: str, value: object, unit: str) -> None:
    """Raise `JounceError` unless a value is a positive number, in a unit."""
    if not scalars.is_finite(value) or not value > 0:  # type: ignore[operator]
        raise JounceError(f"{name} is {quote_value(value)}; expected a number of {unit} > 0")


def check_whole_number(name: str, value: object, least: int, most: int | None = None) -> None:
    """Raise `JounceError` unless a value is a whole number within bounds."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or value < least or (most is not None and value > most):  # type: ignore[operator]
        expected = f"{least} or more" if most is None else f"{least} to {most}"
        raise JounceError(f"{name} is {quote_value(value)}; expected {expected}")
