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

A joint follows others by factors, or one by a polynomial of ascending coefficients:

    joint: {name: slide, type: prismatic, axis: [1, 0, 0], follows: {coordinates: {knee: 0.02}, offset: 0.001}}
    joint: {name: cam, type: revolute, axis: [1, 0, 0], follows: {coordinate: knee, polynomial: [0.1, 0.2, -0.3]}}

A robot that floats states its base, which is the parent of bodies and frames instead of the ground:

base: {name: trunk, inertia: {mass: 9, com: [0, 0, 0], inertia: [0.1, 0, 0, 0.2, 0, 0.2]}}

`read` is the door: it reads the names, the tree and the coordinates, and checks every entry. Below it stand the readers
of one body: of its pose, joint screw, limits, drive and inertia, each in a readable or an exact form. Tables of
Denavit-Hartenberg parameters and files of limits use them too. The sections behind the bodies are in
`jounce.io.robot_sections`; `jounce.io.robot_writing` writes what is read here.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jounce.core.errors import JounceError, check_choice, locate_errors, quote_value, unknown_name_error
from jounce.io import robot_sections
from jounce.io.entries import Entry
from jounce.io.orientation import from_rpy, unit_direction
from jounce.model import coordinates, screws
from jounce.model.drive_trains import UNDRIVEN, drive_error
from jounce.model.frame import Frame
from jounce.model.limits import (
    BOUNDED_FORCES,
    LIMIT_KINDS,
    POSITION_ENDS,
    StatedLimit,
    limit_error,
    limits_of_joints,
)
from jounce.model.mechanism import GRAVITY, Mechanism
from jounce.model.polynomials import PolynomialLaw, with_polynomials
from jounce.spatial import groups, lie
from jounce.spatial.groups import Group
from jounce.spatial.inertia import inertia_matrix, symmetric_matrix

GROUND_NAME = "ground"  # what roots stand on; no name of a body
BASE_KEY = "base"
BAND_KEY = "confirmed_band"  # Hz, up to which torques confirmed positions where the robot was identified
FILE_UNITS = "SI"
POLYNOMIAL_KEY = "polynomial"
Index = Mapping[str, int]  # names and their places in a row
Variable = tuple[str, np.ndarray, Entry]  # of a joint: its name, its screw, and what states its limits and drive


def read(robot: Entry, gravity: object = None, base: str | None = None) -> Mechanism:
    """Return the mechanism of a robot file's content.

    It is under its own gravity unless another is given; ``base="fixed"`` welds a base that floats.
    """
    _check_robot_keys(robot)
    check_units(robot)
    gravity_of_file = robot.get("gravity", list(GRAVITY)).numbers((3,))
    parts = _read_parts(robot, base)
    built = _build_mechanism(robot, parts, gravity_of_file if gravity is None else gravity)
    # A base that floats is the first body: indices of carriers are one more.
    frames = [
        Frame(f.get("name").value, _carrier_index(f.get("body"), parts.places) + parts.floats, read_pose(f))
        for f in parts.frames
    ]
    # The name of a base that is welded stays, as that of a frame on the ground.
    if parts.base is not None and not parts.floats:
        frames = [Frame(parts.root_name, -1, np.eye(4)), *frames]
    joint_names = tuple(name for variables in parts.variables for name, *_ in variables)
    tree = replace(built, joints=joint_names, frames=tuple(frames), confirmed_band=_read_band(robot))
    # Loops come first, as springs and contacts need the coordinates of the closed robot.
    tree = coordinates.check_coordinate_names(tree)
    curved = _read_polynomials(parts.joints, tree)
    if curved.is_closed:
        for key in (robot_sections.LOOPS_SECTION, *robot_sections.LOOP_KEYS):
            if key in robot.value:
                raise robot.get(key).error("none: joints follow by polynomials, and their leaders have the motors")
    closed = curved if curved.is_closed else robot_sections.read_loops(robot, tree)
    elastic = robot_sections.read_elastic(robot, closed)
    return robot_sections.read_contacts(robot, elastic)


def _check_robot_keys(robot: Entry) -> None:
    optional = ("name", "gravity", BASE_KEY, "coordinates", "frames", "limits_of", *LIMIT_KINDS.totals, BAND_KEY)
    sections = (
        robot_sections.ELASTIC_SECTION,
        robot_sections.LOOPS_SECTION,
        *robot_sections.LOOP_KEYS,
        robot_sections.CONTACTS_SECTION,
    )
    robot.keys(("units", "bodies"), (*optional, *sections))


@dataclass(frozen=True)
class RobotParts:
    """The entries of a robot's base, bodies, joints and frames.

    `places` are the indices of bodies by name, after the base or the ground, which has -1. `variables` are those of
    each joint.
    """

    base: Entry | None
    floats: bool
    bodies: Sequence[Entry]
    joints: Sequence[Entry]
    variables: Sequence[Sequence[Variable]]
    frames: Sequence[Entry]
    places: Index

    @property
    def root_name(self) -> str:
        """The name of what the first bodies stand on: the base or the ground."""
        return next(iter(self.places))


def _read_parts(robot: Entry, base: str | None) -> RobotParts:
    """Return the entries of a robot's parts, whose names are checked."""
    listed_bodies = robot.get("bodies").items(least=1)
    bodies = [
        _named_entry("body", body.keys(("name", "parent", "joint"), ("pose", "inertia"))) for body in listed_bodies
    ]
    joints = [_named_entry("joint", body.get("joint")) for body in bodies]
    frames = [
        _named_entry("frame", frame.keys(("name", "body"), ("pose",))) for frame in robot.get("frames", []).items()
    ]
    base_entry = _read_base(robot, base)
    # Bodies, joints, and all that carries or is carried have distinct names; a joint may have the name of a body.
    names = _distinct_names(bodies)
    _distinct_names(joints)
    variables = [read_variables(joint) for joint in joints]
    bases = [] if base_entry is None else [base_entry]
    _distinct_names([*bases, *bodies, *frames])
    if GROUND_NAME in names:
        raise bodies[names[GROUND_NAME]].get("name").error("another name: it denotes the ground")
    root_name = GROUND_NAME if base_entry is None else base_entry.get("name").value
    floats = base_entry is not None and base != "fixed"
    return RobotParts(base_entry, floats, bodies, joints, variables, frames, {root_name: -1, **names})


def _read_band(robot: Entry) -> float | None:
    """Return the frequency in Hz of a confirmed band, if stated.

    Up to it torques confirmed positions where the robot was identified.
    """
    if BAND_KEY not in robot.value:
        return None
    entry = robot.get(BAND_KEY)
    if not entry.number() > 0:
        raise entry.error("a frequency in Hz, above 0")
    return entry.number()


def _read_base(robot: Entry, base: str | None) -> Entry | None:
    """Return the base that a file states, if it does.

    Raises `JounceError` if the robot is to float and the file states no base.
    """
    if BASE_KEY not in robot.value:
        if base == "floating":
            needs = f"{BASE_KEY!r}, a name and an inertia, as `jounce convert --base floating` writes it"
            raise JounceError(f"{robot.place}: {robot.what} stands on the ground; to float it needs {needs}")
        return None
    entry = _named_entry(BASE_KEY, robot.get(BASE_KEY).keys(("name",), ("inertia",)))
    if entry.get("name").value == GROUND_NAME:
        raise entry.get("name").error("another name: it denotes the ground")
    return entry


def _build_mechanism(robot: Entry, parts: RobotParts, gravity: object) -> Mechanism:
    """Return the mechanism of bodies on joints.

    It has the names of coordinates in place of those of joints, and no frames yet.
    """
    parent = [_carrier_index(body.get("parent"), parts.places, i) for i, body in enumerate(parts.bodies)]
    # One row for each joint variable: its joint, name, screw, and the entry of its limits and drive.
    rows = [
        (joint, *variable)
        for joint, variables in zip(parts.joints, parts.variables, strict=True)
        for variable in variables
    ]
    # theta = G q + g: variables that follow are sums of coordinates, and each coordinate moves a variable.
    coordinates = _coordinates(robot, rows)
    G, g = _coupling(rows, coordinates)
    for coordinate, column in zip(coordinates, G.T, strict=True):
        if not column.any():
            raise robot.get("coordinates").error(f"a joint that moves with {quote_value(coordinate)}")
    limits = [read_limits(entry) for *_, entry in rows]
    drives = [read_drive(entry) for *_, entry in rows]
    name = robot.get("name", robot.path.stem).text()
    M = [read_inertia(body) for body in parts.bodies]
    B = [read_pose(body) for body in parts.bodies]
    with locate_errors(robot.path):
        # The inertia of a base is checked also where it is welded.
        M_base = None if parts.base is None else read_inertia(parts.base)
        options = screws.ScrewOptions(
            names=tuple(parts.places)[1:],
            gravity=gravity,
            joint_names=tuple(coordinates),
            owners=[i for i, variables in enumerate(parts.variables) for _ in variables],
            G=G,
            g=g,
            limits=limits_of_joints(limits, limits_without_gravity(robot)).with_totals(read_totals(robot)),
            drives={key: [drive[key] for drive in drives] for key in UNDRIVEN},
            base=M_base if parts.floats else None,
            base_name=parts.root_name,
            name=name,
        )
        X = np.stack([screw for _, _, screw, _ in rows])
        return screws.from_screws(np.stack(B), X, np.stack(M), parent, options)


def _named_entry(kind: str, entry: Entry) -> Entry:
    """Return an entry that messages call by its name."""
    return entry.named(f"{kind} {quote_value(entry.need('name').text())}")


def _distinct_names(entries: Sequence[Entry]) -> Index:
    """Return the names of entries in their order, all different."""
    places: dict[str, str] = {}
    for entry in entries:
        name = entry.get("name")
        if name.value in places:
            raise JounceError(f"{name.place}: second {entry.what}; the first is at {places[name.value]}")
        places[name.value] = name.place
    return {name: i for i, name in enumerate(places)}


def _carrier_index(entry: Entry, places: Index, before: int | None = None) -> int:
    """Return the index of the body that an entry names.

    The body must be one of the first `before`; -1 is the ground or the base.
    """
    name = entry.text()
    if name not in places:
        floats = "" if GROUND_NAME in places else "the robot floats: "
        raise JounceError(f"{entry.place}: {entry.what}: {floats}{unknown_name_error('body', name, places)}")
    if before is not None and places[name] >= before:
        raise entry.error(f"{'the ground' if GROUND_NAME in places else 'the base'} or a body above")
    return places[name]


def _coordinates(robot: Entry, variables: Sequence[tuple[Entry, *Variable]]) -> Index:
    """Return the names of the coordinates with their places.

    They are those that the file lists, or else the joint variables that follow nothing.
    """
    free = {name: joint for joint, name, *_ in variables if not _follows_linearly(joint)}
    if "coordinates" not in robot.value:
        if len(free) == 0:
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


def _follows_linearly(joint: Entry) -> bool:
    """Whether a joint follows coordinates by constant factors.

    Those that follow by polynomials are coordinates of the tree.
    """
    if "follows" not in joint.value:
        return False
    stated = joint.get("follows").value
    return not (isinstance(stated, Mapping) and POLYNOMIAL_KEY in stated)


def _read_polynomials(joints: Sequence[Entry], tree: Mechanism) -> Mechanism:
    """Return the mechanism with joints that follow by polynomials."""
    laws: dict[str, PolynomialLaw] = {}
    for joint in joints:
        if "follows" in joint.value and not _follows_linearly(joint):
            follows = joint.get("follows").keys(("coordinate", POLYNOMIAL_KEY))
            coefficients = [number.number() for number in follows.get(POLYNOMIAL_KEY).items(least=1)]
            laws[joint.get("name").value] = PolynomialLaw(follows.get("coordinate").text(), tuple(coefficients))
            with locate_errors(follows.place):
                check_choice("coordinate", laws[joint.get("name").value].leader, tree.coordinates, joint.what)
    if len(laws) == 0:
        return tree
    with locate_errors(joints[0].place):
        return with_polynomials(tree, laws)


def _coupling(variables: Sequence[tuple[Entry, *Variable]], coordinates: Index) -> tuple[np.ndarray, np.ndarray]:
    """Return G and g of the variables ``theta = G q + g``."""
    G, g = np.zeros((len(variables), len(coordinates))), np.zeros(len(variables))
    for i, (joint, variable_name, *_) in enumerate(variables):
        if not _follows_linearly(joint):
            G[i, coordinates[variable_name]] = 1
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
    """Raise `JounceError` for a file of other units than SI."""
    units = robot.get("units")
    if units.value != FILE_UNITS:
        raise units.error(f"{FILE_UNITS}: m, kg, s, rad")


def read_pose(owner: Entry, key: str = "pose", angle: float = 1.0) -> np.ndarray:
    """Return the pose (4, 4) of a body or frame.

    It is a position with rotation or rpy, or a matrix; what is left out is the identity. `angle` is the unit of rpy in
    rad.
    """
    entry = owner.get(key, {}).keys((), ("position", "rotation", "rpy", "matrix"))
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
    # The pose stays as it is written: `from_screws` makes it exact, and a frame is read back as it was written.
    return T + 0.0


def read_screw(joint: Entry) -> np.ndarray:
    """Return the joint screw (6,).

    It is stated by type, axis (of any length), point and pitch, or by its six numbers.
    """
    if joint.alone("screw", ("type", "axis", "point", "pitch")):
        entry = joint.keys(("name", "screw"), COMMON_JOINT_KEYS).get("screw")
        with locate_errors(entry.place):
            return screws.exact_screw(entry.numbers((6,)), entry.what)
    # A type needs some keys and may have others.
    kind = joint.need("type", ("name", "type", "axis"))
    if kind.text() not in SINGLE_JOINT_KEYS:
        types = (*SINGLE_JOINT_KEYS, *groups.GROUPS)
        raise JounceError(f"{kind.place}: {joint.what}: {unknown_name_error('joint type', kind.value, types)}")
    needed, optional = SINGLE_JOINT_KEYS[kind.value]
    joint.keys(("name", "type", *needed), (*optional, *COMMON_JOINT_KEYS))
    axis = unit_direction(joint.get("axis").numbers((3,)))
    if axis is None:
        raise joint.get("axis").error("a direction")
    return axis_screw(kind.value, axis, joint.get("point", [0, 0, 0]).numbers((3,)), joint.get("pitch", 0).number())


def read_variables(joint: Entry) -> list[tuple[str, np.ndarray, Entry]]:
    """Return the variables of a joint.

    Each has a name, a screw, and the entry that states its limits and its drive.
    """
    name, kind = joint.get("name").value, joint.value.get("type")
    if not isinstance(kind, str) or kind not in groups.GROUPS:
        return [(name, read_screw(joint), joint)]
    group = groups.GROUPS[kind]
    joint.keys(("name", "type"), ("point", "screws", "velocities"))
    # The screws X (k, 6) are stated, or follow from the point that the axes pass through.
    if joint.alone("screws", ("point",)):
        screws_entry = joint.get("screws")
        X = screws_entry.numbers((len(group.axes), 6))
        match = groups.find_group(X.T)
        if match is None or match[0] is not group:
            raise screws_entry.error(f"the screws of a {kind} joint: {', '.join(group.velocities)} in some frame")
    else:
        X = place_screws(group, joint.get("point", [0, 0, 0]).numbers((3,)))
    velocities = joint.get("velocities", {}).keys((), group.velocities)
    entries = [velocities.get(v, {}).keys((), ("limits", "drive")) for v in group.velocities]
    return [(f"{name}.{v}", x, entry) for v, x, entry in zip(group.velocities, X, entries, strict=True)]


def place_screws(group: Group, point: np.ndarray) -> np.ndarray:
    """Return the screws (k, 6) of a joint through a point.

    The point is one of the body, in its axes.
    """
    return (lie.Ad(lie.pose(np.eye(3), point[:, None])) @ group.X).T


def axis_screw(kind: str, axis: np.ndarray, point: np.ndarray, pitch: float) -> np.ndarray:
    """Return the screw of a unit axis e through a point x.

    It is (e; x cross e), for a helical joint (e; x cross e + h e), for a prismatic one (0; e).
    """
    if kind == "prismatic":
        return np.concatenate([np.zeros(3), axis])
    return np.concatenate([axis, np.cross(point, axis) + pitch * axis])


def read_limits(joint: Entry, entry: Entry | None = None) -> dict[str, StatedLimit]:
    """Return the limits of a joint variable.

    Each is a number or [lower, upper]. They are stated in `entry`, or in the limits of the joint.
    """
    entry = joint.get("limits", {}) if entry is None else entry
    entry.keys((), LIMIT_KINDS.bound_names)
    limits = {key: _read_bound(key, value) for key, value in entry.members().items()}
    error = limit_error(**limits)
    if error is not None:
        raise JounceError(f"{entry.place}: {joint.what}: {error}")
    return limits


def read_totals(document: Entry) -> dict[str, StatedLimit]:
    """Return the limits of the whole robot that a document states."""
    members = document.members()
    limits = {}
    for kind in (kind for kind in LIMIT_KINDS.totals if kind in members):
        if isinstance(members[kind].value, Mapping | list) and len(members[kind].value) != len(POSITION_ENDS):
            raise members[kind].error(
                "a number for the whole robot, or two: [lower, upper]; joints have limits of their own"
            )
        limits[kind] = _read_bound(kind, members[kind])
    for kind, value in limits.items():
        error = limit_error(**{kind: value})
        if error is not None:
            raise JounceError(f"{members[kind].place}: {error}")
    return limits


def _read_bound(key: str, entry: Entry) -> StatedLimit:
    """Return a limit; an end that is null is unbounded."""
    if key in POSITION_ENDS or not isinstance(entry.value, list):
        return entry.number()
    ends = entry.items()
    if len(ends) != 2:
        raise entry.error("a number, or two: [lower, upper]")
    unbounded = (-math.inf, math.inf)
    return tuple(free if end.value is None else end.number() for end, free in zip(ends, unbounded, strict=True))


def limits_without_gravity(robot: Entry) -> tuple[str, ...]:
    """Return the effort limits that bound Q - Qgrav.

    They are named by the `limits_of` of a robot.
    """
    entry = robot.get("limits_of", {}).keys((), LIMIT_KINDS.effort)
    for force in entry.members().values():
        if force.value not in BOUNDED_FORCES:
            raise force.error(" or ".join(BOUNDED_FORCES))
    return tuple(kind for kind in LIMIT_KINDS.effort if entry.value.get(kind) == BOUNDED_FORCES[1])


def read_drive(joint: Entry) -> dict[str, float]:
    """Return the drive train of a joint variable.

    What is left out is zero.
    """
    entry = joint.get("drive", {}).keys((), tuple(UNDRIVEN))
    drive = UNDRIVEN | {key: number.number() for key, number in entry.members().items()}
    error = drive_error(**drive)
    if error is not None:
        raise JounceError(f"{entry.place}: {joint.what}: {error}")
    return drive


def read_inertia(body: Entry) -> np.ndarray:
    """Return the inertia matrix (6, 6) of a body.

    It is stated by mass, com and the inertia about it, or by its 36 numbers; a body without an inertia has zeros.
    """
    if "inertia" not in body.value:
        return np.zeros((6, 6))
    entry = body.get("inertia").keys((), ("mass", "com", "inertia", "rotation", "matrix"))
    if entry.alone("matrix", ("mass", "com", "inertia", "rotation")):
        M = entry.get("matrix").numbers((6, 6))
    else:
        entry.keys(("mass", "com", "inertia"), ("rotation",))
        mass, com = entry.get("mass").number(), entry.get("com").numbers((3,))
        # Six numbers xx, xy, xz, yy, yz, zz, or all nine.
        theta = entry.get("inertia").numbers((6,), (3, 3))
        theta = theta if theta.ndim == 2 else symmetric_matrix(theta)
        R = entry.get("rotation").numbers((3, 3)) if "rotation" in entry.value else None
        with locate_errors(entry.place):
            M = inertia_matrix(mass, com, theta, rotation=R)
    with locate_errors(entry.place):
        return screws.exact_inertia(M, entry.what)
