"""Solve linear equations A x = b over any scalar type, and over time series.

Neither square roots nor pivots are needed.

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
        """Return the factors of a symmetric matrix, given by its lower triangle."""
        # From the last row up: d_k = A_kk, row k of L is a / d_k with a left of the diagonal, and what is left of
        # the matrix is A - a^T a / d_k. The mask keeps the upper triangle from being computed.
        rows: list[tuple[Array, Array]] = []
        for k in reversed(range(A.shape[-1])):
            a, inverse_d = A[..., k, :k], reciprocal(A[..., k, k : k + 1])
            rows.insert(0, (a * inverse_d, inverse_d))
            A = A[..., :k, :k] - rows[0][0][..., :, None] * a[..., None, :] * np.tri(k, dtype=int)
        L, inverse_D = zip(*rows, strict=True)
        return cls(L, inverse_D)

    def solve(self, b: Array) -> Array:
        """Return X of A X = b, both (..., n, m)."""
        # L^T z = b from the last row up, and D y = z at once.
        scaled: list[Array] = []
        for row, inverse_d in zip(reversed(self.L), reversed(self.inverse_D), strict=True):
            b, last = b[..., :-1, :], b[..., -1:, :]
            scaled.insert(0, last * inverse_d[..., None])
            b = b - row[..., :, None] * last
        # L X = y from the first row down.
        X = scaled[0]
        for row, y in zip(self.L[1:], scaled[1:], strict=True):
            X = concatenate([X, y - row[..., None, :] @ X], axis=-2)
        return X


@dataclass(frozen=True)
class OrthogonalFactors:
    """The factors Q R of a matrix (..., c, d) of rank d <= c.

    The columns are in an order that keeps zeros.
    """

    order: Sequence[int]  # of the columns
    Q: tuple[Array, ...]  # columns (..., c, 1), orthogonal to each other
    inverse_Q: tuple[Array, ...]  # rows (..., 1, c), of the inverse of Q
    R: tuple[Array, ...]  # row k right of the diagonal, (..., 1, d - 1 - k); the diagonal is 1
    masks: tuple[np.ndarray, ...]  # (c, 1), 0 in the row that a column of one entry leaves empty, else 1

    @classmethod
    def of(cls, A: Array, pattern: np.ndarray) -> "OrthogonalFactors":
        """Return the factors of a matrix with a pattern of zeros.

        The matrix is zero where the pattern, (c, d) of bool, is False.
        """
        # Modified Gram-Schmidt: each column in the order is perpendicular to those before it by now, and is taken out
        # of all that follow.
        steps = elimination_order(pattern)
        order = [j for j, _ in steps]
        A = A[..., order]
        Q, inverse_Q, R, masks = list[Array](), list[Array](), list[Array](), list[np.ndarray]()
        for _, row in steps:
            column, A = A[..., :1], A[..., 1:]
            mask = np.ones((len(pattern), 1), dtype=int)
            if row is None:
                inverse_Q.append(reciprocal(column.mT @ column) * column.mT)
            else:
                # A column of one entry: its inverse is exact, and so are the zeros that it leaves in its row.
                mask[row] = 0
                unit = 1 - mask
                column, pivot = column * unit, column[..., row : row + 1, :]
                inverse_Q.append(reciprocal(pivot) * unit.T)
            masks.append(mask)
            Q.append(column)
            R.append(inverse_Q[-1] @ A)
            A = (A - column @ R[-1]) * mask
        return cls(order, tuple(Q), tuple(inverse_Q), tuple(R), tuple(masks))

    @property
    def places(self) -> Sequence[int]:
        """The place of each column in the order."""
        return np.argsort(self.order).tolist()

    def solve(self, b: Array) -> Array:
        """Return X (..., d, m) of A X = b, (..., c, m), which is solvable."""
        # y = Q^-1 b as in the factorization, column by column; then R X = y from the last row up.
        parts: list[Array] = []
        for column, inverse, mask in zip(self.Q, self.inverse_Q, self.masks, strict=True):
            parts.append(inverse @ b)
            b = (b - column @ parts[-1]) * mask
        X = parts[-1]
        for part, row in zip(reversed(parts[:-1]), reversed(self.R[:-1]), strict=True):
            X = concatenate([part - row @ X, X], axis=-2)
        return X[..., self.places, :]

    def solve_transposed(self, b: Array) -> Array:
        """Return the shortest Y (..., c, m) of A^T Y = b, (..., d, m)."""
        # R^T z = b from the first row down; then Y is the sum of columns of Q^-T times z.
        b, parts = b[..., self.order, :], list[Array]()
        for row in self.R:
            first, b = b[..., :1, :], b[..., 1:, :]
            b = b - row.mT @ first
            parts.append(first)
        Y = self.inverse_Q[-1].mT @ parts[-1]
        # Each part is corrected by the columns added so far, since rounding leaves columns not quite orthogonal.
        other_columns = zip(reversed(self.Q[:-1]), reversed(self.inverse_Q[:-1]), reversed(parts[:-1]), strict=True)
        for column, inverse, part in other_columns:
            Y = Y + inverse.mT @ (part - column.mT @ Y)
        return Y


def elimination_order(pattern: np.ndarray) -> list[tuple[int, int | None]]:
    """Return an order of matrix columns that keeps many zeros.

    With each column comes the row of its only entry, None if it has more entries. An entry that is alone in its column
    is never zero where the rank is full. The row that it leaves needs no more columns; other columns fill each other's
    rows, those with few entries first.
    """
    nonzero, steps = pattern.copy(), list[tuple[int, int | None]]()
    open_columns = list(range(pattern.shape[1]))
    while len(open_columns) > 0:
        j = min(open_columns, key=lambda j: nonzero[:, j].sum())
        open_columns.remove(j)
        rows = np.flatnonzero(nonzero[:, j])
        steps.append((j, int(rows[0]) if len(rows) == 1 else None))
        if len(rows) == 1:
            # Its row is eliminated exactly.
            nonzero[rows] = False
        else:
            # Columns that overlap get entries in all of its rows.
            for other in open_columns:
                if nonzero[rows, other].any():
                    nonzero[rows, other] = True
    return steps


class Factored(Protocol):
    """A matrix A that is factored, with which equations A X = b are solved."""

    def solve(self, b: Array) -> Array:
        """Return X of A X = b, both (..., n, m)."""


@singledispatch
def factor(A: Array) -> Factored:
    """Return the factors of a symmetric positive definite matrix.

    Other kinds of arrays may register a rule of their own.
    """
    return Factors.of(A)


def solve_series(A: Series, B: Series) -> Series:
    """Return X of A X = B with its rates, with A factored once.

    A X[k] = B[k] - sum over j >= 1 of binom(k, j) A[j] X[k - j].
    """
    factors: list[Factored] = []

    def term(k: int) -> Array:
        if not factors:
            factors.append(factor(A[0]))
        right_side = B[k]
        for j in range(1, k + 1):
            right_side = right_side - comb(k, j) * (A[j] @ X[k - j])
        return factors[0].solve(right_side)

    X = Series(term)
    return X


def mirror_triangle(x: Array) -> Array:
    """Return a symmetric matrix with both triangles from the upper.

    Traced, two entries are one expression then.
    """
    upper = np.tri(x.shape[-1], dtype=int).T
    return x * upper + x.mT * (1 - upper)
