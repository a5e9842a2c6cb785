"""Displays in notebooks: what they show of robots, motions and results."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest
import sympy

import jounce
from jounce.figures import canvas


class Cells(HTMLParser):
    """The texts of the cells of tables, and the tags of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.rows, self.tags = [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag == "tr":
            self.rows.append([])

    def handle_data(self, data):
        if self.rows and self.tags[-1] in ("td", "th") and data.strip():
            self.rows[-1].append(data)


@pytest.fixture(scope="module")
def limited_planar2r():
    return jounce.load("planar2r").with_limits(velocity=[1.0, 3.0], effort=60)


@pytest.fixture(scope="module")
def parabola():
    return jounce.Motion.polynomial([[0, 2], [0, 0.5]], duration=1.0)


def test_a_robot_shows_its_joints_masses_and_limits(limited_planar2r):
    page = limited_planar2r._repr_html_()
    found = Cells(page)
    assert [row[0] for row in found.rows[1:]] == list(limited_planar2r.joint_names)
    assert found.rows[1][4:] == ["1 kg", "1 rad/s", "60 N m"]
    assert found.tags.count("img") == 1


def test_a_robot_of_symbols_shows_its_joints():
    page = jounce.load("planar2r", L1=sympy.Symbol("L1"))._repr_html_()
    assert [row[0] for row in Cells(page).rows[1:]] == ["joint1", "joint2"]


def test_names_are_escaped():
    arm = jounce.load("planar2r")
    hostile = "<script>alert(1)</script>"
    renamed = jounce.Robot(replace(arm.mechanism, coordinates=(hostile, "b"), joints=(hostile, "b")))
    page = renamed._repr_html_()
    assert "script" not in Cells(page).tags
    assert "&lt;script&gt;" in page


def test_a_motion_shows_its_ends_and_largest_rates(parabola):
    found = Cells(parabola._repr_html_())
    assert found.rows[1] == ["joint 1", "0", "2", "2", "0"]
    assert "img" in found.tags


def test_a_check_shows_what_is_broken_first(limited_planar2r, parabola):
    found = Cells(limited_planar2r.check(parabola)._repr_html_())
    assert found.rows[1][:3] == ["broken", "joint1", "velocity"]
    ratios = [float(row[-1]) for row in found.rows[1:]]
    assert ratios == sorted(ratios, reverse=True)


def test_results_show_what_decides_and_the_motion(limited_planar2r, parabola):
    slow = limited_planar2r.slowdown(parabola)
    assert "Slowdown by a factor of speed 0.5: velocity of joint1" in slow._repr_html_()
    assert repr(slow) == "<Slowdown by a factor of speed 0.5: velocity of joint1 at t = 0 s>"
    there = jounce.Motion.polynomial([[0, 0, 3, -2], [0, 0, 1.5, -1]], duration=1.0)
    fast = jounce.load("planar2r").with_limits(velocity=1.0, acceleration=2.0).retime(there)
    found = Cells(fast._repr_html_())
    assert found.rows[0][1] == "limit that decides"
    assert {row[0] for row in found.rows[1 : len(fast.binding) + 1]} <= set(limited_planar2r.joint_names)


def test_without_matplotlib_the_tables_remain(limited_planar2r, monkeypatch):
    def missing():
        raise jounce.JounceError("pictures need matplotlib")

    monkeypatch.setattr(canvas, "check_installed", missing)
    found = Cells(limited_planar2r._repr_html_())
    assert "img" not in found.tags
    assert len(found.rows) == 3


def test_symbols_show_a_table_of_formulas():
    rows = jounce.load("planar2r").symbolic()._repr_markdown_().splitlines()
    assert all(re.fullmatch(r"\|[^|]+\|[^|]+\|[^|]+\|", row) for row in rows)
    assert any("`S.M`" in row for row in rows)
    assert any("`S.jacobian(body)`" in row for row in rows)
