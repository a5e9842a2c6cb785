"""A barrier method finds the fastest spline x(sigma) within rows; its iterates are feasible.

Problem: the coefficients c of x = sigma'(t)^2 that minimize the duration, the integral of x^(-1/2), while
``lower <= rows(x, x', x'', x''') <= upper`` at given points and x > 0 (steep friction draws x there where the robot
rests). Rows of velocities, accelerations and forces without damping are linear in c, and the problem is convex [1];
those with a factor sqrt(x), as of jerks, are not, and a local minimum is found.

Algorithm: a primal-dual barrier method ([2], chapter 19). For ever smaller mu, Newton's method solves the perturbed
optimality conditions of ``duration - mu sum log(distances)``, with a line search on this function, steps that stop
short of the bounds, and multipliers kept near mu / distance as in IPOPT [3]. Once for each problem, `Basis` evaluates
the B-splines of x at its points, where only k + 1 of degree k are not zero [4]. A row at a point takes x there alone:
gradients and Hessians by the coefficients are sums of small blocks, and the Newton matrix has the k + 1 bands of the
B-splines, so that a step costs as much as evaluating the rows. The duration is a Gauss-Legendre sum in each interval;
x must be above 0 at its points.

Invariant: every iterate is strictly within all bounds, so that stopping early costs time and never a limit.

Failure: the search ends where no step makes progress. `JounceError` where the Newton matrix has no Cholesky factor,
although made convex: speeds along the path then differ by many powers of ten.

[1] D. Verscheure et al., Time-optimal path tracking for robots: a convex optimization approach, IEEE Trans. Automatic
    Control 54 (2009).
[2] J. Nocedal, S. J. Wright, Numerical Optimization, 2nd edition, 2006.
[3] A. Waechter, L. T. Biegler, On the implementation of an interior-point filter line-search algorithm, Mathematical
    Programming 106 (2006), equation 16.
[4] C. de Boor, A Practical Guide to Splines, 2001.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.errors import JounceError
from jounce.limits import path_terms
from jounce.limits.retime_problem import LimitRows

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


_TIME_LAW_DEGREE = 5  # of x(sigma), which is then C^4, so that the motion is smooth up to q5d
_DURATION_NODES = 4  # of Gauss and Legendre in each interval: exact to degree 7, more than a smooth x^(-1/2) needs


@dataclass(frozen=True, eq=False)
class LocalSplines:
    """The B-splines that are not zero at N points: their indices (N, k + 1), with derivatives (N, 4, k + 1)."""

    index: np.ndarray
    values: np.ndarray
    count: int

    def select(self, points: np.ndarray | slice) -> "LocalSplines":
        """The same at some of the points."""
        return LocalSplines(self.index[points], self.values[points], self.count)

    def jets(self, c: np.ndarray) -> np.ndarray:
        """x, x', x'', x''' at the points, (4, N), of coefficients c."""
        return np.matmul(self.values, c[self.index][:, :, None])[:, :, 0].T

    def collect(self, force: np.ndarray) -> np.ndarray:
        """The gradient by the coefficients of a function with these gradients (N, J) by the jets."""
        parts = np.matmul(force[:, None], self.values[:, : force.shape[1]])
        return np.bincount(self.index.ravel(), parts.ravel(), self.count)

    def bands(self, local: np.ndarray) -> np.ndarray:
        """The Hessian by the coefficients, upper bands (k + 1, count), of one with these Hessians (N, J, J)."""
        values = self.values[:, : local.shape[1]]
        parts = np.matmul(values.transpose(0, 2, 1), np.matmul(local, values))
        rows, columns, places = self._places
        return np.bincount(places, parts[:, rows, columns].ravel(), self.values.shape[2] * self.count).reshape(
            self.values.shape[2], self.count
        )

    @cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        width = self.values.shape[2]
        rows, columns = np.triu_indices(width)
        band = width - 1 + rows - columns
        return rows, columns, (band * self.count + self.index[:, columns]).ravel()


@dataclass(frozen=True, eq=False)
class Basis:
    """B-splines of even intervals from `first` to `last`, clamped at both ends."""

    first: float
    last: float
    intervals: int

    @cached_property
    def knots(self) -> np.ndarray:
        """The knots, the ends repeated."""
        return np.pad(np.linspace(self.first, self.last, self.intervals + 1), _TIME_LAW_DEGREE, mode="edge")

    @property
    def count(self) -> int:
        """The number of coefficients."""
        return self.intervals + _TIME_LAW_DEGREE

    def spline(self, c: np.ndarray) -> "BSpline":
        """The spline with coefficients c."""
        from scipy.interpolate import BSpline

        return BSpline(self.knots, c, _TIME_LAW_DEGREE, extrapolate=False)

    def refine(self, spline: "BSpline") -> np.ndarray:
        """The coefficients of a spline of fewer intervals, each of which is several of these."""
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self._greville, spline(self._greville), k=_TIME_LAW_DEGREE, t=self.knots).c

    def approximate(self, x: "BSpline") -> np.ndarray:
        """The coefficients of a spline near to another function, as smooth as this basis is: Schoenberg's."""
        return np.asarray(x(self._greville))

    @cached_property
    def _greville(self) -> np.ndarray:
        means = [self.knots[i + 1 : i + _TIME_LAW_DEGREE + 1].mean() for i in range(self.count)]
        return np.array(means).clip(self.first, self.last)  # means of equal knots are off by rounding

    def evaluate(self, sigma: np.ndarray) -> LocalSplines:
        """The B-splines at points."""
        from scipy.interpolate import BSpline

        i = (np.searchsorted(self.knots, sigma, side="right") - 1).clip(_TIME_LAW_DEGREE, self.count - 1)
        index = (i - _TIME_LAW_DEGREE)[:, None] + np.arange(_TIME_LAW_DEGREE + 1)
        values = np.empty((len(sigma), path_terms.JET_SIZE, _TIME_LAW_DEGREE + 1))
        rows = np.arange(len(sigma))
        for phase in range(_TIME_LAW_DEGREE + 1):  # every (k + 1)-th B-spline at once: no two of them overlap
            some = BSpline(
                self.knots, (np.arange(self.count) % (_TIME_LAW_DEGREE + 1) == phase).astype(float), _TIME_LAW_DEGREE
            )
            for k in range(path_terms.JET_SIZE):
                values[rows, k, (phase - index[:, 0]) % (_TIME_LAW_DEGREE + 1)] = some(sigma, nu=k)
        return LocalSplines(index, values, self.count)

    def speeds(self, c: np.ndarray) -> np.ndarray:
        """x at the points at which the duration is evaluated."""
        return self._quadrature[0].jets(c)[0]

    def duration(self, c: np.ndarray) -> float:
        """The integral of 1 / sqrt(x)."""
        return float(self._quadrature[1] @ self.speeds(c) ** -0.5)

    def duration_derivatives(self, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and upper bands of the Hessian of the duration."""
        at, weights = self._quadrature
        x = self.speeds(c)
        return at.collect((-0.5 * weights * x**-1.5)[:, None]), at.bands((0.75 * weights * x**-2.5)[:, None, None])

    @cached_property
    def _quadrature(self) -> tuple[LocalSplines, np.ndarray]:
        u, w = np.polynomial.legendre.leggauss(_DURATION_NODES)
        ends = self.knots[_TIME_LAW_DEGREE:-_TIME_LAW_DEGREE]
        half = np.diff(ends)[:, None] / 2
        sigma = ends[:-1, None] + half * (1 + u)
        return self.evaluate(sigma.ravel()), (half * w).ravel()


# The barrier method on these splines.
_MAX_BARRIER_STEPS = 300  # of Newton's method: several times as many as problems have been seen to take
_DECREMENT_TO_SHRINK_MU = 5.0  # Newton's decrement in units of mu: centred well enough for the next mu
_MU_FACTOR = 0.1  # from one mu to the next
_MAX_SHARE_TO_BOUND = 0.99  # of the way to the nearest bound: iterates stay strictly within
_MAX_LINE_SEARCH_HALVINGS = 40  # to 1e-12 of the step: then rounding hides any progress
_MIN_BOUND_DISTANCE = 1e-3  # of a bound: closer coefficients are no start for the barrier
_CENTRING_WEIGHT = 10.0  # durations: the weight of the barrier while feasible coefficients are sought
_CENTRING_STEPS = 3  # of Newton's method between two widths of the bounds: the centre need only be near
_DIAGONAL_SHIFTS = (0.0, 1e-12, 1e-9, 1e-6)  # of the Newton matrix's diagonal, tried until it has a Cholesky factor
UNEVEN = "retiming fails: the paces of the motion differ by too much; retime its parts, and add the results"


@dataclass(frozen=True, eq=False)
class BarrierProgram:
    """Rows at points of a path, the spline's derivatives there, and which coefficients are free."""

    basis: Basis
    at: LocalSplines
    rows: LimitRows
    free: np.ndarray

    def feasible(self, c: np.ndarray) -> bool:
        """Whether all rows are within their bounds, and have room to move there."""
        jet = self.at.jets(c)
        return bool(
            jet[0].min() > 0 and self.basis.speeds(c).min() > 0 and self.rows.excess(jet).max() < -_MIN_BOUND_DISTANCE
        )


def find_feasible(program: BarrierProgram, c: np.ndarray) -> np.ndarray | None:
    """Coefficients whose rows are all within their bounds, from any with x > 0; None where none are found.

    The bounds are widened until they hold, and then drawn in as the centre of what they leave moves.
    """
    jet = program.at.jets(c)
    for _ in range(_MAX_BARRIER_STEPS):
        excess = float(program.rows.excess(jet).max())
        if excess < -_MIN_BOUND_DISTANCE:
            return c
        # Bounds so wide that c is strictly within them, and a few steps towards their centre.
        wider = program.rows.widen(max(1.05 * excess, 0.0) + 20 * _MIN_BOUND_DISTANCE)
        relaxed = BarrierProgram(program.basis, program.at, wider, program.free)
        mu = _CENTRING_WEIGHT * program.basis.duration(c) / wider.factors[:, :, 0].size
        now = _start_iterate(relaxed, c, mu)
        for _ in range(_CENTRING_STEPS):
            _step(relaxed, now, mu)
        c, jet = now.c, program.at.jets(now.c)
        # Without progress by Armijo's rule the centre of the widened bounds stays outside of the given ones.
        if program.rows.excess(jet).max() > excess - 1e-4 * abs(excess):
            return None
    return None


@dataclass(eq=False)
class Iterate:
    """Coefficients, the distances of the rows from both bounds (N, R), and their multipliers."""

    c: np.ndarray
    above: np.ndarray
    below: np.ndarray
    push_down: np.ndarray
    push_up: np.ndarray


def minimize_duration(program: BarrierProgram, c: np.ndarray, gap: float, first: float = 1.0) -> np.ndarray:
    """The coefficients of the fastest x, from feasible ones: at most about a share `gap` of the duration is missed.

    `first` is the share of the duration that the rows may miss in the first problem.
    """
    rows, duration = 2 * program.rows.factors[:, :, 0].size, program.basis.duration(c)
    mu = first * duration / rows
    now = _start_iterate(program, c, mu)
    for _ in range(_MAX_BARRIER_STEPS):
        decrement, length = _step(program, now, mu)
        if length == 0:
            break
        # Nearly central: mu times the number of bounds is the gap to the minimum where the problem is convex.
        if decrement < _DECREMENT_TO_SHRINK_MU and length > 0.5:
            if mu * rows < gap * program.basis.duration(now.c):
                break
            mu *= _MU_FACTOR
    return now.c


def _start_iterate(program: BarrierProgram, c: np.ndarray, mu: float) -> Iterate:
    values = program.rows.values(program.at.jets(c))
    above, below = program.rows.upper - values, values - program.rows.lower
    return Iterate(c, above, below, mu / above, mu / below)


def _step(program: BarrierProgram, now: Iterate, mu: float) -> tuple[float, float]:
    """One Newton step; its decrement in units of mu, and its length, 0 where none makes progress."""
    rows, at = program.rows, program.at
    jet = at.jets(now.c)
    # Hessian, point by point: multipliers over distances along the rows' slopes, and the rows' own curvature.
    first, second = rows.derivatives(jet)
    slopes = np.matmul(rows.factors, first.transpose(2, 0, 1))  # (N, R, J)
    stiffness = now.push_down / now.above + now.push_up / now.below
    outer = np.matmul((stiffness[:, :, None] * slopes).transpose(0, 2, 1), slopes)
    outer[:, 0, 0] += mu / jet[0] ** 2
    pushes = np.matmul((now.push_down - now.push_up)[:, None], rows.factors)[:, 0]
    bent = np.einsum("nk,kijn->nij", pushes, second)
    # Gradient of the barrier function, and the Newton step of c; coefficients at ends that move are fixed.
    force = np.matmul((mu / now.above - mu / now.below)[:, None], slopes)[:, 0]
    force[:, 0] -= mu / jet[0]
    slope, curvature = program.basis.duration_derivatives(now.c)
    gradient = slope + at.collect(force)
    gradient[~program.free] = 0
    move = -_solve_newton(program, outer, bent, curvature, gradient)
    # The rows' changes, and the Newton steps of the multipliers that follow from them.
    moved = np.matmul(slopes, at.jets(move)[: rows.jet].T[:, :, None])[:, :, 0]
    down = mu / now.above - now.push_down + now.push_down / now.above * moved
    up = mu / now.below - now.push_up - now.push_up / now.below * moved
    decrease = float(-gradient @ move)
    # Steps that stop short of the bounds: of c with a line search, of the multipliers without.
    length = min(1.0, _MAX_SHARE_TO_BOUND / max((moved / now.above).max(), (-moved / now.below).max(), 1e-9))
    taken = _line_search(program, now, mu, move, length, decrease)
    dual = min(1.0, _MAX_SHARE_TO_BOUND / max((-down / now.push_down).max(), (-up / now.push_up).max(), 1e-9))
    for push, change, distance in ((now.push_down, down, now.above), (now.push_up, up, now.below)):
        push += dual * change
        np.clip(push, 1e-10 * mu / distance, 1e10 * mu / distance, out=push)
    return decrease / mu, taken


def _solve_newton(
    program: BarrierProgram, outer: np.ndarray, bent: np.ndarray, curvature: np.ndarray, gradient: np.ndarray
) -> np.ndarray:
    """The Newton matrix's solution; where it is not positive definite, the bending of the rows is made so."""
    from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

    def factored(local: np.ndarray, shift: float = 0.0) -> np.ndarray:
        bands = curvature + program.at.bands(local)
        bands[-1] *= 1 + shift
        fixed = ~program.free
        for k in range(len(bands)):  # the k-th band from below holds the entries (j - k, j)
            row = bands[len(bands) - 1 - k]
            row[fixed] = 0
            row[k:][fixed[: len(row) - k]] = 0
        bands[-1, fixed] = bands[-1].max()
        return cholesky_banded(bands)

    try:
        return cho_solve_banded((factored(outer + bent), False), gradient)
    except LinAlgError:
        sizes, axes = np.linalg.eigh(outer + bent)
    convex = np.matmul(axes * sizes.clip(0)[:, None, :], axes.transpose(0, 2, 1))
    for shift in _DIAGONAL_SHIFTS:
        try:
            return cho_solve_banded((factored(convex, shift), False), gradient)
        except LinAlgError:  # rounding, where the speeds along the path differ by many powers of ten
            continue
    raise JounceError(UNEVEN)


def _line_search(
    program: BarrierProgram, now: Iterate, mu: float, move: np.ndarray, length: float, decrease: float
) -> float:
    """Move as far as the barrier function falls, and all rows stay within their bounds; how far that is."""
    floor = 0.1 * (1 - _MAX_SHARE_TO_BOUND)

    def barrier(c: np.ndarray, *distances: np.ndarray) -> float:
        return program.basis.duration(c) - mu * float(sum(np.log(distance).sum() for distance in distances))

    before = barrier(now.c, now.above, now.below, program.at.jets(now.c)[0])
    for _ in range(_MAX_LINE_SEARCH_HALVINGS):
        c = now.c + length * move
        jet = program.at.jets(c)
        if jet[0].min() > 0 and program.basis.speeds(c).min() > 0:
            values = program.rows.values(jet)
            above, below = program.rows.upper - values, values - program.rows.lower
            if (
                (above > floor * now.above).all()
                and (below > floor * now.below).all()
                and barrier(c, above, below, jet[0]) <= before - 1e-4 * length * decrease + 1e-12 * abs(before)
            ):
                now.c, now.above, now.below = c, above, below
                return length
        length /= 2
    return 0.0
