"""Linear equations A x = b over any scalar type, and over time series; neither square roots nor pivots are needed.

Symmetric positive definite A are taken as L^T D L, from the last row to the first: for the mass matrix of a tree
without fill-in (Featherstone, Rigid Body Dynamics Algorithms, 6.3). Others, of full column rank, are taken as Q R with
columns of Q that are orthogonal (modified Gram-Schmidt); rows may be redundant.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch
from math import comb
from typing import Protocol

import numpy as np

from jounce.core.scalars import Array, concatenate, reciprocal
from jounce.spatial.series import Series


@dataclass(frozen=True)
class Factors:
    """The factors L^T D L of a matrix (..., n, n)."""

    L: tuple[Array, ...]  # row k left of the diagonal, (..., k); the diagonal is 1
    inverse_D: tuple[Array, ...]  # (..., 1) each

    @classmethod
    def of(cls, A: Array) -> "Factors":
        """The factors of a symmetric matrix, of which the lower triangle is read."""
        rows: list[tuple[Array, Array]] = []
        for k in reversed(range(A.shape[-1])):
            a, inverse_d = A[..., k, :k], reciprocal(A[..., k, k : k + 1])
            rows.insert(0, (a * inverse_d, inverse_d))
            A = A[..., :k, :k] - rows[0][0][..., :, None] * a[..., None, :] * np.tri(k, dtype=int)
        L, inverse_D = zip(*rows, strict=True)
        return cls(L, inverse_D)

    def solve(self, b: Array) -> Array:
        """X of A X = b, both (..., n, m)."""
        scaled: list[Array] = []
        for row, inverse_d in zip(reversed(self.L), reversed(self.inverse_D), strict=True):
            b, last = b[..., :-1, :], b[..., -1:, :]
            scaled.insert(0, last * inverse_d[..., None])
            b = b - row[..., :, None] * last
        X = scaled[0]
        for row, y in zip(self.L[1:], scaled[1:], strict=True):
            X = concatenate([X, y - row[..., None, :] @ X], axis=-2)
        return X


@dataclass(frozen=True)
class OrthogonalFactors:
    """The factors Q R of a matrix (..., c, d) of rank d <= c, with its columns in an order that keeps zeros."""

    order: Sequence[int]  # of the columns
    Q: tuple[Array, ...]  # columns (..., c, 1), orthogonal to each other
    inverse_Q: tuple[Array, ...]  # rows (..., 1, c), of the inverse of Q
    R: tuple[Array, ...]  # row k right of the diagonal, (..., 1, d - 1 - k); the diagonal is 1
    rest: tuple[np.ndarray, ...]  # (c, 1), 0 where a column is the only one in a row, which it leaves empty; else 1

    @classmethod
    def of(cls, A: Array, pattern: np.ndarray) -> "OrthogonalFactors":
        """The factors of a matrix that is zero where its pattern, (c, d) of bool, is False."""
        steps = elimination_order(pattern)
        order = [j for j, _ in steps]
        A = A[..., order]
        Q, inverse_Q, R, rest = list[Array](), list[Array](), list[Array](), list[np.ndarray]()
        for _, row in steps:
            column, A = A[..., :1], A[..., 1:]
            rest.append(np.ones((len(pattern), 1), dtype=int))
            if row is None:
                inverse_Q.append(reciprocal(column.mT @ column) * column.mT)
            else:  # of one entry: its inverse is exact, and so are the zeros that are left
                rest[-1][row] = 0
                own = 1 - rest[-1]
                column, pivot = column * own, column[..., row : row + 1, :]
                inverse_Q.append(reciprocal(pivot) * own.T)
            Q.append(column)
            R.append(inverse_Q[-1] @ A)
            A = (A - column @ R[-1]) * rest[-1]
        return cls(order, tuple(Q), tuple(inverse_Q), tuple(R), tuple(rest))

    @property
    def places(self) -> Sequence[int]:
        """Where each column stands in the order."""
        return np.argsort(self.order).tolist()

    def solve(self, b: Array) -> Array:
        """X (..., d, m) of A X = b, (..., c, m), which is solvable."""
        parts: list[Array] = []
        for column, inverse, rest in zip(self.Q, self.inverse_Q, self.rest, strict=True):
            parts.append(inverse @ b)
            b = (b - column @ parts[-1]) * rest
        X = parts[-1]
        for part, row in zip(reversed(parts[:-1]), reversed(self.R[:-1]), strict=True):
            X = concatenate([part - row @ X, X], axis=-2)
        return X[..., self.places, :]

    def solve_transposed(self, b: Array) -> Array:
        """Y (..., c, m) of A^T Y = b, (..., d, m), the shortest one."""
        b, parts = b[..., self.order, :], list[Array]()
        for row in self.R:
            first, b = b[..., :1, :], b[..., 1:, :]
            b = b - row.mT @ first
            parts.append(first)
        Y = self.inverse_Q[-1].mT @ parts[-1]
        rest = zip(reversed(self.Q[:-1]), reversed(self.inverse_Q[:-1]), reversed(parts[:-1]), strict=True)
        for column, inverse, part in rest:  # Q^T Y once more: rounding leaves the columns not quite orthogonal
            Y = Y + inverse.mT @ (part - column.mT @ Y)
        return Y


def elimination_order(pattern: np.ndarray) -> list[tuple[int, int | None]]:
    """An order of the columns of a matrix (c, d) that keeps many zeros, with the row of those that have but one entry.

    An entry that is alone in its column is never zero where the rank is full. The row that it leaves needs no more
    columns; other columns fill each other's rows, those with few entries first.
    """
    left, steps = pattern.copy(), list[tuple[int, int | None]]()
    open_ = list(range(pattern.shape[1]))
    while open_:
        j = min(open_, key=lambda j: left[:, j].sum())
        open_.remove(j)
        places = np.flatnonzero(left[:, j])
        steps.append((j, int(places[0]) if len(places) == 1 else None))
        if len(places) == 1:
            left[places] = False
        else:
            for other in open_:
                if left[places, other].any():
                    left[places, other] = True
    return steps


class Factored(Protocol):
    """A matrix A that is factored, with which equations A X = b are solved."""

    def solve(self, b: Array) -> Array:
        """X of A X = b, both (..., n, m)."""


@singledispatch
def factor(A: Array) -> Factored:
    """The factors of a symmetric positive definite matrix: other kinds of arrays may register a rule of their own."""
    return Factors.of(A)


def solve_series(A: Series, B: Series) -> Series:
    """X of A X = B with its rates: A X[k] = B[k] - sum of binom(k, j) A[j] X[k - j], with A factored once."""
    factors: list[Factored] = []

    def term(k: int) -> Array:
        if not factors:
            factors.append(factor(A[0]))
        rest = B[k]
        for j in range(1, k + 1):
            rest = rest - comb(k, j) * (A[j] @ X[k - j])
        return factors[0].solve(rest)

    X = Series(term)
    return X


def mirror_triangle(x: Array) -> Array:
    """A symmetric matrix, each entry below the diagonal that above: traced, they are one expression, not two."""
    upper = np.tri(x.shape[-1], dtype=int).T
    return x * upper + x.mT * (1 - upper)
