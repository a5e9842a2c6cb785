"""What innovations say of filters: whether they follow the motion, which bandwidth suits it, and where a joint rests.

Innovations of a filter that follows are white, of the variance that it states. Where the motion is faster than its
bandwidth they have slow parts, long before these exceed the noise of single samples: so both are watched, the mean
square and a low-pass at the bandwidth. Of several bandwidths the likeliest is that of the least
``log mean(nu^2 / S) + mean(log S)``: twice the negative logarithm of the likelihood per sample, at the likeliest r.

Rounding to an encoder's steps is no white noise where a joint passes fewer steps per second than the bandwidth: no
filter averages it, and motion within a step is not seen (jounce.motion.noise).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jounce.live.settings import Settings

TRUST_TIME = 0.1  # s, of an exponential mean that is as steady as one over a window of 0.2 s
CHOICE_TIME = 1.0  # s, over which filters are compared: half of it distinguishes a likelihood of 5 % per sample
CHOICE_BLOCKS = 4  # in which these are forgotten
MAX_INNOVATION_RMS = 1.1  # over the stated deviation: 2.2 means errors of 5 to 33 deviations
MAX_SLOW_INNOVATION = 3.0  # deviations of the low-pass, above which the motion is faster than the bandwidth
USUAL_SLOW_RMS = 1.45  # above which deviations grow: errors over them then have an rms of 0.9, and seldom exceed 5
MEMORY_ANGLE = 4.0  # rad of the bandwidth, for which a filter remembers what was
START_FACTOR = 60.0  # times the variances of rates: by simulated starts from rest, whose errors reach 14 r omega^3
MAX_REST = 0.05  # of a joint that moves
PACE_FACTOR = 3.0  # times the bandwidth, at which the pace of steps is averaged: a rest is seen at once
REST_PACE = 1.5  # steps per cycle of the bandwidth, below which rounding is not averaged
PACE_ORDER = 12  # of the transition between rest and motion, as steep as a filter of six states


class Trust(NamedTuple):
    """Whether the rates of each joint (n,) are to be trusted.

    `rms` is that of the normalised innovations of the last 0.2 s; 1 of a model that holds. Where `good`, nothing in the
    samples contradicts the deviations: errors of simulated logs were within 5.5 of them. What samples cannot show yet
    is not covered: a vibration within the noise, and a motion that began later than the lag. Where a joint is not
    `moving`, but rests on a step or just left it, deviations are bounds rather than standard deviations.

    Examples
    --------
    >>> import jounce
    >>> live = jounce.load("planar2r").live(1e-3, bandwidth=10, noise=1e-5)
    >>> _ = live.update([0.1, 0.2])
    >>> live.trust.good
    array([False, False])
    """

    rms: np.ndarray
    good: np.ndarray
    moving: np.ndarray


@dataclass(eq=False)
class Innovations:
    """Means over the last innovations of B filters and n joints, (B, n); in rad or m where nothing else is stated.

    Sums over the last second of motion are kept in blocks, so that what is older is forgotten: an
    exponential mean remembers a start, at which a filter is off by a hundred deviations, for ten times its own time.
    What is of one kind stands in one array: NumPy takes longer for a call than for the numbers of all filters.
    """

    forgetting: np.ndarray  # (4, B, 1), at which the averages below and then the peaks forget, per s
    least_pace: np.ndarray  # (B, 1), steps per s below which a joint rests
    averages: np.ndarray  # (3, B, n), exponential means of nu^2 / S, of nu / sqrt(S), and of the steps passed per s
    spread: np.ndarray  # (B, 1), the variance of the second of them of white noise of 1, at the spacings of the samples
    level: np.ndarray  # the second of them over the deviation that it has for white noise of 1
    peaks: np.ndarray  # (2, B, n), last peaks, which fade: of the level, and of how much the joint rests, 0 to 1
    block: np.ndarray  # (4, B, n), sums over time while joints move: of 1, nu^2 / S, log S, the squared level
    older: np.ndarray  # (blocks, 4, B, n), those of the rest of the last second, the newest first
    past: np.ndarray  # (4, B, n), the sum of these
    means: np.ndarray  # (3, B, n), of these over the last second of motion

    @staticmethod
    def start(settings: Settings) -> "Innovations":
        """Those before the second sample."""
        omega, n = settings.omega[:, None], len(settings.sigma)
        memory = settings.lag + MEMORY_ANGLE / omega
        forgetting = np.stack([np.full_like(omega, 1 / TRUST_TIME), omega, PACE_FACTOR * omega, 1 / memory])
        block = np.zeros((4, len(omega), n))
        older = np.zeros((CHOICE_BLOCKS, *block.shape))
        averages, peaks, past, means = block[:3].copy(), block[:2].copy(), block.copy(), block[:3].copy()
        least_pace, spread, level = REST_PACE / (2 * np.pi) * omega, np.zeros_like(omega), block[0].copy()
        return Innovations(forgetting, least_pace, averages, spread, level, peaks, block, older, past, means)

    @property
    def power(self) -> np.ndarray:
        """The mean of nu^2 / S over the last 0.2 s."""
        return self.averages[0]

    @property
    def peak(self) -> np.ndarray:
        """The last peak of the level of slow innovations."""
        return self.peaks[0]

    @property
    def rest(self) -> np.ndarray:
        """1 where a joint rests, or did so within the memory of the filter, else 0."""
        return self.peaks[1]

    def add(self, step: float, nu: np.ndarray, variance: np.ndarray, passed: np.ndarray) -> None:
        """Take in innovations nu (B, n) of filters after `step` s, in which joints pass steps."""
        share = -np.expm1(-step * self.forgetting)
        new = np.empty_like(self.averages)
        square, white, pace = new
        white[:] = nu / np.sqrt(variance)[:, None]
        np.multiply(white, white, out=square)
        pace[:] = passed / step
        self.averages += share[:3] * (new - self.averages)
        _, slow, pace = self.averages
        # how far slow innovations are beyond those of white noise
        of_slow = share[1]
        if self.spread[0, 0]:
            self.spread = (1 - of_slow) ** 2 * self.spread + of_slow**2
        else:  # of the first sample as if all before were as far apart
            self.spread = of_slow / (2 - of_slow)
        self.level = slow / np.sqrt(self.spread)
        rest = 1 / (1 + (pace / self.least_pace) ** PACE_ORDER)
        self.peaks *= 1 - share[3]
        np.maximum(self.peaks[0], np.abs(self.level), out=self.peaks[0])
        np.maximum(self.peaks[1], rest, out=self.peaks[1])
        # samples on the same step do not distinguish filters
        time = step * (1 - rest[-1]) * np.minimum(pace[-1] * step, 1)
        row = np.empty_like(self.block)
        row[0], row[1], row[2], row[3] = 1, square, np.log(variance)[:, None], self.level**2
        self.block += time * row
        full = self.block[0, 0] > CHOICE_TIME / CHOICE_BLOCKS
        if full.any():
            self.older[1:, ..., full] = self.older[:-1, ..., full]
            self.older[0][..., full] = self.block[..., full]
            self.block[..., full] = 0
            self.past = self.older.sum(axis=0)
        total = self.past + self.block
        self.means = total[1:] / np.maximum(total[0], np.finfo(float).tiny)

    def choose(self, settled: np.ndarray) -> np.ndarray:
        """The likeliest filter of each joint (n,) of those `settled` (B,), the widest of one that has not moved."""
        power, log_variance, _ = self.means
        moved = power.all(axis=0)
        score = np.log(power, where=moved, out=np.zeros_like(power)) + log_variance
        score = np.where(settled[:, None], score, np.inf)
        return np.where(moved, score.argmin(axis=0), len(score) - 1)

    def trust(self, sigmas: np.ndarray, used: np.ndarray) -> Trust:
        """What the filters `used` (n,) deserve, by the noise (2, n) of each joint now, and over the last second."""
        joints, (now, long) = np.arange(len(used)), sigmas
        rms, peak = np.sqrt(self.power[used, joints]) / now, self.peak[used, joints] / sigmas.max(axis=0)
        windows = np.maximum(rms, np.sqrt(self.means[0, used, joints]) / long)
        good = (windows < MAX_INNOVATION_RMS) & (peak < MAX_SLOW_INNOVATION)
        return Trust(rms, good, self.rest[used, joints] < MAX_REST)

    def inflate(self, P: np.ndarray, sigma: np.ndarray, used: np.ndarray) -> np.ndarray:
        """Scaled covariances (n, k, k) with what slow innovations and rests add.

        Slow innovations of s times their deviation mean errors of the k-th rate of s^(1 + k/2) times theirs: of
        simulated harmonics 1.3, 1.9, 2.4, 2.8, 3.3, by a bandwidth that is 20 % too low.
        A joint that rests on a step of its encoder may move by r at the bandwidth, or start, and nothing shows it.
        """
        joints, order = np.arange(len(used)), np.arange(P.shape[1])
        slow = np.maximum(1, np.sqrt(self.means[2, used, joints]) / sigma / USUAL_SLOW_RMS)
        grown, rest = slow[:, None] ** (1 + order / 2), self.rest[used, joints, None, None]
        return grown[:, :, None] * grown[:, None] * P + rest**2 * (START_FACTOR * P + np.eye(len(order)))
