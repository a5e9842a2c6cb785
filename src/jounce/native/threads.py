"""A batch in parts that threads take one after the other: threads are kept for later calls, all batch axes are split.

Parts of large batches become smaller towards the end: threads that begin late or run on slower processors take fewer
of them, and all end at about the same time (S. F. Hummel, E. Schonberg and L. E. Flynn, Factoring: a method for
scheduling parallel loops, Communications of the ACM 35, 1992). A caller takes parts itself: no call waits for another
one's, and a caller with the threads that are kept makes no more than there are processors, whatever it asks for.
"""

import os
from collections import deque
from collections.abc import Callable, Iterator
from contextvars import copy_context
from functools import cache
from itertools import accumulate, pairwise
from math import prod
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

Box = tuple[slice, ...]  # of a batch: a slice of each axis
ROUND_WEIGHTS = 4, 2, 1, 1  # of rounds of one part for each thread: half of what is left, the last one all of it
MIN_STATES_IN_ROUNDS = 2**13  # of a thread: the last parts, of 1,024 states, then take longer than to hand them out


def compute_in_parts(work: Callable[[Box], object], batch: tuple[int, ...], threads: int) -> None:
    """Call `work` on boxes that make up a batch, in a number of threads, the caller's among them.

    Threads run in the caller's context, where `numpy.errstate` is kept. An error is raised once all have ended.
    """
    from concurrent.futures import wait  # imported here to keep start-up fast

    parts = deque(pairwise(_cuts(prod(batch), threads)))

    def take_parts() -> None:
        while parts:
            try:
                start, end = parts.popleft()
            except IndexError:  # another thread took the last one
                return
            for box in boxes(batch, start, end):
                work(box)

    others = [_pool().submit(copy_context().run, take_parts) for _ in range(threads - 1)]
    try:
        take_parts()
    finally:  # whatever happens, no thread writes into the caller's arrays any more
        begun = [one for one in others if not one.cancel()]
        wait(begun)
    for one in begun:
        one.result()


def _cuts(count: int, threads: int) -> list[int]:
    """The numbers of states between which the parts lie, from 0 to all."""
    rounds = ROUND_WEIGHTS if count >= threads * MIN_STATES_IN_ROUNDS else (1,)
    weights = [weight for weight in rounds for _ in range(threads)]
    return [count * x // sum(weights) for x in accumulate(weights, initial=0)]


def boxes(batch: tuple[int, ...], start: int, end: int) -> Iterator[Box]:
    """The boxes of the states from one number to another, counted row after row: few, and in this order.

    >>> list(boxes((3, 4), 2, 9))
    [(slice(0, 1, None), slice(2, 4, None)), (slice(1, 2, None), slice(0, 4, None)), \
(slice(2, 3, None), slice(0, 1, None))]
    """
    if start >= end:
        return
    if len(batch) < 2:
        yield (slice(start, end),)
        return
    size = prod(batch[1:])
    first, last = -(-start // size), end // size  # whole rows
    if first > last:  # within one row
        yield from _boxes_in_row(batch, last, start - last * size, end - last * size)
        return
    yield from _boxes_in_row(batch, first - 1, start - (first - 1) * size, size)
    if first < last:
        yield (slice(first, last), *(slice(0, length) for length in batch[1:]))
    yield from _boxes_in_row(batch, last, 0, end - last * size)


def _boxes_in_row(batch: tuple[int, ...], row: int, start: int, end: int) -> Iterator[Box]:
    return ((slice(row, row + 1), *rest) for rest in boxes(batch[1:], start, end) if start < end)


@cache
def _pool() -> "ThreadPoolExecutor":
    """The threads of this process besides callers; they are started when they are first needed."""
    from concurrent.futures import ThreadPoolExecutor

    return ThreadPoolExecutor(max(1, (os.cpu_count() or 1) - 1), thread_name_prefix="jounce")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a forked process has none of its parent's threads
