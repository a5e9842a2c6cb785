"""Second partial derivatives of the generalized forces, from the bodies that the outermost of three joints carries.

Of three joints on one branch, let o be the outermost, and S_j, Y_j = S_j', Z_j, T_j = Y_j + S_j' the screws of a joint j
on the way to it as `force_partials` has them: how they move with a displacement, their acceleration A, and what their
velocity adds to the acceleration. All are seen from o. With the inertia I of the bodies that o carries and their
momentum p, ``B x = I' x + x x p``, and

    P = S_o x I - I S_o x,    L = P + [I S_o],    R = S_o x B - B S_o x + (Y_o x I - I Y_o x + [I Y_o]),

the changes of I and of B with the velocity of o and with its displacement, and ``[h] x = x x h``, the derivatives of
the force of joint i by coordinates j and k, where j is k or carries it, are for k = o beyond i

    d2Q_i/dq_j dq_k   = S_i . (P Z_j + R Y_j + (S_j x (I Z_o + B Y_o + S_o x F) if j is beyond i)),
    d2Q_i/dq_j dqd_k  = S_i . (L Y_j + (S_j x (I T_o + B S_o) if j is beyond i)),
    d2Q_i/dqd_j dq_k  = S_i . (P T_j + R S_j),      d2Q_i/dqd_j dqd_k  = S_i . L S_j,
    d2Q_i/dq_j dq2d_k = S_i . (S_j x I S_o if j is beyond i),    d2Q_i/dq2d_j dq_k = S_i . P S_j,

and for i = o their likes by I S_o, B^T S_o. They are the derivatives of K and D by rotating everything beyond a joint.
Displacements by screws of one joint do not commute, of which the first taken is the first index.

[1] S. Singh, R. P. Russell, P. M. Wensing, On second-order derivatives of rigid-body dynamics: theory and
implementation, arXiv:2302.06001, whose Psi', Psi'' are Y, Z.
"""

from collections.abc import Sequence
from functools import reduce
from operator import add

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics.joint_motion import JointMotion
from jounce.dynamics.recursion.force_partials import CarriedBodies, ScrewWrenches, carry_screws
from jounce.dynamics.recursion.joints import MovingJoint, batch_zeros
from jounce.dynamics.recursion.sweeps import owners_of_screws
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import from_moment_matrix
from jounce.spatial.lie import ad
from jounce.spatial.series import Series

Columns = list[Array]  # S, Y, Z, T of the joints on the way to one, (..., 6, d) each


def second_partials(
    m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None
) -> tuple[Array, ...]:
    """The derivatives of Q by (q, q), (q, qd), (qd, qd) and (q, q2d), (..., nv, nv, nv) each."""
    tree, bodies, screws, steps = carry_screws(m, q, W, base)
    for k in range(2):
        for step in steps:
            step[k]
    owners, columns, found = owners_of_screws(tree.joints), list[Columns](), []
    paths = list[list[int]]()
    for i, (joint, x, on) in enumerate(zip(tree.joints, screws, bodies, strict=True)):
        own, way = [*np.flatnonzero(owners == i)], [] if joint.parent < 0 else paths[joint.parent]
        paths.append([*way, *own])
        columns.append(_seen_from(joint, x, columns[joint.parent] if way else None))
        order = owners[paths[i]]
        for s in range(len(own)):
            blocks = _blocks(joint, x, on, s, columns[i], order)
            found.append([_spread(block, paths[i], len(owners)) for block in blocks])
    zeros = batch_zeros(q)[0][..., None]
    stacks = [concatenate([x[..., None, :, :] for x in blocks], axis=-3) + zeros for blocks in zip(*found, strict=True)]
    by_force, by_first, by_second = stacks[:4], stacks[4:8], stacks[8:]
    return tuple(
        _generalized(a + b.swapaxes(-3, -2) + c.swapaxes(-3, -2).mT, tree.G)
        for a, b, c in zip(by_force, by_first, by_second, strict=True)
    )


def _seen_from(joint: MovingJoint, x: ScrewWrenches, inner: Columns | None) -> Columns:
    """The columns of a joint: those of the joints that carry it, in its body frame, and its own."""
    own = [x.screws.S[0], x.screws.moving[0], x.screws.A[0], (x.screws.S_rate + x.screws.moving)[0]]
    if inner is None:
        return own
    return [concatenate([joint.twists(Series.constant(a))[0], b], axis=-1) for a, b in zip(inner, own, strict=True)]


def _blocks(
    joint: MovingJoint, x: ScrewWrenches, on: CarriedBodies, s: int, columns: Columns, order: np.ndarray
) -> list[Array]:
    """Where screw s of a joint is the outermost: the four derivatives with it as i, as the first, as the second index.

    The two other indices are rows and columns, which run over the screws in `columns`, of joints in `order`.
    """
    (S, Y, Z, T), I = columns, from_moment_matrix(on.Pi[0])
    B = from_moment_matrix(x.Pi_rate[0]) + _bracket(on.p[0])
    S_o, Y_o, T_o, ad_S = *(a[..., -len(joint.ad_X) + s, None] for a in (S, Y, T)), joint.ad_X[s]
    p, r, z = (a[0][..., s, None] for a in (x.momentum, x.reaction, x.change))
    P, p_x, r_x, y_x, z_x = _turn(ad_S, I), *map(_bracket, (p, r, I @ T_o + B @ S_o, z))
    L, R = P + p_x, _turn(ad_S, B) + _turn(ad(Y_o[..., 0]), I) + _bracket(I @ Y_o)
    inner, same, before = order < order[-1], order[:, None] == order, order[:, None] < order
    rows, both = inner[:, None], inner[:, None] & inner
    # The outermost is the force: bilinear forms of what displaces or moves the two others.
    p_S, of_rates, SLS, SPS, SpS = p_x @ S, (p_x - P) @ Y + r_x @ S, S.mT @ L @ S, S.mT @ P @ S, S.mT @ p_x @ S
    qq = Z.mT @ p_S + Y.mT @ of_rates
    qqd = _choose(before, T.mT @ p_S + S.mT @ of_rates, -(S.mT @ L @ Y)).mT
    qdqd = -_choose(same, SPS, _choose(before, SLS.mT, SLS))
    force = [_choose(before, qq, qq.mT), qqd, qdqd, (SpS * before).mT]
    # The outermost is a coordinate: wrenches on what it carries, on the screws of the force.
    by_q = (S.mT @ (P @ Z + R @ Y) + (S.mT @ z_x @ S) * before) * rows
    by_qd = (SLS + (S.mT @ I @ ad_S @ S) * ~inner) * rows
    first = [by_q, (S.mT @ (P @ T + R @ S)) * both, by_qd, SPS * both]
    second = [by_q * both, (S.mT @ L @ Y + (S.mT @ y_x @ S) * before) * rows, by_qd * both, SpS * before * rows]
    return [*force, *first, *second]


def _turn(x: Array, I: Array) -> Array:
    """x x I - I x x: the rate of a form I of twists that moves with a twist, of which x is the ad."""
    return -(x.mT @ I + I @ x)


def _bracket(h: Array) -> Array:
    """[h], of which [h] x = x x h: (..., 6, 6) of a wrench (..., 6, 1)."""
    return -(ad(np.eye(6, dtype=int)).mT @ h[..., None, :, :])[..., 0].mT


def _choose(condition: np.ndarray, x: Array, y: Array) -> Array:
    """The entries of x where a condition holds, those of y elsewhere."""
    return x * condition + y * ~condition


def _spread(block: Array, path: Sequence[int], size: int) -> Array:
    """A block among all screws, zeros in the place of others."""
    place = np.full(size, len(path))
    place[[*path]] = np.arange(len(path))
    padded = concatenate([block, 0 * block[..., :1]], axis=-1)
    return concatenate([padded, 0 * padded[..., :1, :]], axis=-2)[..., place[:, None], place]


def _generalized(T: Array, G: Array) -> Array:
    """A tensor of all screws as one of coordinates."""
    if np.array_equal(G, np.eye(*G.shape, dtype=int)):
        return T
    return (G.T @ (G.T @ T @ G).swapaxes(-3, -2)).swapaxes(-3, -2)
