"""Blended motions: C^4 or C^6 wherever one looks, within the distance that they state, or refused in a line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jounce
from jounce import Motion
from support.refusals import refusal

ROBOT = jounce.load("planar2r")
CORNERS = [[0.0, 0.0], [1.0, -0.5], [0.4, 0.7], [0.4, 1.5]]
POINTS = {
    "joint_names": ["joint1", "joint2"],
    "points": [{"positions": q, "time_from_start": float(i)} for i, q in enumerate(CORNERS)],
}
MOTIONS = {
    "trapezoids": Motion.trapezoidal(CORNERS, 1.0, 4.0),
    "straight lines": Motion.from_joint_trajectory(POINTS),
    "slower": Motion.from_joint_trajectory(POINTS).scaled(2.0),
    "analytic, in a row": Motion.fourier([0, 0], [[1, 2]], [[0, 0.5]], 1.5, 1.0)
    + Motion.polynomial([[np.cos(1.5)], [2 * np.cos(1.5) + 0.5 * np.sin(1.5)]], 1.0),
}


def one_sided(motion, t, order):
    return (np.array(motion(t, order, side)) for side in ("left", "right"))


@pytest.mark.parametrize("continuity", [4, 6])
@pytest.mark.parametrize("motion", MOTIONS.values(), ids=MOTIONS)
def test_no_derivative_jumps_any_more_and_the_path_is_near(motion, continuity):
    time = 0.1
    smooth = motion.blended(time, continuity)
    assert motion.breaks
    assert smooth.breaks == smooth.breaks_to(continuity) == ()
    ends = np.array([found.t + s * time / 2 for found in motion.breaks_to(continuity) for s in (-1, 1)])
    before, after = one_sided(smooth, ends, continuity)
    for k, (a, b) in enumerate(zip(before, after, strict=True)):
        assert np.abs(a - b).max() <= 1e-9 * max(np.abs(smooth(motion.times, k)[k]).max(), np.abs(b).max(), 1), k
    t = np.linspace(motion.start, motion.stop, 40_001)
    moved = np.abs(smooth(t, 0)[0] - motion(t, 0)[0]).max(axis=0)
    assert (moved <= smooth.residual + 1e-15).all()
    assert (moved > 0.9 * smooth.residual).all()
    away = np.abs(t[:, None] - [found.t for found in motion.breaks]).min(axis=1) > time / 2 + 1e-9
    np.testing.assert_array_equal(smooth(t[away])[4], motion(t[away])[4])
    assert {found.order for found in smooth.breaks_to(continuity + 1)} == {continuity + 1}


@given(st.floats(0.01, 0.3))
def test_rates_of_a_blend_are_derivatives(time):
    smooth = MOTIONS["straight lines"].blended(time)
    t = 1.0 + time * np.array([-0.3, -0.1, 0.13, 0.4])
    h = 1e-3 * time
    for k, rate in enumerate(smooth(t)[1:]):
        around = {j: smooth(t + j * h, k)[k] for j in (-2, -1, 1, 2)}
        found = (8 * (around[1] - around[-1]) - (around[2] - around[-2])) / (12 * h)
        assert np.abs(found - rate).max() < 1e-6 * np.abs(rate).max()


def test_forces_along_a_blend_have_no_break():
    motion = MOTIONS["trapezoids"]
    assert {found.order for found in ROBOT.forces_along(motion).breaks} == {0}
    assert ROBOT.forces_along(motion.blended(0.05)).breaks == ()


def test_each_joint_is_blended_at_its_own_breaks():
    """The breaks of two joints may be nearer to each other than the blend is long."""
    c = np.zeros((3, 3, 2))
    c[1] = [[1, 0], [1, 1], [0, 1]]
    c[2] = [[0, 0], [0.5, 0], [0.51, 0.01]]
    motion = Motion.piecewise([0, 0.5, 0.51, 1], c)
    assert motion.blended(0.2).breaks == ()


def test_a_smooth_motion_is_left_as_it_is():
    motion = Motion.polynomial([[0, 1, 2]], 1.0)
    with pytest.warns(jounce.JounceWarning, match="no derivative up to q4d jumps .* leave it out"):
        smooth = motion.blended(0.1)
    assert not smooth.residual.any()
    assert np.array_equal(smooth([0.3])[2], motion([0.3])[2])


LINES = MOTIONS["straight lines"]
REFUSED = {
    "longer than a gap": (lambda: LINES.blended(1.5),
        ["does not fit between the breaks at t = 1 and 2 s, of joint 'joint1'", "blended(time=...) of at most 1 s"]),
    "beyond the end": (lambda: Motion.piecewise([0, 1, 1.01], [[[1], [2]], [[0], [1]]]).blended(0.05),
        ["between the break at t = 1 s and the end of the motion, of joint 0", "at most 0.02 s"]),
    "no time": (lambda: LINES.blended(0), ["time is 0; expected a number of seconds > 0"]),
    "continuity": (lambda: LINES.blended(0.1, 9), ["continuity is 9; expected 2 to 6"]),
}  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED.values(), ids=REFUSED)
def test_refuses(call, words):
    refusal(call, *words)
