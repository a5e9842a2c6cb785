"""Breaks of splines: evenly spaced, where bisection puts them, as densely as a motion needs; and what they gain.

Problem: breaks with no interval whose bisection would explain more of the samples than noise does. Intervals are
bisected in rounds, those first that gain most (bulk chasing: Doerfler, SIAM Journal on Numerical Analysis 33, 1996): an
unresolved place rings far into its neighbourhood, and bisecting all that rings would leave breaks there for ever.

Breaks only get denser, and every interval keeps two samples, so that bisection ends. It stops too early where a feature
explains nothing until it is bisected several times: `jounce.motion.knot_selection` starts it from several numbers of
intervals, and `jounce.motion.bursts` looks for what it misses.
"""

from collections.abc import Callable, Sequence

import numpy as np

from jounce.motion.least_squares import SplineRows, SplineSolution, make_equations, solve_equations
from jounce.motion.noise import Beats
from jounce.motion.normal_equations import SplineEquations

BreakFamily = Callable[[int], np.ndarray]  # breaks, for a number of intervals

MAX_BISECTION_ROUNDS = 60  # a safeguard: bisection ends by itself where no interval gains
RINGING_INTERVALS = 8  # on either side, to which an unresolved place rings
MIN_GAIN_TO_RIVALS = 0.3  # share of their gains: intervals that gain less wait for the next round
MIN_STEPS_TO_BISECT = 8  # of an encoder, passed by some joint in an interval: fewer resolve no more
MIN_SAMPLES_PER_INTERVAL = 2  # fewer, as in gaps, hardly determine the coefficients there
MIN_MEAN_SAMPLES = 3  # per interval on average: fewer leave hardly a residual that shows the noise
MEDIAN_OF_CHI2_3 = 2.366  # of chi^2 with three degrees of freedom


def even_breaks(rows: SplineRows) -> BreakFamily:
    """Evenly spaced breaks."""
    return lambda intervals: np.linspace(*rows.span, intervals + 1)


def average_density(trees: Sequence[np.ndarray]) -> tuple[BreakFamily, int]:
    """Breaks as dense as those of several bisections on (geometric) average, and how many these have."""
    grid = np.unique(np.concatenate(trees))
    middles = (grid[1:] + grid[:-1]) / 2
    lengths = [np.diff(breaks)[np.searchsorted(breaks, middles) - 1] for breaks in trees]
    total = np.append(0, np.cumsum(np.diff(grid) / np.exp(np.mean(np.log(lengths), axis=0))))

    def family(intervals: int) -> np.ndarray:
        return np.interp(np.linspace(0, total[-1], intervals + 1), total, grid)

    return family, max(1, round(total[-1]))


def bisect_intervals(rows: SplineRows, beats: Beats, start: int, variance: np.ndarray) -> SplineSolution:
    """The spline with even intervals, bisected as long as that explains more than noise does."""
    solution = fit_breaks(rows, even_breaks(rows)(start))
    for _ in range(MAX_BISECTION_ROUNDS):
        # what bisection of each interval explains; of one within steps of an encoder it would explain the steps
        gain = gains_over_noise(bisection_gains(rows, solution), beats, solution.breaks, variance)
        gain[beats.passes(solution.breaks) < MIN_STEPS_TO_BISECT] = 0
        finer = bisect_largest_gains(rows, solution.breaks, gain, gain_threshold(len(variance)))
        if len(finer) == len(solution.breaks):
            break
        solution = fit_breaks(rows, finer)
    return solution


def bisect_largest_gains(rows: SplineRows, breaks: np.ndarray, gain: np.ndarray, threshold: float) -> np.ndarray:
    """Breaks with those intervals bisected whose gain passes a threshold and is much of the largest one around."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(gain, RINGING_INTERVALS), 2 * RINGING_INTERVALS + 1)
    chosen = np.flatnonzero((gain > threshold) & (gain >= MIN_GAIN_TO_RIVALS * around.max(axis=1)))
    if not chosen.size:
        return breaks
    return drop_sparse_breaks(rows, halve_intervals(breaks, chosen))


def halve_intervals(breaks: np.ndarray, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
    """Breaks with chosen intervals bisected, by default all."""
    return np.sort(np.append(breaks, ((breaks[1:] + breaks[:-1]) / 2)[chosen]))


def bisection_gains(rows: SplineRows, solution: SplineSolution) -> np.ndarray:
    """Squares, (M, n), that bisection of each interval explains."""
    return joint_gains(rows, solution, fit_breaks(rows, halve_intervals(solution.breaks)))


def gains_over_noise(gain: np.ndarray, beats: Beats, breaks: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """What squares (M, n) that are explained are of those expected of noise, summed over the joints, (M,)."""
    return np.asarray((gain / (variance * beats.inflation(breaks, cycles=2))).sum(axis=1))


def joint_gains(rows: SplineRows, solution: SplineSolution, finer: SplineSolution) -> np.ndarray:
    """Squares, (M, n), that a spline of finer breaks explains in each interval."""
    lost = solution.residual**2 - finer.residual**2
    sums = np.concatenate([np.zeros((1, lost.shape[1])), np.cumsum(lost, axis=0)])
    return np.diff(sums[np.searchsorted(rows.t, solution.breaks[:-1])], axis=0, append=sums[-1:])


def median_length(breaks: np.ndarray) -> float:
    """The length of the interval in the middle of the time, if intervals are sorted by length."""
    lengths = np.sort(np.diff(breaks))
    return float(lengths[np.searchsorted(np.cumsum(lengths), lengths.sum() / 2)])


def gain_threshold(joints: int) -> float:
    """More than noise explains in an interval (chi^2, a degree of freedom per joint) but once in some hundreds."""
    return float(2 * joints + 3 * np.sqrt(2 * joints))


def estimate_noise_variance(rows: SplineRows, beats: Beats, breaks: np.ndarray) -> np.ndarray:
    """The variance per joint of white noise that would be fitted as well as what is in the samples.

    From breaks that leave no motion in the residual: three more in each interval explain three variances, in the
    median over intervals and joints. How many times as much they explain multiplies the variances of the residual.
    """
    coarse = fit_breaks(rows, breaks)
    fine = fit_breaks(rows, halve_intervals(halve_intervals(coarse.breaks)))
    variance = np.maximum(fine.energy / max(1.0, rows.count - fine.unknowns), np.finfo(float).tiny)
    more = np.diff(np.searchsorted(fine.breaks, coarse.breaks))[:, None] - 1
    usual = (beats.inflation(coarse.breaks) < 2) & (more == 3)
    gain = joint_gains(rows, coarse, fine) / variance
    return variance * max(1.0, np.median(gain[usual]) / MEDIAN_OF_CHI2_3 if usual.any() else 1.0)


def fit_breaks(rows: SplineRows, breaks: np.ndarray) -> SplineSolution:
    """The spline with those of the breaks that the samples bear."""
    return solve_equations(rows, *determine_breaks(rows, breaks))


def determine_breaks(rows: SplineRows, breaks: np.ndarray) -> tuple[np.ndarray, SplineEquations]:
    """Those of the breaks that the samples bear, and the equations of their splines.

    Two samples in each interval may lie at its rim alone, at a hole, and hardly determine a coefficient: intervals
    need twice as many samples, again and again, as long as the equations are singular. `LinAlgError` if those of a
    single interval are.
    """
    least = MIN_SAMPLES_PER_INTERVAL
    while True:
        kept = drop_sparse_breaks(rows, breaks, least)
        try:
            return kept, make_equations(rows, kept)
        except np.linalg.LinAlgError:
            if len(kept) == 2:
                raise
        least *= 2


def drop_sparse_breaks(rows: SplineRows, breaks: np.ndarray, least: int = MIN_SAMPLES_PER_INTERVAL) -> np.ndarray:
    """Breaks without those that leave fewer than some samples in an interval, in gaps above all."""
    breaks = rows.snap(breaks)
    before = np.searchsorted(rows.t, breaks)
    before[0], before[-1] = 0, len(rows.t)
    if (np.diff(before) >= least).all():
        return breaks
    kept = [0]
    for k in range(1, len(breaks) - 1):
        if before[k] - before[kept[-1]] >= least and before[-1] - before[k] >= least:
            kept.append(k)
    return breaks[[*kept, len(breaks) - 1]]


def max_intervals(rows: SplineRows) -> int:
    """How many intervals the samples bear at most."""
    return max(1, len(rows.t) // MIN_MEAN_SAMPLES - 9 if rows.edges is None else len(rows.edges) // 2)
