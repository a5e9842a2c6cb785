"""Write the equations of motion of a robot as SymPy expressions: the recursion run on scalars that have a normal form.

`symbolic` is the door of `Robot.symbolic`. A `Symbolic` holds the series of all quantities by symbol, each term
computed on first access and kept (`symbolic_expressions`), on scalars of `trig_polynomial`. Its members, and the
methods of quantities of bodies, follow from the table of quantities when this module is imported. `abbreviate` gives
sines and cosines short names: s_1 of sin(q1), c_12 of cos(q1 + q2).
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from jounce._codegen.symbolic_expressions import expressions
from jounce.arguments import requests
from jounce.arguments.contacts import refuse_contacts
from jounce.arguments.rates import check_order
from jounce.core.errors import JounceError, check_bool, optional_import, quote_value, unknown_name_error
from jounce.dynamics.quantities import QUANTITIES, Quantity
from jounce.dynamics.quantities.row import CLOSED, ON_CONTACTS
from jounce.engine.engine import Engine
from jounce.model.drives import LOAD_FRICTION, OMIT_LOAD_FRICTION
from jounce.model.positions import position_rate_map
from jounce.spatial.series import RATE_SUFFIX, Series, rate_name

EXTERNAL = "ext"  # ends the symbol of what wrenches add to a quantity: Qext
# How many rates of each symbol `Symbolic.dot` differentiates: beyond those of any expression; of a pose, its entries.
RATES_BY_SYMBOL = {"q": 12, "W": 12, "base_twist": 12, "base_pose": 1}
NO_SYMBOLS: Series = Series.constant(np.empty(0))
OF_BODIES = {row.name: row for row in QUANTITIES.values() if row.of_bodies}


def missing_form(row: Quantity) -> str | None:
    """Return why a quantity has no symbolic form, and what has one in its place."""
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
        own = vars(self)  # empty while it is copied or unpickled
        found = re.fullmatch(f"({'|'.join(own['series'])}){RATE_SUFFIX}", name) if "series" in own else None
        if name in QUANTITIES and (reason := missing_form(QUANTITIES[name])):
            raise AttributeError(reason)
        if found is None:
            raise AttributeError(
                str(
                    unknown_name_error(
                        "member", name, [*own.get("series", ()), *OF_BODIES, "abbreviate", "dot"], "Symbolic"
                    )
                )
            )
        symbol, suffix = found.groups()
        return self.series[symbol][int((suffix or "0d")[:-1] or 1)]

    def __dir__(self) -> list[str]:
        rates = [rate_name(symbol, k) for symbol in self.series for k in range(5 if symbol == "q" else 3)]
        return [*rates, *OF_BODIES, "abbreviate", "dot", "name", "series"]

    def abbreviate(self, x: Any) -> tuple[Any, Mapping[Any, Any]]:
        """An expression or matrix with short names of sines and cosines, s_1, c_12, and what the names stand for.

        ``c_12`` is cos(q1 + q2), ``s_{1-2}`` sin(q1 - q2), ``c_22`` cos(2 q2). Of more than nine coordinates, commas
        separate the numbers. Sines and cosines of other angles stay.

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
        """The time derivative of an expression, or matrix of them, in the coordinates, the wrenches and their rates.

        The pose of the base has the rate ``C wedge(V)``, of its twist V.

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
    """The equations of motion of a robot as SymPy expressions, see `Robot.symbolic`."""
    with optional_import("symbolic() needs SymPy", "sympy"):
        import sympy  # noqa: F401
    check_bool("moving_base", moving_base, "whether the ground moves")
    refuse_contacts(robot.mechanism, "their wrenches divide by expressions, which symbolic form does not")
    m = robot.mechanism.tree
    if m.has_load_friction:
        raise JounceError(f"symbolic() of {m.name!r} does not hold {LOAD_FRICTION}; {OMIT_LOAD_FRICTION}")
    found = expressions(m, moving_base or m.floats)
    series = {symbol: found.quantity(row) for symbol, row in OF_ROBOT.items() if not row.obstacle(m)}
    series |= {symbol: found.external(row, symbol) for symbol, row in OF_WRENCHES.items()}
    if m.loops:
        series["gap"] = found.gap()

    @cache
    def of_bodies(name: str, body: str | None, frame: str) -> Series:
        return found.quantity(OF_BODIES[name], body, frame)

    def checked(name: str, body: str | None, frame: str) -> Series:
        requests.check_place(robot.mechanism, name, body, frame)
        return of_bodies(name, body, frame)

    q, qd = (np.array(x.tolist(), dtype=object) for x in found.symbols["q"].upto(1))
    return Symbolic(robot.name, {**found.symbols, **series}, checked, (position_rate_map(m, q[:, 0]) @ qd)[:, 0])


def _method(row: Quantity) -> Callable[..., Any]:
    """The method of `Symbolic` that gives a quantity of bodies."""

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
    """The members of `Symbolic` with their shapes."""
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
    """Return an expression in short names, and what each of them stands for; other angles stay as they are."""
    import sympy

    if not isinstance(x, sympy.Expr | sympy.MatrixBase | sympy.NDimArray):
        raise JounceError(f"abbreviate() expects a SymPy expression, matrix or array, got {quote_value(x)}")
    names = {f: sympy.Symbol(name) for f in x.atoms(sympy.sin, sympy.cos) if (name := _short_name(f, coordinates))}
    taken = sorted(str(name) for name in x.free_symbols.intersection(names.values()))
    if taken:
        raise JounceError(f"abbreviate(): the expression contains the symbol {taken[0]}, a short name; rename it")
    ordered = sorted(names.items(), key=lambda pair: str(pair[1]))
    return x.xreplace(names), {name: f for f, name in ordered}


def _short_name(f: Any, coordinates: Sequence[Any]) -> str | None:
    """The name of a sine or cosine of a sum of coordinates, multiples listed as often: c_112 of cos(2 q1 + q2).

    Braces keep differences apart from what follows: c_{1-2}.
    """
    multiples = f.args[0].as_coefficients_dict()
    if any(symbol not in coordinates or not count.is_Integer for symbol, count in multiples.items()):
        return None
    numbers = [
        f"{'-' if multiples[q] < 0 else ''}{i + 1}"
        for i, q in enumerate(coordinates) if q in multiples for _ in range(abs(multiples[q]))
    ]  # fmt: skip
    below = ("," if len(coordinates) > MAX_DIGITS else "").join(numbers)
    return f"{f.func.__name__[0]}_{f'{{{below}}}' if '-' in below else below}"
