"""What errors of time stamps add to the noise of samples, from the innovations of all joints together.

Problem: a stamp that is off by e moves the sample of joint i by ``qd[i] e``: of all joints at once, along their
velocities. Where these are 1 rad/s, 0.3 ms are 3e-4 rad, fifty times the step of an encoder of 20 bits.

Algorithm: the innovations of all joints in a row, in units of their noise, are a vector; its part along the velocities
is what stamps move, the rest is what they do not touch. Noise of single joints, a vibration and a motion that is too
fast have both parts: of independent innovations x, along the unit vector u, the rest is on average
``sum((1 - u^2) x^2)``. Errors of stamps are claimed only where the rest is a small share of that, over the last second
and the last 0.2 s, and where the part along the velocities is white: a motion that all joints share, as that along a
straight line, has no rest, but is slow. Where a single joint moves, its own noise looks the same, and none are claimed.

Errors of stamps are seldom white: the density of their slow part, over that of white noise, is `colour`, by a low-pass
at the highest bandwidth.

A vibration above all bandwidths hides below such a noise, and below an estimate that still holds errors of stamps of a
faster part. The rest shows it, claimed or not: it is white of noise of joints and of errors of stamps, and its products
from row to row are a large share of its squares where a joint vibrates. Such a joint is not trusted. What is smaller
than both bounds below is left: every arm has some. Rounding to steps is slow at times, and is no vibration.

Invariants: without a claim no noise is added; no claim makes a joint trusted that vibrates; a single joint that moves
has no rest, so nothing is claimed and no vibration is seen.
"""

from dataclasses import dataclass
from math import expm1, sqrt

import numpy as np

from jounce.live.innovations import CHOICE_BLOCKS, CHOICE_TIME, TRUST_TIME
from jounce.live.sample_noise import NoiseWindows

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
    """Means of rows, by innovations of B filters and n joints in units of their noise.

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
        """That before the second sample."""
        size = MEANS + count + JOINT_MEANS * n
        now, block, past, long = np.zeros((4, size))
        return StampJitter(now, block, np.zeros((CHOICE_BLOCKS, size)), past, long, (0.0, np.zeros(n)))

    def add(self, step: float, nu: np.ndarray, qd: np.ndarray, noise: NoiseWindows, level: np.ndarray) -> None:
        """Take in innovations nu (n,), qd and noise after `step` s, and levels (B, n) of slow innovations."""
        sigma, weight = noise.sigma, noise.weights
        x, v = nu * weight, qd * weight
        speed = sqrt(v @ v)
        if not speed:
            return
        u = v / speed
        along = float(u @ x)
        rest = x - along * u
        across = 1 - u * u
        independent = float(across @ (x * x))
        row, of_all = np.empty(len(self.now)), len(self.now) - JOINT_MEANS * len(nu)
        row[:MEANS] = 1, along**2, rest @ rest, independent, along * self.last[0], rest @ self.last[1], speed**2
        row[MEANS:of_all] = (level @ (u * weight)) ** 2
        own, before, moved = rest * sigma, self.last[1] * sigma, along * u * sigma
        of_joints = row[of_all:].reshape(JOINT_MEANS, -1)
        of_joints[0], of_joints[1], of_joints[2] = across, own * before, own * own
        of_joints[3], of_joints[4] = across * (nu * nu), moved * moved
        if noise.is_unknown.any():
            of_joints[:, noise.is_unknown] = 0
        self.last = along, rest
        self.now -= expm1(-step / TRUST_TIME) * (row - self.now)
        self.block += step * row
        if self.block[0] > CHOICE_TIME / CHOICE_BLOCKS:
            self.older[1:] = self.older[:-1].copy()
            self.older[0] = self.block
            self.past = self.older.sum(axis=0)
            self.block[:] = 0
        self.long = self.past + self.block

    def noise(self, dt: float, used: np.ndarray) -> np.ndarray:
        """Deviations (2, n) of samples by errors of stamps in the last 0.2 s and the last second; 0 of none.

        They are those of white noise whose density at the bandwidth of the filter `used` (n,) is as large.
        """
        n, long = len(used), self.long
        none = np.zeros((2, n))
        watched, along, _, independent, product, slow_rest, speed = long[:MEANS].tolist()
        if 6 * dt * MAX_VIBRATION > 1 or not watched > CHOICE_TIME:
            return none
        if not _is_of_stamps(long) or not _is_of_stamps(self.now):
            return none
        if product > MAX_CORRELATION * along or MIN_SLOW_DOMINANCE**2 * slow_rest > independent:
            return none
        if along / speed > (MAX_JITTER_TO_SPACING * dt) ** 2:
            return none
        colour = (long[MEANS + used] / along).clip(1, MAX_COLOUR)
        squares = np.stack([self.now[-n:] / self.now[0], long[-n:] / watched])
        return np.asarray(np.sqrt(colour * squares))

    @property
    def vibrating(self) -> np.ndarray:
        """Joints (n,) whose innovations across the velocities have had a slow part in the last second."""
        across, slow, rest, independent, _ = self.long[-JOINT_MEANS * len(self.last[1]) :].reshape(JOINT_MEANS, -1)
        hidden = np.minimum(MAX_HIDDEN_SHARE**2 * independent, MAX_HIDDEN_ANGLE**2 * across)
        return np.asarray((slow > MAX_SLOW_SHARE * rest) & (slow > hidden))


def _is_of_stamps(means: np.ndarray) -> bool:
    """Whether innovations are along the velocities, and of more than one joint."""
    _, along, rest, independent = means[:4].tolist()
    return bool(MIN_DOMINANCE**2 * rest < independent and independent > MIN_SHARED * (along + rest))
