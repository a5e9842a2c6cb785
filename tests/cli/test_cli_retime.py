"""`jounce retime`: the table holds the fastest motion, which keeps the limits, and the picture shows its speed."""

import json

import numpy as np

import jounce
from jounce.io import tables
from support.commands import run
from support.refusals import refused

JOINTS = {"joint1": [0.1, 0, 0, 0, 35, -84, 70, -20], "joint2": [0.2, 0, 0, 0, -35, 84, -70, 20]}
LIMITS = """units: SI
joints:
  joint1: {velocity: 3, effort: 60, effort_rate: 800}
  joint2: {velocity: 3, effort: 20, effort_rate: 800}
"""


def test_the_fastest_motion_is_written_and_drawn(tmp_path):
    given, limits, out, picture = (tmp_path / name for name in ("move.yaml", "limits.yaml", "fast.csv", "fast.svg"))
    given.write_text(json.dumps({"time": {"start": 0, "stop": 1, "count": 11}, "joints": {
        joint: {"polynomial": c} for joint, c in JOINTS.items()
    }}))  # fmt: skip
    limits.write_text(LIMITS)
    words = ("retime", "planar2r", given, "--limits", limits, "-o", out, "--step", "0.0005", "--picture", picture)
    found = json.loads(run(*words, "--json").stdout)
    robot = jounce.load("planar2r").with_limits(velocity=3, effort=[60, 20], effort_rate=800)
    rows = tables.read(out)
    assert rows["t"][-1] == found["duration"] < found["given"]
    assert {stretch["limit"] for stretch in found["binding"]} <= {"velocity", "effort", "effort_rate"}
    rates = [np.stack([rows[f"{joint}.{rate}"] for joint in JOINTS], axis=1) for rate in ("q", "qd", "q2d", "q3d")]
    Q, Qd = robot.inverse_dynamics(*rates)
    assert 0.98 < max(np.abs(Q / [60, 20]).max(), np.abs(Qd / 800).max()) < 1
    assert picture.read_text().startswith("<?xml")
    assert f"-> {found['duration']:.6g} s with a margin of 0.01" in run(*words).stdout
    refused(tmp_path, "retime planar2r fast.csv --limits limits.yaml -o fast.csv", "the output file is the input file")


def test_accelerations_that_jump_are_asked_for_and_said(tmp_path):
    given, limits, out = (tmp_path / name for name in ("move.yaml", "limits.yaml", "fast.csv"))
    given.write_text(json.dumps({"time": {"start": 0, "stop": 1, "count": 11}, "joints": {
        joint: {"polynomial": c} for joint, c in JOINTS.items()
    }}))  # fmt: skip
    limits.write_text(LIMITS)
    words = ("retime", "planar2r", given, "--limits", limits, "-o", out)
    refused(tmp_path, [*words, "--no-smooth"], "also has limits of effort rate; omit")
    limits.write_text(LIMITS.replace(", effort_rate: 800", ""))
    smooth, shortest = (json.loads(run(*words, way, "--json").stdout) for way in ("--smooth", "--no-smooth"))
    assert shortest["duration"] < smooth["duration"] < 1.005 * shortest["duration"]
    assert smooth["jumps"] == 0 < shortest["jumps"]
    assert f"accelerations and efforts jump {shortest['jumps']} times\n" in run(*words, "--no-smooth").stdout
    assert tables.read(out)["t"][-1] == shortest["duration"]
