"""From measured samples to a spline: what is noise, which rows count, which stamps are wrong, how many breaks."""

from dataclasses import dataclass, replace
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from jounce.errors import JounceError
from jounce.motion import knots, stamps
from jounce.motion.deviations import Spread
from jounce.motion.least_squares import CELLS, DEGREE, Rows, Solution, few_rows_of, rows_of, solve
from jounce.motion.noise import Beats, beats_of, rest_weights, whiteness

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

ROUNDING = 64  # units in the last place of a double, below which samples are no measured ones
SMOOTH = 1e-5  # share of a joint's range that eighth differences of smooth samples are at most
NOT_WHITE = 5  # standard deviations of von Neumann's ratio
OUTLIER = 6  # standard deviations
MEDIAN_OF_ONE = 0.455  # median of chi^2 with one degree of freedom
UNEXPLAINED = 0.1  # share of a joint's scatter about its mean that a fit may leave
SEVERAL = 0.05  # share of the samples, from which on they are no outliers
LONG = 20 * CELLS  # samples, from which on parts of them tell how many intervals they need
PROBES, PROBE = 6, 4096  # such parts, and the samples of each


@dataclass(frozen=True, eq=False)
class Samples:
    """What is smoothed: times (N,), samples (N, n) of joints that move, their weights (N,), the span of the
    times, the steps (n,) of encoders or digits; where stamps are in doubt, a spline to take velocities from and each joint's own
    variance (n,)."""

    t: np.ndarray
    q: np.ndarray
    weight: np.ndarray
    span: tuple[float, float]
    steps: np.ndarray
    drift: "tuple[BSpline, np.ndarray] | None" = None

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
    if len(samples.t) < LONG:
        return knots.by_schwarz(_rows(samples, CELLS), samples.floor), CELLS
    starts = np.linspace(0, len(samples.t) - PROBE, PROBES).astype(int)
    parts = [samples.part(np.arange(start, start + PROBE)) for start in starts]
    needed = [knots.by_schwarz(rows_of(p.t, p.q, p.weight, (p.t[0], p.t[-1])), samples.floor).intervals for p in parts]
    guess = int(np.mean(needed)) * len(samples.t) // PROBE
    cells = max(CELLS, 4 * guess)
    return knots.by_schwarz(_rows(samples, cells), samples.floor, guess), cells


def moves(samples: Samples, first: Solution) -> np.ndarray:
    """Which joints, (n,), a spline explains better, by BIC, than a constant does, or scatter otherwise than by noise."""
    count = len(samples.t)
    constant = np.maximum(samples.q.var(axis=0), samples.floor)
    spline = np.maximum(first.energy / count, samples.floor)
    explained = count * np.log(constant / spline) > (first.unknowns - 1) * np.log(count)
    return explained | (whiteness(samples.q) < -NOT_WHITE)


def smooth(samples: Samples, first: Solution, cells: int, bandwidth: float | None) -> Smoothed:
    """The smoothing spline of joints that move."""
    notes: list[str] = []
    velocity = first.spline(samples.t, nu=1)
    scatter = np.sqrt(first.energy / len(samples.t))
    new = stamps.fresh(samples.t, samples.q, velocity, np.maximum(samples.steps, scatter))
    if not new.all():
        notes.append(
            f"{(~new).sum()} of {len(new)} rows repeat the row before while the robot moves; they are left out"
        )
        samples, velocity = samples.part(new), velocity[new]
    length = float(np.ptp(samples.t)) / first.intervals
    samples = replace(samples, weight=rest_weights(samples.t, samples.q, length))
    floor = np.maximum(samples.floor, samples.steps**2 / 12)
    beats = beats_of(samples.t, samples.q, velocity, samples.steps, scatter, samples.weight)
    found = _corrected(samples, first, cells, 1)
    uncorrected, stamped = samples, None
    if found:  # what is finer than the stamps can tell is not worth breaks
        samples, floor = replace(found[0], drift=(first.spline, found[1].own)), np.maximum(floor, scatter**2)
    choice, samples, note = _without_outliers(samples, beats, first.intervals, cells, bandwidth, floor)
    notes += note
    if found:
        raw = solve(_rows(uncorrected, cells), choice.solution.breaks)
        samples, moved = _corrected(uncorrected, raw, cells, 2) or found
        stamped = raw, _colour(samples, uncorrected.t, raw, moved.sigma) * moved.sigma
        choice = knots.again(_rows(samples, cells), beats, choice)
        notes.append(f"time stamps scatter by {moved.sigma:.2g} s; one shift per row, from all joints, corrects them")
    solution = choice.solution
    variance = choice.variance * beats.inflation(solution.breaks, rests=True)
    spread = Spread(solution, variance, choice.coarser.spline, choice.ratio, stamped)
    left = samples.q - solution.spline(samples.t)
    slow = whiteness(left) < -NOT_WHITE
    if (slow & (left.std(axis=0) > UNEXPLAINED * samples.q.std(axis=0))).any():
        notes.append("much of the samples' scatter is no white noise: there may be motion faster than they carry")
    return Smoothed(samples, solution.spline, spread, np.sqrt((left**2).mean(axis=0)), tuple(notes))


def interpolate(samples: Samples) -> Smoothed:
    """The spline of degree 9 through all samples, whose noise is their rounding."""
    from scipy.interpolate import make_interp_spline

    curve = make_interp_spline(samples.t, samples.q, k=DEGREE)
    solution = solve(rows_of(samples.t, samples.q, samples.weight, samples.span), curve.t[DEGREE:-DEGREE])
    sigma = np.maximum(samples.steps / np.sqrt(12), np.sqrt(samples.floor) / 8)
    variance = np.broadcast_to(sigma**2, (solution.intervals, len(sigma)))
    note = "the samples' noise is no more than their rounding; the spline goes through all of them"
    return Smoothed(samples, curve, Spread(solution, variance), sigma, (note,))


def _choice(
    samples: Samples, beats: Beats, intervals: int, cells: int, bandwidth: float | None, floor: np.ndarray
) -> knots.Choice:
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


def _corrected(samples: Samples, raw: Solution, cells: int, rounds: int) -> tuple[Samples, stamps.Scatter] | None:
    """The samples at corrected times, in order, where shifts of rows explain what a fit leaves of them."""
    some = slice(None, None, len(samples.t) // stamps.SUBSET + 1)
    t = samples.t[some]
    scatter = stamps.scatter(samples.q[some] - raw.spline(t), raw.spline(t, nu=1))
    if not scatter:
        return None
    spline, shift, order, moved = raw.spline, np.zeros(len(samples.t)), np.arange(len(samples.t)), samples
    for k in range(rounds):
        velocity = spline(moved.t, nu=1)
        left = moved.q - spline(moved.t) + velocity * shift[:, None]
        scatter = stamps.scatter(left, velocity) or scatter
        shift = stamps.shifts(left, velocity, scatter)
        times = (samples.t[order] + shift).clip(*samples.span)
        again = np.argsort(times, kind="stable")
        order, shift = order[again], shift[again]
        moved = replace(samples.part(order), t=times[again])
        if k + 1 < rounds:
            spline = solve(_rows(moved, cells), raw.breaks).spline
    return moved, scatter


def _colour(samples: Samples, stamped: np.ndarray, solution: Solution, sigma: float) -> float:
    """How much shifts of rows, averaged over half intervals, scatter more than independent ones do: they may drift."""
    halves = np.searchsorted(samples.t, knots.halves(solution.breaks)[:-1]).clip(max=len(samples.t) - 1)
    number = np.diff(halves, append=len(samples.t))
    means = np.add.reduceat(samples.t - np.sort(stamped), halves)[number > 1] / number[number > 1]
    return float(np.sqrt(max(1.0, np.median(means**2 * number[number > 1]) / MEDIAN_OF_ONE / sigma**2)))


def rounded(samples: Samples, first: Solution) -> bool:
    """Whether a spline explains samples to their rounding, or needs all breaks there are for samples that look smooth."""
    sigma = np.sqrt(first.energy / len(samples.t))
    exact = sigma < ROUNDING * np.finfo(float).eps * np.abs(samples.q).max(axis=0)
    if exact.all() or first.intervals < 0.7 * len(samples.t) / knots.FEWEST:
        return bool(exact.all())
    order = 8  # differences of that order hold white noise sqrt(binomial(16, 8)) times
    noise = np.sqrt((np.diff(samples.q, order, axis=0) ** 2).mean(axis=0) / comb(2 * order, order))
    return bool((noise < SMOOTH * np.ptp(samples.q, axis=0)).all())


def _rows(samples: Samples, cells: int) -> Rows:
    rows = few_rows_of(samples.t, samples.q, samples.weight, samples.span, cells)
    if samples.drift is None:
        return rows
    spline, own = samples.drift
    return replace(rows, along=(spline(rows.t, nu=1), own))
