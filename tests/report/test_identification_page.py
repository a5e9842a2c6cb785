"""The page of an identification: one file, curves with all extremes, spectra that are right, names that are no code."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

import jounce
from jounce._report.page import MAX_PAGE_POINTS, _bar, _spectrum
from support.pages import decoded, parsed
from support.refusals import refusal

NAMES = ("</script><script>hacked = 1</script>", "<b>two</b>")
ARM = jounce.load("planar2r")
ROBOT = jounce.Robot(replace(ARM.mechanism, joints=NAMES, coordinates=NAMES))
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="module")
def identified():
    """Of two logs, of which one only tests; the first has a wild sample, and some that are not measured."""
    logs = {}
    for k, name in enumerate(("first", "<i>test</i>")):
        rng = np.random.default_rng(k)
        motion = jounce.Motion.fourier([0.3, 0.5], *rng.uniform(-0.4, 0.4, (2, 3, 2)), 1.5, 20.0)
        t = np.arange(0, 20, 1e-3)
        Q = 1.2 * ARM.inverse_dynamics(*motion(t, 2)) + 0.1 * rng.normal(size=(len(t), 2))
        Q[7777, 0] += 300 * (k == 0)
        Q[1000:1500, 1] = np.nan
        logs[name] = replace(motion, torques=(t, Q))
    with pytest.warns(jounce.JounceWarning, match="unexplained from 7.74"):
        return ROBOT.identify(logs, drives=False, test="<i>test</i>", span=(0, 15))


@pytest.fixture(scope="module")
def identification_page(identified):
    return ROBOT.report(identified)


def test_curves_are_few_and_keep_every_extreme(identified, identification_page):
    drawn = parsed(identification_page)[1]["figures"]
    assert np.shape(drawn) == (2, 2, 2)
    points = 0
    for log, of_log in zip(identified.logs, drawn, strict=True):
        for j, (times, _) in enumerate(of_log):
            measured, predicted = identified.measured[log.rows, j], identified.predicted[log.rows, j]
            expected = [measured, identified.model[log.rows, j], predicted, measured - identified.model[log.rows, j]]
            for trace, values in zip(times["data"], [*expected, measured - predicted], strict=True):
                y = decoded(trace["y"])
                points += len(y)
                assert (np.nanmin(y), np.nanmax(y)) == pytest.approx((np.nanmin(values), np.nanmax(values)), rel=1e-6)
                assert np.isnan(y).any() == np.isnan(values).any(), "gaps stay gaps"
    assert points < 1.1 * MAX_PAGE_POINTS
    assert len(identification_page.html) < 8e6
    shaded = [[(shape["x0"], shape["x1"]) for shape in of_log[0][0]["layout"]["shapes"]] for of_log in drawn]
    assert np.allclose(shaded[0], [(15, 19.999)])
    assert np.allclose(shaded[1], [(0, 19.999)])


def test_the_spectrum_holds_the_power_of_a_force():
    """White noise has the density s (2 dt)^1/2; a line has its amplitude at its frequency."""
    t, rng = np.arange(0, 40, 1e-3), np.random.default_rng(0)
    f, density = _spectrum(t, 0.3 * rng.normal(size=len(t)))
    assert np.sqrt(np.mean(density[f > 5] ** 2)) == pytest.approx(0.3 * np.sqrt(2e-3), rel=0.05)
    f, density = _spectrum(t, np.where(np.abs(t - 20) < 0.01, np.nan, np.sin(2 * np.pi * 30 * t)))
    assert f[density.argmax()] == pytest.approx(30, rel=0.05)


@pytest.mark.parametrize(
    ("value", "deviation", "model"), [(1.0, 0.1, 3.0), (1.0, 5.0, 1.1), (0.0, np.inf, 0.0), (2.0, 0.0, 2.0)]
)
def test_bars_keep_their_order(value, deviation, model):
    bar = _bar(jounce.IdentifiedParameter("m", "kg", value, deviation, model, True))
    assert 0 < bar["low"] <= bar["value"] <= bar["high"] < 160
    assert (bar["model"] > bar["high"]) == (model > value + 2 * deviation)
    assert 0 < bar["model"] < 160


def test_it_says_what_was_found(identified, identification_page):
    tree, _ = parsed(identification_page)
    text = tree.text_content()
    assert "determine 6 of 6 parameters" in text
    assert identified.notes
    parts = [*NAMES, *identified.names, *identified.notes, "<i>test</i> (test)", "used for validation only"]
    assert [part for part in parts if part not in text] == []
    assert len(tree.xpath("//circle")) == len(identified.table)
    assert not tree.xpath("//link | //img | //script[@src]")
    refusal(lambda: ROBOT.report(identified, order=1), "order", "are for motions")


def test_it_works_in_a_browser(identification_page, tmp_path):
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("no chromium or google-chrome in the path")
    identification_page.save(tmp_path / "page.html")
    wrong = []
    with playwright.sync_playwright() as p:
        browser = p.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        shown = browser.new_page(viewport={"width": 390, "height": 800}, color_scheme="dark")
        shown.on("console", lambda message: wrong.append(message.text) if message.type == "error" else None)
        shown.on("pageerror", lambda error: wrong.append(str(error)))
        shown.on("request", lambda asked: wrong.append(asked.url) if asked.url.startswith("http") else None)
        shown.goto((tmp_path / "page.html").as_uri())
        shown.wait_for_selector(".plot .main-svg", timeout=60_000)
        assert shown.evaluate("document.documentElement.scrollWidth") == 390, "it fits a phone"
        assert "invert" in shown.evaluate("getComputedStyle(document.querySelector('.plot')).filter")
        first = shown.evaluate("plots[0].layout.shapes[0].x0")
        shown.locator("#log").select_option("1")
        assert (first, shown.evaluate("plots[0].layout.shapes[0].x0")) == (15, 0)
        assert shown.locator("[data-log]:visible").count() == 1
        assert shown.evaluate("window.hacked") is None
        browser.close()
    assert wrong == []
