"""Data whose entries have names: mappings, series and data frames, structured arrays, tables, labelled arrays.

NumPy drops names and keeps the order, which a caller who gives names does not state. `scalars.asarray` therefore
refuses whatever has names, and doors that match names read them first.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, one_line, quote_value

MAX_QUOTED_NAMES = 3  # of the entries in a message


def entry_names(given: Any) -> list[Any] | None:
    """Return the names of the entries of a caller's data, or None if they have no names.

    Named are the entries of mappings and whatever else `dict` accepts by keys (data frames and series of pandas), of
    data frames that list their columns (polars, pyarrow), and of structured arrays.
    """
    kind = type(given)
    if kind in (list, tuple):
        return None  # as most are that are no arrays
    try:
        if hasattr(kind, "keys") and hasattr(kind, "__getitem__"):
            return list(given.keys())
        columns = getattr(given, "column_names", getattr(given, "columns", None))  # of pyarrow, of polars
        fields = getattr(getattr(given, "dtype", None), "names", None)
    except Exception as error:
        raise _unreadable_error(given, error) from error
    if isinstance(columns, list):
        return columns
    return list(fields) if isinstance(fields, tuple) else None


def read_entries(given: Any) -> dict[Any, Any]:
    """Map the names that `entry_names` finds to their entries."""
    names = entry_names(given) or []
    repeated = [quote_value(name) for name in dict.fromkeys(names) if names.count(name) > 1]
    if repeated:
        raise JounceError(f"repeated name {join_names(repeated)}; expected every name once")
    try:
        return {name: given[name] for name in names}
    except Exception as error:
        raise _unreadable_error(given, error) from error


def refuse_names(given: Any, what: str) -> None:
    """Raise `JounceError` if entries along an axis of the data have names, or those of what a list holds."""
    if names := names_along_axes(given):
        few = ", ".join(map(quote_value, names[:MAX_QUOTED_NAMES])) + ", ..." * (len(names) > MAX_QUOTED_NAMES)
        came = f"{what} has entries with names, {few}, which are not matched here"
        raise JounceError(f"{came}; expected an array without names, in the order of its entries")


def names_along_axes(given: Any) -> list[Any]:
    """The labels of the first axis that has texts among them; numbers and times label samples."""
    try:
        return _find_names(given)
    except RecursionError:  # a list may hold itself, which NumPy refuses
        return []


def _find_names(given: Any) -> list[Any]:
    if isinstance(given, np.ndarray) and given.dtype.names is None:
        return []
    if type(given) in (list, tuple):
        numbers = all(issubclass(kind, int | float | np.generic) for kind in set(map(type, given)))
        parts = () if numbers else map(_find_names, given)
        return next((names for names in parts if names), [])
    try:
        axes = _labels_along_axes(given)
    except Exception:  # whatever a foreign type raises: NumPy is asked next
        return []
    return next((labels for labels in axes if any(isinstance(x, str | tuple) for x in labels)), [])


def _labels_along_axes(given: Any) -> list[list[Any]]:
    """The labels along axes of data frames and series of pandas, and of arrays of xarray; names of all else."""
    axes, coordinates = getattr(given, "axes", None), getattr(given, "coords", None)
    if isinstance(axes, list):
        return [list(axis) for axis in axes if _holds_objects(axis)]
    if isinstance(coordinates, Mapping):
        return [np.asarray(along).ravel().tolist() for along in coordinates.values() if _holds_objects(along)]
    return [entry_names(given) or []]


def _holds_objects(labels: Any) -> bool:
    """Whether labels may be texts: those of samples are numbers or times, and may be millions."""
    return getattr(getattr(labels, "dtype", None), "kind", "O") not in "iufMm"


def _unreadable_error(given: Any, error: Exception) -> JounceError:  # of a foreign type: a lazy frame, a closed file
    return JounceError(f"nothing can be read from {type(given).__name__}: {one_line(error)}")
