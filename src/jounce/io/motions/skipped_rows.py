"""Rows that are left out of a table: what is wrong with them, and the table of them next to an output."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

from jounce.core.errors import JounceError
from jounce.io import files

SKIPPED_HEADER = b"file,row,column,problem"  # of a table of rows that are left out


@dataclass(frozen=True)
class Skipped:
    """A row that is left out: its file, its number or that of its line, the column that is wrong and how, its cells.

    Of a motion that is left out, or of rows that cannot be read, it is the first row.
    """

    file: str
    row: int
    column: str
    problem: str
    cells: Mapping[str, str] = field(default_factory=dict)


def resolve_output(output: Path) -> Path:
    """The path of an output, where a link leads: the link stays, and results lie on the disk that it points to."""
    return output.resolve() if output.is_symlink() else output


def skipped_path(output: Path) -> Path:
    """The table of the rows that are left out."""
    path = resolve_output(output)
    return path.with_name(f"{path.name}.skipped.csv")


def check_skipped(path: Path) -> None:
    """Raise `JounceError` if a table of rows that are left out would replace a file of another kind."""
    if path.exists() and not _is_ours(path):
        raise JounceError(f"{path}: bad rows are written there, and it is not of an earlier run; move it away")


def write_skipped(path: Path, columns: Sequence[str], rows: Iterator[Skipped]) -> None:
    """Write the rows that are left out, with all their cells as texts; without any, that of an earlier run goes."""
    first = next(rows, None)
    if first is None:
        if _is_ours(path):
            path.unlink()
        return
    with files.write_whole(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["file", "row", "column", "problem", *columns])
        for row in chain([first], rows):
            writer.writerow([row.file, row.row, row.column, row.problem, *(row.cells.get(x, "") for x in columns)])


def _is_ours(path: Path) -> bool:
    """Whether a file is a table of rows that an earlier run left out."""
    return path.is_file() and path.read_bytes()[: len(SKIPPED_HEADER)] == SKIPPED_HEADER
