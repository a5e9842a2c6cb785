"""Positions of joints of several screws: where their numbers stand in q, and the poses and rates that these mean.

The velocities of a joint of one screw are the rates of its position; of balls, planar and free joints they are twists,
and q has more numbers than velocities. Positions stand in q in the order of the coordinates.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from jounce.core.errors import JounceError, quoted
from jounce.core.scalars import Array, concatenate
from jounce.model.mechanism import Mechanism
from jounce.spatial.groups import Group, group_of
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

    def motion(self, q: Array) -> Array:
        """Where the joint moves its body, (..., 4, 4), at columns q (..., nq, 1)."""
        return self.T @ self.group.pose(q[..., self.numbers, 0]) @ inverse(self.T)


@lru_cache(maxsize=64)
def positions(mechanism: Mechanism) -> dict[int, Position]:
    """The numbers of the joints of several screws, by body."""
    found, start, tree = dict[int, Position](), 0, mechanism.tree
    for j, column in enumerate(tree.G.T):
        [i, *_] = [tree.owners[row] for row in np.flatnonzero(column)]
        if i in found:
            continue
        if len(tree.columns[i]) > 1:
            spanned = group_of(np.asarray(tree.X[list(tree.columns[i])], dtype=float).T)
            if spanned is None:
                raise JounceError(f"the joint of body {quoted(tree.bodies[i])} is no ball, planar or free joint")
            group, T = spanned
            exact = np.eye(4, dtype=int) if np.array_equal(T, np.eye(4)) else T
            numbers = slice(start, start + len(group.positions))
            name = tree.joints[tree.columns[i][0]].removesuffix(f".{group.velocities[0]}")
            found[i] = Position(name, group, exact, numbers, slice(j, j + len(group.axes)))
            start = numbers.stop
        else:
            start += 1
    return found


@lru_cache(maxsize=64)
def _numbers(mechanism: Mechanism) -> tuple[int, Array]:
    """How many numbers q has, and the matrix (n, numbers) that leaves those of joints of one screw."""
    joints = positions(mechanism).values()
    several = {j for x in joints for j in range(x.coordinates.start, x.coordinates.stop)}
    count = mechanism.n + sum(len(x.group.positions) - len(x.group.axes) for x in joints)
    taken = {k for x in joints for k in range(x.numbers.start, x.numbers.stop)}
    kept = np.zeros((mechanism.n, count), dtype=int)
    own = [j for j in range(mechanism.n) if j not in several], [k for k in range(count) if k not in taken]
    kept[own] = 1
    return count, kept


def position_count(mechanism: Mechanism) -> int:
    """How many numbers q has, without those of a base that floats."""
    return _numbers(mechanism)[0]


@lru_cache(maxsize=64)
def position_names(mechanism: Mechanism) -> tuple[str, ...]:
    """The names of the numbers of q, those of a base that floats left out."""
    names = list(mechanism.coordinates)
    for joint in sorted(positions(mechanism).values(), key=lambda x: -x.coordinates.start):
        names[joint.coordinates] = joint.names
    return tuple(names)


def single_positions(mechanism: Mechanism) -> Array:
    """(n, numbers) integers: the positions of joints of one screw in the places of their velocities; others are 0."""
    return _numbers(mechanism)[1]


def moves(mechanism: Mechanism, q: Array) -> Array:
    """(..., numbers, n): the rates of the numbers q, (..., numbers), by the velocities of the coordinates."""
    rows, joints, k = [], sorted(positions(mechanism).values(), key=lambda x: x.numbers.start), 0
    unit, single = np.eye(mechanism.n, dtype=int), single_positions(mechanism).T
    for x in joints:
        rows += [
            single[k : x.numbers.start] + 0 * q[..., :1, None],
            x.group.moves(q[..., x.numbers]) @ unit[x.coordinates],
        ]
        k = x.numbers.stop
    return concatenate([*rows, single[k:] + 0 * q[..., :1, None]], axis=-2)


def check_single(mechanism: Mechanism, what: str, of: Array | None = None) -> None:
    """Raise `JounceError` if a joint has several screws, or one of those whose variables an array (nc,) is not 0 of."""
    for body, joint in positions(mechanism).items():
        if of is None or np.any(np.asarray(of)[list(mechanism.columns[body])]):
            named = f"joint {quoted(joint.name)} of {quoted(mechanism.name)} is a {joint.group.name} joint"
            raise JounceError(f"{what}: {named}; expected joints of one screw, revolute, prismatic or helical")
