"""Data whose entries have names: mappings, series and data frames, structured arrays, tables, labelled arrays.

NumPy drops names and keeps the order, which a caller who gives names does not state. `scalars.asarray` therefore
refuses whatever has names, and doors that match names read them first.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, one_line, quote_value

MAX_QUOTED_NAMES = 3  # of the entries in a message


def entry_names(data: Any) -> list[Any] | None:
    """Return the names of the entries of data, or None.

    It is None if they have no names. Named are the entries of mappings and whatever else `dict` accepts by keys (data
    frames and series of pandas), of data frames that list their columns (polars, pyarrow), and of structured arrays.
    """
    kind = type(data)
    if kind in (list, tuple):
        return None  # as most are that are no arrays
    try:
        if hasattr(kind, "keys") and hasattr(kind, "__getitem__"):
            return list(data.keys())
        columns = getattr(data, "column_names", getattr(data, "columns", None))  # of pyarrow, of polars
        fields = getattr(getattr(data, "dtype", None), "names", None)
    except Exception as error:
        raise _unreadable_error(data, error) from error
    if isinstance(columns, list):
        return columns
    return list(fields) if isinstance(fields, tuple) else None


def read_entries(data: Any) -> dict[Any, Any]:
    """Map the names that `entry_names` finds to their entries."""
    names = entry_names(data) or []
    repeated = [quote_value(name) for name in dict.fromkeys(names) if names.count(name) > 1]
    if len(repeated) > 0:
        raise JounceError(f"repeated name {join_names(repeated)}; expected every name once")
    try:
        return {name: data[name] for name in names}
    except Exception as error:
        raise _unreadable_error(data, error) from error


def refuse_names(data: Any, what: str) -> None:
    """Raise `JounceError` if entries along an axis of the data have names.

    What lists hold counts, too.
    """
    names = names_along_axes(data)
    if len(names) > 0:
        ending = ", ..." if len(names) > MAX_QUOTED_NAMES else ""
        few = ", ".join(map(quote_value, names[:MAX_QUOTED_NAMES])) + ending
        came = f"{what} has entries with names, {few}, which are not matched here"
        raise JounceError(f"{came}; expected an array without names, in the order of its entries")


def names_along_axes(data: Any) -> list[Any]:
    """Return the labels of the first axis with text labels.

    Numbers and times label samples.
    """
    try:
        return _find_names(data)
    except RecursionError:  # a list may hold itself, which NumPy refuses
        return []


def _find_names(data: Any) -> list[Any]:
    """Return the labels of the first axis with names.

    A list has the names of what it holds.
    """
    if isinstance(data, np.ndarray) and data.dtype.names is None:
        return []
    if type(data) in (list, tuple):
        # Lists of numbers may be long, and are not looked at one by one.
        holds_numbers = all(issubclass(kind, int | float | np.generic) for kind in set(map(type, data)))
        parts = () if holds_numbers else map(_find_names, data)
        return next((names for names in parts if len(names) > 0), [])
    try:
        axes = _labels_along_axes(data)
    except Exception:  # whatever a foreign type raises: NumPy is asked next
        return []
    return next((labels for labels in axes if any(isinstance(x, str | tuple) for x in labels)), [])


def _labels_along_axes(data: Any) -> list[list[Any]]:
    """Return the labels along the axes of data.

    They are those of pandas or xarray, or names of other data.
    """
    axes, coordinates = getattr(data, "axes", None), getattr(data, "coords", None)
    if isinstance(axes, list):
        return [list(axis) for axis in axes if _holds_objects(axis)]
    if isinstance(coordinates, Mapping):
        return [np.asarray(along).ravel().tolist() for along in coordinates.values() if _holds_objects(along)]
    return [entry_names(data) or []]


def _holds_objects(labels: Any) -> bool:
    """Return whether labels may be texts.

    Those of samples are numbers or times.
    """
    return getattr(getattr(labels, "dtype", None), "kind", "O") not in "iufMm"


def _unreadable_error(data: Any, error: Exception) -> JounceError:
    """Return the error for data of a foreign type: a lazy frame, a closed file."""
    return JounceError(f"nothing can be read from {type(data).__name__}: {one_line(error)}")
