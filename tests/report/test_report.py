"""Reports as files: what stands in them, how large they are, and what is refused."""

import doctest
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import jounce
from jounce._report.curves import MAX_CURVE_POINTS
from jounce._report.panels import end_names, sliders_code, sliders_data
from jounce._report.report_data import make_report_data
from support.commands import call
from support.pages import LARGEST, decoded, drawn_traces, panel, parsed, words
from support.refusals import refusal, refused

ROOT = Path(__file__).parents[2]
HOME = np.array([0, -0.785, 0, -2.356, 0, 1.571, 0.785])
VALUES = "//div[contains(@class, 'values') and contains(@class, 'scroll')]"
HOSTILE = ["</script><script>hacked=1</script>", '"><img src=x onerror=hacked=1>', "{{ 7 * 7 }}<!--\u202e\n"]


def test_an_end_of_the_robot_is_pulled_and_no_name_of_a_file_is_code(panda):
    m = panda.mechanism
    data = sliders_data(make_report_data(panda, jounce.Motion.polynomial([[x, 0.1] for x in HOME], 1.0), 0))
    assert end_names(m) == [*panda.body_names, *(frame.name for frame in m.frames if frame.body >= 0)]
    assert len(end_names(m)) == len(data.ends)
    assert end_names(m)[data.first] == "panda_hand_tcp"
    tool = data.ends[data.first]
    np.testing.assert_allclose(tool.point, m.frame("panda_hand_tcp").T[:3, 3])
    assert data.force == 200  # N, at least the weight
    assert (np.array(data.lower) <= HOME).all()
    assert (np.array(data.upper) >= HOME + 0.1).all()
    code = sliders_code(panda)
    assert "panda" not in code
    assert "//" not in code
    assert "*/" not in code


@pytest.fixture(scope="module")
def planar():
    return jounce.load("planar2r").with_limits(velocity=1.0)


def parabola_motion(n=2, duration=1.0):
    return jounce.Motion.polynomial(np.tile([0, 0.5, 0.1], (n, 1)), duration)


def test_a_tripping_motion_and_the_retimed_one_have_opposite_verdicts(panda, record_property):
    tripping = jounce.Motion.trapezoidal([HOME, HOME + 0.4], 2.0, 7.0).blended(0.02).with_step(0.01)
    retimed = panda.retime(tripping).motion
    for motion, kind in ((tripping, "broken"), (retimed, "kept")):
        report = panda.report(motion, 1)
        page, _ = parsed(report)
        assert page.xpath(f"//*[@class='verdict {kind}']")
        assert report.check.ok == (kind == "kept")
        assert len(report.html.encode()) < LARGEST
        rows = page.xpath("//table[@id='limits']/tbody/tr")
        assert len(rows) == len(report.check.table)
        ratios = [float(row[2].text_content().replace("∞", "inf").split()[0]) for row in rows]
        assert ratios == sorted(ratios, reverse=True)
        assert ratios[0] == pytest.approx(report.check.worst.ratio, rel=1e-4)
        assert len(page.xpath("//tr[@class='broken']")) == sum(not row.ok for row in report.check.table)
        assert words(page, "//*[@id='factor']") == f"{report.slowdown.factor:.5g}"
        record_property("megabytes", len(report.html) / 1e6)


def test_the_report_of_the_tutorial_is_small_with_bands_and_dots(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs/tutorials/from-a-log-to-torques.md").read_text(encoding="utf-8")
    names = {}
    for example in doctest.DocTestParser().get_examples(
        "".join(re.findall(r"^```python\n(.*?)^```$", page, re.M | re.S))
    ):
        exec(example.source, names)
        if "motion" in names:
            break
    report = names["robot"].report(names["motion"])
    assert len(report.html.encode()) < LARGEST
    page, data = parsed(report)
    looks = [(trace["mode"], trace.get("fill")) for trace in drawn_traces(data)]
    assert looks.count(("none", "toself")) == 7 * 8
    assert looks.count(("markers", None)) >= 7
    assert "95 % probability" in words(page, panel("curves"))
    assert "time stamps scatter" in words(page, panel("motion"))
    assert len(page.xpath("//caption[contains(., 'Standard deviations')]")) == 1


def test_a_spike_of_one_sample_is_drawn_and_is_the_worst(planar):
    bump = np.zeros((11, 3, 2))  # of the first joint, narrower than five samples, continuous to its fourth derivative
    bump[:6, 1, 0] = [-1, 5, -10, 10, -5, 1]
    width = 2.0**-11  # s: a power of two, so that polynomials meet exactly
    bump *= 0.5 * width ** -np.arange(10, -1.0, -1)[:, None, None]
    motion = jounce.Motion.piecewise([0, 5.5, 5.5 + width, 10], bump).with_step(1e-4)
    report = planar.report(motion)
    assert len(report.html.encode()) < LARGEST
    _, data = parsed(report)
    of = [trace for trace in data["rates"]["data"] if (trace["yaxis"], trace["meta"]) == ("y2", 0)]
    curves = [decoded(trace["y"]) for trace in of if isinstance(trace["y"], dict)]
    assert max(map(len, curves)) < 2 * MAX_CURVE_POINTS
    assert [np.nanmax(curve) for curve in curves] == pytest.approx([report.check.worst.value] * 2, rel=1e-6)
    assert 5.5 < report.check.worst.t < 5.5 + width
    assert np.abs(decoded(data["frames"]["t"]) - report.check.worst.t).min() < 1e-12


def test_forces_stand_open_and_the_rest_is_folded(planar):
    page, data = parsed(planar.report(jounce.Motion.polynomial([[0, 2.0], [0, -1.5]], 1.0)))
    sections = page.xpath("//main//section")
    folded = [section.get("id").removesuffix("-panel") for section in sections if section.xpath("./details")]
    is_open = [section.get("id").removesuffix("-panel") for section in sections if not section.xpath("./details")]
    assert is_open == ["robot", "values", "curves"]
    assert folded == ["rates", "sliders", "limits", "motion", "robot_data", "conventions"]
    assert page.xpath("//details[@open]") == []
    assert len(page.xpath("//details/summary/h2[@id]")) == len(folded)
    titles = [[note["text"] for note in data[name]["layout"]["annotations"]] for name in ("curves", "rates")]
    assert [re.findall("<b>(.*?)</b>", "".join(of)) for of in titles] == [
        ["Q", "Qd", "Q2d"],
        ["q", "qd", "q2d", "q3d", "q4d"],
    ]
    assert words(page, panel("rates") + "//summary") == "q, qd, q2d, q3d, q4d 2 limits broken"
    assert words(page, panel("limits") + "//summary") == "Limits 2 of 2 limits broken"
    assert page.xpath(panel("limits") + "/details//table[@id='limits']")


def test_the_cursor_starts_at_the_worst_moment(planar):
    motion = jounce.Motion.polynomial([[0, 0.2, 1.5, -1.0], [0, 0.1, 0, 0]], 1.0)
    report = planar.report(motion)
    page, data = parsed(report)
    start, t = data["frames"]["start"], decoded(data["frames"]["t"])
    assert 0.3 < report.check.worst.t < 0.7
    assert t[start] == report.check.worst.t
    assert page.xpath("//input[@id='time']/@value") == [str(start)]
    assert page.xpath("//button[text()='Worst moment']/@data-frame") == [str(start)]
    page, data = parsed(jounce.load("planar2r").report(motion))
    assert data["frames"]["start"] == 0
    assert not page.xpath("//button[text()='Worst moment']")


def test_names_break_after_underscores_and_stay_whole_as_text():
    robot = jounce.load("solo12").with_limits(velocity=2.0)
    page, _ = parsed(robot.report(parabola_motion(robot.n), 0))
    labels = page.xpath("//div[@id='values-table']//label/span")
    assert [label.text_content() for label in labels] == list(robot.joint_names)
    assert [len(label.xpath("./wbr")) for label in labels] == [name.count("_") for name in robot.joint_names]
    assert min(name.count("_") for name in robot.joint_names) > 0
    for cell in (panel("robot_data") + "//tbody//th[1]", "//table[@id='limits']/tbody//td[2]", "//p[@class='verdict']"):
        assert all("_" not in text.rstrip("_") for found in page.xpath(cell) for text in found.itertext())
    assert page.xpath("//table[@id='limits']/tbody//td[2]/wbr")


def test_pictures_have_a_title_and_a_description(planar):
    motion = parabola_motion()
    page, _ = parsed(planar.report(motion))
    pictures = page.xpath("//*[@role='img']")
    assert [picture.get("id") for picture in pictures] == ["robot", "curves", "rates"]
    assert all(picture.get("aria-label") for picture in pictures)
    described = [words(page, f"//*[@id='{picture.get('aria-describedby')}']") for picture in pictures]
    assert described[0].startswith("Drag to orbit.")
    Q = planar.forces_along(motion, motion.times, 0).forces[0]
    assert f"to {Q.max():.5g} (joint joint1, t = 0 s)" in described[1]
    assert described[1].count(" from ") == 3
    assert described[2].startswith("q in rad: from 0 (joint joint1, t = 0 s) to 0.6 (joint joint1, t = 1 s).")


def test_a_robot_without_limits_says_so_and_draws_none():
    report = jounce.load("planar2r").report(parabola_motion())
    page, data = parsed(report)
    assert "states none, so that nothing is checked" in words(page, "//p[@class='verdict']")
    assert "has no limits" in words(page, panel("limits"))
    assert not page.xpath("//table[@id='limits']")
    assert (report.check, report.slowdown) == (None, None)
    assert {trace["mode"] for trace in drawn_traces(data)} == {"lines"}
    assert [len(data[name]["data"]) for name in ("curves", "rates")] == [2 * 3, 2 * 5]


def test_breaks_are_listed_and_drawn_from_both_sides(planar):
    motion = jounce.Motion.trapezoidal([[0, 0], [1, 1]], 0.9, 2.0)
    page, data = parsed(planar.report(motion))
    assert len(page.xpath(panel("motion") + "//tbody/tr")) == len(motion.breaks) == 4
    for figure in (data["curves"], data["rates"]):
        assert [shape["x0"] for shape in figure["layout"]["shapes"]] == sorted({found.t for found in motion.breaks})
    [q2d] = [trace for trace in data["rates"]["data"] if (trace["yaxis"], trace["meta"]) == ("y3", 0)]
    t, y = decoded(q2d["x"]), decoded(q2d["y"])
    at = np.flatnonzero(np.abs(t - motion.breaks[0].t) < 1e-6)
    assert y[at].tolist() == pytest.approx([2.0, 0.0])


def test_there_is_a_reason_where_there_is_no_factor():
    robot = jounce.load("planar2r").with_limits(acceleration=1.0, jerk=1.0)
    report = robot.report(jounce.Motion.trapezoidal([[0, 0], [1, 1]], 0.9, 2.0))
    assert report.slowdown is None
    assert "no slow-down factor: break at t = 0.45 s" in words(parsed(report)[0], panel("limits"))


def test_order_0_draws_Q_alone_and_needs_no_higher_rate(planar):
    t = np.linspace(0, 1, 101)
    rates = {f"joint{j}.{name}": np.sin(t + k * np.pi / 2) for j in (1, 2) for k, name in enumerate(("q", "qd", "q2d"))}
    motion = jounce.load_motion({"t": t, **rates}, planar, 0)
    heads = [cell.text.strip() for cell in parsed(planar.report(motion))[0].xpath(VALUES + "//thead//th")]
    assert heads == ["joint", "Q", "joint", "q", "qd", "q2d"]
    refusal(lambda: planar.report(motion, 2), "q4d is not known")


def test_elastic_joints_show_their_motors(planar):
    arm = planar.elastic([800, 600], rotor=0.1).with_limits(motor_torque=[20.0, 20.0])
    motion = parabola_motion()
    report = arm.report(motion)
    page, data = parsed(report)
    heads = [cell.text.strip() for cell in page.xpath(VALUES + "//thead//th")]
    assert heads[-3:] == ["theta", "thetad", "tau"]
    t = decoded(data["frames"]["t"])
    found = [decoded(values).reshape(-1, 2) for values in data["frames"]["values"]]
    last = int(page.xpath(VALUES + "//td/@data-value")[-1])
    np.testing.assert_allclose(found[last], arm.motor_torques(*motion(t)), rtol=1e-12)
    assert not report.check.ok
    assert page.xpath("//tr[@class='broken']/td[.='motor torque']")
    assert "tau the motor torques" in words(page, panel("conventions"))


def test_hostile_names_stay_text():
    M = jounce.inertia_matrix(1.0, [0, 0, 0.1], np.eye(3) / 100)
    names = {"names": [f"body {name}" for name in HOSTILE], "joint_names": HOSTILE, "name": HOSTILE[0]}
    X = [[0, 0, 1, 0, 0, 0], [0, 0, 0, 1, 0, 0], [0, 1, 0, 0, 0, 0]]
    robot = jounce.Robot.from_screws([np.eye(4)] * 3, X, [M] * 3, limits={"velocity": [0.1] * 3}, **names)
    report = robot.report(parabola_motion(3))
    page, _ = parsed(report)
    harmless = jounce.load("planar2r").report(parabola_motion())
    assert len(page.xpath("//script")) == len(parsed(harmless)[0].xpath("//script"))
    shown = [label.text_content().strip() for label in page.xpath("//div[@id='values-table']//table[1]//label")[:3]]
    assert shown == [*HOSTILE[:2], r"{{ 7 * 7 }}<!--\u202e\n"]
    assert page.xpath("//img") == []
    assert "<script>hacked" not in report.html
    assert words(page, "//h1") == HOSTILE[0]


def test_a_page_links_to_nothing():
    page, _ = parsed(jounce.load("planar2r").report(parabola_motion()))
    assert page.xpath("//@href | //@src") == []
    assert "default-src 'none'" in page.xpath("//meta[@http-equiv]/@content")[0]


def test_bad_input_is_one_line_and_leaves_files_as_they_were(planar, tmp_path, monkeypatch):
    other = jounce.Motion.polynomial([[0.0], [1.0]], 1.0, joint_names=["a", "b"])
    refusal(lambda: planar.report(other), "unknown 'a', 'b'")
    refusal(lambda: planar.report("paper"), "report() expects a jounce.Motion, got str; try jounce.load_motion")
    refusal(lambda: planar.report(parabola_motion(), 3), "order is 3; expected 0, 1 or 2")
    report = planar.report(parabola_motion())
    refusal(lambda: report.save(tmp_path / "none" / "r.html"), "no folder")
    refusal(lambda: report.save(tmp_path / "r.pdf"), "available: .html, .htm")
    refusal(lambda: report.save(3), "save() expects a path, got int")
    old = tmp_path / "r.html"
    old.write_text("old")
    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        refusal(lambda: report.save(old), "No space left on device")
    assert [path.name for path in tmp_path.iterdir()] == ["r.html"]
    assert old.read_text() == "old"


def test_without_plotly_the_extra_is_named(planar, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly", None)
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    assert refusal(lambda: planar.report(parabola_motion())).endswith("pip install 'jounce[report]'")


def test_the_command_writes_the_page_and_tells_of_it(tmp_path):
    motion, page = tmp_path / "motion.yaml", tmp_path / "report.html"
    motion.write_text(
        "time: {start: 0, stop: 1, count: 101}\njoints: {joint1: {polynomial: [0, 2]}, joint2: {offset: 1}}"
    )
    limits = tmp_path / "limits.yaml"
    limits.write_text("units: SI\njoints: {joint1: {velocity: 1}}")
    asked = ["report", "planar2r", str(motion), "-o", str(page), "--limits", str(limits)]
    result = call(*asked, "--json")
    assert result.exit_code == 0, result.output
    summary = json.loads(result.output)
    assert (summary["ok"], summary["states"], summary["bytes"]) == (False, 101, page.stat().st_size)
    assert summary["factor"] == pytest.approx(0.5)
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    result = call(*asked)
    assert result.output.splitlines()[0].endswith("101 states: 1 of 1 limits broken")
    refused(tmp_path, "report planar2r motion.yaml -o no/r.html", "no folder 'no'")
