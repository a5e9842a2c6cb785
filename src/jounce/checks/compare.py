"""Compares results at random states with other libraries, methods, and differentiation.

`compare` runs all comparisons. Errors are norm-wise: the largest difference over the largest entry of all states, or
over the magnitude of the terms that are added where it is larger, as where forces are zero.

Other libraries are `peers`: each has a `Peer` if it is installed, or an `Absence` with the reason. A library reads the
robot's file itself, Pinocchio a URDF and MuJoCo an MJCF file, or else its model is built from our data in the frames on
the joint axes. A `Converter` translates the vectors of a model by joint names, see `jounce.io.models.states`. A peer
takes joint variables, one state at a time.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from math import factorial
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

import numpy as np

from jounce.arguments import requests
from jounce.checks.magnitudes import magnitudes, scale
from jounce.core import errors
from jounce.core.errors import JounceError, warn
from jounce.dynamics.computation import Computation
from jounce.dynamics.loop_branches import scales
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES
from jounce.engine import generic_methods
from jounce.engine.engine import Engine, with_mechanism
from jounce.engine.plan import compute
from jounce.io.models import states
from jounce.io.models.mujoco_arrays import collect_mujoco_warnings, free_assets
from jounce.model import positions, screws
from jounce.model.equivalent_mechanisms import align_to_axes
from jounce.model.mechanism import Mechanism, single_variables
from jounce.spatial import groups, inertia, lie
from jounce.spatial.series import rate_name

# s: truncation falls with the step and rounding rises, so the best step counts.
_DIFFERENCE_STEPS = 0.2 * 2.0 ** -np.arange(9)
# Weights of the first derivative at nine even points, of order 8 (Fornberg 1988).
_DIFFERENCE_STENCIL = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
_STATE_SPREAD = 0.1  # rad or sizes of the robot, per s, per s^2, ...: states of closed robots stay near the start
MAX_COMPARISON_ERRORS = {"exact": 1e-9, "differences": 1e-6}  # relative; differences cannot show less
_BASE_CARRIER = Engine(screws.from_screws([np.eye(4)] * 6, np.roll(np.eye(6), 3, axis=0), np.zeros((6, 6, 6))))


@dataclass(frozen=True)
class ComparedQuantity:
    """The worst error of a quantity against another way to compute it.

    An error of None means that it is not compared; the remark is the reason.
    """

    quantity: str
    against: str
    error: float | None
    allowed: float
    remark: str = ""

    @property
    def passed(self) -> bool:
        """Whether the error is within rounding or differentiation."""
        return self.error is None or self.error <= self.allowed


def compare(
    robot: Engine, source: Path | None = None, *, order: int = 2, states: int = 20, seed: int = 0
) -> list[ComparedQuantity]:
    """Compare the results of a robot, without its drive terms.

    Other libraries read its file `source`, if there is one.
    """
    rigid, rng = with_mechanism(robot, replace(robot.mechanism, acting=())), np.random.default_rng(seed)
    m, q = rigid.mechanism, rng.uniform(-1, 1, (order + 3, states, robot.n))
    # States of closed robots stay near the start, where the loops can be closed.
    if m.closure:
        own_joints = list(m.closure.independent)
        q *= _STATE_SPREAD * scales(m).coordinates[own_joints]
        q[0] += m.closure.start[own_joints]
    random_motion = _Motion(q, rng.uniform(-1, 1, (order + 3, states, 6)) if m.floats else None)
    # The magnitudes of closed robots would be too large: squares add up where constraints are solved.
    force_magnitudes = random_motion.forces(rigid) if m.closure else _sizes(m, order, random_motion)
    return [
        *_compare_peers(rigid, source, random_motion),
        *_compare_methods(rigid, random_motion, force_magnitudes),
        *_compare_differences(rigid, random_motion, force_magnitudes),
    ]


def _sizes(m: Mechanism, order: int, x: "_Motion") -> Sequence[np.ndarray]:
    """Return the magnitudes of forces and their rates."""
    base = x.base(len(x.q))
    return magnitudes(m, Computation(DEFAULT_QUANTITY.name, order, base=base is not None), [*x.rates(m), *(base or ())])


@dataclass(frozen=True)
class _Motion:
    """Random rates of the coordinates and of a floating base.

    Six joints carry the base; `carrier` are their rates. A joint of several screws is carried likewise, by those of six
    joints whose screws it has.
    """

    q: np.ndarray
    carrier: np.ndarray | None

    def base(self, count: int) -> tuple[Any, ...] | None:
        """Return C, V, Vd, ... of a floating base, else None.

        There are as many terms as `count`.
        """
        return None if self.carrier is None else _carry_body(self.carrier[:count])

    def rates(self, m: Mechanism, count: int | None = None) -> list[np.ndarray]:
        """Return q, qd, ... of a robot, the first `count` or all."""
        q, *rates = self.q[:count].copy()
        q = q @ positions.single_positions(m)
        for x in positions.multiscrew_joints(m).values():
            # The six joints slide along x, y, z and then turn about them; screws are (angular; linear).
            six = np.zeros((*self.q[:count].shape[:-1], 6), dtype=self.q.dtype)
            six[..., (np.array(x.group.axes) + 3) % 6] = self.q[:count][..., x.coordinates]
            C, *twists = _carry_body(six)
            q[..., x.numbers] = x.group.numbers(C)
            for rate, V in zip(rates, twists, strict=True):
                rate[..., x.coordinates] = V[..., list(x.group.axes)]
        return [q, *rates]

    def forces(self, robot: Engine, count: int | None = None, **options: Any) -> tuple[Any, ...]:
        """Return Q and its rates from the first rates of the coordinates.

        By default all rates are used.
        """
        q = self.rates(robot.mechanism, count)
        return generic_methods.as_tuple(compute(robot, DEFAULT_QUANTITY.name, q, base=self.base(len(q)), **options))

    def map(self, f: Callable[[np.ndarray], np.ndarray]) -> "_Motion":
        """Return the motion with rates changed by a function."""
        return _Motion(f(self.q), None if self.carrier is None else f(self.carrier))


def _carry_body(rates: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return C, V, Vd, ... of a body on six joints."""
    C = compute(_BASE_CARRIER, "poses", [*rates[:1]], body="body6", method="recursion")
    twists = (
        generic_methods.as_tuple(compute(_BASE_CARRIER, "twists", [*rates], body="body6", method="recursion"))
        if len(rates) > 1
        else ()
    )
    return C, *twists


def _compare_peers(robot: Engine, source: Path | None, x: _Motion) -> Iterator[ComparedQuantity]:
    """Compare Q, gravity forces and M with each other library."""
    m, q = robot.mechanism, x.rates(robot.mechanism)
    if m.closure:
        reason = "loops are closed: other libraries would compute the forces of the tree"
        yield ComparedQuantity("-", "other libraries", None, 0.0, reason)
        return
    # Our results and their magnitudes, for all states at once.
    compared_rows = {row.gives.symbol: row for row in QUANTITIES.values() if row.gives.symbol in ("Q", "Qgrav", "M")}
    own_results, result_magnitudes = {}, {}
    for symbol, row in compared_rows.items():
        base = x.base(row.takes.rates) if requests.takes_base(row.name, "body") else None
        own_results[symbol] = compute(robot, row.name, [*q[: row.takes.rates]], base=base)
        computation = Computation(row.name, 0, base=base is not None)
        result_magnitudes[symbol] = magnitudes(m, computation, [*q[: row.takes.rates], *(base or ())])[0]
    # Peers have forces and masses of joint variables: G maps them to the coordinates, after the six of a base.
    first = m.nv - m.n
    G = np.eye(first + len(m.joints), m.nv)
    G[first:, first:] = m.G
    thetas = zip(*joint_rates(m, q[:3]), strict=True)
    base = x.base(3)
    states_of_peer = [(theta, base and tuple(term[i] for term in base)) for i, theta in enumerate(thetas)]
    at_rest = [
        ((theta, 0 * rate, 0 * rate), base and (base[0], *np.zeros((2, 6))))
        for (theta, rate, _), base in states_of_peer
    ]
    # Peers take one state at a time; gravity forces are those of the same states at rest.
    for peer in peers(m, source):
        if isinstance(peer, Absence):
            yield ComparedQuantity("-", peer.name, None, 0.0, peer.reason)
            continue
        peer_results = {
            "Q": [peer.forces(theta, base) @ G for theta, base in states_of_peer],
            "Qgrav": [peer.forces(theta, base) @ G for theta, base in at_rest],
            "M": [G.T @ peer.mass_matrix(theta, base and base[:1]) @ G for (theta, *_), base in states_of_peer],
        }
        for name, expected in peer_results.items():
            error = _error(own_results[name], np.stack(expected), result_magnitudes[name])
            yield ComparedQuantity(name, peer.name, error, MAX_COMPARISON_ERRORS["exact"], peer.source)


def _compare_methods(robot: Engine, x: _Motion, sizes: Sequence[np.ndarray]) -> Iterator[ComparedQuantity]:
    """Compare with every other method, and with extended precision.

    The latter is the recursion in long doubles.
    """
    default_results = x.forces(robot)
    paths: dict[str, Callable[[], Sequence[np.ndarray]]] = {
        "recursion": lambda: x.forces(robot, method="recursion"),
        "closed form": lambda: x.forces(robot, method="closed_form"),
        "long doubles": lambda: x.map(lambda q: q.astype(np.longdouble)).forces(robot, method="recursion"),
    }
    for name, results in paths.items():
        for k, (result, expected, size) in enumerate(zip(default_results, results(), sizes, strict=True)):
            yield ComparedQuantity(
                rate_name("Q", k), name, _error(result, expected, size), MAX_COMPARISON_ERRORS["exact"]
            )


def _compare_differences(robot: Engine, x: _Motion, sizes: Sequence[np.ndarray]) -> Iterator[ComparedQuantity]:
    """Compare each rate with differences of the lower rate.

    They are nine-point differences along the polynomials with the rates q.
    """
    # Of all steps the best one counts.
    exact = x.forces(robot)
    for k in range(1, len(exact)):
        errors = []
        for h in _DIFFERENCE_STEPS:
            shifted_forces = [x.map(partial(_shift, t=j * h)).forces(robot, k + 2)[-1] for j in range(-4, 5)]
            errors.append(_error(np.tensordot(_DIFFERENCE_STENCIL, shifted_forces, 1) / h, exact[k], sizes[k]))
        yield ComparedQuantity(
            rate_name("Q", k),
            f"differences of {rate_name('Q', k - 1)}",
            min(errors),
            MAX_COMPARISON_ERRORS["differences"],
        )


def _shift(q: np.ndarray, t: float) -> np.ndarray:
    """Return the rates q at a time t later."""
    return np.stack([sum(x * t**j / factorial(j) for j, x in enumerate(q[k:])) for k in range(len(q))])


def _error(result: Any, expected: Any, magnitude: np.ndarray) -> float:
    """Return the largest difference over the scale of a quantity."""
    return float(np.abs(result - expected).max()) / scale(expected, magnitude)


OWN_READING, OUR_DATA = "its own reading of the file", "our data"
OTHER_JOINTS = "joints differ from those of the file: some were locked, welded or left out"


class NotComparableError(JounceError):
    """A robot that another library cannot represent, with the reason."""


@dataclass(frozen=True)
class Peer:
    """A library's model of a mechanism in its joint variables theta (nc,).

    It takes one state at a time.
    """

    name: str
    source: str  # where the library has the robot's numbers from
    forces: Callable[[Sequence[np.ndarray], object], np.ndarray]  # (nc,), or (6 + nc,), of theta, rates and base
    mass_matrix: Callable[[np.ndarray, object], np.ndarray]  # as many rows and columns, of theta and base


def _use_joint_variables(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism whose coordinates are its joint variables."""
    nc = len(mechanism.joints)
    return replace(mechanism, G=np.eye(nc), g=np.zeros(nc), coordinates=mechanism.joints, elasticity=None)


def joint_rates(mechanism: Mechanism, rates: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the joint variables and their rates from the coordinates.

    Numbers of joints of several screws are included.
    """
    unreduced = _use_joint_variables(mechanism)
    # theta = G q + g where joints have one number; joints of several screws keep their numbers.
    theta = rates[0] @ (positions.single_positions(mechanism).T @ mechanism.G.T) + mechanism.g
    theta = theta @ positions.single_positions(unreduced)
    for i, x in positions.multiscrew_joints(mechanism).items():
        theta[..., positions.multiscrew_joints(unreduced)[i].numbers] = rates[0][..., x.numbers]
    return [theta, *(x @ mechanism.G.T for x in rates[1:])]


@dataclass(frozen=True)
class Converter:
    """Converts joint variables and forces to and from a library's vectors."""

    mechanism: Mechanism
    layout: states.ModelLayout

    @classmethod
    def match(cls, mechanism: Mechanism, layout: states.ModelLayout) -> "Converter":
        """Return the converter of a mechanism for a model.

        Raise `NotComparableError` unless the joints of both are the same.
        """
        multiscrew_names = {x.name for x in positions.multiscrew_joints(mechanism).values()}
        single_names = {mechanism.joints[j] for j in single_variables(mechanism).values()}
        if (
            set(layout.places) != single_names
            or len(layout.free) != len(multiscrew_names & set(layout.free)) + mechanism.floats
        ):
            raise NotComparableError(OTHER_JOINTS)
        return cls(_use_joint_variables(mechanism), layout)

    def state(self, theta: Sequence[np.ndarray], base: object) -> tuple[np.ndarray, ...]:
        """Return the vectors q, v, a of the model."""
        return states.state_to(self.mechanism, self.layout, theta, base)

    def forces(self, tau: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return the forces of the mechanism from forces of the model."""
        return states.forces_from(self.mechanism, self.layout, tau, q)

    def mass_matrix(self, M: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return the mass matrix of the mechanism from that of the model.

        Both sides of it transform as forces.
        """
        return self.forces(self.forces(M, q).T, q)


# Pinocchio: a URDF, or a model that is built joint by joint.
PINOCCHIO_NAME = "Pinocchio"
PINOCCHIO_SUFFIX = ".urdf"  # of the files that it reads itself


def read_pinocchio(mechanism: Mechanism, path: Path) -> Peer:
    """Read the model of a URDF in Pinocchio."""
    import pinocchio as pin

    if any(
        x.group is groups.PLANAR and not np.allclose(x.T[:3, :3], np.eye(3))
        for x in positions.multiscrew_joints(mechanism).values()
    ):
        raise NotComparableError("it takes z for the normal of planar joints, whatever their <axis>")
    messages: list[str] = []
    try:
        with _capture_errors(messages):
            model = pin.buildModelFromUrdf(str(path))
            # A URDF whose root is not floating by itself gets a free flyer.
            if mechanism.floats and not states.read_model_layout("pinocchio", model).free:
                model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    except Exception as error:
        reason = errors.one_line(" ".join(messages)) or errors.one_line(error)
        raise NotComparableError(f"refuses the file: {reason}") from error
    model.gravity.linear = mechanism.gravity
    return _pinocchio_peer(pin, mechanism, model, OWN_READING)


@contextmanager
def _capture_errors(messages: list[str]) -> Iterator[None]:
    """Append what foreign code writes to standard error to `messages`.

    It bypasses Python, and appears at the end of the context.
    """
    try:
        original_stderr = os.dup(2)
    except OSError:
        # Standard error is closed: there is nothing to capture.
        yield
        return
    with TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(original_stderr, 2)
            os.close(original_stderr)
            file.seek(0)
            messages.append(file.read().decode(errors="replace"))


def build_pinocchio(mechanism: Mechanism) -> Peer:
    """Build the model of our data in Pinocchio."""
    import pinocchio as pin

    return _pinocchio_peer(pin, mechanism, build_pinocchio_model(pin, mechanism), OUR_DATA)


def build_pinocchio_model(pin: Any, mechanism: Mechanism) -> Any:
    """Return the model of a mechanism's data.

    A floating mechanism is on a free flyer.
    """
    chain, model = align_to_axes(mechanism), pin.Model()
    model.gravity.linear = chain.gravity
    # The joint model and the name of the joint that moves each body, whose axis is z.
    joint_of_body = {0: (pin.JointModelFreeFlyer(), chain.bodies[0])} if chain.floats else {}
    multiscrew = positions.multiscrew_joints(chain)
    joint_models = {"ball": pin.JointModelSpherical, "planar": pin.JointModelPlanar, "free": pin.JointModelFreeFlyer}
    joint_of_body |= {i: (joint_models[x.group.name](), x.name) for i, x in multiscrew.items()}
    for i, X, name in zip(chain.owners, chain.X, chain.joints, strict=True):
        if i in multiscrew:
            continue
        revolute = pin.JointModelHZ(float(X[5])) if X[5] else pin.JointModelRZ()
        joint_of_body[i] = revolute if X[2] else pin.JointModelPZ(), name
    numbers = {-1: 0}
    # Pinocchio's algorithms rely on joints in depth-first order.
    for i in _depth_first(chain.parent):
        B, (kind, name) = chain.B[i], joint_of_body[i]
        placement = pin.SE3(lie.rotation(B).astype(float), lie.position(B)[:, 0].astype(float))
        numbers[i] = model.addJoint(numbers[chain.parent[i]], kind, placement, name)
        model.appendBodyToJoint(numbers[i], _inertia(pin, chain.M[i]), pin.SE3.Identity())
    return model


def _inertia(pin: Any, M: np.ndarray) -> Any:
    """Return an inertia of Pinocchio from our inertia matrix."""
    m, h, _ = inertia.moments(M)
    mass = float(m[0, 0])
    com = h[:, 0] / mass if mass else np.zeros(3)
    return pin.Inertia(mass, com, M[:3, :3] + mass * lie.hat(com) @ lie.hat(com))


def _depth_first(parent: Sequence[int], body: int = -1) -> Iterator[int]:
    """Yield bodies depth first."""
    for i, p in enumerate(parent):
        if p == body:
            yield i
            yield from _depth_first(parent, i)


def _pinocchio_peer(pin: Any, mechanism: Mechanism, model: Any, source: str) -> Peer:
    """Return the peer that computes with a model of Pinocchio."""
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
    """Read the model of an MJCF file in MuJoCo."""
    import mujoco

    # The warnings were passed on when the robot was read.
    with collect_mujoco_warnings(mujoco), free_assets(mujoco):
        model = mujoco.MjModel.from_xml_path(str(path))
    return _mujoco_peer(mujoco, mechanism, model, OWN_READING)


def build_mujoco(mechanism: Mechanism) -> Peer:
    """Build the model of our data in MuJoCo."""
    import mujoco

    return _mujoco_peer(mujoco, mechanism, _build_mujoco_model(mujoco, mechanism), OUR_DATA)


def _build_mujoco_model(mujoco: Any, mechanism: Mechanism) -> Any:
    """Return the compiled model of a mechanism's data."""
    # Compiling would refuse inertias that no body can have: bodies get placeholders, and their own inertias afterwards.
    chain, spec = align_to_axes(mechanism), mujoco.MjSpec()
    bodies: list[Any] = []
    for B, p in zip(chain.B, chain.parent, strict=True):
        body = (bodies[p] if p >= 0 else spec.worldbody).add_body(
            pos=lie.position(B)[:, 0].astype(float), quat=lie.to_quaternion(lie.rotation(B).astype(float))
        )
        body.mass, body.ipos, body.iquat, body.inertia = _PLACEHOLDER_INERTIA
        body.explicitinertial = True
        bodies.append(body)
    if chain.floats:
        bodies[0].name = chain.bodies[0]
        bodies[0].add_freejoint()
    multiscrew = positions.multiscrew_joints(chain)
    for i, x in multiscrew.items():
        is_on_ground = chain.parent[i] < 0 and np.array_equal(chain.B[i], np.eye(4))
        if x.group is not groups.BALL and not (x.group is groups.FREE and is_on_ground):
            missing_kind = (
                "free joints but at the world's origin" if x.group is groups.FREE else f"{x.group.name} joints"
            )
            raise NotComparableError(f"it has no {missing_kind}, as {x.name!r} is one")
        kind = mujoco.mjtJoint.mjJNT_BALL if x.group is groups.BALL else mujoco.mjtJoint.mjJNT_FREE
        bodies[i].add_joint(name=x.name, type=kind)
    for i, X, name in zip(chain.owners, chain.X, chain.joints, strict=True):
        if i in multiscrew:
            continue
        if X[2] and X[5]:
            raise NotComparableError(f"it has no helical joints, as {name!r} is one")
        kind = mujoco.mjtJoint.mjJNT_HINGE if X[2] else mujoco.mjtJoint.mjJNT_SLIDE
        bodies[i].add_joint(name=name, type=kind, axis=[0, 0, 1])
    model = spec.compile()
    for body, M in zip(bodies, chain.M, strict=True):
        i, (m, h, _) = body.id, inertia.moments(M)
        model.body_mass[i] = mass = float(m[0, 0])
        model.body_ipos[i] = com = h[:, 0] / mass if mass else np.zeros(3)
        moments, axes = np.linalg.eigh(M[:3, :3] + mass * lie.hat(com) @ lie.hat(com))
        model.body_inertia[i], model.body_iquat[i] = moments, lie.to_quaternion(axes * np.linalg.det(axes))
    # mj_setConst would set the masses of subtrees too, but it solves with M, which may be singular.
    model.body_subtreemass[:] = model.body_mass
    for i in reversed(range(1, model.nbody)):
        model.body_subtreemass[model.body_parentid[i]] += model.body_subtreemass[i]
    return model


def _mujoco_peer(mujoco: Any, mechanism: Mechanism, model: Any, source: str) -> Peer:
    """Return the peer that computes with a model of MuJoCo."""
    convert = Converter.match(mechanism, states.read_model_layout("mujoco", model))
    # Only rigid-body forces are compared: constraints, actuators, springs, dampers and rotors are switched off.
    for bit in ("CONSTRAINT", "ACTUATION", "SPRING", "DAMPER"):
        model.opt.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{bit}")
    model.opt.gravity[:] = mechanism.gravity
    # MuJoCo 3.3 has the first array only.
    for rotors in ("dof_armature", "actuator_armature"):
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
    with collect_mujoco_warnings(mujoco) as messages:
        function(model, data)
    for warning in messages:
        warn(f"{MUJOCO_NAME} warns: {errors.one_line(warning)}")


@dataclass(frozen=True)
class Absence:
    """The reason why a library takes no part in the comparison."""

    name: str
    reason: str


class Library(NamedTuple):
    """A library: its name, file suffix, reader and builder."""

    name: str
    suffix: str
    read: Callable[[Mechanism, Path], Peer]
    build: Callable[[Mechanism], Peer]


LIBRARIES = (
    Library(PINOCCHIO_NAME, PINOCCHIO_SUFFIX, read_pinocchio, build_pinocchio),
    Library(MUJOCO_NAME, MUJOCO_SUFFIX, read_mujoco, build_mujoco),
)


def peers(mechanism: Mechanism, path: Path | None) -> Iterator[Peer | Absence]:
    """Yield the models of the installed libraries.

    They are read from the file if possible, and otherwise built from the mechanism.
    """
    for library in LIBRARIES:
        ways = [partial(library.build, mechanism)]
        if path is not None and path.suffix.lower() == library.suffix:
            ways.insert(0, partial(library.read, mechanism, path))
        yield from _try_ways(library.name, ways)


def _try_ways(name: str, ways: Sequence[Callable[[], Peer]]) -> Iterator[Peer | Absence]:
    """Yield the first model of a library that can be made.

    The reasons why earlier ways failed come before it.
    """
    for way in ways:
        try:
            yield way()
        except ImportError:
            yield Absence(name, "not installed")
        except Exception as error:
            # Foreign libraries raise errors of any kind at robots that they cannot represent.
            yield Absence(name, errors.one_line(error))
            continue
        return
