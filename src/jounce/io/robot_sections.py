"""Reads and writes the sections behind the bodies of a robot file.

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

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from jounce.arguments import loops as loop_arguments
from jounce.arguments.contacts import with_contacts
from jounce.arguments.joint_data import ElasticParameters, with_elasticity
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
    """Return the mechanism with the loops of a file closed.

    Without actuated joints the loops stay open.
    """
    entries = robot.get(LOOPS_SECTION).items(least=1) if LOOPS_SECTION in robot.value else []
    # Without loops a file may state motors at joints that follow others; the other keys belong to loops.
    has_followers = len(mechanism.joints) > mechanism.n
    keys_without_loops = ("actuated", "weights") if "actuated" in robot.value and has_followers else ()
    for key in LOOP_KEYS:
        if key in robot.value and len(entries) == 0 and key not in keys_without_loops:
            raise robot.get(key).error(f"{LOOPS_SECTION!r} too, a list of cut joints")
    loops = [_read_loop(entry, mechanism) for entry in entries]
    mechanism = replace(mechanism, loops=tuple(loops))
    if "actuated" not in robot.value:
        return mechanism
    # Without loops the coordinates stay; with them the actuated joints are the default.
    parameters = read_closure(robot, [name.text() for name in robot.get("actuated").items(least=1)])
    if len(loops) == 0 and parameters.coordinates is None:
        parameters = replace(parameters, coordinates=mechanism.coordinates)
    with locate_errors(robot.get(LOOPS_SECTION if len(loops) > 0 else "actuated").place):
        return loop_arguments.with_loops(mechanism, parameters)


def read_closure(robot: Entry, motors: Sequence[str]) -> loop_arguments.ClosureParameters:
    """Return what a file states of the coordinates that motors move."""
    # The keys are lists of joints, or numbers by joint.
    lists = {
        key: [name.text() for name in robot.get(key).items(least=1)]
        for key in ("independent", "passive")
        if key in robot.value
    }
    numbers = {
        key: {name: value.number() for name, value in robot.get(key).members().items()}
        for key in ("weights", "start")
        if key in robot.value
    }
    return loop_arguments.ClosureParameters(
        actuated=motors,
        coordinates=lists.get("independent"),
        start=numbers.get("start"),
        weights=numbers.get("weights"),
        passive=lists.get("passive"),
    )


def _read_loop(entry: Entry, mechanism: Mechanism) -> Loop:
    """Return the loop that an entry states: two frames, a cut joint and its axis."""
    entry.keys(("frames",), ("joint", "axis"))
    frames = [frame.text() for frame in entry.get("frames").items()]
    if len(frames) != 2:
        raise entry.get("frames").error("two names of frames")
    with locate_errors(entry.place):
        joint = entry.get("joint", "spherical").text()
        axis = entry.get("axis", list(DEFAULT_LOOP_AXIS)).numbers((3,))
        return loop_arguments.build_loop(mechanism, frames[0], frames[1], joint, axis)


def write_loops(mechanism: Mechanism) -> JsonObject:
    """Return what a file states of the loops of a mechanism."""
    c, loops = mechanism.closure, [_loop_data(loop) for loop in mechanism.loops]
    has_loops = len(loops) > 0
    data: JsonObject = {LOOPS_SECTION: loops} if has_loops else {}
    # Followers by polynomials are stated at their joints, and the others have the motors.
    if c is None or not mechanism.has_constant_ratios:
        return data
    # Of what is the default when it is read again nothing is written.
    names = np.array(c.coordinates)
    data["actuated"] = names[list(c.actuated)].tolist()
    if len(c.passive) > 0:
        data["passive"] = [mechanism.coordinates[k] for k in c.passive]
    if has_loops and c.independent != c.actuated:
        data["independent"] = names[list(c.independent)].tolist()
    if (c.weights != 1).any():
        data["weights"] = dict(zip(data["actuated"], c.weights.tolist(), strict=True))
    if has_loops:
        data["start"] = dict(zip(c.coordinates, c.start.tolist(), strict=True))
    return data


def _loop_data(loop: Loop) -> JsonObject:
    """Return what a file states of a loop.

    A spherical joint is the default.
    """
    joint = {} if loop.joint == "spherical" else {"joint": loop.joint}
    axis = {} if loop.joint in ("spherical", "fixed") else {"axis": loop.axis.tolist()}
    return {"frames": [loop.a.name, loop.b.name], **joint, **axis}


# Springs and motors.
ELASTIC_SECTION = "elastic"
# Keys of a motor's friction, and their defaults.
FRICTION_DEFAULTS = {"viscous": 0.0, "friction": 0.0, "eps": DEFAULT_SMOOTHING_VELOCITY}
DEFAULT_DAMPING_TERMS = ElasticParameters().damping_terms
SPRING_KEYS: tuple[tuple[type[CubicSpring | SpringTable], tuple[str, ...]], ...] = (
    (CubicSpring, ("k", "k3")),
    (SpringTable, ("deflections", "forces")),
)


def read_elastic(robot: Entry, mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with a file's springs and motors, if any."""
    if ELASTIC_SECTION not in robot.value:
        return mechanism
    section = robot.get(ELASTIC_SECTION).keys(("joints",), ("coupling", "damping_terms"))
    values: dict[str, dict[str, object]] = {key: {} for key in ENTRY_READERS}  # by key and joint
    for name, entry in section.get("joints").members().items():
        if name not in mechanism.coordinates:
            raise JounceError(
                f"{entry.place}: {unknown_name_error('coordinate', name, mechanism.coordinates, section.what)}"
            )
        for key, value in entry.keys((), tuple(ENTRY_READERS)).members().items():
            values[key][name] = ENTRY_READERS[key](value)
    parameters = ElasticParameters(
        stiffness=values["stiffness"],
        rotor=_none_if_empty(values["rotor"]),
        damping=_none_if_empty(values["damping"]),
        spring=_none_if_empty(values["spring"]),
        motors=_none_if_empty(values["motor"]),
        coupling=section.get("coupling", "spong").value,
        damping_terms=section.get("damping_terms", DEFAULT_DAMPING_TERMS).value,
    )
    with locate_errors(section.place):
        elastic = with_elasticity(mechanism, parameters)
    e = elastic.elasticity
    assert e is not None
    # The friction that the section states of a motor stands in place of that of its drive train.
    viscous, friction, eps = (
        np.array([values[key].get(name, x) for name, x in zip(mechanism.coordinates, e.arrays[key], strict=True)])
        for key in FRICTION_DEFAULTS
    )
    return replace(elastic, elasticity=replace(e, viscous=viscous, friction=friction, eps=eps))


def _none_if_empty(values: dict[str, object]) -> dict[str, object] | None:
    return values if len(values) > 0 else None


def _read_nonnegative(entry: Entry) -> float:
    number = entry.number()
    if number < 0:
        raise entry.error("0 or more")
    return number


def _read_eps(entry: Entry) -> float:
    number = entry.number()
    if number <= 0:
        raise entry.error("a smoothing velocity of friction above 0")
    return number


def _read_springs(entry: Entry) -> Spring | AntagonisticSprings:
    """Return a spring, or from a list two with a motor each."""
    if not isinstance(entry.value, list):
        return _read_spring(entry)
    items = entry.items()
    if len(items) != 2:
        raise entry.error("a spring, or two with a motor each")
    return AntagonisticSprings(*map(_read_spring, items))


def _read_spring(entry: Entry) -> Spring:
    """Return a cubic spring or a table, by its keys."""
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
    """Return a motor from its fields.

    They are numbers but for `body` and `axis`.
    """
    members = entry.keys((), tuple(field.name for field in fields(Motor))).members()
    readers: dict[str, Callable[[Entry], Any]] = {"body": Entry.text, "axis": _read_axis}
    values = {key: readers.get(key, Entry.number)(x) for key, x in members.items()}
    with locate_errors(entry.place):
        return Motor(**values)


def _read_axis(entry: Entry) -> tuple[float, ...]:
    return tuple(entry.numbers((3,)).tolist())


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
    """Return the section of a mechanism; empty if its joints are rigid."""
    e = mechanism.elasticity
    if e is None:
        return {}
    terms = max((law.terms for law in e.springs if isinstance(law, DampedSpring)), default=DEFAULT_DAMPING_TERMS)
    section: JsonObject = {}
    if e.level is not None:
        section["coupling"] = e.level
    if terms != DEFAULT_DAMPING_TERMS:
        section["damping_terms"] = terms
    joints = {name: _joint_data(e, j, name) for j, name in enumerate(mechanism.coordinates)}
    section["joints"] = {name: data for name, data in joints.items() if len(data) > 0}
    return {ELASTIC_SECTION: section}


def _joint_data(e: Elasticity, j: int, name: str) -> JsonObject:
    """Return what the section states of a coordinate.

    It states nothing of a rigid joint without a rotor.
    """
    motor = e.motors[j] if len(e.motors) > 0 else None
    data = _law_data(e.springs[j] if len(e.springs) > 0 else None, float(e.stiffness[j]), name)
    # Inertia and friction that follow from the data of the motor are not stated twice.
    if e.rotor[j] != 0 and (motor is None or motor.inertia is None):
        data["rotor"] = float(e.rotor[j])
    implied_friction = dict(FRICTION_DEFAULTS)
    if motor is not None:
        implied_friction |= {"viscous": motor.damping * motor.gear**2, "friction": motor.friction * abs(motor.gear)}
    data |= {key: float(e.arrays[key][j]) for key, x in implied_friction.items() if e.arrays[key][j] != x}
    if motor is not None:
        changed_fields = {key: x for key, x in vars(motor).items() if x != vars(Motor())[key]}
        data["motor"] = {key: list(x) if key == "axis" else x for key, x in changed_fields.items()}
    return data


def _law_data(law: ElasticLaw | None, stiffness: float, name: str) -> JsonObject:
    """Return the spring and the damper of a joint as plain data."""
    if law is None:
        return {} if np.isinf(stiffness) else {"stiffness": stiffness}
    if isinstance(law, DampedSpring):
        # A linear spring parallel to a damper is a stiffness.
        is_linear = isinstance(law.spring, CubicSpring) and law.spring.k3 == 0
        return _law_data(None if is_linear else law.spring, stiffness, name) | {"damping": law.damping}
    if isinstance(law, AntagonisticSprings):
        return {"spring": [_spring_data(spring, name) for spring in (law.first, law.second)]}
    return {"spring": _spring_data(law, name)}


def _spring_data(spring: Spring, name: str) -> JsonObject:
    """Return the keys of a spring; springs that are functions are refused."""
    for kind, keys in SPRING_KEYS:
        if isinstance(spring, kind):
            values = {key: getattr(spring, key) for key in keys}
            return {key: list(x) if isinstance(x, tuple) else x for key, x in values.items()}
    cure = "save a jounce.SpringTable of it"
    raise JounceError(f"the spring of joint {quote_value(name)} is a function, which a file cannot hold; {cure}")


# Contacts.
CONTACTS_SECTION = "contacts"
CONTACT_FIELDS = [field.name for field in fields(Contact)]  # frame and kind, which an entry needs, and others


def read_contacts(robot: Entry, mechanism: Mechanism) -> Mechanism:
    """Return the mechanism on the contacts of a file."""
    contacts = []
    for entry in robot.get(CONTACTS_SECTION, []).items():
        with locate_errors(entry.keys(CONTACT_FIELDS[:2], CONTACT_FIELDS[2:]).place):
            contacts.append(Contact(**entry.value))
    with locate_errors(robot.get(CONTACTS_SECTION).place):
        return with_contacts(mechanism, contacts) if len(contacts) > 0 else mechanism


def write_contacts(mechanism: Mechanism) -> JsonObject:
    """Return what a file states of the contacts of a mechanism."""
    if len(mechanism.contacts) == 0:
        return {}
    return {CONTACTS_SECTION: [*map(_contact_data, mechanism.contacts)]}


def _contact_data(contact: Contact) -> JsonObject:
    """Return the fields that a file states of a contact.

    A place that is not turned is a point; default weights are left out.
    """
    data = {name: getattr(contact, name) for name in CONTACT_FIELDS}
    if (contact.place[:3, :3] == np.eye(3)).all():
        data["place"] = contact.place[:3, 3]
    if (data["weights"] == Contact(contact.frame, contact.kind, sole=contact.sole).weights).all():
        del data["weights"]
    return {name: np.asarray(x).tolist() for name, x in data.items() if x is not None}
