"""Times of calls, taken in turn: each round measures every case once, and the medians over the rounds count."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from statistics import median
from time import perf_counter

LONGEST = 0.4  # s; what takes longer in one call is left out
SAMPLE = 2e-3  # s, at least, between two readings of the clock
SHORT = 0.02  # s; calls up to this are made once before they are timed, so that their data are in the cache


@dataclass(frozen=True, eq=False)
class Case:
    """A call to be timed: the key of its figure, and how many states it computes."""

    key: tuple[object, ...]
    call: Callable[[], object]
    states: int = 1
    warm: bool = True  # False: a process of its own, of which one run suffices


def seconds(call: Callable[[], object]) -> float:
    """The time of one call."""
    start = perf_counter()
    call()
    return perf_counter() - start


def roughly(call: Callable[[], object]) -> float:
    """The time of a call, once warm where there is time for it; what compiles at its first call was called before."""
    first = seconds(call)
    return first if first > 2 * LONGEST else min(first, seconds(call))


def medians(cases: Sequence[Case], rounds: int, done: Callable[[], None]) -> dict[tuple[object, ...], float]:
    """Seconds per state of every case, the median over the rounds; `done` is called after each round."""
    rough = {case: roughly(case.call) for case in cases}
    samples: dict[Case, list[float]] = {case: [] for case in cases}
    for _ in range(rounds):
        for case, took in rough.items():
            samples[case].append(_sample(case, took) / case.states)
        done()
    return {case.key: median(found) for case, found in samples.items()}


def _sample(case: Case, took: float) -> float:
    """The time of a call that took about so long before, the mean over some in a row."""
    call, count = case.call, ceil(SAMPLE / took)
    if case.warm and took < SHORT:
        call()
    start = perf_counter()
    for _ in range(count):
        call()
    return (perf_counter() - start) / count
