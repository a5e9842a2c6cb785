"""The command on a terminal and off it: bars, colours, completion."""

import contextlib
import io
import os
import re
from time import monotonic

import pytest
from click.testing import CliRunner
from test_cli import shell

from jounce.cli import main, output
from jounce.cli.output import ProgressLine, align_columns, show_progress
from jounce.core.progress import count_through, listen, stage


class Screen(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def clock(monkeypatch):
    """Seconds that only tests let pass."""
    now = [100.0]
    monkeypatch.setattr(output, "monotonic", lambda: now[0])
    return now


def line_after(clock, seconds, reports=(), label="working"):
    """What a line shows after a stage of some seconds, with reports of (time, done, total, states)."""
    screen, start = Screen(), clock[0]
    line = ProgressLine(screen)
    with listen(line), stage(label) as advance:
        for after, *report in reports:
            clock[0] = start + after
            advance(*report)
        clock[0] = start + seconds
        line.draw(clock[0])
    return screen.getvalue().split("\r")


@pytest.mark.parametrize(
    ("seconds", "reports", "shown"),
    [
        (1.9, [], []),  # short work
        (2.1, [], ["working: 2 s"]),
        (7.0, [(6.9, 1, 10)], ["working: 10%, 7 s"]),  # one report has no rate
        (60.0, [(31.0, 0, 100), *((31.0 + i, i, 100) for i in range(1, 30))], ["working: 29%, 71 s left"]),
        (33.0, [(31.0, 500, 1000), (33.0, 600, 1000)], ["working: 60%, 8 s left"]),  # not of the start-up
        (35.0, [(33.0, 0, 8, 0), (35.0, 4, 8, 1000)], ["working: 50%, 500 states/s, 2 s left"]),
        (37.0, [(33.0, 0, 8), (35.0, 4, 8)], ["working: 50%, 0 s left"]),  # time goes on without a report
        (40.0, [(30.0, 1, 90001), (40.0, 2, 90001)], ["working: 0%, 250.0 h left"]),
    ],
)
def test_a_line_shows_what_is_done_and_what_is_left(clock, seconds, reports, shown):
    said = "".join(line_after(clock, seconds, reports)).strip()
    assert any(text in said for text in shown) if shown else not said


def test_estimates_follow_the_last_seconds(clock):
    """A tenth of the speed after the first half: what is left takes ten times as long."""
    quick = [(i, 10 * i, 1000) for i in range(51)]
    slow = [(50 + i, 500 + i, 1000) for i in range(1, 31)]
    assert "53%, 8 min left" in "".join(line_after(clock, 80.0, [*quick, *slow]))


def test_the_line_goes_when_work_ends_or_fails(clock):
    for error in (None, ValueError("stop")):
        screen = Screen()
        line = ProgressLine(screen)
        with contextlib.suppress(ValueError), listen(line), stage("outer"), stage("working") as advance:
            advance(1, 3)
            clock[0] += 3
            line.draw(clock[0])
            if error:
                raise error
        assert screen.getvalue().startswith("\rworking: 33%")
        *_, blank, end = screen.getvalue().split("\r")
        assert (blank.strip(), end) == ("", "")
        assert len(blank) >= len("working: 33%")


def test_the_innermost_stage_that_reports_is_shown(clock):
    screen = Screen()
    line = ProgressLine(screen)
    with listen(line), stage("whole") as advance, stage("part"):
        clock[0] += 3
        line.draw(clock[0])
        advance(1, 2)
        line.draw(clock[0])
    assert re.findall(r"(\w+): ", screen.getvalue()) == ["part", "whole"]


@pytest.mark.parametrize(("stream", "shown"), [(Screen(), True), (io.StringIO(), False)], ids=["terminal", "file"])
def test_commands_have_a_line_on_terminals_alone(monkeypatch, stream, shown):
    monkeypatch.setattr("sys.stderr", stream)
    monkeypatch.setattr(output, "PATIENCE", 0.0)
    with show_progress() as line, stage("working"):
        assert (line is not None) == shown
        if line is not None:
            line.draw(monotonic())
    assert ("working" in stream.getvalue()) == shown


def test_stages_without_a_listener_do_nothing():
    assert list(count_through("working", "abc", 3)) == ["a", "b", "c"]


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
