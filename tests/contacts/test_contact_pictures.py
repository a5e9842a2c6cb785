"""Soles and forces of contacts in pages: the report and the live view show what the library computes."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import jounce
from contacts.test_contact_ratios import cart, sliding
from jounce._report.view import scene, viewer
from jounce._report.view.track import record_track
from jounce.engine.balance_points import FORCE_ENDS, SOLE_EDGE, contact_lines_along
from support.pages import decoded, parsed

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="module")
def stand():
    return cart(friction=2.0)


@pytest.fixture(scope="module")
def motion():
    return sliding(0.1, 31)


@pytest.fixture(scope="module")
def report(stand, motion):
    return stand.report(motion, 0)


def lines_at(stand, motion, t):
    return contact_lines_along(stand, motion, t)[:, 0]


def test_the_data_of_the_page_are_lines_at_the_times_of_the_cursor(report, stand, motion):
    _, data = parsed(report)
    contacts, t = data["robot"]["contacts"], decoded(data["frames"]["t"])
    found = decoded(contacts["lines"]).reshape(-1, 9, 3)
    np.testing.assert_allclose(found, lines_at(stand, motion, t), rtol=1e-6, atol=1e-6)
    low = data["robot"]["space"][2][0]
    assert low < -contacts["longest"] + 1e-6  # the longest arrow, below the sole, is seen
    assert contacts["names"] == ["box"]


def test_pages_of_robots_without_contacts_have_none(stand, motion):
    page, data = parsed(stand.contacts([]).report(motion, 0))
    assert data["robot"]["contacts"]["names"] == []
    assert page.xpath("//*[@id='contact-forces']") == []


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium or google-chrome in the path")
def test_the_page_draws_soles_and_forces(report, stand, motion, tmp_path):
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    report.save(tmp_path / "page.html")
    wrong = []
    with api.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.goto((tmp_path / "page.html").as_uri(), timeout=60_000)
        page.evaluate("moveTo(20)")
        shown = page.evaluate("(({x, y, z}) => [[...x], [...y], [...z]])(drawing.data.at(-1))")
        curve = page.evaluate("[...document.getElementById('contact-forces').data[0].y]")
        t, longest = page.evaluate("[times[20], robot.contacts.longest]")
        browser.close()
    assert wrong == []
    [expected] = lines_at(stand, motion, np.array([t]))
    start, stop = expected[FORCE_ENDS]
    points = np.array(shown, dtype=float).T
    np.testing.assert_allclose(points[SOLE_EDGE], expected[SOLE_EDGE], atol=1e-6)
    np.testing.assert_allclose(points[FORCE_ENDS][0], start, atol=1e-6)
    np.testing.assert_allclose(points[FORCE_ENDS][1], start - longest * (stop - start) / max(curve), atol=1e-5)
    assert curve[20] == pytest.approx(np.linalg.norm(stop - start), rel=1e-6)


def test_the_view_draws_soles_and_forces(stand, motion):
    pytest.importorskip("viser")
    with viewer.serve_robot(stand, Path("cart"), record_track(stand, motion), 0) as served:
        served.time.value = 0.4
        served.move()
        [expected] = lines_at(stand, motion, served.along.at(served.time.value).t[None])
        start, stop = expected[FORCE_ENDS]
        scale = scene.ARROW_LENGTH * served.scene.size / served.scene.largest["force"]
        np.testing.assert_allclose(
            served.scene.arrows["contact 0"].points, [[start - scale * (stop - start), start]], atol=1e-5
        )
        edge = expected[SOLE_EDGE]
        soles = served.scene.arrows["soles"].points
        np.testing.assert_allclose(soles, np.stack([edge[:-1], edge[1:]], axis=1), atol=1e-6)


def test_what_contacts_cannot_hold_at_rest_is_said_in_the_view(stand):
    pytest.importorskip("viser")
    narrow = stand.contacts([jounce.Contact("box", "plane", sole=(0.1, 0.1))])
    with viewer.serve_robot(narrow, Path("cart"), None, 0) as served:
        served.joints[0].value = served.joints[0].max  # the slider, far beside the sole
        served.rest()
        assert "no contact wrenches within friction and soles balance the motion" in served.table.content
