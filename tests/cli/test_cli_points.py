"""Way points on the command line: tables and documents without times, for retime, check and motors."""

import json

import numpy as np
import pytest

import jounce
from jounce.io import tables
from support.commands import run, summary
from support.refusals import refused

POINTS = [[0.0, 0.0], [1.0, 0.5], [1.0, 0.5], [0.2, 1.2]]
LIMITS = """units: SI
joints:
  joint1: {lower: -2, upper: 2, velocity: 2, acceleration: 6, jerk: 100}
  joint2: {lower: -2, upper: 2, velocity: 2, acceleration: 6, jerk: 100}
"""
ROBOT = jounce.load("planar2r").with_limits(lower=-2, upper=2, velocity=2, acceleration=6, jerk=100)


def write_points(path, points=POINTS, names="joint1,joint2"):
    np.savetxt(path, points, "%.17g", ",", header=names, comments="")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "limits.yaml").write_text(LIMITS)
    write_points(tmp_path / "points.csv")
    monkeypatch.chdir(tmp_path)
    return tmp_path


DOCUMENTS = {
    "rows.yaml": "points: [[0, 0], [1, 0.5], [1, 0.5], [0.2, 1.2]]",
    "names.yaml": "joint_names: [joint2, joint1]\npoints: [[0, 0], [0.5, 1], [0.5, 1], [1.2, 0.2]]",
    "positions.yml": "points: [{joint1: 0, joint2: 0}, {positions: [1, 0.5]}, [1, 0.5], {joint2: 1.2, joint1: 0.2}]",
    "degrees.yaml": "points: [[0, 0], [!degrees 57.29577951308232, 0.5], [1, 0.5], [0.2, 1.2]]",
    "points.json": json.dumps({"joint_names": ["joint1", "joint2"], "points": [{"positions": q} for q in POINTS]}),
}


@pytest.mark.parametrize("name", ["points.csv", "points.npz", "points.parquet", "points.mat", *DOCUMENTS])
def test_points_come_from_files_of_every_type(folder, name):
    path = folder / name
    if name in DOCUMENTS:
        path.write_text(DOCUMENTS[name])
    elif path.suffix == ".mat":
        from scipy.io import savemat

        savemat(path, dict(zip(("joint1", "joint2"), np.array(POINTS).T, strict=True)))
    elif path.suffix != ".csv":
        tables.write(path, dict(zip(("joint2", "joint1"), np.array(POINTS).T[::-1], strict=True)))
    motion = jounce.load_motion(path, ROBOT, duration=2.0)
    expected = jounce.Motion.waypoints(POINTS, 2.0)
    t = np.linspace(0, 2, 51)
    assert np.abs(motion(t, 4)[4] - expected(t, 4)[4]).max() < 1e-9
    assert motion.joint_names == ROBOT.joint_names
    assert motion.notes == ("point 2 from 0: equal to the one before; left out",)


def test_named_columns_without_times_are_points():
    columns = dict(zip(("joint1", "joint2"), np.array(POINTS).T, strict=True))
    motion = jounce.load_motion(columns, ROBOT, duration=2.0, tolerance=0.01)
    assert motion.source == "3 way points, straight lines with corners rounded within 0.01 rad or m (C^4)"
    degrees = {f"{name} [deg]": np.rad2deg(x) for name, x in columns.items()}
    again = jounce.load_motion(degrees, ROBOT, duration=2.0, tolerance=0.01)
    assert np.abs(again(1.0, 0)[0] - motion(1.0, 0)[0]).max() < 1e-14


@pytest.mark.parametrize("tolerance", [None, 0.02])
def test_retime_takes_points(folder, tolerance):
    words = ("retime", "planar2r", "points.csv", "--limits", "limits.yaml", "-o", "fast.csv")
    words += () if tolerance is None else ("--tolerance", tolerance)
    found = summary(*words)
    fast = ROBOT.retime(POINTS, tolerance=tolerance)
    assert found["duration"] == pytest.approx(fast.duration, rel=1e-9)
    assert found["given"] is None
    assert "point 2 from 0: equal to the one before; left out" in found["notes"]
    rows = tables.read(folder / "fast.csv")
    t = rows["t"]
    assert np.abs(np.stack([rows["joint1.q"], rows["joint2.q"]], 1) - fast.motion(t, 0)[0]).max() < 1e-9
    printed = run(*words).stdout
    assert printed.startswith(
        f"planar2r along points.csv: {found['duration']:.6g} s with a margin of 0.01\n3 way points"
    )
    assert ROBOT.check(fast.motion).ok
    # A stated duration is that of the given motion, and changes nothing else.
    stated = summary(*words, "--duration", 3)
    assert stated["given"] == 3
    assert stated["duration"] == pytest.approx(found["duration"], rel=5e-3)


def test_check_and_motors_take_points_with_a_duration(folder):
    words = ("planar2r", "points.csv", "--duration", 6)
    found = summary("check", *words, "--limits", "limits.yaml", "-o", "limits.csv")
    check = ROBOT.check(POINTS, duration=6.0)
    assert (found["ok"], found["t"]) == (check.ok, [0, 6])
    assert max(row["ratio"] for row in found["limits"]) == pytest.approx(check.worst.ratio, rel=1e-9)
    quick = summary("check", *words[:2], "--duration", 0.1, "--limits", "limits.yaml", codes=(1,))
    assert not quick["ok"]
    motors = summary("motors", *words, "--tolerance", 0.05, "--stiffness", 800, "--rotor", 0.1, "-o", "motors.csv")
    arm = ROBOT.elastic(800, rotor=0.1)
    [tau] = arm.motors_along(POINTS, duration=6.0, tolerance=0.05).torques
    assert motors["states"] == len(tau)
    assert np.abs(tables.read(folder / "motors.csv")["joint1.tau"] - tau[:, 0]).max() < 1e-9 * np.abs(tau).max()


def test_options_of_points_are_kept_in_files(folder):
    run(
        "motion", "planar2r", "points.csv", "--duration", 2, "--tolerance", 0.01, "-o", "m.csv", "--save-read", "o.yaml"
    )
    assert (folder / "o.yaml").read_text() == "duration: 2.0\ntolerance: 0.01\n"
    run("check", "planar2r", "points.csv", "--read", "o.yaml", "--limits", "limits.yaml", code=1)


TABLES = {
    "one.csv": "joint1,joint2\n0,0\n",
    "same.csv": "joint1,joint2\n0.1,0\n0.1,0\n",
    "nan.csv": "joint1,joint2\n0,0\nnan,1\n",
    "stamp.csv": "stamp,joint1,joint2\n0,0,0\n1,1,1\n",
    "torque.csv": "joint1,joint2,tau_joint1\n0,0,1\n1,1,2\n",
    "one_joint.csv": "joint1\n0\n1\n",
    "degrees.csv": "joint1,joint2\n0,0\n90,45\n",
    "times.csv": "time,joint1,joint2\n0,0,0\n1,1,1\n",
    "two.csv": "joint1,joint2\n0,0\n1,1\n",
    "beyond.csv": "joint1,joint2\n0,0\n1,2.5\n",
    "rates.csv": "joint1.q,joint2.q,joint1.qd,joint2.qd,joint1.q2d,joint2.q2d\n0,0,0,0,0,0\n1,1,0,0,0,0\n",
    "wide.yaml": "points: [[0, 0, 0], [1, 1, 1]]",
    "empty.yaml": "points: []",
    "nan.yaml": "points: [[0, 0], [.nan, 1]]",
    "names.yaml": "joint_names: [joint1, elbow]\npoints: [[0, 0], [1, 1]]",
    "terms.yaml": "time: {start: 0, stop: 1, count: 11}\njoints: {joint1: {polynomial: [0, 1]}, joint2: {offset: 1}}",
}
CURE = (
    "name another column of times by --time COLUMN, state --duration SECONDS for way points without times, or `jounce"
    " payload` and `jounce identify` take poses at rest"
)
REFUSED = [
    ("retime planar2r one.csv", ["one.csv: points: 1 point; expected at least two different ones"]),
    ("retime planar2r same.csv", ["same.csv: points: 2 equal points; expected at least two different ones"]),
    ("retime planar2r nan.csv", ["nan.csv:3: column 'joint1' holds 'nan'; expected a finite number", "--on-error"]),
    ("retime planar2r stamp.csv", ["no column of times, and columns that are no positions of joints: stamp", "--time"]),
    ("retime planar2r torque.csv", ["columns that are no positions of joints: tau_joint1", "--columns '{joint}'"]),
    ("retime planar2r one_joint.csv", ["missing 't', 'joint2'", "hold a joint by --lock joint2=VALUE"]),
    ("check planar2r rates.csv --duration 1", ["there are columns of rates and none of times", "--time COLUMN"]),
    ("retime planar2r degrees.csv", ["point 1 from 0: joint 'joint1' is at 90 rad", "the unit by --angles deg"]),
    ("retime planar2r beyond.csv", ["point 1 from 0: joint 'joint2' is at 2.5 rad, beyond its position limits of -2"]),
    ("retime planar2r two.csv --tolerance 0.1", ["--tolerance rounds the corners between straight lines", "leave it"]),
    ("retime planar2r points.csv --tolerance 0", ["points.csv: tolerance is 0.0; expected a distance > 0 in rad or m"]),
    ("retime planar2r times.csv --tolerance 0.1", ["times.csv: the table has a column of times; --duration and"]),
    ("retime planar2r wide.yaml", ["wide.yaml:1: point 0 from 0 is [0, 0, 0]; expected 2 numbers: joint1, joint2"]),
    ("retime planar2r empty.yaml", ["empty.yaml:1: points is empty; expected at least 1 entry"]),
    ("retime planar2r nan.yaml", ["nan.yaml:1: entry 1 of point 1 from 0 is nan; expected a finite number"]),
    ("retime planar2r names.yaml", ["names.yaml: missing 'joint2'; unknown 'elbow'", "the joints of 'planar2r'"]),
    ("check planar2r points.csv", [f"points.csv: missing 't'; expected t and joint1, joint2; {CURE}"]),
    ("check planar2r points.csv --tolerance 0.1", ["--tolerance is for way points; state --duration SECONDS"]),
    ("check planar2r times.csv --duration 2", ["times.csv: the table has a column of times", "leave them out"]),
    ("check planar2r terms.yaml --duration 2", ["terms.yaml: the file states times", "leave them out"]),
    ("check planar2r points.csv --duration -1", ["points.csv: duration is -1.0; expected a number of seconds > 0"]),
    ("check planar2r points.csv --duration 1 --degree 5", ["way points have no times; --degree is for samples"]),
    ("check planar2r points.csv --duration 1 --unwrap", ["way points have no times; --unwrap is for motions over t"]),
    ("check planar2r . --duration 1", ["--duration is for one file of way points, which is read as a whole"]),
    ("check planar2r points.csv --duration 1 --on-error skip", ["--duration is for one file of way points"]),
    ("run planar2r rows.yaml", ["rows.yaml: the points have no times; expected time_from_start of each point"]),
    ("slowdown planar2r points.csv", [CURE]),
]  # fmt: skip


@pytest.mark.parametrize(("asked", "words"), REFUSED, ids=[asked for asked, _ in REFUSED])
def test_what_is_no_path_is_refused(folder, asked, words):
    for name, text in {**TABLES, "rows.yaml": DOCUMENTS["rows.yaml"]}.items():
        (folder / name).write_text(text)
    with_limits = " --limits limits.yaml" * (asked.split()[0] in ("retime", "check", "slowdown"))
    output = " -o out.csv" * (asked.split()[0] in ("retime", "run"))
    refused(folder, f"{asked}{with_limits}{output}", *words)
