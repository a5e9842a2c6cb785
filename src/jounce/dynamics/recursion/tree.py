"""The tree of joints that the sweeps run over: those of a mechanism, behind that of a base that moves.

A base that moves is body 0, ahead of all others, behind a joint whose screws are the unit matrix and whose rate is the
twist of the base. The base of a floating robot has inertia, and velocities of its own; the ground that carries a fixed
robot has neither.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from jounce.core.scalars import Array, concatenate
from jounce.dynamics.base import STILL, BaseMotion
from jounce.dynamics.recursion.joints import Joint, joints, momentum
from jounce.model.coordinates import base_columns, joint_columns
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import ad, wedge
from jounce.spatial.series import Series


@dataclass(frozen=True)
class FreeJoint:
    """The joint of a base that moves: it transports between the inertial frame and that of the base."""

    motion: BaseMotion
    parent: int = -1

    @property
    def X(self) -> Array:
        """The six screws, (6, 6)."""
        return np.eye(6, dtype=int)

    @property
    def rate(self) -> Series:
        """The twist of the base."""
        return self.motion.V

    def momentum(self, Pi: Series) -> Series:
        """I S, (..., 6, 6): the inertia matrix of moments of mass, (..., 4, 4)."""
        return momentum(wedge(self.X), Pi)

    def screw_rate(self, V: Series) -> Series:
        """S' = ad(V) S, (..., 6, 6)."""
        return V.map(lambda V: ad(V[..., 0]))

    def cross(self, W: Series) -> Series:
        """S x W, (..., 6, 6): the rates of a wrench W, (..., 6, 1), that moves with one of the screws."""
        return W.map(lambda W: -(ad(self.X).mT @ W[..., None, :, :])[..., 0].mT)

    def twists(self, x: Series) -> Series:
        """Transport twists (..., 6, k) from the inertial frame to that of the base."""
        return self.motion.twists(x)

    def wrenches(self, x: Series) -> Series:
        """Transport wrenches (..., 6, k) from the frame of the base to the inertial one."""
        return self.motion.in_space(x)

    def points(self, x: Series) -> Series:
        """Transport points and weighted sums of points (..., 4, k) from the frame of the base to the inertial one."""
        return self.motion.points(x)


AnyJoint: TypeAlias = Joint | FreeJoint


@dataclass(frozen=True)
class KinematicTree:
    """The joints at an instant, each after its parent, the inertia of their bodies, and the velocities they follow."""

    joints: Sequence[AnyJoint]
    M: Array  # (len(joints), 6, 6)
    G: Array  # rates of all joints, six of a base, from the velocities of the mechanism: (columns of screws, nv)

    def generalized_forces(self, Q: Series) -> Series:
        """G^T Q of forces or momenta of all joints: (..., nv, k)."""
        return self.G.T @ Q

    def generalized_matrix(self, M: Series) -> Series:
        """G^T M G of a matrix of all joints: (..., nv, nv)."""
        return M.map(lambda M: self.G.T @ M @ self.G)


def kinematic_tree(mechanism: Mechanism, q: Series, base: BaseMotion | None = None) -> KinematicTree:
    """The tree of a mechanism at coordinates q, whose base moves; no base: that of a fixed robot is at rest."""
    behind = joints(mechanism, q)
    if base is None and mechanism.base is None:
        return KinematicTree(behind, mechanism.M, mechanism.G)
    shifted = [replace(joint, parent=joint.parent + 1) for joint in behind]
    return KinematicTree([FreeJoint(base or STILL), *shifted], *_with_base(mechanism))


@lru_cache(maxsize=64)
def _with_base(mechanism: Mechanism) -> tuple[Array, Array]:
    """M and G of a tree whose first body is the base."""
    M = concatenate([mechanism.base_inertia[None], mechanism.M], axis=-3)
    return M, concatenate([base_columns(mechanism), mechanism.G @ joint_columns(mechanism)], axis=-2)
