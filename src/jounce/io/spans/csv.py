"""Spans of CSV tables: bytes from the beginning of one line to the end of another."""

import csv
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np

from jounce.core.errors import JounceError, one_line
from jounce.core.scalars import finite
from jounce.io.csv import Layout, layout, parse_numbers
from jounce.io.files import opened
from jounce.io.remainders import remainder_of, remainders_of_texts, split_names
from jounce.io.spans.chunk import Chunk, Span

BLOCK = 1 << 22  # bytes that are read at a time
FIRST = 0, 1  # the place of the first line, and its number
LONGEST = 1 << 20  # bytes of a line
DIGITS = 16  # bytes of a cell, about


def names(path: Path) -> list[str]:
    """The names of the columns."""
    return layout(path).header


def size(path: Path) -> int:
    """The bytes of the text."""
    with opened(path):
        return path.stat().st_size


def spans(path: Path, cells: int) -> list[Span]:
    """Spans of whole lines, of about as many bytes each."""
    first, step = layout(path).start, cells * DIGITS
    with opened(path) as file:
        end = path.stat().st_size
        cuts = [first, *(_line_after(file, place) for place in range(first + step, end, step)), end]
    return [Span(start, stop) for start, stop in itertools.pairwise(cuts) if start < stop]


def check_numbers(path: Path, names: Sequence[str]) -> None:
    """Nothing: a text does not tell what its cells hold."""


def chunks(path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
    """The rows of a span, in chunks."""
    form = layout(path)
    with opened(path) as file:
        file.seek(span.start)
        place, rest = span.start, b""
        while place < span.stop:
            block = file.read(min(BLOCK, span.stop - place - len(rest)))
            whole, cut, more = (rest + block).rpartition(b"\n") if block else (rest, b"", b"")
            if not cut and block:
                rest = more
                continue
            lines, rest = (whole + cut).splitlines(keepends=True), more
            places = place + np.cumsum([0, *map(len, lines)])
            place = int(places[-1])
            yield from _chunk(path, form, lines, places, names, texts)


def row_before(path: Path, place: int) -> Span | None:
    """The span of the line that ends at a place, if there is one."""
    first = layout(path).start
    if place <= first:
        return None
    begin = max(first, place - LONGEST)
    with opened(path) as file:
        file.seek(begin)
        text = file.read(place - 1 - begin)
    return Span(begin + text.rfind(b"\n") + 1, place)


def next_row(path: Path, place: int) -> Span | None:
    """The span of the line that begins at a place, if there is one."""
    with opened(path) as file:
        stop = _line_after(file, place + 1)
    return Span(place, stop) if stop > place else None


def number(path: Path, place: int, known: tuple[int, int]) -> int:
    """The number of the line that begins at a place; `known` are a place before it and the number of its line."""
    start, line = known
    with opened(path) as file:
        file.seek(start)
        while start < place and (block := file.read(min(BLOCK, place - start))):
            start, line = start + len(block), line + block.count(b"\n")
    return line


def row(path: Path, number: int) -> str:
    """A line in words."""
    return f"{path}:{number}"


def _line_after(file: BinaryIO, place: int) -> int:
    """Where the first line begins that does not begin before a place."""
    file.seek(place - 1)
    while block := file.readline(BLOCK):
        if block.endswith(b"\n"):
            break
    return file.tell()


def _chunk(
    path: Path, form: Layout, lines: list[bytes], places: np.ndarray, names: Sequence[str], texts: str | None
) -> Iterator[Chunk]:
    try:
        decoded = [line.decode("utf-8").strip("\r\n" if form.mark != " " else None) for line in lines]
        kept = [i for i, line in enumerate(decoded) if line.strip(" ,;\t")]
        reader = csv.reader((decoded[i] for i in kept), delimiter=form.mark, skipinitialspace=True, strict=True)
        rows = list(reader)
    except (UnicodeDecodeError, csv.Error) as error:
        where = row(path, number(path, int(places[0]), FIRST))
        raise JounceError(f"{where}: not a CSV table: {one_line(error)}") from None
    if not rows:
        return
    broken = {
        i: f"{len(cells)} cells; expected {len(form.header)}, one for each column"
        for i, cells in enumerate(rows)
        if len(cells) != len(form.header)
    }
    for i in broken:
        rows[i] = [cell for cell, _ in itertools.zip_longest(rows[i], form.header, fillvalue="")][: len(form.header)]
    names, bases = split_names(names)
    at = [form.header.index(name) for name in names]
    cells = [[cells[i] for i in at] for cells in rows]
    if form.mark != ",":  # decimal commas
        cells = [[cell.replace(",", ".") for cell in row] for row in cells]
    numbers = parse_numbers([cell for row in cells for cell in row])
    bad: dict[tuple[int, str], str] = {}
    if numbers is None:
        numbers = np.array([[_number(cell) for cell in row] for row in cells])
        missing = np.argwhere(np.isnan(numbers.reshape(len(rows), -1)))
        bad = {(int(i), names[j]): cells[i][j].strip() for i, j in missing}
    columns = {name: x.copy() for name, x in zip(names, numbers.reshape(len(rows), -1).T, strict=True)}
    for name in bases:
        texts_of = [row[names.index(name)] for row in cells]
        columns[remainder_of(name)] = remainders_of_texts(texts_of, columns[name])
    yield Chunk(
        columns,
        None if texts is None else np.array([cells[form.header.index(texts)].strip() for cells in rows], dtype=str),
        np.append(places[:-1][kept], places[-1]),
        bad,
        broken,
    )


def _number(cell: str) -> float:
    number = finite(cell.strip())
    return float("nan") if number is None else number
