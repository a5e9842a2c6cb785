"""Make a spline of samples: find noise, rows that count, wrong stamps, breaks.

Problem: a spline of degree 9 that follows the motion and not the noise, and the noise. One pass of `_smooth_once`:

1. weights of rows at rest, and where rounding to an encoder's steps is no white noise (`Beats`)
2. time stamps, corrected by the first fit where shifts of rows explain its residuals (`jounce.motion.clocks`)
3. the breaks (`jounce.motion.knots`), with wild rows weighed as Huber does (Robust Estimation of a Location Parameter,
   Annals of Mathematical Statistics 35, 1964), and once more without their effect
4. the stamps again, by that better fit, and the same breaks for the samples at their final times
5. residuals: where they are no noise (`residual_excess`), and vibrations among them (`jounce.motion.vibrations`)

`smooth` is the door. `_follow_vibrations` repeats the pass with breaks that follow those, up to MAX_VIBRATION_ROUNDS
times. What is fast and below the noise is not found; what is fast and above it, but no line, shows in residuals:
deviations are larger there, and a note says where.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.errors import JounceError, join_names
from jounce.motion import clocks, knots, least_squares, noise, reliability, vibrations
from jounce.motion.clocks import TimestampScatter
from jounce.motion.curves import ROUNDING_OF_Q
from jounce.motion.knots import DensePart, KnotChoice
from jounce.motion.least_squares import Samples, SplineSolution
from jounce.motion.noise import Beats
from jounce.motion.reliability import SplineCovariances
from jounce.motion.vibrations import Line

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


MAX_SMOOTH_NOISE = 1e-5  # share of a joint's range that differences of smooth samples leave as noise
MIN_NEEDED_INTERVALS = 0.7  # share of those that samples bear: a need of more looks like samples without noise
OUTLIER_DEVIATIONS = 6  # standard deviations, beyond which a row counts less
MAX_OUTLIER_SHARE = 0.05  # of the samples; more of them are no outliers
MIN_LINE_TO_BAND = 2.0  # times the end of the band, from which on a spline takes no part of a vibration
NEXT_LINE_TO_BAND = 1.5  # times the end of the band, from which on a line is another vibration
MAX_VIBRATION_ROUNDS = 3  # in which vibrations are looked for once more, after those found are followed
MIN_WILD_SHARE = 0.5  # of its distance from the fit, by which a wild row is off its neighbours at least
MAX_NEIGHBOUR_SHARE = 1 / 3  # of its distance from them, by which neighbours are off each other without it,
MAX_NEIGHBOUR_DEVIATIONS = 4.0  # and standard deviations of noise besides
MAX_SCATTER_SHARE = 0.1  # of a joint's scatter about its mean that a fit may leave
RESIDUAL_REACH = 2  # intervals on either side of one that determine how well the fit follows there
RESIDUAL_DEVIATIONS = 6  # standard deviations of chi^2, by which residuals around an interval are not noise
MIN_NOTED_RESIDUAL = 10.0  # times the usual squares of residuals, which a user should know of


@dataclass(frozen=True, eq=False)
class SmoothedSamples:
    """A spline through or along samples, with its covariances and notes."""

    samples: Samples  # as they were fitted: at corrected times, without rows that hold older positions
    spline: "BSpline"
    spread: SplineCovariances  # by which deviations follow
    sigma: np.ndarray  # (n,), standard deviation of the noise
    notes: tuple[str, ...]
    lines: tuple[Line, ...] = ()  # followed, or left out as the spread says
    errors_of_encoders: tuple[tuple[int, int], ...] = ()  # joints, and counts per turn
    scatter: TimestampScatter | None = None  # of time stamps that are corrected

    def hidden_amplitudes(self) -> np.ndarray:
        """Return the largest amplitudes (n,) of hidden vibrations.

        They are above the band of the spline.
        """
        samples, shares = self.samples, np.ones(self.samples.q.shape[1])
        velocity = self.spline(samples.t, nu=1)
        # Corrected time stamps take a part of a vibration with them.
        if self.scatter is not None:
            shares = clocks.remaining_share(velocity, self.scatter)
        band = 0.5 / knots.median_length(self.spread.solution.breaks)
        return vibrations.find_hidden_amplitudes(samples, samples.q - self.spline(samples.t), velocity, band, shares)


@dataclass(frozen=True, eq=False)
class KnotSetting:
    """What breaks are chosen by."""

    beats: Beats  # of rounding
    intervals: int  # a first number of them
    cells: int
    bandwidth: float | None  # Hz, if it is given
    floor: np.ndarray  # (n,), the variance below which nothing is worth a break
    bursts: Sequence[DensePart] = ()  # parts with denser breaks


def find_moving_joints(samples: Samples, first: SplineSolution) -> np.ndarray:
    """Return which joints (n,) move.

    A spline explains them better, by BIC, than a constant does, or they scatter by more than noise.
    """
    count = len(samples.t)
    constant = np.maximum(samples.q.var(axis=0), samples.floor)
    spline = np.maximum(first.energy / count, samples.floor)
    # A spline has more coefficients than a constant has: what it explains has to be worth ln N for each.
    explained = count * np.log(constant / spline) > (first.unknowns - 1) * np.log(count)
    return explained | noise.varies_slowly(samples.q)


def smooth(samples: Samples, first: SplineSolution, cells: int, bandwidth: float | None) -> SmoothedSamples:
    """Return the smoothing spline of joints that move.

    Without a bandwidth it follows vibrations too that stand out of the noise. What stands out once the largest
    vibrations are followed is followed too, as far as the samples carry it.
    """
    smoothed = _follow_vibrations(samples, first, cells, bandwidth)
    errors = vibrations.find_encoder_errors(smoothed.samples, smoothed.spread.solution.breaks, cells, smoothed.lines)
    return replace(smoothed, errors_of_encoders=tuple(errors))


def _follow_vibrations(samples: Samples, first: SplineSolution, cells: int, bandwidth: float | None) -> SmoothedSamples:
    """Return the spline whose band and dense parts follow vibrations.

    A stated bandwidth is kept: vibrations above it are left out, and deviations hold them.
    """
    smoothed = _smooth_once(samples, first, cells, bandwidth)
    lines: tuple[Line, ...] = ()
    for _ in range(MAX_VIBRATION_ROUNDS if bandwidth is None else 0):
        new = smoothed.spread.left_out
        if len(new) == 0:
            break
        # A burst is a line of all samples too: of a joint with bursts its lasting line is not followed.
        joints_with_bursts = {line.joint for line in new if not line.lasts}
        lines += tuple(line for line in new if not (line.lasts and line.joint in joints_with_bursts))
        # All vibrations so far determine the band, and the parts with denser breaks.
        lasting = [line.frequency for line in lines if line.lasts]
        bursts = tuple(vibrations.with_flanks(line, samples.span) for line in lines if not line.lasts)
        band = vibrations.BAND_TO_LINE * max(lasting) if len(lasting) > 0 else None
        try:
            smoothed = _smooth_once(samples, first, cells, band, bursts)
        except JounceError:
            # The samples do not carry such a band: the spline before, and deviations that hold the vibrations.
            return replace(smoothed, lines=lines)
        # Lines just above the new band are what a wider fit leaves at its end, and no further vibrations.
        end = NEXT_LINE_TO_BAND * vibrations.BAND_TO_LINE * max(lasting, default=0.0)
        new = tuple(line for line in smoothed.spread.left_out if not line.lasts or line.frequency > end)
        smoothed = replace(smoothed, spread=replace(smoothed.spread, left_out=new))
    return replace(smoothed, lines=lines + smoothed.spread.left_out)


def _smooth_once(
    samples: Samples, first: SplineSolution, cells: int, bandwidth: float | None, bursts: Sequence[DensePart] = ()
) -> SmoothedSamples:
    """Return the spline of one pass of the head's five steps."""
    # Step 1: weights of rows at rest, and beats of rounding. Below the floor, the variance of rounding, nothing is
    # worth a break.
    scatter = np.sqrt(first.energy / len(samples.t))
    samples = replace(
        samples, weight=noise.rest_weights(samples.t, samples.q, float(np.ptp(samples.t)) / first.intervals)
    )
    velocity = first.spline(samples.t, nu=1)
    beats = noise.find_beats(samples.t, samples.q, velocity, samples.steps, scatter, samples.weight)
    floor = np.maximum(samples.floor, samples.steps**2 / 12)
    setting = KnotSetting(beats, first.intervals, cells, bandwidth, floor, bursts)
    # Step 2: time stamps, corrected by the first fit. What is finer than stamps can show is not worth breaks either.
    stamped, stamp_covariances = samples, None
    correction = clocks.correct_timestamps(samples, first, cells, 1)
    if correction is not None:
        samples = replace(correction[0], drift=(first.spline, correction[1].variance))
        setting = replace(setting, floor=np.maximum(setting.floor, scatter**2))
    # Step 3: breaks, and rows that weigh less.
    chosen, samples, notes = _without_outliers(samples, setting)
    stamp_scatter = None
    if correction is not None:
        # Step 4: stamps once more, from the raw ones by the better fit, and the same breaks at the final times.
        rows = stamped.rows(cells)
        raw = knots.fit_breaks(rows, chosen.solution.breaks)
        better = clocks.correct_timestamps(stamped, raw, cells, 2)
        samples, stamp_scatter = correction if better is None else better
        # Shifts of neighbours that are alike average out less than independent ones do: sigma counts for more.
        factor = clocks.correlation_factor(samples, stamped.t, raw, stamp_scatter.sigma)
        stamp_covariances = reliability.timestamp_covariances(
            rows, raw, factor * stamp_scatter.sigma, stamp_scatter.variance
        )
        chosen = knots.refit_choice(samples.rows(cells), beats, chosen)
        notes += (
            f"time stamps scatter by {stamp_scatter.sigma:.2g} s; one shift per row, from all joints, corrects them",
        )
    # Step 5: what the spline leaves, (N, n): vibrations first.
    solution = chosen.solution
    residual = samples.q - solution.spline(samples.t)
    lines = vibrations.find_lines(samples, residual, solution.spline)
    if correction is not None:
        # A vibration of all joints looks like scatter of stamps, and corrected ones take it: the stated ones show it.
        # Of each joint the larger line counts. Bursts are not looked for, since corrected stamps leave errors that
        # come and go with the velocity.
        stated = vibrations.find_lines(stamped, stamped.q - solution.spline(stamped.t), solution.spline)
        lines = list({line.joint: line for line in sorted([*lines, *stated], key=lambda line: line.amplitude)}.values())
    else:
        lines += vibrations.find_bursts(samples, solution.breaks, cells)
    # Noise is the rest: the deviation of a vibration that is left out holds its part.
    shares = _noise_shares(lines, residual.shape[1], 0.5 / knots.median_length(solution.breaks))
    # Variances per interval and joint, (M, n): of noise, where beats count as white noise that is fitted alike, and of
    # residuals that are more than noise.
    excess = residual_excess(samples, residual, solution.breaks, chosen.variance)
    variance = shares * chosen.variance * beats.inflation(solution.breaks, rests=True)
    unfollowed = chosen.variance * (excess - 1)
    spread = SplineCovariances(
        solution,
        variance,
        coarser=chosen.coarser.spline,
        ratio=chosen.ratio,
        stamps=stamp_covariances,
        unfollowed=unfollowed,
        unsure=samples.unsure,
        left_out=tuple(lines),
    )
    sigma = np.sqrt(shares * (residual**2).mean(axis=0))
    notes += notes_of_residual(samples, residual, solution.breaks, excess)
    return SmoothedSamples(samples, solution.spline, spread, sigma, notes, scatter=stamp_scatter)


def _noise_shares(lines: Sequence[Line], count: int, band: float) -> np.ndarray:
    """Return the shares (n,) of residuals' powers that are noise.

    The rest is of lasting vibrations well above the band.
    """
    shares = np.ones(count)
    for line in lines:
        if line.lasts and line.frequency > MIN_LINE_TO_BAND * band:
            shares[line.joint] = min(shares[line.joint], 1 - line.share)
    return shares


def interpolate(samples: Samples) -> SmoothedSamples:
    """Return the spline of degree 9 through all samples.

    The noise of the samples is their rounding.
    """
    from scipy.interpolate import make_interp_spline

    curve = make_interp_spline(samples.t, samples.q, k=least_squares.FIT_DEGREE)
    # Deviations take the normal equations of the same breaks: its knots but for those at the ends.
    solution = least_squares.solve(
        least_squares.make_rows(samples.t, samples.q, samples.weight, samples.span),
        curve.t[least_squares.FIT_DEGREE : -least_squares.FIT_DEGREE],
    )
    # A step s that rounds evenly has the standard deviation s / sqrt(12); the floor is the square of four times the
    # rounding of doubles, of which half is usual.
    sigma = np.maximum(samples.steps / np.sqrt(12), np.sqrt(samples.floor) / 8)
    variance = np.broadcast_to(sigma**2, (solution.intervals, len(sigma)))
    note = "the samples' noise is no more than their rounding; the spline goes through all of them"
    return SmoothedSamples(samples, curve, SplineCovariances(solution, variance), sigma, (note,))


def _choose_knots(samples: Samples, setting: KnotSetting) -> KnotChoice:
    """Return the choice of breaks, by noise or for a band."""
    rows = samples.rows(setting.cells)
    if setting.bandwidth is None:
        choice = knots.select_knots(rows, setting.beats, setting.intervals, setting.floor)
        return knots.densify(rows, choice, setting.bursts)
    # A band of F Hz needs 2 F intervals per second.
    intervals = max(1, int(np.ceil(2 * setting.bandwidth * np.ptp(samples.span))))
    most = knots.max_intervals(rows)
    if intervals > most:
        bound = most / 2 / np.ptp(samples.span)
        raise JounceError(f"bandwidth = {setting.bandwidth:g} Hz; these samples carry at most {bound:.3g} Hz")
    choice = knots.select_by_bandwidth(rows, setting.beats, intervals, setting.floor)
    return knots.densify(rows, choice, setting.bursts)


def _without_outliers(samples: Samples, setting: KnotSetting) -> tuple[KnotChoice, Samples, tuple[str, ...]]:
    """Return the choice of breaks with less weight for single far rows.

    The samples with these weights and a note come with it.
    """
    chosen = _choose_knots(samples, setting)
    residual = samples.q - chosen.solution.spline(samples.t)
    # A scale that outliers hardly change: the median of |r| is 0.6745 standard deviations of a normal distribution.
    scale = np.maximum(np.median(np.abs(residual), axis=0) / 0.6745, np.sqrt(chosen.variance) / 2)
    distance = _outlier_distances(samples, residual, scale) / OUTLIER_DEVIATIONS
    # Where many rows are far, they are no outliers: the fit does not follow a motion there.
    is_far = distance > 1
    if not 0 < is_far.mean() < MAX_OUTLIER_SHARE:
        return chosen, samples, ()
    # Huber's weights: beyond the bound a row counts by its distance, and not by the square of it.
    samples = replace(samples, weight=samples.weight / np.sqrt(np.maximum(distance, 1)))
    return _choose_knots(samples, setting), samples, (f"{is_far.sum()} rows lie far from the others and count less",)


def _outlier_distances(samples: Samples, residual: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the distance (N,) of each row, in scales of a joint.

    Residuals are (N, n). Rows that are off by a motion of several rows count as 0.
    """
    off = np.abs(residual) / scale
    distance, worst = off.max(axis=1), off.argmax(axis=1)
    [far_rows] = np.nonzero(distance > OUTLIER_DEVIATIONS)
    is_wild = are_wild_rows(samples.t, samples.q / scale, far_rows, worst[far_rows], distance[far_rows])
    distance[far_rows[~is_wild]] = 0.0
    return distance


def is_exact(samples: Samples, first: SplineSolution) -> bool:
    """Return whether samples have no noise.

    A spline explains them to their rounding, or needs all breaks there are though they look smooth. They look
    smooth in most places: a kink in exact samples is not noise.
    """
    sigma = np.sqrt(first.energy / len(samples.t))
    exact = (sigma < ROUNDING_OF_Q * np.abs(samples.q).max(axis=0)).all()
    if exact or samples.steps.any():
        return bool(exact)
    # Splines of exact samples need more intervals without end, since each takes away more of the residual.
    most = knots.max_intervals(samples.rows(least_squares.MIN_CELLS))
    if first.intervals < MIN_NEEDED_INTERVALS * most:
        return False
    return bool((noise.estimate_local_noise(samples.q) < MAX_SMOOTH_NOISE * np.ptp(samples.q, axis=0)).all())


# What is no noise: wild rows, and residuals of a motion that is too fast.
def are_wild_rows(t: np.ndarray, q: np.ndarray, rows: np.ndarray, joint: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Return which rows (R,) far `off` a fit are wild.

    Each is far off in a joint; q (N, n) and `off` are in standard deviations of noise. A motion that the fit
    does not follow leaves far rows too. A wild row, or one of two in succession, is off the cubic through two
    rows on either side, and without it its neighbours are smooth, which those in a fast motion are not.
    """
    wild = np.zeros(len(rows), bool)
    # The row may be wild alone, with the next one, or with the one before: such rows are left out of the cubics.
    for wild_together in ((0,), (0, 1), (-1, 0)):
        distance = _distance_from_cubic(t, q, rows, joint, 0, wild_together)
        neighbours = wild_together[0] - 1, wild_together[-1] + 1
        off_neighbours = [_distance_from_cubic(t, q, rows, joint, k, wild_together) for k in neighbours]
        wild |= (distance > off * MIN_WILD_SHARE) & (
            np.maximum(*off_neighbours) < distance * MAX_NEIGHBOUR_SHARE + MAX_NEIGHBOUR_DEVIATIONS
        )
    return wild


def _distance_from_cubic(
    t: np.ndarray, q: np.ndarray, rows: np.ndarray, joint: np.ndarray, target: int, without: tuple[int, ...]
) -> np.ndarray:
    """Return how far rows plus a number `target` are off a cubic.

    It goes through the two rows next to the target on either side, but for those `without`. Rows are (R,), and
    so are the distances.
    """
    before = [k for k in range(target - 1, -9, -1) if k not in without][:2]
    after = [k for k in range(target + 1, 9) if k not in without][:2]
    places = {k: (rows + k).clip(0, len(t) - 1) for k in (target, *before, *after)}
    inside = (rows + min(before) >= 0) & (rows + max(after) < len(t))
    # Lagrange's form of the cubic: each of four rows counts by the product of three ratios of times. Near the ends of
    # the log clipped rows coincide, and divide by zero: these are replaced below.
    off = q[places[target], joint].copy()
    for k in (*before, *after):
        others = [j for j in (*before, *after) if j != k]
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = [(t[places[target]] - t[places[j]]) / (t[places[k]] - t[places[j]]) for j in others]
            off -= q[places[k], joint] * np.prod(shares, axis=0)
    # Where no cubic can be had the far row counts as far from it, and its neighbours as smooth.
    return np.where(inside, np.abs(off), np.inf if target == 0 else 0.0)


def residual_excess(samples: Samples, residual: np.ndarray, breaks: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return mean squares of residuals around each interval over the variance.

    They are (M, n) of residuals (N, n), and 1 where residuals are noise. A motion that is too fast for the
    samples leaves residuals, and an error of its own size.
    """
    squares = (samples.weight[:, None] * residual) ** 2 / variance
    bounds = np.searchsorted(samples.t, breaks)
    bounds[0], bounds[-1] = 0, len(samples.t)
    # Sums over the intervals from RESIDUAL_REACH before to as many after are differences of cumulative sums.
    sums = np.concatenate([np.zeros((1, squares.shape[1])), np.cumsum(squares, axis=0)])
    first, last = (np.arange(len(breaks) - 1) + k for k in (-RESIDUAL_REACH, RESIDUAL_REACH + 1))
    first, last = first.clip(0), last.clip(max=len(breaks) - 1)
    # Each interval takes one degree of freedom. The mean of chi^2 over f of them is 1, with the deviation sqrt(2 / f).
    freedom = np.maximum(bounds[last] - bounds[first] - (last - first), 1)[:, None]
    mean = (sums[bounds[last]] - sums[bounds[first]]) / freedom
    return np.where(mean > 1 + RESIDUAL_DEVIATIONS * np.sqrt(2 / freedom), mean, 1.0)


def notes_of_residual(
    samples: Samples, residual: np.ndarray, breaks: np.ndarray, excess: np.ndarray
) -> tuple[str, ...]:
    """Return notes on residuals (N, n) that are no noise."""
    notes = []
    if (noise.varies_slowly(residual) & (residual.std(axis=0) > MAX_SCATTER_SHARE * samples.q.std(axis=0))).any():
        notes.append("much of the samples' scatter is no white noise: there may be motion faster than they carry")
    intervals = np.flatnonzero((excess > MIN_NOTED_RESIDUAL).any(axis=1))
    if intervals.size > 0:
        # Intervals whose neighbourhoods overlap are one part of the log.
        parts = np.split(intervals, np.flatnonzero(np.diff(intervals) > 2 * RESIDUAL_REACH) + 1)
        times = join_names(f"{breaks[part[0]]:.4g} to {breaks[part[-1] + 1]:.4g} s" for part in parts)
        notes.append(f"the fit does not follow the samples to their noise at t = {times}: deviations are larger there")
    return tuple(notes)
