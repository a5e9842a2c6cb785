"""jounce's own robot files: what they mean, and that nothing is lost on the way out and back, to the last bit."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import jounce
from jounce.io import documents, robot_writing
from jounce.model.frame import Frame
from support.commands import call
from support.refusals import expect_refusal, refusal, refused
from support.robots import GOLDEN_NAMES, floating, golden, mechanisms, parts, random_inertia, random_pose, with_tool

pytestmark = pytest.mark.filterwarnings("ignore::jounce.JounceWarning")  # of the inertias of the iiwa
ROOT = Path(__file__).parents[2]
PANDA = ROOT / "examples" / "panda.urdf"
SUFFIXES = (".yaml", ".yml", ".json")
ROBOTS = {
    **{name: lambda name=name: jounce.Robot(golden(name)[0]) for name in GOLDEN_NAMES},
    **{name: lambda name=name: jounce.load(name) for name in ("iiwa14", "planar2r", PANDA)},
}


def there_and_back(robot, folder, suffix=".yaml"):
    path = folder / f"robot{suffix}"
    jounce.save(robot, path)
    return jounce.load(path)


def loaded_text(folder, text, name="arm.yaml", **options):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return jounce.load(path, **options)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("name", ROBOTS)
def test_nothing_is_lost(tmp_path, name, suffix):
    robot = ROBOTS[name]()
    assert parts(there_and_back(robot, tmp_path, suffix)) == parts(robot)


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
@given(drawn=mechanisms())
def test_nothing_is_lost_of_any_tree(tmp_path_factory, suffix, drawn):
    """Helical joints, joints that follow, several roots, links merged into bodies and the ground, limits, a base."""
    robot, rng, _ = with_tool(drawn)
    fixed = robot.mechanism
    m = floating(fixed, rng) if rng.random() < 0.5 else fixed
    lower = np.where(rng.random(fixed.nb) < 0.5, rng.normal(size=fixed.nb), -np.inf)
    limits = {"lower": lower, "upper": lower + 1e3 * rng.random(fixed.nb), "effort": rng.random(fixed.nb) * 1e-8}
    limits["upper"] = np.where(np.isfinite(limits["upper"]), limits["upper"], np.inf)
    bounded = jounce.Robot.from_screws(fixed.B, fixed.X, fixed.M, fixed.parent, limits=limits).limits
    robot = jounce.Robot(replace(m, limits=bounded))
    assert parts(there_and_back(robot, tmp_path_factory.mktemp("t"), suffix)) == parts(robot)


NAMES = [
    "on", "null", "~", "1", "1e3", "0x1F", "1_000", "2026-11-21", ".nan", "", " a ", "a: b", "- a", "#", "'", '"', "<<",
    "ä 機械 😀", "a\nb", "tab\there", "\x07", "{x}", "&a", "*a", "!t", "%", "true", "\u2028", "x" * 3000,
]  # fmt: skip


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_names_of_any_kind_are_kept(tmp_path, suffix):
    n = len(NAMES)
    rows = np.eye(n)[:, ::-1] * 0.5
    robot = jounce.Robot.from_screws(
        [np.eye(4)] * n, [[0, 0, 1, 0, 0, 0]] * n, [np.eye(6)] * n, names=NAMES, joint_names=NAMES, G=rows, name="yes"
    )
    assert parts(there_and_back(robot, tmp_path, suffix)) == parts(robot)


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
@given(x=st.floats(allow_nan=False, allow_infinity=False), mass=st.floats(0, 1e300))
def test_numbers_of_any_size_are_kept(tmp_path_factory, suffix, x, mass):
    B = np.eye(4)
    B[0, 3] = x
    robot = jounce.Robot.from_screws([B], [[0, 0, 1, 0, 0, 0]], [mass * np.eye(6)], gravity=(x, -x, 0), g=[x])
    assert parts(there_and_back(robot, tmp_path_factory.mktemp("t"), suffix)) == parts(robot)


ARM = """\
name: arm
units: SI
gravity: [0, 0, -3.7]
bodies:
  - name: upper
    parent: ground
    pose: {position: [0, 0, 0.5], rpy: [0.1, -0.2, 0.3]}
    joint: {name: shoulder, type: revolute, axis: [0, 3, 4], point: [0.1, 0, 0], limits: {lower: -1, effort: 9}}
    inertia: {mass: 2, com: [0, 0, 0.1], inertia: [0.02, 0.001, 0, 0.03, 0, 0.01]}
  - name: screw
    parent: upper
    pose: {rotation: [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}
    joint: {name: lead, type: helical, axis: [0, 0, 1], point: [0, 0.2, 0], pitch: 0.01}
    inertia: {mass: 1, com: [0, 0, 0], inertia: [[1, 0, 0], [0, 2, 0], [0, 0, 2]], rotation: [[0, -1, 0], [1, 0, 0], [0, 0, 1]]}
  - name: slide
    parent: screw
    pose: {matrix: [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]}
    joint: {name: drawer, type: prismatic, axis: [-2, 0, 0], follows: {coordinates: {shoulder: 0.5, lead: 2}, offset: 0.1}}
  - name: spare
    parent: ground
    joint: {name: valve, screw: [0, 0, 1, 0.5, 0, 0.25]}
    inertia: {matrix: [[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 3, 0, 0], [0, 0, 0, 0, 3, 0], [0, 0, 0, 0, 0, 3]]}
coordinates: [valve, shoulder, lead]
frames:
  - {name: tool, body: slide, pose: {position: [0, 0, 1]}}
  - {name: floor, body: ground}
"""  # noqa: E501


def test_what_a_file_means(tmp_path):
    robot = loaded_text(tmp_path, ARM)
    m = robot.mechanism
    assert (m.name, m.parent, m.bodies) == ("arm", (-1, 0, 1, -1), ("upper", "screw", "slide", "spare"))
    assert (m.joints, m.coordinates) == (("shoulder", "lead", "drawer", "valve"), ("valve", "shoulder", "lead"))
    assert m.gravity.tolist() == [0, 0, -3.7]
    np.testing.assert_allclose(m.B[0][:3, :3], Rotation.from_euler("xyz", [0.1, -0.2, 0.3]).as_matrix(), atol=1e-15)
    assert m.B[0][:3, 3].tolist() == [0, 0, 0.5]
    assert m.B[1].tolist() == [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert m.B[2][:3].tolist() == [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3]]
    assert (m.B[3] == np.eye(4)).all()
    np.testing.assert_allclose(m.X[0], [0, 0.6, 0.8, 0, -0.08, 0.06], atol=1e-17)  # the axis has unit length
    np.testing.assert_allclose(m.X[1], [0, 0, 1, 0.2, 0, 0.01], atol=1e-17)
    assert m.X[2:].tolist() == [[0, 0, 0, -1, 0, 0], [0, 0, 1, 0.5, 0, 0.25]]
    expected = jounce.inertia_matrix(2, [0, 0, 0.1], [[0.02, 0.001, 0], [0.001, 0.03, 0], [0, 0, 0.01]])
    assert (m.M[0] == expected).all()
    assert (m.M[1] == np.diag([2.0, 1, 2, 1, 1, 1])).all()  # the COM frame is turned
    assert not m.M[2].any()
    assert (m.M[3] == np.diag([1.0, 1, 1, 3, 3, 3])).all()
    assert m.G.tolist() == [[0, 1, 0], [0, 0, 1], [0, 0.5, 2], [1, 0, 0]]
    assert m.g.tolist() == [0, 0, 0.1, 0]
    assert (m.limits.lower[0], m.limits.upper[0], m.limits.effort[0], m.limits.velocity[0]) == (-1, np.inf, 9, np.inf)
    assert [(f.name, f.body, f.T[2, 3]) for f in m.frames] == [("tool", 2, 1), ("floor", -1, 0)]
    assert parts(there_and_back(robot, tmp_path)) == parts(robot)


def test_defaults_and_the_gravity_of_the_caller(tmp_path):
    text = "units: SI\nbodies: [{name: a, parent: ground, joint: {name: j, type: prismatic, axis: [1, 0, 0]}}]\n"
    robot = loaded_text(tmp_path, text, "cart.yml")
    assert (robot.name, robot.gravity.tolist()) == ("cart", [0, 0, -9.81])
    assert loaded_text(tmp_path, ARM, gravity=(1, 2, 3)).gravity.tolist() == [1, 2, 3]
    refusal(lambda: loaded_text(tmp_path, ARM, gravity=[0, 1]), "arm.yaml: gravity", "(2,)", "(3,)")


def test_anchors_spare_repetition(tmp_path):
    text = ARM.replace("[0, 0, 0.5]", "&up [0, 0, 0.5]").replace("position: [0, 0, 1]", "position: *up")
    assert loaded_text(tmp_path, text).mechanism.frames[0].T[2, 3] == 0.5


def test_files_are_pleasant_to_read(tmp_path):
    """Forms for people wherever they read back the same; vectors on a line, whole numbers without a point."""
    text = robot_writing.yaml_text(jounce.load("iiwa14").mechanism)
    start = """\
name: iiwa14
units: SI
gravity: [0, 0, -9.80665]
bodies:
  - name: link1
    parent: ground
    joint:
      name: joint1
      type: revolute
      axis: [0, 0, 1]
    inertia:
      mass: 3.94781
      com: [-0.00351, 0.0016, -0.03139]
      inertia: [0.00455, 0, 0, 0.00454, 1e-05, 0.00029]
  - name: link2
    parent: link1
    pose:
      rotation:
        - [1, 0, 0]
        - [0, 0, -1]
        - [0, 1, 0]
"""
    assert text.startswith(start)
    mechanism = jounce.load(PANDA).mechanism
    panda = robot_writing.yaml_text(mechanism)
    assert "matrix" not in text
    exact = [body["name"] for body in robot_writing.document(mechanism)["bodies"] if "matrix" in body["inertia"]]
    assert {*exact} <= {"panda_link7"}  # links were merged into it, which may take all digits of the matrix
    assert "      limits: {lower: -2.8973, upper: 2.8973, velocity: 2.175, effort: 87}\n" in panda
    assert "        coordinates: {panda_finger_joint1: 1}\n" in panda
    assert "      com: [0.003875, 0.002081, -0.04762]\n" in panda


def test_exact_forms_stand_in_where_others_would_lose_digits(tmp_path):
    rng = np.random.default_rng(0)
    M = random_inertia(rng, 1.7) @ np.diag([1, 1, 1, 1, 1, 1])
    M[:3, :3] = np.diag([1e-20, 1, 1])
    X = [0.6, 0.8, 0, 0.1, 0.2, 0.3]
    robot = jounce.Robot.from_screws([random_pose(rng)], [X], [M])
    [body] = robot_writing.document(robot.mechanism)["bodies"]
    assert list(body["inertia"]) == ["matrix"]
    assert parts(there_and_back(robot, tmp_path)) == parts(robot)


ODD = {  # masses and scales that no COM is computed from, nor any warning
    "massless with moments": np.diag([1.0, 2, 2, 0, 0, 0]),
    "negative": -np.eye(6),
    "tiny": jounce.inertia_matrix(1e-310, [0.3, 0.1, 0.2], 1e-320 * np.eye(3)),
    "light far away": jounce.inertia_matrix(1e-300, [1e10, 0, 0], np.eye(3)),
    "huge": jounce.inertia_matrix(1e300, [1e3, 0, 0], 1e307 * np.eye(3)),
    "unlike": jounce.inertia_matrix(1e-7, [1e-6, 3.0, 1e-12], np.diag([1e-9, 1e-3, 1e-3])),
}


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
@pytest.mark.parametrize("M", ODD.values(), ids=ODD)
def test_odd_inertias_are_kept(tmp_path, M, suffix):
    mechanism = jounce.Robot.from_screws([np.eye(4)], [[0, 0, 1, 0, 0, 0]], [M]).mechanism
    path = tmp_path / f"arm{suffix}"
    jounce.save(jounce.Robot(mechanism), path)
    assert documents.read(path).M.tobytes() == mechanism.M.tobytes()


def test_a_robot_of_symbols_is_not_written(tmp_path):
    L = sympy.Symbol("L")
    path = tmp_path / "arm.yaml"
    with expect_refusal("'planar2r' contains symbols in", "a robot file needs num"):
        jounce.save(jounce.load("planar2r", L1=L), path)
    assert list(tmp_path.iterdir()) == []


def test_what_no_file_can_say_is_refused(tmp_path):
    one = {"B": [np.eye(4)], "X": [[0, 0, 1, 0, 0, 0]], "M": [np.eye(6)]}
    path = tmp_path / "arm.json"
    refusal(lambda: jounce.save(jounce.Robot.from_screws(**one, names=["ground"]), path), "'ground'", "rename the body")
    refusal(lambda: jounce.save(jounce.Robot.from_screws(**one, names=["\ud800"]), path), "arm.json", "name")
    refusal(lambda: jounce.save("iiwa14", path), "save() expects a jounce.Robot, got str")
    long = jounce.Robot.from_screws(**one, g=np.array([1], dtype=np.longdouble) / 3)
    refusal(lambda: jounce.save(long, path), "g of robot", "doubles")
    assert list(tmp_path.iterdir()) == []


SAVES = {
    "arm.urdf": ["'.urdf'", ".yaml, .yml, .json"],
    "arm": ["arm: ", ".yaml, .yml, .json"],
    "no/arm.yaml": ["no folder"],
    "folder.json": ["not a file"],
    3: ["save() expects a path, got int"],
}


@pytest.mark.parametrize(("path", "words"), SAVES.items(), ids=str)
def test_save_refuses(tmp_path, monkeypatch, path, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.json").mkdir()
    refusal(lambda: jounce.save(jounce.load("planar2r"), path), *words)
    assert [item.name for item in tmp_path.rglob("*")] == ["folder.json"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_convert(tmp_path, suffix):
    out = tmp_path / f"arm{suffix}"
    result = call("convert", PANDA, "-o", out)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout == f"panda: 8 coordinates, 9 bodies, 4 merged links written to {out}\n"
    assert parts(jounce.load(out)) == parts(jounce.load(PANDA))
    back = tmp_path / "back.yaml"
    summary = json.loads(call("convert", out, "-o", back, "--json").stdout)
    expected = {"robot": "panda", "source": str(out), "output": str(back), "n": 8, "nb": 9, "base": None, "frames": 4}
    assert summary == expected | {"nq": 8, "nv": 8, "joints": {}}
    assert parts(jounce.load(back)) == parts(jounce.load(PANDA))
    assert call("info", out).stdout == call("info", PANDA).stdout


def test_the_command_of_the_help_works(tmp_path):
    script = Path(sys.executable).with_name("jounce")
    shown = subprocess.run([script, "convert", "--help"], capture_output=True, text=True, timeout=60, check=True)
    assert max(map(len, shown.stdout.splitlines())) <= 80
    assert "jounce convert iiwa14 -o arm.yaml" in shown.stdout
    done = subprocess.run([script, "convert", "iiwa14", "-o", "arm.yaml"], cwd=tmp_path, timeout=60, check=True)
    assert done.returncode == 0
    assert parts(jounce.load(tmp_path / "arm.yaml")) == parts(jounce.load("iiwa14"))


REFUSED = {
    "folder missing, said before the robot is read": ("convert no.urdf -o no/arm.yaml", ["no folder 'no'"]),
    "folder not writable": ("convert iiwa14 -o shut/arm.yaml", ["shut/arm.yaml", "not writable"]),
    "other type": ("convert iiwa14 -o arm.urdf", ["'.urdf'", ".yaml, .yml, .json"]),
    "itself": ("convert arm.yaml -o ./arm.yaml", ["the output file is the input file"]),
    "itself by a link": ("convert arm.yaml -o link.yaml", ["the output file is the input file"]),
    "robot missing": ("convert no.urdf -o out.yaml", ["no.urdf: no such file"]),
    "robot broken": ("convert bad.yaml -o out.yaml", ["bad.yaml:2", "did you mean 'bodies'"]),
}


@pytest.mark.parametrize(("asked", "words"), REFUSED.values(), ids=REFUSED)
def test_convert_refuses_in_one_line_and_leaves_nothing_behind(tmp_path, monkeypatch, asked, words):
    (tmp_path / "shut").mkdir(mode=0o500)
    monkeypatch.setattr("os.access", lambda path, mode: Path(path).name != "shut")  # root may write everywhere
    (tmp_path / "arm.yaml").write_text(ARM)
    (tmp_path / "link.yaml").symlink_to("arm.yaml")
    (tmp_path / "bad.yaml").write_text("units: SI\nbodys: []\n")
    refused(tmp_path, asked, *words)


def test_a_failed_save_leaves_the_older_file(tmp_path, monkeypatch):
    path = tmp_path / "arm.yaml"
    path.write_text("old")
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    refusal(lambda: jounce.save(jounce.load("iiwa14"), path), "arm.yaml: cannot be written: No space left")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_frames_come_back_where_they_were(tmp_path):
    """Also those whose rotation is not exact to the last digit, as products of many are."""
    m = jounce.load("iiwa14").mechanism
    T = random_pose(np.random.default_rng(2))
    robot = jounce.Robot(replace(m, frames=(Frame("tool", 6, T),)))
    assert parts(there_and_back(robot, tmp_path)) == parts(robot)
