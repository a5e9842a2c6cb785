"""Pinocchio's models, read by evaluating their joints at zero.

A joint has a pose M(q) in its parent's and a motion S(q) in the moved frame. Where its coordinates are angles and
lengths it is a chain of screws, ``M(q) = M(0) exp(X_1 q_1) ... exp(X_k q_k)``, and the X are the columns of S(0). Those
of a ball, a planar or a free joint, alone or in a chain, are one joint of several screws, in jounce's order.
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
FREE_JOINT_MODELS = {  # joints of several screws: their kind, q at zero, and where v has each of jounce's velocities
    FREE_FLYER: ("floating", [0, 0, 0, 0, 0, 0, 1], [3, 4, 5, 0, 1, 2]),
    "JointModelPlanar": ("planar", [0, 0, 1, 0], [2, 0, 1]),
    "JointModelSpherical": ("spherical", [0, 0, 0, 1], [0, 1, 2]),
}
NAMED_FRAME_TYPES = ("BODY", "OP_FRAME", "SENSOR")  # those whose names stay
CHAIN_TOLERANCE = 1e-9  # of rotations, and of positions to the lengths of a joint
ZERO_INERTIA = np.zeros((6, 6))
NO_LIMIT = np.finfo(float).max  # by which Pinocchio states that a joint has none


def mechanism(model: Any, gravity: object = None, base: str | None = None, root: str | None = None) -> Mechanism:
    """The mechanism of a `pinocchio.Model`: bodies depth first, coordinates in the order of Pinocchio's v."""
    check_model(model, "from_pinocchio()")
    called = model.name or "robot"
    what = f"model {called!r}"
    if gravity is None and (angular := model.gravity.angular).any():
        raise JounceError(f"{what}: the gravity field has an angular part, {angular.tolist()}; expected zeros")
    bodies = moved_bodies(model)
    links, joints = [tree.Link(bodies[0], ZERO_INERTIA, what)], []
    for i, Y in enumerate(model.inertias[1:], start=1):
        chain = _chain(model, i, bodies, what)
        joints += chain
        links += [tree.Link(joint.child, ZERO_INERTIA, what) for joint in chain[:-1]]
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is refused as not finite
            links += [tree.Link(bodies[i], inertia_matrix(Y.mass, Y.lever, Y.inertia), what)]
    for frame in _other_frames(model, bodies):
        name, parent = frame.name, bodies[frame.parentJoint]
        links.append(tree.Link(name, ZERO_INERTIA, what))
        joints.append(_fixed_joint(f"frame {name}", parent, name, frame.placement.homogeneous, what))
    given = model.gravity.linear if gravity is None else gravity
    built = tree.build_mechanism(links, joints, given, called, what, base=base, root=root, world=bodies[0])
    free = [joint.idx_v + x.v for i, joint in enumerate(model.joints) if i for x in split_joint(joint, "") if x.kind]
    if base != "fixed" and any(model.armature[v].any() for v in free):
        of = "the free-flyer" if built.floats else "joints of several screws"
        warn(f"{what}: ignored, since not part of a tree of rigid bodies: armature of {of}")
    names = [name for joint in joints for name in joint.variables]
    order = [built.coordinates.index(name) for name in names if name in built.coordinates]
    return replace(built, G=built.G[:, order], coordinates=tuple(built.coordinates[j] for j in order))


def check_model(model: Any, what: str) -> None:
    """Raise `JounceError` unless an argument is a `pinocchio.Model` of numbers."""
    kind = type(model)
    if kind.__name__ != "Model" or not kind.__module__.startswith("pinocchio.pinocchio_pywrap_default"):
        raise JounceError(f"{what} expects a pinocchio.Model of numbers, got {kind.__module__}.{kind.__name__}")


def moved_bodies(model: Any) -> list[str]:
    """Return the names of the bodies that the joints move: of the first body on a joint, or else of the joint."""
    names = list(model.names)
    for frame in reversed(model.frames):
        if frame.type.name == "BODY" and frame.parentJoint and np.array_equal(frame.placement.homogeneous, np.eye(4)):
            names[frame.parentJoint] = frame.name
    return names


def _other_frames(model: Any, bodies: list[str]) -> list[Any]:
    """The other frames, the first of each name."""
    others = [
        frame
        for kind in NAMED_FRAME_TYPES
        for frame in model.frames
        if frame.type.name == kind and frame.name not in bodies
    ]
    names = [frame.name for frame in others]
    return [frame for i, frame in enumerate(others) if frame.name not in names[:i]]


def _chain(model: Any, i: int, bodies: list[str], what: str) -> list[tree.Joint]:
    """A joint of the model as a chain of joints of one screw each, some of several, or as one that stands still."""
    joint, parent, child = model.joints[i], bodies[model.parents[i]], bodies[i]
    placement = model.jointPlacements[i].homogeneous
    T, X = _evaluate_joint(model, joint, 0.0)
    mimic = None
    if joint.shortname() == "JointModelMimic" and X.any():
        follows = joint.extract()
        T, X = np.eye(4), X / follows.scaling
        mimic = tree.Mimic(_find_leader(model, joint.idx_v), follows.scaling, follows.offset)
    elif not X.any():
        return [_fixed_joint(model.names[i], parent, child, placement @ T, what)]
    elif not _is_chain(model, joint, T, X):
        raise JounceError(f"{what}: joint {model.names[i]!r} is a {joint.shortname()}, whose screws are not constant")
    parts = split_joint(joint, model.names[i]) or [JointPart(model.names[i], None, 0, 0)]  # a mimic's are its leader's
    links = [parent, *(part.name for part in parts[:-1]), child]
    return [
        tree.Joint(
            name=part.name,
            parent=links[k],
            child=links[k + 1],
            B=np.eye(4) if k else placement @ T,
            X=X[part.v],
            mimic=mimic,
            limits={} if mimic or part.kind else _limits(model, joint, part),
            drive={} if mimic or part.kind else _drive(model, joint.idx_v + int(part.v)),
            place=what,
            free=part.kind,
        )
        for k, part in enumerate(parts)
    ]


def _fixed_joint(name: str, parent: str, child: str, B: np.ndarray, what: str) -> tree.Joint:
    return tree.Joint(name, parent, child, B, X=None, mimic=None, limits={}, drive={}, place=what)


@dataclass(frozen=True, eq=False)
class JointPart:
    """What one joint here is of a joint of Pinocchio: alone, or one of those that it is composed of."""

    name: str
    kind: str | None  # of a joint of several screws
    q: Any  # where its numbers stand in those of the joint, an index or several
    v: Any  # and its velocities, in jounce's order
    turns: bool = False  # whether its q is a cosine and a sine


def split_joint(joint: Any, name: str) -> list[JointPart]:
    """The parts of a joint: its own name, numbered by the first coordinate where there are several."""
    found: list[JointPart] = []
    q = v = 0
    for part in list(joint.extract().joints) if joint.shortname() == "JointModelComposite" else [joint]:
        if (kind := part.shortname()) in FREE_JOINT_MODELS:
            free, at_zero, order = FREE_JOINT_MODELS[kind]
            found.append(JointPart(f"{name}_{v + 1}", free, q + np.arange(len(at_zero)), v + np.array(order)))
        elif part.nq == part.nv:
            found += [JointPart(f"{name}_{v + k + 1}", None, q + k, v + k) for k in range(part.nv)]
        elif (part.nq, part.nv) == (2, 1):
            found.append(JointPart(f"{name}_{v + 1}", None, q, v, turns=True))
        q, v = q + part.nq, v + part.nv
    return [replace(found[0], name=name)] if len(found) == 1 else found


def _find_leader(model: Any, v: int) -> str:
    """The name of the joint whose coordinate is at a place in v."""
    parts = [(joint.idx_v, x) for i, joint in enumerate(model.joints) if i for x in split_joint(joint, model.names[i])]
    return next(part.name for start, part in parts if v in start + np.atleast_1d(part.v))


def _evaluate_joint(model: Any, joint: Any, theta: float) -> tuple[np.ndarray, np.ndarray]:
    """The pose of a joint where all joint variables are theta, and its screws, (k, 6), in the moved frame."""
    q = np.concatenate([_configuration(each, np.full(each.nv, theta)) for each in list(model.joints)[1:] if each.nq])
    data = joint.createData()
    joint.calc(data, q)
    return data.M.homogeneous, np.reshape(data.S, (6, -1)).T[:, [3, 4, 5, 0, 1, 2]]


def _configuration(joint: Any, theta: np.ndarray) -> np.ndarray:
    """The coordinates of a joint at its variables: those without bounds are a cosine and a sine; free ones at zero."""
    kind = joint.shortname()
    if kind == "JointModelComposite":
        parts = list(joint.extract().joints)
        cut = np.split(theta, np.cumsum([part.nv for part in parts]))
        return np.concatenate([_configuration(part, x) for part, x in zip(parts, cut[:-1], strict=True)])
    if kind in FREE_JOINT_MODELS:
        return np.array(FREE_JOINT_MODELS[kind][1], dtype=float)
    return np.array([np.cos(theta[0]), np.sin(theta[0])]) if (joint.nq, joint.nv) == (2, 1) else theta


def _is_chain(model: Any, joint: Any, T: np.ndarray, X: np.ndarray) -> bool:
    """Whether the screws at zero make the pose elsewhere too; joints of several are at zero in both."""
    single = [X[part.v] for part in split_joint(joint, "") if not part.kind]
    product = reduce(np.matmul, [lie.exp(x, np.ones((1, 1))) for x in single], T)
    off = np.abs(_evaluate_joint(model, joint, 1.0)[0] - product)
    far = max(np.abs(x).max() for x in (product[:3, 3], X[:, 3:]))
    return bool(off[:3, :3].max() <= CHAIN_TOLERANCE and off[:3, 3].max() <= CHAIN_TOLERANCE * far)


def _limits(model: Any, joint: Any, part: JointPart) -> dict[str, float]:
    """The limits that are stated of a joint's coordinate; a cosine and a sine have none."""
    q, v = joint.idx_q + part.q, joint.idx_v + part.v
    found = {"velocity": model.velocityLimit[v], "effort": model.effortLimit[v]}
    if not part.turns:
        found |= {"lower": model.lowerPositionLimit[q], "upper": model.upperPositionLimit[q]}
    return {key: float(x) for key, x in found.items() if not abs(x) >= NO_LIMIT}  # NaN stays, and is refused


def _drive(model: Any, v: int) -> dict[str, float]:
    """The drive train at a place in v; the rotor, which Pinocchio itself leaves out, counts where no armature is."""
    rotor = model.rotorInertia[v] * model.rotorGearRatio[v] ** 2
    found = {"armature": model.armature[v] or rotor, "damping": model.damping[v], "friction": model.friction[v]}
    return {key: float(x) for key, x in found.items()}
