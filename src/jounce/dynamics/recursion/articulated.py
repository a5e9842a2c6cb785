"""Equations M x = b of the mass matrix by articulated bodies (Featherstone's algorithm, ABA): O(n), M is not built.

The articulated inertia of a body is the one that its joint has to move where all joints beyond are free. With S_i the
screw of joint i, a_i the armature that acts there, and p the carrier of body i,

    U_i = I_i S_i,    D_i = S_i . U_i + a_i,    I_p = M_p + sum of (I_i - U_i D_i^-1 U_i^T) over the bodies i on p.

These depend on q alone: all orders of forward dynamics share them. For each b, forces go inward and accelerations
outward,

    u_i = b_i - S_i . F_i,              F_p = sum of (F_i + U_i D_i^-1 u_i),
    x_i = D_i^-1 (u_i - U_i . A_p),     A_i = A_p + S_i x_i,

each seen from the frame of the body that it belongs to. D_i are the pivots that M itself has.
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
    """Return whether articulated bodies take fewer operations than M and its factors, and can be used.

    M has an entry for each body and each joint on its way to the ground, articulated bodies one inertia for each body.
    Counted for fifty arms, humanoids, hands and chains, the two are even where that way has `MIN_DEPTH` joints on
    average, as in a chain of eleven, or `MIN_DEPTH_ON_BASE` joints if the robot floats.
    """
    if not moves_joints_alone(m):
        return False
    depths: list[int] = []
    for columns, p in zip(m.columns, m.parent, strict=True):
        depths.append(bool(columns) + (depths[p] if p >= 0 else 0))
    return sum(depths) >= (MIN_DEPTH_ON_BASE if m.floats else MIN_DEPTH) * m.n


@dataclass(frozen=True)
class ArticulatedJoint:
    """A joint with what it takes to move its articulated body, all in the frame of the body."""

    joint: MovingJoint
    D: Factors  # of (..., k, k)
    share: Array  # U D^-1, (..., 6, k)

    def balance(self, b: Array, F: Array) -> tuple[Array, Array]:
        """Return u, what a force on the joint leaves for its acceleration, and the share of the parent in F."""
        u = b - self.joint.X.T @ F
        return u, self.joint.wrenches(_omit_rates(F + self.share @ u))[0]

    def accelerate(self, u: Array, A: Array) -> tuple[Array, Array]:
        """Return the accelerations of the joint and of its body, from A of the parent."""
        A = self.joint.twists(_omit_rates(A))[0]
        x = self.D.solve(u) - self.share.mT @ A
        return x, A + self.joint.X @ x


def articulate(joint: MovingJoint, inertia: Array, armature: Array) -> tuple[ArticulatedJoint, Array]:
    """Return a joint with the articulated inertia of its body, and what its parent feels of it, (..., 6, 6)."""
    U = inertia @ joint.X
    D = joint.X.T @ U
    factors, free = Factors.of(D + np.diag(armature) if len(armature) else D), _free_axis(joint, armature)
    share = factors.solve(U.mT).mT * (1 - free) + free
    left = mirror_triangle(inertia - share @ U.mT) * (1 - free) * (1 - free.mT)
    return ArticulatedJoint(joint, factors, share), joint.inertias(_omit_rates(left))[0]


@dataclass(frozen=True)
class ArticulatedBodies:
    """The articulated bodies of a mechanism without joints that follow others, at coordinates q."""

    mechanism: Mechanism
    joints: Sequence[ArticulatedJoint]

    @classmethod
    def of(cls, m: Mechanism, q: Array) -> "ArticulatedBodies":
        """The articulated bodies at coordinates (..., n, 1)."""
        chain = minimal_mechanism(m)
        tree = kinematic_tree(chain, Series.of([q]))
        armature = m.drives.armature * int("armature" in m.acting)
        inertias, found = list(mirror_triangle(chain.M)), list[ArticulatedJoint]()
        for i, joint in reversed(list(enumerate(tree.joints))):
            own, felt = articulate(joint, inertias[i], armature[list(chain.columns[i])])
            found.insert(0, own)
            if (p := joint.parent) >= 0:
                inertias[p] = inertias[p] + felt
        return cls(chain, found)

    def solve(self, b: Array) -> Array:
        """X of M X = b, both (..., nv, m)."""
        F = [0 * (own.joint.X[:, :1] @ b[..., :1, :]) for own in self.joints]
        u: list[Array] = []
        for i, own in reversed(list(enumerate(self.joints))):
            left, felt = own.balance(b[..., coordinates.velocity_rows(self.mechanism, i), :], F[i])
            u.insert(0, left)
            if (p := own.joint.parent) >= 0:
                F[p] = F[p] + felt
        A, x = {-1: np.zeros((6, 1), dtype=int)}, list[Array]()
        for i, (own, u_i) in enumerate(zip(self.joints, u, strict=True)):
            x_i, A[i] = own.accelerate(u_i, A[own.joint.parent])
            x.append(x_i)
        return concatenate(x, axis=-2)


def _omit_rates(value: Array) -> Series:
    """A quantity whose rates are not asked for."""
    return Series.of([value])


def _free_axis(joint: MovingJoint, armature: Array) -> Array:
    """The axis of the frame along which a joint moves freely, (6, 1); zero if it moves otherwise, or has armature.

    Along it U / D is 1 and nothing is left of the inertia: both are exact, and zeros cost nothing.
    """
    alone = joint.X.shape[-1] == 1 and is_zero(armature[0]) and sum(not is_zero(x) for x in joint.X.flat) == 1
    return joint.X[:, :1] * int(alone)
