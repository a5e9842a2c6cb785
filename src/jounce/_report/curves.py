"""Makes the curves of a report as a figure of plotly.

`figure` makes one chart per quantity and unit, one curve per joint, and one time axis for all. The page has two
figures: the forces, and all other quantities. All parts of a page write arrays as text (`pack_array`): base64 of their
bytes, which plotly.js and our own script read.
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
from jounce.model.limits import LIMIT_KINDS
from jounce.motion import reliability
from jounce.motion.channel import Channel

Packed = dict[str, str]
VISIBLE_SHARE = 1e-5  # of the width of a chart: less than a hundredth of a pixel


def pack_array(array: np.ndarray, dtype: str = "f8") -> Packed:
    """Pack an array, row by row, as little-endian "f8", "f4" or "i4"."""
    return {"dtype": dtype, "bdata": b64encode(np.ascontiguousarray(array, dtype=f"<{dtype}").tobytes()).decode()}


def pack_times(t: np.ndarray) -> Packed:
    """Pack times in single precision where no screen shows the difference.

    Times since 1970 need double precision.
    """
    step = np.finfo(np.float32).eps * np.abs(t).max()
    return pack_array(t, "f4" if step < VISIBLE_SHARE * np.ptp(t) else "f8")


def list_finite(rows: np.ndarray) -> list[list[float | None]]:
    """Return rows of numbers, with None for infinity and NaN."""
    return [[x if np.isfinite(x) else None for x in row] for row in rows.tolist()]


# Points of a curve, and of all together: more than a chart has pixels across, and a page of a few MB.
MAX_CURVE_POINTS, MIN_CURVE_POINTS, MAX_CHART_POINTS = 1000, 300, 100_000
MAX_BAND_POINTS = 400  # of each edge: bands are smooth
MAX_BREAKS_DRAWN = 200  # as lines: more would cover the chart
CHART_HEIGHT, CHARTS_FOOT = 165, 60  # px of a chart, and of what is above and below all of them
RED = "#b00020"
LINE_WIDTH = 1.6
ALWAYS_DRAWN = -1  # in the place of a joint, as in page.js: a curve without a box
KEPT, BROKEN = {"symbol": "circle-open", "size": 8}, {"symbol": "x", "size": 9, "color": RED}  # worst values


class Chart(NamedTuple):
    """A quantity of joints with one unit, at all times and frames.

    `key` is that of `ReportData.quantities`.
    """

    key: str
    quantity: Channel
    at_frames: Channel
    unit: str
    joints: list[int]

    @property
    def is_total(self) -> bool:
        """Whether it is of a sum over all joints."""
        return self.key in LIMIT_KINDS.totals

    def tick(self, j: int) -> int:
        """Return the joint whose box shows a column."""
        return ALWAYS_DRAWN if self.is_total else j

    def style(self, j: int) -> dict[str, str]:
        """Return colour and dashes of a column."""
        return {"color": canvas.INK, "dash": "solid"} if self.is_total else joint_style(j)

    @property
    def window(self) -> tuple[float, float] | None:
        """The times between which values are certain; None if all are exact."""
        return self.quantity.windows[0] if self.quantity.windows else None


@dataclass(frozen=True)
class ChartFigure:
    """A figure of plotly, with the ranges of vertical axes.

    They are by chart and joint: lowest, highest. `descriptions` of the charts are for screen readers.
    """

    data: list[JsonObject]
    layout: JsonObject
    ranges: dict[str, dict[int, tuple[float, float]]]
    descriptions: list[str]


def figure(s: ReportData, of_forces: bool) -> ChartFigure:
    """Return the charts of the forces, or of all other quantities."""
    # The points of the page are shared by the curves of both figures.
    charts = charts_of(s, of_forces)
    all_charts = charts + charts_of(s, not of_forces)
    points_per_curve = MAX_CHART_POINTS // sum(len(chart.joints) for chart in all_charts)
    max_points = int(np.clip(points_per_curve, MIN_CURVE_POINTS, MAX_CURVE_POINTS))
    traces, ranges = [], {}
    for i, chart in enumerate(charts):
        axis = "y" if i == 0 else f"y{i + 1}"
        ranges[axis.replace("y", "yaxis")] = {chart.tick(j): _range(s, chart, j) for j in chart.joints}
        for j in chart.joints:
            base = {"xaxis": "x", "yaxis": axis, "meta": chart.tick(j), "hoverinfo": "none", "showlegend": False}
            traces += [base | trace for trace in _traces(s, chart, j, max_points)]
    return ChartFigure(traces, _layout(s, charts, list(ranges)), ranges, [_describe(s, chart) for chart in charts])


def charts_of(s: ReportData, of_forces: bool) -> list[Chart]:
    """Return the charts of a figure from top to bottom."""
    return [
        Chart(key, quantity, s.at_frames[key], unit, [j for j in known if quantity.units[j] == unit])
        for key in s.keys(of_forces)
        for quantity in [s.quantities[key]]
        for known in [list_known(quantity)]
        for unit in dict.fromkeys(quantity.units[j] for j in known)
    ]


def _describe(s: ReportData, chart: Chart) -> str:
    """Describe a chart by its lowest and highest value."""
    values = chart.quantity.values[:, chart.joints]
    ends = [np.unravel_index(find(values), values.shape) for find in (np.argmin, np.argmax)]
    whose = "" if chart.is_total else "joint "
    low, high = (
        f"{values[row, column]:.5g} ({whose}{chart.quantity.names[chart.joints[column]]}, t = {s.t[row]:.5g} s)"
        for row, column in ends
    )
    return f"{chart.quantity.symbol} in {raise_powers(chart.unit)}: from {low} to {high}."


def joint_style(j: int) -> dict[str, str]:
    """Return colour and dashes of the curves of a joint."""
    style = canvas.line_style(j)
    dashes = style["linestyle"]
    lengths = () if dashes == "solid" else dashes[1]
    return {"color": style["color"], "dash": ",".join(f"{LINE_WIDTH * x:g}px" for x in lengths) or "solid"}


def _traces(s: ReportData, chart: Chart, j: int, max_points: int) -> Iterator[JsonObject]:
    """Yield the traces of a joint, from back to front.

    They are limits, the band of deviations, measured values, stretches beyond a limit, the curve, and the worst value.
    """
    values, bounds, style = chart.quantity.values[:, j], chart.quantity.bounds[0][:, j], chart.style(j)
    limit = _find_limit(s, chart, j)
    # The ends of violations are kept when the curve is thinned, unless they are too many. (violations, 2)
    ends = np.searchsorted(s.t, np.reshape(limit.violations if limit is not None else (), (-1, 2)))
    thinned = thin_points(values, max_points)
    shown = np.union1d(thinned, ends) if len(ends) < max_points else thinned
    t = pack_times(s.t[shown])
    if np.isfinite(bounds).any():
        yield _limits(s, bounds, style["color"])
    deviations = chart.at_frames.deviations
    if deviations is not None and np.isfinite(deviations[0][:, j]).all():
        yield _band(chart.at_frames, j, style["color"])
    if chart.quantity.symbol == "Q" and s.motion.torques is not None and j in s.own:
        yield from _measured_torques(s, s.own.index(j), max_points, style["color"])
    if len(ends) > 0:
        values_beyond = np.full(len(values), np.nan)
        for start, stop in ends:
            values_beyond[start : stop + 1] = values[start : stop + 1]
        line = {"color": RED, "width": 7}
        yield {"mode": "lines", "x": t, "y": pack_array(values_beyond[shown], "f4"), "line": line, "opacity": 0.45}
    yield {"mode": "lines", "x": t, "y": pack_array(values[shown], "f4"), "line": {"width": LINE_WIDTH, **style}}
    if limit is not None and np.isfinite(limit.value):
        marker = BROKEN if limit.verdict == "broken" else KEPT | {"color": style["color"]}
        yield {"mode": "markers", "x": [limit.t], "y": [limit.value], "marker": marker}


def _limits(s: ReportData, bounds: np.ndarray, colour: str) -> JsonObject:
    """Return the limits of a joint as lines across the chart."""
    stated = bounds[np.isfinite(bounds)].tolist()
    times = [s.motion.start, s.motion.stop, None] * len(stated)
    line = {"color": colour, "width": 1, "dash": "dot"}
    return {"mode": "lines", "x": times, "y": [y for bound in stated for y in (bound, bound, None)], "line": line}


def _band(at_frames: Channel, j: int, colour: str) -> JsonObject:
    """Return the band of 95 % about a curve, as an outline."""
    count = len(at_frames.times)
    shown = np.linspace(0, count - 1, min(count, MAX_BAND_POINTS)).astype(int)
    t, (lower, upper) = at_frames.times[shown], (edge[shown] for edge in _edges(at_frames, j))
    outline = {
        "x": pack_times(np.concatenate([t, t[::-1]])),
        "y": pack_array(np.concatenate([upper, lower[::-1]]), "f4"),
    }
    return outline | {"mode": "none", "fill": "toself", "fillcolor": colour, "opacity": 0.25}


def _edges(at_frames: Channel, j: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges of the band of 95 % about a curve."""
    assert at_frames.deviations is not None
    values, reach = at_frames.values[:, j], reliability.BAND_DEVIATIONS * at_frames.deviations[0][:, j]
    return values - reach, values + reach


def _measured_torques(s: ReportData, j: int, max_points: int, colour: str) -> Iterator[JsonObject]:
    """Yield the measured torques of joint j as dots."""
    assert s.motion.torques is not None
    t, torques = s.motion.torques
    known_rows = np.flatnonzero(np.isfinite(torques[:, j]))
    shown = known_rows[thin_points(torques[known_rows, j], max_points)] if known_rows.size else known_rows
    marker = {"color": colour, "size": 3, "opacity": 0.35}
    if shown.size > 0:
        yield {"mode": "markers", "x": pack_times(t[shown]), "y": pack_array(torques[shown, j], "f4"), "marker": marker}


def _find_limit(s: ReportData, chart: Chart, j: int) -> CheckedLimit | None:
    """Return the checked limit of a joint that a chart shows."""
    rows = s.check.table if s.check else ()
    return next((row for row in rows if row.joint == chart.quantity.names[j] and row.limit == chart.key), None)


def _range(s: ReportData, chart: Chart, j: int) -> tuple[float, float]:
    """Return the vertical range of a chart: certain values, and limits near them."""
    values = chart.quantity.values[:, j]
    if chart.window is not None:
        start, stop = chart.window
        known, certain = ((start <= t) & (t <= stop) for t in (s.t, chart.at_frames.times))
        edges = _edges(chart.at_frames, j) if chart.at_frames.deviations is not None else ()
        values = np.concatenate([values[known], *(edge[certain] for edge in edges)])
        values = values[np.isfinite(values)]
    low, high = float(values.min()), float(values.max())
    lower_bound, upper_bound = chart.quantity.bounds[0][:, j].tolist()
    span = upper_bound - lower_bound
    # A limit far from the curve would flatten it, and is left out.
    for bound, distance in ((lower_bound, low - lower_bound), (upper_bound, upper_bound - high)):
        if distance <= MAX_ROOM_SHARE * (span if np.isfinite(span) else 2 * abs(bound)) and np.isfinite(bound):
            low, high = min(low, bound), max(high, bound)
    return low, high


def _layout(s: ReportData, charts: list[Chart], axes: list[str]) -> JsonObject:
    """Return the layout of charts above each other.

    The page sets the ranges of their axes by the joints that are drawn.
    """
    count, grid = len(charts), {"gridcolor": "#e6e6e6", "zeroline": False, "linecolor": canvas.INK, "ticks": "outside"}
    time = {"title": {"text": "t [s]"}, "range": [s.motion.start, s.motion.stop]}
    breaks = sorted({jump.t for jump in s.motion.breaks})
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
    # Each chart has an equal share of the height, with its title above the axes; grey areas mark uncertain ends.
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
    """Return grey areas over the uncertain ends of a quantity."""
    start, stop = chart.window or (s.motion.start, s.motion.stop)
    ends = [span for span in ((s.motion.start, start), (stop, s.motion.stop)) if span[0] < span[1]]
    return shade_spans(ends, f"{axis} domain")


def shade_spans(spans: Iterable[tuple[float, float]], height: str) -> list[JsonObject]:
    """Return grey areas between times, with plotly's reference for their height."""
    shape = {"type": "rect", "xref": "x", "yref": height, "y0": 0, "y1": 1, "layer": "below"}
    shape |= {"fillcolor": "#888888", "opacity": 0.25, "line": {"width": 0}}
    return [shape | {"x0": first, "x1": last} for first, last in spans]


def raise_powers(unit: str) -> str:
    """Return a unit with raised powers."""
    return unit.replace("^2", "²").replace("^3", "³").replace("^4", "⁴")


def _break_line(t: float) -> JsonObject:
    line = {"color": "#777777", "width": 1, "dash": "dot"}
    return {"type": "line", "xref": "x", "yref": "paper", "x0": t, "x1": t, "y0": 0, "y1": 1, "line": line}
