"""Reads and writes the sections of a robot file that follow its bodies.

Each section has a reader, which returns the mechanism with what the file states, and a writer, which returns plain
data, empty where there is nothing to state. They are read in this order, as springs and contacts need the coordinates
of the closed robot.

Loops: the frames that each cut joint joins, the actuated joints, and where positions start.

loops:
  - {frames: [left_tip, right_tip]}                           # spherical: the origins meet
  - {frames: [rod, link], joint: revolute, axis: [0, 0, 1]}   # the axis in the first frame
actuated: [left_shoulder, right_shoulder]                     # without loops, joints that follow may be among them
independent: [left_shoulder, right_shoulder]                  # the actuated joints, unless stated
passive: [ankle]                                              # independent, and moved by springs or nothing
weights: {left_shoulder: 1}                                   # of the forces of redundant motors, 1 unless stated
start: {left_shoulder: 2, left_elbow: -1}                     # near a configuration with closed loops, 0 unless stated

Springs between motors and links, and the motors, by coordinate; a joint that is not named is rigid.

elastic:
  coupling: spong                       # or the level of carried rotors: 0, 1, ...
  joints:
    joint1: {stiffness: 1000, rotor: 0.6, damping: 0.4}           # N m/rad, kg m^2, N m s/rad, seen from the link
    joint2: {spring: {k: 300, k3: 2000}, rotor: 0.5, viscous: 0.2, friction: 0.4, eps: 0.05}
    joint3: {spring: {deflections: [-0.1, ..., 0.1], forces: [-40, ..., 40]}, motor: {gear: 100, inertia: 5e-5}}

Contacts: one entry each, with the fields of `jounce.Contact`.

contacts:
  - {frame: left_foot, kind: plane, place: [0.035, 0, -0.037], sole: [0.09, 0.03], friction: 0.6}
"""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from jounce.arguments.contacts import with_contacts
from jounce.arguments.joint_data import ElasticParameters, with_elasticity
from jounce.arguments.loops import build_loop, with_loops
from jounce.core.errors import JounceError, locate_errors, quote_value, unknown_name_error
from jounce.core.typing import JsonObject
from jounce.io.entries import Entry
from jounce.model.contacts import Contact
from jounce.model.drive_trains import DEFAULT_SMOOTHING_VELOCITY
from jounce.model.elasticity import Elasticity, ElasticLaw, Motor
from jounce.model.loops import DEFAULT_LOOP_AXIS, Loop
from jounce.model.mechanism import Mechanism
from jounce.model.spring_deflection import AntagonisticSprings
from jounce.model.springs import CubicSpring, DampedSpring, Spring, SpringTable

# Loops.
LOOPS_SECTION, LOOP_KEYS = "loops", ("actuated", "independent", "passive", "weights", "start")


def read_loops(robot: Entry, mechanism: Mechanism) -> Mechanism:
    """The mechanism with the loops of a file closed; without actuated joints they are kept, open."""
    loops, entries = [], robot.get(LOOPS_SECTION).items(least=1) if LOOPS_SECTION in robot.value else []
    driven = ("actuated", "weights") if "actuated" in robot.value and len(mechanism.joints) > mechanism.n else ()
    for key in LOOP_KEYS:
        if key in robot.value and not entries and key not in driven:
            raise robot.get(key).error(f"{LOOPS_SECTION!r} too, a list of cut joints")
    for entry in entries:
        given = entry.keys(("frames",), ("joint", "axis"))
        frames = [frame.text() for frame in given.get("frames").items()]
        if len(frames) != 2:
            raise given.get("frames").error("two names of frames")
        with locate_errors(given.place):
            joint, axis = (
                given.get("joint", "spherical").text(),
                given.get("axis", list(DEFAULT_LOOP_AXIS)).numbers((3,)),
            )
            loops.append(build_loop(mechanism, frames[0], frames[1], joint, axis))
    mechanism = replace(mechanism, loops=tuple(loops))
    if "actuated" not in robot.value:
        return mechanism
    lists = {
        key: [name.text() for name in robot.get(key).items(least=1)]
        for key in ("actuated", "independent", "passive")
        if key in robot.value
    }
    numbers = {
        key: {name: value.number() for name, value in robot.get(key).members().items()}
        for key in ("weights", "start")
        if key in robot.value
    }
    own = lists.get("independent", None if loops else mechanism.coordinates)
    with locate_errors(robot.get(LOOPS_SECTION if loops else "actuated").place):
        return with_loops(
            mechanism,
            actuated=lists["actuated"],
            coordinates=own,
            start=numbers.get("start"),
            weights=numbers.get("weights"),
            passive=lists.get("passive"),
        )


def write_loops(mechanism: Mechanism) -> JsonObject:
    """What a file states of the loops of a mechanism."""
    c, loops = mechanism.closure, [_loop_data(loop) for loop in mechanism.loops]
    stated: JsonObject = {LOOPS_SECTION: loops} if loops else {}
    if c is None:
        return stated
    names = np.array(c.coordinates)
    stated["actuated"] = names[list(c.actuated)].tolist()
    if c.passive:
        stated["passive"] = [mechanism.coordinates[k] for k in c.passive]
    if loops and c.independent != c.actuated:
        stated["independent"] = names[list(c.independent)].tolist()
    if (c.weights != 1).any():
        stated["weights"] = dict(zip(stated["actuated"], c.weights.tolist(), strict=True))
    return stated | ({"start": dict(zip(c.coordinates, c.start.tolist(), strict=True))} if loops else {})


def _loop_data(loop: Loop) -> JsonObject:
    joint = {} if loop.joint == "spherical" else {"joint": loop.joint}
    axis = {} if loop.joint in ("spherical", "fixed") else {"axis": loop.axis.tolist()}
    return {"frames": [loop.a.name, loop.b.name], **joint, **axis}


# Springs and motors.
ELASTIC_SECTION = "elastic"
FRICTION_DEFAULTS = {
    "viscous": 0.0,
    "friction": 0.0,
    "eps": DEFAULT_SMOOTHING_VELOCITY,
}  # keys of a motor's friction, and their defaults
DEFAULT_DAMPING_TERMS = ElasticParameters().damping_terms
SPRING_KEYS: tuple[tuple[type[CubicSpring | SpringTable], tuple[str, ...]], ...] = (
    (CubicSpring, ("k", "k3")),
    (SpringTable, ("deflections", "forces")),
)


def read_elastic(robot: Entry, mechanism: Mechanism) -> Mechanism:
    """The mechanism with the springs and motors of a file, if it states any."""
    if ELASTIC_SECTION not in robot.value:
        return mechanism
    section = robot.get(ELASTIC_SECTION).keys(("joints",), ("coupling", "damping_terms"))
    found: dict[str, dict[str, object]] = {key: {} for key in ENTRY_READERS}  # by key and joint
    for name, entry in section.get("joints").members().items():
        if name not in mechanism.coordinates:
            raise JounceError(
                f"{entry.place}: {unknown_name_error('coordinate', name, mechanism.coordinates, section.what)}"
            )
        for key, value in entry.keys((), tuple(ENTRY_READERS)).members().items():
            found[key][name] = ENTRY_READERS[key](value)
    with locate_errors(section.place):
        elastic = with_elasticity(
            mechanism,
            ElasticParameters(
                stiffness=found["stiffness"],
                rotor=found["rotor"] or None,
                damping=found["damping"] or None,
                spring=found["spring"] or None,
                motors=found["motor"] or None,
                coupling=section.get("coupling", "spong").value,
                damping_terms=section.get("damping_terms", DEFAULT_DAMPING_TERMS).value,
            ),
        )
    e = elastic.elasticity
    assert e is not None
    viscous, friction, eps = (
        np.array([found[key].get(name, x) for name, x in zip(mechanism.coordinates, e.arrays[key], strict=True)])
        for key in FRICTION_DEFAULTS
    )
    return replace(elastic, elasticity=replace(e, viscous=viscous, friction=friction, eps=eps))


def _read_nonnegative(entry: Entry) -> float:
    if (number := entry.number()) < 0:
        raise entry.error("0 or more")
    return number


def _read_eps(entry: Entry) -> float:
    if (number := entry.number()) <= 0:
        raise entry.error("a smoothing velocity of friction above 0")
    return number


def _read_springs(entry: Entry) -> Spring | AntagonisticSprings:
    """A spring, or a list of two with a motor each."""
    if not isinstance(entry.value, list):
        return _read_spring(entry)
    if len(items := entry.items()) != 2:
        raise entry.error("a spring, or two with a motor each")
    return AntagonisticSprings(*map(_read_spring, items))


def _read_spring(entry: Entry) -> Spring:
    members = entry.keys((), tuple(key for _, keys in SPRING_KEYS for key in keys)).members()
    if "k" in members or "k3" in members:
        numbers = {key: x.number() for key, x in entry.keys(("k",), ("k3",)).members().items()}
        with locate_errors(entry.place):
            return CubicSpring(**numbers)
    entry.keys(("deflections", "forces"))
    columns = [[x.number() for x in members[key].items()] for key in ("deflections", "forces")]
    with locate_errors(entry.place):
        return SpringTable(*columns)


def _read_motor(entry: Entry) -> Motor:
    given = entry.keys((), tuple(field.name for field in fields(Motor))).members()
    readers: dict[str, Callable[[Entry], Any]] = {"body": Entry.text, "axis": lambda x: tuple(x.numbers((3,)).tolist())}
    numbers = {key: readers.get(key, Entry.number)(x) for key, x in given.items()}
    with locate_errors(entry.place):
        return Motor(**numbers)


ENTRY_READERS: dict[str, Callable[[Entry], Any]] = {
    "stiffness": Entry.number,
    "spring": _read_springs,
    "damping": _read_nonnegative,
    "rotor": Entry.number,
    "viscous": _read_nonnegative,
    "friction": _read_nonnegative,
    "eps": _read_eps,
    "motor": _read_motor,
}


def write_elastic(mechanism: Mechanism) -> JsonObject:
    """Return the section of a mechanism, as plain data; empty if its joints are rigid."""
    e = mechanism.elasticity
    if e is None:
        return {}
    terms = max((law.terms for law in e.springs if isinstance(law, DampedSpring)), default=DEFAULT_DAMPING_TERMS)
    head: JsonObject = {} if e.level is None else {"coupling": e.level}
    head |= {} if terms == DEFAULT_DAMPING_TERMS else {"damping_terms": terms}
    joints = {name: _joint_data(e, j, name) for j, name in enumerate(mechanism.coordinates)}
    return {ELASTIC_SECTION: head | {"joints": {name: said for name, said in joints.items() if said}}}


def _joint_data(e: Elasticity, j: int, name: str) -> JsonObject:
    """What the section says of a coordinate; nothing of a rigid joint without a rotor."""
    motor = e.motors[j] if e.motors else None
    said = _law_data(e.springs[j] if e.springs else None, float(e.stiffness[j]), name)
    if e.rotor[j] and (motor is None or motor.inertia is None):
        said["rotor"] = float(e.rotor[j])
    known = dict(FRICTION_DEFAULTS)
    if motor is not None:
        known |= {"viscous": motor.damping * motor.gear**2, "friction": motor.friction * abs(motor.gear)}
    said |= {key: float(e.arrays[key][j]) for key, x in known.items() if e.arrays[key][j] != x}
    if motor is not None:
        stated = {key: x for key, x in vars(motor).items() if x != vars(Motor())[key]}
        said["motor"] = {key: list(x) if key == "axis" else x for key, x in stated.items()}
    return said


def _law_data(law: ElasticLaw | None, stiffness: float, name: str) -> JsonObject:
    """The spring and the damper of a joint."""
    if law is None:
        return {} if np.isinf(stiffness) else {"stiffness": stiffness}
    if isinstance(law, DampedSpring):
        plain = isinstance(law.spring, CubicSpring) and law.spring.k3 == 0
        return _law_data(None if plain else law.spring, stiffness, name) | {"damping": law.damping}
    if isinstance(law, AntagonisticSprings):
        return {"spring": [_spring_data(spring, name) for spring in (law.first, law.second)]}
    return {"spring": _spring_data(law, name)}


def _spring_data(spring: Spring, name: str) -> JsonObject:
    for kind, keys in SPRING_KEYS:
        if isinstance(spring, kind):
            found = {key: getattr(spring, key) for key in keys}
            return {key: list(x) if isinstance(x, tuple) else x for key, x in found.items()}
    cure = "save a jounce.SpringTable of it"
    raise JounceError(f"the spring of joint {quote_value(name)} is a function, which a file cannot hold; {cure}")


# Contacts.
CONTACTS_SECTION = "contacts"
CONTACT_FIELDS = [own.name for own in fields(Contact)]  # frame and kind, which an entry needs, and others


def read_contacts(robot: Entry, mechanism: Mechanism) -> Mechanism:
    """The mechanism on the contacts of a file."""
    contacts = []
    for entry in robot.get(CONTACTS_SECTION, []).items():
        with locate_errors(entry.keys(CONTACT_FIELDS[:2], CONTACT_FIELDS[2:]).place):
            contacts.append(Contact(**entry.value))
    with locate_errors(robot.get(CONTACTS_SECTION).place):
        return with_contacts(mechanism, contacts) if contacts else mechanism


def write_contacts(mechanism: Mechanism) -> JsonObject:
    """What a file states of the contacts of a mechanism."""
    return {CONTACTS_SECTION: [*map(_contact_data, mechanism.contacts)]} if mechanism.contacts else {}


def _contact_data(contact: Contact) -> JsonObject:
    """The fields that are stated: a place that is not turned as a point, and weights that are not the default ones."""
    stated = {name: getattr(contact, name) for name in CONTACT_FIELDS}
    if (contact.place[:3, :3] == np.eye(3)).all():
        stated["place"] = contact.place[:3, 3]
    if (stated["weights"] == Contact(contact.frame, contact.kind, sole=contact.sole).weights).all():
        del stated["weights"]
    return {name: np.asarray(x).tolist() for name, x in stated.items() if x is not None}
