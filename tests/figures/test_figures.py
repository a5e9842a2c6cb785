"""Pictures: what a reader must be able to see in them is there, and the files are whole, small and repeatable."""

from itertools import combinations

import numpy as np
import pytest
from files import refusal
from hypothesis import given
from matplotlib.colors import to_rgb
from robots import mechanisms

import jounce
from jounce.demo.gallery import portrait
from jounce.figures import canvas
from jounce.figures.curves import MOST_POINTS, Panel, by_size, drawn_points, over_time
from jounce.figures.drawing import View, skeleton
from jounce.figures.schematic import schematic
from jounce.figures.table import panels
from jounce.io import tables

T = np.linspace(0, 2, 501)
CURVES = {f"joint{j}": np.sin((j + 1) * T) for j in range(7)}


def shown(axes):
    """The lines with many points: the curves, without rings and legend entries."""
    return [line for line in axes.get_lines() if len(line.get_xdata()) > 100]


def test_seven_curves_are_told_apart_in_colour_and_in_grey():
    """Each has a dash pattern of its own, on which alone a grey print relies, and a colour of its own."""
    styles = [canvas.line_style(i) for i in range(7)]
    for a, b in combinations(styles, 2):
        assert a["linestyle"] != b["linestyle"]
        assert np.linalg.norm(np.subtract(to_rgb(a["color"]), to_rgb(b["color"]))) > 0.25


def test_many_curves_repeat_no_style():
    styles = [str(canvas.line_style(i)) for i in range(38)]
    assert len(set(styles)) == 38


@pytest.mark.parametrize("small", [False, True])
def test_panels_show_their_values_with_units_and_a_legend_that_hides_nothing(small):
    curves = CURVES | ({"finger": 0.01 * T} if small else {})
    drawn = [Panel("Q [N m]", curves), Panel("Qd [N m/s]", curves, curves)]
    figure = over_time(T, drawn)
    figure.draw_without_rendering()
    grid = np.array(figure.axes).reshape(2, -1)
    assert grid.shape[1] == 1 + small
    assert [axes.get_ylabel() for axes in grid[:, 0]] == ["Q [N m]", "Qd [N m/s]"]
    assert {axes.get_xlabel() for axes in grid[-1]} == {"t [s]"}
    for row in grid:
        lines = [line for axes in row for line in shown(axes)]
        for line, values in zip(lines, curves.values(), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), values)
    [legend] = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [*curves, "numerically differentiated"]
    box = legend.get_window_extent()
    for axes in figure.axes:
        assert not box.overlaps(axes.get_window_extent())


def test_differentiated_values_are_rings_on_the_line_they_were_made_of():
    figure = over_time(T, [Panel("Qd [N m/s]", CURVES, {name: values + 0.25 for name, values in CURVES.items()})])
    [axes] = figure.axes
    rings = [line for line in axes.get_lines() if line.get_marker() == "o" and len(line.get_xdata())]
    for ring, line, values in zip(rings, shown(axes), CURVES.values(), strict=True):
        assert ring.get_markerfacecolor() == "none"  # what lies beneath stays visible
        assert ring.get_color() == line.get_color()
        assert 20 <= len(ring.get_xdata()) <= 30
        np.testing.assert_array_equal(ring.get_ydata(), values[np.searchsorted(T, ring.get_xdata())] + 0.25)
    apart = np.diff(np.sort(np.concatenate([ring.get_xdata() for ring in rings])))
    assert apart.min() > 0


def test_small_curves_have_their_own_scale():
    assert by_size([Panel("", {"a": T, "b": 0.5 * T})]) == [["a", "b"]]
    assert by_size([Panel("", {"a": T, "b": 0.05 * T, "c": T})]) == [["a", "c"], ["b"]]
    assert by_size([Panel("", {"a": 0 * T, "b": 0 * T})]) == [["a", "b"]]


def test_a_table_need_not_hold_every_quantity_of_every_joint():
    """A joint looks the same in all panels, and in the legend, which names all."""
    figure = over_time(T, [Panel("Q", {"a": T, "b": T + 1}), Panel("Qd", {"b": T, "c": 0.01 * T})])
    large_Q, small_Q, large_Qd, small_Qd = ([line.get_color() for line in shown(axes)] for axes in figure.axes)
    a, b, c = (canvas.line_style(i)["color"] for i in range(3))
    assert (large_Q, small_Q, large_Qd, small_Qd) == ([a, b], [], [b], [c])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["a", "b", "c"]


def test_names_stand_in_the_legend_as_they_are():
    """No mark of TeX is one, and no first _ hides a name."""
    names = ["a$x_b$", r"$\frac{", "_hidden", "100%", "a.b", "ü", ""]
    figure = over_time(T, [Panel("Q [N m]", dict.fromkeys(names, T))])
    figure.draw_without_rendering()
    texts = figure.legends[0].get_texts()
    assert [text.get_text() for text in texts] == names
    assert not any(text.get_parse_math() for text in texts)


@pytest.mark.parametrize(("count", "length"), [(8, 40), (40, 6), (40, 200), (1, 2000)])
def test_a_legend_of_many_or_long_names_leaves_the_page_and_its_axes_their_size(count, length):
    figure = over_time(T, [Panel("Q [N m]", {f"{i:02d}" + "x" * length: T for i in range(count)})])
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert figure.bbox.x0 <= box.x0
    assert box.x1 <= figure.bbox.x1
    assert box.y1 <= figure.bbox.y1
    [axes] = figure.axes
    assert axes.get_window_extent().height > 1.5 * figure.dpi
    assert not box.overlaps(axes.get_window_extent())


@pytest.mark.parametrize("count", [1, 2, MOST_POINTS, MOST_POINTS + 1, 3 * MOST_POINTS - 1, 100_003])
def test_of_many_samples_the_ends_and_the_extremes_are_drawn(count):
    """A peak of one sample is what a reader looks for."""
    values = np.random.default_rng(count).normal(size=count)
    values[count // 3], values[count // 2] = -9, 9
    at = drawn_points(values)
    assert (np.diff(at) > 0).all()
    assert len(at) <= MOST_POINTS + 2
    assert {0, count // 2, count - 1} <= set(at.tolist())
    assert values[at].min() == values.min()


def test_one_sample_is_seen():
    figure = over_time(T[:1], [Panel("Q [N m]", {"a": T[:1]})])
    [line] = figure.axes[0].get_lines()
    assert line.get_marker() == "o"


@pytest.mark.parametrize("kind", canvas.FORMATS)
def test_a_picture_is_the_same_file_each_time(tmp_path, kind):
    def content(name):
        canvas.save(over_time(T, [Panel("Q [N m]", CURVES)]), tmp_path / name)
        return (tmp_path / name).read_bytes()

    assert content(f"a.{kind}") == content(f"b.{kind}")
    assert content(f"a.{kind}")[:5] in (b"\x89PNG\r", b"<?xml", b"%PDF-")
    assert len(list(tmp_path.iterdir())) == 2


def test_no_half_of_a_picture_is_left(tmp_path, monkeypatch):
    figure = over_time(T, [Panel("Q [N m]", CURVES)])

    def fails(part, **_):
        part.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(figure, "savefig", fails)
    refusal(lambda: canvas.save(figure, tmp_path / "a.png"), "a.png: cannot be written: No space left")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("azimuth", [-60, 0, 130])
@pytest.mark.parametrize("elevation", [-20, 30, 90])
def test_a_view_is_the_orthogonal_projection_along_its_direction(azimuth, elevation):
    view = View(azimuth, elevation)
    a, e = np.radians([azimuth, elevation])
    towards_the_reader = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    P = view.of(np.eye(3)).T
    np.testing.assert_allclose(P @ P.T, np.eye(2), atol=1e-15)
    np.testing.assert_allclose(P @ towards_the_reader, 0, atol=1e-15)
    np.testing.assert_allclose(np.cross(P[0], P[1]), towards_the_reader, atol=1e-15)  # right-handed: no mirror image


@given(mechanisms())
def test_joint_points_lie_on_their_axes(drawn):
    """A joint that turns moves no point of its own axis, and its centre of mass goes round it."""
    mechanism, rng = drawn
    robot, q = jounce.Robot(mechanism), rng.normal(size=mechanism.n)
    bones = skeleton(mechanism, robot.poses(q))
    for i, X in enumerate(mechanism.X):
        R, r = bones.poses[i, :3, :3], bones.poses[i, :3, 3]
        point = R.T @ (bones.joints[i] - r)
        moved = np.cross(X[:3], point) + X[3:]  # the velocity of a body-fixed point under the unit twist X
        pitch = X[:3] @ X[3:] if X[:3].any() else np.linalg.norm(X[3:])
        np.testing.assert_allclose(R @ moved, pitch * bones.axes[i], atol=1e-12)
        m, h = mechanism.M[i, 3, 3], mechanism.M[i, [2, 0, 1], [4, 5, 3]]  # of m c~, the upper right block
        if m:
            np.testing.assert_allclose(m * R.T @ (bones.coms[i] - r), h, atol=1e-12)
        else:
            assert np.isnan(bones.coms[i]).all()


@pytest.mark.parametrize("picture", [schematic, lambda: portrait(jounce.load("iiwa14"))], ids=["2R", "iiwa"])
def test_drawings_name_frames_axes_and_centres_of_mass(picture):
    figure = picture()
    [axes] = figure.axes
    said = {text.get_text() for text in axes.texts}
    count = 7 if "$e_{7}$" in said else 2
    assert {"x", "y"} <= said  # told apart without colour
    assert {str(i) for i in range(count + 1)} | {f"$c_{{{i}}}$" for i in range(1, count + 1)} <= said
    if count == 2:
        assert {"$q_1$", "$q_2$", "$L_1$", "$L_2$", "$m_1$", "$m_2$", "$g$"} <= said
    else:
        assert {f"$e_{{{i}}}$" for i in range(1, 8)} <= said


@pytest.mark.parametrize("name", ["", "a.b", "two\nlines", "joint.Q", "é"])
def test_a_joint_of_any_name_is_drawn(name):
    [panel] = panels({"t": T, f"{name}.Qd": T}, "f.csv")
    assert list(panel.curves) == [name]


def test_panels_of_a_table(tmp_path):
    columns = tables.of_rates(T, ("a", "b"), "Q", (np.stack([T, -T], 1), np.stack([T**2, T], 1), np.stack([T, T], 1)))
    found = panels(columns, "f.csv")
    assert [panel.label for panel in found] == [
        "Q [N m or N]", "Qd [N m/s or N/s]", "Q2d [N m/s$^{2}$ or N/s$^{2}$]"
    ]  # fmt: skip
    assert (found[1].curves["a"] == T**2).all()
    [only] = panels(columns, "f.csv", ["b"], ["Qd"])
    assert list(only.curves) == ["b"]
    refusal(lambda: panels({"time": T}, "f.csv"), "f.csv: no column 't'; available: time")
    refusal(lambda: panels({"t": T, "a": T}, "f.csv"), "f.csv: no columns NAME.Q", "it has: t, a")
    refusal(lambda: panels(columns, "f.csv", ["c"]), "f.csv: unknown joint 'c'", "available: a, b")
    ragged = {"t": T, "a.Q": T, "b.Qd": T}
    refusal(lambda: panels(ragged, "f.csv", ["a"], ["Qd"]), "f.csv: none of a has a column of Qd")
    refusal(lambda: panels(ragged | {"a.Q": 1e307 * T}, "f.csv"), "f.csv: column 'a.Q' holds 2e+307", "1e+300")
    refusal(lambda: panels(columns, "f.csv", [], ["Q3d"]), "unknown quantity 'Q3d'; did you mean", "Q, Qd, Q2d")


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    refusal(canvas.check_installed, "pictures need matplotlib", "pip install 'jounce[figures]'")
