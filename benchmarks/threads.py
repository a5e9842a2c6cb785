"""Forces by threads, up to as many as there are cores, and what the cores can do at once at best.

Cores that are two threads of one slow each other down in registers already: no kernel can do better there.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks import machine, peaks
from benchmarks.measure import Case
from benchmarks.robots import ARMS, load, states
from jounce.native.kernel import Box, compute_in_parts

ROBOTS = dict.fromkeys(ARMS, (1_000, 100_000)) | {"g1": (1_000, 20_000)}  # robots, and how many states they compute
ORDER = 2
REGISTERS, MEMORY = "ns for 1,000 multiply-adds in registers", "ns for 1,000 bytes copied"
LOOPS = 64  # of multiply-adds, which the threads share


def counts() -> list[int]:
    """One thread, two, four, ... and as many as there are cores."""
    most = machine.cores()
    return sorted({*(2**k for k in range(most.bit_length())), most})


def cases() -> Iterator[Case]:
    """Keyed ("threads", REGISTERS or MEMORY, threads), and ("threads", robot, states, threads), into `out`."""
    yield from _limits()
    for name, batches in ROBOTS.items():
        kernel = load(name).compile(order=ORDER)
        for count in batches:
            rates = states(kernel.mechanism.n, count, ORDER)
            out = [np.empty_like(rates[0]) for _ in range(ORDER + 1)]
            for threads in counts():
                call = partial(kernel, *rates, out=out, threads=threads)
                yield Case(("threads", name, count, threads), call, count)


def _limits() -> Iterator[Case]:
    loop, instructions = peaks.loop(("fma",)), peaks.TURNS * peaks.CHAINS * peaks.LENGTH
    source, target = np.ones(peaks.COPIED // 8), np.zeros(peaks.COPIED // 8)

    def compute(box: Box) -> None:
        for _ in range(LOOPS)[box[0]]:
            loop()

    def copy(box: Box) -> None:
        np.copyto(target[box], source[box])

    for threads in counts():
        computed = partial(compute_in_parts, compute, (LOOPS,), threads)
        yield Case(("threads", REGISTERS, threads), computed, LOOPS * instructions // 1000)
        copied = partial(compute_in_parts, copy, source.shape, threads)
        yield Case(("threads", MEMORY, threads), copied, 2 * peaks.COPIED // 1000)
