"""Match motions and robots by the names of joints.

`match_joints` gives a motion the joints of a robot, in its order, and `unwrap_curve` goes back from such a curve to the
one that it arranges. `build_motion` makes the motion of a robot that a file describes in closed form: terms by the
names of joints, bodies and components.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from jounce.arguments import names
from jounce.core.errors import JounceError, join_names
from jounce.model import positions
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position
from jounce.motion.analytic import AnalyticCurve, ExponentialCurve, Terms
from jounce.motion.base import POSE_COLUMNS, with_blocks
from jounce.motion.composite_curves import RetimedCurve
from jounce.motion.curves import COMPONENTS, ArrangedCurve, Curve
from jounce.motion.motion import Motion
from jounce.motion.time_law import TimeLawCurve


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
