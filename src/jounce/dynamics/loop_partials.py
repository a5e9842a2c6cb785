"""Partial derivatives of the forces of a closed robot from those of its tree.

The coordinates of the tree are functions of the independent ones u, so that their rates depend on those of u by
``d theta^(k) / d u^(j) = binom(k, j) F^(k - j)``. Of forces F^T Q with K, D, M, the derivatives of Q on the tree,

    K_c = F^T (K F + D F' + M F'') + H,    D_c = F^T (D F + 2 M F'),    M_c = F^T M F,

where H is the derivative of F^T with Q as it is. It follows from A F = 0: where cut joints exert y, A_d^T y = Q_d,
``H_jk = -y . (dA[F_k]) F_j``. Joints on the way around a loop turn the screws of those behind them, so that the twists
``S_l F_lk`` of joints l contribute Lie brackets, with the wrench W = R^T y of the cut joint of a loop with rows R,

    H_jk = -W . sum over l before i of [S_l F_lk, S_i F_ij].
"""

from collections.abc import Callable

import numpy as np

from jounce._scalars import Array
from jounce.dynamics.loops import ClosedMotion, closure_of, rows_of, way
from jounce.dynamics.system import system_moved
from jounce.spatial.series import Series, joined


def partials(motion: ClosedMotion, of_tree: tuple[Series, Series, Series], Q: Series) -> tuple[Series, Series, Series]:
    """K, D and M of a closed robot, (..., nv, nv) each, from those of its tree and the forces Q (..., nv, 1) there."""
    (K, D, M), F = of_tree, motion.F
    first, second = F.dot, F.dot.dot
    turned = F.mT @ (K @ F + D @ first + M @ second) + _of_tangents(motion, Q)
    return turned, F.mT @ (D @ F + (M @ first) * 2), F.mT @ (M @ F)


def _of_tangents(motion: ClosedMotion, Q: Series) -> Series:
    """H, (..., nv, nv)."""
    m, y = motion.m, motion.multipliers(Q)
    theta = closure_of(m).G @ motion.F.map(lambda F: F[..., m.nv - m.n :, :])
    total, start = Series.constant(np.zeros((m.nv, m.nv), dtype=int)), 0
    for loop in m.loops:
        end = start + len(loop.rows)
        joints, signs = map(list, zip(*way(m, loop), strict=True))
        screws = motion.views[loop.a.body].screws
        S = joined([sign * screws[i] for i, sign in zip(joints, signs, strict=True)], axis=-1)
        W = rows_of(loop).T @ y.map(_part(slice(start, end)))
        later = (S.mT @ W.map(system_moved) @ S) * np.tri(len(joints), k=-1, dtype=int)
        moved = theta.map(_part(joints))
        total, start = total + moved.mT @ later @ moved, end
    return total


def _part(rows: slice | list[int]) -> Callable[[Array], Array]:
    return lambda x: x[..., rows, :]
