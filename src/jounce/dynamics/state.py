"""What laws take: the state of a motion at an instant, and the motions of joints of several screws.

These are a base that floats, the ground of a fixed robot, and any other.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from operator import add

import numpy as np

from jounce.core.scalars import Array
from jounce.model import positions
from jounce.model.mechanism import Mechanism
from jounce.spatial.lie import ad, pose, position, rotation, wedge
from jounce.spatial.series import Series, from_rate

_NO_SERIES = Series.of(())


@dataclass(frozen=True, eq=False)
class JointMotion:
    """The pose and velocities of a joint of several screws.

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
        """The same motion about an inertial origin at the base.

        No digits are lost there, however far away the base is.
        """
        return replace(self, pose=pose(rotation(self.pose), 0 * position(self.pose)))


BASE_AT_REST = JointMotion(np.eye(4, dtype=int), Series.constant(np.zeros((6, 1), dtype=int)))  # at the inertial frame


def motion_of_joint(m: Mechanism, body: int, q: Series, base: JointMotion | None) -> JointMotion:
    """Return the motion of a joint of several screws, or base.

    The base has the motion that is given; other joints move with coordinates q.
    """
    if m.floats and body == 0:
        return base or BASE_AT_REST
    joint = positions.multiscrew_joints(m)[body]
    return JointMotion(joint.motion(q[0]), q.dot.map(lambda x: x[..., joint.coordinates, :]))


def velocity_drift(m: Mechanism, q: Series, base: JointMotion | None) -> Series | None:
    """Return a, by which displacements d change velocities nu.

    They change by d' + a d, and a is (..., nv, nv). It is zero but for joints of several screws: ``a = X^T ad(X nu) X``
    of each, on the diagonal; ad(V) of a floating base. None where there is no such joint.
    """
    unit, parts = np.eye(m.nv, dtype=int), list[Series]()
    # Without the motion of a base that floats, it is at rest: ad(V) is zero.
    if m.floats and base:
        parts.append(unit[:, :6] @ base.V.map(lambda V: ad(V[..., 0])) @ unit[:6])
    for i, joint in positions.multiscrew_joints(m).items():
        # X^T picks the velocities of twists that the unit screws X span; those of a base come first.
        X, first = joint.group.X, m.nv - m.n
        places = slice(first + joint.coordinates.start, first + joint.coordinates.stop)
        twist = X @ motion_of_joint(m, i, q, base).V
        parts.append(unit[:, places] @ (X.T @ twist.map(lambda V: ad(V[..., 0])) @ X) @ unit[places])
    return reduce(add, parts) if len(parts) > 0 else None


@lru_cache(maxsize=64)
def add_moving_ground(m: Mechanism) -> Mechanism:
    """Return a fixed robot on a massless body that moves.

    It moves as a base does.
    """
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


@dataclass(frozen=True)
class State:
    """The argument of laws: a motion at an instant, with its rates, and the body and frame of the quantity.

    Coordinates are columns (..., n, 1), forces (..., nv, 1), wrenches on the bodies (..., 6nb, 1).
    """

    q: Series
    W: Series | None = None
    Q: Series = _NO_SERIES  # generalized forces, where a quantity takes them
    motors: Series = _NO_SERIES  # theta, thetad, and tau or q4d, where a quantity takes them: no rates of each other
    base: JointMotion | None = None  # None: the ground of a fixed robot, at rest, or of no effect
    body: str | None = None  # a body or a link merged into one; None: all bodies
    frame: str = "body"  # of twists: "body", "world" or "spatial"
    stiffness: Series | None = None  # of joints with two motors, (..., k, 1)
    active: Array | None = None  # of contacts, (..., r): 1 where a row of their limits holds with equality, else 0
    presence: Series | None = None  # of contacts, (..., contacts): multiplies the inverses of their weights
    position: Array | None = None  # of a closed robot, all coordinates (..., N, 1) of its tree, with loops closed

    @property
    def motion_of_base(self) -> JointMotion:
        """The motion of the base: at rest at the inertial frame unless it is given."""
        return self.base or BASE_AT_REST


Law = Callable[[Mechanism, State], Series]
