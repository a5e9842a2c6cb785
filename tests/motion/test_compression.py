"""Ten rows per cell stand for all samples in it: sums of polynomials are the same."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import legendre

from jounce.motion import least_squares


@pytest.mark.parametrize("counts", [(30, 30, 30), (30, 29, 30, 29), (29, 30)])
def test_sums_of_polynomials_over_cells_are_kept(counts):
    """Cells of one sample less too, whose first sample after them is that of the next cell."""
    rng, starts = np.random.default_rng(0), np.concatenate([[0], np.cumsum(counts)])
    edges = np.arange(len(counts) + 1.0)
    t = np.concatenate([k + np.sort(rng.uniform(size=count)) for k, count in enumerate(counts)])
    y, weight = rng.normal(size=(len(t), 2)), rng.uniform(0.5, 2, len(t))
    times, right, weights, rest = least_squares.compress_cells(t, y, weight, starts, edges)
    left = np.zeros(2)
    for k, (first, last) in enumerate(pairwise(starts)):
        rows, given = slice(10 * k, 10 * k + 10), slice(first, last)
        p, of_given = (legendre.legvander(2 * (x - k) - 1, 19) for x in (times[rows], t[given]))
        squares = weight[given] ** 2
        np.testing.assert_allclose((weights[rows] ** 2) @ p, squares @ of_given, rtol=1e-10, atol=1e-10)
        sums = p[:, :10].T @ (weights[rows, None] * right[rows])
        np.testing.assert_allclose(sums, of_given[:, :10].T @ (squares[:, None] * y[given]), rtol=1e-9, atol=1e-9)
        W = weight[given, None]
        best = np.linalg.lstsq(W * of_given[:, :10], W * y[given], rcond=None)[0]
        left += ((W * (y[given] - of_given[:, :10] @ best)) ** 2).sum(axis=0)
    np.testing.assert_allclose(rest, left, rtol=1e-9)
