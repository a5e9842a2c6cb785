"""Reads robot files of jounce's own format: YAML or JSON with all data of a mechanism.

They are readable and editable, and hold every number to the last bit:

name: arm
units: SI                       # m, kg, s, rad
gravity: [0, 0, -9.81]
bodies:
  - name: link1
    parent: ground              # or a body above
    pose: {position: [0, 0, 0.3], rpy: [0, 0, 1.57]}
    joint: {name: joint1, type: revolute, axis: [0, 0, 1], limits: {lower: -2, upper: 2}}
    inertia: {mass: 2, com: [0, 0, 0.1], inertia: [0.02, 0, 0, 0.02, 0, 0.01]}
frames:
  - {name: tool0, body: link1, pose: {position: [0, 0, 0.2]}}

A joint of several screws is a ball, planar or free; limits and drives are those of its velocities:

    joint: {name: rod, type: ball, point: [0, 0, 0.1], velocities: {wx: {drive: {damping: 0.1}}}}

A robot that floats states its base, which is the parent of bodies and frames instead of the ground:

base: {name: trunk, inertia: {mass: 9, com: [0, 0, 0], inertia: [0.1, 0, 0, 0.2, 0, 0.2]}}

`read` is the door: it reads the names, the tree and the coordinates, and checks every entry. Below it stand the readers
of one body: of its pose, joint screw, limits, drive and inertia, each in a readable or an exact form. Tables of
Denavit-Hartenberg parameters and files of limits use them too. The sections behind the bodies are in
`jounce.io.robot_sections`; `jounce.io.robot_writing` writes what is read here.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError, locate_errors, quote_value, unknown_name_error
from jounce.io import robot_sections
from jounce.io.entries import Entry
from jounce.io.orientation import from_rpy, unit_direction
from jounce.model import coordinates, screws
from jounce.model.drive_trains import UNDRIVEN, drive_error
from jounce.model.frame import Frame
from jounce.model.limits import BOUNDED_FORCES, LIMIT_KINDS, POSITION_ENDS, StatedLimit, limit_error, limits_of_joints
from jounce.model.mechanism import GRAVITY, Mechanism
from jounce.spatial import groups, lie
from jounce.spatial.groups import Group
from jounce.spatial.inertia import inertia_matrix, symmetric_matrix

GROUND_NAME = "ground"  # what roots stand on; no name of a body
BASE_KEY = "base"
BAND_KEY = "confirmed_band"  # Hz, up to which torques confirmed positions where the robot was identified
FILE_UNITS = "SI"
Index = Mapping[str, int]  # names and their places in a row
Variable = tuple[str, np.ndarray, Entry]  # of a joint: its name, its screw, and what states its limits and drive


def read(robot: Entry, gravity: object = None, base: str | None = None) -> Mechanism:
    """The mechanism of a file's content, under its own gravity unless another is given; ``base="fixed"`` welds it."""
    optional = (
        "name",
        "gravity",
        BASE_KEY,
        "coordinates",
        "frames",
        "limits_of",
        BAND_KEY,
        robot_sections.ELASTIC_SECTION,
    )
    robot.keys(
        ("units", "bodies"),
        (*optional, robot_sections.LOOPS_SECTION, *robot_sections.LOOP_KEYS, robot_sections.CONTACTS_SECTION),
    )
    check_units(robot)
    own = robot.get("gravity", list(GRAVITY)).numbers((3,))
    listed = robot.get("bodies").items(least=1)
    bodies = [_named_entry("body", body.keys(("name", "parent", "joint"), ("pose", "inertia"))) for body in listed]
    joints = [_named_entry("joint", body.get("joint")) for body in bodies]
    frames = [
        _named_entry("frame", frame.keys(("name", "body"), ("pose",))) for frame in robot.get("frames", []).items()
    ]
    stated = _read_base(robot, base)
    names = _distinct_names(bodies)
    _distinct_names(joints)
    variables = [read_variables(joint) for joint in joints]
    _distinct_names([*stated, *bodies, *frames])
    if GROUND_NAME in names:
        raise bodies[names[GROUND_NAME]].get("name").error("another name: it denotes the ground")
    places = {stated[0].get("name").value if stated else GROUND_NAME: -1, **names}
    floats = bool(stated) and base != "fixed"
    built = _build_mechanism(
        robot, stated, floats, bodies, joints, variables, places, own if gravity is None else gravity
    )
    placed = [Frame(f.get("name").value, _carrier_index(f.get("body"), places) + floats, read_pose(f)) for f in frames]
    if stated and not floats:
        placed = [Frame(next(iter(places)), -1, np.eye(4)), *placed]
    joint_names = tuple(name for own in variables for name, *_ in own)
    tree = replace(built, joints=joint_names, frames=tuple(placed), confirmed_band=_read_band(robot))
    return robot_sections.read_contacts(
        robot,
        robot_sections.read_elastic(robot, robot_sections.read_loops(robot, coordinates.check_coordinate_names(tree))),
    )


def _read_band(robot: Entry) -> float | None:
    """The frequency in Hz up to which torques confirmed positions of the robot, if the file states one."""
    if BAND_KEY not in robot.value:
        return None
    stated = robot.get(BAND_KEY)
    if not stated.number() > 0:
        raise stated.error("a frequency in Hz, above 0")
    return stated.number()


def _read_base(robot: Entry, base: str | None) -> list[Entry]:
    """The base that a file states, if it does; raise if it is to float and the file states none."""
    if BASE_KEY not in robot.value:
        if base == "floating":
            needs = f"{BASE_KEY!r}, a name and an inertia, as `jounce convert --base floating` writes it"
            raise JounceError(f"{robot.place}: {robot.what} stands on the ground; to float it needs {needs}")
        return []
    stated = _named_entry(BASE_KEY, robot.get(BASE_KEY).keys(("name",), ("inertia",)))
    if stated.get("name").value == GROUND_NAME:
        raise stated.get("name").error("another name: it denotes the ground")
    return [stated]


def _build_mechanism(
    robot: Entry,
    base: Sequence[Entry],
    floats: bool,
    bodies: Sequence[Entry],
    joints: Sequence[Entry],
    variables: Sequence[Sequence[Variable]],
    places: Index,
    gravity: object,
) -> Mechanism:
    """The mechanism of bodies on joints, but for the names of joints and for frames."""
    parent = [_carrier_index(body.get("parent"), places, i) for i, body in enumerate(bodies)]
    each = [(joint, *variable) for joint, own in zip(joints, variables, strict=True) for variable in own]
    coordinates = _coordinates(robot, each)
    G, g = _coupling(each, coordinates)
    for coordinate, column in zip(coordinates, G.T, strict=True):
        if not column.any():
            raise robot.get("coordinates").error(f"a joint that moves with {quote_value(coordinate)}")
    limits, drives = (
        [read_limits(stated) for *_, stated in each],
        [read_drive(stated) for *_, stated in each],
    )
    name, M = robot.get("name", robot.path.stem).text(), [read_inertia(body) for body in bodies]
    B = [read_pose(body) for body in bodies]
    with locate_errors(robot.path):
        M_base = read_inertia(base[0]) if base else None
        return screws.from_screws(
            np.stack(B),
            np.stack([x for _, _, x, _ in each]),
            np.stack(M),
            parent,
            tuple(places)[1:],
            gravity,
            joint_names=tuple(coordinates),
            owners=[i for i, own in enumerate(variables) for _ in own],
            G=G,
            g=g,
            limits=limits_of_joints(limits, limits_without_gravity(robot)),
            drives={key: [one[key] for one in drives] for key in UNDRIVEN},
            base=M_base if floats else None,
            base_name=next(iter(places)),
            name=name,
        )


def _named_entry(kind: str, entry: Entry) -> Entry:
    """An entry, called in messages by the name it has."""
    return entry.named(f"{kind} {quote_value(entry.need('name').text())}")


def _distinct_names(named: Sequence[Entry]) -> Index:
    """The names of entries in their order, all different."""
    places: dict[str, str] = {}
    for entry in named:
        name = entry.get("name")
        if name.value in places:
            raise JounceError(f"{name.place}: second {entry.what}; the first is at {places[name.value]}")
        places[name.value] = name.place
    return {name: i for i, name in enumerate(places)}


def _carrier_index(entry: Entry, places: Index, before: int | None = None) -> int:
    """The index of the body that an entry names, which must be one of the first `before`; -1 is the ground or base."""
    name = entry.text()
    if name not in places:
        floats = "" if GROUND_NAME in places else "the robot floats: "
        raise JounceError(f"{entry.place}: {entry.what}: {floats}{unknown_name_error('body', name, places)}")
    if before is not None and places[name] >= before:
        raise entry.error(f"{'the ground' if GROUND_NAME in places else 'the base'} or a body above")
    return places[name]


def _coordinates(robot: Entry, variables: Sequence[tuple[Entry, *Variable]]) -> Index:
    """The names of the coordinates: those listed, else the joint variables that follow nothing."""
    free = {name: joint for joint, name, *_ in variables if "follows" not in joint.value}
    if "coordinates" not in robot.value:
        if not free:
            cure = "'coordinates' must list those that they follow"
            raise JounceError(f"{robot.place}: every joint follows others; {cure}")
        return {name: j for j, name in enumerate(free)}
    listed = robot.get("coordinates")
    names = {name.text(): i for i, name in enumerate(listed.items(least=1))}
    if len(names) < len(listed.value):
        raise listed.error("different names")
    for name, joint in free.items():
        if name not in names:
            raise JounceError(f"{listed.place}: coordinates omit {joint.what}, which follows no other joint")
    return names


def _coupling(variables: Sequence[tuple[Entry, *Variable]], coordinates: Index) -> tuple[np.ndarray, np.ndarray]:
    """G and g of the joint variables ``theta = G q + g``."""
    G, g = np.zeros((len(variables), len(coordinates))), np.zeros(len(variables))
    for i, (joint, own, *_) in enumerate(variables):
        if "follows" not in joint.value:
            G[i, coordinates[own]] = 1
            continue
        follows = joint.get("follows").keys(("coordinates",), ("offset",))
        for name, factor in follows.get("coordinates").members().items():
            if name not in coordinates:
                raise JounceError(
                    f"{factor.place}: {joint.what}: {unknown_name_error('coordinate', name, coordinates)}"
                )
            G[i, coordinates[name]] = factor.number()
        g[i] = follows.get("offset", 0).number()
    return G, g


# One body: its pose, joint screw, limits, drive and inertia.
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


def read_pose(carried: Entry, key: str = "pose", angle: float = 1.0) -> np.ndarray:
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
        screws.exact_pose(T, entry.what)
    return T + 0.0  # as it stands: `from_screws` makes it exact, and a frame is read back as it was written


def read_screw(joint: Entry) -> np.ndarray:
    """The joint screw: of type, axis (of any length), point and pitch, or its six numbers."""
    if joint.alone("screw", ("type", "axis", "point", "pitch")):
        given = joint.keys(("name", "screw"), COMMON_JOINT_KEYS).get("screw")
        with locate_errors(given.place):
            return screws.exact_screw(given.numbers((6,)), given.what)
    kind = joint.need("type", ("name", "type", "axis"))
    if kind.text() not in SINGLE_JOINT_KEYS:
        known = (*SINGLE_JOINT_KEYS, *groups.GROUPS)
        raise JounceError(f"{kind.place}: {joint.what}: {unknown_name_error('joint type', kind.value, known)}")
    needed, optional = SINGLE_JOINT_KEYS[kind.value]
    joint.keys(("name", "type", *needed), (*optional, *COMMON_JOINT_KEYS))
    axis = unit_direction(joint.get("axis").numbers((3,)))
    if axis is None:
        raise joint.get("axis").error("a direction")
    return axis_screw(kind.value, axis, joint.get("point", [0, 0, 0]).numbers((3,)), joint.get("pitch", 0).number())


def read_variables(joint: Entry) -> list[tuple[str, np.ndarray, Entry]]:
    """The variables of a joint: the name of each, its screw, and the entry that states its limits and its drive."""
    name, kind = joint.get("name").value, joint.value.get("type")
    if not isinstance(kind, str) or kind not in groups.GROUPS:
        return [(name, read_screw(joint), joint)]
    group = groups.GROUPS[kind]
    joint.keys(("name", "type"), ("point", "screws", "velocities"))
    if joint.alone("screws", ("point",)):
        given = joint.get("screws")
        X = given.numbers((len(group.axes), 6))
        if (spanned := groups.find_group(X.T)) is None or spanned[0] is not group:
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


def read_limits(joint: Entry, entry: Entry | None = None) -> dict[str, StatedLimit]:
    """The limits of a joint variable, stated in an entry of its own or its joint's: a number, or [lower, upper]."""
    entry = (entry or joint.get("limits", {})).keys((), LIMIT_KINDS.bound_names)
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
    entry = robot.get("limits_of", {}).keys((), LIMIT_KINDS.effort)
    for force in entry.members().values():
        if force.value not in BOUNDED_FORCES:
            raise force.error(" or ".join(BOUNDED_FORCES))
    return tuple(kind for kind in LIMIT_KINDS.effort if entry.value.get(kind) == BOUNDED_FORCES[1])


def read_drive(joint: Entry) -> dict[str, float]:
    """The drive train of a joint variable, zero where it is left out."""
    entry = joint.get("drive", {}).keys((), tuple(UNDRIVEN))
    stated = UNDRIVEN | {key: number.number() for key, number in entry.members().items()}
    if error := drive_error(**stated):
        raise JounceError(f"{entry.place}: {joint.what}: {error}")
    return stated


def read_inertia(body: Entry) -> np.ndarray:
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
        return screws.exact_inertia(M, entry.what)
