"""Limits of swings, twists and places along a motion whose values are known in closed form."""

import numpy as np
import pytest

import jounce
from jounce.model import positions
from support.leg_and_cart import AXIS, leg_and_cart, swinging
from support.refusals import expect_refusal, refusal

ROBOT = leg_and_cart()
SWING = np.arccos(np.cos(1.6) + (1 - np.cos(1.6)) * AXIS[2] ** 2)  # of a turn of 1.6 rad about AXIS
TWIST = 2 * np.arctan(AXIS[2] * np.tan(0.8))


def test_a_cone_and_a_twist_are_checked_between_samples_too():
    robot = ROBOT.with_limits(
        lower={"ankle.twist": -0.2}, upper={"ankle.swing": 0.5, "ankle.angle": 2.0, "ankle.twist": 1.3, "deck.x": 1.5}
    )
    found = {row.joint: row for row in robot.check(swinging()).table if row.limit == "position"}
    for joint, value in (("ankle.swing", SWING), ("ankle.angle", 1.6), ("ankle.twist", TWIST), ("deck.x", 1.6)):
        assert found[joint].value == pytest.approx(value, abs=1e-9)
        assert found[joint].t == pytest.approx(np.pi, abs=1e-4)
    broken = [joint for joint, row in found.items() if row.verdict == "broken"]
    assert broken == ["ankle.swing", "ankle.twist", "deck.x"]
    [(start, stop)] = found["deck.x"].violations
    assert (start, stop) == pytest.approx((np.arccos(1 - 1.5 / 0.8), 2 * np.pi - np.arccos(1 - 1.5 / 0.8)), abs=1e-6)
    assert found["ankle.swing"].ratio == pytest.approx(SWING / 0.5)


def test_velocities_of_a_ball_are_limited_one_by_one():
    [row] = [
        row
        for row in ROBOT.with_limits(velocity={"ankle.wx": 0.4}).check(swinging()).table
        if row.limit == "velocity" and row.joint == "ankle.wx"
    ]
    assert row.value == pytest.approx(0.8 * AXIS[0])
    assert row.verdict == "broken"


def test_no_slow_down_brings_a_ball_back_into_its_cone():
    slow = ROBOT.with_limits(velocity={"ankle.wz": 0.32}, upper={"ankle.swing": 1.0}).slowdown(swinging())
    assert slow.factor == pytest.approx(0.5)
    assert slow.binding.joint == "ankle.wz"
    with expect_refusal("'ankle.swing' is at 0.8899… beyond its limit of 0.8 rad"):
        ROBOT.with_limits(upper={"ankle.swing": 0.8}, velocity=1.0).slowdown(swinging())


def test_a_ball_is_retimed_along_its_path():
    robot = ROBOT.with_limits(velocity={"ankle.wz": 0.32}, acceleration=1.0, upper={"ankle.swing": 1.0})
    faster = robot.retime(swinging())
    ratios = [row.ratio for row in robot.check(faster.motion).table if row.limit != "position"]
    assert 0.98 < max(ratios) <= 1
    with expect_refusal("'ankle.swing' leaves its position limits"):
        robot.with_limits(upper={"ankle.swing": 0.8}).retime(swinging())


def test_a_jump_of_a_quaternion_rate_breaks_later_velocities():
    m = ROBOT.mechanism
    start, end = positions.rest(m), positions.rest(m)
    turn = next(joint.numbers for joint in positions.multiscrew_joints(m).values() if joint.name == "ankle")
    end[turn] = [*np.sin(0.4) * AXIS, np.cos(0.4)]
    motion = jounce.Motion.trapezoidal([start, end], 1.0, 5.0, joint_names=positions.names(m))
    rows = ROBOT.with_limits(jerk=500.0).check(motion).table
    assert {row.joint for row in rows if np.isinf(row.ratio)} == {"ankle.wx", "ankle.wz"}


def test_excitation_refuses_balls_by_name():
    refusal(lambda: ROBOT.excite(seed=0), "joint 'ankle' of … is a ball joint; expected joints of one screw")
