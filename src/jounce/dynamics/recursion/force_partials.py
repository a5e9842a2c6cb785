"""Generalized forces have partial derivatives, first and second, by projecting wrenches onto joint screws.

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

`carry_screws` computes what both take: the joints, what each carries, and what its screws require of that.

Singh, Russell, Wensing, "Efficient Analytical Derivatives of Rigid-Body Dynamics Using Spatial Vector Algebra",
IEEE Robotics and Automation Letters 7(2), 2022; "On Second-Order Derivatives of Rigid-Body Dynamics: Theory &
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
        """F, (..., 6, 1), that moves them with the twist V, besides gravity and the load."""
        F = self.p.dot + _cross(V, self.p) - _wrench(field.map(_wedge) @ self.Pi)
        return F if self.load is None else F + self.load


@dataclass(frozen=True)
class Screws:
    """The screws S of a joint, (..., 6, k), and how they move, in its body frame."""

    S: Series
    S_rate: Series
    moving: Series  # S' where it moves with a displacement of the joint
    A: Series


@dataclass(frozen=True)
class ScrewWrenches:
    """What the screws S of a joint require of the bodies that it carries, a column each, in its body frame."""

    screws: Screws
    Pi_rate: Series  # of the bodies, in space, (..., 4, 4)
    momentum: Series  # I S
    reaction: Series  # B^T S
    change: Series  # I A + B S' + S x F
    turned: Series  # S x F; zero where no joint precedes this one

    @classmethod
    def of(cls, joint: MovingJoint, V: Series, carried: Series | None, field: Series, on: CarriedBodies) -> Self:
        """Those of a joint on whose body V and field are seen; `carried` is the twist of its parent, None at rest."""
        flow, A = V.map(_wedge) @ on.Pi, joint.screw_rate(_carrier_acceleration(joint, V, carried, field))
        Pi_rate, F = on.Pi.dot + flow + flow.mT, on.force(V, field)
        V_carrier = carried if isinstance(joint, FreeJoint) else V
        if V_carrier is None:
            moving = turned = Series.constant(0 * joint.X)
            change = _momenta([(A, on.Pi)])
        else:
            moving, turned = joint.screw_rate(V_carrier), joint.cross(F)
            A = A + V_carrier.map(_ad) @ moving
            change = _momenta([(A, on.Pi), (moving, Pi_rate)]) + _cross(moving, on.p) + turned
        screws = Screws(Series.constant(joint.X), joint.screw_rate(V), moving, A)
        return cls(screws, Pi_rate, joint.momentum(on.Pi), joint.momentum(Pi_rate) - joint.cross(on.p), change, turned)


@dataclass(frozen=True)
class ScrewProducts:
    """The products of a joint's screws with the wrenches of the joints that it carries, a column for each of these."""

    M: Series
    by_place: Series  # K_ji
    change: Series  # K_ij
    by_rate: Series  # D_ji of joints of one screw
    counted_twice: Series  # what D_ji of others has less

    @classmethod
    def of(cls, x: Screws, momenta: Series, reactions: Series, changes: Series) -> Self:
        """Those with the wrenches transported to the joint, (..., 6, columns) each."""
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
    """K, D, M of the generalized forces, (..., nv, nv) each, with wrenches W on the bodies, (..., 6nb, 1)."""
    tree, _, screws, steps = carry_screws(m, q, W, base)
    return _project_partials(tree, q, screws, steps)


def carry_screws(
    m: Mechanism, q: Series, W: Series | None, base: JointMotion | None
) -> tuple[KinematicTree[MovingJoint], list[CarriedBodies], list[ScrewWrenches], list[Series]]:
    """The joints, what each carries, what its screws require of that, and the steps to all in their order."""
    chain = minimal_mechanism(m)
    tree = kinematic_tree(chain, q, base)
    joints = tree.joints
    V, field = velocities(joints), _gravity(joints, chain.gravity)
    Pi = composites(joints, [Series.constant(Pi_i) for Pi_i in moment_matrix(tree.M)], MovingJoint.moments)
    p = composites(joints, [M_i @ V_i for M_i, V_i in zip(tree.M, V, strict=True)], MovingJoint.wrenches)
    loads: Sequence[Series | None] = [None] * len(joints)
    if W is not None:
        on_bodies = shift_wrenches(m, chain, W)
        on_ground = [0 * on_bodies[0]] * (len(joints) - len(on_bodies))
        loads = composites(joints, on_ground + on_bodies, MovingJoint.wrenches)
    bodies, screws = [CarriedBodies(*x) for x in zip(Pi, p, loads, strict=True)], []
    for i, joint in enumerate(joints):
        carried = joint.twists(V[joint.parent]) if isinstance(joint, FreeJoint) and joint.parent >= 0 else None
        screws.append(ScrewWrenches.of(joint, V[i], carried, field[i], bodies[i]))
    rates = [x.dot for x in (*V, *Pi[::-1], *p[::-1])]  # which the accelerations of screws and the forces take
    return tree, bodies, screws, [*V, *field, *Pi[::-1], *p[::-1], *rates]


def _carrier_acceleration(joint: MovingJoint, own: Series, carried: Series | None, field: Series) -> Series:
    """The acceleration, relative to free fall, of a joint's screws as they are displaced.

    It is that of the body or, of several screws, of the parent.
    """
    if not isinstance(joint, FreeJoint):
        return own.dot - field
    if carried is None:
        return -field
    return carried.dot + (joint.X @ joint.rate).map(_ad) @ carried - field


def _project_partials(
    tree: KinematicTree[MovingJoint], q: Series, screws: Sequence[ScrewWrenches], before: Sequence[Series]
) -> Partials:
    """Transport the wrenches of the joints inward, and project them onto the screws."""
    joints = tree.joints
    momenta, reactions, changes = (
        collect(joints, [getattr(x, wrench) for x in screws]) for wrench in ("momentum", "reaction", "change")
    )
    rows = [
        ScrewProducts.of(x.screws, *(wrenches.values for wrenches in columns))
        for x, *columns in zip(screws, momenta, reactions, changes, strict=True)
    ]
    M, K, by_place, D, by_rate = (
        join_rows([getattr(row, part) for row in rows], momenta) for part in ("M", "change", "by_place", "D", "by_rate")
    )
    K = K + mask_above(by_place, joints).mT
    D = D + mask_above(by_rate, joints).mT
    for E, joint, x, row, carried in zip(_places(joints), joints, screws, rows, momenta, strict=True):
        if isinstance(joint, FreeJoint):
            D = D - (E @ spread_columns(row.counted_twice, carried.screws, len(E))).mT
        if isinstance(joint, FreeJoint) and joint.parent >= 0:
            alpha = joint.X.T @ (joint.X @ joint.rate).map(_ad) @ joint.X
            D = D - mask_above(M @ E @ alpha @ E.T, joints)
            K = K - E @ (joint.X.T @ x.turned) @ E.T
    steps = [*before, *(column.values for sweep in (momenta, reactions, changes) for column in reversed(sweep))]
    to_rates = [*steps, *(column.values.dot for column in reversed(momenta))]  # of D, which has the rate of M

    def of_coordinates(matrix: Series, steps: Sequence[Series]) -> Series:
        return evaluate_in_order(tree.generalized_matrix(matrix + batch_zeros(q)), steps)

    return of_coordinates(K, steps), of_coordinates(D, to_rates), of_coordinates(M + mask_above(M, joints).mT, steps)


def _places(tree: Sequence[MovingJoint]) -> list[Array]:
    """Of each joint, the columns of the unit matrix that belong to its screws."""
    sizes = [joint.X.shape[-1] for joint in tree]
    return np.split(np.eye(sum(sizes), dtype=int), np.cumsum(sizes)[:-1], axis=1)


def _gravity(tree: Sequence[MovingJoint], gravity: Array) -> list[Series]:
    """The field of gravity as a twist of each body, which moves as a twist that is constant in space."""
    ground = Series.constant(concatenate([0 * gravity, gravity], axis=-1)[:, None])
    field: list[Series] = []
    for joint in tree:
        field.append(joint.twists(ground if joint.parent < 0 else field[joint.parent]))
    return field


def _momenta(pairs: Sequence[tuple[Series, Series]]) -> Series:
    """The sum of I X of screws X, (..., 6, k), and moments of mass, for some of both."""
    if pairs[0][0][0].shape[-1] == 1:
        return _wrench(reduce(add, [X.map(_wedge) @ Pi for X, Pi in pairs]))
    parts = [X.map(lambda X: wedge(X.mT)) @ Pi.map(lambda Pi: Pi[..., None, :, :]) for X, Pi in pairs]
    return reduce(add, parts).map(lambda T: cowedge(T).mT)


def _wrench(T: Series) -> Series:
    return T.map(lambda x: cowedge(x)[..., None])


def _cross(X: Series, wrench: Series) -> Series:
    """X x W, the rates of a wrench that moves with screws X, (..., 6, k)."""
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
