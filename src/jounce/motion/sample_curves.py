"""Make the curve of measured samples: a smoothing spline with standard deviations.

`fit_curve` is the door: of samples and of what a caller says of them it makes a curve, by smoothing, through all
samples, or as commands of a controller. It refuses a smoothing that does not carry the derivative that is asked for,
and says what jumps. Samples that are exact to their rounding have nothing to smooth: a spline goes through them.

`fit` smooths. It refuses what no smoothing mends (`check_samples`), leaves wild rows out (`find_spikes`), finds the
joints that move (`find_moving_joints`), rows that repeat older positions and sensors with clocks of their own
(`jounce.motion.clocks`), smooths what is left (`smooth`), and says how far each derivative can be trusted: a `Fit` has
peaks, deviations, vibrations and notes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value, warn
from jounce.core.progress import stage
from jounce.motion import clocks, knots, least_squares, noise, reliability, smoothing, smoothness, vibrations
from jounce.motion.clocks import SampleHolds, SensorClocks
from jounce.motion.commands import read_commands
from jounce.motion.curves import ROUNDING_OF_Q, Curve
from jounce.motion.least_squares import Samples
from jounce.motion.noise import Noise
from jounce.motion.reliability import SplineCovariances
from jounce.motion.smoothing import SmoothedSamples
from jounce.motion.spline import (
    INTERPOLATION_OPTION,
    CommandRows,
    SampledColumns,
    Smoothing,
    Spline,
    SplineCurve,
    check_bandwidth,
    fit_spline,
)
from jounce.motion.vibrations import Line, Vibration
from jounce.spatial.series import rate_name

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


MAX_RELATIVE_DEVIATION = 0.5  # of the peak of a derivative: beyond that standard deviation the samples do not carry it
END_INTERVALS = 3  # at either end, in which deviations of derivatives rise by powers of ten
MAX_POSITION = 1e30  # rad or m: no length is as large, and eighth powers of it have no overflow
MIN_SPIKE = 30.0  # times as far off as others around are rows that are left out


@dataclass(frozen=True, eq=False)
class Fit:
    """A smoothing spline of measured samples. `fit` makes one.

    Attributes
    ----------
    spline : scipy.interpolate.BSpline
        q as a function of time, of degree 9, (..., n): `spline(t, nu=k)` is the k-th derivative.
    joints, noise : tuple of str, tuple of Noise
        The names of the joints, and what their samples scatter by.
    bandwidth : float
        Up to which frequency in Hz the result holds, in the middle of its intervals: half of their number per second.
    ends : (float, float)
        The times between which derivatives are trustworthy; beyond, their deviations rise by powers of ten.
    peaks : (7, n)
        Largest values of q (less its mean), qd, q2d, ... between the ends.
    relative : (7,)
        Standard deviations of q, qd, q2d, ... over the largest peak: root mean squares between the ends for the worst
        joint, without vibrations that are left out. Peaks count for no less than those of half a wave over the
        duration: a steady motion has no q4d to compare with.
    notes : tuple of str
        What a user should know about the samples and the fit, one sentence each.
    spacing, rows : float, (R,)
        The median time between samples, s, and the numbers of those that the fit follows: not of wild ones, nor of
        those that repeat older positions.
    vibrations : tuple of Vibration
        What stands out of the noise.
    hidden : (n,)
        The largest amplitudes of lasting vibrations above the bandwidth that would not show, rad or m.
    """

    spline: "BSpline"
    joints: tuple[str, ...]
    noise: tuple[Noise, ...]
    bandwidth: float
    ends: tuple[float, float]
    peaks: np.ndarray
    relative: np.ndarray
    notes: tuple[str, ...]
    spacing: float
    rows: np.ndarray
    _spread: SplineCovariances | None
    _moving: np.ndarray
    vibrations: tuple[Vibration, ...] = ()
    hidden: np.ndarray | None = None

    def deviations(self, t: object, order: int = 4) -> tuple[np.ndarray, ...]:
        """Standard deviations of q, qd, ... at times t: order + 1 arrays (..., n).

        They hold the samples' noise, what correcting the time stamps leaves, and an estimate of the spline's own error.
        """
        covariances = self.covariances(t, order)
        return tuple(np.sqrt(covariances[..., k, k]) for k in range(order + 1))

    def covariances(self, t: object, order: int = 4) -> np.ndarray:
        """Covariances of q, qd, ... of each joint with one another at times t: (..., n, order + 1, order + 1)."""
        if not 0 <= order <= reliability.MAX_DEVIATION_ORDER:
            raise JounceError(
                f"order is {quote_value(order)}; standard deviations are known from order 0 to"
                f" {reliability.MAX_DEVIATION_ORDER}"
            )
        times = np.asarray(t, dtype=float)
        out = np.zeros((*times.shape, len(self.joints), order + 1, order + 1))
        if self._spread is not None:
            found = self._spread.covariances(times.ravel(), order)
            out[..., self._moving, :, :] = found.reshape(*times.shape, *found.shape[1:])
        out[..., ~self._moving, 0, 0] = np.array([noise.sigma**2 for noise in self.noise])[~self._moving]
        for vibration in self.vibrations:
            if not self._moving[vibration.joint]:
                squares = vibration.line.mean_squares(times.ravel(), order).reshape(*times.shape, order + 1)
                for k in range(order + 1):
                    out[..., vibration.joint, k, k] += squares[..., k]
        return out

    @property
    def stamps(self) -> bool:
        """Whether the time stamps of the samples are wrong, and corrected."""
        return self._spread is not None and self._spread.stamps is not None

    @property
    def highest(self) -> int:
        """The highest derivative of q whose standard deviation is less than half of its peak."""
        return int(np.argmax(np.append(self.relative >= MAX_RELATIVE_DEVIATION, True))) - 1

    def shortfall(self, order: int = 2) -> str | None:
        """Why the rate of the forces Q of that order cannot be had from these samples, in one line; None if it can."""
        if not 0 <= order + 2 <= reliability.MAX_DEVIATION_ORDER:
            raise JounceError(f"order is {quote_value(order)}; expected 0 to {reliability.MAX_DEVIATION_ORDER - 2}")
        return self.lacks(order + 2, rate_name("Q", order))

    def lacks(self, k: int, purpose: str, symbol: str = "q") -> str | None:
        """Why the samples do not carry their k-th derivative, which a purpose needs, in one line; None if they do."""
        if k <= self.highest:
            return None
        k = int(np.argmax(self.relative[: k + 1]))
        worst = max((n for n in self.noise if n.kind != "rest"), key=lambda n: n.sigma)
        factor = float(self.relative[k]) / MAX_RELATIVE_DEVIATION
        band = self.bandwidth * min(0.9, factor ** (-2 / (2 * k + 1)))
        longer = Remedy(f" (bandwidth={band:.2g})", f" (--bandwidth {band:.2g})")
        return (
            f"the samples do not carry {purpose}: the standard deviation of {rate_name(symbol, k)} is"
            f" {self.relative[k]:.0%} of its peak, with noise of {worst.sigma:.2g} ({worst.kind}) at"
            f" {1 / self.spacing:.4g} Hz up to {self.bandwidth:.3g} Hz; {np.log2(factor) + 1:.0f} bits more, a rate of"
            f" {factor**2 / self.spacing:.2g} Hz, or a longer window{longer} would do"
        )


@dataclass(frozen=True, eq=False)
class SmoothedCurve(SplineCurve):
    """The spline of a fit, with its standard deviations, and what it was made of: samples, and the way from them."""

    fit: Fit
    given: SampledColumns
    way: Smoothing
    limit: float | None  # Hz, to which the fit is limited, where it is not the noise that limits it

    def smoothed_to(self, bandwidth: float) -> "SmoothedCurve":
        """Another curve of its samples, up to a bandwidth in Hz: all that is wrong with rows is found from them again.

        The samples carry its rates if they carry those of this one, so that it is not refused.
        """
        fitted = fit(self.given.t, self.given.q, bandwidth=bandwidth, names=self.given.names)
        return replace(self, spline=fitted.spline, fit=fitted, limit=bandwidth)

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Standard deviations of the values and derivatives; None beyond the derivatives of which they are known."""
        return list(self.fit.deviations(t, order)) if order <= reliability.MAX_DEVIATION_ORDER else None


@dataclass(frozen=True, eq=False)
class SampleCurve:
    """The curve of samples, how it came about, what to know of it, and its largest distances (n,) from them."""

    curve: Curve
    source: str
    notes: tuple[str, ...] = ()
    residual: np.ndarray | None = None


def fit_curve(given: SampledColumns, way: Smoothing | Spline) -> SampleCurve:
    """The curve of samples; a fit finds the rounding of their times as noise.

    Raises
    ------
    JounceError : where no curve follows from the samples, or they cannot carry the derivative and are not forced to.
    """
    t, q, place, symbol = given.t, given.q, given.place, given.symbol
    if isinstance(way, CommandRows):
        return SampleCurve(*read_commands(t, q, place)) if symbol == "q" else _fit_spline_curve(given, Spline())
    if isinstance(way, Spline):
        return _fit_spline_curve(given, way)
    if len(t) < least_squares.MIN_FIT_SAMPLES:
        least = f"smoothing needs at least {least_squares.MIN_FIT_SAMPLES}; {INTERPOLATION_OPTION} takes them as exact"
        raise JounceError(f"{place}: {len(t)} samples; {least}")
    order = min(given.highest, reliability.MAX_DEVIATION_ORDER)
    purpose = rate_name("Q", order - 2) if symbol == "q" else rate_name(symbol, order)
    try:
        fitted = fit(t, q, bandwidth=way.bandwidth, names=given.names)
        shortfall = fitted.lacks(order, purpose, symbol)
    except JounceError as error:
        raise JounceError(f"{place}: {error}") from None
    off = np.abs(fitted.spline(t) - q)
    if way.bandwidth is None and (off.max(axis=0) <= ROUNDING_OF_Q * np.abs(q).max(axis=0)).all():
        return _fit_spline_curve(replace(given, rounding=0.0), Spline())
    if shortfall and not way.allow_noise:
        cures = Remedy(
            "a lower bandwidth= smooths them more, allow_noise=True accepts them",
            "a lower --bandwidth HZ smooths them more, --allow-noise accepts them",
        )
        raise JounceError(f"{place}: {shortfall}; {cures}")
    if jumps := _describe_jumps(given, off, fitted):
        warn(f"{place}: {jumps}")
    curve = SmoothedCurve(fitted.spline, float(t[0]), float(t[-1]), fitted, given, way, way.bandwidth)
    first, last = fitted.ends
    edges = f"derivatives are trustworthy from t = {first:.6g} to {last:.6g} s: deviations rise towards the ends"
    inside = fitted.relative.any() and (first > t[0] or last < t[-1])
    notes = (*fitted.notes, *([edges] if inside else []), *([shortfall] if shortfall else []))
    kinds = ", ".join(sorted({noise.kind for noise in fitted.noise}))
    source = f"samples, smoothed by a spline of degree 9 that holds up to {fitted.bandwidth:.3g} Hz ({kinds})"
    return SampleCurve(curve, source, notes, off.max(axis=0))


def _describe_jumps(given: SampledColumns, off: np.ndarray, fitted: Fit) -> str | None:
    """What jumps in samples, where a fit does not follow them and their stamps are right."""
    rows = fitted.rows
    scatter = np.maximum(noise.estimate_local_noise(given.q[rows]), [scatter.step for scatter in fitted.noise])
    if fitted.stamps or not (off[rows].max(axis=0) > smoothness.MAX_NOISE_DEVIATIONS * scatter).any():
        return None
    return smoothness.describe_sample_jumps(given.t[rows], given.q[rows], scatter, given.symbol)


def _fit_spline_curve(given: SampledColumns, way: Spline) -> SampleCurve:
    interpolates = way.intervals is None  # otherwise the residual shows what the fit does not follow
    if interpolates and (jumps := smoothness.describe_sample_jumps(given.t, given.q, symbol=given.symbol)):
        warn(f"{given.place}: {jumps}")
    curve = fit_spline(given, way)
    residual = None if interpolates else np.abs(curve.rates(given.t, 0)[0] - given.q).max(axis=0)
    return SampleCurve(curve, f"samples, rates from a {way}", residual=residual)


# The smoothing, from checks of samples to what a user should know of it.
@stage("smoothing of the samples")
def fit(t: object, q: object, *, bandwidth: float | None = None, names: Sequence[str] | None = None) -> Fit:
    """Smooth measured samples: least squares with a spline of degree 9, whose breaks are found from the samples.

    Parameters
    ----------
    t : (N,)
        Times of the samples in s, increasing; they may be uneven.
    q : (N, n)
        Positions of n joints, rad or m.
    bandwidth : float, optional
        The frequency in Hz up to which the motion is followed; by default as far as it stands out of the noise.
    names : sequence of str, optional
        The names of the joints, for what is said about them.

    Raises
    ------
    JounceError
        If the samples hold no numbers, their times do not increase, they are fewer than a fit needs, or a hole between
        them is longer than the motion can be continued over.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(2000) / 1000
    >>> step = 2 * np.pi / 2**17
    >>> q = step * np.round(np.sin(3 * t)[:, None] / step)
    >>> smooth = fit(t, q)
    >>> smooth.noise[0].kind, smooth.highest
    ('encoder step', 6)
    """
    times, samples, rows, joints = check_samples(t, q, names)
    check_bandwidth(bandwidth)
    rounding = [noise.find_step(column) for column in samples.T]
    steps = np.array([step for step, _ in rounding])
    wild = find_spikes(times, samples, steps)
    times, samples = times[~wild], samples[~wild]
    span = float(times[0]), float(times[-1])
    try:
        moving, holds, smoothed = _smooth_samples(Samples(times, samples, np.ones(len(times)), span, steps), bandwidth)
    except np.linalg.LinAlgError:
        raise JounceError(reliability.describe_undetermined(times)) from None
    movers = np.flatnonzero(moving)
    scatter = [Noise(float(column.std()), "rest") for column in samples.T]
    notes = [f"{wild.sum()} rows lie far from their neighbours; they are ignored"] if wild.any() else []
    if smoothed:
        reliability.refuse_holes(smoothed.samples.t, smoothed.spread.solution.breaks)
        notes += [*holds.notes, *smoothed.notes]
        for k, joint in enumerate(movers):
            scatter[joint] = noise.classify_noise(smoothed.samples.q[:, k], float(smoothed.sigma[k]), rounding[joint])
        notes += [
            vibrations.describe_encoder_error(joints[movers[k]], count) for k, count in smoothed.errors_of_encoders
        ]
    if not moving.all():
        still = join_names(name for name, moved in zip(joints, moving, strict=True) if not moved)
        notes.append(f"at rest but for noise, hence constant: {still}")
    followed = np.flatnonzero(~wild)[~holds.held]
    found = _assemble_fit(times, samples, moving, smoothed, joints, tuple(scatter), tuple(notes), rows[followed])
    hidden = np.sqrt(2) * np.array([column.std() for column in samples.T])  # of joints at rest
    seen = []
    for line in _find_lines_at_rest(Samples(times, samples, np.ones(len(times)), span, steps).joints(~moving)):
        number = int(np.flatnonzero(~moving)[line.joint])
        seen.append(Vibration(line, joints[number], number, float(found.peaks[4, number]), False))
    if smoothed:
        hidden[movers] = smoothed.hidden_amplitudes()
        for line in smoothed.lines:
            number, is_followed = int(movers[line.joint]), line not in smoothed.spread.left_out
            seen.append(Vibration(line, joints[number], number, float(found.peaks[4, number]), is_followed))
    notes = [*found.notes, *vibrations.describe_vibrations(seen)]
    return replace(found, vibrations=tuple(seen), notes=tuple(notes), hidden=hidden)


def _find_lines_at_rest(samples: Samples) -> list[Line]:
    """The vibrations of joints that do not move otherwise, all the time or for a part of the log."""
    moving = np.ptp(samples.q, axis=0) > 0
    if not moving.any() or len(samples.t) < vibrations.MIN_SPECTRUM_ROWS:
        return []
    samples = samples.joints(moving)
    lines = vibrations.find_lines(samples, samples.q - samples.q.mean(axis=0))
    lines += vibrations.find_bursts(samples, np.array(samples.span), least_squares.MIN_CELLS)
    return [replace(line, joint=int(np.flatnonzero(moving)[line.joint])) for line in lines]


def _smooth_samples(
    samples: Samples, bandwidth: float | None
) -> tuple[np.ndarray, SampleHolds | SensorClocks, SmoothedSamples | None]:
    """Which joints move, (n,), which rows hold older positions of these, and their spline."""
    moving = np.ptp(samples.q, axis=0) > 0
    holds: SampleHolds | SensorClocks = SampleHolds(np.zeros(len(samples.t), bool), samples.t)
    if not moving.any():
        return moving, holds, None
    part = samples.joints(moving)
    first, cells = knots.fit_even_breaks(part)
    moved = smoothing.find_moving_joints(part, first)
    moving[moving] = moved
    if not moved.any():
        return moving, holds, None
    if not moved.all():
        part = samples.joints(moving)
        first, cells = knots.fit_even_breaks(part)
    curve = first.spline(part.t)
    together = clocks.find_holds(part, curve, first, cells)
    apart = clocks.find_sensors(part, curve, first, cells, together)
    holds = apart or together
    if holds.held.any():
        part = apart.samples if apart else together.without(part)
        first, cells = knots.fit_even_breaks(part)
    exact = bandwidth is None and smoothing.is_exact(part, first)
    return moving, holds, smoothing.interpolate(part) if exact else smoothing.smooth(part, first, cells, bandwidth)


def _assemble_fit(
    t: np.ndarray,
    q: np.ndarray,
    moving: np.ndarray,
    smoothed: SmoothedSamples | None,
    joints: tuple[str, ...],
    noise: tuple[Noise, ...],
    notes: tuple[str, ...],
    rows: np.ndarray,
) -> Fit:
    """The fit of all joints, and how far it can be trusted."""
    from scipy.interpolate import BSpline

    knot = smoothed.spline.t if smoothed else least_squares.pad_knots(t[[0, -1]])
    breaks = knot[least_squares.FIT_DEGREE : len(knot) - least_squares.FIT_DEGREE]
    middle = q[0] + (q - q[0]).mean(axis=0)  # exact where a joint does not move at all
    coefficients = np.tile(middle, (len(knot) - least_squares.FIT_DEGREE - 1, 1))
    if smoothed:
        coefficients[:, moving] = smoothed.spline.c
    spline = BSpline(knot, coefficients, least_squares.FIT_DEGREE)
    usual = knots.median_length(breaks)
    edge = min(END_INTERVALS, max(0, (len(breaks) - 2) // 2))
    ends = (float(breaks[edge]), float(breaks[-1 - edge])) if smoothed else (float(t[0]), float(t[-1]))
    spread, spacing = smoothed.spread if smoothed else None, float(np.median(np.diff(t)))
    followed = replace(spread, left_out=()) if spread else None
    zeros = np.zeros((reliability.MAX_DEVIATION_ORDER + 1, len(joints)))
    bare = Fit(spline, joints, noise, 0.5 / usual, ends, zeros, zeros[:, 0], notes, spacing, rows, followed, moving)
    peaks, shares = reliability.peaks_and_shares(
        spline, lambda s: np.array(bare.deviations(s, reliability.MAX_DEVIATION_ORDER)) * moving, ends, q
    )
    return replace(bare, peaks=peaks, relative=shares, _spread=spread)


def check_samples(
    t: object, q: object, names: Sequence[str] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Samples as arrays (N,) and (N, n), the numbers of their rows, and the joints' names.

    Raises `JounceError` if they are invalid. Rows that are equal to the one before, time included, are left out.
    """
    times, samples = (_as_numbers(x, label) for x, label in ((t, "t"), (q, "q")))
    samples = samples[:, None] if samples.ndim == 1 else samples
    if times.ndim != 1 or samples.ndim != 2 or len(times) != len(samples):
        raise JounceError(f"t has shape {times.shape} and q {samples.shape}; expected (N,) and (N, n)")
    joints = tuple(names or (f"column {k + 1}" for k in range(samples.shape[1])))
    if len(joints) != samples.shape[1]:
        raise JounceError(f"{len(joints)} names for {samples.shape[1]} columns; expected one per column")
    if not np.isfinite(times).all():
        raise JounceError(f"the time of sample {np.argmin(np.isfinite(times))} is not a number; remove the row")
    for name, column in zip(joints, samples.T, strict=True):
        possible = np.abs(column) <= MAX_POSITION  # False of NaN, too
        if not possible.all():
            where = int(np.argmin(possible))
            came = f"{name} is {column[where]} at t = {times[where]:g} s"
            raise JounceError(f"{came}; expected numbers up to {MAX_POSITION:g}: remove such rows")
    kept = np.append(True, (np.diff(times) != 0) | (np.diff(samples, axis=0) != 0).any(axis=1))
    times, samples = times[kept], samples[kept]
    if (late := np.diff(times) <= 0).any():
        where = int(np.argmax(late))
        came = f"time goes from {times[where]:.9g} to {times[where + 1]:.9g} s at sample {where + 1}"
        raise JounceError(f"{came}; expected increasing times: sort the rows, or write the time with more digits")
    if len(times) < least_squares.MIN_FIT_SAMPLES:
        raise JounceError(
            f"{len(times)} samples; smoothing needs at least {least_squares.MIN_FIT_SAMPLES}: give a longer log, or"
            " through()"
        )
    return times, samples, np.flatnonzero(kept), joints


def _as_numbers(given: object, label: str) -> np.ndarray:
    array = np.asarray(given)
    if array.dtype.kind not in "fiu":
        raise JounceError(f"{label} is {quote_value(given)}; expected an array of numbers")
    return array.astype(float)


def find_spikes(t: np.ndarray, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Which rows, (N,), lie off the line through those on either side, alone and much farther than others around."""
    share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
    off = np.pad(q[1:-1] - q[:-2] * (1 - share) - q[2:] * share, ((4, 4), (0, 0)))
    usual = np.maximum(np.median(np.abs(off[:: len(off) // least_squares.MAX_SCATTER_ROWS + 1]), axis=0), steps)
    row, joint = np.nonzero(np.abs(off) > MIN_SPIKE * usual)
    here, before, after = (off[row + k, joint] for k in (0, -1, 1))
    around = np.max([np.abs(off[row + k, joint]) for k in (-3, -2, 2, 3)], axis=0)
    alone = (np.abs(here) > MIN_SPIKE * around) & (here * before < 0) & (here * after < 0)
    wild = np.zeros(len(t), bool)
    wild[row[alone] - 3] = True
    return wild
