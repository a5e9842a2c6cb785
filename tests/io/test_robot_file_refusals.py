"""Robot files that are none: each refused in one line that names the file, the line, what came and what there is."""

import json
import time

import pytest

import jounce
from support.refusals import refusal

pytestmark = pytest.mark.filterwarnings("ignore:.*bodies without mass")  # files of kinematics alone

GOOD = """\
name: arm
units: SI
gravity: [0, 0, -9.81]
bodies:
  - name: upper
    parent: ground
    pose: {position: [0, 0, 1], rpy: [0, 0, 0]}
    joint:
      name: shoulder
      type: revolute
      axis: [0, 0, 1]
      limits: {lower: -1, upper: 1, velocity: 2, effort: 3}
    inertia: {mass: 2, com: [0, 0, 0.1], inertia: [0.02, 0, 0, 0.02, 0, 0.01]}
  - name: lower
    parent: upper
    pose: {position: [0, 0, 1]}
    joint: {name: elbow, type: helical, axis: [1, 0, 0], pitch: 0.1, follows: {coordinates: {shoulder: 2}, offset: 1}}
coordinates: [shoulder]
frames:
  - {name: tool, body: lower, pose: {position: [0, 0, 1]}}
"""
I4 = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
TYPE = "      type: revolute\n      axis: [0, 0, 1]\n"
INERTIA = "{mass: 2, com: [0, 0, 0.1], inertia: [0.02, 0, 0, 0.02, 0, 0.01]}"
M = "[[1, 5, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 1]]"  # noqa: E501

CHANGED = {  # what is replaced, by what, the line of the refusal, its words
    "unknown key": ("gravity:", "gravty:", 3, ["the robot has no key 'gravty'; did you mean 'gravity'"]),
    "unknown key of a body": ("    parent: upper", "    parnt: upper", 15, ["entry 2", "did you mean 'parent'"]),
    "unknown key of a pose": ("rpy: [0", "ryp: [0", 7, ["pose of body 'upper'", "did you mean 'rpy'"]),
    "unknown key of a joint": ("axis: [0,", "axes: [0,", 11, ["joint 'shoulder'", "did you mean 'axis'"]),
    "unknown key of limits": ("effort:", "efort:", 12, ["limits of joint 'shoulder'", "did you mean 'effort'"]),
    "unknown key of an inertia": ("mass:", "mas:", 13, ["inertia of body 'upper'", "did you mean 'mass'"]),
    "unknown key of follows": ("offset:", "offst:", 17, ["follows of joint 'elbow'", "did you mean 'offset'"]),
    "unknown key of a frame": ("body: lower", "bdy: lower", 20, ["entry 1 of frames", "did you mean 'body'"]),
    "key of another joint type": ("axis: [0, 0, 1]", "axis: [0, 0, 1]\n      pitch: 1", 12, ["'pitch'", "point"]),
    "no units": ("units: SI\n", "", 1, ["the robot has no 'units'"]),
    "no bodies": (GOOD[GOOD.index("bodies") : GOOD.index("\ncoord") + 1], "", 1, ["no key that identifies its format, 'bodies'", "keys: name"]),  # noqa: E501
    "no body name": ("- name: lower\n    parent", "- parent", 14, ["entry 2 of bodies", "no 'name'"]),
    "no parent": ("    parent: ground\n", "", 5, ["entry 1 of bodies", "no 'parent'"]),
    "no joint": (GOOD[GOOD.index("    joint: {") : GOOD.index("coordinates: [")], "", 14, ["entry 2", "no 'joint'"]),
    "no joint name": ("name: elbow, ", "", 17, ["joint of", "has no 'name'"]),
    "no joint type": ("      type: revolute\n", "", 8, ["'shoulder'", "no 'type'"]),
    "no axis": ("      axis: [0, 0, 1]\n", "", 8, ["'shoulder'", "no 'axis'"]),
    "no pitch": ("pitch: 0.1, ", "", 17, ["'elbow'", "no 'pitch'"]),
    "no mass": ("mass: 2, ", "", 13, ["inertia of body 'upper'", "no 'mass'"]),
    "no com": ("com: [0, 0, 0.1], ", "", 13, ["no 'com'"]),
    "no moments": (", inertia: [0.02, 0, 0, 0.02, 0, 0.01]", "", 13, ["no 'inertia'"]),
    "no leader": ("coordinates: {shoulder: 2}, ", "", 17, ["follows of joint 'elbow'", "no 'coordinates'"]),
    "no body of a frame": ("body: lower, ", "", 20, ["entry 1 of frames", "no 'body'"]),
    "other units": ("SI", "mm", 2, ["units of the robot is 'mm'", "SI: m, kg, s, rad"]),
    "misspelt units": ("SI", "[SI]", 2, ["['SI']", "SI: m, kg"]),
    "gravity of two": ("[0, 0, -9.81]", "[0, -9.81]", 3, ["gravity", "[0, -9.81]; expected 3 numbers"]),
    "gravity as a number": ("[0, 0, -9.81]", "-9.81", 3, ["is -9.81; expected 3 numbers"]),
    "text for a number": ("-9.81", "down", 3, ["entry 3 of gravity", "'down'; expected a finite number"]),
    "truth for a number": ("mass: 2", "mass: true", 13, ["mass of inertia of body 'upper' is True"]),
    "nothing for a number": ("mass: 2", "mass: ", 13, ["is None; expected a finite number"]),
    "nan": ("mass: 2", "mass: .nan", 13, ["is nan; expected a finite number"]),
    "infinity": ("upper: 1", "upper: .inf", 12, ["upper of limits", "is inf; expected a finite number"]),
    "too large": ("mass: 2", "mass: 1e999", 13, ["is inf; expected a finite number"]),
    "too large an integer": ("mass: 2", "mass: 1" + "0" * 400, 13, ["expected a finite number"]),
    "too many digits": ("mass: 2", "mass: 1" + "0" * 5000, None, ["not YAML"]),
    "overflow": (INERTIA, "{mass: 1e200, com: [1e200, 0, 0], inertia: [1, 0, 0, 1, 0, 1]}", None, ["M[0", "finite"]),
    "overflow of a point": ("      axis: [0, 0, 1]\n", "      axis: [0, 1, -1]\n      point: [0, 1.7e308, 1.7e308]\n", None, ["finite"]),  # noqa: E501
    "overflow of a rotation": ("rpy: [0, 0, 0]", "rotation: [[1e200, 0, 0], [0, 1, 0], [0, 0, 1]]", 7, ["R^T R"]),
    "com of four": ("[0, 0, 0.1]", "[0, 0, 0.1, 0]", 13, ["com of inertia", "expected 3 numbers"]),
    "moments of five": (", 0.02, 0, 0.01]", ", 0.02, 0]", 13, ["expected 6 numbers or 3 rows of 3 numbers"]),
    "rotation of rows too short": ("rpy: [0, 0, 0]", "rotation: [[1, 0], [0, 1], [0, 0]]", 7, ["entry 1", "3 numbers"]),
    "no number in a row": ("rpy: [0, 0, 0]", "rotation: [[1, 0, x], [0, 1, 0], [0, 0, 1]]", 7, ["'x'", "number"]),
    "no rotation": ("rpy: [0, 0, 0]", "rotation: [[2, 0, 0], [0, 1, 0], [0, 0, 1]]", 7, ["pose of body 'upper'", "R^T R"]),  # noqa: E501
    "reflection": ("rpy: [0, 0, 0]", "rotation: [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]", 7, ["'upper'", "det R = -1"]),
    "frame without rotation": ("lower, pose: {", "lower, pose: {rotation: [[0, 0, 0], [0, 1, 0], [0, 0, 1]], ", 20, ["'tool'"]),  # noqa: E501
    "rotation of the COM frame": ("{mass: 2,", "{rotation: [[2, 0, 0], [0, 1, 0], [0, 0, 1]], mass: 2,", 13, ["rotation"]),  # noqa: E501
    "rotation and rpy": ("rpy:", "rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], rpy:", 7, ["both 'rpy' and 'rotation'"]),
    "matrix and position": ("{position: [0, 0, 1], rpy: [0, 0, 0]}", f"{{position: [0, 0, 1], matrix: {I4}}}", 7, ["both"]),  # noqa: E501
    "last row": ("{position: [0, 0, 1], rpy: [0, 0, 0]}", f"{{matrix: {I4[:-2]}.5]]}}", 7, ["last row"]),
    "screw and type": (TYPE, TYPE + "      screw: [0, 0, 1, 0, 0, 0]\n", 8, ["both 'screw' and 'type'"]),
    "no unit screw": (TYPE, "      screw: [0, 0, 2, 0, 0, 0]\n", 10, ["screw of joint 'shoulder'", "not a unit screw"]),
    "matrix and mass": ("{mass: 2,", f"{{matrix: {M}, mass: 2,", 13, ["both 'matrix' and 'mass'"]),
    "matrix of another form": (INERTIA, f"{{matrix: {M}}}", 13, ["inertia of body 'upper'", "not symmetric"]),
    "moments not symmetric": ("[0.02, 0, 0, 0.02, 0, 0.01]", "[[1, 5, 0], [0, 1, 0], [0, 0, 1]]", 13, ["not symmetric"]),  # noqa: E501
    "zero axis": ("axis: [0, 0, 1]", "axis: [0, 0, -0.0]", 11, ["axis of joint 'shoulder'", "expected a direction"]),
    "joint type": ("type: revolute", "type: revolut", 10, ["unknown joint type 'revolut'; did you mean 'revolute'"]),
    "joint type as a list": ("type: revolute", "type: [revolute]", 10, ["expected a text"]),
    "limits crossed": ("lower: -1", "lower: 2", 12, ["joint 'shoulder'", "2 and 1; expected lower <= upper"]),
    "negative effort": ("effort: 3", "effort: -3", 12, ["'shoulder'", "effort is -3"]),
    "unknown parent": ("parent: upper", "parent: uper", 15, ["parent of body 'lower': unknown body 'uper'", "did you mean 'upper'", "ground"]),  # noqa: E501
    "parent after child": ("parent: ground", "parent: lower", 6, ["parent of body 'upper' is 'lower'", "above"]),
    "its own parent": ("parent: upper", "parent: lower", 15, ["the ground or a body above"]),
    "parent as a number": ("parent: ground", "parent: -1", 6, ["is -1; expected a text"]),
    "unknown body": ("body: lower", "body: lowr", 20, ["body of frame 'tool': unknown body 'lowr'", "mean 'lower'"]),
    "body named twice": ("name: lower", "name: upper", 14, ["second body 'upper'", "arm.yaml:5"]),
    "joint named twice": ("name: elbow", "name: shoulder", 17, ["second joint 'shoulder'", "arm.yaml:9"]),
    "frame named as a body": ("name: tool", "name: upper", 20, ["second frame 'upper'", "arm.yaml:5"]),
    "body named ground": ("name: lower", "name: ground", 14, ["'ground'; expected another name"]),
    "unknown coordinate": ("{shoulder: 2}", "{shouldr: 2}", 17, ["'shouldr'", "did you mean 'shoulder'", "'elbow'"]),
    "coordinate left out": ("coordinates: [shoulder]", "coordinates: [x]", 18, ["omit joint 'shoulder'"]),
    "coordinate that moves nothing": ("[shoulder]", "[shoulder, x]", 18, ["a joint that moves with 'x'"]),
    "coordinate twice": ("[shoulder]", "[shoulder, shoulder]", 18, ["different names"]),
    "no coordinates": ("[shoulder]", "[]", 18, ["empty", "at least 1"]),
    "factor in words": ("{shoulder: 2}", "{shoulder: two}", 17, ["'two'; expected a finite number"]),
    "bodies as a mapping": ("  - name: upper", "    name: upper", None, ["not YAML"]),
    "null frames": (GOOD[GOOD.index("frames") :], "frames:\n", 19, ["frames of the robot is None; expected a list"]),
    "null pose": ("pose: {position: [0, 0, 1]}\n    joint", "pose:\n    joint", 16, ["None; expected keys and values"]),
    "name as a number": ("name: arm", "name: 3", 1, ["name of the robot is 3; expected a text"]),
    "repeated key": ("units: SI", "units: SI\nunits: SI", 3, ["not YAML", "units"]),
    "tag of code": ("name: arm", "name: !!python/object/apply:os.system [id]", 1, ["unknown tag"]),
    "tag of its own": ("name: arm", "name: !secret arm", 1, ["unknown tag '!secret'"]),
    "tag that lies": ("mass: 2", "mass: !!float two", None, ["not YAML", "two"]),
    "merge key": ("{position: [0, 0, 1], rpy: [0, 0, 0]}", "{<<: {rpy: [0, 0, 0]}}", 7, ["merge"]),
    "day for a name": ("name: arm", "name: 2026-02-31", None, ["not YAML", "day"]),
}  # fmt: skip


def load(folder, text, name="arm.yaml"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return jounce.load(path)


def test_the_file_is_good(tmp_path):
    assert load(tmp_path, GOOD).n == 1


@pytest.mark.parametrize(("old", "new", "line", "words"), CHANGED.values(), ids=CHANGED)
def test_refuses(tmp_path, old, new, line, words):
    assert old in GOOD
    place = f"arm.yaml:{line}: " if line else "arm.yaml"
    message = refusal(lambda: load(tmp_path, GOOD.replace(old, new, 1)), place, *words)
    assert message.startswith(str(tmp_path / place))


def test_every_joint_may_not_follow_without_coordinates(tmp_path):
    one = "{name: a, parent: ground, joint: {name: j, screw: [0, 0, 1, 0, 0, 0], follows: {coordinates: {x: 1}}}}"
    text = f"units: SI\nbodies: [{one}]\n"
    refusal(lambda: load(tmp_path, text), "every joint follows", "'coordinates'")
    assert load(tmp_path, text + "coordinates: [x]").joint_names == ("x",)


FILES = {
    "empty": (b"", ["the robot is None; expected keys and values"]),
    "blank": (b"\n# nothing\n", ["expected keys and values"]),
    "a list": (b"[1, 2]", ["the robot is [1, 2]; expected keys and values"]),
    "text": (b"robot", ["'robot'; expected keys and values"]),
    "no YAML": (b"a: [1, 2\nb: {", ["not YAML", "arm.yaml:"]),
    "no bodies in it": (b"units: SI\nbodies: []", ["arm.yaml:2", "bodies of the robot is empty", "at least 1"]),
    "bodies as text": (b"units: SI\nbodies: arm", ["'arm'; expected a list"]),
    "half a loop": (GOOD.encode() + b"\nloops:\n- {frames: [shoulder]}\n",
        ["['shoulder']; expected two names of frames"]),
    "body as text": (b"units: SI\nbodies:\n- arm", ["arm.yaml:3", "entry 1 of bodies", "'arm'"]),
    "two documents": (GOOD.encode() + b"---\n" + GOOD.encode(), ["document 2 of 2", "expected one"]),
    "binary": (bytes(range(256)), ["not YAML"]),
    "other encoding": ("name: Grüße".encode("latin-1"), ["not YAML"]),
    "brackets": (b"a: " + b"[" * 9999, ["not YAML"]),
    "a URDF": (b"<robot name='r'/>", ["expected keys and values"]),
    "a motion": (b"time: {stop: 1, count: 5}\njoints: {}",
        ["arm.yaml:1", "'bodies' (", "'dh' (", "its keys: time, joints"]),
    "cycle": (b"units: SI\nbodies: &a [*a]", ["entry 1 of bodies", "expected keys and values"]),
    "ordered map": (b"!!omap [units: SI, bodies: 1]", ["expected a list"]),
    "set": (b"!!set {units, bodies}", ["expected keys and values"]),
    "key of its own": (b"? [1, 2]\n: 3", ["its keys: (1, 2)"]),
}  # fmt: skip


@pytest.mark.parametrize(("content", "words"), FILES.values(), ids=FILES)
def test_refuses_files(tmp_path, content, words):
    message = refusal(lambda: load(tmp_path, content), str(tmp_path), "arm.yaml", *words)
    assert len(message) < 500


JSON = {
    "empty": (b"", ["not JSON"]),
    "YAML": (GOOD.encode(), ["arm.json:1: not JSON"]),
    "comma": (b'{"units": "SI",\n}', ["arm.json:2: not JSON"]),
    "repeated key": (b'{"units": "SI", "units": "SI"}', ["not JSON", "'units' occurs twice"]),
    "NaN": (b'{"units": "SI", "gravity": [0, 0, NaN], "bodies": []}', ["entry 3 of gravity", "nan"]),
    "Infinity": (b'{"units": "SI", "gravity": [0, 0, -Infinity], "bodies": []}', ["-inf; expected a finite number"]),
    "brackets": (b"[" * 99999, ["not JSON"]),
    "a number": (b"3", ["the robot is 3"]),
    "truth": (b'{"units": "SI", "gravity": [0, 0, true], "bodies": []}', ["True; expected a finite number"]),
    "other units": (b'{"units": "mm", "bodies": []}', ["'mm'", "SI"]),
    "other encoding": ('{"name": "Grüße"}'.encode("latin-1"), ["not JSON"]),
}  # fmt: skip


@pytest.mark.parametrize(("content", "words"), JSON.values(), ids=JSON)
def test_refuses_json(tmp_path, content, words):
    refusal(lambda: load(tmp_path, content, "arm.json"), str(tmp_path), "arm.json", *words)


def test_json_may_be_laid_out_with_tabs_and_escapes(tmp_path):
    body = {
        "name": "a\ud83d\ude00/",
        "parent": "ground",
        "joint": {"name": "j", "type": "prismatic", "axis": [1, 0, 0]},
    }
    text = json.dumps({"units": "SI", "bodies": [body]}, indent="\t").replace("/", "\\/")
    assert load(tmp_path, text, "arm.json").body_names == ("a😀/",)


NESTED = "".join(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 10)}]\n" for i in range(1, 12))
MERGED = "".join(f"l{i}: &l{i} {{<<: [{', '.join([f'*l{i - 1}'] * 10)}]}}\n" for i in range(1, 12))
LAUGHS = {
    "as a value": "l0: &l0 laugh\n" + NESTED + GOOD,
    "as the bodies": "units: &l0 SI\nname: &l1 [*l0, *l0]\n" + NESTED[NESTED.index("l2") :] + "bodies: *l11\n",
    "as gravity": "".join(("x: &l0 1\n", NESTED, "units: SI\ngravity: *l11\nbodies: []\n")),
    "as keys": "l0: &l0 {a: 1}\n" + MERGED + GOOD,
}


@pytest.mark.parametrize("text", LAUGHS.values(), ids=LAUGHS)
def test_a_billion_laughs_end_quickly(tmp_path, text):
    start = time.perf_counter()
    assert len(refusal(lambda: load(tmp_path, text), "arm.yaml")) < 2000
    assert time.perf_counter() - start < 2


@pytest.mark.parametrize(
    "where", ["name: *l11", "gravity: *l11", "coordinates: [*l11]", "bodies: *l11", "frames: *l11"]
)
def test_laughs_are_not_said_again(tmp_path, where):
    """What stands where something else should is shown in part."""
    base = "units: SI\nbodies:\n  - {name: a, parent: ground, joint: {name: j, screw: [0, 0, 1, 0, 0, 0]}}\n"
    deep = "&l0 [1, 1]"
    for i in range(1, 12):
        deep = f"&l{i} [{deep}, " + ", ".join([f"*l{i - 1}"] * 9) + "]"
    text = (base if "bodies" not in where else "units: SI\n") + where.replace("*l11", deep)
    assert len(refusal(lambda: load(tmp_path, text), "arm.yaml")) < 500
