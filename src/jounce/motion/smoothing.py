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
MIN_WILD_SHARE = 0.5  # of what a wild row is off the fit, it is off its neighbours
MAX_NEIGHBOUR_SHARE = 1 / 3  # of that, which its neighbours are off without it,
MAX_NEIGHBOUR_DEVIATIONS = 4.0  # and standard deviations of noise besides
MAX_SCATTER_SHARE = 0.1  # of a joint's scatter about its mean that a fit may leave
RESIDUAL_REACH = 2  # intervals on either side of one that determine how well the fit follows there
RESIDUAL_DEVIATIONS = 6  # standard deviations of chi^2, by which residuals around an interval are not noise
MIN_NOTED_RESIDUAL = 10.0  # times the usual squares of residuals, which a user should know of


@dataclass(frozen=True, eq=False)
class SmoothedSamples:
    """A spline through or along samples, with what its deviations come from and what was noticed."""

    samples: Samples
    spline: "BSpline"
    spread: SplineCovariances
    sigma: np.ndarray
    notes: tuple[str, ...]
    lines: tuple[Line, ...] = ()  # followed, or left out as the spread says
    errors_of_encoders: tuple[tuple[int, int], ...] = ()  # joints, and counts per turn
    scatter: TimestampScatter | None = None  # of time stamps that are corrected

    def hidden_amplitudes(self) -> np.ndarray:
        """The largest amplitudes (n,) of vibrations above the band that would not show."""
        samples, kept = self.samples, np.ones(self.samples.q.shape[1])
        velocity = self.spline(samples.t, nu=1)
        if self.scatter:
            kept = clocks.remaining_share(velocity, self.scatter)
        band = 0.5 / knots.median_length(self.spread.solution.breaks)
        return vibrations.find_hidden_amplitudes(samples, samples.q - self.spline(samples.t), velocity, band, kept)


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
    """Which joints, (n,), a spline explains better, by BIC, than a constant does, or scatter by more than noise."""
    count = len(samples.t)
    constant = np.maximum(samples.q.var(axis=0), samples.floor)
    spline = np.maximum(first.energy / count, samples.floor)
    explained = count * np.log(constant / spline) > (first.unknowns - 1) * np.log(count)
    return explained | noise.varies_slowly(samples.q)


def smooth(samples: Samples, first: SplineSolution, cells: int, bandwidth: float | None) -> SmoothedSamples:
    """The smoothing spline of joints that move; without a bandwidth, of vibrations too that stand out of the noise.

    What stands out once the largest vibrations are followed is followed too, as far as the samples carry it.
    """
    found = _follow_vibrations(samples, first, cells, bandwidth)
    errors = vibrations.find_encoder_errors(found.samples, found.spread.solution.breaks, cells, found.lines)
    return replace(found, errors_of_encoders=tuple(errors))


def _follow_vibrations(samples: Samples, first: SplineSolution, cells: int, bandwidth: float | None) -> SmoothedSamples:
    found = _smooth_once(samples, first, cells, bandwidth)
    lines: tuple[Line, ...] = ()
    for _ in range(MAX_VIBRATION_ROUNDS if bandwidth is None else 0):
        if not (new := found.spread.left_out):
            break
        # all found so far determine the band, and the parts with denser breaks
        in_parts = {line.joint for line in new if not line.lasts}  # a burst is a line of all samples too
        lines += tuple(line for line in new if not (line.lasts and line.joint in in_parts))
        lasting = [line.frequency for line in lines if line.lasts]
        bursts = tuple(vibrations.with_flanks(line, samples.span) for line in lines if not line.lasts)
        try:
            found = _smooth_once(
                samples, first, cells, vibrations.BAND_TO_LINE * max(lasting) if lasting else None, bursts
            )
        except JounceError:  # the samples do not carry such a band
            return replace(found, lines=lines)
        # what is left beyond that band: below is what a wider fit leaves at its end
        end = NEXT_LINE_TO_BAND * vibrations.BAND_TO_LINE * max(lasting, default=0.0)
        new = tuple(line for line in found.spread.left_out if not line.lasts or line.frequency > end)
        found = replace(found, spread=replace(found.spread, left_out=new))
    return replace(found, lines=lines + found.spread.left_out)


def _smooth_once(
    samples: Samples, first: SplineSolution, cells: int, bandwidth: float | None, bursts: Sequence[DensePart] = ()
) -> SmoothedSamples:
    # weights, and beats of rounding
    scatter = np.sqrt(first.energy / len(samples.t))
    samples = replace(
        samples, weight=noise.rest_weights(samples.t, samples.q, float(np.ptp(samples.t)) / first.intervals)
    )
    velocity = first.spline(samples.t, nu=1)
    beats = noise.find_beats(samples.t, samples.q, velocity, samples.steps, scatter, samples.weight)
    floor = np.maximum(samples.floor, samples.steps**2 / 12)
    setting = KnotSetting(beats, first.intervals, cells, bandwidth, floor, bursts)
    # time stamps by the first fit
    stamped, left = samples, None
    found = clocks.correct_timestamps(samples, first, cells, 1)
    if found:  # what is finer than stamps can show is not worth breaks
        samples = replace(found[0], drift=(first.spline, found[1].own))
        setting = replace(setting, floor=np.maximum(setting.floor, scatter**2))
    # breaks
    chosen, samples, notes = _without_outliers(samples, setting)
    if found:  # time stamps by the better fit
        rows = stamped.rows(cells)
        raw = knots.fit_breaks(rows, chosen.solution.breaks)
        samples, times = clocks.correct_timestamps(stamped, raw, cells, 2) or found
        alike = clocks.correlation_factor(samples, stamped.t, raw, times.sigma)
        left = reliability.timestamp_covariances(rows, raw, alike * times.sigma, times.own)
        chosen = knots.refit_choice(samples.rows(cells), beats, chosen)
        notes += (f"time stamps scatter by {times.sigma:.2g} s; one shift per row, from all joints, corrects them",)
    # what the spline leaves: vibrations
    solution = chosen.solution
    residual = samples.q - solution.spline(samples.t)
    lines = vibrations.find_lines(samples, residual, solution.spline)
    if found:  # a vibration of all joints looks like scatter of stamps, which corrected ones take
        stated = vibrations.find_lines(stamped, stamped.q - solution.spline(stamped.t), solution.spline)
        lines = list({line.joint: line for line in sorted([*lines, *stated], key=lambda line: line.amplitude)}.values())
    else:  # corrected stamps leave errors that come and go with the velocity
        lines += vibrations.find_bursts(samples, solution.breaks, cells)
    # noise, which has no part of a vibration that is left out: its own deviation holds that
    shares = _noise_shares(lines, residual.shape[1], 0.5 / knots.median_length(solution.breaks))
    excess = residual_excess(samples, residual, solution.breaks, chosen.variance)
    variance = shares * chosen.variance * beats.inflation(solution.breaks, rests=True)
    beyond = chosen.variance * (excess - 1)
    spread = SplineCovariances(solution, variance, chosen.coarser.spline, chosen.ratio, left, beyond, samples.unsure)
    sigma = np.sqrt(shares * (residual**2).mean(axis=0))
    notes += notes_of_residual(samples, residual, solution.breaks, excess)
    left_out = replace(spread, left_out=tuple(lines))
    return SmoothedSamples(samples, solution.spline, left_out, sigma, notes, scatter=times if found else None)


def _noise_shares(lines: Sequence[Line], count: int, band: float) -> np.ndarray:
    """The shares (n,) of residuals' powers that are noise, without those of lasting vibrations well above the band."""
    shares = np.ones(count)
    for line in lines:
        if line.lasts and line.frequency > MIN_LINE_TO_BAND * band:
            shares[line.joint] = min(shares[line.joint], 1 - line.share)
    return shares


def interpolate(samples: Samples) -> SmoothedSamples:
    """The spline of degree 9 through all samples, whose noise is their rounding."""
    from scipy.interpolate import make_interp_spline

    curve = make_interp_spline(samples.t, samples.q, k=least_squares.FIT_DEGREE)
    solution = least_squares.solve(
        least_squares.make_rows(samples.t, samples.q, samples.weight, samples.span),
        curve.t[least_squares.FIT_DEGREE : -least_squares.FIT_DEGREE],
    )
    sigma = np.maximum(samples.steps / np.sqrt(12), np.sqrt(samples.floor) / 8)
    variance = np.broadcast_to(sigma**2, (solution.intervals, len(sigma)))
    note = "the samples' noise is no more than their rounding; the spline goes through all of them"
    return SmoothedSamples(samples, curve, SplineCovariances(solution, variance), sigma, (note,))


def _choose_knots(samples: Samples, setting: KnotSetting) -> KnotChoice:
    rows = samples.rows(setting.cells)
    if setting.bandwidth is None:
        return knots.densify(
            rows, knots.select_knots(rows, setting.beats, setting.intervals, setting.floor), setting.bursts
        )
    wanted = max(1, int(np.ceil(2 * setting.bandwidth * np.ptp(samples.span))))
    most = knots.max_intervals(rows)
    if wanted > most:
        bound = most / 2 / np.ptp(samples.span)
        raise JounceError(f"bandwidth = {setting.bandwidth:g} Hz; these samples carry at most {bound:.3g} Hz")
    return knots.densify(rows, knots.select_by_bandwidth(rows, setting.beats, wanted, setting.floor), setting.bursts)


def _without_outliers(samples: Samples, setting: KnotSetting) -> tuple[KnotChoice, Samples, tuple[str, ...]]:
    """The choice, once more where single rows lie far off, with less weight for these (Huber's)."""
    chosen = _choose_knots(samples, setting)
    left = samples.q - chosen.solution.spline(samples.t)
    scale = np.maximum(np.median(np.abs(left), axis=0) / 0.6745, np.sqrt(chosen.variance) / 2)
    far = _outlier_distances(samples, left, scale) / OUTLIER_DEVIATIONS
    if not 0 < (far > 1).mean() < MAX_OUTLIER_SHARE:
        return chosen, samples, ()
    samples = replace(samples, weight=samples.weight / np.sqrt(np.maximum(far, 1)))
    return _choose_knots(samples, setting), samples, (f"{(far > 1).sum()} rows lie far from the others and count less",)


def _outlier_distances(samples: Samples, left: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """How far each row (N,) of residuals (N, n) is off, in some joint; 0 where it is so by a motion of several rows."""
    off = np.abs(left) / scale
    far, worst = off.max(axis=1), off.argmax(axis=1)
    [beyond] = np.nonzero(far > OUTLIER_DEVIATIONS)
    alone = are_wild_rows(samples.t, samples.q / scale, beyond, worst[beyond], far[beyond])
    far[beyond[~alone]] = 0.0
    return far


def is_exact(samples: Samples, first: SplineSolution) -> bool:
    """Whether a spline explains samples to their rounding, or needs all breaks there are though they look smooth.

    Smooth in most places: a kink in exact samples is not noise.
    """
    sigma = np.sqrt(first.energy / len(samples.t))
    exact = (sigma < ROUNDING_OF_Q * np.abs(samples.q).max(axis=0)).all()
    if exact or samples.steps.any():
        return bool(exact)
    needs_many = first.intervals >= MIN_NEEDED_INTERVALS * knots.max_intervals(samples.rows(least_squares.MIN_CELLS))
    return needs_many and bool(
        (noise.estimate_local_noise(samples.q) < MAX_SMOOTH_NOISE * np.ptp(samples.q, axis=0)).all()
    )


# What is no noise: wild rows, and residuals of a motion that is too fast.
def are_wild_rows(t: np.ndarray, q: np.ndarray, rows: np.ndarray, joint: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Which rows, (R,), far `off` a fit in a joint, are wild: q (N, n) and `off` are in standard deviations of noise.

    A motion that the fit does not follow leaves far rows too. A wild row, or one of two in succession, is off the cubic
    through two rows on either side, and without it its neighbours are smooth, which those in a fast motion are not.
    """
    wild = np.zeros(len(rows), bool)
    for others in ((0,), (0, 1), (-1, 0)):  # rows that may be wild together
        own = _distance_from_cubic(t, q, rows, joint, 0, others)
        beside = [_distance_from_cubic(t, q, rows, joint, k, others) for k in (others[0] - 1, others[-1] + 1)]
        wild |= (own > off * MIN_WILD_SHARE) & (
            np.maximum(*beside) < own * MAX_NEIGHBOUR_SHARE + MAX_NEIGHBOUR_DEVIATIONS
        )
    return wild


def _distance_from_cubic(
    t: np.ndarray, q: np.ndarray, rows: np.ndarray, joint: np.ndarray, target: int, without: tuple[int, ...]
) -> np.ndarray:
    """How far the rows (R,) plus a number `target` are off the cubic through the two next on either side but some."""
    before = [k for k in range(target - 1, -9, -1) if k not in without][:2]
    after = [k for k in range(target + 1, 9) if k not in without][:2]
    at = {k: (rows + k).clip(0, len(t) - 1) for k in (target, *before, *after)}
    inside = (rows + min(before) >= 0) & (rows + max(after) < len(t))
    off = q[at[target], joint].copy()
    for k in (*before, *after):
        others = [j for j in (*before, *after) if j != k]
        with np.errstate(divide="ignore", invalid="ignore"):  # at the ends rows coincide
            shares = [(t[at[target]] - t[at[j]]) / (t[at[k]] - t[at[j]]) for j in others]
            off -= q[at[k], joint] * np.prod(shares, axis=0)
    return np.where(inside, np.abs(off), np.inf if target == 0 else 0.0)


def residual_excess(samples: Samples, residual: np.ndarray, breaks: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Mean squares of residuals (N, n) around each interval over the variance, (M, n), where they are no noise; or 1.

    A motion that is too fast for the samples leaves them, and an error of its own size.
    """
    squares = (samples.weight[:, None] * residual) ** 2 / variance
    bounds = np.searchsorted(samples.t, breaks)
    bounds[0], bounds[-1] = 0, len(samples.t)
    sums = np.concatenate([np.zeros((1, squares.shape[1])), np.cumsum(squares, axis=0)])
    first, last = (np.arange(len(breaks) - 1) + k for k in (-RESIDUAL_REACH, RESIDUAL_REACH + 1))
    first, last = first.clip(0), last.clip(max=len(breaks) - 1)
    freedom = np.maximum(bounds[last] - bounds[first] - (last - first), 1)[:, None]
    mean = (sums[bounds[last]] - sums[bounds[first]]) / freedom
    return np.where(mean > 1 + RESIDUAL_DEVIATIONS * np.sqrt(2 / freedom), mean, 1.0)


def notes_of_residual(
    samples: Samples, residual: np.ndarray, breaks: np.ndarray, excess: np.ndarray
) -> tuple[str, ...]:
    """What a user should know of residuals (N, n) that are no noise."""
    notes = []
    if (noise.varies_slowly(residual) & (residual.std(axis=0) > MAX_SCATTER_SHARE * samples.q.std(axis=0))).any():
        notes.append("much of the samples' scatter is no white noise: there may be motion faster than they carry")
    where = np.flatnonzero((excess > MIN_NOTED_RESIDUAL).any(axis=1))
    if where.size:
        parts = np.split(where, np.flatnonzero(np.diff(where) > 2 * RESIDUAL_REACH) + 1)
        at = join_names(f"{breaks[part[0]]:.4g} to {breaks[part[-1] + 1]:.4g} s" for part in parts)
        notes.append(f"the fit does not follow the samples to their noise at t = {at}: deviations are larger there")
    return tuple(notes)
