"""MuJoCo as a peer: its own reading of an MJCF file, or a model built body by body in the frames on the axes."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jounce.checks.reference.peer import OUR_DATA, OWN_READING, Converter, NotComparableError, Peer
from jounce.core.errors import one_line, warn
from jounce.io.mjcf import collect_mujoco_warnings, free_assets
from jounce.io.models import states
from jounce.model.equivalent_mechanisms import align_to_axes
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints
from jounce.spatial import inertia
from jounce.spatial.groups import BALL, FREE
from jounce.spatial.lie import hat, position, rotation, to_quaternion

NAME = "MuJoCo"
FILE_SUFFIX = ".xml"  # of the files that it reads itself
# Mass, COM, orientation and moments, without symmetries that MuJoCo could make use of.
_PLACEHOLDER_INERTIA = 1.0, [0.1, 0.2, 0.3], [0.5, -0.5, 0.1, 0.7], [0.2, 0.3, 0.4]


def read_peer(mechanism: Mechanism, path: Path) -> Peer:
    """The model of an MJCF file."""
    import mujoco

    with collect_mujoco_warnings(mujoco), free_assets(mujoco):  # the warnings were passed on when the robot was read
        model = mujoco.MjModel.from_xml_path(str(path))
    return _peer(mujoco, mechanism, model, OWN_READING)


def build_peer(mechanism: Mechanism) -> Peer:
    """The model of our data."""
    import mujoco

    return _peer(mujoco, mechanism, _build(mujoco, mechanism), OUR_DATA)


def _build(mujoco: Any, mechanism: Mechanism) -> Any:
    chain, spec = align_to_axes(mechanism), mujoco.MjSpec()
    bodies: list[Any] = []
    for B, p in zip(chain.B, chain.parent, strict=True):
        body = (bodies[p] if p >= 0 else spec.worldbody).add_body(
            pos=position(B)[:, 0].astype(float), quat=to_quaternion(rotation(B).astype(float))
        )
        body.mass, body.ipos, body.iquat, body.inertia = _PLACEHOLDER_INERTIA
        body.explicitinertial = True
        bodies.append(body)
    if chain.floats:
        bodies[0].name = chain.bodies[0]
        bodies[0].add_freejoint()
    several = multiscrew_joints(chain)
    for i, x in several.items():
        grounded = chain.parent[i] < 0 and np.array_equal(chain.B[i], np.eye(4))
        if x.group is not BALL and not (x.group is FREE and grounded):
            known = "free joints but at the world's origin" if x.group is FREE else f"{x.group.name} joints"
            raise NotComparableError(f"it has no {known}, as {x.name!r} is one")
        kind = mujoco.mjtJoint.mjJNT_BALL if x.group is BALL else mujoco.mjtJoint.mjJNT_FREE
        bodies[i].add_joint(name=x.name, type=kind)
    for i, X, name in zip(chain.owners, chain.X, chain.joints, strict=True):
        if i in several:
            continue
        if X[2] and X[5]:
            raise NotComparableError(f"it has no helical joints, as {name!r} is one")
        kind = mujoco.mjtJoint.mjJNT_HINGE if X[2] else mujoco.mjtJoint.mjJNT_SLIDE
        bodies[i].add_joint(name=name, type=kind, axis=[0, 0, 1])
    model = spec.compile()
    for body, M in zip(bodies, chain.M, strict=True):  # compiling would refuse what no distribution of mass has
        i, (m, h, _) = body.id, inertia.moments(M)
        model.body_mass[i] = mass = float(m[0, 0])
        model.body_ipos[i] = com = h[:, 0] / mass if mass else np.zeros(3)
        moments, axes = np.linalg.eigh(M[:3, :3] + mass * hat(com) @ hat(com))
        model.body_inertia[i], model.body_iquat[i] = moments, to_quaternion(axes * np.linalg.det(axes))
    model.body_subtreemass[:] = model.body_mass  # mj_setConst would solve with M too, which may be singular
    for i in reversed(range(1, model.nbody)):
        model.body_subtreemass[model.body_parentid[i]] += model.body_subtreemass[i]
    return model


def _peer(mujoco: Any, mechanism: Mechanism, model: Any, source: str) -> Peer:
    convert = Converter.match(mechanism, states.read_model_layout("mujoco", model))
    for bit in ("CONSTRAINT", "ACTUATION", "SPRING", "DAMPER"):
        model.opt.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{bit}")
    model.opt.gravity[:] = mechanism.gravity
    for rotors in ("dof_armature", "actuator_armature"):  # MuJoCo 3.3 has the first alone
        if hasattr(model, rotors):
            getattr(model, rotors)[:] = 0
    data = mujoco.MjData(model)

    def forces(theta: Sequence[np.ndarray], base: object) -> np.ndarray:
        data.qpos[:], data.qvel[:], data.qacc[:] = convert.state(theta, base)
        _call(mujoco, mujoco.mj_inverse, model, data)
        return convert.forces(data.qfrc_inverse, data.qpos)

    def mass_matrix(theta: np.ndarray, base: object) -> np.ndarray:
        [data.qpos[:]] = convert.state([theta], base)
        _call(mujoco, mujoco.mj_forward, model, data)
        M = np.empty((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        return convert.mass_matrix(M, data.qpos)

    return Peer(f"{NAME} {mujoco.__version__}", source, forces, mass_matrix)


def _call(mujoco: Any, function: Callable[[Any, Any], None], model: Any, data: Any) -> None:
    """Call a function of MuJoCo, and pass its warnings on."""
    with collect_mujoco_warnings(mujoco) as said:
        function(model, data)
    for warning in said:
        warn(f"{NAME} warns: {one_line(warning)}")
