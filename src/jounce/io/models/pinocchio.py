"""Pinocchio's models, read by evaluating their joints at zero.

A joint has a pose M(q) in its parent's and a motion S(q) in the moved frame. Where its coordinates are angles and
lengths it is a chain of screws, ``M(q) = M(0) exp(X_1 q_1) ... exp(X_k q_k)``, and the X are the columns of S(0).
"""

from dataclasses import replace
from functools import reduce
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, warn
from jounce.model import tree
from jounce.model.mechanism import Mechanism
from jounce.spatial import lie
from jounce.spatial.inertia import inertia_matrix

FREE_FLYER = "JointModelFreeFlyer"
FREE_JOINTS = {  # what no chain of screws makes, and its coordinates at zero
    FREE_FLYER: ("floating", [0, 0, 0, 0, 0, 0, 1]),
    "JointModelPlanar": ("planar", [0, 0, 1, 0]),
    "JointModelSpherical": ("spherical", [0, 0, 0, 1]),
}
FRAMES = ("BODY", "OP_FRAME", "SENSOR")  # those whose names stay
MASSLESS = np.zeros((6, 6))
UNBOUNDED = np.finfo(float).max  # as Pinocchio says it


def mechanism(model: Any, gravity: object = None, base: str | None = None, root: str | None = None) -> Mechanism:
    """The mechanism of a `pinocchio.Model`: bodies depth first, coordinates in the order of Pinocchio's v."""
    check_model(model, "from_pinocchio()")
    called = model.name or "robot"
    what = f"model {called!r}"
    if gravity is None and model.gravity.angular.any():
        raise JounceError(
            f"{what}: the gravity field has an angular part, {model.gravity.angular.tolist()}; expected zeros"
        )
    bodies = moved_bodies(model)
    links, joints = [tree.Link(bodies[0], MASSLESS, what)], []
    for i, Y in enumerate(model.inertias[1:], start=1):
        chain = _chain(model, i, bodies, what)
        joints += chain
        links += [tree.Link(joint.child, MASSLESS, what) for joint in chain[:-1]]
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is refused as not finite
            links += [tree.Link(bodies[i], inertia_matrix(Y.mass, Y.lever, Y.inertia), what)]
    for name, frame in _frames(model, bodies).items():
        links.append(tree.Link(name, MASSLESS, what))
        joints.append(_fixed_joint(f"frame {name}", bodies[frame.parentJoint], name, frame.placement.homogeneous, what))
    given = model.gravity.linear if gravity is None else gravity
    built = tree.mechanism(links, joints, given, called, what, base=base, root=root, world=bodies[0])
    flyers = [joint for joint in model.joints if joint.shortname() == FREE_FLYER]
    if built.floats and any(model.armature[joint.idx_v : joint.idx_v + 6].any() for joint in flyers):
        warn(f"{what}: ignored, since not part of a tree of rigid bodies: armature of the free-flyer")
    order = [built.coordinates.index(joint.name) for joint in joints if joint.name in built.coordinates]
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


def _frames(model: Any, bodies: list[str]) -> dict[str, Any]:
    """The other frames by name, the first of each."""
    found: dict[str, Any] = {}
    for kind in FRAMES:
        for frame in model.frames:
            if frame.type.name == kind and frame.name not in bodies:
                found.setdefault(frame.name, frame)
    return found


def _chain(model: Any, i: int, bodies: list[str], what: str) -> list[tree.Joint]:
    """A joint of the model as a chain of joints of one screw each, or as one that is free or stands still."""
    joint, parent, child = model.joints[i], bodies[model.parents[i]], bodies[i]
    placement = model.jointPlacements[i].homogeneous
    T, X = _at(model, joint, 0.0)
    mimic = None
    if joint.shortname() == "JointModelMimic" and X.any():
        follows = joint.extract()
        T, X = np.eye(4), X / follows.scaling
        mimic = tree.Mimic(_leader(model, joint.idx_v), follows.scaling, follows.offset)
    elif not X.any() or not _is_chain(model, joint, T, X):
        kind = joint.shortname()
        free = None if not X.any() else FREE_JOINTS[kind][0] if kind in FREE_JOINTS else kind
        return [replace(_fixed_joint(model.names[i], parent, child, placement @ T, what), free=free)]
    names = coordinate_names(model, i)
    links = [parent, *names[:-1], child]
    return [
        tree.Joint(
            name=name,
            parent=links[k],
            child=links[k + 1],
            B=np.eye(4) if k else placement @ T,
            X=X[k],
            mimic=mimic,
            limits={} if mimic else _limits(model, joint, k),
            drive={} if mimic else _drive(model, joint.idx_v + k),
            place=what,
        )
        for k, name in enumerate(names)
    ]


def _fixed_joint(name: str, parent: str, child: str, B: np.ndarray, what: str) -> tree.Joint:
    return tree.Joint(name, parent, child, B, X=None, mimic=None, limits={}, drive={}, place=what)


def coordinate_names(model: Any, i: int) -> list[str]:
    """The names of a joint's coordinates: its own, numbered where there are several."""
    count, name = model.joints[i].nv, model.names[i]
    return [name] if count < 2 else [f"{name}_{k + 1}" for k in range(count)]


def _leader(model: Any, v: int) -> str:
    """The name of the coordinate at a place in v."""
    return [name for i, joint in enumerate(model.joints) if i and joint.nv for name in coordinate_names(model, i)][v]


def _at(model: Any, joint: Any, theta: float) -> tuple[np.ndarray, np.ndarray]:
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
    if kind in FREE_JOINTS:
        return np.array(FREE_JOINTS[kind][1], dtype=float)
    return np.array([np.cos(theta[0]), np.sin(theta[0])]) if (joint.nq, joint.nv) == (2, 1) else theta


def _is_chain(model: Any, joint: Any, T: np.ndarray, X: np.ndarray) -> bool:
    """Whether the screws at zero make the pose elsewhere too."""
    product = reduce(np.matmul, [lie.exp(x, np.ones((1, 1))) for x in X], T)
    return np.allclose(_at(model, joint, 1.0)[0], product, rtol=0, atol=1e-9)


def _limits(model: Any, joint: Any, k: int) -> dict[str, float]:
    """The limits that are stated of a joint's coordinate; a cosine and a sine have none."""
    q, v = joint.idx_q + k, joint.idx_v + k
    found = {"velocity": model.velocityLimit[v], "effort": model.effortLimit[v]}
    if joint.nq == joint.nv:
        found |= {"lower": model.lowerPositionLimit[q], "upper": model.upperPositionLimit[q]}
    return {key: float(x) for key, x in found.items() if not abs(x) >= UNBOUNDED}  # NaN stays, and is refused


def _drive(model: Any, v: int) -> dict[str, float]:
    """The drive train at a place in v; the rotor, which Pinocchio itself leaves out, counts where no armature is."""
    rotor = model.rotorInertia[v] * model.rotorGearRatio[v] ** 2
    found = {"armature": model.armature[v] or rotor, "damping": model.damping[v], "friction": model.friction[v]}
    return {key: float(x) for key, x in found.items()}
