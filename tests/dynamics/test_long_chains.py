"""Chains of hundreds of bodies, and bodies that carry hundreds: no call nests as deep as there are bodies."""

import inspect
import sys

import numpy as np
import pytest

import jounce
from jounce.dynamics.quantities import QUANTITIES

BODIES = 120
SPARE_CALLS = 230  # on the stack, of which each body would take two or more
ROWS = [name for name, row in QUANTITIES.items() if row.everywhere]


def bars(parent):
    """Bars of 5 cm that turn about y and z in turn."""
    count = len(parent)
    B, X = np.tile(np.eye(4), (count, 1, 1)), np.zeros((count, 6))
    B[1:, 0, 3] = 0.05
    X[::2, 2] = X[1::2, 1] = 1
    M = jounce.inertia_matrix(0.1, [0.025, 0, 0], np.diag([1e-5, 3e-5, 3e-5]))
    return jounce.Robot.from_screws(B, X, np.stack([M] * count), parent, gravity=[0, 0, -9.81])


def small_rates(robot, count):
    return 0.1 * np.random.default_rng(0).normal(size=(count, robot.n))


@pytest.fixture
def few_spare_calls():
    """Calls nest no deeper than `SPARE_CALLS` from here on."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack(0)) + SPARE_CALLS)
    yield
    sys.setrecursionlimit(limit)


SHAPES = {"chain": range(-1, BODIES - 1), "star": [-1, *[0] * (BODIES - 1)]}
ROBOTS = {name: bars(list(parent)) for name, parent in SHAPES.items()}


@pytest.mark.sweep(12)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("name", ROWS)
def test_calls_do_not_nest_by_bodies(name, order, shape, few_spare_calls):
    robot, row = ROBOTS[shape], QUANTITIES[name]
    if order > row.highest(order) or ("second" in name):
        pytest.skip("it has no rates, or as many numbers as bodies to the third power")
    found = getattr(robot, name)(*small_rates(robot, row.takes.rates + order), method="recursion")
    for x in found if isinstance(found, tuple) else (found,):
        assert np.isfinite(x).all()


def test_a_chain_of_four_hundred():
    """Partial derivatives against differences of the forces along a direction, and M as a quantity of its own."""
    robot, h = bars(list(range(-1, 399))), 1e-6
    q, qd, q2d, along = small_rates(robot, 4)
    P = robot.inverse_dynamics_partials(q, qd, q2d, method="recursion")
    ends = [robot.inverse_dynamics(q + s * along, qd, q2d, method="recursion") for s in (-h, h)]
    difference = (ends[1] - ends[0]) / (2 * h)
    np.testing.assert_allclose(P[0] @ along, difference, atol=1e-6 * np.abs(difference).max())
    M = robot.mass_matrix(q, method="recursion")
    np.testing.assert_allclose(P[2], M, atol=1e-12 * np.abs(M).max())
