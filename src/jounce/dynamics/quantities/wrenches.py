"""Wrenches that bodies, or the ground, exert on each other."""

from jounce.dynamics import closed_form
from jounce.dynamics.quantities.row import column, quantity, row_vector
from jounce.dynamics.recursion import forces
from jounce.dynamics.state import State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


class Wrenches:
    """Rows of wrenches."""

    @quantity(
        symbol="F",
        rates=3,
        shape=(6,),
        width=column,
        closed_form=lambda m, x: row_vector(closed_form.at(m, x).F),
        unit="N m and N",
        caption="wrench of the ground on the robot",
        meaning="F: the wrench (moment; force) of the ground on the robot, in the inertial frame about its origin.",
        tex=r"F = \dot{h} + U^T M\,U G",
        wrench_term="their sum about the inertial origin",
        wrench_tex="U^T W",
    )
    @staticmethod
    def base_wrench(m: Mechanism, x: State) -> Series:
        """The reaction wrench of the ground on the robot, F = (moment; force), and its rates.

        ``F = hd + U^T M U G + U^T W``: the rate of the momentum, minus gravity and minus the loads -W, about the
        inertial origin in inertial axes. A mechanism is dynamically balanced if F is constant.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").base_wrench([0, 0], [0, 0], [0, 0])[[2, 4]].round(6)
        array([29.43, 19.62])
        """
        return row_vector(forces.base_wrench(m, x.q, x.W, x.base))
