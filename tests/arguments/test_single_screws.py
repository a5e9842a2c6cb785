"""What takes joints of one screw refuses balls, planar and free joints in one line that names one."""

from dataclasses import replace

import dask.array as da
import numpy as np
import pytest

import jounce.dask
from support.refusals import refusal
from support.several_named import named_robot, states

ROBOT = named_robot()


def sprung_leg():
    """The robot with springs at its toe and at one variable of its ankle."""
    m = ROBOT.mechanism
    stiffness = np.isin(m.joints, ["toe", "ankle.wy"]) * 3.0
    return jounce.Robot(replace(m, drives=replace(m.drives, stiffness=stiffness)))


@pytest.mark.parametrize(("call", "what"), [
    (lambda: ROBOT.elastic({"hip": 100.0}, rotor=0.1), "elastic joints"),
    (lambda: ROBOT.excite(), "excite()"),
    (lambda: sprung_leg().with_drives("spring"), "springs of drives"),
])  # fmt: skip
def test_joints_of_several_screws_are_refused(call, what):
    named = "joint 'ankle' of 'amid' is a ball joint; expected joints of one screw, revolute, prismatic or helical"
    assert refusal(call) == f"{what}: {named}"


def test_what_does_not_touch_them_goes_on():
    assert ROBOT.locked({"lid": 0.3}).n == ROBOT.n - 1
    m = sprung_leg().mechanism
    only = replace(m.drives, stiffness=m.drives.stiffness * np.isin(m.joints, ["toe"]))
    assert jounce.Robot(replace(m, drives=only)).with_drives("spring").mechanism.acting == ("spring",)


def test_dask_takes_the_numbers_of_positions():
    given = states(ROBOT, 3, 6)
    found = jounce.dask.apply(ROBOT, "inverse_dynamics", *(da.from_array(x, chunks=(3, -1)) for x in given))
    np.testing.assert_array_equal(found.compute(), ROBOT.inverse_dynamics(*given))
