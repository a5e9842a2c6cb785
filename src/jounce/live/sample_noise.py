"""What samples that come one by one scatter by: estimates by their differences and steps, window by window."""

from dataclasses import dataclass, replace

import numpy as np

from jounce.motion.noise import NOISE_DIFFERENCE_ORDER, classify_noise, find_step

WINDOW_SAMPLES = 256  # by which noise is estimated
WINDOW_WEIGHT = 1 / 4  # of a window's variance in the mean of the last ones
MAX_SIGMA_TO_ROUNDING = 2.0  # beyond which rounding is a small part of a joint's noise


@dataclass(frozen=True, eq=False)
class NoiseWindows:
    """The standard deviation and the step, 0 of white noise, of each joint's samples (n,); NaN as long as unknown.

    `rows` (t, q) are the window that fills. Of the last one, `window`, `joints` are left to be estimated, one with each
    sample, so that none takes long.
    """

    sigma: np.ndarray
    steps: np.ndarray
    rows: tuple[np.ndarray, ...] = ()
    window: np.ndarray | None = None
    joints: tuple[int, ...] = ()

    @property
    def is_rounding(self) -> np.ndarray:
        """Whether a large part of a joint's noise (n,) is rounding to its steps, whose errors are slow at times."""
        return np.asarray(self.sigma <= MAX_SIGMA_TO_ROUNDING * self.steps / np.sqrt(12))


def add_sample(known: NoiseWindows, t: float, q: np.ndarray) -> NoiseWindows:
    """The noise with one more sample q (n,)."""
    rows = (*known.rows, np.append(t, q))
    if len(rows) == WINDOW_SAMPLES:
        return replace(known, rows=(), window=np.array(rows), joints=tuple(range(len(q))))
    if known.window is None or not known.joints:
        return replace(known, rows=rows)
    j, sigma, steps = known.joints[0], known.sigma.copy(), known.steps.copy()
    found, step = estimate_noise(known.window[:, 0], known.window[:, 1 + j])
    if step and not found > sigma[j]:  # slow rounding errors look larger by differences: the least window counts
        sigma[j] = found
    elif found and not step:
        before = found if np.isnan(sigma[j]) else sigma[j]
        sigma[j] = np.sqrt(before**2 + WINDOW_WEIGHT * (found**2 - before**2))
    steps[j] = step or steps[j]
    return replace(known, rows=rows, sigma=sigma, steps=steps, joints=known.joints[1:])


def forget_window(known: NoiseWindows) -> NoiseWindows:
    """The same noise, without the samples of a window that fills: later ones have another clock."""
    return replace(known, rows=(), joints=())


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
