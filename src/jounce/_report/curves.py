"""The curves of a report as a figure of plotly: one chart per quantity and unit, one curve per joint, one time axis."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from jounce._report.array_text import pack_array, pack_times
from jounce._report.report_data import ReportData, ReportQuantity
from jounce.figures.canvas import INK, line_style
from jounce.figures.limit_lines import MAX_ROOM_SHARE
from jounce.figures.panels import thin_points
from jounce.limits.verdicts import CheckedLimit
from jounce.model.positions import extent_names
from jounce.motion.reliability import BAND_DEVIATIONS

# Points of a curve, and of all together: more than a chart has pixels across, and a page of a few MB.
MAX_CURVE_POINTS, MIN_CURVE_POINTS, MAX_CHART_POINTS = 1000, 300, 100_000
MAX_BAND_POINTS = 400  # of each edge: bands are smooth
MAX_BREAKS_DRAWN = 200  # as lines: more would cover the chart
CHART_HEIGHT, CHARTS_FOOT = 165, 60  # px of a chart, and of what is above and below all of them
RED = "#b00020"
LINE_WIDTH = 1.6
KEPT, BROKEN = {"symbol": "circle-open", "size": 8}, {"symbol": "x", "size": 9, "color": RED}  # worst values


class Chart(NamedTuple):
    """A quantity of the coordinates of one unit."""

    quantity: ReportQuantity
    unit: str
    joints: list[int]


def figure(s: ReportData) -> dict[str, Any]:
    """`data` and `layout` of plotly, and the `ranges` (joint: lowest, highest) of the vertical axis of each chart."""
    charts = charts_of(s)
    share = MAX_CHART_POINTS // sum(len(chart.joints) for chart in charts)
    most = int(np.clip(share, MIN_CURVE_POINTS, MAX_CURVE_POINTS))
    traces, ranges = [], {}
    for i, chart in enumerate(charts):
        axis = "y" if i == 0 else f"y{i + 1}"
        ranges[axis.replace("y", "yaxis")] = {j: _range(s, chart.quantity, j) for j in chart.joints}
        for j in chart.joints:
            base = {"xaxis": "x", "yaxis": axis, "meta": j, "hoverinfo": "none", "showlegend": False}
            traces += [base | trace for trace in _traces(s, chart.quantity, j, most)]
    return {"data": traces, "layout": _layout(s, charts, list(ranges)), "ranges": ranges}


def charts_of(s: ReportData) -> list[Chart]:
    """The charts from above."""
    return [
        Chart(quantity, unit, [j for j in quantity.joints if quantity.units[j] == unit])
        for quantity in s.quantities
        for unit in dict.fromkeys(quantity.units[j] for j in quantity.joints)
    ]


def joint_style(j: int) -> dict[str, str]:
    """Colour and dashes of the curves of a joint; the dashes as plotly and SVG write them."""
    style = line_style(j)
    dashes = style["linestyle"]
    lengths = () if dashes == "solid" else dashes[1]
    return {"color": style["color"], "dash": ",".join(f"{LINE_WIDTH * x:g}px" for x in lengths) or "solid"}


def _traces(s: ReportData, quantity: ReportQuantity, j: int, most: int) -> Iterator[dict[str, Any]]:
    """Limits, the band of deviations, stretches beyond a limit, the curve, and the worst value of a joint."""
    values, style = quantity.values[:, j], joint_style(j)
    found = _find_limit(s, quantity, j)
    ends = np.searchsorted(s.t, np.reshape(found.violations if found else (), (-1, 2)))
    drawn = thin_points(values, most)
    at = np.union1d(drawn, ends) if len(ends) < most else drawn
    t = pack_times(s.t[at])
    if np.isfinite(quantity.bounds[:, j]).any():
        yield _limits(s, quantity.bounds[:, j], style["color"])
    if quantity.deviations is not None and np.isfinite(quantity.deviations[:, j]).all():
        yield _band(s, quantity, j, style["color"])
    if quantity.symbol == "Q" and s.motion.torques is not None and j in s.own:
        yield from _measured_torques(s, s.own.index(j), most, style["color"])
    if len(ends):
        beyond = np.full(len(values), np.nan)
        for start, stop in ends:
            beyond[start : stop + 1] = values[start : stop + 1]
        line = {"color": RED, "width": 7}
        yield {"mode": "lines", "x": t, "y": pack_array(beyond[at], "f4"), "line": line, "opacity": 0.45}
    yield {"mode": "lines", "x": t, "y": pack_array(values[at], "f4"), "line": {"width": LINE_WIDTH, **style}}
    if found and np.isfinite(found.value):
        marker = BROKEN if found.verdict == "broken" else KEPT | {"color": style["color"]}
        yield {"mode": "markers", "x": [found.t], "y": [found.value], "marker": marker}


def _limits(s: ReportData, bounds: np.ndarray, colour: str) -> dict[str, Any]:
    """The limits of a joint as lines across."""
    stated = bounds[np.isfinite(bounds)].tolist()
    times = [s.motion.start, s.motion.stop, None] * len(stated)
    line = {"color": colour, "width": 1, "dash": "dot"}
    return {"mode": "lines", "x": times, "y": [y for bound in stated for y in (bound, bound, None)], "line": line}


def _band(s: ReportData, quantity: ReportQuantity, j: int, colour: str) -> dict[str, Any]:
    """The band of 95 % about an uncertain curve."""
    at = np.linspace(0, len(s.frames) - 1, min(len(s.frames), MAX_BAND_POINTS)).astype(int)
    t, (lower, upper) = s.t[s.frames[at]], (edge[at] for edge in _edges(s, quantity, j))
    outline = {
        "x": pack_times(np.concatenate([t, t[::-1]])),
        "y": pack_array(np.concatenate([upper, lower[::-1]]), "f4"),
    }
    return outline | {"mode": "none", "fill": "toself", "fillcolor": colour, "opacity": 0.25}


def _edges(s: ReportData, quantity: ReportQuantity, j: int) -> tuple[np.ndarray, np.ndarray]:
    assert quantity.deviations is not None
    values, reach = quantity.values[s.frames, j], BAND_DEVIATIONS * quantity.deviations[:, j]
    return values - reach, values + reach


def _measured_torques(s: ReportData, j: int, most: int, colour: str) -> Iterator[dict[str, Any]]:
    """The torques that the log of a motion holds of its joint j, as dots."""
    assert s.motion.torques is not None
    t, torques = s.motion.torques
    known = np.flatnonzero(np.isfinite(torques[:, j]))
    at = known[thin_points(torques[known, j], most)] if known.size else known
    marker = {"color": colour, "size": 3, "opacity": 0.35}
    if at.size:
        yield {"mode": "markers", "x": pack_times(t[at]), "y": pack_array(torques[at, j], "f4"), "marker": marker}


def _find_limit(s: ReportData, quantity: ReportQuantity, j: int) -> CheckedLimit | None:
    rows = s.check.table if s.check and quantity.bounded else ()
    joint = (extent_names(s.robot.mechanism.tree) if quantity.kind == "position" else s.joints)[j]
    return next((row for row in rows if row.joint == joint and row.limit == quantity.kind), None)


def _range(s: ReportData, quantity: ReportQuantity, j: int) -> tuple[float, float]:
    """What a chart of a joint shows: its values where they are known, and limits that they come near to."""
    values = quantity.values[:, j]
    if quantity.window:
        start, stop = quantity.window
        known, certain = ((start <= t) & (t <= stop) for t in (s.t, s.t[s.frames]))
        edges = _edges(s, quantity, j) if quantity.deviations is not None else ()
        values = np.concatenate([values[known], *(edge[certain] for edge in edges)])
        values = values[np.isfinite(values)]
    low, high = float(values.min()), float(values.max())
    lower_bound, upper_bound = quantity.bounds[:, j].tolist()
    span = upper_bound - lower_bound
    for bound, room in ((lower_bound, low - lower_bound), (upper_bound, upper_bound - high)):
        if room <= MAX_ROOM_SHARE * (span if np.isfinite(span) else 2 * abs(bound)) and np.isfinite(bound):
            low, high = min(low, bound), max(high, bound)
    return low, high


def _layout(s: ReportData, charts: list[Chart], axes: list[str]) -> dict[str, Any]:
    """The charts above each other; the page sets the ranges of their axes, by the joints that are drawn."""
    count, grid = len(charts), {"gridcolor": "#e6e6e6", "zeroline": False, "linecolor": INK, "ticks": "outside"}
    time = {"title": {"text": "t [s]"}, "range": [s.motion.start, s.motion.stop]}
    breaks = sorted({found.t for found in s.motion.breaks})
    time_axis = grid | time | {"anchor": "y" if count == 1 else f"y{count}"}
    layout: dict[str, Any] = {
        "height": CHART_HEIGHT * count + CHARTS_FOOT,
        "margin": {"l": 52, "r": 12, "t": 8, "b": 44},
        "annotations": [],
        "font": {"color": INK, "family": "system-ui, sans-serif", "size": 12},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "hovermode": "x",
        "dragmode": "zoom",
        "xaxis": time_axis,
        "shapes": [_break_line(t) for t in breaks[:MAX_BREAKS_DRAWN]],
    }
    for i, (chart, axis) in enumerate(zip(charts, axes, strict=True)):
        top = 1 - i / count
        layout["shapes"] += _uncertain_ends(s, chart.quantity, axis.replace("axis", ""))
        layout[axis] = grid | {"domain": [top - 0.88 / count, top - 0.13 / count]}
        layout["annotations"].append({
            "text": f"<b>{chart.quantity.symbol}</b> [{raise_powers(chart.unit)}]", "showarrow": False,
            "xref": "paper", "x": 0, "xanchor": "left", "yref": "paper", "y": top - 0.12 / count, "yanchor": "bottom",
        })  # fmt: skip
    return layout


def _uncertain_ends(s: ReportData, quantity: ReportQuantity, axis: str) -> list[dict[str, Any]]:
    """Grey areas where a quantity lies in uncertain ends of samples."""
    start, stop = quantity.window or (s.motion.start, s.motion.stop)
    ends = [span for span in ((s.motion.start, start), (stop, s.motion.stop)) if span[0] < span[1]]
    return shade_spans(ends, f"{axis} domain")


def shade_spans(spans: Iterable[tuple[float, float]], height: str) -> list[dict[str, Any]]:
    """Grey areas between times, as high as plotly's `height` says."""
    look = {"type": "rect", "xref": "x", "yref": height, "y0": 0, "y1": 1, "layer": "below"}
    look |= {"fillcolor": "#888888", "opacity": 0.25, "line": {"width": 0}}
    return [look | {"x0": first, "x1": last} for first, last in spans]


def raise_powers(unit: str) -> str:
    """A unit with raised powers."""
    return unit.replace("^2", "²").replace("^3", "³").replace("^4", "⁴")


def _break_line(t: float) -> dict[str, Any]:
    line = {"color": "#777777", "width": 1, "dash": "dot"}
    return {"type": "line", "xref": "x", "yref": "paper", "x0": t, "x1": t, "y0": 0, "y1": 1, "line": line}
