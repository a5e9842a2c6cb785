"""Match motions and robots by the names of joints.

`match_joints` gives a motion the joints of a robot, in its order, and `unwrap_curve` goes back from such a curve to the
one that it arranges. `build_motion` makes the motion of a robot that a file describes in closed form: terms by the
names of joints, bodies and components. `follow_points` makes the motion of a robot along way points, which its position
limits have to contain, and `take_points` does where a caller gives points in place of a motion.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from jounce.arguments import names
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.named_entries import entry_names
from jounce.model import coordinates, positions
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position
from jounce.motion import units, way_points
from jounce.motion.analytic import AnalyticCurve, ExponentialCurve, Terms
from jounce.motion.base import POSE_COLUMNS, align_quaternions, with_blocks
from jounce.motion.composite_curves import RetimedCurve
from jounce.motion.curves import COMPONENTS, ArrangedCurve, Curve
from jounce.motion.motion import Motion
from jounce.motion.time_law import TimeLawCurve

PATH_DURATION = 1.0  # s, of a path whose times are sought: retiming takes any
_LIMIT_ROUNDING = 1e-9  # of a position: what computing it may leave beyond a limit


def unwrap_curve(curve: Curve, t: np.ndarray) -> tuple[Curve, np.ndarray, tuple[int, ...]]:
    """Return a curve without changes of its pace and of its columns.

    Its times t and the numbers of its columns, (n,), come with it.
    """
    order = np.arange(curve.columns)
    while isinstance(curve, RetimedCurve | TimeLawCurve) or (
        isinstance(curve, ArrangedCurve) and np.ndim(curve.factors) == 0
    ):
        if isinstance(curve, ArrangedCurve):
            order = curve.order[order]
        t, curve = curve.inner(t), curve.base
    return curve, t, tuple(order.tolist())


def match_joints(motion: Motion, mechanism: Mechanism) -> Motion:
    """Return a motion with the joints of a robot, in its order."""
    joints, several = positions.names(mechanism), positions.list_multiscrew_joints(mechanism)
    # Columns without names are those of the robot, in its order.
    if motion.joint_names is None:
        if motion.curve.columns != len(joints):
            came = f"{motion.curve.columns} joints without names"
            raise JounceError(f"{came}; {mechanism.name!r} has {join_names(joints)}")
        return replace(motion, joint_names=joints, several=several) if several else motion
    if motion.joint_names == joints:
        return motion if motion.several == several else replace(motion, several=several)
    expected = f"{join_names(joints)}, the joints of {mechanism.name!r}"
    names.check_names(motion.joint_names, joints, names.find_followers(mechanism), expected)
    order = np.array([motion.joint_names.index(joint) for joint in joints])
    samples, torques = motion.samples, motion.torques
    if samples is not None:
        samples = samples[0], samples[1][:, order]
    # Torques have a column per velocity: of balls, planar and free joints these have other names than the numbers.
    if torques is not None:
        places, velocities = [x.numbers for x in motion.several], [x.velocities for x in motion.several]
        torque_names = list(chain(*with_blocks(motion.joint_names, places, velocities)))
        torques = torques[0], torques[1][:, [torque_names.index(name) for name in mechanism.coordinates]]
    residual = None if motion.residual is None else motion.residual[order]
    arranged = replace(motion, curve=ArrangedCurve(motion.curve, order), joint_names=joints, several=several)
    return replace(arranged, samples=samples, residual=residual, torques=torques)


@dataclass(frozen=True)
class MotionDescription:
    """A motion in closed form as a file states it: terms by joint, by body and component of its wrench, and times.

    `base` are the terms of position and quaternion of the base, None if it has none.
    """

    joints: Mapping[str, Terms]
    wrenches: Mapping[str, Mapping[str, Terms]]
    t: np.ndarray
    base: Mapping[str, Terms] | None = None


def build_motion(description: MotionDescription, mechanism: Mechanism) -> Motion:
    """Return the motion that terms describe.

    Components of wrenches and the base that they leave out are zero, qw one. Of balls, planar and free joints
    terms state the numbers or, in place of a quaternion or of cosine and sine, the exponential coordinates
    ``ankle.rx``, ...
    """
    joints, several, t = positions.names(mechanism), positions.list_multiscrew_joints(mechanism), description.t
    # Joints by exponential coordinates: their names stand in place of those of quaternions, or of cosine and sine.
    exponential = [x for x in several if not {*_exponential_names(x)}.isdisjoint(description.joints)]
    turns, blocks = [x.turn for x in exponential], [_exponential_names(x) for x in exponential]
    expected_names = list(chain(*with_blocks(joints, turns, blocks)))
    names.check_names(
        description.joints,
        expected_names,
        names.find_followers(mechanism),
        f"terms for each of {join_names(expected_names)}",
    )
    for body in description.wrenches:
        mechanism.frame(body)
    ends = float(t[0]), float(t[-1])
    loads = {
        body: AnalyticCurve(tuple(components.get(name, Terms()) for name in COMPONENTS), *ends)
        for body, components in description.wrenches.items()
    }
    q: Curve = AnalyticCurve(tuple(description.joints[name] for name in expected_names), *ends)
    if len(exponential) > 0:
        starts = (expected_names.index(names[0]) for names in blocks)
        q = ExponentialCurve(q, tuple(slice(i, i + len(x)) for i, x in zip(starts, blocks, strict=True)))
    if mechanism.floats and description.base is None:
        expected = f"base: with terms of some of {join_names(POSE_COLUMNS)}, position in m and quaternion"
        raise JounceError(f"{mechanism.name!r} floats, and nothing says where its base is; expected {expected}")
    base = None
    if description.base is not None:
        # Without any of the quaternion the base does not turn: Q = (1; 0).
        has_quaternion = not {*POSE_COLUMNS[3:]}.isdisjoint(description.base)
        others = {} if has_quaternion else {"qw": Terms((1.0,))}
        base = AnalyticCurve(
            tuple(description.base.get(name, others.get(name, Terms())) for name in POSE_COLUMNS), *ends
        )
    return Motion(q, joints, "analytic terms, all rates exact", loads, grid=t, base_curve=base, several=several)


def _exponential_names(joint: Position) -> list[str]:
    """Return the names of the exponential coordinates of a joint.

    They are ``ankle.rx``, ...: of its axis times its angle.
    """
    return [f"{joint.name}.r{'xyz'[axis]}" for axis in joint.group.axes if axis < 3]


def take_points(
    mechanism: Mechanism, given: Any, duration: Any = None, tolerance: Any = None, any_duration: bool = False
) -> Any:
    """Return the motion along points, or whatever else is given.

    Whoever takes motions refuses what is neither. With `any_duration` points need no duration.
    """
    if not _are_points(given):
        for name, value in (("duration", duration), ("tolerance", tolerance)):
            if value is not None:
                raise JounceError(f"{name} is for way points, which have no times; leave it out")
        return given
    if duration is None and not any_duration:
        raise JounceError(
            "way points have no times; state how long the motion along them lasts by duration=, or find the fastest"
            " motion by robot.retime(points)"
        )
    return follow_points(given, mechanism, PATH_DURATION if duration is None else duration, tolerance)


def describe_moment(motion: Motion, t: float) -> str:
    """Describe a time of a motion.

    Along a path through way points it is between two of them.
    """
    curve, inner, _ = unwrap_curve(motion.curve, np.array([t]))
    if not isinstance(curve, way_points.RestToRestCurve) or len(curve.numbers) == 0:
        return f"at t = {t:g} s"
    piece = int(np.searchsorted(curve.base.x, curve.inner(inner)[0], side="right")) - 1
    piece = min(max(piece, 0), len(curve.numbers) - 2)
    return f"between points {curve.numbers[piece]} and {curve.numbers[piece + 1]} from 0"


def is_along_points(motion: Motion) -> bool:
    """Return whether a motion is along way points."""
    curve, _, _ = unwrap_curve(motion.curve, np.array([motion.start]))
    return isinstance(curve, way_points.RestToRestCurve)


def _are_points(given: Any) -> bool:
    """Return whether an argument is meant as points."""
    if isinstance(given, list | tuple):
        return not any(isinstance(x, Motion) for x in given)
    return isinstance(given, np.ndarray) or entry_names(given) is not None or hasattr(given, "shape")


def follow_points(points: Any, mechanism: Mechanism, duration: Any, tolerance: Any) -> Motion:
    """Return the motion of a robot from rest to rest along points.

    Columns without names are those of the robot, in its order. Raises `JounceError` where a point is beyond a limit.
    """
    q, given_names = way_points.arrange_points(points, None)
    joints = positions.names(mechanism)
    if given_names is not None:
        expected = f"{join_names(joints)}, the joints of {mechanism.name!r}"
        names.check_names(given_names, joints, names.find_followers(mechanism), expected)
        q = q[:, [list(given_names).index(joint) for joint in joints]]
    elif q.shape[1] != len(joints):
        came = f"points have {q.shape[1]} columns"
        raise JounceError(f"{came}; expected {len(joints)}, one for each of {join_names(joints)} of {mechanism.name!r}")
    # Quaternions become neighbours of length 1, whose signs are free.
    columns, notes = dict(zip(joints, q.T, strict=True)), list[str]()
    for joint in positions.list_multiscrew_joints(mechanism):
        columns, turn_notes = align_quaternions(columns, joint.names[len(joint.group.places) :], True)
        notes += turn_notes
    q = np.stack([columns[joint] for joint in joints], axis=1)
    _refuse_points_beyond_limits(q, mechanism)
    motion = Motion(**way_points.from_points(q, duration, tolerance, joints)._asdict())
    return replace(motion, several=positions.list_multiscrew_joints(mechanism), notes=(*notes, *motion.notes))


def _refuse_points_beyond_limits(q: np.ndarray, mechanism: Mechanism) -> None:
    """Raise `JounceError` for the first point beyond a position limit.

    Points are (k, nq).
    """
    limits = coordinates.limits(mechanism.tree)
    if mechanism.closure is not None:
        limits = limits.select(list(mechanism.independent_places))
    lower, upper = limits.bounds("position")
    bounded = positions.extents(mechanism, q)
    slack = _LIMIT_ROUNDING * np.maximum(1, np.abs(bounded))
    outside = np.argwhere((bounded < lower - slack) | (bounded > upper + slack))
    if len(outside) == 0:
        return
    i, j = outside[0]
    name, joint_units = positions.extent_names(mechanism)[j], coordinates.units(mechanism)
    came = (
        f"point {i} from 0: joint {quote_value(name)} is at {bounded[i, j]:.6g} {joint_units[j]}, beyond its position"
        f" limits of {lower[j]:.6g} to {upper[j]:.6g}"
    )
    # More than a turn, where all would be within limits in degrees, is hardly meant in rad.
    turns = np.array(joint_units) == "rad"
    radians = bounded * np.where(turns, units.ANGLE_UNITS["deg"], 1.0)
    if np.abs(bounded[:, turns]).max(initial=0) > 2 * np.pi and ((radians >= lower) & (radians <= upper)).all():
        cure = Remedy("numpy.deg2rad makes rad of them", "state the unit by --angles deg")
        raise JounceError(f"{came}; {units.IN_DEGREES}; {cure}")
    raise JounceError(f"{came}; expected points within the limits")
