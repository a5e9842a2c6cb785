"""Displays: tables of results on terminals, and in notebooks by functions that are registered for types elsewhere."""

from collections.abc import Sequence
from functools import singledispatch
from importlib import import_module

from jounce.core.errors import shorten

Row = tuple[str, ...]

MAX_LINES_PRINTED = 12  # of a result on a terminal, however large the robot is
MAX_NOTES_PRINTED = 3
MAX_NOTE_LENGTH = 160  # characters
REGISTRY = "jounce.figures.displays"  # which registers the functions; it is imported when an object is first shown


@singledispatch
def render_html(shown: object) -> str:
    """Return an object in HTML."""
    from html import escape  # imported here to keep start-up fast

    return escape(repr(shown))


class HtmlDisplay:
    """An object that notebooks show in HTML."""

    def _repr_html_(self) -> str:
        import_module(REGISTRY)
        return render_html(self)


def print_table(head: str, names: Row, rows: Sequence[Row], notes: Sequence[str] = ()) -> str:
    """Return a head, a table and notes in at most twelve lines.

    Rows for which there is no space are counted.
    """
    note_lines = [shorten(note, MAX_NOTE_LENGTH) for note in notes[:MAX_NOTES_PRINTED]]
    if len(notes) > MAX_NOTES_PRINTED:
        note_lines[-1] = f"and {len(notes) - MAX_NOTES_PRINTED + 1} more notes"
    # The head, the names of the columns and the notes take their lines; a line counts the rows that are left out.
    max_rows = MAX_LINES_PRINTED - 2 - len(note_lines)
    shown = rows if len(rows) <= max_rows else rows[: max_rows - 1]
    lines = [f"<{head}>"]
    if len(rows) > 0:
        lines += align_columns([names, *shown])
    if len(shown) < len(rows):
        lines.append(f"and {len(rows) - len(shown)} more")
    return "\n".join([*lines, *note_lines])


def align_columns(rows: Sequence[Row]) -> list[str]:
    """Return lines of cells in columns.

    Names are on the left, all else is on the right.
    """
    cells = [tuple(map(shorten, row)) for row in rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join([row[0].ljust(widths[0]), *map(str.rjust, row[1:], widths[1:])]).rstrip() for row in cells]
