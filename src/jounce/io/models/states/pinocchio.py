"""The vectors q and v of a Pinocchio model."""

from typing import Any

import numpy as np

from jounce.io.models.pinocchio import FREE_FLYER, check_model, moved_bodies, split_joint
from jounce.io.models.states.layout import FreeJointPlace, JointPlace, ModelLayout
from jounce.model import tree

BASE_FRAME_TYPES = ("BODY", "OP_FRAME", "SENSOR", "JOINT")  # frames that may be the base


def read_layout(model: Any) -> ModelLayout:
    """Return where a model has its joints."""
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
