"""MJCF and models of MuJoCo, against MuJoCo's own inverse dynamics."""

import json
import sys
import warnings
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest

import jounce
from jounce.model import positions
from jounce.model.drive_trains import ALL_DRIVE_TERMS, UNDRIVEN
from support.commands import call
from support.files import GOOD, robot_file
from support.refusals import expect_refusal, refusal
from support.robots import differentiated, harmonic, random_pose, relative_error

ROBOSUITE = [f"robosuite/models/assets/{name}.xml" for name in (
    *(f"robots/{robot}/robot" for robot in ("panda", "iiwa", "ur5e", "kinova3", "jaco", "sawyer", "xarm7")),
    "grippers/robotiq_gripper_s", "bases/floating_legged_base", "objects/door_lock",
)]  # fmt: skip
MORE = [f"robosuite_models/assets/{name}.xml" for name in (
    *(f"robots/{robot}/robot" for robot in ("aloha", "g1", "pr2", "vx300s", "z1")),
    "grippers/schunk_svh_left_hand",
)]  # fmt: skip
CONTROL = [f"dm_control/{name}.xml" for name in (
    *(f"suite/{robot}" for robot in (
        "acrobot", "ball_in_cup", "cheetah", "finger", "fish", "humanoid_CMU", "manipulator", "quadruped", "swimmer",
        "walker",
    )),
    "locomotion/walkers/assets/rodent", "third_party/ant/ant", "third_party/kinova/jaco_arm",
    "mujoco/testing/assets/arm", "mujoco/testing/assets/cartpole_no_names",
)]  # fmt: skip
TENDONS = ("tendon_armature", "tendon_stiffness", "tendon_damping")
TRAINS = ("dof_armature", "dof_damping", "jnt_stiffness", *TENDONS)

ARM = """<mujoco model="odd">
  <compiler angle="radian"/>
  <option gravity="1 -2 -9"/>
  <worldbody>
    <body name="stand" pos="0 0 .3" euler="0 .3 .1">
      <geom size=".1"/>
      <body name="torso" pos=".1 .2 .3" quat=".5 .6 -.3 .2">
        <joint name="lift" type="slide" axis="1 2 3" pos=".4 .5 .6" ref=".1" range="-.2 .7" actuatorfrcrange="-30 40"/>
        <joint name="yaw" axis="0 1 1" pos=".1 .2 .3" ref="-.4" damping=".3" armature=".02" frictionloss=".5"/>
        <joint name="roll" axis="1 0 .2" pos="0 -.2 .1" stiffness="4" springref=".3"/>
        <inertial mass="2" pos=".1 .05 .2" fullinertia=".04 .05 .06 .01 -.005 .002"/>
        <site name="tip" pos=".3 0 .1" euler=".4 .5 .6"/>
        <site name="box" pos="1 1 1"/>
        <body name="head" pos="0 .2 .5" euler=".2 0 -.1">
          <joint type="ball"/>
          <geom type="box" size=".1 .2 .05" pos=".1 0 0"/>
        </body>
        <body name="box" pos="-.2 .1 0" quat=".9 .1 .2 -.3">
          <geom type="box" size=".05 .1 .2"/>
          <body pos=".1 .1 .1">
            <joint axis="0 1 0" pos=".05 0 .02" limited="false"/>
            <geom type="capsule" size=".05 .2" pos="0 0 .2" euler=".3 .3 0"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>"""


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """MuJoCo appends what it warns of, where nobody listens, to a MUJOCO_LOG.TXT in the current folder.

    It keeps the meshes of models that tests read by it, up to 500 MB.
    """
    monkeypatch.chdir(tmp_path)
    yield
    mujoco.mj_clearCache(mujoco.mj_getCache())


def path_of(name):
    package, inner = name.split("/", 1)
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        pytest.skip(f"{package} is not there: pip install --no-deps -r tests/models.txt")
    return Path(spec.submodule_search_locations[0]) / inner


def quietly(call, *given, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", jounce.JounceWarning)
        return call(*given, **options)


def small(bodies, more="", option=""):
    """MJCF of a world."""
    return f"<mujoco model='m'><option {option}/><worldbody>{bodies}</worldbody>{more}</mujoco>"


def hinge(name="a", inner="", **attributes):
    said = " ".join(f"{key}='{value}'" for key, value in attributes.items())
    return f"<body name='{name}'><joint name='{name}_turn' {said}/><geom size='.1' pos='.3 .2 .1'/>{inner}</body>"


def model_of(text):
    return mujoco.MjModel.from_xml_string(text)


def without_balls(robot):
    """The robot with its balls locked where the file has their bodies."""
    return robot.locked({x.name: [0, 0, 0, 1] for x in positions.multiscrew_joints(robot.mechanism).values()})


def joint_addresses(model):
    """Where hinges and slides stand in qpos and in qvel."""
    moving = model.jnt_type >= 2
    return model.jnt_qposadr[moving], model.jnt_dofadr[moving]


def unconstrained(model):
    """The model with nothing in it but bodies and drives: no contact, limit, Coulomb friction, equality, fluid."""
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.opt.density = model.opt.viscosity = 0
    model.body_gravcomp[:] = 0
    spatial = model.wrap_type[model.tendon_adr] != mujoco.mjtWrap.mjWRAP_JOINT
    for name in TENDONS:
        getattr(model, name)[spatial] = 0
    return model


def inverse(model, robot, states):
    """The forces that MuJoCo asks of the coordinates of a robot, states (..., 3, n), and its mass matrices."""
    # Rotors of tendons are joints of the robot alone.
    m = robot.mechanism
    rows = [i for i, body in enumerate(m.owners) if not m.bodies[body].endswith("_rotor")]
    data, G, g = mujoco.MjData(model), m.G[rows], m.g[rows]
    at, dofs = joint_addresses(model)
    Q, M, full = [], [], np.zeros((model.nv, model.nv))
    for q, qd, q2d in states:
        data.qpos[:], data.qvel[:], data.qacc[:] = model.qpos0, 0, 0
        data.qpos[at], data.qvel[dofs], data.qacc[dofs] = G @ q + g, G @ qd, G @ q2d
        mujoco.mj_inverse(model, data)
        mujoco.mj_fullM(model, data, full)
        Q.append(G.T @ data.qfrc_inverse[dofs])
        M.append(G.T @ full[np.ix_(dofs, dofs)] @ G)
    return np.stack(Q), np.stack(M)


def check_against_mujoco(model, robot, count=20):
    """Q, with drives and without, M and the forces of gravity, to 1e-9; they are some 1e-15 off."""
    states = np.random.default_rng(5).uniform(-1.5, 1.5, (count, 3, robot.n))
    still = states * np.array([1, 0, 0])[:, None]
    driven = robot.with_drives(("armature", "damping", "spring"))
    unconstrained(model)
    for switched in (driven, robot):
        if switched is robot:
            for name in TRAINS:
                getattr(model, name)[:] = 0
        Q, M = inverse(model, robot, states)
        assert relative_error(switched.inverse_dynamics(*np.moveaxis(states, 1, 0), method="recursion"), Q) < 1e-9
        assert relative_error(switched.mass_matrix(states[:, 0], method="recursion"), M) < 1e-9
    gravity = robot.gravity_forces(states[:, 0], method="recursion")
    expected = inverse(model, robot, still)[0]
    assert np.abs(gravity - expected).max() < 1e-9 * max(np.abs(expected).max(), 1)


@pytest.mark.sweep(8)
@pytest.mark.filterwarnings("ignore:.* has no effect. the robot states no:jounce.JounceWarning")
@pytest.mark.parametrize("name", [*ROBOSUITE, *MORE, *CONTROL])
def test_robots_of_other_libraries_agree_with_mujoco(name):
    model = mujoco.MjModel.from_xml_path(str(path_of(name)))
    robot = without_balls(quietly(jounce.Robot.from_mujoco, model, base="fixed"))
    rotors = [name for name in robot.body_names if name.endswith("_rotor")]
    assert len(robot.mechanism.joints) == np.count_nonzero(model.jnt_type >= 2) + len(rotors)
    check_against_mujoco(model, robot)


FLOATING = {
    "robosuite_models/assets/robots/g1/robot.xml": None,
    "dm_control/suite/fish.xml": None,
    "dm_control/suite/humanoid_CMU.xml": None,
    "dm_control/suite/quadruped.xml": "torso",  # next to a ball
}


@pytest.mark.parametrize("name", FLOATING)
def test_robots_of_other_libraries_float_as_in_mujoco(name):
    model = mujoco.MjModel.from_xml_path(str(path_of(name)))
    robot = quietly(jounce.Robot.from_mujoco, model, base="floating", root=FLOATING[name])
    unconstrained(model)
    for train in TRAINS:
        getattr(model, train)[:] = 0
    data, rng = mujoco.MjData(model), np.random.default_rng(5)
    rates, base = rng.uniform(-1, 1, (3, robot.n)), (random_pose(rng), *rng.normal(size=(2, 6)))
    data.qpos[:], data.qvel[:], data.qacc[:] = robot.state_to("mujoco", *rates, base=base, model=model)
    mujoco.mj_inverse(model, data)
    Q = robot.state_from("mujoco", data.qpos, forces=data.qfrc_inverse, model=model).Q
    assert relative_error(robot.inverse_dynamics(*rates, base=base, method="recursion"), Q) < 1e-12


@pytest.fixture
def arm_without_balls():
    """The arm, whose head's ball joint is locked, and its model."""
    model = model_of(ARM)
    return model, without_balls(jounce.Robot.from_mujoco(model))


def test_joints_of_one_body_with_odd_axes_agree_with_mujoco(arm_without_balls):
    check_against_mujoco(*arm_without_balls)


def test_every_name_is_where_mujoco_has_it(arm_without_balls):
    model, robot = arm_without_balls
    data, q = mujoco.MjData(model), np.random.default_rng(3).uniform(-1, 1, robot.n)
    data.qpos[joint_addresses(model)[0]] = q
    mujoco.mj_kinematics(model, data)
    names = {"stand": data.body("stand"), "torso": data.body("torso"), "head": data.body("head")}
    names |= {"box": data.body("box"), "body5": data.body(5), "tip": data.site("tip"), "world": data.body("world")}
    for name, there in names.items():
        C = robot.poses(q, body=name)
        assert np.abs(C[:3, 3] - there.xpos).max() < 1e-14, name
        assert np.abs(C[:3, :3] - there.xmat.reshape(3, 3)).max() < 1e-14, name
    assert set(robot.body_names) | {frame.name for frame in robot.mechanism.frames} == {
        *names,
        "torso:lift",
        "torso:yaw",
    }
    assert robot.body_names == ("torso:lift", "torso:yaw", "torso", "body5")
    assert robot.joint_names == ("lift", "yaw", "roll", "joint5")


def test_gravity_limits_and_drives_are_those_of_the_model(arm_without_balls):
    _, robot = arm_without_balls
    inf = np.inf
    assert robot.gravity.tolist() == [1, -2, -9]
    assert quietly(
        jounce.Robot.from_mujoco, arm_without_balls[0], gravity=(0, 0, 1), base="fixed"
    ).gravity.tolist() == [0, 0, 1]
    assert robot.limits.lower.tolist() == [-0.2, -inf, -inf, -inf]
    assert robot.limits.upper.tolist() == [0.7, inf, inf, inf]
    assert robot.limits.effort.tolist() == [40, inf, inf, inf]
    stated = {key: array.tolist() for key, array in vars(robot.drives).items()}
    assert stated == {key: [x] * 4 for key, x in UNDRIVEN.items()} | {
        "armature": [0, 0.02, 0, 0],
        "damping": [0, 0.3, 0, 0],
        "friction": [0, 0.5, 0, 0],
        "stiffness": [0, 0, 4, 0],
        "rest": [0, 0, 0.3, 0],
    }


def test_rates_agree_between_paths_and_with_differences(arm_without_balls):
    robot = arm_without_balls[1].with_drives(("armature", "damping", "spring"))
    motion = harmonic(np.random.default_rng(4), robot.n, 4)
    Q, Qd, Q2d = robot.inverse_dynamics(*motion(0), method="recursion")
    for ours, other in zip((Q, Qd, Q2d), robot.inverse_dynamics(*motion(0), method="closed_form"), strict=True):
        assert relative_error(ours, other) < 1e-12
    assert (
        relative_error(Qd, differentiated(lambda t: robot.inverse_dynamics(*motion(t)[:3], method="recursion"))) < 1e-9
    )
    ahead = differentiated(lambda t: robot.inverse_dynamics(*motion(t)[:4], method="recursion")[1])
    assert relative_error(Q2d, ahead) < 1e-9


def test_a_robot_may_start_at_a_body_behind_free_joints():
    carried = hinge("a", hinge("b"))
    model = model_of(small(f"<body name='car'><freejoint name='drive'/><geom size='.2'/>{carried}</body>"))
    robot = jounce.Robot.from_mujoco(model, root="a")
    assert (robot.joint_names, robot.mechanism.frame("a").body) == (("b_turn",), -1)
    said = ["model 'm': joint 'drive' is floating", "base='fixed'", "root="]
    refusal(lambda: jounce.Robot.from_mujoco(model), *said)


TIE = "<equality><joint joint1='b_turn' joint2='a_turn' polycoef='.3 -2 0 0 0'/></equality>"
THREE = hinge("a", hinge("b", hinge("c"), ref=20), ref=10)


@pytest.mark.filterwarnings("ignore:.* has no effect. the robot states no:jounce.JounceWarning")
def test_a_linear_tie_of_joints_is_folded_as_mujoco_states_it():
    model = model_of(small(THREE, TIE))
    robot = jounce.Robot.from_mujoco(model)
    assert robot.joint_names == ("a_turn", "c_turn")
    a, b = model.qpos0[:2]
    assert robot.mechanism.G.tolist() == [[1, 0], [-2, 0], [0, 1]]
    assert robot.mechanism.g == pytest.approx([0, b + 0.3 + 2 * a, 0])
    data = mujoco.MjData(model)
    data.qpos[:] = robot.mechanism.G @ [0.7, -0.4] + robot.mechanism.g
    mujoco.mj_forward(model, data)
    tied = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    assert np.abs(data.efc_pos[tied]).max() < 1e-15  # MuJoCo sees its tie held
    check_against_mujoco(model, robot)


def test_ties_are_kept_out_where_the_model_switches_them_off():
    off = TIE.replace("<joint ", "<joint active='false' ")
    assert jounce.Robot.from_mujoco(model_of(small(THREE, off))).n == 3
    model = model_of(small(THREE, TIE))
    model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_EQUALITY
    assert jounce.Robot.from_mujoco(model).n == 3


TENDON = "<tendon><fixed name='t' {}><joint joint='a_turn' coef='1'/></fixed></tendon>"
SPATIAL = "<tendon><spatial name='t' {}><site site='s'/><site site='e'/></spatial></tendon>"
ON_TENDON = "<actuator><motor tendon='t' armature='1'/></actuator>"
LEFT_OUT_OF_THREE = {  # what stands beside the bodies, what is said of it, and the coordinates that remain
    "<joint joint1='a_turn' polycoef='.2 0 0 0 0'/>": ("equality constraints", 3),
    "<joint joint1='a_turn' joint2='b_turn'/><joint joint1='b_turn' joint2='a_turn'/>": ("equality constraints", 2),
    "<joint joint1='c_turn' joint2='a_turn'/><joint joint1='c_turn' joint2='b_turn'/>": ("equality constraints", 2),
    TENDON.format("stiffness='3' springlength='0 1'"): ("springs of tendons that are slack over a range", 3),
    SPATIAL.format("stiffness='3' armature='2'"): (
        "spatial tendons that pull or resist, armatures of spatial tendons",
        3,
    ),
    SPATIAL.format("") + ON_TENDON: ("motors on spatial tendons, drive trains of actuators at no joint", 3),
    "<actuator><motor joint='a_turn' damping='0 2'/></actuator>": ("dampers of actuators that are not linear", 3),
    "<option density='1000'/>": ("drag and lift of the fluid", 3),
    "<option viscosity='1'/>": ("drag and lift of the fluid", 3),
}


@pytest.mark.parametrize("more", LEFT_OUT_OF_THREE, ids=range(len(LEFT_OUT_OF_THREE)))
def test_what_no_tree_of_rigid_bodies_has_is_said_in_one_warning(more):
    words, n = LEFT_OUT_OF_THREE[more]
    constraint = more.startswith(("<joint", "<connect"))
    bodies = THREE.replace("</body>", "<site name='e'/></body>", 1) + "<site name='s' pos='1 0 0'/>"
    model = model_of(small(bodies, f"<equality>{more}</equality>" if constraint else more))
    with pytest.warns(jounce.JounceWarning) as said:
        assert jounce.Robot.from_mujoco(model).n == n
    assert [str(one.message) for one in said] == [
        f"model 'm': ignored, since not part of a tree of rigid bodies: {words}"
    ]


@pytest.mark.parametrize(
    ("bodies", "words"),
    [
        (hinge(damping="1 2"), "dampers that are not linear"),
        (hinge(stiffness="1 2"), "springs that are not linear"),
        (hinge(stiffness="1", springyield="3"), "springs that are not linear"),
        (hinge().replace("<body", "<body gravcomp='1'"), "bodies with gravity compensation"),
    ],
)
def test_drives_and_bodies_that_are_more_than_ours_are_warned_of(bodies, words):
    with pytest.warns(jounce.JounceWarning, match=words):
        jounce.Robot.from_mujoco(model_of(small(bodies)))


def test_plain_tendons_actuators_and_contacts_are_no_matter():
    actuators = "<actuator><position joint='a_turn' kp='9' kv='2'/><motor tendon='t' gear='3'/></actuator>"
    jounce.Robot.from_mujoco(model_of(small(THREE, TENDON.format("") + actuators)))  # a warning would be an error here


def test_rotors_and_dampers_count_by_the_square_of_the_gear():
    actuators = (
        "<motor joint='a_turn' gear='5' armature='.2' damping='.3'/><motor joint='a_turn' gear='2' armature='1'/>"
    )
    model = model_of(small(hinge(armature=0.5), f"<actuator>{actuators}</actuator>"))
    robot = jounce.Robot.from_mujoco(model)
    assert robot.drives.armature == pytest.approx([0.5 + 25 * 0.2 + 4])
    assert robot.drives.damping == pytest.approx([25 * 0.3])
    states = np.random.default_rng(5).uniform(-1, 1, (5, 3, 1))
    ours = robot.with_drives().inverse_dynamics(*np.moveaxis(states, 1, 0), method="recursion")
    assert relative_error(ours, inverse(model, robot, states)[0]) < 1e-12


@pytest.mark.parametrize(
    ("flag", "read"),
    [
        ("mjDSBL_GRAVITY", lambda robot: robot.gravity[2]),
        ("mjDSBL_SPRING", lambda robot: robot.drives.stiffness[0]),
        ("mjDSBL_DAMPER", lambda robot: robot.drives.damping[0]),
        ("mjDSBL_FRICTIONLOSS", lambda robot: robot.drives.friction[0]),
        ("mjDSBL_CONSTRAINT", lambda robot: robot.drives.friction[0]),
    ],
)
def test_what_flags_switch_off_is_off(flag, read):
    model = model_of(small(hinge(stiffness=1, damping=2, frictionloss=3)))
    assert read(jounce.Robot.from_mujoco(model)) != 0
    model.opt.disableflags = getattr(mujoco.mjtDisableBit, flag)
    assert read(jounce.Robot.from_mujoco(model)) == 0


def test_names_that_are_missing_or_taken_are_made():
    bodies = hinge(
        "body2", "<body><joint/><joint name='joint2'/><geom size='.1'/><site name='body2'/></body>", axis="1 0 0"
    )
    robot = jounce.Robot.from_mujoco(model_of(small(bodies)))
    assert robot.joint_names == ("body2_turn", "joint2_2", "joint2")
    assert robot.body_names == ("body2", "body2_2:joint2_2", "body2_2")


def test_a_model_without_a_name_is_called_after_its_file(tmp_path):
    path = tmp_path / "lever.xml"
    path.write_text(small(hinge()).replace(" model='m'", ""))
    assert jounce.load(path).name == "lever"


@pytest.mark.parametrize("name", ["robosuite_models/assets/robots/vx300s/robot.xml", "dm_control/suite/cheetah.xml"])
def test_a_file_is_read_as_its_model_is(name):
    path = path_of(name)
    loaded = quietly(jounce.load, path, drives=True).mechanism
    model = jounce.Robot.from_mujoco(mujoco.MjModel.from_xml_path(str(path))).mechanism
    for what in ("B", "X", "M", "gravity"):
        assert np.array_equal(getattr(loaded, what), getattr(model, what))
    assert loaded.joints == model.joints
    assert loaded.acting == ALL_DRIVE_TERMS


def test_a_urdf_may_end_in_xml(tmp_path):
    here = jounce.load(robot_file(tmp_path, *GOOD, name="robot.xml"))
    there = jounce.load(robot_file(tmp_path, *GOOD))
    assert np.array_equal(here.mechanism.M, there.mechanism.M)
    assert here.gravity.tolist() == [0, 0, -9.81]


def test_what_mujoco_warns_of_is_passed_on_and_leaves_no_log(tmp_path):
    (tmp_path / "old.xml").write_text(small(hinge()).replace("<option />", "<compiler settotalmass='3'/>"))
    with pytest.warns(jounce.JounceWarning, match=r"^old\.xml: MuJoCo warns: .*settotalmass"):
        assert jounce.load("old.xml").mechanism.M[0, 3, 3] == pytest.approx(3)
    assert [path.name for path in tmp_path.iterdir()] == ["old.xml"]
    assert mujoco.get_mju_user_warning() is None


BAD = {  # what a file holds, and what is said of it
    "<mujoco><worldbody><body>": ["robot.xml: MuJoCo rejects the file: XML parse error"],
    small(hinge(axle="1 0 0")): ["robot.xml: MuJoCo rejects the file:", "unrecognized attribute: 'axle'", "line 1"],
    small("<body name='a'><joint/></body>"): ["MuJoCo rejects the file:", "mass and inertia of moving bodies", "'a'"],
    small(hinge(), "<include file='gone.xml'/>"): ["MuJoCo rejects the file:", "gone.xml"],
    small(hinge().replace("<body", "<body pos='0 0 nan'")): ["robot.xml: body_pos of body 'a' is [0.0, 0.0, nan]"],
    small(hinge(damping="-1")): ["robot.xml: joint 'a_turn': damping is -1; expected 0 or more"],
    small(hinge(ref="nan")): ["robot.xml: ", "nan; expected"],
    small(hinge(), option="gravity='0 0 nan'"): ["robot.xml: gravity", "nan; expected finite numbers"],
    small("<geom size='.1'/>"): ["robot.xml: no joint; expected at least one movable joint"],
    small(hinge(inner=hinge("b")).replace("<joint name='a_turn' />", "<freejoint/>")): ["joint 'joint1' is floating"],
    "<sdf/>": ["robot.xml: jounce does not read SDF; convert it to URDF or MJCF"],
    "": ["robot.xml:1: not XML: no element found"],
    "name: arm": ["robot.xml:1: not XML: "],
    "<robot name='r'><link/></robot>": ["robot.xml:1: <link> has no name="],
}


OPTIONS = {"base='floating'": "--base floating", "base='fixed'": "--base fixed", "root=": "--root LINK"}


@pytest.mark.parametrize("content", BAD, ids=range(len(BAD)))
@pytest.mark.filterwarnings("ignore:.*NaN:jounce.JounceWarning")
def test_bad_files_are_refused_in_one_line(content, tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(content)
    message = refusal(lambda: jounce.load(path), *BAD[content])
    for argument, option in OPTIONS.items():
        message = message.replace(argument, option)
    result = call("info", path)
    assert (result.exit_code, result.output.splitlines()[-1]) == (2, f"Error: {message}")


def test_without_mujoco_the_command_that_installs_it_is_named(tmp_path, monkeypatch):
    path = tmp_path / "robot.xml"
    path.write_text(small(hinge()))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    refusal(lambda: jounce.load(path), "robot.xml: MJCF needs MuJoCo", "pip install 'jounce[mujoco]'")


@pytest.mark.parametrize("given", [7, "robot.xml", mujoco.MjSpec()], ids=lambda given: type(given).__name__)
def test_what_is_no_model_is_refused(given):
    with expect_refusal("from_mujoco() expects a mujoco.MjModel, got", type(given).__name__):
        jounce.Robot.from_mujoco(given)


@pytest.mark.parametrize(("array", "words"), [
    ("body_inertia", ["model 'm': body_inertia of body 'a' is [", "expected finite numbers"]),
    ("jnt_axis", ["model 'm': jnt_axis of joint 'a_turn' is ["]),
    ("dof_armature", ["model 'm': joint 'a_turn': armature is inf; expected a finite number"]),
])  # fmt: skip
def test_numbers_of_a_model_that_are_not_finite_are_refused(array, words):
    model = model_of(small(hinge()))
    getattr(model, array)[-1] = np.inf
    refusal(lambda: jounce.Robot.from_mujoco(model), *words)


def test_an_mjcf_file_serves_the_command_line(tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(small(THREE, TIE))
    result = call("info", path, "--json")
    assert result.exit_code == 0, result.output
    assert [one["name"] for one in json.loads(result.output)["coordinates"]] == ["a_turn", "c_turn"]


def test_mujocos_meshes_are_freed_unless_the_program_uses_mujoco(tmp_path):
    """It would hold up to 500 MB of them for as long as the process lives."""
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    (tmp_path / "mesh.obj").write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    (tmp_path / "arm.xml").write_text(
        "<mujoco><asset><mesh name='m' file='mesh.obj'/></asset><worldbody><body><joint name='a'/>"
        "<geom type='mesh' mesh='m'/></body></worldbody></mujoco>"
    )
    cache = mujoco.mj_getCache()
    mujoco.mj_clearCache(cache)
    assert jounce.load(tmp_path / "arm.xml").n == 1
    assert mujoco.mj_getCacheSize(cache) == 0
    mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    held = mujoco.mj_getCacheSize(cache)
    assert held > 0
    jounce.load(tmp_path / "arm.xml")
    assert mujoco.mj_getCacheSize(cache) == held
