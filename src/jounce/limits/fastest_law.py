"""The time law of least duration under limits of first and second order alone: its path, its rows, what is refused.

Limits of velocities, accelerations and forces that are quadratic in speed are linear in x = sigma'^2 and u = sigma'',
and `reachability` finds the largest x at points of the path. These lie closer together where the speed of the given
motion changes by factors: sigma is its time, so that x grows without bound, as 1 / q'', towards a rest from which the
result starts with an acceleration that is not zero. x stays below a cap that costs `_COST_OF_CAP` of the duration: the
result leaves a rest as smoothly as the given motion does, within about this share of its duration.

Invariant: no row exceeds its bound by more than `MAX_EXCESS_ON_INTERVALS`, between the points too; more points are
taken until that holds.

Failure: `JounceError` where a limit is of higher order or not linear, where no limit bounds the speed, where the speed
of the given motion at an end is not possible, and where points do not suffice.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names
from jounce.limits import path_velocity
from jounce.limits.barrier import UNEVEN
from jounce.limits.limit_rows import LimitRows
from jounce.limits.limited_motion import known_kinds, motion_order
from jounce.limits.path import Path, sample_path
from jounce.limits.reachability import MAX_EXCESS_ON_INTERVALS, PathRows, Profile, find_first, refine_profile
from jounce.limits.retime_problem import MAX_UNIFORM_SPEED, RetimeProblem, check_path
from jounce.model.limit_kinds import LIMIT_KINDS
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
_QUADRATIC = (path_velocity.ONE, path_velocity.S1_2, path_velocity.S2)


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
    path: Path
    places: np.ndarray

    @classmethod
    def sample(cls, problem: RetimeProblem, count: int) -> "_IntervalPath":
        """The path of a problem on some intervals, which end at its breaks."""
        motion = problem.motion
        breaks = np.unique([found.t for found in motion.breaks_to(_HIGHEST_RATE)])
        breaks = breaks[(breaks > motion.start) & (breaks < motion.stop)]
        sigma = np.union1d(_place_points(motion, count), breaks)
        points = np.concatenate([sigma, (sigma[1:] + sigma[:-1]) / 2])
        path = sample_path(problem.robot, motion, points, 0)
        n = len(sigma) - 1
        places = np.arange(n) + np.array([[0], [n + 1], [1]])
        if breaks.size:
            path = path.join_points(sample_path(problem.robot, motion, breaks, 0, left=True))
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
