"""A barrier method finds the fastest spline x(sigma) within rows.

Its iterates are feasible.

Problem: the coefficients c of x = sigma'(t)^2 that minimize the duration, the integral of
x^(-1/2), while ``lower <= rows(x, x', x'', x''') <= upper`` at given points and x > 0 (steep friction draws x there
where the robot rests). Rows of velocities, accelerations and forces without damping are linear in c, and the problem is
convex [1]; those with a factor sqrt(x), as of jerks, are not, and a local minimum is found.

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
    """B-splines at N points, each with those that are not zero there.

    `index` (N, k + 1) are their places among the `count` coefficients, `values` (N, 4, k + 1) their values and first
    three derivatives.
    """

    index: np.ndarray
    values: np.ndarray
    count: int

    def select(self, points: np.ndarray | slice) -> "LocalSplines":
        """Return the same at some of the points."""
        return LocalSplines(self.index[points], self.values[points], self.count)

    def jets(self, c: np.ndarray) -> np.ndarray:
        """Evaluate x, x', x'', x''' at the points, (4, N).

        The spline has coefficients c.
        """
        # (N, 4, k + 1) times the k + 1 coefficients at each point, (N, k + 1, 1).
        return np.matmul(self.values, c[self.index][:, :, None])[:, :, 0].T

    def collect(self, force: np.ndarray) -> np.ndarray:
        """Return the gradient by the coefficients from that by the jets.

        The chain rule: the B-splines at a point share out its gradient by the jets, (J,), to k + 1 coefficients, and
        points are added up.
        """
        parts = np.matmul(force[:, None], self.values[:, : force.shape[1]])
        return np.bincount(self.index.ravel(), parts.ravel(), self.count)

    def bands(self, local: np.ndarray) -> np.ndarray:
        """Return the Hessian by the coefficients from that by the jets.

        Hessians by the jets are (N, J, J). That by the coefficients is symmetric and banded: the result (k + 1, count)
        holds its upper bands in LAPACK's order.
        """
        values = self.values[:, : local.shape[1]]
        # B^T H B at each point: a dense block (N, k + 1, k + 1) of the coefficients that are not zero there.
        parts = np.matmul(values.transpose(0, 2, 1), np.matmul(local, values))
        # Add the upper triangles of all blocks into the bands.
        rows, columns, places = self._places
        width = self.values.shape[2]
        return np.bincount(places, parts[:, rows, columns].ravel(), width * self.count).reshape(width, self.count)

    @cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rows, columns and places of a block's upper triangle.

        The places are those of the entries in the bands.
        """
        width = self.values.shape[2]
        rows, columns = np.triu_indices(width)
        # LAPACK holds the entry (i, j) of a matrix with upper bands at [k + i - j, j].
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
        """Return the knots, with both ends repeated."""
        return np.pad(np.linspace(self.first, self.last, self.intervals + 1), _TIME_LAW_DEGREE, mode="edge")

    @property
    def count(self) -> int:
        """Return the number of coefficients."""
        return self.intervals + _TIME_LAW_DEGREE

    def spline(self, c: np.ndarray) -> "BSpline":
        """Return the spline with coefficients c."""
        from scipy.interpolate import BSpline

        return BSpline(self.knots, c, _TIME_LAW_DEGREE, extrapolate=False)

    def refine(self, spline: "BSpline") -> np.ndarray:
        """Return the coefficients of a spline of fewer intervals, exactly.

        Each of its intervals is several of these, so that interpolation at as many points as coefficients is exact.
        """
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self._greville, spline(self._greville), k=_TIME_LAW_DEGREE, t=self.knots).c

    def approximate(self, x: "BSpline") -> np.ndarray:
        """Return the coefficients of a spline near to another function: Schoenberg's.

        It takes the values at the Greville points as coefficients, and stays within the range of the function.
        """
        return np.asarray(x(self._greville))

    @cached_property
    def _greville(self) -> np.ndarray:
        """Return the mean of the inner knots of each B-spline: where it is largest, about."""
        means = [self.knots[i + 1 : i + _TIME_LAW_DEGREE + 1].mean() for i in range(self.count)]
        return np.array(means).clip(self.first, self.last)  # means of equal knots are off by rounding

    def evaluate(self, sigma: np.ndarray) -> LocalSplines:
        """Evaluate the B-splines at points, once for each set of points."""
        from scipy.interpolate import BSpline

        # The interval of each point; at the end of the last one the point belongs to that.
        i = (np.searchsorted(self.knots, sigma, side="right") - 1).clip(_TIME_LAW_DEGREE, self.count - 1)
        index = (i - _TIME_LAW_DEGREE)[:, None] + np.arange(_TIME_LAW_DEGREE + 1)
        values = np.empty((len(sigma), path_terms.JET_SIZE, _TIME_LAW_DEGREE + 1))
        rows = np.arange(len(sigma))
        # Every (k + 1)-th B-spline at once: no two of them overlap, so that one spline holds their values apart.
        for phase in range(_TIME_LAW_DEGREE + 1):
            every_sixth = (np.arange(self.count) % (_TIME_LAW_DEGREE + 1) == phase).astype(float)
            splines = BSpline(self.knots, every_sixth, _TIME_LAW_DEGREE)
            for k in range(path_terms.JET_SIZE):
                values[rows, k, (phase - index[:, 0]) % (_TIME_LAW_DEGREE + 1)] = splines(sigma, nu=k)
        return LocalSplines(index, values, self.count)

    def speeds(self, c: np.ndarray) -> np.ndarray:
        """Evaluate x at the points at which the duration is evaluated."""
        return self._quadrature[0].jets(c)[0]

    def duration(self, c: np.ndarray) -> float:
        """Return the duration: the integral of 1 / sqrt(x)."""
        return float(self._quadrature[1] @ self.speeds(c) ** -0.5)

    def duration_derivatives(self, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return gradient and Hessian of the duration by the coefficients.

        The Hessian is given by its upper bands.
        """
        nodes, weights = self._quadrature
        x = self.speeds(c)
        # The derivatives of w x^(-1/2) by x at each node; the duration takes x alone of the jets.
        gradient, hessian = -0.5 * weights * x**-1.5, 0.75 * weights * x**-2.5
        return nodes.collect(gradient[:, None]), nodes.bands(hessian[:, None, None])

    @cached_property
    def _quadrature(self) -> tuple[LocalSplines, np.ndarray]:
        """Return the B-splines at the nodes of all intervals, with weights."""
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
    """A problem of the barrier method: rows at points of a path.

    `at` are the B-splines at the points; `free` says which coefficients may change.
    """

    basis: Basis
    at: LocalSplines
    rows: LimitRows
    free: np.ndarray

    def feasible(self, c: np.ndarray) -> bool:
        """Whether all rows keep some distance from their bounds."""
        jet = self.at.jets(c)
        return bool(
            jet[0].min() > 0 and self.basis.speeds(c).min() > 0 and self.rows.excess(jet).max() < -_MIN_BOUND_DISTANCE
        )


def find_feasible(program: BarrierProgram, c: np.ndarray) -> np.ndarray | None:
    """Find coefficients whose rows are all within their bounds.

    The search begins at any c with x > 0, and returns None where it finds none. The bounds are widened until they hold,
    and then drawn in as the centre of what they leave moves.
    """
    jet = program.at.jets(c)
    for _ in range(_MAX_BARRIER_STEPS):
        excess = float(program.rows.excess(jet).max())
        if excess < -_MIN_BOUND_DISTANCE:
            return c
        # Bounds so wide that c is strictly within them, and a few steps towards their centre.
        wider = program.rows.widen(max(1.05 * excess, 0.0) + 20 * _MIN_BOUND_DISTANCE)
        relaxed = BarrierProgram(program.basis, program.at, wider, program.free)
        # A heavy barrier: the centre counts, and the duration hardly does.
        mu = _CENTRING_WEIGHT * program.basis.duration(c) / wider.factors[:, :, 0].size
        iterate = _start_iterate(relaxed, c, mu)
        for _ in range(_CENTRING_STEPS):
            _step(relaxed, iterate, mu)
        c, jet = iterate.c, program.at.jets(iterate.c)
        # Without progress by Armijo's rule the centre of the widened bounds stays outside of the given ones.
        if program.rows.excess(jet).max() > excess - 1e-4 * abs(excess):
            return None
    return None


@dataclass(eq=False)
class Iterate:
    """The state of the method; each step changes it in place.

    `above` and `below` (N, R) are the distances of the rows from their upper and lower bounds; `push_down` and
    `push_up` are the multipliers of these bounds.
    """

    c: np.ndarray
    above: np.ndarray
    below: np.ndarray
    push_down: np.ndarray
    push_up: np.ndarray


def minimize_duration(program: BarrierProgram, c: np.ndarray, gap: float, first: float = 1.0) -> np.ndarray:
    """Find the coefficients of the fastest x, from feasible ones.

    At most about a share `gap` of the duration is missed. `first` is the share of the duration that the rows may miss
    in the first problem: 1 far from the solution, less from that of a similar problem.
    """
    # Each of the bounds keeps the duration mu above the minimum: the first mu is that of the share `first`.
    bounds, duration = 2 * program.rows.factors[:, :, 0].size, program.basis.duration(c)
    mu = first * duration / bounds
    iterate = _start_iterate(program, c, mu)
    for _ in range(_MAX_BARRIER_STEPS):
        decrement, length = _step(program, iterate, mu)
        # No step makes progress: what is reached is the result, as every iterate is feasible.
        if length == 0:
            break
        # Nearly central: mu times the number of bounds is the gap to the minimum where the problem is convex.
        if decrement < _DECREMENT_TO_SHRINK_MU and length > 0.5:
            if mu * bounds < gap * program.basis.duration(iterate.c):
                break
            mu *= _MU_FACTOR
    return iterate.c


def _start_iterate(program: BarrierProgram, c: np.ndarray, mu: float) -> Iterate:
    """Return an iterate on the central path, at coefficients c.

    The multipliers on the path are mu / distance.
    """
    values = program.rows.values(program.at.jets(c))
    above, below = program.rows.upper - values, values - program.rows.lower
    return Iterate(c, above, below, mu / above, mu / below)


def _step(program: BarrierProgram, iterate: Iterate, mu: float) -> tuple[float, float]:
    """Take one Newton step, and return its decrement and its length.

    The decrement is in units of mu; the length is 0 where no step makes progress. Shapes: N points, R rows, K products,
    J of the four entries of a jet.
    """
    rows, at = program.rows, program.at
    jet = at.jets(iterate.c)
    # Derivatives of the products by the jets; times the factors, the slopes of the rows: (N, R, K) (N, K, J).
    first, second = rows.derivatives(jet)
    slopes = np.matmul(rows.factors, first.transpose(2, 0, 1))
    # Hessian by the jets, point by point, (N, J, J). Multipliers over distances along the slopes of the rows, as for
    # bounds that are linear; the barrier of x > 0 adds mu / x^2.
    stiffness = iterate.push_down / iterate.above + iterate.push_up / iterate.below
    stiffening = np.matmul((stiffness[:, :, None] * slopes).transpose(0, 2, 1), slopes)
    stiffening[:, 0, 0] += mu / jet[0] ** 2
    # The curvature of the rows, weighted by their multipliers, which may be indefinite.
    pushes = np.matmul((iterate.push_down - iterate.push_up)[:, None], rows.factors)[:, 0]
    bending = np.einsum("nk,kijn->nij", pushes, second)
    # Gradient of the barrier function duration - mu sum log(distances) - mu sum log(x).
    force = np.matmul((mu / iterate.above - mu / iterate.below)[:, None], slopes)[:, 0]
    force[:, 0] -= mu / jet[0]
    slope, curvature = program.basis.duration_derivatives(iterate.c)
    gradient = slope + at.collect(force)
    # Newton step of c; coefficients at ends that move are fixed.
    gradient[~program.free] = 0
    move = -_solve_newton(program, stiffening, bending, curvature, gradient)
    # The changes of the rows, and the Newton steps of the multipliers: z (distance - change) = mu, linearized.
    row_change = np.matmul(slopes, at.jets(move)[: rows.jet].T[:, :, None])[:, :, 0]
    down = mu / iterate.above - iterate.push_down + iterate.push_down / iterate.above * row_change
    up = mu / iterate.below - iterate.push_up - iterate.push_up / iterate.below * row_change
    decrease = float(-gradient @ move)
    # Steps that stop short of the bounds: of c with a line search, of the multipliers without.
    nearest = max((row_change / iterate.above).max(), (-row_change / iterate.below).max(), 1e-9)
    length = _line_search(program, iterate, mu, move, min(1.0, _MAX_SHARE_TO_BOUND / nearest), decrease)
    nearest = max((-down / iterate.push_down).max(), (-up / iterate.push_up).max(), 1e-9)
    dual = min(1.0, _MAX_SHARE_TO_BOUND / nearest)
    # Multipliers stay within ten powers of ten about mu / distance [3], so that the Hessian is that of the barrier.
    for push, change, distance in ((iterate.push_down, down, iterate.above), (iterate.push_up, up, iterate.below)):
        push += dual * change
        np.clip(push, 1e-10 * mu / distance, 1e10 * mu / distance, out=push)
    return decrease / mu, length


def _solve_newton(
    program: BarrierProgram, stiffening: np.ndarray, bending: np.ndarray, curvature: np.ndarray, gradient: np.ndarray
) -> np.ndarray:
    """Solve the Newton system for the gradient.

    Where the Newton matrix is not positive definite, the Hessians of the points lose their negative eigenvalues.
    """
    from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

    def factorize(local: np.ndarray, shift: float = 0.0) -> np.ndarray:
        # The Newton matrix (k + 1, count): the duration's bands and those of the points' Hessians.
        bands = curvature + program.at.bands(local)
        bands[-1] *= 1 + shift
        # Fixed coefficients: their rows and columns are those of a diagonal matrix, so that they do not move.
        fixed = ~program.free
        for k in range(len(bands)):
            # The k-th band from below holds the entries (j - k, j).
            row = bands[len(bands) - 1 - k]
            row[fixed] = 0
            row[k:][fixed[: len(row) - k]] = 0
        bands[-1, fixed] = bands[-1].max()
        return cholesky_banded(bands)

    try:
        return cho_solve_banded((factorize(stiffening + bending), False), gradient)
    except LinAlgError:
        eigenvalues, axes = np.linalg.eigh(stiffening + bending)
    # Rows bend the wrong way: without negative eigenvalues each point adds a convex function.
    convex = np.matmul(axes * eigenvalues.clip(0)[:, None, :], axes.transpose(0, 2, 1))
    # Rounding may still leave no factor, where the speeds along the path differ by many powers of ten.
    for shift in _DIAGONAL_SHIFTS:
        try:
            return cho_solve_banded((factorize(convex, shift), False), gradient)
        except LinAlgError:
            continue
    raise JounceError(UNEVEN)


def _line_search(
    program: BarrierProgram, iterate: Iterate, mu: float, move: np.ndarray, length: float, decrease: float
) -> float:
    """Move the iterate as far as the barrier function falls.

    Returns the length of the move, within which all rows keep their bounds. The first length that is tried is `length`,
    which is halved until it fits; `decrease` is how much the barrier function falls for each unit of length at the
    start.
    """
    # Rows that are not linear may end nearer to a bound than the length foresees, but not by more than this share.
    floor = 0.1 * (1 - _MAX_SHARE_TO_BOUND)

    def barrier(c: np.ndarray, *distances: np.ndarray) -> float:
        return program.basis.duration(c) - mu * float(sum(np.log(distance).sum() for distance in distances))

    before = barrier(iterate.c, iterate.above, iterate.below, program.at.jets(iterate.c)[0])
    for _ in range(_MAX_LINE_SEARCH_HALVINGS):
        c = iterate.c + length * move
        jet = program.at.jets(c)
        if jet[0].min() > 0 and program.basis.speeds(c).min() > 0:
            # x > 0 here and at the nodes of the duration, so that all logarithms and roots exist.
            values = program.rows.values(jet)
            above, below = program.rows.upper - values, values - program.rows.lower
            # Armijo's rule, with room for rounding of the barrier function.
            if (
                (above > floor * iterate.above).all()
                and (below > floor * iterate.below).all()
                and barrier(c, above, below, jet[0]) <= before - 1e-4 * length * decrease + 1e-12 * abs(before)
            ):
                iterate.c, iterate.above, iterate.below = c, above, below
                return length
        length /= 2
    return 0.0
