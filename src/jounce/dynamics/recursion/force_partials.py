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

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics.joint_motion import JointMotion
from jounce.dynamics.recursion.forces import shift_wrenches
from jounce.dynamics.recursion.joints import FreeJoint, MovingJoint, batch_zeros
from jounce.dynamics.recursion.sweeps import (
    collect,
    composites,
    evaluate_in_order,
    mask_above,
    project,
    spread_columns,
    velocities,
)
from jounce.dynamics.recursion.tree import KinematicTree, kinematic_tree
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import moment_matrix
from jounce.spatial.lie import ad, cowedge, wedge
from jounce.spatial.series import Series

Partials = tuple[Series, Series, Series]  # K, D, M: by q, qd and q2d


@dataclass(frozen=True)
class _ScrewWrenches:
    """What the screws S of a joint require of the bodies that it carries, a column each, in its body frame."""

    S: Series
    S_rate: Series
    moving: Series  # S' where it moves with a displacement of the joint
    A: Series
    momentum: Series  # I S
    reaction: Series  # B^T S
    change: Series  # I A + B S' + S x F
    turned: Series  # S x F; zero where no joint precedes this one


def _joint_wrenches(
    joint: MovingJoint,
    V: Series,
    carrier: tuple[Series | None, Series],
    Pi: Series,
    Pi_rate: Series,
    p: Series,
    F: Series,
) -> _ScrewWrenches:
    """The wrenches of a joint from moments of mass (..., 4, 4), rates in space, momentum and force of its bodies."""
    V_carrier, a = carrier
    A = joint.screw_rate(a)
    if V_carrier is None:  # no joint precedes this one
        moving = turned = Series.constant(0 * joint.X)
        change = _momenta([(A, Pi)])
    else:
        moving, turned = joint.screw_rate(V_carrier), joint.cross(F)
        A = A + V_carrier.map(_ad) @ moving
        change = _momenta([(A, Pi), (moving, Pi_rate)]) + _cross(moving, p) + turned
    reaction = joint.momentum(Pi_rate) - joint.cross(p)
    return _ScrewWrenches(
        Series.constant(joint.X), joint.screw_rate(V), moving, A, joint.momentum(Pi), reaction, change, turned
    )


def partials(m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None) -> Partials:
    """K, D, M of the generalized forces, (..., nv, nv) each, with wrenches W on the bodies, (..., 6nb, 1)."""
    chain = minimal_mechanism(m)
    tree = kinematic_tree(chain, q, base)
    joints = tree.joints
    V, field = velocities(joints), _gravity(joints, chain.gravity)
    Pi = composites(joints, [Series.constant(Pi_i) for Pi_i in moment_matrix(tree.M)], MovingJoint.moments)
    p = composites(joints, [M_i @ V_i for M_i, V_i in zip(tree.M, V, strict=True)], MovingJoint.wrenches)
    loads = None
    if W is not None:
        on_bodies = shift_wrenches(m, chain, W)
        on_ground = [0 * on_bodies[0]] * (len(joints) - len(on_bodies))
        loads = composites(joints, on_ground + on_bodies, MovingJoint.wrenches)
    screws = []
    for i, joint in enumerate(joints):
        flow = V[i].map(_wedge) @ Pi[i]
        F = p[i].dot + _cross(V[i], p[i]) - _wrench(field[i].map(_wedge) @ Pi[i])
        F = F if loads is None else F + loads[i]
        carrier = _carrier(joint, V, V[i], field[i])
        screws.append(_joint_wrenches(joint, V[i], carrier, Pi[i], Pi[i].dot + flow + flow.mT, p[i], F))
    return _project_partials(tree, q, screws, [*V, *field, *Pi[::-1], *p[::-1]])


def _carrier(joint: MovingJoint, V: Sequence[Series], own: Series, field: Series) -> tuple[Series | None, Series]:
    """The motion of a joint's screws as they are displaced: their twist, and their acceleration relative to free fall.

    It is that of the body or, of several screws, of the parent; None for the twist of a parent at rest.
    """
    if not isinstance(joint, FreeJoint):
        return own, own.dot - field
    if joint.parent < 0:
        return None, -field
    carried = joint.twists(V[joint.parent])
    return carried, carried.dot + (joint.X @ joint.rate).map(_ad) @ carried - field


def _project_partials(
    tree: KinematicTree[MovingJoint], q: Series, screws: Sequence[_ScrewWrenches], before: Sequence[Series]
) -> Partials:
    """Transport the wrenches of the joints inward, and project them onto the screws."""
    joints = tree.joints
    momenta, reactions, changes = (
        collect(joints, [getattr(x, wrench) for x in screws]) for wrench in ("momentum", "reaction", "change")
    )
    S, S_rate, moving, A = ([getattr(x, part) for x in screws] for part in ("S", "S_rate", "moving", "A"))
    M, along, reacting = project(S, momenta), project(S_rate, momenta), project(S, reactions)
    by_place = project(A, momenta) + project(moving, reactions)
    K = project(S, changes) + mask_above(by_place, joints).mT
    by_rate = along * 2 + reacting
    D = M.dot * 2 - by_rate + mask_above(by_rate, joints).mT
    for E, joint, x, carried in zip(_places(joints), joints, screws, momenta, strict=True):
        if isinstance(joint, FreeJoint):
            counted_twice = (x.S_rate - x.moving).mT @ carried.values
            D = D - (E @ spread_columns(counted_twice, carried.screws, len(E))).mT
        if isinstance(joint, FreeJoint) and joint.parent >= 0:
            alpha = joint.X.T @ (joint.X @ joint.rate).map(_ad) @ joint.X
            D = D - mask_above(M @ E @ alpha @ E.T, joints)
            K = K - E @ (joint.X.T @ x.turned) @ E.T
    steps = [*before, *(column.values for sweep in (momenta, reactions, changes) for column in reversed(sweep))]

    def of_coordinates(matrix: Series) -> Series:
        return evaluate_in_order(tree.generalized_matrix(matrix + batch_zeros(q)), steps)

    return of_coordinates(K), of_coordinates(D), of_coordinates(M + mask_above(M, joints).mT)


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
