"""Coordinates that move no inertia: those in which the mass matrix is singular.

Problem: the rank of the mass matrix at almost all positions, and which coordinates take part in its null space; at one
position, whether results of its inverse are rounding.

Algorithm: at an arbitrary position, the pivots of the mass matrix by articulated bodies (Featherstone, Rigid Body
Dynamics Algorithms, 7.3); where one vanishes, or joints follow others, and at a position of a caller, the eigenvalues
of the mass matrix scaled to a diagonal of ones. Closed robots are looked at where their loops are known to close.

Invariant: entries are analytic functions of the coordinates, so that the rank at almost all positions is the largest
that is found at any. What a joint moves is compared with what it alone could move, of what it carries: never kg with
kg m^2, nor a finger with the station that carries it. So nothing depends on units of length and mass.

Failure: where numbers overflow, the matrix counts as regular.
"""

from functools import lru_cache

import numpy as np

from jounce.dynamics import loop_assembly, loops
from jounce.dynamics.recursion import bodies
from jounce.dynamics.recursion.joints import joints
from jounce.dynamics.state import BASE_AT_REST
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism, robot_size, single_variables
from jounce.spatial.lie import position
from jounce.spatial.series import Series, column_series

MASS_RANK_TOLERANCE = 1e-12  # of what a joint could move: rounding leaves less
MOBILITY_SAMPLES = 3  # configurations of a tree: if the mass matrix is regular in one, it is in almost all


@lru_cache(maxsize=64)
def idle_coordinates(m: Mechanism) -> tuple[int, tuple[str, ...]]:
    """The rank of the mass matrix, and which coordinates take part in motions without kinetic energy, everywhere.

    Among these a floating base is named once, whatever its motions are.
    """
    rank, idle = -1, np.zeros(0)
    for k in range(1 if m.closure else MOBILITY_SAMPLES):
        q = _sample_position(m, k)
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
    q = m.closure.start if m.closure else _sample_position(m, 0)
    most = _most_of_joints(tree, q)
    armature = _velocity_armature(tree)
    for i in range(tree.nb):
        own, X = coordinates.velocity_rows(tree, i), coordinates.body_screws(tree, i)
        inertia = X.T @ tree.M[i] @ X + np.diag(armature[own])
        scale = np.sqrt(most[own])
        if not scale.all():
            return True
        if own and not np.linalg.eigvalsh(inertia / scale / scale[:, None])[0] > MASS_RANK_TOLERANCE:
            return True
    return False


def is_singular(m: Mechanism, q: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Which of the mass matrices (..., nv, nv) of a robot at positions (..., N) are singular to rounding, (...).

    Those of closed robots are compared with what they are at other positions.
    """
    most = _most_of_closed(m) if m.closure else _most_of_coordinates(_most_of_joints(m, q), coordinates.velocity_map(m))
    scaled = _with_unit_diagonal(M, np.einsum("...jj->...j", M), most)
    known = np.asarray(np.isfinite(scaled).all(axis=(-2, -1)) & np.isfinite(most).all(axis=-1))
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
        q = _sample_position(m, k)
        J = bodies.jacobians(m, column_series([q]), BASE_AT_REST, None)[0].reshape(m.nb, 6, m.nv)
        own = np.einsum("iaj,iab,ibj->j", J, m.M, J)
        most = _most_of_coordinates(_most_of_bodies(m.tree, q), coordinates.velocity_map(m))
        idle &= (np.abs(own) <= MASS_RANK_TOLERANCE * most)[-m.n :]
    return idle


def _sample_position(m: Mechanism, k: int) -> np.ndarray:
    """An arbitrary position; joints slide by no more than the size of the robot."""
    reach = np.where(np.array(coordinates.position_units(m)) == "m", robot_size(m), 1.0)
    return reach * np.cos(1.0 + k + 1.7 * np.arange(len(reach)))


def _velocity_armature(tree: Mechanism) -> np.ndarray:
    """The armature that acts on each velocity of the joints of a tree, those of a floating base first."""
    own = tree.drives.armature * ("armature" in tree.acting)
    return np.concatenate([np.zeros(6 * tree.floats), own])


def _most_of_joints(tree: Mechanism, q: np.ndarray) -> np.ndarray:
    """What the joints of a tree could move if lengths and masses added up and nothing cancelled, (..., velocities).

    It bounds the diagonal of the mass matrix of its joints at positions (..., N), and the terms that it is a sum of.
    """
    return _most_of_bodies(tree, q) + _velocity_armature(tree)


def _most_of_bodies(tree: Mechanism, q: np.ndarray) -> np.ndarray:
    """The same without armature: what they could move of the bodies."""
    fixed, slides = _lengths(tree)
    if not slides.any() and not positions.multiscrew_joints(tree):
        return _most_of_turning_joints(tree)
    theta = coordinates.joint_variables(tree, Series.of([q[..., None]]))[0][..., 0]
    far = fixed + np.abs(theta) @ slides
    for i, joint in positions.multiscrew_joints(tree).items():
        far[..., i] += np.linalg.norm(position(joint.motion(q[..., None]))[..., 0], axis=-1)
    return _add_up(tree, far)


@lru_cache(maxsize=64)
def _most_of_turning_joints(tree: Mechanism) -> np.ndarray:
    """The same where no joint slides, so that positions change no distance."""
    return _add_up(tree, _lengths(tree)[0])


@lru_cache(maxsize=64)
def _lengths(tree: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """How far bodies may be from their parents, (nb,), and what joint variables add to it per rad or m, (nc, nb)."""
    far, slides = np.linalg.norm(tree.B[:, :3, 3].astype(float), axis=1), np.zeros((len(tree.X), tree.nb))
    for i, j in single_variables(tree).items():
        e, v = np.split(tree.X[j].astype(float), 2)
        along = (e @ v) * e if e.any() else v
        slides[j, i] = np.linalg.norm(along)
        far[i] += 2 * np.linalg.norm(v - along)  # half a turn about an axis away from the frame
    return far, slides


def _add_up(tree: Mechanism, far: np.ndarray) -> np.ndarray:
    """What the joints could move, (..., velocities), where bodies are as far from their parents, (..., nb)."""
    M = np.abs(tree.M.astype(float))
    # of each body with all that it carries, about its frame: second moments, first moments and mass
    second, first, mass = [*M[:, :3, :3].sum(axis=-1).max(axis=-1)], [*M[:, :3, 3:].max(axis=(1, 2))], [*M[:, 3, 3]]
    most = np.empty((*far.shape[:-1], len(coordinates.velocity_map(tree))))
    for i, p in reversed(list(enumerate(tree.parent))):
        for row, X in zip(
            coordinates.velocity_rows(tree, i), coordinates.body_screws(tree, i).T.astype(float), strict=True
        ):
            turn, slide = np.linalg.norm(X[:3]), np.linalg.norm(X[3:])
            most[..., row] = second[i] * turn**2 + 2 * first[i] * turn * slide + mass[i] * slide**2
        if p >= 0:
            d = far[..., i]
            second[p] = second[p] + second[i] + 2 * d * first[i] + d**2 * mass[i]
            first[p] = first[p] + first[i] + d * mass[i]
            mass[p] = mass[p] + mass[i]
    return most


def _most_of_coordinates(most: np.ndarray, F: np.ndarray) -> np.ndarray:
    """What coordinates could move that give joints the velocities F, (..., velocities, nv), if nothing cancelled."""
    return np.asarray((np.sqrt(most)[..., None, :] @ np.abs(F.astype(float)))[..., 0, :] ** 2)


@lru_cache(maxsize=64)
def _most_of_closed(m: Mechanism) -> np.ndarray:
    """What the coordinates of a closed robot could move, (nv,): the largest at some positions with loops closed."""
    q = loop_assembly.sample_positions(m, MOBILITY_SAMPLES) if m.loops else loops.closure_of(m).start[None]
    return np.asarray(_most_of_coordinates(_most_of_joints(m.tree, q), _joint_velocities(m, q)).max(axis=0))


def _joint_velocities(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """The velocities of all joints of a closed robot from its own, (..., velocities, nv), at positions of its tree."""
    own = q[..., list(loops.closure_of(m).independent)]
    F = loops.ClosedMotion(m, column_series([own]), q[..., None]).F[0]
    return np.asarray(coordinates.velocity_map(m.tree) @ F)


def _with_unit_diagonal(M: np.ndarray, own: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Mass matrices scaled by their diagonals `own`; zeros where these are rounding of the `most` that they could be.

    The scale makes entries of m and rad, of heavy and light bodies comparable.
    """
    moves = own > MASS_RANK_TOLERANCE * most
    scale = np.sqrt(np.where(moves, own, 1.0))
    return np.where(moves[..., None, :] & moves[..., None], M / (scale[..., None, :] * scale[..., None]), 0.0)


def _is_regular(m: Mechanism, q: np.ndarray) -> bool:
    """Whether every joint moves inertia while all the others are free: the pivots of the mass matrix, in O(n).

    Where joints follow others, pivots of the joint variables decide nothing.
    """
    if not np.array_equal(m.G, np.eye(len(m.joints))):
        return False
    armature = _velocity_armature(m)
    articulated = list(m.M)  # of a body with all beyond it, whose joints are free
    rounded = [np.zeros((6, 6))] * m.nb  # the inertia that sums behind a body have been rounded as
    for i, joint in reversed(list(enumerate(joints(m, Series.of([q[:, None]]))))):
        inertia, size = articulated[i], rounded[i]
        for X, rotor in zip(joint.X.T, armature[coordinates.velocity_rows(m, i)], strict=True):
            terms = np.diag(np.abs(np.diag(inertia)))
            momentum = inertia @ X
            pivot, most = X @ momentum + rotor, X @ (size + terms) @ X + rotor
            if not pivot > MASS_RANK_TOLERANCE * most or not np.isfinite(pivot):
                return False
            # free the joint: errors of the inertia are left in the directions that it does not move
            kept = np.eye(6) - np.outer(X, momentum / pivot)
            inertia, size = inertia - np.outer(momentum, momentum / pivot), kept.T @ size @ kept + terms
        if joint.parent >= 0:
            carried = (joint.inertias(Series.of([x]))[0] for x in (inertia, size))
            into = (articulated, rounded)
            for sums, x in zip(into, carried, strict=True):
                sums[joint.parent] = sums[joint.parent] + x
    return True


def _find_idle(m: Mechanism, q: np.ndarray) -> tuple[int, np.ndarray]:
    """The rank of the mass matrix at q, and which coordinates take part in motions without kinetic energy."""
    tree, nv, F = m.tree, m.nv, np.eye(m.nv)
    if m.closure:  # where the loops are known to close, instead of at q
        q = m.closure.start
        F = loops.ClosedMotion(m, column_series([q[list(m.closure.independent)]]), q[:, None]).F[0]
    J = bodies.jacobians(tree, column_series([q]), BASE_AT_REST, None)[0] @ F
    momenta = (m.M @ J).reshape(-1, nv)
    velocities = coordinates.velocity_map(tree) @ F
    gM = J.reshape(momenta.shape).T @ momenta + velocities.T * _velocity_armature(tree) @ velocities  # (MC)
    most = _most_of_coordinates(_most_of_joints(tree, q), velocities)
    scaled = _with_unit_diagonal(gM, np.abs(np.diag(gM)), most)
    # regular, as most are, which costs a fraction of eigenvectors; overflown ones count as such
    if not np.isfinite(scaled).all() or (np.abs(np.linalg.eigvalsh(scaled)) > MASS_RANK_TOLERANCE * nv).all():
        return nv, np.zeros(nv, dtype=bool)
    values, vectors = np.linalg.eigh(scaled)
    null = np.abs(values) <= MASS_RANK_TOLERANCE * nv
    return int(nv - null.sum()), (np.abs(vectors[:, null]) > 1e-4).any(axis=1)
