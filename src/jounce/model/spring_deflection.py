"""The deflection of a spring that carries a force.

Problem: phi(d) = Q for d, where phi rises over an interval of deflections, so that a bracket holds one solution.
Algorithm: cubic springs that do not soften take a fixed number of steps of Halley's method, for every scalar type.
Others take Newton's method inside a bracket, on arrays of floats (R. P. Brent, Algorithms for Minimization without
Derivatives, 1973, chapter 4, and W. H. Press et al., Numerical Recipes, section 9.4, rtsafe): a Newton step that leaves
the bracket, or does not halve the last but one, gives way to bisection.
Invariant: the force is at most Q at the low end of a bracket, and at least Q at the high end, state by state.
Failure: `UnreachableError` where the interval ends before the force is reached; NaN in `rising_root`.
"""

from collections.abc import Callable

import numpy as np

from jounce.core.errors import JounceError
from jounce.core.scalars import Array, is_numeric, reciprocal, sqrt
from jounce.model.springs import CubicSpring, Spring

Slope = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # of deflections, to forces and stiffnesses

MAX_DEFLECTION_STEPS = 200  # of which bisection alone takes some 60
MAX_BRACKET_DOUBLINGS = 60  # of the step to the far end: 1e18 times the first one
HALLEY_START_TERMS = 5  # of the series of the exponent 1/3 in the start value: what is left out is 1/3072
HALLEY_STEPS = 3  # which take errors from 26 % to 0.7 %, 3e-7 and 2e-20


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
