"""Vibrations of joints: lines in the spectrum of what a fit leaves of the samples, and what to say of them.

White noise of N samples has a largest line ln(N / 2) / ln 2 times its median: 11 dB for ten thousand. A line is narrow:
it stands out of the frequencies around it too. What is left of a slow motion at the end of the band does not.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jounce.motion.samples import Samples

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
