"""JSON lines: a table whose rows are objects, one per line; lists in them are columns NAME[0], NAME[1], ..."""

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, listed, one_line, quoted
from jounce.core.scalars import is_finite
from jounce.io.columns import CellError, Columns, Select
from jounce.io.files import opened
from jounce.io.remainders import remainder_of, remainders_of_texts, split_names

ROWS_PER_JSON_PIECE = 1 << 12  # few enough for parsed rows, which take some kB each, to fit in memory


def pieces(path: Path, select: Select | None = None) -> Iterator[Columns]:
    """Yield the table of a file in pieces of some rows; objects within a row are columns NAME.FIELD."""
    with opened(path) as file:
        rows = ((number, _row(path, number, line)) for number, line in enumerate(file, start=1) if line.strip())
        first = next(rows, None)
        if first is None:
            raise JounceError(f"{path}: the table is empty; expected one JSON object per line, a number for each name")
        names, bases = split_names(first[1] if select is None else select(list(first[1])))
        piece = [first, *islice(rows, ROWS_PER_JSON_PIECE - 1)]
        while piece:
            columns = {name: np.array([_number(path, *numbered, name) for numbered in piece]) for name in names}
            for name in bases:
                cells = [str(row[name]) for _, row in piece]
                columns[remainder_of(name)] = remainders_of_texts(cells, columns[name])
            yield columns
            piece = list(islice(rows, ROWS_PER_JSON_PIECE))


class _Written(float):
    """A number that remembers how it is written."""

    __slots__ = ("text",)

    def __init__(self, text: str) -> None:
        self.text = text

    def __str__(self) -> str:
        return self.text


def _row(path: Path, number: int, line: bytes) -> dict[str, Any]:
    try:
        row = json.loads(line, parse_float=_Written)
        if not isinstance(row, dict):
            raise ValueError(f"{quoted(row)} is not an object")
        return dict(_flat(row, ""))
    except (ValueError, RecursionError) as error:
        raise JounceError(f"{path}:{number}: not a line of JSON: {one_line(error)}") from None


def _flat(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from _flat(inner, f"{name}[{i}]")
    else:
        yield name, value


def _number(path: Path, line: int, row: dict[str, Any], name: str) -> float:
    if name not in row:
        raise JounceError(f"{path}:{line}: no {quoted(name)} in this row; it has: {listed(row)}")
    if not is_finite(row[name]):
        came = f"column {quoted(name)} holds {quoted(row[name])}"
        raise CellError(f"{path}:{line}: {came}; expected a finite number")
    return float(row[name])
