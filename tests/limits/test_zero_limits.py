"""Limits of 0: `retime` and `guard` refuse by name a joint that they stop, whichever side is 0, and no other.

`slowdown` takes those of 0 on both sides as `check` does: they are undecided, and bound no speed.
"""

import numpy as np
import pytest

import jounce
from limits.test_slowdown import planar2r_with_drives
from support.refusals import expect_refusal, refusal

WAY = np.array([[0, 0, 3, -2], [0, 0, 1.5, -1]])  # from rest to rest, both joints forwards


def limited(kind, joint, bound):
    others = {name: 2.0 for name in ("joint1", "joint2") if name != joint}
    return jounce.load("planar2r").with_limits(**{"velocity": 5.0, "acceleration": 9.0, kind: others | {joint: bound}})


@pytest.mark.parametrize("method", ["retime", "guard"])
@pytest.mark.parametrize("joint", ["joint1", "joint2"])
@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize(("kind", "bound", "stops"), [
    ("velocity", 0.0, (1, -1)),
    ("velocity", (0.0, 2.0), (-1,)),
    ("velocity", (-2.0, 0.0), (1,)),
    ("acceleration", 0.0, (1, -1)),
    ("acceleration", (0.0, 2.0), (1, -1)),
    ("jerk", 0.0, (1, -1)),
])  # fmt: skip
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


@pytest.mark.parametrize("rate", [None, 250.0])
@pytest.mark.parametrize("friction", [0.0, 2.0])
@pytest.mark.parametrize("kind", ["position", "velocity", "acceleration", "effort"])
def test_a_limit_of_0_that_is_undecided_bounds_no_speed(kind, friction, rate):
    """As if it were not stated, whatever the other limits are: they are broken, and decide."""
    arm = planar2r_with_drives(friction=[friction, friction]) if friction else jounce.load("planar2r")
    arm = arm.with_limits(velocity=[1.0, np.inf], acceleration=[np.inf, 3.0])
    zero = {"position": {"lower": {"joint2": 0.0}, "upper": {"joint2": 0.0}}}.get(kind, {kind: {"joint2": 0.0}})
    other = {"acceleration": {"joint2": np.inf}} if kind == "acceleration" else {}
    motion = jounce.Motion.polynomial(WAY, 1.0)
    expected = arm.with_limits(**other).slowdown(motion, rate=rate)
    slow = arm.with_limits(**zero).slowdown(motion, rate=rate)
    assert (slow.factor, slow.binding, slow.verdict) == (expected.factor, expected.binding, "broken")
    assert slow.factor < 1
    after = arm.with_limits(**zero).check(slow.motion, rate=rate)
    assert {row.joint for row in after.table if row.verdict == "undecided"} == {"joint2"}
    assert after.verdict == "undecided"
    assert any(f"undecided: {kind} of joint2: the limit is 0" in note for note in slow.notes)


@pytest.mark.parametrize("bound", [(0.0, 2.0), (-2.0, 0.0)])
def test_a_limit_of_0_on_one_side_is_decided(bound):
    arm = jounce.load("planar2r").with_limits(velocity={"joint1": 1.0, "joint2": bound})
    way = WAY * np.sign(sum(bound))
    assert arm.slowdown(jounce.Motion.polynomial(way, 1.0)).factor < 1
    with expect_refusal("'joint2' moves at t = ", "its limit of velocity is 0"):
        arm.slowdown(jounce.Motion.polynomial(-way, 1.0))
