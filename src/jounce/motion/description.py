"""Motions in closed form as files describe them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from jounce.arguments import names
from jounce.core.errors import JounceError, join_names
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position, list_multiscrew_joints, position_names
from jounce.motion.analytic import AnalyticCurve, ExponentialCurve, Terms
from jounce.motion.base import POSE_COLUMNS, with_blocks
from jounce.motion.curves import COMPONENTS, Curve
from jounce.motion.motion import Motion


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
    """The motion that terms describe; components of wrenches and the base that they leave out are zero, qw one.

    Of balls, planar and free joints terms state the numbers or, in place of a quaternion or of cosine and sine, the
    exponential coordinates ``ankle.rx``, ...
    """
    joints, several, t = position_names(mechanism), list_multiscrew_joints(mechanism), description.t
    turned = [x for x in several if not {*_exponential_names(x)}.isdisjoint(description.joints)]
    turns, blocks = [x.turn for x in turned], [_exponential_names(x) for x in turned]
    given = [name for part in with_blocks(joints, turns, blocks) for name in part]
    names.check_names(
        description.joints, given, names.find_followers(mechanism), f"terms for each of {join_names(given)}"
    )
    for body in description.wrenches:
        mechanism.frame(body)
    ends = float(t[0]), float(t[-1])
    loads = {
        body: AnalyticCurve(tuple(components.get(name, Terms()) for name in COMPONENTS), *ends)
        for body, components in description.wrenches.items()
    }
    q: Curve = AnalyticCurve(tuple(description.joints[name] for name in given), *ends)
    if turned:
        starts = (given.index(names[0]) for names in blocks)
        q = ExponentialCurve(q, tuple(slice(i, i + len(x)) for i, x in zip(starts, blocks, strict=True)))
    if mechanism.floats and description.base is None:
        expected = f"base: with terms of some of {join_names(POSE_COLUMNS)}, position in m and quaternion"
        raise JounceError(f"{mechanism.name!r} floats, and nothing says where its base is; expected {expected}")
    base = None
    if description.base is not None:
        others = {"qw": Terms((1.0,))} if not {*POSE_COLUMNS[3:]} & {*description.base} else {}
        base = AnalyticCurve(
            tuple(description.base.get(name, others.get(name, Terms())) for name in POSE_COLUMNS), *ends
        )
    return Motion(q, joints, "analytic terms, all rates exact", loads, grid=t, base_curve=base, several=several)


def _exponential_names(joint: Position) -> list[str]:
    """The names of the exponential coordinates of a joint, ``ankle.rx``, ...: of its axis times its angle."""
    return [f"{joint.name}.r{'xyz'[axis]}" for axis in joint.group.axes if axis < 3]
