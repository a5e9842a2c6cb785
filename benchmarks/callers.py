"""A plugin of pytest that records which functions of some modules each test calls, and the processor time of the test.

Each test runs in a child of its own, so that nothing which an earlier one has computed hides a call. ``MUTANTS_JOB`` is
a file of JSON that names the files of the modules and the file of JSON lines to write: one of what importing and
collecting call, then one of each test.
"""

import json
import os
import sys
import threading
from pathlib import Path
from types import FrameType

import pytest

from benchmarks.forks import run_forked, used_time

JOB = json.loads(Path(os.environ["MUTANTS_JOB"]).read_text(encoding="utf-8"))
FILES = frozenset(JOB["files"])
called: set[tuple[str, str]] = set()
failures: list[str] = []
started: list[str] = []  # processes of Python


def record(frame: FrameType, event: str, _: object) -> None:
    """Note a call; lines are not traced."""
    code = frame.f_code
    if code.co_filename in FILES:
        called.add((code.co_filename, code.co_qualname))


def note_process(event: str, given: tuple) -> None:
    """Note a process of Python, whose calls are not seen."""
    if event == "subprocess.Popen" and sys.executable in map(os.fsdecode, given[1]):
        started.append(sys.executable)


sys.addaudithook(note_process)
threading.settrace(record)
sys.settrace(record)  # of what is imported and collected


def write(test: str) -> None:
    """Add the line of a test."""
    found = {"test": test, "seconds": used_time(), "called": sorted(called)}
    found |= {"starts_processes": bool(started), "failures": failures}
    with Path(JOB["output"]).open("a", encoding="utf-8") as file:
        file.write(json.dumps(found) + "\n")


def run(item: pytest.Item) -> int:
    """Record one test with its fixtures."""
    called.clear()
    sys.settrace(record)
    item.ihook.pytest_runtest_protocol(item=item, nextitem=None)
    sys.settrace(None)
    write(item.nodeid)
    return 0


def pytest_runtest_logreport(report):
    """Note what failed."""
    if report.failed:
        failures.append(f"{report.nodeid}: {report.longreprtext}")


def pytest_runtestloop(session):
    """Record each test in a child."""
    sys.settrace(None)
    threading.settrace(None)
    write("")
    threading.settrace(record)
    for item in session.items:
        if run_forked(lambda item=item: run(item)):
            raise pytest.UsageError(f"{item.nodeid} ended its process")
    return True
