"""`jounce identify` and `jounce payload` of poses at rest: tables without times, and holds of a log."""

import json

import numpy as np
import pytest

import jounce
from support.commands import run
from support.refusals import refused

FOLDER_NAMES = ("with.csv", "without.csv")


@pytest.fixture
def tables(tmp_path):
    """Poses of a planar arm with 2 kg on its second body and without, and a log that holds the former."""
    robot, rng = jounce.load("planar2r"), np.random.default_rng(0)
    q = rng.uniform(-1.5, 1.5, (20, 2))
    for name, p in zip(FOLDER_NAMES, ([2.0, 0.2, 0.1], [0.0, 0, 0]), strict=True):
        arm = robot.with_inertial_parameters(robot.inertial_parameters + np.append(np.zeros(10), [*p, *np.zeros(7)]))
        Q = arm.gravity_forces(q) + 0.02 * rng.normal(size=q.shape) + 0.3
        columns = {"joint1": q[:, 0], "joint2": q[:, 1], "joint1.tau": Q[:, 0], "joint2.tau": Q[:, 1]}
        for folder in (tmp_path, tmp_path / "both"):
            folder.mkdir(exist_ok=True)
            write_columns(folder / name, columns)
        if name == FOLDER_NAMES[0]:
            held = {column: np.repeat(x, 100) for column, x in columns.items()}
            write_columns(tmp_path / "log.csv", {"t": 0.01 * np.arange(2000), **held})
    return tmp_path


def write_columns(path, columns):
    np.savetxt(path, np.stack([*columns.values()], axis=1), delimiter=",", header=",".join(columns), comments="")


@pytest.mark.filterwarnings("ignore::jounce.JounceWarning")
@pytest.mark.parametrize("second", ["without.csv", None])
def test_the_load_of_poses(tables, second):
    given = [tables / "with.csv", *([] if second is None else [tables / second])]
    said = json.loads(run("payload", "planar2r", *given, "-o", tables / "loaded.yaml", "--json").stdout)
    assert said["mass"] == pytest.approx(2.0, abs=0.05)
    assert said["com"][:2] == pytest.approx([0.1, 0.05], abs=0.02)
    assert said["inertia"] is None
    assert [row["name"] for row in said["parameters"]] == ["mass", "com x", "com y", "com z"]
    assert said["unseen"] == ["com z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"]
    assert list(said["settings"]) == ["ur", "ur before 5.10", "iiwa"]
    assert jounce.load(tables / "loaded.yaml").mechanism.M[1][3, 3] == pytest.approx(3.0, abs=0.05)


def test_holds_of_a_log_say_the_same(tables):
    of_rows, of_holds = (
        json.loads(run("payload", "planar2r", tables / name, *options, "--json").stdout)
        for name, options in (("with.csv", ["--holds"]), ("log.csv", ["--holds"]))
    )
    assert of_holds["mass"] == pytest.approx(of_rows["mass"], abs=0.02)
    assert "20 holds of" in of_holds["notes"][-1]


def test_the_robot_of_poses(tables):
    words = ("identify", "planar2r", tables / "with.csv", "-o", tables / "found.yaml")
    outputs = ("--table", tables / "found.csv", "--picture", tables / "found.svg")
    said = json.loads(run(*words, *outputs, "--json").stdout)
    assert said["poses"] == 20
    assert [said[name] for name in ("samples", "span", "band", "cell", "cells", "logs", "delay")] == [None] * 7
    assert said["undetermined"][:3] == ["moments of inertia", "damping", "armature"]
    names = [row["name"] for row in said["parameters"]]
    assert names == ["body1 mcx", "body1 mcy", "body2 mcx", "body2 mcy", "joint1 offset", "joint2 offset"]
    assert (tables / "found.csv").read_text().count("\n") == 7
    assert "pose" in (tables / "found.svg").read_text()
    text = run(*words).stdout
    assert "planar2r: 20 poses at rest" in text
    assert "rest does not determine moments of inertia, damping, armature" in text
    assert [word for word in ("nan", "Hz", "cells", "all samples") if word in text] == []
    assert jounce.load(tables / "found.yaml", drives=True).drives.offset == pytest.approx([0.3, 0.3], abs=0.05)


@pytest.mark.parametrize(("asked", "words"), [
    ("identify planar2r with.csv -o x.yaml --report x.html", "--picture and --table show the result"),
    ("identify planar2r with.csv -o x.yaml --span 0 1", "--span is for logs"),
    ("identify planar2r with.csv -o x.yaml --bandwidth 5", "--bandwidth is for motions, and these are poses"),
    ("identify planar2r with.csv -o x.yaml --test without.csv", "expected one: join tables of poses"),
    ("identify planar2r both -o x.yaml", "expected one: join tables of poses"),
    ("payload planar2r with.csv --step 0.1", "--step is for motions"),
    ("run planar2r with.csv", "`jounce payload` and `jounce identify` take poses at rest"),
    ("check planar2r with.csv", "missing 't'"),
])  # fmt: skip
def test_refuses_what_needs_times(tables, asked, words):
    refused(tables, asked, words)
