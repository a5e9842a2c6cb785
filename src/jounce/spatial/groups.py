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
        """What its velocities are called."""
        return tuple(VELOCITIES[axis] for axis in self.axes)

    @property
    def extents(self) -> tuple[str, ...]:
        """What limits of its position bound, as many as it has velocities: the turn, then the place.

        In a plane a turn is its angle. Others are a swing, the angle between the z axes before and after the turn, the
        angle of the whole turn, and its twist about the z axis that it moves: the turn is that twist, then a swing
        about an axis square to z.
        """
        turns = ("angle",) if self is PLANAR else ("swing", "angle", "twist")
        return (*turns, *self.positions[: len(self.places)])

    @property
    def resting(self) -> np.ndarray:
        """The numbers p of the unit matrix."""
        return self.numbers(np.eye(4))

    def pose(self, p: Array) -> Array:
        """H, (..., 4, 4), at p, (..., numbers)."""
        count = len(self.places)
        r = p[..., :count, None]
        place = concatenate([r, 0 * p[..., : 3 - count, None]], axis=-2) if count < 3 else r
        return pose(self.turn(p[..., count:]), place)

    def numbers(self, H: np.ndarray) -> np.ndarray:
        """p, (..., numbers), of poses of numbers, (..., 4, 4): w of quaternions is not negative."""
        turn = np.roll(to_quaternion(rotation(H)), -1, axis=-1) if self is not PLANAR else H[..., :2, 0]
        return np.concatenate([H[..., list(self.places), 3], turn], axis=-1)

    def extent(self, p: np.ndarray) -> np.ndarray:
        """What limits bound at p of numbers, (..., k): angles of -pi to pi, swings and angles of turns of 0 to pi."""
        count = len(self.places)
        *v, w = np.moveaxis(p[..., count:], -1, 0)
        if self is PLANAR:
            turns = [np.arctan2(w, *v)]
        else:
            x, y, z = v
            away, about, side = np.hypot(x, y), np.hypot(z, w), np.where(w < 0, -1, 1)
            turns = [
                2 * np.arctan2(a, b) for a, b in ((away, about), (np.hypot(away, z), np.abs(w)), (side * z, side * w))
            ]
        return np.concatenate([np.stack(turns, axis=-1), p[..., :count]], axis=-1)

    def moves(self, p: Array) -> Array:
        """(..., numbers, k): p' = moves nu."""
        R, count = self.turn(p[..., len(self.places) :]), len(self.places)
        linear = R[..., :count, :] @ self.X[3:]
        return concatenate([linear, self.turning(p[..., count:]) @ self.X[:3]], axis=-2)


@singledispatch
def rotation_from_quaternion(p: Array) -> Array:
    """The rotation, (..., 3, 3), of a quaternion (..., 4)."""
    v, w = hat(p[..., :3]), p[..., 3:, None]
    return _I + 2 * reciprocal(p[..., None, :] @ p[..., :, None]) * (w * v + v @ v)


def _quaternion_rates(p: Array) -> Array:
    upper = hat(p[..., :3]) + p[..., 3:, None] * _I
    return concatenate([upper, -p[..., None, :3]], axis=-2) * 0.5


@singledispatch
def rotation_from_angle(p: Array) -> Array:
    """The rotation about z, (..., 3, 3), of a cosine and a sine, (..., 2)."""
    unit = reciprocal(sqrt(p[..., None, :] @ p[..., :, None])) * p[..., :, None]
    c, s, zero = unit[..., :1, :], unit[..., 1:, :], 0 * unit[..., :1, :]
    rows = [[c, -s, zero], [s, c, zero], [zero, zero, zero + 1]]
    return concatenate([concatenate(row, axis=-1) for row in rows], axis=-2)


def _angle_rates(p: Array) -> Array:
    turned = concatenate([-p[..., 1:, None], p[..., :1, None]], axis=-2)
    return turned @ _I[2:]


_QUATERNION = ("qx", "qy", "qz", "qw")
BALL = Group("ball", (0, 1, 2), _QUATERNION, (), rotation_from_quaternion, _quaternion_rates)
PLANAR = Group("planar", (2, 3, 4), ("x", "y", "cos", "sin"), (0, 1), rotation_from_angle, _angle_rates)
FREE = Group(
    "free", (0, 1, 2, 3, 4, 5), ("x", "y", "z", *_QUATERNION), (0, 1, 2), rotation_from_quaternion, _quaternion_rates
)
GROUPS: Mapping[str, Group] = {group.name: group for group in (BALL, PLANAR, FREE)}


def find_group(X: Array) -> tuple[Group, Array] | None:
    """The group that screws X, (6, k), of a joint span, and the pose T of the frame in which they are its screws.

    ``X = Ad(T) group.X``. None where they span none of the three, in the order that it has.
    """
    for group in GROUPS.values():
        if len(group.axes) == X.shape[1]:
            T = _frame(group, X)
            R, off = np.asarray(rotation(T), dtype=float), np.abs(np.asarray(Ad(T) @ group.X - X, dtype=float))
            # how much a turning screw slides is a length, and of the size of the lever
            off[3:, group.X[:3].any(axis=0)] /= np.abs(position(T)).astype(float).max() or 1.0
            if max(np.abs(R.T @ R - _I).max(), off.max()) <= SPAN_ROUNDING and np.linalg.det(R) > 0:
                return group, T
    return None


def _frame(group: Group, X: Array) -> Array:
    """Where the axes of the joint are: their directions, and their origin nearest to the body's."""
    if group is PLANAR:
        R = np.stack([X[3:, 1], X[3:, 2], X[:3, 0]], axis=-1)
        return pose(R, np.cross(X[:3, 0], X[3:, 0])[:, None])
    R, moments = X[:3, :3], X[3:, :3]  # eta_k = c x xi_k
    return pose(R, np.cross(R.T, moments.T).sum(axis=0)[:, None] / 2)
