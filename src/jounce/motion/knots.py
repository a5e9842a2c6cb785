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
# Samples, from which on some parts of a log determine how many intervals it needs.
MIN_LONG_LOG = 20 * least_squares.MIN_CELLS
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
    """The chosen spline, and a coarser one that shows its error."""

    solution: SplineSolution
    coarser: SplineSolution  # of fewer intervals: their difference bounds the spline's own error
    variance: np.ndarray  # (n,), of white noise that would be fitted as well as the samples' noise
    places: tuple[np.ndarray, np.ndarray]  # the breaks asked for, of both; the samples may bear fewer

    @property
    def ratio(self) -> float:
        """The ratio of the numbers of intervals."""
        return max(self.solution.intervals / self.coarser.intervals, 1.01)


def fit_even_breaks(samples: Samples) -> tuple[SplineSolution, int]:
    """Return the evenly spaced spline of least BIC.

    The number of cells to which samples may be compressed for it comes with it.
    """
    if len(samples.t) < MIN_LONG_LOG:
        return select_by_bic(samples.rows(least_squares.MIN_CELLS), samples.floor), least_squares.MIN_CELLS
    # To try all numbers of intervals on a long log takes long. Parts of it determine how many intervals they need, and
    # the whole log is tried near their mean only.
    starts = np.linspace(0, len(samples.t) - PROBE_SAMPLES, PROBES_OF_LOG).astype(int)
    parts = [samples.part(np.arange(start, start + PROBE_SAMPLES)) for start in starts]
    needed = [
        select_by_bic(least_squares.make_rows(p.t, p.q, p.weight, (p.t[0], p.t[-1])), samples.floor).intervals
        for p in parts
    ]
    guess = int(np.mean(needed)) * len(samples.t) // PROBE_SAMPLES
    # Four cells per interval leave a choice of breaks, which lie at edges of cells alone.
    cells = max(least_squares.MIN_CELLS, 4 * guess)
    return select_by_bic(samples.rows(cells), samples.floor, guess), cells


def refit_choice(rows: SplineRows, beats: Beats, choice: KnotChoice) -> KnotChoice:
    """Return the same choice of breaks for samples at corrected times.

    The variance is that of the new samples about the spline.
    """
    solution, coarser = (fit_breaks(rows, places) for places in choice.places)
    return KnotChoice(solution, coarser, estimate_noise_variance(rows, beats, solution.breaks), choice.places)


def densify(rows: SplineRows, choice: KnotChoice, parts: Sequence[DensePart]) -> KnotChoice:
    """Return the choice with intervals that are no longer than wanted.

    Each part of the time has a start, an end and a longest interval.
    """
    if len(parts) == 0:
        return choice
    # The coarser spline keeps its ratio to the other in these parts too, since its comparison relies on that.
    fine = _split_intervals(choice.places[0], parts)
    coarse = _split_intervals(choice.places[1], [(start, end, longest * choice.ratio) for start, end, longest in parts])
    return KnotChoice(fit_breaks(rows, fine), fit_breaks(rows, coarse), choice.variance, (fine, coarse))


def _split_intervals(breaks: np.ndarray, dense_parts: Sequence[DensePart]) -> np.ndarray:
    """Return breaks with the intervals within dense parts divided evenly."""
    for start, end, longest in dense_parts:
        # A part begins and ends at a break: those that lie nearer than half an interval give way to it.
        interior = breaks[1:-1]
        is_near = np.minimum(np.abs(interior - start), np.abs(interior - end)) < longest / 2
        bounds = [x for x in (start, end) if breaks[0] + longest / 2 < x < breaks[-1] - longest / 2]
        breaks = np.unique(np.concatenate([breaks[:1], interior[~is_near], bounds, breaks[-1:]]))
        # Intervals within the part are cut into as few equal pieces as are short enough.
        middles, lengths = (breaks[1:] + breaks[:-1]) / 2, np.diff(breaks)
        pieces = np.where((middles > start) & (middles < end), np.ceil(lengths / longest - 1e-6), 1).astype(int)
        parts = (np.linspace(a, b, n, endpoint=False) for a, b, n in zip(breaks, breaks[1:], pieces, strict=False))
        breaks = np.concatenate([*parts, breaks[-1:]])
    return breaks


def select_by_bic(rows: SplineRows, floor: np.ndarray, guess: int | None = None) -> SplineSolution:
    """Return the spline with the evenly spaced breaks of least BIC.

    Numbers of intervals near a guess are tried, or all that the samples bear. Variances below the floor (n,) are
    rounding. With s the sum of squares of one of n joints, N samples and m coefficients, BIC is the sum over
    joints of N ln(s / N) + m ln N.
    """
    most = max_intervals(rows)
    low, high = (1, most) if guess is None else (max(1, min(most, guess // 2)), min(most, 2 * guess))
    # Numbers grow by a factor of at most 1.4 from one to the next: this first choice is refined afterwards.
    steps = max(2, int(np.ceil(np.log(high / low) / np.log(1.4))) + 1) if high > low else 1
    ladder = np.unique(np.round(np.geomspace(low, high, steps)).astype(int)).tolist()
    fits = [fit_breaks(rows, even_breaks(rows)(number)) for number in ladder]
    penalty = rows.y.shape[1] * np.log(rows.count)
    scores = [rows.count * np.log(np.maximum(s.energy / rows.count, floor)).sum() + penalty * s.unknowns for s in fits]
    return fits[int(np.argmin(scores))]


def select_knots(rows: SplineRows, beats: Beats, intervals: int, floor: np.ndarray) -> KnotChoice:
    """Return the choice of breaks of least estimated error.

    The search starts from a number of intervals. `floor` (n,) is the variance of rounding, below which noise is
    not sought.
    """
    # Even breaks first. The variance of noise comes from twice as many as the start: they leave no motion behind.
    evenly = even_breaks(rows)
    variance = np.maximum(floor, estimate_noise_variance(rows, beats, evenly(_intervals_for_noise(rows, intervals))))
    best, _ = _minimize_cp(rows, beats, evenly, intervals, variance)
    family = evenly
    # Breaks as dense as bisections place them are tried where the motion needs more in some places than in others.
    # Of few intervals there are no coarser ones to start from.
    if best.intervals > 16 and _is_uneven(rows, beats, best, variance):
        # One start suffices for a long log: its parts are many starts in themselves, and each takes time.
        powers = START_POWERS if rows.edges is None else START_POWERS[-1:]
        starts = [max(1, int(best.intervals / 2.0**power)) for power in powers if best.intervals > 4 * 2.0**power]
        dense, middle = average_density(_bisect_from_starts(rows, beats, starts, variance))
        # Such breaks may follow motion that even ones left as noise: the variance is estimated once more, and both
        # families are compared at the same one.
        finer = np.maximum(floor, estimate_noise_variance(rows, beats, dense(int(1.5 * middle) + 1)))
        other, other_score = _minimize_cp(rows, beats, dense, middle, finer)
        if other_score < mallows_cp(best, beats, finer):
            best, family, variance = other, dense, finer
    # Derivatives need more breaks than q does: the spline has some more than the best number, and the best one is the
    # coarser spline that it is compared with.
    places = family(round(INTERVALS_FOR_RATES * best.intervals) + 1), family(best.intervals)
    return KnotChoice(fit_breaks(rows, places[0]), best, variance, places)


def select_by_bandwidth(rows: SplineRows, beats: Beats, intervals: int, floor: np.ndarray) -> KnotChoice:
    """Return the choice of even intervals that a stated band needs.

    Intervals are bisected only where the samples leave that band much more than usual.
    """
    solution = fit_breaks(rows, even_breaks(rows)(intervals))
    variance = np.maximum(
        floor, estimate_noise_variance(rows, beats, even_breaks(rows)(_intervals_for_noise(rows, intervals)))
    )
    # Each round bisects transients: intervals that gain many times what is usual, the band being what was asked for.
    usual = None
    for _ in range(MAX_BISECTION_ROUNDS):
        # The usual gain per time is the median of the first round, since a band may leave motion everywhere. It is no
        # less than noise gains.
        explained = bisection_gains(rows, solution)
        breaks, gain = solution.breaks, explained / np.diff(solution.breaks)[:, None]
        if usual is None:
            usual = np.maximum(np.median(gain, axis=0), variance / np.diff(breaks).mean())
        # Gains that noise may make, and intervals within few steps of an encoder, are not worth a bisection.
        worth = (gain / usual).max(axis=1)
        worth[gains_over_noise(explained, beats, breaks, variance) < gain_threshold(len(variance))] = 0
        worth[beats.passes(breaks) < MIN_STEPS_TO_BISECT] = 0
        finer = bisect_largest_gains(rows, breaks, worth, MIN_TRANSIENT_GAIN)
        if len(finer) == len(breaks):
            break
        solution = fit_breaks(rows, finer)
    breaks = solution.breaks
    # The coarser spline has every second break, and the last one always.
    coarse = np.unique(np.append(breaks[::2], breaks[-1]))
    # What the band leaves counts as noise: deviations have to hold it.
    variance = np.maximum(variance, solution.energy / max(1.0, rows.count - solution.unknowns))
    return KnotChoice(solution, fit_breaks(rows, coarse), variance, (breaks, coarse))


def _intervals_for_noise(rows: SplineRows, intervals: int) -> int:
    """Return a number of intervals whose residuals show the noise.

    They leave no motion in the residual, and samples enough to estimate a variance.
    """
    return max(1, min(2 * intervals, max_intervals(rows) // 2))


def mallows_cp(solution: SplineSolution, beats: Beats, variance: np.ndarray) -> float:
    """Return Mallows' Cp, the estimated squared error, over all joints.

    It is |r|^2 / sigma^2 + 2 m per joint with m coefficients, up to a constant. Where rounding beats, a
    coefficient takes more of the errors with it, and costs more.
    """
    penalty = 2 * solution.unknowns * beats.inflation(solution.breaks).mean(axis=0)
    return float((solution.energy / variance + penalty).sum())


def _bisect_from_starts(
    rows: SplineRows, beats: Beats, starts: Sequence[int], variance: np.ndarray
) -> list[np.ndarray]:
    """Return the breaks of bisections from several starts.

    Bisections that ended with something unresolved are left out.
    """
    fits = [bisect_intervals(rows, beats, start, variance) for start in starts]
    scores = [mallows_cp(s, beats, variance) for s in fits]
    # Half of the penalty of the best one's coefficients is how much worse a result may be that still counts.
    enough = min(scores) + fits[int(np.argmin(scores))].unknowns * len(variance)
    return [s.breaks for s, score in zip(fits, scores, strict=True) if score <= enough]


def _minimize_cp(
    rows: SplineRows, beats: Beats, family: BreakFamily, middle: int, variance: np.ndarray
) -> tuple[SplineSolution, float]:
    """Return the spline of least Cp in a family, and its Cp.

    The family is one of breaks. The search goes by steps from a number `middle` of intervals.
    """
    most = max_intervals(rows)
    fits: dict[int, SplineSolution] = {}
    scores: dict[int, float] = {}

    def score(intervals: float) -> float:
        number = round(min(max(intervals, 1), most))
        if number not in scores:
            fits[number] = fit_breaks(rows, family(number))
            scores[number] = mallows_cp(fits[number], beats, variance)
        return scores[number]

    # Up and down from the best number so far, in wide steps and then in narrow ones.
    for ratio in INTERVAL_RATIOS if rows.edges is None else INTERVAL_RATIOS[:1]:
        start = middle if len(scores) == 0 else min(scores, key=scores.__getitem__)
        for step in (ratio, 1 / ratio):
            # Cp is not convex in the number, since breaks fall differently: one worse number does not end the way.
            best, worse, intervals = score(start), 0, float(start)
            while worse < 2 and 1 <= intervals <= most:
                intervals *= step
                if score(intervals) < best:
                    best, worse = score(intervals), 0
                else:
                    worse += 1
    least = min(scores, key=scores.__getitem__)
    return fits[least], scores[least]


def _is_uneven(rows: SplineRows, beats: Beats, solution: SplineSolution, variance: np.ndarray) -> bool:
    """Return whether a motion needs denser breaks in some places.

    Even intervals are too long for the motion in some of them, or slightly longer ones would do in many.
    """
    enough = gain_threshold(len(variance))

    def gains(present: SplineSolution) -> np.ndarray:
        return gains_over_noise(bisection_gains(rows, present), beats, present.breaks, variance)

    # Too long: to bisect some interval explains far more than noise does.
    if gains(solution).max() > 3 * enough:
        return True
    # Too short: to bisect intervals 1.4 times as long would explain no more than noise in many of them.
    longer = fit_breaks(rows, even_breaks(rows)(max(1, int(solution.intervals / 1.4))))
    return bool((gains(longer) < enough).mean() > 0.3)


# Families of breaks, and bisection.
def even_breaks(rows: SplineRows) -> BreakFamily:
    """Return the family of evenly spaced breaks."""
    return lambda intervals: np.linspace(*rows.span, intervals + 1)


def average_density(trees: Sequence[np.ndarray]) -> tuple[BreakFamily, int]:
    """Return the family of breaks that lie as densely as several bisections.

    Densities are averaged geometrically. The number of intervals of that density comes with the family.
    """
    # Between any two neighbours of all breaks each bisection has one length of interval.
    grid = np.unique(np.concatenate(trees))
    middles = (grid[1:] + grid[:-1]) / 2
    lengths = [np.diff(breaks)[np.searchsorted(breaks, middles) - 1] for breaks in trees]
    # The intervals passed up to each time, the integral of the density: breaks of the family divide it evenly.
    total = np.append(0, np.cumsum(np.diff(grid) / np.exp(np.mean(np.log(lengths), axis=0))))

    def family(intervals: int) -> np.ndarray:
        return np.interp(np.linspace(0, total[-1], intervals + 1), total, grid)

    return family, max(1, round(total[-1]))


def bisect_intervals(rows: SplineRows, beats: Beats, start: int, variance: np.ndarray) -> SplineSolution:
    """Return the spline of even intervals, bisected while that beats noise."""
    solution = fit_breaks(rows, even_breaks(rows)(start))
    for _ in range(MAX_BISECTION_ROUNDS):
        # Within few steps of an encoder a bisection would explain the steps, and not the motion.
        gain = gains_over_noise(bisection_gains(rows, solution), beats, solution.breaks, variance)
        gain[beats.passes(solution.breaks) < MIN_STEPS_TO_BISECT] = 0
        finer = bisect_largest_gains(rows, solution.breaks, gain, gain_threshold(len(variance)))
        if len(finer) == len(solution.breaks):
            break
        solution = fit_breaks(rows, finer)
    return solution


def bisect_largest_gains(rows: SplineRows, breaks: np.ndarray, gain: np.ndarray, threshold: float) -> np.ndarray:
    """Return breaks with the intervals bisected that gain most.

    Their gain passes a threshold and is much of the largest gain around them.
    """
    # An unresolved place rings into its neighbourhood: intervals whose rivals nearby gain much more wait a round.
    around = np.lib.stride_tricks.sliding_window_view(np.pad(gain, RINGING_INTERVALS), 2 * RINGING_INTERVALS + 1)
    chosen = np.flatnonzero((gain > threshold) & (gain >= MIN_GAIN_TO_RIVALS * around.max(axis=1)))
    if chosen.size == 0:
        return breaks
    return drop_sparse_breaks(rows, halve_intervals(breaks, chosen))


def halve_intervals(breaks: np.ndarray, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
    """Return breaks with chosen intervals bisected, by default all."""
    return np.sort(np.append(breaks, ((breaks[1:] + breaks[:-1]) / 2)[chosen]))


def bisection_gains(rows: SplineRows, solution: SplineSolution) -> np.ndarray:
    """Return the squares (M, n) that bisection of each interval explains."""
    # All intervals are bisected at once: one fit shows what each of them gains.
    return joint_gains(rows, solution, fit_breaks(rows, halve_intervals(solution.breaks)))


def gains_over_noise(gain: np.ndarray, beats: Beats, breaks: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return gains over those expected of noise, summed over joints, (M,).

    Gains (M, n) are squares that are explained, by interval and joint.
    """
    return np.asarray((gain / (variance * beats.inflation(breaks, cycles=2))).sum(axis=1))


def joint_gains(rows: SplineRows, solution: SplineSolution, finer: SplineSolution) -> np.ndarray:
    """Return the squares (M, n) that finer breaks explain in each interval."""
    lost = solution.residual**2 - finer.residual**2
    # Sums over the rows of each interval are differences of cumulative sums at its ends.
    sums = np.concatenate([np.zeros((1, lost.shape[1])), np.cumsum(lost, axis=0)])
    return np.diff(sums[np.searchsorted(rows.t, solution.breaks[:-1])], axis=0, append=sums[-1:])


def median_length(breaks: np.ndarray) -> float:
    """Return the length of interval that the middle of the time has.

    Intervals are sorted by length: half of the time is in shorter intervals.
    """
    lengths = np.sort(np.diff(breaks))
    return float(lengths[np.searchsorted(np.cumsum(lengths), lengths.sum() / 2)])


def gain_threshold(joints: int) -> float:
    """Return a gain that noise passes once in some hundred intervals.

    In units of noise, gains are chi^2 with a degree of freedom per joint: n on average, with the deviation
    sqrt(2 n).
    """
    return float(2 * joints + 3 * np.sqrt(2 * joints))


def estimate_noise_variance(rows: SplineRows, beats: Beats, breaks: np.ndarray) -> np.ndarray:
    """Return the variance per joint of noise like the samples'.

    White noise of that variance would be fitted as well as what is in the samples. The breaks leave no motion in the
    residual: three more in each interval explain three variances, in the median over intervals and joints. How many
    times as much they explain multiplies the variances of the residual.
    """
    coarse = fit_breaks(rows, breaks)
    fine = fit_breaks(rows, halve_intervals(halve_intervals(coarse.breaks)))
    # The residual of the finest breaks, over its degrees of freedom.
    variance = np.maximum(fine.energy / max(1.0, rows.count - fine.unknowns), np.finfo(float).tiny)
    more = np.diff(np.searchsorted(fine.breaks, coarse.breaks))[:, None] - 1
    # Intervals count in which all three breaks were possible, and rounding does not beat.
    usual = (beats.inflation(coarse.breaks) < 2) & (more == 3)
    gain = joint_gains(rows, coarse, fine) / variance
    # Noise that is not white has more power at low frequencies, which breaks follow: the gain shows it.
    if not usual.any():
        return variance
    return variance * max(1.0, np.median(gain[usual]) / MEDIAN_OF_CHI2_3)


def fit_breaks(rows: SplineRows, breaks: np.ndarray) -> SplineSolution:
    """Return the spline with those of the breaks that the samples bear."""
    return least_squares.solve_equations(rows, *determine_breaks(rows, breaks))


def determine_breaks(rows: SplineRows, breaks: np.ndarray) -> tuple[np.ndarray, SplineEquations]:
    """Return the breaks that the samples bear, and their equations.

    Two samples in each interval may lie at its rim alone, at a hole, and hardly determine a coefficient: intervals
    need twice as many samples, again and again, as long as the equations are singular. `LinAlgError` if those of a
    single interval are.
    """
    least = MIN_SAMPLES_PER_INTERVAL
    while True:
        sufficient = drop_sparse_breaks(rows, breaks, least)
        try:
            return sufficient, least_squares.make_equations(rows, sufficient)
        except np.linalg.LinAlgError:
            # A single interval has no break to drop.
            if len(sufficient) == 2:
                raise
        least *= 2


def drop_sparse_breaks(rows: SplineRows, breaks: np.ndarray, least: int = MIN_SAMPLES_PER_INTERVAL) -> np.ndarray:
    """Return breaks without those that leave too few samples in an interval.

    Above all these are breaks in gaps.
    """
    breaks = rows.snap(breaks)
    # How many samples lie before each break; the last interval includes its end.
    before = np.searchsorted(rows.t, breaks)
    before[0], before[-1] = 0, len(rows.t)
    if (np.diff(before) >= least).all():
        return breaks
    # From the first on, a break stays if enough samples lie behind the last one that stays, and before the end.
    places = [0]
    for k in range(1, len(breaks) - 1):
        if before[k] - before[places[-1]] >= least and before[-1] - before[k] >= least:
            places.append(k)
    return breaks[[*places, len(breaks) - 1]]


def max_intervals(rows: SplineRows) -> int:
    """Return the largest number of intervals that the samples bear."""
    if rows.edges is None:
        return max(1, len(rows.t) // MIN_MEAN_SAMPLES - least_squares.FIT_DEGREE)
    # Of compressed rows each interval takes two cells or more, so that breaks may still be moved.
    return max(1, len(rows.edges) // 2)
