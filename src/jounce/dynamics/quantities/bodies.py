"""Kinematics of the bodies."""

from jounce.dynamics import closed_form, kinematics
from jounce.dynamics.quantities.row import Inputs, Outputs, Printed, quantity, row_vector
from jounce.dynamics.recursion import bodies
from jounce.dynamics.state import State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


class Bodies:
    """Rows of quantities of bodies."""

    @quantity(
        takes=Inputs(rates=1),
        gives=Outputs("H", ("nb", 4, 4), unit="1 and m"),
        closed_form=lambda m, x: kinematics.poses(m, x, closed_form),
        printed=Printed(
            caption="poses of the bodies",
            meaning="H(q): the pose of the body in the inertial frame, a homogeneous matrix.",
            tex=r"H_i = H_p\,B_i \exp(\hat{X}_i \theta_i)",
        ),
    )
    @staticmethod
    def poses(m: Mechanism, x: State) -> Series:
        """The poses H(q) of the body frames in the inertial frame, and their rates.

        ``H = [[R, r], [0, 1]]`` maps body coordinates to inertial ones; ``Hd = H wedge(V)``, V the body-fixed twist.

        References
        ----------
        Müller & Kumar, (Ci).

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").poses([0, 0])[1, :3, 3]
        array([1., 0., 0.])
        """
        return kinematics.poses(m, x, bodies)

    @quantity(
        takes=Inputs(rates=2),
        gives=Outputs("V", ("nb", 6), unit="rad/s and m/s", frames=tuple(kinematics.SCREW_FRAMES)),
        closed_form=lambda m, x: row_vector(kinematics.screws(m, x, closed_form, closed_form.twists)),
        printed=Printed(
            caption="twists of the bodies",
            meaning="V(q, qd): the twist (angular; linear) of the body.",
            tex=r"V = J\,\dot{q}",
            returns="Rates are the derivatives of the components in the frame.",
        ),
    )
    @staticmethod
    def twists(m: Mechanism, x: State) -> Series:
        """The twists V = J qd of the bodies, (angular; linear), and their rates.

        References
        ----------
        Müller & Kumar, (Vsys), (VbdotMat).

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").twists([0, 0], [1, 0], body="body2", frame="world")[[2, 4]]
        array([1., 1.])
        """
        return row_vector(kinematics.screws(m, x, bodies, bodies.twists))

    @quantity(
        takes=Inputs(rates=1, without_base=("body",)),
        gives=Outputs("J", ("nb", 6, "nv"), unit="1 and m", frames=tuple(kinematics.SCREW_FRAMES)),
        closed_form=lambda m, x: kinematics.screws(m, x, closed_form, closed_form.jacobians),
        printed=Printed(
            caption="Jacobians of the bodies",
            meaning="J(q): the Jacobian of the body, twist (angular; linear) V = J qd.",
            tex=r"J = \partial V / \partial \dot{q}",
        ),
    )
    @staticmethod
    def jacobian(m: Mechanism, x: State) -> Series:
        """The Jacobian J(q) of bodies, V = J qd, and its rates.

        References
        ----------
        Müller & Kumar, (Vsys), (JbSys), (Jdot).

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").jacobian([0, 0], body="body2", frame="world")[3:5]
        array([[0., 0.],
               [1., 0.]])
        """
        return kinematics.screws(m, x, bodies, bodies.jacobians)
