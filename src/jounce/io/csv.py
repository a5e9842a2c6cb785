"""Reads and writes CSV tables, some rows at a time.

A whole table takes far more memory as text than as numbers.
"""

import csv
import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from jounce.core.errors import JounceError, one_line
from jounce.core.foreign import parse_finite
from jounce.io import files
from jounce.io.remainders import remainder_name, split_names, text_remainders
from jounce.io.table_format import Chunk, Pieces, Span, TableFormat, TableMetadata, check_distinct

BLOCK_BYTES = 1 << 19  # read at a time: bounds the memory that the cells take as Python strings
CELLS_PER_WRITE = 1 << 16  # converted to text at a time, a few MB of Python objects
BYTES_PER_CELL = 16  # about, as doubles at full precision take them: only sizes the spans
MAX_LINE_BYTES = 1 << 20  # of the last row before a span, which is searched in as many bytes
SEPARATORS = (",", ";", "\t", " ")  # of cells, the first that stands between column names
BLANK = " ,;\t\r\n"
COMMENT = re.compile(r"^\s*(#|%|//)[\s#]*")  # what lines above the header begin with, and the header of numpy.savetxt


class CsvLayout(NamedTuple):
    """The layout of a table: names of columns, separator, first row."""

    header: list[str]
    mark: str  # the separator of cells
    start: int  # the byte at which the first row begins
    unnamed: int  # how many columns at the end have no name


class Csv(TableFormat):
    """Tables of text.

    Places are bytes: spans go from the beginning of one line to the end of another. The separator is that of the column
    names: a comma, or else a semicolon, tab or space. If it is not the comma, a comma in a number is the decimal point.
    """

    FIRST = 0, 1

    def columns(self, path: Path) -> dict[str, str]:
        """Return the columns by name.

        Their types are not known before the text is read.
        """
        return dict.fromkeys(read_layout(path).header, "")

    def size(self, path: Path) -> int:
        with files.open_file(path):
            return path.stat().st_size

    def spans(self, path: Path, cells: int) -> list[Span]:
        # Each span ends at the first line break behind its size.
        first, step = read_layout(path).start, cells * BYTES_PER_CELL
        with files.open_file(path) as file:
            end = path.stat().st_size
            cuts = [first, *(_find_line_after(file, place) for place in range(first + step, end, step)), end]
        return [Span(start, stop) for start, stop in itertools.pairwise(cuts) if start < stop]

    def chunks(self, path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
        layout, place = read_layout(path), span.start
        with files.open_file(path) as file:
            file.seek(place)
            for block in _read_blocks(file, span.stop - place):
                lines = block.splitlines(keepends=True)
                rows, first_lines = self._parse_rows(path, layout, lines, place)
                if len(rows) > 0:
                    broken = _fit_rows(rows, layout)
                    # The place of a row is that of its first line; the last place is the end of the block.
                    line_places = place + np.cumsum([0, *map(len, lines)])
                    yield _build_chunk(layout, rows, line_places[[*first_lines, -1]], broken, (names, texts))
                place += len(block)
        if place < span.stop:
            raise JounceError(f"{path}: the file lost {span.stop - place} bytes while it was read")

    def row_before(self, path: Path, place: int) -> Span | None:
        first = read_layout(path).start
        if place <= first:
            return None
        begin = max(first, place - MAX_LINE_BYTES)
        with files.open_file(path) as file:
            file.seek(begin)
            text = file.read(place - 1 - begin)
        return Span(begin + text.rfind(b"\n") + 1, place)

    def next_row(self, path: Path, place: int) -> Span | None:
        with files.open_file(path) as file:
            stop = _find_line_after(file, place + 1)
        return Span(place, stop) if stop > place else None

    def number(self, path: Path, place: int, known_row: tuple[int, int]) -> int:
        """Return the number of the line that begins at a place.

        `known_row` are a place before it and the number of its line.
        """
        (start, line), feeds, returns = known_row, 0, 0
        with files.open_file(path) as file:
            file.seek(start)
            while start < place:
                block = file.read(min(BLOCK_BYTES, place - start))
                if len(block) == 0:
                    break
                start, feeds, returns = start + len(block), feeds + block.count(b"\n"), returns + block.count(b"\r")
        # Lines end in line feeds, or in old files of Macintosh in carriage returns alone.
        return line + (feeds if feeds > 0 else returns)

    def row(self, path: Path, number: int) -> str:
        """Return a line, as messages name it."""
        return f"{path}:{number}"

    def write(self, path: Path, pieces: Pieces, about: TableMetadata | None = None) -> None:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            for number, columns in enumerate(pieces):
                if number == 0:
                    writer.writerow(columns)
                # Cells become Python objects, so that few rows are converted at a time.
                arrays = list(columns.values())
                size = max(1, CELLS_PER_WRITE // len(arrays))
                for i in range(0, len(arrays[0]), size):
                    rows = zip(*(array[i : i + size].tolist() for array in arrays), strict=True)
                    writer.writerows(rows)  # repr of a double: it reads back the same

    def join(self, path: Path, parts: Iterable[Path]) -> None:
        with path.open("wb") as file:
            file.writelines(_concatenate_bytes(parts))

    def _parse_rows(
        self, path: Path, layout: CsvLayout, lines: Sequence[bytes], place: int
    ) -> tuple[list[list[str]], list[int]]:
        """Return the cells of rows, and the line where each begins.

        A row takes several lines where a cell within quotes has line breaks; blank rows are left out.
        """
        rows, first_lines, line = list[list[str]](), list[int](), 0
        try:
            reader = _csv_reader(map(bytes.decode, lines), layout.mark)
            for row in reader:
                if any(map(str.strip, row)):
                    rows.append(row)
                    first_lines.append(line)
                line = reader.line_num
        except (UnicodeDecodeError, csv.Error) as error:
            row_words = self.row(path, self.number(path, place, self.FIRST) + line)
            raise JounceError(f"{row_words}: not a CSV table: {one_line(error)}") from None
        return rows, first_lines


def _fit_rows(rows: list[list[str]], layout: CsvLayout) -> dict[int, str]:
    """Cut or fill rows to the number of columns.

    What is wrong is returned by row. Blank cells at the end, and those of columns without a name, are no fault.
    """
    count, broken = len(layout.header), dict[int, str]()
    for i, cells in enumerate(rows):
        is_unnamed = len(cells) <= count + layout.unnamed
        if len(cells) > count and (is_unnamed or not any(map(str.strip, cells[count:]))):
            rows[i] = cells[:count]
        elif len(cells) != count:
            broken[i] = f"{len(cells)} cells; expected {count}, one for each column"
            rows[i] = [*cells, *[""] * count][:count]
    return broken


def _build_chunk(
    layout: CsvLayout,
    rows: list[list[str]],
    places: np.ndarray,
    broken: dict[int, str],
    selection: tuple[Sequence[str], str | None],
) -> Chunk:
    """Return the chunk of rows.

    The selection names columns of numbers, and one of texts.
    """
    selected_names, texts = selection
    names, bases = split_names(selected_names)
    indices = [layout.header.index(name) for name in names]
    # All cells go row by row into one list, which is parsed at once.
    cells = [row[i] for row in rows for i in indices]
    if layout.mark != ",":
        cells = [cell.replace(",", ".") for cell in cells]
    numbers = _parse_numbers(cells)
    wrong = np.flatnonzero(np.isnan(numbers)).tolist()
    wrong_cells = {(k // len(indices), names[k % len(indices)]): cells[k].strip() for k in wrong}
    # (rows, columns) -> contiguous columns by name.
    columns = {name: x.copy() for name, x in zip(names, numbers.reshape(len(rows), -1).T, strict=True)}
    for name in bases:
        columns[remainder_name(name)] = text_remainders(cells[names.index(name) :: len(indices)], columns[name])
    motions = None
    if texts is not None:
        column = layout.header.index(texts)
        motions = np.array([row[column].strip() for row in rows], dtype=str)
    return Chunk(columns, motions, places, wrong_cells, broken)


def read_layout(path: Path) -> CsvLayout:
    """Return the layout of a table; its rows are not read."""
    start = 0

    def lines(file: BinaryIO) -> Iterator[str]:
        nonlocal start
        for block in iter(file.readline, b""):
            for line in block.splitlines(keepends=True):
                text = line.decode("utf-8" if start > 0 else "utf-8-sig")
                start += len(line)
                yield text

    with files.open_file(path) as file:
        try:
            following = lines(file)
            # Comments may stand above the header; the first other line is the header or, behind a header that
            # is a comment, a row.
            nonblank_lines = (line for line in following if line.strip(BLANK))
            comments, end_of_comments = list[str](), 0
            first = next(nonblank_lines, "")
            while COMMENT.match(first):
                comments.append(first)
                end_of_comments = start
                first = next(nonblank_lines, "")
            # numpy.savetxt marks its header as a comment: it has the cells of the row of numbers below it.
            names_comment = next((comment for comment in comments if first == "" or _fits(comment, first)), None)
            # Names within quotes may go on in the lines that follow.
            header_lines = itertools.chain([first], following) if names_comment is None else [names_comment]
            mark = _find_mark(first if names_comment is None else names_comment)
            cells: list[str] = next(_csv_reader(header_lines, mark), [])
        except (UnicodeDecodeError, csv.Error) as error:
            raise JounceError(f"{path}: not a CSV table: {one_line(error)}") from None
    if len(cells) == 0:
        raise JounceError(f"{path}: the table is empty; expected a row of column names and rows of numbers")
    names = _check_header(path, [cell.strip() for cell in cells], mark)
    first_row = start if names_comment is None else end_of_comments
    return CsvLayout(names, mark, first_row, 0 if mark == " " else len(cells) - len(names))


def _find_mark(header: str) -> str:
    """Return the separator of cells, the first that stands between names."""
    bare = COMMENT.sub("", re.sub(r'"[^"]*"', "", header)).strip()
    return next((mark for mark in SEPARATORS if mark in bare), ",")


def _fits(comment: str, row: str) -> bool:
    """Return whether a comment has names for the cells of a row.

    Some of the cells have to be numbers.
    """
    mark = _find_mark(comment)
    names: list[str] = next(_csv_reader([COMMENT.sub("", comment).rstrip(BLANK)], mark), [])
    cells: list[str] = next(_csv_reader([row.rstrip(BLANK)], mark), [])
    return len(names) == len(cells) and any(parse_finite(cell.strip().replace(",", ".")) is not None for cell in cells)


def _csv_reader(lines: Iterable[str], mark: str) -> Any:
    """Return the reader of lines as lists of cells."""
    lines = (line.strip() for line in lines) if mark == " " else lines
    return csv.reader(lines, delimiter=mark, skipinitialspace=True, strict=True)


def _check_header(path: Path, cells: Sequence[str], mark: str) -> list[str]:
    """Return the column names without marks of comments and blank ends."""
    header = [COMMENT.sub("", cells[0]), *cells[1:]]
    # A header that is a comment, "# t q", has an empty name before the first space.
    header = header[1:] if mark == " " and header[0] == "" else header
    # Lines may end in a separator.
    while len(header) > 1 and header[-1] == "":
        header.pop()
    if all(parse_finite(name) is not None for name in header):
        raise JounceError(f"{path}: no row of column names above the numbers; expected one, such as 't,JOINT,...'")
    check_distinct(path, header)
    return header


def _read_blocks(file: BinaryIO, size: int) -> Iterator[bytes]:
    """Yield whole lines of the next `size` bytes, block by block.

    No block ends within quotes.
    """
    pending = b""
    while size > 0:
        block = file.read(min(BLOCK_BYTES, size))
        if len(block) == 0:
            break
        size -= len(block)
        pending += block
        # A carriage return at the very end may be the first half of a line break.
        end = max(pending.rfind(b"\n"), pending.rfind(b"\r", 0, -1)) + 1
        # An odd number of quotes means that the last line break is within quotes.
        if size > 0 and end > 0 and pending.count(b'"', 0, end) % 2 == 0:
            yield pending[:end]
            pending = pending[end:]
    if len(pending) > 0:
        yield pending


def _find_line_after(file: BinaryIO, place: int) -> int:
    """Return where the first line begins, at a place or after it."""
    # A line that begins at the place itself has a line break right before it.
    file.seek(place - 1)
    for line in iter(partial(file.readline, BLOCK_BYTES), b""):
        if line.endswith(b"\n"):
            break
    return file.tell()


def _parse_numbers(cells: Sequence[str]) -> np.ndarray:
    """Return cells as finite numbers, and all others as NaN."""
    # Python's float takes digits of other scripts, underscores, infinity and NaN: cells with those are parsed one by
    # one, all others at once.
    with suppress(ValueError):
        numbers, text = np.fromiter(map(float, cells), float, len(cells)), "".join(cells)
        if text.isascii() and "_" not in text and np.isfinite(numbers).all():
            return numbers
    parsed = (parse_finite(cell.strip()) for cell in cells)
    return np.array([np.nan if number is None else number for number in parsed])


def _concatenate_bytes(parts: Iterable[Path]) -> Iterator[bytes]:
    """Yield the bytes of several files, with the header of the first."""
    for number, part in enumerate(parts):
        with files.open_file(part) as content:
            header = content.readline()
            if number == 0:
                yield header
            yield from iter(partial(content.read, BLOCK_BYTES), b"")
