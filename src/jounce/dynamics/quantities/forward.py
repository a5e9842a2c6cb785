"""Forward dynamics: the accelerations that forces cause."""

from dataclasses import replace

from jounce.dynamics import drive_terms, forward
from jounce.dynamics.quantities.forces import Forces
from jounce.dynamics.quantities.matrices import Matrices
from jounce.dynamics.quantities.needs import WITHOUT_CONTACTS
from jounce.dynamics.quantities.row import DriveTrains, Inputs, Outputs, Printed, quantity, row_vector
from jounce.dynamics.recursion import articulated
from jounce.dynamics.recursion import forces as recursion_forces
from jounce.dynamics.state import JointMotion, Law, State
from jounce.model.drives import ALL_DRIVE_TERMS, load_friction_of_motors
from jounce.model.mechanism import Mechanism
from jounce.spatial.linear import Factors
from jounce.spatial.series import Series


def _loaded_accelerations(law: Law, m: Mechanism, x: State) -> Series:
    """Accelerations from what is left of the forces: its rates take those of q, each of them known by then."""
    moving = Series(lambda k: x.q[k] if k < 2 else found[k - 2][..., -m.n :, None])
    left = x.Q - drive_terms.load_forces(m, load_friction_of_motors, moving, x.Q)
    found = law(m, replace(x, Q=left))
    return found


class Forward:
    """Rows of accelerations."""

    @quantity(
        takes=Inputs(rates=3, forces=True, wrenches=True),
        gives=Outputs("q", ("nv",), first_rate=2, unit="rad/s^2 or, for coordinates in m, m/s^2"),
        needs=(WITHOUT_CONTACTS,),
        drives=DriveTrains(ALL_DRIVE_TERMS, load=_loaded_accelerations),
        sweep=recursion_forces.MOVING_SWEEP,
        of_motors="elastic_forward_dynamics",
        printed=Printed(
            caption="accelerations of the coordinates",
            meaning="q2d = M^-1 (Q - C qd - Qgrav): the accelerations that generalized forces Q cause.",
            tex=r"\ddot{q} = M^{-1} \left(Q - C(q, \dot{q})\,\dot{q} - Q_{\mathrm{grav}}(q)\right)",
            wrench_term="-M^-1 J^T W",
            wrench_tex="-M^{-1} J^T W",
            returns="If the robot floats, (Vd; q2d), (V2d; q3d), ...: they begin with the rates of the components of"
            " the base's twist.",
        ),
    )
    @staticmethod
    def forward_dynamics(m: Mechanism, x: State, method: str = "recursion") -> Series:
        """Accelerations q2d from generalized forces, with as many rates as Q has.

        ``q2d = M^-1 (Q - C qd - Qgrav - Qext)``: the inverse of `inverse_dynamics`, of every order. Drive terms that
        act are subtracted from Q; armature that acts is in M. Of a robot that floats, base is (C, V), and the
        acceleration of the base is found too: ``(Vd; q2d)``.

        Errors grow with each rate by damping over inertia, by the slope of friction over inertia, by stiffness over
        inertia with each second one. Rates that are off by more than 1e-6 of their size are refused: an
        `UncertainError` names them. Compiled kernels and traced arrays of JAX check nothing.

        Where the mass matrix is singular at one position, results are infinite or NaN, with NumPy's warning. Compiled
        kernels, generated code and arrays of JAX do not look at it: they may give large numbers that are rounding.

        References
        ----------
        Müller & Kumar (EOM1); R. Featherstone, Rigid Body Dynamics Algorithms, 6.3 for the factors of M, 7.3 for the
        articulated bodies that robots with long branches take.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot = jounce.load("iiwa14")
        >>> q, qd, q2d, q3d = np.ones((4, 7))
        >>> Q, Qd = robot.inverse_dynamics(q, qd, q2d, q3d)
        >>> np.round(robot.forward_dynamics(q, qd, Q, Qd), 9) + 0.0
        array([[1., 1., 1., 1., 1., 1., 1.],
               [1., 1., 1., 1., 1., 1., 1.]])
        """
        if method == "closed_form" and not m.closure:
            return row_vector(forward.solve_dense(m, x.q, x.Q, x.W, x.base))
        inverse = Forces.inverse_dynamics.free_law(method, m)
        if articulated.has_deep_branches(m) and not m.closure:
            M: forward.Solver = articulated.ArticulatedBodies.of(m, x.q[0])
        else:
            M = Factors.of(Matrices.mass_matrix.law(method, m)(m, x)[0])

        def required(q: Series, base: JointMotion | None) -> Series:
            return inverse(m, replace(x, q=q, base=base)).map(lambda Q: Q[..., None])

        return row_vector(forward.solve_with_inverse_dynamics(M, required, m, x.q, x.Q, x.base))
