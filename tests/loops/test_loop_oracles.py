"""Closed robots against oracles: closed-form kinematics with d'Alembert's principle (40 digits), and Pinocchio."""

import numpy as np
import pytest
from loops import LOOP_ROBOTS, content, loaded, golden_loops, motion_near_start
from robots import relative_error

import jounce

METHODS = ("closed_form", "recursion", "kernel")


@pytest.fixture(scope="module")
def closed(tmp_path_factory):
    """The bundled robots with loops, read once."""
    folder = tmp_path_factory.mktemp("loops")
    return {name: loaded(content(name), folder) for name in LOOP_ROBOTS}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["fivebar", "gough_stewart"])
def test_forces_and_their_rates_are_those_of_closed_form_kinematics(closed, name, method):
    """The robots' loops are closed by circles that intersect and legs that reach their platform, in 70 digits."""
    robot = closed[name]
    coordinates, actuated, cases = golden_loops(name)
    own = [coordinates.index(joint) for joint in actuated]
    assert (robot.joint_names, robot.mechanism.tree.coordinates) == (tuple(actuated), tuple(coordinates))
    for q, forces in cases:
        found = robot.inverse_dynamics(*q[:, own], method=method)
        for rate, expected in zip(found, forces, strict=True):
            assert relative_error(rate, expected) < 1e-11


@pytest.mark.parametrize("name", ["fivebar", "gough_stewart"])
def test_coordinates_are_those_of_closed_form_kinematics(closed, name):
    coordinates, actuated, cases = golden_loops(name)
    own = [coordinates.index(joint) for joint in actuated]
    for q, _ in cases:
        for rate, expected in zip(closed[name].coordinates(*q[:, own]), q, strict=True):
            assert relative_error(rate, expected) < 1e-11


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_forces_and_accelerations_are_those_of_pinocchio(closed, name):
    pytest.importorskip("pinocchio")
    from loop_peer import ConstrainedPeer

    robot = closed[name]
    m, loops = robot.mechanism, robot.mechanism.loops
    peer, own = ConstrainedPeer(m.tree, [(loop.a.name, loop.b.name) for loop in loops]), list(m.closure.independent)
    motion = motion_near_start(robot, np.random.default_rng(1), 2)
    for t in (0.0, 0.7):
        u = motion(t)
        q, qd, q2d = robot.coordinates(*u)
        Q = robot.inverse_dynamics(*u)
        forces, accelerations = peer.inverse(q, qd, u[2], own)
        assert relative_error(Q, forces) < 1e-9
        assert relative_error(q2d, accelerations) < 1e-9
        assert relative_error(q2d, peer.forward(q, qd, Q, own)) < 1e-9
        assert relative_error(robot.forward_dynamics(*u[:2], Q), u[2]) < 1e-9
