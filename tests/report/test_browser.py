"""Reports in Chromium: cursor, player, joints, keyboard, and what axe finds."""

import json
import re
import shutil

import numpy as np
import pytest

import jounce

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium or google-chrome in the path"),
    pytest.mark.outside,
]
WAIT = 60_000  # ms, on machines that draw without a graphics card
NAMES = ("turn", "</script><script>hacked = 1</script>", "<b>screw</b>")


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def subject():
    """A tree with every type of joint, one of which follows another, and a motion that breaks limits."""
    M = jounce.inertia_matrix(1.0, [0.1, 0, 0.2], np.eye(3) / 50)
    B = np.tile(np.eye(4), (5, 1, 1))
    B[1:, :3, 3] = [[0, 0, 0.4], [0.3, 0, 0], [0, 0.2, 0.1], [0, -0.2, 0.1]]
    X = [[0, 0, 1, 0, 0, 0], [0, 0.6, 0.8, 0, 0, 0], [0, 0, 0, 1, 0, 0], [1, 0, 0, 0.05, 0, 0], [0, 1, 0, 0, 0, 0.1]]
    G = [[1, 0, 0], [0.5, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 2]]
    limits = {"velocity": [0.4] * 5, "effort": [5.0] * 5}
    robot = jounce.Robot.from_screws(
        B, X, [M] * 5, [-1, 0, 1, 2, 1], G=G, g=[0.1, 0, 0, 0.2, 0], joint_names=NAMES, limits=limits, name="tree"
    )
    return robot, jounce.Motion.polynomial([[0, 0.5, 0.2, 0], [0.1, -0.1, 0.1, 0], [0, 0, 1.0, -0.5]], 1.5)


@pytest.fixture(scope="module")
def tree_report(subject):
    robot, motion = subject
    return robot.report(motion, 0)


@pytest.fixture(scope="module")
def open_page(browser, tree_report, tmp_path_factory):
    """The report, opened from disk; what it logs and asks for is gathered in `page.wrong`."""
    path = tmp_path_factory.mktemp("report") / "report.html"
    tree_report.save(path)
    page = browser.new_page(viewport={"width": 1000, "height": 500})
    page.set_default_timeout(WAIT)
    page.wrong = []
    page.on("console", lambda message: page.wrong.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: page.wrong.append(str(error)))
    page.on("request", lambda asked: page.wrong.append(asked.url) if not asked.url.startswith(OWN) else None)
    page.goto(path.as_uri())
    wait_until_shown(page)
    return page


OWN = ("file:", "data:", "blob:")


def wait_until_shown(page):
    playwright.expect(page.locator("#clock")).to_contain_text("t =", timeout=WAIT)


def page_clock(page):
    return float(page.locator("#clock").text_content().split()[2])


def cursor(page):
    return int(page.locator("#time").input_value())


def page_data(report, name):
    return json.loads(re.search(rf'id="{name}-data">(.*?)</script>', report.html)[1])


def test_a_page_works_without_errors_or_network(open_page, tree_report, subject):
    _values_under_the_cursor_are_those_of_the_table(open_page, tree_report, subject[0])
    _the_keyboard_moves_cursor_line_and_robot(open_page)
    _the_robot_stands_where_the_library_says(open_page, tree_report, subject[0])
    _play_runs_and_pauses(open_page)
    _joints_are_switched_off_and_on(open_page)
    _zoom_keeps_the_line_at_the_cursor(open_page)
    _sliders_show_what_holds_the_robot_at_rest(open_page, tree_report, subject[0])
    assert open_page.evaluate("window.hacked") is None
    assert open_page.wrong == []


def _values_under_the_cursor_are_those_of_the_table(page, report, robot):
    page.evaluate("all('details').forEach(fold => { fold.open = true; })")
    worst = sorted(report.check.table, key=lambda row: -row.ratio)
    assert not worst[0].ok
    numbers = {"velocity": 1, "effort": 3}  # of q, qd, q2d, Q
    for k, row in enumerate(worst[:3]):
        page.locator("#limits tbody tr").nth(k).get_by_role("button").click()
        assert page_clock(page) == pytest.approx(row.t, abs=6e-5)
        cell = page.locator(f".values td[data-value='{numbers[row.limit]}']").nth(robot.joint_names.index(row.joint))
        value = page.locator("#limits tbody tr").nth(k).locator("td").nth(3).text_content()
        assert float(cell.text_content()) == float(value)
        assert ("beyond" in (cell.get_attribute("class") or "")) == (not row.ok)


def _the_keyboard_moves_cursor_line_and_robot(page):
    page.evaluate("moveTo(10)")
    page.locator("#time").focus()
    before = (
        page.locator(".line").first.bounding_box()["x"],
        page.evaluate("[...document.getElementById('robot').data[0].x]"),
    )
    page.keyboard.press("ArrowRight")
    page.keyboard.press("PageUp")
    assert cursor(page) > 11
    assert page.locator(".line").first.bounding_box()["x"] > before[0]
    assert page.evaluate("[...document.getElementById('robot').data[0].x]") != before[1]


def _the_robot_stands_where_the_library_says(page, report, robot):
    q = np.array([0.3, -0.2, 0.7])
    found = np.array(page.evaluate(f"pose({q.tolist()}).map(C => [...C])")).reshape(-1, 3, 4)
    np.testing.assert_allclose(found, robot.poses(q)[:, :3], atol=1e-14)


def _play_runs_and_pauses(page):
    page.evaluate("moveTo(0)")
    page.locator("#speed").select_option("0.1")
    page.get_by_role("button", name="Play").click()
    page.wait_for_timeout(300)
    page.get_by_role("button", name="Pause").click()
    stopped = cursor(page)
    assert 0 < stopped < int(page.locator("#time").get_attribute("max"))
    page.wait_for_timeout(100)
    assert cursor(page) == stopped


def _joints_are_switched_off_and_on(page):
    drawn = "document.getElementById('curves').data.filter(trace => trace.visible !== false).length"
    every = page.evaluate(drawn)
    box = page.get_by_role("checkbox").first
    box.uncheck()
    assert 0 < page.evaluate(drawn) < every
    box.check()
    assert page.evaluate(drawn) == every


def _zoom_keeps_the_line_at_the_cursor(page):
    page.get_by_role("button", name="Zoom to the cursor").click()
    left, right = page.evaluate("document.getElementById('curves').layout.xaxis.range")
    assert right - left == pytest.approx(0.375)
    page.get_by_role("button", name="Whole motion").click()
    assert page.evaluate("document.getElementById('curves').layout.xaxis.range") == [0, 1.5]


def _sliders_show_what_holds_the_robot_at_rest(page, report, robot):
    q, pull, end = np.array([0.3, -0.2, 0.7]), np.array([3.0, -4.0, 5.0]), {"body": 3, "point": [0.1, 0.2, -0.3]}
    found = page.evaluate(f"atRest(Float64Array.from({q.tolist()}), {pull.tolist()}, {json.dumps(end)})")
    Q, gravity, pulled = (np.array(found[name]) for name in ("Q", "gravity", "pulled"))
    _assert_pull(robot, q, pull, end, Q, gravity, pulled)

    page.get_by_role("button", name="Play").click()
    for inputs, numbers in (("data-slider", q), ("data-pull", pull)):
        for j, x in enumerate(numbers):
            page.locator(f"[{inputs}='{j}']").evaluate(
                f"(e) => {{ e.value = {x}; e.dispatchEvent(new Event('input')); }}"
            )
    page.locator("#end").select_option(label=robot.body_names[2])
    assert page.get_by_role("button", name="Play").is_visible()  # no longer Pause
    rows = [row.locator("td.number").all_text_contents() for row in page.locator("#rest tbody tr").all()]
    shown = np.array([[float(cell.split()[0]) for cell in row] for row in rows]).T
    end = {"body": 2, "point": [0, 0, 0]}
    np.testing.assert_allclose(shown[0], q, rtol=1e-4)
    _assert_pull(robot, q, pull, end, shown[3], shown[1], shown[2], rtol=1e-4)
    beyond = [bool(row.locator("td.beyond").count()) for row in page.locator("#rest tbody tr").all()]
    assert beyond == (np.abs(shown[3]) > 5).tolist()
    assert any(beyond)
    arrow = page.evaluate("(({x, y, z}) => [x, y, z])(document.getElementById('robot').data.at(-1))")
    start, stop = np.array(arrow).T
    np.testing.assert_allclose(start, robot.poses(q)[2, :3, 3], atol=1e-12)
    np.testing.assert_allclose(np.cross(stop - start, pull), 0, atol=1e-12)
    assert (stop - start) @ pull > 0

    page.get_by_role("button", name="Release").click()
    assert page.locator("#pull").text_content() == "(0, 0, 0) N"
    page.evaluate("moveTo(7)")
    moved = [float(slider.input_value()) for slider in page.locator("[data-slider]").all()]
    assert moved == list(page.evaluate("[...stateAt(7).q]"))


def _assert_pull(robot, q, pull, end, Q, gravity, pulled, rtol=1e-12):
    """What the page says is what the library computes for a load on a point of a body."""
    W = np.zeros((5, 6))
    own = robot.poses(q)[end["body"], :3, :3].T @ pull
    W[end["body"]] = -np.concatenate([np.cross(end["point"], own), own])
    rest, G = np.zeros(3), robot.gravity_forces(q)
    expected = robot.inverse_dynamics(q, rest, rest, wrench=W)
    np.testing.assert_allclose(gravity, G, rtol, 1e-12)
    np.testing.assert_allclose(Q, expected, rtol, 1e-12)
    np.testing.assert_allclose(pulled, expected - G, rtol, 1e-12)


@pytest.fixture(scope="module")
def fresh_page(browser, tree_report, tmp_path_factory):
    """A function that opens the report in a window of some size, as a reader first sees it."""
    path, pages = tmp_path_factory.mktemp("fresh") / "report.html", []
    tree_report.save(path)

    def open_in(width, height):
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(WAIT)
        pages.append(page)
        page.goto(path.as_uri())
        wait_until_shown(page)
        return page

    yield open_in
    for page in pages:
        page.close()


OPEN_FOLDS = "all('details').forEach(fold => { fold.open = true; })"
SCREEN, PHONE = (1440, 900), (390, 844)


@pytest.mark.parametrize("size", [SCREEN, PHONE], ids=["screen", "phone"])
def test_the_first_screen_shows_verdict_robot_and_forces(fresh_page, tree_report, size):
    page = fresh_page(*size)
    worst = tree_report.check.worst
    assert page_clock(page) == pytest.approx(worst.t, abs=6e-5)
    player = page.locator(".player").bounding_box()
    assert player["y"] + player["height"] <= size[1]
    shown = [".verdict", "#robot", "#values-table"]
    for part in [*shown, "#curves"] if size == SCREEN else shown:
        box = page.locator(part).bounding_box()
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= player["y"], part
    robot = page.locator("#robot").bounding_box()
    assert robot["width"] * robot["height"] > 0.15 * size[0] * size[1]
    assert page.evaluate(CORNERS_INSIDE)


# Whether the corners of the space leave room for labels; plotly looks from the eye to the centre, by 45 degrees upwards
CORNERS_INSIDE = """(() => {
  const {eye, center} = drawing.layout.scene.camera, {x, y, z} = drawing.layout.scene.aspectratio;
  const to = ["x", "y", "z"].map(side => eye[side] - center[side]), distance = Math.hypot(...to);
  const [a, b, c] = to.map(s => s / distance), flat = Math.hypot(a, b), half = Math.tan(Math.PI / 8);
  const right = [-b / flat, a / flat, 0], up = [-c * a / flat, -c * b / flat, flat];
  const dot = (u, v) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2], {clientWidth: w, clientHeight: h} = drawing;
  return [0, 1, 2, 3, 4, 5, 6, 7].every(k => {
    const p = [x * ((k & 1) - 0.5) - center.x, y * ((k >> 1 & 1) - 0.5) - center.y, z * ((k >> 2) - 0.5) - center.z];
    const scale = h / 2 / half / (distance - dot(p, [a, b, c]));
    const px = w / 2 + scale * dot(p, right), py = h / 2 - scale * dot(p, up);
    return px > 60 && px < w - 30 && py > 20 && py < h - 20;
  });
})()"""


def test_folds_open_by_the_keyboard_and_for_paper(fresh_page):
    page = fresh_page(*SCREEN)
    assert page.locator("details[open]").count() == 0
    assert page.locator("#rates .main-svg").count() == 0  # not yet drawn
    page.get_by_role("button", name="Zoom to the cursor").click()
    page.locator("#rates-panel summary").focus()
    page.keyboard.press("Enter")
    page.locator("#rates .main-svg").first.wait_for()
    ranges = "figures.map(({curves}) => [...curves.layout.xaxis.range])"
    assert page.evaluate(f"new Set({ranges}.map(String)).size") == 1
    page.get_by_role("button", name="Whole motion").click()
    assert page.evaluate(ranges) == [[0, 1.5], [0, 1.5]]
    curves, rates = (page.locator(f"{chart} .main-svg").first.bounding_box() for chart in ("#curves", "#rates"))
    assert curves["width"] == pytest.approx(rates["width"], abs=2)
    folds = page.locator("details").count()
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.locator("details[open]").count() == folds
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.locator("details[open]").count() == 1


@pytest.mark.parametrize("size", [SCREEN, PHONE], ids=["screen", "phone"])
def test_buttons_are_large_enough_for_fingers(fresh_page, size):
    page = fresh_page(*size)
    page.evaluate(OPEN_FOLDS)
    sizes = page.evaluate("""all("button, select, summary, .player input").map(part => {
      const {width, height} = part.getBoundingClientRect();
      return [part.textContent.trim().slice(0, 20), Math.min(width, height)];
    })""")
    assert len(sizes) > 20
    assert [name for name, least in sizes if least < 44] == []


def test_rounding_noise_is_shown_as_zero(fresh_page):
    page = fresh_page(*SCREEN)
    cells = page.locator("#values-table td")
    page.evaluate("values[3][cursor * n] = -7.9e-19; moveTo(cursor)")
    assert cells.nth(0).text_content() == "0"
    page.evaluate("values[3][cursor * n] = -7.9e-6; moveTo(cursor)")
    assert cells.nth(0).text_content() == "-7.90e-6"


@pytest.mark.parametrize("size", [SCREEN, PHONE], ids=["screen", "phone"])
def test_axe_finds_no_fault_on_screens_and_phones(fresh_page, size):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")
    page = fresh_page(*size)
    for prepare in ("0", OPEN_FOLDS):
        page.evaluate(prepare)
        found = axe.Axe().run(page, options={"resultTypes": ["violations"]})
        assert [(fault["id"], fault["help"]) for fault in found.response["violations"]] == [], prepare


def test_axe_finds_no_fault(open_page):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")
    for scheme, options in (("light", {}), ("dark", {"runOnly": ["color-contrast"]})):
        open_page.emulate_media(color_scheme=scheme)
        found = axe.Axe().run(open_page, options=options | {"resultTypes": ["violations"]})
        assert [(fault["id"], fault["help"]) for fault in found.response["violations"]] == [], scheme


def test_it_fits_a_phone_and_paper(open_page):
    open_page.set_viewport_size({"width": 390, "height": 800})
    inner = "[...document.querySelectorAll('.scroll')].every(box => box.scrollWidth <= box.clientWidth)"
    assert open_page.evaluate(inner)  # no number is cut off
    fits = "document.documentElement.scrollWidth <= document.documentElement.clientWidth"
    playwright.expect(open_page.locator("body")).to_have_js_property("scrollWidth", 390)
    assert open_page.evaluate(fits)
    open_page.emulate_media(media="print")
    assert not open_page.locator("#play").is_visible()
    canvas = "document.querySelector('#robot canvas')"
    kept = (
        f"({canvas}.getContext('webgl') || {canvas}.getContext('webgl2')).getContextAttributes().preserveDrawingBuffer"
    )
    assert open_page.evaluate(kept)  # else it is blank on paper
    open_page.emulate_media(media="screen")


def test_reduced_motion_is_respected(open_page):
    """A picture per second in place of a moving one."""
    open_page.emulate_media(reduced_motion="reduce")
    open_page.evaluate("moveTo(0)")
    open_page.get_by_role("button", name="Play").click()
    open_page.wait_for_timeout(300)
    assert cursor(open_page) == 0
    open_page.get_by_role("button", name="Pause").click()
