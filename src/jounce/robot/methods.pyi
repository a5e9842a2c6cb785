"""Written by `make stubs` from the table of quantities."""

from typing import Any, Literal, Never, TypeAlias, overload

from jounce.core import typing as _types
from jounce.core.typing import Array, ArrayLike, Floats, Named, Rates
from jounce.dynamics.quantities.names import QuantityName as _QuantityName
from jounce.native.kernel import Kernel

Nothing: TypeAlias = _types.Nothing[Never]
Out: TypeAlias = _types.Out | Nothing
DriveTerms: TypeAlias = _types.DriveTerms | Nothing
Form: TypeAlias = _types.Form | Nothing
Frame: TypeAlias = _types.Frame | Nothing
LoadFrame: TypeAlias = _types.LoadFrame | Nothing
Method: TypeAlias = _types.Method | Nothing
Side: TypeAlias = _types.Side | Nothing
Product: TypeAlias = _types.Product | Nothing
QuantityName: TypeAlias = _QuantityName | Nothing

class Methods:
    """What robots compute."""

    # its row: jounce/dynamics/quantities/forces.py
    @overload
    def inverse_dynamics(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        wrench: Rates | None = None,
        side: Side | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The generalized forces Q of a motion and their time derivatives Qd, Q2d, ... (RNEA with rates).

        ``Q = M(q) q2d + C(q, qd) qd + Qgrav(q) + Qext``, with the drive terms that act added. With `contacts`, less
        what their wrenches do: six rows of the base that vanish, to rounding, and the torques of the joints.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of Q.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        side : "links", optional
            To be given for this release where joints are elastic: Q is the force of the links, see `motor_torques`.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Q : (..., nv), or tuple of (..., nv)
            Unit: N m or, for coordinates in m, N; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, `wrench` has fewer rates than it takes, or a name is
            unknown.

        References
        ----------
        Müller & Kumar, (EOM1), (EOM1stOrder), (EOM2ndOrder); as a recursion to order 2, G. Buondonno, A. De Luca, IROS
        2015; to any order, S. Kumar, A. Müller, ICRA 2021.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> Q, Qd = robot.inverse_dynamics([0, 0], [1, 0], [0, 0], [0, 0])
        >>> Q.round(4), Qd.round(4)
        (array([29.43,  9.81]), array([0., 0.]))
        """
    @overload
    def inverse_dynamics(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        wrench: Rates | None = None,
        side: Side | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def inverse_dynamics(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        side: Side | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def inverse_dynamics(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        side: Side | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/forces.py
    @overload
    def gravity_forces(
        self,
        q: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The generalized gravity forces Qgrav(q) = dU/dq, with U the potential energy of gravity, and their rates.

        Parameters
        ----------
        q : (..., n)
            Coordinates: rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative of Qgrav.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Qgrav : (..., nv), or tuple of (..., nv)
            Unit: N m or, for coordinates in m, N; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        References
        ----------
        Müller & Kumar, (25), (Qgravdot), (52).

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").gravity_forces([0, 0])
        array([29.43,  9.81])
        """
    @overload
    def gravity_forces(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def gravity_forces(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def gravity_forces(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/forward.py
    @overload
    def forward_dynamics(
        self,
        q: Named,
        qd: Named,
        Q: Named,
        *,
        wrench: Rates | None = None,
        side: Side | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """Accelerations q2d from generalized forces, with as many rates as Q has.

        ``q2d = M^-1 (Q - C qd - Qgrav - Qext)``: the inverse of `inverse_dynamics`, of every order. Drive terms that
        act are subtracted from Q; armature that acts is in M. Of a robot that floats, base is (C, V), and the
        acceleration of the base is found too: ``(Vd; q2d)``.

        Errors grow with each rate by damping over inertia, by the slope of friction over inertia, by stiffness over
        inertia with each second one. Rates that are off by more than 1e-6 of their size are refused: an
        `UncertainError` names them. Compiled kernels and traced arrays of JAX check nothing.

        Where the mass matrix is singular at one position, results are infinite or NaN, with NumPy's warning. Compiled
        kernels, generated code and arrays of JAX do not look at it: they may give large numbers that are rounding.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        Q : (..., nv)
            Generalized forces: N m, or N for coordinates in m. If the robot floats, they begin with the wrench (moment;
            force) that acts on the base, in its axes: zero in flight.
        Qd, Q2d, *higher : (..., nv), optional
            Further rates, each for one more time derivative of q2d.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        side : "links", optional
            To be given for this release where joints are elastic: Q is the force of the links, see
            `elastic_forward_dynamics`.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        q2d : (..., nv), or tuple of (..., nv)
            Unit: rad/s^2 or, for coordinates in m, m/s^2; of rates per s, per s^2, and so on. If the robot floats, (Vd;
            q2d), (V2d; q3d), ...: they begin with the rates of the components of the base's twist.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, `wrench` has fewer rates than it takes, the mass matrix is
            singular at all positions, or a name is unknown.

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
    @overload
    def forward_dynamics(
        self,
        q: Named,
        qd: Named,
        Q: Named,
        Qd: Named,
        *,
        wrench: Rates | None = None,
        side: Side | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def forward_dynamics(
        self,
        q: Named,
        qd: Named,
        Q: Named,
        Qd: Named,
        Q2d: Named,
        *,
        wrench: Rates | None = None,
        side: Side | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def forward_dynamics(
        self,
        q: Named,
        qd: Named,
        Q: Named,
        Qd: Named,
        Q2d: Named,
        Q3d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        side: Side | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/partials.py
    @overload
    def inverse_dynamics_partials(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The partial derivatives P of the generalized forces by q, qd and q2d, and those of the forces' rates.

        ``P[j] = dQ/dq^(j)``, in the order q, qd, q2d; ``Pd[j] = dQd/dq^(j)``, j = 0 .. 3; ``P2d[j] = dQ2d/dq^(j)``,
        j = 0 .. 4. P[2] is the mass matrix. Drive terms that act contribute.

        Components of wrenches in the body frames are held constant: a wrench turns with its body as q changes. Of one
        that keeps its direction in space, they depend on q, and the derivative has one more term.

        If the robot floats, the first six rows are those of the wrench on the base, and the first six columns the
        derivatives along a displacement of the base by a twist d in its own axes, C exp(wedge(d)) (j = 0), by its twist
        V (j = 1), by Vd (j = 2) and so on, with the other components held. Derivatives by the motion of the ground of a
        fixed robot are left out. Those of a closed robot are derivatives by its independent coordinates, which the
        others follow.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of P.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        P : (..., 3, nv, nv), or tuple of them
            Unit: that of Q over that of q, qd, q2d; of rates per s, per s^2, and so on. Row i, column k: the derivative
            of force i by coordinate k. Pd is (..., 4, nv, nv), P2d (..., 5, nv, nv), and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, `wrench` has fewer rates than it takes, or a name is
            unknown.

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
    @overload
    def inverse_dynamics_partials(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def inverse_dynamics_partials(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def inverse_dynamics_partials(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/partials.py
    def inverse_dynamics_second_partials(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array, Array]:
        """The second partial derivatives of the generalized forces: four tensors.

        ``Qqq = d2Q/dq dq``, ``Qqqd = d2Q/dq dqd``, ``Qqdqd = d2Q/dqd dqd`` and ``Qqq2d = d2Q/dq dq2d``, which is that
        of the mass matrix by q. Drive terms that act contribute. Where sums over the forces with given weights are
        enough, as in steps of solvers, `Kernel.hessian` computes them at a fraction of the cost, with all rates.

        As in `inverse_dynamics_partials`, wrenches are fixed in the bodies, and a base that floats is displaced by a
        twist in its own axes. Displacements of one base, and of one joint of several columns, do not commute: there,
        Qqq is not symmetric, and k is that of the second derivative taken.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Qqq, Qqqd, Qqdqd, Qqq2d : (..., nv, nv, nv)
            Unit: that of Q over that of q, qd, q2d, twice. Entry (i, j, k): the derivative of force i by coordinate j,
            then by coordinate, velocity or acceleration k. All others are zero.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, `wrench` has fewer rates than it takes, or a name is
            unknown.

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

    # its row: jounce/dynamics/quantities/partials.py
    def forward_dynamics_partials(
        self,
        q: Named,
        qd: Named,
        Q: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]:
        """The partial derivatives of the accelerations q2d by q, qd and Q, which linearise `forward_dynamics`.

        ``dq2d/dq = -M^-1 dQ/dq``, ``dq2d/dqd = -M^-1 dQ/dqd``, with the derivatives of `inverse_dynamics_partials` at
        the accelerations that Q causes, and ``dq2d/dQ = M^-1``. If the robot floats, those of (Vd; q2d): by a
        displacement of the base by a twist in its own axes and q, by (V; qd), and by Q. Wrenches are held constant in
        the body frames.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        Q : (..., nv)
            Generalized forces: N m, or N for coordinates in m. If the robot floats, they begin with the wrench (moment;
            force) that acts on the base, in its axes: zero in flight.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        dq, dqd, Minv : (..., nv, nv)
            Unit: that of q2d over that of q, qd, Q. dq2d/dq, dq2d/dqd and the inverse of the mass matrix. Row i, column
            k: the derivative of acceleration i by coordinate, velocity or force k.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, `wrench` has fewer rates than it takes, the mass matrix is
            singular at all positions, or a name is unknown.

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

    # its row: jounce/dynamics/quantities/partials.py
    def forward_dynamics_second_partials(
        self,
        q: Named,
        qd: Named,
        Q: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array, Array]:
        """The second partial derivatives of the accelerations q2d by q, qd and Q: four tensors.

        With u and w among q, qd and Q, and a = q2d: ``d2a/du dw = -M^-1 (d2Q/du dw + dM/du da/dw + dM/dw da/du)``,
        from `inverse_dynamics_second_partials` at the accelerations that Q causes and `forward_dynamics_partials`. What
        is said there of wrenches and of bases holds here.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        Q : (..., nv)
            Generalized forces: N m, or N for coordinates in m. If the robot floats, they begin with the wrench (moment;
            force) that acts on the base, in its axes: zero in flight.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        dqdq, dqdqd, dqddqd, dqdQ : (..., nv, nv, nv)
            Unit: that of q2d over that of q, qd, Q, twice. Entry (i, j, k): the derivative of acceleration i by
            coordinate or velocity j, then by coordinate, velocity or force k. All others are zero.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, `wrench` has fewer rates than it takes, the mass matrix is
            singular at all positions, or a name is unknown.

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

    # its row: jounce/dynamics/quantities/regressors.py
    @overload
    def regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The inertial-parameter regressor Y and its time derivatives: Q = Y p, with p = `inertial_parameters`.

        The forces of the rigid mechanism are linear in p, and so are their rates: Qd = Yd p, Q2d = Y2d p, .... Wrenches
        on bodies and drive terms that act add to Q what they add in `inverse_dynamics`. Drive terms are linear in their
        parameters too: `drives` appends their columns.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of Y.
        drives : bool, str or iterable of str, optional
            Columns to append: nb, one per joint variable, for each of "armature", "damping", "friction", "stribeck",
            "spring" and "offset", in this order; True appends these. Their parameters are those of `Robot.drives`, of
            the spring its stiffness; speeds of friction and the rest position of the spring are those of the robot.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Y : (..., nv, 10 nb), or tuple of (..., nv, 10 nb)
            Unit: that of Q over kg, kg m or kg m^2; of rates per s, per s^2, and so on. With drives, k nb columns more
            for k terms: nb in 10 nb counts a floating base, that in k nb does not.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        References
        ----------
        C. G. Atkeson, C. H. An, J. M. Hollerbach, "Estimation of Inertial Parameters of Manipulator Loads and Links",
        International Journal of Robotics Research 5(3), 1986.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> Y, Yd = robot.regressor([0, 0], [1, 0], [0, 0], [0, 0])
        >>> Y.shape, (Y @ robot.inertial_parameters).round(6)
        ((2, 20), array([29.43,  9.81]))
        >>> robot.regressor([0, 0], [1, 0], [0, 0], drives=("damping", "offset"))[:, 20:]
        array([[1., 0., 1., 0.],
               [0., 0., 0., 1.]])
        """
    @overload
    def regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/regressors.py
    @overload
    def momentum_regressor(
        self,
        q: Named,
        qd: Named,
        *,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The regressor Yp of the generalized momentum and its time derivatives: M qd = Yp p.

        p are the `inertial_parameters`. ``Y(q, qd, q2d) = Ypd(q, qd, q2d) + R(q, qd)`` of the `regressor` Y: the forces
        are the rate of the momentum and what q and qd determine, so that their integral needs no q2d. Of the drive
        terms only the armature has momentum; the columns of the others are zero.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of Yp.
        drives : bool, str or iterable of str, optional
            Columns to append: nb, one per joint variable, for each of "armature", "damping", "friction", "stribeck",
            "spring" and "offset", in this order; True appends these. Their parameters are those of `Robot.drives`, of
            the spring its stiffness; speeds of friction and the rest position of the spring are those of the robot.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Yp : (..., nv, 10 nb), or tuple of (..., nv, 10 nb)
            Unit: that of p over kg, kg m or kg m^2; of rates per s, per s^2, and so on. With drives, k nb columns more
            for k terms: nb in 10 nb counts a floating base, that in k nb does not.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        References
        ----------
        J.-J. E. Slotine, W. Li, "On the Adaptive Control of Robot Manipulators", International Journal of Robotics
        Research 6(3), 1987: filtered forces without accelerations.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> Yp = robot.momentum_regressor([0, 0], [0, 1])
        >>> Yp.shape, (Yp @ robot.inertial_parameters).round(6)
        ((2, 20), array([2., 1.]))
        >>> robot.momentum_regressor([0, 0], [2, 1], drives=("armature", "damping"))[:, 20:]
        array([[2., 0., 0., 0.],
               [0., 1., 0., 0.]])
        """
    @overload
    def momentum_regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def momentum_regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def momentum_regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        /,
        *higher: Named,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/regressors.py
    @overload
    def energy_regressor(
        self,
        q: Named,
        qd: Named,
        *,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The regressor YE of the energy and its time derivatives: T + U = YE p.

        p are the `inertial_parameters`. While the base is at rest, the rate of the energy is the power of the forces,
        ``YEd(q, qd, q2d) = qd . Y(q, qd, q2d)`` of the `regressor` Y, so that the integral of the power needs no q2d.
        Of the drive terms the armature and the spring have energy; the columns of the others are zero.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of YE.
        drives : bool, str or iterable of str, optional
            Columns to append: nb, one per joint variable, for each of "armature", "damping", "friction", "stribeck",
            "spring" and "offset", in this order; True appends these. Their parameters are those of `Robot.drives`, of
            the spring its stiffness; speeds of friction and the rest position of the spring are those of the robot.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        YE : (..., 10 nb), or tuple of (..., 10 nb)
            Unit: J over kg, kg m or kg m^2; of rates per s, per s^2, and so on. With drives, k nb columns more for k
            terms: nb in 10 nb counts a floating base, that in k nb does not.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        References
        ----------
        M. Gautier, W. Khalil, "On the Identification of the Inertial Parameters of Robots", IEEE Conference on Decision
        and Control, 1988.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> YE = robot.energy_regressor([0, 0], [1, 1])
        >>> YE.shape, (YE @ robot.inertial_parameters).round(6)
        ((20,), np.float64(5.0))
        """
    @overload
    def energy_regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def energy_regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def energy_regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        /,
        *higher: Named,
        drives: DriveTerms = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/matrices.py
    @overload
    def mass_matrix(
        self,
        q: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The generalized mass matrix M(q) = J^T M J and its rates Md, M2d, ... (CRBA with rates).

        The armature that acts is added, see `with_drives`.

        Parameters
        ----------
        q : (..., n)
            Coordinates: rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative of M.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        M : (..., nv, nv), or tuple of (..., nv, nv)
            Unit: kg m^2, kg m or kg; of rates per s, per s^2, and so on. Symmetric.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

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
    @overload
    def mass_matrix(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def mass_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def mass_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/matrices.py
    @overload
    def coriolis_matrix(
        self,
        q: Named,
        qd: Named,
        *,
        form: Form = "paper",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The Coriolis matrix C(q, qd) of the paper, or with ``form="skew"`` the one for passivity-based control.

        Both give the same forces C qd. For the skew form, (Cbar), ``Md - 2 C`` is skew-symmetric, and so are its rates;
        for the paper's, (Csys), only ``qd^T (Md - 2 C) qd = 0``.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of C.
        form : str, optional
            "paper" or "skew".
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        C : (..., nv, nv), or tuple of (..., nv, nv)
            Unit: kg m^2/s, kg m/s or kg/s; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

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
    @overload
    def coriolis_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        form: Form = "paper",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def coriolis_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        form: Form = "paper",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def coriolis_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        /,
        *higher: Named,
        form: Form = "paper",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/matrices.py
    @overload
    def skew_coriolis_matrix(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The Coriolis matrix Cbar(q, qd) for passivity-based control: ``coriolis_matrix(..., form="skew")``.

        ``Md - 2 Cbar`` is skew-symmetric, and so are its rates.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of Cbar.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Cbar : (..., nv, nv), or tuple of (..., nv, nv)
            Unit: kg m^2/s, kg m/s or kg/s; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

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
    @overload
    def skew_coriolis_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def skew_coriolis_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def skew_coriolis_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/bodies.py
    @overload
    def poses(
        self,
        q: Named,
        *,
        body: str | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The poses H(q) of the body frames in the inertial frame, and their rates.

        ``H = [[R, r], [0, 1]]`` maps body coordinates to inertial ones; ``Hd = H wedge(V)``, V the body-fixed twist.

        Parameters
        ----------
        q : (..., n)
            Coordinates: rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative of H.
        body : str, optional
            A body or a link merged into one; all bodies by default.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        H : (..., nb, 4, 4), or (..., 4, 4) of one body; with rates a tuple of them
            Unit: 1 and m; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        References
        ----------
        Müller & Kumar, (Ci).

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").poses([0, 0])[1, :3, 3]
        array([1., 0., 0.])
        """
    @overload
    def poses(
        self,
        q: Named,
        qd: Named,
        *,
        body: str | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def poses(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        body: str | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def poses(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        /,
        *higher: Named,
        body: str | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/bodies.py
    @overload
    def twists(
        self,
        q: Named,
        qd: Named,
        *,
        body: str | None = None,
        frame: Frame = "body",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The twists V = J qd of the bodies, (angular; linear), and their rates.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of V.
        body : str, optional
            A body or a link merged into one; all bodies by default.
        frame : str, optional
            Frame of the twists (angular; linear): "body" (the paper's body-fixed twist), "world" (world axes, origin of
            the body frame: the hybrid form) or "spatial" (the paper's spatial twist).
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        V : (..., nb, 6), or (..., 6) of one body; with rates a tuple of them
            Unit: rad/s and m/s; of rates per s, per s^2, and so on. Rates are the derivatives of the components in the
            frame.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        References
        ----------
        Müller & Kumar, (Vsys), (VbdotMat).

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").twists([0, 0], [1, 0], body="body2", frame="world")[[2, 4]]
        array([1., 1.])
        """
    @overload
    def twists(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        body: str | None = None,
        frame: Frame = "body",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def twists(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        body: str | None = None,
        frame: Frame = "body",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def twists(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        /,
        *higher: Named,
        body: str | None = None,
        frame: Frame = "body",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/bodies.py
    @overload
    def jacobian(
        self,
        q: Named,
        *,
        body: str | None = None,
        frame: Frame = "body",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The Jacobian J(q) of bodies, V = J qd, and its rates.

        Parameters
        ----------
        q : (..., n)
            Coordinates: rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative of J.
        body : str, optional
            A body or a link merged into one; all bodies by default.
        frame : str, optional
            Frame of the twists (angular; linear): "body" (the paper's body-fixed twist), "world" (world axes, origin of
            the body frame: the hybrid form) or "spatial" (the paper's spatial twist).
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        J : (..., nb, 6, nv), or (..., 6, nv) of one body; with rates a tuple of them
            Unit: 1 and m; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

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
    @overload
    def jacobian(
        self,
        q: Named,
        qd: Named,
        *,
        body: str | None = None,
        frame: Frame = "body",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def jacobian(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        body: str | None = None,
        frame: Frame = "body",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def jacobian(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        /,
        *higher: Named,
        body: str | None = None,
        frame: Frame = "body",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/momenta.py
    @overload
    def momentum(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The spatial momentum h = (angular; linear) of the robot and its rates.

        ``h = U^T M V``: the momenta M_i V_i of the bodies about the inertial origin, in inertial axes, summed up.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of h.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        h : (..., 6), or tuple of (..., 6)
            Unit: kg m^2/s and kg m/s; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").momentum([0, 0], [1, 0])[[2, 4]]
        array([5., 3.])
        """
    @overload
    def momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/momenta.py
    @overload
    def centroidal_momentum(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The momentum hG = (angular; linear) of the robot about its centre of mass, and its rates.

        ``hG = (k - c x l; l)`` in inertial axes, with the momentum h = (k; l) and the centre of mass c. Its rate
        is the sum of the weight and of all wrenches on the robot, about the centre of mass.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of hG.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        hG : (..., 6), or tuple of (..., 6)
            Unit: kg m^2/s and kg m/s; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If the masses are 0, an array has a wrong shape, a rate is skipped, or a name is unknown.

        References
        ----------
        D. E. Orin, A. Goswami, S.-H. Lee, "Centroidal dynamics of a humanoid robot", Autonomous Robots 35, 2013.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").centroidal_momentum([0, 0], [1, 0])[[2, 4]]
        array([0.5, 3. ])
        """
    @overload
    def centroidal_momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def centroidal_momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def centroidal_momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/momenta.py
    @overload
    def centroidal_momentum_matrix(
        self,
        q: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The centroidal momentum matrix AG and its rates: hG = AG qd.

        If the robot floats, AG has nv = 6 + n columns, those of the twist of its base first; AG' = `AGd` gives the bias
        ``hGd - AG nud = AGd nu``. For a robot whose ground moves, the momentum of that motion is not part of AG qd.

        Parameters
        ----------
        q : (..., n)
            Coordinates: rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative of AG.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        AG : (..., 6, nv), or tuple of (..., 6, nv)
            Unit: kg m^2, kg m or kg; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If the masses are 0, an array has a wrong shape, a rate is skipped, or a name is unknown.

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
    @overload
    def centroidal_momentum_matrix(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def centroidal_momentum_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def centroidal_momentum_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/momenta.py
    @overload
    def center_of_mass(
        self,
        q: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The centre of mass c of the robot in the inertial frame, and its velocity, acceleration, ...

        ``c = sum of m_i c_i / sum of m_i`` over the bodies that move; links fixed to the ground are not among them.

        Parameters
        ----------
        q : (..., n)
            Coordinates: rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative of c.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        c : (..., 3), or tuple of (..., 3)
            Unit: m; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If the masses are 0, an array has a wrong shape, a rate is skipped, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> c, cd = jounce.load("planar2r").center_of_mass([0, 0], [1, 0])
        >>> c, cd
        (array([1.5, 0. , 0. ]), array([0. , 1.5, 0. ]))
        """
    @overload
    def center_of_mass(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def center_of_mass(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def center_of_mass(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/momenta.py
    @overload
    def generalized_momentum(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The generalized momentum p = M qd and its rates; the armature that acts is included.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of p.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        p : (..., nv), or tuple of (..., nv)
            Unit: N m s or, for coordinates in m, N s; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").generalized_momentum([0, 0], [0, 1])
        array([2., 1.])
        """
    @overload
    def generalized_momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def generalized_momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def generalized_momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/momenta.py
    @overload
    def kinetic_energy(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Any:
        """The kinetic energy T = 1/2 qd . M qd and its rates; the armature that acts is included.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of T.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        T : (...), or tuple of (...)
            Unit: J; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").kinetic_energy([0, 0], [1, 1])
        np.float64(5.0)
        """
    @overload
    def kinetic_energy(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Any, Any]: ...
    @overload
    def kinetic_energy(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Any, Any, Any]: ...
    @overload
    def kinetic_energy(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Any, ...]: ...

    # its row: jounce/dynamics/quantities/momenta.py
    @overload
    def potential_energy(
        self,
        q: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Any:
        """The potential energy U(q) of gravity, and of the springs that act, and its rates: Ud = qd . dU/dq, ...

        ``U = -sum m_i g . c_i``, zero for masses at the inertial origin; springs are slack at their rest position.

        Parameters
        ----------
        q : (..., n)
            Coordinates: rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative of U.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        U : (...), or tuple of (...)
            Unit: J; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> U, Ud = jounce.load("planar2r").potential_energy([0.5, 0], [1, 0])
        >>> U.round(4), Ud.round(4)
        (np.float64(14.1095), np.float64(25.8273))
        """
    @overload
    def potential_energy(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Any, Any]: ...
    @overload
    def potential_energy(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Any, Any, Any]: ...
    @overload
    def potential_energy(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Any, ...]: ...

    # its row: jounce/dynamics/quantities/wrenches.py
    @overload
    def base_wrench(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The reaction wrench of the ground on the robot, F = (moment; force), and its rates.

        ``F = hd + U^T M U G + U^T W``: the rate of the momentum, minus gravity and minus the loads -W, about the
        inertial origin in inertial axes. A mechanism is dynamically balanced if F is constant.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of F.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        F : (..., 6), or tuple of (..., 6)
            Unit: N m and N; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, `wrench` has fewer rates than it takes, or a name is
            unknown.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").base_wrench([0, 0], [0, 0], [0, 0])[[2, 4]].round(6)
        array([29.43, 19.62])
        """
    @overload
    def base_wrench(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def base_wrench(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def base_wrench(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/wrenches.py
    @overload
    def joint_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The wrenches Fj = (moment; force) that the joints transmit to their bodies, and their rates.

        They are what bearings, flanges and force sensors carry, all six components: the wrench of the parent on the
        body, for the body's own motion and weight, for all that it carries, and for wrenches on these. Projected on the
        joint screw, ``X . Fj``, it is the force of the joint without drive terms. If the robot floats, the first row is
        the wrench that acts on its base, as in `inverse_dynamics`.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of Fj.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Fj : (..., nb, 6), or tuple of (..., nb, 6)
            Unit: N m and N; of rates per s, per s^2, and so on. Rows are those of `body_names`, components those in the
            body frame about its origin.

        Raises
        ------
        JounceError
            If loops are closed, an array has a wrong shape, a rate is skipped, `wrench` has fewer rates than it takes,
            or a name is unknown.

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
    @overload
    def joint_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def joint_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def joint_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/motors.py
    @overload
    def motor_positions(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The motor positions theta of a motion of the links behind elastic joints, and their rates.

        ``theta = q + Q / K``, seen from the links: rotor angles over gear ratios. See `elastic`.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of theta.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        stiffness : (..., k) or mapping, or a tuple of them, optional
            The stiffness S of the k joints with two motors, in their order or by name, with as many rates as `wrench`.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        theta : (..., n), or tuple of (..., n)
            Unit: rad or, for coordinates in m, m; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If the joints of the robot are rigid, an array has a wrong shape, a rate is skipped, `wrench` has fewer
            rates than it takes, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> theta, thetad = arm.motor_positions([0, 0], [1, 0], [0, 0], [0, 0])
        >>> theta.round(6), thetad.round(6)
        (array([0.036788, 0.01635 ]), array([1., 0.]))
        """
    @overload
    def motor_positions(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def motor_positions(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def motor_positions(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/motors.py
    @overload
    def motor_torques(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The motor torques tau of a motion of the links behind elastic joints, and their rates.

        ``tau = Q + B theta2d + F_m(thetad)`` with ``theta = q + Q / K``, which takes Q2d and thus q4d.

        Parameters
        ----------
        q, qd, q2d, q3d, q4d : (..., n)
            Coordinates and their rates: rad or m, ...
        q5d, q6d, *higher : (..., n), optional
            Further rates, each for one more time derivative of tau.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has, and 2 more:
            (W, Wd, W2d) for it; anything else, nested lists included, is W alone. Each is an array (..., nb, 6) or a
            dict {body or merged link: (..., 6)}. Wd is the derivative of those components.
        stiffness : (..., k) or mapping, or a tuple of them, optional
            The stiffness S of the k joints with two motors, in their order or by name, with as many rates as `wrench`.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        tau : (..., n), or tuple of (..., n)
            Unit: N m or, for coordinates in m, N; of rates per s, per s^2, and so on.

        Raises
        ------
        JounceError
            If the joints of the robot are rigid, an array has a wrong shape, a rate is skipped, `wrench` has fewer
            rates than it takes, or a name is unknown.

        References
        ----------
        M. W. Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109 (1987).

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> tau, taud = arm.motor_torques([0, 0], [0, 0], [1, 1], [0, 0], [0, 0], [0, 0])
        >>> tau.round(6), taud.round(6)
        (array([36.53, 12.91]), array([0., 0.]))
        """
    @overload
    def motor_torques(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def motor_torques(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        q6d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def motor_torques(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        q6d: Named,
        q7d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/motors.py
    def motor_commands(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]:
        """The motor positions theta, velocities thetad and torques tau of a motion of the links, in one call.

        They are those of `motor_positions` and `motor_torques`, as the controller of a drive takes them.

        Parameters
        ----------
        q, qd, q2d, q3d, q4d : (..., n)
            Coordinates and their rates: rad or m, ...
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has, and 2 more:
            (W, Wd, W2d) for it; anything else, nested lists included, is W alone. Each is an array (..., nb, 6) or a
            dict {body or merged link: (..., 6)}. Wd is the derivative of those components.
        stiffness : (..., k) or mapping, or a tuple of them, optional
            The stiffness S of the k joints with two motors, in their order or by name, with as many rates as `wrench`.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        theta, thetad, tau : (..., n)
            Unit: rad, rad/s and N m or, for coordinates in m, m, m/s and N.

        Raises
        ------
        JounceError
            If the joints of the robot are rigid, an array has a wrong shape, a rate is skipped, `wrench` has fewer
            rates than it takes, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> theta, thetad, tau = arm.motor_commands(*[[0, 0]] * 5)
        >>> theta.round(6), tau.round(6)
        (array([0.036788, 0.01635 ]), array([29.43,  9.81]))
        """

    # its row: jounce/dynamics/quantities/motors.py
    @overload
    def motor_currents(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The currents i of the motors for a motion of the links behind elastic joints, and their rates.

        ``i = tau / (r k)`` with the gear ratio r and the torque constant k of each `Motor`.

        Parameters
        ----------
        q, qd, q2d, q3d, q4d : (..., n)
            Coordinates and their rates: rad or m, ...
        q5d, q6d, *higher : (..., n), optional
            Further rates, each for one more time derivative of i.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has, and 2 more:
            (W, Wd, W2d) for it; anything else, nested lists included, is W alone. Each is an array (..., nb, 6) or a
            dict {body or merged link: (..., 6)}. Wd is the derivative of those components.
        stiffness : (..., k) or mapping, or a tuple of them, optional
            The stiffness S of the k joints with two motors, in their order or by name, with as many rates as `wrench`.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        i : (..., n), or tuple of (..., n)
            Unit: A; of rates per s, per s^2, and so on. NaN for motors that state no torque constant.

        Raises
        ------
        JounceError
            If no motor states its torque constant, the joints of the robot are rigid, an array has a wrong shape, a
            rate is skipped, `wrench` has fewer rates than it takes, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> motor = jounce.Motor(gear=100, inertia=1e-5, constant=0.05, resistance=0.5)
        >>> arm = jounce.load("planar2r").elastic(800, motors=motor)
        >>> arm.motor_currents(*[[0, 0]] * 5)
        array([5.886, 1.962])
        """
    @overload
    def motor_currents(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def motor_currents(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        q6d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def motor_currents(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        q6d: Named,
        q7d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/motors.py
    @overload
    def motor_voltages(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The voltages u of the motors for a motion of the links behind elastic joints, and their rates.

        ``u = R i + L di/dt + k r thetad`` takes the rate of tau and thus q5d, unless no motor has an inductance.

        Parameters
        ----------
        q, qd, q2d, q3d, q4d : (..., n)
            Coordinates and their rates: rad or m, ...
        q5d, q6d, *higher : (..., n), optional
            Further rates, each for one more time derivative of u.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has, and 2 more:
            (W, Wd, W2d) for it; anything else, nested lists included, is W alone. Each is an array (..., nb, 6) or a
            dict {body or merged link: (..., 6)}. Wd is the derivative of those components.
        stiffness : (..., k) or mapping, or a tuple of them, optional
            The stiffness S of the k joints with two motors, in their order or by name, with as many rates as `wrench`.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        u : (..., n), or tuple of (..., n)
            Unit: V; of rates per s, per s^2, and so on. NaN for motors that state no torque constant or no resistance.

        Raises
        ------
        JounceError
            If no motor states constant and resistance, the joints of the robot are rigid, an array has a wrong shape, a
            rate is skipped, `wrench` has fewer rates than it takes, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> motor = jounce.Motor(gear=100, inertia=1e-5, constant=0.05, resistance=0.5, inductance=1e-3)
        >>> arm = jounce.load("planar2r").elastic(800, motors=motor)
        >>> arm.motor_voltages(*[[0, 0]] * 6)
        array([2.943, 0.981])
        """
    @overload
    def motor_voltages(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def motor_voltages(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        q6d: Named,
        *,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def motor_voltages(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        q6d: Named,
        q7d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/motors.py
    def elastic_forward_dynamics(
        self,
        q: Named,
        qd: Named,
        theta: Named,
        thetad: Named,
        tau: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]:
        """The accelerations q2d of the links and theta2d of the motors behind elastic joints that motor torques cause.

        ``q2d = M^-1 (K (theta - q) - C qd - Qgrav - Qext)``, ``theta2d = (tau - F_m - K (theta - q)) / B``. At a rigid
        joint B is in M, and theta2d = q2d.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        theta, thetad : (..., n)
            Positions and velocities of the motors, but of rigid joints.
        tau : (..., n)
            Motor torques: N m, or N for coordinates in m.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        q2d, theta2d : (..., n)
            Unit: rad/s^2 or, for coordinates in m, m/s^2.

        Raises
        ------
        JounceError
            If the joints of the robot are rigid, an array has a wrong shape, a rate is skipped, `wrench` has fewer
            rates than it takes, the base moves, the mass matrix is singular at all positions, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> rest, theta = [0, 0], arm.motor_positions([0, 0], [0, 0], [0, 0])
        >>> q2d, theta2d = arm.elastic_forward_dynamics(rest, rest, theta, rest, [29.43 + 0.1, 9.81])
        >>> theta2d.round(9) + 0.0
        array([1., 0.])
        """

    # its row: jounce/dynamics/quantities/motors.py
    def feedback_linearization(
        self,
        q: Named,
        qd: Named,
        theta: Named,
        thetad: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The motor torques tau that give the links a wanted snap q4d, from the measured state.

        q2d and q3d follow from the forces of the springs, ``Q = K (theta - q)`` and ``Qd = K (thetad - qd)``; tau is
        that of `motor_torques`. With ``q4d = q4d_ref + k3 (q3d_ref - q3d) + ...`` the tracking error obeys a linear
        equation of order four per coordinate.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        theta, thetad : (..., n)
            Positions and velocities of the motors, but of rigid joints.
        q4d : (..., n)
            The wanted fourth time derivative of q: rad/s^4 or m/s^4.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has, and 2 more:
            (W, Wd, W2d) for it; anything else, nested lists included, is W alone. Each is an array (..., nb, 6) or a
            dict {body or merged link: (..., 6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        tau : (..., n)
            Unit: N m or, for coordinates in m, N.

        Raises
        ------
        JounceError
            If a joint is rigid, the joints of the robot are rigid, an array has a wrong shape, a rate is skipped,
            `wrench` has fewer rates than it takes, the base moves, the mass matrix is singular at all positions, or a
            name is unknown.

        References
        ----------
        M. W. Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109 (1987).

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> rest, theta = [0, 0], arm.motor_positions([0, 0], [0, 0], [0, 0])
        >>> arm.feedback_linearization(rest, rest, theta, rest, [0, 0]).round(9)
        array([29.43,  9.81])
        """

    # its row: jounce/dynamics/quantities/loops.py
    @overload
    def coordinates(
        self,
        q: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The coordinates of all joints of a robot with closed loops, and their rates.

        ``qtd = F qd`` with the constraints ``A F = 0``. The motion of the base has no effect here.

        Parameters
        ----------
        q : (..., n) or (..., N)
            Independent coordinates: rad or m; or all N of the tree, near the branch.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative of qt.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        qt : (..., N), or tuple of (..., N)
            Unit: rad or, for coordinates in m, m; of rates per s, per s^2, and so on. In the order of
            ``mechanism.tree.coordinates``. As q in later calls it saves closing the loops again.

        Raises
        ------
        JounceError
            If the robot has no closed loops, its loops cannot be closed at q, an array has a wrong shape, a rate is
            skipped, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("fivebar")
        >>> qt, qtd = robot.coordinates([2.2, 0.9], [1.0, 0.0])
        >>> qt.shape
        (4,)
        """
    @overload
    def coordinates(
        self,
        q: Named,
        qd: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def coordinates(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def coordinates(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        /,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/loops.py
    @overload
    def actuator_forces(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The forces u of the actuated joints of a robot with closed loops, and their rates.

        ``F_u^T u = Q``, F_u the velocities of the actuated joints from those of the independent coordinates. With more
        motors than coordinates, the weighted sum of u^2 is least. If the coordinates are those of the motors, u = Q.
        Of passive coordinates ``Q_p - F_p^T u`` follows, what their motion needs beyond motors and the springs and
        dampers that act: it vanishes along motions that the robot can do.

        Parameters
        ----------
        q : (..., n) or (..., N)
            Independent coordinates: rad or m; or all N of the tree, near the branch.
        qd, q2d : (..., n)
            Their rates: per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of u.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        u : (..., k), or tuple of (..., k)
            Unit: N m or, for coordinates in m, N; of rates per s, per s^2, and so on. Of the motors, in the order of
            `actuated` in `closed`, then of coordinates in that of `passive`.

        Raises
        ------
        JounceError
            If the robot has no closed loops, its loops cannot be closed at q, an array has a wrong shape, a rate is
            skipped, `wrench` has fewer rates than it takes, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("fivebar")
        >>> robot.actuator_forces([2.2, 0.9], [0, 0], [0, 0]).shape
        (2,)
        """
    @overload
    def actuator_forces(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def actuator_forces(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def actuator_forces(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/loops.py
    @overload
    def passive_accelerations(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The accelerations of passive coordinates of a robot with closed loops, where motors move the others.

        Those with which nothing is lacking in `actuator_forces`, of every order: hybrid dynamics (R. Featherstone,
        Rigid Body Dynamics Algorithms, 9.2). Entries of passive coordinates in q2d, q3d, ... are not read.

        Parameters
        ----------
        q : (..., n) or (..., N)
            Independent coordinates: rad or m; or all N of the tree, near the branch.
        qd, q2d : (..., n)
            Their rates: per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of p2d.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        p2d : (..., passive), or tuple of (..., passive)
            Unit: rad/s^2 or, for coordinates in m, m/s^2; of rates per s, per s^2, and so on. Of the passive
            coordinates, in the order of `passive` in `closed`.

        Raises
        ------
        JounceError
            If the robot has no closed loops, its loops cannot be closed at q, an array has a wrong shape, a rate is
            skipped, `wrench` has fewer rates than it takes, or a name is unknown.

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
    @overload
    def passive_accelerations(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def passive_accelerations(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def passive_accelerations(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/loops.py
    @overload
    def loop_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The wrenches that the cut joints of a robot with closed loops transmit, and their rates.

        ``Wl = R^T y`` with ``A_d^T y = Q_d``: the dependent joints of the tree need no motors. Where constraints are
        redundant, as those of planar loops, the shortest y is taken.

        Parameters
        ----------
        q : (..., n) or (..., N)
            Independent coordinates: rad or m; or all N of the tree, near the branch.
        qd, q2d : (..., n)
            Their rates: per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of Wl.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Wl : (..., loops, 6), or tuple of (..., loops, 6)
            Unit: N m and N; of rates per s, per s^2, and so on. Moment and force of each cut joint on the body of its
            second frame, in the axes of its first frame, about the origin of that.

        Raises
        ------
        JounceError
            If the robot has no closed loops, its loops cannot be closed at q, an array has a wrong shape, a rate is
            skipped, `wrench` has fewer rates than it takes, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("fivebar")
        >>> robot.loop_wrenches([2.2, 0.9], [0, 0], [0, 0]).shape
        (1, 6)
        """
    @overload
    def loop_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def loop_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def loop_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # its row: jounce/dynamics/quantities/contacts.py
    @overload
    def contact_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Array:
        """The wrenches f of the ground on a robot at its contacts, and their rates.

        No motor drives the base: ``G f = Q_0``, the wrench that the motion takes on it. Of all f the one with the least
        weighted sum of squares is taken, see `contacts`.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of f.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as the result has; anything
            else, nested lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (...,
            6)}. Wd is the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        f : (..., contacts, 6), or tuple of (..., contacts, 6)
            Unit: N m and N; of rates per s, per s^2, and so on. In the order of the contacts, about their points in
            their axes: those of the place on the body for planes and lines, those of the ground for points.

        Raises
        ------
        JounceError
            If contacts do not balance the motion, an array has a wrong shape, a rate is skipped, `wrench` has fewer
            rates than it takes, or a name is unknown.

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
    @overload
    def contact_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array]: ...
    @overload
    def contact_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def contact_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> tuple[Array, ...]: ...

    # by hand
    @overload
    def compile(
        self,
        quantity: QuantityName | None = None,
        order: Literal[0] = ...,
        wrench: bool = False,
        *,
        body: str | None = None,
        frame: Frame = "body",
        product: None = None,
        moving_base: bool = False,
    ) -> Kernel[Floats]:
        """Compile a quantity to native code before its first call.

        Code that takes longer than three seconds to compile is compiled only here and with ``method="kernel"``; the
        robot's methods use it from then on, in later processes too, because it is kept on disk.

        Parameters
        ----------
        quantity : str, optional
            The method's name: "inverse_dynamics", "mass_matrix", ...; the first by default, unless joints are elastic.
        order : int, optional
            The highest rate of the quantity: 2 gives Q, Qd, Q2d.
        wrench : bool, optional
            Whether wrenches W, Wd, ... (..., nb, 6) follow the coordinates' rates in its calls.
        body, frame : str, optional
            Body or merged link, and frame, of poses, twists and Jacobians; all bodies by default.
        product : {"vjp", "jvp", "hvp", "jjvp", "hessian"}, optional
            Products of the derivatives by all inputs instead of the values: the kernel that `Kernel.vjp`, `Kernel.jvp`,
            `Kernel.hvp` or `Kernel.hessian` compiles at its first call, which takes the weights, then the directions,
            after the other arrays. Those of "hessian" return one matrix (..., N, N) of the N entries of all inputs.
            "jjvp", the second derivatives along two directions, is that of "jvp" along what follows.
        moving_base : bool, optional
            Whether the motion of the base, C, V, Vd, ..., follows in its calls; it always does if the robot floats.

        Returns
        -------
        Kernel
            To call as ``kernel(q, qd, q2d, q3d, q4d)`` on float64 arrays; ``kernel.bind(..., out=...)`` is for the same
            arrays again and again. It can be pickled. Where loops are closed, the dependent coordinates come last.

        Raises
        ------
        JounceError
            If a name is unknown, the robot holds symbols, llvmlite is missing, or a call needs over 64 MiB of memory.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> kernel = jounce.load("iiwa14").compile(order=2)
        >>> q, qd, q2d, q3d, q4d = np.ones((5, 7))
        >>> Q, Qd, Q2d = kernel(q, qd, q2d, q3d, q4d)
        >>> out = np.empty((3, 7))
        >>> call = kernel.bind(q, qd, q2d, q3d, q4d, out=list(out))
        >>> call()
        >>> bool((out[2] == Q2d).all())
        True
        """
    @overload
    def compile(
        self,
        quantity: QuantityName | None = None,
        order: Literal[1] = ...,
        wrench: bool = False,
        *,
        body: str | None = None,
        frame: Frame = "body",
        product: None = None,
        moving_base: bool = False,
    ) -> Kernel[tuple[Floats, Floats]]: ...
    @overload
    def compile(
        self,
        quantity: QuantityName | None = None,
        order: Literal[2] = ...,
        wrench: bool = False,
        *,
        body: str | None = None,
        frame: Frame = "body",
        product: None = None,
        moving_base: bool = False,
    ) -> Kernel[tuple[Floats, Floats, Floats]]: ...
    @overload
    def compile(
        self,
        quantity: QuantityName | None = None,
        order: int = 2,
        wrench: bool = False,
        *,
        body: str | None = None,
        frame: Frame = "body",
        product: Product | None = None,
        moving_base: bool = False,
    ) -> Kernel[Any]: ...

    # by hand
    @overload
    def drive_forces(self, q: Named, qd: Named, q2d: Named, *, terms: DriveTerms = True, out: Out = None) -> Array:
        """The joint forces of the drive-train terms, and their rates, whether or not they act in Q.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        terms : bool, str or iterable of str, optional
            Some of "armature", "damping", "friction", "stribeck", "spring", "offset", see `with_drives`; True selects
            all. "load_friction" is refused: it takes the forces of all others.
        out : optional
            See `Robot`.

        Returns
        -------
        Q : (..., n), or tuple of (..., n)

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> base = jounce.load("planar2r").mechanism
        >>> arm = jounce.Robot.from_screws(base.B, base.X, base.M, drives={"damping": [2.0, 3.0]})
        >>> arm.drive_forces([0, 0], [1, 1], [0, 0])
        array([2., 3.])
        """
    @overload
    def drive_forces(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, *, terms: DriveTerms = True, out: Out = None
    ) -> tuple[Array, Array]: ...
    @overload
    def drive_forces(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, *, terms: DriveTerms = True, out: Out = None
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def drive_forces(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        terms: DriveTerms = True,
        out: Out = None,
    ) -> tuple[Array, ...]: ...

    # by hand
    @overload
    def wrench(
        self,
        q: Named,
        *,
        body: str,
        force: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        frame: LoadFrame = "world",
        point: ArrayLike | None = None,
        base: Rates | None = None,
    ) -> Array:
        """The wrenches W, and their rates, of a load that acts ON a body, for `wrench=` of `inverse_dynamics`.

        W is the wrench that the body exerts, which is minus the load, about the body's origin in body axes. A load that
        is constant in the world has rates in the body frame: each further rate of q returns one more rate of W.

        Parameters
        ----------
        q : (..., n)
            Coordinates.
        qd, q2d, *higher : (..., n), optional
            Their rates, each for one more rate of W.
        body : str
            A body, or a link merged into one.
        force, torque : (..., 3), or a tuple of them, optional
            In N and N m. A *tuple* (f, fd, ...) is a vector with as many rates as W has; anything else, lists and a
            tuple of three numbers included, is the vector alone, constant in its axes.
        frame : str, optional
            The axes of force and torque, "world" or "body" (those of the named link).
        point : (3,), optional
            Where the force acts, in the frame of the link; by default its origin.
        base : optional
            The motion of the base, see `Robot`; a load in the axes of the body does not need it.

        Returns
        -------
        W : (..., nb, 6), or tuple of (..., nb, 6)

        Raises
        ------
        JounceError
            If a name is unknown, a shape is wrong, or the load has fewer rates than W.

        Examples
        --------
        A payload of 2 kg in the hand of an arm: its weight acts on the last link.

        >>> import jounce
        >>> robot, q, qd = jounce.load("iiwa14"), [0.1] * 7, [0.2] * 7
        >>> W, Wd = robot.wrench(q, qd, body="link7", force=(0, 0, -2 * 9.81), point=(0, 0, 0.1))
        >>> Q, Qd = robot.inverse_dynamics(q, qd, [0] * 7, [0] * 7, wrench=(W, Wd))
        """
    @overload
    def wrench(
        self,
        q: Named,
        qd: Named,
        *,
        body: str,
        force: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        frame: LoadFrame = "world",
        point: ArrayLike | None = None,
        base: Rates | None = None,
    ) -> tuple[Array, Array]: ...
    @overload
    def wrench(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        body: str,
        force: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        frame: LoadFrame = "world",
        point: ArrayLike | None = None,
        base: Rates | None = None,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def wrench(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        /,
        *higher: Named,
        body: str,
        force: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        frame: LoadFrame = "world",
        point: ArrayLike | None = None,
        base: Rates | None = None,
    ) -> tuple[Array, ...]: ...

    # by hand
    @overload
    def zmp(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *,
        height: float = 0.0,
        wrench: Rates | None = None,
        base: Rates | None = None,
    ) -> Array:
        """The zero-moment point, and its rates: where the wrench of the ground on the robot has a vertical moment.

        ``p = ((fx h - ny) / fz, (nx + fy h) / fz)`` of `base_wrench` (n; f), in the inertial plane z = h (Vukobratovic,
        Borovac, Int. J. Humanoid Robotics 1, 2004).

        Parameters
        ----------
        q, qd, q2d, *higher : (..., n)
            Coordinates and their rates, each after q2d for one more time derivative.
        height : float, optional
            h, m: the plane on which the robot stands. Feet at different heights have no common one.
        wrench, base : optional
            Loads and the motion of the base, as for `base_wrench`.

        Returns
        -------
        p : (..., 2), or tuple of (..., 2)
            x and y, m.

        Raises
        ------
        JounceError
            If the robot is in flight, or gravity is not along -z.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot = jounce.load("g1", base="floating")
        >>> still, base = np.zeros(robot.n), (np.eye(4), np.zeros(6), np.zeros(6))
        >>> bool(np.allclose(robot.zmp(still, still, still, base=base), robot.center_of_mass(still, base=base[0])[:2]))
        True
        """
    @overload
    def zmp(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        *,
        height: float = 0.0,
        wrench: Rates | None = None,
        base: Rates | None = None,
    ) -> tuple[Array, Array]: ...
    @overload
    def zmp(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        height: float = 0.0,
        wrench: Rates | None = None,
        base: Rates | None = None,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def zmp(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        height: float = 0.0,
        wrench: Rates | None = None,
        base: Rates | None = None,
    ) -> tuple[Array, ...]: ...

    # by hand
    @overload
    def center_of_pressure(
        self, q: Named, qd: Named, q2d: Named, *, wrench: Rates | None = None, base: Rates | None = None
    ) -> Array:
        """The centres of pressure of the contacts, and their rates: ``(-my, mx) / fz`` of `contact_wrenches`.

        Parameters
        ----------
        q, qd, q2d, *higher, wrench, base
            As for `contact_wrenches`.

        Returns
        -------
        p : (..., contacts, 2), or tuple of (..., contacts, 2)
            x and y of each contact in its axes, m; NaN of contacts that do not push.

        Raises
        ------
        JounceError
            If the robot has no contacts, or these do not balance it.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot = jounce.load("g1", base="floating")
        >>> feet = [f"{side}_ankle_roll_link" for side in ("left", "right")]
        >>> stand = robot.contacts([jounce.Contact(foot, "plane", place=(0.035, 0, -0.037)) for foot in feet])
        >>> still = np.zeros(robot.n)
        >>> stand.center_of_pressure(still, still, still, base=(np.eye(4), np.zeros(6), np.zeros(6))).shape
        (2, 2)
        """
    @overload
    def center_of_pressure(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, *, wrench: Rates | None = None, base: Rates | None = None
    ) -> tuple[Array, Array]: ...
    @overload
    def center_of_pressure(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        base: Rates | None = None,
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def center_of_pressure(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        q5d: Named,
        /,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
    ) -> tuple[Array, ...]: ...

    # by hand
    @overload
    def dcm(self, q: Named, qd: Named, *, height: float, base: Rates | None = None) -> Array:
        """The divergent component of motion, and its rates: ``c + cd / w`` with the centre of mass c.

        On the plane it is the capture point. Where the centre of mass stays at its height, it moves away from the
        zero-moment point p with the rate ``w (dcm - p)`` (Englsberger et al., IEEE Trans. Robotics 31, 2015).

        Parameters
        ----------
        q, qd, *higher : (..., n)
            Coordinates and their rates, each after qd for one more time derivative.
        height : float
            Height of the centre of mass above the ground, m: ``w = sqrt(g / height)``.
        base : optional
            The motion of the base, see `Robot`.

        Returns
        -------
        xi : (..., 3), or tuple of (..., 3)

        Raises
        ------
        JounceError
            If the height is not positive, or gravity is not along -z.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot, still = jounce.load("g1", base="floating"), np.zeros(29)
        >>> robot.dcm(still, still, height=0.7, base=(np.eye(4), np.zeros(6))).shape
        (3,)
        """
    @overload
    def dcm(
        self, q: Named, qd: Named, q2d: Named, *, height: float, base: Rates | None = None
    ) -> tuple[Array, Array]: ...
    @overload
    def dcm(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, *, height: float, base: Rates | None = None
    ) -> tuple[Array, Array, Array]: ...
    @overload
    def dcm(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        /,
        *higher: Named,
        height: float,
        base: Rates | None = None,
    ) -> tuple[Array, ...]: ...
