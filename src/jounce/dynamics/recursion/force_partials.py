"""Projected wrenches give first and second partial derivatives of forces.

First ones, with rates (`partials`). The coordinate of joint j displaces the bodies that the joint carries along its
screw S_j. With a prime for the rate in space, S' = ad(V) S and S'' the rates of a screw, g the field of gravity, and of
the bodies that joint j carries the inertia I_j, the momentum p_j and the force F_j, the partial derivatives of the
forces of the joint variables are, where joint i carries joint j or is j itself,

    K_ij = S_i . (I_j A_j + B_j S_j' + S_j x F_j),    K_ji = (I_j S_j) . A_i + (B_j^T S_j) . S_i',
    D_ji = 2 (I_j S_j) . S_i' + (B_j^T S_j) . S_i,    D_ij = 2 M_ij' - D_ji,

where ``A = S'' + S x g`` and ``B x = I' x + x x p``. Wrenches on the bodies, fixed in them, are part of F.

A joint of several screws, as that of a base that floats, is displaced along them while the components of its own
velocities nu are held. Its screws then move as if they were fixed on its parent: with ``S_p' = ad(V_p) S`` in the
places of S' and S'' in the equations of K, in those of D in the place of one S' of two, ``D - M alpha``. The forces of
such a joint turn with it, so that S_j x F_j is no part of its own block K_jj.

Second ones, without rates (`second_partials`), come from the bodies that the outermost of three joints carries: they
differ from 0 where the joints of the force and of both coordinates are on one branch. Let o be the outermost of them.
Seen from o, let S be the screws of the joints on the way to it; Y and Z be S' and A of the first derivatives, how the
screws move and accelerate as they are displaced; T be Y and the rate of S, 2 Y of joints of one screw. With the inertia
M of the bodies that o carries, their momentum p and force F, and with [h] x = x x h,

    B = M' + [p],   P = S_o x M - M S_o x,   L = P + [M S_o],   R = S_o x B - B S_o x + Y_o x M - M Y_o x + [M Y_o]:

P is the change of M by a displacement of o, L and R are those of B by its velocity and by a displacement. Where k is o,
beyond i, and j carries k or is k, turning everything beyond a joint gives

    d2Q_i/dq_j dq_k   = S_i . (P Z_j + R Y_j + (S_j x (M Z_o + B Y_o + S_o x F) where j is beyond i)),
    d2Q_i/dq_j dqd_k  = S_i . (L Y_j + (S_j x (M T_o + B S_o) where j is beyond i)),
    d2Q_i/dqd_j dq_k  = S_i . (P T_j + R S_j),      d2Q_i/dqd_j dqd_k  = S_i . L S_j,
    d2Q_i/dq2d_j dq_k = S_i . P S_j,                d2Q_i/dq_j dq2d_k = S_i . (S_j x M S_o where j is beyond i),

and where i = o their likes of M S_o and B^T S_o. Displacements by screws of one joint do not commute: the derivative by
the first index is taken first.

How often what runs: `carry_screws` and the projections once per evaluation; `_blocks` once per screw of each joint, on
matrices of the screws on the way to it.

`carry_screws` computes what both take: the joints, what each carries, and what its screws require of that.

Singh, Russell, Wensing, "Efficient Analytical Derivatives of Rigid-Body Dynamics Using Spatial Vector Algebra", IEEE
Robotics and Automation Letters 7(2), 2022; "On Second-Order Derivatives of Rigid-Body Dynamics: Theory &
Implementation", arXiv:2302.06001: Y and Z are its first and second rates of Psi.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Self

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics.recursion.forces import shift_wrenches
from jounce.dynamics.recursion.joints import FreeJoint, MovingJoint, batch_zeros
from jounce.dynamics.recursion.tree import (
    KinematicTree,
    collect,
    composites,
    evaluate_in_order,
    join_rows,
    kinematic_tree,
    mask_above,
    owners_of_screws,
    spread_columns,
    velocities,
)
from jounce.dynamics.state import JointMotion
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import from_moment_matrix, moment_matrix
from jounce.spatial.lie import ad, cowedge, wedge
from jounce.spatial.series import Series

Partials = tuple[Series, Series, Series]  # K, D, M: by q, qd and q2d
Columns = list[Array]  # S, Y, Z, T of the joints on the way to one, (..., 6, d) each


@dataclass(frozen=True)
class CarriedBodies:
    """The bodies that a joint carries, as one, in its body frame."""

    Pi: Series  # (..., 4, 4) moments of mass
    p: Series  # (..., 6, 1) momentum
    load: Series | None = None  # (..., 6, 1) wrenches on them

    def force(self, V: Series, field: Series) -> Series:
        """Return F that moves the bodies with the twist V.

        F, (..., 6, 1), acts against gravity and the load.
        """
        # p' in space, less the weight, which is I g of the field of gravity as an acceleration.
        F = self.p.dot + _cross(V, self.p) - _wrench(field.map(_wedge) @ self.Pi)
        return F if self.load is None else F + self.load


@dataclass(frozen=True)
class Screws:
    """The screws S of a joint with their rates.

    S is (..., 6, k), in the body frame of the joint.
    """

    S: Series
    S_rate: Series
    moving: Series  # S' where it moves with a displacement of the joint
    A: Series


@dataclass(frozen=True)
class ScrewWrenches:
    """The wrenches that the screws S of a joint require.

    They act on the bodies that the joint carries. There is a column for each screw, in the body frame of the joint.
    """

    screws: Screws
    Pi_rate: Series  # of the bodies, in space, (..., 4, 4)
    momentum: Series  # I S
    reaction: Series  # B^T S
    change: Series  # I A + B S' + S x F
    turned: Series  # S x F; zero where no joint precedes this one

    @classmethod
    def of(cls, joint: MovingJoint, V: Series, V_parent: Series | None, field: Series, bodies: CarriedBodies) -> Self:
        """Compute the wrenches of a joint and the bodies that it carries.

        V and field are seen from its body. `V_parent` is the twist of its parent as seen from the body, None at rest.
        """
        # The rate of the moments of mass in space: Pi' + wedge(V) Pi + Pi wedge(V)^T.
        flow = V.map(_wedge) @ bodies.Pi
        Pi_rate, F = bodies.Pi.dot + flow + flow.mT, bodies.force(V, field)
        # A displacement of the joint moves its screws with the body or, of several screws, with the parent.
        A = joint.screw_rate(_carrier_acceleration(joint, V, V_parent, field))
        V_carrier = V_parent if isinstance(joint, FreeJoint) else V
        if V_carrier is None:
            # At rest S_p' = 0; and S x F enters nowhere, since it turns with the joint and no joint precedes it.
            moving = turned = Series.constant(0 * joint.X)
            change = _momenta([(A, bodies.Pi)])
        else:
            moving, turned = joint.screw_rate(V_carrier), joint.cross(F)
            A = A + V_carrier.map(_ad) @ moving
            change = _momenta([(A, bodies.Pi), (moving, Pi_rate)]) + _cross(moving, bodies.p) + turned
        screws = Screws(Series.constant(joint.X), joint.screw_rate(V), moving, A)
        reaction = joint.momentum(Pi_rate) - joint.cross(bodies.p)
        return cls(screws, Pi_rate, joint.momentum(bodies.Pi), reaction, change, turned)


@dataclass(frozen=True)
class ScrewProducts:
    """The products of a joint's screws with wrenches of carried joints.

    There is a column for each screw of these, its own among them.
    """

    M: Series
    by_place: Series  # K_ji
    change: Series  # K_ij
    by_rate: Series  # D_ji of joints of one screw
    counted_twice: Series  # what D_ji of others has less

    @classmethod
    def of(cls, x: Screws, momenta: Series, reactions: Series, changes: Series) -> Self:
        """Multiply the screws by wrenches transported to the joint.

        These are (..., 6, columns) each.
        """
        along = x.S_rate.mT @ momenta
        return cls(
            M=(x.S.mT @ momenta).unkept,
            by_place=(x.A.mT @ momenta + x.moving.mT @ reactions).unkept,
            change=(x.S.mT @ changes).unkept,
            by_rate=(along * 2 + x.S.mT @ reactions).unkept,
            counted_twice=(x.S_rate - x.moving).mT @ momenta,
        )

    @property
    def D(self) -> Series:
        """D_ij of joints that are carried."""
        return self.M.dot * 2 - self.by_rate


def partials(m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None) -> Partials:
    """Return K, D and M of the generalized forces.

    They are (..., nv, nv) each. Wrenches W on the bodies, (..., 6nb, 1), are fixed in them.
    """
    tree, _, screws, steps = carry_screws(m, q, W, base)
    return _project_partials(tree, q, screws, steps)


def carry_screws(
    m: Mechanism, q: Series, W: Series | None, base: JointMotion | None
) -> tuple[KinematicTree[MovingJoint], list[CarriedBodies], list[ScrewWrenches], list[Series]]:
    """Return the tree, carried bodies, screw wrenches, and steps to them.

    The steps are in the order of evaluation.
    """
    chain = minimal_mechanism(m)
    tree = kinematic_tree(chain, q, base)
    joints = tree.joints
    # Outward: twists and the field of gravity. Inward: moments of mass, momenta and loads of what each joint carries.
    V, field = velocities(joints), _gravity(joints, chain.gravity)
    Pi = composites(joints, [Series.constant(Pi_i) for Pi_i in moment_matrix(tree.M)], MovingJoint.moments)
    p = composites(joints, [M_i @ V_i for M_i, V_i in zip(tree.M, V, strict=True)], MovingJoint.wrenches)
    loads: Sequence[Series | None] = [None] * len(joints)
    if W is not None:
        # A ground that moves is a body ahead of those of the mechanism, without a load.
        on_bodies = shift_wrenches(m, chain, W)
        on_ground = [0 * on_bodies[0]] * (len(joints) - len(on_bodies))
        loads = composites(joints, on_ground + on_bodies, MovingJoint.wrenches)
    bodies, screws = [CarriedBodies(*x) for x in zip(Pi, p, loads, strict=True)], []
    for i, joint in enumerate(joints):
        V_parent = joint.twists(V[joint.parent]) if isinstance(joint, FreeJoint) and joint.parent >= 0 else None
        screws.append(ScrewWrenches.of(joint, V[i], V_parent, field[i], bodies[i]))
    # Accelerations of screws and forces take these rates.
    rates = [x.dot for x in (*V, *Pi[::-1], *p[::-1])]
    return tree, bodies, screws, [*V, *field, *Pi[::-1], *p[::-1], *rates]


def _carrier_acceleration(joint: MovingJoint, V: Series, V_parent: Series | None, field: Series) -> Series:
    """Return the acceleration of a joint's screws as they are displaced.

    It is relative to free fall. It is that of the body or, of several screws, of the parent.
    """
    if not isinstance(joint, FreeJoint):
        return V.dot - field
    if V_parent is None:
        return -field
    # The twist of the parent as the body sees it changes by its own rate and by the motion of the joint.
    return V_parent.dot + (joint.X @ joint.rate).map(_ad) @ V_parent - field


def _project_partials(
    tree: KinematicTree[MovingJoint], q: Series, screws: Sequence[ScrewWrenches], before: Sequence[Series]
) -> Partials:
    """Transport wrenches of joints inward, and project them onto screws."""
    joints = tree.joints
    # Inward: of each joint (..., 6, columns) of the joints that it carries, once for I S, B^T S and I A + B S' + S x F.
    momenta, reactions, changes = (
        collect(joints, [getattr(x, wrench) for x in screws]) for wrench in ("momentum", "reaction", "change")
    )
    rows = [
        ScrewProducts.of(x.screws, *(wrenches.values for wrenches in columns))
        for x, *columns in zip(screws, momenta, reactions, changes, strict=True)
    ]
    # Rows of all joints make upper triangles (..., columns, columns): entries ij where joint i carries joint j.
    M, K, by_place, D, by_rate = (
        join_rows([getattr(row, part) for row in rows], momenta) for part in ("M", "change", "by_place", "D", "by_rate")
    )
    # Entries ji, below the diagonal, from products of screw i with the wrenches of screw j.
    K = K + mask_above(by_place, joints).mT
    D = D + mask_above(by_rate, joints).mT
    # Corrections of joints of several screws, whose own velocities are held as they are displaced.
    for E, joint, x, row, momentum_columns in zip(_places(joints), joints, screws, rows, momenta, strict=True):
        # D_ji takes S_p' in the place of one S' of two.
        if isinstance(joint, FreeJoint):
            D = D - (E @ spread_columns(row.counted_twice, momentum_columns.screws, len(E))).mT
        # D - M alpha, above the diagonal; and the forces of the joint turn with it, so that S x F is no part of K_jj. A
        # joint on the ground has no rows above its own, and S x F was left out of its wrenches.
        if isinstance(joint, FreeJoint) and joint.parent >= 0:
            alpha = joint.X.T @ (joint.X @ joint.rate).map(_ad) @ joint.X
            D = D - mask_above(M @ E @ alpha @ E.T, joints)
            K = K - E @ (joint.X.T @ x.turned) @ E.T
    steps = list(before)
    for columns_of_joints in (momenta, reactions, changes):
        steps += [column.values for column in reversed(columns_of_joints)]
    # D has the rate of M, and so that of the momenta.
    steps_to_D = [*steps, *(column.values.dot for column in reversed(momenta))]

    def project_to_coordinates(matrix: Series, steps: Sequence[Series]) -> Series:
        return evaluate_in_order(tree.generalized_matrix(matrix + batch_zeros(q)), steps)

    M = M + mask_above(M, joints).mT
    return project_to_coordinates(K, steps), project_to_coordinates(D, steps_to_D), project_to_coordinates(M, steps)


def _places(tree: Sequence[MovingJoint]) -> list[Array]:
    """Return the columns of the unit matrix that select each joint."""
    sizes = [joint.X.shape[-1] for joint in tree]
    return np.split(np.eye(sum(sizes), dtype=int), np.cumsum(sizes)[:-1], axis=1)


def _gravity(tree: Sequence[MovingJoint], gravity: Array) -> list[Series]:
    """Return the field of gravity as a twist of each body.

    It moves as a twist that is constant in space.
    """
    ground = Series.constant(concatenate([0 * gravity, gravity], axis=-1)[:, None])
    field: list[Series] = []
    for joint in tree:
        field.append(joint.twists(ground if joint.parent < 0 else field[joint.parent]))
    return field


def _momenta(pairs: Sequence[tuple[Series, Series]]) -> Series:
    """Return the sum of I X over pairs of X and I.

    X are screws, (..., 6, k), I are moments of mass. Momenta of moments of mass are wedge(X) Pi, of which `cowedge`
    takes the six numbers.
    """
    # The usual joint of one screw needs no axis for its screws.
    if pairs[0][0][0].shape[-1] == 1:
        return _wrench(reduce(add, [X.map(_wedge) @ Pi for X, Pi in pairs]))
    # (..., 6, k) -> (..., k, 4, 4) -> (..., 6, k).
    parts = [X.map(lambda X: wedge(X.mT)) @ Pi.map(lambda Pi: Pi[..., None, :, :]) for X, Pi in pairs]
    return reduce(add, parts).map(lambda T: cowedge(T).mT)


def _wrench(T: Series) -> Series:
    """Return the wrench (..., 6, 1) of a product wedge(X) Pi.

    The shape is (..., 4, 4).
    """
    return T.map(lambda x: cowedge(x)[..., None])


def _cross(X: Series, wrench: Series) -> Series:
    """Return X x W, the rates of wrenches that move with screws.

    X x W = -ad(X)^T W, (..., 6, k).
    """
    if X[0].shape[-1] == 1:
        return -(X.map(_ad).mT @ wrench)
    screws = X.map(lambda X: ad(X.mT).mT)
    return -(screws @ wrench.map(lambda W: W[..., None, :, :])).map(lambda W: W[..., 0].mT)


def _ad(X: Array) -> Array:
    return ad(X[..., 0])


def _wedge(X: Array) -> Array:
    return wedge(X[..., 0])


# Second partial derivatives.
def second_partials(
    m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None
) -> tuple[Array, ...]:
    """Return the four second derivatives of Q.

    They are those by (q, q), (q, qd), (qd, qd) and (q, q2d), (..., nv, nv, nv) each.
    """
    tree, carried_bodies, screws, steps = carry_screws(m, q, W, base)
    # Values alone, step by step, which bounds the depth of Python's recursion.
    for step in steps:
        step[0]
    # Outward over the joints o that are the outermost of three: the screws on the way to o, seen from o, and twelve
    # blocks for each screw of o, which is the force, the first or the second coordinate of four derivatives.
    owners, columns, blocks_of_screws = owners_of_screws(tree.joints), list[Columns](), []
    paths = list[list[int]]()
    for i, (joint, x, bodies) in enumerate(zip(tree.joints, screws, carried_bodies, strict=True)):
        screws_of_joint = [*np.flatnonzero(owners == i)]
        path_to_parent = [] if joint.parent < 0 else paths[joint.parent]
        paths.append([*path_to_parent, *screws_of_joint])
        columns.append(_seen_from(joint, x, columns[joint.parent] if len(path_to_parent) > 0 else None))
        order = owners[paths[i]]
        for s in range(len(screws_of_joint)):
            blocks = _blocks(joint, x, bodies, s, columns[i], order)
            blocks_of_screws.append([_spread(block, paths[i], len(owners)) for block in blocks])
    # Twelve tensors (..., o, screws, screws), whose first axis is that of the outermost screw; the axes then change
    # places to (force, first, second).
    zeros = batch_zeros(q)[0][..., None]
    stacks = [
        concatenate([x[..., None, :, :] for x in blocks], axis=-3) + zeros
        for blocks in zip(*blocks_of_screws, strict=True)
    ]
    by_force, by_first, by_second = stacks[:4], stacks[4:8], stacks[8:]
    return tuple(
        _generalized(a + b.swapaxes(-3, -2) + c.swapaxes(-3, -2).mT, tree.G)
        for a, b, c in zip(by_force, by_first, by_second, strict=True)
    )


def _seen_from(joint: MovingJoint, x: ScrewWrenches, parent_columns: Columns | None) -> Columns:
    """Return the columns of a joint: those of the joints that carry it, and its own, in its body frame."""
    own_columns = [x.screws.S[0], x.screws.moving[0], x.screws.A[0], (x.screws.S_rate + x.screws.moving)[0]]
    if parent_columns is None:
        return own_columns
    pairs = zip(parent_columns, own_columns, strict=True)
    return [concatenate([joint.twists(Series.constant(a))[0], b], axis=-1) for a, b in pairs]


def _blocks(
    joint: MovingJoint, x: ScrewWrenches, bodies: CarriedBodies, s: int, columns: Columns, order: np.ndarray
) -> list[Array]:
    """Return the derivatives whose outermost joint has the screw s.

    There are four each with screw s as force, as first and as second index. The two other indices are rows and columns,
    which run over the screws in `columns`, of joints in `order`.
    """
    # Of the bodies that o carries: M, B, and with the screw o: P, L, R, and [.] of its wrenches, as in the module's
    # head.
    (S, Y, Z, T), M = columns, from_moment_matrix(bodies.Pi[0])
    B = from_moment_matrix(x.Pi_rate[0]) + _bracket(bodies.p[0])
    S_o, Y_o, T_o, ad_S = *(a[..., -len(joint.ad_X) + s, None] for a in (S, Y, T)), joint.ad_X[s]
    p, r, z = (a[0][..., s, None] for a in (x.momentum, x.reaction, x.change))
    P, p_x, r_x, y_x, z_x = _turn(ad_S, M), *map(_bracket, (p, r, M @ T_o + B @ S_o, z))
    L, R = P + p_x, _turn(ad_S, B) + _turn(ad(Y_o[..., 0]), M) + _bracket(M @ Y_o)
    # Masks of joints, (d,), and of entries (row, column), (d, d). `force_inside`: the force is inside of o.
    # `both_inside`: the other coordinate is so too; derivatives by two screws of o itself are in one of the lists
    # `first` and `second` alone.
    is_inside, is_same, is_before = order < order[-1], order[:, None] == order, order[:, None] < order
    force_inside, both_inside = is_inside[:, None], is_inside[:, None] & is_inside
    # The outermost is the force: bilinear forms of what displaces or moves the two others.
    p_S, of_rates, SLS, SPS, SpS = p_x @ S, (p_x - P) @ Y + r_x @ S, S.mT @ L @ S, S.mT @ P @ S, S.mT @ p_x @ S
    qq = Z.mT @ p_S + Y.mT @ of_rates
    qqd = _choose(is_before, T.mT @ p_S + S.mT @ of_rates, -(S.mT @ L @ Y)).mT
    qdqd = -_choose(is_same, SPS, _choose(is_before, SLS.mT, SLS))
    force = [_choose(is_before, qq, qq.mT), qqd, qdqd, (SpS * is_before).mT]
    # The outermost is a coordinate: wrenches on what it carries, on the screws of the force.
    by_q = (S.mT @ (P @ Z + R @ Y) + (S.mT @ z_x @ S) * is_before) * force_inside
    by_qd = (SLS + (S.mT @ M @ ad_S @ S) * ~is_inside) * force_inside
    first = [by_q, (S.mT @ (P @ T + R @ S)) * both_inside, by_qd, SPS * both_inside]
    by_q_then_qd = (S.mT @ L @ Y + (S.mT @ y_x @ S) * is_before) * force_inside
    second = [by_q * both_inside, by_q_then_qd, by_qd * both_inside, SpS * is_before * force_inside]
    return [*force, *first, *second]


def _turn(x: Array, M: Array) -> Array:
    """Return x x M - M x x by the matrix ad of x.

    This is the rate of a form M that moves with the twist.
    """
    return -(x.mT @ M + M @ x)


def _bracket(h: Array) -> Array:
    """Return [h] of a wrench h, with [h] x = x x h.

    h is (..., 6, 1), [h] is (..., 6, 6).
    """
    return -(ad(np.eye(6, dtype=int)).mT @ h[..., None, :, :])[..., 0].mT


def _choose(condition: np.ndarray, x: Array, y: Array) -> Array:
    """Return entries of x where a condition holds, else of y."""
    return x * condition + y * ~condition


def _spread(block: Array, path: Sequence[int], size: int) -> Array:
    """Spread a block over all screws, with zeros elsewhere."""
    # Places of others point at a row and a column of zeros behind the block.
    place = np.full(size, len(path))
    place[[*path]] = np.arange(len(path))
    padded = concatenate([block, 0 * block[..., :1]], axis=-1)
    return concatenate([padded, 0 * padded[..., :1, :]], axis=-2)[..., place[:, None], place]


def _generalized(T: Array, G: Array) -> Array:
    """Return a tensor of all screws as one of coordinates."""
    if np.array_equal(G, np.eye(*G.shape, dtype=int)):
        return T
    return (G.T @ (G.T @ T @ G).swapaxes(-3, -2)).swapaxes(-3, -2)
