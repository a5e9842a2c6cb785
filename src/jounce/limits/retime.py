"""`retime` finds the fastest time law along a path.

It keeps all limits of a robot.

Problem: x(sigma) = sigma'(t)^2 > 0 along a given path q(sigma) that minimizes the
duration, with every limit kept.

Algorithm: direct transcription [1]. x is a spline, and a `Grid` holds the path and its limits, as rows at some points
of each interval; `barrier` finds the coefficients. Points between at which a row peaks beyond its bound are added, and
the program is solved again from the last solution drawn towards one that is well within (an exchange method,
`Grid.solve`). Splines of twice as many intervals follow as long as the duration falls by enough. Under limits of first
and second order alone `fastest_law` has the answer of least duration, whose accelerations jump: it is the result where
these may, and else the program begins near it.

Invariants: a finer spline contains the coarser one, so that refining starts from the last solution; what is still
exceeded between points is drawn back within at the end.

Failure: `JounceError` where no limit bounds the speed along part of the path, where velocities given at the ends leave
no time law, where speeds along the path are too uneven, and where friction or the path turns over between the points.

[1] J. T. Betts, Practical Methods for Optimal Control and Estimation Using Nonlinear Programming, 2nd edition, 2010.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jounce.core import errors, scalars
from jounce.core.cures import Remedy
from jounce.core.display import HtmlDisplay
from jounce.core.errors import JounceError, quote_value
from jounce.core.progress import stage
from jounce.engine import along
from jounce.engine.engine import Engine
from jounce.limits import path_terms
from jounce.limits.barrier import UNEVEN, BarrierProgram, Basis, LocalSplines, find_feasible, minimize_duration
from jounce.limits.check import check
from jounce.limits.fastest_law import FastestLaw, find_fastest_law, find_obstacle
from jounce.limits.joints import column_names, column_owner
from jounce.limits.limited_motion import is_measured, known_kinds
from jounce.limits.retime_problem import LimitRows, RetimeProblem, build_problem, check_path
from jounce.limits.tried_speeds import CommandSpeeds, describe_open_limits
from jounce.model import positions
from jounce.model.limits import LIMIT_KINDS
from jounce.motion import Motion, commands, joint_matching
from jounce.motion.time_law import TimeLaw, TimeLawCurve

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


FIRST_INTERVALS = 30  # of the first spline: enough for a point-to-point motion, and cheap
_MAX_FIRST_TIME_LAW_INTERVALS = 480  # of the first spline: a motion that needs more has very uneven speeds
_MAX_TIME_LAW_INTERVALS = 1920  # of the last spline, which bounds time and memory
_POINTS_PER_INTERVAL = 5  # of the path: rows at five points for each coefficient that an interval adds
GRID_POINTS_PER_POINT = 8  # finer points on which excesses between those of the program are sought
GRID_POINTS_PER_INTERVAL = GRID_POINTS_PER_POINT * _POINTS_PER_INTERVAL
_MAX_SAMPLING_ERROR = 0.01  # of the largest velocity, or of the way: what interpolation between two points may miss
_MIN_GAIN_OF_REFINEMENT = 5e-3  # of the duration, which twice as many intervals must save to be doubled again
SPEED_CAPS = (20.0, 400.0, 8000.0)  # fastest uniform speeds: the highest speed along the path, raised where it decides
_SPEED_CAP_NEAR_FASTEST = 60.0  # the first cap under limits that let accelerations begin at once: 20 costs 0.3 %
_NEAR_FASTEST = 4e-3  # of the duration: a smooth law as near to the fastest is not refined
_START_CAP_SHARE, _GAP_NEAR_FASTEST = 0.7, 0.01  # of the cap and of the duration: where it begins near the fastest
_MIN_BINDING_RATIO = 0.97  # to a bound from which on it counts as deciding: the barrier keeps some distance
_MAX_UNRESOLVED_EXCESS = 0.01  # of a limit: a check that finds more shows what the points do not resolve
_POSITIVITY_SAMPLES_PER_POINT = 8  # of x, per point of the grid, before its root is taken
_MIN_STRETCH_SHARE = 0.004  # of the duration: shorter stretches are not reported
DUALITY_GAP = 3e-4  # of the duration, between a time law and the fastest of its spline
WARM_START_GAP = 0.03  # of the duration: with it the program begins from the solution of a similar one
_MAX_ADDED_ROUNDS = 6  # of rows added where a limit is exceeded between the points
_MAX_EXCESS_BETWEEN_POINTS = 1e-3  # of a limit: what is left is drawn back within at the end
_MAX_CAPPED_SHARE = 0.01  # of the path: where the cap decides on more, no limit bounds the speed
START_SPEED_SHARE = 0.95  # of the fastest uniform speed, where the program begins: strictly within
_FIRST_SHRINK, _SHRINK_BISECTIONS = 1e-4, 6  # of the way to coefficients within the limits, doubled, then refined
_SLOWEST_SHARE = 0.01  # of the square of the speed: slower is no use
_RECHECKED_DISTANCE = 0.05  # of a bound: rows further from it are not looked at again while coefficients are drawn in


class Stretch(NamedTuple):
    """A part of the motion on which one limit decides the speed.

    `joint` and `limit` are whose limit of which kind, `start` and `stop` the times, s.
    """

    joint: str
    limit: str
    start: float
    stop: float


@dataclass(frozen=True, eq=False)
class Retiming(HtmlDisplay):
    """A motion along the same path by the fastest time law.

    `Robot.retime` makes one.

    Attributes
    ----------
    motion : Motion
        The motion, from the same start time.
    duration : float
        How long it lasts, s.
    binding : tuple of Stretch
        The limits that decide: (joint, limit, start, stop), in the order of time.
    law : TimeLaw
        The time of the given motion as a function of time; of way points, that of their path, which lasts 1 s.
    notes : tuple of str
        Of measured motions, the limits that the result does not surely keep, in words: deviations are left out of the
        time law.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(velocity=1.0, acceleration=2.0)
    >>> there = jounce.Motion.polynomial([[0, 0, 3, -2], [0, 0, 1.5, -1]], duration=1.0)
    >>> bool(robot.retime(there, margin=0.0).duration < robot.slowdown(there).motion.duration)
    True
    """

    motion: Motion
    duration: float
    binding: tuple[Stretch, ...]
    law: TimeLaw
    notes: tuple[str, ...] = ()

    @property
    def jumps(self) -> int:
        """Return how often accelerations, and forces with them, jump: never where smooth."""
        return len(self.law.kinks)

    def __repr__(self) -> str:
        jumps = f"; accelerations and forces jump {self.jumps} times" if self.jumps > 0 else ""
        return f"<Retiming to {self.duration:.6g} s, {len(self.binding)} stretches{jumps}>"


@stage("time law along the path")
def retime(
    robot: Engine,
    motion: object,
    margin: object = 0.01,
    smooth: bool = True,
    rate: float | None = None,
    differences: int = commands.JERK_DIFFERENCE,
) -> Retiming:
    """Find the fastest motion along the path of a motion.

    Its limits are taken to a share 1 - margin of themselves. At a rate its differences keep the limits too.
    """
    given_motion = along.check_motion(robot.mechanism, motion)
    if not scalars.is_finite(margin) or not 0 <= margin < 1:  # type: ignore[operator]
        raise JounceError(
            f"margin is {quote_value(margin)}; expected a number from 0 to below 1, 0.01 for 99 % of a limit"
        )
    problem = build_problem(robot, given_motion, 1 - float(margin))  # type: ignore[arg-type]
    if rate is not None:
        # This raises where rate or differences are out of range, before any work is done.
        given_motion.sampled(rate, differences)
    may_jump = not errors.check_bool("smooth", smooth, "whether accelerations of the result are continuous")
    retiming = _retime_with_jumps(robot, problem) if may_jump else _retime_smoothly(robot, problem)
    if rate is not None:
        retiming = _keep_as_commands(robot, problem, retiming, rate, differences)
    if not is_measured(given_motion):
        return retiming
    # Deviations do not enter the time law: a check of the result says which limits they leave undecided.
    result = retiming.motion if rate is None else retiming.motion.sampled(rate, differences)
    return replace(retiming, notes=describe_open_limits(check(robot, result)))


def _keep_as_commands(
    robot: Engine, problem: RetimeProblem, retiming: Retiming, rate: float, differences: int
) -> Retiming:
    """Slow the result down where its differences break a limit.

    At the rate of a controller differences may break a limit that the derivatives keep. The result is slowed down as a
    whole.
    """
    speeds = CommandSpeeds(robot, retiming.motion, rate, differences)
    before = speeds.check()
    if before.ok or (before.verdict == "undecided" and speeds.keeps()):
        return retiming
    factor, _ = speeds.fall()
    # A factor of speed multiplies sigma', and x = sigma'^2 by its square.
    x = retiming.law.x
    motion, law = _follow_law(problem, type(x)(x.t, factor**2 * x.c, x.k))
    verified = CommandSpeeds(robot, motion, rate, differences).check()
    if verified.verdict == "broken":
        raise JounceError(
            f"retiming fails at {rate:g} Hz: {verified.worst}; expected a higher rate, or a larger margin"
        )
    # The same parts decide, at times that are stretched about the start.
    start = law.start
    binding = tuple(
        part._replace(start=start + (part.start - start) / factor, stop=start + (part.stop - start) / factor)
        for part in retiming.binding
    )
    return Retiming(motion, motion.duration, binding, law)


def _retime_smoothly(robot: Engine, problem: RetimeProblem) -> Retiming:
    """Find the fastest motion whose accelerations are continuous."""
    given_motion = problem.motion
    intervals = _count_intervals(robot, given_motion)
    fastest = _find_start(problem)
    if fastest is not None:
        # Enough for `_NEAR_FASTEST`, where the program begins near the fastest.
        intervals = intervals * 4 // 3
    caps = SPEED_CAPS if fastest is None else (_SPEED_CAP_NEAR_FASTEST, *SPEED_CAPS[1:])
    # The barrier needs a highest speed. It is raised until it decides on hardly any of the path.
    for reach in caps:
        grid, c = _refine_splines(Grid.build(problem, intervals, reach), fastest)
        if grid.is_bounded(c):
            return _verify_result(robot, _build_result(grid, c), problem)
    raise problem.unbounded_error()


def _retime_with_jumps(robot: Engine, problem: RetimeProblem) -> Retiming:
    """Find the fastest motion of all, whose accelerations and forces jump."""
    obstacle = find_obstacle(problem)
    if obstacle is not None:
        raise JounceError(f"retime with smooth=False supports {obstacle}")
    fastest = find_fastest_law(problem)
    motion, law = _follow_law(problem, fastest.spline)
    stretches = _find_stretches(problem, fastest.sigma, fastest.rows, fastest.jets, law)
    return _verify_result(robot, Retiming(motion, motion.duration, stretches, law), problem)


def _find_start(problem: RetimeProblem) -> FastestLaw | None:
    """Find the law of least duration, near which the smooth one begins.

    Returns None where limits are of higher order or not linear, or no such law is found.
    """
    if find_obstacle(problem) is not None:
        return None
    try:
        return find_fastest_law(problem)
    except JounceError:
        return None


def _verify_result(robot: Engine, retiming: Retiming, problem: RetimeProblem) -> Retiming:
    """Refuse a result that is beyond a limit between points.

    These do not resolve Coulomb friction or corners between lines that change too fast, nor powers of which one bound
    is far smaller than the other: excesses are small against their distance.
    """
    totals = [kind for kind in known_kinds(robot, problem.limits) if kind in LIMIT_KINDS.totals]
    is_coarse = problem.friction is not None or joint_matching.is_along_points(problem.motion)
    if not is_coarse and len(totals) == 0:
        return retiming
    # The check sees what happens between the points.
    rows = [row for row in check(robot, retiming.motion).table if row.limit != "position"]
    rows = rows if is_coarse else [row for row in rows if row.limit in totals]
    worst = max(rows, key=lambda row: row.ratio)
    if worst.ratio <= problem.share * (1 + _MAX_UNRESOLVED_EXCESS):
        return retiming
    fails = f"retiming fails: {worst}, where at most {problem.share:g} is expected:"
    if problem.friction is not None:
        raise JounceError(
            f"{fails} the Coulomb friction turns over within {1 / problem.friction.slope.max():g} rad/s or m/s: it is"
            f" too steep: expected a larger one{Remedy(', robot.with_drives(..., eps=...)')}"
        )
    if worst.limit in totals:
        cure = Remedy(", margin=0.1", ", --margin 0.1")
        raise JounceError(f"{fails} its bounds are too different; expected nearer ones, or a larger margin{cure}")
    raise JounceError(f"{fails} the path turns too sharply; expected a larger tolerance, or other points")


def _count_intervals(robot: Engine, motion: Motion) -> int:
    """Return the number of intervals of the first grid.

    Its finer points follow the velocities of the motion.
    """
    intervals = FIRST_INTERVALS
    while intervals <= _MAX_FIRST_TIME_LAW_INTERVALS:
        # Twice as many points as the finest grid has: every second one tests what the others miss.
        t = np.linspace(motion.start, motion.stop, 2 * GRID_POINTS_PER_INTERVAL * intervals + 1)
        q, velocity = motion(t, 1)
        speed = positions.number_rates(robot.mechanism, q, velocity)
        chord, step = (speed[:-1:2] + speed[2::2]) / 2, 2 * (t[1] - t[0])
        chord_error = np.abs(speed[1::2] - chord).max()
        # Between two points q changes by the integral of its velocity, by Simpson's rule.
        way_error = np.abs(q[2::2] - q[:-1:2] - step * (chord + 2 * speed[1::2]) / 3).max()
        follows_speed = chord_error <= _MAX_SAMPLING_ERROR * np.abs(speed).max()
        if follows_speed and way_error <= _MAX_SAMPLING_ERROR * np.ptp(q, axis=0).max():
            return intervals
        intervals *= 2
    raise JounceError(UNEVEN)


@dataclass(frozen=True, eq=False)
class Grid:
    """A problem with splines, and its path at fine points.

    The points are finer than those of the program. A grid is built once for each number of intervals.
    """

    problem: RetimeProblem
    basis: Basis
    sigma: np.ndarray
    count: int  # of sigma without breaks
    path: path_terms.Path
    at: LocalSplines
    rows: LimitRows
    uniform: float  # the speed of the fastest uniform time law
    reach: float  # times as fast as this is the highest speed

    @classmethod
    def build(cls, problem: RetimeProblem, intervals: int, reach: float, uniform: float | None = None) -> "Grid":
        """Build the grid with a number of intervals.

        The path is checked where the uniform speed is not known yet, which is for the first grid.
        """
        basis = Basis(problem.motion.start, problem.motion.stop, intervals)
        sigma, count = problem.points(GRID_POINTS_PER_INTERVAL * intervals + 1)
        path = problem.path(sigma, count)
        if uniform is None:
            check_path(problem, sigma, path)
            uniform = 1.0 if any(problem.moving) else problem.uniform_speed(path)
        rows = problem.rows(path, reach * uniform)
        return cls(problem, basis, sigma, count, path, basis.evaluate(sigma), rows, uniform, reach)

    @property
    def free(self) -> np.ndarray:
        """The mask of the free coefficients: where an end moves, x = 1 and x' = 0 there."""
        free = np.ones(self.basis.count, dtype=bool)
        free[:2], free[-2:] = (not moves for moves in self.problem.moving)
        return free

    def inner(self, c: np.ndarray) -> np.ndarray:
        """Return coefficients well within all limits.

        They are those of a uniform speed, or near to c where the speed of an end stays.
        """
        if self.free.all():
            # Most rows grow with the speed: slower than the fastest uniform speed is strictly within.
            return np.full(self.basis.count, (START_SPEED_SHARE * self.uniform) ** 2)
        program = BarrierProgram(self.basis, self.at, self.rows, self.free)
        c_inside = find_feasible(program, c)
        if c_inside is None:
            raise self._infeasible_error(program, c)
        return c_inside

    def solve(self, c: np.ndarray, inner: np.ndarray, first: float) -> np.ndarray:
        """Find the coefficients of the fastest spline within all limits.

        The limits hold between the points too. The search begins at c, drawn towards `inner`, which is well within the
        limits; `first` is the gap it begins with, a share of the duration.
        """
        # Rows at every eighth point, at the end of the path and at all breaks.
        chosen = np.zeros(len(self.rows.factors), dtype=bool)
        chosen[: self.count : GRID_POINTS_PER_POINT] = chosen[self.count - 1 :] = True
        for _ in range(_MAX_ADDED_ROUNDS):
            program = BarrierProgram(self.basis, self.at.select(chosen), self.rows.select(chosen), self.free)
            c = minimize_duration(program, self._draw_inside(c, inner, program.feasible), DUALITY_GAP, first)
            # Exchange: the rows that peak beyond their bounds between the points join the program.
            peaks = _find_peak_points(self.rows.excess(self.at.jets(c))[: self.count], _MAX_EXCESS_BETWEEN_POINTS)
            if peaks.size == 0:
                break
            # The last solution is near to the next one: a small gap is enough to begin with.
            chosen[peaks], first = True, WARM_START_GAP
        return self._draw_within(c, inner)

    def _draw_within(self, c: np.ndarray, inner: np.ndarray) -> np.ndarray:
        """Draw the coefficients within the limits at all points.

        The coefficients move towards `inner` by as little as makes them fit.
        """
        # Rows far from their bounds stay there.
        near = self.rows.excess(self.at.jets(c)).max(axis=1) > -_RECHECKED_DISTANCE
        checked = [(self.rows.select(near), self.at.select(near))]

        def keeps_bounds(c: np.ndarray) -> bool:
            return all(bool((rows.excess(at.jets(c)) <= 0).all()) for rows, at in checked)

        for _ in range(_MAX_ADDED_ROUNDS):
            c = self._draw_inside(c, inner, keeps_bounds)
            # Exchange once more: where rows peak between the fine points, these are sampled exactly.
            sigma = self._find_tops(c)
            if sigma.size == 0:
                break
            checked.append((self.problem.rows_at(sigma, self.reach * self.uniform), self.basis.evaluate(sigma)))
        return c

    def _draw_inside(self, c: np.ndarray, inner: np.ndarray, fits: Callable[[np.ndarray], bool]) -> np.ndarray:
        """Draw coefficients towards others, or slow them down.

        Limits of high rates are not convex: what lies between two sets of coefficients within them may be beyond.
        """
        drawn = draw_inside(c, inner, fits)
        # Coefficients of ends that move cannot be slowed down.
        if drawn is c or not self.free.all():
            return drawn
        # Where the line to `inner` leads beyond a bend of the limits, a slower speed along the same law is faster.
        slowed = draw_inside(c, _SLOWEST_SHARE * c, fits)
        return slowed if fits(slowed) and self.basis.duration(slowed) < self.basis.duration(drawn) else drawn

    def _find_tops(self, c: np.ndarray) -> np.ndarray:
        """Find where rows peak above their limits between the points.

        Each peak is the top of a parabola through three neighbouring points.
        """
        sigma = self.sigma[: self.count]
        excess, step = self.rows.excess(self.at.jets(c))[: self.count], np.diff(sigma)[:, None]
        # Differences on both sides of each inner point, (N - 2, R), which need not be even.
        rise, value, both = np.diff(excess, axis=0) / step, excess[1:-1], step[1:] + step[:-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            # Slope and curvature of the parabola at its middle point; its top is -slope / bend away.
            slope = (rise[1:] * step[:-1] + rise[:-1] * step[1:]) / both
            bend = 2 * (rise[1:] - rise[:-1]) / both
            above = (rise[:-1] > 0) & (rise[1:] < 0) & (value - slope**2 / (2 * bend) > _MAX_EXCESS_BETWEEN_POINTS / 10)
            return np.unique((sigma[1:-1, None] - slope / bend)[above])

    def _infeasible_error(self, program: BarrierProgram, c: np.ndarray) -> JounceError:
        """Return the error of speeds at the ends beyond the limits.

        The motion moves at an end, and no time law keeps that speed within the limits.
        """
        excess = program.rows.excess(program.at.jets(c))
        point, row = np.unravel_index(excess.argmax(), excess.shape)
        kind = program.rows.kinds[row]
        owner = column_owner(self.problem.robot.mechanism, kind, int(program.rows.joints[point, row]))
        ends = [end for end, moves in zip(("start", "end"), self.problem.moving, strict=True) if moves]
        return JounceError(
            f"the motion moves at its {' and '.join(ends)}, and no time law keeps the velocity there within the limits"
            f" (worst: {kind} of {owner});"
            f" expected a motion from rest to rest, or a slower one{Remedy(': motion.scaled(2)')}"
        )

    def is_bounded(self, c: np.ndarray) -> bool:
        """Whether the limits decide the speed along nearly all the path.

        Elsewhere the highest speed does.
        """
        way = np.abs(self.path.q[1][: self.count]).sum(axis=1) * np.gradient(self.sigma[: self.count])
        x = self.at.jets(c)[0, : self.count]
        return bool(way[x > (self.reach * self.uniform) ** 2 / 4].sum() <= _MAX_CAPPED_SHARE * way.sum())


def _refine_splines(grid: Grid, fastest: FastestLaw | None) -> tuple[Grid, np.ndarray]:
    """Find the fastest spline, of as many intervals as pay.

    The search begins near the law of least duration, where that is known, and ends where it is as good.
    """
    enough = 0.0 if fastest is None else (1 + _NEAR_FASTEST) * fastest.duration
    inner = grid.inner(np.ones(grid.basis.count))
    if fastest is None:
        c = grid.solve(inner, inner, 1.0)
    else:
        # Below the cap, which bounds x strictly; coefficients of ends that move are those of `inner`.
        highest_x = (_START_CAP_SHARE * grid.reach * grid.uniform) ** 2
        near_fastest = grid.basis.approximate(fastest.spline).clip(max=highest_x)
        c = grid.solve(np.where(grid.free, near_fastest, inner), inner, _GAP_NEAR_FASTEST)
    while grid.basis.intervals < _MAX_TIME_LAW_INTERVALS and grid.basis.duration(c) > enough:
        # The same splines on twice as many intervals, from which the finer problem starts.
        finer = Grid.build(grid.problem, 2 * grid.basis.intervals, grid.reach, grid.uniform)
        inner, coarse = (finer.basis.refine(grid.basis.spline(x)) for x in (inner, c))
        inner = finer.inner(inner)
        better = finer.solve(coarse, inner, WARM_START_GAP)
        before, after = grid.basis.duration(c), finer.basis.duration(better)
        if after < before:
            grid, c = finer, better
        if after > (1 - _MIN_GAIN_OF_REFINEMENT) * before:
            break
    # Never slower than the fastest uniform speed: with non-convex limits a local minimum may be.
    if grid.free.all() and grid.basis.duration(c) > grid.problem.motion.duration / grid.uniform:
        c = np.full(grid.basis.count, grid.uniform**2)
    return grid, c


def _build_result(grid: Grid, c: np.ndarray) -> Retiming:
    """Build the motion with x of some coefficients."""
    problem, spline = grid.problem, grid.basis.spline(c)
    sigma = np.linspace(problem.motion.start, problem.motion.stop, _POSITIVITY_SAMPLES_PER_POINT * grid.count)
    # The root of x is taken at every time: x has to be above 0 between the points too.
    if spline(sigma).min() <= 0:
        raise JounceError(UNEVEN)
    motion, law = _follow_law(problem, spline)
    without_breaks = slice(grid.count)
    rows, jets = grid.rows.select(without_breaks), grid.at.jets(c)[:, without_breaks]
    stretches = _find_stretches(problem, grid.sigma[without_breaks], rows, jets, law)
    return Retiming(motion, motion.duration, stretches, law)


def _follow_law(problem: RetimeProblem, x: "BSpline") -> tuple[Motion, TimeLaw]:
    """Return the motion by a time law, and the law.

    x is the spline of the law.
    """
    given_motion = problem.motion
    law = TimeLaw(x, given_motion.start, given_motion.stop, given_motion.start)
    # Loads and the base go with the path: they follow the same law.
    base_curve = None if given_motion.base_curve is None else TimeLawCurve(given_motion.base_curve, law)
    motion = replace(
        given_motion,
        curve=TimeLawCurve(given_motion.curve, law),
        loads={body: TimeLawCurve(curve, law) for body, curve in given_motion.loads.items()},
        base_curve=base_curve,
        source=f"{given_motion.source}, retimed",
        samples=None,
        grid=None,
        torques=None,
    )
    return motion, law


def _find_stretches(
    problem: RetimeProblem, sigma: np.ndarray, rows: LimitRows, jet: np.ndarray, law: TimeLaw
) -> tuple[Stretch, ...]:
    """Find the stretches on which one limit decides.

    `rows` and `jet` are the limits and x with its derivatives at points `sigma` of the path.
    """
    # At each point the row nearest to a bound, and its joint, or -1 where none is near enough.
    nearness = rows.nearness(jet)
    row = nearness.argmax(axis=1)
    point = np.arange(len(sigma))
    joints = np.where(nearness[point, row] > _MIN_BINDING_RATIO, rows.joints[point, row], -1)
    t = law.times(sigma)
    m = problem.robot.mechanism
    # Neighbouring points with the same limit are one stretch, which lasts to the next point.
    stretches = []
    for (kind, joint), group in groupby(point.tolist(), key=lambda i: (rows.kinds[row[i]], int(joints[i]))):
        points = list(group)
        start, stop = t[points[0]], t[min(points[-1] + 1, len(t) - 1)]
        if joint >= 0 and stop - start > _MIN_STRETCH_SHARE * (t[-1] - t[0]):
            stretches.append(Stretch(column_names(m, kind)[joint], kind, float(start), float(stop)))
    return tuple(stretches)


def draw_inside(c: np.ndarray, inner: np.ndarray, fits: Callable[[np.ndarray], bool]) -> np.ndarray:
    """Draw coefficients towards others that fit.

    The coefficients move by as little as makes them fit.
    """
    if fits(c):
        return c
    # Double the share of the way until the coefficients fit; all of it leads to those that do.
    low, high = 0.0, _FIRST_SHRINK
    while high < 1 and not fits(c + high * (inner - c)):
        low, high = high, 2 * high
    high = min(high, 1.0)
    for _ in range(_SHRINK_BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if fits(c + middle * (inner - c)) else (middle, high)
    return c + high * (inner - c)


def _find_peak_points(excess: np.ndarray, above: float) -> np.ndarray:
    """Return the points at which a row peaks above a bound.

    The excess of the rows is (N, R).
    """
    padded = np.pad(excess, ((1, 1), (0, 0)), constant_values=-np.inf)
    peak = (excess > above) & (excess >= padded[:-2]) & (excess >= padded[2:])
    return np.flatnonzero(peak.any(axis=1))
