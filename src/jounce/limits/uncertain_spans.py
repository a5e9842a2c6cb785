"""Limits outside of their windows: a value counts there where two deviations lie between it and its limit."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from jounce.limits.deviations import compute_deviations
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.motion_polynomials import Pieces, split_part
from jounce.limits.peaks import find_peaks
from jounce.limits.ratios import SIGNS
from jounce.limits.worst_values import Spans, Worst, find_runs

_DECISIVE_DEVIATIONS = 2.0  # between a value and its limit: 95 % of normal errors are smaller
_UNCERTAIN_TIMES_AT_ONCE = 2000  # times evaluated together, which bounds working memory


def count_uncertain(b: LimitedMotion, worst: Worst) -> Spans:
    """Count values outside of windows, peaks between rows too; returns the spans in which nothing is known."""
    undecided: Spans = {}
    for part, t in _split_outside(b):
        values, off = _values(part, t), compute_deviations(part, t)
        for kind in part.kinds:
            start, stop = b.window(kind)
            mine = (t <= start) if t[0] < start else (t >= stop)
            unclear = _count_known(worst, kind, t[mine], values[kind][mine], off[kind][mine])
            for j in np.flatnonzero(unclear.any(axis=0)).tolist():
                spans = [(float(t[mine][i]), float(t[mine][k + 1])) for i, k in find_runs(unclear[:, j])]
                undecided[kind, j] = undecided.get((kind, j), []) + spans
    return undecided


def _split_outside(b: LimitedMotion) -> Iterator[tuple[LimitedMotion, np.ndarray]]:
    """The times before windows and those after them, with the kinds of these windows."""
    first, last = b.whole
    before = {kind: start for kind, (start, _) in b.windows.items() if start > first}
    after = {kind: stop for kind, (_, stop) in b.windows.items() if stop < last}
    if before:
        yield b.select_kinds(before), _collect_times(b.select_kinds(before), [first, *before.values()])
    if after:
        yield b.select_kinds(after), _collect_times(b.select_kinds(after), [*after.values(), last])


def _collect_times(b: LimitedMotion, ends: Sequence[float]) -> np.ndarray:
    """The times of pieces between the first and the last of some ends, these, and when values have peaks."""
    every = [np.array(ends)]
    for pieces in split_part(b, (min(ends), max(ends))):
        every += [pieces.start, pieces.stop, find_peaks(b, pieces, partial(_any_peak, b)).t]
    return np.unique(np.concatenate(every))


def _any_peak(b: LimitedMotion, pieces: Pieces, kind: str, sign: int) -> np.ndarray:
    """What peaks must reach: anything where a value is bounded on this side."""
    bound = b.scales[kind].bound(sign)
    return np.where(np.isfinite(bound), -np.inf, np.inf) + np.zeros((len(pieces.start), 1))


def _values(b: LimitedMotion, t: np.ndarray) -> dict[str, np.ndarray]:
    blocks = [b.values(t[i : i + _UNCERTAIN_TIMES_AT_ONCE]) for i in range(0, len(t), _UNCERTAIN_TIMES_AT_ONCE)]
    return {kind: np.concatenate([block[kind] for block in blocks]) for kind in b.kinds}


def _count_known(worst: Worst, kind: str, t: np.ndarray, values: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Count the values (N, joints) of a kind that are known; returns the intervals (N - 1, joints) with others."""
    unclear, broken = (np.zeros(values.shape, dtype=bool) for _ in range(2))
    for sign in SIGNS:
        excess = sign * values - worst.b.scales[kind].tolerant(sign)
        beyond, within = excess > _DECISIVE_DEVIATIONS * off, excess <= -_DECISIVE_DEVIATIONS * off
        worst.take_values(kind, sign, t, np.where(beyond | within, sign * values, -np.inf), beyond)
        unclear |= ~(beyond | within) & np.isfinite(excess)
        broken |= beyond
    unclear &= ~broken
    return unclear[:-1] | unclear[1:]
