"""A chunk of a table: some rows, whose cells may be bad."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from jounce.io.columns import Columns

CELLS = 1 << 19  # in a chunk: 4 MB of numbers, which stay in the cache while they are computed


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


def rows_of(columns: int) -> int:
    """The rows of a chunk."""
    return max(1, CELLS // max(1, columns))
