"""NPZ tables: an archive with an array for each column, as `numpy.savez` writes it."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO
from zipfile import ZipFile

import numpy as np

from jounce.arguments import names
from jounce.core.errors import JounceError, one_line, quoted
from jounce.io.columns import Columns, Select, check_distinct, checked, select_columns
from jounce.io.files import opened
from jounce.io.spans.npz import columns_of


def pieces(path: Path, select: Select | None = None) -> Iterator[Columns]:
    """The table of an archive, in one piece: it stands there column by column."""
    with opened(path) as file:
        found = _arrays(path, file)
    check_distinct(path, [name for name, _ in found])
    yield checked(path, select_columns(dict(found), select))


def write(path: Path, pieces: Iterable[Mapping[str, np.ndarray]]) -> None:
    """Write a table with all digits of its numbers, as numpy.savez, which takes no column named "file".

    Column by column: the pieces are all held until the last has come.
    """
    parts = list(pieces)
    with ZipFile(path, "w") as archive:
        for name in parts[0]:
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                column = np.concatenate([part[name] for part in parts])
                np.lib.format.write_array(member, column, allow_pickle=False)


def join(path: Path, parts: Iterable[Path]) -> None:
    """Write the tables of several files, whose columns are the same, as one; a column of a file is held at a time."""
    tables = list(parts)
    with ZipFile(path, "w") as archive:
        for name, first in columns_of(tables[0]).items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                columns = [columns_of(table)[name] for table in tables]
                dtype = np.result_type(first.dtype, *(column.dtype for column in columns))
                header = {"shape": (sum(map(len, columns)),), "fortran_order": False, "descr": dtype.str}
                np.lib.format.write_array_header_2_0(member, header)
                for column in columns:
                    member.write(np.ascontiguousarray(column, dtype).tobytes())


def _arrays(path: Path, file: BinaryIO) -> list[tuple[str, np.ndarray]]:
    """The arrays of all members, and of all fields of those that are tables of their own."""
    found: list[tuple[str, np.ndarray]] = []
    name = None
    try:
        with ZipFile(file) as archive:
            for member in archive.infolist():
                name = member.filename.removesuffix(".npy")
                with archive.open(member) as content:
                    array = np.lib.format.read_array(content, allow_pickle=False)
                    if content.read(1):  # at its end the archive checks what was read
                        raise ValueError("more follows the array")
                found += [(name, array)] if array.dtype.names is None else names.entries(array).items()
    except Exception as error:  # damaged archives raise whatever their decoder stumbles over
        where = "" if name is None else f" column {quoted(name)}:"
        raise JounceError(f"{path}: not an NPZ table:{where} {one_line(error)}") from None
    return found
