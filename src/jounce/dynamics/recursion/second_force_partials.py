"""Second partial derivatives of the generalized forces, from the bodies that the outermost of three joints carries.

Derivatives differ from 0 where the joints of the force and of both coordinates are on one branch. Let o be the
outermost of them. Seen from o, let S be the screws of the joints on the way to it; Y and Z be S' and A of
`force_partials`, how the screws move and accelerate as they are displaced; T be Y and the rate of S, 2 Y of joints of
one screw. With the inertia M of the bodies that o carries, their momentum p and force F, and with [h] x = x x h,

    B = M' + [p],   P = S_o x M - M S_o x,   L = P + [M S_o],   R = S_o x B - B S_o x + Y_o x M - M Y_o x + [M Y_o]:

P is the change of M by a displacement of o, L and R are those of B by its velocity and by a displacement. Where k is o,
beyond i, and j carries k or is k, turning everything beyond a joint gives

    d2Q_i/dq_j dq_k   = S_i . (P Z_j + R Y_j + (S_j x (M Z_o + B Y_o + S_o x F) where j is beyond i)),
    d2Q_i/dq_j dqd_k  = S_i . (L Y_j + (S_j x (M T_o + B S_o) where j is beyond i)),
    d2Q_i/dqd_j dq_k  = S_i . (P T_j + R S_j),      d2Q_i/dqd_j dqd_k  = S_i . L S_j,
    d2Q_i/dq2d_j dq_k = S_i . P S_j,                d2Q_i/dq_j dq2d_k = S_i . (S_j x M S_o where j is beyond i),

and where i = o their likes of M S_o and B^T S_o. Displacements by screws of one joint do not commute: the derivative by
the first index is taken first.

S. Singh, R. P. Russell, P. M. Wensing, "On Second-Order Derivatives of Rigid-Body Dynamics: Theory & Implementation",
arXiv:2302.06001: Y and Z are its first and second rates of Psi.
"""

from collections.abc import Sequence

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics.recursion.force_partials import CarriedBodies, ScrewWrenches, carry_screws
from jounce.dynamics.recursion.joints import MovingJoint, batch_zeros
from jounce.dynamics.recursion.sweeps import owners_of_screws
from jounce.dynamics.state import JointMotion
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
    for step in steps:
        step[0]
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
    (S, Y, Z, T), M = columns, from_moment_matrix(on.Pi[0])
    B = from_moment_matrix(x.Pi_rate[0]) + _bracket(on.p[0])
    S_o, Y_o, T_o, ad_S = *(a[..., -len(joint.ad_X) + s, None] for a in (S, Y, T)), joint.ad_X[s]
    p, r, z = (a[0][..., s, None] for a in (x.momentum, x.reaction, x.change))
    P, p_x, r_x, y_x, z_x = _turn(ad_S, M), *map(_bracket, (p, r, M @ T_o + B @ S_o, z))
    L, R = P + p_x, _turn(ad_S, B) + _turn(ad(Y_o[..., 0]), M) + _bracket(M @ Y_o)
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
    by_qd = (SLS + (S.mT @ M @ ad_S @ S) * ~inner) * rows
    first = [by_q, (S.mT @ (P @ T + R @ S)) * both, by_qd, SPS * both]
    second = [by_q * both, (S.mT @ L @ Y + (S.mT @ y_x @ S) * before) * rows, by_qd * both, SpS * before * rows]
    return [*force, *first, *second]


def _turn(x: Array, M: Array) -> Array:
    """x x M - M x x: the rate of a form M of twists that moves with a twist, of which x is the ad."""
    return -(x.mT @ M + M @ x)


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
