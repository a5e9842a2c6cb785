"""Springs of elastic joints give the force phi over the deflection.

They are frozen data. A spring gives phi, phi', phi'', ..., the derivatives by the deflection, at any deflection and to
any order. All else follows from them: the force of a moving spring with its rates, by `force_along`, and the rates of a
deflection that carries a force.

`Spring` is what all springs have in common. `CubicSpring` stiffens or softens, `SpringFunction` records a function of
the caller as a program, `SpringTable` lays a spline through measured pairs, which takes SciPy, and `DampedSpring` has a
damper in parallel. `read_spring` is the door for what a caller gives as a spring.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from math import inf
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from jounce.core.errors import JounceError, locate_errors, one_line, quote_value
from jounce.core.scalars import Array, asarray, is_finite, is_numeric
from jounce.core.typing import ArrayLike
from jounce.model.series_functions import evaluate
from jounce.program.program import Program, Tape
from jounce.spatial.series import Series

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


ENERGY_QUADRATURE_NODES = 40  # of Gauss and Legendre: exact for polynomials of degree 79
SPRING_SPLINE_DEGREE = 5  # so that the force has four continuous derivatives
END_SLACK = 1e-9  # of the range of a spring: rounding of a difference theta - q may go beyond its ends by this much
MAX_CUBIC_RATIO = (
    1e100  # of sqrt(k3 / k) / k, 1/(N m): forces up to 1e50 N m keep y y below 1e300, see `spring_deflection`
)
SPRING_OPERATIONS = "+ - * / **, and the functions sin, cos, tanh, exp, sqrt, sinh, cosh of NumPy"


class Spring(ABC):
    """A force that rises with the deflection, over an interval of deflections."""

    @property
    @abstractmethod
    def range(self) -> tuple[float, float]:
        """The least and the largest deflection, rad or m."""

    def force(self, deflection: ArrayLike) -> Array:
        """Return the force phi at deflections of any shape, within its range: N m, or N."""
        return self._derivatives(self.checked(np.asarray(deflection, dtype=float)))[0]

    def stiffness(self, deflection: ArrayLike) -> Array:
        """Return the stiffness phi' at deflections of any shape, within its range.

        It is in N m/rad, or N/m.
        """
        return self._derivatives(self.checked(np.asarray(deflection, dtype=float)))[1]

    def checked(self, deflection: Array) -> Array:
        """Return deflections that the spring allows.

        Raises `JounceError` for one beyond its ends.
        """
        low, high = self.range
        if (low == -inf and high == inf) or not is_numeric(deflection) or np.iscomplexobj(deflection):
            return deflection
        slack = END_SLACK * (high - low)
        is_beyond = (deflection < low - slack) | (deflection > high + slack)
        if is_beyond.any():
            x = deflection[is_beyond].flat[0]
            raise JounceError(f"a deflection of {x:g} is beyond the ends of the spring, {low:g} to {high:g}")
        return deflection

    @abstractmethod
    def _derivatives(self, deflection: Array) -> Series:
        """Return phi, phi', phi'', ... at deflections of any shape."""

    @abstractmethod
    def _energy(self, deflection: Array) -> Array:
        """Return the energy of the spring, J: zero at rest."""


@dataclass(frozen=True)
class CubicSpring(Spring):
    """A spring that stiffens or softens: phi = k delta + k3 delta^3.

    Parameters
    ----------
    k : float
        The stiffness at rest, N m/rad or N/m, positive, or zero if k3 is positive. With zero there is no native or
        generated code, and rates of deflections are refused where the spring carries no force: they are infinite there.
    k3 : float, optional
        The cubic coefficient, N m/rad^3 or N/m^3. A negative one softens the spring, which ends where the stiffness is
        zero.

    Examples
    --------
    >>> import jounce
    >>> arm = jounce.load("planar2r").elastic(spring=jounce.CubicSpring(500.0, 2e4), rotor=0.1)
    """

    k: float
    k3: float = 0.0

    def __post_init__(self) -> None:
        if not (is_finite(self.k) and is_finite(self.k3) and (self.k > 0 or (self.k == 0 and self.k3 > 0))):
            expected = "a stiffness k above 0, in N m/rad or N/m, and a finite k3; or k=0 with k3 above 0"
            raise JounceError(f"CubicSpring(k={quote_value(self.k)}, k3={quote_value(self.k3)}): expected {expected}")

    @property
    def has_fixed_steps(self) -> bool:
        """Whether a fixed number of steps inverts it for every scalar type.

        It does not soften, k is above 0, and k is not so small that the square of a force in units of k sqrt(k / k3)
        may overflow.
        """
        return self.k > 0 and self.k3 >= 0 and (self.k3 / self.k) ** 0.5 <= MAX_CUBIC_RATIO * self.k

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest deflection, rad or m: infinite, unless the spring softens."""
        # A spring that softens ends where its stiffness k + 3 k3 delta^2 is 0.
        end = (-self.k / (3 * self.k3)) ** 0.5 if self.k3 < 0 else inf
        return -end, end

    def _derivatives(self, deflection: Array) -> Series:
        d, square = deflection, deflection * deflection
        terms = ((self.k + self.k3 * square) * d, self.k + 3 * self.k3 * square, 6 * self.k3 * d, 6 * self.k3 + 0 * d)
        return Series(lambda j: terms[j] if j < len(terms) else 0 * d)

    def _energy(self, deflection: Array) -> Array:
        square = deflection * deflection
        return (self.k / 2 + self.k3 / 4 * square) * square


@dataclass(frozen=True)
class SpringFunction(Spring):
    """A spring given by a function, recorded as a program.

    `SpringFunction.of` makes one of a Python function.

    Attributes
    ----------
    program : Program
        The operations that lead from the deflection to the force.

    Examples
    --------
    >>> import jounce, numpy as np
    >>> spring = jounce.SpringFunction.of(lambda delta: 300 * np.sinh(2 * delta) / 2)
    >>> round(float(spring.stiffness(0.0)), 9)
    300.0
    """

    program: Program

    @classmethod
    def of(cls, function: Callable[[Any], Any]) -> Self:
        """Return a spring whose force is a function of the deflection.

        Parameters
        ----------
        function : callable
            It takes the deflection, rad or m, and returns the force phi, N m or N. It is called once, with a symbol:
            it may use + - * / **, and sin, cos, tanh, exp, sqrt, sinh, cosh of NumPy, and no comparisons.

        Returns
        -------
        SpringFunction

        Raises
        ------
        JounceError
            If the function uses anything else, or its force does not rise at rest.

        Examples
        --------
        >>> import jounce
        >>> spring = jounce.SpringFunction.of(lambda delta: 300 * delta + 2e3 * delta**3)
        """
        tape = Tape()
        try:
            force = function(tape.variables(1)[0])
            spring = cls(tape.program([force]))
        except JounceError:
            raise
        except Exception as error:  # whatever a caller's function, or NumPy on a symbol, raises
            came = f"it raised: {one_line(error)}"
            raise JounceError(f"a spring function may use {SPRING_OPERATIONS}; {came}; give a table instead") from None
        with np.errstate(all="ignore"):
            stiffness = spring._derivatives(np.zeros(()))[1]
        if not stiffness > 0:
            raise JounceError(f"a spring function has stiffness {stiffness:g} at rest; expected a force that rises")
        return spring

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest deflection, rad or m: not bounded."""
        return -inf, inf

    def _derivatives(self, deflection: Array) -> Series:
        if not is_numeric(deflection):
            raise JounceError("a spring given by a function needs NumPy arrays of floats; use CubicSpring for symbols")
        units = (deflection, np.ones_like(deflection))
        moving = Series(lambda j: units[j] if j < 2 else np.zeros_like(deflection))
        return evaluate(self.program, [moving])[0]

    def _energy(self, deflection: Array) -> Array:
        # E = integral of phi from 0 to delta by Gauss-Legendre quadrature: nodes in (0, delta), (...) -> (..., nodes).
        points, weights = np.polynomial.legendre.leggauss(ENERGY_QUADRATURE_NODES)
        force = self._derivatives(deflection[..., None] * (points + 1) / 2)[0]
        return deflection / 2 * (force @ weights)


def read_spring(given: object, label: str) -> Spring:
    """Return a spring given as one or as a function."""
    if isinstance(given, Spring):
        return given
    if callable(given):
        with locate_errors(label):
            return SpringFunction.of(given)
    expected = "a CubicSpring, a SpringTable or a function of the deflection"
    raise JounceError(f"{label} is {quote_value(given)}; expected {expected}")


@dataclass(frozen=True)
class DampedSpring:
    """A spring with a damper in parallel."""

    spring: Spring
    damping: float  # D, N m s or N s/m
    terms: int  # of its series at one instant

    @property
    def time_constant(self) -> float:
        """D / K at rest, s."""
        return self.damping / float(self.spring.stiffness(0.0))


def force_along(spring: Spring, deflection: Series, derivative: int = 0) -> Series:
    """Return phi, or a derivative of it, along a deflection."""
    # The rate of the j-th derivative is the next derivative times delta': its series takes that of the next, one rate
    # less.
    at_instant = spring._derivatives(deflection[0])
    rows: dict[int, Series] = {}

    def row(j: int) -> Series:
        if j not in rows:
            rows[j] = Series(lambda k: row_rate(j)[k - 1] if k else at_instant[j])
        return rows[j]

    @cache
    def row_rate(j: int) -> Series:
        return row(j + 1) * deflection.dot

    return row(derivative)


@dataclass(frozen=True)
class SpringTable(Spring):
    """A spring given by measured pairs of deflection and force.

    It is the spline of degree 5 through the pairs, with four continuous derivatives.

    Parameters
    ----------
    deflections : (N,)
        Deflections, rad or m, rising; at least 6.
    forces : (N,)
        The forces that they take, N m or N, rising.

    Raises
    ------
    JounceError
        If either does not rise, or the spline through them does not.

    Examples
    --------
    >>> import jounce, numpy as np
    >>> deflection = np.linspace(-0.1, 0.1, 21)
    >>> spring = jounce.SpringTable(deflection, 500 * deflection + 2e4 * deflection**3)
    >>> round(float(spring.force(0.05)), 6)
    27.5
    """

    deflections: tuple[float, ...]
    forces: tuple[float, ...]

    def __init__(self, deflections: ArrayLike, forces: ArrayLike) -> None:
        for name, numbers in {"deflections": deflections, "forces": forces}.items():
            column = np.asarray(asarray(numbers, f"spring table: {name}"))
            if not is_numeric(column) or column.ndim != 1 or not np.isfinite(column).all():
                raise JounceError(f"spring table: {name} have shape {column.shape}; expected finite numbers (N,)")
            falling = np.flatnonzero(np.diff(column) <= 0)
            if falling.size > 0:
                i = int(falling[0])
                rows = f"from row {i} ({column[i]:g}) to {i + 1} ({column[i + 1]:g})"
                raise JounceError(f"spring table: {name} do not rise {rows}; expected a monotone table")
            object.__setattr__(self, name, tuple(column.tolist()))
        if not len(self.deflections) == len(self.forces) > SPRING_SPLINE_DEGREE:
            came = f"{len(self.deflections)} deflections and {len(self.forces)} forces"
            least = f"as many of both, {SPRING_SPLINE_DEGREE + 1} or more"
            raise JounceError(f"a spring table has {came}; expected {least}")
        self._check_rise()

    def _check_rise(self) -> None:
        """Raise `JounceError` if the force falls anywhere between the pairs."""
        # The least stiffness is at a knot or where the stiffness has an extremum.
        stiffness = _splines(self)[1]
        turning = stiffness.derivative().roots(extrapolate=False)
        points = np.concatenate([stiffness.x, turning[np.isfinite(turning)]])
        lowest = points[np.argmin(stiffness(points))]
        if not stiffness(lowest) > 0:
            why = f"its force falls at the deflection {lowest:g}; expected more or smoother rows"
            raise JounceError(f"the spline through a spring table is not monotone: {why}")

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest deflection, rad or m: the ends of the table."""
        return self.deflections[0], self.deflections[-1]

    def _derivatives(self, deflection: Array) -> Series:
        if not is_numeric(deflection):
            raise JounceError("a spring given by a table needs NumPy arrays of floats; use CubicSpring for symbols")
        splines = _splines(self)
        return Series(lambda j: splines[j](deflection) if j <= SPRING_SPLINE_DEGREE else np.zeros_like(deflection))

    def _energy(self, deflection: Array) -> Array:
        """Return the energy of the spring, J."""
        work = _splines(self)[0].antiderivative()
        return work(deflection) - work(np.clip(0.0, *self.range))


@lru_cache(maxsize=64)
def _splines(spring: SpringTable) -> "list[PPoly]":
    """Return the spline through a table, and its derivatives."""
    from scipy.interpolate import PPoly, make_interp_spline

    spline = PPoly.from_spline(make_interp_spline(spring.deflections, spring.forces, k=SPRING_SPLINE_DEGREE).tck)
    return [spline.derivative(j) for j in range(SPRING_SPLINE_DEGREE + 1)]
