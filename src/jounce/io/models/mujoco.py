"""Reads MuJoCo's models, mjModel, as links and joints.

Of their arrays it takes what dynamics needs.

`mechanism` is the door. Its steps, in this order:

1. `read_arrays`: the arrays, whatever version of MuJoCo made them, are there and finite, and every part has a name.
2. `find_mimics`, `find_ties`: equality constraints are soft in MuJoCo, and hold exactly here. Those that tie one joint
   linearly to another make it follow, ``q1 - q1_0 = a + b (q2 - q2_0)`` with `qpos0` for q1_0 and q2_0. Those that
   connect or weld two bodies are loops, cut at a ball or at a weld.
3. `_build_bodies`: bodies are links, with joints between them. The joints of a body act one after another: the last
   moves the body, those before it move massless links, BODY:JOINT by name. Bodies without a joint are welded, and so
   are named sites, as massless links, unless a body has their name, and the ends of constraints.
4. `warn_of_ignored`: one warning names what is not part of a tree of rigid bodies and its drives.
5. `close_ties`: the joints with actuators move the closed robot, which starts at `qpos0`.

Joint variables are MuJoCo's own, which are `qpos0` where the bodies stand as the file places them; angles in rad. The
numbers q of a free joint are the pose of its body in the world, those of a ball the turn from where the file has the
body: MuJoCo's own too, but for the order x, y, z, w of quaternions.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jounce.arguments import loops as loop_arguments
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, locate_errors, warn
from jounce.model import positions, tree
from jounce.model.limits import StatedLimit
from jounce.model.mechanism import Mechanism
from jounce.model.tree import Mimic
from jounce.spatial import groups, lie
from jounce.spatial.inertia import inertia_matrix


def mechanism(
    model: Any, gravity: object = None, base: str | None = None, root: str | None = None, file: Path | None = None
) -> Mechanism:
    """Return the mechanism of an mjModel.

    It is under its own gravity unless another is given; `file` is what messages call it.
    """
    m = read_arrays(model, file)
    with locate_errors(m.place):
        tree.check_base(base)
    if len(m.joints) == 0:
        raise JounceError(f"{m.place}: no joint; expected at least one movable joint")
    # Equality constraints are joints that follow, loops, or ignored.
    mimics = find_mimics(m)
    active = active_constraints(m)
    ties = find_ties(m, active, {*m.bodies, *m.joints, *m.sites})
    ends = [end for tie in ties for end in (tie.a, tie.b)]
    links, joints = _build_bodies(m, mimics, ends, welded=base == "fixed")
    warn_of_ignored(m, ties=len(active) - len(mimics) - len(ties), floats=base != "fixed")
    gravity = m.gravity * m.acts("GRAVITY") if gravity is None else gravity
    parts = tree.LinkModel(links, joints, m.name, m.place, world=m.bodies[0])
    return close_ties(m, tree.build_mechanism(parts, gravity, base, root), ties)


@dataclass(frozen=True, eq=False)
class ModelArrays:
    """The arrays of a model by MuJoCo's names, and its parts' names."""

    values: Mapping[str, np.ndarray]
    name: str
    place: str  # what messages call the model
    bodies: tuple[str, ...]  # the first is the world
    joints: tuple[str, ...]
    sites: tuple[str, ...]  # "" where they have no name
    gravity: np.ndarray
    fluid: bool  # whether it moves in one
    disabled: frozenset[str]  # what its flags disable: "GRAVITY", "SPRING", ...

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def acts(self, *flags: str) -> bool:
        """Return whether no flag of these disables it."""
        return self.disabled.isdisjoint(flags)

    def pose(self, position: str, quaternion: str, i: int) -> np.ndarray:
        """Return the pose (4, 4) of a position and a quaternion.

        The quaternion is (w, x, y, z), of unit length.
        """
        return lie.pose(lie.from_quaternion(self[quaternion][i]), self[position][i][:, None])


class LoopEnd(NamedTuple):
    """One end of a loop: the name of its frame, the body that carries it, and its pose there."""

    frame: str
    body: str
    T: np.ndarray


def _build_bodies(
    m: ModelArrays, mimics: dict[int, tree.Mimic], ends: Sequence[LoopEnd], welded: bool
) -> tuple[list[tree.Link], list[tree.Joint]]:
    """Return the links of a model, and the joints between them.

    `welded` is whether the base does not float; `ends` are those of loops.
    """
    # The inertia of a body is diagonal in its principal axes, about the COM.
    links = []
    for i, body in enumerate(m.bodies):
        pose_body_from_com, theta = m.pose("body_ipos", "body_iquat", i), np.diag(m["body_inertia"][i])
        M = inertia_matrix(m["body_mass"][i], pose_body_from_com[:3, 3], theta, rotation=pose_body_from_com[:3, :3])
        links.append(tree.Link(body, M, m.place))
    joints: list[tree.Joint] = []
    link_names, joint_names = set(m.bodies), set(m.joints)

    def weld(link: str, parent: str, B: np.ndarray) -> None:
        joints.append(tree.Joint(make_distinct(link, joint_names), parent, link, B, None, None, {}, {}, m.place))

    def add_massless(link: str) -> str:
        links.append(tree.Link(link, np.zeros((6, 6)), m.place))
        return link

    # The joints of a body are a chain from its parent: the first has the pose of the body, the others stand at its
    # origin, and the last one moves the body itself.
    for i, body in enumerate(m.bodies[1:], 1):
        carrier, B = m.bodies[m["body_parentid"][i]], m.pose("body_pos", "body_quat", i)
        joints_of_body = range(m["body_jntadr"][i], m["body_jntadr"][i] + m["body_jntnum"][i])
        for j in joints_of_body:
            # The q of a free joint is the pose in the world, wherever the file has the body.
            if m["jnt_type"][j] == FREE_JOINT_TYPE and not welded:
                B = np.eye(4)
            is_last = j == joints_of_body[-1]
            child = body if is_last else add_massless(make_distinct(f"{body}:{m.joints[j]}", link_names))
            joints.append(build_joint(m, j, carrier, child, B, mimics.get(j)))
            carrier, B = child, np.eye(4)
        if len(joints_of_body) == 0:
            weld(body, carrier, B)
    for i, site in enumerate(m.sites):
        if site != "" and site not in link_names:
            weld(add_massless(site), m.bodies[m["site_bodyid"][i]], m.pose("site_pos", "site_quat", i))
    for end in ends:
        weld(add_massless(end.frame), end.body, end.T)
    return links, joints


# The arrays of a model.
UNNAMED = "MuJoCo Model"  # what MuJoCo calls a model without a name
# Positions, axes and inertias are checked here to be finite; limits and drives are checked where they are read.
FINITE_ARRAYS = {
    "body": ("body_pos", "body_quat", "body_mass", "body_ipos", "body_iquat", "body_inertia"),
    "joint": ("jnt_pos", "jnt_axis"),
    "site": ("site_pos", "site_quat"),
}
REQUIRED_ARRAYS = (
    *(name for names in FINITE_ARRAYS.values() for name in names),
    *("name_bodyadr", "body_parentid", "body_jntadr", "body_jntnum", "body_gravcomp", "body_plugin"),
    *("name_jntadr", "jnt_type", "jnt_qposadr", "jnt_dofadr", "name_siteadr", "site_bodyid", "qpos0", "qpos_spring"),
    *("jnt_limited", "jnt_range", "jnt_actfrclimited", "jnt_actfrcrange"),
    *("jnt_stiffness", "dof_armature", "dof_damping", "dof_frictionloss"),
    *("eq_type", "eq_obj1id", "eq_obj2id", "eq_active0", "eq_data", "eq_objtype"),
    *("actuator_trntype", "actuator_trnid", "actuator_gear", "actuator_forcelimited", "actuator_forcerange"),
    *("tendon_stiffness", "tendon_damping", "tendon_frictionloss", "nflex"),
)
NEWER_ARRAYS = (  # arrays that MuJoCo 3.3 does not have: nothing where they are missing
    *("dof_dampingpoly", "jnt_stiffnesspoly", "jnt_springyield", "tendon_armature"),
    *("actuator_armature", "actuator_damping", "actuator_dampingpoly"),
)


def read_arrays(model: Any, file: Path | None, what: str = "from_mujoco()") -> ModelArrays:
    """Return the arrays of a model.

    Raises `JounceError`, naming `file`, if it is not a model, or positions, axes or inertias are not finite.
    """
    try:
        values = {name: np.asarray(getattr(model, name)) for name in REQUIRED_ARRAYS}
        option, texts = model.opt, bytes(model.names)
    except AttributeError as error:
        came = f"{type(model).__name__}, which has no {error.name!r}"
        raise JounceError(f"{what} expects a mujoco.MjModel, got {came}") from None
    values |= {name: np.asarray(getattr(model, name, 0.0)) for name in NEWER_ARRAYS}
    name = _read_text(texts, 0)
    name = file.stem if file is not None and name == UNNAMED else name
    # All names stand one behind another in `texts`; addresses say where each begins.
    bodies, joints, sites = (
        [_read_text(texts, address) for address in values[f"name_{kind}adr"]] for kind in ("body", "jnt", "site")
    )
    arrays = ModelArrays(
        values=values,
        name=name,
        place=f"model {name!r}" if file is None else str(file),
        bodies=_fill_names(bodies, "body", first=0),
        joints=_fill_names(joints, "joint", first=1),
        sites=tuple(sites),
        gravity=np.array(option.gravity, dtype=float),
        fluid=bool(option.density or option.viscosity),
        disabled=_disabled_flags(int(option.disableflags)),
    )
    _check_finite(arrays)
    return arrays


def make_distinct(name: str, used_names: set[str]) -> str:
    """Return a name, with a number behind it if it is used.

    From then on the name is used.
    """
    distinct = name
    numbers = count(2)
    while distinct in used_names:
        distinct = f"{name}_{next(numbers)}"
    used_names.add(distinct)
    return distinct


def _read_text(texts: bytes, address: int) -> str:
    return texts[address : texts.index(b"\0", address)].decode(errors="replace")


def _fill_names(names: list[str], stem: str, first: int) -> tuple[str, ...]:
    """Return names, with missing ones made of a stem and a number."""
    used_names = set(names)
    return tuple(make_distinct(f"{stem}{i}", used_names) if name == "" else name for i, name in enumerate(names, first))


def _disabled_flags(flags: int) -> frozenset[str]:
    """Return the names of disabled flags, without their prefix.

    Their bits are those of the version that is installed.
    """
    if flags == 0:
        return frozenset()
    from mujoco import mjtDisableBit  # the bits differ between versions

    bits = mjtDisableBit.__members__.items()
    return frozenset(name.removeprefix("mjDSBL_") for name, bit in bits if flags & int(bit))


def _check_finite(m: ModelArrays) -> None:
    """Raise `JounceError` if positions, axes or inertias are not finite."""
    names_of_kind = {"body": m.bodies, "joint": m.joints, "site": m.sites}
    for kind, array_names in FINITE_ARRAYS.items():
        for name in array_names:
            bad_rows = np.argwhere(~np.isfinite(m[name]))[:, 0]
            if bad_rows.size > 0:
                i = bad_rows[0]
                came = f"{name} of {kind} {names_of_kind[kind][i]!r} is {m[name][i].tolist()}"
                raise JounceError(f"{m.place}: {came}; expected finite numbers")


# Joints: their screws, limits and drive trains.
FREE_JOINT_TYPE, BALL_JOINT_TYPE, SLIDE_JOINT_TYPE = 0, 1, 2  # mujoco.mjtJoint
FREE_JOINT_KINDS = {FREE_JOINT_TYPE: "floating", BALL_JOINT_TYPE: "spherical"}
JOINT_TRANSMISSION_TYPES = (0, 1)  # mujoco.mjtTrn, in a joint's frame or its parent's: the same for one axis


def moves_along_one_screw(m: ModelArrays, j: int) -> bool:
    """Return whether a joint is a hinge or a slide."""
    return int(m["jnt_type"][j]) not in FREE_JOINT_KINDS


def build_joint(m: ModelArrays, j: int, parent: str, child: str, B: np.ndarray, mimic: tree.Mimic | None) -> tree.Joint:
    """Return a joint between two links.

    B is the pose of the child where the joint variable is `qpos0`.
    """
    name, kind = m.joints[j], int(m["jnt_type"][j])
    if kind == FREE_JOINT_TYPE:
        return tree.Joint(name, parent, child, B, None, None, {}, {}, m.place, free=FREE_JOINT_KINDS[kind])
    if kind == BALL_JOINT_TYPE:
        X, free = lie.Ad(lie.pose(np.eye(3), m["jnt_pos"][j][:, None])) @ groups.BALL.X, FREE_JOINT_KINDS[kind]
        return tree.Joint(name, parent, child, B, X.T, None, _ball_limits(m, j), _drive(m, j), m.place, free=free)
    # B exp(X qpos0) is the pose where the file places the child: B is the pose at zero.
    X, start = _screw(m, j), m["qpos0"][m["jnt_qposadr"][j]]
    if start != 0:
        B = B @ lie.exp(X, -start[None, None])
    return tree.Joint(name, parent, child, B, X, mimic, _joint_limits(m, j), _drive(m, j), m.place)


def _ball_limits(m: ModelArrays, j: int) -> dict[str, StatedLimit]:
    """Return the limits of a ball, if it has some.

    They are those of the angle of its whole turn, which is pi at most.
    """
    largest_angle = float(m["jnt_range"][j][1])
    is_bounded = m["jnt_limited"][j] and largest_angle < np.pi
    return {"lower": -largest_angle, "upper": largest_angle} if is_bounded else {}


def _screw(m: ModelArrays, j: int) -> np.ndarray:
    """Return the screw (6,) of a slide or a hinge."""
    axis = m["jnt_axis"][j]
    if m["jnt_type"][j] == SLIDE_JOINT_TYPE:
        return np.concatenate([np.zeros(3), axis])
    return np.concatenate([axis, np.cross(m["jnt_pos"][j], axis)])


def _joint_limits(m: ModelArrays, j: int) -> dict[str, StatedLimit]:
    """Return the range of a joint, and the range of its effort.

    Its actuators may exert together the sum of their ranges, if all have one.
    """
    limits: dict[str, StatedLimit] = {}
    if m["jnt_limited"][j]:
        limits["lower"], limits["upper"] = m["jnt_range"][j].tolist()
    lower, upper = _actuator_forces(m, j)
    if m["jnt_actfrclimited"][j]:
        lower_of_joint, upper_of_joint = m["jnt_actfrcrange"][j].tolist()
        lower, upper = max(lower, lower_of_joint), min(upper, upper_of_joint)
    if np.isfinite([lower, upper]).any():
        limits["effort"] = upper if lower == -upper else (lower, upper)
    return limits


def _actuator_forces(m: ModelArrays, j: int) -> tuple[float, float]:
    """Return the smallest and largest force of the actuators of a joint.

    They are infinite without actuators, or where one has no range.
    """
    actuators = np.flatnonzero(_find_actuators(m, j))
    if actuators.size == 0 or not m["actuator_forcelimited"][actuators].all():
        return -np.inf, np.inf
    # Gears may be negative, so that ends of a range change places.
    ranges = m["actuator_forcerange"][actuators] * m["actuator_gear"][actuators, :1]
    return float(ranges.min(axis=1).sum()), float(ranges.max(axis=1).sum())


def _drive(m: ModelArrays, j: int) -> dict[str, float]:
    """Return the drive of a joint.

    Armature and damping of its actuators count times the gear squared, at joints of one screw.
    """
    dof, is_single = m["jnt_dofadr"][j], moves_along_one_screw(m, j)
    gears_squared = is_single * _find_actuators(m, j) * m["actuator_gear"][:, 0] ** 2
    drive = {
        "armature": m["dof_armature"][dof] + np.sum(gears_squared * m["actuator_armature"]),
        "damping": m["dof_damping"][dof] + np.sum(gears_squared * m["actuator_damping"]),
        "friction": m["dof_frictionloss"][dof] * m.acts("FRICTIONLOSS", "CONSTRAINT"),
        "stiffness": is_single * m["jnt_stiffness"][j] * m.acts("SPRING", "PASSIVE"),
    }
    drive["damping"] *= m.acts("DAMPER", "PASSIVE")
    if drive["stiffness"] != 0:
        drive["rest"] = m["qpos_spring"][m["jnt_qposadr"][j]]
    return {key: float(x) for key, x in drive.items()}


def _find_actuators(m: ModelArrays, j: int) -> np.ndarray:
    """Return which actuators act on a joint."""
    return np.isin(m["actuator_trntype"], JOINT_TRANSMISSION_TYPES) & (m["actuator_trnid"][:, 0] == j)


# Equality constraints: joints that follow others, and loops.
JOINT_EQUALITY_TYPE = 2  # mujoco.mjtEq
CUT_JOINTS = {0: "spherical", 1: "fixed"}  # by mujoco.mjtEq: connect and weld
SITE_OBJECT_TYPE = 6  # mujoco.mjtObj


class LoopTie(NamedTuple):
    """Two ends that a constraint ties, and the joint between them."""

    a: LoopEnd
    b: LoopEnd
    joint: str


def find_mimics(m: ModelArrays) -> dict[int, Mimic]:
    """Map joints to those that they follow, by index.

    A constraint that would close a circle, or tie a joint a second time, is ignored.
    """
    leaders: dict[int, int] = {}
    mimics: dict[int, Mimic] = {}
    for k in active_constraints(m):
        i, leader, law = m["eq_obj1id"][k], m["eq_obj2id"][k], m["eq_data"][k]
        # The law is a polynomial, which is linear here: q1 - q1_0 = a + b (q2 - q2_0).
        if m["eq_type"][k] != JOINT_EQUALITY_TYPE or leader < 0 or law[2:5].any() or i in leaders:
            continue
        are_single = moves_along_one_screw(m, i) and moves_along_one_screw(m, leader)
        if not are_single or _leads_to(leader, i, leaders):
            continue
        start, start_of_leader = (m["qpos0"][m["jnt_qposadr"][j]] for j in (i, leader))
        leaders[i] = leader
        mimics[i] = Mimic(m.joints[leader], float(law[1]), float(start + law[0] - law[1] * start_of_leader))
    return mimics


def active_constraints(m: ModelArrays) -> list[int]:
    """Return the active equality constraints."""
    if not m.acts("EQUALITY", "CONSTRAINT"):
        return []
    return [int(k) for k in np.flatnonzero(m["eq_active0"])]


def _leads_to(joint: int, end: int, leaders: dict[int, int]) -> bool:
    """Return whether a joint is another one, or follows it."""
    while joint != end and joint in leaders:
        joint = leaders[joint]
    return joint == end


def find_ties(m: ModelArrays, active: Sequence[int], used_names: set[str]) -> list[LoopTie]:
    """Return the loops among the active equality constraints.

    Their frames take names that are not used yet.
    """
    ties: list[LoopTie] = []
    for k in active:
        joint = CUT_JOINTS.get(int(m["eq_type"][k]))
        if joint is None:
            continue
        # The ends are two sites, or anchors on two bodies.
        places = [m[f"eq_obj{side}id"][k] for side in (1, 2)]
        if m["eq_objtype"][k] == SITE_OBJECT_TYPE:
            ends = [(m.bodies[m["site_bodyid"][i]], m.pose("site_pos", "site_quat", i)) for i in places]
        else:
            ends = list(zip([m.bodies[i] for i in places], _anchors(m, k, joint), strict=True))
        a, b = (LoopEnd(make_distinct(f"loop{len(ties)}:{body}", used_names), body, T) for body, T in ends)
        ties.append(LoopTie(a, b, joint))
    return ties


def _anchors(m: ModelArrays, k: int, joint: str) -> list[np.ndarray]:
    """Return the anchors of a constraint, as poses on two bodies.

    A weld has one anchor, on the second body, and the pose of this body in the first.
    """
    data = m["eq_data"][k]
    anchors = [lie.pose(np.eye(3), data[3 * i : 3 * i + 3, None]) for i in range(2)]
    if joint == "fixed":
        pose_first_from_second = lie.pose(lie.from_quaternion(data[6:10]), data[3:6, None])
        anchors = [pose_first_from_second @ anchors[0], anchors[0]]
    return anchors


def close_ties(m: ModelArrays, mechanism: Mechanism, ties: Sequence[LoopTie]) -> Mechanism:
    """Return the mechanism with its loops closed.

    The loops stay open if the joints with actuators do not determine the motion.
    """
    # A tie between frames that `--root` has left out, or on one body, is no loop.
    loops = []
    for tie in ties:
        if {tie.a.frame, tie.b.frame} <= set(mechanism.frame_names):
            with suppress(JounceError):
                loops.append(loop_arguments.build_loop(mechanism, tie.a.frame, tie.b.frame, tie.joint))
    if len(loops) == 0:
        return mechanism
    mechanism = replace(mechanism, loops=tuple(loops))
    # Actuators at joints are the motors of the closed robot.
    driven_joints = m["actuator_trnid"][np.isin(m["actuator_trntype"], JOINT_TRANSMISSION_TYPES), 0]
    driven_names = {m.joints[j] for j in driven_joints}
    motors = [name for name in mechanism.coordinates if name in driven_names]
    try:
        positions.check_single_screws(mechanism, "closed loops")
        if mechanism.floats and any(-1 in (loop.a.body, loop.b.body) for loop in loops):
            raise JounceError("some hold the base to the ground, which makes its pose a coordinate")
        start: Mapping[str, float] = {
            name: float(m["qpos0"][m["jnt_qposadr"][m.joints.index(name)]]) for name in mechanism.coordinates
        }
        if len(motors) == 0:
            raise JounceError("no joint has an actuator")
        # What motors leave loose, as fingers on springs, is passive.
        return loop_arguments.with_loops(
            mechanism, loop_arguments.ClosureParameters(actuated=motors, start=start, finds_passive=True)
        )
    except JounceError as error:
        warn(f"{m.place}: its loops stay open{Remedy(', robot.closed(actuated=[...]) closes them')}: {error}")
        return mechanism


def warn_of_ignored(m: ModelArrays, ties: int, floats: bool) -> None:
    """Warn of terms of MuJoCo's inverse dynamics that jounce ignores.

    `ties` is the number of equality constraints that are ignored. Contacts, limits and the laws of actuators are not
    among these terms: Q is the force that they must supply.
    """
    is_elsewhere = ~np.isin(m["actuator_trntype"], JOINT_TRANSMISSION_TYPES)
    has_drive_train = _nonzero_rows(m, "actuator_armature", "actuator_damping", "actuator_dampingpoly")
    # A number of parts, or which parts have the term.
    ignored: dict[str, int | np.bool_ | np.ndarray] = {
        "equality constraints": ties,
        "tendons that pull or resist": _nonzero_rows(m, "tendon_stiffness", "tendon_damping", "tendon_frictionloss"),
        "armatures of tendons": _nonzero_rows(m, "tendon_armature"),
        "drive trains of actuators at no joint": has_drive_train & is_elsewhere,
        "springs of ball joints": (m["jnt_type"] == BALL_JOINT_TYPE) & (m["jnt_stiffness"] != 0),
        "springs that are not linear": _nonzero_rows(m, "jnt_stiffnesspoly", "jnt_springyield"),
        "dampers that are not linear": _nonzero_rows(m, "dof_dampingpoly"),
        "dampers of actuators that are not linear": _nonzero_rows(m, "actuator_dampingpoly") & ~is_elsewhere,
        "bodies with gravity compensation": _nonzero_rows(m, "body_gravcomp"),
        "bodies with a plugin": m["body_plugin"] >= 0,
        "armature, damping, friction and springs of the free joint": floats and _free_drives(m).any(),
        "flexible bodies": m["nflex"],
        "drag and lift of the fluid": m.fluid,
    }
    counts = {term: int(np.sum(parts)) for term, parts in ignored.items()}
    words = [f"{term} ({n})" if n > 1 else term for term, n in counts.items() if n != 0]
    if len(words) > 0:
        warn(f"{m.place}: ignored, since not part of a tree of rigid bodies: {', '.join(words)}")


def _free_drives(m: ModelArrays) -> np.ndarray:
    """Return the numbers of the drive trains of free joints."""
    joints = np.flatnonzero(m["jnt_type"] == FREE_JOINT_TYPE)
    rows = (m["jnt_dofadr"][joints, None] + np.arange(6)).ravel()
    numbers = [m[f"dof_{name}"][rows] for name in ("armature", "damping", "frictionloss")]
    return np.concatenate([*numbers, m["jnt_stiffness"][joints]])


def _nonzero_rows(m: ModelArrays, *names: str) -> np.ndarray:
    """Return which rows of arrays of equal length have a nonzero entry.

    Arrays that this version of MuJoCo does not have are skipped.
    """
    arrays = [m[name] for name in names if m[name].ndim > 0]
    return np.any([array.any(axis=tuple(range(1, array.ndim))) for array in arrays], axis=0)


@contextmanager
def collect_mujoco_warnings(mujoco: Any) -> Iterator[list[str]]:
    """Collect MuJoCo's warnings within this context.

    Otherwise it would print them, and append them to MUJOCO_LOG.TXT in the current folder.
    """
    warnings: list[str] = []
    former_handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(warnings.append)
    try:
        yield warnings
    finally:
        mujoco.set_mju_user_warning(former_handler)


@contextmanager
def free_assets(mujoco: Any) -> Iterator[None]:
    """Free the meshes and textures that MuJoCo caches within this context.

    They take up to 500 MB. The cache stays if the program has read models by itself before.
    """
    get_cache = getattr(mujoco, "mj_getCache", None)  # which old versions do not have
    cache = None if get_cache is None else get_cache()
    was_empty = cache is not None and mujoco.mj_getCacheSize(cache) == 0
    try:
        yield
    finally:
        if was_empty:
            mujoco.mj_clearCache(cache)
