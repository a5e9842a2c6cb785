"""The deflection of a spring that carries a force: Newton's method inside a bracket, on arrays of floats.

Springs rise, so that a bracket holds one solution; a Newton step that leaves it, or does not halve the last but one,
gives way to bisection. Cubic springs that do not soften have a fixed number of steps too, for every scalar type.
"""

from collections.abc import Callable

import numpy as np

from jounce._scalars import Array, is_numeric, reciprocal
from jounce.errors import JounceError
from jounce.model.springs import CubicSpring, Spring

Slope = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # of deflections, to forces and stiffnesses

STEPS = 200  # of which bisection alone takes some 60
DOUBLINGS = 60  # of a bracket that is not bounded
HALLEY = 8  # steps: to rounding for forces up to 4e4 k sqrt(k / k3), where the stiffness is 4,000 times that at rest


class UnreachableError(JounceError):
    """No deflection fulfils what is asked for; `state` is the number of the first state of the batch without one."""

    def __init__(self, text: str, state: int) -> None:
        super().__init__(text)
        self.state = state


def deflection(spring: Spring, force: Array) -> Array:
    """The deflection at which a spring exerts a force.

    Raises
    ------
    UnreachableError : where the spring cannot exert the force.
    """
    if is_numeric(force):
        return _numeric(spring, np.asarray(force))
    if isinstance(spring, CubicSpring) and spring.k3 >= 0:
        return _cubic(spring, force)
    kind = "that softens" if isinstance(spring, CubicSpring) else "given by a function or table"
    raise JounceError(f"a spring {kind} needs NumPy arrays of floats; springs for symbols are linear or CubicSpring")


def _cubic(spring: CubicSpring, force: Array) -> Array:
    """Halley's method for x + x^3 = y, where x is the deflection over sqrt(k / k3)."""
    if spring.k3 == 0:
        return force * (1 / spring.k)
    size = (spring.k / spring.k3) ** 0.5
    y = force * (1 / (spring.k * size))
    x = y * reciprocal(y * y * 0.05 + 1)
    for _ in range(HALLEY):
        z = x * x
        x = x - (x + z * x - y) * (z * 3 + 1) * reciprocal(z * 3 + z * z * 6 + x * y * 3 + 1)
    return x * size


def _numeric(spring: Spring, force: np.ndarray) -> np.ndarray:
    def slope(d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = spring._derivatives(d)
        return found[0], found[1]

    found = rising_root(slope, force, spring.range)
    lost = np.isnan(found) & np.isfinite(force)
    if lost.any():
        state = int(np.flatnonzero(lost)[0])
        low, high = _extremes(slope, spring.range)
        raise UnreachableError(
            f"no deflection of the spring carries {force.flat[state]:g}; it carries {low:g} to {high:g}", state
        )
    return found


def _extremes(slope: Slope, bounds: tuple[float, float]) -> tuple[float, float]:
    """The least and the greatest force of a spring, at its ends, or far out."""
    with np.errstate(all="ignore"):
        ends = [float(slope(np.asarray(np.clip(end, -1e9, 1e9)))[0]) for end in bounds]
    return ends[0], ends[1]


@np.errstate(all="ignore")
def rising_root(slope: Slope, target: np.ndarray, bounds: tuple[np.ndarray | float, np.ndarray | float]) -> np.ndarray:
    """x with f(x) = target of a rising function, NaN where no x within bounds has it."""
    low, high, x = _bracket(slope, target, bounds)
    last = before = high - low
    done = lost = np.isnan(low) | np.isnan(target)
    for _ in range(STEPS):
        f, rise = slope(x)
        above = f > target
        low, high = np.where(above, low, x), np.where(above, x, high)
        step = (target - f) / rise
        at_end = (np.abs(step) <= 2 * np.finfo(float).eps * np.abs(x)) & np.isfinite(rise)
        fast = (x + step > low) & (x + step < high) & (2 * np.abs(step) <= before)
        step = np.where(fast | at_end, step, (high + low) / 2 - x)
        x, before, last = np.where(done, x, x + step), last, np.abs(step)
        done = done | at_end | (f == target) | (high - low <= 0) | (last <= np.finfo(float).tiny)
        if done.all():
            break
    return np.where(lost | ~done | ~(slope(x)[1] > 0), np.nan, x)


def _bracket(
    slope: Slope, target: np.ndarray, bounds: tuple[np.ndarray | float, np.ndarray | float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends between which a rising function takes its targets, NaN where they are not found, and a first guess."""
    least, most = np.broadcast_to(bounds[0], target.shape), np.broadcast_to(bounds[1], target.shape)
    middle = np.where(np.isfinite(least) & np.isfinite(most), (least + most) / 2, np.clip(0.0, least, most))
    f, rise = slope(middle)
    way = np.where(target >= f, 1.0, -1.0)
    guess = np.clip(middle + (target - f) / rise, least, most)
    step = np.maximum(np.abs(guess - middle), np.finfo(float).tiny)
    far = guess
    for _ in range(DOUBLINGS):
        short = (slope(far)[0] - target) * way < 0
        if not short.any():
            break
        step = np.where(short, 2 * step, step)
        far = np.where(short, np.clip(middle + way * step, least, most), far)
    lost = ~((slope(far)[0] - target) * way >= 0)
    low, high = np.where(way > 0, middle, far), np.where(way > 0, far, middle)
    return np.where(lost, np.nan, low), np.where(lost, np.nan, high), np.where(lost, middle, guess)
