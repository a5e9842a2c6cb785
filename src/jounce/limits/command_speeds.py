"""Factors of speed at which the commands of a plan keep limits at a controller's rate.

A difference of commands is no polynomial of the factor: they stand at other places of the path at every speed. Factors
are tried, down from 1 until one keeps every limit, or up from 1 until one breaks a limit; bisection follows between
the last two. Every factor that is returned was itself judged. Those below it were not: differences of order m of
positions are means of m-th derivatives and fall with the speed, torque rates may rise where gravity and inertia cancel.
Of measured motions two standard deviations lie between values and their bounds, as of `measured_speeds`.

`JounceError` where a limit is broken at rest already, and where no factor down to a thousandth keeps every limit.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.engine.engine import Engine
from jounce.limits.check import check
from jounce.limits.commands import JudgedCommands, take_differences, take_rest
from jounce.limits.deviations import compute_deviations, is_measured
from jounce.limits.doubts import without_doubts
from jounce.limits.factor_search import Place
from jounce.limits.feasible_factors import refuse_static
from jounce.limits.measured_speeds import Limit, find_open_limits, widen
from jounce.limits.ratios import SIGNS
from jounce.limits.validation import validate_limits
from jounce.limits.verdicts import Check
from jounce.motion.commands import MAX_DIFFERENCES, MIN_COMMANDS, find_commands
from jounce.motion.motion import Motion

KEPT_RATIO = 1 - 1e-6  # to every limit: rounded times and positions of a table move third differences by less
_FACTOR_STEP = 1.05  # from one factor that is tried to the next
_MIN_FACTOR, _MAX_FACTOR = 1e-3, 1000.0  # times the given speed: no motion is meant to be slower or faster
_MAX_SLOWED_COMMANDS = 2e6  # of a motion that is slowed down, which bounds time and memory
_BISECTIONS = 24  # between two factors: to 3e-9 of them, far below what a margin of 1e-6 asks for


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
            low = high * min(1 / _FACTOR_STEP, ratio ** (-1 / MAX_DIFFERENCES))
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
        low, most = 1.0, min(_MAX_FACTOR, self.motion.duration * self.rate / MIN_COMMANDS)
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
    commands = find_commands(motion.curve)
    if rate is not None:
        return CommandSpeeds(robot, motion, rate, differences)
    if commands is None:
        return None
    return CommandSpeeds(robot, motion, commands.rate, commands.differences, own=True)
