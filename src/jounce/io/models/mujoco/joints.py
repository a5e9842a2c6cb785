"""Joints of an mjModel: their screws, limits and drive trains.

Joint variables are MuJoCo's own, which are `qpos0` where the bodies stand as the file places them; angles in rad. The
numbers q of a free joint are the pose of its body in the world, those of a ball the turn from where the file has the
body: MuJoCo's own too, but for the order x, y, z, w of quaternions.
"""

import numpy as np

from jounce.io.models.mujoco.arrays import ModelArrays
from jounce.model import tree
from jounce.model.stated_limits import StatedLimit
from jounce.spatial import groups, lie

FREE_JOINT_TYPE, BALL_JOINT_TYPE, SLIDE_JOINT_TYPE = 0, 1, 2  # mujoco.mjtJoint
FREE_JOINT_KINDS = {FREE_JOINT_TYPE: "floating", BALL_JOINT_TYPE: "spherical"}
JOINT_TRANSMISSION_TYPES = (0, 1)  # mujoco.mjtTrn, in a joint's frame or its parent's: the same for one axis


def moves_along_one_screw(m: ModelArrays, j: int) -> bool:
    """Whether a joint is a hinge or a slide."""
    return int(m["jnt_type"][j]) not in FREE_JOINT_KINDS


def build_joint(m: ModelArrays, j: int, parent: str, child: str, B: np.ndarray, mimic: tree.Mimic | None) -> tree.Joint:
    """A joint between two links; B is the child's pose where the joint variable is `qpos0`."""
    name, kind = m.joints[j], int(m["jnt_type"][j])
    if kind == FREE_JOINT_TYPE:
        return tree.Joint(name, parent, child, B, None, None, {}, {}, m.place, free=FREE_JOINT_KINDS[kind])
    if kind == BALL_JOINT_TYPE:
        X, free = lie.Ad(lie.pose(np.eye(3), m["jnt_pos"][j][:, None])) @ groups.BALL.X, FREE_JOINT_KINDS[kind]
        return tree.Joint(name, parent, child, B, X.T, None, _ball_limits(m, j), _drive(m, j), m.place, free=free)
    X, start = _screw(m, j), m["qpos0"][m["jnt_qposadr"][j]]
    B = B @ lie.exp(X, -start[None, None]) if start else B
    return tree.Joint(name, parent, child, B, X, mimic, _joint_limits(m, j), _drive(m, j), m.place)


def _ball_limits(m: ModelArrays, j: int) -> dict[str, StatedLimit]:
    """The range of a ball: that of the angle of its whole turn, which is pi at most."""
    most = float(m["jnt_range"][j][1])
    return {"lower": -most, "upper": most} if m["jnt_limited"][j] and most < np.pi else {}


def _screw(m: ModelArrays, j: int) -> np.ndarray:
    axis = m["jnt_axis"][j]
    if m["jnt_type"][j] == SLIDE_JOINT_TYPE:
        return np.concatenate([np.zeros(3), axis])
    return np.concatenate([axis, np.cross(m["jnt_pos"][j], axis)])


def _joint_limits(m: ModelArrays, j: int) -> dict[str, StatedLimit]:
    """The range of a joint, and what its actuators may exert together: the sum of their ranges, if all have one."""
    stated: dict[str, StatedLimit] = {}
    if m["jnt_limited"][j]:
        stated["lower"], stated["upper"] = m["jnt_range"][j].tolist()
    lower, upper = _actuator_forces(m, j)
    if m["jnt_actfrclimited"][j]:
        low, high = m["jnt_actfrcrange"][j].tolist()
        lower, upper = max(lower, low), min(upper, high)
    if np.isfinite([lower, upper]).any():
        stated["effort"] = upper if lower == -upper else (lower, upper)
    return stated


def _actuator_forces(m: ModelArrays, j: int) -> tuple[float, float]:
    """The smallest and largest force of the actuators of a joint; infinite without actuators or ranges."""
    acting = np.flatnonzero(_find_actuators(m, j))
    if not acting.size or not m["actuator_forcelimited"][acting].all():
        return -np.inf, np.inf
    ends = m["actuator_forcerange"][acting] * m["actuator_gear"][acting, :1]
    return float(ends.min(axis=1).sum()), float(ends.max(axis=1).sum())


def _drive(m: ModelArrays, j: int) -> dict[str, float]:
    """Return the drive of a joint, with the actuators' armature and damping times the gear squared."""
    dof, single = m["jnt_dofadr"][j], moves_along_one_screw(m, j)
    gears = single * _find_actuators(m, j) * m["actuator_gear"][:, 0] ** 2
    stated = {
        "armature": m["dof_armature"][dof] + np.sum(gears * m["actuator_armature"]),
        "damping": m["dof_damping"][dof] + np.sum(gears * m["actuator_damping"]),
        "friction": m["dof_frictionloss"][dof] * m.acts("FRICTIONLOSS", "CONSTRAINT"),
        "stiffness": single * m["jnt_stiffness"][j] * m.acts("SPRING", "PASSIVE"),
    }
    stated["damping"] *= m.acts("DAMPER", "PASSIVE")
    if stated["stiffness"]:
        stated["rest"] = m["qpos_spring"][m["jnt_qposadr"][j]]
    return {key: float(x) for key, x in stated.items()}


def _find_actuators(m: ModelArrays, j: int) -> np.ndarray:
    return np.isin(m["actuator_trntype"], JOINT_TRANSMISSION_TYPES) & (m["actuator_trnid"][:, 0] == j)
