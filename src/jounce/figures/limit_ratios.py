"""Ratios to limits over time: one panel per kind of limit, one curve per joint, the limit a line at 1."""

from typing import TYPE_CHECKING

import numpy as np

from jounce.engine.engine import Engine
from jounce.figures.canvas import Style, legend_above, line_style, painted
from jounce.figures.panels import thin_points
from jounce.limits.limited_motion import validate_limits
from jounce.limits.motion_polynomials import evaluate_polynomials, split_motion
from jounce.motion.channel import Channel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jounce.motion import Motion

RATIO_LIMIT_STYLE = {"color": "#b00020", "linewidth": 0.9, "linestyle": "solid", "zorder": 0.8}
MAX_RATIO_DRAWN = 50.0  # a larger ratio is cut there: the other curves would be flat


def draw_limit_ratios(robot: Engine, motion: "Motion") -> "Figure":
    """Panels of the ratios by kind of limit along a motion; what is above the line breaks its limit."""
    ratios = find_ratios(robot, motion)

    def paint(figure: "Figure") -> None:
        grid = figure.subplots(len(ratios), 1, sharex=True, squeeze=False)[:, 0]
        bounded: dict[str, Style] = {}
        for axes, channel in zip(grid, ratios, strict=True):
            for j, (joint, column) in enumerate(zip(channel.names, channel.values.T, strict=True)):
                if np.isfinite(column).any():
                    known = np.flatnonzero(~np.isnan(column))
                    shown = known[thin_points(column[known])]
                    axes.plot(channel.times[shown], column[shown].clip(None, MAX_RATIO_DRAWN), **line_style(j))
                    bounded[joint] = line_style(j)
            axes.axhline(1, **RATIO_LIMIT_STYLE)
            axes.axhspan(
                1, max(1.05, axes.get_ylim()[1]), color=RATIO_LIMIT_STYLE["color"], alpha=0.07, linewidth=0, zorder=0.1
            )
            axes.set_ylabel(f"{channel.symbol.replace('_', ' ')}\n/ limit")
            axes.margins(x=0.01, y=0)
        grid[-1].set_xlabel("t [s]")
        figure.align_ylabels(grid)
        legend_above(figure, bounded | {"limit": RATIO_LIMIT_STYLE})

    return painted(paint, 7.2, 0.7 + 1.6 * len(ratios))


def find_ratios(robot: Engine, motion: "Motion") -> list[Channel]:
    """The ratios of each kind of limit, as far as each is known well, or else NaN, at times that hold breaks twice.

    They are -inf where a joint has no such limit; the joints are all that have limits, those that follow in loops too.
    """
    b = validate_limits(robot, motion)
    times: list[np.ndarray] = []
    found: dict[str, list[np.ndarray]] = {kind: [] for kind in b.kinds}
    for pieces in split_motion(b):
        times.append(np.column_stack([pieces.start, (pieces.start + pieces.stop) / 2, pieces.stop]).ravel())
        for kind in set(b.kinds) - set(pieces.kinds):
            found[kind].append(np.full((3 * len(pieces.start), len(b.joints)), np.nan))
        for kind in pieces.kinds:
            left, right = pieces.left[kind], pieces.right[kind]
            middle = evaluate_polynomials(pieces.polynomials[kind], np.array(0.5)) if pieces.width.all() else left
            values = np.stack([left, middle, right], axis=1).reshape(-1, len(b.joints))
            found[kind].append(b.scales[kind].largest(values))
    t, units = np.concatenate(times), ("1",) * len(b.joints)
    return [Channel(kind, tuple(b.joints), units, t, (np.concatenate(parts),)) for kind, parts in found.items()]
