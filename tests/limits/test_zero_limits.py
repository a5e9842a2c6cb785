"""Limits of 0: `retime` and `guard` refuse by name a joint that they stop, whichever side is 0, and no other."""

import numpy as np
import pytest

import jounce
from support.files import refusal

WAY = np.array([[0, 0, 3, -2], [0, 0, 1.5, -1]])  # from rest to rest, both joints forwards


def limited(kind, joint, bound):
    others = {name: 2.0 for name in ("joint1", "joint2") if name != joint}
    return jounce.load("planar2r").with_limits(**{"velocity": 5.0, "acceleration": 9.0, kind: others | {joint: bound}})


@pytest.mark.parametrize("method", ["retime", "guard"])
@pytest.mark.parametrize("joint", ["joint1", "joint2"])
@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize(
    ("kind", "bound", "stops"),
    [
        ("velocity", 0.0, (1, -1)),
        ("velocity", (0.0, 2.0), (-1,)),
        ("velocity", (-2.0, 0.0), (1,)),
        ("acceleration", 0.0, (1, -1)),
        ("acceleration", (0.0, 2.0), (1, -1)),
        ("jerk", 0.0, (1, -1)),
    ],
)
def test_a_joint_that_a_limit_of_0_stops_is_named(method, joint, way, kind, bound, stops):
    robot, motion = limited(kind, joint, bound), jounce.Motion.polynomial(way * WAY, 1.0)
    if way in stops:
        if kind == "jerk":
            motion = jounce.Motion.polynomial(way * np.array([[0, 0, 0, 0, 35, -84, 70, -20]] * 2), 1.0)
        refusal(lambda: getattr(robot, method)(motion), f"{kind} limit of joint {joint!r} is 0", "the joint moves")
    else:
        found = getattr(robot, method)(motion)
        assert found is not None


@pytest.mark.parametrize("method", ["retime", "guard"])
def test_a_joint_that_rests_may_have_a_limit_of_0(method):
    robot = limited("velocity", "joint2", 0.0)
    assert getattr(robot, method)(jounce.Motion.polynomial(WAY * np.array([[1], [0]]), 1.0)) is not None
