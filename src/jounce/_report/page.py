"""Writes a report: a page about a robot along a motion or identified, in one file.

`report` makes the page, for `Robot.report` and the commands. Along a motion it fills the template with the panels of
`jounce._report.panels`. For an identification it fills another with `page_content`: measured and computed torques,
residuals and their spectra, and the parameters. Style, scripts and plotly.js stand in the page, which links to nothing.
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
from jounce.core.cures import Remedy, option_name
from jounce.core.errors import JounceError, door, quote_value
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


@door
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
    """The times of the cursor, with values and bounds (2, n) there.

    `windows` are the spans in which values are certain; `start` is the frame at which the page opens.
    """

    n: int
    start: int
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
    """Make a page about a motion or an identification, see `Robot.report`.

    The page names the `file` of the motion, if there is one.
    """
    check_installed()
    if isinstance(motion, Identification):
        if (order, visuals, list(mesh_folders)) != (None, None, []):
            raise JounceError("order, visuals and mesh_folders are for motions; leave them out for an Identification")
        refuse_poses(motion.at_rest)
        return Report(_identification_page(motion, file), None, None)
    if not isinstance(motion, Motion):
        raise JounceError(f"report() expects a jounce.Motion, got {type(motion).__name__}; try jounce.load_motion")
    urdf = None if visuals is None else _visuals_file(visuals)
    path, folders = along.check_motion(robot.mechanism, motion), _mesh_folders(mesh_folders)
    subject = make_report_data(robot, path, _order(motion, order), urdf, folders)
    slowdown = subject.slowdown if isinstance(subject.slowdown, Slowdown) else None
    return Report(_page(subject, file), subject.check, slowdown)


def refuse_poses(at_rest: bool) -> None:
    """Raise `JounceError` of an identification from poses at rest: a page shows curves over time, and spectra."""
    if at_rest:
        other = Remedy("print the result", "--picture and --table show the result")
        raise JounceError(f"{option_name('report')} shows torques over time, which poses at rest have not; {other}")


def check_installed() -> None:
    """Raise `JounceError` if plotly is missing."""
    with errors.optional_import("reports need plotly", "report"):
        import plotly.offline  # noqa: F401


def check_writable(path: Path) -> None:
    """Raise `JounceError` if `Report.save` cannot write to a path."""
    if path.suffix.lower() not in PAGE_SUFFIXES:
        raise JounceError(f"{path}: unknown type of page {path.suffix!r}; available: {', '.join(PAGE_SUFFIXES)}")
    files.check_writable(path)


def _order(motion: Motion, order: int | None) -> int:
    """Return the highest rate of Q on the page: as given, or as the motion allows."""
    highest = motion.highest
    if order is None:
        if highest is None:
            return MAX_REPORT_ORDER
        return max(0, min(MAX_REPORT_ORDER, highest - along.Q_RATE_ORDER))
    if isinstance(order, bool) or not isinstance(order, int | np.integer) or not 0 <= int(order) <= MAX_REPORT_ORDER:
        raise JounceError(f"order is {quote_value(order)}; expected 0, 1 or 2: the highest rate of Q on the page")
    return int(order)


def _mesh_folders(folders: Sequence[str | os.PathLike[str]]) -> list[Path]:
    if not isinstance(folders, list | tuple):
        raise JounceError(f"mesh_folders is {quote_value(folders)}; expected a list of folders")
    return [files.expand_path(folder) for folder in folders]


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

    # Robots have no use for some panels. A panel with a script of its own may have code for the robot before it.
    panels = [panel for panel in (make(s) for make in PANELS) if panel is not None]
    panel_scripts = [(panel.code, HERE / "panels" / f"{panel.name}.js") for panel in panels]
    codes = (code + path.read_text(encoding="utf-8") for code, path in panel_scripts if path.exists())
    scripts = [_read("common.js"), _read("page.js"), *codes]
    return _environment().get_template("page.html.jinja").render(
        robot=s.robot, subject=s, file=file, panels=panels, frames=_frames(s), style=Markup(_read("page.css")),
        library=Markup(get_plotlyjs()), scripts=list(map(Markup, scripts)),
    )  # fmt: skip


def _identification_page(identified: Identification[Any], file: str) -> str:
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

    return _environment().get_template("identification.html.jinja").render(
        **vars(page_content(identified)), file=file, style=Markup(_read("page.css")), library=Markup(get_plotlyjs()),
        scripts=[Markup(_read(name)) for name in ("common.js", "identification.js")],
    )  # fmt: skip


def _read(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")


def _frames(s: ReportData) -> CursorFrames:
    """Return the values of all quantities at the times of the cursor."""
    shown = s.at_frames.values()
    return CursorFrames(
        n=len(s.joints),
        start=s.start_frame,
        t=pack_array(s.t[s.frames]),
        values=[pack_array(x.values) for x in shown],
        bounds=[list_finite(x.bounds[0]) for x in shown],
        windows=[x.windows[0] if x.windows else None for x in shown],
    )


@cache  # templates stay compiled
def _environment() -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    def printable(x: Any) -> Any:
        """Names from files with control and direction characters escaped."""
        return errors.escape_text(x) if isinstance(x, str) and not isinstance(x, Markup) else x

    def breakable(name: str) -> Markup:
        """Return a name that may break after each underscore."""
        return Markup("_<wbr>").join(errors.escape_text(name).split("_"))

    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, finalize=printable,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    # Data classes become JSON field by field.
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "default": vars}
    environment.filters["powers"] = raise_powers
    environment.filters["breakable"] = breakable
    environment.filters["number"] = lambda x: "∞" if np.isinf(x) else f"{x:.5g}"
    return environment


# The page of an identification.
MAX_PAGE_POINTS = 150_000  # of all curves: 2 MB
PAGE_CURVE_POINTS = (300, 4000)  # fewest and most points of a curve, including all its extremes
SPECTRUM_BINS = 200  # of frequencies, evenly spread over their logarithm
SPECTRUM_PIECES = 8  # of a log, whose periodograms are averaged: a spectrum of fewer pieces is noise
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
    """The content of the page; `figures` are by log and force."""

    found: Identification[Any]
    robot: Engine
    forces: list[str]
    residuals: list[list[ForceResidual]]
    bars: list[dict[str, float]]
    width: int
    figures: list[list[tuple[Plot, Plot]]]
    lines: Mapping[str, JsonObject]
    versions: Mapping[str, str]


def page_content(identified: Identification[Any]) -> IdentificationPage:
    """Return the content of the page about an identification."""
    # Each figure has five curves: three forces, and two residuals.
    m = identified.robot.mechanism
    names, units = coordinates.force_names(m), coordinates.force_units(m)
    measured_columns = np.flatnonzero(np.isfinite(identified.measured).any(axis=0)).tolist()
    points_per_curve = MAX_PAGE_POINTS // (5 * len(measured_columns) * len(identified.logs))
    max_points = int(np.clip(points_per_curve, *PAGE_CURVE_POINTS))
    figures = [
        [_figures(identified, log, j, raise_powers(units[j]), max_points) for j in measured_columns]
        for log in identified.logs
    ]
    rows = [[row for row in identified.residuals if row.log == log.name] for log in identified.logs]
    versions = {"jounce": __version__, "NumPy": np.__version__}
    bars, forces = list(map(_bar, identified.table)), [names[j] for j in measured_columns]
    return IdentificationPage(identified, identified.robot, forces, rows, bars, BAR_WIDTH, figures, LINES, versions)


def _figures(
    identified: Identification[Any], log: IdentifiedLog, j: int, unit: str, max_points: int
) -> tuple[Plot, Plot]:
    """Return two figures of a force in a log: curves over time, and spectra."""
    t = identified.t[log.rows]
    forces = {channel.symbol: channel.values[log.rows, j] for channel in identified.channels}
    residuals = {name: forces["measured"] - values for name, values in forces.items() if name != "measured"}
    data = [
        {
            "name": name,
            "x": pack_times(t[shown]),
            "y": pack_array(values[shown], "f4"),
            "yaxis": axis,
            "line": LINES[name],
        }
        for axis, curves in (("y", forces), ("y2", residuals))
        for name, values in curves.items()
        for shown in [thin_points(np.nan_to_num(values), max_points)]
    ]
    spectra = [
        {"name": name, "x": f.tolist(), "y": density.tolist(), "line": LINES[name]}
        for name, values in {"measured": forces["measured"], **residuals}.items()
        for f, density in [_spectrum(t, values)]
    ]
    grid = {"gridcolor": "#e6e6e6", "zeroline": False, "linecolor": canvas.INK, "ticks": "outside"}
    layout = {
        "height": 330, "margin": {"l": 56, "r": 10, "t": 24, "b": 40}, "showlegend": False, "hovermode": "x",
        "font": {"color": canvas.INK, "family": "system-ui, sans-serif", "size": 12}, "dragmode": "zoom",
        "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)",
    }  # fmt: skip
    # Forces above, residuals below, with the stretches that were not used in grey.
    times = layout | {
        "xaxis": grid | {"title": {"text": "t [s]"}, "anchor": "y2", "range": [float(t[0]), float(t[-1])]},
        "yaxis": grid | {"domain": [0.42, 1]}, "yaxis2": grid | {"domain": [0, 0.33]},
        "annotations": [_title(f"force [{unit}]", 1), _title(f"measured less computed [{unit}]", 0.33)],
        "shapes": shade_spans(unused_spans(log, t), "paper"),
    }  # fmt: skip
    # Spectra on logarithmic axes, with a line at the band of the fit.
    band = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": log.band, "x1": log.band}
    frequencies = layout | {
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
    """Return frequencies and amplitude densities of a force, by Welch's method.

    Densities are roots of mean powers over bins of frequency. Missing samples are interpolated by lines.
    """
    from scipy.signal import welch  # imported here to keep start-up fast

    is_known, step = np.isfinite(values), median_step(t)
    even = t[0] + step * np.arange(int((t[-1] - t[0]) / step) + 1)
    x = np.interp(even, t[is_known], values[is_known]) if is_known.any() else np.zeros(len(even))
    f, power = welch(x, 1 / step, nperseg=min(len(x), max(256, 2 * len(x) // SPECTRUM_PIECES)))
    # The mean has no place on a logarithmic axis.
    f, power = f[1:], power[1:]
    bins = np.searchsorted(np.geomspace(f[0], f[-1], SPECTRUM_BINS), f)
    bin_of_frequency = np.unique(bins, return_inverse=True)[1]
    counts = np.bincount(bin_of_frequency)
    return np.bincount(bin_of_frequency, f) / counts, np.sqrt(np.bincount(bin_of_frequency, power) / counts)


def _bar(row: IdentifiedParameter) -> dict[str, float]:
    """Return the places of value, model and deviations on a bar.

    An infinite deviation fills the bar.
    """
    reach = 2 * row.deviation if np.isfinite(row.deviation) else 2 * max(abs(row.value), abs(row.model), 1.0)
    places = np.array([row.value - reach, row.value, row.value + reach, row.model])
    span = np.ptp(places) or 1.0
    x = BAR_MARGIN + (BAR_WIDTH - 2 * BAR_MARGIN) * (places - places.min()) / span
    return dict(zip(("low", "value", "high", "model"), x.round(1).tolist(), strict=True))
