"""Partial derivatives of forces and accelerations."""

from dataclasses import replace

from jounce.dynamics import drive_terms, loops, partials
from jounce.dynamics.quantities.forces import Forces, Forward
from jounce.dynamics.quantities.loops import tree_forces
from jounce.dynamics.quantities.row import WITHOUT_CONTACTS, DriveTrains, Inputs, Need, Outputs, Printed, quantity
from jounce.dynamics.recursion import force_partials
from jounce.dynamics.state import State, velocity_drift
from jounce.model.drive_trains import DRIVE_TERMS
from jounce.model.mechanism import Mechanism
from jounce.spatial.series import Series


def no_closed_tensors(m: Mechanism) -> str | None:
    """Return why a robot with loops has no tensors, or None.

    The tensors are those of second derivatives. Products of kernels alone hold what loops add to them.
    """
    if m.closure is None:
        return None
    return " has closed loops: there are no tensors; kernel.hessian and kernel.hvp give their weighted sums"


class Partials:
    """Rows of partial derivatives."""

    @quantity(
        takes=Inputs(rates=Forces.inverse_dynamics.takes.rates, wrenches=True),
        gives=Outputs("P", ("rates", "nv", "nv"), unit="that of Q over that of q, qd, q2d"),
        needs=(WITHOUT_CONTACTS,),
        drives=DriveTrains(
            DRIVE_TERMS, law=lambda m, x: partials.extend_to_rates(*drive_terms.partials(m, x.q, m.acting))
        ),
        printed=Printed(
            caption="partial derivatives of the generalized forces",
            meaning="P[j] = dQ/dq^(j): the partial derivatives of the generalized forces by q, qd and q2d.",
            tex=r"P_j = \partial Q / \partial q^{(j)}",
            wrench_term="d(J^T W)/dq, of wrenches W fixed in the bodies",
            wrench_tex=r"\partial (J^T W) / \partial q^{(j)}",
            returns="Row i, column k: the derivative of force i by coordinate k. Pd is (..., 4, nv, nv), P2d (..., 5,"
            " nv, nv), and so on.",
        ),
    )
    @staticmethod
    def inverse_dynamics_partials(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute the partial derivatives P of the generalized forces, with rates.

        They are those by q, qd and q2d. ``P[j] = dQ/dq^(j)``, in the order q, qd, q2d; ``Pd[j] = dQd/dq^(j)``, j = 0 ..
        3; ``P2d[j] = dQ2d/dq^(j)``, j = 0 .. 4. P[2] is the mass matrix. Drive terms that act contribute.

        Components of wrenches in the body frames are held constant: a wrench turns with its body as q changes. Of one
        that keeps its direction in space, they depend on q, and the derivative has one more term.

        If the robot floats, the first six rows are those of the wrench on the base, and the first six columns the
        derivatives along a displacement of the base by a twist d in its own axes, C exp(wedge(d)) (j = 0), by its twist
        V (j = 1), by Vd (j = 2) and so on, with the other components held. Derivatives by the motion of the ground of a
        fixed robot are left out. Those of a closed robot are derivatives by its independent coordinates, which the
        others follow.

        References
        ----------
        Singh, Russell, Wensing, "Efficient Analytical Derivatives of Rigid-Body Dynamics Using Spatial Vector Algebra",
        IEEE Robotics and Automation Letters 7(2), 2022, for P.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot = jounce.load("planar2r")
        >>> P, Pd = robot.inverse_dynamics_partials([0, 0], [1, 0], [0, 0], [0, 0])
        >>> P.shape, Pd.shape
        ((3, 2, 2), (4, 2, 2))
        >>> bool(np.allclose(P[2], robot.mass_matrix([0, 0])))
        True
        """
        of_forces = {"recursion": force_partials.partials, "closed_form": partials.compute_dense_partials}[method]
        if not m.closure:
            return partials.extend_to_rates(*of_forces(m, x.q, x.W, x.base), velocity_drift(m, x.q, x.base))
        # K, D and M of the tree with drive terms, then those of the independent coordinates.
        motion = loops.closed_motion(m, x)
        of_bodies = of_forces(m.tree, motion.q, x.W, x.base)
        of_drives = drive_terms.partials(m.tree, motion.q, m.acting)
        K, D, M = (P + drive_terms.pad_base(m, term, (-2, -1)) for P, term in zip(of_bodies, of_drives, strict=True))
        closed = partials.closed_partials(motion, (K, D, M), tree_forces(method, m, x, motion))
        return partials.extend_to_rates(*closed, velocity_drift(m, x.q, x.base))

    @quantity(
        takes=Inputs(rates=Forces.inverse_dynamics.takes.rates, wrenches=True),
        gives=Outputs(
            "Qqq",
            ("nv", "nv", "nv"),
            unit="that of Q over that of q, qd, q2d, twice",
            results=("Qqq", "Qqqd", "Qqdqd", "Qqq2d"),
        ),
        needs=(WITHOUT_CONTACTS, Need(no_closed_tensors)),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            caption="second partial derivatives of the generalized forces",
            meaning="Qqq = d2Q/dq dq, Qqqd = d2Q/dq dqd, Qqdqd = d2Q/dqd dqd, Qqq2d = d2Q/dq dq2d = dM/dq: the second"
            " partial derivatives of the generalized forces.",
            tex=r"\partial^2 Q / \partial (q, \dot{q}, \ddot{q})^2",
            wrench_term="d2(J^T W)/dq2, of wrenches W fixed in the bodies",
            wrench_tex=r"\partial^2 (J^T W) / \partial q^2",
            returns="Entry (i, j, k): the derivative of force i by coordinate j, then by coordinate, velocity or"
            " acceleration k. All others are zero.",
        ),
    )
    @staticmethod
    def inverse_dynamics_second_partials(m: Mechanism, x: State) -> Series:
        """Compute the second partial derivatives of the generalized forces: four tensors.

        ``Qqq = d2Q/dq dq``, ``Qqqd = d2Q/dq dqd``, ``Qqdqd = d2Q/dqd dqd`` and ``Qqq2d = d2Q/dq dq2d``, which is that
        of the mass matrix by q. Drive terms that act contribute. Where sums over the forces with given weights are
        enough, as in steps of solvers, `Kernel.hessian` computes them at a fraction of the cost, with all rates.

        As in `inverse_dynamics_partials`, wrenches are fixed in the bodies, and a base that floats is displaced by a
        twist in its own axes. Displacements of one base, and of one joint of several columns, do not commute: there,
        Qqq is not symmetric, and k is that of the second derivative taken.

        References
        ----------
        S. Singh, R. P. Russell, P. M. Wensing, "On Second-Order Derivatives of Rigid-Body Dynamics: Theory &
        Implementation", arXiv:2302.06001.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot = jounce.load("iiwa14")
        >>> Qqq, Qqqd, Qqdqd, Qqq2d = robot.inverse_dynamics_second_partials(*np.ones((3, 7)))
        >>> Qqq.shape, bool(np.allclose(Qqq, Qqq.swapaxes(1, 2)))
        ((7, 7, 7), True)
        """
        tensors = [*force_partials.second_partials(m, x.q, x.W, x.base)]
        # Of drive terms, friction alone is not linear, in qd: it enters Qqdqd.
        if len(set(DRIVE_TERMS) & set(m.acting)) > 0:
            tensors[2] = tensors[2] + drive_terms.second_partials(m, x.q, m.acting)
        return Series.of(tensors)

    @quantity(
        takes=Inputs(rates=3, forces=True, wrenches=True),
        gives=Outputs("dq", ("nv", "nv"), unit="that of q2d over that of q, qd, Q", results=("dq", "dqd", "Minv")),
        needs=(WITHOUT_CONTACTS,),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            caption="partial derivatives of the accelerations",
            meaning="dq = dq2d/dq, dqd = dq2d/dqd, Minv = dq2d/dQ = M^-1: the partial derivatives of forward dynamics.",
            tex=r"\partial \ddot{q} / \partial (q, \dot{q}, Q)",
            wrench_term="-M^-1 d(J^T W)/dq, of wrenches W fixed in the bodies",
            wrench_tex=r"\partial (-M^{-1} J^T W) / \partial q",
            returns="dq2d/dq, dq2d/dqd and the inverse of the mass matrix. Row i, column k: the derivative of"
            " acceleration i by coordinate, velocity or force k.",
        ),
    )
    @staticmethod
    def forward_dynamics_partials(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Compute the partial derivatives of the accelerations q2d.

        They are those by q, qd and Q, which linearise `forward_dynamics`. ``dq2d/dq = -M^-1 dQ/dq``,
        ``dq2d/dqd = -M^-1 dQ/dqd``, with the derivatives of `inverse_dynamics_partials` at the accelerations that Q
        causes, and ``dq2d/dQ = M^-1``. If the robot floats, those of (Vd; q2d): by a displacement of the base by a
        twist in its own axes and q, by (V; qd), and by Q. Wrenches are held constant in the body frames.

        References
        ----------
        Carpentier, Mansard, "Analytical Derivatives of Rigid Body Dynamics Algorithms", Robotics: Science and Systems
        2018, for the relation of the two.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot = jounce.load("iiwa14")
        >>> dq, dqd, Minv = robot.forward_dynamics_partials(np.ones(7), np.zeros(7), np.zeros(7))
        >>> bool(np.allclose(Minv @ robot.mass_matrix(np.ones(7)), np.eye(7)))
        True
        """
        moving = with_accelerations(m, x, method)
        P = Partials.inverse_dynamics_partials.law(method, m)(m, moving)
        return Series.of(partials.acceleration_partials(P[0]))

    @quantity(
        takes=Inputs(rates=3, forces=True, wrenches=True),
        gives=Outputs(
            "dqdq",
            ("nv", "nv", "nv"),
            unit="that of q2d over that of q, qd, Q, twice",
            results=("dqdq", "dqdqd", "dqddqd", "dqdQ"),
        ),
        needs=(WITHOUT_CONTACTS, Need(no_closed_tensors)),
        drives=DriveTrains(DRIVE_TERMS),
        printed=Printed(
            caption="second partial derivatives of the accelerations",
            meaning="dqdq = d2q2d/dq dq, dqdqd = d2q2d/dq dqd, dqddqd = d2q2d/dqd dqd, dqdQ = d2q2d/dq dQ = dM^-1/dq:"
            " the second partial derivatives of forward dynamics.",
            tex=r"\partial^2 \ddot{q} / \partial (q, \dot{q}, Q)^2",
            wrench_term="-M^-1 d2(J^T W)/dq2, of wrenches W fixed in the bodies",
            wrench_tex=r"\partial^2 (-M^{-1} J^T W) / \partial q^2",
            returns="Entry (i, j, k): the derivative of acceleration i by coordinate or velocity j, then by coordinate,"
            " velocity or force k. All others are zero.",
        ),
    )
    @staticmethod
    def forward_dynamics_second_partials(m: Mechanism, x: State) -> Series:
        """Compute the second partial derivatives of the accelerations q2d.

        They are those by q, qd and Q: four tensors. With u and w among q, qd and Q, and a = q2d:
        ``d2a/du dw = -M^-1 (d2Q/du dw + dM/du da/dw + dM/dw da/du)``, from `inverse_dynamics_second_partials` at the
        accelerations that Q causes and `forward_dynamics_partials`. What is said there of wrenches and of bases holds
        here.

        References
        ----------
        S. Singh, R. P. Russell, P. M. Wensing, "On Second-Order Derivatives of Rigid-Body Dynamics: Theory &
        Implementation", arXiv:2302.06001, for the relation of the two.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot, q = jounce.load("planar2r"), np.ones(2)
        >>> dqdq, dqdqd, dqddqd, dqdQ = robot.forward_dynamics_second_partials(q, q, q)
        >>> bool(np.allclose(dqddqd, dqddqd.swapaxes(1, 2)))
        True
        """
        moving = with_accelerations(m, x, "recursion")
        of_forces = Partials.inverse_dynamics_second_partials.law("recursion", m)(m, moving)
        P = Partials.inverse_dynamics_partials.law("recursion", m)(m, moving)
        first = partials.acceleration_partials(P[0])
        return Series.of(partials.second_acceleration_partials(first, of_forces.upto(3)))


def with_accelerations(m: Mechanism, x: State, method: str) -> State:
    """Return the state with the accelerations that its forces cause."""
    # (..., nv, 1): those of a floating base come first.
    accelerations = Forward.forward_dynamics.law(method, m)(m, x)[0][..., None]
    moving = replace(x, q=Series.of([x.q[0], x.q[1], accelerations[..., -m.n :, :]]))
    if m.floats and x.base is not None:
        base = replace(x.base, V=Series.of([x.base.V[0], accelerations[..., :6, :]]))
        moving = replace(moving, base=base)
    return moving
