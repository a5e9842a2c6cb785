"""The bodies of a robot: where they are, how they move, what acts on them."""

from functools import partial
from typing import Any, Unpack, overload

from jounce._scalars import Array
from jounce.dynamics import kinematics, loads
from jounce.dynamics.quantities import Path, column, columns
from jounce.robot.quantities import Options, Quantities


class Bodies(Quantities):
    """Poses, Jacobians, momentum and wrenches with their rates, each a line on its path."""

    def poses(self, q: Array, *, body: str | None = None, out: Any = None) -> Array:
        """C_i, the pose of every body frame in the inertial frame: (..., nb, 4, 4), or (..., 4, 4) of one.

        ``body`` is a body or a link merged into one. Müller & Kumar, (Ci).

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").poses([0, 0])[1, :3, 3]
        array([1., 0., 0.])
        """
        law = Path(lambda model, q, _: kinematics.poses(model, q, body), column)
        return self._along(law, 1, (q,), out)

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
        body : str
            A body or a link merged into one; all bodies if left out.
        frame : str
            Of the twists V = (angular; linear): "body" (the paper's body-fixed twist), "world" (world axes, origin of
            the body frame: the hybrid form) or "spatial" (the paper's spatial twist).

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
        law = Path(lambda model, q, _: kinematics.jacobian(model, q, body, frame), columns)
        return self._along(law, 1, (q, qd, q2d, *higher), out)

    @overload
    def momentum(self, q: Array, qd: Array, **options: Unpack[Options]) -> Array: ...
    @overload
    def momentum(
        self, q: Array, qd: Array, q2d: Array, q3d: Array = None, *higher: Array, **options: Unpack[Options]
    ) -> tuple[Array, ...]: ...
    def momentum(self, q, qd, q2d=None, q3d=None, *higher, **options):  # type: ignore[no-untyped-def]
        """The spatial momentum h = (angular; linear) about the inertial origin, inertial axes, and its rates: (..., 6).

        ``h = U^T M V``, the sum of the bodies' momenta M_i V_i carried to the origin; kg m^2/s and kg m/s.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").momentum([0, 0], [1, 0])[[2, 4]]
        array([5., 3.])
        """
        return self._quantity("momentum", 2, (q, qd, q2d, q3d, *higher), **options)

    @overload
    def base_wrench(
        self, q: Array, qd: Array, q2d: Array, *, wrench: Any = None, **options: Unpack[Options]
    ) -> Array: ...
    @overload
    def base_wrench(
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
    def base_wrench(self, q, qd, q2d, q3d=None, q4d=None, *higher, wrench=None, **options):  # type: ignore[no-untyped-def]
        """What the ground exerts on the robot, F = (moment; force) about the inertial origin, and its rates: (..., 6).

        ``F = hd + U^T M U G + U^T W``: the rate of the momentum, less gravity and less the loads -W; inertial axes. A
        mechanism is dynamically balanced where F is constant. ``wrench`` as in `inverse_dynamics`.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").base_wrench([0, 0], [0, 0], [0, 0])[[2, 4]].round(6)
        array([29.43, 19.62])
        """
        return self._quantity("base_wrench", 3, (q, qd, q2d, q3d, q4d, *higher), self._given(wrench), **options)

    @overload
    def wrench(
        self, q: Array, *, body: str, force: Any = None, torque: Any = None, frame: str = "world", point: Any = None
    ) -> Array: ...
    @overload
    def wrench(
        self,
        q: Array,
        qd: Array,
        q2d: Array = None,
        *higher: Array,
        body: str,
        force: Any = None,
        torque: Any = None,
        frame: str = "world",
        point: Any = None,
    ) -> tuple[Array, ...]: ...
    def wrench(self, q, qd=None, q2d=None, *higher, body, force=None, torque=None, frame="world", point=None):  # type: ignore[no-untyped-def]
        """W, and its rates, of a load that acts ON a body: what `wrench=` of `inverse_dynamics` takes, (..., nb, 6).

        W is what the body exerts, so it is minus the load, about the body's origin in body axes. A load that stands
        still in the world has rates in the body frame: each further rate of q returns one more rate of W.

        Parameters
        ----------
        q : (..., n)
            Coordinates.
        qd, q2d, *higher : (..., n), default: None
            Their rates, each for one more rate of W.
        body : str
            A body, or a link merged into one.
        force, torque : (..., 3)
            In N and N m. A tuple (f, fd, ...) is a vector with as many rates as W has; anything else, lists too and
            a tuple of three scalars, is the vector alone, constant in its axes.
        frame : str
            The axes of force and torque, "world" or "body" (those of the named link).
        point : (3,)
            Where the force acts, in the frame of the link; its origin if left out.

        Examples
        --------
        A payload of 2 kg in the hand of an arm: its weight acts on the last link.

        >>> import jounce
        >>> robot, q, qd = jounce.load("iiwa14"), [0.1] * 7, [0.2] * 7
        >>> W, Wd = robot.wrench(q, qd, body="link7", force=(0, 0, -2 * 9.81), point=(0, 0, 0.1))
        >>> Q, Qd = robot.inverse_dynamics(q, qd, [0] * 7, [0] * 7, wrench=(W, Wd))
        """
        place = loads.checked_place(frame, point)
        law = Path(lambda model, q, load: loads.wrench(model, q, load, body, frame, place), columns)
        return self._along(law, 1, (q, qd, q2d, *higher), None, partial(loads.checked, force, torque))
