"""Coordinates that move no inertia: those in which the mass matrix is singular.

Problem: the rank of the mass matrix at almost all positions, and which coordinates take part in its null space.

Algorithm: at an arbitrary position, the pivots of the mass matrix by articulated bodies (Featherstone, Rigid Body
Dynamics Algorithms, 7.3); where one vanishes, or joints follow others, the eigenvalues of J^T M J scaled to a diagonal
of ones. Closed robots are looked at where their loops are known to close.

Invariant: entries are analytic functions of the coordinates, so that the rank at almost all positions is the largest
that is found at any. Pivots are compared with what the inertia could make of them, in no units.

Failure: where numbers overflow, the matrix counts as regular.
"""

from functools import lru_cache

import numpy as np

from jounce.dynamics import loops
from jounce.dynamics.recursion import bodies
from jounce.dynamics.recursion.joints import joints
from jounce.dynamics.state import BASE_AT_REST
from jounce.model.coordinates import joint_columns
from jounce.model.mechanism import Mechanism
from jounce.model.positions import position_count
from jounce.spatial.series import Series, column_series

MASS_RANK_TOLERANCE = 1e-12  # relative to what a pivot could be: rounding leaves less
MOBILITY_SAMPLES = 3  # configurations of a tree: if the mass matrix is regular in one, it is in almost all


@lru_cache(maxsize=64)
def idle_coordinates(m: Mechanism) -> tuple[int, tuple[str, ...]]:
    """The rank of the mass matrix, and which coordinates take part in motions without kinetic energy, everywhere.

    Among these a floating base is named once, whatever its motions are.
    """
    rank, idle = -1, np.zeros(0)
    for k in range(1 if m.closure else MOBILITY_SAMPLES):
        q = np.cos(1.0 + k + 1.7 * np.arange(position_count(m)))
        if _is_regular(m, q):
            return m.nv, ()
        trial = _find_idle(m, q)
        rank, idle = max((rank, idle), trial, key=lambda found: found[0])
        if rank == m.nv:
            return rank, ()
    own = idle[-m.n :]
    base = m.bodies[:1] if m.floats and idle[:6].any() else ()
    return rank, (*base, *(m.coordinates[j] for j in np.flatnonzero(own)))


@lru_cache(maxsize=64)
def may_be_singular(m: Mechanism) -> bool:
    """Whether the mass matrix can be singular at some positions: not where every body resists its own joint.

    Of the joints that move, those nearest to the base then take energy, whatever the others do.
    """
    tree = m.tree
    largest, rotors = np.abs(tree.M).max(axis=(1, 2)), _rotors(m)
    own = np.full(tree.nb, np.inf)
    for i, screws in ((i, [*screws]) for i, screws in enumerate(tree.columns) if screws):
        X = tree.X[screws]
        own[i] = np.linalg.eigvalsh(X @ tree.M[i] @ X.T + np.diag(rotors[screws]))[0]
    of_base = np.linalg.eigvalsh(tree.M[0])
    base_is_regular = not m.floats or of_base[0] > MASS_RANK_TOLERANCE * of_base[-1]
    return not (base_is_regular and (own > MASS_RANK_TOLERANCE * largest).all())


def is_singular(M: np.ndarray) -> np.ndarray:
    """Which of some mass matrices (..., nv, nv) are singular to rounding, (...)."""
    own = np.einsum("...jj->...j", M)
    scaled = _with_unit_diagonal(M, own, own.max(axis=-1, keepdims=True))
    known = np.asarray(np.isfinite(scaled).all(axis=(-2, -1)))
    least = np.linalg.eigvalsh(np.where(known[..., None, None], scaled, np.eye(M.shape[-1])))[..., 0]
    return np.asarray(known & (least <= MASS_RANK_TOLERANCE * M.shape[-1]))


def find_massless(m: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Which bodies (nb,) have no mass, yet carry some, and which have none and carry none: massless tips.

    Bodies that a closed loop joins carry the mass of each other. A floating base has no joint that could move nothing,
    and neither have the rotors of a robot whose drives are coupled.
    """
    empty = ~m.M.any(axis=(1, 2))
    empty[: int(m.floats)] = False
    loaded = ~empty
    if m.closure:
        empty[[m.owners[j] for j in m.closure.actuated if not m.loops]] = False
        loaded[[frame.body for loop in m.loops for frame in (loop.a, loop.b) if frame.body >= 0]] = True
    carries = loaded.copy()
    for i, p in reversed(list(enumerate(m.parent))):
        if p >= 0:
            carries[p] |= carries[i]
    return empty & carries, empty & ~carries


def find_idle_coordinates(m: Mechanism) -> np.ndarray:
    """Which coordinates (n,) of the tree move no inertia alone: massless tips, or points of mass on their axes.

    Of closed robots, those that move massless tips: what a loop moves is not seen from one coordinate.
    """
    tree = m.tree
    if m.closure:
        tips = find_massless(m)[1][list(tree.owners)]
        moved = tree.G != 0
        return np.asarray(moved[tips].any(axis=0) & ~moved[~tips].any(axis=0))
    idle = np.ones(m.n, dtype=bool)
    for k in range(MOBILITY_SAMPLES):
        q = np.cos(1.0 + k + 1.7 * np.arange(position_count(m)))
        J = bodies.jacobians(m, column_series([q]), BASE_AT_REST, None)[0].reshape(m.nb, 6, m.nv)
        own = np.einsum("iaj,iab,ibj->j", J, m.M, J)
        most = np.einsum("iaj,iaj,i->j", J, J, np.abs(m.M).max(axis=(1, 2)))
        idle &= (np.abs(own) <= MASS_RANK_TOLERANCE * most)[-m.n :]
    return idle


def _rotors(m: Mechanism) -> np.ndarray:
    """The armature that acts at each joint."""
    return m.drives.armature * ("armature" in m.acting)


def _with_unit_diagonal(M: np.ndarray, own: np.ndarray, largest: np.ndarray) -> np.ndarray:
    """Mass matrices scaled by their diagonals `own`; zeros where these are rounding of the largest that they could be.

    The scale makes entries of m and rad, of heavy and light bodies comparable.
    """
    moves = own > MASS_RANK_TOLERANCE * largest
    scale = np.sqrt(np.where(moves, own, 1.0))
    return np.where(moves[..., None, :] & moves[..., None], M / (scale[..., None, :] * scale[..., None]), 0.0)


def _is_regular(m: Mechanism, q: np.ndarray) -> bool:
    """Whether every joint moves inertia while all the others are free: the pivots of the mass matrix, in O(n).

    Where joints follow others, pivots of the joint variables decide nothing.
    """
    if not np.array_equal(m.G, np.eye(len(m.joints))):
        return False
    rotors = _rotors(m)
    articulated = list(m.M)  # of a body with all beyond it, whose joints are free
    for i, joint in reversed(list(enumerate(joints(m, Series.of([q[:, None]]))))):
        left, largest = articulated[i], np.abs(articulated[i]).max()
        own = rotors[list(m.columns[i])] if m.columns[i] else np.zeros(6)
        for X, rotor in zip(joint.X.T, own, strict=True):
            freed = _free_joint(left, X, rotor, largest)
            if freed is None:
                return False
            left = freed
        if joint.parent >= 0:
            articulated[joint.parent] = articulated[joint.parent] + joint.inertias(Series.of([left]))[0]
    return True


def _free_joint(inertia: np.ndarray, X: np.ndarray, rotor: float, largest: float) -> np.ndarray | None:
    """What is left of an inertia where its body moves freely along a screw; None if nothing resists there."""
    momentum = inertia @ X
    pivot = X @ momentum + rotor
    if not pivot > MASS_RANK_TOLERANCE * largest or not np.isfinite(pivot):
        return None
    return inertia - np.outer(momentum, momentum / pivot)


def _find_idle(m: Mechanism, q: np.ndarray) -> tuple[int, np.ndarray]:
    """The rank of the mass matrix at q, and which coordinates take part in motions without kinetic energy."""
    if closure := m.closure:  # where the loops are known to close, instead of at q
        tree, position = m.tree, closure.start[:, None]
        F = loops.ClosedMotion(m, column_series([closure.start[list(closure.independent)]]), position).F[0]
        q = closure.start
    else:
        tree, F = m, np.eye(m.nv)
    J = bodies.jacobians(tree, column_series([q]), BASE_AT_REST, None)[0] @ F
    M, nv = m.M, m.nv
    rotors = _rotors(m)
    G = tree.G @ joint_columns(tree) @ F
    momenta = (M @ J).reshape(-1, nv)
    gM = J.reshape(momenta.shape).T @ momenta + G.T * rotors @ G  # (MC)
    most = np.einsum("iaj,iaj,i->j", J, J, np.abs(M).max(axis=(1, 2))) + rotors @ G**2
    scaled = _with_unit_diagonal(gM, np.abs(np.diag(gM)), most)
    # regular, as most are, which costs a fraction of eigenvectors; overflown ones count as such
    if not np.isfinite(scaled).all() or (np.abs(np.linalg.eigvalsh(scaled)) > MASS_RANK_TOLERANCE * nv).all():
        return nv, np.zeros(nv, dtype=bool)
    values, vectors = np.linalg.eigh(scaled)
    null = np.abs(values) <= MASS_RANK_TOLERANCE * nv
    return int(nv - null.sum()), (np.abs(vectors[:, null]) > 1e-4).any(axis=1)
