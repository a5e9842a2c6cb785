"""Kalman filters of sampled positions, one for each of several bandwidths, that smooth at a fixed lag.

Problem: samples y = q + n, n of variance r^2, of a motion whose q^(m) is white noise of density r^2 dt (2 pi f)^(2m).
With evenly spaced samples the filter becomes the Butterworth filter of order m and bandwidth f, whatever r is. In
scaled time, s = 2 pi f t, with rates per s and variances over r^2, h = 2 pi f dt is all that it depends on.

Algorithm: prediction and correction over the spacing at hand (Kalman, 1960). States of earlier ticks are kept and
corrected by each innovation too, through their covariances with the present state: smoothers at fixed points (Anderson
& Moore, Optimal Filtering, 1979, section 7.2), of which the one nearest to the lag is read. One covariance serves all
joints, since they are sampled together and their noise only scales it.

Invariant: the newest of the kept states is the present one, so that ``cross[:, 0]`` is ``covariance[:, 0]``.
"""

from dataclasses import dataclass
from math import factorial

import numpy as np

START_VARIANCE = 1e8  # of scaled rates, over r^2: nothing is known of them at the first sample


@dataclass(frozen=True, eq=False)
class Filters:
    """States of B filters of m states at K ticks, the newest first; rates and variances are scaled.

    `covariance` is that of the errors of a state, `cross` that of its errors with those of the present state.
    """

    x: np.ndarray  # (B, K, m, n)
    covariance: np.ndarray  # (B, K, m, m)
    cross: np.ndarray  # (B, K, m, m)


def start_filters(y: np.ndarray, count: int, kept: int, states: int) -> Filters:
    """Filters at the first sample y (n,), of which nothing else is known."""
    x = np.zeros((count, kept, states, len(y)))
    x[:, :, 0] = y
    P = np.zeros((count, kept, states, states))
    P[:] = np.diag([1.0] + [START_VARIANCE] * (states - 1))
    return Filters(x, P, P.copy())


def transition(steps: np.ndarray, states: int) -> np.ndarray:
    """Taylor's series over scaled steps (B,), as matrices (B, m, m)."""
    found = np.zeros((len(steps), states, states))
    for k in range(states):
        found[:, range(states - k), range(k, states)] = (steps**k / factorial(k))[:, None]
    return found


def process_noise(steps: np.ndarray, h: np.ndarray, states: int) -> np.ndarray:
    """What the white noise of q^(m) adds to the covariance over scaled steps (B,), as matrices (B, m, m)."""
    i, j = states - 1 - np.indices((states, states))  # of integrals of the noise
    factorials = np.array([factorial(k) for k in range(states)], dtype=float)
    scale = factorials[i] * factorials[j] * (i + j + 1)
    return np.asarray(h[:, None, None] * steps[:, None, None] ** (i + j + 1) / scale)


def predict(filters: Filters, F: np.ndarray, W: np.ndarray, keep: bool) -> Filters:
    """Filters at the next tick, over a transition F with process noise W; `keep` the present state, drop the oldest."""
    count, _, states, _ = filters.cross.shape
    older = slice(None, -1) if keep else slice(1, None)
    P = F @ filters.covariance[:, 0] @ F.mT + W
    newest = ((P + P.mT) / 2)[:, None]
    cross = filters.cross[:, older]
    moved = (cross.reshape(count, cross.shape[1] * states, states) @ F.mT).reshape(cross.shape)
    return Filters(
        np.concatenate([F[:, None] @ filters.x[:, :1], filters.x[:, older]], axis=1),
        np.concatenate([newest, filters.covariance[:, older]], axis=1),
        np.concatenate([newest, moved], axis=1),
    )


def correct(filters: Filters, innovations: np.ndarray) -> Filters:
    """Filters with a sample taken in by its innovations (B, n)."""
    shared = filters.cross[..., 0]  # covariance of each state with the innovation
    gains = shared / innovation_variance(filters)[:, None, None]
    return Filters(
        filters.x + gains[..., None] * innovations[:, None, None],
        filters.covariance - shared[..., None] * gains[:, :, None],
        filters.cross - shared[..., None] * gains[:, :1, None],
    )


def innovation_variance(filters: Filters) -> np.ndarray:
    """Variances (B,) of the innovations at the present tick, before a correction."""
    return np.asarray(1 + filters.covariance[:, 0, 0, 0])
