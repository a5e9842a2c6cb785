"""Reads robots in YAML or JSON.

`read` is the door: a file is parsed once, then read in the format that its keys identify. The own format of jounce is
that of `jounce.io.robot_files`. In a table of Denavit-Hartenberg parameters, which is read here, every row names them:

name: arm
units: SI                       # m, kg, s
angles: deg                     # or rad: of alpha, theta and rpy, of limits, of rest and eps of drives
convention: modified            # or standard
base: {position: [0, 0, 0.3]}
dh:
  - {name: shoulder, a: 0, alpha: -90, d: 0.2, theta: 0, limits: {lower: -170, upper: 170}, inertia: {...}}
  - {name: lift, type: prismatic, a: 0.5, alpha: 0, d: 0, theta: 90, inertia: {...}}
tool: {position: [0, 0, 0.1], rpy: [0, 180, 0]}
"""

from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from jounce.core.cures import FLOATING_BASE
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value, unknown_name_error
from jounce.io import entries, robot_files
from jounce.io.entries import Entry
from jounce.io.limit_files import convert_to_rad
from jounce.model import screws
from jounce.model.drive_trains import UNDRIVEN
from jounce.model.limits import LIMIT_KINDS, limits_of_joints
from jounce.model.mechanism import GRAVITY, Mechanism
from jounce.motion import units

ROW_KEYS = ("name", "body", "type", "limits", "drive", "inertia")  # keys of a row besides its four parameters


def read_dh_table(robot: Entry, gravity: object = None, base: str | None = None) -> Mechanism:
    """Return the mechanism of a Denavit-Hartenberg table.

    It is under its own gravity unless another is given; its base is fixed.
    """
    if base == "floating":
        cure = "a URDF or MJCF file states it, or jounce's own format with 'base'"
        why = "needs the inertia of the base, which this format does not state"
        raise JounceError(f"{robot.path}: {FLOATING_BASE} {why}; {cure}")
    robot.keys(
        ("units", "angles", "convention", "dh"), ("name", "gravity", "base", "tool", "limits_of", *LIMIT_KINDS.totals)
    )
    robot_files.check_units(robot)
    unit = units.ANGLE_UNITS[robot.get("angles").choice(units.ANGLE_UNITS)]
    convention = robot.get("convention").choice(screws.CONVENTIONS)
    name = robot.get("name", robot.path.stem).text()
    gravity_of_file = robot.get("gravity", list(GRAVITY)).numbers((3,))
    # Rows get the names of their joints for messages.
    rows = [row.keys(screws.DH_PARAMETERS, ROW_KEYS) for row in robot.get("dh").items(least=1)]
    joints, bodies = _row_names(rows, "name", "joint"), _row_names(rows, "body", "body")
    rows = [row.named(f"joint {quote_value(name)}") for row, name in zip(rows, joints, strict=True)]
    # Limits, and what drives state in angles, are in the unit of the file where a joint turns.
    types = [row.get("type", screws.TYPES[0]).choice(screws.TYPES) for row in rows]
    unit_of_row = [unit if kind == "revolute" else 1.0 for kind in types]
    limits = [
        convert_to_rad(robot_files.read_limits(row), row.get("limits", {}).value, x)
        for row, x in zip(rows, unit_of_row, strict=True)
    ]
    drives = [
        convert_to_rad(robot_files.read_drive(row), row.get("drive", {}).value, x)
        for row, x in zip(rows, unit_of_row, strict=True)
    ]
    table = [[row.get(key).number() for key in screws.DH_PARAMETERS] for row in rows]
    M = [robot_files.read_inertia(row) for row in rows]
    end_poses = {key: robot_files.read_pose(robot, key, unit) for key in ("base", "tool") if key in robot.value}
    with locate_errors(robot.path):
        options = screws.ScrewOptions(
            names=bodies,
            gravity=gravity_of_file if gravity is None else gravity,
            joint_names=joints,
            limits=limits_of_joints(limits, robot_files.limits_without_gravity(robot)).with_totals(
                robot_files.read_totals(robot)
            ),
            drives={key: [drive[key] for drive in drives] for key in UNDRIVEN},
            name=name,
        )
        rows_and_poses = screws.DhTable(table, convention, types=types, degrees=unit != 1, **end_poses)
        return screws.from_dh(rows_and_poses, np.stack(M), options)


def _row_names(rows: list[Entry], key: str, stem: str) -> list[str]:
    """Return the distinct names of rows under a key.

    Rows without a name are numbered.
    """
    names: list[str] = []
    for i, row in enumerate(rows, start=1):
        entry = row.get(key, f"{stem}{i}")
        if entry.text() in names:
            raise entry.error(f"another name: that of the {stem} of row {names.index(entry.value) + 1}")
        names.append(entry.value)
    return names


# By the key that no other format has.
ROBOT_FORMATS: dict[str, tuple[str, Callable[[Entry, object, str | None], Mechanism]]] = {
    "bodies": ("jounce's own format", robot_files.read),
    "dh": ("a Denavit-Hartenberg table", read_dh_table),
}


def read(path: Path, gravity: object = None, base: str | None = None) -> Mechanism:
    """Return the mechanism of a YAML or JSON file.

    It is under its own gravity unless another is given; only jounce's own format can float.
    """
    robot = entries.read(path, "the robot")
    keys = list(robot.members())
    for key, (_, reader) in ROBOT_FORMATS.items():
        if key in keys:
            return reader(robot, gravity, base)
    # Files of skidy, and keys with a typing error, get a cure of their own.
    if "joint_screw_coord" in keys:
        cure = "examples/skidy_to_jounce.py in jounce's sources converts it to jounce's own format"
        raise JounceError(f"{robot.place}: a description for skidy, which jounce does not read; {cure}")
    for key in keys:
        if len(get_close_matches(key, ROBOT_FORMATS, n=1)) > 0:
            raise JounceError(f"{robot.get(key).place}: {unknown_name_error('key', key, ROBOT_FORMATS, 'the robot')}")
    formats = ", ".join(f"{key!r} ({words})" for key, (words, _) in ROBOT_FORMATS.items())
    came = join_names(keys) if len(keys) > 0 else "none"
    raise JounceError(f"{robot.place}: the robot has no key that identifies its format, {formats}; its keys: {came}")
