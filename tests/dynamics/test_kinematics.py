"""Poses and Jacobians in all frames, of bodies and of links merged into them, against motions of the poses."""

import numpy as np
import pytest
from hypothesis import given

import jounce
from jounce.spatial import lie
from support.robots import differentiated_at_once, harmonic, mechanisms, relative_error, with_tool


def vee(H):
    return np.array([H[2, 1], H[0, 2], H[1, 0], *H[:3, 3]])


@pytest.mark.parametrize("frame", ["body", "world", "spatial"])
@given(drawn=mechanisms())
def test_jacobians_give_the_twists_of_moving_poses(frame, drawn):
    robot, rng, T = with_tool(drawn)
    path = harmonic(rng, robot.n, 1)
    q, qd = path(0)
    C = robot.poses(q)[-1] @ T
    C_dot = differentiated_at_once(lambda t: robot.poses(path(t)[0])[..., -1, :, :] @ T)
    body = vee(lie.inverse(C) @ C_dot)  # the paper's body-fixed twist
    if frame == "spatial":
        expected = vee(C_dot @ lie.inverse(C))
    else:
        R = C[:3, :3] if frame == "world" else np.eye(3)
        expected = np.concatenate([R @ body[:3], R @ body[3:]])
    found = robot.jacobian(q, body="tool", frame=frame) @ qd
    assert np.abs(found - expected).max() < 1e-9 * (1 + np.abs(expected).max())


@pytest.mark.parametrize("frame", ["body", "world", "spatial"])
@given(drawn=mechanisms(largest=4))
def test_rates_of_jacobians(frame, drawn):
    robot, rng, _ = with_tool(drawn)
    path = harmonic(rng, robot.n, 2)
    for body in ("tool", None):
        J = robot.jacobian(*path(0), body=body, frame=frame)
        for k in (1, 2):

            def lower(t, k=k, body=body):
                given = robot.jacobian(*path(t)[:k], body=body, frame=frame)
                return given if k == 1 else given[k - 1]

            assert np.abs(differentiated_at_once(lower) - J[k]).max() < 1e-8 * (1 + np.abs(J[k]).max())


@given(drawn=mechanisms())
def test_all_bodies_at_once_or_one_by_one(drawn):
    robot, rng, _ = with_tool(drawn)
    q, qd = rng.normal(size=(2, robot.n))
    for frame in ("body", "world", "spatial"):
        everything = robot.jacobian(q, qd, frame=frame)
        for i, name in enumerate(robot.body_names):
            for all_of_them, one in zip(everything, robot.jacobian(q, qd, body=name, frame=frame), strict=True):
                assert np.abs(all_of_them[i] - one).max() < 1e-13 * (1 + np.abs(one).max())


@given(drawn=mechanisms())
def test_links_on_the_ground_do_not_move(drawn):
    robot, rng, _ = with_tool(drawn)
    q, qd = rng.normal(size=(2, 3, robot.n))
    J, Jd = robot.jacobian(q, qd, body="stand", frame="spatial")
    assert J.shape == Jd.shape == (3, 6, robot.n)
    assert not J.any()
    assert not Jd.any()


@given(drawn=mechanisms())
def test_poses_of_merged_links(drawn):
    robot, rng, T = with_tool(drawn)
    q = rng.normal(size=(3, robot.n))
    assert np.abs(robot.poses(q, body="tool") - robot.poses(q)[:, -1] @ T).max() < 1e-13
    assert (robot.poses(q, body="stand") == robot.mechanism.frame("stand").T).all()
    assert robot.poses(q, body="stand").shape == (3, 4, 4)


@given(drawn=mechanisms())
def test_a_wrench_on_a_merged_link_does_the_work_of_its_twist(drawn):
    """Qext = J^T W with the Jacobian of that link; nothing for links on the ground."""
    robot, rng, _ = with_tool(drawn)
    q = rng.normal(size=(3, robot.n))
    W = rng.normal(size=6)
    extra = robot.inverse_dynamics(*q, wrench={"tool": W, "stand": W}) - robot.inverse_dynamics(*q)
    expected = robot.jacobian(q[0], body="tool").T @ W
    assert np.abs(extra - expected).max() < 1e-11 * (1 + np.abs(robot.inverse_dynamics(*q)).max())


def test_wrenches_by_name_add_up_and_take_batches():
    robot = jounce.load("iiwa14")
    rng = np.random.default_rng(0)
    q, W = rng.normal(size=(3, 4, 7)), np.zeros((4, 7, 6))
    tip, elbow = rng.normal(size=(4, 6)), rng.normal(size=6)
    W[:, 6], W[:, 3] = tip, elbow
    named = robot.inverse_dynamics(*q, wrench={"link7": tip, "link4": elbow})
    assert relative_error(named, robot.inverse_dynamics(*q, wrench=W)) < 1e-14


def test_poses_of_the_planar_2r():
    C = jounce.load("planar2r", L1=2.0).poses([np.pi / 2, -np.pi / 2])
    np.testing.assert_allclose(C[1], [[1, 0, 0, 0], [0, 1, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-15)
