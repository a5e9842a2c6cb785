"""A low-pass filter w / (s + w) of sampled signals, exact for signals that are cubic between samples at any times.

The filter takes derivatives away: F[dv/dt] = w (v(t) - exp(-w (t - t0)) v(t0)) - w F[v], by integration by parts.

Algorithm: exponential integration of y' = w (u - y), exact for the cubic through the four samples around each interval:
y[k + 1] = exp(-w h) y[k] + w h sum of phi_p(-w h) times the coefficients of u, where the moments phi are confluent
hypergeometric functions. Invariant: y[0] = 0, so that a constant u becomes
u (1 - exp(-w (t - t0))). Samples that are far from evenly spaced are joined by lines.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.special import hyp1f1

from jounce.core.errors import JounceError
from jounce.identification.averaging import MAX_REGRESSOR_SAMPLES

CUBIC_POINTS = 4  # samples that a cubic passes through
MIN_INTERVAL_RATIO = 0.1  # of the intervals between them: below it a line is taken, as a cubic would amplify noise


@dataclass(frozen=True, eq=False)
class LowPass:
    """A filter F[u]' = w (u - F[u]): y[k + 1] = decay[k] y[k] + sum of weights[k, m] u[first[k] + m], y[0] = 0."""

    t: np.ndarray
    cutoff: float  # w, rad/s
    decay: np.ndarray  # (N - 1,)
    first: np.ndarray  # (N - 1,)
    weights: np.ndarray  # (N - 1, CUBIC_POINTS)

    def __call__(self, signal: Callable[[slice], tuple[np.ndarray, np.ndarray]]) -> Iterator[tuple[slice, np.ndarray]]:
        """The filtered u + dv/dt by pieces of samples, from a function that returns u and v at some samples."""
        # F[u + dv/dt] = F[u - w v] + w v - w exp(-w (t - t0)) v(t0)
        w, (_, v_start) = self.cutoff, signal(slice(0, 1))
        y = 0 * v_start
        yield slice(0, 1), y
        for start in range(0, len(self.decay), MAX_REGRESSOR_SAMPLES):
            steps = slice(start, min(start + MAX_REGRESSOR_SAMPLES, len(self.decay)))
            first = self.first[steps]
            u, v = signal(slice(first[0], first[-1] + CUBIC_POINTS))
            part, axes = slice(steps.start + 1, steps.stop + 1), (-1, *[1] * (u.ndim - 1))
            u, direct = u - w * v, w * v[part.start - first[0] : part.stop - first[0]]
            filtered = sum(g.reshape(axes) * u[first - first[0] + m] for m, g in enumerate(self.weights[steps].T))
            for k, decay in enumerate(self.decay[steps]):
                filtered[k] += decay * y[0]
                y = filtered[k : k + 1]
            fading = w * np.exp(-w * (self.t[part] - self.t[0])).reshape(axes)
            yield part, filtered + direct - fading * v_start

    def apply(self, values: np.ndarray) -> np.ndarray:
        """The filtered signal of values (N, ...) at all samples."""
        return np.concatenate([y for _, y in self(lambda part: (values[part], 0 * values[part]))])


def design_low_pass(t: np.ndarray, cutoff: float) -> LowPass:
    """The filter for increasing times (N,), four at least, and a cutoff frequency in Hz."""
    if len(t) < CUBIC_POINTS:
        raise JounceError(f"a filter needs {CUBIC_POINTS} samples or more, got {len(t)}")
    w, h = 2 * np.pi * cutoff, np.diff(t)
    first = np.clip(np.arange(len(h)) - 1, 0, len(t) - CUBIC_POINTS)
    near = first[:, None] + np.arange(CUBIC_POINTS)
    powers = np.arange(CUBIC_POINTS)
    # weights of samples: those of moments of powers of the place in the interval, through the Vandermonde matrix
    x = ((t[near] - t[:-1, None]) / h[:, None])[:, None] ** powers[:, None]  # (N - 1, powers, points)
    moments = (w * h)[:, None] * hyp1f1(1, powers + 2, -(w * h)[:, None]) / (powers + 1)
    cubic = np.linalg.solve(x, moments[..., None])[..., 0]
    later, earlier = (near == np.arange(len(h))[:, None] + k for k in (1, 0))
    line = later * moments[:, 1:2] + earlier * (moments[:, :1] - moments[:, 1:2])
    gaps = np.diff(t[near], axis=1)
    even = gaps.min(axis=1) >= MIN_INTERVAL_RATIO * gaps.max(axis=1)
    return LowPass(t, w, np.exp(-w * h), first, np.where(even[:, None], cubic, line))
