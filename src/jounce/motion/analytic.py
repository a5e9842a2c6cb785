"""Motions in closed form: sums of cosines and polynomials, whose rates of every order are exact."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from jounce.errors import JounceError, listed, no_such
from jounce.mechanism import Mechanism
from jounce.motion.states import Motion


@dataclass(frozen=True)
class Cosine:
    """amplitude * cos(frequency * t + phase): rad or m, rad/s, rad."""

    amplitude: float
    frequency: float
    phase: float

    def rate(self, t: np.ndarray, k: int) -> np.ndarray:
        """The k-th time derivative; whole quarter turns exchange cosine and sine, so that no phase is rounded."""
        angle = self.frequency * t + self.phase
        turned = np.cos(angle) if k % 2 == 0 else np.sin(angle)
        return (1, -1, -1, 1)[k % 4] * self.amplitude * self.frequency**k * turned


@dataclass(frozen=True)
class Curve:
    """A coordinate over time: a polynomial in t, lowest power first, and cosines."""

    polynomial: tuple[float, ...] = (0.0,)
    cosines: tuple[Cosine, ...] = ()

    def rate(self, t: np.ndarray, k: int) -> np.ndarray:
        """The k-th time derivative at the times t."""
        power = Polynomial(self.polynomial)
        total = (power.deriv(k) if k else power)(t) + 0 * t
        return sum((cosine.rate(t, k) for cosine in self.cosines), start=total)


def along(curves: Mapping[str, Curve], t: np.ndarray, mechanism: Mechanism, highest: int) -> Motion:
    """The motion of curves by joint name, with rates up to the one of order `highest`."""
    joints = mechanism.coordinates
    for name in curves:
        if name not in joints:
            raise no_such("joint", name, joints)
    missing = [name for name in joints if name not in curves]
    if missing:
        raise JounceError(f"no terms for {listed(missing)}; expected some for each of {listed(joints)}")
    rates = (np.stack([curves[joint].rate(t, k) for joint in joints], axis=1) for k in range(highest + 1))
    return Motion(t, tuple(rates), "analytic terms, all rates exact")
