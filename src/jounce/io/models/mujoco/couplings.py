"""Equality constraints of an mjModel: those that tie one joint linearly to another make it follow.

``q1 - q1_0 = a + b (q2 - q2_0)`` with `qpos0` for q1_0, q2_0. MuJoCo's are soft, and here they hold exactly.
"""

import numpy as np

from jounce.io.models.mujoco.arrays import Arrays
from jounce.io.models.mujoco.joints import moves_along_one_screw
from jounce.model.tree import Mimic

JOINT_EQUALITY_TYPE = 2  # mujoco.mjtEq


def mimics(m: Arrays) -> dict[int, Mimic]:
    """Map joints to those that they follow, by index; those that form a cycle or tie a joint twice are ignored."""
    leaders: dict[int, int] = {}
    found: dict[int, Mimic] = {}
    for k in active(m):
        i, leader, law = m.of["eq_obj1id"][k], m.of["eq_obj2id"][k], m.of["eq_data"][k]
        if m.of["eq_type"][k] != JOINT_EQUALITY_TYPE or leader < 0 or law[2:5].any() or i in leaders:
            continue
        if not (moves_along_one_screw(m, i) and moves_along_one_screw(m, leader)) or _leads_to(leader, i, leaders):
            continue
        start, start_of_leader = (m.of["qpos0"][m.of["jnt_qposadr"][j]] for j in (i, leader))
        leaders[i] = leader
        found[i] = Mimic(m.joints[leader], float(law[1]), float(start + law[0] - law[1] * start_of_leader))
    return found


def active(m: Arrays) -> list[int]:
    """Return the active equality constraints."""
    return [int(k) for k in np.flatnonzero(m.of["eq_active0"])] if m.acts("EQUALITY", "CONSTRAINT") else []


def _leads_to(joint: int, end: int, leaders: dict[int, int]) -> bool:
    """Whether a joint is another one, or follows it."""
    while joint != end and joint in leaders:
        joint = leaders[joint]
    return joint == end
