"""Least-squares splines by banded normal equations, against dense ones and scipy's."""

import numpy as np
import pytest
from scipy.interpolate import BSpline, make_lsq_spline

from jounce.motion import knots, least_squares
from jounce.motion import least_squares as ls


@pytest.fixture
def fit_problem():
    rng = np.random.default_rng(0)
    t = np.sort(np.append([0, 10], rng.uniform(0, 10, 3000)))
    y = np.sin(t[:, None] * [1, 2, 3]) + 1e-5 * rng.normal(size=(len(t), 3))
    breaks = np.sort(np.append([0, 10], rng.uniform(0.1, 9.9, 30)))
    return t, y, rng.uniform(0.5, 2, len(t)), breaks


def spline_basis(t, breaks, order=0):
    count = len(breaks) + ls.FIT_DEGREE - 1
    return BSpline(ls.pad_knots(breaks), np.eye(count), ls.FIT_DEGREE)(t, nu=order)


def test_solutions_are_those_of_scipy(fit_problem):
    t, y, weight, breaks = fit_problem
    solution = ls.solve(ls.make_rows(t, y, weight, (0, 10)), breaks)
    expected = make_lsq_spline(t, y, ls.pad_knots(breaks), ls.FIT_DEGREE, w=weight)
    assert np.allclose(solution.coefficients, expected.c, atol=1e-11, rtol=0)
    assert np.allclose(solution.energy, ((weight[:, None] * (y - expected(t))) ** 2).sum(axis=0))


def test_exact_data_are_fitted_to_rounding(fit_problem):
    t, _, weight, breaks = fit_problem
    y = spline_basis(t, breaks) @ np.random.default_rng(1).normal(size=(len(breaks) + 8, 3))
    assert np.abs(ls.solve(ls.make_rows(t, y, weight, (0, 10)), breaks).residual).max() < 1e-13


def test_the_covariance_is_the_inverse_of_the_normal_equations(fit_problem):
    t, y, weight, breaks = fit_problem
    values = weight[:, None] * spline_basis(t, breaks)
    inverse = np.linalg.inv(values.T @ values)
    blocks = ls.covariance_blocks(ls.solve(ls.make_rows(t, y, weight, (0, 10)), breaks).factor)
    for i, block in enumerate(blocks):
        assert np.allclose(block, inverse[i : i + 10, i : i + 10], rtol=1e-8, atol=1e-10 * np.abs(block).max())


@pytest.mark.parametrize("order", range(7))
def test_derivatives_of_the_basis(fit_problem, order):
    t, _, _, breaks = fit_problem
    values, place = least_squares.basis(t, breaks, order)
    expected = np.take_along_axis(
        spline_basis(t, breaks, order), place[:, None] + np.arange(least_squares.BASIS_WIDTH), axis=1
    )
    assert np.allclose(values, expected, atol=1e-10 * np.abs(expected).max())


def test_compressed_samples_give_the_same_spline(fit_problem):
    t, y, weight, _ = fit_problem
    rows = ls.compress_rows(t, y, weight, (0, 10), cells=60)
    assert len(rows.t) < len(t) / 4
    breaks = rows.snap(np.linspace(0, 10, 21))
    expected = ls.solve(ls.make_rows(t, y, weight, (0, 10)), breaks)
    solution = ls.solve(rows, breaks)
    assert np.allclose(solution.coefficients, expected.coefficients, atol=1e-9, rtol=0)
    assert np.allclose(solution.energy, expected.energy, rtol=1e-9)
    assert np.allclose(ls.covariance_blocks(solution.factor), ls.covariance_blocks(expected.factor), rtol=1e-7)


def test_b_splines_are_sums_of_chebyshev_polynomials(fit_problem):
    t, _, _, breaks = fit_problem
    values, place = least_squares.basis(t, breaks)
    x = 2 * (t - breaks[place]) / np.diff(breaks)[place] - 1
    chebyshev = np.polynomial.chebyshev.chebvander(x, ls.FIT_DEGREE)
    assert np.allclose(least_squares.evaluate_chebyshev(x, least_squares.BASIS_WIDTH).T, chebyshev, atol=1e-13)
    pieces = (chebyshev[:, None] @ least_squares.chebyshev_coefficients(breaks)[place])[:, 0]
    assert np.allclose(pieces, values, atol=1e-13)


def uneven_rows(hole):
    """Rows whose intervals have 20 to 60 of them each, from 0 to 10 s but for a hole; and the breaks."""
    rng = np.random.default_rng(2)
    t = np.sort(rng.uniform(0, 10, 2000))
    t = t[(t < 4) | (t > 4 + hole)]
    starts = np.cumsum(rng.integers(20, 60, 40))
    starts = starts[starts < len(t) - 20]
    y = np.sin(t[:, None] * [1, 2, 3]) + 1e-5 * rng.normal(size=(len(t), 3))
    return t, y, rng.uniform(0.5, 2, len(t)), np.concatenate([[0], (t[starts] + t[starts - 1]) / 2, [10]])


@pytest.mark.parametrize("hole", [0, 0.03, 0.3, 3])  # s: beside the last ones an interval is covered by less than 0.8
def test_sums_of_chebyshev_polynomials_give_the_equations(hole):
    t, y, weight, breaks = uneven_rows(hole)
    found = least_squares.factorize(t, weight, breaks, in_cells=True)
    expected = least_squares.factorize(t, weight, breaks, in_cells=False)
    assert (found.E.ndim == 3) == (hole < 0.1)
    assert np.allclose(found.factor, expected.factor, rtol=1e-6, atol=1e-9 * np.abs(expected.factor).max())
    (coefficients, left), (others, rest) = found.fit(weight[:, None] * y), expected.fit(weight[:, None] * y)
    assert np.allclose(left, rest, atol=1e-9)
    assert hole > 1 or np.allclose(coefficients, others, atol=1e-8)


def test_tens_of_rows_are_summed_alike():
    t, y, weight, _ = uneven_rows(0)
    t, y, weight = t[:1990], y[:1990], weight[:1990]
    ends = np.arange(50, 1990, 50)
    in_tens = np.concatenate([[0], (t[ends] + t[ends - 1]) / 2, [10]])
    found, shifted = (least_squares.factorize(t[k:], weight[k:], in_tens, in_cells=True) for k in (0, 1))
    assert found.sums is not None
    assert shifted.sums is None
    expected = make_lsq_spline(t, y, ls.pad_knots(in_tens), ls.FIT_DEGREE, w=weight)
    assert np.allclose(found.fit(weight[:, None] * y)[0], expected.c, atol=1e-9)
    expected = make_lsq_spline(t[1:], y[1:], ls.pad_knots(in_tens), ls.FIT_DEGREE, w=weight[1:])
    assert np.allclose(shifted.fit((weight[:, None] * y)[1:])[0], expected.c, atol=1e-9)


@pytest.mark.parametrize("start", [0, 4])
@pytest.mark.parametrize("alone", [0, 1, 2, 3])
def test_breaks_that_a_hole_does_not_bear_are_dropped(start, alone):
    """They left equations singular, where a hole of seconds holds one row or two."""
    t = np.arange(8000) / 1000
    inside = (t > start) & (t < start + 3)
    kept = ~inside
    kept[np.random.default_rng(alone).choice(np.flatnonzero(inside), alone, replace=False)] = True
    rows = ls.make_rows(t[kept], np.sin(t[kept])[:, None], np.ones(kept.sum()), (0, t[-1]))
    solution = knots.fit_breaks(rows, np.linspace(0, t[-1], 200))
    assert np.abs(solution.residual).max() < 1e-6
    assert solution.intervals > 60
