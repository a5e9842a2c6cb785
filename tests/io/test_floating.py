"""Robots that float, from files and other libraries: which link is the base, its inertia, and what is fixed to it."""

import json
import pickle
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio
import pytest

import jounce
from support.commands import call
from support.files import BODY, ODD, OTHER, joint, link, origin, robot_file
from support.refusals import refusal
from support.robots import on_base, parts, random_inertia, relative_error

PLACED = origin((0.3, -0.2, 0.5), (0.1, 0.7, -0.4))
TURN = joint("turn", "trunk", "arm", axis="0 1 0")
ROBOT = (
    link("trunk", BODY),
    link("lid", OTHER),
    joint("glue", "trunk", "lid", "fixed", inner=PLACED),
    link("arm", BODY),
)
WORLD = (link("world"), *ROBOT, TURN)


def flying(kind="floating"):
    return (*WORLD, joint("flight", "world", "trunk", kind, inner=PLACED))


def assert_floats(robot, name, like):
    """The base is the body behind a joint of another robot, and so are all bodies beyond it."""
    m, other = robot.mechanism, like.mechanism
    i = other.bodies.index(name)
    assert (m.floats, m.bodies[0], m.parent[0]) == (True, name, -1)
    assert np.abs(m.M[0] - other.M[i]).max() < 1e-15
    np.testing.assert_array_equal(m.M[1:], other.M[i + 1 :])
    np.testing.assert_array_equal(m.B[1:], other.B[i + 1 :])
    assert m.parent[1:] == tuple(p - i for p in other.parent[i + 1 :])


@pytest.mark.parametrize("options", [{}, {"root": "trunk"}], ids=["", "root"])
@pytest.mark.parametrize("items", [(*ROBOT, TURN), flying()], ids=["root link", "floating joint"])
def test_a_link_floats_with_what_is_fixed_to_it(tmp_path, items, options):
    robot = jounce.load(robot_file(tmp_path, *items), base="floating", **options)
    assert_floats(robot, "trunk", jounce.load(robot_file(tmp_path, *flying("revolute"))))
    assert [(frame.name, frame.body) for frame in robot.mechanism.frames] == [("lid", 0)]
    assert (robot.n, robot.nv, robot.mechanism.frame("trunk").body) == (1, 7, 0)


def test_what_stands_on_the_ground_is_left_out(tmp_path):
    """A floor that does not move, and a link that a joint carries."""
    floor = (link("floor", BODY), joint("floor", "world", "floor", "fixed"))
    robot = jounce.load(robot_file(tmp_path, *flying(), *floor), base="floating")
    assert robot.mechanism.frame_names == ("trunk", "arm", "lid")
    arm = (*flying(), link("hand", OTHER), joint("bend", "arm", "hand"))
    robot = jounce.load(robot_file(tmp_path, *arm), base="floating", root="arm")
    assert (robot.body_names, robot.joint_names) == (("arm", "hand"), ("bend",))


SECOND = (link("wing", BODY), joint("glide", "world", "wing", "floating"))
DH = "units: SI\nangles: rad\nconvention: modified\ndh:\n  - {name: a, a: 0, alpha: 0, d: 0, theta: 0}\n"
TWO_ROOTS = (*WORLD, link("flap", OTHER), joint("f", "world", "flap"))
REFUSED = {
    "several roots": (TWO_ROOTS, {}, ["2 root links, world, trunk", "root="]),
    "several that move": ((*flying(), *SECOND), {}, ["2 links move on the ground, trunk, wing", "trunk or wing"]),
    "unknown root": (flying(), {"root": "trnk"}, ["unknown link 'trnk'", "did you mean 'trunk'"]),
    "no links": ((), {}, ["no links"]),
}


@pytest.mark.parametrize(("items", "options", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(tmp_path, items, options, words):
    path = robot_file(tmp_path, *items)
    refusal(lambda: jounce.load(path, base="floating", **options), *words, str(path))


def test_planar_joints_move_behind_the_base_and_on_the_ground(tmp_path):
    path = robot_file(tmp_path, *flying(), link("x", OTHER), joint("p", "arm", "x", "planar"))
    robot = jounce.load(path, base="floating")
    assert (robot.joint_names, robot.nq, robot.nv) == (("turn", "p.wz", "p.vx", "p.vy"), 12, 10)
    path = robot_file(tmp_path, *flying("planar"))
    robot = jounce.load(path)
    assert (robot.joint_names, robot.nq) == (("flight.wz", "flight.vx", "flight.vy", "turn"), 5)


def test_a_base_without_joints_is_a_free_joint_of_the_ground(tmp_path):
    robot = jounce.load(robot_file(tmp_path, *flying()), base="floating", root="lid")
    assert (robot.mechanism.floats, robot.body_names, robot.nq) == (False, ("lid",), 7)


def test_formats_without_an_inertia_of_the_base_stand(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(DH)
    refusal(lambda: jounce.load(path, base="floating"), str(path), "the inertia of the base")
    assert not jounce.load(path, base="fixed", massless_tips=True).mechanism.floats
    jounce.save(jounce.load("planar2r"), path)
    refusal(lambda: jounce.load(path, base="floating"), f"{path}:1: the robot stands on the ground", "'base'")


def test_a_base_without_inertia_is_said(tmp_path):
    """Forces are as they are; the mass matrix may be singular."""
    path = robot_file(tmp_path, link("trunk"), link("arm", BODY), TURN)
    with pytest.warns(jounce.JounceWarning, match="base 'trunk' has no inertia.*root="):
        assert not jounce.load(path, base="floating").mechanism.M[0].any()


def test_an_impossible_inertia_of_the_base_is_found(tmp_path):
    path = robot_file(tmp_path, link("trunk", ODD), link("arm", BODY), TURN)
    with pytest.warns(jounce.JounceWarning, match="1 of 2 bodies have a physically inconsistent inertia: trunk"):
        robot = jounce.load(path, base="floating")
    assert [f.bodies for f in robot.audit() if f.kind == "triangle inequality"] == [("trunk",)]


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_files_of_a_robot_that_floats_are_as_good_as_the_robot(tmp_path, suffix):
    robot = jounce.load(robot_file(tmp_path, *ROBOT, TURN), base="floating")
    path = tmp_path / f"robot{suffix}"
    jounce.save(robot, path)
    for options in ({}, {"base": "floating"}):
        same = jounce.load(path, **options)
        assert (same, parts(same)) == (robot, parts(robot))
    fixed = jounce.load(path, base="fixed").mechanism
    assert (fixed.floats, [(f.name, f.body) for f in fixed.frames]) == (False, [("trunk", -1), ("lid", -1)])
    assert jounce.Robot(replace(fixed, name="r")) == jounce.load(robot_file(tmp_path, *ROBOT, TURN))


OWN = """\
units: SI
base: {name: trunk, inertia: {mass: 9, com: [0, 0, 0.1], inertia: [0.1, 0, 0, 0.2, 0, 0.2]}}
bodies:
  - {name: arm, parent: trunk, joint: {name: turn, type: revolute, axis: [0, 0, 1]}}
frames:
  - {name: eye, body: trunk}
"""


@pytest.mark.parametrize(("old", "new", "words"), [
    ("parent: trunk", "parent: ground", [":4", "the robot floats", "unknown body 'ground'", "trunk, arm"]),
    ("name: arm", "name: trunk", [":4", "second body 'trunk'", ":2"]),
    ("name: eye", "name: trunk", [":6", "second frame 'trunk'"]),
    ("{name: trunk, ", "{name: ground, ", [":2", "it denotes the ground"]),
    ("{name: trunk, inertia", "{inertia", [":2", "has no 'name'"]),
    ("{name: trunk, ", "{name: trunk, pose: 3, ", [":2", "no key 'pose'"]),
    ("mass: 9", "mass: .nan", [":2", "mass", "finite number"]),
    ("{name: trunk, inertia", "floating # {", [":2", "base of the robot is 'floating'", "keys and values"]),
])  # fmt: skip
def test_a_bad_base_in_a_file_is_refused(tmp_path, old, new, words):
    path = tmp_path / "arm.yaml"
    assert old in OWN
    path.write_text(OWN.replace(old, new, 1))
    refusal(lambda: jounce.load(path), str(path), *words)


def test_locked_joints_merge_into_the_base(tmp_path):
    items = (*ROBOT, TURN, link("hand", OTHER), joint("bend", "arm", "hand", axis="1 0 0", inner=PLACED))
    robot = jounce.load(robot_file(tmp_path, *items), base="floating")
    held = robot.locked({"turn": 0.4})
    assert (held.body_names, held.mechanism.frame("arm").body) == (("trunk", "hand"), 0)
    rng = np.random.default_rng(1)
    base = (np.eye(4), *rng.normal(size=(2, 6)))
    q, qd, q2d = np.array([[0.4, 0.3], [0, 0.2], [0, -0.5]])
    Q = robot.inverse_dynamics(q, qd, q2d, base=base, method="recursion")
    ours = held.inverse_dynamics(q[1:], qd[1:], q2d[1:], base=base, method="recursion")
    assert relative_error(ours, np.delete(Q, 6)) < 1e-13


def test_a_robot_of_numbers_floats():
    rng = np.random.default_rng(2)
    M, M_base = random_inertia(rng, 2.0), random_inertia(rng, 5.0)
    data = [np.eye(4)], [[0, 0, 1, 0, 0, 0]], [M]
    for made in (jounce.Robot.from_screws, jounce.Robot.from_spatial_screws):
        robot = made(*data, base=M_base, base_name="trunk")
        assert robot == jounce.Robot(on_base(made(*data).mechanism, M_base, "trunk"))
        assert pickle.loads(pickle.dumps(robot)) == robot != made(*data)
        assert robot != made(*data, base=M_base) != made(*data, base=2 * M_base)
        refusal(lambda made=made: made(*data, base=np.eye(4)), "base has shape (4, 4)", "(6, 6)")
        refusal(lambda made=made: made(*data, base=M_base * np.nan), "base[0, 0] is nan", "finite")
        refusal(lambda made=made: made(*data, base=np.ones((6, 6))), "base", "an inertia matrix is")
        refusal(lambda made=made: made(*data, base=M_base, base_name="body1"), "base_name is 'body1'")
        refusal(lambda made=made: made(*data, base=M_base, base_name=3), "base_name is 3; expected a text")
    assert not robot.mechanism.M.flags.writeable


BODIES = """
<body name='trunk' pos='1 2 3' quat='.6 0 .8 0'>{free}<inertial pos='.1 .2 .3' quat='.8 .6 0 0' mass='3'
 diaginertia='.1 .2 .25'/><body name='lid' pos='0 .1 0'><geom size='.1'/></body>
 <body name='arm'><joint name='turn'/><geom size='.2' pos='.3 0 0'/></body></body>"""


def model_of_bodies(bodies):
    return mujoco.MjModel.from_xml_string(f"<mujoco model='m'><worldbody>{bodies}</worldbody></mujoco>")


def test_a_free_joint_of_mujoco_carries_the_base():
    """The frame is that of the body, not of its principal axes."""
    robot = jounce.Robot.from_mujoco(
        model_of_bodies("<geom size='9'/>" + BODIES.format(free="<freejoint/>")), base="floating"
    )
    turned = jounce.Robot.from_mujoco(model_of_bodies(BODIES.format(free="<joint axis='0 0 1' name='on'/>")))
    assert_floats(robot, "trunk", turned)
    assert [frame.name for frame in robot.mechanism.frames] == ["lid"]


def test_the_world_of_mujoco_does_not_float():
    model = model_of_bodies(BODIES.format(free=""))
    for options in ({}, {"root": "world"}):
        said = "'world' is the ground", "root="
        refusal(lambda options=options: jounce.Robot.from_mujoco(model, base="floating", **options), *said)
    assert jounce.Robot.from_mujoco(model, base="floating", root="trunk").body_names == ("trunk", "arm")


def test_drives_of_a_free_joint_are_said():
    model = model_of_bodies(BODIES.format(free="<joint type='free' armature='1'/>"))
    with pytest.warns(jounce.JounceWarning, match="armature, damping, friction and springs of the free joint"):
        jounce.Robot.from_mujoco(model, base="floating")


def test_a_free_flyer_of_pinocchio_carries_the_base():
    model = pinocchio.buildSampleModelHumanoid()
    robot = jounce.Robot.from_pinocchio(model, base="floating")
    Y = model.inertias[1]
    M = jounce.inertia_matrix(Y.mass, Y.lever, Y.inertia)
    np.testing.assert_allclose(robot.mechanism.M[0], M, rtol=0, atol=1e-14)
    assert robot.nv == model.nv
    refusal(lambda: jounce.Robot.from_pinocchio(model), "is floating", "base='floating'")
    still = pinocchio.buildSampleModelManipulator()
    refusal(lambda: jounce.Robot.from_pinocchio(still, base="floating"), "'universe' is the ground")
    model.armature[:6] = 0.1
    with pytest.warns(jounce.JounceWarning, match="armature of the free-flyer"):
        jounce.Robot.from_pinocchio(model, base="floating")


def test_commands_show_the_base(tmp_path):
    path = robot_file(tmp_path, *ROBOT, TURN)
    out = tmp_path / "robot.yaml"
    summary = json.loads(call("convert", path, "-o", out, "--base", "floating", "--json").stdout)
    assert (summary["base"], summary["nb"]) == ("trunk", 1)
    assert "floating on trunk, 1 coordinates" in call("convert", path, "-o", out, "--base", "floating").stdout
    lines = call("info", out).stdout.splitlines()
    assert lines[0].startswith("r: 1 coordinates, 2 bodies, 4.7 kg moving, floating, gravity")
    assert [line.split()[:5] for line in lines if "floating" in line][1:] == [["-", "floating", "-", "trunk", "-"]]
    data = json.loads(call("info", out, "--json").stdout)
    assert (data["base"]["name"], data["base"]["mass"]) == ("trunk", pytest.approx(2.7))
    assert (data["bodies"][0]["parent"], data["merged_links"]) == ("trunk", {"lid": "trunk"})
    assert json.loads(call("info", out, "--base", "fixed", "--json").stdout)["base"] is None
