"""Rows of the equations of motion: forces, their matrices, the accelerations they cause, and regressors.

`Forces` has inverse dynamics and gravity, `Matrices` the matrices that the forces consist of, `Forward` the
accelerations that forces cause, `Regressors` what is linear in the inertial parameters, without them.
"""

from dataclasses import replace

from jounce.dynamics import closed_form, drive_terms, forward, paper
from jounce.dynamics.quantities.row import WITHOUT_CONTACTS, DriveTrains, Inputs, Outputs, Printed, quantity, row_vector
from jounce.dynamics.recursion import articulated, forces, matrices, regressor
from jounce.dynamics.state import JointMotion, Law, State
from jounce.model.drive_trains import ALL_DRIVE_TERMS, load_friction, load_friction_of_motors
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series


def _loaded_forces(law: Law, m: Mechanism, x: State) -> Series:
    Q = law(m, x).map(lambda Q: Q[..., None])
    return row_vector(Q + drive_terms.load_forces(m, load_friction, x.q, Q))


class Forces:
    """Rows of forces."""

    @quantity(
        takes=Inputs(rates=3, wrenches=True),
        gives=Outputs("Q", ("nv",), unit="N m or, for coordinates in m, N"),
        drives=DriveTrains(
            ALL_DRIVE_TERMS, law=lambda m, x: row_vector(drive_terms.forces(m, x.q, m.acting)), load=_loaded_forces
        ),
        closed_form=lambda m, x: row_vector(closed_form.evaluate_state(m, x).Q),
        paper=lambda m, x: row_vector(paper.inverse_dynamics(m, x)),
        sweep=forces.MOVING_SWEEP,
        balanced=True,
        of_motors="motor_torques",
        printed=Printed(
            caption="generalized forces",
            meaning="Q = M(q) q2d + C(q, qd) qd + Qgrav(q): generalized forces.",
            tex=r"Q = M(q)\,\ddot{q} + C(q, \dot{q})\,\dot{q} + Q_{\mathrm{grav}}(q)",
            wrench_term="J^T W",
            wrench_tex="J^T W",
        ),
    )
    @staticmethod
    def inverse_dynamics(m: Mechanism, x: State) -> Series:
        """Compute the generalized forces Q of a motion and their rates.

        The algorithm is RNEA with rates Qd, Q2d, ... ``Q = M(q) q2d + C(q, qd) qd + Qgrav(q) + Qext``, with the drive
        terms that act added. With `contacts`, less what their wrenches do: six rows of the base that vanish, to
        rounding, and the torques of the joints.

        References
        ----------
        Müller & Kumar, (EOM1), (EOM1stOrder), (EOM2ndOrder); as a recursion to order 2, G. Buondonno, A. De Luca, IROS
        2015; to any order, S. Kumar, A. Müller, ICRA 2021.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> Q, Qd = robot.inverse_dynamics([0, 0], [1, 0], [0, 0], [0, 0])
        >>> Q.round(4), Qd.round(4)
        (array([29.43,  9.81]), array([0., 0.]))
        """
        return row_vector(forces.rnea(forces.MOVING_SWEEP, m, x.q, x.W, x.base))

    @quantity(
        takes=Inputs(rates=1),
        gives=Outputs("Qgrav", ("nv",), unit="N m or, for coordinates in m, N"),
        needs=(WITHOUT_CONTACTS,),
        closed_form=lambda m, x: row_vector(closed_form.evaluate_state(m, x).Qgrav),
        paper=lambda m, x: row_vector(paper.gravity_forces(m, x)),
        sweep=forces.RESTING_SWEEP,
        printed=Printed(
            meaning="Qgrav = dU/dq: the forces that hold the robot up against gravity.",
            tex=r"Q_{\mathrm{grav}} = \partial U / \partial q",
            tex_symbol=r"Q_{\mathrm{grav}}",
        ),
    )
    @staticmethod
    def gravity_forces(m: Mechanism, x: State) -> Series:
        """Compute the generalized gravity forces Qgrav(q) and their rates.

        Qgrav = dU/dq, with U the potential energy of gravity.

        References
        ----------
        Müller & Kumar, (25), (Qgravdot), (52).

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").gravity_forces([0, 0])
        array([29.43,  9.81])
        """
        return row_vector(forces.rnea(forces.RESTING_SWEEP, m, x.q, None, x.base))


class Matrices:
    """Rows of matrices."""

    @quantity(
        takes=Inputs(rates=1, without_base=("body",)),
        gives=Outputs("M", ("nv", "nv"), unit="kg m^2, kg m or kg"),
        drives=DriveTrains(("armature",), law=lambda m, x: drive_terms.armature_matrix(m)),
        closed_form=lambda m, x: closed_form.evaluate_state(m, x).gM,
        paper=paper.mass_matrix,
        printed=Printed(
            caption="generalized mass matrix",
            meaning="M(q): the generalized mass matrix, symmetric.",
            tex=r"T = \tfrac{1}{2}\,\dot{q}^T M\,\dot{q}",
            returns="Symmetric.",
        ),
    )
    @staticmethod
    def mass_matrix(m: Mechanism, x: State) -> Series:
        """Compute the generalized mass matrix M(q) and its rates Md, M2d, ...

        ``M(q) = J^T M J``, with the inertia matrix of the system on the right, by CRBA with rates. The armature that
        acts is added, see `with_drives`.

        References
        ----------
        Müller & Kumar, (MC), (Mdot), (Mddot); M. W. Walker, D. E. Orin, J. Dyn. Sys. Meas. Control 104(3), 1982, for
        composite bodies.

        Examples
        --------
        >>> import jounce
        >>> M, Md = jounce.load("planar2r").mass_matrix([0, 0], [0, 1])
        >>> M
        array([[5., 2.],
               [2., 1.]])
        """
        return matrices.mass_matrix(m, x.q)

    @quantity(
        takes=Inputs(rates=2, options=("form",)),
        gives=Outputs("C", ("nv", "nv"), unit="kg m^2/s, kg m/s or kg/s"),
        closed_form=lambda m, x: closed_form.evaluate_state(m, x).gC,
        paper=paper.coriolis_matrix,
        turns_with=mass_matrix,
        printed=Printed(
            caption="Coriolis matrix of the paper",
            meaning="C(q, qd): the paper's Coriolis matrix; passivity-based control takes Cbar, skew_coriolis_matrix.",
            tex=r"C\,\dot{q} = Q - M\,\ddot{q} - Q_{\mathrm{grav}}",
        ),
    )
    @staticmethod
    def coriolis_matrix(m: Mechanism, x: State) -> Series:
        """Compute the Coriolis matrix C(q, qd) of the paper and its rates.

        With ``form="skew"`` it is the one for passivity-based control. Both give the same forces C qd. For the skew
        form, (Cbar), ``Md - 2 C`` is skew-symmetric, and so are its rates; for the paper's, (Csys), only
        ``qd^T (Md - 2 C) qd = 0``.

        References
        ----------
        Müller & Kumar, (MC), (Cdot), (45), (Cbar); S. Echeandia, P. M. Wensing, J. Comput. Nonlinear Dynam. 16(9),
        2021, for composite bodies.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot, q, qd = jounce.load("iiwa14"), np.full(7, 0.3), np.ones(7)
        >>> M, Md = robot.mass_matrix(q, qd)
        >>> S = Md - 2 * robot.coriolis_matrix(q, qd, form="skew")
        >>> bool(abs(S + S.T).max() < 1e-13)
        True
        """
        return matrices.coriolis_matrix(m, x.q, x.base)

    @quantity(
        takes=Inputs(rates=2),
        gives=Outputs("Cbar", ("nv", "nv"), unit="kg m^2/s, kg m/s or kg/s"),
        closed_form=lambda m, x: closed_form.evaluate_state(m, x).gCbar,
        turns_with=mass_matrix,
        printed=Printed(
            caption="Coriolis matrix for passivity-based control",
            meaning="Cbar(q, qd): the Coriolis matrix for which Md - 2 Cbar is skew-symmetric.",
            tex=r"(\dot{M} - 2 \bar{C}) + (\dot{M} - 2 \bar{C})^T = 0",
            tex_symbol=r"\bar{C}",
        ),
    )
    @staticmethod
    def skew_coriolis_matrix(m: Mechanism, x: State) -> Series:
        """Compute the Coriolis matrix Cbar(q, qd) for passivity-based control.

        It is ``coriolis_matrix(..., form="skew")``. ``Md - 2 Cbar`` is skew-symmetric, and so are its rates.

        References
        ----------
        Müller & Kumar, (Cbar).

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot, q, qd = jounce.load("iiwa14"), np.full(7, 0.3), np.ones(7)
        >>> bool((robot.skew_coriolis_matrix(q, qd) == robot.coriolis_matrix(q, qd, form="skew")).all())
        True
        """
        return matrices.skew_coriolis_matrix(m, x.q, x.base)


def _loaded_accelerations(law: Law, m: Mechanism, x: State) -> Series:
    """Return accelerations from forces less the friction by the load."""
    # Rates of the friction take those of q, which are the results: each is known when the next is computed.
    moving = Series(lambda k: x.q[k] if k < 2 else accelerations[k - 2][..., -m.n :, None])
    forces_without_friction = x.Q - drive_terms.load_forces(m, load_friction_of_motors, moving, x.Q)
    accelerations = law(m, replace(x, Q=forces_without_friction))
    return accelerations


class Forward:
    """Rows of accelerations."""

    @quantity(
        takes=Inputs(rates=3, forces=True, wrenches=True),
        gives=Outputs("q", ("nv",), first_rate=2, unit="rad/s^2 or, for coordinates in m, m/s^2"),
        needs=(WITHOUT_CONTACTS,),
        drives=DriveTrains(ALL_DRIVE_TERMS, load=_loaded_accelerations),
        sweep=forces.MOVING_SWEEP,
        of_motors="elastic_forward_dynamics",
        printed=Printed(
            caption="accelerations of the coordinates",
            meaning="q2d = M^-1 (Q - C qd - Qgrav): the accelerations that generalized forces Q cause.",
            tex=r"\ddot{q} = M^{-1} \left(Q - C(q, \dot{q})\,\dot{q} - Q_{\mathrm{grav}}(q)\right)",
            wrench_term="-M^-1 J^T W",
            wrench_tex="-M^{-1} J^T W",
            returns="If the robot floats, (Vd; q2d), (V2d; q3d), ...: they begin with the rates of the components of"
            " the base's twist.",
        ),
    )
    @staticmethod
    def forward_dynamics(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute accelerations q2d from generalized forces.

        They have as many rates as Q has. ``q2d = M^-1 (Q - C qd - Qgrav - Qext)``: the inverse of `inverse_dynamics`,
        of every order. Drive terms that act are subtracted from Q; armature that acts is in M. Of a robot that floats,
        base is (C, V), and the acceleration of the base is found too: ``(Vd; q2d)``.

        Errors grow with each rate by damping over inertia, by the slope of friction over inertia, by stiffness over
        inertia with each second one. Rates that are off by more than 1e-6 of their size are refused: an
        `UncertainError` names them. Compiled kernels and traced arrays of JAX check nothing.

        Where the mass matrix is singular at one position, results are infinite or NaN, with NumPy's warning. Compiled
        kernels, generated code and arrays of JAX do not look at it: they may give large numbers that are rounding.

        References
        ----------
        Müller & Kumar (EOM1); R. Featherstone, Rigid Body Dynamics Algorithms, 6.3 for the factors of M, 7.3 for the
        articulated bodies that robots with long branches take.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot = jounce.load("iiwa14")
        >>> q, qd, q2d, q3d = np.ones((4, 7))
        >>> Q, Qd = robot.inverse_dynamics(q, qd, q2d, q3d)
        >>> np.round(robot.forward_dynamics(q, qd, Q, Qd), 9) + 0.0
        array([[1., 1., 1., 1., 1., 1., 1.],
               [1., 1., 1., 1., 1., 1., 1.]])
        """
        if method == "closed_form" and not m.closure:
            return row_vector(forward.solve_dense(m, x.q, x.Q, x.W, x.base))
        inverse = Forces.inverse_dynamics.free_law(method, m)
        # M is factored once, for all orders: by articulated bodies, or as a matrix where that takes fewer operations.
        if articulated.has_deep_branches(m) and not m.closure:
            M: forward.Solver = articulated.ArticulatedBodies.of(m, x.q[0])
        else:
            M = Factors.of(Matrices.mass_matrix.law(method, m)(m, x)[0])

        def required(q: Series, base: JointMotion | None) -> Series:
            return inverse(m, replace(x, q=q, base=base)).map(lambda Q: Q[..., None])

        return row_vector(forward.solve_with_inverse_dynamics(M, required, m, x.q, x.Q, x.base))


DRIVE_COLUMNS = "With drives, k nb columns more for k terms: nb in 10 nb counts a floating base, that in k nb does not."


class Regressors:
    """Rows of regressors."""

    @quantity(
        takes=Inputs(rates=3, options=("drives",)),
        gives=Outputs("Y", ("nv", "parameters"), unit="that of Q over kg, kg m or kg m^2"),
        needs=(WITHOUT_CONTACTS,),
        closed_form=lambda m, x: closed_form.regressor(m, x.q, x.base),
        printed=Printed(
            caption="inertial-parameter regressor",
            meaning="Y(q, qd, q2d): the regressor, Q = Y p of the inertial parameters p of the bodies, 10 of each.",
            tex=r"Q = Y(q, \dot{q}, \ddot{q})\,p",
            returns=DRIVE_COLUMNS,
        ),
    )
    @staticmethod
    def regressor(m: Mechanism, x: State) -> Series:
        """Compute the inertial-parameter regressor Y and its rates.

        Q = Y p, with p = `inertial_parameters`. The forces of the rigid mechanism are linear in p, and so are their
        rates: Qd = Yd p, Q2d = Y2d p, .... Wrenches on bodies and drive terms that act add to Q what they add in
        `inverse_dynamics`. Drive terms are linear in their parameters too: `drives` appends their columns.

        References
        ----------
        C. G. Atkeson, C. H. An, J. M. Hollerbach, "Estimation of Inertial Parameters of Manipulator Loads and Links",
        International Journal of Robotics Research 5(3), 1986.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> Y, Yd = robot.regressor([0, 0], [1, 0], [0, 0], [0, 0])
        >>> Y.shape, (Y @ robot.inertial_parameters).round(6)
        ((2, 20), array([29.43,  9.81]))
        >>> robot.regressor([0, 0], [1, 0], [0, 0], drives=("damping", "offset"))[:, 20:]
        array([[1., 0., 1., 0.],
               [0., 0., 0., 1.]])
        """
        return regressor.regressor(m, x.q, x.base)

    @quantity(
        takes=Inputs(rates=2, options=("drives",)),
        gives=Outputs("Yp", ("nv", "parameters"), unit="that of p over kg, kg m or kg m^2"),
        needs=(WITHOUT_CONTACTS,),
        closed_form=lambda m, x: closed_form.momentum_regressor(m, x.q, x.base),
        printed=Printed(
            caption="regressor of the generalized momentum",
            meaning="Yp(q, qd): the regressor of the generalized momentum, M qd = Yp p of the inertial parameters p.",
            tex=r"M\,\dot{q} = Y_p(q, \dot{q})\,p",
            tex_symbol="Y_{p}",
            returns=DRIVE_COLUMNS,
        ),
    )
    @staticmethod
    def momentum_regressor(m: Mechanism, x: State) -> Series:
        """Compute the regressor Yp of the generalized momentum and its rates.

        M qd = Yp p. p are the `inertial_parameters`. ``Y(q, qd, q2d) = Ypd(q, qd, q2d) + R(q, qd)`` of the `regressor`
        Y: the forces are the rate of the momentum and what q and qd determine, so that their integral needs no q2d. Of
        the drive terms only the armature has momentum; the columns of the others are zero.

        References
        ----------
        J.-J. E. Slotine, W. Li, "On the Adaptive Control of Robot Manipulators", International Journal of Robotics
        Research 6(3), 1987: filtered forces without accelerations.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> Yp = robot.momentum_regressor([0, 0], [0, 1])
        >>> Yp.shape, (Yp @ robot.inertial_parameters).round(6)
        ((2, 20), array([2., 1.]))
        >>> robot.momentum_regressor([0, 0], [2, 1], drives=("armature", "damping"))[:, 20:]
        array([[2., 0., 0., 0.],
               [0., 1., 0., 0.]])
        """
        return regressor.momentum_regressor(m, x.q, x.base)

    @quantity(
        takes=Inputs(rates=2, options=("drives",)),
        gives=Outputs("YE", ("parameters",), unit="J over kg, kg m or kg m^2"),
        needs=(WITHOUT_CONTACTS,),
        closed_form=lambda m, x: row_vector(closed_form.energy_regressor(m, x.q, x.base)),
        printed=Printed(
            caption="regressor of the energy",
            meaning="YE(q, qd): the regressor of the energy, T + U = YE p of the inertial parameters p.",
            tex=r"T + U = Y_E(q, \dot{q})\,p",
            tex_symbol="Y_{E}",
            returns=DRIVE_COLUMNS,
        ),
    )
    @staticmethod
    def energy_regressor(m: Mechanism, x: State) -> Series:
        """Compute the regressor YE of the energy and its rates: T + U = YE p.

        p are the `inertial_parameters`. While the base is at rest, the rate of the energy is the power of the forces,
        ``YEd(q, qd, q2d) = qd . Y(q, qd, q2d)`` of the `regressor` Y, so that the integral of the power needs no q2d.
        Of the drive terms the armature and the spring have energy; the columns of the others are zero.

        References
        ----------
        M. Gautier, W. Khalil, "On the Identification of the Inertial Parameters of Robots", IEEE Conference on Decision
        and Control, 1988.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> YE = robot.energy_regressor([0, 0], [1, 1])
        >>> YE.shape, (YE @ robot.inertial_parameters).round(6)
        ((20,), np.float64(5.0))
        """
        return row_vector(regressor.energy_regressor(m, x.q, x.base))
