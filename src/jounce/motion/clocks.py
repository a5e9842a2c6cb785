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
    """Rows that hold an older position than the joints have."""

    held: np.ndarray  # (N,), which rows do
    t: np.ndarray  # (R,), times of the others: of the sensor's clock, where that is regular
    period: float | None = None  # of a regular sensor, s
    delay: float = 0.0  # of the sensor's rows, held ones included, on average, s
    unsure: float = 0.0  # by how much the sensor may be earlier still, s; infinite if the motion is too slow to show it

    @property
    def notes(self) -> tuple[str, ...]:
        """The notes on the holds for a user."""
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
        """Return the samples without held rows, at the sensor's times."""
        # Without a regular period the times are those of the rows, and how late they are is not known.
        unsure = np.full(samples.q.shape[1], 0.0 if self.period is None else self.unsure)
        return replace(samples.part(~self.held), t=self.t.clip(*samples.span), unsure=unsure)


def describe_delay(unsure: np.ndarray | float, period: float) -> str:
    """Describe by how much times are unsure, if that matters.

    It is compared with the sensor's period.
    """
    late = float(np.max(unsure))
    return f" or up to {late:.2g} s late, which the deviations hold" if late > MIN_NOTED_DELAY * period else ""


def find_holds(samples: Samples, curve: np.ndarray, first: SplineSolution, cells: int) -> SampleHolds:
    """Return the rows that hold older positions.

    The `first` fit to all rows, with values `curve` (N, n), is late by half of a hold, which does not matter here.
    """
    # Runs of rows in which no joint changes, by their first and last rows, (K,).
    changed = np.append(True, (np.diff(samples.q, axis=0) != 0).any(axis=1))
    starts = np.flatnonzero(changed)
    ends = np.append(starts[1:], len(changed)) - 1
    # What a motion has to pass to be seen, (n,): some steps of the encoder, or the scatter of fresh rows.
    scatter = np.sqrt(first.energy / len(changed))
    fresh_scatter = _scatter_of_first_rows(samples, starts, curve, first, cells)
    size = np.maximum(MIN_STEPS_IN_HOLD * np.maximum(samples.steps, fresh_scatter), scatter / 2)

    # A run is a hold where the fit goes on while the samples stand, and the samples catch up afterwards.
    after = (ends + 1).clip(max=len(changed) - 1)
    catches_up = np.abs(samples.q[after] - samples.q[starts]) > size
    passes = (np.abs(curve[ends] - curve[starts]) > size) & catches_up
    # The usual length comes from changes that are certain to be seen, since the fit passes enough between them. A much
    # longer run is a rest, at whose ends a fit that is not resolved swings.
    certain = np.asarray((np.abs(curve[starts[1:]] - curve[starts[:-1]]) > size).any(axis=1))
    usual = float(np.median(np.diff(starts)[certain])) if certain.any() else 1.0
    is_hold = passes.any(axis=1) & (ends - starts < MAX_HOLD_TO_USUAL * usual)
    # A fast joint has no rests: whatever repeats while the fit passes steps from row to row is held.
    fast = (np.abs(np.diff(curve, axis=0)) > MIN_STEPS_IN_HOLD * np.maximum(samples.steps, scatter)).any(axis=1)
    period = _estimate_period(samples.t, starts, certain)
    held = ~changed & (is_hold[np.cumsum(changed) - 1] | np.append(False, fast) | (period is not None))
    if period is not None:
        # A regular sensor holds all rows that repeat, but reads the same position more than once at rest.
        held[_find_reread_rows(samples.t, starts[~is_hold], ends[~is_hold], period)] = False
    t = samples.t[~held]
    if period is None:
        return SampleHolds(held, t, unsure=0.0 if certain.sum() >= MIN_SENSOR_CHANGES else np.inf)
    # The sensor's own clock gives better times than the rows that first show its values.
    ticks, unsure = _estimate_ticks(t, changed[~held], period, float(np.median(np.diff(samples.t))))
    return SampleHolds(held, ticks, period, float((samples.t - ticks[np.cumsum(~held) - 1]).mean()), unsure)


def _scatter_of_first_rows(
    samples: Samples, starts: np.ndarray, curve: np.ndarray, first: SplineSolution, cells: int
) -> np.ndarray:
    """Return the scatter (n,) of first rows of runs about a fit."""
    scatter = np.sqrt(((samples.q - curve)[starts] ** 2).mean(axis=0))
    if (scatter <= samples.steps).all():
        return scatter
    # The first fit is off these rows by the delay of the others: a fit to them alone scatters less.
    try:
        return np.sqrt(knots.fit_breaks(samples.part(starts).all_rows(cells), first.breaks).energy / len(starts))
    except np.linalg.LinAlgError:
        # A joint that changes in less than ten rows determines no spline.
        return scatter


def _estimate_ticks(t: np.ndarray, changed: np.ndarray, period: float, row: float) -> tuple[np.ndarray, float]:
    """Return when a regular sensor was read, and the uncertainty.

    Times t (R,) are of the first rows after each reading. The straight line of ticks is that to which rows where
    something `changed` are late by the most alike times; the first row of a log may begin within a hold.
    """
    from scipy.optimize import minimize_scalar

    # The number of each row's tick, (R,).
    ticks_passed = np.round(np.diff(t) / period)
    ticks_passed[0] = max(ticks_passed[0], 1)
    k = np.append(0, np.cumsum(ticks_passed))
    changed = np.append(False, changed[1:])
    # The exact period p, for which t - p k are closest together. Both ends are late by less than a row, which bounds
    # how far it is from the mean one.
    mean_period = (t[-1] - t[1]) / (k[-1] - k[1])
    reach = 2 * row / k[-1]

    def range_of_delays(p: float) -> float:
        return float(np.ptp((t - p * k)[changed]))

    bounds = mean_period - reach, mean_period + reach
    best = minimize_scalar(range_of_delays, bounds=bounds, method="bounded", options={"xatol": 1e-6 * reach})
    # Where delays are more than a row, the log's clock is not regular: its scatter is noise, and its times stay.
    if best.fun > MAX_ROWS_LATE * row or (ticks_passed < 1).any():
        return t, row
    # The line is as late as the rows allow, and they bound how much earlier it may be.
    start = (t - best.x * k)[changed].min()
    late = (t - best.x * k - start)[changed] / row
    first = late <= np.quantile(late, FIRST_ROW_SHARE)
    return start + best.x * k, row * _bound_clock_error(k[changed][first] / k[-1], late[first])


def _bound_clock_error(x: np.ndarray, late: np.ndarray) -> float:
    """Return how far a line of ticks may be off, in rows.

    Rows at x (R,), from 0 to 1, are `late` (R,) by parts of a row of the log. All lines are as good to which they are
    late by less than 1. The earliest and the latest of each of some parts suffice: fewer rows leave more lines, not
    less.
    """
    from scipy.optimize import linprog

    parts = np.array_split(np.arange(len(x)), min(len(x), CLOCK_PARTS))
    extremes = [part[[late[part].argmin(), late[part].argmax()]] for part in parts]
    some = np.unique(extremes)
    x, late = x[some], late[some]
    # Lines a + b x with 0 <= late - (a + b x) <= most: (2 R, 2) inequalities in (a, b).
    line = np.stack([np.ones(len(x)), x], axis=1)
    most = max(1.0, float(late.max())) + TICK_TOLERANCE
    rows, bounds = np.concatenate([line, -line]), np.concatenate([late, most - late])

    def least_value(goal: list[int]) -> float:
        value = linprog(goal, rows, bounds, bounds=(-2, 2)).fun
        return 0.0 if value is None else value

    # Four linear programs: the least and the largest value of such a line at x = 0 and at x = 1.
    goals = ([sign, sign * end] for sign in (1, -1) for end in (0, 1))
    return float(np.abs([least_value(goal) for goal in goals]).max())


def _estimate_period(t: np.ndarray, starts: np.ndarray, certain: np.ndarray) -> float | None:
    """Return the period of a sensor, or None.

    Changes that are `certain` not to be missed count. Irregular changes have no period, nor have those of a sensor as
    fast as the log.
    """
    intervals, row = np.diff(t[starts])[certain], float(np.median(np.diff(t)))
    if len(intervals) < MIN_SENSOR_CHANGES:
        return None
    # Rows show a regular clock to about a row: the mean of those that agree is the period.
    usual = float(np.median(intervals))
    agrees = np.abs(intervals - usual) < 1.5 * row
    if agrees.mean() < MIN_REGULAR_SHARE or usual <= MIN_PERIOD_IN_ROWS * row:
        return None
    return float(intervals[agrees].mean())


def _find_reread_rows(t: np.ndarray, starts: np.ndarray, ends: np.ndarray, period: float) -> np.ndarray:
    """Return rows in runs at which the sensor was read again.

    Encoders at rest give such runs, from `starts` to `ends`, though they are read in each period.
    """
    rows = [np.empty(0, int)]
    for a, b in zip(starts, ends, strict=True):
        # Ticks are even up to the next change; behind the last one they follow each other by the period.
        if b + 1 < len(t):
            ticks = np.linspace(t[a], t[b + 1], max(1, round((t[b + 1] - t[a]) / period)) + 1)[1:-1]
        else:
            ticks = np.arange(t[a] + period, t[b], period)
        rows.append(np.searchsorted(t, ticks - 1e-3 * period).clip(max=b))
    return np.concatenate(rows)


# Sensors with clocks of their own.
@dataclass(frozen=True, eq=False)
class SensorClocks:
    """Samples whose sensors are not read together, at common times."""

    held: np.ndarray  # (N,), rows that are left out
    samples: Samples  # the others, moved to common times
    periods: np.ndarray  # (n,), s; 0 for joints as fast as the log, or where the motion is too slow to determine it

    @property
    def notes(self) -> tuple[str, ...]:
        """The notes on the sensors for a user."""
        regular = self.periods[self.periods > 0]
        rates = dict.fromkeys(f"{1 / period:.4g}" for period in (regular.max(), regular.min()))
        return (
            f"sensors of {' to '.join(rates)} values per second, which rows hold, are not read together for all joints:"
            f" {self.held.sum()} of {len(self.held)} rows are left out, which the slowest does not read, and values are"
            " moved to the times of the others by the motion itself"
            + describe_delay(np.asarray(self.samples.unsure), float(regular.max())),
        )


def find_sensors(
    samples: Samples, curve: np.ndarray, first: SplineSolution, cells: int, together: SampleHolds
) -> SensorClocks | None:
    """Return samples at common times, where sensors have clocks of their own.

    None where joints hold no values over rows of their own, or all of them `together`.
    """
    by_joint = [
        find_holds(samples.joints(k), curve[:, k], replace(first, energy=first.energy[k]), cells)
        for k in np.arange(samples.q.shape[1])[:, None]
    ]
    periods = np.array([0.0 if holds.period is None else holds.period for holds in by_joint])
    regular = periods[periods > 0]
    # Rows of the slowest sensor count, (R,).
    slowest = by_joint[int(np.argmax(periods))]
    rows = np.flatnonzero(~slowest.held)
    has_common_clock = together.period is not None and (np.abs(regular / together.period - 1) < PERIOD_TOLERANCE).all()
    if regular.size == 0 or has_common_clock or len(rows) < least_squares.MIN_FIT_SAMPLES:
        return None
    # The last tick of each joint at these rows, (R, n).
    ticks = np.stack([holds.t[np.cumsum(~holds.held)[rows] - 1] for holds in by_joint], axis=1).clip(*samples.span)
    # Joints as fast as the log have clocks of their own as well: they are unsure by a row.
    row = float(np.median(np.diff(samples.t)))
    unsure = np.array([min(row if holds.unsure == 0 else holds.unsure, periods.max()) for holds in by_joint])
    return SensorClocks(slowest.held, _move_samples(replace(samples.part(rows), unsure=unsure), ticks), periods)


def _move_samples(samples: Samples, ticks: np.ndarray) -> Samples:
    """Return samples q (R, n) as they were at the rows' times.

    They were read at `ticks` (R, n).
    """
    moved = samples
    for _ in range(MAX_MOVING_ROUNDS):
        # The fit to the samples as moved so far passes fit(t) - fit(t_k) between the two times.
        solution, _ = knots.fit_even_breaks(moved)
        curve = solution.spline
        passed = curve(samples.t) - np.stack([curve(t)[:, k] for k, t in enumerate(ticks.T)], axis=1)
        before, moved = moved, replace(moved, q=samples.q + passed)
        # At rest: no value moves by more than a small part of its noise.
        if (np.abs(moved.q - before.q).max(axis=0) < MOVING_TOLERANCE * np.sqrt(solution.energy / len(ticks))).all():
            break
    return moved


# Stamps that scatter.
@dataclass(frozen=True, eq=False)
class TimestampScatter:
    """How time stamps scatter, and what each joint scatters by otherwise."""

    sigma: float  # standard deviation s of rows' shifts in time, s
    variance: np.ndarray  # (n,), D, of each joint's own noise


def correct_timestamps(
    samples: Samples, raw: SplineSolution, cells: int, rounds: int
) -> tuple[Samples, TimestampScatter] | None:
    """Return the samples at corrected times, in order, and their scatter.

    None where shifts of rows do not explain what a fit leaves. `raw` is the fit at the stamps as they came; each
    further round refits its breaks at the corrected times.
    """
    some = slice(None, None, len(samples.t) // least_squares.MAX_SCATTER_ROWS + 1)
    t = samples.t[some]
    scatter = estimate_scatter(samples.q[some] - raw.spline(t), raw.spline(t, nu=1))
    if scatter is None:
        return None
    # `order` are the numbers of the rows by their corrected times, `shift` their shifts in that order.
    spline, shift, order, moved = raw.spline, np.zeros(len(samples.t)), np.arange(len(samples.t)), samples
    for k in range(rounds):
        # What is off the fit at the stamps as they came, to the first order: the present shift is added again.
        velocity = spline(moved.t, nu=1)
        residual = moved.q - spline(moved.t) + velocity * shift[:, None]
        improved = estimate_scatter(residual, velocity)
        scatter = scatter if improved is None else improved
        shift = estimate_shifts(residual, velocity, scatter)
        # Corrected times may pass each other: rows are put in their order.
        times = (samples.t[order] + shift).clip(*samples.span)
        again = np.argsort(times, kind="stable")
        order, shift = order[again], shift[again]
        moved = replace(samples.part(order), t=times[again])
        # The last times need no fit: the caller makes it.
        if k + 1 < rounds:
            spline = knots.fit_breaks(moved.rows(cells), raw.breaks).spline
    return moved, scatter


def correlation_factor(samples: Samples, stamped: np.ndarray, solution: SplineSolution, sigma: float) -> float:
    """Return how much shifts of rows scatter more than independent ones.

    Shifts are averaged over parts of intervals. Neighbours' shifts may be alike. Averages over much of an
    interval do not show it, for a fit takes these; averages over fewer rows than are alike show too little.
    """
    shift, squares = samples.t - np.sort(stamped), [1.0]
    for parts in AVERAGING_PARTS:
        block = max(1, len(shift) // (parts * solution.intervals))
        # Means of blocks of rows: of independent shifts their squares are sigma^2 / block.
        means = shift[: len(shift) // block * block].reshape(-1, block).mean(axis=1)
        squares.append(float(np.median(means**2)) * block / MEDIAN_OF_CHI2_1 / sigma**2)
    return float(np.sqrt(max(squares)))


def estimate_scatter(r: np.ndarray, v: np.ndarray) -> TimestampScatter | None:
    """Return how stamps scatter, by residuals at velocities.

    Residuals are r (N, n), velocities v (N, n). None where shifts of rows explain residuals no better than noise alone.
    """
    # A single joint does not distinguish shifts from noise.
    if r.shape[1] < 2:
        return None
    # Some rows suffice, and outliers would pass for large shifts.
    step = len(r) // least_squares.MAX_SCATTER_ROWS + 1
    r, v, tiny = r[::step], v[::step], np.finfo(float).tiny
    is_usual = (np.abs(r) <= MIN_OUTLYING_RESIDUAL * np.median(np.abs(r), axis=0)).all(axis=1)
    if is_usual.mean() > MIN_USUAL_SHARE:
        r, v = r[is_usual], v[is_usual]
    # The likelihood of noise alone: normal distributions of the residuals' own variances.
    variance = np.maximum((r**2).mean(axis=0), tiny)
    noise_likelihood = -0.5 * (np.log(variance).sum() + len(variance))
    # The start: half of the squares are noise, and shifts explain half of those of the joint that they explain least.
    sigma = float(np.sqrt((variance / np.maximum((v**2).mean(axis=0), tiny)).min() / 2))
    scatter = TimestampScatter(sigma, variance / 2)
    for _ in range(EM_ROUNDS):
        # Expectation: the mean and the variance of each shift by the present s and D.
        d, shift_variance = _posterior_shifts(r, v, scatter)
        # Maximisation: D and s by the mean squares that these shifts give.
        variance = ((r - v * d[:, None]) ** 2 + v**2 * shift_variance[:, None]).mean(axis=0)
        scatter = TimestampScatter(float(np.sqrt((d**2 + shift_variance).mean())), np.maximum(variance, tiny))
    d, shift_variance = _posterior_shifts(r, v, scatter)
    # The likelihood of r ~ N(0, D + s^2 v v^T), by the determinant and the inverse of a matrix of rank one more than D:
    # det = det D s^2 / var(d), r^T (D + s^2 v v^T)^-1 r = r^T D^-1 r - d^2 / var(d).
    squares = (r**2 / scatter.variance).sum(axis=1) - d**2 / shift_variance
    likelihood = -0.5 * (np.log(scatter.variance).sum() + np.log(scatter.sigma**2 / shift_variance) + squares).mean()
    # Of the logarithms of likelihoods, per row: chance gains little, and all rows together have to gain much.
    gain = likelihood - noise_likelihood
    is_certain = gain > MIN_GAIN_PER_ROW and len(r) * gain > MIN_GAIN_OF_ROWS
    return scatter if is_certain and not _has_few_large_shifts(d) else None


def remaining_share(v: np.ndarray, scatter: TimestampScatter) -> np.ndarray:
    """Return the mean share (n,) of one joint's wave that shifts leave.

    Shifts of rows, at velocities v (N, n), take the rest with them.
    """
    # A wave r of joint j alone makes shifts v r / D over 1 / s^2 + sum(v^2 / D), of which v times as much is taken off.
    weights = v**2 / scatter.variance
    taken_off = weights / (1 / scatter.sigma**2 + weights.sum(axis=1, keepdims=True))
    return np.asarray(1 - taken_off.mean(axis=0))


def _has_few_large_shifts(d: np.ndarray) -> bool:
    """Return whether few shifts (N,) are most of their squares.

    They are of a motion that a fit does not follow, and of no clock.
    """
    squares = np.sort(d**2)
    return bool(squares[-max(1, round(LARGEST_SHIFTS * len(d))) :].sum() > MAX_SHARE_OF_LARGEST * squares.sum())


def estimate_shifts(r: np.ndarray, v: np.ndarray, scatter: TimestampScatter) -> np.ndarray:
    """Return how much later than its stamp each row belongs.

    It is sum(v r / D) / (1 / s^2 + sum(v^2 / D)), (N,) in s. Rows that lie off the motion at any time stay where
    they are.
    """
    d, _ = _posterior_shifts(r, v, scatter)
    off = ((r - v * d[:, None]) ** 2 / scatter.variance).max(axis=1) > MIN_OUTLYING_RESIDUAL**2
    return np.where(off, 0.0, d)


def _posterior_shifts(r: np.ndarray, v: np.ndarray, scatter: TimestampScatter) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean and the variance (N,) of each row's shift."""
    variance = 1 / (1 / scatter.sigma**2 + (v**2 / scatter.variance).sum(axis=1))
    return variance * (v * r / scatter.variance).sum(axis=1), variance
