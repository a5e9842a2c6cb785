"""Peaks on polynomials that are given: each is found once, unless the tangents around it meet below a floor."""

import numpy as np
import pytest

import jounce
from jounce.limits.limited_motion import validate_limits
from jounce.limits.motion_polynomials import Pieces
from jounce.limits.worst_values import find_peaks

H = 1 / 16  # of a piece, between samples of its polynomial


def peaks_of_parabola(at, floor):
    """The peaks above a floor of a velocity -(t - at)^2, one piece from 0 to 1 s."""
    motion = jounce.Motion.polynomial([[0, -(at**2), at, -1 / 3]], 1.0).with_step(1.0)
    b = validate_limits(jounce.load("planar2r").locked({"joint2": 0.0}).with_limits(velocity=[[-np.inf, 1.0]]), motion)
    ends = [{"velocity": np.array([[-((t - at) ** 2)]])} for t in (0.0, 1.0)]
    polynomial = {"velocity": np.array([-1.0, 2 * at, -(at**2)])[:, None, None]}
    pieces = Pieces(np.array([0.0]), np.array([1.0]), *ends, polynomial, {})
    found = find_peaks(b, pieces, lambda pieces, kind, sign: np.array([[floor if sign > 0 else np.inf]]))
    return found.t.tolist()


def test_a_peak_at_a_sample_is_found_once():
    assert peaks_of_parabola(8 * H, -1.0) == pytest.approx([0.5])


@pytest.mark.parametrize("shift", [0.1, 0.9])
@pytest.mark.parametrize(("floor", "count"), [(0.98, 1), (1.0, 0)])
def test_tangents_that_meet_below_the_floor_have_no_peak_above(shift, floor, count):
    """Of a peak a tenth of an interval from a sample, the other sample's tangent rises by 0.99 of its square."""
    assert len(peaks_of_parabola((7 + shift) * H, floor * H**2)) == count
