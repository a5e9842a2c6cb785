"""Reports of robots with closed loops: all joints move, cut joints are joined, sliders of the page close the loops."""

import shutil

import numpy as np
import pytest

import jounce
from jounce._report.drawing import drawing
from jounce._report.report_data import list_known, make_report_data
from jounce.dynamics import loop_closure

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="module")
def fivebar_and_motion():
    robot = jounce.load("fivebar")
    return robot, jounce.Motion.polynomial([[2.2, 0.0, 0.3], [0.9, 0.0, 0.2]], 1.0)


@pytest.fixture(scope="module")
def report_data(fivebar_and_motion):
    return make_report_data(*fivebar_and_motion, 1)


def test_all_joints_move_and_cut_joints_are_joined(fivebar_and_motion, report_data):
    robot, motion = fivebar_and_motion
    m = robot.mechanism
    assert report_data.joints == m.tree.coordinates
    poses = jounce.Robot(m.tree).poses(report_data.positions)
    [loop] = m.loops
    a, b = (poses[:, frame.body] @ frame.T[:, 3] for frame in (loop.a, loop.b))
    np.testing.assert_allclose(a, b, atol=1e-12)
    Q = report_data.quantities["effort"]
    assert list_known(Q) == list(m.closure.actuated)
    np.testing.assert_allclose(
        Q.values[:, list_known(Q)], robot.forces_along(motion, report_data.t, 1).forces[0], rtol=1e-12
    )
    worst = np.linalg.norm(robot.loop_wrenches(*motion(report_data.t)[:3])[..., 3:], axis=-1).max()
    np.testing.assert_allclose(np.linalg.norm(report_data.loop_wrenches[..., 3:], axis=-1).max(), worst, rtol=1e-9)


def test_motors_at_dependent_joints_show_their_forces(fivebar_and_motion):
    other = fivebar_and_motion[0].closed(coordinates=["left_shoulder", "left_elbow"])
    q = fivebar_and_motion[0].coordinates([2.2, 0.9])[[0, 1]]
    s = make_report_data(other, jounce.Motion.polynomial([[q[0], 0.1], [q[1], 0.1]], 0.2), 0)
    Q = s.quantities["effort"]
    rates = [x[s.frames] for x in s.along.rates[:3]]
    np.testing.assert_allclose(Q.values[s.frames][:, list_known(Q)], other.actuator_forces(*rates), rtol=1e-9)
    assert [other.mechanism.tree.coordinates[j] for j in list_known(Q)] == ["left_shoulder", "right_shoulder"]


def test_platforms_have_edges_and_virtual_slides_are_not_drawn():
    robot = jounce.load("delta")
    motion = jounce.Motion.polynomial([[0.6, 0.1]] * 3, 0.1)
    solids = drawing(make_report_data(robot, motion, 0)).solids
    bodies = np.concatenate([np.frombuffer(_bytes(solid.bodies), "i4") for solid in solids])
    names = robot.mechanism.bodies
    assert not set(bodies.tolist()) & {names.index("slide_x"), names.index("slide_y")}
    assert (bodies == names.index("platform")).sum() == 3 * 8 * 12  # an edge is a capsule of 8 circles of 12 corners


def _bytes(packed):
    import base64

    return base64.b64decode(packed["bdata"])


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium or google-chrome in the path")
def test_sliders_close_the_loops_on_the_branch_or_stop(fivebar_and_motion, tmp_path):
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    robot, motion = fivebar_and_motion
    robot.report(motion, 0).save(tmp_path / "fivebar.html")
    with api.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.goto((tmp_path / "fivebar.html").as_uri(), timeout=60_000)
        on = "u => closedOn(panelData('sliders'), stateAt(0).q, u)"
        found, lost = (page.evaluate(f"u => {{ const x = ({on})(u); return [[...x.q], x.arrived]; }}", u)
                       for u in ([2.9, 1.3], [3.6, -0.4]))  # fmt: skip
        q = page.evaluate(
            "u => atRest(new Float64Array(u), [0, 0, 0], panelData('sliders').ends[0], [0, 2]).Q", found[0]
        )
        page.evaluate("() => { const s = all('[data-slider]'); s[0].value = 3.8; s[1].value = -0.6;"
                      " s[0].dispatchEvent(new Event('input')); }")  # fmt: skip
        stuck = page.evaluate("() => !document.getElementById('stuck').hidden && +all('[data-slider]')[0].value < 3.8")
        browser.close()
    near = robot.coordinates(motion(0.0, 0)[0])
    expected = loop_closure.close_loops(robot.mechanism, np.array([[2.9, 1.3]]), near)[0]
    np.testing.assert_allclose(found[0], expected, atol=1e-10)
    still = np.zeros(2)
    np.testing.assert_allclose(list(q), robot.inverse_dynamics(expected, still, still), rtol=1e-9)
    assert (found[1], lost[1], stuck) == (True, False, True)
