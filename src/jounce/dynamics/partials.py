"""Partial derivatives of forces extend to rates, accelerations and closed robots.

K, D and M are dQ/dq, dQ/dqd and dQ/dq2d along a motion: by the recursion (`recursion.force_partials`), or by the closed
form (`compute_dense_partials`). They and their rates are all the partial derivatives of all the rates of Q
(`extend_to_rates`), since a partial derivative and the time derivative d/dt commute but for one term:

    d(dx/dt)/dq^(j) = d/dt (dx/dq^(j)) + dx/dq^(j - 1)

A joint of several screws, as that of a base, is displaced by a twist d in its own axes, C exp(wedge(d)). With its
velocities held, such a displacement changes, which adds a term to the derivatives of rates by d, see `velocity_drift`.

Of closed robots (`closed_partials`), the coordinates of the tree are functions of the independent ones u, so that their
rates depend on those of u by ``d theta^(k) / d u^(j) = binom(k, j) F^(k - j)``. Of forces F^T Q with K, D, M, the
derivatives of Q on the tree,

    K_c = F^T ((K + H) F + D F' + M F''),    D_c = F^T (D F + 2 M F'),    M_c = F^T M F,

where F^T H F is the derivative of F^T with Q as it is. It follows from A F = 0: where cut joints exert y, A_d^T y =
Q_d, it is ``-y . (dA) F``. What the last body of a branch sees, with the wrench W of the cut joint on it and the screws
S of the joints, gives the branch's part,

    H_ik = (W . [S_k, S_i] if joint k is beyond joint i) - W . [P S_k, S_i],

with any constant projection P onto the twists that the cut joint allows. The first term is of the screws, which turn
with the joints beyond them; the second of W, which turns with the relative twist V = P V. Brackets of allowed twists
are allowed, so that W . [V, X] is the same of the twists X of both ends: the branches separate.
"""

from collections import defaultdict
from collections.abc import Sequence
from functools import reduce
from operator import add

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics import system
from jounce.dynamics.closed_form import closed_form
from jounce.dynamics.drive_terms import pad_base
from jounce.dynamics.loop_branches import Branch, LoopEnds
from jounce.dynamics.loops import ClosedMotion
from jounce.dynamics.state import JointMotion, velocity_drift
from jounce.dynamics.system import system_wrench_rate
from jounce.model import coordinates
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import Factors, mirror_triangle
from jounce.spatial.series import Series


def compute_dense_partials(
    m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None
) -> tuple[Series, Series, Series]:
    """Return K, D and M by the closed form.

    They are (..., nv, nv) each. Wrenches W on the bodies, (..., 6nb, 1), are fixed in them. A displacement dq of the
    coordinates moves the bodies by J dq. Seen from them, their twists change by the rate of J dq in space, and their
    forces accordingly. Forces turn with the bodies: those that joint j moves have turned as seen from the screw of a
    joint i that carries joint j.
    """
    x, bodies = closed_form(m, q, W, base), system.build_system(m)
    J, b, M = x.J, x.b, bodies.M
    P = M @ x.V
    # A displacement dq changes twists by J1 dq, J1 = (rates of the screws in space), and accelerations relative to free
    # fall by J2 dq.
    J1 = J.dot + b @ J
    J2 = J1.dot + b @ J1 + x.UG.map(system.system_b) @ J
    # B x = I' x + x x p: the change of the forces by a change of twists.
    B = -(b.mT @ M) - M @ b + P.map(system.system_wrench_rate)
    # The forces on the bodies and what they carry, S_i . (S_j x F): they turn with the bodies, which makes a difference
    # where joint i carries joint j.
    force = P.dot - b.mT @ P + M @ x.UG
    S = x.A @ bodies.S
    turned = S.mT @ (force if W is None else force + W).map(system.system_wrench_rate) @ S
    owner = np.repeat(np.arange(m.nb), [coordinates.body_screws(m, i).shape[-1] for i in range(m.nb)])
    outward = turned * (owner[:, None] < owner)
    K = J.mT @ (M @ J2 + B @ J1) + bodies.G.T @ outward @ bodies.G
    D = J.mT @ (2 * (M @ J1) + B @ J)
    a = velocity_drift(m, q, base)
    if a is None:
        return K, D, x.gM
    # So far, displacements d of joints of several screws were constant in their axes, so that their velocities changed
    # by a d, and their accelerations by a' d + a d'. Derivatives with velocities and accelerations held lack these
    # changes.
    D = D - x.gM @ a
    return K - D @ a - x.gM @ a.dot, D, x.gM


def extend_to_rates(K: Series, D: Series, M: Series, a: Series | None = None) -> Series:
    """Return P, whose k-th term has the partial derivatives of Q^(k): (..., 3 + k, nv, nv).

    They are those by q, qd, ..., q^(k+2). a is that of `velocity_drift`.
    """
    # rows[k] are the derivatives of the k-th rate of Q, as series.
    rows = [[K, D, M]]

    def term(k: int) -> Array:
        while len(rows) <= k:
            # Each derivative of the next rate is the rate of one of these plus the one before it, as the module's head
            # says: the first has none before it, but -P a, and the last is new.
            P = rows[-1]
            first = P[0].dot if a is None else P[0].dot - P[0] @ a
            rows.append([first, *(P[j].dot + P[j - 1] for j in range(1, len(P))), P[-1]])
        return concatenate([x[0][..., None, :, :] for x in rows[k]], axis=-3)

    return Series(term)


def acceleration_partials(P: Array) -> tuple[Array, Array, Array]:
    """Return dq2d/dq, dq2d/dqd and M^-1 from K, D and M.

    dq2d/dq = -M^-1 K and dq2d/dqd = -M^-1 D. P, (..., 3, nv, nv), holds K, D and M.
    """
    # One solution for the columns of all three.
    K, D, M = (P[..., j, :, :] for j in range(3))
    n = M.shape[-1]
    solution = Factors.of(M).solve(concatenate([-K, -D, np.eye(n, dtype=int)], axis=-1))
    return solution[..., :n], solution[..., n : 2 * n], mirror_triangle(solution[..., 2 * n :])


def second_acceleration_partials(first: Sequence[Array], of_forces: Sequence[Array]) -> tuple[Array, ...]:
    """Return the second derivatives of q2d by q, qd and Q.

    They are those by (q, q), (q, qd), (qd, qd) and (q, Q), (..., nv, nv, nv) each. `first` are its first derivatives,
    `of_forces` the second ones of the forces. With u and w among q, qd and Q and a = q2d,
    ``d2a/du dw = -M^-1 (d2Q/du dw + dM/du da/dw + dM/dw da/du)``.
    """
    (dq, dqd, Minv), (qq, qqd, qdqd, dM) = first, of_forces

    # dM/dq_j da/dw_k, of all j and k.
    def along(da: Array) -> Array:
        return dM @ da[..., None, :, :]

    # M depends on q alone; by (q, q) both terms of dM occur. (..., nv, nv, nv) -> (..., nv, nv^2) for one product.
    sums = qq + along(dq) + along(dq).mT, qqd + along(dqd), qdqd, along(Minv)
    n = Minv.shape[-1]
    return tuple((-Minv @ x.reshape((*x.shape[:-3], n, n * n))).reshape(x.shape) for x in sums)


def closed_partials(
    motion: ClosedMotion, of_tree: tuple[Series, Series, Series], Q: Series
) -> tuple[Series, Series, Series]:
    """Return K, D and M of a closed robot.

    They are (..., nv, nv) each, from those of its tree. Q, (..., nv, 1), are the forces on the tree.
    """
    (K, D, M), F = of_tree, motion.F
    # H, by the rate of F^T with Q as it is, is that of the loops that are solved, and of followers by polynomials.
    if motion.ends.m.loops:
        K = K + pad_base(motion.m, curvature(motion.ends, motion.multipliers(Q)), (-2, -1))
    if not motion.m.has_constant_ratios:
        K = K + pad_base(motion.m, motion.follower_curvature(Q), (-2, -1))
    by_position, by_velocity = K @ F + D @ F.dot + M @ F.dot.dot, D @ F + M @ F.dot * 2
    return F.mT @ by_position, F.mT @ by_velocity, (F.mT @ (M @ F)).map(mirror_triangle)


def curvature(ends: LoopEnds, y: Series) -> Series:
    """Return H, (..., N, N), where cut joints exert y.

    The shape is (..., c, 1).
    """
    # Per branch, summed over the loops that end on it: the matrices of x -> -ad(x)^T W, which give W . [x, S_i], of the
    # screws as they are and as the cut joint allows them.
    ends_of_branches = defaultdict[tuple[int, int], list[tuple[Branch, Series, Series]]](list)
    for branch, allowed, W in ends.end_wrenches(y):
        wrench_rate = W.map(system_wrench_rate)
        ends_of_branches[branch.key].append((branch, wrench_rate, wrench_rate @ allowed))
    total = Series.constant(np.zeros((ends.m.tree.n, ends.m.tree.n), dtype=int))
    for ends_of_branch in ends_of_branches.values():
        [branch, *_], *wrench_rates = zip(*ends_of_branch, strict=True)
        by_all, by_allowed = (reduce(add, parts) for parts in wrench_rates)
        # H_ik = (W . [S_k, S_i] if joint k is beyond joint i) - W . [P S_k, S_i], then from joints to coordinates.
        S, columns = ends.screws(branch), branch.columns
        is_beyond = np.tri(len(columns), k=-1, dtype=int).T
        total = total + columns.T @ (S.mT @ by_allowed @ S - (S.mT @ by_all @ S) * is_beyond) @ columns
    return total
