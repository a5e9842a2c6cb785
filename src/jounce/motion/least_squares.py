"""Least-squares splines of degree 9 over any knots, and their covariance.

Problem: the coefficients c that minimise ``|B c - y|^2``, where rows of B and y are those of samples times weights.
B-splines of degree 9 overlap by ten, so the normal equations ``B^T B c = B^T y`` of any number of samples are banded
(de Boor, A Practical Guide to Splines, XIV). In each interval they follow from sums of Chebyshev polynomials over the
samples, since a product of two of them is the mean of two others. They are solved by Cholesky's method, and refined
once where samples fit so well that the rounding of normal equations shows.

Many fits of a long log share one compression: the samples of a cell become ten rows. These have the same normal
equations as long as knots lie at the edges of cells, to which `SplineRows.snap` moves them.

Cholesky's method raises `LinAlgError` where the samples leave a coefficient undetermined:
`jounce.motion.knots.fit_breaks` drops breaks until they do not.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from jounce.motion.bsplines import BASIS_WIDTH, FIT_DEGREE, pad_knots
from jounce.motion.compression import compress_cells
from jounce.motion.normal_equations import SplineEquations, factorize, sum_squares

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

MIN_CELLS = 8192  # that a long log is compressed to, ten rows each; more where it needs more intervals


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
