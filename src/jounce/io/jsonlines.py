"""JSON lines: a table whose rows are objects, one per line; lists in them are columns NAME[0], NAME[1], ..."""

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, one_line, quote_value
from jounce.core.scalars import is_finite
from jounce.io.columns import CellError, Columns, Select
from jounce.io.files import open_file
from jounce.io.remainders import remainder_name, split_names, text_remainders

ROWS_PER_JSON_PIECE = 1 << 12  # few enough for parsed rows, which take some kB each, to fit in memory


def read_pieces(path: Path, select: Select | None = None) -> Iterator[Columns]:
    """Yield the table of a file in pieces of some rows; objects within a row are columns NAME.FIELD."""
    with open_file(path) as file:
        rows = ((number, _parse_row(path, number, line)) for number, line in enumerate(file, start=1) if line.strip())
        first = next(rows, None)
        if first is None:
            raise JounceError(f"{path}: the table is empty; expected one JSON object per line, a number for each name")
        names, bases = split_names(first[1] if select is None else select(list(first[1])))
        piece = [first, *islice(rows, ROWS_PER_JSON_PIECE - 1)]
        while piece:
            columns = {name: np.array([_read_number(path, *numbered, name) for numbered in piece]) for name in names}
            for name in bases:
                cells = [str(row[name]) for _, row in piece]
                columns[remainder_name(name)] = text_remainders(cells, columns[name])
            yield columns
            piece = list(islice(rows, ROWS_PER_JSON_PIECE))


class _WrittenNumber(float):
    """A number that remembers how it is written."""

    __slots__ = ("text",)

    def __init__(self, text: str) -> None:
        self.text = text

    def __str__(self) -> str:
        return self.text


def _parse_row(path: Path, number: int, line: bytes) -> dict[str, Any]:
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


def _read_number(path: Path, line: int, row: dict[str, Any], name: str) -> float:
    if name not in row:
        raise JounceError(f"{path}:{line}: no {quote_value(name)} in this row; it has: {join_names(row)}")
    if not is_finite(row[name]):
        came = f"column {quote_value(name)} holds {quote_value(row[name])}"
        raise CellError(f"{path}:{line}: {came}; expected a finite number")
    return float(row[name])
