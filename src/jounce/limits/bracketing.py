"""Factors of speed by direct evaluation, where they enter no polynomial: Coulomb friction is a tanh of a velocity.

The function is the largest ratio to a limit of the whole motion at a factor c, peaks between samples included. Factors
rise in steps until one breaks a limit; Brent's method (`scipy.optimize.brentq`) then finds where it is 1, between
this factor and the last one that kept all limits. Limits that are broken only between two factors of the steps are not
noticed. `JounceError` where no factor up to a thousand breaks a limit, and where none down to 3e-11 keeps them.
"""

import numpy as np

from jounce.core.errors import JounceError
from jounce.limits.bounded import Bounded
from jounce.limits.feasible import states_of
from jounce.limits.friction import friction_of
from jounce.limits.pieces import pieces_of
from jounce.limits.worst import Worst
from jounce.model.elasticity import Law
from jounce.model.kinds import KINDS
from jounce.model.springs import CubicSpring, DampedSpring

_SPEED_FACTOR_STEP = 1 / 32  # between the factors that are tried: limits broken only between two of them are missed
_SPEED_FACTOR_GROWTH = 1.05  # from one factor to the next above 1: steps in proportion, a twentieth each
_MAX_SPEED_FACTOR = 1000.0  # times the given speed: no motion is meant to be faster, so that no limit bounds it
_SPEED_FACTOR_TOLERANCE = 1e-13  # relative, close to the rounding of a check
_MAX_SPEED_FACTOR_HALVINGS = 30  # of the first step, to 3e-11: where no slower factor keeps the limits either

Place = tuple[str, int, float]  # of a limit: kind, joint, time in the given motion


def is_polynomial(b: Bounded) -> bool:
    """Whether limited values are polynomials of the factor: linear springs, and no friction of links or motors."""
    mechanism = b.robot.mechanism
    if b.forces and friction_of(mechanism):
        return False
    motors = mechanism.elasticity if any(KINDS[kind].takes for kind in b.kinds) else None
    return motors is None or not (motors.friction.any() or any(map(_bends, motors.springs)))


def _bends(law: Law | None) -> bool:
    """Whether the force of a spring is not proportional to its deflection."""
    spring = law.spring if isinstance(law, DampedSpring) else law
    return spring is not None and not (isinstance(spring, CubicSpring) and spring.k3 == 0)


def bracketed_factor(b: Bounded) -> tuple[float, Place]:
    """The factor at which a limit is met, and which limit that is."""
    from scipy.optimize import brentq

    states_of(b)  # raises where a limit is broken at every speed
    # Rise until a limit is broken.
    low, high = 0.0, _SPEED_FACTOR_STEP
    while worst_at(b, high)[0] <= 1:
        low, high = high, high + _SPEED_FACTOR_STEP if high < 1 else high * _SPEED_FACTOR_GROWTH
        if high > _MAX_SPEED_FACTOR:
            raise JounceError(f"no limit bounds the speed of this motion up to {_MAX_SPEED_FACTOR:g} times its own")
    # Where already the first factor breaks one, fall until none is broken.
    for _ in range(_MAX_SPEED_FACTOR_HALVINGS):
        if low:
            break
        low, high = (high / 2, high) if worst_at(b, high / 2)[0] <= 1 else (0.0, high / 2)
    if not low:
        raise JounceError(f"no factor of speed down to {high:.1g} keeps the limits; with_limits states others")
    relative = _SPEED_FACTOR_TOLERANCE
    factor = float(brentq(lambda c: worst_at(b, c)[0] - 1, low, high, xtol=relative * low, rtol=relative))
    return factor, worst_at(b, factor)[1]


def worst_at(b: Bounded, factor: float) -> tuple[float, Place]:
    """The largest ratio of the motion at a factor of speed, and where it is."""
    worst = worst_of(b, factor)
    found = []
    for (kind, sign), ratio in worst.ratios.items():
        j = int(np.argmax(ratio))
        found.append((float(ratio[j]), (kind, j, float(b.given_times(worst.t[kind, sign][j], factor)))))
    return max(found)


def worst_of(b: Bounded, factor: float) -> Worst:
    """The worst values of the motion at a factor of speed."""
    scaled = b.scaled(1 / factor)
    worst = Worst(scaled)
    for pieces in pieces_of(scaled):
        worst.take_worst(pieces)
    return worst
