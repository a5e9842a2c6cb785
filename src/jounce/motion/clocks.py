"""Find when samples were taken: sensors read late, and stamps that scatter.

Holds (`find_holds`): rows that repeat older positions while the robot moves, of a log that is written faster than its
sensor is read. Only the first row of a hold is where the robot is; the others are late by up to a period of the sensor.
An encoder that stays on a step repeats its value too: a hold is where the motion passes more than a step meanwhile.
First rows are late as well, by what is left of a row of the log. Where the two clocks run past each other, each row is
a bound of the sensor's time, and the ticks of a regular clock that keep all bounds are known to a part of a row.

Sensors of their own clocks (`find_sensors`): joints that are read at different times, or at different rates, each hold
their values over rows of their own. Rows of the slowest sensor count, so that no value counts twice. The values that
others hold there are late by known delays: they are moved to the row's time by what the motion passes meanwhile.
Problem: samples at common times t of a motion q with samples ``q_k(t_k)`` at each joint's own times. Fixed point
iteration: a fit to the samples moves them, ``q_k(t_k) + fit(t) - fit(t_k)``, and is repeated until they rest. Errors of
the fit at an angular frequency w grow 2 sin(w delay / 2) times in each round, so that it converges for delays below a
sixth of the shortest period of the motion; otherwise it ends after `MAX_MOVING_ROUNDS`.

Stamps (`correct_timestamps`): a controller's log is stamped when rows are written. Each row then has the joints'
positions at another time than its stamp says, all of them at the same: one shift per row, estimated from all joints
together, explains their scatter. Problem: with residuals ``r = v d + e`` of each row, ``d ~ N(0, s^2)``,
``e ~ N(0, D)``, D diagonal, the s and D of the largest likelihood. This is factor analysis with known loadings v, by
expectation and maximisation (Rubin & Thayer, Psychometrika 47, 1982), whose likelihood rises in each step. A single
joint does not distinguish shifts from noise; nor are shifts believed that gain little likelihood, or that few rows
have: a fit that does not follow leaves such ones.

Holds and sensors are looked for once, before samples are smoothed; stamps are corrected twice on the way, by the first
fit and by the better one.
"""

from dataclasses import dataclass, replace

import numpy as np

from jounce.motion import knots, least_squares
from jounce.motion.least_squares import Samples, SplineSolution

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
PERIOD_TOLERANCE = 0.01  # of a sensor's period, by which that of all joints together may differ
MAX_MOVING_ROUNDS = 8  # each leaves a delay times the highest frequency of the rest
MOVING_TOLERANCE = 0.01  # standard deviations of noise, by which values still move at the end
AVERAGING_PARTS = (2, 4, 8, 16)  # of an interval, over which shifts of rows are averaged
MEDIAN_OF_CHI2_1 = 0.455  # of chi^2 with one degree of freedom
EM_ROUNDS = 30  # of expectation and maximisation
MIN_OUTLYING_RESIDUAL = 10.0  # times the usual residual, from which on a row is an outlier
MIN_USUAL_SHARE = 0.9  # of the rows: where more lie far off they are no outliers
LARGEST_SHIFTS = 0.02  # of all: the 2 % largest of normal shifts have 13 % of the squares,
MAX_SHARE_OF_LARGEST = 0.4  # and those of a clock less than this
MIN_GAIN_PER_ROW = 0.05  # in the logarithm of the likelihood, on average, that makes shifts believable
MIN_GAIN_OF_ROWS = 50  # the same, of all rows together


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
        return np.sqrt(knots.fit_breaks(samples.part(starts).all_rows(cells), first.breaks).energy / len(starts))
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


# Sensors with clocks of their own.
@dataclass(frozen=True, eq=False)
class SensorClocks:
    """What becomes of samples whose sensors are not read together."""

    held: np.ndarray  # (N,), rows that are left out
    samples: Samples  # the others, moved to common times
    periods: np.ndarray  # (n,), s; 0 for joints as fast as the log, or where the motion is too slow to determine it

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of it."""
        known = self.periods[self.periods > 0]
        rates = dict.fromkeys(f"{1 / period:.4g}" for period in (known.max(), known.min()))
        return (
            f"sensors of {' to '.join(rates)} values per second, which rows hold, are not read together for all joints:"
            f" {self.held.sum()} of {len(self.held)} rows are left out, which the slowest does not read, and values are"
            " moved to the times of the others by the motion itself"
            + describe_delay(np.asarray(self.samples.unsure), float(known.max())),
        )


def find_sensors(
    samples: Samples, curve: np.ndarray, first: SplineSolution, cells: int, together: SampleHolds
) -> SensorClocks | None:
    """The samples at common times, where joints hold values over rows of their own and not all of them `together`."""
    own = [
        find_holds(samples.joints(k), curve[:, k], replace(first, energy=first.energy[k]), cells)
        for k in np.arange(samples.q.shape[1])[:, None]
    ]
    periods = np.array([holds.period or 0.0 for holds in own])
    known = periods[periods > 0]
    slowest = own[int(np.argmax(periods))]
    rows = np.flatnonzero(~slowest.held)
    alike = together.period is not None and (np.abs(known / together.period - 1) < PERIOD_TOLERANCE).all()
    if not known.size or alike or len(rows) < least_squares.MIN_FIT_SAMPLES:
        return None
    ticks = np.stack([holds.t[np.cumsum(~holds.held)[rows] - 1] for holds in own], axis=1).clip(*samples.span)
    row = float(np.median(np.diff(samples.t)))  # joints as fast as the log have clocks of their own as well
    unsure = np.array([min(holds.unsure or row, periods.max()) for holds in own])
    return SensorClocks(slowest.held, _move_samples(replace(samples.part(rows), unsure=unsure), ticks), periods)


def _move_samples(samples: Samples, ticks: np.ndarray) -> Samples:
    """Samples q (R, n), read at `ticks` (R, n), as they were at the times of the rows."""
    moved = samples
    for _ in range(MAX_MOVING_ROUNDS):  # a fit, what it passes between the times, and whether that has changed
        solution, _ = knots.fit_even_breaks(moved)
        curve = solution.spline
        passed = curve(samples.t) - np.stack([curve(t)[:, k] for k, t in enumerate(ticks.T)], axis=1)
        before, moved = moved, replace(moved, q=samples.q + passed)
        if (np.abs(moved.q - before.q).max(axis=0) < MOVING_TOLERANCE * np.sqrt(solution.energy / len(ticks))).all():
            break
    return moved


# Stamps that scatter.
@dataclass(frozen=True, eq=False)
class TimestampScatter:
    """The standard deviation of rows' shifts in time, s, and the variance (n,) of each joint's own noise."""

    sigma: float
    own: np.ndarray


def correct_timestamps(
    samples: Samples, raw: SplineSolution, cells: int, rounds: int
) -> tuple[Samples, TimestampScatter] | None:
    """The samples at corrected times, in order, where shifts of rows explain what a fit leaves of them."""
    some = slice(None, None, len(samples.t) // least_squares.MAX_SCATTER_ROWS + 1)
    t = samples.t[some]
    scatter = estimate_scatter(samples.q[some] - raw.spline(t), raw.spline(t, nu=1))
    if not scatter:
        return None
    spline, shift, order, moved = raw.spline, np.zeros(len(samples.t)), np.arange(len(samples.t)), samples
    for k in range(rounds):
        velocity = spline(moved.t, nu=1)
        left = moved.q - spline(moved.t) + velocity * shift[:, None]
        scatter = estimate_scatter(left, velocity) or scatter
        shift = estimate_shifts(left, velocity, scatter)
        times = (samples.t[order] + shift).clip(*samples.span)
        again = np.argsort(times, kind="stable")
        order, shift = order[again], shift[again]
        moved = replace(samples.part(order), t=times[again])
        if k + 1 < rounds:
            spline = knots.fit_breaks(moved.rows(cells), raw.breaks).spline
    return moved, scatter


def correlation_factor(samples: Samples, stamped: np.ndarray, solution: SplineSolution, sigma: float) -> float:
    """How much shifts of rows, averaged over parts of intervals, scatter more than independent ones do.

    Neighbours' shifts may be alike. Averages over much of an interval do not show it, for a fit takes these; averages
    over fewer rows than are alike show too little.
    """
    shift, squares = samples.t - np.sort(stamped), [1.0]
    for parts in AVERAGING_PARTS:
        block = max(1, len(shift) // (parts * solution.intervals))
        means = shift[: len(shift) // block * block].reshape(-1, block).mean(axis=1)
        squares.append(float(np.median(means**2)) * block / MEDIAN_OF_CHI2_1 / sigma**2)
    return float(np.sqrt(max(squares)))


def estimate_scatter(r: np.ndarray, v: np.ndarray) -> TimestampScatter | None:
    """How stamps scatter, where shifts of rows explain residuals r, (N, n), at velocities v better than noise alone."""
    if r.shape[1] < 2:
        return None
    # some rows, without outliers, and the likelihood of noise alone
    step = len(r) // least_squares.MAX_SCATTER_ROWS + 1
    r, v, tiny = r[::step], v[::step], np.finfo(float).tiny
    usual = (np.abs(r) <= MIN_OUTLYING_RESIDUAL * np.median(np.abs(r), axis=0)).all(axis=1)
    if usual.mean() > MIN_USUAL_SHARE:
        r, v = r[usual], v[usual]
    own = np.maximum((r**2).mean(axis=0), tiny)
    alone = -0.5 * (np.log(own).sum() + len(own))
    found = TimestampScatter(float(np.sqrt((own / np.maximum((v**2).mean(axis=0), tiny)).min() / 2)), own / 2)
    for _ in range(EM_ROUNDS):  # shifts by the present s and D, then s and D by the shifts
        d, variance = _posterior_shifts(r, v, found)
        own = ((r - v * d[:, None]) ** 2 + v**2 * variance[:, None]).mean(axis=0)
        found = TimestampScatter(float(np.sqrt((d**2 + variance).mean())), np.maximum(own, tiny))
    d, variance = _posterior_shifts(r, v, found)
    # the gain of likelihood, by the determinant and the inverse of D + s^2 v v^T
    squares = (r**2 / found.own).sum(axis=1) - d**2 / variance
    together = -0.5 * (np.log(found.own).sum() + np.log(found.sigma**2 / variance) + squares).mean()
    better = together - alone  # of the logarithms of likelihoods, per row
    return (
        found
        if better > MIN_GAIN_PER_ROW and len(r) * better > MIN_GAIN_OF_ROWS and not _has_few_large_shifts(d)
        else None
    )


def remaining_share(v: np.ndarray, found: TimestampScatter) -> np.ndarray:
    """The mean share (n,) of a wave of one joint alone that shifts of rows, at velocities v (N, n), do not take."""
    weights = v**2 / found.own
    return np.asarray(1 - (weights / (1 / found.sigma**2 + weights.sum(axis=1, keepdims=True))).mean(axis=0))


def _has_few_large_shifts(d: np.ndarray) -> bool:
    """Whether few of the shifts (N,) are most of their squares: a motion that a fit does not follow, and no clock."""
    squares = np.sort(d**2)
    return bool(squares[-max(1, round(LARGEST_SHIFTS * len(d))) :].sum() > MAX_SHARE_OF_LARGEST * squares.sum())


def estimate_shifts(r: np.ndarray, v: np.ndarray, found: TimestampScatter) -> np.ndarray:
    """How much later than its stamp each row belongs, (N,) in s: sum(v r / D) / (1 / s^2 + sum(v^2 / D)).

    Rows that lie off the motion at any time stay where they are.
    """
    d, _ = _posterior_shifts(r, v, found)
    off = ((r - v * d[:, None]) ** 2 / found.own).max(axis=1) > MIN_OUTLYING_RESIDUAL**2
    return np.where(off, 0.0, d)


def _posterior_shifts(r: np.ndarray, v: np.ndarray, found: TimestampScatter) -> tuple[np.ndarray, np.ndarray]:
    """The mean and the variance (N,) of each row's shift."""
    variance = 1 / (1 / found.sigma**2 + (v**2 / found.own).sum(axis=1))
    return variance * (v * r / found.own).sum(axis=1), variance
