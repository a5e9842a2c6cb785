"""Passive coordinates: a biped on one foot, with springs at shins and heels, and a five-bar with one motor."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import jounce
from jounce.dynamics.loops import movers
from support.biped import BIPED, biped_of_hinges
from support.closed_robots import content, driven_content, loaded
from support.refusals import refusal
from support.robots import WEIGHTS, relative_error

RECURSION = {"method": "recursion"}
SIDES = ("left", "right")
MOTORS = [f"{side}-{joint}" for side in SIDES for joint in ("hip", "thigh", "knee", "foot")]
SPRINGS = [f"{side}-{joint}" for side in SIDES for joint in ("shin", "heel")]
SPINS = [f"{side}-{rod}-rod_roll" for side in SIDES for rod in ("achilles", "plantar")]
POSTURE = {"hip": 0.05, "thigh": 0.5, "knee": -1.2, "tarsus": 1.45, "foot": -1, "crank": -1, "plantar-rod_yaw": 1}
START = {"base_z": 1.0} | {f"{side}-{joint}": x for side in SIDES for joint, x in POSTURE.items()}


@pytest.fixture(scope="module")
def biped(tmp_path_factory):
    """The biped on its left foot: its pelvis follows, shins and heels are sprung, and its rods may spin."""
    path = tmp_path_factory.mktemp("biped") / "biped.xml"
    path.write_text(BIPED)
    with pytest.warns(jounce.JounceWarning, match="loops stay open"):
        tree = jounce.load(path, base="floating", drives=True)
    loops = [*tree.mechanism.loops, ("left-foot", "ground", "fixed")]
    with pytest.warns(jounce.JounceWarning) as warnings:
        robot = tree.closed(loops, MOTORS, passive=SPRINGS + SPINS, start=START)
    left_out, idle = (str(warning.message) for warning in warnings)
    assert "drive terms of its balls, planar and free joints are left out" in left_out
    assert f"nothing but inertia moves {', '.join(SPINS)}, passive without a spring" in idle
    return robot


@pytest.fixture(scope="module")
def coasting(biped):
    """A state of the biped, of which nothing but the motion of the motors is given, with the rates that follow."""
    c, rng = biped.mechanism.closure, np.random.default_rng(1)
    q = c.start[list(c.independent)]
    qd, q2d, q3d, q4d = rng.uniform(-0.3, 0.3, (4, biped.n))
    found = biped.passive_accelerations(q, qd, q2d, q3d, q4d, **RECURSION)
    for rate, own in zip((q2d, q3d, q4d), found, strict=True):
        rate[list(c.passive)] = own
    return q, qd, q2d, q3d, q4d


def test_passive_coordinates_lack_nothing(biped, coasting):
    for u in biped.actuator_forces(*coasting, **RECURSION):
        motors, lacking = np.split(u, [len(MOTORS)])
        assert np.abs(lacking).max() < 1e-12 * np.abs(motors).max()
    Q = biped.inverse_dynamics(*coasting, **RECURSION)
    for found, u in zip(Q, biped.actuator_forces(*coasting, **RECURSION), strict=True):
        assert np.abs(found - u).max() < 1e-12 * np.abs(u).max()  # where the motors are at the other coordinates


def test_their_accelerations_have_rates(biped, coasting):
    """Against nine-point differences along the polynomial of time that the state begins."""
    h, scale = 2e-4, np.array([1, 1, 1 / 2, 1 / 6, 1 / 24])
    t = h * np.array([*WEIGHTS, *(-k for k in WEIGHTS)])

    def at(order):
        rest = np.stack(coasting[order:])
        return np.einsum("ki,tk->ti", rest, t[:, None] ** np.arange(len(rest)) * scale[: len(rest)])

    q = biped.coordinates(at(0), **RECURSION)
    values, slopes = biped.passive_accelerations(q, *map(at, range(1, 4)), **RECURSION)
    _, *expected = biped.passive_accelerations(*coasting, **RECURSION)
    difference = np.array([*WEIGHTS.values(), *(-w for w in WEIGHTS.values())]) / h
    for found, along in zip(expected, (values, slopes), strict=True):
        assert relative_error(found, difference @ along) < 1e-6


def test_motors_give_their_power_to_energy_springs_and_dampers(biped, coasting):
    m, (q, qd, q2d, *_) = biped.mechanism, coasting
    _, velocities = biped.coordinates(q, qd, **RECURSION)
    given = biped.actuator_forces(q, qd, q2d, **RECURSION)[: len(MOTORS)] @ qd[: len(MOTORS)]
    gain = biped.kinetic_energy(q, qd, q2d, **RECURSION)[1] + biped.potential_energy(q, qd, **RECURSION)[1]
    assert abs(given - gain - m.drives.damping @ velocities**2) < 1e-10 * abs(given)
    assert m.drives.damping[m.tree.joints.index("left-tarsus")]  # which follows


def test_mujoco_moves_alike_the_harder_its_constraints_are(biped, coasting):
    """Its accelerations under these motors' torques, with hinges of its own for balls and base, and an impedance d < 1:
    the difference vanishes where d comes to 1."""
    pose = np.linalg.inv(biped.poses(coasting[0], body="left-foot"))
    turned = np.empty(4)
    mujoco.mju_mat2Quat(turned, pose[:3, :3].ravel())
    place = " ".join(map(repr, map(float, (*pose[:3, 3], *turned))))
    model = mujoco.MjModel.from_xml_string(biped_of_hinges(f"<weld body1='left-foot' relpose='{place}'/>"))
    model.opt.tolerance, model.opt.iterations = 1e-20, 500
    data = mujoco.MjData(model)
    names = [model.joint(j).name for j in range(model.njnt)]
    places = [biped.mechanism.tree.coordinates.index(name) for name in names]
    assert len(places) == len(biped.mechanism.tree.coordinates)
    q, qd, q2d = (x[places] for x in biped.coordinates(*coasting[:3], **RECURSION))
    tau = np.zeros(model.nv)
    tau[[names.index(name) for name in MOTORS]] = biped.actuator_forces(*coasting[:3], **RECURSION)[: len(MOTORS)]
    off = []
    for softness in (1e-4, 2e-4, 4e-4):
        model.eq_solimp[:] = [1 - softness, 1 - softness, 0.001, 0.5, 2]
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, qd, tau
        mujoco.mj_forward(model, data)
        off.append(data.qacc - q2d)
        assert np.abs(data.efc_pos).max() < 1e-12
        mujoco.mj_inverse(model, data)
        assert relative_error(data.qfrc_inverse, tau) < 1e-9
    hard, softer, softest = off
    assert np.abs(hard).max() < 0.6 * np.abs(softer).max() < 0.36 * np.abs(softest).max()
    assert np.abs(8 * hard - 6 * softer + softest).max() / 3 < 0.03 * np.abs(hard).max()  # at d = 1


@pytest.fixture(scope="module")
def half(tmp_path_factory):
    """The five-bar with drive trains at all joints, in two choices of coordinates, whose right shoulder is passive."""
    robot = loaded(driven_content(content("fivebar")), tmp_path_factory.mktemp("half"), drives=True)
    motor = {"actuated": ["left_shoulder"]}
    return (
        robot.closed(**motor, passive=["right_shoulder"]),
        robot.closed(**motor, coordinates=["right_elbow"], passive=["right_shoulder"]),
    )


@pytest.mark.parametrize("place", [0, 1])
def test_forward_dynamics_agrees(half, place):
    """With the torque of the motor as Q, and zero where nothing acts, also where the motor is at a follower."""
    robot, whole = half[place], half[0]
    q = whole.coordinates([2.2, 0.9], [0.4, -0.3], [0.5, 0.0], **RECURSION)
    own = list(robot.mechanism.closure.independent)
    ud, u2d = (x[own] for x in q[1:])
    p2d = robot.passive_accelerations(q[0], ud, u2d, **RECURSION)
    u2d[list(robot.mechanism.closure.passive)] = p2d
    motor, lacking = robot.actuator_forces(q[0], ud, u2d, **RECURSION)
    assert abs(lacking) < 1e-12 * abs(motor)
    moved = robot.coordinates(q[0], ud, u2d, **RECURSION)[2][list(whole.mechanism.closure.independent)]
    assert relative_error(whole.forward_dynamics([2.2, 0.9], [0.4, -0.3], [motor, 0.0], **RECURSION), moved) < 1e-11


def test_what_a_motion_lacks_is_no_motors(half):
    """Limits bound the motor alone; a passive coordinate that moves as it cannot is reported beside it."""
    robot = half[0]
    motor, lacking = robot.actuator_forces([2.2, 0.9], [0, 0], [0, 0], **RECURSION)
    Q = robot.inverse_dynamics([2.2, 0.9], [0, 0], [0, 0], **RECURSION)
    assert (motor, lacking) == pytest.approx(Q, rel=1e-12)
    assert abs(lacking) > 0.1
    motion = jounce.Motion.polynomial([[2.2, 0.1], [0.9, 0.0]], duration=0.1)
    limited = robot.with_limits(effort={"left_shoulder": 1.01 * abs(motor)})
    assert limited.check(motion).worst.joint == "left_shoulder"
    refusal(lambda: robot.with_limits(effort={"right_shoulder": 1.0}), "it has no motor")


def test_passive_coordinates_are_kept(half, tmp_path):
    robot = half[1]
    jounce.save(robot, tmp_path / "half.yaml")
    for other in (jounce.load(tmp_path / "half.yaml", drives=True), robot.closed(coordinates=["right_elbow"])):
        assert other.mechanism.closure.passive == robot.mechanism.closure.passive
        assert other.joint_names == robot.joint_names
    assert robot.closed(actuated=["left_shoulder", "right_shoulder"]).mechanism.closure.passive == ()
    assert movers(robot.mechanism) == {"right_elbow": "motors", "right_shoulder": "spring"}


def loaded_without_drives(robot):
    """The five-bar with a spring at its passive shoulder that does not act."""
    m = robot.mechanism
    sprung = jounce.Robot(replace(m, drives=replace(m.drives, stiffness=np.ones(4))))
    return sprung.closed(actuated=["left_shoulder"], passive=["right_shoulder"])


REFUSED = {
    "a motor that is passive": (lambda robot: robot.closed(actuated=["left_shoulder"], passive=["left_shoulder"]),
        ["passive names left_shoulder, which actuated names too"]),
    "too few motors": (
        lambda robot: robot.closed(actuated=["left_shoulder"], coordinates=["left_shoulder", "right_shoulder"]),
        ["motors at left_shoulder cannot move all of left_shoulder, right_shoulder", "or passive=[...]"]),
    "a spring that does not act": (
        lambda robot: loaded_without_drives(robot).passive_accelerations([2.2, 0.9], [0, 0], [0, 0]),
        ["takes the springs of passive coordinates, which do not act; robot.with_drives(True)"]),
    "none": (lambda robot: robot.passive_accelerations([2.2, 0.9], [0, 0], [0, 0]),
        ["it has none; robot.closed(passive=[...]) names some"]),
    "motors with springs": (
        lambda robot: robot.closed(actuated=["left_shoulder"], passive=["right_shoulder"]).elastic(10.0),
        ["has motors at left_shoulder"]),
}  # fmt: skip


@pytest.mark.filterwarnings("ignore:.*nothing but inertia")
@pytest.mark.parametrize("case", REFUSED)
def test_passive_coordinates_are_refused_in_one_line(case):
    call, words = REFUSED[case]
    refusal(lambda: call(jounce.load("fivebar")), *words)


@pytest.mark.filterwarnings("ignore:.*nothing but inertia moves")
def test_checks_say_what_passive_coordinates_lack():
    """A motion that the passive arm does not do by itself; one at rest without gravity lacks nothing."""
    arms = jounce.load("fivebar", gravity=(0, 0, 0)).with_limits(velocity=9)
    robot = arms.closed(actuated=["left_shoulder"], passive=["right_shoulder"])
    u = robot.mechanism.closure.start[list(robot.mechanism.closure.independent)]
    for moves in (0.1, 0.0):
        motion = jounce.Motion.polynomial([[u[0], 0, moves], [u[1], 0, 0]], 1.0, joint_names=robot.joint_names)
        for notes in (robot.check(motion).notes, robot.slowdown(motion).notes if moves else ()):
            assert any("at passive 'right_shoulder', at t = " in note for note in notes) == bool(moves and notes)
        assert any("lacks" in note for note in robot.check(motion).notes) == bool(moves)
