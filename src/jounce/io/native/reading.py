"""Reading robot files of jounce's own format: names, the tree and the coordinates; every entry is checked."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from jounce.errors import JounceError, at, no_such, quoted
from jounce.io.entries import Entry
from jounce.io.native import GROUND, elastic, parts
from jounce.model.drives import UNDRIVEN
from jounce.model.limits import limits_of_joints
from jounce.model.mechanism import GRAVITY, Frame, Mechanism
from jounce.model.screws import from_screws

Index = Mapping[str, int]  # names and their places in a row


def read(robot: Entry, gravity: object = None) -> Mechanism:
    """The mechanism of a file's content, under its own gravity unless another is given."""
    robot.keys(("units", "bodies"), ("name", "gravity", "coordinates", "frames", "limits_of", elastic.SECTION))
    parts.check_units(robot)
    own = robot.get("gravity", list(GRAVITY)).numbers((3,))
    listed = robot.get("bodies").items(least=1)
    bodies = [_named_entry("body", body.keys(("name", "parent", "joint"), ("pose", "inertia"))) for body in listed]
    joints = [_named_entry("joint", body.get("joint")) for body in bodies]
    frames = [
        _named_entry("frame", frame.keys(("name", "body"), ("pose",))) for frame in robot.get("frames", []).items()
    ]
    names = _distinct_names(bodies)
    _distinct_names([*bodies, *frames])
    if GROUND in names:
        raise bodies[names[GROUND]].get("name").error("another name: it denotes the ground")
    built = _build(robot, bodies, joints, names, own if gravity is None else gravity)
    placed = (Frame(f.get("name").value, _carrier(f.get("body"), names), parts.pose(f)) for f in frames)
    return elastic.read(robot, replace(built, joints=tuple(_distinct_names(joints)), frames=tuple(placed)))


def _build(robot: Entry, bodies: Sequence[Entry], joints: Sequence[Entry], names: Index, gravity: object) -> Mechanism:
    """The mechanism of bodies on joints, but for the names of joints and for frames."""
    parent = [_carrier(body.get("parent"), names, i) for i, body in enumerate(bodies)]
    name, coordinates = robot.get("name", robot.path.stem).text(), _coordinates(robot, joints)
    G, g = _coupling(joints, coordinates)
    for coordinate, column in zip(coordinates, G.T, strict=True):
        if not column.any():
            raise robot.get("coordinates").error(f"a joint that moves with {quoted(coordinate)}")
    limits, drives = [parts.limits(joint) for joint in joints], [parts.drive(joint) for joint in joints]
    X, M = [parts.screw(joint) for joint in joints], [parts.inertia(body) for body in bodies]
    B = [parts.pose(body) for body in bodies]
    with at(robot.path):
        return from_screws(
            np.stack(B),
            np.stack(X),
            np.stack(M),
            parent,
            tuple(names),
            gravity,
            joint_names=tuple(coordinates),
            G=G,
            g=g,
            limits=limits_of_joints(limits, parts.without_gravity(robot)),
            drives={key: [one[key] for one in drives] for key in UNDRIVEN},
            name=name,
        )


def _named_entry(kind: str, entry: Entry) -> Entry:
    """An entry, called in messages by the name it has."""
    return entry.named(f"{kind} {quoted(entry.need('name').text())}")


def _distinct_names(named: Sequence[Entry]) -> Index:
    """The names of entries in their order, all different."""
    places: dict[str, str] = {}
    for entry in named:
        name = entry.get("name")
        if name.value in places:
            raise JounceError(f"{name.place}: second {entry.what}; the first is at {places[name.value]}")
        places[name.value] = name.place
    return {name: i for i, name in enumerate(places)}


def _carrier(entry: Entry, bodies: Index, before: int | None = None) -> int:
    """The index of the body that an entry names, which must be one of the first `before`; -1 is the ground."""
    name = entry.text()
    if name == GROUND:
        return -1
    if name not in bodies:
        raise JounceError(f"{entry.place}: {entry.what}: {no_such('body', name, [GROUND, *bodies])}")
    if before is not None and bodies[name] >= before:
        raise entry.error("the ground or a body above")
    return bodies[name]


def _coordinates(robot: Entry, joints: Sequence[Entry]) -> Index:
    """The names of the coordinates: those listed, else the joints that follow nothing."""
    free = [joint for joint in joints if "follows" not in joint.value]
    if "coordinates" not in robot.value:
        if not free:
            raise JounceError(
                f"{robot.place}: every joint follows others; 'coordinates' must list those that they follow"
            )
        return _distinct_names(free)
    listed = robot.get("coordinates")
    names = {name.text(): i for i, name in enumerate(listed.items(least=1))}
    if len(names) < len(listed.value):
        raise listed.error("different names")
    for joint in free:
        if joint.get("name").value not in names:
            raise JounceError(f"{listed.place}: coordinates omit {joint.what}, which follows no other joint")
    return names


def _coupling(joints: Sequence[Entry], coordinates: Index) -> tuple[np.ndarray, np.ndarray]:
    """G and g of the joint variables ``theta = G q + g``."""
    G, g = np.zeros((len(joints), len(coordinates))), np.zeros(len(joints))
    for i, joint in enumerate(joints):
        if "follows" not in joint.value:
            G[i, coordinates[joint.get("name").value]] = 1
            continue
        follows = joint.get("follows").keys(("coordinates",), ("offset",))
        for name, factor in follows.get("coordinates").members().items():
            if name not in coordinates:
                raise JounceError(f"{factor.place}: {joint.what}: {no_such('coordinate', name, coordinates)}")
            G[i, coordinates[name]] = factor.number()
        g[i] = follows.get("offset", 0).number()
    return G, g
