"""Magnitudes are about as large as results that do not cancel, stay where results do, and grow with the masses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from jounce.robot.evaluation import evaluate
from robots import mechanisms, on_its_axis

from jounce.checks.magnitudes import magnitudes, scale
from jounce.dynamics.quantities import COMPILED, PATHS
from jounce.model.drives import Drives

LOADED = "inverse_dynamics"


def state(rng, m, quantity, order):
    q = [*rng.uniform(-2, 2, (order + COMPILED[quantity], 10, m.n))]
    return q, [*rng.uniform(-3, 3, (order + 1, 10, m.nb, 6))] * (quantity == LOADED)


@pytest.mark.parametrize("quantity", COMPILED)
@settings(max_examples=15)
@given(mechanisms(6))
def test_magnitudes_are_about_as_large_as_results(quantity, drawn):
    """Hence errors relative to them are no more forgiving than those relative to the largest entry."""
    m, rng = drawn
    q, W = state(rng, m, quantity, 3)
    path = PATHS[quantity]["recursion"]
    results = evaluate(lambda q, W: path.law(m, q, W), q, W, 3, path.width(m.nb))
    sizes = magnitudes(m, quantity, q, W, 3)
    assert [size.shape for size in sizes] == [result.shape for result in results]
    for k, (size, result) in enumerate(zip(sizes, results, strict=True)):
        largest = np.abs(result).max()
        assert 0.1 * largest <= size.max(), k
        if quantity == LOADED:  # never near zero, as a mass matrix that hardly changes is
            assert size.max() <= 10 * 2**k * largest, k


@pytest.mark.parametrize("quantity", COMPILED)
@given(drawn=mechanisms(4))
@settings(max_examples=5)
def test_magnitudes_are_linear_in_the_masses(quantity, drawn):
    m, rng = drawn
    q, _ = state(rng, m, quantity, 1)
    heavy, light = (magnitudes(x, quantity, q, [], 1) for x in (replace(m, M=1e3 * m.M), m))
    for x, y in zip(heavy, light, strict=True):
        np.testing.assert_allclose(x, 1e3 * y, rtol=1e-9)


def test_magnitudes_stay_where_results_cancel():
    m, q = on_its_axis(2.0).mechanism, [np.array([[0.3]]), np.array([[0.5]])]
    for k, size in enumerate(magnitudes(m, "gravity_forces", q, [], 1)):
        assert 0.5**k * 2.0 * 9.81 * 0.1 < size.min() < 2.0 * 9.81
    assert magnitudes(m, "mass_matrix", q, [], 1)[1].min() > 0.1


def test_where_nothing_is_added_up_errors_are_absolute():
    m = on_its_axis().mechanism
    (size,) = magnitudes(replace(m, M=0 * m.M), "gravity_forces", [np.zeros((1, 1))], [], 0)
    assert scale(np.zeros((1, 1)), size) == 1.0


def test_drives_that_act_are_among_the_terms():
    m, q = on_its_axis().mechanism, [*np.full((4, 1, 1), 0.1)]
    numbers = {"armature": 1e3, "damping": 0.0, "friction": 1e4, "eps": 1.0, "stiffness": 1e4, "rest": 0.1 + 1e-3}
    driven = replace(m, drives=Drives(**{name: np.array([x]) for name, x in numbers.items()}))
    for acting, terms in (((), 0), (("friction", "spring"), np.hypot(1e4 * np.tanh(0.1), 10)), (("armature",), 100)):
        (size,) = magnitudes(replace(driven, acting=acting), LOADED, q[:3], [], 0)
        assert size == pytest.approx(np.hypot(terms, magnitudes(m, LOADED, q[:3], [], 0)[0]))
    (size,) = magnitudes(replace(driven, acting=("armature",)), "mass_matrix", q[:1], [], 0)
    assert size == pytest.approx(1e3, rel=1e-3)
