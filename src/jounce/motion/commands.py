"""Make a curve of commands of a controller: positions at its rate, one per period.

The curve is the cubic B-spline whose control points are the commands. Its jerk is constant within each period, and is
the third difference of the commands; it passes them at a distance of q2d / (6 rate^2). Its velocity, acceleration and
jerk stay within those of the differences, where a spline through the commands overshoots them. It is at rest from one
period before the first command, and from one after the last, which are its ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value, warn
from jounce.core.scalars import is_finite
from jounce.motion import smoothness
from jounce.motion.composite_curves import RetimedCurve
from jounce.motion.curves import ArrangedCurve, Curve
from jounce.motion.spline import SplineCurve

AS_COMMANDS = Remedy("as_='commands'", "--as commands")
JERK_DIFFERENCE = 3  # the order of the last difference that libfranka's rate limiting takes, and that of the curve
MAX_DIFFERENCES = 4  # that of snap and of the second rate of a torque
MIN_USUAL_RATE = 20.0  # Hz: what is below is a period of at most 20 ms, if it was meant in ms
MIN_COMMANDS = 5  # in which a jerk is seen to be constant
MAX_COMMANDS = 10_000_000  # 560 MB of seven joints
MAX_RATE_ERROR = 0.02  # of a table's own rate against a controller's: more is another rate, or time was scaled
MAX_RATE_ROUNDING = 5e-4  # of a table's own rate to a whole number: clocks differ by less, 333 from 1000 / 3 Hz by more
LATE_PERIODS = 1.5  # from the command before: less is jitter
REST_TOLERANCE = 1e-3  # of a jerk or a velocity, to which the last rows fit a stop: by chance they fit none as well
TICK_TOLERANCE_PERIODS = 1e-6  # by which a duration is a whole number of periods
MAX_STEP_AT_REST = 1e-12  # rad or m per period: rounding
MAX_SHARE_AT_REST = 0.1  # of the last step: velocity that a cubic through four rows leaves where they come to rest
MIN_LAST_PERIOD = 0.9  # of the last row: one that is nearer to the row before is off the grid, where motions may stop


@dataclass(frozen=True, eq=False)
class CommandCurve(SplineCurve):
    """The commands of a controller, and the curve through them.

    `differences` is the order up to which a check takes them. `smoothed` is the curve of measured samples that
    they are of, whose deviations they have.
    """

    t: np.ndarray  # (N,)
    q: np.ndarray  # (N, n)
    rate: float  # Hz
    differences: int = JERK_DIFFERENCE
    smoothed: Curve | None = None

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Return standard deviations of the rates of a measured motion.

        Differences of commands are means of these.
        """
        return None if self.smoothed is None else self.smoothed.deviations(t, order)


def build_commands(t: np.ndarray, q: np.ndarray, rate: float, differences: int = JERK_DIFFERENCE) -> CommandCurve:
    """Return the curve of commands.

    Across commands that are skipped it goes straight on.
    """
    from scipy.interpolate import BSpline  # a second to import

    # The number of each command's period, at least one behind the one before.
    places = np.cumsum(np.append(0, np.maximum(np.rint(np.diff(t) * rate), 1)))
    count, period = int(places[-1]), (t[-1] - t[0]) / places[-1]
    # The first and the last command are repeated, at which the curve rests: (N, n) -> (count + 5, n) control points.
    points = np.stack([np.interp(np.arange(-2, count + 3), places, column) for column in q.T], axis=1)
    spline = BSpline(t[0] + period * np.arange(-4, count + 5), points, JERK_DIFFERENCE)
    return CommandCurve(spline, float(t[0] - period), float(t[-1] + period), t, q, rate, differences)


def find_commands(curve: Curve) -> CommandCurve | None:
    """Return the commands that a curve consists of; None for other curves.

    They have the columns of the curve in its order, at its times.
    """
    if isinstance(curve, CommandCurve):
        return curve
    # Columns in another order leave commands what they are, and factors of columns do not.
    if isinstance(curve, ArrangedCurve) and np.ndim(curve.factors) == 0:
        base = find_commands(curve.base)
        if base is not None:
            return build_commands(base.t, base.q[:, curve.order], base.rate, base.differences)
    # Later or earlier times leave them too, and other paces do not.
    if isinstance(curve, RetimedCurve) and curve.factor == 1:
        base = find_commands(curve.base)
        if base is not None:
            return build_commands(curve.outer(base.t), base.q, base.rate, base.differences)
    return None


def read_commands(t: np.ndarray, q: np.ndarray, place: str) -> tuple[CommandCurve, str, tuple[str, ...]]:
    """Return the commands of a table, their source, and notes.

    They are at the table's own rate.
    """
    if len(t) < MIN_COMMANDS:
        raise JounceError(f"{place}: {len(t)} rows; a table of commands has at least {MIN_COMMANDS}")
    period = float(np.median(np.diff(t)))
    # Rates of controllers are whole numbers: the median period shows them but for rounding.
    rate = round(1 / period) if abs(round(1 / period) * period - 1) < MAX_RATE_ROUNDING else 1 / period
    source, notes, gaps = f"{len(t)} commands at {rate:.6g} Hz", [], np.append(1, np.diff(t) * rate)
    late = np.flatnonzero(gaps > LATE_PERIODS)
    if late.size > 0:
        first = f"the first at t = {t[late[0]]:.6g} s, {gaps[late[0]]:.3g} periods after the one before"
        notes.append(f"{late.size} of {len(t)} commands are late: {first}")
    # A motion that ends within a period of its last command comes to rest by its jerk: that command is added.
    rounding, rates = np.array([2 * smoothness.rounding_error(column) for column in q.T]), _last_rates(q, rate)
    steps, last_step = np.abs(rates[1]) / rate, MAX_SHARE_AT_REST * np.abs(q[-1] - q[-2])
    moves = (steps > np.maximum(rounding, MAX_STEP_AT_REST)) & (gaps[-1] > MIN_LAST_PERIOD)
    wait = find_rest(rates, moves, 1 / rate)
    if wait > 0:
        t, q = np.append(t, t[-1] + 1 / rate), np.vstack([q, extrapolate(rates, wait)])
    # The cubic through the last rows leaves a velocity where they come to rest: it is no motion.
    moves &= steps > last_step
    return build_commands(t, q, rate), source, (*notes, *_describe_end(steps * moves, wait, t[-1]))


def sample_curve(curve: Curve, rate: float, differences: int) -> tuple[CommandCurve, tuple[str, ...]]:
    """Return the commands of a curve at k / rate, and notes.

    The first command is at the start of the curve.
    """
    if not is_finite(rate) or not rate > 0:
        raise JounceError(f"rate is {quote_value(rate)}; expected that of a controller in Hz, 1000 for 1 ms")
    if isinstance(differences, bool) or not isinstance(differences, int) or not 1 <= differences <= MAX_DIFFERENCES:
        orders = f"1 to {MAX_DIFFERENCES}: 1 for velocity, 2 for acceleration too, 3 for jerk, 4 for snap"
        raise JounceError(f"differences is {quote_value(differences)}; expected {orders}")
    rate, duration = float(rate), curve.stop - curve.start
    if duration * rate < MIN_COMMANDS - 1 or duration * rate > MAX_COMMANDS:
        came = f"a rate of {rate:g} Hz makes {duration * rate + 1:.3g} commands in {duration:g} s"
        raise JounceError(f"{came}; expected {MIN_COMMANDS} to {MAX_COMMANDS}: it is in Hz, 1000 for 1 ms")
    if rate < MIN_USUAL_RATE:
        warn(f"a rate of {rate:g} Hz is unusually low; for a period of {rate:g} ms give {1000 / rate:g}")
    # Commands are taken as they are, at the rate that they have.
    commands = find_commands(curve)
    if commands is not None:
        if abs(rate / commands.rate - 1) > MAX_RATE_ERROR:
            came = f"the table has commands at {commands.rate:.6g} Hz, and rate is {rate:g} Hz"
            raise JounceError(f"{came}; give the rate of the table, or load it without {AS_COMMANDS}")
        return build_commands(commands.t, commands.q, rate, differences), ()
    # How the curve ends, and whether its jerk brings it to rest within a period.
    order = JERK_DIFFERENCE if curve.highest is None else min(curve.highest, JERK_DIFFERENCE)
    rates = [x[0] for x in curve.rates(np.array([curve.stop]), order, True)]
    steps = np.abs(rates[1]) / rate
    moves = steps > MAX_STEP_AT_REST
    wait = find_rest(rates, moves, 1 / rate) if order == JERK_DIFFERENCE else 0.0
    # Commands behind the end of the curve hold it, or go on to where it rests.
    count = int(np.ceil((duration + wait) * rate - TICK_TOLERANCE_PERIODS))
    t = curve.start + np.arange(count + 1) / rate
    q = curve.rates(t.clip(max=curve.stop), 0)[0]
    is_behind = t > curve.stop
    if wait > 0:
        q[is_behind] = extrapolate(rates, np.minimum(t[is_behind, None] - curve.stop, wait))
    notes = _describe_end(steps * moves, wait, t[-1])
    is_measured = curve.deviations(t[:1], 0) is not None
    if is_measured:
        notes = (f"the rows are smoothed before: {AS_COMMANDS} takes them as they are", *notes)
    if is_behind[-1] and t[-1] - curve.stop > TICK_TOLERANCE_PERIODS / rate and wait == 0:
        came = f"{rate:g} Hz does not divide {duration:.9g} s"
        notes = (f"{came}: the last command, of t = {t[-1]:.9g} s, is the end of the motion", *notes)
    return replace(build_commands(t, q, rate, differences), smoothed=curve if is_measured else None), notes


def find_rest(rates: Sequence[np.ndarray], moves: np.ndarray, period: float) -> float:
    """Return how long after a state its jerk brings it to rest.

    The time is in s, the jerk constant. The state is q, qd, q2d, q3d (n,), of all joints that move. 0 where they do not
    rest within a period, to a tolerance: q2d and qd vanish at one time by chance in no other motion.
    """
    _, v, a, j = rates
    # The acceleration a + j t vanishes at -a / j, where the velocity v + a t + j t^2 / 2 has become v + a t / 2.
    with np.errstate(all="ignore"):
        wait = -a / j
        rests = (wait > 0) & (wait <= period * (1 + REST_TOLERANCE))
        rests &= np.abs(v + a * wait / 2) < REST_TOLERANCE * np.abs(v)
    return float(wait[moves].max()) if moves.any() and rests[moves].all() else 0.0


def extrapolate(rates: Sequence[np.ndarray], s: np.ndarray | float) -> np.ndarray:
    """Return the positions s seconds after a state, by its constant jerk."""
    q, v, a, j = rates
    return np.asarray(q + s * (v + s * (a / 2 + s * j / 6)))


def _last_rates(q: np.ndarray, rate: float) -> list[np.ndarray]:
    """Return q, qd, q2d, q3d at the last row.

    They are those of the cubic through four of the rows (N, n); q3d is 0 where a fifth row is off it.
    """
    # Newton's backward differences: the derivatives of the cubic at its last row are sums of these.
    first, second, third, fourth = (np.diff(q[-MIN_COMMANDS:], k, axis=0)[-1] for k in range(1, MIN_COMMANDS))
    jerk = np.where(np.abs(fourth) < REST_TOLERANCE * np.abs(third), third, 0.0) * rate**3
    return [q[-1], (first + second / 2 + third / 3) * rate, (second + third) * rate**2, jerk]


def _describe_end(steps: np.ndarray, wait: float, end: float) -> tuple[str, ...]:
    """Return a note on how commands end: at rest by the jerk, or in motion."""
    if wait > 0:
        return (f"it stops {wait:.3g} s after its end, by the jerk there: the command of t = {end:.9g} s is added",)
    if steps.any():
        return (f"it ends in motion, by up to {steps.max():.2g} rad or m per command: the last command is held",)
    return ()
