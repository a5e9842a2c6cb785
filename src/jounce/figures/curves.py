"""Draws curves over time, by joint or by run.

`draw_curves` and `overlay_runs` arrange cells, each with the curves of some joints, in a grid of axes: as many columns
as the page has space for, with the labels of scales once in each row. The axes of a cell show the curves,
differentiated values as rings on exact lines, and limits: lines across, pale bands beyond them, and marks where a curve
exceeds them.
"""

import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.core import cures
from jounce.core.errors import JounceError, quote_value
from jounce.figures import canvas
from jounce.figures.canvas import Style
from jounce.figures.panels import (
    EITHER,
    SAMPLE_STYLE,
    DrawnRun,
    Panel,
    columns_of,
    drawn_names,
    find_column,
    thin_points,
)
from jounce.motion.channel import Channel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


RINGS_PER_CURVE = 24  # differentiated values drawn: the line beneath stays visible
RING_STYLE: Any = {"marker": "o", "linestyle": "none", "mfc": "none", "ms": 4.5, "mew": 0.8}
BAND_STYLE: Any = {"linewidth": 6, "alpha": 0.25}
BREAK_STYLE: Any = {"color": "0.5", "linewidth": 1, "linestyle": (0, (2, 2)), "zorder": 0.5}
POWER, RAISED = re.compile(r"\^(\d+)"), r"$^{\1}$"  # of a unit, and as TeX writes it
MARKS = "osD^vP*X"
MAX_JOINT_COLUMNS = 4  # of joints where runs are laid over each other: a page has room for no more
MAX_BAND_SHARE = 0.5  # of the largest value: a wider band is cut, nothing would be visible next to it


@dataclass(frozen=True)
class Trace:
    """The curves of a joint in a run, with their style."""

    run: DrawnRun
    joint: str
    number: int


@dataclass(frozen=True)
class AxesCell:
    """The traces in one place of the grid of axes.

    The place has a title, and axes for every quantity.
    """

    title: str
    traces: Sequence[Trace]


def draw_curves(
    runs: Sequence[DrawnRun],
    title: str = "",
    columns: Sequence[Sequence[str]] | None = None,
    width: float | None = None,
) -> "Figure":
    """Draw axes by quantity and by groups of joints.

    There is a row of axes per quantity and a column per group of joints. All axes share the time axis and the legend.

    Several runs lie side by side in each column, with the same scales. Without `columns` the groups are those of
    `columns_of`. A page with a `width` in inches has the fonts of a journal, and as many columns as it has space for;
    the other axes stand below.
    """
    panels = [panel for run in runs for panel in run.panels]
    names = drawn_names(panels)
    cells = [
        AxesCell(run.title, [Trace(run, name, i) for i, name in enumerate(names) if name in column])
        for column in (columns or columns_of(panels)) for run in runs
    ]  # fmt: skip
    return _figure(cells, names, len(cells), len(runs), width, title)


def overlay_runs(runs: Sequence[DrawnRun], width: float | None = None) -> "Figure":
    """Draw axes for each joint and quantity, with one curve per run.

    `width` is as in `draw_curves`.
    """
    joints = drawn_names([panel for run in runs for panel in run.panels])
    cells = [AxesCell(joint, [Trace(run, joint, i) for i, run in enumerate(runs)]) for joint in joints]
    return _figure(cells, [run.title for run in runs], min(len(cells), MAX_JOINT_COLUMNS), 1, width)


def _figure(
    cells: Sequence[AxesCell], names: Sequence[str], columns: int, alike: int, width: float | None, title: str = ""
) -> "Figure":
    """Draw the axes of all cells, quantity by quantity.

    Groups of `alike` neighbours have the same scales.
    """
    runs = list({id(trace.run): trace.run for cell in cells for trace in cell.traces}.values())
    panels = [panel for run in runs for panel in run.panels]
    labels = list(dict.fromkeys(panel.channel.symbol for panel in panels))
    size, columns = page_size(columns, alike, len(cells), len(labels), width)

    def paint(figure: "Figure") -> None:
        marks: list[str] = []
        grid = create_axes_grid(figure, len(cells), columns, len(labels))
        for label, row in zip(labels, grid, strict=True):
            panels_of_label = [panel for panel in panels if panel.channel.symbol == label]
            for i, (axes, cell) in enumerate(zip(row, cells, strict=True)):
                # Neighbours of a group share the scale of the first.
                place_in_group = i % alike
                if place_in_group > 0:
                    axes.sharey(row[i - place_in_group])
                    axes.tick_params(labelleft=False)
                marks += _draw(axes, cell, label, panels_of_label, len(names))
                if cell.title and (alike == 1 or label == labels[0]):
                    axes.set_title(canvas.printable_name(cell.title), parse_math=False)
        # The legend needs the widths of all axes, and comes last.
        leave_out_labels(grid, columns)
        figure.align_ylabels()
        entries = _entries(panels, names, any(run.breaks for run in runs), marks)
        entries |= {run.title: {**entries[run.title], **run.panels[0].style} for run in runs if run.title in names}
        canvas.legend_above(figure, entries, title=title or None)

    return canvas.painted(paint, *size, canvas.LOOK if width is None else canvas.PRINT)


def _axis_label(channel: Channel, column: Sequence[str]) -> str:
    """Return ``Q [N m]``, with the units of the joints shown.

    The label is empty if the axes show no joint of the quantity.
    """
    shown_units = [unit for name, unit in zip(channel.names, channel.units, strict=True) if name in column]
    units = dict.fromkeys(alternative for unit in shown_units if unit for alternative in unit.split(EITHER))
    if len(units) == 0:
        return channel.symbol if len(shown_units) > 0 else ""
    return f"{channel.symbol} [{EITHER.join(POWER.sub(RAISED, unit) for unit in units)}]"


def _entries(
    panels: Sequence[Panel], names: Sequence[str], has_breaks: bool, limits: Container[str]
) -> dict[str, Style]:
    """Return the line styles of the legend, by name."""
    optional_entries = {
        "numerically differentiated": (RING_STYLE, any(panel.differentiated is not None for panel in panels)),
        "measured": (SAMPLE_STYLE | {"ms": 6, "alpha": 0.6}, any(panel.points is not None for panel in panels)),
        "95 % band": (BAND_STYLE, any(panel.has_band(name) for panel in panels for name in panel.channel.names)),
        **{name: (style, name in limits) for name, style in OF_LIMITS.items()},
        "break": (BREAK_STYLE, has_breaks),
    }
    entries = {name: canvas.line_style(i) for i, name in enumerate(names)}
    return entries | {
        name: {"color": "0.3", **style} for name, (style, is_drawn) in optional_entries.items() if is_drawn
    }


def _draw(axes: "Axes", cell: AxesCell, label: str, panels: Sequence[Panel], count: int) -> list[str]:
    """Draw a quantity in the axes of a cell.

    Return the names of the marks of limits that are drawn.
    """
    traces = [(trace, panel) for trace in cell.traces for panel in trace.run.panels if panel.channel.symbol == label]
    joints = list(dict.fromkeys(trace.joint for trace in cell.traces))
    # Bands beyond limits would cover the curves of other joints: they are drawn in axes of a single joint.
    height, marks = axes_reach(panels) if len(joints) == 1 else None, []
    for joint in joints:
        traces_of_joint = [
            (trace, panel) for trace, panel in traces if trace.joint == joint and joint in panel.channel.names
        ]
        for trace, panel in traces_of_joint:
            _draw_curve(axes, panel, trace, count)
            if mark_violations(axes, panel, joint):
                marks.append(VIOLATION)
        if len(traces_of_joint) > 0:
            color = canvas.line_style(traces_of_joint[0][0].number)["color"] if len(joints) > 1 else canvas.INK
            if draw_limits(axes, [panel for _, panel in traces_of_joint], joint, color, height):
                marks.append(LIMIT_ENTRY)
    if len(traces) > 0:
        axes.set_ylabel(_axis_label(traces[0][1].channel, joints))
    _leave_out_wide_bands(axes, panels, joints)
    for run in {id(trace.run): trace.run for trace in cell.traces}.values():
        for jump in run.breaks:
            axes.axvline(jump.t, **BREAK_STYLE)
    axes.margins(x=0.01)
    return marks


def _draw_curve(axes: "Axes", panel: Panel, trace: Trace, count: int) -> None:
    """Draw the curve of a joint, with its band, samples and rings."""
    t = panel.channel.times
    ring_spacing = max(1, len(t) // RINGS_PER_CURVE)
    i, name = trace.number, trace.joint
    values, style = panel.curve(name), canvas.line_style(i)
    shown = thin_points(values)
    if panel.points is not None and name in panel.points.names:
        axes.plot(t[shown], find_column(panel.points, name)[shown], **SAMPLE_STYLE, color=style["color"])
    if panel.has_band(name):
        band_look = {"color": style["color"], "alpha": BAND_STYLE["alpha"], "linewidth": 0}
        axes.fill_between(t[shown], *(edge[shown] for edge in panel.band(name)), **band_look)
    # A single state has marks in place of lines; hollow ones of different shapes show all of several in one place.
    if len(t) == 1:
        style = {**style, "marker": MARKS[i % len(MARKS)], "mfc": "none"}
    axes.plot(t[shown], values[shown], **{**style, **panel.style})
    if panel.differentiated is not None:
        # The rings of each curve come a little later than those of the curve before: no ring covers another.
        ring_rows = slice(i * ring_spacing // count, None, ring_spacing)
        axes.plot(t[ring_rows], find_column(panel.differentiated, name)[ring_rows], **RING_STYLE, color=style["color"])


def _leave_out_wide_bands(axes: "Axes", panels: Sequence[Panel], column: Sequence[str]) -> None:
    """Scale axes to the certain values, where bands elsewhere are far wider.

    Such bands are cut, as at the ends of a fit.
    """
    # Values are certain where their band is narrow, as a share of the largest value.
    curves = [(panel, name) for panel in panels for name in column if name in panel.channel.names]
    peak = max((peak for panel in panels for name, peak in panel.peaks.items() if name in column), default=0.0)
    narrow_rows = [panel.reach(name) <= MAX_BAND_SHARE * peak for panel, name in curves]
    if all(rows.all() for rows in narrow_rows) or not any(rows.any() for rows in narrow_rows):
        return
    shown = [
        values[rows]
        for (panel, name), rows in zip(curves, narrow_rows, strict=True)
        for points in [panel.points if panel.points is not None and name in panel.points.names else panel.channel]
        for values in (*panel.band(name), find_column(points, name))
    ]
    values = np.concatenate(shown)
    lowest, highest = values.min(), values.max()
    margin = 0.05 * (highest - lowest)
    axes.set_ylim(lowest - margin, highest + margin)


# Limits in the axes of curves.
LIMIT_STYLE: Any = {"linewidth": 2.4, "alpha": 0.4, "linestyle": "solid", "zorder": 0.8}
VIOLATION_STYLE: Any = {"color": "#eba3ae", "linewidth": 4.5, "marker": "o", "markersize": 4.5, "mew": 0, "zorder": 1.2}
LIMIT_ENTRY, VIOLATION = "limit", "beyond its limit"  # in the legend
OF_LIMITS: Mapping[str, Any] = {LIMIT_ENTRY: LIMIT_STYLE, VIOLATION: VIOLATION_STYLE}
BAND_OPACITY = 0.07  # bands of several joints lie over each other, and curves stay visible
MAX_ROOM_SHARE = 0.2  # of the span of limits: a limit farther from its curve is not drawn, it would flatten the curve


def find_violations(panel: Panel, joint: str) -> np.ndarray:
    """Return whether each value of a curve is beyond a limit."""
    lower, upper = panel.limits(joint)
    values = panel.curve(joint)
    is_beyond: np.ndarray = (values < lower) | (values > upper)
    return is_beyond


def axes_reach(panels: Sequence[Panel]) -> float:
    """Return a height that no axes of these panels reach."""
    limits = [x for panel in panels for bounds in panel.channel.bounds for x in bounds[np.isfinite(bounds)]]
    values = [np.abs(panel.channel.values).max() for panel in panels]
    return 10 * float(max(np.abs([*limits, *values])))


def draw_limits(axes: "Axes", panels: Sequence[Panel], joint: str, color: str, height: float | None) -> bool:
    """Draw the limits that the curves of a joint come near to.

    Return whether there are any.

    Bands reach from them to a height; without it, where other joints share the axes, no bands are drawn.
    """
    from matplotlib.patches import Rectangle

    values = np.concatenate([panel.curve(joint) for panel in panels])
    lower, upper = panels[0].limits(joint)
    has_limits = False
    for limit, distance, side in ((lower, values.min() - lower, -1), (upper, upper - values.max(), 1)):
        # A limit far from the curve would flatten it; a single limit is compared with its own size.
        span = upper - lower if np.isfinite(upper - lower) else 2 * abs(limit)
        if np.isfinite(limit) and distance <= MAX_ROOM_SHARE * span:
            axes.axhline(limit, **LIMIT_STYLE, color=color)
            has_limits = True
            if height is not None:
                band_look: Any = {
                    "transform": axes.get_yaxis_transform(),
                    "color": color,
                    "alpha": BAND_OPACITY,
                    "linewidth": 0,
                }
                band = Rectangle((0, limit), 1, side * height, **band_look, zorder=0.1)
                # Unlike a patch, an artist does not change the scale of the axes.
                axes.add_artist(band)
    return has_limits


def mark_violations(axes: "Axes", panel: Panel, joint: str) -> bool:
    """Mark the curve of a joint where it is beyond a limit.

    Return whether it is anywhere.
    """
    is_beyond = find_violations(panel, joint)
    if is_beyond.any():
        t, values = panel.channel.times, panel.curve(joint)
        shown = thin_points(values)
        axes.plot(t[shown], np.where(is_beyond, values, np.nan)[shown], **VIOLATION_STYLE)
    return bool(is_beyond.any())


# The grid of axes on a page.
MM_PER_INCH = 25.4  # mm
COLUMN_WIDTH, PAGE_WIDTH = 88.9, 181.9  # mm, of the journals of the IEEE; those of Elsevier have 90 and 190
MIN_AXES_WIDTH = 2.1  # inches of a column of axes: its tick labels need it
MIN_PICTURE_WIDTH, MAX_PICTURE_WIDTH = 30.0, 500.0  # mm: below, nothing can be read; above, no paper is as wide


def parse_width(text: str) -> float:
    """Return a width in inches from "column", "page" or mm.

    Raise `JounceError` if it is too narrow or too wide.
    """
    try:
        named = {"column": COLUMN_WIDTH, "page": PAGE_WIDTH}.get(text)
        width = float(text) if named is None else named
    except ValueError:
        width = 0.0
    if not MIN_PICTURE_WIDTH <= width <= MAX_PICTURE_WIDTH:
        raise JounceError(
            f"{cures.option_name('width')} {quote_value(text)};"
            f" expected column, page or {MIN_PICTURE_WIDTH:g} to {MAX_PICTURE_WIDTH:g} mm"
        )
    return width / MM_PER_INCH


def page_size(
    columns: int, alike: int, cells: int, labels: int, width: float | None
) -> tuple[tuple[float, float], int]:
    """Return the size of a page in inches, and its columns.

    A given width may allow fewer columns: if possible, a multiple of `alike`.
    """
    # Every label has as many rows of axes as its cells need columns of.
    if width is None:
        size = 3 + (4.2 if columns < 3 else 3.2) * columns, 0.7 + 2.2 * labels * -(-cells // columns)
        return size, columns
    columns = max(1, min(columns, int(width / MIN_AXES_WIDTH)))
    columns = max(columns - columns % alike, 1)
    row_height = min(2.2, max(1.2, 0.55 * width / columns))
    return (width, 0.5 + row_height * labels * -(-cells // columns)), columns


def create_axes_grid(figure: "Figure", cells: int, columns: int, labels: int) -> "Sequence[Sequence[Axes]]":
    """Create the axes of every cell, label by label, with common times."""
    rows = -(-cells // columns)
    grid = figure.subplots(labels * rows, columns, sharex=True, squeeze=False)
    for axes in grid[-1]:
        axes.set_xlabel("t [s]")
    axes_by_label = [list(grid[k * rows : (k + 1) * rows].flat) for k in range(labels)]
    for k, axes_of_label in enumerate(axes_by_label):
        for i in range(cells, rows * columns):
            axes_of_label[i].remove()
            # The axes above are now the last of their column, and need the labels of times.
            if k == labels - 1 and rows > 1:
                above = axes_of_label[i - columns]
                above.tick_params(labelbottom=True)
                above.set_xlabel("t [s]")
    return [axes_of_label[:cells] for axes_of_label in axes_by_label]


def leave_out_labels(grid: "Sequence[Sequence[Axes]]", columns: int) -> None:
    """Label scales once in each row, and give axes letters.

    Labels of another unit stay. A single pair of axes needs no letter.
    """
    for axes_of_label in grid:
        for i in range(len(axes_of_label) - 1, 0, -1):
            if i % columns and axes_of_label[i - 1].get_ylabel() == axes_of_label[i].get_ylabel():
                axes_of_label[i].set_ylabel("")
    all_axes = [axes for axes_of_label in grid for axes in axes_of_label]
    for i, axes in enumerate(all_axes if len(all_axes) > 1 else []):
        axes.set_title(f"({canvas.axes_letter(i)})", loc="left")
