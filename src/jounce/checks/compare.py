"""Compare a robot's results at random states with other libraries at order 0, other methods, and differentiation.

`compare` is the door. Errors are norm-wise: the largest difference over the largest entry of all the states, or over
the magnitude of what is added up where that is larger, as where forces are zero.

Other libraries are `peers`: of each one that is installed there is a `Peer`, or an `Absence` with the reason. A library
reads the robot's file itself, Pinocchio a URDF and MuJoCo an MJCF file, or else its model is built of our data in the
frames on the joint axes. A `Converter` translates the vectors of a model by joint names, see `jounce.io.models.states`;
a peer takes joint variables, one state at a time.
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
from jounce.io.models.mujoco import collect_mujoco_warnings, free_assets
from jounce.model import positions, screws
from jounce.model.equivalent_mechanisms import align_to_axes
from jounce.model.mechanism import Mechanism, single_variables
from jounce.spatial import groups, inertia, lie
from jounce.spatial.series import rate_name

_DIFFERENCE_STEPS = 0.2 * 2.0 ** -np.arange(9)  # s: the best one counts, as truncation falls and rounding rises
# Of the first derivative at nine even points, of order 8 (Fornberg 1988).
_DIFFERENCE_STENCIL = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
_STATE_SPREAD = 0.1  # rad or sizes of the robot, per s, per s^2, ...: states of closed robots stay near the start
MAX_COMPARISON_ERRORS = {"exact": 1e-9, "differences": 1e-6}  # relative; differences cannot show less
_BASE_CARRIER = Engine(screws.from_screws([np.eye(4)] * 6, np.roll(np.eye(6), 3, axis=0), np.zeros((6, 6, 6))))


@dataclass(frozen=True)
class ComparedQuantity:
    """The worst error of a quantity against another way to compute it, or the reason that it is not compared."""

    quantity: str
    against: str
    error: float | None
    allowed: float
    remark: str = ""

    @property
    def passed(self) -> bool:
        """Whether the error is one of rounding, or of differentiation where differences are compared."""
        return self.error is None or self.error <= self.allowed


def compare(
    robot: Engine, source: Path | None = None, *, order: int = 2, states: int = 20, seed: int = 0
) -> list[ComparedQuantity]:
    """Run the checks of a robot without drive terms; other libraries read its file `source`, if given."""
    rigid, rng = with_mechanism(robot, replace(robot.mechanism, acting=())), np.random.default_rng(seed)
    m, q = rigid.mechanism, rng.uniform(-1, 1, (order + 3, states, robot.n))
    if m.closure:
        own = list(m.closure.independent)
        q *= _STATE_SPREAD * scales(m).coordinates[own]
        q[0] += m.closure.start[own]
    x = _Motion(q, rng.uniform(-1, 1, (order + 3, states, 6)) if m.floats else None)
    sizes = x.forces(rigid) if m.closure else _sizes(m, order, x)  # squares outgrow what constraints are solved for
    return [
        *_compare_peers(rigid, source, x),
        *_compare_methods(rigid, x, sizes),
        *_compare_differences(rigid, x, sizes),
    ]


def _sizes(m: Mechanism, order: int, x: "_Motion") -> Sequence[np.ndarray]:
    """The magnitudes of forces and their rates."""
    base = x.base(len(x.q))
    return magnitudes(m, Computation(DEFAULT_QUANTITY.name, order, base=base is not None), [*x.rates(m), *(base or ())])


@dataclass(frozen=True)
class _Motion:
    """Rates of the coordinates, and of six joints that carry the base of a robot that floats.

    A joint of several screws is carried as a base is: by those of six joints whose screws it has.
    """

    q: np.ndarray
    carrier: np.ndarray | None

    def base(self, count: int) -> tuple[Any, ...] | None:
        """C, V, Vd, ... of the base, as many as there are rates of the coordinates; None if it does not float."""
        return None if self.carrier is None else _carry_body(self.carrier[:count])

    def rates(self, m: Mechanism, count: int | None = None) -> list[np.ndarray]:
        """q, qd, ... of a robot, as many as asked for, by default as there are rates of the coordinates."""
        q, *rates = self.q[:count].copy()
        q = q @ positions.single_positions(m)
        for x in positions.multiscrew_joints(m).values():
            six = np.zeros((*self.q[:count].shape[:-1], 6), dtype=self.q.dtype)
            six[..., (np.array(x.group.axes) + 3) % 6] = self.q[:count][..., x.coordinates]
            C, *twists = _carry_body(six)
            q[..., x.numbers] = x.group.numbers(C)
            for rate, V in zip(rates, twists, strict=True):
                rate[..., x.coordinates] = V[..., list(x.group.axes)]
        return [q, *rates]

    def forces(self, robot: Engine, count: int | None = None, **options: Any) -> tuple[Any, ...]:
        """Q and its rates from the first rates of the coordinates, by default from all of them."""
        q = self.rates(robot.mechanism, count)
        return generic_methods.as_tuple(compute(robot, DEFAULT_QUANTITY.name, q, base=self.base(len(q)), **options))

    def map(self, f: Callable[[np.ndarray], np.ndarray]) -> "_Motion":
        """The motion with other rates."""
        return _Motion(f(self.q), None if self.carrier is None else f(self.carrier))


def _carry_body(rates: np.ndarray) -> tuple[np.ndarray, ...]:
    """C, V, Vd, ... of a body on six joints with these rates."""
    C = compute(_BASE_CARRIER, "poses", [*rates[:1]], body="body6", method="recursion")
    more = (
        generic_methods.as_tuple(compute(_BASE_CARRIER, "twists", [*rates], body="body6", method="recursion"))
        if len(rates) > 1
        else ()
    )
    return C, *more


def _compare_peers(robot: Engine, source: Path | None, x: _Motion) -> Iterator[ComparedQuantity]:
    m, q = robot.mechanism, x.rates(robot.mechanism)
    if m.closure:
        yield ComparedQuantity(
            "-", "other libraries", None, 0.0, "loops are closed: these would compute the forces of the tree"
        )
        return
    known = {row.gives.symbol: row for row in QUANTITIES.values() if row.gives.symbol in ("Q", "Qgrav", "M")}
    ours, sizes = {}, {}
    for symbol, row in known.items():
        base = x.base(row.takes.rates) if requests.takes_base(row.name, "body") else None
        ours[symbol] = compute(robot, row.name, [*q[: row.takes.rates]], base=base)
        computation = Computation(row.name, 0, base=base is not None)
        sizes[symbol] = magnitudes(m, computation, [*q[: row.takes.rates], *(base or ())])[0]
    first = m.nv - m.n
    G = np.eye(first + len(m.joints), m.nv)
    G[first:, first:] = m.G
    thetas = zip(*joint_rates(m, q[:3]), strict=True)
    base = x.base(3)
    at = [(theta, base and tuple(term[i] for term in base)) for i, theta in enumerate(thetas)]
    at_rest = [((theta, 0 * rate, 0 * rate), base and (base[0], *np.zeros((2, 6)))) for (theta, rate, _), base in at]
    for peer in peers(m, source):
        if isinstance(peer, Absence):
            yield ComparedQuantity("-", peer.name, None, 0.0, peer.reason)
            continue
        theirs = {
            "Q": [peer.forces(theta, base) @ G for theta, base in at],
            "Qgrav": [peer.forces(theta, base) @ G for theta, base in at_rest],
            "M": [G.T @ peer.mass_matrix(theta, base and base[:1]) @ G for (theta, *_), base in at],
        }
        for name, expected in theirs.items():
            error = _error(ours[name], np.stack(expected), sizes[name])
            yield ComparedQuantity(name, peer.name, error, MAX_COMPARISON_ERRORS["exact"], peer.source)


def _compare_methods(robot: Engine, x: _Motion, sizes: Sequence[np.ndarray]) -> Iterator[ComparedQuantity]:
    """Compare with every other method, and with the recursion in extended precision."""
    own = x.forces(robot)
    paths: dict[str, Callable[[], Sequence[np.ndarray]]] = {
        "recursion": lambda: x.forces(robot, method="recursion"),
        "closed form": lambda: x.forces(robot, method="closed_form"),
        "long doubles": lambda: x.map(lambda q: q.astype(np.longdouble)).forces(robot, method="recursion"),
    }
    for name, results in paths.items():
        for k, (found, expected, size) in enumerate(zip(own, results(), sizes, strict=True)):
            yield ComparedQuantity(
                rate_name("Q", k), name, _error(found, expected, size), MAX_COMPARISON_ERRORS["exact"]
            )


def _compare_differences(robot: Engine, x: _Motion, sizes: Sequence[np.ndarray]) -> Iterator[ComparedQuantity]:
    """Compare each rate with nine-point differences of the lower one, along the polynomials that have the rates q."""
    exact = x.forces(robot)
    for k in range(1, len(exact)):
        errors = []
        for h in _DIFFERENCE_STEPS:
            along = [x.map(partial(_shift, t=j * h)).forces(robot, k + 2)[-1] for j in range(-4, 5)]
            errors.append(_error(np.tensordot(_DIFFERENCE_STENCIL, along, 1) / h, exact[k], sizes[k]))
        yield ComparedQuantity(
            rate_name("Q", k),
            f"differences of {rate_name('Q', k - 1)}",
            min(errors),
            MAX_COMPARISON_ERRORS["differences"],
        )


def _shift(q: np.ndarray, t: float) -> np.ndarray:
    """The rates q a time t later."""
    return np.stack([sum(x * t**j / factorial(j) for j, x in enumerate(q[k:])) for k in range(len(q))])


def _error(found: Any, expected: Any, magnitude: np.ndarray) -> float:
    return float(np.abs(found - expected).max()) / scale(expected, magnitude)


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
    theta = rates[0] @ (positions.single_positions(mechanism).T @ mechanism.G.T) + mechanism.g
    theta = theta @ positions.single_positions(free)
    for i, x in positions.multiscrew_joints(mechanism).items():
        theta[..., positions.multiscrew_joints(free)[i].numbers] = rates[0][..., x.numbers]
    return [theta, *(x @ mechanism.G.T for x in rates[1:])]


@dataclass(frozen=True)
class Converter:
    """Joint variables and forces of a mechanism from and to the vectors of a library's model."""

    mechanism: Mechanism
    layout: states.ModelLayout

    @classmethod
    def match(cls, mechanism: Mechanism, layout: states.ModelLayout) -> "Converter":
        """Raise `NotComparableError` unless the joints of the mechanism are those of the model."""
        several = {x.name for x in positions.multiscrew_joints(mechanism).values()}
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
        x.group is groups.PLANAR and not np.allclose(x.T[:3, :3], np.eye(3))
        for x in positions.multiscrew_joints(mechanism).values()
    ):
        raise NotComparableError("it takes z for the normal of planar joints, whatever their <axis>")
    said: list[str] = []
    try:
        with _capture_errors(said):
            model = pin.buildModelFromUrdf(str(path))
            if mechanism.floats and not states.read_model_layout("pinocchio", model).free:
                model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    except Exception as error:
        reason = errors.one_line(" ".join(said)) or errors.one_line(error)
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
    several = positions.multiscrew_joints(chain)
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
        placed = pin.SE3(lie.rotation(B).astype(float), lie.position(B)[:, 0].astype(float))
        numbers[i] = model.addJoint(numbers[chain.parent[i]], kind, placed, name)
        model.appendBodyToJoint(numbers[i], _inertia(pin, chain.M[i]), pin.SE3.Identity())
    return model


def _inertia(pin: Any, M: np.ndarray) -> Any:
    m, h, _ = inertia.moments(M)
    mass = float(m[0, 0])
    com = h[:, 0] / mass if mass else np.zeros(3)
    return pin.Inertia(mass, com, M[:3, :3] + mass * lie.hat(com) @ lie.hat(com))


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
            pos=lie.position(B)[:, 0].astype(float), quat=lie.to_quaternion(lie.rotation(B).astype(float))
        )
        body.mass, body.ipos, body.iquat, body.inertia = _PLACEHOLDER_INERTIA
        body.explicitinertial = True
        bodies.append(body)
    if chain.floats:
        bodies[0].name = chain.bodies[0]
        bodies[0].add_freejoint()
    several = positions.multiscrew_joints(chain)
    for i, x in several.items():
        grounded = chain.parent[i] < 0 and np.array_equal(chain.B[i], np.eye(4))
        if x.group is not groups.BALL and not (x.group is groups.FREE and grounded):
            known = "free joints but at the world's origin" if x.group is groups.FREE else f"{x.group.name} joints"
            raise NotComparableError(f"it has no {known}, as {x.name!r} is one")
        kind = mujoco.mjtJoint.mjJNT_BALL if x.group is groups.BALL else mujoco.mjtJoint.mjJNT_FREE
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
        moments, axes = np.linalg.eigh(M[:3, :3] + mass * lie.hat(com) @ lie.hat(com))
        model.body_inertia[i], model.body_iquat[i] = moments, lie.to_quaternion(axes * np.linalg.det(axes))
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
        warn(f"{MUJOCO_NAME} warns: {errors.one_line(warning)}")


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
            yield Absence(name, errors.one_line(error))
            continue
        return
