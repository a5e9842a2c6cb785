"""Reads MuJoCo's models, mjModel, as links and joints.

Of their arrays it takes what dynamics needs.

`mechanism` is the door. Its steps, in this order:

1. `read_arrays`: the arrays, whatever version of MuJoCo made them, are there and finite, and every part has a name.
2. `find_followers`, `find_ties`: equality constraints are soft in MuJoCo, and hold exactly here. Those that tie one
   joint to another make it follow, ``q1 - q1_0 = p(q2 - q2_0)`` with a polynomial p and `qpos0` for q1_0 and q2_0.
   Those that connect or weld two bodies are loops, cut at a ball or at a weld.
3. `_build_bodies`: bodies are links, with joints between them. The joints of a body act one after another: the last
   moves the body, those before it move massless links, BODY:JOINT by name. Bodies without a joint are welded, and so
   are named sites, as massless links, unless a body has their name, and the ends of constraints.
4. `warn_of_ignored`: one warning names what is not part of a tree of rigid bodies and its drives.
5. `prepare_tendons`: fixed tendons are rotors that follow the joints, or motors of a joint.
6. `follow_polynomials`: joints whose polynomial is not linear become dependent coordinates.
   `close_ties`: the joints with motors move the closed robot, which starts at `qpos0`.
7. `drive_by_tendons`: motors on tendons that move several joints drive them together.

Joint variables are MuJoCo's own, which are `qpos0` where the bodies stand as the file places them; angles in rad. The
numbers q of a free joint are the pose of its body in the world, those of a ball the turn from where the file has the
body: MuJoCo's own too, but for the order x, y, z, w of quaternions.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, locate_errors, warn
from jounce.io.models import mujoco_actuators, mujoco_arrays, mujoco_ties
from jounce.io.models.mujoco_arrays import (
    ModelArrays,
    make_distinct,
    moves_along_one_screw,
    read_arrays,
)
from jounce.model import tree
from jounce.model.limits import StatedLimit
from jounce.model.mechanism import Mechanism
from jounce.spatial import groups, lie
from jounce.spatial.inertia import inertia_matrix


def mechanism(
    model: Any,
    gravity: object = None,
    base: str | None = None,
    root: str | None = None,
    file: Path | None = None,
    transmissions: bool = True,
) -> Mechanism:
    """Return the mechanism of an mjModel.

    It is under its own gravity unless another is given; `file` is what messages call it. `transmissions` is whether
    motors on tendons move joints together.
    """
    m = read_arrays(model, file)
    with locate_errors(m.place):
        tree.check_base(base)
    if len(m.joints) == 0:
        raise JounceError(f"{m.place}: no joint; expected at least one movable joint")
    # Equality constraints are joints that follow, loops, or ignored.
    followers = mujoco_ties.find_followers(m)
    mimics = mujoco_ties.linear_mimics(m, followers)
    active = mujoco_ties.active_constraints(m)
    ties = mujoco_ties.find_ties(m, active, {*m.bodies, *m.joints, *m.sites})
    ends = [end for tie in ties for end in (tie.a, tie.b)]
    links, joints = _build_bodies(m, mimics, ends, welded=base == "fixed")
    warn_of_ignored(m, ties=len(active) - len(followers) - len(ties), floats=base != "fixed")
    gravity = m.gravity * m.acts("GRAVITY") if gravity is None else gravity
    parts = tree.LinkModel(links, joints, m.name, m.place, world=m.bodies[0])
    built = tree.build_mechanism(parts, gravity, base, root)
    # Tendons are rotors that follow the joints, and motors; those that move one joint close loops as its motors do.
    drives = mujoco_actuators.prepare_tendons(m, built)
    curved = mujoco_ties.follow_polynomials(m, drives.tree, followers)
    closed = mujoco_ties.close_ties(m, curved, ties, drives.motor_names)
    return mujoco_actuators.drive_by_tendons(drives, closed) if transmissions else closed


def _build_bodies(
    m: ModelArrays, mimics: dict[int, tree.Mimic], ends: Sequence[mujoco_ties.LoopEnd], welded: bool
) -> tuple[list[tree.Link], list[tree.Joint]]:
    """Return the links of a model, and the joints between them.

    `welded` is whether the base does not float; `ends` are those of loops.
    """
    # The inertia of a body is diagonal in its principal axes, about the COM.
    links = []
    for i, body in enumerate(m.bodies):
        pose_body_from_com, theta = m.pose("body_ipos", "body_iquat", i), np.diag(m["body_inertia"][i])
        M = inertia_matrix(m["body_mass"][i], pose_body_from_com[:3, 3], theta, rotation=pose_body_from_com[:3, :3])
        links.append(tree.Link(body, M, m.place))
    joints: list[tree.Joint] = []
    link_names, joint_names = set(m.bodies), set(m.joints)

    def weld(link: str, parent: str, B: np.ndarray) -> None:
        joints.append(tree.Joint(make_distinct(link, joint_names), parent, link, B, None, None, {}, {}, m.place))

    def add_massless(link: str) -> str:
        links.append(tree.Link(link, np.zeros((6, 6)), m.place))
        return link

    # The joints of a body are a chain from its parent: the first has the pose of the body, the others stand at its
    # origin, and the last one moves the body itself.
    for i, body in enumerate(m.bodies[1:], 1):
        carrier, B = m.bodies[m["body_parentid"][i]], m.pose("body_pos", "body_quat", i)
        joints_of_body = range(m["body_jntadr"][i], m["body_jntadr"][i] + m["body_jntnum"][i])
        for j in joints_of_body:
            # The q of a free joint is the pose in the world, wherever the file has the body.
            if m["jnt_type"][j] == mujoco_arrays.FREE_JOINT_TYPE and not welded:
                B = np.eye(4)
            is_last = j == joints_of_body[-1]
            child = body if is_last else add_massless(make_distinct(f"{body}:{m.joints[j]}", link_names))
            joints.append(build_joint(m, j, carrier, child, B, mimics.get(j)))
            carrier, B = child, np.eye(4)
        if len(joints_of_body) == 0:
            weld(body, carrier, B)
    for i, site in enumerate(m.sites):
        if site != "" and site not in link_names:
            weld(add_massless(site), m.bodies[m["site_bodyid"][i]], m.pose("site_pos", "site_quat", i))
    for end in ends:
        weld(add_massless(end.frame), end.body, end.T)
    return links, joints


# Joints: their screws, limits and drive trains.
def build_joint(m: ModelArrays, j: int, parent: str, child: str, B: np.ndarray, mimic: tree.Mimic | None) -> tree.Joint:
    """Return a joint between two links.

    B is the pose of the child where the joint variable is `qpos0`.
    """
    name, kind = m.joints[j], int(m["jnt_type"][j])
    free = mujoco_arrays.FREE_JOINT_KINDS.get(kind)
    if kind == mujoco_arrays.FREE_JOINT_TYPE:
        return tree.Joint(name, parent, child, B, None, None, {}, {}, m.place, free=free)
    if kind == mujoco_arrays.BALL_JOINT_TYPE:
        X = lie.Ad(lie.pose(np.eye(3), m["jnt_pos"][j][:, None])) @ groups.BALL.X
        return tree.Joint(name, parent, child, B, X.T, None, _ball_limits(m, j), _drive(m, j), m.place, free=free)
    # B exp(X qpos0) is the pose where the file places the child: B is the pose at zero.
    X, start = _screw(m, j), m["qpos0"][m["jnt_qposadr"][j]]
    if start != 0:
        B = B @ lie.exp(X, -start[None, None])
    return tree.Joint(name, parent, child, B, X, mimic, _joint_limits(m, j), _drive(m, j), m.place)


def _ball_limits(m: ModelArrays, j: int) -> dict[str, StatedLimit]:
    """Return the limits of a ball, if it has some.

    They are those of the angle of its whole turn, which is pi at most.
    """
    largest_angle = float(m["jnt_range"][j][1])
    is_bounded = m["jnt_limited"][j] and largest_angle < np.pi
    return {"lower": -largest_angle, "upper": largest_angle} if is_bounded else {}


def _screw(m: ModelArrays, j: int) -> np.ndarray:
    """Return the screw (6,) of a slide or a hinge."""
    axis = m["jnt_axis"][j]
    if m["jnt_type"][j] == mujoco_arrays.SLIDE_JOINT_TYPE:
        return np.concatenate([np.zeros(3), axis])
    return np.concatenate([axis, np.cross(m["jnt_pos"][j], axis)])


def _joint_limits(m: ModelArrays, j: int) -> dict[str, StatedLimit]:
    """Return the range of a joint, and the range of its effort.

    Its actuators may exert together the sum of their ranges, if all have one.
    """
    limits: dict[str, StatedLimit] = {}
    if m["jnt_limited"][j]:
        limits["lower"], limits["upper"] = m["jnt_range"][j].tolist()
    lower, upper = mujoco_actuators.clamped_forces(m, j, mujoco_actuators.joint_forces(m, j))
    if np.isfinite([lower, upper]).any():
        limits["effort"] = upper if lower == -upper else (lower, upper)
    return limits


def _drive(m: ModelArrays, j: int) -> dict[str, float]:
    """Return the drive of a joint.

    Armature and damping of its actuators count times the gear squared, at joints of one screw.
    """
    dof, is_single = m["jnt_dofadr"][j], moves_along_one_screw(m, j)
    gears_squared = is_single * mujoco_actuators.find_joint_actuators(m, j) * m["actuator_gear"][:, 0] ** 2
    drive = {
        "armature": m["dof_armature"][dof] + np.sum(gears_squared * m["actuator_armature"]),
        "damping": m["dof_damping"][dof] + np.sum(gears_squared * m["actuator_damping"]),
        "friction": m["dof_frictionloss"][dof] * m.acts("FRICTIONLOSS", "CONSTRAINT"),
        "stiffness": is_single * m["jnt_stiffness"][j] * m.acts("SPRING", "PASSIVE"),
    }
    drive["damping"] *= m.acts("DAMPER", "PASSIVE")
    if drive["stiffness"] != 0:
        drive["rest"] = m["qpos_spring"][m["jnt_qposadr"][j]]
    return {key: float(x) for key, x in drive.items()}


def warn_of_ignored(m: ModelArrays, ties: int, floats: bool) -> None:
    """Warn of terms of MuJoCo's inverse dynamics that jounce ignores.

    `ties` is the number of equality constraints that are ignored. Contacts, limits and the laws of actuators are not
    among these terms: Q is the force that they must supply.
    """
    # A number of parts, or which parts have the term.
    ignored: dict[str, int | np.bool_ | np.ndarray] = {
        "equality constraints": ties,
        **mujoco_actuators.find_unread(m),
        "springs of ball joints": (m["jnt_type"] == mujoco_arrays.BALL_JOINT_TYPE) & (m["jnt_stiffness"] != 0),
        "springs that are not linear": m.nonzero_rows("jnt_stiffnesspoly", "jnt_springyield"),
        "dampers that are not linear": m.nonzero_rows("dof_dampingpoly"),
        "bodies with gravity compensation": m.nonzero_rows("body_gravcomp"),
        "bodies with a plugin": m["body_plugin"] >= 0,
        "armature, damping, friction and springs of the free joint": floats and _free_drives(m).any(),
        "flexible bodies": m["nflex"],
        "drag and lift of the fluid": m.fluid,
    }
    counts = {term: int(np.sum(parts)) for term, parts in ignored.items()}
    words = [f"{term} ({n})" if n > 1 else term for term, n in counts.items() if n != 0]
    if len(words) > 0:
        warn(f"{m.place}: ignored, since not part of a tree of rigid bodies: {', '.join(words)}")


def _free_drives(m: ModelArrays) -> np.ndarray:
    """Return the numbers of the drive trains of free joints."""
    joints = np.flatnonzero(m["jnt_type"] == mujoco_arrays.FREE_JOINT_TYPE)
    rows = (m["jnt_dofadr"][joints, None] + np.arange(6)).ravel()
    numbers = [m[f"dof_{name}"][rows] for name in ("armature", "damping", "frictionloss")]
    return np.concatenate([*numbers, m["jnt_stiffness"][joints]])
