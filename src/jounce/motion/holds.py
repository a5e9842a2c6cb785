"""Rows that repeat older positions while the robot moves: a log that is written faster than its sensor is read.

Only the first row of a hold is where the robot is; the others are late by up to a period of the sensor. An encoder
that stays on a step repeats its value too: a hold is where the motion passes more than a step meanwhile.

First rows are late as well, by what is left of a row of the log. Where the two clocks run past each other, each row is
a bound of the sensor's time, and the ticks of a regular clock that keep all bounds are known to a part of a row.
"""

from dataclasses import dataclass, replace

import numpy as np

from jounce.motion.knots import fit_breaks
from jounce.motion.least_squares import SplineSolution
from jounce.motion.samples import Samples

MIN_STEPS_IN_HOLD = 2.0  # or standard deviations, that a motion passes: positions round, and both ends scatter
MAX_HOLD_TO_USUAL = 10.0  # number of rows between changes: a longer run of equal rows is a rest
MIN_REGULAR_SHARE = 0.9  # of certain changes, which follow each other by the period, give or take a row
MIN_SENSOR_CHANGES = 10  # that determine a period
MIN_PERIOD_IN_ROWS = 1.5  # from which on a sensor is slower than the log
FIRST_ROW_SHARE = 0.995  # of rows are the first of their hold; of a few holds it may be missing
MIN_NOTED_DELAY = 0.01  # periods: below, the doubt about a delay is not worth a word
CLOCK_PARTS = 64  # of a log, whose earliest and latest rows bound the sensor's clock in a linear program
TICK_TOLERANCE = 1e-9  # rows, by which ticks may be late for rounding
MAX_ROWS_LATE = 1.1  # a regular sensor is read within one row, but for rounding of stamps


@dataclass(frozen=True, eq=False)
class SampleHolds:
    """Rows that hold an older position than they could."""

    held: np.ndarray  # (N,), which rows do
    t: np.ndarray  # (R,), times of the others: of the sensor's clock, where that is regular
    period: float | None = None  # of a regular sensor, s
    delay: float = 0.0  # of the sensor's rows, held ones included, on average, s
    unsure: float = 0.0  # by how much the sensor may be earlier still, s; infinite if the motion is too slow to show it

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of it."""
        if not self.held.any():
            return ()
        count = f"{self.held.sum()} of {len(self.held)}"
        if self.period is None:
            return (f"{count} rows repeat the row before while the robot moves; they are left out",)
        return (
            f"the sensor gives {1 / self.period:.4g} values per second, which rows hold, {self.delay:.2g} s late on"
            f" average: {count} rows are left out, the others are at the sensor's times"
            + describe_delay(self.unsure, self.period),
        )

    def without(self, samples: Samples) -> Samples:
        """The samples at the sensor's times."""
        unsure = np.full(samples.q.shape[1], 0.0 if self.period is None else self.unsure)
        return replace(samples.part(~self.held), t=self.t.clip(*samples.span), unsure=unsure)


def describe_delay(unsure: np.ndarray | float, period: float) -> str:
    """What to say of times that are unsure, against the sensor's period."""
    late = float(np.max(unsure))
    return f" or up to {late:.2g} s late, which the deviations hold" if late > MIN_NOTED_DELAY * period else ""


def find_holds(samples: Samples, curve: np.ndarray, first: SplineSolution, cells: int) -> SampleHolds:
    """The rows that hold older positions, by a first fit to all, late by half of a hold, whose values are `curve`."""
    changed = np.append(True, (np.diff(samples.q, axis=0) != 0).any(axis=1))
    starts = np.flatnonzero(changed)
    ends = np.append(starts[1:], len(changed)) - 1
    scatter, own = np.sqrt(first.energy / len(changed)), _own_scatter(samples, starts, curve, first, cells)
    size = np.maximum(MIN_STEPS_IN_HOLD * np.maximum(samples.steps, own), scatter / 2)

    after = (ends + 1).clip(max=len(changed) - 1)
    catches_up = np.abs(samples.q[after] - samples.q[starts]) > size
    certain = np.asarray((np.abs(curve[starts[1:]] - curve[starts[:-1]]) > size).any(axis=1))
    usual = float(np.median(np.diff(starts)[certain])) if certain.any() else 1.0
    # a longer run is a rest, at whose ends a fit that is not resolved swings; a fast joint has no rests
    passes = (np.abs(curve[ends] - curve[starts]) > size) & catches_up
    is_hold = passes.any(axis=1) & (ends - starts < MAX_HOLD_TO_USUAL * usual)
    fast = (np.abs(np.diff(curve, axis=0)) > MIN_STEPS_IN_HOLD * np.maximum(samples.steps, scatter)).any(axis=1)
    period = _estimate_period(samples.t, starts, certain)
    held = ~changed & (is_hold[np.cumsum(changed) - 1] | np.append(False, fast) | (period is not None))
    if period is not None:
        held[_find_reread_rows(samples.t, starts[~is_hold], ends[~is_hold], period)] = False
    t = samples.t[~held]
    if period is None:
        return SampleHolds(held, t, unsure=0.0 if certain.sum() >= MIN_SENSOR_CHANGES else np.inf)
    ticks, unsure = _estimate_ticks(t, changed[~held], period, float(np.median(np.diff(samples.t))))
    return SampleHolds(held, ticks, period, float((samples.t - ticks[np.cumsum(~held) - 1]).mean()), unsure)


def _own_scatter(
    samples: Samples, starts: np.ndarray, curve: np.ndarray, first: SplineSolution, cells: int
) -> np.ndarray:
    """By how much (n,) the first rows of runs scatter about a fit."""
    own = np.sqrt(((samples.q - curve)[starts] ** 2).mean(axis=0))
    if (own <= samples.steps).all():
        return own
    # a fit to these rows alone scatters less: the first one is off them for the delay of the others
    try:
        return np.sqrt(fit_breaks(samples.part(starts).all_rows(cells), first.breaks).energy / len(starts))
    except np.linalg.LinAlgError:  # of a joint that changes in less than ten rows
        return own


def _estimate_ticks(t: np.ndarray, changed: np.ndarray, period: float, row: float) -> tuple[np.ndarray, float]:
    """When a sensor of about that period was read, by the first rows (R,) afterwards; how much earlier it may be.

    The straight line of ticks is that to which rows where something `changed` are late by the most alike times; the
    first row of a log may begin within a hold.
    """
    from scipy.optimize import minimize_scalar

    apart = np.round(np.diff(t) / period)
    apart[0] = max(apart[0], 1)
    k = np.append(0, np.cumsum(apart))
    changed = np.append(False, changed[1:])
    about = (t[-1] - t[1]) / (k[-1] - k[1])
    reach = 2 * row / k[-1]  # both ends are late by less than a row
    spread, bounds = lambda p: float(np.ptp((t - p * k)[changed])), (about - reach, about + reach)
    found = minimize_scalar(spread, bounds=bounds, method="bounded", options={"xatol": 1e-6 * reach})
    if found.fun > MAX_ROWS_LATE * row or (apart < 1).any():  # the log's clock is not regular: its scatter is noise
        return t, row
    start = (t - found.x * k)[changed].min()
    late = (t - found.x * k - start)[changed] / row
    first = late <= np.quantile(late, FIRST_ROW_SHARE)
    return start + found.x * k, row * _bound_clock_error(k[changed][first] / k[-1], late[first])


def _bound_clock_error(x: np.ndarray, late: np.ndarray) -> float:
    """By how much the ends of a straight line of ticks may be off 0, where rows at x from 0 to 1 are `late` (R,): all
    lines are as good to which they are late by less than 1, the rows of the log that time is counted in.

    The earliest and the latest of each of some parts suffice: fewer rows leave more lines, not less.
    """
    from scipy.optimize import linprog

    parts = np.array_split(np.arange(len(x)), min(len(x), CLOCK_PARTS))
    some = np.unique([part[pick(late[part])] for part in parts for pick in (np.argmin, np.argmax)])
    x, late = x[some], late[some]
    line = np.stack([np.ones(len(x)), x], axis=1)
    most = max(1.0, float(late.max())) + TICK_TOLERANCE
    rows, bounds = np.concatenate([line, -line]), np.concatenate([late, most - late])
    goals = ([sign, sign * end] for sign in (1, -1) for end in (0, 1))
    return float(np.abs([linprog(goal, rows, bounds, bounds=(-2, 2)).fun or 0.0 for goal in goals]).max())


def _estimate_period(t: np.ndarray, starts: np.ndarray, certain: np.ndarray) -> float | None:
    """The time between changes, of those that are `certain` not to be missed, if it is regular and more than a row."""
    apart, row = np.diff(t[starts])[certain], float(np.median(np.diff(t)))
    if len(apart) < MIN_SENSOR_CHANGES:
        return None
    usual = float(np.median(apart))
    near = np.abs(apart - usual) < 1.5 * row
    return float(apart[near].mean()) if near.mean() >= MIN_REGULAR_SHARE and usual > MIN_PERIOD_IN_ROWS * row else None


def _find_reread_rows(t: np.ndarray, starts: np.ndarray, ends: np.ndarray, period: float) -> np.ndarray:
    """Rows in runs of equal ones, as encoders at rest give, at which a sensor of that period was read again."""
    found = [np.empty(0, int)]
    for a, b in zip(starts, ends, strict=True):
        if b + 1 < len(t):  # ticks are even up to the next change
            ticks = np.linspace(t[a], t[b + 1], max(1, round((t[b + 1] - t[a]) / period)) + 1)[1:-1]
        else:
            ticks = np.arange(t[a] + period, t[b], period)
        found.append(np.searchsorted(t, ticks - 1e-3 * period).clip(max=b))
    return np.concatenate(found)
