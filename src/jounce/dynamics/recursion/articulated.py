"""Equations M x = b of the mass matrix by articulated bodies (Featherstone's algorithm, ABA): O(n), M is not built.

The articulated inertia of a body is what its joint feels where all the joints beyond are free to move. With S_i the
screw of joint i, a_i the armature that acts there, and p the carrier of body i,

    U_i = I_i S_i,    D_i = S_i . U_i + a_i,    I_p = M_p + sum of (I_i - U_i U_i^T / D_i) over the bodies i on p.

These depend on q alone: all orders of forward dynamics share them. For each b, forces go inward and accelerations
outward,

    u_i = b_i - S_i . F_i,              F_p = sum of (F_i + U_i u_i / D_i),
    x_i = (u_i - U_i . A_p) / D_i,      A_i = A_p + S_i x_i,

each seen from the frame of the body that it belongs to. D_i are the pivots that M itself has. The screws of a floating
base are the unit matrix, so that its own part of x is ``A_0 = I_0^-1 (b_0 - F_0)``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.scalars import Array, concatenate, is_zero, reciprocal
from jounce.dynamics.recursion.joints import Joint, joints
from jounce.model.equivalent import minimal
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import Factors, mirrored
from jounce.spatial.series import Series

DEPTH = 6  # joints on the way to a body, on average, from which articulated bodies take fewer operations
DEPTH_ON_BASE = 3  # the same of a floating robot, where each way goes on to the six screws of the base


def has_deep_branches(mechanism: Mechanism) -> bool:
    """Return whether articulated bodies take fewer operations than M and its factors, and can be used.

    M has an entry for each body and each joint on its way to the ground, articulated bodies one inertia for each body.
    Counted for fifty arms, humanoids, hands and chains, the two are even where that way has `DEPTH` joints on average,
    as in a chain of eleven, or `DEPTH_ON_BASE` joints if the robot floats. Joints that follow others tie branches
    together, which articulated bodies leave free.
    """
    if mechanism.n != mechanism.nb or not all(map(is_zero, np.ravel(mechanism.G - np.eye(mechanism.n)))):
        return False
    depths: list[int] = []
    for p in mechanism.parent:
        depths.append(1 + (depths[p] if p >= 0 else 0))
    return sum(depths) >= (DEPTH_ON_BASE if mechanism.base else DEPTH) * mechanism.nb


@dataclass(frozen=True)
class ArticulatedBodies:
    """The articulated bodies of a mechanism without joints that follow others, at coordinates q."""

    tree: Sequence[Joint]
    shares: Sequence[Array]  # U_i / D_i, (..., 6, 1)
    inverse_D: Sequence[Array]  # (..., 1, 1)
    base: Factors | None  # of the articulated inertia of a floating base

    @classmethod
    def of(cls, mechanism: Mechanism, q: Array) -> "ArticulatedBodies":
        """The articulated bodies at coordinates (..., n, 1)."""
        chain = minimal(mechanism)
        tree = joints(chain, Series.of([q]))
        armature = mechanism.drives.armature * int("armature" in mechanism.acting)
        inertias = dict(enumerate(mirrored(chain.M)))
        if chain.base:
            inertias[-1] = mirrored(chain.base.M)
        shares, inverse_D = list[Array](), list[Array]()
        for i, joint in reversed(list(enumerate(tree))):
            U = inertias[i] @ joint.X
            inverse_D.insert(0, reciprocal(joint.X.mT @ U + armature[i]))
            free = _free_axis(joint, armature[i])
            shares.insert(0, U * inverse_D[0] * (1 - free) + free)
            if (p := joint.parent) in inertias:
                left = mirrored(inertias[i] - shares[0] @ U.mT) * (1 - free) * (1 - free.mT)
                inertias[p] = inertias[p] + joint.inertias(_now(left))[0]
        return cls(tree, shares, inverse_D, Factors.of(inertias[-1]) if chain.base else None)

    def solve(self, b: Array) -> Array:
        """X of M X = b, both (..., nv, m)."""
        of_base, of_joints = b[..., : -len(self.tree), :], b[..., -len(self.tree) :, :]
        F: dict[int, Array] = {i: 0 * (joint.X @ b[..., :1, :]) for i, joint in enumerate(self.tree)}
        if self.base:
            F[-1] = 0 * of_base
        u: list[Array] = []
        for i, joint in reversed(list(enumerate(self.tree))):
            u.insert(0, of_joints[..., i : i + 1, :] - joint.X.mT @ F[i])
            if (p := joint.parent) in F:
                F[p] = F[p] + joint.wrenches(_now(F[i] + self.shares[i] @ u[0]))[0]
        A = {-1: self.base.solve(of_base - F[-1]) if self.base else 0 * F[0]}
        x = [A[-1]] if self.base else []
        for i, (joint, u_i, share, inverse_D) in enumerate(zip(self.tree, u, self.shares, self.inverse_D, strict=True)):
            A_p = joint.twists(_now(A[joint.parent]))[0]
            x.append(u_i * inverse_D - share.mT @ A_p)
            A[i] = A_p + joint.X @ x[-1]
        return concatenate(x, axis=-2)


def _now(value: Array) -> Series:
    """A quantity whose rates are not asked for."""
    return Series.of([value])


def _free_axis(joint: Joint, armature: Array) -> Array:
    """The axis of the frame along which a joint moves freely, (6, 1); zero if it moves along several, or has armature.

    Along it U / D is 1 and nothing is left of the inertia: both are exact, and zeros cost nothing.
    """
    return joint.X * int(is_zero(armature) and sum(not is_zero(x) for x in joint.X.flat) == 1)
