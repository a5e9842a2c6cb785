"""Balls, planar and free joints, and the base of a robot that floats, as chains of joints of one screw each.

Loops are closed on positions that are coordinates. A joint of several screws becomes the product of exponentials of
these, slides before turns: ``exp(v_x x) exp(v_y y) exp(v_z z) exp(w_z yaw) exp(w_y pitch) exp(w_x roll)``, with a body
without inertia behind each but the last. A base is such a joint of the ground.

Invariant: bodies move as before; all other joints keep their coordinates.

Failure: none is noticed here. At a pitch of 90 degrees the axes of yaw and roll coincide, and constraints that are
solved for them are singular.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError, quote_value, warn
from jounce.core.scalars import concatenate
from jounce.model.drives import AMOUNTS, UNDRIVEN, Drives
from jounce.model.frame import Frame
from jounce.model.limits import no_limits
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints
from jounce.spatial.groups import FREE

CHAIN = {"vx": "x", "vy": "y", "vz": "z", "wz": "yaw", "wy": "pitch", "wx": "roll"}  # coordinates by velocities
BASE_JOINT = "base"
BASE_COORDINATES = tuple(f"{BASE_JOINT}_{name}" for name in CHAIN.values())


def to_single_screws(m: Mechanism, base: bool) -> Mechanism:
    """The tree on joints of one screw each; if asked, a base that floats becomes a joint of the ground."""
    m = _base_on_joint(m) if base and m.floats else m
    if not (joints := multiscrew_joints(m)):
        return m
    m = _without_drives(m, [j for i in joints for j in m.columns[i]])
    rows, columns = np.arange(len(m.joints)), np.arange(m.n)
    for i, x in joints.items():
        order = np.argsort([[*CHAIN].index(velocity) for velocity in x.group.velocities])
        rows[list(m.columns[i])], columns[x.coordinates] = m.columns[i][0] + order, x.coordinates.start + order
    new_names = {f"{x.name}.{v}": f"{x.name}_{name}" for x in joints.values() for v, name in CHAIN.items()}
    joint_names = tuple(new_names.get(m.joints[j], m.joints[j]) for j in rows)
    coordinates = tuple(new_names.get(m.coordinates[j], m.coordinates[j]) for j in columns)
    if taken := [name for name in coordinates if coordinates.count(name) > 1]:
        raise JounceError(f"{m.name!r} has two coordinates {quote_value(taken[0])}; rename the joint of this name")
    counts = np.array([max(1, len(own)) for own in m.columns])
    last = np.append(np.cumsum(counts) - 1, -1)  # where old bodies are; the ground, -1, stays
    first = last[:-1] + 1 - counts
    B, M = np.tile(np.eye(4, dtype=m.B.dtype), (counts.sum(), 1, 1)), np.zeros((counts.sum(), 6, 6), dtype=m.M.dtype)
    B[first], M[last[:-1]] = m.B, m.M
    parent, owners = np.arange(len(B)) - 1, range(m.floats, len(B))
    parent[first] = last[list(m.parent)]
    bodies = dict(zip(owners, joint_names, strict=True)) | dict(zip(last, m.bodies, strict=False))

    def moved(frame: Frame) -> Frame:
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
        frames=tuple(map(moved, m.frames)),
        loops=tuple(replace(loop, a=moved(loop.a), b=moved(loop.b)) for loop in m.loops),
    )


def _base_on_joint(m: Mechanism) -> Mechanism:
    """A robot that floats on a free joint of the ground."""
    k = len(FREE.axes)
    names = tuple(f"{BASE_JOINT}.{velocity}" for velocity in FREE.velocities)
    return replace(
        m,
        X=concatenate([FREE.X.T, m.X], axis=0),
        owners=(0,) * k + m.owners,
        G=concatenate([np.eye(k, m.nv, dtype=int), np.pad(m.G, ((0, 0), (k, 0)))], axis=0),
        g=np.pad(m.g, (k, 0)),
        joints=names + m.joints,
        coordinates=names + m.coordinates,
        limits=replace(m.limits, table=concatenate([no_limits(k).table, m.limits.table], axis=-1)),
        drives=Drives(**{x: np.pad(own, (k, 0), constant_values=UNDRIVEN[x]) for x, own in vars(m.drives).items()}),
        floats=False,
    )


def _without_drives(m: Mechanism, joints: Sequence[int]) -> Mechanism:
    """The mechanism without limits and drive terms of some joint variables; it warns if there are any."""
    table, own = m.limits.table.copy(), np.isin(range(len(m.joints)), joints)
    table[..., own] = no_limits(len(joints)).table
    drives = Drives(**{key: np.where(own, UNDRIVEN[key], x) for key, x in vars(m.drives).items()})
    if (table != m.limits.table).any() or any(getattr(m.drives, key)[own].any() for key in AMOUNTS.values()):
        warn(
            f"{m.name!r}: limits and drive terms of its balls, planar and free joints are left out, as turns about"
            " their axes are no coordinates where loops are closed"
        )
    return replace(m, limits=replace(m.limits, table=table), drives=drives)
