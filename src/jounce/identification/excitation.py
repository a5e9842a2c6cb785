"""Find the motion within all limits whose forces determine a robot's parameters best.

`excite` is the door. `prepare_search` checks what a caller gives and makes the search of it: ranges of all positions,
weights of forces, the parameters that motions as wide as the limits separate. `ExcitationSearch` finds a series that
may exceed limits between its points; `_shrink_into_limits` draws it to a pose at rest until the check of limits, which
sees all times, finds it within them. An `Excitation` holds that motion and its check.
"""

from dataclasses import dataclass, replace

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
    Information,
    Progress,
    build_barrier,
    build_information,
    motion_reaches,
)
from jounce.limits.check import check
from jounce.limits.verdicts import Check, CheckedLimit
from jounce.model import body_parameters, coordinates, drive_trains, positions
from jounce.model.limits import LIMIT_KINDS, Limits
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
            f"{len(self.parameters)} parameters seen, unseen: {join_names(self.unseen) or '-'}",
            f"log det of the information matrix {self.criterion:.6g}, condition number {self.condition:.4g}",
            *self.notes,
            "",
            *("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows),
        ])  # fmt: skip


def excite(
    robot: Engine,
    period: float,
    periods: int,
    harmonics: int,
    drives: DriveTerms,
    weights: ArrayLike | None,
    reach: float,
    margin: float,
    payload: bool | str,
    starts: int,
    seed: int,
    progress: Progress | None,
) -> Excitation:
    """Find the motion that excites a robot within its limits, see `Robot.excite`."""
    count, rng = (
        check_whole_number("starts", starts, 1, MAX_REPETITIONS),
        np.random.default_rng(check_whole_number("seed", seed, 0)),
    )
    times = check_number("period", period, "s"), check_whole_number("periods", periods, 1, MAX_REPETITIONS)
    series = Harmonics(*times, check_whole_number("harmonics", harmonics, MIN_HARMONICS, MAX_HARMONICS))
    load = None
    if payload is not False:
        load = body_parameters.find_load_frame(robot.mechanism, None if payload is True else payload).body
    search, notes = prepare_search(
        robot, series, drive_trains.select_terms(drives, drive_trains.DRIVE_TERMS), weights, reach, margin, rng, load
    )
    rest = search.find_rest(rng)
    x, motion, found = _shrink_into_limits(search, search.find_best(count, rng, progress), rest)
    rates, information = search.rates(x), search.information
    condition = information.condition(rates)
    if not condition <= MAX_CONDITION:
        cure = f"expected a longer period, more than {harmonics} harmonics, or wider limits"
        came = f"{len(information.names)} parameters (condition number {condition:.2g})"
        raise JounceError(f"the motion does not separate the {came}; {cure}")
    names, unseen = information.names, information.unseen
    return Excitation(motion, information.log_det(rates), condition, names, unseen, found, notes)


def _shrink_into_limits(search: ExcitationSearch, x: np.ndarray, rest: np.ndarray) -> tuple[np.ndarray, Motion, Check]:
    """A series drawn to a pose at rest as far as limits between its points need it, with its motion and the check."""
    robot, centre, size = search.information.robot, np.zeros_like(x), 1.0
    centre[0] = rest
    # limits hold at rest, so that some share of the series does too: it shrinks by the excess, and faster and faster
    for i in range(MAX_SHRINK_STEPS):
        near = centre + size * (x - centre)
        motion = search.series.motion(near, robot.joint_names)
        found = check(robot, motion.with_step(search.series.step))
        if found.worst.ratio <= search.share:
            return near, motion, found
        size *= 1 - max(1 - search.share / found.worst.ratio, min(MIN_SHRINKAGE * 2**i, 0.5))
    raise JounceError(f"no excitation is found within the limits; the nearest one has {found.worst}")


# What a caller states, checked, and the search that it makes.
def prepare_search(
    robot: Engine,
    series: Harmonics,
    terms: tuple[DriveTerm, ...],
    weights: ArrayLike | None,
    reach: object,
    margin: object,
    rng: np.random.Generator,
    load: int | None = None,
) -> tuple[ExcitationSearch, tuple[str, ...]]:
    """The search for the arguments of a caller, checked, and notes on what is assumed."""
    if robot.mechanism.floats:
        fixed = Remedy("load(..., base='fixed')", "--base fixed")
        cure = f"expected one at rest, {fixed}"
        raise JounceError(f"the base of {quote_value(robot.name)} floats; {cure}")
    left = float(margin) if scalars.is_finite(margin) else -1.0  # type: ignore[arg-type]
    if not 0 <= left < 1:
        raise JounceError(f"margin is {quote_value(margin)}; expected a share of the limits, 0 <= margin < 1")
    if robot.mechanism.closure:
        has = "loops that are closed" if robot.mechanism.loops else "motors that move joints together"
        raise JounceError(f"{quote_value(robot.name)} has {has}; expected a robot without: excite() is of its joints")
    positions.check_single_screws(robot.mechanism, "excite()")
    limits, notes = _bounded_positions(robot, check_number("reach", reach, "rad"))
    kinds = [kind for kind in limits.kinds if not LIMIT_KINDS[kind].takes]
    _check_limits(robot, limits, kinds)
    room = build_barrier(robot, limits, kinds)
    reaches = motion_reaches(limits, series, room.order)
    if not reaches[1].any():
        raise JounceError(f"the limits of {quote_value(robot.name)} let no joint move; expected room for one at least")
    middle = limits.bounds("position").mean(axis=0)
    inverse, equal = _weights(robot, limits, weights)
    information = _information(robot, terms, inverse, middle, reaches, load, rng)
    return ExcitationSearch(series, information, room, middle, reaches, 1 - left), (*notes, *equal)


def _bounded_positions(robot: Engine, reach: float) -> tuple[Limits, list[str]]:
    """The limits of the coordinates with two bounds of every position, and notes on those that were added."""
    limits, units = coordinates.limits(robot.mechanism), coordinates.units(robot.mechanism)
    lower, upper = limits.bounds("position").copy()
    bare = ~(np.isfinite(lower) & np.isfinite(upper))
    for j in np.flatnonzero(bare):
        if units[j] == "m":
            cure = f"state one with {Remedy('robot.with_limits(lower=..., upper=...)', '--limits FILE')}"
            raise JounceError(f"prismatic joint {quote_value(robot.joint_names[j])} has no range; {cure}")
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
    """Raise `JounceError` where nothing limits how fast a robot moves, or a force has no room on one side."""
    if kinds == [LIMIT_KINDS.motion[0]]:
        came = "states no limit of a rate or a force, and an excitation would go as far as it can"
        cure = f"state some with {Remedy('robot.with_limits(velocity=..., effort=...)', '--limits FILE')}"
        raise JounceError(f"{quote_value(robot.name)} {came}; {cure}")
    for kind in kinds:
        zero = (limits.bounds(kind) == 0).any(axis=0)
        if kind not in LIMIT_KINDS.motion and zero.any():
            joint = quote_value(robot.joint_names[int(zero.argmax())])
            way = Remedy(f"robot.with_limits({kind}=...)", "--limits FILE")
            cure = f"expected room on both sides of 0: state another with {way}"
            raise JounceError(f"a limit of {kind} of joint {joint} is 0; {cure}")


def _weights(robot: Engine, limits: Limits, given: ArrayLike | None) -> tuple[np.ndarray, list[str]]:
    """The weights (n,) of the forces, and a note where efforts do not give them."""
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
        came = f"a weight is {worst[0]:g}" if worst.size else "all weights are 0"
        raise JounceError(f"{came}; expected inverse variances: 0, which leaves a force out, or more")
    return weights.astype(float), []


def _information(
    robot: Engine,
    terms: tuple[DriveTerm, ...],
    weights: np.ndarray,
    middle: np.ndarray,
    reaches: np.ndarray,
    load: int | None,
    rng: np.random.Generator,
) -> Information:
    """The information of motions that go as far as the limits let them, from random states."""
    columns = 10 * len(robot.body_names) + len(terms) * len(robot.mechanism.joints)
    count = TYPICAL_ROWS_PER_COLUMN * columns // robot.n + 1
    states = rng.uniform(-1, 1, (3, count, robot.n)) * reaches[:3, None]
    states[0] = middle + np.where(reaches[1] > 0, states[0], states[0, 0])  # a joint that stands still, anywhere
    found = build_information(robot, terms, weights, tuple(states), load)
    if not found.names:
        raise JounceError(f"no parameter of {quote_value(robot.name)} enters the forces of joints that move")
    return found


def check_number(name: str, given: object, unit: str) -> float:
    """A caller's positive number in a unit."""
    if not scalars.is_finite(given) or not given > 0:  # type: ignore[operator]
        raise JounceError(f"{name} is {quote_value(given)}; expected a number of {unit} > 0")
    return float(given)  # type: ignore[arg-type]


def check_whole_number(name: str, given: object, least: int, most: int | None = None) -> int:
    """A caller's whole number from the least to the most."""
    if isinstance(given, bool) or not isinstance(given, int | np.integer) or not least <= given <= (most or given):
        raise JounceError(f"{name} is {quote_value(given)}; expected {least}{f' to {most}' if most else ' or more'}")
    return int(given)
