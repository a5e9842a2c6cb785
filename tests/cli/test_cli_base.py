"""Commands on robots that float, and on robots whose ground moves."""

import json

import numpy as np
import pyarrow.parquet
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

import jounce
from jounce.cli import main
from jounce.figures.canvas import painted
from jounce.figures.drawing import View, draw, poses_on
from jounce.io import tables
from support.refusals import refused
from support.robots import floating

ARM = jounce.load("planar2r")
YAML = """time: {stop: 1, count: 21}
joints: {joint1: {cosines: [{amplitude: 1, frequency: 2}]}, joint2: {polynomial: [0, 0.5, 1]}}
"""
BASE = """base:
  x: {cosines: [{amplitude: 0.1, frequency: 3}]}
  qw: {offset: 1}
  qy: {cosines: [{amplitude: 0.2, frequency: 4, phase: 1}]}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("base")
    jounce.save(jounce.Robot(floating(ARM.mechanism, np.random.default_rng(3))), found / "robot.yaml")
    (found / "sway.yaml").write_text(YAML + BASE)
    (found / "still.yaml").write_text(YAML)
    return found


@pytest.fixture(scope="module")
def robot(folder):
    return jounce.load(folder / "robot.yaml")


def jounce_(*words, code=0):
    result = CliRunner().invoke(main, list(map(str, words)))
    assert result.exit_code == code, result.output
    return result.output


def test_run_writes_the_wrench_on_the_base_first(folder, robot):
    said = jounce_("run", folder / "robot.yaml", folder / "sway.yaml", "-o", folder / "forces.npz", "--rates")
    found = tables.read(folder / "forces.npz")
    along = robot.forces_along(jounce.load_motion(folder / "sway.yaml", robot))
    names = [f"base.{name}" for name in ("mx", "my", "mz", "fx", "fy", "fz")] + ["joint1", "joint2"]
    for k, rate in enumerate(("Q", "Qd", "Q2d")):
        np.testing.assert_array_equal(np.stack([found[f"{name}.{rate}"] for name in names], axis=1), along.forces[k])
    assert [line.split()[:3] for line in said.splitlines()[-8:-4]] == [
        ["base.mx", "N", "m"], ["base.my", "N", "m"], ["base.mz", "N", "m"], ["base.fx", "N", found_peak(along, 3)],
    ]  # fmt: skip
    again = jounce.load_motion(folder / "forces.npz", robot)
    for ours, other in zip(again.base(again.times), along.base, strict=True):
        np.testing.assert_allclose(ours, other, atol=1e-12 * (1 + abs(other).max()))


def found_peak(along, j):
    return f"{abs(along.forces[0][:, j]).max():.6g}"


def test_tables_read_by_rows_are_those_read_as_a_whole(folder):
    jounce_("motion", folder / "robot.yaml", folder / "sway.yaml", "-o", folder / "motion.csv")
    jounce_("run", folder / "robot.yaml", folder / "motion.csv", "-o", folder / "whole.npz")
    jounce_("run", folder / "robot.yaml", folder / "motion.csv", "-o", folder / "parts")
    whole = tables.read(folder / "whole.npz")
    [part] = (folder / "parts").rglob("*.parquet")
    found = pyarrow.parquet.read_table(part).to_pydict()
    for name, values in whole.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-12, atol=1e-12 * abs(values).max(), err_msg=name)


def test_the_ground_of_a_fixed_robot_moves(folder):
    for name in ("sway", "still"):
        jounce_("run", "planar2r", folder / f"{name}.yaml", "-o", folder / f"{name}.npz")
    sway, still = (tables.read(folder / f"{name}.npz") for name in ("sway", "still"))
    assert list(sway) == list(still)
    assert abs(sway["joint1.Q"] - still["joint1.Q"]).max() > 1
    refused(folder, "run robot.yaml still.yaml -o x.csv", "nothing says where its base is")


@pytest.mark.parametrize("verb", ["run", "check"])
def test_a_plan_without_a_base_is_refused_for_a_robot_that_floats(folder, verb):
    points = [{"positions": [k, 0], "time_from_start": {"sec": k}} for k in (0, 1)]
    (folder / "plan.json").write_text(json.dumps({"joint_names": ["joint1", "joint2"], "points": points}))
    asked = f"{verb} robot.yaml plan.json" + " -o x.csv" * (verb == "run")
    refused(folder, asked, "columns base.x, ..., base.qz of a table state one")


def test_pictures_show_the_wrench_on_the_base(folder):
    jounce_("run", folder / "robot.yaml", folder / "sway.yaml", "-o", folder / "f.csv", "--order", "0")
    options = ("-o", folder / "f.svg", "--robot", folder / "robot.yaml", "--json")
    panels = json.loads(jounce_("plot", folder / "f.csv", *options))["panels"]
    assert panels["Q"][:1] == ["base.mx"]
    assert panels["Q"][-1] == "joint2"
    assert "of 2 joints and the base" in jounce_("plot", folder / "f.csv", *options[:-1])


def test_a_robot_that_floats_is_drawn_without_ground(robot):
    assert "<img" in robot._repr_html_()
    patches = []
    for one in (ARM, robot):
        axes = painted(Figure.subplots, 4, 3).axes[0]
        draw(axes, one.mechanism, poses_on(one, np.zeros(2), np.eye(4)), View(0, 0))
        patches.append(len(axes.patches))
    assert patches[0] == patches[1] + 1


def test_reports_draw_a_base_that_moves(folder):
    for robot in ("planar2r", folder / "robot.yaml"):
        said = jounce_("report", robot, folder / "sway.yaml", "-o", folder / "r.html")
        assert "sway.yaml, 21 states" in said
