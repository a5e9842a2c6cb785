"""Limits that estimated rates and forces break, beyond what their deviations leave open."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.limits.joints import joint_limits
from jounce.limits.ratios import SIGNS, build_scale
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

    `rows` says which of `JUDGED_KINDS` they are. `tolerant` are the bounds with room for rounding, `less_gravity`
    (3, 1) is 1 where those of Q, Qd, Q2d are of the force without gravity, else 0.
    """

    limits: Limits
    kinds: tuple[str, ...]
    rows: list[int]
    bounds: np.ndarray
    tolerant: np.ndarray
    less_gravity: np.ndarray


def judged_limits(robot: Engine) -> JudgedLimits:
    """The limits of motion, effort and its rates."""
    limits = joint_limits(robot.mechanism)
    kinds = tuple(kind for kind in JUDGED_KINDS if kind in limits.kinds)
    scales = [build_scale(limits.bounds(kind), kind) for kind in kinds]
    shape = len(kinds), len(SIGNS), robot.n
    bounds = np.array([[scale.bound(sign) for sign in SIGNS] for scale in scales]).reshape(shape)
    tolerant = np.array([[scale.tolerant(sign) for sign in SIGNS] for scale in scales]).reshape(shape)
    rows = [JUDGED_KINDS.index(kind) for kind in kinds]
    less_gravity = np.array([[float(kind in limits.without_gravity)] for kind in EFFORT_KINDS])
    return JudgedLimits(limits, kinds, rows, bounds, tolerant, less_gravity)


def find_broken(
    robot: Engine, judged: JudgedLimits, rates: Sequence[np.ndarray], spread: np.ndarray, forces: LiveForces
) -> list[BrokenLimit]:
    """The limits that values break by more than two deviations, `spread` (5, n) those of the rates; NaN breaks none."""
    if not judged.kinds:
        return []
    values = np.array([*rates, *forces[:3]])
    if judged.less_gravity.any():
        values[-len(EFFORT_KINDS) :] -= judged.less_gravity * compute(robot, "gravity_forces", rates[:3])
    deviations = np.array([*spread, *forces.deviations])
    x, off = values[judged.rows, None], deviations[judged.rows, None]
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
