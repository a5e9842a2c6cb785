"""Motions of joints of several screws: that of a base that floats, of the ground of a fixed robot, and of any other."""

from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from operator import add

import numpy as np

from jounce.core.scalars import Array
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints
from jounce.spatial.lie import ad, pose, position, rotation, wedge
from jounce.spatial.series import Series, from_rate


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Where a joint of several screws moves its body, and its velocities along the screws with rates.

    Of a base, these are its pose in the inertial frame and its twist in its own axes.
    """

    pose: Array  # (..., 4, 4)
    V: Series  # (..., k, 1), of a base (..., 6, 1)

    @property
    def H(self) -> Series:
        """The pose of a base with its rates."""
        return from_rate(self.pose, lambda H: H @ self.V.map(lambda V: wedge(V[..., 0])))

    @property
    def at_origin(self) -> "JointMotion":
        """The same motion about an inertial origin at the place of the base: no digits are lost far away from it."""
        return replace(self, pose=pose(rotation(self.pose), 0 * position(self.pose)))


BASE_AT_REST = JointMotion(np.eye(4, dtype=int), Series.constant(np.zeros((6, 1), dtype=int)))  # at the inertial frame


def motion_of_joint(m: Mechanism, body: int, q: Series, base: JointMotion | None) -> JointMotion:
    """The motion of the joint of a body, of several screws, at coordinates q: that of the base if it is the base."""
    if m.floats and body == 0:
        return base or BASE_AT_REST
    own = multiscrew_joints(m)[body]
    return JointMotion(own.motion(q[0]), q.dot.map(lambda x: x[..., own.coordinates, :]))


def velocity_drift(m: Mechanism, q: Series, base: JointMotion | None) -> Series | None:
    """a, (..., nv, nv), of joints of several screws: displaced by d, their velocities nu change by d' + a d.

    ``a = X^T ad(X nu) X`` of each, on the diagonal; ad(V) of a floating base. None where there is no such joint.
    """
    unit, parts = np.eye(m.nv, dtype=int), list[Series]()
    if m.floats and base:
        parts.append(unit[:, :6] @ base.V.map(lambda V: ad(V[..., 0])) @ unit[:6])
    for i, x in multiscrew_joints(m).items():
        X, own = x.group.X, slice(m.nv - m.n + x.coordinates.start, m.nv - m.n + x.coordinates.stop)
        twist = X @ motion_of_joint(m, i, q, base).V
        parts.append(unit[:, own] @ (X.T @ twist.map(lambda V: ad(V[..., 0])) @ X) @ unit[own])
    return reduce(add, parts) if parts else None


@lru_cache(maxsize=64)
def add_moving_ground(m: Mechanism) -> Mechanism:
    """A fixed robot on a body without inertia, in the place of the ground, that moves as a base does."""
    return replace(
        m,
        B=np.stack([np.eye(4, dtype=int), *m.B]),
        M=np.stack([np.zeros((6, 6), dtype=int), *m.M]),
        parent=(-1, *(p + 1 for p in m.parent)),
        owners=tuple(i + 1 for i in m.owners),
        bodies=("", *m.bodies),
        frames=(),
        loops=(),
        floats=True,
    )
