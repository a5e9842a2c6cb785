"""Deflections of elastic joints over series: of springs that are not linear, and of springs with a damper.

Problem: the deflection delta of a spring that carries Q, and its rates: phi(delta) = Q, or with a damper D parallel to
the spring, ``phi(delta) + D delta' = Q``.

Algorithm: without a damper, delta by `spring_deflection.spring_deflection` and ``delta' = Q' / phi'(delta)`` for its
rates. With one, the deflection is a state with the time constant D / phi'. Where it is not integrated, at one instant,
it is an asymptotic series: fixed-point iterations ``delta = phi^-1(Q - D delta')``, each of which takes one more rate
of Q. Of a linear spring the terms are ``(-D / K)^k Q^(k) / K``. The first of them fall if the motion is slow compared
with the time constant.

Failure: `UnreachableError` beyond the ends of a spring, and for rates where a spring has no stiffness; `JounceError`
where the last term of a series is no smaller than those before it.
"""

from collections.abc import Sequence
from functools import singledispatch
from itertools import pairwise

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import Array
from jounce.model.series_functions import inverse
from jounce.model.spring_deflection import UnreachableError, spring_deflection
from jounce.model.springs import CubicSpring, Spring, force_along
from jounce.spatial.series import Series, from_rate

FORCE_ROUNDING = 1e-8  # of the largest force: smaller ones have lost half their digits, all that rates near zero need
NEGLIGIBLE_TERM = 1e-13  # of a deflection: smaller terms of its series are rounding, and need not fall


def deflect_spring(spring: Spring, Q: Series, largest: float = 0.0) -> Series:
    """delta with phi(delta) = Q; `largest` is the largest force of the robot, of which the others have the rounding."""
    if isinstance(spring, CubicSpring) and spring.k3 == 0:
        return Q * (1 / spring.k)
    return solve_deflection(Q[0], spring, Q, largest)


@singledispatch
def solve_deflection(force: Array, spring: Spring, Q: Series, largest: float) -> Series:
    """delta with phi(delta) = Q, Q[0] being `force`: other kinds of arrays may register a rule of their own."""

    def rate(delta: Series) -> Series:
        _check_stiffness(spring, Q, largest)
        return Q.dot * inverse(force_along(spring, delta, 1))

    return from_rate(spring_deflection(spring, force), rate)


def _check_stiffness(spring: Spring, Q: Series, largest: float) -> None:
    """Raise `UnreachableError` where rates of a deflection are asked for and the spring has no stiffness.

    A force that crosses zero within 1e-8 s counts as zero.
    """
    if not (isinstance(spring, CubicSpring) and spring.k == 0):
        return
    slack = np.flatnonzero(np.abs(Q[0]) <= FORCE_ROUNDING * (largest + np.abs(Q[1])))
    if slack.size:
        raise UnreachableError(
            f"the spring has no stiffness where it carries {Q[0].flat[slack[0]]:.3g}, so its motor would move"
            " infinitely fast; give CubicSpring a k above 0, or ask for motor positions without rates",
            int(slack[0]),
        )


def expand_damped_deflection(spring: Spring, damping: float, Q: Series, terms: int) -> list[Series]:
    """The sums of 0, 1, ... `terms` terms of delta with phi(delta) + D delta' = Q."""
    sums = [Q * 0, deflect_spring(spring, Q)]
    while len(sums) <= terms:  # the rate of a sum takes a rate of Q more than the sum
        sums.append(deflect_spring(spring, Q - sums[-1].dot * damping))
    return sums[: terms + 1]


def damped_deflection_rates(spring: Spring, damping: float, Q: Series, delta: Array) -> Series:
    """The rates of a deflection that is known, from delta' = (Q - phi(delta)) / D."""
    return from_rate(delta, lambda delta: (Q - force_along(spring, delta)) * (1 / damping))


def check_series(sums: Sequence[Series], time_constant: float) -> None:
    """Raise `JounceError` if the last term of a series is no smaller than the terms before, over the batch."""
    sizes = [float(np.nanmax(np.abs(b[0] - a[0]), initial=0.0)) for a, b in pairwise(sums)]
    if len(sizes) > 1 and sizes[-1] >= max(sizes[1:-1] or sizes[:1]) and sizes[-1] > NEGLIGIBLE_TERM * sizes[0]:
        raise JounceError(
            f"the series of the damper does not converge: term {len(sizes)} is {sizes[-1]:.2g}, not below the one"
            f" before; the time constant D/K is {time_constant:.3g} s; use motors_along(motion), which is exact"
        )
