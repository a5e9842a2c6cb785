"""Reports, views and drawings of robots with joints of several screws."""

import numpy as np
import pytest

from jounce._report.drawing import from_single_screws, parts_of, to_single_screws
from jounce._report.scene import record_track, rest_state
from jounce.checks.compare import compare
from jounce.checks.description import describe
from jounce.figures.drawing import skeleton
from jounce.model import positions
from jounce.spatial.lie import exp
from support.leg_and_cart import leg_and_cart, swinging
from support.pages import decoded, parsed, words

ROBOT = leg_and_cart()
M = ROBOT.mechanism
# turns of a quarter about y, where turns about x and z are alike
LOCKED = np.array([0.1, 0.5, 0.5, 0.5, 0.5, 0.2, 1, 2, 0.6, 0.8, 1, 2, 3, 0, 0.5**0.5, 0, 0.5**0.5])
STATES = np.random.default_rng(0).normal(size=(5, ROBOT.nq))


@pytest.mark.parametrize("q", [*STATES, LOCKED, positions.rest(M)])
def test_joints_of_several_screws_are_joints_of_one_screw_in_turn(q):
    s, C = to_single_screws(M, q), []
    for i, p in enumerate(M.parent):
        H = M.B[i] if p < 0 else C[p] @ M.B[i]
        for j in M.columns[i]:
            H = H @ exp(M.X[j], s[j, None, None])
        C.append(H)
    np.testing.assert_allclose(C, ROBOT.poses(q), atol=1e-14)
    np.testing.assert_allclose(ROBOT.poses(from_single_screws(M, s)), ROBOT.poses(q), atol=1e-14)


def test_the_page_draws_poses_and_shows_what_limits_bound():
    motion = swinging()
    page, data = parsed(ROBOT.with_limits(upper={"ankle.swing": 0.5}, velocity=1.0).report(motion))
    t = decoded(data["frames"]["t"])
    s = decoded(data["robot"]["q"]).reshape(len(t), M.n)
    np.testing.assert_allclose(s, to_single_screws(M, motion(t)[0]), atol=1e-15)
    said = words(page, "//section[@id='robot_data-panel']")
    assert "joint ankle is a ball joint, so there are no sliders; its q are shown as swing, angle, twist" in said
    assert not page.xpath("//section[@id='sliders-panel']")
    assert "ankle.swing" in words(page, "//section[@id='limits-panel']")


def test_a_ball_is_a_sphere_and_what_is_loose_has_no_link():
    size = skeleton(M, np.asarray(ROBOT.poses(positions.rest(M)))).size
    parts = parts_of(M, size)
    cart = list(M.bodies).index("cart")
    assert [part.body for part in parts].count(cart) == 1  # to its centre of mass
    far = [np.linalg.norm(part.vertices, axis=1) for part in parts if part.body == list(M.bodies).index("foot")]
    assert any(np.ptp(radii) < 1e-12 for radii in far)


def test_a_view_starts_at_rest_and_follows_a_motion():
    still = rest_state(ROBOT, positions.start(ROBOT.mechanism), np.eye(4))
    np.testing.assert_allclose(still.Q, ROBOT.gravity_forces(positions.rest(M)))
    assert record_track(ROBOT, swinging()).positions.values.shape[1] == ROBOT.nq


@pytest.mark.parametrize("base", [False, True])
def test_comparison_and_description_know_joints_of_several_screws(base):
    robot = leg_and_cart(base)
    assert all(check.passed for check in compare(robot, states=3, order=1))
    rows = describe(robot.mechanism).json()["bodies"]
    assert [row["type"] for row in rows[:3]] == ["revolute", "ball", "revolute"]
    assert sum(row["mass"] or 0 for row in rows) == pytest.approx(7)
    assert {joint.name for joint in positions.multiscrew_joints(robot.mechanism).values()} == {"ankle", "deck", "box"}


def test_a_notebook_shows_it():
    assert "swing -0.5 .. 0.5 rad" in ROBOT.with_limits(upper={"ankle.swing": 0.5})._repr_html_()
