"""Writes robot files of jounce's own format.

The form is the readable one if it restores the same bits, else the exact one.
"""

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
from jounce.model.polynomials import polynomial_laws
from jounce.model.positions import Position
from jounce.model.transmissions import with_followers
from jounce.spatial.inertia import inertia_matrix, moments, symmetric_matrix
from jounce.spatial.lie import hat, portable_product


def yaml_text(mechanism: Mechanism) -> str:
    """Return the YAML text of a mechanism."""
    return dump_yaml(document(mechanism))


def dump_yaml(data: JsonObject, flow: bool | None = None) -> str:
    """Return the YAML text of plain data.

    Vectors, rows and short mappings stand on one line each; with `flow` False none does.
    """
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
    """Return the JSON text of a mechanism."""
    return dump_json(document(mechanism))


def dump_json(data: JsonObject) -> str:
    """Return the JSON text of plain data."""
    return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def document(mechanism: Mechanism) -> JsonObject:
    """Return the content of a mechanism's file as plain data.

    The mechanism is one of numbers.
    """
    _check_writable(mechanism)
    sections = (
        robot_sections.write_loops(mechanism)
        | robot_sections.write_elastic(mechanism)
        | robot_sections.write_contacts(mechanism)
    )
    # Below the sections the file is the tree, with joints that follow others by constant ratios or polynomials.
    laws = polynomial_laws(mechanism)
    mechanism = with_followers(mechanism)
    joints = {i: _joint_data(mechanism, i) for i in mechanism.moving_bodies}
    free_bodies = [i for i, joint in joints.items() if "follows" not in joint]
    for joint in joints.values():
        law = laws.get(joint["name"])
        if law is not None:
            joint["follows"] = {"coordinate": law.leader, "polynomial": _plain_numbers(law.coefficients)}
    free_joints = [mechanism.joints[j] for i in free_bodies for j in mechanism.columns[i]]
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
    data: JsonObject = {"name": mechanism.name, "units": FILE_UNITS, "gravity": _plain_numbers(mechanism.gravity)}
    if mechanism.base_body is not None:
        data[BASE_KEY] = {"name": mechanism.base_body, **_inertia_data(mechanism.M[0])}
    data["bodies"] = bodies
    # Keys follow only where they state something: coordinates are the free joints by default.
    if free_joints != list(mechanism.coordinates):
        data["coordinates"] = list(mechanism.coordinates)
    if len(frames) > 0:
        data["frames"] = frames
    if len(mechanism.limits.without_gravity) > 0:
        data["limits_of"] = dict.fromkeys(mechanism.limits.without_gravity, BOUNDED_FORCES[1])
    data |= {kind: _plain_numbers(x) for kind, x in mechanism.limits.stated_totals.items()}
    if mechanism.confirmed_band is not None:
        data[BAND_KEY] = float(mechanism.confirmed_band)
    return data | sections


def _check_writable(mechanism: Mechanism) -> None:
    """Raise `JounceError` if a file cannot hold a mechanism."""
    robot = f"robot {quote_value(mechanism.name)}"
    symbolic = [name for name, array in mechanism.arrays.items() if is_symbolic(array)]
    if len(symbolic) > 0:
        raise JounceError(f"{robot} contains symbols in {', '.join(symbolic)}; a robot file needs numbers")
    for name, array in mechanism.arrays.items():
        if np.any(array.astype(float) != array):
            raise JounceError(f"{name} of {robot} has more digits than a double; a robot file holds doubles")
    if GROUND_NAME in mechanism.bodies:
        raise JounceError(f"a body is named {GROUND_NAME!r}, which denotes the ground in a file; rename the body")


def _plain_numbers(x: Any) -> Any:
    """Return the numbers of an array in lists, whole ones as integers."""
    if x is None:
        return None
    if np.ndim(x) > 0:
        return [_plain_numbers(row) for row in x]
    return int(x) if float(x).is_integer() and abs(x) < 1e15 else float(x)


def _pose_data(T: np.ndarray) -> JsonObject:
    """Return the pose of a body or frame, without identities."""
    pose: JsonObject = {}
    if T[:3, 3].any():
        pose["position"] = _plain_numbers(T[:3, 3])
    if np.any(T[:3, :3] != np.eye(3)):
        pose["rotation"] = _plain_numbers(T[:3, :3])
    return {"pose": pose} if len(pose) > 0 else {}


def _joint_data(mechanism: Mechanism, i: int) -> JsonObject:
    """Return the joint of a body."""
    multiscrew_joints = positions.multiscrew_joints(mechanism)
    if i in multiscrew_joints:
        return _free_joint_data(mechanism, i, multiscrew_joints[i])
    [j] = mechanism.columns[i]
    data = {"name": mechanism.joints[j], **_screw_data(mechanism.X[j]), **_limits_and_drive(mechanism, j)}
    # theta = G q + g, unless the joint is a coordinate itself.
    row, offset, names = mechanism.G[j], mechanism.g[j], mechanism.coordinates
    factors = {names[k]: row[k] for k in np.flatnonzero(row)}
    if offset != 0 or factors != {mechanism.joints[j]: 1}:
        data["follows"] = {"coordinates": {name: _plain_numbers(factor) for name, factor in factors.items()}}
        if offset != 0:
            data["follows"]["offset"] = _plain_numbers(offset)
    return data


def _free_joint_data(mechanism: Mechanism, i: int, joint: Position) -> JsonObject:
    """Return a joint of several screws.

    It is stated by the point that its axes pass through, or by its screws.
    """
    columns = list(mechanism.columns[i])
    X, point = mechanism.X[columns], np.asarray(joint.T)[:3, 3]
    # A file names the variables by the joint and the velocities of its type.
    names_of_file = [f"{joint.name}.{velocity}" for velocity in joint.group.velocities]
    names = [mechanism.joints[j] for j in columns]
    if names_of_file != names:
        came = f"the variables of a {joint.group.name} joint are {join_names(names)}"
        raise JounceError(f"{came}; a file has {join_names(names_of_file)}")
    data: JsonObject = {"name": joint.name, "type": joint.group.name}
    if not np.array_equal(robot_files.place_screws(joint.group, point), X):
        data["screws"] = _plain_numbers(X)
    elif point.any():
        data["point"] = _plain_numbers(point)
    velocities = {v: _limits_and_drive(mechanism, j) for v, j in zip(joint.group.velocities, columns, strict=True)}
    velocities = {v: limits_and_drive for v, limits_and_drive in velocities.items() if len(limits_and_drive) > 0}
    if len(velocities) > 0:
        data["velocities"] = velocities
    return data


def _limits_and_drive(mechanism: Mechanism, j: int) -> JsonObject:
    """Return the limits and the drive of a joint variable."""
    data: JsonObject = {}
    drive = {key: array[j] for key, array in vars(mechanism.drives).items() if array[j] != UNDRIVEN[key]}
    for key, numbers in (("limits", mechanism.limits.stated(j)), ("drive", drive)):
        if len(numbers) > 0:
            data[key] = {kind: _plain_numbers(x) for kind, x in numbers.items()}
    return data


def _screw_data(X: np.ndarray) -> JsonObject:
    """Return a screw by axis, point and pitch, or by numbers.

    The point is the one of the axis that is nearest the origin.
    """
    xi, eta = X[:3], X[3:]
    if not xi.any():
        return {"type": "prismatic", "axis": _plain_numbers(eta)}
    # X = (e; x cross e + h e) with |e| = 1: x = e cross eta and h = e . eta, where rounding restores the same bits.
    point, pitch = np.cross(xi, eta), xi @ eta
    for kind, h in (("revolute", 0.0), ("helical", pitch)):
        if np.array_equal(robot_files.axis_screw(kind, xi, point, h), X):
            data: JsonObject = {"type": kind, "axis": _plain_numbers(xi)}
            if point.any():
                data["point"] = _plain_numbers(point)
            if kind == "helical":
                data["pitch"] = _plain_numbers(h)
            return data
    return {"screw": _plain_numbers(X)}


# Numbers that are too large to divide or square are written as the matrix.
@np.errstate(all="ignore")
def _inertia_data(M: np.ndarray) -> JsonObject:
    """Return an inertia about the COM, or the matrix.

    The numbers have as few digits as give the same matrix.
    """
    if not M.any():
        return {}
    m, h, _ = moments(M)
    mass, h = m[0, 0], h[:, 0]
    # The COM c restores h = m c.
    com = _round_to_fit(h / mass if mass != 0 else h, lambda c: np.array_equal(c * mass, h))
    if com is not None:
        # By Steiner's theorem the inertia about the COM is M_rot + m hat(c)^2.
        theta = M[:3, :3] + mass * portable_product(hat(com), hat(com))
        six_numbers = theta[np.triu_indices(3)]
        about_com = _round_to_fit(
            six_numbers, lambda x: np.array_equal(inertia_matrix(mass, com, symmetric_matrix(x)), M)
        )
        if about_com is not None:
            data = {"mass": mass, "com": com, "inertia": about_com}
            return {"inertia": {key: _plain_numbers(x) for key, x in data.items()}}
    return {"inertia": {"matrix": _plain_numbers(M)}}


def _round_to_fit(numbers: np.ndarray, fit: Callable[[np.ndarray], bool]) -> np.ndarray | None:
    """Return numbers to as few decimals as fit.

    They keep all their digits where fewer do not fit; the result is None where even all digits do not.
    """
    if not np.isfinite(numbers).all():
        return None
    # Rounding begins at the decimal where the largest number begins.
    first = -math.floor(math.log10(np.abs(numbers).max(initial=1e-300)))
    rounded = [np.round(numbers, first + more) for more in range(17)]
    return next((short for short in (*rounded, numbers) if fit(short)), None)
