"""The room that limits leave along a motion, as a relaxed logarithmic barrier with exact gradients.

The barrier of a bound is -log z of its room z = share - ratio. Below z = delta a parabola with the same value, slope
and curvature continues it, so that motions beyond limits have a value too, and are drawn inside. Gradients by q, qd,
... are those of the forces, by vector-Jacobian products of native code, and those of power and stall lines by hand.

J. Hauser, A. Saccon, "A Barrier Function Method for the Optimization of Trajectory Functionals with Constraints", IEEE
Conference on Decision and Control, 2006.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jounce.dynamics.computation import Computation
from jounce.dynamics.quantities.names import QuantityName
from jounce.engine.along import Q_RATE_ORDER
from jounce.engine.backends import compile_ahead
from jounce.engine.engine import Engine
from jounce.engine.generic_methods import as_tuple
from jounce.limits.limited_motion import motion_order
from jounce.limits.ratios import SIGNS, Scale, build_scale
from jounce.limits.samples import limited_values
from jounce.model.limit_kinds import EFFORT_KINDS, LIMIT_KINDS, MOTION_KINDS
from jounce.model.limits import Limits
from jounce.native.kernel import Kernel

Rates = Sequence[np.ndarray]  # q, qd, q2d, ..., (M, n) each


class BoundedForce(NamedTuple):
    """A force with its rates up to an order: native code of both, and of vector-Jacobian products."""

    order: int
    inputs: int
    kernel: Kernel
    product: Kernel

    def values(self, rates: Rates) -> Sequence[np.ndarray]:
        """The force and its rates, (M, n) each."""
        return tuple(as_tuple(self.kernel(*rates[: self.inputs])))

    def gradients(self, rates: Rates, pushes: Sequence[np.ndarray]) -> Sequence[np.ndarray]:
        """The gradients by the rates of q of the sum of its values and rates times pushes."""
        return tuple(as_tuple(self.product(*rates[: self.inputs], *pushes)))


@dataclass(frozen=True, eq=False)
class LimitBarrier:
    """The bounds of a robot's coordinates, and the forces Q and Qgrav with the rates that they bound, or None.

    `kinds` are those of the limits: what they bound has n columns each, in their order, with `scale`; `sides` are signs
    and the columns that have bounds of them. `order` is that of the highest rate of q that they take.
    """

    limits: Limits
    kinds: tuple[str, ...]
    scale: Scale
    sides: tuple[tuple[int, np.ndarray], ...]
    order: int
    Q: BoundedForce | None
    gravity: BoundedForce | None

    def worst(self, rates: Rates) -> tuple[float, str, int]:
        """The largest ratio at states, of which kind and coordinate."""
        values, found = self._stacked(self._values(rates)), []
        for sign, columns in self.sides:
            ratios = self.scale.ratio(values[:, columns], sign, columns).max(axis=0)
            kind, joint = divmod(int(columns[ratios.argmax()]), rates[0].shape[1])
            found.append((float(ratios.max()), self.kinds[kind], joint))
        return max(found)

    def loss(self, rates: Rates, share: float, delta: float) -> tuple[float, list[np.ndarray]]:
        """The barrier, a sum over bounds and a mean over states, and its gradients by q, qd, ..."""
        by_kind = self._values(rates)
        values, total = self._stacked(by_kind), 0.0
        pushes = np.zeros_like(values)
        for sign, columns in self.sides:
            z = share - self.scale.ratio(values[:, columns], sign, columns)
            beyond, y = z < delta, z / delta - 2
            inside = np.where(beyond, delta, z)
            total += float(np.where(beyond, (y * y - 1) / 2 - np.log(delta), -np.log(inside)).sum())
            reach = sign * self.scale.reach(sign)[columns]
            pushes[:, columns] -= np.where(beyond, y / delta, -1 / inside) / (reach * len(z))
        parts = np.split(pushes, len(self.kinds), axis=1)
        return total / len(rates[0]), self._gradients(rates, by_kind, dict(zip(self.kinds, parts, strict=True)))

    def _values(self, rates: Rates) -> dict[str, np.ndarray]:
        """What limits bound at states by kind, (M, n) each; Q itself as "Q"."""
        Q = self.Q.values(rates) if self.Q else ()
        found = limited_values(self.limits, rates, Q, self.gravity.values(rates) if self.gravity else ())
        return found | ({"Q": Q[0]} if Q else {})

    def _stacked(self, by_kind: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.concatenate([by_kind[kind] for kind in self.kinds], axis=1)

    def _gradients(
        self, rates: Rates, values: Mapping[str, np.ndarray], pushes: Mapping[str, np.ndarray]
    ) -> list[np.ndarray]:
        """The gradients by q, qd, ... of the sum of what limits bound times pushes (M, n), by kind."""
        zero = np.zeros_like(rates[0])
        found = [pushes.get(kind, zero).copy() for kind in MOTION_KINDS[: len(rates)]]
        if self.Q is None:
            return found
        onto = [pushes.get(kind, zero) for kind in EFFORT_KINDS[: self.Q.order + 1]]
        parts = []
        if self.gravity:
            off = [-x * (kind in self.limits.without_gravity) for kind, x in zip(EFFORT_KINDS, onto, strict=False)]
            parts.append(self.gravity.gradients(rates, off[: self.gravity.order + 1]))
        if "power" in pushes:
            found[1] += pushes["power"] * values["Q"]
            onto[0] = onto[0] + pushes["power"] * rates[1]
        if "stall_effort" in pushes:
            found[1] += pushes["stall_effort"] * self.limits.effort_slope
            onto[0] = onto[0] + pushes["stall_effort"]
        for part in (*parts, self.Q.gradients(rates, onto)):
            for gradient, more in zip(found, part, strict=False):
                gradient += more
        return found


def build_barrier(robot: Engine, limits: Limits, kinds: Sequence[str]) -> LimitBarrier:
    """The room within limits of some kinds of the coordinates of a robot, but bounds of 0 of what stands still."""
    joined = zip(*(vars(build_scale(limits.bounds(kind), kind)).values() for kind in kinds), strict=True)
    scale = Scale(*map(np.concatenate, joined))
    finite = {sign: np.isfinite(scale.bound(sign)) & (scale.reach(sign) != 0) for sign in reversed(SIGNS)}
    forces = [kind for kind in kinds if LIMIT_KINDS[kind].force]
    order = max((LIMIT_KINDS[kind].rate for kind in forces), default=0)
    bare = [LIMIT_KINDS[kind].rate for kind in forces if kind in limits.without_gravity]
    return LimitBarrier(
        limits,
        tuple(kinds),
        scale,
        tuple((sign, np.flatnonzero(on)) for sign, on in finite.items() if on.any()),
        max([Q_RATE_ORDER, *(motion_order(robot, kind) for kind in kinds)]),
        _compile_force(robot, "inverse_dynamics", order, Q_RATE_ORDER) if forces else None,
        _compile_force(robot, "gravity_forces", max(bare), 0) if bare else None,
    )


def _compile_force(robot: Engine, name: QuantityName, order: int, first: int) -> BoundedForce:
    kernels = (compile_ahead(robot, Computation(name, order, product=product)) for product in (None, "vjp"))
    return BoundedForce(order, order + first + 1, *kernels)
