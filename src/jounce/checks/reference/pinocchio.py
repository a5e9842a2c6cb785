"""Pinocchio as a peer: its own reading of a URDF, or a model built joint by joint in the frames on the axes."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jounce.checks.reference import OTHER_JOINTS, OUR_DATA, OWN_READING, NotComparableError, Peer
from jounce.checks.reference.terminal import errors_caught
from jounce.errors import one_line
from jounce.model.equivalent import on_axes
from jounce.model.mechanism import Mechanism
from jounce.spatial import inertia
from jounce.spatial.lie import hat, position, rotation

NAME = "Pinocchio"
SUFFIX = ".urdf"  # of the files that it reads itself


def of_file(mechanism: Mechanism, path: Path) -> Peer:
    """The model of a URDF."""
    import pinocchio as pin

    said: list[str] = []
    try:
        with errors_caught(said):
            model = pin.buildModelFromUrdf(str(path), *([pin.JointModelFreeFlyer()] if mechanism.base else []))
    except Exception as error:
        reason = one_line(" ".join(said)) or one_line(error)
        raise NotComparableError(f"refuses the file: {reason}") from error
    first = 2 if mechanism.base else 1  # behind the universe, and behind the free flyer
    found = zip(list(model.names)[first:], list(model.joints)[first:], strict=True)
    names = {name for name, joint in found if joint.nv}
    if names != set(mechanism.joints):
        raise NotComparableError(OTHER_JOINTS)
    model.gravity.linear = mechanism.gravity
    return _peer(pin, mechanism, model, OWN_READING)


def of_data(mechanism: Mechanism) -> Peer:
    """The model of our data."""
    import pinocchio as pin

    return _peer(pin, mechanism, build_model(pin, mechanism), OUR_DATA)


def build_model(pin: Any, mechanism: Mechanism) -> Any:
    """Return the model of a mechanism's data, on a free flyer if it floats."""
    chain, model = on_axes(mechanism), pin.Model()
    model.gravity.linear = chain.gravity
    numbers = {-1: 0}
    if chain.base:
        numbers[-1] = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), chain.base.name)
        model.appendBodyToJoint(numbers[-1], _inertia(pin, chain.base.M), pin.SE3.Identity())
    for i in _depth_first(chain.parent):  # the order that its algorithms rely on
        B, X = chain.B[i], chain.X[i]
        kind = pin.JointModelPZ() if not X[2] else pin.JointModelHZ(float(X[5])) if X[5] else pin.JointModelRZ()
        placed = pin.SE3(rotation(B).astype(float), position(B)[:, 0].astype(float))
        numbers[i] = model.addJoint(numbers[chain.parent[i]], kind, placed, chain.joints[i])
        model.appendBodyToJoint(numbers[i], _inertia(pin, chain.M[i]), pin.SE3.Identity())
    return model


def _inertia(pin: Any, M: np.ndarray) -> Any:
    m, h, _ = inertia.moments(M)
    mass = float(m[0, 0])
    com = h[:, 0] / mass if mass else np.zeros(3)
    return pin.Inertia(mass, com, M[:3, :3] + mass * hat(com) @ hat(com))


def _depth_first(parent: Sequence[int], body: int = -1) -> Iterator[int]:
    for i, p in enumerate(parent):
        if p == body:
            yield i
            yield from _depth_first(parent, i)


def _peer(pin: Any, mechanism: Mechanism, model: Any, source: str) -> Peer:
    data = model.createData()
    of_base = [3, 4, 5, 0, 1, 2] if mechanism.base else []  # Pinocchio's twists are (linear; angular)
    rows = [*of_base, *(model.joints[model.getJointId(name)].idx_v for name in mechanism.joints)]

    def spread(x: np.ndarray, V: np.ndarray | None = None) -> np.ndarray:
        v = np.zeros(model.nv)
        v[rows] = np.concatenate([np.zeros(len(of_base)) if V is None else V, x])
        return v

    def placed(theta: np.ndarray, C: np.ndarray | None = None) -> np.ndarray:
        q = pin.integrate(model, pin.neutral(model), spread(theta))
        if C is not None:
            q[:7] = pin.SE3ToXYZQUAT(pin.SE3(C))
        return q

    def forces(theta: np.ndarray, rate: np.ndarray, second: np.ndarray, *base: np.ndarray) -> np.ndarray:
        C, V, Vd = base or (None, None, None)
        return pin.rnea(model, data, placed(theta, C), spread(rate, V), spread(second, Vd))[rows]

    def mass_matrix(theta: np.ndarray) -> np.ndarray:
        upper = np.triu(pin.crba(model, data, placed(theta)))
        return (upper + np.triu(upper, 1).T)[np.ix_(rows, rows)]

    return Peer(
        name=f"{NAME} {pin.__version__}",
        source=source,
        forces=forces,
        mass_matrix=mass_matrix,
    )
