"""Ratios to bounds: 1 at a bound, on either side, from 0 or from the middle of a range; and the room for rounding."""

import numpy as np
import pytest

import jounce
from jounce.limits.ratios import SIGNS, build_scale

INF = np.inf


@pytest.mark.parametrize(
    ("kind", "lower", "upper", "value", "above", "below"),
    [  # of the value to the upper bound, and to the lower one
        ("velocity", -2, 4, 1, 0.25, -0.5),  # from 0, where it lies between the bounds
        ("velocity", -1, 0.5, 0.25, 0.5, -0.25),
        ("velocity", -0.5, 1, 0.25, 0.25, -0.5),
        ("velocity", 0, 2, 1.5, 0.75, 0),  # or on one of them
        ("velocity", 0, 2, -0.1, -0.05, INF),
        ("velocity", -2, 0, -1.5, 0, 0.75),
        ("velocity", -INF, 2, 3, 1.5, -INF),
        ("velocity", -2, INF, -3, -INF, 1.5),
        ("velocity", 0.5, 3, 3, 1, -1),  # else from the middle
        ("velocity", -3, -0.5, -3, -1, 1),
        ("velocity", 1, INF, 0.5, -INF, 1.5),  # or from 1 beside the only bound
        ("position", 1, 3, 2.5, 0.5, -0.5),  # positions always
        ("position", -1, 3, 2, 0.5, -0.5),
        ("position", -INF, 3, 2.5, 0.5, -INF),
        ("position", -3, INF, -2.5, -INF, 0.5),
        ("position", -INF, INF, 9, -INF, -INF),
    ],
)
def test_ratios_to_both_bounds(kind, lower, upper, value, above, below):
    """Alone, beside a joint with other bounds, and of one joint of two."""
    alone, two = (build_scale(np.array(x, dtype=float), kind) for x in ([[lower], [upper]], [[lower, -1], [upper, 1]]))
    for sign, expected in zip(SIGNS, (above, below), strict=True):
        values = (
            alone.ratio(np.array([value]), sign)[0],
            two.ratio(np.array([value, 0.5]), sign)[0],
            two.ratio(np.array([value]), sign, slice(0, 1))[0],
        )
        assert values == pytest.approx([expected] * 3, abs=1e-15)
    assert alone.largest(np.array([value])) == pytest.approx([max(above, below)])


@pytest.mark.parametrize(("bound", "room"), [(1.0, 1e-9), (0.01, 1e-11), (0.0, 1e-12)])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("share", "verdict"), [(0.6, "kept"), (1.6, "broken")])
def test_room_for_rounding(bound, room, side, share, verdict):
    """A billionth of the limit, and 1e-12 of SI units where that is 0: at a constant velocity, less of it is kept."""
    limit = (-2.0, bound) if side > 0 else (-bound, 2.0)
    arm = jounce.load("planar2r").with_limits(velocity={"joint1": limit})
    found = arm.check(jounce.Motion.polynomial([[0, side * (bound + share * room)], [0, 0]], 1.0))
    assert found.verdict == verdict
    assert (found.worst.ratio > 1 + 0.7e-9) == (verdict == "broken")


def test_room_beside_0_ends_for_ratios_where_it_ends_for_spans():
    """The last value that is no violation has the ratio 0, and the next double an infinite one."""
    scale = build_scale(np.array([[-1.0], [0.0]]), "velocity")
    last = scale.tolerant(1)
    assert scale.ratio(last, 1) == 0
    assert scale.ratio(np.nextafter(last, 1), 1) == INF
