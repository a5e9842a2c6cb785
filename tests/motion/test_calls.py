"""What one call of a motion takes: what depends on the motion alone is computed once, and results stay those before."""

from collections import Counter
from copy import deepcopy

import numpy as np
import pytest

import jounce
from jounce.motion.composite_curves import Blend, RetimedCurve
from jounce.motion.curves import CURVE_POINTS, Jump, Polynomials
from jounce.motion.time_law import TimeLawCurve


def blended_trapezoid():
    return jounce.Motion.trapezoidal([[0.0, 0.0], [1.0, 0.4], [0.0, 0.0]], 1.0, 4.0).blended(0.1)


def retimed():
    robot = jounce.load("planar2r").with_limits(velocity=1.0, acceleration=4.0, jerk=100.0)
    return robot.retime(blended_trapezoid()).motion


KINDS = {
    "slowed": lambda: blended_trapezoid().scaled(1.5),
    "slowed twice": lambda: blended_trapezoid().scaled(1.5).scaled(1.2),
    "retimed and slowed": lambda: retimed().scaled(1.5),
    "joined and slowed": lambda: (blended_trapezoid().scaled(2) + blended_trapezoid()).scaled(1.5),
}


@pytest.mark.parametrize("kind", KINDS)
def test_no_call_looks_for_breaks_again(monkeypatch, kind):
    motion, asked = KINDS[kind](), Counter()
    for curve in (Blend, RetimedCurve, TimeLawCurve, Polynomials):
        rates = curve.rates

        def counted(self, t, order, left=False, rates=rates):
            asked[type(self)] += 1
            return rates(self, t, order, left)

        monkeypatch.setattr(curve, "rates", counted)
    motion(motion.start + 0.1)
    asked.clear()
    motion(motion.start + 0.2)
    assert asked[Blend] == 1
    assert max(asked.values()) <= 2


@pytest.mark.parametrize("kind", KINDS)
def test_values_at_both_sides_of_breaks_are_those_of_one_call(kind):
    """What is kept does not depend on which order or side was asked first."""
    untouched = KINDS[kind]()
    motion = deepcopy(untouched)
    t = np.union1d(np.linspace(motion.start, motion.stop, CURVE_POINTS), [x.t for x in motion.breaks])
    for order, side in ((4, "left"), (0, "right"), (3, "left"), (4, "right")):
        fresh = deepcopy(untouched)(t, order, side)
        np.testing.assert_array_equal(motion(t, order, side), fresh)


def test_breaks_of_a_blend_lie_outside_of_its_windows():
    """Column 0 is blended at t = 1, column 1 is not; q2d jumps by 2 at t = 2 in both."""
    x, c = np.arange(4.0), np.zeros((3, 3, 2))
    c[1, 0], c[0, 2] = 1.0, 1.0  # q = t, 1 and 1 + (t - 2)^2
    c[2, 1:] = 1.0
    motion = jounce.Motion.piecewise(x, c)
    blend = Blend(motion.curve, (None, None))
    assert blend.jumps(2) == motion.curve.jumps(2)
    assert [(jump.t, jump.column, jump.order) for jump in blend.jumps(2)] == [
        (t, column, order) for t, order in ((1.0, 1), (2.0, 2)) for column in (0, 1)
    ]
    windows = motion.blended(0.5).curve.windows
    outside = windows[0].outside([Jump(0.5, 0, 1, 1.0), Jump(1.1, 0, 1, 1.0), Jump(1.5, 0, 1, 1.0)])
    assert [jump.t for jump in outside] == [0.5, 1.5]
