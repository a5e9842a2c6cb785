"""Compute quantities of the table as series of SymPy expressions, on trigonometric polynomials.

`expressions` is the door, once a robot: the data of the mechanism become fractions and polynomials (`cast_mechanism`),
and its state becomes symbols of the coordinates, of wrenches and of the base (`state_symbols`). A quantity is the
recursion run on these scalars; each of its rates is converted to SymPy's expressions when it is asked for, within a
limit on work. Friction, which is no polynomial, is computed in SymPy's own functions and added.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from math import isinf
from typing import Any

import numpy as np

from jounce._codegen.trig_polynomial import Printer, TrigPolynomial, Variables, polynomial
from jounce.arguments import requests
from jounce.core.errors import JounceError, locate_errors
from jounce.core.scalars import Array, zeros_like
from jounce.dynamics.quantities import QUANTITIES, Quantity
from jounce.dynamics.state import JointMotion, Law, State
from jounce.model.drives import Drives
from jounce.model.frame import Frame
from jounce.model.loops import Loop
from jounce.model.mechanism import Mechanism, with_arrays, with_exact_integers
from jounce.model.positions import position_count
from jounce.spatial.lie import axial, hat, pose, position, rotation
from jounce.spatial.series import Series, join_series, rate_name

MAX_SYMBOLIC_OPERATIONS = 1_000_000  # on terms, for one matrix: some seconds, some ten thousand terms
OPERATIONS_PER_PRINTED_TERM = 50  # which take as long as the conversion of one term to SymPy
FRICTION_TERMS = {"friction", "stribeck"}  # terms of the drives that are no trigonometric polynomials
_NUMBERED_AXES = ((1, "x"), (2, "y"), (3, "z"))


@dataclass(frozen=True, eq=False)
class Expressions:
    """The sources of expressions: a mechanism, the same in polynomials, and the symbols of its state."""

    mechanism: Mechanism
    model: Mechanism
    symbols: Mapping[str, Series]  # q and W, and of a base that moves base_pose and base_twist, of SymPy matrices
    variables: Variables
    parameters: int  # the number of variables that the model holds

    def quantity(self, row: Quantity, body: str | None = None, frame: str = "body") -> Series:
        """A quantity without wrenches, of one body or of all."""
        moving = self._base() if requests.takes_base(row.name, frame) else None
        state = State(self._column("q"), base=moving, body=body, frame=frame)
        series = self._printed(row.gives.symbol, lambda: _law(row, self.model)(self.model, state), body)
        if FRICTION_TERMS.intersection(self.mechanism.acting, row.drives.terms):
            of_drives = self._spring_law(row) if row.drives.law is None else row.drives.law
            series = series + self._friction(of_drives)
        return series

    def external(self, row: Quantity, symbol: str) -> Series:
        """Return the part of wrenches in a quantity: the quantity without masses and drives."""
        massless = replace(self.model, acting=(), M=zeros_like(self.model.M))
        state = State(self._column("q"), self._column("W"), base=self._base())
        return self._printed(symbol, lambda: _law(row, massless)(massless, state))

    def gap(self) -> Series:
        """How far the loops are from closed: sines of the turns, and slides, that cut joints do not allow, a column.

        Rows that are zero everywhere are left out, such as those of turns out of a plane.
        """
        law = cache(lambda: join_series([self._loop_gap(loop) for loop in self.mechanism.loops], axis=-2))

        def rows() -> Series:
            kept = [i for i, x in enumerate(law()[0][:, 0]) if x != 0]
            return law().map(lambda x: x[kept])

        return self._printed("gap", rows)

    def _loop_gap(self, loop: Loop) -> Series:
        H = _law(QUANTITIES["poses"], self.model)(self.model, State(self._column("q")))

        def end(frame: Frame) -> Series:
            T = np.vectorize(lambda x: polynomial(x, self.variables), otypes=[object])(frame.T)
            return H.map(lambda H: H[frame.body] @ T) if frame.body >= 0 else Series.constant(T)

        a, b, (turns, slides), e = end(loop.a), end(loop.b), loop.held, np.asarray(loop.axis)[:, None]
        back = a.map(rotation).mT  # to the axes of frame a
        R, r = back @ b.map(rotation), back @ (b - a).map(position)
        sines = R.map(lambda R: axial(R)[:, None] if len(turns) == 3 else hat(e[:, 0]) @ (R @ e))
        return join_series([sines.map(lambda x: turns @ x), r.map(lambda x: slides @ x)], axis=-2)

    def _column(self, name: str) -> Series:
        """The symbols of q or W as a column of variables."""
        variable = self.variables.variable
        return self.symbols[name].map(lambda x: np.array([[variable(symbol)] for symbol in x], dtype=object))

    def _base(self) -> JointMotion | None:
        """The motion of the base in variables, where it has symbols."""
        if "base_pose" not in self.symbols:
            return None
        C = self.symbols["base_pose"][0][:3, :].tolist()
        above = np.array([[self.variables.variable(x) for x in row] for row in C], dtype=object)
        return JointMotion(pose(above[:, :3], above[:, 3:]), self._column("base_twist"))

    def _printed(self, symbol: str, law: Callable[[], Series], body: str | None = None) -> Series:
        """The SymPy form of a series of polynomials, each term within the limit on work."""
        law, printer = cache(law), self._printer(body)
        place = self.mechanism.name if body is None else f"{body} of {self.mechanism.name}"

        def term(k: int) -> Any:
            self.variables.work = 0
            with locate_errors(f"{rate_name(symbol, k)} of {place!r}"):
                try:
                    values = np.asarray(law()[k], dtype=object)
                    terms = sum(len(x.terms) for x in values.flat if isinstance(x, TrigPolynomial))
                    self.variables.spend(OPERATIONS_PER_PRINTED_TERM * terms)
                    self.variables.check()
                except JounceError:
                    law.cache_clear()  # it may hold results beyond the limit
                    raise
            return _sympy([printer.expression(x) for x in values.flat], values.shape)

        return Series(term)

    def _printer(self, body: str | None) -> Printer:
        """The printer of a quantity: numbers are decimals where any that enter it are."""
        m = self.mechanism
        data = [*m.arrays.values()] + [m.frame(body).T for body in [body] if body is not None]
        if m.acting:
            data += [m.drives.armature, m.drives.damping, m.drives.stiffness, m.drives.rest, m.drives.offset]
        if (e := m.elasticity) is not None:
            data += [e.stiffness[~e.is_rigid], e.rotor, e.viscous]
        coordinates = frozenset(self.symbols["q"][0])
        return Printer(self.variables, self.parameters, coordinates, any(map(has_decimals, data)))

    def _spring_law(self, row: Quantity) -> Law:
        """Return the part of forces of drives in a quantity of motors, whose springs are linear in them."""

        def law(mechanism: Mechanism, state: State) -> Series:
            massless = replace(mechanism, M=zeros_like(mechanism.M))
            driven, free = (_law(row, m)(m, state) for m in (massless, replace(massless, acting=())))
            return driven - free

        return law

    def _friction(self, law: Law) -> Series:
        """Return the part of Coulomb and Stribeck friction, in SymPy functions."""
        acting = tuple(term for term in self.mechanism.acting if term in FRICTION_TERMS)
        mechanism = replace(with_exact_integers(self.mechanism), acting=acting)
        q = self.symbols["q"].map(lambda x: np.array(x.tolist(), dtype=object))
        return law(mechanism, State(q)).map(lambda x: _sympy(list(x.flat), x.shape))


def expressions(mechanism: Mechanism, base: bool) -> Expressions:
    """Return the sources of the expressions of a mechanism, with the motion of its base or without.

    Raises `JounceError` if the mechanism holds what is neither a number nor a real SymPy expression, or a symbol that
    is named as a coordinate, wrench or motion of the base.
    """
    variables, symbols = Variables(MAX_SYMBOLIC_OPERATIONS), state_symbols(mechanism, base)
    model = cast_mechanism(mechanism, variables)
    variables.check()
    check_names(variables, symbols)
    model = replace(model, acting=tuple(term for term in model.acting if term not in FRICTION_TERMS))
    return Expressions(mechanism, model, symbols, variables, len(variables.expressions))


def _law(row: Quantity, model: Mechanism) -> Law:
    """The recursion, or the closed form where a joint has no direction in numbers to put a frame on."""
    return row.law("recursion" if all(map(_has_direction, model.X)) else "closed_form", model)


def _has_direction(X: Array) -> bool:
    """Whether the direction of a joint is made of numbers."""
    return all(isinstance(x, Fraction) for x in (X[:3] if any(x != 0 for x in X[:3]) else X[3:]))


def _sympy(entries: list[Any], shape: tuple[int, ...]) -> Any:
    """Expressions as one, as a matrix, a column of a vector, or as an array of more axes."""
    import sympy

    if not shape:
        return entries[0]
    if len(shape) > 2:
        return sympy.ImmutableDenseNDimArray(entries, shape)
    return sympy.ImmutableMatrix(shape[0], len(entries) // shape[0], entries)


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
