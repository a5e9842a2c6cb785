"""Series: Leibniz' rule and differential equations, against functions whose derivatives are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from jounce.spatial.series import Series, column_series, diagonal, from_rate, join_series, product_rate, with_rates

ORDER = 5
polynomials = st.lists(st.integers(-5, 5), min_size=1, max_size=6).map(Polynomial)


def matrix_series(entries):
    """A 2x2 matrix of polynomials with its derivatives at 0.5."""
    return Series.of([np.array([[p.deriv(k)(0.5) if k else p(0.5) for p in entries[i : i + 2]] for i in (0, 2)])
                      for k in range(ORDER + 1)])  # fmt: skip


@given(st.lists(polynomials, min_size=4, max_size=4), st.lists(polynomials, min_size=4, max_size=4))
def test_products_are_differentiated_by_leibniz(p, r):
    product = [p[i] * r[j] + p[i + 1] * r[j + 2] for i in (0, 2) for j in (0, 1)]
    S, T = matrix_series(p), matrix_series(r)
    for found, expected in ((S @ T, product), (S * T, [x * y for x, y in zip(p, r, strict=True)])):
        for k in range(ORDER + 1):
            np.testing.assert_allclose(found[k], matrix_series(expected)[k], rtol=1e-12, atol=1e-9)


def test_sums_constants_and_transposes():
    S = Series.of([np.array([[1.0, 2], [3, 4]]) * 10**k for k in range(3)])
    c = np.array([[1.0, 1], [0, 1]])
    assert ((S + c)[0] == S[0] + c).all()
    assert ((S + c)[1] == S[1]).all()
    assert ((S - S)[2] == 0).all()
    assert ((c @ S)[2] == c @ S[2]).all()
    assert ((S @ c)[2] == S[2] @ c).all()
    assert ((2 * S)[1] == (S * 2)[1]).all()
    assert ((-S).mT[1] == -S[1].T).all()
    assert (S.dot[1] == S[2]).all()
    assert (Series.constant(c)[3] == 0).all()
    assert join_series([S, S], axis=-1)[0].shape == (2, 4)


@pytest.mark.parametrize("k", range(5))
def test_rates_of_stacked_products_are_those_of_series(k):
    rng = np.random.default_rng(0)
    S, T = rng.normal(size=(5, 7, 2, 3)), rng.normal(size=(6, 7, 3, 4))
    np.testing.assert_allclose(product_rate(S, T, k), (Series.of(S) @ Series.of(T))[k], atol=1e-13)


def test_rates_to_come_are_zeros():
    np.testing.assert_array_equal(with_rates(np.ones(2), 2), [[1, 1], [0, 0], [0, 0]])


def test_from_rate_solves_the_differential_equation():
    A = np.array([[0.1, 1.0], [-2.0, 0.3]])
    S = from_rate(np.eye(2), lambda S: A @ S)  # exp(A t) at t = 0
    for k in range(ORDER + 1):
        np.testing.assert_allclose(S[k], np.linalg.matrix_power(A, k), rtol=1e-14)
    logistic = from_rate(np.array([[0.5]]), lambda y: y - y * y)  # y' = y (1 - y): y'' = y' (1 - 2 y) = 0 at 1/2
    assert [float(logistic[k][0, 0]) for k in range(4)] == [0.5, 0.25, 0.0, -0.125]


def test_terms_are_computed_once_and_only_when_asked_for():
    asked = []

    def term(k):
        asked.append(k)
        return np.ones((1, 1))

    S = Series(term)
    product = S @ S
    assert asked == []
    product[1], product[1], S[1]
    assert asked == [0, 1]


def test_given_terms_end_where_they_end():
    with pytest.raises(IndexError):
        column_series([np.zeros(2)])[1]


def test_diagonal_places_blocks():
    blocks = np.arange(2 * 3 * 2 * 2).reshape(2, 3, 2, 2)
    D = diagonal(blocks)
    assert D.shape == (2, 6, 6)
    for i in range(3):
        assert (D[:, 2 * i : 2 * i + 2, 2 * i : 2 * i + 2] == blocks[:, i]).all()
    assert D.sum() == blocks.sum()
