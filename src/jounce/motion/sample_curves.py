"""Make the curve of measured samples: a smoothing spline with standard deviations.

`fit_curve` is the door: of samples and of what a caller says of them it makes a curve, by smoothing, through all
samples, or as commands of a controller. It refuses a smoothing that does not carry the derivative that is asked for,
and says what jumps. Samples that are exact to their rounding have nothing to smooth: a spline goes through them.

`fit` smooths, in these steps, each once per log:

1. It refuses what no smoothing mends (`check_samples`), and leaves wild rows out (`find_spikes`).
2. It finds the joints that move (`find_moving_joints`), rows that repeat older positions, and sensors with clocks of
   their own (`jounce.motion.clocks`), and smooths what is left (`smooth`): all in `_smooth_samples`.
3. It refuses holes that no motion bridges (`reliability.refuse_holes`), and writes notes.
4. It classifies the noise of each joint, assembles the spline of all joints, at rest too, and says how far each
   derivative can be trusted (`_assemble_fit`): its deviation, by the covariances of the smoothing, over its peak.
5. It lists the vibrations that the samples show, and how large hidden ones may be.
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
MIN_SPIKE = 30.0  # times as far off its neighbours' line as others around is a row that is left out


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
        Up to which frequency in Hz the result holds: half of the number of intervals per second, where they have their
        median length. Where they are shorter, it holds further.
    ends : (float, float)
        The times between which derivatives are trustworthy; beyond, their deviations rise by powers of ten.
    peaks : (7, n)
        Largest values of q (less its mean), qd, q2d, ... between the ends.
    relative : (7,)
        Standard deviations of q, qd, q2d, ... over the largest peak of all joints: root mean squares between the ends
        for the worst joint, without vibrations that are left out. Peaks count less their deviations, and for no less
        than those of half a wave over the duration: a steady motion has no q4d to compare with.
    notes : tuple of str
        What a user should know about the samples and the fit, one sentence each.
    spacing, rows : float, (R,)
        The median time between samples, s, and the numbers of those that the fit follows: not of wild ones, nor of
        those that repeat older positions.
    vibrations : tuple of Vibration
        What stands out of the noise.
    hidden : (n,)
        The largest amplitudes of hidden vibrations, which last and are above the bandwidth: rad or m.
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
    _spread: SplineCovariances | None  # of the joints that move; None where all rest
    _moving: np.ndarray  # (n,), which joints move
    vibrations: tuple[Vibration, ...] = ()
    hidden: np.ndarray | None = None

    def deviations(self, t: object, order: int = 4) -> tuple[np.ndarray, ...]:
        """Return standard deviations of q, qd, ... at times t.

        They are order + 1 arrays (..., n), and hold all parts that the head of `jounce.motion.reliability` names, above
        all the samples' noise and the spline's own error.
        """
        covariances = self.covariances(t, order)
        # The diagonal of each joint's covariances, (..., n, order + 1, order + 1) -> order + 1 times (..., n).
        return tuple(np.sqrt(covariances[..., k, k]) for k in range(order + 1))

    def covariances(self, t: object, order: int = 4) -> np.ndarray:
        """Return covariances of q, qd, ... of each joint with one another.

        At times t (...) they are (..., n, order + 1, order + 1).
        """
        if not 0 <= order <= reliability.MAX_DEVIATION_ORDER:
            raise JounceError(
                f"order is {quote_value(order)}; standard deviations are known from order 0 to"
                f" {reliability.MAX_DEVIATION_ORDER}"
            )
        times = np.asarray(t, dtype=float)
        out = np.zeros((*times.shape, len(self.joints), order + 1, order + 1))
        if self._spread is not None:
            of_movers = self._spread.covariances(times.ravel(), order)
            out[..., self._moving, :, :] = of_movers.reshape(*times.shape, *of_movers.shape[1:])
        # A joint at rest is constant: its rates are 0, and its position is off by the scatter of its samples.
        out[..., ~self._moving, 0, 0] = np.array([scatter.sigma**2 for scatter in self.noise])[~self._moving]
        # Vibrations of joints that move are in the covariances of the smoothing already; those of joints at rest, which
        # the constant leaves out, add their mean squares.
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
        """The highest derivative of q that the samples carry.

        Its standard deviation is less than half of its peak, and so are those of all lower ones. It is -1 where they do
        not carry q itself.
        """
        # It is the one before the first that fails. One more, which always fails, stands for those without deviations.
        return int(np.argmax(np.append(self.relative >= MAX_RELATIVE_DEVIATION, True))) - 1

    def shortfall(self, order: int = 2) -> str | None:
        """Return why samples do not carry a rate of the forces.

        The reason is one line; None if they carry it.
        """
        if not 0 <= order + 2 <= reliability.MAX_DEVIATION_ORDER:
            raise JounceError(f"order is {quote_value(order)}; expected 0 to {reliability.MAX_DEVIATION_ORDER - 2}")
        return self.lacks(order + 2, rate_name("Q", order))

    def lacks(self, k: int, purpose: str, symbol: str = "q") -> str | None:
        """Return why the samples do not carry their k-th derivative.

        The reason is one line, which names the purpose that needs the derivative; None if they carry it.
        """
        if k <= self.highest:
            return None
        # The message names the derivative that is known worst, of those up to the k-th, and the joint with the most
        # noise.
        k = int(np.argmax(self.relative[: k + 1]))
        worst = max((n for n in self.noise if n.kind != "rest"), key=lambda n: n.sigma)
        factor = float(self.relative[k]) / MAX_RELATIVE_DEVIATION
        # Deviations of the k-th derivative by white noise up to a frequency F grow like F^((2 k + 1) / 2). This band
        # divides them by the factor; it is at least a tenth lower, so that it helps.
        band = self.bandwidth * min(0.9, factor ** (-2 / (2 * k + 1)))
        # Deviations halve with each bit of resolution, of which the message asks for one more than is needed, and fall
        # like the root of the number of samples per second. To smooth over a longer window is to lower the bandwidth.
        longer = Remedy(f" (bandwidth={band:.2g})", f" (--bandwidth {band:.2g})")
        return (
            f"the samples do not carry {purpose}: the standard deviation of {rate_name(symbol, k)} is"
            f" {self.relative[k]:.0%} of its peak, with noise of {worst.sigma:.2g} ({worst.kind}) at"
            f" {1 / self.spacing:.4g} Hz up to {self.bandwidth:.3g} Hz; {np.log2(factor) + 1:.0f} bits more, a rate of"
            f" {factor**2 / self.spacing:.2g} Hz, or a longer window{longer} would do"
        )


@dataclass(frozen=True, eq=False)
class SmoothedCurve(SplineCurve):
    """The spline of a fit, with its samples and its options."""

    fit: Fit
    sampled: SampledColumns  # as they came
    way: Smoothing
    limit: float | None  # Hz, to which a caller limits the fit; None where the noise does

    def smoothed_to(self, bandwidth: float) -> "SmoothedCurve":
        """Return another curve of the samples, smoothed to a bandwidth in Hz.

        What is wrong with rows is found from the samples once more. How well its rates are known is not judged again:
        this curve is accepted.
        """
        fitted = fit(self.sampled.t, self.sampled.q, bandwidth=bandwidth, names=self.sampled.names)
        return replace(self, spline=fitted.spline, fit=fitted, limit=bandwidth)

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Return standard deviations of the values and derivatives.

        None where derivatives up to the order are not known.
        """
        return list(self.fit.deviations(t, order)) if order <= reliability.MAX_DEVIATION_ORDER else None


@dataclass(frozen=True, eq=False)
class SampleCurve:
    """The curve of samples, its origin, notes, and distances from them."""

    curve: Curve
    source: str
    notes: tuple[str, ...] = ()
    residual: np.ndarray | None = None  # (n,), the largest distances of the curve from the samples


def fit_curve(sampled: SampledColumns, way: Smoothing | Spline) -> SampleCurve:
    """Return the curve of samples, by a fit, a spline or commands.

    A fit does not ask for the rounding of times in `sampled`: it finds that as noise.

    Raises
    ------
    JounceError : where no curve follows from the samples, or they cannot carry the derivative and are not forced to.
    """
    t, q, place, symbol = sampled.t, sampled.q, sampled.place, sampled.symbol
    # Rows of commands command joints only: wrenches in the same table are samples, which a spline interpolates.
    if isinstance(way, CommandRows):
        return SampleCurve(*read_commands(t, q, place)) if symbol == "q" else _fit_spline_curve(sampled, Spline())
    if isinstance(way, Spline):
        return _fit_spline_curve(sampled, way)
    if len(t) < least_squares.MIN_FIT_SAMPLES:
        least = f"smoothing needs at least {least_squares.MIN_FIT_SAMPLES}; {INTERPOLATION_OPTION} takes them as exact"
        raise JounceError(f"{place}: {len(t)} samples; {least}")
    # The rate of order k - 2 of the forces Q is what takes the k-th derivative of q.
    order = min(sampled.highest, reliability.MAX_DEVIATION_ORDER)
    purpose = rate_name("Q", order - 2) if symbol == "q" else rate_name(symbol, order)
    try:
        fitted = fit(t, q, bandwidth=way.bandwidth, names=sampled.names)
        shortfall = fitted.lacks(order, purpose, symbol)
    except JounceError as error:
        raise JounceError(f"{place}: {error}") from None
    # Where the fit meets all samples to their rounding they are exact, their times too: a spline goes through them, and
    # nothing has to be refused.
    off = np.abs(fitted.spline(t) - q)
    if way.bandwidth is None and (off.max(axis=0) <= ROUNDING_OF_Q * np.abs(q).max(axis=0)).all():
        return _fit_spline_curve(replace(sampled, rounding=0.0), Spline())
    if shortfall is not None and not way.allow_noise:
        cures = Remedy(
            "a lower bandwidth= smooths them more, allow_noise=True accepts them",
            "a lower --bandwidth HZ smooths them more, --allow-noise accepts them",
        )
        raise JounceError(f"{place}: {shortfall}; {cures}")
    jumps = _describe_jumps(sampled, off, fitted)
    if jumps is not None:
        warn(f"{place}: {jumps}")
    curve = SmoothedCurve(fitted.spline, float(t[0]), float(t[-1]), fitted, sampled, way, way.bandwidth)
    return SampleCurve(curve, _describe_source(fitted), _list_notes(sampled, fitted, shortfall), off.max(axis=0))


def _describe_source(fitted: Fit) -> str:
    """Describe what a smoothed curve is made of, in one line."""
    kinds = ", ".join(sorted({scatter.kind for scatter in fitted.noise}))
    return f"samples, smoothed by a spline of degree 9 with a bandwidth of {fitted.bandwidth:.3g} Hz ({kinds})"


def _list_notes(sampled: SampledColumns, fitted: Fit, shortfall: str | None) -> tuple[str, ...]:
    """List the notes of a smoothed curve.

    They are those of its fit, its uncertain ends, and what it lacks if that is accepted.
    """
    notes, t = [*fitted.notes], sampled.t
    # Where all deviations are 0, as of joints that rest, the ends are as certain as the middle.
    first, last = fitted.ends
    if fitted.relative.any() and (first > t[0] or last < t[-1]):
        notes.append(
            f"derivatives are trustworthy from t = {first:.6g} to {last:.6g} s: deviations rise towards the ends"
        )
    if shortfall is not None:
        notes.append(shortfall)
    return tuple(notes)


def _describe_jumps(sampled: SampledColumns, off: np.ndarray, fitted: Fit) -> str | None:
    """Describe what jumps in samples, where a fit does not follow them.

    `off` (N, n) are the distances of the fit from the samples. Stamps that are wrong explain distances too: no jumps
    are looked for then.
    """
    rows = fitted.rows
    # The scatter of neighbours, and the step of an encoder where that is more.
    scatter = np.maximum(noise.estimate_local_noise(sampled.q[rows]), [of_joint.step for of_joint in fitted.noise])
    if fitted.stamps or not (off[rows].max(axis=0) > smoothness.MAX_NOISE_DEVIATIONS * scatter).any():
        return None
    return smoothness.describe_sample_jumps(sampled.t[rows], sampled.q[rows], scatter, sampled.symbol)


def _fit_spline_curve(sampled: SampledColumns, way: Spline) -> SampleCurve:
    """Return the curve of a spline through samples, or fitted over intervals."""
    curve: Curve
    if way.intervals is not None:
        # The residual shows what the fit does not follow, jumps among it.
        curve = fit_spline(sampled, way)
        residual = np.abs(curve.rates(sampled.t, 0)[0] - sampled.q).max(axis=0)
        return SampleCurve(curve, f"samples, rates from a {way}", residual=residual)
    # A spline through all samples leaves no residual: jumps have to be looked for in the samples.
    jumps = smoothness.describe_sample_jumps(sampled.t, sampled.q, symbol=sampled.symbol)
    if jumps is not None:
        warn(f"{sampled.place}: {jumps}")
    return SampleCurve(fit_spline(sampled, way), f"samples, rates from a {way}")


# The smoothing, from checks of samples to what a user should know of it.
@stage("smoothing of the samples")
def fit(t: object, q: object, *, bandwidth: float | None = None, names: Sequence[str] | None = None) -> Fit:
    """Smooth measured samples by a least-squares spline of degree 9.

    Its breaks are found from the samples.

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
    times, positions, rows, joints = check_samples(t, q, names)
    check_bandwidth(bandwidth)
    # Steps of encoders, or of written digits: the smallest motion that the samples can show.
    rounding = [noise.find_step(column) for column in positions.T]
    steps = np.array([step for step, _ in rounding])
    # Wild rows are left out before any fit: their squares would outweigh all others.
    wild = find_spikes(times, positions, steps)
    times, positions, rows = times[~wild], positions[~wild], rows[~wild]
    span = float(times[0]), float(times[-1])
    samples = Samples(times, positions, np.ones(len(times)), span, steps)
    try:
        moving, holds, smoothed = _smooth_samples(samples, bandwidth)
    except np.linalg.LinAlgError:
        raise JounceError(reliability.describe_undetermined(times)) from None
    source = FitSource(samples, rows[~holds.held], joints, moving, smoothed)
    notes = [f"{wild.sum()} rows lie far from their neighbours; they are ignored"] if wild.any() else []
    if smoothed is not None:
        # Across a hole any motion may have happened, whatever the spline makes of it.
        reliability.refuse_holes(smoothed.samples.t, smoothed.spread.solution.breaks)
        notes += [*holds.notes, *smoothed.notes]
        for k, count in smoothed.errors_of_encoders:
            notes.append(vibrations.describe_encoder_error(joints[source.movers[k]], count))
    if not moving.all():
        still = join_names(name for name, moves in zip(joints, moving, strict=True) if not moves)
        notes.append(f"at rest but for noise, hence constant: {still}")
    # Vibrations are compared with the peaks of q4d, which the assembled fit has.
    assembled = _assemble_fit(source, _classify_noise(source, rounding))
    shown = _list_vibrations(source, assembled.peaks)
    notes += vibrations.describe_vibrations(shown)
    return replace(assembled, vibrations=tuple(shown), notes=tuple(notes), hidden=_bound_hidden_amplitudes(source))


@dataclass(frozen=True, eq=False)
class FitSource:
    """Samples without wild rows, and what smoothing made of them."""

    samples: Samples  # (N, n), of all joints
    rows: np.ndarray  # (R,), numbers of the rows that the fit follows, as they came
    joints: tuple[str, ...]  # names
    moving: np.ndarray  # (n,), which joints move
    smoothed: SmoothedSamples | None  # of the joints that move; None where all rest

    @property
    def movers(self) -> np.ndarray:
        """The numbers of the joints that move."""
        return np.flatnonzero(self.moving)


def _classify_noise(source: FitSource, rounding: Sequence[tuple[float, str]]) -> tuple[Noise, ...]:
    """Return the noise of each joint.

    `rounding` are the steps of all joints and their kinds.
    """
    # A joint at rest scatters about its mean, a joint that moves about the spline.
    scatter = [Noise(float(column.std()), "rest") for column in source.samples.q.T]
    smoothed = source.smoothed
    if smoothed is not None:
        for k, joint in enumerate(source.movers):
            scatter[joint] = noise.classify_noise(smoothed.samples.q[:, k], float(smoothed.sigma[k]), rounding[joint])
    return tuple(scatter)


def _list_vibrations(source: FitSource, peaks: np.ndarray) -> list[Vibration]:
    """List the vibrations of all joints, of joints at rest first.

    `peaks` (7, n) are those of the fit.
    """
    joints, shown = source.joints, []
    resting = np.flatnonzero(~source.moving)
    # The constant of a joint at rest follows no vibration.
    for line in _find_lines_at_rest(source.samples.joints(~source.moving)):
        number = int(resting[line.joint])
        shown.append(Vibration(line, joints[number], number, float(peaks[4, number]), False))
    smoothed = source.smoothed
    if smoothed is not None:
        for line in smoothed.lines:
            number, is_followed = int(source.movers[line.joint]), line not in smoothed.spread.left_out
            shown.append(Vibration(line, joints[number], number, float(peaks[4, number]), is_followed))
    return shown


def _bound_hidden_amplitudes(source: FitSource) -> np.ndarray:
    """Return the largest amplitudes (n,) of hidden vibrations."""
    # At rest no wave is larger than one that is all of the scatter, with an amplitude of sqrt(2) standard deviations.
    hidden = np.sqrt(2) * np.array([column.std() for column in source.samples.q.T])
    if source.smoothed is not None:
        hidden[source.movers] = source.smoothed.hidden_amplitudes()
    return hidden


def _find_lines_at_rest(samples: Samples) -> list[Line]:
    """Return the vibrations of joints that do not move otherwise.

    They last all the time or for a part of the log. Lines number the joints of these samples.
    """
    # Samples that are all equal have no spectrum.
    scatters = np.ptp(samples.q, axis=0) > 0
    if not scatters.any() or len(samples.t) < vibrations.MIN_SPECTRUM_ROWS:
        return []
    samples = samples.joints(scatters)
    lines = vibrations.find_lines(samples, samples.q - samples.q.mean(axis=0))
    # A spline of one interval over the whole log stands for the constant: it follows no burst.
    lines += vibrations.find_bursts(samples, np.array(samples.span), least_squares.MIN_CELLS)
    # Numbers among the joints that scatter become numbers among all that came.
    return [replace(line, joint=int(np.flatnonzero(scatters)[line.joint])) for line in lines]


def _smooth_samples(
    samples: Samples, bandwidth: float | None
) -> tuple[np.ndarray, SampleHolds | SensorClocks, SmoothedSamples | None]:
    """Return which joints move, which rows hold older positions, and the spline.

    The spline is of the joints that move, `True` among (n,), and None where all rest.
    """
    # Joints whose samples are all alike rest for certain.
    moving = np.ptp(samples.q, axis=0) > 0
    holds: SampleHolds | SensorClocks = SampleHolds(np.zeros(len(samples.t), bool), samples.t)
    if not moving.any():
        return moving, holds, None
    # Others may only scatter: a first fit by even breaks explains these no better than a constant does.
    part = samples.joints(moving)
    first, cells = knots.fit_even_breaks(part)
    moves = smoothing.find_moving_joints(part, first)
    moving[moving] = moves
    if not moves.any():
        return moving, holds, None
    # Joints at rest have no part in the choice of breaks: without them it is made once more.
    if not moves.all():
        part = samples.joints(moving)
        first, cells = knots.fit_even_breaks(part)
    # Rows may hold older positions, of all joints together or of each joint in rows of its own: only fresh ones count.
    curve = first.spline(part.t)
    together = clocks.find_holds(part, curve, first, cells)
    separate = clocks.find_sensors(part, curve, first, cells, together)
    holds = together if separate is None else separate
    if holds.held.any():
        part = together.without(part) if separate is None else separate.samples
        first, cells = knots.fit_even_breaks(part)
    # Samples of a formula or a simulation have no noise: a spline goes through all of them. A stated bandwidth is kept.
    if bandwidth is None and smoothing.is_exact(part, first):
        return moving, holds, smoothing.interpolate(part)
    return moving, holds, smoothing.smooth(part, first, cells, bandwidth)


def _assemble_fit(source: FitSource, scatter: tuple[Noise, ...]) -> Fit:
    """Return the fit of all joints, and judge each derivative.

    `fit` adds notes and vibrations.
    """
    from scipy.interpolate import BSpline

    samples, moving, smoothed = source.samples, source.moving, source.smoothed
    t, q = samples.t, samples.q
    # Where all joints rest, one interval over the whole log holds their constants.
    all_knots = least_squares.pad_knots(t[[0, -1]]) if smoothed is None else smoothed.spline.t
    breaks = all_knots[least_squares.FIT_DEGREE : len(all_knots) - least_squares.FIT_DEGREE]
    # B-splines sum to 1, so that equal coefficients make a constant: (M + 9, n). Those of joints that move give way.
    # The mean is taken of differences from the first row: it is exact where a joint does not move at all.
    means = q[0] + (q - q[0]).mean(axis=0)
    coefficients = np.tile(means, (len(all_knots) - least_squares.FIT_DEGREE - 1, 1))
    if smoothed is not None:
        coefficients[:, moving] = smoothed.spline.c
    spline = BSpline(all_knots, coefficients, least_squares.FIT_DEGREE)
    # A spline of M even intervals per second follows up to M / 2 Hz, as samples at M per second would.
    bandwidth = 0.5 / knots.median_length(breaks)
    # Derivatives are known between the ends: the outer intervals have neighbours on one side alone. At least one
    # interval is left between them.
    ends = samples.span
    if smoothed is not None:
        edge = min(END_INTERVALS, max(0, (len(breaks) - 2) // 2))
        ends = float(breaks[edge]), float(breaks[-1 - edge])
    # A fit whose peaks and shares are 0 for now has the deviations by which these are found. Vibrations that the spline
    # leaves out have no part in them: a user is to hear of these by notes, and not by samples that are refused.
    spread = None if smoothed is None else smoothed.spread
    followed = None if spread is None else replace(spread, left_out=())
    spacing = float(np.median(np.diff(t)))
    zeros = np.zeros((reliability.MAX_DEVIATION_ORDER + 1, len(source.joints)))
    bare = Fit(
        spline, source.joints, scatter, bandwidth, ends, zeros, zeros[:, 0], (), spacing, source.rows, followed, moving
    )

    def deviations_of_movers(times: np.ndarray) -> np.ndarray:
        # (T,) -> (7, T, n), 0 of joints at rest: their scatter is no part of a motion.
        return np.array(bare.deviations(times, reliability.MAX_DEVIATION_ORDER)) * moving

    peaks, shares = reliability.peaks_and_shares(spline, deviations_of_movers, ends, q)
    # Users see deviations with all vibrations.
    return replace(bare, peaks=peaks, relative=shares, _spread=spread)


def check_samples(
    t: object, q: object, names: Sequence[str] | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return samples as arrays, the numbers of their rows, and joint names.

    Times are (N,), samples (N, n). Raises `JounceError` if they are invalid. Rows that are equal to the one
    before, time included, are left out.
    """
    times, samples = (_as_numbers(x, label) for x, label in ((t, "t"), (q, "q")))
    samples = samples[:, None] if samples.ndim == 1 else samples
    if times.ndim != 1 or samples.ndim != 2 or len(times) != len(samples):
        raise JounceError(f"t has shape {times.shape} and q {samples.shape}; expected (N,) and (N, n)")
    if names is None or len(names) == 0:
        names = [f"column {k + 1}" for k in range(samples.shape[1])]
    joints = tuple(names)
    if len(joints) != samples.shape[1]:
        raise JounceError(f"{len(joints)} names for {samples.shape[1]} columns; expected one per column")
    if not np.isfinite(times).all():
        raise JounceError(f"the time of sample {np.argmin(np.isfinite(times))} is not a number; remove the row")
    for name, column in zip(joints, samples.T, strict=True):
        possible = np.abs(column) <= MAX_POSITION  # False of NaN, too
        if not possible.all():
            row = int(np.argmin(possible))
            came = f"{name} is {column[row]} at t = {times[row]:g} s"
            raise JounceError(f"{came}; expected numbers up to {MAX_POSITION:g}: remove such rows")
    # Loggers write rows twice: a row that says nothing new is left out, one of another position at that time refused.
    is_new = np.append(True, (np.diff(times) != 0) | (np.diff(samples, axis=0) != 0).any(axis=1))
    times, samples = times[is_new], samples[is_new]
    late = np.diff(times) <= 0
    if late.any():
        row = int(np.argmax(late))
        came = f"time goes from {times[row]:.9g} to {times[row + 1]:.9g} s at sample {row + 1}"
        raise JounceError(f"{came}; expected increasing times: sort the rows, or write the time with more digits")
    if len(times) < least_squares.MIN_FIT_SAMPLES:
        raise JounceError(
            f"{len(times)} samples; smoothing needs at least {least_squares.MIN_FIT_SAMPLES}: give a longer log, or"
            " through()"
        )
    return times, samples, np.flatnonzero(is_new), joints


def _as_numbers(numbers: object, label: str) -> np.ndarray:
    """Return numbers as an array of float64; raise `JounceError` for anything else."""
    array = np.asarray(numbers)
    if array.dtype.kind not in "fiu":
        raise JounceError(f"{label} is {quote_value(numbers)}; expected an array of numbers")
    return array.astype(float)


def find_spikes(t: np.ndarray, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return which rows (N,) are single wild ones.

    They lie off the line through those on either side, alone and much farther than others around.
    """
    # How far each row is off the straight line through its neighbours. The first and the last row have no line; four
    # zeros on either side of the other N - 2 rows, (N + 6, n), leave a place for three neighbours of each. Row k has
    # the place k + 3.
    share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
    off = np.pad(q[1:-1] - q[:-2] * (1 - share) - q[2:] * share, ((4, 4), (0, 0)))
    usual = np.maximum(np.median(np.abs(off[:: len(off) // least_squares.MAX_SCATTER_ROWS + 1]), axis=0), steps)
    at, joint = np.nonzero(np.abs(off) > MIN_SPIKE * usual)
    # A spike puts its neighbours off their lines in the other direction, and no row further away: a step of a motion
    # or a vibration does not do so.
    spike, before, after = (off[at + k, joint] for k in (0, -1, 1))
    around = np.max([np.abs(off[at + k, joint]) for k in (-3, -2, 2, 3)], axis=0)
    is_alone = (np.abs(spike) > MIN_SPIKE * around) & (spike * before < 0) & (spike * after < 0)
    wild = np.zeros(len(t), bool)
    wild[at[is_alone] - 3] = True
    return wild
