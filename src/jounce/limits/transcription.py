"""The retiming problem on a grid: its path and rows at points, and the fastest spline within all limits there."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.limits.barrier import BarrierProgram, find_feasible, minimize_duration
from jounce.limits.basis import Basis, LocalSplines
from jounce.limits.joints import joint_names
from jounce.limits.limit_rows import LimitRows
from jounce.limits.path import Path
from jounce.limits.retime_problem import RetimeProblem, check_path

_POINTS_PER_INTERVAL = 5  # of the path: rows at five points for each coefficient that an interval adds
GRID_POINTS_PER_POINT = 8  # finer points on which excesses between those of the program are sought
GRID_POINTS_PER_INTERVAL = GRID_POINTS_PER_POINT * _POINTS_PER_INTERVAL
DUALITY_GAP = 3e-4  # of the duration, between a time law and the fastest of its spline
WARM_START_GAP = 0.03  # of the duration: with it the program begins from the solution of a similar one
_MAX_ADDED_ROUNDS = 6  # of rows added where a limit is exceeded between the points
_MAX_EXCESS_BETWEEN_POINTS = 1e-3  # of a limit: what is left is drawn back within at the end
_MAX_CAPPED_SHARE = 0.01  # of the path: where the cap decides on more, no limit bounds the speed
START_SPEED_SHARE = 0.95  # of the fastest uniform speed, where the program begins: strictly within
_FIRST_SHRINK, _SHRINK_BISECTIONS = 1e-4, 6  # of the way to coefficients within the limits, doubled, then refined
_SLOWEST_SHARE = 0.01  # of the square of the speed: slower is no use
_RECHECKED_DISTANCE = 0.05  # of a bound: rows further from it are not looked at again while coefficients are drawn in


@dataclass(frozen=True, eq=False)
class Grid:
    """A problem with splines of some intervals, and its path at finer points than those of the program."""

    problem: RetimeProblem
    basis: Basis
    sigma: np.ndarray
    count: int  # of sigma without breaks
    path: Path
    at: LocalSplines
    rows: LimitRows
    uniform: float  # the speed of the fastest uniform time law
    reach: float  # times as fast as this is the highest speed

    @classmethod
    def build(cls, problem: RetimeProblem, intervals: int, reach: float, uniform: float | None = None) -> "Grid":
        """The grid with a number of intervals; the path is checked where the uniform speed is not known yet."""
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
        """Which coefficients are free: where an end moves, x = 1 and x' = 0 there."""
        free = np.ones(self.basis.count, dtype=bool)
        free[:2], free[-2:] = (not moves for moves in self.problem.moving)
        return free

    def inner(self, c: np.ndarray) -> np.ndarray:
        """Coefficients well within all limits: uniform ones, or near to some others where the speed of an end stays."""
        if self.free.all():
            return np.full(self.basis.count, (START_SPEED_SHARE * self.uniform) ** 2)
        program = BarrierProgram(self.basis, self.at, self.rows, self.free)
        found = find_feasible(program, c)
        if found is None:
            raise self._infeasible_error(program, c)
        return found

    def solve(self, c: np.ndarray, inner: np.ndarray, first: float) -> np.ndarray:
        """The coefficients of the fastest spline within all limits, between the points too, from some others."""
        chosen = np.zeros(len(self.rows.factors), dtype=bool)
        chosen[: self.count : GRID_POINTS_PER_POINT] = chosen[self.count - 1 :] = True
        for _ in range(_MAX_ADDED_ROUNDS):
            program = BarrierProgram(self.basis, self.at.select(chosen), self.rows.select(chosen), self.free)
            c = minimize_duration(program, self._draw_inside(c, inner, program.feasible), DUALITY_GAP, first)
            # Exchange: the rows that peak beyond their bounds between the points join the program.
            peaks = _find_peak_points(self.rows.excess(self.at.jets(c))[: self.count], _MAX_EXCESS_BETWEEN_POINTS)
            if not peaks.size:
                break
            chosen[peaks], first = True, WARM_START_GAP
        return self._draw_within(c, inner)

    def _draw_within(self, c: np.ndarray, inner: np.ndarray) -> np.ndarray:
        """The coefficients, drawn to those well within the limits by what these are exceeded between the points."""
        near = self.rows.excess(self.at.jets(c)).max(axis=1) > -_RECHECKED_DISTANCE
        looked = [(self.rows.select(near), self.at.select(near))]
        for _ in range(_MAX_ADDED_ROUNDS):
            c = self._draw_inside(
                c, inner, lambda c: all(bool((rows.excess(at.jets(c)) <= 0).all()) for rows, at in looked)
            )
            sigma = self._find_tops(c)
            if not sigma.size:
                break
            looked.append((self.problem.rows_at(sigma, self.reach * self.uniform), self.basis.evaluate(sigma)))
        return c

    def _draw_inside(self, c: np.ndarray, inner: np.ndarray, fits: Callable[[np.ndarray], bool]) -> np.ndarray:
        """Coefficients that fit, drawn from some towards others that do or, where these lie behind a bend, slowed down.

        Limits of high rates are not convex: what lies between two sets of coefficients within them may be beyond.
        """
        drawn = draw_inside(c, inner, fits)
        if drawn is c or not self.free.all():
            return drawn
        slowed = draw_inside(c, _SLOWEST_SHARE * c, fits)
        return slowed if fits(slowed) and self.basis.duration(slowed) < self.basis.duration(drawn) else drawn

    def _find_tops(self, c: np.ndarray) -> np.ndarray:
        """Where rows peak above their limits between the points, by parabolas through three of these each."""
        sigma = self.sigma[: self.count]
        excess, step = self.rows.excess(self.at.jets(c))[: self.count], np.diff(sigma)[:, None]
        rise, value, both = np.diff(excess, axis=0) / step, excess[1:-1], step[1:] + step[:-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = (rise[1:] * step[:-1] + rise[:-1] * step[1:]) / both
            bend = 2 * (rise[1:] - rise[:-1]) / both
            above = (rise[:-1] > 0) & (rise[1:] < 0) & (value - slope**2 / (2 * bend) > _MAX_EXCESS_BETWEEN_POINTS / 10)
            return np.unique((sigma[1:-1, None] - slope / bend)[above])

    def _infeasible_error(self, program: BarrierProgram, c: np.ndarray) -> JounceError:
        """The error where the speed of the motion at its ends, which remains, leaves no time law within the limits."""
        excess = program.rows.excess(program.at.jets(c))
        point, row = np.unravel_index(excess.argmax(), excess.shape)
        joint = joint_names(self.problem.robot.mechanism)[program.rows.joints[point, row]]
        ends = [end for end, moves in zip(("start", "end"), self.problem.moving, strict=True) if moves]
        return JounceError(
            f"the motion moves at its {' and '.join(ends)}, and no time law keeps the velocity there within the limits"
            f" (worst: {program.rows.kinds[row]} of joint {quote_value(joint)});"
            f" expected a motion from rest to rest, or a slower one{Remedy(': motion.scaled(2)')}"
        )

    def is_bounded(self, c: np.ndarray) -> bool:
        """Whether the limits decide the speed along nearly all of the path, and not the highest speed."""
        way = np.abs(self.path.q[1][: self.count]).sum(axis=1) * np.gradient(self.sigma[: self.count])
        x = self.at.jets(c)[0, : self.count]
        return bool(way[x > (self.reach * self.uniform) ** 2 / 4].sum() <= _MAX_CAPPED_SHARE * way.sum())


def draw_inside(c: np.ndarray, inner: np.ndarray, fits: Callable[[np.ndarray], bool]) -> np.ndarray:
    """Coefficients that fit, between some and others that do: as little as possible towards the latter."""
    if fits(c):
        return c
    low, high = 0.0, _FIRST_SHRINK
    while high < 1 and not fits(c + high * (inner - c)):
        low, high = high, 2 * high
    high = min(high, 1.0)
    for _ in range(_SHRINK_BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if fits(c + middle * (inner - c)) else (middle, high)
    return c + high * (inner - c)


def _find_peak_points(excess: np.ndarray, above: float) -> np.ndarray:
    """The points at which a row (N, R) has a peak above a bound."""
    inner = np.pad(excess, ((1, 1), (0, 0)), constant_values=-np.inf)
    peak = (excess > above) & (excess >= inner[:-2]) & (excess >= inner[2:])
    return np.flatnonzero(peak.any(axis=1))
