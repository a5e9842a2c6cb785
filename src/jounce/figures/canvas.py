"""The canvas of all pictures: one look, distinct curves, whole files."""

import re
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path
from string import ascii_lowercase
from typing import TYPE_CHECKING, Any

from jounce.core import errors
from jounce.core.errors import JounceError
from jounce.io import files

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

Style = Mapping[str, Any]  # keywords of a line, as matplotlib takes them

INK, PALE = "#222222", "#bbbbbb"
# Seven lines: each has a colour (most of Okabe and Ito, safe for the colour-blind) and a dash pattern of its own.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000", "#56b4e9", "#7a5c00")
DASHES: tuple[Any, ...] = (
    "solid",
    (0, (6, 1.5)),
    (0, (1.2, 1.2)),
    (0, (6, 1.5, 1.2, 1.5)),
    (0, (3, 1.2)),
    (0, (9, 1.5, 1.2, 1.5, 1.2, 1.5)),
    (0, (12, 3)),
)
LOOK: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "mathtext.fontset": "dejavusans",
    "savefig.dpi": 160,
    "savefig.bbox": "tight",
    "savefig.pad_inches": 0.08,
    "svg.hashsalt": "jounce",  # the same figure gives the same file
    "svg.fonttype": "path",
    "pdf.fonttype": 42,  # TrueType: journals refuse Type 3
}
# A page of a journal: its width is exact, its letters are those of captions.
PRINT: Any = LOOK | {
    "font.size": 8,
    "axes.titlesize": 8,
    "lines.linewidth": 1,
    "savefig.bbox": "standard",
    "savefig.dpi": 600,
}
PICTURE_FORMATS = ("png", "svg", "pdf")
# On a dark page an SVG is dark: light and dark change places, hues stay. A page that sets its scheme by `color-scheme`
# passes it on to its pictures; where a viewer knows neither, the picture is a light card, legible on any page.
INVERTED = b"filter: invert(.9) hue-rotate(180deg) brightness(1.2)"
DARK = b"@media (prefers-color-scheme: dark) {svg:has(> #figure_1) {" + INVERTED + b"}}"


def check_installed() -> None:
    """Raise `JounceError` if matplotlib is missing.

    It takes half a second to import, and is needed for pictures only.
    """
    with errors.optional_import("pictures need matplotlib", "figures"):
        import matplotlib.figure  # noqa: F401


def painted(paint: "Callable[[Figure], None]", width: float, height: float, look: Any = LOOK) -> "Figure":
    """Paint a figure of a size in inches in jounce's style.

    No window is opened, and no global setting is changed.
    """
    check_installed()
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(look):
        figure = Figure(figsize=(width, height), layout="constrained")
        paint(figure)
        return figure


def line_style(i: int) -> Style:
    """Return colour and dashes of the i-th of several curves."""
    return {"color": COLOURS[i % len(COLOURS)], "linestyle": DASHES[(i + i // len(COLOURS)) % len(DASHES)]}


def printable_name(name: str) -> str:
    """Return a name as the font of pictures can write it.

    It is shortened, and escaped where the font has no glyph.
    """
    from matplotlib.font_manager import FontProperties, findfont, get_font

    # This font comes with matplotlib.
    glyphs = get_font(findfont(FontProperties(family="DejaVu Sans"))).get_charmap()
    return "".join(c if ord(c) in glyphs else c.encode("unicode_escape").decode() for c in errors.shorten(name))


def axes_letter(i: int) -> str:
    """Return the letters of the i-th axes: a, ..., z, aa, ab, ..."""
    return ("" if i < 26 else axes_letter(i // 26 - 1)) + ascii_lowercase[i % 26]


def legend_above(figure: "Figure", entries: Mapping[str, Style], columns: int = 8, **options: Any) -> None:
    """Draw a legend in rows above all axes, where it hides nothing.

    Its entries are names and their line styles. It has as many columns as the page has space for. From the third row
    on, the page grows with the legend.
    """
    # The widths of names are known once they are drawn: columns are tried from the largest number down.
    for count in range(min(columns, len(entries)), 0, -1):
        legend = _legend(figure, entries, count, options)
        box = legend.get_window_extent()
        if box.width <= figure.bbox.width or count == 1:
            break
        legend.remove()
    rows = -(-len(entries) // count)
    # If the last row is short, the same number of rows needs fewer columns.
    if -(-len(entries) // rows) < count:
        legend.remove()
        box = _legend(figure, entries, -(-len(entries) // rows), options).get_window_extent()
    if rows > 2:
        figure.set_figheight(figure.get_figheight() + box.height * (1 - 2 / rows) / figure.dpi)


def _legend(figure: "Figure", entries: Mapping[str, Style], columns: int, options: Mapping[str, Any]) -> "Legend":
    """Draw a legend that is read row by row.

    matplotlib fills it column by column.
    """
    from matplotlib.lines import Line2D

    names = [name for column in range(columns) for name in list(entries)[column::columns]]
    handles = [Line2D([], [], **entries[name]) for name in names]
    legend = figure.legend(
        handles, ["-"] * len(handles), loc="outside upper center", ncols=columns, handlelength=3.6, **options
    )
    for text, name in zip(legend.get_texts(), names, strict=True):
        # $ and _ of a name are not marks of TeX, and a leading _ must not hide it.
        text.set_parse_math(False)
        text.set_text(printable_name(name))
    return legend


def check_format(path: Path) -> None:
    """Raise `JounceError` if no picture of this suffix can be written."""
    if path.suffix.lower().removeprefix(".") not in PICTURE_FORMATS:
        known = [f".{name}" for name in PICTURE_FORMATS]
        raise JounceError(f"{path}: {errors.unknown_name_error('type of picture', path.suffix, known)}")


def check_writable(path: Path) -> None:
    """Raise `JounceError` if a picture cannot be drawn to a file."""
    check_format(path)
    files.check_writable(path)
    check_installed()


def save(figure: "Figure", path: Path, look: Any = LOOK) -> None:
    """Write a figure whole, as PNG, SVG or PDF by its suffix.

    The same figure gives the same file.
    """
    import matplotlib

    check_format(path)
    format_name = path.suffix.lower().removeprefix(".")
    metadata = {"png": {}, "pdf": {"CreationDate": None}}
    with matplotlib.rc_context(look), files.write_whole(path) as part:
        if format_name == "svg":
            part.write_bytes(svg(figure, look))
        else:
            figure.savefig(part, format=format_name, metadata=metadata[format_name])


def svg(figure: "Figure", look: Any = LOOK) -> bytes:
    """Return a figure as SVG, which turns dark on dark pages.

    Each path is one line, in hundredths of a point.
    """
    import matplotlib

    content = BytesIO()
    with matplotlib.rc_context(look):
        figure.savefig(content, format="svg", metadata={"Date": None})
    shortened = re.sub(rb'(?<= d=")[^"]+', _shorten_path, content.getvalue())
    return shortened.replace(b"</style>", DARK + b"</style>", 1)


def _shorten_path(path: re.Match[bytes]) -> bytes:
    """Round the numbers of a path, and write it in one line."""
    return re.sub(rb"-?\d+\.\d+", lambda x: b"%g" % round(float(x[0]), 2), b" ".join(path[0].split()))
