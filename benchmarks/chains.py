"""Chains of n joints: the closed form, the recursion in NumPy and what users get, over n and the order."""

from collections.abc import Iterator
from functools import partial

from benchmarks.measure import Case, roughly, seconds
from benchmarks.robots import chain, states
from jounce import Robot

SIZES = (2, 4, 7, 10, 14, 20, 30, 50, 100)
ORDERS = (0, 2, 4)
METHODS = {"robot.inverse_dynamics": None, "recursion in NumPy": "recursion", "closed form in NumPy": "closed_form"}
BATCHES = (10, 100, 1_000)  # states; the largest that a call has time for
LONGEST = 0.25  # s, of a call; where ten states take longer, longer chains are left out
PATIENCE = 20.0  # s, of a first call, which compiles


def cases() -> Iterator[Case]:
    """Keyed ("chain", method, order, n)."""
    for order in ORDERS:
        for name, method in METHODS.items():
            for n in SIZES:
                robot = chain(n)
                first = seconds(_call(robot, order, BATCHES[0], method))
                found, took = _largest(robot, order, method)
                yield Case(("chain", name, order, n), *found)
                if first > PATIENCE or took > LONGEST:
                    break


def _largest(robot: Robot, order: int, method: str | None) -> tuple[tuple[partial[object], int], float]:
    """The call on the largest batch that there is time for, its size, and the time it takes."""
    count = BATCHES[0]
    call = _call(robot, order, count, method)
    took = roughly(call)
    for more in BATCHES[1:]:
        larger = _call(robot, order, more, method)
        if took > LONGEST or (longer := roughly(larger)) > LONGEST:
            break
        call, count, took = larger, more, longer
    return (call, count), took


def _call(robot: Robot, order: int, count: int, method: str | None) -> partial[object]:
    return partial(robot.inverse_dynamics, *states(robot.n, count, order), method=method)
