"""Choose the breaks of a smoothing spline: as many as samples bear, where motions need them.

Problem: the breaks of the spline whose squared error about the motion, summed over joints in units of their noise, is
least. Breaks come from families with one number, their intervals, so that the search is one of whole numbers.

1. Evenly spaced breaks by Schwarz' criterion (BIC, Annals of Statistics 6, 1978), which is hardest to mislead by noise
   that is not white (`select_by_bic`); of a long log by some of its parts (`fit_even_breaks`).
2. Their number by Mallows' Cp (Technometrics 15, 1973), which estimates the squared error itself, near the first one
   (`select_knots`).
3. Where the motion is uneven: bisections from several starts determine how densely breaks lie, Cp their number. They
   replace even breaks only if their Cp is less, at the same variance of noise.

`select_by_bandwidth` takes a stated band in place of 2 and 3. The variance comes from denser breaks
(`estimate_noise_variance`), and counts for more where rounding beats (`Beats.inflation`). Noise that is slower than an
interval is taken for motion.

Bisection (`bisect_intervals`) seeks breaks with no interval whose bisection would explain more of the samples than
noise does. Intervals are bisected in rounds, those first that gain most (bulk chasing: Doerfler, SIAM Journal on
Numerical Analysis 33, 1996): an unresolved place rings far into its neighbourhood, and bisecting all that rings would
leave breaks there for ever. Breaks only get denser, and every interval keeps two samples, so that bisection ends. It
stops too early where a feature explains nothing until it is bisected several times: hence several starts, and
`jounce.motion.vibrations` looks for what they miss.

`fit_breaks` runs for each number of intervals and each round: the least-squares spline of those breaks that the samples
bear.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jounce.motion import least_squares
from jounce.motion.least_squares import Samples, SplineEquations, SplineRows, SplineSolution
from jounce.motion.noise import Beats

INTERVALS_FOR_RATES = 1.1  # times those that suit q best: its derivatives need more, against their bias
START_POWERS = (4, 11 / 3, 10 / 3, 4 / 3)  # of two, by which bisections start coarser than the best even intervals
INTERVAL_RATIOS = 1.15, 1.05  # of the numbers of intervals that are tried; the first suffices for a long log
MIN_TRANSIENT_GAIN = 30  # times the usual squares above a given band: such intervals are bisected all the same
MIN_LONG_LOG = (
    20 * least_squares.MIN_CELLS
)  # samples, from which on parts of them determine how many intervals they need
PROBES_OF_LOG = 6  # parts of a long log, evenly spread
PROBE_SAMPLES = 4096  # in each of them
MAX_BISECTION_ROUNDS = 60  # a safeguard: bisection ends by itself where no interval gains
RINGING_INTERVALS = 8  # on either side, to which an unresolved place rings
MIN_GAIN_TO_RIVALS = 0.3  # share of their gains: intervals that gain less wait for the next round
MIN_STEPS_TO_BISECT = 8  # of an encoder, passed by some joint in an interval: fewer resolve no more
MIN_SAMPLES_PER_INTERVAL = 2  # fewer, as in gaps, hardly determine the coefficients there
MIN_MEAN_SAMPLES = 3  # per interval on average: fewer leave hardly a residual that shows the noise
MEDIAN_OF_CHI2_3 = 2.366  # of chi^2 with three degrees of freedom
DensePart = tuple[float, float, float]  # start, end, longest interval
BreakFamily = Callable[[int], np.ndarray]  # breaks, for a number of intervals


@dataclass(frozen=True, eq=False)
class KnotChoice:
    """The spline chosen."""

    solution: SplineSolution
    coarser: SplineSolution  # to compare with
    variance: np.ndarray  # (n,), of white noise like that found
    places: tuple[np.ndarray, np.ndarray]  # where the breaks of the two were to be

    @property
    def ratio(self) -> float:
        """How many times fewer intervals the coarser one has."""
        return max(self.solution.intervals / self.coarser.intervals, 1.01)


def fit_even_breaks(samples: Samples) -> tuple[SplineSolution, int]:
    """The evenly spaced spline of least BIC, and the number of cells to which samples may be compressed for it."""
    if len(samples.t) < MIN_LONG_LOG:
        return select_by_bic(samples.rows(least_squares.MIN_CELLS), samples.floor), least_squares.MIN_CELLS
    starts = np.linspace(0, len(samples.t) - PROBE_SAMPLES, PROBES_OF_LOG).astype(int)
    parts = [samples.part(np.arange(start, start + PROBE_SAMPLES)) for start in starts]
    needed = [
        select_by_bic(least_squares.make_rows(p.t, p.q, p.weight, (p.t[0], p.t[-1])), samples.floor).intervals
        for p in parts
    ]
    guess = int(np.mean(needed)) * len(samples.t) // PROBE_SAMPLES
    cells = max(least_squares.MIN_CELLS, 4 * guess)
    return select_by_bic(samples.rows(cells), samples.floor, guess), cells


def refit_choice(rows: SplineRows, beats: Beats, choice: KnotChoice) -> KnotChoice:
    """The same breaks for samples that are not quite the same, and what these scatter by about the spline."""
    solution, coarser = (fit_breaks(rows, places) for places in choice.places)
    return KnotChoice(solution, coarser, estimate_noise_variance(rows, beats, solution.breaks), choice.places)


def densify(rows: SplineRows, choice: KnotChoice, parts: Sequence[DensePart]) -> KnotChoice:
    """The choice with no longer intervals than is said, in parts of the time: starts, ends and lengths."""
    if not parts:
        return choice
    fine = _split_intervals(choice.places[0], parts)
    coarse = _split_intervals(choice.places[1], [(start, end, longest * choice.ratio) for start, end, longest in parts])
    return KnotChoice(fit_breaks(rows, fine), fit_breaks(rows, coarse), choice.variance, (fine, coarse))


def _split_intervals(breaks: np.ndarray, longest_in: Sequence[DensePart]) -> np.ndarray:
    for start, end, longest in longest_in:
        inner = breaks[1:-1]  # those that a part begins or ends at move there
        near = np.minimum(np.abs(inner - start), np.abs(inner - end)) < longest / 2
        bounds = [x for x in (start, end) if breaks[0] + longest / 2 < x < breaks[-1] - longest / 2]
        breaks = np.unique(np.concatenate([breaks[:1], inner[~near], bounds, breaks[-1:]]))
        middles, lengths = (breaks[1:] + breaks[:-1]) / 2, np.diff(breaks)
        pieces = np.where((middles > start) & (middles < end), np.ceil(lengths / longest - 1e-6), 1).astype(int)
        parts = (np.linspace(a, b, n, endpoint=False) for a, b, n in zip(breaks, breaks[1:], pieces, strict=False))
        breaks = np.concatenate([*parts, breaks[-1:]])
    return breaks


def select_by_bic(rows: SplineRows, floor: np.ndarray, guess: int | None = None) -> SplineSolution:
    """The evenly spaced breaks of least BIC, near a guess; variances below the floor (n,) are rounding."""
    most = max_intervals(rows)
    low, high = (1, most) if guess is None else (max(1, min(most, guess // 2)), min(most, 2 * guess))
    steps = max(2, int(np.ceil(np.log(high / low) / np.log(1.4))) + 1) if high > low else 1
    ladder = np.unique(np.round(np.geomspace(low, high, steps)).astype(int)).tolist()
    found = [fit_breaks(rows, even_breaks(rows)(number)) for number in ladder]
    penalty = rows.y.shape[1] * np.log(rows.count)
    scores = [rows.count * np.log(np.maximum(s.energy / rows.count, floor)).sum() + penalty * s.unknowns for s in found]
    return found[int(np.argmin(scores))]


def select_knots(rows: SplineRows, beats: Beats, intervals: int, floor: np.ndarray) -> KnotChoice:
    """The spline of least estimated error, from a first number of intervals; `floor` (n,) is a variance of rounding."""
    evenly = even_breaks(rows)
    variance = np.maximum(floor, estimate_noise_variance(rows, beats, evenly(_intervals_for_noise(rows, intervals))))
    best, _ = _minimize_cp(rows, beats, evenly, intervals, variance)
    family = evenly
    if best.intervals > 16 and _is_uneven(rows, beats, best, variance):
        # a long log has starts enough in itself, and less time
        powers = START_POWERS if rows.edges is None else START_POWERS[-1:]
        starts = [max(1, int(best.intervals / 2.0**power)) for power in powers if best.intervals > 4 * 2.0**power]
        dense, middle = average_density(_bisect_from_starts(rows, beats, starts, variance))
        finer = np.maximum(floor, estimate_noise_variance(rows, beats, dense(int(1.5 * middle) + 1)))
        other, other_score = _minimize_cp(rows, beats, dense, middle, finer)
        if other_score < mallows_cp(best, beats, finer):
            best, family, variance = other, dense, finer
    places = family(round(INTERVALS_FOR_RATES * best.intervals) + 1), family(best.intervals)
    return KnotChoice(fit_breaks(rows, places[0]), best, variance, places)


def select_by_bandwidth(rows: SplineRows, beats: Beats, intervals: int, floor: np.ndarray) -> KnotChoice:
    """Even intervals as a band wants them, bisected only where the samples leave that band much more than usual."""
    solution = fit_breaks(rows, even_breaks(rows)(intervals))
    variance = np.maximum(
        floor, estimate_noise_variance(rows, beats, even_breaks(rows)(_intervals_for_noise(rows, intervals)))
    )
    usual = None
    for _ in range(MAX_BISECTION_ROUNDS):
        # the gains over their median in the first round, or over noise: of what a band leaves everywhere, that is usual
        explained = bisection_gains(rows, solution)
        breaks, gain = solution.breaks, explained / np.diff(solution.breaks)[:, None]
        usual = np.maximum(np.median(gain, axis=0), variance / np.diff(breaks).mean()) if usual is None else usual
        # worth a bisection: transients, that are no noise and no steps of an encoder
        worth = (gain / usual).max(axis=1)
        worth[gains_over_noise(explained, beats, breaks, variance) < gain_threshold(len(variance))] = 0
        worth[beats.passes(breaks) < MIN_STEPS_TO_BISECT] = 0
        finer = bisect_largest_gains(rows, breaks, worth, MIN_TRANSIENT_GAIN)
        if len(finer) == len(breaks):
            break
        solution = fit_breaks(rows, finer)
    breaks = solution.breaks
    coarse = np.unique(np.append(breaks[::2], breaks[-1]))
    variance = np.maximum(variance, solution.energy / max(1.0, rows.count - solution.unknowns))
    return KnotChoice(solution, fit_breaks(rows, coarse), variance, (breaks, coarse))


def _intervals_for_noise(rows: SplineRows, intervals: int) -> int:
    """How many intervals leave no motion in the residual, and samples enough to show the noise."""
    return max(1, min(2 * intervals, max_intervals(rows) // 2))


def mallows_cp(solution: SplineSolution, beats: Beats, variance: np.ndarray) -> float:
    """Mallows' Cp over all joints: the estimated squared error over the variance, up to a constant."""
    penalty = 2 * solution.unknowns * beats.inflation(solution.breaks).mean(axis=0)
    return float((solution.energy / variance + penalty).sum())


def _bisect_from_starts(
    rows: SplineRows, beats: Beats, starts: Sequence[int], variance: np.ndarray
) -> list[np.ndarray]:
    """Bisections from several starts, without those that ended with something unresolved."""
    found = [bisect_intervals(rows, beats, start, variance) for start in starts]
    scores = [mallows_cp(s, beats, variance) for s in found]
    good = min(scores) + found[int(np.argmin(scores))].unknowns * len(variance)
    return [s.breaks for s, score in zip(found, scores, strict=True) if score <= good]


def _minimize_cp(
    rows: SplineRows, beats: Beats, family: BreakFamily, middle: int, variance: np.ndarray
) -> tuple[SplineSolution, float]:
    """The number of intervals of least Cp, by steps from a first one, which end two steps after the best."""
    most = max_intervals(rows)
    found: dict[int, SplineSolution] = {}
    scores: dict[int, float] = {}

    def score(intervals: float) -> float:
        number = round(min(max(intervals, 1), most))
        if number not in scores:
            found[number] = fit_breaks(rows, family(number))
            scores[number] = mallows_cp(found[number], beats, variance)
        return scores[number]

    # up and down from the best so far, in wide steps and then in narrow ones, until two in a row are no better
    for ratio in INTERVAL_RATIOS if rows.edges is None else INTERVAL_RATIOS[:1]:
        start = min(scores, key=scores.__getitem__) if scores else middle
        for step in (ratio, 1 / ratio):
            best, worse, at = score(start), 0, float(start)
            while worse < 2 and 1 <= at <= most:
                at *= step
                best, worse = (score(at), 0) if score(at) < best else (best, worse + 1)
    least = min(scores, key=scores.__getitem__)
    return found[least], scores[least]


def _is_uneven(rows: SplineRows, beats: Beats, solution: SplineSolution, variance: np.ndarray) -> bool:
    """Whether even intervals are too long for the motion in some of them, or a bit longer ones would do in many."""
    enough = gain_threshold(len(variance))

    def gains(present: SplineSolution) -> np.ndarray:
        return gains_over_noise(bisection_gains(rows, present), beats, present.breaks, variance)

    if gains(solution).max() > 3 * enough:
        return True
    longer = fit_breaks(rows, even_breaks(rows)(max(1, int(solution.intervals / 1.4))))
    return bool((gains(longer) < enough).mean() > 0.3)


# Families of breaks, and bisection.
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
    return least_squares.solve_equations(rows, *determine_breaks(rows, breaks))


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
            return kept, least_squares.make_equations(rows, kept)
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
