"""`Robot.live`: rates of all joints from samples that come one by one, at a fixed lag, with deviations."""

from typing import Any

import numpy as np

from jounce.arguments.rates import convert_coordinates
from jounce.core import errors, scalars
from jounce.core.errors import JounceError, quote_value, warn
from jounce.engine.engine import Engine
from jounce.live.filter import Filters, correct, innovation_variance, predict, process_noise, start_filters, transition
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


class LiveRates:
    """Rates of a robot's joints at a fixed lag behind samples that come one by one. `Robot.live` makes one.

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
        steps = np.nan_to_num(s.sigma * np.sqrt(12))  # of encoders whose rounding is the stated noise
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
        """Standard deviations (5, n) of q to q4d; NaN as long as the noise of a joint's samples is not known."""
        return np.sqrt(np.diagonal(self._covariance, axis1=1, axis2=2).T)

    @property
    def bandwidths(self) -> np.ndarray:
        """The bandwidth (n,) that each joint's rates are taken from, Hz."""
        return np.asarray(self.settings.omega[self._used] / (2 * np.pi))

    @property
    def trust(self) -> Trust:
        """Whether the rates of each joint are to be trusted, by the innovations of the last 0.2 s."""
        found = self._innovations.trust(self._sigmas, self._used)
        good = found.good & self._settled[self._used] & (self._now - self._begin >= 2 * TRUST_TIME)
        return Trust(found.rms, good & (self._noise.is_rounding | ~self._jitter.vibrating), found.moving)

    @property
    def _settled(self) -> np.ndarray:
        return self.settings.omega * (self._now - self._begin) >= SETTLING_ANGLE

    def update(self, q: Any, t: float | None = None) -> tuple[np.ndarray, ...]:
        """Take in a sample, and return q, qd, q2d, q3d, q4d at the lag before its time.

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
        if self._filters is not None and now - self._sampled > s.longest_gap:
            self._forget()
        if self._filters is not None:
            moved = np.full(len(y), np.nan) if lost else s.check_jump(y, now, self._y, self._sampled)
            self._step(now, step, self._y + moved, lost)
        elif not lost:
            units.warn_of_degrees(y[None], np.zeros((1, len(y))), s.mechanism, "q")
            self._filters = start_filters(y, len(s.omega), s.kept, s.states)
            self._times, self._begin, self._sampled, self._y = np.full(s.kept, now), now, now, y.copy()
        self._clock, self._sigmas = clock, self._measure_noises()
        self._read()
        return self.rates

    def _measure_noises(self) -> np.ndarray:
        """The deviations (2, n) of samples, with errors of stamps, now and in the last second."""
        return np.maximum(self._noise.sigma, self._jitter.noise(self.settings.dt, self._used))

    def _read_clock(self, t: object) -> SampleClock:
        """The clock with the stamp of a sample; a new one begins without samples, as nobody knows the time between."""
        found = self._clock.read(t, self.settings.dt, self.settings.longest_gap)
        if found.refused:
            self._clock = found
            last = f"not after the last sample at {found.now:.9g} s"
            cure = f"leave the row out; {NEW_CLOCK_STAMPS} such rows in a row whose t increases start a new clock"
            raise JounceError(f"t is {found.stamp:.9g} s, {last}; {cure}")
        if found.is_new:
            warn(
                f"t = {found.now:.9g} s is taken for that of a new clock: {NEW_CLOCK_STAMPS} samples in a row are not "
                f"after {self._now:.9g} s and increase; rates begin with this sample, and the ones before are forgotten"
            )
            self._forget()
            self._noise.forget_window()
            self._forces_at = np.nan
        return found

    def _step(self, now: float, step: float, y: np.ndarray, lost: bool) -> None:
        """Predict to the present, and correct by a sample that is not lost."""
        s = self.settings
        assert self._filters is not None
        apart = self._times[self._filters.head] - self._times[self._filters.place(1)]
        keep = s.kept > 1 and apart > KEPT_SHARE * s.spacing
        scaled = s.omega * step
        predict(self._filters, transition(scaled, s.states), process_noise(scaled, s.scaled_dt, s.states), keep)
        self._times[self._filters.head] = now
        nu, variance, moved = y - self._filters.present, innovation_variance(self._filters), np.abs(y - self._y)
        moved[moved <= ROUNDING_OF_Q * np.abs(y)] = 0  # an unwrapped angle that is the same is rounded
        moves = bool(moved.any())
        if not moves and now - self._sampled < MAX_REPEAT_TIME:
            lost = bool((np.abs(nu[-1]) > REPEAT_DEVIATIONS * self._noise.sigma * np.sqrt(variance[-1])).any())
        if lost:
            return
        if s.finds_noise and moves:
            self._noise.add(now, y)
        elapsed, qd = now - self._sampled, self._filters.x[-1, :, 1, self._filters.head] * s.omega[-1]
        correct(self._filters, nu)
        passed = np.full(len(moved), NO_STEPS)
        np.divide(moved, self._noise.steps, out=passed, where=self._noise.steps > 0)
        self._innovations.add(elapsed, nu, variance, passed)
        settled = self._settled
        if s.finds_noise and settled[-1]:  # a noise that is stated is that of stamps, too
            white = nu[-1] / np.sqrt(variance[-1])
            self._jitter.add(elapsed, white, qd, self._noise, self._innovations.level)
        self._sampled, self._y = now, y
        if now - self._begin >= CHOICE_TIME:
            self._used = self._innovations.choose(settled)

    def _read(self) -> None:
        """The rates at the lag, by Taylor's series from the nearest of the kept states, and their covariances."""
        s, t = self.settings, self._now - self.settings.lag
        if self._filters is None or not t >= self._begin - TIME_TOLERANCE:
            self._forget_rates()
            return
        i, joints, used = int(np.abs(self._times - t).argmin()), np.arange(len(self._y)), self._used
        scaled, scale = s.omega[used] * (t - self._times[i]), s.rate_scales[used]
        F, W = transition(scaled, s.states), process_noise(np.abs(scaled), s.scaled_dt[used], s.states)
        x = F @ self._filters.x[used, joints, :, i][..., None]
        P = F @ self._filters.covariance[used, ..., i] @ F.mT + W
        sigma = self._sigmas.max(axis=0)
        P = self._innovations.inflate(P[:, :RATE_COUNT, :RATE_COUNT], sigma, used)
        self.t, self.rates = t, tuple((x[:, :RATE_COUNT, 0] * scale).T)
        size = sigma[:, None] * scale
        self._covariance = P * (size[:, :, None] * size[:, None])

    def forces(self, keep_uncertain: bool = False) -> LiveForces:
        """Q, Qd, Q2d at the time of the last rates, with standard deviations.

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
        if np.isfinite(variances[2]).all():
            share = 1.0 if np.isnan(self._forces_at) else -np.expm1((self._forces_at - self._now) / SIGNAL_TIME)
            self._power = self._power + share * (forces[2] ** 2 - self._power)
            self._forces_at = self._now
        # By its rms too, of which such noise is a part: noise alone exceeds its deviation one time in three.
        certain = variances[2] < np.minimum(forces[2] ** 2, self._power / 2)
        Q2d = forces[2] if keep_uncertain else np.where(certain, forces[2], np.nan)
        Q, Qd, Q2d_deviation = np.sqrt(variances)
        return LiveForces(forces[0], forces[1], Q2d, (Q, Qd, Q2d_deviation), certain)

    def links(self) -> LiveLinks:
        """The motion of the links on elastic joints at `t`, from samples of their motors, to first order in 1/K.

        ``q = theta - Q / K``, and so qd and q2d, with Q, Qd, Q2d at the rates of theta: valid for motions well below
        the first resonance. A swing of the links at it with motors held still is in neither deviations nor error.

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
