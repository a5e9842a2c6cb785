"""One body in a robot file: its pose, joint screw, limits and inertia, each in a readable or an exact form."""

import math

import numpy as np

from jounce.core.errors import JounceError, locate_errors, unknown_name_error
from jounce.io.entries import Entry
from jounce.io.native import FILE_UNITS
from jounce.io.orientation import from_rpy, unit_direction
from jounce.model.drives import UNDRIVEN, drive_error
from jounce.model.limit_kinds import BOUNDED_FORCES, EFFORT_KINDS, LIMIT_KEYS, POSITION_ENDS
from jounce.model.screws import exact_inertia, exact_pose, exact_screw
from jounce.model.stated_limits import StatedLimit, limit_error
from jounce.spatial import lie
from jounce.spatial.groups import GROUPS, Group, find_group
from jounce.spatial.inertia import inertia_matrix, symmetric_matrix

SINGLE_JOINT_KEYS = {  # of joints: the keys that each needs, and those it may have
    "revolute": (("axis",), ("point",)),
    "prismatic": (("axis",), ()),
    "helical": (("axis", "pitch"), ("point",)),
}
IDENTITY_ROWS = np.eye(3).tolist()
COMMON_JOINT_KEYS = ("limits", "drive", "follows")  # keys of every joint


def check_units(robot: Entry) -> None:
    """Refuse a file of other units than SI."""
    units = robot.get("units")
    if units.value != FILE_UNITS:
        raise units.error(f"{FILE_UNITS}: m, kg, s, rad")


def pose(carried: Entry, key: str = "pose", angle: float = 1.0) -> np.ndarray:
    """The pose of a body or frame: position with rotation or rpy, or a 4x4 matrix; what is left out is the identity.

    `angle` is the unit of rpy in rad.
    """
    entry = carried.get(key, {}).keys((), ("position", "rotation", "rpy", "matrix"))
    if entry.alone("matrix", ("position", "rotation", "rpy")):
        T = entry.get("matrix").numbers((4, 4))
    else:
        if entry.alone("rpy", ("rotation",)):
            R = from_rpy(angle * entry.get("rpy").numbers((3,)), entry.get("rpy").place)
        else:
            R = entry.get("rotation", IDENTITY_ROWS).numbers((3, 3))
        T = lie.pose(R, entry.get("position", [0, 0, 0]).numbers((3,))[:, None])
    with locate_errors(entry.place):
        exact_pose(T, entry.what)
    return T + 0.0  # as it stands: `from_screws` makes it exact, and a frame is read back as it was written


def screw(joint: Entry) -> np.ndarray:
    """The joint screw: of type, axis (of any length), point and pitch, or its six numbers."""
    if joint.alone("screw", ("type", "axis", "point", "pitch")):
        given = joint.keys(("name", "screw"), COMMON_JOINT_KEYS).get("screw")
        with locate_errors(given.place):
            return exact_screw(given.numbers((6,)), given.what)
    kind = joint.need("type", ("name", "type", "axis"))
    if kind.text() not in SINGLE_JOINT_KEYS:
        known = (*SINGLE_JOINT_KEYS, *GROUPS)
        raise JounceError(f"{kind.place}: {joint.what}: {unknown_name_error('joint type', kind.value, known)}")
    needed, optional = SINGLE_JOINT_KEYS[kind.value]
    joint.keys(("name", "type", *needed), (*optional, *COMMON_JOINT_KEYS))
    axis = unit_direction(joint.get("axis").numbers((3,)))
    if axis is None:
        raise joint.get("axis").error("a direction")
    return axis_screw(kind.value, axis, joint.get("point", [0, 0, 0]).numbers((3,)), joint.get("pitch", 0).number())


def variables(joint: Entry) -> list[tuple[str, np.ndarray, Entry]]:
    """The variables of a joint: the name of each, its screw, and the entry that states its limits and its drive."""
    name, kind = joint.get("name").value, joint.value.get("type")
    if not isinstance(kind, str) or kind not in GROUPS:
        return [(name, screw(joint), joint)]
    group = GROUPS[kind]
    joint.keys(("name", "type"), ("point", "screws", "velocities"))
    if joint.alone("screws", ("point",)):
        given = joint.get("screws")
        X = given.numbers((len(group.axes), 6))
        if (spanned := find_group(X.T)) is None or spanned[0] is not group:
            raise given.error(f"the screws of a {kind} joint: {', '.join(group.velocities)} in some frame")
    else:
        X = place_screws(group, joint.get("point", [0, 0, 0]).numbers((3,)))
    stated = joint.get("velocities", {}).keys((), group.velocities)
    entries = [stated.get(v, {}).keys((), ("limits", "drive")) for v in group.velocities]
    return [(f"{name}.{v}", x, entry) for v, x, entry in zip(group.velocities, X, entries, strict=True)]


def place_screws(group: Group, point: np.ndarray) -> np.ndarray:
    """The screws (k, 6) of a joint of several through a point of the body, in its axes."""
    return (lie.Ad(lie.pose(np.eye(3), point[:, None])) @ group.X).T


def axis_screw(kind: str, axis: np.ndarray, point: np.ndarray, pitch: float) -> np.ndarray:
    """The screw of a unit axis e through a point x: (e; x cross e), helical (e; x cross e + h e), prismatic (0; e)."""
    if kind == "prismatic":
        return np.concatenate([np.zeros(3), axis])
    return np.concatenate([axis, np.cross(point, axis) + pitch * axis])


def limits(joint: Entry, entry: Entry | None = None) -> dict[str, StatedLimit]:
    """The limits of a joint variable, stated in an entry of its own or its joint's: a number, or [lower, upper]."""
    entry = (entry or joint.get("limits", {})).keys((), LIMIT_KEYS)
    stated = {key: _read_bound(key, value) for key, value in entry.members().items()}
    if error := limit_error(**stated):
        raise JounceError(f"{entry.place}: {joint.what}: {error}")
    return stated


def _read_bound(key: str, entry: Entry) -> StatedLimit:
    if key in POSITION_ENDS or not isinstance(entry.value, list):
        return entry.number()
    if len(ends := entry.items()) != 2:
        raise entry.error("a number, or two: [lower, upper]")
    unbounded = (-math.inf, math.inf)
    return tuple(free if end.value is None else end.number() for end, free in zip(ends, unbounded, strict=True))


def limits_without_gravity(robot: Entry) -> tuple[str, ...]:
    """Those effort limits that a robot's `limits_of` says to be of Q - Qgrav."""
    entry = robot.get("limits_of", {}).keys((), EFFORT_KINDS)
    for force in entry.members().values():
        if force.value not in BOUNDED_FORCES:
            raise force.error(" or ".join(BOUNDED_FORCES))
    return tuple(kind for kind in EFFORT_KINDS if entry.value.get(kind) == BOUNDED_FORCES[1])


def drive(joint: Entry) -> dict[str, float]:
    """The drive train of a joint variable, zero where it is left out."""
    entry = joint.get("drive", {}).keys((), tuple(UNDRIVEN))
    stated = UNDRIVEN | {key: number.number() for key, number in entry.members().items()}
    if error := drive_error(**stated):
        raise JounceError(f"{entry.place}: {joint.what}: {error}")
    return stated


def inertia(body: Entry) -> np.ndarray:
    """The inertia matrix: of mass, com and inertia about it, or its 36 numbers; zero where nothing is said."""
    if "inertia" not in body.value:
        return np.zeros((6, 6))
    entry = body.get("inertia").keys((), ("mass", "com", "inertia", "rotation", "matrix"))
    if entry.alone("matrix", ("mass", "com", "inertia", "rotation")):
        M = entry.get("matrix").numbers((6, 6))
    else:
        entry.keys(("mass", "com", "inertia"), ("rotation",))
        mass, com = entry.get("mass").number(), entry.get("com").numbers((3,))
        theta = entry.get("inertia").numbers((6,), (3, 3))
        R = entry.get("rotation").numbers((3, 3)) if "rotation" in entry.value else None
        with locate_errors(entry.place):
            M = inertia_matrix(mass, com, theta if theta.ndim == 2 else symmetric_matrix(theta), rotation=R)
    with locate_errors(entry.place):
        return exact_inertia(M, entry.what)
