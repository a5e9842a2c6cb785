"""The tree of joints that the sweeps run over: those of a mechanism, behind that of a ground that moves.

The ground that carries a fixed robot moves as a base does, but has neither inertia nor velocities of its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from jounce.core.scalars import Array, concatenate, is_symbolic
from jounce.dynamics.recursion.joints import MovingJoint, joints
from jounce.dynamics.recursion.steps import AnyJoint, aligned_joints
from jounce.dynamics.state import JointMotion, add_moving_ground
from jounce.model.coordinates import velocity_map
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series

J = TypeVar("J", MovingJoint, AnyJoint)


@dataclass(frozen=True)
class KinematicTree(Generic[J]):
    """The joints at an instant, each after its parent, the inertia of their bodies, and the velocities they follow."""

    mechanism: Mechanism  # on the ground that moves, if it does
    joints: Sequence[J]
    G: Array  # velocities of all joints, six of a base, from those of the mechanism: (columns of screws, nv)
    own: range  # the places of the joints that are those of the mechanism

    @property
    def M(self) -> Array:
        """(len(joints), 6, 6)."""
        return self.mechanism.M

    def generalized_forces(self, Q: Series) -> Series:
        """G^T Q of forces or momenta of all joints: (..., nv, k)."""
        return self.G.T @ Q

    def generalized_matrix(self, M: Series) -> Series:
        """G^T M G of a matrix of all joints: (..., nv, nv)."""
        identity = np.array_equal(self.G, np.eye(*self.G.shape, dtype=int))
        return M.map(lambda M: M if identity and is_symbolic(M) else self.G.T @ M @ self.G)


def kinematic_tree(m: Mechanism, q: Series, base: JointMotion | None = None) -> KinematicTree[MovingJoint]:
    """The tree of a mechanism at coordinates q, whose base moves; no base: that of a fixed robot is at rest."""
    return _tree(m, q, base, joints)


def aligned_tree(m: Mechanism, q: Series, base: JointMotion | None = None) -> KinematicTree[AnyJoint]:
    """The same of a mechanism whose frames are on the axes of its joints."""
    return _tree(m, q, base, aligned_joints)


def _tree(
    m: Mechanism,
    q: Series,
    base: JointMotion | None,
    joints_of: Callable[[Mechanism, Series, JointMotion | None], Sequence[J]],
) -> KinematicTree[J]:
    if m.floats or base is None:
        return KinematicTree(m, joints_of(m, q, base), velocity_map(m), range(m.nb))
    G = concatenate([np.zeros((6, m.nv), dtype=int), m.G], axis=-2)
    moving = add_moving_ground(m)
    return KinematicTree(moving, joints_of(moving, q, base), G, range(1, moving.nb))
