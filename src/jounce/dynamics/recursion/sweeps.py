"""Sweeps over the tree, outward from parent to body and inward from body to parent."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from jounce._scalars import Array
from jounce.dynamics.recursion.joints import Joint
from jounce.spatial.series import Series, joined


def velocities(tree: Sequence[Joint]) -> list[Series]:
    """V_i, the twists of the bodies in their frames, (..., 6, 1)."""
    V: list[Series] = []
    for joint in tree:
        own = joint.X * joint.rate
        V.append(own if joint.parent < 0 else joint.twists(V[joint.parent]) + own)
    return V


def composites(tree: Sequence[Joint], own: Sequence[Series], carry: Callable[[Joint, Series], Series]) -> list[Series]:
    """Composite quantity of the subtree of each joint, such as its inertia, in the joint's body frame."""
    total = list(own)
    for i in reversed(range(len(tree))):
        if (p := tree[i].parent) >= 0:
            total[p] = total[p] + carry(tree[i], total[i])
    return total


@dataclass(frozen=True)
class Columns:
    """Wrenches or momenta in the body frame of one joint, one column for each joint that it carries."""

    joints: list[int]
    values: Series  # (..., 6, len(joints))


def collect(tree: Sequence[Joint], own: Sequence[Series]) -> list[Columns]:
    """Transport the wrench (..., 6, 1) of each joint inward: for each joint, those of the joints that it carries."""
    at = [([j], [own_j]) for j, own_j in enumerate(own)]
    columns: list[Columns] = []
    for i in reversed(range(len(tree))):
        members, parts = at[i]
        columns.append(Columns(members, joined(parts, axis=-1)))
        if (p := tree[i].parent) >= 0:
            at[p][0].extend(members)
            at[p][1].append(tree[i].wrenches(columns[-1].values))
    return columns[::-1]


def project(screws: Sequence[Series], columns: Sequence[Columns]) -> Series:
    """Project wrenches onto screws (..., 6, 1): the upper triangle (..., nb, nb) of products S_i . W_j."""
    unit = np.eye(len(columns), dtype=int)
    return joined([S.mT @ c.values @ unit[c.joints] for S, c in zip(screws, columns, strict=True)], axis=-2)


def above(triangle: Series) -> Series:
    """The entries above the diagonal."""
    return triangle.map(lambda entries: entries * np.tri(entries.shape[-1], k=-1, dtype=int).T)


def evaluate_in_order(result: Series, steps: Iterable[Series]) -> Series:
    """Evaluate the steps to a series one after the other, order by order: this bounds Python's recursion depth."""
    steps = tuple(steps)

    def term(k: int) -> Array:
        for step in steps:
            step[k]
        return result[k]

    return Series(term)
