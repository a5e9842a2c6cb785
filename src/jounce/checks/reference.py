"""Makes models of a robot in other libraries, to check it against at order 0.

`peers` is the door: of each library that is installed it yields a `Peer`, or an `Absence` with the reason. A library
reads the robot's file itself, Pinocchio a URDF and MuJoCo an MJCF file, or else its model is built of our data in the
frames on the joint axes. A `Converter` translates the vectors of a model by joint names, see `jounce.io.models.states`;
a peer takes joint variables, one state at a time.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

import numpy as np

from jounce.core.errors import JounceError, one_line, warn
from jounce.io.mjcf import collect_mujoco_warnings, free_assets
from jounce.io.models import states
from jounce.model.equivalent_mechanisms import align_to_axes
from jounce.model.mechanism import Mechanism, single_variables
from jounce.model.positions import multiscrew_joints, single_positions
from jounce.spatial import inertia
from jounce.spatial.groups import BALL, FREE, PLANAR
from jounce.spatial.lie import hat, position, rotation, to_quaternion

OWN_READING, OUR_DATA = "its own reading of the file", "our data"
OTHER_JOINTS = "joints differ from those of the file: some were locked, welded or left out"


class NotComparableError(JounceError):
    """A robot that another library cannot represent; the message says why."""


@dataclass(frozen=True)
class Peer:
    """A library's model of a mechanism in its joint variables theta (nc,), at one state of these and of the base."""

    name: str
    source: str  # where the library has the robot's numbers from
    forces: Callable[[Sequence[np.ndarray], object], np.ndarray]  # (nc,), or (6 + nc,), of theta, rates and base
    mass_matrix: Callable[[np.ndarray, object], np.ndarray]  # as many rows and columns, of theta and base


def _use_joint_variables(mechanism: Mechanism) -> Mechanism:
    """The mechanism whose coordinates are its joint variables."""
    nc = len(mechanism.joints)
    return replace(mechanism, G=np.eye(nc), g=np.zeros(nc), coordinates=mechanism.joints, elasticity=None)


def joint_rates(mechanism: Mechanism, rates: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The joint variables and their rates, numbers of joints of several screws included, of the coordinates."""
    free = _use_joint_variables(mechanism)
    theta = rates[0] @ (single_positions(mechanism).T @ mechanism.G.T) + mechanism.g
    theta = theta @ single_positions(free)
    for i, x in multiscrew_joints(mechanism).items():
        theta[..., multiscrew_joints(free)[i].numbers] = rates[0][..., x.numbers]
    return [theta, *(x @ mechanism.G.T for x in rates[1:])]


@dataclass(frozen=True)
class Converter:
    """Joint variables and forces of a mechanism from and to the vectors of a library's model."""

    mechanism: Mechanism
    layout: states.ModelLayout

    @classmethod
    def match(cls, mechanism: Mechanism, layout: states.ModelLayout) -> "Converter":
        """Raise `NotComparableError` unless the joints of the mechanism are those of the model."""
        several = {x.name for x in multiscrew_joints(mechanism).values()}
        single = {mechanism.joints[j] for j in single_variables(mechanism).values()}
        if set(layout.places) != single or len(layout.free) != len(several & set(layout.free)) + mechanism.floats:
            raise NotComparableError(OTHER_JOINTS)
        return cls(_use_joint_variables(mechanism), layout)

    def state(self, theta: Sequence[np.ndarray], base: object) -> tuple[np.ndarray, ...]:
        """The vectors q, v, a of the model."""
        return states.state_to(self.mechanism, self.layout, theta, base)

    def forces(self, tau: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The forces of the mechanism from those of the model at q."""
        return states.forces_from(self.mechanism, self.layout, tau, q)

    def mass_matrix(self, M: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The mass matrix of the mechanism from that of the model at q: both sides of it are forces."""
        return self.forces(self.forces(M, q).T, q)


# Pinocchio: a URDF, or a model that is built joint by joint.
PINOCCHIO_NAME = "Pinocchio"
PINOCCHIO_SUFFIX = ".urdf"  # of the files that it reads itself


def read_pinocchio(mechanism: Mechanism, path: Path) -> Peer:
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
    return _pinocchio_peer(pin, mechanism, model, OWN_READING)


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


def build_pinocchio(mechanism: Mechanism) -> Peer:
    """The model of our data."""
    import pinocchio as pin

    return _pinocchio_peer(pin, mechanism, build_pinocchio_model(pin, mechanism), OUR_DATA)


def build_pinocchio_model(pin: Any, mechanism: Mechanism) -> Any:
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


def _pinocchio_peer(pin: Any, mechanism: Mechanism, model: Any, source: str) -> Peer:
    data, convert = model.createData(), Converter.match(mechanism, states.read_model_layout("pinocchio", model))

    def forces(theta: Sequence[np.ndarray], base: object) -> np.ndarray:
        q, v, a = convert.state(theta, base)
        return convert.forces(pin.rnea(model, data, q, v, a), q)

    def mass_matrix(theta: np.ndarray, base: object) -> np.ndarray:
        [q] = convert.state([theta], base)
        upper = np.triu(pin.crba(model, data, q))
        return convert.mass_matrix(upper + np.triu(upper, 1).T, q)

    return Peer(f"{PINOCCHIO_NAME} {pin.__version__}", source, forces, mass_matrix)


# MuJoCo: an MJCF file, or a model that is built body by body.
MUJOCO_NAME = "MuJoCo"
MUJOCO_SUFFIX = ".xml"  # of the files that it reads itself
# Mass, COM, orientation and moments, without symmetries that MuJoCo could make use of.
_PLACEHOLDER_INERTIA = 1.0, [0.1, 0.2, 0.3], [0.5, -0.5, 0.1, 0.7], [0.2, 0.3, 0.4]


def read_mujoco(mechanism: Mechanism, path: Path) -> Peer:
    """The model of an MJCF file."""
    import mujoco

    with collect_mujoco_warnings(mujoco), free_assets(mujoco):  # the warnings were passed on when the robot was read
        model = mujoco.MjModel.from_xml_path(str(path))
    return _mujoco_peer(mujoco, mechanism, model, OWN_READING)


def build_mujoco(mechanism: Mechanism) -> Peer:
    """The model of our data."""
    import mujoco

    return _mujoco_peer(mujoco, mechanism, _build_mujoco_model(mujoco, mechanism), OUR_DATA)


def _build_mujoco_model(mujoco: Any, mechanism: Mechanism) -> Any:
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


def _mujoco_peer(mujoco: Any, mechanism: Mechanism, model: Any, source: str) -> Peer:
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

    return Peer(f"{MUJOCO_NAME} {mujoco.__version__}", source, forces, mass_matrix)


def _call(mujoco: Any, function: Callable[[Any, Any], None], model: Any, data: Any) -> None:
    """Call a function of MuJoCo, and pass its warnings on."""
    with collect_mujoco_warnings(mujoco) as said:
        function(model, data)
    for warning in said:
        warn(f"{MUJOCO_NAME} warns: {one_line(warning)}")


@dataclass(frozen=True)
class Absence:
    """The reason that a library takes no part in the comparison."""

    name: str
    reason: str


class Library(NamedTuple):
    """A library: its name, the suffix of files that it reads, and how it reads a file or takes our data."""

    name: str
    suffix: str
    read: Callable[[Mechanism, Path], Peer]
    build: Callable[[Mechanism], Peer]


LIBRARIES = (
    Library(PINOCCHIO_NAME, PINOCCHIO_SUFFIX, read_pinocchio, build_pinocchio),
    Library(MUJOCO_NAME, MUJOCO_SUFFIX, read_mujoco, build_mujoco),
)


def peers(mechanism: Mechanism, path: Path | None) -> Iterator[Peer | Absence]:
    """Return the installed libraries' models: read from the file where possible, otherwise built from the mechanism."""
    for library in LIBRARIES:
        ways = [partial(library.build, mechanism)]
        if path is not None and path.suffix.lower() == library.suffix:
            ways.insert(0, partial(library.read, mechanism, path))
        yield from _try_ways(library.name, ways)


def _try_ways(name: str, ways: Sequence[Callable[[], Peer]]) -> Iterator[Peer | Absence]:
    """Return the first model of a library that can be built, and the reasons that the earlier ways failed."""
    for way in ways:
        try:
            yield way()
        except ImportError:
            yield Absence(name, "not installed")
        except Exception as error:  # whatever a foreign library raises at a robot that it cannot hold
            yield Absence(name, one_line(error))
            continue
        return
