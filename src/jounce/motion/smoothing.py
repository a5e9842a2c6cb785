"""From measured samples to a spline: what is noise, which rows count, which stamps are wrong, how many breaks."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jounce.errors import JounceError
from jounce.motion.choice import Choice, again, bounded, by_schwarz, choose
from jounce.motion.correction import colour, corrected
from jounce.motion.deviations import Spread, stamp_covariances
from jounce.motion.knots import fitted, most_intervals
from jounce.motion.least_squares import CELLS, DEGREE, Solution, rows_of, solve
from jounce.motion.noise import Beats, beats_of, local_noise, rest_weights, whiteness
from jounce.motion.samples import Samples

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

ROUNDING = 64  # units in the last place of a double, below which samples are no measured ones
SMOOTH = 1e-5  # share of a joint's range that differences of smooth samples leave as noise at most
MANY = 0.7  # of the intervals that samples bear: needing as many looks as if there were no noise
NOT_WHITE = 5  # standard deviations of von Neumann's ratio
OUTLIER = 6  # standard deviations
UNEXPLAINED = 0.1  # share of a joint's scatter about its mean that a fit may leave
SEVERAL = 0.05  # share of the samples, from which on they are no outliers
LONG = 20 * CELLS  # samples, from which on parts of them tell how many intervals they need
PROBES, PROBE = 6, 4096  # such parts, and the samples of each


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A spline through or along samples, with what its deviations come from and what was noticed."""

    samples: Samples
    spline: "BSpline"
    spread: Spread
    sigma: np.ndarray
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Setting:
    """What breaks are chosen by: beats of rounding, a first number of intervals, the number of cells, the band in Hz
    where it is given, and the variance (n,) below which nothing is worth a break.
    """

    beats: Beats
    intervals: int
    cells: int
    bandwidth: float | None
    floor: np.ndarray


def first_fit(samples: Samples) -> tuple[Solution, int]:
    """The evenly spaced spline of least BIC, and the number of cells to which samples may be compressed for it."""
    if len(samples.t) < LONG:
        return by_schwarz(samples.rows(CELLS), samples.floor), CELLS
    starts = np.linspace(0, len(samples.t) - PROBE, PROBES).astype(int)
    parts = [samples.part(np.arange(start, start + PROBE)) for start in starts]
    needed = [by_schwarz(rows_of(p.t, p.q, p.weight, (p.t[0], p.t[-1])), samples.floor).intervals for p in parts]
    guess = int(np.mean(needed)) * len(samples.t) // PROBE
    cells = max(CELLS, 4 * guess)
    return by_schwarz(samples.rows(cells), samples.floor, guess), cells


def moves(samples: Samples, first: Solution) -> np.ndarray:
    """Which joints, (n,), a spline explains better, by BIC, than a constant does, or scatter by more than noise."""
    count = len(samples.t)
    constant = np.maximum(samples.q.var(axis=0), samples.floor)
    spline = np.maximum(first.energy / count, samples.floor)
    explained = count * np.log(constant / spline) > (first.unknowns - 1) * np.log(count)
    return explained | (whiteness(samples.q) < -NOT_WHITE)


def smooth(samples: Samples, first: Solution, cells: int, bandwidth: float | None) -> Smoothed:
    """The smoothing spline of joints that move."""
    scatter = np.sqrt(first.energy / len(samples.t))
    samples = replace(samples, weight=rest_weights(samples.t, samples.q, float(np.ptp(samples.t)) / first.intervals))
    velocity = first.spline(samples.t, nu=1)
    beats = beats_of(samples.t, samples.q, velocity, samples.steps, scatter, samples.weight)
    setting = Setting(beats, first.intervals, cells, bandwidth, np.maximum(samples.floor, samples.steps**2 / 12))
    stamped, left = samples, None
    found = corrected(samples, first, cells, 1)
    if found:  # what is finer than the stamps can tell is not worth breaks
        samples = replace(found[0], drift=(first.spline, found[1].own))
        setting = replace(setting, floor=np.maximum(setting.floor, scatter**2))
    chosen, samples, note = _without_outliers(samples, setting)
    notes = note
    if found:
        rows = stamped.rows(cells)
        raw = fitted(rows, chosen.solution.breaks)
        samples, times = corrected(stamped, raw, cells, 2) or found
        sigma = colour(samples, stamped.t, raw, times.sigma) * times.sigma
        left = stamp_covariances(rows, raw, sigma, times.own)
        chosen = again(samples.rows(cells), beats, chosen)
        notes += (f"time stamps scatter by {times.sigma:.2g} s; one shift per row, from all joints, corrects them",)
    solution = chosen.solution
    variance = chosen.variance * beats.inflation(solution.breaks, rests=True)
    spread = Spread(solution, variance, chosen.coarser.spline, chosen.ratio, left)
    residual = samples.q - solution.spline(samples.t)
    sigma_of = np.sqrt((residual**2).mean(axis=0))
    return Smoothed(samples, solution.spline, spread, sigma_of, notes + _unexplained(samples, residual))


def _unexplained(samples: Samples, residual: np.ndarray) -> tuple[str, ...]:
    slow = whiteness(residual) < -NOT_WHITE
    if not (slow & (residual.std(axis=0) > UNEXPLAINED * samples.q.std(axis=0))).any():
        return ()
    return ("much of the samples' scatter is no white noise: there may be motion faster than they carry",)


def interpolate(samples: Samples) -> Smoothed:
    """The spline of degree 9 through all samples, whose noise is their rounding."""
    from scipy.interpolate import make_interp_spline

    curve = make_interp_spline(samples.t, samples.q, k=DEGREE)
    solution = solve(rows_of(samples.t, samples.q, samples.weight, samples.span), curve.t[DEGREE:-DEGREE])
    sigma = np.maximum(samples.steps / np.sqrt(12), np.sqrt(samples.floor) / 8)
    variance = np.broadcast_to(sigma**2, (solution.intervals, len(sigma)))
    note = "the samples' noise is no more than their rounding; the spline goes through all of them"
    return Smoothed(samples, curve, Spread(solution, variance), sigma, (note,))


def _choice(samples: Samples, setting: Setting) -> Choice:
    rows = samples.rows(setting.cells)
    if setting.bandwidth is None:
        return choose(rows, setting.beats, setting.intervals, setting.floor)
    wanted = max(1, int(np.ceil(2 * setting.bandwidth * np.ptp(samples.span))))
    most = most_intervals(rows)
    if wanted > most:
        bound = most / 2 / np.ptp(samples.span)
        raise JounceError(f"bandwidth = {setting.bandwidth:g} Hz; these samples carry at most {bound:.3g} Hz")
    return bounded(rows, setting.beats, wanted, setting.floor)


def _without_outliers(samples: Samples, setting: Setting) -> tuple[Choice, Samples, tuple[str, ...]]:
    """The choice, once more where single rows lie far off, with less weight for these (Huber's)."""
    chosen = _choice(samples, setting)
    left = samples.q - chosen.solution.spline(samples.t)
    scale = np.maximum(np.median(np.abs(left), axis=0) / 0.6745, np.sqrt(chosen.variance) / 2)
    far = _far_alone(left / scale) / OUTLIER
    if not 0 < (far > 1).mean() < SEVERAL:
        return chosen, samples, ()
    samples = replace(samples, weight=samples.weight / np.sqrt(np.maximum(far, 1)))
    return _choice(samples, setting), samples, (f"{(far > 1).sum()} rows lie far from the others and count less",)


def _far_alone(left: np.ndarray) -> np.ndarray:
    """How far each row (N,) of residuals (N, n) is off, in some joint, and off what its neighbours are off."""
    far = np.abs(left).max(axis=1)
    [beyond] = np.nonzero(far > OUTLIER)
    around = (beyond[:, None] + np.arange(-2, 3)).clip(0, len(left) - 1)
    far[beyond] = np.abs(left[beyond] - np.median(left[around], axis=1)).max(axis=1)
    return far


def rounded(samples: Samples, first: Solution) -> bool:
    """Whether a spline explains samples to their rounding, or needs all breaks there are though they look smooth.

    Most places tell: a kink in exact samples is not noise.
    """
    sigma = np.sqrt(first.energy / len(samples.t))
    exact = sigma < ROUNDING * np.finfo(float).eps * np.abs(samples.q).max(axis=0)
    if exact.all() or samples.steps.any() or first.intervals < MANY * most_intervals(samples.rows(CELLS)):
        return bool(exact.all())
    return bool((local_noise(samples.q) < SMOOTH * np.ptp(samples.q, axis=0)).all())
