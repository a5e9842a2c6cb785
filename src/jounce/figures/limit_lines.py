"""Limits in the axes of curves: lines across, pale bands beyond them, and marks where a curve lies there."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.figures.panels import Panel, thin_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LIMIT_STYLE: Any = {"linewidth": 2.4, "alpha": 0.4, "linestyle": "solid", "zorder": 0.8}
VIOLATION_STYLE: Any = {"color": "#eba3ae", "linewidth": 4.5, "marker": "o", "markersize": 4.5, "mew": 0, "zorder": 1.2}
LIMIT_ENTRY, VIOLATION = "limit", "beyond its limit"  # in the legend
OF_LIMITS: Mapping[str, Any] = {LIMIT_ENTRY: LIMIT_STYLE, VIOLATION: VIOLATION_STYLE}
BAND_OPACITY = 0.07  # bands of several joints lie over each other, and curves stay visible
MAX_ROOM_SHARE = 0.2  # of the span of limits: a limit farther from its curve is not drawn, it would flatten the curve


def find_violations(panel: Panel, joint: str) -> np.ndarray:
    """Whether each value of a curve is beyond a limit of its joint."""
    lower, upper = panel.limits(joint)
    values = panel.curve(joint)
    found: np.ndarray = (values < lower) | (values > upper)
    return found


def axes_reach(panels: Sequence[Panel]) -> float:
    """A height that no axes of these panels reach."""
    limits = [x for panel in panels for bounds in panel.channel.bounds for x in bounds[np.isfinite(bounds)]]
    values = [np.abs(panel.channel.values).max() for panel in panels]
    return 10 * float(max(np.abs([*limits, *values])))


def draw_limits(axes: "Axes", panels: Sequence[Panel], joint: str, color: str, height: float | None) -> bool:
    """Draw the limits of a joint that its curves come near to or exceed; whether there are any.

    Bands reach from them to a height; without it, where other joints share the axes, no bands are drawn.
    """
    from matplotlib.patches import Rectangle

    values = np.concatenate([panel.curve(joint) for panel in panels])
    lower, upper = panels[0].limits(joint)
    drawn = False
    for limit, room, side in ((lower, values.min() - lower, -1), (upper, upper - values.max(), 1)):
        span = upper - lower if np.isfinite(upper - lower) else 2 * abs(limit)
        if np.isfinite(limit) and room <= MAX_ROOM_SHARE * span:
            axes.axhline(limit, **LIMIT_STYLE, color=color)
            drawn = True
            if height is not None:
                look: Any = {
                    "transform": axes.get_yaxis_transform(),
                    "color": color,
                    "alpha": BAND_OPACITY,
                    "linewidth": 0,
                }
                band = Rectangle((0, limit), 1, side * height, **look, zorder=0.1)
                axes.add_artist(band)  # unlike a patch it leaves the scale alone
    return drawn


def mark_violations(axes: "Axes", panel: Panel, joint: str) -> bool:
    """Mark the curve of a joint where it is beyond a limit; whether it is anywhere."""
    outside = find_violations(panel, joint)
    if outside.any():
        t, values = panel.channel.times, panel.curve(joint)
        shown = thin_points(values)
        axes.plot(t[shown], np.where(outside, values, np.nan)[shown], **VIOLATION_STYLE)
    return bool(outside.any())
