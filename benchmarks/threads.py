"""Forces by threads: a batch in as many parts as there are threads, up to as many as there are cores."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks import machine
from benchmarks.measure import Case
from benchmarks.robots import states
from jounce import load

ROBOTS = {"iiwa14": (1_000, 100_000), "g1": (1_000, 20_000)}  # robots, and how many states they compute
ORDER = 2


def counts() -> list[int]:
    """One thread, two, four, ... and as many as there are cores."""
    most = machine.cores()
    return sorted({*(2**k for k in range(most.bit_length())), most})


def cases() -> Iterator[Case]:
    """Keyed ("threads", robot, states, threads), into `out`."""
    for name, batches in ROBOTS.items():
        kernel = load(name).compile(order=ORDER)
        for count in batches:
            rates = states(kernel.mechanism.n, count, ORDER)
            out = [np.empty_like(rates[0]) for _ in range(ORDER + 1)]
            for threads in counts():
                call = partial(kernel, *rates, out=out, threads=threads)
                yield Case(("threads", name, count, threads), call, count)
