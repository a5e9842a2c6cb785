"""What starts from one robot and lies above its quantities: each method imports what does it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import pi
from os import PathLike
from typing import TYPE_CHECKING, Any

from jounce.core.typing import ArrayLike, DriveTerms
from jounce.engine.engine import with_mechanism
from jounce.robot.identifications import Identifications

if TYPE_CHECKING:
    from jounce._report import Report
    from jounce.identification import Excitation, Identification
    from jounce.live.estimator import LiveRates
    from jounce.live.guard import Guard
    from jounce.motion import Motion


class Applications(Identifications):
    """Methods of `Robot` that excite it, follow it live and report on it."""

    def excite(
        self,
        *,
        period: float = 10.0,
        periods: int = 1,
        harmonics: int = 5,
        drives: DriveTerms = False,
        weights: ArrayLike | None = None,
        reach: float = pi,
        margin: float = 0.01,
        payload: bool | str = False,
        starts: int = 5,
        seed: int = 0,
        progress: Callable[[int, int], object] | None = None,
    ) -> "Excitation":
        """Find a motion whose forces determine the base parameters best, within all limits of the robot.

        ``q(t) = c + sum_k a_k cos(k w t) + b_k sin(k w t)``, ``w = 2 pi / period``, for every coordinate, with all
        rates up to q4d zero at the ends of each period: the robot starts and stops at rest, and Q2d has no jump. The
        amplitudes maximize log det H of the information matrix H, the time mean of ``Y^T W Y`` with the regressor Y of
        the base parameters and weights W of the forces: the confidence ellipsoid of identified parameters has the least
        volume, whatever their units. All limits of the robot hold, between samples too; drive terms that act enter
        those of effort. Obstacles and the robot's own links are ignored: position limits keep it from them.

        Parameters
        ----------
        period : float, optional
            Of the series, s.
        periods : int, optional
            How often the motion repeats it.
        harmonics : int, optional
            Of the series, 3 to 50.
        drives : bool, str or iterable of str, optional
            Drive terms to identify too: "armature", "damping", "friction", "spring", "offset"; True for all.
        weights : (n,), optional
            Relative inverse variances of the measured forces; 0 leaves one out. By default the inverse squares of the
            effort limits; equal if a coordinate has none.
        reach : float, optional
            Range of revolute joints without position limits to either side of 0, rad (twice as far from an only limit).
        margin : float, optional
            Share of each limit that is left.
        payload : bool or str, optional
            Determine the ten parameters of a load, on the last body or a named one, instead of those of the robot.
        starts, seed : int, optional
            Number of random series to start from, and the seed of their generator.
        progress : callable, optional
            It is called with the number of starts that are done, and of all.

        Returns
        -------
        Excitation
            The `motion`, its `criterion` and `condition`, parameters seen and unseen, the `check` of all limits.

        Raises
        ------
        JounceError
            If the robot floats, has closed loops or states no limit of a rate or force, an argument is out of range, a
            prismatic joint has no position limits, limits leave no room to move, or parameters cannot be separated.

        References
        ----------
        J. Swevers, C. Ganseman, D. B. Tukel, J. De Schutter, H. Van Brussel, "Optimal Robot Excitation and
        Identification", IEEE Transactions on Robotics and Automation 13(5), 1997.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r").with_limits(lower=-2, upper=2, velocity=3, effort=[60, 20])
        >>> found = robot.excite(period=4, harmonics=4, starts=2, drives="friction")
        >>> found.check.ok, found.parameters[-1]
        (True, 'joint2 friction')
        """
        from jounce.identification.excitation import excite

        return excite(self, period, periods, harmonics, drives, weights, reach, margin, payload, starts, seed, progress)

    def live(
        self,
        dt: float,
        bandwidth: float | None = None,
        lag: float = 0.02,
        states: int = 6,
        noise: ArrayLike | None = None,
    ) -> "LiveRates":
        """Estimate rates and forces while the robot moves, from samples of its encoders that come one by one.

        A Kalman filter, with q^(m) as white noise, is a Butterworth filter of order m; it takes uneven time stamps and
        lost samples. With a lag it is a smoother, which is up to 14 times better: **without lag Q2d serves no
        feedback**, and of encoders of 12 bits only Q does. The rates are those of the joints that are sampled: of
        links, or of motors of elastic joints, of which `live.links()` gives those of the links.

        Parameters
        ----------
        dt : float
            Usual spacing of the samples, s.
        bandwidth : float, optional
            Highest frequency of the motion, Hz; by default the likeliest of nine, 1 to 25.6 Hz, for each joint.
        lag : float, optional
            By how much the rates are behind the samples, s; 0 to 1.
        states : int, optional
            Order m of the filter, 5 to 8.
        noise : float or (n,), optional
            Standard deviation of a sample, rad or m; by default estimated, of encoders by their steps.

        Returns
        -------
        LiveRates
            ``live.update(q, t)`` returns q to q4d at t - lag; ``live.forces()`` Q, Qd, Q2d; ``live.deviations`` and
            ``live.trust`` say how far to trust them.

        Raises
        ------
        JounceError
            If an argument is out of range, or the robot floats, has loops, joints of several screws or symbols.

        References
        ----------
        B. D. O. Anderson, J. B. Moore, "Optimal Filtering", Prentice-Hall, 1979.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot = jounce.load("planar2r")
        >>> live = robot.live(1e-3, bandwidth=8)
        >>> step = 2 * np.pi / 2**16  # of the encoders
        >>> for t in np.arange(0, 1, 1e-3):
        ...     q, qd, q2d, q3d, q4d = live.update(np.round(np.sin([t, 2 * t]) / step) * step, t)
        >>> bool(np.allclose(qd, [np.cos(live.t), 2 * np.cos(2 * live.t)], atol=1e-3)), live.trust.good.tolist()
        (True, [True, True])
        """
        from jounce.live.estimator import LiveRates

        return LiveRates(self, dt, bandwidth, lag, states, noise)

    def guard(self, motion: "Motion", limits: object = None, dt: float = 1e-3) -> "Guard":
        """Follow a planned motion within all limits while the robot moves, slower in time where they need it.

        Each tick goes on only if the robot can stop within the limits after it, else the stop that was verified before
        goes on. At ticks limits are kept to interpolation of tables, below 5e-4; between ticks Q may exceed its
        limit by that of Qd times dt / 2. Coulomb friction is taken with either sign, without its rates.

        Parameters
        ----------
        motion : Motion
            A motion of its joints, of which the guard keeps the path.
        limits : optional
            The name of an arm, a file, a robot or `Limits`, as for `with_limits`; by default those of the robot.
        dt : float, optional
            The spacing of ticks, s.

        Returns
        -------
        Guard
            ``guard.step(setpoint)`` is a tick; ``guard.c_source()`` the guard in C.

        Raises
        ------
        JounceError
            If standing still breaks a limit on the path, none is stated, a rate that limits bound jumps, or the robot
            floats, has loops, joints of several screws or symbols.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r").with_limits(effort=[60, 15], effort_rate=300)
        >>> guard = robot.guard(jounce.Motion.fourier([0, 0], [[1, 1]], [[0, 0]], 1.0, 1.0))
        >>> while (state := guard.step()).status != "end":
        ...     pass
        """
        from jounce.io.limits.reading import limits_from
        from jounce.live.guard import Guard

        m = self.mechanism
        robot = self if limits is None else with_mechanism(self, replace(m, limits=limits_from(m, limits)))
        return Guard(robot, motion, dt)

    def report(
        self,
        motion: "Motion | Identification[Any]",
        order: int | None = None,
        visuals: str | PathLike[str] | None = None,
        mesh_folders: Sequence[str | PathLike[str]] = (),
    ) -> "Report":
        """A page about the robot along a motion: the moving robot, its curves, its limits, in one file.

        Limits of the robot are checked. With elastic joints, order 2 shows motor positions, velocities, torques. Of
        what `identify` found, the page shows measured and computed forces, what is left with its spectrum, parameters.

        Parameters
        ----------
        motion : Motion or Identification
            A motion of its joints, or the result of `identify`, for which the other parameters are left out.
        order : int, optional
            The highest rate of Q on the page: 0, 1 or 2; by default 2, or as high as the rates of the motion are known.
        visuals : str or path, optional
            A URDF whose visuals show the links: boxes, cylinders, spheres and meshes, which trimesh reads; it is the
            file of the robot as a rule. Capsules stand for links without any.
        mesh_folders : sequence of str or path, optional
            Folders in which its meshes may be, besides that of the file and its packages.

        Returns
        -------
        Report
            With the page as `html`, and `save(path)`.

        Raises
        ------
        JounceError
            If the motion is of other joints, a rate is unknown or overflows, `visuals` no URDF, or plotly is missing.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r").with_limits(effort=[60, 15])
        >>> motion = jounce.Motion.trapezoidal([[0, 0], [1, 1]], 2.0, 10.0)
        >>> page = robot.report(motion)
        >>> page.check.ok, round(page.slowdown.factor, 4)
        (False, 0.4159)
        """
        from jounce._report.page import report

        return report(self, motion, order, visuals, mesh_folders)
