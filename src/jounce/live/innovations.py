"""Innovations show whether filters follow the motion, and what noise samples have.

Innovations of a filter that follows are white, of the variance that it states. Where the motion is faster than its
bandwidth they have slow parts, long before these exceed the noise of single samples: so both are watched, the mean
square and a low-pass at the bandwidth. Of several bandwidths the likeliest is that of the least
``log mean(nu^2 / S) + mean(log S)``: twice the negative logarithm of the likelihood per sample, at the likeliest r.
`Innovations` keeps these means with every sample, and finds from them the bandwidth, the trust, and what is added to
covariances.

Rounding to an encoder's steps is no white noise where a joint passes fewer steps per second than the bandwidth: no
filter averages it, and motion within a step is not seen (jounce.motion.noise). `NoiseWindows` estimates noise and steps
of each joint from windows of samples, by differences, one joint with each sample.

`StampJitter` finds what errors of time stamps add to that noise, from the innovations of all joints together. A stamp
that is off by e moves the sample of joint i by ``qd[i] e``: of all joints at once, along their velocities. Where these
are 1 rad/s, 0.3 ms are 3e-4 rad, fifty times the step of an encoder of 20 bits.

The innovations of all joints in a row, in units of their noise, are a vector; its part along the velocities is what
stamps move, the rest is what they do not touch. Noise of single joints, a vibration and a motion that is too fast have
both parts: of independent innovations x, along the unit vector u, the rest is on average ``sum((1 - u^2) x^2)``. Errors
of stamps are claimed only where the rest is a small share of that, over the last second and the last 0.2 s, and where
the part along the velocities is white: a motion that all joints share, as that along a straight line, has no rest, but
is slow. Where a single joint moves, its own noise looks the same, and none are claimed. Errors of stamps are seldom
white: the density of their slow part, over that of white noise, is `colour`, by a low-pass at the highest bandwidth.

A vibration above all bandwidths hides below such a noise, and below an estimate that still holds errors of stamps of a
faster part. The rest shows it, claimed or not: it is white of noise of joints and of errors of stamps, and its products
from row to row are a large share of its squares where a joint vibrates. Such a joint is not trusted. What is smaller
than both `MAX_HIDDEN_SHARE` and `MAX_HIDDEN_ANGLE` is left: every arm has some. Rounding to steps is slow at times, and
is no vibration.

Invariants: without a claim no noise is added; no claim makes a joint trusted that vibrates; a single joint that moves
has no rest, so nothing is claimed and no vibration is seen.
"""

from dataclasses import dataclass, field
from math import expm1, sqrt
from typing import NamedTuple

import numpy as np

from jounce.live.settings import Settings
from jounce.motion import noise

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
    """Whether to trust the rates of each joint (n,).

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
    """Means over the last innovations of filters and joints: (B, n).

    They are in rad or m where nothing else is stated. Sums over the last second of motion are kept in blocks, so that
    what is older is forgotten: an exponential mean remembers a start, at which a filter is off by a hundred deviations,
    for ten times its own time. What is of one kind stands in one array: NumPy takes longer for a call than for the
    numbers of all filters. `add` and `choose` run once per sample.
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
        """Return the means before the second sample."""
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
        """The last peak of the level of slow innovations, which fades."""
        return self.peaks[0]

    @property
    def rest(self) -> np.ndarray:
        """The share to which a joint rests: 1 also within the memory of the filter, 0 if it moves."""
        return self.peaks[1]

    def add(self, step: float, nu: np.ndarray, variance: np.ndarray, passed: np.ndarray) -> None:
        """Take in innovations nu after `step` s: (B, n), in which joints pass steps."""
        # Exponential means of nu^2 / S, nu / sqrt(S) and steps per s, with the share 1 - exp(-step / time) of the new.
        share = -np.expm1(-step * self.forgetting)
        new = np.empty_like(self.averages)
        square, white, pace = new
        white[:] = nu / np.sqrt(variance)[:, None]
        np.multiply(white, white, out=square)
        pace[:] = passed / step
        self.averages += share[:3] * (new - self.averages)
        _, slow, pace = self.averages
        # How far slow innovations are beyond those of white noise, whose low-pass has this variance at these spacings.
        # That of the first sample is as if all samples before were as far apart.
        slow_share = share[1]
        if self.spread[0, 0] != 0:
            self.spread = (1 - slow_share) ** 2 * self.spread + slow_share**2
        else:
            self.spread = slow_share / (2 - slow_share)
        self.level = slow / np.sqrt(self.spread)
        # Peaks of this level, and of how much a joint rests, by its pace: both fade within the memory of the filter.
        rest = 1 / (1 + (pace / self.least_pace) ** PACE_ORDER)
        self.peaks *= 1 - share[3]
        np.maximum(self.peaks[0], np.abs(self.level), out=self.peaks[0])
        np.maximum(self.peaks[1], rest, out=self.peaks[1])
        # Sums over time of motion, since samples on the same step do not distinguish filters.
        time = step * (1 - rest[-1]) * np.minimum(pace[-1] * step, 1)
        row = np.empty_like(self.block)
        row[0], row[1], row[2], row[3] = 1, square, np.log(variance)[:, None], self.level**2
        self.block += time * row
        # Full blocks of joints push out the oldest ones.
        full = self.block[0, 0] > CHOICE_TIME / CHOICE_BLOCKS
        if full.any():
            self.older[1:, ..., full] = self.older[:-1, ..., full]
            self.older[0][..., full] = self.block[..., full]
            self.block[..., full] = 0
            self.past = self.older.sum(axis=0)
        total = self.past + self.block
        self.means = total[1:] / np.maximum(total[0], np.finfo(float).tiny)

    def choose(self, settled: np.ndarray) -> np.ndarray:
        """Return the likeliest settled filter of each joint (n,).

        `settled` are masks of the filters (B,). A joint that has not moved gets the widest filter.
        """
        # log mean(nu^2 / S) + mean(log S), where there are innovations.
        power, log_variance, _ = self.means
        has_moved = power.all(axis=0)
        score = np.log(power, where=has_moved, out=np.zeros_like(power)) + log_variance
        score = np.where(settled[:, None], score, np.inf)
        return np.where(has_moved, score.argmin(axis=0), len(score) - 1)

    def trust(self, sigmas: np.ndarray, used: np.ndarray) -> Trust:
        """Return the trust in the filters `used` (n,) by the noise.

        The noise (2, n) is that now, and over the last second.
        """
        # Neither the mean square, in a short and in a long window, nor slow innovations may exceed what noise makes.
        joints, (sigma_now, sigma_long) = np.arange(len(used)), sigmas
        rms, peak = np.sqrt(self.power[used, joints]) / sigma_now, self.peak[used, joints] / sigmas.max(axis=0)
        windows = np.maximum(rms, np.sqrt(self.means[0, used, joints]) / sigma_long)
        good = (windows < MAX_INNOVATION_RMS) & (peak < MAX_SLOW_INNOVATION)
        return Trust(rms, good, self.rest[used, joints] < MAX_REST)

    def inflate(self, P: np.ndarray, sigma: np.ndarray, used: np.ndarray) -> np.ndarray:
        """Return scaled covariances with what slow innovations and rests add: (n, k, k).

        Slow innovations of s times their deviation mean errors of the k-th rate of s^(1 + k/2) times theirs: of
        simulated harmonics 1.3, 1.9, 2.4, 2.8, 3.3, by a bandwidth that is 20 % too low.
        A joint that rests on a step of its encoder may move by r at the bandwidth, or start, and nothing shows it.
        """
        joints, order = np.arange(len(used)), np.arange(P.shape[1])
        slow = np.maximum(1, np.sqrt(self.means[2, used, joints]) / sigma / USUAL_SLOW_RMS)
        grown, rest = slow[:, None] ** (1 + order / 2), self.rest[used, joints, None, None]
        return grown[:, :, None] * grown[:, None] * P + rest**2 * (START_FACTOR * P + np.eye(len(order)))


# Noise of single joints, by windows of samples.
WINDOW_SAMPLES = 256  # by which noise is estimated
WINDOW_WEIGHT = 1 / 4  # of a window's variance in the mean of the last ones
MAX_SIGMA_TO_ROUNDING = 2.0  # beyond which rounding is a small part of a joint's noise


@dataclass(eq=False)
class NoiseWindows:
    """The standard deviation and the step of each joint's samples (n,).

    They are NaN as long as they are unknown; steps are 0 of white noise. `rows` (t, q) are the window that fills. Of
    the last one, `window`, `joints` are left to be estimated, one with each sample, so that none takes long. What
    follows from the deviations is kept until one changes.
    """

    sigma: np.ndarray
    steps: np.ndarray
    rows: list[np.ndarray] = field(default_factory=list)
    window: np.ndarray | None = None
    joints: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._derive()

    def _derive(self) -> None:
        """Derive what follows from deviations and steps."""
        is_known = self.sigma > 0
        # 1 / sigma, and 0 of joints whose noise is not known.
        self.weights = np.divide(1, self.sigma, out=np.zeros_like(self.sigma), where=is_known)
        self.is_unknown = ~is_known
        # Whether a large part of a joint's noise is rounding to its steps, whose errors are slow at times.
        self.is_rounding = self.sigma <= MAX_SIGMA_TO_ROUNDING * self.steps / np.sqrt(12)

    def add(self, t: float, q: np.ndarray) -> None:
        """Take in a sample q (n,)."""
        self.rows.append(np.append(t, q))
        if len(self.rows) == WINDOW_SAMPLES:
            self.window, self.rows, self.joints = np.array(self.rows), [], list(range(len(q)))
        elif self.window is not None and len(self.joints) > 0:
            j = self.joints.pop(0)
            self._estimate(j, self.window[:, 0], self.window[:, 1 + j])
            self._derive()

    def _estimate(self, j: int, t: np.ndarray, q: np.ndarray) -> None:
        """Take in what the samples of a window say of joint j."""
        last_sigma, (sigma, step) = self.sigma[j], estimate_noise(t, q)
        # Slow rounding errors look larger by differences: of steps the least window counts. Of white noise it is the
        # mean of the last windows, and a window of rest says nothing.
        if step > 0 and not sigma > last_sigma:
            self.sigma[j] = sigma
        elif sigma > 0 and step == 0:
            before = sigma if np.isnan(last_sigma) else last_sigma
            self.sigma[j] = np.sqrt(before**2 + WINDOW_WEIGHT * (sigma**2 - before**2))
        if step > 0:
            self.steps[j] = step

    def forget_window(self) -> None:
        """Drop the samples of a window that fills: later ones have another clock."""
        self.rows, self.joints = [], []


def estimate_noise(t: np.ndarray, q: np.ndarray) -> tuple[float, float]:
    """Return standard deviation and step of one joint's samples (N,).

    (0, 0) where it rests on a step of its encoder. Divided differences, which polynomials of lower degree do not have,
    serve samples at uneven times too.
    """
    # Windows of order + 1 samples, and the weights of the divided difference in each, 1 / prod (t_i - t_j): (M, order +
    # 1). Times are over the longest of each window, as only the ratios of weights matter.
    points = np.lib.stride_tricks.sliding_window_view(np.stack([t, q - q[0]]), noise.NOISE_DIFFERENCE_ORDER + 1, axis=1)
    gaps = points[0][:, :, None] - points[0][:, None, :]
    gaps = gaps / np.abs(gaps).max(axis=(1, 2), keepdims=True) + np.eye(noise.NOISE_DIFFERENCE_ORDER + 1)
    weights = 1 / gaps.prod(axis=2)
    # Differences that have the variance of one sample.
    differences = (weights * points[1]).sum(axis=1) / np.sqrt((weights**2).sum(axis=1))
    sample_noise = noise.classify_noise(q, float(np.sqrt((differences**2).mean())), noise.find_step(q))
    if sample_noise.kind == "rounding" or np.median(np.abs(differences)) == 0:
        return 0.0, 0.0
    # A step that is a small part of the noise counts as none: the noise is white.
    rounding = sample_noise.step / np.sqrt(12)
    step = sample_noise.step if sample_noise.sigma <= MAX_SIGMA_TO_ROUNDING * rounding else 0.0
    return sample_noise.sigma, step


# Errors of stamps, by the innovations of all joints.
MIN_DOMINANCE = 4.0  # of errors of stamps over all else, whose variance is 6 % of theirs then: vibrations have 1 to 1.3
MIN_SLOW_DOMINANCE = 20.0  # over what of all else is no white noise: a vibration, or a motion that is too fast
MIN_SHARED = 0.1  # of the innovations, that more than one joint has: two joints of equal parts have 0.5
MAX_CORRELATION = 0.5  # of the errors of two stamps in a row: a vibration below a sixth of the sampling rate has more
MAX_COLOUR = 3.0  # of the density of slow errors of stamps, over that of white ones: a motion that is missed has 4
MAX_VIBRATION = 80.0  # Hz, of arms, which samples resolve by six a cycle at least: else it looks white
MAX_JITTER_TO_SPACING = 0.5  # beyond which stamps would change their order
MAX_SLOW_SHARE = 0.3  # of a joint's rest: vibrations of 3e-5 rad in white noise of 1e-5 have more, white noise none
MAX_HIDDEN_SHARE = 0.05  # of the innovations, that a slow rest may be: 0.02 to 0.03 along a log of a Panda
MAX_HIDDEN_ANGLE = 1e-5  # rad or m, that it may be, too: 4e-6 along that log; a vibration of 3e-5 at 30 Hz has 1.1e-5
MEANS = 7  # of a row, before those of filters and of joints
JOINT_MEANS = 5  # of each joint, at the end of a row


@dataclass(eq=False)
class StampJitter:
    """Means of rows by innovations of filters and joints over their noise.

    A row begins with 1; of the filter with the highest bandwidth the squares of the part along the velocities, of the
    rest, and of the rest that independent innovations have; the products of two such parts in a row, and of two
    such rests; the squared speed, in noise per s. Then come the squares of the slow parts of all filters along the
    velocities; and of each joint the share of the rest in independent innovations; in rad or m, the products of
    two rests in a row, the squares of the rest, of the one that independent innovations have, and of the part along
    the velocities.
    """

    now: np.ndarray  # mean of the last 0.2 s, times that of the 1 in it
    block: np.ndarray  # sums over time
    older: np.ndarray  # (blocks, ...), those of the rest of the last second, the newest first
    past: np.ndarray  # the sum of these
    long: np.ndarray  # that of all
    last: tuple[float, np.ndarray]  # part along the velocities, and rest

    @staticmethod
    def start(count: int, n: int) -> "StampJitter":
        """Return the means before the second sample."""
        size = MEANS + count + JOINT_MEANS * n
        now, block, past, long = np.zeros((4, size))
        return StampJitter(now, block, np.zeros((CHOICE_BLOCKS, size)), past, long, (0.0, np.zeros(n)))

    def add(self, step: float, nu: np.ndarray, qd: np.ndarray, noise: NoiseWindows, level: np.ndarray) -> None:
        """Take in innovations after `step` s: nu and qd (n,), and slow levels (B, n)."""
        # Innovations x and velocities v in units of the noise, 0 of joints whose noise is not known. At rest stamps
        # move nothing.
        sigma, weight = noise.sigma, noise.weights
        x, v = nu * weight, qd * weight
        speed = sqrt(v @ v)
        if speed == 0:
            return
        # The part of x along the unit vector u of the velocities, the rest, and the rest of independent innovations.
        u = v / speed
        along = float(u @ x)
        rest = x - along * u
        across = 1 - u * u
        independent = float(across @ (x * x))
        # The row, as the docstring of the class describes it: of all joints, of the filters, then of each joint.
        row, first_of_joints = np.empty(len(self.now)), len(self.now) - JOINT_MEANS * len(nu)
        row[:MEANS] = 1, along**2, rest @ rest, independent, along * self.last[0], rest @ self.last[1], speed**2
        row[MEANS:first_of_joints] = (level @ (u * weight)) ** 2
        joint_rest, last_joint_rest, joint_along = rest * sigma, self.last[1] * sigma, along * u * sigma
        joint_rows = row[first_of_joints:].reshape(JOINT_MEANS, -1)
        joint_rows[0], joint_rows[1], joint_rows[2] = across, joint_rest * last_joint_rest, joint_rest * joint_rest
        joint_rows[3], joint_rows[4] = across * (nu * nu), joint_along * joint_along
        if noise.is_unknown.any():
            joint_rows[:, noise.is_unknown] = 0
        self.last = along, rest
        # Means over 0.2 s, and over the last second in blocks.
        self.now -= expm1(-step / TRUST_TIME) * (row - self.now)
        self.block += step * row
        if self.block[0] > CHOICE_TIME / CHOICE_BLOCKS:
            self.older[1:] = self.older[:-1].copy()
            self.older[0] = self.block
            self.past = self.older.sum(axis=0)
            self.block[:] = 0
        self.long = self.past + self.block

    def noise(self, dt: float, used: np.ndarray) -> np.ndarray:
        """Return deviations of samples by errors of stamps: (2, n), 0 of none.

        In the last 0.2 s and in the last second. They are those of white noise whose density at the bandwidth of the
        filter `used` (n,) is as large.
        """
        n, long = len(used), self.long
        no_noise = np.zeros((2, n))
        watched_time, along, _, independent, product, slow_rest, speed = long[:MEANS].tolist()
        # Samples must resolve vibrations, which look white else, and there must be a second of them.
        if 6 * dt * MAX_VIBRATION > 1 or not watched_time > CHOICE_TIME:
            return no_noise
        # Innovations are along the velocities, now and over the last second.
        if not _is_of_stamps(long) or not _is_of_stamps(self.now):
            return no_noise
        # The part along the velocities is white, and the rest has no slow part: no motion is missed.
        if product > MAX_CORRELATION * along or MIN_SLOW_DOMINANCE**2 * slow_rest > independent:
            return no_noise
        # Errors e of stamps, e^2 = along / speed, are smaller than the spacing of samples.
        if along / speed > (MAX_JITTER_TO_SPACING * dt) ** 2:
            return no_noise
        # Squares of the joints' parts along the velocities, times the density of slow errors over that of white ones.
        colour = (long[MEANS + used] / along).clip(1, MAX_COLOUR)
        squares = np.stack([self.now[-n:] / self.now[0], long[-n:] / watched_time])
        return np.asarray(np.sqrt(colour * squares))

    @property
    def vibrating(self) -> np.ndarray:
        """Joints (n,) whose innovations across the velocities have a slow part.

        In the last second, and beyond what may stay hidden.
        """
        across, slow, rest, independent, _ = self.long[-JOINT_MEANS * len(self.last[1]) :].reshape(JOINT_MEANS, -1)
        hidden = np.minimum(MAX_HIDDEN_SHARE**2 * independent, MAX_HIDDEN_ANGLE**2 * across)
        return np.asarray((slow > MAX_SLOW_SHARE * rest) & (slow > hidden))


def _is_of_stamps(means: np.ndarray) -> bool:
    """Return whether innovations are those of stamps: along velocities, of several joints."""
    _, along, rest, independent = means[:4].tolist()
    return bool(MIN_DOMINANCE**2 * rest < independent and independent > MIN_SHARED * (along + rest))
