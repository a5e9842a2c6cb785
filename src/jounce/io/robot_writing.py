"""Writing robot files of jounce's own format: the readable form if it restores the same bits, else the exact one."""

import json
import math
from collections.abc import Callable
from io import StringIO
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.scalars import is_symbolic
from jounce.core.typing import JsonObject
from jounce.io import robot_files, robot_sections
from jounce.io.robot_files import BAND_KEY, BASE_KEY, FILE_UNITS, GROUND_NAME
from jounce.model import positions
from jounce.model.drive_trains import UNDRIVEN
from jounce.model.limits import BOUNDED_FORCES
from jounce.model.mechanism import Mechanism, body_name
from jounce.model.positions import Position
from jounce.model.transmissions import with_followers
from jounce.spatial.inertia import inertia_matrix, moments, symmetric_matrix
from jounce.spatial.lie import hat, portable_product


def yaml_text(mechanism: Mechanism) -> str:
    """The YAML text of a mechanism."""
    return dump_yaml(document(mechanism))


def dump_yaml(data: JsonObject, flow: bool | None = None) -> str:
    """The YAML text of plain data: vectors, rows and short mappings on one line each, or, with `flow` False, none."""
    from ruamel.yaml import YAML

    writer = YAML(typ="safe", pure=True)
    writer.default_flow_style = flow  # None: one line for what holds no other collection
    writer.width = 1_000_000
    writer.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # declared None
    writer.indent(mapping=2, sequence=4, offset=2)
    text = StringIO()
    writer.dump(data, text)
    return text.getvalue()


def json_text(mechanism: Mechanism) -> str:
    """The JSON text of a mechanism."""
    return dump_json(document(mechanism))


def dump_json(data: JsonObject) -> str:
    """The JSON text of plain data."""
    return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def document(mechanism: Mechanism) -> JsonObject:
    """Return the content of the file of a mechanism of numbers, as plain data."""
    _check_writable(mechanism)
    stated = (
        robot_sections.write_loops(mechanism)
        | robot_sections.write_elastic(mechanism)
        | robot_sections.write_contacts(mechanism)
    )
    mechanism = with_followers(mechanism)
    joints = {i: _joint_data(mechanism, i) for i in mechanism.moving_bodies}
    free = [mechanism.joints[j] for i, joint in joints.items() if "follows" not in joint for j in mechanism.columns[i]]
    frames = [
        {"name": f.name, "body": body_name(mechanism, f.body, GROUND_NAME), **_pose_data(f.T)} for f in mechanism.frames
    ]
    bodies = [
        {
            "name": mechanism.bodies[i],
            "parent": body_name(mechanism, mechanism.parent[i], GROUND_NAME),
            **_pose_data(mechanism.B[i]),
            "joint": joints[i],
            **_inertia_data(mechanism.M[i]),
        }
        for i in joints
    ]
    coordinates = {} if free == list(mechanism.coordinates) else {"coordinates": list(mechanism.coordinates)}
    head: JsonObject = {"name": mechanism.name, "units": FILE_UNITS, "gravity": _plain_numbers(mechanism.gravity)}
    if mechanism.base_body is not None:
        head |= {BASE_KEY: {"name": mechanism.base_body, **_inertia_data(mechanism.M[0])}}
    head |= {"bodies": bodies}
    band = {} if mechanism.confirmed_band is None else {BAND_KEY: float(mechanism.confirmed_band)}
    of = {"limits_of": dict.fromkeys(mechanism.limits.without_gravity, BOUNDED_FORCES[1])}
    end = {"frames": frames} if frames else {}
    return head | coordinates | end | (of if of["limits_of"] else {}) | band | stated


def _check_writable(mechanism: Mechanism) -> None:
    robot = f"robot {quote_value(mechanism.name)}"
    symbolic = [name for name, array in mechanism.arrays.items() if is_symbolic(array)]
    if symbolic:
        raise JounceError(f"{robot} contains symbols in {', '.join(symbolic)}; a robot file needs numbers")
    for name, array in mechanism.arrays.items():
        if np.any(array.astype(float) != array):
            raise JounceError(f"{name} of {robot} has more digits than a double; a robot file holds doubles")
    if GROUND_NAME in mechanism.bodies:
        raise JounceError(f"a body is named {GROUND_NAME!r}, which denotes the ground in a file; rename the body")


def _plain_numbers(x: Any) -> Any:
    """The numbers of an array in lists, whole ones as integers."""
    if x is None:
        return None
    if np.ndim(x):
        return [_plain_numbers(row) for row in x]
    return int(x) if float(x).is_integer() and abs(x) < 1e15 else float(x)


def _pose_data(T: np.ndarray) -> JsonObject:
    said = {"position": _plain_numbers(T[:3, 3])} if T[:3, 3].any() else {}
    if np.any(T[:3, :3] != np.eye(3)):
        said["rotation"] = _plain_numbers(T[:3, :3])
    return {"pose": said} if said else {}


def _joint_data(mechanism: Mechanism, i: int) -> JsonObject:
    """The joint of a body."""
    if i in (several := positions.multiscrew_joints(mechanism)):
        return _free_joint_data(mechanism, i, several[i])
    [j] = mechanism.columns[i]
    said = {"name": mechanism.joints[j], **_screw_data(mechanism.X[j]), **_limits_and_drive(mechanism, j)}
    row, offset, names = mechanism.G[j], mechanism.g[j], mechanism.coordinates
    if offset or [(names[k], row[k]) for k in np.flatnonzero(row)] != [(mechanism.joints[j], 1)]:
        said["follows"] = {"coordinates": {names[k]: _plain_numbers(row[k]) for k in np.flatnonzero(row)}}
        said["follows"] |= {"offset": _plain_numbers(offset)} if offset else {}
    return said


def _free_joint_data(mechanism: Mechanism, i: int, joint: Position) -> JsonObject:
    """A joint of several screws, by the point that its axes pass through, or by its screws."""
    own, X, point = list(mechanism.columns[i]), mechanism.X[list(mechanism.columns[i])], np.asarray(joint.T)[:3, 3]
    names = [f"{joint.name}.{velocity}" for velocity in joint.group.velocities]
    if names != (stated := [mechanism.joints[j] for j in own]):
        came = f"the variables of a {joint.group.name} joint are {join_names(stated)}"
        raise JounceError(f"{came}; a file has {join_names(names)}")
    said: JsonObject = {"name": joint.name, "type": joint.group.name}
    if not np.array_equal(robot_files.place_screws(joint.group, point), X):
        said["screws"] = _plain_numbers(X)
    elif point.any():
        said["point"] = _plain_numbers(point)
    of = {v: _limits_and_drive(mechanism, j) for v, j in zip(joint.group.velocities, own, strict=True)}
    of = {v: stated for v, stated in of.items() if stated}
    return said | ({"velocities": of} if of else {})


def _limits_and_drive(mechanism: Mechanism, j: int) -> JsonObject:
    said: JsonObject = {}
    drives = {key: array[j] for key, array in vars(mechanism.drives).items() if array[j] != UNDRIVEN[key]}
    for what, stated in (("limits", mechanism.limits.stated(j)), ("drive", drives)):
        said |= {what: {key: _plain_numbers(x) for key, x in stated.items()}} if stated else {}
    return said


def _screw_data(X: np.ndarray) -> JsonObject:
    """A screw by its axis, the point of the axis nearest the origin and the pitch, or by its numbers."""
    xi, eta = X[:3], X[3:]
    if not xi.any():
        return {"type": "prismatic", "axis": _plain_numbers(eta)}
    point, pitch = np.cross(xi, eta), xi @ eta
    for kind, h in (("revolute", 0.0), ("helical", pitch)):
        if np.array_equal(robot_files.axis_screw(kind, xi, point, h), X):
            foot = {"point": _plain_numbers(point)} if point.any() else {}
            return {
                "type": kind,
                "axis": _plain_numbers(xi),
                **foot,
                **({"pitch": _plain_numbers(h)} if kind == "helical" else {}),
            }
    return {"screw": _plain_numbers(X)}


@np.errstate(all="ignore")  # numbers too large to divide or square are written as the matrix
def _inertia_data(M: np.ndarray) -> JsonObject:
    """An inertia about the COM in as few digits as give the same matrix, or the matrix."""
    if not M.any():
        return {}
    m, h, _ = moments(M)
    mass, h = m[0, 0], h[:, 0]
    com = _round_to_fit(h / mass if mass else h, lambda c: np.array_equal(c * mass, h))
    if com is not None:
        theta = M[:3, :3] + mass * portable_product(hat(com), hat(com))
        six = theta[np.triu_indices(3)]
        about = _round_to_fit(six, lambda x: np.array_equal(inertia_matrix(mass, com, symmetric_matrix(x)), M))
        if about is not None:
            return {
                "inertia": {"mass": _plain_numbers(mass), "com": _plain_numbers(com), "inertia": _plain_numbers(about)}
            }
    return {"inertia": {"matrix": _plain_numbers(M)}}


def _round_to_fit(numbers: np.ndarray, fit: Callable[[np.ndarray], bool]) -> np.ndarray | None:
    """The numbers to as few decimals as fit, or with all their digits, or None where even these do not."""
    if not np.isfinite(numbers).all():
        return None
    first = -math.floor(math.log10(np.abs(numbers).max(initial=1e-300)))  # the decimal where the largest begins
    rounded = [np.round(numbers, first + more) for more in range(17)]
    return next((short for short in (*rounded, numbers) if fit(short)), None)
