"""Curves over time, by joint or by run, in axes by quantity; differentiated values are rings upon exact lines."""

import re
from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.figures.canvas import INK, LOOK, PRINT, Style, legend_above, line_style, painted, printable_name
from jounce.figures.grid import create_axes_grid, leave_out_labels, page_size
from jounce.figures.limit_lines import LIMIT_ENTRY, OF_LIMITS, VIOLATION, axes_reach, draw_limits, mark_violations
from jounce.figures.panels import EITHER, DrawnRun, Panel, columns_of, drawn_names, find_column, thin_points
from jounce.motion.channel import Channel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

RINGS_PER_CURVE = 24  # differentiated values drawn: the line beneath stays visible
RING_STYLE: Any = {"marker": "o", "linestyle": "none", "mfc": "none", "ms": 4.5, "mew": 0.8}
SAMPLE_STYLE: Any = {"marker": ".", "linestyle": "none", "ms": 2.5, "alpha": 0.25, "zorder": 1.5}
BAND_STYLE: Any = {"linewidth": 6, "alpha": 0.25}
BREAK_STYLE: Any = {"color": "0.5", "linewidth": 1, "linestyle": (0, (2, 2)), "zorder": 0.5}
POWER, RAISED = re.compile(r"\^(\d+)"), r"$^{\1}$"  # of a unit, and as TeX writes it
MARKS = "osD^vP*X"
MAX_JOINT_COLUMNS = 4  # of joints where runs are laid over each other: a page has room for no more
MAX_BAND_SHARE = 0.5  # of the largest value: a wider band is cut, nothing would be visible next to it


@dataclass(frozen=True)
class Trace:
    """The curves of a joint in a run, all of one style: that of a number."""

    run: DrawnRun
    joint: str
    number: int


@dataclass(frozen=True)
class AxesCell:
    """What the axes of every quantity show in one place of their grid, under a title."""

    title: str
    traces: Sequence[Trace]


def draw_curves(
    runs: Sequence[DrawnRun],
    title: str = "",
    columns: Sequence[Sequence[str]] | None = None,
    width: float | None = None,
) -> "Figure":
    """A row of axes per quantity and a column per group of joints, above a common time axis and under one legend.

    Several runs lie side by side in each column, to the same scales. Without `columns` the groups are those of
    `columns_of`. A page of a `width` in inches has the letters of a journal, and as many columns as it is wide enough
    for; the other axes stand below.
    """
    panels = [panel for run in runs for panel in run.panels]
    names = drawn_names(panels)
    cells = [
        AxesCell(run.title, [Trace(run, name, i) for i, name in enumerate(names) if name in column])
        for column in (columns or columns_of(panels)) for run in runs
    ]  # fmt: skip
    return _figure(cells, names, len(cells), len(runs), width, title)


def overlay_runs(runs: Sequence[DrawnRun], width: float | None = None) -> "Figure":
    """Axes for each joint and quantity, in which each of several runs is a curve; `width` as in `draw_curves`."""
    joints = drawn_names([panel for run in runs for panel in run.panels])
    cells = [AxesCell(joint, [Trace(run, joint, i) for i, run in enumerate(runs)]) for joint in joints]
    return _figure(cells, [run.title for run in runs], min(len(cells), MAX_JOINT_COLUMNS), 1, width)


def _figure(
    cells: Sequence[AxesCell], names: Sequence[str], columns: int, alike: int, width: float | None, title: str = ""
) -> "Figure":
    """The axes of all cells, quantity by quantity; groups of `alike` neighbours have the same scales."""
    runs = list({id(trace.run): trace.run for cell in cells for trace in cell.traces}.values())
    panels = [panel for run in runs for panel in run.panels]
    labels = list(dict.fromkeys(panel.channel.symbol for panel in panels))
    size, columns = page_size(columns, alike, len(cells), len(labels), width)

    def paint(figure: "Figure") -> None:
        marks: list[str] = []
        grid = create_axes_grid(figure, len(cells), columns, len(labels))
        for label, row in zip(labels, grid, strict=True):
            of_label = [panel for panel in panels if panel.channel.symbol == label]
            for i, (axes, cell) in enumerate(zip(row, cells, strict=True)):
                if first := i % alike:
                    axes.sharey(row[i - first])
                    axes.tick_params(labelleft=False)
                marks += _draw(axes, cell, label, of_label, len(names))
                if cell.title and (alike == 1 or label == labels[0]):
                    axes.set_title(printable_name(cell.title), parse_math=False)
        leave_out_labels(grid, columns)
        figure.align_ylabels()
        entries = _entries(panels, names, any(run.breaks for run in runs), marks)
        entries |= {run.title: {**entries[run.title], **run.panels[0].style} for run in runs if run.title in names}
        legend_above(figure, entries, title=title or None)

    return painted(paint, *size, LOOK if width is None else PRINT)


def _axis_label(channel: Channel, column: Sequence[str]) -> str:
    """``Q [N m]``, with the units of those joints that the axes show; nothing where they show none."""
    shown = [unit for name, unit in zip(channel.names, channel.units, strict=True) if name in column]
    units = dict.fromkeys(either for unit in shown if unit for either in unit.split(EITHER))
    if not units:
        return channel.symbol if shown else ""
    return f"{channel.symbol} [{EITHER.join(POWER.sub(RAISED, unit) for unit in units)}]"


def _entries(panels: Sequence[Panel], names: Sequence[str], breaks: bool, limits: Container[str]) -> dict[str, Style]:
    """The line styles of the legend, by name."""
    marks = {
        "numerically differentiated": (RING_STYLE, any(panel.differentiated is not None for panel in panels)),
        "measured": (SAMPLE_STYLE | {"ms": 6, "alpha": 0.6}, any(panel.points is not None for panel in panels)),
        "95 % band": (BAND_STYLE, any(panel.has_band(name) for panel in panels for name in panel.channel.names)),
        **{name: (style, name in limits) for name, style in OF_LIMITS.items()},
        "break": (BREAK_STYLE, breaks),
    }
    entries = {name: line_style(i) for i, name in enumerate(names)}
    return entries | {name: {"color": "0.3", **style} for name, (style, drawn) in marks.items() if drawn}


def _draw(axes: "Axes", cell: AxesCell, label: str, panels: Sequence[Panel], count: int) -> list[str]:
    """Draw a quantity, of which there are these panels, in the axes of a cell; what it holds of limits, by name."""
    found = [(trace, panel) for trace in cell.traces for panel in trace.run.panels if panel.channel.symbol == label]
    joints = list(dict.fromkeys(trace.joint for trace in cell.traces))
    height, marks = axes_reach(panels) if len(joints) == 1 else None, []
    for joint in joints:
        of_joint = [(trace, panel) for trace, panel in found if trace.joint == joint and joint in panel.channel.names]
        for trace, panel in of_joint:
            _draw_curve(axes, panel, trace, count)
            marks += [VIOLATION] * mark_violations(axes, panel, joint)
        if of_joint:
            color = line_style(of_joint[0][0].number)["color"] if len(joints) > 1 else INK
            marks += [LIMIT_ENTRY] * draw_limits(axes, [panel for _, panel in of_joint], joint, color, height)
    if found:
        axes.set_ylabel(_axis_label(found[0][1].channel, joints))
    _leave_out_wide_bands(axes, panels, joints)
    for run in {id(trace.run): trace.run for trace in cell.traces}.values():
        for found_break in run.breaks:
            axes.axvline(found_break.t, **BREAK_STYLE)
    axes.margins(x=0.01)
    return marks


def _draw_curve(axes: "Axes", panel: Panel, trace: Trace, count: int) -> None:
    t = panel.channel.times
    apart = max(1, len(t) // RINGS_PER_CURVE)
    i, name = trace.number, trace.joint
    values, style = panel.curve(name), line_style(i)
    shown = thin_points(values)
    if panel.points is not None and name in panel.points.names:
        axes.plot(t[shown], find_column(panel.points, name)[shown], **SAMPLE_STYLE, color=style["color"])
    if panel.has_band(name):
        look = {"color": style["color"], "alpha": BAND_STYLE["alpha"], "linewidth": 0}
        axes.fill_between(t[shown], *(edge[shown] for edge in panel.band(name)), **look)
    if len(t) == 1:  # hollow marks, each another, show all of several in one place
        style = {**style, "marker": MARKS[i % len(MARKS)], "mfc": "none"}
    axes.plot(t[shown], values[shown], **{**style, **panel.style})
    if panel.differentiated is not None:
        at = slice(i * apart // count, None, apart)  # each curve's a little later: no ring on a ring
        axes.plot(t[at], find_column(panel.differentiated, name)[at], **RING_STYLE, color=style["color"])


def _leave_out_wide_bands(axes: "Axes", panels: Sequence[Panel], column: Sequence[str]) -> None:
    """Scale axes to the values that are known: where bands are far wider, as at the ends of a fit, they are cut."""
    curves = [(panel, name) for panel in panels for name in column if name in panel.channel.names]
    peak = max((peak for panel in panels for name, peak in panel.peaks.items() if name in column), default=0.0)
    known = [panel.reach(name) <= MAX_BAND_SHARE * peak for panel, name in curves]
    if all(rows.all() for rows in known) or not any(rows.any() for rows in known):
        return
    shown = [
        values[rows]
        for (panel, name), rows in zip(curves, known, strict=True)
        for points in [panel.points if panel.points is not None and name in panel.points.names else panel.channel]
        for values in (*panel.band(name), find_column(points, name))
    ]
    lowest, highest = (of(np.concatenate(shown)) for of in (np.min, np.max))
    margin = 0.05 * (highest - lowest)
    axes.set_ylim(lowest - margin, highest + margin)
