"""Partial derivatives of the generalized forces, with rates, from wrenches projected onto joint screws.

The coordinate of joint j displaces the bodies that the joint carries along its screw S_j. With a prime for the rate in
space, S' = ad(V) S and S'' the rates of a screw, g the field of gravity, and of the bodies that joint j carries the
inertia I_j, the momentum p_j and the force F_j, the partial derivatives of the forces of the joint variables are, where
joint i carries joint j or is j itself,

    K_ij = S_i . (I_j A_j + B_j S_j' + S_j x F_j),    K_ji = (I_j S_j) . A_i + (B_j^T S_j) . S_i',
    D_ji = 2 (I_j S_j) . S_i' + (B_j^T S_j) . S_i,    D_ij = 2 M_ij' - D_ji,

where ``A = S'' + S x g`` and ``B x = I' x + x x p``. Wrenches on the bodies, fixed in them, are part of F.

A joint of several screws, as that of a base that floats, is displaced along them while the components of its own
velocities nu are held. Its screws then move as if they were fixed on its parent: with ``S_p' = ad(V_p) S`` in the
places of S' and S'' in the equations of K, in those of D in the place of one S' of two, ``D - M alpha``. The forces of
such a joint turn with it, so that S_j x F_j is no part of its own block K_jj.

Singh, Russell, Wensing, "Efficient Analytical Derivatives of Rigid-Body Dynamics Using Spatial Vector Algebra",
IEEE Robotics and Automation Letters 7(2), 2022.
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
from jounce.dynamics.recursion.sweeps import (
    collect,
    composites,
    evaluate_in_order,
    join_rows,
    mask_above,
    spread_columns,
    velocities,
)
from jounce.dynamics.recursion.tree import KinematicTree, kinematic_tree
from jounce.dynamics.state import JointMotion
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import moment_matrix
from jounce.spatial.lie import ad, cowedge, wedge
from jounce.spatial.series import Series

Partials = tuple[Series, Series, Series]  # K, D, M: by q, qd and q2d


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
