"""Tables read by spans, from one place in a file to another: rows of Parquet and NPZ tables, bytes of CSV tables.

Spans follow each other without gaps, can be read in any order, and take a bounded amount of memory.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from jounce.core.errors import JounceError
from jounce.io.spans import csv, npz, parquet
from jounce.io.spans.chunk import Chunk, Span


class Format(Protocol):
    """How tables of a type are read by spans; the modules of this package are such."""

    FIRST: tuple[int, int]  # the place of the first row or line, and its number

    def names(self, path: Path, /) -> list[str]:
        """The names of the columns."""

    def size(self, path: Path, /) -> int:
        """The bytes that the numbers take in memory, or the text in the file."""

    def check_numbers(self, path: Path, names: Sequence[str], /) -> None:
        """Raise `JounceError` where a column does not hold numbers, as far as is known without reading it."""

    def spans(self, path: Path, cells: int, /) -> list[Span]:
        """The spans of a table, of about a number of cells each."""

    def chunks(self, path: Path, names: Sequence[str], texts: str | None, span: Span, /) -> Iterator[Chunk]:
        """Some columns of numbers, and one of texts, of the rows of a span."""

    def row_before(self, path: Path, place: int, /) -> Span | None:
        """The span of the row that ends at a place, if there is one."""

    def next_row(self, path: Path, place: int, /) -> Span | None:
        """The span of the row that begins at a place, if there is one."""

    def number(self, path: Path, place: int, known: tuple[int, int], /) -> int:
        """The number of the row at a place; `known` are a place before it and the number of its row."""

    def row(self, path: Path, number: int, /) -> str:
        """The row of a number in words."""


FORMATS: Mapping[str, Format] = {".parquet": parquet, ".csv": csv, ".npz": npz, ".tsv": csv, ".txt": csv}


def place(path: Path, at: int) -> str:
    """A place in a file in words."""
    form = format_of(path)
    return form.row(path, form.number(path, at, form.FIRST))


def format_of(path: Path) -> Format:
    """The format of a file, by its suffix."""
    if path.suffix.lower() not in FORMATS:
        raise JounceError(f"{path}: unknown type of table {path.suffix!r}; read by rows are: {', '.join(FORMATS)}")
    return FORMATS[path.suffix.lower()]
