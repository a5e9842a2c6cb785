"""The page of an identification: torques measured and computed, what is left and its spectrum, and the parameters."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from jounce._report.array_text import pack_array, pack_times
from jounce._report.curves import raise_powers, shade_spans
from jounce.core.typing import JsonObject
from jounce.core.version import __version__
from jounce.engine.engine import Engine
from jounce.figures.canvas import COLOURS, INK
from jounce.figures.panels import thin_points
from jounce.identification.measurements import median_step
from jounce.identification.result import ForceResidual, Identification, IdentifiedLog, IdentifiedParameter, unused_spans
from jounce.model.coordinates import force_names, force_units

MAX_PAGE_POINTS = 150_000  # of all curves: 2 MB
PAGE_CURVE_POINTS = (300, 4000)  # of one curve, at least and at most, all extremes among them
SPECTRUM_BINS = 200  # of frequencies, evenly spread over their logarithm
SPECTRUM_PIECES = 8  # of a log whose periodograms are averaged: of fewer a spectrum is noise
BAR_WIDTH, BAR_MARGIN = 160, 8  # px
LINES: Mapping[str, JsonObject] = {
    "measured": {"color": COLOURS[1], "width": 1.2},
    "model": {"color": COLOURS[0], "width": 1.2, "dash": "4px,2px"},
    "identified": {"color": INK, "width": 1.2},
}


@dataclass(frozen=True)
class Plot:
    """A figure of plotly."""

    data: list[JsonObject]
    layout: JsonObject


@dataclass(frozen=True)
class IdentificationPage:
    """What the template of the page is filled with: `figures` by log and force, the curves and their spectra."""

    found: Identification[Any]
    robot: Engine
    forces: list[str]
    residuals: list[list[ForceResidual]]
    bars: list[dict[str, float]]
    width: int
    figures: list[list[tuple[Plot, Plot]]]
    lines: Mapping[str, JsonObject]
    versions: Mapping[str, str]


def page_content(found: Identification[Any]) -> IdentificationPage:
    """The page of what is found."""
    m = found.robot.mechanism
    names, units = force_names(m), force_units(m)
    seen = np.flatnonzero(np.isfinite(found.measured).any(axis=0)).tolist()
    share = MAX_PAGE_POINTS // (5 * len(seen) * len(found.logs))
    most = int(np.clip(share, *PAGE_CURVE_POINTS))
    figures = [[_figures(found, log, j, raise_powers(units[j]), most) for j in seen] for log in found.logs]
    rows = [[row for row in found.residuals if row.log == log.name] for log in found.logs]
    versions = {"jounce": __version__, "NumPy": np.__version__}
    bars, forces = list(map(_bar, found.table)), [names[j] for j in seen]
    return IdentificationPage(found, found.robot, forces, rows, bars, BAR_WIDTH, figures, LINES, versions)


def _figures(found: Identification[Any], log: IdentifiedLog, j: int, unit: str, most: int) -> tuple[Plot, Plot]:
    """The curves of a force over the time of a log, and the spectra of what is left, as figures of plotly."""
    t = found.t[log.rows]
    forces = {channel.symbol: channel.values[log.rows, j] for channel in found.channels}
    left = {what: forces["measured"] - values for what, values in forces.items() if what != "measured"}
    data = [
        {"name": what, "x": pack_times(t[at]), "y": pack_array(values[at], "f4"), "yaxis": axis, "line": LINES[what]}
        for axis, of in (("y", forces), ("y2", left))
        for what, values in of.items()
        for at in [thin_points(np.nan_to_num(values), most)]
    ]
    spectra = [
        {"name": what, "x": f.tolist(), "y": density.tolist(), "line": LINES[what]}
        for what, values in {"measured": forces["measured"], **left}.items()
        for f, density in [_spectrum(t, values)]
    ]
    grid = {"gridcolor": "#e6e6e6", "zeroline": False, "linecolor": INK, "ticks": "outside"}
    look = {
        "height": 330, "margin": {"l": 56, "r": 10, "t": 24, "b": 40}, "showlegend": False, "hovermode": "x",
        "font": {"color": INK, "family": "system-ui, sans-serif", "size": 12}, "dragmode": "zoom",
        "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)",
    }  # fmt: skip
    times = look | {
        "xaxis": grid | {"title": {"text": "t [s]"}, "anchor": "y2", "range": [float(t[0]), float(t[-1])]},
        "yaxis": grid | {"domain": [0.42, 1]}, "yaxis2": grid | {"domain": [0, 0.33]},
        "annotations": [_title(f"force [{unit}]", 1), _title(f"measured less computed [{unit}]", 0.33)],
        "shapes": shade_spans(unused_spans(log, t), "paper"),
    }  # fmt: skip
    band = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": log.band, "x1": log.band}
    frequencies = look | {
        "xaxis": grid | {"type": "log", "dtick": 1, "title": {"text": "f [Hz]"}},
        "yaxis": grid | {"type": "log", "dtick": 1, "exponentformat": "power"},
        "annotations": [_title(f"spectrum of the same [{unit}/√Hz]", 1)],
        "shapes": [band | {"line": {"color": "#777777", "width": 1, "dash": "dot"}}],
    }
    return Plot(data, times), Plot(spectra, frequencies)


def _title(text: str, y: float) -> JsonObject:
    place = {"xref": "paper", "x": 0, "xanchor": "left", "yref": "paper", "y": y, "yanchor": "bottom"}
    return place | {"text": text, "showarrow": False}


def _spectrum(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and amplitude densities of a force, by Welch's method, means of power over bins of frequency.

    What is not measured is bridged by lines.
    """
    from scipy.signal import welch  # imported here to keep start-up fast

    known, step = np.isfinite(values), median_step(t)
    even = t[0] + step * np.arange(int((t[-1] - t[0]) / step) + 1)
    x = np.interp(even, t[known], values[known]) if known.any() else np.zeros(len(even))
    f, power = welch(x, 1 / step, nperseg=min(len(x), max(256, 2 * len(x) // SPECTRUM_PIECES)))
    f, power = f[1:], power[1:]
    bins = np.searchsorted(np.geomspace(f[0], f[-1], SPECTRUM_BINS), f)
    place = np.unique(bins, return_inverse=True)[1]
    counts = np.bincount(place)
    return np.bincount(place, f) / counts, np.sqrt(np.bincount(place, power) / counts)


def _bar(row: IdentifiedParameter) -> dict[str, float]:
    """Where value, model and value -+ 2 deviations stand on a bar; a deviation without end fills it."""
    reach = 2 * row.deviation if np.isfinite(row.deviation) else 2 * max(abs(row.value), abs(row.model), 1.0)
    places = np.array([row.value - reach, row.value, row.value + reach, row.model])
    span = np.ptp(places) or 1.0
    x = BAR_MARGIN + (BAR_WIDTH - 2 * BAR_MARGIN) * (places - places.min()) / span
    return dict(zip(("low", "value", "high", "model"), x.round(1).tolist(), strict=True))
