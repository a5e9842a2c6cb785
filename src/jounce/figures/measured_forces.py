"""Measured forces over time against those of a model and of the identified robot: one panel per force."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jounce.figures.canvas import INK, legend_above, line_style, painted, printable_name
from jounce.figures.panels import thin_points
from jounce.identification.result_tables import unused_spans

MEASURED_CURVE_POINTS = 900  # of a curve, at most: panels are low and many, and files small
MAX_WIDTH = 40.0  # inches: pictures of many logs stay below the size that viewers open

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jounce.identification import Identification


def draw_measured_forces(found: "Identification", names: Sequence[str], units: Sequence[str]) -> "Figure":
    """Panels of the forces that are measured, below each other, one column per log; shaded samples were not used."""
    curves = {"measured": found.measured, "model": found.model, "identified": found.predicted}
    styles = [line_style(1) | {"linestyle": "solid"}, line_style(0) | {"linestyle": (0, (3, 1.2))}, {"color": INK}]
    entries = dict(zip(curves, styles, strict=True))
    seen = np.flatnonzero(np.isfinite(found.measured).any(axis=0)).tolist()

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(seen), len(found.logs), sharex="col", sharey="row", squeeze=False)
        for log, column in zip(found.logs, grid.T, strict=True):
            t = found.t[log.rows]
            for j, axes in zip(seen, column, strict=True):
                for name, values in curves.items():
                    shown = thin_points(np.nan_to_num(values[log.rows, j]), MEASURED_CURVE_POINTS)
                    axes.plot(t[shown], values[log.rows][shown, j], **entries[name])
                for start, stop in unused_spans(log, t):
                    axes.axvspan(start, stop, color=INK, alpha=0.08, linewidth=0, zorder=0.1)
                title = f"{names[j]} [{units[j]}]" + (f", {log.name}" if log.name and j == seen[0] else "")
                axes.set_title(printable_name(title), loc="left", parse_math=False)
                axes.margins(x=0.01)
            column[-1].set_xlabel("t [s]")
        legend_above(figure, entries)

    return painted(paint, max(7.2, min(3.6 * len(found.logs), MAX_WIDTH)), 0.8 + 1.25 * len(seen))
