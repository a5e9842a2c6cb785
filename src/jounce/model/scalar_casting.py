"""The data of a mechanism in other scalars: exact integers, long doubles, symbols."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from jounce.core.scalars import Array, is_numeric, is_symbolic, restore_integers
from jounce.model.drives import Drives
from jounce.model.loops import convert_loops
from jounce.model.mechanism import Mechanism


@lru_cache(maxsize=64)
def with_exact_integers(mechanism: Mechanism) -> Mechanism:
    """Convert integer-valued floats to ints, so that symbolic results show L, not 1.0*L."""
    return _convert(mechanism, restore_integers)


@lru_cache(maxsize=64)
def with_extended_precision(mechanism: Mechanism) -> Mechanism:
    """Convert the data to long doubles, so that quantities derived from them are not rounded to doubles."""
    return _convert(mechanism, lambda array: array.astype(np.longdouble))


def _convert(mechanism: Mechanism, convert: Callable[[Array], Array]) -> Mechanism:
    converted = with_arrays(mechanism, lambda _, array: convert(array))
    frames = tuple(replace(frame, T=convert(frame.T)) for frame in mechanism.frames)
    drives = Drives(**{name: convert(array) for name, array in vars(mechanism.drives).items()})
    elasticity = mechanism.elasticity and mechanism.elasticity.map(convert)
    loops, closure = convert_loops(mechanism.loops, mechanism.closure, convert)
    return replace(converted, frames=frames, drives=drives, elasticity=elasticity, loops=loops, closure=closure)


def with_arrays(mechanism: Mechanism, convert: Callable[[str, Array], Array]) -> Mechanism:
    """The mechanism with its `arrays` converted, each with its name."""
    B, X, M, gravity, G, g = (convert(name, array) for name, array in mechanism.arrays.items())
    return replace(mechanism, B=B, X=X, M=M, gravity=gravity, G=G, g=g)


def cast_model(mechanism: Mechanism, arrays: Sequence[Array]) -> Mechanism:
    """Convert the data to the scalar type of states and wrenches."""
    if any(map(is_symbolic, arrays)):
        return with_exact_integers(mechanism)
    if any(is_numeric(x) and x.dtype == np.longdouble for x in arrays):
        return with_extended_precision(mechanism)
    return mechanism
