"""B-splines of degree 9: their values, derivatives, and pieces as sums of Chebyshev polynomials."""

import numpy as np

FIT_DEGREE = 9  # q4d has five continuous derivatives more, and Q2d no kinks
BASIS_WIDTH = FIT_DEGREE + 1  # B-splines that overlap in an interval
POINTS_AT_ONCE = 2**13  # at which values are computed: they stay in a processor's cache,
INTERVALS_AT_ONCE = 2**9  # as those at ten points in each of these do


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
