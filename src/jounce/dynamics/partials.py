"""Partial derivatives of forces of every order, and of accelerations, from those of the forces themselves.

K, D and M are dQ/dq, dQ/dqd and dQ/dq2d along a motion. They and their rates are all the partial derivatives of all the
rates of Q, since a partial derivative and the time derivative d/dt commute but for one term:

    d(dx/dt)/dq^(j) = d/dt (dx/dq^(j)) + dx/dq^(j - 1)

A joint of several screws, as that of a base, is displaced by a twist d in its own axes, C exp(wedge(d)). With its
velocities held, such a displacement changes, which adds a term to the derivatives of rates by d, see `turning`.
"""

from collections.abc import Sequence

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics import system
from jounce.dynamics.closed_form import closed_form
from jounce.dynamics.joint_motion import JointMotion, velocity_drift
from jounce.model.coordinates import body_screws
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import Factors, mirror_triangle
from jounce.spatial.series import Series


def compute_dense_partials(
    m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None
) -> tuple[Series, Series, Series]:
    """K, D and M by the closed form, (..., nv, nv) each, with wrenches W on the bodies, (..., 6nb, 1), fixed in them.

    A displacement dq of the coordinates moves the bodies by J dq. Seen from them, their twists change by the rate of
    J dq in space, and their forces accordingly. Forces turn with the bodies: those that joint j moves have turned as
    seen from the screw of a joint i that carries joint j.
    """
    x, bodies = closed_form(m, q, W, base), system.build_system(m)
    J, b, M = x.J, x.b, bodies.M
    P = M @ x.V
    J1 = J.dot + b @ J  # rates of the screws in space
    J2 = J1.dot + b @ J1 + x.UG.map(system.system_b) @ J  # relative to free fall
    B = -(b.mT @ M) - M @ b + P.map(system.system_wrench_rate)
    force = P.dot - b.mT @ P + M @ x.UG
    S = x.A @ bodies.S
    turned = S.mT @ (force if W is None else force + W).map(system.system_wrench_rate) @ S
    owner = np.repeat(np.arange(m.nb), [body_screws(m, i).shape[-1] for i in range(m.nb)])
    outward = turned * (owner[:, None] < owner)
    K = J.mT @ (M @ J2 + B @ J1) + bodies.G.T @ outward @ bodies.G
    D = J.mT @ (2 * (M @ J1) + B @ J)
    if (a := velocity_drift(m, q, base)) is None:
        return K, D, x.gM
    D = D - x.gM @ a  # so far, of displacements of the base that are constant, and change the components of its twist
    return K - D @ a - x.gM @ a.dot, D, x.gM


def extend_to_rates(K: Series, D: Series, M: Series, a: Series | None = None) -> Series:
    """P, whose k-th term has the partial derivatives of Q^(k) by q, qd, ..., q^(k+2): (..., 3 + k, nv, nv)."""
    rows = [[K, D, M]]

    def term(k: int) -> Array:
        while len(rows) <= k:
            P = rows[-1]
            first = P[0].dot if a is None else P[0].dot - P[0] @ a
            rows.append([first, *(P[j].dot + P[j - 1] for j in range(1, len(P))), P[-1]])
        return concatenate([x[0][..., None, :, :] for x in rows[k]], axis=-3)

    return Series(term)


def acceleration_partials(P: Array) -> tuple[Array, Array, Array]:
    """dq2d/dq = -M^-1 K, dq2d/dqd = -M^-1 D and M^-1 from K, D and M, (..., 3, nv, nv)."""
    K, D, M = (P[..., j, :, :] for j in range(3))
    n = M.shape[-1]
    solution = Factors.of(M).solve(concatenate([-K, -D, np.eye(n, dtype=int)], axis=-1))
    return solution[..., :n], solution[..., n : 2 * n], mirror_triangle(solution[..., 2 * n :])


def second_acceleration_partials(first: Sequence[Array], of_forces: Sequence[Array]) -> tuple[Array, ...]:
    """The derivatives of q2d by (q, q), (q, qd), (qd, qd), (q, Q), (..., nv, nv, nv) each, from its `first` ones."""
    (dq, dqd, Minv), (qq, qqd, qdqd, by_q) = first, of_forces

    def along(da: Array) -> Array:  # dM/dq_j da/dw_k
        return by_q @ da[..., None, :, :]

    sums = qq + along(dq) + along(dq).mT, qqd + along(dqd), qdqd, along(Minv)
    n = Minv.shape[-1]
    return tuple((-Minv @ x.reshape((*x.shape[:-3], n, n * n))).reshape(x.shape) for x in sums)
