"""A plugin of pytest that records which functions of some modules each test calls, and how long the test takes.

``RECORDED_MODULES`` lists the files, ``RECORDED_CALLS`` is the file of JSON to write.
"""

import json
import os
import sys
from collections import defaultdict
from pathlib import Path
from time import perf_counter
from types import FrameType

import pytest

MODULES = frozenset(os.environ.get("RECORDED_MODULES", "").split(os.pathsep))
called: dict[str, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))  # by module and function, the tests
seconds: dict[str, float] = defaultdict(float)
current = [""]


def record(frame: FrameType, event: str, _: object) -> None:
    """Note a call; lines are not traced."""
    code = frame.f_code
    if code.co_filename in MODULES:
        called[code.co_filename][code.co_qualname].add(current[0])


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item):
    """Trace the calls of a test with its fixtures."""
    current[0], start = item.nodeid, perf_counter()
    sys.settrace(record)
    yield
    sys.settrace(None)
    seconds[item.nodeid] += perf_counter() - start


def pytest_sessionfinish():
    """Write what was recorded."""
    found = {module: {name: sorted(tests) for name, tests in names.items()} for module, names in called.items()}
    text = json.dumps({"called": found, "seconds": seconds})
    Path(os.environ["RECORDED_CALLS"]).write_text(text, encoding="utf-8")
