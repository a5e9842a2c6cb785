"""Joints of several screws: forces and what follows from them against independent oracles."""

from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce._codegen.test_vectors import derivative_product
from jounce.dynamics.computation import Computation
from jounce.model import positions
from jounce.native.kernel import compile_kernel
from support.momentum_jets import forces_by_jets, start_of
from support.refusals import expect_refusal, refusal
from support.robots import random_pose, relative_error
from support.several_screws import TREES, screw_robot
from support.states import random_inputs

ROBOTS = [(name, tilted, floats) for name in TREES for tilted in (False, True) for floats in (False, True)]


def series_results(
    computation: Computation, method: str, robot: jounce.Robot, arrays: list[np.ndarray]
) -> list[np.ndarray]:
    series = computation.series(method, robot.mechanism, arrays)
    return [np.asarray(series[k]) for k in range(computation.count)]


@pytest.mark.parametrize(("name", "tilted", "floats"), ROBOTS)
def test_forces_are_rates_of_momenta_in_space(name, tilted, floats):
    robot, rng = screw_robot(name, floats=floats, tilted=tilted), np.random.default_rng(2)
    q = rng.normal(size=robot.nq - 7 * floats).astype(np.longdouble)
    rates = rng.uniform(-1, 1, (6, robot.nv)).astype(np.longdouble)
    base = (random_pose(rng).astype(np.longdouble), *rates[:5, :6]) if floats else None
    start = start_of(robot.mechanism, q, base[0] if base else None)
    expected = forces_by_jets(robot.mechanism, start, list(rates), 3)
    found = robot.inverse_dynamics(q, *rates[:5, 6 * floats :], base=base, method="recursion")
    for Q, reference in zip(found, expected, strict=True):
        assert relative_error(Q, reference) < 1e-12


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("name", "tilted", "floats"), ROBOTS)
def test_forward_is_the_inverse_of_inverse(name, tilted, floats):
    robot, rng = screw_robot(name, floats=floats, tilted=tilted), np.random.default_rng(3)
    q, rates = rng.normal(size=robot.nq), rng.uniform(-1, 1, (5, robot.nv))
    Q = robot.inverse_dynamics(q, *rates[:5])
    for method in ("recursion", "closed_form", None):
        for k, found in enumerate(robot.forward_dynamics(q, rates[0], *Q, method=method)):
            assert relative_error(found, rates[k + 1]) < 1e-10 * 10**k


@pytest.mark.parametrize("name", ["ball", "free"])
def test_a_body_that_nothing_turns_keeps_its_momentum(name):
    robot, rng = screw_robot(name, seed=4), np.random.default_rng(4)
    weightless = jounce.Robot(replace(robot.mechanism, gravity=np.zeros(3)))
    q, v, none = rng.normal(size=robot.nq), rng.uniform(-2, 2, robot.n), np.zeros(robot.n)
    rates = weightless.forward_dynamics(q, v, *[none] * 5)
    h = weightless.momentum(q, v, *rates)
    own = slice(0, 3) if name == "ball" else slice(0, 6)  # about the point of the ball, which holds its place
    h0 = momentum_at_joint(weightless, h[0], q)[own]
    for k in range(1, 5):
        assert np.abs(momentum_at_joint(weightless, h[k], q)[own]).max() < 1e-13 * np.abs(h0).max() * 10**k


def momentum_at_joint(robot: jounce.Robot, h: np.ndarray, q: np.ndarray) -> np.ndarray:
    """A momentum about the place where the joint of the first body is."""
    r = robot.mechanism.B[0, :3, 3] if len(robot.joint_names) == 3 else np.zeros(3)
    return np.concatenate([h[:3] - np.cross(r, h[3:]), h[3:]])


def test_a_free_body_falls_without_force():
    robot, rng = screw_robot("free", seed=5), np.random.default_rng(5)
    q, v = rng.normal(size=7), rng.uniform(-2, 2, 6)
    rates = robot.forward_dynamics(q, v, *[np.zeros(6)] * 4)
    for Q in robot.inverse_dynamics(q, v, *rates):
        assert np.abs(Q).max() < 1e-11
    c = robot.center_of_mass(q, v, *rates[:3])
    np.testing.assert_allclose(c[2], robot.gravity, atol=1e-12)
    np.testing.assert_allclose(c[3], 0, atol=1e-11)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("product_", ["vjp", "jvp"])
@pytest.mark.parametrize("quantity", ["inverse_dynamics", "mass_matrix", "poses", "forward_dynamics"])
@pytest.mark.parametrize(("name", "floats"), [("branches", False), ("forest", True)])
def test_kernels_and_their_derivatives(name, floats, quantity, product_):
    robot = screw_robot(name, floats=floats, tilted=True)
    values = Computation(quantity, 1, base=floats and quantity != "mass_matrix")
    arrays = random_inputs(values.signature(robot.mechanism).inputs, seed=6, size=1.0)
    found = compile_kernel(robot.mechanism, values)(*arrays)
    for x, reference in zip(found, series_results(values, "closed_form", robot, arrays), strict=True):
        assert relative_error(x, reference) < 1e-11
    asked = replace(values, product=product_)
    arrays = random_inputs(asked.signature(robot.mechanism).inputs, seed=7, size=1.0)
    expected = derivative_product(asked, "recursion", robot.mechanism, [x[None] for x in arrays])
    found = compile_kernel(robot.mechanism, asked)(*arrays)
    for x, reference in zip(found, expected, strict=True):
        assert relative_error(x, reference[0]) < 1e-10


@pytest.mark.parametrize("name", list(TREES))
def test_partials_are_those_along_displacements(name):
    robot, rng = screw_robot(name, tilted=True), np.random.default_rng(8)
    m, h = robot.mechanism, 1e-6
    q, v, a = rng.normal(size=robot.nq), *rng.uniform(-1, 1, (2, robot.n))
    P = robot.inverse_dynamics_partials(q, v, a)
    N, unit = positions.rate_map(m, q), np.eye(robot.n)
    for j, steps in enumerate(((N, 0, 0), (0, unit, 0), (0, 0, unit))):
        ahead, behind = (
            robot.inverse_dynamics(*(x + s * h * np.asarray(d).T for x, d in zip((q, v, a), steps, strict=True)))
            for s in (1, -1)
        )
        assert relative_error(P[j], (ahead - behind).T / (2 * h)) < 1e-7


@pytest.mark.parametrize("name", list(TREES))
def test_the_length_and_the_sign_of_a_quaternion_do_not_matter(name):
    robot, rng = screw_robot(name), np.random.default_rng(9)
    q, v, a = rng.normal(size=robot.nq), *rng.uniform(-1, 1, (2, robot.n))
    other = q.copy()
    for joint in positions.multiscrew_joints(robot.mechanism).values():
        other[joint.numbers.start + len(joint.group.places) : joint.numbers.stop] *= -2.5
        if joint.group.name == "planar":  # the sign of cosine and sine does
            other[joint.numbers.start + 2 : joint.numbers.stop] *= -1
    np.testing.assert_allclose(robot.inverse_dynamics(other, v, a), robot.inverse_dynamics(q, v, a), rtol=1e-10)


def test_states_by_joint_name():
    robot, rng = screw_robot("forest"), np.random.default_rng(10)
    q, v = rng.normal(size=robot.nq), rng.uniform(-1, 1, robot.n)
    joints = positions.multiscrew_joints(robot.mechanism).values()
    several = {j for joint in joints for j in range(joint.coordinates.start, joint.coordinates.stop)}
    [single] = [name for j, name in enumerate(robot.joint_names) if j not in several]
    [k] = set(range(robot.nq)) - {k for joint in joints for k in range(joint.numbers.start, joint.numbers.stop)}
    numbers = {joint.name: q[joint.numbers] for joint in joints} | {single: q[k]}
    turned = numbers | {joint.name: joint.group.pose(q[joint.numbers]) for joint in joints}
    rates = {joint.name: v[joint.coordinates] for joint in joints} | {single: v[robot.joint_names.index(single)]}
    expected = robot.twists(q, v)
    np.testing.assert_allclose(robot.twists(numbers, rates), expected, rtol=1e-12)
    np.testing.assert_allclose(robot.twists(turned, rates), expected, rtol=1e-9, atol=1e-12)


def test_a_whole_floating_robot_as_one_state():
    robot, rng = screw_robot("branches", floats=True), np.random.default_rng(11)
    q, (v, a) = rng.normal(size=robot.nq), rng.uniform(-1, 1, (2, robot.nv))
    assert (robot.nq, robot.nv, robot.n) == (30, 25, 19)
    Q = robot.inverse_dynamics(q, v, a)
    C = robot.poses(q, body=robot.body_names[0])
    np.testing.assert_array_equal(Q, robot.inverse_dynamics(q[7:], v[6:], a[6:], base=(C, v[:6], a[:6])))


@pytest.mark.parametrize(("q", "message"), [
    (np.ones(3), "q has shape (3,); expected (..., 4): …; 3 are velocities"),
    (np.zeros(4), "^q: qx, qy, qz, qw of joint … have the length 0; expected 1"),
    ({"joint1": np.zeros(4)}, "^q: qx, qy, qz, qw of joint 'joint1' have the length 0; expected 1"),
    ({"ball": 1.0}, "unknown 'ball'"),
], ids=["velocities", "zero", "zero by name", "unknown"])  # fmt: skip
def test_positions_that_are_none(q, message):
    refusal(lambda: screw_robot("ball").gravity_forces(q), message)


def test_a_matrix_that_is_no_rotation():
    robot = screw_robot("ball")
    [joint] = positions.multiscrew_joints(robot.mechanism).values()
    refusal(lambda: robot.gravity_forces({joint.name: np.ones((3, 3))}), f"joint {joint.name!r} is no pose")
    planar = screw_robot("planar")
    [joint] = positions.multiscrew_joints(planar.mechanism).values()
    anywhere = {joint.name: random_pose(np.random.default_rng(0))}
    refusal(lambda: planar.gravity_forces(anywhere), "is a planar joint, which the pose misses")


@pytest.mark.parametrize(
    ("X", "message"),
    [(np.eye(6)[:2], "the joint of body 'body1' is no ball, planar or free joint"), (np.eye(6)[[0, 1, 3]], "no ball")],
)
def test_screws_that_are_no_joint(X, message):
    M = jounce.inertia_matrix(1.0, [0, 0, 0], np.eye(3))
    refusal(lambda: jounce.Robot.from_screws([np.eye(4)], X, [M], owners=[0] * len(X)), message)


@pytest.mark.parametrize("G", [np.eye(4)[[1, 0, 2, 3]], np.vstack([np.eye(3), [1, 0, 0]]), 2 * np.eye(4)])
def test_a_ball_has_coordinates_of_its_own(G):
    M = [jounce.inertia_matrix(1.0, [0, 0, 0], np.eye(3))] * 2
    X = [*np.eye(6)[:3], np.eye(6)[2]]
    with expect_refusal("the ball joint of body 'body1' follows others, or others follow it"):
        jounce.Robot.from_screws([np.eye(4)] * 2, X, M, owners=[0, 0, 0, 1], G=G)
