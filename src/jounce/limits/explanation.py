"""`explain` says why a controller stops a motion: which limit its commands break, when, for which cause, and the cure.

A controller judges differences of commands at its own rate (`commands.take_differences`). A moment is a run of commands
at which any of these differences is beyond its limit, runs a few periods apart being one (`_find_moments`). For each
moment a `Trip` states the limit that is broken first. Its cause is sought at the command that decides, in this order
(`_find_cause`):

1. the path leaves a range of positions;
2. the stream: a command comes late, is missing, or repeats the one before;
3. torques that a table of commands states: they begin off the rest before, or step;
4. rounding: positions of few digits make differences of high order noisy;
5. jumps: a low derivative jumps where the motion starts, ends or in between;
6. the plan: its derivative, torque rate or force is beyond the limit by itself.

Causes of the plan have cures: `slowdown` and `retime` at the same rate are tried, and judged as the motion was.
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

MAX_DRIFT = 1.5  # times what the derivative on either side of a moment makes of it: a larger change is a jump
MIN_STEPS_TO_SEE = 8  # times the rounding of positions: of smaller steps none is seen to be missing
MAX_ROUNDING_SHARE_OF_DIFFERENCES = 0.1  # of the largest one: more of it enters torque rates
MAX_SKIP_MISMATCH = 0.2  # of a velocity that is the sum of those next to it, where a command is missing
PLAN_CAUSES = ("jump", "torque rate", "too fast")  # those that another time law can cure


@dataclass(frozen=True)
class Controller:
    """What is public of a controller.

    `rate` is in Hz, `arms` are those with a table of limits, and `unpredicted` is what nobody predicts, in words.
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

    The arm is the first of the controller's arms whose name is part of a joint's name: its limits are used.
    """
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

    `joint` and `limit` are those of the first limit that is broken, from `t` to `stop`, s, with its value and bound.
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
    """Whether a method at the controller's rate keeps every limit.

    The method is `slowdown` or `retime`; `words` say factor and duration, or why it does not work. `call` is the call
    of Python, of `robot` and `motion`, whose result is so.
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
        if len(self.trips) == 0:
            return f"<Explanation: {self.words}>"
        first = self.trips[0]
        return f"<Explanation: {self.words}, first at t = {first.t:g} s: {first.words}>"


@stage("explanation")
def explain(
    robot: Engine, motion: Motion, rate: float, differences: int, start: object, controller: Controller | None = None
) -> Explanation:
    """Explain why a controller stops a motion.

    `robot` has the limits of the controller. It begins at rest at `start` (n,), or where the first command is.
    """
    given_motion = along.check_motion(robot.mechanism, motion)
    b = validate_limits(robot, given_motion.sampled(rate, differences))
    begin = None if start is None else np.asarray(array_by_name(start, robot.joint_names, "start"), dtype=float)
    if begin is not None and (begin.shape != (robot.n,) or not np.isfinite(begin).all()):
        expected = f"{robot.n} positions: {join_names(robot.joint_names)}"
        raise JounceError(f"start is {quote_value(start)}; expected {expected}")
    # Judge the commands, and explain each moment at which a limit is broken.
    d, checked = _judge_commands(b, begin)
    trips = tuple(_describe_trip(d, *span) for span in _find_moments(d))
    # Notes: how the motion was judged, and which causes no other time law cures.
    notes = [*b.motion.notes, *checked.notes]
    if controller is not None:
        notes.append(f"limits of {join_names(controller.arms)}, of {controller.source}")
    incurable = list(dict.fromkeys(trip.cause for trip in trips if trip.cause not in PLAN_CAUSES))
    if len(incurable) > 0:
        notes.append(f"slowdown and retime do not help against: {join_names(incurable)}")
    # What nobody knows before the run: the controller's own steps, and what the caller did not state.
    unpredicted = [] if controller is None else [*controller.unpredicted]
    if begin is None:
        cure = f"{cures.option_name('start')} states its position"
        unpredicted.append(f"whether the robot rests where the first command is: {cure}")
    if b.motion.torques is None:
        unpredicted.append(
            f"torques of feedback: {cures.option_name('torques')} reads those that a table of commands states"
        )
    # Cures are tried only where the plan is the only cause.
    tried: list[Cure] = []
    if len(trips) > 0 and len(incurable) == 0:
        tried = _try_cures(robot, given_motion, {"rate": rate, "differences": differences}, begin)
    if controller is not None:
        # `robot` has the limits of the arm already; the call that is shown states them for the caller's robot.
        arm = f"robot.with_limits({controller.arms[0]!r})"
        tried = [replace(cure, call=cure.call.replace("robot", arm, 1)) for cure in tried]
    verdict: Verdict = "broken"
    words = f"limits are broken at {len(trips)} moments"
    if len(trips) == 0:
        # The check lets the robot begin where the first command is. A row that it finds broken there, and that has no
        # trip, is kept from `start`.
        verdict = _verdict_without_trips(checked)
        row_verdicts: list[Verdict] = ["undecided" if row.verdict == "undecided" else "kept" for row in checked.table]
        words = describe_verdict(row_verdicts, checked.judged)
    return Explanation(trips, tuple(tried), tuple(notes), tuple(unpredicted), checked.judged, verdict, words)


def _judge_commands(b: LimitedMotion, begin: np.ndarray | None) -> tuple[JudgedCommands, Check]:
    """Take the differences of commands, and check the commands.

    The differences begin where the robot begins. Values of limits that the check leaves undecided are NaN, which is
    beyond no bound.
    """
    d, checked = take_differences(b, begin), check(b.robot, b.motion)
    assert d is not None  # b.motion consists of commands
    undecided = {(row.limit, row.joint) for row in checked.table if row.verdict == "undecided"}
    limited = {}
    for kind, channel in d.limited.items():
        # Which columns are left out, (n,); values are (N, n).
        left_out = [(kind, name) in undecided for name in channel.names]
        limited[kind] = replace(channel, rates=(np.where(left_out, np.nan, channel.values),))
    return replace(d, limited=limited), checked


def _verdict_without_trips(checked: Check) -> Verdict:
    """Return the verdict on commands that break no limit."""
    return "undecided" if any(row.verdict == "undecided" for row in checked.table) else "kept"


def _find_moments(d: JudgedCommands) -> list[tuple[int, int]]:
    """Find the moments at which limits are broken.

    The result has the first and the last command of each moment. Indices are those of the commands, and of the last one
    while it is held.
    """
    # At which commands any limit is broken, of any kind, sign or joint: (kinds and signs, N, n) -> (N,).
    beyond = [d.b.scales[kind].beyond(channel.values, sign) for kind, channel in d.limited.items() for sign in SIGNS]
    is_broken = np.any(beyond, axis=(0, 2))
    # A difference of order m takes m commands before its own, so that one fault breaks limits for up to m more
    # commands: each moment is prolonged by m, and those that meet are one.
    reach, end = d.commands.differences, len(d.commands.t)
    moments = find_runs(np.convolve(is_broken, np.ones(reach + 1))[: len(is_broken)] > 0)
    # What is broken while the last command is held has a cause of its own: how the motion ends. It is a moment of its
    # own, unless it began so shortly before that the end may be the cause of all of it.
    if is_broken[end:].any() and moments[-1][0] < end - 2 * reach:
        first, last = moments.pop()
        moments += [(first, end - 1), (end, last)]
    return moments


class _Breach(NamedTuple):
    """A value beyond its limit, at a command.

    Fields are in the order by which the first one is found: the earliest command, limits of the motion before those of
    forces, and the largest ratio.
    """

    command: int
    is_force: bool
    negative_ratio: float
    kind: str
    joint: int
    sign: int


def _describe_trip(d: JudgedCommands, first: int, last: int) -> Trip:
    """Describe what is broken from one command to another: the first limit, and the cause."""
    breaches = []
    for (kind, channel), sign in product(d.limited.items(), SIGNS):
        scale, values = d.b.scales[kind], channel.values[first : last + 1]
        for i, j in np.argwhere(scale.beyond(values, sign)).tolist():
            ratio = scale.ratio(values[i, [j]], sign, slice(j, j + 1)).item()
            breaches.append(_Breach(first + i, kind not in LIMIT_KINDS.motion, -ratio, kind, j, sign))
    # The trip states the limit that is broken first.
    shown = min(breaches)
    # The cause is that of a limit of the motion, if one is broken soon enough to come from the same fault: differences
    # of positions say more of causes than forces, which all joints enter.
    near = [
        breach
        for breach in breaches
        if not breach.is_force and breach.command <= shown.command + d.commands.differences
    ]
    decisive = min(near, default=shown)
    cause, words = _find_cause(d, decisive.command, decisive.kind, decisive.joint)
    kind, j, channel = shown.kind, shown.joint, d.limited[shown.kind]
    force = d.b.limits.of(kind) if kind in LIMIT_KINDS.effort else None
    return Trip(
        joint=channel.names[j],
        limit=LIMIT_KINDS[kind].describe(force),
        t=float(channel.times[shown.command]),
        stop=float(channel.times[max(breach.command for breach in breaches)]),
        value=float(channel.values[shown.command, j]),
        bound=shown.sign * float(d.b.scales[kind].bound(shown.sign)[j]),
        unit=channel.units[j],
        ratio=-min(breach.negative_ratio for breach in breaches),
        cause=cause,
        words=words,
    )


def _find_cause(d: JudgedCommands, k: int, kind: str, j: int) -> tuple[str, str]:
    """Find why command k breaks a limit of joint j.

    Returns the cause and its words.
    """
    rate, order, name, rates = d.commands.rate, motion_order(d.b.robot, kind), d.b.joints[j], d.q.rates
    # Differences begin with the rest before the first command: those of command k are in row k + 1.
    row = k + 1
    if kind == "position":
        return "position", f"the path of {name} leaves its range"
    # A fault of the stream makes all differences that take its command wrong: it comes before any other cause.
    stream_fault = _find_stream_fault(d, k, max(order, 1))
    if stream_fault is not None:
        return stream_fault
    # Torque rates are differences of stated torques, where a table states some; positions do not enter them.
    if kind in LIMIT_KINDS.effort[1:] and d.b.motion.torques is not None:
        if k == 0:
            return "start", f"the first torque of {name} is not that of the rest before it"
        step = d.limited[kind].values[k, j] / rate
        return "torque step", f"the commanded torque of {name} changes by {step:.3g} N m or N in one period"
    # Rounding of positions by e makes differences of order m wrong by up to e (2 rate)^m.
    rounding = [smoothness.rounding_error(column) for column in rates[0][1:].T]
    if kind in LIMIT_KINDS.motion:
        value, error = float(d.limited[kind].values[k, j]), rounding[j] * (2 * rate) ** order
        # An excess that is smaller than this error may be none.
        excess = abs(value) - d.b.scales[kind].reach(int(np.sign(value)))[j]
        if error > excess:
            return "rounding", f"{name} is rounded: its differences are up to {error:.3g} off; write 17 digits"
        jump = _find_jump(d, row, j, order)
        if jump is not None:
            return jump
        return "too fast", f"the motion itself exceeds the {kind} limit of {name}"
    # Forces take all joints. The last difference but one is the highest that the controller takes; the last one only
    # serves `_find_jump`.
    if max(rounding) * (2 * rate) ** (len(rates) - 2) > MAX_ROUNDING_SHARE_OF_DIFFERENCES * np.abs(rates[-2]).max():
        return "rounding", "positions are rounded, by more than a tenth of their highest difference; write 17 digits"
    jumps = []
    for i in range(len(d.b.joints)):
        jump = _find_jump(d, row, i, min(order + 1, len(rates) - 2))
        if jump is not None:
            jumps.append(jump)
    # A start or an end off the rest is named first. A jump in between that a limit of jerk lets pass is not the cause.
    candidates = [jump for jump in jumps if jump[0] != "jump"]
    if "jerk" not in d.b.kinds:
        candidates += jumps
    if len(candidates) > 0:
        return candidates[0]
    # The plan is smooth: the force itself, or its rate, is beyond the limit.
    if kind not in LIMIT_KINDS.effort[1:]:
        return "too fast", f"the motion itself exceeds the {LIMIT_KINDS[kind].describe()} limit of {name}"
    why = "nothing else is limited"
    kept_kinds = [kind for kind in LIMIT_KINDS.motion[1:] if kind in d.b.kinds]
    if len(kept_kinds) > 0:
        why = f"limits of {join_names(kept_kinds)} are kept there, and do not prevent it"
    return "torque rate", f"that of {name}; {why}"


def _find_stream_fault(d: JudgedCommands, k: int, order: int) -> tuple[str, str] | None:
    """Find a command that is late, missing or repeated.

    It is sought among the commands that the difference of command k takes, which are as many before k as its order.
    """
    t, q, rate = d.commands.t, d.commands.q, d.commands.rate
    # Smaller steps (n,) may be rounding: a joint moves where its steps are larger.
    least = MIN_STEPS_TO_SEE * np.array([smoothness.rounding_error(column) for column in q.T])
    for i in range(max(k - order + 1, 2), min(k + 1, len(t) - 1)):
        # The steps to the command before, to command i, and to the one after, (n,) each.
        before, step, after = np.diff(q[i - 2 : i + 2], axis=0)
        periods = (t[i] - t[i - 1]) * rate
        if periods > commands.LATE_PERIODS:
            return "late command", f"the command of t = {t[i]:.6g} s comes {periods:.3g} periods after the one before"
        # A repeated command: no joint steps, and one moves both before and after.
        moves = (np.abs(before) > least) & (np.abs(after) > least)
        if moves.any() and not step.any():
            return "repeated command", f"the command of t = {t[i]:.6g} s repeats the one before, while the robot moves"
        # A missing command: the step of each joint that moves is that of two periods, the sum of its neighbours, and
        # these are alike.
        mismatch = np.maximum(np.abs(step - before - after), np.abs(before - after))[moves]
        if moves.any() and (mismatch < MAX_SKIP_MISMATCH * np.abs(step[moves])).all():
            return "late command", f"before t = {t[i]:.6g} s a command is missing: the step is twice those next to it"
    return None


def _find_jump(d: JudgedCommands, row: int, j: int, order: int) -> tuple[str, str] | None:
    """Find the lowest derivative of joint j that jumps within one difference.

    The difference is that in a row of `d.q`, of the given order. Derivatives are compared as many rows before and after
    it, which is beyond all commands that it takes.
    """
    left, right = max(row - order, 0), min(row + order, len(d.q.times) - 1)
    last, name, rates = len(d.commands.t), d.b.joints[j], d.q.rates
    for k in range(order + 1):
        # The k-th derivative changes by its own derivative times the time between, which is not more than `drift` if
        # the motion is smooth; and by rounding.
        before, after = rates[k][[left, right], j]
        drift = MAX_DRIFT * np.abs(rates[k + 1][[left, right], j]).max() * (right - left) / d.commands.rate
        rounding = ROUNDING_OF_Q * np.abs(rates[0][:, j]).max() * (2 * d.commands.rate) ** k
        if abs(after - before) <= drift + rounding:
            continue
        unit = LIMIT_KINDS[LIMIT_KINDS.motion[k]].unit(joint_units(d.b.robot.mechanism)[j])
        size = f"by {after - before:.4g} {unit}"
        # Next to the rest before the first command or after the last one, position and velocity have to be those of it.
        if left == 0 and k < 2:
            return "start", f"{name} begins off the state before: its {DIFFERENCE_NAMES[k]} jumps {size}"
        if row > last and k < 2:
            return "end", f"{name} ends in motion: its {DIFFERENCE_NAMES[k]} jumps {size}"
        # A limited derivative below the jerk that changes this fast is beyond its limit by itself; that is no jump.
        if k == order and order < LIMIT_KINDS.motion.index("jerk"):
            return None
        return "jump", f"the {DIFFERENCE_NAMES[k]} of {name} jumps {size}"
    return None


def _try_cures(robot: Engine, motion: Motion, options: Mapping[str, Any], begin: np.ndarray | None) -> list[Cure]:
    """Try whether other time laws keep every limit as commands.

    The laws are those of `slowdown` and `retime`. `options` are the rate and the differences of the controller; the
    robot begins at rest at `begin`.
    """
    # The call that is shown leaves out what is the default.
    defaults = {"differences": commands.JERK_DIFFERENCE}
    arguments = ", ".join(f"{name}={value:.10g}" for name, value in options.items() if value != defaults.get(name))
    tried = []
    for law in (slowdown, retime):
        method, call = law.__name__, f"robot.{law.__name__}(motion, {arguments})"
        try:
            result = law(robot, motion, **options)
        except JounceError as error:
            tried.append(Cure(method, False, str(error), call))
            continue
        words = f"{result.motion.duration:.4g} s instead of {motion.duration:.4g} s"
        if isinstance(result, Slowdown):
            words = f"{result.factor:.4g} times the speed, {words}"
        # Judge the result as the motion was judged, from where the robot begins.
        d, checked = _judge_commands(validate_limits(robot, result.motion.sampled(**options)), begin)
        works = len(_find_moments(d)) == 0
        if not works:
            words += " still break a limit"
        elif _verdict_without_trips(checked) == "undecided":
            words += "; limits that are undecided remain so"
        tried.append(Cure(method, works, words, call))
    return tried
