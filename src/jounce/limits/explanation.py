"""`explain` says why a controller stops a motion: which limit its commands break, when, why, and what cures it.

A controller judges differences of commands at its own rate, and forces that follow from them
(`commands.take_differences`); here `d` holds them. A moment is a run of commands at which any of these values is beyond
its limit; runs that are a few periods apart are one moment (`_find_moments`). For each moment a `Trip` states the limit
that is broken first. The cause may be sought at another limit, which is broken soon after it and says more
(`_describe_trip`). Causes are tried in this order (`_find_cause`):

1. the path leaves a range of positions;
2. the stream: a command comes late, is missing, or repeats the one before;
3. torques that a table of commands states: they begin off the rest before, or step;
4. rounding: positions of few digits make differences of high order noisy;
5. jumps: a low derivative jumps where the motion starts, ends or in between;
6. the plan: its derivative, torque rate or force is beyond the limit by itself.

Another time law can cure the plan and its jumps in between (`PLAN_CAUSES`): `slowdown` and `retime` at the same rate
are tried, and their results are judged as the motion was.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

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

MAX_DRIFT = 1.5  # times the change that the next derivative makes of it: a larger change is a jump
MIN_STEPS_TO_SEE = 8  # times the rounding of positions: a joint whose steps are smaller shows no fault of the stream
MAX_ROUNDING_SHARE_OF_DIFFERENCES = 0.1  # of the largest difference: a larger share decides forces and torque rates
MAX_SKIP_MISMATCH = 0.2  # of the step over a missing command: how far it may be from the sum of its neighbours
PLAN_CAUSES = ("jump", "torque rate", "too fast")  # causes that another time law can cure


@dataclass(frozen=True)
class Controller:
    """The public rules of a controller.

    `rate` is in Hz, and `differences` is the highest order that it takes. `arms` are those with published limits;
    `select_controller` leaves the arm that is used. `source` says where the rules are published, and `unpredicted` what
    they do not predict, in words.
    """

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
    """Return a controller by its name, and the arm it drives.

    The limits of the arm are used. It is the first of the controller's arms whose name is part of a joint's name;
    without such a name, it is the first of all.
    """
    # A list takes names of any type: callers may give one that has no hash.
    if name not in [*CONTROLLERS]:
        came = errors.unknown_name_error("controller", name, CONTROLLERS)
        at_rate = Remedy("rate=1000", "--rate 1000")
        raise JounceError(f"{came}; no rules of others are public: {at_rate} judges by the robot's own limits")
    controller = CONTROLLERS[name]
    arm = next((arm for arm in controller.arms if any(arm in joint for joint in joint_names)), controller.arms[0])
    return replace(controller, arms=(arm,)), arm


@dataclass(frozen=True)
class Trip:
    """A moment at which commands break limits, and why.

    `joint`, `limit`, `value`, `bound` and `unit` are of the limit that is broken first, at `t`, s. `stop`, s, is the
    last time of the moment at which any limit is broken, and `ratio` the worst one of any joint and limit up to then.
    `cause` is "late command", "repeated command", "rounding", "start", "end", "torque step", "jump", "torque rate",
    "too fast" or "position", and `words` say it.
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
    """A method that may keep every limit at the controller's rate.

    `method` is "slowdown" or "retime", and `works` says whether its result keeps every limit. `words` state factor and
    duration, or why there is no result. `call` is the Python call that makes the result from `robot` and `motion`.
    """

    method: str
    works: bool
    words: str
    call: str


@dataclass(frozen=True, repr=False)
class Explanation(HtmlDisplay):
    """Why a controller stops a motion.

    `Robot.explain` makes one.

    Attributes
    ----------
    trips : tuple of Trip
        The moments at which limits are broken, in the order of time; none if every limit is kept.
    cures : tuple of Cure
        What `slowdown` and `retime` do about it; none unless the plan causes all trips.
    notes, unpredicted : tuple of str
        How the motion was judged, which limits are undecided and why, which causes these methods do not cure; and what
        is not predicted.
    verdict : str
        "broken" if there are trips, else "undecided" if `Robot.check` leaves a limit of these commands so, else "kept".
    words : str
        The verdict in words.
    judged : mapping of str to float
        By kind of limit that is stated, the share of time in which it is known to be kept or broken, as of `Check`.

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
        if len(self.trips) == 0:
            return f"<Explanation: {self.words}>"
        first = self.trips[0]
        return f"<Explanation: {self.words}, first at t = {first.t:g} s: {first.words}>"


@stage("explanation")
def explain(
    robot: Engine, motion: Motion, rate: float, differences: int, start: object, controller: Controller | None = None
) -> Explanation:
    """Explain why a controller stops a motion.

    `robot` has the limits of the controller, which takes differences up to the order `differences` at `rate`, Hz. The
    robot begins at rest at `start` (n,), or where the first command is.
    """
    # Commands of the motion are judged. The motion itself is kept for the cures, which take it at other speeds.
    given_motion = along.check_motion(robot.mechanism, motion)
    b = validate_limits(robot, given_motion.sampled(rate, differences))
    begin = None if start is None else np.asarray(array_by_name(start, robot.joint_names, "start"), dtype=float)
    if begin is not None and (begin.shape != (robot.n,) or not np.isfinite(begin).all()):
        expected = f"{robot.n} positions: {join_names(robot.joint_names)}"
        raise JounceError(f"start is {quote_value(start)}; expected {expected}")
    # Judge the commands, and explain each moment at which a limit is broken.
    d, checked = _judge_commands(b, begin)
    trips = tuple(_describe_trip(d, *span) for span in _find_moments(d))
    # Notes say how the motion was judged, and which causes no other time law cures.
    notes = [*b.motion.notes, *checked.notes]
    if controller is not None:
        notes.append(f"limits of {join_names(controller.arms)}, of {controller.source}")
    incurable = list(dict.fromkeys(trip.cause for trip in trips if trip.cause not in PLAN_CAUSES))
    if len(incurable) > 0:
        notes.append(f"slowdown and retime do not help against: {join_names(incurable)}")
    # Nobody knows before the run what the controller itself adds, nor what the caller did not state.
    unpredicted = [] if controller is None else [*controller.unpredicted]
    if begin is None:
        cure = f"{cures.option_name('start')} states its position"
        unpredicted.append(f"whether the robot rests where the first command is: {cure}")
    if b.motion.torques is None:
        unpredicted.append(
            f"torques of feedback: {cures.option_name('torques')} reads those that a table of commands states"
        )
    # Cures are tried only where the plan is the only cause: any other cause would remain in their results.
    tried_cures: list[Cure] = []
    if len(trips) > 0 and len(incurable) == 0:
        tried_cures = _try_cures(robot, given_motion, {"rate": rate, "differences": differences}, begin)
    if controller is not None:
        # `robot` has the limits of the arm already; the call that is shown states them for the caller's robot.
        arm = f"robot.with_limits({controller.arms[0]!r})"
        tried_cures = [replace(cure, call=cure.call.replace("robot", arm, 1)) for cure in tried_cures]
    verdict: Verdict = "broken"
    words = f"limits are broken at {len(trips)} moments"
    if len(trips) == 0:
        # The check knows no `start`: for it the robot begins where the first command is. A row that it finds broken
        # from there is kept from `start`, or there would be a trip.
        verdict = _verdict_without_trips(checked)
        row_verdicts: list[Verdict] = ["undecided" if row.verdict == "undecided" else "kept" for row in checked.table]
        words = describe_verdict(row_verdicts, checked.judged)
    return Explanation(trips, tuple(tried_cures), tuple(notes), tuple(unpredicted), checked.judged, verdict, words)


def _judge_commands(b: LimitedMotion, begin: np.ndarray | None) -> tuple[JudgedCommands, Check]:
    """Take the differences of commands, and check the commands.

    The differences begin at rest at `begin` (n,), or where the first command is. Values of limits that the check leaves
    undecided are NaN, which is beyond no bound.
    """
    d, checked = take_differences(b, begin), check(b.robot, b.motion)
    assert d is not None  # b.motion consists of commands
    undecided = {(row.limit, row.joint) for row in checked.table if row.verdict == "undecided"}
    limited = {}
    for kind, channel in d.limited.items():
        # A row of the check is undecided only if it is surely broken at no time: its whole column, (N,) of (N, n), is
        # left out.
        left_out = [(kind, name) in undecided for name in channel.names]
        limited[kind] = replace(channel, rates=(np.where(left_out, np.nan, channel.values),))
    return replace(d, limited=limited), checked


def _verdict_without_trips(checked: Check) -> Verdict:
    """Return the verdict on commands that break no limit."""
    return "undecided" if any(row.verdict == "undecided" for row in checked.table) else "kept"


def _find_moments(d: JudgedCommands) -> list[tuple[int, int]]:
    """Find the moments at which limits are broken.

    The result has the first and the last command of each moment; the last few may break no limit. Indices count the
    commands, and go on while the last one is held.
    """
    # A command is broken if it breaks any limit, of any kind, sign or joint: (kinds and signs, N, n) -> (N,).
    beyond = [d.b.scales[kind].beyond(channel.values, sign) for kind, channel in d.limited.items() for sign in SIGNS]
    is_broken = np.any(beyond, axis=(0, 2))
    # A difference of order m takes m commands before its own, so that one fault breaks limits for up to m more
    # commands: each moment is prolonged by m, and those that meet are one.
    order, first_held = d.commands.differences, len(d.commands.t)
    moments = find_runs(np.convolve(is_broken, np.ones(order + 1))[: len(is_broken)] > 0)
    # What is broken while the last command is held has a cause of its own: how the motion ends. It is a moment of its
    # own, unless it began at most 2 m commands before: the end may then be the cause of all of it.
    if is_broken[first_held:].any() and moments[-1][0] < first_held - 2 * order:
        first, last = moments.pop()
        moments += [(first, first_held - 1), (first_held, last)]
    return moments


class _Breach(NamedTuple):
    """A value beyond its limit, at a command.

    The first breach is the smallest one, by its fields in their order: the earliest command, then limits of the motion
    before all others, then the largest ratio. Further fields only decide between equals. `is_force` is true of power
    and motors too.
    """

    command: int
    is_force: bool
    negative_ratio: float
    kind: str
    joint: int
    sign: int


def _describe_trip(d: JudgedCommands, first: int, last: int) -> Trip:
    """Describe the limit that a moment breaks first, and its cause.

    The moment goes from the command `first` to the command `last`.
    """
    breaches = []
    for (kind, channel), sign in product(d.limited.items(), SIGNS):
        scale, values = d.b.scales[kind], channel.values[first : last + 1]
        for i, j in np.argwhere(scale.beyond(values, sign)).tolist():
            ratio = scale.ratio(values[i, [j]], sign, slice(j, j + 1)).item()
            breaches.append(_Breach(first + i, kind not in LIMIT_KINDS.motion, -ratio, kind, j, sign))
    # The trip states the limit that is broken first.
    first_breach = min(breaches)
    # Differences of positions say more of causes than forces, which all joints enter. So the cause is that of a limit
    # of the motion, if one is broken soon enough to come from the same fault.
    motion_breaches = [
        breach
        for breach in breaches
        if not breach.is_force and breach.command <= first_breach.command + d.commands.differences
    ]
    decisive = min(motion_breaches, default=first_breach)
    cause, words = _find_cause(d, decisive.command, decisive.kind, decisive.joint)
    # Only cause and words may be those of another limit: the rest is of the first one.
    kind, j, channel = first_breach.kind, first_breach.joint, d.limited[first_breach.kind]
    force = d.b.limits.of(kind) if kind in LIMIT_KINDS.effort else None
    return Trip(
        joint=channel.names[j],
        limit=LIMIT_KINDS[kind].describe(force),
        t=float(channel.times[first_breach.command]),
        stop=float(channel.times[max(breach.command for breach in breaches)]),
        value=float(channel.values[first_breach.command, j]),
        bound=first_breach.sign * float(d.b.scales[kind].bound(first_breach.sign)[j]),
        unit=channel.units[j],
        ratio=-min(breach.negative_ratio for breach in breaches),
        cause=cause,
        words=words,
    )


def _find_cause(d: JudgedCommands, command: int, kind: str, j: int) -> tuple[str, str]:
    """Find why a command breaks a limit of joint j.

    `kind` is that of the limit. Returns the cause and its words.
    """
    # The limit takes differences of q up to `order`; `differences` has q and all of them, by their orders.
    rate, order, name, differences = d.commands.rate, motion_order(d.b.robot, kind), d.b.name(kind, j), d.q.rates
    # Row 0 of the differences is the rest before the first command.
    row = command + 1
    # Positions are no differences, so that only the path itself takes them out of their range.
    if kind == "position":
        return "position", f"the path of {name} leaves its range"
    # A fault of the stream makes all differences that take its command wrong: no other cause can be read off them.
    stream_fault = _find_stream_fault(d, command, max(order, 1))
    if stream_fault is not None:
        return stream_fault
    # Torque rates are differences of stated torques, where a table states some; positions do not enter them.
    if kind in LIMIT_KINDS.effort[1:] and d.b.motion.torques is not None:
        if command == 0:
            return "start", f"the first torque of {name} is not that of the rest before it"
        step = d.limited[kind].values[command, j] / rate
        return "torque step", f"the commanded torque of {name} changes by {step:.3g} N m or N in one period"
    # Rounding of positions by e makes differences of order m wrong by up to e (2 rate)^m. Row 0 is left out, as a
    # measured start has a rounding of its own.
    rounding_errors = [smoothness.rounding_error(column) for column in differences[0][1:].T]
    if kind in LIMIT_KINDS.motion:
        value, error = float(d.limited[kind].values[command, j]), rounding_errors[j] * (2 * rate) ** order
        # An excess that is smaller than this error may be none.
        excess = abs(value) - d.b.scales[kind].reach(int(np.sign(value)))[j]
        if error > excess:
            return "rounding", f"{name} is rounded: its differences are up to {error:.3g} off; write 17 digits"
        jump = _find_jump(d, row, j, order)
        if jump is not None:
            return jump
        return "too fast", f"the motion itself exceeds the {kind} limit of {name}"
    # Forces take all joints, so that rounding and jumps of any joint count. The last difference but one is the highest
    # that the controller takes, and rounding is largest in it; the last one only serves `_find_jump`.
    highest = len(differences) - 2
    if max(rounding_errors) * (2 * rate) ** highest > MAX_ROUNDING_SHARE_OF_DIFFERENCES * np.abs(differences[-2]).max():
        return "rounding", "positions are rounded, by more than a tenth of their highest difference; write 17 digits"
    # One order more than the limit takes is searched: an acceleration that jumps makes a force jump, and `_find_jump`
    # names no acceleration if that is the highest order.
    jumps = []
    for i in range(len(d.b.joints)):
        jump = _find_jump(d, row, i, min(order + 1, highest))
        if jump is not None:
            jumps.append(jump)
    # A start or an end off the rest is named first. A jump in between is no cause where there is a limit of jerk: that
    # limit lets it pass, or it would be the one that decides.
    candidates = [jump for jump in jumps if jump[0] != "jump"]
    if "jerk" not in d.b.kinds:
        candidates += jumps
    if len(candidates) > 0:
        return candidates[0]
    # The plan is smooth: the force itself, or its rate, is beyond the limit.
    if kind not in LIMIT_KINDS.effort[1:]:
        return "too fast", f"the motion itself exceeds the {LIMIT_KINDS[kind].describe()} limit of {name}"
    # Limits of the motion that are stated are kept near this command: one that is not would be the one that decides.
    why = "nothing else is limited"
    kept_kinds = [other_kind for other_kind in LIMIT_KINDS.motion[1:] if other_kind in d.b.kinds]
    if len(kept_kinds) > 0:
        why = f"limits of {join_names(kept_kinds)} are kept there, and do not prevent it"
    return "torque rate", f"that of {name}; {why}"


def _find_stream_fault(d: JudgedCommands, command: int, order: int) -> tuple[str, str] | None:
    """Find a command that is late, missing or repeated.

    It is sought in the steps that the difference of a command takes, which are as many as its order and end there.
    Returns the cause and its words.
    """
    t, q, rate = d.commands.t, d.commands.q, d.commands.rate
    # Smaller steps (n,) may be rounding: a joint moves where its steps are larger.
    least_steps = MIN_STEPS_TO_SEE * np.array([smoothness.rounding_error(column) for column in q.T])
    # A step is judged by those before and after it, which the first step and the last one do not have.
    for i in range(max(command - order + 1, 2), min(command + 1, len(t) - 1)):
        # These are the steps to the command before, to command i, and to the one after, (n,) each.
        before, step, after = np.diff(q[i - 2 : i + 2], axis=0)
        periods = (t[i] - t[i - 1]) * rate
        if periods > commands.LATE_PERIODS:
            return "late command", f"the command of t = {t[i]:.6g} s comes {periods:.3g} periods after the one before"
        # A command is repeated where no joint steps, and one moves both before and after.
        moves = (np.abs(before) > least_steps) & (np.abs(after) > least_steps)
        if moves.any() and not step.any():
            return "repeated command", f"the command of t = {t[i]:.6g} s repeats the one before, while the robot moves"
        # A command is missing where the step of each joint that moves is that of two periods: the sum of its
        # neighbours, which are alike.
        mismatch = np.maximum(np.abs(step - before - after), np.abs(before - after))[moves]
        if moves.any() and (mismatch < MAX_SKIP_MISMATCH * np.abs(step[moves])).all():
            return "late command", f"before t = {t[i]:.6g} s a command is missing: the step is twice those next to it"
    return None


def _find_jump(d: JudgedCommands, row: int, j: int, order: int) -> tuple[str, str] | None:
    """Find the lowest derivative of joint j that jumps within one difference.

    The difference is that of `order` in a row of `d.q`. Derivatives are compared `order` rows before and after it: the
    former take no command after its first one, the latter none before its last one. Returns the cause and its words.
    """
    left, right = max(row - order, 0), min(row + order, len(d.q.times) - 1)
    # Row 0 is the rest before the first command; rows after that of the last command are those that hold it.
    last_row, name, differences = len(d.commands.t), d.b.joints[j], d.q.rates
    for k in range(order + 1):
        # If the motion is smooth, the k-th derivative changes by at most `drift`, its own derivative times the time
        # between, and by rounding.
        before, after = differences[k][[left, right], j]
        drift = MAX_DRIFT * np.abs(differences[k + 1][[left, right], j]).max() * (right - left) / d.commands.rate
        rounding = ROUNDING_OF_Q * np.abs(differences[0][:, j]).max() * (2 * d.commands.rate) ** k
        if abs(after - before) <= drift + rounding:
            continue
        unit = LIMIT_KINDS[LIMIT_KINDS.motion[k]].unit(joint_units(d.b.robot.mechanism)[j])
        size = f"by {after - before:.4g} {unit}"
        # Next to the rest before the first command or after the last one, position and velocity have to be those of it.
        if left == 0 and k < 2:
            return "start", f"{name} begins off the state before: its {DIFFERENCE_NAMES[k]} jumps {size}"
        if row > last_row and k < 2:
            return "end", f"{name} ends in motion: its {DIFFERENCE_NAMES[k]} jumps {size}"
        # A velocity or acceleration that is limited itself is too large however it is reached: its jump is no cause.
        if k == order and order < LIMIT_KINDS.motion.index("jerk"):
            return None
        return "jump", f"the {DIFFERENCE_NAMES[k]} of {name} jumps {size}"
    return None


def _try_cures(robot: Engine, motion: Motion, options: Mapping[str, Any], begin: np.ndarray | None) -> list[Cure]:
    """Try whether `slowdown` and `retime` keep every limit as commands.

    `options` are the rate and the differences of the controller. The robot begins at rest at `begin`, or where the
    first command is.
    """
    # The call that is shown leaves out what is the default.
    defaults = {"differences": commands.JERK_DIFFERENCE}
    arguments = ", ".join(f"{name}={value:.10g}" for name, value in options.items() if value != defaults.get(name))
    tried_cures = []
    for method in (slowdown, retime):
        method_name, call = method.__name__, f"robot.{method.__name__}(motion, {arguments})"
        # A method that has no result says why, and is a cure that does not work.
        try:
            result = method(robot, motion, **options)
        except JounceError as error:
            tried_cures.append(Cure(method_name, False, str(error), call))
            continue
        words = f"{result.motion.duration:.4g} s instead of {motion.duration:.4g} s"
        if isinstance(result, Slowdown):
            words = f"{result.factor:.4g} times the speed, {words}"
        # Judge the result as the motion was judged, from `begin`, which the methods do not take.
        d, checked = _judge_commands(validate_limits(robot, result.motion.sampled(**options)), begin)
        works = len(_find_moments(d)) == 0
        if not works:
            words += " still break a limit"
        elif _verdict_without_trips(checked) == "undecided":
            words += "; limits that are undecided remain so"
        tried_cures.append(Cure(method_name, works, words, call))
    return tried_cures
