"""Whether two robots are the same: names, tree and every number of their mechanisms."""

from collections.abc import Hashable
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from jounce.core.scalars import is_numeric
from jounce.model.mechanism import Mechanism


def are_equal(a: Any, b: Any) -> bool:
    """Whether two mechanisms, or parts of them, hold the same data; floats and whole numbers may be equal."""
    if a is b:
        return True
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        if is_numeric(a) and is_numeric(b):
            return np.array_equal(a, b)
        return a.shape == b.shape and all(map(_are_equal_scalars, a.flat, b.flat))
    if is_dataclass(a):
        return all(are_equal(getattr(a, field.name), getattr(b, field.name)) for field in fields(a) if field.compare)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(are_equal, a, b))
    return bool(a == b)


def structure_key(mechanism: Mechanism) -> Hashable:
    """Return the hashable data that equal mechanisms share: names and tree, no numbers."""
    return mechanism.name, mechanism.parent, mechanism.bodies, mechanism.coordinates


def _are_equal_scalars(x: Any, y: Any) -> bool:
    try:
        return x is y or bool(x == y)
    except Exception:  # symbols of CasADi that are not known to be the same have no truth value
        return False
