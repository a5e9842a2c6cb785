"""Magnitudes are about as large as results that do not cancel, stay where results do, and grow with the masses."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import jounce
from jounce.checks.magnitudes import _Sized, magnitudes, scale
from jounce.dynamics import joint_springs
from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.quantities.row import CLOSED, ON_CONTACTS
from jounce.engine.generic_methods import compute_by_method
from jounce.model.drive_trains import UNDRIVEN, Drives
from jounce.spatial.series import Series
from support.quantities import REQUESTS, branched, served
from support.robots import mechanisms, on_its_axis, springs
from support.states import random_inputs
from support.units import SI

OF_TREES = [row for row in QUANTITIES.values() if not (CLOSED in row.needs or ON_CONTACTS in row.needs)]
every = pytest.mark.parametrize("quantity", OF_TREES, ids=lambda row: row.name)


def with_springs(m):
    return replace(m, elasticity=springs(m.n))


@every
@given(mechanisms(6, units=st.just(SI)))
def test_magnitudes_are_about_as_large_as_results(quantity, drawn):
    """Hence errors relative to them are no more forgiving than those relative to the largest entry."""
    m, rng = served(jounce.Robot(with_springs(drawn[0])), quantity).mechanism, drawn[1]
    asked = Computation(quantity.name, quantity.highest(3), quantity.takes.wrenches)
    q = random_inputs(asked.signature(m).inputs, 10, seed=rng)
    results = compute_by_method(asked, "recursion", m, q)
    sizes = magnitudes(m, asked, q)
    assert [size.shape for size in sizes] == [result.shape for result in results]
    for k, (size, result) in enumerate(zip(sizes, results, strict=True)):
        largest = np.abs(result).max()
        assert 0.1 * largest <= size.max(), k
        near_zero = (
            quantity.inverts or quantity.gives.results or "rates" in quantity.gives.shape
        )  # as of a mass matrix that is constant
        if quantity.takes.wrenches and not near_zero:
            assert size.max() <= 10 * 5**k * largest, k


@pytest.mark.parametrize(("quantity", "keywords"), REQUESTS)
def test_every_quantity_has_magnitudes_of_its_shapes(quantity, keywords):
    m = branched().mechanism
    asked = Computation(quantity.name, quantity.highest(2), quantity.takes.wrenches, **keywords)
    q = random_inputs(asked.signature(m).inputs, 10)
    results = compute_by_method(asked, "recursion", m, q)
    for size, result in zip(magnitudes(m, asked, q), results, strict=True):
        assert size.shape == result.shape
        assert 0.1 * np.abs(result).max() <= size.max() or not result.any()


@pytest.mark.parametrize("quantity", [row for row in QUANTITIES.values() if row.everywhere], ids=lambda row: row.name)
@given(drawn=mechanisms(4, units=st.just(SI)))
@settings(max_examples=5)
def test_magnitudes_are_linear_in_the_masses_or_do_not_depend_on_them(quantity, drawn):
    m, rng = drawn
    asked = Computation(quantity.name, quantity.highest(1))
    q = random_inputs(asked.signature(m).inputs, 10, seed=rng)
    own = quantity.takes.coordinates(len(q))
    more = [*q[:own], *(1e3 * Q for Q in q[own:])]
    heavy, light = magnitudes(replace(m, M=1e3 * m.M), asked, more), magnitudes(m, asked, q)
    with_parameters = "parameters" in quantity.gives.shape
    of_motion = quantity.of_bodies or quantity.takes.forces or quantity.name == "center_of_mass" or with_parameters
    for name, x, y in zip(quantity.names(asked.order), heavy, light, strict=True):
        factor = 1e-3 if name in ("Minv", "dqdQ") else 1 if of_motion else 1e3
        np.testing.assert_allclose(x, factor * y, rtol=1e-9)


def test_magnitudes_stay_where_results_cancel():
    m, q = on_its_axis(2.0).mechanism, [np.array([[0.3]]), np.array([[0.5]])]
    for k, size in enumerate(magnitudes(m, Computation("gravity_forces", 1), q)):
        assert 0.5**k * 2.0 * 9.81 * 0.1 < size.min() < 2.0 * 9.81
    assert magnitudes(m, Computation("mass_matrix", 1), q)[1].min() > 0.1


@pytest.mark.parametrize(("k", "k3"), [(1e2, 1e4), (1e3, 50.0), (5e2, 1e8), (1e-3, 1e4)])
@pytest.mark.parametrize("name", ["motor_positions", "motor_torques"])
def test_stiffening_springs_deflect_in_proportion_to_their_cause(name, k, k3):
    """However many steps lead to them: a change P of Q moves a spring by P / phi'."""
    m = jounce.load("planar2r").elastic(spring=jounce.CubicSpring(k, k3), rotor=0.1).mechanism
    asked = Computation(name, 2)
    q = random_inputs(asked.signature(m).inputs, 10)
    for size, result in zip(magnitudes(m, asked, q), compute_by_method(asked, "recursion", m, q), strict=True):
        assert 0.1 * np.abs(result).max() <= size.max() <= (200 if k < 1 else 20) * np.abs(result).max()


def test_sizes_of_deflections_follow_forces_that_cancel():
    """Q = 0 of terms of 3 N m: the spring k delta + k3 delta^3 is off by rounding of 3 / k, not of the root of 3."""
    Q = [np.zeros((1, 1)), np.full((1, 1), 2.0)]
    sized = Series.of([_Sized(Q[0], np.full((1, 1), 9.0)), _Sized(Q[1])])
    delta = joint_springs.deflect_spring(jounce.CubicSpring(4.0, 1e6), sized)
    assert [x.value.item() for x in delta.upto(1)] == [0.0, 0.5]
    np.testing.assert_allclose([np.sqrt(x.square).item() for x in delta.upto(1)], [0.75, 0.5], rtol=1e-15)


def test_where_nothing_is_added_up_errors_are_absolute():
    m = on_its_axis().mechanism
    (size,) = magnitudes(replace(m, M=0 * m.M), Computation("gravity_forces", 0), [np.zeros((1, 1))])
    assert scale(np.zeros((1, 1)), size) == 1.0


def test_drives_that_act_are_among_the_terms():
    m, q = on_its_axis().mechanism, [*np.full((4, 1, 1), 0.1)]
    numbers = {"armature": 1e3, "damping": 0.0, "friction": 1e4, "eps": 1.0, "stiffness": 1e4, "rest": 0.3}
    driven = replace(m, drives=Drives(**{name: np.array([x]) for name, x in (UNDRIVEN | numbers).items()}))
    forces, mass, energy = (Computation(name, 0) for name in ("inverse_dynamics", "mass_matrix", "potential_energy"))
    spring = np.hypot(1e3, 3e3)  # 1e4 (theta - rest)
    for acting, terms in (
        ((), 0),
        (("friction", "spring"), np.hypot(1e4 * np.tanh(0.1), spring)),
        (("armature",), 100),
    ):
        (size,) = magnitudes(replace(driven, acting=acting), forces, q[:3])
        assert size == pytest.approx(np.hypot(terms, magnitudes(m, forces, q[:3])[0]))
    (size,) = magnitudes(replace(driven, acting=("armature",)), mass, q[:1])
    assert size == pytest.approx(1e3, rel=1e-3)
    (size,) = magnitudes(replace(driven, acting=("spring",)), energy, q[:1])
    assert size == pytest.approx(spring**2 / 2e4, rel=1e-2)
