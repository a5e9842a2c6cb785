"""Equivalent mechanisms: passes from mechanism to mechanism leave the motion of the bodies as it is.

Passes to other frames and inertias leave the generalized forces as they are, too. `align_frames` puts every body frame
on its joint axis, z along it; `turn_frames` turns them about it, until x is normal to the next axis as in
Denavit-Hartenberg frames; `slide_origins` slides the origins along the axes until offsets vanish; `reduce_inertias`
reduces the bodies to their base inertial parameters. After all of them (`minimal_mechanism`) the recursion needs the
fewest operations. All but the last (`align_to_axes`) leave the Coriolis matrix as it is: C depends on the position of
inertia, not only on its effect. Body order, coordinates, names, gravity and the frame of a floating base stay.

`to_single_screws` is a pass to other coordinates, on which loops are closed: balls, planar and free joints, and the
base of a robot that floats, as chains of joints of one screw each. Each becomes the product of exponentials of these,
slides before turns: ``exp(v_x x) exp(v_y y) exp(v_z z) exp(w_z yaw) exp(w_y pitch) exp(w_x roll)``, with a body without
inertia behind each but the last. A base is such a joint of the ground. All other joints keep their coordinates.
Failure: none is noticed there. At a pitch of 90 degrees the axes of yaw and roll coincide, and constraints that are
solved for them are singular.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from jounce.core.errors import JounceError, quote_value, warn
from jounce.core.scalars import Array, concatenate, is_symbolic, is_zero
from jounce.model import positions
from jounce.model.drive_trains import AMOUNTS, UNDRIVEN, Drives
from jounce.model.frame import UNIT_ROUNDING, Frame
from jounce.model.limits import no_limits
from jounce.model.mechanism import Mechanism, reference_poses, single_variables, with_exact_integers
from jounce.spatial import groups, inertia
from jounce.spatial.lie import Ad, hat, inverse, pose, position, rotation

_I = np.eye(3, dtype=int)
_Z_AXIS = _I[:, 2:]
CHAIN = {"vx": "x", "vy": "y", "vz": "z", "wz": "yaw", "wy": "pitch", "wx": "roll"}  # coordinates by velocities
BASE_JOINT = "base"
BASE_COORDINATES = tuple(f"{BASE_JOINT}_{name}" for name in CHAIN.values())


def reframe(mechanism: Mechanism, T: Sequence[Array]) -> Mechanism:
    """Return the mechanism with its body frames at other poses.

    The frame of body i is at the pose T_i in its old frame.
    """
    # B_i' = T_p^-1 B_i T_i, X_i' = Ad(T_i)^-1 X_i, M_i' = Ad(T_i)^T M_i Ad(T_i); the ground keeps its frame.
    back = [inverse(t) for t in T]
    ads = [Ad(t) for t in T]
    B = [b @ t if p < 0 else back[p] @ b @ t for b, t, p in zip(mechanism.B, T, mechanism.parent, strict=True)]
    frames = (f if f.body < 0 else replace(f, T=back[f.body] @ f.T) for f in mechanism.frames)
    return replace(
        mechanism,
        B=np.stack(B),
        X=np.stack([Ad(back[i]) @ x for i, x in zip(mechanism.owners, mechanism.X, strict=True)]),
        M=np.stack([a.mT @ m @ a for a, m in zip(ads, mechanism.M, strict=True)]),
        frames=tuple(frames),
    )


@lru_cache(maxsize=64)
def frame_shifts(old: Mechanism, new: Mechanism) -> Array:
    """Return the poses of the body frames of `new` in `old`."""
    shifts = []
    for old_pose, new_pose in zip(reference_poses(old), reference_poses(new), strict=True):
        T = inverse(old_pose) @ new_pose
        # Positions are differences of those in the inertial frame, of which they have the rounding.
        most = max(_largest(position(old_pose)), _largest(position(new_pose)))
        shifts.append(pose(_round_units(rotation(T)), _round_lengths(position(T), most)))
    return np.stack(shifts)


def align_frames(mechanism: Mechanism) -> Mechanism:
    """Put every body frame on its joint axis, z along the axis.

    Then X_i is (0, 0, 1, 0, 0, h), or (0, 0, 0, 0, 0, 1) of a prismatic joint. The screws of joints of several are
    those of their group.
    """
    T, X = [np.eye(4, dtype=int)] * mechanism.nb, list(mechanism.X)
    for i, j in single_variables(mechanism).items():
        T[i], X[j] = _frame_on_axis(X[j])
    for i, joint in positions.multiscrew_joints(mechanism).items():
        T[i] = joint.T
        for j, screw in zip(mechanism.columns[i], joint.group.X.T, strict=True):
            X[j] = screw
    return replace(_round_rotations(reframe(mechanism, T)), X=np.stack(X))


def turn_frames(mechanism: Mechanism) -> Mechanism:
    """Turn aligned frames about their axes to simplify child axes.

    The axes of children have fewer components then.
    """
    # The joint axes of the children of each body, seen from its frame: z of their frames.
    axes: list[list[np.ndarray]] = [[] for _ in mechanism.parent]
    for B, p in zip(mechanism.B, mechanism.parent, strict=True):
        axis = _to_floats(B[:3, 2])
        if p >= 0 and axis is not None:
            axes[p].append(axis)
    T = [np.eye(4, dtype=int)] * mechanism.nb
    for i, j in single_variables(mechanism).items():
        if not is_zero(mechanism.X[j, 2]):
            T[i] = pose(_simplest_turn(axes[i]), 0 * _Z_AXIS)
    # Turns of integers are identities: no frame changes.
    return mechanism if all(t.dtype == int for t in T) else _round_rotations(reframe(mechanism, T))


def _simplest_turn(axes: Sequence[np.ndarray]) -> Array:
    """Return the turn about z that leaves vectors fewest components.

    It is the identity, of integers, where no turn is better.
    """

    def count_components(turn: Array) -> int:
        return sum(int(np.count_nonzero(_round_units(turn.T @ e))) for e in axes)

    # Each candidate turns one of the vectors into the y-z plane; one with x = 0 or y = 0 has nothing to gain.
    turns = []
    for x, y, _ in axes:
        r = np.hypot(x, y)
        if x != 0 and y != 0 and r != 0:
            turns.append(np.array([[y, x, 0], [-x, y, 0], [0, 0, r]]) / r)
    return min([_I, *turns], key=count_components)


def split_turn(B: Array, X: Array) -> tuple[Array, Array]:
    """Return S and Z of B = S Z, Z a turn about the axis.

    S has fewer entries other than 0, 1 and -1 than B has, or Z is the identity. A joint turns by Z and its angle at
    once, so that only S is left to carry vectors through.
    """
    # Only where the axis is z, and lies in a coordinate plane of the parent, can S have fewer such entries.
    R, e = rotation(B), _to_floats(B[:3, 2])
    if e is None or e.all() or is_zero(X[2]) or not all(map(is_zero, X[[0, 1, 3, 4]])):
        return B, np.eye(4, dtype=int)
    # x of S is the axis of the parent that is perpendicular to e; z is e.
    x = _I[:, np.flatnonzero(e == 0)[0]]
    S = np.stack([x, np.cross(e, x), e], axis=-1)
    if _count_odd_entries(S) >= _count_odd_entries(R):
        return B, np.eye(4, dtype=int)
    c, s = S[:, 0] @ R[:, 0], S[:, 1] @ R[:, 0]
    return pose(_round_units(S), position(B)), pose(
        _round_units(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])), 0 * _Z_AXIS
    )


def _count_odd_entries(R: Array) -> int:
    """Return the number of entries that are not -1, 0 or 1."""
    return sum(not is_zero(x * x * x - x) for x in np.ravel(R))


def slide_origins(mechanism: Mechanism) -> Mechanism:
    """Slide the origins of aligned frames until offsets vanish.

    They slide along the joint axes. The frame of a body on a prismatic joint may be anywhere: it goes to the origin of
    its parent.
    """
    T, B, variables = [np.eye(4, dtype=int)] * mechanism.nb, list(mechanism.B), single_variables(mechanism)
    for i, (old, p) in enumerate(zip(mechanism.B, mechanism.parent, strict=True)):
        # The offset of this origin from that of the parent, which has slid already, in the axes of the parent.
        offset = position(old) if p < 0 else position(old) - position(T[p])
        new_offset = offset
        if i in variables:
            is_prismatic = is_zero(mechanism.X[variables[i], 2])
            new_offset = 0 * offset if is_prismatic else _shorten_offset(offset, old[:3, 2:3])
            slide = rotation(old).mT @ (new_offset - offset)
            T[i] = pose(_I, slide if is_prismatic else _Z_AXIS * slide[2:])
        B[i] = pose(rotation(old), new_offset)
    # B is what `reframe` would compute, without the rounding of its products.
    return replace(reframe(mechanism, T), B=np.stack(B))


def _shorten_offset(offset: Array, axis: Array) -> Array:
    """Return an offset moved along an axis.

    It is shortest there, or has fewer components.
    """
    shortest = offset - axis * (axis.mT @ offset)
    e = _to_floats(axis)
    if e is None or not all(isinstance(x, int | float | np.number) for x in offset.flat):
        return shortest
    # Component k vanishes where the axis meets a coordinate plane, which is far away unless the axis is steep to it.
    steep_axes = np.flatnonzero(np.abs(e) >= 0.5)
    candidates = [shortest, *(offset - axis * (offset[k] / axis[k]) for k in steep_axes)]
    rounding = 4 * np.finfo(float).eps * np.abs(offset).max()
    return min((np.where(np.abs(x) <= rounding, 0, x) for x in candidates), key=np.count_nonzero)


def reduce_inertias(mechanism: Mechanism) -> Mechanism:
    """Reduce the inertia of aligned bodies to base inertial parameters.

    Parents get what is left. The force of a revolute joint does not depend on m, h_z and P_zz of its body alone, that
    of a helical joint on P_zz, that of a prismatic one on P, those of a ball on m. Inertia that reaches the ground is
    dropped: drive forces stay the same, bearing forces do not. A floating base keeps what reaches it: forces on it stay
    the same too.
    """
    # From the tips to the ground: a body passes on what it got from its children, too.
    M = list(mechanism.M)
    for i in reversed(range(mechanism.nb)):
        from_m, from_h, from_P = _untransmitted_moments(mechanism.X[list(mechanism.columns[i])])
        if from_m == 0 and not from_P.any():
            continue  # as a base that floats keeps all
        m, h, P = inertia.moments(M[i])
        M[i] = inertia.from_moments((1 - from_m) * m, (1 - from_h) * h, (1 - from_P) * P)
        # At any angle of the joint the parent sees these moments alike, so that B alone takes them there.
        p = mechanism.parent[i]
        passed_on = inertia.shift_inertia(inertia.from_moments(from_m * m, from_h * h, from_P * P), mechanism.B[i])
        if p >= 0:
            M[p] = M[p] + passed_on
    return replace(mechanism, M=np.stack(M))


def _untransmitted_moments(X: Array) -> tuple[int, Array, Array]:
    """Return masks of the moments m, h and P that joints drop.

    They are 1 where a joint does not transmit an entry of its body, else 0. The joint has screws X (k, 6), in its own
    axes.
    """
    turns, slides = (not all(map(is_zero, np.ravel(part))) for part in (X[:, :3], X[:, 3:]))
    from_m = int(turns and not slides)
    if len(X) != 1:
        return from_m, 0 * _Z_AXIS, 0 * _I
    # A turn about z does not see P_zz, nor h_z if it does not slide; a slide sees no second moment.
    from_P = _Z_AXIS @ _Z_AXIS.T if turns else np.ones((3, 3), dtype=int)
    return from_m, _Z_AXIS * from_m, from_P


@lru_cache(maxsize=64)
def align_to_axes(mechanism: Mechanism) -> Mechanism:
    """Return the same bodies in the frames with the most zeros: aligned, turned and slid."""
    return _restore_integers(slide_origins(turn_frames(align_frames(mechanism))))


@lru_cache(maxsize=64)
def minimal_mechanism(mechanism: Mechanism) -> Mechanism:
    """Return the equivalent mechanism with the fewest parameters.

    Its frames are aligned and slid, its inertias reduced to base inertial parameters.
    """
    return _restore_integers(reduce_inertias(align_to_axes(mechanism)))


def _restore_integers(mechanism: Mechanism) -> Mechanism:
    return with_exact_integers(mechanism) if is_symbolic(mechanism.B) else mechanism


def _frame_on_axis(X: Array) -> tuple[Array, Array]:
    """Return a frame on the axis of a screw, and its screw.

    The axis is z of the frame, which is a pose.
    """
    xi = _to_floats(X[:3])
    prismatic = xi is not None and not xi.any()
    e = _to_floats(X[3:]) if prismatic else xi
    if e is None:
        raise JounceError(f"joint direction {X.tolist()} is not made of numbers; use method='closed_form'")
    R = _round_units(turn_to(e))
    if prismatic:
        return pose(R, 0 * _Z_AXIS), np.array([0, 0, 0, 0, 0, 1])
    # X = (xi; r x xi + h xi): h = xi . eta is the pitch, r = xi x eta the point of the axis nearest to the origin.
    eta = X[3:, None]
    most = _largest(eta)
    pitch = _round_lengths(xi @ eta, most)
    return pose(R, _round_lengths(hat(R[:, 2]) @ eta, most)), concatenate([_I[2], 0 * _I[0, :2], pitch], axis=-1)


def turn_to(e: np.ndarray) -> np.ndarray:
    """Return the shortest rotation from z to the unit vector e."""
    # Near -z the shortest way is no longer well defined: turn to -e, then half a turn about x.
    if e[2] < -0.5:
        return turn_to(-e) @ np.diag([1, -1, -1])
    # R = I + v~ + v~^2 / (1 + z . e) with v = z x e
    v = hat(np.cross(_I[2], e))
    return _I + v + v @ v / (1 + e[2])


def _round_rotations(mechanism: Mechanism) -> Mechanism:
    return replace(mechanism, B=np.stack([pose(_round_units(rotation(B)), position(B)) for B in mechanism.B]))


def _to_floats(x: Array) -> np.ndarray | None:
    """Return x as floats, or None where it holds symbols."""
    # Symbols of CasADi become NaN, others raise errors of several types.
    try:
        numbers = np.array(x, dtype=float)
    except (TypeError, ValueError, RuntimeError):
        return None
    return numbers if np.isfinite(numbers).all() else None


def _round_units(a: Array) -> Array:
    """Set entries within rounding of -1, 0 or 1 to these integers.

    The array is one of integers where all entries are.
    """
    if is_symbolic(a):
        return np.asarray(np.frompyfunc(_round_unit, 1, 1)(a), dtype=object)
    nearest = np.rint(a)
    return _integers_if_all(np.where((np.abs(a - nearest) < UNIT_ROUNDING) & (np.abs(nearest) <= 1), nearest, a))


def _round_unit(x: object) -> object:
    return round(x) if isinstance(x, float) and abs(x) < 2 and abs(x - round(x)) < UNIT_ROUNDING else x


def _round_lengths(a: Array, most: float) -> Array:
    """Set lengths up to the rounding of `most` to 0.

    Lengths are sums of other lengths. No number of metres is small by itself.
    """
    if is_symbolic(a):
        small = np.frompyfunc(lambda x: isinstance(x, int | float) and abs(x) <= UNIT_ROUNDING * most, 1, 1)
        return np.where(small(a).astype(bool), 0, a)
    return _integers_if_all(np.where(np.abs(a) <= UNIT_ROUNDING * most, 0, a))


def _largest(lengths: Array) -> float:
    """Return the largest of the lengths that are numbers."""
    return max((abs(float(x)) for x in np.ravel(lengths) if isinstance(x, int | float | np.number)), default=0.0)


def _integers_if_all(a: Array) -> Array:
    """Return an array of integers if all entries are whole numbers."""
    return a.astype(int) if np.all(a == np.rint(a)) else a


# Coordinates on which loops are closed.
def to_single_screws(m: Mechanism, base: bool) -> Mechanism:
    """Return the tree on joints of one screw each.

    With `base`, a base that floats becomes a joint of the ground, and with it a chain of such joints.
    """
    m = _base_on_joint(m) if base and m.floats else m
    joints = positions.multiscrew_joints(m)
    if len(joints) == 0:
        return m
    m = _without_drives(m, [j for i in joints for j in m.columns[i]])

    # The order of joint variables and coordinates: slides before turns within each joint of several screws.
    rows, columns = np.arange(len(m.joints)), np.arange(m.n)
    for i, x in joints.items():
        order = np.argsort([[*CHAIN].index(velocity) for velocity in x.group.velocities])
        rows[list(m.columns[i])], columns[x.coordinates] = m.columns[i][0] + order, x.coordinates.start + order
    new_names = {f"{x.name}.{v}": f"{x.name}_{name}" for x in joints.values() for v, name in CHAIN.items()}
    joint_names = tuple(new_names.get(m.joints[j], m.joints[j]) for j in rows)
    coordinates = tuple(new_names.get(m.coordinates[j], m.coordinates[j]) for j in columns)
    repeated = [name for name in coordinates if coordinates.count(name) > 1]
    if len(repeated) > 0:
        raise JounceError(f"{m.name!r} has two coordinates {quote_value(repeated[0])}; rename the joint of this name")

    # A joint of k screws becomes a chain of k bodies. The old body is the last of its chain, with its inertia; the
    # first hangs on the old parent by the old pose B, all others on the body before by the identity.
    counts = np.array([max(1, len(variables)) for variables in m.columns])
    last = np.append(np.cumsum(counts) - 1, -1)  # by old bodies; the ground, -1, stays
    first = last[:-1] + 1 - counts
    B, M = np.tile(np.eye(4, dtype=m.B.dtype), (counts.sum(), 1, 1)), np.zeros((counts.sum(), 6, 6), dtype=m.M.dtype)
    B[first], M[last[:-1]] = m.B, m.M
    parent, owners = np.arange(len(B)) - 1, range(m.floats, len(B))
    parent[first] = last[list(m.parent)]
    bodies = dict(zip(owners, joint_names, strict=True)) | dict(zip(last, m.bodies, strict=False))

    def move_frame(frame: Frame) -> Frame:
        return replace(frame, body=int(last[frame.body]))

    return replace(
        m,
        B=B,
        X=m.X[rows],
        M=M,
        parent=tuple(parent.tolist()),
        owners=tuple(owners),
        G=m.G[rows][:, columns],
        g=m.g[rows],
        bodies=tuple(bodies[i] for i in range(len(B))),
        joints=joint_names,
        coordinates=coordinates,
        limits=m.limits.select(rows.tolist()),
        drives=Drives(**{key: x[rows] for key, x in vars(m.drives).items()}),
        frames=tuple(map(move_frame, m.frames)),
        loops=tuple(replace(loop, a=move_frame(loop.a), b=move_frame(loop.b)) for loop in m.loops),
    )


def _base_on_joint(m: Mechanism) -> Mechanism:
    """Return a floating robot as one on a free joint."""
    # The six velocities of the base become joint variables and coordinates of body 0, ahead of all others.
    k = len(groups.FREE.axes)
    names = tuple(f"{BASE_JOINT}.{velocity}" for velocity in groups.FREE.velocities)
    return replace(
        m,
        X=concatenate([groups.FREE.X.T, m.X], axis=0),
        owners=(0,) * k + m.owners,
        G=concatenate([np.eye(k, m.nv, dtype=int), np.pad(m.G, ((0, 0), (k, 0)))], axis=0),
        g=np.pad(m.g, (k, 0)),
        joints=names + m.joints,
        coordinates=names + m.coordinates,
        limits=replace(m.limits, table=concatenate([no_limits(k).table, m.limits.table], axis=-1)),
        drives=Drives(**{key: np.pad(x, (k, 0), constant_values=UNDRIVEN[key]) for key, x in vars(m.drives).items()}),
        floats=False,
    )


def _without_drives(m: Mechanism, joints: Sequence[int]) -> Mechanism:
    """Return the mechanism without limits and drive terms of some joint variables.

    Warns if there are any.
    """
    table, is_dropped = m.limits.table.copy(), np.isin(range(len(m.joints)), joints)
    table[..., is_dropped] = no_limits(len(joints)).table
    drives = Drives(**{key: np.where(is_dropped, UNDRIVEN[key], x) for key, x in vars(m.drives).items()})
    has_drives = any(getattr(m.drives, key)[is_dropped].any() for key in AMOUNTS.values())
    if (table != m.limits.table).any() or has_drives:
        warn(
            f"{m.name!r}: limits and drive terms of its balls, planar and free joints are left out, as turns about"
            " their axes are no coordinates where loops are closed"
        )
    return replace(m, limits=replace(m.limits, table=table), drives=drives)
