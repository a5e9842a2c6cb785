"""Least-squares splines by banded normal equations, against dense ones and scipy's."""

import numpy as np
import pytest
from scipy.interpolate import BSpline, make_lsq_spline

from jounce.motion import least_squares as ls
from jounce.motion.bsplines import BASIS_WIDTH, basis


@pytest.fixture
def problem():
    rng = np.random.default_rng(0)
    t = np.sort(np.append([0, 10], rng.uniform(0, 10, 3000)))
    y = np.sin(t[:, None] * [1, 2, 3]) + 1e-5 * rng.normal(size=(len(t), 3))
    breaks = np.sort(np.append([0, 10], rng.uniform(0.1, 9.9, 30)))
    return t, y, rng.uniform(0.5, 2, len(t)), breaks


def dense(t, breaks, order=0):
    count = len(breaks) + ls.FIT_DEGREE - 1
    return BSpline(ls.pad_knots(breaks), np.eye(count), ls.FIT_DEGREE)(t, nu=order)


def test_solutions_are_those_of_scipy(problem):
    t, y, weight, breaks = problem
    solution = ls.solve(ls.make_rows(t, y, weight, (0, 10)), breaks)
    expected = make_lsq_spline(t, y, ls.pad_knots(breaks), ls.FIT_DEGREE, w=weight)
    assert np.allclose(solution.coefficients, expected.c, atol=1e-11, rtol=0)
    assert np.allclose(solution.energy, ((weight[:, None] * (y - expected(t))) ** 2).sum(axis=0))


def test_exact_data_are_fitted_to_rounding(problem):
    t, _, weight, breaks = problem
    y = dense(t, breaks) @ np.random.default_rng(1).normal(size=(len(breaks) + 8, 3))
    assert np.abs(ls.solve(ls.make_rows(t, y, weight, (0, 10)), breaks).residual).max() < 1e-13


def test_the_covariance_is_the_inverse_of_the_normal_equations(problem):
    t, y, weight, breaks = problem
    values = weight[:, None] * dense(t, breaks)
    inverse = np.linalg.inv(values.T @ values)
    blocks = ls.covariance_blocks(ls.solve(ls.make_rows(t, y, weight, (0, 10)), breaks).factor)
    for i, block in enumerate(blocks):
        assert np.allclose(block, inverse[i : i + 10, i : i + 10], rtol=1e-8, atol=1e-10 * np.abs(block).max())


@pytest.mark.parametrize("order", range(7))
def test_derivatives_of_the_basis(problem, order):
    t, _, _, breaks = problem
    values, place = basis(t, breaks, order)
    expected = np.take_along_axis(dense(t, breaks, order), place[:, None] + np.arange(BASIS_WIDTH), axis=1)
    assert np.allclose(values, expected, atol=1e-10 * np.abs(expected).max())


def test_compressed_samples_give_the_same_spline(problem):
    t, y, weight, _ = problem
    rows = ls.compress_rows(t, y, weight, (0, 10), cells=60)
    assert len(rows.t) < len(t) / 4
    breaks = rows.snap(np.linspace(0, 10, 21))
    expected = ls.solve(ls.make_rows(t, y, weight, (0, 10)), breaks)
    solution = ls.solve(rows, breaks)
    assert np.allclose(solution.coefficients, expected.coefficients, atol=1e-9, rtol=0)
    assert np.allclose(solution.energy, expected.energy, rtol=1e-9)
    assert np.allclose(ls.covariance_blocks(solution.factor), ls.covariance_blocks(expected.factor), rtol=1e-7)
