"""`jounce identify`: from a log with torques to a robot file, a table and a picture."""

import csv
import json

import numpy as np
import pytest

import jounce
from support.commands import run
from support.refusals import refused


@pytest.fixture
def heavy_arm_log(tmp_path):
    """The log of an arm that is heavier than its model, with friction."""
    true = jounce.load("planar2r")
    rng = np.random.default_rng(0)
    motion = jounce.Motion.fourier([0.3, 0.2], *rng.uniform(-0.5, 0.5, (2, 3, 2)), 2.0, 6.0)
    t = np.linspace(0, 6, 1201)
    q, qd, q2d = motion(t, 2)
    Q = 1.5 * true.inverse_dynamics(q, qd, q2d) + np.tanh(qd / 0.05) + 0.01 * rng.normal(size=q.shape)
    path = tmp_path / "log.csv"
    columns = [t, *q.T, *qd.T, *q2d.T, *Q.T]
    names = [f"joint{j}{rate}" for rate in (".q", ".qd", ".q2d", ".tau") for j in (1, 2)]
    np.savetxt(path, np.stack(columns, axis=1), delimiter=",", header=",".join(["t", *names]), comments="")
    return path


def test_the_robot_the_table_and_the_picture_are_written(heavy_arm_log, tmp_path):
    out, table, picture = (tmp_path / name for name in ("found.yaml", "found.csv", "found.svg"))
    words = ("identify", "planar2r", heavy_arm_log, "-o", out, "--span", 0, 4, "--table", table, "--picture", picture)
    said = json.loads(run(*words, "--json").stdout)
    assert said["span"][1] == pytest.approx(4, abs=0.01)
    assert {row["part"] for row in said["residuals"]} == {"used", "rest"}
    assert all(row["identified"] < 0.05 * row["model"] for row in said["residuals"])
    robot = jounce.load(out, drives=True)
    assert robot.drives.friction == pytest.approx([1, 1], abs=0.05)
    assert robot.gravity_forces([0, 0]) == pytest.approx(1.5 * jounce.load("planar2r").gravity_forces([0, 0]), rel=0.01)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [row["name"] for row in rows] == [row["name"] for row in said["parameters"]]
    assert float(rows[0]["value"]) == said["parameters"][0]["value"] == pytest.approx(3, abs=0.1)
    assert picture.read_text().startswith("<?xml")
    text = run(*words).stdout
    for part in ("rank 12 of 12", "joint1 friction", "rest of the data", f"robot written to {out}"):
        assert part in text


def test_a_folder_of_logs_is_one_fit_with_a_page(heavy_arm_log, tmp_path):
    folder, out, page = tmp_path / "logs", tmp_path / "found.yaml", tmp_path / "found.html"
    folder.mkdir()
    lines = heavy_arm_log.read_text().splitlines(keepends=True)
    (folder / "b.csv").write_text("".join([lines[0], *lines[600:]]))
    (folder / "a.csv").write_text("".join(lines[:600]))
    (folder / "notes.md").write_text("not a log")
    words = ("identify", "planar2r", folder, "-o", out)
    said = json.loads(run(*words, "--test", "b.csv", "--report", page, "--json").stdout)
    assert [(of["name"], of["samples"]) for of in said["logs"]] == [("a.csv", 599), ("b.csv", 0)]
    assert said["notes"][0] == f"{folder}: other files, ignored: notes.md"
    assert {(row["log"], row["part"]) for row in said["residuals"]} == {("a.csv", "used"), ("b.csv", "rest")}
    assert said["report"] == str(page)
    assert "planar2r identified from logs" in page.read_text()
    picture = tmp_path / "found.svg"
    text = run(*words, "--picture", picture).stdout
    assert "2 of 2 logs" in text
    assert picture.exists()
    other = run("identify", "planar2r", folder / "a.csv", "-o", out, "--test", folder / "b.csv").stdout
    assert "b.csv: test" in other
    assert json.loads(run(*words, "--test", folder / "b.csv", "--json").stdout)["parameters"] == said["parameters"]


def test_a_folder_is_refused_with_the_name_of_what_is_wrong(heavy_arm_log, tmp_path):
    folder, asked = tmp_path / "logs", "identify planar2r logs -o found.yaml"
    folder.mkdir()
    refused(tmp_path, asked, "logs: no log in this folder; logs are files of type")
    (folder / "a.csv").write_text(heavy_arm_log.read_text())
    (folder / "b.csv").write_text(heavy_arm_log.read_text().replace("tau", "other"))
    refused(tmp_path, asked, "b.csv: the motion has no measured forces")
    (folder / "c.csv").write_text("t,joint1\n0,1\n")
    refused(tmp_path, f"{asked} --test logs/c.csv", "missing 'joint2'")
    refused(tmp_path, f"{asked} --report page.pdf", "available: .html")


@pytest.mark.parametrize(("options", "words"), [
    ("-o out.urdf", "unknown type of robot file"),
    ("-o out.yaml --table out.npz", "available: .csv"),
    ("-o out.yaml --drives stiction", "unknown drive term 'stiction'"),
    ("-o out.yaml --span 7 8", "expected times from 0 to 6 s"),
    ("-o out.yaml --torques Q{number}", "no column 'Q1'"),
])  # fmt: skip
def test_refuses(heavy_arm_log, tmp_path, options, words):
    refused(tmp_path, f"identify planar2r {heavy_arm_log.name} {options}", words)


def test_a_table_without_torques_is_refused(heavy_arm_log, tmp_path):
    heavy_arm_log.write_text(heavy_arm_log.read_text().replace("tau", "other"))
    words = "the motion has no measured forces; expected columns such as tau_JOINT"
    refused(tmp_path, f"identify planar2r {heavy_arm_log.name} -o out.yaml", words)


def test_a_table_does_not_replace_the_log(heavy_arm_log, tmp_path):
    refused(
        tmp_path,
        f"identify planar2r {heavy_arm_log} -o out.yaml --table {heavy_arm_log}",
        f"{heavy_arm_log}: the output file is the input file",
    )
