"""Reads MuJoCo's models, mjModel: what dynamics needs of their arrays, as links and joints.

`mechanism` is the door. Its steps, in this order:

1. `read_arrays`: the arrays, whatever version of MuJoCo made them, are there and finite, and every part has a name.
2. `find_mimics`, `find_ties`: equality constraints are soft in MuJoCo, and hold exactly here. Those that tie one joint
   linearly to another make it follow, ``q1 - q1_0 = a + b (q2 - q2_0)`` with `qpos0` for q1_0 and q2_0. Those that
   connect or weld two bodies are loops, cut at a ball or at a weld.
3. `_build_bodies`: bodies are links, with joints between them. The joints of a body act one after another: the last
   moves the body, those before it massless links, BODY:JOINT by name. Bodies without a joint are welded, and so are
   named sites, as massless links, unless a body has their name, and the ends of constraints.
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

from jounce.arguments.loops import build_loop, with_loops
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
    """The mechanism of an mjModel, under its own gravity unless another is given; `file` is what messages call it."""
    m = read_arrays(model, file)
    with locate_errors(m.place):
        tree.check_base(base)
    if not m.joints:
        raise JounceError(f"{m.place}: no joint; expected at least one movable joint")
    mimics = find_mimics(m)
    active = active_constraints(m)
    tied = find_ties(m, active, {*m.bodies, *m.joints, *m.sites})
    links, between = _build_bodies(m, mimics, [end for tie in tied for end in (tie.a, tie.b)], welded=base == "fixed")
    warn_of_ignored(m, ties=len(active) - len(mimics) - len(tied), floats=base != "fixed")
    own = m.gravity * m.acts("GRAVITY")
    given = own if gravity is None else gravity
    built = tree.build_mechanism(links, between, given, m.name, m.place, base=base, root=root, world=m.bodies[0])
    return close_ties(m, built, tied)


@dataclass(frozen=True, eq=False)
class ModelArrays:
    """The arrays of a model by MuJoCo's names, and the names of its parts."""

    values: Mapping[str, np.ndarray]
    name: str
    place: str  # what messages call the model
    bodies: tuple[str, ...]  # the first is the world
    joints: tuple[str, ...]
    sites: tuple[str, ...]  # "" where they have no name
    gravity: np.ndarray
    fluid: bool  # whether it moves in one
    off: frozenset[str]  # what its flags disable: "GRAVITY", "SPRING", ...

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def acts(self, *flags: str) -> bool:
        """Whether none of some flags disables it."""
        return self.off.isdisjoint(flags)

    def pose(self, position: str, quaternion: str, i: int) -> np.ndarray:
        """The pose (4, 4) of a position and a unit quaternion (w, x, y, z)."""
        return lie.pose(lie.from_quaternion(self[quaternion][i]), self[position][i][:, None])


class LoopEnd(NamedTuple):
    """One end of a loop: the name of its frame, the body that carries it, and its pose there."""

    frame: str
    body: str
    T: np.ndarray


def _build_bodies(
    m: ModelArrays, mimics: dict[int, tree.Mimic], ends: Sequence[LoopEnd], welded: bool
) -> tuple[list[tree.Link], list[tree.Joint]]:
    links = []
    for i, body in enumerate(m.bodies):
        principal, theta = m.pose("body_ipos", "body_iquat", i), np.diag(m["body_inertia"][i])
        M = inertia_matrix(m["body_mass"][i], principal[:3, 3], theta, rotation=principal[:3, :3])
        links.append(tree.Link(body, M, m.place))
    between: list[tree.Joint] = []
    taken, called = set(m.bodies), set(m.joints)

    def weld(link: str, parent: str, B: np.ndarray) -> None:
        between.append(tree.Joint(make_distinct(link, called), parent, link, B, None, None, {}, {}, m.place))

    def massless(link: str) -> str:
        links.append(tree.Link(link, np.zeros((6, 6)), m.place))
        return link

    for i, body in enumerate(m.bodies[1:], 1):
        carrier, B = m.bodies[m["body_parentid"][i]], m.pose("body_pos", "body_quat", i)
        own = range(m["body_jntadr"][i], m["body_jntadr"][i] + m["body_jntnum"][i])
        for j in own:
            if m["jnt_type"][j] == FREE_JOINT_TYPE and not welded:
                B = np.eye(4)  # its q is the pose in the world, wherever the file has the body
            child = body if j == own[-1] else massless(make_distinct(f"{body}:{m.joints[j]}", taken))
            between.append(build_joint(m, j, carrier, child, B, mimics.get(j)))
            carrier, B = child, np.eye(4)
        if not own:
            weld(body, carrier, B)
    for i, site in enumerate(m.sites):
        if site and site not in taken:
            weld(massless(site), m.bodies[m["site_bodyid"][i]], m.pose("site_pos", "site_quat", i))
    for end in ends:
        weld(massless(end.frame), end.body, end.T)
    return links, between


# The arrays of a model.
UNNAMED = "MuJoCo Model"  # what MuJoCo calls a model without a name
FINITE_ARRAYS = {  # what places and weighs the parts: checked here to be finite, limits and drives where they are read
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
    """Return the arrays of a model; raise `JounceError`, naming `file`, if it is not a model or not finite."""
    try:
        values = {name: np.asarray(getattr(model, name)) for name in REQUIRED_ARRAYS}
        option, texts = model.opt, bytes(model.names)
    except AttributeError as error:
        came = f"{type(model).__name__}, which has no {error.name!r}"
        raise JounceError(f"{what} expects a mujoco.MjModel, got {came}") from None
    values |= {name: np.asarray(getattr(model, name, 0.0)) for name in NEWER_ARRAYS}
    name = _read_text(texts, 0)
    name = file.stem if file and name == UNNAMED else name
    bodies, joints, sites = (
        [_read_text(texts, at) for at in values[f"name_{kind}adr"]] for kind in ("body", "jnt", "site")
    )
    found = ModelArrays(
        values=values,
        name=name,
        place=f"model {name!r}" if file is None else str(file),
        bodies=_fill_names(bodies, "body", first=0),
        joints=_fill_names(joints, "joint", first=1),
        sites=tuple(sites),
        gravity=np.array(option.gravity, dtype=float),
        fluid=bool(option.density or option.viscosity),
        off=_disabled_flags(int(option.disableflags)),
    )
    _check_finite(found)
    return found


def make_distinct(name: str, taken: set[str]) -> str:
    """The name, with a number behind it where it is taken; from then on it is."""
    free = name if name not in taken else next(x for i in count(2) if (x := f"{name}_{i}") not in taken)
    taken.add(free)
    return free


def _read_text(texts: bytes, at: int) -> str:
    return texts[at : texts.index(b"\0", at)].decode(errors="replace")


def _fill_names(given: list[str], stem: str, first: int) -> tuple[str, ...]:
    """The names, those that are missing made of a stem and a number."""
    taken = set(given)
    return tuple(name or make_distinct(f"{stem}{i}", taken) for i, name in enumerate(given, first))


def _disabled_flags(flags: int) -> frozenset[str]:
    if not flags:
        return frozenset()
    from mujoco import mjtDisableBit  # the bits differ between versions

    said = mjtDisableBit.__members__.items()
    return frozenset(name.removeprefix("mjDSBL_") for name, bit in said if flags & int(bit))


def _check_finite(found: ModelArrays) -> None:
    called = {"body": found.bodies, "joint": found.joints, "site": found.sites}
    for kind, names in FINITE_ARRAYS.items():
        for name in names:
            for i in np.argwhere(~np.isfinite(found[name]))[:1, 0]:
                came = f"{name} of {kind} {called[kind][i]!r} is {found[name][i].tolist()}"
                raise JounceError(f"{found.place}: {came}; expected finite numbers")


# Joints: their screws, limits and drive trains.
FREE_JOINT_TYPE, BALL_JOINT_TYPE, SLIDE_JOINT_TYPE = 0, 1, 2  # mujoco.mjtJoint
FREE_JOINT_KINDS = {FREE_JOINT_TYPE: "floating", BALL_JOINT_TYPE: "spherical"}
JOINT_TRANSMISSION_TYPES = (0, 1)  # mujoco.mjtTrn, in a joint's frame or its parent's: the same for one axis


def moves_along_one_screw(m: ModelArrays, j: int) -> bool:
    """Whether a joint is a hinge or a slide."""
    return int(m["jnt_type"][j]) not in FREE_JOINT_KINDS


def build_joint(m: ModelArrays, j: int, parent: str, child: str, B: np.ndarray, mimic: tree.Mimic | None) -> tree.Joint:
    """A joint between two links; B is the child's pose where the joint variable is `qpos0`."""
    name, kind = m.joints[j], int(m["jnt_type"][j])
    if kind == FREE_JOINT_TYPE:
        return tree.Joint(name, parent, child, B, None, None, {}, {}, m.place, free=FREE_JOINT_KINDS[kind])
    if kind == BALL_JOINT_TYPE:
        X, free = lie.Ad(lie.pose(np.eye(3), m["jnt_pos"][j][:, None])) @ groups.BALL.X, FREE_JOINT_KINDS[kind]
        return tree.Joint(name, parent, child, B, X.T, None, _ball_limits(m, j), _drive(m, j), m.place, free=free)
    X, start = _screw(m, j), m["qpos0"][m["jnt_qposadr"][j]]
    B = B @ lie.exp(X, -start[None, None]) if start else B
    return tree.Joint(name, parent, child, B, X, mimic, _joint_limits(m, j), _drive(m, j), m.place)


def _ball_limits(m: ModelArrays, j: int) -> dict[str, StatedLimit]:
    """The range of a ball: that of the angle of its whole turn, which is pi at most."""
    most = float(m["jnt_range"][j][1])
    return {"lower": -most, "upper": most} if m["jnt_limited"][j] and most < np.pi else {}


def _screw(m: ModelArrays, j: int) -> np.ndarray:
    axis = m["jnt_axis"][j]
    if m["jnt_type"][j] == SLIDE_JOINT_TYPE:
        return np.concatenate([np.zeros(3), axis])
    return np.concatenate([axis, np.cross(m["jnt_pos"][j], axis)])


def _joint_limits(m: ModelArrays, j: int) -> dict[str, StatedLimit]:
    """The range of a joint, and what its actuators may exert together: the sum of their ranges, if all have one."""
    stated: dict[str, StatedLimit] = {}
    if m["jnt_limited"][j]:
        stated["lower"], stated["upper"] = m["jnt_range"][j].tolist()
    lower, upper = _actuator_forces(m, j)
    if m["jnt_actfrclimited"][j]:
        low, high = m["jnt_actfrcrange"][j].tolist()
        lower, upper = max(lower, low), min(upper, high)
    if np.isfinite([lower, upper]).any():
        stated["effort"] = upper if lower == -upper else (lower, upper)
    return stated


def _actuator_forces(m: ModelArrays, j: int) -> tuple[float, float]:
    """The smallest and largest force of the actuators of a joint; infinite without actuators or ranges."""
    acting = np.flatnonzero(_find_actuators(m, j))
    if not acting.size or not m["actuator_forcelimited"][acting].all():
        return -np.inf, np.inf
    ends = m["actuator_forcerange"][acting] * m["actuator_gear"][acting, :1]
    return float(ends.min(axis=1).sum()), float(ends.max(axis=1).sum())


def _drive(m: ModelArrays, j: int) -> dict[str, float]:
    """Return the drive of a joint, with the actuators' armature and damping times the gear squared."""
    dof, single = m["jnt_dofadr"][j], moves_along_one_screw(m, j)
    gears = single * _find_actuators(m, j) * m["actuator_gear"][:, 0] ** 2
    stated = {
        "armature": m["dof_armature"][dof] + np.sum(gears * m["actuator_armature"]),
        "damping": m["dof_damping"][dof] + np.sum(gears * m["actuator_damping"]),
        "friction": m["dof_frictionloss"][dof] * m.acts("FRICTIONLOSS", "CONSTRAINT"),
        "stiffness": single * m["jnt_stiffness"][j] * m.acts("SPRING", "PASSIVE"),
    }
    stated["damping"] *= m.acts("DAMPER", "PASSIVE")
    if stated["stiffness"]:
        stated["rest"] = m["qpos_spring"][m["jnt_qposadr"][j]]
    return {key: float(x) for key, x in stated.items()}


def _find_actuators(m: ModelArrays, j: int) -> np.ndarray:
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
    """Map joints to those that they follow, by index; those that form a cycle or tie a joint twice are ignored."""
    leaders: dict[int, int] = {}
    found: dict[int, Mimic] = {}
    for k in active_constraints(m):
        i, leader, law = m["eq_obj1id"][k], m["eq_obj2id"][k], m["eq_data"][k]
        if m["eq_type"][k] != JOINT_EQUALITY_TYPE or leader < 0 or law[2:5].any() or i in leaders:
            continue
        if not (moves_along_one_screw(m, i) and moves_along_one_screw(m, leader)) or _leads_to(leader, i, leaders):
            continue
        start, start_of_leader = (m["qpos0"][m["jnt_qposadr"][j]] for j in (i, leader))
        leaders[i] = leader
        found[i] = Mimic(m.joints[leader], float(law[1]), float(start + law[0] - law[1] * start_of_leader))
    return found


def active_constraints(m: ModelArrays) -> list[int]:
    """Return the active equality constraints."""
    return [int(k) for k in np.flatnonzero(m["eq_active0"])] if m.acts("EQUALITY", "CONSTRAINT") else []


def _leads_to(joint: int, end: int, leaders: dict[int, int]) -> bool:
    """Whether a joint is another one, or follows it."""
    while joint != end and joint in leaders:
        joint = leaders[joint]
    return joint == end


def find_ties(m: ModelArrays, active: Sequence[int], taken: set[str]) -> list[LoopTie]:
    """The loops among the active equality constraints; their frames take names that are free."""
    found: list[LoopTie] = []
    for k in active:
        joint = CUT_JOINTS.get(int(m["eq_type"][k]))
        if joint is None:
            continue
        places = [m[f"eq_obj{side}id"][k] for side in (1, 2)]
        if m["eq_objtype"][k] == SITE_OBJECT_TYPE:
            placed = [(m.bodies[m["site_bodyid"][i]], m.pose("site_pos", "site_quat", i)) for i in places]
        else:
            placed = list(zip([m.bodies[i] for i in places], _anchors(m, k, joint), strict=True))
        a, b = (LoopEnd(make_distinct(f"loop{len(found)}:{body}", taken), body, T) for body, T in placed)
        found.append(LoopTie(a, b, joint))
    return found


def _anchors(m: ModelArrays, k: int, joint: str) -> list[np.ndarray]:
    """The frames on two bodies: the anchors of a connection, or that of a weld and where it is to be."""
    data = m["eq_data"][k]
    at = [lie.pose(np.eye(3), data[3 * i : 3 * i + 3, None]) for i in range(2)]
    if joint == "fixed":
        related = lie.pose(lie.from_quaternion(data[6:10]), data[3:6, None])
        at = [related @ at[0], at[0]]
    return at


def close_ties(m: ModelArrays, mechanism: Mechanism, tied: Sequence[LoopTie]) -> Mechanism:
    """The mechanism with its loops closed; they stay open if the joints with actuators do not determine the motion."""
    loops = []
    for tie in tied:
        if {tie.a.frame, tie.b.frame} <= set(mechanism.frame_names):
            with suppress(JounceError):  # between bodies that are welded to each other
                loops.append(build_loop(mechanism, tie.a.frame, tie.b.frame, tie.joint))
    if not loops:
        return mechanism
    mechanism = replace(mechanism, loops=tuple(loops))
    driven = m["actuator_trnid"][np.isin(m["actuator_trntype"], JOINT_TRANSMISSION_TYPES), 0]
    motors = [name for name in mechanism.coordinates if name in {m.joints[j] for j in driven}]
    try:
        positions.check_single_screws(mechanism, "closed loops")
        if mechanism.floats and any(-1 in (loop.a.body, loop.b.body) for loop in loops):
            raise JounceError("some hold the base to the ground, which makes its pose a coordinate")
        start: Mapping[str, float] = {
            name: float(m["qpos0"][m["jnt_qposadr"][m.joints.index(name)]]) for name in mechanism.coordinates
        }
        if not motors:
            raise JounceError("no joint has an actuator")
        return with_loops(mechanism, actuated=motors, start=start)
    except JounceError as error:
        warn(f"{m.place}: its loops stay open{Remedy(', robot.closed(actuated=[...]) closes them')}: {error}")
        return mechanism


def warn_of_ignored(m: ModelArrays, ties: int, floats: bool) -> None:
    """Warn of terms of MuJoCo's inverse dynamics that jounce ignores, including `ties` equality constraints.

    Contacts, limits and the laws of actuators are not among these terms: Q is the force that they must supply.
    """
    elsewhere = ~np.isin(m["actuator_trntype"], JOINT_TRANSMISSION_TYPES)
    trains = _nonzero_rows(m, "actuator_armature", "actuator_damping", "actuator_dampingpoly")
    found: dict[str, int | np.bool_ | np.ndarray] = {
        "equality constraints": ties,
        "tendons that pull or resist": _nonzero_rows(m, "tendon_stiffness", "tendon_damping", "tendon_frictionloss"),
        "armatures of tendons": _nonzero_rows(m, "tendon_armature"),
        "drive trains of actuators at no joint": trains & elsewhere,
        "springs of ball joints": (m["jnt_type"] == BALL_JOINT_TYPE) & (m["jnt_stiffness"] != 0),
        "springs that are not linear": _nonzero_rows(m, "jnt_stiffnesspoly", "jnt_springyield"),
        "dampers that are not linear": _nonzero_rows(m, "dof_dampingpoly"),
        "dampers of actuators that are not linear": _nonzero_rows(m, "actuator_dampingpoly") & ~elsewhere,
        "bodies with gravity compensation": _nonzero_rows(m, "body_gravcomp"),
        "bodies with a plugin": m["body_plugin"] >= 0,
        "armature, damping, friction and springs of the free joint": floats and _free_drives(m).any(),
        "flexible bodies": m["nflex"],
        "drag and lift of the fluid": m.fluid,
    }
    counted = {what: int(np.sum(which)) for what, which in found.items()}
    said = [f"{what} ({n})" if n > 1 else what for what, n in counted.items() if n]
    if said:
        warn(f"{m.place}: ignored, since not part of a tree of rigid bodies: {', '.join(said)}")


def _free_drives(m: ModelArrays) -> np.ndarray:
    """Return the numbers of the drive trains of free joints."""
    joints = np.flatnonzero(m["jnt_type"] == FREE_JOINT_TYPE)
    rows = (m["jnt_dofadr"][joints, None] + np.arange(6)).ravel()
    of_dofs = [m[f"dof_{name}"][rows] for name in ("armature", "damping", "frictionloss")]
    return np.concatenate([*of_dofs, m["jnt_stiffness"][joints]])


def _nonzero_rows(m: ModelArrays, *names: str) -> np.ndarray:
    """Return which rows of arrays of equal length have a nonzero entry; missing arrays are skipped."""
    there = [m[name] for name in names if m[name].ndim]
    return np.any([array.any(axis=tuple(range(1, array.ndim))) for array in there], axis=0)


@contextmanager
def collect_mujoco_warnings(mujoco: Any) -> Iterator[list[str]]:
    """Collect MuJoCo's warnings, which it would print and append to MUJOCO_LOG.TXT in the current folder."""
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        yield said
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def free_assets(mujoco: Any) -> Iterator[None]:
    """Free the meshes and textures that MuJoCo caches, up to 500 MB, unless the program has read models by itself."""
    find = getattr(mujoco, "mj_getCache", None)  # which old versions do not have
    cache = find() if find else None
    empty = cache is not None and mujoco.mj_getCacheSize(cache) == 0
    try:
        yield
    finally:
        if empty:
            mujoco.mj_clearCache(cache)
