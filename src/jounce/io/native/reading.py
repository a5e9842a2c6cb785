"""Reading robot files of jounce's own format: names, the tree and the coordinates; every entry is checked."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError, locate_errors, quote_value, unknown_name_error
from jounce.io.entries import Entry
from jounce.io.native import BAND_KEY, BASE_KEY, GROUND_NAME, body_entries, contacts, elastic, loops
from jounce.model.coordinates import check_coordinate_names
from jounce.model.drives import UNDRIVEN
from jounce.model.frame import Frame
from jounce.model.mechanism import GRAVITY, Mechanism
from jounce.model.screws import from_screws
from jounce.model.stated_limits import limits_of_joints

Index = Mapping[str, int]  # names and their places in a row
Variable = tuple[str, np.ndarray, Entry]  # of a joint: its name, its screw, and what states its limits and drive


def read(robot: Entry, gravity: object = None, base: str | None = None) -> Mechanism:
    """The mechanism of a file's content, under its own gravity unless another is given; ``base="fixed"`` welds it."""
    optional = ("name", "gravity", BASE_KEY, "coordinates", "frames", "limits_of", BAND_KEY, elastic.ELASTIC_SECTION)
    robot.keys(("units", "bodies"), (*optional, loops.LOOPS_SECTION, *loops.LOOP_KEYS, contacts.CONTACTS_SECTION))
    body_entries.check_units(robot)
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
    variables = [body_entries.variables(joint) for joint in joints]
    _distinct_names([*stated, *bodies, *frames])
    if GROUND_NAME in names:
        raise bodies[names[GROUND_NAME]].get("name").error("another name: it denotes the ground")
    places = {stated[0].get("name").value if stated else GROUND_NAME: -1, **names}
    floats = bool(stated) and base != "fixed"
    built = _build_mechanism(
        robot, stated, floats, bodies, joints, variables, places, own if gravity is None else gravity
    )
    placed = [
        Frame(f.get("name").value, _carrier_index(f.get("body"), places) + floats, body_entries.pose(f)) for f in frames
    ]
    if stated and not floats:
        placed = [Frame(next(iter(places)), -1, np.eye(4)), *placed]
    joint_names = tuple(name for own in variables for name, *_ in own)
    tree = replace(built, joints=joint_names, frames=tuple(placed), confirmed_band=_read_band(robot))
    return contacts.read(robot, elastic.read(robot, loops.read(robot, check_coordinate_names(tree))))


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
        [body_entries.limits(stated) for *_, stated in each],
        [body_entries.drive(stated) for *_, stated in each],
    )
    name, M = robot.get("name", robot.path.stem).text(), [body_entries.inertia(body) for body in bodies]
    B = [body_entries.pose(body) for body in bodies]
    with locate_errors(robot.path):
        M_base = body_entries.inertia(base[0]) if base else None
        return from_screws(
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
            limits=limits_of_joints(limits, body_entries.limits_without_gravity(robot)),
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
