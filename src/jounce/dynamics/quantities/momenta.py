"""Momenta and energies."""

from jounce.dynamics import closed_form, drive_terms
from jounce.dynamics.quantities.needs import WITHOUT_CONTACTS
from jounce.dynamics.quantities.row import DriveTrains, Inputs, Outputs, Printed, quantity, row_vector, scalar
from jounce.dynamics.recursion import matrices, momenta
from jounce.dynamics.state import State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


class Momenta:
    """Rows of momenta and energies."""

    @quantity(
        takes=Inputs(rates=2),
        gives=Outputs("h", (6,), unit="kg m^2/s and kg m/s"),
        closed_form=lambda m, x: row_vector(closed_form.evaluate_state(m, x).h),
        printed=Printed(
            caption="spatial momentum",
            meaning="h: the momentum (angular; linear) of the bodies about the inertial origin, in inertial axes.",
            tex=r"h = U^T M\,V",
        ),
    )
    @staticmethod
    def momentum(m: Mechanism, x: State) -> Series:
        """The spatial momentum h = (angular; linear) of the robot and its rates.

        ``h = U^T M V``: the momenta M_i V_i of the bodies about the inertial origin, in inertial axes, summed up.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").momentum([0, 0], [1, 0])[[2, 4]]
        array([5., 3.])
        """
        return row_vector(momenta.momentum(m, x.q, x.base))

    @quantity(
        takes=Inputs(rates=2),
        gives=Outputs("hG", (6,), unit="kg m^2/s and kg m/s"),
        closed_form=lambda m, x: row_vector(closed_form.evaluate_state(m, x).hG),
        printed=Printed(
            meaning="hG: the momentum (angular; linear) of the bodies about their centre of mass, in inertial axes.",
            tex=r"h_G = (k - c \times l;\ l), \quad h = (k; l)",
            tex_symbol="h_{G}",
            raises="the masses are 0",
        ),
    )
    @staticmethod
    def centroidal_momentum(m: Mechanism, x: State) -> Series:
        """The momentum hG = (angular; linear) of the robot about its centre of mass, and its rates.

        ``hG = (k - c x l; l)`` in inertial axes, with the momentum h = (k; l) and the centre of mass c. Its rate
        is the sum of the weight and of all wrenches on the robot, about the centre of mass.

        References
        ----------
        D. E. Orin, A. Goswami, S.-H. Lee, "Centroidal dynamics of a humanoid robot", Autonomous Robots 35, 2013.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").centroidal_momentum([0, 0], [1, 0])[[2, 4]]
        array([0.5, 3. ])
        """
        return row_vector(momenta.centroidal_momentum(m, x.q, x.base))

    @quantity(
        takes=Inputs(rates=1),
        gives=Outputs("AG", (6, "nv"), unit="kg m^2, kg m or kg"),
        closed_form=lambda m, x: closed_form.evaluate_state(m, x).AG,
        printed=Printed(
            meaning="AG(q): the centroidal momentum matrix, hG = AG qd.",
            tex=r"A_G = \partial h_G / \partial \dot{q}",
            tex_symbol="A_{G}",
            raises="the masses are 0",
        ),
    )
    @staticmethod
    def centroidal_momentum_matrix(m: Mechanism, x: State) -> Series:
        """The centroidal momentum matrix AG and its rates: hG = AG qd.

        If the robot floats, AG has nv = 6 + n columns, those of the twist of its base first; AG' = `AGd` gives the bias
        ``hGd - AG nud = AGd nu``. For a robot whose ground moves, the momentum of that motion is not part of AG qd.

        References
        ----------
        D. E. Orin, A. Goswami, S.-H. Lee, "Centroidal dynamics of a humanoid robot", Autonomous Robots 35, 2013.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").centroidal_momentum_matrix([0, 0])[[2, 4]]
        array([[0.5, 0.5],
               [3. , 1. ]])
        """
        return matrices.centroidal_momentum_matrix(m, x.q, x.base)

    @quantity(
        takes=Inputs(rates=1),
        gives=Outputs("c", (3,), unit="m"),
        closed_form=lambda m, x: row_vector(closed_form.evaluate_state(m, x).c),
        printed=Printed(
            caption="centre of mass",
            meaning="c(q): the centre of mass of the bodies, in the inertial frame.",
            tex=r"c = \sum_i m_i\, c_i / \sum_i m_i",
            raises="the masses are 0",
        ),
    )
    @staticmethod
    def center_of_mass(m: Mechanism, x: State) -> Series:
        """The centre of mass c of the robot in the inertial frame, and its velocity, acceleration, ...

        ``c = sum of m_i c_i / sum of m_i`` over the bodies that move; links fixed to the ground are not among them.

        Examples
        --------
        >>> import jounce
        >>> c, cd = jounce.load("planar2r").center_of_mass([0, 0], [1, 0])
        >>> c, cd
        (array([1.5, 0. , 0. ]), array([0. , 1.5, 0. ]))
        """
        return row_vector(momenta.center_of_mass(m, x.q, x.base))

    @quantity(
        takes=Inputs(rates=2),
        gives=Outputs("p", ("nv",), unit="N m s or, for coordinates in m, N s"),
        needs=(WITHOUT_CONTACTS,),
        drives=DriveTrains(("armature",), law=lambda m, x: row_vector(drive_terms.armature_matrix(m) @ x.q.dot)),
        closed_form=lambda m, x: row_vector(closed_form.evaluate_state(m, x).p),
        printed=Printed(meaning="p = M qd: the generalized momentum.", tex=r"p = M\,\dot{q}"),
    )
    @staticmethod
    def generalized_momentum(m: Mechanism, x: State) -> Series:
        """The generalized momentum p = M qd and its rates; the armature that acts is included.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").generalized_momentum([0, 0], [0, 1])
        array([2., 1.])
        """
        return row_vector(momenta.generalized_momentum(m, x.q, x.base))

    @quantity(
        takes=Inputs(rates=2),
        gives=Outputs("T", (), unit="J"),
        drives=DriveTrains(
            ("armature",), law=lambda m, x: scalar(x.q.dot.mT @ (drive_terms.armature_matrix(m) @ x.q.dot) * 0.5)
        ),
        closed_form=lambda m, x: scalar(closed_form.evaluate_state(m, x).T),
        printed=Printed(
            meaning="T = 1/2 qd . M qd: the kinetic energy.", tex=r"T = \tfrac{1}{2}\,\dot{q}^T M\,\dot{q}"
        ),
    )
    @staticmethod
    def kinetic_energy(m: Mechanism, x: State) -> Series:
        """The kinetic energy T = 1/2 qd . M qd and its rates; the armature that acts is included.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").kinetic_energy([0, 0], [1, 1])
        np.float64(5.0)
        """
        return scalar(momenta.kinetic_energy(m, x.q, x.base))

    @quantity(
        takes=Inputs(rates=1),
        gives=Outputs("U", (), unit="J"),
        drives=DriveTrains(("spring",), law=lambda m, x: scalar(drive_terms.spring_energy(m, x.q))),
        closed_form=lambda m, x: scalar(closed_form.evaluate_state(m, x).U),
        printed=Printed(
            meaning="U(q): the potential energy, zero where all masses are at the height of the inertial origin.",
            tex=r"U = -\sum_i m_i\, g \cdot c_i",
        ),
    )
    @staticmethod
    def potential_energy(m: Mechanism, x: State) -> Series:
        """The potential energy U(q) of gravity, and of the springs that act, and its rates: Ud = qd . dU/dq, ...

        ``U = -sum m_i g . c_i``, zero for masses at the inertial origin; springs are slack at their rest position.

        Examples
        --------
        >>> import jounce
        >>> U, Ud = jounce.load("planar2r").potential_energy([0.5, 0], [1, 0])
        >>> U.round(4), Ud.round(4)
        (np.float64(14.1095), np.float64(25.8273))
        """
        return scalar(momenta.potential_energy(m, x.q, x.base))
