"""Rows of robots with constraints: closed loops, and contacts with the ground.

`Loops` has the coordinates that follow, the forces of motors, the wrenches of cut joints, and the motion of passive
coordinates; `Contacts` the wrenches that balance a floating robot.
"""

from dataclasses import replace

from jounce.core.cures import Remedy
from jounce.dynamics import forward, loops
from jounce.dynamics.contacts import Stance
from jounce.dynamics.quantities.forces import Forces, Matrices
from jounce.dynamics.quantities.row import (
    CLOSED,
    CUT_JOINTS,
    ON_CONTACTS,
    DriveTrains,
    Inputs,
    Need,
    Outputs,
    Printed,
    quantity,
    row_vector,
)
from jounce.dynamics.state import State
from jounce.model.drive_trains import DRIVE_TERMS
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


def passive_obstacle(m: Mechanism) -> str | None:
    """Return why passive coordinates do not move by themselves, or None."""
    if not (m.closure and m.closure.passive):
        return f" is of passive coordinates, and it has none{Remedy('; robot.closed(passive=[...]) names some')}"
    if "spring" in m.acting or "spring" not in loops.movers(m).values():
        return None
    acting = Remedy("robot.with_drives(True)", "--drives all")
    return f" takes the springs of passive coordinates, which do not act; {acting} lets all drives act"


def tree_forces(method: str, m: Mechanism, x: State, motion: loops.ClosedMotion) -> Series:
    """Return the forces that move the tree of a closed robot.

    They are (..., nv, 1).
    """
    Q = Forces.inverse_dynamics.law(method, m.tree)(m.tree, replace(x, q=motion.q, position=None))
    return Q.map(lambda Q: Q[..., None])


class Loops:
    """Rows of closed loops."""

    @quantity(
        takes=Inputs(rates=1, without_base=("body",)),
        gives=Outputs("qt", ("tree",), unit="rad or, for coordinates in m, m"),
        needs=(CLOSED,),
        printed=Printed(
            caption="coordinates of the tree",
            meaning="qt: the coordinates of all joints, with loops closed; qtd = F qd of the independent ones.",
            tex=r"\dot{q}_t = F\,\dot{q}, \quad A\,F = 0",
            tex_symbol="q_{t}",
            returns="In the order of ``mechanism.tree.coordinates``. As q in later calls it saves closing the loops"
            " again.",
        ),
    )
    @staticmethod
    def coordinates(m: Mechanism, x: State) -> Series:
        """Compute the coordinates of all joints and their rates.

        Loops of the robot are closed. ``qtd = F qd`` with the constraints ``A F = 0``. The motion of the base has no
        effect here.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("fivebar")
        >>> qt, qtd = robot.coordinates([2.2, 0.9], [1.0, 0.0])
        >>> qt.shape
        (4,)
        """
        return row_vector(loops.closed_motion(m, x).q)

    @quantity(
        takes=Inputs(rates=3, wrenches=True),
        gives=Outputs("u", ("motors",), unit="N m or, for coordinates in m, N"),
        needs=(CLOSED,),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            caption="forces of the motors",
            meaning="u: forces of the actuated joints, F_u^T u = Q, with the least weighted sum of squares.",
            tex=r"F_u^T u = Q",
            wrench_term="F_u^-T F^T J^T W",
            wrench_tex=r"F_u^{-T} F^T J^T W",
            returns="Of the motors, in the order of `actuated` in `closed`, then of coordinates in that of `passive`.",
        ),
    )
    @staticmethod
    def actuator_forces(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute the forces u of the actuated joints and their rates.

        The robot has closed loops. ``F_u^T u = Q``, F_u the velocities of the actuated joints from those of the
        independent coordinates. With more motors than coordinates, the weighted sum of u^2 is least. If the coordinates
        are those of the motors, u = Q. Of passive coordinates ``Q_p - F_p^T u`` follows, what their motion needs beyond
        motors and the springs and dampers that act: it vanishes along motions that the robot can do.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("fivebar")
        >>> robot.actuator_forces([2.2, 0.9], [0, 0], [0, 0]).shape
        (2,)
        """
        Q = Forces.inverse_dynamics.law(method, m)(m, x).map(lambda Q: Q[..., -m.n :, None])
        return row_vector(loops.actuator_forces(m, loops.closed_motion(m, x).F, Q))

    @quantity(
        takes=Inputs(rates=3, wrenches=True),
        gives=Outputs("p", ("passive",), first_rate=2, unit="rad/s^2 or, for coordinates in m, m/s^2"),
        needs=(CLOSED, Need(passive_obstacle)),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            caption="accelerations of passive coordinates",
            meaning="p2d: the accelerations of passive coordinates, from the motion of the others.",
            tex=r"Q_p(q, \dot{q}, \ddot{q}) = F_p^T u",
            wrench_term="what they add",
            wrench_tex=r"\ddot{p}(W)",
            returns="Of the passive coordinates, in the order of `passive` in `closed`.",
        ),
    )
    @staticmethod
    def passive_accelerations(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute the accelerations of passive coordinates of a closed robot.

        Motors move the others. With these accelerations, of every order, nothing is lacking in `actuator_forces`:
        hybrid dynamics (R. Featherstone, Rigid Body Dynamics Algorithms, 9.2). Entries of passive coordinates in q2d,
        q3d, ... are not read.

        Examples
        --------
        >>> import jounce, warnings
        >>> with warnings.catch_warnings(action="ignore"):  # of a passive coordinate without a spring
        ...     arms = jounce.load("fivebar").closed(actuated=["left_shoulder"], passive=["right_shoulder"])
        >>> [p2d] = arms.passive_accelerations([2.2, 0.9], [0, 0], [0, 0])
        >>> motor, lack = arms.actuator_forces([2.2, 0.9], [0, 0], [0, p2d])
        >>> bool(abs(lack) < 1e-12)
        True
        """
        laws = (row.law(method, m) for row in (Matrices.mass_matrix, Forces.inverse_dynamics))
        return row_vector(forward.passive_accelerations(m, x, *laws))

    @quantity(
        takes=Inputs(rates=3, wrenches=True),
        gives=Outputs("Wl", ("loops", 6), unit="N m and N"),
        needs=(CLOSED, CUT_JOINTS),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            caption="wrenches at the cut joints",
            meaning="Wl: the wrench (moment; force) of a cut joint on the body of its second frame, in the first.",
            tex=r"W_l = R^T \lambda, \quad A_d^T \lambda = Q_d",
            tex_symbol="W_{l}",
            wrench_term="what they add",
            wrench_tex=r"W_l(W)",
            returns="Moment and force of each cut joint on the body of its second frame, in the axes of its first"
            " frame, about the origin of that.",
        ),
    )
    @staticmethod
    def loop_wrenches(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute the wrenches that cut joints transmit, and their rates.

        The robot has closed loops. ``Wl = R^T y`` with ``A_d^T y = Q_d``: the dependent joints of the tree need no
        motors. Where constraints are redundant, as those of planar loops, the shortest y is taken.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("fivebar")
        >>> robot.loop_wrenches([2.2, 0.9], [0, 0], [0, 0]).shape
        (1, 6)
        """
        motion = loops.closed_motion(m, x)
        return loops.loop_wrenches(m, motion, tree_forces(method, m, x, motion))


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
        """Compute the wrenches f of the ground on the robot, with rates.

        They act at its contacts. No motor drives the base: ``G f = Q_0``, the wrench that the motion takes on it. Of
        all f the one with the least weighted sum of squares is taken, see `contacts`.

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
