"""Two springs with a motor each on one joint: force and stiffness decide both deflections."""

import numpy as np
import pytest
import sympy
from scipy.optimize import brentq, minimize_scalar

from jounce.model.spring_deflection import (
    AntagonisticSprings,
    UnreachableError,
    antagonist_deflections,
    antagonist_series,
)
from jounce.model.springs import CubicSpring, SpringFunction, SpringTable, force_along
from jounce.spatial.series import Series
from support.refusals import expect_refusal

K0, A = 40.0, 3.0
SINH = SpringFunction.of(lambda d: K0 * np.sinh(A * d) / A)
ROW = np.linspace(-1, 1, 81)
TABLE = SpringTable(ROW, SINH._derivatives(ROW)[0])
PAIRS = {
    "sinh": AntagonisticSprings(SINH, SINH),
    "cubic": AntagonisticSprings(CubicSpring(40.0, 100.0), CubicSpring(40.0, 100.0)),
    "different": AntagonisticSprings(CubicSpring(100.0, 500.0), SINH),
    "tendons": AntagonisticSprings(
        SpringFunction.of(lambda d: 10 * np.exp(4 * d)), SpringFunction.of(lambda d: -10 * np.exp(-4 * d))
    ),
    "table": AntagonisticSprings(TABLE, TABLE),
}
pairs = pytest.mark.parametrize("name", PAIRS)
T = np.linspace(0, 3, 40)


def wave_series(mean, size, speed, order=4):
    return Series.of([(k == 0) * mean + size * speed**k * np.sin(speed * T + k * np.pi / 2) for k in range(order + 1)])


@pairs
def test_deflections_give_force_and_stiffness_with_rates(name):
    springs, Q, S = PAIRS[name], wave_series(3, 15, 2.0), wave_series(250, 60, 1.3)
    d1, d2 = antagonist_series(springs, Q, S)
    force, stiffness = (force_along(springs.first, d1, j) + force_along(springs.second, d2, j) for j in (0, 1))
    for k in range(4):
        np.testing.assert_allclose(force[k], Q[k], rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(stiffness[k], S[k], rtol=1e-9, atol=1e-9)
    assert (d1[0] > d2[0]).all()


def test_the_least_stiffness_of_equal_sinh_springs_is_known():
    """S >= sqrt(4 k0^2 + a^2 Q^2)."""
    Q = np.array([-60.0, 0.0, 10.0])
    least = np.sqrt(4 * K0**2 + A**2 * Q**2)
    d1, d2 = antagonist_deflections(PAIRS["sinh"], Q, least * (1 + 1e-8))
    np.testing.assert_allclose(d1, d2, atol=1e-3)
    for i in (0, 2):
        with expect_refusal(rf"at force {Q[i]:g}; it is above {least[i]:g}, where it rises", kind=UnreachableError):
            antagonist_deflections(PAIRS["sinh"], Q[i : i + 1], least[i : i + 1] * (1 - 1e-8))


@pytest.mark.parametrize("above", [1e-1, 1e-2, 1e-4, 1e-7])
def test_stiffnesses_close_above_the_least_are_reached(above):
    """The least by a search over settings that carry the force, found by bisection; 20 forces."""
    first, second = CubicSpring(40.0, 100.0), CubicSpring(100.0, 500.0)
    for Q in np.random.default_rng(0).uniform(-25, 25, 20):

        def stiffness(d, Q=Q):
            other = brentq(lambda x: first.force(d) + second.force(x) - Q, -5, 5, xtol=1e-15)
            return first.stiffness(d) + second.stiffness(other)

        least = minimize_scalar(stiffness, bounds=(-1.5, 1.5), method="bounded", options={"xatol": 1e-9}).fun
        S = np.array([least * (1 + above)])
        d1, d2 = antagonist_deflections(AntagonisticSprings(first, second), np.array([Q]), S)
        np.testing.assert_allclose(first.stiffness(d1) + second.stiffness(d2), S, rtol=1e-13)


@pytest.mark.parametrize(("springs", "Q", "S", "words"), [
    (PAIRS["sinh"], 10.0, 50.0, "no setting has stiffness 50 at force 10; it is above 85.44"),
    (PAIRS["table"], 10.0, 1e4, "no setting has stiffness 10000 at force 10; it is below 7"),
    (PAIRS["table"], 1e5, 200.0, "no setting has stiffness 200 at force 100000; no setting carries this force"),
    (AntagonisticSprings(CubicSpring(10.0), CubicSpring(20.0)), 3.0, 31.0, "it is below 30"),
    (AntagonisticSprings(CubicSpring(10.0), CubicSpring(20.0)), 3.0, 29.0, "it is above 30"),
])  # fmt: skip
def test_a_stiffness_that_no_setting_has_is_refused(springs, Q, S, words):
    with expect_refusal(words, kind=UnreachableError) as error:
        antagonist_deflections(springs, np.array([np.nan, Q]), np.array([S, S]))
    assert error.value.state == 1


def test_two_springs_need_numbers():
    with expect_refusal("^two springs of one joint need NumPy arrays of floats$"):
        antagonist_deflections(PAIRS["sinh"], np.array([sympy.Symbol("Q")]), np.array([100.0]))
