"""B-splines on a path: values and derivatives at points, and the duration that a spline x(sigma) makes.

At a point only k + 1 B-splines of degree k are not zero (C. de Boor, A Practical Guide to Splines, 2001), so that
gradients and Hessians by the coefficients are sums of small blocks, and Hessians have k + 1 bands. The duration, the
integral of x^(-1/2), is a Gauss-Legendre sum in each interval; x must be above 0 at its points.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from jounce.limits.path_velocity import JET_SIZE

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_TIME_LAW_DEGREE = 5  # of x(sigma), which is then C^4, so that the motion is smooth up to q5d
_DURATION_NODES = 4  # of Gauss and Legendre in each interval: exact to degree 7, more than a smooth x^(-1/2) needs


@dataclass(frozen=True, eq=False)
class LocalSplines:
    """The B-splines that are not zero at N points: their indices (N, k + 1), with derivatives (N, 4, k + 1)."""

    index: np.ndarray
    values: np.ndarray
    count: int

    def select(self, points: np.ndarray | slice) -> "LocalSplines":
        """The same at some of the points."""
        return LocalSplines(self.index[points], self.values[points], self.count)

    def jets(self, c: np.ndarray) -> np.ndarray:
        """x, x', x'', x''' at the points, (4, N), of coefficients c."""
        return np.matmul(self.values, c[self.index][:, :, None])[:, :, 0].T

    def collect(self, force: np.ndarray) -> np.ndarray:
        """The gradient by the coefficients of a function with these gradients (N, J) by the jets."""
        parts = np.matmul(force[:, None], self.values[:, : force.shape[1]])
        return np.bincount(self.index.ravel(), parts.ravel(), self.count)

    def bands(self, local: np.ndarray) -> np.ndarray:
        """The Hessian by the coefficients, upper bands (k + 1, count), of one with these Hessians (N, J, J)."""
        values = self.values[:, : local.shape[1]]
        parts = np.matmul(values.transpose(0, 2, 1), np.matmul(local, values))
        rows, columns, places = self._places
        return np.bincount(places, parts[:, rows, columns].ravel(), self.values.shape[2] * self.count).reshape(
            self.values.shape[2], self.count
        )

    @cached_property
    def _places(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        width = self.values.shape[2]
        rows, columns = np.triu_indices(width)
        band = width - 1 + rows - columns
        return rows, columns, (band * self.count + self.index[:, columns]).ravel()


@dataclass(frozen=True, eq=False)
class Basis:
    """B-splines of even intervals from `first` to `last`, clamped at both ends."""

    first: float
    last: float
    intervals: int

    @cached_property
    def knots(self) -> np.ndarray:
        """The knots, the ends repeated."""
        return np.pad(np.linspace(self.first, self.last, self.intervals + 1), _TIME_LAW_DEGREE, mode="edge")

    @property
    def count(self) -> int:
        """The number of coefficients."""
        return self.intervals + _TIME_LAW_DEGREE

    def spline(self, c: np.ndarray) -> "BSpline":
        """The spline with coefficients c."""
        from scipy.interpolate import BSpline

        return BSpline(self.knots, c, _TIME_LAW_DEGREE, extrapolate=False)

    def refine(self, spline: "BSpline") -> np.ndarray:
        """The coefficients of a spline of fewer intervals, each of which is several of these."""
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self._greville, spline(self._greville), k=_TIME_LAW_DEGREE, t=self.knots).c

    def approximate(self, x: "BSpline") -> np.ndarray:
        """The coefficients of a spline near to another function, as smooth as this basis is: Schoenberg's."""
        return np.asarray(x(self._greville))

    @cached_property
    def _greville(self) -> np.ndarray:
        means = [self.knots[i + 1 : i + _TIME_LAW_DEGREE + 1].mean() for i in range(self.count)]
        return np.array(means).clip(self.first, self.last)  # means of equal knots are off by rounding

    def evaluate(self, sigma: np.ndarray) -> LocalSplines:
        """The B-splines at points."""
        from scipy.interpolate import BSpline

        i = (np.searchsorted(self.knots, sigma, side="right") - 1).clip(_TIME_LAW_DEGREE, self.count - 1)
        index = (i - _TIME_LAW_DEGREE)[:, None] + np.arange(_TIME_LAW_DEGREE + 1)
        values = np.empty((len(sigma), JET_SIZE, _TIME_LAW_DEGREE + 1))
        rows = np.arange(len(sigma))
        for phase in range(_TIME_LAW_DEGREE + 1):  # every (k + 1)-th B-spline at once: no two of them overlap
            some = BSpline(
                self.knots, (np.arange(self.count) % (_TIME_LAW_DEGREE + 1) == phase).astype(float), _TIME_LAW_DEGREE
            )
            for k in range(JET_SIZE):
                values[rows, k, (phase - index[:, 0]) % (_TIME_LAW_DEGREE + 1)] = some(sigma, nu=k)
        return LocalSplines(index, values, self.count)

    def speeds(self, c: np.ndarray) -> np.ndarray:
        """x at the points at which the duration is evaluated."""
        return self._quadrature[0].jets(c)[0]

    def duration(self, c: np.ndarray) -> float:
        """The integral of 1 / sqrt(x)."""
        return float(self._quadrature[1] @ self.speeds(c) ** -0.5)

    def duration_derivatives(self, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and upper bands of the Hessian of the duration."""
        at, weights = self._quadrature
        x = self.speeds(c)
        return at.collect((-0.5 * weights * x**-1.5)[:, None]), at.bands((0.75 * weights * x**-2.5)[:, None, None])

    @cached_property
    def _quadrature(self) -> tuple[LocalSplines, np.ndarray]:
        u, w = np.polynomial.legendre.leggauss(_DURATION_NODES)
        ends = self.knots[_TIME_LAW_DEGREE:-_TIME_LAW_DEGREE]
        half = np.diff(ends)[:, None] / 2
        sigma = ends[:-1, None] + half * (1 + u)
        return self.evaluate(sigma.ravel()), (half * w).ravel()
