"""What starts from one robot and lies above its quantities: each method imports what does it.

`Identifications` are the methods that take logs; `Applications` adds those that excite, follow, guard and report.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import pi
from os import PathLike
from typing import TYPE_CHECKING, Any, Self

from jounce.core.errors import door
from jounce.core.typing import ArrayLike, DriveTerms
from jounce.engine.engine import with_mechanism
from jounce.robot.exports import Exports

if TYPE_CHECKING:
    from jounce._report import Report
    from jounce.identification import Excitation, Identification, Payload
    from jounce.live.estimator import LiveRates
    from jounce.live.guard import Guard
    from jounce.motion import Motion
    from jounce.motion.poses import Poses


@door
class Identifications(Exports):
    """Methods of `Robot` that identify it from logs of motions."""

    def identify(
        self,
        motion: "Motion | Poses | Sequence[Motion] | Mapping[str, Motion]",
        forces: ArrayLike | Sequence[ArrayLike | None] | None = None,
        *,
        t: ArrayLike | Sequence[ArrayLike | None] | None = None,
        drives: DriveTerms = ("damping", "friction", "stribeck", "offset", "load_friction"),
        eps: float | None = None,
        span: tuple[float, float] | None = None,
        band: float | None = None,
        weights: ArrayLike | Sequence[ArrayLike | None] | None = None,
        deviations: ArrayLike | Sequence[ArrayLike | None] | None = None,
        prior: float = 0.3,
        test: int | str | Sequence[int | str] = (),
        delay: float | None = None,
        torques_as_given: bool = False,
    ) -> "Identification[Self]":
        """Identify inertial parameters and drive terms from motions with measured forces.

        The robot is the first guess, such as that of a CAD model. Q = Y p is linear in the inertial parameters p and in
        those of drive terms. Weighted least squares find the base parameters, the combinations that the forces depend
        on, with standard deviations. Regressor and forces are averaged over cells of half a period of the motion's
        highest frequency. Each force has the variance of its residuals; errors e of the accelerations that the motion's
        smoothing states make forces M(p) e too, and the regressor is taken without their estimate by the residuals, as
        parameters would be too small otherwise. Deviations follow from the spectrum of the residuals, so that serially
        correlated noise does not make them too small. Smoothed positions that are multiples of a step may be off by a
        constant that no fit sees: by half a step where an encoder floors, by none where it rounds. Deviations hold one
        of half a step for each joint; a note says where it is most of them. The identified robot has physically
        consistent inertias, nearest to the data, and to the model's own values where data are few.

        Several logs make one fit. Each has its own smoothing, band, cells, variances and spectra; deviations grow where
        logs differ by more than they state, as the halves of one log do.

        Poses at rest, as `jounce.load_poses` reads them, determine first moments, offsets, springs, and Coulomb
        friction of joints that came from both sides. What rest does not determine is named, has no row in the table,
        and stays as it is in the model.

        Parameters
        ----------
        motion : Motion, or several in a list or a dict by name; or Poses
            As for `Robot.forces_along`, with q, qd, q2d; of a log, `jounce.load_motion` smooths it. Wrenches that it
            holds act. If its accelerations have standard deviations, their errors are taken into account. Of several,
            `forces`, `t`, `weights` and `deviations` are lists of one entry per motion, or one array for all.
        forces : (N, nv), optional
            Measured forces at `t`, N m or N, NaN for those not measured; by default the torques of the motion's log.
        t : (N,), optional
            Times of the forces, s; by default ``motion.times``.
        drives : bool, str or iterable of str, optional
            Drive terms to identify: those of `with_drives`. Others keep their values; "stribeck" and "load_friction"
            are of joints whose data ask for them.
        eps : float, optional
            Smoothing velocity of Coulomb friction, rad/s or m/s; by default that of each joint.
        span : (float, float), optional
            Times in s between which the data are used; the others test the result. By default all are used.
        band : float, optional
            Use forces up to this frequency, Hz; by default the band that contains 99 % of the predicted power.
        weights : (nv,) or (N, nv), optional
            Factors of the inverse variances, 0 or more; 0 leaves forces out.
        deviations : float, (nv,) or (N, nv), optional
            Standard deviations of independent errors of the forces, N m or N; by default those of the residuals.
        prior : float, optional
            Relative standard deviation of the model's own inertial parameters: how near to them the bodies stay.
        test : int, str or sequence of them, optional
            Motions used for validation only: places in the list, or names of the dict.
        delay : float, optional
            Delay of the forces relative to the positions, s. By default it is estimated, and removed if it is certain.
        torques_as_given : bool, optional
            Whether torques of another scale than the model's at most joints, such as currents, are read as they are.

        Returns
        -------
        Identification

        Raises
        ------
        JounceError
            If there are no forces, a shape is wrong, a force is infinite, times do not increase or are outside of the
            motion, a weight is negative, there are fewer measurements than parameters, or forces follow those of the
            model at another scale at most joints: below 0.3, as currents do, or above 10.

        Warns
        -----
        JounceWarning
            If the data do not determine some parameters, forces are late or seem to have the wrong sign or unit, or
            others act too.

        References
        ----------
        M. Gautier, W. Khalil, "On the Identification of the Inertial Parameters of Robots", IEEE Conference on Decision
        and Control, 1988.
        C. Gaz, M. Cognetti, A. Oliva, P. Robuffo Giordano, A. De Luca, "Dynamic Identification of the Franka Emika
        Panda Robot With Retrieval of Feasible Parameters Using Penalty-Based Optimization", IEEE Robotics and
        Automation Letters 4(4), 2019.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("iiwa14")
        >>> motion = jounce.load_motion("paper", robot)
        >>> p = robot.inertial_parameters
        >>> Q = robot.with_inertial_parameters(1.2 * p).forces_along(motion, order=0).forces[0]
        >>> found = robot.identify(motion, Q)
        >>> found.rank, len(found.names)
        (64, 64)
        """
        from jounce.identification.estimation import IdentifyOptions, identify

        options = IdentifyOptions(
            forces,
            t,
            weights,
            deviations,
            drives,
            eps=eps,
            span=span,
            band=band,
            prior=prior,
            test=test,
            delay=delay,
            as_given=torques_as_given,
        )
        return identify(self, motion, options)

    def payload(
        self,
        with_load: "Motion | Poses",
        without_load: "Motion | Poses | None" = None,
        *,
        body: str | None = None,
        drives: DriveTerms = ("damping", "friction", "stribeck", "offset", "load_friction"),
        mass: float | None = None,
        torques_as_given: bool = False,
    ) -> "Payload[Self]":
        """Identify a load on a body from logs with and without it.

        Each log is fitted as by `identify`, with friction of its own. Their base parameters then differ by K x, with
        the ten inertial parameters x of the load; what that does not explain is stated as chi^2, and deviations grow
        with it. Without a second log the robot is taken as it is; otherwise it needs to be known roughly only.

        Parameters
        ----------
        with_load, without_load : Motion or Poses
            Logs with measured torques, as `jounce.load_motion` reads them; or poses at rest, of `jounce.load_poses`,
            which determine mass and centre of mass.
        body : str, optional
            The body or link that carries the load, which is described in its frame; by default the last body.
        drives : bool, str or iterable of str, optional
            Drive terms that each log has its own of, as of `identify`, with eps of each joint.
        mass : float, optional
            The known mass of the load, kg: it calibrates the torques, with one factor per joint.
        torques_as_given : bool, optional
            Whether torques of another scale than the model's at most joints, such as currents, are read as they are.

        Returns
        -------
        Payload
            The estimate with deviations, the nearest body that can exist, lines for controllers, the robot with it.

        Raises
        ------
        JounceError
            If a log has no torques, all are 0 or of another scale than the model's, as for `identify`; the body is
            unknown, or fixed to the ground; or the mass is negative.

        Warns
        -----
        JounceWarning
            If the load changes, logs differ by more than a load or do not determine it, or a cable, hose or push acts.

        Examples
        --------
        >>> import jounce
        >>> from dataclasses import replace
        >>> robot = jounce.load("iiwa14")
        >>> motion = jounce.load_motion("paper", robot).with_step(0.01)
        >>> p = robot.inertial_parameters
        >>> p[-10] += 2.0  # a point mass at the origin of the last body
        >>> loaded = robot.with_inertial_parameters(p)
        >>> logs = [replace(motion, torques=(motion.times, arm.forces_along(motion, order=0).forces[0]))
        ...         for arm in (loaded, robot)]
        >>> load = robot.payload(*logs)
        >>> round(load.mass, 4)
        2.0
        """
        from jounce.identification.payload import PayloadOptions, identify_payload

        return identify_payload(self, with_load, without_load, PayloadOptions(body, drives, mass, torques_as_given))

    def identify_stiffness(
        self,
        links: "Motion",
        motors: "Motion | None" = None,
        *,
        deflections: "Motion | None" = None,
        gear: ArrayLike | Mapping[str, float] = 1.0,
        rotor: ArrayLike | Mapping[str, float] | None = None,
        delay: float | None = None,
        torques_as_given: bool = False,
    ) -> "Identification[Self]":
        """Identify the stiffness of elastic joints from a log.

        The log holds the positions of links and motors, or deflections of the springs, and torques.

        Deflections ``theta / gear - q = tau / K + c + h sign(qd) + e qd`` are regressed on torques of the springs,
        with a hysteresis h K, and encoders that are not at zero and apart by a time e. A delay of the torques is found
        and taken out. Deviations follow from the spectrum of the residuals. They hold by which factor torques differ
        from those of the model, where that is certain, and by how much other columns, as of a wrong gear ratio, move K.

        Parameters
        ----------
        links, motors : Motion
            The log by the columns of its links, with torques that springs carry, and by those of its motors, as
            `jounce.load_motion` reads them. At joints without measured torques those of the model serve.
        deflections : Motion, optional
            In place of motors: measured deflections, positions of links less those behind the gears, rad or m, as
            ``jounce.load_motion(path, robot, columns="{joint}.deflection", allow_noise=True)`` reads them. They need
            measured torques.
        gear : number, array or mapping, optional
            Motor speed over joint speed, if positions of motors are not over gear ratios: for all joints or by name.
        rotor : number, array or mapping, optional
            Inertias of the rotors seen from the links, kg m^2 or kg, as of `elastic`; by default those of the robot.
        delay : float, optional
            Delay of the torques relative to positions, s, as for `identify`.
        torques_as_given : bool, optional
            Whether torques of another scale than the model's at most joints, such as currents, are read as they are.

        Returns
        -------
        Identification
            The robot with elastic joints, which keeps the stiffness of joints of which the log does not determine it;
            a table of stiffnesses, hysteresis and delays of encoders. What is measured are deflections, rad or m.

        Raises
        ------
        JounceError
            If both motors and deflections are given or none, there are deflections without torques, stiffnesses are
            negative or none is determined, motors follow the links of other joints or are copies of them, gear ratios
            seem to be missing, all torques are 0 or of another scale than the model's, as for `identify`, or joints
            have no rotor inertia, or springs that are not linear.

        Warns
        -----
        JounceWarning
            If a stiffness is not determined, torques or encoders are late, torques differ from those of the model by
            more than 5 % or do not follow them, or deflections follow more than torques.

        Examples
        --------
        >>> import jounce
        >>> from dataclasses import replace
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> links = jounce.Motion.fourier([0.3, 0.2], [[0.5, 0.2], [0.1, 0.4]], [[0.1, 0.3], [0.5, 0.2]], 3.0, 8.0)
        >>> motors = jounce.Motion.through(links.times, arm.motors_along(links).positions[0])
        >>> links = replace(links, torques=(links.times, arm.forces_along(links, order=0).forces[0]))
        >>> found = arm.identify_stiffness(links, motors)
        >>> found.robot.elasticity.stiffness.round(3)
        array([800., 600.])
        """
        from jounce.identification.stiffness import SpringLog, identify_stiffness

        return identify_stiffness(self, SpringLog(links, motors, deflections, gear), rotor, delay, torques_as_given)


@door
class Applications(Identifications):
    """Methods of `Robot` for excitation, live estimation and reports."""

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
        """Find a motion within all limits that determines the parameters best.

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
        from jounce.identification.excitation import ExcitationOptions, excite

        options = ExcitationOptions(
            period, periods, harmonics, drives,
            weights=weights, reach=reach, margin=margin, payload=payload, starts=starts, seed=seed,
        )  # fmt: skip
        return excite(self, options, progress)

    def live(
        self,
        dt: float,
        bandwidth: float | None = None,
        lag: float = 0.02,
        states: int = 6,
        noise: ArrayLike | None = None,
    ) -> "LiveRates":
        """Estimate rates and forces from encoder samples that come one by one.

        A Kalman filter, with q^(m) as white noise, is a Butterworth filter of order m; it takes uneven time stamps and
        lost samples. With a lag it is a smoother, which is up to 14 times better. **With lag 0, Q2d is too noisy for
        feedback**; with encoders of 12 bits, only Q is good enough. The rates are those of the joints that are sampled:
        of links, or of motors of elastic joints, of which `live.links()` gives those of the links.

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
        """Follow a planned motion live within all limits.

        The motion is slowed down in time where the limits need it.

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
        from jounce.io.limit_files import limits_from
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
        """Make a page about the robot along a motion, in one file.

        It shows the moving robot, its curves and its limits.

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
