"""Partial derivatives of the generalized forces, with rates, from wrenches projected onto joint screws.

The coordinate of joint j displaces the bodies that the joint carries along its screw S_j. With a prime for the rate in
space, S' = ad(V) S and S'' the rates of a screw, g the field of gravity, and of the bodies that joint j carries the
inertia I_j, the momentum p_j and the force F_j, the partial derivatives of the forces of the joint variables are, where
joint i carries joint j or is j itself,

    K_ij = S_i . (I_j A_j + B_j S_j' + S_j x F_j),    K_ji = (I_j S_j) . A_i + (B_j^T S_j) . S_i',
    D_ji = 2 (I_j S_j) . S_i' + (B_j^T S_j) . S_i,    D_ij = 2 M_ij' - D_ji,

where ``A = S'' + S x g`` and ``B x = I' x + x x p``. Wrenches on the bodies, fixed in them, are part of F.

The base that moves is displaced by a twist in its own axes, while the components of its own twist are held. What it
carries keeps its motion as seen from it, but for gravity: ``S' = S'' = 0`` and ``A = S x g`` in the equations of K, of
which ``K_00 = I_0 A_0``; and ``S'`` counts once in those of D, not twice.

Singh, Russell, Wensing, "Efficient Analytical Derivatives of Rigid-Body Dynamics Using Spatial Vector Algebra",
IEEE Robotics and Automation Letters 7(2), 2022.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.scalars import Array
from jounce.dynamics.base import BaseMotion
from jounce.dynamics.recursion.forces import wrenches
from jounce.dynamics.recursion.joints import Joint, batch_zeros
from jounce.dynamics.recursion.sweeps import above, collect, composites, evaluate_in_order, project, velocities
from jounce.dynamics.recursion.tree import AnyJoint, FreeJoint, KinematicTree, kinematic_tree
from jounce.model.equivalent import minimal
from jounce.model.mechanism import Mechanism
from jounce.spatial.inertia import moment_matrix
from jounce.spatial.lie import ad, cowedge, wedge
from jounce.spatial.series import Series

Partials = tuple[Series, Series, Series]  # K, D, M: by q, qd and q2d


@dataclass(frozen=True)
class _Subtree:
    """The bodies that a joint carries, in its body frame; rates are those in space."""

    Pi: Series  # (..., 4, 4) moments of mass
    Pi_rate: Series
    p: Series  # (..., 6, 1) momentum and force
    F: Series
    V: Series  # of the body of the joint: its twist, its acceleration relative to free fall, and gravity there
    a: Series
    g: Series


@dataclass(frozen=True)
class _Wrenches:
    """What the screws S of a joint require of the bodies that it carries, a column each, in its body frame."""

    S: Series
    S_rate: Series
    moving: Series  # S' where it moves with a displacement of the joint
    A: Series
    momentum: Series  # I S
    reaction: Series  # B^T S
    change: Series  # I A + B S' + S x F


def _of_joint(joint: Joint, x: _Subtree) -> _Wrenches:
    S_rate = joint.screw_rate(x.V)
    A = joint.screw_rate(x.a) + x.V.map(_ad) @ S_rate
    moved = _wrench(A.map(_wedge) @ x.Pi + S_rate.map(_wedge) @ x.Pi_rate)
    return _Wrenches(
        S=Series.constant(joint.X),
        S_rate=S_rate,
        moving=S_rate,
        A=A,
        momentum=joint.momentum(x.Pi),
        reaction=joint.momentum(x.Pi_rate) - joint.cross(x.p),
        change=moved + _cross(S_rate, x.p) + joint.cross(x.F),
    )


def _of_base(joint: FreeJoint, x: _Subtree) -> _Wrenches:
    momentum, A = joint.momentum(x.Pi), -joint.screw_rate(x.g)
    return _Wrenches(
        S=Series.constant(joint.X),
        S_rate=joint.screw_rate(x.V),
        moving=Series.constant(0 * joint.X),
        A=A,
        momentum=momentum,
        reaction=joint.momentum(x.Pi_rate) - joint.cross(x.p),
        change=momentum @ A,
    )


def partials(mechanism: Mechanism, q: Series, W: Series | None = None, base: BaseMotion | None = None) -> Partials:
    """K, D, M of the generalized forces, (..., nv, nv) each, with wrenches W on the bodies, (..., 6nb, 1)."""
    chain = minimal(mechanism)
    tree = kinematic_tree(chain, q, base)
    joints = tree.joints
    V, field = velocities(joints), _gravity(joints, chain.gravity)
    Pi = composites(joints, [Series.constant(Pi_i) for Pi_i in moment_matrix(tree.M)], Joint.moments)
    p = composites(joints, [M_i @ V_i for M_i, V_i in zip(tree.M, V, strict=True)], Joint.wrenches)
    loads = None
    if W is not None:
        on_bodies = wrenches(mechanism, chain, W)
        on_ground = [0 * on_bodies[0]] * (len(joints) - len(on_bodies))
        loads = composites(joints, on_ground + on_bodies, Joint.wrenches)
    screws = []
    for i, joint in enumerate(joints):
        flow = V[i].map(_wedge) @ Pi[i]
        F = p[i].dot + _cross(V[i], p[i]) - _wrench(field[i].map(_wedge) @ Pi[i])
        F = F if loads is None else F + loads[i]
        x = _Subtree(Pi[i], Pi[i].dot + flow + flow.mT, p[i], F, V[i], V[i].dot - field[i], field[i])
        screws.append(_of_joint(joint, x) if isinstance(joint, Joint) else _of_base(joint, x))
    return _projected(tree, q, screws, [*V, *field, *Pi[::-1], *p[::-1]])


def _projected(tree: KinematicTree, q: Series, screws: Sequence[_Wrenches], before: Sequence[Series]) -> Partials:
    """Transport the wrenches of the joints inward, and project them onto the screws."""
    joints = tree.joints
    momenta, reactions, changes = (
        collect(joints, [getattr(x, wrench) for x in screws]) for wrench in ("momentum", "reaction", "change")
    )
    S, S_rate, moving, A = ([getattr(x, part) for x in screws] for part in ("S", "S_rate", "moving", "A"))
    M, along = project(S, momenta), project(S_rate, momenta)
    by_rate = along * 2 + project(S, reactions)
    by_place = project(A, momenta) + project(moving, reactions)
    K = project(S, changes) + above(by_place, joints).mT
    D = M.dot * 2 - by_rate + above(by_rate, joints).mT
    if isinstance(joints[0], FreeJoint):
        D = D - along.mT * (np.arange(len(tree.G)) < 6)  # where S' of the base counts once
    steps = [*before, *(column.values for sweep in (momenta, reactions, changes) for column in reversed(sweep))]

    def of_coordinates(matrix: Series) -> Series:
        return evaluate_in_order(tree.generalized_matrix(matrix + batch_zeros(q)), steps)

    return of_coordinates(K), of_coordinates(D), of_coordinates(M + above(M, joints).mT)


def _gravity(tree: Sequence[AnyJoint], gravity: Array) -> list[Series]:
    """The field of gravity as a twist of each body, which moves as a twist that is constant in space."""
    ground = Series.constant(np.concatenate([0 * gravity, gravity])[:, None])
    field: list[Series] = []
    for joint in tree:
        field.append(joint.twists(ground if joint.parent < 0 else field[joint.parent]))
    return field


def _wrench(T: Series) -> Series:
    return T.map(lambda x: cowedge(x)[..., None])


def _cross(X: Series, wrench: Series) -> Series:
    """X x W, the rate of a wrench that moves with the screw X."""
    return -(X.map(_ad).mT @ wrench)


def _ad(X: Array) -> Array:
    return ad(X[..., 0])


def _wedge(X: Array) -> Array:
    return wedge(X[..., 0])
