"""From measured samples to a spline: what is noise, which rows count, which stamps are wrong, how many breaks."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jounce.errors import JounceError
from jounce.motion import knots, stamps
from jounce.motion.deviations import Spread
from jounce.motion.least_squares import CELLS, DEGREE, Rows, Solution, rows_of, solve
from jounce.motion.noise import Beats, beats_of, rest_weights

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

ROUNDING = 64  # units in the last place of a double, below which samples are no measured ones
OUTLIER = 6  # standard deviations
SEVERAL = 0.05  # share of the samples, from which on they are no outliers
LONG = 20 * CELLS  # samples, from which on parts of them tell how many intervals they need
PROBE = 4096  # samples of such a part


@dataclass(frozen=True, eq=False)
class Samples:
    """What is smoothed: times (N,), samples (N, n) of joints that move, their weights (N,), the span of the
    times, and the steps (n,) of encoders or digits."""

    t: np.ndarray
    q: np.ndarray
    weight: np.ndarray
    span: tuple[float, float]
    steps: np.ndarray

    @property
    def floor(self) -> np.ndarray:
        """The variance (n,) of rounding of doubles."""
        return np.maximum((4 * np.finfo(float).eps * np.abs(self.q).max(axis=0)) ** 2, np.finfo(float).tiny)

    def part(self, rows: np.ndarray) -> "Samples":
        """Some of the rows."""
        return replace(self, t=self.t[rows], q=self.q[rows], weight=self.weight[rows])


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A spline through or along samples, with what its deviations come from and what was noticed."""

    samples: Samples
    spline: "BSpline"
    spread: Spread
    sigma: np.ndarray
    notes: tuple[str, ...]


def first_fit(samples: Samples) -> tuple[Solution, int]:
    """The evenly spaced spline of least BIC, and to how many cells samples may be compressed for so many intervals."""
    cells, bounds = CELLS, (1, None)
    if len(samples.t) >= LONG:
        starts = np.linspace(0, len(samples.t) - PROBE, 6).astype(int)
        parts = [samples.part(np.arange(start, start + PROBE)) for start in starts]
        needed = [
            knots.by_schwarz(rows_of(p.t, p.q, p.weight, (p.t[0], p.t[-1])), samples.floor).intervals for p in parts
        ]
        guess = int(np.mean(needed)) * len(samples.t) // PROBE
        cells = max(cells, 4 * guess)
        bounds = max(1, guess // 4), 4 * guess
    rows = rows_of(samples.t, samples.q, samples.weight, samples.span, cells)
    return knots.by_schwarz(rows, samples.floor, bounds[0], bounds[1] and min(bounds[1], knots.most_intervals(rows))), cells


def moves(samples: Samples, first: Solution) -> np.ndarray:
    """Which joints, (n,), a spline explains better, by BIC, than a constant does."""
    count = len(samples.t)
    constant = np.maximum(samples.q.var(axis=0), samples.floor)
    spline = np.maximum(first.energy / count, samples.floor)
    return count * np.log(constant / spline) > (first.unknowns - 1) * np.log(count)


def smooth(samples: Samples, first: Solution, cells: int, bandwidth: float | None) -> Smoothed:
    """The smoothing spline of joints that move."""
    notes: list[str] = []
    velocity = first.spline(samples.t, nu=1)
    scatter = np.sqrt(first.energy / len(samples.t))
    new = stamps.fresh(samples.t, samples.q, velocity, np.maximum(samples.steps, scatter))
    if not new.all():
        notes.append(f"{(~new).sum()} of {len(new)} rows repeat the row before while the robot moves; they are left out")
        samples, velocity = samples.part(new), velocity[new]
    length = float(np.ptp(samples.t)) / first.intervals
    samples = replace(samples, weight=rest_weights(samples.t, samples.q, length))
    floor = np.maximum(samples.floor, samples.steps**2 / 12)
    beats = beats_of(samples.t, samples.q, velocity, samples.steps, scatter, samples.weight)
    found = _corrected(samples, first, cells, 1)
    uncorrected, stamped = samples, None
    if found:  # what is finer than the stamps can tell is not worth breaks
        samples, floor = found[0], np.maximum(floor, scatter**2)
    choice, samples, note = _without_outliers(samples, beats, first.intervals, cells, bandwidth, floor)
    notes += note
    if found:
        raw = solve(_rows(uncorrected, cells), choice.solution.breaks)
        samples, moved = _corrected(uncorrected, raw, cells, 2) or found
        stamped = raw, _colour(moved, samples.t, choice) * moved.sigma
        choice = knots.again(_rows(samples, cells), choice)
        notes.append(f"time stamps scatter by {moved.sigma:.2g} s; one shift per row, from all joints, corrects them")
    solution = choice.solution
    variance = choice.variance * beats.inflation(solution.breaks, rests=True)
    spread = Spread(solution, variance, choice.coarser.spline, choice.ratio, stamped)
    left = samples.q - solution.spline(samples.t)
    return Smoothed(samples, solution.spline, spread, np.sqrt((left**2).mean(axis=0)), tuple(notes))


def interpolate(samples: Samples) -> Smoothed:
    """The spline of degree 9 through all samples, whose noise is their rounding."""
    from scipy.interpolate import make_interp_spline

    curve = make_interp_spline(samples.t, samples.q, k=DEGREE)
    solution = solve(_rows(samples, len(samples.t)), curve.t[DEGREE:-DEGREE])
    sigma = np.maximum(samples.steps / np.sqrt(12), np.sqrt(samples.floor) / 8)
    variance = np.broadcast_to(sigma**2, (solution.intervals, len(sigma)))
    note = "the samples' noise is no more than their rounding; the spline goes through all of them"
    return Smoothed(samples, curve, Spread(solution, variance), sigma, (note,))


def _choice(samples: Samples, beats: Beats, intervals: int, cells: int, bandwidth: float | None, floor: np.ndarray) -> knots.Choice:
    rows = _rows(samples, cells)
    if bandwidth is None:
        return knots.choose(rows, beats, intervals, floor)
    wanted = max(1, int(np.ceil(2 * bandwidth * np.ptp(samples.span))))
    most = knots.most_intervals(rows)
    if wanted > most:
        bound = most / 2 / np.ptp(samples.span)
        raise JounceError(f"bandwidth = {bandwidth:g} Hz; these samples carry at most {bound:.3g} Hz")
    return knots.bounded(rows, beats, wanted, floor)


def _without_outliers(
    samples: Samples, beats: Beats, intervals: int, cells: int, bandwidth: float | None, floor: np.ndarray
) -> tuple[knots.Choice, Samples, list[str]]:
    """The choice, once more where single rows lie far off, with less weight for these (Huber's)."""
    choice = _choice(samples, beats, intervals, cells, bandwidth, floor)
    left = np.abs(samples.q - choice.solution.spline(samples.t))
    scale = np.maximum(np.median(left, axis=0) / 0.6745, np.sqrt(choice.variance) / 2)
    far = (left / scale).max(axis=1) / OUTLIER
    if not 0 < (far > 1).mean() < SEVERAL:
        return choice, samples, []
    samples = replace(samples, weight=samples.weight / np.sqrt(np.maximum(far, 1)))
    note = f"{(far > 1).sum()} rows lie far from the others and count less"
    return _choice(samples, beats, intervals, cells, bandwidth, floor), samples, [note]


def _corrected(
    samples: Samples, raw: Solution, cells: int, rounds: int
) -> tuple[Samples, stamps.Shifts] | None:
    """The samples at corrected times where shifts of rows explain what a fit leaves of them."""
    few = slice(None, None, len(samples.t) // stamps.SUBSET + 1)
    t = samples.t[few]
    if not stamps.shifts(samples.q[few] - raw.spline(t), raw.spline(t, nu=1), np.zeros(len(t))):
        return None
    spline, shift, order, moved = raw.spline, np.zeros(len(samples.t)), np.arange(len(samples.t)), samples
    for k in range(rounds):
        found = stamps.shifts(moved.q - spline(moved.t), spline(moved.t, nu=1), shift)
        if not found:
            return None
        times = (samples.t[order] + found.shift).clip(*samples.span)
        again = np.argsort(times, kind="stable")
        order, shift = order[again], found.shift[again]
        moved = replace(samples.part(order), t=times[again])
        if k + 1 < rounds:
            spline = solve(_rows(moved, cells), raw.breaks).spline
    return moved, replace(found, shift=shift)


def _colour(shifts: stamps.Shifts, t: np.ndarray, choice: knots.Choice) -> float:
    """How much the shifts, averaged over half intervals, scatter more than independent ones: they may drift."""
    halves = np.searchsorted(t, knots.halves(choice.solution.breaks)[:-1]).clip(max=len(t) - 1)
    number = np.diff(halves, append=len(t))
    means = np.add.reduceat(shifts.shift, halves)[number > 1] / number[number > 1]
    return float(np.sqrt(max(1.0, np.median(means**2 * number[number > 1]) / 0.455 / shifts.sigma**2)))


def rounded(samples: Samples, first: Solution) -> bool:
    """Whether a spline explains samples to their rounding, or as long as there are breaks: no noise is seen."""
    sigma = np.sqrt(first.energy / len(samples.t))
    exact = sigma < ROUNDING * np.finfo(float).eps * np.abs(samples.q).max(axis=0)
    return bool(exact.all() or first.intervals > 0.7 * len(samples.t) / knots.FEWEST)


def _rows(samples: Samples, cells: int) -> Rows:
    return rows_of(samples.t, samples.q, samples.weight, samples.span, cells)
