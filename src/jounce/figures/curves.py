"""Curves over time: a row of axes per quantity, a curve per joint, differentiated values as rings upon exact lines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.figures.canvas import legend_above, letter, line_style, painted, written
from jounce.motion.bands import COVERS, surest_peaks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_POINTS = 2000  # of a curve, about; a page shows no more
RINGS = 24  # differentiated values drawn of each curve, so that the line beneath stays visible
RING: Any = {"marker": "o", "linestyle": "none", "mfc": "none", "ms": 4.5, "mew": 0.8}
POINT: Any = {"marker": ".", "linestyle": "none", "ms": 2.5, "alpha": 0.25, "zorder": 1.5}
BAND: Any = {"linewidth": 6, "alpha": 0.25}
BREAK: Any = {"color": "0.5", "linewidth": 1, "linestyle": (0, (2, 2)), "zorder": 0.5}
LIMIT: Any = {"linewidth": 2.4, "alpha": 0.4, "linestyle": "solid", "zorder": 0.8}
MARKS = "osD^vP*X"
HIDDEN = 0.1  # of the largest value: a curve below this tells nothing in the same axes
CROWD = 10  # curves that a reader can follow in the same axes
WIDEST = 6  # columns that crowds are spread over
TOLD = 0.5  # of the largest value: a band that reaches further than this leaves nothing visible next to it
NEAR = 0.2  # of the span of limits: how close to one a curve comes where it is drawn


@dataclass(frozen=True)
class Panel:
    """A quantity over time: its values by joint, and if given those that differentiation makes of them."""

    label: str
    curves: Mapping[str, np.ndarray]
    differentiated: Mapping[str, np.ndarray] | None = None
    points: Mapping[str, np.ndarray] = field(default_factory=dict)  # measured ones, which the curves should follow
    deviations: Mapping[str, np.ndarray] = field(default_factory=dict)  # standard ones, drawn as bands of 95 %
    units: Mapping[str, str] = field(default_factory=dict)  # of the quantity, by the unit of the joint: rad, m
    joint_units: Mapping[str, str] = field(default_factory=dict)  # by joint; of some or of none where unknown
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # by joint, infinite where not stated
    style: Mapping[str, Any] = field(default_factory=dict)  # of values that are no curves

    def reach(self, name: str) -> np.ndarray:
        """How far the band of a curve reaches on either side of it."""
        return COVERS * self._deviations(name)

    def band(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """The lower and the upper edge of the band of a curve."""
        return self.curves[name] - self.reach(name), self.curves[name] + self.reach(name)

    def peak(self, name: str) -> float:
        """The largest absolute value of a curve, that of its wild ends left out."""
        return float(surest_peaks(self.curves[name], self._deviations(name))[0])

    def _deviations(self, name: str) -> np.ndarray:
        return self.deviations.get(name, np.zeros(len(self.curves[name])))


@dataclass(frozen=True)
class Run:
    """The panels of a table over its times; breaks are upright lines."""

    t: np.ndarray
    panels: Sequence[Panel]
    breaks: Sequence[float] = ()
    title: str = ""


def over_time(runs: Sequence[Run], title: str = "", columns: Sequence[Sequence[str]] | None = None) -> "Figure":
    """A row of axes per quantity and a column per group of joints, above a common time axis and under one legend.

    Several runs lie side by side in each column, to the same scales. Without `columns` the groups are those of
    `columns_of`.
    """
    panels = [panel for run in runs for panel in run.panels]
    names, labels = _names(panels), list(dict.fromkeys(panel.label for panel in panels))
    cells = [(column, run) for column in (columns or columns_of(panels)) for run in runs]

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(labels), len(cells), sharex=True, squeeze=False)
        limited = False
        for row, label in zip(grid, labels, strict=True):
            for i, (axes, (column, run)) in enumerate(zip(row, cells, strict=True)):
                if first := i % len(runs):
                    axes.sharey(row[i - first])
                    axes.tick_params(labelleft=False)
                for panel in run.panels:
                    if panel.label == label:
                        _draw(axes, run.t, panel, column, names)
                        limited |= _draw_limits(axes, panel, column, names)
                        axes.set_ylabel(_axis_label(panel, column))
                _leave_out_wide_bands(axes, [panel for panel in panels if panel.label == label], column)
                for at in run.breaks:
                    axes.axvline(at, **BREAK)
        _write_titles(grid, [run.title for _, run in cells])
        figure.align_ylabels(grid)
        legend_above(figure, _entries(panels, names, any(run.breaks for run in runs), limited), title=title or None)

    return painted(paint, 3 + (4.2 if len(cells) < 3 else 3.2) * len(cells), 0.7 + 2.2 * len(labels))


def _write_titles(grid: np.ndarray, titles: Sequence[str]) -> None:
    """The titles of the columns, letters of the axes, and labels of the scales, once in each row of one unit."""
    for row in grid:
        for axes, left in reversed(list(zip(row[1:], row, strict=False))):
            if axes.get_ylabel() == left.get_ylabel():
                axes.set_ylabel("")
    for axes, title in zip(grid[0], titles, strict=True):
        axes.set_title(written(title), parse_math=False)
    for axes in grid[-1]:
        axes.set_xlabel("t [s]")
    if grid.size > 1:
        for i, axes in enumerate(grid.flat):
            axes.set_title(f"({letter(i)})", loc="left")


def columns_of(panels: Sequence[Panel]) -> list[list[str]]:
    """The joints of each column of axes: of one unit, of sizes that can be seen together, and not too many."""
    names = _names(panels)
    units = {name: unit for panel in panels for name, unit in panel.joint_units.items()}
    alike = [[name for name in names if units.get(name) == unit] for unit in dict.fromkeys(map(units.get, names))]
    most = max(CROWD, -(-len(names) // WIDEST))
    return [
        [str(name) for name in column]
        for group in alike for sized in by_size(panels, group)
        for column in np.array_split(sized, -(-len(sized) // most))
    ]  # fmt: skip


def by_size(panels: Sequence[Panel], names: Sequence[str]) -> list[list[str]]:
    """Curves in one column, or in two, large and small, if one is hidden by the largest of its panel."""
    small = set()
    for panel in panels:
        peaks = {name: panel.peak(name) for name in names if name in panel.curves}
        small |= {name for name, peak in peaks.items() if peak < HIDDEN * max(peaks.values())}
    columns = [[name for name in names if (name in small) == side] for side in (False, True)]
    return [column for column in columns if column]


def drawn_points(values: np.ndarray, most: int = MOST_POINTS) -> np.ndarray:
    """The indices of the samples that a page shows: of many the ends, in each short piece the first and the extremes.

    Extremes alone would make a ring of a cloud of dots.
    """
    if len(values) <= most:
        return np.arange(len(values))
    starts = np.linspace(0, len(values), most // 3, endpoint=False).astype(int)
    extremes = [
        start + at for start, piece in zip(starts, np.split(values, starts[1:]), strict=True)
        for at in (0, piece.argmin(), piece.argmax())
    ]  # fmt: skip
    return np.unique([*extremes, len(values) - 1])


def _names(panels: Sequence[Panel]) -> list[str]:
    """The curves of all panels: a table need not hold every quantity of every joint."""
    return list(dict.fromkeys(name for panel in panels for name in panel.curves))


def _axis_label(panel: Panel, column: Sequence[str]) -> str:
    """``Q [N m]``, with the units of those joints that the axes show; nothing where they show none."""
    of = {panel.joint_units.get(name) for name in column if name in panel.curves}
    units = [unit for joint_unit, unit in panel.units.items() if None in of or joint_unit in of]
    return f"{panel.label} [{' or '.join(units)}]" if units else panel.label if of else ""


def _entries(panels: Sequence[Panel], names: Sequence[str], breaks: bool, limits: bool) -> dict[str, dict[str, Any]]:
    """The line styles of the legend, by name."""
    marks = {
        "numerically differentiated": (RING, any(panel.differentiated for panel in panels)),
        "measured": (POINT | {"ms": 6, "alpha": 0.6}, any(panel.points for panel in panels)),
        "95 % band": (BAND, any(panel.deviations for panel in panels)),
        "limit": (LIMIT, limits),
        "break": (BREAK, breaks),
    }
    entries = {name: line_style(i) for i, name in enumerate(names)}
    return entries | {name: {"color": "0.3"} | style for name, (style, drawn) in marks.items() if drawn}


def _draw(axes: "Axes", t: np.ndarray, panel: Panel, column: Sequence[str], names: Sequence[str]) -> None:
    apart = max(1, len(t) // RINGS)
    for i, name in enumerate(names):
        if name not in column or name not in panel.curves:
            continue
        values, style = panel.curves[name], line_style(i)
        shown = drawn_points(values)
        if name in panel.points:
            axes.plot(t[shown], panel.points[name][shown], **POINT, color=style["color"])
        if name in panel.deviations:
            look = {"color": style["color"], "alpha": BAND["alpha"], "linewidth": 0}
            axes.fill_between(t[shown], *(edge[shown] for edge in panel.band(name)), **look)
        if len(t) == 1:  # hollow marks, each another, show all of several in one place
            style |= {"marker": MARKS[i % len(MARKS)], "mfc": "none"}
        axes.plot(t[shown], values[shown], **{**style, **panel.style})
        if panel.differentiated:
            at = slice(i * apart // len(names), None, apart)  # each curve's a little later: no ring on a ring
            axes.plot(t[at], panel.differentiated[name][at], **RING, color=style["color"])
    axes.margins(x=0.01)


def _leave_out_wide_bands(axes: "Axes", panels: Sequence[Panel], column: Sequence[str]) -> None:
    """Scale axes to the values that are known: where bands are far wider, as at the ends of a fit, they are cut."""
    curves = [(panel, name) for panel in panels for name in column if name in panel.curves]
    peak = max((panel.peak(name) for panel, name in curves), default=0.0)
    known = [panel.reach(name) <= TOLD * peak for panel, name in curves]
    if all(rows.all() for rows in known) or not any(rows.any() for rows in known):
        return
    shown = [
        values[rows]
        for (panel, name), rows in zip(curves, known, strict=True)
        for values in (*panel.band(name), panel.points.get(name, panel.curves[name]))
    ]
    lowest, highest = (of(np.concatenate(shown)) for of in (np.min, np.max))
    margin = 0.05 * (highest - lowest)
    axes.set_ylim(lowest - margin, highest + margin)


def _draw_limits(axes: "Axes", panel: Panel, column: Sequence[str], names: Sequence[str]) -> bool:
    """Draw the limits that curves come near to or exceed, as lines across; whether there are any."""
    drawn = False
    for name in column:
        if name not in panel.curves or name not in panel.limits:
            continue
        values, (lower, upper) = panel.curves[name], panel.limits[name]
        for limit, room in ((lower, values.min() - lower), (upper, upper - values.max())):
            span = upper - lower if np.isfinite(upper - lower) else 2 * abs(limit)
            if np.isfinite(limit) and room <= NEAR * span:
                axes.axhline(limit, **LIMIT, color=line_style(names.index(name))["color"])
                drawn = True
    return drawn
