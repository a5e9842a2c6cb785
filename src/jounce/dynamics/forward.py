"""Forward dynamics: accelerations from forces, and their rates from the rates of the forces.

The rates of q from the second on are unknowns, each of them known when the next is computed: q is a series that asks
for its own terms.
"""

from collections.abc import Callable
from typing import Protocol

from jounce._scalars import Array, zeros_like
from jounce.dynamics import drive_terms
from jounce.dynamics.closed_form import closed_form
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import solved
from jounce.spatial.series import Series


def dense(m: Mechanism, q: Series, Q: Series, W: Series | None = None) -> Series:
    """(EOM1) for the accelerations: q2d = M^-1 (Q - C qd - Qgrav - Qext), with all its rates by Leibniz' rule."""
    moving = Series(lambda k: q[k] if k < 2 else q2d[k - 2])
    x = closed_form(m, moving, W)
    other = [term for term in m.acting if term != "armature"]
    M = x.gM + drive_terms.armature_matrix(m) if "armature" in m.acting else x.gM
    taken = x.gC @ moving.dot + x.Qgrav + x.Qext
    q2d = solved(M, Q - (taken + drive_terms.forces(m, moving, other) if other else taken))
    return q2d


class Solver(Protocol):
    """The mass matrix at one position, ready to solve equations."""

    def solve(self, b: Array) -> Array:
        """X of M X = b, both (..., n, m)."""


def from_inverse(M: Solver, inverse: Callable[[Series], Series], q: Series, Q: Series) -> Series:
    """q^(k+2) = M^-1 (Q^(k) - the k-th rate of inverse dynamics where q^(k+2) = 0): no rate of M is needed.

    Forces are affine in their highest rate of q, with the factor M.
    """
    known = [q[0], q[1]]

    def term(k: int) -> Array:
        bias = inverse(Series.of([*known, zeros_like(q[0])]))[k]
        known.append(M.solve(Q[k] - bias))
        return known[-1]

    return Series(term)
