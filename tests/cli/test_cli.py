"""The command line: the library's numbers in tables, in words and JSON; every refusal one line, exit 2, no file."""

import json
import re
import shlex
import subprocess
import sys
import tracemalloc
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce.checks.description import describe
from jounce.cli import main
from jounce.engine import motion_states
from jounce.io import tables
from jounce.motion.spline import Spline
from jounce.spatial.series import rate_name
from support.commands import call
from support.files import BODY, GOOD, ODD, joint, link, robot_file
from support.motion_tables import from_table
from support.refusals import contents, refused

EXAMPLES = Path(__file__).parents[2] / "examples"
PANDA, IIWA_MOTION = EXAMPLES / "panda.urdf", EXAMPLES / "iiwa14.csv"
SCRIPT = Path(sys.executable).with_name("jounce")


def shell(*words, **options):
    command = [SCRIPT, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=60, check=False, **options)


def forces_of(robot, motion, order, method=None):
    """The columns that `jounce run` should write, straight from the library."""
    path = from_table(tables.read(motion), robot.mechanism, order + 2, "", Spline())
    rates = path(path.times, order + 2)
    return force_columns(robot, path.times, robot.inverse_dynamics(*rates, method=method), order)


def force_columns(robot, t, results, order):
    results = results if order else (results,)
    names = [(j, joint, k) for j, joint in enumerate(robot.joint_names) for k in range(order + 1)]
    return {"t": t, **{f"{joint}.{rate_name('Q', k)}": results[k][:, j] for j, joint, k in names}}


def assert_table(path, expected):
    found = tables.read(path)
    assert list(found) == list(expected)
    for name, column in expected.items():
        assert np.array_equal(found[name], column), name


@pytest.fixture(scope="module")
def panda_motion(tmp_path_factory):
    """Every twentieth row of the motion that the example writes."""
    path = tmp_path_factory.mktemp("motion") / "panda.csv"
    subprocess.run([sys.executable, EXAMPLES / "02_motion_between_postures.py", path], check=True, timeout=60)
    tables.write(path, {name: column[::20] for name, column in tables.read(path).items()})
    return path


@pytest.mark.parametrize(
    ("order", "method"),
    [*product(range(3), [None, "recursion", "closed_form", "paper"]), (3, "recursion"), (3, "closed_form")],
)
@pytest.mark.parametrize("name", ["panda", "iiwa14"])
def test_run_writes_what_the_library_computes(tmp_path, panda_motion, name, order, method):
    source, motion = (PANDA, panda_motion) if name == "panda" else ("iiwa14", IIWA_MOTION)
    out = tmp_path / "forces.csv"
    result = call(
        "run", source, motion, "-o", out, "--degree", 7, "--order", order, *(["--method", method] if method else [])
    )
    assert (result.exit_code, result.stderr) == (0, "")
    assert_table(out, forces_of(jounce.load(source), motion, order, method))


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_run_takes_rates_as_they_are(tmp_path, suffix):
    robot, rates = jounce.load("iiwa14"), np.random.default_rng(3).normal(size=(6, 4, 7))
    table = {"t": np.arange(4.0)}
    for j, name in reversed(list(enumerate(robot.joint_names))):
        table |= {f"{name}.{rate_name('q', k)}": rates[k, :, j] for k in range(6)}
    motion, out = tmp_path / f"motion{suffix}", tmp_path / f"forces{suffix}"
    tables.write(motion, table)
    assert call("run", "iiwa14", motion, "-o", out).exit_code == 0
    assert_table(out, force_columns(robot, table["t"], robot.inverse_dynamics(*rates[:5]), 2))


def test_run_replaces_an_older_table(tmp_path):
    out = tmp_path / "forces.npz"
    out.write_text("old")
    assert call("run", "iiwa14", IIWA_MOTION, "-o", out, "--degree", 7).exit_code == 0
    assert_table(out, forces_of(jounce.load("iiwa14"), IIWA_MOTION, 2))
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize("order", range(3))
def test_run_sums_up(tmp_path, panda_motion, order):
    out = tmp_path / "forces.csv"
    asked = ("run", PANDA, panda_motion, "-o", out, "--degree", 7, "--order", order)
    summary, words = json.loads(call(*asked, "--json").stdout), call(*asked).stdout
    found, robot = tables.read(out), jounce.load(PANDA)
    names = [rate_name("Q", k) for k in range(order + 1)]
    largest = {joint: {Q: np.abs(found[f"{joint}.{Q}"]).max() for Q in names} for joint in robot.joint_names}
    assert summary["peaks"] == largest
    units = [dict(zip(names, (u, f"{u}/s", f"{u}/s^2"), strict=False)) for u in ("N m", "N")]
    assert summary["units"] == {joint: units["finger" in joint] for joint in robot.joint_names}
    assert summary["t"] == [found["t"][0], found["t"][-1]]
    assert (summary["robot"], summary["states"], summary["order"]) == ("panda", len(found["t"]), order)
    assert (summary["motion"], summary["output"]) == (str(panda_motion), str(out))
    assert "degree 7" in summary["source"]
    for word in ("panda", str(panda_motion), str(out), f"{len(found['t'])} states", "degree 7", *names):
        assert word in words
    rows = {line.split()[0]: line.split() for line in words.splitlines() if line.startswith("panda_")}
    for name, peaks in largest.items():
        times = (found["t"][np.argmax(np.abs(found[f"{name}.{Q}"]))] for Q in names)
        shown = zip(peaks.values(), times, strict=True)
        assert rows[name][-2 * order - 2 :] == [f"{x:.6g}" for pair in shown for x in pair]


@pytest.mark.parametrize("source", ["iiwa14", "planar2r", PANDA])
def test_info(source):
    robot = jounce.load(source)
    data = json.loads(call("info", source, "--json").stdout)
    assert data == describe(robot.mechanism).json()
    assert [body["name"] for body in data["bodies"]] == list(robot.body_names)
    assert data["mass"] == pytest.approx(robot.mechanism.M[:, 3, 3].sum())
    assert data["gravity"] == robot.gravity.tolist()
    words = call("info", source)
    assert (words.exit_code, words.stderr) == (0, "")
    lines = words.stdout.splitlines()
    assert lines[0].startswith(
        f"{robot.name}: {robot.n} coordinates, {robot.mechanism.nb} bodies, {data['mass']:.6g} kg"
    )
    for body in data["bodies"]:
        row = next(line.split() for line in lines if line.startswith(f"{body['joint']} "))
        assert row[1] == body["type"]
        assert {body["name"], body["parent"], f"{body['mass']:.5g}"} <= set(row)
    for word in ("link4", "triangle inequality") if source == "iiwa14" else ():
        assert word in words.stdout
    for word in ("panda_finger_joint2 = panda_finger_joint1", "panda_hand (panda_link7)") if source == PANDA else ():
        assert word in words.stdout


@pytest.fixture
def mixed_folder(tmp_path, monkeypatch):
    """A folder of good and bad files, which is where the command runs."""
    robot_file(tmp_path, *GOOD, joint("loop", "arm", "base"), name="cycle.urdf")
    robot_file(tmp_path, link("base"), link("a", ODD), joint("turn", "base", "a"), name="odd.urdf")
    t = np.arange(9) / 8
    good = {"t": t, "joint1": np.sin(t), "joint2": -np.cos(t)}
    tables.write(tmp_path / "good.csv", good)
    tables.write(tmp_path / "few.csv", {name: column[:5] for name, column in good.items()})
    huge = {f"joint{j}.{rate_name('q', k)}": np.full(9, 1e308) for j in (1, 2) for k in range(5)}
    tables.write(tmp_path / "huge.csv", {"t": t} | huge)
    tables.write(tmp_path / "turn.csv", {"t": t, "turn": np.sin(t)})
    (tmp_path / "cell.csv").write_text("t,joint1,joint2\n0,1,2\n1,x,2\n")
    (tmp_path / "folder.csv").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


RUN = ("run", "planar2r", "good.csv", "-o", "out.csv", "--degree", "7")
TO = "run planar2r good.csv -o"
REFUSED = {
    "robot missing": ("run no.urdf good.csv -o out.csv", ["no.urdf: no such file"]),
    "robot unknown": ("run planar2 good.csv -o out.csv", ["'planar2'", "did you mean 'planar2r'"]),
    "robot broken": ("run cycle.urdf good.csv -o out.csv", ["cycle.urdf", "turn, loop", "cycle"]),
    "motion missing": ("run planar2r no.csv -o out.csv", ["no.csv: no such file"]),
    "motion of a folder": ("run planar2r folder.csv -o out.csv", ["folder.csv"]),
    "motion with a bad cell": ("run planar2r cell.csv -o out.csv", ["cell.csv:3", "'joint1'", "'x'"]),
    "motion too short": ("run planar2r few.csv -o out.csv", ["few.csv: 5 samples", "--degree 7"]),
    "output folder missing": (f"{TO} no/out.csv", ["no/out.csv", "no folder 'no'"]),
    "output is a folder": (f"{TO} folder.csv", ["folder.csv", "not a file"]),
    "output of other type": (f"{TO} out.xls", ["out.xls", "'.xls'", ".csv, .npz"]),
    "output onto the motion": (f"{TO} ./good.csv", ["the output file is the input file"]),
    "fit of exact terms": ("run iiwa14 paper -o out.csv --intervals 5",
        ["paper: its terms or trajectory points are exact; --intervals is for samples: leave it out"]),
    "unknown method": ((*RUN, "--method", "papr"), ["'papr'", "did you mean 'paper'", "recursion, closed_form, paper"]),
    "order beyond the paper": ((*RUN, "--method", "paper", "--order", "3"), ["order 3", "order 2"]),
    "order beyond the spline": ((*RUN, "--order", "6"), ["q8d", "degree 7"]),
    "forces that are not finite": ("run planar2r huge.csv -o out.csv --json", ["^out.csv: column 'joint1.Q' holds "]),
    "info on nothing": ("info no.urdf", ["no.urdf: no such file"]),
    "info on an unknown robot": ("info iwa14 --json", ["'iwa14'", "did you mean 'iiwa14'"]),
}  # fmt: skip


@pytest.mark.filterwarnings("always")
@pytest.mark.parametrize(("asked", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(mixed_folder, asked, words):
    (mixed_folder / "out.csv").write_text("old")
    refused(mixed_folder, asked, *words)


@pytest.mark.parametrize("error", [MemoryError("Unable to allocate\n745. GiB"), MemoryError()])
def test_run_refuses_what_memory_does_not_bear(mixed_folder, monkeypatch, error):
    def fails(*_, **__):
        raise error

    monkeypatch.setattr(motion_states, "compute", fails)
    refused(mixed_folder, RUN, "^out of memory: ")


def test_run_takes_little_more_memory_than_its_motion(tmp_path):
    """However long the motion, its forces are written as they come, and never held."""
    joints = "joint1: {offset: 1}, joint2: {polynomial: [0, 1]}"
    (tmp_path / "long.yaml").write_text(f"time: {{stop: 1, count: 30_000}}\njoints: {{{joints}}}\n")
    asked = ("run", "planar2r", tmp_path / "long.yaml", "-o", tmp_path / "out.csv")
    assert call(*asked).exit_code == 0  # and imports what it needs
    tracemalloc.start()
    assert call(*asked).exit_code == 0
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.7 * 8 * 30_000 * (1 + 5 * 2)


USAGE = {
    "no output": (("motion", "planar2r", "good.csv"), "--output"),
    "no motion": (("run", "planar2r"), "MOTION"),
    "negative order": ((*RUN, "--order", "-1"), "--order"),
    "order in words": ((*RUN, "--order", "two"), "--order"),
    "unknown option": ((*RUN, "--ordr", "1"), "--order"),
    "unknown verb": (("rn",), "'rn'"),
    "no robot": (("info",), "ROBOT"),
}


@pytest.mark.parametrize(("asked", "word"), USAGE.values(), ids=USAGE)
def test_usage_errors(mixed_folder, asked, word):
    before = contents(mixed_folder)
    result = call(*asked)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "Usage: " in result.stderr
    assert word in result.stderr
    assert contents(mixed_folder) == before


@pytest.mark.outside
@pytest.mark.parametrize("verb", [[], *([verb] for verb in main.commands if verb != "demo")], ids=" ".join)
def test_the_example_of_the_help_runs_as_printed(verb, tmp_path, monkeypatch):
    said = call(*verb, "--help").stdout
    assert max(map(len, said.splitlines())) <= 80
    examples = [shlex.split(line)[1:] for line in said.splitlines() if line.startswith("    jounce ")]
    assert not verb or any(words[0] == verb[0] for words in examples)
    assert examples
    monkeypatch.chdir(tmp_path)
    if ["cache", "--clear"] in examples:
        monkeypatch.setenv("JOUNCE_CACHE_DIR", str(tmp_path / "kernels"))  # that of the other tests is not cleared
    if verb == ["view"]:  # which would play until it is interrupted
        monkeypatch.setattr("jounce._report.viewer.run", lambda viewer, stopped: None)
    for words in examples:
        result = call(*words)
        assert (result.exit_code, result.stderr) == (0, ""), result.output


def test_help_imports_nothing_heavy():
    """What takes long to import is imported where it is used: the cause of a quick start, not its seconds."""
    command = [sys.executable, "-X", "importtime", "-m", "jounce", "run", "--help"]
    imported = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stderr
    assert "jounce.cli" in imported
    for heavy in ("numpy", "scipy", "lxml", "sympy", "matplotlib"):
        assert not re.search(rf"\| +{heavy}", imported)
    for seldom in ("checks.audit", "io.models", "motion", "io.tables", "io.urdf"):  # rooms of our own
        assert not re.search(rf"\| +jounce\.{seldom}\b", imported)


def test_units_are_those_of_the_joint_that_names_the_coordinate(tmp_path):
    """A revolute joint that follows a prismatic one, stated before it, does not make the coordinate an angle."""
    items = (link("wheel", BODY), joint("gear", "base", "wheel", inner='<mimic joint="slide"/>'))
    path = robot_file(tmp_path, *items, link("base"), link("sled", BODY), joint("slide", "base", "sled", "prismatic"))
    [coordinate] = json.loads(call("info", path, "--json").stdout)["coordinates"]
    assert coordinate == {"name": "slide", "unit": "m"}


def test_version():
    assert call("--version").stdout == f"jounce, version {jounce.__version__}\n"


def test_the_command_of_the_help_works(tmp_path):
    """As a user types it, in a process of its own."""
    done = shell(
        "run", "iiwa14", "examples/iiwa14.csv", "--degree", 7, "-o", tmp_path / "forces.csv", cwd=EXAMPLES.parent
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert_table(tmp_path / "forces.csv", forces_of(jounce.load("iiwa14"), IIWA_MOTION, 2))


@pytest.mark.parametrize("name", ["motion with a bad cell", "robot broken"])
def test_refuses_in_a_process_of_its_own(mixed_folder, name):
    before, done = contents(mixed_folder), shell(*REFUSED[name][0].split())
    assert (done.returncode, done.stdout) == (2, "")
    [line] = done.stderr.splitlines()
    assert line.startswith("Error: ")
    assert contents(mixed_folder) == before


@pytest.mark.parametrize(
    "asked", [("info", "odd.urdf", "--json"), ("run", "odd.urdf", "turn.csv", "-o", "o.csv", "--degree", "7", "--json")]
)
def test_warnings_are_one_line_beside_the_result(mixed_folder, asked):
    done = shell(*asked)
    assert done.returncode == 0
    assert json.loads(done.stdout)
    [line] = done.stderr.splitlines()
    assert line.startswith("Warning: odd.urdf: 1 of 1 bodies")
    assert "a: " in line
