"""Closed robots against oracles: closed-form kinematics with d'Alembert's principle (40 digits), and Pinocchio."""

import numpy as np
import pytest

from support.closed_robots import LOOP_ROBOTS, golden_loops, motion_near_start
from support.robots import relative_error

RECURSION = {"method": "recursion"}


@pytest.mark.parametrize(
    ("name", "method", "count"),
    [
        ("fivebar", "recursion", 3),
        ("gough_stewart", "closed_form", 1),  # of 126 x 126 matrices
        ("gough_stewart", "recursion", 3),
    ],
)
def test_forces_and_their_rates_are_those_of_closed_form_kinematics(closed, name, method, count):
    """The robots' loops are closed by circles that intersect and legs that reach their platform, in 70 digits."""
    robot = closed[name]
    coordinates, actuated, q, forces = golden_loops(name)
    own = [coordinates.index(joint) for joint in actuated]
    assert (robot.joint_names, robot.mechanism.tree.coordinates) == (tuple(actuated), tuple(coordinates))
    for found, expected in zip(robot.inverse_dynamics(*q[:, :count, own], method=method), forces, strict=True):
        for x, y in zip(found, expected[:count], strict=True):
            assert relative_error(x, y) < 1e-11


@pytest.mark.parametrize("name", ["fivebar", "gough_stewart"])
def test_coordinates_are_those_of_closed_form_kinematics(closed, name):
    coordinates, actuated, q, _ = golden_loops(name)
    own = [coordinates.index(joint) for joint in actuated]
    for found, expected in zip(closed[name].coordinates(*q[..., own], **RECURSION), q, strict=True):
        for x, y in zip(found, expected, strict=True):
            assert relative_error(x, y) < 1e-11


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_forces_and_accelerations_are_those_of_pinocchio(closed, name):
    pytest.importorskip("pinocchio")
    from support.pinocchio_of_mechanism import ConstrainedPeer

    robot = closed[name]
    m, own = robot.mechanism, list(robot.mechanism.closure.independent)
    peer = ConstrainedPeer(m.tree, [(loop.a.name, loop.b.name) for loop in m.loops])
    u = motion_near_start(robot, np.random.default_rng(1), 2)(0.7)
    q, qd, q2d = robot.coordinates(*u, **RECURSION)
    Q = robot.inverse_dynamics(q, *u[1:], **RECURSION)
    forces, accelerations = peer.inverse(q, qd, u[2], own)
    assert relative_error(Q, forces) < 1e-9
    assert relative_error(q2d, accelerations) < 1e-9
    assert relative_error(q2d, peer.forward(q, qd, Q, own)) < 1e-9
    assert relative_error(robot.forward_dynamics(q, qd[own], Q, **RECURSION), u[2]) < 1e-9
