"""Positions of joints of several screws: where their numbers stand in q, and the poses and rates that these mean.

The velocities of a joint of one screw are the rates of its position; of balls, planar and free joints they are twists,
and q has more numbers than velocities. Positions stand in q in the order of the coordinates.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import Array, concatenate, is_zero
from jounce.model.mechanism import Mechanism
from jounce.spatial import groups
from jounce.spatial.groups import Group
from jounce.spatial.lie import inverse


@dataclass(frozen=True)
class Position:
    """The numbers of a joint of several screws in q."""

    name: str
    group: Group
    T: Array  # (4, 4) the frame of its screws in that of its body
    numbers: slice  # in q
    coordinates: slice  # its velocities among those of all coordinates

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its numbers in q."""
        return tuple(f"{self.name}.{what}" for what in self.group.positions)

    @property
    def velocities(self) -> tuple[str, ...]:
        """The names of its velocities."""
        return tuple(f"{self.name}.{what}" for what in self.group.velocities)

    @property
    def turn(self) -> slice:
        """The places in q of the numbers of its rotation."""
        return slice(self.numbers.start + len(self.group.places), self.numbers.stop)

    @property
    def extents(self) -> tuple[str, ...]:
        """The names of the extents, in the places of its velocities.

        Extents are what limits of the position bound.
        """
        return tuple(f"{self.name}.{what}" for what in self.group.extents)

    def motion(self, q: Array) -> Array:
        """Return the pose (..., 4, 4) of the body at q (..., nq, 1)."""
        return self.T @ self.group.pose(q[..., self.numbers, 0]) @ inverse(self.T)


@lru_cache(maxsize=64)
def multiscrew_joints(mechanism: Mechanism) -> dict[int, Position]:
    """Return the positions of multi-screw joints, by body.

    They are in the order of q.

    Raises `JounceError` if screws of a joint form none of the groups, or if its coordinates are not its own.
    """
    # The coordinates in their order: one number in q of a joint of one screw, all numbers of a joint of several at its
    # first coordinate. The body of a coordinate is that of the first joint variable that it moves.
    joints, start = dict[int, Position](), 0
    tree = mechanism.tree if mechanism.closure else mechanism
    for j, column in enumerate(tree.G.T):
        [i, *_] = [tree.owners[row] for row in np.flatnonzero(column)]
        if i in joints:
            continue
        if len(tree.columns[i]) > 1:
            group_and_pose = groups.find_group(np.asarray(tree.X[list(tree.columns[i])], dtype=float).T)
            if group_and_pose is None:
                raise JounceError(f"the joint of body {quote_value(tree.bodies[i])} is no ball, planar or free joint")
            group, T = group_and_pose
            # Its velocities are components of a twist, which no ratio may mix: its rows of G are unit rows, at
            # coordinates that move nothing else.
            rows, unit = list(tree.columns[i]), np.eye(tree.n, dtype=int)[j : j + len(group.axes)]
            follows_none = len(unit) == len(rows) and all(map(is_zero, [*np.ravel(tree.G[rows] - unit), *tree.g[rows]]))
            if not follows_none or np.count_nonzero(tree.G[:, j : j + len(rows)]) != len(rows):
                joint = f"the {group.name} joint of body {quote_value(tree.bodies[i])}"
                raise JounceError(f"{joint} follows others, or others follow it; expected coordinates of its own")
            exact = np.eye(4, dtype=int) if np.array_equal(T, np.eye(4)) else T
            numbers = slice(start, start + len(group.positions))
            name = tree.joints[tree.columns[i][0]].removesuffix(f".{group.velocities[0]}")
            joints[i] = Position(name, group, exact, numbers, slice(j, j + len(group.axes)))
            start = numbers.stop
        else:
            start += 1
    return joints


@lru_cache(maxsize=64)
def _count_numbers(mechanism: Mechanism) -> tuple[int, Array]:
    """Return the size of q and its single-screw positions.

    The latter is a matrix (n, numbers). The matrix has 1 where a number of q is the position of a coordinate.
    """
    joints = multiscrew_joints(mechanism).values()
    count = mechanism.n + sum(len(x.group.positions) - len(x.group.axes) for x in joints)
    # Coordinates and numbers of joints of one screw are in the same order.
    other_coordinates = {j for x in joints for j in range(x.coordinates.start, x.coordinates.stop)}
    other_numbers = {k for x in joints for k in range(x.numbers.start, x.numbers.stop)}
    single_positions = np.zeros((mechanism.n, count), dtype=int)
    places = (
        [j for j in range(mechanism.n) if j not in other_coordinates],
        [k for k in range(count) if k not in other_numbers],
    )
    single_positions[places] = 1
    return count, single_positions


def count(mechanism: Mechanism) -> int:
    """Return the size of q, without a floating base."""
    return _count_numbers(mechanism)[0]


def whole_count(mechanism: Mechanism) -> int:
    """Return the size of q with a floating base ahead."""
    return count(mechanism) + len(groups.FREE.positions) * mechanism.floats


@lru_cache(maxsize=64)
def names(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of q, without those of a floating base."""
    # From the last joint to the first, since a joint has more numbers than velocities: n entries become nq.
    names = list(mechanism.coordinates)
    for joint in reversed(list_multiscrew_joints(mechanism)):
        names[joint.coordinates] = joint.names
    return tuple(names)


def list_multiscrew_joints(mechanism: Mechanism) -> tuple[Position, ...]:
    """Return the joints of several screws, in the order of q."""
    return tuple(multiscrew_joints(mechanism).values())


def extent_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of what limits of the position bound.

    For joints of one screw these are the coordinates.
    """
    names = list(mechanism.coordinates)
    for joint in multiscrew_joints(mechanism).values():
        names[joint.coordinates] = joint.extents
    return tuple(names)


def extents(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """Return what limits of the position bound, (..., n), at q (..., nq) of floats.

    For joints of one screw this is q itself.
    """
    joints = multiscrew_joints(mechanism)
    if len(joints) == 0:
        return q
    bounded = single_joint_positions(mechanism, q)
    for joint in joints.values():
        bounded[..., joint.coordinates] = joint.group.extent(q[..., joint.numbers])
    return bounded


def loose_bodies(mechanism: Mechanism) -> set[int]:
    """Return the bodies that may leave their carriers.

    They are on planar and free joints.
    """
    return {body for body, joint in multiscrew_joints(mechanism).items() if joint.group.places}


def outer_bodies(mechanism: Mechanism) -> list[int]:
    """Return the bodies that carry none but loose ones."""
    loose = loose_bodies(mechanism)
    return sorted(set(range(mechanism.nb)) - {p for i, p in enumerate(mechanism.parent) if i not in loose})


def anchors(mechanism: Mechanism) -> np.ndarray:
    """Return a point (nc, 3) on the axis of each variable.

    It is in the frame of the body. It is the point nearest to the origin; variables of a joint of several screws share
    the origin of the joint.
    """
    points = np.cross(mechanism.X[:, :3], mechanism.X[:, 3:])
    for body, joint in multiscrew_joints(mechanism).items():
        points[list(mechanism.columns[body])] = joint.T[:3, 3]
    return points


def rest(mechanism: Mechanism) -> np.ndarray:
    """Return q (nq,) at which no joint moves its body: zeros, or the numbers of the unit matrix."""
    q = np.zeros(count(mechanism))
    for joint in multiscrew_joints(mechanism).values():
        q[joint.numbers] = joint.group.resting
    return q


def start(mechanism: Mechanism) -> np.ndarray:
    """Return q (nq,) of the tree at rest or closed."""
    return rest(mechanism) if mechanism.closure is None else mechanism.closure.start


def single_positions(mechanism: Mechanism) -> Array:
    """Return the integers (n, numbers) that pick single-screw positions.

    They put each position into the place of its velocity; rows of other joints are 0.
    """
    return _count_numbers(mechanism)[1]


def single_joint_positions(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """Return single-screw positions (..., n) of q (..., nq), else 0."""
    return q @ single_positions(mechanism).T if multiscrew_joints(mechanism) else q


def number_rates(mechanism: Mechanism, q: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return the rates (..., nq) of q at a velocity (..., n)."""
    return (rate_map(mechanism, q) @ velocity[..., None])[..., 0] if multiscrew_joints(mechanism) else velocity


def rate_map(mechanism: Mechanism, q: Array) -> Array:
    """Return the matrix (..., numbers, n) from velocities to rates."""
    # Rows of joints of one screw between those of joints of several; 0 q gives them the batch axes and the scalar type.
    rows, joints, k = [], list_multiscrew_joints(mechanism), 0
    unit, single = np.eye(mechanism.n, dtype=int), single_positions(mechanism).T
    for x in joints:
        rows += [
            single[k : x.numbers.start] + 0 * q[..., :1, None],
            x.group.moves(q[..., x.numbers]) @ unit[x.coordinates],
        ]
        k = x.numbers.stop
    return concatenate([*rows, single[k:] + 0 * q[..., :1, None]], axis=-2)


def check_single_screws(mechanism: Mechanism, what: str, uses: Array | None = None) -> None:
    """Raise `JounceError` if a joint has several screws.

    With an array `uses` (nc,), only joints count at whose variables it is not 0.
    """
    for body, joint in multiscrew_joints(mechanism).items():
        if uses is None or np.any(np.asarray(uses)[list(mechanism.columns[body])]):
            named = f"joint {quote_value(joint.name)} of {quote_value(mechanism.name)} is a {joint.group.name} joint"
            raise JounceError(f"{what}: {named}; expected joints of one screw, revolute, prismatic or helical")
