"""Pinocchio as a peer: its own reading of a URDF, or a model built joint by joint in the frames on the axes."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np

from jounce.checks.reference.peer import OUR_DATA, OWN_READING, Converter, NotComparableError, Peer
from jounce.core.errors import one_line
from jounce.io.models import states
from jounce.model.equivalent_mechanisms import align_to_axes
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints
from jounce.spatial import inertia
from jounce.spatial.groups import PLANAR
from jounce.spatial.lie import hat, position, rotation

NAME = "Pinocchio"
FILE_SUFFIX = ".urdf"  # of the files that it reads itself


def read_peer(mechanism: Mechanism, path: Path) -> Peer:
    """The model of a URDF."""
    import pinocchio as pin

    if any(
        x.group is PLANAR and not np.allclose(x.T[:3, :3], np.eye(3)) for x in multiscrew_joints(mechanism).values()
    ):
        raise NotComparableError("it takes z for the normal of planar joints, whatever their <axis>")
    said: list[str] = []
    try:
        with _capture_errors(said):
            model = pin.buildModelFromUrdf(str(path))
            if mechanism.floats and not states.read_model_layout("pinocchio", model).free:
                model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    except Exception as error:
        reason = one_line(" ".join(said)) or one_line(error)
        raise NotComparableError(f"refuses the file: {reason}") from error
    model.gravity.linear = mechanism.gravity
    return _peer(pin, mechanism, model, OWN_READING)


@contextmanager
def _capture_errors(said: list[str]) -> Iterator[None]:
    """Append what foreign code writes directly to standard error, bypassing Python, to `said` at the end."""
    try:
        before = os.dup(2)
    except OSError:  # closed: nothing to keep it from
        yield
        return
    with TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(before, 2)
            os.close(before)
            file.seek(0)
            said.append(file.read().decode(errors="replace"))


def build_peer(mechanism: Mechanism) -> Peer:
    """The model of our data."""
    import pinocchio as pin

    return _peer(pin, mechanism, build_model(pin, mechanism), OUR_DATA)


def build_model(pin: Any, mechanism: Mechanism) -> Any:
    """Return the model of a mechanism's data, on a free flyer if it floats."""
    chain, model = align_to_axes(mechanism), pin.Model()
    model.gravity.linear = chain.gravity
    own = {0: (pin.JointModelFreeFlyer(), chain.bodies[0])} if chain.floats else {}  # of each body
    several = multiscrew_joints(chain)
    free = {"ball": pin.JointModelSpherical, "planar": pin.JointModelPlanar, "free": pin.JointModelFreeFlyer}
    own |= {i: (free[x.group.name](), x.name) for i, x in several.items()}
    for i, X, name in zip(chain.owners, chain.X, chain.joints, strict=True):
        if i in several:
            continue
        turning = pin.JointModelHZ(float(X[5])) if X[5] else pin.JointModelRZ()
        own[i] = turning if X[2] else pin.JointModelPZ(), name
    numbers = {-1: 0}
    for i in _depth_first(chain.parent):  # the order that its algorithms rely on
        B, (kind, name) = chain.B[i], own[i]
        placed = pin.SE3(rotation(B).astype(float), position(B)[:, 0].astype(float))
        numbers[i] = model.addJoint(numbers[chain.parent[i]], kind, placed, name)
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
    data, convert = model.createData(), Converter.match(mechanism, states.read_model_layout("pinocchio", model))

    def forces(theta: Sequence[np.ndarray], base: object) -> np.ndarray:
        q, v, a = convert.state(theta, base)
        return convert.forces(pin.rnea(model, data, q, v, a), q)

    def mass_matrix(theta: np.ndarray, base: object) -> np.ndarray:
        [q] = convert.state([theta], base)
        upper = np.triu(pin.crba(model, data, q))
        return convert.mass_matrix(upper + np.triu(upper, 1).T, q)

    return Peer(f"{NAME} {pin.__version__}", source, forces, mass_matrix)
