"""Limits from files and tables: every number has a source, joints go by name, nonsense is refused in a line."""

import numpy as np
import pytest

import jounce
from jounce.io.limit_files import read_table, table_names
from jounce.model.limits import LIMIT_KINDS
from support.refusals import refusal

MOVEIT = """
joint_limits:
  joint1:
    has_velocity_limits: true
    max_velocity: 2.0
    has_acceleration_limits: false
    max_acceleration: 5.0
    has_effort_limits: true
    max_effort: 30
  joint2: {has_position_limits: true, min_position: -1, max_position: 1.5, max_jerk: 40, has_jerk_limits: true}
"""
OWN = """
units: SI
angles: deg
limits_of: {effort_rate: Q - Qgrav}
joints:
  joint1: {lower: -90, upper: 180, velocity: [-90, 180], effort: 50, effort_rate: [null, 1000]}
"""


@pytest.fixture
def file(tmp_path):
    def write(text, name="limits.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("name", table_names())
def test_every_number_of_a_table_has_a_public_source(name):
    table = read_table(name)
    stated = {key for joint in table.get("joints").members().values() for key in joint.value}
    assert stated <= {*LIMIT_KINDS.bound_names}
    kinds = {"position" if key in ("lower", "upper") else key for key in stated}
    sources = {kind: entry.text() for kind, entry in table.get("sources").members().items()}
    assert kinds == {*sources}
    assert all(url.startswith("https://") for url in sources.values())


def test_tables_fit_robots_behind_any_prefix():
    panda = jounce.load("panda").with_limits("panda").limits
    assert panda.effort_rate.tolist() == [1000.0] * 7 + [np.inf] * 2
    assert panda.effort.tolist() == [87.0] * 4 + [12.0] * 3 + [100.0] * 2  # those of the fingers are the file's own
    assert panda.of("effort_rate") == "Q - Qgrav"
    assert jounce.load("iiwa14").with_limits("iiwa14").limits.velocity[0] == pytest.approx(np.radians(85))
    two = [f"{side}_{name}" for side in ("left", "right") for name in jounce.load("ur5").joint_names]
    arms = jounce.Robot.from_screws(
        [np.eye(4)] * 12, [[0, 0, 1, 0, 0, 0]] * 12, [np.eye(6)] * 12, joint_names=two
    ).with_limits("ur5e")  # fmt: skip
    assert arms.limits.effort.tolist() == [150, 150, 150, 28, 28, 28] * 2


def test_own_files_and_limits_of_another_robot(file):
    robot = jounce.load("planar2r").with_limits(file(OWN))
    assert robot.limits.bounds("velocity")[:, 0] == pytest.approx([-np.pi / 2, np.pi])
    assert robot.limits.bounds("effort_rate")[:, 0].tolist() == [-np.inf, 1000]
    assert (robot.limits.lower[0], robot.limits.of("effort_rate")) == (pytest.approx(-np.pi / 2), "Q - Qgrav")
    assert robot.with_limits(effort=1).limits.of("effort_rate") == "Q - Qgrav"
    assert jounce.load("planar2r").with_limits(robot.limits) == robot
    assert robot.with_limits(file(OWN), effort=3).limits.effort.tolist() == [3, 3]


def test_moveit(file):
    limits = jounce.load("planar2r").with_limits(file(MOVEIT)).limits
    assert limits.velocity.tolist() == [2, np.inf]
    assert limits.acceleration.tolist() == [np.inf] * 2
    assert limits.effort.tolist() == [30, np.inf]
    assert (limits.bounds("position")[:, 1].tolist(), limits.jerk[1]) == ([-1, 1.5], 40)
    wrapped = "robot_description_planning:\n" + "\n".join("  " + line for line in MOVEIT.splitlines())
    assert (jounce.load("planar2r").with_limits(file(wrapped)).limits.table == limits.table).all()
    more = MOVEIT + "  gripper: {max_velocity: 1}\n"
    with pytest.warns(jounce.JounceWarning, match="limits of gripper are left out"):
        jounce.load("planar2r").with_limits(file(more))


@pytest.mark.parametrize(("text", "words"), [
    (OWN.replace("joint1:", "joint3:"), ["limits.yaml:6", "unknown joint 'joint3'", "joint1, joint2"]),
    (OWN.replace("units: SI", "units: mm"), ["units", "'mm'", "SI"]),
    (OWN.replace("effort: 50", "efort: 50"), ["no key", "'efort'", "did you mean 'effort'"]),
    (OWN.replace("lower: -90", "lower: 200"), ["joint 'joint1'", "200 and 180; expected lower <= upper"]),
    (OWN.replace("[-90, 180]", "[90, 180]"), ["limits of velocity are 90 and 180"]),
    (OWN.replace("[-90, 180]", "[1, 2, 3]"), ["expected a number, or two: [lower, upper]"]),
    (OWN.replace("Q - Qgrav", "Q-Qgrav"), ["effort_rate of limits_of", "expected Q or Q - Qgrav"]),
    (OWN.replace("angles: deg", "angles: grad"), ["unknown unit of angles 'grad'", "rad, deg"]),
    (MOVEIT.replace("max_velocity: 2.0", "max_velocity: -2"), ["limits.yaml:3", "velocity is -2"]),
    (MOVEIT.replace("joint1", "a").replace("joint2", "b"), ["unknown joint 'a'"]),
    (MOVEIT.replace("has_velocity_limits: true", "has_velocity_limits: 1"), ["is 1; expected true or false"]),
    ("joints: [", ["not YAML"]),
    ("bodies: []", ["no key"]),
])  # fmt: skip
def test_bad_files_are_refused(file, text, words):
    refusal(lambda: jounce.load("planar2r").with_limits(file(text)), *words)


@pytest.mark.parametrize(("source", "words"), [
    ("pnda", ["unknown limits 'pnda'; did you mean 'panda'?", "iiwa14"]),
    ("panda", ["of 7 joints called joint1", "the joints of this robot are: joint1, joint2"]),
    (3, ["expects a file, the name of an arm or jounce.Limits, got int"]),
    ("nowhere.yaml", ["nowhere.yaml: no such file"]),
    (jounce.load("iiwa14").limits, ["limits are of 7 joint variables; this robot has 2"]),
])  # fmt: skip
def test_bad_sources_are_refused(source, words):
    refusal(lambda: jounce.load("planar2r").with_limits(source), *words)


def test_degrees_are_those_of_every_limit_in_rad(file):
    """Those of motors too, which are seen from the links; only what is measured in rad is converted."""
    for kind in (LIMIT_KINDS[name] for name in LIMIT_KINDS.of_joints):
        key, turns = kind.keys[-1], "rad" in kind.unit("rad").split("/")
        line = (
            f", {LIMIT_KINDS.stall_line[1 - LIMIT_KINDS.stall_line.index(key)]}: 1"
            if key in LIMIT_KINDS.stall_line
            else ""
        )
        text = f"units: SI\nangles: deg\njoints:\n  joint1: {{{key}: 90{line}}}\n"
        found = jounce.load("planar2r").with_limits(file(text)).limits
        assert getattr(found, key)[0] == pytest.approx(np.pi / 2 if turns else 90.0), key
