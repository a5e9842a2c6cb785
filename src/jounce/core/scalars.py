"""The one file that knows scalar types and their namespaces.

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

from jounce.core.errors import JounceError, one_line, quoted

FLOAT = np.dtype(float)
Array: TypeAlias = Any  # a NumPy array of floats or objects, a JAX array or tracer
NOT_REAL = (complex, Decimal, date, timedelta, np.generic)  # what adds up, but not with floats, or not to a float


def asarray(x: Any, what: str = "an array") -> Array:
    """Convert `x` to an array to calculate with: integers and short floats become float64, symbols stay as they are.

    Missing numbers, masked by NumPy or NA of pandas, become NaN.
    """
    if type(x) is np.ndarray and x.dtype is FLOAT:
        return x  # as most are, and some a thousand times a second
    if not isinstance(x, np.ndarray | np.generic) and hasattr(type(x), "__array_namespace__"):
        return x  # a foreign array that names its own namespace: JAX, also while it traces
    if isinstance(x, Mapping | str):
        raise JounceError(f"{what} is of type {type(x).__name__}; expected an array of numbers")
    if not isinstance(x, np.ndarray) and _is_spatial(x):
        raise JounceError(
            f"{what} is of type {type(x).__name__}, whose array is (linear; angular); expected (angular; linear):"
            " numpy.concatenate([x.angular, x.linear])"
        )
    if type(x).__module__.startswith("casadi"):
        x = _of_casadi(x, what)
    try:
        array = _without_missing(np.asarray(_unmask(x)))
        if array.dtype.kind == "O" and all(isinstance(v, int | float | np.floating | np.integer) for v in array.flat):
            array = array.astype(np.float64)
    except Exception as error:  # ragged lists, integers beyond the floats, and whatever a foreign type raises
        if type(error).__module__.startswith("jax"):
            cure = "jax.numpy.stack makes one array of a list"
            raise JounceError(f"{what} holds numbers that JAX traces; expected an array of numbers: {cure}") from error
        raise JounceError(f"{what} is not an array of numbers: {one_line(error)}") from error
    if array.dtype.kind in "biuf":
        return array.astype(np.result_type(array.dtype, np.float64), copy=False)
    if array.dtype.kind != "O":
        raise JounceError(f"{what} holds {_kind(array)}; expected real numbers or symbols")
    for v in array.flat:
        if not _is_element(v):
            raise JounceError(f"{what} holds {quoted(v)}; expected real numbers or symbols")
    return array


def shaped(x: Any, shape: tuple[int, ...], what: str, rows: str = "") -> Array:
    """Convert `x` as `asarray` does, and check its last axes; `rows` says in an error what they are."""
    array = asarray(x, what)
    if array.shape[-len(shape) :] != shape:
        raise JounceError(f"{what} has shape {array.shape}; expected (..., {', '.join(map(str, shape))}){rows}")
    return array


def _is_spatial(x: Any) -> bool:
    """Whether `x` is a motion or force of Pinocchio, or a list of them: NumPy takes them in their own order."""
    entries = x if type(x) in (list, tuple) or type(x).__name__.startswith("StdVec") else (x,)
    return any(hasattr(type(entry), "angular") and hasattr(type(entry), "linear") for entry in entries)


def _unmask(x: Any) -> Any:
    """`x` with NaN where it is masked, as are the arrays that lists hold."""
    if isinstance(x, np.ma.MaskedArray) and x.dtype.kind in "biufO":
        kind = x.dtype if x.dtype.kind == "O" else np.result_type(x.dtype, np.float64)
        return np.ma.filled(x.astype(kind), np.nan)
    return [_unmask(part) for part in x] if type(x) in (list, tuple) and is_masked(x) else x


def is_masked(x: Any) -> bool:
    """Whether an array has a mask, or one in a list or tuple of them."""
    return isinstance(x, np.ma.MaskedArray) or (type(x) in (list, tuple) and any(map(is_masked, x)))


def _without_missing(array: np.ndarray) -> np.ndarray:
    """An array with NaN in place of NA, if pandas is there to have made any."""
    pandas = sys.modules.get("pandas")
    if pandas is None or array.dtype.kind != "O":
        return array
    return np.asarray(np.frompyfunc(lambda v: np.nan if v is pandas.NA else v, 1, 1)(array), dtype=object)


def _is_element(x: Any) -> bool:
    """Return whether an element of an object array is a real number in the range of floats, or a symbol."""
    if isinstance(x, float | np.floating | np.integer):
        return True
    if isinstance(x, int | Fraction):
        return is_finite(x)
    adds = all(hasattr(type(x), f"__{name}__") for name in ("add", "mul", "neg"))
    return adds and not hasattr(type(x), "__len__") and not isinstance(x, NOT_REAL)


def is_scalar(x: Any) -> bool:
    """Whether a value is one scalar, not an array of any kind; CasADi's scalars have two axes."""
    shape = getattr(x, "shape", None)
    return _is_element(x) if shape is None else shape == ((1, 1) if type(x).__module__.startswith("casadi") else ())


def is_finite(x: Any) -> bool:
    """Return whether a value is a real number that a float can represent; bools and symbols are not."""
    if isinstance(x, bool) or not isinstance(x, int | float | Fraction | np.floating | np.integer):
        return False
    try:
        return math.isfinite(x)
    except OverflowError:  # integers of 400 digits
        return False


def element(x: Any, what: str) -> Array:
    """Return one scalar of an array, with batch axes only; a CasADi scalar, which has two axes, is one scalar."""
    if not type(x).__module__.startswith("casadi") or x.shape != (1, 1):
        return asarray(x, what)
    array = np.empty((), dtype=object)
    array[()] = x
    return array


def _of_casadi(x: Any, what: str) -> np.ndarray:
    """The entries of a CasADi matrix, `SX` or numbers: (n,) of a column or a row, else (m, n)."""
    if type(x).__name__ not in ("SX", "DM"):
        raise JounceError(
            f"{what} is a CasADi {type(x).__name__}; expected SX, or call with it what robot.casadi_function returns"
        )
    array = np.empty(x.shape, dtype=object)
    for index in np.ndindex(*x.shape):
        array[index] = x[index] if type(x).__name__ == "SX" else float(x[index])
    return array.ravel() if 1 in x.shape else array


def _kind(array: np.ndarray) -> str:
    kinds = {"c": "complex numbers", "U": "text", "S": "bytes", "M": "dates", "m": "durations"}
    return kinds.get(array.dtype.kind, f"values of type {array.dtype}")


def is_numeric(x: Array) -> bool:
    """Whether `x` holds numbers that can be checked (a NumPy float array), not symbols or traced values."""
    return isinstance(x, np.ndarray) and x.dtype != object


def is_jax(x: Array) -> bool:
    """Return whether `x` is an array or a tracer of JAX, which is not imported for it."""
    jax = sys.modules.get("jax")
    return jax is not None and isinstance(x, jax.Array)


def is_traced(x: Any) -> bool:
    """Return whether `x` stands for an array while JAX traces a function, and has no numbers."""
    return is_jax(x) and isinstance(x, sys.modules["jax"].core.Tracer)


def is_zero(x: Any) -> bool:
    """Return whether a scalar is the number 0; symbols are never equal to 0, and bool() of them is not taken."""
    try:
        return bool(x == 0)
    except Exception:  # CasADi's symbols have no truth value
        return False


def is_symbolic(x: Array) -> bool:
    """Whether `x` is an object array: symbols, or traced scalars."""
    return isinstance(x, np.ndarray) and x.dtype == object


class Recorder:
    """A scalar that records the operations on it, whose operators never raise: they note what stops them."""

    __slots__ = ()

    def check_recording(self) -> None:
        """Raise what has stopped the recording, if anything has."""
        raise NotImplementedError


def check_recording(x: Array) -> None:
    """Raise what has stopped the recording of scalars in an array, if there are any."""
    if is_symbolic(x) and (recorder := next((v for v in x.flat if isinstance(v, Recorder)), None)) is not None:
        recorder.check_recording()


def exact_integers(x: np.ndarray) -> np.ndarray:
    """Convert integer-valued floats to ints in an object array, so that symbolic results show L, not 1.0*L.

    Doubles beyond 2^53, all of which are integers, stay doubles: products of such ints would not overflow until they
    are divided, and then raise an error.
    """

    def exact(v: Any) -> bool:
        return isinstance(v, float) and v.is_integer() and abs(v) < 2**53

    as_integer = np.frompyfunc(lambda v: int(v) if exact(v) else v, 1, 1)
    return np.asarray(as_integer(x), dtype=object)


def namespace(*arrays: Array) -> Any:
    """The module whose functions serve these arrays: NumPy, unless one of them brings its own."""
    for x in arrays:
        if not isinstance(x, np.ndarray) and hasattr(type(x), "__array_namespace__"):
            return x.__array_namespace__()
    return np


def concatenate(arrays: Sequence[Array], axis: int) -> Array:
    """The arrays joined along `axis`, their leading (batch) axes broadcast against each other."""
    xp, leads = namespace(*arrays), {x.shape[:axis] for x in arrays}
    if len(leads) == 1:
        return xp.concatenate(arrays, axis=axis)
    lead = np.broadcast_shapes(*leads)
    return xp.concatenate([xp.broadcast_to(x, lead + x.shape[axis:]) for x in arrays], axis=axis)


def batch_of(arrays: Sequence[Array], tails: Sequence[int], labels: Sequence[str]) -> tuple[int, ...]:
    """The shape to which the leading (batch) axes broadcast, all but the last `tails` axes of each array."""
    batches = [x.shape[: x.ndim - tail] for x, tail in zip(arrays, tails, strict=True)]
    try:
        return np.broadcast_shapes(*batches)
    except ValueError:
        shapes = ", ".join(f"{label} {b}" for label, b in zip(labels, batches, strict=True))
        raise JounceError(f"batch axes do not fit together: {shapes}") from None


def broadcast(arrays: Sequence[Array], tails: Sequence[int], labels: Sequence[str]) -> list[Array]:
    """The arrays with their leading (batch) axes broadcast against each other; the last `tails` axes stay."""
    batch, xp = batch_of(arrays, tails, labels), namespace(*arrays)
    return [xp.broadcast_to(x, batch + x.shape[x.ndim - tail :]) for x, tail in zip(arrays, tails, strict=True)]


def zeros_like(x: Array) -> Array:
    """Exact zeros in the shape and scalar type of `x` (integers 0 among symbols)."""
    return namespace(x).zeros_like(x)


def _elementwise(name: str) -> Callable[[Array], Array]:
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


sin = _elementwise("sin")
cos = _elementwise("cos")
tanh = _elementwise("tanh")
exp = _elementwise("exp")
sqrt = _elementwise("sqrt")


def reciprocal(x: Array) -> Array:
    """1 / x of every element, whatever the scalar type; of the number 0 it is infinite, as IEEE 754 has it."""
    return np.asarray(_reciprocals(x), dtype=object) if is_symbolic(x) else 1 / x


def _reciprocal(s: Any) -> Any:
    if isinstance(s, int | float | Fraction) and s == 0:  # where Python raises an error
        return math.copysign(math.inf, s)
    if isinstance(s, int) and abs(s) == 1:  # exact, as integers among symbols are
        return s
    try:
        return 1 / s
    except TypeError:
        raise JounceError(f"scalars of type {type(s).__name__} have no reciprocal 1 / x, which is required") from None


_reciprocals = np.frompyfunc(_reciprocal, 1, 1)


def finite(text: str) -> float | None:
    """Parse a finite decimal number, or return None; 1_000 and digits of other scripts are not accepted."""
    if "_" in text or not text.isascii():
        return None
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
