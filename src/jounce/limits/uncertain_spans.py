"""Limits along measured motions: a value counts where two standard deviations lie between it and its limit.

One rule, whatever the deviations come from (noise, vibrations that a fit leaves out, the ends of a fit) and wherever it
is: a value that is beyond its bound by more than two deviations is broken, one that is within it by as much is kept,
and all else is undecided. Peaks between samples count. The value that is shown is the worst one in its window, where
deviations are near their median, or one outside that is decided.
"""

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np

from jounce.limits.deviations import compute_deviations
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.motion_polynomials import Pieces, split_part
from jounce.limits.peaks import find_peaks
from jounce.limits.ratios import LIMIT_TOLERANCE, SIGNS
from jounce.limits.worst_values import Spans, Worst, find_runs

DECISIVE_DEVIATIONS = 2.0  # between a value and its limit: 95 % of normal errors are smaller
_UNCERTAIN_TIMES_AT_ONCE = 20_000  # times judged together, which bounds working memory
_VALUES_AT_ONCE = 2000  # times evaluated together


def judge_samples(b: LimitedMotion, worst: Worst) -> Spans:
    """Judge a measured motion along all its time: its worst values, and where it is broken; returns where undecided."""
    undecided: Spans = {}
    for t, values in sample_values(b):
        judge_values(b, worst, t, values, undecided)
    return undecided


def sample_values(b: LimitedMotion) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Times (N,) along all the motion, those of peaks between its samples too, and the values there, part by part."""
    for t in _overlapping_parts(_collect_times(b)):
        yield from take_sides(b, t)


def take_sides(b: LimitedMotion, t: np.ndarray) -> Iterator[tuple[np.ndarray, dict[str, np.ndarray]]]:
    """Times (N,) and the values there: of those that are breaks what ends there, and of all what begins there."""
    jumps = np.intersect1d(t, [found.t for found in b.motion.breaks_to(b.rate_order)])
    if jumps.size:
        yield jumps, b.values(jumps, "left")
    yield t, _values(b, t)


def judge_values(
    b: LimitedMotion, worst: Worst, t: np.ndarray, values: Mapping[str, np.ndarray], undecided: Spans
) -> None:
    """Judge given values (N, joints) by kind at times (N,), and add the spans in which nothing is known."""
    off = compute_deviations(b, t.clip(*b.whole))
    for kind in b.kinds:
        unclear = _judge_kind(worst, kind, t, values[kind], off.get(kind, np.zeros_like(values[kind])))
        for j in np.flatnonzero(unclear.any(axis=0)).tolist():
            # from the last time before at which it is known to the first one after
            spans = [(float(t[max(i - 1, 0)]), float(t[min(k + 1, len(t) - 1)])) for i, k in find_runs(unclear[:, j])]
            undecided[kind, j] = undecided.get((kind, j), []) + spans


def _judge_kind(worst: Worst, kind: str, t: np.ndarray, values: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Count values (N, joints) of a kind; returns which are neither kept nor broken on any side."""
    start, stop = worst.b.window(kind)
    inside = ((t >= start) & (t <= stop))[:, None]
    unclear, broken = (np.zeros(values.shape, dtype=bool) for _ in range(2))
    for sign in SIGNS:
        excess = sign * values - worst.b.scales[kind].tolerant(sign)
        beyond, within = excess > DECISIVE_DEVIATIONS * off, excess <= -DECISIVE_DEVIATIONS * off
        shown = np.where(inside | beyond | within, sign * values, -np.inf)
        worst.take_values(kind, sign, t, shown, beyond)
        unclear |= ~(beyond | within) & np.isfinite(worst.b.scales[kind].bound(sign))
        broken |= beyond
    return unclear & ~broken


def _overlapping_parts(t: np.ndarray) -> Iterator[np.ndarray]:
    """Parts of times, of which each begins with the last time of the one before."""
    for start in range(0, max(1, len(t) - 1), _UNCERTAIN_TIMES_AT_ONCE - 1):
        yield t[start : start + _UNCERTAIN_TIMES_AT_ONCE]


def _collect_times(b: LimitedMotion) -> np.ndarray:
    """The times of the pieces of a motion, and when values have peaks."""
    every = [np.array(b.whole)]
    for pieces in split_part(b, b.whole):
        every += [pieces.start, pieces.stop, find_peaks(b, pieces, partial(_any_peak, b)).t]
    return np.unique(np.concatenate(every))


def _any_peak(b: LimitedMotion, pieces: Pieces, kind: str, sign: int) -> np.ndarray:
    """What peaks must reach where a value is bounded on this side: more than the ends of their piece."""
    scale = b.scales[kind]
    ends = np.maximum(sign * pieces.left[kind], sign * pieces.right[kind])
    with np.errstate(invalid="ignore"):  # of infinite bounds
        return np.where(np.isfinite(scale.bound(sign)), ends + LIMIT_TOLERANCE * np.abs(scale.reach(sign)), np.inf)


def _values(b: LimitedMotion, t: np.ndarray) -> dict[str, np.ndarray]:
    blocks = [b.values(t[i : i + _VALUES_AT_ONCE]) for i in range(0, len(t), _VALUES_AT_ONCE)]
    return {kind: np.concatenate([block[kind] for block in blocks]) for kind in b.kinds}
