"""A plugin of pytest that writes the list of slow tests, which `make slow` asks for."""

import os
from collections import defaultdict

import pytest

from support.tiers import QUICK_CASE, SLOW_TESTS, base_name

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
    """Write the list, once for all workers."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        slow = sorted(name for name, cases in spent.items() if sum(cases) > QUICK_CASE * len(cases))
        SLOW_TESTS.write_text("".join(f"{name}\n" for name in slow), encoding="utf-8")
