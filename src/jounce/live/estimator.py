"""Kalman filters smooth sampled positions at a fixed lag: rates of all joints while the robot moves.

`Robot.live` makes `LiveRates`. Its `update` takes in samples that come one by one: it predicts the filters to the
present, one for each of several bandwidths, corrects them by the sample, chooses a bandwidth for each joint, and reads
the rates at the lag, with deviations.

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
from typing import Any

import numpy as np

from jounce.arguments.rates import convert_coordinates
from jounce.core import errors, scalars
from jounce.core.errors import JounceError, door, quote_value, warn
from jounce.engine.engine import Engine
from jounce.live.forces import SIGNAL_TIME, LiveForces, LiveLinks, estimate_links, linear_variances, linearize_forces
from jounce.live.innovations import CHOICE_TIME, TRUST_TIME, Innovations, NoiseWindows, StampJitter, Trust
from jounce.live.samples import NEW_CLOCK_STAMPS, SampleClock
from jounce.live.settings import RATE_COUNT, check_settings
from jounce.motion import units
from jounce.motion.curves import ROUNDING_OF_Q

SETTLING_ANGLE = 15.0  # rad of a bandwidth, before which a filter is a polynomial through all samples, of any motion
MAX_REPEAT_TIME = 0.05  # s: rows that repeat the last one for longer are those of a robot that rests
REPEAT_DEVIATIONS = 3.0  # by which a joint should have moved, if a row repeats the last one by mistake
KEPT_SHARE = 0.999  # of the spacing of kept states, after which one more is kept: stamps are rounded
TIME_TOLERANCE = 1e-9  # s, of rounded stamps
NO_STEPS = 1e9  # steps per sample that joints pass whose noise is white


@door
class LiveRates:
    """Rates of a robot's joints at a fixed lag behind samples.

    Samples come one by one. `Robot.live` makes one.

    Attributes
    ----------
    t : float
        The time of the rates, s: that of the last sample less the lag.
    rates : tuple of (n,)
        q, qd, q2d, q3d, q4d, as `update` returned them.
    settings : Settings
        What it was made with, checked: `dt`, `lag`, `states`, ...

    Examples
    --------
    >>> import jounce, numpy as np
    >>> robot = jounce.load("planar2r")
    >>> live = robot.live(1e-3, bandwidth=10, noise=1e-5)
    >>> for t in np.arange(0, 1, 1e-3):
    ...     q, qd, q2d, q3d, q4d = live.update([np.sin(t), np.cos(t)], t)
    >>> bool(abs(q[0] - np.sin(t - 0.02)) < 5 * live.deviations[0, 0])
    True
    """

    def __init__(
        self, robot: Engine, dt: Any, bandwidth: Any = None, lag: Any = 0.02, states: Any = 6, noise: Any = None
    ) -> None:
        self.settings = s = check_settings(robot.mechanism, dt, bandwidth, lag, states, noise)
        # A stated noise counts as the rounding of an encoder, with steps of that deviation.
        steps = np.nan_to_num(s.sigma * np.sqrt(12))
        self._robot, self._noise = robot, NoiseWindows(s.sigma.copy(), steps)
        self._clock = SampleClock()
        self._power, self._forces_at = np.zeros(len(s.sigma)), np.nan  # mean square of Q2d, and its last time
        self._forget()
        self._sigmas = self._measure_noises()

    @property
    def _now(self) -> float:
        return self._clock.now

    def _forget(self) -> None:
        """Begin without samples."""
        n, count = len(self.settings.sigma), len(self.settings.omega)
        self._filters: Filters | None = None
        self._innovations, self._jitter = Innovations.start(self.settings), StampJitter.start(count, n)
        self._times = np.empty(0)  # of the kept states
        self._begin = self._sampled = np.nan  # times of the first sample, and of the last one that was not lost
        self._y, self._used = np.full(n, np.nan), np.full(n, count - 1)
        self._forget_rates()

    def _forget_rates(self) -> None:
        n = len(self.settings.sigma)
        self.t, self.rates = np.nan, (np.full(n, np.nan),) * RATE_COUNT
        self._covariance = np.full((n, RATE_COUNT, RATE_COUNT), np.nan)

    @property
    def deviations(self) -> np.ndarray:
        """Standard deviations (5, n) of q to q4d.

        NaN as long as the noise of a joint's samples is not known.
        """
        return np.sqrt(np.diagonal(self._covariance, axis1=1, axis2=2).T)

    @property
    def bandwidths(self) -> np.ndarray:
        """The bandwidth (n,) that each joint's rates are taken from, Hz."""
        return np.asarray(self.settings.omega[self._used] / (2 * np.pi))

    @property
    def trust(self) -> Trust:
        """The trust in the rates of each joint: by innovations of the last 0.2 s."""
        trust = self._innovations.trust(self._sigmas, self._used)
        # A filter that has not settled fits any motion, and a vibration may hide below the noise, but for rounding.
        good = trust.good & self._settled[self._used] & (self._now - self._begin >= 2 * TRUST_TIME)
        return Trust(trust.rms, good & (self._noise.is_rounding | ~self._jitter.vibrating), trust.moving)

    @property
    def _settled(self) -> np.ndarray:
        """Whether each filter (B,) has seen enough samples to contradict it."""
        return self.settings.omega * (self._now - self._begin) >= SETTLING_ANGLE

    def update(self, q: Any, t: float | None = None) -> tuple[np.ndarray, ...]:
        """Take in a sample, and return q to q4d at the lag.

        Parameters
        ----------
        q : (n,)
            Positions, rad or m, or by joint name. NaN: the sample is lost, and rates are predicted.
        t : float, optional
            Time of the sample, s; by default `dt` after the last one. Stamps that differ from even ones are worth a
            factor of 20 and more. Three in a row that are not after the last one, but increase, are those of a new
            clock: a `JounceWarning` says so, and rates begin with the third sample.

        Returns
        -------
        q, qd, q2d, q3d, q4d : (n,)
            NaN at times before the first sample.

        Raises
        ------
        JounceError
            If a shape is wrong, t is not after the last one, or a joint jumps. The sample is left out then.

        Examples
        --------
        >>> import jounce
        >>> live = jounce.load("planar2r").live(1e-3, lag=0, bandwidth=10, noise=1e-5)
        >>> q, qd, q2d, q3d, q4d = live.update([0.1, 0.2])
        >>> q
        array([0.1, 0.2])
        """
        s = self.settings
        y = convert_coordinates(s.mechanism, q, "q", s.mechanism.n)
        if not scalars.is_numeric(y) or y.ndim != 1 or np.isinf(y).any():
            raise JounceError(f"q is {quote_value(q)}; expected ({s.mechanism.n},) numbers, NaN of a lost sample")
        lost, clock = bool(np.isnan(y).any()), self._read_clock(t)
        now, step = clock.now, clock.now - self._now
        # After a long gap nothing is known of the motion: the filters start with this sample.
        if self._filters is not None and now - self._sampled > s.longest_gap:
            self._forget()
        # Filters follow unwrapped positions: the last one plus the change, across the ends of a turn too. The first
        # sample starts them, once it is not lost.
        if self._filters is not None:
            change = np.full(len(y), np.nan) if lost else s.check_jump(y, now, self._y, self._sampled)
            self._step(now, step, self._y + change, lost)
        elif not lost:
            units.warn_of_degrees(y[None], np.zeros((1, len(y))), s.mechanism, "q")
            self._filters = start_filters(y, len(s.omega), s.kept, s.states)
            self._times, self._begin, self._sampled, self._y = np.full(s.kept, now), now, now, y.copy()
        # Only now is the clock kept: a sample that is refused above leaves the state as it was.
        self._clock, self._sigmas = clock, self._measure_noises()
        self._read()
        return self.rates

    def _measure_noises(self) -> np.ndarray:
        """Return the deviations of samples, now and in the last second: (2, n).

        They hold errors of stamps.
        """
        return np.maximum(self._noise.sigma, self._jitter.noise(self.settings.dt, self._used))

    def _read_clock(self, t: object) -> SampleClock:
        """Return the clock with the stamp of a sample, or refuse it."""
        clock = self._clock.read(t, self.settings.dt, self.settings.longest_gap)
        if clock.refused > 0:
            self._clock = clock
            last = f"not after the last sample at {clock.now:.9g} s"
            cure = f"leave the row out; {NEW_CLOCK_STAMPS} such rows in a row whose t increases start a new clock"
            raise JounceError(f"t is {clock.stamp:.9g} s, {last}; {cure}")
        # A new clock begins without samples, as nobody knows the time between.
        if clock.is_new:
            warn(
                f"t = {clock.now:.9g} s is taken for that of a new clock: {NEW_CLOCK_STAMPS} samples in a row are not "
                f"after {self._now:.9g} s and increase; rates begin with this sample, and the ones before are forgotten"
            )
            self._forget()
            self._noise.forget_window()
            self._forces_at = np.nan
        return clock

    def _step(self, now: float, step: float, y: np.ndarray, lost: bool) -> None:
        """Predict to the present, and correct unless the sample is lost."""
        s = self.settings
        assert self._filters is not None
        # Prediction over scaled time w dt of each filter, (B,). The present state is kept for the lag, if it is far
        # enough from the last one that was kept; else it is overwritten.
        spacing = self._times[self._filters.head] - self._times[self._filters.place(1)]
        keep = s.kept > 1 and spacing > KEPT_SHARE * s.spacing
        scaled = s.omega * step
        predict(self._filters, transition(scaled, s.states), process_noise(scaled, s.scaled_dt, s.states), keep)
        self._times[self._filters.head] = now
        # Innovations nu (B, n), and by how much the joints moved, (n,); unwrapped angles that are the same are rounded.
        nu, variance = y - self._filters.present, innovation_variance(self._filters)
        distance = np.abs(y - self._y)
        distance[distance <= ROUNDING_OF_Q * np.abs(y)] = 0
        moves = bool(distance.any())
        # A row that repeats the last one by mistake is lost: the quickest filter says that a joint should have moved.
        if not moves and now - self._sampled < MAX_REPEAT_TIME:
            lost = bool((np.abs(nu[-1]) > REPEAT_DEVIATIONS * self._noise.sigma * np.sqrt(variance[-1])).any())
        if lost:
            return
        if s.finds_noise and moves:
            self._noise.add(now, y)
        # Velocities as predicted, which errors of stamps move the sample along; then the correction.
        elapsed, qd = now - self._sampled, self._filters.x[-1, :, 1, self._filters.head] * s.omega[-1]
        correct(self._filters, nu)
        # Steps of the encoders that joints passed; white noise has none, and counts as many.
        passed = np.full(len(distance), NO_STEPS)
        np.divide(distance, self._noise.steps, out=passed, where=self._noise.steps > 0)
        self._innovations.add(elapsed, nu, variance, passed)
        # A stated noise is that of stamps too; innovations of a start are no noise.
        settled = self._settled
        if s.finds_noise and settled[-1]:
            white = nu[-1] / np.sqrt(variance[-1])
            self._jitter.add(elapsed, white, qd, self._noise, self._innovations.level)
        self._sampled, self._y = now, y
        # The bandwidth of each joint, once there are innovations to compare.
        if now - self._begin >= CHOICE_TIME:
            self._used = self._innovations.choose(settled)

    def _read(self) -> None:
        """Read rates at the lag and their covariances from a kept state."""
        s, t = self.settings, self._now - self.settings.lag
        if self._filters is None or not t >= self._begin - TIME_TOLERANCE:
            self._forget_rates()
            return
        # Taylor's series from that state over scaled time, with the filter of each joint: matrices (n, m, m). Process
        # noise is added in either direction.
        i, joints, used = int(np.abs(self._times - t).argmin()), np.arange(len(self._y)), self._used
        scaled, scale = s.omega[used] * (t - self._times[i]), s.rate_scales[used]
        F, W = transition(scaled, s.states), process_noise(np.abs(scaled), s.scaled_dt[used], s.states)
        x = F @ self._filters.x[used, joints, :, i][..., None]
        P = F @ self._filters.covariance[used, ..., i] @ F.mT + W
        # Of m states the first five are q to q4d; innovations may show that their covariances are too small.
        sigma = self._sigmas.max(axis=0)
        P = self._innovations.inflate(P[:, :RATE_COUNT, :RATE_COUNT], sigma, used)
        # From scaled rates to rates per s, and from variances over r^2 to variances.
        self.t, self.rates = t, tuple((x[:, :RATE_COUNT, 0] * scale).T)
        size = sigma[:, None] * scale
        self._covariance = P * (size[:, :, None] * size[:, None])

    def forces(self, keep_uncertain: bool = False) -> LiveForces:
        """Return Q, Qd, Q2d at the last rates, with deviations.

        Native code is compiled at the first call, which may be before the first sample.

        Parameters
        ----------
        keep_uncertain : bool, optional
            Whether to keep a Q2d that is not certain, instead of NaN: one that is smaller than its deviation, or
            whose rms over the last second, without noise, is.

        Returns
        -------
        LiveForces
            Q, Qd, Q2d, deviations, certain; NaN where rates are.

        Examples
        --------
        >>> import jounce
        >>> live = jounce.load("planar2r").live(1e-3, lag=0, bandwidth=10, noise=1e-5)
        >>> _ = live.update([0.1, 0.2])
        >>> live.forces().Q2d
        array([nan, nan])
        """
        errors.check_bool("keep_uncertain", keep_uncertain, "whether to keep a Q2d that is not certain")
        forces, partials = linearize_forces(self._robot, self.rates)
        variances = linear_variances(partials, self._covariance)
        # The mean square of Q2d over the last second, an exponential mean at uneven times.
        if np.isfinite(variances[2]).all():
            share = 1.0 if np.isnan(self._forces_at) else -np.expm1((self._forces_at - self._now) / SIGNAL_TIME)
            self._power = self._power + share * (forces[2] ** 2 - self._power)
            self._forces_at = self._now
        # Q2d is certain by its size, and by its rms too: noise alone exceeds its deviation one time in three.
        certain = variances[2] < np.minimum(forces[2] ** 2, self._power / 2)
        Q2d = forces[2] if keep_uncertain else np.where(certain, forces[2], np.nan)
        Q, Qd, Q2d_deviation = np.sqrt(variances)
        return LiveForces(forces[0], forces[1], Q2d, (Q, Qd, Q2d_deviation), certain)

    def links(self) -> LiveLinks:
        """Return the motion of links on elastic joints, from their motors.

        To first order in 1/K at `t`: ``q = theta - Q / K``, and so qd and q2d, with Q, Qd, Q2d at the rates of theta.
        It is valid for motions well below the first resonance. A swing of the links at it with motors held still is in
        neither deviations nor error.

        Returns
        -------
        LiveLinks
            q, qd, q2d, deviations, error; NaN where rates are.

        Raises
        ------
        JounceError
            If joints are rigid, a spring is not linear or has a damper or two motors, or rotors are coupled.

        Examples
        --------
        >>> import jounce
        >>> live = jounce.load("planar2r").elastic(900, rotor=0.1).live(1e-3, lag=0, bandwidth=10, noise=1e-5)
        >>> _ = live.update([0.1, 0.2])
        >>> live.links().q.round(4)
        array([0.0679, 0.1896])
        """
        return estimate_links(self._robot, self.rates, self._covariance, float(self.settings.omega[self._used].max()))


START_VARIANCE = 1e8  # of scaled rates, over r^2: nothing is known of them at the first sample


@dataclass(eq=False)
class Filters:
    """States of B filters at K ticks: a ring whose newest is at `head`.

    Each filter has m states; rates and variances are scaled. `covariance` is that of the errors of a state, `cross`
    that of the present state's errors with those of a kept one. `predict` and `correct` run once per sample, for all
    filters and joints at once.
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
        """Return the place of the state kept `age` states ago."""
        return (self.head + age) % self.x.shape[-1]


def start_filters(y: np.ndarray, count: int, kept: int, states: int) -> Filters:
    """Start filters at the first sample y (n,): nothing is known of rates."""
    x = np.zeros((count, len(y), states, kept))
    x[:, :, 0] = y[:, None]
    P = np.zeros((count, states, states, kept))
    P[:] = np.diag([1.0] + [START_VARIANCE] * (states - 1))[..., None]
    return Filters(x, P, P.copy())


@cache
def _taylor_series(states: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the powers of the step in a transition, and their factors: (m, m).

    Entry (i, j) is h^(j - i) / (j - i)!, and zero below the diagonal.
    """
    power = np.arange(states) - np.arange(states)[:, None]
    factors = [1 / factorial(k) if k >= 0 else 0.0 for k in power.ravel()]
    return power.clip(0), np.array(factors).reshape(power.shape)


@cache
def _noise_series(states: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the powers of the step in process noise, and their factors: (m, m).

    Where i and j are the integrals, beyond the first, from the noise to two states, an entry is h^(i + j + 1) /
    (i! j! (i + j + 1)) times its density.
    """
    i, j = states - 1 - np.indices((states, states))
    factorials = np.array([factorial(k) for k in range(states)], dtype=float)
    return i + j + 1, 1 / (factorials[i] * factorials[j] * (i + j + 1))


def _powers(steps: np.ndarray, count: int) -> np.ndarray:
    """Return the powers (B, count) of steps (B,) from the 0th on."""
    powers = np.empty((len(steps), count))
    powers[:, 0] = 1
    powers[:, 1:] = steps[:, None]
    return np.asarray(np.multiply.accumulate(powers, axis=1))


def transition(steps: np.ndarray, states: int) -> np.ndarray:
    """Return Taylor's series over scaled steps (B,), as matrices (B, m, m)."""
    power, factors = _taylor_series(states)
    return np.asarray(_powers(steps, states)[:, power] * factors)


def process_noise(steps: np.ndarray, h: np.ndarray, states: int) -> np.ndarray:
    """Return what the white noise of q^(m) adds to covariances: (B, m, m).

    Over scaled steps (B,), with samples at the scaled spacings h (B,).
    """
    power, factors = _noise_series(states)
    return np.asarray(_powers(steps, 2 * states)[:, power] * (h[:, None, None] * factors))


def predict(filters: Filters, F: np.ndarray, W: np.ndarray, keep: bool) -> None:
    """Predict to the next tick by transitions F.

    F and the process noise W are (B, m, m). To `keep` the present state drops the oldest one.
    """
    x, P, cross, last = filters.x, filters.covariance, filters.cross, filters.head
    head = filters.head = filters.place(-1) if keep else last
    # P = F P F^T + W, summed term by term, as generated code does: P of a start is 1e8 times that of a sample, and the
    # order of the sum matters.
    newest = (F[..., None] * P[:, None, ..., last]).sum(axis=2)
    newest = (newest[:, :, None] * F[:, None]).sum(axis=3) + W
    newest = (newest + newest.mT) / 2
    # Kept states do not change; their covariances with the present one move by F alone: (B, m, m, K).
    cross[:] = (F @ cross.reshape(*cross.shape[:2], -1)).reshape(cross.shape)
    cross[..., head] = P[..., head] = newest
    x[..., head] = x[..., last] @ F.mT


def correct(filters: Filters, innovations: np.ndarray) -> None:
    """Take a sample in by its innovations (B, n): present and kept states alike."""
    # Gains (B, m, K): covariances of each state with the innovation, which is that with the present position, over the
    # variance of the innovation.
    shared = filters.cross[:, 0]
    gains = shared / innovation_variance(filters)[:, None, None]
    filters.x += innovations[:, :, None, None] * gains[:, None]
    filters.covariance -= shared[:, :, None] * gains[:, None]
    filters.cross -= gains[:, :, None, None, filters.head] * shared[:, None]


def innovation_variance(filters: Filters) -> np.ndarray:
    """Return variances (B,) of the innovations, over r^2, before a correction."""
    return np.asarray(1 + filters.covariance[:, 0, 0, filters.head])
