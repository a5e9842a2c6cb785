"""Reports of measured motions: ends that are uncertain, measured torques, what is not judged; and bases that move."""

import shutil

import numpy as np
import pytest
from lxml import html

import jounce
from jounce._report.drawing import drawing
from jounce._report.report_data import MEASURED_LESS_COMPUTED, list_known, make_report_data
from jounce.io import tables
from jounce.model.limits import LIMIT_KINDS
from support.commands import call
from support.pages import decoded, panel, parsed, words

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FRICTION = 0.7  # N m, between the torques of the log and those of the robot


@pytest.fixture(scope="module")
def limited_robot():
    return jounce.load("planar2r").with_limits(velocity=9.0, effort_rate=900.0)


@pytest.fixture(scope="module")
def noisy_log_and_truth(limited_robot):
    """Noisy samples, whose q4d is wild at its ends, with torques of the first joint, and their truth."""
    random, t = np.random.default_rng(3), np.arange(0, 4, 2e-3)
    w = np.array([3.0, 5.0])
    rates = [w**k * np.sin(w * t[:, None] + k * np.pi / 2) for k in range(3)]
    torques = limited_robot.inverse_dynamics(*rates) + FRICTION * np.sign(rates[1])
    q = rates[0] + 1e-4 * random.normal(size=(len(t), 2))
    columns = {"t": t, "joint1": q[:, 0], "joint2": q[:, 1], "tau_joint1": torques[:, 0]}
    return columns, lambda s, k: w**k * np.sin(w * s[:, None] + k * np.pi / 2)


def test_axes_are_ruled_by_what_is_known(limited_robot, noisy_log_and_truth):
    columns, truth = noisy_log_and_truth
    motion = jounce.load_motion(columns, limited_robot)
    s = make_report_data(limited_robot, motion, 2)
    _, data = parsed(limited_robot.report(motion))
    layout, ranges = data["rates"]["layout"], list(data["rates"]["ranges"].values())
    grey = [shape for shape in layout["shapes"] if shape["type"] == "rect"]
    for k, kind in enumerate(LIMIT_KINDS.motion):
        quantity = s.quantities[kind]
        [(start, stop)] = quantity.windows
        known = (s.t > start) & (s.t < stop)
        for j in range(2):
            low, high = ranges[k][str(j)]
            assert max(-low, high) < 1.3 * np.abs(truth(s.t, k)[:, j]).max()
            assert low <= quantity.values[known, j].min()
            assert high >= quantity.values[known, j].max()
        mine = [(shape["x0"], shape["x1"]) for shape in grey if shape["yref"] == f"y{k + 1 if k else ''} domain"]
        assert mine == [span for span in ((motion.start, start), (stop, motion.stop)) if span[0] < span[1]]
    q4d = s.quantities["snap"]
    assert np.abs(q4d.values).max() > 1.4 * np.abs(truth(s.t, 4)).max()  # the ends would rule the axes
    [window] = q4d.windows
    assert data["frames"]["windows"][4] == list(window)
    assert 0.5 < (window[1] - window[0]) / motion.duration < 1


def test_a_page_opens_where_values_are_certain(limited_robot, noisy_log_and_truth):
    motion = jounce.load_motion(noisy_log_and_truth[0], limited_robot)
    for robot in (limited_robot, limited_robot.with_limits(None)):
        s = make_report_data(robot, motion, 0)
        t = s.t[s.frames[s.start_frame]]
        assert all(window[0] <= t <= window[1] for x in s.at_frames.values() for window in x.windows)


def test_what_is_exact_has_no_uncertain_ends(limited_robot):
    report = limited_robot.report(jounce.Motion.polynomial([[0, 0.5], [0, 0.5]], 1.0))
    page, data = parsed(report)
    assert set(map(str, data["frames"]["windows"])) == {"None"}
    assert data["curves"]["layout"]["shapes"] == data["rates"]["layout"]["shapes"] == []
    assert "uncertain" not in words(page, panel("values"))


def test_measured_less_computed_torques_are_drawn(limited_robot, noisy_log_and_truth):
    columns, truth = noisy_log_and_truth
    motion = jounce.load_motion(columns, limited_robot)
    s = make_report_data(limited_robot, motion, 0)
    apart, [(start, stop)] = s.quantities[MEASURED_LESS_COMPUTED], s.quantities[MEASURED_LESS_COMPUTED].windows
    assert list_known(apart) == [0]
    moving = np.abs(truth(s.t, 1)[:, 0]) > 1
    inside = moving & (s.t > start) & (s.t < stop)
    np.testing.assert_allclose(apart.values[inside, 0], FRICTION * np.sign(truth(s.t, 1)[inside, 0]), atol=0.05)
    assert not np.isfinite(apart.bounds[0]).any()
    assert s.at_frames[MEASURED_LESS_COMPUTED].deviations is None
    q, off = s.at_frames["position"], motion.deviations(s.t[s.frames], 0)[0]
    np.testing.assert_array_equal(q.times, s.t[s.frames])
    np.testing.assert_allclose(q.deviations[0], off, rtol=1e-12)


def test_a_page_names_its_file_and_what_is_not_judged(limited_robot, noisy_log_and_truth, tmp_path):
    jounce.save(limited_robot, tmp_path / "arm.yaml")
    tables.write(tmp_path / "monday.csv", noisy_log_and_truth[0])
    asked = ["report", tmp_path / "arm.yaml", tmp_path / "monday.csv", "-o", tmp_path / "r.html"]
    result = call(*asked)
    assert result.exit_code == 0, result.output
    page = html.document_fromstring((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert page.xpath("//title")[0].text.endswith("along monday.csv")
    assert words(page, "//h1").endswith("along monday.csv")
    [verdict] = page.xpath("//p[contains(@class, 'verdict')]")
    assert verdict.text_content().strip().startswith("monday.csv: ")
    listed = [item.text_content() for item in page.xpath(panel("limits") + "//li")]
    assert listed[0] == "there are no limits of position, acceleration, jerk, snap, effort, second effort rate"
    [hidden] = [line for line in listed if "are invisible" in line]
    assert hidden.startswith("Resolved up to ")


def floating_motion():
    """A robot that floats, along a motion that turns and shifts its base."""
    robot = jounce.load("solo12", base="floating")
    t = np.linspace(0, 1, 101)
    C = np.tile(np.eye(4), (101, 1, 1))
    c, s = np.cos(0.5 * t), np.sin(0.5 * t)
    C[:, 0, 0], C[:, 0, 1], C[:, 1, 0], C[:, 1, 1], C[:, 0, 3] = c, -s, s, c, 0.4 * t
    return robot, jounce.Motion.polynomial([[0.1, 0.2 + 0.01 * j] for j in range(robot.n)], 1.0).with_base(t, C)


@pytest.mark.parametrize("kind", ["floats", "is carried"])
def test_bases_that_move_are_drawn_where_they_are(kind, tmp_path):
    robot, motion = floating_motion()
    if kind == "is carried":
        robot = jounce.load("planar2r").with_limits(effort=90.0)
        C = motion.base(np.linspace(0, 1, 101), 0)[0]
        motion = jounce.Motion.polynomial([[0, 0.5], [0, 0.5]], 1.0).with_base(np.linspace(0, 1, 101), C)
    s = make_report_data(robot, motion, 1)
    found, t = drawing(s), s.t[s.frames]
    base = decoded(found.base).reshape(-1, 3, 4)
    np.testing.assert_allclose(base, motion.base(t, 0)[0][:, :3], atol=1e-14)
    poses = robot.poses(motion(t, 0)[0], base=motion.base(t, 0)[0])
    low, high = np.array(found.space).T
    assert (poses[..., :3, 3] >= low).all()
    assert (poses[..., :3, 3] <= high).all()
    Q = s.quantities["effort"]
    np.testing.assert_allclose(Q.values, robot.forces_along(motion, s.t, 0).forces[0][:, -robot.n :], atol=1e-9)
    report = robot.report(motion, 1)
    page, _ = parsed(report)
    assert not page.xpath(panel("sliders"))
    assert ("the base floats" in words(page, panel("robot_data"))) == (kind == "floats")
    if CHROMIUM is None:
        pytest.skip("no chromium or google-chrome in the path")
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    report.save(tmp_path / "r.html")
    with api.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.goto((tmp_path / "r.html").as_uri(), timeout=60_000)
        k = len(t) // 2
        shown = page.evaluate(f"pose(stateAt({k}).q, baseAt({k})).map(C => [...C])")
        above = f"points([], {{bodies: [-1], vertices: [0, 0, 1]}}, baseAt({k})).map(x => x[0])"
        ground = page.evaluate(above)
        browser.close()
    np.testing.assert_allclose(np.array(shown).reshape(-1, 3, 4), poses[k, :, :3], atol=1e-12)
    on = np.eye(4) if kind == "floats" else motion.base(t[k], 0)[0]
    np.testing.assert_allclose(ground, on[:3, 2] + on[:3, 3], atol=1e-6)
