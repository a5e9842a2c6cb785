"""Move along the same path by another time law.

sigma is the time of the given motion, as a function of time.

Problem: sigma(t) of ``sigma'^2 = x(sigma)``, x > 0 a B-spline. The time at which sigma is passed is an integral, ``t =
int 1 / sqrt(x)``, by the rule of Gauss and Legendre between nodes: knots of x, halved until two halves agree with the
whole to rounding. sigma(t) is its root by Newton's method, with the derivative ``dt / dsigma = 1 / sqrt(x)``.

Times of nodes increase, so that a root lies between two of them; steps are clipped to these. Where x comes near zero
the integrand grows, and halving ends at `MAX_NODE_HALVINGS` with less than all digits; x = 0 is for callers to exclude.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from jounce.motion.curves import DerivedCurve, Jump, find_jumps, keep_by_order, sample_rates

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

TIME_QUADRATURE_POINTS = 16  # of Gauss and Legendre between two nodes
MAX_NODE_HALVINGS = 40  # of an interval: they leave 1e-12 of it
MAX_TIME_LAW_STEPS = 50  # a safeguard: Newton's method is quadratic, and kept within its interval
TIME_LAW_TOLERANCE = 4 * np.finfo(float).eps  # of the length of the path or the time along it


@cache
def _gauss_legendre() -> tuple[np.ndarray, np.ndarray]:
    """Return the points and weights of the rule of Gauss and Legendre."""
    return np.polynomial.legendre.leggauss(TIME_QUADRATURE_POINTS)


@dataclass(frozen=True, eq=False)
class TimeLaw:
    """The time law sigma(t) with sigma'(t)^2 = x(sigma).

    It goes from sigma = `first` at t = `start` to sigma = `last`. x is a B-spline with values above 0; of degree
    k it makes sigma C^k, but for its `kinks`.
    """

    x: "BSpline"
    first: float
    last: float
    start: float

    @cached_property
    def kinks(self) -> np.ndarray:
        """The sigma at which x' jumps: knots that are repeated as often as the degree."""
        knots, counts = np.unique(self.x.t, return_counts=True)
        return np.asarray(knots[(counts >= self.x.k) & (knots > self.first) & (knots < self.last)])

    @property
    def stop(self) -> float:
        """The time at which the path ends, s."""
        return float(self._table[1][-1])

    def times(self, sigma: np.ndarray) -> np.ndarray:
        """Return the times (N,) at which values sigma (N,) are passed."""
        nodes, t = self._table
        i = (np.searchsorted(nodes, sigma, side="right") - 1).clip(0, len(nodes) - 2)
        return t[i] + self._duration(nodes[i], sigma)

    def sigma(self, t: np.ndarray) -> np.ndarray:
        """Return sigma (N,) at times (N,).

        It is the root of ``times(sigma) = t``, by Newton's method.
        """
        nodes, node_times = self._table
        i = (np.searchsorted(node_times, t, side="right") - 1).clip(0, len(nodes) - 2)
        left, right = nodes[i], nodes[i + 1]
        # The start is where the secant between the two nodes has the time.
        sigma = left + (right - left) * ((t - node_times[i]) / (node_times[i + 1] - node_times[i])).clip(0, 1)
        for _ in range(MAX_TIME_LAW_STEPS):
            # Newton's step: the error in time over dt / dsigma = 1 / sqrt(x), clipped to between the nodes.
            step = (node_times[i] + self._duration(left, sigma) - t) * np.sqrt(self.x(sigma))
            better = (sigma - step).clip(left, right)
            change, sigma = np.abs(better - sigma), better
            if (change <= TIME_LAW_TOLERANCE * (self.last - self.first)).all():
                break
        return sigma

    def rates(self, t: np.ndarray, order: int) -> list[np.ndarray]:
        """Return sigma and its derivatives up to an order, (N,) each."""
        return self.rates_at(self.sigma(t), order)

    def rates_at(self, sigma: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """Return sigma and its derivatives at values of sigma.

        sigma'' = x'(sigma) / 2, at kinks from one side, and its derivatives follow.
        """
        side = np.nextafter(sigma, self.first) if left and self.kinks.size else sigma
        # With x' / 2 = f the k-th derivative of sigma'' is that of f(sigma(t)), by the chain rule from lower
        # derivatives.
        rates = [sigma, np.sqrt(self.x(sigma))]
        slopes = [self.x(side, nu=k) / 2 for k in range(1, order)]
        for k in range(order - 1):
            row = chain_rule(rates, k)[k]
            rates.append(sum((f * b for f, b in zip(slopes, row, strict=False)), start=0 * sigma))
        return rates[: order + 1]

    @cached_property
    def _table(self) -> tuple[np.ndarray, np.ndarray]:
        """Values of sigma and their times, close together.

        A rule of Gauss and Legendre is exact between two of them.
        """
        knots = np.unique(self.x.t)
        nodes = np.unique([self.first, *knots[(knots > self.first) & (knots < self.last)], self.last])
        # Intervals are halved whose halves differ from the whole: the rule is not exact there.
        for _ in range(MAX_NODE_HALVINGS):
            left, right = nodes[:-1], nodes[1:]
            middle = (left + right) / 2
            whole, halves = self._duration(left, right), self._duration(left, middle) + self._duration(middle, right)
            rough = np.abs(whole - halves) > TIME_LAW_TOLERANCE * halves.sum()
            if not rough.any():
                break
            nodes = np.sort(np.concatenate([nodes, middle[rough]]))
        durations = self._duration(nodes[:-1], nodes[1:])
        return nodes, self.start + np.concatenate([[0.0], np.cumsum(durations)])

    def _duration(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Return the time from one value of sigma to another.

        It is the integral of 1 / sqrt(x).
        """
        u, w = _gauss_legendre()
        half = (right - left)[:, None] / 2
        return (half * w / np.sqrt(self.x((left + right)[:, None] / 2 + half * u))).sum(axis=1)


@dataclass(frozen=True, eq=False)
class TimeLawCurve(DerivedCurve):
    """A curve by another time law: that of `base` at sigma(t)."""

    law: TimeLaw

    @property
    def start(self) -> float:
        return self.law.start

    @property
    def stop(self) -> float:
        return self.law.stop

    @property
    def highest(self) -> int | None:
        """The order of the last derivative that is known.

        sigma is C^k with a spline x of degree k, or has `jumps`.
        """
        if self.law.kinks.size > 0:
            return self.base.highest
        degree = int(self.law.x.k)
        return degree if self.base.highest is None else min(self.base.highest, degree)

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """Return the values and their derivatives, by the chain rule."""
        return self._rates_at(self.inner_at_jumps(t, order), order, left)

    def _rates_at(self, sigma: np.ndarray, order: int, left: bool) -> list[np.ndarray]:
        factors = chain_rule(self.law.rates_at(sigma, order, left), order)
        return apply_chain_rule(factors, self.base.rates(sigma, order, left))

    @keep_by_order
    def jumps(self, order: int) -> list[Jump]:
        """Return where a derivative up to `order` jumps.

        It does where those of `base` do, and at kinks of the time law.
        """
        jumps = self.base.jumps(order)
        if self.law.kinks.size > 0 and order > 1:
            return self._find_jumps(order)
        sigma = np.array([jump.t for jump in jumps])
        times, speeds = self.law.times(sigma).tolist(), np.sqrt(self.law.x(sigma)).tolist()
        # The time law is smooth: the lowest derivative that jumps is multiplied by sigma' as often as its order.
        return [j._replace(t=t, size=j.size * v**j.order) for j, t, v in zip(jumps, times, speeds, strict=True)]

    def _find_jumps(self, order: int) -> list[Jump]:
        """Return the jumps that derivatives from both sides show."""
        sigma = self.inner_jumps(order)
        t = self.law.times(sigma)
        spans = np.diff(np.concatenate([[self.start], t, [self.stop]]))
        before, after = (self._rates_at(sigma, order, left) for left in (True, False))
        return find_jumps(t, before, after, np.maximum(spans[1:], spans[:-1]), sample_rates(self, order))

    @keep_by_order
    def inner_jumps(self, order: int) -> np.ndarray:
        """Return the values of sigma at which a derivative jumps.

        The kinks of the time law are among them.
        """
        return np.union1d(self.law.kinks, super().inner_jumps(order))

    def inner(self, t: np.ndarray) -> np.ndarray:
        return self.law.sigma(t)

    def outer(self, t: np.ndarray) -> np.ndarray:
        return self.law.times(t)

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Return standard deviations, with those of `base` taken as independent."""
        law = self.law.rates(t, order)
        base = self.base.deviations(law[0], order)
        if base is None:
            return None
        # Variances add with the squares of the factors of the chain rule.
        squares = [[b**2 for b in row] for row in chain_rule(law, order)]
        return [np.sqrt(square) for square in apply_chain_rule(squares, [rate**2 for rate in base])]


def apply_chain_rule(rows: Sequence[Sequence[np.ndarray]], base: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the sums of derivatives (N, columns) times factors (N,)."""
    return [sum((b[:, None] * f for b, f in zip(row, base, strict=False)), start=0 * base[0]) for row in rows]


def chain_rule(rates: Sequence[np.ndarray], order: int) -> list[list[np.ndarray]]:
    """Return the factors B[n][k] of the chain rule up to an order.

    (f o sigma)^(n) = sum_k f^(k)(sigma) B[n][k]: Bell polynomials of the rates of sigma.
    """
    one = np.ones_like(rates[0])
    rows: list[list[np.ndarray]] = [[one]]
    for n in range(1, order + 1):
        # B[n][k] = sum_i binomial(n - 1, i) sigma^(i + 1) B[n - 1 - i][k - 1], with B[0][0] = 1 and B[n][0] = 0.
        row = [0 * one]
        for k in range(1, n + 1):
            terms = (comb(n - 1, i) * rates[i + 1] * rows[n - 1 - i][k - 1] for i in range(n - k + 1))
            row.append(sum(terms, start=0 * one))
        rows.append(row)
    return rows
