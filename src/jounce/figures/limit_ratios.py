"""Ratios to limits over time: one panel per kind of limit, one curve per joint, the limit a line at 1."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from jounce.figures.canvas import legend_above, line_style, painted
from jounce.figures.panels import thin_points

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RATIO_LIMIT_STYLE = {"color": "#b00020", "linewidth": 0.9, "linestyle": "solid", "zorder": 0.8}
MAX_RATIO_DRAWN = 50.0  # a larger ratio is cut there: the other curves would be flat


def draw_limit_ratios(t: np.ndarray, ratios: Mapping[str, np.ndarray], joints: Sequence[str]) -> "Figure":
    """Panels of ratios (N, n) by kind of limit, at times (N,); what is above the line breaks its limit."""

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(ratios), 1, sharex=True, squeeze=False)[:, 0]
        bounded: dict[str, dict[str, object]] = {}
        for axes, (kind, values) in zip(grid, ratios.items(), strict=True):
            for j, joint in enumerate(joints):
                column = values[:, j]
                if np.isfinite(column).any():
                    known = np.flatnonzero(~np.isnan(column))
                    shown = known[thin_points(column[known])]
                    axes.plot(t[shown], column[shown].clip(None, MAX_RATIO_DRAWN), **line_style(j))
                    bounded[joint] = line_style(j)
            axes.axhline(1, **RATIO_LIMIT_STYLE)
            axes.axhspan(
                1, max(1.05, axes.get_ylim()[1]), color=RATIO_LIMIT_STYLE["color"], alpha=0.07, linewidth=0, zorder=0.1
            )
            axes.set_ylabel(f"{kind.replace('_', ' ')}\n/ limit")
            axes.margins(x=0.01, y=0)
        grid[-1].set_xlabel("t [s]")
        figure.align_ylabels(grid)
        legend_above(figure, bounded | {"limit": RATIO_LIMIT_STYLE})

    return painted(paint, 7.2, 0.7 + 1.6 * len(ratios))
