"""Regressors: what is linear in the inertial parameters, without them."""

from jounce.dynamics import closed_form
from jounce.dynamics.quantities.needs import WITHOUT_CONTACTS
from jounce.dynamics.quantities.row import Inputs, Outputs, Printed, quantity, row_vector
from jounce.dynamics.recursion import regressor as recursion
from jounce.dynamics.state import State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series

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
        """The inertial-parameter regressor Y and its time derivatives: Q = Y p, with p = `inertial_parameters`.

        The forces of the rigid mechanism are linear in p, and so are their rates: Qd = Yd p, Q2d = Y2d p, .... Wrenches
        on bodies and drive terms that act add to Q what they add in `inverse_dynamics`. Drive terms are linear in their
        parameters too: `drives` appends their columns.

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
        return recursion.regressor(m, x.q, x.base)

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
        """The regressor Yp of the generalized momentum and its time derivatives: M qd = Yp p.

        p are the `inertial_parameters`. ``Y(q, qd, q2d) = Ypd(q, qd, q2d) + R(q, qd)`` of the `regressor` Y: the forces
        are the rate of the momentum and what q and qd determine, so that their integral needs no q2d. Of the drive
        terms only the armature has momentum; the columns of the others are zero.

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
        return recursion.momentum_regressor(m, x.q, x.base)

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
        """The regressor YE of the energy and its time derivatives: T + U = YE p.

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
        return row_vector(recursion.energy_regressor(m, x.q, x.base))
