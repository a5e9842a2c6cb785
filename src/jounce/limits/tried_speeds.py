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
from jounce.core.errors import JounceError, join_names
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
    """A plan, as a controller samples it at factors of speed.

    The controller takes differences of up to an order at `rate`, Hz. `has_own_rate` is whether the plan consists of
    commands, and the rate is theirs.
    """

    robot: Engine
    motion: Motion
    rate: float
    differences: int
    has_own_rate: bool = False

    def at_speed(self, factor: float) -> Motion:
        """Return the plan at a factor of its speed: as commands, if it consists of these."""
        slow = self.motion.scaled(1 / factor)
        return slow.sampled(self.rate, self.differences) if self.has_own_rate else slow

    def sampled(self, factor: float = 1.0) -> Motion:
        """Return the commands at a factor of the speed."""
        scaled = self.motion if factor == 1 else self.motion.scaled(1 / factor)
        return scaled.sampled(self.rate, self.differences)

    def check(self) -> Check:
        """Check every limit of the commands."""
        return check(self.robot, self.sampled())

    def keeps(self) -> bool:
        """Whether the plan at its own speed keeps every limit.

        Limits that no speed decides do not count.
        """
        return self._judge(1.0)[0] <= KEPT_RATIO

    def fall(self) -> tuple[float, Place]:
        """Find the largest factor below 1 that keeps every limit.

        The factor is the largest one of those tried, and the limit is that which a larger one breaks. The plan at its
        own speed breaks a limit.
        """
        # This raises where a limit is broken even while the robot rests at each command.
        differences = self._take_differences(1.0)
        refuse_static(
            differences.b,
            {kind: value[None] for kind, value in take_rest(differences).items()},
            differences.q.times[1:],
        )
        # Slower plans have more commands, whose number bounds the factor.
        least_factor = max(_MIN_FACTOR, (len(differences.q.times) - 1) / _MAX_SLOWED_COMMANDS)
        high, (ratio, place) = 1.0, self._find_worst(differences, 1.0)
        while True:
            # A value falls at most with the power of the speed that its order is: no factor between is passed over.
            low = high * min(1 / _FACTOR_STEP, ratio ** (-1 / commands.MAX_DIFFERENCES))
            if low < least_factor:
                raise self._stuck_error(place, high)
            ratio, low_place = self._judge(low)
            if ratio <= KEPT_RATIO:
                return self._bisect(low, high, place)
            high, place = low, low_place

    def rise(self) -> tuple[float, Place | None]:
        """Find how far the factor can rise from 1.

        All factors tried up to the result keep every limit, and the next one breaks the limit that is returned. The
        result is infinite where none breaks a limit, as long as there are commands enough for a controller.
        """
        low, most = 1.0, min(_MAX_FACTOR, self.motion.duration * self.rate / commands.MIN_COMMANDS)
        while low * _FACTOR_STEP <= most:
            ratio, place = self._judge(low * _FACTOR_STEP)
            if ratio > KEPT_RATIO:
                return self._bisect(low, low * _FACTOR_STEP, place)
            low *= _FACTOR_STEP
        return np.inf, None

    def _bisect(self, low: float, high: float, place: Place) -> tuple[float, Place]:
        """Bisect between factors that keep and break limits.

        `low` keeps all limits, and `high` breaks the one at `place`. Returns the largest factor that keeps all, and the
        limit that is broken beyond it.
        """
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            ratio, middle_place = self._judge(middle)
            if ratio <= KEPT_RATIO:
                low = middle
            else:
                high, place = middle, middle_place
        return low, place

    def _judge(self, factor: float) -> tuple[float, Place]:
        """Return the largest ratio to a limit, and its place.

        The plan is at a factor of its speed.
        """
        return self._find_worst(self._take_differences(factor), factor)

    def _take_differences(self, factor: float) -> JudgedCommands:
        """Take the differences of the commands at a factor of the speed."""
        differences = take_differences(without_doubts(validate_limits(self.robot, self.sampled(factor))))
        assert differences is not None  # they are commands
        return differences

    def _find_worst(self, d: JudgedCommands, factor: float) -> tuple[float, Place]:
        """Find the largest ratio to a limit that depends on the speed.

        Returns it with the kind, the joint and the time in the plan.
        """
        # Where no limit depends on the speed every factor keeps them: -inf.
        ratios, times = [(-np.inf, ("position", 0, self.motion.start))], d.q.times[1:]
        off = compute_deviations(d.b, times.clip(*d.b.whole))
        for kind, channel in d.limited.items():
            for sign in SIGNS if kind != "position" else ():
                # Of measured plans a value counts with two deviations towards its bound.
                widened = channel.values + widen(kind, sign, off, self._open_limits, len(channel.names))
                ratio = d.b.scales[kind].ratio(widened, sign)
                i, j = np.unravel_index(ratio.argmax(), ratio.shape)
                # The last command is held after the end of the plan.
                t = self.motion.start + (float(times[i]) - self.motion.start) * factor
                ratios.append((float(ratio[i, j]), (kind, int(j), min(t, self.motion.stop))))
        return max(ratios)

    @cached_property
    def _open_limits(self) -> frozenset[Limit]:
        """Return the limits of the plan that are open at every speed.

        Only a measured plan has such limits.
        """
        if not is_measured(self.motion):
            return frozenset()
        return find_open_limits(without_doubts(validate_limits(self.robot, self.motion)), self.motion.times)

    def _stuck_error(self, place: Place, factor: float) -> JounceError:
        """Return the error where no factor that is tried keeps a limit."""
        kind, j, t = place
        owner = validate_limits(self.robot, self.motion).owner(kind, j)
        return JounceError(
            f"at {self.rate:g} Hz the {kind.replace('_', ' ')} of {owner} is beyond its limit at t = {t:.6g} s"
            f" even at {factor:.2g} times the speed; change the motion, as"
            f" {Remedy('motion.blended(time)', '--blend')} does, or"
            f" {Remedy('with_limits', '--limits')}"
        )


def find_command_speeds(robot: Engine, motion: Motion, rate: float | None, differences: int) -> CommandSpeeds | None:
    """Return a plan at a rate, or commands at their own rate.

    Returns None for a plan without a rate, whose derivatives limits bound.
    """
    sampled = commands.find_commands(motion.curve)
    if rate is not None:
        return CommandSpeeds(robot, motion, rate, differences)
    if sampled is None:
        return None
    return CommandSpeeds(robot, motion, sampled.rate, sampled.differences, has_own_rate=True)


# Factors at which a measured motion surely keeps its limits.
_FIRST_SURE_TIMES = 200  # that bracket the factor first: those of the peaks follow
_SURE_BISECTIONS = 20  # of a factor between its half and itself: to 1e-6 of it
_FACTOR_MARGIN = 1e-6  # of a factor, far below its deviation: peaks lie elsewhere at every speed
_MAX_SURE_ROUNDS = 20  # of times that are added: logs take two or three


class SureFactor(NamedTuple):
    """The largest factor, and the limit that bounds it.

    A larger factor leaves this limit open first. The factor is infinite if nothing bounds the speed.
    """

    factor: float
    place: Place | None


@dataclass(frozen=True)
class _Excess:
    """How far a value is beyond a bound, in shares.

    The value counts with its deviations. `t` is the time in the given motion.
    """

    share: float
    t: float


def find_sure_factor(b: LimitedMotion) -> SureFactor:
    """Find the largest factor at which limits are surely kept.

    The factor is the largest one of those tried. Limits that no speed decides do not count.
    """
    times = b.motion.times
    t = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), _FIRST_SURE_TIMES)).astype(int))]
    high = 1.0
    for _ in range(_MAX_SURE_ROUNDS):
        # The values at some times bracket the factor, which costs little.
        open_limits = find_open_limits(b, t)
        factor, place = _bracket(b, t, open_limits, high)
        # All the motion at this factor, peaks included: it is the result if nothing is beyond a limit.
        beyond = _select_beyond(find_excess(b, factor, open_limits=open_limits))
        if len(beyond) == 0:
            return SureFactor(np.inf if factor >= _MAX_FACTOR else factor, place)
        # Exchange: the times at which limits are not surely kept join the others.
        t, high = np.union1d(t, [excess.t for excess in beyond.values()]), factor
    raise JounceError(
        f"no factor of speed down to {factor:.3g} surely keeps the limits; samples with less noise, or with_limits"
    )


def find_open_limits(b: LimitedMotion, t: np.ndarray) -> frozenset[Limit]:
    """Find the limits that are undecided at every speed.

    A limit counts that is undecided at any of the times (N,). Raises where one is surely broken at every speed.
    """
    # A limit that is not surely kept at the least factor is open at all others.
    open_limits = frozenset(_select_beyond(find_excess(b, _MIN_FACTOR, t)))
    # Open limits have their deviations turned away from the bound: what is beyond even so is surely broken.
    broken = _select_beyond(find_excess(b, _MIN_FACTOR, t, open_limits))
    if len(broken) > 0:
        (kind, j), excess = next(iter(broken.items()))
        what = f"the {kind.replace('_', ' ')} of {b.owner(kind, j)}"
        raise JounceError(
            f"{what} is beyond its limit by more than two standard deviations at t = {excess.t:.6g} s, at every speed;"
            " change the motion or with_limits"
        )
    return open_limits


def widen(kind: str, sign: int, off: Deviations, open_limits: Collection[Limit], joints: int) -> np.ndarray:
    """Return what is added to values before they are compared.

    The values (N, joints) are those of a kind. What is added is two deviations towards the bound, or away from it for
    limits that are undecided at every speed.
    """
    signs = np.array([-sign if (kind, j) in open_limits else sign for j in range(joints)])
    return np.asarray(signs * DECISIVE_DEVIATIONS * off.get(kind, np.zeros((1, joints))))


def find_excess(
    b: LimitedMotion, factor: float, t: np.ndarray | None = None, open_limits: Collection[Limit] = ()
) -> Mapping[Limit, _Excess]:
    """Find the largest excess of each limit at a factor of speed.

    The values are those along all the motion, or at times (N,) in the given one.
    """
    scaled, excesses = b.scaled(1 / factor), dict[Limit, _Excess]()
    parts: Iterable[tuple[np.ndarray, Mapping[str, np.ndarray]]]
    parts = sample_values(scaled) if t is None else take_sides(scaled, b.motion.start + (t - b.motion.start) / factor)
    for times, values in parts:
        # Times of the scaled motion may be outside of it by rounding.
        off = compute_deviations(scaled, times.clip(*scaled.whole))
        for kind in scaled.kinds:
            for sign in SIGNS:
                shares = _shares_beyond(scaled, kind, sign, values[kind], off, open_limits)
                worst_row = shares.argmax(axis=0)
                for j in np.flatnonzero(np.isfinite(scaled.scales[kind].bound(sign))).tolist():
                    share = float(shares[worst_row[j], j])
                    if share > excesses.get((kind, j), _Excess(-np.inf, 0)).share:
                        excesses[kind, j] = _Excess(share, float(b.given_times(times[worst_row[j]], factor)))
    return excesses


def _shares_beyond(
    b: LimitedMotion, kind: str, sign: int, values: np.ndarray, off: Deviations, open_limits: Collection[Limit]
) -> np.ndarray:
    """Return how far values with deviations are beyond the bounds.

    The distances (N, joints) are in shares of the bounds, and above 0 beyond them.
    """
    scale, count = b.scales[kind], len(b.names(kind))
    excess = sign * (values + widen(kind, sign, off, open_limits, count)) - scale.tolerant(sign)
    # A deviation that is not known leaves every value open.
    unknown = [-np.inf if (kind, j) in open_limits else np.inf for j in range(count)]
    # The reach is infinite where nothing bounds a joint, and 0 at a bound of 0.
    reach = np.abs(scale.reach(sign))
    unit = np.where((reach > 0) & np.isfinite(reach), reach, 1.0)
    return np.asarray(np.where(np.isnan(excess), unknown, excess) / unit)


def _select_beyond(excess: Mapping[Limit, _Excess]) -> dict[Limit, _Excess]:
    """Return the limits with an excess above 0, the largest one first."""
    largest_first = sorted(excess.items(), key=lambda item: -item[1].share)
    return {limit: excess_of_limit for limit, excess_of_limit in largest_first if excess_of_limit.share > 0}


def _bracket(b: LimitedMotion, t: np.ndarray, open_limits: frozenset[Limit], high: float) -> tuple[float, Place | None]:
    """Find the largest factor that surely keeps some values.

    The values are those at times (N,), and the search begins at the factor `high`. Returns the factor with the limit
    that a larger one leaves.
    """

    def find_beyond(factor: float) -> dict[Limit, _Excess]:
        return _select_beyond(find_excess(b, factor, t, open_limits))

    # Rise until a limit is not surely kept at `high`.
    beyond = find_beyond(high)
    low = high
    while len(beyond) == 0 and high < _MAX_FACTOR:
        low, high = high, min(2 * high, _MAX_FACTOR)
        beyond = find_beyond(high)
    if len(beyond) == 0:
        return high, None
    # Where it was not at the first factor, fall until all are kept at `low`.
    while low == high or len(find_beyond(low)) > 0:
        high, low = low, low / 2
    beyond = find_beyond(high)
    # Bisection keeps that: all limits are surely kept at `low`, and `beyond` are those that are not at `high`.
    for _ in range(_SURE_BISECTIONS):
        middle = (low + high) / 2
        beyond_middle = find_beyond(middle)
        if len(beyond_middle) > 0:
            high, beyond = middle, beyond_middle
        else:
            low = middle
    (kind, j), worst = next(iter(beyond.items()))
    return low * (1 - _FACTOR_MARGIN), (kind, j, worst.t)


def describe_open_limits(checked: Check) -> tuple[str, ...]:
    """Describe which limits a result leaves undecided or breaks.

    The result is a slower or retimed motion; its samples leave limits undecided.
    """
    names = []
    for row in checked.table:
        spans = row.violations
        if len(spans) == 0 and row.cause == SAMPLES_CAUSE:
            spans = row.undecided
        if len(spans) == 0:
            continue
        start, stop = spans[0]
        what = f"{row.limit.replace('_', ' ')} of {row.joint} at t = {start:.6g} to {stop:.6g} s of the result"
        names.append(f"{what} is {row.verdict}")
    return (f"not every limit is surely kept: {join_names(names)}",) if len(names) > 0 else ()
