"""Factors of speed by direct evaluation, where they enter no polynomial: Coulomb friction is a tanh of a velocity.

The function is the largest ratio to a limit of the whole motion at a factor c, peaks between samples included. Factors
rise in steps until one breaks a limit; Brent's method (`scipy.optimize.brentq`) then finds where it is 1, between
this factor and the last one that kept all limits. Limits that are broken only between two factors of the steps are not
noticed. `JounceError` where no factor down to 3e-11 keeps them.
"""

import numpy as np

from jounce.core.errors import JounceError
from jounce.limits.feasible_factors import sample_states
from jounce.limits.friction import acting_friction
from jounce.limits.limited_motion import LimitedMotion
from jounce.limits.motion_polynomials import split_motion
from jounce.limits.worst_values import Worst
from jounce.model.elasticity import ElasticLaw
from jounce.model.limit_kinds import LIMIT_KINDS
from jounce.model.springs import CubicSpring, DampedSpring

_SPEED_FACTOR_STEP = 1 / 32  # between the factors that are tried: limits broken only between two of them are missed
_SPEED_FACTOR_GROWTH = 1.05  # from one factor to the next above 1: steps in proportion, a twentieth each
_MAX_SPEED_FACTOR = 1000.0  # times the given speed: no motion is meant to be faster, so that no limit bounds it
_SPEED_FACTOR_TOLERANCE = 1e-13  # relative, close to the rounding of a check
_MAX_SPEED_FACTOR_HALVINGS = 30  # of the first step, to 3e-11: where no slower factor keeps the limits either

Place = tuple[str, int, float]  # of a limit: kind, joint, time in the given motion


def is_polynomial(b: LimitedMotion) -> bool:
    """Whether limited values are polynomials of the factor: linear springs, and no friction of links or motors."""
    mechanism = b.robot.mechanism
    if b.forces and acting_friction(mechanism):
        return False
    motors = mechanism.elasticity if any(LIMIT_KINDS[kind].takes for kind in b.kinds) else None
    return motors is None or not (motors.friction.any() or any(map(is_nonlinear, motors.springs)))


def is_nonlinear(law: ElasticLaw | None) -> bool:
    """Whether the force of a spring is not proportional to its deflection."""
    spring = law.spring if isinstance(law, DampedSpring) else law
    return spring is not None and not (isinstance(spring, CubicSpring) and spring.k3 == 0)


def bracket_factor(b: LimitedMotion) -> tuple[float, Place | None]:
    """The factor at which a limit is met, and which limit that is; infinite where none is met up to a thousand."""
    from scipy.optimize import brentq

    sample_states(b)  # raises where a limit is broken at every speed
    # Rise until a limit is broken.
    low, high = 0.0, _SPEED_FACTOR_STEP
    while find_worst_limit(b, high)[0] <= 1:
        low, high = high, high + _SPEED_FACTOR_STEP if high < 1 else high * _SPEED_FACTOR_GROWTH
        if high > _MAX_SPEED_FACTOR:
            return np.inf, None
    # Where already the first factor breaks one, fall until none is broken.
    for _ in range(_MAX_SPEED_FACTOR_HALVINGS):
        if low:
            break
        low, high = (high / 2, high) if find_worst_limit(b, high / 2)[0] <= 1 else (0.0, high / 2)
    if not low:
        raise JounceError(f"no factor of speed down to {high:.1g} keeps the limits; with_limits states others")
    relative = _SPEED_FACTOR_TOLERANCE
    factor = float(brentq(lambda c: find_worst_limit(b, c)[0] - 1, low, high, xtol=relative * low, rtol=relative))
    return factor, find_worst_limit(b, factor)[1]


def find_worst_limit(b: LimitedMotion, factor: float) -> tuple[float, Place]:
    """The largest ratio of the motion at a factor of speed, and where it is."""
    worst = compute_worst(b, factor)
    found = []
    for (kind, sign), ratio in worst.ratios.items():
        j = int(np.argmax(ratio))
        found.append((float(ratio[j]), (kind, j, float(b.given_times(worst.t[kind, sign][j], factor)))))
    return max(found)


def compute_worst(b: LimitedMotion, factor: float) -> Worst:
    """The worst values of the motion at a factor of speed."""
    scaled = b.scaled(1 / factor)
    worst = Worst(scaled)
    for pieces in split_motion(scaled):
        worst.take_worst(pieces)
    return worst
