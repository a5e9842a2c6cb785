"""Chains of n joints: the closed form, the recursion in NumPy and what users get, over n and the order."""

from collections.abc import Iterator
from functools import partial

from benchmarks.measure import LONGEST, Case, roughly, seconds
from benchmarks.robots import chain, states

SIZES = (2, 4, 7, 10, 14, 20, 30, 50, 100)
ORDERS = (0, 2, 4)
METHODS = {"robot.inverse_dynamics": None, "recursion in NumPy": "recursion", "closed form in NumPy": "closed_form"}
PATIENCE = 20.0  # s, of a first call, which compiles


def batch(name: str, n: int) -> int:
    """How many states are computed at once: the closed form's work for one grows with n^3."""
    return 1_000 if not name.startswith("closed") or n < 5 else 100 if n < 15 else 10


def cases() -> Iterator[Case]:
    """Keyed ("chain", method, order, n); where a chain takes too long, longer ones are left out."""
    for order in ORDERS:
        for name, method in METHODS.items():
            for n in SIZES:
                robot, count = chain(n), batch(name, n)
                call = partial(robot.inverse_dynamics, *states(n, count, order), method=method)
                if seconds(call) > PATIENCE or roughly(call) > LONGEST:
                    break
                yield Case(("chain", name, order, n), call, count)
