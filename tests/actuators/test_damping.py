"""Springs with a damper in parallel: deflections over time, and the series at one instant."""

import mpmath
import numpy as np
import pytest

from jounce.actuators import motors
from jounce.dynamics import joint_springs
from jounce.model.springs import CubicSpring, force_along
from jounce.spatial.series import Series
from support.refusals import expect_refusal

SPEED = 7.0  # rad/s, of the waves
CUBIC = CubicSpring(500.0, 2e4)
DAMPERS = (50.0, 3.0, 0.05, 1e-4)  # N m s: slower and faster than the wave, and stiff


def wave(size, t, order):
    return Series.of([size * SPEED**k * np.sin(SPEED * t + k * np.pi / 2) for k in range(order + 1)])


def damped_force(spring, D, t, order=2):
    """The force of a spring with a damper on a wave of the deflection."""
    delta = wave(0.05, t, order + 1)
    return (force_along(spring, delta) + delta.dot * D).upto(order)


def sampled_forces(spring, D):
    """Q, Qd, Q2d before and after times."""

    def both(t):
        rates = [x[:, None] for x in damped_force(spring, D, t)]
        return rates, rates

    return both


@pytest.mark.parametrize("z", [0.0, 1e-12, 0.5, 3.0, 5.9, 6.0, 11.0, 1e4])
def test_the_integrals_of_the_exponential(z):
    with mpmath.workdps(30):
        split = [0, max(0, 1 - 20 / max(z, 1)), 1]
        expected = [mpmath.quad(lambda u, j=j: mpmath.exp(-z * (1 - u)) * u**j, split) for j in range(6)]
    np.testing.assert_allclose(
        motors.exponential_integrals(np.array(z), 6), np.array(expected, dtype=float), rtol=1e-14
    )


@pytest.mark.parametrize("D", DAMPERS)
def test_linear_springs_are_integrated_exactly(D):
    """Polynomials of degree five are exact at any step, forces between samples within the error of Hermite's."""
    K, t = np.array([500.0, 80.0]), np.array([0.0, 0.4, 1.0, 3.0])
    exact = [np.polynomial.Polynomial(c) for c in ([0.1, 2, -1, 0.3, 1, -0.2], [0, 0, 0.4, 0, 0, 0.3])]
    Q = [k * x + D * x.deriv() for k, x in zip(K, exact, strict=True)]

    def polynomials(t):
        rates = [np.stack([x.deriv(k)(t) if k else x(t) for x in Q], 1) for k in range(3)]
        return rates, rates

    expected = np.stack([x(t) for x in exact], 1)
    found = motors.integrate_linear(K, np.array([D, D]), t, polynomials(t), expected[0])
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    t = np.linspace(0, 1, 101)
    found = motors.integrate_linear(
        np.array([500.0]), np.array([D]), t, sampled_forces(CubicSpring(500.0), D)(t), np.zeros(1)
    )
    np.testing.assert_allclose(found[:, 0], wave(0.05, t, 0)[0], atol=1e-12)


@pytest.mark.parametrize("D", DAMPERS)
def test_other_springs_are_integrated_to_the_error_of_the_interpolant(D):
    errors = []
    for count in (51, 101):
        t = np.linspace(0, 1, count)
        found = motors.integrate_nonlinear(CUBIC, D, t, sampled_forces(CUBIC, D)(t), 0.0)
        errors.append(np.abs(found - wave(0.05, t, 0)[0]).max())
    assert errors[0] < 1e-10
    assert errors[1] < max(errors[0] / 30, 1e-15)


def test_a_jump_of_the_force_dies_out_with_the_time_constant():
    K, D, t = 500.0, 5.0, np.linspace(0, 0.1, 6)

    def step(t):
        after = [np.full((len(t), 1), 10.0), *np.zeros((2, len(t), 1))]
        return after, after

    expected = 10 / K * (1 - np.exp(-t * K / D))
    found = motors.integrate_linear(np.array([K]), np.array([D]), t, step(t), np.zeros(1))
    np.testing.assert_allclose(found[:, 0], expected, rtol=1e-13)
    np.testing.assert_allclose(motors.integrate_nonlinear(CubicSpring(K), D, t, step(t), 0.0), expected, rtol=1e-6)


@pytest.mark.parametrize("spring", [CubicSpring(500.0), CUBIC])
def test_each_term_of_the_series_has_the_error_of_the_next(spring):
    t = np.linspace(0, 1, 30)
    Q, delta = Series.of(damped_force(spring, 3.0, t, 8)), wave(0.05, t, 2)
    errors = []
    for terms in range(1, 7):
        sums = joint_springs.expand_damped_deflection(spring, 3.0, Q, terms)
        errors.append(np.abs(sums[-1][0] - delta[0]).max())
        joint_springs.check_series(sums, 3.0 / 500)
        estimate = np.abs(sums[-1][0] - sums[-2][0]).max()
        assert terms == 1 or errors[-1] < estimate < errors[-2] * 1.1
    assert errors[-1] < 1e-5 * errors[0]


def test_a_series_whose_terms_do_not_fall_is_refused():
    Q = Series.of(damped_force(CUBIC, 80.0, np.linspace(0, 1, 30), 6))
    sums = joint_springs.expand_damped_deflection(CUBIC, 80.0, Q, 4)
    with expect_refusal("does not converge: term 4 is …; the time constant D/K is 0.16 s; use mot"):
        joint_springs.check_series(sums, 80 / 500)


def test_rates_of_a_deflection_that_is_known():
    t = np.linspace(0, 1, 30)
    Q = Series.of(damped_force(CUBIC, 3.0, t, 4))
    found = joint_springs.damped_deflection_rates(CUBIC, 3.0, Q, wave(0.05, t, 0)[0])
    for k in range(6):
        np.testing.assert_allclose(found[k], wave(0.05, t, k)[k], rtol=1e-8, atol=1e-11 * 1e3**k)
