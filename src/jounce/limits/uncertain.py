"""Limits outside of their windows: a value counts there where two deviations lie between it and its limit."""

from collections.abc import Iterator

import numpy as np

from jounce.limits.bounded import Bounded, Span
from jounce.limits.deviations import deviations_of
from jounce.limits.worst import SIGNS, Worst, runs

DECISIVE_DEVIATIONS = 2.0  # between a value and its limit: from there on it is known on which side the value lies
BLOCK = 2000  # times worked on at a time

Spans = dict[tuple[str, int], list[Span]]  # by kind and joint


def take_uncertain(b: Bounded, worst: Worst) -> Spans:
    """Count values outside of windows, at rows and between them; returns the spans in which nothing is known."""
    undecided: Spans = {}
    for part, t in _outside(b):
        values, off = _values(part, t), deviations_of(part, t)
        for kind in part.kinds:
            start, stop = b.window(kind)
            mine = (t <= start) if t[0] < start else (t >= stop)
            unclear = _take(worst, kind, t[mine], values[kind][mine], off[kind][mine])
            for j in np.flatnonzero(unclear.any(axis=0)).tolist():
                spans = [(float(t[mine][i]), float(t[mine][k + 1])) for i, k in runs(unclear[:, j])]
                undecided[kind, j] = undecided.get((kind, j), []) + spans
    return undecided


def _outside(b: Bounded) -> Iterator[tuple[Bounded, np.ndarray]]:
    """The times before windows and those after them, with the kinds of these windows."""
    rows = np.unique([*b.motion.times, *(end for span in b.windows.values() for end in span)])
    t = np.union1d(rows, (rows[1:] + rows[:-1]) / 2)
    first, last = b.whole
    before = {kind: start for kind, (start, _) in b.windows.items() if start > first}
    after = {kind: stop for kind, (_, stop) in b.windows.items() if stop < last}
    if before:
        yield b.of_kinds(before), t[t <= max(before.values())]
    if after:
        yield b.of_kinds(after), t[t >= min(after.values())]


def _values(b: Bounded, t: np.ndarray) -> dict[str, np.ndarray]:
    blocks = [b.values(t[i : i + BLOCK]) for i in range(0, len(t), BLOCK)]
    return {kind: np.concatenate([block[kind] for block in blocks]) for kind in b.kinds}


def _take(worst: Worst, kind: str, t: np.ndarray, values: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Count the values (N, joints) of a kind that are known; returns the intervals (N - 1, joints) with others."""
    unclear, broken = (np.zeros(values.shape, dtype=bool) for _ in range(2))
    for sign in SIGNS:
        excess = sign * values - worst.tolerant(kind, sign)
        beyond, within = excess > DECISIVE_DEVIATIONS * off, excess <= -DECISIVE_DEVIATIONS * off
        worst.take_values(kind, sign, t, np.where(beyond | within, sign * values, -np.inf), beyond)
        unclear |= ~(beyond | within) & np.isfinite(excess)
        broken |= beyond
    unclear &= ~broken
    return unclear[:-1] | unclear[1:]
