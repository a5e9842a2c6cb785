"""Partial derivatives of the forces of a closed robot from those of its tree.

The coordinates of the tree are functions of the independent ones u, so that their rates depend on those of u by
``d theta^(k) / d u^(j) = binom(k, j) F^(k - j)``. Of forces F^T Q with K, D, M, the derivatives of Q on the tree,

    K_c = F^T ((K + H) F + D F' + M F''),    D_c = F^T (D F + 2 M F'),    M_c = F^T M F,

where F^T H F is the derivative of F^T with Q as it is. It follows from A F = 0: where cut joints exert y, A_d^T y =
Q_d, it is ``-y . (dA) F``. What the last body of a branch sees, with the wrench W of the cut joint on it and the screws
S of the joints, gives the branch's part,

    H_ik = (W . [S_k, S_i] if joint k is beyond joint i) - W . [P S_k, S_i],

with any constant projection P onto the twists that the cut joint allows. The first term is of the screws, which turn
with the joints beyond them; the second of W, which turns with the relative twist V = P V. Brackets of allowed twists
are allowed, so that W . [V, X] is the same of the twists X of both ends: the branches separate.
"""

from collections import defaultdict
from functools import reduce
from operator import add

import numpy as np

from jounce.dynamics.drive_terms import pad_base
from jounce.dynamics.loop_branches import Branch, LoopEnds
from jounce.dynamics.loops import ClosedMotion
from jounce.dynamics.system import system_wrench_rate
from jounce.spatial.linear import mirror_triangle
from jounce.spatial.series import Series


def partials(motion: ClosedMotion, of_tree: tuple[Series, Series, Series], Q: Series) -> tuple[Series, Series, Series]:
    """K, D and M of a closed robot, (..., nv, nv) each, from those of its tree and the forces Q (..., nv, 1) there."""
    (K, D, M), F = of_tree, motion.F
    if motion.ends.m.loops:
        K = K + pad_base(motion.m, curvature(motion.ends, motion.multipliers(Q)), (-2, -1))
    by_position, by_velocity = K @ F + D @ F.dot + M @ F.dot.dot, D @ F + M @ F.dot * 2
    return F.mT @ by_position, F.mT @ by_velocity, (F.mT @ (M @ F)).map(mirror_triangle)


def curvature(ends: LoopEnds, y: Series) -> Series:
    """H, (..., N, N), where cut joints exert y, (..., c, 1)."""
    pulls = defaultdict[tuple[int, int], list[tuple[Branch, Series, Series]]](list)
    for branch, allowed, W in ends.end_wrenches(y):
        turning = W.map(system_wrench_rate)
        pulls[branch.key].append((branch, turning, turning @ allowed))
    total = Series.constant(np.zeros((ends.m.tree.n, ends.m.tree.n), dtype=int))
    for pull in pulls.values():
        [branch, *_], *wrenches = zip(*pull, strict=True)
        turning, turned = (reduce(add, parts) for parts in wrenches)
        S, columns = ends.screws(branch), branch.columns
        beyond = np.tri(len(columns), k=-1, dtype=int).T
        total = total + columns.T @ (S.mT @ turned @ S - (S.mT @ turning @ S) * beyond) @ columns
    return total
