"""`jounce check`, `jounce slowdown`, and the line of `jounce run` on a broken limit."""

import json

import pytest

import jounce
from support.commands import call
from support.refusals import refused


@pytest.fixture(scope="module")
def slower(tmp_path_factory):
    """The paper's motion at the pace that the iiwa's limits allow."""
    path = tmp_path_factory.mktemp("slower") / "slower.npz"
    result = call("slowdown", "iiwa14", "paper", "--limits", "iiwa14", "--step", 0.02, "-o", path, "--json")
    assert result.exit_code == 0, result.output
    return path, json.loads(result.stdout)


def test_check_reports_every_limit_and_exits_with_1_if_broken(tmp_path):
    picture = tmp_path / "ratio.svg"
    result = call("check", "iiwa14", "paper", "--limits", "iiwa14", "--step", 0.02, "--picture", picture)
    assert result.exit_code == 1
    lines = result.stdout.splitlines()
    assert lines[0].endswith("5 of 21 limits broken")
    assert lines[3].split()[:5] == ["velocity", "joint4", "2.1", "1.309", "rad/s"]
    assert "and 1 more; --json lists them" in lines
    assert picture.read_text().startswith("<?xml")
    data = json.loads(call("check", "iiwa14", "paper", "--limits", "iiwa14", "--step", 0.02, "--json").stdout)
    assert (data["ok"], len(data["limits"])) == (False, 21)
    assert max(row["ratio"] for row in data["limits"]) == pytest.approx(1.604, rel=1e-3)


def test_slowdown_writes_a_motion_that_keeps_its_limits(slower):
    path, data = slower
    assert data["binding"]["joint"] == "joint4"
    assert data["duration"][1] == pytest.approx(data["duration"][0] / data["factor"])
    robot = jounce.load("iiwa14").with_limits("iiwa14")
    assert robot.check(jounce.load_motion(path, robot)).worst.ratio == pytest.approx(1, abs=1e-6)
    words = call("slowdown", "iiwa14", "paper", "--limits", "iiwa14", "--step", 0.02)
    assert "it must be slower, 0.623332 times the speed" in words.stdout
    assert "bound by the velocity of joint4 at t = " in words.stdout


def test_run_tells_of_a_broken_limit(tmp_path):
    arm = tmp_path / "arm.yaml"
    jounce.save(jounce.load("planar2r").with_limits(effort=20), arm)
    motion = tmp_path / "motion.yaml"
    motion.write_text("time: {start: 0, stop: 1, count: 11}\njoints: {joint1: {offset: 0}, joint2: {offset: 0}}")
    result = call("run", arm, motion, "-o", tmp_path / "forces.csv")
    assert "limit broken: effort of joint1 at t = 0 s is 1.472 times its limit; jounce check" in result.stdout
    result = call("run", "iiwa14", "paper", "--step", 0.01, "-o", tmp_path / "forces.csv", "--json")
    assert json.loads(result.stdout)["broken_limit"] is None


@pytest.mark.parametrize(("asked", "words"), [
    ("check iiwa14 paper", "has no limits; use --limits ARM"),
    ("check iiwa14 paper --limits iwa14", "unknown limits 'iwa14'; did you mean 'iiwa14'?"),
    ("check iiwa14 paper --limits iiwa14 --picture ratio.doc", "unknown type of picture"),
    ("slowdown iiwa14 paper --limits iiwa14 -o slower.doc", "slower.doc"),
])  # fmt: skip
def test_what_cannot_be_done_is_one_line(tmp_path, asked, words):
    refused(tmp_path, asked, words)
