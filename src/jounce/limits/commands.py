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
from jounce.limits.joints import (
    compute_at_speed,
    compute_gravity,
    joint_rates,
    joint_units,
    power_factors,
    scatter_columns,
)
from jounce.limits.limited_motion import LimitedMotion, motion_order
from jounce.limits.samples import limited_values, sum_powers
from jounce.model import positions
from jounce.model.limits import LIMIT_KINDS
from jounce.motion import commands
from jounce.motion.channel import Channel
from jounce.motion.commands import CommandCurve

DIFFERENCE_NAMES = ("position", "velocity", "acceleration", "jerk", "snap")


@dataclass(frozen=True, eq=False)
class JudgedCommands:
    """Commands, and what limits bound of them.

    The last command is held until no difference takes an earlier one. `b` has the kinds that are judged; `q` is q and
    its differences, from the state before the first command on; `limited` is what is compared with limits, by kind, at
    the times at which commands arrive.
    """

    b: LimitedMotion
    commands: CommandCurve
    q: Channel
    limited: Mapping[str, Channel]
    notes: tuple[str, ...]


def take_differences(b: LimitedMotion, start: np.ndarray | None = None) -> JudgedCommands | None:
    """Take the differences of a motion's commands, with their limits.

    Returns None for a motion that does not consist of commands. The robot begins at rest at `start`, or where the first
    command is.
    """
    sampled, m = commands.find_commands(b.motion.curve), b.robot.mechanism
    if sampled is None:
        return None
    if m.floats or b.motion.base_curve is not None or len(positions.multiscrew_joints(m.tree)) > 0:
        raise JounceError(
            f"{m.name!r} moves its base or joints of several screws; a controller's rate is for joints of one screw on"
            f" a fixed base: leave out {cures.option_name('rate')} and {cures.option_name('as_')}"
        )
    period, order = 1 / sampled.rate, sampled.differences
    # Positions (1 + N + order, n): the rest before the first command, the commands, and the last one while it is held,
    # until no difference takes an earlier one.
    first = sampled.q[:1] if start is None else start[None]
    held_q = np.concatenate([first, sampled.q, np.repeat(sampled.q[-1:], order, axis=0)])
    rates = _take_rates(held_q, period, order + 1)
    t = np.append(sampled.t, sampled.t[-1] + period * np.arange(1, order + 1))
    # Before and after the motion, wrenches and the closures of loops are those at its ends.
    within = np.append(t[0], t).clip(b.motion.start, b.motion.stop)
    near, forces, gravity = closed_path.continue_positions(b.robot, b.motion, within), [], []
    if _takes_forces(b):
        # Torques are those of the differences, as a controller computes them, and their rates are differences again.
        states = MotionStates(tuple(rates[:3]), b.motion.wrench(within, 0), None, near)
        forces, gravity = (_take_rates(x, period, len(LIMIT_KINDS.effort) - 1) for x in _take_forces(b, states))
    notes = [f"differences of commands at {sampled.rate:.6g} Hz: {join_names(DIFFERENCE_NAMES[1 : order + 1])}"]
    joints = joint_rates(b.robot, rates, near, b.follow)
    values = limited_values(b.limits, joints[: order + 1], forces, gravity)
    values |= _sum_powers(b, joints, forces)
    # What rounding of positions adds to a bound is no excess: values that close are put on the bound.
    for k, kind in enumerate(LIMIT_KINDS.motion[: order + 1]):
        nearest_kept = values[kind].clip(*b.limits.bounds(kind))
        rounding = np.finfo(float).eps * np.abs(joints[0]).max(axis=0) * (2 * sampled.rate) ** k
        values[kind] = np.where(np.abs(values[kind] - nearest_kept) <= rounding, nearest_kept, values[kind])
    # Torques that the table states are what the controller gets: their rates come before those of the model.
    if len(forces) > 0 and b.motion.torques is not None:
        torque_at_rest = forces[0][0] - gravity[0][0] * ("effort_rate" in b.limits.without_gravity)
        values |= _stated_torque_rates(b, values, torque_at_rest, period)
        notes.append(f"torque rates are differences of the table's torques, taken as {b.limits.of('effort_rate')}")
    # Kinds whose order is above that of the differences are not judged.
    judged = b.select_kinds([kind for kind in b.kinds if kind in values and motion_order(b.robot, kind) <= order])
    unjudged = [kind.replace("_", " ") for kind in b.kinds if kind not in judged.kinds]
    if len(unjudged) > 0:
        words = f"limits of {join_names(unjudged)} are not judged by differences up to order {order}"
        if len(judged.kinds) == 0:
            needed = [motion_order(b.robot, kind) for kind in b.kinds if kind in values or kind in LIMIT_KINDS.motion]
            cure = f"leave out {cures.option_name('rate')}"
            if len(needed) > 0:
                cure = f"raise {cures.option_name('differences')} to {min(needed)}"
            raise JounceError(f"{m.name!r}: {words}, and it has no others; {cure}")
        notes.append(words)
    # Without the row of the rest before the first command.
    limited = {kind: judged.bounded(kind, t, values[kind][1:]) for kind in judged.kinds}
    q = Channel("q", b.joints, tuple(joint_units(m)), np.append(t[0] - period, t), joints)
    return JudgedCommands(judged, sampled, q, limited, tuple(notes))


def take_rest(d: JudgedCommands) -> dict[str, np.ndarray]:
    """Evaluate what limits bound where the robot rests at commands.

    The values are (N, joints).
    """
    b, t = d.b, d.q.times[1:]
    within = t.clip(b.motion.start, b.motion.stop)
    # The last command is held, as in `take_differences`; all rates are 0.
    q = np.concatenate([d.commands.q, np.repeat(d.commands.q[-1:], len(t) - len(d.commands.q), axis=0)])
    near, rates = closed_path.continue_positions(b.robot, b.motion, within), (q, *[0 * q] * (len(d.q.rates) - 1))
    forces: Sequence[np.ndarray] = ()
    gravity: Sequence[np.ndarray] = ()
    if _takes_forces(b):
        at_rest = _take_forces(b, MotionStates(rates[:3], b.motion.wrench(within, 0), None, near))
        forces, gravity = ([x, *[0 * x] * (len(LIMIT_KINDS.effort) - 1)] for x in at_rest)
    joints = joint_rates(b.robot, rates, near, b.follow)
    values = limited_values(b.limits, joints, forces, gravity) | _sum_powers(b, joints, forces)
    return {kind: values[kind] for kind in b.kinds}


def _takes_forces(b: LimitedMotion) -> bool:
    """Whether limits take forces of joints, or sums of their powers."""
    m = b.robot.mechanism
    return any(LIMIT_KINDS[kind].force or "effort" in power_factors(m, kind) for kind in b.kinds)


def _sum_powers(b: LimitedMotion, joints: Sequence[np.ndarray], forces: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Return the sums over all joints that limits bound, by kind."""
    return sum_powers(b.robot.mechanism, {"effort": forces[0], "velocity": joints[1]}) if len(forces) > 0 else {}


def _take_forces(b: LimitedMotion, states: MotionStates) -> tuple[np.ndarray, np.ndarray]:
    """Compute Q and Qgrav (N, joints) at some states."""
    Q, G = compute_at_speed(b.robot, states, b.efforts, 0), compute_gravity(b.robot, states, 0)
    return scatter_columns(b.robot.mechanism, Q, b.efforts)[0], scatter_columns(b.robot.mechanism, G, b.efforts)[0]


def _take_rates(values: np.ndarray, period: float, count: int) -> list[np.ndarray]:
    """Return values (N, k) and as many backward differences.

    They begin at the rest before the first command: the first difference is 0.
    """
    rates = [values]
    for _ in range(count):
        rates.append(np.diff(rates[-1], axis=0, prepend=rates[-1][:1]) / period)
    return rates


def _stated_torque_rates(
    b: LimitedMotion, values: Mapping[str, np.ndarray], torque_at_rest: np.ndarray, period: float
) -> dict[str, np.ndarray]:
    """Return the rates of the torques that a table of commands states.

    They begin at the torque at rest, (joints,). Where the table states none, they are those of the model.
    """
    assert b.motion.torques is not None
    # As positions: the rest before the first torque, and the last one while it is held.
    tau = b.motion.torques[1]
    count_held = len(next(iter(values.values()))) - 1 - len(tau)
    held_tau = np.concatenate([torque_at_rest[None], tau, np.repeat(tau[-1:], count_held, axis=0)])
    rates = dict(zip(LIMIT_KINDS.effort, _take_rates(held_tau, period, len(LIMIT_KINDS.effort) - 1), strict=True))
    return {
        kind: np.where(np.isnan(rates[kind]), values[kind], rates[kind])
        for kind in LIMIT_KINDS.effort[1:]
        if kind in values
    }
