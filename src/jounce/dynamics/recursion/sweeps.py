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
    """For each joint the sum of what the bodies that it carries own, seen from its body."""
    total = list(own)
    for i in reversed(range(len(tree))):
        if (p := tree[i].parent) >= 0:
            total[p] = total[p] + carry(tree[i], total[i])
    return total


@dataclass(frozen=True)
class Columns:
    """Wrenches at the body of one joint, a column for each joint that it carries."""

    joints: list[int]
    W: Series  # (..., 6, len(joints))


def collect(tree: Sequence[Joint], own: Sequence[Series]) -> list[Columns]:
    """For each joint the wrenches (..., 6, 1) of the joints that it carries, seen from its body."""
    at = [([j], [W_j]) for j, W_j in enumerate(own)]
    columns: list[Columns] = []
    for i in reversed(range(len(tree))):
        members, parts = at[i]
        columns.append(Columns(members, joined(parts, axis=-1)))
        if (p := tree[i].parent) >= 0:
            at[p][0].extend(members)
            at[p][1].append(tree[i].wrenches(columns[-1].W))
    return columns[::-1]


def project(screws: Sequence[Series], columns: Sequence[Columns]) -> Series:
    """``S_i . W_j``, an upper triangle (..., nb, nb), of screws S_i (..., 6, 1) and the wrenches at their bodies."""
    unit = np.eye(len(columns), dtype=int)
    return joined([S.mT @ c.W @ unit[c.joints] for S, c in zip(screws, columns, strict=True)], axis=-2)


def evaluate_in_order(result: Series, steps: Iterable[Series]) -> Series:
    """The same series, the steps to it computed one after the other, so that no call nests deeper than one joint."""
    steps = tuple(steps)

    def term(k: int) -> Array:
        for step in steps:
            step[k]
        return result[k]

    return Series(term)
