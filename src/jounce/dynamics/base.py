"""The motion of the base: of a floating robot's own, or of the ground on which a fixed robot stands."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from jounce._scalars import Array
from jounce.spatial.lie import Ad, ad, hat, inverse, rotation, wedge
from jounce.spatial.series import Series, from_rate


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

    def field(self, gravity: Array) -> Series:
        """The acceleration of gravity in the axes of the base, (..., 3, 1)."""
        return from_rate(rotation(self.pose).mT @ gravity[:, None], lambda g: -(self.hat_w @ g))

    def in_space(self, W: Series) -> Series:
        """A wrench on the base, (..., 6, 1), in inertial axes about the inertial origin.

        It is rotated with the base: ``(Ad^T W)' = Ad^T (W' - ad(V)^T W)``, so that no rate of Ad is needed.
        """
        Ad_T, ads = Ad(inverse(self.pose)).mT, self.V.map(lambda V: ad(V[..., 0]).mT)
        seen = [W]  # the rates in space, in the axes of the base

        def term(k: int) -> Array:
            while len(seen) <= k:
                seen.append(seen[-1].dot - ads @ seen[-1])
            return Ad_T @ seen[k][0]

        return Series(term)


STILL = BaseMotion(np.eye(4, dtype=int), Series.constant(np.zeros((6, 1), dtype=int)))  # at the inertial frame
