"""A defect ends a command with its traceback and exit code 2, never with 1 or 3, which are verdicts."""

import subprocess
import sys

import numpy as np
import pytest

import jounce
from jounce import cli
from jounce.cli import main
from jounce.core.errors import JounceError
from jounce.io import tables
from support.commands import call
from support.refusals import refused

VERDICTS = {  # the command, what it calls, and its words
    "check": ("jounce.limits.check.validate_limits", ["check", "arm.yaml", "plan.csv"]),
    "check at a rate": ("jounce.limits.check.validate_limits", ["check", "arm.yaml", "plan.csv", "--rate", "100"]),
    "explain": ("jounce.limits.explanation.take_differences", ["explain", "arm.yaml", "plan.csv", "--rate", "100"]),
    "info": ("jounce.checks.description.describe", ["info", "planar2r", "--strict"]),
    "compare": ("jounce.checks.compare.compare", ["compare", "planar2r"]),
}
UNFORESEEN = [
    ValueError("min() arg is an empty sequence"),
    RecursionError("too deep"),
    KeyError("x\x1b[31m"),
    Warning(),
]

PROCESS = """
import sys
from unittest import mock
from jounce.__main__ import main

target, *sys.argv[1:] = sys.argv[1:]
with mock.patch(target, side_effect=ZeroDivisionError("planted")):
    main()
"""


@pytest.fixture
def plan_folder(tmp_path, monkeypatch):
    """A robot with limits, and a plan that keeps them."""
    monkeypatch.chdir(tmp_path)
    t = np.linspace(0, 2, 201)
    jounce.save(jounce.load("planar2r").with_limits(velocity=99, effort=1e4), "arm.yaml")
    s = (1 - np.cos(np.pi * t / 2)) / 2
    tables.write(tmp_path / "plan.csv", {"t": t, "joint1": s, "joint2": 2 * s})
    return tmp_path


def said_of(error, result):
    """The lines of a command that a defect ended."""
    *trace, last = result.stderr.splitlines()
    assert result.exit_code == 2
    assert "Traceback (most recent call last):" in trace
    assert all(line.isprintable() for line in trace)
    assert last.startswith(f"Error: {type(error).__name__}: ")
    assert last.endswith("a defect of jounce; report it with these lines")


@pytest.mark.parametrize("verb", main.commands.values(), ids=lambda verb: verb.name)
@pytest.mark.parametrize("error", UNFORESEEN, ids=lambda error: type(error).__name__)
def test_an_exception_in_any_command(verb, error, monkeypatch):
    def fail(**_):
        raise error

    monkeypatch.setattr(verb, "params", [])
    monkeypatch.setattr(verb, "callback", fail)
    said_of(error, call(verb.name))


@pytest.mark.parametrize("name", VERDICTS)
def test_an_exception_behind_a_verdict(name, plan_folder, monkeypatch):
    target, words = VERDICTS[name]
    assert call(*words).exit_code in (0, 1, 3)
    done = subprocess.run(
        [sys.executable, "-c", PROCESS, target, *words], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 2
    assert "Traceback" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("Error: ZeroDivisionError: planted: a defect of jounce")


@pytest.mark.parametrize("error", [JounceError("limit"), MemoryError(), OSError(28, "No space left on device")])
def test_what_is_foreseen_remains_one_line(error, tmp_path, monkeypatch):
    def fail(**_):
        raise error

    monkeypatch.setattr(cli.check, "params", [])
    monkeypatch.setattr(cli.check, "callback", fail)
    assert "defect" not in refused(tmp_path, "check")


def test_an_installation_that_is_not_whole(tmp_path):
    """Python's own exit code after a traceback is 1: that of a broken limit."""
    (tmp_path / "click.py").write_text("raise ImportError('half a file')\n")
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from jounce.__main__ import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "ImportError: half a file"
