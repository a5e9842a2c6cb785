"""Robot: what users hold. It checks at the door, then calls one function a method."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypedDict, Unpack, overload

from jounce import kinematics, rates, screws, wrenches
from jounce._scalars import Array
from jounce.errors import JounceError, no_such
from jounce.evaluation import delivered, evaluate
from jounce.mechanism import Mechanism, suited
from jounce.paths import FORMS, Path, path


class Options(TypedDict, total=False):
    """Keywords that the quantities share: the path that computes them, and the arrays to write into."""

    method: str | None
    out: Any


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot: its mechanism, and the quantities of its equations of motion along a motion.

    Build one by `jounce.load`, `Robot.from_screws` or `Robot.from_spatial_screws`. Conventions of every method:

    * SI units. Twists, screws and wrenches are (angular; linear).
    * Leading axes are batch axes and broadcast; the coordinate axis is last. Any real scalars: NumPy, JAX, or object
      arrays of CasADi SX, SymPy or other symbols.
    * q is required; each further rate you give returns one more time derivative. With none to spare the result is
      a plain array, otherwise a tuple: the quantity, its rate, ...
    * ``method`` picks the path: "recursion" (the default of all but C and J), "closed_form" or "paper"; all agree.
    * ``out`` takes the NumPy array (or the tuple of them) to write into.

    Errors: `JounceError` for a wrong shape, a skipped rate, an unknown name or method, an `out` that does not fit.
    """

    mechanism: Mechanism

    def __post_init__(self) -> None:
        if not isinstance(self.mechanism, Mechanism):
            raise JounceError(
                f"a Robot is made of a Mechanism, not of {type(self.mechanism).__name__}; use jounce.load"
            )

    @classmethod
    def from_screws(
        cls,
        B: Array,
        X: Array,
        M: Array,
        parent: Sequence[int] | None = None,
        names: Sequence[str] | None = None,
        gravity: Array = (0, 0, -9.81),
        **data: Any,
    ) -> "Robot":
        """A robot from body-fixed data.

        Body i hangs on its parent by ``C_i = C_p B_i exp(X_i theta_i)`` with joint variables ``theta = G q + g``.

        Parameters
        ----------
        B : (nb, 4, 4) pose of body i in the frame of its parent body at theta_i = 0
        X : (nb, 6) joint screw in the frame of body i, (xi; eta): revolute (e; x cross e), helical of pitch h
            (e; x cross e + h e), prismatic (0; e), with a unit vector e and a point x on the axis
        M : (nb, 6, 6) inertia matrix in the frame of body i, see `inertia_matrix`
        parent : (nb) index of the parent body, smaller than i; -1 is the ground, several roots are allowed; a serial
            chain if left out
        names : names of the nb bodies
        gravity : (3,) gravitational acceleration in the inertial frame, m/s^2
        data : joint_names, names of the n coordinates; G (nb, n) and g (nb,), constant, for joints that follow others,
            theta = q if left out; name, of the robot

        Raises
        ------
        JounceError : where a shape or name is wrong, a number is not finite, a pose, screw or inertia has not its form,
            or a body comes before its parent.

        References
        ----------
        Müller & Kumar, (Ci), (Xi), (eqn_body_fixed_mass_inertia_matrix).

        Examples
        --------
        A pendulum of 2 kg at 0.5 m, turning about the y axis:

        >>> import numpy as np, jounce
        >>> M = jounce.inertia_matrix(2.0, [0, 0, -0.5], np.zeros((3, 3)))
        >>> pendulum = jounce.Robot.from_screws([np.eye(4)], [[0, 1, 0, 0, 0, 0]], [M])
        >>> pendulum.inverse_dynamics([np.pi / 2], [0.0], [0.0]).round(6)
        array([9.81])
        """
        return cls(screws.from_screws(B, X, M, parent, names, gravity, **data))

    @classmethod
    def from_spatial_screws(
        cls, A: Array, Y: Array, M: Array, parent: Sequence[int] | None = None, **data: Any
    ) -> "Robot":
        """A robot from spatial data, all in the inertial frame at theta = 0.

        ``B_i = A_p^-1 A_i``, ``X_i = Ad(A_i^-1) Y_i``, exactly.

        Parameters
        ----------
        A : (nb, 4, 4) absolute poses of the bodies
        Y : (nb, 6) joint screws in the inertial frame
        M : (nb, 6, 6) inertia matrices, in the body frames
        parent, data : and names, gravity: as in `from_screws`, with the same errors

        Examples
        --------
        >>> import numpy as np, jounce
        >>> M = jounce.inertia_matrix(1.0, [0.1, 0, 0], 0.01 * np.eye(3))
        >>> robot = jounce.Robot.from_spatial_screws([np.eye(4)], [[0, 0, 0, 0, 0, 1]], [M])  # a vertical slide
        >>> robot.inverse_dynamics([0.3], [0.0], [1.0])
        array([10.81])
        """
        return cls(screws.from_spatial_screws(A, Y, M, parent, **data))

    def __repr__(self) -> str:
        return f"<Robot {self.name!r}: {self.n} coordinates, {self.mechanism.nb} bodies>"

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.mechanism.name

    @property
    def n(self) -> int:
        """The number of coordinates."""
        return self.mechanism.n

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of the coordinates, in the order of the last axis of q."""
        return self.mechanism.coordinates

    @property
    def body_names(self) -> tuple[str, ...]:
        """The names of the bodies, in the order of the rows of wrenches, poses and Jacobians."""
        return self.mechanism.bodies

    @property
    def gravity(self) -> Array:
        """The gravitational acceleration in the inertial frame, m/s^2."""
        return self.mechanism.gravity

    @overload
    def inverse_dynamics(
        self, q: Array, qd: Array, q2d: Array, *, wrench: Any = None, **options: Unpack[Options]
    ) -> Array: ...
    @overload
    def inverse_dynamics(
        self,
        q: Array,
        qd: Array,
        q2d: Array,
        q3d: Array,
        q4d: Array = None,
        *higher: Array,
        wrench: Any = None,
        **options: Unpack[Options],
    ) -> tuple[Array, ...]: ...
    def inverse_dynamics(self, q, qd, q2d, q3d=None, q4d=None, *higher, wrench=None, method=None, out=None):  # type: ignore[no-untyped-def]
        """The generalized forces Q of a motion, and their time derivatives Qd, Q2d, ...: each a (..., n) array.

        ``Q = M(q) q2d + C(q, qd) qd + Qgrav(q) + Qext``, in N m for revolute and N for prismatic coordinates.

        Parameters
        ----------
        q, qd, q2d, q3d, q4d, *higher : (..., n) coordinates and their rates, rad or m, per s, ...
        wrench : what the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components
            about the origin of the body frame: W or a tuple (W, Wd, ...) with as many rates as Q; each an array
            (..., nb, 6) or a dict {body or merged link: (..., 6)}. Wd is the derivative of those components.
        method, out : see `Robot`

        References
        ----------
        Müller & Kumar, (EOM1), (EOM1stOrder), (EOM2ndOrder).

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> Q, Qd = robot.inverse_dynamics([0, 0], [1, 0], [0, 0], [0, 0])
        >>> Q.round(4), Qd.round(4)
        (array([29.43,  9.81]), array([0., 0.]))
        """
        return self._along(path("inverse_dynamics", method), 3, (q, qd, q2d, q3d, q4d, *higher), out, wrench)

    @overload
    def mass_matrix(self, q: Array, **options: Unpack[Options]) -> Array: ...
    @overload
    def mass_matrix(
        self, q: Array, qd: Array, q2d: Array = None, *higher: Array, **options: Unpack[Options]
    ) -> tuple[Array, ...]: ...
    def mass_matrix(self, q, qd=None, q2d=None, *higher, method=None, out=None):  # type: ignore[no-untyped-def]
        """The generalized mass matrix M(q) = J^T M J and its rates Md, M2d, ...: each (..., n, n), symmetric.

        Müller & Kumar, (MC), (Mdot), (Mddot).

        >>> import jounce
        >>> M, Md = jounce.load("planar2r").mass_matrix([0, 0], [0, 1])
        >>> M
        array([[5., 2.],
               [2., 1.]])
        """
        return self._along(path("mass_matrix", method), 1, (q, qd, q2d, *higher), out)

    @overload
    def coriolis_matrix(self, q: Array, qd: Array, *, form: str = "paper", **options: Unpack[Options]) -> Array: ...
    @overload
    def coriolis_matrix(
        self,
        q: Array,
        qd: Array,
        q2d: Array,
        q3d: Array = None,
        *higher: Array,
        form: str = "paper",
        **options: Unpack[Options],
    ) -> tuple[Array, ...]: ...
    def coriolis_matrix(self, q, qd, q2d=None, q3d=None, *higher, form="paper", method=None, out=None):  # type: ignore[no-untyped-def]
        """The Coriolis matrix C(q, qd) of the paper by default; ``form="skew"`` is the one for passivity-based control.

        Both give the same forces C qd. For the skew form, (Cbar), ``Md - 2 C`` is skew-symmetric, and so are its rates;
        for the paper's, (Csys), only ``qd^T (Md - 2 C) qd = 0``. C and its rates Cd, C2d, ...: each (..., n, n).

        Müller & Kumar, (MC), (Cdot), (C2temp), (Cbar).

        >>> import jounce, numpy as np
        >>> robot, q, qd = jounce.load("iiwa14"), np.full(7, 0.3), np.ones(7)
        >>> M, Md = robot.mass_matrix(q, qd)
        >>> S = Md - 2 * robot.coriolis_matrix(q, qd, form="skew")
        >>> bool(abs(S + S.T).max() < 1e-14)
        True
        """
        if form not in FORMS:
            raise no_such("form of the Coriolis matrix", form, FORMS)
        return self._along(path(f"coriolis_matrix of form {form!r}", method), 2, (q, qd, q2d, q3d, *higher), out)

    @overload
    def gravity_forces(self, q: Array, **options: Unpack[Options]) -> Array: ...
    @overload
    def gravity_forces(
        self, q: Array, qd: Array, q2d: Array = None, *higher: Array, **options: Unpack[Options]
    ) -> tuple[Array, ...]: ...
    def gravity_forces(self, q, qd=None, q2d=None, *higher, method=None, out=None):  # type: ignore[no-untyped-def]
        """The generalized gravity forces Qgrav(q) = dV/dq, with V the potential energy, and their rates: each (..., n).

        Müller & Kumar, (eq_U), (Qgravdot).

        >>> import jounce
        >>> jounce.load("planar2r").gravity_forces([0, 0])
        array([29.43,  9.81])
        """
        return self._along(path("gravity_forces", method), 1, (q, qd, q2d, *higher), out)

    @overload
    def jacobian(self, q: Array, *, body: str | None = None, frame: str = "body", out: Any = None) -> Array: ...
    @overload
    def jacobian(
        self,
        q: Array,
        qd: Array,
        q2d: Array = None,
        *higher: Array,
        body: str | None = None,
        frame: str = "body",
        out: Any = None,
    ) -> tuple[Array, ...]: ...
    def jacobian(self, q, qd=None, q2d=None, *higher, body=None, frame="body", out=None):  # type: ignore[no-untyped-def]
        """The Jacobian J(q), V = J qd, and its rates: (..., nb, 6, n) of all bodies, (..., 6, n) of one.

        Parameters
        ----------
        body : a body or a link merged into one; all bodies if left out
        frame : of the twists V = (angular; linear): "body" (the paper's body-fixed twist), "world" (world axes, origin
            of the body frame: the hybrid form) or "spatial" (the paper's spatial twist)

        Müller & Kumar, (Vsys), (JbSys), (Jdot).

        >>> import jounce
        >>> jounce.load("planar2r").jacobian([0, 0], body="body2", frame="world")[3:5]
        array([[0., 0.],
               [1., 0.]])
        """
        law = Path(lambda model, q, _: kinematics.jacobian(model, q, body, frame))
        return self._along(law, 1, (q, qd, q2d, *higher), out)

    def poses(self, q: Array, *, body: str | None = None, out: Any = None) -> Array:
        """C_i, the pose of every body frame in the inertial frame: (..., nb, 4, 4), or (..., 4, 4) of one.

        ``body`` is a body or a link merged into one. Müller & Kumar, (Ci).

        >>> import jounce
        >>> jounce.load("planar2r").poses([0, 0])[1, :3, 3]
        array([1., 0., 0.])
        """
        law = Path(lambda model, q, _: kinematics.poses(model, q, body))
        return self._along(law, 1, (q,), out)

    def _along(self, path: Path, least: int, q: Sequence[Array | None], out: Any, wrench: Any = None) -> Any:
        """The quantity of a path along q: it takes `least` of the rates, each further one gives one more derivative."""
        given = rates.checked(q, least, self.joint_names)
        order = len(given) - least
        W = wrenches.checked(self.mechanism, wrench, order)
        model = suited(self.mechanism, [*given, *W])
        terms = evaluate(lambda q, W: path.law(model, q, W), given, W, order, path.width(model.nb))
        return delivered(terms, out)
