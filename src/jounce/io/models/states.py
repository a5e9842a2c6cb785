"""Converts states and forces of a robot from and to the vectors of other libraries.

Joints are matched by name, and the base of a robot that floats is in the conventions of the library:

| | quaternion | linear velocity of the base | angular | acceleration |
|---|---|---|---|---|
| Pinocchio | x, y, z, w | base axes | base axes | rates of the components of v |
| MuJoCo | w, x, y, z | world axes | base axes | rates of the components of qvel |

A `ModelLayout` is where a model has the coordinates of its joints, once for a model; `match_joints` says which of these
joints a robot has. `state_from`, `state_to`, `forces_from` and `forces_to` convert by it, for batches of states.

Joints of one screw are copied. With nu = (w; u) the velocities of a joint of several screws here, those of a library
are the same numbers in another order; where it states linear quantities in world axes, they are A u with the rotation A
of the joint. ``a = v'``, and forces are such that powers are equal.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jounce.arguments.base import convert_base_motion, split_terms
from jounce.arguments.poses import POSE_TOLERANCE, worst_sample
from jounce.arguments.rates import convert_coordinates, convert_position, convert_rates
from jounce.core.errors import JounceError, check_choice, join_names, quote_value, unknown_name_error
from jounce.core.scalars import array_of_shape, broadcast, common_batch_shape, concatenate, is_numeric
from jounce.dynamics.quantities import QUANTITIES
from jounce.io.models.mujoco import FREE_JOINT_TYPE, moves_along_one_screw, read_arrays
from jounce.io.models.pinocchio import FREE_FLYER, check_model, moved_bodies, split_joint
from jounce.model import positions, tree
from jounce.model.mechanism import Mechanism
from jounce.spatial import groups
from jounce.spatial.groups import Group
from jounce.spatial.lie import Ad, inverse, rotation
from jounce.spatial.series import rate_name

BASE_FRAME_TYPES = ("BODY", "OP_FRAME", "SENSOR", "JOINT")  # frames that may be the base


@dataclass(frozen=True)
class JointPlace:
    """The index of a joint's coordinate in q and v; a joint that turns freely has a cosine and a sine in q."""

    q: int
    v: int
    turns: bool = False


@dataclass(frozen=True, eq=False)
class FreeJointPlace:
    """A joint of several screws: where jounce's numbers of it stand in q, and its velocities in v.

    Of one that may carry a base also where it stands on the ground, and the frames that it moves; T is the base's.
    """

    name: str
    group: Group
    q: np.ndarray
    v: np.ndarray
    in_world: bool = False  # linear velocity, acceleration and force are in world axes, otherwise in its own
    ground: np.ndarray = field(default_factory=lambda: np.eye(4))
    moved: Mapping[str, np.ndarray] = field(default_factory=dict)  # poses in its moved frame
    T: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class ModelLayout:
    """The vectors of a model: sizes, and joints by name."""

    what: str  # for messages
    labels: tuple[str, str, str, str]  # of position, velocity, acceleration and forces
    nq: int
    nv: int
    rest: np.ndarray  # q of joints that a robot does not have
    places: Mapping[str, JointPlace]
    free: Mapping[str, FreeJointPlace]
    carries: Mapping[str, frozenset[str]]  # bodies, frames and joints beyond each joint, of all kinds


@dataclass(frozen=True, eq=False)
class LayoutMatch:
    """The joints of a robot in a model: indices with their places, and those of several screws, that of a base first.

    Their numbers stand in a whole q of nq numbers, their velocities among nv.
    """

    nq: int
    joints: Mapping[int, JointPlace]
    several: Sequence[tuple[FreeJointPlace, slice, slice]]

    @property
    def in_world(self) -> bool:
        """Whether forces take the pose of a joint, as they are in world axes."""
        return any(joint.in_world for joint, *_ in self.several)


def match_joints(mechanism: Mechanism, layout: ModelLayout) -> LayoutMatch:
    """Return the joints of a robot in a model; raise unless all that move its bodies are joints of both."""
    if mechanism.closure:
        raise JounceError(
            f"{quote_value(mechanism.name)} has closed loops, {layout.what} has the joints of its tree; convert states"
            " of jounce.Robot(robot.mechanism.tree), whose q the closed robot takes as it is"
        )
    joints = {i: layout.places[name] for i, name in enumerate(mechanism.joints) if name in layout.places}
    own = positions.list_multiscrew_joints(mechanism)
    of_several = [name for x in own for name in mechanism.coordinates[x.coordinates]]
    for name in mechanism.coordinates:
        if name not in of_several and (name not in mechanism.joints or name not in layout.places):
            raise unknown_name_error("joint", name, layout.places, layout.what)
    for x in own:
        if layout.free.get(x.name) is None or layout.free[x.name].group is not x.group:
            kind = {name: None for name, joint in layout.free.items() if joint.group is x.group}
            raise unknown_name_error(f"{x.group.name} joint", x.name, kind, layout.what)
    base = _carrier_of_base(mechanism, layout) if mechanism.floats else None
    names = {*mechanism.joints, *(x.name for x in own)}
    known = {*mechanism.frame_names, *names}
    for name, carried in layout.carries.items():
        ours = name in names or (base is not None and layout.free.get(name) is base)
        if not ours and (moved := sorted(carried & known)):
            held = f"joint {quote_value(name)} moves {join_names(moved, most=3)}, which this robot holds"
            floats = "; load it with base='floating'" if name in layout.free and not mechanism.floats else ""
            raise JounceError(f"{layout.what}: {held}{floats or '; expected a model of the same joints'}")
    at, first = 7 * mechanism.floats, 6 * mechanism.floats
    carrier = [] if base is None else [(replace(base, T=base.moved[mechanism.bodies[0]]), slice(0, 7), slice(0, 6))]
    several = [(layout.free[x.name], _shift_slice(x.numbers, at), _shift_slice(x.coordinates, first)) for x in own]
    return LayoutMatch(positions.whole_count(mechanism), joints, carrier + several)


def _shift_slice(own: slice, count: int) -> slice:
    return slice(own.start + count, own.stop + count)


def _carrier_of_base(mechanism: Mechanism, layout: ModelLayout) -> FreeJointPlace:
    base = mechanism.bodies[0]
    for joint in layout.free.values():
        if base in joint.moved:
            return joint
    some = join_names(name for joint in layout.free.values() for name in joint.moved) or "none"
    came = f"no floating joint moves {quote_value(base)}, the base of {quote_value(mechanism.name)}"
    raise JounceError(f"{layout.what}: {came}; links on floating joints: {some}")


def read_mujoco_layout(model: Any) -> ModelLayout:
    """Where a MuJoCo model has its joints in qpos and qvel."""
    m = read_arrays(model, None, "model=")
    beyond = [{name} for name in m.bodies]
    for site, body in zip(m.sites, m["site_bodyid"], strict=True):
        beyond[body] |= {site} - {""}
    of_body = [m.joints[j : j + k] for j, k in zip(m["body_jntadr"], m["body_jntnum"], strict=True)]
    for i in reversed(range(1, len(m.bodies))):
        beyond[m["body_parentid"][i]] |= beyond[i] | {*of_body[i]}
    places: dict[str, JointPlace] = {}
    free: dict[str, FreeJointPlace] = {}
    carries: dict[str, frozenset[str]] = {}
    for i, names in enumerate(of_body):
        for j, name in enumerate(names, start=m["body_jntadr"][i]):
            q, v = int(m["jnt_qposadr"][j]), int(m["jnt_dofadr"][j])
            carries[name] = frozenset(beyond[i])
            if moves_along_one_screw(m, j):
                places[name] = JointPlace(q, v)
            elif m["jnt_type"][j] == FREE_JOINT_TYPE:
                at, rates = q + np.array([0, 1, 2, 4, 5, 6, 3]), v + np.array([3, 4, 5, 0, 1, 2])
                free[name] = FreeJointPlace(name, groups.FREE, at, rates, in_world=True, moved={m.bodies[i]: np.eye(4)})
            else:
                free[name] = FreeJointPlace(name, groups.BALL, q + np.array([1, 2, 3, 0]), v + np.arange(3))
    rest = np.array(m["qpos0"], dtype=float)
    sizes = len(rest), int(model.nv)
    return ModelLayout(m.place, ("qpos", "qvel", "qacc", "qfrc"), *sizes, rest, places, free, carries)


def read_pinocchio_layout(model: Any) -> ModelLayout:
    """Where a Pinocchio model has its joints in q and v."""
    check_model(model, "model=")
    joints, bodies = list(model.joints), moved_bodies(model)
    rest = np.zeros(model.nq)
    places: dict[str, JointPlace] = {}
    free: dict[str, FreeJointPlace] = {}
    beyond: list[set[str]] = [set() for _ in joints]
    own: list[list[str]] = [[] for _ in joints]
    for i, joint in enumerate(joints[1:], start=1):
        parts = split_joint(joint, model.names[i])
        own[i] = [part.name for part in parts] or [model.names[i]]
        for part in parts:
            q, v = joint.idx_q + part.q, joint.idx_v + part.v
            if part.kind is None:
                places[part.name] = JointPlace(q, v, part.turns)
                rest[q] = part.turns
                continue
            group, moved, ground = tree.FREE_JOINT_GROUPS[part.kind], {}, np.eye(4)
            rest[q] = group.resting
            if joint.shortname() == FREE_FLYER:
                moved = {f.name: f.placement.homogeneous for f in model.frames if f.parentJoint == i and _is_body(f)}
                moved, ground = moved | {bodies[i]: np.eye(4)}, model.jointPlacements[i].homogeneous
            free[part.name] = FreeJointPlace(part.name, group, q, v, ground=ground, moved=moved)
    for frame in model.frames:
        if _is_body(frame):
            beyond[frame.parentJoint].add(frame.name)
    for i in reversed(range(1, len(joints))):
        beyond[i] |= {bodies[i]}
        beyond[model.parents[i]] |= beyond[i] | {*own[i]}
    carries = {name: frozenset(beyond[i]) for i in range(1, len(joints)) for name in own[i] if joints[i].nv}
    what = f"model {model.name or 'robot'!r}"
    return ModelLayout(what, ("q", "v", "a", "tau"), model.nq, model.nv, rest, places, free, carries)


def _is_body(frame: Any) -> bool:
    return frame.type.name in BASE_FRAME_TYPES


# States and forces from and to vectors of a layout.
LAYOUTS = {"pinocchio": read_pinocchio_layout, "mujoco": read_mujoco_layout}  # of a model, by library
FOLLOWER_TOLERANCE = 1e-2  # rad or m: MuJoCo's constraints are soft, so that a joint leaves what it follows


@dataclass(frozen=True, eq=False)
class RobotState:
    """A state of a robot, to use as ``robot.inverse_dynamics(*state.rates, base=state.base)``.

    Attributes
    ----------
    q, qd, q2d : (..., nq), (..., n), or None
        Coordinates, velocities and accelerations in the order of `joint_names`; None where they were not given. Of
        balls, planar and free joints q has the numbers, qd and q2d the velocities and their rates.
    base : tuple of arrays, or None
        Pose C (..., 4, 4) of the base, its twist V (..., 6), (angular; linear) in its own axes, and the rate Vd of
        these components, as many as there are of q, qd and q2d; None if the robot does not float.
    Q : (..., nv), or None
        Generalized forces, the wrench on the base first if the robot floats; None where they were not given.

    Examples
    --------
    >>> import jounce, pinocchio
    >>> model = pinocchio.buildSampleModelHumanoid()
    >>> robot = jounce.Robot.from_pinocchio(model, base="floating")
    >>> v = a = [0.0] * model.nv
    >>> state = robot.state_from("pinocchio", pinocchio.neutral(model), v, a, model=model)
    >>> Q = robot.inverse_dynamics(*state.rates, base=state.base)
    >>> float(Q[5].round(6)) == round(9.81 * sum(body.mass for body in model.inertias), 6)  # its weight
    True
    """

    q: np.ndarray
    qd: np.ndarray | None
    q2d: np.ndarray | None
    base: tuple[np.ndarray, ...] | None
    Q: np.ndarray | None = None

    @property
    def rates(self) -> tuple[np.ndarray, ...]:
        """Those of q, qd, q2d that were given."""
        return tuple(x for x in (self.q, self.qd, self.q2d) if x is not None)


def read_model_layout(library: str, model: Any) -> ModelLayout:
    """Where a model of a library, by its name, has its joints."""
    return LAYOUTS[check_choice("library", library, LAYOUTS)](model)


def state_from(mechanism: Mechanism, layout: ModelLayout, given: Sequence[object], tau: object = None) -> RobotState:
    """The state of a robot from q, v, a of a library, and its forces where tau is given."""
    found, labels = match_joints(mechanism, layout), layout.labels
    count = max(k for k, term in enumerate(given) if term is not None or k == 0) + 1
    sizes = (layout.nq, layout.nv, layout.nv)
    terms = [_check_vector(layout, *item) for item in zip(given[:count], labels[:count], sizes[:count], strict=True)]
    terms = broadcast(terms, [1] * count, labels[:count])
    batch = terms[0].shape[:-1]
    theta = {i: _joint_variable(terms[0], place, mechanism.joints[i], labels[0]) for i, place in found.joints.items()}
    alone = np.zeros((*batch, mechanism.n))
    q, *rates = (np.zeros((*batch, n)) for n in (found.nq, mechanism.nv, mechanism.nv)[:count])
    at = 7 * mechanism.floats + positions.single_positions(mechanism).argmax(axis=1)
    for j, name in enumerate(mechanism.coordinates, first := mechanism.nv - mechanism.n):
        if name in layout.places:
            i = mechanism.joints.index(name)
            q[..., at[j - first]] = alone[..., j - first] = theta[i]
            for x, rate in zip(terms[1:], rates, strict=True):
                rate[..., j] = x[..., found.joints[i].v]
    for i, place in found.joints.items():
        _check_follower(mechanism, i, place, theta[i], alone, labels[0])
    for joint, own, coordinates in found.several:
        q[..., own], *moved = motion_from(joint, terms, labels[0])
        for rate, nu in zip(rates, moved, strict=True):
            rate[..., coordinates] = nu
    base = (groups.FREE.pose(q[..., :7]), *(x[..., :6] for x in rates)) if mechanism.floats else None
    qd, q2d = [*(x[..., first:] for x in rates), None, None][:2]
    Q = None if tau is None else forces_from(mechanism, layout, tau, terms[0])
    return RobotState(q[..., 7 * mechanism.floats :], qd, q2d, base, Q)


def state_to(
    mechanism: Mechanism, layout: ModelLayout, given: Sequence[object], base: object, Q: object = None
) -> tuple[np.ndarray, ...]:
    """The vectors q, v, a of a library, as many as rates of q are given, and its forces where Q is given."""
    alone = Q is not None and all(x is None for x in given)
    vectors = () if alone else _motion_to(mechanism, layout, given, base)
    q = given[0] if given else None
    return vectors if Q is None else (*vectors, forces_to(mechanism, layout, Q, split_terms(base)[:1] or None, q))


def _motion_to(
    mechanism: Mechanism, layout: ModelLayout, given: Sequence[object], base: object
) -> tuple[np.ndarray, ...]:
    """The vectors q, v, a of a library; joints that the robot lacks are at rest."""
    found = match_joints(mechanism, layout)
    rates = [_check_numbers(x, "q") for x in convert_rates(mechanism, given, QUANTITIES["poses"])]
    motion = _base_motion(mechanism, base, len(rates))
    labels = [*(rate_name("q", k) for k in range(len(rates))), *("C", "V", "Vd")[: len(motion)]]
    batch = common_batch_shape([*rates, *motion], [*(1 for _ in rates), 2, 1, 1][: len(labels)], labels)
    out = [np.tile(layout.rest, (*batch, 1)), *(np.zeros((*batch, layout.nv)) for _ in rates[1:])]
    for i, place in found.joints.items():
        angle = rates[0] @ (positions.single_positions(mechanism).T @ mechanism.G[i]) + mechanism.g[i]
        out[0][..., place.q] = np.cos(angle) if place.turns else angle
        if place.turns:
            out[0][..., place.q + 1] = np.sin(angle)
        for x, rate in zip(out[1:], rates[1:], strict=True):
            x[..., place.v] = rate @ mechanism.G[i]
    whole = _join_base(rates, motion)
    for joint, own, coordinates in found.several:
        put_motion(joint, [whole[0][..., own], *(rate[..., coordinates] for rate in whole[1:])], out)
    return tuple(out)


def _join_base(rates: Sequence[np.ndarray], motion: Sequence[np.ndarray]) -> list[np.ndarray]:
    """q, v, a with those of a base first, if it moves."""
    moved = [groups.FREE.numbers(motion[0]), *motion[1:]] if motion else [x[..., :0] for x in rates]
    return [concatenate(both, axis=-1) for both in zip(moved, rates, strict=False)]


def forces_from(mechanism: Mechanism, layout: ModelLayout, tau: object, q: object = None) -> np.ndarray:
    """The forces Q of a robot from those of a library; its q, where they are in world axes."""
    found, x = match_joints(mechanism, layout), _check_vector(layout, tau, layout.labels[3], layout.nv)
    if found.in_world:
        labels = (layout.labels[0], layout.labels[3])
        at, x = broadcast([_check_vector(layout, q, labels[0], layout.nq), x], [1, 1], labels)
    Q = np.zeros((*x.shape[:-1], mechanism.nv))
    Q[..., mechanism.nv - mechanism.n :] = x[..., [p.v for p in found.joints.values()]] @ mechanism.G[[*found.joints]]
    for joint, _, coordinates in found.several:
        p = motion_from(joint, [at], layout.labels[0])[0] if joint.in_world else None
        Q[..., coordinates] = force_from(joint, p, x)
    return Q


def forces_to(
    mechanism: Mechanism, layout: ModelLayout, Q: object, base: object = None, q: object = None
) -> np.ndarray:
    """The forces of a library from those of a robot; the pose of the base, or q, where they are in world axes."""
    found = match_joints(mechanism, layout)
    forces = _check_numbers(convert_coordinates(mechanism, Q, "Q", mechanism.nv), "Q")
    first = mechanism.nv - mechanism.n
    of_base = mechanism.floats and found.in_world
    motion = _base_motion(mechanism, base, 1) if of_base or base is not None else []
    behind = [joint.name for joint, _, coordinates in found.several if joint.in_world and coordinates.start >= first]
    if behind and q is None:
        raise JounceError(
            f"q is None; expected it, as {layout.what} has forces on {quote_value(behind[0])} in world axes"
        )
    own = _check_numbers(convert_position(mechanism, q), "q") if behind else np.zeros(positions.count(mechanism))
    whole, forces = broadcast([_join_base([own], motion)[0], forces], [1, 1], ["q", "Q"])
    tau = np.zeros((*forces.shape[:-1], layout.nv))
    for i, place in found.joints.items():
        if (name := mechanism.joints[i]) in mechanism.coordinates:
            tau[..., place.v] = forces[..., first + mechanism.coordinates.index(name)]
    for joint, numbers, coordinates in found.several:
        tau[..., joint.v] = force_to(joint, whole[..., numbers] if joint.in_world else None, forces[..., coordinates])
    return tau


def _check_vector(layout: ModelLayout, given: object, label: str, size: int) -> np.ndarray:
    if given is None:
        raise JounceError(f"{label} is None; expected an array (..., {size}) of {layout.what}")
    return _check_numbers(array_of_shape(given, (size,), label, f", as {layout.what} has it"), label)


def _check_numbers(x: object, label: str) -> np.ndarray:
    if not is_numeric(x):
        raise JounceError(f"{label} is of type {type(x).__name__} or holds symbols; expected NumPy arrays of numbers")
    return np.asarray(x, dtype=float)


def _joint_variable(q: np.ndarray, place: JointPlace, name: str, label: str) -> np.ndarray:
    """The joint variable that stands in q, or of its cosine and sine the angle from -pi to pi."""
    if not place.turns:
        return q[..., place.q]
    x = check_unit(q[..., place.q : place.q + 2], f"{label}: cosine and sine of joint {quote_value(name)}")
    return np.arctan2(x[..., 1], x[..., 0])


def _check_follower(
    mechanism: Mechanism, i: int, place: JointPlace, theta: np.ndarray, q: np.ndarray, label: str
) -> None:
    """Raise `JounceError` if a joint is not where those that it follows place it."""
    expected = q @ mechanism.G[i] + mechanism.g[i]
    off = np.abs(theta - expected)
    if place.turns:
        off = np.minimum(off % (2 * np.pi), -off % (2 * np.pi))
    if (off > FOLLOWER_TOLERANCE).any():
        at = np.unravel_index(np.nanargmax(off), off.shape)
        leaders = join_names(mechanism.coordinates[j] for j in np.flatnonzero(mechanism.G[i]))
        came = f"{label} has joint {quote_value(mechanism.joints[i])} at {theta[at]:.6g}; it follows {leaders}"
        raise JounceError(f"{came}, expected {expected[at]:.6g} within {FOLLOWER_TOLERANCE:g} rad or m")


def _base_motion(mechanism: Mechanism, base: object, count: int) -> list[np.ndarray]:
    """The motion C, V, Vd of the base, `count` of them; nothing of a robot that does not float."""
    if not mechanism.floats:
        if base is not None:
            raise JounceError(f"base is given, yet {mechanism.name!r} does not float; expected base=None")
        return []
    return [_check_numbers(x, "base") for x in convert_base_motion(mechanism, base, count, "this state")]


# A joint of several screws: its motion and forces in the axes of a library, and back.
def motion_from(joint: FreeJointPlace, terms: Sequence[np.ndarray], label: str) -> list[np.ndarray]:
    """The numbers p of a joint, nu and nu', as many as there are of q, v and a."""
    p = terms[0][..., joint.q]
    count = len(joint.group.places)
    what = "the quaternion" if p.shape[-1] - count == 4 else "cosine and sine"
    where = f"{label} of {quote_value(joint.name)}" if joint.T is None else label
    p = np.concatenate([p[..., :count], check_unit(p[..., count:], f"{where}: {what}")], axis=-1)
    rates = [_rotate_linear(joint, p, x[..., joint.v], back=True) for x in terms[1:]]
    rates = [*rates[:1], *(nu - _transport_acceleration(rates[0]) if joint.in_world else nu for nu in rates[1:])]
    if joint.T is None:
        return [p, *rates]
    return [
        groups.FREE.numbers(joint.ground @ groups.FREE.pose(p) @ joint.T),
        *(nu @ Ad(inverse(joint.T)).T for nu in rates),
    ]


def put_motion(joint: FreeJointPlace, motion: Sequence[np.ndarray], out: Sequence[np.ndarray]) -> None:
    """Write p, nu, nu' of a joint into q, v, a."""
    out[0][..., joint.q] = p = _joint_numbers(joint, motion[0])
    rates = motion[1:] if joint.T is None else [nu @ Ad(joint.T).T for nu in motion[1:]]
    for k, (nu, x) in enumerate(zip(rates, out[1:], strict=True)):
        x[..., joint.v] = _rotate_linear(
            joint, p, nu + _transport_acceleration(rates[0]) if k and joint.in_world else nu
        )


def _transport_acceleration(nu: np.ndarray) -> np.ndarray:
    """What the turning of its axes adds to the acceleration, (0; w x u)."""
    return np.concatenate([0 * nu[..., :3], np.cross(nu[..., :3], nu[..., 3:])], axis=-1)


def force_from(joint: FreeJointPlace, p: np.ndarray | None, tau: np.ndarray) -> np.ndarray:
    """The forces of a joint from those of a library; at p, where these are in world axes."""
    W = (
        tau[..., joint.v]
        if p is None
        else _rotate_linear(joint, _joint_numbers(joint, p), tau[..., joint.v], back=True)
    )
    return W if joint.T is None else np.asarray(W @ Ad(joint.T))


def force_to(joint: FreeJointPlace, p: np.ndarray | None, W: np.ndarray) -> np.ndarray:
    """The forces of a library from those of a joint."""
    W = W if joint.T is None else W @ Ad(inverse(joint.T))
    return W if p is None else _rotate_linear(joint, _joint_numbers(joint, p), W)


def _joint_numbers(joint: FreeJointPlace, p: np.ndarray) -> np.ndarray:
    """The numbers of the joint itself, of the link that it carries: w of quaternions is not negative."""
    C = joint.group.pose(p)
    return joint.group.numbers(C if joint.T is None else inverse(joint.ground) @ C @ inverse(joint.T))


def _rotate_linear(joint: FreeJointPlace, p: np.ndarray, x: np.ndarray, back: bool = False) -> np.ndarray:
    """Velocities or forces of a joint at p into the axes of its library, or back from them."""
    if not joint.in_world:
        return x
    A = rotation(joint.group.pose(p))
    linear = ((A.mT if back else A) @ x[..., 3:, None])[..., 0]
    return np.concatenate(np.broadcast_arrays(x[..., :3], linear), axis=-1)


def check_unit(x: np.ndarray, what: str) -> np.ndarray:
    """Return vectors (..., k) that are meant to have unit length, with unit length; NaN passes."""
    length = np.linalg.norm(x, axis=-1, keepdims=True)
    off = np.abs(length - 1)[..., 0]
    if (off > POSE_TOLERANCE).any():
        at, where = worst_sample(off)
        came = f"{what}{where} has norm {length[at][0]:.6g}"
        raise JounceError(f"{came}; expected 1 within {POSE_TOLERANCE:g}: normalize it")
    return np.asarray(x / length)
