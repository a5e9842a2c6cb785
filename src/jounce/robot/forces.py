"""The generalized forces of a robot and the matrices of its equations of motion."""

from typing import Any, Unpack, overload

from jounce._scalars import Array
from jounce.dynamics.quantities import FORMS, Path, column, drive_forces, row
from jounce.errors import one_of
from jounce.model.drives import chosen
from jounce.native.kernel import Kernel
from jounce.robot.dispatch import ahead
from jounce.robot.quantities import Options, Quantities


class Forces(Quantities):
    """Q, M, C and Qgrav with their rates, each a line on its path."""

    def compile(self, order: int = 2, wrench: bool = False, quantity: str = "inverse_dynamics") -> Kernel:
        """Native code of a quantity ahead of time: the first call need not wait for it, and calls cost less.

        Code that takes longer than three seconds to compile is compiled here alone (and with ``method="kernel"``); the
        robot's methods use it from then on, in later processes too, as it is kept on disk.

        Parameters
        ----------
        order : int
            The highest rate of the quantity: 2 gives Q, Qd, Q2d.
        wrench : bool
            Whether wrenches W, Wd, ... (..., nb, 6) follow the coordinates' rates in its calls.
        quantity : str
            "inverse_dynamics", "gravity_forces", "mass_matrix", "coriolis_matrix of form 'paper'" or
            "coriolis_matrix of form 'skew'".

        Returns
        -------
        Kernel : ``kernel(q, qd, q2d, q3d, q4d)`` on float64 arrays; ``kernel.bind(..., out=...)`` for the same arrays
            again and again. It can be pickled.

        Raises
        ------
        JounceError : where there is no such quantity, the robot holds symbols, llvmlite is missing, or a call needs
            more than 64 MiB of scratch memory.

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
        return ahead(self.mechanism, quantity, order, wrench)

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
    def inverse_dynamics(self, q, qd, q2d, q3d=None, q4d=None, *higher, wrench=None, **options):  # type: ignore[no-untyped-def]
        """The generalized forces Q of a motion, and their time derivatives Qd, Q2d, ...: each a (..., n) array.

        ``Q = M(q) q2d + C(q, qd) qd + Qgrav(q) + Qext``, in N m for revolute and N for prismatic coordinates.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), default: None
            Further rates, each for one more time derivative of Q.
        wrench : (..., nb, 6) or dict
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A tuple (W, Wd, ...) is W with as many rates as Q has; anything else, nested
            lists too, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (..., 6)}. Wd is the
            derivative of those components.
        **options : keywords
            method, out and threads, see `Robot`.

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
        rates = (q, qd, q2d, q3d, q4d, *higher)
        return self._quantity("inverse_dynamics", 3, rates, self._given(wrench), **options)

    @overload
    def drive_forces(self, q: Array, qd: Array, q2d: Array, *, terms: Any = True, out: Any = None) -> Array: ...
    @overload
    def drive_forces(
        self,
        q: Array,
        qd: Array,
        q2d: Array,
        q3d: Array,
        q4d: Array = None,
        *higher: Array,
        terms: Any = True,
        out: Any = None,
    ) -> tuple[Array, ...]: ...
    def drive_forces(self, q, qd, q2d, q3d=None, q4d=None, *higher, terms=True, out=None):  # type: ignore[no-untyped-def]
        """What the drives take beside the rigid mechanism, and its rates: (..., n), whether or not they act in Q.

        ``terms`` picks some of "armature", "damping", "friction", "spring", see `with_drives`; True is all.

        Examples
        --------
        >>> import jounce
        >>> base = jounce.load("planar2r").mechanism
        >>> arm = jounce.Robot.from_screws(base.B, base.X, base.M, drives={"damping": [2.0, 3.0]})
        >>> arm.drive_forces([0, 0], [1, 1], [0, 0])
        array([2., 3.])
        """
        names = chosen(terms)
        law = Path(lambda model, q, _: row(drive_forces(model, q, names)), column)
        return self._along(law, 3, (q, qd, q2d, q3d, q4d, *higher), out)

    @overload
    def mass_matrix(self, q: Array, **options: Unpack[Options]) -> Array: ...
    @overload
    def mass_matrix(
        self, q: Array, qd: Array, q2d: Array = None, *higher: Array, **options: Unpack[Options]
    ) -> tuple[Array, ...]: ...
    def mass_matrix(self, q, qd=None, q2d=None, *higher, **options):  # type: ignore[no-untyped-def]
        """The generalized mass matrix M(q) = J^T M J and its rates Md, M2d, ...: each (..., n, n), symmetric.

        Müller & Kumar, (MC), (Mdot), (Mddot).

        Examples
        --------
        >>> import jounce
        >>> M, Md = jounce.load("planar2r").mass_matrix([0, 0], [0, 1])
        >>> M
        array([[5., 2.],
               [2., 1.]])
        """
        return self._quantity("mass_matrix", 1, (q, qd, q2d, *higher), **options)

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
    def coriolis_matrix(self, q, qd, q2d=None, q3d=None, *higher, form="paper", **options):  # type: ignore[no-untyped-def]
        """The Coriolis matrix C(q, qd) of the paper by default; ``form="skew"`` is the one for passivity-based control.

        Both give the same forces C qd. For the skew form, (Cbar), ``Md - 2 C`` is skew-symmetric, and so are its rates;
        for the paper's, (Csys), only ``qd^T (Md - 2 C) qd = 0``. C and its rates Cd, C2d, ...: each (..., n, n).

        Müller & Kumar, (MC), (Cdot), (C2temp), (Cbar).

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot, q, qd = jounce.load("iiwa14"), np.full(7, 0.3), np.ones(7)
        >>> M, Md = robot.mass_matrix(q, qd)
        >>> S = Md - 2 * robot.coriolis_matrix(q, qd, form="skew")
        >>> bool(abs(S + S.T).max() < 1e-13)
        True
        """
        one_of("form of the Coriolis matrix", form, FORMS)
        return self._quantity(f"coriolis_matrix of form {form!r}", 2, (q, qd, q2d, q3d, *higher), **options)

    @overload
    def gravity_forces(self, q: Array, **options: Unpack[Options]) -> Array: ...
    @overload
    def gravity_forces(
        self, q: Array, qd: Array, q2d: Array = None, *higher: Array, **options: Unpack[Options]
    ) -> tuple[Array, ...]: ...
    def gravity_forces(self, q, qd=None, q2d=None, *higher, **options):  # type: ignore[no-untyped-def]
        """The generalized gravity forces Qgrav(q) = dV/dq, with V the potential energy, and their rates: each (..., n).

        Müller & Kumar, (eq_U), (Qgravdot).

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").gravity_forces([0, 0])
        array([29.43,  9.81])
        """
        return self._quantity("gravity_forces", 1, (q, qd, q2d, *higher), **options)
