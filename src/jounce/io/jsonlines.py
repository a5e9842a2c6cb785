"""JSON lines: a table whose rows are objects, one per line; lists in them are columns NAME[0], NAME[1], ..."""

import json
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, one_line, quote_value
from jounce.core.scalars import is_finite
from jounce.core.typing import JsonObject
from jounce.io.files import open_file
from jounce.io.remainders import remainder_name, split_names, text_remainders
from jounce.io.table_format import Chunk, Select, join_chunks

ROWS_PER_JSON_PIECE = 1 << 12  # few enough for parsed rows, which take some kB each, to fit in memory


def read_rows(path: Path, select: Select | None = None) -> Chunk:
    """All rows of a file, whose places are the numbers of lines; objects within a row are columns NAME.FIELD."""
    with open_file(path) as file:
        rows = ((number, _parse_row(path, number, line)) for number, line in enumerate(file, start=1) if line.strip())
        first = next(rows, None)
        if first is None:
            raise JounceError(f"{path}: the table is empty; expected one JSON object per line, a number for each name")
        names, bases = split_names(first[1] if select is None else select(list(first[1])))
        every, found = chain([first], rows), list[Chunk]()
        while piece := list(islice(every, ROWS_PER_JSON_PIECE)):
            found.append(_read_piece(piece, names, bases))
    return join_chunks(found)


def _read_piece(piece: list[tuple[int, JsonObject]], names: list[str], bases: list[str]) -> Chunk:
    cells: dict[str, list[Any]] = {name: [row.get(name) for _, row in piece] for name in names}
    columns = {name: np.array([float(x) if is_finite(x) else np.nan for x in of]) for name, of in cells.items()}
    for name in bases:
        columns[remainder_name(name)] = text_remainders(list(map(str, cells[name])), columns[name])
    texts = {(i, name): str(x) for name, of in cells.items() for i, x in enumerate(of) if not is_finite(x)}
    absent = {i: name for i, (_, row) in enumerate(piece) for name in reversed(names) if name not in row}
    broken = {i: f"no {quote_value(x)} in this row; it has: {join_names(piece[i][1])}" for i, x in absent.items()}
    return Chunk(columns, None, np.array([number for number, _ in piece] + [piece[-1][0] + 1]), texts, broken)


class _WrittenNumber(float):
    """A number that remembers how it is written."""

    __slots__ = ("text",)

    def __init__(self, text: str) -> None:
        self.text = text

    def __str__(self) -> str:
        return self.text


def _parse_row(path: Path, number: int, line: bytes) -> JsonObject:
    try:
        row = json.loads(line, parse_float=_WrittenNumber)
        if not isinstance(row, dict):
            raise ValueError(f"{quote_value(row)} is not an object")
        return dict(_flatten_row(row, ""))
    except (ValueError, RecursionError) as error:
        raise JounceError(f"{path}:{number}: not a line of JSON: {one_line(error)}") from None


def _flatten_row(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flatten_row(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from _flatten_row(inner, f"{name}[{i}]")
    else:
        yield name, value
