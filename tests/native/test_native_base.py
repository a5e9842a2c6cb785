"""Native code of robots with a base that moves: the loop over the bodies, poses checked on the short way of calls."""

import pickle
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import jounce
from jounce.arguments.poses import POSE_TOLERANCE, pose_error
from jounce.model.drive_trains import AMOUNTS, DRIVE_TERMS
from jounce.native import memory_layout
from jounce.native.laws import are_poses
from support.quantities import tupled
from support.refusals import expect_refusal, refusal
from support.robots import floating, random_mechanism, random_pose, relative_error


@cache
def branched_robot(afloat, bodies=24):
    """A tree of bodies, many of which take a loop, one joint of which follows another, with drives."""
    rng = np.random.default_rng(2)
    kinds = (["revolute", "prismatic", "helical", "revolute"] * 6)[:bodies]
    m = random_mechanism(rng, [-1, 0, -1, *range(2, bodies - 1)], kinds, [1.0] * bodies, mimic=True)
    drives = {name: rng.uniform(0.1, 1, bodies) for name in (*(AMOUNTS[term] for term in DRIVE_TERMS), "rest")}
    driven = jounce.Robot.from_screws(m.B, m.X, m.M, m.parent, gravity=m.gravity, G=m.G, g=m.g, drives=drives)
    of_all = driven.with_drives(eps=0.5).mechanism
    return jounce.Robot(floating(of_all, rng) if afloat else of_all)


def random_motion_on_base(of, order, *batch):
    rng = np.random.default_rng(7)
    q = [rng.uniform(-2, 2, (*batch, of.n)) for _ in range(order + 3)]
    C = np.array([random_pose(rng) for _ in range(int(np.prod(batch)))]).reshape(*batch, 4, 4)
    base = (C, *(rng.uniform(-2, 2, (*batch, 6)) for _ in range(order + 2)))
    W = tuple(rng.uniform(-3, 3, (*batch, len(of.body_names), 6)) for _ in range(order + 1))
    return q, base, W


@pytest.mark.parametrize("afloat", [True, False], ids=["floating", "on moving ground"])
def test_many_bodies_agree_with_the_recursion(afloat):
    of, order = branched_robot(afloat), 4
    q, base, W = random_motion_on_base(of, order, 3)
    kernel = of.compile(order=order, wrench=True, moving_base=True)
    assert not memory_layout.is_straight(kernel.computation, kernel.mechanism)
    expected = of.inverse_dynamics(*q, base=base, wrench=W, method="recursion")
    for x, y in zip(kernel(*q, *W, *base), expected, strict=True):
        assert relative_error(x, y) < 1e-13
    expected = of.gravity_forces(*q[:5], base=base[:5], method="recursion")
    for x, y in zip(of.gravity_forces(*q[:5], base=base[:5], method="kernel"), expected, strict=True):
        assert relative_error(x, y) < 1e-13


def test_a_kernel_with_a_base_is_bound_and_pickled():
    of = branched_robot(True, bodies=4)
    kernel = of.compile(order=1, wrench=True)
    assert repr(kernel).endswith("to order 1, with wrenches, with the motion of the base>")
    q, base, W = random_motion_on_base(of, 1, 20)
    arrays = [*q, *W, *base]
    expected = kernel(*arrays)
    for x, y in zip(pickle.loads(pickle.dumps(kernel))(*arrays), expected, strict=True):
        np.testing.assert_array_equal(x, y)
    out = [np.empty_like(x) for x in expected]
    kernel.bind(*arrays, out=out)()
    np.testing.assert_array_equal(out, expected)
    moving = branched_robot(False, bodies=4).compile(order=0, moving_base=True)
    assert moving.computation.keywords() == ["'inverse_dynamics'", "order=0", "moving_base=True"]
    with expect_refusal("^robot.compile('inverse_dynamics', order=0, moving_base=True) fixed what"):
        moving(*arrays, body="x")
    with expect_refusal("without base=: it takes q, qd, q2d, base_pose, base_twist, base_twistd$"):
        moving(*q[:3], base=base)
    fixed = branched_robot(False, bodies=4).compile(order=0)
    refusal(lambda: fixed(*q[:3], base=base), "compile another one with moving_base=True$")
    refusal(lambda: fixed(*q[:3], wrench=W), "compile another one with wrench=True$")


@pytest.mark.parametrize("batch", [(), (30,)])
def test_a_pose_that_is_none_is_refused_by_every_call(batch):
    """The first call of a form takes the long way, the others the short one."""
    of = branched_robot(True, bodies=4)
    q, base, _ = random_motion_on_base(of, 0, *batch)
    at = (17,) if batch else ()
    expected = of.inverse_dynamics(*q, base=base)
    for entry in np.ndindex(4, 4):
        if entry[0] < 3 and entry[1] == 3:
            continue  # the position
        C = base[0].copy()
        C[(*at, *entry)] += 3 * POSE_TOLERANCE
        with expect_refusal(re.compile(r"^base: C( of sample 17)? is no pose: ")):
            of.inverse_dynamics(*q, base=(C, *base[1:]))
    unknown = base[0].copy()
    unknown[(*at, 0, 0)] = np.nan
    found = of.inverse_dynamics(*q, base=(unknown, *base[1:]))
    assert np.isnan(found[at]).all()
    if batch:
        np.testing.assert_array_equal(np.delete(found, 17, axis=0), np.delete(expected, 17, axis=0))


def test_the_quick_check_is_no_laxer():
    rng = np.random.default_rng(0)
    C = np.array([random_pose(rng) for _ in range(50)])
    assert are_poses(C)
    assert are_poses(C[0])
    assert not are_poses(C * [[-1], [1], [1], [1]])  # of determinant -1
    bent = C + rng.normal(size=(20, 50, 4, 4)) * POSE_TOLERANCE
    wrong = (pose_error(bent) > POSE_TOLERANCE).ravel()
    assert 0 < wrong.sum() < wrong.size
    assert not any(map(are_poses, bent.reshape(-1, 4, 4)[wrong]))
    assert not are_poses(np.full((4, 4), np.nan))


def test_results_of_a_call_are_those_of_the_kernel():
    of = branched_robot(True, bodies=4)
    q, base, W = random_motion_on_base(of, 1, 9)
    kernel = of.compile(order=1, wrench=True)
    for _ in range(2):
        for x, y in zip(of.inverse_dynamics(*q, base=base, wrench=W), kernel(*q, *W, *base), strict=True):
            np.testing.assert_array_equal(x, y)
    M = of.mechanism.M
    masses = replace(of.mechanism, M=np.concatenate([2 * M[:1], M[1:]]))
    other = tupled(jounce.Robot(masses).inverse_dynamics(*q, base=base, wrench=W))
    for x, y in zip(other, kernel(*q, *W, *base), strict=True):
        np.testing.assert_array_equal(x[:, 6:], y[:, 6:])
        assert not np.allclose(x[:, :6], y[:, :6])


def test_elastic_joints_on_a_base_that_moves():
    """Spong's model, by native code: the springs carry the forces of the joints, which are the last rows."""
    of, rng = branched_robot(True, bodies=3).with_drives(False), np.random.default_rng(0)
    stiffness, rotor = rng.uniform(500, 900, of.n), rng.uniform(0.1, 0.3, of.n)
    arm = of.elastic(stiffness, rotor=rotor)
    q, base, W = random_motion_on_base(of, 2, 3)
    Q = [x[..., 6:] for x in of.inverse_dynamics(*q, base=base, wrench=W)]
    theta = arm.motor_positions(*q, base=base, wrench=W)
    for x, own, force in zip(theta, q, Q, strict=False):
        assert relative_error(x, own + force / stiffness) < 1e-13
    assert relative_error(arm.motor_torques(*q, base=base, wrench=W), Q[0] + rotor * theta[2]) < 1e-12
    assert "with the motion of the base" in repr(arm.compile("motor_torques", 0))
    for call in (lambda: arm.elastic_forward_dynamics(*q), lambda: arm.elastic_energy(*q[:4])):
        refusal(call, re.compile(r"^\w+: the base of 'robot' moves; expected one at rest"))
    coupled = replace(arm.elasticity, level=0)
    with expect_refusal("^motor_torques of 'robot': its base moves, and coupling=0 of rotors and"):
        jounce.Robot(replace(of.mechanism, elasticity=coupled)).compile("motor_torques", 0)
