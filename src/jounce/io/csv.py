"""CSV tables, read and written some rows at a time: as texts a whole table takes far more memory than as numbers."""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from jounce._scalars import finite
from jounce.errors import JounceError, one_line, quoted
from jounce.io.columns import Columns, check_distinct
from jounce.io.files import opened

CELLS = 1 << 16  # in a piece
Row = tuple[int, list[str]]  # its line, its cells


def pieces(path: Path) -> Iterator[Columns]:
    """The table of a file, some rows after the other; at least one row."""
    with opened(path) as content, TextIOWrapper(content, encoding="utf-8-sig", newline="") as file:
        try:
            yield from _pieces(path, file)
        except (UnicodeDecodeError, csv.Error) as error:
            raise JounceError(f"{path}: not a CSV table: {one_line(error)}") from None


def write(path: Path, pieces: Iterable[Mapping[str, np.ndarray]]) -> None:
    """Write a table with all digits of its numbers, each piece when it comes."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        for number, columns in enumerate(pieces):
            if number == 0:
                writer.writerow(columns)
            arrays = list(columns.values())
            size = _rows(len(arrays))
            for i in range(0, max(map(len, arrays)), size):
                rows = np.stack([array[i : i + size] for array in arrays], axis=1)
                writer.writerows(rows.tolist())  # repr of a double: it reads back the same


def _rows(columns: int) -> int:
    """The rows of a piece."""
    return max(1, CELLS // columns)


def _pieces(path: Path, file: TextIO) -> Iterator[Columns]:
    reader = csv.reader(file, skipinitialspace=True, strict=True)
    rows = ((reader.line_num, row) for row in reader if any(map(str.strip, row)))
    first = next(rows, None)
    if first is None:
        raise JounceError(f"{path}: nothing in it; expected a row of column names and rows of numbers")
    header = _header(path, [cell.strip() for cell in first[1]])
    piece = list(islice(rows, _rows(len(header))))
    if not piece:
        raise JounceError(f"{path}: no rows of numbers under the column names")
    while piece:
        yield _columns(path, header, piece)
        piece = list(islice(rows, _rows(len(header))))


def _header(path: Path, cells: Sequence[str]) -> list[str]:
    header = [cells[0].lstrip("# "), *cells[1:]]  # numpy.savetxt marks its header with #
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        marks = "semicolons" if ";" in header[0] else "tabs"
        raise JounceError(f"{path}: columns are separated by {marks}; expected commas")
    if all(finite(name) is not None for name in header):
        raise JounceError(f"{path}: no row of column names above the numbers")
    check_distinct(path, header)
    return header


def _columns(path: Path, header: Sequence[str], piece: Sequence[Row]) -> Columns:
    for line, row in piece:
        if len(row) != len(header):
            raise JounceError(f"{path}:{line}: {len(row)} cells; expected {len(header)}, one for each column")
    numbers = _plain([cell for _, row in piece for cell in row])
    if numbers is None:
        cells = ((line, name, cell) for line, row in piece for name, cell in zip(header, row, strict=True))
        numbers = np.array([_number(cell.strip(), f"{path}:{line}", name) for line, name, cell in cells])
    return {name: column.copy() for name, column in zip(header, numbers.reshape(len(piece), -1).T, strict=True)}


def _plain(cells: Sequence[str]) -> np.ndarray | None:
    """Cells as numbers, all at once; None where one might be none by `finite`, which looks at each."""
    try:
        numbers = np.array([float(cell) for cell in cells])
    except ValueError:
        return None
    text = "".join(cells)
    return numbers if text.isascii() and "_" not in text and np.isfinite(numbers).all() else None


def _number(cell: str, place: str, column: str) -> float:
    number = finite(cell)
    if number is None:
        raise JounceError(f"{place}: column {quoted(column)} holds {quoted(cell)}; expected a finite number")
    return number
