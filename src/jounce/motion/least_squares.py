"""Fit least-squares splines of degree 9 over any knots, with their covariance.

Problem: the coefficients c that minimise ``|B c - y|^2``. Each sample has a row of B, which is the values of B-splines
at its time, and one of y, both times its weight.

Algorithm: B-splines of degree 9 overlap by ten, so the normal equations ``B^T B c = B^T y`` of any number of samples
are banded (de Boor, A Practical Guide to Splines, XIV). In each interval they follow from sums of Chebyshev polynomials
over the samples, since a product of two of them is the mean of two others. They are solved by Cholesky's method,
``B^T B = L L^T``, and refined once where samples fit so well that the rounding of normal equations shows. The same L
gives the blocks of ``(B^T B)^-1`` by which `jounce.motion.reliability` knows what noise does (`covariance_blocks`).

`Samples` are those of some joints, as all steps of a smoothing pass them on; `Samples.rows` makes the rows of a
problem. Many fits of a long log share one compression (`compress_cells`): the samples of a cell become ten rows, the
nodes and weights of Gauss' quadrature over them. Sums over the samples of polynomials up to degree 19 are the same over
these rows (Golub & Welsch, Mathematics of Computation 23, 1969), hence normal equations too, as long as knots lie at
the edges of cells, to which `SplineRows.snap` moves them; the right sides are those of the polynomial that fits best.

`make_rows` or `compress_rows` run once for samples, `make_equations` once for breaks, `SplineEquations.fit` once for
right sides; `solve` is the last two. `basis` and what stands with it are B-splines, their derivatives, and their pieces
as sums of Chebyshev polynomials.

Cholesky's method raises `LinAlgError` where the samples leave a coefficient undetermined:
`jounce.motion.knots.fit_breaks` drops breaks until they do not.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.interpolate import BSpline
    from scipy.sparse import csr_array


MAX_SCATTER_ROWS = 20000  # from which a usual scatter is estimated: more only take time
MIN_FIT_SAMPLES = 24  # more than twice the ten coefficients of one interval, so that noise can be estimated
MIN_CELLS = 8192  # that a long log is compressed to, ten rows each; more where it needs more intervals
MIN_COVERED_SHARE = 0.8  # of each interval by its rows: beside a hole the products of Chebyshev polynomials are alike
MIN_REFINED_SHARE = 1e-6  # of the samples: smaller residuals show the rounding of normal equations, and are refined
FIT_DEGREE = 9  # q4d has five continuous derivatives more, and Q2d no kinks
BASIS_WIDTH = FIT_DEGREE + 1  # B-splines that overlap in an interval
POINTS_AT_ONCE = 2**13  # at which values are computed: they stay in a processor's cache,
INTERVALS_AT_ONCE = 2**9  # as those at ten points in each of these do


@dataclass(frozen=True, eq=False)
class SplineRows:
    """Rows of a least-squares problem for a spline in time.

    At `t` the values of the spline times the weights are to equal `y`.
    """

    t: np.ndarray  # (P,), increasing; ten in each cell if compressed
    y: np.ndarray  # (P, n), right sides times the weights
    weight: np.ndarray  # (P,), inverse standard deviations up to a factor
    edges: np.ndarray | None  # (C + 1,) of cells of ten rows or more, where alone knots may be
    span: tuple[float, float]  # the first and the last time of the samples
    count: float  # of samples, each by its weight squared
    rest: np.ndarray  # (n,), squares that no polynomial in a cell reaches, left out of the rows
    # Where stamps are in doubt: velocities v (P, n) and variances D (n,). What shifts of rows explain is no residual.
    along: tuple[np.ndarray, np.ndarray] | None = None

    def across(self, residual: np.ndarray) -> np.ndarray:
        """Return residuals (P, n) without what a shift in time explains.

        A row that is read later by tau is off by v tau. The shift of least squares in units of the joints'
        noise takes off v (v^T D^-1 r) / (v^T D^-1 v).
        """
        if self.along is None:
            return residual
        v, variance = self.along
        # A robot at rest, v = 0, keeps its residuals: the tiny divisor makes 0 of 0 / 0.
        squares = np.maximum((v**2 / variance).sum(axis=1), np.finfo(float).tiny)
        return residual - v * ((v * residual / variance).sum(axis=1) / squares)[:, None]

    def snap(self, breaks: np.ndarray) -> np.ndarray:
        """Return breaks, each moved to the nearest edge of a cell.

        Within a cell there are no breaks, since its ten rows stand for the sums of all its samples.
        """
        if self.edges is None:
            return breaks
        # The edge behind each break, and whether the one before it is nearer.
        behind = np.searchsorted(self.edges, breaks).clip(1, len(self.edges) - 1)
        is_before_nearer = breaks - self.edges[behind - 1] < self.edges[behind] - breaks
        # Several breaks may move to one edge, and are one break then.
        snapped = np.unique(self.edges[behind - is_before_nearer])
        snapped[0], snapped[-1] = self.span
        return snapped


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of some joints, as they are smoothed."""

    t: np.ndarray  # (N,), increasing
    q: np.ndarray  # (N, n)
    weight: np.ndarray  # (N,), of the rows
    span: tuple[float, float]  # the first and the last time of the spline
    steps: np.ndarray  # (n,), of encoders or of written digits, otherwise 0
    # Where stamps are in doubt: a spline to take velocities from, and each joint's own variance (n,).
    drift: "tuple[BSpline, np.ndarray] | None" = None
    unsure: np.ndarray | None = None  # (n,), by how much each sensor may be read earlier than the times say, s

    @cached_property
    def floor(self) -> np.ndarray:
        """The variance (n,) that counts as rounding of doubles."""
        return np.maximum((4 * np.finfo(float).eps * np.abs(self.q).max(axis=0)) ** 2, np.finfo(float).tiny)

    def joints(self, which: np.ndarray) -> "Samples":
        """Return the samples of some of the joints."""
        unsure = None if self.unsure is None else self.unsure[which]
        return replace(self, q=self.q[:, which], steps=self.steps[which], unsure=unsure)

    def part(self, rows: np.ndarray) -> "Samples":
        """Return some of the rows."""
        return replace(self, t=self.t[rows], q=self.q[rows], weight=self.weight[rows])

    def rows(self, cells: int) -> SplineRows:
        """Return the rows of a least-squares problem.

        Many samples are compressed to a number of cells.
        """
        rows = compress_rows(self.t, self.q, self.weight, self.span, cells)
        if self.drift is None:
            return rows
        spline, variance = self.drift
        return replace(rows, along=(spline(rows.t, nu=1), variance))

    def all_rows(self, cells: int) -> SplineRows:
        """Return the rows of all samples, with breaks at edges of cells.

        Splines of these rows may have the knots that compressed rows allow. For few fits this is faster than to
        compress.
        """
        _, edges = cut_cells(self.t, self.span, cells)
        return make_rows(self.t, self.q, self.weight, self.span, edges)


@dataclass(frozen=True, eq=False)
class SplineSolution:
    """A least-squares spline of M intervals."""

    breaks: np.ndarray  # (M + 1,)
    coefficients: np.ndarray  # (M + 9, n)
    residual: np.ndarray  # (P, n), what it leaves of the rows, times their weights
    factor: np.ndarray  # (10, M + 9), Cholesky factor of the normal equations in lower bands
    energy: np.ndarray  # (n,), sums of squares of what it leaves of the samples

    @property
    def intervals(self) -> int:
        """The number of intervals between breaks."""
        return len(self.breaks) - 1

    @property
    def unknowns(self) -> int:
        """The number of coefficients per joint."""
        return len(self.coefficients)

    @property
    def spline(self) -> "BSpline":
        """The spline as a function."""
        from scipy.interpolate import BSpline

        return BSpline(pad_knots(self.breaks), self.coefficients, FIT_DEGREE)


def make_rows(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, span: tuple[float, float], edges: np.ndarray | None = None
) -> SplineRows:
    """Return the rows of samples y (N, n) at times t."""
    return SplineRows(t, y * weight[:, None], weight, edges, span, float((weight**2).sum()), np.zeros(y.shape[1]))


def cut_cells(t: np.ndarray, span: tuple[float, float], cells: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the first samples and the ends (C + 1,) of cells.

    There are about as many cells as asked for. There are no ends, None, where the cells would hold too few
    samples.
    """
    # To compress pays only where ten rows stand for twice as many samples or more.
    size = len(t) // cells
    if size < 2 * BASIS_WIDTH:
        return np.array([0, len(t)]), None
    # As many cells as samples fill, rounded up: their sizes differ by one sample at most.
    cells = -(-len(t) // size)
    starts = np.arange(cells + 1) * len(t) // cells
    # A cell ends in the middle between its last sample and the next one.
    return starts, np.concatenate([span[:1], (t[starts[1:-1]] + t[starts[1:-1] - 1]) / 2, span[1:]])


def compress_rows(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, span: tuple[float, float], cells: int
) -> SplineRows:
    """Return rows of samples, compressed where that halves their number."""
    starts, edges = cut_cells(t, span, cells)
    if edges is None:
        return make_rows(t, y, weight, span)
    times, right, weights, lost = compress_cells(t, y, weight, starts, edges)
    return SplineRows(times, right, weights, edges, span, float((weight**2).sum()), lost)


def solve(rows: SplineRows, breaks: np.ndarray) -> SplineSolution:
    """Return the least-squares spline with these breaks.

    Raises `LinAlgError` where the samples leave a coefficient undetermined.
    """
    return solve_equations(rows, breaks, make_equations(rows, breaks))


@dataclass(frozen=True, eq=False)
class SplineEquations:
    """The factored normal equations B^T B of rows and breaks.

    `factorize` makes them with B = T E, and `fit` solves them for any right sides. T are weighted values at each row of
    ten functions per interval, and E makes the interval's ten B-splines of these functions. Neighbouring intervals
    share nine B-splines, whose parts are added.

    The functions are Chebyshev polynomials, where the rows of each interval distinguish these, since
    2 T_i T_j = T_(i + j) + T_|i - j| saves most products. Otherwise they are the B-splines themselves, which may be so
    small at the few rows of an interval that only sums of their own products are exact enough.
    """

    T: "np.ndarray | csr_array"  # (P / 10, 10, 10) if each ten rows are in one interval, otherwise (P, 10 M)
    E: np.ndarray  # (M, 10, 10), or the unit matrix (10, 10)
    sums: "csr_array | None"  # (M, P / 10), over the tens of rows in each interval
    factor: np.ndarray  # (10, M + 9), Cholesky factor L of B^T B in lower bands: factor[k, i] is L_(i + k) i

    def fit(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return coefficients of least squares, and residuals.

        The coefficients c make |B c - y| least, and the residuals are y - B c. Right sides y (P, n) give
        coefficients c (M + 9, n) and residuals (P, n).
        """
        from scipy.linalg import cho_solve_banded

        intervals = self.factor.shape[1] - FIT_DEGREE
        coefficients, residual = np.zeros((self.factor.shape[1], y.shape[1])), y
        # Iterative refinement, c += (B^T B)^-1 B^T (y - B c), begins with c = 0. One round suffices, unless it leaves
        # so little that this is the rounding of the normal equations: then there are two.
        while True:
            # Shares of intervals in B^T r are E^T T^T r, (M, 10, n); coefficient i + a gets the a-th of interval i.
            right = np.zeros(coefficients.shape)
            shares = self.E.mT @ self._sum_by_interval(residual)
            for a in range(BASIS_WIDTH):
                right[a : a + intervals] += shares[:, a]
            coefficients += cho_solve_banded((self.factor, True), right, check_finite=False)
            # The ten coefficients that count in each interval: (M + 9, n) -> (M, n, 10).
            by_interval = np.lib.stride_tricks.sliding_window_view(coefficients, BASIS_WIDTH, axis=0)
            # The values B c are new memory, in which the residual y - B c takes their place.
            before, residual = residual, self._evaluate(self.E @ by_interval.mT)
            np.subtract(y, residual, out=residual)
            is_refined = before is not y
            if is_refined or (sum_squares(residual) > MIN_REFINED_SHARE**2 * sum_squares(y)).all():
                return coefficients, residual

    def _sum_by_interval(self, y: np.ndarray) -> np.ndarray:
        """Return T^T y of rows (P, n), (M, 10, n)."""
        if not isinstance(self.T, np.ndarray):
            return np.asarray(self.T.T @ y).reshape(-1, BASIS_WIDTH, y.shape[1])
        # Blocks of ten rows first, each with its dense block of T, then the blocks of each interval.
        by_ten = self.T.mT @ y.reshape(len(self.T), BASIS_WIDTH, -1)
        return np.asarray(self.sums @ by_ten.reshape(len(by_ten), -1)).reshape(-1, *by_ten.shape[1:])

    def _evaluate(self, local: np.ndarray) -> np.ndarray:
        """Return T times coefficients (M, 10, n) by interval, (P, n)."""
        if isinstance(self.T, np.ndarray) and self.sums is not None:
            # Each block of ten rows takes the coefficients of its interval: (M, 10, n) -> (P / 10, 10, n).
            local = self.T @ np.repeat(local, np.diff(self.sums.indptr), axis=0)
            return local.reshape(-1, local.shape[2])
        return np.asarray(self.T @ local.reshape(-1, local.shape[2]))


def make_equations(rows: SplineRows, breaks: np.ndarray) -> SplineEquations:
    """Return the normal equations of splines with these breaks.

    Raises `LinAlgError` as `solve` does.
    """
    return factorize(rows.t, rows.weight, breaks, in_cells=rows.edges is not None)


def solve_equations(rows: SplineRows, breaks: np.ndarray, equations: SplineEquations) -> SplineSolution:
    """Return the least-squares spline with these breaks, from its equations."""
    coefficients, residual = equations.fit(rows.y)
    # Where stamps are in doubt, what shifts of rows explain counts neither as residual nor as energy.
    residual = rows.across(residual)
    return SplineSolution(breaks, coefficients, residual, equations.factor, sum_squares(residual) + rows.rest)


def covariance_blocks(factor: np.ndarray) -> np.ndarray:
    """Return blocks of (B^T B)^-1, (M, 10, 10).

    A block is among the ten coefficients of an interval: times the variance of white noise it is their covariance.
    All follow from the banded Cholesky factor (10, M + 9). The inverse is full, but only its band is needed, and
    follows from itself, last column first: Hutchinson & de Hoog, Smoothing noisy data with spline functions,
    Numerische Mathematik 47 (1985).
    """
    # With B^T B = L L^T the inverse Z = L^-T L^-1 fulfils Z L = L^-T, whose right side is upper triangular with
    # 1 / L_ii on its diagonal. L has nine entries below each diagonal one, so that column i of Z follows from the nine
    # rows and columns behind it. Behind the last column they count as 0.
    unknowns = factor.shape[1]
    blocks = np.empty((unknowns - FIT_DEGREE, BASIS_WIDTH, BASIS_WIDTH))
    window = np.zeros((BASIS_WIDTH, BASIS_WIDTH))  # of the inverse: ten rows and columns from column i on, symmetric
    for i in range(unknowns - 1, -1, -1):
        # L_ii, and the nine L_ki / L_ii below it.
        pivot = factor[0, i]
        lower = factor[1:, i] / pivot
        # Below the diagonal L^-T is 0: Z_ji = - sum_k Z_jk L_ki / L_ii, over the nine k behind i, where Z is known from
        # the window of column i + 1.
        known = window[:FIT_DEGREE, :FIT_DEGREE]
        column = -known @ lower
        # On the diagonal it is 1 / L_ii: Z_ii = 1 / L_ii^2 - sum_k L_ki / L_ii Z_ki.
        diagonal = 1 / pivot**2 - lower @ column
        # The window moves by one column: what was last in it is no longer needed.
        window = np.empty((BASIS_WIDTH, BASIS_WIDTH))
        window[0, 0], window[0, 1:], window[1:, 0], window[1:, 1:] = diagonal, column, column, known
        # The nine last columns begin no interval.
        if i < len(blocks):
            blocks[i] = window
    return blocks


# Sums of squares, and the normal equations of rows and breaks.
def sum_squares(columns: np.ndarray) -> np.ndarray:
    """Return the sums (n,) of squares of columns (P, n)."""
    return np.asarray(np.einsum("pj,pj->j", columns, columns))


def factorize(t: np.ndarray, weight: np.ndarray, breaks: np.ndarray, in_cells: bool) -> SplineEquations:
    """Return the equations of rows and of splines with some breaks.

    Rows at t (P,) have weights (P,). Where they are `in_cells`, each interval holds ten of them or more. Raises
    `LinAlgError` where the equations are singular.
    """
    from scipy.linalg import cholesky_banded
    from scipy.sparse import csr_array

    # The rows of interval i are bounds[i] to bounds[i + 1]; `place` (P,) is the interval of each row.
    intervals, k = len(breaks) - 1, np.arange(BASIS_WIDTH)
    bounds = np.concatenate([[0], np.searchsorted(t, breaks[1:-1]), [len(t)]])
    # Rows that lie in a part of their interval only, beside a hole, do not tell Chebyshev polynomials apart.
    by_chebyshev = in_cells and bool((t[bounds[1:] - 1] - t[bounds[:-1]] > MIN_COVERED_SHARE * np.diff(breaks)).all())
    # The sparse T has ten entries per row: their numbers fit into 32 bits nearly always, which halves its indices.
    index = np.int32 if BASIS_WIDTH * len(t) <= np.iinfo(np.int32).max else np.int64
    place, scale = np.repeat(np.arange(intervals, dtype=index), np.diff(bounds)), 2 / np.diff(breaks)
    E = chebyshev_coefficients(breaks) if by_chebyshev else np.eye(BASIS_WIDTH)
    # The weighted rows of T, (P, 10): those of Chebyshev polynomials are filled in below.
    values = np.empty((len(place), BASIS_WIDTH)) if by_chebyshev else basis(t, breaks)[0] * weight[:, None]
    # B^T B in lower bands, (10, M + 9), is a sum of Gram matrices, (10, 10) of each interval: the products of its ten
    # B-splines, summed over its rows. Those of some intervals at a time stay in the cache.
    banded = np.zeros((BASIS_WIDTH, intervals + FIT_DEGREE))
    step = 1 + min(INTERVALS_AT_ONCE, POINTS_AT_ONCE * intervals // len(place))
    for start in range(0, intervals, step):
        some, part_bounds = slice(start, start + step), bounds[start : start + step + 1]
        # `np.add.reduceat` sums from each first row to the next one: intervals without rows are left out, and stay 0.
        rows, filled = slice(part_bounds[0], part_bounds[-1]), np.flatnonzero(np.diff(part_bounds))
        firsts = part_bounds[filled] - part_bounds[0]
        if by_chebyshev:
            # T_0 to T_18 at x from -1 to 1 over each interval, (19, rows): products of T_0 to T_9 reach T_18.
            local = evaluate_chebyshev((t[rows] - breaks[place[rows]]) * scale[place[rows]] - 1, 2 * FIT_DEGREE + 1)
            local *= weight[rows]
            values[rows] = local[:BASIS_WIDTH].T
            # Moments m_k = sum of w^2 T_k over the rows of each interval, (intervals, 19).
            local *= weight[rows]
            moments = np.zeros((len(part_bounds) - 1, len(local)))
            moments[filled] = np.add.reduceat(local, firsts, axis=1).T
            # The Gram matrix G of Chebyshev polynomials is (m_(i + j) + m_|i - j|) / 2, that of B-splines E^T G E.
            gram = (moments[:, k[:, None] + k] + moments[:, np.abs(k[:, None] - k)]) / 2
            gram = E[some].mT @ gram @ E[some]
        else:
            gram = np.zeros((len(part_bounds) - 1, BASIS_WIDTH, BASIS_WIDTH))
            gram[filled] = np.add.reduceat(values[rows, :, None] * values[rows, None], firsts)
        # The a-th B-spline of interval i has the number i + a: row a of its Gram matrix, from the diagonal on, adds to
        # column i + a of the lower bands.
        for a in range(BASIS_WIDTH):
            banded[: BASIS_WIDTH - a, start + a : start + a + len(gram)] += gram[:, a, a:].T
    factor = cholesky_banded(banded, lower=True, check_finite=False)
    # Compressed rows come in tens that lie in one interval: T is dense blocks (P / 10, 10, 10), and a sparse matrix
    # sums the blocks of an interval.
    if not (bounds % BASIS_WIDTH).any():
        cells = np.arange(len(t) // BASIS_WIDTH)
        sums = csr_array((np.ones(len(cells)), cells, bounds // BASIS_WIDTH), shape=(intervals, len(cells)))
        return SplineEquations(values.reshape(-1, BASIS_WIDTH, BASIS_WIDTH), E, sums, factor)
    # Rows of any number per interval make a sparse T, (P, 10 M).
    columns = place[:, None] * BASIS_WIDTH + k.astype(index)
    ends = np.arange(0, values.size + 1, BASIS_WIDTH, dtype=index)
    T = csr_array((values.ravel(), columns.ravel(), ends), shape=(len(place), intervals * BASIS_WIDTH))
    return SplineEquations(T, E, None, factor)


# B-splines, and their pieces as sums of Chebyshev polynomials.
def pad_knots(breaks: np.ndarray) -> np.ndarray:
    """Return knots: the breaks, of which both ends count ten times."""
    return np.pad(breaks, FIT_DEGREE, mode="edge")


def basis(t: np.ndarray, breaks: np.ndarray, order: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return the ten B-splines, or a derivative of them, at times t.

    Values (P, 10) are of the B-splines that differ from 0 at t; the intervals (P,) of t come with them. The
    coefficients of a derivative are divided differences, d (c_j - c_j-1) / (knot_j+d - knot_j) with the degree
    d.
    """
    # The last interval includes its end, and times outside of the breaks count to the first or the last interval.
    place = np.searchsorted(breaks, t, side="right").clip(1, len(breaks) - 1) - 1
    all_knots, degree = pad_knots(breaks), FIT_DEGREE - order
    knots, values = all_knots[order : len(all_knots) - order], np.empty((len(t), degree + 1))
    # Values of the B-splines of the degree that the derivative has: 9 less its order, (P, 10 - order).
    for start in range(0, len(t), POINTS_AT_ONCE):
        some = slice(start, start + POINTS_AT_ONCE)
        around = knots[place[some] + np.arange(1, 2 * degree + 1)[:, None]]
        values[some] = _evaluate_basis(t[None, some], around)[:, 0].T
    # Each derivative raises the degree by one, up to 9: that of a B-spline is d times the difference of the two of
    # degree d - 1 that begin at its first and at its second knot, each divided by the time that it spans.
    for degree in range(FIT_DEGREE - order + 1, BASIS_WIDTH):
        j = place[:, None] + np.arange(BASIS_WIDTH - degree, BASIS_WIDTH)
        scaled = values * degree / (all_knots[j + degree] - all_knots[j])
        values = np.pad(scaled, ((0, 0), (1, 0))) - np.pad(scaled, ((0, 0), (0, 1)))
    return values, place


def _evaluate_basis(t: np.ndarray, around: np.ndarray) -> np.ndarray:
    """Return the d + 1 B-splines that count at times t.

    Times (K, M) give values (d + 1, K, M), by the recursion of Cox and de Boor. The knots `around` (2 d, M) are
    the last d before the times, and the first d behind them.
    """
    degree = len(around) // 2
    ahead, lower = around[:, None] - t, np.ones((1, *t.shape))
    for k in range(1, degree + 1):
        # Each B-spline of degree k - 1, from a knot to knot', passes shares to the two of degree k that contain it:
        # (t - knot) / (knot' - knot) to the later one, (knot' - t) / (knot' - knot) to the earlier one. `ahead` is
        # knots less t, negative for knots before t.
        share = lower * (1 / (around[degree : degree + k] - around[degree - k : degree]))[:, None]
        lower = np.zeros((k + 1, *t.shape))
        lower[1:] -= ahead[degree - k : degree] * share
        lower[:-1] += ahead[degree : degree + k] * share
    return lower


def chebyshev_coefficients(breaks: np.ndarray) -> np.ndarray:
    """Return the B-splines of each interval as sums of Chebyshev polynomials.

    They are (M, 10, 10): numbers k of T_k over the interval first, B-splines last.
    """
    # Interpolation at ten Chebyshev nodes x_j = cos(angle_j) is exact for degree 9: a discrete cosine transform of the
    # values there gives the coefficients, that of T_0 with half the factor.
    angles = np.pi * (np.arange(BASIS_WIDTH) + 0.5) / BASIS_WIDTH
    interpolation = np.cos(np.arange(BASIS_WIDTH)[:, None] * angles) * 2 / BASIS_WIDTH
    interpolation[0] /= 2
    # The 18 knots next to each interval, nine on either side: (M + 17,) -> (18, M).
    around = np.lib.stride_tricks.sliding_window_view(pad_knots(breaks)[1:-1], 2 * FIT_DEGREE).T
    out = np.empty((len(breaks) - 1, BASIS_WIDTH, BASIS_WIDTH))
    for start in range(0, len(out), INTERVALS_AT_ONCE):
        some = slice(start, start + INTERVALS_AT_ONCE)
        left, right = np.ascontiguousarray(around[FIT_DEGREE - 1 : FIT_DEGREE + 1, some])
        # The nodes in time, (10, intervals), and the values of the B-splines there, (10 B-splines, 10 nodes,
        # intervals).
        points = left + (right - left) * (np.cos(angles)[:, None] + 1) / 2
        out[some] = np.tensordot(interpolation, _evaluate_basis(points, around[:, some]), (1, 1)).T.mT
    return out


def evaluate_chebyshev(x: np.ndarray, count: int) -> np.ndarray:
    """Return Chebyshev polynomials T_0, T_1, ... at x (P,), (count, P)."""
    T, twice = np.empty((count, len(x))), 2 * x
    T[0], T[1] = 1, x
    # T_k = 2 x T_k-1 - T_k-2, in place.
    for k in range(2, count):
        np.multiply(twice, T[k - 1], out=T[k])
        T[k] -= T[k - 2]
    return T


# Many samples, compressed to ten rows per cell.
def compress_cells(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, starts: np.ndarray, edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return times, right sides and weights of ten rows per cell.

    The squares (n,) that no polynomial in a cell reaches come last. Cells (C,) have alike many samples, or one
    less; `starts` (C + 1,) are their first samples, `edges` their ends.
    """
    size, cells = int(np.diff(starts).max()), len(starts) - 1
    # As many cells at a time as stay in a processor's cache.
    some = max(1, POINTS_AT_ONCE // size)
    parts = [
        _reduce_cells(t, y, weight, starts[k : k + some + 1], edges[k : k + some + 1], size)
        for k in range(0, cells, some)
    ]
    # Rows of all parts follow each other; the squares that are left add up.
    times, right, weights = (np.concatenate(column) for column in list(zip(*parts, strict=True))[:3])
    return times, right, weights, np.sum([part[3] for part in parts], axis=0)


def _reduce_cells(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, starts: np.ndarray, edges: np.ndarray, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return times, right sides and weights of the rows of some cells.

    Each cell has ten rows. The squares (n,) that they leave of the samples come last.
    """
    # Samples by cell, (C, S). A cell of one sample less has the first one of the next cell with the weight 0.
    numbers = starts[:-1, None] + np.arange(size)
    squares = np.where(numbers < starts[1:, None], weight[numbers.clip(max=len(t) - 1)], 0) ** 2
    numbers = numbers.clip(max=len(t) - 1)
    # Times x from -1 to 1 over each cell, (C, S), and samples (C, S, n).
    x, cell_samples = (t[numbers] - edges[:-1, None]) / np.diff(edges)[:, None] * 2 - 1, y[numbers]
    # The best polynomial of degree 9 in each cell: its coefficients (C, 10, n) are products with orthonormal ones,
    # summed over the samples.
    polynomials, nodes, vectors = _gauss_nodes(x, squares)
    right = (polynomials * squares[:, None]) @ cell_samples
    # What no polynomial of degree 9 reaches is lost to any spline, and adds to the energy of every fit alike.
    lost = cell_samples - polynomials.mT @ right
    # Values of the polynomial at the nodes of Gauss' quadrature, times the square roots of its weights: these are
    # sqrt(sum of squares) times the first entries of the eigenvectors (Golub & Welsch).
    total = np.sqrt(squares.sum(axis=1))[:, None]
    times = edges[:-1, None] + np.diff(edges)[:, None] * (nodes + 1) / 2
    values, weights = (vectors.mT @ right).reshape(times.size, -1), (total * vectors[:, 0]).ravel()
    return times.ravel(), values, weights, np.einsum("cs,csj->j", squares, lost**2)


def _gauss_nodes(x: np.ndarray, squares: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return orthonormal polynomials over points, and Gauss' nodes.

    Polynomials (C, 10, S) are orthonormal over points x (C, S) of squared weights (C, S). The nodes (C, 10) are
    the zeros of the eleventh polynomial. Eigenvectors (C, 10, 10) of the Jacobi matrices come last, whose j-th
    columns are sqrt(weight_j) p_k(zero_j). Stieltjes' procedure: each polynomial is x times the one before, made
    orthogonal to all of them.
    """
    polynomials = np.empty((len(x), BASIS_WIDTH, x.shape[1]))
    jacobi = np.zeros((len(x), BASIS_WIDTH, BASIS_WIDTH))
    p, shares = np.ones(x.shape), np.zeros((len(x), 0, 1))
    for k in range(BASIS_WIDTH):
        p = p - (shares.mT @ polynomials[:, :k])[:, 0]
        polynomials[:, k] = p = p / np.sqrt((squares * p**2).sum(axis=1))[:, None]
        p = x * p
        # Shares of x p_k in p_0 to p_k, (C, k + 1, 1): only the last two differ from 0, but for rounding. They are
        # the entries of the tridiagonal Jacobi matrix.
        shares = polynomials[:, : k + 1] @ (squares * p)[:, :, None]
        jacobi[:, k, k] = shares[:, k, 0]
        if k > 0:
            jacobi[:, k, k - 1] = jacobi[:, k - 1, k] = shares[:, k - 1, 0]
    nodes, vectors = np.linalg.eigh(jacobi)
    # Signs make the first entries, the roots of weights, positive.
    return polynomials, nodes, vectors * np.sign(vectors[:, :1])
