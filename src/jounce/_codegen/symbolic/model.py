"""A mechanism in trigonometric polynomials, and the symbols of its coordinates, of wrenches and of the base."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import isinf
from typing import Any

import numpy as np

from jounce._codegen.symbolic.terms import polynomial
from jounce._codegen.symbolic.trig_polynomial import Variables
from jounce.core.errors import JounceError, locate_errors
from jounce.core.scalars import Array
from jounce.dynamics.state import JointMotion
from jounce.model.drives import Drives
from jounce.model.mechanism import Mechanism, with_arrays
from jounce.model.positions import position_count
from jounce.spatial.series import Series

_NUMBERED_AXES = ((1, "x"), (2, "y"), (3, "z"))


def cast_mechanism(mechanism: Mechanism, variables: Variables) -> Mechanism:
    """The mechanism with fractions and trigonometric polynomials as its data."""

    def cast(array: Array, what: str) -> Array:
        result = np.empty(array.shape, dtype=object)
        for index, x in zip(np.ndindex(*array.shape), array.ravel().tolist(), strict=True):
            with locate_errors(f"{what}{list(index)} of {mechanism.name!r}"):
                rigid = isinstance(x, float) and isinf(x)  # a stiffness, of which only the reciprocal enters
                result[index] = x if rigid else polynomial(x, variables)
        return result

    converted = with_arrays(mechanism, lambda name, array: cast(array, name))
    drives = Drives(**{label: cast(array, label) for label, array in vars(mechanism.drives).items()})
    frames = tuple(replace(frame, T=cast(frame.T, f"pose of {frame.name!r}")) for frame in mechanism.frames)
    elasticity = mechanism.elasticity and mechanism.elasticity.map(lambda array: cast(array, "elastic joints"))
    return replace(converted, drives=drives, frames=frames, elasticity=elasticity)


def has_decimals(array: Array) -> bool:
    """Whether an array holds a float that is not an integer, or an expression with one."""
    import sympy

    def floats(x: Any) -> Any:
        return x.atoms(sympy.Float) if isinstance(x, sympy.Expr) else [x] if isinstance(x, float) else []

    return any(not float(number).is_integer() for x in array.ravel().tolist() for number in floats(x))


def state_symbols(mechanism: Mechanism, base: bool) -> dict[str, Series]:
    """The symbols of the coordinates, matrices (n, 1), and of the wrenches, matrices (nb, 6), by name, with rates.

    Positions are a matrix (nq, 1), longer where joints have several screws. With those of the base, its pose (4, 4),
    whose rates are products of it and of its twist, a matrix (6, 1).
    """
    import sympy

    n, nq, nb = mechanism.n, position_count(mechanism), mechanism.nb
    found = {
        "q": Series(lambda k: sympy.ImmutableMatrix([sympy.Symbol(name) for name in _coordinates(n if k else nq, k)])),
        "W": Series(lambda k: sympy.ImmutableMatrix(nb, 6, [sympy.Symbol(name) for name in _wrenches(nb, k)])),
    }
    if not base:
        return found
    C = np.array([[*(sympy.Symbol(f"R_{i}{j}") for j in (1, 2, 3)), sympy.Symbol(f"r_{x}")] for i, x in _NUMBERED_AXES])
    V = Series(lambda k: np.array([[sympy.Symbol(name)] for name in _twist(k)]))
    motion = JointMotion(np.concatenate([C, np.eye(4, dtype=int)[3:]]), V)
    found["base_pose"] = motion.H.map(lambda H: sympy.ImmutableMatrix(H.tolist()))
    found["base_twist"] = V.map(lambda V: sympy.ImmutableMatrix(V.tolist()))
    return found


def _coordinates(n: int, k: int) -> Iterator[str]:
    return (f"q{_dots(k)}{j + 1}" for j in range(n))


def _wrenches(nb: int, k: int) -> Iterator[str]:
    return (f"{kind}{_dots(k)}_{axis}{i + 1}" for i in range(nb) for kind in "mf" for axis in "xyz")


def _twist(k: int) -> Iterator[str]:
    return (f"{kind}{_dots(k)}_{axis}" for kind in ("omega", "v") for axis in "xyz")


def _dots(k: int) -> str:
    """The part of the name of a k-th rate for which SymPy prints k dots."""
    return "" if k == 0 else "d" * k + "ot" if k <= 4 else f"^({k})_"


def check_names(variables: Variables, symbols: Mapping[str, Series]) -> None:
    """Raise `JounceError` if a symbol of the robot bears the name of a coordinate, wrench or motion of the base."""
    taken = {str(symbol) for series in symbols.values() for k in range(5) for symbol in series[k].free_symbols}
    for symbol in variables.expressions:
        if str(symbol) in taken:
            raise JounceError(
                f"the robot contains the symbol {symbol}, which is the name of a coordinate, wrench or base motion;"
                " rename it"
            )
