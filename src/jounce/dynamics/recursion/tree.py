"""Sweeps run over the tree of joints, outward from parent to body and inward from body to parent.

`kinematic_tree` gives the joints of a mechanism at an instant, behind that of a ground that moves: the ground that
carries a fixed robot moves as a base does, but has neither inertia nor velocities of its own. `build_tree` does so with
joints of any kind, also those of RNEA (`forces.aligned_tree`).

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
    """The joints at an instant, each after its parent, the inertia of their bodies, and the velocities they follow."""

    mechanism: Mechanism  # on the ground that moves, if it does
    joints: Sequence[J]
    G: Array  # velocities of all joints, six of a base, from those of the mechanism: (columns of screws, nv)
    own: range  # the places of the joints that are those of the mechanism

    @property
    def M(self) -> Array:
        """(len(joints), 6, 6)."""
        return self.mechanism.M

    def generalized_forces(self, Q: Series) -> Series:
        """G^T Q of forces or momenta of all joints: (..., nv, k)."""
        return self.G.T @ Q

    def generalized_matrix(self, M: Series) -> Series:
        """G^T M G of a matrix of all joints: (..., nv, nv)."""
        identity = np.array_equal(self.G, np.eye(*self.G.shape, dtype=int))
        return M.map(lambda M: M if identity and is_symbolic(M) else self.G.T @ M @ self.G)


def kinematic_tree(m: Mechanism, q: Series, base: JointMotion | None = None) -> KinematicTree[MovingJoint]:
    """The tree of a mechanism at coordinates q, whose base moves; no base: that of a fixed robot is at rest."""
    return build_tree(m, q, base, joints)


def build_tree(
    m: Mechanism,
    q: Series,
    base: JointMotion | None,
    joints_of: Callable[[Mechanism, Series, JointMotion | None], Sequence[J]],
) -> KinematicTree[J]:
    """The tree of a mechanism, with joints of the kind that `joints_of` makes."""
    if m.floats or base is None:
        return KinematicTree(m, joints_of(m, q, base), coordinates.velocity_map(m), range(m.nb))
    G = concatenate([np.zeros((6, m.nv), dtype=int), m.G], axis=-2)
    moving = add_moving_ground(m)
    return KinematicTree(moving, joints_of(moving, q, base), G, range(1, moving.nb))


def velocities(tree: Sequence[MovingJoint]) -> list[Series]:
    """V_i, the twists of the bodies in their frames, (..., 6, 1)."""
    V: list[Series] = []
    for joint in tree:
        own = joint.X @ joint.rate
        V.append(own if joint.parent < 0 else joint.twists(V[joint.parent]) + own)
    return V


def composites(
    tree: Sequence[MovingJoint], own: Sequence[Series], carry: Callable[[MovingJoint, Series], Series]
) -> list[Series]:
    """Composite quantity of the subtree of each joint, such as its inertia, in the joint's body frame."""
    total = list(own)
    for i, joint in reversed(list(enumerate(tree))):
        if joint.parent >= 0:
            total[joint.parent] = total[joint.parent] + carry(joint, total[i])
    return total


@dataclass(frozen=True)
class ScrewColumns:
    """Wrenches or momenta in the body frame of one joint, columns for each joint that it carries."""

    screws: list[int]  # the numbers of the screws that the columns belong to
    values: Series  # (..., 6, len(screws))


def collect(tree: Sequence[MovingJoint], own: Sequence[Series]) -> list[ScrewColumns]:
    """Transport the wrenches of each joint inward: for each joint, those of the joints that it carries."""
    owners = owners_of_screws(tree)
    at = [(np.flatnonzero(owners == j).tolist(), [own_j]) for j, own_j in enumerate(own)]
    columns: list[ScrewColumns] = []
    for i in reversed(range(len(tree))):
        screws, parts = at[i]
        columns.append(ScrewColumns(screws, join_series(parts, axis=-1).unkept))
        if (p := tree[i].parent) >= 0:
            at[p][0].extend(screws)
            at[p][1].append(tree[i].wrenches(columns[-1].values).unkept)
    return columns[::-1]


def project(screws: Sequence[Series], columns: Sequence[ScrewColumns]) -> Series:
    """Project wrenches onto screws: the upper triangle, in blocks of joints, of all products S_i . W_j."""
    return join_rows([(S.mT @ c.values).unkept for S, c in zip(screws, columns, strict=True)], columns)


def join_rows(rows: Sequence[Series], columns: Sequence[ScrewColumns]) -> Series:
    """Rows of joints, an entry for each column of the joint, as a matrix: the upper triangle, in blocks of joints."""
    size = 1 + max(max(c.screws) for c in columns)
    spread = [spread_columns(row, c.screws, size) for row, c in zip(rows, columns, strict=True)]
    return join_series([row.unkept for row in spread], axis=-2)


def spread_columns(columns: Series, numbers: Sequence[int], size: int) -> Series:
    """Numbered columns among all, zeros in the place of the others."""

    def placed(x: Array) -> Array:
        place = np.full(size, len(numbers))  # of the others, a column of zeros behind the last
        place[numbers] = np.arange(len(numbers))
        return concatenate([x, zeros_like(x[..., :1])], axis=-1)[..., place]

    return columns.map(placed)


def mask_above(triangle: Series, tree: Sequence[MovingJoint]) -> Series:
    """The entries above the diagonal, in blocks of joints."""
    owners = owners_of_screws(tree)
    kept = (owners[:, None] < owners).astype(np.int8)
    return triangle.map(lambda entries: entries * kept)


def owners_of_screws(tree: Sequence[MovingJoint]) -> np.ndarray:
    """The joint of each screw."""
    return np.repeat(np.arange(len(tree)), [joint.X.shape[-1] for joint in tree])


def evaluate_in_order(result: Series, steps: Iterable[Series]) -> Series:
    """Evaluate the steps to a series one after the other, order by order: this bounds Python's recursion depth."""
    steps = tuple(steps)

    def term(k: int) -> Array:
        for step in steps:
            step[k]
        return result[k]

    return Series(term)
