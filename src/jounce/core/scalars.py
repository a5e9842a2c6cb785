"""Scalar types and their namespaces, which no other file knows.

A backend is a scalar type: a state is a float array of NumPy, an array of any library that follows the array API
standard (JAX), or a NumPy object array of symbols (CasADi ``SX``, SymPy, tracing scalars). Mathematics elsewhere uses
``@ + - * .mT``, slices and the few functions here, and never assigns in place.
"""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import date, timedelta
from decimal import Decimal
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np

from jounce.core import foreign
from jounce.core.errors import JounceError, one_line, quote_value
from jounce.core.named_entries import refuse_names

FLOAT = np.dtype(float)
Array: TypeAlias = Any  # a NumPy array of floats or objects, a JAX array or tracer
NOT_REAL = (complex, Decimal, date, timedelta, np.generic)  # what adds up, but not with floats, or not to a float


def asarray(x: Any, what: str = "an array") -> Array:
    """Convert `x` to an array to calculate with: integers and short floats become float64, symbols stay as they are.

    Missing numbers, masked by NumPy or NA of pandas, become NaN. Entries with names are refused: an array has none.
    """
    if type(x) is np.ndarray and x.dtype is FLOAT:
        return x  # as most are, and some a thousand times a second
    if not isinstance(x, np.ndarray | np.generic) and hasattr(type(x), "__array_namespace__"):
        return x  # a foreign array that names its own namespace: JAX, also while it traces
    # What NumPy would convert in silence, to other numbers or without names, is refused.
    if isinstance(x, Mapping | str):
        raise JounceError(f"{what} is of type {type(x).__name__}; expected an array of numbers")
    foreign.refuse_spatial(x, what)
    refuse_names(x, what)
    if type(x).__module__.startswith("casadi"):
        x = foreign.from_casadi(x, what)
    # Numbers of Python among objects are floats; so are those of pandas and of masked arrays, NaN where they are
    # missing.
    try:
        array = foreign.fill_missing(np.asarray(foreign.fill_masked(x)))
        if array.dtype.kind == "O" and all(isinstance(v, int | float | np.floating | np.integer) for v in array.flat):
            array = array.astype(np.float64)
    except Exception as error:  # ragged lists, integers beyond the floats, and errors of any foreign type
        if type(error).__module__.startswith("jax"):
            expected = "an array of numbers: jax.numpy.stack makes one array of a list"
            raise JounceError(f"{what} holds numbers that JAX traces; expected {expected}") from error
        raise JounceError(f"{what} is not an array of numbers: {one_line(error)}") from error
    # Booleans, integers and floats become float64, long doubles stay; all else are objects, checked one by one.
    if array.dtype.kind in "biuf":
        return array.astype(np.result_type(array.dtype, np.float64), copy=False)
    if array.dtype.kind != "O":
        kinds = {"c": "complex numbers", "U": "text", "S": "bytes", "M": "dates", "m": "durations"}
        came = kinds.get(array.dtype.kind, f"values of type {array.dtype}")
        raise JounceError(f"{what} holds {came}; expected real numbers or symbols")
    for v in array.flat:
        if not _is_element(v):
            raise JounceError(f"{what} holds {quote_value(v)}; expected real numbers or symbols")
    return array


def array_of_shape(x: Any, shape: tuple[int, ...], what: str, rows: str = "") -> Array:
    """Convert `x` as `asarray` does, and check its last axes.

    `rows` says in an error what they are.
    """
    array = asarray(x, what)
    if array.shape[-len(shape) :] != shape:
        raise JounceError(f"{what} has shape {array.shape}; expected (..., {', '.join(map(str, shape))}){rows}")
    return array


def _is_element(x: Any) -> bool:
    """Return whether an entry is a real number or a symbol.

    The number is in the range of floats.
    """
    if isinstance(x, float | np.floating | np.integer):
        return True
    if isinstance(x, int | Fraction):
        return is_finite(x)
    # A symbol of any library has operators, is no container, and is no number of another kind.
    has_operators = all(hasattr(type(x), f"__{name}__") for name in ("add", "mul", "neg"))
    return has_operators and not hasattr(type(x), "__len__") and not isinstance(x, NOT_REAL)


def is_scalar(x: Any) -> bool:
    """Return whether a value is one scalar, not an array."""
    if getattr(x, "shape", None) is None:
        return _is_element(x)
    # Scalars of CasADi are matrices.
    return x.shape == ((1, 1) if type(x).__module__.startswith("casadi") else ())


def is_finite(x: Any) -> bool:
    """Return whether a value is a real number within floats.

    Bools and symbols are not.
    """
    if isinstance(x, bool) or not isinstance(x, int | float | Fraction | np.floating | np.integer):
        return False
    try:
        return math.isfinite(x)
    except OverflowError:  # integers of 400 digits
        return False


def convert_element(x: Any, what: str) -> Array:
    """Convert a scalar with batch axes only to an array.

    A CasADi scalar, which has two axes, is one scalar.
    """
    if not type(x).__module__.startswith("casadi") or x.shape != (1, 1):
        return asarray(x, what)
    array = np.empty((), dtype=object)
    array[()] = x
    return array


def is_numeric(x: Array) -> bool:
    """Return whether `x` holds numbers that can be checked.

    Symbols and traced values cannot. It is a float array of NumPy then.
    """
    return isinstance(x, np.ndarray) and x.dtype != object


def is_jax(x: Array) -> bool:
    """Return whether `x` is an array or tracer of JAX.

    JAX is not imported for it.
    """
    jax = sys.modules.get("jax")
    return jax is not None and isinstance(x, jax.Array)


def is_traced(x: Any) -> bool:
    """Return whether `x` is traced by JAX, without numbers."""
    return is_jax(x) and isinstance(x, sys.modules["jax"].core.Tracer)


def is_zero(x: Any) -> bool:
    """Return whether a scalar is the number 0, which no symbol is."""
    try:
        return bool(x == 0)
    except Exception:  # CasADi's symbols have no truth value
        return False


def is_symbolic(x: Array) -> bool:
    """Return whether `x` is an object array: symbols, or traced scalars."""
    return isinstance(x, np.ndarray) and x.dtype == object


class Recorder:
    """A scalar that records the operations on it, whose operators never raise: they note what stops them."""

    __slots__ = ()

    def check_recording(self) -> None:
        """Raise what has stopped the recording, if anything has."""
        raise NotImplementedError


def check_recording(x: Array) -> None:
    """Raise what has stopped the recording of an array."""
    if not is_symbolic(x):
        return
    # All recorders of an array share what they record on: one of them knows.
    recorder = next((v for v in x.flat if isinstance(v, Recorder)), None)
    if recorder is not None:
        recorder.check_recording()


def restore_integers(x: np.ndarray) -> np.ndarray:
    """Convert integer-valued floats to ints in an object array.

    Symbolic results show L then, not 1.0*L. Doubles beyond 2^53 stay doubles: products of such ints would raise an
    error only when they are divided.
    """

    def exact(v: Any) -> Any:
        return int(v) if isinstance(v, float) and v.is_integer() and abs(v) < 2**53 else v

    return np.asarray(np.frompyfunc(exact, 1, 1)(x), dtype=object)


def namespace(*arrays: Array) -> Any:
    """Return the module whose functions serve arrays: NumPy, unless one brings its own."""
    for x in arrays:
        if not isinstance(x, np.ndarray) and hasattr(type(x), "__array_namespace__"):
            return x.__array_namespace__()
    return np


def concatenate(arrays: Sequence[Array], axis: int) -> Array:
    """Return arrays joined along `axis`, their leading (batch) axes broadcast."""
    xp, leads = namespace(*arrays), {x.shape[:axis] for x in arrays}
    if len(leads) == 1:
        return xp.concatenate(arrays, axis=axis)
    lead = np.broadcast_shapes(*leads)
    whole = [x if x.shape[:axis] == lead else xp.broadcast_to(x, lead + x.shape[axis:]) for x in arrays]
    return xp.concatenate(whole, axis=axis)


def common_batch_shape(arrays: Sequence[Array], tails: Sequence[int], labels: Sequence[str]) -> tuple[int, ...]:
    """Return the shape to which leading (batch) axes broadcast.

    They are all but the last `tails` axes of each array.
    """
    batches = [x.shape[: x.ndim - tail] for x, tail in zip(arrays, tails, strict=True)]
    try:
        return np.broadcast_shapes(*batches)
    except ValueError:
        shapes = ", ".join(f"{label} {b}" for label, b in zip(labels, batches, strict=True))
        raise JounceError(f"batch axes do not fit together: {shapes}") from None


def broadcast(arrays: Sequence[Array], tails: Sequence[int], labels: Sequence[str]) -> list[Array]:
    """Return arrays with their leading (batch) axes broadcast against each other.

    The last `tails` axes of each array stay.
    """
    batch, xp = common_batch_shape(arrays, tails, labels), namespace(*arrays)
    return [xp.broadcast_to(x, batch + x.shape[x.ndim - tail :]) for x, tail in zip(arrays, tails, strict=True)]


def zeros_like(x: Array) -> Array:
    """Return exact zeros in shape and scalar type of `x`."""
    return namespace(x).zeros_like(x)


def _make_elementwise(name: str) -> Callable[[Array], Array]:
    """Return a function of every element of any scalar type."""

    def scalar(s: Any) -> Any:
        sympy = sys.modules.get("sympy")  # imported already wherever its symbols exist
        if sympy is not None and isinstance(s, sympy.Basic):
            return getattr(sympy, name)(s)
        if isinstance(s, int | float):
            try:
                return getattr(math, name)(s)
            except ValueError:  # of infinity: NaN, as in arrays of floats
                return math.nan
            except OverflowError:
                return math.inf
        if not hasattr(s, name):
            raise JounceError(f"scalars of type {type(s).__name__} have no method {name}(), which is required")
        return getattr(s, name)()

    over_objects = np.frompyfunc(scalar, 1, 1)

    def function(x: Array) -> Array:
        if is_symbolic(x):
            return np.asarray(over_objects(x), dtype=object)
        return getattr(namespace(x), name)(x)

    function.__doc__ = f"{name} of every element, whatever the scalar type."
    return function


sin, cos, tanh, exp, sqrt = map(_make_elementwise, ("sin", "cos", "tanh", "exp", "sqrt"))


def reciprocal(x: Array) -> Array:
    """Return 1 / x of every element, whatever the scalar type.

    Of the number 0 it is infinite, as in IEEE 754.
    """
    if is_symbolic(x):
        return np.asarray(np.frompyfunc(_scalar_reciprocal, 1, 1)(x), dtype=object)
    return 1 / x


def _scalar_reciprocal(s: Any) -> Any:
    if isinstance(s, int | float | Fraction) and s == 0:  # where Python raises an error
        return math.copysign(math.inf, s)
    if isinstance(s, int) and abs(s) == 1:  # exact, as integers among symbols are
        return s
    try:
        return 1 / s
    except TypeError:
        raise JounceError(f"scalars of type {type(s).__name__} have no reciprocal 1 / x, which is required") from None
