"""The vectors q and v of a Pinocchio model."""

from typing import Any

import numpy as np

from jounce.io.models.pinocchio import FREE_FLYER, FREE_JOINTS, check_model, coordinate_names, moved_bodies
from jounce.io.models.states.layout import FreeJoint, Layout, Place

BODIES = ("BODY", "OP_FRAME", "SENSOR", "JOINT")  # frames that may be the base

LABELS = ("q", "v", "a", "tau")


def layout(model: Any) -> Layout:
    """Return where a model has its joints."""
    check_model(model, "model=")
    joints, bodies = list(model.joints), moved_bodies(model)
    rest = np.zeros(model.nq)
    places: dict[str, Place] = {}
    free: dict[str, FreeJoint] = {}
    beyond: list[set[str]] = [set() for _ in joints]
    own: list[list[str]] = [[] for _ in joints]
    for i, joint in enumerate(joints[1:], start=1):
        kind = joint.shortname()
        spans = _spans(joint)
        own[i] = coordinate_names(model, i) if spans else [model.names[i]]
        for name, (q, v, turns) in zip(own[i], spans, strict=False):
            places[name] = Place(joint.idx_q + q, joint.idx_v + v, turns)
            rest[joint.idx_q + q] = turns
        if kind in FREE_JOINTS:
            rest[joint.idx_q : joint.idx_q + joint.nq] = FREE_JOINTS[kind][1]
        if kind == FREE_FLYER:
            moved = {f.name: f.placement.homogeneous for f in model.frames if f.parentJoint == i and _names_a_body(f)}
            ground = model.jointPlacements[i].homogeneous
            free[model.names[i]] = FreeJoint(joint.idx_q, joint.idx_v, ground, moved | {bodies[i]: np.eye(4)})
    for frame in model.frames:
        if _names_a_body(frame):
            beyond[frame.parentJoint].add(frame.name)
    for i in reversed(range(1, len(joints))):
        beyond[i] |= {bodies[i]}
        beyond[model.parents[i]] |= beyond[i] | {*own[i]}
    carries = {name: frozenset(beyond[i]) for i in range(1, len(joints)) for name in own[i] if joints[i].nv}
    what = f"model {model.name or 'robot'!r}"
    return Layout(what, LABELS, model.nq, model.nv, rest, places, free, carries, (3, 0, 1, 2), linear_in_world=False)


def _names_a_body(frame: Any) -> bool:
    return frame.type.name in BODIES


def _spans(joint: Any) -> list[tuple[int, int, bool]]:
    """The places of a joint's coordinates within its own, and whether they are a cosine and a sine; none if free."""
    if joint.shortname() == "JointModelComposite":
        found, q, v = [], 0, 0
        for part in joint.extract().joints:
            found += [(q + a, v + b, turns) for a, b, turns in _spans(part)]
            q, v = q + part.nq, v + part.nv
        return found
    if joint.nq == joint.nv:
        return [(k, k, False) for k in range(joint.nv)]
    return [(0, 0, True)] if (joint.nq, joint.nv) == (2, 1) else []
