"""Reads motions in YAML and JSON: analytic terms, ROS trajectories, or way points.

Terms are per joint; every key and number of them is checked.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, join_names, locate_errors, quote_value
from jounce.io import files, robot_writing
from jounce.io.entries import Entry
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism
from jounce.motion import Motion, ros, units
from jounce.motion.analytic import AnalyticCurve, Cosine, Terms
from jounce.motion.base import POSE_COLUMNS
from jounce.motion.curves import COMPONENTS
from jounce.motion.joint_matching import MotionDescription, build_motion, match_joints
from jounce.motion.ros import find_trajectories, from_joint_trajectory

MAX_MOTION_STATES = 100_000_000  # 800 MB per column: more is a typing error


def read(entry: Entry, mechanism: Mechanism, skip: bool = False) -> Motion:
    """Return the motion of a file for a mechanism.

    It may have ``stance: [[TIME, [FRAME, ...]], ...]`` and ``blend: SECONDS`` as `Motion.with_stances` takes them. A
    JointTrajectory may be alone or in a plan; of its points bad ones are refused, or left out if they are to `skip`.
    """
    if next(find_trajectories(entry.value), None) is not None:
        with locate_errors(entry.place):
            parts = from_joint_trajectory(entry.value, skip)
            motion = match_joints(Motion(**parts._asdict()), mechanism)
    else:
        description = read_terms(entry)
        with locate_errors(entry.path):
            motion = build_motion(description, mechanism)
    # A list of messages states no stances.
    if not isinstance(entry.value, Mapping):
        return motion
    if "blend" in entry.value and "stance" not in entry.value:
        raise entry.get("blend").error("'stance' too: which contacts are there, from when on")
    stance = entry.get("stance", [])
    with locate_errors(stance.place):
        return motion.with_stances(stance.value, entry.get("blend", 0).value)


def read_terms(entry: Entry) -> MotionDescription:
    """Return the terms of a motion.

    They are ``time: {start, stop, count}``, ``joints: {NAME: {offset, cosines, polynomial}}`` and, where bodies or
    merged links exert wrenches, ``wrenches: {NAME: {mx: {offset, cosines, polynomial}, ..., fz: {...}}}``; where the
    base moves ``base: {x: {offset, ...}, ..., qz: {...}}``. Contacts that come and leave are no terms: see `read`.
    """
    motion = entry.keys(("time", "joints"), ("name", "wrenches", "base", "stance", "blend"))
    joints = motion.get("joints").named("joints").members()
    bodies = motion.get("wrenches", {}).named("wrenches").members()
    wrenches = {body: terms.named(f"the wrench of {quote_value(body)}") for body, terms in bodies.items()}
    return MotionDescription(
        {name: _read_curve(terms.named(f"joint {quote_value(name)}")) for name, terms in joints.items()},
        {body: _read_components(terms, COMPONENTS) for body, terms in wrenches.items()},
        _read_times(motion.get("time").named("time")),
        _read_components(motion.get("base").named("base"), POSE_COLUMNS) if "base" in motion.members() else None,
    )


def has_points(document: Any) -> bool:
    """Return whether a document has way points: points without times."""
    points = document.get("points") if isinstance(document, Mapping) else None
    return isinstance(points, list) and not any(
        isinstance(point, Mapping) and ros.TIME_FIELD in point for point in points
    )


def read_points(entry: Entry, mechanism: Mechanism, unit: str | None) -> list[dict[str, float]]:
    """Return way points of a file, positions by joint.

    It has ``points: [[NUMBER, ...], ...]`` in the order of ``joint_names``, or of the robot, or positions by joint. As
    in a JointTrajectory, a point may be ``{positions: [NUMBER, ...]}``. Angles without ``!degrees`` are in `unit`.
    """
    factor = units.ANGLE_UNITS["rad" if unit is None else unit]
    joints = positions.names(mechanism)
    turning = {name for name, unit in zip(joints, coordinates.position_units(mechanism), strict=True) if unit == "rad"}
    entry.keys(("points",), ("joint_names", *ros.IGNORED_FIELDS))
    names = [name.text() for name in entry.get("joint_names", [*joints]).items()]
    points = []
    for i, item in enumerate(entry.get("points").named("points").items(least=1)):
        row = point = item.named(f"point {i} from 0")
        if isinstance(point.value, Mapping) and ros.POINT_FIELDS[0] in point.value:
            row = point.keys(ros.POINT_FIELDS[:1], ros.POINT_FIELDS[1:]).get(ros.POINT_FIELDS[0])
        if isinstance(row.value, Mapping):
            members = row.members()
        else:
            items = row.items()
            if len(items) != len(names):
                raise row.error(f"{len(names)} numbers: {join_names(names)}")
            members = dict(zip(names, items, strict=True))
        points.append({name: x.angle(factor) if name in turning else x.number() for name, x in members.items()})
    return points


def _read_times(time: Entry) -> np.ndarray:
    """Return the times of a motion, with equal steps."""
    time.keys(("stop", "count"), ("start",))
    start, stop, count = time.get("start", 0).number(), time.get("stop").number(), time.get("count").value
    is_count = isinstance(count, int) and not isinstance(count, bool) and 2 <= count <= MAX_MOTION_STATES
    if not is_count or not start < stop or math.isinf(stop - start):
        came = f"time runs from {start:g} to {stop:g} in {quote_value(count)} states"
        raise JounceError(f"{time.place}: {came}; expected stop > start, count 2 to {MAX_MOTION_STATES}")
    return np.linspace(start, stop, count)


def _read_components(terms: Entry, names: Sequence[str]) -> dict[str, Terms]:
    return {name: _read_curve(component) for name, component in terms.keys((), names).members().items()}


def _read_curve(terms: Entry) -> Terms:
    """Return the terms of one coordinate.

    The offset is the constant of its polynomial.
    """
    terms.keys((), ("offset", "cosines", "polynomial"))
    powers = [power.number() for power in terms.get("polynomial", [0]).items(least=1)]
    powers[0] += terms.get("offset", 0).number()
    cosines = []
    for cosine in terms.get("cosines", []).items(f"cosine of {terms.what}"):
        cosine.keys(("amplitude", "frequency"), ("phase",))
        cosines.append(Cosine(*(cosine.get(key, 0).number() for key in ("amplitude", "frequency", "phase"))))
    return Terms(tuple(powers), tuple(cosines))


def write(path: Path, motion: Motion, joints: Sequence[str]) -> None:
    """Write a motion of joints in closed form.

    It is read again with the same bits; it exerts no wrenches.
    """
    if not isinstance(motion.curve, AnalyticCurve):
        raise JounceError(f"{path}: the motion has no analytic terms; expected a table, .csv or .npz")
    time = {"start": motion.start, "stop": motion.stop, "count": len(motion.times)}
    terms = [
        {"polynomial": list(term.polynomial), "cosines": [vars(cosine) for cosine in term.cosines]}
        for term in motion.curve.terms
    ]
    data = {"time": time, "joints": dict(zip(joints, terms, strict=True))}
    text = robot_writing.dump_json(data) if path.suffix.lower() == ".json" else robot_writing.dump_yaml(data)
    with files.write_whole(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")
