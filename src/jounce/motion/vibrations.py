"""Find waves in what a fit leaves: vibrations, and errors of encoders.

Lines (`find_lines`): white noise of N samples has a largest line ln(N / 2) / ln 2 times its median: 11 dB for ten
thousand. A line is narrow: it stands out of the frequencies around it too. What is left of a slow motion at the end of
the band does not.

Bursts (`find_bursts`) last for a part of a log. A fit whose intervals suit the motion before and after may not find
one: to bisect an interval of a second explains nothing of 25 Hz. Where it finds one, it does not follow the flanks,
which are below the noise and most of their q4d. Spectra of overlapping parts of what an even fit leaves show both. A
line of a part stands out of what that frequency has in most parts, of the part's own frequencies, and of those below
it, which a reach and the ringing of a fit have more of.

Encoders that interpolate (`find_encoder_errors`) err by a wave over the angle of their joint, which a fit follows as
motion. What samples differ by from a coarse fit holds such a wave, but for what a coarse fit of the wave itself
follows. Its power is compared with those over the angle of what is left without it. Rows weigh less where more scatters
around them: bursts of vibration, and parts that the coarse fit does not follow, are no waves over all of the angle.

Each is looked for once in what a spline leaves. `Vibration` and the functions that describe are what users read of
it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jounce.motion import knots, least_squares
from jounce.motion.knots import DensePart
from jounce.motion.least_squares import Samples, SplineEquations, SplineRows

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


MIN_LINE_POWER = 250.0  # times the median of the spectrum: 24 dB. A measured log of a Franka arm has up to 21 dB
BAND_TO_LINE = 1.3  # times a line's frequency, up to which a fit follows it
LINE_LOSS = (
    1.3  # of amplitude, that hides a line: 1.18 between two bins of Hann's window, 1.1 by two deviations of noise
)
MAX_ROUNDING_LINE_SHARE = 0.65  # of a residual's power in the line of a sawtooth: 6 / pi^2, and a little more
MIN_DOMINANT_SHARE = 0.25  # of the power of a residual, from which on a line may be all of it: deviations hold that
MAX_MEDIAN_BINS = 4096  # of a spectrum, that determine a median
MAX_EVEN_TIMES = 1000.0  # times the samples: a hole that long is bridged by no motion, and no log has one unmeant
MIN_SPECTRUM_ROWS = 32  # that distinguish a line from noise: 14 bins have a median, and noise none of 24 dB above it
MAX_ROUNDING_AMPLITUDE = 0.7  # of a step, of a line that rounding makes: 2 / pi of a square wave, and a tenth
LINE_BINS = 2  # of the spectrum, on either side of a line, that belong to it
MIN_ROUNDING_BINS = 100  # of the spectrum, over which a joint that is not steady spreads its rounding
MASS_MATRIX_TIMES = 50  # of a vibration, at which mass matrices are taken
BURST_PART_ROWS = 64, 256, 1024  # of the parts, which overlap by half: short bursts, and lines close to the noise
MIN_PARTS_OF_LOG = 4  # a line over most of a log is not that of a burst
FALSE_ALARMS_PER_LOG = 1e-3  # of white noise, for each length of parts
MIN_POWER_TO_LOWER = 4.0  # times the largest power at half the frequency and below: a reach has more power there
MIN_BURST_BIN = 6  # this number of waves passes in a part: fewer may be the motion itself
MIN_FREQUENCY_TO_BAND = 2.0  # times the end of the band of the even fit, which rings there
MIN_BURST_STEPS = 0.6  # of an encoder: a joint that stays between two steps has a line of half a step
WAVE_COUNTS = np.arange(16, 1025)  # per turn: below 16 a motion itself is periodic, as harmonics are
COARSENING_FACTORS = 9, 3, 1  # of intervals: a fit may follow an error far below the end of its band
MIN_WAVES_PASSED = 4  # by a joint: fewer look like its motion
PLACES_PER_TURN = 2**14  # to which angles are rounded: 1,024 waves lose 1 % by it
SCATTER_ROWS = 256  # whose scatter weighs a row


@dataclass(frozen=True)
class Line:
    """A vibration of a joint."""

    joint: int
    frequency: float  # Hz
    amplitude: float  # rad or m
    span: tuple[float, float]  # s, from when to when it is seen
    lasts: bool = False  # whether that is all the time
    most: float | None = None  # what the amplitude may be, where rows that are uneven or moved hide a part of it
    share: float = 0.0  # of the power of what the fit leaves

    @property
    def reach(self) -> tuple[float, float]:
        """From when to when it is: flanks of a burst, below the noise, last as long as what is seen."""
        start, end = self.span
        return self.span if self.lasts else (2 * start - end, 2 * end - start)

    def mean_squares(self, t: np.ndarray, order: int) -> np.ndarray:
        """The mean squares of its part in q, qd, ... at times (T,), (T, order + 1): half of its amplitudes' squares."""
        largest = self.amplitude if self.most is None else self.most
        rates = largest * (2 * np.pi * self.frequency) ** np.arange(order + 1)
        during = (t >= self.reach[0]) & (t <= self.reach[1])
        return np.asarray(during[:, None] * rates**2 / 2)


def find_lines(samples: Samples, residual: np.ndarray, spline: "BSpline | None" = None) -> list[Line]:
    """The largest line of what a spline, or rest, leaves of each joint, (N, n), if it stands out and is no rounding."""
    if len(samples.t) < MIN_SPECTRUM_ROWS:
        return []
    t = space_evenly(samples.t)
    count, row, window = len(t), t[1] - t[0], np.hanning(len(t))
    found = []
    for joint, column in enumerate(residual.T):
        power = compute_spectrum(samples.t, column, t)
        at = int(np.argmax(power))
        near = power[at // 2 : 2 * at + 2]
        if power[at] <= MIN_LINE_POWER * max(np.median(power), np.median(near)):
            continue
        around = power[max(0, at - LINE_BINS) : at + LINE_BINS + 1].sum()
        amplitude = float(2 * np.sqrt(around / ((window**2).sum() * count)))
        rms, known = float(np.sqrt((column**2).mean())), samples.steps[joint]
        share = amplitude**2 / 2 / rms**2
        step = known or np.sqrt(12) * rms  # if all that is left were rounding
        is_rounding = amplitude <= MAX_ROUNDING_AMPLITUDE * step if known else share <= MAX_ROUNDING_LINE_SHARE
        if spline is not None:
            is_rounding &= is_steady_motion(spline(samples.t, nu=1)[:, joint], step, count * row)
        elif not known:
            is_rounding = False  # a constant is rounded to a constant
        if not is_rounding:
            most = np.sqrt(2) * rms if share > MIN_DOMINANT_SHARE else LINE_LOSS * amplitude
            span, line_share = (float(t[0]), float(t[-1])), float(around / power.sum())
            found.append(Line(joint, at / (count * row), amplitude, span, True, float(most), line_share))
    return found


def space_evenly(t: np.ndarray) -> np.ndarray:
    """Even times at the usual distance of times (N,), which are those where some are missing.

    Times between samples halve what is fast: a line between two rows at a third of their rate. `LinAlgError` where
    nearly all are missing, as by a wrong stamp: they would fill the memory, and determine no spline.
    """
    count = float(np.ptp(t)) / float(np.median(np.diff(t)))
    if count > MAX_EVEN_TIMES * len(t):
        raise np.linalg.LinAlgError("a hole that no spline bridges")
    return np.linspace(t[0], t[-1], round(count) + 1)


def compute_spectrum(at: np.ndarray, column: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The power of residuals (N,) at even times t under Hann's window, without that of a constant."""
    power = np.abs(np.fft.rfft(np.interp(t, at, column) * np.hanning(len(t)))) ** 2
    power[: LINE_BINS + 1] = 0
    return np.asarray(power)


def find_hidden_amplitudes(
    samples: Samples, residual: np.ndarray, velocity: np.ndarray, band: float, kept: np.ndarray
) -> np.ndarray:
    """The largest amplitudes A (n,), rad or m, of lasting vibrations above a band in Hz that `find_lines` leaves out.

    Under a window w a wave has a line of (A sum(w) / 2)^2, and one of `MIN_LINE_POWER` times the median P of the
    spectrum, or of an octave on either side where that is more, is found:

        A = LINE_LOSS 2 sqrt(MIN_LINE_POWER P) / sum(w) / kept,

    about 42 sigma / sqrt(N) of N samples with white noise. `kept` (n,) is the share of a wave that corrected time
    stamps do not take. No wave is larger than all residuals, A = sqrt(2) sigma / kept; so it is of few samples and of
    joints at steady speed, in which no lines are looked for.
    """
    t = space_evenly(samples.t)
    count, duration = len(t), float(np.ptp(samples.t))
    largest = np.sqrt(2 * (residual**2).mean(axis=0))
    for joint, column in enumerate(residual.T if count >= MIN_SPECTRUM_ROWS else ()):
        if is_steady_motion(velocity[:, joint], samples.steps[joint] or np.sqrt(12) * column.std(), duration):
            continue
        power = compute_spectrum(samples.t, column, t)
        starts = np.geomspace(band * duration, len(power) - 1, 2 + int(2 * np.log2(len(power)))).astype(int)
        parts = [power, *(power[at // 2 : 2 * at + 2] for at in starts if at > LINE_BINS)]
        usual = max(np.median(part[:: len(part) // MAX_MEDIAN_BINS + 1]) for part in parts)
        largest[joint] = min(largest[joint], LINE_LOSS * 4 * np.sqrt(MIN_LINE_POWER * usual) / count)
    return np.asarray(largest / kept)


def is_steady_motion(velocity: np.ndarray, step: float, duration: float) -> bool:
    """Whether rounding at these velocities (N,) may be a line: steps pass at a frequency of velocity over step."""
    slow, fast = np.quantile(velocity, [0.1, 0.9])
    return bool((fast - slow) / step * duration < MIN_ROUNDING_BINS)


@dataclass(frozen=True)
class Vibration:
    """A vibration of a joint, by its name and number, whose largest q4d is `peak`.

    If the fit does not follow it, its standard deviations hold it.
    """

    line: Line
    name: str
    joint: int
    peak: float
    followed: bool

    @property
    def fourth(self) -> float:
        """Its amplitude in q4d."""
        return float(self.line.amplitude * (2 * np.pi * self.line.frequency) ** 4)

    def __str__(self) -> str:
        when = "" if self.line.lasts else f" from t = {self.line.span[0]:.4g} to {self.line.span[1]:.4g} s"
        followed = "the fit follows it, unless a lower bandwidth makes it noise"
        return (
            f"{self.name} vibrates at {self.line.frequency:.4g} Hz by {self.line.amplitude:.2g} rad or m{when}, which"
            f" is {self.fourth:.2g} in q4d, whose peak is {self.peak:.2g}: "
            + (followed if self.followed else "the fit leaves it out, and its deviations hold it")
        )


def describe_vibrations(vibrations: Sequence[Vibration]) -> tuple[str, ...]:
    """A note of each that lasts, and one of those in parts of the log: of the largest, and how many there are."""
    lasting = [str(v) for v in vibrations if v.line.lasts]
    bursts = [v for v in vibrations if not v.line.lasts]
    if bursts:
        largest = max(bursts, key=lambda v: v.fourth)
        more = f"; {len(bursts) - 1} more such parts, of this or other joints" if len(bursts) > 1 else ""
        lasting.append(f"{largest}{more}")
    return tuple(lasting)


def describe_encoder_error(name: str, count: int) -> str:
    """A note of a joint whose encoder errs by a wave over its angle."""
    wave = f"a wave of about {count} per turn, as an encoder's interpolation is"
    return f"{name} is off by {wave}; the fit follows it as motion as far as its band reaches"


def describe_force_rates(
    vibration: Vibration, mass_matrices: Callable[[np.ndarray], np.ndarray], coordinates: Sequence[str]
) -> str:
    """A note of the largest Q2d that a vibration means to the first order, M (T, n, n) at times (T,) times its q4d."""
    M = mass_matrices(np.linspace(*vibration.line.span, MASS_MATRIX_TIMES))
    most = np.abs(M[:, :, coordinates.index(vibration.name)]).max(axis=0) * vibration.fourth
    largest = int(np.argmax(most))
    return (
        f"the vibration of {vibration.name} at {vibration.line.frequency:.4g} Hz means up to {most[largest]:.2g} in Q2d"
        f" of {coordinates[largest]}, N m/s^2 or N/s^2, to the first order"
    )


# Bursts: lines of parts of a log.
def find_bursts(samples: Samples, breaks: np.ndarray, cells: int) -> list[Line]:
    """The bursts of each joint that a spline with these breaks does not follow to the ends of their flanks."""
    usual = knots.median_length(breaks)
    rows, lowest = samples.all_rows(cells), MIN_FREQUENCY_TO_BAND / 2 / usual
    even = knots.fit_breaks(rows, np.linspace(*samples.span, round(np.ptp(samples.span) / usual) + 1))
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


# Encoders: waves over the angle of a joint.
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
        _, equations = knots.determine_breaks(rows, coarse)
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
    usual = float(np.median(np.abs(left[:: len(left) // least_squares.MAX_SCATTER_ROWS + 1])))
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
