"""Motions: the coordinates of a robot as functions of time, and what its bodies exert meanwhile."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from jounce._scalars import asarray, is_finite
from jounce.arguments.rates import checked_order
from jounce.errors import JounceError, listed, one_of, quoted
from jounce.motion.composed import Chain, Retimed
from jounce.motion.curves import HIGHEST, Curve, Polynomials
from jounce.spatial.series import rate_name

STEP = 1e-3  # s, between the times of a motion that comes without any
MOST = 10_000_000  # of such times; a slip of the pen asks for more
SIDES = ("right", "left")
MOST_CONTINUOUS = 6  # the order of the last derivative that blends make continuous
MEET = 1e-6  # rad or m: motions further apart do not follow each other


class Break(NamedTuple):
    """A jump of a derivative of a coordinate: time, joint, order (0 is q, 3 is q3d) and size."""

    t: float
    joint: str | int
    order: int
    jump: float


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of a robot as a function of time: ``motion(t, order)`` gives q, qd, ... at any times.

    `jounce.load_motion` makes one of a file or of named columns, and so do `Motion.through`, `Motion.fit`,
    `Motion.polynomial`, `Motion.fourier`, `Motion.piecewise`, `Motion.trapezoidal`, `Motion.from_ruckig`,
    `Motion.from_toppra` and `Motion.from_joint_trajectory`.

    Attributes
    ----------
    curve : Curve
        The function of time: piecewise polynomials, splines, analytic terms, or compositions of curves.
    joint_names : tuple of str, or None
        The names of the coordinates, in the order of the last axis; None if they are in the robot's order.
    source : str
        A description of the origin of the motion.
    samples : tuple of arrays, or None
        The times (N,) and coordinates (N, n) that a spline was made of.
    residual : (n,), or None
        Largest distance of q from the samples of a fit, or from the motion that was blended, rad or m.
    torques : tuple of arrays, or None
        Times (N,) and the torques (N, n) measured then, N m or N; NaN where a joint has none.
    notes : tuple of str
        What else its table contains, one note each.

    Examples
    --------
    >>> import jounce
    >>> motion = jounce.load_motion("paper", jounce.load("iiwa14"))
    >>> q, qd, q2d, q3d, q4d = motion([0.5, 1.0, 1.5])
    >>> q4d.shape, motion.duration, motion.breaks
    ((3, 7), 5.0, ())
    """

    curve: Curve
    joint_names: tuple[str, ...] | None
    source: str
    loads: Mapping[str, Curve] = field(default_factory=dict)
    samples: tuple[np.ndarray, np.ndarray] | None = None
    residual: np.ndarray | None = None
    grid: np.ndarray | None = None
    torques: tuple[np.ndarray, np.ndarray] | None = None
    notes: tuple[str, ...] = ()

    @staticmethod
    def through(t: Any, q: Any, degree: int = 7, *, joint_names: Any = None) -> "Motion":
        """The spline through samples q (N, n) without noise at times t (N,), of degree 7 (C^6) or 5 (C^4)."""
        from jounce.motion import constructors
        from jounce.motion.spline import Spline

        return constructors.through(t, q, Spline(degree), joint_names)

    @staticmethod
    def fit(
        t: Any,
        q: Any,
        *,
        bandwidth: float | None = None,
        force: bool = False,
        degree: int | None = None,
        intervals: int | None = None,
        joint_names: Any = None,
    ) -> "Motion":
        """Smooth measured samples q (N, n) at t (N,) according to their noise, with standard deviations of all rates.

        The fit has a bandwidth in Hz, by default as far as the motion exceeds the noise. If noise dominates q4d,
        `JounceError` is raised unless `force` is set. With `intervals`, a spline of a degree, 7 by default, is fitted
        by least squares instead, over this number of intervals with equally many samples.
        """
        from jounce.motion import constructors
        from jounce.motion.spline import way_of

        return constructors.through(t, q, way_of(degree, intervals, bandwidth, force), joint_names)

    @staticmethod
    def polynomial(coefficients: Any, duration: float, *, start: float = 0.0, joint_names: Any = None) -> "Motion":
        """Polynomials in t - start with coefficients (n, degree + 1), the lowest power first, over a duration in s."""
        from jounce.motion import constructors

        return constructors.polynomial(coefficients, duration, start, joint_names)

    @staticmethod
    def fourier(
        offset: Any,
        cosines: Any,
        sines: Any,
        frequency: float,
        duration: float,
        *,
        start: float = 0.0,
        joint_names: Any = None,
    ) -> "Motion":
        """The Fourier series offset + sum_k cosines[k - 1] cos(k frequency t) + sines[k - 1] sin(k frequency t).

        The offset is (n,), cosines and sines are (harmonics, n); the frequency of the first harmonic in rad/s.
        """
        from jounce.motion import constructors

        return constructors.fourier(offset, cosines, sines, frequency, duration, start, joint_names)

    @staticmethod
    def piecewise(breaks: Any, coefficients: Any, *, joint_names: Any = None) -> "Motion":
        """Piecewise polynomials, as `scipy.interpolate.PPoly`: breaks (m + 1,), coefficients (degree + 1, m, n).

        Between breaks[i] and breaks[i + 1] they are those of powers of t - breaks[i], the highest power first.
        """
        from jounce.motion import constructors

        return constructors.piecewise(breaks, coefficients, joint_names)

    @staticmethod
    def trapezoidal(positions: Any, velocity: Any, acceleration: Any, *, joint_names: Any = None) -> "Motion":
        """From rest to rest between positions (m, n) with trapezoidal velocities, all joints in step.

        The limits of velocity and acceleration are numbers, or (n,) one for each joint; the slowest joint decides.
        """
        from jounce.motion import planners

        return planners.trapezoidal(positions, velocity, acceleration, joint_names)

    @staticmethod
    def from_ruckig(trajectory: Any, *, joint_names: Any = None) -> "Motion":
        """The motion of a `ruckig.Trajectory`: exact pieces of constant jerk, whose ends are breaks."""
        from jounce.motion import planners

        return planners.from_ruckig(trajectory, joint_names)

    @staticmethod
    def from_toppra(path: Any, *, joint_names: Any = None) -> "Motion":
        """The motion that toppra's ``compute_trajectory()`` returns, of either parametrizer, as exact polynomials."""
        from jounce.motion import planners

        return planners.from_toppra(path, joint_names)

    @staticmethod
    def from_joint_trajectory(message: Any) -> "Motion":
        """The motion of a ROS JointTrajectory, or of a plan of MoveIt that holds one: a message or the dict of it.

        Between points it is linear, cubic or quintic, as both of them state positions, velocities too, or accelerations
        too. Joints are matched by name when it is used with a robot.
        """
        from jounce.motion import ros

        return ros.from_joint_trajectory(message)

    @property
    def start(self) -> float:
        """The time at which it begins, s."""
        return self.curve.start

    @property
    def stop(self) -> float:
        """The time at which it ends, s."""
        return self.curve.stop

    @property
    def duration(self) -> float:
        """The duration, s."""
        return self.stop - self.start

    @cached_property
    def times(self) -> np.ndarray:
        """Default times (N,) of evaluation: those of its samples or its file, or a grid of about a millisecond."""
        if self.grid is not None:
            return self.grid
        return self._grid(STEP)

    @cached_property
    def breaks(self) -> tuple[Break, ...]:
        """Where a derivative up to q4d jumps, in the order of time; of each joint the lowest one that does."""
        return self.breaks_to(HIGHEST)

    def breaks_to(self, order: int) -> tuple[Break, ...]:
        """Where a derivative up to an order jumps, in the order of time; of each joint the lowest one that does."""
        known, order = self.curve.highest, checked_order(order)
        jumps = self.curve.jumps(order if known is None else min(order, known))
        names: Sequence[str | int] = self.joint_names or range(self.curve.columns)
        return tuple(Break(jump.t, names[jump.column], jump.order, jump.size) for jump in jumps)

    def __call__(self, t: object, order: int = 4, side: Literal["right", "left"] = "right") -> tuple[np.ndarray, ...]:
        """The coordinates and their rates at times.

        Parameters
        ----------
        t : (...)
            Times from `start` to `stop`, s.
        order : int, optional
            The highest rate: 4 gives q, qd, q2d, q3d, q4d.
        side : {"right", "left"}, optional
            Whether to return the rates after a break or those before it, at the time of a break.

        Returns
        -------
        tuple of (..., n)
            q, qd, ...: rad or m, per s, per s^2, ...; a tuple for order 0 too.

        Raises
        ------
        JounceError
            If a time is outside of the motion, or the rates are not known to this order.
        """
        times, order = self.checked(t), checked_order(order)
        self._check_known(self.curve, order, "q", self.source)
        found = self.curve.rates(times.ravel(), order, one_of("side", side, SIDES) == "left")
        self._check_finite(found, times, "q", lambda j: f"joint {self._name(j)}")
        return tuple(rate.reshape(*times.shape, self.curve.columns) for rate in found)

    def wrench(
        self, t: object, order: int = 2, side: Literal["right", "left"] = "right"
    ) -> tuple[dict[str, np.ndarray], ...] | None:
        """The wrenches that bodies and merged links exert, with rates: {name: (..., 6)}, (moment; force), in N m and N.

        It has the form of `wrench=` of `Robot.inverse_dynamics`; None for a motion without wrenches.
        """
        times, order = self.checked(t), checked_order(order)
        left = one_of("side", side, SIDES) == "left"
        if not self.loads:
            return None
        found: list[dict[str, np.ndarray]] = [{} for _ in range(order + 1)]
        for body, curve in self.loads.items():
            self._check_known(curve, order, "W", f"the wrench of {quoted(body)}")
            rates = curve.rates(times.ravel(), order, left)
            self._check_finite(rates, times, "W", lambda j, body=body: f"the wrench of {quoted(body)}")
            for by_body, rate in zip(found, rates, strict=True):
                by_body[body] = rate.reshape(*times.shape, 6)
        return tuple(found)

    def deviations(self, t: object, order: int = 4) -> tuple[np.ndarray, ...] | None:
        """Standard deviations (..., n) of the coordinates and their rates at times; None where these are exact."""
        times, order = self.checked(t), checked_order(order)
        self._check_known(self.curve, order, "q", self.source)
        found = self.curve.deviations(times.ravel(), order)
        shape = *times.shape, self.curve.columns
        return None if found is None else tuple(rate.reshape(shape) for rate in found)

    def scaled(self, factor: float) -> "Motion":
        """The same path, `factor` times as long, from the same start: k-th rates are 1 / factor^k of these."""
        if not is_finite(factor) or not factor > 0:
            raise JounceError(f"factor is {quoted(factor)}; expected a finite number > 0, 2 for half the speed")
        number = float(factor)
        return self._retimed(number, self.start * (1 - number), f"{self.source}, {number:g} times as long")

    def shifted(self, seconds: float) -> "Motion":
        """The same motion, later by some seconds."""
        if not is_finite(seconds):
            raise JounceError(f"seconds is {quoted(seconds)}; expected a finite number")
        return self._retimed(1.0, float(seconds), self.source)

    def with_step(self, step: float) -> "Motion":
        """The same motion, with other `times`: from start to end in even steps of at most `step` seconds."""
        if not is_finite(step) or not step > 0:
            raise JounceError(f"step is {quoted(step)}; expected a number of seconds > 0")
        if self.duration / step > MOST:
            raise JounceError(
                f"a step of {step:g} s makes more than {MOST} times in {self.duration:g} s; expected a longer one"
            )
        return replace(self, grid=self._grid(float(step)))

    def blended(self, time: float, continuity: int = 4) -> "Motion":
        """Replace the breaks of the motion by polynomials, so that derivatives up to an order are continuous.

        Each break of a joint is replaced from half the time before to half the time after it; `residual` is the largest
        distance from the original motion.

        Parameters
        ----------
        time : float
            How long each blend lasts, s: no longer than any gap between two breaks of a joint.
        continuity : int, optional
            The order of the last derivative that is continuous: 4, with which Q2d has no jump, or 6.
        """
        from jounce.motion.blend import blended

        if not is_finite(time) or not time > 0:
            raise JounceError(f"time is {quoted(time)}; expected a number of seconds > 0")
        if isinstance(continuity, bool) or not isinstance(continuity, int) or not 2 <= continuity <= MOST_CONTINUOUS:
            raise JounceError(
                f"continuity is {quoted(continuity)}; expected 2 to {MOST_CONTINUOUS}, 4 for a smooth Q2d"
            )
        names = [f"joint {self._name(j)}" for j in range(self.curve.columns)]
        known = self.curve.highest
        order = continuity if known is None else min(continuity, known)
        curve, distance = blended(self.curve, float(time), order, names)
        source = f"{self.source}, blended over {float(time):g} s (C^{continuity})"
        return replace(self, curve=curve, source=source, residual=distance)

    def __add__(self, other: object) -> "Motion":
        """Append another motion, shifted to the end of this one; positions must agree, jumps of rates become breaks."""
        if not isinstance(other, Motion):
            return NotImplemented
        if self.joint_names != other.joint_names or self.curve.columns != other.curve.columns:
            raise JounceError(f"motions of other joints: {self._names()} and {other._names()}; expected the same")
        later = other.shifted(self.stop - other.start)
        [end], [begin] = self(self.stop, 0, "left"), later(later.start, 0)
        apart = np.abs(end - begin)
        if apart.max() > MEET:
            j = int(apart.argmax())
            came = f"joint {self._name(j)} ends at {end[j]:g} and goes on from {begin[j]:g}"
            raise JounceError(f"the motions do not meet: {came}; expected one to begin where the other ends")
        loads = {
            body: Chain(tuple(part.loads.get(body) or _zero(part) for part in (self, later)))
            for body in {**self.loads, **later.loads}
        }
        grid = None
        if self.grid is not None and later.grid is not None:
            grid = np.concatenate([self.grid, later.grid[later.grid > self.grid[-1]]])
        source = self.source if self.source == other.source else f"{self.source}; then {other.source}"
        return Motion(Chain((self.curve, later.curve)), self.joint_names, source, loads, grid=grid)

    def checked(self, t: object) -> np.ndarray:
        """Times that a caller gives, within the motion."""
        times = np.asarray(asarray(t, "t"))
        if times.dtype.kind != "f" or np.asarray(t).dtype.kind == "b":
            raise JounceError(f"t is {quoted(t)}; expected times in s")
        slack = 1e-12 * max(abs(self.start), abs(self.stop))
        outside = ~((times >= self.start - slack) & (times <= self.stop + slack))
        if outside.any():
            came = f"t = {times[outside].flat[0]:.17g} s is outside of the motion"
            raise JounceError(f"{came}; expected times from {self.start:.17g} to {self.stop:.17g} s")
        return times.clip(self.start, self.stop)

    def _grid(self, step: float) -> np.ndarray:
        count = min(max(int(np.ceil(self.duration / step * (1 - 1e-12))), 1), MOST)
        return np.linspace(self.start, self.stop, count + 1)

    def _retimed(self, factor: float, offset: float, source: str) -> "Motion":
        def moved(t: np.ndarray) -> np.ndarray:
            return t * factor + offset

        return replace(
            self,
            curve=Retimed(self.curve, factor, offset),
            loads={body: Retimed(curve, factor, offset) for body, curve in self.loads.items()},
            source=source,
            samples=self.samples and (moved(self.samples[0]), self.samples[1]),
            grid=None if self.grid is None else moved(self.grid),
            torques=self.torques and (moved(self.torques[0]), self.torques[1]),
        )

    def _check_known(self, curve: Curve, order: int, symbol: str, source: str) -> None:
        if curve.highest is not None and order > curve.highest:
            last = rate_name(symbol, curve.highest)
            raise JounceError(
                f"{rate_name(symbol, order)} is not known along this motion ({source}); it ends at {last}"
            )

    def _check_finite(self, rates: Sequence[np.ndarray], times: np.ndarray, symbol: str, of: Any) -> None:
        for k, rate in enumerate(rates):
            if not np.isfinite(rate).all():
                i, j = np.argwhere(~np.isfinite(rate))[0]
                came = f"{rate_name(symbol, k)} of {of(j)} overflows at t = {times.flat[i]:g} s"
                raise JounceError(f"{came}; expected a finite time derivative of order {k}")

    def _name(self, j: int) -> str:
        return quoted(self.joint_names[j]) if self.joint_names else str(j)

    def _names(self) -> str:
        return listed(self.joint_names) if self.joint_names else f"{self.curve.columns} without names"


def _zero(motion: Motion) -> Curve:
    return Polynomials(np.array([motion.start, motion.stop]), np.zeros((1, 1, 6)))
