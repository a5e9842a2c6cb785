"""`jounce excite`: its table and its terms hold the same motion, which keeps the limits."""

import json

import numpy as np
import pytest

import jounce
from jounce.io import tables
from jounce.io.motions import terms
from support.commands import run
from support.refusals import expect_refusal, refused

LIMITS = "units: SI\njoints:\n" + "".join(
    f"  {joint}: {{lower: -2, upper: 2, velocity: 3, effort: {effort}}}\n"
    for joint, effort in (("joint1", 60), ("joint2", 20))
)
ASKED = ("--period", 4, "--periods", 2, "--harmonics", 3, "--starts", 1, "--seed", 2)


def test_table_terms_and_summary_hold_the_same_motion(tmp_path):
    limits, table, series, picture = (tmp_path / name for name in ("limits.yaml", "x.csv", "x.yaml", "x.svg"))
    limits.write_text(LIMITS)
    words = ("excite", "planar2r", "--limits", limits, *ASKED, "--step", 0.01)
    found = json.loads(run(*words, "-o", table, "--picture", picture, "--json").stdout)
    text = run(*words, "-o", series, "--drives", "damping, friction").stdout
    assert text.startswith(f"planar2r: series written to {series}\nFourier series, 3 harmonics of 0.25 Hz, 2 periods")
    assert "10 parameters seen, unseen: -" in text
    assert (len(found["parameters"]), found["unseen"], found["states"]) == (6, [], 801)
    assert {row["limit"] for row in found["limits"]} == {"position", "velocity", "effort"}
    assert max(row["ratio"] for row in found["limits"]) <= 0.99
    run("check", "planar2r", table, "--limits", limits)
    run("check", "planar2r", series, "--limits", limits)
    assert picture.read_text().startswith("<?xml")
    rows = tables.read(table)
    assert {f"joint{j}.{rate}" for j in (1, 2) for rate in ("q", "qd", "q2d", "q3d", "q4d")} <= set(rows)
    assert rows["t"][-1] == found["duration"] == 8
    assert np.ptp(rows["joint1.q"]) > 0.1


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_terms_that_are_written_are_read_with_the_same_bits(tmp_path, suffix):
    robot = jounce.load("planar2r")
    motion = jounce.Motion.fourier([0.1, 0.2], [[1 / 3, 0]], [[0.7, np.pi]], 0.1, 3.0, start=1.0).with_step(0.5)
    terms.write(tmp_path / f"x{suffix}", motion, robot.joint_names)
    again = jounce.load_motion(tmp_path / f"x{suffix}", robot)
    assert again.curve == motion.curve
    assert (again.times == motion.times).all()
    with expect_refusal("no analytic terms; expected a table"):
        terms.write(tmp_path / "y.yaml", jounce.Motion.piecewise([0, 1], [[[1.0]]]), ["joint1"])


@pytest.mark.parametrize(("options", "words"), [
    ("-o x.csv", "states no limit of a rate or a force"),
    ("-o x.txt", "x.txt"),
    ("-o x.csv --period -1", "period is -1.0; expected a number of s > 0"),
    ("-o x.csv --drives motor", "unknown linear drive term 'motor'"),
])  # fmt: skip
def test_what_cannot_be_is_refused_in_one_line(tmp_path, options, words):
    refused(tmp_path, f"excite planar2r {options}", words)


def test_the_files_that_it_reads_are_kept(tmp_path):
    run("convert", "planar2r", "-o", tmp_path / "arm.yaml")
    (tmp_path / "limits.yaml").write_text(LIMITS)
    for name in ("arm.yaml", "limits.yaml"):
        refused(
            tmp_path, f"excite arm.yaml --limits limits.yaml -o {name}", f"{name}: the output file is the input file"
        )
