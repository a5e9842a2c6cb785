"""What becomes of robots for skidy: their forces and rates are those of skidy itself, and `load` names the script.

golden/skidy/forces.json holds what skidy 0.0.1 made of the files beside it; generate.py there wrote it. They state what
its documentation names: chains and a tree, spatial and body-fixed, each way of writing a pose and an inertia.
"""

import json
import re
import runpy
import sys

import numpy as np
import pytest

import jounce
from support.refusals import refusal
from support.robots import GOLDEN, relative_error

pytest.importorskip("sympy")
ROOT, HERE = GOLDEN.parents[1], GOLDEN / "skidy"
FORCES = json.loads((HERE / "forces.json").read_text())
WEE = [0.3, -0.5, 0.7, 2.0, -1.0, 3.0]  # that of generate.py, on the last body of the files that name it


@pytest.fixture
def converted(tmp_path, monkeypatch):
    def convert(source):
        target = tmp_path / "of-jounce.yaml"
        monkeypatch.setattr(sys, "argv", ["skidy_to_jounce.py", str(source), str(target)])
        runpy.run_path(str(ROOT / "examples/skidy_to_jounce.py"))
        return jounce.load(target)

    return convert


@pytest.mark.parametrize("name", FORCES)
def test_forces_are_those_of_skidy(converted, name):
    robot, case = converted(HERE / f"{name}.yaml"), FORCES[name]
    W = np.zeros((3, robot.n, 6))
    W[0, -1] = WEE if "Mx" in (HERE / f"{name}.yaml").read_text() else 0
    for rate, expected in zip(robot.inverse_dynamics(*case["state"], wrench=tuple(W)), case["Q"], strict=True):
        assert relative_error(rate, expected) < 1e-13
    np.testing.assert_allclose(robot.poses(case["state"][0]), case["poses"], atol=1e-14)


def test_names_tree_and_end_effectors(converted):
    tree = converted(HERE / "tree4.yaml")
    assert (tree.name, tree.mechanism.parent, tree.joint_names) == ("tree4", (-1, 0, 0, 2), ("q1", "q2", "q3", "q4"))
    assert [(frame.name, frame.body) for frame in tree.mechanism.frames] == [("ee1", 1), ("ee2", 3)]
    assert tree.mechanism.frame("ee2").T[2, 3] == 0.25
    [ee] = converted(HERE / "spatial3r.yaml").mechanism.frames
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
  - {mass: 2, frame: com, inertia: 0.1, com: [0, 0, 0.3]}
  - {mass: 1, inertia: [1, 0, 0, 1, 0, 1], com: [0, 0, 0.1]}
parent:
child:
support:
q: [a, b]
assignments:
  L: 0.5
"""


def test_a_short_file_and_its_json(converted, tmp_path):
    """What skidy leaves empty of a chain is one; a frame that is left out is that of the last body which states one."""
    document = {
        "gravity_vector": [0, 0, "-9.81"],
        "joint_screw_coord": [[0, 0, 1, 0, 0, 0], ["0", "1", "0", "0", "0", "L"]],
        "body_ref_config": [{"translation": [0, 0, "1/2"]}, {"rotation": {"rpy": [0, 0, "pi/2"]}}],
        "mass_inertia": [
            {"mass": 2, "frame": "com", "inertia": "1/10", "com": [0, 0, 0.3]},
            {"mass": 1, "frame": "com", "inertia": {"Ixx": 1, "Iyy": 1, "Izz": 1}, "com": [0, 0, 0.1]},
        ],
        "ee": [{"xyzrpy": [0, 0, 1, 0, 0, 0]}],
        "assignments": {"L": 0.5},
    }
    (tmp_path / "arm.yaml").write_text(GOOD)
    (tmp_path / "arm.json").write_text(json.dumps(document))
    robot, same = converted(tmp_path / "arm.yaml"), converted(tmp_path / "arm.json")
    for label in ("B", "X", "M", "gravity"):
        np.testing.assert_allclose(getattr(same.mechanism, label), getattr(robot.mechanism, label), atol=1e-16)
    assert (robot.joint_names, same.joint_names) == (("a", "b"), ("joint1", "joint2"))
    assert robot.mechanism.parent == (-1, 0)
    np.testing.assert_array_equal(robot.mechanism.frame("ee").T, same.mechanism.frame("ee").T)


def test_a_symbol_without_a_number_is_an_error(converted, tmp_path):
    (tmp_path / "arm.yaml").write_text(GOOD.replace("mass: 2", "mass: m1"))
    with pytest.raises(TypeError):
        converted(tmp_path / "arm.yaml")


def test_load_names_the_script():
    path = HERE / "tree4.yaml"
    message = refusal(lambda: jounce.load(path), f"{path}:2: ", "skidy")
    assert (ROOT / re.search(r"examples/\w+\.py", message)[0]).is_file()
