"""Rows of logs at the borders of what is decided: disorder, stamps, missing cells, names, and rates by differences."""

import csv
import json
from itertools import combinations

import numpy as np
import pytest

import jounce
from jounce.io import tables
from jounce.io.motions import logs
from support.commands import call, run
from support.refusals import expect_refusal, refusal
from support.states import sine_rates

ROBOT = jounce.load("planar2r")
T = np.arange(300) / 100
PLAIN = {"t": T, "joint1": np.sin(2 * T), "joint2": 0.5 * np.cos(3 * T)}
RATES = ("q", "qd", "q2d", "q3d", "q4d")


def exact_columns(t, order=4):
    """All rates of both joints by column."""
    found = sine_rates(t, order, [0.8, 0.5], [2, 3])
    return {f"joint{j + 1}.{RATES[k]}": x[:, j] for k, x in enumerate(found) for j in (0, 1)}


def with_late_row(rows):
    """Samples of which one stamp is so many rows earlier than the latest before it."""
    t = T.copy()
    t[150] = t[149] - rows / 100
    return PLAIN | {"t": t, "joint1": np.sin(2 * t), "joint2": 0.5 * np.cos(3 * t)}


def notes(columns, **options):
    return jounce.load_motion(columns, ROBOT, 0, **options).notes


@pytest.mark.parametrize("rows", [0.1, 0.9])
def test_rows_out_of_order_by_less_than_a_row_are_sorted(rows):
    motion = jounce.load_motion(with_late_row(rows), ROBOT, 0)
    [note] = [note for note in motion.notes if "out of order" in note]
    assert note.startswith(f"1 of 300 rows out of order by up to {rows / 100:.2g} s")
    assert np.array_equal(motion.times, np.sort(with_late_row(rows)["t"]))


@pytest.mark.parametrize("rows", [1.1, 20])
def test_rows_out_of_order_by_more_are_refused_or_left_out(rows):
    columns = with_late_row(rows)
    refusal(lambda: notes(columns), "the motion: row 150 from 0: column 't' does not increase: ", "on_error='skip'")
    motion = jounce.load_motion(columns, ROBOT, 0, on_error="skip")
    assert np.array_equal(motion.times, np.delete(columns["t"], 150))
    assert "1 of 300 rows left out: the motion: row 150 from 0" in motion.notes[0]


def test_neighbours_that_changed_places_are_sorted_however_far_apart():
    t = np.concatenate([T[:150], T[150:] + 0.02])  # 0.03 s between rows 149 and 150
    gap = PLAIN | {"t": t, "joint1": np.sin(2 * t), "joint2": 0.5 * np.cos(3 * t)}
    order = np.r_[:149, 150, 149, 151:300]
    columns = {name: x[order] for name, x in gap.items()}
    motion = jounce.load_motion(columns, ROBOT, 0, degree=5)
    assert motion.notes[0] == "1 of 300 rows out of order by up to 0.03 s; sorted by their stamps"
    assert np.array_equal(motion.times, t)
    beyond = np.r_[:148, 150, 148, 149, 151:300]  # two places
    columns = {name: x[beyond] for name, x in gap.items()}
    refusal(lambda: notes(columns), "does not increase: 1.52 comes before 1.48")


def test_bursts_of_rows_are_sorted_within_the_time_between_rows():
    """Rows that are written together pass several others in little time."""
    t = T.copy()
    t[150:155] = 1.5 + np.array([0.0, 2e-3, 4e-3, 6e-3, 8e-3])
    mixed = np.r_[:151, 154, 151:154, 155:300]  # three places, 6 ms of 10 ms
    columns = PLAIN | {"t": t, "joint1": np.sin(2 * t), "joint2": 0.5 * np.cos(3 * t)}
    motion = jounce.load_motion({name: x[mixed] for name, x in columns.items()}, ROBOT, 0, degree=5)
    assert motion.notes[0] == "1 of 300 rows out of order by up to 0.006 s; sorted by their stamps"
    assert np.array_equal(motion.times, t)


def test_pairs_are_sorted_and_a_reversed_log_is_not():
    pairs = np.arange(300).reshape(-1, 2)[:, ::-1].ravel()
    motion = jounce.load_motion({name: x[pairs] for name, x in PLAIN.items()}, ROBOT, 0)
    assert motion.notes[0] == "150 of 300 rows out of order by up to 0.01 s; sorted by their stamps"
    assert np.array_equal(motion.times, T)
    refusal(lambda: notes({name: x[::-1] for name, x in PLAIN.items()}), "column 't' does not increase: ")


def test_stamps_of_plans_do_not_scatter():
    t = T.copy()
    t[[150, 151]] = t[[151, 150]]
    with expect_refusal("row 150 from 0: column 't' does not increase: 1.51 comes before 1.5", "skip"):
        notes({"t": t} | exact_columns(t))
    assert len(jounce.load_motion({"t": t} | exact_columns(t), ROBOT, on_error="skip").times) == 299


def test_faults_of_both_kinds_are_found_together():
    columns = with_late_row(3)
    columns["t"][20] = 1e4
    motion = jounce.load_motion(columns, ROBOT, 0, on_error="skip")
    assert np.array_equal(motion.times, np.delete(columns["t"], [20, 150]))


def test_one_wild_stamp_costs_one_row_whichever_way_it_goes():
    for stamp in (-7.0, 1e4):
        t = T.copy()
        t[20] = stamp
        motion = jounce.load_motion(PLAIN | {"t": t}, ROBOT, 0, on_error="skip")
        assert len(motion.times) == 299
        assert not any("out of order" in note for note in motion.notes)


def test_rows_of_one_stamp_are_refused_or_left_out_but_the_first():
    twice = {name: x[np.insert(np.arange(300), 100, [99, 99])] for name, x in PLAIN.items()}
    refusal(lambda: notes(twice), "row 100 from 0: column 't' does not increase: 0.99 follows 0.99", "on_error='skip'")
    motion = jounce.load_motion(twice, ROBOT, 0, on_error="skip")
    assert np.array_equal(motion.times, T)
    assert motion.notes[0].startswith("2 of 302 rows left out, the first: ")


FORMS = {
    "Z": "2024-11-22T15:00:{:09.6f}Z",
    "zone": "2024-11-22T16:00:{:09.6f}+01:00",
    "short zone": "2024-11-22T16:00:{:09.6f}+0100",
    "no zone": "2024-11-22 15:00:{:09.6f}",
    "nanoseconds": "2024-11-22T15:00:{:012.9f}Z",
}


def write_rows(path, stamps):
    rows = [
        {"t": stamp, "joint1": a, "joint2": b} for stamp, a, b in zip(stamps, *list(PLAIN.values())[1:], strict=True)
    ]
    if path.suffix == ".jsonl":
        path.write_text("\n".join(json.dumps({k: v if k == "t" else float(v) for k, v in row.items()}) for row in rows))
    else:
        path.write_text("\n".join(["t,joint1,joint2", *(",".join(map(str, row.values())) for row in rows)]))
    return path


@pytest.mark.parametrize("suffix", [".csv", ".jsonl"])
@pytest.mark.parametrize("form", FORMS)
def test_iso_stamps_keep_their_digits(tmp_path, form, suffix):
    path = write_rows(tmp_path / f"log{suffix}", [FORMS[form].format(t) for t in T])
    motion = jounce.load_motion(path, ROBOT, 0)
    assert np.abs(motion.times - T).max() < 1e-12
    assert "times are since the first row, at 1732287600 s, 2024-11-22 15:00:00 UTC" in motion.notes
    words = "log.", "column 't' holds ISO 8601 stamps, '2024-11-22", "leave time_unit out"
    refusal(lambda: jounce.load_motion(path, ROBOT, 0, time_unit="ms"), *words)


def test_stamps_that_are_no_dates_are_refused(tmp_path):
    path = write_rows(tmp_path / "log.csv", [f"2024-13-22T15:00:{t:09.6f}" for t in T])
    refusal(lambda: jounce.load_motion(path, ROBOT, 0), "log.csv:2: column 't' holds '2024-13-22T15:00:00.000000'")


@pytest.mark.parametrize("cell", ["", "nan", "NULL"])
def test_rows_without_any_position_are_left_out_and_others_not(tmp_path, cell):
    path = write_rows(tmp_path / "log.csv", T.tolist())
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:50], f"0.485,{cell},{cell}", *lines[50:]]))
    assert jounce.load_motion(path, ROBOT, 0).notes[0] == "1 of 301 rows state no position; left out"
    path.write_text("\n".join([*lines[:50], f"0.485,{cell},1.5", *lines[50:]]))
    with expect_refusal(f"log.csv:51: column 'joint1' holds {cell!r}", "on_error='skip'"):
        jounce.load_motion(path, ROBOT, 0)
    path.write_text("\n".join([lines[0], *(f"{t},{cell},{cell}" for t in T)]))
    refusal(lambda: jounce.load_motion(path, ROBOT, 0, on_error="skip"), "no position in this row, nor in any other")


@pytest.mark.filterwarnings("default::jounce.JounceWarning")
def test_parts_and_wholes_are_read_alike(tmp_path):
    """With all that is decided: a folder is read by parts, a file as a whole."""
    rng = np.random.default_rng(3)
    columns = with_late_row(0.5) | {"tau_joint1": 3 + T}
    columns |= {name: columns[name] + 1e-4 * rng.normal(size=300) for name in ("joint1", "joint2")}
    columns["tau_joint1"][40] = np.nan
    for name in ("joint1", "joint2", "tau_joint1"):
        columns[name][60] = np.nan
    (tmp_path / "in").mkdir()
    path = tmp_path / "in" / "log.csv"
    with path.open("w") as file:
        csv.writer(file).writerows([list(columns), *zip(*(x.tolist() for x in columns.values()), strict=True)])
    found = {}
    for source, words in ((path, ()), (path.parent, ()), (path, ("--on-error", "skip"))):
        result = call("run", "planar2r", source, "-o", tmp_path / "out.csv", "--order", 0, "--json", *words)
        assert result.exit_code == 0, result.output
        summary = json.loads(result.stdout)
        said = {note.split(": ", 1)[-1] if "state no position" in note else note for note in summary["warnings"]}
        found[source, words] = {*summary["notes"]} | said, summary["states"], summary["peaks"]
    whole, *parts = found.values()
    assert {"measured torques missing, left out there: 1 of 299 of joint1"} < whole[0]
    assert any("out of order" in note for note in whole[0])
    assert parts == [whole, whole]


def test_measured_torques_have_the_holes_of_the_log(tmp_path):
    columns = PLAIN | {"tau_joint1": 3 + T, "tau_joint2": T.copy()}
    columns["tau_joint2"][100:120] = np.inf
    motion = jounce.load_motion(columns, ROBOT, 0)
    assert motion.notes[0] == "measured torques missing, left out there: 20 of 300 of joint2"
    np.savez(tmp_path / "log.npz", **columns)
    assert call("run", "planar2r", tmp_path / "log.npz", "-o", tmp_path / "out.npz", "--order", 0).exit_code == 0
    found = tables.read(tmp_path / "out.npz", missing=["_measured"])
    assert np.flatnonzero(np.isnan(found["joint2.Q_measured"])).tolist() == list(range(100, 120))
    assert np.array_equal(found["joint1.Q_measured"], 3 + T)
    picture = tmp_path / "out.png"
    assert call("plot", tmp_path / "out.npz", "-o", picture).exit_code == 0
    assert picture.exists()


@pytest.mark.filterwarnings("default::jounce.JounceWarning")
def test_plots_leave_bad_rows_out_on_request(tmp_path):
    path = tmp_path / "forces.csv"
    path.write_text("t,joint1.Q\n0,1\n1,x\n2,3\n3,2\n")
    result = call("plot", path, "-o", tmp_path / "out.png")
    assert "forces.csv:3: column 'joint1.Q' holds 'x'" in result.stderr
    assert "--on-error skip" in result.stderr
    result = call("plot", path, "-o", tmp_path / "out.png", "--on-error", "skip", "--json")
    assert json.loads(result.stdout)["states"] == [3]
    assert "Warning: 1 of 4 rows left out" in result.stderr


def test_a_prefix_is_mapped_wherever_it_stands():
    arm = jounce.load("iiwa14")
    q = {name: np.sin(T + i) for i, name in enumerate(arm.joint_names)}
    log = {"t": T, "tau_lbr_joint2": T, "lbr_joint10": T} | {f"lbr_{name}": x for name, x in q.items()}
    motion = jounce.load_motion(log, arm, 0, rename={"lbr_*": "*"})
    assert motion.notes[0] == "other columns, ignored: lbr_joint10"
    assert np.array_equal(motion.torques[1][:, 1], T)
    assert np.array_equal(motion.samples[1][:, 2], q["joint3"])
    log = {"t": T} | {f"q_lbr_{name} [rad]": x for name, x in q.items()}
    assert np.array_equal(
        jounce.load_motion(log, arm, 0, rename={"lbr_*": "*"}, columns="q_{joint}").samples[1][:, 2], q["joint3"]
    )
    log = {"t": T} | {f"A{i}": x for i, x in enumerate(q.values(), 1)}
    refusal(lambda: jounce.load_motion(log, arm, 0), "try: columns='A{number}'")
    assert np.array_equal(jounce.load_motion(log, arm, 0, rename={"A*": "joint*"}).samples[1][:, 2], q["joint3"])


WRONG = {
    "another way with errors": ({"on_error": "ignore"}, ["unknown on_error 'ignore'", "stop, skip"]),
}  # fmt: skip


@pytest.mark.parametrize(("options", "words"), WRONG.values(), ids=WRONG)
def test_refuses(options, words):
    refusal(lambda: notes(PLAIN, **options), *words)


@pytest.mark.parametrize("pattern", ["q{number} [deg]", "q{number}[deg]", "q{number} (deg)", "q{number}"])
def test_patterns_may_have_the_unit_of_the_header(pattern):
    log = {"t": T, "q1 [deg]": np.rad2deg(PLAIN["joint1"]), "q2 [deg]": np.rad2deg(PLAIN["joint2"]), "m1 [N m]": T}
    motion = jounce.load_motion(log, ROBOT, 0, columns=pattern, torques="m{number} [N m]")
    np.testing.assert_allclose(motion.samples[1][:, 0], PLAIN["joint1"], atol=1e-12)
    assert np.array_equal(motion.torques[1][:, 0], T)
    refusal(lambda: jounce.load_motion(log, ROBOT, 0, columns="q{number} [rad]"), "no column 'q1 [rad]', 'q2 [rad]'")


def in_degrees_from(row, by, size=1.0):
    """Samples that become so many times as large at a row."""
    factor = np.where(np.arange(300) < row, 1.0, by)
    return {"t": T, "joint1": factor * size * (0.9 + 0.3 * np.sin(T)), "joint2": factor * size * np.cos(T)}


DEGREES = 180 / np.pi


@pytest.mark.parametrize("by", [DEGREES, 1 / DEGREES])
def test_a_change_of_unit_is_refused(by):
    name = "degrees" if by > 1 else "radians"
    words = "row 100 from 0", "angles become " + name, "write all rows in one unit"
    refusal(lambda: notes(in_degrees_from(100, by)), *words)
    refusal(lambda: notes(in_degrees_from(100, by), angles="rad"), *words)
    plan = {f"{name}.{rate}": x for name, x in list(in_degrees_from(100, by).items())[1:] for rate in RATES[:1]}
    plan |= {f"{name}.{rate}": 0 * T for name in ("joint1", "joint2") for rate in RATES[1:]}
    refusal(lambda: jounce.load_motion({"t": T} | plan, ROBOT, angles="rad"), *words)


@pytest.mark.filterwarnings("ignore::jounce.JounceWarning")
@pytest.mark.parametrize("by", [0.9 * DEGREES, 1.1 * DEGREES])
def test_other_jumps_are_no_change_of_unit(by):
    jounce.load_motion(in_degrees_from(100, by), ROBOT, 0, angles="rad", degree=5)


@pytest.mark.filterwarnings("ignore::jounce.JounceWarning")
def test_a_jump_to_zero_is_no_change_of_unit():
    """Of a step, what is left there is a small share, and of the angles in degrees all."""
    there = np.where(np.arange(300) < 100, 1.0, 0.0)
    jounce.load_motion({"t": T, "joint1": there, "joint2": -there}, ROBOT, 0, angles="rad", degree=5)


@pytest.mark.filterwarnings("ignore::jounce.JounceWarning")
@pytest.mark.parametrize(("size", "refused"), [(1.5e-3, False), (1.6e-3, True)])
def test_small_changes_of_unit_do_no_harm(size, refused):
    """The largest step is 57.3 - 1 times 1.15 of this size: below and above 0.1 rad."""
    load = lambda: notes(in_degrees_from(100, DEGREES, size), degree=5)  # noqa: E731
    refusal(load, "angles become degrees") if refused else load()


def test_jerk_by_differences_of_accelerations(tmp_path):
    """One-sided: exact where jerk is constant between rows, else off by half a step of q4d."""
    rates = exact_columns(T, 2)
    motion = jounce.load_motion({"t": T} | rates, ROBOT, 1)
    q3d = motion(T, 3)[3]
    for j, name in enumerate(("joint1", "joint2")):
        assert np.array_equal(q3d[:-1, j], np.diff(rates[f"{name}.q2d"]) / np.diff(T))
        assert np.abs(q3d[:-1, j] - exact_columns(T)[f"{name}.q3d"][:-1]).max() < 0.51 * 0.01 * 40.5
    assert motion.notes[0].startswith(
        "q3d is the difference of q2d to the next row, and changes by up to 0.4 of joint2"
    )
    assert notes({"t": T} | rates) == ()
    refusal(lambda: jounce.load_motion({"t": T} | rates, ROBOT), "'joint1.q4d'", "order=1 takes q3d")
    partly = rates | {"joint1.q3d": T}
    refusal(lambda: jounce.load_motion({"t": T} | partly, ROBOT, 1), "missing 'joint2.q3d'")
    (tmp_path / "in").mkdir()
    tables.write(tmp_path / "in" / "plan.csv", {"t": T} | rates)
    found = []
    for source in (tmp_path / "in" / "plan.csv", tmp_path / "in"):
        result = call("run", "planar2r", source, "-o", tmp_path / "out.npz", "--order", 1, "--json")
        assert result.exit_code == 0, result.output
        found.append([json.loads(result.stdout)[key] for key in ("notes", "peaks", "states")])
    assert found[0] == found[1]
    assert found[0][0][0].startswith("q3d is the difference")


def test_rows_of_other_tables_are_left_out_too(tmp_path):
    path = write_rows(tmp_path / "log.jsonl", T.tolist())
    lines = path.read_text().splitlines()
    lines[7], lines[9] = (
        lines[7].replace('"joint2"', '"other"'),
        lines[9].replace('"joint1": ', '"joint1": null, "x": '),
    )
    path.write_text("\n".join(lines))
    refusal(lambda: jounce.load_motion(path, ROBOT, 0), "log.jsonl:8: no 'joint2' in this row", "on_error='skip'")
    motion = jounce.load_motion(path, ROBOT, 0, on_error="skip")
    assert motion.notes[0].startswith(f"2 of 300 rows left out, the first: {path}:8: no 'joint2'")
    result = call("run", "planar2r", path, "-o", tmp_path / "out.csv", "--order", 0, "--on-error", "skip")
    assert "2 of 300 rows left out" in result.output


def test_as_few_rows_as_possible_are_wrong():
    rng = np.random.default_rng(1)
    for _ in range(100):
        t = rng.permutation(rng.integers(2, 9)).astype(float)
        kept = logs._find_increasing(t)
        assert (np.diff(t[kept]) > 0).all()
        assert (np.diff(kept) > 0).all()
        larger = combinations(range(len(t)), len(kept) + 1)
        assert not any((np.diff(t[list(rows)]) > 0).all() for rows in larger)


@pytest.mark.filterwarnings("ignore:.*equal to the one before:jounce.JounceWarning")
@pytest.mark.parametrize("with_rates", [False, True])
@pytest.mark.parametrize("count", [1, 3])
def test_a_last_row_that_is_there_twice_is_left_out(tmp_path, with_rates, count):
    """As samples, with all rates in memory and by parts: the same motion as without these rows."""
    t = np.linspace(0, 1, 101)
    rates = {"": np.sin(t)} if not with_rates else {".q": np.sin(t), ".qd": np.cos(t), ".q2d": -np.sin(t)}
    columns = {"t": t} | {f"joint{j}{rate}": x for j in (1, 2) for rate, x in rates.items()}
    robot = jounce.load("planar2r")
    plain = jounce.load_motion(columns, robot, order=0)
    ended = {name: np.append(x, np.repeat(x[-1], count)) for name, x in columns.items()}
    found = jounce.load_motion(ended, robot, order=0)
    assert f"the last {count} of {101 + count} rows: equal to the one before, also in time; left out" in found.notes
    np.testing.assert_array_equal(found(t, 2), plain(t, 2))
    tables.write(tmp_path / "plain.csv", columns)
    tables.write(tmp_path / "ended.csv", ended)
    for name in ("plain", "ended"):
        words = "run", "planar2r", tmp_path / f"{name}.csv", "--order", 0, "--on-error", "skip", "-o"
        run(*words, tmp_path / f"{name}.out.csv")
    assert (tmp_path / "plain.out.csv").read_bytes() == (tmp_path / "ended.out.csv").read_bytes()
    different = {name: np.append(x, x[-1] + 1e-3 * (name != "t")) for name, x in columns.items()}
    refusal(lambda: jounce.load_motion(different, robot, order=0), "does not increase", "on_error='skip'")
    assert len(jounce.load_motion(different, robot, order=0, on_error="skip").times) == 101
