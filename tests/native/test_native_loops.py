"""Closed robots in native code: kernels, the step that closes loops, the short way of calls, and few operations."""

import numpy as np
import pytest

import jounce
from jounce.dynamics import loop_assembly
from jounce.dynamics.computation import Computation
from jounce.dynamics.loop_branches import constraint_pattern, scales
from jounce.native.code_forms import trace_program
from jounce.native.laws import NativeStep
from jounce.spatial.linear import OrthogonalFactors, elimination_order
from support.refusals import expect_refusal, refusal
from support.robots import relative_error

ROBOTS = ("fivebar", "fourbar_leg", "delta")


def positions(robot, count, size=0.1):
    """Independent coordinates about the start."""
    own, s = list(robot.mechanism.closure.independent), scales(robot.mechanism)
    way = np.random.default_rng(0).uniform(-size, size, (count, robot.n))
    return robot.mechanism.closure.start[own] + way * s.coordinates[own]


def operations(mechanism, name, order):
    return trace_program(mechanism, Computation(name, order)).operations


@pytest.mark.parametrize(
    ("name", "quantity", "order", "times"),
    [
        ("fivebar", "inverse_dynamics", 2, 3),
        ("delta", "inverse_dynamics", 1, 4),
        ("gough_stewart", "inverse_dynamics", 0, 5.1),  # 21 at first, by constraints without their zeros
        ("gough_stewart", "coordinates", 1, np.inf),
    ],
)
def test_a_closed_robot_takes_few_times_the_operations_of_its_tree(closed, name, quantity, order, times):
    m = closed[name].mechanism
    found = operations(m, quantity, order)
    assert found < 1500 if quantity == "coordinates" else found < times * operations(m.tree, quantity, order)


def test_legs_of_a_platform_leave_their_rows_one_by_one(closed):
    """Of fifteen dependent coordinates ten are those of universal joints, each with a row of its own."""
    m = closed["gough_stewart"].mechanism
    dependent = list(m.closure.dependent)
    steps = elimination_order(constraint_pattern(m)[:, dependent])
    alone = [m.tree.coordinates[dependent[j]] for j, row in steps if row is not None]
    assert sorted(alone) == [f"leg{k}_{axis}" for k in range(2, 7) for axis in "xy"]


@pytest.mark.parametrize("seed", range(4))
def test_factors_with_zeros_solve_as_dense_ones(seed):
    rng = np.random.default_rng(seed)
    zeros = rng.random((7, 5)) < 0.6
    zeros[range(5), rng.permutation(5)] = False
    A = np.where(zeros, 0, rng.normal(size=(3, 7, 5)))
    x, b = rng.normal(size=(3, 5, 2)), rng.normal(size=(3, 5, 2))
    factors = OrthogonalFactors.of(A, ~zeros)
    np.testing.assert_allclose(factors.solve(A @ x), x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(factors.solve_transposed(b), np.linalg.pinv(A.mT) @ b, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_native_steps_are_those_of_arrays(closed, name):
    robot = closed[name]
    m, rng = robot.mechanism, np.random.default_rng(2)
    q = m.closure.start + rng.uniform(-0.1, 0.1, (9, m.tree.n))
    change = rng.uniform(-0.1, 0.1, (9, m.n))
    for found, expected in zip(NativeStep(m)(q, change), loop_assembly.numpy_step(m)(q, change), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_closed_positions_do_not_depend_on_batch_or_method(closed, name):
    robot = closed[name]
    u = positions(robot, 30, 0.3)
    u[7] = np.nan
    q = robot.coordinates(u)
    assert np.isnan(q[7]).all()
    known = np.delete(np.arange(30), 7)
    assert (robot.coordinates(u[3]) == q[3]).all()
    assert relative_error(robot.coordinates(u[known], method="recursion"), q[known]) < 1e-13
    missing = q.copy()
    missing[3, robot.mechanism.closure.dependent[0]] = np.nan  # the others are as they are without it
    for method in (None, "recursion"):
        found = robot.coordinates(missing, method=method)
        assert np.isnan(found).any(axis=1).nonzero()[0].tolist() == [3, 7]
        assert relative_error(np.delete(found, [3, 7], 0), np.delete(q, [3, 7], 0)) < 1e-13
    near = q[known] + np.random.default_rng(3).uniform(-1e-3, 1e-3, (29, 1)) * np.isin(
        range(robot.mechanism.tree.n), robot.mechanism.closure.dependent
    )
    assert relative_error(robot.coordinates(near), q[known]) < 1e-13
    assert relative_error(robot.coordinates(near[0]), q[known[0]]) < 1e-13  # by the short way, as one state
    assert np.abs(loop_assembly.loop_gaps(robot.mechanism, q[known])[0]).max() < 1e-14


def test_the_short_way_of_calls_is_the_long_one(closed):
    robot = jounce.Robot(closed["fivebar"].mechanism)
    u = positions(robot, 5)
    q, qd = robot.coordinates(u), np.ones((5, 2))
    expected = robot.inverse_dynamics(q, qd, qd, method="recursion")
    for _ in range(2):  # the first call makes the short way
        for given in (q, u, q.tolist()):
            assert relative_error(robot.inverse_dynamics(given, qd, qd), expected) < 1e-13
        assert relative_error(robot.inverse_dynamics(q[0], qd[0], qd[0]), expected[0]) < 1e-13
        out = np.empty((5, 2))
        assert robot.inverse_dynamics(q, qd, qd, out=out) is out
        assert relative_error(out, expected) < 1e-13
    refusal(lambda: robot.inverse_dynamics(np.array([3.6, -0.4]), qd[0], qd[0]), "cannot be closed at q")
    with expect_refusal("q has shape …; or all 4 of the tree: left_shoulder, left_elbow, "):
        robot.inverse_dynamics(np.ones(3), qd[0], qd[0])


def test_coordinates_that_are_given_decide_on_the_branch(closed):
    robot = closed["fivebar"]
    q = robot.coordinates(np.array([2.2, 0.9]))
    left, right = np.array([np.cos(q[0]), np.sin(q[0])]), np.array([np.cos(q[2]), np.sin(q[2])])
    across = np.array([0.12, 0]) + 0.12 * (right - left)
    turns = 2 * (np.arctan2(across[1], across[0]) - np.array([q[0] + q[1], q[2] + q[3] - np.pi])) + [0, -2 * np.pi]
    other = q + np.array([0, turns[0], 0, turns[1]])  # the pin on the other side of the line between the elbows
    found = robot.coordinates(other)
    assert np.abs(loop_assembly.loop_gaps(robot.mechanism, found[None])[0]).max() < 1e-14
    assert np.abs(found - other).max() < 1e-9
    assert np.abs(np.sin((found - q) / 2)).max() > 0.1
