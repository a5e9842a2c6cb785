"""Moments and causes of trips, from differences that are given: of a small arm whose second joint rests."""

from types import SimpleNamespace

import numpy as np
import pytest

import jounce
from jounce.limits import explanation
from jounce.limits.commands import JudgedCommands, _take_rates
from jounce.limits.limited_motion import validate_limits
from jounce.model.limits import LIMIT_KINDS
from jounce.motion.channel import Channel

RATE = 100.0  # Hz
ARM = jounce.load("planar2r")
STILL = jounce.Motion.polynomial([[0.0], [0.0]], 1.0)


def differences_of(*q, beyond=(), **limits):
    """Third differences of commands of joints, and values of a kind at commands `beyond`, (kind, commands), twice 1."""
    b = validate_limits(ARM.with_limits(**limits), STILL)
    commands = np.transpose([*q, 0 * q[0]][:2])
    held = np.concatenate([commands[:1], commands, np.repeat(commands[-1:], 3, axis=0)])
    rates, t = tuple(_take_rates(held, 1 / RATE, 4)), np.arange(len(commands) + 3) / RATE
    values = {kind: rate[1:].copy() for kind, rate in zip(LIMIT_KINDS.motion, rates, strict=True) if kind in b.kinds}
    values |= {kind: np.zeros((len(t), 2)) for kind in b.kinds if kind not in values}
    for kind, which in beyond:
        values[kind][list(which), 0] = 2.0
    stream = SimpleNamespace(t=t[:-3], q=commands, rate=RATE, differences=3)
    q = Channel("q", b.joints, ("rad",) * 2, np.append(-1 / RATE, t), rates)
    return JudgedCommands(b, stream, q, {kind: b.bounded(kind, t, x) for kind, x in values.items()}, ())


REST, T = np.zeros(40), np.arange(40) / RATE  # 40 commands, and then three while the last one is held


@pytest.mark.parametrize(("first", "moments"), [(34, [(34, 42)]), (33, [(33, 39), (40, 42)]), (40, [(40, 42)])])
def test_what_the_held_command_breaks_is_a_moment_of_its_own(first, moments):
    """Where the moment before it began more than twice three commands before."""
    d = differences_of(REST, beyond=[("effort_rate", range(first, 41))], effort_rate=1.0)
    assert explanation._find_moments(d) == moments


@pytest.mark.parametrize(("later", "cause"), [(3, "too fast"), (4, "torque rate")])
def test_a_motion_limit_broken_three_commands_later_decides(later, cause):
    beyond = [("effort_rate", [10]), ("acceleration", [10 + later])]
    d = differences_of(REST, beyond=beyond, effort_rate=1.0, acceleration=1.0)
    trip = explanation._describe_trip(d, 10, 10 + later)
    assert (trip.limit, trip.t, trip.stop, trip.cause) == ("effort rate", 0.1, 0.1 + later / RATE, cause)


@pytest.mark.parametrize(("share", "cause"), [(0.15, "rounding"), (0.06, "torque rate")])
def test_rounding_above_a_tenth_of_the_highest_difference_decides(share, cause):
    """Positions are in steps of 1e-9 rad, which make third differences of up to 0.004 rad/s^3."""
    t = np.arange(101) / RATE
    q = 0.004 * (1 / share - 1) / 60 * (10 * t**3 - 15 * t**4 + 6 * t**5)
    d = differences_of(q.round(9), effort_rate=1.0)
    assert explanation._find_cause(d, 2, "effort_rate", 0)[0] == cause


def test_a_joint_in_motion_is_named_before_one_that_jumps():
    d = differences_of(T**2 / 2, T, effort_rate=1.0)
    start = "start", "joint2 begins off the state before: its velocity jumps by 1 rad/s"
    assert explanation._find_cause(d, 1, "effort_rate", 0) == start


@pytest.mark.parametrize(("limits", "cause"), [({}, "jump"), ({"jerk": 1e9}, "torque rate")])
def test_a_jump_that_a_limit_of_jerk_lets_pass_is_not_the_cause(limits, cause):
    d = differences_of((T - 0.2).clip(0) ** 2, effort_rate=1.0, **limits)
    assert explanation._find_cause(d, 21, "effort_rate", 0)[0] == cause


@pytest.mark.parametrize(
    ("q", "cause", "words"),
    [
        (T**2 / 2, "jump", "the acceleration of joint1 jumps by 1 rad/s^2"),
        (T, "start", "joint1 begins off the state before: its velocity jumps by 1 rad/s"),
    ],
)
def test_a_start_is_in_motion_by_its_velocity_alone(q, cause, words):
    assert explanation._find_cause(differences_of(q, jerk=1.0), 1, "jerk", 0) == (cause, words)


@pytest.mark.parametrize(("share", "cause"), [(0.7, "too fast"), (1.5, "jump")])
def test_rounding_of_positions_makes_no_jump_of_the_velocity(share, cause):
    """After a spike at 0.2 s the joint goes on at a velocity that rounding makes in a period, or at a larger one."""
    i = np.arange(40)
    q = 2.0 + 0.01 * (i == 20) + share * explanation.ROUNDING_OF_Q * 4 * (i > 20) * (i - 20)
    assert explanation._find_cause(differences_of(q, jerk=1.0), 21, "jerk", 0)[0] == cause


def test_cures_are_tried_of_plans_that_break_a_limit(monkeypatch):
    cure = explanation.Cure("slowdown", True, "", "")
    monkeypatch.setattr(explanation, "_try_cures", lambda *_: [cure])
    motion = jounce.Motion.polynomial([[0, 0, 0, 1, -1.5, 0.6], np.zeros(6)], 1.0)
    cures = [ARM.with_limits(acceleration=x).explain(motion, rate=RATE).cures for x in (0.1, 9.0)]
    assert cures == [(cure,), ()]


@pytest.mark.parametrize(("limits", "words"), [({}, "s"), ({"jerk": [9, 0]}, "; limits that are undecided remain so")])
def test_cures_say_what_stays_undecided(monkeypatch, limits, words):
    def slowdown(*_, **__):
        return SimpleNamespace(motion=STILL)

    monkeypatch.setattr(explanation, "slowdown", slowdown)
    monkeypatch.setattr(explanation, "retime", slowdown)
    robot, options = ARM.with_limits(velocity=1.0, **limits), {"rate": RATE, "differences": 3}
    for cure in explanation._try_cures(robot, STILL, options, None):
        assert (cure.works, cure.words) == (True, f"1 s instead of 1 {'s' * bool(limits)}{words}")
