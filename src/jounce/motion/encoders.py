"""Encoders that interpolate: they err by a wave over the angle of their joint, which a fit follows as motion.

What samples differ by from a coarse fit holds such a wave, but for what a coarse fit of the wave itself follows. Its
power is compared with those over the angle of what is left without it. Rows weigh less where more scatters around
them: bursts of vibration, and parts that the coarse fit does not follow, are no waves over all of the angle.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from jounce.motion.knots import fit_breaks
from jounce.motion.samples import Samples
from jounce.motion.vibrations import MIN_LINE_POWER, MIN_SPECTRUM_ROWS, Line

WAVE_COUNTS = np.arange(16, 1025)  # per turn: below 16 a motion itself is periodic, as harmonics are
COARSENING_FACTORS = 9, 3, 1  # of intervals: a fit may follow an error far below the end of its band
MIN_WAVES_PASSED = 4  # by a joint: fewer look like its motion
PLACES_PER_TURN = 2**14  # to which angles are rounded: 1,024 waves lose 1 % by it
SCATTER_ROWS = 256  # whose scatter weighs a row


def find_encoder_errors(
    samples: Samples, breaks: np.ndarray, cells: int, vibrations: Sequence[Line] = ()
) -> list[tuple[int, int]]:
    """Joints whose samples have a line over the joint's angle, with its count per turn.

    It is looked for outside of bursts, and not where a joint vibrates all the time: the angle has lines of that too.
    What coarse fits leave of joints without an error has up to 21 dB; errors of the size of the noise have 24 and more.
    """
    window = np.hanning(len(samples.t))
    for start, end in (vibration.reach for vibration in vibrations if not vibration.lasts):
        window[(samples.t > start) & (samples.t < end)] = 0
    if np.count_nonzero(window) < MIN_SPECTRUM_ROWS:
        return []
    vibrating = {vibration.joint for vibration in vibrations if vibration.lasts}
    found: dict[int, int] = {}
    rows = replace(samples, drift=None).rows(cells)
    for coarser in COARSENING_FACTORS:
        coarse = np.unique(np.append(breaks[::coarser], breaks[-1]))
        left = samples.q - fit_breaks(rows, coarse).spline(samples.t)
        found = dict(_find_waves(samples, left, coarse, cells, window)) | found
    return [(joint, count) for joint, count in sorted(found.items()) if joint not in vibrating]


def _find_waves(
    samples: Samples, left: np.ndarray, coarse: np.ndarray, cells: int, window: np.ndarray
) -> Iterator[tuple[int, int]]:
    """Joints and counts of waves in what a coarse fit has `left`, (N, n), of samples."""
    q, left = np.ascontiguousarray(samples.q.T), np.ascontiguousarray(left.T)  # by joint
    weights = np.stack([_row_weights(row, window) for row in left])
    powers = np.stack([_angular_spectrum(*rows) for rows in zip(q, weights * left, strict=True)])
    seen = np.flatnonzero(powers.any(axis=1))
    if not seen.size:
        return
    counts = WAVE_COUNTS[powers[seen].argmax(axis=1)]
    angles = counts[:, None] * q[seen]
    # what such a fit leaves of the waves themselves
    columns = np.concatenate([np.cos(angles), np.sin(angles)]).T
    fitted = fit_breaks(replace(samples, q=columns, drift=None).rows(cells), coarse).spline(samples.t)
    for joint, count, *wave in zip(seen, counts, *np.split((columns - fitted).T, 2), strict=True):
        power = _compare_wave_power(q[joint], left[joint], weights[joint], np.stack(wave, axis=1), window, count)
        if power > MIN_LINE_POWER:
            yield int(joint), int(count)


def _row_weights(left: np.ndarray, window: np.ndarray) -> np.ndarray:
    sums = np.pad(left**2, (SCATTER_ROWS // 2, SCATTER_ROWS // 2 - 1))
    for k in range(SCATTER_ROWS.bit_length() - 1):  # of 2, 4, 8, ... rows
        sums = sums[: -(2**k)] + sums[2**k :]
    around = np.sqrt(sums / SCATTER_ROWS)
    return window / np.maximum(around, max(float(np.median(np.abs(left))), np.finfo(float).tiny))


def _angular_spectrum(angle: np.ndarray, weighted: np.ndarray) -> np.ndarray:
    """Powers of weighted samples over the angle by WAVE_COUNTS; 0 of those that cannot be seen."""
    place = np.round(angle / (2 * np.pi) * PLACES_PER_TURN).astype(int) % PLACES_PER_TURN
    power = np.abs(np.fft.rfft(np.bincount(place, weighted, PLACES_PER_TURN))[WAVE_COUNTS]) ** 2
    turned = np.quantile(np.abs(np.diff(angle)), 0.9)  # from row to row: faster waves are no longer sampled
    return np.where(
        (WAVE_COUNTS * turned < np.pi) & (WAVE_COUNTS * np.ptp(angle) > 2 * np.pi * MIN_WAVES_PASSED), power, 0
    )


def _compare_wave_power(
    angle: np.ndarray, left: np.ndarray, weights: np.ndarray, wave: np.ndarray, window: np.ndarray, count: int
) -> float:
    """The power of a wave, cosine and sine (N, 2), over the median of those around it, and of all, left without it."""
    without = left
    for _ in range(2):  # what is left without the wave weighs the rows
        size = np.linalg.lstsq(weights[:, None] * wave, weights * left, rcond=None)[0]
        without = left - wave @ size
        weights = _row_weights(without, window)
    power = (((weights * left) @ wave) ** 2).sum()
    squares = weights**2
    others = _angular_spectrum(angle, weights * without)
    near = others[(count // 2 - 8 <= WAVE_COUNTS) & (2 * count + 16 > WAVE_COUNTS)]
    median = max(float(np.median(x[x > 0])) for x in (others, near))
    return float(power / (squares @ (wave**2).sum(axis=1) / squares.sum()) / median)
