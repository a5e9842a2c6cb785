"""The states along a motion."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

COMPONENTS = ("mx", "my", "mz", "fx", "fy", "fz")  # of a wrench, (moment; force), in files


@dataclass(frozen=True)
class Motion:
    """Coordinates and their rates, each (N, n), at the times t, (N,)."""

    t: np.ndarray
    rates: tuple[np.ndarray, ...]
    source: str  # how the rates came about, in words
    wrench: tuple[dict[str, np.ndarray], ...] | None = None  # W by body, (N, 6), and its rates
    residual: float | None = None  # largest distance of the coordinates from the samples that they come from

    def pieces(self, states: int) -> Iterator["Motion"]:
        """The motion in pieces of at most so many states."""
        for i in range(0, len(self.t), states):
            part = slice(i, i + states)
            wrench = self.wrench and tuple({body: W[part] for body, W in rate.items()} for rate in self.wrench)
            yield Motion(self.t[part], tuple(rate[part] for rate in self.rates), self.source, wrench, self.residual)
