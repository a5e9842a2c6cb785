"""Forces of the coordinates: of a motion, and of gravity."""

from jounce.dynamics import closed_form, drive_terms
from jounce.dynamics.paper import equations
from jounce.dynamics.quantities.needs import WITHOUT_CONTACTS
from jounce.dynamics.quantities.row import DriveTrains, Inputs, Outputs, Printed, quantity, row_vector
from jounce.dynamics.recursion import forces
from jounce.dynamics.state import Law, State
from jounce.model.drives import ALL_DRIVE_TERMS, load_friction
from jounce.model.mechanism import Mechanism
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
        paper=lambda m, x: row_vector(equations.inverse_dynamics(m, x)),
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
        """The generalized forces Q of a motion and their time derivatives Qd, Q2d, ... (RNEA with rates).

        ``Q = M(q) q2d + C(q, qd) qd + Qgrav(q) + Qext``, with the drive terms that act added. With `contacts`, less
        what their wrenches do: six rows of the base that vanish, to rounding, and the torques of the joints.

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
        paper=lambda m, x: row_vector(equations.gravity_forces(m, x)),
        sweep=forces.RESTING_SWEEP,
        printed=Printed(
            meaning="Qgrav = dU/dq: the forces that hold the robot up against gravity.",
            tex=r"Q_{\mathrm{grav}} = \partial U / \partial q",
            tex_symbol=r"Q_{\mathrm{grav}}",
        ),
    )
    @staticmethod
    def gravity_forces(m: Mechanism, x: State) -> Series:
        """The generalized gravity forces Qgrav(q) = dU/dq, with U the potential energy of gravity, and their rates.

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
