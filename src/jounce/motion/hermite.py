"""Make curves through rows that state the coordinates and all their rates: Hermite polynomials, exact at every row.

Between two rows of m rates each there is one polynomial of degree 2 m - 1 with these rates at both ends
(`hermite_coefficients`). It is evaluated from the nearer end, so that both ends are met to rounding. Rounding of q
and t is small at the rows, and grows by h^-k in the k-th rate between rows that are h apart: a warning says so where
it shows.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import count, takewhile

import numpy as np

from jounce.core.errors import warn
from jounce.motion import smoothness
from jounce.motion.curves import SmoothCurve, evaluate_powers
from jounce.spatial.series import rate_name

_counting: ContextVar[float] = ContextVar("_counting", default=math.inf)


@contextmanager
def limit_rounding_warnings(order: int) -> Iterator[None]:
    """Limit warnings of rounding to rates up to an order.

    Within this context results depend on rates up to the order, and higher ones only help.
    """
    token = _counting.set(order)
    try:
        yield
    finally:
        _counting.reset(token)


def collect_rates(columns: Mapping[str, np.ndarray], stems: Sequence[str], ending: str = "") -> tuple[np.ndarray, ...]:
    """Return the rates (N, stems) that columns state of every stem.

    None is skipped: they end before the first rate that is missing. With an ending, their deviations.
    """
    names = ([f"{rate_name(stem, k)}{ending}" for stem in stems] for k in count())
    complete = takewhile(lambda of_rate: all(name in columns for name in of_rate), names)
    return tuple(np.stack([columns[name] for name in of_rate], axis=1) for of_rate in complete)


@dataclass(frozen=True, eq=False)
class HermiteCurve(SmoothCurve):
    """Polynomials between rows of q, qd, ....

    Rows at t (N,) are (N, columns) for each rate: m of them make the degree 2 m - 1. `spreads` are their standard
    deviations, if the rows come from a fit and not from a plan. `rounding` is the standard deviation of t in s, beyond
    that of doubles. Warnings name the table and its columns of q.
    """

    t: np.ndarray
    rows: tuple[np.ndarray, ...]
    spreads: tuple[np.ndarray, ...] | None = None
    rounding: float = 0.0
    table: str = "the motion"
    names: tuple[str, ...] = ()

    @property
    def start(self) -> float:
        return float(self.t[0])

    @property
    def stop(self) -> float:
        return float(self.t[-1])

    @property
    def columns(self) -> int:
        return self.rows[0].shape[1]

    @property
    def highest(self) -> int:
        """The order of the last rate that the rows state."""
        return len(self.rows) - 1

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """Return the values and their derivatives up to `order`.

        At the rows they are those of the rows.
        """
        i = (np.searchsorted(self.t, t, side="right") - 1).clip(0)
        is_on_row = self.t[i] == t
        if is_on_row.all():
            return [row[i] for row in self.rows[: order + 1]]
        left_row = i.clip(max=len(self.t) - 2)
        h = (self.t[left_row + 1] - self.t[left_row])[:, None]
        before, after = ([row[places] for row in self.rows] for places in (left_row, left_row + 1))
        rates = interpolate_hermite(before, after, h, (t - self.t[left_row])[:, None] / h, order)
        self._warn_of_rounding(order)
        return [np.where(is_on_row[:, None], row[i], rate) for row, rate in zip(self.rows, rates, strict=False)]

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Return the standard deviations that the rows state.

        They are linear between the rows, and what the rounding of t adds is in them.
        """
        if self.spreads is None:
            return None if self.rounding == 0 else self._deviations_of_rounding(t, order)
        deviations = [self._linear(rows, t) for rows in self.spreads[: order + 1]]
        if self.rounding == 0:
            return deviations
        return [np.hypot(a, b) for a, b in zip(deviations, self._deviations_of_rounding(t, order), strict=False)]

    def _linear(self, rows: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Return the columns of rows at times, linear between the rows."""
        return np.stack([np.interp(t, self.t, column) for column in rows.T], axis=1)

    def _deviations_of_rounding(self, t: np.ndarray, order: int) -> list[np.ndarray]:
        """Return what the rounding of t does to q and its rates.

        At rows these hold at other times; between them h^-k magnifies it.
        """
        i = np.searchsorted(self.t, t).clip(1, len(self.t) - 1)
        h = (self.t[i] - self.t[i - 1])[:, None]
        rates = [*(self._linear(np.abs(row), t) for row in self.rows[1:]), np.zeros((len(t), self.columns))]
        # Two rows are rounded independently: their distance is off by sqrt(2) times as much, and at a row not at all.
        off = np.where((self.t[i] == t) | (self.t[i - 1] == t), 0, np.sqrt(2) * self.rounding)[:, None]
        at_rows = [self.rounding * rates[min(k, self.highest)] for k in range(order + 1)]
        between_rows = [off * rates[0] * _error_gain(len(self.rows), k) / h**k for k in range(order + 1)]
        return list(map(np.hypot, at_rows, between_rows))

    def _warn_of_rounding(self, order: int) -> None:
        """Warn where the digits of q do not carry the highest rate."""
        order = int(min(order, _counting.get()))
        shares, coarse = self._shares_of_rounding
        share, j = float(shares[order].max()), int(shares[order].argmax())
        if share > smoothness.MAX_ROUNDING_SHARE:
            q = self.names[j] if self.names else "q"
            came = f"{self.table}: rounding of {q} or t may make up {min(share, 1):.0%} of {rate_name(q, order)}"
            # The share falls with the k-th power of the distance of rows.
            distance = 1.1 * np.diff(self.t).min() * (share / smoothness.MAX_ROUNDING_SHARE) ** (1 / max(order, 1))
            cures = ["more digits"] if coarse[j] else []
            if order > 0:
                cures.append(f"rows at least {distance:.2g} s apart")
            warn(f"{came} between its rows, not at them; expected {' or '.join(cures)}")

    @cached_property  # it takes all rows, and a check of limits asks for rates hundreds of times
    @np.errstate(all="ignore")
    def _shares_of_rounding(self) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the share of each rate (columns,) that may be rounding.

        Rounding is that of q and t, between rows, where h^-k magnifies it. A rate that is zero at all rows
        has none. Whether rounding is coarser than that of doubles, so that digits help, comes last.
        """
        fastest = np.abs(self.rows[min(1, self.highest)]).max(axis=0)
        size = np.maximum([smoothness.rounding_error(column) for column in self.rows[0].T], self.rounding * fastest)
        step = np.diff(self.t).min()
        sizes = smoothness.rate_sizes(self.rows, self.stop - self.start)
        shares = [
            size * _error_gain(len(self.rows), k) / step**k / rate * row.any(axis=0)
            for k, (rate, row) in enumerate(zip(sizes, self.rows, strict=True))
        ]
        return shares, size > np.finfo(float).eps * np.abs(self.rows[0]).max(axis=0)


def interpolate_hermite(
    left: Sequence[np.ndarray], right: Sequence[np.ndarray], h: np.ndarray, u: np.ndarray, order: int
) -> list[np.ndarray]:
    """Return values and derivatives at u (N, 1) of Hermite polynomials.

    They are those that `hermite_coefficients` makes of rates at both ends, up to `order`. They are expanded at
    the nearer end, so that both ends are met to rounding.
    """
    # Nearer to the right end the polynomial runs backwards, from there to the left.
    is_backwards = u > 0.5
    ends, reversed_ends = (left, right), (reversed_rates(right), reversed_rates(left))
    sides = zip(ends, reversed_ends, strict=True)
    near_end, far_end = ([np.where(is_backwards, b, a) for a, b in zip(*pair, strict=True)] for pair in sides)
    return evaluate_nearer(hermite_coefficients(near_end, far_end, h), h, u, order)


def reversed_rates(rates: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the rates of a function of time that runs backwards."""
    return [(-1.0) ** k * rate for k, rate in enumerate(rates)]


def evaluate_nearer(c: np.ndarray, h: np.ndarray, u: np.ndarray, order: int) -> list[np.ndarray]:
    """Return values and derivatives at u (N, 1) of polynomials c.

    They are polynomials in u, or where u > 0.5 in 1 - u; derivatives are up to `order`.
    """
    is_backwards = u > 0.5
    rates = evaluate_powers(c, np.where(is_backwards, 1 - u, u), order)
    # The k-th derivative in time is that in u over h^k, with the sign of (-1)^k backwards.
    return [np.where(is_backwards, (-1.0) ** k, 1.0) * rate / h**k for k, rate in enumerate(rates)]


def hermite_coefficients(left: Sequence[np.ndarray], right: Sequence[np.ndarray], h: np.ndarray) -> np.ndarray:
    """Return coefficients of polynomials in u = (t - t_left) / h.

    They are (2 m, N, columns), highest power first. The polynomials have the values and derivatives `left` at u
    = 0 and `right` at u = 1, m of each, stated per time.
    """
    # Powers below m are Taylor's, by the derivatives at u = 0.
    m = len(left)
    low = [h**k * rate / math.factorial(k) for k, rate in enumerate(left)]
    # What they leave of the derivatives at u = 1 is for the powers from m on.
    remainder = [
        h**j * rate - sum((math.perm(k, j) * low[k] for k in range(j, m)), start=0 * rate)
        for j, rate in enumerate(right)
    ]
    high = np.einsum("kj,j...->k...", _inverse_derivatives(m), np.stack(remainder))
    return np.concatenate([high[::-1], np.stack(low)[::-1]])


@cache
def _inverse_derivatives(m: int) -> np.ndarray:
    """Return the matrix from derivatives at 1 to coefficients e.

    The derivatives are of u^m sum_k e_k u^k. It is the inverse of (m + k)! / (m + k - j)!: whole numbers over j!.
    """
    derivative = np.array([[math.perm(m + k, j) for k in range(m)] for j in range(m)], dtype=float)
    factorials = np.array([math.factorial(j) for j in range(m)], dtype=float)
    return np.rint(np.linalg.inv(derivative) * factorials) / factorials


@cache
def _error_gain(m: int, order: int) -> float:
    """Return the gain from an error of q to a derivative.

    The error is of one value of q, with the step 1, and the derivative of an order, between the rows.
    """
    # The polynomial that is 1 at u = 1, and 0 at u = 0 with all its derivatives.
    c = np.concatenate([_inverse_derivatives(m)[::-1, 0], np.zeros(m)])[:, None, None]
    u = np.linspace(0, 1, 33)[:, None]
    return float(np.abs(evaluate_powers(np.broadcast_to(c, (2 * m, len(u), 1)), u, order)[order]).max())
