"""Least-squares splines of degree 9 over any knots, and their covariance.

Problem: the coefficients c that minimise ``|B c - y|^2``, where rows of B and y are those of samples times weights.
B-splines of degree 9 overlap by ten, so the normal equations ``B^T B c = B^T y`` of any number of samples are banded
(de Boor, A Practical Guide to Splines, XIV). They are accumulated interval by interval, solved by Cholesky's method and
refined once where samples fit so well that the rounding of normal equations shows.

Many fits of a long log share one compression: the samples of a cell become ten rows. These have the same normal
equations as long as knots lie at the edges of cells, to which `Rows.snap` moves them.

Cholesky's method raises `LinAlgError` where the samples leave a coefficient undetermined: callers drop breaks first
(`jounce.motion.knots.drop_sparse_breaks`), or give up this number of intervals.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

FIT_DEGREE = 9  # q4d has five continuous derivatives more, and Q2d no kinks
BASIS_WIDTH = FIT_DEGREE + 1  # B-splines that overlap in an interval
MIN_REFINED_SHARE = 1e-6  # of the samples: in smaller residuals the rounding of normal equations shows
SAMPLES_AT_ONCE = 2**13  # whose polynomials stay in a processor's cache
MIN_CELLS = 8192  # that a long log is compressed to, ten rows each; more where it needs more intervals


@dataclass(frozen=True, eq=False)
class SplineRows:
    """Rows of a least-squares problem in time: the spline's values at `t`, times weights, are to equal `y`."""

    t: np.ndarray  # (P,), increasing; ten in each cell if compressed
    y: np.ndarray  # (P, n), right sides times the weights
    weight: np.ndarray  # (P,), inverse standard deviations up to a factor
    edges: np.ndarray | None  # (C + 1,) of cells if compressed: where knots may be
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


def make_rows(t: np.ndarray, y: np.ndarray, weight: np.ndarray, span: tuple[float, float]) -> SplineRows:
    """The rows of samples y, (N, n), at times t in a span."""
    return SplineRows(t, y * weight[:, None], weight, None, span, float((weight**2).sum()), np.zeros(y.shape[1]))


def compress_rows(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, span: tuple[float, float], cells: int
) -> SplineRows:
    """The rows of samples, compressed to cells where that leaves half of them or less."""
    size = len(t) // cells
    return make_rows(t, y, weight, span) if size < 2 * BASIS_WIDTH else _compress_cells(t, y, weight, span, size)


def _compress_cells(
    t: np.ndarray, y: np.ndarray, weight: np.ndarray, span: tuple[float, float], size: int
) -> SplineRows:
    """Ten rows for each of cells of `size` samples or one less: the nodes and weights of their Gauss quadrature.

    Sums over the samples of polynomials up to degree 19 are the same over these rows (Golub & Welsch, Mathematics of
    Computation 23, 1969), hence normal equations too; the right sides are those of the polynomial that fits best.
    """
    cells = -(-len(t) // size)
    starts = np.arange(cells + 1) * len(t) // cells
    edges = np.concatenate([span[:1], (t[starts[1:-1]] + t[starts[1:-1] - 1]) / 2, span[1:]])
    some = max(1, SAMPLES_AT_ONCE // size)
    parts = [
        _reduce_cells(t, y, weight, starts[k : k + some + 1], edges[k : k + some + 1], size)
        for k in range(0, cells, some)
    ]
    times, right, weights = (np.concatenate(column) for column in list(zip(*parts, strict=True))[:3])
    lost = np.sum([part[3] for part in parts], axis=0)
    return SplineRows(times, right, weights, edges, span, float((weight**2).sum()), lost)


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


def pad_knots(breaks: np.ndarray) -> np.ndarray:
    """The knots of a spline with these breaks: ten at either end."""
    return np.pad(breaks, FIT_DEGREE, mode="edge")


def basis(t: np.ndarray, breaks: np.ndarray, order: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """B-splines, or a derivative of them, (P, 10): those that differ from 0 at t, and the intervals (P,) of t.

    A derivative's coefficients are divided differences, d (c_j - c_j-1) / (knot_j+d - knot_j) with the degree d.
    """
    place = np.searchsorted(breaks, t, side="right").clip(1, len(breaks) - 1) - 1
    all_knots = pad_knots(breaks)
    values = _evaluate_basis(t, place, all_knots[order : len(all_knots) - order], FIT_DEGREE - order)
    for degree in range(FIT_DEGREE - order + 1, BASIS_WIDTH):
        j = place[:, None] + np.arange(BASIS_WIDTH - degree, BASIS_WIDTH)
        scaled = values * degree / (all_knots[j + degree] - all_knots[j])
        values = np.pad(scaled, ((0, 0), (1, 0))) - np.pad(scaled, ((0, 0), (0, 1)))
    return values, place


def _evaluate_basis(t: np.ndarray, place: np.ndarray, knots: np.ndarray, degree: int) -> np.ndarray:
    """B-splines (P, degree + 1) that differ from 0 at t, in intervals `place`, by the recursion of Cox and de Boor."""
    values = np.empty((len(t), degree + 1))
    for start in range(0, len(t), SAMPLES_AT_ONCE):
        some = slice(start, start + SAMPLES_AT_ONCE)
        around = knots[place[some] + np.arange(1, 2 * degree + 1)[:, None]]
        ahead, lower = around - t[some], np.ones((1, around.shape[1]))
        for k in range(1, degree + 1):
            share = lower / (around[degree : degree + k] - around[degree - k : degree])
            lower = np.zeros((k + 1, around.shape[1]))
            lower[1:] -= ahead[degree - k : degree] * share
            lower[:-1] += ahead[degree : degree + k] * share
        values[some] = lower.T
    return values


def solve(rows: SplineRows, breaks: np.ndarray) -> SplineSolution:
    """The least-squares spline with these breaks; raises `LinAlgError` where the samples leave it undetermined."""
    from scipy.linalg import cho_solve_banded, cholesky_banded
    from scipy.sparse import csr_array

    # B, and the Cholesky factor of B^T B
    values, place = basis(rows.t, breaks)
    values *= rows.weight[:, None]
    factor = cholesky_banded(_normal_bands(values, place, len(breaks) - 1), lower=True, check_finite=False)
    columns = place[:, None] + np.arange(BASIS_WIDTH)
    ends = np.arange(0, values.size + 1, BASIS_WIDTH)
    B = csr_array((values.ravel(), columns.ravel(), ends), shape=(len(values), factor.shape[1]))
    coefficients = np.zeros((factor.shape[1], rows.y.shape[1]))
    residual = rows.y
    while True:  # c += (B^T B)^-1 B^T (y - B c), once, or twice where the first residual is as small as its rounding
        coefficients += cho_solve_banded((factor, True), B.T @ residual, check_finite=False)
        before, residual = residual, rows.y - B @ coefficients
        if before is not rows.y or ((residual**2).sum(axis=0) > MIN_REFINED_SHARE**2 * (rows.y**2).sum(axis=0)).all():
            break
    residual = rows.across(residual)
    return SplineSolution(breaks, coefficients, residual, factor, (residual**2).sum(axis=0) + rows.rest)


def _normal_bands(values: np.ndarray, place: np.ndarray, intervals: int) -> np.ndarray:
    """B^T B in lower bands, (10, m): sums over the rows of each interval."""
    starts = np.searchsorted(place, np.arange(intervals))
    filled = np.flatnonzero(np.diff(starts, append=len(place)))
    columns, starts = np.ascontiguousarray(values.T), starts[filled]
    banded = np.zeros((BASIS_WIDTH, intervals + FIT_DEGREE))
    for a in range(BASIS_WIDTH):
        for b in range(a, BASIS_WIDTH):
            banded[b - a, a + filled] += np.add.reduceat(columns[a] * columns[b], starts)
    return banded


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
