"""RNEA gives generalized forces with rates by two sweeps.

One goes outward over the tree, the other inward. It works with moments of mass, in the frames with most zeros, on the
joint axes. A point r of body i has the acceleration a_i + K_i r, in body coordinates, with a_i that of the frame's
origin and ``K = hat(wdot) + hat(w) hat(w)``. With the body's mass m, first moment h and second moments P, all constant
in its frame, its inertia force and moment about the origin are

    f = m a + K h,    n = h x a + axial(K P),

so that rates of f and n take no product rule for the inertia, and no linear velocity occurs at all.

`AlignedJoint` and `FreeAlignedJoint` take motions outward and forces inward across one joint, `propagate_motion` and
its likes are the steps from parent to body. The order of steps is written once, in `sweep`: a `Sweep` specifies what
the bodies pass on; a `Tree` stores the numbers and performs the steps, here on time series, in native code in memory,
by a loop over the bodies. `rnea` is the door; `base_wrench` and `joint_wrenches` read the same sweep elsewhere.

How often what runs: `sweep` once per evaluation, each of its steps once per body. In time series the steps set up
formulas, whose rates are computed when they are asked for, up to the order of Q.

RNEA: R. Featherstone, Rigid Body Dynamics Algorithms, 5.3. Its rates: C. Guarino Lo Bianco, IEEE Trans. Robotics 25(4),
2009, the first; G. Buondonno, A. De Luca, IROS 2015, the second; S. Kumar, A. Müller, ICRA 2021, any.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache, reduce
from operator import add
from typing import Any, Protocol, TypeAlias

import numpy as np

from jounce.core.scalars import Array, is_zero
from jounce.dynamics.recursion.joints import (
    batch_zeros,
    joint_transforms,
    split_placements,
    take_rows,
    transport_inward,
)
from jounce.dynamics.recursion.tree import KinematicTree, build_tree, evaluate_in_order
from jounce.dynamics.state import JointMotion, motion_of_joint
from jounce.model import coordinates
from jounce.model.equivalent_mechanisms import align_to_axes, frame_shifts, minimal_mechanism
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia
from jounce.spatial.lie import Ad, axial, hat, inverse, position, rotation
from jounce.spatial.series import Series, from_rate, from_rates, join_series

Moments = tuple[Array, Array, Array]  # of a body: mass m, first moment h, second moments P
_Z_COLUMN = np.eye(3, dtype=int)[:, 2:]
_Z_HAT = hat(_Z_COLUMN[:, 0])
_ZERO_VECTOR = Series.constant(np.zeros((3, 1), dtype=int))
_ZERO_MATRIX = Series.constant(np.zeros((3, 3), dtype=int))


@dataclass(frozen=True)
class BodyMotion:
    """The motion of a body, in body coordinates."""

    w: Series  # angular velocity
    a: Series  # acceleration of the frame's origin
    K: Series  # and its change from point to point


@dataclass(frozen=True)
class BodyForce:
    """The force on a body, and its moment about the frame's origin."""

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
        """Return body coordinates of vectors given in the parent's."""
        # x_b = turn^T R^T x_p, with the rate x_b' = turn^T R^T x_p' - theta' z x x_b.
        x = self.R.T @ x
        if not self.turns:
            return x
        return from_rates(lambda k: self.turn.mT @ x[k], lambda y: self.theta.dot * (-_Z_HAT @ y))

    def to_parent(self, x: Series) -> Series:
        """Return the parent's coordinates of vectors given in the body's."""
        if not self.turns:
            return self.R @ x
        return self.R @ from_rates(lambda k: self.turn @ x[k], lambda y: self.theta.dot * (_Z_HAT @ y))

    def angular_velocity(self, w: Series) -> Series:
        """Return the angular velocity of the body, w + z theta'.

        w is that of the parent. Both are in body coordinates.
        """
        return w + _Z_COLUMN * self.theta.dot if self.turns else w

    def origin_acceleration(self, a: Series, w_parent: Series, hat_w: Series, K: Series) -> Series:
        """Return the acceleration of the body's origin.

        It follows from that of the point where the joint begins. The point is one of the parent, whose angular velocity
        is `w_parent` in body coordinates.
        """
        if self.d is None:
            return a
        # a + K z d + z d'' + 2 w x z d': the axis turns with the body, along which the origin slides.
        return a + (K @ _Z_COLUMN) * self.d + _Z_COLUMN * self.d.dot.dot + 2 * (hat_w @ _Z_COLUMN) * self.d.dot

    def origin_velocity(self, v: Series, hat_w: Series) -> Series:
        """Return the velocity of the body's origin from that point's."""
        return v if self.d is None else v + (hat_w @ _Z_COLUMN) * self.d + _Z_COLUMN * self.d.dot

    def force(self, force: BodyForce) -> Series:
        """Project the force on a body onto its joint, (..., 1, 1)."""
        # n_z of joints that turn, h f_z of those that slide; helical joints do both.
        parts = []
        if self.turns:
            parts.append(take_rows(force.n, 2, 3))
        if self.d is not None:
            parts.append(take_rows(force.f, 2, 3) * self.pitch)
        return reduce(add, parts)

    def inward(self, force: BodyForce) -> BodyForce:
        """Transport the force on a body to its parent."""
        # The moment about the origin where d = 0, then the one about the parent's origin: n + d z x f, n + r x f.
        n = force.n if self.d is None else force.n + (_Z_HAT @ force.f) * self.d
        f = self.to_parent(force.f)
        return BodyForce(f, self.to_parent(n) + _hat(self.r) @ f)

    def gravity_at_body(self, field: Series, work: Series) -> tuple[Series, Series]:
        """Return g and g . r of a body from its parent's."""
        work = work + self.r.T @ field
        field = self.to_body(field)
        return field, work if self.d is None else work + (_Z_COLUMN.T @ field) * self.d


@dataclass(frozen=True)
class FreeAlignedJoint:
    """One joint of several screws at an instant.

    Its body turns with w and slides with v against the parent, both in body coordinates.
    """

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

    def angular_velocity(self, w: Series) -> Series:
        return w + self.w

    def origin_acceleration(self, a: Series, w_parent: Series, hat_w: Series, K: Series) -> Series:
        """Return the acceleration of the body's origin.

        a is that of the parent's point at which it is.
        """
        # a + v' + 2 w_p x v + w x v: v has components in body axes, which turn with w against the parent.
        return a + self.v.dot + 2 * (w_parent.map(_hat) @ self.v) + self.w.map(_hat) @ self.v

    def origin_velocity(self, v: Series, hat_w: Series) -> Series:
        return v + self.v

    def force(self, force: BodyForce) -> Series:
        """Project the force on a body onto its joint's screws.

        The shape is (..., k, 1).
        """
        return self.X[:3].T @ force.n + self.X[3:].T @ force.f

    def inward(self, force: BodyForce) -> BodyForce:
        f = self.to_parent(force.f)
        return BodyForce(f, self.to_parent(force.n) + self.r.map(_hat) @ f)

    def gravity_at_body(self, field: Series, work: Series) -> tuple[Series, Series]:
        return self.to_body(field), work + self.r.mT @ field


AnyJoint: TypeAlias = AlignedJoint | FreeAlignedJoint


def propagate_motion(joint: AnyJoint, parent: BodyMotion) -> BodyMotion:
    """Return the motion of a body from that of its parent."""
    w_parent = joint.to_body(parent.w)
    w = joint.angular_velocity(w_parent)
    hat_w = w.map(_hat)
    K = hat_w.dot + hat_w @ hat_w
    a = joint.origin_acceleration(point_acceleration(joint, parent.a, parent.K), w_parent, hat_w, K)
    return BodyMotion(w, a, K)


def propagate_acceleration(joint: AnyJoint, parent: BodyMotion) -> BodyMotion:
    """Return the same for a robot at rest, whose ground accelerates."""
    return BodyMotion(parent.w, point_acceleration(joint, parent.a, parent.K), parent.K)


def propagate_velocity(joint: AnyJoint, parent: BodyMotion) -> BodyMotion:
    """Return the velocity field of a body from that of its parent.

    The field is v + hat(w) r. In a `BodyMotion` v takes the place of a, and hat(w) that of K.
    """
    w = joint.angular_velocity(joint.to_body(parent.w))
    hat_w = w.map(_hat)
    return BodyMotion(w, joint.origin_velocity(point_acceleration(joint, parent.a, parent.K), hat_w), hat_w)


def point_acceleration(joint: AnyJoint, a: Series, K: Series) -> Series:
    """Return the acceleration, or velocity, of the point where the joint begins.

    It is a point of the parent.
    """
    return joint.to_body(a + K @ joint.r)


def inertia_force(moments: Moments, motion: BodyMotion) -> BodyForce:
    """Return the force that the accelerations of a body require.

    Its points r have accelerations a + K r.
    """
    (m, h, P), a, K = moments, motion.a, motion.K
    return BodyForce(a * m + K @ h, _hat(h) @ a + (K @ P).map(lambda T: axial(T)[..., None]))


def aligned_joints(chain: Mechanism, q: Series, base: JointMotion | None = None) -> list[AnyJoint]:
    """Return the joints of a mechanism in frames on their axes.

    `base` is the motion of a base that floats.
    """
    theta = coordinates.joint_variables(chain, q)
    places, T = joint_transforms(chain, theta[0], range(chain.nb))
    aligned: list[AnyJoint] = []
    for i, (B, p) in enumerate(zip(split_placements(chain)[0], chain.parent, strict=True)):
        if i in places:
            # One screw, (0, 0, 1, 0, 0, h) or (0, 0, 0, 0, 0, 1): it turns if its third number is not zero, and slides
            # by its last one.
            [j] = chain.columns[i]
            X, theta_i = chain.X[j], take_rows(theta, j, j + 1)
            d = None if is_zero(X[5]) else theta_i * X[5:]
            place = (p, rotation(B), position(B), rotation(T[..., places[i], :, :]))
            aligned.append(AlignedJoint(*place, theta_i, not is_zero(X[2]), d, pitch=X[5:]))
        else:
            motion = motion_of_joint(chain, i, q, base)
            aligned.append(free_joint(p, B, coordinates.body_screws(chain, i), motion.pose, motion.V))
    return aligned


def free_joint(parent: int, B: Array, X: Array, T: Array, nu: Series) -> FreeAlignedJoint:
    """Return a joint of several screws X at the pose T.

    X is (6, k); nu are its velocities.
    """
    w, v = X[:3] @ nu, X[3:] @ nu
    # The origin in the frame that the joint moves from: its rate is v, seen from there.
    displacement = from_rate(position(T), lambda _: _turn_back(rotation(T), w, v))
    return FreeAlignedJoint(parent, rotation(B), rotation(B) @ displacement + position(B), rotation(T), X, w, v)


def _turn_back(turn: Array, w: Series, x: Series) -> Series:
    """Return vectors in the frame that a joint turns from.

    They are given in the frame that the joint turns with w.
    """
    hat_w = w.map(_hat)
    return transport_inward(x, lambda x: turn @ x, lambda x: hat_w @ x)


def _hat(column: Array) -> Array:
    return hat(column[..., 0])


def aligned_tree(m: Mechanism, q: Series, base: JointMotion | None = None) -> KinematicTree[AnyJoint]:
    """Return the tree in frames on the axes of its joints."""
    return build_tree(m, q, base, aligned_joints)


# The sweep, wherever its numbers are stored.
@dataclass(frozen=True)
class Sweep:
    """The parts of motions, their step outward, and required forces.

    `parts` are the nonzero parts of `BodyMotion`; each has the number of rates that it needs in addition to those of Q.
    """

    parts: Mapping[str, int]
    outward: Callable[[AnyJoint, BodyMotion], BodyMotion]
    force: Callable[[Moments, BodyMotion], BodyForce] = inertia_force


MOVING_SWEEP = Sweep({"w": 1, "a": 0, "K": 0}, propagate_motion)
RESTING_SWEEP = Sweep({"a": 0}, propagate_acceleration)  # under gravity alone


class Tree(Protocol):
    """The bodies of a mechanism, wherever their data are stored.

    A body is identified by its index.
    """

    def outward(self) -> Iterator[Any]:
        """Yield the bodies, each after its parent."""

    def inward(self) -> Iterator[Any]:
        """Yield the bodies, each before its parent."""

    def move(self, i: Any) -> None:
        """Compute the motion of a body, and the force it requires."""

    def add_wrench(self, i: Any) -> None:
        """Add the wrench that a body exerts to its force."""

    def hand_on(self, i: Any) -> None:
        """Project the force on a body, and pass it on.

        The projection is onto the joint, the rest is added to the force on the parent.
        """

    def collect(self, i: Any) -> None:
        """Add the force of a joint to those of its coordinates."""


def sweep(tree: Tree) -> None:
    """Compute motions and inertia forces outward, then joint forces inward."""
    for i in tree.outward():
        tree.move(i)
        tree.add_wrench(i)
    for i in tree.inward():
        tree.hand_on(i)
        tree.collect(i)


def ground(gravity: Array) -> BodyMotion:
    """Return the motion of the ground: it accelerates by -g, which replaces gravity."""
    return BodyMotion(_ZERO_VECTOR, Series.constant(-gravity[:, None]), _ZERO_MATRIX)


def rnea(kind: Sweep, m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None) -> Series:
    """Return the generalized forces of (EOM1).

    They are (..., nv, 1), with wrenches W on the bodies, (..., 6nb, 1).
    """
    # Base parameters have most zeros, and the same generalized forces.
    return _run_sweep(kind, m, minimal_mechanism(m), q, W, base).forces()


def base_wrench(m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None) -> Series:
    """Return the wrench on the base about the inertial origin.

    The wrench (moment; force) is (..., 6, 1). Axes are inertial. It is what the bodies pass to the ground. It depends
    on all of the inertia, drive forces on base parameters only.
    """
    return _run_sweep(MOVING_SWEEP, m, align_to_axes(m), q, W, base).wrench(-1)


def joint_wrenches(m: Mechanism, q: Series, W: Series | None = None, base: JointMotion | None = None) -> Series:
    """Return the wrenches of joints on their bodies, in body frames.

    The wrenches (moment; force) are (..., nb, 6). They are the forces on the bodies and on what these carry, before
    they are projected on the joints.
    """
    chain = align_to_axes(m)
    # Wrenches about the origins on the axes, then about those of the given body frames.
    swept = _run_sweep(MOVING_SWEEP, m, chain, q, W, base)
    to_given = Ad(inverse(frame_shifts(m, chain))).mT
    return join_series([(E @ swept.wrench(i)).mT for i, E in zip(swept.tree.own, to_given, strict=True)], axis=-2)


def _run_sweep(
    kind: Sweep, m: Mechanism, chain: Mechanism, q: Series, W: Series | None, base: JointMotion | None
) -> "_SeriesTree":
    """Return the tree after both sweeps, in the frames of `chain`.

    Wrenches W are on the frames of m.
    """
    tree = aligned_tree(chain, q, base)
    on_bodies = [] if W is None else shift_wrenches(m, chain, W)
    swept = _SeriesTree(
        kind, tree, q, dict(zip(tree.own, on_bodies, strict=False)), {-1: ground(chain.gravity)}, {}, {}
    )
    sweep(swept)
    return swept


@dataclass(frozen=True)
class _SeriesTree:
    """The tree in time series: motions, forces on the bodies, forces of the joints.

    The steps fill the dictionaries, by body; -1 is the ground.
    """

    kind: Sweep
    tree: KinematicTree[AnyJoint]
    q: Series
    wrenches: Mapping[int, Series]
    motions: dict[int, BodyMotion]
    on: dict[int, BodyForce]
    Q: dict[int, Series]

    def outward(self) -> Iterator[int]:
        yield from range(len(self.tree.joints))

    def inward(self) -> Iterator[int]:
        yield from reversed(range(len(self.tree.joints)))

    def move(self, i: int) -> None:
        joint = self.tree.joints[i]
        self.motions[i] = self.kind.outward(joint, self.motions[joint.parent])
        self.on[i] = self.kind.force(_moments(self.tree.mechanism)[i], self.motions[i])

    def add_wrench(self, i: int) -> None:
        if i in self.wrenches:
            W = self.wrenches[i]
            self.on[i] = self.on[i] + BodyForce(f=take_rows(W, 3, 6), n=take_rows(W, 0, 3))

    def hand_on(self, i: int) -> None:
        joint = self.tree.joints[i]
        self.Q[i] = joint.force(self.on[i])
        p, inward_force = joint.parent, joint.inward(self.on[i])
        # The ground has no force of its own, to which that of its first body would be added.
        self.on[p] = self.on[p] + inward_force if p in self.on else inward_force

    def collect(self, i: int) -> None:
        self.Q[i] = self.Q[i] + batch_zeros(self.q)

    def forces(self) -> Series:
        """Return G^T Q of the joints."""
        return self._in_order(self.tree.generalized_forces(join_series([self.Q[i] for i in self.outward()], axis=-2)))

    def wrench(self, i: int) -> Series:
        """Return the moment and the force on a body or the ground.

        Those on a body include what it carries. The shape is (..., 6, 1).
        """
        return self._in_order(join_series([self.on[i].n, self.on[i].f], axis=-2) + batch_zeros(self.q))

    def _in_order(self, result: Series) -> Series:
        """Return a result that is computed body by body."""
        steps = [*(self.motions[i].a for i in self.outward()), *(self.on[i].n for i in self.inward())]
        return evaluate_in_order(result, steps)


@lru_cache(maxsize=64)
def _moments(chain: Mechanism) -> list[Moments]:
    return [inertia.moments(M) for M in chain.M]


def shift_wrenches(old: Mechanism, chain: Mechanism, W: Series) -> list[Series]:
    """Return wrenches on the frames of `chain`, from those of `old`.

    There is one (..., 6, 1) per body.
    """
    return [Ad_T @ take_rows(W, 6 * i, 6 * i + 6) for i, Ad_T in enumerate(Ad(frame_shifts(old, chain)).mT)]
