"""A low-pass filter w / (s + w) of sampled signals, exact for signals that are cubic between samples at any times."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import hyp1f1

PIECE = 2000  # samples that are filtered at once
POINTS = 4  # samples that a cubic passes through
EVEN = 0.1  # ratio of the intervals between them, below which it is a line: a cubic would amplify noise


@dataclass(frozen=True, eq=False)
class LowPass:
    """A filter w / (s + w) on samples: y[k + 1] = decay[k] y[k] + sum of weights[k, m] u[first[k] + m]."""

    t: np.ndarray
    cutoff: float  # w, rad/s
    decay: np.ndarray  # (N - 1,)
    first: np.ndarray  # (N - 1,)
    weights: np.ndarray  # (N - 1, POINTS)

    def __call__(self, signal: Callable[[slice], np.ndarray]) -> Iterator[tuple[slice, np.ndarray]]:
        """The filtered signal by pieces of samples, from a function that returns the signal at some samples."""
        y = 0 * signal(slice(0, 1))
        yield slice(0, 1), y
        for start in range(0, len(self.decay), PIECE):
            steps = slice(start, min(start + PIECE, len(self.decay)))
            first = self.first[steps]
            u = signal(slice(first[0], first[-1] + POINTS))
            filtered = np.zeros((len(first), *u.shape[1:]))
            for m, weight in enumerate(self.weights[steps].T):
                filtered += weight.reshape(-1, *[1] * (u.ndim - 1)) * u[first - first[0] + m]
            for k, decay in enumerate(self.decay[steps]):
                filtered[k] += decay * y[0]
                y = filtered[k : k + 1]
            yield slice(steps.start + 1, steps.stop + 1), filtered

    def of(self, values: np.ndarray) -> np.ndarray:
        """The filtered signal of values (N, ...) at all samples."""
        return np.concatenate([y for _, y in self(values.__getitem__)])


def low_pass(t: np.ndarray, cutoff: float) -> LowPass:
    """The filter for increasing times (N,), N at least 4, and a cutoff frequency in Hz."""
    w, h = 2 * np.pi * cutoff, np.diff(t)
    first = np.clip(np.arange(len(h)) - 1, 0, len(t) - POINTS)
    near = first[:, None] + np.arange(POINTS)
    powers = np.arange(POINTS)
    x = ((t[near] - t[:-1, None]) / h[:, None])[:, None] ** powers[:, None]  # (N - 1, powers, points)
    moments = (w * h)[:, None] * hyp1f1(1, powers + 2, -(w * h)[:, None]) / (powers + 1)
    cubic = np.linalg.solve(x, moments[..., None])[..., 0]
    later, earlier = (near == np.arange(len(h))[:, None] + k for k in (1, 0))
    line = later * moments[:, 1:2] + earlier * (moments[:, :1] - moments[:, 1:2])
    gaps = np.diff(t[near], axis=1)
    even = gaps.min(axis=1) >= EVEN * gaps.max(axis=1)
    return LowPass(t, w, np.exp(-w * h), first, np.where(even[:, None], cubic, line))
