"""The fastest law of all under limits of first and second order is found by reachability analysis.

Problem: x(sigma) >= 0 of least duration, the integral of x^(-1/2), with ``lower <= G u + H x + g <= upper`` along the
path, where x = sigma'^2 and ``u = sigma'' = x'/2``: limits of velocities, accelerations and forces that are quadratic
in speed are linear in x and u.

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
    """R rows at the start, middle and end of N intervals of a path: ``lower <= G u + H x + g <= upper``.

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
        """Which rows (R,) do not take u."""
        return np.asarray(~self.G.any(axis=(0, 1)))

    def uniform(self) -> float:
        """The largest x that, constant along the path, is within all rows."""
        with np.errstate(divide="ignore", invalid="ignore"):
            most = np.where(self.H > 0, self.upper - self.g, self.lower - self.g) / self.H
        return float(np.where(self.H == 0, np.inf, most).min())


@dataclass(frozen=True, eq=False)
class Profile:
    """x (N + 1,) at the ends of intervals, u (N,) at their starts, and its slope (N,) on them."""

    x: np.ndarray
    u: np.ndarray
    slope: np.ndarray

    def at(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x and u at distances d (..., N) from the starts of the intervals."""
        return self.x[:-1] + d * (2 * self.u + d * self.slope), self.u + d * self.slope

    def duration(self, length: np.ndarray) -> float:
        """The integral of x^(-1/2) by the rule of Gauss and Legendre on each interval."""
        nodes, weights = _gauss_legendre()
        x, _ = self.at(length / 2 * (1 + nodes[:, None]))
        return float((weights @ x.clip(np.finfo(float).tiny) ** -0.5 * length / 2).sum())

    def cap(self, length: np.ndarray, cost: float, highest: float) -> float:
        """A cap of x that makes the duration longer by a share, but for where x is at the highest cap already."""
        x, _ = self.at(length / 2)
        x, length = (part[x < highest / 2] for part in (x, length))
        if not x.size:  # it is at the highest cap all along
            return highest
        caps = np.geomspace(x.max(), np.median(x), _CAPS_TRIED)
        with np.errstate(divide="ignore"):
            longer = (length * (caps[:, None] ** -0.5 - x**-0.5).clip(0)).sum(axis=1)
        return float(caps[np.searchsorted(longer, cost * (length * x**-0.5).sum(), side="right") - 1])

    def excess(self, rows: PathRows) -> np.ndarray:
        """By how much rows leave their bounds on each interval (N, R), between its three points by parabolas."""
        x, u = self.at(_SHARES * rows.length)
        first, middle, last = rows.G * u[..., None] + rows.H * x[..., None] + rows.g
        rise, bend = last - first, 2 * (first + last - 2 * middle)  # value: middle + rise s + bend s^2, |s| <= 1/2
        with np.errstate(divide="ignore", invalid="ignore"):
            top = np.where(np.abs(rise) < np.abs(bend), middle - rise**2 / (4 * bend), middle)
        # Rows of x alone have kinks, where another joint decides: at quarters, from chords.
        chords = [(part[:-1] + part[1:]) / 2 for part in (rows.H, rows.g)]
        quarters = np.where(rows.alone, chords[0] * self.at(_QUARTERS * rows.length)[0][..., None] + chords[1], middle)
        values = np.stack([first, top, last, *quarters])
        return np.asarray(np.maximum(values - rows.upper, rows.lower - values).max(axis=0))


class FastestLaw(NamedTuple):
    """The rows at the ends of intervals, before which `sigma` they begin, and x on the intervals."""

    sigma: np.ndarray
    rows: LimitRows
    profile: Profile

    @property
    def duration(self) -> float:
        """How long the path takes, s."""
        return self.profile.duration(np.diff(self.sigma))

    @property
    def jets(self) -> np.ndarray:
        """x, x', x'', x''' at the starts of the intervals and at the end of the path, (4, N + 1)."""
        x, u, w = self.profile.x, self.profile.u, self.profile.slope
        last = u[-1:] + np.diff(self.sigma)[-1] * w[-1:]
        return np.stack([x, 2 * np.concatenate([u, last]), 2 * np.concatenate([w, w[-1:]]), 0 * x])

    @property
    def spline(self) -> "BSpline":
        """x as a spline of degree 2, whose derivative jumps at the ends of intervals."""
        from scipy.interpolate import BSpline

        x, u = self.profile.x, self.profile.u
        c = np.empty(2 * len(x) - 1)
        c[::2], c[1::2] = x, x[:-1] + np.diff(self.sigma) * u  # Bernstein's coefficients
        knots = np.repeat(self.sigma, 2)
        return BSpline(np.concatenate([knots[:1], knots, knots[-1:]]), c, 2, extrapolate=False)


def find_obstacle(problem: RetimeProblem) -> str | None:
    """Which limits are of higher order or not linear, and what to do; None where all are linear and of low order."""
    robot, m = problem.robot, problem.robot.mechanism
    kinds = [kind for kind in known_kinds(robot, problem.limits) if kind != "position"]
    many = [
        kind
        for kind in kinds
        if motion_order(robot, kind) > _HIGHEST_RATE or LIMIT_KINDS[kind].of not in ("q", "Q") or LIMIT_KINDS[kind].line
    ]
    if many:
        infinite = ", ".join(f"{kind}=float('inf')" for kind in many)
        return (
            "limits of velocity, acceleration and effort; this robot also has limits of"
            f" {join_names([kind.replace('_', ' ') for kind in many])}; omit {SAMPLED_LAW}"
            f"{Remedy(f', or remove them, robot.with_limits({infinite})')}"
        )
    acting = ["friction"] * (problem.friction is not None)
    if "damping" in m.acting and m.drives.damping.any():
        acting.append("damping")
    if acting and any(LIMIT_KINDS[kind].force for kind in kinds):
        return (
            f"effort limits without {join_names(acting)}, which is not linear in the square of the speed;"
            f" omit {SAMPLED_LAW}, or take {LINEAR_DRIVES}, and check the result with it"
        )
    return None


def find_fastest_law(problem: RetimeProblem) -> FastestLaw:
    """The time law of least duration, at as many points as it takes."""
    count = _FIRST_COUNT
    while count <= _MAX_COUNT:
        path = _IntervalPath.sample(problem, count)
        if count == _FIRST_COUNT:
            check_path(problem, path.points, path.path)
        if path.is_resolved():
            rows = problem.rows(path.path, MAX_UNIFORM_SPEED)
            found = _find_profile(problem, path, path.linear_rows(rows))
            if found is not None:
                ends = np.append(path.places[0], path.places[2][-1])
                return FastestLaw(path.sigma, rows.select(ends), found)
        count *= 2
    raise JounceError(UNEVEN)


class _IntervalPath(NamedTuple):
    """The path at `points`: the ends of intervals, their middles, and breaks from the left.

    `places` (3, N) are those of the start, middle and end of each interval among the points.
    """

    sigma: np.ndarray
    points: np.ndarray
    path: path_terms.Path
    places: np.ndarray

    @classmethod
    def sample(cls, problem: RetimeProblem, count: int) -> "_IntervalPath":
        """The path of a problem on some intervals, which end at its breaks."""
        motion = problem.motion
        breaks = np.unique([found.t for found in motion.breaks_to(_HIGHEST_RATE)])
        breaks = breaks[(breaks > motion.start) & (breaks < motion.stop)]
        sigma = np.union1d(_place_points(motion, count), breaks)
        points = np.concatenate([sigma, (sigma[1:] + sigma[:-1]) / 2])
        path = path_terms.sample_path(problem.robot, motion, points, 0)
        n = len(sigma) - 1
        places = np.arange(n) + np.array([[0], [n + 1], [1]])
        if breaks.size:
            path = path.join_points(path_terms.sample_path(problem.robot, motion, breaks, 0, left=True))
            places[2, np.searchsorted(sigma, breaks) - 1] = len(points) + np.arange(len(breaks))
        return cls(sigma, np.concatenate([points, breaks]), path, places)

    def is_resolved(self) -> bool:
        """Whether velocities and their derivatives are near to chords on all intervals, and q to their integral."""
        length = np.diff(self.sigma)[:, None]
        for rate in self.path.q[1:3]:
            first, middle, last = rate[self.places]
            if np.abs((first + last) / 2 - middle).max() > _MAX_CHORD_ERROR * np.abs(rate).max():
                return False
        first, middle, last = self.path.q[1][self.places]
        q = self.path.q[0][: len(self.sigma)]
        missed = np.abs(np.diff(q, axis=0) - length * (first + 4 * middle + last) / 6).max()  # by Simpson's rule
        return bool(missed <= _MAX_CHORD_ERROR * np.ptp(q, axis=0).max())

    def linear_rows(self, rows: LimitRows) -> PathRows:
        """Rows of x and u on the intervals, from those at the points."""
        used, none = rows.used.tolist(), np.zeros(rows.factors.shape[:2])
        g, H, G = (rows.factors[:, :, used.index(k)] if k in used else none for k in _QUADRATIC)
        G, H, g = (part[self.places] for part in (G, H, g))
        return PathRows(np.diff(self.sigma), G, H, g, rows.lower, rows.upper)


def _place_points(motion: Motion, count: int) -> np.ndarray:
    """Points of the path: even ones, and more where x changes by factors, as towards rests."""
    sigma = np.linspace(motion.start, motion.stop, _FIRST_TRIES)
    scale = [float(np.linalg.norm(rate, axis=1).max()) or 1.0 for rate in motion(sigma, 2)[1:]]  # of q' and q''
    speed = _log_speed(motion, sigma, scale)
    for _ in range(_MAX_TRY_HALVINGS):
        steep = np.abs(np.diff(speed)) > 1
        if not steep.any():
            break
        middle = (sigma[1:] + sigma[:-1])[steep] / 2
        order = np.argsort(both := np.concatenate([sigma, middle]), kind="stable")
        sigma, speed = both[order], np.concatenate([speed, _log_speed(motion, middle, scale)])[order]
    graded = count * np.diff(sigma) / motion.duration + _INTERVALS_PER_LOG_SPEED * np.abs(np.diff(speed))
    placed = np.concatenate([[0.0], np.cumsum(graded)])
    return np.interp(np.linspace(0, placed[-1], int(np.ceil(placed[-1])) + 1), placed, sigma)


def _log_speed(motion: Motion, sigma: np.ndarray, scale: list[float]) -> np.ndarray:
    """The logarithm of what bounds x: q' and, near rests, q''; not below where the cap decides."""
    shares = [np.linalg.norm(rate, axis=1) / size for rate, size in zip(motion(sigma, 2)[1:], scale, strict=True)]
    return np.asarray(np.log(shares[0] + shares[1] + _LEAST_SPEED))


def _find_profile(problem: RetimeProblem, path: _IntervalPath, rows: PathRows) -> Profile | None:
    """The fastest profile; None where rows exceed their bounds between the points, which are too few."""
    uniform = 1.0 if any(problem.moving) else np.sqrt(rows.uniform())
    if uniform > _MAX_BOUNDED_SHARE * MAX_UNIFORM_SPEED:
        raise problem.unbounded_error()
    first, last = (1.0 if moves else None for moves in problem.moving)
    way = np.abs(path.path.q[1][path.places[1]]).sum(axis=1) * rows.length
    for factor in _CAPS:
        cap = (factor * uniform) ** 2
        found = find_first(rows, cap, first, last)
        if way[found.at(rows.length / 2)[0] > cap / 4].sum() <= _MAX_CAPPED_WAY * way.sum():
            break
    else:
        raise problem.unbounded_error()
    found = refine_profile(rows, found, found.cap(rows.length, _COST_OF_CAP, cap), first, last)
    for moves, x, end in zip(problem.moving, (found.x[0], found.x[-1]), ("start", "end"), strict=True):
        if moves and x < _LEAST_REACHED:
            raise JounceError(
                f"the motion moves at its {end}, and no time law keeps the velocity there within the limits;"
                f" expected a motion from rest to rest, or a slower one{Remedy(': motion.scaled(2)')}"
            )
    valid = found.at(rows.length / 2)[0].min() > 0 and found.x.min() > 0
    return found if valid and found.excess(rows).max() <= MAX_EXCESS_ON_INTERVALS else None


@cache
def _gauss_legendre() -> tuple[np.ndarray, np.ndarray]:
    return np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False)
class _Steps:
    """The least of affine functions that each interval takes: of x at its end backwards, of x at its start forwards."""

    most: np.ndarray  # x at the start for which any u is left
    back: np.ndarray
    back_offset: np.ndarray
    ahead: np.ndarray
    ahead_offset: np.ndarray


# Reachability analysis: a pass backwards, then one forwards, in a few rounds.
def find_first(rows: PathRows, cap: float, first: float | None = None, last: float | None = None) -> Profile:
    """The fastest x below a cap with u constant on intervals, from `first` to at most `last` where these are given."""
    none = np.zeros(len(rows.length))
    return _find_round(rows, none, np.zeros((len(none), len(rows.upper))), cap, first, last)


def refine_profile(
    rows: PathRows, coarse: Profile, cap: float, first: float | None = None, last: float | None = None
) -> Profile:
    """The fastest x below a cap with u linear on intervals, of slopes that those of another profile are near to."""
    best, least, found = coarse, np.inf, coarse
    taken = np.zeros((len(rows.length), len(rows.upper)))
    bent = np.ones(len(rows.length), dtype=bool)  # where u has a slope
    for _ in range(_MAX_ROUNDS):
        high = np.maximum(found.x[1:], found.x[:-1])
        near = high > _NEAR_CAP * cap
        if found.duration(rows.length * near) < _SHARE_NEAR_CAP * found.duration(rows.length):
            taken[near] = taken[near].clip(_RESERVE_NEAR_CAP)
        slope = _estimate_slopes(found.u + found.slope * rows.length / 2, rows.length) * (bent & (high <= cap))
        following = _find_round(rows, slope, taken, cap, first, last)
        if (below := ~(following.at(_SHARES * rows.length)[0].min(axis=0) > 0)).any():
            bent &= ~(below | np.roll(below, 1) | np.roll(below, -1))  # slopes beyond what the limits leave at rest
            continue
        # Bounds are drawn in by what exceeds them between the three points of intervals.
        found = following
        excess = found.excess(rows)
        if (size := float(excess.max())) < least:
            best, least = found, size
        if size <= MAX_EXCESS_ON_INTERVALS:
            break
        taken = taken + excess.clip(0)
    return best


def _find_round(
    rows: PathRows, slope: np.ndarray, taken: np.ndarray, cap: float, first: float | None, last: float | None
) -> Profile:
    """The fastest x with given slopes of u, and bounds drawn in by what is `taken` (N, R)."""
    steps = _build_steps(rows, slope, taken, cap)
    x = _pass_forward(steps, _pass_backward(steps, cap if last is None else last), first)
    return Profile(x, (np.diff(x) / rows.length - rows.length * slope) / 2, slope)


def _build_steps(rows: PathRows, slope: np.ndarray, taken: np.ndarray, cap: float) -> _Steps:
    """The half-planes of x and u at the starts of intervals, and what a step does with them."""
    # x and u at the three points are affine in those at the start, and so are the rows: A u + H x + rest.
    d = _SHARES * rows.length
    bent = d * slope
    A = rows.G + 2 * d[..., None] * rows.H
    rest = rows.g + bent[..., None] * rows.G + (bent * d)[..., None] * rows.H
    upper, lower = rows.upper - taken - rest, rows.lower + taken - rest
    # Rows of x alone hold at the ends of intervals: with those in the middle x would swing from one to the other.
    upper[1][:, rows.alone], lower[1][:, rows.alone] = np.inf, -np.inf
    flat = np.abs(A) * (cap / (2 * rows.length))[:, None] < _FLAT_ROW
    A = np.where(flat, 1.0, A)
    m = np.where(flat, 0.0, -rows.H / A)
    high = np.where(flat, np.inf, np.where(A > 0, upper, lower) / A)
    low = np.where(flat, -np.inf, np.where(A > 0, lower, upper) / A)
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = np.where(rows.H > 0, upper, lower) / rows.H
        most = np.minimum(cap, np.where(flat & (rows.H != 0), bound, np.inf).min(axis=(0, 2)))
    m, high, low = (np.moveaxis(part, 1, 0).reshape(len(slope), -1) for part in (m, high, low))
    # The next x is c x + 2 length n + length^2 w on a line u = m x + n.
    twice, added = 2 * rows.length[:, None], (rows.length**2 * slope)[:, None]
    c, ahead, behind = 1 + twice * m, twice * high + added, twice * low + added
    with np.errstate(divide="ignore", invalid="ignore"):
        most = np.minimum(most, np.where(c < 0, -ahead / c, np.inf).min(axis=1))  # from where the next x is >= 0
        back = np.where(c > 0, 1 / c, 0.0)
        back_offset = np.where((c > 0) & np.isfinite(behind), -behind / c, np.inf)
    return _Steps(_highest_speeds(m, high, low, most), back, back_offset, c, ahead)


def _highest_speeds(m: np.ndarray, high: np.ndarray, low: np.ndarray, most: np.ndarray) -> np.ndarray:
    """The largest x (N,) at which a u is left between lines (N, L): Newton's method on a concave function."""
    row = np.arange(len(most))
    for _ in range(_MAX_SPEED_STEPS):
        above, below = m * most[:, None] + high, m * most[:, None] + low
        i, j = above.argmin(axis=1), below.argmax(axis=1)
        over = below[row, j] - above[row, i] > _SPEED_ROUNDING * np.abs(above[row, i])
        if not over.any():
            break
        fall = np.where(over, m[row, j] - m[row, i], 1.0)
        most = np.where(over, (high[row, i] - low[row, j]) / fall, most)
    return most


def _pass_backward(steps: _Steps, last: float) -> list[float]:
    """The largest controllable x (N + 1,), from that at the end."""
    least, x = np.minimum.reduce, last
    K = [last]
    for most, factor, offset in zip(steps.most[::-1].tolist(), steps.back[::-1], steps.back_offset[::-1], strict=True):
        K.append(x := min(most, float(least(factor * x + offset))))
    return K[::-1]


def _pass_forward(steps: _Steps, K: list[float], first: float | None) -> np.ndarray:
    """The largest x (N + 1,) within the controllable ones, from that at the start."""
    least, now = np.minimum.reduce, K[0] if first is None else min(first, K[0])
    x = [now]
    for most, factor, offset in zip(K[1:], steps.ahead, steps.ahead_offset, strict=True):
        x.append(now := min(most, float(least(factor * now + offset))))
    return np.array(x)


def _estimate_slopes(u: np.ndarray, length: np.ndarray) -> np.ndarray:
    """The slopes of u on intervals from its values in their middles: the smaller of both sides, or 0 where u turns."""
    steep = 2 * np.diff(u) / (length[1:] + length[:-1])
    before, after = np.concatenate([[0.0], steep]), np.concatenate([steep, [0.0]])
    smaller = np.where(np.abs(before) < np.abs(after), before, after)
    return np.where(before * after > 0, smaller, 0.0)
