"""Sweeps over the tree, outward from parent to body and inward from body to parent."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from jounce.core.scalars import Array, concatenate, zeros_like
from jounce.dynamics.recursion.joints import MovingJoint
from jounce.spatial.series import Series, join_series


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
