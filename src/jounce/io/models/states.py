"""Converts states and forces from and to vectors of other libraries.

Joints are matched by name, and the base of a robot that floats is in the conventions of the library:

| | quaternion | linear velocity of the base | angular | acceleration |
|---|---|---|---|---|
| Pinocchio | x, y, z, w | base axes | base axes | rates of the components of v |
| MuJoCo | w, x, y, z | world axes | base axes | rates of the components of qvel |

A `ModelLayout` says where a model has the coordinates of its joints; it is read once for a model. `match_joints` says
which of these joints a robot has. `state_from`, `state_to`, `forces_from` and `forces_to` convert by it, for batches of
states.

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
from jounce.io.models.mujoco_arrays import FREE_JOINT_TYPE, moves_along_one_screw, read_arrays
from jounce.io.models.pinocchio import FREE_FLYER, check_model, moved_bodies, split_joint
from jounce.model import positions, tree
from jounce.model.mechanism import Mechanism
from jounce.model.transmissions import with_followers
from jounce.spatial import groups
from jounce.spatial.groups import Group
from jounce.spatial.lie import Ad, inverse, rotation
from jounce.spatial.series import rate_name

BASE_FRAME_TYPES = ("BODY", "OP_FRAME", "SENSOR", "JOINT")  # frames that may be the base


@dataclass(frozen=True)
class JointPlace:
    """The index of a joint's coordinate in q and v."""

    q: int
    v: int
    turns: bool = False  # without bounds: q has a cosine and a sine


@dataclass(frozen=True, eq=False)
class FreeJointPlace:
    """A joint of several screws, with its places in q and v.

    `q` and `v` are where the numbers and velocities of jounce stand in those of the model. A joint that may carry a
    base has also its place on the ground, and the frames that it moves; T is the pose of the base in the moved frame.
    """

    name: str
    group: Group
    q: np.ndarray
    v: np.ndarray
    in_world: bool = False  # linear velocity, acceleration and force are in world axes, otherwise in its own
    ground: np.ndarray = field(default_factory=lambda: np.eye(4))
    moved: Mapping[str, np.ndarray] = field(default_factory=dict)  # poses of frames by name, in its moved frame
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
    """The joints of a robot in a model.

    `joints` are the places of joints by their index in the robot. `several` are the joints of several screws, that of a
    base first, with the slices of their numbers in a whole q of nq numbers, and of their velocities among nv.
    """

    nq: int
    joints: Mapping[int, JointPlace]
    several: Sequence[tuple[FreeJointPlace, slice, slice]]

    @property
    def in_world(self) -> bool:
        """Whether forces are in world axes, and so take a pose."""
        return any(joint.in_world for joint, *_ in self.several)


def _without_motors(mechanism: Mechanism) -> Mechanism:
    """Return a robot without loops as a tree with followers.

    A model does not have the motors that move its joints together.
    """
    has_motors_alone = len(mechanism.loops) == 0 and mechanism.has_constant_ratios
    return with_followers(mechanism) if has_motors_alone else mechanism


def match_joints(mechanism: Mechanism, layout: ModelLayout) -> LayoutMatch:
    """Return the joints of a robot in a model.

    Raises `JounceError` unless all joints that move its bodies are joints of both.
    """
    if mechanism.closure is not None:
        raise JounceError(
            f"{quote_value(mechanism.name)} has joints that follow others in loops or by polynomials, {layout.what} has"
            " those of its tree; convert states of jounce.Robot(robot.mechanism.tree), whose q the robot takes as it is"
        )
    # All joints of the robot are in the model, those of several screws with the same group.
    joints = {i: layout.places[name] for i, name in enumerate(mechanism.joints) if name in layout.places}
    multiscrew_joints = positions.list_multiscrew_joints(mechanism)
    multiscrew_coordinates = [name for x in multiscrew_joints for name in mechanism.coordinates[x.coordinates]]
    for name in mechanism.coordinates:
        is_single = name not in multiscrew_coordinates
        if is_single and (name not in mechanism.joints or name not in layout.places):
            raise unknown_name_error("joint", name, layout.places, layout.what)
    for x in multiscrew_joints:
        if layout.free.get(x.name) is None or layout.free[x.name].group is not x.group:
            names_of_group = {name: None for name, joint in layout.free.items() if joint.group is x.group}
            raise unknown_name_error(f"{x.group.name} joint", x.name, names_of_group, layout.what)
    # No other joint of the model moves what the robot has: its bodies would be elsewhere.
    base = _carrier_of_base(mechanism, layout) if mechanism.floats else None
    joint_names = {*mechanism.joints, *(x.name for x in multiscrew_joints)}
    names = {*mechanism.frame_names, *joint_names}
    for name, carried_names in layout.carries.items():
        is_of_robot = name in joint_names or (base is not None and layout.free.get(name) is base)
        moved_names = sorted(carried_names & names)
        if not is_of_robot and len(moved_names) > 0:
            came = f"joint {quote_value(name)} moves {join_names(moved_names, most=3)}, which this robot holds"
            is_base = name in layout.free and not mechanism.floats
            cure = "load it with base='floating'" if is_base else "expected a model of the same joints"
            raise JounceError(f"{layout.what}: {came}; {cure}")
    # In whole vectors seven numbers and six velocities of a base stand before those of the joints.
    base_numbers, base_velocities = 7 * mechanism.floats, 6 * mechanism.floats
    several = []
    if base is not None:
        several.append((replace(base, T=base.moved[mechanism.bodies[0]]), slice(0, 7), slice(0, 6)))
    for x in multiscrew_joints:
        numbers = _shift_slice(x.numbers, base_numbers)
        several.append((layout.free[x.name], numbers, _shift_slice(x.coordinates, base_velocities)))
    return LayoutMatch(positions.whole_count(mechanism), joints, several)


def _shift_slice(part: slice, count: int) -> slice:
    return slice(part.start + count, part.stop + count)


def _carrier_of_base(mechanism: Mechanism, layout: ModelLayout) -> FreeJointPlace:
    """Return the floating joint of a model that moves the base."""
    base = mechanism.bodies[0]
    for joint in layout.free.values():
        if base in joint.moved:
            return joint
    linked_names = join_names(name for joint in layout.free.values() for name in joint.moved) or "none"
    came = f"no floating joint moves {quote_value(base)}, the base of {quote_value(mechanism.name)}"
    raise JounceError(f"{layout.what}: {came}; links on floating joints: {linked_names}")


def read_mujoco_layout(model: Any) -> ModelLayout:
    """Return where a MuJoCo model has its joints in qpos and qvel."""
    m = read_arrays(model, None, "model=")
    # What moves with each body: itself, its sites, and from the leaves on its children with their joints.
    names_on_body = [{name} for name in m.bodies]
    for site, body in zip(m.sites, m["site_bodyid"], strict=True):
        names_on_body[body] |= {site} - {""}
    joints_of_body = [m.joints[j : j + k] for j, k in zip(m["body_jntadr"], m["body_jntnum"], strict=True)]
    for i in reversed(range(1, len(m.bodies))):
        names_on_body[m["body_parentid"][i]] |= names_on_body[i] | {*joints_of_body[i]}
    places: dict[str, JointPlace] = {}
    free: dict[str, FreeJointPlace] = {}
    carries: dict[str, frozenset[str]] = {}
    for i, names in enumerate(joints_of_body):
        for j, name in enumerate(names, start=m["body_jntadr"][i]):
            q, v = int(m["jnt_qposadr"][j]), int(m["jnt_dofadr"][j])
            carries[name] = frozenset(names_on_body[i])
            if moves_along_one_screw(m, j):
                places[name] = JointPlace(q, v)
            elif m["jnt_type"][j] == FREE_JOINT_TYPE:
                # MuJoCo has w first in quaternions, and the linear velocity before the angular one.
                numbers, velocities = q + np.array([0, 1, 2, 4, 5, 6, 3]), v + np.array([3, 4, 5, 0, 1, 2])
                body_poses = {m.bodies[i]: np.eye(4)}
                free[name] = FreeJointPlace(name, groups.FREE, numbers, velocities, in_world=True, moved=body_poses)
            else:
                free[name] = FreeJointPlace(name, groups.BALL, q + np.array([1, 2, 3, 0]), v + np.arange(3))
    resting_q = np.array(m["qpos0"], dtype=float)
    sizes = len(resting_q), int(model.nv)
    return ModelLayout(m.place, ("qpos", "qvel", "qacc", "qfrc"), *sizes, resting_q, places, free, carries)


def read_pinocchio_layout(model: Any) -> ModelLayout:
    """Return where a Pinocchio model has its joints in q and v."""
    check_model(model, "model=")
    joints, bodies = list(model.joints), moved_bodies(model)
    resting_q = np.zeros(model.nq)
    places: dict[str, JointPlace] = {}
    free: dict[str, FreeJointPlace] = {}
    names_on_joint: list[set[str]] = [set() for _ in joints]
    part_names: list[list[str]] = [[] for _ in joints]
    for i, joint in enumerate(joints[1:], start=1):
        # A joint without parts follows another one, and has no coordinates.
        parts = split_joint(joint, model.names[i])
        part_names[i] = [part.name for part in parts] if len(parts) > 0 else [model.names[i]]
        for part in parts:
            q, v = joint.idx_q + part.q, joint.idx_v + part.v
            if part.kind is None:
                places[part.name] = JointPlace(q, v, part.turns)
                resting_q[q] = part.turns
                continue
            group, frame_poses, ground = tree.FREE_JOINT_GROUPS[part.kind], {}, np.eye(4)
            resting_q[q] = group.resting
            # A free-flyer may carry the base, which may be any of the frames that it moves.
            if joint.shortname() == FREE_FLYER:
                frame_poses = {
                    f.name: f.placement.homogeneous for f in model.frames if f.parentJoint == i and _is_body(f)
                }
                frame_poses, ground = frame_poses | {bodies[i]: np.eye(4)}, model.jointPlacements[i].homogeneous
            free[part.name] = FreeJointPlace(part.name, group, q, v, ground=ground, moved=frame_poses)
    # What moves with each joint: its body and frames, and from the leaves on the joints that it carries.
    for frame in model.frames:
        if _is_body(frame):
            names_on_joint[frame.parentJoint].add(frame.name)
    for i in reversed(range(1, len(joints))):
        names_on_joint[i] |= {bodies[i]}
        names_on_joint[model.parents[i]] |= names_on_joint[i] | {*part_names[i]}
    carries: dict[str, frozenset[str]] = {}
    for i, joint in enumerate(joints[1:], start=1):
        if joint.nv > 0:
            carries |= dict.fromkeys(part_names[i], frozenset(names_on_joint[i]))
    what = f"model {model.name or 'robot'!r}"
    return ModelLayout(what, ("q", "v", "a", "tau"), model.nq, model.nv, resting_q, places, free, carries)


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
        """The rates q, qd, q2d that were given."""
        return tuple(x for x in (self.q, self.qd, self.q2d) if x is not None)


def read_model_layout(library: str, model: Any) -> ModelLayout:
    """Return where a model has its joints; `library` names its kind."""
    return LAYOUTS[check_choice("library", library, LAYOUTS)](model)


def state_from(mechanism: Mechanism, layout: ModelLayout, vectors: Sequence[object], tau: object = None) -> RobotState:
    """Return the state of a robot from a library's q, v, a.

    It has forces where tau is given.
    """
    mechanism = _without_motors(mechanism)
    match, labels = match_joints(mechanism, layout), layout.labels
    # q, and v and a as far as they are given: (..., nq), (..., nv), (..., nv) of the model, broadcast.
    count = max(k for k, term in enumerate(vectors) if term is not None or k == 0) + 1
    sizes = (layout.nq, layout.nv, layout.nv)
    terms = [_check_vector(layout, *item) for item in zip(vectors[:count], labels[:count], sizes[:count], strict=True)]
    terms = broadcast(terms, [1] * count, labels[:count])
    batch = terms[0].shape[:-1]
    theta = {i: _joint_variable(terms[0], place, mechanism.joints[i], labels[0]) for i, place in match.joints.items()}
    # Whole vectors of the robot, its base first: q (..., nq), qd and q2d (..., nv). `single` (..., n) has the
    # coordinates of joints of one screw.
    single = np.zeros((*batch, mechanism.n))
    q, *rates = (np.zeros((*batch, n)) for n in (match.nq, mechanism.nv, mechanism.nv)[:count])
    base_count = mechanism.nv - mechanism.n
    places_in_q = 7 * mechanism.floats + positions.single_positions(mechanism).argmax(axis=1)
    for j, name in enumerate(mechanism.coordinates):
        if name in layout.places:
            i = mechanism.joints.index(name)
            q[..., places_in_q[j]] = single[..., j] = theta[i]
            for x, rate in zip(terms[1:], rates, strict=True):
                rate[..., base_count + j] = x[..., match.joints[i].v]
    for i, place in match.joints.items():
        _check_follower(mechanism, i, place, theta[i], single, labels[0])
    for joint, numbers, coordinates in match.several:
        q[..., numbers], *velocities = motion_from(joint, terms, labels[0])
        for rate, nu in zip(rates, velocities, strict=True):
            rate[..., coordinates] = nu
    # The base is separated from the joints behind it.
    base = (groups.FREE.pose(q[..., :7]), *(x[..., :6] for x in rates)) if mechanism.floats else None
    qd, q2d = [*(x[..., base_count:] for x in rates), None, None][:2]
    Q = None if tau is None else forces_from(mechanism, layout, tau, terms[0])
    return RobotState(q[..., 7 * mechanism.floats :], qd, q2d, base, Q)


def state_to(
    mechanism: Mechanism, layout: ModelLayout, state_rates: Sequence[object], base: object, Q: object = None
) -> tuple[np.ndarray, ...]:
    """Return the vectors q, v, a of a library.

    They are as many as rates of q are given; forces follow where Q is given.
    """
    mechanism = _without_motors(mechanism)
    are_forces_alone = Q is not None and all(x is None for x in state_rates)
    vectors = () if are_forces_alone else _motion_to(mechanism, layout, state_rates, base)
    if Q is None:
        return vectors
    # Forces may take the pose of the base and q, but no velocities.
    q = state_rates[0] if len(state_rates) > 0 else None
    base_terms = split_terms(base)
    base_pose = base_terms[:1] if len(base_terms) > 0 else None
    return (*vectors, forces_to(mechanism, layout, Q, base_pose, q))


def _motion_to(
    mechanism: Mechanism, layout: ModelLayout, state_rates: Sequence[object], base: object
) -> tuple[np.ndarray, ...]:
    """Return the vectors q, v, a of a library.

    Joints that the robot lacks are at rest.
    """
    match = match_joints(mechanism, layout)
    rates = [_check_numbers(x, "q") for x in convert_rates(mechanism, state_rates, QUANTITIES["poses"])]
    motion = _base_motion(mechanism, base, len(rates))
    labels = [*(rate_name("q", k) for k in range(len(rates))), *("C", "V", "Vd")[: len(motion)]]
    batch = common_batch_shape([*rates, *motion], [*(1 for _ in rates), 2, 1, 1][: len(labels)], labels)
    # (..., nq), (..., nv), (..., nv) of the model; joint variables are theta = G q + g.
    vectors = [np.tile(layout.rest, (*batch, 1)), *(np.zeros((*batch, layout.nv)) for _ in rates[1:])]
    for i, place in match.joints.items():
        angle = rates[0] @ (positions.single_positions(mechanism).T @ mechanism.G[i]) + mechanism.g[i]
        vectors[0][..., place.q] = np.cos(angle) if place.turns else angle
        if place.turns:
            vectors[0][..., place.q + 1] = np.sin(angle)
        for x, rate in zip(vectors[1:], rates[1:], strict=True):
            x[..., place.v] = rate @ mechanism.G[i]
    whole = _join_base(rates, motion)
    for joint, numbers, coordinates in match.several:
        put_motion(joint, [whole[0][..., numbers], *(rate[..., coordinates] for rate in whole[1:])], vectors)
    return tuple(vectors)


def _join_base(rates: Sequence[np.ndarray], motion: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return q, v, a, beginning with those of a base."""
    # Without a base nothing stands before the joints: (..., 0).
    base_terms = [x[..., :0] for x in rates]
    if len(motion) > 0:
        base_terms = [groups.FREE.numbers(motion[0]), *motion[1:]]
    return [concatenate(pair, axis=-1) for pair in zip(base_terms, rates, strict=False)]


def forces_from(mechanism: Mechanism, layout: ModelLayout, tau: object, q: object = None) -> np.ndarray:
    """Return the forces Q of a robot from a library's forces.

    `q` is the q of the library, which is taken where forces are in world axes.
    """
    match, x = match_joints(mechanism, layout), _check_vector(layout, tau, layout.labels[3], layout.nv)
    if match.in_world:
        labels = (layout.labels[0], layout.labels[3])
        q_of_model, x = broadcast([_check_vector(layout, q, labels[0], layout.nq), x], [1, 1], labels)
    # Q = G^T tau of joints of one screw, (..., nv) of the model -> (..., n).
    Q = np.zeros((*x.shape[:-1], mechanism.nv))
    Q[..., mechanism.nv - mechanism.n :] = x[..., [p.v for p in match.joints.values()]] @ mechanism.G[[*match.joints]]
    for joint, _, coordinates in match.several:
        p = motion_from(joint, [q_of_model], layout.labels[0])[0] if joint.in_world else None
        Q[..., coordinates] = force_from(joint, p, x)
    return Q


def forces_to(
    mechanism: Mechanism, layout: ModelLayout, Q: object, base: object = None, q: object = None
) -> np.ndarray:
    """Return the forces of a library from a robot's forces Q.

    The pose of the base, or q, is taken where the forces of the library are in world axes.
    """
    match = match_joints(mechanism, layout)
    forces = _check_numbers(convert_coordinates(mechanism, Q, "Q", mechanism.nv), "Q")
    base_count = mechanism.nv - mechanism.n
    takes_pose = mechanism.floats and match.in_world
    motion = _base_motion(mechanism, base, 1) if takes_pose or base is not None else []
    # Other free joints than that of the base take q.
    names_in_world = [
        joint.name for joint, _, coordinates in match.several if joint.in_world and coordinates.start >= base_count
    ]
    takes_q = len(names_in_world) > 0
    if takes_q and q is None:
        raise JounceError(
            f"q is None; expected it, as {layout.what} has forces on {quote_value(names_in_world[0])} in world axes"
        )
    q_of_joints = np.zeros(positions.count(mechanism))
    if takes_q:
        q_of_joints = _check_numbers(convert_position(mechanism, q), "q")
    whole, forces = broadcast([_join_base([q_of_joints], motion)[0], forces], [1, 1], ["q", "Q"])
    # Joints that follow others exert no forces: those of their leaders do the same work.
    tau = np.zeros((*forces.shape[:-1], layout.nv))
    for i, place in match.joints.items():
        name = mechanism.joints[i]
        if name in mechanism.coordinates:
            tau[..., place.v] = forces[..., base_count + mechanism.coordinates.index(name)]
    for joint, numbers, coordinates in match.several:
        p = whole[..., numbers] if joint.in_world else None
        tau[..., joint.v] = force_to(joint, p, forces[..., coordinates])
    return tau


def _check_vector(layout: ModelLayout, vector: object, label: str, size: int) -> np.ndarray:
    """Return a vector (..., size) of a model; None is refused."""
    if vector is None:
        raise JounceError(f"{label} is None; expected an array (..., {size}) of {layout.what}")
    return _check_numbers(array_of_shape(vector, (size,), label, f", as {layout.what} has it"), label)


def _check_numbers(x: object, label: str) -> np.ndarray:
    if not is_numeric(x):
        raise JounceError(f"{label} is of type {type(x).__name__} or holds symbols; expected NumPy arrays of numbers")
    return np.asarray(x, dtype=float)


def _joint_variable(q: np.ndarray, place: JointPlace, name: str, label: str) -> np.ndarray:
    """Return the joint variable (...) from q.

    Of a cosine and a sine it is the angle from -pi to pi.
    """
    if not place.turns:
        return q[..., place.q]
    x = check_unit(q[..., place.q : place.q + 2], f"{label}: cosine and sine of joint {quote_value(name)}")
    return np.arctan2(x[..., 1], x[..., 0])


def _check_follower(
    mechanism: Mechanism, i: int, place: JointPlace, theta: np.ndarray, q: np.ndarray, label: str
) -> None:
    """Raise `JounceError` if a joint is not where its leaders place it."""
    expected = q @ mechanism.G[i] + mechanism.g[i]
    errors = np.abs(theta - expected)
    # Whole turns do not count.
    if place.turns:
        errors = np.minimum(errors % (2 * np.pi), -errors % (2 * np.pi))
    if (errors > FOLLOWER_TOLERANCE).any():
        worst = np.unravel_index(np.nanargmax(errors), errors.shape)
        leaders = join_names(mechanism.coordinates[j] for j in np.flatnonzero(mechanism.G[i]))
        came = f"{label} has joint {quote_value(mechanism.joints[i])} at {theta[worst]:.6g}; it follows {leaders}"
        raise JounceError(f"{came}, expected {expected[worst]:.6g} within {FOLLOWER_TOLERANCE:g} rad or m")


def _base_motion(mechanism: Mechanism, base: object, count: int) -> list[np.ndarray]:
    """Return the `count` terms C, V, Vd of the base.

    A robot that does not float has none.
    """
    if not mechanism.floats:
        if base is not None:
            raise JounceError(f"base is given, yet {mechanism.name!r} does not float; expected base=None")
        return []
    return [_check_numbers(x, "base") for x in convert_base_motion(mechanism, base, count, "this state")]


# A joint of several screws: its motion and forces in the axes of a library, and back.
def motion_from(joint: FreeJointPlace, terms: Sequence[np.ndarray], label: str) -> list[np.ndarray]:
    """Return the numbers p of a joint, nu and nu'.

    They are as many as there are of q, v and a.
    """
    # p is a position, then a quaternion or a cosine and a sine.
    p = terms[0][..., joint.q]
    count = len(joint.group.places)
    what = "the quaternion" if p.shape[-1] - count == 4 else "cosine and sine"
    owner = f"{label} of {quote_value(joint.name)}" if joint.T is None else label
    p = np.concatenate([p[..., :count], check_unit(p[..., count:], f"{owner}: {what}")], axis=-1)
    rates = [_rotate_linear(joint, p, x[..., joint.v], back=True) for x in terms[1:]]
    # d/dt (A u) = A (u' + w x u): u' is the rate of the components in the axes of the joint.
    if joint.in_world and len(rates) > 1:
        rates = [rates[0], *(nu - _transport_acceleration(rates[0]) for nu in rates[1:])]
    if joint.T is None:
        return [p, *rates]
    # A base has the pose C = ground p T, and the twist Ad(T^-1) nu.
    C = joint.ground @ groups.FREE.pose(p) @ joint.T
    return [groups.FREE.numbers(C), *(nu @ Ad(inverse(joint.T)).T for nu in rates)]


def put_motion(joint: FreeJointPlace, motion: Sequence[np.ndarray], out: Sequence[np.ndarray]) -> None:
    """Write p, nu, nu' of a joint into q, v, a."""
    out[0][..., joint.q] = p = _joint_numbers(joint, motion[0])
    rates = motion[1:] if joint.T is None else [nu @ Ad(joint.T).T for nu in motion[1:]]
    for k, (nu, x) in enumerate(zip(rates, out[1:], strict=True)):
        if k > 0 and joint.in_world:
            nu = nu + _transport_acceleration(rates[0])
        x[..., joint.v] = _rotate_linear(joint, p, nu)


def _transport_acceleration(nu: np.ndarray) -> np.ndarray:
    """Return the acceleration (0; w x u) due to turning axes."""
    return np.concatenate([0 * nu[..., :3], np.cross(nu[..., :3], nu[..., 3:])], axis=-1)


def force_from(joint: FreeJointPlace, p: np.ndarray | None, tau: np.ndarray) -> np.ndarray:
    """Return the forces of a joint from the forces of a library.

    `p` are the numbers of the joint, where the forces are in world axes.
    """
    W = tau[..., joint.v]
    if p is not None:
        W = _rotate_linear(joint, _joint_numbers(joint, p), W, back=True)
    return W if joint.T is None else np.asarray(W @ Ad(joint.T))


def force_to(joint: FreeJointPlace, p: np.ndarray | None, W: np.ndarray) -> np.ndarray:
    """Return the forces of a library from those of a joint."""
    W = W if joint.T is None else W @ Ad(inverse(joint.T))
    return W if p is None else _rotate_linear(joint, _joint_numbers(joint, p), W)


def _joint_numbers(joint: FreeJointPlace, p: np.ndarray) -> np.ndarray:
    """Return the numbers of a joint from those of its body.

    w of quaternions is not negative.
    """
    C = joint.group.pose(p)
    return joint.group.numbers(C if joint.T is None else inverse(joint.ground) @ C @ inverse(joint.T))


def _rotate_linear(joint: FreeJointPlace, p: np.ndarray, x: np.ndarray, back: bool = False) -> np.ndarray:
    """Return velocities or forces of a joint in its library's axes.

    They are at p; with `back` those of the library are rotated into the axes of the joint.
    """
    if not joint.in_world:
        return x
    A = rotation(joint.group.pose(p))
    A = A.mT if back else A
    linear = (A @ x[..., 3:, None])[..., 0]
    return np.concatenate(np.broadcast_arrays(x[..., :3], linear), axis=-1)


def check_unit(x: np.ndarray, what: str) -> np.ndarray:
    """Return vectors (..., k) scaled to unit length.

    Raises `JounceError` unless their length is 1 already, but for rounding; NaN passes.
    """
    length = np.linalg.norm(x, axis=-1, keepdims=True)
    errors = np.abs(length - 1)[..., 0]
    if (errors > POSE_TOLERANCE).any():
        index, sample = worst_sample(errors)
        came = f"{what}{sample} has norm {length[index][0]:.6g}"
        raise JounceError(f"{came}; expected 1 within {POSE_TOLERANCE:g}: normalize it")
    return np.asarray(x / length)
