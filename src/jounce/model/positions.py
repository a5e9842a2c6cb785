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
        """The names of its numbers."""
        return tuple(f"{self.name}.{what}" for what in self.group.positions)

    @property
    def velocities(self) -> tuple[str, ...]:
        """The names of its velocities."""
        return tuple(f"{self.name}.{what}" for what in self.group.velocities)

    @property
    def turn(self) -> slice:
        """Those of its numbers in q that say the rotation."""
        return slice(self.numbers.start + len(self.group.places), self.numbers.stop)

    @property
    def extents(self) -> tuple[str, ...]:
        """The names of what limits of the position bound, in the places of its velocities."""
        return tuple(f"{self.name}.{what}" for what in self.group.extents)

    def motion(self, q: Array) -> Array:
        """Where the joint moves its body, (..., 4, 4), at columns q (..., nq, 1)."""
        return self.T @ self.group.pose(q[..., self.numbers, 0]) @ inverse(self.T)


@lru_cache(maxsize=64)
def multiscrew_joints(mechanism: Mechanism) -> dict[int, Position]:
    """The numbers of the joints of several screws, by body, in the order of q."""
    found, start = dict[int, Position](), 0
    tree = mechanism.tree if mechanism.closure else mechanism
    for j, column in enumerate(tree.G.T):
        [i, *_] = [tree.owners[row] for row in np.flatnonzero(column)]
        if i in found:
            continue
        if len(tree.columns[i]) > 1:
            spanned = groups.find_group(np.asarray(tree.X[list(tree.columns[i])], dtype=float).T)
            if spanned is None:
                raise JounceError(f"the joint of body {quote_value(tree.bodies[i])} is no ball, planar or free joint")
            group, T = spanned
            rows, unit = list(tree.columns[i]), np.eye(tree.n, dtype=int)[j : j + len(group.axes)]
            own = len(unit) == len(rows) and all(map(is_zero, [*np.ravel(tree.G[rows] - unit), *tree.g[rows]]))
            if not own or np.count_nonzero(tree.G[:, j : j + len(rows)]) != len(rows):
                of = f"the {group.name} joint of body {quote_value(tree.bodies[i])}"
                raise JounceError(f"{of} follows others, or others follow it; expected coordinates of its own")
            exact = np.eye(4, dtype=int) if np.array_equal(T, np.eye(4)) else T
            numbers = slice(start, start + len(group.positions))
            name = tree.joints[tree.columns[i][0]].removesuffix(f".{group.velocities[0]}")
            found[i] = Position(name, group, exact, numbers, slice(j, j + len(group.axes)))
            start = numbers.stop
        else:
            start += 1
    return found


@lru_cache(maxsize=64)
def _count_numbers(mechanism: Mechanism) -> tuple[int, Array]:
    """How many numbers q has, and the matrix (n, numbers) that leaves those of joints of one screw."""
    joints = multiscrew_joints(mechanism).values()
    several = {j for x in joints for j in range(x.coordinates.start, x.coordinates.stop)}
    count = mechanism.n + sum(len(x.group.positions) - len(x.group.axes) for x in joints)
    taken = {k for x in joints for k in range(x.numbers.start, x.numbers.stop)}
    kept = np.zeros((mechanism.n, count), dtype=int)
    own = [j for j in range(mechanism.n) if j not in several], [k for k in range(count) if k not in taken]
    kept[own] = 1
    return count, kept


def count(mechanism: Mechanism) -> int:
    """How many numbers q has, without those of a base that floats."""
    return _count_numbers(mechanism)[0]


def whole_count(mechanism: Mechanism) -> int:
    """How many numbers q of a whole state has, with those of a base that floats ahead."""
    return count(mechanism) + len(groups.FREE.positions) * mechanism.floats


@lru_cache(maxsize=64)
def names(mechanism: Mechanism) -> tuple[str, ...]:
    """The names of the numbers of q, those of a base that floats left out."""
    names = list(mechanism.coordinates)
    for joint in reversed(list_multiscrew_joints(mechanism)):
        names[joint.coordinates] = joint.names
    return tuple(names)


def list_multiscrew_joints(mechanism: Mechanism) -> tuple[Position, ...]:
    """The joints of several screws, in the order of q."""
    return tuple(multiscrew_joints(mechanism).values())


def extent_names(mechanism: Mechanism) -> tuple[str, ...]:
    """The names of what limits of the position bound: of joints of one screw the coordinates."""
    names = list(mechanism.coordinates)
    for joint in multiscrew_joints(mechanism).values():
        names[joint.coordinates] = joint.extents
    return tuple(names)


def extents(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """What limits of the position bound, (..., n), at q of numbers, (..., nq): q itself of joints of one screw."""
    if not multiscrew_joints(mechanism):
        return q
    found = single_joint_positions(mechanism, q)
    for joint in multiscrew_joints(mechanism).values():
        found[..., joint.coordinates] = joint.group.extent(q[..., joint.numbers])
    return found


def loose_bodies(mechanism: Mechanism) -> set[int]:
    """The bodies that their joints let leave the bodies that carry them: on planar and free ones."""
    return {body for body, joint in multiscrew_joints(mechanism).items() if joint.group.places}


def outer_bodies(mechanism: Mechanism) -> list[int]:
    """The bodies that no other is linked to: they carry none, or only such as may leave them."""
    loose = loose_bodies(mechanism)
    return sorted(set(range(mechanism.nb)) - {p for i, p in enumerate(mechanism.parent) if i not in loose})


def anchors(mechanism: Mechanism) -> np.ndarray:
    """(nc, 3): of the axis of each joint variable the point nearest to the body's origin; several share their own."""
    points = np.cross(mechanism.X[:, :3], mechanism.X[:, 3:])
    for body, joint in multiscrew_joints(mechanism).items():
        points[list(mechanism.columns[body])] = joint.T[:3, 3]
    return points


def rest(mechanism: Mechanism) -> np.ndarray:
    """q of zeros, but for joints of several screws, which do not move their body: (nq,)."""
    q = np.zeros(count(mechanism))
    for joint in multiscrew_joints(mechanism).values():
        q[joint.numbers] = joint.group.resting
    return q


def start(mechanism: Mechanism) -> np.ndarray:
    """The numbers of all joints, (nq,) of the tree, at rest at zero, or where loops are closed at first."""
    return rest(mechanism) if mechanism.closure is None else mechanism.closure.start


def single_positions(mechanism: Mechanism) -> Array:
    """(n, numbers) integers: the positions of joints of one screw in the places of their velocities; others are 0."""
    return _count_numbers(mechanism)[1]


def single_joint_positions(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """q (..., n) of joints of one screw, 0 in the places of others, of positions (..., nq)."""
    return q @ single_positions(mechanism).T if multiscrew_joints(mechanism) else q


def number_rates(mechanism: Mechanism, q: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """The rates (..., nq) of positions q (..., nq) that move by a velocity (..., n)."""
    return (rate_map(mechanism, q) @ velocity[..., None])[..., 0] if multiscrew_joints(mechanism) else velocity


def rate_map(mechanism: Mechanism, q: Array) -> Array:
    """(..., numbers, n): the rates of the numbers q, (..., numbers), by the velocities of the coordinates."""
    rows, joints, k = [], list_multiscrew_joints(mechanism), 0
    unit, single = np.eye(mechanism.n, dtype=int), single_positions(mechanism).T
    for x in joints:
        rows += [
            single[k : x.numbers.start] + 0 * q[..., :1, None],
            x.group.moves(q[..., x.numbers]) @ unit[x.coordinates],
        ]
        k = x.numbers.stop
    return concatenate([*rows, single[k:] + 0 * q[..., :1, None]], axis=-2)


def check_single_screws(mechanism: Mechanism, what: str, of: Array | None = None) -> None:
    """Raise `JounceError` if a joint has several screws, or one of those whose variables an array (nc,) is not 0 of."""
    for body, joint in multiscrew_joints(mechanism).items():
        if of is None or np.any(np.asarray(of)[list(mechanism.columns[body])]):
            named = f"joint {quote_value(joint.name)} of {quote_value(mechanism.name)} is a {joint.group.name} joint"
            raise JounceError(f"{what}: {named}; expected joints of one screw, revolute, prismatic or helical")
