"""The vectors qpos and qvel of a MuJoCo model."""

from typing import Any

import numpy as np

from jounce.io.models.mujoco.arrays import read_arrays
from jounce.io.models.mujoco.joints import FREE_JOINT_TYPE, moves_along_one_screw
from jounce.io.models.states.layout import FreeJointPlace, JointPlace, ModelLayout
from jounce.spatial.groups import BALL, FREE


def read_layout(model: Any) -> ModelLayout:
    """Return where a model has its joints."""
    m = read_arrays(model, None, "model=")
    beyond = [{name} for name in m.bodies]
    for site, body in zip(m.sites, m["site_bodyid"], strict=True):
        beyond[body] |= {site} - {""}
    of_body = [m.joints[j : j + k] for j, k in zip(m["body_jntadr"], m["body_jntnum"], strict=True)]
    for i in reversed(range(1, len(m.bodies))):
        beyond[m["body_parentid"][i]] |= beyond[i] | {*of_body[i]}
    places: dict[str, JointPlace] = {}
    free: dict[str, FreeJointPlace] = {}
    carries: dict[str, frozenset[str]] = {}
    for i, names in enumerate(of_body):
        for j, name in enumerate(names, start=m["body_jntadr"][i]):
            q, v = int(m["jnt_qposadr"][j]), int(m["jnt_dofadr"][j])
            carries[name] = frozenset(beyond[i])
            if moves_along_one_screw(m, j):
                places[name] = JointPlace(q, v)
            elif m["jnt_type"][j] == FREE_JOINT_TYPE:
                at, rates = q + np.array([0, 1, 2, 4, 5, 6, 3]), v + np.array([3, 4, 5, 0, 1, 2])
                free[name] = FreeJointPlace(name, FREE, at, rates, in_world=True, moved={m.bodies[i]: np.eye(4)})
            else:
                free[name] = FreeJointPlace(name, BALL, q + np.array([1, 2, 3, 0]), v + np.arange(3))
    rest = np.array(m["qpos0"], dtype=float)
    sizes = len(rest), int(model.nv)
    return ModelLayout(m.place, ("qpos", "qvel", "qacc", "qfrc"), *sizes, rest, places, free, carries)
