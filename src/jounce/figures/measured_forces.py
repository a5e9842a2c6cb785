"""Measured forces over time against those of a model and of the identified robot: one panel per force."""

from typing import TYPE_CHECKING

import numpy as np

from jounce.figures import canvas
from jounce.figures.panels import thin_points
from jounce.identification.result import unused_spans

MEASURED_CURVE_POINTS = 900  # of a curve, at most: panels are low and many, and files small
MAX_WIDTH = 40.0  # inches: pictures of many logs stay below the size that viewers open

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jounce.identification import Identification


def draw_measured_forces(found: "Identification") -> "Figure":
    """Panels of the forces that are measured, below each other, one column per log; shaded samples were not used."""
    styles = (
        {**canvas.line_style(1), "linestyle": "solid"},
        {**canvas.line_style(0), "linestyle": (0, (3, 1.2))},
        {"color": canvas.INK},
    )
    entries = {channel.symbol: style for channel, style in zip(found.channels, styles, strict=True)}
    seen = np.flatnonzero(np.isfinite(found.measured).any(axis=0)).tolist()

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(seen), len(found.logs), sharex="col", sharey="row", squeeze=False)
        for log, column in zip(found.logs, grid.T, strict=True):
            channels = [channel.rows(log.rows) for channel in found.channels]
            measured = channels[0]
            for j, axes in zip(seen, column, strict=True):
                for channel in channels:
                    shown = thin_points(np.nan_to_num(channel.values[:, j]), MEASURED_CURVE_POINTS)
                    axes.plot(channel.times[shown], channel.values[shown, j], **entries[channel.symbol])
                for start, stop in unused_spans(log, measured.times):
                    axes.axvspan(start, stop, color=canvas.INK, alpha=0.08, linewidth=0, zorder=0.1)
                title = f"{measured.names[j]} [{measured.units[j]}]"
                if log.name and j == seen[0]:
                    title += f", {log.name}"
                axes.set_title(canvas.printable_name(title), loc="left", parse_math=False)
                axes.margins(x=0.01)
            column[-1].set_xlabel("t [s]")
        canvas.legend_above(figure, entries)

    return canvas.painted(paint, max(7.2, min(3.6 * len(found.logs), MAX_WIDTH)), 0.8 + 1.25 * len(seen))
