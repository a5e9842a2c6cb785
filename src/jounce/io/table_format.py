"""Reads tables by rows: columns of numbers, in chunks of bounded memory.

`Columns` are named arrays of finite numbers, all of one length; `check_columns` makes them of a caller's arrays. A
`TableFormat` reads spans of a file, which follow each other without gaps: they can be read in any order, each in
chunks of some rows, and take a bounded amount of memory. A table that is read as a whole, `whole`, is one span.

A `Chunk` keeps what is wrong with its rows; `leave_out_rows` refuses the first bad row, or leaves all of them out. What
is written here is common to all formats: `jounce.io.csv`, `npz` and `parquet` are formats by rows,
`whole_tables` gives all rows at once. `jounce.io.tables` selects the format of a file.
"""

import sys
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, quote_value
from jounce.core.progress import stage
from jounce.io.remainders import split_names, with_remainders

Columns = dict[str, np.ndarray]
Select = Callable[[Sequence[str]], Iterable[str]]  # of the names that a table has, those to be read


@dataclass(frozen=True)
class TableMetadata:
    """Metadata of a table: the unit of a column by its name, and plain data; tables of some types keep it."""

    unit: Callable[[str], str]
    data: Mapping[str, Any]


def flatten(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays (N, k) as k columns NAME[0], NAME[1], ..., and vectors (N, 1), (1, N), as MATLAB has them, as columns."""
    found: dict[str, np.ndarray] = {}
    for name, array in arrays.items():
        if array.ndim == 2 and 1 in array.shape and array.size:
            found[name] = array.ravel()
        elif array.ndim == 2:
            found |= {f"{name}[{j}]": column for j, column in enumerate(array.T)}
        else:
            found[name] = array
    return found


def select_columns(columns: Mapping[str, np.ndarray], select: Select | None) -> dict[str, np.ndarray]:
    """Return the selected columns, with arrays of several columns flattened; all columns if `select` is None."""
    if select is None:
        return dict(columns)
    flat = flatten(columns)
    names, bases = split_names(select(list(flat)))
    return with_remainders({name: flat[name] for name in names}, bases, flat)


class CellError(JounceError):
    """A cell is not a finite number."""


def check_columns(place: object, columns: Mapping[str, np.ndarray]) -> Columns:
    """Convert a caller's arrays to the columns of a table, whose cells may be infinite or NaN."""
    if not columns or not max(array.size for array in columns.values()):
        raise JounceError(f"{place}: no columns or no rows; expected named columns of numbers")
    rows = next(iter(columns.values())).shape[:1]
    for name, array in columns.items():
        if array.shape != rows or array.ndim != 1 or array.dtype.kind not in "fiu":
            came = f"{array.dtype} of shape {array.shape}"
            raise CellError(
                f"{place}: column {quote_value(name)} is {came}; expected numbers of shape {rows or '(N,)'}"
            )
    return {name: array.astype(float) for name, array in columns.items()}


def check_finite(
    place: object, columns: Mapping[str, np.ndarray], first: int = 0, missing: tuple[str, ...] = ()
) -> None:
    """Raise `JounceError` if a column contains a value that is not finite, nor NaN under an ending of `missing`.

    `first` is the number of the first row.
    """
    for name, array in columns.items():
        bad = np.flatnonzero(np.isinf(array) if name.endswith(missing) else ~np.isfinite(array))
        if bad.size:
            came = f"{array[bad[0]]} in row {first + bad[0]} from 0"
            raise CellError(f"{place}: column {quote_value(name)} holds {came}; expected finite numbers")


def check_distinct(place: object, names: Iterable[str]) -> None:
    """Raise `JounceError` where columns have the same name."""
    for name, count in Counter(names).items():
        if count > 1:
            raise JounceError(f"{place}: column {quote_value(name)} occurs {count} times; rename or remove all but one")


# Chunks of rows, and the formats that read them.
ROW_CURE = Remedy(
    "repair or remove the row, or leave bad rows out by on_error='skip'",
    "repair or remove the row, or leave bad rows out by --on-error skip",
)
CELLS_PER_CHUNK = 1 << 19  # 4 MB of numbers, which stay in the cache while they are computed
# that columns which are inflated as a whole take beyond the bytes of their file: a small file states any size
MAX_INFLATED_BYTES = 1 << 30
Pieces = Iterable[Mapping[str, np.ndarray]]


class Span(NamedTuple):
    """From one place in a file to another: numbers of rows from 0, or of bytes of CSV tables."""

    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some rows of a table.

    `columns` are the columns of numbers, NaN in place of other cells; `motions` are the cells of the column of texts;
    `places` (N + 1,) are the places in the file where the rows begin, and where the last one ends. `texts` are cells
    that are not numbers, by row and column, and `broken` are reasons by row why its cells are not those of the columns.
    """

    columns: Columns
    motions: np.ndarray | None
    places: np.ndarray
    texts: Mapping[tuple[int, str], str] = field(default_factory=dict)
    broken: Mapping[int, str] = field(default_factory=dict)

    def problems(self, names: Iterable[str]) -> dict[int, tuple[str, str]]:
        """The rows with invalid cells in columns of these names: of each the first such column, and what is wrong."""
        found = {i: ("", reason) for i, reason in self.broken.items()}
        with np.errstate(all="ignore"):  # a sum is finite where all are, and sums take less time than looking at each
            doubtful = [name for name in names if not isfinite(self.columns[name].sum())]
        for name in doubtful:
            column = self.columns[name]
            for i in np.flatnonzero(~np.isfinite(column)).tolist():
                came = self.texts.get((i, name))
                text = str(column[i]) if came is None else quote_value(came)
                found.setdefault(i, (name, f"holds {text}; expected a finite number"))
        return found


def leave_out_rows(
    problems: Mapping[int, tuple[str, str]], count: int, where: Callable[[int], str], skip: bool
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Which rows (N,) are good, and a note of those that are left out: by row, their column and what is wrong with it.

    Raises `JounceError` for the first of them unless they are to `skip`.
    """
    good = np.ones(count, dtype=bool)
    if not problems:
        return good, ()
    good[list(problems)] = False
    first = min(problems)
    column, problem = problems[first]
    came = f"{where(first)}: {f'column {quote_value(column)} ' if column else ''}{problem}"
    if not skip:
        raise (CellError if column else JounceError)(f"{came}; {ROW_CURE}")
    if not good.any():
        raise JounceError(f"{came}; no row is good")
    which = ", the first:" if len(problems) > 1 else ":"
    return good, (f"{len(problems)} of {count} rows left out{which} {came}",)


class TableFormat(ABC):
    """How tables of a type are read by rows, and written; places are numbers of rows unless a format says otherwise."""

    FIRST = 0, 0  # the place of the first row or line, and its number

    @abstractmethod
    def columns(self, path: Path) -> dict[str, str]:
        """The columns by name, with the type of their cells where it is known and no number, else ""."""

    def names(self, path: Path) -> list[str]:
        """The names of the columns."""
        return list(self.columns(path))

    @abstractmethod
    def size(self, path: Path) -> int:
        """The bytes that the numbers take in memory, or the text in the file."""

    def check_numbers(self, path: Path, names: Sequence[str]) -> None:
        """Raise `JounceError` where a column does not hold numbers, as far as is known without reading it."""
        types = self.columns(path)
        for name in names:
            if types[name]:
                raise JounceError(f"{path}: column {quote_value(name)} holds {types[name]}; expected numbers")

    @abstractmethod
    def spans(self, path: Path, cells: int) -> list[Span]:
        """The spans of a table, of about a number of cells each."""

    @abstractmethod
    def chunks(self, path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
        """Some columns of numbers, and one of texts, of the rows of a span."""

    @abstractmethod
    def write(self, path: Path, pieces: Pieces, about: TableMetadata | None = None) -> None:
        """Write a table piece by piece, with units and plain data where the format has metadata."""

    @abstractmethod
    def join(self, path: Path, parts: Iterable[Path]) -> None:
        """Write the tables of several files, whose columns are the same, as one."""

    def row_before(self, path: Path, place: int) -> Span | None:
        """The span of the row that ends at a place, if there is one."""
        return Span(place - 1, place) if place else None

    def next_row(self, path: Path, place: int) -> Span | None:
        """The span of the row that begins at a place, if there is one."""
        return Span(place, place + 1) if place < self.spans(path, sys.maxsize)[-1].stop else None

    def number(self, path: Path, place: int, known: tuple[int, int]) -> int:
        """The number of the row at a place; `known` are a place before it and the number of its row."""
        return place

    def row(self, path: Path, number: int) -> str:
        """The row of a number, as messages name it."""
        return f"{path}: row {number} from 0"

    def place(self, path: Path, at: int) -> str:
        """A place in a file, as messages name it."""
        return self.row(path, self.number(path, at, self.FIRST))

    def whole(self, path: Path, select: Select | None = None) -> Chunk:
        """All rows of the columns that are selected by name, at least one row; cells may be of any kind."""
        header = self.names(path)
        wanted = header if select is None else list(select(header))
        self.check_numbers(path, split_names(wanted)[0])
        found, spans = list[Chunk](), list(self.spans(path, sys.maxsize))
        with stage(f"reading {path.name}") as advance:
            for chunk in chain.from_iterable(self.chunks(path, wanted, None, span) for span in spans):
                found.append(chunk)
                advance(int(chunk.places[-1]), spans[-1].stop)
        if not found:
            raise JounceError(f"{path}: no rows of numbers under the column names")
        return join_chunks(found)


def join_chunks(chunks: Sequence[Chunk]) -> Chunk:
    """Chunks of a table, one below the other; texts are left out, and each column is freed once it is copied."""
    starts = np.cumsum([0, *(len(chunk.places) - 1 for chunk in chunks[:-1])]).tolist()
    columns, of = [dict(chunk.columns) for chunk in chunks], list(zip(starts, chunks, strict=True))
    return Chunk(
        {name: np.concatenate([part.pop(name) for part in columns]) for name in list(columns[0])},
        None,
        np.concatenate([*(chunk.places[:-1] for chunk in chunks), chunks[-1].places[-1:]]),
        {(start + i, name): x for start, chunk in of for (i, name), x in chunk.texts.items()},
        {start + i: x for start, chunk in of for i, x in chunk.broken.items()},
    )


def number_rows(columns: Columns) -> Chunk:
    """The rows of columns, whose places are their numbers."""
    return Chunk(columns, None, np.arange(len(next(iter(columns.values()))) + 1))


def rows_per_chunk(columns: int) -> int:
    """The rows of a chunk."""
    return max(1, CELLS_PER_CHUNK // max(1, columns))
