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
# Of amplitude, that hides a line: 1.18 between two bins of Hann's window, 1.1 by two deviations of noise.
LINE_LOSS = 1.3
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
        """The times from when to when it lasts, flanks included.

        The flanks of a burst are below the noise, and last as long as what is seen.
        """
        start, end = self.span
        return self.span if self.lasts else (2 * start - end, 2 * end - start)

    def mean_squares(self, t: np.ndarray, order: int) -> np.ndarray:
        """Return the mean squares of its part in q, qd, ....

        They are (T, order + 1), at times (T,) within its reach half of the squares of its amplitudes.
        """
        largest = self.amplitude if self.most is None else self.most
        rates = largest * (2 * np.pi * self.frequency) ** np.arange(order + 1)
        during = (t >= self.reach[0]) & (t <= self.reach[1])
        return np.asarray(during[:, None] * rates**2 / 2)


def find_lines(samples: Samples, residual: np.ndarray, spline: "BSpline | None" = None) -> list[Line]:
    """Return the largest line of each joint's residuals, if it stands out.

    Residuals (N, n) are what a spline, or rest, leaves. Lines that rounding to steps makes are left out.
    """
    if len(samples.t) < MIN_SPECTRUM_ROWS:
        return []
    t = space_evenly(samples.t)
    count, row, window = len(t), t[1] - t[0], np.hanning(len(t))
    lines = []
    for joint, column in enumerate(residual.T):
        # The line has to stand out of the whole spectrum, and of an octave on either side.
        power = compute_spectrum(samples.t, column, t)
        peak_bin = int(np.argmax(power))
        octaves = power[peak_bin // 2 : 2 * peak_bin + 2]
        if power[peak_bin] <= MIN_LINE_POWER * max(np.median(power), np.median(octaves)):
            continue
        # A wave of amplitude A has the power A^2 / 4 N sum(w^2) in the bins around its frequency, by Parseval.
        line_power = power[max(0, peak_bin - LINE_BINS) : peak_bin + LINE_BINS + 1].sum()
        amplitude = float(2 * np.sqrt(line_power / ((window**2).sum() * count)))
        rms, known_step = float(np.sqrt((column**2).mean())), samples.steps[joint]
        share = amplitude**2 / 2 / rms**2
        # Rounding makes lines of a part of its step. If the step is not known, all that is left may be rounding.
        if known_step > 0:
            step, is_rounding = known_step, bool(amplitude <= MAX_ROUNDING_AMPLITUDE * known_step)
        else:
            step, is_rounding = np.sqrt(12) * rms, share <= MAX_ROUNDING_LINE_SHARE
        # It makes a line only where steps are passed at one frequency. A constant is rounded to a constant.
        if spline is not None:
            is_rounding &= is_steady_motion(spline(samples.t, nu=1)[:, joint], step, count * row)
        elif known_step == 0:
            is_rounding = False
        if not is_rounding:
            # Of a large part of the residual, the line may be all of it.
            most = np.sqrt(2) * rms if share > MIN_DOMINANT_SHARE else LINE_LOSS * amplitude
            span, line_share = (float(t[0]), float(t[-1])), float(line_power / power.sum())
            lines.append(Line(joint, peak_bin / (count * row), amplitude, span, True, float(most), line_share))
    return lines


def space_evenly(t: np.ndarray) -> np.ndarray:
    """Return even times at the usual distance of times (N,).

    Where some are missing there are more of them. Times between samples halve what is fast: a line between two
    rows at a third of their rate. `LinAlgError` where nearly all are missing, as by a wrong stamp: they would
    fill the memory, and determine no spline.
    """
    count = float(np.ptp(t)) / float(np.median(np.diff(t)))
    if count > MAX_EVEN_TIMES * len(t):
        raise np.linalg.LinAlgError("a hole that no spline bridges")
    return np.linspace(t[0], t[-1], round(count) + 1)


def compute_spectrum(times: np.ndarray, column: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the power spectrum of residuals (N,) under Hann's window.

    Residuals at `times` (N,) are interpolated at even times t. The bins of a constant are 0.
    """
    power = np.abs(np.fft.rfft(np.interp(t, times, column) * np.hanning(len(t)))) ** 2
    power[: LINE_BINS + 1] = 0
    return np.asarray(power)


def find_hidden_amplitudes(
    samples: Samples, residual: np.ndarray, velocity: np.ndarray, band: float, shares: np.ndarray
) -> np.ndarray:
    """Return the largest amplitudes A (n,) of vibrations that do not show.

    They last, are above a band in Hz, and are left out by `find_lines`; rad or m. Under a window w a wave has a line of
    (A sum(w) / 2)^2, and one of `MIN_LINE_POWER` times the median P of the spectrum, or of an octave on either side
    where that is more, is found:

        A = LINE_LOSS 2 sqrt(MIN_LINE_POWER P) / sum(w) / share,

    about 42 sigma / sqrt(N) of N samples with white noise. Corrected time stamps leave `shares` (n,) of a wave. No wave
    is larger than all residuals, A = sqrt(2) sigma / share; so it is of few samples and of joints at steady speed, in
    which no lines are looked for.
    """
    t = space_evenly(samples.t)
    count, duration = len(t), float(np.ptp(samples.t))
    largest = np.sqrt(2 * (residual**2).mean(axis=0))
    for joint, column in enumerate(residual.T if count >= MIN_SPECTRUM_ROWS else ()):
        known_step = samples.steps[joint]
        step = known_step if known_step > 0 else np.sqrt(12) * column.std()
        if is_steady_motion(velocity[:, joint], step, duration):
            continue
        # Octaves on either side of bins from the band to the highest frequency, which overlap.
        power = compute_spectrum(samples.t, column, t)
        bins = np.geomspace(band * duration, len(power) - 1, 2 + int(2 * np.log2(len(power)))).astype(int)
        parts = [power, *(power[k // 2 : 2 * k + 2] for k in bins if k > LINE_BINS)]
        # The frequency with the most power around it hides the largest wave. Hann's window has the sum N / 2.
        usual = max(np.median(part[:: len(part) // MAX_MEDIAN_BINS + 1]) for part in parts)
        largest[joint] = min(largest[joint], LINE_LOSS * 4 * np.sqrt(MIN_LINE_POWER * usual) / count)
    return np.asarray(largest / shares)


def is_steady_motion(velocity: np.ndarray, step: float, duration: float) -> bool:
    """Return whether rounding at these velocities (N,) may be a line.

    Steps pass at a frequency of velocity over step, which a line holds if it hardly varies.
    """
    # Most velocities, without starts and stops: their frequencies lie in a few bins, 1 / duration each.
    slow, fast = np.quantile(velocity, [0.1, 0.9])
    return bool((fast - slow) / step * duration < MIN_ROUNDING_BINS)


@dataclass(frozen=True)
class Vibration:
    """A vibration of a joint, as users read of it.

    The joint has a name, a number, and `peak`, its largest q4d. If the fit does not follow the vibration, its
    standard deviations hold it.
    """

    line: Line
    name: str
    joint: int
    peak: float
    followed: bool

    @property
    def fourth(self) -> float:
        """The amplitude in q4d."""
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
    """Return notes of vibrations: one of each that lasts, one of all bursts.

    The note of bursts, in parts of the log, is of the largest, and says how many there are.
    """
    lasting = [str(v) for v in vibrations if v.line.lasts]
    bursts = [v for v in vibrations if not v.line.lasts]
    if len(bursts) > 0:
        largest = max(bursts, key=lambda v: v.fourth)
        more = f"; {len(bursts) - 1} more such parts, of this or other joints" if len(bursts) > 1 else ""
        lasting.append(f"{largest}{more}")
    return tuple(lasting)


def describe_encoder_error(name: str, count: int) -> str:
    """Describe an encoder that errs by a wave over its angle."""
    wave = f"a wave of about {count} per turn, as an encoder's interpolation is"
    return f"{name} is off by {wave}; the fit follows it as motion as far as its band reaches"


def describe_force_rates(
    vibration: Vibration, mass_matrices: Callable[[np.ndarray], np.ndarray], coordinates: Sequence[str]
) -> str:
    """Describe the largest Q2d that a vibration means, to the first order.

    It is M (T, n, n) at times (T,) times the q4d of the vibration.
    """
    M = mass_matrices(np.linspace(*vibration.line.span, MASS_MATRIX_TIMES))
    most = np.abs(M[:, :, coordinates.index(vibration.name)]).max(axis=0) * vibration.fourth
    largest = int(np.argmax(most))
    return (
        f"the vibration of {vibration.name} at {vibration.line.frequency:.4g} Hz means up to {most[largest]:.2g} in Q2d"
        f" of {coordinates[largest]}, N m/s^2 or N/s^2, to the first order"
    )


# Bursts: lines of parts of a log.
def find_bursts(samples: Samples, breaks: np.ndarray, cells: int) -> list[Line]:
    """Return the bursts of each joint that a spline does not follow.

    It does not follow them to the ends of their flanks, with these breaks.
    """
    # The residual of an even fit, whose band is the same everywhere: bursts stand out of it in some parts.
    usual = knots.median_length(breaks)
    rows, lowest = samples.all_rows(cells), MIN_FREQUENCY_TO_BAND / 2 / usual
    even = knots.fit_breaks(rows, np.linspace(*samples.span, round(np.ptp(samples.span) / usual) + 1))
    residual = even.residual / rows.weight[:, None]
    lines: list[Line] = []
    for joint in range(samples.q.shape[1]):
        lines += _find_joint_bursts(samples, residual, joint, lowest)
    return [line for line in lines if not is_followed(line, breaks)]


def with_flanks(burst: Line, span: tuple[float, float]) -> DensePart:
    """Return the part of a log in which breaks follow a burst.

    It is from its start to its end with flanks, and has the longest interval that resolves it.
    """
    start, end = np.clip(burst.reach, *span).tolist()
    return start, end, 1 / (2 * BAND_TO_LINE * burst.frequency)


def is_followed(burst: Line, breaks: np.ndarray) -> bool:
    """Return whether breaks are dense enough for a burst and its flanks."""
    start, end, longest = with_flanks(burst, (breaks[0], breaks[-1]))
    # Intervals that lie well within the part: at its ends breaks may be moved.
    over = (breaks[1:] > start + longest) & (breaks[:-1] < end - longest)
    return bool((np.diff(breaks)[over] < 1.01 * longest).all())


def _find_joint_bursts(samples: Samples, residual: np.ndarray, joint: int, lowest: float) -> Iterator[Line]:
    """Yield the bursts of a joint above a lowest frequency."""
    count, step = len(samples.t), float(samples.steps[joint])
    t = np.linspace(samples.t[0], samples.t[-1], count)
    row = t[1] - t[0]
    even = np.interp(t, samples.t, residual[:, joint])
    # Per even time: whether a part with a line contains it, and the highest frequency and largest amplitude of these.
    marked, frequency, amplitude = np.zeros(count, bool), np.zeros(count), np.zeros(count)
    for length in BURST_PART_ROWS:
        if count < MIN_PARTS_OF_LOG * length:
            continue
        # A burst that shorter parts show has better times by these.
        marked_by_shorter = marked.copy()
        starts = np.arange(0, count - length + 1, length // 2)
        for start, peak_bin, size in _find_part_lines(even, starts, length, step):
            part = slice(start, start + length)
            is_fast, is_large = lowest < peak_bin / (length * row), size > MIN_BURST_STEPS * step
            if is_fast and is_large and not marked_by_shorter[part].any():
                marked[part] = True
                # The line lies within a bin of its peak: the fit has to follow the upper end of it.
                frequency[part] = np.maximum(frequency[part], (peak_bin + 1) / (length * row))
                amplitude[part] = np.maximum(amplitude[part], size)
    # Times that follow each other are one burst.
    for first, last in np.flatnonzero(np.diff(np.pad(marked.astype(int), 1))).reshape(-1, 2):
        highest, largest = float(frequency[first:last].max()), float(amplitude[first:last].max())
        yield Line(joint, highest, largest, (float(t[first]), float(t[last - 1])))


def _find_part_lines(even: np.ndarray, starts: np.ndarray, length: int, step: float) -> list[tuple[int, int, float]]:
    """Return starts, bins and amplitudes of lines in parts of residuals.

    Of each part of evenly spaced residuals it is the largest line, where that stands out. Powers of white noise
    are exponentially distributed: one in N is more than ln N / ln 2 medians. That at half the rate is the square
    of one real number, is larger more often, and is left out.
    """
    window = np.hanning(length)
    spectra = np.fft.rfft(np.lib.stride_tricks.sliding_window_view(even, length)[starts] * window, axis=1)
    power = np.abs(spectra[:, :-1]) ** 2
    # What each frequency has in most parts, but no less than rounding has: (parts, bins) -> (bins,).
    rounding = step**2 / 12 * (window**2).sum() * np.log(2)
    usual = np.maximum(np.median(power, axis=0), max(rounding, np.finfo(float).tiny))
    # The bin of each part that is most unusual, its power, and the largest one up to half its frequency, (parts,).
    peak_bin = MIN_BURST_BIN + (power / usual)[:, MIN_BURST_BIN:].argmax(axis=1)
    size = power[np.arange(len(peak_bin)), peak_bin]
    lower = np.maximum.accumulate(power[:, 1:], axis=1)[np.arange(len(peak_bin)), peak_bin // 2 - 1]
    # It stands out of what the frequency has in most parts, of the part's own frequencies, and of those below it.
    enough = np.log(power.size / FALSE_ALARMS_PER_LOG) / np.log(2)
    floor = enough * np.maximum(usual[peak_bin], np.median(power, axis=1))
    stands_out = size > np.maximum(floor, MIN_POWER_TO_LOWER * lower)
    return [
        (int(starts[k]), int(peak_bin[k]), float(2 * np.sqrt(size[k]) / window.sum()))
        for k in np.flatnonzero(stands_out)
    ]


# Encoders: waves over the angle of a joint.
def find_encoder_errors(
    samples: Samples, breaks: np.ndarray, cells: int, vibrations: Sequence[Line] = ()
) -> list[tuple[int, int]]:
    """Return joints with a line over their angle, with its count.

    The count is of waves per turn. It is looked for outside of bursts, and not where a joint vibrates all the
    time: the angle has lines of that too. What coarse fits leave of joints without an error has up to 21 dB;
    errors of the size of the noise have 24 and more.
    """
    window = np.hanning(len(samples.t))
    for start, end in (vibration.reach for vibration in vibrations if not vibration.lasts):
        window[(samples.t > start) & (samples.t < end)] = 0
    if np.count_nonzero(window) < MIN_SPECTRUM_ROWS:
        return []
    vibrating = {vibration.joint for vibration in vibrations if vibration.lasts}
    counts: dict[int, int] = {}
    rows, angles = replace(samples, drift=None).all_rows(cells), [Angle.from_samples(angle) for angle in samples.q.T]
    for factor in COARSENING_FACTORS:
        coarse = np.unique(np.append(breaks[::factor], breaks[-1]))
        _, equations = knots.determine_breaks(rows, coarse)
        # The coarsest fit that shows a wave of a joint decides: it follows the least of the wave.
        counts = dict(_find_waves(angles, rows, equations, window)) | counts
    return [(joint, count) for joint, count in sorted(counts.items()) if joint not in vibrating]


@dataclass(frozen=True, eq=False)
class Angle:
    """The angle of a joint at the samples, for spectra over it."""

    values: np.ndarray  # (N,)
    place: np.ndarray  # (N,), of PLACES_PER_TURN
    is_seen: np.ndarray  # of WAVE_COUNTS, which of these waves the samples can show

    @staticmethod
    def from_samples(angle: np.ndarray) -> "Angle":
        """Return the angle of samples (N,) of a joint."""
        place = np.round(angle * (PLACES_PER_TURN / (2 * np.pi))).astype(int) % PLACES_PER_TURN
        # Waves of which half or more passes from row to row are no longer sampled; of few waves none is certain.
        row_step = np.quantile(np.abs(np.diff(angle)), 0.9)
        is_passed = WAVE_COUNTS * np.ptp(angle) > 2 * np.pi * MIN_WAVES_PASSED
        return Angle(np.ascontiguousarray(angle), place, (WAVE_COUNTS * row_step < np.pi) & is_passed)

    def spectrum(self, weighted: np.ndarray) -> np.ndarray:
        """Return powers of weighted samples over the angle by WAVE_COUNTS.

        They are 0 of waves that cannot be seen.
        """
        # Samples at the same place of any turn add up.
        power = np.abs(np.fft.rfft(np.bincount(self.place, weighted, PLACES_PER_TURN))[WAVE_COUNTS]) ** 2
        return np.where(self.is_seen, power, 0)


def _find_waves(
    angles: Sequence[Angle], rows: SplineRows, equations: SplineEquations, window: np.ndarray
) -> Iterator[tuple[int, int]]:
    """Yield joints and counts of waves in what a coarse fit leaves."""
    # (P, n) -> (n, P): each joint's residuals are read many times.
    residual = (equations.fit(rows.y)[1] / rows.weight[:, None]).T.copy()
    for joint, (angle, row) in enumerate(zip(angles, residual, strict=True)):
        weights = _row_weights(row, window)
        power = angle.spectrum(weights * row)
        if not power.any():
            continue
        count = int(WAVE_COUNTS[power.argmax()])
        # The same fit follows a part of the wave itself: what it leaves of cosine and sine is compared, (2, P).
        wave = rows.weight * np.stack([np.cos(count * angle.values), np.sin(count * angle.values)])
        wave = (equations.fit(wave.T.copy())[1] / rows.weight[:, None]).T.copy()
        if _compare_wave_power(angle, row, weights, wave, window, count) > MIN_LINE_POWER:
            yield joint, count


def _row_weights(residual: np.ndarray, window: np.ndarray) -> np.ndarray:
    """Return weights (N,) of rows by the residuals around them."""
    # Sums over SCATTER_ROWS rows, a power of two, by doubling: sums of 2, 4, 8, ... rows.
    sums = np.pad(residual**2, (SCATTER_ROWS // 2, SCATTER_ROWS // 2 - 1))
    for k in range(SCATTER_ROWS.bit_length() - 1):
        sums = sums[: -(2**k)] + sums[2**k :]
    around = np.sqrt(sums / SCATTER_ROWS)
    # Rows where little scatters count no more than usual ones.
    usual = float(np.median(np.abs(residual[:: len(residual) // least_squares.MAX_SCATTER_ROWS + 1])))
    return window / np.maximum(around, max(usual, np.finfo(float).tiny))


def _compare_wave_power(
    angle: Angle, residual: np.ndarray, weights: np.ndarray, wave: np.ndarray, window: np.ndarray, count: int
) -> float:
    """Return the power of a wave over that of others.

    The wave is cosine and sine (2, N). The others are the median of what is left without the wave, around it or
    of all counts.
    """
    # Weighted least squares take the wave off. A wave in the residual makes rows weigh less: weights follow from what
    # is left without it, twice.
    without_wave = residual
    for _ in range(2):
        weighted = weights**2 * wave
        amplitudes = np.linalg.lstsq(weighted @ wave.T, weighted @ residual, rcond=None)[0]
        without_wave = residual - amplitudes @ wave
        weights = _row_weights(without_wave, window)
    power = ((wave @ (weights * residual)) ** 2).sum()
    squares = weights**2
    # Counts from half to twice that of the wave.
    others = angle.spectrum(weights * without_wave)
    neighbours = others[(count // 2 - 8 <= WAVE_COUNTS) & (2 * count + 16 > WAVE_COUNTS)]
    median = max(float(np.median(x[x > 0])) for x in (others, neighbours))
    # Over the mean square of what is left of a unit wave, the power is as if the coarse fit followed none of it.
    return float(power / (np.vdot(wave, squares * wave) / squares.sum()) / median)
