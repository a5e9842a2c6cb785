"""Limits that estimated rates and forces break, beyond what their deviations leave open."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine
from jounce.limits.joints import joint_limits
from jounce.limits.ratios import SIGNS, build_scale
from jounce.limits.samples import limited_values
from jounce.live.forces import LiveForces
from jounce.model.limit_kinds import EFFORT_KINDS, MOTION_KINDS
from jounce.model.limits import Limits

CERTAIN_DEVIATIONS = 2.0  # beyond a bound
JUDGED_KINDS = (*MOTION_KINDS, *EFFORT_KINDS)  # in the order of the deviations of rates and forces
_SIGN_COLUMN = np.array(SIGNS)[:, None]


class BrokenLimit(NamedTuple):
    """A limit that a joint breaks: the value, its standard deviation, and the bound."""

    limit: str
    joint: str
    value: float
    deviation: float
    bound: float


class JudgedLimits(NamedTuple):
    """The limits of a robot, and the kinds that are judged live: their bounds (kinds, 2, n), upper and negative lower.

    `tolerant` are these bounds with room for rounding, `weighs` says whether one is of effort without gravity.
    """

    limits: Limits
    kinds: tuple[str, ...]
    bounds: np.ndarray
    tolerant: np.ndarray
    weighs: bool


def judged_limits(robot: Engine) -> JudgedLimits:
    """The limits of motion, effort and its rates."""
    limits = joint_limits(robot.mechanism)
    kinds = tuple(kind for kind in JUDGED_KINDS if kind in limits.kinds)
    scales = [build_scale(limits.bounds(kind), kind) for kind in kinds]
    shape = len(kinds), len(SIGNS), robot.n
    bounds = np.array([[scale.bound(sign) for sign in SIGNS] for scale in scales]).reshape(shape)
    tolerant = np.array([[scale.tolerant(sign) for sign in SIGNS] for scale in scales]).reshape(shape)
    return JudgedLimits(limits, kinds, bounds, tolerant, any(kind in limits.without_gravity for kind in kinds))


def find_broken(
    robot: Engine, judged: JudgedLimits, rates: Sequence[np.ndarray], spread: np.ndarray, forces: LiveForces
) -> list[BrokenLimit]:
    """The limits that values break by more than two deviations, `spread` (5, n) those of the rates; NaN breaks none."""
    if not judged.kinds:
        return []
    gravity = compute(robot, "gravity_forces", rates[:3]) if judged.weighs else ()
    values = limited_values(judged.limits, rates, forces[:3], gravity)
    deviations = dict(zip(JUDGED_KINDS, [*spread, *forces.deviations], strict=True))
    x, off = (np.array([table[kind] for kind in judged.kinds])[:, None] for table in (values, deviations))
    beyond = _SIGN_COLUMN * x - CERTAIN_DEVIATIONS * off > judged.tolerant
    if not beyond.any():
        return []
    return [
        BrokenLimit(
            judged.kinds[k],
            robot.joint_names[j],
            float(x[k, 0, j]),
            float(off[k, 0, j]),
            float(SIGNS[side] * judged.bounds[k, side, j]),
        )
        for k, side, j in np.argwhere(beyond)
    ]
