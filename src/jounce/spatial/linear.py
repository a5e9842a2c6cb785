"""Linear equations A x = b of symmetric positive definite matrices, over any scalar type, and over time series.

A is taken as L^T D L, from its last row to its first: without square roots, and for the mass matrix of a tree without
fill-in (Featherstone, Rigid Body Dynamics Algorithms, 6.3).
"""

from dataclasses import dataclass
from math import comb

import numpy as np

from jounce._scalars import Array, concatenate, reciprocal
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


def solved(A: Series, B: Series) -> Series:
    """X of A X = B with its rates: A X[k] = B[k] - sum of binom(k, j) A[j] X[k - j], with A factored once."""
    factors: list[Factors] = []

    def term(k: int) -> Array:
        if not factors:
            factors.append(Factors.of(A[0]))
        rest = B[k]
        for j in range(1, k + 1):
            rest = rest - comb(k, j) * (A[j] @ X[k - j])
        return factors[0].solve(rest)

    X = Series(term)
    return X


def mirrored(x: Array) -> Array:
    """A symmetric matrix, each entry below the diagonal that above: traced, they are one expression, not two."""
    upper = np.tri(x.shape[-1], dtype=int).T
    return x * upper + x.mT * (1 - upper)
