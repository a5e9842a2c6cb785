"""Elastic joints of robots with closed loops: springs between the motors and the actuated joints, by Spong's model."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce import JounceWarning
from support.closed_robots import fivebar_swing
from support.refusals import refusal

K, B = np.array([90.0, 70.0]), np.array([0.01, 0.02])
T = np.array([0.3, 1.1, 1.7])


@pytest.fixture(scope="module")
def elastic_fivebar(bundled_fivebar):
    return bundled_fivebar.elastic(K, rotor=B)


@pytest.fixture(scope="module")
def swing_rates():
    return fivebar_swing()(T, 6)


def test_motors_carry_the_forces_of_the_actuated_joints(bundled_fivebar, elastic_fivebar, swing_rates):
    """theta = q + Q / K and tau = Q + B theta2d, with each rate."""
    Q = bundled_fivebar.inverse_dynamics(*swing_rates)
    theta, tau = elastic_fivebar.motor_positions(*swing_rates), elastic_fivebar.motor_torques(*swing_rates)
    for k, found in enumerate(theta):
        np.testing.assert_allclose(found, swing_rates[k] + Q[k] / K, rtol=1e-12, atol=1e-12)
    for k, found in enumerate(tau):
        np.testing.assert_allclose(found, Q[k] + B * theta[k + 2], rtol=1e-12, atol=1e-12)


def test_rates_are_those_of_differences_along_a_motion(elastic_fivebar):
    h, motion = 0.02, fivebar_swing()
    stencil = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
    tau, taud = elastic_fivebar.motors_along(motion, T, order=1).torques
    near = [elastic_fivebar.motors_along(motion, T + j * h).torques[0] for j in range(-4, 5)]
    np.testing.assert_allclose(np.tensordot(stencil, near, 1), taud, atol=1e-7 * np.abs(taud).max())
    np.testing.assert_allclose(near[4], tau, rtol=1e-12)


@pytest.mark.parametrize("whole", [False, True])
def test_forward_dynamics_and_linearisation_invert_the_torques(bundled_fivebar, elastic_fivebar, swing_rates, whole):
    """From the coordinates, or from those of all joints."""
    theta, tau = elastic_fivebar.motor_positions(*swing_rates), elastic_fivebar.motor_torques(*swing_rates)[0]
    q = bundled_fivebar.coordinates(swing_rates[0]) if whole else swing_rates[0]
    found = elastic_fivebar.elastic_forward_dynamics(q, swing_rates[1], theta[0], theta[1], tau)
    np.testing.assert_allclose(found[0], swing_rates[2], atol=1e-8)
    np.testing.assert_allclose(found[1], theta[2], atol=1e-8)
    np.testing.assert_allclose(
        elastic_fivebar.feedback_linearization(q, swing_rates[1], theta[0], theta[1], swing_rates[4]), tau, atol=1e-9
    )


def test_energy_grows_by_the_power_of_the_motors(elastic_fivebar):
    h, motion = 0.02, fivebar_swing()
    stencil = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / h
    energies = []
    for j in range(-4, 5):
        q = motion(T + j * h, 3)
        energies.append(elastic_fivebar.elastic_energy(q[0], q[1], *elastic_fivebar.motor_positions(*q)[:2]).total)
    q = motion(T, 4)
    power = (elastic_fivebar.motor_positions(*q)[1] * elastic_fivebar.motor_torques(*q)).sum(axis=1)
    np.testing.assert_allclose(np.tensordot(stencil, energies, 1), power, atol=1e-8)


def test_damping_of_passive_joints_stays_in_the_forces_of_the_links(bundled_fivebar, swing_rates):
    """That of actuated joints moves to their motors."""
    m, d = bundled_fivebar.mechanism, 0.3
    both, passive = (replace(m, drives=replace(m.drives, damping=np.array([x, d, x, d]))) for x in (0.2, 0.0))
    links, damped = (type(bundled_fivebar)(m).with_drives(["damping"]) for m in (passive, both))
    with pytest.warns(JounceWarning, match="damping no longer acts in Q, but on the motors"):
        arm = damped.elastic(K, rotor=B)
    other = links.elastic(K, rotor=B)
    theta, tau = other.motor_positions(*swing_rates[:5]), other.motor_torques(*swing_rates[:5])
    np.testing.assert_allclose(arm.motor_torques(*swing_rates[:5]), tau + 0.2 * theta[1], rtol=1e-12, atol=1e-12)
    assert np.abs(tau - bundled_fivebar.elastic(K, rotor=B).motor_torques(*swing_rates[:5])).max() > 0.01


def test_limits_of_motors_are_checked_along_a_motion(elastic_fivebar):
    limited = elastic_fivebar.with_limits(motor_torque=0.4, motor_velocity=5)
    tau = np.abs(elastic_fivebar.motors_along(fivebar_swing(), np.linspace(0, 2, 1001)).torques[0]).max(axis=0)
    rows = {row.joint: row for row in limited.check(fivebar_swing()).table if row.limit == "motor_torque"}
    for joint, most in zip(elastic_fivebar.joint_names, tau, strict=True):
        assert abs(rows.pop(joint).value) == pytest.approx(most, rel=1e-4)
    assert not rows


def test_a_damper_is_integrated_along_a_motion(bundled_fivebar):
    """Of a slow motion, the deflection is that of the series."""
    damped = bundled_fivebar.elastic(K, rotor=B, damping=0.05)
    along = damped.motors_along(fivebar_swing(), T)
    np.testing.assert_allclose(along.positions[0], damped.motor_positions(*fivebar_swing()(T, 5)), atol=1e-9)


@pytest.mark.parametrize(("options", "message"), [
    ({"stiffness": {"left_elbow": 100.0}}, "stiffness of joint 'left_elbow': it follows others"),
    ({"stiffness": K, "rotor": {"right_elbow": 1.0}}, "rotor of joint 'right_elbow': it follows others"),
    ({"stiffness": K, "rotor": B, "coupling": 0}, "coupling=0 is not available for robots with closed loops"),
])  # fmt: skip
def test_springs_of_passive_joints_and_carried_rotors_are_refused(bundled_fivebar, options, message):
    refusal(lambda: bundled_fivebar.elastic(**options), message)


def test_springs_of_redundant_motors_are_refused(bundled_fivebar):
    redundant = bundled_fivebar.closed(
        actuated=[*bundled_fivebar.joint_names, "left_elbow"], coordinates=bundled_fivebar.joint_names
    )
    refusal(lambda: redundant.elastic(K[0], rotor=1.0), "has motors at left_shoulder, right_shoulder, left_elbow")


def test_loops_are_closed_before_joints_are_elastic(elastic_fivebar):
    refusal(lambda: elastic_fivebar.closed(), "close its loops first")


def test_a_file_states_springs_of_a_closed_robot(elastic_fivebar, swing_rates, tmp_path):
    path = tmp_path / "elastic.yaml"
    jounce.save(elastic_fivebar, path)
    read = jounce.load(path).elastic()
    np.testing.assert_allclose(
        read.motor_torques(*swing_rates)[0], elastic_fivebar.motor_torques(*swing_rates)[0], rtol=1e-12
    )
