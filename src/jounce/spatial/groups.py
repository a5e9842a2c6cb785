"""The motions that a joint of several screws allows: turns about a point, motions in a plane, all motions.

They are subgroups of SE(3). Where such a joint is, numbers p say: the place of its origin, if that moves, then the
rotation as a quaternion (x, y, z, w) or, in a plane, as cosine and sine. What moves it is a twist nu in the axes that
move, ``H' = H wedge(X nu)`` with screws X that are columns of the unit matrix. The length of a quaternion, or of cosine
and sine, does not matter unless it is zero.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from jounce.core.scalars import Array, concatenate, reciprocal, sqrt
from jounce.spatial.lie import Ad, hat, pose, position, rotation, to_quaternion

_I = np.eye(3, dtype=int)
SPAN_ROUNDING = 1e-12  # of directions, and of levers: what rounding leaves of screws that span a group
VELOCITIES = ("wx", "wy", "wz", "vx", "vy", "vz")


@dataclass(frozen=True)
class Group:
    """A subgroup of motions.

    Attributes
    ----------
    name : str
        Of the joint: "ball", "planar" or "free".
    axes : tuple of int
        Which components of a twist it has: its screws are these columns of the unit matrix, in this order.
    places : tuple of int
        Those of its numbers p that are the place of the origin; the others are the rotation.
    positions : tuple of str
        What its numbers p are called.
    """

    name: str
    axes: tuple[int, ...]
    positions: tuple[str, ...]
    places: tuple[int, ...]
    turn: Callable[[Array], Array]  # the rotation (..., 3, 3) of the numbers behind the places, (..., k)
    turning: Callable[[Array], Array]  # the rates (..., k, 3) of these by an angular velocity

    @property
    def X(self) -> np.ndarray:
        """The screws, (6, k)."""
        return np.eye(6, dtype=int)[:, list(self.axes)]

    @property
    def velocities(self) -> tuple[str, ...]:
        """The names of its velocities."""
        return tuple(VELOCITIES[axis] for axis in self.axes)

    @property
    def extents(self) -> tuple[str, ...]:
        """The values that limits of its position bound.

        They are as many as it has velocities: first those of the turn, then the place. In a plane a turn is its angle.
        Others are a swing, the angle between the z axes before and after the turn, the angle of the whole turn, and its
        twist about the z axis that it moves: the turn is that twist, then a swing about an axis square to z.
        """
        turns = ("angle",) if self is PLANAR else ("swing", "angle", "twist")
        return (*turns, *self.positions[: len(self.places)])

    @property
    def resting(self) -> np.ndarray:
        """The numbers p of the unit matrix."""
        return self.numbers(np.eye(4))

    def pose(self, p: Array) -> Array:
        """Return H (..., 4, 4) at p (..., numbers)."""
        # In a plane the place has two numbers: z is 0.
        count = len(self.places)
        r = p[..., :count, None]
        place = concatenate([r, 0 * p[..., : 3 - count, None]], axis=-2) if count < 3 else r
        return pose(self.turn(p[..., count:]), place)

    def numbers(self, H: np.ndarray) -> np.ndarray:
        """Return p (..., numbers) of poses (..., 4, 4) of floats.

        w of quaternions is not negative.
        """
        # (w, x, y, z) -> (x, y, z, w), or cosine and sine from the first column.
        turn = np.roll(to_quaternion(rotation(H)), -1, axis=-1) if self is not PLANAR else H[..., :2, 0]
        return np.concatenate([H[..., list(self.places), 3], turn], axis=-1)

    def extent(self, p: np.ndarray) -> np.ndarray:
        """Return what limits bound at p (..., k) of floats.

        Angles are from -pi to pi, swings and angles of whole turns from 0 to pi.
        """
        count = len(self.places)
        *v, w = np.moveaxis(p[..., count:], -1, 0)
        if self is PLANAR:
            turns = [np.arctan2(w, *v)]
        else:
            # Half the swing has the tangent |(x, y)| / |(z, w)|, half the angle |v| / |w|, half the twist z / w.
            # Q and -Q are one rotation: the sign with w >= 0 gives the shorter way.
            x, y, z = v
            across, about, sign = np.hypot(x, y), np.hypot(z, w), np.where(w < 0, -1, 1)
            swing, angle = np.arctan2(across, about), np.arctan2(np.hypot(across, z), np.abs(w))
            twist = np.arctan2(sign * z, sign * w)
            turns = [2 * swing, 2 * angle, 2 * twist]
        return np.concatenate([np.stack(turns, axis=-1), p[..., :count]], axis=-1)

    def moves(self, p: Array) -> Array:
        """Return the matrix (..., numbers, k) with p' = moves nu."""
        R, count = self.turn(p[..., len(self.places) :]), len(self.places)
        linear = R[..., :count, :] @ self.X[3:]
        return concatenate([linear, self.turning(p[..., count:]) @ self.X[:3]], axis=-2)


@singledispatch
def rotation_from_quaternion(p: Array) -> Array:
    """Return the rotation (..., 3, 3) of a quaternion (..., 4)."""
    # I + 2 (w v~ + v~^2) / |p|^2, for a quaternion of any length
    v, w = hat(p[..., :3]), p[..., 3:, None]
    return _I + 2 * reciprocal(p[..., None, :] @ p[..., :, None]) * (w * v + v @ v)


def _quaternion_rates(p: Array) -> Array:
    """Return the matrix (..., 4, 3) from angular velocity to p'.

    The velocity is in the axes of the body.
    """
    # v' = (w I + v~) omega / 2, w' = -v . omega / 2
    upper = hat(p[..., :3]) + p[..., 3:, None] * _I
    return concatenate([upper, -p[..., None, :3]], axis=-2) * 0.5


@singledispatch
def rotation_from_angle(p: Array) -> Array:
    """Return the rotation about z of cosine and sine.

    (..., 2) to (..., 3, 3).
    """
    # Both may be of any length, and are made a unit vector.
    unit = reciprocal(sqrt(p[..., None, :] @ p[..., :, None])) * p[..., :, None]
    c, s, zero = unit[..., :1, :], unit[..., 1:, :], 0 * unit[..., :1, :]
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, zero + 1]]
    return concatenate([concatenate(row, axis=-1) for row in rows], axis=-2)


def _angle_rates(p: Array) -> Array:
    """Return the matrix (..., 2, 3) from angular velocity to p'.

    Only z of the velocity counts.
    """
    # (c, s)' = (-s, c) omega_z
    quarter_turn = concatenate([-p[..., 1:, None], p[..., :1, None]], axis=-2)
    return quarter_turn @ _I[2:]


_QUATERNION = ("qx", "qy", "qz", "qw")
BALL = Group("ball", (0, 1, 2), _QUATERNION, (), rotation_from_quaternion, _quaternion_rates)
PLANAR = Group("planar", (2, 3, 4), ("x", "y", "cos", "sin"), (0, 1), rotation_from_angle, _angle_rates)
FREE = Group(
    "free", (0, 1, 2, 3, 4, 5), ("x", "y", "z", *_QUATERNION), (0, 1, 2), rotation_from_quaternion, _quaternion_rates
)
GROUPS: Mapping[str, Group] = {group.name: group for group in (BALL, PLANAR, FREE)}


def find_group(X: Array) -> tuple[Group, Array] | None:
    """Return the group that screws X (6, k) span, and its pose.

    It is the pose T of the frame of the joint. ``X = Ad(T) group.X``. It is None where they span none of the three
    groups, in the order that the group has.
    """
    # Balls and planar joints have three screws each; the error shows which of them it is.
    for group in GROUPS.values():
        if len(group.axes) == X.shape[1]:
            T = _frame(group, X)
            R, error = np.asarray(rotation(T), dtype=float), np.abs(np.asarray(Ad(T) @ group.X - X, dtype=float))
            # The slide of a screw that turns is a length, of the size of the lever, by which its error is divided.
            error[3:, group.X[:3].any(axis=0)] /= np.abs(position(T)).astype(float).max() or 1.0
            if max(np.abs(R.T @ R - _I).max(), error.max()) <= SPAN_ROUNDING and np.linalg.det(R) > 0:
                return group, T
    return None


def _frame(group: Group, X: Array) -> Array:
    """Return the pose of the axes of a joint.

    Its origin is the one nearest to that of the body.
    """
    # In a plane: x and y are the slides, z is the turn, and xi x eta the point of its axis nearest to the origin.
    if group is PLANAR:
        R = np.stack([X[3:, 1], X[3:, 2], X[:3, 0]], axis=-1)
        return pose(R, np.cross(X[:3, 0], X[3:, 0])[:, None])
    # eta_k = c x xi_k for the center c: the sum of xi_k x eta_k over three perpendicular axes is 2 c.
    R, moments = X[:3, :3], X[3:, :3]
    return pose(R, np.cross(R.T, moments.T).sum(axis=0)[:, None] / 2)
