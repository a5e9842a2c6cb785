"""What a robot is made of, and the one way from its data and a caller's state to a result."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TypedDict

from jounce import denavit_hartenberg, rates, screws, wrenches
from jounce._scalars import Array
from jounce.audit import Finding, audit
from jounce.drives import Drives, chosen, with_eps
from jounce.errors import JounceError
from jounce.evaluation import by_kernel, delivered, evaluate
from jounce.kernel.serving import serving
from jounce.mechanism import GRAVITY, Limits, Mechanism, suited
from jounce.paths import Path, path
from jounce.welding import locked

Loads = Callable[[int], list[Array]]  # wrenches and their rates up to an order


class Options(TypedDict, total=False):
    """Keywords that the quantities share: the path that computes them, arrays to write into, threads for a batch."""

    method: str | None
    out: Any
    threads: int


@dataclass(frozen=True, eq=False, repr=False)
class Data:
    """A mechanism in a user's hands: how it is built, what it is called."""

    mechanism: Mechanism

    def __post_init__(self) -> None:
        if not isinstance(self.mechanism, Mechanism):
            raise JounceError(
                f"a Robot is made of a Mechanism, not of {type(self.mechanism).__name__}; try jounce.load"
            )

    @classmethod
    def from_screws(
        cls,
        B: Array,
        X: Array,
        M: Array,
        parent: Sequence[int] | None = None,
        names: Sequence[str] | None = None,
        gravity: Array = GRAVITY,
        **data: Any,
    ) -> Self:
        """A robot from body-fixed data.

        Body i hangs on its parent by ``C_i = C_p B_i exp(X_i theta_i)`` with joint variables ``theta = G q + g``.

        Parameters
        ----------
        B : (nb, 4, 4)
            Pose of body i in the frame of its parent body at theta_i = 0.
        X : (nb, 6)
            Joint screw in the frame of body i, (xi; eta): revolute (e; x cross e), helical of pitch h
            (e; x cross e + h e), prismatic (0; e), with a unit vector e and a point x on the axis.
        M : (nb, 6, 6)
            Inertia matrix in the frame of body i, see `inertia_matrix`.
        parent : (nb,)
            Index of the parent body, smaller than i; -1 is the ground, several roots are allowed; a serial chain if
            left out.
        names : (nb,)
            Names of the bodies.
        gravity : (3,)
            Gravitational acceleration in the inertial frame, m/s^2; (0, 0, -9.81) if left out.
        **data : keywords
            joint_names, names of the n coordinates; G (nb, n) and g (nb,), constant, for joints that follow others,
            theta = q if left out; limits, a mapping of lower, upper, velocity, effort (nb,) of theta, each infinite if
            left out; drives, a mapping of armature, damping, friction, eps, stiffness, rest (nb,) of theta, each zero
            (eps 0.05) if left out, see `with_drives`; name, of the robot.

        Raises
        ------
        JounceError
            Where a shape or name is wrong, a number is not finite, a pose, screw or inertia has not its form, or a
            body comes before its parent.

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
    ) -> Self:
        """A robot from spatial data, all in the inertial frame at theta = 0.

        ``B_i = A_p^-1 A_i``, ``X_i = Ad(A_i^-1) Y_i``.

        Parameters
        ----------
        A : (nb, 4, 4)
            Absolute poses of the bodies.
        Y : (nb, 6)
            Joint screws in the inertial frame.
        M : (nb, 6, 6)
            Inertia matrices, in the body frames.
        parent : (nb,)
            As in `from_screws`, with the same errors.
        **data : keywords
            names and gravity too, as in `from_screws`.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> M = jounce.inertia_matrix(1.0, [0.1, 0, 0], 0.01 * np.eye(3))
        >>> robot = jounce.Robot.from_spatial_screws([np.eye(4)], [[0, 0, 0, 0, 0, 1]], [M])  # a vertical slide
        >>> robot.inverse_dynamics([0.3], [0.0], [1.0])
        array([10.81])
        """
        return cls(screws.from_spatial_screws(A, Y, M, parent, **data))

    @classmethod
    def from_dh(cls, table: Any, M: Array, convention: str, **options: Any) -> Self:
        """A serial robot from a Denavit-Hartenberg table.

        "standard": ``T_i = Rot_z(theta_i) Trans_z(d_i) Trans_x(a_i) Rot_x(alpha_i)``, frame i at the end of link i,
        the axis of joint i is z of frame i - 1.

        "modified" (Craig's): ``T_i = Rot_x(alpha_i) Trans_x(a_i) Rot_z(theta_i) Trans_z(d_i)``, frame i on the axis
        of joint i, its z; row i holds what Craig calls a_{i-1}, alpha_{i-1}, d_i, theta_i.

        The joint variable is added to theta_i, of a prismatic joint to d_i. **Body i has frame i**: inertias, wrenches
        and poses are those of this frame, which is another one in each convention.

        Parameters
        ----------
        table : (n, 4), or n mappings
            Rows **a, alpha, d, theta**, in this order, which is not that of every book; in m and rad. Rows that cannot
            be confused are mappings, ``{"theta": 0, "d": 0.1, "a": 0, "alpha": 1.2}``, with ``"type": "prismatic"``
            where the joint is one.
        M : (n, 6, 6)
            Inertia matrices in the frames of the table, see `inertia_matrix`.
        convention : str
            "standard" or "modified".
        **options : keywords
            types, of the joints where rows are numbers, "revolute" (all, if left out) or "prismatic"; degrees=True
            where alpha and theta are in degrees; base (4, 4), the pose of frame 0 in the inertial frame; tool (4, 4),
            the pose of a frame "tool" in frame n; names, gravity, joint_names, limits and the others of `from_screws`.

        Raises
        ------
        JounceError
            Where a row has not four finite numbers, a convention or type is unknown, or as in `from_screws`.

        Examples
        --------
        An arm of two links of 0.5 m, whose centres of mass are half a link before their ends:

        >>> import numpy as np, jounce
        >>> M = jounce.inertia_matrix(2.0, [-0.25, 0, 0], np.diag([0, 0.04, 0.04]))
        >>> arm = jounce.Robot.from_dh([[0.5, 0, 0, 0], [0.5, 0, 0, 0]], [M, M], "standard", gravity=(0, -9.81, 0))
        >>> arm.poses([np.pi / 2, 0.0], body="body2")[:3, 3].round(9) + 0.0
        array([0., 1., 0.])
        >>> arm.gravity_forces([0.0, 0.0])
        array([19.62 ,  4.905])
        """
        return cls(denavit_hartenberg.from_dh(table, M, convention, **options))

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

    @property
    def limits(self) -> Limits:
        """What bounds the nb joint variables: `lower`, `upper`, `velocity`, `effort`, (nb,) each, SI units.

        Infinite where nothing is stated. They do not enter Q.
        """
        return self.mechanism.limits

    @property
    def drives(self) -> Drives:
        """The drive trains as stated: `armature`, `damping`, `friction`, `eps`, `stiffness`, `rest`, (nb,) each.

        Of the nb joint variables, SI units. They enter Q where `with_drives` or ``load(..., drives=True)`` says so.
        """
        return self.mechanism.drives

    def with_drives(self, terms: bool | str | Iterable[str] = True, eps: float | None = None) -> Self:
        """The same robot with some terms of its drives in Q, the armature in M too: all, none, or those named.

        ``Q_theta = armature theta'' + damping theta' + friction tanh(theta' / eps) + stiffness (theta - rest)`` of the
        joint variables theta = G q + g; Q gains ``G^T Q_theta`` and M ``G^T diag(armature) G``, with exact rates.

        Parameters
        ----------
        terms : bool, str or several
            "armature", "damping", "friction", "spring"; True for all, False for none.
        eps : float
            Speed in rad/s or m/s over which friction turns over; that of each joint (0.05 unless stated) if left out.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.Robot(jounce.load("planar2r").mechanism)
        >>> arm.with_drives("armature").mechanism.acting
        ('armature',)
        """
        drives = self.drives if eps is None else with_eps(self.drives, eps)
        return type(self)(replace(self.mechanism, acting=chosen(terms), drives=drives))

    def locked(self, values: Mapping[str, float]) -> Self:
        """The robot with some joints held at values, {joint: rad or m}: their bodies merge into those that carry them.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("iiwa14").locked({"joint3": 0.0, "joint7": 0.5}).n
        5
        """
        return type(self)(locked(self.mechanism, values))

    def audit(self) -> tuple[Finding, ...]:
        """What in the data no body can have, or looks like a mistake: findings, errors first; empty where all is well.

        Inertias that are not positive semidefinite or break the triangle inequality, placeholders, massless bodies and
        a singular mass matrix, masses, lengths and moments off by powers of 1000, missing effort and velocity limits,
        odd gravity. See `jounce.audit.Finding`.

        Raises
        ------
        JounceError
            Where the robot holds symbols.

        Examples
        --------
        >>> import jounce
        >>> for finding in jounce.load("planar2r").audit():
        ...     print(finding.severity, finding)
        note body1, body2: mass, 1 kg at most, without moments about its COM
        note joint1, joint2: no effort limit on any joint
        note joint1, joint2: no velocity limit on any joint
        """
        return audit(self.mechanism)

    def _given(self, wrench: Any) -> Loads:
        return lambda order: wrenches.checked(self.mechanism, wrench, order)

    def _quantity(
        self,
        name: str,
        least: int,
        q: Sequence[Any],
        loads: Loads = lambda order: [],
        *,
        method: str | None = None,
        out: Any = None,
        threads: int = 1,
    ) -> Any:
        """A quantity of `paths`, or of native code, along q; see `_along`."""
        given = rates.checked(q, least, self.mechanism)
        order = len(given) - least
        W = loads(order)
        kernel = serving(self.mechanism, name, method, order, given, W)
        if kernel is not None:
            return by_kernel(kernel, given, W, out, threads)
        if threads != 1:
            raise JounceError(f"threads = {threads!r} is for native code only, which does not serve this call")
        return self._by(path(name, method), order, given, W, out)

    def _along(
        self,
        path: Path,
        least: int,
        q: Sequence[Any],
        out: Any,
        loads: Loads = lambda order: [],
    ) -> Any:
        """The quantity of a path along q: it takes `least` of the rates, each further one gives one more derivative."""
        given = rates.checked(q, least, self.mechanism)
        order = len(given) - least
        return self._by(path, order, given, loads(order), out)

    def _by(self, path: Path, order: int, q: Sequence[Array], W: Sequence[Array], out: Any) -> Any:
        """The quantity of a path and its rates up to an order, of checked arrays."""
        model = suited(self.mechanism, [*q, *W])
        terms = evaluate(lambda q, W: path.law(model, q, W), q, W, order, path.width(model.nb))
        return delivered(terms, out)
