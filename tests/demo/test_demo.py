"""The paper's example: its numbers against other paths, its command, and `jounce plot`."""

import json
import sys
from contextlib import contextmanager

import numpy as np
import pytest

import jounce
from jounce._report.paper_example import example, step_errors
from jounce.io import tables
from support.commands import call
from support.refusals import refused
from support.robots import relative_error

command = sys.modules["jounce.cli.pages"]  # its name in jounce.cli is that of the verb


@pytest.fixture(scope="module")
def paper_example():
    return example("paper", 2000)


def test_exact_rates_agree_with_differences_at_their_best_step(paper_example):
    """Over the whole motion, relative to the largest value: Qd to 1e-9, Q2d to 1e-8; no scheme reaches the exact."""
    for errors, bound in zip(step_errors(paper_example.robot), (1e-9, 1e-8), strict=True):
        best = {name: values.min() for name, values in errors.of_scheme.items()}
        assert best["central, 2 points"] < bound
        assert best["central, 4 points"] < bound
        assert errors.exact < 1e-14 < min(best.values())
        for name, values in errors.of_scheme.items():
            assert values[0] > best[name] < values[-1], f"{name} does not fall and rise again"


@pytest.mark.parametrize("scheme", [("forward, 2 points", 1), ("central, 2 points", 2), ("central, 4 points", 4)])
def test_schemes_have_the_order_of_theory(paper_example, scheme):
    """Halving a long step divides the error by two to the scheme's order."""
    name, order = scheme
    for errors in step_errors(paper_example.robot):
        ratios = errors.of_scheme[name][1:4] / errors.of_scheme[name][2:5]
        np.testing.assert_allclose(np.log2(ratios), order, atol=0.15)


def test_the_wrench_acts_on_the_loaded_example(paper_example):
    loaded = example("paper-wrench", 2000)
    J = jounce.Robot(paper_example.robot.mechanism).jacobian(paper_example.motion(paper_example.t)[0], body="link7")
    W = 10 * np.sin(np.pi * paper_example.t)[:, None, None] * np.ones((6, 1))
    assert relative_error(loaded.forces[0] - paper_example.forces[0], (J.mT @ W)[..., 0]) < 1e-13


def test_demo_writes_all_that_it_names(tmp_path, monkeypatch):
    """Its progress ends with it, and a format that is asked for twice is drawn, told and counted once."""
    out, shown = tmp_path / "demo", []

    @contextmanager
    def counted(_):
        yield lambda *step: shown.append(step)

    monkeypatch.setattr(command, "stage", counted)
    result = call("demo", "-o", out, "--states", 200, "--format", "svg", "--format", "svg", "--json")
    assert (result.exit_code, result.stderr) == (0, ""), result.output
    assert shown == [(k + 1, len(shown)) for k in range(len(shown))]
    summary = json.loads(result.stdout)
    assert summary["formats"] == ["svg"]
    names = [*summary["tables"], *(f"{name}.svg" for name in summary["pictures"])]
    assert sorted(path.name for path in out.iterdir()) == sorted(names)
    assert {"forces", "forces-wrench", "step-size", "figure", "figure-rates"} == set(summary["pictures"])
    alone = example("paper", 200)
    Q = jounce.Channel("Q", alone.robot.joint_names, ("N m",) * 7, alone.t, tuple(alone.forces))
    expected = {"t": alone.t} | Q.to_columns()
    found = tables.read(out / "forces.csv")
    assert all((found[name] == values).all() for name, values in expected.items())
    assert summary["peaks"]["without W"] == [np.abs(Q).max() for Q in alone.forces]
    assert all(ms > 0 for pair in summary["milliseconds"].values() for ms in pair)


def test_demo_says_what_the_figure_is(tmp_path, monkeypatch):
    monkeypatch.setattr("jounce.figures.canvas.save", lambda *_: None)  # pictures are drawn above
    words = call("demo", "-o", tmp_path, "--states", 200, "--format", "png").stdout
    for word in ("Steiner's theorem", "1.6 ms", "central, 4 points", "recursion", "forces-wrench", str(tmp_path)):
        assert word in words
    rows = {line[:28].strip(): line.split()[-1] for line in words.splitlines() if line}
    assert float(rows["both: the figure"]) < 4e-4 < 3 < float(rows["wrench alone"]) < float(rows["formulas"])
    assert max(map(len, words.replace(str(tmp_path), "").splitlines())) < 100


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_plot_draws_what_run_wrote(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    assert call("run", "planar2r", write_waves(tmp_path), "--degree", "7", "-o", "forces.csv").exit_code == 0
    result = call("plot", "forces.csv", "-o", f"forces.{kind}")
    assert (result.exit_code, result.stderr) == (0, "")
    assert "Q, Qd, Q2d of 2 joints, 9 states" in result.stdout
    assert (tmp_path / f"forces.{kind}").stat().st_size > 5000
    drawn = json.loads(call("plot", "forces.csv", "-o", f"one.{kind}", "--joint", "joint2", "--json").stdout)
    assert set(map(tuple, drawn["panels"].values())) == {("joint2",)}


def test_plot_counts_the_joints_of_all_panels(tmp_path):
    tables.write(tmp_path / "f.csv", {"t": np.arange(1.0), "a.Q": np.ones(1), "b.Qd": np.ones(1)})
    result = call("plot", tmp_path / "f.csv", "-o", tmp_path / "f.png")
    assert result.stdout.startswith("Q, Qd of 2 joints, 1 state, drawn")


def test_plot_takes_units_from_a_robot_and_overlays_tables(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("f.csv", "g.csv"):
        tables.write(tmp_path / name, {"t": np.arange(2.0), "joint2.Q": np.ones(2), "joint1.Q": np.ones(2)})
    drawn = call("plot", "f.csv", "g.csv", "-o", "p.svg", "--robot", "planar2r", "--json")
    assert (drawn.exit_code, drawn.stderr) == (0, "")
    summary = json.loads(drawn.stdout)
    assert (summary["tables"], summary["states"]) == (["f.csv", "g.csv"], [2, 2])
    assert summary["panels"] == {"Q": ["joint1", "joint2"]}  # in the order of the robot
    assert summary["exceeded"] == {}
    assert call("plot", "f.csv", "g.csv", "-o", "q.svg", "--side-by-side").exit_code == 0
    apart, over = ((tmp_path / name).read_text().count('id="axes_') for name in ("q.svg", "p.svg"))
    assert (apart, over) == (2, 2)


def test_plot_says_what_is_beyond_a_limit_and_draws_pages_of_journals(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tables.write(tmp_path / "f.csv", {"t": np.arange(9.0), "panda_joint1.Q": 30 * np.arange(9.0)})
    call_plot = ("plot", "f.csv", "-o", "p.svg", "--robot", "panda")
    assert call(*call_plot, "--width", "90").stdout.splitlines()[1:] == ["beyond a limit: Q of panda_joint1"]
    assert 'width="255.118' in (tmp_path / "p.svg").read_text()
    refused(tmp_path, [*call_plot, "--width", "wide"], "^--width 'wide'; expected column, page or 30 to 500 mm$")


def write_waves(folder):
    t = np.arange(9) / 8
    tables.write(folder / "motion.csv", {"t": t, "joint1": np.sin(t), "joint2": -np.cos(t)})
    return folder / "motion.csv"


REFUSED = {
    "table without the columns": ("plot motion.csv -o p.png", ["motion.csv", "NAME.Q", "t, joint1, joint2"]),
    "no table": ("plot no.csv -o p.png", ["no.csv: no such file"]),
    "robot of other joints": ("plot rates.csv -o p.png --robot planar2r", ["rates.csv", "'a'", "joint1"]),
    "base of no robot": ("plot rates.csv -o p.png --base fixed", ["--base", "--robot"]),
    "picture of other type": ("plot motion.csv -o p.gif", ["p.gif", "'.gif'", ".png, .svg, .pdf"]),
    "picture folder missing": ("plot motion.csv -o no/p.png", ["no/p.png", "no folder 'no'"]),
    "demo in a missing folder": ("demo -o no/demo", ["no/demo", "no folder 'no'"]),
    "demo onto a file": ("demo -o motion.csv", ["motion.csv: exists and is not a folder"]),
}


@pytest.mark.parametrize(("asked", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(tmp_path, asked, words):
    write_waves(tmp_path)
    tables.write(tmp_path / "rates.csv", {"t": np.arange(2.0), "a.Q": np.ones(2)})
    refused(tmp_path, asked, *words)
