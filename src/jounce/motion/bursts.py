"""Vibrations that last for a part of a log: lines in the spectra of parts of what an even fit leaves of the samples.

A fit whose intervals suit the motion before and after may not find a burst: to bisect an interval of a second explains
nothing of 25 Hz. Where it finds one, it does not follow the flanks, which are below the noise and most of their q4d.
Spectra of overlapping parts show both. A line of a part stands out of what that frequency has in most parts, of the
part's own frequencies, and of those below it, which a reach and the ringing of a fit have more of.
"""

from collections.abc import Iterator

import numpy as np

from jounce.motion.knot_selection import DensePart
from jounce.motion.knots import fit_breaks, median_length
from jounce.motion.samples import Samples
from jounce.motion.vibrations import BAND_TO_LINE, Line

BURST_PART_ROWS = 64, 256, 1024  # of the parts, which overlap by half: short bursts, and lines close to the noise
MIN_PARTS_OF_LOG = 4  # a line over most of a log is not that of a burst
FALSE_ALARMS_PER_LOG = 1e-3  # of white noise, for each length of parts
MIN_POWER_TO_LOWER = 4.0  # times the largest power at half the frequency and below: a reach has more power there
MIN_BURST_BIN = 6  # this number of waves passes in a part: fewer may be the motion itself
MIN_FREQUENCY_TO_BAND = 2.0  # times the end of the band of the even fit, which rings there
MIN_BURST_STEPS = 0.6  # of an encoder: a joint that stays between two steps has a line of half a step


def find_bursts(samples: Samples, breaks: np.ndarray, cells: int) -> list[Line]:
    """The bursts of each joint that a spline with these breaks does not follow to the ends of their flanks."""
    usual = median_length(breaks)
    rows, lowest = samples.all_rows(cells), MIN_FREQUENCY_TO_BAND / 2 / usual
    even = fit_breaks(rows, np.linspace(*samples.span, round(np.ptp(samples.span) / usual) + 1))
    residual = even.residual / rows.weight[:, None]
    found = (
        line for joint in range(samples.q.shape[1]) for line in _find_joint_bursts(samples, residual, joint, lowest)
    )
    return [line for line in found if not is_followed(line, breaks)]


def with_flanks(burst: Line, span: tuple[float, float]) -> DensePart:
    """From when to when a spline is to follow a burst, and with intervals of what length at most."""
    start, end = np.clip(burst.reach, *span).tolist()
    return start, end, 1 / (2 * BAND_TO_LINE * burst.frequency)


def is_followed(burst: Line, breaks: np.ndarray) -> bool:
    """Whether breaks are as dense as a burst and its flanks want them."""
    start, end, longest = with_flanks(burst, (breaks[0], breaks[-1]))
    over = (breaks[1:] > start + longest) & (breaks[:-1] < end - longest)
    return bool((np.diff(breaks)[over] < 1.01 * longest).all())


def _find_joint_bursts(samples: Samples, residual: np.ndarray, joint: int, lowest: float) -> Iterator[Line]:
    count, step = len(samples.t), float(samples.steps[joint])
    t = np.linspace(samples.t[0], samples.t[-1], count)
    row = t[1] - t[0]
    even = np.interp(t, samples.t, residual[:, joint])
    marked, frequency, amplitude = np.zeros(count, bool), np.zeros(count), np.zeros(count)
    for length in (length for length in BURST_PART_ROWS if count >= MIN_PARTS_OF_LOG * length):
        shorter = marked.copy()  # these have better times
        for start, at, size in _find_part_lines(even, np.arange(0, count - length + 1, length // 2), length, step):
            part = slice(start, start + length)
            if lowest < at / (length * row) and size > MIN_BURST_STEPS * step and not shorter[part].any():
                marked[part] = True
                frequency[part] = np.maximum(frequency[part], (at + 1) / (length * row))
                amplitude[part] = np.maximum(amplitude[part], size)
    for first, last in np.flatnonzero(np.diff(np.pad(marked.astype(int), 1))).reshape(-1, 2):
        highest, largest = float(frequency[first:last].max()), float(amplitude[first:last].max())
        yield Line(joint, highest, largest, (float(t[first]), float(t[last - 1])))


def _find_part_lines(even: np.ndarray, starts: np.ndarray, length: int, step: float) -> list[tuple[int, int, float]]:
    """Starts, bins and amplitudes of the largest lines of parts of evenly spaced residuals, where they stand out.

    Powers of white noise are exponentially distributed: one in N is more than ln N / ln 2 medians. That at half the
    rate is the square of one real number, is larger more often, and is left out.
    """
    window = np.hanning(length)
    spectra = np.fft.rfft(np.lib.stride_tricks.sliding_window_view(even, length)[starts] * window, axis=1)
    power = np.abs(spectra[:, :-1]) ** 2
    rounding = step**2 / 12 * (window**2).sum() * np.log(2)
    usual = np.maximum(np.median(power, axis=0), max(rounding, np.finfo(float).tiny))
    at = MIN_BURST_BIN + (power / usual)[:, MIN_BURST_BIN:].argmax(axis=1)
    size = power[np.arange(len(at)), at]
    below = np.maximum.accumulate(power[:, 1:], axis=1)[np.arange(len(at)), at // 2 - 1]
    enough = np.log(power.size / FALSE_ALARMS_PER_LOG) / np.log(2)
    out = size > np.maximum(enough * np.maximum(usual[at], np.median(power, axis=1)), MIN_POWER_TO_LOWER * below)
    return [(int(starts[k]), int(at[k]), float(2 * np.sqrt(size[k]) / window.sum())) for k in np.flatnonzero(out)]
