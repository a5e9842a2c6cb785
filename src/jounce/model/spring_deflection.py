"""Solvers find the deflections of springs that carry a force: of one spring, or of two that act against each other.

One spring, `spring_deflection`: phi(d) = Q for d, where phi rises over an interval of deflections, so that a bracket
holds one solution. Cubic springs that do not soften take a fixed number of steps of Halley's method, for every scalar
type. Others take Newton's method inside a bracket, `rising_root`, on arrays of floats (R. P. Brent, Algorithms for
Minimization without Derivatives, 1973, chapter 4, and W. H. Press et al., Numerical Recipes, section 9.4, rtsafe): a
Newton step that leaves the bracket, or does not halve the last but one, gives way to bisection. Invariant: the force is
at most Q at the low end of a bracket, and at least Q at the high end, state by state.

Two springs with a motor each on one joint, `antagonist_deflections` and with rates `antagonist_series`: the force and
the stiffness of the joint decide both deflections,

    phi1(d1) + phi2(d2) = Q,   phi1'(d1) + phi2'(d2) = S

Along the curve of one force, which the difference e = d1 - d2 runs through, springs that stiffen have a least
stiffness. Beyond it two settings reach each stiffness. The one is taken at which the stiffness rises with e: with the
larger e if springs stiffen, with the smaller if they soften. On arrays of all states at once: on the curve, where
`rising_root` gives the mean deflection of each e, find an e of less stiffness (or of the least), double steps from
there until S is reached, and halve this bracket until Newton's method for both equations converges from it (bisection
safeguards Newton as above). Invariant: the stiffness is below S at the near end of a bracket and not at the far one.

Failure: `UnreachableError` where the interval ends before the force is reached, and where the curve does not reach S,
with the stiffness that it does reach; NaN in `rising_root`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import Array, is_numeric, reciprocal, sqrt
from jounce.model.series_functions import inverse
from jounce.model.springs import CubicSpring, Spring, force_along, read_spring
from jounce.spatial.series import Series, from_rate

Slope = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # of deflections, to forces and stiffnesses
MAX_DEFLECTION_STEPS = 200  # of which bisection alone takes some 60
MAX_BRACKET_DOUBLINGS = 60  # of the step to the far end: 1e18 times the first one
HALLEY_START_TERMS = 5  # of the series of the exponent 1/3 in the start value: what is left out is 1/3072
HALLEY_STEPS = 3  # which take errors from 26 % to 0.7 %, 3e-7 and 2e-20
FIRST_DIFFERENCE_STEP = 1e-3  # rad or m, of the search for a bracket of e; it doubles from step to step
MAX_DIFFERENCE_DOUBLINGS = 16  # of that step: the last one is 33 rad or m
HALVINGS_PER_ATTEMPT = 6  # of the bracket of e before each attempt with Newton's method
MAX_NEWTON_ATTEMPTS = 8  # after which bisection alone has halved the bracket 48 times
LEAST_STIFFNESS_HALVINGS = 30  # give e to 1e-9 of a bracket, and the least stiffness there to the square of that
NEWTON_STEPS_PER_ATTEMPT = 6  # each squares the error, which is at first 2^-6 of a bracket
STIFFNESS_TOLERANCE = 1e-13  # relative, of the sum of both stiffnesses: rounding with room for cancellation
MIN_STIFFNESS_MARGIN = 1e-9  # relative, by which a stiffness must exceed the least one, at which rates are infinite


class UnreachableError(JounceError):
    """No deflection carries a force or has a stiffness; `state` numbers the first state of the batch without one."""

    def __init__(self, text: str, state: int) -> None:
        super().__init__(text)
        self.state = state


def spring_deflection(spring: Spring, force: Array) -> Array:
    """The deflection at which a spring exerts a force; raise `UnreachableError` where it cannot."""
    if is_numeric(force):
        return _solve_numeric(spring, np.asarray(force))
    if isinstance(spring, CubicSpring) and spring.has_fixed_steps:
        return _solve_cubic(spring, force)
    kind = "is given by a function or table"
    if isinstance(spring, CubicSpring):
        kind = "softens" if spring.k3 < 0 else "has no stiffness k at rest"
    raise JounceError(f"a spring that {kind} needs NumPy arrays of floats; springs for symbols are linear or stiffen")


def _solve_cubic(spring: CubicSpring, force: Array) -> Array:
    """Halley's method for m + y^2 m^3 = 1, where y is the force over k sqrt(k / k3), and the deflection force m / k.

    m is near v^(-1/3), v = 1 + y^2, and 1/3 = 1/4 + 1/16 + 1/64 + ...: with five terms, the start value is within 26 %
    of m for all |y| < 1e154, and three steps reduce the error below 1e-19. Beyond, v overflows and m is NaN.
    """
    ratio = (spring.k3 / spring.k) ** 0.5
    y = force * (ratio / spring.k)
    w = y * y
    root = product = sqrt(sqrt(w + 1))
    for _ in range(HALLEY_START_TERMS - 1):
        root = sqrt(sqrt(root))
        product = product * root
    m = reciprocal(product)
    for _ in range(HALLEY_STEPS):
        t = w * m
        u = t * m
        m = m - (m + u * m - 1) * (u * 3 + 1) * reciprocal(u * 3 + u * u * 6 + t * 3 + 1)
    return force * (1 / spring.k) * m


def _solve_numeric(spring: Spring, force: np.ndarray) -> np.ndarray:
    def slope(d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = spring._derivatives(d)
        return found[0], found[1]

    with np.errstate(all="ignore"):  # overflow leaves NaN
        if isinstance(spring, CubicSpring) and spring.k == 0:
            found = np.cbrt(force) / np.cbrt(spring.k3)
        elif isinstance(spring, CubicSpring) and spring.has_fixed_steps:
            found = _solve_cubic(spring, force)
        else:
            found = rising_root(slope, force, spring.range)
    lost = np.isnan(found) & np.isfinite(force)
    if lost.any():
        state = int(np.flatnonzero(lost)[0])
        with np.errstate(all="ignore"):  # the forces at its ends, or far out
            low, high = (float(slope(np.asarray(np.clip(end, -1e9, 1e9)))[0]) for end in spring.range)
        came = f"no deflection of the spring carries {force.flat[state]:g}"
        raise UnreachableError(f"{came}; it carries {low:g} to {high:g}", state)
    return found


@np.errstate(all="ignore")
def rising_root(slope: Slope, target: np.ndarray, bounds: tuple[np.ndarray | float, np.ndarray | float]) -> np.ndarray:
    """x with f(x) = target of a rising function, NaN where no x within bounds has it."""
    low, high, x = _find_bracket(slope, target, bounds)
    last = before = high - low
    done = lost = np.isnan(low) | np.isnan(target)
    for _ in range(MAX_DEFLECTION_STEPS):
        # the bracket shrinks to x on one side
        f, rise = slope(x)
        above = f > target
        low, high = np.where(above, low, x), np.where(above, x, high)
        # Newton's step, if it stays inside and is fast enough, or is down to rounding; else bisection
        step = (target - f) / rise
        at_end = (np.abs(step) <= 2 * np.finfo(float).eps * np.abs(x)) & np.isfinite(rise)
        fast = (x + step > low) & (x + step < high) & (2 * np.abs(step) <= before)
        step = np.where(fast | at_end, step, (high + low) / 2 - x)
        x, before, last = np.where(done, x, x + step), last, np.abs(step)
        done = done | at_end | (f == target) | (high - low <= 0) | (last <= np.finfo(float).tiny)
        if done.all():
            break
    return np.where(lost | ~done | ~(slope(x)[1] > 0), np.nan, x)


def _find_bracket(
    slope: Slope, target: np.ndarray, bounds: tuple[np.ndarray | float, np.ndarray | float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends between which a rising function takes its targets, NaN where they are not found, and a first guess."""
    least, most = np.broadcast_to(bounds[0], target.shape), np.broadcast_to(bounds[1], target.shape)
    middle = np.where(np.isfinite(least) & np.isfinite(most), (least + most) / 2, np.clip(0.0, least, most))
    f, rise = slope(middle)
    # the first guess, on the side of the target, and from there twice as far until the target is passed
    way = np.where(target >= f, 1.0, -1.0)
    guess = np.clip(middle + (target - f) / rise, least, most)
    step = np.maximum(np.abs(guess - middle), np.finfo(float).tiny)
    far = guess
    for _ in range(MAX_BRACKET_DOUBLINGS):
        short = (slope(far)[0] - target) * way < 0
        if not short.any():
            break
        step = np.where(short, 2 * step, step)
        far = np.where(short, np.clip(middle + way * step, least, most), far)
    lost = ~((slope(far)[0] - target) * way >= 0)
    low, high = np.where(way > 0, middle, far), np.where(way > 0, far, middle)
    return np.where(lost, np.nan, low), np.where(lost, np.nan, high), np.where(lost, middle, guess)


@dataclass(frozen=True)
class AntagonisticSprings:
    """Two springs of one joint, each with a motor of its own: a joint of variable stiffness.

    Both act on the joint in its own direction, ``Q = phi1(theta1 - q) + phi2(theta2 - q)``, and at least one of them
    changes its stiffness with its deflection. A wanted stiffness S goes with each state. Of several settings with it,
    the one is taken at which it rises with theta1 - theta2: if springs stiffen, motor 1 is wound up further.

    Parameters
    ----------
    first, second : CubicSpring, SpringTable or function
        The springs of the two motors; a function is one of the deflection, as `SpringFunction.of` takes it.

    Examples
    --------
    >>> import jounce, numpy as np
    >>> springs = jounce.AntagonisticSprings(*[lambda delta: 40 * np.sinh(3 * delta) / 3] * 2)
    >>> round(float(springs.first.stiffness(0.0)), 9)
    40.0
    """

    first: Spring
    second: Spring

    def __init__(self, first: Spring | Callable[[Any], Any], second: Spring | Callable[[Any], Any]) -> None:
        for name, spring in {"first": first, "second": second}.items():
            found = read_spring(spring, f"AntagonisticSprings: {name}")
            if isinstance(found, CubicSpring) and found.k == 0:
                raise JounceError(f"AntagonisticSprings: {name} has no stiffness at rest; give CubicSpring a k above 0")
            object.__setattr__(self, name, found)


class _Setting(NamedTuple):
    """Deflections of both springs that carry a force, the stiffness S that they make, and the sign of dS/de."""

    d: tuple[np.ndarray, np.ndarray]
    S: np.ndarray
    rise: np.ndarray


Curve = Callable[[np.ndarray], _Setting]  # the settings that carry a force, over e
Condition = Callable[[_Setting], np.ndarray]  # state by state


def antagonist_deflections(springs: AntagonisticSprings, Q: np.ndarray, S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The deflections of both springs for a force and a stiffness, arrays of floats; raise `UnreachableError`."""
    if not (is_numeric(Q) and is_numeric(S)):
        raise JounceError("two springs of one joint need NumPy arrays of floats")
    Q, S = np.broadcast_arrays(np.asarray(Q), np.asarray(S))
    known = np.isfinite(Q) & np.isfinite(S)

    def curve(e: np.ndarray) -> _Setting:
        return _solve_setting(springs, Q, e)

    def check(reached: np.ndarray, bound: np.ndarray, word: str) -> None:
        if (lost := known & ~reached).any():
            i = int(np.flatnonzero(lost)[0])
            reason = f"it is {word} {bound.flat[i]:g}, where it rises with theta1 - theta2"
            reason = reason if bound.flat[i] > 0 else "no setting carries this force"
            raise UnreachableError(f"no setting has stiffness {S.flat[i]:g} at force {Q.flat[i]:g}; {reason}", i)

    with np.errstate(all="ignore"):
        # 1. a start with less stiffness than S
        low = _softer_difference(springs, curve, S, known)
        least = curve(low).S
        check(least * (1 + MIN_STIFFNESS_MARGIN) < S, least, "above")
        # 2. a bracket in the direction in which the stiffness rises
        near, far = _find_differences(curve, lambda x: ~(x.S < S), low, 1.0, known)
        # 3. bisection, until Newton's method converges to a setting on this side of the least stiffness
        for _ in range(MAX_NEWTON_ATTEMPTS):
            near, far = _halve_bracket(curve, lambda x: ~(x.S < S), near, far, HALVINGS_PER_ATTEMPT)
            (d1, d2), off = _newton_steps(springs, Q, S, curve(near).d)
            found = (off <= STIFFNESS_TOLERANCE * S) & (d1 - d2 > low)
            if found[known].all():
                break
        check(found, curve(near).S, "below")
    return np.where(known, d1, np.nan), np.where(known, d2, np.nan)


def antagonist_series(springs: AntagonisticSprings, Q: Series, S: Series) -> tuple[Series, Series]:
    """The deflections of both springs with their rates, by the inverse of the Jacobian of (Q, S)."""
    d1, d2 = antagonist_deflections(springs, Q[0], S[0])

    @cache
    def rates() -> tuple[Series, Series]:
        p1, c1 = (force_along(springs.first, first, j) for j in (1, 2))
        p2, c2 = (force_along(springs.second, second, j) for j in (1, 2))
        factor = inverse(p1 * c2 - p2 * c1)
        return (c2 * Q.dot - p2 * S.dot) * factor, (p1 * S.dot - c1 * Q.dot) * factor

    first = from_rate(d1, lambda _: rates()[0])
    second = from_rate(d2, lambda _: rates()[1])
    return first, second


def _solve_setting(springs: AntagonisticSprings, Q: np.ndarray, e: np.ndarray) -> _Setting:
    """The setting that carries Q with the difference e: the mean deflection is the root of a rising function."""

    def slope(mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        one, two = springs.first._derivatives(mean + e / 2), springs.second._derivatives(mean - e / 2)
        return one[0] + two[0], one[1] + two[1]

    (low1, high1), (low2, high2) = springs.first.range, springs.second.range
    bounds = np.maximum(low1 - e / 2, low2 + e / 2), np.minimum(high1 - e / 2, high2 + e / 2)
    mean = rising_root(slope, np.where(bounds[0] < bounds[1], Q, np.nan), bounds)
    d = mean + e / 2, mean - e / 2
    one, two = springs.first._derivatives(d[0]), springs.second._derivatives(d[1])
    return _Setting(d, one[1] + two[1], np.sign(one[2] * two[1] - two[2] * one[1]))


def _softer_difference(springs: AntagonisticSprings, curve: Curve, S: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Differences e with less than a stiffness, or else with the least."""
    (low1, high1), (low2, high2) = springs.first.range, springs.second.range
    start = np.full(S.shape, 0.0 if low1 - high2 < 0 < high1 - low2 else (low1 - high2 + high1 - low2) / 2)
    way = -curve(start).rise

    def turned(x: _Setting) -> np.ndarray:
        return ~(x.rise * way < 0)

    near, far = _find_differences(curve, lambda x: turned(x) | (x.S < S), start, way, known)
    if not (curve(far).S < S)[known].all():  # steps went over the least, which may still be below
        near, far = _halve_bracket(curve, turned, near, far, LEAST_STIFFNESS_HALVINGS)
    return np.where(np.isnan(curve(far).S), near, far)


def _find_differences(
    curve: Curve, passed: Condition, start: np.ndarray, way: np.ndarray | float, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Two differences on the way from a start: the condition holds at the second, if anywhere, and not at the first."""
    near = far = start
    for k in range(MAX_DIFFERENCE_DOUBLINGS):
        going = known & ~passed(curve(far))
        if not going.any():
            break
        near, far = np.where(going, far, near), np.where(going, start + way * FIRST_DIFFERENCE_STEP * 2**k, far)
    return near, far


def _halve_bracket(
    curve: Curve, passed: Condition, near: np.ndarray, far: np.ndarray, times: int
) -> tuple[np.ndarray, np.ndarray]:
    for _ in range(times):
        middle = (near + far) / 2
        beyond = passed(curve(middle))
        near, far = np.where(beyond, near, middle), np.where(beyond, middle, far)
    return near, far


def _newton_steps(
    springs: AntagonisticSprings, Q: np.ndarray, S: np.ndarray, d: tuple[np.ndarray, np.ndarray]
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Newton's method for both equations, and what it leaves of the stiffness."""
    for _ in range(NEWTON_STEPS_PER_ATTEMPT):
        one, two = springs.first._derivatives(d[0]), springs.second._derivatives(d[1])
        force, stiffness = Q - one[0] - two[0], S - one[1] - two[1]
        factor = 1 / (one[1] * two[2] - two[1] * one[2])
        first = (two[2] * force - two[1] * stiffness) * factor
        d = d[0] + first, d[1] + (one[1] * stiffness - one[2] * force) * factor
    return d, np.abs(stiffness)
