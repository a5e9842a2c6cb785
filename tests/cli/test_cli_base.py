"""Commands on robots that float, and on robots whose ground moves."""

import json

import numpy as np
import pyarrow.parquet
import pytest
from matplotlib.figure import Figure

import jounce
from jounce.figures import canvas
from jounce.figures.drawing import View, draw, poses_on
from jounce.io import tables
from support.commands import run, summary
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
def base_folder(tmp_path_factory):
    found = tmp_path_factory.mktemp("base")
    jounce.save(jounce.Robot(floating(ARM.mechanism, np.random.default_rng(3))), found / "robot.yaml")
    (found / "sway.yaml").write_text(YAML + BASE)
    (found / "still.yaml").write_text(YAML)
    return found


@pytest.fixture(scope="module")
def saved_robot(base_folder):
    return jounce.load(base_folder / "robot.yaml")


def test_run_writes_the_wrench_on_the_base_first(base_folder, saved_robot):
    said = run(
        "run", base_folder / "robot.yaml", base_folder / "sway.yaml", "-o", base_folder / "forces.npz", "--rates"
    ).output
    found = tables.read(base_folder / "forces.npz")
    along = saved_robot.forces_along(jounce.load_motion(base_folder / "sway.yaml", saved_robot))
    names = [f"base.{name}" for name in ("mx", "my", "mz", "fx", "fy", "fz")] + ["joint1", "joint2"]
    for k, rate in enumerate(("Q", "Qd", "Q2d")):
        np.testing.assert_array_equal(np.stack([found[f"{name}.{rate}"] for name in names], axis=1), along.forces[k])
    assert [line.split()[:3] for line in said.splitlines()[-8:-4]] == [
        ["base.mx", "N", "m"], ["base.my", "N", "m"], ["base.mz", "N", "m"], ["base.fx", "N", found_peak(along, 3)],
    ]  # fmt: skip
    again = jounce.load_motion(base_folder / "forces.npz", saved_robot)
    for ours, other in zip(again.base(again.times), along.base, strict=True):
        np.testing.assert_allclose(ours, other, atol=1e-12 * (1 + abs(other).max()))


def found_peak(along, j):
    return f"{abs(along.forces[0][:, j]).max():.6g}"


def test_tables_read_by_rows_are_those_read_as_a_whole(base_folder):
    run("motion", base_folder / "robot.yaml", base_folder / "sway.yaml", "-o", base_folder / "motion.csv")
    run("run", base_folder / "robot.yaml", base_folder / "motion.csv", "-o", base_folder / "whole.npz")
    run("run", base_folder / "robot.yaml", base_folder / "motion.csv", "-o", base_folder / "parts")
    whole = tables.read(base_folder / "whole.npz")
    [part] = (base_folder / "parts").rglob("*.parquet")
    found = pyarrow.parquet.read_table(part).to_pydict()
    for name, values in whole.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-12, atol=1e-12 * abs(values).max(), err_msg=name)


def test_the_ground_of_a_fixed_robot_moves(base_folder):
    for name in ("sway", "still"):
        run("run", "planar2r", base_folder / f"{name}.yaml", "-o", base_folder / f"{name}.npz")
    sway, still = (tables.read(base_folder / f"{name}.npz") for name in ("sway", "still"))
    assert list(sway) == list(still)
    assert abs(sway["joint1.Q"] - still["joint1.Q"]).max() > 1
    refused(base_folder, "run robot.yaml still.yaml -o x.csv", "nothing says where its base is")


@pytest.mark.parametrize("verb", ["run", "check"])
def test_a_plan_without_a_base_is_refused_for_a_robot_that_floats(base_folder, verb):
    points = [{"positions": [k, 0], "time_from_start": {"sec": k}} for k in (0, 1)]
    (base_folder / "plan.json").write_text(json.dumps({"joint_names": ["joint1", "joint2"], "points": points}))
    asked = f"{verb} robot.yaml plan.json" + " -o x.csv" * (verb == "run")
    refused(base_folder, asked, "columns base.x, ..., base.qz of a table state one")


def test_pictures_show_the_wrench_on_the_base(base_folder):
    run("run", base_folder / "robot.yaml", base_folder / "sway.yaml", "-o", base_folder / "f.csv", "--order", "0")
    options = ("-o", base_folder / "f.svg", "--robot", base_folder / "robot.yaml")
    panels = summary("plot", base_folder / "f.csv", *options)["panels"]
    assert panels["Q"][:1] == ["base.mx"]
    assert panels["Q"][-1] == "joint2"
    assert "of 2 joints and the base" in run("plot", base_folder / "f.csv", *options).output


def test_a_robot_that_floats_is_drawn_without_ground(saved_robot):
    assert "<img" in saved_robot._repr_html_()
    patches = []
    for one in (ARM, saved_robot):
        axes = canvas.painted(Figure.subplots, 4, 3).axes[0]
        draw(axes, one.mechanism, poses_on(one, np.zeros(2), np.eye(4)), View(0, 0))
        patches.append(len(axes.patches))
    assert patches[0] == patches[1] + 1


def test_reports_draw_a_base_that_moves(base_folder):
    for robot in ("planar2r", base_folder / "robot.yaml"):
        said = run("report", robot, base_folder / "sway.yaml", "-o", base_folder / "r.html").output
        assert "sway.yaml, 21 states" in said
