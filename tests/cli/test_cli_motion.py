"""`jounce motion`, `run --rates` and `plot`: what is written is the motion, is run again, and is drawn."""

import json

import numpy as np
import pytest

import jounce
from jounce.engine import motion_states
from jounce.figures.curves import draw_curves
from jounce.figures.panels import make_run
from jounce.io import tables
from jounce.io.motions import writing
from support.commands import call, run, summary
from support.motion_tables import from_table

PLANAR = jounce.load("planar2r")
T = np.linspace(0, 1, 201)
SAMPLES = {"t": T, "joint1": np.sin(2 * T), "joint2": np.cos(3 * T), "tau_joint1": 40 + T}
RATES = ("q", "qd", "q2d", "q3d", "q4d")
POINTS = {
    "joint_names": ["joint1", "joint2"],
    "points": [
        {"positions": [i, i**2], "velocities": [1, 0], "time_from_start": 0.4 * i} for i in range(4)
    ],
}  # fmt: skip


@pytest.fixture
def samples_file(tmp_path):
    tables.write(tmp_path / "log.csv", SAMPLES)
    return tmp_path / "log.csv"


@pytest.fixture
def points_file(tmp_path):
    (tmp_path / "plan.json").write_text(json.dumps(POINTS))
    return tmp_path / "plan.json"


@pytest.mark.parametrize("piece", [7, 1000])
def test_a_motion_is_written_with_its_rates_and_samples(tmp_path, samples_file, monkeypatch, piece):
    monkeypatch.setattr(writing, "ROWS_PER_MOTION_PIECE", piece)
    out = tmp_path / "motion.csv"
    words = run("motion", "planar2r", samples_file, "-o", out, "--intervals", 8).stdout
    assert f"q to q4d written to {out}" in words
    found, motion = tables.read(out), jounce.load_motion(samples_file, PLANAR, intervals=8)
    for k, rate in enumerate(motion(T)):
        assert np.array_equal(np.stack([found[f"joint{j}.{RATES[k]}"] for j in (1, 2)], axis=1), rate)
    assert np.array_equal(found["joint2.q_sample"], SAMPLES["joint2"])
    again = jounce.load_motion(out, PLANAR)
    assert again.notes == ()
    assert np.array_equal(again(T)[4], motion(T)[4])


def test_deviations_go_from_table_to_forces():
    """Of a motion whose q4d alone is uncertain Q2d is, by what M makes of it; Q and Qd are exact."""
    motion = jounce.load_motion(SAMPLES, PLANAR)
    rates = motion(T)
    spreads = [np.zeros((len(T), 2))] * 4 + [np.tile([2.0, 0.5], (len(T), 1))]
    q = jounce.Channel("q", PLANAR.joint_names, ("rad", "rad"), T, rates, tuple(spreads))
    columns = {"t": T} | q.to_columns()
    table = from_table(columns, PLANAR.mechanism, 4, "m.csv")
    assert np.array_equal(table.deviations(T)[4], spreads[4])
    along = PLANAR.forces_along(table)
    M = PLANAR.mass_matrix(rates[0])
    expected = np.sqrt((M**2 @ np.array([4.0, 0.25])[:, None])[..., 0])
    np.testing.assert_allclose(along.deviations[2], expected, rtol=1e-9)
    assert not along.deviations[0].any()
    assert not along.deviations[1].any()
    slow = table.scaled(2).deviations(0.8)[4]
    np.testing.assert_allclose(slow, [2 / 16, 0.5 / 16])


def test_breaks_are_marked_in_the_row_after_them(tmp_path, points_file):
    out = tmp_path / "motion.npz"
    said = summary("motion", "planar2r", points_file, "-o", out, "--step", 0.07)
    assert [(found["t"], found["order"]) for found in said["breaks"][::2]] == [(0.4, 2), (0.8, 2)]
    found = tables.read(out)
    assert {found["break"][i] for i in np.searchsorted(found["t"], [0.4, 0.8])} == {2.0}
    assert np.count_nonzero(found["break"] >= 0) == 2
    smooth = summary("motion", "planar2r", points_file, "-o", out, "--blend", 0.1)
    assert smooth["breaks"] == []
    assert "break" not in tables.read(out)


def test_run_tells_breaks_and_writes_rates_and_measured_torques(tmp_path, samples_file, points_file):
    out = tmp_path / "forces.csv"
    run("run", "planar2r", samples_file, "-o", out, "--rates")
    found, motion = tables.read(out), jounce.load_motion(samples_file, PLANAR)
    assert np.array_equal(found["joint2.q3d"], motion(T)[3][:, 1])
    np.testing.assert_array_equal(found["joint1.Q_measured"], SAMPLES["tau_joint1"])
    assert "joint2.Q_measured" not in found
    run("motion", "planar2r", samples_file, "-o", tmp_path / "motion.csv")
    run("run", "planar2r", tmp_path / "motion.csv", "-o", out)
    np.testing.assert_array_equal(tables.read(out)["joint1.Q_measured"], SAMPLES["tau_joint1"])
    words = run("run", "planar2r", points_file, "-o", out).stdout
    assert "break at t = 0.4 s: q2d of joint1, joint2 jumps; Q jumps, Qd, Q2d do not exist" in words
    [first, _] = summary("run", "planar2r", points_file, "-o", out)["breaks"]
    assert (first["jumps"], first["missing"]) == ("Q", ["Qd", "Q2d"])
    found = tables.read(out)
    marked = found["break"] >= 0
    np.testing.assert_allclose(found["t"][marked], [0.4, 0.8], atol=1e-3)
    assert set(found["break"][marked]) == {0}
    refused = call("plot", points_file, "-o", tmp_path / "a.png")
    assert f"{points_file} is not a table; make one with `jounce motion ROBOT {points_file} -o OUT`" in refused.stderr
    path = jounce.load_motion(points_file, PLANAR)
    a, b = (PLANAR.inverse_dynamics(*path(0.4, 2, side)) for side in ("left", "right"))
    np.testing.assert_allclose(list(first["by"].values()), b - a, atol=1e-9)


def test_the_largest_values_are_known_ones_with_their_deviations(tmp_path, monkeypatch):
    """Not those at the ends of the fit, where deviations are larger than values."""
    monkeypatch.setattr(motion_states, "_STATES_PER_PIECE", 300)
    t, noise = np.arange(1500) / 1000, np.random.default_rng(0).normal(0, 1e-5, (2, 1500))
    log, out = tmp_path / "log.csv", tmp_path / "forces.csv"
    tables.write(log, {"t": t, "joint1": np.sin(3 * t) + noise[0], "joint2": np.cos(4 * t) + noise[1]})
    said = summary("run", "planar2r", log, "-o", out)
    found = tables.read(out)
    for joint in PLANAR.joint_names:
        value, sd = found[f"{joint}.Q2d"], found[f"{joint}.Q2d_sd"]
        row = np.argmax(np.abs(value) - 1.96 * sd)
        assert said["peaks"][joint]["Q2d"] == abs(value[row])
        assert said["deviations"][joint]["Q2d"] == sd[row]
    words = run("run", "planar2r", log, "-o", out).stdout.splitlines()
    assert next(line for line in words if line.startswith("joint1") and " N m " in line).count(" ± ") == 3
    tables.write(log, SAMPLES)
    assert "±" not in run("run", "planar2r", log, "-o", out).stdout


def test_samples_residuals_bands_and_breaks_are_drawn():
    q, sd = np.sin(T), np.full(len(T), 0.1)
    columns = {
        "t": T,
        "a.q": q,
        "a.q_sample": q + 0.02,
        "a.q_sd": sd,
        "a.qd": np.cos(T),
        "a.Q": T,
        "a.Q_measured": T + 1,
    }
    columns["break"] = np.where(T[50] == T, 2.0, -1.0)
    run = make_run(columns, "m.csv")
    found = run.panels
    assert [panel.channel.symbol.split()[0] for panel in found] == ["q", "residual", "qd", "Q"]
    np.testing.assert_allclose(found[1].curve("a"), 0.02)
    assert found[3].points.names == ("a",)
    np.testing.assert_array_equal(found[3].points.values[:, 0], columns["a.Q_measured"])
    assert run.breaks == [(T[50], 2)]
    figure = draw_curves([run])
    [band] = figure.axes[0].collections
    low, high = band.get_paths()[0].vertices[:, 1].min(), band.get_paths()[0].vertices[:, 1].max()
    np.testing.assert_allclose([low, high], [q.min() - 0.196, q.max() + 0.196])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "measured", "95 % band", "break"]
    assert all(any(list(line.get_xdata()) == [T[50]] * 2 for line in axes.get_lines()) for axes in figure.axes)
