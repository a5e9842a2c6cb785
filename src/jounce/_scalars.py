"""The one file that knows scalar types and their namespaces.

A backend is a scalar type: a state is a float array of NumPy, an array of any library that follows the array API
standard (JAX), or a NumPy object array of symbols (CasADi ``SX``, SymPy, tracing scalars). Mathematics elsewhere uses
``@ + - * .mT``, slices and the few functions here, and never assigns in place.
"""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np

from jounce.errors import JounceError, one_line

FLOAT = np.dtype(float)
Array: TypeAlias = Any  # a NumPy array of floats or objects, a JAX array or tracer


def asarray(x: Any, what: str = "an array") -> Array:
    """`x` as an array to calculate with: integers and short floats become float64, symbols stay what they are."""
    if not isinstance(x, np.ndarray) and hasattr(type(x), "__array_namespace__"):
        return x  # a foreign array that names its own namespace: JAX, also while it traces
    if isinstance(x, Mapping | str):
        raise JounceError(f"{what} is of type {type(x).__name__}; expected an array of numbers")
    if type(x).__module__.startswith("casadi"):
        x = _of_casadi(x, what)
    try:
        array = np.asarray(x)
    except Exception as error:  # ragged lists, and whatever a foreign type raises in its conversion
        raise JounceError(f"{what} is not an array of numbers: {one_line(error)}") from error
    if array.dtype.kind == "O" and all(isinstance(v, int | float | np.floating | np.integer) for v in array.flat):
        array = array.astype(np.float64)
    if array.dtype.kind in "biuf":
        return array.astype(np.result_type(array.dtype, np.float64), copy=False)
    if array.dtype.kind == "O" and not any(v is None or isinstance(v, str | complex) for v in array.flat):
        return array
    raise JounceError(f"{what} holds {_kind(array)}; expected real numbers or symbols")


def element(x: Any, what: str) -> Array:
    """`x` as what stands for one scalar of an array, batch axes alone; a CasADi scalar, which has two axes, is one."""
    if not type(x).__module__.startswith("casadi") or x.shape != (1, 1):
        return asarray(x, what)
    array = np.empty((), dtype=object)
    array[()] = x
    return array


def _of_casadi(x: Any, what: str) -> np.ndarray:
    """The entries of a CasADi matrix, `SX` or numbers: (n,) of a column or a row, else (m, n)."""
    if type(x).__name__ not in ("SX", "DM"):
        raise JounceError(
            f"{what} is a CasADi {type(x).__name__}; expected SX, or call with it what jounce.casadi_function returns"
        )
    array = np.empty(x.shape, dtype=object)
    for index in np.ndindex(*x.shape):
        array[index] = x[index] if type(x).__name__ == "SX" else float(x[index])
    return array.ravel() if 1 in x.shape else array


def _kind(array: np.ndarray) -> str:
    kinds = {"c": "complex numbers", "U": "text", "S": "bytes", "M": "dates", "m": "durations", "O": "None or text"}
    return kinds.get(array.dtype.kind, f"values of type {array.dtype}")


def is_numeric(x: Array) -> bool:
    """Whether `x` holds numbers that can be checked (a NumPy float array), not symbols or traced values."""
    return isinstance(x, np.ndarray) and x.dtype != object


def is_zero(x: Any) -> bool:
    """Whether a scalar is the number 0; a symbol of any kind is not, and is never asked for its truth."""
    try:
        return bool(x == 0)
    except Exception:  # CasADi's symbols have no truth value
        return False


def is_symbolic(x: Array) -> bool:
    """Whether `x` is an object array: symbols, or traced scalars."""
    return isinstance(x, np.ndarray) and x.dtype == object


def whole(x: np.ndarray) -> np.ndarray:
    """The same numbers in an object array, integers where they are whole: 1 L stays L among symbols, not 1.0 L."""
    as_integer = np.frompyfunc(lambda v: int(v) if isinstance(v, float) and v.is_integer() else v, 1, 1)
    return np.asarray(as_integer(x), dtype=object)


def namespace(*arrays: Array) -> Any:
    """The module whose functions serve these arrays: NumPy, unless one of them brings its own."""
    for x in arrays:
        if not isinstance(x, np.ndarray) and hasattr(type(x), "__array_namespace__"):
            return x.__array_namespace__()
    return np


def concatenate(arrays: Sequence[Array], axis: int) -> Array:
    """The arrays joined along `axis`, their leading (batch) axes broadcast against each other."""
    xp = namespace(*arrays)
    lead = np.broadcast_shapes(*(x.shape[:axis] for x in arrays))
    return xp.concatenate([xp.broadcast_to(x, lead + x.shape[axis:]) for x in arrays], axis=axis)


def zeros_like(x: Array) -> Array:
    """Exact zeros in the shape and scalar type of `x` (integers 0 among symbols)."""
    return namespace(x).zeros_like(x)


def _elementwise(name: str) -> Callable[[Array], Array]:
    def scalar(s: Any) -> Any:
        sympy = sys.modules.get("sympy")  # imported already wherever its symbols exist
        if sympy is not None and isinstance(s, sympy.Basic):
            return getattr(sympy, name)(s)
        if isinstance(s, int | float):
            return getattr(math, name)(s)
        if not hasattr(s, name):
            raise JounceError(f"scalars of type {type(s).__name__} have no method {name}(); expected one")
        return getattr(s, name)()

    over_objects = np.frompyfunc(scalar, 1, 1)

    def function(x: Array) -> Array:
        if is_symbolic(x):
            return np.asarray(over_objects(x), dtype=object)
        return getattr(namespace(x), name)(x)

    function.__doc__ = f"{name} of every element, whatever the scalar type."
    return function


sin = _elementwise("sin")
cos = _elementwise("cos")
tanh = _elementwise("tanh")
