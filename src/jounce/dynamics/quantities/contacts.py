"""Quantities of robots with contacts."""

from jounce.dynamics.contacts import Stance
from jounce.dynamics.quantities.forces import Forces
from jounce.dynamics.quantities.needs import ON_CONTACTS
from jounce.dynamics.quantities.row import Inputs, Outputs, Printed, quantity
from jounce.dynamics.state import State
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


class Contacts:
    """Rows of contacts."""

    @quantity(
        takes=Inputs(rates=3, wrenches=True),
        gives=Outputs("f", ("contacts", 6), unit="N m and N"),
        needs=(ON_CONTACTS,),
        printed=Printed(
            meaning="f: the wrenches (moment; force) of the ground on the robot at its contacts, G f = Q of the base.",
            tex=r"f = W^{-1} G^T \left(G W^{-1} G^T\right)^{-1} Q_0",
            wrench_term="what balances J^T W at the base",
            wrench_tex="f(W)",
            returns="In the order of the contacts, about their points in their axes: those of the place on the body for"
            " planes and lines, those of the ground for points.",
            raises="contacts do not balance the motion",
        ),
    )
    @staticmethod
    def contact_wrenches(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """The wrenches f of the ground on a robot at its contacts, and their rates.

        No motor drives the base: ``G f = Q_0``, the wrench that the motion takes on it. Of all f the one with the least
        weighted sum of squares is taken, see `contacts`.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> dog = jounce.load("solo12", base="floating")
        >>> feet = [jounce.Contact(f"{foot}_FOOT", "point") for foot in ("FL", "FR", "HL", "HR")]
        >>> stand, still = dog.contacts(feet), np.zeros(12)
        >>> f = stand.contact_wrenches(still, still, still, base=(np.eye(4), np.zeros(6), np.zeros(6)))
        >>> bool(abs(f[:, 5].sum() - 9.81 * dog.mechanism.M[:, 3, 3].sum()) < 1e-9)
        True
        """
        stance = Stance(m, x)
        return stance.wrenches(stance.components(Forces.inverse_dynamics.free_law(method, m)(m, x)))
