"""Motors that move several joints of robots whose coordinates are not named as their joints."""

import numpy as np
import pytest

import jounce
from support.refusals import refusal
from support.robots import random_inertia, random_pose, random_screw

A = np.array([[28.25, -16.75], [14.0, 28.25]])
RATES = np.random.default_rng(1).uniform(-1, 1, (5, 2))
GRIPPER = [[1, 0], [0, 1], [1, -1]]


def follower_robot(G, **names):
    rng, count = np.random.default_rng(0), len(G)
    arrays = [[make(rng, x) for _ in range(count)] for make, x in ((random_screw, "revolute"), (random_inertia, 1.0))]
    return jounce.Robot.from_screws([random_pose(rng) for _ in range(count)], *arrays, G=G, **names)


ROBOTS = {
    "other names": follower_robot(np.eye(2)),
    "a gripper": follower_robot(GRIPPER),
    "a gripper with names": follower_robot(GRIPPER, joint_names=["close", "turn"]),
    "names of joints that come second": follower_robot([[1, -1], [1, 0], [0, 1]], joint_names=["joint2", "x"]),
}


@pytest.mark.parametrize("name", ROBOTS)
def test_the_torques_are_those_of_the_coordinates(name):
    """tau = A^-T Q with its rates, by virtual work of phi = A q, and the same coordinates under the same names."""
    robot = ROBOTS[name]
    moved = robot.with_transmission(A, ["m1", "m2"])
    assert moved.joint_names == robot.joint_names
    forces, torques = robot.inverse_dynamics(*RATES), moved.actuator_forces(*RATES)
    for Q, same, tau in zip(forces, moved.inverse_dynamics(*RATES), torques, strict=True):
        np.testing.assert_allclose(same, Q, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(tau, np.linalg.solve(A.T, Q), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", ROBOTS)
def test_motors_at_coordinates_by_their_names(name):
    robot = ROBOTS[name]
    driven = robot.closed(actuated=robot.joint_names, coordinates=robot.joint_names)
    assert driven.joint_names == robot.joint_names
    np.testing.assert_allclose(driven.inverse_dynamics(*RATES[:3]), robot.inverse_dynamics(*RATES[:3]), atol=1e-11)


def test_coordinates_that_no_joint_has_are_refused_by_their_names():
    both = follower_robot([[1, 1], [1, -1]])
    refusal(
        lambda: both.with_transmission(A, ["m1", "m2"]),
        "no joint that moves as its coordinate 'q1' does",
        "expected coordinates that are joints, among joint1, joint2$",
    )
    mixed = follower_robot([[2, 0], [1, 0], [0, 1]], joint_names=["joint1", "x"])
    refusal(lambda: mixed.with_transmission(A, ["m1", "m2"]), "joint 'joint1' does not move as the coordinate")
