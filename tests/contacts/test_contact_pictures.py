"""Soles and forces of contacts in pages: the report and the live view show what the library computes."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import jounce
from contacts.conftest import FEET, PAWS, SOLE, squat
from contacts.test_contact_ratios import cart, sliding
from jounce._report import scene, viewer
from jounce._report.scene import record_track, rest_state
from jounce.engine import balance_points
from jounce.engine.motion_states import MotionStates
from support.pages import decoded, parsed

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="module")
def stand():
    return cart(friction=2.0)


@pytest.fixture(scope="module")
def sliding_motion():
    return sliding(0.1, 31)


@pytest.fixture(scope="module")
def stand_report(stand, sliding_motion):
    return stand.report(sliding_motion, 0)


def lines_at(stand, motion, t):
    return balance_points.contact_lines_along(stand, motion, t)[:, 0]


def test_the_data_of_the_page_are_lines_at_the_times_of_the_cursor(stand_report, stand, sliding_motion):
    _, data = parsed(stand_report)
    contacts, t = data["robot"]["contacts"], decoded(data["frames"]["t"])
    found = decoded(contacts["lines"]).reshape(-1, 9, 3)
    np.testing.assert_allclose(found, lines_at(stand, sliding_motion, t), rtol=1e-6, atol=1e-6)
    low = data["robot"]["space"][2][0]
    assert low < -contacts["longest"] + 1e-6  # the longest arrow, below the sole, is seen
    assert contacts["names"] == ["box"]
    points = decoded(data["robot"]["zmp"]).reshape(-1, 3)
    np.testing.assert_allclose(points, balance_points.zmp_along(stand, sliding_motion, t), atol=1e-6)
    np.testing.assert_allclose(points, found[:, balance_points.FORCE_ENDS.start], atol=1e-6)  # of one contact


def test_zero_moment_points_lie_at_the_mean_height(humanoid):
    t = np.linspace(0, 0.6, 19)
    q = squat(humanoid, t, 0)[0]
    q[:, humanoid.joint_names.index("waist_roll_joint")] = 0.3 * np.sin(5 * t)
    C = np.linalg.inv(humanoid.poses(q, body=FEET[0], base=np.eye(4), method="recursion"))
    path = jounce.Motion.through(t, q, joint_names=humanoid.joint_names).with_base(t, C, degree=7)
    feet = [jounce.Contact(foot, "plane", place=(0, 0, SOLE["place"][2] - k)) for k, foot in enumerate(FEET)]
    height = SOLE["place"][2]  # the feet are level; the second contact is 1 m lower
    for stances, lower in [([(0, FEET)], 0.5), ([(0, FEET[:1])], 0), ([(0, FEET[1:])], 1)]:
        found = balance_points.zmp_along(humanoid.contacts(feet), path.with_stances(stances), t[3:9])
        expected = humanoid.zmp(*path(t[3:9], 2), base=path.base(t[3:9], 2), height=height - lower)
        np.testing.assert_allclose(found[:, :2], expected, atol=1e-10)
        np.testing.assert_allclose(found[:, 2], height - lower, atol=1e-6)


def test_no_zero_moment_point_in_flight_and_with_tilted_gravity(dog):
    t = np.arange(12) / 12
    still = np.tile([0.0, 0.7, -1.4], (12, 4))
    stand = dog.contacts([jounce.Contact(paw, "point") for paw in PAWS])
    path = jounce.Motion.through(t, still, joint_names=dog.joint_names).with_base(None, np.eye(4))
    lifted = path.with_stances([(0, PAWS), (0.5, [])])
    np.testing.assert_array_equal(np.isnan(balance_points.zmp_along(stand, lifted, t)), np.tile(t[:, None] >= 0.5, 3))
    tilted = jounce.Robot(replace(stand.mechanism, gravity=np.array([1, 0, -9.8])))
    assert all(np.isnan(balance_points.zmp_along(robot, path, t)).all() for robot in (dog, tilted))
    for share, none in [(0.5e-6, True), (2e-6, False)]:  # of the weight that the ground carries
        fall = (np.eye(4), np.zeros(6), np.array([0, 0, 0, 0, 0, (1 - share) * dog.gravity[2]]))
        states = MotionStates((still[0], 0 * still[0], 0 * still[0]), None, fall, None)
        assert np.isnan(balance_points.zmp_points(stand, states)).all() == none


def test_pages_of_robots_without_contacts_have_none(stand, sliding_motion):
    page, data = parsed(stand.contacts([]).report(sliding_motion, 0))
    assert data["robot"]["contacts"]["names"] == []
    assert page.xpath("//*[@id='contact-forces']") == []


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium or google-chrome in the path")
def test_the_page_draws_soles_and_forces(stand_report, stand, sliding_motion, tmp_path):
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    stand_report.save(tmp_path / "page.html")
    wrong = []
    with api.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto((tmp_path / "page.html").as_uri(), timeout=60_000)
        page.evaluate("moveTo(20)")
        shown = page.evaluate("(({x, y, z}) => [[...x], [...y], [...z]])(drawing.data.at(-1))")
        curve = page.evaluate("[...document.getElementById('contact-forces').data[0].y]")
        ball = page.evaluate("(({x, y, z}) => [x[0], y[0], z[0]])(drawing.data.at(-2))")
        t, longest = page.evaluate("[times[20], robot.contacts.longest]")
        browser.close()
    assert wrong == []
    [expected] = lines_at(stand, sliding_motion, np.array([t]))
    start, stop = expected[balance_points.FORCE_ENDS]
    np.testing.assert_allclose(ball, start, atol=1e-6)
    points = np.array(shown, dtype=float).T
    np.testing.assert_allclose(points[balance_points.SOLE_EDGE], expected[balance_points.SOLE_EDGE], atol=1e-6)
    np.testing.assert_allclose(points[balance_points.FORCE_ENDS][0], start, atol=1e-6)
    np.testing.assert_allclose(
        points[balance_points.FORCE_ENDS][1], start - longest * (stop - start) / max(curve), atol=1e-5
    )
    assert curve[20] == pytest.approx(np.linalg.norm(stop - start), rel=1e-6)


def test_the_view_draws_soles_and_forces(stand, sliding_motion):
    pytest.importorskip("viser")
    with viewer.serve_robot(stand, Path("cart"), record_track(stand, sliding_motion), 0) as served:
        served.time.value = 0.4
        served.move()
        [expected] = lines_at(stand, sliding_motion, np.array([served.along.at(served.time.value).t]))
        start, stop = expected[balance_points.FORCE_ENDS]
        scale = scene.ARROW_LENGTH * served.scene.size / served.scene.largest["force"]
        np.testing.assert_allclose(
            served.scene.arrows["contact 0"].points, [[start - scale * (stop - start), start]], atol=1e-5
        )
        ball = served.scene.zmp
        np.testing.assert_allclose(ball.position, start, atol=1e-6)
        assert ball.radius > 0
        scene.show(served.scene, replace(served.along.at(0.4), zmp=np.full(3, np.nan)))
        assert ball.radius == 0
        edge = expected[balance_points.SOLE_EDGE]
        soles = served.scene.soles.points
        np.testing.assert_allclose(soles, np.stack([edge[:-1], edge[1:]], axis=1), atol=1e-6)


def test_at_rest_the_point_is_below_the_centre_of_mass(stand):
    C = np.eye(4)
    C[:3, 3] = 0.3, 0.2, 0.1
    c = stand.center_of_mass([0.05], base=C)
    np.testing.assert_allclose(rest_state(stand, np.array([0.05]), C).zmp, [*c[:2], 0.1], atol=1e-12)


def test_what_contacts_cannot_hold_at_rest_is_said_in_the_view(stand):
    pytest.importorskip("viser")
    narrow = stand.contacts([jounce.Contact("box", "plane", sole=(0.1, 0.1))])
    with viewer.serve_robot(narrow, Path("cart"), None, 0) as served:
        served.joints[0].value = served.joints[0].max  # the slider, far beside the sole
        served.rest()
        assert "no contact wrenches within friction and soles balance the motion" in served.table.content
