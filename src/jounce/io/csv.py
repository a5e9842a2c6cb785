"""CSV tables, read and written some rows at a time: a whole table takes far more memory as text than as numbers."""

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
MAX_LINE_BYTES = 1 << 20  # of the last row before a span, which is looked for in as many bytes
SEPARATORS = (",", ";", "\t", " ")  # of cells, the first that stands between column names
BLANK = " ,;\t\r\n"
COMMENT = re.compile(r"^\s*(#|%|//)[\s#]*")  # what lines above the header begin with, and the header of numpy.savetxt


class CsvLayout(NamedTuple):
    """The names of the columns, the separator of the cells, the byte of the first row, and how many have no name."""

    header: list[str]
    mark: str
    start: int
    unnamed: int  # columns at the end


class Csv(TableFormat):
    """Tables of text, of which places are bytes: spans go from the beginning of one line to the end of another.

    The separator is that of the column names: a comma, or else a semicolon, tab or space. If it is not the comma, a
    comma in a number is the decimal point.
    """

    FIRST = 0, 1

    def columns(self, path: Path) -> dict[str, str]:
        """The columns by name; their types are not known before the text is read."""
        return dict.fromkeys(read_layout(path).header, "")

    def size(self, path: Path) -> int:
        with files.open_file(path):
            return path.stat().st_size

    def spans(self, path: Path, cells: int) -> list[Span]:
        first, step = read_layout(path).start, cells * BYTES_PER_CELL
        with files.open_file(path) as file:
            end = path.stat().st_size
            cuts = [first, *(_find_line_after(file, place) for place in range(first + step, end, step)), end]
        return [Span(start, stop) for start, stop in itertools.pairwise(cuts) if start < stop]

    def chunks(self, path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
        form, place = read_layout(path), span.start
        with files.open_file(path) as file:
            file.seek(place)
            for block in _read_blocks(file, span.stop - place):
                if (chunk := self._chunk(path, form, block, place, names, texts)) is not None:
                    yield chunk
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

    def number(self, path: Path, place: int, known: tuple[int, int]) -> int:
        """The number of the line that begins at a place; `known` are a place before it and the number of its line."""
        (start, line), feeds, returns = known, 0, 0
        with files.open_file(path) as file:
            file.seek(start)
            while start < place and (block := file.read(min(BLOCK_BYTES, place - start))):
                start, feeds, returns = start + len(block), feeds + block.count(b"\n"), returns + block.count(b"\r")
        return line + (feeds or returns)

    def row(self, path: Path, number: int) -> str:
        """A line, as messages name it."""
        return f"{path}:{number}"

    def write(self, path: Path, pieces: Pieces, about: TableMetadata | None = None) -> None:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            for number, columns in enumerate(pieces):
                if number == 0:
                    writer.writerow(columns)
                arrays = list(columns.values())
                size = max(1, CELLS_PER_WRITE // len(arrays))
                for i in range(0, len(arrays[0]), size):
                    rows = zip(*(array[i : i + size].tolist() for array in arrays), strict=True)
                    writer.writerows(rows)  # repr of a double: it reads back the same

    def join(self, path: Path, parts: Iterable[Path]) -> None:
        with path.open("wb") as file:
            file.writelines(_concatenate_bytes(parts))

    def _chunk(
        self, path: Path, form: CsvLayout, block: bytes, place: int, names: Sequence[str], texts: str | None
    ) -> Chunk | None:
        """The rows of a block of lines; None without any."""
        lines = block.splitlines(keepends=True)
        rows, first, line = list[list[str]](), list[int](), 0  # the rows, and the lines that they begin with
        try:
            reader = _csv_reader(map(bytes.decode, lines), form.mark)
            for row in reader:
                if any(map(str.strip, row)):
                    rows.append(row)
                    first.append(line)
                line = reader.line_num
        except (UnicodeDecodeError, csv.Error) as error:
            where = self.row(path, self.number(path, place, self.FIRST) + line)
            raise JounceError(f"{where}: not a CSV table: {one_line(error)}") from None
        if not rows:
            return None
        count, broken = len(form.header), dict[int, str]()
        for i, cells in enumerate(rows):
            if len(cells) > count and (len(cells) <= count + form.unnamed or not any(map(str.strip, cells[count:]))):
                rows[i] = cells[:count]
            elif len(cells) != count:
                broken[i] = f"{len(cells)} cells; expected {count}, one for each column"
                rows[i] = [*cells, *[""] * count][:count]
        names, bases = split_names(names)
        at = [form.header.index(name) for name in names]
        cells = [row[i] for row in rows for i in at]
        if form.mark != ",":  # decimal commas
            cells = [cell.replace(",", ".") for cell in cells]
        numbers = _parse_numbers(cells)
        wrong = np.flatnonzero(np.isnan(numbers)).tolist()
        bad = {(k // len(at), names[k % len(at)]): cells[k].strip() for k in wrong}
        columns = {name: x.copy() for name, x in zip(names, numbers.reshape(len(rows), -1).T, strict=True)}
        for name in bases:
            columns[remainder_name(name)] = text_remainders(cells[names.index(name) :: len(at)], columns[name])
        column = None if texts is None else form.header.index(texts)
        motions = None if column is None else np.array([row[column].strip() for row in rows], dtype=str)
        places = place + np.cumsum([0, *map(len, lines)])
        return Chunk(columns, motions, places[[*first, -1]], bad, broken)


def read_layout(path: Path) -> CsvLayout:
    """The layout of a table, whose rows are not read."""
    start = 0

    def lines(file: BinaryIO) -> Iterator[str]:
        nonlocal start
        while block := file.readline():
            for line in block.splitlines(keepends=True):
                text = line.decode("utf-8" if start else "utf-8-sig")
                start += len(line)
                yield text

    with files.open_file(path) as file:
        try:
            following = lines(file)
            written = (line for line in following if line.strip(BLANK))
            above, end = list[str](), 0  # comments, and where they end
            while COMMENT.match(first := next(written, "")):
                above.append(first)
                end = start
            # numpy.savetxt marks its header as a comment: it has the cells of the row of numbers below it
            named = next((comment for comment in above if not first or _fits(comment, first)), None)
            mark = _find_mark(named or first)
            cells: list[str] = next(_csv_reader([named] if named else itertools.chain([first], following), mark), [])
        except (UnicodeDecodeError, csv.Error) as error:
            raise JounceError(f"{path}: not a CSV table: {one_line(error)}") from None
    if not cells:
        raise JounceError(f"{path}: the table is empty; expected a row of column names and rows of numbers")
    names = _check_header(path, [cell.strip() for cell in cells], mark)
    return CsvLayout(names, mark, end if named else start, 0 if mark == " " else len(cells) - len(names))


def _find_mark(header: str) -> str:
    """The separator of cells."""
    bare = COMMENT.sub("", re.sub(r'"[^"]*"', "", header)).strip()
    return next((mark for mark in SEPARATORS if mark in bare), ",")


def _fits(comment: str, row: str) -> bool:
    """Whether a comment names the cells of a row, of which some are numbers."""
    mark = _find_mark(comment)
    names: list[str] = next(_csv_reader([COMMENT.sub("", comment).rstrip(BLANK)], mark), [])
    cells: list[str] = next(_csv_reader([row.rstrip(BLANK)], mark), [])
    return len(names) == len(cells) and any(parse_finite(cell.strip().replace(",", ".")) is not None for cell in cells)


def _csv_reader(lines: Iterable[str], mark: str) -> Any:
    """The rows of lines as lists of cells."""
    lines = (line.strip() for line in lines) if mark == " " else lines
    return csv.reader(lines, delimiter=mark, skipinitialspace=True, strict=True)


def _check_header(path: Path, cells: Sequence[str], mark: str) -> list[str]:
    header = [COMMENT.sub("", cells[0]), *cells[1:]]
    header = header[1:] if mark == " " and not header[0] else header
    while len(header) > 1 and not header[-1]:  # a separator at the end
        header.pop()
    if all(parse_finite(name) is not None for name in header):
        raise JounceError(f"{path}: no row of column names above the numbers; expected one, such as 't,JOINT,...'")
    check_distinct(path, header)
    return header


def _read_blocks(file: BinaryIO, size: int) -> Iterator[bytes]:
    """Whole lines of the next bytes of a file, about as many at a time, none of which ends within quotes."""
    rest = b""
    while size and (block := file.read(min(BLOCK_BYTES, size))):
        size -= len(block)
        rest += block
        end = max(rest.rfind(b"\n"), rest.rfind(b"\r", 0, -1)) + 1  # what follows the last byte is not known
        if size and end and rest.count(b'"', 0, end) % 2 == 0:  # an odd number: the last line break is within quotes
            yield rest[:end]
            rest = rest[end:]
    if rest:
        yield rest


def _find_line_after(file: BinaryIO, place: int) -> int:
    """Where the first line begins that does not begin before a place."""
    file.seek(place - 1)
    while block := file.readline(BLOCK_BYTES):
        if block.endswith(b"\n"):
            break
    return file.tell()


def _parse_numbers(cells: Sequence[str]) -> np.ndarray:
    """Cells as finite numbers, NaN where they are not; all at once if none needs the slower look."""
    with suppress(ValueError):
        numbers, text = np.fromiter(map(float, cells), float, len(cells)), "".join(cells)
        if text.isascii() and "_" not in text and np.isfinite(numbers).all():
            return numbers
    found = (parse_finite(cell.strip()) for cell in cells)
    return np.array([np.nan if number is None else number for number in found])


def _concatenate_bytes(parts: Iterable[Path]) -> Iterator[bytes]:
    """The bytes of several files one below the other, with the header of the first."""
    for number, part in enumerate(parts):
        with files.open_file(part) as content:
            header = content.readline()
            if number == 0:
                yield header
            yield from iter(partial(content.read, BLOCK_BYTES), b"")
