"""Equality constraints of an mjModel. MuJoCo's are soft, and here they hold exactly.

Those that tie one joint linearly to another make it follow: ``q1 - q1_0 = a + b (q2 - q2_0)`` with `qpos0` for q1_0 and
q2_0. Those that connect or weld two bodies are loops, cut at a ball or at a weld: the joints with actuators move the
closed robot, which starts at `qpos0`.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from jounce.arguments.loops import build_loop, with_loops
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, warn
from jounce.io.models.mujoco.arrays import ModelArrays, make_distinct
from jounce.io.models.mujoco.joints import JOINT_TRANSMISSION_TYPES, moves_along_one_screw
from jounce.model.mechanism import Mechanism
from jounce.model.positions import check_single_screws
from jounce.model.tree import Mimic
from jounce.spatial import lie

JOINT_EQUALITY_TYPE = 2  # mujoco.mjtEq
CUT_JOINTS = {0: "spherical", 1: "fixed"}  # by mujoco.mjtEq: connect and weld
SITE_OBJECT_TYPE = 6  # mujoco.mjtObj


class LoopEnd(NamedTuple):
    """One end of a loop: the name of its frame, the body that carries it, and its pose there."""

    frame: str
    body: str
    T: np.ndarray


class LoopTie(NamedTuple):
    """Two ends that a constraint ties, and the joint between them."""

    a: LoopEnd
    b: LoopEnd
    joint: str


def find_mimics(m: ModelArrays) -> dict[int, Mimic]:
    """Map joints to those that they follow, by index; those that form a cycle or tie a joint twice are ignored."""
    leaders: dict[int, int] = {}
    found: dict[int, Mimic] = {}
    for k in active_constraints(m):
        i, leader, law = m["eq_obj1id"][k], m["eq_obj2id"][k], m["eq_data"][k]
        if m["eq_type"][k] != JOINT_EQUALITY_TYPE or leader < 0 or law[2:5].any() or i in leaders:
            continue
        if not (moves_along_one_screw(m, i) and moves_along_one_screw(m, leader)) or _leads_to(leader, i, leaders):
            continue
        start, start_of_leader = (m["qpos0"][m["jnt_qposadr"][j]] for j in (i, leader))
        leaders[i] = leader
        found[i] = Mimic(m.joints[leader], float(law[1]), float(start + law[0] - law[1] * start_of_leader))
    return found


def active_constraints(m: ModelArrays) -> list[int]:
    """Return the active equality constraints."""
    return [int(k) for k in np.flatnonzero(m["eq_active0"])] if m.acts("EQUALITY", "CONSTRAINT") else []


def _leads_to(joint: int, end: int, leaders: dict[int, int]) -> bool:
    """Whether a joint is another one, or follows it."""
    while joint != end and joint in leaders:
        joint = leaders[joint]
    return joint == end


def find_ties(m: ModelArrays, active: Sequence[int], taken: set[str]) -> list[LoopTie]:
    """The loops among the active equality constraints; their frames take names that are free."""
    found: list[LoopTie] = []
    for k in active:
        joint = CUT_JOINTS.get(int(m["eq_type"][k]))
        if joint is None:
            continue
        places = [m[f"eq_obj{side}id"][k] for side in (1, 2)]
        if m["eq_objtype"][k] == SITE_OBJECT_TYPE:
            placed = [(m.bodies[m["site_bodyid"][i]], m.pose("site_pos", "site_quat", i)) for i in places]
        else:
            placed = list(zip([m.bodies[i] for i in places], _anchors(m, k, joint), strict=True))
        a, b = (LoopEnd(make_distinct(f"loop{len(found)}:{body}", taken), body, T) for body, T in placed)
        found.append(LoopTie(a, b, joint))
    return found


def _anchors(m: ModelArrays, k: int, joint: str) -> list[np.ndarray]:
    """The frames on two bodies: the anchors of a connection, or that of a weld and where it is to be."""
    data = m["eq_data"][k]
    at = [lie.pose(np.eye(3), data[3 * i : 3 * i + 3, None]) for i in range(2)]
    if joint == "fixed":
        related = lie.pose(lie.from_quaternion(data[6:10]), data[3:6, None])
        at = [related @ at[0], at[0]]
    return at


def close_ties(m: ModelArrays, mechanism: Mechanism, tied: Sequence[LoopTie]) -> Mechanism:
    """The mechanism with its loops closed; they stay open if the joints with actuators do not determine the motion."""
    loops = []
    for tie in tied:
        if {tie.a.frame, tie.b.frame} <= set(mechanism.frame_names):
            with suppress(JounceError):  # between bodies that are welded to each other
                loops.append(build_loop(mechanism, tie.a.frame, tie.b.frame, tie.joint))
    if not loops:
        return mechanism
    mechanism = replace(mechanism, loops=tuple(loops))
    driven = m["actuator_trnid"][np.isin(m["actuator_trntype"], JOINT_TRANSMISSION_TYPES), 0]
    motors = [name for name in mechanism.coordinates if name in {m.joints[j] for j in driven}]
    try:
        check_single_screws(mechanism, "closed loops")
        if mechanism.floats and any(-1 in (loop.a.body, loop.b.body) for loop in loops):
            raise JounceError("some hold the base to the ground, which makes its pose a coordinate")
        start: Mapping[str, float] = {
            name: float(m["qpos0"][m["jnt_qposadr"][m.joints.index(name)]]) for name in mechanism.coordinates
        }
        if not motors:
            raise JounceError("no joint has an actuator")
        return with_loops(mechanism, actuated=motors, start=start)
    except JounceError as error:
        warn(f"{m.place}: its loops stay open{Remedy(', robot.closed(actuated=[...]) closes them')}: {error}")
        return mechanism
