"""Spans of NPZ tables: rows of the arrays of an archive, which lie in the file as they are in memory."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from struct import unpack_from
from typing import BinaryIO
from zipfile import ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from jounce.arguments.names import entries
from jounce.core.errors import JounceError, one_line, quoted
from jounce.io.columns import check_distinct, flatten
from jounce.io.files import opened
from jounce.io.remainders import split_names, with_remainders
from jounce.io.spans.chunk import Chunk, Span, rows_of

FIRST = 0, 0  # the place of the first row, and its number
LOCAL = 30  # bytes of the fixed part of a member's header, which ends in the lengths of its name and of what follows


def names(path: Path) -> list[str]:
    """The names of the columns."""
    return list(columns_of(path))


def size(path: Path) -> int:
    """The bytes of the table in memory."""
    return sum(column.nbytes for column in columns_of(path).values())


def spans(path: Path, cells: int) -> list[Span]:
    """Spans of even numbers of rows."""
    columns = columns_of(path)
    rows, step = _rows(path, columns), max(1, cells // len(columns))
    return [Span(start, min(start + step, rows)) for start in range(0, rows, step)]


def check_numbers(path: Path, names: Sequence[str]) -> None:
    """Raise `JounceError` where a column does not hold numbers."""
    columns = columns_of(path)
    for name in names:
        if columns[name].dtype.kind not in "fiu":
            raise JounceError(f"{path}: column {quoted(name)} holds {columns[name].dtype}; expected numbers")


def chunks(path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
    """The rows of a span, in chunks."""
    names, bases = split_names(names)
    step = rows_of(len(names))
    for start in range(span.start, span.stop, step):
        part = slice(start, min(start + step, span.stop))
        columns = columns_of(path)  # mapped again, so that the pages that were read do not pile up
        found = {name: columns[name][part].astype(float) for name in names}
        yield Chunk(
            with_remainders(found, bases, {name: columns[name][part] for name in bases}),
            None if texts is None else columns[texts][part].astype(str),
            np.arange(part.start, part.stop + 1),
        )


def row_before(path: Path, place: int) -> Span | None:
    """The span of the row that ends at a place, if there is one."""
    return Span(place - 1, place) if place else None


def next_row(path: Path, place: int) -> Span | None:
    """The span of a row, if there is one."""
    return Span(place, place + 1) if place < _rows(path, columns_of(path)) else None


def number(path: Path, place: int, known: tuple[int, int]) -> int:
    """The number of the row at a place."""
    return place


def row(path: Path, number: int) -> str:
    """A row in words."""
    return f"{path}: row {number} from 0"


def _rows(path: Path, columns: Mapping[str, np.ndarray]) -> int:
    first, *others = columns
    for name in others:
        if columns[name].shape != columns[first].shape:
            came = f"{len(columns[first])} rows in column {quoted(first)}, {len(columns[name])} in {quoted(name)}"
            raise JounceError(f"{path}: {came}; expected as many in all")
    return len(columns[first])


def columns_of(path: Path) -> dict[str, np.ndarray]:
    """The columns, mapped from the file: their pages are read when they are used."""
    found: list[tuple[str, np.ndarray]] = []
    with opened(path) as file:
        try:
            with ZipFile(file) as archive:
                for member in archive.infolist():
                    array = _mapped(path, file, member)
                    name = member.filename.removesuffix(".npy")
                    found += [(name, array)] if array.dtype.names is None else entries(array).items()
        except JounceError:
            raise
        except Exception as error:  # damaged archives raise whatever their decoder stumbles over
            raise JounceError(f"{path}: not an NPZ table: {one_line(error)}") from None
    check_distinct(path, [name for name, _ in found])
    columns = {name: column for name, column in flatten(dict(found)).items() if column.ndim == 1 and column.size}
    if not columns:
        raise JounceError(f"{path}: no columns or no rows; expected named columns of numbers")
    return columns


def _mapped(path: Path, file: BinaryIO, member: ZipInfo) -> np.ndarray:
    if member.compress_type != ZIP_STORED:
        raise JounceError(
            f"{path}: {quoted(member.filename)} is compressed, which is read as a whole only; numpy.savez, not"
            " savez_compressed, writes tables that are read by rows"
        )
    file.seek(member.header_offset)
    lengths = unpack_from("<HH", file.read(LOCAL), LOCAL - 4)
    file.seek(member.header_offset + LOCAL + sum(lengths))
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read(file)
    if not np.prod(shape):
        return np.empty(0)
    return np.memmap(path, dtype, "r", file.tell(), shape, "F" if fortran else "C")
