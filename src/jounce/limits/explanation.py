"""Why a controller stops a motion: what its commands break, when, for which cause, and what cures it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from jounce.arguments.names import array_by_name
from jounce.core import cures, errors
from jounce.core.cures import Remedy
from jounce.core.display import HtmlDisplay
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.progress import stage
from jounce.engine import along
from jounce.engine.engine import Engine
from jounce.limits.check import check
from jounce.limits.commands import DIFFERENCE_NAMES, JudgedCommands, take_differences
from jounce.limits.joints import joint_units
from jounce.limits.limited_motion import LimitedMotion, motion_order, validate_limits
from jounce.limits.ratios import SIGNS, find_runs
from jounce.limits.retime import retime
from jounce.limits.slowdown import Slowdown, slowdown
from jounce.limits.verdicts import Check, Verdict, describe_verdict
from jounce.model.limits import LIMIT_KINDS
from jounce.motion import commands, smoothness
from jounce.motion.curves import ROUNDING_OF_Q
from jounce.motion.motion import Motion

MAX_DRIFT = 1.5  # times what the derivative on either side of a moment makes of it: a larger change is a jump
MIN_STEPS_TO_SEE = 8  # times the rounding of positions: of smaller steps none is seen to be missing
MAX_ROUNDING_SHARE_OF_DIFFERENCES = 0.1  # of the largest one: more of it enters torque rates
MAX_SKIP_MISMATCH = 0.2  # of a velocity that is the sum of those next to it, where a command is missing
PLAN_CAUSES = ("jump", "torque rate", "too fast")  # those that another time law can cure


@dataclass(frozen=True)
class Controller:
    """What is public of a controller: its rate, Hz, arms with a table of limits, source, and what nobody predicts."""

    rate: float
    differences: int
    arms: tuple[str, ...]
    source: str
    unpredicted: tuple[str, ...]


CONTROLLERS: Mapping[str, Controller] = {
    "franka": Controller(
        1000.0, 3, ("panda", "fr3"),
        "libfranka, include/franka/rate_limiting.h, of 0.9.2 (2022-08-31) for Panda and of 0.18.0 (2025) for FR3",
        (
            "libfranka's low-pass filter (from 0.5.0 on) and rate limiter (on by default from 0.4.0 to 0.9.2)",
            "packets that will be lost, contacts, and an FR3's lower velocity near the ends of its joints",
            "limits of torque and torque rate are conditions for torque commands, and advice for positions",
        ),
    )
}  # fmt: skip


def select_controller(name: str, joint_names: Sequence[str]) -> tuple[Controller, str]:
    """A controller by its name, and the arm, of those that it drives, whose limits are used: its name is in joints'."""
    if name not in [*CONTROLLERS]:
        came = errors.unknown_name_error("controller", name, CONTROLLERS)
        at_rate = Remedy("rate=1000", "--rate 1000")
        raise JounceError(f"{came}; no rules of others are public: {at_rate} judges by the robot's own limits")
    found = CONTROLLERS[name]
    arm = next((arm for arm in found.arms if any(arm in joint for joint in joint_names)), found.arms[0])
    return replace(found, arms=(arm,)), arm


@dataclass(frozen=True)
class Trip:
    """A moment at which commands break limits: the first limit of which joint, from when to when, s, and the cause.

    `cause` is "late command", "repeated command", "rounding", "start", "end", "torque step", "jump", "torque rate",
    "too fast" or "position", and `words` say it; `ratio` is the worst one while it lasts, of any joint and limit.
    """

    joint: str
    limit: str
    t: float
    stop: float
    value: float
    bound: float
    unit: str
    ratio: float
    cause: str
    words: str


@dataclass(frozen=True)
class Cure:
    """Whether `slowdown` or `retime` at the controller's rate keeps every limit, with factor and duration, or why not.

    `call` is the call of Python, of `robot` and `motion`, whose result is so.
    """

    method: str
    works: bool
    words: str
    call: str


@dataclass(frozen=True, repr=False)
class Explanation(HtmlDisplay):
    """Why a controller stops a motion. `Robot.explain` makes one.

    Attributes
    ----------
    trips : tuple of Trip
        The moments at which limits are broken, in the order of time; none if every limit is kept.
    cures : tuple of Cure
        What `slowdown` and `retime` do about it; none where the plan is not the cause.
    notes, unpredicted : tuple of str
        How the motion was judged, which limits are undecided for which cause, and what is not predicted.
    verdict : str
        That of `Robot.check` on the same commands: "broken" if there are trips, else "kept" or "undecided".
    words : str
        The verdict in words.
    judged : mapping of str to float
        By kind of limit that is stated, 1 where differences judge it, else 0, as of `Check`.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(jerk=100)
    >>> robot.explain(jounce.Motion.trapezoidal([[0, 0], [1, 1]], 1.0, 5.0), rate=1000)
    <Explanation: limits are broken at 4 moments, first at t = 0.001 s: the acceleration of joint1 jumps by 5 rad/s^2>
    """

    trips: tuple[Trip, ...]
    cures: tuple[Cure, ...]
    notes: tuple[str, ...]
    unpredicted: tuple[str, ...]
    judged: Mapping[str, float]
    verdict: Verdict
    words: str

    def __repr__(self) -> str:
        if not self.trips:
            return f"<Explanation: {self.words}>"
        first = self.trips[0]
        return f"<Explanation: {self.words}, first at t = {first.t:g} s: {first.words}>"


@stage("explanation")
def explain(
    robot: Engine, motion: Motion, rate: float, differences: int, start: object, known: Controller | None = None
) -> Explanation:
    """Why a controller with the limits of a robot stops a motion; it begins at rest at `start` (n,), or where it is."""
    given = along.check_motion(robot.mechanism, motion)
    b = validate_limits(robot, given.sampled(rate, differences))
    begin = None if start is None else np.asarray(array_by_name(start, robot.joint_names, "start"), dtype=float)
    if begin is not None and (begin.shape != (robot.n,) or not np.isfinite(begin).all()):
        expected = f"{robot.n} positions: {join_names(robot.joint_names)}"
        raise JounceError(f"start is {quote_value(start)}; expected {expected}")
    d, found = _judge_commands(b, begin)
    trips = tuple(_describe_trip(d, *span) for span in _find_moments(d))
    notes, unpredicted = [*b.motion.notes, *found.notes], [*known.unpredicted] if known else []
    if known:
        notes.append(f"limits of {join_names(known.arms)}, of {known.source}")
    if others := dict.fromkeys(trip.cause for trip in trips if trip.cause not in PLAN_CAUSES):
        notes.append(f"neither slowdown nor retime cures: {join_names(others)}")
    if begin is None:
        stated = f"{cures.option_name('start')} states its position"
        unpredicted.append(f"whether the robot rests where the first command is: {stated}")
    if b.motion.torques is None:
        unpredicted.append(
            f"torques of feedback: {cures.option_name('torques')} reads those that a table of commands states"
        )
    tried = [] if others or not trips else _try_cures(robot, given, {"rate": rate, "differences": differences}, begin)
    if known:
        arm = f"robot.with_limits({known.arms[0]!r})"
        tried = [replace(cure, call=cure.call.replace("robot", arm, 1)) for cure in tried]
    verdict: Verdict = "broken" if trips else _verdict_without_trips(found)
    words = describe_verdict(
        ["undecided" if row.verdict == "undecided" else "kept" for row in found.table], found.judged
    )
    if trips:
        words = f"limits are broken at {len(trips)} moments"
    return Explanation(trips, tuple(tried), tuple(notes), tuple(unpredicted), found.judged, verdict, words)


def _judge_commands(b: LimitedMotion, begin: np.ndarray | None) -> tuple[JudgedCommands, Check]:
    """The differences of commands from where the robot begins, without values of limits that a check leaves undecided.

    Values that are left out are NaN, which is beyond no bound.
    """
    d, found = take_differences(b, begin), check(b.robot, b.motion)
    assert d is not None  # b.motion consists of commands
    undecided = {(row.limit, row.joint) for row in found.table if row.verdict == "undecided"}
    limited = {}
    for kind, of in d.limited.items():
        left_out = [(kind, name) in undecided for name in of.names]
        limited[kind] = replace(of, rates=(np.where(left_out, np.nan, of.values),))
    return replace(d, limited=limited), found


def _verdict_without_trips(found: Check) -> Verdict:
    """Whether a limit is undecided, of commands that break none from where the robot begins."""
    return "undecided" if any(row.verdict == "undecided" for row in found.table) else "kept"


def _find_moments(d: JudgedCommands) -> list[tuple[int, int]]:
    """The first and the last command of each moment at which limits are broken: few periods apart they are one."""
    beyond = [d.b.scales[kind].beyond(of.values, sign) for kind, of in d.limited.items() for sign in SIGNS]
    ever = np.any(beyond, axis=(0, 2))
    reach, end = d.commands.differences, len(d.commands.t)
    found = find_runs(np.convolve(ever, np.ones(reach + 1))[: len(ever)] > 0)
    if ever[end:].any() and found[-1][0] < end - 2 * reach:  # what is broken while the last is held has its own cause
        first, last = found.pop()
        found += [(first, end - 1), (end, last)]
    return found


def _describe_trip(d: JudgedCommands, first: int, last: int) -> Trip:
    """What is broken from one command to another: the first limit, and the cause, of a limit of the motion if near."""
    found = []
    for (kind, of), sign in product(d.limited.items(), SIGNS):
        scale, values = d.b.scales[kind], of.values[first : last + 1]
        for i, j in np.argwhere(scale.beyond(values, sign)).tolist():
            ratio = scale.ratio(values[i, [j]], sign, slice(j, j + 1)).item()
            found.append((first + i, kind not in LIMIT_KINDS.motion, -ratio, kind, j, sign))
    k, _, _, kind, j, sign = min(found)
    near = [of for of in found if not of[1] and of[0] <= k + d.commands.differences]
    decides = min(near, default=min(found))
    broken = d.limited[kind]
    return Trip(
        broken.names[j], LIMIT_KINDS[kind].describe(d.b.limits.of(kind) if kind in LIMIT_KINDS.effort else None),
        float(broken.times[k]), float(broken.times[max(of[0] for of in found)]), float(broken.values[k, j]),
        sign * float(d.b.scales[kind].bound(sign)[j]), broken.units[j],
        -min(of[2] for of in found), *_find_cause(d, decides[0], *decides[3:5]),
    )  # fmt: skip


def _find_cause(d: JudgedCommands, k: int, kind: str, j: int) -> tuple[str, str]:
    """The cause for which command k breaks a limit of joint j, and the same in words."""
    rate, order, name, rates = d.commands.rate, motion_order(d.b.robot, kind), d.b.joints[j], d.q.rates
    row = k + 1  # of the differences, which begin with the rest before
    if kind == "position":
        return "position", f"the path of {name} leaves its range"
    if stream := _find_stream_fault(d, k, max(order, 1)):
        return stream
    if kind in LIMIT_KINDS.effort[1:] and d.b.motion.torques:
        if k == 0:
            return "start", f"the first torque of {name} is not that of the rest before it"
        step = d.limited[kind].values[k, j] / rate
        return "torque step", f"the commanded torque of {name} changes by {step:.3g} N m or N in one period"
    errors = [smoothness.rounding_error(column) for column in rates[0][1:].T]
    if kind in LIMIT_KINDS.motion:
        value, off = float(d.limited[kind].values[k, j]), errors[j] * (2 * rate) ** order
        if off > abs(value) - d.b.scales[kind].reach(int(np.sign(value)))[j]:
            return "rounding", f"{name} is rounded: its differences are up to {off:.3g} off; write 17 digits"
        return _find_jump(d, row, j, order) or ("too fast", f"the {kind} of {name} is itself beyond its limit")
    if max(errors) * (2 * rate) ** (len(rates) - 2) > MAX_ROUNDING_SHARE_OF_DIFFERENCES * np.abs(rates[-2]).max():
        return "rounding", "positions are rounded, by more than a tenth of their highest difference; write 17 digits"
    jumps = [jump for i in range(len(d.b.joints)) if (jump := _find_jump(d, row, i, min(order + 1, len(rates) - 2)))]
    if at_ends := [jump for jump in jumps if jump[0] != "jump" or "jerk" not in d.b.kinds]:
        return min(at_ends, key=lambda jump: jump[0] == "jump")
    if kind not in LIMIT_KINDS.effort[1:]:
        return "too fast", f"the planned {LIMIT_KINDS[kind].describe()} of {name} is itself beyond its limit"
    kept = [kind for kind in LIMIT_KINDS.motion[1:] if kind in d.b.kinds]
    why = f"limits of {join_names(kept)} are kept there, and do not prevent it" if kept else "nothing else is limited"
    return "torque rate", f"that of {name}; {why}"


def _find_stream_fault(d: JudgedCommands, k: int, order: int) -> tuple[str, str] | None:
    """A command that is late, missing or repeated, among those whose difference the one of command k is."""
    t, q, rate = d.commands.t, d.commands.q, d.commands.rate
    least = MIN_STEPS_TO_SEE * np.array([smoothness.rounding_error(column) for column in q.T])
    for i in range(max(k - order + 1, 2), min(k + 1, len(t) - 1)):
        before, here, after = np.diff(q[i - 2 : i + 2], axis=0)
        if (gap := (t[i] - t[i - 1]) * rate) > commands.LATE_PERIODS:
            return "late command", f"the command of t = {t[i]:.6g} s comes {gap:.3g} periods after the one before"
        moves = (np.abs(before) > least) & (np.abs(after) > least)
        if moves.any() and not here.any():
            return "repeated command", f"the command of t = {t[i]:.6g} s repeats the one before, while the robot moves"
        off = np.maximum(np.abs(here - before - after), np.abs(before - after))[moves]
        if moves.any() and (off < MAX_SKIP_MISMATCH * np.abs(here[moves])).all():
            return "late command", f"before t = {t[i]:.6g} s a command is missing: the step is twice those next to it"
    return None


def _find_jump(d: JudgedCommands, row: int, j: int, order: int) -> tuple[str, str] | None:
    """The lowest derivative of joint j that jumps within the periods whose difference is of that order."""
    left, right = max(row - order, 0), min(row + order, len(d.q.times) - 1)
    last, name, rates = len(d.commands.t), d.b.joints[j], d.q.rates
    for k in range(order + 1):
        before, after = rates[k][[left, right], j]
        drift = MAX_DRIFT * np.abs(rates[k + 1][[left, right], j]).max() * (right - left) / d.commands.rate
        if abs(after - before) <= drift + ROUNDING_OF_Q * np.abs(rates[0][:, j]).max() * (2 * d.commands.rate) ** k:
            continue
        size = f"by {after - before:.4g} {LIMIT_KINDS[LIMIT_KINDS.motion[k]].unit(joint_units(d.b.robot.mechanism)[j])}"
        if left == 0 and k < 2:
            return "start", f"{name} begins off the state before: its {DIFFERENCE_NAMES[k]} jumps {size}"
        if row > last and k < 2:
            return "end", f"{name} ends in motion: its {DIFFERENCE_NAMES[k]} jumps {size}"
        if k == order and order < LIMIT_KINDS.motion.index("jerk"):
            return None
        return "jump", f"the {DIFFERENCE_NAMES[k]} of {name} jumps {size}"
    return None


def _try_cures(robot: Engine, motion: Motion, controller: Mapping[str, Any], begin: np.ndarray | None) -> list[Cure]:
    """Whether other time laws of the motion keep every limit as commands too, from where the robot begins."""
    usual = {"differences": commands.JERK_DIFFERENCE}
    stated = ", ".join(f"{name}={value:.10g}" for name, value in controller.items() if value != usual.get(name))
    cures = []
    for law in (slowdown, retime):
        method, call = law.__name__, f"robot.{law.__name__}(motion, {stated})"
        try:
            found = law(robot, motion, **controller)
        except JounceError as error:
            cures.append(Cure(method, False, str(error), call))
            continue
        words = f"{found.motion.duration:.4g} s instead of {motion.duration:.4g} s"
        if isinstance(found, Slowdown):
            words = f"{found.factor:.4g} times the speed, {words}"
        d, after = _judge_commands(validate_limits(robot, found.motion.sampled(**controller)), begin)
        works = not _find_moments(d)
        if not works:
            words += " still break a limit"
        elif _verdict_without_trips(after) == "undecided":
            words += "; limits that are undecided remain so"
        cures.append(Cure(method, works, words, call))
    return cures
