"""The equations of motion of a robot as SymPy matrices, each made when it is asked for, and kept."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

from jounce._scalars import Array
from jounce._symbolic.terms import Print, waves
from jounce._symbolic.trig_polynomial import Alphabet, Waves
from jounce.dynamics import drive_terms
from jounce.dynamics.closed_form import closed_form
from jounce.dynamics.quantities import QUANTITIES, State
from jounce.dynamics.recursion.forces import external_forces
from jounce.errors import JounceError, at, no_such, quoted
from jounce.model.mechanism import DATA, Mechanism, in_whole_numbers
from jounce.robot import Robot
from jounce.spatial.series import SUFFIX, Series, rate_name

WORK = 1_000_000  # operations on terms, up to which one matrix is worked out: some seconds, some ten thousand terms
PRINTED = 50  # operations that take as long as to print one term
FRICTION = "friction"
NAMES = ("inverse_dynamics", "mass_matrix", "coriolis_matrix", "skew_coriolis_matrix", "gravity_forces")
NAMED = 12  # rates of the coordinates that `Symbolic.dot` knows


@dataclass(frozen=True, eq=False, repr=False)
class Symbolic:
    """The equations of motion of a robot as SymPy matrices; `jounce.symbolic` makes it.

    ============ ========= ===================================================================================
    attribute    shape     matrix
    ============ ========= ===================================================================================
    q .. q4d     n x 1     symbols q1, qdot1, qddot1, ... of the coordinates, in the order of `joint_names`
    W, Wd, W2d   nb x 6    symbols m_x1 .. f_z1, mdot_x1, ... of the wrenches that the bodies exert
    Q, Qd, Q2d   n x 1     generalized forces without wrenches, M q2d + C qd + Qgrav, and the drives that act
    M, Md, M2d   n x n     mass matrix
    C, Cd, C2d   n x n     Coriolis matrix of the paper (Csys)
    Cbar, ...    n x n     the one for which Md - 2 Cbar is skew
    Qgrav, ...   n x 1     gravity forces
    Qext, ...    n x 1     what the wrenches add to Q, J^T W
    ============ ========= ===================================================================================

    It does not stop at two: ``Q3d`` holds ``q5d``. A matrix is made when it is first asked for, and kept.

    Raises
    ------
    JounceError : where a matrix is too large for symbolic form.
    """

    name: str
    series: Mapping[str, Series]  # of SymPy matrices

    def __repr__(self) -> str:
        return f"<Symbolic {self.name!r}: {', '.join(self.series)}, and their rates>"

    def __getattr__(self, name: str) -> Any:
        found = None if name.startswith("_") or name == "series" else re.fullmatch(self._names, name)
        if found is None:
            raise AttributeError(str(no_such("matrix", name, [] if name == "series" else dir(self))))
        symbol, suffix = found.groups()
        return self.series[symbol][int((suffix or "0d")[:-1] or 1)]

    def __dir__(self) -> list[str]:
        rates = [rate_name(symbol, k) for symbol in self.series for k in range(5 if symbol == "q" else 3)]
        return [*rates, "dot", "name", "series"]

    @property
    def _names(self) -> str:
        return f"({'|'.join(self.series)}){SUFFIX}"

    def dot(self, x: Any) -> Any:
        """The time derivative of an expression, or matrix of them, in the coordinates, the wrenches and their rates.

        Examples
        --------
        >>> import jounce
        >>> S = jounce.symbolic(jounce.load("planar2r"))
        >>> (S.dot(S.Q) - S.Qd).expand()
        Matrix([
        [0],
        [0]])
        """
        import sympy

        if not isinstance(x, sympy.Expr | sympy.MatrixBase | sympy.NDimArray | int | float):
            raise JounceError(f"dot takes an expression of SymPy or a matrix of them, not {quoted(x)}")
        total = 0 * x
        for moving in (self.series["q"], self.series["W"]):
            for k in range(NAMED):
                for symbol, rate in zip(moving[k], moving[k + 1], strict=True):
                    total = total + sympy.diff(x, symbol) * rate
        return total


def symbolic(robot: Robot) -> Symbolic:
    """The equations of motion of a robot as SymPy expressions: Q, M, C, Cbar, Qgrav, Qext and their rates.

    Expressions are multiplied out in sines and cosines of sums of angles, so that what is equal looks equal; what all
    terms share stands in front. The robot may hold SymPy symbols, polynomials of them, sines and cosines; its numbers
    are taken as the decimals that they print as.

    Parameters
    ----------
    robot : Robot
        Of symbols or of numbers.

    Returns
    -------
    Symbolic : S.q, S.qd, ..., S.Q, S.Qd, S.Q2d, S.M, ..., see there.

    Raises
    ------
    JounceError : where the robot holds what is neither a number nor a real SymPy expression, or a symbol named as a
        coordinate, or SymPy is missing; a matrix that is too large says so when it is asked for.

    References
    ----------
    Müller & Kumar, Section 6.1, for what comes out of the planar 2R.

    Examples
    --------
    >>> import jounce, sympy
    >>> L1, L2, m1, m2, g = sympy.symbols("L1 L2 m1 m2 g")
    >>> S = jounce.symbolic(jounce.load("planar2r", L1=L1, L2=L2, m1=m1, m2=m2, g=g))
    >>> S.M[0, 1]
    L2*m2*(L1*cos(q2) + L2)
    >>> S.Qgravd[1]
    -L2*g*m2*(qdot1*sin(q1 + q2) + qdot2*sin(q1 + q2))
    >>> print(sympy.latex(S.q4d.T))
    \\left[\\begin{matrix}\\ddddot{q}_{1} & \\ddddot{q}_{2}\\end{matrix}\\right]
    """
    try:
        import sympy
    except ModuleNotFoundError:
        raise JounceError("expressions need SymPy; install it by: pip install 'jounce[sympy]'") from None
    if not isinstance(robot, Robot):
        raise JounceError(f"a Robot has symbolic form, not a {type(robot).__name__}; expected one of jounce.load, say")
    mechanism, alphabet = robot.mechanism, Alphabet(WORK)
    model = _in_waves(mechanism, alphabet)
    symbols = {
        "q": Series(lambda k: sympy.ImmutableMatrix(mechanism.n, 1, list(_coordinates(mechanism.n, k)))),
        "W": Series(lambda k: sympy.ImmutableMatrix(mechanism.nb, 6, list(_wrenches(mechanism.nb, k)))),
    }
    _check_names(alphabet, symbols)
    decimals = any(_has_decimals(x) for label in DATA for x in _scalars(mechanism, label))
    printer = Print(alphabet, parameters=len(alphabet.variables), decimals=decimals)

    def printed(name: str, law: Callable[[], Series]) -> Series:
        def matrix(k: int) -> Any:
            alphabet.work = 0
            with at(f"{rate_name(name, k)} of {mechanism.name!r}"):
                values = np.atleast_2d(law()[k])
                alphabet.spend(PRINTED * sum(len(x.terms) for x in values.flat if isinstance(x, Waves)))
            entries = [printer.expression(x) for x in values.flat]
            return sympy.ImmutableMatrix(mechanism.n, len(entries) // mechanism.n, entries)

        return Series(matrix)

    laws = _laws(model, *(s.map(lambda x: _variables(x, alphabet)) for s in symbols.values()))
    matrices = {name: printed(name, cache(law)) for name, law in laws.items()}
    if FRICTION in mechanism.acting:
        matrices["Q"] = matrices["Q"] + _friction(mechanism, symbols["q"])
    return Symbolic(mechanism.name, symbols | matrices)


def _has_decimals(x: Any) -> bool:
    """Whether a scalar is a float that is not whole, or holds one."""
    import sympy

    floats = x.atoms(sympy.Float) if isinstance(x, sympy.Expr) else [x] if isinstance(x, float) else []
    return any(not float(number).is_integer() for number in floats)


def _laws(model: Mechanism, q: Series, W: Series) -> dict[str, Callable[[], Series]]:
    """What gives the matrices: the recursion, or where it has no frames to work in, the closed form."""
    path = "recursion" if all(map(_has_direction, model.X)) else "closed_form"

    def law(name: str) -> Callable[[], Series]:
        return lambda: QUANTITIES[name].law(path, model)(model, State(q))

    def external() -> Series:
        return external_forces(model, q, W) if path == "recursion" else closed_form(model, q, W).Qext

    return {QUANTITIES[name].symbol: law(name) for name in NAMES} | {"Qext": external}


def _friction(mechanism: Mechanism, q: Series) -> Series:
    """What Coulomb friction adds to Q: no polynomial in waves, hence in SymPy's own terms."""
    import sympy

    columns = q.map(lambda x: np.array(x.tolist(), dtype=object))
    return drive_terms.forces(in_whole_numbers(mechanism), columns, [FRICTION]).map(sympy.ImmutableMatrix)


def _has_direction(X: Array) -> bool:
    """Whether the direction of a joint is made of numbers."""
    return all(isinstance(x, Fraction) for x in (X[:3] if any(x != 0 for x in X[:3]) else X[3:]))


def _in_waves(mechanism: Mechanism, alphabet: Alphabet) -> Mechanism:
    """The mechanism with fractions and waves as its data."""
    data: dict[str, Any] = {}
    for label in DATA:
        array = np.empty(getattr(mechanism, label).shape, dtype=object)
        for index, x in zip(np.ndindex(*array.shape), _scalars(mechanism, label), strict=True):
            with at(f"{label}{list(index)} of {mechanism.name!r}"):
                array[index] = waves(x, alphabet)
        data[label] = array
    acting = tuple(term for term in mechanism.acting if term != FRICTION)
    return replace(mechanism, frames=(), acting=acting, **data)


def _scalars(mechanism: Mechanism, label: str) -> Iterator[Any]:
    return iter(getattr(mechanism, label).ravel().tolist())


def _variables(symbols: Any, alphabet: Alphabet) -> Array:
    """A matrix of symbols as a column of variables."""
    return np.array([[alphabet.variable(symbol)] for symbol in symbols], dtype=object)


def _dots(k: int) -> str:
    """How the name of a k-th rate goes on, so that SymPy prints k dots."""
    return "" if k == 0 else "d" * k + "ot" if k <= 4 else f"^({k})_"


def _coordinates(n: int, k: int) -> Iterator[Any]:
    import sympy

    return (sympy.Symbol(f"q{_dots(k)}{j + 1}") for j in range(n))


def _wrenches(nb: int, k: int) -> Iterator[Any]:
    import sympy

    return (sympy.Symbol(f"{kind}{_dots(k)}_{axis}{i + 1}") for i in range(nb) for kind in "mf" for axis in "xyz")


def _check_names(alphabet: Alphabet, symbols: Mapping[str, Series]) -> None:
    taken = {str(symbol) for series in symbols.values() for k in range(5) for symbol in series[k]}
    for symbol in alphabet.variables:
        if str(symbol) in taken:
            raise JounceError(f"the robot holds a symbol {symbol}, which is the name of a coordinate or wrench")
