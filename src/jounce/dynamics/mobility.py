"""Coordinates that move no inertia: those in which the mass matrix is singular.

Problem: the rank of the mass matrix at almost all positions, and which coordinates take part in its null space; at one
position, whether results of its inverse are rounding.

Algorithm: at an arbitrary position, the pivots of the mass matrix by articulated bodies (Featherstone, Rigid Body
Dynamics Algorithms, 7.3); where one vanishes, or joints follow others, and at a position of a caller, the eigenvalues
of the mass matrix scaled to a diagonal of ones. Closed robots are looked at where their loops are known to close.

Invariant: entries are analytic functions of the coordinates, so that the rank at almost all positions is the largest
that is found at any. What a joint moves is compared with what it alone could move, of what it carries: never kg with
kg m^2, nor a finger with the station that carries it. So nothing depends on units of length and mass.

How often what runs: ranks and bounds once per robot, `is_singular` once per call of a quantity with the inverse of M.

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
from jounce.model.transmissions import find_rotors
from jounce.spatial.lie import position
from jounce.spatial.series import Series, column_series

MASS_RANK_TOLERANCE = 1e-12  # of what a joint could move: rounding leaves less
IDLE_SHARE = 1e-4  # of a unit vector of the null space: smaller entries are left by eigenvalues that are not quite zero
MOBILITY_SAMPLES = 3  # configurations of a tree: if the mass matrix is regular in one, it is in almost all


@lru_cache(maxsize=64)
def idle_coordinates(m: Mechanism) -> tuple[int, tuple[str, ...]]:
    """Return the rank of the mass matrix, and the idle coordinates.

    These move no inertia: they take part in motions without kinetic energy at almost all positions. A floating base
    among them is named once, whatever its motions are.
    """
    rank, idle = -1, np.zeros(0)
    # The rank at almost all positions is the largest of any: the first regular sample ends the search. A closed robot
    # has one sample, as its loops are known to close at its start alone.
    for k in range(1 if m.closure else MOBILITY_SAMPLES):
        q = _sample_position(m, k)
        # Pivots take O(n), and nearly all robots end here.
        if _is_regular(m, q):
            return m.nv, ()
        # Otherwise eigenvalues decide; of equal ranks the first sample is kept.
        sample_rank, sample_idle = _find_idle(m, q)
        if sample_rank > rank:
            rank, idle = sample_rank, sample_idle
        if rank == m.nv:
            return rank, ()
    # (nv,) -> names: the six velocities of a base count as one.
    base = m.bodies[:1] if m.floats and idle[:6].any() else ()
    return rank, (*base, *(m.coordinates[j] for j in np.flatnonzero(idle[-m.n :])))


@lru_cache(maxsize=64)
def may_be_singular(m: Mechanism) -> bool:
    """Return whether the mass matrix can be singular at some positions.

    It cannot where every body resists its own joint: of the joints that move, those nearest to the base then take
    energy, whatever the others do.
    """
    tree = m.tree
    q = m.closure.start if m.closure else _sample_position(m, 0)
    bounds = _bound_joints(tree, q)
    armature = _velocity_armature(tree)
    for i in range(tree.nb):
        # X^T M_i X with armature, of the one body alone, relative to what its joint could move: a joint whose block
        # is singular by that measure may move no inertia, wherever the others are.
        rows, X = coordinates.velocity_rows(tree, i), coordinates.body_screws(tree, i)
        inertia = X.T @ tree.M[i] @ X + np.diag(armature[rows])
        scale = np.sqrt(bounds[rows])
        if not scale.all():
            return True
        if len(rows) > 0 and not np.linalg.eigvalsh(inertia / scale / scale[:, None])[0] > MASS_RANK_TOLERANCE:
            return True
    return False


def is_singular(m: Mechanism, q: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return which mass matrices are singular to rounding.

    The matrices are (..., nv, nv) at positions (..., N), the result is (...). Those of closed robots are compared with
    what they are at other positions.
    """
    bounds = _bound_closed(m) if m.closure else _bound_coordinates(_bound_joints(m, q), coordinates.velocity_map(m))
    scaled = _with_unit_diagonal(M, np.einsum("...jj->...j", M), bounds)
    # Matrices with missing or overflown numbers count as regular: the unit matrix takes their place.
    is_finite = np.asarray(np.isfinite(scaled).all(axis=(-2, -1)) & np.isfinite(bounds).all(axis=-1))
    least = np.linalg.eigvalsh(np.where(is_finite[..., None, None], scaled, np.eye(M.shape[-1])))[..., 0]
    return np.asarray(is_finite & (least <= MASS_RANK_TOLERANCE * M.shape[-1]))


def find_massless(m: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Return which bodies have no mass but carry some, and massless tips.

    Both are (nb,). Massless tips have no mass and carry none. Bodies that a closed loop joins carry the mass of each
    other. A floating base has no joint that could move nothing, and neither have rotors.
    """
    empty = ~m.M.any(axis=(1, 2))
    empty[: int(m.floats)] = False
    empty &= ~find_rotors(m)
    loaded = ~empty
    if m.closure:
        # A closure without loops is one of coupled drives: its actuated joints are those of rotors.
        empty[[m.owners[j] for j in m.closure.actuated if not m.loops]] = False
        loaded[[frame.body for loop in m.loops for frame in (loop.a, loop.b) if frame.body >= 0]] = True
    # Inward: a body carries mass if it or any body beyond it has some.
    carries = loaded.copy()
    for i, p in reversed(list(enumerate(m.parent))):
        if p >= 0:
            carries[p] |= carries[i]
    return empty & carries, empty & ~carries


def find_idle_coordinates(m: Mechanism) -> np.ndarray:
    """Return which coordinates (n,) of the tree move no inertia alone.

    They move massless tips, or points of mass on their axes. Of closed robots, only those that move massless tips
    count: what a loop moves is not seen from one coordinate.
    """
    tree = m.tree
    if m.closure:
        # Coordinates that move joints of tips, and no other joint.
        moves_tip = find_massless(m)[1][list(tree.owners)]
        moves = tree.G != 0
        return np.asarray(moves[moves_tip].any(axis=0) & ~moves[~moves_tip].any(axis=0))
    idle = np.ones(m.n, dtype=bool)
    for k in range(MOBILITY_SAMPLES):
        # The diagonal of M without armature, J^T M J, is zero at all samples for such a coordinate.
        q = _sample_position(m, k)
        J = bodies.jacobians(m, column_series([q]), BASE_AT_REST, None)[0].reshape(m.nb, 6, m.nv)
        diagonal = np.einsum("iaj,iab,ibj->j", J, m.M, J)
        bounds = _bound_coordinates(_bound_bodies(m.tree, q), coordinates.velocity_map(m))
        idle &= (np.abs(diagonal) <= MASS_RANK_TOLERANCE * bounds)[-m.n :]
    return idle


def _sample_position(m: Mechanism, k: int) -> np.ndarray:
    """Return an arbitrary position.

    Joints slide by no more than the size of the robot.
    """
    reach = np.where(np.array(coordinates.position_units(m)) == "m", robot_size(m), 1.0)
    return reach * np.cos(1.0 + k + 1.7 * np.arange(len(reach)))


def _velocity_armature(tree: Mechanism) -> np.ndarray:
    """Return the armature on each velocity, zeros for a base."""
    by_joint = tree.drives.armature * ("armature" in tree.acting)
    return np.concatenate([np.zeros(6 * tree.floats), by_joint])


# Bounds on what joints move.
def _bound_joints(tree: Mechanism, q: np.ndarray) -> np.ndarray:
    """Bound the inertia that joints of a tree move.

    Positions are (..., N), bounds are (..., velocities). The bounds are what joints could move if lengths and masses
    added up and nothing cancelled: of the diagonal of the mass matrix of the joints, and of the terms that it is a sum
    of.
    """
    return _bound_bodies(tree, q) + _velocity_armature(tree)


def _bound_bodies(tree: Mechanism, q: np.ndarray) -> np.ndarray:
    """Bound the inertia of the bodies that joints move, without armature."""
    fixed, slides = _lengths(tree)
    if not slides.any() and len(positions.multiscrew_joints(tree)) == 0:
        return _bound_turning_joints(tree)
    # Sliding joints take their bodies as far as they slide; joints of several screws, as far as they are now.
    theta = coordinates.joint_variables(tree, Series.of([q[..., None]]))[0][..., 0]
    distances = fixed + np.abs(theta) @ slides
    for i, joint in positions.multiscrew_joints(tree).items():
        distances[..., i] += np.linalg.norm(position(joint.motion(q[..., None]))[..., 0], axis=-1)
    return _add_up(tree, distances)


@lru_cache(maxsize=64)
def _bound_turning_joints(tree: Mechanism) -> np.ndarray:
    """Return the same bounds where no joint slides.

    Positions change no distance there.
    """
    return _add_up(tree, _lengths(tree)[0])


@lru_cache(maxsize=64)
def _lengths(tree: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest distances of bodies from their parents, (nb,), and slides.

    The shape is (nc, nb). Slides are what joint variables add to the distances per rad or m.
    """
    distances, slides = np.linalg.norm(tree.B[:, :3, 3].astype(float), axis=1), np.zeros((len(tree.X), tree.nb))
    for i, j in single_variables(tree).items():
        # X = (e; v): along e the joint slides by its pitch, the rest of v is r x e of an axis at the place r. A joint
        # that does not turn slides along v.
        e, v = np.split(tree.X[j].astype(float), 2)
        along = (e @ v) * e if e.any() else v
        slides[j, i] = np.linalg.norm(along)
        # Half a turn about an axis at the distance |r| moves the frame by 2 |r|.
        distances[i] += 2 * np.linalg.norm(v - along)
    return distances, slides


def _add_up(tree: Mechanism, distances: np.ndarray) -> np.ndarray:
    """Add up what joints could move, from distances to parents.

    The shapes are (..., velocities) and (..., nb).
    """
    M = np.abs(tree.M.astype(float))
    # Of each body with all that it carries, about its frame: second moments, first moments and mass.
    second, first, mass = [*M[:, :3, :3].sum(axis=-1).max(axis=-1)], [*M[:, :3, 3:].max(axis=(1, 2))], [*M[:, 3, 3]]
    bounds = np.empty((*distances.shape[:-1], len(coordinates.velocity_map(tree))))
    # Inward: by then each body has the sums of all that it carries.
    for i, p in reversed(list(enumerate(tree.parent))):
        for row, X in zip(
            coordinates.velocity_rows(tree, i), coordinates.body_screws(tree, i).T.astype(float), strict=True
        ):
            # X . M X with sizes in place of entries.
            turn, slide = np.linalg.norm(X[:3]), np.linalg.norm(X[3:])
            bounds[..., row] = second[i] * turn**2 + 2 * first[i] * turn * slide + mass[i] * slide**2
        if p >= 0:
            # Steiner's theorem, with the distance d of the frames and signs that never cancel.
            d = distances[..., i]
            second[p] = second[p] + second[i] + 2 * d * first[i] + d**2 * mass[i]
            first[p] = first[p] + first[i] + d * mass[i]
            mass[p] = mass[p] + mass[i]
    return bounds


def _bound_coordinates(bounds: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Bound the inertia that coordinates move, from bounds of joints.

    F is (..., velocities, nv). Of joints that move together the square roots add up: (sum of F_ij sqrt(bound_i))^2
    bounds their kinetic energy.
    """
    return np.asarray((np.sqrt(bounds)[..., None, :] @ np.abs(F.astype(float)))[..., 0, :] ** 2)


@lru_cache(maxsize=64)
def _bound_closed(m: Mechanism) -> np.ndarray:
    """Bound the inertia that coordinates of a closed robot move.

    The bounds, (nv,), are the largest at some closed positions.
    """
    q = loop_assembly.sample_positions(m, MOBILITY_SAMPLES) if m.loops else loops.closure_of(m).start[None]
    return np.asarray(_bound_coordinates(_bound_joints(m.tree, q), _joint_velocities(m, q)).max(axis=0))


def _joint_velocities(m: Mechanism, q: np.ndarray) -> np.ndarray:
    """Return the map to all joint velocities of a closed robot.

    It takes the robot's own velocities. The shape is (..., velocities, nv).
    """
    u = q[..., list(loops.closure_of(m).independent)]
    F = loops.ClosedMotion(m, column_series([u]), q[..., None]).F[0]
    return np.asarray(coordinates.velocity_map(m.tree) @ F)


def _with_unit_diagonal(M: np.ndarray, diagonal: np.ndarray, bounds: np.ndarray) -> np.ndarray:
    """Scale mass matrices to a diagonal of ones.

    The scale makes entries of m and rad, of heavy and light bodies comparable. Rows and columns whose diagonal is
    rounding of its bound become zeros.
    """
    moves = diagonal > MASS_RANK_TOLERANCE * bounds
    scale = np.sqrt(np.where(moves, diagonal, 1.0))
    return np.where(moves[..., None, :] & moves[..., None], M / (scale[..., None, :] * scale[..., None]), 0.0)


def _is_regular(m: Mechanism, q: np.ndarray) -> bool:
    """Return whether every joint moves inertia while all the others are free.

    These are the pivots of the mass matrix, in O(n). Where joints follow others, pivots of the joint variables decide
    nothing.
    """
    if not np.array_equal(m.G, np.eye(len(m.joints))):
        return False
    armature = _velocity_armature(m)
    # Per body: the articulated inertia I_i so far, and the size of the numbers whose rounding is in it. A pivot that is
    # small against these sizes may be rounding alone.
    articulated = list(m.M)
    rounded_sizes = [np.zeros((6, 6))] * m.nb
    for i, joint in reversed(list(enumerate(joints(m, Series.of([q[:, None]]))))):
        inertia, size = articulated[i], rounded_sizes[i]
        # A joint of several screws is taken screw by screw, as if each were a joint.
        for X, rotor in zip(joint.X.T, armature[coordinates.velocity_rows(m, i)], strict=True):
            terms = np.diag(np.abs(np.diag(inertia)))
            momentum = inertia @ X
            # D_i = S_i . I_i S_i + a_i, and the same of the sizes.
            pivot, bound = X @ momentum + rotor, X @ (size + terms) @ X + rotor
            if not pivot > MASS_RANK_TOLERANCE * bound or not np.isfinite(pivot):
                return False
            # Free the joint: I_i - U_i U_i^T / D_i. Errors of the inertia are left in the directions that it does not
            # move.
            projector = np.eye(6) - np.outer(X, momentum / pivot)
            inertia, size = inertia - np.outer(momentum, momentum / pivot), projector.T @ size @ projector + terms
        if joint.parent >= 0:
            p = joint.parent
            articulated[p] = articulated[p] + joint.inertias(Series.of([inertia]))[0]
            rounded_sizes[p] = rounded_sizes[p] + joint.inertias(Series.of([size]))[0]
    return True


def _find_idle(m: Mechanism, q: np.ndarray) -> tuple[int, np.ndarray]:
    """Return the rank of the mass matrix at q, and idle coordinates.

    Idle ones, (nv,) of bool, take part in motions without kinetic energy.
    """
    tree, nv, F = m.tree, m.nv, np.eye(m.nv)
    # Loops of a closed robot are known to close at its start, not at q.
    if m.closure:
        q = m.closure.start
        F = loops.ClosedMotion(m, column_series([q[list(m.closure.independent)]]), q[:, None]).F[0]
    # M of the independent velocities, without the sweeps of the mass matrix: J^T M J of all bodies, and armature.
    J = bodies.jacobians(tree, column_series([q]), BASE_AT_REST, None)[0] @ F
    momenta = (m.M @ J).reshape(-1, nv)
    velocities = coordinates.velocity_map(tree) @ F
    gM = J.reshape(momenta.shape).T @ momenta + velocities.T * _velocity_armature(tree) @ velocities  # (MC)
    bounds = _bound_coordinates(_bound_joints(tree, q), velocities)
    scaled = _with_unit_diagonal(gM, np.abs(np.diag(gM)), bounds)
    # Most matrices are regular, which eigenvalues show at a fraction of the cost of eigenvectors. Overflown ones count
    # as regular.
    if not np.isfinite(scaled).all() or (np.abs(np.linalg.eigvalsh(scaled)) > MASS_RANK_TOLERANCE * nv).all():
        return nv, np.zeros(nv, dtype=bool)
    # Idle coordinates have a share in an eigenvector of the null space.
    values, vectors = np.linalg.eigh(scaled)
    null = np.abs(values) <= MASS_RANK_TOLERANCE * nv
    return int(nv - null.sum()), (np.abs(vectors[:, null]) > IDLE_SHARE).any(axis=1)
