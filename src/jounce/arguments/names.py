"""Match the entries of a state or load by name, and report all naming errors together."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, one_line, quote_value
from jounce.core.scalars import is_zero
from jounce.model.mechanism import Mechanism

LOCK_CURE = "lock= of jounce.load, or Robot.locked, holds joints without a value"


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


def _unreadable_error(given: Any, error: Exception) -> JounceError:  # of a foreign type: a lazy frame, a closed file
    return JounceError(f"nothing can be read from {type(given).__name__}: {one_line(error)}")


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


def check_names(given: Collection[Any], expected: Sequence[str], unfit: Mapping[Any, str], asked: str = "") -> None:
    """Raise `JounceError` if the given names are not the expected ones, with all missing, unknown and unfit names.

    `unfit` maps existing names that are not allowed here to the reason; `asked` describes the expected names.
    """
    from difflib import get_close_matches  # imported here to keep start-up fast

    absent = [name for name in expected if name not in given]
    unknown = []
    for name in [name for name in given if name not in expected and name not in unfit]:
        near = get_close_matches(name, absent, n=1) if isinstance(name, str) else []
        unknown.append(quote_value(name) + (f" (did you mean {near[0]!r}?)" if near else ""))
    found = (("missing", [quote_value(name) for name in absent]), ("unknown", unknown))
    wrong = [f"{word} {join_names(names)}" for word, names in found if names]
    wrong += [f"leave out {quote_value(name)}, {unfit[name]}" for name in given if name in unfit]
    if wrong:
        raise JounceError(f"{'; '.join(wrong)}; expected {asked or join_names(expected)}")


def find_followers(mechanism: Mechanism) -> dict[Any, str]:
    """Map the joints that are not coordinates, and so not part of a state, to the joints that they follow."""
    in_loops = [name for name in mechanism.tree.coordinates if name not in mechanism.coordinates]
    follows: dict[Any, str] = dict.fromkeys(in_loops, "which follows others in closed loops")
    for joint, row in zip(mechanism.joints, mechanism.tree.G, strict=True):
        if joint not in mechanism.tree.coordinates:
            leaders = [mechanism.tree.coordinates[j] for j in np.flatnonzero([not is_zero(factor) for factor in row])]
            follows[joint] = f"which follows {join_names(leaders) or 'none'} (mimic)"
    return follows
