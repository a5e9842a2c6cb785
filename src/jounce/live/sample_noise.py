"""What samples that come one by one scatter by: estimates by their differences and steps, window by window."""

from dataclasses import dataclass, field

import numpy as np

from jounce.motion.noise import NOISE_DIFFERENCE_ORDER, classify_noise, find_step

WINDOW_SAMPLES = 256  # by which noise is estimated
WINDOW_WEIGHT = 1 / 4  # of a window's variance in the mean of the last ones
MAX_SIGMA_TO_ROUNDING = 2.0  # beyond which rounding is a small part of a joint's noise


@dataclass(eq=False)
class NoiseWindows:
    """The standard deviation and the step, 0 of white noise, of each joint's samples (n,); NaN as long as unknown.

    `rows` (t, q) are the window that fills. Of the last one, `window`, `joints` are left to be estimated, one with each
    sample, so that none takes long. What follows from the deviations is kept until one changes.
    """

    sigma: np.ndarray
    steps: np.ndarray
    rows: list[np.ndarray] = field(default_factory=list)
    window: np.ndarray | None = None
    joints: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._derive()

    def _derive(self) -> None:
        """What follows from deviations and steps."""
        known = self.sigma > 0
        # 1 / sigma, and 0 of joints whose noise is not known
        self.weights = np.divide(1, self.sigma, out=np.zeros_like(self.sigma), where=known)
        self.is_unknown = ~known
        # whether a large part of a joint's noise is rounding to its steps, whose errors are slow at times
        self.is_rounding = self.sigma <= MAX_SIGMA_TO_ROUNDING * self.steps / np.sqrt(12)

    def add(self, t: float, q: np.ndarray) -> None:
        """Take in a sample q (n,)."""
        self.rows.append(np.append(t, q))
        if len(self.rows) == WINDOW_SAMPLES:
            self.window, self.rows, self.joints = np.array(self.rows), [], list(range(len(q)))
        elif self.window is not None and self.joints:
            j = self.joints.pop(0)
            self._estimate(j, self.window[:, 0], self.window[:, 1 + j])
            self._derive()

    def _estimate(self, j: int, t: np.ndarray, q: np.ndarray) -> None:
        """Take in what the samples of a window say of joint j."""
        known, (found, step) = self.sigma[j], estimate_noise(t, q)
        if step and not found > known:  # slow rounding errors look larger by differences: the least window counts
            self.sigma[j] = found
        elif found and not step:
            before = found if np.isnan(known) else known
            self.sigma[j] = np.sqrt(before**2 + WINDOW_WEIGHT * (found**2 - before**2))
        self.steps[j] = step or self.steps[j]

    def forget_window(self) -> None:
        """Drop the samples of a window that fills: later ones have another clock."""
        self.rows, self.joints = [], []


def estimate_noise(t: np.ndarray, q: np.ndarray) -> tuple[float, float]:
    """Standard deviation and step of one joint's samples (N,); (0, 0) where it rests on a step of its encoder.

    Divided differences, which polynomials of lower degree do not have, serve samples at uneven times too.
    """
    points = np.lib.stride_tricks.sliding_window_view(np.stack([t, q - q[0]]), NOISE_DIFFERENCE_ORDER + 1, axis=1)
    apart = points[0][:, :, None] - points[0][:, None, :]
    apart = apart / np.abs(apart).max(axis=(1, 2), keepdims=True) + np.eye(NOISE_DIFFERENCE_ORDER + 1)
    weights = 1 / apart.prod(axis=2)
    off = (weights * points[1]).sum(axis=1) / np.sqrt((weights**2).sum(axis=1))
    found = classify_noise(q, float(np.sqrt((off**2).mean())), find_step(q))
    if found.kind == "rounding" or not np.median(np.abs(off)):
        return 0.0, 0.0
    rounding = found.step / np.sqrt(12)
    return found.sigma, found.step if found.sigma <= MAX_SIGMA_TO_ROUNDING * rounding else 0.0
