"""Equality by value of frozen data that hold arrays.

A dataclass compares its fields by ``==``, which is no truth value for arrays. `are_equal` compares arrays element by
element, dataclasses field by field, containers item by item, and objects without an equality of their own by what they
hold. Functions are equal to themselves alone: what a function returns is no data.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import BuiltinFunctionType, FunctionType, MethodType
from typing import Any

import numpy as np


class EqualByValue:
    """A frozen dataclass whose instances are equal if all fields are.

    It is written with ``eq=False``.
    """

    def __eq__(self, other: object) -> bool:
        return are_equal(self, other) if type(self) is type(other) else NotImplemented

    def __hash__(self) -> int:
        # Equal data have equal hashes: those of arrays and mappings are their sizes.
        return hash((type(self), *(_hash_part(getattr(self, field.name)) for field in fields(self))))  # type: ignore[arg-type]


def are_equal(a: Any, b: Any) -> bool:
    """Return whether two objects hold the same data; NaN is equal to NaN."""
    if a is b:
        return True
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and _have_equal_elements(a, b)
    if isinstance(a, Mapping):
        return a.keys() == b.keys() and all(are_equal(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list):
        return len(a) == len(b) and all(map(are_equal, a, b))
    if is_dataclass(a):
        return all(are_equal(getattr(a, field.name), getattr(b, field.name)) for field in fields(a) if field.compare)
    # What has no equality of its own is compared by its attributes, unless it is a function or has none.
    is_function = isinstance(a, FunctionType | MethodType | BuiltinFunctionType)
    has_equality = getattr(type(a), "__eq__") is not getattr(object, "__eq__")  # noqa: B009 - mypy compares their types
    if not (has_equality or is_function) and getattr(a, "__dict__", {}):
        return are_equal(vars(a), vars(b))
    return _are_equal_scalars(a, b)


def _have_equal_elements(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether arrays of one shape are equal.

    Floats and whole numbers may be equal.
    """
    if a.dtype == object or b.dtype == object:
        return all(map(_are_equal_scalars, a.flat, b.flat))
    return np.array_equal(a, b, equal_nan=a.dtype.kind == b.dtype.kind == "f")


def _are_equal_scalars(x: Any, y: Any) -> bool:
    try:
        return x is y or bool(x == y) or bool(x != x and y != y)
    except Exception:  # symbols of CasADi that are not known to be the same have no truth value
        return False


def _hash_part(x: Any) -> Any:
    """Return something with a hash that equal values share."""
    if isinstance(x, np.ndarray):
        return x.shape
    if isinstance(x, tuple | list):
        return tuple(map(_hash_part, x))
    if isinstance(x, Mapping):
        return len(x)
    return x if isinstance(x, str | int | bool | EqualByValue | None) else type(x)
