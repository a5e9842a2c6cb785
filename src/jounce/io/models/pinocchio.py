"""Pinocchio's models, read by evaluating their joints at zero.

A joint has a pose M(q) in the frame of its parent and a motion S(q) in the moved frame. Where its coordinates are
angles and lengths it is a chain of screws, ``M(q) = M(0) exp(X_1 q_1) ... exp(X_k q_k)``, and the X are the columns of
S(0). The screws of a ball, a planar or a free joint, alone or in a chain, are one joint of several screws, in jounce's
order.
"""

from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, warn
from jounce.model import tree
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie
from jounce.spatial.inertia import inertia_matrix

FREE_FLYER = "JointModelFreeFlyer"
# Joints of several screws: their kind, q at zero, and where v has each of jounce's velocities.
FREE_JOINT_MODELS = {
    FREE_FLYER: ("floating", [0, 0, 0, 0, 0, 0, 1], [3, 4, 5, 0, 1, 2]),
    "JointModelPlanar": ("planar", [0, 0, 1, 0], [2, 0, 1]),
    "JointModelSpherical": ("spherical", [0, 0, 0, 1], [0, 1, 2]),
}
NAMED_FRAME_TYPES = ("BODY", "OP_FRAME", "SENSOR")  # frames that become links of their names
CHAIN_TOLERANCE = 1e-9  # of rotations, and of positions to the lengths of a joint
ZERO_INERTIA = np.zeros((6, 6))
NO_LIMIT = np.finfo(float).max  # by which Pinocchio states that a joint has none


def mechanism(model: Any, gravity: object = None, base: str | None = None, root: str | None = None) -> Mechanism:
    """Return the mechanism of a `pinocchio.Model`.

    Bodies are depth first, coordinates in the order of Pinocchio's v.
    """
    check_model(model, "from_pinocchio()")
    robot_name = model.name or "robot"
    what = f"model {robot_name!r}"
    if gravity is None and model.gravity.angular.any():
        came = model.gravity.angular.tolist()
        raise JounceError(f"{what}: the gravity field has an angular part, {came}; expected zeros")
    # Each joint moves one body, behind massless links where it is a chain.
    bodies = moved_bodies(model)
    links, joints = [tree.Link(bodies[0], ZERO_INERTIA, what)], []
    for i, Y in enumerate(model.inertias[1:], start=1):
        chain = _chain(model, i, bodies, what)
        joints += chain
        links += [tree.Link(joint.child, ZERO_INERTIA, what) for joint in chain[:-1]]
        # Numbers that overflow are refused as not finite.
        with np.errstate(over="ignore", invalid="ignore"):
            links += [tree.Link(bodies[i], inertia_matrix(Y.mass, Y.lever, Y.inertia), what)]
    # Other frames are massless links on fixed joints.
    for frame in _other_frames(model, bodies):
        name, parent = frame.name, bodies[frame.parentJoint]
        links.append(tree.Link(name, ZERO_INERTIA, what))
        joints.append(_fixed_joint(f"frame {name}", parent, name, frame.placement.homogeneous, what))
    gravity = model.gravity.linear if gravity is None else gravity
    parts = tree.LinkModel(links, joints, robot_name, what, world=bodies[0])
    built = tree.build_mechanism(parts, gravity, base, root)
    # The armature of joints of several screws belongs to no coordinate.
    free_places = []
    for joint in list(model.joints)[1:]:
        free_places += [joint.idx_v + part.v for part in split_joint(joint, "") if part.kind is not None]
    if base != "fixed" and any(model.armature[v].any() for v in free_places):
        owners = "the free-flyer" if built.floats else "joints of several screws"
        warn(f"{what}: ignored, since not part of a tree of rigid bodies: armature of {owners}")
    # The tree is built depth first; Pinocchio orders v by its joints.
    names = [name for joint in joints for name in joint.variables]
    order = [built.coordinates.index(name) for name in names if name in built.coordinates]
    return replace(built, G=built.G[:, order], coordinates=tuple(built.coordinates[j] for j in order))


def check_model(model: Any, what: str) -> None:
    """Raise `JounceError` unless an argument is a `pinocchio.Model` of numbers."""
    kind = type(model)
    if kind.__name__ != "Model" or not kind.__module__.startswith("pinocchio.pinocchio_pywrap_default"):
        raise JounceError(f"{what} expects a pinocchio.Model of numbers, got {kind.__module__}.{kind.__name__}")


def moved_bodies(model: Any) -> list[str]:
    """Return the names of the bodies that the joints move.

    A name is that of the first body on a joint, or else of the joint.
    """
    names = list(model.names)
    for frame in reversed(model.frames):
        if frame.type.name == "BODY" and frame.parentJoint and np.array_equal(frame.placement.homogeneous, np.eye(4)):
            names[frame.parentJoint] = frame.name
    return names


def _other_frames(model: Any, bodies: list[str]) -> list[Any]:
    """Return the frames that are no bodies, the first of each name."""
    frame_of_name: dict[str, Any] = {}
    for kind in NAMED_FRAME_TYPES:
        for frame in model.frames:
            if frame.type.name == kind and frame.name not in bodies:
                frame_of_name.setdefault(frame.name, frame)
    return list(frame_of_name.values())


def _chain(model: Any, i: int, bodies: list[str], what: str) -> list[tree.Joint]:
    """Return a joint of the model as a chain of joints.

    Each has one screw, or several; a joint that cannot move is fixed.
    """
    joint, parent, child = model.joints[i], bodies[model.parents[i]], bodies[i]
    placement = model.jointPlacements[i].homogeneous
    # The pose M(0) and the screws (k, 6), S(0).
    T, X = _evaluate_joint(model, joint, 0.0)
    mimic = None
    # The S of a mimic is by the coordinate of its leader, scaled.
    if joint.shortname() == "JointModelMimic" and X.any():
        follower = joint.extract()
        T, X = np.eye(4), X / follower.scaling
        mimic = tree.Mimic(_find_leader(model, joint.idx_v), follower.scaling, follower.offset)
    elif not X.any():
        return [_fixed_joint(model.names[i], parent, child, placement @ T, what)]
    elif not _is_chain(model, joint, T, X):
        raise JounceError(f"{what}: joint {model.names[i]!r} is a {joint.shortname()}, whose screws are not constant")
    # A mimic has no coordinates of its own, and moves along one screw.
    parts = split_joint(joint, model.names[i])
    if len(parts) == 0:
        parts = [JointPart(model.names[i], None, 0, 0)]
    links = [parent, *(part.name for part in parts[:-1]), child]
    return [
        tree.Joint(
            name=part.name,
            parent=links[k],
            child=links[k + 1],
            B=placement @ T if k == 0 else np.eye(4),
            X=X[part.v],
            mimic=mimic,
            limits={} if mimic is not None or part.kind is not None else _limits(model, joint, part),
            drive={} if mimic is not None or part.kind is not None else _drive(model, joint.idx_v + int(part.v)),
            place=what,
            free=part.kind,
        )
        for k, part in enumerate(parts)
    ]


def _fixed_joint(name: str, parent: str, child: str, B: np.ndarray, what: str) -> tree.Joint:
    return tree.Joint(name, parent, child, B, X=None, mimic=None, limits={}, drive={}, place=what)


@dataclass(frozen=True, eq=False)
class JointPart:
    """A part of a joint of Pinocchio: the joint itself, or one that it is composed of."""

    name: str
    kind: str | None  # of a joint of several screws
    q: Any  # where its numbers stand in the q of the joint, an index or several
    v: Any  # where its velocities stand in the v of the joint, in jounce's order
    turns: bool = False  # whether its q is a cosine and a sine


def split_joint(joint: Any, name: str) -> list[JointPart]:
    """Return the parts of a joint.

    A single part has the name of the joint; several are numbered by their first coordinate.
    """
    parts: list[JointPart] = []
    q = v = 0
    for part in list(joint.extract().joints) if joint.shortname() == "JointModelComposite" else [joint]:
        kind = part.shortname()
        if kind in FREE_JOINT_MODELS:
            free, q_at_zero, order = FREE_JOINT_MODELS[kind]
            parts.append(JointPart(f"{name}_{v + 1}", free, q + np.arange(len(q_at_zero)), v + np.array(order)))
        # As many numbers in q as in v: angles and lengths. A cosine and a sine for one velocity: an unbounded turn.
        elif part.nq == part.nv:
            parts += [JointPart(f"{name}_{v + k + 1}", None, q + k, v + k) for k in range(part.nv)]
        elif (part.nq, part.nv) == (2, 1):
            parts.append(JointPart(f"{name}_{v + 1}", None, q, v, turns=True))
        q, v = q + part.nq, v + part.nv
    return [replace(parts[0], name=name)] if len(parts) == 1 else parts


def _find_leader(model: Any, v: int) -> str:
    """Return the name of the joint at a place in v."""
    parts = []
    for joint, joint_name in zip(list(model.joints)[1:], list(model.names)[1:], strict=True):
        parts += [(joint.idx_v, part) for part in split_joint(joint, joint_name)]
    return next(part.name for start, part in parts if v in start + np.atleast_1d(part.v))


def _evaluate_joint(model: Any, joint: Any, theta: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose (4, 4) and screws (k, 6) of a joint.

    All joint variables are theta; the screws are in the moved frame, (angular; linear).
    """
    q = np.concatenate([_configuration(x, np.full(x.nv, theta)) for x in list(model.joints)[1:] if x.nq > 0])
    data = joint.createData()
    joint.calc(data, q)
    # Pinocchio has the linear part first.
    return data.M.homogeneous, np.reshape(data.S, (6, -1)).T[:, [3, 4, 5, 0, 1, 2]]


def _configuration(joint: Any, theta: np.ndarray) -> np.ndarray:
    """Return the coordinates q of a joint at its variables.

    An unbounded turn is a cosine and a sine; joints of several screws stay at zero.
    """
    kind = joint.shortname()
    if kind == "JointModelComposite":
        parts = list(joint.extract().joints)
        pieces = np.split(theta, np.cumsum([part.nv for part in parts]))
        return np.concatenate([_configuration(part, x) for part, x in zip(parts, pieces[:-1], strict=True)])
    if kind in FREE_JOINT_MODELS:
        return np.array(FREE_JOINT_MODELS[kind][1], dtype=float)
    return np.array([np.cos(theta[0]), np.sin(theta[0])]) if (joint.nq, joint.nv) == (2, 1) else theta


def _is_chain(model: Any, joint: Any, T: np.ndarray, X: np.ndarray) -> bool:
    """Return whether the screws at zero make the pose elsewhere too.

    Joints of several screws are at zero in both places.
    """
    # M(1, ..., 1) against M(0) exp(X_1) ... exp(X_k).
    single_screws = [X[part.v] for part in split_joint(joint, "") if part.kind is None]
    product = reduce(np.matmul, [lie.exp(x, np.ones((1, 1))) for x in single_screws], T)
    errors = np.abs(_evaluate_joint(model, joint, 1.0)[0] - product)
    length = max(np.abs(x).max() for x in (product[:3, 3], X[:, 3:]))
    return bool(errors[:3, :3].max() <= CHAIN_TOLERANCE and errors[:3, 3].max() <= CHAIN_TOLERANCE * length)


def _limits(model: Any, joint: Any, part: JointPart) -> dict[str, float]:
    """Return the limits that are stated of a joint's coordinate.

    A cosine and a sine have no position limits.
    """
    q, v = joint.idx_q + part.q, joint.idx_v + part.v
    limits = {"velocity": model.velocityLimit[v], "effort": model.effortLimit[v]}
    if not part.turns:
        limits |= {"lower": model.lowerPositionLimit[q], "upper": model.upperPositionLimit[q]}
    # NaN stays, and is refused later.
    return {key: float(x) for key, x in limits.items() if not abs(x) >= NO_LIMIT}


def _drive(model: Any, v: int) -> dict[str, float]:
    """Return the drive train at a place in v.

    The rotor, which Pinocchio itself leaves out, counts where there is no armature.
    """
    rotor = model.rotorInertia[v] * model.rotorGearRatio[v] ** 2
    armature = rotor if model.armature[v] == 0 else model.armature[v]
    drive = {"armature": armature, "damping": model.damping[v], "friction": model.friction[v]}
    return {key: float(x) for key, x in drive.items()}
