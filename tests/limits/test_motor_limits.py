"""Limits of motors behind elastic joints: nothing between samples is missed, and a slow-down keeps them."""

import numpy as np
import pytest
from test_check import fourier, rows

import jounce
from jounce.limits.feasible_factors import polynomials
from jounce.limits.limited_motion import compute_deviations, validate_limits
from support.refusals import expect_refusal, refusal

STIFFNESS, ROTOR = [300.0, 200.0], [0.4, 0.2]
MOTION = fourier(3, 2, duration=1.0).with_step(0.05)


def soft_arm(friction=0.0, **limits):
    """A planar arm with soft joints, and with friction where a test asks for it."""
    m = jounce.load("planar2r").mechanism
    drives = {"damping": [0.3, 0.2], "friction": [friction, friction]}
    robot = jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, gravity=m.gravity, drives=drives).with_drives()
    with pytest.warns(jounce.JounceWarning, match="on the motors"):
        return robot.elastic(STIFFNESS, rotor=ROTOR).with_limits(**limits)


def motors(elastic, rates):
    """What limits of motors bound."""
    theta, thetad = elastic.motor_positions(*rates[:4])
    return {"motor_position": theta, "motor_velocity": thetad, "motor_torque": elastic.motor_torques(*rates[:5])}


def test_worst_values_are_those_of_a_dense_grid():
    bounds = {"motor_position": 1.0, "motor_velocity": 1.5, "motor_torque": 30.0}
    elastic = soft_arm(**bounds)
    found = rows(elastic.check(MOTION))
    t = np.linspace(MOTION.start, MOTION.stop, 20001)
    for kind, values in motors(elastic, MOTION(t)).items():
        for joint, column in zip(elastic.joint_names, values.T, strict=True):
            row = found[joint, kind]
            assert abs(row.value) == pytest.approx(np.abs(column).max(), rel=1e-6)
            assert row.ratio == pytest.approx(abs(row.value) / bounds[kind])
            beyond = sum(stop - start for start, stop in row.violations)
            assert beyond == pytest.approx((np.abs(column) > bounds[kind]).mean() * MOTION.duration, abs=5e-4)
    assert [found[elastic.joint_names[0], kind].unit for kind in bounds] == ["rad", "rad/s", "N m"]


def test_motors_are_polynomials_of_the_speed():
    elastic = soft_arm(motor_position=9, motor_velocity=9, motor_torque=900)
    t = np.linspace(MOTION.start, MOTION.stop, 7)
    found = polynomials(validate_limits(elastic, MOTION), t)
    assert {kind: len(c) - 1 for kind, c in found.items()} == {
        "motor_position": 2,
        "motor_velocity": 3,
        "motor_torque": 4,
    }
    for speed in (0.3, 1.7):
        scaled = [rate * speed**k for k, rate in enumerate(MOTION(t))]
        for kind, exact in motors(elastic, scaled).items():
            value = sum(c * speed**k for k, c in enumerate(found[kind]))
            np.testing.assert_allclose(value, exact, rtol=0, atol=1e-11 * np.abs(exact).max())


@pytest.mark.parametrize(
    ("limit", "friction"),
    [({"motor_torque": 45.0}, 0.0), ({"motor_torque": 45.0}, 0.5), ({"motor_velocity": [[-1.0, 0.8], [-9, 9]]}, 0.0)],
)
def test_a_slow_down_meets_one_limit_and_all_smaller_factors_keep_it(limit, friction):
    elastic = soft_arm(friction, **limit)
    slow = elastic.slowdown(MOTION, up_to_limits=True)
    assert slow.binding.limit == next(iter(limit))
    assert (slow.largest is None) == (bool(friction) and slow.factor < 1)  # it enters no polynomial
    assert elastic.check(slow.motion).worst.ratio == pytest.approx(1, abs=1e-8)
    for share in (0.3, 0.99):
        assert elastic.check(MOTION.scaled(1 / (share * slow.factor))).ok


def test_what_no_slow_down_cures_is_refused():
    refusal(
        lambda: soft_arm(motor_torque=5.0).slowdown(MOTION), "motor of joint", "torque of", "at rest", "slowing down"
    )
    refusal(lambda: soft_arm(motor_position=0.01).slowdown(MOTION), "position of", "beyond its limit of")
    jerky = jounce.Motion.trapezoidal([[0, 0], [1, 1]], 2.0, 10.0)
    elastic = soft_arm(motor_torque=1e6)
    assert np.isinf(elastic.check(jerky).worst.ratio)
    refusal(lambda: elastic.slowdown(jerky), "break at", "motor torque", "infinite")


def test_rigid_joints_have_no_limits_of_motors():
    rigid = jounce.load("planar2r").with_limits(motor_torque=1.0)
    refusal(lambda: rigid.check(MOTION), "has no limits of rigid joints", "robot.elastic(stiffness)")
    [note] = rigid.with_limits(velocity=9.0).check(MOTION).notes
    assert "limits of motor torque are not checked" in note


def test_a_file_keeps_them(tmp_path):
    robot = jounce.load("planar2r").with_limits(
        motor_position={"joint1": (-1, 2), "joint2": (0.5, 3)},
        motor_velocity=3,
        motor_torque=4,
        motor_current={"joint1": 5},
        motor_voltage=6,
    )
    jounce.save(robot, tmp_path / "arm.yaml")
    assert np.array_equal(jounce.load(tmp_path / "arm.yaml").limits.table, robot.limits.table)
    assert jounce.load(tmp_path / "arm.yaml").limits.motor_current.tolist() == [5, np.inf]


def test_currents_and_voltages_are_limits_too():
    motor = jounce.Motor(gear=-50, inertia=1e-4, resistance=0.5, inductance=2e-3, constant=0.05)
    robot = jounce.load("planar2r").elastic(STIFFNESS, motors=motor).with_limits(motor_current=20, motor_voltage=9)
    found = rows(robot.check(MOTION))
    along = robot.motors_along(MOTION, np.linspace(MOTION.start, MOTION.stop, 4001), order=1)
    for kind, values in (("motor_current", along.currents), ("motor_voltage", along.voltages)):
        for joint, column in zip(robot.joint_names, values[0].T, strict=True):
            assert abs(found[joint, kind].value) == pytest.approx(np.abs(column).max(), rel=1e-5)
    slow = robot.slowdown(MOTION, up_to_limits=True)
    assert robot.check(slow.motion).worst.ratio == pytest.approx(1, abs=1e-8)
    with expect_refusal("joint 'joint2' has a limit of motor_voltage", "no constant and no resistance"):
        soft_arm().with_limits(motor_voltage={"joint2": 9}).check(MOTION)


def test_springs_that_bend_and_dampers_are_bounded_as_well():
    motion = fourier(3, 2, duration=0.4).with_step(0.2)
    for options in ({"spring": jounce.CubicSpring(300.0, 2e4)}, {"stiffness": 300.0, "damping": 0.6}):
        robot = jounce.load("planar2r").elastic(rotor=ROTOR, **options).with_limits(motor_torque=45)
        slow = robot.slowdown(motion, up_to_limits=True)
        assert robot.check(slow.motion).worst.ratio == pytest.approx(1, abs=1e-7)


def test_deviations_of_motors_follow_from_those_of_the_joints():
    motor = jounce.Motor(gear=-50, inertia=1e-4, resistance=0.5, inductance=2e-3, constant=0.05)
    limits = dict.fromkeys(("motor_position", "motor_velocity", "motor_torque", "motor_current", "motor_voltage"), 1e3)
    robot = jounce.load("planar2r").elastic(STIFFNESS, motors=motor).with_limits(**limits)
    truth, t = fourier(3, 2, duration=4.0), np.linspace(0, 4, 2001)
    measured = jounce.Motion.fit(t, truth(t, 0)[0] + np.random.default_rng(0).normal(0, 1e-5, (2001, 2)))
    b, middle = validate_limits(robot, measured), np.linspace(1, 3, 41)
    found, exact = b.values(middle), validate_limits(robot, truth).values(middle)
    for kind, off in compute_deviations(b, middle).items():
        assert (off > 0).all()
        assert (np.abs(found[kind] - exact[kind]) < 5 * off).all()
        assert (off < 0.02 * np.abs(exact[kind]).max(axis=0)).all()
    assert set(found) == set(limits)
    checked = robot.check(measured)
    assert (checked.verdict, set(checked.judged.values())) == ("kept", {1.0})
