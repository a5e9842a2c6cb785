"""Hermite polynomials: curves through rows that state the coordinates and all their rates, exact at every row."""

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
    """Within this context, results depend on rates up to an order, and higher ones only help: none warns of these."""
    token = _counting.set(order)
    try:
        yield
    finally:
        _counting.reset(token)


def collect_rates(columns: Mapping[str, np.ndarray], stems: Sequence[str], ending: str = "") -> tuple[np.ndarray, ...]:
    """The rates (N, stems) that columns state of every stem, none skipped; with an ending, their deviations."""
    names = ([f"{rate_name(stem, k)}{ending}" for stem in stems] for k in count())
    given = takewhile(lambda of_rate: all(name in columns for name in of_rate), names)
    return tuple(np.stack([columns[name] for name in of_rate], axis=1) for of_rate in given)


@dataclass(frozen=True, eq=False)
class HermiteCurve(SmoothCurve):
    """Polynomials between rows at t (N,) of q, qd, ... (N, columns) each: m of them make the degree 2 m - 1.

    `spreads` are their standard deviations, if the rows come from a fit and not from a plan. `rounding` is the standard
    deviation of t in s, beyond that of doubles. Warnings name the table and its columns of q.
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
        """The values and their derivatives up to `order`; at the rows they are those of the rows."""
        i = (np.searchsorted(self.t, t, side="right") - 1).clip(0)
        on_row = self.t[i] == t
        if on_row.all():
            return [row[i] for row in self.rows[: order + 1]]
        left_row = i.clip(max=len(self.t) - 2)
        h = (self.t[left_row + 1] - self.t[left_row])[:, None]
        before, after = ([row[at] for row in self.rows] for at in (left_row, left_row + 1))
        found = interpolate_hermite(before, after, h, (t - self.t[left_row])[:, None] / h, order)
        self._warn_of_rounding(order)
        return [np.where(on_row[:, None], row[i], rate) for row, rate in zip(self.rows, found, strict=False)]

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """The standard deviations that the rows state, linear between them, and what the rounding of t adds."""
        if self.spreads is None:
            return self._deviations_of_rounding(t, order) if self.rounding else None
        stated = [self._linear(rows, t) for rows in self.spreads[: order + 1]]
        if not self.rounding:
            return stated
        return [np.hypot(a, b) for a, b in zip(stated, self._deviations_of_rounding(t, order), strict=False)]

    def _linear(self, rows: np.ndarray, t: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(t, self.t, column) for column in rows.T], axis=1)

    def _deviations_of_rounding(self, t: np.ndarray, order: int) -> list[np.ndarray]:
        """What the rounding of t does: at rows, which hold at other times; between them, where h^-k magnifies it."""
        i = np.searchsorted(self.t, t).clip(1, len(self.t) - 1)
        h = (self.t[i] - self.t[i - 1])[:, None]
        rates = [*(self._linear(np.abs(row), t) for row in self.rows[1:]), np.zeros((len(t), self.columns))]
        apart = np.where((self.t[i] == t) | (self.t[i - 1] == t), 0, np.sqrt(2) * self.rounding)[:, None]
        at_rows = [self.rounding * rates[min(k, self.highest)] for k in range(order + 1)]
        between_rows = [apart * rates[0] * _error_gain(len(self.rows), k) / h**k for k in range(order + 1)]
        return list(map(np.hypot, at_rows, between_rows))

    def _warn_of_rounding(self, order: int) -> None:
        """Warn where the digits of q do not carry the highest rate from row to row."""
        order = int(min(order, _counting.get()))
        shares, coarse = self._shares_of_rounding
        share, j = float(shares[order].max()), int(shares[order].argmax())
        if share > smoothness.MAX_ROUNDING_SHARE:
            q = self.names[j] if self.names else "q"
            came = f"{self.table}: rounding of {q} or t may make up {min(share, 1):.0%} of {rate_name(q, order)}"
            apart = 1.1 * np.diff(self.t).min() * (share / smoothness.MAX_ROUNDING_SHARE) ** (1 / max(order, 1))
            cures = ["more digits"] * bool(coarse[j]) + [f"rows at least {apart:.2g} s apart"] * (order > 0)
            warn(f"{came} between its rows, not at them; expected {' or '.join(cures)}")

    @cached_property  # it takes all rows, and a check of limits asks for rates hundreds of times
    @np.errstate(all="ignore")
    def _shares_of_rounding(self) -> tuple[list[np.ndarray], np.ndarray]:
        """What share of each rate (columns,) the rounding of q and t may make up between rows, which h^-k magnifies.

        A rate that is zero at all rows has none. And where rounding is coarser than of doubles, so that digits help.
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
    """Values and derivatives up to `order` at u (N, 1) of the polynomials that `coefficients` makes.

    They are expanded at the nearer end, so that both ends are met to rounding.
    """
    back = u > 0.5
    ends, turned = (left, right), (reversed_rates(right), reversed_rates(left))
    sides = zip(ends, turned, strict=True)
    near, far = ([np.where(back, b, a) for a, b in zip(*pair, strict=True)] for pair in sides)
    return evaluate_nearer(hermite_coefficients(near, far, h), h, u, order)


def reversed_rates(rates: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The values and derivatives of a function of time that runs backwards."""
    return [(-1.0) ** k * rate for k, rate in enumerate(rates)]


def evaluate_nearer(c: np.ndarray, h: np.ndarray, u: np.ndarray, order: int) -> list[np.ndarray]:
    """Values and derivatives up to `order` at u (N, 1) of polynomials c in u, or where u > 0.5 in 1 - u."""
    back = u > 0.5
    found = evaluate_powers(c, np.where(back, 1 - u, u), order)
    return [np.where(back, (-1.0) ** k, 1.0) * rate / h**k for k, rate in enumerate(found)]


def hermite_coefficients(left: Sequence[np.ndarray], right: Sequence[np.ndarray], h: np.ndarray) -> np.ndarray:
    """Coefficients (2 m, N, columns), highest power first, of polynomials in u = (t - t_left) / h.

    They have the values and derivatives `left` at u = 0 and `right` at u = 1, m of each, stated per time.
    """
    m = len(left)
    low = [h**k * rate / math.factorial(k) for k, rate in enumerate(left)]
    rest = [  # what powers below m leave of the derivatives at u = 1
        h**j * rate - sum((math.perm(k, j) * low[k] for k in range(j, m)), start=0 * rate)
        for j, rate in enumerate(right)
    ]
    high = np.einsum("kj,j...->k...", _inverse_derivatives(m), np.stack(rest))
    return np.concatenate([high[::-1], np.stack(low)[::-1]])


@cache
def _inverse_derivatives(m: int) -> np.ndarray:
    """Derivatives at 1 of u^m sum_k e_k u^k to e: the inverse of (m + k)! / (m + k - j)!, whole numbers over j!."""
    derivative = np.array([[math.perm(m + k, j) for k in range(m)] for j in range(m)], dtype=float)
    factorials = np.array([math.factorial(j) for j in range(m)], dtype=float)
    return np.rint(np.linalg.inv(derivative) * factorials) / factorials


@cache
def _error_gain(m: int, order: int) -> float:
    """How much an error of one value of q, the step being 1, shows in the derivative of an order between the rows."""
    c = np.concatenate([_inverse_derivatives(m)[::-1, 0], np.zeros(m)])[:, None, None]
    u = np.linspace(0, 1, 33)[:, None]
    return float(np.abs(evaluate_powers(np.broadcast_to(c, (2 * m, len(u), 1)), u, order)[order]).max())
