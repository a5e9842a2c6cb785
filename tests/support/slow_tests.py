"""A plugin of pytest that writes the lists of slow and of long tests, which `make slow` asks for."""

import os
from collections import defaultdict

import pytest

from support.tiers import LONG_TESTS, QUICK_CASE, SLOW_TESTS, TESTS, base_name, is_long

spent = defaultdict(list)  # s of the processor of each case, by test
begun = 0.0  # the processor's time when the part of a test began that is under way


def processor_time():
    """The time in s of this process and of those that it has started."""
    return sum(os.times()[:4])


def pytest_runtest_logstart():
    """A test begins."""
    global begun
    begun = processor_time()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    """A part of a test, as set-up, is over: its report tells the processor's time."""
    global begun
    report, now = (yield), processor_time()
    report.user_properties.append(("processor", now - begun))
    begun = now
    return report


def pytest_runtest_logreport(report):
    """Note how long each case takes with its fixtures; a process that dies reports no time."""
    cases = spent[base_name(report.nodeid)]
    if report.when == "setup" or not cases:
        cases.append(0.0)
    times = [seconds for name, seconds in report.user_properties if name == "processor"]
    cases[-1] += times[-1] if times else 0.0


def pytest_sessionfinish():
    """Write the lists, once for all workers; examples of docstrings are in none."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        usual = {name: sum(cases) / len(cases) for name, cases in spent.items() if name.startswith(f"{TESTS.name}/")}
        _write_list(SLOW_TESTS, [name for name, seconds in usual.items() if seconds > QUICK_CASE])
        _write_list(LONG_TESTS, [name for name, seconds in usual.items() if is_long(name, seconds)])


def _write_list(path, names):
    path.write_text("".join(f"{name}\n" for name in sorted(names)), encoding="utf-8")
