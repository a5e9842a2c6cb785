"""What limits bound along a motion: q to q4d, Q to Q2d, Q - Qgrav, power and motors, with derivatives, at any times."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from jounce.arguments.requests import more_rates
from jounce.dynamics.quantities import FORCES, Quantity, row_of
from jounce.errors import JounceError, listed
from jounce.model.coordinates import coordinate_limits
from jounce.model.limits import EFFORT_KINDS, MOTION_KINDS, MOTOR_KINDS, Limits
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
Rates = tuple[np.ndarray, ...]
Wrenches = Sequence[Mapping[str, np.ndarray]] | None
Series = Mapping[str, list[np.ndarray]]  # by kind: a quantity and its derivatives, (N, n) each
MOTORS = {  # of limits of motors: the quantity that each bounds, or a rate of it
    "motor_position": ("motor_positions", 0),
    "motor_velocity": ("motor_positions", 1),
    "motor_torque": ("motor_torques", 0),
}
# A rate of Q is a derivative of the series of Q, and so are motor velocities of positions: kind -> which
DERIVATIVE = {kind: k for k, kind in enumerate(EFFORT_KINDS)} | {kind: k for kind, (_, k) in MOTORS.items()}


@dataclass(frozen=True, eq=False)
class Bounded:
    """A robot along a motion, and the kinds of limits that bound any coordinate, which are `limits`."""

    robot: "Robot"
    motion: Motion
    limits: Limits
    kinds: tuple[str, ...]

    @property
    def forces(self) -> bool:
        """Whether any limit bounds forces, power or motors."""
        return any(kind not in MOTION_KINDS for kind in self.kinds)

    @cached_property
    def orders(self) -> Mapping[str, int]:
        """The quantities that are used, and of each the highest rate: the second where the motion knows enough."""
        needed: dict[str, int] = {}
        for kind in self.kinds:
            if kind not in MOTION_KINDS:
                row = quantity_of(kind)
                needed[row] = max(needed.get(row, 0), DERIVATIVE.get(kind, 0))
        known = self.motion.curve.highest
        return {
            row: SMOOTH if known is None else max(least, min(SMOOTH, known - row_of_robot(self.robot, row).rates + 1))
            for row, least in needed.items()
        }

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
        """The highest rate of Q that is used."""
        return max(order + row_of_robot(self.robot, row).rates - FORCES.rates for row, order in self.orders.items())

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
        values = {row: self._quantity(row, rates, t, side) for row in self.orders}
        found |= {kind: values[row] for kind, (row, _) in MOTORS.items() if kind in self.kinds}
        return found | (self._efforts(values[FORCES.name], rates) if FORCES.name in values else {})

    def _quantity(self, row: str, rates: Rates, t: np.ndarray, side: Side) -> list[np.ndarray]:
        """One of the quantities that are used, with its rates."""
        order = self.orders[row]
        return at_speed(
            self.robot, row, rates, self.motion.wrench(t, wrench_order(self.robot, row, order), side), 1.0, order
        )

    def _efforts(self, Q: list[np.ndarray], rates: Rates) -> dict[str, list[np.ndarray]]:
        """What limits of efforts and of the power bound, of Q with its rates."""
        inertial, found = Q, {}
        if any(self.limits.of(kind) == BOUND_FORCES[1] for kind in self.kinds if kind in EFFORT_KINDS):
            G = _tuple(compute(self.robot, "gravity_forces", rates[: len(Q)]))
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
    kinds = known_kinds(robot, limits)
    if not kinds:
        if limits.kinds:
            came = f"robot {robot.name!r} states no limits of rigid joints, only {listed(limits.kinds)}"
            raise JounceError(f"{came}; robot.elastic(stiffness) makes its joints elastic")
        ways = "robot.with_limits(effort=..., velocity=...) or robot.with_limits('panda') states some"
        raise JounceError(f"robot {robot.name!r} states no limits; {ways} (--limits)")
    return Bounded(robot, path, limits, kinds)


def known_kinds(robot: "Robot", limits: Limits) -> tuple[str, ...]:
    """The kinds of limits that a motion of a robot is held against: those of motors where its joints are elastic."""
    return tuple(kind for kind in limits.kinds if kind not in MOTOR_KINDS or robot.mechanism.elasticity is not None)


def quantity_of(kind: str) -> str:
    """The quantity that a kind of limit of forces, of the power or of motors bounds, or a rate of which."""
    return MOTORS[kind][0] if kind in MOTORS else FORCES.name


def row_of_robot(robot: "Robot", name: str) -> Quantity:
    """The row of a quantity, with the rates that springs and motors of the robot take."""
    return row_of(name, more_rates(robot.mechanism, name))


def rate_of_forces(robot: "Robot", kind: str) -> int:
    """The highest rate of Q that enters what a kind of limit of forces, of the power or of motors bounds."""
    return row_of_robot(robot, quantity_of(kind)).rates - FORCES.rates + DERIVATIVE.get(kind, 0)


def order_needed(robot: "Robot") -> int:
    """The highest rate of Q that a motion must carry for the limits of a robot: q to q2d for 0, q to q4d for 2."""
    kinds = known_kinds(robot, coordinate_limits(robot.mechanism))
    orders = [MOTION_KINDS.index(k) - FIRST if k in MOTION_KINDS else rate_of_forces(robot, k) for k in kinds]
    return max([0, *orders])


def wrench_order(robot: "Robot", row: str, order: int) -> int:
    """The highest rate of wrenches that a quantity takes for its rates up to an order."""
    return order + row_of_robot(robot, row).wrench_rates - 1


def at_speed(robot: "Robot", row: str, rates: Rates, wrench: Wrenches, c: float, order: int) -> list[np.ndarray]:
    """A quantity and its rates up to an order at c times the speed; wrenches over time go with the path."""
    W = wrench and tuple({body: w * c**k for body, w in of.items()} for k, of in enumerate(wrench))
    scaled = tuple(rate * c**k for k, rate in enumerate(rates[: order + row_of_robot(robot, row).rates]))
    return _tuple(compute(robot, row, scaled, wrench=W))


def power(rates: Rates, Q: list[np.ndarray]) -> list[np.ndarray]:
    """Qd Q with as many derivatives as Q has, by the product rule; `rates` are qd, q2d, ..."""
    binomial = ([1], [1, 1], [1, 2, 1])
    return [sum(c * rates[k - j] * Q[j] for j, c in enumerate(binomial[k])) for k in range(len(Q))]


def _tuple(found: object) -> list[np.ndarray]:
    return list(found) if isinstance(found, tuple) else [np.asarray(found)]
