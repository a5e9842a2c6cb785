"""The steps of RNEA for one joint, outward and inward, with moments of mass, in frames on the joint axes.

A point r of body i has the acceleration a_i + K_i r, in body coordinates, with a_i that of the frame's origin and
``K = hat(wdot) + hat(w) hat(w)``. With the body's mass m, first moment h and second moments P, all constant in its
frame, its inertia force and moment about the origin are

    f = m a + K h,    n = h x a + axial(K P),

so that rates of f and n take no product rule for the inertia, and no linear velocity occurs at all.
"""

from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np

from jounce.core.scalars import Array, is_zero
from jounce.dynamics.recursion.joints import motions, placed, rows, transport
from jounce.model.coordinates import joint_variables
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import axial, hat, position, rotation
from jounce.spatial.series import Series

Moments = tuple[Array, Array, Array]  # of a body: mass m, first moment h, second moments P

_Z = np.eye(3, dtype=int)[:, 2:]
_Z_HAT = hat(_Z[:, 0])


@dataclass(frozen=True)
class AlignedJoint:
    """One joint at an instant: it turns by theta about the z axis of its body and slides by d along it."""

    parent: int
    R: Array  # rotation of the body frame in its parent's at theta = 0, and the offset of its origin
    r: Array
    turn: Array  # rotation about z by theta
    theta: Series
    turns: bool  # False: prismatic
    d: Series | None  # None: revolute
    pitch: Array  # (1,) of the screw; 1 for a prismatic joint

    def to_body(self, x: Series) -> Series:
        """Body coordinates of vectors given in the parent's."""
        x = self.R.T @ x
        return transport(self.turn.mT, -_Z_HAT, self.theta.dot, x) if self.turns else x

    def to_parent(self, x: Series) -> Series:
        """Parent's coordinates of vectors given in the body's."""
        return self.R @ (transport(self.turn, _Z_HAT, self.theta.dot, x) if self.turns else x)


@dataclass(frozen=True)
class BodyMotion:
    """The motion of a body, in body coordinates."""

    w: Series  # angular velocity
    a: Series  # acceleration of the frame's origin
    K: Series  # and its change from point to point


@dataclass(frozen=True)
class Force:
    """The force that acts on a body, and its moment about the frame's origin."""

    f: Series
    n: Series

    def __add__(self, other: "Force") -> "Force":
        return Force(self.f + other.f, self.n + other.n)


def outward(joint: AlignedJoint, parent: BodyMotion) -> BodyMotion:
    """Return the motion of a body from that of its parent."""
    w = joint.to_body(parent.w)
    if joint.turns:
        w = w + _Z * joint.theta.dot
    hat_w = w.map(_hat)
    K = hat_w.dot + hat_w @ hat_w
    a = point_acceleration(joint, parent.a, parent.K)
    if joint.d is not None:
        a = a + (K @ _Z) * joint.d + _Z * joint.d.dot.dot + 2 * (hat_w @ _Z) * joint.d.dot
    return BodyMotion(w, a, K)


def outward_at_rest(joint: AlignedJoint, parent: BodyMotion) -> BodyMotion:
    """Return the same for a robot at rest, whose ground accelerates."""
    return BodyMotion(parent.w, point_acceleration(joint, parent.a, parent.K), parent.K)


def outward_velocity(joint: AlignedJoint, parent: BodyMotion) -> BodyMotion:
    """Return the velocity field of a body, v + hat(w) r, from that of its parent: v in the place of a, hat(w) of K."""
    w = joint.to_body(parent.w)
    if joint.turns:
        w = w + _Z * joint.theta.dot
    hat_w = w.map(_hat)
    v = point_acceleration(joint, parent.a, parent.K)
    if joint.d is not None:
        v = v + (hat_w @ _Z) * joint.d + _Z * joint.d.dot
    return BodyMotion(w, v, hat_w)


def point_acceleration(joint: AlignedJoint, a: Series, K: Series) -> Series:
    """Return the acceleration, or velocity, of the parent's point at which the joint begins."""
    return joint.to_body(a + K @ joint.r)


def inertia_force(moments: Moments, motion: BodyMotion) -> Force:
    """Return the force that the acceleration a + K r of a body requires."""
    (m, h, P), a, K = moments, motion.a, motion.K
    return Force(a * m + K @ h, _hat(h) @ a + (K @ P).map(lambda T: axial(T)[..., None]))


def joint_force(joint: AlignedJoint, force: Force) -> Series:
    """Project the force on a body onto its joint: the generalized force (..., 1, 1) that balances it."""
    parts = [rows(force.n, 2, 3)] if joint.turns else []
    parts += [rows(force.f, 2, 3) * joint.pitch] if joint.d is not None else []
    return reduce(add, parts)


def inward(joint: AlignedJoint, force: Force) -> Force:
    """Transport the force on a body to its parent."""
    n = force.n if joint.d is None else force.n + (_Z_HAT @ force.f) * joint.d
    f = joint.to_parent(force.f)
    return Force(f, joint.to_parent(n) + _hat(joint.r) @ f)


def aligned_joints(chain: Mechanism, q: Series) -> list[AlignedJoint]:
    """The joints of a mechanism in frames on their axes, for coordinates q."""
    theta = joint_variables(chain, q)
    T = motions(chain, theta[0], range(chain.nb))
    joints = []
    for i, (B, X, p) in enumerate(zip(placed(chain)[0], chain.X, chain.parent, strict=True)):
        theta_i = rows(theta, i, i + 1)
        d = None if is_zero(X[5]) else theta_i * X[5:]
        turn = rotation(T[..., i, :, :])
        joints.append(AlignedJoint(p, rotation(B), position(B), turn, theta_i, not is_zero(X[2]), d, pitch=X[5:]))
    return joints


def _hat(column: Array) -> Array:
    return hat(column[..., 0])
