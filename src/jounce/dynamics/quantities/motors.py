"""Motors behind elastic joints."""

from collections.abc import Callable
from dataclasses import replace

from jounce.dynamics import elastic
from jounce.dynamics.quantities.forces import Forces
from jounce.dynamics.quantities.row import column, quantity, row_vector
from jounce.dynamics.state import State
from jounce.model.drives import TERMS
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series

Law = Callable[[Mechanism, Series, elastic.Forces], Series]


def _of_motors(law: Law, method: str, m: Mechanism, x: State) -> Series:
    """By a law of elastic joints, with the forces on the links by a method."""

    def forces(added: Series | None) -> Series:
        W = x.W if added is None else added if x.W is None else x.W + added
        return Forces.inverse_dynamics.law(method, m)(m, replace(x, W=W)).map(lambda Q: Q[..., -m.n :, None])

    return row_vector(law(m, x.q, forces))


class Motors:
    """Rows of motors."""

    @quantity(
        symbol="theta",
        rates=3,
        shape=("n",),
        elastic=True,
        width=column,
        closed_form=lambda m, x: _of_motors(elastic.motor_positions, "closed_form", m, x),
        drive_terms=TERMS,
        unit="rad or, for coordinates in m, m",
        caption="motor positions",
        meaning="theta = q + K^-1 Q: positions of the motors behind elastic joints.",
        tex=r"\theta = q + K^{-1} Q",
        tex_symbol=r"\theta",
        wrench_term="K^-1 J^T W",
        wrench_tex=r"K^{-1} J^T W",
    )
    @staticmethod
    def motor_positions(m: Mechanism, x: State) -> Series:
        """The motor positions theta of a motion of the links, and their rates thetad, theta2d, ...

        ``theta = q + Q / K``.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1).robot
        >>> theta, thetad = arm.motor_positions([0, 0], [1, 0], [0, 0], [0, 0])
        >>> theta.round(6), thetad.round(6)
        (array([0.036788, 0.01635 ]), array([1., 0.]))
        """
        return _of_motors(elastic.motor_positions, "recursion", m, x)

    @quantity(
        symbol="tau",
        rates=5,
        shape=("n",),
        elastic=True,
        width=column,
        closed_form=lambda m, x: _of_motors(elastic.motor_torques, "closed_form", m, x),
        drive_terms=TERMS,
        unit="N m or, for coordinates in m, N",
        caption="motor torques",
        meaning="tau = Q + B theta2d + F_m(thetad): torques of the motors behind elastic joints.",
        tex=r"\tau = Q + B\,\ddot{\theta} + F_m(\dot{\theta})",
        tex_symbol=r"\tau",
        wrench_rates=3,
        wrench_term="J^T W, and B K^-1 times its second derivative",
        wrench_tex=r"J^T W + B K^{-1} \tfrac{d^2}{dt^2}(J^T W)",
    )
    @staticmethod
    def motor_torques(m: Mechanism, x: State) -> Series:
        """The motor torques tau of a motion of the links, and their rates taud, tau2d, ...

        ``tau = Q + B theta2d + F_m(thetad)`` with ``theta = q + Q / K``, which takes Q2d and thus q4d.

        References
        ----------
        M. W. Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109 (1987).

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1).robot
        >>> tau, taud = arm.motor_torques([0, 0], [0, 0], [1, 1], [0, 0], [0, 0], [0, 0])
        >>> tau.round(6), taud.round(6)
        (array([36.53, 12.91]), array([0., 0.]))
        """
        return _of_motors(elastic.motor_torques, "recursion", m, x)
