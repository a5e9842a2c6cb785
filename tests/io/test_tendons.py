"""Fixed tendons of MJCF: drive trains and motors that move several joints, against MuJoCo and virtual work."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.polynomial import Polynomial

import jounce
from jounce.dynamics.loop_closure import close_loops
from support.refusals import expect_refusal
from support.robots import differentiated, harmonic, relative_error

FILES = Path(__file__).parents[1] / "data" / "actuators"
WRIST = np.array([[28.25, -16.75], [28.25, 16.75]])
DRIVES = ["armature", "damping", "spring"]


def forces_of_mujoco(model, joints, states):
    """The forces that MuJoCo asks of its joints, by name, in states of shape (3, joints); Coulomb friction is off."""
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    at, dofs = ([int(x[model.joint(name).id]) for name in joints] for x in (model.jnt_qposadr, model.jnt_dofadr))
    data.qpos[at], data.qvel[dofs], data.qacc[dofs] = states
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse[dofs]


def tendon_chain(tendons, actuators="", joints="hinge slide hinge slide", more=""):
    """MJCF of a chain of hinges and slides, j0, j1, ..., with tendons and actuators."""
    bodies, ends = "", ""
    for k, kind in enumerate(joints.split()):
        axis = ("0 1 0", "1 0 .3", "0 .2 1", "1 1 0")[k % 4]
        bodies += (
            f"<body name='b{k}' pos='.1 0 .2'><joint name='j{k}' type='{kind}' axis='{axis}' ref='{0.1 * k}'/>"
            f"<inertial mass='{1 + k}' pos='.05 .02 .1' diaginertia='.02 .03 .01'/>"
        )
        ends += "</body>"
    world = f"<compiler angle='radian' autolimits='true'/><worldbody>{bodies}{ends}</worldbody>"
    return f"<mujoco model='m'>{world}<tendon>{tendons}</tendon><actuator>{actuators}</actuator>{more}</mujoco>"


def fixed_tendon(name, coefficients, **attributes):
    """A fixed tendon, its coefficients by the number of the joint."""
    stated = " ".join(f"{key}='{value}'" for key, value in attributes.items())
    parts = "".join(f"<joint joint='j{k}' coef='{c}'/>" for k, c in coefficients.items())
    return f"<fixed name='{name}' {stated}>{parts}</fixed>"


def from_text(text):
    model = mujoco.MjModel.from_xml_string(text)
    return jounce.Robot.from_mujoco(model), model


def test_a_motor_on_two_equal_fingers_is_one_motor():
    robot = jounce.load(FILES / "tendon_fingers.xml")
    assert robot.joint_names == ("lift", "finger_joint2")
    assert robot.mechanism.closure is None
    efforts = dict(zip(robot.mechanism.joints, robot.limits.bounds("effort").T.tolist(), strict=True))
    assert efforts["finger_joint2"] == [-100, 100]
    assert efforts["lift"] == [-20, 20]


@pytest.mark.parametrize("name", ["tendon_wrist", "tendon_wrist_armature"])
def test_motors_of_a_wrist_share_its_forces_by_virtual_work(name):
    robot = jounce.load(FILES / f"{name}.xml")
    if name.endswith("armature"):
        robot = robot.with_drives(DRIVES)
    model = mujoco.MjModel.from_xml_path(str(FILES / f"{name}.xml"))
    assert robot.joint_names == ("pitch", "roll")
    for state in np.random.default_rng(0).uniform(-1.5, 1.5, (10, 3, 2)):
        Q = forces_of_mujoco(model, robot.joint_names, state)
        assert relative_error(robot.inverse_dynamics(*state), Q) < 1e-12
        assert relative_error(robot.actuator_forces(*state), np.linalg.solve(WRIST.T, Q)) < 1e-12
    limits = dict(zip(robot.mechanism.joints, robot.limits.effort, strict=True))
    assert (limits["motor2"], limits["motor3"]) == (1.5, 1.5)


def test_drive_trains_of_tendons_act_by_their_ratios():
    robot, plain = (jounce.load(FILES / f"tendon_wrist{x}.xml") for x in ("_armature", ""))
    M = robot.with_drives(["armature"]).mass_matrix([0.3, 0.4]) - plain.mass_matrix([0.3, 0.4])
    np.testing.assert_allclose(M, WRIST.T @ np.diag([8.3e-5, 0]) @ WRIST, rtol=1e-12)
    q, qd, none = [0.3, 0.4], np.array([0.2, -0.1]), np.zeros(2)
    damped, still = (robot.with_drives(x).inverse_dynamics(q, qd, none) for x in (["damping"], []))
    np.testing.assert_allclose(damped - still, WRIST.T @ np.diag([1e-4, 0]) @ WRIST @ qd, rtol=1e-12)
    # Friction is 99.99 % of its loss at five times its smoothing velocity.
    rubbing = robot.with_drives(["friction"]).inverse_dynamics(q, qd, none) - still
    assert relative_error(rubbing, WRIST[0] * 0.002 * np.sign(WRIST[0] @ qd)) < 1e-4


@pytest.mark.parametrize("seed", range(6))
def test_tendons_over_joints_of_any_kind_resist_as_in_mujoco(seed):
    """Hinges and slides on one tendon: coefficients have the units."""
    rng = np.random.default_rng(seed)
    tendons = "".join(
        fixed_tendon(
            f"t{i}",
            dict(zip(rng.choice(4, size, replace=False), rng.normal(size=size), strict=True)),
            armature=0.3,
            damping=0.7,
            stiffness=4,
            springlength=0.2,
        )
        for i, size in enumerate((2, 3, 1))
    )
    robot, model = from_text(tendon_chain(tendons))
    driven = robot.with_drives(DRIVES)
    for state in rng.uniform(-1, 1, (5, 3, 4)):
        assert (
            relative_error(driven.inverse_dynamics(*state), forces_of_mujoco(model, robot.joint_names, state)) < 1e-11
        )
    # Rates, against differences over nine points.
    motion = harmonic(rng, robot.n, 4)

    def forces(t, k):
        exact = [x.astype(np.longdouble) for x in motion(np.longdouble(t))[: 3 + k]]
        return np.atleast_2d(driven.inverse_dynamics(*exact))[k]

    for k, rate in enumerate(driven.inverse_dynamics(*motion(0.0))[1:]):
        assert relative_error(rate, differentiated(lambda t, k=k: forces(t, k), h=0.004)) < 1e-10


def test_gears_and_own_motors_enter_a_coupled_drive():
    """Joint 0 has a motor of its own next to the tendon; a tendon of two motors turns by its length."""
    tendons = fixed_tendon("pair", {0: 2.0, 1: -1.0}, limited="true", range="-3 4") + fixed_tendon(
        "both", {2: 1.0, 3: 0.5}
    )
    tendons += fixed_tendon("cross", {2: -1.0, 3: 0.5})
    actuators = (
        "<motor name='cable' tendon='pair' gear='-5' forcerange='-1 3'/><motor name='m0' joint='j0' gear='2'"
        " forcerange='-7 7'/><motor tendon='both' gear='3' forcerange='-1 1'/><motor tendon='both' forcerange='-2 2'/>"
        "<motor name='x' tendon='cross'/>"
    )
    robot, _ = from_text(tendon_chain(tendons, actuators))
    m = robot.mechanism
    names = [m.closure.coordinates[j] for j in m.closure.actuated]
    assert sorted(names) == ["both", "cable", "j0_motor", "x"]
    limits = dict(zip(m.joints, m.limits.bounds("effort").T.tolist(), strict=True))
    assert limits["cable"] == [-1, 3]
    assert limits["j0_motor"] == [-14, 14]
    assert limits["both"] == [-5, 5]
    assert limits["j0"] == [-np.inf, np.inf]  # its own motor is not all that moves it
    lower, upper = (dict(zip(m.joints, x, strict=True)) for x in (m.limits.lower, m.limits.upper))
    assert (lower["cable"], upper["cable"]) == (-20, 15)
    # phi = A q of the motors, and tau with A^T tau = Q.
    A = {"cable": [-10, 5, 0, 0], "j0_motor": [1, 0, 0, 0], "both": [0, 0, 1, 0.5], "x": [0, 0, -1, 0.5]}
    q, qd, q2d = np.random.default_rng(1).uniform(-1, 1, (3, 4))
    positions = dict(zip(m.closure.coordinates, robot.coordinates(q), strict=True))
    for name in names:
        assert positions[name] == pytest.approx(np.dot(A[name], q), abs=1e-14)
    tau = robot.actuator_forces(q, qd, q2d)
    np.testing.assert_allclose(np.array([A[name] for name in names]).T @ tau, robot.inverse_dynamics(q, qd, q2d))


def test_one_motor_over_two_free_joints_is_left_out_in_words():
    text = tendon_chain(fixed_tendon("split", {0: 1.0, 2: 1.0}), "<motor name='a' tendon='split'/><motor joint='j1'/>")
    with pytest.warns(jounce.JounceWarning, match="motors on tendons are left out, as they leave .*: split on j0, j2"):
        robot, _ = from_text(text)
    assert robot.mechanism.closure is None


def test_what_shares_a_joint_with_a_tendon_bounds_no_force():
    """The range of the motor at j0 bounded its force alone, although the tendon pulls too; the joint's clamp does."""
    text = tendon_chain(
        fixed_tendon("t", {0: 1.0, 2: 1.0}),
        "<motor joint='j0' forcerange='-1 1'/><motor tendon='t' forcerange='-50 50'/>",
    ).replace("name='j2'", "name='j2' actuatorfrcrange='-30 20'")
    robot, _ = from_text(text)
    limits = dict(zip(robot.mechanism.joints, robot.limits.bounds("effort").T.tolist(), strict=True))
    assert limits["j0"] == [-np.inf, np.inf]
    assert limits["j2"] == [-30, 20]
    # Both motors together determine both joints, and keep their ranges.
    assert limits["motor2"] == [-50, 50]
    assert limits["j0_motor"] == [-1, 1]


def test_two_motors_on_one_joint_exert_the_sum_of_their_ranges():
    actuators = "<motor joint='j0' forcerange='-1 1'/><motor tendon='t' forcerange='-5 2'/>"
    robot, _ = from_text(tendon_chain(fixed_tendon("t", {0: 2.0}), actuators))
    assert robot.limits.bounds("effort")[:, 0].tolist() == [-11, 5]


def test_a_robot_of_tendons_floats_and_goes_to_mujoco_and_back():
    text = tendon_chain(
        fixed_tendon("a", {1: 1.0, 2: 1.0}, armature=0.1) + fixed_tendon("b", {1: 1.0, 2: -1.0}),
        "<motor name='ma' tendon='a'/><motor name='mb' tendon='b'/>",
    )
    model = mujoco.MjModel.from_xml_string(text)
    robot = jounce.Robot.from_mujoco(model)
    q, qd, q2d = np.random.default_rng(0).uniform(-1, 1, (3, 4))
    vectors = robot.state_to("mujoco", q, qd, q2d, model=model)
    state = robot.state_from("mujoco", *vectors, model=model)
    for ours, back in zip((q, qd, q2d), state.rates, strict=True):
        np.testing.assert_array_equal(ours, back)
    floating = jounce.Robot.from_mujoco(model, base="floating", root="b0")
    assert floating.mechanism.closure is not None
    assert floating.n == 3


def test_a_robot_of_tendons_is_saved_and_loaded(tmp_path):
    robot = jounce.load(FILES / "tendon_wrist_armature.xml")
    jounce.save(robot, tmp_path / "wrist.yaml")
    assert jounce.load(tmp_path / "wrist.yaml") == robot


def gripper():
    """The gripper and its model: a motor on a tendon closes two fingers of four bars and a spring each."""
    return jounce.load(FILES / "gripper.xml"), mujoco.MjModel.from_xml_path(str(FILES / "gripper.xml"))


def test_a_gripper_of_springs_and_a_tendon_closes_without_a_hint():
    robot, _ = gripper()
    closure = robot.mechanism.closure
    assert robot.joint_names == ("lift", "left_driver", "right_spring_link", "left_spring_link")
    assert [closure.coordinates[j] for j in closure.actuated] == ["lift", "left_driver"]
    assert [robot.joint_names[k] for k in closure.passive] == ["right_spring_link", "left_spring_link"]
    efforts = dict(zip(robot.mechanism.joints, robot.limits.effort, strict=True))
    assert efforts["left_driver"] == 5


def test_forces_of_a_gripper_are_those_of_mujoco_by_virtual_work():
    """F by differences of closed positions; Q of the open tree is MuJoCo's."""
    robot, model = gripper()
    driven, joints = robot.with_drives(DRIVES), [model.joint(i).name for i in range(model.njnt)]
    m = robot.mechanism
    rng, h = np.random.default_rng(0), 1e-5

    def whole(u):
        """All joints of the model at independent coordinates."""
        theta = m.closure.G @ close_loops(m, u[None])[0] + m.closure.g
        return theta[[m.joints.index(name) for name in joints]]

    for _ in range(5):
        u, ud, u2d = np.array([0.1, 0.2, 0.05, 0.1]) * rng.uniform(0.5, 1, 4), *rng.uniform(-0.5, 0.5, (2, 4))
        F = np.stack([(whole(u + h * e) - whole(u - h * e)) / (2 * h) for e in np.eye(4)], axis=1)
        # theta'' of u + ud t + u2d t^2 / 2.
        ahead, here, back = (whole(u + t * ud + t**2 / 2 * u2d) for t in (1e-4, 0.0, -1e-4))
        Q = forces_of_mujoco(model, joints, [here, F @ ud, (ahead - 2 * here + back) / 1e-8])
        assert relative_error(driven.inverse_dynamics(u, ud, u2d), F.T @ Q) < 1e-6


def test_rates_of_a_gripper_agree_with_differences():
    robot = gripper()[0].with_drives(DRIVES)
    motion = harmonic(np.random.default_rng(2), robot.n, 4)
    scale, offset = 0.05, np.array([0, 0.2, 0.05, 0.05])

    def rates(t):
        q, *others = motion(t)
        return [offset + scale * q, *(scale * x for x in others)]

    _, Qd, Q2d = robot.inverse_dynamics(*rates(0.0))
    for k, ours in enumerate((Qd, Q2d)):
        expected = differentiated(lambda t, k=k: np.atleast_2d(robot.inverse_dynamics(*rates(t)[: 3 + k]))[k], h=0.01)
        assert relative_error(ours, expected) < 1e-7


@pytest.mark.parametrize("tendon", ["<fixed name='t'/>", fixed_tendon("t", {1: 1.0})], ids=["of no joint", "of a ball"])
def test_tendons_that_cannot_be_are_refused_in_one_line(tmp_path, tendon):
    text = tendon_chain(tendon, joints="hinge ball").replace("type='ball' axis='1 0 .3' ref='0.1'", "type='ball'")
    (tmp_path / "bad.xml").write_text(text)
    with expect_refusal(str(tmp_path / "bad.xml"), "MuJoCo rejects the file"):
        jounce.load(tmp_path / "bad.xml")


def test_springs_of_tendons_that_are_slack_are_warned_of():
    with pytest.warns(jounce.JounceWarning, match="springs of tendons that are slack over a range"):
        from_text(tendon_chain(fixed_tendon("t", {0: 1.0}, stiffness=3, springlength="0 1")))


WRIST_URDF = """<robot name="wrist"><link name="base"/>
<link name="yoke"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
  <inertia ixx="0.02" iyy="0.02" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="hand"><inertial><origin xyz="0.05 0 0.1"/><mass value="1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pitch" type="continuous"><parent link="base"/><child link="yoke"/><axis xyz="0 1 0"/></joint>
<joint name="roll" type="continuous"><origin xyz="0 0 0.3"/><parent link="yoke"/><child link="hand"/>
  <axis xyz="0 0 1"/></joint>
<transmission name="t"><type>transmission_interface/DifferentialTransmission</type>
<joint name="pitch"><role>joint1</role></joint><joint name="roll"><role>joint2</role></joint>
<actuator name="left"><role>actuator1</role><mechanicalReduction>20</mechanicalReduction></actuator>
<actuator name="right"><role>actuator2</role><mechanicalReduction>20</mechanicalReduction></actuator>
</transmission></robot>"""
WRIST_MJCF = """<mujoco model="wrist"><worldbody><body name="yoke"><joint name="pitch" axis="0 1 0"/>
<inertial mass="2" pos="0 0 0.2" diaginertia="0.02 0.02 0.005"/>
<body name="hand" pos="0 0 0.3"><joint name="roll" axis="0 0 1"/>
<inertial mass="1" pos="0.05 0 0.1" diaginertia="0.01 0.01 0.004"/></body></body></worldbody>
<tendon><fixed name="sum"><joint joint="pitch" coef="20"/><joint joint="roll" coef="20"/></fixed>
<fixed name="difference"><joint joint="pitch" coef="20"/><joint joint="roll" coef="-20"/></fixed></tendon>
<actuator><motor name="left" tendon="sum"/><motor name="right" tendon="difference"/></actuator></mujoco>"""


def test_a_differential_wrist_is_the_same_robot_in_urdf_and_mjcf(tmp_path):
    (tmp_path / "wrist.urdf").write_text(WRIST_URDF)
    (tmp_path / "wrist.xml").write_text(WRIST_MJCF)
    of_urdf, of_mjcf = jounce.load(tmp_path / "wrist.urdf"), jounce.load(tmp_path / "wrist.xml")
    # The ground is a link of its own name in each format.
    one, other = (jounce.Robot(replace(robot.mechanism, frames=())) for robot in (of_urdf, of_mjcf))
    assert one == other
    rates = np.random.default_rng(0).uniform(-1, 1, (5, 2))
    for ours, theirs in zip(of_urdf.actuator_forces(*rates), of_mjcf.actuator_forces(*rates), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert jounce.load(tmp_path / "wrist.xml", transmissions=False).mechanism.closure is None


def random_tree_of_tendons(seed):
    """MJCF of a random tree of hinges and slides with tendons, motors and followers; the followers by joint."""
    rng, n, depth = np.random.default_rng(seed), 5, 0
    bodies = ""
    for k, kind in enumerate(rng.choice(["hinge", "slide"], n)):
        axis = " ".join(map(repr, rng.normal(size=3).tolist()))
        bodies += (
            f"<body name='b{k}' pos='.1 {0.1 * k} .2'><joint name='j{k}' type='{kind}' axis='{axis}'"
            f" ref='{rng.uniform(-0.3, 0.3)}'/><inertial mass='{1 + k}' pos='.05 .02 .1' diaginertia='.02 .03 .02'/>"
        )
        depth += 1
        if rng.random() < 0.4 and depth > 1 and k < n - 1:
            bodies, depth = bodies + "</body>", depth - 1
    order, laws = rng.permutation(n), {}
    for place, joint in enumerate(order[2:], 2):
        coefficients = rng.uniform(-0.5, 0.5, 5)
        coefficients[2:] *= rng.random() < 0.5
        if rng.random() < 0.6:
            laws[int(joint)] = int(order[rng.integers(0, place)]), Polynomial(coefficients)
    ties = "".join(
        f"<joint joint1='j{i}' joint2='j{j}' polycoef='{' '.join(map(repr, law.coef.tolist()))}'/>"
        for i, (j, law) in laws.items()
    )
    tendons = "".join(
        fixed_tendon(
            f"t{i}",
            {j: rng.normal() for j in rng.choice(n, rng.integers(1, 4), replace=False)},
            armature=rng.uniform(0, 0.5), damping=rng.uniform(0, 0.5), stiffness=3, springlength=0.2,
        )
        for i in range(rng.integers(1, 3))
    )  # fmt: skip
    world = f"<compiler angle='radian'/><worldbody>{bodies}{'</body>' * depth}</worldbody>"
    parts = f"<equality>{ties}</equality><tendon>{tendons}</tendon><actuator><motor tendon='t0' gear='2'/></actuator>"
    return mujoco.MjModel.from_xml_string(f"<mujoco model='m'>{world}{parts}</mujoco>"), laws


def armature_between_branches(model):
    """The parts a c_i c_j of tendons' armature for joints of which none carries the other: MuJoCo leaves them out."""
    n = model.nv
    carriers = [{j} for j in range(n)]
    for j in range(n):  # a joint for each body, in the order of bodies
        parent = model.body_parentid[j + 1] - 1
        carriers[j] |= carriers[parent] if parent >= 0 else set()
    J = np.zeros((model.ntendon, n))
    for i in range(model.ntendon):
        parts = range(model.tendon_adr[i], model.tendon_adr[i] + model.tendon_num[i])
        for part in parts:
            J[i, model.wrap_objid[part]] += model.wrap_prm[part]
    apart = np.array([[i not in carriers[j] and j not in carriers[i] for j in range(n)] for i in range(n)])
    return apart * (J.T @ np.diag(model.tendon_armature) @ J)


@pytest.mark.sweep(20)
@pytest.mark.parametrize("seed", range(40))
@pytest.mark.filterwarnings("ignore:.*motors on tendons are left out:jounce.JounceWarning")
def test_random_trees_with_tendons_and_followers_agree_with_mujoco(seed):
    model, laws = random_tree_of_tendons(seed)
    robot = jounce.Robot.from_mujoco(model).with_drives(DRIVES)
    assert robot.n == model.nv - len(laws)
    leaders = [model.joint(name).id for name in robot.joint_names]

    def follow(i, q, qd, q2d):
        if i in laws:
            j, law = laws[i]
            follow(j, q, qd, q2d)
            x, slope, bend = q[j] - model.qpos0[j], law.deriv(), law.deriv(2)
            q[i], qd[i] = model.qpos0[i] + law(x), slope(x) * qd[j]
            q2d[i] = slope(x) * q2d[j] + bend(x) * qd[j] ** 2

    def whole(rates):
        q, qd, q2d = (x.copy() for x in rates)
        for i in laws:
            follow(i, q, qd, q2d)
        return q, qd, q2d

    rates = np.random.default_rng(seed).uniform(-0.6, 0.6, (3, model.nv))
    q, qd, q2d = whole(rates)
    F = np.stack([whole([rates[0], np.eye(model.nv)[j], 0 * q])[1] for j in leaders], axis=1)
    joints = [model.joint(j).name for j in range(model.nv)]
    Q = forces_of_mujoco(model, joints, [q, qd, q2d]) + armature_between_branches(model) @ q2d
    assert relative_error(robot.inverse_dynamics(q[leaders], qd[leaders], q2d[leaders]), F.T @ Q) < 1e-12
