"""The states along a motion."""

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
