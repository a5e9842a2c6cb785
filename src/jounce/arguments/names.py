"""Names that callers give: what stands under each, and all that is wrong with them, said at once."""

from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np

from jounce._scalars import is_zero
from jounce.errors import JounceError, listed, one_line, quoted
from jounce.model.mechanism import Mechanism

LOCK = "lock= of jounce.load, or Robot.locked, holds joints without a value"


def listed_in(given: Any) -> list[Any] | None:
    """The names under which something stands in what a caller gives, or None where nothing is named.

    Names have mappings and all else that `dict` would take by its keys (data frames and series of pandas), data frames
    that list their columns (polars, pyarrow), and structured arrays.
    """
    if type(given) in (list, tuple):
        return None  # as most are that are no arrays
    try:
        return _names_of(given)
    except Exception as error:
        raise _unreadable(given, error) from error


def _names_of(given: Any) -> list[Any] | None:
    kind = type(given)
    if hasattr(kind, "keys") and hasattr(kind, "__getitem__"):
        return list(given.keys())
    columns = getattr(given, "column_names", getattr(given, "columns", None))  # of pyarrow, of polars
    if isinstance(columns, list):
        return columns
    fields = getattr(getattr(given, "dtype", None), "names", None)
    return list(fields) if isinstance(fields, tuple) else None


def _unreadable(given: Any, error: Exception) -> JounceError:
    """The error for whatever a foreign type raises: frames that are lazy, files that are closed."""
    return JounceError(f"nothing can be read from {type(given).__name__}: {one_line(error)}")


def entries(given: Any) -> dict[Any, Any]:
    """What stands under each of the names that `listed_in` finds."""
    names = listed_in(given) or []
    repeated = [quoted(name) for name in dict.fromkeys(names) if names.count(name) > 1]
    if repeated:
        raise JounceError(f"{listed(repeated)} named more than once; expected every name once")
    try:
        return {name: given[name] for name in names}
    except Exception as error:
        raise _unreadable(given, error) from error


def check(given: Collection[Any], expected: Sequence[str], unfit: Mapping[Any, str], asked: str = "") -> None:
    """Raise `JounceError` where the names given are not those expected: what is missing, what is unknown, what unfit.

    `unfit` says of names that exist but have no place here, why; `asked` says in words what is expected.
    """
    missing = [quoted(name) for name in expected if name not in given]
    absent = [name for name in expected if name not in given]
    unknown = [_unknown(name, absent) for name in given if name not in expected and name not in unfit]
    wrong = [f"{word} {listed(names)}" for word, names in (("missing", missing), ("unknown", unknown)) if names]
    wrong += [f"leave out {quoted(name)}, {unfit[name]}" for name in given if name in unfit]
    if wrong:
        raise JounceError(f"{'; '.join(wrong)}; expected {asked or listed(expected)}")


def followers(mechanism: Mechanism) -> dict[Any, str]:
    """The joints that are no coordinates, as names without a place in a state, each with what it follows."""
    follows: dict[Any, str] = {}
    for joint, row in zip(mechanism.joints, mechanism.G, strict=True):
        if joint not in mechanism.coordinates:
            leaders = [mechanism.coordinates[j] for j in np.flatnonzero([not is_zero(factor) for factor in row])]
            follows[joint] = f"which follows {listed(leaders) or 'none'} (mimic)"
    return follows


def _unknown(name: Any, expected: Sequence[str]) -> str:
    near = get_close_matches(name, expected, n=1) if isinstance(name, str) else []
    return quoted(name) + (f" (did you mean {near[0]!r}?)" if near else "")
