"""Elastic joints of robots with closed loops: springs between the motors and the actuated joints, by Spong's model."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce import JounceWarning, Motion
from support.refusals import refusal

K, B = np.array([90.0, 70.0]), np.array([0.01, 0.02])
T = np.array([0.3, 1.1, 1.7])


@pytest.fixture(scope="module")
def robot(closed):
    return closed["fivebar"]


@pytest.fixture(scope="module")
def arm(robot):
    return robot.elastic(K, rotor=B)


@pytest.fixture(scope="module")
def rates():
    return swing()(T, 6)


def swing():
    return Motion.fourier([2.2, 0.94], [[0.05, 0.1]], [[0.1, 0.1]], 3.0, 2.0)


def test_motors_carry_the_forces_of_the_actuated_joints(robot, arm, rates):
    """theta = q + Q / K and tau = Q + B theta2d, with each rate."""
    Q = robot.inverse_dynamics(*rates)
    theta, tau = arm.motor_positions(*rates), arm.motor_torques(*rates)
    for k, found in enumerate(theta):
        np.testing.assert_allclose(found, rates[k] + Q[k] / K, rtol=1e-12, atol=1e-12)
    for k, found in enumerate(tau):
        np.testing.assert_allclose(found, Q[k] + B * theta[k + 2], rtol=1e-12, atol=1e-12)


def test_rates_are_those_of_differences_along_a_motion(arm):
    h, motion = 0.02, swing()
    stencil = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
    tau, taud = arm.motors_along(motion, T, order=1).torques
    near = [arm.motors_along(motion, T + j * h).torques[0] for j in range(-4, 5)]
    np.testing.assert_allclose(np.tensordot(stencil, near, 1), taud, atol=1e-7 * np.abs(taud).max())
    np.testing.assert_allclose(near[4], tau, rtol=1e-12)


@pytest.mark.parametrize("whole", [False, True])
def test_forward_dynamics_and_linearisation_invert_the_torques(robot, arm, rates, whole):
    """From the coordinates, or from those of all joints."""
    theta, tau = arm.motor_positions(*rates), arm.motor_torques(*rates)[0]
    q = robot.coordinates(rates[0]) if whole else rates[0]
    found = arm.elastic_forward_dynamics(q, rates[1], theta[0], theta[1], tau)
    np.testing.assert_allclose(found[0], rates[2], atol=1e-8)
    np.testing.assert_allclose(found[1], theta[2], atol=1e-8)
    np.testing.assert_allclose(arm.feedback_linearization(q, rates[1], theta[0], theta[1], rates[4]), tau, atol=1e-9)


def test_energy_grows_by_the_power_of_the_motors(arm):
    h, motion = 0.02, swing()
    stencil = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
    energies = []
    for j in range(-4, 5):
        q = motion(T + j * h, 3)
        energies.append(arm.elastic_energy(q[0], q[1], *arm.motor_positions(*q)[:2]).total)
    q = motion(T, 4)
    power = (arm.motor_positions(*q)[1] * arm.motor_torques(*q)).sum(axis=1)
    np.testing.assert_allclose(np.tensordot(stencil, energies, 1), power, atol=1e-8)


def test_damping_of_passive_joints_stays_in_the_forces_of_the_links(robot, rates):
    """That of actuated joints moves to their motors."""
    m, d = robot.mechanism, 0.3
    both, passive = (replace(m, drives=replace(m.drives, damping=np.array([x, d, x, d]))) for x in (0.2, 0.0))
    links, damped = (type(robot)(m).with_drives(["damping"]) for m in (passive, both))
    with pytest.warns(JounceWarning, match="damping no longer acts in Q, but on the motors"):
        arm = damped.elastic(K, rotor=B)
    other = links.elastic(K, rotor=B)
    theta, tau = other.motor_positions(*rates[:5]), other.motor_torques(*rates[:5])
    np.testing.assert_allclose(arm.motor_torques(*rates[:5]), tau + 0.2 * theta[1], rtol=1e-12, atol=1e-12)
    assert np.abs(tau - robot.elastic(K, rotor=B).motor_torques(*rates[:5])).max() > 0.01


def test_limits_of_motors_are_checked_along_a_motion(arm):
    limited = arm.with_limits(motor_torque=0.4, motor_velocity=5)
    tau = np.abs(arm.motors_along(swing(), np.linspace(0, 2, 1001)).torques[0]).max(axis=0)
    rows = {row.joint: row for row in limited.check(swing()).table if row.limit == "motor_torque"}
    for joint, most in zip(arm.joint_names, tau, strict=True):
        assert abs(rows.pop(joint).value) == pytest.approx(most, rel=1e-4)
    assert not rows


def test_a_damper_is_integrated_along_a_motion(robot):
    """Of a slow motion, the deflection is that of the series."""
    damped = robot.elastic(K, rotor=B, damping=0.05)
    along = damped.motors_along(swing(), T)
    np.testing.assert_allclose(along.positions[0], damped.motor_positions(*swing()(T, 5)), atol=1e-9)


@pytest.mark.parametrize(("options", "message"), [
    ({"stiffness": {"left_elbow": 100.0}}, "stiffness of joint 'left_elbow': it follows others"),
    ({"stiffness": K, "rotor": {"right_elbow": 1.0}}, "rotor of joint 'right_elbow': it follows others"),
    ({"stiffness": K, "rotor": B, "coupling": 0}, "coupling=0 is not available for robots with closed loops"),
])  # fmt: skip
def test_springs_of_passive_joints_and_carried_rotors_are_refused(robot, options, message):
    refusal(lambda: robot.elastic(**options), message)


def test_springs_of_redundant_motors_are_refused(robot):
    redundant = robot.closed(actuated=[*robot.joint_names, "left_elbow"], coordinates=robot.joint_names)
    refusal(lambda: redundant.elastic(K[0], rotor=1.0), "has motors at left_shoulder, right_shoulder, left_elbow")


def test_loops_are_closed_before_joints_are_elastic(arm):
    refusal(lambda: arm.closed(), "close its loops first")


def test_a_file_states_springs_of_a_closed_robot(arm, rates, tmp_path):
    path = tmp_path / "elastic.yaml"
    jounce.save(arm, path)
    read = jounce.load(path).elastic()
    np.testing.assert_allclose(read.motor_torques(*rates)[0], arm.motor_torques(*rates)[0], rtol=1e-12)
