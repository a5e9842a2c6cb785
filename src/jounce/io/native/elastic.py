"""The section `elastic` of a robot file: springs between motors and links, by coordinate.

elastic:
  joints:
    joint1: {stiffness: 1000, rotor: 0.6}        # N m/rad and kg m^2, seen from the link
    joint2: {stiffness: 800, rotor: 0.5, viscous: 0.2, friction: 0.4, eps: 0.05}

A joint that it does not name is rigid.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from jounce.actuators.stated import with_elasticity
from jounce.errors import JounceError, at, no_such
from jounce.io.entries import Entry
from jounce.model.drives import EPS
from jounce.model.elasticity import ARRAYS
from jounce.model.mechanism import Mechanism

SECTION = "elastic"
MOTOR = {
    "viscous": 0.0,
    "friction": 0.0,
    "eps": EPS,
}  # keys of a motor's friction, and what is meant if they are left out


def read(robot: Entry, mechanism: Mechanism) -> Mechanism:
    """The mechanism with the springs and motors of a file, if it states any."""
    if SECTION not in robot.value:
        return mechanism
    section = robot.get(SECTION).keys(("joints",))
    joints = section.get("joints").members()
    found: dict[str, dict[str, float]] = {key: {} for key in ARRAYS}
    for name, entry in joints.items():
        if name not in mechanism.coordinates:
            raise JounceError(f"{entry.place}: {no_such('coordinate', name, mechanism.coordinates, section.what)}")
        entry.keys((), ARRAYS)
        for key, value in entry.members().items():
            found[key][name] = _number(key, value)
    with at(section.place):
        elastic = with_elasticity(mechanism, found["stiffness"], found["rotor"] or None)
    assert elastic.elasticity is not None
    motors = {
        key: np.array([found[key].get(name, default) for name in mechanism.coordinates])
        for key, default in MOTOR.items()
    }
    return replace(elastic, elasticity=replace(elastic.elasticity, **motors))


def _number(key: str, entry: Entry) -> float:
    number = entry.number()
    if key in MOTOR and not (number > 0 if key == "eps" else number >= 0):
        raise entry.error("a smoothing velocity of friction above 0" if key == "eps" else "0 or more")
    return number


def section(mechanism: Mechanism) -> dict[str, Any]:
    """Return the section of a mechanism, as plain data; empty if its joints are rigid."""
    e = mechanism.elasticity
    if e is None:
        return {}
    joints = {}
    for j, name in enumerate(mechanism.coordinates):
        numbers = {key: float(array[j]) for key, array in e.arrays.items()}
        joints[name] = {key: x for key, x in numbers.items() if x != MOTOR.get(key, np.inf)}
    return {SECTION: {"joints": joints}}
