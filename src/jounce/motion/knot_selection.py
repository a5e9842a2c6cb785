"""The choice of a smoothing spline: as many breaks as the samples distinguish from noise, where the motion needs them.

Problem: the breaks of the spline whose squared error about the motion, summed over joints in units of their noise, is
least. Breaks come from families with one number, their intervals, so that the search is one of whole numbers.

1. Evenly spaced breaks by Schwarz' criterion (BIC, Annals of Statistics 6, 1978), which is hardest to mislead by noise
   that is not white (`select_by_bic`).
2. Their number by Mallows' Cp (Technometrics 15, 1973), which estimates the squared error itself, near the first one.
3. Where the motion is uneven: bisections from several starts determine how densely breaks lie, Cp their number. They
   replace even breaks only if their Cp is less, at the same variance of noise.

The variance comes from denser breaks (`estimate_noise_variance`), and counts for more where rounding beats
(`Beats.inflation`). Noise that is slower than an interval is taken for motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.motion import knots
from jounce.motion.knots import (
    BreakFamily,
    bisection_gains,
    estimate_noise_variance,
    even_breaks,
    fit_breaks,
    gain_threshold,
    gains_over_noise,
    max_intervals,
)
from jounce.motion.least_squares import SplineRows, SplineSolution
from jounce.motion.noise import Beats

DensePart = tuple[float, float, float]  # start, end, longest interval

INTERVALS_FOR_RATES = 1.1  # times those that suit q best: its derivatives need more, against their bias
START_POWERS = (4, 11 / 3, 10 / 3, 4 / 3)  # of two, by which bisections start coarser than the best even intervals
INTERVAL_RATIOS = 1.15, 1.05  # of the numbers of intervals that are tried; the first suffices for a long log
MIN_TRANSIENT_GAIN = 30  # times the usual squares above a given band: such intervals are bisected all the same


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
        dense, middle = knots.average_density(_bisect_from_starts(rows, beats, starts, variance))
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
    for _ in range(knots.MAX_BISECTION_ROUNDS):
        # the gains over their median in the first round, or over noise: of what a band leaves everywhere, that is usual
        explained = bisection_gains(rows, solution)
        breaks, gain = solution.breaks, explained / np.diff(solution.breaks)[:, None]
        usual = np.maximum(np.median(gain, axis=0), variance / np.diff(breaks).mean()) if usual is None else usual
        # worth a bisection: transients, that are no noise and no steps of an encoder
        worth = (gain / usual).max(axis=1)
        worth[gains_over_noise(explained, beats, breaks, variance) < gain_threshold(len(variance))] = 0
        worth[beats.passes(breaks) < knots.MIN_STEPS_TO_BISECT] = 0
        finer = knots.bisect_largest_gains(rows, breaks, worth, MIN_TRANSIENT_GAIN)
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
    found = [knots.bisect_intervals(rows, beats, start, variance) for start in starts]
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
