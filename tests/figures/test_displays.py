"""Displays in notebooks: what they show of robots, motions and results."""

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
import sympy

import jounce
from jounce.core.display import MAX_LINES_PRINTED, print_table
from jounce.figures import canvas
from jounce.figures.displays import MAX_ROWS_SHOWN
from jounce.motion.channel import Channel


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


HOSTILE_NAME = "<script>alert(1)</script>"


def is_short(shown):
    return len(repr(shown).splitlines()) <= MAX_LINES_PRINTED


def with_hostile_names(robot, name=HOSTILE_NAME):
    """A robot whose first joint, first body and own name are code."""
    m = robot.mechanism
    joints, bodies = (name, *m.joints[1:]), (name, *m.bodies[1:])
    return jounce.Robot(replace(m, name=name, joints=joints, coordinates=joints, bodies=bodies))


@pytest.fixture(scope="module")
def noisy_identification():
    """Of a log with noise, whose first parameter is not seen."""
    robot = with_hostile_names(jounce.load("planar2r"))
    motion = jounce.Motion.fourier([0, 0], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 4.0)
    Q = robot.forces_along(motion, order=0).forces[0]
    found = robot.identify(motion, 1.5 * Q + 0.1 * np.random.default_rng(0).normal(size=Q.shape))
    first, *others = found.table
    return replace(found, table=(replace(first, seen=False), *others))


@pytest.fixture(scope="module")
def carried_load():
    robot = jounce.load("iiwa14")
    motion = jounce.load_motion("paper", robot).with_step(0.02)
    p = robot.inertial_parameters
    p[-10] += 1.5
    Q = robot.with_inertial_parameters(p).forces_along(motion, order=0).forces[0]
    return robot.payload(replace(motion, torques=(motion.times, Q)))


def test_a_table_on_a_terminal_has_twelve_lines_at_most():
    rows = [(f"a{k}", f"{k}") for k in range(40)]
    for count in (0, 1, 8, 9, 10, 11, 40):
        for notes in range(5):
            lines = print_table("head", ("", "x"), rows[:count], ["note"] * notes).splitlines()
            shown = sum(line.startswith("a") and not line.startswith("and") for line in lines)
            assert len(lines) <= MAX_LINES_PRINTED
            assert (f"and {count - shown} more" in lines) == (shown < count)
            assert sum(line == "note" for line in lines) == (notes if notes < 4 else 2)


def test_a_mechanism_prints_its_joints_and_bodies():
    lines = repr(jounce.load("planar2r").mechanism).splitlines()
    assert lines[0] == "<Mechanism planar2r: 2 coordinates, 2 bodies of 2 kg>"
    assert [line.split() for line in lines[2:]] == [
        ["joint1", "rad", "body1", "ground", "1"],
        ["joint2", "rad", "body2", "body1", "1"],
    ]
    for name in ("g1", "solo12", "panda", "delta"):
        assert is_short(jounce.load(name).mechanism), name
    floating = repr(jounce.load("g1", base="floating").mechanism)
    assert ", floats" in floating.splitlines()[0]
    assert "and 20 more" in floating
    assert "L1" not in repr(jounce.load("planar2r", L1=sympy.Symbol("L1")).mechanism)
    assert "m_1" in repr(jounce.load("planar2r", m1=sympy.Symbol("m_1")).mechanism)


def test_a_mechanism_shows_what_its_robot_shows(limited_planar2r):
    page = with_hostile_names(limited_planar2r).mechanism._repr_html_()
    found = Cells(page)
    assert found.rows[2][4:] == ["1 kg", "3 rad/s", "60 N m"]
    assert "img" in found.tags
    assert "script" not in found.tags
    assert "Mechanism &lt;script&gt;" in page


def test_drives_show_what_is_stated_joint_by_joint():
    drives = jounce.load("panda").drives
    assert repr(drives).splitlines()[0] == "<Drives of 9 joint variables: damping>"
    assert [line.split() for line in repr(drives).splitlines()[2:4]] == [["0", "0.003"], ["1", "0.003"]]
    assert repr(jounce.load("planar2r").drives) == "<Drives of 2 joint variables: none stated>"
    friction = np.array([0.0, 0.5] * 20)
    terms = {name: np.resize(x, 40) for name, x in vars(drives).items()} | {
        "friction": friction,
        "damping": 0 * friction,
    }
    many = replace(drives, **terms)
    lines = repr(many).splitlines()
    assert (len(lines), lines[1].split(), lines[2].split()) == (12, ["joint", "friction", "eps"], ["1", "0.5", "0.05"])
    assert lines[-1] == "and 11 more"
    rows = Cells(many._repr_html_()).rows
    assert rows[1:3] == [["1", "0.5", "0.05"], ["3", "0.5", "0.05"]]
    assert len(rows) == 1 + MAX_ROWS_SHOWN
    assert "and 8 more joints" in many._repr_html_()


def test_an_identification_shows_what_is_left_and_not_seen(noisy_identification):
    assert is_short(noisy_identification)
    head, titles, first, *_ = repr(noisy_identification).splitlines()
    seen = sum(row.seen for row in noisy_identification.table)
    assert (
        f"{seen} of {len(noisy_identification.table)} parameters seen, {noisy_identification.samples} samples>" in head
    )
    of = noisy_identification.residuals[0]
    numbers = [f"{x:.4g}" for x in (of.measured, of.model, of.identified)]
    assert re.split(r" {2,}", first)[1:] == [*numbers, "N m"]
    assert titles.split() == ["force", "measured", "model", "leaves", "identified", "leaves", "unit"]
    assert f"not seen: {noisy_identification.unseen[0]}" in repr(noisy_identification)
    page = noisy_identification._repr_html_()
    found = Cells(page)
    assert found.rows[1][1:] == [*numbers, "N m"]
    assert "script" not in found.tags
    assert "img" in found.tags
    for name in noisy_identification.unseen:
        assert name.replace("<", "&lt;").replace(">", "&gt;")[:20] in page


def test_a_payload_shows_its_parameters_and_settings(carried_load):
    assert is_short(carried_load)
    lines = repr(carried_load).splitlines()
    assert lines[0].startswith("<Payload on link7: 1.5 +- ")
    assert lines[2].split()[:2] == ["mass", "1.5"]
    found = Cells(carried_load._repr_html_())
    assert found.rows[1][:2] == ["mass", "1.5"]
    assert len(found.rows) == 11
    assert "set_payload(1.5000" in carried_load._repr_html_()
    hostile = replace(carried_load, frame=HOSTILE_NAME)
    assert "script" not in Cells(hostile._repr_html_()).tags


def test_forces_along_a_motion_show_peaks_and_curves(parabola):
    along = with_hostile_names(jounce.load("planar2r")).forces_along(parabola, np.linspace(0, 1, 30), 1)
    page = along._repr_html_()
    found = Cells(page)
    assert [row[0] for row in found.rows[1:]] == ["q", "qd", "q2d", "q3d", "Q", "Qd"]
    i, j = np.unravel_index(np.abs(along.forces[0]).argmax(), (30, 2))
    assert found.rows[5][1:3] == [f"{abs(along.forces[0][i, j]):.5g}", "N m"]
    assert found.rows[5][4] == f"{along.t[i]:.5g}"
    assert "script" not in found.tags
    assert found.tags.count("img") == 1
    assert "Along: 30 times, t = 0 .. 1 s" in page


def test_motors_along_a_motion_show_peaks_curves_and_notes():
    arm = jounce.load("planar2r").elastic(1e4, rotor=0.4)
    along = arm.motors_along(jounce.Motion.polynomial([[0, 1, 1, 1, 1, 1]] * 2, 1.0), np.linspace(0, 1, 30))
    found = Cells(along._repr_html_())
    row = next(row for row in found.rows if row[0] == "tau")
    assert row[1] == f"{np.abs(along.torques[0]).max():.5g}"
    assert "img" in found.tags


def test_a_channel_shows_its_largest_values_and_its_curves():
    t = np.linspace(0, 1, 5000)
    names = (HOSTILE_NAME, *(f"joint{j}" for j in range(20)))
    values = np.tile(np.sin(6 * t)[:, None], 21)
    values[1234, 3] = 9.0
    shown = Channel("tau", names, ("N m",) * 21, t, (values,))
    found = Cells(shown._repr_html_())
    assert found.rows[4][:2] == ["joint2", "9"]
    assert found.rows[4][2] == f"{t[1234]:.5g}"
    assert len(found.rows) == 1 + MAX_ROWS_SHOWN
    assert "and 9 more columns" in shown._repr_html_()
    assert "script" not in found.tags
    assert "img" in found.tags
    poses = Channel("C", ("base",), ("1 and m",), t, (np.zeros((5000, 1, 4, 4)),))
    assert poses._repr_html_().startswith("<p>C [1 and m] of base, 5000 times")


def test_results_are_shown_without_matplotlib(monkeypatch, parabola):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    found = Cells(jounce.load("planar2r").forces_along(parabola, [0.0, 1.0], 0)._repr_html_())
    assert "img" not in found.tags
    assert found.rows
