"""Kalman filters of sampled positions, one for each of several bandwidths, that smooth at a fixed lag.

Problem: samples y = q + n, n of variance r^2, of a motion whose q^(m) is white noise of density r^2 dt (2 pi f)^(2m).
With evenly spaced samples the filter becomes the Butterworth filter of order m and bandwidth f, whatever r is. In
scaled time, s = 2 pi f t, with rates per s and variances over r^2, h = 2 pi f dt is all that it depends on.

Algorithm: prediction and correction over the spacing at hand (Kalman, 1960). States of earlier ticks are kept and
corrected by each innovation too, through their covariances with the present state: smoothers at fixed points (Anderson
& Moore, Optimal Filtering, 1979, section 7.2), of which the one nearest to the lag is read. One covariance serves all
joints, since they are sampled together and their noise only scales it.

Invariant: the kept state at `head` is the present one, so that ``cross[..., head]`` is ``covariance[..., head]``. All
arrays are changed in place, and have the kept states last: these are the longest axis, along which NumPy is quick.
"""

from dataclasses import dataclass
from functools import cache
from math import factorial

import numpy as np

START_VARIANCE = 1e8  # of scaled rates, over r^2: nothing is known of them at the first sample


@dataclass(eq=False)
class Filters:
    """States of B filters of m states at K ticks, a ring whose newest is at `head`; rates and variances are scaled.

    `covariance` is that of the errors of a state, `cross` that of the present state's errors with those of a kept one.
    """

    x: np.ndarray  # (B, n, m, K)
    covariance: np.ndarray  # (B, m, m, K)
    cross: np.ndarray  # (B, m, m, K)
    head: int = 0

    @property
    def present(self) -> np.ndarray:
        """The positions (B, n) of the present state."""
        return self.x[:, :, 0, self.head]

    def place(self, age: int) -> int:
        """Where the state is that was kept `age` states before the present one."""
        return (self.head + age) % self.x.shape[-1]


def start_filters(y: np.ndarray, count: int, kept: int, states: int) -> Filters:
    """Filters at the first sample y (n,), of which nothing else is known."""
    x = np.zeros((count, len(y), states, kept))
    x[:, :, 0] = y[:, None]
    P = np.zeros((count, states, states, kept))
    P[:] = np.diag([1.0] + [START_VARIANCE] * (states - 1))[..., None]
    return Filters(x, P, P.copy())


@cache
def _taylor_series(states: int) -> tuple[np.ndarray, np.ndarray]:
    """Of a transition: the powers of the step (m, m), and their factors, zero below the diagonal."""
    power = np.arange(states) - np.arange(states)[:, None]
    factors = [1 / factorial(k) if k >= 0 else 0.0 for k in power.ravel()]
    return power.clip(0), np.array(factors).reshape(power.shape)


@cache
def _noise_series(states: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the process noise: the powers of the step (m, m), and their factors."""
    i, j = states - 1 - np.indices((states, states))  # of integrals of the noise
    factorials = np.array([factorial(k) for k in range(states)], dtype=float)
    return i + j + 1, 1 / (factorials[i] * factorials[j] * (i + j + 1))


def _powers(steps: np.ndarray, count: int) -> np.ndarray:
    """The powers (B, count) of steps (B,) from the 0th on."""
    found = np.empty((len(steps), count))
    found[:, 0] = 1
    found[:, 1:] = steps[:, None]
    return np.asarray(np.multiply.accumulate(found, axis=1))


def transition(steps: np.ndarray, states: int) -> np.ndarray:
    """Taylor's series over scaled steps (B,), as matrices (B, m, m)."""
    power, factors = _taylor_series(states)
    return np.asarray(_powers(steps, states)[:, power] * factors)


def process_noise(steps: np.ndarray, h: np.ndarray, states: int) -> np.ndarray:
    """What the white noise of q^(m) adds to the covariance over scaled steps (B,), as matrices (B, m, m)."""
    power, factors = _noise_series(states)
    return np.asarray(_powers(steps, 2 * states)[:, power] * (h[:, None, None] * factors))


def predict(filters: Filters, F: np.ndarray, W: np.ndarray, keep: bool) -> None:
    """To the next tick, over a transition F with process noise W; `keep` the present state, drop the oldest."""
    x, P, cross, last = filters.x, filters.covariance, filters.cross, filters.head
    head = filters.head = filters.place(-1) if keep else last
    # summed term by term, as generated code does: P of a start is 1e8 times that of a sample, and order matters
    newest = (F[..., None] * P[:, None, ..., last]).sum(axis=2)
    newest = (newest[:, :, None] * F[:, None]).sum(axis=3) + W
    newest = (newest + newest.mT) / 2
    cross[:] = (F @ cross.reshape(*cross.shape[:2], -1)).reshape(cross.shape)
    cross[..., head] = P[..., head] = newest
    x[..., head] = x[..., last] @ F.mT


def correct(filters: Filters, innovations: np.ndarray) -> None:
    """Take a sample in by its innovations (B, n)."""
    shared = filters.cross[:, 0]  # covariance of each state with the innovation
    gains = shared / innovation_variance(filters)[:, None, None]
    filters.x += innovations[:, :, None, None] * gains[:, None]
    filters.covariance -= shared[:, :, None] * gains[:, None]
    filters.cross -= gains[:, :, None, None, filters.head] * shared[:, None]


def innovation_variance(filters: Filters) -> np.ndarray:
    """Variances (B,) of the innovations at the present tick, before a correction."""
    return np.asarray(1 + filters.covariance[:, 0, 0, filters.head])
