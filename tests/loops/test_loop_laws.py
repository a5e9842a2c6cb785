"""Laws that hold of every closed robot: rates, power, equations of motion, and independence of where loops are cut."""

import numpy as np
import pytest

import jounce
from jounce.spatial import lie
from support.closed_robots import (
    LOOP_ROBOTS,
    at_zero,
    content,
    driven_content,
    fivebar_cut_at_elbow,
    loaded,
    motion_near_start,
    platform_on_leg_four,
)
from support.refusals import refusal
from support.robots import WEIGHTS, relative_error

RECURSION = {"method": "recursion"}
H = 0.02  # s, of differences over nine points
TIMES = H * np.array([0, *WEIGHTS, *(-k for k in WEIGHTS)])
DIFFERENCE = np.array([0, *WEIGHTS.values(), *(-w for w in WEIGHTS.values())]) / H


@pytest.fixture(scope="module")
def at_times(closed):
    """Of each robot at TIMES: all joint positions, loops closed, and the rates of the independent coordinates."""
    found = {}
    for name, robot in closed.items():
        q, *rates = motion_near_start(robot, np.random.default_rng(2), 4)(TIMES)
        found[name] = [robot.coordinates(q, **RECURSION), *rates]
    return found


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
OF_MANY_JOINTS = ("inverse_dynamics", "coriolis_matrix")  # for the robot that takes longest


@pytest.mark.parametrize(
    ("name", "quantity"),
    [(name, x) for name in LOOP_ROBOTS for x in (OF_MANY_JOINTS if name == "gough_stewart" else RATES)],
)
def test_rates_are_derivatives_along_the_motion(closed, at_times, name, quantity):
    """The first rate against nine-point differences of the value, the second against those of the first."""
    compute, count = getattr(closed[name], quantity), RATES[quantity] + 2
    _, first, second = compute(*at_zero(at_times[name][: count + 1]), **RECURSION)
    for found, along in zip((first, second), compute(*at_times[name][:count], **RECURSION), strict=True):
        assert relative_error(found, np.tensordot(DIFFERENCE, along, axes=1)) < 1e-8


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_forces_give_their_power_to_the_energy(closed, at_times, name):
    robot, (q, qd, q2d, *_) = closed[name], at_times[name]
    Q = robot.inverse_dynamics(q, qd, q2d, **RECURSION)
    gain = robot.kinetic_energy(q, qd, q2d, **RECURSION)[1] + robot.potential_energy(q, qd, **RECURSION)[1]
    assert relative_error(gain, np.sum(Q * qd, axis=-1)) < 1e-12


@pytest.mark.parametrize("name", LOOP_ROBOTS)
def test_equations_of_motion(closed, at_times, name):
    """Q = M q2d + C qd + Qgrav with both matrices, Md - 2 Cbar is skew, T = qd M qd / 2, p = M qd."""
    robot, (q, qd, q2d) = closed[name], at_zero(at_times[name][:3])
    M, Md = robot.mass_matrix(q, qd, **RECURSION)
    Cbar = robot.coriolis_matrix(q, qd, form="skew", **RECURSION)
    Q = robot.inverse_dynamics(q, qd, q2d, **RECURSION)
    rest, rounding = Q - M @ q2d - robot.gravity_forces(q, **RECURSION), 1e-13 * np.abs(Q).max()
    assert np.abs(robot.coriolis_matrix(q, qd, **RECURSION) @ qd - rest).max() < rounding
    assert np.abs(Cbar @ qd - rest).max() < rounding
    assert np.abs(Md - 2 * Cbar + (Md - 2 * Cbar).T).max() < 1e-12 * np.abs(M).max()
    assert relative_error(robot.kinetic_energy(q, qd, **RECURSION), qd @ M @ qd / 2) < 1e-12
    assert relative_error(robot.generalized_momentum(q, qd, **RECURSION), M @ qd) < 1e-12


@pytest.mark.parametrize("name", ["fivebar", "delta", "fourbar_leg"])
def test_bodies_move_as_those_of_the_tree(closed, at_times, name):
    robot, q = closed[name], at_zero(at_times[name])
    tree, on_tree = jounce.Robot(robot.mechanism.tree), robot.coordinates(*q[:4], **RECURSION)
    for quantity, count in {"poses": 2, "twists": 3, "momentum": 3, "base_wrench": 4}.items():
        found = getattr(robot, quantity)(*q[:count], **RECURSION)
        expected = getattr(tree, quantity)(*on_tree[:count], **RECURSION)
        for x, y in zip(found, expected, strict=True):
            assert relative_error(x, y) < 1e-12, quantity


@pytest.mark.parametrize("method", ["recursion", "closed_form"])
@pytest.mark.parametrize("name", ["fivebar", "delta", "fourbar_leg"])
def test_forward_dynamics_inverts_inverse_dynamics(closed, at_times, name, method):
    robot, u = closed[name], at_zero(at_times[name])
    Q = robot.inverse_dynamics(*u, **RECURSION)
    for found, expected in zip(robot.forward_dynamics(*u[:2], *Q, method=method), u[2:], strict=True):
        assert relative_error(found, expected) < 1e-10


@pytest.fixture(scope="module")
def driven_fivebar(tmp_path_factory):
    """The five-bar with drive trains that act, at all joints."""
    return loaded(driven_content(content("fivebar")), tmp_path_factory.mktemp("driven"), drives=True)


@pytest.mark.parametrize(
    ("name", "methods"),
    [("driven", ["recursion", "closed_form", "kernel"]), ("fivebar", ["recursion"]), ("delta", ["recursion"])],
)
def test_partial_derivatives_are_differences(closed, at_times, driven_fivebar, name, methods):
    """Of Q and Qd by q, qd, q2d, q3d, over nine points; loops are closed at each of them."""
    robot = driven_fivebar if name == "driven" else closed[name]
    u = at_zero(at_times["fivebar" if name == "driven" else name][:4])
    u[0] = u[0][list(robot.mechanism.closure.independent)]
    steps = TIMES[:, None, None, None, None] * np.eye(4 * robot.n).reshape(4, robot.n, 4, robot.n)
    near = robot.inverse_dynamics(*np.moveaxis(np.stack(u) + steps, -2, 0), **RECURSION)  # (9, 4, n, n) each
    for method in methods:
        for P, along in zip(robot.inverse_dynamics_partials(*u, method=method), near, strict=True):
            expected = np.tensordot(DIFFERENCE, along, axes=1).mT[: len(P)]
            assert np.abs(P - expected).max() < 1e-8 * np.abs(P).max()


@pytest.mark.parametrize("method", ["recursion", "closed_form"])
def test_drives_of_all_joints_take_their_power(driven_fivebar, at_times, method):
    """d/dt (T + U) = Q . qd - dissipation, of the tree's joints; springs are in U, armature in T."""
    q, qd, q2d = at_zero(at_times["fivebar"][:3])
    Q, G = driven_fivebar.inverse_dynamics(q, qd, q2d, method=method), driven_fivebar.gravity_forces(q, method=method)
    gain = (
        driven_fivebar.kinetic_energy(q, qd, q2d, **RECURSION)[1]
        + driven_fivebar.potential_energy(q, qd, **RECURSION)[1]
    )
    drives, rates = driven_fivebar.drives, driven_fivebar.coordinates(q, qd, **RECURSION)[1]
    lost = drives.damping * rates**2 + drives.friction * np.tanh(rates / drives.eps) * rates
    assert Q @ qd - lost.sum() == pytest.approx(gain, rel=1e-11)
    assert np.isfinite(G).all()


ELSEWHERE = {"fivebar": fivebar_cut_at_elbow, "gough_stewart": platform_on_leg_four}


@pytest.mark.filterwarnings("ignore:.*bodies without mass that carry mass:jounce.JounceWarning")
@pytest.mark.parametrize("name", ELSEWHERE)
def test_forces_do_not_depend_on_the_cut(closed, at_times, name, tmp_path):
    robot, other = closed[name], loaded(ELSEWHERE[name](), tmp_path)
    assert not {loop.name for loop in other.mechanism.loops} & {loop.name for loop in robot.mechanism.loops}
    u = at_zero(at_times[name])
    own = u[0][list(robot.mechanism.closure.independent)]
    found = other.inverse_dynamics(own, *u[1:], **RECURSION)
    for x, y in zip(found, robot.inverse_dynamics(*u, **RECURSION), strict=True):
        assert relative_error(x, y) < 1e-11


def test_redundant_motors_share_the_forces(closed, at_times):
    """B^T u = Q with the rows B of F of the motors; the weighted sum of squares is least, so that W u = B x."""
    robot, motors = closed["fivebar"], ["left_shoulder", "right_shoulder", "left_elbow"]
    tree, start = jounce.Robot(robot.mechanism.tree), robot.mechanism.closure.start
    options = {"coordinates": motors[:2], "start": start, "weights": {"left_elbow": 4.0}}
    driven = tree.closed(robot.mechanism.loops, motors, **options)
    u = at_zero(at_times["fivebar"])
    Q = robot.inverse_dynamics(*u, **RECURSION)
    for found, expected in zip(driven.inverse_dynamics(*u, **RECURSION), Q, strict=True):
        assert relative_error(found, expected) < 1e-13
    places = [tree.joint_names.index(joint) for joint in motors]
    B = np.stack([robot.coordinates(u[0], e, **RECURSION)[1][places] for e in np.eye(2)], axis=-1)
    shares = driven.actuator_forces(*u, **RECURSION)
    weighted = np.array([1.0, 1.0, 4.0]) * shares[0]
    assert relative_error(B.T @ shares[0], Q[0]) < 1e-12
    assert relative_error(B @ np.linalg.lstsq(B, weighted)[0], weighted) < 1e-12
    for found, along in zip(shares[1:], driven.actuator_forces(*at_times["fivebar"][:4], **RECURSION), strict=True):
        assert relative_error(found, np.tensordot(DIFFERENCE, along, axes=1)) < 1e-8


@pytest.mark.parametrize(
    ("name", "coordinates", "motors"),
    [
        *((name, None, None) for name in LOOP_ROBOTS),
        ("delta", ["x", "y", "z"], None),
        ("delta", ["x", "motor2", "z"], None),
        ("fivebar", ["left_elbow", "right_elbow"], None),
        ("fivebar", ["left_shoulder", "right_elbow"], ["left_shoulder", "right_shoulder", "left_elbow"]),
    ],
)
def test_cut_joints_transmit_what_keeps_the_tree_in_motion(closed, name, coordinates, motors):
    """The tree under the wrenches of its cut joints needs the forces of the motors, and none at the other joints.

    So it does at every order, whichever coordinates move the robot.
    """
    robot = closed[name] if coordinates is None else closed[name].closed(actuated=motors, coordinates=coordinates)
    m, tree = robot.mechanism, jounce.Robot(robot.mechanism.tree)
    u = motion_near_start(robot, np.random.default_rng(2), 4)(TIMES)
    q = robot.coordinates(*u, **RECURSION)
    C, W = tree.poses(q[0], **RECURSION), np.zeros((len(TIMES), m.nb, 6))
    cuts, forces = robot.loop_wrenches(*u, **RECURSION), robot.actuator_forces(*u, **RECURSION)
    for k, loop in enumerate(m.loops):
        at_cut = C[:, loop.a.body] @ loop.a.T
        for sign, body in ((1, loop.a.body), (-1, loop.b.body)):  # W is what a body exerts on others
            W[:, body] += (
                sign * (lie.Ad(lie.inverse(lie.inverse(C[:, body]) @ at_cut)).mT @ cuts[0][:, k, :, None])[..., 0]
            )
    rates = [np.tensordot(DIFFERENCE, W, axes=1)]
    found = tree.inverse_dynamics(*(x[0] for x in q[:4]), wrench=(W[0], *rates), **RECURSION)
    for order, exact in enumerate((1e-11, 1e-8)):
        expected = np.zeros(tree.n)
        expected[list(m.closure.actuated)] = forces[order][0]
        assert relative_error(found[order], expected) < exact
    for order in (1, 2):
        assert relative_error(cuts[order][0], np.tensordot(DIFFERENCE, cuts[order - 1], axes=1)) < 1e-8


@pytest.mark.parametrize("name", ["fivebar", "delta"])
def test_a_locked_robot_is_the_whole_one_with_a_joint_at_rest(closed, at_times, name):
    robot, (q, *rates) = closed[name], at_zero(at_times[name])
    own = q[list(robot.mechanism.closure.independent)]
    own[0] += 0.7
    held = robot.locked({robot.joint_names[0]: own[0]})
    assert held.joint_names == robot.joint_names[1:]
    moving = [x * (np.arange(robot.n) > 0) for x in rates]
    found = held.inverse_dynamics(own[1:], *(x[1:] for x in moving), **RECURSION)
    for x, y in zip(found, robot.inverse_dynamics(own, *moving, **RECURSION), strict=True):
        assert relative_error(x, y[1:]) < 1e-11
    refusal(lambda: robot.locked({robot.mechanism.tree.coordinates[1]: 0.0}), "cannot be locked", *robot.joint_names)
    refusal(lambda: robot.locked(dict(zip(robot.joint_names, own, strict=True))), "joints are locked; expected one")


@pytest.mark.filterwarnings("ignore:.*bodies without mass that carry mass:jounce.JounceWarning")
def test_the_mass_matrix_is_regular_with_mass_beyond_the_cut(closed, at_times, tmp_path):
    """The massless link moves the forearm that the tree carries elsewhere."""
    said = fivebar_cut_at_elbow()
    del said["bodies"][0]["inertia"]
    robot, u = loaded(said, tmp_path), at_zero(at_times["fivebar"][:3])
    u[0] = u[0][list(closed["fivebar"].mechanism.closure.independent)]
    Q = robot.inverse_dynamics(*u, **RECURSION)
    assert relative_error(robot.forward_dynamics(*u[:2], Q, **RECURSION), u[2]) < 1e-10
    assert [(found.severity, found.kind) for found in robot.audit()] == [("note", "massless")]
    for body in said["bodies"]:
        body.pop("inertia", None)
    rotors = loaded(driven_content(said), tmp_path, drives="armature")  # those of joints that follow are felt too
    assert np.linalg.eigvalsh(rotors.mass_matrix(u[0], **RECURSION))[0] > 1e-3
    Q = rotors.inverse_dynamics(*u, **RECURSION)
    assert relative_error(rotors.forward_dynamics(*u[:2], Q, **RECURSION), u[2]) < 1e-10


def test_drives_of_joints_that_follow_are_felt(driven_fivebar, at_times):
    u, d = at_zero(at_times["fivebar"][:4]), driven_fivebar.drives
    u[0] = u[0][list(driven_fivebar.mechanism.closure.independent)]
    expected = np.subtract(
        driven_fivebar.inverse_dynamics(*u, **RECURSION),
        driven_fivebar.with_drives(False).inverse_dynamics(*u, **RECURSION),
    )
    for found, Q in zip(driven_fivebar.drive_forces(*u), expected, strict=True):
        assert relative_error(found, Q) < 1e-12
    amounts = (d.armature, d.damping, d.friction, d.stribeck, d.stiffness, d.offset)
    p = np.concatenate([driven_fivebar.inertial_parameters, *amounts])
    for Y, Q in zip(
        driven_fivebar.regressor(*u, drives=True, **RECURSION),
        driven_fivebar.inverse_dynamics(*u, **RECURSION),
        strict=True,
    ):
        assert relative_error(Y @ p, Q) < 1e-12
    momentum = driven_fivebar.generalized_momentum(*u[:2], **RECURSION)
    assert relative_error(driven_fivebar.momentum_regressor(*u[:2], drives=True, **RECURSION) @ p, momentum) < 1e-12
    energy = driven_fivebar.kinetic_energy(*u[:2], **RECURSION) + driven_fivebar.potential_energy(u[0], **RECURSION)
    assert relative_error(driven_fivebar.energy_regressor(*u[:2], drives=True, **RECURSION) @ p, energy) < 1e-12
