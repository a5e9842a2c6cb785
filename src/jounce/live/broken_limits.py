"""Limits that estimated rates and forces break, beyond what their deviations leave open."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine
from jounce.limits.joints import joint_limits
from jounce.limits.ratios import SIGNS, Scale, build_scale
from jounce.limits.samples import limited_values
from jounce.live.forces import LiveForces
from jounce.model.limit_kinds import EFFORT_KINDS, MOTION_KINDS
from jounce.model.limits import Limits

CERTAIN_DEVIATIONS = 2.0  # beyond a bound
JUDGED_KINDS = (*MOTION_KINDS, *EFFORT_KINDS)  # in the order of the deviations of rates and forces


class BrokenLimit(NamedTuple):
    """A limit that a joint breaks: the value, its standard deviation, and the bound."""

    limit: str
    joint: str
    value: float
    deviation: float
    bound: float


class JudgedLimits(NamedTuple):
    """The limits of a robot, and the scales of the kinds that are judged live."""

    limits: Limits
    scales: Mapping[str, Scale]


def judged_limits(robot: Engine) -> JudgedLimits:
    """The limits of motion, effort and its rates."""
    limits = joint_limits(robot.mechanism)
    scales = {kind: build_scale(limits.bounds(kind), kind) for kind in JUDGED_KINDS if kind in limits.kinds}
    return JudgedLimits(limits, scales)


def find_broken(
    robot: Engine, judged: JudgedLimits, rates: Sequence[np.ndarray], spread: np.ndarray, forces: LiveForces
) -> list[BrokenLimit]:
    """The limits that values break by more than two deviations, `spread` (5, n) those of the rates; NaN breaks none."""
    weighs = any(kind in judged.limits.without_gravity for kind in judged.scales)
    gravity = compute(robot, "gravity_forces", rates[:3]) if weighs else ()
    values = limited_values(judged.limits, rates, forces[:3], gravity)
    found = []
    for kind, scale in judged.scales.items():
        x, off = values[kind], [*spread, *forces.deviations][JUDGED_KINDS.index(kind)]
        for sign in SIGNS:
            bound = sign * scale.bound(sign)
            for j in np.flatnonzero(sign * x - CERTAIN_DEVIATIONS * off > scale.tolerant(sign)):
                found.append(BrokenLimit(kind, robot.joint_names[j], *map(float, (x[j], off[j], bound[j]))))
    return found
