"""Rows of the bodies: where they are and how they move, momenta and energies, and wrenches between them.

`Bodies` has poses, twists and Jacobians, `Momenta` sums over the bodies, `Wrenches` what the ground and the bodies
exert on each other.
"""

from jounce.core.cures import Remedy
from jounce.dynamics import closed_form, drive_terms, kinematics
from jounce.dynamics.quantities.row import (
    WITHOUT_CONTACTS,
    DriveTrains,
    Inputs,
    Need,
    Outputs,
    Printed,
    quantity,
    row_vector,
    scalar,
)
from jounce.dynamics.recursion import bodies, forces, matrices
from jounce.dynamics.state import State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series, diagonal


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
        """Compute the poses H(q) of the body frames and their rates.

        The poses are in the inertial frame. ``H = [[R, r], [0, 1]]`` maps body coordinates to inertial ones;
        ``Hd = H wedge(V)``, V the body-fixed twist.

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
        """Compute the twists V = J qd of the bodies and their rates.

        Twists are (angular; linear).

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
        """Compute the Jacobian J(q) of bodies, V = J qd, and its rates.

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
        """Compute the spatial momentum h of the robot and its rates.

        The momentum is (angular; linear). ``h = U^T M V``: the momenta M_i V_i of the bodies about the inertial origin,
        in inertial axes, summed up.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").momentum([0, 0], [1, 0])[[2, 4]]
        array([5., 3.])
        """
        return row_vector(bodies.momentum(m, x.q, x.base))

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
        """Compute the momentum hG about the centre of mass, and its rates.

        The momentum is (angular; linear). ``hG = (k - c x l; l)`` in inertial axes, with the momentum h = (k; l) and
        the centre of mass c. Its rate is the sum of the weight and of all wrenches on the robot, about the centre of
        mass.

        References
        ----------
        D. E. Orin, A. Goswami, S.-H. Lee, "Centroidal dynamics of a humanoid robot", Autonomous Robots 35, 2013.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").centroidal_momentum([0, 0], [1, 0])[[2, 4]]
        array([0.5, 3. ])
        """
        return row_vector(bodies.centroidal_momentum(m, x.q, x.base))

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
        """Compute the centroidal momentum matrix AG and its rates: hG = AG qd.

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
        """Compute the centre of mass c of the robot, and its rates.

        These are its velocity, acceleration, ... in the inertial frame. ``c = sum of m_i c_i / sum of m_i`` over the
        bodies that move; links fixed to the ground are not among them.

        Examples
        --------
        >>> import jounce
        >>> c, cd = jounce.load("planar2r").center_of_mass([0, 0], [1, 0])
        >>> c, cd
        (array([1.5, 0. , 0. ]), array([0. , 1.5, 0. ]))
        """
        return row_vector(bodies.center_of_mass(m, x.q, x.base))

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
        """Compute the generalized momentum p = M qd and its rates.

        The armature that acts is included.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").generalized_momentum([0, 0], [0, 1])
        array([2., 1.])
        """
        return row_vector(bodies.generalized_momentum(m, x.q, x.base))

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
        """Compute the kinetic energy T and its rates.

        T = 1/2 qd . M qd; the armature that acts is included.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").kinetic_energy([0, 0], [1, 1])
        np.float64(5.0)
        """
        return scalar(bodies.kinetic_energy(m, x.q, x.base))

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
        """Compute the potential energy U(q) and its rates Ud = qd . dU/dq, ...

        U is that of gravity, and of the springs that act. ``U = -sum m_i g . c_i``, zero for masses at the inertial
        origin; springs are slack at their rest position.

        Examples
        --------
        >>> import jounce
        >>> U, Ud = jounce.load("planar2r").potential_energy([0.5, 0], [1, 0])
        >>> U.round(4), Ud.round(4)
        (np.float64(14.1095), np.float64(25.8273))
        """
        return scalar(bodies.potential_energy(m, x.q, x.base))


OPEN_LOOPS = Remedy("; Robot(robot.mechanism.tree) has open loops")


def _cut_joints(m: Mechanism) -> str | None:
    return f" depend on what its cut joints transmit, loop_wrenches{OPEN_LOOPS}" if m.closure else None


def _dense_joint_wrenches(m: Mechanism, x: State) -> Series:
    """Return A^T (M (V' + U G) - b^T M V + W).

    The shape is (..., nb, 6).
    """
    dense = closed_form.evaluate_state(m, x)
    M = diagonal(m.M)  # (Msys)
    # What each body requires; A^T adds up what a joint carries.
    F = M @ (dense.V.dot + dense.UG) - dense.b.mT @ (M @ dense.V)
    F = F if x.W is None else F + x.W
    return closed_form.split_bodies(dense.A.mT @ F).map(lambda F: F[..., 0])


class Wrenches:
    """Rows of wrenches."""

    @quantity(
        takes=Inputs(rates=3, wrenches=True),
        gives=Outputs("F", (6,), unit="N m and N"),
        closed_form=lambda m, x: row_vector(closed_form.evaluate_state(m, x).F),
        printed=Printed(
            caption="wrench of the ground on the robot",
            meaning="F: the wrench (moment; force) of the ground on the robot, in the inertial frame about its origin.",
            tex=r"F = \dot{h} + U^T M\,U G",
            wrench_term="their sum about the inertial origin",
            wrench_tex="U^T W",
        ),
    )
    @staticmethod
    def base_wrench(m: Mechanism, x: State) -> Series:
        """Compute the reaction wrench of the ground on the robot, with rates.

        The wrench is F = (moment; force). ``F = hd + U^T M U G + U^T W``: the rate of the momentum, minus gravity and
        minus the loads -W, about the inertial origin in inertial axes. A mechanism is dynamically balanced if F is
        constant.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").base_wrench([0, 0], [0, 0], [0, 0])[[2, 4]].round(6)
        array([29.43, 19.62])
        """
        return row_vector(forces.base_wrench(m, x.q, x.W, x.base))

    @quantity(
        takes=Inputs(rates=3, wrenches=True),
        gives=Outputs("Fj", ("bodies", 6), unit="N m and N"),
        needs=(WITHOUT_CONTACTS, Need(_cut_joints)),
        closed_form=_dense_joint_wrenches,
        printed=Printed(
            caption="wrenches that the joints transmit",
            meaning="Fj: the wrenches (moment; force) of the joints on their bodies, in the body frames.",
            tex=r"F_j = A^T \left(M\,(\dot{V} + U G) - b^T M\,V\right)",
            tex_symbol="F_{j}",
            wrench_term="A^T W",
            wrench_tex="A^T W",
            returns="Rows are those of `body_names`, components those in the body frame about its origin.",
            raises="loops are closed",
        ),
    )
    @staticmethod
    def joint_wrenches(m: Mechanism, x: State) -> Series:
        """Compute the wrenches of the joints on their bodies, and their rates.

        The wrenches are Fj = (moment; force). They are what bearings, flanges and force sensors carry, all six
        components: the wrench of the parent on the body, for the body's own motion and weight, for all that it carries,
        and for wrenches on these. Projected on the joint screw, ``X . Fj``, it is the force of the joint without drive
        terms. If the robot floats, the first row is the wrench that acts on its base, as in `inverse_dynamics`.

        References
        ----------
        R. Featherstone, Rigid Body Dynamics Algorithms, 5.3: the f_i of the recursive Newton-Euler algorithm.

        Examples
        --------
        The shoulder of an arm of two links of 1 kg and 1 m that is held level carries 2 kg at 1.5 m and 1 m:

        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> robot.joint_wrenches([0, 0], [0, 0], [0, 0])[0, [2, 4]].round(6)
        array([29.43, 19.62])
        """
        return forces.joint_wrenches(m, x.q, x.W, x.base)
