"""What starts from one robot and lies above its quantities: each method imports what does it."""

from collections.abc import Callable, Sequence
from math import pi
from os import PathLike
from typing import TYPE_CHECKING, Self

from jounce.core.deprecated import renamed_keywords
from jounce.core.typing import ArrayLike, DriveColumns, Equations, Frame, Language
from jounce.dynamics.quantities.names import QuantityName
from jounce.engine.engine import Engine

if TYPE_CHECKING:
    import casadi
    from jounce._codegen import Generated
    from jounce._codegen.symbolic import Symbolic
    from jounce._report import Report
    from jounce.identification import Excitation, Identification
    from jounce.motion import Motion


class Applications(Engine):
    """Methods of `Robot` that identify it, excite it, report on it, and write its equations elsewhere."""

    def identify(
        self,
        motion: "Motion",
        forces: ArrayLike | None = None,
        *,
        t: ArrayLike | None = None,
        drives: DriveColumns = ("damping", "friction", "offset"),
        eps: float | None = None,
        span: tuple[float, float] | None = None,
        band: float | None = None,
        weights: ArrayLike | None = None,
        deviations: ArrayLike | None = None,
        prior: float = 0.3,
        method: Equations = "inverse_dynamics",
    ) -> "Identification[Self]":
        """Identify the inertial parameters and drive terms from a motion and the forces measured along it.

        The robot is the first guess, such as that of a CAD model. Q = Y p is linear in the inertial parameters p and in
        those of drive terms. Weighted least squares find the base parameters, the combinations that the forces depend
        on, with standard deviations; each force has the variance of its residuals. Regressor and forces are averaged
        over cells of half a period of the motion's highest frequency, and the variances are those of the residuals at
        the frequencies of the motion, so that serially correlated noise does not make the deviations too small. The
        identified robot has bodies that can exist, nearest to the data, and to the model's own values where data are
        few.

        Parameters
        ----------
        motion : Motion
            As for `Robot.forces_along`, with q, qd, q2d; of a log, `jounce.load_motion` smooths it. Wrenches that it
            holds act, and if its positions have standard deviations, what follows from these weighs the forces.
        forces : (N, nv), optional
            Measured forces at `t`, N m or N, NaN for those not measured; by default the torques of the motion's log.
        t : (N,), optional
            Times of the forces, s; by default ``motion.times``.
        drives : bool, str or iterable of str, optional
            Drive terms to identify: "armature", "damping", "friction", "spring", "offset". Others keep their values.
        eps : float, optional
            Smoothing velocity of Coulomb friction, rad/s or m/s; by default that of each joint.
        span : (float, float), optional
            Times in s between which the data are used; the others test the result. By default all are used.
        band : float, optional
            Highest frequency of the forces in Hz; by default the one below which 99 % of the power of the model's is.
        weights : (nv,) or (N, nv), optional
            Factors of the inverse variances, 0 or more; 0 leaves forces out.
        deviations : float, (nv,) or (N, nv), optional
            Standard deviations of independent errors of the forces, N m or N; by default those of the residuals.
        prior : float, optional
            Relative standard deviation of the model's own inertial parameters: how near to them the bodies stay.
        method : {"inverse_dynamics", "momentum", "power"}, optional
            The equations. Those of momentum and power need no q2d: the balance of the generalized momentum, one row per
            force, and that of the energy, one row for all forces, which must all be measured. Both sides are filtered.

        Returns
        -------
        Identification

        Raises
        ------
        JounceError
            If there are no forces, a shape is wrong, a force is infinite, times do not increase or are outside of the
            motion, a weight is negative, or there are fewer measurements than parameters.

        Warns
        -----
        JounceWarning
            If the data do not determine some parameters, or forces seem to have the wrong sign or unit.

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
        from jounce.identification.estimation import identify

        return identify(self, motion, forces, t, drives, eps, span, band, weights, deviations, prior, method)

    def excite(
        self,
        *,
        period: float = 10.0,
        periods: int = 1,
        harmonics: int = 5,
        drives: DriveColumns = False,
        weights: ArrayLike | None = None,
        reach: float = pi,
        margin: float = 0.01,
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
            Drive terms that are to be identified too, as `Robot.regressor` takes them: "armature", "damping",
            "friction", "spring", "offset"; True for all.
        weights : (n,), optional
            Relative inverse variances of the measured forces; 0 leaves one out. By default the inverse squares of the
            effort limits; equal if a coordinate has none.
        reach : float, optional
            How far a revolute joint without position limits moves to either side of 0 (from an only limit twice as
            far), rad.
        margin : float, optional
            Share of each limit that is left.
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

        return excite(self, period, periods, harmonics, drives, weights, reach, margin, starts, seed, progress)

    def report(
        self,
        motion: "Motion",
        order: int | None = None,
        visuals: str | PathLike[str] | None = None,
        mesh_folders: Sequence[str | PathLike[str]] = (),
    ) -> "Report":
        """A page about the robot along a motion: the moving robot, its curves, its limits, in one file.

        Limits of the robot are checked. With elastic joints, order 2 shows motor positions, velocities, torques.

        Parameters
        ----------
        motion : Motion
            A motion of its joints.
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
            If the motion is of other joints, a rate is unknown or overflows, `visuals` is no URDF, or plotly is
            missing.

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

    @renamed_keywords(base="moving_base", force="overwrite")
    def codegen(
        self,
        lang: Language,
        order: int = 2,
        directory: str | PathLike[str] | None = None,
        *,
        outputs: Sequence[str] = ("inverse_dynamics",),
        wrench: bool = False,
        parameters: Sequence[str] = (),
        float32: bool = False,
        prefix: str | None = None,
        overwrite: bool = False,
        moving_base: bool = False,
    ) -> "Generated":
        """Write the robot's equations as source code that does not depend on jounce, with tests for your compiler.

        There is one function for each output, the recursion traced operation by operation for this robot, without
        loops, branches or memory allocation: ``PREFIX_inverse_dynamics(q, qd, q2d, q3d, q4d, Q, Qd, Q2d)``,
        ``PREFIX_jacobian_tool0_world(q, qd, q2d, J, Jd, J2d)``, ... ``make test`` in the folder compares the results
        with the closed form. SymPy symbols of the robot become parameters with their names.

        Parameters
        ----------
        lang : str
            The language: "c" (C99), "cpp" (C++11, and overloads for Eigen), "cuda", "javascript" (ES module), "julia",
            "latex" (a document), "matlab" (and GNU Octave), "python" (NumPy), "rust" (no_std).
        order : int
            The highest time derivative: 2 gives Q, Qd, Q2d.
        directory : str or path
            The output folder, new or empty; by default PREFIX-LANG in the working directory.
        outputs : sequence of str
            Quantities, each with its rates: the names of methods of `Robot`, "skew_coriolis_matrix" for the form
            "skew". A quantity of bodies needs a body and may have a frame: "poses:tool0", "jacobian:tool0:world". Of
            vectors, "inverse_dynamics.vjp" and "inverse_dynamics.jvp" are what `Kernel.vjp` and `Kernel.jvp` compute.
            Of elastic joints, "inverse_dynamics" is of the links, "motor_torques" of the motors.
        wrench : bool
            Whether the functions take wrenches W, Wd, ..., (nb, 6), if their quantity depends on them.
        parameters : sequence of str
            Data that become run-time parameters: "gravity", "masses", "lengths", "payload", "payload:BODY".
        float32 : bool
            Whether to generate single precision.
        prefix : str
            The prefix of all names in the code; by default the robot's name.
        overwrite : bool
            Write into a folder that is not empty: what an earlier run generated is replaced or removed, all else stays.
        moving_base : bool
            Whether functions of a fixed robot take the motion of its ground, as those of a floating robot do of its
            base: base_pose (4, 4), body to inertial frame, base_twist (6) in its own axes, and the rates of it.

        Returns
        -------
        Generated : its `directory`, `files`, and `operations`, the number of operations of each function.

        Raises
        ------
        JounceError
            If a language, output or parameter is unknown, an output needs a body, a name is not an identifier, the
            robot is too large, or the folder is not empty. Nothing is written then.

        Examples
        --------
        >>> import tempfile, jounce
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     made = jounce.load("iiwa14").codegen("c", directory=folder)
        >>> made.files
        ('Makefile', 'README.md', 'iiwa14.c', 'iiwa14.h', 'test_iiwa14.c')
        >>> made.operations
        {'iiwa14_inverse_dynamics': 2213}
        """
        from jounce._codegen.generate import codegen

        given = (outputs, wrench, parameters, float32, prefix, overwrite, moving_base)
        return codegen(self, lang, order, directory, *given)

    @renamed_keywords(base="moving_base")
    def casadi_function(
        self,
        quantity: QuantityName = "inverse_dynamics",
        order: int = 2,
        wrench: bool = False,
        *,
        body: str | None = None,
        frame: Frame = "body",
        parameters: Sequence[str] = (),
        moving_base: bool = False,
    ) -> "casadi.Function":
        """A quantity and its rates up to an order as a `casadi.Function`, built on SX and callable with MX.

        Parameters
        ----------
        quantity : str, optional
            The name of the quantity, that of the method of `Robot`.
        order : int, optional
            The highest rate of the quantity: 2 gives Q, Qd, Q2d.
        wrench : bool, optional
            Whether wrenches W, Wd, ... (nb, 6) on the bodies are inputs too.
        body, frame : str, optional
            Body or merged link, and frame, of poses, twists and Jacobians; without a body twists are those of all
            bodies.
        parameters : list of str, optional
            Data of the robot that become inputs:

            * "gravity": gravity (3);
            * "masses": masses (nb), that of a floating base first; bodies keep their COM, and inertia grows with the
              mass;
            * "lengths": lengths (nb, 3), the positions of the body frames in their parents';
            * "payload", or "payload:X" for a body or merged link X: payload_mass, payload_com (3) and payload_inertia
              (6) about the COM, xx xy xz yy yz zz, in the axes of X, the end of the robot if none is named; those of a
              second payload are payload2_mass, ...
        moving_base : bool, optional
            Whether the motion of the ground is an input, as that of a floating base is: base_pose (4, 4), body to
            inertial frame, base_twist (6, angular; linear) in the axes of the base, and the rates of it.

        Returns
        -------
        casadi.Function
            Named after the quantity, body and frame. Inputs q, qd, q2d, ... (n), then W, Wd, ..., the motion of the
            base, q_dependent (N - n) if loops are closed, the positions of all other joints, and the parameters;
            outputs the quantity and its rates under the names of its symbol, Q, Qd, Q2d, ...: columns of vectors, 1 x 1
            of scalars. The matrices of partial derivatives P stand one below the other, (3 nv, nv), those of Pd are (4
            nv, nv).

        Raises
        ------
        JounceError
            If a name is unknown, the quantity needs a body, the robot holds symbols, or CasADi is missing.

        Examples
        --------
        >>> import casadi, jounce
        >>> robot = jounce.load("iiwa14")
        >>> F = robot.casadi_function(order=1, parameters=["payload"])
        >>> F.name_in()
        ['q', 'qd', 'q2d', 'q3d', 'payload_mass', 'payload_com', 'payload_inertia']
        >>> q, m = casadi.MX.sym("q", 7), casadi.MX.sym("m")
        >>> at_rest = F(q=q, payload_mass=m, payload_com=[0, 0, 0.1])  # what is not named is zero
        >>> casadi.jacobian(at_rest["Q"], q).shape, casadi.jacobian(at_rest["Q"], m).shape
        ((7, 7), (7, 1))
        >>> robot.casadi_function("jacobian", order=1, body="link7", frame="world")
        Function(jacobian_link7_world:(q[7],qd[7])->(J[6x7],Jd[6x7]) SXFunction)
        """
        from jounce._codegen.casadi import casadi_function

        return casadi_function(self, quantity, order, wrench, body, frame, parameters, moving_base)

    @renamed_keywords(base="moving_base")
    def symbolic(self, moving_base: bool = False) -> "Symbolic":
        """The equations of motion as SymPy expressions: every quantity, and its rates.

        Expressions are multiplied out in sines and cosines of sums of angles, so that equal ones look equal; the common
        factors of all terms stand in front. The robot may hold SymPy symbols, polynomials of them, sines and cosines;
        its numbers are read as the decimals that they print as.

        Parameters
        ----------
        moving_base : bool, optional
            Whether the ground of a fixed robot moves, with symbols of its pose and twist, as a floating base does,
            whose six rows come first.

        Returns
        -------
        Symbolic
            ``S.q, S.qd, ..., S.Q, S.Qd, S.Q2d, S.M, ..., S.poses("tool0")``, see `Symbolic`.

        Raises
        ------
        JounceError
            If the robot contains anything but numbers and real SymPy expressions, or a symbol with the name of a
            coordinate, or SymPy is missing. An expression that is too large raises it on access.

        References
        ----------
        Müller & Kumar, Section 6.1, for the results of the planar 2R.

        Examples
        --------
        >>> import jounce, sympy
        >>> L1, L2, m1, m2, g = sympy.symbols("L1 L2 m1 m2 g")
        >>> S = jounce.load("planar2r", L1=L1, L2=L2, m1=m1, m2=m2, g=g).symbolic()
        >>> S.M[0, 1]
        L2*m2*(L1*cos(q2) + L2)
        >>> S.Qgravd[1]
        -L2*g*m2*(qdot1*sin(q1 + q2) + qdot2*sin(q1 + q2))
        >>> S.twists("body2", frame="world")[3]
        -L1*qdot1*sin(q1)
        >>> print(sympy.latex(S.q4d.T))
        \\left[\\begin{matrix}\\ddddot{q}_{1} & \\ddddot{q}_{2}\\end{matrix}\\right]
        """
        from jounce._codegen.symbolic import symbolic

        return symbolic(self, moving_base)
