"""Features of an mjModel that are not part of a tree of rigid bodies and its drives: reported in one warning."""

import numpy as np

from jounce.core.errors import warn
from jounce.io.models.mujoco.arrays import ModelArrays
from jounce.io.models.mujoco.joints import BALL_JOINT_TYPE, FREE_JOINT_TYPE, JOINT_TRANSMISSION_TYPES


def warn_of_ignored(m: ModelArrays, ties: int, floats: bool) -> None:
    """Warn of terms of MuJoCo's inverse dynamics that jounce ignores, including `ties` equality constraints.

    Contacts, limits and the laws of actuators are not among these terms: Q is the force that they must supply.
    """
    elsewhere = ~np.isin(m["actuator_trntype"], JOINT_TRANSMISSION_TYPES)
    trains = _nonzero_rows(m, "actuator_armature", "actuator_damping", "actuator_dampingpoly")
    found: dict[str, int | np.bool_ | np.ndarray] = {
        "equality constraints": ties,
        "tendons that pull or resist": _nonzero_rows(m, "tendon_stiffness", "tendon_damping", "tendon_frictionloss"),
        "armatures of tendons": _nonzero_rows(m, "tendon_armature"),
        "drive trains of actuators at no joint": trains & elsewhere,
        "springs of ball joints": (m["jnt_type"] == BALL_JOINT_TYPE) & (m["jnt_stiffness"] != 0),
        "springs that are not linear": _nonzero_rows(m, "jnt_stiffnesspoly", "jnt_springyield"),
        "dampers that are not linear": _nonzero_rows(m, "dof_dampingpoly"),
        "dampers of actuators that are not linear": _nonzero_rows(m, "actuator_dampingpoly") & ~elsewhere,
        "bodies with gravity compensation": _nonzero_rows(m, "body_gravcomp"),
        "bodies with a plugin": m["body_plugin"] >= 0,
        "armature, damping, friction and springs of the free joint": floats and _free_drives(m).any(),
        "flexible bodies": m["nflex"],
        "drag and lift of the fluid": m.fluid,
    }
    counted = {what: int(np.sum(which)) for what, which in found.items()}
    said = [f"{what} ({n})" if n > 1 else what for what, n in counted.items() if n]
    if said:
        warn(f"{m.place}: ignored, since not part of a tree of rigid bodies: {', '.join(said)}")


def _free_drives(m: ModelArrays) -> np.ndarray:
    """Return the numbers of the drive trains of free joints."""
    joints = np.flatnonzero(m["jnt_type"] == FREE_JOINT_TYPE)
    rows = (m["jnt_dofadr"][joints, None] + np.arange(6)).ravel()
    of_dofs = [m[f"dof_{name}"][rows] for name in ("armature", "damping", "frictionloss")]
    return np.concatenate([*of_dofs, m["jnt_stiffness"][joints]])


def _nonzero_rows(m: ModelArrays, *names: str) -> np.ndarray:
    """Return which rows of arrays of equal length have a nonzero entry; missing arrays are skipped."""
    there = [m[name] for name in names if m[name].ndim]
    return np.any([array.any(axis=tuple(range(1, array.ndim))) for array in there], axis=0)
