"""Motions and robots, matched by joint name."""

from dataclasses import replace

import numpy as np

from jounce.arguments import names
from jounce.core.errors import JounceError, join_names
from jounce.model.mechanism import Mechanism
from jounce.model.positions import list_multiscrew_joints, position_names
from jounce.motion.base import with_blocks
from jounce.motion.composite_curves import RetimedCurve
from jounce.motion.curves import ArrangedCurve, Curve
from jounce.motion.motion import Motion
from jounce.motion.time_law import TimeLawCurve


def unwrap_curve(curve: Curve, t: np.ndarray) -> tuple[Curve, np.ndarray, tuple[int, ...]]:
    """A curve without changes of its pace and of the order of columns: it, its times, and its columns, (n,)."""
    order = np.arange(curve.columns)
    while isinstance(curve, RetimedCurve | TimeLawCurve) or (
        isinstance(curve, ArrangedCurve) and np.ndim(curve.factors) == 0
    ):
        if isinstance(curve, ArrangedCurve):
            order = curve.order[order]
        t, curve = curve.inner(t), curve.base
    return curve, t, tuple(order.tolist())


def match_joints(motion: Motion, mechanism: Mechanism) -> Motion:
    """A motion with the joints of a robot, in its order."""
    joints, several = position_names(mechanism), list_multiscrew_joints(mechanism)
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
    samples = motion.samples and (motion.samples[0], motion.samples[1][:, order])
    places, velocities = [x.numbers for x in motion.several], [x.velocities for x in motion.several]
    own = [name for part in with_blocks(motion.joint_names, places, velocities) for name in part]
    of_torques = [own.index(name) for name in mechanism.coordinates] if motion.torques else []
    torques = motion.torques and (motion.torques[0], motion.torques[1][:, of_torques])
    residual = None if motion.residual is None else motion.residual[order]
    arranged = replace(motion, curve=ArrangedCurve(motion.curve, order), joint_names=joints, several=several)
    return replace(arranged, samples=samples, residual=residual, torques=torques)
