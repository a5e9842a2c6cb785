"""Curves: several coordinates as functions of time, with their rates, and where a derivative jumps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, NamedTuple, Protocol, TypeVar, cast

import numpy as np

COMPONENTS = ("mx", "my", "mz", "fx", "fy", "fz")  # of a wrench, (moment; force), in files
DEFAULT_ORDER = 4  # q4d, which Q2d takes: up to it jumps are reported, and the rounding of samples is judged
MIN_JUMP_SHARE = 1e-9  # of the largest value: a smaller difference is rounding
INNER_SHARES = (0.2, 0.6)  # of a piece, between whose ends at rest its derivatives are not zero there
CURVE_POINTS = 64  # by which the size of the derivatives of a curve is judged
ROUNDING_OF_Q = 64 * np.finfo(float).eps  # share of q; k-th derivatives over a span h magnify it by h^-k

T = TypeVar("T")


class Jump(NamedTuple):
    """The lowest derivative of one column that jumps at a time."""

    t: float
    column: int
    order: int
    size: float  # by how much it jumps


def keep_by_order(method: Callable[[Any, int], T]) -> Callable[[Any, int], T]:
    """Return a method of a curve whose results are kept by order.

    It takes an order alone: it is computed once for each, as every call of a motion asks for it.
    """

    @wraps(method)
    def kept(self: Any, order: int) -> T:
        results = vars(self).setdefault("_by_order", {})
        # A method that extends another one of the same name has results of its own.
        key = method.__qualname__, order
        if key not in results:
            results[key] = method(self, order)
        return cast(T, results[key])

    return kept


class Curve(Protocol):
    """A function of time with values (columns,), from `start` to `stop`.

    Its callers ask for times between them.
    """

    @property
    def start(self) -> float:
        """The start time, s."""

    @property
    def stop(self) -> float:
        """The end time, s."""

    @property
    def columns(self) -> int:
        """The number of coordinates."""

    @property
    def highest(self) -> int | None:
        """The order of the last known derivative; None where all are known."""

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """Return the values (N, columns) and their derivatives up to `order`.

        At a jump they are those from the right, or from the left.
        """

    def jumps(self, order: int) -> list[Jump]:
        """Return where a derivative up to `order` jumps, in order of time."""

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Return the standard deviations of values and derivatives.

        None where they are exact.
        """


class SmoothCurve:
    """The defaults of a curve that is exact and without jumps."""

    def jumps(self, order: int) -> list[Jump]:
        """Return no jumps, up to the highest derivative that is known."""
        return []

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        """Return None: the curve is exact."""
        return None


@dataclass(frozen=True, eq=False)
class DerivedCurve:
    """The defaults of a curve that is made of a `base`."""

    base: Curve

    @property
    def start(self) -> float:
        return float(self.outer(np.array([self.base.start]))[0])

    @property
    def stop(self) -> float:
        return float(self.outer(np.array([self.base.stop]))[0])

    @property
    def columns(self) -> int:
        return self.base.columns

    @property
    def highest(self) -> int | None:
        return self.base.highest

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        return self.base.deviations(t, order)

    def inner(self, t: np.ndarray) -> np.ndarray:
        """Return the times of `base` at times t of the curve."""
        return t

    def outer(self, t: np.ndarray) -> np.ndarray:
        """Return the times of the curve at times t of `base`."""
        return t

    @keep_by_order
    def inner_jumps(self, order: int) -> np.ndarray:
        """Return the inner times at which a derivative up to `order` jumps."""
        return np.unique([jump.t for jump in self.base.jumps(order)])

    @keep_by_order
    def outer_jumps(self, order: int) -> np.ndarray:
        """Return the times at which the curve is at its `inner_jumps`."""
        return self.outer(self.inner_jumps(order))

    def inner_at_jumps(self, t: np.ndarray, order: int) -> np.ndarray:
        """Return the inner times, those of jumps without rounding.

        Rounding would lead to the other side of a jump.
        """
        inner, jumps = self.inner(t), self.inner_jumps(order)
        if jumps.size == 0:
            return inner
        outer = self.outer_jumps(order)
        next_jump = np.searchsorted(outer, t).clip(0, len(outer) - 1)
        return np.where(outer[next_jump] == t, jumps[next_jump], inner)


@dataclass(frozen=True, eq=False)
class ArrangedCurve(DerivedCurve):
    """Some columns of a curve, times factors.

    Column j is `factors[j]` times that of number `order[j]`, or 0 for -1.
    """

    order: np.ndarray
    factors: np.ndarray | float = 1.0

    @property
    def columns(self) -> int:
        return len(self.order)

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        return [self._arrange(rate) * self.factors for rate in self.base.rates(t, order, left)]

    def jumps(self, order: int) -> list[Jump]:
        factors = np.broadcast_to(self.factors, len(self.order)).tolist()
        place = {int(j): i for i, j in enumerate(self.order)}
        jumps = ((jump, place[jump.column]) for jump in self.base.jumps(order) if jump.column in place)
        return sorted(jump._replace(column=i, size=jump.size * factors[i]) for jump, i in jumps)

    def deviations(self, t: np.ndarray, order: int) -> list[np.ndarray] | None:
        deviations = self.base.deviations(t, order)
        return None if deviations is None else [self._arrange(rate) * np.abs(self.factors) for rate in deviations]

    def _arrange(self, rate: np.ndarray) -> np.ndarray:
        # Number -1 is the last column, of zeros.
        padded = np.pad(rate, ((0, 0), (0, 1))) if (self.order < 0).any() else rate
        return padded[:, self.order]


def find_jumps(
    t: np.ndarray,
    before: Sequence[np.ndarray],
    after: Sequence[np.ndarray],
    spans: np.ndarray,
    within: Sequence[np.ndarray],
) -> list[Jump]:
    """Return the jumps at times (m,), by derivatives from both sides.

    Derivatives (m, columns) are from the left and from the right, lowest order first.

    `spans` (m,) are the lengths of the pieces that meet there: what rounding does to their derivatives is no jump.
    `within` are derivatives (points, columns) inside of the pieces: at the times themselves a motion may rest at zero.
    """
    jumps: list[Jump] = []
    # A jump of a derivative makes all higher ones jump: only the lowest one counts.
    has_jumped = np.zeros(before[0].shape, dtype=bool)
    peaks = [np.abs(np.concatenate(parts)).max(axis=0, initial=0) for parts in zip(before, after, within, strict=True)]
    for k, (a, b) in enumerate(zip(before, after, strict=True)):
        floor = MIN_JUMP_SHARE * peaks[k] + ROUNDING_OF_Q * peaks[0] / spans[:, None] ** k
        new = (np.abs(b - a) > floor) & ~has_jumped
        jumps += [Jump(float(t[i]), int(j), k, float(b[i, j] - a[i, j])) for i, j in np.argwhere(new)]
        has_jumped |= new
    return sorted(jumps)


@dataclass(frozen=True, eq=False)
class Polynomials(SmoothCurve):
    """Piecewise polynomials, as scipy's PPoly.

    Breakpoints are x (m + 1,), coefficients c (degree + 1, m, columns). On the piece from x[i] to x[i + 1] the
    coefficients are those of powers of t - x[i], the highest power first.
    """

    x: np.ndarray
    c: np.ndarray
    highest: int | None = None

    @property
    def start(self) -> float:
        return float(self.x[0])

    @property
    def stop(self) -> float:
        return float(self.x[-1])

    @property
    def columns(self) -> int:
        return self.c.shape[2]

    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        piece = (np.searchsorted(self.x, t, side="left" if left else "right") - 1).clip(0, len(self.x) - 2)
        return evaluate_powers(self.c[:, piece], (t - self.x[piece])[:, None], order)

    @keep_by_order
    def jumps(self, order: int) -> list[Jump]:
        """Return where a derivative up to `order` jumps.

        It jumps between pieces that do not continue each other.
        """
        h = np.diff(self.x)
        before = evaluate_powers(self.c[:, :-1], h[:-1, None], order)
        after = evaluate_powers(self.c[:, 1:], np.zeros((len(h) - 1, 1)), order)
        inside = (evaluate_powers(self.c, share * h[:, None], order) for share in INNER_SHARES)
        within = [np.concatenate(parts) for parts in zip(*inside, strict=True)]
        return find_jumps(self.x[1:-1], before, after, np.maximum(h[:-1], h[1:]), within)


def sample_rates(curve: Curve, order: int) -> list[np.ndarray]:
    """Return rates of a curve at times between its ends.

    They are the values (points, columns) and their derivatives.
    """
    return curve.rates(np.linspace(curve.start, curve.stop, CURVE_POINTS + 2)[1:-1], order)


def evaluate_powers(c: np.ndarray, s: np.ndarray, order: int) -> list[np.ndarray]:
    """Return values and derivatives of polynomials at s (N, 1).

    Coefficients are c (degree + 1, N, columns), highest power first.
    """
    values = []
    for _ in range(order + 1):
        # Horner's scheme.
        value = c[0] + 0 * s
        for coefficient in c[1:]:
            value = value * s + coefficient
        values.append(value)
        # The coefficients of the derivative: each times its power, one power less. That of a constant is 0.
        degree = len(c) - 1
        c = c[:-1] * np.arange(degree, 0, -1)[:, None, None] if degree > 0 else 0 * c
    return values
