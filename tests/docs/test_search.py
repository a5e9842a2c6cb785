"""The built site: a word leads to its how-to page first, and no page has a serious fault for screen readers."""

import functools
import http.server
import shutil
import threading
from pathlib import Path

import pytest

SITE = Path(__file__).parents[2] / "build" / "site"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FIRST = {
    "csv": "howto/motion-files.html",
    "torque limit": "howto/limits.html",
    "mass matrix": "howto/matrices.html",
    "gravity compensation": "howto/matrices.html",
    "forward kinematics": "howto/matrices.html",
    "payload": "howto/payload.html",
    "urdf": "howto/robot-files.html",
    "jacobian": "howto/matrices.html",
    "elastic joint": "howto/elastic-joints.html",
    "c code": "howto/codegen.html",
}
RESULT = ".md-search-result__list > li > a"
pytestmark = pytest.mark.outside


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def site_address():
    if not (SITE / "search").is_dir():
        pytest.skip("the site is not built: make docs")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=SITE))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def tab():
    sync_api = pytest.importorskip("playwright.sync_api")
    if CHROMIUM is None:
        pytest.skip("no chromium or google-chrome in the path")
    with sync_api.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser.new_page(viewport={"width": 1440, "height": 900})
        browser.close()


@pytest.mark.parametrize(("word", "page"), FIRST.items(), ids=FIRST)
def test_a_word_leads_to_its_page_first(tab, site_address, word, page):
    tab.goto(f"{site_address}/index.html?q={word.replace(' ', '+')}")
    tab.wait_for_selector(RESULT, state="attached")
    assert tab.get_attribute(RESULT, "href").partition("?")[0] == f"{site_address}/{page}"


@pytest.mark.parametrize("page", ["index.html", "howto/limits.html", "tutorials/my-urdf.html"])
def test_pages_have_no_serious_fault(tab, site_address, page):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    tab.goto(f"{site_address}/{page}")
    found = axe.Axe().run(tab).response["violations"]
    assert [fault["id"] for fault in found if fault["impact"] in ("serious", "critical")] == []
