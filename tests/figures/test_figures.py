"""Pictures: what a reader must be able to see in them is there, and the files are whole, small and repeatable."""

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from lxml import etree
from matplotlib import rc_context
from matplotlib.colors import to_rgb
from paper_robots import iiwa14, planar2r

import jounce
from jounce.figures import canvas
from jounce.figures.curves import (
    BAND_OPACITY,
    COLUMN_WIDTH,
    MM_PER_INCH,
    PAGE_WIDTH,
    VIOLATION_STYLE,
    draw_curves,
    find_violations,
    overlay_runs,
    parse_width,
)
from jounce.figures.drawing import LABEL, View, outline_points, skeleton
from jounce.figures.limit_pictures import draw_limit_ratios, find_ratios
from jounce.figures.panels import (
    MAX_CURVES_PER_AXES,
    MAX_POINTS_DRAWN,
    DrawnRun,
    Panel,
    TableBreak,
    columns_of,
    make_run,
    select_rows,
    thin_points,
)
from jounce.motion import reliability
from jounce.motion.channel import Channel
from support.refusals import expect_refusal, refusal
from support.robots import mechanisms

ROOT = Path(__file__).parents[2]
PICTURES = [*ROOT.glob("docs/pictures/*.svg"), *ROOT.glob("benchmarks/*.svg")]
T = np.linspace(0, 2, 501)
CURVES = {f"joint{j}": np.sin((j + 1) * T) for j in range(7)}


def channel_of(symbol, curves, t=T, units=None, **more):
    """A channel of curves by joint."""
    units = tuple(units or [""] * len(curves))
    return Channel(symbol, tuple(curves), units, t, (np.column_stack([*curves.values()]),), **more)


def panel_of(symbol, curves, differentiated=None, deviations=None, limits=None, **more):
    """The panel of curves by joint."""
    if deviations is not None:
        more["deviations"] = (np.column_stack([deviations[name] for name in curves]),)
    if limits is not None:
        more["bounds"] = (np.array([limits.get(name, (-np.inf, np.inf)) for name in curves]).T,)
    rough = None if differentiated is None else channel_of(symbol, differentiated)
    return Panel(channel_of(symbol, curves, **more), differentiated=rough)


def plots(axes):
    """The lines with many points: the curves, without rings, marks and legend entries."""
    return [
        line
        for line in axes.get_lines()
        if len(line.get_xdata()) > 100 and line.get_color() != VIOLATION_STYLE["color"]
    ]


def legend(figure):
    """The names in the legend, row by row."""
    figure.draw_without_rendering()
    boxes = [(text.get_text(), text.get_window_extent()) for text in figure.legends[0].get_texts()]
    return [name for name, box in sorted(boxes, key=lambda found: (-round(found[1].y0 / 5), found[1].x0))]


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
def test_panels_show_values_units_and_an_unobtrusive_legend(small):
    curves = CURVES | ({"finger": 0.01 * T} if small else {})
    drawn = [panel_of("Q [N m]", curves), panel_of("Qd [N m/s]", curves, curves)]
    figure = draw_curves([DrawnRun(drawn)])
    figure.draw_without_rendering()
    grid = np.array(figure.axes).reshape(2, -1)
    assert grid.shape[1] == 1 + small
    assert [axes.get_ylabel() for axes in grid[:, 0]] == ["Q [N m]", "Qd [N m/s]"]
    assert {axes.get_xlabel() for axes in grid[-1]} == {"t [s]"}
    for row in grid:
        lines = [line for axes in row for line in plots(axes)]
        for line, values in zip(lines, curves.values(), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), values)
    assert legend(figure) == [*curves, "numerically differentiated"]
    box = figure.legends[0].get_window_extent()
    for axes in figure.axes:
        assert not box.overlaps(axes.get_window_extent())


def test_differentiated_values_are_rings_on_their_line():
    figure = draw_curves([DrawnRun([panel_of("Qd", CURVES, {name: values + 0.25 for name, values in CURVES.items()})])])
    [axes] = figure.axes
    rings = [line for line in axes.get_lines() if line.get_marker() == "o" and len(line.get_xdata())]
    for ring, line, values in zip(rings, plots(axes), CURVES.values(), strict=True):
        assert ring.get_markerfacecolor() == "none"  # what lies beneath stays visible
        assert ring.get_color() == line.get_color()
        assert 20 <= len(ring.get_xdata()) <= 30
        np.testing.assert_array_equal(ring.get_ydata(), values[np.searchsorted(T, ring.get_xdata())] + 0.25)
    apart = np.diff(np.sort(np.concatenate([ring.get_xdata() for ring in rings])))
    assert apart.min() > 0


def test_small_curves_have_their_own_scale():
    assert columns_of([panel_of("", {"a": T, "b": 0.5 * T})]) == [["a", "b"]]
    assert columns_of([panel_of("", {"a": T, "b": 0.05 * T, "c": T})]) == [["a", "c"], ["b"]]
    assert columns_of([panel_of("", {"a": 0 * T, "b": 0 * T})]) == [["a", "b"]]


def test_a_crowd_is_spread_over_columns_in_its_order():
    names = [f"{i}" for i in range(29)]
    columns = columns_of([panel_of("", dict.fromkeys(names, T))])
    assert [name for column in columns for name in column] == names
    assert [len(column) for column in columns] == [10, 10, 9]
    assert len(columns_of([panel_of("", dict.fromkeys(map(str, range(300)), T))])) <= 6
    assert len(columns_of([panel_of("", dict.fromkeys(names[:MAX_CURVES_PER_AXES], T))])) == 1


def test_a_table_need_not_hold_every_quantity_of_every_joint():
    """A joint looks the same in all panels, and in the legend, which names all."""
    figure = draw_curves([DrawnRun([panel_of("Q", {"a": T, "b": T + 1}), panel_of("Qd", {"b": T, "c": 0.01 * T})])])
    large_Q, small_Q, large_Qd, small_Qd = ([line.get_color() for line in plots(axes)] for axes in figure.axes)
    a, b, c = (canvas.line_style(i)["color"] for i in range(3))
    assert (large_Q, small_Q, large_Qd, small_Qd) == ([a, b], [], [b], [c])
    assert legend(figure) == ["a", "b", "c"]


def test_names_stand_in_the_legend_as_they_are():
    """No mark of TeX is one, and no first _ hides a name."""
    names = ["a$x_b$", r"$\frac{", "_hidden", "100%", "a.b", "ü", ""]
    figure = draw_curves([DrawnRun([panel_of("Q", dict.fromkeys(names, T))])])
    assert set(legend(figure)) == set(names)
    assert not any(text.get_parse_math() for text in figure.legends[0].get_texts())


@pytest.mark.parametrize(("count", "length"), [(8, 40), (40, 6), (40, 200), (1, 2000)])
def test_a_large_legend_leaves_page_and_axes_their_size(count, length):
    figure = draw_curves([DrawnRun([panel_of("Q", {f"{i:02d}" + "x" * length: T for i in range(count)})])])
    figure.draw_without_rendering()
    box = figure.legends[0].get_window_extent()
    assert figure.bbox.x0 <= box.x0
    assert box.x1 <= figure.bbox.x1
    assert box.y1 <= figure.bbox.y1
    for axes in figure.axes:
        assert axes.get_window_extent().height > 1.5 * figure.dpi
        assert not box.overlaps(axes.get_window_extent())


@pytest.mark.parametrize("count", [1, 2, MAX_POINTS_DRAWN, MAX_POINTS_DRAWN + 1, 3 * MAX_POINTS_DRAWN - 1, 100_003])
def test_of_many_samples_the_ends_and_the_extremes_are_drawn(count):
    """A peak of one sample is what a reader looks for."""
    values = np.random.default_rng(count).normal(size=count)
    values[count // 3], values[count // 2] = -9, 9
    at = thin_points(values)
    assert (np.diff(at) > 0).all()
    assert len(at) <= MAX_POINTS_DRAWN + 2
    assert {0, count // 2, count - 1} <= set(at.tolist())
    assert values[at].min() == values.min()


def test_one_sample_is_seen():
    figure = draw_curves([DrawnRun([panel_of("Q", {"a": T[:1]}, t=T[:1])])])
    [line] = figure.axes[0].get_lines()
    assert line.get_marker() == "o"


@pytest.mark.parametrize("kind", canvas.PICTURE_FORMATS)
def test_a_picture_is_the_same_file_each_time(tmp_path, kind):
    def content(name):
        canvas.save(draw_curves([DrawnRun([panel_of("Q", CURVES)])]), tmp_path / name)
        return (tmp_path / name).read_bytes()

    assert content(f"a.{kind}") == content(f"b.{kind}")
    assert content(f"a.{kind}")[:5] in (b"\x89PNG\r", b"<?xml", b"%PDF-")
    assert len(list(tmp_path.iterdir())) == 2


def luminance(colour):
    """Of WCAG 2, of an sRGB colour."""
    c = np.asarray(colour)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


def contrast(a, b):
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


def test_an_svg_is_dark_on_dark_pages(tmp_path):
    """The filter that a browser applies there leaves all ink at least as much contrast as it has on white."""
    canvas.save(draw_curves([DrawnRun([panel_of("Q", CURVES)])]), tmp_path / "a.svg")
    style = etree.parse(tmp_path / "a.svg").find(".//{*}style").text
    assert canvas.DARK.decode() in style
    inverted, brighter = (float(re.search(rf"{name}\((.*?)\)", style)[1]) for name in ("invert", "brightness"))
    grey = np.full((3, 3), [0.213, 0.715, 0.072])  # of the specification's hue-rotate

    def filtered(colour):
        turned = (2 * grey - np.eye(3)) @ ((1 - 2 * inverted) * np.array(to_rgb(colour)) + inverted)
        return np.clip(brighter * np.clip(turned, 0, 1), 0, 1)

    page = filtered("white")
    assert page.max() < 0.15
    for colour in (*canvas.COLOURS, canvas.INK):
        assert contrast(filtered(colour), page) > min(4, contrast(to_rgb(colour), (1, 1, 1)))


@pytest.mark.parametrize(
    "path", sorted([*ROOT.glob("docs/pictures/*.svg"), *ROOT.glob("benchmarks/*.svg")]), ids=lambda p: p.name
)
def test_pictures_of_the_pages_are_dark_on_dark_pages(path):
    """What matplotlib wrote has the rule for dark pages; the others are drawn by hand."""
    content = path.read_bytes()
    assert (b"Matplotlib" in content) == (canvas.DARK in content)


def test_paths_of_an_svg_are_short_and_where_they_were(tmp_path):
    with rc_context(canvas.LOOK):
        draw_curves([DrawnRun([panel_of("Q", CURVES)])]).savefig(tmp_path / "long.svg")
    canvas.save(draw_curves([DrawnRun([panel_of("Q", CURVES)])]), tmp_path / "short.svg")

    def paths(name):
        return etree.parse(tmp_path / name).xpath("//*/@d")

    def numbers(path):
        return np.array(re.findall(r"-?[\d.]+", path), dtype=float)

    for long, short in zip(paths("long.svg"), paths("short.svg"), strict=True):
        assert "\n" not in short
        assert re.sub(r"[-\d.\s]", "", short) == re.sub(r"[-\d.\s]", "", long)
        np.testing.assert_allclose(numbers(short), numbers(long), atol=0.00501)


def test_no_half_of_a_picture_is_left(tmp_path, monkeypatch):
    figure = draw_curves([DrawnRun([panel_of("Q", CURVES)])])

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
    bones = skeleton(mechanism, robot.poses(q, method="recursion"))
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


@pytest.mark.parametrize("picture", [planar2r, iiwa14], ids=["2R", "iiwa"])
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


@pytest.mark.parametrize("picture", [planar2r, iiwa14], ids=["2R", "iiwa"])
def test_labels_cover_neither_each_other_nor_what_is_drawn(picture):
    figure = picture()
    figure.draw_without_rendering()
    [axes] = figure.axes
    labels = [text for text in axes.texts if text.get_gid() == LABEL]
    assert len(labels) == len([text for text in axes.texts if text.get_text()])
    boxes = [text.get_window_extent() for text in labels]
    for (a, first), (b, second) in combinations(zip(boxes, labels, strict=True), 2):
        assert not a.overlaps(b), f"{first.get_text()} on {second.get_text()}"
    points = outline_points(axes)
    assert len(points) > 500
    assert all(figure.bbox.contains(*point) for point in points)
    covering = [text.get_text() for box, text in zip(boxes, labels, strict=True) if box.count_contains(points)]
    assert covering == []


@pytest.mark.parametrize("name", ["", "a.b", "two\nlines", "joint.Q", "é"])
def test_a_joint_of_any_name_is_drawn(name):
    [panel] = make_run({"t": T, f"{name}.Qd": T}, "f.csv").panels
    assert panel.channel.names == (name,)


def test_panels_of_a_table(tmp_path):
    columns = {"t": T, "a.Q": T, "a.Qd": T**2, "a.Q2d": T, "b.Q": -T, "b.Qd": T, "b.Q2d": T}
    run = make_run(columns, "f.csv")
    assert [panel.channel.symbol for panel in run.panels] == ["Q", "Qd", "Q2d"]
    assert (run.panels[1].curve("a") == T**2).all()
    assert [axes.get_ylabel() for axes in draw_curves([run]).axes] == [
        "Q [N m or N]", "Qd [N m/s or N/s]", "Q2d [N m/s$^{2}$ or N/s$^{2}$]"
    ]  # fmt: skip
    [only] = make_run(columns, "f.csv", ["b"], ["Qd"]).panels
    assert only.channel.names == ("b",)
    refusal(lambda: make_run({"time": T, "a.Q": T}, "f.csv"), "f.csv: no column 't'; available: time")
    log = {"time": T, "a": T}
    with expect_refusal("no columns NAME.Q", "available: time, a", "`jounce motion ROBOT f.csv -o OUT`"):
        make_run(log, "f.csv")
    refusal(lambda: make_run(columns, "f.csv", ["c"]), "f.csv: unknown joint 'c'", "available: a, b")
    ragged = {"t": T, "a.Q": T, "b.Qd": T}
    refusal(lambda: make_run(ragged, "f.csv", ["a"], ["Qd"]), "f.csv: none of a has a column of Qd")
    refusal(lambda: make_run(ragged | {"a.Q": 1e307 * T}, "f.csv"), "f.csv: column 'a.Q' holds 2e+307", "1e+300")
    refusal(lambda: make_run(columns, "f.csv", [], ["Q3d"]), "unknown quantity 'Q3d'; did you mean", "Q, Qd, Q2d")


def test_a_table_of_no_robot_says_which_units_may_be_meant():
    """Deviations of one joint are no band of another, nor do they hide its peak; units of the base are known."""
    columns = {"t": T, "a.Q": 9 - T, "b.Q": T, "b.Q_sd": 0.1 * T, "base.fx.Q": T, "b.Q_measured": T + 1}
    [panel] = make_run(columns, "f.csv").panels
    assert panel.channel.units == ("N m or N", "N m or N", "N")
    assert [panel.has_band(name) for name in panel.channel.names] == [False, True, False]
    assert panel.peaks == {"a": 9.0, "b": 2.0, "base.fx": 2.0}
    assert panel.points.names == ("b",)
    [alone] = make_run(columns, "f.csv", ["a"]).panels
    assert alone.channel.deviations is None
    assert alone.points is None, "the legend says nothing of what is not drawn"


def test_some_rows_of_a_table():
    columns = {"t": T, "a.Q": T}
    assert select_rows(columns, "f.csv", None) is columns
    assert np.array_equal(select_rows(columns, "f.csv", (0.5, 1.0))["a.Q"], T[(T >= 0.5) & (T <= 1)])
    refusal(lambda: select_rows(columns, "f.csv", (2.5, 3)), "f.csv: no rows between t = 2.5 and 3 s", "t = 0 .. 2 s")


def test_where_bands_are_wide_they_are_cut_and_the_rest_is_seen():
    """The ends of a fit: values and bands that are powers of ten larger hide nothing, nor move a curve elsewhere."""
    wild = np.where(T < 0.1, 1e6, 0.0)
    curves = {"a": np.sin(T) + wild, "b": np.cos(T)}
    deviations = {"a": 0.01 + wild, "b": np.full(len(T), 0.02)}
    figure = draw_curves([DrawnRun([panel_of("Qd", curves, deviations=deviations)])])
    [axes] = figure.axes
    low, high = axes.get_ylim()
    assert low < np.cos(2) - reliability.BAND_DEVIATIONS * 0.02
    assert 1 + reliability.BAND_DEVIATIONS * 0.02 < high < 1.5
    [exact] = draw_curves([DrawnRun([panel_of("Qd", curves)])]).axes[:1]
    assert exact.get_ylim()[1] > 1e6  # a value that is certain is shown


def test_several_runs_have_one_scale_where_bands_are_cut():
    wild = np.where(T < 0.1, 1e6, 0.0)
    runs = [DrawnRun([panel_of("Qd", {"a": k * np.sin(T) + wild}, deviations={"a": 0.01 + wild})]) for k in (3, 1)]
    assert all(3 < axes.get_ylim()[1] < 4 for axes in draw_curves(runs).axes)


def test_residuals_are_dots():
    run = make_run({"t": T, "a.q": T, "a.q_sample": T + 1e-3}, "f.csv")
    [line] = [line for line in draw_curves([run]).axes[1].get_lines() if len(line.get_xdata())]
    assert (line.get_marker(), line.get_linestyle()) == (".", "None")


def test_q_stands_above_Q_and_rates_below_what_they_are_rates_of():
    names = ["a.Q2d", "a.Qd", "a.q10d", "a.q2d", "a.Q", "a.q"]
    assert [panel.channel.symbol for panel in make_run({"t": T} | dict.fromkeys(names, T), "f.csv").panels] == [
        "q", "q2d", "q10d", "Q", "Qd", "Q2d"
    ]  # fmt: skip


def panda_table(t=T, scale=1.0):
    """A table of the panda, whose last joint is prismatic, with its joints from last to first."""
    robot = jounce.load("panda")
    return robot.mechanism, {"t": t} | {
        f"{name}.{quantity}": scale * (i + 1) * np.sin(t + i)
        for i, name in enumerate(robot.joint_names[::-1]) for quantity in ("Q", "q")
    }  # fmt: skip


def test_a_robot_tells_order_units_and_limits_of_its_joints():
    mechanism, columns = panda_table()
    figure = draw_curves([make_run(columns, "f.csv", mechanism=mechanism)])
    assert legend(figure) == [*mechanism.coordinates, "limit", "beyond its limit"]
    q_arm, q_finger, Q_arm, Q_finger = figure.axes
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["q [rad]", "q [m]", "Q [N m]", "Q [N]"]
    assert [axes.get_title("left") for axes in figure.axes] == ["(a)", "(b)", "(c)", "(d)"]
    assert (len(plots(q_arm)), len(plots(q_finger)), len(plots(Q_arm)), len(plots(Q_finger))) == (7, 1, 7, 1)
    levels = {line.get_ydata()[0] for line in q_arm.get_lines() if len(line.get_xdata()) == 2}
    assert levels
    assert levels <= {*mechanism.limits.lower, *mechanism.limits.upper}
    foreign = columns | {"wheel.Q": T}
    with expect_refusal("f.csv: unknown joint of panda 'wheel'", "panda_joint1"):
        make_run(foreign, "f.csv", mechanism=mechanism)


def test_limits_are_drawn_where_curves_come_near_or_exceed_them():
    """All limits of all joints would hide the curves, and those far away would squeeze them."""
    q = {"a": np.sin(9 * T), "b": T - 1, "c": 2 * T, "d": 0 * T, "e": 5 * T}
    limits = {"a": (-1.2, 50.0), "b": (-np.inf, np.inf), "c": (-20.0, 20.0), "d": (0.1, np.inf), "e": (-3.0, 3.0)}
    figure = draw_curves([DrawnRun([panel_of("q", q, limits=limits)])])
    drawn = [line for axes in figure.axes for line in axes.get_lines() if len(line.get_xdata()) == 2]
    a, d, e = (canvas.line_style(i)["color"] for i in (0, 3, 4))
    assert {(line.get_color(), line.get_ydata()[0]) for line in drawn} == {(a, -1.2), (d, 0.1), (e, 3.0)}


def bands(axes):
    """The edges of the bands of limits, from the limit outwards."""
    return [(patch.get_y(), np.sign(patch.get_height())) for patch in axes.patches if patch.get_alpha() == BAND_OPACITY]


def test_bands_beyond_the_limits_do_not_change_the_scale():
    q = {"a": np.sin(9 * T)}
    [axes] = draw_curves([DrawnRun([panel_of("q", q, limits={"a": (-1.1, 1.05)})])]).axes
    assert bands(axes) == [(-1.1, -1), (1.05, 1)]
    assert -1.3 < axes.get_ylim()[0] < axes.get_ylim()[1] < 1.3
    [axes] = draw_curves([DrawnRun([panel_of("q", q | {"b": T}, limits={"a": (-1.1, 1.05)})])]).axes
    assert bands(axes) == []  # the other curve may well be there


def test_ratios_to_limits_are_those_of_the_check_by_joint():
    """Of loops that are closed too, in which coordinates are not the first of the joints."""
    robot = jounce.load("fivebar").with_limits(velocity=1.0)
    motion = jounce.Motion.polynomial([[1.2, 0.3], [1.9, 0.3]], 1.0)
    peaks = {
        (of.symbol, name): x
        for of in find_ratios(robot, motion)
        for name, x in zip(of.names, of.values.max(0), strict=True)
    }
    for row in robot.check(motion).table:
        assert peaks[row.limit, row.joint] == pytest.approx(row.ratio, rel=1e-6)
    assert legend(draw_limit_ratios(robot, motion)) == ["left_shoulder", "right_shoulder", "limit"]


@pytest.mark.parametrize("draw", [draw_curves, overlay_runs])
def test_what_is_beyond_a_limit_is_marked_sample_by_sample(draw):
    panel = panel_of("Q", {"a": 2 * np.sin(9 * T), "b": T}, limits={"a": (-np.inf, 1.5), "b": (0.0, 2.0)})
    lines = [line for axes in draw([DrawnRun([panel])]).axes for line in axes.get_lines()]
    [mark] = [line for line in lines if line.get_color() == VIOLATION_STYLE["color"]]
    outside = 2 * np.sin(9 * T) > 1.5
    np.testing.assert_array_equal(mark.get_ydata(), np.where(outside, 2 * np.sin(9 * T), np.nan))
    np.testing.assert_array_equal(find_violations(panel, "a"), outside)
    assert not find_violations(panel, "b").any()  # on the limit is not beyond it


def test_a_single_sample_beyond_a_limit_is_seen_among_many():
    t = np.linspace(0, 1, 10 * MAX_POINTS_DRAWN)
    Q = np.zeros(len(t))
    Q[7777] = 9
    [axes] = draw_curves([DrawnRun([panel_of("Q", {"a": Q}, limits={"a": (-1, 1)}, t=t)])]).axes
    [mark] = [line for line in axes.get_lines() if line.get_color() == VIOLATION_STYLE["color"]]
    assert (mark.get_xdata()[np.isfinite(mark.get_ydata())] == t[7777]).all()
    assert mark.get_marker() == "o"


def test_overlaid_runs_are_curves_in_the_axes_of_each_joint():
    """Told apart in colour and in grey; a limit of the joint is drawn once."""
    limits = {"a": (-1.0, 2.1)}
    first = DrawnRun(
        [panel_of("Q", {"a": T, "b": 0.01 * T}, limits=limits), panel_of("Qd", {"a": T})], title="first.csv"
    )
    Q = panel_of("Q", {"b": 3 * T, "a": T / 2}, limits=limits, t=2 * T, breaks=(TableBreak(0.5, 0),))
    second = DrawnRun([Q], title="second.csv")
    figure = overlay_runs([first, second])
    assert [axes.get_title() for axes in figure.axes] == ["a", "b"] * 2
    styles = [canvas.line_style(i)["color"] for i in range(2)]
    assert [[line.get_color() for line in plots(axes)] for axes in figure.axes] == [styles, styles, styles[:1], []]
    np.testing.assert_array_equal(plots(figure.axes[1])[1].get_xdata(), 2 * T)
    assert bands(figure.axes[0]) == [(2.1, 1)]
    assert legend(figure) == ["first.csv", "second.csv", "limit", "break"]


@pytest.mark.parametrize(("draw", "width", "columns"), [(draw_curves, PAGE_WIDTH, 3), (overlay_runs, COLUMN_WIDTH, 1)])
def test_a_journal_page_has_its_width_font_and_legible_columns(tmp_path, draw, width, columns):
    names = ("a", "b", "c", "d")
    runs = [DrawnRun([panel_of("Q", dict.fromkeys(names, T), units=("N m", "N", "s", "kg"))])]
    figure = draw(runs, width=width / MM_PER_INCH)
    canvas.save(figure, tmp_path / "a.svg", canvas.PRINT)
    root = etree.parse(tmp_path / "a.svg").getroot()
    assert float(root.get("width").removesuffix("pt")) == pytest.approx(width * 72 / MM_PER_INCH, abs=0.1)
    assert len({round(axes.get_position().x0, 2) for axes in figure.axes}) == columns
    last = [max(figure.axes, key=lambda axes: (axes.get_position().x0 == x, -axes.get_position().y0))
            for x in {axes.get_position().x0 for axes in figure.axes}]  # fmt: skip
    assert [axes.get_xlabel() for axes in last] == ["t [s]"] * len(last)
    for axes in figure.axes:
        assert axes.get_window_extent().height > 0.5 * figure.dpi
        assert axes.title.get_fontsize() == 8


@pytest.mark.parametrize(("text", "mm"), [("column", 88.9), ("page", 181.9), ("90", 90), ("140.5", 140.5)])
def test_widths_of_journals(text, mm):
    assert parse_width(text) == pytest.approx(mm / 25.4)


@pytest.mark.parametrize("text", ["", "wide", "0", "nan", "inf", "-90", "29", "501", "90mm"])
def test_other_widths_are_refused(text):
    refusal(lambda: parse_width(text), f"width {text!r}; expected column, page or 30 to 500 mm")


def test_runs_side_by_side_share_columns_and_scales():
    """The small one of one run is small in the other, and a joint looks the same in both."""
    first = DrawnRun([panel_of("Q", {"a": T, "b": 0.01 * T})], title="first.csv")
    second = DrawnRun([panel_of("Q", {"b": 3 * T, "a": 2 * T}, t=2 * T)], title="second.csv")
    figure = draw_curves([first, second])
    grid = figure.axes
    assert [axes.get_title() for axes in grid] == ["first.csv", "second.csv"] * 2
    a, b = (canvas.line_style(i)["color"] for i in range(2))
    assert [[line.get_color() for line in plots(axes)] for axes in grid] == [[a], [a], [b], [b]]
    for left, right in (grid[:2], grid[2:]):
        assert left.get_ylim() == right.get_ylim()
        assert left.get_xlim() == right.get_xlim()


def test_names_whose_letters_the_font_lacks_are_escaped():
    """matplotlib would warn, and draw boxes."""
    figure = draw_curves([DrawnRun([panel_of("Q", {"漢é": T})])])
    assert legend(figure) == [r"\u6f22é"]


def test_a_legend_is_read_row_by_row():
    figure = draw_curves([DrawnRun([panel_of("Q", {f"{i:02d}" + "x" * 12: T for i in range(9)})])])
    assert legend(figure) == sorted(legend(figure))
    rows = [round(text.get_window_extent().y0) for text in figure.legends[0].get_texts()]
    assert max(map(rows.count, rows)) - min(map(rows.count, rows)) <= 1


def test_more_axes_than_letters():
    assert [canvas.axes_letter(i) for i in (0, 25, 26, 51, 52, 701, 702)] == ["a", "z", "aa", "az", "ba", "zz", "aaa"]


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    refusal(canvas.check_installed, "pictures need matplotlib", "pip install 'jounce[figures]'")
