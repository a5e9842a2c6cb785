"""Loops of an mjModel: equality constraints that connect or weld two bodies, cut at a ball or at a weld.

MuJoCo's are soft, and here they hold exactly. The joints with actuators move the closed robot; it starts at `qpos0`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.arguments.loops import loop_between, with_loops
from jounce.core.errors import JounceError, warn
from jounce.io.models.mujoco.arrays import Arrays, distinct
from jounce.io.models.mujoco.joints import JOINT_TRANSMISSION_TYPES
from jounce.model.mechanism import Mechanism
from jounce.model.positions import check_single, positions
from jounce.spatial import lie

CUT_JOINTS = {0: "spherical", 1: "fixed"}  # by mujoco.mjtEq: connect and weld
SITE_OBJECT_TYPE = 6  # mujoco.mjtObj


@dataclass(frozen=True, eq=False)
class End:
    """One end of a loop: the name of its frame, the body that carries it, and its pose there."""

    frame: str
    body: str
    T: np.ndarray


@dataclass(frozen=True, eq=False)
class Tie:
    """Two ends that a constraint ties, and the joint between them."""

    a: End
    b: End
    joint: str


def ties(m: Arrays, active: Sequence[int], taken: set[str]) -> list[Tie]:
    """The loops among the active equality constraints; their frames take names that are free."""
    found: list[Tie] = []
    for k in active:
        joint = CUT_JOINTS.get(int(m.of["eq_type"][k]))
        if joint is None:
            continue
        placed = _sites(m, k) if m.of["eq_objtype"][k] == SITE_OBJECT_TYPE else _bodies(m, k, joint)
        a, b = (End(distinct(f"loop{len(found)}:{body}", taken), body, T) for body, T in placed)
        found.append(Tie(a, b, joint))
    return found


def _sites(m: Arrays, k: int) -> list[tuple[str, np.ndarray]]:
    places = [m.of[f"eq_obj{side}id"][k] for side in (1, 2)]
    return [(m.bodies[m.of["site_bodyid"][i]], m.pose("site_pos", "site_quat", i)) for i in places]


def _bodies(m: Arrays, k: int, joint: str) -> list[tuple[str, np.ndarray]]:
    """The frames on two bodies: the anchors of a connection, or that of a weld and where it is to be."""
    bodies, data = [m.bodies[m.of[f"eq_obj{side}id"][k]] for side in (1, 2)], m.of["eq_data"][k]
    at = [lie.pose(np.eye(3), data[3 * i : 3 * i + 3, None]) for i in range(2)]
    if joint == "fixed":
        related = lie.pose(lie.from_quaternion(data[6:10]), data[3:6, None])
        at = [related @ at[0], at[0]]
    return list(zip(bodies, at, strict=True))


def close(m: Arrays, mechanism: Mechanism, tied: Sequence[Tie]) -> Mechanism:
    """The mechanism with its loops closed; they stay open if the joints with actuators do not determine the motion."""
    there = [tie for tie in tied if {tie.a.frame, tie.b.frame} <= set(mechanism.frame_names)]
    loops = []
    for tie in there:
        try:
            loops.append(loop_between(mechanism, tie.a.frame, tie.b.frame, tie.joint))
        except JounceError:  # between bodies that are welded to each other
            continue
    if not loops:
        return mechanism
    mechanism = replace(mechanism, loops=tuple(loops))
    driven = m.of["actuator_trnid"][np.isin(m.of["actuator_trntype"], JOINT_TRANSMISSION_TYPES), 0]
    motors = [name for name in mechanism.coordinates if name in {m.joints[j] for j in driven}]
    try:
        check_single(mechanism, "closed loops")
        start: Mapping[str, float] = {
            name: float(m.of["qpos0"][m.of["jnt_qposadr"][m.joints.index(name)]]) for name in mechanism.coordinates
        }
        if not motors:
            raise JounceError("no joint has an actuator")
        return with_loops(mechanism, actuated=motors, start=start)
    except JounceError as error:
        cure = "" if positions(mechanism) else ", robot.closed(actuated=[...]) closes them"
        warn(f"{m.place}: its loops stay open{cure}: {error}")
        return mechanism
