"""Fourier series at rest where their period begins: rates to q4d vanish there, so that a robot can start and stop.

    q(t) = c + sum_k a_k cos(k w t) + b_k sin(k w t),   w = 2 pi / period,
    sum_k k b_k = sum_k k^2 a_k = sum_k k^3 b_k = sum_k k^4 a_k = 0.

The conditions leave each joint 2 N - 4 free amplitudes of N harmonics, and its mean c.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jounce.motion import Motion

MIN_HARMONICS = 3  # with two of them, nothing moves that is at rest at the ends
POINTS_PER_HIGHEST_PERIOD = 32  # of the highest harmonic: between such points peaks are higher by 0.5 % at most


@dataclass(frozen=True)
class Harmonics:
    """Series with `count` harmonics over some periods, linear in free amplitudes x (2 count - 3, n), means first."""

    period: float
    periods: int
    count: int

    @property
    def frequency(self) -> float:
        """Of the first harmonic, rad/s."""
        return 2 * np.pi / self.period

    @property
    def step(self) -> float:
        """Between the points at which the series are evaluated, s."""
        return self.period / (POINTS_PER_HIGHEST_PERIOD * self.count)

    @cached_property
    def cosines(self) -> np.ndarray:
        """The amplitudes of cosines (count, 2 count - 3) that belong to the free ones."""
        even = _rest_basis(self.count, (2, 4))
        return np.hstack([np.zeros((self.count, 1)), even, np.zeros_like(even)])

    @cached_property
    def sines(self) -> np.ndarray:
        """The amplitudes of sines (count, 2 count - 3) that belong to the free ones."""
        odd = _rest_basis(self.count, (1, 3))
        return np.hstack([np.zeros((self.count, 1)), np.zeros_like(odd), odd])

    def basis(self, order: int) -> np.ndarray:
        """The series of each free amplitude with its rates, (order + 1, points, 2 count - 3)."""
        points = POINTS_PER_HIGHEST_PERIOD * self.count
        k = np.arange(1, self.count + 1)
        angles = k * (2 * np.pi * np.arange(points) / points)[:, None]
        found = np.empty((order + 1, points, self.cosines.shape[1]))
        for rate in range(order + 1):
            size, turned = (self.frequency * k) ** rate, angles + rate * np.pi / 2
            found[rate] = (size * np.cos(turned)) @ self.cosines + (size * np.sin(turned)) @ self.sines
        found[0, :, 0] = 1
        return found

    def motion(self, x: np.ndarray, joint_names: tuple[str, ...]) -> Motion:
        """The motion over all periods."""
        a, b = self.cosines @ x, self.sines @ x
        found = Motion.fourier(x[0], a, b, self.frequency, self.period * self.periods, joint_names=joint_names)
        times = f"{self.periods} periods" if self.periods > 1 else "one period"
        source = f"Fourier series, {self.count} harmonics of {1 / self.period:.6g} Hz, {times} of {self.period:g} s"
        return replace(found, source=source)


def _rest_basis(count: int, powers: tuple[int, int]) -> np.ndarray:
    """An orthonormal basis (count, count - 2) of the amplitudes with sum_k k^p amplitude_k = 0 for both powers p."""
    k = np.arange(1, count + 1) / count
    return np.asarray(np.linalg.svd(np.stack([k**power for power in powers]))[2][2:].T)
