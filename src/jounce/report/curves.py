"""Curves over time: one panel a quantity, one curve a joint, differentiated values as rings upon the exact lines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.report.canvas import legend_above, line_style, painted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_POINTS = 2000  # of a curve; a page shows no more
RINGS = 24  # differentiated values drawn of each curve, so that the line beneath stays visible
RING: Any = {"marker": "o", "linestyle": "none", "mfc": "none", "ms": 4.5, "mew": 0.8}
HIDDEN = 0.1  # of the largest value: a curve below this tells nothing in the same axes


@dataclass(frozen=True)
class Panel:
    """A quantity over time: its values by joint, and if given those that differentiation makes of them."""

    label: str
    curves: Mapping[str, np.ndarray]
    differentiated: Mapping[str, np.ndarray] | None = None


def over_time(t: np.ndarray, panels: Sequence[Panel], title: str = "") -> "Figure":
    """A row of axes a panel, above a common time axis and under one legend.

    Curves too small to be seen beside the others have a second column, to a scale of their own.
    """
    columns = by_size(panels)

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(panels), len(columns), sharex=True, squeeze=False)
        for row, panel in zip(grid, panels, strict=True):
            row[0].set_ylabel(panel.label)
            for axes, names in zip(row, columns, strict=True):
                _draw(axes, t, panel, names)
        for axes in grid[-1]:
            axes.set_xlabel("t [s]")
        figure.align_ylabels(grid)
        for i, name in enumerate(panels[0].curves):
            grid[0, 0].plot([], [], label=name, **line_style(i))
        if any(panel.differentiated for panel in panels):
            grid[0, 0].plot([], [], **RING, color="0.3", label="numerically differentiated")
        legend_above(figure, grid[0, 0], title=title or None)

    return painted(paint, 3 + 4.2 * len(columns), 0.7 + 2.2 * len(panels))


def by_size(panels: Sequence[Panel]) -> list[list[str]]:
    """The curves in one column, or in two, large and small, where one is hidden beside the largest of its panel."""
    peaks = [{name: np.abs(values).max() for name, values in panel.curves.items()} for panel in panels]
    largest = [max(of.values()) for of in peaks]
    names = list(panels[0].curves)
    small = [name for name in names if any(of[name] < HIDDEN * most for of, most in zip(peaks, largest, strict=True))]
    return [[name for name in names if name not in small], small] if 0 < len(small) < len(names) else [names]


def _draw(axes: "Axes", t: np.ndarray, panel: Panel, names: Sequence[str]) -> None:
    every, apart = max(1, len(t) // MOST_POINTS), max(1, len(t) // RINGS)
    for i, (name, values) in enumerate(panel.curves.items()):
        if name not in names:
            continue
        axes.plot(t[::every], values[::every], **line_style(i))
        if panel.differentiated:
            at = slice(i * apart // len(panel.curves), None, apart)  # each curve's a little later: no ring on a ring
            axes.plot(t[at], panel.differentiated[name][at], **RING, color=line_style(i)["color"])
    axes.margins(x=0.01)
