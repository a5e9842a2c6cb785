"""Methods of robots that compute, and are no quantities: those of quantities are in `quantity_methods`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, overload

from jounce.arguments import requests
from jounce.core.errors import door
from jounce.core.typing import Array, ArrayLike, Floats, Named, Rates, Results
from jounce.engine import drives as _drives
from jounce.engine.backends import compile_ahead
from jounce.engine.engine import Engine
from jounce.model.drive_trains import select_terms
from jounce.robot.overload_types import DriveTerms, Frame, LoadFrame, Out, Product, QuantityName

if TYPE_CHECKING:
    from jounce.native.kernel import Kernel


@door
class Methods(Engine):
    """Methods of several quantities, and of native code."""

    @overload
    def compile(
        self,
        quantity: QuantityName = "inverse_dynamics",
        order: Literal[2] = 2,
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
        quantity: QuantityName = "inverse_dynamics",
        order: Literal[0] = ...,
        wrench: bool = False,
        *,
        body: str | None = None,
        frame: Frame = "body",
        product: None = None,
        moving_base: bool = False,
    ) -> Kernel[Floats]: ...
    @overload
    def compile(
        self,
        quantity: QuantityName = "inverse_dynamics",
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
        quantity: QuantityName = "inverse_dynamics",
        order: int = 2,
        wrench: bool = False,
        *,
        body: str | None = None,
        frame: Frame = "body",
        product: Product | None = None,
        moving_base: bool = False,
    ) -> Kernel[Any]: ...
    def compile(
        self,
        quantity: Any = "inverse_dynamics",
        order: int = 2,
        wrench: bool = False,
        *,
        body: str | None = None,
        frame: Any = "body",
        product: Any = None,
        moving_base: bool = False,
    ) -> Kernel[Any]:
        """Compile a quantity to native code before its first call.

        Code that takes longer than three seconds to compile is compiled only here and with ``method="kernel"``; the
        robot's methods use it from then on, in later processes too, because it is kept on disk.

        Parameters
        ----------
        quantity : str, optional
            The method's name: "inverse_dynamics", "mass_matrix", ...; the first by default.
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
        request = requests.ComputationRequest(quantity, order, wrench, body, frame, product, moving_base)
        return compile_ahead(self, requests.build_computation(self.mechanism, request))

    @overload
    def drive_forces(self, q: Named, qd: Named, q2d: Named, *, terms: DriveTerms = True, out: Out = None) -> Array: ...
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
    def drive_forces(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named | None = None,
        q4d: Named | None = None,
        *higher: Named,
        terms: DriveTerms = True,
        out: Out = None,
    ) -> Results:
        """Return the joint forces of drive-train terms, and their rates.

        Terms need not act in Q.

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

        Examples
        --------
        >>> import jounce
        >>> base = jounce.load("planar2r").mechanism
        >>> arm = jounce.Robot.from_screws(base.B, base.X, base.M, drives={"damping": [2.0, 3.0]})
        >>> arm.drive_forces([0, 0], [1, 1], [0, 0])
        array([2., 3.])
        """
        return _drives.drive_forces(self.mechanism, (q, qd, q2d, q3d, q4d, *higher), select_terms(terms), out)

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
    ) -> Array: ...
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
    def wrench(
        self,
        q: Named,
        qd: Named | None = None,
        q2d: Named | None = None,
        *higher: Named,
        body: str,
        force: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        frame: Any = "world",
        point: ArrayLike | None = None,
        base: Rates | None = None,
    ) -> Results:
        """Return the wrenches W of a load ON a body, with rates.

        They are for `wrench=` of `inverse_dynamics`.

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

        Examples
        --------
        A payload of 2 kg in the hand of an arm: its weight acts on the last link.

        >>> import jounce
        >>> robot, q, qd = jounce.load("iiwa14"), [0.1] * 7, [0.2] * 7
        >>> W, Wd = robot.wrench(q, qd, body="link7", force=(0, 0, -2 * 9.81), point=(0, 0, 0.1))
        >>> Q, Qd = robot.inverse_dynamics(q, qd, [0] * 7, [0] * 7, wrench=(W, Wd))
        """
        load = _drives.BodyLoad(body, force, torque, frame, point)
        return _drives.wrench_of_load(self.mechanism, (q, qd, q2d, *higher), base, load)

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
    ) -> Array: ...
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
    def zmp(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named | None = None,
        q4d: Named | None = None,
        *higher: Named,
        height: float = 0.0,
        wrench: Rates | None = None,
        base: Rates | None = None,
    ) -> Results:
        """Return the zero-moment point and its rates.

        The wrench of the ground on the robot has a vertical moment there.

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
        from jounce.engine import balance_points  # imported here to keep start-up fast

        return balance_points.zmp(self, (q, qd, q2d, q3d, q4d, *higher), base, wrench, height)

    @overload
    def center_of_pressure(
        self, q: Named, qd: Named, q2d: Named, *, wrench: Rates | None = None, base: Rates | None = None
    ) -> Array: ...
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
    def center_of_pressure(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named | None = None,
        q4d: Named | None = None,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
    ) -> Results:
        """Return the centres of pressure of the contacts, and their rates.

        They are ``(-my, mx) / fz`` of `contact_wrenches`.

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
        from jounce.engine import balance_points  # imported here to keep start-up fast

        return balance_points.center_of_pressure(self, (q, qd, q2d, q3d, q4d, *higher), base, wrench)

    @overload
    def dcm(self, q: Named, qd: Named, *, height: float, base: Rates | None = None) -> Array: ...
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
    def dcm(
        self,
        q: Named,
        qd: Named,
        q2d: Named | None = None,
        q3d: Named | None = None,
        *higher: Named,
        height: float,
        base: Rates | None = None,
    ) -> Results:
        """Return the divergent component of motion and its rates.

        It is ``c + cd / w`` with the centre of mass c.

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
        from jounce.engine import balance_points  # imported here to keep start-up fast

        return balance_points.dcm(self, (q, qd, q2d, q3d, *higher), base, height)
