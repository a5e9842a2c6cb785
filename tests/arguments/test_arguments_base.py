"""The motion of the base as callers give it: what is wrong with it is said in one line, on every call."""

import numpy as np
import pandas
import pinocchio
import pytest

import jounce
from jounce.arguments.poses import pose_error
from jounce.dynamics.quantities import QUANTITIES
from support.refusals import expect_refusal, refusal
from support.robots import floating

ORIGIN, STILL = np.eye(4), np.zeros(6)
ZEROS = np.zeros((3, 2))


@pytest.fixture(scope="module")
def floating_planar2r():
    return jounce.Robot(floating(jounce.load("planar2r").mechanism, np.random.default_rng(1)))


def turned_pose(angle, scale=1.0):
    C, (c, s) = np.eye(4), (np.cos(angle), np.sin(angle))
    C[:2, :2] = scale * np.array([[c, -s], [s, c]])
    return C


SLIPS = [
    (None, "base is None, yet 'planar2r' floats; inverse_dynamics of order 0 takes base=(C, V, Vd): pose"),
    (ORIGIN, "base gives C alone; "),
    ([ORIGIN, STILL, STILL], "base gives C alone, as a list is one array; … takes base=(C, V, Vd)"),
    ({"pose": ORIGIN}, "base is {'pose': …; inverse_dynamics of order 0 takes base=(C, V, Vd)"),
    ((ORIGIN, pandas.Series(STILL, list("xyzabc")), STILL), "V of base has entries with names, 'x', 'y', 'z'"),
    ((ORIGIN, pinocchio.Motion.Zero(), STILL), "V of base is of type Motion, whose array is (linear; angular); exp"),
    ("floating", "base is 'floating'; inverse_dynamics of order 0 "),
    ((ORIGIN, STILL), "base gives 2 terms, up to V; "),
    ((ORIGIN, STILL, STILL, STILL), "base gives 4 terms, up to V2d; "),
    ((ORIGIN, None, STILL), "base: V is None; "),
    ((ORIGIN[:3], STILL, STILL), "base: C has shape (3, 4); expected (..., 4, 4)"),
    ((ORIGIN, STILL, np.zeros(3)), "base: Vd has shape (3,); expected (..., 6), (angular; linear)"),
    ((turned_pose(0.3, 1.01), STILL, STILL), "base: C is no pose: … is missed by 0.02; expected 1e-06 at most"),
    ((np.diag([1.0, 1, -1, 1]), STILL, STILL), "base: C is no pose: … is missed by 2;"),
    ((turned_pose(0.3).T + np.eye(4, k=-3), STILL, STILL), "base: C is no pose: … is missed by 1;"),
    ((np.stack([ORIGIN, 2 * ORIGIN]), STILL, STILL), "base: C of sample 1 is no pose: "),
    (("x", STILL, STILL), "C of base is "),
]


@pytest.mark.parametrize(("base", "message"), SLIPS, ids=[message[:40] for _, message in SLIPS])
def test_what_is_wrong_with_a_base_is_said(floating_planar2r, base, message):
    for _ in range(2):  # before and after a call that is well formed
        refusal(lambda: floating_planar2r.inverse_dynamics(*ZEROS, base=base), message)
        floating_planar2r.inverse_dynamics(*ZEROS, base=(ORIGIN, STILL, STILL))


@pytest.mark.parametrize("W", [{"body2": pinocchio.Force.Zero()}, [pinocchio.Force.Zero()] * 3], ids=["dict", "list"])
def test_forces_of_pinocchio_are_refused_as_linear_first(floating_planar2r, W):
    with expect_refusal("(linear; angular); expected (angular; linear): numpy.concatenate"):
        floating_planar2r.inverse_dynamics(*ZEROS, base=(ORIGIN, STILL, STILL), wrench=W)


def test_distances_from_poses_are_those_of_their_parts():
    near = turned_pose(0.7) + 1e-9 * np.ones((4, 4))
    assert 1e-9 < pose_error(near) < 1e-8
    assert pose_error(turned_pose(0.7)) < 1e-15
    assert np.array_equal(pose_error(np.stack([ORIGIN, 3 * ORIGIN])) > 1, [False, True])


def test_a_base_is_required_where_it_enters(floating_planar2r):
    free = {name for name, row in QUANTITIES.items() if "body" in row.takes.without_base}
    assert {"mass_matrix", "jacobian"} <= free
    floating_planar2r.jacobian(ZEROS[0], body="body2")
    refusal(
        lambda: floating_planar2r.jacobian(ZEROS[0], body="body2", frame="world"), "jacobian of order 0 takes base=C"
    )
    same = floating_planar2r.jacobian(ZEROS[0], body="body2", base=turned_pose(0.4))
    assert np.array_equal(same, floating_planar2r.jacobian(ZEROS[0], body="body2"))
    refusal(lambda: floating_planar2r.jacobian(ZEROS[0], body="body2", base=2 * ORIGIN), "is no pose")


def test_a_fixed_robot_stands_on_a_ground_that_may_move():
    robot, rng = jounce.load("planar2r"), np.random.default_rng(3)
    q, qd, q2d = rng.normal(size=(3, 5, 2))
    lifted = (turned_pose(0.0), np.zeros((5, 6)), np.tile([0, 0, 0, 0, 9.81, 0], (5, 1)))  # its gravity is along -y
    heavier = robot.inverse_dynamics(q, qd, q2d, base=lifted) - robot.inverse_dynamics(q, qd, q2d)
    assert np.allclose(heavier, robot.gravity_forces(q), atol=1e-12)
    assert np.array_equal(
        robot.inverse_dynamics(q, qd, q2d, base=(ORIGIN, STILL, STILL)).round(12),
        robot.inverse_dynamics(q, qd, q2d).round(12),
    )
