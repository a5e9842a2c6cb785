"""skidy's descriptions of robots: the forces and their rates are those of skidy itself, and what is none is refused.

golden/skidy/forces.json holds what skidy 0.0.1 made of the files beside it; generate.py there wrote it. They state what
its documentation names: chains and a tree, spatial and body-fixed, each way of writing a pose and an inertia.
"""

import json
import math

import numpy as np
import pytest
from files import refusal
from robots import GOLDEN, relative_error

import jounce
from jounce.io.skidy import expressions

HERE = GOLDEN / "skidy"
FORCES = json.loads((HERE / "forces.json").read_text())
WEE = [0.3, -0.5, 0.7, 2.0, -1.0, 3.0]  # that of generate.py, on the last body of the files that name it


def load(folder, text, name="arm.yaml", **options):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return jounce.load(path, **options)


@pytest.mark.parametrize("name", FORCES)
def test_forces_are_those_of_skidy(name):
    robot, case = jounce.load(HERE / f"{name}.yaml"), FORCES[name]
    W = np.zeros((3, robot.n, 6))
    W[0, -1] = WEE if "Mx" in (HERE / f"{name}.yaml").read_text() else 0
    for rate, expected in zip(robot.inverse_dynamics(*case["state"], wrench=tuple(W)), case["Q"], strict=True):
        assert relative_error(rate, expected) < 1e-13
    np.testing.assert_allclose(robot.poses(case["state"][0]), case["poses"], atol=1e-14)


def test_names_tree_and_end_effectors():
    tree = jounce.load(HERE / "tree4.yaml")
    assert (tree.name, tree.mechanism.parent, tree.joint_names) == ("tree4", (-1, 0, 0, 2), ("q1", "q2", "q3", "q4"))
    assert [(frame.name, frame.body) for frame in tree.mechanism.frames] == [("ee1", 1), ("ee2", 3)]
    assert tree.mechanism.frame("ee2").T[2, 3] == 0.25
    [ee] = jounce.load(HERE / "spatial3r.yaml").mechanism.frames
    assert (ee.name, ee.body) == ("ee", 2)
    np.testing.assert_allclose(ee.T, [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0.1], [0, 0, 0, 1]], atol=1e-15)


GOOD = """\
gravity: [0, 0, -9.81]
joint_screw_coord:
  - [0, 0, 1, 0, 0, 0]
  - {type: revolute, axis: [0, 1, 0], vec: [L, 0, 0]}
body_ref_config:
  - translation: [0, 0, 1/2]
  - {rotation: {axis: [0, 0, 1], angle: pi/2}}
ee: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]]
mass_inertia:
  - {mass: 2, inertia: 0.1, com: [0, 0, 0]}
  - {mass: 1, frame: com, inertia: [1, 0, 0, 1, 0, 1], com: [0, 0, 0.1]}
parent: [0, 1]
q: [a, b]
assignments:
  L: 0.5
"""


def test_a_short_file_and_its_json(tmp_path):
    robot = load(tmp_path, GOOD)
    document = {
        "gravity_vector": [0, 0, "-9.81"],
        "joint_screw_coord": [[0, 0, 1, 0, 0, 0], ["0", "1", "0", "0", "0", "L"]],
        "body_ref_config": [{"translation": [0, 0, "1/2"]}, {"rotation": {"rpy": [0, 0, "pi/2"]}}],
        "mass_inertia": [
            {"mass": 2, "inertia": "1/10", "com": [0, 0, 0]},
            {"mass": 1, "frame": "com", "inertia": {"Ixx": 1, "Iyy": 1, "Izz": 1}, "com": [0, 0, 0.1]},
        ],
        "assignments": {"L": 0.5},
    }
    same = load(tmp_path, json.dumps(document), "arm.json")
    for label in ("B", "X", "M", "gravity"):
        np.testing.assert_allclose(getattr(same.mechanism, label), getattr(robot.mechanism, label), atol=1e-16)
    assert (robot.joint_names, same.joint_names) == (("a", "b"), ("joint1", "joint2"))
    empty = GOOD.replace("parent: [0, 1]", "parent:\nchild:\nsupport:")  # as skidy writes a chain
    assert load(tmp_path, empty).mechanism.parent == robot.mechanism.parent == (-1, 0)
    assert load(tmp_path, GOOD, gravity=(1, 2, 3)).gravity.tolist() == [1, 2, 3]


CHANGED = {  # what is replaced, by what, the line of the refusal, its words
    "symbol": ("mass: 2", "mass: m1", 10, ["mass of entry 1 of mass_inertia", "'m1'", "has no value", "L"]),
    "symbol within": ("L, 0, 0]", "2*l1, 0, 0]", 4, ["entry 1 of vec", "'2*l1'", "'l1'", "symbols with values: L"]),
    "code": ("1/2]", "__import__('os').getcwd()]", 6, ["entry 3 of translation", "expected a number"]),
    "method": ("1/2]", "(1).real]", 6, ["operators are + - * / **", "sqrt"]),
    "division by zero": ("1/2]", "1/0]", 6, ["'1/0'", "expected a finite number"]),
    "power": ("1/2]", "9**9**9**9]", 6, ["expected a finite number"]),
    "complex": ("1/2]", "sqrt(-1)]", 6, ["expected a finite number"]),
    "no expression": ("1/2]", "1/]", 6, ["expected a finite number, or an expression of one"]),
    "nested": ("1/2]", "(" * 400 + "1" + ")" * 400 + "]", 6, ["expected a finite number, or an expression"]),
    "signs": ("1/2]", "+" * 4000 + "1]", 6, ["at most 1000 characters"]),
    "symbol of a symbol": ("  L: 0.5", "  L: l1", 15, ["L of assignments", "'l1'; expected a finite number"]),
    "key": ("joint_screw_coord", "joint_screw_cord", 2, ["'joint_screw_cord'; did you mean 'joint_screw_coord'"]),
    "other key": ("parent:", "parents:", 12, ["'parents'; did you mean 'parent'"]),
    "no inertias": ("mass_inertia:\n", "ee_parent:\n", 1, ["the robot has no 'mass_inertia'"]),
    "one pose": ("  - translation: [0, 0, 1/2]\n", "", 1, ["2 of joint_screw_coord, 1 of body_ref_config"]),
    "screw of five": ("[0, 0, 1, 0, 0, 0]", "[0, 0, 1, 0, 0]", 3, ["entry 1 of joint_screw_coord", "6 numbers"]),
    "no unit axis": ("axis: [0, 1, 0]", "axis: [0, 2, 0]", 4, ["entry 2 of joint_screw", "not a unit screw"]),
    "joint type": ("revolute", "helical", 4, ["unknown joint type 'helical'", "revolute, prismatic"]),
    "vec of a slide": ("revolute", "prismatic", 4, ["entry 2 of joint_screw_coord", "has no key 'vec'"]),
    "axis not of unit length": ("axis: [0, 0, 1]", "axis: [0, 0, 3]", 7, ["entry 2 of body_ref", "R^T R"]),
    "quaternion": ("{axis: [0, 0, 1], angle: pi/2}", "{Q: [1, 1, 0, 0]}", 7, ["entry 2 of body_ref", "R^T R"]),
    "angle alone": ("axis: [0, 0, 1], ", "", 7, ["rotation of entry 2", "no 'axis'"]),
    "two rotations": ("angle: pi/2", "rpy: [0, 0, 0]", 7, ["both 'rpy' and 'axis'"]),
    "frame": ("frame: com", "frame: COM", 11, ["'COM'; expected body or com"]),
    "rotation about the origin": ("frame: com", "rotation: {rpy: [0, 0, 0]}", 11, ["requires frame: com"]),
    "symbols for moments": ("inertia: 0.1", "inertia: {index: 1}", 10, ["inertia of", "no key 'index'", "Ixx"]),
    "tree without support": ("[0, 1]", "[0, 0]", 12, ["a tree without 'support'", "chain"]),
    "support of another tree": ("[0, 1]", "[0, 1]\nsupport: [[1], [2]]", 13, ["support", "[[1], [1, 2]]"]),
    "parent after child": ("[0, 1]", "[2, 1]", 12, ["entry 1 of parent", "is 2", "0 .. 0"]),
    "parent as a text": ("[0, 1]", "[world, 1]", 12, ["'world'; expected the whole number"]),
    "parents too few": ("[0, 1]", "[0]", 12, ["parent of the robot", "2 numbers, one per body"]),
    "symbol twice": ("[a, b]", "[a, a]", 13, ["q of the robot", "2 different symbols"]),
    "expression for a symbol": ("[a, b]", "[a, 2*a]", 13, ["2 different symbols"]),
    "load": ("q: [a, b]", "WEE: [0, 0, 0, 0, 0, 5]", 13, ["entry 6 of WEE", "is 5", "wrench="]),
    "representation": ("gravity:", "representation: body\ngravity:", 1, ["'body'; expected spatial or body_fixed"]),
    "gravity twice": ("gravity:", "gravity_vector: [0, 0, 0]\ngravity:", 1, ["both 'gravity_vector' and 'gravity'"]),
    "body of the ee": ("q: [a", "ee_parent: 3\nq: [a", 13, ["ee_parent", "is 3; expected the whole", "1 .. 2"]),
    "bodies of the ee": ("q: [a", "ee_parent: [1, 2]\nq: [a", 13, ["1 bodies, one for each of ee"]),
}  # fmt: skip


def test_the_changed_file_is_good(tmp_path):
    assert load(tmp_path, GOOD).n == 2


@pytest.mark.parametrize(("old", "new", "line", "words"), CHANGED.values(), ids=CHANGED)
def test_refuses(tmp_path, old, new, line, words):
    assert old in GOOD
    text = GOOD.replace(old, new, 1)
    message = refusal(lambda: load(tmp_path, text), *words)
    assert message.startswith(f"{tmp_path / 'arm.yaml'}:{line}: ")


def test_a_frame_left_out_after_com_is_refused(tmp_path):
    """skidy lets the `frame: com` of one body stand for the bodies after it."""
    text = GOOD.replace("mass: 2,", "mass: 2, frame: com,").replace("mass: 1, frame: com,", "mass: 1,")
    refusal(lambda: load(tmp_path, text), "arm.yaml:11: entry 2 of mass_inertia", "no 'frame'")


VALUES = {
    "1e-3": 1e-3,
    " -sqrt(2)/2 ": -math.sqrt(2) / 2,
    "2**-1": 0.5,
    "-2**2": -4,
    "atan2(1, L)*cos(pi)": -math.atan2(1, 0.5),
    "m1*L**2/12": 3 * 0.25 / 12,
    "E": math.e,
    ".5 + L - +1": 0,
}


@pytest.mark.parametrize("text", VALUES)
def test_expressions(text):
    assert expressions.value(text, {"L": 0.5, "m1": 3}) == pytest.approx(VALUES[text], rel=1e-15)


NONE = (
    "", "pi()", "f(1)", "sin", "sin()", "L.real", "True", "'1'", "[1]", "1j", "a=1", "lambda: 1", "1 if 1 else 2",
    "1e999", "log(0)", "2^3", "3!", "\0", "sin(x=1)", "sqrt(*[1])",
)  # fmt: skip


@pytest.mark.parametrize("text", NONE)
def test_what_is_no_expression(text):
    refusal(lambda: expressions.value(text, {"L": 0.5}), "number")
