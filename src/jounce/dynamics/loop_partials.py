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

from jounce.core.scalars import Array
from jounce.dynamics.loops import ClosedMotion, closure_of
from jounce.dynamics.system import system_wrench_rate
from jounce.model.coordinates import joint_variables
from jounce.model.loops import Loop
from jounce.model.mechanism import Mechanism, path_to
from jounce.spatial.lie import Ad, ad, exp, inverse
from jounce.spatial.series import Series, from_rate, join_series


def partials(motion: ClosedMotion, of_tree: tuple[Series, Series, Series], Q: Series) -> tuple[Series, Series, Series]:
    """K, D and M of a closed robot, (..., nv, nv) each, from those of its tree and the forces Q (..., nv, 1) there."""
    (K, D, M), F = of_tree, motion.F
    first, second = F.dot, F.dot.dot
    turned = F.mT @ (K @ F + D @ first + M @ second) + _tangent_partials(motion, Q)
    return turned, F.mT @ (D @ F + (M @ first) * 2), F.mT @ (M @ F)


def _tangent_partials(motion: ClosedMotion, Q: Series) -> Series:
    """H, (..., nv, nv)."""
    m, theta = motion.ends.m, joint_variables(motion.m.tree, motion.q)
    y = motion.multipliers(Q) if m.loops else Q
    by_joint = closure_of(m).G @ motion.F.map(lambda F: F[..., m.nv - m.n :, :])
    total, start = Series.constant(np.zeros((m.nv, m.nv), dtype=int)), 0
    for loop in m.loops:
        end, way = start + len(loop.rows), _loop_path(m, loop)
        S = join_series(_screws(m, theta, way), axis=-1)
        W = Ad(inverse(loop.a.T)).mT @ loop.rows.T @ y.map(_take_part(slice(start, end)))
        later = (S.mT @ W.map(system_wrench_rate) @ S) * np.tri(len(way), k=-1, dtype=int)
        moved = by_joint.map(_take_part([m.columns[i][0] for i, _ in way]))
        total, start = total + moved.mT @ later @ moved, end
    return total


def _loop_path(m: Mechanism, loop: Loop) -> list[tuple[int, int]]:
    """The joints on the way around a loop, from the first frame to the second, with -1 for inward, 1 for outward."""
    inward, outward = path_to(m, loop.a.body), path_to(m, loop.b.body)
    there = [(i, -1) for i in reversed(inward) if i not in outward]
    return there + [(i, 1) for i in outward if i not in inward]


def _screws(m: Mechanism, theta: Series, way: list[tuple[int, int]]) -> list[Series]:
    """The screws of joints on a way, as the body where it begins sees them, reversed where the way leads inward."""
    C, V, found = np.eye(4, dtype=int), Series.constant(np.zeros((6, 1), dtype=int)), list[Series]()
    for i, sign in way:
        j = m.columns[i][0]
        angle = theta.map(_take_part(slice(j, j + 1)))
        step = m.B[i] @ exp(m.X[j], angle[0])
        outer = C if sign < 0 else C @ step  # the pose of body i
        C = C @ inverse(step) if sign < 0 else outer
        found.append(from_rate(sign * Ad(outer) @ m.X[j, :, None], _turn_screw(V)))
        V = V + found[-1] @ angle.dot
    return found


def _turn_screw(V: Series) -> Callable[[Series], Series]:
    """The rate of a screw that moves with the twist V."""
    ads = V.map(lambda V: ad(V[..., 0]))
    return lambda S: ads @ S


def _take_part(rows: slice | list[int]) -> Callable[[Array], Array]:
    return lambda x: x[..., rows, :]
