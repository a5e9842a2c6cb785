"""Draws measured forces against those of the model and the identified robot."""

from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.figures import canvas
from jounce.figures.panels import thin_points
from jounce.identification.result import unused_spans

MEASURED_CURVE_POINTS = 900  # of a curve, at most: panels are low and many, and files small
MAX_WIDTH = 40.0  # inches: pictures of many logs stay below the size that viewers open

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jounce.identification import Identification


def draw_measured_forces(identified: "Identification") -> "Figure":
    """Draw the measured forces in panels, one column per log.

    Shaded samples were not used.
    """
    # The channels are the measured forces, those of the model, and those of the identified robot.
    styles: tuple[dict[str, Any], ...] = (
        {**canvas.line_style(1), "linestyle": "solid"},
        {**canvas.line_style(0), "linestyle": (0, (3, 1.2))},
        {"color": canvas.INK},
    )
    if identified.at_rest:
        # Poses have nothing between them: a mark for each.
        marks = ({"linestyle": "none", "marker": mark} for mark in "ox.")
        styles = tuple({**style, **mark} for style, mark in zip(styles, marks, strict=True))
    entries = {channel.symbol: style for channel, style in zip(identified.channels, styles, strict=True)}
    measured_columns = np.flatnonzero(np.isfinite(identified.measured).any(axis=0)).tolist()

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(measured_columns), len(identified.logs), sharex="col", sharey="row", squeeze=False)
        # Each log has a column of axes with its own times; forces share their scales across logs.
        for log, column in zip(identified.logs, grid.T, strict=True):
            channels = [channel.rows(log.rows) for channel in identified.channels]
            measured = channels[0]
            for j, axes in zip(measured_columns, column, strict=True):
                for channel in channels:
                    shown = thin_points(np.nan_to_num(channel.values[:, j]), MEASURED_CURVE_POINTS)
                    axes.plot(channel.times[shown], channel.values[shown, j], **entries[channel.symbol])
                for start, stop in unused_spans(log, measured.times):
                    axes.axvspan(start, stop, color=canvas.INK, alpha=0.08, linewidth=0, zorder=0.1)
                title = f"{measured.names[j]} [{measured.units[j]}]"
                if log.name and j == measured_columns[0]:
                    title += f", {log.name}"
                axes.set_title(canvas.printable_name(title), loc="left", parse_math=False)
                axes.margins(x=0.01)
            column[-1].set_xlabel("pose" if identified.at_rest else "t [s]")
        canvas.legend_above(figure, entries)

    return canvas.painted(
        paint, max(7.2, min(3.6 * len(identified.logs), MAX_WIDTH)), 0.8 + 1.25 * len(measured_columns)
    )
