"""Motions: the coordinates of a robot as functions of time, and what its bodies exert meanwhile."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Literal, NamedTuple

import numpy as np

from jounce.arguments.rates import check_order
from jounce.core.display import HtmlDisplay
from jounce.core.equality import EqualByValue
from jounce.core.errors import JounceError, check_choice, door, join_names, quote_value, warn
from jounce.core.scalars import asarray, is_finite
from jounce.core.typing import ArrayLike, Named
from jounce.model.positions import Position
from jounce.motion import base as bases
from jounce.motion.composite_curves import BLEND_DEGREE, CurveChain, RetimedCurve, make_presence
from jounce.motion.curves import COMPONENTS, DEFAULT_ORDER, ArrangedCurve, Curve, Jump, Polynomials
from jounce.spatial.series import rate_name

DEFAULT_TIME_STEP = 1e-3  # s, for motions without times of their own: the usual cycle of controllers
MAX_TIMES = 10_000_000  # that a step may make; a slip of the pen asks for more
BREAK_SIDES = ("right", "left")
MAX_CONTINUITY = 6  # the order of the last derivative that blends make continuous
MAX_JOIN_GAP = 1e-6  # rad or m: motions further apart do not follow each other


class Break(NamedTuple):
    """A place where a derivative of a coordinate jumps.

    It has the time, the joint, the order of the derivative (0 is q, 3 is q3d), and by how much it jumps.

    Where a wrench jumps, `symbol` is "W", the order is that of its derivative, and the joint is its component, as in
    "link7.fz". Where the motion of the base jumps, `symbol` is "base", and the joint is its entry, as in "base.z". Of a
    contact that comes or leaves, `symbol` is "contact", the joint is its frame, and the jump 1 or -1.
    """

    t: float
    joint: str | int
    order: int
    jump: float
    symbol: str = "q"


@door
@dataclass(frozen=True, eq=False, repr=False)
class Motion(EqualByValue, HtmlDisplay):
    """The motion of a robot as a function of time.

    ``motion(t, order)`` gives q, qd, ... at any times.

    `jounce.load_motion` makes one of a file or of named columns; the static methods make one of samples, terms, or what
    planners compute.

    Motions are equal if all their data are; a curve that is a function is equal to itself alone.

    Attributes
    ----------
    curve : Curve
        The function of time, whose columns are the numbers of q; of balls, planar and free joints these have names such
        as ankle.qx.
    joint_names : tuple of str, or None
        The names of the numbers of q, in the order of the last axis; None if they are in the robot's order.
    loads : mapping of str to Curve
        What bodies exert, (moment; force), by name: see `wrench`.
    source : str
        A description of the origin of the motion.
    samples : tuple of arrays, or None
        The times (N,) and coordinates (N, n) that a spline was made of.
    residual : (n,), or None
        Largest distance of q from the samples of a fit, or from the motion that was blended, rad or m.
    grid : (N,), or None
        The times of its samples or its file, s: see `times`.
    torques : tuple of arrays, or None
        Times (N,) and the torques (N, n) measured then, N m or N; NaN where a joint has none.
    notes : tuple of str
        What else its table contains, one note each.
    base_curve : Curve, or None
        Seven columns x, y, z, qw, qx, qy, qz: the position of the base, m, and a quaternion of any length (see `base`).
    branch : mapping of str to float
        Where joints that follow others in closed loops are at the start, by name, rad or m: in which way loops close.
        Empty if the start of the robot decides.
    several : tuple of Position
        Where the numbers of balls, planar and free joints stand among the columns. Rates that a call returns have the
        twists of these joints, and fewer columns than q.
    stance_frames : tuple of str
        The frames of the contacts that its stances name: see `with_stances`.
    presence : Curve, or None
        One column per such frame: 1 while its contacts are there, 0 while they are not.
    angles : "rad", or None
        The unit of angles; None for a log of which it is not stated: methods of robots compare it with their limits.
    commanded : bool
        Whether `torques` are commands and not measured, as the names of their columns say: they contradict no verdict.

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
    base_curve: Curve | None = None
    branch: Mapping[str, float] = field(default_factory=dict)
    several: tuple[Position, ...] = ()
    stance_frames: tuple[str, ...] = ()
    presence: Curve | None = None
    angles: str | None = "rad"
    commanded: bool = False

    @staticmethod
    def through(t: ArrayLike, q: Named, degree: int = 7, *, joint_names: Sequence[str] | None = None) -> "Motion":
        """Return the spline through samples without noise.

        Parameters
        ----------
        t : (N,)
            Increasing times, s.
        q : (N, n), or columns by joint name
            Coordinates at these times, rad or m: an array, or a dict, data frame or structured array of columns.
        degree : int, optional
            7 (C^6) or 5 (C^4).
        joint_names : sequence of str, optional
            Names of the n coordinates, by which robots match them; by default the order of the robot.

        Returns
        -------
        Motion

        Raises
        ------
        JounceError
            If a shape is wrong, t does not increase, or there are too few samples.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> t = np.linspace(0, 1, 50)
        >>> motion = jounce.Motion.through(t, np.sin(t)[:, None])
        >>> q, qd = motion(0.5, order=1)
        >>> qd.round(6)
        array([0.877583])
        """
        from jounce.motion import constructors
        from jounce.motion.spline import Spline

        return Motion(**constructors.from_samples(t, q, Spline(degree), joint_names)._asdict())

    @staticmethod
    def fit(
        t: ArrayLike,
        q: Named,
        *,
        bandwidth: float | None = None,
        allow_noise: bool = False,
        degree: int | None = None,
        intervals: int | None = None,
        joint_names: Sequence[str] | None = None,
        angles: Literal["rad"] | None = None,
        unwrap: bool = False,
    ) -> "Motion":
        """Return a smoothing of measured samples, by their noise.

        All rates have standard deviations.

        Parameters
        ----------
        t : (N,)
            Increasing times, s.
        q : (N, n), or columns by joint name
            Measured coordinates, rad or m: an array, or a dict, data frame or structured array of columns.
        bandwidth : float, optional
            Frequency in Hz up to which samples are followed; by default as far as the motion stands out of the noise.
        allow_noise : bool, optional
            Accept samples whose noise drowns q4d.
        degree, intervals : int, optional
            In place of smoothing, a least-squares spline of degree 7 or 5 with intervals of as many samples each.
        joint_names : sequence of str, optional
            Names of the n coordinates, by which robots match them; by default those of q, or the order of the robot.
        angles : {"rad"}, optional
            States that angles are in rad. By default methods of robots compare them with their limits, and refuse what
            looks like degrees, as `jounce.load_motion` does.
        unwrap : bool, optional
            Take off the whole turns, of 2 pi, by which angles jump where their encoders wrap; they go on from the first
            row. By default such samples are refused.

        Returns
        -------
        Motion

        Raises
        ------
        JounceError
            If a shape is wrong, t does not increase, or the samples cannot carry q4d.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> t = np.linspace(0, 4, 2001)
        >>> noise = 1e-5 * np.random.default_rng(0).normal(size=t.size)
        >>> motion = jounce.Motion.fit(t, (np.sin(t) + noise)[:, None])
        >>> q, qd, q2d = motion(2.0, order=2)
        >>> bool(abs(q2d[0] + np.sin(2.0)) < 1e-2)
        True
        """
        from jounce.motion import constructors
        from jounce.motion.spline import select_smoothing

        way = select_smoothing(degree, intervals, bandwidth, allow_noise)
        unit = None if angles is None else check_choice("unit of angles", angles, ("rad",))
        parts = constructors.from_log(t, q, way, joint_names, unwrap)
        return Motion(**parts._replace(angles=unit)._asdict())

    @staticmethod
    def polynomial(
        coefficients: Named, duration: float, *, start: float = 0.0, joint_names: Sequence[str] | None = None
    ) -> "Motion":
        """Return a motion of polynomials of time.

        Parameters
        ----------
        coefficients : (n, degree + 1), or a mapping of joints to (degree + 1,)
            Of the powers of t - start, the lowest first; rad or m.
        duration, start : float
            How long it lasts and when it begins, s.
        joint_names : sequence of str, optional
            Names of the n coordinates, by which robots match them; by default the order of the robot.

        Returns
        -------
        Motion

        Examples
        --------
        >>> import jounce
        >>> jounce.Motion.polynomial([[0.1, 0, 0.5]], duration=2.0)(1.0, order=2)
        (array([0.6]), array([1.]), array([1.]))
        """
        from jounce.motion import constructors

        return Motion(**constructors.from_polynomials(coefficients, duration, start, joint_names)._asdict())

    @staticmethod
    def fourier(
        offset: Named,
        cosines: Named,
        sines: Named,
        frequency: float,
        duration: float,
        *,
        start: float = 0.0,
        joint_names: Sequence[str] | None = None,
    ) -> "Motion":
        """Return a motion by a Fourier series.

        It is offset + sum_k cosines[k - 1] cos(k w t) + sines[k - 1] sin(k w t).

        Parameters
        ----------
        offset : (n,), or by joint name
            Mean of the coordinates, rad or m.
        cosines, sines : (harmonics, n), or by joint name
            Amplitudes, rad or m.
        frequency : float
            Angular frequency w of the first harmonic, rad/s.
        duration, start : float
            How long it lasts and when it begins, s.
        joint_names : sequence of str, optional
            Names of the n coordinates, by which robots match them; by default the order of the robot.

        Returns
        -------
        Motion

        Examples
        --------
        >>> import jounce
        >>> jounce.Motion.fourier([0.5], [[0.0]], [[0.2]], frequency=2.0, duration=3.0)(0.0, order=1)
        (array([0.5]), array([0.4]))
        """
        from jounce.motion import constructors

        series = constructors.FourierSeries(offset, cosines, sines, frequency, duration, start)
        return Motion(**constructors.from_fourier_series(series, joint_names)._asdict())

    @staticmethod
    def piecewise(breaks: ArrayLike, coefficients: Named, *, joint_names: Sequence[str] | None = None) -> "Motion":
        """Return a motion of piecewise polynomials, as `scipy.interpolate.PPoly`.

        Parameters
        ----------
        breaks : (m + 1,)
            Increasing times between which the pieces lie, s.
        coefficients : (degree + 1, m, n), or a mapping of joints to (degree + 1, m)
            Of the powers of t - breaks[i], the highest first; rad or m.
        joint_names : sequence of str, optional
            Names of the n coordinates, by which robots match them; by default the order of the robot.

        Returns
        -------
        Motion

        Examples
        --------
        >>> import jounce
        >>> motion = jounce.Motion.piecewise([0, 1, 2], [[[1.0], [0.0]], [[0.0], [1.0]]])  # t, then 1
        >>> motion([0.5, 1.5], order=0)[0].tolist()
        [[0.5], [1.0]]
        """
        from jounce.motion import constructors

        return Motion(**constructors.from_pieces(breaks, coefficients, joint_names)._asdict())

    @staticmethod
    def trapezoidal(
        positions: Named, velocity: Named, acceleration: Named, *, joint_names: Sequence[str] | None = None
    ) -> "Motion":
        """Return a motion from rest to rest between positions.

        Velocities are trapezoidal, and all joints in step.

        Parameters
        ----------
        positions : (m, n), or columns by joint name
            Coordinates to pass through at rest, rad or m.
        velocity, acceleration : float or (n,), or by joint name
            Limits; the slowest joint decides. In rad/s or m/s, and per s^2.
        joint_names : sequence of str, optional
            Names of the n coordinates, by which robots match them; by default the order of the robot.

        Returns
        -------
        Motion

        Examples
        --------
        >>> import jounce
        >>> motion = jounce.Motion.trapezoidal([[0.0], [1.0]], velocity=1.0, acceleration=2.0)
        >>> motion.duration, [found.t for found in motion.breaks]
        (1.5, [0.5, 1.0])
        """
        from jounce.motion import constructors

        return Motion(
            **constructors.from_trapezoidal_profiles(positions, velocity, acceleration, joint_names)._asdict()
        )

    @staticmethod
    def waypoints(
        points: Named | Sequence[Mapping[str, ArrayLike]],
        duration: float,
        *,
        tolerance: float | None = None,
        joint_names: Sequence[str] | None = None,
    ) -> "Motion":
        """Return a motion from rest to rest along way points.

        The path is a spline of degree 5 (C^4) through all points, straight between two; or straight lines with corners
        rounded by polynomials (C^4), which stay within the triangle of a corner and its neighbours. Along the path the
        motion follows a polynomial of degree 9, at rest to q4d at both ends; `Robot.retime` finds the fastest law.

        Parameters
        ----------
        points : (k, n), columns by joint name, or a list of positions
            Coordinates of the points, rad or m. Neighbours that are equal to 1e-9 count once, with a note.
        duration : float
            How long the motion lasts, s.
        tolerance : float, optional
            Straight lines between the points instead, and how far the path may be from a corner: the largest change of
            any joint, each in its own unit, rad or m. Corners reach it, unless half of a line to a neighbour is too
            short; `residual` holds how far each joint is away.
        joint_names : sequence of str, optional
            Names of the n coordinates, by which robots match them; by default those of points, or the robot's order.

        Returns
        -------
        Motion

        Raises
        ------
        JounceError
            If fewer than two points differ, a number is out of range, or a tolerance is given for a straight line.

        References
        ----------
        E. T. Y. Lee, "Choosing nodes in parametric curve interpolation", Computer-Aided Design 21(6), 1989.

        Examples
        --------
        >>> import jounce
        >>> points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
        >>> jounce.Motion.waypoints(points, 2.0)(1.0, order=0)[0].round(6)
        array([1., 0.])
        >>> jounce.Motion.waypoints(points, 2.0, tolerance=0.05)(1.0, order=0)[0].round(6)
        array([0.95, 0.05])
        """
        from jounce.motion import way_points

        return Motion(**way_points.from_points(points, duration, tolerance, joint_names)._asdict())

    @staticmethod
    def from_ruckig(trajectory: Any, *, joint_names: Sequence[str] | None = None) -> "Motion":
        """Return the motion of a `ruckig.Trajectory`.

        It has exact pieces of constant jerk, whose ends are breaks.

        Parameters
        ----------
        trajectory : ruckig.Trajectory
            A trajectory that Ruckig has calculated.
        joint_names : sequence of str, optional
            Names of the n coordinates, by which robots match them; by default the order of the robot.

        Returns
        -------
        Motion

        Raises
        ------
        JounceError
            If it is no such trajectory or has no pieces.

        Examples
        --------
        >>> import jounce, ruckig
        >>> given = ruckig.InputParameter(1)
        >>> given.target_position = [1.0]
        >>> given.max_velocity, given.max_acceleration, given.max_jerk = [1.0], [2.0], [10.0]
        >>> trajectory = ruckig.Trajectory(1)
        >>> result = ruckig.Ruckig(1).calculate(given, trajectory)
        >>> motion = jounce.Motion.from_ruckig(trajectory)
        >>> motion(motion.stop, order=0)[0].round(9)
        array([1.])
        """
        from jounce.motion import constructors

        return Motion(**constructors.from_ruckig(trajectory, joint_names)._asdict())

    @staticmethod
    def from_toppra(path: Any, *, joint_names: Sequence[str] | None = None) -> "Motion":
        """Return the motion that toppra's ``compute_trajectory()`` returns.

        Either parametrizer may make it; its polynomials are exact.

        Parameters
        ----------
        path : toppra interpolator
            The path over time.
        joint_names : sequence of str, optional
            Names of the n coordinates, by which robots match them; by default the order of the robot.

        Returns
        -------
        Motion

        Raises
        ------
        JounceError
            If it is no path of toppra, or one whose polynomials are not known.

        Examples
        --------
        >>> import jounce, toppra
        >>> path = toppra.SplineInterpolator([0, 1], [[0.0], [1.0]])
        >>> limits = [toppra.constraint.JointAccelerationConstraint([[-2.0, 2.0]])]
        >>> planned = toppra.algorithm.TOPPRA(limits, path, parametrizer="ParametrizeConstAccel").compute_trajectory()
        >>> motion = jounce.Motion.from_toppra(planned)
        >>> round(motion.duration, 6)
        1.414214
        """
        from jounce.motion import constructors

        return Motion(**constructors.from_toppra(path, joint_names)._asdict())

    @staticmethod
    def from_joint_trajectory(message: Any) -> "Motion":
        """Return the motion of a ROS JointTrajectory.

        It may be within a plan of MoveIt that holds one.

        Between points it is linear, cubic or quintic, as both of them state positions, velocities too, or accelerations
        too. Joints are matched by name when it is used with a robot.

        Parameters
        ----------
        message : trajectory_msgs/JointTrajectory or dict
            The message, or its dict.

        Returns
        -------
        Motion

        Raises
        ------
        JounceError
            If joints or points are missing, or their times do not increase.

        Examples
        --------
        >>> import jounce
        >>> points = [{"time_from_start": t, "positions": [q]} for t, q in ((0, 0.0), (1, 0.5))]
        >>> motion = jounce.Motion.from_joint_trajectory({"joint_names": ["lift"], "points": points})
        >>> motion(0.5, order=0), motion.joint_names
        ((array([0.25]),), ('lift',))
        """
        from jounce.motion import ros

        return Motion(**ros.from_joint_trajectory(message)._asdict())

    def __repr__(self) -> str:
        more = sum(len(joint.names) - 1 for joint in self.several)
        joints = "" if self.joint_names is None else f" of {len(self.joint_names) - more} joints"
        base = " with a base" if self.base_curve else ""
        return f"<Motion{joints}{base}, t = {self.start:g} .. {self.stop:g} s: {self.source}>"

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

    @property
    def highest(self) -> int | None:
        """The order of the last derivative that is known.

        It is known of all joints and of the base; None where all are.
        """
        curves = (self.curve, self.base_curve) if self.base_curve else (self.curve,)
        return min((curve.highest for curve in curves if curve.highest is not None), default=None)

    @cached_property
    def times(self) -> np.ndarray:
        """Default times (N,) of evaluation.

        They are those of its samples or its file, or a grid of about a millisecond.
        """
        return self._grid(DEFAULT_TIME_STEP) if self.grid is None else self.grid

    @cached_property
    def stance_ends(self) -> np.ndarray:
        """The times between which contacts stay as they are.

        Contacts begin or end to come or leave there; the start and end of the motion are among them.
        """
        jumps = self.presence.jumps(BLEND_DEGREE) if self.presence else ()
        return np.unique([self.start, *(jump.t for jump in jumps), self.stop])

    @cached_property
    def breaks(self) -> tuple[Break, ...]:
        """The breaks where a derivative up to q4d or W2d jumps.

        They are in the order of time; of each joint the lowest derivative that jumps.
        """
        return self.breaks_to(DEFAULT_ORDER)

    def breaks_to(self, order: int) -> tuple[Break, ...]:
        """Return the breaks of derivatives up to another order than `breaks`.

        Wrenches count to the order less two.

        Parameters
        ----------
        order : int
            The highest derivative of q: 4 is q4d.

        Returns
        -------
        tuple of Break
            Each with the time `t`, the `joint`, the `order` of the derivative that jumps, and by how much, `jump`.

        Examples
        --------
        >>> import jounce
        >>> motion = jounce.Motion.trapezoidal([[0.0], [1.0]], velocity=1.0, acceleration=2.0)
        >>> [(found.t, found.order, found.jump) for found in motion.breaks_to(2)]
        [(0.5, 2, -2.0), (1.0, 2, -2.0)]
        """
        order = check_order(order)
        names: Sequence[str | int] = self.joint_names or range(self.curve.columns)
        breaks = [Break(jump.t, names[jump.column], jump.order, jump.size) for jump in _find_jumps(self.curve, order)]
        # Forces take the second rate of q where they take wrenches, and contacts, as they are.
        for body, curve in self.loads.items():
            for jump in _find_jumps(curve, order - 2):
                name = f"{body}.{COMPONENTS[jump.column]}"
                breaks.append(Break(jump.t, name, jump.order, jump.size, "W"))
        if self.presence is not None:
            for jump in _find_jumps(self.presence, order - 2):
                breaks.append(Break(jump.t, self.stance_frames[jump.column], jump.order, jump.size, "contact"))
        if self.base_curve is not None:
            for jump in _find_jumps(self.base_curve, order):
                breaks.append(Break(jump.t, bases.BASE_COLUMNS[jump.column], jump.order, jump.size, "base"))
        return tuple(sorted(breaks, key=lambda jump: jump.t))

    def __call__(
        self, t: ArrayLike, order: int = 4, side: Literal["right", "left"] = "right"
    ) -> tuple[np.ndarray, ...]:
        """Return the coordinates and their rates at times.

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
            q, qd, ...: rad or m, per s, per s^2, ...; a tuple for order 0 too. Of balls, planar and free joints q has
            the numbers and qd the twist, in the axes of the joint, which follows from their rates exactly.

        Raises
        ------
        JounceError
            If a time is outside of the motion, or the rates are not known to this order.

        Examples
        --------
        >>> import jounce
        >>> motion = jounce.Motion.polynomial([[0, 1, 0.5]], duration=1.0)
        >>> motion([0.0, 1.0], order=1)[1].tolist()
        [[1.0], [2.0]]
        """
        times, order = self.checked(t), check_order(order)
        self._check_known(self.curve, order, "q", self.source)
        rates = self.curve.rates(times.ravel(), order, check_choice("side", side, BREAK_SIDES) == "left")
        self._check_finite(rates, times, "q", lambda j: f"joint {self._name(j)}")
        for joint in self.several:
            bases.check_norms(rates[0][:, joint.turn], times.ravel(), f"{joint.name}: the rotation")
        # Rates of numbers become twists of joints of several numbers: (N, nq) -> (N, n).
        return tuple(rate.reshape(*times.shape, rate.shape[1]) for rate in bases.compute_states(self.several, rates))

    def wrench(
        self, t: ArrayLike, order: int = 2, side: Literal["right", "left"] = "right"
    ) -> tuple[dict[str, np.ndarray], ...] | None:
        """Return what bodies and merged links exert at times, with rates.

        This is what `wrench=` of `Robot.inverse_dynamics` takes.

        Parameters
        ----------
        t, order, side : (...), int, {"right", "left"}
            As in a call of the motion; `order` is the highest rate of W.

        Returns
        -------
        tuple of dict, or None
            W, Wd, ...: {name: (..., 6)}, (moment; force) in N m and N; None for a motion without wrenches.

        Raises
        ------
        JounceError
            If a time is outside of the motion, or the rates are not known to this order.

        Examples
        --------
        >>> import jounce
        >>> motion = jounce.load_motion("paper-wrench", jounce.load("iiwa14"))
        >>> W, Wd = motion.wrench(0.5, order=1)
        >>> list(W), W["link7"].shape
        (['link7'], (6,))
        """
        times, order = self.checked(t), check_order(order)
        left = check_choice("side", side, BREAK_SIDES) == "left"
        wrenches: list[dict[str, np.ndarray]] = [{} for _ in range(order + 1)]
        for body, curve in self.loads.items():
            what = f"the wrench of {quote_value(body)}"
            self._check_known(curve, order, "W", what)
            rates = curve.rates(times.ravel(), order, left)
            self._check_finite(rates, times, "W", lambda j, what=what: what)
            for by_body, rate in zip(wrenches, rates, strict=True):
                by_body[body] = rate.reshape(*times.shape, 6)
        return tuple(wrenches) if len(self.loads) > 0 else None

    def base(
        self, t: ArrayLike, order: int = 4, side: Literal["right", "left"] = "right"
    ) -> tuple[np.ndarray, ...] | None:
        """Return the pose of the base at times, and its twists.

        This is what `base=` of `Robot.inverse_dynamics` takes.

        The base is that of a robot that floats, or the ground on which another robot stands. The twist is (angular;
        linear), in the axes of the base and about its origin. It follows exactly from the quaternion Q = (w; v) of
        `base_curve`, of any length: the angular velocity is 2 E(Q) Qd / (Q^T Q) with E = [-v, w 1 - hat(v)].

        Parameters
        ----------
        t, order, side : (...), int, {"right", "left"}
            As in a call of the motion; `order` is the highest derivative of position and quaternion.

        Returns
        -------
        tuple of arrays, or None
            C (..., 4, 4), V, Vd, ... (..., 6), order + 1 of them; m, rad/s and m/s, ...; None without a base.

        Raises
        ------
        JounceError
            If a time is outside of the motion, the rates are not known to this order, or the quaternion vanishes.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> t, C = np.linspace(0, 1, 50), np.broadcast_to(np.eye(4), (50, 4, 4)).copy()
        >>> C[:, 2, 3] = 0.5 + 0.1 * t**2
        >>> motion = jounce.Motion.polynomial([[0, 1], [0, 2]], 1.0).with_base(t, C, degree=7)
        >>> C, V, Vd = motion.base(1.0, order=2)
        >>> V.round(6), Vd.round(6)
        (array([0. , 0. , 0. , 0. , 0. , 0.2]), array([0. , 0. , 0. , 0. , 0. , 0.2]))
        """
        times, order = self.checked(t), check_order(order)
        left = check_choice("side", side, BREAK_SIDES) == "left"
        if self.base_curve is None:
            return None
        self._check_known(self.base_curve, order, "q", "the motion of the base")
        terms = bases.evaluate_base(self.base_curve, times.ravel(), order, left)
        self._check_finite(terms, times, "the motion", lambda j: "the base")
        return tuple(term.reshape(*times.shape, *term.shape[1:]) for term in terms)

    def with_base(
        self,
        t: ArrayLike | None,
        C: ArrayLike,
        *,
        degree: int | None = None,
        intervals: int | None = None,
        bandwidth: float | None = None,
        allow_noise: bool = False,
    ) -> "Motion":
        """Return the same motion with poses of the base.

        The base is that of a robot that floats, or the ground on which another stands.

        Positions and unit quaternions become a curve, whose twist is exact (see `base`). By default it is smoothed as
        measured samples of joints are, and forces have standard deviations that follow from it.

        Parameters
        ----------
        t : (N,), or None
            Increasing times, s, from the start of the motion or earlier to its end or later; None for one pose.
        C : (N, 4, 4) or (4, 4)
            Poses of the base in the inertial frame, base to inertial frame, positions in m; one pose if the base rests.
        degree, intervals : int, optional
            Interpolate the poses by a spline of degree 7 (C^6) or 5 (C^4), or fit it by least squares over intervals.
        bandwidth, allow_noise : float, bool, optional
            Bandwidth of smoothing in Hz, and whether to accept noise that drowns the highest rate: see `Motion.fit`.

        Returns
        -------
        Motion

        Raises
        ------
        JounceError
            If a shape is wrong, a matrix is no pose (the message says which and how far off), t does not increase or
            does not cover the motion, or there are too few poses.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> jounce.Motion.polynomial([[0, 1]], 1.0).with_base(None, np.eye(4)).base(0.5, order=1)[1]
        array([0., 0., 0., 0., 0., 0.])
        """
        from jounce.motion import body_columns
        from jounce.motion.spline import select_smoothing

        way = select_smoothing(degree, intervals, bandwidth, allow_noise)
        curve, notes = body_columns.curve_from_poses(t, C, way, self.start, self.stop)
        return replace(self, base_curve=curve, notes=(*self.notes, *notes))

    def with_stances(self, stances: Sequence[tuple[float, Sequence[str]]], blend: float = 0.0) -> "Motion":
        """Return the same motion on contacts that come and leave.

        `Robot.contacts` states what the contacts transmit.

        Torques jump where contacts change, unless with a `blend` the inverses of their weights grow from 0 after they
        come, and fall to 0 before they leave, by polynomials of degree 9 with four continuous derivatives.

        Parameters
        ----------
        stances : list of (float, list of str)
            From when on, s, which contacts are there, by their frames: the first from the start of the motion. (t, [])
            is flight, where the rows of the base are what is missing, 0 where it falls. [] leaves all stances.
        blend : float, optional
            How long contacts take to come and to leave, s; others must balance the robot meanwhile.

        Returns
        -------
        Motion

        Raises
        ------
        JounceError
            If times do not increase from the start of the motion to before its end, or the blend is too long.

        Examples
        --------
        >>> import jounce
        >>> feet = ["left_ankle_roll_link", "right_ankle_roll_link"]
        >>> motion = jounce.Motion.polynomial([[0, 1]], 2.0).with_stances([(0, feet), (1.5, feet[:1])])
        >>> [(found.t, found.joint, found.jump) for found in motion.breaks]
        [(1.5, 'right_ankle_roll_link', -1.0)]
        """
        frames, presence = make_presence(stances, blend, self.start, self.stop)
        return replace(self, stance_frames=frames, presence=presence)

    def wrench_deviations(self, t: ArrayLike, order: int = 2) -> tuple[dict[str, np.ndarray], ...]:
        """Return standard deviations of the wrenches and their rates.

        Wrenches have them that are smoothed.

        Parameters
        ----------
        t, order : (...), int
            Times, s, and the highest rate, as for `wrench`.

        Returns
        -------
        tuple of dict
            {name: (..., 6)} for each rate, without the wrenches that are exact.

        Raises
        ------
        JounceError
            If a time is outside of the motion, or the rates are not known to this order.

        Examples
        --------
        >>> import jounce
        >>> jounce.load_motion("paper-wrench", jounce.load("iiwa14")).wrench_deviations(0.5, order=0)
        ({},)
        """
        times, order = self.checked(t), check_order(order)
        deviations = {body: curve.deviations(times.ravel(), order) for body, curve in self.loads.items()}
        inexact = {body: rates for body, rates in deviations.items() if rates is not None}
        shape = *times.shape, len(COMPONENTS)
        return tuple({body: rates[k].reshape(shape) for body, rates in inexact.items()} for k in range(order + 1))

    def deviations(self, t: ArrayLike, order: int = 4) -> tuple[np.ndarray, ...] | None:
        """Return standard deviations of the coordinates and their rates.

        Parameters
        ----------
        t, order : (...), int
            Times, s, and the highest rate, as in a call of the motion.

        Returns
        -------
        tuple of (..., n), or None
            Of q, qd, ...: rad or m, per s, ...; None where these are exact.

        Raises
        ------
        JounceError
            If a time is outside of the motion, or the rates are not known to this order.

        Examples
        --------
        >>> import jounce
        >>> jounce.Motion.polynomial([[0, 1]], duration=1.0).deviations(0.5) is None
        True
        """
        times, order = self.checked(t), check_order(order)
        self._check_known(self.curve, order, "q", self.source)
        deviations = self.curve.deviations(times.ravel(), order)
        if deviations is None:
            return None
        if len(self.several) > 0:
            # Deviations of numbers become those of twists: each entry is put off by its own, and squares add up.
            compute = partial(bases.compute_states, self.several)
            exact = compute(self.curve.rates(times.ravel(), order))
            deviations = [np.zeros_like(rate) for rate in exact]
            for perturbed in bases.perturb_rates(self.curve, times.ravel(), order, compute):
                changes = map(np.subtract, perturbed, exact)
                deviations = [np.hypot(a, b) for a, b in zip(deviations, changes, strict=True)]
        return tuple(rate.reshape(*times.shape, rate.shape[1]) for rate in deviations)

    def scaled(self, factor: float) -> "Motion":
        """Return the same path, `factor` times as long, from the same start.

        Its k-th rates are 1 / factor^k of these.

        Parameters
        ----------
        factor : float
            2 for half the speed.

        Returns
        -------
        Motion

        Examples
        --------
        >>> import jounce
        >>> jounce.Motion.polynomial([[0, 1]], duration=1.0).scaled(2).duration
        2.0
        """
        if not is_finite(factor) or not factor > 0:
            raise JounceError(f"factor is {quote_value(factor)}; expected a finite number > 0, 2 for half the speed")
        number = float(factor)  # a fraction does not take a format
        return self._retimed(number, self.start, f"{self.source}, {number:g} times as long")

    def shifted(self, seconds: float) -> "Motion":
        """Return the same motion, later by some seconds.

        Parameters
        ----------
        seconds : float
            How much later, s; negative for earlier.

        Returns
        -------
        Motion

        Examples
        --------
        >>> import jounce
        >>> jounce.Motion.polynomial([[0, 1]], duration=1.0).shifted(3).start
        3.0
        """
        if not is_finite(seconds):
            raise JounceError(f"seconds is {quote_value(seconds)}; expected a finite number")
        return self._retimed(1.0, self.start + float(seconds), self.source)

    def with_step(self, step: float) -> "Motion":
        """Return the same motion with other `times`, in even steps.

        Parameters
        ----------
        step : float
            The longest step, s.

        Returns
        -------
        Motion

        Raises
        ------
        JounceError
            If the step is not positive, or makes more than ten million times.

        Examples
        --------
        >>> import jounce
        >>> jounce.Motion.polynomial([[0, 1]], duration=1.0).with_step(0.25).times
        array([0.  , 0.25, 0.5 , 0.75, 1.  ])
        """
        if not is_finite(step) or not step > 0:
            raise JounceError(f"step is {quote_value(step)}; expected a number of seconds > 0")
        if self.duration / step > MAX_TIMES:
            came = f"a step of {step:g} s makes more than {MAX_TIMES} times in {self.duration:g} s"
            raise JounceError(f"{came}; expected a longer one")
        return replace(self, grid=self._grid(float(step)))

    def sampled(self, rate: float, differences: int = 3) -> "Motion":
        """Return the motion as a controller takes it: commands of positions.

        The commands are positions at k / rate, and controllers take their differences too.

        `Robot.check` compares the differences of its commands with limits. Between them the motion is the B-spline
        whose control points they are, with the jerk of their third differences.

        Parameters
        ----------
        rate : float
            That of the controller, Hz. The last command is the end of the motion, at the first k / rate from there on;
            if the motion ends with a jerk that stops it within a period, where it stops.
        differences : int, optional
            Order of the last difference that the controller takes: 1 for velocity, 2 for acceleration, 3 for jerk, as
            libfranka does, or 4 for snap.

        Returns
        -------
        Motion
            With the commands as `samples`.

        Raises
        ------
        JounceError
            If a number is out of range, or the motion consists of commands at another rate.

        Examples
        --------
        >>> import jounce
        >>> motion = jounce.Motion.trapezoidal([[0.0], [1.0]], velocity=1.0, acceleration=2.0).sampled(rate=20)
        >>> motion.samples[1][:4, 0].round(4).tolist()
        [0.0, 0.0025, 0.01, 0.0225]
        """
        from jounce.motion.commands import find_commands, sample_curve

        # Motion.sampled(t, q) is what users write who look for `fit`.
        caller: object = self
        if not isinstance(caller, Motion):
            came = f"Motion.sampled() is a method of a motion, got {type(caller).__name__}"
            raise JounceError(f"{came}; Motion.fit(t, q) makes a motion of samples")
        curve, notes = sample_curve(self.curve, rate, differences)
        sampled = replace(self, curve=curve, samples=(curve.t, curve.q), grid=curve.t, notes=(*self.notes, *notes))
        # Commands of a table stay what they are, with the torques that were measured along them.
        if find_commands(self.curve) is not None:
            return sampled
        return replace(sampled, source=f"{self.source}, as commands at {rate:g} Hz", residual=None, torques=None)

    def blended(self, time: float, continuity: int = 4) -> "Motion":
        """Return the motion with polynomials in place of its breaks.

        Derivatives up to an order are continuous then.

        Each break of a joint is replaced from half the time before to half the time after; `residual` is the largest
        distance from this motion. Wrenches that jump are blended too, up to the order less two, and so is the base.

        Parameters
        ----------
        time : float
            How long each blend lasts, s: no longer than any gap between two breaks of a joint.
        continuity : int, optional
            The order of the last derivative that is continuous: 4, with which Q2d has no jump, or 6.

        Returns
        -------
        Motion

        Raises
        ------
        JounceError
            If a number is out of range, or a blend is longer than a gap between breaks.

        Examples
        --------
        >>> import jounce
        >>> motion = jounce.Motion.trapezoidal([[0.0], [1.0]], velocity=1.0, acceleration=2.0)
        >>> motion.blended(0.1).breaks_to(4)
        ()
        """
        from jounce.motion.composite_curves import blend_curve

        if not is_finite(time) or not time > 0:
            raise JounceError(f"time is {quote_value(time)}; expected a number of seconds > 0")
        if isinstance(continuity, bool) or not isinstance(continuity, int) or not 2 <= continuity <= MAX_CONTINUITY:
            raise JounceError(
                f"continuity is {quote_value(continuity)}; expected 2 to {MAX_CONTINUITY}, 4 for a smooth Q2d"
            )
        if len(self.breaks_to(continuity)) == 0:
            last = rate_name("q", continuity)
            warn(f"no derivative up to {last} jumps ({self.source}): a blend has no effect; leave it out")
            return replace(self, residual=np.zeros(self.curve.columns))
        names = [f"joint {self._name(j)}" for j in range(self.curve.columns)]
        curve, distance = blend_curve(self.curve, float(time), _known_order(self.curve, continuity), names)
        # Wrenches enter the forces as q2d does: they need two derivatives less.
        loads, notes = dict(self.loads), list(self.notes)
        for body, load in self.loads.items():
            if len(_find_jumps(load, continuity - 2)) > 0:
                components = [f"the wrench component {body}.{component}" for component in COMPONENTS]
                loads[body], off = blend_curve(load, float(time), _known_order(load, continuity - 2), components)
                notes.append(f"wrench of {quote_value(body)}: blended, at most {off.max():.2g} N m or N from it")
        base = self.base_curve
        if base is not None and len(_find_jumps(base, continuity)) > 0:
            base, off = blend_curve(
                base, float(time), _known_order(base, continuity), [f"column {name}" for name in bases.BASE_COLUMNS]
            )
            turn = f"{off[3:].max():.2g} in quaternions"
            notes.append(f"base: blended, at most {off[:3].max():.2g} m from it, and {turn}")
        source = f"{self.source}, blended over {float(time):g} s (C^{continuity})"
        return replace(
            self, curve=curve, residual=distance, loads=loads, base_curve=base, notes=tuple(notes), source=source
        )

    def __add__(self, other: object) -> "Motion":
        """Append another motion, shifted to the end of this one.

        Positions must agree; jumps of rates become breaks.
        """
        if not isinstance(other, Motion):
            return NotImplemented
        if self.joint_names != other.joint_names or self.curve.columns != other.curve.columns:
            raise JounceError(f"motions of other joints: {self._names()} and {other._names()}; expected the same")
        if self.presence or other.presence:
            raise JounceError("motions with stances are not joined; join them first, then state stances of the whole")
        later = other.shifted(self.stop - other.start)
        [end], [begin] = self(self.stop, 0, "left"), later(later.start, 0)
        # The free sign of quaternions, and the length of these and of cosines and sines, are made to go on.
        factors = np.ones(len(end))
        for joint in self.several:
            factors[joint.turn] = _continuation_factor(end[joint.turn], begin[joint.turn])
        begin = begin * factors
        gaps = np.abs(end - begin)
        if gaps.max() > MAX_JOIN_GAP:
            j = int(gaps.argmax())
            came = f"joint {self._name(j)} ends at {end[j]:g} and goes on from {begin[j]:g}"
            raise JounceError(f"the motions do not meet: {came}; expected one to begin where the other ends")
        # A body with a wrench in one of the motions alone has none in the other.
        loads = {
            body: CurveChain(tuple(part.loads.get(body) or _zero_wrench(part) for part in (self, later)))
            for body in {**self.loads, **later.loads}
        }
        grid = None
        if self.grid is not None and later.grid is not None:
            grid = np.concatenate([self.grid, later.grid[later.grid > self.grid[-1]]])
        source = self.source if self.source == other.source else f"{self.source}; then {other.source}"
        later_curve = _scale_columns(later.curve, factors) if len(self.several) > 0 else later.curve
        curve = CurveChain((self.curve, later_curve))
        joined = Motion(curve, self.joint_names, source, loads, grid=grid, base_curve=_join_bases(self, later))
        unit = None if self.angles is None or other.angles is None else self.angles
        return replace(joined, branch=self.branch, several=self.several, angles=unit)

    def checked(self, t: ArrayLike) -> np.ndarray:
        """Return times that a caller states, within the motion.

        Parameters
        ----------
        t : (...)
            Times, s.

        Returns
        -------
        (...)
            The times as an array of float64.

        Raises
        ------
        JounceError
            If it is no array of numbers, or a time is outside of the motion.

        Examples
        --------
        >>> import jounce
        >>> jounce.Motion.polynomial([[0, 1]], duration=1.0).checked([0, 1])
        array([0., 1.])
        """
        times = np.asarray(asarray(t, "t"))
        if times.dtype.kind != "f" or np.asarray(t).dtype.kind == "b":
            raise JounceError(f"t is {quote_value(t)}; expected times in s")
        # Times of even steps may be beyond the end by rounding: they are moved to it.
        slack = 1e-12 * max(abs(self.start), abs(self.stop))
        outside = ~((times >= self.start - slack) & (times <= self.stop + slack))
        if outside.any():
            came = f"t = {times[outside].flat[0]:.17g} s is outside of the motion"
            raise JounceError(f"{came}; expected times from {self.start:.17g} to {self.stop:.17g} s")
        return times.clip(self.start, self.stop)

    def _grid(self, step: float) -> np.ndarray:
        """Return even times from start to end, at most a step apart."""
        count = min(max(int(np.ceil(self.duration / step * (1 - 1e-12))), 1), MAX_TIMES)
        return np.linspace(self.start, self.stop, count + 1)

    def _retimed(self, factor: float, place: float, source: str) -> "Motion":
        """Return the motion at another pace, its start at a time `place`."""
        retimed = partial(RetimedCurve, factor=factor, origin=self.start, place=place)
        curve = retimed(self.curve)
        return replace(
            self,
            curve=curve,
            loads={body: retimed(load) for body, load in self.loads.items()},
            base_curve=self.base_curve and retimed(self.base_curve),
            source=source,
            samples=self.samples and (curve.outer(self.samples[0]), self.samples[1]),
            grid=None if self.grid is None else curve.outer(self.grid),
            torques=self.torques and (curve.outer(self.torques[0]), self.torques[1]),
            presence=self.presence and retimed(self.presence),
        )

    def _check_known(self, curve: Curve, order: int, symbol: str, source: str) -> None:
        """Raise `JounceError` where a curve does not know an order."""
        if curve.highest is not None and order > curve.highest:
            rate, last = rate_name(symbol, order), rate_name(symbol, curve.highest)
            raise JounceError(f"{rate} is not known along this motion ({source}); it ends at {last}")

    def _check_finite(self, rates: Sequence[np.ndarray], times: np.ndarray, symbol: str, of: Any) -> None:
        """Raise `JounceError` where rates overflow, which names what and when."""
        for k, rate in enumerate(rates):
            if not np.isfinite(rate).all():
                i, j = np.argwhere(~np.isfinite(rate))[0]
                came = f"{rate_name(symbol, k)} of {of(j)} overflows at t = {times.flat[i]:g} s"
                raise JounceError(f"{came}; expected a finite time derivative of order {k}")

    def _name(self, j: int) -> str:
        """Return the name of a coordinate, or its number."""
        return quote_value(self.joint_names[j]) if self.joint_names else str(j)

    def _names(self) -> str:
        """Return the names of all coordinates, or their number."""
        return join_names(self.joint_names) if self.joint_names else f"{self.curve.columns} without names"


def _known_order(curve: Curve, order: int) -> int:
    """Return the order, or the last one that a curve knows."""
    return order if curve.highest is None else min(order, curve.highest)


def _find_jumps(curve: Curve, order: int) -> list[Jump]:
    """Return the known jumps of a curve up to an order."""
    return curve.jumps(_known_order(curve, order)) if order >= 0 else []


def _join_bases(first: Motion, later: Motion) -> Curve | None:
    """Return the base of two motions one after the other.

    The free sign and length of the second quaternion follow the first.
    """
    if first.base_curve is None or later.base_curve is None:
        if first.base_curve is not None or later.base_curve is not None:
            raise JounceError("only one of the motions has a base; expected both or neither: motion.with_base(t, C)")
        return None
    [end] = first.base_curve.rates(np.array([first.stop]), 0, True)
    [begin] = later.base_curve.rates(np.array([later.start]), 0)
    factors = np.array([1.0] * 3 + [_continuation_factor(end[0, 3:], begin[0, 3:])] * 4)
    gap = np.abs(end - begin * factors).max()
    if gap > MAX_JOIN_GAP:
        came = f"the motions do not meet: their bases are {gap:.2g} apart in position (m) or quaternion"
        raise JounceError(f"{came}; expected one to begin where the other ends")
    return CurveChain((first.base_curve, _scale_columns(later.base_curve, factors)))


def _continuation_factor(end: np.ndarray, begin: np.ndarray) -> float:
    """Return the factor by which numbers go on from where others end.

    They are a quaternion, whose sign is free, or cosine and sine.
    """
    factor = float(end @ begin) / float(begin @ begin)
    return factor if len(end) == 4 else abs(factor)


def _scale_columns(curve: Curve, factors: np.ndarray) -> Curve:
    """Return a curve with its columns times factors."""
    return ArrangedCurve(curve, np.arange(curve.columns), factors)


def _zero_wrench(motion: Motion) -> Curve:
    """Return the wrench 0 over the time of a motion."""
    return Polynomials(np.array([motion.start, motion.stop]), np.zeros((1, 1, 6)))
