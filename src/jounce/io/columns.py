"""Columns: named arrays of finite numbers, all of one length, and their checks."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, quote_value
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
