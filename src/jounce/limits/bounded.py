"""What limits bound, along a motion: q to q4d, Q to Q2d, Q - Qgrav and the power, with derivatives, at any times."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from jounce.dynamics.quantities import FORCES
from jounce.errors import JounceError
from jounce.model.coordinates import coordinate_limits
from jounce.model.limits import EFFORT_KINDS, MOTION_KINDS, Limits
from jounce.model.limits import FORCES as BOUND_FORCES
from jounce.motion.motion import Motion
from jounce.robot.along import FIRST, checked_motion
from jounce.robot.dispatch import compute

if TYPE_CHECKING:
    from jounce.robot.robot import Robot

UNCERTAIN = 10.0  # times the median standard deviation of a rate: beyond, at the ends of a fit, it says nothing
LOOKED_AT = 2000  # times of a motion at which deviations are compared
SMOOTH = 2  # derivatives that are used where they are known: a quintic between samples has two at each end

Side = Literal["right", "left"]
Series = Mapping[str, list[np.ndarray]]  # by kind: a quantity and its derivatives, (N, n) each
# A rate of Q is a derivative of the series of Q: kind -> which
DERIVATIVE = {kind: k for k, kind in enumerate(EFFORT_KINDS)}


@dataclass(frozen=True, eq=False)
class Bounded:
    """A robot along a motion, and the kinds of limits that bound any coordinate, which are `limits`."""

    robot: "Robot"
    motion: Motion
    limits: Limits
    kinds: tuple[str, ...]

    @property
    def forces(self) -> bool:
        """Whether any limit bounds forces or power."""
        return any(kind not in MOTION_KINDS for kind in self.kinds)

    @cached_property
    def window(self) -> tuple[float, float]:
        """The times between which the motion is looked at: of measured ones without their uncertain ends."""
        motion = self.motion
        t = motion.times[:: max(1, len(motion.times) // LOOKED_AT)]
        deviations = motion.deviations(t, self.rate_order)
        if deviations is None:
            return motion.start, motion.stop
        known = np.flatnonzero((deviations[-1] <= UNCERTAIN * np.median(deviations[-1], axis=0)).all(axis=1))
        return (float(t[known[0]]), float(t[known[-1]])) if known.size > 1 else (motion.start, motion.stop)

    @property
    def force_order(self) -> int:
        """The highest rate of Q that is used: the second where the motion knows q4d, at least what is bounded."""
        known = self.motion.curve.highest
        needed = max((DERIVATIVE.get(kind, 0) for kind in self.kinds if kind not in MOTION_KINDS), default=0)
        return SMOOTH if known is None else max(needed, min(SMOOTH, known - FIRST))

    @property
    def rate_order(self) -> int:
        """The highest rate of q that is used."""
        known = self.motion.curve.highest
        ways = [MOTION_KINDS.index(kind) for kind in self.kinds if kind in MOTION_KINDS]
        smooth = max((k + SMOOTH for k in ways), default=0)
        order = smooth if known is None else max([*ways, min(smooth, known)])
        return max(order, self.force_order + FIRST) if self.forces else order

    def series(self, t: np.ndarray, side: Side = "right") -> Series:
        """The quantities that are bounded, with derivatives, at times (N,)."""
        rates = self.motion(t, self.rate_order, side)
        found = {kind: list(rates[k : k + SMOOTH + 1]) for k, kind in enumerate(MOTION_KINDS) if kind in self.kinds}
        if not self.forces:
            return found
        order = self.force_order
        Q = forces_of(self.robot, rates, self.motion.wrench(t, order, side), order)
        inertial = Q
        if any(self.limits.of(kind) == BOUND_FORCES[1] for kind in self.kinds if kind in EFFORT_KINDS):
            G = _tuple(compute(self.robot, "gravity_forces", rates[: order + 1]))
            inertial = [x - g for x, g in zip(Q, G, strict=True)]
        for kind in EFFORT_KINDS:
            if kind in self.kinds:
                found[kind] = Q if self.limits.of(kind) == BOUND_FORCES[0] else inertial
        if "power" in self.kinds:
            found["power"] = power(rates[1:], Q)
        return found

    def values(self, t: np.ndarray, side: Side = "right") -> dict[str, np.ndarray]:
        """The quantities alone."""
        return {kind: series[DERIVATIVE.get(kind, 0)] for kind, series in self.series(t, side).items()}


def bounded(robot: "Robot", motion: object) -> Bounded:
    """A robot along a motion, checked, with the limits of its coordinates; a robot without any is refused."""
    path, limits = checked_motion(robot.mechanism, motion), coordinate_limits(robot.mechanism)
    if not limits.kinds:
        ways = "robot.with_limits(effort=..., velocity=...) or robot.with_limits('panda') states some"
        raise JounceError(f"robot {robot.name!r} states no limits; {ways} (--limits)")
    return Bounded(robot, path, limits, limits.kinds)


def order_needed(robot: "Robot") -> int:
    """The highest rate of Q that a motion must carry for the limits of a robot: q to q2d for 0, q to q4d for 2."""
    kinds = coordinate_limits(robot.mechanism).kinds
    motion = [MOTION_KINDS.index(kind) - FIRST for kind in kinds if kind in MOTION_KINDS]
    return max([0, *motion, *(DERIVATIVE[kind] for kind in kinds if kind in DERIVATIVE)])


def forces_of(robot: "Robot", rates: "tuple[np.ndarray, ...]", wrench: object, order: int) -> list[np.ndarray]:
    """Q and its rates up to an order."""
    return _tuple(compute(robot, FORCES.name, rates[: order + FIRST + 1], wrench=wrench))


def forces_at_speed(
    robot: "Robot",
    rates: "tuple[np.ndarray, ...]",
    wrench: "Sequence[Mapping[str, np.ndarray]] | None",
    c: float,
    order: int,
) -> list[np.ndarray]:
    """Q and its rates up to an order at c times the speed; wrenches over time go with the path."""
    W = wrench and tuple({body: w * c**k for body, w in of.items()} for k, of in enumerate(wrench))
    return forces_of(robot, tuple(rate * c**k for k, rate in enumerate(rates)), W, order)


def power(rates: "tuple[np.ndarray, ...]", Q: list[np.ndarray]) -> list[np.ndarray]:
    """Qd Q with as many derivatives as Q has, by the product rule; `rates` are qd, q2d, ..."""
    binomial = ([1], [1, 1], [1, 2, 1])
    return [sum(c * rates[k - j] * Q[j] for j, c in enumerate(binomial[k])) for k in range(len(Q))]


def _tuple(found: object) -> list[np.ndarray]:
    return list(found) if isinstance(found, tuple) else [np.asarray(found)]
