"""Find the largest factor of speed that keeps every limit.

It is at most 1 by default.

Problem: the largest c such that the motion at every speed up to c times its own keeps all
limits at all times, a semi-infinite program in one variable.

Algorithm: at one state each limited value is a polynomial in c, whose roots bound the intervals of c that break a
limit. The first interval of all states gives a c; a check of the motion at this c, peaks between samples included,
yields the states at which it is farthest beyond a limit, and these are added until no limit is broken: the exchange
method of semi-infinite programming [1]. Factors at which samples come near a limit and recede again are checked as
well. With Coulomb friction or bent springs there are no polynomials, and c is bracketed by direct evaluation.

A motion that `check` finds kept is the result itself, at c = 1. At a controller's rate limits bound differences of
commands, and of measured motions deviations count: in both cases `tried_speeds` tries factors.

Invariant: c only falls as states are added. It fails, with `JounceError`, where a limit is broken at every speed, where
none bounds a speed that is raised up to them, and where a limit of a joint that moves is 0 on its side. Limits that are
undecided along every motion, as those of 0 on both sides are, bound no speed and stay undecided in the result.

[1] R. Hettich, K. O. Kortanek, Semi-infinite programming: theory, methods, and applications, SIAM Review 35 (1993).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jounce.core import errors
from jounce.core.cures import Remedy
from jounce.core.display import HtmlDisplay
from jounce.core.errors import JounceError
from jounce.core.progress import stage
from jounce.engine import along, contact_limits
from jounce.engine.along import ForceBreak
from jounce.engine.engine import Engine
from jounce.limits.check import check, find_limited_breaks, without_doubts
from jounce.limits.feasible_factors import Feasible, Place, bracket_factor, compute_worst, is_polynomial
from jounce.limits.limited_motion import LimitedMotion, is_measured, validate_limits
from jounce.limits.tried_speeds import CommandSpeeds, describe_open_limits, find_command_speeds, find_sure_factor
from jounce.limits.verdicts import Verdict
from jounce.limits.worst_values import Worst
from jounce.motion import commands
from jounce.motion.motion import Motion

_BINDING_RATIO_TOLERANCE = 2e-10  # of a ratio above 1: factors are as exact
_MAX_SLOWDOWN_ROUNDS = 40  # of states added between samples; motions take three or four
_MIN_SPEED_FACTOR = 1e-9  # only a limit of 0 makes the factor smaller: no useful motion lasts 1e9 times as long
_NO_RESERVE = 5e-6  # of a factor above 1: what six digits show as 1


class Binding(NamedTuple):
    """The limit that stops a motion from being faster.

    `joint` and `limit` are whose limit of which kind, `t` is when, s, in the given motion.
    """

    joint: str
    limit: str
    t: float

    def __str__(self) -> str:
        return f"{self.limit.replace('_', ' ')} of {self.joint} at t = {self.t:.6g} s"


@dataclass(frozen=True, repr=False)
class Slowdown(HtmlDisplay):
    """How fast a motion may be.

    `Robot.slowdown` makes one.

    Attributes
    ----------
    factor : float
        Largest factor of speed, at most 1, such that every smaller one keeps all limits too; 1 of a motion that is
        kept. With `up_to_limits=True` it is above 1 where the motion may be faster. At a controller's rate, and of
        measured motions, the largest of those tried.
    binding : Binding or None
        The limit that is met exactly at this factor: (joint, limit, t), t in the given motion; None where the motion is
        returned as it is.
    motion : Motion
        The motion at this factor: ``motion.scaled(1 / factor)``, or the given one itself.
    largest : float or None
        Largest factor at which all limits are kept. Above 1 it says how much faster a motion that is kept could be,
        infinite where no limit bounds its speed. None where it is not sought: of a motion that breaks a limit with
        friction or at a controller's rate, and of one that is undecided.
    notes : tuple of str
        What `Robot.check` notes of the result, between which factors some break a limit, and which limits of the result
        are undecided because its samples, or the data of the robot, decide them at no speed, in words.
    verdict : str
        That of `Robot.check` on the given motion: "kept", "broken" or "undecided".

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(effort=[60, 15])
    >>> motion = jounce.Motion.trapezoidal([[0, 0], [1, 1]], 2.0, 10.0)
    >>> slow = robot.slowdown(motion)
    >>> slow.binding.joint, round(slow.factor, 4), round(robot.check(slow.motion).worst.ratio, 9)
    ('joint2', 0.4159, 1.0)
    >>> robot.slowdown(motion.scaled(3))
    <Slowdown: every limit is kept; the motion could be up to 1.2478 times as fast>
    """

    factor: float
    binding: Binding | None
    motion: Motion
    largest: float | None
    notes: tuple[str, ...] = ()
    verdict: Verdict = "broken"

    def __repr__(self) -> str:
        return f"<Slowdown: {self.words}>" if self.binding is None else f"<Slowdown {self.words}>"

    @property
    def words(self) -> str:
        """Return what slows the motion down, or how fast it could be."""
        if self.binding is not None:
            return f"by a factor of speed {self.factor:.6g}: {self.binding!s}"
        if self.verdict == "undecided":
            return "no limit is known to be broken, and some are undecided; the motion is returned as it is"
        return f"every limit is kept; {describe_reserve(self.largest)}"


class SpeedLimit(NamedTuple):
    """The first factor at which a limit is met, and which.

    The factor is infinite if no limit is met. `largest` is the largest factor at which all are kept, if it is known.
    """

    factor: float
    place: Place | None
    largest: float | None


_NOTHING_BOUNDS = SpeedLimit(np.inf, None, np.inf)


def describe_reserve(largest: float | None) -> str:
    """Describe how much faster a motion could be that keeps every limit."""
    if largest is None:
        return "how much faster the motion could be is not known"
    if np.isinf(largest):
        return "no limit bounds the speed of the motion"
    if largest <= 1 + _NO_RESERVE:
        return "one is just met, so that the motion could not be faster"
    return f"the motion could be up to {largest:.6g} times as fast"


@stage("largest factor of speed")
def slowdown(
    robot: Engine,
    motion: Motion,
    rate: float | None = None,
    differences: int = commands.JERK_DIFFERENCE,
    up_to_limits: bool = False,
) -> Slowdown:
    """Find the largest factor of speed that keeps all limits.

    Every smaller factor keeps all limits too. The factor is at most 1 unless `up_to_limits`.
    """
    if contact_limits.are_limited(robot.mechanism):
        raise JounceError(f"{robot.name!r}: slowdown takes contacts without friction and sole; check judges them")
    errors.check_bool("up_to_limits", up_to_limits, "whether the motion may become faster")
    given_motion = along.check_motion(robot.mechanism, motion)
    # None for a motion whose derivatives are bounded, in place of differences at a rate.
    speeds = find_command_speeds(robot, given_motion, rate, differences)
    checked = check(robot, given_motion if speeds is None else speeds.sampled())
    if checked.verdict == "undecided" and not up_to_limits:
        return Slowdown(1.0, None, motion, None, checked.notes, checked.verdict)
    # Limits that no speed decides are left out: they bound nothing.
    b = without_doubts(validate_limits(robot, given_motion))
    limit = _NOTHING_BOUNDS
    if len(b.kinds) > 0:
        limit = _limit_derivatives(b) if speeds is None else _limit_commands(speeds, checked.verdict)
    # A motion that is kept is the result itself; the limit says how much faster it could be.
    if checked.verdict == "kept" and not up_to_limits:
        notes = (*checked.notes, *_describe_gap(limit))
        return Slowdown(1.0, None, motion, limit.largest, notes, checked.verdict)
    if limit.place is None:
        raise JounceError("no limit bounds the speed of this motion: it does not move, or with_limits must state more")
    kind, joint, t = limit.place
    slow = given_motion.scaled(1 / limit.factor) if speeds is None else speeds.at_speed(limit.factor)
    # The notes are those of the result.
    after = check(robot, slow if speeds is None else speeds.sampled(limit.factor))
    notes = (*after.notes, *_describe_gap(limit), *describe_open_limits(after))
    return Slowdown(limit.factor, Binding(b.name(kind, joint), kind, t), slow, limit.largest, notes, checked.verdict)


def _limit_commands(speeds: CommandSpeeds, verdict: Verdict) -> SpeedLimit:
    """Find the limit of the speed of commands.

    It is below the speed of the plan where that breaks a limit, else above.
    """
    if verdict == "broken" or (verdict == "undecided" and not speeds.keeps()):
        return SpeedLimit(*speeds.fall(), None)
    factor, place = speeds.rise()
    return SpeedLimit(factor, place, factor)


def _limit_derivatives(b: LimitedMotion) -> SpeedLimit:
    """Find the speed limit of a motion whose derivatives are bounded."""
    _refuse_jumps(b, find_limited_breaks(b))
    # Three ways: deviations are tried, polynomials have roots, and all else is bracketed.
    if is_measured(b.motion):
        sure = find_sure_factor(b)
        return SpeedLimit(sure.factor, sure.place, sure.factor)
    if is_polynomial(b):
        states = Feasible(b)
        factor = _refine_first(b, states)
        if np.isinf(factor):
            return _NOTHING_BOUNDS
        i = states.first
        place: Place | None = (str(states.kind[i]), int(states.joint[i]), float(states.t[i]))
        largest: float | None = max(factor, _refine_largest(b, states))
    else:
        factor, place = bracket_factor(b)
        largest = factor if factor >= 1 else None
    return SpeedLimit(factor, place, largest)


def _describe_gap(limit: SpeedLimit) -> tuple[str, ...]:
    """Describe between which factors some break a limit.

    The larger one keeps all limits again, where gravity and inertia cancel.
    """
    if limit.largest is None or limit.largest <= limit.factor * (1 + _BINDING_RATIO_TOLERANCE):
        return ()
    return (f"some factors of speed between {limit.factor:.6g} and {limit.largest:.6g} break a limit",)


def _refine_first(b: LimitedMotion, states: Feasible) -> float:
    """Find the largest factor below which all are feasible.

    It is refined between samples at this factor, and where limits are near at smaller ones.
    """
    if np.isinf(states.factor):
        # No state breaks a limit: this raises where one between the states is broken at every speed.
        states.add(find_times_beyond(b, 1.0))
    for _ in range(_MAX_SLOWDOWN_ROUNDS):
        factor = _check_factor(states)
        if np.isinf(factor):
            return factor
        # Exchange: states farthest beyond a limit at this factor, or where smaller ones come near, bound the next.
        near_factors = states.near_misses(factor)
        beyond = np.unique(np.concatenate([find_times_beyond(b, c) for c in (*near_factors, factor)]))
        if beyond.size == 0:
            return factor
        states.add(beyond)
    return _check_factor(states)


def _refine_largest(b: LimitedMotion, states: Feasible) -> float:
    """Find the largest feasible factor, refined between samples."""
    for _ in range(_MAX_SLOWDOWN_ROUNDS):
        beyond = find_times_beyond(b, states.largest)
        if states.largest <= states.factor or not beyond.size:
            break
        states.add(beyond)
    return states.largest


def _check_factor(states: Feasible) -> float:
    """Return the factor, unless a limit of 0 decides it.

    Only a limit of 0 makes the factor so small.
    """
    factor = states.factor
    if factor < _MIN_SPEED_FACTOR:
        i = states.first
        kind = str(states.kind[i])
        owner, limit = states.b.owner(kind, int(states.joint[i])), kind.replace("_", " ")
        raise JounceError(f"{owner} moves at t = {states.t[i]:.6g} s, and its limit of {limit} is 0")
    return factor


def find_times_beyond(b: LimitedMotion, factor: float) -> np.ndarray:
    """Find when a motion is farthest beyond limits, between samples too.

    The motion is at a factor of its speed, and the times are those in the given motion.
    """
    worst = compute_worst(b, factor)
    times = [worst.t[side][ratio > 1 + _BINDING_RATIO_TOLERANCE] for side, ratio in worst.ratios.items()]
    return np.asarray(b.given_times(np.unique(np.concatenate(times)), factor))


def _refuse_jumps(b: LimitedMotion, breaks: Sequence[ForceBreak]) -> None:
    """Raise where a jump of a lower rate breaks a limit.

    It is broken at every speed.
    """
    worst = Worst(b)
    worst.take_jumps(breaks)
    for (kind, sign), value in worst.value.items():
        for j in np.flatnonzero(np.isposinf(value)):
            owner, t = b.owner(kind, int(j)), worst.t[kind, sign][j]
            limit = kind.replace("_", " ")
            raise JounceError(
                f"break at t = {t:.9g} s: the {limit} of {owner} is infinite there at every speed, and it has a"
                f" limit; {Remedy('motion.blended(time)', '--blend S')} replaces breaks"
            )
