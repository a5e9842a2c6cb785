"""The grid of axes on a page: as many columns as it is wide enough for, the labels of scales once in each row."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from jounce.core.cures import option_name
from jounce.core.errors import JounceError, quote_value
from jounce.figures.canvas import axes_letter

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MM_PER_INCH = 25.4  # mm
COLUMN_WIDTH, PAGE_WIDTH = 88.9, 181.9  # mm, of the journals of the IEEE; those of Elsevier have 90 and 190
MIN_AXES_WIDTH = 2.1  # inches of a column of axes: its tick labels need it
MIN_PICTURE_WIDTH, MAX_PICTURE_WIDTH = 30.0, 500.0  # mm: below, nothing can be read; above, no paper is as wide


def parse_width(text: str) -> float:
    """The width in inches that "column", "page" or a number of mm means; `JounceError` if nothing can be read on it."""
    try:
        found = {"column": COLUMN_WIDTH, "page": PAGE_WIDTH}.get(text) or float(text)
    except ValueError:
        found = 0.0
    if not MIN_PICTURE_WIDTH <= found <= MAX_PICTURE_WIDTH:
        raise JounceError(
            f"{option_name('width')} {quote_value(text)};"
            f" expected column, page or {MIN_PICTURE_WIDTH:g} to {MAX_PICTURE_WIDTH:g} mm"
        )
    return found / MM_PER_INCH


def page_size(
    columns: int, alike: int, cells: int, labels: int, width: float | None
) -> tuple[tuple[float, float], int]:
    """The size in inches of a page of axes, and its columns: for a width fewer, if possible a multiple of `alike`."""
    if width is None:
        size = 3 + (4.2 if columns < 3 else 3.2) * columns, 0.7 + 2.2 * labels * -(-cells // columns)
        return size, columns
    columns = max(1, min(columns, int(width / MIN_AXES_WIDTH)))
    columns = max(columns - columns % alike, 1)
    row = min(2.2, max(1.2, 0.55 * width / columns))
    return (width, 0.5 + row * labels * -(-cells // columns)), columns


def create_axes_grid(figure: "Figure", cells: int, columns: int, labels: int) -> "Sequence[Sequence[Axes]]":
    """The axes of every cell, label by label, in a grid with a common time axis."""
    rows = -(-cells // columns)
    grid = figure.subplots(labels * rows, columns, sharex=True, squeeze=False)
    for axes in grid[-1]:
        axes.set_xlabel("t [s]")
    found = [list(grid[k * rows : (k + 1) * rows].flat) for k in range(labels)]
    for k, of_label in enumerate(found):
        for at in range(cells, rows * columns):
            of_label[at].remove()
            if k == labels - 1 and rows > 1:  # what stands above is now the last of its column
                above = of_label[at - columns]
                above.tick_params(labelbottom=True)
                above.set_xlabel("t [s]")
    return [of_label[:cells] for of_label in found]


def leave_out_labels(grid: "Sequence[Sequence[Axes]]", columns: int) -> None:
    """Label scales once in each row of one unit, and give each of several axes a letter."""
    for of_label in grid:
        for i in range(len(of_label) - 1, 0, -1):
            if i % columns and of_label[i - 1].get_ylabel() == of_label[i].get_ylabel():
                of_label[i].set_ylabel("")
    every = [axes for of_label in grid for axes in of_label]
    for i, axes in enumerate(every if len(every) > 1 else []):
        axes.set_title(f"({axes_letter(i)})", loc="left")
