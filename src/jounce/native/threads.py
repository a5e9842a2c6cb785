"""A batch in parts, one for each thread: threads are kept for later calls, and all batch axes are split.

A caller computes a part itself, and those that no thread has begun when it is done: no call waits for another one's
parts, and a caller with the threads that are kept makes no more than there are processors, whatever it asks for.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextvars import copy_context
from functools import cache
from math import prod

Box = tuple[slice, ...]  # of a batch: a slice of each axis


def compute_in_parts(work: Callable[[Box], object], batch: tuple[int, ...], parts: int) -> None:
    """Call `work` on boxes that make up a batch, in as many threads as there are parts of equal size.

    Threads run in the caller's context, where `numpy.errstate` is kept. An error is raised once all have ended.
    """
    count = prod(batch)
    cuts = [count * i // parts for i in range(parts + 1)]

    def part(i: int) -> None:
        for box in boxes(batch, cuts[i], cuts[i + 1]):
            work(box)

    later = [_pool().submit(copy_context().run, part, i) for i in range(1, parts)]
    try:
        part(0)
        for i, one in enumerate(later, 1):
            if one.cancel():
                part(i)
    finally:  # whatever happens, no thread writes into the caller's arrays any more
        begun = [one for one in later if not one.cancel()]
        wait(begun)
    for one in begun:
        one.result()


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
def _pool() -> ThreadPoolExecutor:
    """The threads of this process besides callers; they are started when they are first needed."""
    return ThreadPoolExecutor(max(1, (os.cpu_count() or 1) - 1), thread_name_prefix="jounce")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # a forked process has none of its parent's threads
