"""Write the equations of motion of a robot as SymPy expressions: the recursion run on scalars that have a normal form.

`symbolic` is the door of `Robot.symbolic`. A `Symbolic` holds the series of all quantities by symbol, each term
computed on first access and kept. Its members, and the methods of quantities of bodies, follow from the table of
quantities when this module is imported. `abbreviate` gives sines and cosines short names: s_1 of sin(q1), c_12 of
cos(q1 + q2).

Once a robot, `expressions` converts: the data of the mechanism become fractions and polynomials of `trig_polynomial`
(`cast_mechanism`), and its state becomes symbols of the coordinates, of wrenches and of the base (`state_symbols`). A
quantity is the recursion run on these scalars; each of its rates is converted to SymPy's expressions when it is asked
for, within a limit on work. Friction, which is no polynomial, is computed in SymPy's own functions and added.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from math import isinf
from typing import Any

import numpy as np

from jounce._codegen.trig_polynomial import Printer, TrigPolynomial, Variables, polynomial
from jounce.arguments import contacts, requests
from jounce.arguments.rates import check_order
from jounce.core import errors, scalars
from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import Array
from jounce.dynamics.quantities import QUANTITIES, Quantity
from jounce.dynamics.quantities.row import CLOSED, ON_CONTACTS
from jounce.dynamics.state import JointMotion, Law, State
from jounce.engine.engine import Engine
from jounce.model import drive_trains, positions
from jounce.model.drive_trains import Drives
from jounce.model.frame import Frame
from jounce.model.loops import Loop
from jounce.model.mechanism import Mechanism, with_arrays, with_exact_integers
from jounce.spatial import lie
from jounce.spatial.series import RATE_SUFFIX, Series, join_series, rate_name

EXTERNAL = "ext"  # ends the symbol of what wrenches add to a quantity: Qext
# How many rates of each symbol `Symbolic.dot` differentiates: beyond those of any expression; of a pose, its entries.
RATES_BY_SYMBOL = {"q": 12, "W": 12, "base_twist": 12, "base_pose": 1}
NO_SYMBOLS: Series = Series.constant(np.empty(0))
OF_BODIES = {row.name: row for row in QUANTITIES.values() if row.of_bodies}


def missing_form(row: Quantity) -> str | None:
    """Return why a quantity has no symbolic form, or None."""
    if row.inverts:
        return (
            f"{row.name} has no symbolic form, as it divides by expressions; mass_matrix and inverse_dynamics have one:"
            " solve M q2d = Q - (Q where q2d = 0)"
        )
    if row.gives.results:
        return f"{row.name} has no symbolic form; expected derivatives of another quantity by SymPy, as S.Q.diff(...)"
    return None


OF_ROBOT = {
    row.gives.symbol: row
    for row in QUANTITIES.values()
    if not (row.of_bodies or CLOSED in row.needs or ON_CONTACTS in row.needs or missing_form(row))
}
OF_WRENCHES = {row.gives.symbol + EXTERNAL: row for row in OF_ROBOT.values() if row.takes.wrenches and row.everywhere}
MAX_DIGITS = 9  # coordinates that one digit numbers; the numbers of more are separated by commas


@dataclass(frozen=True, eq=False, repr=False)
class Symbolic:
    """The equations of motion of a robot as SymPy expressions; `Robot.symbolic` makes it.

    * ``S.q, S.qd, S.q2d, ...`` are the symbols q1, qdot1, qddot1, ... of the coordinates, in the order of
      `joint_names`, as columns, q of the numbers of joints of several screws; ``S.W, S.Wd, ...``, (nb, 6), are those
      of the wrenches that the bodies exert: m_x1 .. f_z1, mdot_x1, ...
    * ``S.base_pose``, (4, 4), is the pose [R, r; 0, 1] of the base, where it moves, of the symbols R_11, ..., r_z, and
      ``S.base_twist, S.base_twistd, ...`` its twist in its own axes, omega_x, ..., v_z, omegadot_x, ...
    * Each quantity that belongs to no body is an attribute named after its symbol, ``S.Q``, ``S.M``, ``S.U``, and so
      are its rates, ``S.Qd``, ``S.Q2d``, ``S.Q3d``, ...: a matrix, a column of a vector, or an expression.
    * These are the quantities without wrenches; the part of wrenches has ``ext`` in its name: Q is ``S.Q + S.Qext``.
    * ``S.theta`` and ``S.tau`` are members only of robots with elastic joints, ``S.i`` and ``S.u`` where motors state
      their electrical data.
    * Of robots with closed loops all coordinates of the tree are symbols, with the constraint ``S.gap = 0``: a column
      of turns and slides that cut joints do not allow. With ``A = S.gap.jacobian(S.q)`` and multipliers y, the forces
      of the motors are ``S.Q - A.T * y``.
    * Each quantity of bodies is a method: ``J, Jd = S.jacobian("tool0", frame="world", order=1)``.
    * A quantity that is too large for symbolic form raises `JounceError` on access.
    """

    name: str
    series: Mapping[str, Series]  # by symbol
    of_bodies: Callable[[str, str | None, str], Series]  # by name of the quantity, body and frame
    moved: Any  # the rates of q, which are the velocities where no joint has several screws

    def __repr__(self) -> str:
        return f"<Symbolic {self.name!r}: {', '.join(self.series)}, and their rates; of bodies: {', '.join(OF_BODIES)}>"

    def _repr_markdown_(self) -> str:
        members = [(row.gives.symbol, row.printed) for row in OF_ROBOT.values()]
        members += [(f"{row.name}(body)", row.printed) for row in OF_BODIES.values()]
        rows = [f"| `S.{member}` | {printed.caption} | ${printed.tex}$ |" for member, printed in members]
        return "\n".join(["| expression | quantity | formula |", "| --- | --- | --- |", *rows])

    def __getattr__(self, name: str) -> Any:
        # Fields are missing while the object is copied or unpickled.
        all_series = vars(self).get("series", {})
        reason = missing_form(QUANTITIES[name]) if name in QUANTITIES else None
        if reason is not None:
            raise AttributeError(reason)
        # A member is the symbol of a quantity with the suffix of a rate: "" of the values, d, 2d, 3d, ...
        match = re.fullmatch(f"({'|'.join(all_series)}){RATE_SUFFIX}", name) if len(all_series) > 0 else None
        if match is None:
            members = [*all_series, *OF_BODIES, "abbreviate", "dot"]
            raise AttributeError(str(errors.unknown_name_error("member", name, members, "Symbolic")))
        symbol, suffix = match.groups()
        if suffix is None:
            return self.series[symbol][0]
        return self.series[symbol][1 if suffix == "d" else int(suffix[:-1])]

    def __dir__(self) -> list[str]:
        rates = [rate_name(symbol, k) for symbol in self.series for k in range(5 if symbol == "q" else 3)]
        return [*rates, *OF_BODIES, "abbreviate", "dot", "name", "series"]

    def abbreviate(self, x: Any) -> tuple[Any, Mapping[Any, Any]]:
        """Return an expression or matrix in short names of sines and cosines, s_1, c_12.

        With it comes a mapping of what the names stand for. ``c_12`` is cos(q1 + q2), ``s_{1-2}`` sin(q1 - q2),
        ``c_22`` cos(2 q2). Of more than nine coordinates, commas separate the numbers. Sines and cosines of other
        angles stay.

        Examples
        --------
        >>> import jounce
        >>> S = jounce.load("planar2r").symbolic()
        >>> short, names = S.abbreviate(S.Qgrav)
        >>> short[1], names
        (9.81*c_12, {c_1: cos(q1), c_12: cos(q1 + q2)})
        >>> short.subs(names) == S.Qgrav
        True
        """
        return abbreviate(x, list(self.series["q"][0]))

    def dot(self, x: Any) -> Any:
        """Return the time derivative of an expression or matrix.

        It is by the chain rule in the coordinates, the wrenches and their rates. The pose of the base has the rate ``C
        wedge(V)``, of its twist V.

        Examples
        --------
        >>> import jounce
        >>> S = jounce.load("planar2r").symbolic()
        >>> (S.dot(S.Q) - S.Qd).expand()
        Matrix([
        [0],
        [0]])
        """
        import sympy

        if not isinstance(x, sympy.Expr | sympy.MatrixBase | sympy.NDimArray | int | float):
            raise JounceError(f"dot() expects a SymPy expression, matrix or array, got {quote_value(x)}")
        total, present = 0 * x, getattr(x, "free_symbols", ())
        for name, count in RATES_BY_SYMBOL.items():
            moving = self.series.get(name, NO_SYMBOLS)
            for k in range(count):
                rates = moving[k + 1] if k or name != "q" else self.moved
                for symbol, rate in zip(moving[k], rates, strict=True):
                    if symbol in present:
                        total = total + sympy.diff(x, symbol) * rate
        return total


def symbolic(robot: Engine, moving_base: bool) -> Symbolic:
    """Return the equations of motion as SymPy expressions.

    See `Robot.symbolic`.
    """
    with errors.optional_import("symbolic() needs SymPy", "sympy"):
        import sympy  # noqa: F401
    errors.check_bool("moving_base", moving_base, "whether the ground moves")
    contacts.refuse_contacts(robot.mechanism, "their wrenches divide by expressions, which symbolic form does not")
    m = robot.mechanism.tree
    if m.has_load_friction:
        raise JounceError(
            f"symbolic() of {m.name!r} does not hold {drive_trains.LOAD_FRICTION}; {drive_trains.OMIT_LOAD_FRICTION}"
        )
    # Series are made here, but no term of them is computed yet.
    sources = expressions(m, moving_base or m.floats)
    series = {symbol: sources.quantity(row) for symbol, row in OF_ROBOT.items() if not row.obstacle(m)}
    series |= {symbol: sources.external(row, symbol) for symbol, row in OF_WRENCHES.items()}
    if len(m.loops) > 0:
        series["gap"] = sources.gap()

    @cache
    def series_of_bodies(name: str, body: str | None, frame: str) -> Series:
        return sources.quantity(OF_BODIES[name], body, frame)

    def check_and_find(name: str, body: str | None, frame: str) -> Series:
        requests.check_place(robot.mechanism, name, body, frame)
        return series_of_bodies(name, body, frame)

    # The rates of q by its velocities: those of a quaternion are half its product with a twist.
    q, qd = (np.array(x.tolist(), dtype=object) for x in sources.symbols["q"].upto(1))
    rates_of_q = (positions.rate_map(m, q[:, 0]) @ qd)[:, 0]
    return Symbolic(robot.name, {**sources.symbols, **series}, check_and_find, rates_of_q)


def _method(row: Quantity) -> Callable[..., Any]:
    """Return the method of `Symbolic` that gives a quantity of bodies."""

    def method(self: Symbolic, body: str | None = None, *, frame: str = "body", order: int = 0) -> Any:
        terms = self.of_bodies(row.name, body, frame).upto(check_order(order))
        return terms if order else terms[0]

    method.__name__, method.__qualname__ = row.name, f"{Symbolic.__name__}.{row.name}"
    method.__doc__ = f"""{row.printed.meaning}

        Parameters
        ----------
        body : str, optional
            A body or a link merged into one; all bodies by default, along the first axis of an array.
        frame : str, optional
            {_frames(row)}
        order : int, optional
            The highest rate, 0 by default.

        Returns
        -------
        Matrix, or tuple of them: {row.gives.symbol}, {row.gives.symbol}d, ... up to the order
        """
    return method


def _frames(row: Quantity) -> str:
    frames = row.gives.frames
    return f"The frame of the components: {', '.join(map(repr, frames))}." if frames else 'Always "body".'


def _table() -> str:
    """Return the members of `Symbolic` as lines of its docstring."""
    members = {f"{symbol}, {symbol}d, ...": (row, row.printed.caption) for symbol, row in OF_ROBOT.items()}
    members |= {
        f"{symbol}, ...": (row, f"part of the wrenches in {row.gives.symbol}") for symbol, row in OF_WRENCHES.items()
    }
    members |= {f"{name}(body)": (row, row.printed.caption) for name, row in OF_BODIES.items()}
    lines = (f"    {member:20} {_shape(row):8} {caption}" for member, (row, caption) in members.items())
    return "\n".join(lines)


def _shape(row: Quantity) -> str:
    axes = [str(row.takes.rates if axis == "rates" else axis) for axis in row.gives.shape if axis != "nb"]
    return " x ".join(axes if len(axes) > 1 else [*axes, "1"])


for _row in OF_BODIES.values():
    setattr(Symbolic, _row.name, _method(_row))


Symbolic.__doc__ = f"{Symbolic.__doc__ or ''}\n{_table()}\n"  # help() lists what the table of quantities holds


def abbreviate(x: Any, coordinates: Sequence[Any]) -> tuple[Any, Mapping[Any, Any]]:
    """Return an expression in short names, and the meaning of each name."""
    import sympy

    if not isinstance(x, sympy.Expr | sympy.MatrixBase | sympy.NDimArray):
        raise JounceError(f"abbreviate() expects a SymPy expression, matrix or array, got {quote_value(x)}")
    names = {}
    for f in x.atoms(sympy.sin, sympy.cos):
        name = _short_name(f, coordinates)
        if name is not None:
            names[f] = sympy.Symbol(name)
    ambiguous = sorted(str(name) for name in x.free_symbols.intersection(names.values()))
    if len(ambiguous) > 0:
        raise JounceError(f"abbreviate(): the expression contains the symbol {ambiguous[0]}, a short name; rename it")
    ordered = sorted(names.items(), key=lambda pair: str(pair[1]))
    return x.xreplace(names), {name: f for f, name in ordered}


def _short_name(f: Any, coordinates: Sequence[Any]) -> str | None:
    """Return the short name of a sine or cosine.

    It is None unless the angle is a sum of coordinates. Multiples are listed as often: c_112 of cos(2 q1 + q2). Braces
    keep differences apart from what follows: c_{1-2}.
    """
    multiples = f.args[0].as_coefficients_dict()
    if any(symbol not in coordinates or not count.is_Integer for symbol, count in multiples.items()):
        return None
    numbers: list[str] = []
    for i, q in enumerate(coordinates):
        if q in multiples:
            sign = "-" if multiples[q] < 0 else ""
            numbers += [f"{sign}{i + 1}"] * abs(int(multiples[q]))
    below = ("," if len(coordinates) > MAX_DIGITS else "").join(numbers)
    return f"{f.func.__name__[0]}_{f'{{{below}}}' if '-' in below else below}"


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
        """Return a quantity without wrenches, of one body or of all."""
        # The polynomials hold all but friction, which SymPy's own functions add.
        moving = self._base() if requests.takes_base(row.name, frame) else None
        state = State(self._column("q"), base=moving, body=body, frame=frame)
        series = self._printed(row.gives.symbol, lambda: _law(row, self.model)(self.model, state), body)
        if FRICTION_TERMS.intersection(self.mechanism.acting, row.drives.terms):
            of_drives = self._spring_law(row) if row.drives.law is None else row.drives.law
            series = series + self._friction(of_drives)
        return series

    def external(self, row: Quantity, symbol: str) -> Series:
        """Return the part of wrenches in a quantity: the quantity without masses and drives."""
        massless = replace(self.model, acting=(), M=scalars.zeros_like(self.model.M))
        state = State(self._column("q"), self._column("W"), base=self._base())
        return self._printed(symbol, lambda: _law(row, massless)(massless, state))

    def gap(self) -> Series:
        """Return the gap of the loops, a column.

        It is zero where they are closed. It holds the sines of turns, and the slides, that cut joints do not allow.
        Rows that are zero everywhere are left out, such as those of turns out of a plane.
        """
        law = cache(lambda: join_series([self._loop_gap(loop) for loop in self.mechanism.loops], axis=-2))

        def rows() -> Series:
            kept = [i for i, x in enumerate(law()[0][:, 0]) if x != 0]
            return law().map(lambda x: x[kept])

        return self._printed("gap", rows)

    def _loop_gap(self, loop: Loop) -> Series:
        """Return the gap of one loop in polynomials: turns (k, 1) above slides (l, 1)."""
        H = _law(QUANTITIES["poses"], self.model)(self.model, State(self._column("q")))

        def end(frame: Frame) -> Series:
            T = np.vectorize(lambda x: polynomial(x, self.variables), otypes=[object])(frame.T)
            return H.map(lambda H: H[frame.body] @ T) if frame.body >= 0 else Series.constant(T)

        # The relative rotation R and offset r of both frames, in the axes of frame a. Where no turn is allowed, the
        # skew part of R is 0; where turns about e are, e and R e are parallel.
        a, b, (turns, slides), e = end(loop.a), end(loop.b), loop.held, np.asarray(loop.axis)[:, None]
        to_axes_of_a = a.map(lie.rotation).mT
        R, r = to_axes_of_a @ b.map(lie.rotation), to_axes_of_a @ (b - a).map(lie.position)
        sines = R.map(lambda R: lie.axial(R)[:, None] if len(turns) == 3 else lie.hat(e[:, 0]) @ (R @ e))
        return join_series([sines.map(lambda x: turns @ x), r.map(lambda x: slides @ x)], axis=-2)

    def _column(self, name: str) -> Series:
        """Return the symbols of q or W as a column of variables."""
        variable = self.variables.variable
        return self.symbols[name].map(lambda x: np.array([[variable(symbol)] for symbol in x], dtype=object))

    def _base(self) -> JointMotion | None:
        """Return the motion of the base in variables, or None."""
        if "base_pose" not in self.symbols:
            return None
        C = self.symbols["base_pose"][0][:3, :].tolist()
        rows = np.array([[self.variables.variable(x) for x in row] for row in C], dtype=object)
        return JointMotion(lie.pose(rows[:, :3], rows[:, 3:]), self._column("base_twist"))

    def _printed(self, symbol: str, law: Callable[[], Series], body: str | None = None) -> Series:
        """Return the SymPy form of a series of polynomials.

        Each term keeps within the limit on work.
        """
        law, printer = cache(law), self._printer(body)
        place = self.mechanism.name if body is None else f"{body} of {self.mechanism.name}"

        def term(k: int) -> Any:
            self.variables.work = 0
            with errors.locate_errors(f"{rate_name(symbol, k)} of {place!r}"):
                try:
                    values = np.asarray(law()[k], dtype=object)
                    # Conversion to SymPy counts as work, too, before it begins.
                    terms = sum(len(x.terms) for x in values.flat if isinstance(x, TrigPolynomial))
                    self.variables.spend(OPERATIONS_PER_PRINTED_TERM * terms)
                    self.variables.check()
                except JounceError:
                    law.cache_clear()  # it may hold results beyond the limit
                    raise
            return _sympy([printer.expression(x) for x in values.flat], values.shape)

        return Series(term)

    def _printer(self, body: str | None) -> Printer:
        """Return the printer of a quantity: numbers are decimals where any that enter it are."""
        m = self.mechanism
        data = [*m.arrays.values()]
        if body is not None:
            data.append(m.frame(body).T)
        if len(m.acting) > 0:
            data += [m.drives.armature, m.drives.damping, m.drives.stiffness, m.drives.rest, m.drives.offset]
        e = m.elasticity
        if e is not None:
            data += [e.stiffness[~e.is_rigid], e.rotor, e.viscous]
        coordinates = frozenset(self.symbols["q"][0])
        return Printer(self.variables, self.parameters, coordinates, any(map(has_decimals, data)))

    def _spring_law(self, row: Quantity) -> Law:
        """Return the part of forces of drives in a quantity of motors.

        Springs are linear, so that this part is the difference of a massless robot with and without its drives.
        """

        def law(mechanism: Mechanism, state: State) -> Series:
            massless = replace(mechanism, M=scalars.zeros_like(mechanism.M))
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
    """Return the sources of the expressions of a mechanism.

    With `base`, its base moves as symbols say. Raises `JounceError` if the mechanism holds what is neither a number nor
    a real SymPy expression, or a symbol that is named as a coordinate, wrench or motion of the base.
    """
    variables, symbols = Variables(MAX_SYMBOLIC_OPERATIONS), state_symbols(mechanism, base)
    model = cast_mechanism(mechanism, variables)
    variables.check()
    check_names(variables, symbols)
    model = replace(model, acting=tuple(term for term in model.acting if term not in FRICTION_TERMS))
    return Expressions(mechanism, model, symbols, variables, len(variables.expressions))


def _law(row: Quantity, model: Mechanism) -> Law:
    """Return the recursion, or the closed form.

    The latter serves where a joint has a direction of symbols. The recursion puts a frame on the axis of each joint.
    """
    return row.law("recursion" if all(map(_has_direction, model.X)) else "closed_form", model)


def _has_direction(X: Array) -> bool:
    """Return whether the direction of a joint is made of numbers."""
    turns = any(x != 0 for x in X[:3])
    direction = X[:3] if turns else X[3:]
    return all(isinstance(x, Fraction) for x in direction)


def _sympy(entries: list[Any], shape: tuple[int, ...]) -> Any:
    """Return expressions as one expression, matrix or array."""
    import sympy

    if not shape:
        return entries[0]
    if len(shape) > 2:
        return sympy.ImmutableDenseNDimArray(entries, shape)
    return sympy.ImmutableMatrix(shape[0], len(entries) // shape[0], entries)


def cast_mechanism(mechanism: Mechanism, variables: Variables) -> Mechanism:
    """Return the mechanism with fractions and trigonometric polynomials as its data."""

    def cast(array: Array, what: str) -> Array:
        result = np.empty(array.shape, dtype=object)
        for index, x in zip(np.ndindex(*array.shape), array.ravel().tolist(), strict=True):
            with errors.locate_errors(f"{what}{list(index)} of {mechanism.name!r}"):
                # An infinite stiffness stays: only its reciprocal enters.
                is_rigid = isinstance(x, float) and isinf(x)
                result[index] = x if is_rigid else polynomial(x, variables)
        return result

    converted = with_arrays(mechanism, lambda name, array: cast(array, name))
    drives = Drives(**{label: cast(array, label) for label, array in vars(mechanism.drives).items()})
    frames = tuple(replace(frame, T=cast(frame.T, f"pose of {frame.name!r}")) for frame in mechanism.frames)
    elasticity = mechanism.elasticity and mechanism.elasticity.map(lambda array: cast(array, "elastic joints"))
    return replace(converted, drives=drives, frames=frames, elasticity=elasticity)


def has_decimals(array: Array) -> bool:
    """Return whether an array holds decimals.

    They are floats that are no integers, or expressions with them.
    """
    import sympy

    def floats(x: Any) -> Any:
        if isinstance(x, sympy.Expr):
            return x.atoms(sympy.Float)
        return [x] if isinstance(x, float) else []

    return any(not float(number).is_integer() for x in array.ravel().tolist() for number in floats(x))


def state_symbols(mechanism: Mechanism, base: bool) -> dict[str, Series]:
    """Return the symbols of the state by name, with their rates.

    Coordinates are matrices (n, 1), wrenches (nb, 6). Positions are a matrix (nq, 1), longer where joints have several
    screws. With those of the base, its pose (4, 4), whose rates are products of it and of its twist, a matrix (6, 1).
    """
    import sympy

    n, nq, nb = mechanism.n, positions.count(mechanism), mechanism.nb
    symbols = {
        "q": Series(lambda k: sympy.ImmutableMatrix([sympy.Symbol(name) for name in _coordinates(n if k else nq, k)])),
        "W": Series(lambda k: sympy.ImmutableMatrix(nb, 6, [sympy.Symbol(name) for name in _wrenches(nb, k)])),
    }
    if not base:
        return symbols
    C = np.array([[*(sympy.Symbol(f"R_{i}{j}") for j in (1, 2, 3)), sympy.Symbol(f"r_{x}")] for i, x in _NUMBERED_AXES])
    V = Series(lambda k: np.array([[sympy.Symbol(name)] for name in _twist(k)]))
    motion = JointMotion(np.concatenate([C, np.eye(4, dtype=int)[3:]]), V)
    symbols["base_pose"] = motion.H.map(lambda H: sympy.ImmutableMatrix(H.tolist()))
    symbols["base_twist"] = V.map(lambda V: sympy.ImmutableMatrix(V.tolist()))
    return symbols


def _coordinates(n: int, k: int) -> Iterator[str]:
    return (f"q{_dots(k)}{j + 1}" for j in range(n))


def _wrenches(nb: int, k: int) -> Iterator[str]:
    return (f"{kind}{_dots(k)}_{axis}{i + 1}" for i in range(nb) for kind in "mf" for axis in "xyz")


def _twist(k: int) -> Iterator[str]:
    return (f"{kind}{_dots(k)}_{axis}" for kind in ("omega", "v") for axis in "xyz")


def _dots(k: int) -> str:
    """Return the letters for which SymPy prints k dots."""
    if k == 0:
        return ""
    return "d" * k + "ot" if k <= 4 else f"^({k})_"


def check_names(variables: Variables, symbols: Mapping[str, Series]) -> None:
    """Raise `JounceError` for a symbol named like the state."""
    state_names: set[str] = set()
    for series in symbols.values():
        state_names.update(str(symbol) for matrix in series.upto(4) for symbol in matrix.free_symbols)
    for symbol in variables.expressions:
        if str(symbol) in state_names:
            raise JounceError(
                f"the robot contains the symbol {symbol}, which is the name of a coordinate, wrench or base motion;"
                " rename it"
            )
