"""Least-squares splines of degree 9 over any knots, and their covariance.

Problem: the coefficients c that minimise ``|B c - y|^2``, where rows of B and y are those of samples times weights.
B-splines of degree 9 overlap by ten, so the normal equations ``B^T B c = B^T y`` of any number of samples are banded
(de Boor, A Practical Guide to Splines, XIV). In each interval they follow from sums of Chebyshev polynomials over the
samples, since a product of two of them is the mean of two others. They are solved by Cholesky's method, and refined
once where samples fit so well that the rounding of normal equations shows.

Many fits of a long log share one compression: the samples of a cell become ten rows. These have the same normal
equations as long as knots lie at the edges of cells, to which `Rows.snap` moves them.

Cholesky's method raises `LinAlgError` where the samples leave a coefficient undetermined: callers drop breaks first
(`jounce.motion.knots.drop_sparse_breaks`), or give up this number of intervals.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jounce.motion.bsplines import (
    BASIS_WIDTH,
    FIT_DEGREE,
    INTERVALS_AT_ONCE,
    POINTS_AT_ONCE,
    basis,
    chebyshev_coefficients,
    evaluate_chebyshev,
    pad_knots,
)
from jounce.motion.compression import compress_cells

if TYPE_CHECKING:
    from scipy.interpolate import BSpline
    from scipy.sparse import csr_array

MIN_REFINED_SHARE = 1e-6  # of the samples: in smaller residuals the rounding of normal equations shows
MIN_CELLS = 8192  # that a long log is compressed to, ten rows each; more where it needs more intervals


@dataclass(frozen=True, eq=False)
class SplineRows:
    """Rows of a least-squares problem in time: the spline's values at `t`, times weights, are to equal `y`."""

    t: np.ndarray  # (P,), increasing; ten in each cell if in_cells
    y: np.ndarray  # (P, n), right sides times the weights
    weight: np.ndarray  # (P,), inverse standard deviations up to a factor
    edges: np.ndarray | None  # (C + 1,) of cells if in_cells: where knots may be
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


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """B^T B of rows and of the splines with some breaks, for any right sides; B = T E.

    T are weighted values at each row of ten functions per interval: Chebyshev polynomials if the rows have cells, where
    2 T_i T_j = T_(i + j) + T_|i - j| saves most products; otherwise B-splines: where an interval has few samples, these
    may be so small there that only sums of their own products are exact enough.
    """

    T: "csr_array"  # (P, 10 M)
    E: np.ndarray  # (M, 10, 10), or the unit matrix (10, 10)
    factor: np.ndarray  # (10, m), Cholesky factor of B^T B in lower bands

    def fit(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The coefficients c, (m, n), of the least |B c - y|, and y - B c, (P, n), of right sides y."""
        from scipy.linalg import cho_solve_banded

        intervals = self.factor.shape[1] - FIT_DEGREE
        coefficients, residual = np.zeros((self.factor.shape[1], y.shape[1])), y
        while (
            True
        ):  # c += (B^T B)^-1 B^T (y - B c), once, or twice where the first residual is as small as its rounding
            right = np.zeros(coefficients.shape)
            shares = self.E.mT @ (self.T.T @ residual).reshape(intervals, BASIS_WIDTH, -1)
            for a in range(BASIS_WIDTH):
                right[a : a + intervals] += shares[:, a]
            coefficients += cho_solve_banded((self.factor, True), right, check_finite=False)
            own = np.lib.stride_tricks.sliding_window_view(coefficients, BASIS_WIDTH, axis=0)
            before, residual = residual, self.T @ (self.E @ own.mT).reshape(intervals * BASIS_WIDTH, -1)
            np.subtract(y, residual, out=residual)
            if before is not y or (_squares(residual) > MIN_REFINED_SHARE**2 * _squares(y)).all():
                return coefficients, residual


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
    *rows, lost = compress_cells(t, y, weight, starts, edges)
    return SplineRows(*rows, edges, span, float((weight**2).sum()), lost)


def solve(rows: SplineRows, breaks: np.ndarray) -> SplineSolution:
    """The least-squares spline with these breaks; raises `LinAlgError` where the samples leave it undetermined."""
    equations = factorize(rows, breaks)
    coefficients, residual = equations.fit(rows.y)
    residual = rows.across(residual)
    return SplineSolution(breaks, coefficients, residual, equations.factor, _squares(residual) + rows.rest)


def _squares(columns: np.ndarray) -> np.ndarray:
    return np.einsum("pj,pj->j", columns, columns)


def factorize(rows: SplineRows, breaks: np.ndarray) -> NormalEquations:
    """The normal equations of splines with these breaks; raises `LinAlgError` where they are singular."""
    from scipy.linalg import cholesky_banded
    from scipy.sparse import csr_array

    intervals, in_cells, k = len(breaks) - 1, rows.edges is not None, np.arange(BASIS_WIDTH)
    bounds = np.concatenate([[0], np.searchsorted(rows.t, breaks[1:-1]), [len(rows.t)]])
    index = np.int32 if BASIS_WIDTH * len(rows.t) <= np.iinfo(np.int32).max else np.int64
    place, scale = np.repeat(np.arange(intervals, dtype=index), np.diff(bounds)), 2 / np.diff(breaks)
    E = chebyshev_coefficients(breaks) if in_cells else np.eye(BASIS_WIDTH)
    values = np.empty((len(place), BASIS_WIDTH)) if in_cells else basis(rows.t, breaks)[0] * rows.weight[:, None]
    banded = np.zeros((BASIS_WIDTH, intervals + FIT_DEGREE))
    step = 1 + min(INTERVALS_AT_ONCE, POINTS_AT_ONCE * intervals // len(place))
    for start in range(0, intervals, step):
        some, at = slice(start, start + step), bounds[start : start + step + 1]
        here, filled = slice(at[0], at[-1]), np.flatnonzero(np.diff(at))
        firsts = at[filled] - at[0]
        if in_cells:
            local = evaluate_chebyshev(
                (rows.t[here] - breaks[place[here]]) * scale[place[here]] - 1, 2 * FIT_DEGREE + 1
            )
            local *= rows.weight[here]
            values[here] = local[:BASIS_WIDTH].T
            local *= rows.weight[here]
            moments = np.zeros((len(at) - 1, len(local)))
            moments[filled] = np.add.reduceat(local, firsts, axis=1).T
            gram = (moments[:, k[:, None] + k] + moments[:, np.abs(k[:, None] - k)]) / 2
            gram = E[some].mT @ gram @ E[some]
        else:
            gram = np.zeros((len(at) - 1, BASIS_WIDTH, BASIS_WIDTH))
            gram[filled] = np.add.reduceat(values[here, :, None] * values[here, None], firsts)
        for a in range(BASIS_WIDTH):
            banded[: BASIS_WIDTH - a, start + a : start + a + len(gram)] += gram[:, a, a:].T
    columns = place[:, None] * BASIS_WIDTH + k.astype(index)
    ends = np.arange(0, values.size + 1, BASIS_WIDTH, dtype=index)
    T = csr_array((values.ravel(), columns.ravel(), ends), shape=(len(place), intervals * BASIS_WIDTH))
    return NormalEquations(T, E, cholesky_banded(banded, lower=True, check_finite=False))


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
