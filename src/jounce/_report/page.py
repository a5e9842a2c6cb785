"""Writes a report: a page about a robot along a motion or identified, in one file.

`report` is the door, for `Robot.report` and the commands. Along a motion it fills the template with the panels of
`jounce._report.panels`. `page_content` is that of an identification: torques measured and computed, what is left and
its spectrum, and the parameters. Style, scripts and plotly.js stand in the page itself, so that it links to no others.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce._report.curves import Packed, list_finite, pack_array, pack_times, raise_powers, shade_spans
from jounce._report.panels import PANELS
from jounce._report.report_data import MAX_REPORT_ORDER, ReportData, make_report_data
from jounce.core import errors
from jounce.core.errors import JounceError, quote_value
from jounce.core.progress import stage
from jounce.core.typing import JsonObject
from jounce.core.version import __version__
from jounce.engine import along
from jounce.engine.engine import Engine
from jounce.figures import canvas
from jounce.figures.panels import thin_points
from jounce.identification import Identification
from jounce.identification.measurements import median_step
from jounce.identification.result import ForceResidual, IdentifiedLog, IdentifiedParameter, unused_spans
from jounce.io import files
from jounce.io.visuals import URDF_SUFFIX
from jounce.limits.slowdown import Slowdown
from jounce.limits.verdicts import Check
from jounce.model import coordinates
from jounce.motion.channel import Span
from jounce.motion.motion import Motion

if TYPE_CHECKING:
    from jinja2 import Environment


HERE = Path(__file__).parent
PAGE_SUFFIXES = (".html", ".htm")


@dataclass(frozen=True, eq=False, repr=False)
class Report:
    """A page about a robot along a motion. `Robot.report` makes one.

    Attributes
    ----------
    html : str
        The page: one file without links to others, which any browser opens from disk.
    check : Check or None
        Every limit along the motion; None where the robot states none, and of an identification.
    slowdown : Slowdown or None
        The largest factor of speed, at most 1, that keeps every limit; None where none does, and the page says why.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r").with_limits(velocity=1.0)
    >>> robot.report(jounce.Motion.polynomial([[0, 2], [0, 0.5]], duration=1.0)).check.worst.ratio
    2.0
    """

    html: str
    check: Check | None
    slowdown: Slowdown | None

    def __repr__(self) -> str:
        return f"<Report: {len(self.html) / 1e6:.1f} MB of HTML; save(path) writes it>"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the page into a file.

        Parameters
        ----------
        path : str or path
            Path of an .html file; an existing file is replaced as a whole.

        Raises
        ------
        JounceError
            If the suffix is another, or the file cannot be written.

        Examples
        --------
        >>> import pathlib, tempfile, jounce
        >>> report = jounce.load("planar2r").report(jounce.Motion.polynomial([[0, 2], [0, 0.5]], duration=1.0))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     report.save(pathlib.Path(folder, "report.html"))
        ...     pathlib.Path(folder, "report.html").read_text(encoding="utf-8")[:15]
        '<!doctype html>'
        """
        if not isinstance(path, str | os.PathLike):
            raise JounceError(f"save() expects a path, got {type(path).__name__}")
        target = files.expand_path(path)
        check_writable(target)
        with files.write_whole(target) as part:
            part.write_text(self.html, encoding="utf-8", newline="\n")


@dataclass(frozen=True)
class CursorFrames:
    """Where the cursor can stand: times, all values there, their bounds (2, n), and when they are known well."""

    n: int
    t: Packed
    values: list[Packed]
    bounds: list[list[list[float | None]]]
    windows: list[Span | None]


@stage("report")
def report(
    robot: Engine,
    motion: Motion | Identification[Any],
    order: int | None,
    visuals: str | os.PathLike[str] | None,
    mesh_folders: Sequence[str | os.PathLike[str]],
    file: str = "",
) -> Report:
    """A page about a robot along a motion, or identified, see `Robot.report`; it names the file, if there is one."""
    check_installed()
    if isinstance(motion, Identification):
        if (order, visuals, list(mesh_folders)) != (None, None, []):
            raise JounceError("order, visuals and mesh_folders are for motions; leave them out for an Identification")
        return Report(_identification_page(motion, file), None, None)
    if not isinstance(motion, Motion):
        raise JounceError(f"report() expects a jounce.Motion, got {type(motion).__name__}; try jounce.load_motion")
    urdf = None if visuals is None else _visuals_file(visuals)
    path, folders = along.check_motion(robot.mechanism, motion), _mesh_folders(mesh_folders)
    subject = make_report_data(robot, path, _order(motion, order), urdf, folders)
    slowdown = subject.slowdown if isinstance(subject.slowdown, Slowdown) else None
    return Report(_page(subject, file), subject.check, slowdown)


def check_installed() -> None:
    """Raise `JounceError` where plotly is missing, which draws the page."""
    with errors.optional_import("reports need plotly", "report"):
        import plotly.offline  # noqa: F401


def check_writable(path: Path) -> None:
    """Raise `JounceError` if `Report.save` could not write, before any work is done."""
    if path.suffix.lower() not in PAGE_SUFFIXES:
        raise JounceError(f"{path}: unknown type of page {path.suffix!r}; available: {', '.join(PAGE_SUFFIXES)}")
    files.check_writable(path)


def _order(motion: Motion, order: int | None) -> int:
    known = motion.highest
    if order is None:
        return MAX_REPORT_ORDER if known is None else max(0, min(MAX_REPORT_ORDER, known - along.Q_RATE_ORDER))
    if isinstance(order, bool) or not isinstance(order, int | np.integer) or not 0 <= int(order) <= MAX_REPORT_ORDER:
        raise JounceError(f"order is {quote_value(order)}; expected 0, 1 or 2: the highest rate of Q on the page")
    return int(order)


def _mesh_folders(given: Sequence[str | os.PathLike[str]]) -> list[Path]:
    if not isinstance(given, list | tuple):
        raise JounceError(f"mesh_folders is {quote_value(given)}; expected a list of folders")
    return [files.expand_path(folder) for folder in given]


def _visuals_file(given: str | os.PathLike[str]) -> Path:
    path = files.expand_path(given)
    if path.suffix.lower() != URDF_SUFFIX:
        raise JounceError(
            f"{path}: visuals are read from {URDF_SUFFIX} files; without visuals= the page draws capsules"
        )
    return path


def _page(s: ReportData, file: str) -> str:
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

    panels = [found for make in PANELS if (found := make(s)) is not None]
    own = [(panel.code, HERE / "panels" / f"{panel.name}.js") for panel in panels]
    of_panels = (code + path.read_text(encoding="utf-8") for code, path in own if path.exists())
    scripts = [_read("common.js"), _read("page.js"), *of_panels]
    return _environment().get_template("page.html.jinja").render(
        robot=s.robot, subject=s, file=file, panels=panels, frames=_frames(s), style=Markup(_read("page.css")),
        library=Markup(get_plotlyjs()), scripts=list(map(Markup, scripts)),
    )  # fmt: skip


def _identification_page(found: Identification[Any], file: str) -> str:
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

    return _environment().get_template("identification.html.jinja").render(
        **vars(page_content(found)), file=file, style=Markup(_read("page.css")), library=Markup(get_plotlyjs()),
        scripts=[Markup(_read(name)) for name in ("common.js", "identification.js")],
    )  # fmt: skip


def _read(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")


def _frames(s: ReportData) -> CursorFrames:
    shown = s.at_frames.values()
    return CursorFrames(
        n=len(s.joints),
        t=pack_array(s.t[s.frames]),
        values=[pack_array(x.values) for x in shown],
        bounds=[list_finite(x.bounds[0]) for x in shown],
        windows=[x.windows[0] if x.windows else None for x in shown],
    )


@cache  # which keeps the templates compiled
def _environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    def printable(x: Any) -> Any:
        """Names from files with control and direction characters escaped."""
        return errors.escape_text(x) if isinstance(x, str) and not isinstance(x, Markup) else x

    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, finalize=printable,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "default": vars}  # of data classes, field by field
    environment.filters["powers"] = raise_powers
    environment.filters["number"] = lambda x: "∞" if np.isinf(x) else f"{x:.5g}"
    return environment


# The page of an identification.
MAX_PAGE_POINTS = 150_000  # of all curves: 2 MB
PAGE_CURVE_POINTS = (300, 4000)  # of one curve, at least and at most, all extremes among them
SPECTRUM_BINS = 200  # of frequencies, evenly spread over their logarithm
SPECTRUM_PIECES = 8  # of a log whose periodograms are averaged: of fewer a spectrum is noise
BAR_WIDTH, BAR_MARGIN = 160, 8  # px
LINES: Mapping[str, JsonObject] = {
    "measured": {"color": canvas.COLOURS[1], "width": 1.2},
    "model": {"color": canvas.COLOURS[0], "width": 1.2, "dash": "4px,2px"},
    "identified": {"color": canvas.INK, "width": 1.2},
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
    names, units = coordinates.force_names(m), coordinates.force_units(m)
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
    grid = {"gridcolor": "#e6e6e6", "zeroline": False, "linecolor": canvas.INK, "ticks": "outside"}
    look = {
        "height": 330, "margin": {"l": 56, "r": 10, "t": 24, "b": 40}, "showlegend": False, "hovermode": "x",
        "font": {"color": canvas.INK, "family": "system-ui, sans-serif", "size": 12}, "dragmode": "zoom",
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
