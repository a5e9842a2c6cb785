"""CSV tables, read and written some rows at a time: a whole table takes far more memory as text than as numbers."""

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from io import TextIOWrapper
from itertools import chain, islice
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from jounce.core.errors import JounceError, one_line, quoted
from jounce.core.scalars import finite
from jounce.io.columns import CellError, Columns, Select, check_distinct
from jounce.io.files import opened
from jounce.io.remainders import remainder_of, remainders_of_texts, split_names

BLOCK = 1 << 20  # bytes that are copied at a time
CELLS = 1 << 16  # in a piece
SEPARATORS = (",", ";", "\t", " ")  # of cells, the first that stands between column names
BLANK = " ,;\t\r\n"
Row = tuple[int, list[str]]  # its line, its cells


class Layout(NamedTuple):
    """The names of the columns, the separator of the cells, and the byte at which the rows begin."""

    header: list[str]
    mark: str
    start: int


def layout(path: Path) -> Layout:
    """The layout of a table, whose rows are not read."""
    with opened(path) as file:
        try:
            line = next((line for line in iter(file.readline, b"") if line.decode("utf-8-sig").strip(BLANK)), b"")
            text = line.decode("utf-8-sig")
            mark = _separator(text)
            reader = csv.reader([text.strip()], delimiter=mark, skipinitialspace=True, strict=True)
            cells = next(reader, [])
        except (UnicodeDecodeError, csv.Error) as error:
            raise JounceError(f"{path}: not a CSV table: {one_line(error)}") from None
        if not cells:
            raise JounceError(f"{path}: the table is empty; expected a row of column names and rows of numbers")
        return Layout(_header(path, [cell.strip() for cell in cells], mark), mark, file.tell())


def pieces(path: Path, select: Select | None = None) -> Iterator[Columns]:
    """Yield the table of a file in pieces of some rows; it has at least one row.

    The separator is that of the column names: a comma, or else a semicolon, tab or space. If it is not the comma, a
    comma in a number is the decimal point.
    """
    with opened(path) as content, TextIOWrapper(content, encoding="utf-8-sig", newline="") as file:
        try:
            yield from _pieces(path, file, select)
        except (UnicodeDecodeError, csv.Error) as error:
            raise JounceError(f"{path}: not a CSV table: {one_line(error)}") from None


def write(path: Path, pieces: Iterable[Mapping[str, np.ndarray]]) -> None:
    """Write a table at full precision, piece by piece."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        for number, columns in enumerate(pieces):
            if number == 0:
                writer.writerow(columns)
            arrays = list(columns.values())
            size = _rows(len(arrays))
            for i in range(0, max(map(len, arrays)), size):
                rows = zip(*(array[i : i + size].tolist() for array in arrays), strict=True)
                writer.writerows(rows)  # repr of a double: it reads back the same


def join(path: Path, parts: Iterable[Path]) -> None:
    """Write the tables of several files, whose columns are the same, as one."""
    with path.open("wb") as file:
        file.writelines(_bytes(parts))


def _bytes(parts: Iterable[Path]) -> Iterator[bytes]:
    """The bytes of several files one below the other, with the header of the first."""
    for number, part in enumerate(parts):
        with opened(part) as content:
            header = content.readline()
            if number == 0:
                yield header
            yield from iter(partial(content.read, BLOCK), b"")


def _rows(columns: int) -> int:
    """The rows of a piece."""
    return max(1, CELLS // columns)


def _pieces(path: Path, file: TextIO, select: Select | None) -> Iterator[Columns]:
    head: list[str] = []  # blank lines, and the one of column names
    for line in iter(file.readline, ""):
        head.append(line)
        if line.strip(BLANK):
            break
    mark = _separator(head[-1] if head else "")
    lines = (line.strip() for line in chain(head, file)) if mark == " " else chain(head, file)
    reader = csv.reader(lines, delimiter=mark, skipinitialspace=True, strict=True)
    rows = ((reader.line_num, row) for row in reader if any(map(str.strip, row)))
    first = next(rows, None)
    if first is None:
        raise JounceError(f"{path}: the table is empty; expected a row of column names and rows of numbers")
    header = _header(path, [cell.strip() for cell in first[1]], mark)
    names, bases = split_names(header if select is None else select(header))
    piece = list(islice(rows, _rows(len(header))))
    if not piece:
        raise JounceError(f"{path}: no rows of numbers under the column names")
    while piece:
        yield _columns(path, header, (names, bases), piece, mark)
        piece = list(islice(rows, _rows(len(header))))


def _separator(line: str) -> str:
    """Return the separator of the column names: a comma, or else a semicolon, a tab or spaces."""
    bare = re.sub(r'"[^"]*"', "", line).lstrip("# ").strip()
    return next((mark for mark in SEPARATORS if mark in bare), ",")


def _header(path: Path, cells: Sequence[str], mark: str) -> list[str]:
    header = [cells[0].lstrip("# "), *cells[1:]]  # numpy.savetxt marks its header with #
    header = header[1:] if mark == " " and not header[0] else header
    if all(finite(name) is not None for name in header):
        raise JounceError(f"{path}: no row of column names above the numbers")
    check_distinct(path, header)
    return header


def _columns(
    path: Path, header: Sequence[str], asked: tuple[list[str], list[str]], piece: Sequence[Row], mark: str
) -> Columns:
    names, bases = asked
    wanted = [header.index(name) for name in names]
    for line, row in piece:
        if len(row) != len(header):
            raise JounceError(f"{path}:{line}: {len(row)} cells; expected {len(header)}, one for each column")
    if mark != ",":  # decimal commas
        piece = [(line, [cell.replace(",", ".") for cell in row]) for line, row in piece]
    numbers = parse_numbers([row[i] for _, row in piece for i in wanted])
    if numbers is None:
        cells = ((line, header[i], row[i]) for line, row in piece for i in wanted)
        numbers = np.array([_number(cell.strip(), f"{path}:{line}", name) for line, name, cell in cells])
    columns = {name: column.copy() for name, column in zip(names, numbers.reshape(len(piece), -1).T, strict=True)}
    for name in bases:
        texts = [row[header.index(name)] for _, row in piece]
        columns[remainder_of(name)] = remainders_of_texts(texts, columns[name])
    return columns


def parse_numbers(cells: Sequence[str]) -> np.ndarray | None:
    """Convert cells to numbers all at once; None if a cell needs the slower check by `finite`."""
    try:
        numbers = np.array([float(cell) for cell in cells])
    except ValueError:
        return None
    text = "".join(cells)
    return numbers if text.isascii() and "_" not in text and np.isfinite(numbers).all() else None


def _number(cell: str, place: str, column: str) -> float:
    number = finite(cell)
    if number is None:
        raise CellError(f"{place}: column {quoted(column)} holds {quoted(cell)}; expected a finite number")
    return number
