"""B-splines of degree 9: their values, derivatives, and pieces as sums of Chebyshev polynomials."""

import numpy as np

FIT_DEGREE = 9  # q4d has five continuous derivatives more, and Q2d no kinks
BASIS_WIDTH = FIT_DEGREE + 1  # B-splines that overlap in an interval
POINTS_AT_ONCE = 2**13  # at which values are computed: they stay in a processor's cache


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
    for start in range(0, len(t), POINTS_AT_ONCE):
        some = slice(start, start + POINTS_AT_ONCE)
        around = knots[place[some] + np.arange(1, 2 * degree + 1)[:, None]]
        ahead, lower = around - t[some], np.ones((1, around.shape[1]))
        for k in range(1, degree + 1):
            share = lower / (around[degree : degree + k] - around[degree - k : degree])
            lower = np.zeros((k + 1, around.shape[1]))
            lower[1:] -= ahead[degree - k : degree] * share
            lower[:-1] += ahead[degree : degree + k] * share
        values[some] = lower.T
    return values


def chebyshev_coefficients(breaks: np.ndarray) -> np.ndarray:
    """The B-splines of each interval in Chebyshev polynomials T_k over it, (M, 10, 10): k first, B-splines last."""
    angles = np.pi * (np.arange(BASIS_WIDTH) + 0.5) / BASIS_WIDTH
    points = breaks[:-1, None] + np.diff(breaks)[:, None] * (np.cos(angles[::-1]) + 1) / 2
    values, _ = basis(points.ravel(), breaks)
    interpolation = np.cos(np.arange(BASIS_WIDTH)[:, None] * angles[::-1]) * 2 / BASIS_WIDTH
    interpolation[0] /= 2
    return interpolation @ values.reshape(-1, BASIS_WIDTH, BASIS_WIDTH)


def evaluate_chebyshev(x: np.ndarray, count: int) -> np.ndarray:
    """Chebyshev polynomials T_0, T_1, ... at x (P,), (count, P)."""
    T, twice = np.empty((count, len(x))), 2 * x
    T[0], T[1] = 1, x
    for k in range(2, count):
        np.multiply(twice, T[k - 1], out=T[k])
        T[k] -= T[k - 2]
    return T
