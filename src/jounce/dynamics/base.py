"""The motion of the base: of a floating robot's own, or of the ground on which a fixed robot stands."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jounce.core.scalars import Array
from jounce.spatial.lie import Ad, ad, hat, inverse, pose, position, rotation, wedge
from jounce.spatial.series import Series, from_rate, from_rates


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """The pose of the base in the inertial frame, and its twist in its own axes with rates."""

    pose: Array  # (..., 4, 4)
    V: Series  # (..., 6, 1)

    @cached_property
    def H(self) -> Series:
        """The pose with its rates."""
        return from_rate(self.pose, lambda H: H @ self.V.map(lambda V: wedge(V[..., 0])))

    @cached_property
    def w(self) -> Series:
        """The angular velocity, (..., 3, 1)."""
        return self.V.map(lambda V: V[..., :3, :])

    @cached_property
    def v(self) -> Series:
        """The velocity of the origin, (..., 3, 1)."""
        return self.V.map(lambda V: V[..., 3:, :])

    @cached_property
    def hat_w(self) -> Series:
        """hat(w)."""
        return self.w.map(lambda w: hat(w[..., 0]))

    @property
    def at_origin(self) -> "BaseMotion":
        """The same motion about an inertial origin at the place of the base: no digits are lost far away from it."""
        return replace(self, pose=pose(rotation(self.pose), 0 * position(self.pose)))

    def field(self, gravity: Array) -> Series:
        """The acceleration of gravity in the axes of the base, (..., 3, 1)."""
        return from_rate(rotation(self.pose).mT @ gravity[:, None], lambda g: -(self.hat_w @ g))

    def in_space(self, W: Series) -> Series:
        """Wrenches on the base, (..., 6, k), in inertial axes about the inertial origin: Ad(C^-1)^T W."""
        Ad_T, ads = Ad(inverse(self.pose)).mT, self.V.map(lambda V: ad(V[..., 0]).mT)
        return moved(W, Ad_T, lambda W: -(ads @ W))

    def points(self, x: Series) -> Series:
        """Points of the base and weighted sums of points, (..., 4, k), (m r; m), in the inertial frame: C x."""
        hats = self.V.map(lambda V: wedge(V[..., 0]))
        return moved(x, self.pose, lambda x: hats @ x)

    def twists(self, X: Series) -> Series:
        """Twists (..., 6, k) that are seen from the inertial frame, in the axes of the base: Ad(C^-1) X."""
        Ad_inverse, ads = Ad(inverse(self.pose)), self.V.map(lambda V: ad(V[..., 0]))
        return from_rates(lambda k: Ad_inverse @ X[k], lambda Y: -(ads @ Y))


def moved(x: Series, E: Array, drift: Callable[[Series], Series]) -> Series:
    """y = E x of a matrix E that moves with the base: ``y' = E (x' + drift(x))``, so that no rate of E is needed."""
    seen = [x]  # the rates in space, in the axes of the base

    def term(k: int) -> Array:
        while len(seen) <= k:
            seen.append(seen[-1].dot + drift(seen[-1]))
        return E @ seen[k][0]

    return Series(term)


STILL = BaseMotion(np.eye(4, dtype=int), Series.constant(np.zeros((6, 1), dtype=int)))  # at the inertial frame
