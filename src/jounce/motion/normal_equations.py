"""Normal equations of least-squares splines: banded, accumulated interval by interval, solved by Cholesky's method."""

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
)

if TYPE_CHECKING:
    from scipy.sparse import csr_array

MIN_COVERED_SHARE = 0.8  # of each interval by its rows: beside a hole the products of Chebyshev polynomials are alike
MIN_REFINED_SHARE = 1e-6  # of the samples: in smaller residuals the rounding of normal equations shows


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
