"""Encoders that interpolate: they err by a wave over the angle of their joint, which a fit follows as motion.

What samples differ by from a coarse fit holds such a wave, but for what a coarse fit of the wave itself follows. Its
power is compared with those over the angle of what is left without it. Rows weigh less where more scatters around
them: bursts of vibration, and parts that the coarse fit does not follow, are no waves over all of the angle.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.motion.knots import determine_breaks
from jounce.motion.least_squares import SplineRows
from jounce.motion.normal_equations import SplineEquations
from jounce.motion.samples import MAX_SCATTER_ROWS, Samples
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
    rows, angles = replace(samples, drift=None).all_rows(cells), [_Angle.of(angle) for angle in samples.q.T]
    for coarser in COARSENING_FACTORS:
        coarse = np.unique(np.append(breaks[::coarser], breaks[-1]))
        _, equations = determine_breaks(rows, coarse)
        found = dict(_find_waves(angles, rows, equations, window)) | found
    return [(joint, count) for joint, count in sorted(found.items()) if joint not in vibrating]


@dataclass(frozen=True, eq=False)
class _Angle:
    """The angle of a joint at the samples, of which place it is of PLACES_PER_TURN, and which waves can be seen."""

    values: np.ndarray  # (N,)
    place: np.ndarray  # (N,)
    seen: np.ndarray  # of WAVE_COUNTS

    @staticmethod
    def of(angle: np.ndarray) -> "_Angle":
        place = np.round(angle * (PLACES_PER_TURN / (2 * np.pi))).astype(int) % PLACES_PER_TURN
        turned = np.quantile(np.abs(np.diff(angle)), 0.9)  # from row to row: faster waves are no longer sampled
        passed = WAVE_COUNTS * np.ptp(angle) > 2 * np.pi * MIN_WAVES_PASSED
        return _Angle(np.ascontiguousarray(angle), place, (WAVE_COUNTS * turned < np.pi) & passed)

    def spectrum(self, weighted: np.ndarray) -> np.ndarray:
        """Powers of weighted samples over the angle by WAVE_COUNTS; 0 of those that cannot be seen."""
        power = np.abs(np.fft.rfft(np.bincount(self.place, weighted, PLACES_PER_TURN))[WAVE_COUNTS]) ** 2
        return np.where(self.seen, power, 0)


def _find_waves(
    angles: Sequence[_Angle], rows: SplineRows, equations: SplineEquations, window: np.ndarray
) -> Iterator[tuple[int, int]]:
    """Joints and counts of waves in what a coarse fit leaves of the rows."""
    left = (equations.fit(rows.y)[1] / rows.weight[:, None]).T.copy()  # by joint
    for joint, (angle, row) in enumerate(zip(angles, left, strict=True)):
        weights = _row_weights(row, window)
        power = angle.spectrum(weights * row)
        if not power.any():
            continue
        count = int(WAVE_COUNTS[power.argmax()])
        # what such a fit leaves of the wave itself
        wave = rows.weight * np.stack([np.cos(count * angle.values), np.sin(count * angle.values)])
        wave = (equations.fit(wave.T.copy())[1] / rows.weight[:, None]).T.copy()
        if _compare_wave_power(angle, row, weights, wave, window, count) > MIN_LINE_POWER:
            yield joint, count


def _row_weights(left: np.ndarray, window: np.ndarray) -> np.ndarray:
    sums = np.pad(left**2, (SCATTER_ROWS // 2, SCATTER_ROWS // 2 - 1))
    for k in range(SCATTER_ROWS.bit_length() - 1):  # of 2, 4, 8, ... rows
        sums = sums[: -(2**k)] + sums[2**k :]
    around = np.sqrt(sums / SCATTER_ROWS)
    usual = float(np.median(np.abs(left[:: len(left) // MAX_SCATTER_ROWS + 1])))
    return window / np.maximum(around, max(usual, np.finfo(float).tiny))


def _compare_wave_power(
    angle: _Angle, left: np.ndarray, weights: np.ndarray, wave: np.ndarray, window: np.ndarray, count: int
) -> float:
    """The power of a wave, cosine and sine (2, N), over the median of those around it, and of all, left without it."""
    without = left
    for _ in range(2):  # what is left without the wave weighs the rows
        weighted = weights**2 * wave
        without = left - np.linalg.lstsq(weighted @ wave.T, weighted @ left, rcond=None)[0] @ wave
        weights = _row_weights(without, window)
    power = ((wave @ (weights * left)) ** 2).sum()
    squares = weights**2
    others = angle.spectrum(weights * without)
    near = others[(count // 2 - 8 <= WAVE_COUNTS) & (2 * count + 16 > WAVE_COUNTS)]
    median = max(float(np.median(x[x > 0])) for x in (others, near))
    return float(power / (np.vdot(wave, squares * wave) / squares.sum()) / median)
