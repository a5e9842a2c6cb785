"""Curves in closed form: sums of cosines and polynomials, whose rates of every order are exact."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from jounce.motion.curves import Smooth


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
        return (1, -1, -1, 1)[k % 4] * self.amplitude * np.float64(self.frequency) ** k * turned


@dataclass(frozen=True)
class Terms:
    """A coordinate over time: a polynomial in t, lowest power first, and cosines."""

    polynomial: tuple[float, ...] = (0.0,)
    cosines: tuple[Cosine, ...] = ()

    def rate(self, t: np.ndarray, k: int) -> np.ndarray:
        """The k-th time derivative at the times t."""
        power = Polynomial(self.polynomial)
        total = (power.deriv(k) if k else power)(t) + 0 * t
        return sum((cosine.rate(t, k) for cosine in self.cosines), start=total)


@dataclass(frozen=True)
class Analytic(Smooth):
    """Coordinates in closed form from one time to another."""

    terms: tuple[Terms, ...]
    start: float
    stop: float

    @property
    def columns(self) -> int:
        """The number of coordinates."""
        return len(self.terms)

    @property
    def highest(self) -> None:
        """None: derivatives of every order are known."""

    @np.errstate(over="ignore", invalid="ignore")  # whoever asks refuses what is not finite
    def rates(self, t: np.ndarray, order: int, left: bool = False) -> list[np.ndarray]:
        """The values and their derivatives up to `order`."""
        return [np.stack([terms.rate(t, k) for terms in self.terms], axis=1) for k in range(order + 1)]
