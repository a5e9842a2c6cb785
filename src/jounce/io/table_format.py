"""Reads tables by rows: columns of numbers, in chunks of bounded memory.

`Columns` are named arrays of finite numbers, all of one length; `check_columns` makes them of a caller's arrays. A
`TableFormat` reads spans of a file, which follow each other without gaps: they can be read in any order, each in
chunks of some rows, and take a bounded amount of memory. A table that is read as a whole, `whole`, is one span.

A `Chunk` keeps what is wrong with its rows; `leave_out_rows` refuses the first bad row, or leaves all of them out. This
module is common to all formats: `jounce.io.csv`, `npz` and `parquet` are formats by rows, `whole_tables` gives all rows
at once. `jounce.io.tables` selects the format of a file.
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
Select = Callable[[Sequence[str]], Iterable[str]]  # from the names that a table has to the names of columns to read


@dataclass(frozen=True)
class TableMetadata:
    """Metadata of a table: units of columns by name, and plain data.

    Tables of some types keep it.
    """

    unit: Callable[[str], str]
    data: Mapping[str, Any]


def flatten(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return arrays as columns.

    Arrays (N, k) are k columns NAME[0], NAME[1], ...; vectors (N, 1) and (1, N), as MATLAB has them, are one.
    """
    columns: dict[str, np.ndarray] = {}
    for name, array in arrays.items():
        if array.ndim == 2 and 1 in array.shape and array.size > 0:
            columns[name] = array.ravel()
        elif array.ndim == 2:
            columns |= {f"{name}[{j}]": column for j, column in enumerate(array.T)}
        else:
            columns[name] = array
    return columns


def select_columns(columns: Mapping[str, np.ndarray], select: Select | None) -> dict[str, np.ndarray]:
    """Return the selected columns, or all if `select` is None.

    Arrays of several columns are flattened before the selection.
    """
    if select is None:
        return dict(columns)
    flat = flatten(columns)
    names, bases = split_names(select(list(flat)))
    return with_remainders({name: flat[name] for name in names}, bases, flat)


class CellError(JounceError):
    """A cell is not a finite number."""


def check_columns(place: object, columns: Mapping[str, np.ndarray]) -> Columns:
    """Return a caller's arrays as the columns of a table.

    Cells may be infinite or NaN.
    """
    if max((array.size for array in columns.values()), default=0) == 0:
        raise JounceError(f"{place}: no columns or no rows; expected named columns of numbers")
    # (N,) of the first column; () where it is a single number, which no column may be.
    shape = next(iter(columns.values())).shape[:1]
    for name, array in columns.items():
        if array.shape != shape or array.ndim != 1 or array.dtype.kind not in "fiu":
            came = f"{array.dtype} of shape {array.shape}"
            expected_shape = shape if len(shape) > 0 else "(N,)"
            raise CellError(
                f"{place}: column {quote_value(name)} is {came}; expected numbers of shape {expected_shape}"
            )
    return {name: array.astype(float) for name, array in columns.items()}


def check_finite(
    place: object, columns: Mapping[str, np.ndarray], first: int = 0, missing: tuple[str, ...] = ()
) -> None:
    """Raise `JounceError` if a column contains a value that is not finite.

    Columns that end in one of `missing` may hold NaN. `first` is the number of the first row.
    """
    for name, array in columns.items():
        is_bad = np.isinf(array) if name.endswith(missing) else ~np.isfinite(array)
        bad_rows = np.flatnonzero(is_bad)
        if bad_rows.size > 0:
            came = f"{array[bad_rows[0]]} in row {first + bad_rows[0]} from 0"
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
# Columns that are inflated as a whole take no more bytes beyond those of their file: a small file states any size.
MAX_INFLATED_BYTES = 1 << 30
Pieces = Iterable[Mapping[str, np.ndarray]]


class Span(NamedTuple):
    """A span of a file, from one place to another.

    Places are numbers of rows from 0, or of bytes of CSV tables.
    """

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
        """Return the first bad column of each bad row, and why.

        `names` are the columns that must hold finite numbers; the column is "" where the row as a whole is bad.
        """
        problems = {i: ("", reason) for i, reason in self.broken.items()}
        # Where a sum is finite all cells are, and it takes less time than a look at each cell.
        with np.errstate(all="ignore"):
            doubtful = [name for name in names if not isfinite(self.columns[name].sum())]
        for name in doubtful:
            column = self.columns[name]
            for i in np.flatnonzero(~np.isfinite(column)).tolist():
                came = self.texts.get((i, name))
                text = str(column[i]) if came is None else quote_value(came)
                problems.setdefault(i, (name, f"holds {text}; expected a finite number"))
        return problems


def leave_out_rows(
    problems: Mapping[int, tuple[str, str]], count: int, row_words: Callable[[int], str], skip: bool
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return which rows (N,) are good, and a note of others.

    `problems` are the column of a bad row and what is wrong with it, by row. `row_words` names a row in messages.
    `JounceError` is raised for the first bad row unless they are to `skip`.
    """
    is_good = np.ones(count, dtype=bool)
    if len(problems) == 0:
        return is_good, ()
    is_good[list(problems)] = False
    first = min(problems)
    column, problem = problems[first]
    has_column = column != ""
    column_words = f"column {quote_value(column)} " if has_column else ""
    came = f"{row_words(first)}: {column_words}{problem}"
    if not skip:
        # A cell that is no number may be in a column that the motion does not need: readers of logs add that cure.
        error = CellError if has_column else JounceError
        raise error(f"{came}; {ROW_CURE}")
    if not is_good.any():
        raise JounceError(f"{came}; no row is good")
    separator = ", the first:" if len(problems) > 1 else ":"
    return is_good, (f"{len(problems)} of {count} rows left out{separator} {came}",)


class TableFormat(ABC):
    """A type of tables: how they are read by rows, and written.

    Places are numbers of rows unless a format says otherwise.
    """

    FIRST = 0, 0  # the place of the first row or line, and its number

    @abstractmethod
    def columns(self, path: Path) -> dict[str, str]:
        """Return the columns by name, with the type of their cells.

        The type is "" where the cells are numbers, or where it is not known before they are read.
        """

    def names(self, path: Path) -> list[str]:
        """Return the names of the columns."""
        return list(self.columns(path))

    @abstractmethod
    def size(self, path: Path) -> int:
        """Return the bytes that the numbers take in memory.

        Of a table of text they are those of the file.
        """

    def check_numbers(self, path: Path, names: Sequence[str]) -> None:
        """Raise `JounceError` where a column does not hold numbers.

        Only what is known without reading the column is checked.
        """
        types = self.columns(path)
        for name in names:
            if types[name] != "":
                raise JounceError(f"{path}: column {quote_value(name)} holds {types[name]}; expected numbers")

    @abstractmethod
    def spans(self, path: Path, cells: int) -> list[Span]:
        """Return the spans of a table, of about `cells` cells each."""

    @abstractmethod
    def chunks(self, path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
        """Yield chunks of the rows of a span.

        They have some columns of numbers, and one of texts or none.
        """

    @abstractmethod
    def write(self, path: Path, pieces: Pieces, about: TableMetadata | None = None) -> None:
        """Write a table piece by piece.

        Units and plain data are written where the format has metadata.
        """

    @abstractmethod
    def join(self, path: Path, parts: Iterable[Path]) -> None:
        """Write the tables of several files as one.

        Their columns are the same.
        """

    def row_before(self, path: Path, place: int) -> Span | None:
        """Return the span of the row that ends there, if any."""
        return Span(place - 1, place) if place > 0 else None

    def next_row(self, path: Path, place: int) -> Span | None:
        """Return the span of the row that begins there, if any."""
        return Span(place, place + 1) if place < self.spans(path, sys.maxsize)[-1].stop else None

    def number(self, path: Path, place: int, known_row: tuple[int, int]) -> int:
        """Return the number of the row at a place.

        `known_row` are a place before it and the number of its row.
        """
        return place

    def row(self, path: Path, number: int) -> str:
        """Return the row of a number, as messages name it."""
        return f"{path}: row {number} from 0"

    def place(self, path: Path, at: int) -> str:
        """Return a place in a file, as messages name it."""
        return self.row(path, self.number(path, at, self.FIRST))

    def whole(self, path: Path, select: Select | None = None) -> Chunk:
        """Return all rows of the columns that are selected by name.

        There is at least one row; cells may be of any kind.
        """
        header = self.names(path)
        names = header if select is None else list(select(header))
        self.check_numbers(path, split_names(names)[0])
        chunks, spans = list[Chunk](), list(self.spans(path, sys.maxsize))
        with stage(f"reading {path.name}") as advance:
            for chunk in chain.from_iterable(self.chunks(path, names, None, span) for span in spans):
                chunks.append(chunk)
                advance(int(chunk.places[-1]), spans[-1].stop)
        if len(chunks) == 0:
            raise JounceError(f"{path}: no rows of numbers under the column names")
        return join_chunks(chunks)


def join_chunks(chunks: Sequence[Chunk]) -> Chunk:
    """Return chunks of a table, one below the other, without motions."""
    # The row at which each chunk starts.
    starts = np.cumsum([0, *(len(chunk.places) - 1 for chunk in chunks[:-1])]).tolist()
    texts: dict[tuple[int, str], str] = {}
    broken: dict[int, str] = {}
    for start, chunk in zip(starts, chunks, strict=True):
        texts |= {(start + i, name): text for (i, name), text in chunk.texts.items()}
        broken |= {start + i: reason for i, reason in chunk.broken.items()}
    # Each column of a chunk is freed once it is copied.
    columns = [dict(chunk.columns) for chunk in chunks]
    return Chunk(
        {name: np.concatenate([part.pop(name) for part in columns]) for name in list(columns[0])},
        None,
        np.concatenate([*(chunk.places[:-1] for chunk in chunks), chunks[-1].places[-1:]]),
        texts,
        broken,
    )


def number_rows(columns: Columns) -> Chunk:
    """Return the rows of columns, whose places are their numbers."""
    return Chunk(columns, None, np.arange(len(next(iter(columns.values()))) + 1))


def rows_per_chunk(columns: int) -> int:
    """Return the rows of a chunk of some columns."""
    return max(1, CELLS_PER_CHUNK // max(1, columns))
