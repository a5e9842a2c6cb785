"""Fit least-squares splines of degree 9 over any knots, with their covariance.

Problem: the coefficients c that minimise ``|B c - y|^2``, where rows of B and y are those of samples times weights.

Algorithm: B-splines of degree 9 overlap by ten, so the normal equations ``B^T B c = B^T y`` of any number of samples
are banded (de Boor, A Practical Guide to Splines, XIV). In each interval they follow from sums of Chebyshev polynomials
over the samples, since a product of two of them is the mean of two others. They are solved by Cholesky's method, and
refined once where samples fit so well that the rounding of normal equations shows.

`Samples` are those of the joints that move, as all steps of a smoothing pass them on; `Samples.rows` makes the rows of
a problem. Many fits of a long log share one compression (`compress_cells`): the samples of a cell become ten rows, the
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


MAX_SCATTER_ROWS = 20000  # from which the scatter of stamps is estimated: more only take time
MIN_FIT_SAMPLES = 24  # more than twice the ten coefficients of one interval, so that noise can be estimated
MIN_CELLS = 8192  # that a long log is compressed to, ten rows each; more where it needs more intervals
MIN_COVERED_SHARE = 0.8  # of each interval by its rows: beside a hole the products of Chebyshev polynomials are alike
MIN_REFINED_SHARE = 1e-6  # of the samples: in smaller residuals the rounding of normal equations shows
FIT_DEGREE = 9  # q4d has five continuous derivatives more, and Q2d no kinks
BASIS_WIDTH = FIT_DEGREE + 1  # B-splines that overlap in an interval
POINTS_AT_ONCE = 2**13  # at which values are computed: they stay in a processor's cache,
INTERVALS_AT_ONCE = 2**9  # as those at ten points in each of these do


@dataclass(frozen=True, eq=False)
class SplineRows:
    """Rows of a least-squares problem in time: the spline's values at `t`, times weights, are to equal `y`."""

    t: np.ndarray  # (P,), increasing; ten in each cell if compressed
    y: np.ndarray  # (P, n), right sides times the weights
    weight: np.ndarray  # (P,), inverse standard deviations up to a factor
    edges: np.ndarray | None  # (C + 1,) of cells of ten rows or more, where alone knots may be
    span: tuple[float, float]  # the first and the last time of the samples
    count: float  # of samples, each by its weight squared
    rest: np.ndarray  # (n,), squares that no polynomial in a cell reaches, left out of the rows
    # where stamps are in doubt, velocities v (P, n) and variances D (n,): what shifts of rows explain is no residual
    along: tuple[np.ndarray, np.ndarray] | None = None

    def across(self, residual: np.ndarray) -> np.ndarray:
        """What is left of residuals (P, n) but for a shift in time of each row: r - v (v^T D^-1 r) / (v^T D^-1 v)."""
        if self.along is None:
            return residual
        v, own = self.along
        squares = np.maximum((v**2 / own).sum(axis=1), np.finfo(float).tiny)
        return residual - v * ((v * residual / own).sum(axis=1) / squares)[:, None]

    def snap(self, breaks: np.ndarray) -> np.ndarray:
        """Breaks of a spline, moved to where they may be."""
        if self.edges is None:
            return breaks
        at = np.searchsorted(self.edges, breaks).clip(1, len(self.edges) - 1)
        left = breaks - self.edges[at - 1] < self.edges[at] - breaks
        snapped = np.unique(self.edges[at - left])
        snapped[0], snapped[-1] = self.span
        return snapped


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of the joints that move, as they are smoothed."""

    t: np.ndarray  # (N,), increasing
    q: np.ndarray  # (N, n)
    weight: np.ndarray  # (N,), of the rows
    span: tuple[float, float]  # the first and the last time of the spline
    steps: np.ndarray  # (n,), of encoders or of written digits, otherwise 0
    # where stamps are in doubt: a spline to take velocities from, and each joint's own variance (n,)
    drift: "tuple[BSpline, np.ndarray] | None" = None
    unsure: np.ndarray | None = None  # (n,), by how much each sensor may be read earlier than the times say, s

    @cached_property
    def floor(self) -> np.ndarray:
        """The variance (n,) of rounding of doubles."""
        return np.maximum((4 * np.finfo(float).eps * np.abs(self.q).max(axis=0)) ** 2, np.finfo(float).tiny)

    def joints(self, which: np.ndarray) -> "Samples":
        """The samples of some of the joints."""
        unsure = None if self.unsure is None else self.unsure[which]
        return replace(self, q=self.q[:, which], steps=self.steps[which], unsure=unsure)

    def part(self, rows: np.ndarray) -> "Samples":
        """Some of the rows."""
        return replace(self, t=self.t[rows], q=self.q[rows], weight=self.weight[rows])

    def rows(self, cells: int) -> SplineRows:
        """The rows of a least-squares problem, compressed to a number of cells if there are many samples."""
        rows = compress_rows(self.t, self.q, self.weight, self.span, cells)
        if self.drift is None:
            return rows
        spline, own = self.drift
        return replace(rows, along=(spline(rows.t, nu=1), own))

    def all_rows(self, cells: int) -> SplineRows:
        """The rows of all samples for splines with knots as in compressed ones: faster for few fits."""
        _, edges = cut_cells(self.t, self.span, cells)
        return make_rows(self.t, self.q, self.weight, self.span, edges)


@dataclass(frozen=True, eq=False)
class SplineSolution:
    """A least-squares spline: its breaks (M + 1,), coefficients (M + 9, n), residual rows (P, n), Cholesky factor,
    and the sums of squares (n,) of what it leaves of the samples.
    """

    breaks: np.ndarray
    coefficients: np.ndarray
    residual: np.ndarray
    factor: np.ndarray
    energy: np.ndarray

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
    """The rows of samples y, (N, n), at times t in a span."""
    return SplineRows(t, y * weight[:, None], weight, edges, span, float((weight**2).sum()), np.zeros(y.shape[1]))


def cut_cells(t: np.ndarray, span: tuple[float, float], cells: int) -> tuple[np.ndarray, np.ndarray | None]:
    """The first samples and the ends, (C + 1,), of about that many cells; no ends where these hold too few samples."""
    size = len(t) // cells
    if size < 2 * BASIS_WIDTH:
        return np.array([0, len(t)]), None
    cells = -(-len(t) // size)
    starts = np.arange(cells + 1) * len(t) // cells
    return starts, np.concatenate([span[:1], (t[starts[1:-1]] + t[starts[1:-1] - 1]) / 2, span[1:]])


def compress_rows(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, span: tuple[float, float], cells: int
) -> SplineRows:
    """The rows of samples, compressed to cells where that leaves half of them or less."""
    starts, edges = cut_cells(t, span, cells)
    if edges is None:
        return make_rows(t, y, weight, span)
    times, right, weights, lost = compress_cells(t, y, weight, starts, edges)
    return SplineRows(times, right, weights, edges, span, float((weight**2).sum()), lost)


def solve(rows: SplineRows, breaks: np.ndarray) -> SplineSolution:
    """The least-squares spline with these breaks; raises `LinAlgError` where the samples leave it undetermined."""
    return solve_equations(rows, breaks, make_equations(rows, breaks))


@dataclass(frozen=True, eq=False)
class SplineEquations:
    """B^T B of rows and of the splines with some breaks, for any right sides; B = T E.

    T are weighted values at each row of ten functions per interval: Chebyshev polynomials, where the rows determine
    these, since 2 T_i T_j = T_(i + j) + T_|i - j| saves most products; otherwise B-splines, which may be so small at
    the few rows of an interval that only sums of their own products are exact enough.
    """

    T: "np.ndarray | csr_array"  # (P / 10, 10, 10) if each ten rows are in one interval, otherwise (P, 10 M)
    E: np.ndarray  # (M, 10, 10), or the unit matrix (10, 10)
    sums: "csr_array | None"  # (M, P / 10), over the tens of rows in each interval
    factor: np.ndarray  # (10, m), Cholesky factor of B^T B in lower bands

    def fit(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The coefficients c, (m, n), of the least |B c - y|, and y - B c, (P, n), of right sides y."""
        from scipy.linalg import cho_solve_banded

        intervals = self.factor.shape[1] - FIT_DEGREE
        coefficients, residual = np.zeros((self.factor.shape[1], y.shape[1])), y
        while True:  # c += (B^T B)^-1 B^T (y - B c); twice where the first residual is as small as its rounding
            right = np.zeros(coefficients.shape)
            shares = self.E.mT @ self._sum_by_interval(residual)
            for a in range(BASIS_WIDTH):
                right[a : a + intervals] += shares[:, a]
            coefficients += cho_solve_banded((self.factor, True), right, check_finite=False)
            own = np.lib.stride_tricks.sliding_window_view(coefficients, BASIS_WIDTH, axis=0)
            before, residual = residual, self._evaluate(self.E @ own.mT)
            np.subtract(y, residual, out=residual)
            if before is not y or (sum_squares(residual) > MIN_REFINED_SHARE**2 * sum_squares(y)).all():
                return coefficients, residual

    def _sum_by_interval(self, y: np.ndarray) -> np.ndarray:
        """T^T y of rows (P, n), (M, 10, n)."""
        if not isinstance(self.T, np.ndarray):
            return np.asarray(self.T.T @ y).reshape(-1, BASIS_WIDTH, y.shape[1])
        by_ten = self.T.mT @ y.reshape(len(self.T), BASIS_WIDTH, -1)
        return np.asarray(self.sums @ by_ten.reshape(len(by_ten), -1)).reshape(-1, *by_ten.shape[1:])

    def _evaluate(self, local: np.ndarray) -> np.ndarray:
        """T times coefficients (M, 10, n) by interval, (P, n)."""
        if isinstance(self.T, np.ndarray) and self.sums is not None:
            local = self.T @ np.repeat(local, np.diff(self.sums.indptr), axis=0)
            return local.reshape(-1, local.shape[2])
        return np.asarray(self.T @ local.reshape(-1, local.shape[2]))


def make_equations(rows: SplineRows, breaks: np.ndarray) -> SplineEquations:
    """The normal equations of splines with these breaks; raises `LinAlgError` as `solve` does."""
    return factorize(rows.t, rows.weight, breaks, in_cells=rows.edges is not None)


def solve_equations(rows: SplineRows, breaks: np.ndarray, equations: SplineEquations) -> SplineSolution:
    """The least-squares spline with these breaks, from its equations."""
    coefficients, residual = equations.fit(rows.y)
    residual = rows.across(residual)
    return SplineSolution(breaks, coefficients, residual, equations.factor, sum_squares(residual) + rows.rest)


def covariance_blocks(factor: np.ndarray) -> np.ndarray:
    """(B^T B)^-1 among the ten coefficients of each interval, (M, 10, 10), from the banded Cholesky factor.

    Only the band of the inverse is needed, and it follows from itself, last column first: Hutchinson & de Hoog,
    Smoothing noisy data with spline functions, Numerische Mathematik 47 (1985).
    """
    # L of B^T B = L L^T gives the inverse Z by Z L = L^-T: column i from the nine rows and columns behind it
    unknowns = factor.shape[1]
    blocks = np.empty((unknowns - FIT_DEGREE, BASIS_WIDTH, BASIS_WIDTH))
    window = np.zeros((BASIS_WIDTH, BASIS_WIDTH))  # of the inverse, from the present column on
    for i in range(unknowns - 1, -1, -1):
        pivot = factor[0, i]
        lower = factor[1:, i] / pivot
        beside = window[:FIT_DEGREE, :FIT_DEGREE]
        column = -beside @ lower
        first = 1 / pivot**2 - lower @ column
        window = np.empty((BASIS_WIDTH, BASIS_WIDTH))
        window[0, 0], window[0, 1:], window[1:, 0], window[1:, 1:] = first, column, column, beside
        if i < len(blocks):
            blocks[i] = window
    return blocks


# The normal equations of rows and breaks.
def sum_squares(columns: np.ndarray) -> np.ndarray:
    """The sums (n,) of squares of columns (P, n)."""
    return np.asarray(np.einsum("pj,pj->j", columns, columns))


def factorize(t: np.ndarray, weight: np.ndarray, breaks: np.ndarray, in_cells: bool) -> SplineEquations:
    """The equations of rows at t, (P,), of weights (P,), and of splines with these breaks.

    Rows `in_cells` are ten or more in each interval. Raises `LinAlgError` where the equations are singular.
    """
    from scipy.linalg import cholesky_banded
    from scipy.sparse import csr_array

    intervals, k = len(breaks) - 1, np.arange(BASIS_WIDTH)
    bounds = np.concatenate([[0], np.searchsorted(t, breaks[1:-1]), [len(t)]])
    by_chebyshev = in_cells and bool((t[bounds[1:] - 1] - t[bounds[:-1]] > MIN_COVERED_SHARE * np.diff(breaks)).all())
    index = np.int32 if BASIS_WIDTH * len(t) <= np.iinfo(np.int32).max else np.int64
    place, scale = np.repeat(np.arange(intervals, dtype=index), np.diff(bounds)), 2 / np.diff(breaks)
    E = chebyshev_coefficients(breaks) if by_chebyshev else np.eye(BASIS_WIDTH)
    values = np.empty((len(place), BASIS_WIDTH)) if by_chebyshev else basis(t, breaks)[0] * weight[:, None]
    banded = np.zeros((BASIS_WIDTH, intervals + FIT_DEGREE))
    step = 1 + min(INTERVALS_AT_ONCE, POINTS_AT_ONCE * intervals // len(place))
    for start in range(0, intervals, step):
        some, at = slice(start, start + step), bounds[start : start + step + 1]
        here, filled = slice(at[0], at[-1]), np.flatnonzero(np.diff(at))
        firsts = at[filled] - at[0]
        if by_chebyshev:
            local = evaluate_chebyshev((t[here] - breaks[place[here]]) * scale[place[here]] - 1, 2 * FIT_DEGREE + 1)
            local *= weight[here]
            values[here] = local[:BASIS_WIDTH].T
            local *= weight[here]
            moments = np.zeros((len(at) - 1, len(local)))
            moments[filled] = np.add.reduceat(local, firsts, axis=1).T
            gram = (moments[:, k[:, None] + k] + moments[:, np.abs(k[:, None] - k)]) / 2
            gram = E[some].mT @ gram @ E[some]
        else:
            gram = np.zeros((len(at) - 1, BASIS_WIDTH, BASIS_WIDTH))
            gram[filled] = np.add.reduceat(values[here, :, None] * values[here, None], firsts)
        for a in range(BASIS_WIDTH):
            banded[: BASIS_WIDTH - a, start + a : start + a + len(gram)] += gram[:, a, a:].T
    factor = cholesky_banded(banded, lower=True, check_finite=False)
    if not (bounds % BASIS_WIDTH).any():  # ten rows are in one interval, as compressed ones
        cells = np.arange(len(t) // BASIS_WIDTH)
        sums = csr_array((np.ones(len(cells)), cells, bounds // BASIS_WIDTH), shape=(intervals, len(cells)))
        return SplineEquations(values.reshape(-1, BASIS_WIDTH, BASIS_WIDTH), E, sums, factor)
    columns = place[:, None] * BASIS_WIDTH + k.astype(index)
    ends = np.arange(0, values.size + 1, BASIS_WIDTH, dtype=index)
    T = csr_array((values.ravel(), columns.ravel(), ends), shape=(len(place), intervals * BASIS_WIDTH))
    return SplineEquations(T, E, None, factor)


# B-splines, and their pieces as sums of Chebyshev polynomials.
def pad_knots(breaks: np.ndarray) -> np.ndarray:
    """The knots of a spline with these breaks: ten at either end."""
    return np.pad(breaks, FIT_DEGREE, mode="edge")


def basis(t: np.ndarray, breaks: np.ndarray, order: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """B-splines, or a derivative of them, (P, 10): those that differ from 0 at t, and the intervals (P,) of t.

    A derivative's coefficients are divided differences, d (c_j - c_j-1) / (knot_j+d - knot_j) with the degree d.
    """
    place = np.searchsorted(breaks, t, side="right").clip(1, len(breaks) - 1) - 1
    all_knots, degree = pad_knots(breaks), FIT_DEGREE - order
    knots, values = all_knots[order : len(all_knots) - order], np.empty((len(t), degree + 1))
    for start in range(0, len(t), POINTS_AT_ONCE):
        some = slice(start, start + POINTS_AT_ONCE)
        around = knots[place[some] + np.arange(1, 2 * degree + 1)[:, None]]
        values[some] = _evaluate_basis(t[None, some], around)[:, 0].T
    for degree in range(FIT_DEGREE - order + 1, BASIS_WIDTH):
        j = place[:, None] + np.arange(BASIS_WIDTH - degree, BASIS_WIDTH)
        scaled = values * degree / (all_knots[j + degree] - all_knots[j])
        values = np.pad(scaled, ((0, 0), (1, 0))) - np.pad(scaled, ((0, 0), (0, 1)))
    return values, place


def _evaluate_basis(t: np.ndarray, around: np.ndarray) -> np.ndarray:
    """The d + 1 B-splines that differ from 0 at t (K, M), (d + 1, K, M), by the recursion of Cox and de Boor.

    The knots `around` (2 d, M) are the last d before the times, and the first d behind them.
    """
    degree = len(around) // 2
    ahead, lower = around[:, None] - t, np.ones((1, *t.shape))
    for k in range(1, degree + 1):
        share = lower * (1 / (around[degree : degree + k] - around[degree - k : degree]))[:, None]
        lower = np.zeros((k + 1, *t.shape))
        lower[1:] -= ahead[degree - k : degree] * share
        lower[:-1] += ahead[degree : degree + k] * share
    return lower


def chebyshev_coefficients(breaks: np.ndarray) -> np.ndarray:
    """The B-splines of each interval in Chebyshev polynomials T_k over it, (M, 10, 10): k first, B-splines last."""
    angles = np.pi * (np.arange(BASIS_WIDTH) + 0.5) / BASIS_WIDTH
    interpolation = np.cos(np.arange(BASIS_WIDTH)[:, None] * angles) * 2 / BASIS_WIDTH
    interpolation[0] /= 2
    around = np.lib.stride_tricks.sliding_window_view(pad_knots(breaks)[1:-1], 2 * FIT_DEGREE).T
    out = np.empty((len(breaks) - 1, BASIS_WIDTH, BASIS_WIDTH))
    for start in range(0, len(out), INTERVALS_AT_ONCE):
        some = slice(start, start + INTERVALS_AT_ONCE)
        left, right = np.ascontiguousarray(around[FIT_DEGREE - 1 : FIT_DEGREE + 1, some])
        points = left + (right - left) * (np.cos(angles)[:, None] + 1) / 2
        out[some] = np.tensordot(interpolation, _evaluate_basis(points, around[:, some]), (1, 1)).T.mT
    return out


def evaluate_chebyshev(x: np.ndarray, count: int) -> np.ndarray:
    """Chebyshev polynomials T_0, T_1, ... at x (P,), (count, P)."""
    T, twice = np.empty((count, len(x))), 2 * x
    T[0], T[1] = 1, x
    for k in range(2, count):
        np.multiply(twice, T[k - 1], out=T[k])
        T[k] -= T[k - 2]
    return T


# Many samples, compressed to ten rows per cell.
def compress_cells(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, starts: np.ndarray, edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, right sides and weights of ten rows per cell, and the squares (n,) that no polynomial in a cell reaches.

    Cells (C,) have alike many samples, or one less; `starts` (C + 1,) are their first samples, `edges` their ends.
    """
    size, cells = int(np.diff(starts).max()), len(starts) - 1
    some = max(1, POINTS_AT_ONCE // size)
    parts = [
        _reduce_cells(t, y, weight, starts[k : k + some + 1], edges[k : k + some + 1], size)
        for k in range(0, cells, some)
    ]
    times, right, weights = (np.concatenate(column) for column in list(zip(*parts, strict=True))[:3])
    return times, right, weights, np.sum([part[3] for part in parts], axis=0)


def _reduce_cells(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, starts: np.ndarray, edges: np.ndarray, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, right sides and weights of the ten rows of each of some cells, and the squares (n,) that they leave."""
    # samples by cell; a cell of one sample less has the first one of the next with the weight 0
    of_cell = starts[:-1, None] + np.arange(size)
    squares = np.where(of_cell < starts[1:, None], weight[of_cell.clip(max=len(t) - 1)], 0) ** 2
    of_cell = of_cell.clip(max=len(t) - 1)
    x, of_samples = (t[of_cell] - edges[:-1, None]) / np.diff(edges)[:, None] * 2 - 1, y[of_cell]
    # the best polynomial of degree 9 of each cell, and what it leaves
    polynomials, nodes, vectors = _gauss_nodes(x, squares)
    right = (polynomials * squares[:, None]) @ of_samples
    rest = of_samples - polynomials.mT @ right
    # its values at the nodes, whose weights are sqrt(sum of squares) times the first entries of eigenvectors
    total = np.sqrt(squares.sum(axis=1))[:, None]
    times = edges[:-1, None] + np.diff(edges)[:, None] * (nodes + 1) / 2
    values, weights = (vectors.mT @ right).reshape(times.size, -1), (total * vectors[:, 0]).ravel()
    return times.ravel(), values, weights, np.einsum("cs,csj->j", squares, rest**2)


def _gauss_nodes(x: np.ndarray, squares: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Polynomials (C, 10, S) orthonormal over points x (C, S) of squared weights, the zeros (C, 10) of the eleventh,
    and eigenvectors (C, 10, 10) of the Jacobi matrices, whose j-th columns are sqrt(weight_j) p_k(zero_j).

    Stieltjes' procedure: each polynomial is x times the one before, made orthogonal to all of them.
    """
    polynomials = np.empty((len(x), BASIS_WIDTH, x.shape[1]))
    jacobi = np.zeros((len(x), BASIS_WIDTH, BASIS_WIDTH))
    p, shares = np.ones(x.shape), np.zeros((len(x), 0, 1))
    for k in range(BASIS_WIDTH):
        p = p - (shares.mT @ polynomials[:, :k])[:, 0]
        polynomials[:, k] = p = p / np.sqrt((squares * p**2).sum(axis=1))[:, None]
        p = x * p
        shares = polynomials[:, : k + 1] @ (squares * p)[:, :, None]  # the last two would do, but for rounding
        jacobi[:, k, k] = shares[:, k, 0]
        if k:
            jacobi[:, k, k - 1] = jacobi[:, k - 1, k] = shares[:, k - 1, 0]
    nodes, vectors = np.linalg.eigh(jacobi)
    return polynomials, nodes, vectors * np.sign(vectors[:, :1])
