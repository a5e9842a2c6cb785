"""NPZ tables: an archive with an array for each column, as `numpy.savez` writes it."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from struct import unpack_from
from typing import BinaryIO
from zipfile import ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from jounce.core.errors import JounceError, one_line, quote_value
from jounce.core.named_entries import read_entries
from jounce.io.columns import Select, TableMetadata, check_columns, check_distinct, flatten, select_columns
from jounce.io.files import open_file
from jounce.io.remainders import split_names, with_remainders
from jounce.io.table_format import Chunk, Pieces, Span, TableFormat, number_rows, rows_per_chunk

# of the fixed part of a ZIP member's header, which ends in two lengths: of its name, and of what follows that
LOCAL_HEADER_BYTES = 30


class Npz(TableFormat):
    """Archives, whose arrays lie in the file as they are in memory unless they are compressed."""

    def columns(self, path: Path) -> dict[str, str]:
        return {name: "" if x.dtype.kind in "fiu" else str(x.dtype) for name, x in _map_columns(path).items()}

    def size(self, path: Path) -> int:
        return sum(column.nbytes for column in _map_columns(path).values())

    def spans(self, path: Path, cells: int) -> list[Span]:
        columns = _map_columns(path)
        first, *others = columns
        rows, step = len(columns[first]), max(1, cells // len(columns))
        for name in others:
            if len(columns[name]) != rows:
                came = f"{rows} rows in column {quote_value(first)}, {len(columns[name])} in {quote_value(name)}"
                raise JounceError(f"{path}: {came}; expected as many in all")
        return [Span(start, min(start + step, rows)) for start in range(0, rows, step)]

    def chunks(self, path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
        names, bases = split_names(names)
        step = rows_per_chunk(len(names))
        for start in range(span.start, span.stop, step):
            part = slice(start, min(start + step, span.stop))
            columns = _map_columns(path)  # mapped again, so that the pages that were read do not pile up
            found = {name: columns[name][part].astype(float) for name in names}
            yield Chunk(
                with_remainders(found, bases, {name: columns[name][part] for name in bases}),
                None if texts is None else columns[texts][part].astype(str),
                np.arange(part.start, part.stop + 1),
            )

    def whole(self, path: Path, select: Select | None = None) -> Chunk:
        """All rows, which may be compressed."""
        return number_rows(check_columns(path, select_columns(_read_members(path, _read_member), select)))

    def write(self, path: Path, pieces: Pieces, about: TableMetadata | None = None) -> None:
        """Write a table as numpy.savez does, column by column: all pieces are held until the last has come."""
        parts = list(pieces)
        with ZipFile(path, "w") as archive:
            for name in parts[0]:
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    column = np.concatenate([part[name] for part in parts])
                    np.lib.format.write_array(member, column, allow_pickle=False)

    def join(self, path: Path, parts: Iterable[Path]) -> None:
        """Write the tables of several files, whose columns are the same, as one; a column of a file at a time."""
        tables = list(parts)
        with ZipFile(path, "w") as archive:
            for name, first in _map_columns(tables[0]).items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    columns = [_map_columns(table)[name] for table in tables]
                    dtype = np.result_type(first.dtype, *(column.dtype for column in columns))
                    header = {"shape": (sum(map(len, columns)),), "fortran_order": False, "descr": dtype.str}
                    np.lib.format.write_array_header_2_0(member, header)
                    for column in columns:
                        member.write(np.ascontiguousarray(column, dtype).tobytes())


def _map_columns(path: Path) -> dict[str, np.ndarray]:
    """The columns, mapped from the file: their pages are read when they are used."""
    found = flatten(_read_members(path, _map_member))
    columns = {name: column for name, column in found.items() if column.ndim == 1 and column.size}
    if not columns:
        raise JounceError(f"{path}: no columns or no rows; expected named columns of numbers")
    return columns


def _read_members(path: Path, read: Callable[[Path, BinaryIO, ZipFile, ZipInfo], np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays of all members, and of all fields of those that are tables of their own."""
    found: list[tuple[str, np.ndarray]] = []
    where = ""
    with open_file(path) as file:
        try:
            with ZipFile(file) as archive:
                for member in archive.infolist():
                    name = member.filename.removesuffix(".npy")
                    where = f" column {quote_value(name)}:"
                    array = read(path, file, archive, member)
                    found += [(name, array)] if array.dtype.names is None else read_entries(array).items()
        except JounceError:
            raise
        except Exception as error:  # damaged archives make their decoder raise errors of any type
            raise JounceError(f"{path}: not an NPZ table:{where} {one_line(error)}") from None
    check_distinct(path, [name for name, _ in found])
    return dict(found)


def _read_member(_path: Path, _file: BinaryIO, archive: ZipFile, member: ZipInfo) -> np.ndarray:
    """The array of a member, whose bytes are checked."""
    with archive.open(member) as content:
        array = np.lib.format.read_array(content, allow_pickle=False)
        if content.read(1):  # at its end the archive checks what was read
            raise ValueError("more follows the array")
    return array


def _map_member(path: Path, file: BinaryIO, _archive: ZipFile, member: ZipInfo) -> np.ndarray:
    """The array of a member, which lies in the file as it is in memory."""
    if member.compress_type != ZIP_STORED:
        came = f"{quote_value(member.filename)} is compressed, which is read as a whole only"
        raise JounceError(f"{path}: {came}; numpy.savez, not savez_compressed, writes tables that are read by rows")
    file.seek(member.header_offset)
    lengths = unpack_from("<HH", file.read(LOCAL_HEADER_BYTES), LOCAL_HEADER_BYTES - 4)
    file.seek(member.header_offset + LOCAL_HEADER_BYTES + sum(lengths))
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read(file)
    if not np.prod(shape):
        return np.empty(0)
    return np.memmap(path, dtype, "r", file.tell(), shape, "F" if fortran else "C")
