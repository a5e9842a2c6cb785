"""Series: a quantity together with its time derivatives at one instant, and the product rule.

``S[k]`` is the k-th time derivative. With ``@`` and ``*`` as Leibniz' rule, an equation written once for the values
holds for all the derivatives, to any order. Terms are computed when they are first asked for, and kept: a formula costs
what is asked of it.
"""

from collections.abc import Callable, Sequence
from functools import cache
from math import comb
from typing import Any

import numpy as np

from jounce.core.scalars import Array, check_recording, concatenate, zeros_like

RATE_SUFFIX = r"(d|[2-9]d|[1-9]\d+d)?"  # what `rate_name` adds to a symbol, as a regular expression


def rate_name(symbol: str, k: int) -> str:
    """Return the name of the k-th time derivative: q, qd, q2d, q3d, ..."""
    if k == 0:
        return symbol
    return f"{symbol}d" if k == 1 else f"{symbol}{k}d"


class Series:
    """The time derivatives S[0], S[1], ... of an array."""

    __slots__ = ("_term", "_terms")
    __array_ufunc__ = None  # array @ Series is ours, not NumPy's

    def __init__(self, term: Callable[[int], Array]):
        self._term = term
        self._terms: list[Array] = []

    @classmethod
    def of(cls, terms: Sequence[Array]) -> "Series":
        """Return the series of given derivatives, which has no further terms."""
        return cls(tuple(terms).__getitem__)

    @classmethod
    def constant(cls, value: Array) -> "Series":
        """Return the series of a quantity that does not change."""
        return cls(lambda k: zeros_like(value) if k else value)

    def __getitem__(self, k: int) -> Array:
        # Terms are computed in their order, each once, since many rules take lower terms of the same series.
        while len(self._terms) <= k:
            term = self._term(len(self._terms))
            check_recording(term)  # here no loop of NumPy is under way
            self._terms.append(term)
        return self._terms[k]

    def upto(self, order: int) -> tuple[Array, ...]:
        """Return S[0] .. S[order]."""
        return tuple(self[k] for k in range(order + 1))

    def map(self, linear: Callable[[Array], Array]) -> "Series":
        """Return the series of a constant linear map of S."""
        return Series(lambda k: linear(self[k]))

    @property
    def unkept(self) -> "Series":
        """The same series, whose terms are not kept if they are numbers.

        For large matrices, memory counts more than time.
        """
        return _Unkept(self._term)

    @property
    def dot(self) -> "Series":
        """The time derivative of S, a series again."""
        return Series(lambda k: self[k + 1])

    @property
    def mT(self) -> "Series":
        """S with its last two axes exchanged."""
        return self.map(lambda S: S.mT)

    def __neg__(self) -> "Series":
        return self.map(lambda S: -S)

    def __add__(self, other: Any) -> "Series":
        if isinstance(other, Series):
            return _Sum(self, other)
        # A constant adds to the value alone.
        return Series(lambda k: self[k] if k else self[0] + other)

    def __sub__(self, other: Any) -> "Series":
        return self + -other

    def __matmul__(self, other: Any) -> "Series":
        if isinstance(other, Series):
            return _leibniz(self, other, lambda S, T: S @ T)
        return self.map(lambda S: S @ other)

    def __rmatmul__(self, other: Array) -> "Series":
        return self.map(lambda S: other @ S)

    def __mul__(self, other: Any) -> "Series":
        if isinstance(other, Series):
            return _leibniz(self, other, lambda S, T: S * T)
        return self.map(lambda S: S * other)

    def __rmul__(self, other: Any) -> "Series":
        return self.map(lambda S: other * S)


class _Sum(Series):
    """The sum of two series.

    Of sums of sums, as over bodies, the first are evaluated first, so that no call nests.
    """

    __slots__ = ("_first",)

    def __init__(self, first: Series, second: Series):
        super().__init__(lambda k: first[k] + second[k])
        self._first = first

    def __getitem__(self, k: int) -> Array:
        # Go down the chain of first summands to one that has the term, and evaluate the others on the way back. Each
        # finds the terms of its own first summand computed, so that a chain of thousands takes no deeper calls.
        waiting, first = list[Series](), self._first
        while isinstance(first, _Sum) and len(first._terms) <= k:
            waiting.append(first)
            first = first._first
        for part in reversed(waiting):
            Series.__getitem__(part, k)
        return super().__getitem__(k)


class _Unkept(Series):
    """A series whose numbers are computed each time; expressions are kept.

    Expressions cost more time than memory.
    """

    __slots__ = ()

    def __getitem__(self, k: int) -> Array:
        if k < len(self._terms):
            return self._terms[k]
        term = self._term(k)
        check_recording(term)
        if k == len(self._terms) and not (isinstance(term, np.ndarray) and term.dtype == np.float64):
            self._terms.append(term)
        return term


def _leibniz(S: Series, T: Series, product: Callable[[Array, Array], Array]) -> Series:
    """Return the product of two series: (S T)^(k) = sum over j of binom(k, j) S^(j) T^(k - j)."""

    def term(k: int) -> Array:
        total = product(S[0], T[k])
        for j in range(1, k + 1):
            # The last coefficient is 1, and would be one more operation on symbols.
            factor = S[j] if j == k else comb(k, j) * S[j]
            total = total + product(factor, T[k - j])
        return total

    return Series(term)


def product_rate(S: np.ndarray, T: np.ndarray, k: int) -> np.ndarray:
    """Return the k-th time derivative of ``S @ T``.

    S and T are stacked along the first axis with their derivatives. One product of arrays takes the place of k + 1
    products, which take longer where matrices of numbers are small.
    """
    # (k + 1, ...) binom(k, j) S[j] times T[k - j], the derivatives of T in reverse order.
    weights = _binomials(k).reshape((-1,) + (1,) * (S.ndim - 1))
    return np.asarray((weights * S[: k + 1] @ T[k::-1]).sum(axis=0))


def with_rates(x: np.ndarray, order: int) -> np.ndarray:
    """Return an array and zeros for its derivatives, stacked.

    They are those up to `order`, along the first axis.
    """
    stacked = np.zeros((order + 1, *x.shape))
    stacked[0] = x
    return stacked


@cache
def _binomials(k: int) -> np.ndarray:
    return np.array([comb(k, j) for j in range(k + 1)], dtype=float)


def from_rate(S0: Array, f: Callable[[Series], Series]) -> Series:
    """Return the series with S[0] = S0 and dS/dt = f(S)."""

    # f(S) is made when the first rate is computed: then S exists, and term k of f(S) takes S[0] .. S[k] only.
    @cache
    def rate() -> Series:
        return f(S)

    S = Series(lambda k: rate()[k - 1] if k else S0)
    return S


def from_rates(first: Callable[[int], Array], f: Callable[[Series], Series]) -> Series:
    """Return the first series of a family of coupled series.

    S_k[0] = first(k) and dS_k/dt = S_(k+1) + f(S_k). k counts rates of an input. S_0[k] takes S_1[k - 1], ..., S_k[0]:
    they are computed from the last one, so that no call nests deeper than one.
    """
    rows: list[Series] = []
    corrections: list[Series] = []

    def row(k: int) -> Series:
        return Series(lambda i: rows[k + 1][i - 1] + corrections[k][i - 1] if i else first(k))

    def term(k: int) -> Array:
        rows.append(row(k))
        corrections.append(f(rows[k]))
        for j in reversed(range(1, k + 1)):
            rows[j][k - j]
        return rows[0][k]

    # Each new term of S_0 adds a row to the family, and extends the rows before it by one term, the last row first.
    S = Series(term)
    S[0]  # at once: generated code has its steps in the order in which they are computed
    return S


def join_series(parts: Sequence[Series], axis: int) -> Series:
    """Return the series of parts joined along an axis.

    The axis is counted from the end.
    """
    return Series(lambda k: concatenate([part[k] for part in parts], axis=axis))


def column_series(terms: Sequence[Array]) -> Series:
    """Return q, qd, ... (..., n) as a series of columns."""
    return Series.of([term[..., None] for term in terms])


def wrench_columns(terms: Sequence[Array]) -> Series:
    """Return W, Wd, ... (..., nb, 6) as a series of columns."""
    return Series.of([term.reshape((*term.shape[:-2], 6 * term.shape[-2], 1)) for term in terms])


def diagonal(blocks: Array) -> Array:
    """Return the matrix with blocks along its diagonal.

    Blocks are (..., m, k, l), the matrix is (..., m k, m l). It is linear, as `Series.map` needs.
    """
    # (..., m, k, 1, l) * (m, 1, m, 1) -> (..., m, k, m, l): zeros but for the block of each row and column.
    *lead, m, k, length = blocks.shape
    spread = blocks[..., :, :, None, :] * np.eye(m, dtype=int)[:, None, :, None]
    return spread.reshape((*lead, m * k, m * length))
