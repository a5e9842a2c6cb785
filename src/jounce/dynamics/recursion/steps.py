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
from typing import TypeAlias

import numpy as np

from jounce.core.scalars import Array, is_zero
from jounce.dynamics.recursion.joints import joint_transforms, split_placements, take_rows, transport_inward
from jounce.dynamics.state import JointMotion, motion_of_joint
from jounce.model.coordinates import body_screws, joint_variables
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import axial, hat, position, rotation
from jounce.spatial.series import Series, from_rate, from_rates

Moments = tuple[Array, Array, Array]  # of a body: mass m, first moment h, second moments P

_Z_COLUMN = np.eye(3, dtype=int)[:, 2:]
_Z_HAT = hat(_Z_COLUMN[:, 0])


@dataclass(frozen=True)
class BodyMotion:
    """The motion of a body, in body coordinates."""

    w: Series  # angular velocity
    a: Series  # acceleration of the frame's origin
    K: Series  # and its change from point to point


@dataclass(frozen=True)
class BodyForce:
    """The force that acts on a body, and its moment about the frame's origin."""

    f: Series
    n: Series

    def __add__(self, other: "BodyForce") -> "BodyForce":
        return BodyForce(self.f + other.f, self.n + other.n)


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
        if not self.turns:
            return x
        return from_rates(lambda k: self.turn.mT @ x[k], lambda y: self.theta.dot * (-_Z_HAT @ y))

    def to_parent(self, x: Series) -> Series:
        """Parent's coordinates of vectors given in the body's."""
        if not self.turns:
            return self.R @ x
        return self.R @ from_rates(lambda k: self.turn @ x[k], lambda y: self.theta.dot * (_Z_HAT @ y))

    def turned(self, w: Series) -> Series:
        """The angular velocity of the body from that of the parent, in body coordinates."""
        return w + _Z_COLUMN * self.theta.dot if self.turns else w

    def slid(self, a: Series, carried: Series, hat_w: Series, K: Series) -> Series:
        """The acceleration of the body's origin from that of the parent's point at which the joint begins."""
        if self.d is None:
            return a
        return a + (K @ _Z_COLUMN) * self.d + _Z_COLUMN * self.d.dot.dot + 2 * (hat_w @ _Z_COLUMN) * self.d.dot

    def slid_velocity(self, v: Series, hat_w: Series) -> Series:
        """The same of velocities."""
        return v if self.d is None else v + (hat_w @ _Z_COLUMN) * self.d + _Z_COLUMN * self.d.dot

    def force(self, force: BodyForce) -> Series:
        """Project the force on a body onto its joint: the generalized force (..., 1, 1) that balances it."""
        parts = [take_rows(force.n, 2, 3)] if self.turns else []
        parts += [take_rows(force.f, 2, 3) * self.pitch] if self.d is not None else []
        return reduce(add, parts)

    def inward(self, force: BodyForce) -> BodyForce:
        """Transport the force on a body to its parent."""
        n = force.n if self.d is None else force.n + (_Z_HAT @ force.f) * self.d
        f = self.to_parent(force.f)
        return BodyForce(f, self.to_parent(n) + _hat(self.r) @ f)

    def lowered(self, field: Series, work: Series) -> tuple[Series, Series]:
        """g and g . r of a body from those of its parent."""
        work = work + self.r.T @ field
        field = self.to_body(field)
        return field, work if self.d is None else work + (_Z_COLUMN.T @ field) * self.d


@dataclass(frozen=True)
class FreeAlignedJoint:
    """One joint of several screws at an instant: its body turns with w and slides with v, both in body coordinates."""

    parent: int
    R: Array  # rotation of the body frame in its parent's where the joint has not moved
    r: Series  # the body's origin in the parent's frame
    turn: Array  # rotation of the joint
    X: Array  # (6, k) its screws
    w: Series  # (..., 3, 1)
    v: Series

    def to_body(self, x: Series) -> Series:
        x, hat_w = self.R.T @ x, self.w.map(_hat)
        return from_rates(lambda k: self.turn.mT @ x[k], lambda y: -(hat_w @ y))

    def to_parent(self, x: Series) -> Series:
        return self.R @ _turn_back(self.turn, self.w, x)

    def turned(self, w: Series) -> Series:
        return w + self.w

    def slid(self, a: Series, carried: Series, hat_w: Series, K: Series) -> Series:
        """The acceleration of the body's origin from that of the parent's point at which it is."""
        return a + self.v.dot + 2 * (carried.map(_hat) @ self.v) + self.w.map(_hat) @ self.v

    def slid_velocity(self, v: Series, hat_w: Series) -> Series:
        return v + self.v

    def force(self, force: BodyForce) -> Series:
        """Project the force on a body onto the screws of its joint: the generalized forces (..., k, 1)."""
        return self.X[:3].T @ force.n + self.X[3:].T @ force.f

    def inward(self, force: BodyForce) -> BodyForce:
        f = self.to_parent(force.f)
        return BodyForce(f, self.to_parent(force.n) + self.r.map(_hat) @ f)

    def lowered(self, field: Series, work: Series) -> tuple[Series, Series]:
        return self.to_body(field), work + self.r.mT @ field


AnyJoint: TypeAlias = AlignedJoint | FreeAlignedJoint


def propagate_motion(joint: AnyJoint, parent: BodyMotion) -> BodyMotion:
    """Return the motion of a body from that of its parent."""
    carried = joint.to_body(parent.w)
    w = joint.turned(carried)
    hat_w = w.map(_hat)
    K = hat_w.dot + hat_w @ hat_w
    a = joint.slid(point_acceleration(joint, parent.a, parent.K), carried, hat_w, K)
    return BodyMotion(w, a, K)


def propagate_acceleration(joint: AnyJoint, parent: BodyMotion) -> BodyMotion:
    """Return the same for a robot at rest, whose ground accelerates."""
    return BodyMotion(parent.w, point_acceleration(joint, parent.a, parent.K), parent.K)


def propagate_velocity(joint: AnyJoint, parent: BodyMotion) -> BodyMotion:
    """Return the velocity field of a body, v + hat(w) r, from that of its parent: v in the place of a, hat(w) of K."""
    w = joint.turned(joint.to_body(parent.w))
    hat_w = w.map(_hat)
    return BodyMotion(w, joint.slid_velocity(point_acceleration(joint, parent.a, parent.K), hat_w), hat_w)


def point_acceleration(joint: AnyJoint, a: Series, K: Series) -> Series:
    """Return the acceleration, or velocity, of the parent's point at which the joint begins."""
    return joint.to_body(a + K @ joint.r)


def inertia_force(moments: Moments, motion: BodyMotion) -> BodyForce:
    """Return the force that the acceleration a + K r of a body requires."""
    (m, h, P), a, K = moments, motion.a, motion.K
    return BodyForce(a * m + K @ h, _hat(h) @ a + (K @ P).map(lambda T: axial(T)[..., None]))


def aligned_joints(chain: Mechanism, q: Series, base: JointMotion | None = None) -> list[AnyJoint]:
    """The joints of a mechanism in frames on their axes, for coordinates q and the motion of a base that floats."""
    theta = joint_variables(chain, q)
    places, T = joint_transforms(chain, theta[0], range(chain.nb))
    found: list[AnyJoint] = []
    for i, (B, p) in enumerate(zip(split_placements(chain)[0], chain.parent, strict=True)):
        if i in places:
            [j] = chain.columns[i]
            X, theta_i = chain.X[j], take_rows(theta, j, j + 1)
            d = None if is_zero(X[5]) else theta_i * X[5:]
            place = (p, rotation(B), position(B), rotation(T[..., places[i], :, :]))
            found.append(AlignedJoint(*place, theta_i, not is_zero(X[2]), d, pitch=X[5:]))
        else:
            own = motion_of_joint(chain, i, q, base)
            found.append(free_joint(p, B, body_screws(chain, i), own.pose, own.V))
    return found


def free_joint(parent: int, B: Array, X: Array, T: Array, nu: Series) -> FreeAlignedJoint:
    """A joint of several screws X, (6, k), at T, from which it moves with nu."""
    w, v = X[:3] @ nu, X[3:] @ nu
    way = from_rate(position(T), lambda _: _turn_back(rotation(T), w, v))
    return FreeAlignedJoint(parent, rotation(B), rotation(B) @ way + position(B), rotation(T), X, w, v)


def _turn_back(turn: Array, w: Series, x: Series) -> Series:
    """Vectors in the frame that a joint turns from, given in the one that it turns with w."""
    hat_w = w.map(_hat)
    return transport_inward(x, lambda x: turn @ x, lambda x: hat_w @ x)


def _hat(column: Array) -> Array:
    return hat(column[..., 0])
