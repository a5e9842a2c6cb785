"""Where other libraries have the coordinates of joints in their vectors, and which of these joints a robot has."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value, unknown_name_error
from jounce.io.models.mujoco.arrays import read_arrays
from jounce.io.models.mujoco.joints import FREE_JOINT_TYPE, moves_along_one_screw
from jounce.io.models.pinocchio import FREE_FLYER, check_model, moved_bodies, split_joint
from jounce.model import tree
from jounce.model.mechanism import Mechanism
from jounce.model.positions import list_multiscrew_joints, whole_position_count
from jounce.spatial.groups import BALL, FREE, Group

BASE_FRAME_TYPES = ("BODY", "OP_FRAME", "SENSOR", "JOINT")  # frames that may be the base


@dataclass(frozen=True)
class JointPlace:
    """The index of a joint's coordinate in q and v; a joint that turns freely has a cosine and a sine in q."""

    q: int
    v: int
    turns: bool = False


@dataclass(frozen=True, eq=False)
class FreeJointPlace:
    """A joint of several screws: where jounce's numbers of it stand in q, and its velocities in v.

    Of one that may carry a base also where it stands on the ground, and the frames that it moves; T is the base's.
    """

    name: str
    group: Group
    q: np.ndarray
    v: np.ndarray
    in_world: bool = False  # linear velocity, acceleration and force are in world axes, otherwise in its own
    ground: np.ndarray = field(default_factory=lambda: np.eye(4))
    moved: Mapping[str, np.ndarray] = field(default_factory=dict)  # poses in its moved frame
    T: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class ModelLayout:
    """The vectors of a model: sizes, and joints by name."""

    what: str  # for messages
    labels: tuple[str, str, str, str]  # of position, velocity, acceleration and forces
    nq: int
    nv: int
    rest: np.ndarray  # q of joints that a robot does not have
    places: Mapping[str, JointPlace]
    free: Mapping[str, FreeJointPlace]
    carries: Mapping[str, frozenset[str]]  # bodies, frames and joints beyond each joint, of all kinds


@dataclass(frozen=True, eq=False)
class LayoutMatch:
    """The joints of a robot in a model: indices with their places, and those of several screws, that of a base first.

    Their numbers stand in a whole q of nq numbers, their velocities among nv.
    """

    nq: int
    joints: Mapping[int, JointPlace]
    several: Sequence[tuple[FreeJointPlace, slice, slice]]

    @property
    def in_world(self) -> bool:
        """Whether forces take the pose of a joint, as they are in world axes."""
        return any(joint.in_world for joint, *_ in self.several)


def match_joints(mechanism: Mechanism, layout: ModelLayout) -> LayoutMatch:
    """Return the joints of a robot in a model; raise unless all that move its bodies are joints of both."""
    if mechanism.closure:
        raise JounceError(
            f"{quote_value(mechanism.name)} has closed loops, {layout.what} has the joints of its tree; convert states"
            " of jounce.Robot(robot.mechanism.tree), whose q the closed robot takes as it is"
        )
    joints = {i: layout.places[name] for i, name in enumerate(mechanism.joints) if name in layout.places}
    own = list_multiscrew_joints(mechanism)
    of_several = [name for x in own for name in mechanism.coordinates[x.coordinates]]
    for name in mechanism.coordinates:
        if name not in of_several and (name not in mechanism.joints or name not in layout.places):
            raise unknown_name_error("joint", name, layout.places, layout.what)
    for x in own:
        if layout.free.get(x.name) is None or layout.free[x.name].group is not x.group:
            kind = {name: None for name, joint in layout.free.items() if joint.group is x.group}
            raise unknown_name_error(f"{x.group.name} joint", x.name, kind, layout.what)
    base = _carrier_of_base(mechanism, layout) if mechanism.floats else None
    names = {*mechanism.joints, *(x.name for x in own)}
    known = {*mechanism.frame_names, *names}
    for name, carried in layout.carries.items():
        ours = name in names or (base is not None and layout.free.get(name) is base)
        if not ours and (moved := sorted(carried & known)):
            held = f"joint {quote_value(name)} moves {join_names(moved, most=3)}, which this robot holds"
            floats = "; load it with base='floating'" if name in layout.free and not mechanism.floats else ""
            raise JounceError(f"{layout.what}: {held}{floats or '; expected a model of the same joints'}")
    at, first = 7 * mechanism.floats, 6 * mechanism.floats
    carrier = [] if base is None else [(replace(base, T=base.moved[mechanism.bodies[0]]), slice(0, 7), slice(0, 6))]
    several = [(layout.free[x.name], _shift_slice(x.numbers, at), _shift_slice(x.coordinates, first)) for x in own]
    return LayoutMatch(whole_position_count(mechanism), joints, carrier + several)


def _shift_slice(own: slice, count: int) -> slice:
    return slice(own.start + count, own.stop + count)


def _carrier_of_base(mechanism: Mechanism, layout: ModelLayout) -> FreeJointPlace:
    base = mechanism.bodies[0]
    for joint in layout.free.values():
        if base in joint.moved:
            return joint
    some = join_names(name for joint in layout.free.values() for name in joint.moved) or "none"
    came = f"no floating joint moves {quote_value(base)}, the base of {quote_value(mechanism.name)}"
    raise JounceError(f"{layout.what}: {came}; links on floating joints: {some}")


def read_mujoco_layout(model: Any) -> ModelLayout:
    """Where a MuJoCo model has its joints in qpos and qvel."""
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


def read_pinocchio_layout(model: Any) -> ModelLayout:
    """Where a Pinocchio model has its joints in q and v."""
    check_model(model, "model=")
    joints, bodies = list(model.joints), moved_bodies(model)
    rest = np.zeros(model.nq)
    places: dict[str, JointPlace] = {}
    free: dict[str, FreeJointPlace] = {}
    beyond: list[set[str]] = [set() for _ in joints]
    own: list[list[str]] = [[] for _ in joints]
    for i, joint in enumerate(joints[1:], start=1):
        parts = split_joint(joint, model.names[i])
        own[i] = [part.name for part in parts] or [model.names[i]]
        for part in parts:
            q, v = joint.idx_q + part.q, joint.idx_v + part.v
            if part.kind is None:
                places[part.name] = JointPlace(q, v, part.turns)
                rest[q] = part.turns
                continue
            group, moved, ground = tree.FREE_JOINT_GROUPS[part.kind], {}, np.eye(4)
            rest[q] = group.resting
            if joint.shortname() == FREE_FLYER:
                moved = {f.name: f.placement.homogeneous for f in model.frames if f.parentJoint == i and _is_body(f)}
                moved, ground = moved | {bodies[i]: np.eye(4)}, model.jointPlacements[i].homogeneous
            free[part.name] = FreeJointPlace(part.name, group, q, v, ground=ground, moved=moved)
    for frame in model.frames:
        if _is_body(frame):
            beyond[frame.parentJoint].add(frame.name)
    for i in reversed(range(1, len(joints))):
        beyond[i] |= {bodies[i]}
        beyond[model.parents[i]] |= beyond[i] | {*own[i]}
    carries = {name: frozenset(beyond[i]) for i in range(1, len(joints)) for name in own[i] if joints[i].nv}
    what = f"model {model.name or 'robot'!r}"
    return ModelLayout(what, ("q", "v", "a", "tau"), model.nq, model.nv, rest, places, free, carries)


def _is_body(frame: Any) -> bool:
    return frame.type.name in BASE_FRAME_TYPES
