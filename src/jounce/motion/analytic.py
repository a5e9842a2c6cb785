"""Evaluate curves in closed form, exact to every order.

They are sums of cosines and polynomials (`AnalyticCurve`), and turns by exponential coordinates (`ExponentialCurve`).
With x the axis times the angle, the quaternion is ``(sin(th / 2) / th x, cos(th / 2))``, ``th^2 = x . x``. Of s = th^2
its entries are entire functions, and so are their derivatives: with z = th / 2, those of cos z are spherical Bessel
functions, ``u_k = j_(k-1)(z) / z^(k-1)``, ``d u_k / ds = -u_(k+1) / 8``; nothing is divided by zero at x = 0.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import zip_longest
from math import factorial, prod

import numpy as np

from jounce.motion.base import with_blocks
from jounce.motion.curves import DerivedCurve, SmoothCurve, evaluate_powers
from jounce.spatial.series import Series, column_series, from_rate, join_series

POWER_SERIES_RADIUS = 1.0  # of z, rad, below which the power series is used
POWER_SERIES_TERMS = 10  # the next one is less than 1e-18


@dataclass(frozen=True)
class Cosine:
    """amplitude * cos(frequency * t + phase): rad or m, rad/s, rad."""

    amplitude: float
    frequency: float
    phase: float


@dataclass(frozen=True)
class Terms:
    """A coordinate over time: a polynomial in t, lowest power first, and cosines."""

    polynomial: tuple[float, ...] = (0.0,)
    cosines: tuple[Cosine, ...] = ()


@dataclass(frozen=True)
class AnalyticCurve(SmoothCurve):
    """Coordinates in closed form from one time to another."""

    terms: tuple[Terms, ...]
    start: float
    stop: float

    @property
    def columns(self) -> int:
        return len(self.terms)

    @property
    def highest(self) -> None:
        """None: derivatives of every order are known."""

    @np.errstate(over="ignore", invalid="ignore")  # whoever asks refuses what is not finite
    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        rates = evaluate_powers(self._powers, t[:, None], order)
        for amplitude, frequency, phase in self._waves:
            angle = frequency * t[:, None] + phase
            # Each derivative is a quarter turn further. Cosine and sine exchange, so that no phase is rounded.
            waves = np.cos(angle), np.sin(angle)
            for k, rate in enumerate(rates):
                rate += (1, -1, -1, 1)[k % 4] * amplitude * frequency**k * waves[k % 2]
        return rates

    @cached_property
    def _powers(self) -> np.ndarray:
        """Coefficients (degree + 1, 1, columns) of polynomials.

        The highest power is first.
        """
        columns = zip_longest(*(terms.polynomial for terms in self.terms), fillvalue=0.0)
        return np.array(list(columns), dtype=float)[::-1, None]

    @cached_property
    def _waves(self) -> np.ndarray:
        """Amplitudes, frequencies and phases (cosines, 3, columns).

        They are 0 where a column has fewer cosines.
        """
        rows = zip_longest(*(terms.cosines for terms in self.terms), fillvalue=Cosine(0.0, 0.0, 0.0))
        waves = [[(x.amplitude, x.frequency, x.phase) for x in row] for row in rows]
        return np.array(waves, dtype=float).reshape(-1, self.columns, 3).swapaxes(1, 2)


@dataclass(frozen=True, eq=False)
class ExponentialCurve(DerivedCurve, SmoothCurve):
    """A smooth curve with exponential coordinates turned into quaternions.

    The columns of `base` at some places are exponential coordinates; each place becomes a quaternion (x, y, z,
    w). A place of one column is an angle, of which cosine and sine are made.
    """

    turns: tuple[slice, ...]

    @property
    def columns(self) -> int:
        return self.base.columns + len(self.turns)

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        rates = self.base.rates(t, order, left)
        quaternions = [_exponentiate([rate[:, place] for rate in rates]) for place in self.turns]
        # Columns are rows of rate.T, whose blocks at the places are replaced.
        parts = (with_blocks(rate.T, self.turns, [Q[k].T for Q in quaternions]) for k, rate in enumerate(rates))
        return [np.concatenate(part).T for part in parts]


def _exponentiate(rates: list[np.ndarray]) -> list[np.ndarray]:
    """Return the quaternion, or cosine and sine, with as many rates.

    Exponential coordinates are (N, 3), or (N, 1) of an angle.
    """
    # z is half of the angle for quaternions, and the angle itself in a plane; s = x . x is a series.
    x, part = column_series(rates), 1 / 2 if rates[0].shape[1] == 3 else 1.0
    s, z = x.mT @ x, part * np.linalg.norm(rates[0], axis=1)[:, None, None]

    @cache
    def u(k: int) -> Series:
        # d u_k / dt = -u_(k + 1) part^2 / 2 ds / dt; each order of the series takes one u more.
        return from_rate(_bessel(k, z), lambda _: u(k + 1) @ s.dot * (-part * part / 2))

    # (x, y, z, w) of a quaternion, but (cosine, sine) of an angle.
    Q = join_series([x @ u(1) * part, u(0)][:: 1 if part < 1 else -1], axis=-2)
    return [Q[k][..., 0] for k in range(len(rates))]


def _bessel(k: int, z: np.ndarray) -> np.ndarray:
    """Return u_k: cos z, sin z / z, ..., finite at zero."""
    from scipy.special import spherical_jn

    small, x = np.zeros_like(z), np.maximum(z, POWER_SERIES_RADIUS)
    # The power series near zero, by Horner's scheme from its last term on.
    for i in reversed(range(POWER_SERIES_TERMS)):
        small = small * (-z * z / 2) + 1 / (factorial(i) * prod(range(2 * k + 2 * i - 1, 1, -2)))
    return np.where(z < POWER_SERIES_RADIUS, small, spherical_jn(k - 1, x) / x ** (k - 1) if k else np.cos(x))
