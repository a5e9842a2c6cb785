"""Factors of speed are tried where limits are no polynomials of them: of commands and of measured motions.

Commands stand at other places of the path at every speed, so that their differences are no polynomials of the factor.
`CommandSpeeds` tries factors, down from 1 until one keeps every limit (`fall`), or up from 1 until one breaks a limit
(`rise`); bisection follows between the last two. Every factor that is returned was itself judged. Those below it were
not: differences of order m of positions are means of m-th derivatives and fall with the speed, torque rates may rise
where gravity and inertia cancel. Of measured motions two standard deviations lie between values and their bounds.

Measured motions: `find_sure_factor` finds the largest c at which every value is within its bound by two standard
deviations, as `judge_values` asks for it. Rates and their deviations fall with powers of c, forces at rest do not.
Values at some times bracket c, by factors of two, and bisection follows. A judgement along all the motion at this c
yields the times at which limits are not surely kept, and these are added until no more appear: an exchange method, as
in `slowdown`, whose costly step is taken two or three times.

A limit that is not surely kept even at a thousandth of the speed, such as that of a position at its bound, is
undecided at every speed: it may not be surely broken, and all others are surely kept.

`JounceError` where a limit is broken at rest already, or surely broken at every speed, and where no factor down to a
thousandth keeps every limit.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.engine.engine import Engine
from jounce.limits.check import SAMPLES_CAUSE, check, without_doubts
from jounce.limits.commands import JudgedCommands, take_differences, take_rest
from jounce.limits.feasible_factors import Place, refuse_static
from jounce.limits.limited_motion import Deviations, LimitedMotion, compute_deviations, is_measured, validate_limits
from jounce.limits.ratios import SIGNS
from jounce.limits.verdicts import Check
from jounce.limits.worst_values import DECISIVE_DEVIATIONS, sample_values, take_sides
from jounce.motion import commands
from jounce.motion.motion import Motion

KEPT_RATIO = 1 - 1e-6  # to every limit: rounded times and positions of a table move third differences by less
_FACTOR_STEP = 1.05  # from one factor that is tried to the next
_MIN_FACTOR, _MAX_FACTOR = 1e-3, 1000.0  # times the given speed: no motion is meant to be slower or faster
_MAX_SLOWED_COMMANDS = 2e6  # of a motion that is slowed down, which bounds time and memory
_BISECTIONS = 24  # between two factors: to 3e-9 of them, far below what a margin of 1e-6 asks for
Limit = tuple[str, int]  # kind and joint


@dataclass(frozen=True, eq=False)
class CommandSpeeds:
    """A plan of a robot that a controller samples at `rate`, Hz, and takes differences of up to an order.

    `own` is whether the plan consists of commands, and the rate is theirs.
    """

    robot: Engine
    motion: Motion
    rate: float
    differences: int
    own: bool = False

    def at_speed(self, factor: float) -> Motion:
        """The plan at a factor of its speed: as commands, if it consists of these."""
        slow = self.motion.scaled(1 / factor)
        return slow.sampled(self.rate, self.differences) if self.own else slow

    def sampled(self, factor: float = 1.0) -> Motion:
        """The commands at a factor of the speed."""
        scaled = self.motion if factor == 1 else self.motion.scaled(1 / factor)
        return scaled.sampled(self.rate, self.differences)

    def check(self) -> Check:
        """Every limit of the commands."""
        return check(self.robot, self.sampled())

    def keeps(self) -> bool:
        """Whether the plan at its own speed keeps every limit that a speed decides."""
        return self._judge(1.0)[0] <= KEPT_RATIO

    def fall(self) -> tuple[float, Place]:
        """The largest factor below 1, of those tried, that keeps every limit, and the limit that a larger one breaks.

        The plan at its own speed breaks a limit.
        """
        given = self._take_differences(1.0)
        refuse_static(given.b, {kind: value[None] for kind, value in take_rest(given).items()}, given.q.times[1:])
        fewest = (len(given.q.times) - 1) / _MAX_SLOWED_COMMANDS
        high, (ratio, place) = 1.0, self._find_worst(given, 1.0)
        while True:
            # A value falls at most with the power of the speed that its order is: no factor between is passed over.
            low = high * min(1 / _FACTOR_STEP, ratio ** (-1 / commands.MAX_DIFFERENCES))
            if low < max(_MIN_FACTOR, fewest):
                raise self._stuck_error(place, high)
            ratio, where = self._judge(low)
            if ratio <= KEPT_RATIO:
                return self._bisect(low, high, place)
            high, place = low, where

    def rise(self) -> tuple[float, Place | None]:
        """The largest factor up to which those tried from 1 on keep every limit, and the limit that the next breaks.

        Infinite where none breaks a limit, as long as there are commands enough for a controller.
        """
        low, most = 1.0, min(_MAX_FACTOR, self.motion.duration * self.rate / commands.MIN_COMMANDS)
        while low * _FACTOR_STEP <= most:
            ratio, place = self._judge(low * _FACTOR_STEP)
            if ratio > KEPT_RATIO:
                return self._bisect(low, low * _FACTOR_STEP, place)
            low *= _FACTOR_STEP
        return np.inf, None

    def _bisect(self, low: float, high: float, place: Place) -> tuple[float, Place]:
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            ratio, where = self._judge(middle)
            if ratio <= KEPT_RATIO:
                low = middle
            else:
                high, place = middle, where
        return low, place

    def _judge(self, factor: float) -> tuple[float, Place]:
        return self._find_worst(self._take_differences(factor), factor)

    def _take_differences(self, factor: float) -> JudgedCommands:
        found = take_differences(without_doubts(validate_limits(self.robot, self.sampled(factor))))
        assert found is not None  # they are commands
        return found

    def _find_worst(self, found: JudgedCommands, factor: float) -> tuple[float, Place]:
        """The largest ratio to a limit that depends on the speed, and of which kind and joint, and when in the plan."""
        ratios, times = [(-np.inf, ("position", 0, self.motion.start))], found.q.times[1:]
        off = compute_deviations(found.b, times.clip(*found.b.whole))
        for kind, channel in found.limited.items():
            for sign in SIGNS if kind != "position" else ():
                widened = channel.values + widen(kind, sign, off, self._open_limits, len(channel.names))
                ratio = found.b.scales[kind].ratio(widened, sign)
                i, j = np.unravel_index(ratio.argmax(), ratio.shape)
                t = self.motion.start + (float(times[i]) - self.motion.start) * factor
                ratios.append((float(ratio[i, j]), (kind, int(j), min(t, self.motion.stop))))
        return max(ratios)

    @cached_property
    def _open_limits(self) -> frozenset[Limit]:
        """The limits of a measured plan that are undecided at every speed."""
        if not is_measured(self.motion):
            return frozenset()
        return find_open_limits(without_doubts(validate_limits(self.robot, self.motion)), self.motion.times)

    def _stuck_error(self, place: Place, factor: float) -> JounceError:
        kind, j, t = place
        name = quote_value(validate_limits(self.robot, self.motion).name(kind, j))
        return JounceError(
            f"at {self.rate:g} Hz the {kind.replace('_', ' ')} of joint {name} is beyond its limit at t = {t:.6g} s"
            f" even at {factor:.2g} times the speed; change the motion, as"
            f" {Remedy('motion.blended(time)', '--blend')} does, or"
            f" {Remedy('with_limits', '--limits')}"
        )


def find_command_speeds(robot: Engine, motion: Motion, rate: float | None, differences: int) -> CommandSpeeds | None:
    """A plan at a rate, or commands at their own; None for a plan without a rate, whose derivatives limits bound."""
    sampled = commands.find_commands(motion.curve)
    if rate is not None:
        return CommandSpeeds(robot, motion, rate, differences)
    if sampled is None:
        return None
    return CommandSpeeds(robot, motion, sampled.rate, sampled.differences, own=True)


# Factors at which a measured motion surely keeps its limits.
_FIRST_SURE_TIMES = 200  # that bracket the factor first: those of the peaks follow
_SURE_BISECTIONS = 20  # of a factor between its half and itself: to 1e-6 of it
_FACTOR_MARGIN = 1e-6  # of a factor, far below its deviation: peaks lie elsewhere at every speed
_MAX_SURE_ROUNDS = 20  # of times that are added: logs take two or three


class SureFactor(NamedTuple):
    """The largest factor, infinite if nothing bounds the speed, and the first limit that a larger one leaves open."""

    factor: float
    place: Place | None


@dataclass(frozen=True)
class _Excess:
    """How far a value with its deviations is beyond a bound, in shares of it, and when in the given motion."""

    share: float
    t: float


def find_sure_factor(b: LimitedMotion) -> SureFactor:
    """The largest factor of those tried at which every limit that a speed decides is surely kept."""
    times = b.motion.times
    t = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), _FIRST_SURE_TIMES)).astype(int))]
    high = 1.0
    for _ in range(_MAX_SURE_ROUNDS):
        still = find_open_limits(b, t)
        factor, place = _bracket(b, t, still, high)
        beyond = _select_beyond(find_excess(b, factor, still=still))
        if not beyond:
            return SureFactor(np.inf if factor >= _MAX_FACTOR else factor, place)
        t, high = np.union1d(t, [found.t for found in beyond.values()]), factor
    raise JounceError(
        f"no factor of speed down to {factor:.3g} surely keeps the limits; samples with less noise, or with_limits"
    )


def find_open_limits(b: LimitedMotion, t: np.ndarray) -> frozenset[Limit]:
    """The limits that are undecided at every speed at some of the times (N,).

    Raises where one is surely broken at every speed.
    """
    open_limits = frozenset(_select_beyond(find_excess(b, _MIN_FACTOR, t)))
    if broken := _select_beyond(find_excess(b, _MIN_FACTOR, t, open_limits)):
        (kind, j), found = next(iter(broken.items()))
        what = f"the {kind.replace('_', ' ')} of joint {quote_value(b.name(kind, j))}"
        raise JounceError(
            f"{what} is beyond its limit by more than two standard deviations at t = {found.t:.6g} s, at every speed;"
            " change the motion or with_limits"
        )
    return open_limits


def widen(kind: str, sign: int, off: Deviations, still: Collection[Limit], joints: int) -> np.ndarray:
    """What is added to values (N, joints) of a kind before they are compared: two deviations towards the bound.

    Away from it for limits that are `still` undecided at every speed.
    """
    ways = np.array([-sign if (kind, j) in still else sign for j in range(joints)])
    return np.asarray(ways * DECISIVE_DEVIATIONS * off.get(kind, np.zeros((1, joints))))


def find_excess(
    b: LimitedMotion, factor: float, t: np.ndarray | None = None, still: Collection[Limit] = ()
) -> Mapping[Limit, _Excess]:
    """The largest excess of each limit at a factor of speed, along all the motion or at times (N,) in the given one."""
    scaled, found = b.scaled(1 / factor), dict[Limit, _Excess]()
    parts: Iterable[tuple[np.ndarray, Mapping[str, np.ndarray]]]
    parts = sample_values(scaled) if t is None else take_sides(scaled, b.motion.start + (t - b.motion.start) / factor)
    for at, values in parts:
        off = compute_deviations(scaled, at.clip(*scaled.whole))
        for kind in scaled.kinds:
            for sign in SIGNS:
                shares = _shares_beyond(scaled, kind, sign, values[kind], off, still)
                worst = shares.argmax(axis=0)
                for j in np.flatnonzero(np.isfinite(scaled.scales[kind].bound(sign))).tolist():
                    share = float(shares[worst[j], j])
                    if share > found.get((kind, j), _Excess(-np.inf, 0)).share:
                        found[kind, j] = _Excess(share, float(b.given_times(at[worst[j]], factor)))
    return found


def _shares_beyond(
    b: LimitedMotion, kind: str, sign: int, values: np.ndarray, off: Deviations, still: Collection[Limit]
) -> np.ndarray:
    """(N, joints): how far values with their deviations are beyond the bounds, in shares of these; above 0 if so."""
    scale = b.scales[kind]
    excess = sign * (values + widen(kind, sign, off, still, len(b.joints))) - scale.tolerant(sign)
    unknown = [-np.inf if (kind, j) in still else np.inf for j in range(len(b.joints))]
    reach = np.abs(scale.reach(sign))  # infinite where nothing bounds a joint
    of = np.where((reach > 0) & np.isfinite(reach), reach, 1.0)
    return np.asarray(np.where(np.isnan(excess), unknown, excess) / of)


def _select_beyond(excess: Mapping[Limit, _Excess]) -> dict[Limit, _Excess]:
    """Those above 0, the largest one first."""
    found = sorted(excess.items(), key=lambda item: -item[1].share)
    return {limit: of for limit, of in found if of.share > 0}


def _bracket(b: LimitedMotion, t: np.ndarray, still: frozenset[Limit], high: float) -> tuple[float, Place | None]:
    """The largest factor at which values at times (N,) surely keep limits, and the limit that a larger one leaves."""
    beyond = _select_beyond(find_excess(b, high, t, still))
    # Rise until a limit is not surely kept, or fall until all are.
    low = high
    while not beyond and high < _MAX_FACTOR:
        low, high = high, min(2 * high, _MAX_FACTOR)
        beyond = _select_beyond(find_excess(b, high, t, still))
    if not beyond:
        return high, None
    while low == high or _select_beyond(find_excess(b, low, t, still)):
        high, low = low, low / 2
    beyond = _select_beyond(find_excess(b, high, t, still)) or beyond
    for _ in range(_SURE_BISECTIONS):
        middle = (low + high) / 2
        found = _select_beyond(find_excess(b, middle, t, still))
        low, high, beyond = (low, middle, found) if found else (middle, high, beyond)
    (kind, j), worst = next(iter(beyond.items()))
    return low * (1 - _FACTOR_MARGIN), (kind, j, worst.t)


def describe_open_limits(found: Check) -> tuple[str, ...]:
    """Which limits a motion that was made slower or retimed still leaves undecided for its samples, or breaks."""
    rows = [row for row in found.table if row.violations or (row.undecided and row.cause == SAMPLES_CAUSE)]
    names = []
    for row in rows:
        start, stop = (row.violations or row.undecided)[0]
        what = f"{row.limit.replace('_', ' ')} of {row.joint} at t = {start:.6g} to {stop:.6g} s of the result"
        names.append(f"{what} is {row.verdict}")
    return (f"not every limit is surely kept: {join_names(names)}",) if names else ()
