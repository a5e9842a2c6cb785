"""The options of all verbs that say how their robot is loaded: those of `jounce.load`, with the same refusals."""

import json

import numpy as np
import pytest

import jounce
from jounce.checks.description import describe
from jounce.core.cures import running_command
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.io import tables
from support.commands import call
from support.files import BODY, GOOD, LINKS, OTHER, joint, link, robot_file
from support.refusals import refused

FLOATING = (*LINKS, joint("hold", "base", "arm", "floating"), link("x", OTHER), joint("turn", "arm", "x"))
DRIVEN = (*GOOD, link("x", BODY), joint("bend", "arm", "x", inner='<dynamics damping="0.5" friction="0.2"/>'))

THREE = (*DRIVEN, link("y", OTHER), joint("z=1", "x", "y"))


OPTIONS = {
    "base": (FLOATING, ["--base", "fixed"], {"base": "fixed"}),
    "root": (DRIVEN, ["--root", "arm"], {"root": "arm"}),
    "lock": (DRIVEN, ["--lock", "turn=-0.5"], {"lock": {"turn": -0.5}}),
    "two locks": (THREE, ["--lock", "turn=.5", "--lock", "z=1=2e-1"], {"lock": {"turn": 0.5, "z=1": 0.2}}),
    "all drives": (DRIVEN, ["--drives", "all"], {"drives": True}),
    "some drives": (DRIVEN, ["--drives", "damping,armature"], {"drives": ["damping", "armature"]}),
    "gravity": (DRIVEN, ["--gravity", "0", "-1", "2"], {"gravity": (0, -1, 2)}),
    "several": (DRIVEN, ["--lock", "turn=1", "--drives", "friction"], {"lock": {"turn": 1}, "drives": "friction"}),
}


@pytest.mark.filterwarnings("ignore::jounce.JounceWarning")
@pytest.mark.parametrize(("items", "options", "keywords"), OPTIONS.values(), ids=OPTIONS)
def test_options_are_those_of_load(tmp_path, items, options, keywords):
    path, yaml, csv = robot_file(tmp_path, *items), tmp_path / "arm.yaml", tmp_path / "forces.csv"
    robot = jounce.load(path, **keywords)
    with running_command(["--gravity"]):  # whose advice names options
        described = describe(robot.mechanism).json()
    assert json.loads(call("info", path, *options, "--json").stdout) == described
    data = options[: options.index("--drives")] if "--drives" in options else options  # no file says which act
    assert call("convert", path, "-o", yaml, *data).exit_code == 0
    np.testing.assert_array_equal(jounce.load(yaml).mechanism.M, robot.mechanism.M)
    t = np.arange(9) / 8
    tables.write(tmp_path / "motion.csv", {"t": t, **{name: np.sin(t + k) for k, name in enumerate(robot.joint_names)}})
    result = call("run", path, tmp_path / "motion.csv", "-o", csv, *options, "--order", 0, "--degree", 7)
    assert result.exit_code == 0, result.output
    alone = call("run", yaml, tmp_path / "motion.csv", "-o", tmp_path / "other.csv", "--order", 0, "--degree", 7)
    assert alone.exit_code == 0, alone.output
    ours, without = tables.read(csv), tables.read(tmp_path / "other.csv")
    assert set(ours) == set(without)
    drives_act = bool(robot.mechanism.acting)  # which no file says
    assert all(np.array_equal(ours[name], without[name]) for name in ours) is not drives_act


def test_info_names_loops_and_the_joints_that_follow_them():
    said = call("info", "fourbar_leg").stdout
    assert "loops, closed: coupler_end - shank_lever (revolute)\nfollowing joints: coupler_pin, knee\n" in said
    assert "knee = " not in said
    data = json.loads(call("info", "fourbar_leg", "--json").stdout)
    assert data["loops"] == [{"frames": ["coupler_end", "shank_lever"], "joint": "revolute", "axis": [0.0, 1.0, 0.0]}]
    assert (data["following"], data["n"]) == (["coupler_pin", "knee"], 2)


def test_a_xacro_file_takes_arguments(tmp_path):
    path = robot_file(
        tmp_path, '<xacro:arg name="kind" default="revolute"/>', *LINKS, joint("turn", "base", "arm", "$(arg kind)"),
        head='<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">', name="arm.urdf.xacro",
    )  # fmt: skip
    for kind in ("revolute", "prismatic"):
        data = json.loads(call("info", path, "--xacro-arg", f"kind={kind}", "--json").stdout)
        assert data["bodies"][0]["type"] == kind


@pytest.mark.filterwarnings("default::jounce.JounceWarning")
def test_what_is_welded_is_said_beside_the_result(tmp_path):
    result = call("info", robot_file(tmp_path, *FLOATING), "--base", "fixed", "--json")
    assert json.loads(result.stdout)["coordinates"] == [{"name": "turn", "unit": "rad"}]
    assert "hold (floating)" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_info_shows_the_order_of_q_and_the_drives(tmp_path):
    path = robot_file(tmp_path, *DRIVEN)
    lines = [line.split() for line in call("info", path).stdout.splitlines()]
    assert ["q:", "turn,", "bend"] in lines
    assert ["drive", "armature", "damping", "friction", "stribeck", "spring", "offset", "load_friction"] in lines
    assert ["bend", "-", "0.5", "N", "m", "s/rad", "0.2", "N", "m", "over", "0.05", "rad/s", *["-"] * 4] in lines
    assert ["in", "Q:", "none", "of", "these"] in lines
    acting = call("info", path, "--drives", "friction,damping").stdout.splitlines()
    assert "in Q: damping, friction" in acting
    assert "armature" not in call("info", robot_file(tmp_path, *GOOD)).stdout


REFUSED = {
    "base": (["--base", "free"], ["base is 'free'", "'floating'", "'fixed'"]),
    "root": (["--root", "amr"], ["unknown link 'amr'", "did you mean 'arm'"]),
    "lock without a value": (["--lock", "turn"], ["--lock 'turn'", "JOINT=VALUE"]),
    "lock without a name": (["--lock", "=3"], ["--lock '=3'", "JOINT=VALUE"]),
    "lock twice": (["--lock", "turn=1", "--lock", "turn=2"], ["--lock 'turn=2'", "second"]),
    "lock at no number": (["--lock", "turn=x"], ["--lock 'turn=x'", "finite number"]),
    "lock at infinity": (["--lock", "turn=inf"], ["--lock 'turn=inf'", "finite number"]),
    "lock of an unknown joint": (["--lock", "trun=1"], ["'trun'", "did you mean 'turn'"]),
    "gravity": (["--gravity", "0", "nan", "0"], ["gravity", "finite"]),
    "argument of no xacro": (["--xacro-arg", "a=1"], ["'xacro_args'"]),
    "argument without a value": (["--xacro-arg", "a"], ["--xacro-arg 'a'", "NAME=VALUE"]),
}
VERBS = ("info", "run motion.csv -o out.csv", "convert -o arm.yaml")
DRIVES = {"unknown": ("dampin", ["unknown drive term 'dampin'; did you mean 'damping'"]), "none": ("", ["'';"])}


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize(("options", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(tmp_path, verb, options, words):
    name, *others = verb.split()
    robot_file(tmp_path, *DRIVEN)
    refused(tmp_path, [name, "robot.urdf", *others, *options], *words)


@pytest.mark.parametrize("verb", VERBS[:2])
@pytest.mark.parametrize(("terms", "words"), DRIVES.values(), ids=DRIVES)
def test_refuses_drives(tmp_path, verb, terms, words):
    test_refuses(tmp_path, verb, ["--drives", terms], words)


@pytest.mark.parametrize("asked", ["convert iiwa14 -o x.yaml", "compare iiwa14", "motion iiwa14 paper -o x.csv"])
def test_verbs_on_which_drives_have_no_effect_take_none(asked):
    result = call(*asked.split(), "--drives", "all")
    assert result.exit_code == 2
    assert "No such option" in result.stderr
    assert "--drives" in result.stderr


def test_help_of_run_names_every_method():
    helped = call("run", "--help").stdout
    assert [method for method in ("kernel", *DEFAULT_QUANTITY.laws) if method not in helped] == []
    assert "kernel (native code, the default)" in " ".join(helped.split())
