"""Friction that grows with the load: fitted where residuals show it, held by the robot, nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from support.refusals import refusal

T = np.linspace(0, 6, 1501)
NOISE = 0.05
WITHOUT = ("damping", "friction", "stribeck", "offset")
QUIET = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # what notes hold


def true_arm(arm, shares, eps=0.05):
    """The arm with other masses, and friction of which shares grow with the load."""
    m = arm.with_inertial_parameters(1.2 * arm.inertial_parameters).mechanism
    amounts = {"friction": [3.0, 2.0, 1.0], "damping": [0.5] * 3, "eps": [eps] * 3, "load_friction": shares}
    drives = replace(m.drives, **{name: np.array(x, dtype=float) for name, x in amounts.items()})
    return jounce.Robot(replace(m, drives=drives, acting=("damping", "friction", "load_friction")))


def measured_torques(robot, motion, seed):
    Q = robot.forces_along(motion, T, order=0).forces[0]
    return Q + NOISE * np.random.default_rng(seed).normal(size=Q.shape)


def other_motion(seed=5):
    rng = np.random.default_rng(seed)
    return jounce.Motion.fourier(np.full(3, 0.3), *rng.uniform(-0.5, 0.5, (2, 3, 3)), 2.0, 6.0)


def torque_error(found, robot, motion):
    """Root mean square of how far torques along a motion are off, N m."""
    there = [one.forces_along(motion, T, order=0).forces[0] for one in (found.robot, robot)]
    return np.sqrt(((there[0] - there[1]) ** 2).mean())


def load_shares(found):
    return {row.name: row for row in found.table if row.name.endswith("load_friction")}


@QUIET
@pytest.mark.parametrize("c", [[0, 0.05, 0], [0.05, 0.05, 0.05]])
def test_it_is_found_and_other_motions_are_predicted(arm, motion, c, tmp_path):
    robot, Q = true_arm(arm, c), measured_torques(true_arm(arm, c), motion, 1)
    found, without = arm.identify(motion, Q, t=T), arm.identify(motion, Q, t=T, drives=WITHOUT)
    expected = {f"{joint} load_friction": x for joint, x in zip(arm.joint_names, c, strict=True) if x}
    assert [*load_shares(found)] == [*expected]
    for name, row in load_shares(found).items():
        assert abs(row.value - expected[name]) < 3 * row.deviation < 0.01 * expected[name]
        assert (row.unit, row.model, row.seen) == ("1", 0, True)
        assert name in str(found)
    assert found.notes == ()
    assert "that grows by" in without.notes[0], "named where it is not sought"
    assert torque_error(found, robot, other_motion()) < 0.02 * torque_error(without, robot, other_motion())
    assert torque_error(found, robot, other_motion()) < 0.2 * NOISE
    jounce.save(found.robot, tmp_path / "found.yaml")
    again = jounce.load(tmp_path / "found.yaml", drives=True).forces_along(motion, T, order=0).forces[0]
    np.testing.assert_allclose(again, found.predicted, rtol=0, atol=1e-9 * np.abs(Q).max())


def test_deviations_are_those_of_the_errors(arm, motion):
    c, over = 0.05, []
    for seed in range(12):
        found = arm.identify(motion, measured_torques(true_arm(arm, [0, c, c]), motion, seed), t=T)
        over += [(row.value - c) / row.deviation for row in load_shares(found).values()]
    assert len(over) == 24
    assert 0.6 < np.sqrt(np.mean(np.square(over))) < 1.5


@pytest.mark.parametrize("seed", range(5))
def test_logs_without_it_get_none(arm, motion, seed):
    """Of exact motions and of encoders; what a robot file states goes, as the log shows."""
    Q, step = measured_torques(true_arm(arm, [0, 0, 0]), motion, seed), 2 * np.pi / 2**17
    stated = true_arm(arm, [0.1, 0.1, 0.1])
    read = jounce.Motion.fit(T, np.round(motion(T, 0)[0] / step) * step, joint_names=arm.joint_names)
    for model, path in ((arm, motion), (arm, read), (stated, motion)):
        found = model.identify(path, Q, t=T)
        assert load_shares(found) == {}
        assert not found.robot.drives.load_friction.any()
        assert found.notes == ()


def test_encoders_leave_it_within_its_deviations(arm, motion):
    step = 2 * np.pi / 2**17
    read = jounce.Motion.fit(T, np.round(motion(T, 0)[0] / step) * step, joint_names=arm.joint_names)
    found = arm.identify(read, measured_torques(true_arm(arm, [0, 0.05, 0]), motion, 2), t=T)
    [row] = load_shares(found).values()
    assert abs(row.value - 0.05) < 3 * row.deviation < 0.005


def test_logs_share_it_and_others_test_it(arm, motion):
    robot = true_arm(arm, [0, 0.05, 0])
    other = other_motion().with_step(6 / 1500)
    forces = [measured_torques(robot, path, seed) for seed, path in enumerate((motion, other, motion))]
    found = arm.identify([motion, other, motion], forces, t=[T] * 3, test=2)
    [row] = load_shares(found).values()
    assert abs(row.value - 0.05) < 3 * row.deviation
    exact = np.concatenate([found.robot.forces_along(path, T, order=0).forces[0] for path in (motion, other, motion)])
    np.testing.assert_allclose(found.predicted, exact, rtol=0, atol=1e-9)


@QUIET
def test_joints_that_share_their_force_have_none(arm, motion):
    """It is named, as robots cannot hold it."""
    m = true_arm(arm, [0, 0, 0]).mechanism
    G = np.array([[1.0, 0], [0, 1], [0, 0.5]])
    robot = jounce.Robot(replace(m, G=G, g=np.zeros(3), coordinates=m.coordinates[:2]))
    path = jounce.Motion.fourier([0.3, 0.3], *np.random.default_rng(1).uniform(-0.5, 0.5, (2, 3, 2)), 2.0, 6.0)
    Q = measured_torques(robot, path, 1)
    Q[:, 1] += 0.05 * np.abs(Q[:, 1]) * np.tanh(path(T, 1)[1][:, 1] / 0.05)
    found = robot.identify(path, Q, t=T)
    assert load_shares(found) == {}
    assert "that grows by" in found.notes[-1]


@QUIET
def test_payloads_of_arms_with_it(arm, motion):
    """Loads are within their deviations, which are half as large as without the term."""
    c, load = [0, 0.05, 0.05], np.array([2.0, 0.04, -0.06, 0.1, 0.03, 0, 0.03, 0, 0, 0.02])
    p = np.array(true_arm(arm, c).inertial_parameters)
    p[-10:] += load
    logs = [
        replace(motion, torques=(T, measured_torques(robot, motion, seed)))
        for seed, robot in enumerate((true_arm(arm, c).with_inertial_parameters(p), true_arm(arm, c)))
    ]
    found, without = arm.payload(*logs), arm.payload(*logs, drives=WITHOUT)
    over = (found.parameters - load) / np.sqrt(np.diag(found.covariance))
    assert np.abs(over[:4]).max() < 4
    assert found.notes == ()
    assert found.covariance[0, 0] < 0.25 * without.covariance[0, 0]


def test_refuses_it_without_the_friction_whose_speed_it_shares(arm, motion):
    Q = measured_torques(true_arm(arm, [0, 0, 0]), motion, 1)
    words = "load_friction is of friction, which drives=['damping', 'load_friction'] does not identify"
    refusal(lambda: arm.identify(motion, Q, t=T, drives=("load_friction", "damping")), words)
