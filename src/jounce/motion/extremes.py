"""Find the largest values of channels, and sums of squares.

Extremes of several stretches are merged. Sums are added in the order of the stretches, so that they are the same to the
last bit whatever computes the stretches.
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
    """The largest absolute value of a column."""

    value: float
    deviation: float  # standard deviation, 0 where the value is exact
    t: float


class Extremes(NamedTuple):
    """The extremes of a column."""

    largest: Peak
    certain: Peak  # the largest one that is known well
    squares: float  # the sum of squares


PeaksByJoint = Mapping[str, Mapping[str, Extremes]]  # of joints or motors, by quantity


def find_extremes(channels: Sequence[Channel]) -> PeaksByJoint:
    """Return the extremes of channels by joint or motor, and quantity.

    The channels are at the same times.
    """
    extremes: dict[str, dict[str, Extremes]] = {}
    for channel in channels:
        t = channel.times
        for k, (quantity, rate) in enumerate(zip(channel.rate_names, channel.rates, strict=True)):
            x, off = np.asfortranarray(rate), None if channel.deviations is None else channel.deviations[k]
            largest = certain = _find_peaks(t, x, off)
            # Well known are values in the window of the channel, and those whose deviation is a small share of them.
            if len(channel.windows) > 0 and off is not None:
                start, stop = channel.windows[k]
                is_certain = ((start <= t) & (t <= stop))[:, None] | (off <= reliability.MAX_CERTAIN_SHARE * np.abs(x))
                certain = _find_peaks(t, np.where(is_certain, x, np.nan), off)
            squares = np.einsum("ij,ij->j", x, x).tolist()
            for name, *of_column in zip(channel.names, largest, certain, squares, strict=True):
                extremes.setdefault(name, {})[quantity] = Extremes(*of_column)
    return extremes


def _find_peaks(t: np.ndarray, x: np.ndarray, deviations: np.ndarray | None) -> list[Peak]:
    """Return the peak of each column: the absolute value less its band.

    No NaN is a peak, unless all are.
    """
    # Without bands and NaN the largest and the least value suffice, which takes no memory for absolute ones.
    columns, high, low = np.arange(x.shape[1]), x.argmax(axis=0), x.argmin(axis=0)
    rows = np.where(x[high, columns] >= -x[low, columns], high, low)
    if deviations is not None or np.isnan(x[rows, columns]).any():
        rows = reliability.find_surest_rows(x, np.zeros_like(x) if deviations is None else deviations)
    off = np.zeros(len(rows)) if deviations is None else deviations[rows, columns]
    return list(map(Peak._make, np.column_stack([np.abs(x[rows, columns]), off, t[rows]]).tolist()))


def find_motion_extremes(motion: Motion, joints: Sequence[str], order: int, windows: Sequence[Span]) -> PeaksByJoint:
    """Return the extremes of q and its rates along a motion.

    They are known well in windows. Joints of several numbers have no extremes.
    """
    extremes: PeaksByJoint = {}
    for start in range(0, 0 if motion.several else len(motion.times), MAX_PEAK_ROWS):
        t = motion.times[start : start + MAX_PEAK_ROWS]
        deviations = motion.deviations(t, order)
        q = Channel("q", tuple(joints), ("",) * len(joints), t, motion(t, order), deviations, tuple(windows))
        more = find_extremes([q])
        extremes = more if len(extremes) == 0 else merge_peaks(extremes, more)
    return extremes


def merge_peaks(first: PeaksByJoint, second: PeaksByJoint) -> PeaksByJoint:
    """Return the extremes of the same columns over two stretches."""
    return {
        joint: {name: merge_extremes(extremes, second[joint][name]) for name, extremes in quantities.items()}
        for joint, quantities in first.items()
    }


def merge_extremes(first: Extremes, second: Extremes) -> Extremes:
    """Return the extremes of two stretches of a column."""
    largest = surest_peak([first.largest, second.largest])
    certain = surest_peak([first.certain, second.certain])
    return Extremes(largest, certain, first.squares + second.squares)


def surest_peak(peaks: Iterable[Peak]) -> Peak:
    """Return the first of the peaks that are largest less their bands.

    It is NaN if all are.
    """
    return max(
        peaks, key=lambda peak: -inf if isnan(peak.value) else peak.value - reliability.BAND_DEVIATIONS * peak.deviation
    )


def tabulate_peaks(motions: Mapping[str, tuple[int, PeaksByJoint]], kinds: Sequence[str]) -> dict[str, np.ndarray]:
    """Return columns of a table with a row per motion and joint.

    They are ``Q_peak, Qd_peak, ..., Q_rms, ...``. Of each motion there are the number of its rows and its peaks.
    """
    rows = []
    for motion, (count, joint_peaks) in motions.items():
        rows += [(motion, joint, count, quantities) for joint, quantities in joint_peaks.items()]
    names, joints, counts, extremes = (list(column) for column in zip(*rows, strict=True))
    columns = {"motion": np.array(names), "joint": np.array(joints), "rows": np.array(counts)}
    for kind in kinds:
        # Motions may have quantities of their own: the others have NaN there.
        for name in dict.fromkeys(name for quantities in extremes for name in quantities):
            columns[f"{name}_{kind}"] = np.array(
                [
                    REDUCTIONS[kind](quantities[name], n) if name in quantities else np.nan
                    for quantities, n in zip(extremes, counts, strict=True)
                ]
            )
    return columns


REDUCTIONS: Mapping[str, Callable[[Extremes, int], float]] = {
    "peak": lambda found, rows: found.largest.value,
    "rms": lambda found, rows: float(np.sqrt(found.squares / rows)),
}
