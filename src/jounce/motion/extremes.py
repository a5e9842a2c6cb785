"""The largest values of channels, those that are known well, and sums of squares; and those of several stretches.

Sums are added in the order of the stretches, so that they are the same to the last bit whatever computes these.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import inf, isnan
from typing import NamedTuple

import numpy as np

from jounce.motion import reliability
from jounce.motion.channel import Channel, Span
from jounce.motion.motion import Motion

MAX_PEAK_ROWS = 10_000  # of a motion at a time: a few MB


class Peak(NamedTuple):
    """The largest absolute value, its standard deviation, 0 where it is exact, and its time."""

    value: float
    deviation: float
    t: float


class Extremes(NamedTuple):
    """Of a column the largest value, the largest one that is known well, and the sum of squares."""

    largest: Peak
    certain: Peak
    squares: float


PeaksByJoint = Mapping[str, Mapping[str, Extremes]]  # of joints or motors, by quantity


def find_extremes(channels: Sequence[Channel]) -> PeaksByJoint:
    """The extremes of channels at the same times, by joint or motor and quantity."""
    found: dict[str, dict[str, Extremes]] = {}
    for channel in channels:
        t = channel.times
        for k, (quantity, rate) in enumerate(zip(channel.rate_names, channel.rates, strict=True)):
            x, off = np.asfortranarray(rate), None if channel.deviations is None else channel.deviations[k]
            largest = certain = _find_peaks(t, x, off)
            if channel.windows and off is not None:
                start, stop = channel.windows[k]
                known = ((start <= t) & (t <= stop))[:, None] | (off <= reliability.MAX_CERTAIN_SHARE * np.abs(x))
                certain = _find_peaks(t, np.where(known, x, np.nan), off)
            squares = np.einsum("ij,ij->j", x, x).tolist()
            for name, *of in zip(channel.names, largest, certain, squares, strict=True):
                found.setdefault(name, {})[quantity] = Extremes(*of)
    return found


def _find_peaks(t: np.ndarray, x: np.ndarray, deviations: np.ndarray | None) -> list[Peak]:
    """Of each column the absolute value that is largest less its band; no NaN."""
    columns, high, low = np.arange(x.shape[1]), x.argmax(axis=0), x.argmin(axis=0)
    at = np.where(x[high, columns] >= -x[low, columns], high, low)
    if deviations is not None or np.isnan(x[at, columns]).any():
        at = reliability.find_surest_rows(x, np.zeros_like(x) if deviations is None else deviations)
    off = np.zeros(len(at)) if deviations is None else deviations[at, columns]
    return list(map(Peak._make, np.column_stack([np.abs(x[at, columns]), off, t[at]]).tolist()))


def find_motion_extremes(motion: Motion, joints: Sequence[str], order: int, windows: Sequence[Span]) -> PeaksByJoint:
    """The extremes of q and its rates along a motion, known well in windows; none of joints of several numbers."""
    found: PeaksByJoint = {}
    for start in range(0, 0 if motion.several else len(motion.times), MAX_PEAK_ROWS):
        t = motion.times[start : start + MAX_PEAK_ROWS]
        spread = motion.deviations(t, order)
        q = Channel("q", tuple(joints), ("",) * len(joints), t, motion(t, order), spread, tuple(windows))
        more = find_extremes([q])
        found = merge_peaks(found, more) if found else more
    return found


def merge_peaks(first: PeaksByJoint, second: PeaksByJoint) -> PeaksByJoint:
    """The extremes of the same columns over two stretches."""
    return {
        joint: {name: merge_extremes(of, second[joint][name]) for name, of in found.items()}
        for joint, found in first.items()
    }


def merge_extremes(first: Extremes, second: Extremes) -> Extremes:
    """The extremes of both of two stretches of a column."""
    largest = surest_peak([first.largest, second.largest])
    certain = surest_peak([first.certain, second.certain])
    return Extremes(largest, certain, first.squares + second.squares)


def surest_peak(peaks: Iterable[Peak]) -> Peak:
    """The first of the peaks that are largest less their bands; NaN if all are."""
    return max(
        peaks, key=lambda peak: -inf if isnan(peak.value) else peak.value - reliability.BAND_DEVIATIONS * peak.deviation
    )


def tabulate_peaks(motions: Mapping[str, tuple[int, PeaksByJoint]], kinds: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns of a table with a row per motion and joint: ``Q_peak, Qd_peak, ..., Q_rms, ...``.

    Of each motion there are the number of its rows and its peaks.
    """
    rows = [(motion, joint, count, found) for motion, (count, of) in motions.items() for joint, found in of.items()]
    names, joints, counts, extremes = (list(column) for column in zip(*rows, strict=True))
    columns = {"motion": np.array(names), "joint": np.array(joints), "rows": np.array(counts)}
    for kind in kinds:
        for name in dict.fromkeys(name for found in extremes for name in found):
            columns[f"{name}_{kind}"] = np.array(
                [
                    REDUCTIONS[kind](found[name], n) if name in found else np.nan
                    for found, n in zip(extremes, counts, strict=True)
                ]
            )
    return columns


REDUCTIONS: Mapping[str, Callable[[Extremes, int], float]] = {
    "peak": lambda found, rows: found.largest.value,
    "rms": lambda found, rows: float(np.sqrt(found.squares / rows)),
}
