"""Makes the curves of a report as a figure of plotly.

There is one chart per quantity and unit, one curve per joint, and one time axis for all. `figure` is the door. All
parts of a page write arrays as text, `pack_array`: base64 of their bytes, as plotly.js reads them, and our own script
too.
"""

from base64 import b64encode
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jounce._report.report_data import ReportData, list_known
from jounce.core.typing import JsonObject
from jounce.figures import canvas
from jounce.figures.curves import MAX_ROOM_SHARE
from jounce.figures.panels import thin_points
from jounce.limits.verdicts import CheckedLimit
from jounce.motion import reliability
from jounce.motion.channel import Channel

Packed = dict[str, str]
VISIBLE_SHARE = 1e-5  # of the width of a chart: less than a hundredth of a pixel


def pack_array(array: np.ndarray, dtype: str = "f8") -> Packed:
    """An array, in the order of its rows, as little-endian "f8", "f4" or "i4"."""
    return {"dtype": dtype, "bdata": b64encode(np.ascontiguousarray(array, dtype=f"<{dtype}").tobytes()).decode()}


def pack_times(t: np.ndarray) -> Packed:
    """Times to be drawn: in single precision where no screen shows the difference, as it does for stamps since 1970."""
    step = np.finfo(np.float32).eps * np.abs(t).max()
    return pack_array(t, "f4" if step < VISIBLE_SHARE * np.ptp(t) else "f8")


def list_finite(rows: np.ndarray) -> list[list[float | None]]:
    """Rows of numbers, None in the place of those that JSON has not: infinite and NaN."""
    return [[x if np.isfinite(x) else None for x in row] for row in rows.tolist()]


# Points of a curve, and of all together: more than a chart has pixels across, and a page of a few MB.
MAX_CURVE_POINTS, MIN_CURVE_POINTS, MAX_CHART_POINTS = 1000, 300, 100_000
MAX_BAND_POINTS = 400  # of each edge: bands are smooth
MAX_BREAKS_DRAWN = 200  # as lines: more would cover the chart
CHART_HEIGHT, CHARTS_FOOT = 165, 60  # px of a chart, and of what is above and below all of them
RED = "#b00020"
LINE_WIDTH = 1.6
KEPT, BROKEN = {"symbol": "circle-open", "size": 8}, {"symbol": "x", "size": 9, "color": RED}  # worst values


class Chart(NamedTuple):
    """A quantity of the coordinates of one unit, at all times and at the frames; its key in `ReportData.quantities`."""

    key: str
    quantity: Channel
    at_frames: Channel
    unit: str
    joints: list[int]

    @property
    def window(self) -> tuple[float, float] | None:
        """The times between which it is known well; None of what is exact."""
        return self.quantity.windows[0] if self.quantity.windows else None


@dataclass(frozen=True)
class ChartFigure:
    """`data` and `layout` of plotly, and the `ranges` (joint: lowest, highest) of the vertical axis of each chart."""

    data: list[JsonObject]
    layout: JsonObject
    ranges: dict[str, dict[int, tuple[float, float]]]


def figure(s: ReportData) -> ChartFigure:
    """The charts of all quantities."""
    charts = charts_of(s)
    share = MAX_CHART_POINTS // sum(len(chart.joints) for chart in charts)
    most = int(np.clip(share, MIN_CURVE_POINTS, MAX_CURVE_POINTS))
    traces, ranges = [], {}
    for i, chart in enumerate(charts):
        axis = "y" if i == 0 else f"y{i + 1}"
        ranges[axis.replace("y", "yaxis")] = {j: _range(s, chart, j) for j in chart.joints}
        for j in chart.joints:
            base = {"xaxis": "x", "yaxis": axis, "meta": j, "hoverinfo": "none", "showlegend": False}
            traces += [base | trace for trace in _traces(s, chart, j, most)]
    return ChartFigure(traces, _layout(s, charts, list(ranges)), ranges)


def charts_of(s: ReportData) -> list[Chart]:
    """The charts from above."""
    return [
        Chart(key, quantity, s.at_frames[key], unit, [j for j in known if quantity.units[j] == unit])
        for key, quantity in s.quantities.items()
        for known in [list_known(quantity)]
        for unit in dict.fromkeys(quantity.units[j] for j in known)
    ]


def joint_style(j: int) -> dict[str, str]:
    """Colour and dashes of the curves of a joint; the dashes as plotly and SVG write them."""
    style = canvas.line_style(j)
    dashes = style["linestyle"]
    lengths = () if dashes == "solid" else dashes[1]
    return {"color": style["color"], "dash": ",".join(f"{LINE_WIDTH * x:g}px" for x in lengths) or "solid"}


def _traces(s: ReportData, chart: Chart, j: int, most: int) -> Iterator[JsonObject]:
    """Limits, the band of deviations, stretches beyond a limit, the curve, and the worst value of a joint."""
    values, bounds, style = chart.quantity.values[:, j], chart.quantity.bounds[0][:, j], joint_style(j)
    found = _find_limit(s, chart, j)
    ends = np.searchsorted(s.t, np.reshape(found.violations if found else (), (-1, 2)))
    drawn = thin_points(values, most)
    at = np.union1d(drawn, ends) if len(ends) < most else drawn
    t = pack_times(s.t[at])
    if np.isfinite(bounds).any():
        yield _limits(s, bounds, style["color"])
    deviations = chart.at_frames.deviations
    if deviations is not None and np.isfinite(deviations[0][:, j]).all():
        yield _band(chart.at_frames, j, style["color"])
    if chart.quantity.symbol == "Q" and s.motion.torques is not None and j in s.own:
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


def _limits(s: ReportData, bounds: np.ndarray, colour: str) -> JsonObject:
    """The limits of a joint as lines across."""
    stated = bounds[np.isfinite(bounds)].tolist()
    times = [s.motion.start, s.motion.stop, None] * len(stated)
    line = {"color": colour, "width": 1, "dash": "dot"}
    return {"mode": "lines", "x": times, "y": [y for bound in stated for y in (bound, bound, None)], "line": line}


def _band(at_frames: Channel, j: int, colour: str) -> JsonObject:
    """The band of 95 % about an uncertain curve."""
    count = len(at_frames.times)
    at = np.linspace(0, count - 1, min(count, MAX_BAND_POINTS)).astype(int)
    t, (lower, upper) = at_frames.times[at], (edge[at] for edge in _edges(at_frames, j))
    outline = {
        "x": pack_times(np.concatenate([t, t[::-1]])),
        "y": pack_array(np.concatenate([upper, lower[::-1]]), "f4"),
    }
    return outline | {"mode": "none", "fill": "toself", "fillcolor": colour, "opacity": 0.25}


def _edges(at_frames: Channel, j: int) -> tuple[np.ndarray, np.ndarray]:
    assert at_frames.deviations is not None
    values, reach = at_frames.values[:, j], reliability.BAND_DEVIATIONS * at_frames.deviations[0][:, j]
    return values - reach, values + reach


def _measured_torques(s: ReportData, j: int, most: int, colour: str) -> Iterator[JsonObject]:
    """The torques that the log of a motion holds of its joint j, as dots."""
    assert s.motion.torques is not None
    t, torques = s.motion.torques
    known = np.flatnonzero(np.isfinite(torques[:, j]))
    at = known[thin_points(torques[known, j], most)] if known.size else known
    marker = {"color": colour, "size": 3, "opacity": 0.35}
    if at.size:
        yield {"mode": "markers", "x": pack_times(t[at]), "y": pack_array(torques[at, j], "f4"), "marker": marker}


def _find_limit(s: ReportData, chart: Chart, j: int) -> CheckedLimit | None:
    rows = s.check.table if s.check else ()
    return next((row for row in rows if row.joint == chart.quantity.names[j] and row.limit == chart.key), None)


def _range(s: ReportData, chart: Chart, j: int) -> tuple[float, float]:
    """What a chart of a joint shows: its values where they are known, and limits that they come near to."""
    values = chart.quantity.values[:, j]
    if chart.window:
        start, stop = chart.window
        known, certain = ((start <= t) & (t <= stop) for t in (s.t, chart.at_frames.times))
        edges = _edges(chart.at_frames, j) if chart.at_frames.deviations is not None else ()
        values = np.concatenate([values[known], *(edge[certain] for edge in edges)])
        values = values[np.isfinite(values)]
    low, high = float(values.min()), float(values.max())
    lower_bound, upper_bound = chart.quantity.bounds[0][:, j].tolist()
    span = upper_bound - lower_bound
    for bound, room in ((lower_bound, low - lower_bound), (upper_bound, upper_bound - high)):
        if room <= MAX_ROOM_SHARE * (span if np.isfinite(span) else 2 * abs(bound)) and np.isfinite(bound):
            low, high = min(low, bound), max(high, bound)
    return low, high


def _layout(s: ReportData, charts: list[Chart], axes: list[str]) -> JsonObject:
    """The charts above each other; the page sets the ranges of their axes, by the joints that are drawn."""
    count, grid = len(charts), {"gridcolor": "#e6e6e6", "zeroline": False, "linecolor": canvas.INK, "ticks": "outside"}
    time = {"title": {"text": "t [s]"}, "range": [s.motion.start, s.motion.stop]}
    breaks = sorted({found.t for found in s.motion.breaks})
    time_axis = grid | time | {"anchor": "y" if count == 1 else f"y{count}"}
    layout: JsonObject = {
        "height": CHART_HEIGHT * count + CHARTS_FOOT,
        "margin": {"l": 52, "r": 12, "t": 8, "b": 44},
        "annotations": [],
        "font": {"color": canvas.INK, "family": "system-ui, sans-serif", "size": 12},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "hovermode": "x",
        "dragmode": "zoom",
        "xaxis": time_axis,
        "shapes": [_break_line(t) for t in breaks[:MAX_BREAKS_DRAWN]],
    }
    for i, (chart, axis) in enumerate(zip(charts, axes, strict=True)):
        top = 1 - i / count
        layout["shapes"] += _uncertain_ends(s, chart, axis.replace("axis", ""))
        layout[axis] = grid | {"domain": [top - 0.88 / count, top - 0.13 / count]}
        layout["annotations"].append({
            "text": f"<b>{chart.quantity.symbol}</b> [{raise_powers(chart.unit)}]", "showarrow": False,
            "xref": "paper", "x": 0, "xanchor": "left", "yref": "paper", "y": top - 0.12 / count, "yanchor": "bottom",
        })  # fmt: skip
    return layout


def _uncertain_ends(s: ReportData, chart: Chart, axis: str) -> list[JsonObject]:
    """Grey areas where a quantity lies in uncertain ends of samples."""
    start, stop = chart.window or (s.motion.start, s.motion.stop)
    ends = [span for span in ((s.motion.start, start), (stop, s.motion.stop)) if span[0] < span[1]]
    return shade_spans(ends, f"{axis} domain")


def shade_spans(spans: Iterable[tuple[float, float]], height: str) -> list[JsonObject]:
    """Grey areas between times, as high as plotly's `height` says."""
    look = {"type": "rect", "xref": "x", "yref": height, "y0": 0, "y1": 1, "layer": "below"}
    look |= {"fillcolor": "#888888", "opacity": 0.25, "line": {"width": 0}}
    return [look | {"x0": first, "x1": last} for first, last in spans]


def raise_powers(unit: str) -> str:
    """A unit with raised powers."""
    return unit.replace("^2", "²").replace("^3", "³").replace("^4", "⁴")


def _break_line(t: float) -> JsonObject:
    line = {"color": "#777777", "width": 1, "dash": "dot"}
    return {"type": "line", "xref": "x", "yref": "paper", "x0": t, "x1": t, "y0": 0, "y1": 1, "line": line}
