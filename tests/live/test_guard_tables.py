"""The tables of a guard, held against the definition of what they hold."""

import numpy as np
import pytest

import jounce
from jounce.live import guard_tables
from jounce.live.guard_tables import _STOP_SPEEDS, LAW_RATES, _find_stop_speeds, build_tables


@pytest.mark.parametrize("k", LAW_RATES)
def test_speeds_of_stops_are_the_largest_possible(k):
    """Against a search speed by speed and node by node."""
    rng = np.random.default_rng(0)
    s = np.sort(np.concatenate([rng.uniform(0, 1, 50), [0.3, 0.3]]))
    size, slack = rng.uniform(0, 1, (52, 3, 7)) ** 8, rng.uniform(-0.01, 1, (52, 3)) ** 3
    own = []
    for i in range(len(s)):
        kept = [v for v in _STOP_SPEEDS if (size[i] @ [0, v, v**2, k * v, v**3, k * v**2, k**2 * v] <= slack[i]).all()]
        own.append(max(kept, default=0.0))
    after = np.append(s[1:], s[-1]) + 2 * _STOP_SPEEDS[0] / k
    expected = [min(own[i : max(i + 1, int((s <= after[i]).sum()))]) for i in range(len(s))]
    assert len({*own}) > 10
    np.testing.assert_array_equal(_find_stop_speeds(k, s, size, slack), expected)


def test_blocks_of_nodes_make_the_same_tables(monkeypatch):
    robot = jounce.load("planar2r").with_limits(velocity=2, acceleration=20, effort=[90, 30])
    motion = jounce.Motion.trapezoidal([[0, 0], [1, 0.5]], 1.0, 5.0)
    whole = build_tables(robot, motion)
    monkeypatch.setattr(guard_tables, "_NODES_PER_BLOCK", 7)
    parts = build_tables(robot, motion)
    for name in ("s", "factors", "product", "first", "lower", "upper", "joints", "stop_speed"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-12, atol=1e-12)
