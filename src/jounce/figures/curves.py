"""Curves over time: one panel per quantity, one curve per joint, differentiated values as rings on the exact lines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.figures.canvas import PALE, legend_above, line_style, painted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_POINTS = 2000  # of a curve, about; a page shows no more
RINGS = 24  # differentiated values drawn of each curve, so that the line beneath stays visible
RING: Any = {"marker": "o", "linestyle": "none", "mfc": "none", "ms": 4.5, "mew": 0.8}
POINT: Any = {"marker": ".", "linestyle": "none", "ms": 2.5, "alpha": 0.25, "zorder": 1.5}
BAND: Any = {"linewidth": 6, "alpha": 0.25}
BREAK: Any = {"color": PALE, "linewidth": 0.8, "linestyle": (0, (2, 2)), "zorder": 0.5}
COVERS = 1.96  # standard deviations on either side
HIDDEN = 0.1  # of the largest value: a curve below this tells nothing in the same axes


@dataclass(frozen=True)
class Panel:
    """A quantity over time: its values by joint, and if given those that differentiation makes of them."""

    label: str
    curves: Mapping[str, np.ndarray]
    differentiated: Mapping[str, np.ndarray] | None = None
    points: Mapping[str, np.ndarray] = field(default_factory=dict)  # measured ones, which the curves should follow
    deviations: Mapping[str, np.ndarray] = field(default_factory=dict)  # standard ones, drawn as bands of 95 %


def over_time(t: np.ndarray, panels: Sequence[Panel], title: str = "", breaks: Sequence[float] = ()) -> "Figure":
    """A row of axes a panel, above a common time axis and under one legend; breaks are upright lines.

    Curves too small to be seen next to the others have a second column with its own scale.
    """
    columns = by_size(panels)
    names = _names(panels)

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(panels), len(columns), sharex=True, squeeze=False)
        for row, panel in zip(grid, panels, strict=True):
            row[0].set_ylabel(panel.label)
            for axes, column in zip(row, columns, strict=True):
                _draw(axes, t, panel, column, names)
                for at in breaks:
                    axes.axvline(at, **BREAK)
        for axes in grid[-1]:
            axes.set_xlabel("t [s]")
        figure.align_ylabels(grid)
        entries = {name: line_style(i) for i, name in enumerate(names)}
        if any(panel.differentiated for panel in panels):
            entries |= {"numerically differentiated": RING | {"color": "0.3"}}
        if any(panel.points for panel in panels):
            entries |= {"measured": POINT | {"color": "0.3"}}
        if any(panel.deviations for panel in panels):
            entries |= {"95 % band": BAND | {"color": "0.3"}}
        if breaks:
            entries |= {"break": BREAK}
        legend_above(figure, entries, title=title or None)

    return painted(paint, 3 + 4.2 * len(columns), 0.7 + 2.2 * len(panels))


def by_size(panels: Sequence[Panel]) -> list[list[str]]:
    """Return the curves in one column, or in two, large and small, if one is hidden by the largest of its panel."""
    small = set()
    for panel in panels:
        peaks = {name: np.abs(values).max() for name, values in panel.curves.items()}
        small |= {name for name, peak in peaks.items() if peak < HIDDEN * max(peaks.values())}
    names = _names(panels)
    columns = [[name for name in names if (name in small) == side] for side in (False, True)]
    return columns if all(columns) else [names]


def drawn_points(values: np.ndarray) -> np.ndarray:
    """The indices of the samples that a page shows: of many the ends, and in each short piece the extremes."""
    if len(values) <= MOST_POINTS:
        return np.arange(len(values))
    starts = np.linspace(0, len(values), MOST_POINTS // 2, endpoint=False).astype(int)
    extremes = [
        start + at for start, piece in zip(starts, np.split(values, starts[1:]), strict=True)
        for at in (piece.argmin(), piece.argmax())
    ]  # fmt: skip
    return np.unique([0, *extremes, len(values) - 1])


def _names(panels: Sequence[Panel]) -> list[str]:
    """The curves of all panels: a table need not hold every quantity of every joint."""
    return list(dict.fromkeys(name for panel in panels for name in panel.curves))


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
            reach = COVERS * panel.deviations[name][shown]
            band = {"color": style["color"], "alpha": BAND["alpha"], "linewidth": 0}
            axes.fill_between(t[shown], values[shown] - reach, values[shown] + reach, **band)
        axes.plot(t[shown], values[shown], marker="o" if len(t) == 1 else "", **style)
        if panel.differentiated:
            at = slice(i * apart // len(names), None, apart)  # each curve's a little later: no ring on a ring
            axes.plot(t[at], panel.differentiated[name][at], **RING, color=style["color"])
    axes.margins(x=0.01)
