"""Commands as a controller judges them: backward differences at its own rate, in place of derivatives.

libfranka's rate limiting takes v_k = (q_k - q_k-1) / T, a_k = (v_k - v_k-1) / T, j_k = (a_k - a_k-1) / T and, of torque
commands, (tau_k - tau_k-1) / T, each with the period T = 1 ms, whenever a command arrives [1]. The robot is at rest
before the first command, and it holds the last one.

A difference of order m is the mean of the m-th derivative, weighted by a B-spline of m periods: a motion that keeps its
limits of velocity, acceleration and jerk keeps them as commands too; one that breaks a limit for less than m periods
may keep it as commands.

[1] libfranka, src/rate_limiting.cpp (commit 16d7d166, 2023) and include/franka/rate_limiting.h.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core import cures
from jounce.core.errors import JounceError, join_names
from jounce.engine import closed_path
from jounce.engine.motion_states import MotionStates
from jounce.limits.joints import compute_at_speed, compute_gravity, joint_rates, joint_units, scatter_columns
from jounce.limits.limited_motion import LimitedMotion, motion_order
from jounce.limits.samples import limited_values
from jounce.model import positions
from jounce.model.limits import LIMIT_KINDS
from jounce.motion import commands
from jounce.motion.channel import Channel
from jounce.motion.commands import CommandCurve

DIFFERENCE_NAMES = ("position", "velocity", "acceleration", "jerk", "snap")


@dataclass(frozen=True, eq=False)
class JudgedCommands:
    """What limits bound of commands, and of the last one while it is held.

    `b` has the kinds that are judged; `q` is q and its differences, from the state before the first command on;
    `limited` is what is compared with limits, by kind, at the times at which commands arrive.
    """

    b: LimitedMotion
    commands: CommandCurve
    q: Channel
    limited: Mapping[str, Channel]
    notes: tuple[str, ...]


def take_differences(b: LimitedMotion, start: np.ndarray | None = None) -> JudgedCommands | None:
    """The differences of a motion that consists of commands; None for another. The robot begins at rest at `start`."""
    sampled, m = commands.find_commands(b.motion.curve), b.robot.mechanism
    if sampled is None:
        return None
    if m.floats or b.motion.base_curve or positions.multiscrew_joints(m.tree):
        raise JounceError(
            f"{m.name!r} moves its base or joints of several screws; a controller's rate is for joints of one screw on"
            f" a fixed base: leave out {cures.option_name('rate')} and {cures.option_name('as_')}"
        )
    period, order = 1 / sampled.rate, sampled.differences
    first = sampled.q[:1] if start is None else start[None]
    held = np.concatenate([first, sampled.q, np.repeat(sampled.q[-1:], order, axis=0)])
    rates = _take_rates(held, period, order + 1)
    t = np.append(sampled.t, sampled.t[-1] + period * np.arange(1, order + 1))
    within = np.append(t[0], t).clip(b.motion.start, b.motion.stop)  # as the world is then that the robot meets
    near, forces, gravity = closed_path.continue_positions(b.robot, b.motion, within), [], []
    if any(LIMIT_KINDS[kind].force for kind in b.kinds):
        states = MotionStates(tuple(rates[:3]), b.motion.wrench(within, 0), None, near)
        forces, gravity = (_take_rates(x, period, len(LIMIT_KINDS.effort) - 1) for x in _take_forces(b, states))
    notes = [f"differences of commands at {sampled.rate:.6g} Hz: {join_names(DIFFERENCE_NAMES[1 : order + 1])}"]
    joints = joint_rates(b.robot, rates, near, b.follow)
    values = limited_values(b.limits, joints[: order + 1], forces, gravity)
    for k, kind in enumerate(LIMIT_KINDS.motion[: order + 1]):  # what rounding adds to a bound is no excess
        kept = values[kind].clip(*b.limits.bounds(kind))
        off = np.finfo(float).eps * np.abs(joints[0]).max(axis=0) * (2 * sampled.rate) ** k
        values[kind] = np.where(np.abs(values[kind] - kept) <= off, kept, values[kind])
    if forces and b.motion.torques:
        rest = forces[0][0] - gravity[0][0] * ("effort_rate" in b.limits.without_gravity)
        values |= _stated_torque_rates(b, values, rest, period)
        notes.append(f"torque rates are differences of the table's torques, taken as {b.limits.of('effort_rate')}")
    judged = b.select_kinds([kind for kind in b.kinds if kind in values and motion_order(b.robot, kind) <= order])
    if left := [kind.replace("_", " ") for kind in b.kinds if kind not in judged.kinds]:
        words = f"limits of {join_names(left)} are not judged by differences up to order {order}"
        if not judged.kinds:
            needed = [motion_order(b.robot, kind) for kind in b.kinds if kind in values or kind in LIMIT_KINDS.motion]
            cure = (
                f"raise {cures.option_name('differences')} to {min(needed)}"
                if needed
                else f"leave out {cures.option_name('rate')}"
            )
            raise JounceError(f"{m.name!r}: {words}, and it has no others; {cure}")
        notes.append(words)
    limited = {kind: judged.bounded(kind, t, values[kind][1:]) for kind in judged.kinds}
    q = Channel("q", b.joints, tuple(joint_units(m)), np.append(t[0] - period, t), joints)
    return JudgedCommands(judged, sampled, q, limited, tuple(notes))


def take_rest(d: JudgedCommands) -> dict[str, np.ndarray]:
    """What limits bound, by kind, (N, joints), where the robot rests at each of its commands."""
    b, t = d.b, d.q.times[1:]
    within = t.clip(b.motion.start, b.motion.stop)
    q = np.concatenate([d.commands.q, np.repeat(d.commands.q[-1:], len(t) - len(d.commands.q), axis=0)])
    near, rates = closed_path.continue_positions(b.robot, b.motion, within), (q, *[0 * q] * (len(d.q.rates) - 1))
    forces: Sequence[np.ndarray] = ()
    gravity: Sequence[np.ndarray] = ()
    if any(LIMIT_KINDS[kind].force for kind in b.kinds):
        both = _take_forces(b, MotionStates(rates[:3], b.motion.wrench(within, 0), None, near))
        forces, gravity = ([x, *[0 * x] * (len(LIMIT_KINDS.effort) - 1)] for x in both)
    values = limited_values(b.limits, joint_rates(b.robot, rates, near, b.follow), forces, gravity)
    return {kind: values[kind] for kind in b.kinds}


def _take_forces(b: LimitedMotion, states: MotionStates) -> tuple[np.ndarray, np.ndarray]:
    """Q and Qgrav (N, joints) at some states."""
    Q, G = compute_at_speed(b.robot, states, b.efforts, 0), compute_gravity(b.robot, states, 0)
    return scatter_columns(b.robot.mechanism, Q, b.efforts)[0], scatter_columns(b.robot.mechanism, G, b.efforts)[0]


def _take_rates(values: np.ndarray, period: float, count: int) -> list[np.ndarray]:
    """Values (N, k) and `count` differences, which begin at the rest before the first command."""
    found = [values]
    for _ in range(count):
        found.append(np.diff(found[-1], axis=0, prepend=found[-1][:1]) / period)
    return found


def _stated_torque_rates(
    b: LimitedMotion, values: Mapping[str, np.ndarray], rest: np.ndarray, period: float
) -> dict[str, np.ndarray]:
    """The rates of the torques that a table of commands states, from `rest` (joints,) on; the model's without any."""
    assert b.motion.torques is not None
    stated = b.motion.torques[1]
    more = len(next(iter(values.values()))) - 1 - len(stated)
    whole = np.concatenate([rest[None], stated, np.repeat(stated[-1:], more, axis=0)])
    rates = dict(zip(LIMIT_KINDS.effort, _take_rates(whole, period, len(LIMIT_KINDS.effort) - 1), strict=True))
    return {
        kind: np.where(np.isnan(rates[kind]), values[kind], rates[kind])
        for kind in LIMIT_KINDS.effort[1:]
        if kind in values
    }
