"""Articulated bodies solve equations M x = b of the mass matrix.

This is Featherstone's algorithm (ABA): O(n), M is not built. The articulated inertia of a body is the one that its
joint has to move where all joints beyond are free. With S_i the screw of joint i, a_i the armature that acts there, and
p the carrier of body i,

    U_i = I_i S_i,    D_i = S_i . U_i + a_i,    I_p = M_p + sum of (I_i - U_i D_i^-1 U_i^T) over the bodies i on p.

These depend on q alone: all orders of forward dynamics share them. For each b, forces go inward and accelerations
outward,

    u_i = b_i - S_i . F_i,              F_p = sum of (F_i + U_i D_i^-1 u_i),
    x_i = D_i^-1 (u_i - U_i . A_p),     A_i = A_p + S_i x_i,

each seen from the frame of the body that it belongs to. D_i are the pivots that M itself has.

How often what runs: `ArticulatedBodies.of` once per state, one sweep inward; its `solve` once per order of forward
dynamics, one sweep inward and one outward.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.scalars import Array, concatenate, is_zero
from jounce.dynamics.recursion.joints import MovingJoint
from jounce.dynamics.recursion.tree import kinematic_tree
from jounce.model import coordinates
from jounce.model.equivalent_mechanisms import minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import Factors, mirror_triangle
from jounce.spatial.series import Series

MIN_DEPTH = 6  # joints on the way to a body, on average, from which articulated bodies take fewer operations
MIN_DEPTH_ON_BASE = 3  # the same of a floating robot, where each way goes on to the six screws of the base


def moves_joints_alone(m: Mechanism) -> bool:
    """Return whether each coordinate moves one joint: those that follow others tie articulated bodies together."""
    return m.n == len(m.joints) and all(map(is_zero, np.ravel(m.G - np.eye(m.n))))


def has_deep_branches(m: Mechanism) -> bool:
    """Return whether articulated bodies work and take fewer operations than M.

    M has an entry for each body and each joint on its way to the ground, articulated bodies one inertia for each body.
    Counted for fifty arms, humanoids, hands and chains, the two are even where that way has `MIN_DEPTH` joints on
    average, as in a chain of eleven, or `MIN_DEPTH_ON_BASE` joints if the robot floats.
    """
    if not moves_joints_alone(m):
        return False
    # The number of joints on the way to each body; a floating base has none of the n joints.
    depths: list[int] = []
    for columns, p in zip(m.columns, m.parent, strict=True):
        parent_depth = depths[p] if p >= 0 else 0
        depths.append(parent_depth + int(len(columns) > 0))
    return sum(depths) >= (MIN_DEPTH_ON_BASE if m.floats else MIN_DEPTH) * m.n


@dataclass(frozen=True)
class ArticulatedJoint:
    """A joint with the factors that move its articulated body.

    All are in the frame of the body.
    """

    joint: MovingJoint
    D: Factors  # of (..., k, k)
    share: Array  # U D^-1, (..., 6, k)

    def balance(self, b: Array, F: Array) -> tuple[Array, Array]:
        """Return u = b - S . F, and the wrench on the parent.

        u is left to accelerate the joint.
        """
        u = b - self.joint.X.T @ F
        return u, self.joint.wrenches(_omit_rates(F + self.share @ u))[0]

    def accelerate(self, u: Array, A: Array) -> tuple[Array, Array]:
        """Return the accelerations of the joint and of its body.

        A is that of the parent.
        """
        # x = D^-1 u - (U D^-1)^T A_p, with A_p in the frame of the body.
        A = self.joint.twists(_omit_rates(A))[0]
        x = self.D.solve(u) - self.share.mT @ A
        return x, A + self.joint.X @ x


def articulate(joint: MovingJoint, inertia: Array, armature: Array) -> tuple[ArticulatedJoint, Array]:
    """Return a joint with its articulated inertia, and its parent's share.

    The parent feels an inertia, (..., 6, 6).
    """
    U = inertia @ joint.X
    D = joint.X.T @ U
    # A floating base has screws and no armature.
    factors = Factors.of(D + np.diag(armature) if len(armature) > 0 else D)
    # U D^-1 and I - U D^-1 U^T, with their exact 1 and zeros along an axis on which the joint is free.
    free = _free_axis(joint, armature)
    share = factors.solve(U.mT).mT * (1 - free) + free
    felt = mirror_triangle(inertia - share @ U.mT) * (1 - free) * (1 - free.mT)
    return ArticulatedJoint(joint, factors, share), joint.inertias(_omit_rates(felt))[0]


@dataclass(frozen=True)
class ArticulatedBodies:
    """The articulated bodies of a mechanism at coordinates q.

    None of its joints follows others.
    """

    mechanism: Mechanism
    joints: Sequence[ArticulatedJoint]

    @classmethod
    def of(cls, m: Mechanism, q: Array) -> "ArticulatedBodies":
        """Return the articulated bodies at coordinates (..., n, 1)."""
        # Base parameters have most zeros, and the same M.
        chain = minimal_mechanism(m)
        tree = kinematic_tree(chain, Series.of([q]))
        armature = m.drives.armature * int("armature" in m.acting)
        # Inward: by then a body has the inertias that its children pass on.
        inertias, articulated = list(mirror_triangle(chain.M)), list[ArticulatedJoint]()
        for i, joint in reversed(list(enumerate(tree.joints))):
            articulated_joint, felt = articulate(joint, inertias[i], armature[list(chain.columns[i])])
            articulated.insert(0, articulated_joint)
            p = joint.parent
            if p >= 0:
                inertias[p] = inertias[p] + felt
        return cls(chain, articulated)

    def solve(self, b: Array) -> Array:
        """Return X of M X = b, both (..., nv, m)."""
        # Inward: forces b on the joints give u, and wrenches F on the bodies.
        F = [0 * (joint.joint.X[:, :1] @ b[..., :1, :]) for joint in self.joints]
        u: list[Array] = []
        for i, joint in reversed(list(enumerate(self.joints))):
            u_i, felt = joint.balance(b[..., coordinates.velocity_rows(self.mechanism, i), :], F[i])
            u.insert(0, u_i)
            p = joint.joint.parent
            if p >= 0:
                F[p] = F[p] + felt
        # Outward: accelerations of the joints from those of their parents; the ground is at rest.
        A, x = {-1: np.zeros((6, 1), dtype=int)}, list[Array]()
        for i, (joint, u_i) in enumerate(zip(self.joints, u, strict=True)):
            x_i, A[i] = joint.accelerate(u_i, A[joint.joint.parent])
            x.append(x_i)
        return concatenate(x, axis=-2)


def _omit_rates(value: Array) -> Series:
    """Return a quantity as a series without rates."""
    return Series.of([value])


def _free_axis(joint: MovingJoint, armature: Array) -> Array:
    """Return the axis along which a joint moves freely, or zeros.

    It is an axis of the frame, (6, 1). They are zeros if it moves along no single axis of the frame, or has armature.
    Along the axis U / D is 1 and nothing is left of the inertia: both are exact, and zeros cost nothing.
    """
    is_free = joint.X.shape[-1] == 1 and is_zero(armature[0]) and sum(not is_zero(x) for x in joint.X.flat) == 1
    return joint.X[:, :1] * int(is_free)
