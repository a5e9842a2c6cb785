"""Denavit-Hartenberg tables in YAML and JSON: what they mean, and each that is none refused with its line."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jounce
from support.refusals import refusal

pytestmark = pytest.mark.filterwarnings("ignore:.*bodies without mass")  # files of kinematics alone

GOOD = """\
name: lifted
units: SI
angles: deg
convention: modified
gravity: [0, 0, -3.7]
base: {position: [0, 0, 0.3], rpy: [0, 0, 90]}
dh:
  - name: rail
    type: prismatic
    a: 0.1
    alpha: 0
    d: 0.2
    theta: -90
  - name: turn
    body: arm
    a: 0.5
    alpha: 30
    d: 0.1
    theta: 45
    limits: {lower: -170, upper: 170, velocity: 180, effort: 9}
    drive: {damping: 0.5, rest: 90, stiffness: 2}
    inertia: {mass: 2, com: [0, 0, 0.1], inertia: [0.02, 0, 0, 0.02, 0, 0.01]}
tool: {position: [0, 0, 0.1], rpy: [180, 0, 0]}
"""
DOCUMENT = {
    "units": "SI",
    "angles": "rad",
    "convention": "standard",
    "dh": [{"a": 0.5, "alpha": 1.5, "d": 0.1, "theta": 0.3, "limits": {"lower": -1}, "drive": {"friction": 1.0}}],
}


def load_text(folder, text, name="arm.yaml", **options):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return jounce.load(path, **options)


def test_what_a_file_means(tmp_path):
    robot = load_text(tmp_path, GOOD)
    assert (robot.name, robot.joint_names, robot.body_names) == ("lifted", ("rail", "turn"), ("body1", "arm"))
    assert robot.gravity.tolist() == [0, 0, -3.7]
    limits, drives = robot.limits, robot.drives
    np.testing.assert_allclose(limits.upper, [np.inf, np.radians(170)])
    np.testing.assert_allclose(limits.velocity, [np.inf, np.pi])
    assert limits.effort.tolist() == [np.inf, 9]
    np.testing.assert_allclose([drives.rest[1], drives.damping[1], drives.stiffness[1]], [np.pi / 2, 0.5, 2])
    assert len(set(drives.eps)) == 1  # nothing is stated: the same, whatever the angles
    base = np.eye(4)
    base[:3, :3], base[:3, 3] = Rotation.from_euler("z", 90, degrees=True).as_matrix(), [0, 0, 0.3]
    tool = np.diag([1.0, -1, -1, 1])
    tool[2, 3] = 0.1
    M = [np.zeros((6, 6)), jounce.inertia_matrix(2, [0, 0, 0.1], np.diag([0.02, 0.02, 0.01]))]
    rows = [[0.1, 0, 0.2, -90], [0.5, 30, 0.1, 45]]
    types = ["prismatic", "revolute"]
    same = jounce.Robot.from_dh(rows, M, "modified", types=types, degrees=True, base=base, tool=tool)
    for label in ("B", "X", "M"):
        np.testing.assert_allclose(getattr(robot.mechanism, label), getattr(same.mechanism, label), atol=1e-15)
    np.testing.assert_allclose(robot.poses([0.1, 2], body="tool"), same.poses([0.1, 2], body="tool"), atol=1e-15)


def test_json_in_radians(tmp_path):
    robot = load_text(tmp_path, json.dumps(DOCUMENT), "arm.json", gravity=(0, 0, 0))
    same = jounce.Robot.from_dh([[0.5, 1.5, 0.1, 0.3]], [np.zeros((6, 6))], "standard").mechanism
    assert (robot.mechanism.B == same.B).all()
    assert (robot.limits.lower[0], robot.drives.friction[0], robot.name) == (-1, 1, "arm")
    assert not robot.gravity.any()


def test_it_goes_out_as_a_file_of_our_own(tmp_path):
    robot = load_text(tmp_path, GOOD)
    jounce.save(robot, tmp_path / "own.yaml")
    same = jounce.load(tmp_path / "own.yaml")
    assert (same.mechanism.B == robot.mechanism.B).all()
    assert same.mechanism.frame("tool").body == 1


CHANGED = {  # what is replaced, by what, the line of the refusal, its words
    "no units": ("units: SI\n", "", 1, ["the robot has no 'units'"]),
    "other units": ("SI", "mm", 2, ["units of the robot is 'mm'", "SI: m, kg, s, rad"]),
    "no angles": ("angles: deg\n", "", 1, ["the robot has no 'angles'"]),
    "angles misspelt": ("deg", "degree", 3, ["unknown angles of the robot 'degree'; did you mean 'deg'", "rad, deg"]),
    "name as a number": ("name: lifted", "name: 3", 1, ["name of the robot is 3; expected a text"]),
    "no convention": ("convention: modified\n", "", 1, ["the robot has no 'convention'"]),
    "unknown convention": ("modified", "craig", 4, ["unknown convention of the robot 'craig'", "standard, modified"]),
    "unknown key": ("base:", "bas:", 6, ["the robot has no key 'bas'; did you mean 'base'"]),
    "parameter left out": ("    d: 0.2\n", "", 8, ["entry 1 of dh", "has no 'd'", "a, alpha, d, theta"]),
    "parameter misspelt": ("alpha: 30", "alhpa: 30", 17, ["entry 2 of dh", "'alhpa'; did you mean 'alpha'"]),
    "parameter as a text": ("alpha: 30", "alpha: pi/6", 17, ["alpha of joint 'turn' is 'pi/6'", "finite number"]),
    "not finite": ("d: 0.2", "d: .inf", 12, ["d of joint 'rail' is inf"]),
    "unknown type": ("prismatic", "P", 9, ["unknown type of joint 'rail' 'P'", "revolute, prismatic"]),
    "joint named twice": ("name: turn", "name: rail", 14, ["'rail'; expected another name", "joint of row 1"]),
    "body named twice": ("body: arm", "body: body1", 15, ["'body1'; expected another name", "body of row 1"]),
    "limits crossed": ("lower: -170", "lower: 171", 20, ["joint 'turn'", "expected lower <= upper"]),
    "negative damping": ("damping: 0.5", "damping: -1", 21, ["joint 'turn'", "damping is -1"]),
    "no mass": ("mass: 2, ", "", 22, ["inertia of joint 'turn'", "no 'mass'"]),
    "tool of no pose": ("rpy: [180, 0, 0]", "rpy: [180, 0]", 23, ["rpy of tool of the robot", "3 numbers"]),
    "tool as a body": ("body: arm", "body: tool", None, ["a body is named 'tool'"]),
    "bodies too": ("dh:\n", "bodies: []\ndh:\n", 3, ["the robot has no key 'angles'", "bodies"]),
}


@pytest.mark.parametrize(("old", "new", "line", "words"), CHANGED.values(), ids=CHANGED)
def test_refuses(tmp_path, old, new, line, words):
    assert old in GOOD
    place = f"arm.yaml:{line}: " if line else "arm.yaml: "
    message = refusal(lambda: load_text(tmp_path, GOOD.replace(old, new, 1)), *words)
    assert message.startswith(str(tmp_path / place))


@pytest.mark.parametrize("rows", ["[]", "3", "[[0, 0, 0, 0]]", ""], ids=["none", "a number", "numbers", "nothing"])
def test_refuses_rows(tmp_path, rows):
    text = GOOD[: GOOD.index("dh:")] + f"dh: {rows}\n"
    refusal(lambda: load_text(tmp_path, text), "arm.yaml:7: ", "dh of the robot", "expected")
