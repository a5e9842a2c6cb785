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
    """Solve (EOM1) for the accelerations, with rates.

    q2d = M^-1 (Q - C qd - Qgrav - Qext). Accelerations of a floating base, Vd, come first; the motion of the ground of
    a fixed robot is given.
    """
    # q whose rates from the second on are the results. A rate of the bias takes rates of q that are known by then.
    moving = Series(lambda k: q[k] if k < 2 else accelerations[k - 2][..., -m.n :, :])
    if m.floats and base:
        V = Series(lambda k: accelerations[k - 1][..., :6, :] if k else V0)
        V0, base = base.V[0], replace(base, V=V)
    x = closed_form(m, moving, W, base)
    # Armature adds to M, all other drive terms to the forces that the motion takes without accelerations.
    terms_of_forces = [term for term in m.acting if term != "armature"]
    M, bias = x.gM, x.bias
    if "armature" in m.acting:
        M = M + drive_terms.pad_base(m, drive_terms.armature_matrix(m), (-2, -1))
    if len(terms_of_forces) > 0:
        bias = bias + drive_terms.pad_base(m, drive_terms.forces(m, moving, terms_of_forces), (-2,))
    accelerations = solve_series(M, Q - bias)
    return accelerations


class Solver(Protocol):
    """The mass matrix at one position, ready to solve equations."""

    def solve(self, b: Array) -> Array:
        """Return X of M X = b, both (..., nv, m)."""


def solve_with_inverse_dynamics(
    M: Solver,
    inverse: Callable[[Series, JointMotion | None], Series],
    m: Mechanism,
    q: Series,
    Q: Series,
    base: JointMotion | None,
) -> Series:
    """Return accelerations with rates from those of inverse dynamics: no rate of M is needed.

    q^(k+2) = M^-1 (Q^(k) - R), where R is the k-th rate of inverse dynamics with q^(k+2) = 0. Forces are affine in
    their highest rate of q, with the factor M. So they are in that of the twist of a floating base, V^(k+1), which
    belongs to the unknowns.
    """
    known_rates, twists = [q[0], q[1]], [base.V[0]] if m.floats and base else []

    # Each order runs inverse dynamics once, with the rates of q found so far and zero for the next one.
    def term(k: int) -> Array:
        without_highest = Series.of([*known_rates, zeros_like(q[1])])
        moving_base = base
        if len(twists) > 0 and base is not None:
            moving_base = replace(base, V=Series.of([*twists, zeros_like(twists[0])]))
        highest = M.solve(Q[k] - inverse(without_highest, moving_base)[k])
        # (..., nv, 1): rates of the base's twist, then those of q.
        known_rates.append(highest[..., -m.n :, :])
        if len(twists) > 0:
            twists.append(highest[..., :6, :])
        return highest

    return Series(term)


def passive_accelerations(m: Mechanism, x: State, mass_matrix: Law, inverse: Law) -> Series:
    """Return p^(k+2), (..., passive, 1), with which passive coordinates lack no force.

    What they lack is r = Q_p - F_p^T u. It is affine in p^(k+2), ``r^(k) = P p^(k+2) + r^(k) where p^(k+2) = 0``, with
    the same matrix P at all orders: that of columns of M in place of Q, M_pp where the other coordinates are those of
    the motors.
    """
    S, joints = np.eye(m.n, dtype=int)[:, loops.closure_of(m).passive], slice(m.nv - m.n, None)

    # r, the last rows of the forces that motors and passive coordinates would have to exert for Q.
    def lacking_forces(x: State, Q: Series) -> Series:
        return loops.actuator_forces(m, loops.closed_motion(m, x).F, Q).map(lambda u: u[..., -S.shape[1] :, :])

    # P once, for all orders: its columns are r where one passive acceleration is 1.
    P = lacking_forces(x, Series.of([mass_matrix(m, x)[0][..., joints, joints] @ S]))[0]
    factors = OrthogonalFactors.of(P, np.ones((S.shape[1], S.shape[1]), dtype=bool))
    known_rates = [x.q[0], x.q[1]]

    def term(k: int) -> Array:
        # The given rates of motor coordinates, zeros at passive ones; then what these need to lack nothing.
        without_passive = x.q[k + 2] * (1 - S.sum(axis=1, keepdims=True))
        moving = replace(x, q=Series.of([*known_rates, without_passive]))
        Q = inverse(m, moving).map(lambda Q: Q[..., joints, None])
        passive_rates = -factors.solve(lacking_forces(moving, Q)[k])
        known_rates.append(without_passive + S @ passive_rates)
        return passive_rates

    return Series(term)
