"""What `Limits.bounds` returns is taken by `Robot.with_limits`."""

import numpy as np
import pytest

import jounce
from jounce.model.limits import LIMIT_KINDS
from support.refusals import refusal

TAKEN = [kind for kind in LIMIT_KINDS.bound_names if kind in LIMIT_KINDS]


@pytest.mark.parametrize("name", ["panda", "planar2r", "ur5", "solo12"])
def test_bounds_go_round(name):
    robot = jounce.load(name)
    robot = robot.with_limits(**dict.fromkeys(("velocity", "acceleration", "jerk", "effort", "effort_rate"), 3.0))
    for kind in TAKEN:
        if kind not in LIMIT_KINDS.stall_line and kind not in LIMIT_KINDS.motor:
            assert robot.with_limits(**{kind: robot.limits.bounds(kind)}).limits == robot.limits, kind


@pytest.mark.parametrize("order", ["joints", "sides"])
def test_two_joints_have_their_bounds_either_way_round(order):
    by_joint = np.array([[-1.0, 2.0], [-3.0, 4.0]])
    robot = jounce.load("planar2r").with_limits(velocity=by_joint if order == "joints" else by_joint.T)
    assert np.array_equal(robot.limits.bounds("velocity"), by_joint.T)


def test_zero_bounds_of_two_joints_are_the_same_either_way_round():
    bounds = np.array([[-1.0, 0.0], [0.0, 2.0]])
    robot = jounce.load("planar2r").with_limits(velocity=bounds)
    assert np.array_equal(robot.limits.bounds("velocity"), bounds)


def test_bounds_that_fit_neither_way_are_refused():
    refusal(
        lambda: jounce.load("planar2r").with_limits(velocity=[[1.0, 2.0], [1.0, 3.0]]),
        "velocity",
        "lower <= 0 <= upper",
    )


def test_forces_on_one_side_of_zero_are_refused_where_both_ways_fit():
    robot = jounce.load("planar2r")
    refusal(lambda: robot.with_limits(effort=[[1.0, 3.0], [2.0, 4.0]]), "(lower, upper) by rows or by columns")
    one_way = robot.with_limits(effort=[[3.0, 4.0], [1.0, 2.0]])
    assert np.array_equal(one_way.limits.bounds("effort"), [[3, 1], [4, 2]])
