"""Pinocchio's models as robots: the same forces by the same names, whatever joints they are made of."""

import numpy as np
import pytest

import jounce
from support.files import BODY, LINKS, OTHER, joint, link, robot_file
from support.pinocchio_of_urdf import REAL, configuration, control_bounds, pinocchio, rnea
from support.refusals import refusal
from support.robots import relative_error
from support.states import random_rates

AXIS = np.array([1.0, 2.0, -2.0]) / 3
JOINTS = {
    "revolute": lambda: pinocchio.JointModelRY(),
    "revolute about any axis": lambda: pinocchio.JointModelRevoluteUnaligned(AXIS),
    "unbounded": lambda: pinocchio.JointModelRUBZ(),
    "prismatic": lambda: pinocchio.JointModelPX(),
    "prismatic along any axis": lambda: pinocchio.JointModelPrismaticUnaligned(AXIS),
    "helical": lambda: pinocchio.JointModelHZ(0.3),
    "helical about any axis": lambda: pinocchio.JointModelHelicalUnaligned(AXIS, -0.2),
    "universal": lambda: pinocchio.JointModelUniversal(AXIS, np.array([0.0, 1.0, 1.0]) / np.sqrt(2)),
    "translation": lambda: pinocchio.JointModelTranslation(),
    "three angles": lambda: pinocchio.JointModelSphericalZYX(),
    "composite": lambda: composite(),
}
FREE = {
    "floating": pinocchio.JointModelFreeFlyer,
    "planar": pinocchio.JointModelPlanar,
    "spherical": pinocchio.JointModelSpherical,
}


def composite(*parts):
    made = pinocchio.JointModelComposite(pinocchio.JointModelRX(), pinocchio.SE3.Random())
    for part in parts or (JOINTS["universal"](), JOINTS["helical"]()):
        made.addJoint(part, pinocchio.SE3.Random())
    return made


def random_model(joints, parents, name="made"):
    """A model of random placements and bodies, its joints j1, j2, ..."""
    pinocchio.seed(3)
    model = pinocchio.Model()
    model.name = name
    for i, (moving, parent) in enumerate(zip(joints, parents, strict=True), start=1):
        model.addJoint(parent, moving, pinocchio.SE3.Random(), f"j{i}")
        model.appendBodyToJoint(i, pinocchio.Inertia.Random(), pinocchio.SE3.Random())
    return model


def assert_same_dynamics(robot, model):
    """Q and M at random states, in the order of v; `crba` is right where joints are depth first alone."""
    rest = np.zeros(model.nv)
    for q, qd, q2d in zip(*random_rates(robot.n, 3, 5), strict=True):
        Q = robot.inverse_dynamics(q, qd, q2d, method="recursion")
        assert relative_error(Q, rnea(model, q, qd, q2d)) < 1e-12
        M = [rnea(model, q, rest, unit) - rnea(model, q, rest, rest) for unit in np.eye(model.nv)]
        assert relative_error(robot.mass_matrix(q, method="recursion"), M) < 1e-12


@pytest.mark.parametrize("kind", JOINTS)
def test_every_joint_that_screws_make(kind):
    """Between two others, so that its placement and what it carries count."""
    model = random_model([pinocchio.JointModelRX(), JOINTS[kind](), pinocchio.JointModelPZ()], [0, 1, 2])
    robot = jounce.Robot.from_pinocchio(model)
    several = model.joints[2].nv > 1
    middle = [f"j2_{k + 1}" for k in range(model.joints[2].nv)] if several else ["j2"]
    assert robot.joint_names == ("j1", *middle, "j3")
    assert robot.body_names == ("j1", *middle[:-1], "j2", "j3")
    assert_same_dynamics(robot, model)


def test_coordinates_are_in_the_order_of_v_where_bodies_are_not():
    """Breadth first: j3 hangs on j1, j4 on j2."""
    kinds = ("revolute", "prismatic", "universal", "helical")
    model = random_model([JOINTS[kind]() for kind in kinds], [0, 0, 1, 2])
    robot = jounce.Robot.from_pinocchio(model)
    assert robot.joint_names == ("j1", "j2", "j3_1", "j3_2", "j4")
    assert robot.body_names == ("j1", "j3_1", "j3", "j2", "j4")
    assert_same_dynamics(robot, model)


def test_a_chain_with_an_unbounded_joint_in_it():
    model = random_model([composite(pinocchio.JointModelRUBY(), JOINTS["universal"]())], [0])
    robot = jounce.Robot.from_pinocchio(model)
    q, qd, q2d = random_rates(robot.n, 3)
    theirs = np.array([q[0], np.cos(q[1]), np.sin(q[1]), q[2], q[3]])
    Q = pinocchio.rnea(model, model.createData(), theirs, qd, q2d)
    assert relative_error(robot.inverse_dynamics(q, qd, q2d), Q) < 1e-12


@pytest.mark.filterwarnings("ignore:.*the tighter ones count")
@pytest.mark.parametrize("name", ["panda/panda.urdf", "tiago_pro/robots/tiago_pro.urdf", "ur/ur5_robot.urdf"])
def test_what_pinocchio_reads_of_a_urdf_is_what_load_reads(name):
    model = pinocchio.buildModelFromUrdf(str(REAL[name]), mimic=True)
    robot, loaded = jounce.Robot.from_pinocchio(model), jounce.load(REAL[name])
    assert (robot.name, robot.n, set(robot.joint_names)) == (loaded.name, loaded.n, set(loaded.joint_names))
    assert set(robot.body_names) == set(loaded.body_names)
    assert_same_dynamics(robot, model)
    leaders = [joint for joint in loaded.mechanism.joints if joint in loaded.joint_names]
    ours, theirs = ([m.joints.index(joint) for joint in leaders] for m in (robot.mechanism, loaded.mechanism))
    for what in ("velocity", "effort"):
        expected = np.minimum(getattr(robot.limits, what)[ours], control_bounds(REAL[name], what, leaders))
        np.testing.assert_array_equal(expected, getattr(loaded.limits, what)[theirs])
    for what in ("damping", "friction"):
        np.testing.assert_array_equal(getattr(robot.drives, what)[ours], getattr(loaded.drives, what)[theirs])
    merged = {frame.name for frame in loaded.mechanism.frames}
    assert {frame.name for frame in robot.mechanism.frames} == merged | {"universe"}
    q = np.random.default_rng(1).uniform(-1, 1, robot.n)
    same = q[[robot.joint_names.index(joint) for joint in loaded.joint_names]]
    for frame in sorted(merged)[:5]:
        np.testing.assert_allclose(robot.poses(q, body=frame), loaded.poses(same, body=frame), atol=1e-14)


@pytest.mark.parametrize("multiplier", [-2.0, 0.0])
def test_mimic_joints_are_folded(tmp_path, multiplier):
    limit = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
    mimic = f'{limit}<mimic joint="turn" multiplier="{multiplier}" offset="0.3"/>'
    path = robot_file(
        tmp_path, *LINKS, joint("turn", "base", "arm", inner=limit), link("x", OTHER), link("y", BODY),
        joint("follow", "arm", "x", axis="0 1 0", inner=mimic), joint("bend", "x", "y", axis="1 0 0", inner=limit),
    )  # fmt: skip
    model = pinocchio.buildModelFromUrdf(str(path), mimic=True)
    robot, loaded = jounce.Robot.from_pinocchio(model), jounce.load(path)
    assert robot.joint_names == loaded.joint_names == ("turn", "bend")
    for q, qd, q2d in zip(*random_rates(robot.n, 3, 5), strict=True):
        Q = robot.inverse_dynamics(q, qd, q2d)
        assert relative_error(Q, rnea(model, q, qd, q2d)) < 1e-12
        assert relative_error(Q, loaded.inverse_dynamics(q, qd, q2d)) < 1e-12


def test_a_floating_root_is_refused_welded_or_left_behind():
    model = random_model([FREE["floating"](), pinocchio.JointModelRX(), pinocchio.JointModelRY()], [0, 1, 2])
    refusal(lambda: jounce.Robot.from_pinocchio(model), "model 'made'", "'j1'", "floating", "base='fixed'", "root=")
    with pytest.warns(jounce.JounceWarning, match=r"welds.*j1 \(floating\)") as caught:
        robot = jounce.Robot.from_pinocchio(model, base="fixed")
    assert caught[0].filename == __file__
    assert robot.joint_names == ("j2", "j3")
    for state in zip(*random_rates(robot.n, 3, 5), strict=True):
        theirs = rnea(model, *(np.concatenate([np.zeros(6), x]) for x in state))[6:]
        assert relative_error(robot.inverse_dynamics(*state), theirs) < 1e-12


@pytest.mark.parametrize("kind", FREE)
def test_a_robot_may_start_behind_a_free_joint(kind):
    model = random_model([FREE[kind](), pinocchio.JointModelRX(), pinocchio.JointModelRY()], [0, 1, 2])
    behind = jounce.Robot.from_pinocchio(model, root="j1")
    np.testing.assert_allclose(behind.mechanism.B, [model.jointPlacements[i].homogeneous for i in (2, 3)], atol=1e-15)


def test_joints_whose_screws_are_not_constant_are_refused():
    model = random_model([pinocchio.JointModelEllipsoid(0.1, 0.2, 0.3), pinocchio.JointModelRX()], [0, 1])
    refusal(lambda: jounce.Robot.from_pinocchio(model), "'j1'", "JointModelEllipsoid", "not constant")


def test_armature_of_joints_of_several_screws_is_said():
    model = random_model([pinocchio.JointModelRX(), FREE["spherical"]()], [0, 1])
    model.armature = np.array([0.1, 0.2, 0.2, 0.2])
    with pytest.warns(jounce.JounceWarning, match="armature of joints of several screws"):
        robot = jounce.Robot.from_pinocchio(model)
    assert robot.drives.armature.tolist() == [0.1, 0, 0, 0]


def test_drives_and_limits():
    model = random_model([pinocchio.JointModelRX(), pinocchio.JointModelRUBY(), pinocchio.JointModelPZ()], [0, 1, 2])
    model.armature, model.rotorInertia = np.array([0.5, 0.0, 0.2]), np.array([9.0, 0.001, 0.0])
    model.rotorGearRatio, model.damping = np.array([1.0, 100.0, 1.0]), np.array([1.0, 2.0, 3.0])
    model.lowerPositionLimit, model.velocityLimit = np.array([-1.0, -2, -2, -3]), np.array([4.0, 5, np.inf])
    robot = jounce.Robot.from_pinocchio(model)
    np.testing.assert_allclose(robot.drives.armature, [0.5, 10.0, 0.2])
    assert robot.drives.damping.tolist() == [1, 2, 3]
    assert robot.limits.lower.tolist() == [-1, -np.inf, -3]
    assert robot.limits.upper.tolist() == [np.inf] * 3
    assert robot.limits.velocity.tolist() == [4, 5, np.inf]
    model.armature = robot.drives.armature
    assert_same_dynamics(robot.with_drives("armature"), model)


def test_gravity_and_frames():
    model = random_model([pinocchio.JointModelRX()], [0])
    tool = pinocchio.SE3.Random()
    model.addFrame(pinocchio.Frame("tool", 1, 0, tool, pinocchio.FrameType.OP_FRAME))
    model.gravity.linear = np.array([1.0, 2.0, 3.0])
    robot = jounce.Robot.from_pinocchio(model)
    assert robot.gravity.tolist() == [1, 2, 3]
    assert_same_dynamics(robot, model)
    assert jounce.Robot.from_pinocchio(model, gravity=(0, 0, -1)).gravity.tolist() == [0, 0, -1]
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, configuration(model, np.array([0.4])))
    at = data.oMf[model.getFrameId("tool")].homogeneous
    np.testing.assert_allclose(robot.poses([0.4], body="tool"), at, atol=1e-14)


def changed_model(change):
    model = random_model([pinocchio.JointModelRX(), pinocchio.JointModelRY()], [0, 1])
    change(model)
    return model


def turn_gravity(model):
    model.gravity.angular = np.array([0.0, 0.0, 1.0])


def heavy(model):
    model.inertias[1].mass = np.nan


def damped(model):
    model.damping = np.array([0.0, np.nan])


def bounded(model):
    model.lowerPositionLimit = np.array([0.0, np.nan])


BAD = {
    "gravity that turns": (turn_gravity, ["gravity", "[0.0, 0.0, 1.0]"]),
    "mass that is none": (heavy, ["inertia of link 'j1' holds nan", "finite"]),
    "damping that is none": (damped, ["joint 'j2': damping is nan"]),
    "limit that is none": (bounded, ["joint 'j2': lower and upper limit are nan"]),
    "two of one name": (lambda model: model.names.__setitem__(2, "j1"), ["duplicate", "'j1'"]),
}


@pytest.mark.parametrize(("change", "words"), BAD.values(), ids=BAD)
def test_refuses(change, words):
    refusal(lambda: jounce.Robot.from_pinocchio(changed_model(change)), "model 'made'", *words)


@pytest.mark.parametrize("model", [None, "panda.urdf", pinocchio.Model().createData(), pinocchio.Model])
def test_refuses_what_is_no_model(model):
    refusal(lambda: jounce.Robot.from_pinocchio(model), "expects a pinocchio.Model", type(model).__name__)


def test_refuses_a_model_without_joints():
    refusal(lambda: jounce.Robot.from_pinocchio(pinocchio.Model()), "model 'robot': no movable joint")
