"""What `make quick` and `make test` leave to the larger tiers; conftest.py does it."""

from pathlib import Path

TESTS = Path(__file__).parents[1]

# What `make test` leaves to `make test-all`, below tests/: what runs pages and notebooks, starts browsers and compilers
# of other languages, or attacks at random. Single tests elsewhere are marked `outside`. Examples of docstrings are
# left there, too.
OUTSIDE = ("casadi", "codegen", "cuda", "docs", "examples", "fuzz", "report/test_browser.py", "symbolic", "types")

# `make slow` writes which tests take more than so many seconds of the processor a case on average, with their fixtures:
# SLOW_TESTS are left to `make test` by `make quick`, and LONG_TESTS to `make test-all` by `make test`.
SLOW_TESTS, QUICK_CASE = TESTS / "slow_tests.txt", 0.05
LONG_TESTS, LONG_CASE = TESTS / "long_tests.txt", 0.25

# Never long: what notices mutants of the rooms that decide (benchmarks/MUTANTS.md), but for those of limits, of which
# many more notice each: there half a second is long.
ALWAYS = (
    "cli/test_cli_cache.py",
    "dynamics/test_steep",
    "io/test_defective_logs.py",
    "io/test_log_rows.py",
    "io/test_mat.py",
    "io/test_npz.py",
    "io/test_stamps.py",
    "io/test_table",
    "live/test_guard",
    "loops/test_near_singular.py",
    "native/test_code_digest.py",
    "native/test_kernel_cache.py",
)

LIMITS, LONG_CASE_OF_LIMITS = ("limits/", "contacts/test_contact_ratios.py"), 0.5


def base_name(nodeid):
    """The name of a test without its case."""
    return nodeid.partition("[")[0]


def listed_tests(path):
    """The names of the tests of a list."""
    return set(path.read_text(encoding="utf-8").splitlines())


def is_long(name, seconds):
    """Whether `make test` leaves a test to `make test-all` whose cases take so many seconds of the processor."""
    path = name.removeprefix(f"{TESTS.name}/")
    longest = LONG_CASE_OF_LIMITS if path.startswith(LIMITS) else LONG_CASE
    return seconds > longest and not path.startswith(ALWAYS)
