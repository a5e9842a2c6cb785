"""A robot's equations written elsewhere: source code, CasADi functions, SymPy expressions."""

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING

from jounce.core.errors import door
from jounce.core.typing import Frame, Language
from jounce.dynamics.quantities.names import QuantityName
from jounce.engine.engine import Engine

if TYPE_CHECKING:
    import casadi
    from jounce._codegen import Generated
    from jounce._codegen.symbolic import Symbolic
    from jounce.live.estimator import LiveRates


@door
class Exports(Engine):
    """Methods of `Robot` that write its equations elsewhere.

    Each method imports what it needs.
    """

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
        live: "LiveRates | None" = None,
    ) -> "Generated":
        """Write the robot's equations as source code that is independent of jounce.

        Tests for your compiler are included.

        There is one function for each output, the recursion traced operation by operation for this robot, without
        loops, branches or memory allocation: ``PREFIX_inverse_dynamics(q, qd, q2d, q3d, q4d, Q, Qd, Q2d)``,
        ``PREFIX_jacobian_tool0_world(q, qd, q2d, J, Jd, J2d)``, ... ``make test`` in the folder compares the results
        with the closed form. SymPy symbols of the robot become parameters with their names.

        Parameters
        ----------
        lang : str
            The language: "c" (C99), "casadi" (C with derivatives for `casadi.external`), "cpp" (C++11, and overloads
            for Eigen), "cuda", "javascript" (ES module), "julia", "latex" (a document), "matlab" (and GNU Octave),
            "python" (NumPy), "rust" (no_std).
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
            Data that become run-time parameters: "gravity", "masses", "lengths", "payload", "payload:BODY", and
            of elastic joints "stiffness", "rotor".
        float32 : bool
            Whether to generate single precision.
        prefix : str
            The prefix of all names in the code; by default the robot's name.
        overwrite : bool
            Write into a folder that is not empty: what an earlier run generated is replaced or removed, all else stays.
        moving_base : bool
            Whether functions of a fixed robot take the motion of its ground, as those of a floating robot do of its
            base: base_pose (4, 4), body to inertial frame, base_twist (6) in its own axes, and the rates of it.
        live : LiveRates
            In C and C++: an estimator of rates from encoders to add, ``robot.live(dt, bandwidth=..., noise=...)``.

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
        from jounce._codegen.options import CodegenOptions

        options = CodegenOptions(
            lang=lang, order=order, outputs=outputs, wrench=wrench, parameters=parameters, float32=float32,
            prefix=prefix, moving_base=moving_base, live=live,
        )  # fmt: skip
        return codegen(self, options, directory, overwrite)

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
        native: bool = False,
        points: int = 1,
    ) -> "casadi.Function":
        """Return a quantity and its rates as a `casadi.Function`.

        It takes a state, or all points of a motion.

        It is built on SX, or runs native code, with exact first and second derivatives: solvers of trajectories take a
        fraction of the time then.

        Parameters
        ----------
        quantity : str, optional
            The name of the quantity, that of the method of `Robot`.
        order : int, optional
            The highest rate of the quantity: 2 gives Q, Qd, Q2d.
        wrench : bool, optional
            Whether wrenches W, Wd, ... (nb, 6) on the bodies are inputs too.
        body, frame : str, optional
            Body or merged link, and frame, of poses, twists and Jacobians; twists are of all bodies by default.
        parameters : list of str, optional
            Data of the robot that become inputs:

            * "gravity": gravity (3);
            * "masses": masses (nb), that of a floating base first; bodies keep their COM, and inertia grows with the
              mass;
            * "lengths": lengths (nb, 3), the positions of the body frames in their parents';
            * "payload", or "payload:X" for a body or merged link X: payload_mass, payload_com (3) and payload_inertia
              (6) about the COM, xx xy xz yy yz zz, in the axes of X, the end of the robot if none is named; those of a
              second payload are payload2_mass, ...
            * "stiffness", "rotor" (n): of linear springs, and of the rotors of motors, behind elastic joints.
        moving_base : bool, optional
            Whether the motion of the ground is an input, as that of a floating base is: base_pose (4, 4), body to
            inertial frame, base_twist (6, angular; linear) in the axes of the base, and the rates of it.
        native : bool, optional
            Whether native code computes the values, the Jacobian, and the Hessian of weighted sums of the results, of
            robots with a fixed base and open loops whose joints have one column each; there are no third derivatives.
            The function and its code are kept until the process ends.
        points : int, optional
            How many states a call takes and returns, in columns: of vectors (n, points). Of native functions
            those of a whole motion, as each evaluation takes some 20 us, plus about 1 us per state.

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
            If a name is unknown, the quantity needs a body, the robot holds symbols, CasADi is missing, or native code
            cannot serve what is asked for; a native function called with numbers raises it for wrong shapes too.

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
        >>> robot.casadi_function(order=0, native=True, points=30)
        Callback(inverse_dynamics:(q[7x30],qd[7x30],q2d[7x30])->(Q[7x30]) CallbackInternal)
        """
        from jounce._codegen.casadi.function import CasadiOptions, casadi_function

        options = CasadiOptions(
            quantity=quantity, order=order, wrench=wrench, body=body, frame=frame, parameters=parameters,
            moving_base=moving_base, native=native, points=points,
        )  # fmt: skip
        return casadi_function(self, options)

    def symbolic(self, moving_base: bool = False) -> "Symbolic":
        """Return the equations of motion as SymPy expressions.

        They are all quantities with their rates.

        Expressions are multiplied out in sines and cosines of sums of angles, so that equal ones look equal; what
        multiplies one of them is joined, ``(l + q2)*cos(q1)``, with common factors in front. Equations of robots with
        closed loops are those in all coordinates, with the constraint ``S.gap = 0``. The robot may hold SymPy symbols,
        polynomials of them, sines and cosines; its numbers are read as the decimals that they print as.

        Parameters
        ----------
        moving_base : bool, optional
            Whether the ground of a fixed robot moves, with a pose and a twist, as a floating base (first six rows)
            does.

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
        -L2*g*m2*(qdot1 + qdot2)*sin(q1 + q2)
        >>> S.twists("body2", frame="world")[3]
        -L1*qdot1*sin(q1)
        >>> print(sympy.latex(S.q4d.T))
        \\left[\\begin{matrix}\\ddddot{q}_{1} & \\ddddot{q}_{2}\\end{matrix}\\right]
        """
        from jounce._codegen.symbolic import symbolic

        return symbolic(self, moving_base)
