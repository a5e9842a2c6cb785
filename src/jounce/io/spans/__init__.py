"""Tables read by spans, from one place in a file to another: rows of Parquet and NPZ tables, bytes of CSV tables.

Spans follow each other without gaps, can be read in any order, and take a bounded amount of memory.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from jounce.errors import JounceError
from jounce.io.spans import csv, npz, parquet
from jounce.io.spans.chunk import Chunk, Span


class Format(NamedTuple):
    """How tables of a type are read by spans."""

    names: Callable[[Path], list[str]]
    size: Callable[[Path], int]  # bytes that the numbers take in memory, or the text in the file
    spans: Callable[[Path, int], list[Span]]  # of a number of cells each, about
    chunks: Callable[[Path, Sequence[str], str | None, Span], Iterator[Chunk]]  # of columns of numbers and one of texts
    next_row: Callable[[Path, int], Span | None]  # the span of the row that begins at a place, if there is one
    number: Callable[[Path, int, tuple[int, int]], int]  # of the row at a place, from a place and number before it
    row: Callable[[Path, int], str]  # the row of a number, in words
    first: tuple[int, int] = (0, 0)  # the place of the first row, and its number


PARQUET = Format(
    parquet.names, parquet.size, parquet.spans, parquet.chunks, parquet.next_row, parquet.number, parquet.row
)
CSV = Format(csv.names, csv.size, csv.spans, csv.chunks, csv.next_row, csv.number, csv.row, csv.FIRST)
NPZ = Format(npz.names, npz.size, npz.spans, npz.chunks, npz.next_row, npz.number, npz.row)
FORMATS: Mapping[str, Format] = {".parquet": PARQUET, ".csv": CSV, ".npz": NPZ, ".tsv": CSV, ".txt": CSV}


def place(path: Path, at: int) -> str:
    """A place in a file in words."""
    form = format_of(path)
    return form.row(path, form.number(path, at, form.first))


def format_of(path: Path) -> Format:
    """The format of a file, by its suffix."""
    if path.suffix.lower() not in FORMATS:
        raise JounceError(f"{path}: unknown type of table {path.suffix!r}; read by rows are: {', '.join(FORMATS)}")
    return FORMATS[path.suffix.lower()]
