"""The largest values of `run`, `motion`, `check`: when they are, which lie in uncertain ends, and the certain ones."""

import json

import numpy as np
import pytest

import jounce
from jounce.cli.summaries import UNCERTAIN_MARK
from jounce.io import tables
from jounce.motion import reliability
from jounce.spatial.series import rate_name
from support.commands import call
from support.logs import blended_harmonics

ROBOT = jounce.load("planar2r").with_limits(acceleration=60.0, snap=900.0)
T = np.arange(0, 8, 2e-3)


def fast_start(t, k=0):
    """From rest into harmonics within half a second."""
    return blended_harmonics(np.random.default_rng(0))(t, k)[:, :2]


@pytest.fixture(scope="module")
def rates_folder(tmp_path_factory):
    """A log whose noise hides q4d of the fast start; one with less noise; and the motion with all rates, exact."""
    found, random = tmp_path_factory.mktemp("largest"), np.random.default_rng(0)
    blended_harmonics(random)  # noise of other numbers than those of the motion
    for name, noise in (("log", 3e-5), ("quiet", 1e-6)):
        q = fast_start(T) + noise * random.normal(size=(len(T), 2))
        tables.write(found / f"{name}.csv", {"t": T, "joint1": q[:, 0], "joint2": q[:, 1]})
    rates = {f"joint{j + 1}.{rate_name('q', k)}": fast_start(T, k)[:, j] for j in range(2) for k in range(5)}
    tables.write(found / "exact.csv", {"t": T, **rates})
    jounce.save(ROBOT, found / "arm.yaml")
    return found


def asked(folder, verb, motion, *words):
    result = call(verb, folder / "arm.yaml", folder / motion, *words)
    assert result.exit_code in (0, 1, 3), result.output
    return result.stdout


@pytest.mark.parametrize(("verb", "symbol", "order"), [("run", "Q", 2), ("motion", "q", 4)])
def test_largest_values_are_those_of_the_table(rates_folder, verb, symbol, order):
    found = json.loads(asked(rates_folder, verb, "log.csv", "-o", rates_folder / f"{verb}.csv", "--json"))
    columns, marked = tables.read(rates_folder / f"{verb}.csv"), []
    t = columns["t"]
    for name in ROBOT.joint_names:
        for k in range(order + 1):
            rate = rate_name(symbol, k)
            x, off = np.abs(columns[f"{name}.{rate}"]), columns[f"{name}.{rate}_sd"]
            largest, certain = found["largest"][name][rate], found["certain"][name][rate]
            at = np.argmax(x - 1.96 * off)
            assert (largest["value"], largest["deviation"], largest["t"]) == (x[at], pytest.approx(off[at]), t[at])
            assert certain["value"] - 1.96 * certain["deviation"] <= largest["value"] - 1.96 * largest["deviation"]
            marked += [rate] if certain != largest else []
    assert rate_name(symbol, order) in marked
    assert symbol not in marked
    said = asked(rates_folder, verb, "log.csv", "-o", rates_folder / f"{verb}.csv")
    assert said.count(" * ") == len(marked)
    assert UNCERTAIN_MARK in said


@pytest.mark.parametrize(("verb", "rate"), [("run", "Q2d"), ("motion", "q4d")])
def test_certain_values_are_true(rates_folder, verb, rate):
    found = json.loads(asked(rates_folder, verb, "log.csv", "-o", rates_folder / "out.csv", "--json"))
    for j, name in enumerate(ROBOT.joint_names):
        largest, certain = found["largest"][name][rate], found["certain"][name][rate]
        assert (largest["deviation"] > 0.05 * largest["value"]) == (largest != certain)
        at = [fast_start(np.array([certain["t"]]), k) for k in range(5)]
        true = abs((ROBOT.inverse_dynamics(*at)[2] if verb == "run" else at[4])[0, j])
        assert abs(certain["value"] - true) < 4 * certain["deviation"]
        assert certain["deviation"] < 0.05 * certain["value"]
    assert any(found["largest"][name][rate] != found["certain"][name][rate] for name in ROBOT.joint_names)
    if verb == "motion":
        assert found["largest"]["joint2"][rate]["value"] > 10 * np.abs(fast_start(T, 4)[:, 1]).max()


def test_a_fast_start_that_is_known_well_is_no_uncertain_end(rates_folder):
    found = json.loads(asked(rates_folder, "motion", "quiet.csv", "-o", rates_folder / "out.csv", "--json"))
    largest = found["largest"]["joint2"]["q4d"]
    assert largest == found["certain"]["joint2"]["q4d"]
    assert largest["value"] == pytest.approx(np.abs(fast_start(T, 4)[:, 1]).max(), rel=0.01)
    assert largest["t"] < 0.5


@pytest.mark.parametrize("verb", ["run", "motion"])
def test_exact_motions_have_times_and_no_marks(rates_folder, verb):
    found = json.loads(asked(rates_folder, verb, "exact.csv", "-o", rates_folder / "out.csv", "--json"))
    assert found["largest"] == found["certain"]
    assert found["hidden_vibrations"] == []
    said = asked(rates_folder, verb, "exact.csv", "-o", rates_folder / "out.csv")
    assert UNCERTAIN_MARK not in said
    assert "are invisible" not in said
    if verb == "motion":
        assert found["largest"]["joint1"]["q2d"]["t"] == T[np.argmax(np.abs(fast_start(T, 2)[:, 0]))]


def test_of_many_motions_the_name_stands_beside_the_time(rates_folder, tmp_path):
    (tmp_path / "in").mkdir()
    for name, share in (("slow", 0.5), ("fast", 2.0)):
        rates = {f"joint{j + 1}.{rate_name('q', k)}": share**k * fast_start(T[:100], k)[:, j]
                 for j in range(2) for k in range(5)}  # fmt: skip
        tables.write(tmp_path / "in" / f"{name}.csv", {"t": T[:100] / share, **rates})
    said = asked(rates_folder, "run", tmp_path / "in", "-o", tmp_path / "o.npz")
    assert " of fast" in said
    assert " of slow" not in said


def test_check_marks_values_in_uncertain_ends(rates_folder):
    found = json.loads(asked(rates_folder, "check", "log.csv", "--json"))
    rows = {(row["joint"], row["limit"]): row for row in found["limits"]}
    motion = jounce.load_motion(rates_folder / "log.csv", ROBOT, 2)
    for (joint, limit), row in rows.items():
        k = {"acceleration": 2, "snap": 4}[limit]
        start, stop = reliability.find_window(motion.times, motion.deviations(motion.times, k)[k])
        if row["certain"] is None:
            assert start - 0.01 < row["t"] < stop + 0.01 or row["deviation"] * row["bound"] < 0.05 * abs(row["value"])
        else:
            value, at = row["certain"]
            assert start - 0.01 <= at <= stop + 0.01
            after = np.abs(fast_start(T[T > 0.6], k)).max(axis=0)[ROBOT.joint_names.index(joint)]
            assert abs(value) == pytest.approx(after, rel=0.1)
    assert rows["joint1", "snap"]["certain"]
    marked = [row for row in found["limits"] if row["certain"]]
    said = asked(rates_folder, "check", "log.csv")
    assert (said.count(" *  "), UNCERTAIN_MARK in said) == (len(marked), True)
    assert said.count("are invisible") == 1
    assert asked(rates_folder, "check", "log.csv", "--verbose").count("are invisible") == 2


@pytest.mark.parametrize("verb", ["run", "motion"])
def test_one_line_states_hidden_vibrations_and_verbose_one_per_joint(rates_folder, verb):
    words = verb, "log.csv", "-o", rates_folder / "out.csv"
    found = json.loads(asked(rates_folder, *words, "--json"))["hidden_vibrations"]
    worst = max(found, key=lambda x: x["adds"])
    [line] = [line for line in asked(rates_folder, *words).splitlines() if "are invisible" in line]
    assert line.startswith(f"Resolved up to {worst['bandwidth']:.3g} Hz; ")
    assert f" change {worst['to']} of {worst['of']} by up to {worst['adds']:.2g} " in line
    assert f"(worst: {worst['joint']}; {worst['per_octave']} times as much at twice the frequency)" in line
    said = asked(rates_folder, *words, "--verbose")
    lines = [line for line in said.splitlines() if "are invisible" in line]
    assert [line.split()[0] for line in lines] == ["joint1", "joint2"]
    assert all((" change Q2d of " in line) == (verb == "run") for line in lines)


def test_windows_end_where_deviations_are_ten_times_their_median():
    t, off = np.arange(5.0), np.array([10.1, 1.0, 1.0, 1.0, 9.9])[:, None]
    assert reliability.find_window(t, off) == (1.0, 4.0)
    assert reliability.find_window(t, np.hstack([off, np.full((5, 1), np.nan)])) == (1.0, 4.0)
    assert reliability.find_window(t, np.zeros((5, 1))) == (0.0, 4.0)
    assert reliability.find_window(t, off, np.full((5, 1), 203.0)) == (0.0, 4.0)  # known to 5 %
    assert reliability.find_window(t, off, np.full((5, 1), 201.0)) == (1.0, 4.0)


def test_a_vibration_all_along_makes_no_uncertain_end():
    """Deviations that hold it are over 5 % of the value everywhere, and nowhere ten times their median."""
    t, random = np.arange(0, 6, 2e-3), np.random.default_rng(5)
    q = np.stack([np.sin(t), np.cos(1.3 * t)], axis=1) + 1e-5 * random.normal(size=(len(t), 2))
    motion = jounce.Motion.fit(t, q + 1e-4 * np.sin(2 * np.pi * 20 * t)[:, None], bandwidth=1.0, allow_noise=True)
    found = jounce.load("planar2r").with_limits(snap=5e5).check(motion)
    assert all(row.deviation * row.bound**2 > 0.06 * abs(row.value * row.bound) for row in found.table)
    assert [row.certain for row in found.table] == [None, None]
