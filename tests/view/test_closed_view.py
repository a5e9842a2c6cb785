"""The live view of robots with closed loops."""

import numpy as np
import pytest

import jounce
from jounce._report.scene import record_track, rest_state
from jounce.model import positions

ROBOT = jounce.load("fivebar")


def test_all_joints_are_shown_along_a_motion_and_at_rest():
    along = record_track(ROBOT, jounce.Motion.polynomial([[2.2, 0.3], [0.9, 0.2]], 1.0))
    np.testing.assert_allclose(along.positions.values, ROBOT.coordinates(along.q.values), atol=1e-12)
    rest = rest_state(ROBOT, np.array([2.4, 1.0]), np.eye(4), positions.start(ROBOT.mechanism))
    np.testing.assert_allclose(rest.positions, ROBOT.coordinates(rest.q), atol=1e-12)


def test_sliders_stay_where_the_loops_close():
    pytest.importorskip("viser", reason="viser is not installed")
    from pathlib import Path

    from jounce._report.viewer import serve_robot

    with serve_robot(ROBOT, Path("fivebar"), None, 0) as served:
        before = [slider.value for slider in served.joints]
        served.joints[0].value, served.joints[1].value = 3.6, -0.4
        assert "cannot be closed" in served.table.content
        np.testing.assert_allclose(served.positions[[0, 2]], [slider.value for slider in served.joints])
        served.joints[1].value = before[1] + 0.01
        assert "cannot be closed" not in served.table.content
