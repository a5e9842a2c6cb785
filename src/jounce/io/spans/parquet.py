"""Spans of Parquet tables: row groups, each read in chunks of rows."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import fsencode
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.core.errors import JounceError, one_line, quoted
from jounce.io.columns import check_distinct
from jounce.io.files import check_readable
from jounce.io.remainders import split_names, with_remainders
from jounce.io.spans.chunk import Chunk, Span, rows_of

if TYPE_CHECKING:
    from pyarrow.parquet import ParquetFile

FIRST = 0, 0  # the place of the first row, and its number


def pyarrow(path: object) -> Any:
    """The modules pyarrow and pyarrow.parquet, or the error that says how to install them."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise JounceError(f"{path}: Parquet needs pyarrow; install it by: pip install 'jounce[tables]'") from None
    return pyarrow


@contextmanager
def opened(path: Path) -> "Iterator[ParquetFile]":
    """Open a table; within this context errors of its reader become `JounceError`."""
    check_readable(path)
    arrow = pyarrow(path)
    try:
        with arrow.OSFile(fsencode(path)) as content, arrow.parquet.ParquetFile(content, pre_buffer=True) as file:
            yield file
    except (arrow.ArrowException, OSError, UnicodeDecodeError) as error:
        raise JounceError(f"{path}: not a Parquet table, or a damaged one: {one_line(error)}") from None


def names(path: Path) -> list[str]:
    """The names of the columns."""
    with opened(path) as file:
        found = [str(name) for name in file.schema_arrow.names]
    check_distinct(path, found)
    return found


def size(path: Path) -> int:
    """The bytes of the table in memory."""
    with opened(path) as file:
        return int(file.metadata.num_rows) * len(file.schema_arrow.names) * 8


def spans(path: Path, cells: int) -> list[Span]:
    """Spans of one or more row groups."""
    with opened(path) as file:
        about, columns = file.metadata, len(file.schema_arrow.names)
        counts = [about.row_group(i).num_rows for i in range(about.num_row_groups)]
    found: list[Span] = []
    for stop in np.cumsum(counts).tolist():
        first = found[-1].stop if found else 0
        if found and (stop - found[-1].start) * columns <= cells:
            found[-1] = Span(found[-1].start, stop)
        elif stop > first:
            found.append(Span(first, stop))
    return found


def check_numbers(path: Path, names: Sequence[str]) -> None:
    """Raise `JounceError` where a column does not hold numbers."""
    with opened(path) as file:
        kinds = {name: file.schema_arrow.field(name).type for name in names}
    for name, kind in kinds.items():
        if not _is_number(path, kind):
            raise JounceError(f"{path}: column {quoted(name)} holds {kind}; expected numbers")


def chunks(path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
    """The rows of a span, in chunks."""
    names, bases = split_names(names)
    with opened(path) as file:
        wanted = [*names, *([] if texts is None else [texts])]
        for first, batch in _batches(file, wanted, span):
            columns = {name: _numbers(batch.column(name)) for name in names}
            stated = {name: batch.column(name) for name in bases}
            columns = with_remainders(columns, bases, {name: _as_stated(column) for name, column in stated.items()})
            motions = None if texts is None else _texts(path, batch.column(texts))
            yield Chunk(columns, motions, np.arange(first, first + batch.num_rows + 1))


def row_before(path: Path, place: int) -> Span | None:
    """The span of the row that ends at a place, if there is one."""
    return Span(place - 1, place) if place else None


def next_row(path: Path, place: int) -> Span | None:
    """The span of a row, if there is one."""
    with opened(path) as file:
        return Span(place, place + 1) if place < file.metadata.num_rows else None


def number(path: Path, place: int, known: tuple[int, int]) -> int:
    """The number of the row at a place."""
    return place


def row(path: Path, number: int) -> str:
    """A row in words."""
    return f"{path}: row {number} from 0"


def _batches(file: "ParquetFile", wanted: Sequence[str], span: Span) -> "Iterator[tuple[int, Any]]":
    """The batches of a span with the numbers of their first rows."""
    first = 0
    for i in range(file.metadata.num_row_groups):
        start, first = first, first + file.metadata.row_group(i).num_rows
        if first <= span.start or start >= span.stop:
            continue
        for batch in file.iter_batches(rows_of(len(wanted)), row_groups=[i], columns=list(wanted), use_threads=False):
            begin, end = max(span.start - start, 0), min(span.stop - start, batch.num_rows)
            if begin < end:
                yield start + begin, batch.slice(begin, end - begin)
            start += batch.num_rows


def _is_number(path: Path, kind: Any) -> bool:
    types = pyarrow(path).types
    return bool(types.is_floating(kind) or types.is_integer(kind) or types.is_decimal(kind))


def _numbers(column: Any) -> np.ndarray:
    """The cells as float64; missing ones are NaN."""
    return np.asarray(column.cast("float64", safe=False).to_numpy(zero_copy_only=False))


def _as_stated(column: Any) -> np.ndarray:
    """The cells as integers, if they are and none is missing, or as float64."""
    kind = str(column.type)
    return np.asarray(column.to_numpy()) if "int" in kind and not column.null_count else _numbers(column)


def _texts(path: Path, column: Any) -> np.ndarray:
    if column.null_count:
        raise JounceError(f"{path}: the column of motions has {column.null_count} empty cells; expected a name in each")
    return np.asarray(column.cast("string").to_numpy(zero_copy_only=False).astype(str))
