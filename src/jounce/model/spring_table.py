"""Springs of elastic joints given by measured pairs of deflections and forces."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import Array, asarray, is_numeric
from jounce.core.typing import ArrayLike
from jounce.model.springs import Spring
from jounce.spatial.series import Series

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

SPRING_SPLINE_DEGREE = 5  # so that the force has four continuous derivatives


@dataclass(frozen=True)
class SpringTable(Spring):
    """A spring given by measured pairs: the spline of degree 5 through them, with four continuous derivatives.

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
        columns = {"deflections": deflections, "forces": forces}
        for name, given in columns.items():
            column = np.asarray(asarray(given, f"spring table: {name}"))
            if not is_numeric(column) or column.ndim != 1 or not np.isfinite(column).all():
                raise JounceError(f"spring table: {name} have shape {column.shape}; expected finite numbers (N,)")
            if (fall := np.flatnonzero(np.diff(column) <= 0)).size:
                i = int(fall[0])
                rows = f"from row {i} ({column[i]:g}) to {i + 1} ({column[i + 1]:g})"
                raise JounceError(f"spring table: {name} do not rise {rows}; expected a monotone table")
            object.__setattr__(self, name, tuple(column.tolist()))
        if not len(self.deflections) == len(self.forces) > SPRING_SPLINE_DEGREE:
            came = f"{len(self.deflections)} deflections and {len(self.forces)} forces"
            least = f"as many of both, {SPRING_SPLINE_DEGREE + 1} or more"
            raise JounceError(f"a spring table has {came}; expected {least}")
        self._check_rise()

    def _check_rise(self) -> None:
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
        """The energy of the spring, J: zero at rest, or at the end of the table that is nearest to it."""
        work = _splines(self)[0].antiderivative()
        return work(deflection) - work(np.clip(0.0, *self.range))


@lru_cache(maxsize=64)
def _splines(spring: SpringTable) -> "list[PPoly]":
    """The spline through a table, and its derivatives."""
    from scipy.interpolate import PPoly, make_interp_spline

    spline = PPoly.from_spline(make_interp_spline(spring.deflections, spring.forces, k=SPRING_SPLINE_DEGREE).tck)
    return [spline.derivative(j) for j in range(SPRING_SPLINE_DEGREE + 1)]
