"""Partial derivatives of the forces of a closed robot from those of its tree.

The coordinates of the tree are functions of the independent ones u, so that their rates depend on those of u by
``d theta^(k) / d u^(j) = binom(k, j) F^(k - j)``. Of forces F^T Q with K, D, M, the derivatives of Q on the tree,

    K_c = F^T ((K + H) F + D F' + M F''),    D_c = F^T (D F + 2 M F'),    M_c = F^T M F,

where F^T H F is the derivative of F^T with Q as it is. It follows from A F = 0: where cut joints exert y, A_d^T y =
Q_d, ``H_jk = -y . (dA[e_k])_j``. A branch of a loop adds to it what its screws S and the wrench W on its last body,
which sees them, make of Lie brackets,

    H_jk = (W . [S_j, S_k] if k is beyond j) - W . [P S_k, S_j],

with any constant projection P onto the twists that the cut joint allows. Relative twists V of the ends are among these:
there ``ad(V)`` turns one end as the other sees it, and W . [V, S] is the same of both, as W does not move what the
joint allows, nor do brackets leave it.
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
