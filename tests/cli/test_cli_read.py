"""How a table is read: a group of options of the help, kept in a file, read again to the last bit."""

import json

import numpy as np
import pytest

from jounce.io import tables
from support.commands import run
from support.refusals import refused

T = np.linspace(0, 2, 401)
NOISE = np.random.default_rng(0).uniform(-1e-5, 1e-5, (2, T.size))
LOG = {"stamp": 1e3 * T, "q1": np.degrees(np.cos(3 * T) + NOISE[0]), "q2": np.degrees(np.sin(2 * T) + NOISE[1])}
LOG |= {"tau: #1": np.cos(T), "tau: #2": np.sin(T)}
COLUMNS = ("--time", "stamp", "--time-unit", "ms", "--columns", "q{number}", "--angles", "deg")
COMMANDS = ("run", "motion", "check", "slowdown", "retime", "report", "motors", "identify", "payload", "view")


@pytest.fixture
def log_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tables.write(tmp_path / "log.csv", LOG)
    return tmp_path


@pytest.mark.parametrize(
    "options",
    [
        ("--bandwidth", 1 / 3),
        ("--bandwidth", 20, "--allow-noise"),
        ("--intervals", 6, "--degree", 5, "--step", 0.1 + 0.2),
        ("--degree", 7, "--torques", "tau: #{number}"),
    ],
)
def test_what_motion_saves_run_reads_to_the_last_bit(log_folder, options):
    asked = (*COLUMNS, *options)
    assert (
        "log.yaml, for --read"
        in run("motion", "planar2r", "log.csv", "-o", "m.csv", *asked, "--save-read", "log.yaml").output
    )
    run("run", "planar2r", "log.csv", "-o", "typed.csv", *asked)
    run("run", "planar2r", "log.csv", "-o", "kept.csv", "--read", "log.yaml")
    assert (log_folder / "kept.csv").read_bytes() == (log_folder / "typed.csv").read_bytes()
    run("motion", "planar2r", "log.csv", "-o", "m.csv", "--read", "log.yaml", "--save-read", "again.yaml")
    assert (log_folder / "again.yaml").read_bytes() == (log_folder / "log.yaml").read_bytes()


def test_blends_of_plans_are_saved_too(log_folder):
    points = [{"positions": [i, i**2], "velocities": [1, 0], "time_from_start": 0.4 * i} for i in range(3)]
    (log_folder / "plan.json").write_text(json.dumps({"joint_names": ["joint1", "joint2"], "points": points}))
    run("motion", "planar2r", "plan.json", "-o", "m.csv", "--blend", 0.1, "--step", 0.03, "--save-read", "plan.yaml")
    assert (log_folder / "plan.yaml").read_text() == "blend: 0.1\nstep: 0.03\n"
    run("motion", "planar2r", "plan.json", "-o", "again.csv", "--read", "plan.yaml")
    assert (log_folder / "again.csv").read_bytes() == (log_folder / "m.csv").read_bytes()


def test_the_command_line_wins_over_the_file(log_folder):
    (log_folder / "log.yaml").write_text(
        "time: none\ncolumns: q{number}\nangles: deg\ntime-unit: us\nallow-noise: false\n"
    )
    run("run", "planar2r", "log.csv", "-o", "typed.csv", *COLUMNS, "--degree", 7)
    more = ("--time", "stamp", "--time-unit", "ms", "--degree", 7)
    run("run", "planar2r", "log.csv", "-o", "kept.csv", "--read", "log.yaml", *more)
    assert (log_folder / "kept.csv").read_bytes() == (log_folder / "typed.csv").read_bytes()


def test_nothing_to_keep_is_an_empty_file(log_folder):
    refused(log_folder, "motion planar2r paper.csv -o m.csv", "paper.csv: no such file")
    tables.write(log_folder / "paper.csv", {"t": T, "joint1": np.sin(T), "joint2": T**2})
    run("motion", "planar2r", "paper.csv", "-o", "m.csv", "--save-read", "log.yaml")
    assert (log_folder / "log.yaml").read_text() == "{}\n"
    run("run", "planar2r", "paper.csv", "-o", "f.csv", "--read", "log.yaml")


REFUSED = {
    "bandwith: 20": ("log.yaml:1", "'bandwith'", "did you mean 'bandwidth'?", "available: bandwidth, allow-noise"),
    "time_unit: ms": ("log.yaml:1", "did you mean 'time-unit'?"),
    "time: stamp\nbandwidth: wide": ("log.yaml:2", "bandwidth", "'wide'; expected a finite number > 0"),
    "bandwidth: true": ("bandwidth", "True; expected a finite number"),
    "bandwidth: .inf": ("bandwidth", "inf; expected a finite number"),
    "step: -1": ("step", "-1; expected a finite number > 0"),
    "degree: 7.5": ("degree", "7.5; expected an integer > 0"),
    "degree: 6": ("log.yaml", "degree 6 is not supported; expected 5 or 7"),
    "intervals: 0": ("intervals", "0; expected an integer > 0"),
    "allow-noise: 1": ("allow-noise", "1; expected true or false"),
    "time: 3": ("time", "3; expected a text"),
    "columns:": ("columns", "None; expected a pattern"),
    "angles: grad": ("angles", "'grad'; expected rad, deg"),
    "time-unit: [s]": ("time-unit", "['s']; expected s, ms, us, ns"),
    "degree: 7\nbandwidth: 20": ("log.yaml", "--bandwidth", "--degree", "leave one of them out"),
    "read: log.yaml": ("log.yaml:1", "'read'"),
    "- time": ("log.yaml:1", "expected keys and values"),
    "": ("log.yaml", "expected keys and values"),
    "{": ("log.yaml", "not YAML"),
    "joints: {}\ntime: {stop: 1, count: 2}": ("log.yaml: a motion", "give it as MOTION"),
}


@pytest.mark.parametrize("text", REFUSED)
def test_a_wrong_file_is_refused_in_one_line(log_folder, text):
    (log_folder / "log.yaml").write_text(text)
    refused(log_folder, "run planar2r log.csv -o f.csv --read log.yaml", *REFUSED[text])


@pytest.mark.parametrize(("asked", "words"), [
    ("check planar2r log.yaml", "^log.yaml: options of how a table is read, not a motion; give a table as MOTION"),
    ("run planar2r log.csv -o f.csv --read no.yaml", "no such file"),
    ("view planar2r --read log.yaml", "^--read needs a MOTION$"),
])  # fmt: skip
def test_options_are_no_motion(log_folder, asked, words):
    (log_folder / "log.yaml").write_text("time: stamp\n")
    refused(log_folder, asked, words)


@pytest.mark.parametrize(("options", "words"), [
    ("motion -o m.csv --save-read log.yaml", "log.yaml: the output file is the input file"),
    ("motion -o m.csv --save-read log.csv", "unknown type of file '.csv' for --save-read; available: .yaml, .yml"),
    ("motion -o m.csv --save-read no/log.yaml", "no folder 'no'"),
    ("identify -o log.yaml", "log.yaml: the output file is the input file"),
])  # fmt: skip
def test_saved_options_replace_no_input(log_folder, options, words):
    (log_folder / "log.yaml").write_text("time: stamp\n")
    verb, *others = options.split()
    refused(log_folder, [verb, "planar2r", "log.csv", "--read", "log.yaml", *others], words)
