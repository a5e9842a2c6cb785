"""Forward dynamics: accelerations from forces, and their rates from the rates of the forces.

The rates of q from the second on are unknowns, each of them known when the next is computed: q is a series that asks
for its own terms.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from jounce.core.scalars import Array, zeros_like
from jounce.dynamics import drive_terms, loops
from jounce.dynamics.closed_form import closed_form
from jounce.dynamics.state import JointMotion, Law, State
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import OrthogonalFactors, solve_series
from jounce.spatial.series import Series


def solve_dense(m: Mechanism, q: Series, Q: Series, W: Series | None = None, base: JointMotion | None = None) -> Series:
    """(EOM1) for the accelerations: q2d = M^-1 (Q - C qd - Qgrav - Qext), with all its rates by Leibniz' rule.

    Those of a floating base, Vd, come first; the motion of the ground of a fixed robot is given.
    """
    moving = Series(lambda k: q[k] if k < 2 else found[k - 2][..., -m.n :, :])
    if m.floats and base:
        V = Series(lambda k: found[k - 1][..., :6, :] if k else V0)
        V0, base = base.V[0], replace(base, V=V)
    x = closed_form(m, moving, W, base)
    other = [term for term in m.acting if term != "armature"]
    M, taken = x.gM, x.bias
    if "armature" in m.acting:
        M = M + drive_terms.pad_base(m, drive_terms.armature_matrix(m), (-2, -1))
    if other:
        taken = taken + drive_terms.pad_base(m, drive_terms.forces(m, moving, other), (-2,))
    found = solve_series(M, Q - taken)
    return found


class Solver(Protocol):
    """The mass matrix at one position, ready to solve equations."""

    def solve(self, b: Array) -> Array:
        """X of M X = b, both (..., nv, m)."""


def solve_with_inverse_dynamics(
    M: Solver,
    inverse: Callable[[Series, JointMotion | None], Series],
    m: Mechanism,
    q: Series,
    Q: Series,
    base: JointMotion | None,
) -> Series:
    """q^(k+2) = M^-1 (Q^(k) - the k-th rate of inverse dynamics where q^(k+2) = 0): no rate of M is needed.

    Forces are affine in their highest rate of q, with the factor M. So they are in that of the twist of a floating
    base, V^(k+1), which belongs to the unknowns.
    """
    known, twists = [q[0], q[1]], [base.V[0]] if m.floats and base else []

    def term(k: int) -> Array:
        at_rest = Series.of([*known, zeros_like(q[1])])
        moving = replace(base, V=Series.of([*twists, zeros_like(twists[0])])) if twists and base else base
        found = M.solve(Q[k] - inverse(at_rest, moving)[k])
        known.append(found[..., -m.n :, :])
        if twists:
            twists.append(found[..., :6, :])
        return found

    return Series(term)


def passive_accelerations(m: Mechanism, x: State, mass_matrix: Law, inverse: Law) -> Series:
    """p^(k+2), (..., passive, 1), with which passive coordinates lack nothing: r = Q_p - F_p^T u vanishes.

    It is affine in p^(k+2), ``r^(k) = P p^(k+2) + r^(k) where p^(k+2) = 0``, with the same matrix P at all orders: that
    of columns of M in place of Q, M_pp where the other coordinates are those of the motors.
    """
    S, of_joints = np.eye(m.n, dtype=int)[:, loops.closure_of(m).passive], slice(m.nv - m.n, None)

    def lacking(x: State, Q: Series) -> Series:
        return loops.actuator_forces(m, loops.closed_motion(m, x).F, Q).map(lambda u: u[..., -S.shape[1] :, :])

    P = lacking(x, Series.of([mass_matrix(m, x)[0][..., of_joints, of_joints] @ S]))[0]
    factors = OrthogonalFactors.of(P, np.ones((S.shape[1], S.shape[1]), dtype=bool))
    known = [x.q[0], x.q[1]]

    def term(k: int) -> Array:
        held = x.q[k + 2] * (1 - S.sum(axis=1, keepdims=True))
        moving = replace(x, q=Series.of([*known, held]))
        Q = inverse(m, moving).map(lambda Q: Q[..., of_joints, None])
        found = -factors.solve(lacking(moving, Q)[k])
        known.append(held + S @ found)
        return found

    return Series(term)
