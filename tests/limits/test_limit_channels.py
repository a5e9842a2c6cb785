"""What limits bound, as channels: their symbols, columns, units and bounds, and rates that are derivatives."""

import numpy as np
import pytest

import jounce
from jounce.limits.commands import take_differences
from jounce.limits.limited_motion import validate_limits
from jounce.model.limits import LIMIT_KINDS
from support.leg_and_cart import leg_and_cart, swinging

ARM = jounce.load("planar2r").elastic(stiffness=500.0, rotor=0.1)
LIMITS = {
    "position": 3.0, "velocity": 2.0, "acceleration": 9.0, "jerk": 90.0, "snap": 900.0, "effort": 200.0,
    "effort_rate": 400.0, "second_effort_rate": 800.0, "power": 100.0, "motor_position": 4.0, "motor_velocity": 5.0,
    "motor_torque": 300.0,
}  # fmt: skip
SAID = {
    "position": ("q", "rad", "q", "rad"),
    "velocity": ("qd", "rad/s", "qd", "rad/s"),
    "acceleration": ("q2d", "rad/s^2", "q2d", "rad/s^2"),
    "jerk": ("q3d", "rad/s^3", "q3d", "rad/s^3"),
    "snap": ("q4d", "rad/s^4", "q4d", "rad/s^4"),
    "effort": ("Q", "N m", "Q", "N m"),
    "effort_rate": ("(Q - Qgrav)", "N m", "(Q - Qgrav)d", "N m/s"),
    "second_effort_rate": ("Q", "N m", "Q2d", "N m/s^2"),
    "power": ("P", "W", "P", "W"),
    "stall_effort": ("(Q at stall)", "N m", "(Q at stall)", "N m"),
    "motor_position": ("theta", "rad", "theta", "rad"),
    "motor_velocity": ("theta", "rad", "thetad", "rad/s"),
    "motor_torque": ("tau", "N m", "tau", "N m"),
}  # by kind: the symbol and unit of its channel, and those of what it bounds
T = np.linspace(0.2, 1.8, 9)


def limited_motion(motion=None):
    stated = {kind: value for kind, value in LIMITS.items() if kind not in ("position", "effort_rate")}
    robot = ARM.with_limits(lower=-3.0, upper=3.0, **stated, stall_effort=[200.0, 100.0], no_load_velocity=10.0)
    robot = robot.with_limits(effort_rate=LIMITS["effort_rate"], of="Q - Qgrav")
    return validate_limits(robot, motion or jounce.Motion.fourier([0.1, 0.3], [[0.3, 0.1]], [[0.1, 0.2]], 2.0, 2.0))


def test_channels_say_what_they_are_of():
    b = limited_motion()
    assert {*b.kinds} == {*SAID}
    found = b.channels(T)
    for kind, (symbol, unit, bounded, of_bounded) in SAID.items():
        channel, bounds = found[kind], b.limits.bounds(kind)
        assert (channel.symbol, channel.names, channel.units) == (symbol, ("joint1", "joint2"), (unit,) * 2)
        assert channel.times is T
        alone = b.bounded(kind, T, b.values(T)[kind])
        for of in (alone, channel.rate(LIMIT_KINDS[kind].derivative)):
            assert (of.symbol, of.names, of.units) == (bounded, ("joint1", "joint2"), (of_bounded,) * 2)
            np.testing.assert_array_equal(of.bounds, [bounds])
            np.testing.assert_array_equal(of.values, b.values(T)[kind])
        for free in channel.bounds[:-1]:
            np.testing.assert_array_equal(free, [[-np.inf] * 2, [np.inf] * 2])


@pytest.mark.parametrize("kind", SAID)
def test_rates_of_channels_are_derivatives(kind):
    b, step = limited_motion().select_kinds([kind]), 1e-4
    early, at, late = (b.channels(T + shift)[kind].rates for shift in (-step, 0, step))
    assert len(at) >= 3
    for k, rate in enumerate(at[1:]):
        difference = (late[k] - early[k]) / (2 * step)
        np.testing.assert_allclose(rate, difference, atol=1e-5 * np.abs(at[k + 1]).max())


def test_extents_of_a_ball_joint_are_named_and_have_no_rates():
    robot = leg_and_cart().with_limits(upper={"ankle.swing": 0.5, "ankle.twist": 1.3}, velocity={"ankle.wx": 0.4})
    found = validate_limits(robot, swinging()).channels(np.array([0.0, 1.0]))
    position, velocity = found["position"], found["velocity"]
    assert {"ankle.swing", "ankle.twist", "deck.x"} < {*position.names}
    assert (len(position.rates), velocity.names) == (1, robot.mechanism.tree.coordinates)
    assert position.bounds[0][1, position.names.index("ankle.swing")] == 0.5
    assert dict(zip(velocity.names, velocity.units, strict=True))["ankle.wx"] == "rad/s"


def test_selected_kinds_keep_what_is_computed():
    b = limited_motion()
    some = b.select_kinds(["power", "jerk"])
    assert some.kinds == ("jerk", "power")
    assert b.select_kinds({"jerk", "power"}) is some
    assert b.select_kinds(["jerk"]).kinds == ("jerk",)
    assert {*some.channels(T)} == {"jerk", "power"}


def test_channels_of_commands_begin_with_the_state_before():
    b = limited_motion(jounce.Motion.trapezoidal([[0.0, 0.0], [0.2, 0.1]], 1.0, 5.0).sampled(100.0))
    found = take_differences(b)
    t = found.commands.t
    assert (found.q.symbol, found.q.names, found.q.units) == ("q", ("joint1", "joint2"), ("rad", "rad"))
    np.testing.assert_allclose(found.q.times, t[0] + 0.01 * np.arange(-1, len(t) + 3), atol=1e-12)
    np.testing.assert_array_equal(found.q.values[0], found.q.values[1])
    np.testing.assert_array_equal(found.limited["jerk"].values, found.q.rates[3][1:])
    for kind, channel in found.limited.items():
        assert (channel.symbol, channel.units) == (SAID[kind][2], (SAID[kind][3],) * 2)
        np.testing.assert_array_equal(channel.times, found.q.times[1:])
        np.testing.assert_array_equal(channel.bounds, [b.limits.bounds(kind)])
