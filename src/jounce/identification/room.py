"""The room that limits leave along a motion, as a barrier with exact gradients.

The barrier of a bound is -log z of its room z = share - ratio. Below z = delta it goes on as a parabola, so that
motions beyond limits have a value too, and are drawn inside.

J. Hauser, A. Saccon, "A Barrier Function Method for the Optimization of Trajectory Functionals with Constraints", IEEE
Conference on Decision and Control, 2006.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jounce._typing import QuantityName
from jounce.limits.bounded import DERIVATIVE, rate_of_forces
from jounce.limits.ratios import scale_of
from jounce.model.limits import EFFORT_KINDS, MOTION_KINDS, Limits
from jounce.model.limits import FORCES as BOUND_FORCES
from jounce.native.kernel import Kernel
from jounce.robot.along import FIRST
from jounce.robot.generic import as_tuple

if TYPE_CHECKING:
    from jounce.robot import Robot

Rates = Sequence[np.ndarray]  # q, qd, q2d, ..., (M, n) each


class Side(NamedTuple):
    """The finite bounds of a kind on one side: of which coordinates, where ratios begin, and the way to the bounds."""

    kind: str
    joints: np.ndarray
    centre: np.ndarray
    reach: np.ndarray

    def ratios(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """The ratios (M, joints) of values to the bounds."""
        ratios: np.ndarray = (values[self.kind][:, self.joints] - self.centre) / self.reach
        return ratios


class Force(NamedTuple):
    """A force with rates up to an order: its native code, and that of vector-Jacobian products."""

    order: int
    inputs: int
    kernel: Kernel
    product: Kernel

    def values(self, rates: Rates) -> Sequence[np.ndarray]:
        """The force and its rates, (M, n) each."""
        found: Sequence[np.ndarray] = as_tuple(self.kernel(*rates[: self.inputs]))
        return found

    def gradients(self, rates: Rates, pushes: Sequence[np.ndarray]) -> Sequence[np.ndarray]:
        """The gradients by the rates of q of the sum of its values and rates times pushes."""
        found: Sequence[np.ndarray] = as_tuple(self.product(*rates[: self.inputs], *pushes))
        return found


@dataclass(frozen=True, eq=False)
class Room:
    """The bounds of a robot's coordinates, and the forces Q and Qgrav with the rates that they bound, or None.

    `order` is that of the highest rate of q that they take.
    """

    limits: Limits
    sides: tuple[Side, ...]
    order: int
    Q: Force | None
    gravity: Force | None

    def values(self, rates: Rates) -> dict[str, np.ndarray]:
        """What the limits bound at states, (M, n) each; Q as "Q"."""
        found = dict(zip(MOTION_KINDS, rates, strict=False))
        if self.Q is None:
            return found
        Q = self.Q.values(rates)
        found |= dict(zip(EFFORT_KINDS, Q, strict=False)) | {"Q": Q[0], "power": rates[1] * Q[0]}
        for k, g in enumerate(self.gravity.values(rates) if self.gravity else ()):
            if self.without_gravity(EFFORT_KINDS[k]):
                found[EFFORT_KINDS[k]] = Q[k] - g
        return found

    def without_gravity(self, kind: str) -> bool:
        """Whether an effort limit bounds Q - Qgrav."""
        return self.limits.of(kind) == BOUND_FORCES[1]

    def worst(self, rates: Rates) -> tuple[float, str, int]:
        """The largest ratio at states, of which kind and coordinate."""
        values, found = self.values(rates), []
        for side in self.sides:
            ratios = side.ratios(values).max(axis=0)
            found.append((float(ratios.max()), side.kind, int(side.joints[ratios.argmax()])))
        return max(found)

    def loss(self, rates: Rates, share: float, delta: float) -> tuple[float, list[np.ndarray]]:
        """The barrier, a sum over bounds and a mean over states, and its gradients by q, qd, ..."""
        values, total = self.values(rates), 0.0
        pushes = {side.kind: np.zeros_like(rates[0]) for side in self.sides}
        for side in self.sides:
            z = share - side.ratios(values)
            beyond, y = z < delta, z / delta - 2
            inside = np.where(beyond, delta, z)
            total += float(np.where(beyond, (y * y - 1) / 2 - np.log(delta), -np.log(inside)).sum())
            slope = np.where(beyond, y / delta, -1 / inside) / -side.reach
            pushes[side.kind][:, side.joints] += slope / len(rates[0])
        return total / len(rates[0]), self._gradients(rates, values, pushes)

    def _gradients(
        self, rates: Rates, values: Mapping[str, np.ndarray], pushes: Mapping[str, np.ndarray]
    ) -> list[np.ndarray]:
        """The gradients by q, qd, ... of the sum of values times pushes (M, n), by kind."""
        zero = np.zeros_like(rates[0])
        found = [pushes.get(kind, zero).copy() for kind in MOTION_KINDS[: len(rates)]]
        if self.Q is None:
            return found
        onto = [pushes.get(kind, zero) for kind in EFFORT_KINDS[: self.Q.order + 1]]
        parts = []
        if self.gravity:
            off = [-x if self.without_gravity(kind) else zero for kind, x in zip(EFFORT_KINDS, onto, strict=False)]
            parts.append(self.gravity.gradients(rates, off[: self.gravity.order + 1]))
        if "power" in pushes:
            found[1] += pushes["power"] * values["Q"]
            onto[0] = onto[0] + pushes["power"] * rates[1]
        for part in (*parts, self.Q.gradients(rates, onto)):
            for gradient, more in zip(found, part, strict=False):
                gradient += more
        return found


def room_of(robot: "Robot", limits: Limits, kinds: Sequence[str]) -> Room:
    """The room within limits of some kinds of the coordinates of a robot; bounds of 0 of what rests leave it out."""
    sides = []
    for kind in kinds:
        bounds = limits.bounds(kind)
        centre = scale_of(bounds, kind).centre
        for bound in bounds:
            [joints] = np.nonzero(np.isfinite(bound) & (bound != centre))
            if joints.size:
                sides.append(Side(kind, joints, centre[joints], (bound - centre)[joints]))
    forces = [kind for kind in kinds if kind not in MOTION_KINDS]
    order = max((rate_of_forces(robot, kind) for kind in forces), default=0)
    bare = [DERIVATIVE[kind] for kind in forces if kind in EFFORT_KINDS and limits.of(kind) == BOUND_FORCES[1]]
    return Room(
        limits,
        tuple(sides),
        max([FIRST, order + FIRST, *(MOTION_KINDS.index(kind) for kind in kinds if kind in MOTION_KINDS)]),
        _force(robot, "inverse_dynamics", order, FIRST) if forces else None,
        _force(robot, "gravity_forces", max(bare), 0) if bare else None,
    )


def _force(robot: "Robot", name: QuantityName, order: int, first: int) -> Force:
    kernels = robot.compile(name, order), robot.compile(name, order, product="vjp")
    return Force(order, order + first + 1, *kernels)
