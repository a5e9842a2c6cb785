"""The URDF reader: joints, frames and inertias by the conventions of URDF; fixed joints merged, mimic joints folded."""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jounce
from support.files import BODY, GOOD, ODD, OTHER, joint, link, origin, robot_file, text
from support.refusals import refusal


@pytest.fixture
def load(tmp_path):
    return lambda *items, **options: jounce.load(robot_file(tmp_path, *items, **options))


def by_hand(*bodies):
    """Mass, first moment and inertia tensor about the origin of bodies, each with the pose (R, p) of its link."""
    mass, moment, theta = 0.0, np.zeros(3), np.zeros((3, 3))
    for (m, com, rpy, (xx, xy, xz, yy, yz, zz)), R, p in bodies:
        c = R @ com + p
        turned = R @ Rotation.from_euler("xyz", rpy).as_matrix()
        mass, moment = mass + m, moment + m * c
        theta += turned @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turned.T
        theta += m * (c @ c * np.eye(3) - np.outer(c, c))
    return mass, moment, theta


def assert_inertia(M, mass, moment, theta):
    x, y, z = moment
    np.testing.assert_allclose(M[:3, :3], theta, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(M[:3, 3:], [[0, -z, y], [z, 0, -x], [-y, x, 0]], rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(M[3:, 3:], mass * np.eye(3), rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize(("kind", "at"), [("revolute", 0), ("continuous", 0), ("prismatic", 3)])
@pytest.mark.parametrize("axis", ["0 0 1", " 3  0\t-4 ", "1 2 3", "0 -0.001 0", "1e200 0 -1e200", "0 1e-200 0"])
def test_joint_types_and_axes(load, kind, at, axis):
    robot = load(link("base"), link("arm", BODY), joint("turn", "base", "arm", kind, axis))
    given = np.array([float(x) for x in axis.split()])
    given = given / np.abs(given).max()
    expected = np.zeros(6)
    expected[at : at + 3] = given / np.sqrt(given @ given)
    np.testing.assert_allclose(robot.mechanism.X, [expected], rtol=1e-15)
    assert (robot.name, robot.joint_names, robot.body_names, robot.mechanism.joints) == (
        "r", ("turn",), ("arm",), ("turn",)
    )  # fmt: skip


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("seed", range(3))
def test_origins_and_axes_follow_the_conventions_of_urdf(load, kind, seed):
    """Child pose = translate(xyz) * Rz(yaw) Ry(pitch) Rx(roll) * motion about or along the axis, in the child frame."""
    rng = np.random.default_rng(seed)
    xyz, rpy, axes = rng.normal(size=(2, 3)), rng.uniform(-np.pi, np.pi, (2, 3)), rng.normal(size=(2, 3))
    q = rng.uniform(-2, 2, 2)
    robot = load(
        link("base"), link("upper", BODY), link("fore", OTHER),
        joint("a", "base", "upper", kind, text(axes[0]), origin(xyz[0], rpy[0])),
        joint("b", "upper", "fore", kind, text(axes[1]), origin(xyz[1], rpy[1])),
    )  # fmt: skip
    R, p = np.eye(3), np.zeros(3)
    for i, pose in enumerate(robot.poses(q)):
        p = p + R @ xyz[i]
        R = R @ Rotation.from_euler("xyz", rpy[i]).as_matrix()
        step = q[i] * axes[i] / np.linalg.norm(axes[i])
        R, p = (R @ Rotation.from_rotvec(step).as_matrix(), p) if kind == "revolute" else (R, p + R @ step)
        np.testing.assert_allclose(pose[:3, :3], R, atol=1e-14)
        np.testing.assert_allclose(pose[:3, 3], p, atol=1e-14)
    for M, body in zip(robot.mechanism.M, (BODY, OTHER), strict=True):
        assert_inertia(M, *by_hand((body, np.eye(3), np.zeros(3))))


@pytest.mark.filterwarnings("ignore:.*bodies without mass")
def test_fixed_joints_merge(load):
    """arm carries tool by a fixed joint, tool carries tip by another; wrist turns on the tip."""
    rng = np.random.default_rng(4)
    (p1, r1), (p2, r2), (p3, r3), (p4, r4) = rng.uniform(-1, 1, (4, 2, 3))
    robot = load(
        link("world"), link("base", BODY), link("arm", BODY), link("tool", OTHER), link("tip", BODY), link("wrist"),
        joint("stand", "world", "base", "fixed", inner=origin(p1, r1)), joint("turn", "base", "arm"),
        joint("clamp", "arm", "tool", "fixed", inner=origin(p2, r2)),
        joint("glue", "tool", "tip", "fixed", inner=origin(p3, r3)),
        joint("bend", "tip", "wrist", inner=origin(p4, r4)),
    )  # fmt: skip
    R1, R2, R3, R4 = (Rotation.from_euler("xyz", r).as_matrix() for r in (r1, r2, r3, r4))
    tool, tip = (R2, p2), (R2 @ R3, R2 @ p3 + p2)
    assert robot.body_names == ("arm", "wrist")
    assert robot.mechanism.parent == (-1, 0)
    assert_inertia(robot.mechanism.M[0], *by_hand((BODY, np.eye(3), np.zeros(3)), (OTHER, *tool), (BODY, *tip)))
    expected = {"world": (-1, np.eye(3), 0), "base": (-1, R1, p1), "tool": (0, *tool), "tip": (0, *tip)}
    assert {frame.name for frame in robot.mechanism.frames} == set(expected)
    for name, (body, R, p) in expected.items():
        frame = robot.mechanism.frame(name)
        assert frame.body == body
        np.testing.assert_allclose(frame.T[:3, :3], R, atol=1e-15)
        np.testing.assert_allclose(frame.T[:3, 3], np.zeros(3) + p, atol=1e-15)
    np.testing.assert_allclose(robot.mechanism.B[0][:3, :3], R1, atol=1e-15)
    np.testing.assert_allclose(robot.mechanism.B[1][:3, :3], R2 @ R3 @ R4, atol=1e-15)
    np.testing.assert_allclose(robot.mechanism.B[1][:3, 3], tip[0] @ p4 + tip[1], atol=1e-15)
    J = robot.jacobian([0.4, -0.2], body="tip")  # turns about the z axis of arm, seen from the tip
    z = tip[0].T @ [0, 0, 1]
    np.testing.assert_allclose(J[:, 0], [*z, *(tip[0].T @ np.cross([0, 0, 1], tip[1]))], atol=1e-15)
    assert not robot.jacobian([0.4, -0.2], body="base").any()
    refusal(lambda: robot.jacobian([0, 0], body="tipp"), "'tipp'", "did you mean 'tip'")


def test_order_is_that_of_the_document_depth_first(load):
    joints = [("b2", "b1", "b2"), ("a", "base", "a1"), ("b1", "base", "b1"), ("b3", "b1", "b3"), ("a2", "a1", "a2")]
    names = ["b3", "a2", "base", "b1", "b2", "a1"]
    robot = load(*(joint(*given) for given in joints), *(link(name, BODY) for name in names))
    assert robot.joint_names == ("a", "a2", "b1", "b2", "b3")
    assert robot.body_names == ("a1", "a2", "b1", "b2", "b3")
    assert robot.mechanism.parent == (-1, 0, -1, 2, 2)


def test_forest_of_two_roots(load):
    one, two = GOOD, (link("base2", BODY), link("arm2", OTHER), joint("turn2", "base2", "arm2", axis="1 0 0"))
    robot, state = load(*two, *one), np.array([[0.3, -0.4], [1.0, 2.0], [0.5, -1.0]])
    assert robot.joint_names == ("turn2", "turn")
    assert robot.mechanism.parent == (-1, -1)
    alone = [load(*items).inverse_dynamics(*state[:, [j]]) for j, items in enumerate((two, one))]
    np.testing.assert_allclose(robot.inverse_dynamics(*state), np.concatenate(alone), rtol=1e-14)


def test_link_without_inertial_is_massless(load):
    with pytest.warns(jounce.JounceWarning, match="bodies without mass that carry none.*: flag; .*massless_tips=True"):
        robot = load(*GOOD, link("flag"), joint("wave", "arm", "flag", axis="0 1 0"))
    assert not robot.mechanism.M[1].any()
    Q = robot.inverse_dynamics([0.1, 0.2], [1, 2], [3, 4])
    assert Q[1] == 0
    np.testing.assert_allclose(Q[0], load(*GOOD).inverse_dynamics([0.1], [1], [3])[0], rtol=1e-14)


def test_mimic_chains(load):
    """c = 2 b + 0.3 and b = -0.5 a + 0.1; d = a (the defaults)."""
    links = [link("base"), *(link(name, BODY) for name in "ABCD")]
    follow = {
        "c": '<mimic joint="b" multiplier="2" offset="0.3"/>',
        "b": '<mimic joint="a" multiplier="-0.5" offset="0.1"/>',
        "d": '<mimic joint="a"/>',
    }
    tree = (("c", "base", "C"), ("a", "C", "A"), ("b", "A", "B"), ("e", "B", "D"))
    joints = [(*given, "revolute", "1 2 3") for given in tree]
    joints.append(("d", "base", "E", "prismatic", "1 0 0"))
    links.append(link("E", OTHER))
    robot = load(*links, *(joint(*given, inner=follow.get(given[0], "")) for given in joints))
    free = load(*links, *(joint(*given) for given in joints))
    assert free.joint_names == robot.mechanism.joints == ("c", "a", "b", "e", "d")
    assert robot.joint_names == ("a", "e")
    G, g = np.array([[-1, 0], [1, 0], [-0.5, 0], [0, 1], [1, 0]]), np.array([0.5, 0, 0.1, 0, 0])
    q, qd, q2d = np.random.default_rng(0).normal(size=(3, 2))
    tau = free.inverse_dynamics(G @ q + g, G @ qd, G @ q2d)
    np.testing.assert_allclose(robot.inverse_dynamics(q, qd, q2d), G.T @ tau, rtol=1e-12)


def test_gravity(tmp_path):
    path = robot_file(
        tmp_path, link("base"), link("arm", (2.0, [0.5, 0, 0], [0, 0, 0], [0] * 6)), joint("turn", "base", "arm")
    )
    assert jounce.load(path).gravity.tolist() == [0, 0, -9.81]
    sideways = jounce.load(str(path), gravity=[0, -3.0, 0])
    np.testing.assert_allclose(sideways.inverse_dynamics([0.0], [0.0], [0.0]), [2.0 * 0.5 * 3.0])
    refusal(lambda: jounce.load(path, gravity=[0, 1]), "gravity", "(2,)", "(3,)")


def test_what_dynamics_needs_not_is_ignored(load):
    looks = (
        f'<visual>{origin([1, 2, 3])}<geometry><mesh filename="package://nowhere/arm.dae"/></geometry></visual>'
        '<collision><origin xyz="bad"/><geometry><mesh filename="package://nowhere/arm.stl"/></geometry></collision>'
    )
    extra = (
        "<!-- a comment -->", '<material name="red"><color rgba="1 0 0 1"/></material>',
        '<transmission name="t"><type>x</type><joint name="turn"/></transmission>',
        '<gazebo reference="arm"><link name="ghost"/><joint name="ghost" type="floating"/></gazebo>',
    )  # fmt: skip
    limits = '<!-- limits --><limit effort="1" lower="-1" upper="1" velocity="1"/><dynamics damping="0.1"/>'
    head = '<?xml version="1.0" encoding="utf-8"?>\n<!-- Grüße -->\n<robot name="r">'
    robot = load(
        link("base", inner=looks),
        link("arm", BODY, looks),
        *extra,
        joint("turn", "base", "arm", inner=limits),
        head=head,
    )
    plain = load(*GOOD)
    assert robot.body_names == plain.body_names
    assert {frame.name for frame in robot.mechanism.frames} == {"base"}
    for field in ("B", "X", "M", "G", "g"):
        np.testing.assert_array_equal(getattr(robot.mechanism, field), getattr(plain.mechanism, field))


def test_nameless_robot_is_named_after_its_file(load):
    assert load(*GOOD, head="<robot>", name="robot.URDF").name == "robot"


def test_angles_of_more_than_a_turn_are_warned_of(tmp_path):
    turned = joint("turn", "base", "arm", inner=origin(rpy=(0, 90, 0)))
    with pytest.warns(jounce.JounceWarning, match=r"robot.urdf:4: rpy is \[0.0, 90.0, 0.0\], more than a turn.* rad$"):
        jounce.load(robot_file(tmp_path, link("base"), link("arm", BODY), turned))


def test_warns_once_of_impossible_inertias(tmp_path):
    items = [link("base"), link("a", ODD), link("b", BODY), link("c", (-1.0, *BODY[1:]))]
    joints = [joint(f"j{name}", "base", name) for name in "abc"]
    path = robot_file(tmp_path, *items, *joints)
    with pytest.warns(jounce.JounceWarning) as caught:
        jounce.load(path)
    assert len(caught) == 1
    message = str(caught[0].message)
    for word in (str(path), "2 of 3 bodies", "a: ", "triangle inequality", "0.5 kg m^2", "1 more"):
        assert word in message
    assert message.isprintable()
    assert caught[0].filename == __file__  # where the caller stands
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        jounce.load(robot_file(tmp_path, link("base"), link("arm", BODY), joint("turn", "base", "arm")))


def test_limits_of_urdf_1_2_are_read_and_written_back(load, tmp_path):
    def limited(more=""):
        limit = f'<limit lower="-1" upper="1" velocity="2" effort="3" acceleration="4" jerk="5"{more}/>'
        return load(link("base"), link("arm", BODY), joint("turn", "base", "arm", inner=limit))

    robot = limited()
    assert (robot.limits.acceleration.tolist(), robot.limits.jerk.tolist()) == ([4.0], [5.0])
    jounce.save(robot, tmp_path / "robot.yaml")
    assert jounce.load(tmp_path / "robot.yaml").limits == robot.limits == limited(' deceleration="4"').limits
    with pytest.warns(
        jounce.JounceWarning, match=r"robot.urdf:4: deceleration= is left out; acceleration= alone bounds"
    ):
        assert limited(' deceleration="3"').limits == robot.limits


def test_a_world_that_only_joints_name_is_the_ground(load, tmp_path):
    items = link("arm", BODY), joint("turn", "world", "arm", axis="0 1 0")
    stated, unstated = load(link("world"), *items), load(*items)
    assert unstated.mechanism.frame_names == stated.mechanism.frame_names
    q = np.array([[0.3, 1.0, 2.0]]).T
    assert np.array_equal(unstated.inverse_dynamics(q, q, q), stated.inverse_dynamics(q, q, q))
    path = robot_file(tmp_path, *items)
    refusal(lambda: jounce.load(path, base="floating"), "'world' is the ground, and no free joint stands on it")
    path = robot_file(tmp_path, link("arm", BODY), joint("free", "world", "arm", kind="floating", axis=None))
    loose = jounce.load(path, base="floating")
    assert loose.nv == 6
    refusal(lambda: load(link("arm", BODY), joint("turn", "ground", "arm")), "unknown link 'ground'")
