"""Reachability analysis finds the fastest law of all.

Limits are of first and second order.

Problem: x(sigma) >= 0 of least duration, the integral of x^(-1/2), with ``lower
<= G u + H x + g <= upper`` along the path, where x = sigma'^2 and ``u = sigma'' = x'/2``: limits of velocities,
accelerations and forces that are quadratic in speed are linear in x and u.

Points of the path lie closer together where the speed of the given motion changes by factors: sigma is its time, so
that x grows without bound, as 1 / q'', towards a rest from which the result starts with an acceleration that is not
zero. x stays below a cap that costs `_COST_OF_CAP` of the duration: the result leaves a rest as smoothly as the given
motion does, within about this share of its duration. `find_fastest_law` is the door; `find_obstacle` says what is not
linear.

Algorithm: TOPP-RA [1]. The path is divided into N intervals, on each of which u is linear with a given slope w, so that
the rows at its start, middle and end are half-planes of x and u at its start. Backwards, x is controllable up to
K[i], from where some u leads to x <= K[i + 1]; forwards, the largest u that stays within K is taken. Both steps are the
least of affine functions of x. The first round has w = 0, an error of the first order in the length of intervals; its
solution yields the slopes w of the second, which leaves one of the second order. Slopes are limited as in schemes for
shocks (minmod), hence 0 where u switches back and forth.

Invariants: a robot at rest is strictly within all limits, so that x = 0 is controllable everywhere and K[i] > 0; the
greedy x is the largest of all at every point of the path, but for the length of intervals [1]. Where G passes zero, so
that x alone is bounded (a zero-inertia point), rows at both ends of the interval bound u, and no division by G decides.
No row exceeds its bound by more than `MAX_EXCESS_ON_INTERVALS`, between the points too (`Profile.excess`); more points
are taken until that holds.

Failure: `JounceError` where no limit bounds the speed, where the speed of the given motion at an end is not possible,
as no u leads there, and where points do not suffice.

[1] H. Pham, Q.-C. Pham, A new approach to time-optimal path parameterization based on reachability analysis, IEEE
    Transactions on Robotics 34 (2018).
"""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names
from jounce.limits import path_terms
from jounce.limits.barrier import UNEVEN
from jounce.limits.limited_motion import known_kinds, motion_order
from jounce.limits.retime_problem import MAX_UNIFORM_SPEED, LimitRows, RetimeProblem, check_path
from jounce.model.limits import LIMIT_KINDS
from jounce.motion import Motion

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


SAMPLED_LAW = Remedy("smooth=False", "--no-smooth")
LINEAR_DRIVES = Remedy("robot.with_drives(['armature', 'spring', 'offset'])", "--drives armature,spring,offset")
_HIGHEST_RATE = 2  # of q, in limits that are linear in x and x'
_FIRST_COUNT, _MAX_COUNT = 300, 19_200  # intervals of even length; graded ones come in addition
_CAPS = (1e3, 2e4, 4e5)  # times the fastest uniform speed: the highest speed, raised where it decides
_MAX_BOUNDED_SHARE = 0.5  # of the speed that stands for infinity: uniform ones above it have no bound
_COST_OF_CAP = 3e-5  # of the duration
_LEAST_SPEED = 1.5e-5  # of the largest q'': x is as 1 / q'' near a rest, where the cap decides below this share
_INTERVALS_PER_LOG_SPEED = 4  # where q'' changes by a factor of e
_FIRST_TRIES, _MAX_TRY_HALVINGS = 301, 30  # of even points, at which speeds are looked at
_MAX_CAPPED_WAY = 0.01  # of the path: where the cap decides on more, no limit bounds the speed
_MAX_CHORD_ERROR = 0.01  # of the largest rate: what a rate of the path may be off its chord in the middle of intervals
_LEAST_REACHED = 1 - 1e-9  # of the square of a speed that is to remain at an end: less is not reached
_QUADRATIC = (path_terms.ONE, path_terms.S1_2, path_terms.S2)
MAX_EXCESS_ON_INTERVALS = 1e-4  # of a limit: what rows may exceed it by between the three points of an interval
_SHARES = np.array([0.0, 0.5, 1.0])[:, None]  # of an interval: where rows hold
_QUARTERS = np.array([0.25, 0.75])[:, None]
_FLAT_ROW = 1e-12  # of its bound: what u within its range adds to a row that bounds x alone
_MAX_SPEED_STEPS = 60  # of Newton's method on concave functions of a few dozen pieces, which takes three to five
_SPEED_ROUNDING = 1e-12  # of u: bounds of u that meet to rounding
_CAPS_TRIED = 200  # in a geometric series: the cap needs no digits
_NEAR_CAP, _SHARE_NEAR_CAP = 0.1, 1e-3  # of a cap, where x has a corner, and of the duration that is spent there
_RESERVE_NEAR_CAP = 5e-3  # of bounds, where that takes no time: the corner lies between points
_MAX_ROUNDS = 4  # one finds the profile, others remove what exceeds a bound between points


@dataclass(frozen=True, eq=False)
class PathRows:
    """R rows on N intervals of a path: ``lower <= G u + H x + g <= upper``.

    They hold at the start, middle and end of each interval.

    `G`, `H`, `g` are (3, N, R), the bounds (R,), `length` (N,) is that of the intervals.
    """

    length: np.ndarray
    G: np.ndarray
    H: np.ndarray
    g: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    @cached_property
    def alone(self) -> np.ndarray:
        """A mask of the rows (R,) that do not take u: those of velocities."""
        return np.asarray(~self.G.any(axis=(0, 1)))

    def uniform(self) -> float:
        """Return the largest constant x within all rows."""
        # u = 0: H x <= upper - g where H > 0, else H x >= lower - g.
        with np.errstate(divide="ignore", invalid="ignore"):
            most = np.where(self.H > 0, self.upper - self.g, self.lower - self.g) / self.H
        return float(np.where(self.H == 0, np.inf, most).min())


@dataclass(frozen=True, eq=False)
class Profile:
    """x and u on N intervals of a path.

    `x` (N + 1,) is at the ends of the intervals, `u` (N,) at their starts; `slope` (N,) is that of u on them.
    """

    x: np.ndarray
    u: np.ndarray
    slope: np.ndarray

    def at(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate x and u at distances from starts of intervals.

        The distances d are (..., N).
        """
        # x' = 2 u, so that a u linear in d makes x quadratic.
        return self.x[:-1] + d * (2 * self.u + d * self.slope), self.u + d * self.slope

    def duration(self, length: np.ndarray) -> float:
        """Return the duration, by a Gauss-Legendre rule on each interval."""
        nodes, weights = _gauss_legendre()
        # Nodes from -1 to 1 -> distances (4, N).
        x, _ = self.at(length / 2 * (1 + nodes[:, None]))
        return float((weights @ x.clip(np.finfo(float).tiny) ** -0.5 * length / 2).sum())

    def cap(self, length: np.ndarray, cost: float, highest: float) -> float:
        """Return a cap of x that costs a share of the duration.

        Where x is at the highest cap already, it does not count.
        """
        x, _ = self.at(length / 2)
        x, length = (part[x < highest / 2] for part in (x, length))
        if x.size == 0:
            return highest
        # Caps from the largest x downwards: the lowest one that costs no more than the share.
        caps = np.geomspace(x.max(), np.median(x), _CAPS_TRIED)
        with np.errstate(divide="ignore"):
            longer = (length * (caps[:, None] ** -0.5 - x**-0.5).clip(0)).sum(axis=1)
        return float(caps[np.searchsorted(longer, cost * (length * x**-0.5).sum(), side="right") - 1])

    def excess(self, rows: PathRows) -> np.ndarray:
        """Return by how much rows leave their bounds.

        The excess is (N, R): one for each interval and row. Between the three points of an interval the rows are
        parabolas through their values there.
        """
        x, u = self.at(_SHARES * rows.length)
        first, middle, last = rows.G * u[..., None] + rows.H * x[..., None] + rows.g
        # The parabola is middle + rise s + bend s^2 for |s| <= 1/2; its top counts if it lies within.
        rise, bend = last - first, 2 * (first + last - 2 * middle)
        with np.errstate(divide="ignore", invalid="ignore"):
            top = np.where(np.abs(rise) < np.abs(bend), middle - rise**2 / (4 * bend), middle)
        # Rows of x alone have kinks, where another joint decides: at quarters, from chords of their factors.
        chords = [(part[:-1] + part[1:]) / 2 for part in (rows.H, rows.g)]
        quarters = np.where(rows.alone, chords[0] * self.at(_QUARTERS * rows.length)[0][..., None] + chords[1], middle)
        values = np.stack([first, top, last, *quarters])
        return np.asarray(np.maximum(values - rows.upper, rows.lower - values).max(axis=0))


class FastestLaw(NamedTuple):
    """The law of least duration: x on intervals, which end at `sigma`, with the rows there."""

    sigma: np.ndarray
    rows: LimitRows
    profile: Profile

    @property
    def duration(self) -> float:
        """Return how long the path takes, s."""
        return self.profile.duration(np.diff(self.sigma))

    @property
    def jets(self) -> np.ndarray:
        """Return x, x', x'', x''' at the ends of intervals.

        Jets (4, N + 1) are at the starts of intervals and at the end of the path.
        """
        x, u, w = self.profile.x, self.profile.u, self.profile.slope
        # With x' = 2 u and x'' = 2 w; at the end of the path u is that of the last interval.
        last = u[-1:] + np.diff(self.sigma)[-1] * w[-1:]
        return np.stack([x, 2 * np.concatenate([u, last]), 2 * np.concatenate([w, w[-1:]]), 0 * x])

    @property
    def spline(self) -> "BSpline":
        """Return x as a spline of degree 2.

        Its derivative jumps at the ends of intervals.
        """
        from scipy.interpolate import BSpline

        x, u = self.profile.x, self.profile.u
        c = np.empty(2 * len(x) - 1)
        # Bernstein's coefficients: the ends of each interval, and between them what the slope at its start leads to.
        c[::2], c[1::2] = x, x[:-1] + np.diff(self.sigma) * u
        knots = np.repeat(self.sigma, 2)
        return BSpline(np.concatenate([knots[:1], knots, knots[-1:]]), c, 2, extrapolate=False)


def find_obstacle(problem: RetimeProblem) -> str | None:
    """Describe which limits are of higher order or not linear.

    The words also say what to do. None stands for limits that are all linear and of low order.
    """
    robot, m = problem.robot, problem.robot.mechanism
    kinds = [kind for kind in known_kinds(robot, problem.limits) if kind != "position"]
    unsupported = [
        kind
        for kind in kinds
        if motion_order(robot, kind) > _HIGHEST_RATE or LIMIT_KINDS[kind].of not in ("q", "Q") or LIMIT_KINDS[kind].line
    ]
    if len(unsupported) > 0:
        infinite = ", ".join(f"{kind}=float('inf')" for kind in unsupported)
        return (
            "limits of velocity, acceleration and effort; this robot also has limits of"
            f" {join_names([kind.replace('_', ' ') for kind in unsupported])}; omit {SAMPLED_LAW}"
            f"{Remedy(f', or remove them, robot.with_limits({infinite})')}"
        )
    # Forces with friction or damping take s1 = sqrt(x), and are not linear in x and u.
    acting = []
    if problem.friction is not None:
        acting.append("friction")
    if "damping" in m.acting and m.drives.damping.any():
        acting.append("damping")
    if len(acting) > 0 and any(LIMIT_KINDS[kind].force for kind in kinds):
        return (
            f"effort limits without {join_names(acting)}, which is not linear in the square of the speed;"
            f" omit {SAMPLED_LAW}, or take {LINEAR_DRIVES}, and check the result with it"
        )
    return None


def find_fastest_law(problem: RetimeProblem) -> FastestLaw:
    """Find the time law of least duration.

    The number of intervals doubles until they are short enough.
    """
    count = _FIRST_COUNT
    while count <= _MAX_COUNT:
        # Once for each number of points: sample the path, build the rows, and search for x on them.
        path = _IntervalPath.sample(problem, count)
        if count == _FIRST_COUNT:
            check_path(problem, path.points, path.path)
        if path.is_resolved():
            rows = problem.rows(path.path, MAX_UNIFORM_SPEED)
            profile = _find_profile(problem, path, path.linear_rows(rows))
            if profile is not None:
                ends = np.append(path.places[0], path.places[2][-1])
                return FastestLaw(path.sigma, rows.select(ends), profile)
        count *= 2
    raise JounceError(UNEVEN)


class _IntervalPath(NamedTuple):
    """The path at `points`: the ends of intervals, their middles, and breaks once more.

    At ends that are breaks the path is that of the right side; what ends at the breaks comes last.

    `places` (3, N) are those of the start, middle and end of each interval among the points.
    """

    sigma: np.ndarray
    points: np.ndarray
    path: path_terms.Path
    places: np.ndarray

    @classmethod
    def sample(cls, problem: RetimeProblem, count: int) -> "_IntervalPath":
        """Sample the path of a problem on intervals.

        Intervals end at the breaks of the motion.
        """
        motion = problem.motion
        breaks = np.unique([motion_break.t for motion_break in motion.breaks_to(_HIGHEST_RATE)])
        breaks = breaks[(breaks > motion.start) & (breaks < motion.stop)]
        sigma = np.union1d(_place_points(motion, count), breaks)
        points = np.concatenate([sigma, (sigma[1:] + sigma[:-1]) / 2])
        path = path_terms.sample_path(problem.robot, motion, points, 0)
        n = len(sigma) - 1
        # Places of starts, middles and ends: i, n + 1 + i and i + 1.
        places = np.arange(n) + np.array([[0], [n + 1], [1]])
        if breaks.size > 0:
            # Intervals that end at a break have the left side there.
            path = path.join_points(path_terms.sample_path(problem.robot, motion, breaks, 0, left=True))
            places[2, np.searchsorted(sigma, breaks) - 1] = len(points) + np.arange(len(breaks))
        return cls(sigma, np.concatenate([points, breaks]), path, places)

    def is_resolved(self) -> bool:
        """Whether the intervals are short enough for the rates of the path.

        Velocities and their derivatives are near to chords on all intervals, and q to the integral of its velocity.
        """
        length = np.diff(self.sigma)[:, None]
        # q' and q'': what G, H and g of the rows are made of.
        for rate in self.path.q[1:3]:
            first, middle, last = rate[self.places]
            if np.abs((first + last) / 2 - middle).max() > _MAX_CHORD_ERROR * np.abs(rate).max():
                return False
        first, middle, last = self.path.q[1][self.places]
        q = self.path.q[0][: len(self.sigma)]
        # Between the ends of intervals q changes by the integral of q', by Simpson's rule.
        missed = np.abs(np.diff(q, axis=0) - length * (first + 4 * middle + last) / 6).max()
        return bool(missed <= _MAX_CHORD_ERROR * np.ptp(q, axis=0).max())

    def linear_rows(self, rows: LimitRows) -> PathRows:
        """Return the rows of x and u on the intervals.

        `rows` are those at the points.
        """
        # Of the products only 1, s1^2 = x and s2 = u occur: their factors are g, H and G, 0 where no row takes them.
        used, zero = rows.used.tolist(), np.zeros(rows.factors.shape[:2])
        g, H, G = (rows.factors[:, :, used.index(k)] if k in used else zero for k in _QUADRATIC)
        # (points, R) -> (3, N, R)
        G, H, g = (part[self.places] for part in (G, H, g))
        return PathRows(np.diff(self.sigma), G, H, g, rows.lower, rows.upper)


def _place_points(motion: Motion, count: int) -> np.ndarray:
    """Place points on the path: even ones, and more where x changes by factors."""
    sigma = np.linspace(motion.start, motion.stop, _FIRST_TRIES)
    # The largest q' and q'', the units of `_log_speed`; 1 where a rate is zero all along.
    scale = []
    for rate in motion(sigma, 2)[1:]:
        largest = float(np.linalg.norm(rate, axis=1).max())
        scale.append(1.0 if largest == 0 else largest)
    speed = _log_speed(motion, sigma, scale)
    for _ in range(_MAX_TRY_HALVINGS):
        # Halve intervals until the logarithm of the speed changes by no more than 1 on any, as towards rests.
        steep = np.abs(np.diff(speed)) > 1
        if not steep.any():
            break
        middle = (sigma[1:] + sigma[:-1])[steep] / 2
        both_sigma, both_speed = (
            np.concatenate([sigma, middle]),
            np.concatenate([speed, _log_speed(motion, middle, scale)]),
        )
        order = np.argsort(both_sigma, kind="stable")
        sigma, speed = both_sigma[order], both_speed[order]
    # A density of intervals: even ones, and some for each factor of e. Its integral, inverted, places them.
    graded = count * np.diff(sigma) / motion.duration + _INTERVALS_PER_LOG_SPEED * np.abs(np.diff(speed))
    intervals_before = np.concatenate([[0.0], np.cumsum(graded)])
    intervals = intervals_before[-1]
    return np.interp(np.linspace(0, intervals, int(np.ceil(intervals)) + 1), intervals_before, sigma)


def _log_speed(motion: Motion, sigma: np.ndarray, scale: list[float]) -> np.ndarray:
    """Return the logarithm of what bounds x: q' and, near rests, q''.

    It does not fall below where the cap decides.
    """
    shares = [np.linalg.norm(rate, axis=1) / size for rate, size in zip(motion(sigma, 2)[1:], scale, strict=True)]
    return np.asarray(np.log(shares[0] + shares[1] + _LEAST_SPEED))


def _find_profile(problem: RetimeProblem, path: _IntervalPath, rows: PathRows) -> Profile | None:
    """Find the fastest profile; return None where the points are too few.

    They are too few where rows exceed their bounds between them, or x is not above 0.
    """
    uniform = 1.0 if any(problem.moving) else np.sqrt(rows.uniform())
    # Without any limit the rows still keep speeds below MAX_UNIFORM_SPEED: one that comes near is not bounded.
    if uniform > _MAX_BOUNDED_SHARE * MAX_UNIFORM_SPEED:
        raise problem.unbounded_error()
    # sigma is the time of the given motion: where it moves at an end, x = 1 there.
    first, last = (1.0 if moves else None for moves in problem.moving)
    way = np.abs(path.path.q[1][path.places[1]]).sum(axis=1) * rows.length
    # Raise the cap until it decides on hardly any of the way, else no limit bounds the speed.
    for factor in _CAPS:
        cap = (factor * uniform) ** 2
        profile = find_first(rows, cap, first, last)
        if way[profile.at(rows.length / 2)[0] > cap / 4].sum() <= _MAX_CAPPED_WAY * way.sum():
            break
    else:
        raise problem.unbounded_error()
    # A lower cap then costs hardly any time, and leaves rests more smoothly.
    profile = refine_profile(rows, profile, profile.cap(rows.length, _COST_OF_CAP, cap), first, last)
    for moves, x, end in zip(problem.moving, (profile.x[0], profile.x[-1]), ("start", "end"), strict=True):
        if moves and x < _LEAST_REACHED:
            raise JounceError(
                f"the motion moves at its {end}, and no time law keeps the velocity there within the limits;"
                f" expected a motion from rest to rest, or a slower one{Remedy(': motion.scaled(2)')}"
            )
    positive = profile.at(rows.length / 2)[0].min() > 0 and profile.x.min() > 0
    return profile if positive and profile.excess(rows).max() <= MAX_EXCESS_ON_INTERVALS else None


@cache
def _gauss_legendre() -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes from -1 to 1 and their weights."""
    return np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False)
class _Steps:
    """What a step over each interval does: the least of affine functions of x.

    Backwards it takes x at the end to the largest x at the start, min(most, back x + back_offset); forwards it takes x
    at the start to the largest x at the end, ahead x + ahead_offset. `most` is (N,), the others are (N, L), of L lines.
    """

    most: np.ndarray  # x at the start for which any u is left
    back: np.ndarray
    back_offset: np.ndarray
    ahead: np.ndarray
    ahead_offset: np.ndarray


# Reachability analysis: a pass backwards, then one forwards, in a few rounds.
def find_first(rows: PathRows, cap: float, first: float | None = None, last: float | None = None) -> Profile:
    """Find the fastest x below a cap with u constant on intervals.

    x begins at `first` and ends at most at `last`, where these are given.
    """
    no_slope = np.zeros(len(rows.length))
    return _find_round(rows, no_slope, np.zeros((len(no_slope), len(rows.upper))), cap, first, last)


def refine_profile(
    rows: PathRows, coarse: Profile, cap: float, first: float | None = None, last: float | None = None
) -> Profile:
    """Find the fastest x below a cap with u linear on intervals.

    The slopes of u are estimated from the profile of the round before, first from the coarse one. The result is the
    round that exceeds its bounds least.
    """
    best, least_excess, profile = coarse, np.inf, coarse
    # What the bounds of each row are drawn in by, (N, R), and where u may have a slope, (N,).
    reserve = np.zeros((len(rows.length), len(rows.upper)))
    may_bend = np.ones(len(rows.length), dtype=bool)
    for _ in range(_MAX_ROUNDS):
        # Near the cap x has a corner between points. A reserve of all bounds costs hardly any time there.
        high = np.maximum(profile.x[1:], profile.x[:-1])
        near_cap = high > _NEAR_CAP * cap
        if profile.duration(rows.length * near_cap) < _SHARE_NEAR_CAP * profile.duration(rows.length):
            reserve[near_cap] = reserve[near_cap].clip(_RESERVE_NEAR_CAP)
        # u in the middle of intervals yields its slopes; above the cap it has none.
        middle_u = profile.u + profile.slope * rows.length / 2
        slope = _estimate_slopes(middle_u, rows.length) * (may_bend & (high <= cap))
        following = _find_round(rows, slope, reserve, cap, first, last)
        # A slope may ask for more than the limits leave at rest, so that x falls below 0: there and next to it u is
        # constant in the next round.
        below_zero = ~(following.at(_SHARES * rows.length)[0].min(axis=0) > 0)
        if below_zero.any():
            may_bend &= ~(below_zero | np.roll(below_zero, 1) | np.roll(below_zero, -1))
            continue
        profile = following
        excess = profile.excess(rows)
        largest_excess = float(excess.max())
        if largest_excess < least_excess:
            best, least_excess = profile, largest_excess
        if largest_excess <= MAX_EXCESS_ON_INTERVALS:
            break
        # Bounds are drawn in by what exceeds them between the three points of intervals.
        reserve = reserve + excess.clip(0)
    return best


def _find_round(
    rows: PathRows, slope: np.ndarray, reserve: np.ndarray, cap: float, first: float | None, last: float | None
) -> Profile:
    """Find the fastest x with given slopes of u.

    Bounds are drawn in by `reserve` (N, R).
    """
    steps = _build_steps(rows, slope, reserve, cap)
    x = _pass_forward(steps, _pass_backward(steps, cap if last is None else last), first)
    # Over an interval x changes by 2 u length + slope length^2: u follows from x at both ends.
    return Profile(x, (np.diff(x) / rows.length - rows.length * slope) / 2, slope)


def _build_steps(rows: PathRows, slope: np.ndarray, reserve: np.ndarray, cap: float) -> _Steps:
    """Build what a step over each interval does.

    The steps follow from the half-planes of x and u at the starts of the intervals.
    """
    # x and u at the three points are affine in those at the start, and so are the rows: A u + H x + rest.
    d = _SHARES * rows.length
    u_added = d * slope
    A = rows.G + 2 * d[..., None] * rows.H
    rest = rows.g + u_added[..., None] * rows.G + (u_added * d)[..., None] * rows.H
    upper, lower = rows.upper - reserve - rest, rows.lower + reserve - rest
    # Rows of x alone hold at the ends of intervals: with those in the middle x would swing from one to the other.
    upper[1][:, rows.alone], lower[1][:, rows.alone] = np.inf, -np.inf
    # Each row bounds u by two lines, m x + low <= u <= m x + high. Where A is as good as zero, it bounds x alone.
    flat = np.abs(A) * (cap / (2 * rows.length))[:, None] < _FLAT_ROW
    A = np.where(flat, 1.0, A)
    m = np.where(flat, 0.0, -rows.H / A)
    high = np.where(flat, np.inf, np.where(A > 0, upper, lower) / A)
    low = np.where(flat, -np.inf, np.where(A > 0, lower, upper) / A)
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = np.where(rows.H > 0, upper, lower) / rows.H
        most = np.minimum(cap, np.where(flat & (rows.H != 0), bound, np.inf).min(axis=(0, 2)))
    # (3, N, R) -> (N, L) with L = 3 R lines.
    m, high, low = (np.moveaxis(part, 1, 0).reshape(len(slope), -1) for part in (m, high, low))
    # The next x is c x + 2 length n + length^2 w on a line u = m x + n.
    twice, added = 2 * rows.length[:, None], (rows.length**2 * slope)[:, None]
    c, ahead, lowest = 1 + twice * m, twice * high + added, twice * low + added
    with np.errstate(divide="ignore", invalid="ignore"):
        # The next x has to be >= 0: for c < 0 this bounds x at the start.
        most = np.minimum(most, np.where(c < 0, -ahead / c, np.inf).min(axis=1))
        # Backwards: the smallest u leads to c x + lowest, which has to be at most the next x. For c <= 0 a larger x
        # makes that easier, and nothing is bounded.
        back = np.where(c > 0, 1 / c, 0.0)
        back_offset = np.where((c > 0) & np.isfinite(lowest), -lowest / c, np.inf)
    return _Steps(_highest_speeds(m, high, low, most), back, back_offset, c, ahead)


def _highest_speeds(m: np.ndarray, high: np.ndarray, low: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Return the largest x (N,) at which a u is left.

    u has to be between lines (N, L). The room for u, the least upper line less the highest lower one, is a concave
    function of x, piecewise linear. Newton's method finds its zero from above: it goes to where the two lines that are
    nearest now meet.
    """
    row = np.arange(len(most))
    for _ in range(_MAX_SPEED_STEPS):
        # The lines that bound u most at this x.
        above, below = m * most[:, None] + high, m * most[:, None] + low
        i, j = above.argmin(axis=1), below.argmax(axis=1)
        # Where they cross, no u is left: x falls.
        over = below[row, j] - above[row, i] > _SPEED_ROUNDING * np.abs(above[row, i])
        if not over.any():
            break
        fall = np.where(over, m[row, j] - m[row, i], 1.0)
        most = np.where(over, (high[row, i] - low[row, j]) / fall, most)
    return most


def _pass_backward(steps: _Steps, last: float) -> list[float]:
    """Return the largest controllable x (N + 1,).

    The pass begins at the end of the path, where x is at most `last`.
    """
    least, x = np.minimum.reduce, last
    K = [last]
    for most, factor, offset in zip(steps.most[::-1].tolist(), steps.back[::-1], steps.back_offset[::-1], strict=True):
        x = min(most, float(least(factor * x + offset)))
        K.append(x)
    return K[::-1]


def _pass_forward(steps: _Steps, K: list[float], first: float | None) -> np.ndarray:
    """Return the largest x (N + 1,) within the controllable ones.

    The pass begins at the start of the path, where x is at most `first`.
    """
    least, x = np.minimum.reduce, K[0] if first is None else min(first, K[0])
    profile = [x]
    for most, factor, offset in zip(K[1:], steps.ahead, steps.ahead_offset, strict=True):
        x = min(most, float(least(factor * x + offset)))
        profile.append(x)
    return np.array(profile)


def _estimate_slopes(u: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Estimate the slopes of u on intervals: minmod.

    u is known in the middles of the intervals. The slope is the smaller one of both sides, or 0 where u turns.
    """
    steep = 2 * np.diff(u) / (length[1:] + length[:-1])
    before, after = np.concatenate([[0.0], steep]), np.concatenate([steep, [0.0]])
    smaller = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(before * after > 0, smaller, 0.0)
