"""What `make quick` and `make test` leave to the larger tiers; conftest.py does it."""

from pathlib import Path

TESTS = Path(__file__).parents[1]

# What `make test` leaves to `make test-all`, below tests/: what runs pages and notebooks, starts browsers and compilers
# of other languages, or attacks at random. Single tests elsewhere are marked `outside`.
OUTSIDE = ("casadi", "codegen", "cuda", "docs", "examples", "fuzz", "report/test_browser.py", "symbolic", "types")

# What `make quick` leaves to `make test`: tests of which a case takes more than QUICK_CASE s of the processor on
# average, with its fixtures, when `make slow` writes the list.
SLOW_TESTS, QUICK_CASE = TESTS / "slow_tests.txt", 0.1


def base_name(nodeid):
    """The name of a test without its case."""
    return nodeid.partition("[")[0]
