"""Tables by parts: the numbers are those of the library whatever the parts are, and no stop loses any."""

import csv
import errno
import json
import os
import pickle
import shutil
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from pathlib import Path

import duckdb
import numpy as np
import pyarrow.parquet as pq
import pytest

import jounce
from jounce.io import files, npz, tables
from jounce.io.motions import table_parts
from jounce.io.motions.table_parts import Reading, divide_tables
from jounce.motion.spline import select_smoothing
from jounce.spatial.series import rate_name
from jounce.stream import finished_parts, run
from jounce.stream.jobs import CheckJob, ForceJob, MotorJob, digest
from support.commands import call, summary
from support.refusals import expect_refusal, refused

ROBOT = jounce.load("planar2r")
JOINTS = ROBOT.joint_names
SUFFIXES = (".parquet", ".csv", ".npz")
TEXTS = ("motion", "joint", "limit", "of", "unit", "verdict")


def complaint(*words):
    return refused(None, words)


def swings(rows, seed=0, order=2):
    """Times and rates of a motion of both joints."""
    t = np.arange(rows) / 100 + seed
    found = {"t": t}
    for j, name in enumerate(JOINTS):
        for k in range(order + 3):
            found[f"{name}.{rate_name('q', k)}"] = (2 + j) ** k * np.cos((2 + j) * t + j + k * np.pi / 2)
    return found


def joined(*parts, names=None):
    """Tables one below the other, with the column of motions if these are named."""
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    if names is None:
        return columns
    return {"motion": np.repeat(names, [len(part["t"]) for part in parts])} | columns


def stored(path, columns):
    tables.TABLE_WRITERS[path.suffix].write(path, [columns], None)
    return path


def expected_forces(columns, order=2):
    """The columns that a run should write, straight from the library."""
    rates = [np.stack([columns[f"{name}.{rate_name('q', k)}"] for name in JOINTS], 1) for k in range(order + 3)]
    Q = ROBOT.inverse_dynamics(*rates)
    named = {f"{name}.{rate_name('Q', k)}": Q[k][:, j] for j, name in enumerate(JOINTS) for k in range(order + 1)}
    return {name: columns[name] for name in ("motion", "t") if name in columns} | named


def read_output(path):
    """The columns of an output, texts among them."""
    if path.is_dir() or path.suffix == ".parquet":
        files = sorted(path.glob("*.parquet")) if path.is_dir() else [path]
        found = [pq.read_table(file) for file in files]
        return {
            name: np.concatenate([np.array(one.column(name).to_pylist()) for one in found])
            for name in found[0].column_names
        }
    if path.suffix == ".npz":
        return dict(np.load(path))
    header, *rows = csv.reader(path.read_text().splitlines())
    columns = zip(header, zip(*rows, strict=True), strict=True)
    return {name: np.array(cells if name in TEXTS else [*map(float, cells)]) for name, cells in columns}


def assert_output(path, expected):
    found = read_output(path)
    assert list(found) == list(expected)
    for name, column in expected.items():
        assert np.array_equal(found[name], column), name


def bytes_of(path):
    return {file.name: file.read_bytes() for file in sorted(path.iterdir())} if path.is_dir() else path.read_bytes()


@pytest.fixture
def small_parts(monkeypatch):
    """Parts of a few rows, and chunks of fewer."""
    monkeypatch.setattr(table_parts, "MAX_PART_CELLS", 200)
    monkeypatch.setattr(table_parts, "MIN_LARGE_TABLE_BYTES", 0)
    monkeypatch.setattr("jounce.io.table_format.CELLS_PER_CHUNK", 70)
    monkeypatch.setattr("jounce.io.parquet.ROWS_PER_GROUP", 13)


@pytest.mark.parametrize(
    ("source", "output"), [(".parquet", "out"), (".csv", "out.csv"), (".npz", "out.npz"), (".csv", "out.parquet")]
)
def test_parts_of_any_size_make_what_the_library_computes(tmp_path, small_parts, source, output):
    columns = joined(swings(90), swings(1, 3), swings(40, 5), names=["a", "b", "c"])
    path = stored(tmp_path / f"states{source}", columns)
    found = summary("run", "planar2r", path, "-o", tmp_path / output)
    assert found["parts"] > 3
    assert (found["states"], found["motions"]) == (131, 3)
    assert_output(tmp_path / output, expected_forces(columns))
    Q = expected_forces(columns)
    assert found["peaks"]["joint1"]["Q2d"] == np.abs(Q["joint1.Q2d"]).max()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([output, f"states{source}"])


def test_a_folder_is_a_motion_per_file_of_any_type(tmp_path, small_parts):
    (tmp_path / "in").mkdir()
    for number, suffix in enumerate(SUFFIXES):
        stored(tmp_path / "in" / f"m{number}{suffix}", swings(30 + number, number))
    (tmp_path / "in" / "notes.md").write_text("mine")
    found = summary("run", "planar2r", tmp_path / "in", "-o", tmp_path / "out.npz", "--rates")
    assert found["notes"] == ["other files, ignored: notes.md"]
    whole = joined(*(swings(30 + k, k) for k in range(3)), names=["m0", "m1", "m2"])
    kept = read_output(tmp_path / "out.npz")
    assert all(np.array_equal(kept[name], column) for name, column in (whole | expected_forces(whole)).items())


def test_motions_of_samples_are_fitted_as_wholes(tmp_path, small_parts):
    """As each of them alone, whatever parts they are in."""
    t = np.linspace(0, 2, 120)
    one, two = ({"t": t, "joint1": np.sin(w * t), "joint2": np.cos(t) / w} for w in (2, 3))
    path = stored(tmp_path / "log.parquet", joined(one, two, names=["one", "two"]))
    found = summary("run", "planar2r", path, "-o", tmp_path / "out.npz", "--degree", 7)
    assert (found["parts"], found["states"]) == (2, 240)
    kept = read_output(tmp_path / "out.npz")
    for name, columns in (("one", one), ("two", two)):
        along = ROBOT.forces_along(jounce.load_motion(columns, ROBOT, degree=7))
        mine = kept["motion"] == name
        assert np.array_equal(kept["joint2.Q2d"][mine], along.forces[2][:, 1])
        assert not kept["joint2.Q2d_sd"].any()
    again = joined(one, two, {name: x[:60] for name, x in one.items()}, names=["one", "two", "one"])
    stored(path, again)
    assert "row 240 from 0: motion 'one' begins a second time" in complaint(
        "run", "planar2r", path, "-o", tmp_path / "o"
    )


def test_a_motion_that_does_not_fit_into_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(table_parts, "_memory", lambda: 1000)
    t = np.linspace(0, 2, 120)
    path = stored(tmp_path / "log.parquet", {"t": t, "joint1": t, "joint2": t})
    message = complaint("run", "planar2r", path, "-o", tmp_path / "out")
    assert "row 0 from 0: the motion that begins here takes" in message
    assert "state its rates in columns NAME.q, NAME.qd" in message


def test_aggregates_are_those_of_the_rows(tmp_path, small_parts):
    columns = joined(swings(90), swings(40, 5), names=["a", "c"])
    path = stored(tmp_path / "states.parquet", columns)
    assert call("run", "planar2r", path, "-o", tmp_path / "out.csv", "--reduce", "rms,peak").exit_code == 0
    found, Q = read_output(tmp_path / "out.csv"), expected_forces(columns)
    assert list(found)[:4] == ["motion", "joint", "rows", "Q_rms"]
    for i, (motion, joint) in enumerate(zip(found["motion"], found["joint"], strict=True)):
        mine = Q[f"{joint}.Q2d"][columns["motion"] == motion]
        assert found["rows"][i] == len(mine)
        assert found["Q2d_peak"][i] == np.abs(mine).max()
        assert found["Q2d_rms"][i] == pytest.approx(np.sqrt(np.mean(mine**2)), rel=1e-14)


def test_motors_by_parts_are_those_of_the_whole(tmp_path, small_parts, monkeypatch):
    path = stored(tmp_path / "states.npz", swings(60))
    options = ("--stiffness", "1000", "--rotor", "0.2")
    with monkeypatch.context() as patch:
        patch.setattr(table_parts, "MIN_LARGE_TABLE_BYTES", 1 << 20)
        assert call("motors", "planar2r", path, "-o", tmp_path / "whole.npz", *options).exit_code == 0
    assert call("motors", "planar2r", path, "-o", tmp_path / "parts", *options).exit_code == 0
    whole, found = read_output(tmp_path / "whole.npz"), read_output(tmp_path / "parts")
    assert list(whole) == list(found)
    assert all(np.array_equal(whole[name], column) for name, column in found.items())
    assert pq.read_schema(tmp_path / "parts" / "part-000000.parquet").field("joint1.tau").metadata == {b"unit": b"N m"}


def test_motors_with_dampers_are_computed_for_motions_as_wholes(tmp_path, small_parts):
    """Deflections follow from all of the motion before."""
    arm = ROBOT.elastic(1e3, rotor=0.2, damping=5.0)
    jounce.save(arm, tmp_path / "arm.yaml")
    path = stored(tmp_path / "states.parquet", swings(60, order=5))
    found = summary("motors", tmp_path / "arm.yaml", path, "-o", tmp_path / "out")
    assert found["parts"] == 1
    along = arm.motors_along(jounce.load_motion(path, arm, 2))
    np.testing.assert_allclose(read_output(tmp_path / "out")["joint2.tau"], along.torques[0][:, 1], rtol=1e-9)


def test_voltages_by_parts_take_the_rate_that_a_table_states(tmp_path, small_parts):
    """With an inductance they take one rate of the torque, and so q5d, which rows may state or not."""
    wound = jounce.Motor(gear=100, inertia=1e-5, resistance=0.5, inductance=2e-3, constant=0.05)
    arm = ROBOT.elastic(1e3, motors={"joint1": wound, "joint2": replace(wound, gear=80)})
    jounce.save(arm, tmp_path / "arm.yaml")
    for order in (2, 3):
        columns = swings(60, order=order)
        path, out = stored(tmp_path / "states.parquet", columns), tmp_path / f"{order}.npz"
        assert summary("motors", tmp_path / "arm.yaml", path, "-o", out)["parts"] > 1
        found = read_output(out)
        assert ("joint1.u" in found) == (order == 3)
    rates = [np.stack([columns[f"{name}.{rate_name('q', k)}"] for name in JOINTS], axis=1) for k in range(6)]
    expected = arm.motor_voltages(*rates)
    for j, name in enumerate(JOINTS):
        np.testing.assert_allclose(found[f"{name}.u"], expected[:, j], rtol=1e-12)


@pytest.mark.parametrize(("deviations", "is_broken"), [(1.5, False), (2.5, True)])
def test_a_limit_counts_as_broken_beyond_two_deviations(tmp_path, deviations, is_broken):
    """Of samples the force is larger than its limit by so many of its standard deviations."""
    t = np.arange(400) / 200
    noise = np.random.default_rng(8).normal(0, 1e-4, (2, len(t)))
    columns = {"t": t, "joint1": np.sin(2 * t) + noise[0], "joint2": np.cos(3 * t) + noise[1]}
    along = ROBOT.forces_along(jounce.load_motion(columns, ROBOT, 0), order=0)
    surest = (np.abs(along.forces[0]) - deviations * along.deviations[0])[:, 0].max()
    jounce.save(ROBOT.with_limits(effort={"joint1": surest}), tmp_path / "arm.yaml")
    path = stored(tmp_path / "log.csv", columns)
    found = summary("run", tmp_path / "arm.yaml", path, "-o", tmp_path / "out.csv", "--order", 0)["broken_limit"]
    assert (found is not None) == is_broken


@pytest.mark.filterwarnings("ignore:.*rounding of .* or t:jounce.JounceWarning")  # of a stretch of a few rows
def test_limits_by_parts_are_those_of_the_whole(tmp_path, small_parts, monkeypatch):
    monkeypatch.setattr("jounce.io.motions.part_rows.MAX_STRETCH_ROWS", 7)
    columns = swings(90)
    path = stored(tmp_path / "states.csv", columns)
    (tmp_path / "limits.yaml").write_text(
        "units: SI\njoints: {joint1: {velocity: 1.9, effort: 30}, joint2: {velocity: 2.0}}"
    )
    limits = ("--limits", tmp_path / "limits.yaml")
    with monkeypatch.context() as patch:
        patch.setattr(table_parts, "MIN_LARGE_TABLE_BYTES", 1 << 20)
        whole = json.loads(call("check", "planar2r", path, *limits, "--json").stdout)
    result = call("check", "planar2r", path, *limits, "-o", tmp_path / "out.csv", "--json")
    found = json.loads(result.stdout)
    assert (result.exit_code, found["ok"], found["broken"]) == (1, False, ["states"])
    for mine, other in zip(found["limits"], whole["limits"], strict=True):
        assert (mine["joint"], mine["limit"]) == (other["joint"], other["limit"])
        assert mine["ratio"] == pytest.approx(other["ratio"], rel=1e-6)
        assert np.allclose(mine["violations"], other["violations"], atol=1e-6)
    assert read_output(tmp_path / "out.csv")["ratio"].tolist() == [row["ratio"] for row in found["limits"]]


def divided(monkeypatch, folder, rows):
    """A table in parts of a few rows, that have chunks of the usual size."""
    monkeypatch.setattr(table_parts, "MAX_PART_CELLS", 200)
    with monkeypatch.context() as patch:
        patch.setattr("jounce.io.parquet.ROWS_PER_GROUP", 13)
        return stored(folder / "states.parquet", swings(rows))


def test_a_part_can_be_sent_to_another_process(tmp_path, monkeypatch):
    """What it makes depends on nothing else than what is sent."""
    path = divided(monkeypatch, tmp_path, 60)
    job = ForceJob(ROBOT, Reading(), ".parquet", 2)
    made = divide_tables(job, path)
    for folder in ("a", "b"):
        (tmp_path / folder / "rows").mkdir(parents=True)
    here = [run.compute_part(job, made.layout, part, tmp_path / "a") for part in made.parts]
    *there, others = pickle.loads(pickle.dumps((job, made.layout, made.parts)))
    assert here == [run.compute_part(*there, part, tmp_path / "b") for part in reversed(others)][::-1]
    assert bytes_of(tmp_path / "a" / "rows") == bytes_of(tmp_path / "b" / "rows")


def trapezoids(rows):
    """Noisy samples of a motion whose accelerations jump, which breaks forces and hides vibrations."""
    plan = jounce.Motion.trapezoidal([[0, 0], [1, 1]], 1.0, 4.0)
    t = np.linspace(plan.start, plan.stop, rows)
    q = plan(t, 0)[0] + np.random.default_rng(3).normal(0, 1e-5, (rows, 2))
    return {"t": t, **dict(zip(JOINTS, q.T, strict=True))}


@pytest.mark.parametrize("table", [swings, trapezoids])
@pytest.mark.parametrize("job", [ForceJob, MotorJob, CheckJob])
@pytest.mark.parametrize("degree", [None, 5])
def test_what_is_kept_of_a_part_is_read_as_it_was(tmp_path, table, job, degree):
    """Peaks, breaks, vibrations and checks are the same to the last bit; half a line, or another one, is none."""
    robot = ROBOT.with_limits(velocity=1.0, snap=1e9).elastic(1e3, rotor=0.1)
    way = None if degree is None or table is swings else select_smoothing(degree, None, None, False, None)
    asked = job(robot, Reading(way=way), None, 2 if job is ForceJob else 0)
    made = divide_tables(asked, stored(tmp_path / "states.csv", table(80)))
    (tmp_path / "rows").mkdir()
    found = run.compute_part(asked, made.layout, made.parts[0], tmp_path)
    line = finished_parts.line_of(found)
    assert finished_parts.parse_line(line) == found
    [result] = found.results.values()
    assert (result.check is not None) == (job is CheckJob)
    assert bool(result.peaks) == (job is not CheckJob)
    assert finished_parts.parse_line(line[:-5]) is None
    assert finished_parts.parse_line(line.replace('"rows": 80', '"rows": 81')) is None


@pytest.mark.filterwarnings("ignore:.*acceleration jumps:jounce.JounceWarning")
def test_warnings_of_finished_parts_are_given_again(tmp_path):
    path, out = stored(tmp_path / "samples.csv", trapezoids(80)), tmp_path / "out"
    found = [summary("run", "planar2r", path, "-o", out, "--degree", 5) for _ in range(2)]
    assert [of["parts_computed"] for of in found] == [1, 0]
    [warning] = found[0]["warnings"]
    assert "acceleration jumps at 3 knots" in warning
    assert found[1]["warnings"] == [warning]


KILLED = """
import os, signal, sys
from jounce.cli import main
from jounce.io import files
from jounce.io.motions import table_parts
from jounce.stream import finished_parts, run
table_parts.MAX_PART_CELLS = 200

def run_killed(module, name, count):
    real = getattr(module, name)
    def killed(*given):
        nonlocal count
        count -= 1
        if count < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*given)
    setattr(module, name, killed)
    main(["run", "planar2r", "states.parquet", "-o", "out"])

lines = int(sys.argv[1])  # those of the parts that are left, and two of the output
for where in ((files, "checksum", 1), (finished_parts, "write_finished", 1), (finished_parts, "line_of", lines)):
    child = os.fork() or run_killed(*where)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    assert not os.path.exists("out")
    print(len([name for name in os.listdir("out.unfinished") if name.endswith(".json")]), flush=True)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no signal is sent like this")
def test_a_killed_run_goes_on_and_ends_as_if_it_had_not_been(tmp_path, monkeypatch):
    """Killed while a part is written, between its rows and its record, and while the output is made."""
    monkeypatch.chdir(tmp_path)
    divided(monkeypatch, tmp_path, 90)
    count = summary("run", "planar2r", "states.parquet", "-o", "whole")["parts"]
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(count)], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.stderr, done.stdout.split()) == ("", ["1", "2", str(count)])  # none is computed twice
    assert summary("run", "planar2r", "states.parquet", "-o", "out")["parts_computed"] == 0
    assert bytes_of(Path("out")) == bytes_of(Path("whole"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "states.parquet", "whole"]


def test_finished_parts_are_kept_and_damaged_ones_computed_again(tmp_path, small_parts, monkeypatch):
    path, out = stored(tmp_path / "states.parquet", swings(90)), tmp_path / "out.csv"
    calls = []
    real = run.compute_part

    def compute(job, layout, part, work):
        calls.append(part.number)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return real(job, layout, part, work)

    monkeypatch.setattr(run, "compute_part", compute)
    assert call("run", "planar2r", path, "-o", out).exit_code == 130
    damaged = run.work_folder(out) / "rows" / "part-000001.csv"
    damaged.write_bytes(damaged.read_bytes()[:-1])
    (run.work_folder(out) / "part-000002.json").write_text("{}")
    calls[:] = [0] * 4
    assert call("run", "planar2r", path, "-o", out).exit_code == 0
    assert calls[4:] == list(range(1, len(calls) - 3))
    assert_output(out, expected_forces(swings(90)))
    os.utime(path, (0, 0))  # another table, for all that can be told: of a folder of them it alone is computed again
    calls[:] = [0] * 4
    assert summary("run", "planar2r", path, "-o", tmp_path / "out")["parts_computed"] == len(calls) - 4
    assert summary("run", "planar2r", path, "-o", tmp_path / "out")["parts_computed"] == 0


def test_parts_without_bad_rows_serve_either_treatment_of_them(tmp_path, small_parts):
    """A run that ends at a bad row is continued by leaving it out; what left rows out serves no run that would not."""
    columns = swings(90)
    columns["joint1.qd"][70] = np.nan
    path, out = stored(tmp_path / "states.csv", columns), tmp_path / "out.csv"
    complaint("run", "planar2r", path, "-o", out)
    kept = len([*run.work_folder(out).glob("part-*.json")])
    found = summary("run", "planar2r", path, "-o", out, "--on-error", "skip")
    assert 0 < kept == found["parts"] - found["parts_computed"]
    assert found["skipped"]["rows"] == 1
    whole = tmp_path / "whole"
    summary("run", "planar2r", path, "-o", whole, "--on-error", "skip")
    assert "column 'joint1.qd' holds" in complaint("run", "planar2r", path, "-o", whole)


def test_a_full_disk_loses_nothing(tmp_path, small_parts, monkeypatch):
    path, out, real = stored(tmp_path / "states.parquet", swings(90)), tmp_path / "out.npz", tables.NPZ.write
    written = []

    def full(target, *given):
        written.append(target)
        if len(written) == 3:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(target, *given)

    with monkeypatch.context() as patch:
        patch.setattr(tables.NPZ, "write", full)
        message = complaint("run", "planar2r", path, "-o", out)
    assert "No space left on device; finished parts are kept, and the same command continues after them" in message
    assert len([*run.work_folder(out).glob("part-*.json")]) == 2
    with monkeypatch.context() as patch:  # while the parts are joined
        patch.setattr(tables.NPZ, "join", full)
        written[:] = [None] * 2
        message = complaint("run", "planar2r", path, "-o", out)
    assert message.startswith(f"{out}: cannot be written: No space left on device; finished parts are kept")
    found = summary("run", "planar2r", path, "-o", out)
    assert found["parts_computed"] == 0
    assert_output(out, expected_forces(swings(90)))


def test_a_full_disk_while_joining_is_no_unreadable_part(tmp_path):
    resource = pytest.importorskip("resource")
    part, before = stored(tmp_path / "part.csv", swings(2000)), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    try:
        with pytest.raises(OSError, match="File too large"):
            tables.CSV.join(tmp_path / "out.csv", [part])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_bad_row_is_named_and_can_be_left_out(tmp_path, small_parts, suffix):
    columns = swings(60)
    columns["joint2.q3d"][41] = np.nan
    columns["t"][50] = columns["t"][49]
    path = stored(tmp_path / f"states{suffix}", columns)
    where = f"{path}:43" if suffix == ".csv" else f"{path}: row 41 from 0"
    message = complaint("run", "planar2r", path, "-o", tmp_path / "out")
    assert f"{where}: column 'joint2.q3d' holds {chr(39) * (suffix == '.csv')}nan" in message
    found = summary("run", "planar2r", path, "-o", tmp_path / "out", "--on-error", "skip")
    assert found["parts_computed"] < found["parts"]  # the good parts before it are kept
    assert found["skipped"] == {"rows": 2, "table": str(tmp_path / "out.skipped.csv")}
    good = np.delete(np.arange(60), [41, 50])
    assert_output(tmp_path / "out", expected_forces({name: column[good] for name, column in columns.items()}))
    rows = list(csv.DictReader((tmp_path / "out.skipped.csv").read_text().splitlines()))
    assert [row["column"] for row in rows] == ["joint2.q3d", "t"]
    assert [int(row["row"]) for row in rows] == [41 + 2 * (suffix == ".csv"), 50 + 2 * (suffix == ".csv")]
    assert (rows[0]["file"], float(rows[0]["joint1.q"])) == (str(path), columns["joint1.q"][41])
    stored(path, swings(60))
    assert summary("run", "planar2r", path, "-o", tmp_path / "out2", "--on-error", "skip")["skipped"]["rows"] == 0


def test_an_infinite_time_ending_a_part_spoils_no_other_row(tmp_path, monkeypatch):
    monkeypatch.setattr(table_parts, "MAX_PART_CELLS", 10 * 11)
    columns = swings(30)
    columns["t"][9] = np.inf
    path = stored(tmp_path / "states.npz", columns)
    found = summary("run", "planar2r", path, "-o", tmp_path / "out", "--on-error", "skip")
    assert (found["parts"], found["skipped"]["rows"], found["states"]) == (3, 1, 29)


def test_rows_of_csv_tables_can_be_broken_in_any_way(tmp_path, small_parts):
    path = stored(tmp_path / "states.csv", swings(30))
    lines = path.read_text().splitlines()
    lines[5] += ",7"
    lines[9] = lines[9].replace(",", ",x", 1)
    lines[12] = "\n" + lines[12]
    lines[20] = ",".join(lines[20].split(",")[:3])
    path.write_text("\n".join(lines))
    assert ":6: 12 cells; expected 11" in complaint("run", "planar2r", path, "-o", tmp_path / "out")
    found = summary("run", "planar2r", path, "-o", tmp_path / "out", "--on-error", "skip")
    assert (found["skipped"]["rows"], found["states"]) == (3, 27)
    rows = list(csv.DictReader((tmp_path / "out.skipped.csv").read_text().splitlines()))
    assert [(row["row"], row["column"]) for row in rows] == [("6", ""), ("10", "joint1.q"), ("22", "")]
    assert rows[1]["joint1.q"].startswith("x")
    assert [float(cell) for cell in list(rows[0].values())[4:]] == [column[4] for column in swings(30).values()]
    assert list(rows[2].values())[4:] == [*lines[20].split(","), *[""] * 8]  # the cells that there are


def test_a_broken_line_does_not_divide_a_motion_of_samples(tmp_path):
    t = np.linspace(0, 2, 60)
    path = stored(tmp_path / "log.csv", {"motion": np.array(["a"] * 60), "t": t, "joint1": np.sin(t), "joint2": t})
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:30], "", *lines[30:]]).replace("\n\n", "\n0\n"))
    out = tmp_path / "out.npz"
    found = summary("run", "planar2r", path, "-o", out, "--on-error", "skip", "--degree", 7)
    assert (found["motions"], found["states"], found["skipped"]["rows"]) == (1, 60, 1)


def test_input_that_cannot_be_read_is_refused_in_one_line(tmp_path, small_parts):
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    assert "no table in this folder" in complaint("run", "planar2r", folder, "-o", out)
    a, b = stored(folder / "a.parquet", swings(30)), folder / "b.parquet"
    other = swings(30)
    del other["joint2.q4d"]
    stored(b, other)
    assert "missing 'joint2.q4d'" in complaint("run", "planar2r", folder, "-o", out)
    stored(b, swings(30, order=3))
    message = complaint("run", "planar2r", folder, "-o", out)
    assert "b.parquet: has a column 'joint1.q5d', 'joint2.q5d' more than a.parquet" in message
    texts = swings(30)
    stored(b, texts | {"joint1.q": np.array(["x"] * 30)})
    assert "b.parquet: column 'joint1.q' holds dictionary" in complaint("run", "planar2r", folder, "-o", out)
    stored(b, {name: column[:0] for name, column in swings(30).items()})
    assert "b.parquet: no rows of numbers" in complaint("run", "planar2r", folder, "-o", out)
    b.write_bytes(a.read_bytes()[: a.stat().st_size // 2])
    assert "b.parquet: not a Parquet table, or a damaged one" in complaint("run", "planar2r", folder, "-o", out)
    assert not out.exists()
    found = summary("run", "planar2r", folder, "-o", out, "--on-error", "skip")
    assert (found["motions"], found["states"], found["skipped"]["rows"]) == (1, 30, 1)
    [row] = csv.DictReader((tmp_path / "out.skipped.csv").read_text().splitlines())
    assert row["file"] == str(b)
    assert "b.parquet: not a Parquet table, or a damaged one" in row["problem"]
    (tmp_path / "limits.yaml").write_text("units: SI\njoints: {joint1: {velocity: 99}}")
    limits = ("--limits", tmp_path / "limits.yaml", "--on-error", "skip")
    assert summary("check", "planar2r", folder, *limits)["skipped"]["rows"] == 1
    shutil.rmtree(out)


def test_compressed_archives_are_read_by_parts_within_a_bound(tmp_path, small_parts, monkeypatch):
    columns = joined(swings(40), swings(50, 1), names=["a", "b"])
    path, out = tmp_path / "states.npz", tmp_path / "out.npz"
    np.savez_compressed(path, **columns)
    assert summary("run", "planar2r", path, "-o", out)["parts"] > 1
    assert_output(out, expected_forces(columns))
    monkeypatch.setattr(npz, "MAX_INFLATED_BYTES", 1000)
    assert "bytes; expected at most 1000" in complaint("run", "planar2r", path, "-o", tmp_path / "other.npz")


def test_a_part_that_cannot_be_read_is_named_and_can_be_left_out(tmp_path, small_parts):
    folder, out = tmp_path / "in", tmp_path / "out.npz"
    folder.mkdir()
    for name in "abc":
        stored(folder / f"{name}.parquet", swings(30))
    b = folder / "b.parquet"
    content = bytearray(b.read_bytes())
    content[4:600] = bytes(596)  # the first row group
    b.write_bytes(content)
    assert "b.parquet: not a Parquet table, or a damaged one" in complaint("run", "planar2r", folder, "-o", out)
    found = summary("run", "planar2r", folder, "-o", out, "--on-error", "skip")
    assert (found["motions"], found["states"], found["skipped"]["rows"]) == (3, 77, 1)
    [row] = csv.DictReader((tmp_path / "out.npz.skipped.csv").read_text().splitlines())
    assert (row["file"], row["row"]) == (str(b), "0")
    assert row["problem"].startswith("the rows of this part from here on: ")


@pytest.mark.parametrize("cells", [200, 1 << 20])
@pytest.mark.parametrize("verb", ["run", "check"])
def test_a_motion_that_begins_again_is_refused(tmp_path, monkeypatch, small_parts, cells, verb):
    monkeypatch.setattr(table_parts, "MAX_PART_CELLS", cells)
    (tmp_path / "limits.yaml").write_text("units: SI\njoints: {joint1: {velocity: 1.9}}")
    path = stored(tmp_path / "a.npz", joined(swings(30), swings(20, 5), swings(30), names=["a", "b", "a"]))
    where = ("-o", tmp_path / "out") if verb == "run" else ("--limits", tmp_path / "limits.yaml")
    assert "motion 'a' goes on at t = 0, and its rows before end at t = 0.28" in complaint(
        verb, "planar2r", path, *where
    )


def test_an_output_folder_with_foreign_files_stays_as_it_is(tmp_path, small_parts):
    path, out = stored(tmp_path / "states.parquet", swings(30)), tmp_path / "out"
    out.mkdir()
    assert call("run", "planar2r", path, "-o", out).exit_code == 0  # it is empty
    assert call("run", "planar2r", path, "-o", out, "--order", "1").exit_code == 0  # it is ours
    assert "joint1.Q2d" not in read_output(out)
    (out / "mine.txt").write_text("mine")
    (tmp_path / "other.skipped.csv").write_text("mine")
    (tmp_path / "in").mkdir()
    bad_rows = "other.skipped.csv: bad rows are written there, and it is not of an earlier run; move it away"
    refused(tmp_path, "run planar2r states.parquet -o out", "files that are not of an earlier run (mine.txt)")
    refused(tmp_path, "run planar2r states.parquet -o states.parquet --on-error skip", "the output is the input")
    refused(tmp_path, "run planar2r states.parquet -o other --on-error skip", bad_rows)
    refused(tmp_path, "run planar2r in -o in/out", "or inside its folder")


@pytest.mark.parametrize("exists", [True, False])
def test_an_output_that_is_a_link_stays_one(tmp_path, small_parts, exists):
    path, link, elsewhere = stored(tmp_path / "states.parquet", swings(30)), tmp_path / "link", tmp_path / "elsewhere"
    if exists:
        elsewhere.mkdir()
    link.symlink_to(elsewhere)
    assert call("run", "planar2r", path, "-o", link).exit_code == 0
    assert link.is_symlink()
    assert_output(elsewhere, expected_forces(swings(30)))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["elsewhere", "link", "states.parquet"]


def test_other_programs_read_what_is_written(tmp_path, small_parts):
    columns = joined(swings(90), swings(40, 5), names=["a", "c"])
    path = stored(tmp_path / "states.parquet", columns)
    assert call("run", "planar2r", path, "-o", tmp_path / "out").exit_code == 0
    source = f"'{tmp_path}/out/*.parquet' group by motion order by motion"
    query = f'select motion, max(abs("joint1.Q2d")), count(*) from {source}'
    Q = expected_forces(columns)
    of = {name: np.abs(Q["joint1.Q2d"][columns["motion"] == name]) for name in "ac"}
    assert duckdb.sql(query).fetchall() == [(name, x.max(), len(x)) for name, x in of.items()]
    schema = pq.read_schema(tmp_path / "out" / "part-000000.parquet")
    about = json.loads(schema.metadata[b"jounce"])
    assert (about["robot"], about["joints"], about["order"]) == ("planar2r", list(JOINTS), 2)
    assert about["units"]["joint1.Qd"] == "N m/s"
    assert schema.field("joint2.Q2d").metadata == {b"unit": b"N m/s^2"}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_memory_does_not_grow_with_the_number_of_rows(tmp_path, monkeypatch, suffix):
    monkeypatch.setattr(table_parts, "MAX_PART_CELLS", 1 << 12)
    monkeypatch.setattr("jounce.io.parquet.ROWS_PER_GROUP", 300)
    monkeypatch.setattr("jounce.io.csv.BLOCK_BYTES", 1 << 16)
    peaks = []
    for rows in (1_000, 1_000, 5_000):
        path = stored(tmp_path / f"states{suffix}", swings(rows))
        tracemalloc.start()
        assert call("run", "planar2r", path, "-o", tmp_path / "out.csv", "--on-error", "skip").exit_code == 0
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < 1.5 * peaks[1]


def test_small_parquet_tables_are_read_and_written_as_others_are(tmp_path):
    path, t = tmp_path / "log.parquet", np.linspace(0, 2, 120)
    log = {"t": t, "joint1": np.sin(2 * t), "joint2": np.cos(t)}
    for name in (path, tmp_path / "log.csv"):
        tables.write(name, log)
    assert call("run", "planar2r", path, "-o", tmp_path / "a.parquet").exit_code == 0
    assert call("run", "planar2r", tmp_path / "log.csv", "-o", tmp_path / "b.csv").exit_code == 0
    assert_output(tmp_path / "a.parquet", read_output(tmp_path / "b.csv"))
    assert json.loads(pq.read_schema(tmp_path / "a.parquet").metadata[b"jounce"])["units"]["joint2.Q"] == "N m"


def test_parquet_without_pyarrow_says_how_to_get_it(tmp_path, monkeypatch):
    path = stored(tmp_path / "states.parquet", swings(30))
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    words = "Parquet needs pyarrow; install it by: pip install 'jounce[tables]'$"
    refused(tmp_path, ["run", "planar2r", path, "-o", tmp_path / "out.csv"], words)


def test_large_tables_of_rates_are_read_by_parts(tmp_path, small_parts, monkeypatch):
    """Which changes none of the bytes that are written."""
    path = stored(tmp_path / "states.csv", swings(60))
    monkeypatch.setattr(table_parts, "MIN_LARGE_TABLE_BYTES", 100_000)
    before = call("run", "planar2r", path, "-o", tmp_path / "a.csv")
    monkeypatch.setattr(table_parts, "MIN_LARGE_TABLE_BYTES", 1000)
    found = summary("run", "planar2r", path, "-o", tmp_path / "b.csv")
    assert found["parts"] > 1
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert before.exit_code == 0


HELD = """
import sys
from pathlib import Path
from jounce.io.files import hold_lock

with hold_lock(Path("out.csv.unfinished"), Path("out.csv")):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no locks of files there")
def test_a_second_run_into_one_output_is_refused_until_the_end(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["run", "planar2r", stored(tmp_path / "states.csv", swings(9)), "-o", "out.csv", "--on-error", "skip"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", HELD], **pipes) as first:
        assert first.stdout.readline() == b"held\n"
        assert f"out.csv: another run writes there (process {first.pid})" in complaint(*words)
        first.kill()  # its file stays on the disk
    assert (tmp_path / "out.csv.unfinished" / "_jounce.lock").exists()
    assert call(*words).exit_code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.csv", "states.csv"]
    assert call(*words).exit_code == 0


@pytest.mark.skipif(sys.platform == "win32", reason="no locks of files there")
def test_a_lock_whose_file_another_run_removes_is_taken_again(tmp_path, monkeypatch):
    """The other run ends between the opening of the file and its lock: a third one would lock a new file."""
    import fcntl

    lock, taken = fcntl.flock, []

    def late(file, how):
        if not taken:
            (tmp_path / "work" / files.LOCK_FILE).unlink()
        taken.append(file)
        lock(file, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with files.hold_lock(tmp_path / "work", tmp_path / "out.csv"):
        assert len(taken) == 2
        with expect_refusal("another run writes there"), files.hold_lock(tmp_path / "work", tmp_path):
            pass


@pytest.mark.parametrize("code", ["of another release", None], ids=["other code", "unknown code"])
def test_records_of_another_form_are_computed_again(tmp_path, small_parts, monkeypatch, code):
    """A run that is continued after an upgrade: results of limits had no share that is judged."""
    path, out = stored(tmp_path / "states.csv", swings(90)), tmp_path / "out.csv"
    (tmp_path / "limits.yaml").write_text("units: SI\njoints: {joint1: {velocity: 1.9}, joint2: {velocity: 2.0}}")
    words = ("check", "planar2r", path, "--limits", tmp_path / "limits.yaml", "-o", out, "--json")
    whole = json.loads(call(*words).stdout)
    table_of_whole = out.read_bytes()
    out.unlink()
    real, calls, line_of = run.compute_part, [], finished_parts.line_of

    def compute(job, layout, part, work):
        calls.append(part.number)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(job, layout, part, work)

    def old(found):
        kept = json.loads(line_of(found))
        for of in kept["part"]["results"].values():
            del of["check"]["judged"]
        return json.dumps({"digest": digest(kept["part"]), "part": kept["part"]})

    with monkeypatch.context() as patch:
        patch.setattr("jounce.core.code_digest.code_digest", lambda *layers: code)
        patch.setattr(finished_parts, "line_of", old)
        patch.setattr(run, "compute_part", compute)
        assert call(*words).exit_code == 130
    assert len([*run.work_folder(out).glob("part-*.json")]) == 2
    result = call(*words)
    assert json.loads(result.stdout) == whole
    assert out.read_bytes() == table_of_whole


def test_code_that_is_not_known_continues_no_run(tmp_path, monkeypatch):
    keys = {ForceJob(ROBOT, Reading(), ".csv", 2).key for _ in range(2)}
    assert len(keys) == 1
    monkeypatch.setattr("jounce.core.code_digest.code_digest", lambda *layers: None)
    assert len(keys | {ForceJob(ROBOT, Reading(), ".csv", 2).key for _ in range(2)}) == 3


def test_limits_are_checked_wherever_parts_end(tmp_path, monkeypatch):
    """A part may hold the last row of a motion alone, of which the part before has taken account."""
    path, limits = (
        stored(tmp_path / "states.csv", joined(swings(23), swings(9, 3), names=["a", "b"])),
        tmp_path / "l.json",
    )
    limits.write_text('{"units": "SI", "joints": {"joint1": {"velocity": 0.1}}}')
    found = set()
    for cells in range(20, 120, 7):
        monkeypatch.setattr(table_parts, "MAX_PART_CELLS", cells)
        monkeypatch.setattr(table_parts, "MIN_LARGE_TABLE_BYTES", 0)
        out = tmp_path / f"{cells}.csv"
        assert call("check", "planar2r", path, "--limits", limits, "-o", out).exit_code == 1
        found.add(out.read_bytes())
    assert len(found) == 1


@pytest.mark.parametrize("rows", [7, 8, 9])
def test_motions_of_one_row_are_refused_wherever_they_lie(tmp_path, monkeypatch, rows):
    """A part that begins with such a motion is not behind a part that has checked it."""
    path, limits = tmp_path / "states.csv", tmp_path / "l.json"
    stored(path, joined(swings(rows), swings(1, 2), swings(9, 3), names=["a", "b", "c"]))
    limits.write_text('{"units": "SI", "joints": {"joint1": {"velocity": 0.1}}}')
    monkeypatch.setattr(table_parts, "MIN_LARGE_TABLE_BYTES", 0)
    for cells in range(20, 120, 7):
        monkeypatch.setattr(table_parts, "MAX_PART_CELLS", cells)
        refused = call("check", "planar2r", path, "--limits", limits, "-o", tmp_path / "out.csv")
        assert refused.exit_code == 2, cells
        assert "motion 'b' has one row" in refused.stderr
