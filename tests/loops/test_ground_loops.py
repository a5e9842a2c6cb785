"""Loops through the ground: a quadruped on its feet, of which the base follows the joints or the joints the base."""

from math import comb

import numpy as np
import pytest

import jounce
from jounce.dynamics.loop_assembly import gaps
from jounce.model import positions
from jounce.model.equivalent_mechanisms import BASE_COORDINATES, to_single_screws
from jounce.model.frame import Frame
from jounce.spatial.lie import pose
from support.closed_robots import at_zero, motion_near_start
from support.leg_and_cart import leg_and_cart
from support.refusals import refusal
from support.robots import WEIGHTS, relative_error

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
JOINTS = tuple(f"{leg}_{joint}" for leg in ("FL", "FR", "HL", "HR") for joint in ("HAA", "HFE", "KFE"))
LEGS = ("FL_HAA", "FL_HFE", "FL_KFE", "FR_HFE", "FR_KFE", "HL_KFE")
START = {"base_z": 0.25, "base_yaw": 0.3} | {
    name: {"HAA": 0.1, "HFE": 0.7, "KFE": -1.4}[name[3:]] * (1 if name[0] == "F" else 0.9) for name in JOINTS
}
COORDINATES = {"base": BASE_COORDINATES, "legs": LEGS, "both": ("base_x", "base_z", "base_yaw", *LEGS[:3])}
H = 0.02  # s, of differences over nine points
TIMES = H * np.array([0, *WEIGHTS, *(-k for k in WEIGHTS)])
DIFFERENCE = np.array([0, *WEIGHTS.values(), *(-w for w in WEIGHTS.values())]) / H
RECURSION = {"method": "recursion"}


@pytest.fixture(scope="module")
def standing_dog(dog):
    """The dog on four points, moved by all of its joints, in each choice of coordinates, and states along a motion."""
    feet = [(foot, "ground") for foot in FEET]
    return {
        name: near_start(dog.closed(feet, JOINTS, coordinates=own, start=START)) for name, own in COORDINATES.items()
    }


def near_start(robot):
    """All joint positions, loops closed, and four rates of the independent coordinates at TIMES."""
    q, *rates = motion_near_start(robot, np.random.default_rng(2), 4)(TIMES)
    return robot, [robot.coordinates(q, **RECURSION), *rates]


@pytest.mark.parametrize("name", COORDINATES)
def test_feet_rest_at_all_orders(standing_dog, name):
    robot, rates = standing_dog[name]
    assert np.abs(gaps(robot.mechanism, rates[0])[0]).max() < 1e-13
    feet = [robot.body_names.index(f"{foot[:2]}_LOWER_LEG") for foot in FEET]
    reach = np.stack([robot.mechanism.frame(foot).T[:3, 3] for foot in FEET])
    for V, rate in zip(robot.twists(*at_zero(rates), **RECURSION), at_zero(rates)[1:], strict=True):
        found = V[feet, 3:] + np.cross(V[feet, :3], reach)
        assert np.abs(found).max() < 1e-12 * max(1, np.abs(rate).max())


@pytest.mark.parametrize("name", COORDINATES)
@pytest.mark.parametrize("quantity", ["inverse_dynamics", "actuator_forces", "loop_wrenches"])
def test_rates_are_derivatives_along_the_motion(standing_dog, name, quantity):
    robot, rates = standing_dog[name]
    _, first, second = getattr(robot, quantity)(*at_zero(rates), **RECURSION)
    for found, along in zip((first, second), getattr(robot, quantity)(*rates[:4], **RECURSION), strict=True):
        assert relative_error(found, np.tensordot(DIFFERENCE, along, axes=1)) < 1e-7


@pytest.mark.parametrize("name", COORDINATES)
def test_motors_give_their_power_to_the_energy(standing_dog, name):
    robot, (q, qd, q2d, *_) = standing_dog[name]
    _, velocities = robot.coordinates(q, qd, **RECURSION)
    motors = velocities[:, list(robot.mechanism.closure.actuated)]
    gain = robot.kinetic_energy(q, qd, q2d, **RECURSION)[1] + robot.potential_energy(q, qd, **RECURSION)[1]
    assert relative_error((robot.actuator_forces(q, qd, q2d, **RECURSION) * motors).sum(axis=-1), gain) < 1e-11


def on_the_base(robot, rates):
    """The motion of the joints and of the base, as a robot takes it that floats."""
    joints = [x[..., len(BASE_COORDINATES) :] for x in robot.coordinates(*rates[:5], **RECURSION)]
    return joints, (robot.poses(rates[0], body="base_link"), *robot.twists(*rates[:5], body="base_link", **RECURSION))


def left_over(Q, torques, J, forces):
    """Q - S tau - J^T f, order by order, in relation to Q."""
    found = []
    for k, own in enumerate(Q):
        pulled = sum(comb(k, j) * np.einsum("fij,fi->j", J[j], forces[k - j]) for j in range(k + 1))
        found.append(np.abs(own - np.concatenate([np.zeros(6), torques[k]]) - pulled).max() / np.abs(own).max())
    return found


def test_motors_and_ground_balance_the_floating_robot_as_contacts_do(dog, standing_dog):
    """Q = S u + A^T f of the same motion; the f of `contacts` are others, and of the same total on the base."""
    robot, states = standing_dog["legs"]
    rates = at_zero(states)
    joints, base = on_the_base(robot, rates)
    Q = dog.inverse_dynamics(*joints, base=base, **RECURSION)
    in_world = {"base": base[:3], "frame": "world"} | RECURSION
    of_feet = [dog.jacobian(*joints[:3], body=foot, **in_world) for foot in FEET]
    J = [np.stack(rate)[:, 3:] for rate in zip(*of_feet, strict=True)]
    stand = dog.contacts([jounce.Contact(foot, "point") for foot in FEET])
    torques, contacts = ([x[..., at:] for x in found] for at, found in (
        (6, stand.inverse_dynamics(*joints, base=base, **RECURSION)),
        (3, stand.contact_wrenches(*joints, base=base, **RECURSION)),
    ))  # fmt: skip
    assert max(left_over(Q, torques, J, contacts)) < 1e-11
    turned = dog.closed([("ground", foot) for foot in FEET], JOINTS, coordinates=LEGS, start=START)
    axes = np.stack([turned.mechanism.frame(f"ground:{foot}").T[:3, :3] for foot in FEET])
    ground = [np.einsum("fij,fj->fi", axes, W[:, 3:]) for W in turned.loop_wrenches(*rates, **RECURSION)]
    assert max(left_over(Q, robot.actuator_forces(*rates, **RECURSION), J, ground)) < 1e-11
    assert relative_error(np.sum(ground, axis=1), np.sum(contacts, axis=1)) < 1e-11
    assert relative_error(np.stack(ground), np.stack(contacts)) > 1e-3


def test_coordinates_make_no_difference_to_the_motors(standing_dog):
    """The motion of the legs, in coordinates of the base."""
    legs, rates = standing_dog["legs"]
    u = at_zero(rates)
    base = standing_dog["base"][0]
    places = list(base.mechanism.closure.independent)
    whole = legs.coordinates(*u, **RECURSION)
    moving = [whole[0], *(x[places] for x in whole[1:])]
    for found, expected in zip(
        base.actuator_forces(*moving, **RECURSION), legs.actuator_forces(*u, **RECURSION), strict=True
    ):
        assert relative_error(found, expected) < 1e-11


def test_native_code_and_motions_follow(standing_dog):
    robot, rates = standing_dog["legs"]
    for found, expected in zip(robot.actuator_forces(*rates), robot.actuator_forces(*rates, **RECURSION), strict=True):
        assert relative_error(found, expected) < 1e-12
    c = robot.mechanism.closure
    rest = c.start[list(c.independent)]
    motion = jounce.Motion.polynomial(np.stack([rest, *0.05 * np.random.default_rng(0).normal(size=(3, 6))], 1), 0.5)
    along = robot.forces_along(motion, order=2)
    assert relative_error(along.forces[1][10], robot.inverse_dynamics(*motion(along.t[10], 4))[1]) < 1e-9


@pytest.mark.filterwarnings("ignore:.*bodies without mass that carry mass:jounce.JounceWarning")
def test_a_saved_robot_stands_as_before(standing_dog, tmp_path):
    robot, rates = standing_dog["both"]
    jounce.save(robot, tmp_path / "dog.yaml")
    again = jounce.load(tmp_path / "dog.yaml")
    assert again.joint_names == robot.joint_names
    assert (
        relative_error(again.actuator_forces(*rates[:3], **RECURSION), robot.actuator_forces(*rates[:3], **RECURSION))
        < 1e-13
    )


def test_joints_of_several_screws_become_chains_that_move_alike():
    """The kinetic and the potential energy, and with them the dynamics, of balls, planar and free joints and a base."""
    robot, rng = leg_and_cart(base=True), np.random.default_rng(0)
    chain = jounce.Robot(to_single_screws(robot.mechanism, base=True))
    assert chain.n == robot.nv
    assert chain.mechanism.coordinates[:6] == BASE_COORDINATES
    s, sd = rng.uniform(-0.8, 0.8, (2, chain.n))
    C, (_, Cd) = chain.poses(s), chain.poses(s, sd)
    bodies = [chain.body_names.index(name) for name in robot.mechanism.bodies]
    C, Cd, parents = C[bodies], Cd[bodies], robot.mechanism.parent
    q, qd = np.zeros(robot.nq - 7), np.zeros(robot.n)
    joints = positions.multiscrew_joints(robot.mechanism)
    V = chain.twists(s, sd)[bodies]
    for i, p in enumerate(parents):
        if i in joints:
            x, (B, own) = joints[i], (robot.mechanism.B[i], np.linalg.inv(C[p]) @ C[i])
            q[x.numbers] = x.group.numbers(np.linalg.inv(x.T) @ np.linalg.inv(B) @ own @ x.T)
            back = np.linalg.inv(own)
            R, r = back[:3, :3], back[:3, 3]
            carried = np.concatenate([R @ V[p][:3], R @ V[p][3:] + np.cross(r, R @ V[p][:3])])
            columns = robot.mechanism.X[list(robot.mechanism.columns[i])]
            qd[x.coordinates] = np.linalg.lstsq(columns.T, V[i] - carried)[0]
    for name in ("knee", "toe"):
        at, own = chain.joint_names.index(name), robot.joint_names.index(name)
        single = jounce.model.positions.single_positions(robot.mechanism)[own].argmax()
        q[single], qd[own] = s[at], sd[at]
    base = (C[0], V[0])
    assert relative_error(robot.poses(q, base=C[0]), C) < 1e-14
    assert relative_error(robot.twists(q, qd, base=base), V) < 1e-13
    assert relative_error(robot.kinetic_energy(q, qd, base=base), chain.kinetic_energy(s, sd)) < 1e-13
    assert relative_error(robot.potential_energy(q, base=C[0]), chain.potential_energy(s)) < 1e-13


ON_THE_GROUND = [(foot, "ground") for foot in FEET]
TWO_FEET = [("FL_FOOT", "ground"), ("HR_FOOT", "ground")]


def on_its_feet(dog):
    return dog.closed(ON_THE_GROUND, JOINTS, coordinates=LEGS, start=START)


def placed_twice(dog):
    return on_its_feet(dog).closed([*on_its_feet(dog).mechanism.loops, ON_THE_GROUND[0]], start=START | {"base_z": 0.3})


def held_elsewhere(dog):
    """The dog on its feet, one of them held at another place too."""
    robot = on_its_feet(dog)
    there = Frame("there", -1, pose(np.eye(3), np.array([[0.3], [0.2], [0.1]])))
    second = jounce.Loop(robot.mechanism.tree.frame("FL_FOOT"), there, "spherical", np.array([0.0, 0.0, 1.0]))
    return robot.closed([*robot.mechanism.loops, second])


REFUSED = {
    "loops that contradict each other": (held_elsewhere,
        ["FL_FOOT-ground:FL_FOOT", "FL_FOOT-there", "is open by 0.09", "nearly as far as FL_FOOT-"]),
    "one frame at two places": (placed_twice, ["loops state 'ground:FL_FOOT' at two places"]),
    "points on a line": (  # about which the base turns while all joints rest
        lambda dog: dog.closed(TWO_FEET, JOINTS, start=START), ["do not determine the motion", "base_pitch", "can move"]
    ),
    "the ground alone": (lambda dog: dog.closed([("ground", "ground")], JOINTS), ["both ends are the ground"]),
    "a frame that is missing": (lambda dog: dog.closed([("FOOT", "ground")], JOINTS),
        ["loops[0]: unknown body 'FOOT'", "FL_FOOT"]),
    "its base": (lambda dog: on_its_feet(dog).mass_matrix(np.zeros(6), base=np.eye(4)),
        ["base= of 'solo12': base_x,", "are its coordinates, in q; leave base= out"]),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_the_ground_cannot_hold_is_refused_in_one_line(dog, case):
    call, words = REFUSED[case]
    refusal(lambda: call(dog), *words)


@pytest.mark.parametrize("ends", [("ground", "FL_FOOT"), ("FL_FOOT", "ground")])
def test_axes_in_the_ground_are_inertial(dog, ends):
    """A foot on a plane stays at its height where the normal is stated in the ground; in the foot it is another."""
    with pytest.warns(jounce.JounceWarning, match="nothing but inertia"):
        robot = dog.closed(
            [(*ends, "planar", (0, 0, 1))], JOINTS, passive=["base_x", "base_y", "base_yaw"], start=START
        )
    c = robot.mechanism.closure
    q = c.start[list(c.independent)]
    V = robot.twists(q, 1.0 * (np.array(robot.joint_names) == "base_x"), body="FL_FOOT", frame="world", **RECURSION)
    assert (abs(V[5]) < 1e-12) == (ends[0] == "ground")
