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
    """No deflection carries a force or has a stiffness.

    `state` is the number of the first state of the batch without one.
    """

    def __init__(self, text: str, state: int) -> None:
        super().__init__(text)
        self.state = state


def spring_deflection(spring: Spring, force: Array) -> Array:
    """Return the deflection at which a spring exerts a force.

    Raises `UnreachableError` where no deflection does.
    """
    if is_numeric(force):
        return _solve_numeric(spring, np.asarray(force))
    if isinstance(spring, CubicSpring) and spring.has_fixed_steps:
        return _solve_cubic(spring, force)
    kind = "is given by a function or table"
    if isinstance(spring, CubicSpring):
        kind = "softens" if spring.k3 < 0 else "has no stiffness k at rest"
    raise JounceError(f"a spring that {kind} needs NumPy arrays of floats; springs for symbols are linear or stiffen")


def _solve_cubic(spring: CubicSpring, force: Array) -> Array:
    """Find the deflection of a spring that hardens, by Halley's method.

    It is force m / k with m + y^2 m^3 = 1, where y is the force over k sqrt(k / k3). m is near v^(-1/3), v = 1 + y^2,
    and 1/3 = 1/4 + 1/16 + 1/64 + ...: with five terms, the start value is within 26 % of m for all |y| < 1e154, and
    three steps reduce the error below 1e-19. Beyond, v overflows and m is NaN.
    """
    ratio = (spring.k3 / spring.k) ** 0.5
    y = force * (ratio / spring.k)
    w = y * y
    # v^(1/4) v^(1/16) v^(1/64) ...: each factor is the fourth root of the one before.
    root = product = sqrt(sqrt(w + 1))
    for _ in range(HALLEY_START_TERMS - 1):
        root = sqrt(sqrt(root))
        product = product * root
    m = reciprocal(product)
    # f = m + w m^3 - 1, f' = 1 + 3 w m^2, f'' = 6 w m; m - 2 f f' / (2 f'^2 - f f'') with u = w m^2 and t = w m.
    for _ in range(HALLEY_STEPS):
        t = w * m
        u = t * m
        m = m - (m + u * m - 1) * (u * 3 + 1) * reciprocal(u * 3 + u * u * 6 + t * 3 + 1)
    return force * (1 / spring.k) * m


def _solve_numeric(spring: Spring, force: np.ndarray) -> np.ndarray:
    """Return the deflections that carry forces of floats.

    Each spring takes the method that suits it.
    """

    def slope(d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        derivatives = spring._derivatives(d)
        return derivatives[0], derivatives[1]

    with np.errstate(all="ignore"):  # overflow leaves NaN
        if isinstance(spring, CubicSpring) and spring.k == 0:
            deflection = np.cbrt(force) / np.cbrt(spring.k3)
        elif isinstance(spring, CubicSpring) and spring.has_fixed_steps:
            deflection = _solve_cubic(spring, force)
        else:
            deflection = rising_root(slope, force, spring.range)
    is_unreachable = np.isnan(deflection) & np.isfinite(force)
    if is_unreachable.any():
        state = int(np.flatnonzero(is_unreachable)[0])
        with np.errstate(all="ignore"):  # the forces at its ends, or far out
            low, high = (float(slope(np.asarray(np.clip(end, -1e9, 1e9)))[0]) for end in spring.range)
        came = f"no deflection of the spring carries {force.flat[state]:g}"
        raise UnreachableError(f"{came}; it carries {low:g} to {high:g}", state)
    return deflection


@np.errstate(all="ignore")
def rising_root(slope: Slope, target: np.ndarray, bounds: tuple[np.ndarray | float, np.ndarray | float]) -> np.ndarray:
    """Return x with f(x) = target of a rising function.

    It is NaN where no x within bounds has it. All states step together, once per pass; states that are done keep their
    x.
    """
    low, high, x = _find_bracket(slope, target, bounds)
    last = before = high - low  # the sizes of the last step and of the last but one
    done = has_no_bracket = np.isnan(low) | np.isnan(target)
    for _ in range(MAX_DEFLECTION_STEPS):
        # The bracket shrinks to x on one side.
        f, rise = slope(x)
        is_above = f > target
        low, high = np.where(is_above, low, x), np.where(is_above, x, high)
        # Newton's step, if it stays inside and halves the last step but one, or is down to rounding; else bisection.
        step = (target - f) / rise
        is_rounding = (np.abs(step) <= 2 * np.finfo(float).eps * np.abs(x)) & np.isfinite(rise)
        is_fast = (x + step > low) & (x + step < high) & (2 * np.abs(step) <= before)
        step = np.where(is_fast | is_rounding, step, (high + low) / 2 - x)
        x, before, last = np.where(done, x, x + step), last, np.abs(step)
        # The target is met, or nothing is left of the bracket or of the step.
        done = done | is_rounding | (f == target) | (high - low <= 0) | (last <= np.finfo(float).tiny)
        if done.all():
            break
    # A stiffness that is not positive is an end of the spring: rates would be infinite there.
    return np.where(has_no_bracket | ~done | ~(slope(x)[1] > 0), np.nan, x)


def _find_bracket(
    slope: Slope, target: np.ndarray, bounds: tuple[np.ndarray | float, np.ndarray | float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return brackets in which a rising function meets targets.

    First guesses come with them. Ends are NaN where no bracket is found.
    """
    # The middle of the bounds; where they are infinite, the point nearest to 0, the deflection at rest.
    least, most = np.broadcast_to(bounds[0], target.shape), np.broadcast_to(bounds[1], target.shape)
    middle = np.where(np.isfinite(least) & np.isfinite(most), (least + most) / 2, np.clip(0.0, least, most))
    f, rise = slope(middle)
    # The first guess is a Newton step from the middle, on the side of the target; from there each step goes twice as
    # far from the middle, until the target is passed.
    way = np.where(target >= f, 1.0, -1.0)
    guess = np.clip(middle + (target - f) / rise, least, most)
    step = np.maximum(np.abs(guess - middle), np.finfo(float).tiny)
    far = guess
    for _ in range(MAX_BRACKET_DOUBLINGS):
        is_short = (slope(far)[0] - target) * way < 0
        if not is_short.any():
            break
        step = np.where(is_short, 2 * step, step)
        far = np.where(is_short, np.clip(middle + way * step, least, most), far)
    # Written so that NaN counts as not passed.
    is_missed = ~((slope(far)[0] - target) * way >= 0)
    low, high = np.where(way > 0, middle, far), np.where(way > 0, far, middle)
    return np.where(is_missed, np.nan, low), np.where(is_missed, np.nan, high), np.where(is_missed, middle, guess)


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
        for name, law in {"first": first, "second": second}.items():
            spring = read_spring(law, f"AntagonisticSprings: {name}")
            if isinstance(spring, CubicSpring) and spring.k == 0:
                raise JounceError(f"AntagonisticSprings: {name} has no stiffness at rest; give CubicSpring a k above 0")
            object.__setattr__(self, name, spring)


class _Setting(NamedTuple):
    """Deflections of both springs that carry a force."""

    d: tuple[np.ndarray, np.ndarray]
    S: np.ndarray  # the stiffness that they make
    rise: np.ndarray  # the sign of dS/de


Curve = Callable[[np.ndarray], _Setting]  # the settings that carry a force, over e
Condition = Callable[[_Setting], np.ndarray]  # state by state


def antagonist_deflections(springs: AntagonisticSprings, Q: np.ndarray, S: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the deflections of both springs for forces and stiffnesses of floats.

    Raises `UnreachableError` where no setting has both. Steps 1 and 2 run once for all states, step 3 up to
    `MAX_NEWTON_ATTEMPTS` times.
    """
    if not (is_numeric(Q) and is_numeric(S)):
        raise JounceError("two springs of one joint need NumPy arrays of floats")
    Q, S = np.broadcast_arrays(np.asarray(Q), np.asarray(S))
    known = np.isfinite(Q) & np.isfinite(S)

    def curve(e: np.ndarray) -> _Setting:
        return _solve_setting(springs, Q, e)

    def check(reached: np.ndarray, bound: np.ndarray, word: str) -> None:
        is_unreachable = known & ~reached
        if is_unreachable.any():
            i = int(np.flatnonzero(is_unreachable)[0])
            # The bound is NaN where no setting carries the force.
            reason = "no setting carries this force"
            if bound.flat[i] > 0:
                reason = f"it is {word} {bound.flat[i]:g}, where it rises with theta1 - theta2"
            raise UnreachableError(f"no setting has stiffness {S.flat[i]:g} at force {Q.flat[i]:g}; {reason}", i)

    with np.errstate(all="ignore"):
        # 1. Start from a setting with less stiffness than S.
        low = _softer_difference(springs, curve, S, known)
        least = curve(low).S
        check(least * (1 + MIN_STIFFNESS_MARGIN) < S, least, "above")
        # 2. Find a bracket in the direction in which the stiffness rises.
        near, far = _find_differences(curve, lambda x: ~(x.S < S), low, 1.0, known)
        # 3. Bisect, until Newton's method converges to a setting on this side of the least stiffness.
        for _ in range(MAX_NEWTON_ATTEMPTS):
            near, far = _halve_bracket(curve, lambda x: ~(x.S < S), near, far, HALVINGS_PER_ATTEMPT)
            (d1, d2), error = _newton_steps(springs, Q, S, curve(near).d)
            has_converged = (error <= STIFFNESS_TOLERANCE * S) & (d1 - d2 > low)
            if has_converged[known].all():
                break
        check(has_converged, curve(near).S, "below")
    return np.where(known, d1, np.nan), np.where(known, d2, np.nan)


def antagonist_series(springs: AntagonisticSprings, Q: Series, S: Series) -> tuple[Series, Series]:
    """Return the deflections of both springs with their rates.

    Their rates are the inverse of the Jacobian of (Q, S) times the rates of Q and S.
    """
    d1, d2 = antagonist_deflections(springs, Q[0], S[0])

    # [[p1, p2], [c1, c2]] (d1', d2') = (Q', S') with stiffnesses p = phi' and their changes c = phi''.
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
    """Return the setting that carries Q with the difference e of both deflections.

    The mean deflection is the root of a rising function, phi1(mean + e/2) + phi2(mean - e/2) = Q.
    """

    def slope(mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        one, two = springs.first._derivatives(mean + e / 2), springs.second._derivatives(mean - e / 2)
        return one[0] + two[0], one[1] + two[1]

    # Both deflections stay within their springs; where no mean does, the target is NaN, and so is the setting.
    (low1, high1), (low2, high2) = springs.first.range, springs.second.range
    bounds = np.maximum(low1 - e / 2, low2 + e / 2), np.minimum(high1 - e / 2, high2 + e / 2)
    mean = rising_root(slope, np.where(bounds[0] < bounds[1], Q, np.nan), bounds)
    # Along the curve of one force, dS/de has the sign of phi1'' phi2' - phi2'' phi1'.
    d = mean + e / 2, mean - e / 2
    one, two = springs.first._derivatives(d[0]), springs.second._derivatives(d[1])
    return _Setting(d, one[1] + two[1], np.sign(one[2] * two[1] - two[2] * one[1]))


def _softer_difference(springs: AntagonisticSprings, curve: Curve, S: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return differences e with less, or the least, stiffness."""
    # Start at e = 0, or in the middle of the differences that the springs allow, and go where the stiffness falls.
    (low1, high1), (low2, high2) = springs.first.range, springs.second.range
    allows_zero = low1 - high2 < 0 < high1 - low2
    start = np.full(S.shape, 0.0 if allows_zero else (low1 - high2 + high1 - low2) / 2)
    way = -curve(start).rise

    def has_turned(x: _Setting) -> np.ndarray:
        return ~(x.rise * way < 0)

    near, far = _find_differences(curve, lambda x: has_turned(x) | (x.S < S), start, way, known)
    # Steps may have gone over the least stiffness, which may still be below S: bisect for it.
    if not (curve(far).S < S)[known].all():
        near, far = _halve_bracket(curve, has_turned, near, far, LEAST_STIFFNESS_HALVINGS)
    # Beyond the ends of the springs the stiffness is NaN.
    return np.where(np.isnan(curve(far).S), near, far)


def _find_differences(
    curve: Curve, passed: Condition, start: np.ndarray, way: np.ndarray | float, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return two differences between which a condition begins.

    They are on the way from a start. It holds at the second, if anywhere, and not at the first.
    """
    near = far = start
    for k in range(MAX_DIFFERENCE_DOUBLINGS):
        goes_on = known & ~passed(curve(far))
        if not goes_on.any():
            break
        near, far = np.where(goes_on, far, near), np.where(goes_on, start + way * FIRST_DIFFERENCE_STEP * 2**k, far)
    return near, far


def _halve_bracket(
    curve: Curve, passed: Condition, near: np.ndarray, far: np.ndarray, times: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return a bracket after bisections: the condition holds at its far end only."""
    for _ in range(times):
        middle = (near + far) / 2
        has_passed = passed(curve(middle))
        near, far = np.where(has_passed, near, middle), np.where(has_passed, middle, far)
    return near, far


def _newton_steps(
    springs: AntagonisticSprings, Q: np.ndarray, S: np.ndarray, d: tuple[np.ndarray, np.ndarray]
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Return deflections after Newton steps, and the stiffness error."""
    # [[phi1', phi2'], [phi1'', phi2'']] step = (errors of force and stiffness), by Cramer's rule.
    for _ in range(NEWTON_STEPS_PER_ATTEMPT):
        one, two = springs.first._derivatives(d[0]), springs.second._derivatives(d[1])
        force, stiffness = Q - one[0] - two[0], S - one[1] - two[1]
        factor = 1 / (one[1] * two[2] - two[1] * one[2])
        first = (two[2] * force - two[1] * stiffness) * factor
        d = d[0] + first, d[1] + (one[1] * stiffness - one[2] * force) * factor
    return d, np.abs(stiffness)
