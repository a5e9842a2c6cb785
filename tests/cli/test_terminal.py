"""The command on a terminal and off it: bars, colours, completion."""

import io
import os
import re

import pytest
from click.testing import CliRunner
from test_cli import shell

from jounce.cli import main, output
from jounce.cli.output import align_columns, progress


class Screen(io.StringIO):
    def isatty(self):
        return True


def bar_of(monkeypatch, stream, patience, steps=4):
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setattr(output, "PROGRESS_DELAY", patience)
    with progress("working") as show:
        for step in range(steps):
            show(step + 1, steps)
    return stream.getvalue()


def test_long_work_has_a_bar_that_reaches_its_end(monkeypatch):
    said = bar_of(monkeypatch, Screen(), patience=0)
    assert "working" in said
    assert re.findall(r"(\d+)%", said)[-1] == "100"


def test_short_work_and_work_that_nobody_watches_have_no_bar(monkeypatch):
    assert bar_of(monkeypatch, Screen(), patience=60) == ""
    assert bar_of(monkeypatch, io.StringIO(), patience=0) == ""


def test_an_error_ends_the_bar_and_goes_on(monkeypatch):
    screen = Screen()
    monkeypatch.setattr("sys.stderr", screen)
    monkeypatch.setattr(output, "PROGRESS_DELAY", 0)

    def fails():
        with progress("working") as show:
            show(1, 3)
            raise ValueError("stop")

    with pytest.raises(ValueError, match="stop"):
        fails()
    assert screen.getvalue().endswith("\n")


@pytest.mark.parametrize(("settings", "coloured"), [({}, True), ({"NO_COLOR": ""}, True), ({"NO_COLOR": "1"}, False)])
@pytest.mark.parametrize("asked", [["info", "planar2r"], ["info", "planar3r"]], ids=["table", "error"])
def test_colour_only_where_wanted(monkeypatch, settings, coloured, asked):
    monkeypatch.delenv("NO_COLOR", raising=False)
    on_a_terminal = CliRunner(env=settings).invoke(main, asked, color=True).output
    assert ("\x1b[" in on_a_terminal) == coloured
    piped = CliRunner(env=settings).invoke(main, asked).output
    assert "\x1b" not in piped
    assert re.sub(r"\x1b\[\d+m", "", on_a_terminal) == piped


def test_columns_are_straight(monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    assert align_columns([("a", "bb", ""), ("ccc", "d", "e")]) == ["a    bb", "ccc  d   e"]
    assert align_columns([("a\nb", "c"), ("d", "e")]) == [r"a\nb  c", "d     e"]


@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("jounce info i", "plain,iiwa14"),
        ("jounce robots pan", "plain,panda"),
        ("jounce run iiwa14 pap", "plain,paper\nplain,paper-wrench"),
        ("jounce info examples/p", "file,examples/p"),
        ("jounce pl", "plain,plot"),
        ("jounce run --deg", "plain,--degree"),
    ],
)
def test_the_shell_completes_verbs_options_robots_and_motions(typed, offered):
    asked = {"COMP_WORDS": typed, "COMP_CWORD": str(len(typed.split()) - 1), "_JOUNCE_COMPLETE": "bash_complete"}
    assert offered in shell(env=os.environ | asked).stdout


def test_the_completion_of_the_help_is_a_script():
    said = shell(env=os.environ | {"_JOUNCE_COMPLETE": "bash_source"}).stdout
    assert "complete" in said
    assert "_JOUNCE_COMPLETE=bash_source" in shell("--help").stdout
