"""Sweeps run over the tree of joints, outward and inward.

Outward is from parent to body, inward from body to parent. `kinematic_tree` gives the joints of a mechanism at an
instant, behind that of a ground that moves: the ground that carries a fixed robot moves as a base does, but has neither
inertia nor velocities of its own. `build_tree` does so with joints of any kind, also those of RNEA
(`forces.aligned_tree`).

Outward go the twists of the bodies (`velocities`). Inward go quantities that add up over what a joint carries, as its
inertia (`composites`), and wrenches, in a column for each joint beyond (`collect`), which `project` and `join_rows`
make the triangle of a matrix. `evaluate_in_order` computes a series joint by joint, so that Python's recursion depth
does not grow with the tree.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from jounce.core.scalars import Array, concatenate, is_symbolic, zeros_like
from jounce.dynamics.recursion.joints import MovingJoint, joints
from jounce.dynamics.state import JointMotion, add_moving_ground
from jounce.model import coordinates
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series, join_series

J = TypeVar("J")  # MovingJoint, AnyJoint


@dataclass(frozen=True)
class KinematicTree(Generic[J]):
    """The joints at an instant, with the velocities that they follow.

    Each comes after its parent.
    """

    mechanism: Mechanism  # on the ground that moves, if it does
    joints: Sequence[J]
    G: Array  # velocities of all joints, six of a base, from those of the mechanism: (columns of screws, nv)
    own: range  # the places of the joints that are those of the mechanism

    @property
    def M(self) -> Array:
        """The inertias of the bodies, (len(joints), 6, 6)."""
        return self.mechanism.M

    def generalized_forces(self, Q: Series) -> Series:
        """Return G^T Q of forces or momenta of all joints.

        The shape is (..., nv, k).
        """
        return self.G.T @ Q

    def generalized_matrix(self, M: Series) -> Series:
        """Return G^T M G of a matrix of all joints.

        The shape is (..., nv, nv).
        """
        # Products of symbols with a unit matrix would only make expressions longer.
        identity = np.array_equal(self.G, np.eye(*self.G.shape, dtype=int))
        return M.map(lambda M: M if identity and is_symbolic(M) else self.G.T @ M @ self.G)


def kinematic_tree(m: Mechanism, q: Series, base: JointMotion | None = None) -> KinematicTree[MovingJoint]:
    """Return the tree of a mechanism at coordinates q, whose base moves.

    Without the motion of a base, that of a fixed robot is at rest.
    """
    return build_tree(m, q, base, joints)


def build_tree(
    m: Mechanism,
    q: Series,
    base: JointMotion | None,
    joints_of: Callable[[Mechanism, Series, JointMotion | None], Sequence[J]],
) -> KinematicTree[J]:
    """Return the tree with joints of the kind of `joints_of`."""
    if m.floats or base is None:
        return KinematicTree(m, joints_of(m, q, base), coordinates.velocity_map(m), range(m.nb))
    # The ground that moves is the first joint: its six velocities are given, and no coordinate moves it.
    G = concatenate([np.zeros((6, m.nv), dtype=int), m.G], axis=-2)
    moving = add_moving_ground(m)
    return KinematicTree(moving, joints_of(moving, q, base), G, range(1, moving.nb))


def velocities(tree: Sequence[MovingJoint]) -> list[Series]:
    """Return V_i, the twists of the bodies in their frames.

    They are (..., 6, 1).
    """
    V: list[Series] = []
    for joint in tree:
        joint_twist = joint.X @ joint.rate
        V.append(joint_twist if joint.parent < 0 else joint.twists(V[joint.parent]) + joint_twist)
    return V


def composites(
    tree: Sequence[MovingJoint], by_body: Sequence[Series], carry: Callable[[MovingJoint, Series], Series]
) -> list[Series]:
    """Return sums of a quantity over the bodies that joints carry.

    They are in the body frame of each joint. `carry` transports the quantity, such as inertia, from a body to its
    parent.
    """
    total = list(by_body)
    for i, joint in reversed(list(enumerate(tree))):
        if joint.parent >= 0:
            total[joint.parent] = total[joint.parent] + carry(joint, total[i])
    return total


@dataclass(frozen=True)
class ScrewColumns:
    """Wrenches or momenta in the body frame of one joint.

    There are columns for each joint that it carries.
    """

    screws: list[int]  # the numbers of the screws that the columns belong to
    values: Series  # (..., 6, len(screws))


def collect(tree: Sequence[MovingJoint], by_joint: Sequence[Series]) -> list[ScrewColumns]:
    """Transport the wrenches of each joint to joints that carry it."""
    owners = owners_of_screws(tree)
    # Per joint: the numbers of the screws collected so far, and their columns in its body frame, its own first.
    screws_on = [np.flatnonzero(owners == j).tolist() for j in range(len(tree))]
    parts_on = [[columns] for columns in by_joint]
    collected: list[ScrewColumns] = []
    # Inward: by then a joint has the columns of all that it carries. Matrices of columns are large: they are not kept.
    for i in reversed(range(len(tree))):
        collected.append(ScrewColumns(screws_on[i], join_series(parts_on[i], axis=-1).unkept))
        p = tree[i].parent
        if p >= 0:
            screws_on[p].extend(screws_on[i])
            parts_on[p].append(tree[i].wrenches(collected[-1].values).unkept)
    return collected[::-1]


def project(screws: Sequence[Series], columns: Sequence[ScrewColumns]) -> Series:
    """Project wrenches onto screws: all products S_i . W_j where joint i carries joint j.

    They are the upper triangle of a matrix, in blocks of joints.
    """
    return join_rows([(S.mT @ c.values).unkept for S, c in zip(screws, columns, strict=True)], columns)


def join_rows(rows: Sequence[Series], columns: Sequence[ScrewColumns]) -> Series:
    """Join rows of joints to an upper triangle.

    A row has an entry per column of the joint. The triangle is in blocks of joints.
    """
    size = 1 + max(max(c.screws) for c in columns)
    whole_rows = [spread_columns(row, c.screws, size) for row, c in zip(rows, columns, strict=True)]
    return join_series([row.unkept for row in whole_rows], axis=-2)


def spread_columns(columns: Series, numbers: Sequence[int], size: int) -> Series:
    """Spread numbered columns over all, with zeros elsewhere."""

    def spread(x: Array) -> Array:
        # The places of the others point at a column of zeros behind the last.
        place = np.full(size, len(numbers))
        place[numbers] = np.arange(len(numbers))
        return concatenate([x, zeros_like(x[..., :1])], axis=-1)[..., place]

    return columns.map(spread)


def mask_above(triangle: Series, tree: Sequence[MovingJoint]) -> Series:
    """Return the entries above the diagonal, in blocks of joints, zeros elsewhere."""
    owners = owners_of_screws(tree)
    mask = (owners[:, None] < owners).astype(np.int8)
    return triangle.map(lambda entries: entries * mask)


def owners_of_screws(tree: Sequence[MovingJoint]) -> np.ndarray:
    """Return the joint of each screw."""
    return np.repeat(np.arange(len(tree)), [joint.X.shape[-1] for joint in tree])


def evaluate_in_order(result: Series, steps: Iterable[Series]) -> Series:
    """Return a series that evaluates steps one after the other.

    It does so order by order. This bounds Python's recursion depth: each step finds the terms of the steps before it.
    """
    steps = tuple(steps)

    def term(k: int) -> Array:
        for step in steps:
            step[k]
        return result[k]

    return Series(term)
