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

    Sums over the last second of motion are kept in blocks, the newest first, so that what is older is forgotten: an
    exponential mean remembers a start, at which a filter is off by a hundred deviations, for ten times its own time.
    """

    power: np.ndarray  # mean of nu^2 / S, squared
    slow: np.ndarray  # low-pass of nu / sqrt(S)
    spread: np.ndarray  # (B, 1), the variance of that of white noise of 1, at the spacings of the samples
    level: np.ndarray  # the same over the deviation that it has for white noise of 1
    peak: np.ndarray  # last peak of the level
    pace: np.ndarray  # steps per s that a joint passes
    rest: np.ndarray  # 1 where a joint rests or did so within the memory of the filter, else 0
    sums: np.ndarray  # (blocks, 4, B, n), over time while joints move: 1, nu^2 / S, log S, the squared level of `slow`
    means: np.ndarray  # (3, B, n), of these over the last second of motion

    @staticmethod
    def start(count: int, n: int) -> "Innovations":
        """Those before the second sample."""
        power, slow, level, peak, pace, rest = np.zeros((6, count, n))
        spread, sums, means = np.zeros((count, 1)), np.zeros((1 + CHOICE_BLOCKS, 4, count, n)), np.zeros((3, count, n))
        return Innovations(power, slow, spread, level, peak, pace, rest, sums, means)

    def add(self, step: float, settings: Settings, nu: np.ndarray, variance: np.ndarray, passed: np.ndarray) -> None:
        """Take in innovations nu (B, n) of filters after `step` s, in which joints pass steps."""
        omega = settings.omega[:, None]
        share, of_pace = -np.expm1(-step * omega), -np.expm1(-step * PACE_FACTOR * omega)
        leak = np.exp(-step / (settings.lag + MEMORY_ANGLE / omega))
        white = nu / np.sqrt(variance)[:, None]
        square = white**2
        self.power -= np.expm1(-step / TRUST_TIME) * (square - self.power)
        self.slow += share * (white - self.slow)
        # of the first sample as if all before were as far apart
        self.spread = np.where(self.spread > 0, (1 - share) ** 2 * self.spread + share**2, share / (2 - share))
        self.level = self.slow / np.sqrt(self.spread)
        self.pace += of_pace * (passed / step - self.pace)
        rest = 1 / (1 + (2 * np.pi / REST_PACE * self.pace / omega) ** PACE_ORDER)
        np.maximum(np.abs(self.level), leak * self.peak, out=self.peak)
        np.maximum(rest, leak * self.rest, out=self.rest)
        # samples on the same step do not distinguish filters
        time, block = step * (1 - rest[-1]) * np.minimum(self.pace[-1] * step, 1), self.sums[0]
        block[0] += time
        block[1] += time * square
        block[2] += time * np.log(variance)[:, None]
        block[3] += time * self.level**2
        full = block[0, 0] > CHOICE_TIME / CHOICE_BLOCKS
        if full.any():
            self.sums[1:, :, :, full] = self.sums[:-1, :, :, full]
            self.sums[0, :, :, full] = 0
        total = self.sums.sum(axis=0)
        self.means = np.asarray(total[1:] / np.maximum(total[0], np.finfo(float).tiny))

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
