"""Wrenches that joints transmit: against joint forces, momenta of what is carried, power, and the ground's reaction."""

import numpy as np
from hypothesis import given

import jounce
from jounce.model.mechanism import ancestors
from jounce.spatial import lie
from support.bases import base_path, moved_mechanisms
from support.comparisons import assert_close
from support.refusals import expect_refusal
from support.robots import Interpreted, differentiated_at_once, harmonic, mechanisms, relative_error


@given(drawn=mechanisms())
def test_projected_on_the_screws_they_are_the_forces_of_the_joints(drawn):
    """Of joints that follow others too: G^T (X . F) = Q, and so are the rates: the screws are fixed in the bodies."""
    m, rng = drawn
    robot = Interpreted(jounce.Robot(m))
    q, W = rng.uniform(-2, 2, (5, m.n)), tuple(rng.normal(size=(3, m.nb, 6)))
    for F, Q in zip(robot.joint_wrenches(*q, wrench=W), robot.inverse_dynamics(*q, wrench=W), strict=True):
        assert_close((m.X * F).sum(axis=-1) @ m.G, Q, 1e-11)


@given(drawn=mechanisms())
def test_they_change_the_momentum_of_what_the_joints_carry(drawn):
    """Newton and Euler for each body with all that it carries, in the inertial frame, without a recursion."""
    m, rng = drawn
    robot, path = Interpreted(jounce.Robot(m)), harmonic(rng, m.n, 2)
    W, carries = rng.normal(size=(m.nb, 6)), ancestors(m).T

    def momenta(t):
        q, qd = path(t)[:2]
        C, V = robot.poses(q), robot.twists(q, qd)
        h = lie.Ad(lie.inverse(C)).mT @ (m.M @ V[..., None])
        return carries @ h[..., 0]

    C = robot.poses(path(0)[0])
    to_space = lie.Ad(lie.inverse(C)).mT
    at_rest = lie.Ad(lie.inverse(C)) @ np.concatenate([np.zeros(3), m.gravity])
    # the acceleration of gravity, seen from the bodies, moves their masses
    own = to_space @ (W - (m.M @ at_rest[..., None])[..., 0])[..., None]
    expected = differentiated_at_once(momenta) + carries @ own[..., 0]
    found = to_space @ robot.joint_wrenches(*path(0)[:3], wrench=W)[..., None]
    assert_close(found[..., 0], expected, 1e-8)


@given(drawn=moved_mechanisms())
def test_their_power_is_that_of_the_forces(drawn):
    """Each acts on its body and, reversed, on the parent; what is left is the power of Q, and that of the base."""
    m, rng = drawn
    robot, q = Interpreted(jounce.Robot(m)), rng.uniform(-2, 2, (3, m.n))
    base = base_path(rng, 4)(0.0)[:3]
    F, Q = (getattr(robot, name)(*q, base=base, method="recursion") for name in ("joint_wrenches", "inverse_dynamics"))
    if m.floats:
        assert_close(F[0], Q[:6], 1e-11)
    C, V = robot.poses(q[0], base=base[:1]), robot.twists(*q[:2], base=base[:2])
    power = 0.0
    for i in m.owners:
        p = m.parent[i]
        H, twist = (C[p], V[p]) if p >= 0 else base[:2]
        carried = lie.Ad(lie.inverse(C[i]) @ H) @ twist
        power += F[i] @ (V[i] - carried)
    assert_close(power, q[1] @ Q[-m.n :], 1e-11)


def test_the_ground_exerts_those_of_the_bodies_that_stand_on_it():
    robot, (q, qd, q2d) = jounce.load("iiwa14"), np.random.default_rng(3).uniform(-1, 1, (3, 7))
    F, C = robot.joint_wrenches(q, qd, q2d), robot.poses(q)
    assert relative_error(lie.Ad(lie.inverse(C[0])).T @ F[0], robot.base_wrench(q, qd, q2d)) < 1e-13


def test_rates_along_a_motion_are_those_of_the_kernel():
    robot, path = jounce.load("panda"), harmonic(np.random.default_rng(4), 7, 5)
    robot = jounce.load("panda", lock={"panda_finger_joint1": 0.02}) if robot.n > 7 else robot
    found = robot.compile("joint_wrenches", order=2)(*path(0.0)[:5])
    for k in (1, 2):
        along = differentiated_at_once(lambda t, k=k: np.stack(robot.joint_wrenches(*path(t)[: k + 3]))[k - 1])
        assert_close(found[k], along, 1e-7)


def test_closed_loops_are_refused():
    with expect_refusal("joint_wrenches of 'fivebar' depend on what its cut joints transmit"):
        jounce.load("fivebar").joint_wrenches([2.2, 0.9], [0, 0], [0, 0])
    tree = jounce.Robot(jounce.load("fivebar").mechanism.tree)
    assert tree.joint_wrenches(*np.zeros((3, 4))).shape == (4, 6)
