"""Motors behind elastic joints."""

from collections.abc import Callable
from dataclasses import replace

from jounce.dynamics import elastic, joint_springs
from jounce.dynamics.quantities.forces import Forces, Forward, Matrices
from jounce.dynamics.quantities.row import ELASTIC, DriveTrains, Inputs, Need, Outputs, Printed, quantity, row_vector
from jounce.dynamics.state import State
from jounce.model.drive_trains import DRIVE_TERMS
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


def _motor_motion(method: str, m: Mechanism, x: State) -> tuple[Series, Callable[[], Series]]:
    """Return theta of the motors, and a function that computes tau.

    The method is that of the forces on the links. Torques take more rates than positions, and not all callers want
    them.
    """

    # Q of the links, with the wrenches of rotors added to those that the bodies exert.
    def link_forces(rotor_wrenches: Series | None) -> Series:
        W = x.W
        if rotor_wrenches is not None:
            W = rotor_wrenches if W is None else W + rotor_wrenches
        return Forces.inverse_dynamics.law(method, m)(m, replace(x, W=W)).map(lambda Q: Q[..., -m.n :, None])

    inputs = joint_springs.NO_INPUTS if x.stiffness is None else joint_springs.with_stiffness(m, x.stiffness)
    theta, phi = elastic.motor_positions(m, x.q, link_forces, inputs)
    return row_vector(theta), lambda: row_vector(elastic.motor_torques(m, x.q, theta, phi))


def _accelerations(method: str, m: Mechanism, x: State) -> Series:
    """Return q2d and theta2d of links and motors.

    The forces of the springs couple them; where links carry rotors, inertia does so too.
    """
    theta, thetad, tau = x.motors.upto(2)
    Q, phi, drive = elastic.plant_forces(m, x.q, Series.of([theta, thetad]), tau)
    e = joint_springs.elasticity_of(m)
    # Rotors on links: M, S and B of the whole, and forces where all accelerations are zero, moments of rotors included.
    if e.level is not None and len(e.motors) > 0:
        q, motors = (Series.of([*rates, 0 * rates[0]]) for rates in (x.q.upto(1), (theta, thetad)))
        W = elastic.reaction_wrenches(m, q, motors)
        without_accelerations = replace(x, q=q, W=W if x.W is None else W + x.W)
        M, bias = (
            row.law(method, m)(m, without_accelerations)[0] for row in (Matrices.mass_matrix, Forces.inverse_dynamics)
        )
        return row_vector(Series.of(elastic.coupled_accelerations(m, q, M, phi - bias[..., None], drive - phi)))
    # Otherwise links and rotors move by themselves; rotors of rigid joints belong to the mass matrix of the links.
    plant = elastic.with_rigid_rotors(m)
    q2d = Forward.forward_dynamics.law(method, plant)(plant, replace(x, Q=Series.of([Q])))[0][..., None]
    return row_vector(Series.of([q2d, elastic.rotor_accelerations(m, q2d, drive - phi)]))


def _linearizing_torques(method: str, m: Mechanism, x: State) -> Series:
    """Return tau that makes q4d what is given.

    q2d and q3d follow from the forces of the springs.
    """
    theta, thetad, q4d = x.motors.upto(2)
    Q = elastic.spring_forces(m, x.q, Series.of([theta, thetad]))
    accelerations = Forward.forward_dynamics.law(method, m)(m, replace(x, Q=Q))
    # q, qd, q2d, q3d, q4d: a whole motion of the links, of which motor torques follow.
    q = Series.of([*x.q.upto(1), *(x[..., None] for x in accelerations.upto(1)), q4d])
    return _motor_motion(method, m, replace(x, q=q))[1]()


class Motors:
    """Rows of motors."""

    @quantity(
        takes=Inputs(rates=3, wrenches=True),
        gives=Outputs("theta", ("n",), unit="rad or, for coordinates in m, m"),
        needs=(ELASTIC,),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            meaning="theta = q + K^-1 Q: positions of the motors behind elastic joints.",
            tex=r"\theta = q + K^{-1} Q",
            tex_symbol=r"\theta",
            wrench_term="K^-1 J^T W",
            wrench_tex=r"K^{-1} J^T W",
        ),
    )
    @staticmethod
    def motor_positions(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute the motor positions theta and their rates.

        They are those of a motion of the links behind elastic joints. ``theta = q + Q / K``, seen from the links: rotor
        angles over gear ratios. See `elastic`.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> theta, thetad = arm.motor_positions([0, 0], [1, 0], [0, 0], [0, 0])
        >>> theta.round(6), thetad.round(6)
        (array([0.036788, 0.01635 ]), array([1., 0.]))
        """
        return _motor_motion(method, m, x)[0]

    @quantity(
        takes=Inputs(rates=5, wrenches=True, wrench_rates=3),
        gives=Outputs("tau", ("n",), unit="N m or, for coordinates in m, N"),
        needs=(ELASTIC,),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            meaning="tau = Q + B theta2d + F_m(thetad): torques of the motors behind elastic joints.",
            tex=r"\tau = Q + B\,\ddot{\theta} + F_m(\dot{\theta})",
            tex_symbol=r"\tau",
            wrench_term="J^T W, and B K^-1 times its second derivative",
            wrench_tex=r"J^T W + B K^{-1} \tfrac{d^2}{dt^2}(J^T W)",
        ),
    )
    @staticmethod
    def motor_torques(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute the motor torques tau and their rates.

        They are those of a motion of the links behind elastic joints. ``tau = Q + B theta2d + F_m(thetad)`` with
        ``theta = q + Q / K``, which takes Q2d and thus q4d.

        References
        ----------
        M. W. Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109 (1987).

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> tau, taud = arm.motor_torques([0, 0], [0, 0], [1, 1], [0, 0], [0, 0], [0, 0])
        >>> tau.round(6), taud.round(6)
        (array([36.53, 12.91]), array([0., 0.]))
        """
        return _motor_motion(method, m, x)[1]()

    @quantity(
        takes=Inputs(rates=5, wrenches=True, wrench_rates=3),
        gives=Outputs(
            "theta",
            ("n",),
            unit="rad, rad/s and N m or, for coordinates in m, m, m/s and N",
            results=("theta", "thetad", "tau"),
        ),
        needs=(ELASTIC,),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            caption="motor positions, velocities and torques",
            meaning="theta = q + K^-1 Q, thetad and tau = Q + B theta2d + F_m(thetad): what the motors do.",
            tex=r"\theta = q + K^{-1} Q,\quad \dot{\theta},\quad \tau = Q + B\,\ddot{\theta} + F_m(\dot{\theta})",
            tex_symbol=r"(\theta,\ \dot{\theta},\ \tau)",
            wrench_term="K^-1 J^T W to theta, and what they add to thetad and tau",
            wrench_tex=r"K^{-1} J^T W",
        ),
    )
    @staticmethod
    def motor_commands(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute motor positions theta, velocities thetad and torques tau at once.

        They are those of `motor_positions` and `motor_torques` for a motion of the links, as the
        controller of a drive takes them.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> theta, thetad, tau = arm.motor_commands(*[[0, 0]] * 5)
        >>> theta.round(6), tau.round(6)
        (array([0.036788, 0.01635 ]), array([29.43,  9.81]))
        """
        theta, torques = _motor_motion(method, m, x)
        return Series.of([*theta.upto(1), torques()[0]])

    @quantity(
        takes=Inputs(rates=5, wrenches=True, wrench_rates=3),
        gives=Outputs("i", ("n",), unit="A"),
        needs=(ELASTIC, Need(elastic.current_obstacle)),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            meaning="i = tau / (r k): currents of the motors, with gear ratios r and torque constants k.",
            tex=r"i = \tau / (r k)",
            wrench_term="what they add to tau, over r k",
            wrench_tex=r"\tau(W) / (r k)",
            returns="NaN for motors that state no torque constant.",
            raises="no motor states its torque constant",
        ),
    )
    @staticmethod
    def motor_currents(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute the currents i of the motors and their rates.

        They are those of a motion of the links behind elastic joints. ``i = tau / (r k)`` with the gear ratio r and the
        torque constant k of each `Motor`.

        Examples
        --------
        >>> import jounce
        >>> motor = jounce.Motor(gear=100, inertia=1e-5, constant=0.05, resistance=0.5)
        >>> arm = jounce.load("planar2r").elastic(800, motors=motor)
        >>> arm.motor_currents(*[[0, 0]] * 5)
        array([5.886, 1.962])
        """
        return elastic.currents(joint_springs.elasticity_of(m), _motor_motion(method, m, x)[1]())

    @quantity(
        takes=Inputs(rates=5, inductive=True, wrenches=True, wrench_rates=3),
        gives=Outputs("u", ("n",), unit="V"),
        needs=(ELASTIC, Need(elastic.voltage_obstacle)),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            meaning="u = R i + L di/dt + k r thetad: voltages of the motors.",
            tex=r"u = R\,i + L\,\dot{i} + k r\,\dot{\theta}",
            wrench_term="what they add",
            wrench_tex="u(W)",
            returns="NaN for motors that state no torque constant or no resistance.",
            raises="no motor states constant and resistance",
        ),
    )
    @staticmethod
    def motor_voltages(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute the voltages u of the motors and their rates.

        They are those of a motion of the links behind elastic joints. ``u = R i + L di/dt + k r thetad`` takes the rate
        of tau and thus q5d, unless no motor has an inductance.

        Examples
        --------
        >>> import jounce
        >>> motor = jounce.Motor(gear=100, inertia=1e-5, constant=0.05, resistance=0.5, inductance=1e-3)
        >>> arm = jounce.load("planar2r").elastic(800, motors=motor)
        >>> arm.motor_voltages(*[[0, 0]] * 6)
        array([2.943, 0.981])
        """
        theta, torques = _motor_motion(method, m, x)
        return elastic.voltages(joint_springs.elasticity_of(m), theta, torques())

    @quantity(
        takes=Inputs(rates=5, motors=("q", "qd", "theta", "thetad", "tau"), wrenches=True),
        gives=Outputs("q", ("n",), unit="rad/s^2 or, for coordinates in m, m/s^2", results=("q2d", "theta2d")),
        needs=(ELASTIC,),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            caption="accelerations of links and motors",
            meaning="q2d = M^-1 (K (theta - q) - C qd - Qgrav), theta2d = (tau - F_m - K (theta - q)) / B.",
            tex=r"\ddot{q} = M^{-1} \left(K (\theta - q) - C\,\dot{q} - Q_{\mathrm{grav}}\right),\quad"
            r" \ddot{\theta} = B^{-1} \left(\tau - F_m(\dot{\theta}) - K (\theta - q)\right)",
            tex_symbol=r"(\ddot{q},\ \ddot{\theta})",
            wrench_term="-M^-1 J^T W to q2d",
            wrench_tex="-M^{-1} J^T W",
        ),
    )
    @staticmethod
    def elastic_forward_dynamics(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute accelerations of links and motors from motor torques.

        They are q2d and theta2d behind elastic joints. ``q2d = M^-1 (K (theta - q) - C qd - Qgrav - Qext)``,
        ``theta2d = (tau - F_m - K (theta - q)) / B``. At a rigid joint B is in M, and theta2d = q2d.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> rest, theta = [0, 0], arm.motor_positions([0, 0], [0, 0], [0, 0])
        >>> q2d, theta2d = arm.elastic_forward_dynamics(rest, rest, theta, rest, [29.43 + 0.1, 9.81])
        >>> theta2d.round(9) + 0.0
        array([1., 0.])
        """
        return _accelerations(method, m, x)

    @quantity(
        takes=Inputs(rates=5, motors=("q", "qd", "theta", "thetad", "q4d"), wrenches=True, wrench_rates=3),
        gives=Outputs("tau", ("n",), unit="N m or, for coordinates in m, N", results=("tau",)),
        needs=(ELASTIC, Need(elastic.linearization_obstacle)),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            caption="motor torques for a wanted snap",
            meaning="tau that makes q4d what is given in the state q, qd, theta, thetad.",
            tex=r"\tau = \tau(q, \dot{q}, \ddot{q}, q^{(3)}, q^{(4)}),\quad M\,\ddot{q}"
            r" = K (\theta - q) - C\,\dot{q} - Q_{\mathrm{grav}}",
            tex_symbol=r"\tau",
            wrench_term="what they add to tau",
            wrench_tex=r"\tau(W)",
            raises="a joint is rigid",
        ),
    )
    @staticmethod
    def feedback_linearization(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute motor torques tau for a wanted snap q4d of the links.

        They follow from the measured state. q2d and q3d follow from the forces of the springs, ``Q = K (theta - q)``
        and ``Qd = K (thetad - qd)``; tau is that of `motor_torques`. With ``q4d = q4d_ref + k3 (q3d_ref - q3d) + ...``
        the tracking error obeys a linear equation of order four per coordinate.

        References
        ----------
        M. W. Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109 (1987).

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> rest, theta = [0, 0], arm.motor_positions([0, 0], [0, 0], [0, 0])
        >>> arm.feedback_linearization(rest, rest, theta, rest, [0, 0]).round(9)
        array([29.43,  9.81])
        """
        return _linearizing_torques(method, m, x)
