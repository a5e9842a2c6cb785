"""Reads limits of robots from files, and of arms by name.

A file is jounce's own, or a MoveIt ``joint_limits.yaml``, which `read_moveit` reads:

units: SI                                     # m, kg, s, rad
angles: rad                                   # or deg: of positions and their rates, of motors too, where a joint turns
limits_of: {effort_rate: Q - Qgrav}           # which force effort limits bound: Q unless said otherwise
total_power: [-200, 500]                      # of the whole robot, W
joints:
  joint1: {lower: -2.8, upper: 2.8, velocity: 2, effort: 87, effort_rate: [-1000, 800]}

A table of an arm is such a file, ``limit_tables/NAME.yaml``, with `sources`: where each kind of number is published. It
is for the joints of a robot that have its names behind a common prefix. `limits_from` is the door for all of them.
"""

import os
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from jounce.core.errors import (
    JounceError,
    check_choice,
    join_names,
    locate_errors,
    quote_value,
    unknown_name_error,
    warn,
)
from jounce.io import entries, files, robot_files
from jounce.io.entries import DOCUMENT_SUFFIXES, Entry
from jounce.model import coordinates
from jounce.model.limits import (
    BOUNDED_FORCES,
    BOUNDED_UNITS,
    LIMIT_KINDS,
    Limits,
    StatedLimit,
    limit_error,
)
from jounce.model.mechanism import Mechanism
from jounce.motion import units

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable


OPTIONAL_KEYS = ("angles", "limits_of", *LIMIT_KINDS.totals, "names", "sources")  # of a file
ByJoint = Mapping[str, Mapping[str, StatedLimit]]


def table_names() -> list[str]:
    """Return the names of the arms whose limits come with jounce."""
    return sorted(file.name.removesuffix(".yaml") for file in _table_folder().iterdir())


def limits_from(mechanism: Mechanism, source: object) -> Limits:
    """Return the limits of a mechanism, changed by those of a source.

    The source is a file, an arm by its name, or the limits of another robot.
    """
    if isinstance(source, Limits):
        if source.table.shape != mechanism.limits.table.shape:
            count = source.table.shape[-1]
            raise JounceError(f"the limits are of {count} joint variables; this robot has {len(mechanism.joints)}")
        return source
    if not isinstance(source, str | os.PathLike):
        came = f"{type(source).__name__}; arms with limits: {join_names(table_names())}"
        raise JounceError(f"with_limits() expects a file, the name of an arm or jounce.Limits, got {came}")
    path = files.expand_path(source)
    if path.suffix.lower() in DOCUMENT_SUFFIXES:
        return _from_file(mechanism, entries.read(path, "the limits"))
    name = os.fspath(source)
    if name not in table_names():
        raise JounceError(
            f"{unknown_name_error('limits', name, table_names())}, or a file of type {', '.join(DOCUMENT_SUFFIXES)}"
        )
    return _from_table(mechanism, name)


def read_table(name: str) -> Entry:
    """Return the table of an arm."""
    from importlib.resources import as_file

    with as_file(_table_folder() / f"{name}.yaml") as path:
        return entries.read(path, f"the limits of {name}")


def _table_folder() -> "Traversable":
    from importlib.resources import files

    return files("jounce.io") / "limit_tables"


def _from_file(mechanism: Mechanism, document: Entry) -> Limits:
    """Return the limits of a mechanism, changed by those of a file."""
    places = coordinates.joint_places(mechanism)
    sliding_joints = [name for name, i in places.items() if not mechanism.X[i][:3].any()]
    moveit_limits = read_moveit(document, sliding_joints)
    # A file of jounce's own is for this robot: an unknown joint is an error.
    if moveit_limits is None:
        limits = _read_joints(document, mechanism)
        for name, entry in document.get("joints", {}).members().items():
            with locate_errors(entry.place):
                check_choice("joint", name, places)
        return _change_limits(mechanism, document, limits)
    # A file of MoveIt may have joints that this robot lacks, such as those of a gripper.
    other_joints = [name for name in moveit_limits if name not in places]
    if len(other_joints) == len(moveit_limits):
        unknown = other_joints[0] if len(other_joints) > 0 else ""
        raise JounceError(f"{document.place}: {unknown_name_error('joint', unknown, places)}")
    if len(other_joints) > 0:
        warn(f"{document.path}: limits of {join_names(other_joints)} are left out; this robot has no such joint")
    own_limits = {name: limits for name, limits in moveit_limits.items() if name in places}
    return _change_limits(mechanism, document, own_limits)


def _from_table(mechanism: Mechanism, name: str) -> Limits:
    """Return the limits of a mechanism, changed by those of an arm.

    Joints of the robot have the names of the arm behind common prefixes, such as ``left_``.
    """
    table = read_table(name)
    keys, places = list(table.get("joints").members()), coordinates.joint_places(mechanism)
    # An arm is found where all its joints are there behind the prefix of its first.
    key_of_joint: dict[str, str] = {}
    patterns = [item.text() for item in table.get("names", ["{}"]).items()]
    for pattern in patterns:
        arm_names = [pattern.format(key) for key in keys]
        for joint in places:
            prefix = joint.removesuffix(arm_names[0])
            joint_names = [prefix + arm_name for arm_name in arm_names]
            is_first = joint.endswith(arm_names[0]) and not prefix[-1:].isalnum()
            if is_first and all(joint_name in places for joint_name in joint_names):
                key_of_joint |= dict(zip(joint_names, keys, strict=True))
    if len(key_of_joint) == 0:
        expected = join_names(pattern.format(keys[0]) for pattern in patterns)
        raise JounceError(
            f"limits of {name} are of {len(keys)} joints called {expected}, ..., behind a common prefix;"
            f" the joints of this robot are: {join_names(places)}"
        )
    return _change_limits(mechanism, table, _read_joints(table, mechanism, key_of_joint))


def _read_joints(document: Entry, mechanism: Mechanism, keys: Mapping[str, str] | None = None) -> ByJoint:
    """Return what a file states of each joint, in SI units.

    `keys` are the keys of the file by joint of the robot, by default the same names.
    """
    # A file of limits of the whole robot alone needs no joints.
    is_whole = any(kind in document.members() for kind in LIMIT_KINDS.totals)
    document.keys(("units",) if is_whole else ("units", "joints"), (*["joints"] * is_whole, *OPTIONAL_KEYS))
    robot_files.check_units(document)
    unit = units.ANGLE_UNITS[check_choice("unit of angles", document.get("angles", "rad").text(), units.ANGLE_UNITS)]
    members, places = document.get("joints", {}).members(), coordinates.joint_places(mechanism)
    key_of_joint = {key: key for key in members} if keys is None else keys
    limits_of_joint: dict[str, dict[str, StatedLimit]] = {}
    for joint, key in key_of_joint.items():
        entry = members[key].named(f"joint {quote_value(joint)}")
        limits = robot_files.read_limits(entry, entry)
        # The unit of angles is for joints that turn.
        turns = joint in places and mechanism.X[places[joint]][:3].any()
        limits_of_joint[joint] = convert_to_rad(limits, limits, unit) if turns else limits
    return limits_of_joint


def _change_limits(mechanism: Mechanism, document: Entry, limits_of_joint: ByJoint) -> Limits:
    """Return the limits of a mechanism, changed by those of some joints."""
    changes: dict[int, dict[str, StatedLimit]] = {}
    without_gravity = robot_files.limits_without_gravity(document) if "limits_of" in document.value else ()
    with locate_errors(document.path):
        for name, limits in limits_of_joint.items():
            for key, value in limits.items():
                changes.setdefault(coordinates.limit_place(mechanism, name, key), {})[key] = value
        changed_limits = coordinates.change_limits(
            mechanism, changes, dict.fromkeys(without_gravity, BOUNDED_FORCES[1])
        )
    return changed_limits.with_totals(robot_files.read_totals(document))


MOVEIT_OUTER_KEYS = ("/**", "ros__parameters", "robot_description_planning")  # keys that may stand above the limits
MOVEIT_KINDS = ("velocity", "acceleration", "jerk", "effort")
MOVEIT_LIMIT_KEYS = {"min_position": "lower", "max_position": "upper"} | {f"max_{kind}": kind for kind in MOVEIT_KINDS}
MOVEIT_KEYS = (
    *(*MOVEIT_LIMIT_KEYS, "angle_wraparound", "max_deceleration", "min_velocity"),
    *(f"has_{kind}_limits" for kind in ("position", "deceleration", *MOVEIT_KINDS, "soft")),
    *("k_position", "k_velocity", "soft_lower_limit", "soft_upper_limit"),
)


def read_moveit(document: Entry, sliding: Collection[str]) -> Mapping[str, Mapping[str, StatedLimit]] | None:
    """Return the limits of a MoveIt file by joint, None for others.

    What ``has_..: false`` denies is left out. Angles may have tags, ``max_velocity: !degrees 180``, except those of
    joints that slide.
    """
    for key in MOVEIT_OUTER_KEYS:
        if isinstance(document.value, Mapping) and key in document.value:
            document = document.get(key)
    if not isinstance(document.value, Mapping) or "joint_limits" not in document.value:
        return None
    joints = document.get("joint_limits").members()
    return {name: _read_moveit_joint(entry, name not in sliding) for name, entry in joints.items()}


def _read_moveit_joint(entry: Entry, is_turning: bool) -> Mapping[str, StatedLimit]:
    """Return the limits of a joint under jounce's keys."""
    limits = {}
    for moveit_key, key in MOVEIT_LIMIT_KEYS.items():
        # max_velocity, for example, counts unless has_velocity_limits is false.
        flag = entry.get(f"has_{moveit_key.partition('_')[2]}_limits", True)
        if moveit_key in entry.keys((), MOVEIT_KEYS).value and flag.value is not False:
            if flag.value is not True:
                raise flag.error("true or false")
            value = entry.get(moveit_key)
            limits[key] = value.angle() if is_turning and key != "effort" else value.number()
    error = limit_error(**limits)
    if error is not None:
        raise JounceError(f"{entry.place}: {entry.what}: {error}")
    return limits


# Angles, or rates of them, where a joint turns:
ANGULAR_KEYS = (
    *(key for row in LIMIT_KINDS.values() if BOUNDED_UNITS[row.of][0] == "rad" for key in row.keys),
    "rest",
    "eps",
)
Number = TypeVar("Number", float, StatedLimit)


def convert_to_rad(numbers: Mapping[str, Number], stated_keys: Collection[str], unit: float) -> dict[str, Number]:
    """Return numbers of a joint, with stated angles converted to rad.

    `unit` is that of the angles, in rad; numbers that are not stated are defaults, in rad already.
    """
    keys = {*ANGULAR_KEYS} & {*stated_keys}
    return {key: np.multiply(x, unit).tolist() if key in keys else x for key, x in numbers.items()}
