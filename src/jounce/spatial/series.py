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
    """The name of the k-th time derivative: q, qd, q2d, q3d, ..."""
    return symbol + ("" if k == 0 else "d" if k == 1 else f"{k}d")


class Series:
    """The time derivatives S[0], S[1], ... of an array, given by a function of their order."""

    __slots__ = ("_term", "_terms")
    __array_ufunc__ = None  # array @ Series is ours, not NumPy's

    def __init__(self, term: Callable[[int], Array]):
        self._term = term
        self._terms: list[Array] = []

    @classmethod
    def of(cls, terms: Sequence[Array]) -> "Series":
        """The series of given derivatives; no further ones can be asked for."""
        return cls(tuple(terms).__getitem__)

    @classmethod
    def constant(cls, value: Array) -> "Series":
        """The series of a quantity that does not change."""
        return cls(lambda k: zeros_like(value) if k else value)

    def __getitem__(self, k: int) -> Array:
        while len(self._terms) <= k:
            term = self._term(len(self._terms))
            check_recording(term)  # here no loop of NumPy is under way
            self._terms.append(term)
        return self._terms[k]

    def upto(self, order: int) -> tuple[Array, ...]:
        """S[0] .. S[order]."""
        return tuple(self[k] for k in range(order + 1))

    def map(self, linear: Callable[[Array], Array]) -> "Series":
        """The series of a constant linear map of S."""
        return Series(lambda k: linear(self[k]))

    @property
    def unkept(self) -> "Series":
        """S, whose terms are not kept if they are numbers: of large matrices, memory counts more than time."""
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
    """The sum of two series. Of sums of sums, as over bodies, the first are evaluated first, so that no call nests."""

    __slots__ = ("_first",)

    def __init__(self, first: Series, second: Series):
        super().__init__(lambda k: first[k] + second[k])
        self._first = first

    def __getitem__(self, k: int) -> Array:
        waiting, first = list[Series](), self._first
        while isinstance(first, _Sum) and len(first._terms) <= k:
            waiting.append(first)
            first = first._first
        for part in reversed(waiting):
            Series.__getitem__(part, k)
        return super().__getitem__(k)


class _Unkept(Series):
    """A series whose numbers are computed whenever they are asked for; expressions cost more than their memory."""

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
    def term(k: int) -> Array:
        total = product(S[0], T[k])
        for j in range(1, k + 1):
            total = total + product(S[j] if j == k else comb(k, j) * S[j], T[k - j])
        return total

    return Series(term)


def product_rate(S: np.ndarray, T: np.ndarray, k: int) -> np.ndarray:
    """The k-th time derivative of ``S @ T`` from derivatives of both, stacked along the first axis.

    One product of arrays takes the place of k + 1 products, which take longer where matrices of numbers are small.
    """
    weights = _binomials(k).reshape((-1,) + (1,) * (S.ndim - 1))
    return np.asarray((weights * S[: k + 1] @ T[k::-1]).sum(axis=0))


def with_rates(x: np.ndarray, order: int) -> np.ndarray:
    """An array and its derivatives up to `order`, still zeros, stacked along the first axis."""
    stacked = np.zeros((order + 1, *x.shape))
    stacked[0] = x
    return stacked


@cache
def _binomials(k: int) -> np.ndarray:
    return np.array([comb(k, j) for j in range(k + 1)], dtype=float)


def from_rate(S0: Array, f: Callable[[Series], Series]) -> Series:
    """The series with S[0] = S0 and dS/dt = f(S)."""

    @cache
    def rate() -> Series:
        return f(S)

    S = Series(lambda k: rate()[k - 1] if k else S0)
    return S


def from_rates(first: Callable[[int], Array], f: Callable[[Series], Series]) -> Series:
    """The series S_0 of those with S_k[0] = first(k) and dS_k/dt = S_(k+1) + f(S_k), where k counts rates of an input.

    S_0[k] takes S_1[k - 1], ..., S_k[0]: they are computed from the last one, so that no call nests deeper than one.
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

    S = Series(term)
    S[0]  # at once: generated code has its steps in the order in which they are computed
    return S


def join_series(parts: Sequence[Series], axis: int) -> Series:
    """The series of the parts joined along an axis (counted from the end)."""
    return Series(lambda k: concatenate([part[k] for part in parts], axis=axis))


def column_series(terms: Sequence[Array]) -> Series:
    """q, qd, q2d, ... of shape (..., n) as a series of columns (..., n, 1), the shape that matrices multiply."""
    return Series.of([term[..., None] for term in terms])


def wrench_columns(terms: Sequence[Array]) -> Series:
    """W, Wd, ... of the bodies (..., nb, 6) as a series of columns (..., 6nb, 1)."""
    return Series.of([term.reshape((*term.shape[:-2], 6 * term.shape[-2], 1)) for term in terms])


def diagonal(blocks: Array) -> Array:
    """Blocks (..., m, k, l) along the diagonal of a matrix (..., m k, m l); linear, as `Series.map` needs."""
    *lead, m, k, length = blocks.shape
    spread = blocks[..., :, :, None, :] * np.eye(m, dtype=int)[:, None, :, None]
    return spread.reshape((*lead, m * k, m * length))
