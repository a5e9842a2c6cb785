"""The canvas of all pictures: one look, axes told apart in colour and in grey, files written whole."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jounce.errors import JounceError, no_such, shortened
from jounce.io import files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
}
FORMATS = ("png", "svg", "pdf")


def check_installed() -> None:
    """Raise `JounceError` where matplotlib, half a second to import and only for pictures, is missing."""
    try:
        import matplotlib.figure  # noqa: F401
    except ModuleNotFoundError:
        raise JounceError("pictures need matplotlib; install it by: pip install 'jounce[figures]'") from None


def painted(paint: "Callable[[Figure], None]", width: float, height: float) -> "Figure":
    """Paint a figure of a size in inches in jounce's style; no window is opened, no global setting changed."""
    check_installed()
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(LOOK):
        figure = Figure(figsize=(width, height), layout="constrained")
        paint(figure)
        return figure


def line_style(i: int) -> dict[str, Any]:
    """Colour and dashes of the i-th of several curves."""
    return {"color": COLOURS[i % len(COLOURS)], "linestyle": DASHES[(i + i // len(COLOURS)) % len(DASHES)]}


def legend_above(figure: "Figure", entries: Mapping[str, Mapping[str, Any]], columns: int = 8, **options: Any) -> None:
    """A legend of names, as they stand, and their line styles, in rows above all the axes, where it hides nothing.

    It has as many columns as the page is wide enough for, and from its third row on the page grows with it.
    """
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], **style) for style in entries.values()]
    for count in range(min(columns, len(entries)), 0, -1):
        legend = figure.legend(
            handles, ["-"] * len(handles), loc="outside upper center", ncols=count, handlelength=3.6, **options
        )
        for text, name in zip(legend.get_texts(), entries, strict=True):
            text.set_parse_math(False)  # $ and _ of a name are not marks of TeX, nor does a first _ hide it
            text.set_text(shortened(name))
        box = legend.get_window_extent()
        if box.width <= figure.bbox.width or count == 1:
            break
        legend.remove()
    rows = -(-len(entries) // count)
    if rows > 2:
        figure.set_figheight(figure.get_figheight() + box.height * (1 - 2 / rows) / figure.dpi)


def check_format(path: Path) -> None:
    """Raise `JounceError` where no picture of this suffix can be written."""
    if path.suffix.lower().removeprefix(".") not in FORMATS:
        raise JounceError(f"{path}: {no_such('type of picture', path.suffix, [f'.{name}' for name in FORMATS])}")


def save(figure: "Figure", path: Path) -> None:
    """Write a figure whole, as PNG, SVG or PDF by its suffix; the same figure gives the same file."""
    import matplotlib

    check_format(path)
    kind = path.suffix.lower().removeprefix(".")
    undated = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    with matplotlib.rc_context(LOOK), files.written_whole(path) as part:
        figure.savefig(part, format=kind, metadata=undated)
