"""Matrices of the equations of motion."""

from jounce.dynamics import closed_form, drive_terms
from jounce.dynamics.paper import equations
from jounce.dynamics.quantities.row import DriveTrains, Inputs, Outputs, Printed, quantity
from jounce.dynamics.recursion import matrices
from jounce.dynamics.state import State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


class Matrices:
    """Rows of matrices."""

    @quantity(
        takes=Inputs(rates=1, without_base=("body",)),
        gives=Outputs("M", ("nv", "nv"), unit="kg m^2, kg m or kg"),
        drives=DriveTrains(("armature",), law=lambda m, x: drive_terms.armature_matrix(m)),
        closed_form=lambda m, x: closed_form.evaluate_state(m, x).gM,
        paper=equations.mass_matrix,
        printed=Printed(
            caption="generalized mass matrix",
            meaning="M(q): the generalized mass matrix, symmetric.",
            tex=r"T = \tfrac{1}{2}\,\dot{q}^T M\,\dot{q}",
            returns="Symmetric.",
        ),
    )
    @staticmethod
    def mass_matrix(m: Mechanism, x: State) -> Series:
        """The generalized mass matrix M(q) = J^T M J and its rates Md, M2d, ... (CRBA with rates).

        The armature that acts is added, see `with_drives`.

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
        paper=equations.coriolis_matrix,
        turns_with=mass_matrix,
        printed=Printed(
            caption="Coriolis matrix of the paper",
            meaning="C(q, qd): the paper's Coriolis matrix; passivity-based control takes Cbar, skew_coriolis_matrix.",
            tex=r"C\,\dot{q} = Q - M\,\ddot{q} - Q_{\mathrm{grav}}",
        ),
    )
    @staticmethod
    def coriolis_matrix(m: Mechanism, x: State) -> Series:
        """The Coriolis matrix C(q, qd) of the paper, or with ``form="skew"`` the one for passivity-based control.

        Both give the same forces C qd. For the skew form, (Cbar), ``Md - 2 C`` is skew-symmetric, and so are its rates;
        for the paper's, (Csys), only ``qd^T (Md - 2 C) qd = 0``.

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
        """The Coriolis matrix Cbar(q, qd) for passivity-based control: ``coriolis_matrix(..., form="skew")``.

        ``Md - 2 Cbar`` is skew-symmetric, and so are its rates.

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
