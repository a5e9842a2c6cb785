"""Laws that hold of every closed robot: rates, power, equations of motion, and independence of where loops are cut."""

import numpy as np
import pytest
from loops import LOOP_ROBOTS, content, loaded, fivebar_cut_at_elbow, motion_near_start, platform_on_leg_four
from robots import WEIGHTS, relative_error

import jounce

FASTEST = {"method": "recursion"}
H = 0.02  # s, of differences over nine points
TIMES = H * np.array([*WEIGHTS, *(-k for k in WEIGHTS)])
DIFFERENCE = np.array([*WEIGHTS.values(), *(-w for w in WEIGHTS.values())]) / H


@pytest.fixture(scope="module")
def closed(tmp_path_factory):
    """The bundled robots with loops, read once."""
    folder = tmp_path_factory.mktemp("loops")
    return {name: loaded(content(name), folder) for name in LOOP_ROBOTS}


RATES = {  # of quantities: how many rates of q they take themselves
    "inverse_dynamics": 2,
    "coriolis_matrix": 1,
    "coordinates": 0,
    "mass_matrix": 0,
    "gravity_forces": 0,
    "jacobian": 0,
    "momentum": 1,
    "generalized_momentum": 1,
    "base_wrench": 2,
    "loop_wrenches": 2,
}
MANY_JOINTS = ("inverse_dynamics", "coriolis_matrix", "coordinates")  # of the robot that takes longest


@pytest.fixture(scope="module")
def nearby(closed):
    """States of each robot at one time and at those before and after it that differences take: all joints, and rates."""
    found = {}
    for name, robot in closed.items():
        motion = motion_near_start(robot, np.random.default_rng(2), 4)
        for times in (np.array(0.0), TIMES):
            q, *rates = motion(times)
            found[name, times.shape] = [robot.coordinates(q), *rates]
    return found


@pytest.mark.parametrize(
    ("name", "quantity"),
    [(name, x) for name in LOOP_ROBOTS for x in (MANY_JOINTS if name == "gough_stewart" else RATES)],
)
def test_rates_are_derivatives_along_the_motion(closed, nearby, name, quantity):
    """The first rate against nine-point differences of the value, the second against those of the first."""
    compute, at_rest = getattr(closed[name], quantity), RATES[quantity]

    def rates(times, order):
        return compute(*nearby[name, times.shape][: at_rest + order + 1], **FASTEST)

    _, first, second = rates(np.array(0.0), 2)
    value, rate = rates(TIMES, 1)
    for found, differenced in ((first, value), (second, rate)):
        assert relative_error(found, np.tensordot(DIFFERENCE, differenced, axes=1)) < 1e-8


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_forces_give_their_power_to_the_energy(closed, name):
    robot = closed[name]
    q, qd, q2d = motion_near_start(robot, np.random.default_rng(3), 2)(np.linspace(0, 2, 3))
    Q = robot.inverse_dynamics(q, qd, q2d, **FASTEST)
    gain = robot.kinetic_energy(q, qd, q2d, **FASTEST)[1] + robot.potential_energy(q, qd, **FASTEST)[1]
    assert relative_error(gain, np.sum(Q * qd, axis=-1)) < 1e-12


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_equations_of_motion(closed, name):
    """Q = M q2d + C qd + Qgrav with both matrices, Md - 2 Cbar is skew, T = qd M qd / 2, p = M qd."""
    robot = closed[name]
    q, qd, q2d = motion_near_start(robot, np.random.default_rng(4), 2)(0.3)
    M, Md = robot.mass_matrix(q, qd, **FASTEST)
    Cbar = robot.coriolis_matrix(q, qd, form="skew", **FASTEST)
    rest = robot.inverse_dynamics(q, qd, q2d, **FASTEST) - M @ q2d - robot.gravity_forces(q, **FASTEST)
    assert relative_error(robot.coriolis_matrix(q, qd, **FASTEST) @ qd, rest) < 1e-11
    assert relative_error(Cbar @ qd, rest) < 1e-11
    assert np.abs(Md - 2 * Cbar + (Md - 2 * Cbar).T).max() < 1e-12 * np.abs(M).max()
    assert relative_error(robot.kinetic_energy(q, qd, **FASTEST), qd @ M @ qd / 2) < 1e-12
    assert relative_error(robot.generalized_momentum(q, qd, **FASTEST), M @ qd) < 1e-12


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_bodies_move_as_those_of_the_tree(closed, name):
    robot = closed[name]
    tree, q = jounce.Robot(robot.mechanism.tree), motion_near_start(robot, np.random.default_rng(5), 3)(1.1)
    on_tree = robot.coordinates(*q)
    for quantity, given in {"poses": 2, "twists": 3, "momentum": 3, "base_wrench": 4}.items():
        found = getattr(robot, quantity)(*q[:given], **FASTEST)
        expected = getattr(tree, quantity)(*on_tree[:given], **FASTEST)
        for x, y in zip(found, expected, strict=True) if isinstance(found, tuple) else [(found, expected)]:
            assert relative_error(x, y) < 1e-12, quantity


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_forward_dynamics_inverts_inverse_dynamics(closed, name):
    robot = closed[name]
    u = motion_near_start(robot, np.random.default_rng(6), 4)(0.9)
    Q = robot.inverse_dynamics(*u, **FASTEST)
    for method in ("recursion", "closed_form"):
        for found, expected in zip(robot.forward_dynamics(*u[:2], *Q, method=method), u[2:], strict=True):
            assert relative_error(found, expected) < 1e-10


ELSEWHERE = {"fivebar": fivebar_cut_at_elbow, "gough_stewart": platform_on_leg_four}


@pytest.mark.parametrize("name", ELSEWHERE)
def test_forces_do_not_depend_on_the_cut(closed, name, tmp_path):
    robot, other = closed[name], loaded(ELSEWHERE[name](), tmp_path)
    assert {loop.name for loop in other.mechanism.loops}.isdisjoint({loop.name for loop in robot.mechanism.loops})
    u = motion_near_start(robot, np.random.default_rng(7), 4)(0.4)
    for found, expected in zip(
        other.inverse_dynamics(*u, **FASTEST), robot.inverse_dynamics(*u, **FASTEST), strict=True
    ):
        assert relative_error(found, expected) < 1e-11


def test_redundant_motors_share_the_forces(closed):
    """u = W^-1 B (B^T W^-1 B)^-1 Q with B the rows of F of the motors: B^T u = Q, and the weighted squares are least."""
    robot, motors = closed["fivebar"], ["left_shoulder", "right_shoulder", "left_elbow"]
    tree, weights = jounce.Robot(robot.mechanism.tree), {"left_elbow": 4.0}
    driven = tree.closed(robot.mechanism.loops, motors, coordinates=motors[:2], start=START, weights=weights)
    u = motion_near_start(robot, np.random.default_rng(8), 4)(0.2)
    Q = robot.inverse_dynamics(*u, **FASTEST)
    assert relative_error(driven.inverse_dynamics(*u, **FASTEST), Q) < 1e-13
    places = [robot.mechanism.tree.coordinates.index(joint) for joint in motors]
    B = np.stack([robot.coordinates(u[0], e)[1][places] for e in np.eye(2)], axis=-1)
    shares = driven.actuator_forces(*u, **FASTEST)
    W = np.diag([1.0, 1.0, 4.0])
    assert relative_error(B.T @ shares[0], Q[0]) < 1e-12
    assert relative_error(W @ shares[0], B @ np.linalg.lstsq(B, W @ shares[0])[0]) < 1e-12  # no share works for nothing
    found = np.array([driven.actuator_forces(*x, **FASTEST) for x in zip(*motion_near_start(robot, np.random.default_rng(8), 2)(0.2 + TIMES), strict=True)])
    assert relative_error(shares[1], np.tensordot(DIFFERENCE, found, axes=1)) < 1e-8


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_cut_joints_transmit_what_keeps_the_tree_in_motion(closed, name):
    """The tree under the wrenches of its cut joints needs the forces of the motors, and none at the other joints."""
    robot = closed[name]
    m, tree = robot.mechanism, jounce.Robot(robot.mechanism.tree)
    u = motion_near_start(robot, np.random.default_rng(9), 2)(0.6)
    q, qd, q2d = robot.coordinates(*u)
    C, W = tree.poses(q), np.zeros((m.nb, 6))
    for loop, wrench in zip(m.loops, robot.loop_wrenches(*u, **FASTEST), strict=True):
        at_cut = C[loop.a.body] @ loop.a.T
        for sign, body in ((1, loop.a.body), (-1, loop.b.body)):  # W is what a body exerts on others
            W[body] += sign * lie.Ad(lie.inverse(lie.inverse(C[body]) @ at_cut)).T @ wrench
    Q = tree.inverse_dynamics(q, qd, q2d, wrench=W)
    expected = np.zeros(tree.n)
    expected[list(m.closure.independent)] = robot.inverse_dynamics(*u, **FASTEST)
    assert relative_error(Q, expected) < 1e-11
