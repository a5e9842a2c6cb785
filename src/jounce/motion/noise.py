"""What noise samples bear: steps of an encoder, written digits, white noise; and where rounding is not white.

Problem: the step of which all differences of samples are multiples. One that is written is found by decimals, that of
an encoder by Euclid's algorithm on the differences of sorted samples. It multiplies their rounding and gives up after a
few divisions: such samples count as white (`find_step` is 0).

Rounding to steps leaves the errors of a saw-tooth, whose m-th harmonic holds 6 / (pi m)^2 of their variance step^2 / 12
(Widrow & Kollar, Quantization Noise, 2008). In samples they are as good as white as long as the motion passes several
steps, or a varying part of one, from sample to sample. Slow joints stay on a step, and at some speeds a sample passes a
whole number of steps: then the error beats slowly, and no averaging removes it. Noise of a third of a step prevents it.
"""

from dataclasses import dataclass
from math import comb

import numpy as np

from jounce.motion.curves import ROUNDING_OF_Q

ENCODER_STEP = "encoder step"  # the kind of noise of an encoder that rounds positions
BEAT_HARMONICS = np.arange(1, 5)  # of the saw-tooth: four hold 87 % of its variance
MAX_BEAT_SAMPLES = 4096  # at which beats are looked for
MAX_STEP_SAMPLES = 100000  # by which steps are found: more only take time
MIN_DIFFERENT_SAMPLES = 8  # below which round numbers among them may be chance, as the 1 is of a cosine
MAX_DECIMALS = 12  # beyond which numbers are taken for doubles
IRREGULARITY_ORDER = 5  # of the differences that polynomial pieces do not have, and rounded samples have
NOISE_DIFFERENCE_ORDER = 8  # differences hold white noise sqrt(binomial(16, 8)) times, and hardly any motion
MAX_DIVISIONS = 4  # of Euclid's algorithm, each of which multiplies the rounding of what is left
WHITENESS_DEVIATIONS = 5  # standard deviations of von Neumann's ratio, which white noise does not exceed
REST_WEIGHT_POWER = 1 / 3  # of the number of equal samples, by which those of a robot at rest weigh less


@dataclass(frozen=True)
class Noise:
    """What a joint's samples scatter by: a deviation, its kind, and a step.

    The standard deviation is in rad or m, and so is the step of an encoder or of digits, otherwise 0. The kind is
    "encoder step", "written digits", "white", "rounding" (of floating-point numbers) or "rest" (the joint does not
    move).
    """

    sigma: float
    kind: str
    step: float = 0.0

    def __str__(self) -> str:
        bits = f", {np.log2(2 * np.pi / self.step):.3g} bits" if self.kind == ENCODER_STEP else ""
        has_steps = self.step > 0 and self.kind in (ENCODER_STEP, "written digits")
        step = f" of {self.step:.3g} rad or m{bits}" if has_steps else ""
        return f"{self.kind}{step}, standard deviation {self.sigma:.2g}"


@dataclass(frozen=True, eq=False)
class Beats:
    """Slow parts of rounding errors, at some of the samples."""

    t: np.ndarray  # (P,), times of these samples
    period: np.ndarray  # (P, n, 4), s, by joint and harmonic
    share: np.ndarray  # (P, n, 4), of the variance
    weight: np.ndarray  # (P,), squares of the weights of all samples from each to the next
    path: np.ndarray  # (P, n), steps passed since the start

    def passes(self, breaks: np.ndarray) -> np.ndarray:
        """Return how many steps are passed in each interval, (M,).

        They are those of the joint that passes most of them.
        """
        return np.max([np.diff(np.interp(breaks, self.t, path)) for path in self.path.T], axis=0)

    def inflation(self, breaks: np.ndarray, cycles: int = 1, rests: bool = False) -> np.ndarray:
        """Return variances of white noise that fits alike, as multiples.

        They are multiples of the samples' variances, per interval (M, n). Beats with at most half a cycle in
        an interval (or `cycles` times that) are fitted. Where the whole robot rests, its samples are equal:
        an error, but one that does not depend on the breaks; `rests` counts it too.
        """
        # The share of the variance that is slow at each time, (P, n): of all harmonics whose period is long enough.
        place = np.searchsorted(breaks, self.t, side="right").clip(1, len(breaks) - 1) - 1
        slowest = 2 * np.diff(breaks)[place, None, None] / cycles
        slow = np.where(self.period > slowest, self.share, 0).sum(axis=2) * self.weight[:, None]
        # At rest the first harmonic of all joints is slow.
        if not rests:
            slow[(self.period[:, :, 0] > slowest[:, :, 0]).all(axis=1)] = 0
        # A slow error is the same in all N samples of an interval: white noise would need N times its variance to be
        # fitted as well.
        sums = np.concatenate([np.zeros((1, slow.shape[1])), np.cumsum(slow, axis=0)])
        bounds = np.searchsorted(self.t, breaks)
        bounds[0], bounds[-1] = 0, len(self.t)
        return 1 + np.diff(sums[bounds], axis=0)


def find_beats(
    t: np.ndarray, q: np.ndarray, velocity: np.ndarray, steps: np.ndarray, sigma: np.ndarray, weight: np.ndarray
) -> Beats:
    """Return where samples that are rounded to steps beat.

    Samples q (N, n) have weights (N,) and `steps` (n,). Estimated velocities and scatter decide.
    """
    # The usual time between samples, and its standard deviation, but for outliers.
    spacing = np.diff(t)
    usual = float(np.median(spacing))
    uneven = float(np.median(np.abs(spacing - usual))) / 0.6745
    few = slice(None, None, len(t) // MAX_BEAT_SAMPLES + 1)
    step = np.where(steps > 0, steps, np.inf)[:, None]  # without steps there are no beats
    # Steps that each harmonic passes from sample to sample, (P, n, 4).
    passed = np.abs(velocity[few, :, None]) * usual / step * BEAT_HARMONICS
    # Noise a, and uneven times, spread the phase of the m-th harmonic by 2 pi m a / step, which leaves the share
    # exp(-spread^2) of its variance: that is 6 / (pi m)^2 of all without them.
    added = np.sqrt(np.maximum(sigma**2 - steps**2 / 12, 0))
    spread = 2 * np.pi * BEAT_HARMONICS * np.hypot(added, velocity[few] * uneven)[:, :, None] / step
    share = 6 / (np.pi * BEAT_HARMONICS) ** 2 * np.exp(-(np.minimum(spread, 20) ** 2)) * (steps > 0)[:, None]
    # The error beats with what the harmonic passes beyond whole steps. A joint that stays on a step has an error as
    # long.
    period = usual / np.maximum(np.abs(passed - np.round(passed)), 1e-9)
    period[:, :, 0] = np.maximum(period[:, :, 0], hold_durations(t, q)[few])
    # Squares of weights of all samples from each of the few to the next, and steps passed since the start.
    around = np.add.reduceat(weight**2, np.arange(0, len(t), few.step))
    travel = np.cumsum(np.abs(velocity) * np.diff(t, append=t[-1])[:, None], axis=0)[few]
    path = travel / np.where(steps > 0, steps, np.finfo(float).eps)
    return Beats(t[few], period, share, around, path)


def varies_slowly(samples: np.ndarray) -> np.ndarray:
    """Return whether samples vary more slowly than white noise, (n,).

    Von Neumann's ratio is 1 for white noise. Annals of Mathematical Statistics 12 (1941).
    """
    scale = np.maximum(2 * ((samples - samples.mean(axis=0)) ** 2).sum(axis=0), np.finfo(float).tiny)
    ratio = (np.diff(samples, axis=0) ** 2).sum(axis=0) / scale
    return np.asarray((ratio - 1) * np.sqrt(len(samples)) < -WHITENESS_DEVIATIONS)


def estimate_local_noise(samples: np.ndarray) -> np.ndarray:
    """Return the standard deviation (n,) of white noise in most places.

    Differences of high order hold hardly any motion.
    """
    off = np.abs(np.diff(samples, NOISE_DIFFERENCE_ORDER, axis=0))
    # The median of |x| is 0.6745 sigma, and the d-th difference has binomial(2 d, d) times the variance.
    return np.asarray(
        np.median(off, axis=0) / 0.6745 / np.sqrt(comb(2 * NOISE_DIFFERENCE_ORDER, NOISE_DIFFERENCE_ORDER))
    )


def hold_durations(t: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return for how long samples stay equal, (N, n)."""
    durations = np.empty(q.shape)
    for joint, column in enumerate(q.T):
        starts = np.flatnonzero(np.diff(column, prepend=np.nan) != 0)
        ends = np.append(starts[1:], len(t))
        durations[:, joint] = np.repeat(t[ends - 1] - t[starts], ends - starts)
    return durations


def rest_weights(t: np.ndarray, q: np.ndarray, interval: float) -> np.ndarray:
    """Return weights (N,) of samples, less where the robot rests.

    All joints stay on a step then for long, with an error in common.
    """
    duration = hold_durations(t, q).min(axis=1)
    # The number of equal samples; weights are roots of what each of them counts.
    equal_samples = 1 + duration / float(np.median(np.diff(t)))
    return np.where(duration > interval / 2, equal_samples ** (-REST_WEIGHT_POWER / 2), 1.0)


def find_step(samples: np.ndarray) -> tuple[float, str]:
    """Return the step to which samples are rounded, and its kind.

    The kind is that of an encoder or of written digits; the step is 0 of samples that are not rounded.
    """
    some = samples[:: len(samples) // MAX_STEP_SAMPLES + 1]
    if not _is_irregular(some):
        return 0.0, "written digits"
    digit_step = _find_written_step(some)
    tolerance = digit_step if digit_step > 0 else _rounding_tolerance(some)
    encoder_step = _find_lattice_step(some, tolerance)
    # Written digits are multiples of a step too: that of an encoder is wider.
    if encoder_step > 0 and not (digit_step > 0 and encoder_step < 1.5 * digit_step):
        return encoder_step, ENCODER_STEP
    return digit_step, "written digits"


def _is_irregular(samples: np.ndarray) -> bool:
    """Return whether samples are rounded, and no short polynomials.

    Rounded samples are off polynomials of degree 4 in most places where they change. Evenly spaced samples of a
    straight line or of a parabola are multiples of a step too, and are not rounded to it.
    """
    window = IRREGULARITY_ORDER + 1
    if len(samples) < window + MIN_DIFFERENT_SAMPLES:
        return True
    changes = np.lib.stride_tricks.sliding_window_view(np.diff(samples) != 0, IRREGULARITY_ORDER).any(axis=1)
    # The rounding of doubles in a difference of that order.
    tiny = 2**window * np.finfo(float).eps * float(np.abs(samples).max())
    off = np.abs(np.diff(samples, IRREGULARITY_ORDER)) > tiny
    return bool(off[changes].mean() > 0.5) if changes.any() else True


def _rounding_tolerance(samples: np.ndarray) -> float:
    """Return what the rounding of doubles may be of a difference.

    Samples that single precision holds exactly have its rounding.
    """
    single = np.array_equal(samples, samples.astype(np.float32))
    return float(np.abs(samples).max() * (np.finfo(np.float32).eps if single else 4096 * np.finfo(float).eps))


def _find_lattice_step(samples: np.ndarray, tolerance: float) -> float:
    """Return the step of which all differences are multiples; otherwise 0.

    They are so up to a tolerance. Where a joint passes several steps from sample to sample, what is left of its
    differences determines the step: Euclid's algorithm.
    """
    differences = np.diff(np.unique(samples))
    differences = differences[differences > tolerance]
    for _ in range(MAX_DIVISIONS):
        if len(differences) < 2 or differences.min() < 4 * tolerance:
            return 0.0
        # The step is the mean of the least differences first, then of all that are few steps: the error of a step
        # grows with the number of steps.
        step = float(differences[differences < 1.5 * differences.min()].mean())
        for _ in range(3):
            multiples = np.round(differences / step)
            are_few = multiples <= 16
            step = float(differences[are_few].sum() / multiples[are_few].sum())
        # It is found if all these differences are multiples of it.
        off = np.abs(differences - multiples * step)[are_few]
        if len(off) >= min(MIN_DIFFERENT_SAMPLES, len(differences)) and off.mean() < min(0.05 * step, tolerance):
            return step
        # Otherwise the least difference is several steps, and what it leaves of the others is fewer.
        least = differences.min()
        off = np.abs(differences - np.round(differences / least) * least)
        differences = np.append(off[off > 8 * tolerance], least)
    return 0.0


def _find_written_step(samples: np.ndarray) -> float:
    """Return the unit of the last digit that samples are written with.

    It is that of the largest decade of their sizes; 0 for doubles. Of a fixed number of decimals all decades
    have the same; of a fixed number of digits smaller ones have finer units.
    """
    # The powers of ten of all sizes, and the unit of each decade with enough different samples.
    decades = np.floor(np.log10(np.abs(samples), out=np.full(len(samples), -np.inf), where=samples != 0))
    parts = {float(k): samples[decades == k] for k in np.unique(decades[np.isfinite(decades)])}
    units = {k: _decimal_unit(part) for k, part in parts.items() if len(np.unique(part)) >= MIN_DIFFERENT_SAMPLES}
    if len(units) == 0:
        return _decimal_unit(samples)
    largest = max(units)
    if units[largest] == 0:
        return 0.0
    # With as many digits as the largest decade has, smaller ones may be beyond what `_decimal_unit` finds.
    finest = {k: units[largest] * 10.0 ** (k - largest) for k in units}
    is_written = all(units[k] > 0 or finest[k] < 10.0**-MAX_DECIMALS for k in units)
    return max(units.values()) if is_written else 0.0


def _decimal_unit(samples: np.ndarray) -> float:
    """Return the unit of the last decimal that samples have.

    It is 0 beyond MAX_DECIMALS.
    """
    return next((10.0**-d for d in range(MAX_DECIMALS + 1) if np.array_equal(np.round(samples, d), samples)), 0.0)


def classify_noise(samples: np.ndarray, sigma: float, rounding: tuple[float, str]) -> Noise:
    """Return the noise of a joint's samples, by their scatter.

    They scatter by sigma about the joint's motion; their step and its kind are known.
    """
    step, kind = rounding
    # Even rounding to a step has the deviation step / sqrt(12): if samples scatter by hardly more, it is all.
    if step > 0 and sigma < 1.5 * step / np.sqrt(12):
        return Noise(max(sigma, step / np.sqrt(12)), kind, step)
    is_exact = sigma < ROUNDING_OF_Q * float(np.abs(samples).max())
    return Noise(sigma, "rounding" if is_exact else "white", step)
