"""Property tests run the same examples everywhere, however slow the machine.

Native code is compiled without LLVM's optimizations of machine code, which change no bit of its results: most kernels
run once or twice. tests/native and processes that tests start compile it as users do.
"""

import ctypes
import gc
import mmap
import os
import sys
from collections import defaultdict
from pathlib import Path
from random import SystemRandom

import pytest
from hypothesis import settings

from support import machine_code
from support.tiers import LONG_TESTS, OUTSIDE, SLOW_TESTS, TESTS, base_name, listed_tests

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # each core has a worker: threads of small products only wait
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")  # every function is compiled for a call or two

# data, generated tests in Python among them; programs for type checkers
collect_ignore = ["golden", "types/mistakes.py", "types/right.py", "types/editor.py"]

STATM, PAGE = Path("/proc/self/statm"), mmap.PAGESIZE
GROWTH = 500  # MiB
left = 0.0  # MiB of this process when it was tidied last

gc.set_threshold(10_000_000, 50, 1000)  # traces make many objects, few cycles

settings.register_profile("jounce", deadline=None, max_examples=10, derandomize=True)
settings.register_profile("thorough", settings.get_profile("jounce"), max_examples=50)  # of `make fuzz`
settings.load_profile("jounce")

machine_code.compile_quickly()


def pytest_addoption(parser):
    parser.addoption(
        "--tier",
        choices=("quick", "test", "all"),
        default="all",
        help="quick: the first case of each test that is not slow; test: none that is long or outside, sweeps "
        "in part; all: everything.",
    )
    lists = f"{SLOW_TESTS.name} and {LONG_TESTS.name}"
    parser.addoption("--list-slow", action="store_true", help=f"Write {lists}, of all tests but those outside.")
    parser.addoption(
        "--refresh-golden", action="store_true", help="Replace the digests of generated code by those of now."
    )
    parser.addoption("--fuzz-seconds", type=float, default=0, help="Of attacks; a part of a round each if 0.")
    parser.addoption("--fuzz-seed", type=int, help="Of the first round; random where seconds are given, else 0.")


def pytest_configure(config):
    """Marks, the plugin that lists slow tests, and one seed for all workers.

    Workers take over the options of the process that starts them.
    """
    if config.option.list_slow:
        from support import slow_tests

        config.pluginmanager.register(slow_tests)
    config.addinivalue_line("markers", "outside: left to `make test-all`: it starts what is slow and no part of jounce")
    config.addinivalue_line("markers", "sweep(n): of its many cases `make test` runs n, `make test-all` all")
    if config.option.fuzz_seed is None:
        config.option.fuzz_seed = SystemRandom().randrange(10**6) if config.option.fuzz_seconds else 0


def pytest_report_header(config):
    return f"fuzz: seed {config.option.fuzz_seed}, {config.option.fuzz_seconds:g} s"


def pytest_ignore_collect(collection_path, config):
    """Modules of other tiers are not even imported."""
    tier = config.option.tier
    if not collection_path.is_relative_to(TESTS):  # examples of docstrings
        return True if tier != "all" else None
    below = collection_path.relative_to(TESTS).as_posix()
    left_out = tier != "all" and any(below == path or below.startswith(f"{path}/") for path in OUTSIDE)
    return True if left_out else None


@pytest.hookimpl(tryfirst=True)
def pytest_generate_tests(metafunc):
    """For `make quick` only the first case of each test is made: one robot, one method, one reader."""
    if metafunc.config.option.tier != "quick":
        return
    parametrize = metafunc.parametrize

    def parametrize_once(names, values, *more, ids=None, **options):
        ids = ids if ids is None or callable(ids) else list(ids)[:1]
        return parametrize(names, list(values)[:1], *more, ids=ids, **options)

    metafunc.parametrize = parametrize_once


def pytest_collection_modifyitems(config, items):
    """The tests of the tier.

    Of a test marked `sweep`, which takes long for all its cases, `make test` runs as many as the mark says, evenly.
    """
    tier = config.option.tier
    if tier == "all":
        return
    left = set() if config.option.list_slow else listed_tests(SLOW_TESTS if tier == "quick" else LONG_TESTS)
    cases = defaultdict(list)
    for item in items:
        if item.get_closest_marker("outside") is None and base_name(item.nodeid) not in left:
            cases[base_name(item.nodeid)].append(item)
    taken = set()
    for of_test in cases.values():
        sweep = of_test[0].get_closest_marker("sweep")
        most = sweep.args[0] if sweep else len(of_test)
        step = max(1, len(of_test) / most)
        taken.update(of_test[int(k * step)] for k in range(min(most, len(of_test))))
    config.hook.pytest_deselected(items=[item for item in items if item not in taken])
    items[:] = [item for item in items if item in taken]


def pytest_collection_finish():
    """What is imported stays: no search for cycles goes through it again."""
    gc.freeze()


def pytest_unconfigure():
    """So that libraries find nothing of theirs left when the process ends."""
    gc.unfreeze()


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    """Native code of the tests is compiled by them, once for all workers, and leaves nothing in the user's cache."""
    own = tmp_path_factory.getbasetemp()
    shared = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
    kept = os.environ.get("JOUNCE_TEST_KERNELS")  # by whoever runs some tests many times
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JOUNCE_CACHE_DIR", kept or str(shared / "kernels"))
        yield


def bundled(name, **options):
    import jounce  # here, since the settings above come before NumPy

    return jounce.load(name, **options)


@pytest.fixture(scope="session")
def closed():
    """The bundled robots with closed loops by name."""
    from support.closed_robots import LOOP_ROBOTS

    return {name: bundled(name) for name in LOOP_ROBOTS}


@pytest.fixture(scope="session")
def bundled_fivebar(closed):
    return closed["fivebar"]


@pytest.fixture(scope="session")
def dog():
    """A quadruped that floats."""
    return bundled("solo12", base="floating")


@pytest.fixture(scope="session")
def panda():
    """The bundled arm with a closed hand and its limits."""
    return bundled("panda", lock={"panda_finger_joint1": 0.0}).with_limits("panda")


@pytest.fixture
def as_shipped():
    """Native code is compiled with LLVM's optimizations, as users get it."""
    with machine_code.optimized():
        yield


def resident():
    """The memory of this process in MiB; 0 where Linux does not tell."""
    pages = STATM.read_text().split()[1] if STATM.exists() else 0
    return int(pages) * PAGE / 2**20


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown():
    """Free what JAX compiled, cycles and free pages where tests leave much of it: a worker would grow to gigabytes."""
    global left
    if resident() < left + GROWTH:
        return
    if jax := sys.modules.get("jax"):
        jax.clear_caches()
    gc.collect()
    if trim := getattr(ctypes.CDLL(None), "malloc_trim", None):  # of glibc alone
        trim(0)
    left = resident()


def pytest_terminal_summary(terminalreporter):
    """Tables that tests have recorded, a row each, as the property "robots"."""
    reports = terminalreporter.getreports("passed") + terminalreporter.getreports("failed")
    rows = sorted(tuple(map(str, row)) for r in reports for name, row in r.user_properties if name == "robots")
    if rows:
        terminalreporter.section("robots of example-robot-data against Pinocchio: n, bodies, errors of Q and M")
        for name, n, nb, *found in rows:
            terminalreporter.write_line(f"{name:48} {n:>3} {nb:>3}  {'  '.join(found)}")
