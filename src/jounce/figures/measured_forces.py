"""Measured forces over time against those of a model and of the identified robot: one panel per force."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from jounce.figures.canvas import INK, legend_above, line_style, painted, printable_name
from jounce.figures.panels import thin_points

MEASURED_CURVE_POINTS = 900  # of a curve, at most: panels are low and many, and files small

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jounce.identification import Identification


def draw_measured_forces(found: "Identification", names: Sequence[str], units: Sequence[str]) -> "Figure":
    """Panels of the forces that are measured, below each other; what is shaded was not used for the fit."""
    curves = {"measured": found.measured, "model": found.model, "identified": found.predicted}
    styles = [line_style(1) | {"linestyle": "solid"}, line_style(0) | {"linestyle": (0, (3, 1.2))}, {"color": INK}]
    entries = dict(zip(curves, styles, strict=True))
    seen = np.flatnonzero(np.isfinite(found.measured).any(axis=0)).tolist()
    first, last = found.span

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(seen), 1, sharex=True, squeeze=False)[:, 0]
        for j, axes in zip(seen, grid, strict=True):
            for name, values in curves.items():
                shown = thin_points(np.nan_to_num(values[:, j]), MEASURED_CURVE_POINTS)
                axes.plot(found.t[shown], values[shown, j], **entries[name])
            for span in ((found.t[0], first), (last, found.t[-1])):
                if span[1] > span[0]:
                    axes.axvspan(*span, color=INK, alpha=0.08, linewidth=0, zorder=0.1)
            axes.set_title(f"{printable_name(names[j])} [{units[j]}]", loc="left", parse_math=False)
            axes.margins(x=0.01)
        grid[-1].set_xlabel("t [s]")
        legend_above(figure, entries)

    return painted(paint, 7.2, 0.8 + 1.25 * len(seen))
