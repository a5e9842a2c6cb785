"""Wrenches that the ground and the bodies exert on each other."""

from jounce.core.cures import Remedy
from jounce.dynamics import closed_form
from jounce.dynamics.quantities.needs import WITHOUT_CONTACTS, Need
from jounce.dynamics.quantities.row import Inputs, Outputs, Printed, quantity, row_vector
from jounce.dynamics.recursion import forces
from jounce.dynamics.state import State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series, diagonal

OPEN_LOOPS = Remedy("; Robot(robot.mechanism.tree) has open loops")


def _cut_joints(m: Mechanism) -> str | None:
    return f" depend on what its cut joints transmit, loop_wrenches{OPEN_LOOPS}" if m.closure else None


def _dense_joint_wrenches(m: Mechanism, x: State) -> Series:
    """A^T (M (V' + U G) - b^T M V + W): what the bodies require, added up from the ends of the tree."""
    dense = closed_form.evaluate_state(m, x)
    M = diagonal(m.M)  # (Msys)
    own = M @ (dense.V.dot + dense.UG) - dense.b.mT @ (M @ dense.V)
    own = own if x.W is None else own + x.W
    return closed_form.split_bodies(dense.A.mT @ own).map(lambda F: F[..., 0])


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
        """The wrenches Fj = (moment; force) that the joints transmit to their bodies, and their rates.

        They are what bearings, flanges and force sensors carry, all six components: the wrench of the parent on the
        body, for the body's own motion and weight, for all that it carries, and for wrenches on these. Projected on the
        joint screw, ``X . Fj``, it is the force of the joint without drive terms. If the robot floats, the first row is
        the wrench that acts on its base, as in `inverse_dynamics`.

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
