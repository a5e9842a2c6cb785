"""Defective logs: what can be decided is done and noted in one line, the rest is refused with what decides."""

import json

import numpy as np
import pytest

import jounce
from support.commands import call
from support.defective_logs import (
    NOISE,
    clean_columns,
    make_logs,
    named_arguments,
    named_options,
    true_positions,
    write_logs,
)
from support.refusals import refusal

LOGS = make_logs()
ROBOT = jounce.load("planar2r").with_limits(velocity=[2.0, 2.0], acceleration=[9.0, 9.0], effort=[200.0, 100.0])
START = clean_columns()[1]  # s, of the first stamp, in the times of the truth
COMMANDS = {
    "motion": ("-o", "out.csv", "--order", "2"),
    "run": ("-o", "out.csv", "--order", "0"),
    "check": (),
    "slowdown": (),
}


@pytest.fixture(scope="module")
def logs_folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs")
    write_logs(path)
    jounce.save(ROBOT, path / "robot.yaml")
    return path


@pytest.fixture(scope="module")
def log_paths(logs_folder):
    return write_logs(logs_folder)


def words_of(options):
    texts = {name: "=".join(*x.items()) if isinstance(x, dict) else x for name, x in options.items()}
    return [word for name, text in texts.items() for word in (f"--{name.replace('_', '-')}", text)]


@pytest.mark.parametrize("name", LOGS)
def test_what_is_read_is_the_truth(log_paths, name):
    log = LOGS[name]
    if log.refused:
        words = (str(log_paths[name]), *log.refused, *named_arguments(log.cure))
        refusal(lambda: jounce.load_motion(log_paths[name], ROBOT, 0), *words)
    if log.cure is None:
        refusal(lambda: jounce.load_motion(log_paths[name], ROBOT, 0, on_error="skip"), *log.refused)
        return
    motion = jounce.load_motion(log_paths[name], ROBOT, 0, **log.cure)
    assert len(motion.times) == log.rows
    assert [words for words in log.noted if not any(words in note for note in motion.notes)] == [], motion.notes
    t = np.linspace(0.5, 3.5, 50)
    for k, (rate, tolerance) in enumerate(zip(motion(t, 2), (NOISE, 30 * NOISE, 1000 * NOISE), strict=True)):
        assert np.abs(rate - true_positions(t + START, k)).max() < tolerance, k


@pytest.mark.sweep(12)
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("name", LOGS)
def test_commands_read_what_can_be_read(log_paths, logs_folder, monkeypatch, tmp_path, name, command):
    monkeypatch.chdir(tmp_path)
    log = LOGS[name]

    words_given = [command, logs_folder / "robot.yaml", log_paths[name], *COMMANDS[command]]
    if log.refused:
        result = call(*words_given)
        assert result.exit_code == 2
        words = [*log.refused, *named_options(log.cure)]
        assert [word for word in words if word not in result.stderr] == [], result.stderr
        assert result.stderr.count("\n") == 1
    if log.cure is None:
        return
    result = call(*words_given, *words_of(log.cure), "--json")
    assert result.exit_code in (0, 1, 3), result.output
    found = json.loads(result.stdout)
    skipped = found.get("skipped", {"rows": 0})["rows"]
    by_parts = log.cure == {"on_error": "skip"} and command in ("run", "check")
    assert skipped == (int(log.noted[0].split()[0]) if by_parts else 0)
    noted = log.noted[: 0 if skipped else None]
    said = [*found["notes"], *found.get("warnings", ())]
    assert [words for words in noted if not any(words in note for note in said)] == [], said


OTHERS = {
    "retime": ("--no-smooth", "-o", "out.csv"),
    "identify": ("-o", "out.yaml", "--drives", "none"),
    "report": ("-o", "out.html", "--order", "0"),
    "motors": ("--stiffness", "1000", "--rotor", "0.1", "-o", "out.csv", "--allow-noise"),
}


@pytest.mark.sweep(4)
@pytest.mark.parametrize("command", OTHERS)
@pytest.mark.parametrize("name", ["torque sensor off", "texts among numbers", "names of another prefix"])
def test_other_commands_read_them_too(log_paths, logs_folder, monkeypatch, tmp_path, name, command):
    pytest.importorskip("plotly")
    monkeypatch.chdir(tmp_path)
    words = [command, str(logs_folder / "robot.yaml"), str(log_paths[name]), *OTHERS[command]]
    if LOGS[name].refused:
        result = call(*words)
        assert result.exit_code == 2
        said = [*LOGS[name].refused, *named_options(LOGS[name].cure)]
        assert [word for word in said if word not in result.stderr] == [], result.stderr
    result = call(*words, *words_of(LOGS[name].cure))
    assert result.exit_code == 0, result.output
    noted = [] if command == "motors" and "skip" in LOGS[name].cure.values() else LOGS[name].noted
    assert [part for part in noted if part not in result.output] == [], result.output
