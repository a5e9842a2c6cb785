"""Robot: what users hold. Every method is a signature, a docstring, and one call."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import TYPE_CHECKING, Any, Self

from jounce.arguments import requests
from jounce.arguments.limits import with_limits
from jounce.arguments.loops import with_locked, with_loops
from jounce.core.deprecated import renamed_keywords
from jounce.core.display import Displayed
from jounce.core.errors import JounceError, listed, one_of
from jounce.core.typing import (
    Array,
    ArrayLike,
    Base,
    Convention,
    Coupling,
    DriveColumns,
    DriveTerms,
    Form,
    Frame,
    JointType,
    Library,
    LimitValues,
    LoadFrame,
    Method,
    Named,
    Out,
    Product,
    QuantityName,
    Rates,
    Results,
    Side,
)
from jounce.engine.backends import compile_ahead
from jounce.engine.dispatch import compute
from jounce.engine.drives import drive_forces, regressor
from jounce.engine.loads import wrench_of_load
from jounce.model import dh, equality, inertial, screws
from jounce.model.drives import Drives, select_columns, select_terms, warn_of_idle, with_eps
from jounce.model.limits import Limits
from jounce.model.mechanism import GRAVITY
from jounce.native.kernel import Kernel
from jounce.robot import overloads
from jounce.robot.applications import Applications
from jounce.robot.elastic import check_side, compiled_name, renamed
from jounce.robot.old import OldMethods
from jounce.robot.overloads import typed

if TYPE_CHECKING:
    from jounce.actuators.along import ElasticAlong
    from jounce.actuators.energy import Energy
    from jounce.checks.audit import Finding
    from jounce.dynamics.base_parameters import BaseParameters
    from jounce.engine.along import Along
    from jounce.io.models.states import RobotState
    from jounce.limits.check import Check
    from jounce.limits.retime import Retiming
    from jounce.limits.slowdown import Slowdown
    from jounce.model.elasticity import Elasticity, SpringLaw
    from jounce.model.loops import Loop
    from jounce.model.motors import Motor
    from jounce.motion import Motion

FORMS = {"paper": "coriolis_matrix", "skew": "skew_coriolis_matrix"}  # of the Coriolis matrix


@dataclass(frozen=True, eq=False, repr=False)
class Robot(Applications, OldMethods, Displayed):
    """A robot: its mechanism, and the quantities of its equations of motion along a motion.

    `jounce.load` makes one from a file, the constructors `Robot.from_...` from numbers or from other libraries' models.

    Conventions of every method:

    * SI units. Twists, screws and wrenches are (angular; linear).
    * Leading axes are batch axes and broadcast; the coordinate axis is last. Scalars are real and of any type: float
      arrays of NumPy, arrays of JAX, or object arrays of CasADi SX, SymPy or other symbols.
    * A state may name its coordinates: a dict, a data frame or series, or a structured array is matched by joint name.
      Results are always arrays, in the order of `joint_names`.
    * q is required; each further rate you give returns one more time derivative, up to order 100. With none to spare
      the result is a plain array, otherwise a tuple: the quantity, its rate, ...
    * ``base=(C, V, Vd, ...)`` is the motion of the base: its pose C (..., 4, 4), base to inertial frame, its twist V
      (..., 6) in its own axes about its origin, and the rates of these components, as many terms as q has. Robots that
      float require it: their forces, matrices and Jacobians have nv = 6 + n rows or columns, those of the base first,
      Q the wrench (moment; force) that acts on it, in its axes. For other robots nv = n, and the base is the ground, at
      rest unless given. Where it does not enter, as in the mass matrix, it may be left out.
    * Missing values (masked by NumPy, or NA of pandas) are NaN, and so are results that depend on them.
    * ``method`` selects the method: "kernel" is native code, the default for NumPy arrays of float64, and for arrays
      of JAX on the CPU, if it is available; "recursion" is the default otherwise; "closed_form" and "paper" are
      independent checks. All agree. The first call compiles native code, in a fraction of a second, and keeps it on
      disk for later processes.
    * ``out`` is the NumPy array, or tuple of arrays, to write the results into; ``threads`` is the number of threads
      among which native code splits a batch.

    Robots are equal if all their data are equal: names, tree and numbers.

    Errors: `JounceError` for a wrong shape, a skipped rate, an unknown name or method, or an invalid `out`.

    Examples
    --------
    >>> import jounce
    >>> robot = jounce.load("planar2r")
    >>> robot.n, robot.joint_names, robot.body_names
    (2, ('joint1', 'joint2'), ('body1', 'body2'))
    >>> robot.gravity_forces([0.0, 0.0])
    array([29.43,  9.81])
    """

    def __eq__(self, other: object) -> bool:
        return equality.equal(self.mechanism, other.mechanism) if isinstance(other, Robot) else NotImplemented

    def __hash__(self) -> int:
        return hash(equality.key(self.mechanism))

    def __repr__(self) -> str:
        floats = ", floating" if self.mechanism.base else ""
        springs = ", elastic joints" if self.mechanism.elasticity else ""
        return f"<Robot {self.name!r}: {self.n} coordinates, {len(self.body_names)} bodies{floats}{springs}>"

    if not TYPE_CHECKING:
        __getattr__ = renamed

    @property
    def gravity(self) -> Array:
        """The gravitational acceleration in the inertial frame, m/s^2."""
        return self.mechanism.gravity

    @property
    def limits(self) -> Limits:
        """The limits of the nb joint variables and of their forces, SI units, see `Limits`; `with_limits` sets them.

        A limit that is not stated is infinite. Limits do not enter Q.
        """
        return self.mechanism.limits

    @property
    def drives(self) -> Drives:
        """The drive trains as stated: `armature`, `damping`, `friction`, `eps`, `stiffness`, `rest`, (nb,) each.

        They are those of the nb joint variables, in SI units. They enter Q where `with_drives` or
        ``load(..., drives=True)`` selects them.
        """
        return self.mechanism.drives

    @property
    def elasticity(self) -> "Elasticity | None":
        """The springs and motors of elastic joints, one per coordinate: `stiffness`, `rotor`, ..., see `Elasticity`.

        None where all joints are rigid; `elastic` makes them elastic.
        """
        return self.mechanism.elasticity

    @classmethod
    def from_screws(
        cls,
        B: ArrayLike,
        X: ArrayLike,
        M: ArrayLike,
        parent: Sequence[int] | None = None,
        names: Sequence[str] | None = None,
        gravity: ArrayLike = GRAVITY,
        *,
        joint_names: Sequence[str] | None = None,
        G: ArrayLike | None = None,
        g: ArrayLike | None = None,
        limits: Limits | Mapping[str, ArrayLike] | None = None,
        drives: Drives | Mapping[str, ArrayLike] | None = None,
        base: ArrayLike | None = None,
        base_name: str = "base",
        name: str = "robot",
    ) -> Self:
        """A robot from body-fixed data.

        Body i moves relative to its parent p by ``C_i = C_p B_i exp(X_i theta_i)`` with joint variables
        ``theta = G q + g``.

        Parameters
        ----------
        B : (nb, 4, 4)
            Pose of body i in the frame of its parent body at theta_i = 0.
        X : (nb, 6)
            Joint screw in the frame of body i, (xi; eta): revolute (e; x cross e), helical of pitch h
            (e; x cross e + h e), prismatic (0; e), with a unit vector e and a point x on the axis.
        M : (nb, 6, 6)
            Inertia matrix in the frame of body i, see `inertia_matrix`.
        parent : (nb,), optional
            Index of the parent body, smaller than i; -1 is the ground, or the base if the robot floats, and several
            bodies may have it. The default is a serial chain.
        names : (nb,), optional
            Names of the bodies.
        gravity : (3,), optional
            Gravitational acceleration in the inertial frame, m/s^2.
        joint_names : (n,), optional
            Names of the coordinates.
        G, g : (nb, n) and (nb,), optional
            Constants of joints that follow others; theta = q by default.
        limits : mapping, optional
            `lower`, `upper`, `velocity`, `effort`, ... of theta, (nb,) each, or (nb, 2) for (lower, upper); infinite
            where left out, see `Limits`.
        drives : mapping, optional
            `armature`, `damping`, `friction`, `eps`, `stiffness`, `rest` of theta, (nb,) each; zero (eps 0.05) where
            left out, see `with_drives`.
        base : (6, 6), optional
            Inertia matrix of the base in its own frame, if the robot floats; otherwise the robot stands on the ground.
        base_name : str, optional
            Name of the base.
        name : str, optional
            Name of the robot.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If a shape or name is wrong, a number is not finite, a pose, screw or inertia is invalid, or a body
            comes before its parent.

        References
        ----------
        Müller & Kumar, (Ci), (Xi), (eqn_body_fixed_mass_inertia_matrix).

        Examples
        --------
        A pendulum of 2 kg at 0.5 m that turns about the y axis:

        >>> import numpy as np, jounce
        >>> M = jounce.inertia_matrix(2.0, [0, 0, -0.5], np.zeros((3, 3)))
        >>> pendulum = jounce.Robot.from_screws([np.eye(4)], [[0, 1, 0, 0, 0, 0]], [M])
        >>> pendulum.inverse_dynamics([np.pi / 2], [0.0], [0.0]).round(6)
        array([9.81])

        The same on a base of 10 kg that floats:

        >>> base = jounce.inertia_matrix(10.0, [0, 0, 0], 0.2 * np.eye(3))
        >>> jounce.Robot.from_screws([np.eye(4)], [[0, 1, 0, 0, 0, 0]], [M], base=base, base_name="trunk")
        <Robot 'robot': 1 coordinates, 2 bodies, floating>
        """
        return cls(screws.from_screws(
            B, X, M, parent, names, gravity, joint_names=joint_names, G=G, g=g, limits=limits, drives=drives,
            base=base, base_name=base_name, name=name,
        ))  # fmt: skip

    @classmethod
    def from_spatial_screws(
        cls,
        A: ArrayLike,
        Y: ArrayLike,
        M: ArrayLike,
        parent: Sequence[int] | None = None,
        names: Sequence[str] | None = None,
        gravity: ArrayLike = GRAVITY,
        *,
        joint_names: Sequence[str] | None = None,
        G: ArrayLike | None = None,
        g: ArrayLike | None = None,
        limits: Limits | Mapping[str, ArrayLike] | None = None,
        drives: Drives | Mapping[str, ArrayLike] | None = None,
        base: ArrayLike | None = None,
        base_name: str = "base",
        name: str = "robot",
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
        parent, names, gravity, joint_names, G, g, limits, drives, base, base_name, name : optional
            As in `from_screws`; the frame of a base is the inertial frame at theta = 0.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            As in `from_screws`.

        Examples
        --------
        >>> import numpy as np, jounce
        >>> M = jounce.inertia_matrix(1.0, [0.1, 0, 0], 0.01 * np.eye(3))
        >>> robot = jounce.Robot.from_spatial_screws([np.eye(4)], [[0, 0, 0, 0, 0, 1]], [M])  # a vertical slide
        >>> robot.inverse_dynamics([0.3], [0.0], [1.0])
        array([10.81])
        """
        return cls(screws.from_spatial_screws(
            A, Y, M, parent, names=names, gravity=gravity,
            joint_names=joint_names, G=G, g=g, limits=limits, drives=drives, base=base, base_name=base_name, name=name,
        ))  # fmt: skip

    @classmethod
    def from_dh(
        cls,
        table: ArrayLike | Sequence[Mapping[str, object]],
        M: ArrayLike,
        convention: Convention,
        *,
        types: Sequence[JointType] | None = None,
        degrees: bool = False,
        base: ArrayLike | None = None,
        tool: ArrayLike | None = None,
        names: Sequence[str] | None = None,
        gravity: ArrayLike = GRAVITY,
        joint_names: Sequence[str] | None = None,
        G: ArrayLike | None = None,
        g: ArrayLike | None = None,
        limits: Limits | Mapping[str, ArrayLike] | None = None,
        drives: Drives | Mapping[str, ArrayLike] | None = None,
        name: str = "robot",
    ) -> Self:
        """A serial robot from a Denavit-Hartenberg table.

        "standard": ``T_i = Rot_z(theta_i) Trans_z(d_i) Trans_x(a_i) Rot_x(alpha_i)``; frame i is at the end of link i,
        the axis of joint i is z of frame i - 1.

        "modified" (Craig's): ``T_i = Rot_x(alpha_i) Trans_x(a_i) Rot_z(theta_i) Trans_z(d_i)``; frame i is on the axis
        of joint i, its z axis; row i holds what Craig calls a_{i-1}, alpha_{i-1}, d_i, theta_i.

        The joint variable is added to theta_i, of a prismatic joint to d_i. **Body i has frame i**: inertias, wrenches
        and poses are those of this frame, which differs between the conventions.

        Parameters
        ----------
        table : (n, 4), or n mappings
            Rows **a, alpha, d, theta**, in this order, which is not that of every book; in m and rad. Rows that cannot
            be confused are mappings, ``{"theta": 0, "d": 0.1, "a": 0, "alpha": 1.2}``, with ``"type": "prismatic"``
            for a prismatic joint.
        M : (n, 6, 6)
            Inertia matrices in the frames of the table, see `inertia_matrix`.
        convention : str
            "standard" or "modified".
        types : sequence of str, optional
            "revolute" (the default for all) or "prismatic", one for each row of numbers.
        degrees : bool, optional
            Whether alpha and theta are in degrees.
        base, tool : (4, 4), optional
            Pose of frame 0 in the inertial frame; pose of a frame "tool" in frame n.
        names, gravity, joint_names, G, g, limits, drives, name : optional
            As in `from_screws`.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If a row does not have four finite numbers, a convention or type is unknown, or as in `from_screws`.

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
        return cls(dh.from_dh(
            table, M, convention, types=types, degrees=degrees, base=base, tool=tool, names=names, gravity=gravity,
            joint_names=joint_names, G=G, g=g, limits=limits, drives=drives, name=name,
        ))  # fmt: skip

    @classmethod
    def from_pinocchio(
        cls, model: Any, *, gravity: ArrayLike | None = None, base: Base | None = None, root: str | None = None
    ) -> Self:
        """A robot from a Pinocchio model, with the Q of ``pinocchio.rnea(model, data, q, v, a)`` and the same names.

        The coordinates are in the order of Pinocchio's v and named after its joints; mimic joints follow their leader.
        Differences: a joint without bounds has its angle in q, not a cosine and a sine; joints of several coordinates
        (composite, universal, translation, sphericalZYX) are chains, ``NAME_1``, ``NAME_2``, ...; bodies are in the
        order of joints depth first, which is Pinocchio's own for a URDF. Armature (where it is 0, the rotor's inertia
        times the gear ratio squared), damping and friction become drives, see `with_drives`: Pinocchio's rnea always
        includes armature and never the others. Bodies, operational frames and sensors may be named wherever a body may.

        Parameters
        ----------
        model : pinocchio.Model
            A model of numbers.
        gravity : (3,), optional
            Gravitational acceleration, m/s^2; that of the model by default.
        base : str, optional
            "floating": the body that the free-flyer moves is the base, and floats. "fixed" welds free-flyer, planar and
            spherical joints at zero, with a `JounceWarning`. By default such joints are refused.
        root : str, optional
            A body or frame that becomes the base, fixed to the ground or floating: only the bodies that it carries are
            kept.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If it is not a model of Pinocchio, has a free joint, has no joint that moves, or holds a number that is not
            finite.

        Examples
        --------
        >>> import jounce, pinocchio
        >>> model = pinocchio.buildSampleModelManipulator()
        >>> robot = jounce.Robot.from_pinocchio(model)
        >>> robot.joint_names == tuple(model.names)[1:]
        True
        """
        from jounce.io.models import pinocchio  # what few programs need

        return cls(pinocchio.mechanism(model, gravity, base, root))

    @classmethod
    def from_mujoco(
        cls, model: Any, *, gravity: ArrayLike | None = None, base: Base | None = None, root: str | None = None
    ) -> Self:
        """A robot from a MuJoCo model in memory, as `jounce.load` makes one from an MJCF file.

        Coordinates are MuJoCo's joint variables (rad, m), in its order; joints that an active equality constraint ties
        linearly to another follow it exactly, and are not coordinates. Bodies without a joint merge into those that
        carry them, named sites become merged links. If a body has several joints, all but the last move massless links,
        named BODY:JOINT. Features that the model's flags disable are ignored.

        Parameters
        ----------
        model : mujoco.MjModel
            The model; it is read, not kept.
        gravity : (3,), optional
            Gravitational acceleration, m/s^2; that of the model by default.
        base, root : str, optional
            ``base="floating"``: the body on the free joint is the base, and floats; ``base="fixed"`` welds ball and
            free joints at the model's placement. `root` names a body that becomes the base, floating or fixed to the
            ground.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If it is not a model of MuJoCo, has a ball or free joint and no `base` or `root` is given, has no joint that
            moves, or holds a number that is not finite.

        Warns
        -----
        JounceWarning
            For terms of MuJoCo's inverse dynamics that jounce ignores: other equality constraints, tendons, gravity
            compensation, nonlinear springs and dampers, fluids; and for welded joints.

        Examples
        --------
        >>> import jounce, mujoco
        >>> body = "<body name='arm'><joint name='tilt' axis='0 1 0'/><geom size='0.1' pos='0 0 1'/></body>"
        >>> model = mujoco.MjModel.from_xml_string(f"<mujoco model='m'><worldbody>{body}</worldbody></mujoco>")
        >>> jounce.Robot.from_mujoco(model)
        <Robot 'm': 1 coordinates, 1 bodies>
        """
        from jounce.io.models import mujoco  # what few programs need

        return cls(mujoco.mechanism(model, gravity, base, root))

    def state_from(
        self,
        library: Library,
        q: ArrayLike,
        v: ArrayLike | None = None,
        a: ArrayLike | None = None,
        *,
        forces: ArrayLike | None = None,
        model: Any,
    ) -> "RobotState":
        """The state of the robot, and its forces, from vectors of Pinocchio or MuJoCo: joints by name.

        A base that floats has a pose C, a twist V and its rate Vd from its joint. Of the vectors of this joint,
        Pinocchio has the quaternion as (x, y, z, w) and the velocity as (linear; angular) in the axes of the body:
        ``V = (v[3:6]; v[:3])``, ``Vd = (a[3:6]; a[:3])``. MuJoCo has the quaternion as (w, x, y, z), and the linear
        velocity and force in world axes: with the rotation R of the base, ``V = (v[3:6]; R^T v[:3])`` and
        ``Vd = (a[3:6]; R^T a[:3] - v[3:6] x R^T v[:3])``. Joints that turn freely have a cosine and a sine in
        Pinocchio's q; here they are angles from -pi to pi.

        Parameters
        ----------
        library : {"pinocchio", "mujoco"}
            Whose vectors they are.
        q : (..., nq)
            q of Pinocchio, qpos of MuJoCo; quaternions of unit norm within 1e-6.
        v, a : (..., nv), optional
            Velocity and acceleration: v and a, or qvel and qacc.
        forces : (..., nv), optional
            Generalized forces, such as tau of Pinocchio's rnea, or qfrc_inverse of MuJoCo.
        model : pinocchio.Model or mujoco.MjModel
            The model whose vectors they are: its order of joints may differ from that of the robot. Joints that move
            none of the robot's bodies are ignored.

        Returns
        -------
        RobotState
            To use as ``robot.inverse_dynamics(*state.rates, base=state.base)``. Its Q are the forces, if given: the
            wrench (moment; force) on a base that floats first, in its axes; forces of joints that follow others are
            added to these.

        Raises
        ------
        JounceError
            If a shape is wrong, a quaternion is not of unit norm, a joint of the robot is not in the model, another
            joint of the model moves its bodies, such as one that is locked, or a joint is not where those that it
            follows place it, within 0.01.

        Examples
        --------
        >>> import jounce, pinocchio
        >>> model = pinocchio.buildSampleModelHumanoid()
        >>> robot = jounce.Robot.from_pinocchio(model, base="floating")
        >>> state = robot.state_from("pinocchio", pinocchio.neutral(model), model=model)
        >>> state.q.shape, state.base[0].shape
        ((28,), (4, 4))
        """
        from jounce.io.models import states  # what few programs need

        return states.state_from(self.mechanism, states.layout_of(library, model), (q, v, a), forces)

    def state_to(
        self,
        library: Library,
        q: Named | None = None,
        qd: Named | None = None,
        q2d: Named | None = None,
        *,
        Q: Named | None = None,
        base: Rates | None = None,
        model: Any,
    ) -> Results:
        """The vectors of Pinocchio or MuJoCo that state the robot, and its forces: the inverse of `state_from`.

        Parameters
        ----------
        library : {"pinocchio", "mujoco"}
            Whose vectors they become.
        q, qd, q2d : (..., n), optional
            Coordinates, velocities and accelerations.
        Q : (..., nv), optional
            Generalized forces, the wrench on the base first if the robot floats.
        base : tuple, optional
            C, V, Vd of the base of a robot that floats, as many as there are of q, qd and q2d. Forces of MuJoCo alone
            need C, those of Pinocchio none.
        model : pinocchio.Model or mujoco.MjModel
            The model whose vectors they become.

        Returns
        -------
        array, or tuple of arrays
            What is given, in this order: q (..., nq), of a pose the quaternion with w >= 0; v and a (..., nv); forces
            (..., nv), zero at joints that follow others. Joints that move none of the robot's bodies are at rest, in
            Pinocchio's neutral position or at MuJoCo's qpos0, without forces.

        Raises
        ------
        JounceError
            If a shape is wrong, the pose is missing or not a pose, or the joints of the model are not those of the
            robot.

        Examples
        --------
        >>> import jounce, mujoco
        >>> arm = "<body name='arm'><joint name='tilt'/><geom size='.1'/></body>"
        >>> model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{arm}</worldbody></mujoco>")
        >>> robot = jounce.Robot.from_mujoco(model)
        >>> robot.state_to("mujoco", [0.4], [2.0], model=model)
        (array([0.4]), array([2.]))
        >>> robot.state_to("mujoco", Q=[3.0], model=model)
        array([3.])
        """
        from jounce.io.models import states  # what few programs need

        vectors = states.state_to(self.mechanism, states.layout_of(library, model), (q, qd, q2d), base, Q)
        return vectors[0] if len(vectors) == 1 else vectors

    def with_drives(self, terms: DriveTerms = True, eps: float | None = None) -> Self:
        """The robot whose inverse dynamics includes the selected drive terms: armature, damping, friction, spring.

        ``Q_theta = armature theta'' + damping theta' + friction tanh(theta' / eps) + stiffness (theta - rest)`` of the
        joint variables theta = G q + g; Q gains ``G^T Q_theta`` and M ``G^T diag(armature) G``, with exact rates.

        Parameters
        ----------
        terms : bool, str or iterable of str, optional
            "armature", "damping", "friction", "spring"; True selects all, False none.
        eps : float, optional
            Smoothing velocity of Coulomb friction, rad/s or m/s; by default that of each joint (0.05 unless stated).

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If a term is unknown, `eps` is not a positive number, or a term of the motors is selected for a robot with
            elastic joints.

        Warns
        -----
        JounceWarning
            If the robot states none of the terms, or `eps` is given and no friction enters.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("panda").with_drives("damping")
        >>> arm.mechanism.acting
        ('damping',)
        """
        if self.mechanism.elasticity is not None and (moved := set(select_terms(terms)) - {"spring"}):
            raise JounceError(
                f"{self.name} has elastic joints: {listed(sorted(moved))} would act on the links, not on the motors;"
                " select drive terms before elastic()"
            )
        drives = self.drives if eps is None else with_eps(self.drives, eps)
        warn_of_idle(self.drives, terms, eps, self.name)
        return type(self)(replace(self.mechanism, acting=select_terms(terms), drives=drives))

    def with_limits(
        self,
        source: "str | PathLike[str] | Limits | None" = None,
        /,
        *,
        lower: LimitValues = None,
        upper: LimitValues = None,
        velocity: LimitValues = None,
        acceleration: LimitValues = None,
        jerk: LimitValues = None,
        snap: LimitValues = None,
        effort: LimitValues = None,
        effort_rate: LimitValues = None,
        second_effort_rate: LimitValues = None,
        power: LimitValues = None,
        stall_effort: LimitValues = None,
        no_load_velocity: LimitValues = None,
        motor_position: LimitValues = None,
        motor_velocity: LimitValues = None,
        motor_torque: LimitValues = None,
        motor_current: LimitValues = None,
        motor_voltage: LimitValues = None,
        of: str | Mapping[str, str] | None = None,
    ) -> Self:
        """The robot with some of its limits replaced: of q to q4d, of Q, Qd, Q2d, of the power qd Q, and of motors.

        They come from a file, from the published table of an arm, or as numbers, which come last: one number for all
        coordinates, an array (n,), or a mapping {joint: number}. Except `lower` and `upper`, which bound the position,
        a limit has two sides where (lower, upper) stands in place of a number, (n, 2) in place of (n,). Infinity takes
        a limit away. What is left out keeps its limits. Closed loops: forces and power are limited at the motors, in
        the order of `actuator_forces` if these are not at the coordinates.

        Parameters
        ----------
        source : str, path or Limits, optional
            A YAML or JSON file of limits, MoveIt's joint_limits.yaml among them; the name of an arm whose limits are
            published: "panda", "fr3", "ur3e", "ur5", "ur5e", "ur10e", "iiwa7", "iiwa14", "xarm6", "xarm7", for joints
            with its names behind any prefix; or the limits of a robot with the same joints.
        lower, upper, velocity, acceleration, jerk, snap : number, array or mapping, optional
            Bounds of q, qd, q2d, q3d, q4d: rad or m, per s, ...
        effort, effort_rate, second_effort_rate : number, array or mapping, optional
            Bounds of Q, Qd, Q2d: N m or N, per s, per s^2.
        power : number, array or mapping, optional
            Bound of qd Q, W.
        stall_effort, no_load_velocity : number, array or mapping, optional
            Q that falls with speed, as drives have it: Q / stall_effort + qd / no_load_velocity <= 1 in either
            direction, where a line of the data sheet ends at rest, N m or N, and without load, rad/s or m/s.
        motor_position, motor_velocity, motor_torque : number, array or mapping, optional
            Bounds of theta, thetad and tau of motors behind elastic joints, seen from the links: rad or m, per s, N m
            or N.
        motor_current, motor_voltage : number, array or mapping, optional
            Bounds of the currents and voltages of these motors, A and V.
        of : str or mapping, optional
            Which force the effort limits given here bound, with its rates: "Q", the default, or "Q - Qgrav"; a mapping
            {"effort_rate": "Q - Qgrav"} says it of some.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If a joint, a kind or the name of an arm is unknown, a file cannot be read, a lower limit is above the upper
            one, a number is negative, or a force is limited at a joint of a closed robot without a motor.

        Warns
        -----
        JounceWarning
            If a file of MoveIt states limits of joints that the robot does not have.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").with_limits("panda").limits.jerk[:3]
        array([7500., 3750., 5000.])
        >>> robot = jounce.load("iiwa14").with_limits(effort=[320, 320, 176, 176, 110, 40, 40], velocity={"joint1": 2})
        >>> robot.limits.velocity[:2]
        array([ 2., inf])
        """
        given = {
            "lower": lower, "upper": upper, "velocity": velocity, "acceleration": acceleration, "jerk": jerk,
            "snap": snap, "effort": effort, "effort_rate": effort_rate, "second_effort_rate": second_effort_rate,
            "power": power, "stall_effort": stall_effort, "no_load_velocity": no_load_velocity,
            "motor_position": motor_position, "motor_velocity": motor_velocity, "motor_torque": motor_torque,
            "motor_current": motor_current, "motor_voltage": motor_voltage,
        }  # fmt: skip
        from jounce.io.limits.reading import limits_from  # what few programs need

        mechanism = self.mechanism
        if source is not None:
            mechanism = replace(mechanism, limits=limits_from(mechanism, source))
        return type(self)(with_limits(mechanism, given, of))

    @property
    def inertial_parameters(self) -> Array:
        """The inertial parameters of all bodies, (10 nb,), of which Q is linear: Q = `regressor` @ them.

        Per body, in the order of `body_names`: m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz, with the first moment
        m c and the inertia tensor I about the origin of the body frame, in its axes, as Pinocchio has them; kg, kg m,
        kg m^2.
        """
        return inertial.parameters_of(self.mechanism)

    def with_inertial_parameters(self, p: ArrayLike) -> Self:
        """The robot with other inertial parameters, such as identified ones.

        Parameters
        ----------
        p : (10 nb,)
            As `inertial_parameters`. Any finite numbers are taken: `audit` finds what no distribution of mass has.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If the shape is wrong or a number is not finite.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> robot.with_inertial_parameters(2 * robot.inertial_parameters).gravity_forces([0, 0])
        array([58.86, 19.62])
        """
        return type(self)(inertial.with_parameters(self.mechanism, p))

    def base_parameters(self) -> "BaseParameters":
        """The base inertial parameters: the fewest combinations of `inertial_parameters` that determine Q.

        They are those that forces of the joints let identify, found without states from the geometry of the joints, for
        a base at rest unless it floats. The direction of gravity counts, and joints that follow others. Those of closed
        robots are fewer than those of their trees; they are found at random states around the start.

        Returns
        -------
        BaseParameters
            With `names`, `matrix` (count, 10 nb), `columns` and `count`: for p = `inertial_parameters` and the
            regressor Y, Q = Y[:, columns] (matrix p). ``print`` shows a table.

        Raises
        ------
        JounceError
            If the robot holds symbols.

        References
        ----------
        M. Gautier, W. Khalil, "Direct Calculation of Minimum Set of Inertial Parameters of Serial Robots", IEEE
        Transactions on Robotics and Automation 6(3), 1990. P. M. Wensing, G. Niemeyer, J.-J. E. Slotine, "A Geometric
        Characterization of Observability in Inertial Parameter Identification", International Journal of Robotics
        Research 43(14), 2024.

        Examples
        --------
        >>> import jounce
        >>> found = jounce.load("planar2r").base_parameters()
        >>> found
        <BaseParameters: 6 of 20>
        >>> found.names
        ('body1 mcx', 'body1 mcy', 'body1 Izz', 'body2 mcx', 'body2 mcy', 'body2 Izz')
        """
        from jounce.dynamics.base_parameters import base_parameters  # what few programs need

        return base_parameters(self.mechanism)

    def locked(self, values: Mapping[str, float]) -> Self:
        """The robot with some joints locked: their bodies merge into those that carry them.

        The loops of a closed robot stay closed: joints that follow the locked ones move to where these hold them.

        Parameters
        ----------
        values : mapping
            {joint: rad or m}. Of a closed robot, independent coordinates.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If a joint is unknown or follows another, a value is not a finite number, no joint remains, or the loops
            cannot be closed.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("iiwa14").locked({"joint3": 0.0, "joint7": 0.5}).n
        5
        """
        return type(self)(with_locked(self.mechanism, values))

    def audit(self) -> "tuple[Finding, ...]":
        """Check the model data for physically impossible or suspicious values.

        It finds inertias that are not positive semidefinite or break the triangle inequality, placeholders, massless
        bodies and a singular mass matrix, masses, lengths and moments off by powers of 1000, missing effort and
        velocity limits, odd gravity.

        Returns
        -------
        tuple of Finding
            Errors first; empty if nothing is found.

        Raises
        ------
        JounceError
            If the robot holds symbols.

        Examples
        --------
        >>> import jounce
        >>> for finding in jounce.load("planar2r").audit():
        ...     print(finding.severity, finding)
        note body1, body2: mass, 1 kg at most, without moments about its COM
        note joint1, joint2: no effort limit on any joint
        note joint1, joint2: no velocity limit on any joint
        """
        from jounce.checks.audit import audit  # what few programs need

        return audit(self.mechanism)

    @typed(overloads.Compile)
    @renamed_keywords(base="moving_base")
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
    ) -> Kernel:
        """Compile a quantity to native code before its first call.

        Code that takes longer than three seconds to compile is compiled only here and with ``method="kernel"``; the
        robot's methods use it from then on, in later processes too, because it is kept on disk.

        Parameters
        ----------
        quantity : str, optional
            The name of the method: "inverse_dynamics", "mass_matrix", "jacobian", ... The first is the default, but
            for this release not of robots with elastic joints.
        order : int, optional
            The highest rate of the quantity: 2 gives Q, Qd, Q2d.
        wrench : bool, optional
            Whether wrenches W, Wd, ... (..., nb, 6) follow the coordinates' rates in its calls.
        body, frame : str, optional
            Body or merged link, and frame, of poses, twists and Jacobians; all bodies by default.
        product : {"vjp", "jvp"}, optional
            Products of the derivatives by all inputs instead of the values: the kernel that `Kernel.vjp` or
            `Kernel.jvp` compiles at its first call, which takes the weights or directions after the other arrays.
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
            If a name is unknown, the robot holds symbols, llvmlite is missing, or a call needs more than 64 MiB of
            scratch memory.

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
        name = compiled_name(self, quantity)
        asked = requests.computation(self.mechanism, name, order, wrench, body, frame, product, moving_base)
        return compile_ahead(self, asked)

    @typed(overloads.OfAcceleration)
    def inverse_dynamics(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named | None = None,
        q4d: Named | None = None,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
        side: Side | None = None,
    ) -> Results:
        """The generalized forces Q of a motion and their time derivatives Qd, Q2d, ... (RNEA with rates).

        ``Q = M(q) q2d + C(q, qd) qd + Qgrav(q) + Qext``, with the drive terms that act added.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of Q.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, Qext = +J^T W, (moment; force) in body-frame components about
            the origin of the body frame. A *tuple* (W, Wd, ...) is W with as many rates as Q has; anything else, nested
            lists included, is W alone. Each is an array (..., nb, 6) or a dict {body or merged link: (..., 6)}. Wd is
            the derivative of those components.
        base, method, out, threads : optional
            See `Robot`.
        side : "links", optional
            To be given for this release where joints are elastic: Q is the force of the links, not `motor_torques`.

        Returns
        -------
        Q : (..., nv), or tuple of (..., nv)
            In N m for revolute and N for prismatic coordinates, per s, per s^2, ...

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or `wrench` has fewer rates than Q.

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
        if side is not None or self.mechanism.elasticity is not None:
            check_side(self, "inverse_dynamics", side)
        rates = (q, qd, q2d, q3d, q4d, *higher)
        return compute(
            self, "inverse_dynamics", rates, wrench=wrench, base=base, method=method, out=out, threads=threads
        )

    @typed(overloads.OfForces)
    def forward_dynamics(
        self,
        q: Named,
        qd: Named,
        Q: Named,
        Qd: Named | None = None,
        Q2d: Named | None = None,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
        side: Side | None = None,
    ) -> Results:
        """Accelerations q2d from generalized forces, with as many rates as Q has.

        ``q2d = M^-1 (Q - C qd - Qgrav - Qext)``: the inverse of `inverse_dynamics`, of every order. Drive terms that
        act are subtracted from Q; armature that acts is in M. Of a robot that floats, the acceleration of the base is
        found too: ``(Vd; q2d)``.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, and per s.
        Q : (..., nv)
            Generalized forces: N m, or N for coordinates in m. If the robot floats, they begin with the wrench (moment;
            force) that acts on the base, in its axes: zero in flight.
        Qd, Q2d, *higher : (..., nv), optional
            Their time derivatives; each returns one more rate of q2d.
        wrench : (..., nb, 6), dict or tuple, optional
            What the bodies EXERT ON their environment, (moment; force) in body frames, alone or as a tuple with its
            rates, (W, Wd, ...), as many as Q has; by body name as a dict.
        base : tuple of arrays, optional
            (C, V) of a robot that floats: the pose of the base and its twist. Of a fixed robot the motion of the
            ground, (C, V, Vd, ...), as many terms as q has with its rates; see `Robot`.
        method : {"kernel", "recursion", "closed_form"}, optional
            See `Robot`.
        out : array or tuple of arrays, optional
            Written into and returned: (..., nv) each.
        threads : int, optional
            Threads of native code that split the batch.
        side : "links", optional
            To be given for this release where joints are elastic: Q acts on the links, see `elastic_forward_dynamics`.

        Returns
        -------
        q2d, q3d, ... : (..., nv)
            Accelerations and their rates: rad/s^2 or m/s^2, and per s. If the robot floats, (Vd; q2d), (V2d; q3d), ...:
            they begin with the rates of the components of the base's twist.

        Raises
        ------
        JounceError
            If a shape or name does not fit, a rate is skipped, or the mass matrix is singular at all positions.
            Where it is singular at one, results are infinite or NaN, with NumPy's warning. Compiled kernels, generated
            code and arrays of JAX do not look at it: they may give large numbers that are rounding there.

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
        if side is not None or self.mechanism.elasticity is not None:
            check_side(self, "forward_dynamics", side)
        rates = (q, qd, Q, Qd, Q2d, *higher)
        return compute(
            self, "forward_dynamics", rates, wrench=wrench, base=base, method=method, out=out, threads=threads
        )

    @typed(overloads.OfAcceleration)
    def inverse_dynamics_partials(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named | None = None,
        q4d: Named | None = None,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The partial derivatives P of the generalized forces by q, qd and q2d, and those of the forces' rates.

        ``P[j] = dQ/dq^(j)``, in the order q, qd, q2d; ``Pd[j] = dQd/dq^(j)``, j = 0 .. 3; ``P2d[j] = dQ2d/dq^(j)``,
        j = 0 .. 4. P[2] is the mass matrix. Drive terms that act contribute.

        If the robot floats, the first six rows are those of the wrench on the base, and the first six columns the
        derivatives along a displacement of the base by a twist d in its own axes, C exp(wedge(d)) (j = 0), by its twist
        V (j = 1), by Vd (j = 2) and so on, with the other components held. Those of a closed robot are derivatives by
        its independent coordinates, which the others follow.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for the partial derivatives of one more rate of Q.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            What the bodies EXERT ON their environment, as in `inverse_dynamics`. Its components in the body frames are
            held constant: the wrench turns with the body as q changes. Of a wrench that keeps its direction in space,
            those components depend on q, and the derivative has one more term.
        base : tuple of arrays, optional
            (C, V, Vd, ...), see `Robot`. Derivatives by the motion of the ground of a fixed robot are left out.
        method : {"kernel", "recursion", "closed_form"}, optional
            See `Robot`.
        out : array or tuple of arrays, optional
            Written into and returned.
        threads : int, optional
            Threads of native code that split the batch.

        Returns
        -------
        P : (..., 3, nv, nv), or tuple of P, Pd, P2d, ...: (..., 3, nv, nv), (..., 4, nv, nv), (..., 5, nv, nv), ...
            Row i, column k: the derivative of force i by coordinate k, in units of Q over those of q, qd, q2d, ....

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or `wrench` has fewer rates than Q.

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
        rates = (q, qd, q2d, q3d, q4d, *higher)
        name = "inverse_dynamics_partials"
        return compute(self, name, rates, wrench=wrench, base=base, method=method, out=out, threads=threads)

    @typed(overloads.Regressor)
    def regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named | None = None,
        q4d: Named | None = None,
        *higher: Named,
        drives: DriveColumns = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
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
            Columns to append: nb, one per joint variable, for each of "armature", "damping", "friction", "spring" and
            "offset", a constant force, in this order; True appends all. Their parameters are those of `Robot.drives`,
            of the spring its stiffness; eps of friction and the rest position of the spring are those of the robot.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Y : (..., nv, 10 nb), or tuple of (..., nv, 10 nb)
            With drives, (..., nv, 10 nb + k nb) for k terms; nb in 10 nb counts a floating base, which is the first of
            `body_names`, and in k nb it does not. Columns in N m or N over kg, kg m, kg m^2.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or the name of a drive term is unknown.

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
        given = (q, qd, q2d, q3d, q4d, *higher)
        options = {"base": base, "method": method, "threads": threads}
        return regressor(self, "regressor", given, select_columns(drives), out, **options)

    @typed(overloads.OfVelocityRegressor)
    def momentum_regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named | None = None,
        q3d: Named | None = None,
        *higher: Named,
        drives: DriveColumns = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The regressor Yp of the generalized momentum and its time derivatives: M qd = Yp p.

        p are the `inertial_parameters`. ``Y(q, qd, q2d) = Ypd(q, qd, q2d) + R(q, qd)`` of the `regressor` Y: the forces
        are the rate of the momentum and what q and qd determine, so that their integral needs no q2d.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of Yp.
        drives : bool, str or iterable of str, optional
            Columns to append, as of `regressor`. Of these only the armature has momentum; the others are zero.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Yp : (..., nv, 10 nb), or tuple of (..., nv, 10 nb)
            With drives, (..., nv, 10 nb + k nb) for k terms, as of `regressor`. Columns in N m s or N s over kg, kg m,
            kg m^2.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or the name of a drive term is unknown.

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
        options = {"base": base, "method": method, "threads": threads}
        rates, columns = (q, qd, q2d, q3d, *higher), select_columns(drives)
        return regressor(self, "momentum_regressor", rates, columns, out, **options)

    @typed(overloads.OfVelocityRegressor)
    def energy_regressor(
        self,
        q: Named,
        qd: Named,
        q2d: Named | None = None,
        q3d: Named | None = None,
        *higher: Named,
        drives: DriveColumns = False,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The regressor YE of the energy and its time derivatives: T + U = YE p.

        p are the `inertial_parameters`. While the base is at rest, the rate of the energy is the power of the forces,
        ``YEd(q, qd, q2d) = qd . Y(q, qd, q2d)`` of the `regressor` Y, so that the integral of the power needs no q2d.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative of YE.
        drives : bool, str or iterable of str, optional
            Columns to append, as of `regressor`. Of these the armature and the spring have energy; the others are zero.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        YE : (..., 10 nb), or tuple of (..., 10 nb)
            With drives, (..., 10 nb + k nb) for k terms, as of `regressor`. Columns in J over kg, kg m, kg m^2.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or the name of a drive term is unknown.

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
        options = {"base": base, "method": method, "threads": threads}
        rates, columns = (q, qd, q2d, q3d, *higher), select_columns(drives)
        return regressor(self, "energy_regressor", rates, columns, out, **options)

    @typed(overloads.ForwardPartials)
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
    ) -> Results:
        """The partial derivatives of the accelerations q2d by q, qd and Q, which linearise `forward_dynamics`.

        ``dq2d/dq = -M^-1 dQ/dq``, ``dq2d/dqd = -M^-1 dQ/dqd``, with the derivatives of `inverse_dynamics_partials` at
        the accelerations that Q causes, and ``dq2d/dQ = M^-1``. If the robot floats, those of (Vd; q2d): by a
        displacement of the base by a twist in its own axes and q, by (V; qd), and by Q.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, and per s.
        Q : (..., nv)
            Generalized forces: N m, or N for coordinates in m.
        wrench : (..., nb, 6) or dict, optional
            What the bodies EXERT ON their environment, held constant in the body frames, as in
            `inverse_dynamics_partials`.
        base : tuple of arrays, optional
            As in `forward_dynamics`.
        method : {"kernel", "recursion", "closed_form"}, optional
            See `Robot`.
        out : tuple of three arrays, optional
            Written into and returned: (..., nv, nv) each.
        threads : int, optional
            Threads of native code that split the batch.

        Returns
        -------
        dq, dqd, Minv : (..., nv, nv)
            dq2d/dq, dq2d/dqd and the inverse of the mass matrix. Row i, column k: the derivative of acceleration i by
            coordinate, velocity or force k.

        Raises
        ------
        JounceError
            If a shape or name does not fit, or the mass matrix is singular.

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
        given = (q, qd, Q)
        name = "forward_dynamics_partials"
        return compute(self, name, given, wrench=wrench, base=base, method=method, out=out, threads=threads)

    def forces_along(
        self,
        motion: "Motion",
        t: ArrayLike | None = None,
        order: int = 2,
        *,
        method: Method | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> "Along":
        """The generalized forces Q and their rates along a motion, with the wrenches and the base that it holds.

        They are those of `inverse_dynamics`, computed piece by piece: long motions take little memory besides the
        results.

        Parameters
        ----------
        motion : Motion
            From `jounce.load_motion` or a constructor of `Motion`. A robot that floats needs one with a base: columns
            ``base.x, ...`` of a table, or `Motion.with_base`. The base of a fixed robot is the ground that carries it.
        t : (N,), optional
            Times in s, any within the motion, in any order; by default ``motion.times``: those of its samples or its
            file, or a grid of about a millisecond.
        order : int, optional
            The highest rate of the forces: 2 gives Q, Qd, Q2d.
        method : str, optional
            See `Robot`.
        progress : callable, optional
            Called as ``progress(done, total)`` after each piece, with numbers of states. An exception that it raises
            ends the computation.

        Returns
        -------
        Along
            Frozen: the times `t`, the `rates` q, qd, ..., tuples of (N, n), and the `forces` Q, Qd, ..., tuples of
            (N, nv), the wrench on a base that floats first; their standard `deviations` where the motion is fitted to
            measurements; the `breaks` where a rate of Q jumps; the terms C, V, Vd, ... of the `base`.

        Raises
        ------
        JounceError
            If the motion has too few rates for the order or is not this robot's, a time is outside of it, or a name is
            unknown.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("iiwa14")
        >>> motion = jounce.load_motion("paper", robot)
        >>> Q, Qd, Q2d = robot.forces_along(motion).forces
        >>> Q2d.shape
        (10000, 7)
        """
        from jounce.engine.along import forces_along  # what few programs need

        return forces_along(self, motion, t, order, method, progress)

    def check(self, motion: "Motion") -> "Check":
        """Check a motion against every limit of the robot, between samples too.

        Between samples quintic polynomials through q, qd, ... and Q, Qd, Q2d find the peaks, which are then evaluated
        exactly. At a break of the motion both sides are checked; where a lower rate jumps, the value is infinite.

        Of measured motions, each kind of limit counts as it is where its standard deviation is at most ten times its
        median; elsewhere, which is towards the ends, where a value lies two deviations or more from its limit.

        Parameters
        ----------
        motion : Motion
            As for `forces_along`; with wrenches, these act.

        Returns
        -------
        Check
            The `verdict`: "kept", "broken", or "undecided" if no limit is broken as far as samples decide, with the
            share of time that they do, `judged`; `ok`, which is True if kept; the `worst` limit, and the `table` of all
            with worst value, ratio, time, margin and violations.

        Raises
        ------
        JounceError
            If the robot has no limits, the motion is not one of its joints, or a rate that a limit needs is not known.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r").with_limits(effort=[40, 9], velocity=1)
        >>> motion = jounce.Motion.trapezoidal([[0, 0], [1, 1]], 0.5, 2.0)
        >>> found = robot.check(motion)
        >>> found.ok, found.worst.joint, found.worst.limit, round(found.worst.ratio, 4)
        (False, 'joint2', 'effort', 1.7567)
        """
        from jounce.limits.check import check  # what few programs need

        return check(self, motion)

    def slowdown(self, motion: "Motion") -> "Slowdown":
        """The largest factor of speed at which a motion keeps every limit, and so does every slower one.

        ``q_c(t) = q(c t)`` takes ``Q_c = S + c V + c^2 D``: static, viscous and inertial forces. Every limit is a
        polynomial inequality in c at each time; between samples the factor is refined by exact evaluation. Wrenches
        given over time go with the path. Coulomb friction is no polynomial; with it, factors are tried one by one.

        Parameters
        ----------
        motion : Motion
            As for `forces_along`.

        Returns
        -------
        Slowdown
            The `factor`, what it is `binding` on: (joint, limit, time), the `motion` at this factor, and the `largest`
            feasible factor at all.

        Raises
        ------
        JounceError
            If no factor helps: a position beyond its limit, a static torque above its limit, a break where a lower
            rate of a limited quantity jumps; if nothing limits the speed; and as `check` does.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r").with_limits(effort=[60, 15])
        >>> slow = robot.slowdown(jounce.Motion.trapezoidal([[0, 0], [1, 1]], 2.0, 10.0))
        >>> round(slow.factor, 4), slow.binding.joint, slow.binding.limit
        (0.4159, 'joint2', 'effort')
        """
        from jounce.limits.slowdown import slowdown  # what few programs need

        return slowdown(self, motion)

    def retime(self, motion: "Motion", margin: float = 0.01) -> "Retiming":
        """The fastest motion along the path of a motion, within all limits of the robot.

        Every finite limit counts: velocity, acceleration, jerk and snap, Q, Qd and Q2d (or Q - Qgrav with its rates,
        as the limit says), and power; position limits are those of the path. The wrenches of the motion go with the
        path. The time law is C^5: the result is as smooth as the motion, up to q5d. It starts and ends at rest where
        the motion does; where the motion moves at an end, its velocity and acceleration there remain.

        An interior-point method finds the spline x(sigma), the square of the speed along the path, each of its
        iterates within the limits; rows are added where a limit is exceeded between the points of the path.

        Parameters
        ----------
        motion : Motion
            Of this robot. No rate of q that a limit of it takes may jump below the highest one: a torque rate takes
            q3d, so that q2d must be continuous; `Motion.blended` makes it so.
        margin : float, optional
            Share of each limit that is left.

        Returns
        -------
        Retiming
            Frozen: the `motion`, its `duration` in s, and `binding`: which limit of which joint decides, and when.

        Raises
        ------
        JounceError
            If the path does not move, leaves the position limits, or its static torque exceeds an effort limit; if
            limits are missing, or a rate that one takes is not continuous; if Coulomb friction acts at joints that
            follow others in closed loops, or turns over too fast to be resolved.

        References
        ----------
        Bobrow, Dubowsky & Gibson (1985): Time-optimal control of robotic manipulators along specified paths. Verscheure
        et al. (2009): Time-optimal path tracking for robots, a convex optimization approach.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("ur5").with_limits(effort_rate=500.0)
        >>> start, way = [0, -1.5, 1, 0, 0.5, 0], [1, 0.5, 0.5, -1, 0.5, 1]
        >>> rest_to_rest = [[a, 0, 0, 0, 35 * b, -84 * b, 70 * b, -20 * b] for a, b in zip(start, way)]
        >>> motion = jounce.Motion.polynomial(rest_to_rest, 1.0)  # trips: Qd exceeds its limits
        >>> faster = robot.retime(motion)
        >>> round(faster.duration, 2), faster.binding[0].limit
        (0.54, 'effort_rate')
        """
        from jounce.limits.retime import retime  # what few programs need

        return retime(self, motion, margin)

    def elastic(
        self, stiffness: Named | None = None, rotor: Named | None = None, damping: Named | None = None,
        spring: "SpringLaw | Mapping[str, SpringLaw] | None" = None, coupling: Coupling = "spong",
        motors: "Motor | Mapping[str, Motor] | None" = None, *, damping_terms: int = 4,
    ) -> Self:  # fmt: skip
        """The robot with elastic joints: each link hangs on its motor by a spring.

        The motor positions theta are those seen from the links, rotor angles over gear ratios. Spong's model:
        ``K (theta - q) = Q``, ``B theta2d + F_m(thetad) + K (theta - q) = tau`` with motor torques tau and the forces Q
        of the links alone. Drive terms that act in Q move to the motors: armature is rotor inertia and counts once,
        damping and friction are F_m; springs of the file are parallel to the joints, and stay in Q.

        Parameters
        ----------
        stiffness : number, (n,) or mapping, optional
            Stiffness K of the springs, N m/rad or N/m: one number for all coordinates, an array, or {joint: number}.
            Infinity is a rigid joint, as is a joint that a mapping leaves out. By default those of the robot's file.
        rotor : number, (n,) or mapping, optional
            Inertia B of the rotors as seen from the links, kg m^2 or kg: their own times the gear ratio squared. By
            default, and for a joint that a mapping leaves out, the armature of the file, whether or not it acts.
        damping : number, (n,) or mapping, optional
            Damping D of dampers parallel to the springs, N m s/rad or N s/m: ``phi(delta) + D delta' = Q`` with the
            deflection delta = theta - q. `motors_along` integrates it; at one instant it is a series.
        spring : spring or mapping, optional
            Springs that are not linear, one for all joints or {joint: spring}: `CubicSpring`, `SpringTable`, a function
            of the deflection as `SpringFunction.of` takes it, or `AntagonisticSprings` with two motors.
        coupling : "spong" or int, optional
            "spong": rotors turn about their own axes only, their motion with the links that carry them is neglected. A
            level 0, 1, ... holds it, for motors that state the bodies that carry them. Each level takes two more rates
            of q; level n - 1 is exact for a chain of n joints whose rotors are carried by links before their joints.
        motors : Motor or mapping, optional
            The motors, one for all joints or {joint: motor}: gears, inertias and carriers of rotors, friction, and the
            electrical side.
        damping_terms : int, optional
            Number of terms of the series of dampers at one instant; each after the first takes one more rate of q.

        Returns
        -------
        Robot
            With the methods of any robot, which are those of the links, and `motor_positions`, `motor_torques`,
            `motor_currents`, `motor_voltages`, `elastic_forward_dynamics`, `feedback_linearization`, `motors_along`.

        Raises
        ------
        JounceError
            If a stiffness or rotor is zero, negative or NaN, a joint is unknown, an elastic joint has no rotor, or
            rotors are coupled and one has no carrier.

        Warns
        -----
        JounceWarning
            If terms that acted in Q act on the motors now.

        References
        ----------
        M. W. Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109 (1987). A. De Luca,
        W. Book, Robots with flexible elements, Springer Handbook of Robotics, 2nd ed. (2016), 11.1.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic(stiffness=[800, 600], rotor={"joint1": 0.2, "joint2": 0.1})
        >>> arm.motor_positions([0, 0], [0, 0], [0, 0]).round(6)
        array([0.036788, 0.01635 ])
        """
        from jounce.actuators.parameters import ElasticParameters, with_elasticity  # what few programs need

        stated = ElasticParameters(
            stiffness=stiffness, rotor=rotor, damping=damping, spring=spring, coupling=coupling, motors=motors,
            damping_terms=damping_terms,
        )  # fmt: skip
        return type(self)(with_elasticity(self.mechanism, stated))

    def closed(
        self,
        loops: "Sequence[Loop | Sequence[Any]] | None" = None,
        actuated: Sequence[str] | None = None,
        *,
        coordinates: Sequence[str] | None = None,
        start: Named | None = None,
        weights: Named | None = None,
    ) -> Self:
        """The robot with its loops closed, moved by its actuated joints.

        Constraints ``A q' = 0`` hold the coordinates q of the tree, which is this robot: ``q' = F u'`` with the rates
        u' of independent coordinates u. All methods of the closed robot take and return quantities of u, by the
        principle of virtual work: forces ``F^T Q``, mass matrix ``F^T M F``, Jacobians ``J F``. Their q is u, (..., n),
        from which the loops are closed by Newton's method, along a straight line from the start; or it has all
        coordinates of the tree, (..., N), from which the loops are closed without leaving the branch. Joints that
        follow by constant ratios, as in parallelograms, are set to their places: no position is singular for them.

        Parameters
        ----------
        loops : list of tuples, optional
            (frame_a, frame_b) of names of bodies, or of links merged into bodies, that a cut joint joins: a spherical
            one, so that the origins of both frames meet. (frame_a, frame_b, joint) and (frame_a, frame_b, joint, axis)
            name another: "spherical", "revolute", "prismatic", "cylindrical", "planar" or "fixed", and its axis in
            frame_a, [0, 0, 1] by default. By default the loops that the robot's file states.
        actuated : list of str, optional
            The joints with motors. By default those of a robot whose loops are closed already.
        coordinates : list of str, optional
            The independent coordinates, by default the actuated joints.
        start : (N,) or mapping, optional
            Joint positions, rad or m, near a configuration with closed loops: they decide on the branch. Joints that a
            mapping leaves out are at 0.
        weights : (k,) or mapping, optional
            Weights of the motors' forces, where more joints are actuated than there are coordinates: the weighted sum
            of their squares is least. 1 by default.

        Returns
        -------
        Robot
            With `n` independent coordinates; its `mechanism.tree` has its loops open.

        Raises
        ------
        JounceError
            If a name is unknown, the loops cannot be closed from the start, or the coordinates or motors do not
            determine the motion.
        UncertainError
            By methods of the closed robot, a kind of JounceError: if q is so close to a singular position that results
            have errors above 1e-6 of their size.

        References
        ----------
        A. Müller, S. Kumar: Closed form time derivatives of the equations of motion of rigid body systems, Multibody
        Syst. Dyn. 53 (2021), outlook. A. Müller, S. Kumar, T. Kordik, arXiv 2507.14274 (2025).

        Examples
        --------
        >>> import jounce
        >>> tree = jounce.Robot(jounce.load("fivebar").mechanism.tree)
        >>> robot = tree.closed([("left_tip", "right_tip")], ["left_shoulder", "right_shoulder"], start=[2, -1, 1, 1])
        >>> robot.n, tree.n
        (2, 4)
        """
        return type(self)(with_loops(self.mechanism, loops, actuated, coordinates, start, weights))

    @typed(overloads.OfPosition[Array])
    def coordinates(
        self,
        q: Named,
        qd: Named | None = None,
        q2d: Named | None = None,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The coordinates of all joints of a robot with closed loops, and their rates.

        ``qtd = F qd`` with the constraints ``A F = 0``.

        Parameters
        ----------
        q : (..., n) or (..., N)
            Independent coordinates, rad or m; or all N, near the wanted branch, from which the loops are closed.
        qd, q2d, *higher : (..., n), optional
            Rates of the independent coordinates, per s, per s^2, ..., each for one more time derivative.
        base : tuple, optional
            The motion of the base, see `Robot`; it has no effect here.
        method, out, threads : optional
            See `Robot`.

        Returns
        -------
        qt : (..., N), or tuple of (..., N)
            In the order of ``mechanism.tree.coordinates``. As q in later calls it saves closing the loops again.

        Raises
        ------
        JounceError
            If the robot has no closed loops, the loops cannot be closed at q, an array has a wrong shape, or a rate is
            skipped.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("fivebar")
        >>> qt, qtd = robot.coordinates([2.2, 0.9], [1.0, 0.0])
        >>> qt.shape
        (4,)
        """
        given = q, qd, q2d, *higher
        return compute(self, "coordinates", given, base=base, method=method, out=out, threads=threads)

    @typed(overloads.OfAcceleration)
    def actuator_forces(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The forces u of the actuated joints of a robot with closed loops, and their rates.

        ``F_u^T u = Q``, F_u the velocities of the actuated joints from those of the independent coordinates. With more
        motors than coordinates, the weighted sum of u^2 is least. If the coordinates are those of the motors, u = Q.

        Parameters
        ----------
        q : (..., n) or (..., N)
            Independent coordinates, rad or m; or all N of the tree.
        qd, q2d : (..., n)
            Velocities and accelerations, per s and per s^2.
        *higher : (..., n), optional
            Further rates, each for one more time derivative of u.
        wrench, base : optional
            As in `inverse_dynamics`.
        method, out, threads : optional
            See `Robot`.

        Returns
        -------
        u : (..., k), or tuple of (..., k)
            Of the k motors, in the order of `actuated` in `closed`: N m, or N for coordinates in m, per s, ...

        Raises
        ------
        JounceError
            If the robot has no closed loops, the loops cannot be closed at q, an array has a wrong shape, or a rate is
            skipped.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("fivebar")
        >>> robot.actuator_forces([2.2, 0.9], [0, 0], [0, 0]).shape
        (2,)
        """
        given = q, qd, q2d, *higher
        return compute(
            self, "actuator_forces", given, wrench=wrench, base=base, method=method, out=out, threads=threads
        )

    @typed(overloads.OfAcceleration)
    def loop_wrenches(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The wrenches that the cut joints of a robot with closed loops transmit, and their rates.

        ``W = R^T y`` with ``A_d^T y = Q_d``: the dependent joints of the tree need no motors. Where constraints are
        redundant, as those of planar loops, the shortest y is taken.

        Parameters
        ----------
        q : (..., n) or (..., N)
            Independent coordinates, rad or m; or all N of the tree.
        qd, q2d : (..., n)
            Velocities and accelerations, per s and per s^2.
        *higher : (..., n), optional
            Further rates, each for one more time derivative.
        wrench, base : optional
            As in `inverse_dynamics`.
        method, out, threads : optional
            See `Robot`.

        Returns
        -------
        W : (..., loops, 6), or tuple of them
            Moment and force of each cut joint on the body of its second frame, in the axes of its first frame, about
            the origin of that: N m and N, per s, ...

        Raises
        ------
        JounceError
            If the robot has no closed loops, the loops cannot be closed at q, an array has a wrong shape, or a rate is
            skipped.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("fivebar")
        >>> robot.loop_wrenches([2.2, 0.9], [0, 0], [0, 0]).shape
        (1, 6)
        """
        given = q, qd, q2d, *higher
        return compute(self, "loop_wrenches", given, wrench=wrench, base=base, method=method, out=out, threads=threads)

    @typed(overloads.OfMotorPositions)
    def motor_positions(
        self, q: Named, qd: Named, q2d: Named, q3d: Named | None = None, q4d: Named | None = None, *higher: Named,
        wrench: Rates | None = None, stiffness: Rates | None = None, base: Rates | None = None,
        method: Method | None = None, out: Out = None, threads: int = 1,
    ) -> Results:  # fmt: skip
        """The motor positions theta of a motion of the links behind elastic joints, and their rates.

        ``theta = q + Q / K``, seen from the links: rotor angles over gear ratios. See `elastic`.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations of the links: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of theta.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            As in `inverse_dynamics`, with as many rates as theta.
        stiffness : (..., k) or mapping, or a tuple of them, optional
            The stiffness S of the k joints with two motors, in their order or by name, with as many rates as theta.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        theta : (..., n), or tuple of (..., n)
            In rad or m, per s, ...

        Raises
        ------
        JounceError
            If the joints are rigid, an array has a wrong shape, a rate is skipped, or `wrench` has fewer rates than
            theta.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> theta, thetad = arm.motor_positions([0, 0], [1, 0], [0, 0], [0, 0])
        >>> theta.round(6), thetad.round(6)
        (array([0.036788, 0.01635 ]), array([1., 0.]))
        """
        return compute(
            self, "motor_positions", (q, qd, q2d, q3d, q4d, *higher),
            wrench=wrench, stiffness=stiffness, base=base, method=method, out=out, threads=threads,
        )  # fmt: skip

    @typed(overloads.OfSnap)
    def motor_torques(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, *higher: Named,
        wrench: Rates | None = None, stiffness: Rates | None = None, base: Rates | None = None,
        method: Method | None = None, out: Out = None, threads: int = 1,
    ) -> Results:  # fmt: skip
        """The motor torques tau of a motion of the links behind elastic joints, and their rates.

        ``tau = Q + B theta2d + F_m(thetad)`` with ``theta = q + Q / K``, which takes Q2d and thus q4d.

        Parameters
        ----------
        q, qd, q2d, q3d, q4d : (..., n)
            Coordinates of the links and their rates: rad or m, per s, ...
        *higher : (..., n), optional
            Further rates, each for one more time derivative of tau.
        wrench, stiffness : tuple, optional
            As in `motor_positions`, with two more rates than the torques: (W, Wd, W2d) for tau.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        tau : (..., n), or tuple of (..., n)
            In N m for revolute and N for prismatic coordinates, per s, ...

        Raises
        ------
        JounceError
            If the joints are rigid, an array has a wrong shape, a rate is skipped, or `wrench` has too few rates.

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
        return compute(
            self, "motor_torques", (q, qd, q2d, q3d, q4d, *higher),
            wrench=wrench, stiffness=stiffness, base=base, method=method, out=out, threads=threads,
        )  # fmt: skip

    @typed(overloads.OfSnap)
    def motor_currents(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, *higher: Named,
        wrench: Rates | None = None, stiffness: Rates | None = None, base: Rates | None = None,
        method: Method | None = None, out: Out = None, threads: int = 1,
    ) -> Results:  # fmt: skip
        """The currents i of the motors for a motion of the links behind elastic joints, and their rates.

        ``i = tau / (r k)`` with the gear ratio r and the torque constant k of each `Motor`.

        Parameters
        ----------
        q, qd, q2d, q3d, q4d, *higher, wrench, stiffness, base, method, out, threads : arrays and options
            As in `motor_torques`.

        Returns
        -------
        i : (..., n), or tuple of (..., n)
            In A, per s, ...; NaN for motors that state no torque constant.

        Raises
        ------
        JounceError
            As in `motor_torques`, or if no motor states its torque constant.

        Examples
        --------
        >>> import jounce
        >>> motor = jounce.Motor(gear=100, inertia=1e-5, constant=0.05, resistance=0.5)
        >>> arm = jounce.load("planar2r").elastic(800, motors=motor)
        >>> arm.motor_currents(*[[0, 0]] * 5)
        array([5.886, 1.962])
        """
        return compute(
            self, "motor_currents", (q, qd, q2d, q3d, q4d, *higher),
            wrench=wrench, stiffness=stiffness, base=base, method=method, out=out, threads=threads,
        )  # fmt: skip

    def motor_voltages(
        self, q: Named, qd: Named, q2d: Named, q3d: Named, q4d: Named, *higher: Named,
        wrench: Rates | None = None, stiffness: Rates | None = None, base: Rates | None = None,
        method: Method | None = None, out: Out = None, threads: int = 1,
    ) -> Results:  # fmt: skip
        """The voltages u of the motors for a motion of the links behind elastic joints, and their rates.

        ``u = R i + L di/dt + k r thetad`` takes the rate of tau and thus q5d, unless no motor has an inductance.

        Parameters
        ----------
        q, qd, q2d, q3d, q4d, *higher, wrench, stiffness, base, method, out, threads : arrays and options
            As in `motor_torques`, with the rates that taud takes where a motor has an inductance.

        Returns
        -------
        u : (..., n), or tuple of (..., n)
            In V, per s, ...; NaN for motors that state no torque constant or no resistance.

        Raises
        ------
        JounceError
            As in `motor_torques`, or if no motor states constant and resistance.

        Examples
        --------
        >>> import jounce
        >>> motor = jounce.Motor(gear=100, inertia=1e-5, constant=0.05, resistance=0.5, inductance=1e-3)
        >>> arm = jounce.load("planar2r").elastic(800, motors=motor)
        >>> arm.motor_voltages(*[[0, 0]] * 6)
        array([2.943, 0.981])
        """
        return compute(
            self, "motor_voltages", (q, qd, q2d, q3d, q4d, *higher),
            wrench=wrench, stiffness=stiffness, base=base, method=method, out=out, threads=threads,
        )  # fmt: skip

    def elastic_forward_dynamics(
        self, q: Named, qd: Named, theta: Named, thetad: Named, tau: Named, *, wrench: Rates | None = None,
        method: Method | None = None, out: Out = None, threads: int = 1,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The accelerations q2d of the links and theta2d of the motors behind elastic joints that motor torques cause.

        ``q2d = M^-1 (K (theta - q) - C qd - Qgrav - Qext)``, ``theta2d = (tau - F_m - K (theta - q)) / B``. At a rigid
        joint B is in M, and theta2d = q2d.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities of the links: rad or m, and per s.
        theta, thetad : (..., n)
            Positions and velocities of the motors; those of rigid joints have no effect.
        tau : (..., n)
            Motor torques: N m, or N for coordinates in m.
        wrench : (..., nb, 6) or dict, optional
            As in `inverse_dynamics`.
        method, out, threads : optional
            See `Robot`.

        Returns
        -------
        q2d, theta2d : (..., n)
            In rad/s^2 or m/s^2.

        Raises
        ------
        JounceError
            If the joints are rigid, an array has a wrong shape, a name is unknown, the base moves, or the mass matrix
            is singular.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> rest, theta = [0, 0], arm.motor_positions([0, 0], [0, 0], [0, 0])
        >>> q2d, theta2d = arm.elastic_forward_dynamics(rest, rest, theta, rest, [29.43 + 0.1, 9.81])
        >>> theta2d.round(9) + 0.0
        array([1., 0.])
        """
        given = (q, qd, theta, thetad, tau)
        return compute(self, "elastic_forward_dynamics", given, wrench=wrench, method=method, out=out, threads=threads)

    def feedback_linearization(
        self, q: Named, qd: Named, theta: Named, thetad: Named, q4d: Named, *, wrench: Rates | None = None,
        method: Method | None = None, out: Out = None, threads: int = 1,
    ) -> Array:  # fmt: skip
        """The motor torques tau that give the links a wanted snap q4d, from the measured state.

        q2d and q3d follow from the forces of the springs, ``Q = K (theta - q)`` and ``Qd = K (thetad - qd)``; tau is
        that of `motor_torques`. With ``q4d = q4d_ref + k3 (q3d_ref - q3d) + ...`` the tracking error obeys a linear
        equation of order four per coordinate.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities of the links: rad or m, and per s.
        theta, thetad : (..., n)
            Positions and velocities of the motors.
        q4d : (..., n)
            The wanted fourth time derivative of q.
        wrench : tuple of (..., nb, 6) or dict, optional
            (W, Wd, W2d), as in `inverse_dynamics`.
        method, out, threads : optional
            See `Robot`.

        Returns
        -------
        tau : (..., n)
            In N m, or N for coordinates in m.

        Raises
        ------
        JounceError
            If a joint is rigid, an array has a wrong shape, the base moves, or the mass matrix is singular.

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
        given = (q, qd, theta, thetad, q4d)
        return compute(self, "feedback_linearization", given, wrench=wrench, method=method, out=out, threads=threads)

    def motors_along(
        self,
        motion: "Motion",
        t: ArrayLike | None = None,
        order: int = 0,
        *,
        stiffness: Rates | None = None,
        method: Method | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> "ElasticAlong":
        """Positions and torques of the motors behind elastic joints along a motion, with the wrenches that it holds.

        Parameters
        ----------
        motion : Motion
            As for `forces_along`; tau takes q4d.
        t, method, progress : optional
            As in `forces_along`.
        order : int, optional
            The highest rate of the torques: 1 gives tau and taud.
        stiffness : (N, k) or mapping, or a tuple of them, optional
            The stiffness S of the k joints with two motors: constant, or a tuple (S, Sd, S2d, ...) at the times.

        Returns
        -------
        ElasticAlong
            Frozen: the times `t`, the `rates` q, qd, ..., the `positions` theta, thetad, theta2d, ... and the `torques`
            tau, ..., tuples of (N, m); `currents`, `voltages`; `deviations` and `breaks` of the torques.

        Raises
        ------
        JounceError
            If the joints are rigid, the motion has too few rates for the order or is not this robot's, a time is
            outside of it, or springs cannot carry a force or have a stiffness, with the joint, the time and the bound.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("iiwa14").elastic(1e4, rotor=0.4)
        >>> [tau] = arm.motors_along(jounce.load_motion("paper", arm)).torques
        >>> tau.shape
        (10000, 7)
        """
        from jounce.actuators.along import motors_along  # what few programs need

        return motors_along(self, motion, t, order, stiffness, method, progress)

    def elastic_energy(self, q: Named, qd: Named, theta: Named, thetad: Named) -> "Energy":
        """The energies of links, rotors and springs of a robot with elastic joints.

        Along a motion without wrenches, the rate of their sum is the power of the motors less what friction takes:
        ``thetad . (tau - F_m(thetad))``.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities of the links: rad or m, and per s.
        theta, thetad : (..., n)
            Positions and velocities of the motors; those of rigid joints have no effect.

        Returns
        -------
        Energy
            `kinetic` of the links, `rotors`, `potential` of gravity and of springs of the file that act, `springs`
            between motors and links, (...) each, in J; `total` is their sum.

        Raises
        ------
        JounceError
            If the joints are rigid, an array has a wrong shape, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> energy = arm.elastic_energy([0, 0], [0, 0], [0.1, 0], [1, 0])
        >>> energy.rotors.round(9), energy.springs.round(9)
        (np.float64(0.05), np.float64(4.0))
        """
        from jounce.actuators.energy import energy  # what few programs need

        return energy(self, (q, qd, theta, thetad))

    def damping_error(self, *rates: Named, wrench: Rates | None = None) -> Array:
        """An estimate of the error of motor positions that dampers leave at one instant: the last term of their series.

        Parameters
        ----------
        *rates : (..., n)
            q, qd, q2d, ..., as `motor_positions` takes them.
        wrench : optional
            See `motor_positions`.

        Returns
        -------
        error : (..., n)
            In rad or m; zero at joints without a damper.

        Raises
        ------
        JounceError
            If no joint has a damper, or the terms of the series do not fall.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1, damping=2.0, damping_terms=2)
        >>> arm.damping_error([0, 0], [1, 0], [0, 0], [0, 0]).round(9)
        array([0., 0.])
        """
        from jounce.actuators.energy import damping_error  # what few programs need

        return damping_error(self, rates, wrench)

    @typed(overloads.OfPosition[Array])
    def mass_matrix(
        self,
        q: Named,
        qd: Named | None = None,
        q2d: Named | None = None,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The generalized mass matrix M(q) = J^T M J and its rates Md, M2d, ... (CRBA with rates).

        The armature that acts is added, see `with_drives`.

        Parameters
        ----------
        q : (..., n)
            Coordinates, rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        M : (..., nv, nv), or tuple of (..., nv, nv)
            Symmetric; kg m^2 between revolute coordinates, kg m or kg where prismatic ones are.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        References
        ----------
        Müller & Kumar, (MC), (Mdot), (Mddot).

        Examples
        --------
        >>> import jounce
        >>> M, Md = jounce.load("planar2r").mass_matrix([0, 0], [0, 1])
        >>> M
        array([[5., 2.],
               [2., 1.]])
        """
        return compute(self, "mass_matrix", (q, qd, q2d, *higher), base=base, method=method, out=out, threads=threads)

    @typed(overloads.CoriolisMatrix)
    def coriolis_matrix(
        self,
        q: Named,
        qd: Named,
        q2d: Named | None = None,
        q3d: Named | None = None,
        *higher: Named,
        form: Form = "paper",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The Coriolis matrix C(q, qd) of the paper, or with ``form="skew"`` the one for passivity-based control.

        Both give the same forces C qd. For the skew form, (Cbar), ``Md - 2 C`` is skew-symmetric, and so are its rates;
        for the paper's, (Csys), only ``qd^T (Md - 2 C) qd = 0``.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        form : str, optional
            "paper" or "skew".
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        C : (..., nv, nv), or tuple of (..., nv, nv)

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        References
        ----------
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
        name = FORMS[one_of("form", form, FORMS, "coriolis_matrix")]
        return compute(self, name, (q, qd, q2d, q3d, *higher), base=base, method=method, out=out, threads=threads)

    @typed(overloads.OfPosition[Array])
    def gravity_forces(
        self,
        q: Named,
        qd: Named | None = None,
        q2d: Named | None = None,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The generalized gravity forces Qgrav(q) = dU/dq, with U the potential energy of gravity, and their rates.

        Parameters
        ----------
        q : (..., n)
            Coordinates, rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        Qgrav : (..., nv), or tuple of (..., nv)
            In N m for revolute and N for prismatic coordinates.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        References
        ----------
        Müller & Kumar, (eq_U), (Qgravdot).

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").gravity_forces([0, 0])
        array([29.43,  9.81])
        """
        return compute(
            self, "gravity_forces", (q, qd, q2d, *higher), base=base, method=method, out=out, threads=threads
        )

    @typed(overloads.DriveForces)
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
        """The joint forces of the drive-train terms, and their rates, whether or not they act in Q.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        terms : bool, str or iterable of str, optional
            Some of "armature", "damping", "friction", "spring", see `with_drives`; True selects all.
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
        return drive_forces(self.mechanism, (q, qd, q2d, q3d, q4d, *higher), select_terms(terms), out)

    @typed(overloads.PosesOfBodies)
    def poses(
        self,
        q: Named,
        qd: Named | None = None,
        q2d: Named | None = None,
        *higher: Named,
        body: str | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The poses H(q) of the body frames in the inertial frame, and their rates.

        ``H = [[R, r], [0, 1]]`` maps body coordinates to inertial ones; ``Hd = H wedge(V)``, V the body-fixed twist.

        Parameters
        ----------
        q : (..., n)
            Coordinates, rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        body : str, optional
            A body or a link merged into one; all bodies by default.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        H : (..., nb, 4, 4), or (..., 4, 4) of one body; with rates a tuple of them

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
        return compute(
            self, "poses", (q, qd, q2d, *higher), body=body, base=base, method=method, out=out, threads=threads
        )

    @typed(overloads.TwistsOfBodies)
    def twists(
        self,
        q: Named,
        qd: Named,
        q2d: Named | None = None,
        q3d: Named | None = None,
        *higher: Named,
        body: str | None = None,
        frame: Frame = "body",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The twists V = J qd of the bodies, (angular; linear), and their rates.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
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
            In rad/s and m/s; rates are the derivatives of the components in the frame.

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
        return compute(
            self,
            "twists",
            (q, qd, q2d, q3d, *higher),
            body=body,
            frame=frame,
            base=base,
            method=method,
            out=out,
            threads=threads,
        )

    @typed(overloads.JacobiansOfBodies)
    def jacobian(
        self,
        q: Named,
        qd: Named | None = None,
        q2d: Named | None = None,
        *higher: Named,
        body: str | None = None,
        frame: Frame = "body",
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The Jacobian J(q) of bodies, V = J qd, and its rates.

        Parameters
        ----------
        q : (..., n)
            Coordinates, rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
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
        return compute(
            self,
            "jacobian",
            (q, qd, q2d, *higher),
            body=body,
            frame=frame,
            base=base,
            method=method,
            out=out,
            threads=threads,
        )

    @typed(overloads.OfVelocity[Array])
    def momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named | None = None,
        q3d: Named | None = None,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The spatial momentum h = (angular; linear) of the robot and its rates.

        ``h = U^T M V``: the momenta M_i V_i of the bodies about the inertial origin, in inertial axes, summed up.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        h : (..., 6), or tuple of (..., 6)
            In kg m^2/s and kg m/s.

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
        return compute(self, "momentum", (q, qd, q2d, q3d, *higher), base=base, method=method, out=out, threads=threads)

    @typed(overloads.OfVelocity[Array])
    def centroidal_momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named | None = None,
        q3d: Named | None = None,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The momentum hG = (angular; linear) of the robot about its centre of mass, and its rates.

        ``hG = (k - c x l; l)`` in inertial axes, with the momentum h = (k; l) and the centre of mass c. Its rate
        is the sum of the weight and of all wrenches on the robot, about the centre of mass.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        hG : (..., 6), or tuple of (..., 6)
            In kg m^2/s and kg m/s.

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
        rates = (q, qd, q2d, q3d, *higher)
        return compute(self, "centroidal_momentum", rates, base=base, method=method, out=out, threads=threads)

    @typed(overloads.OfPosition[Array])
    def centroidal_momentum_matrix(
        self,
        q: Named,
        qd: Named | None = None,
        q2d: Named | None = None,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The centroidal momentum matrix AG and its rates: hG = AG qd.

        If the robot floats, AG has nv = 6 + n columns, those of the twist of its base first; AG' = `AGd` gives the bias
        ``hGd - AG nud = AGd nu``. For a robot whose ground moves, the momentum of that motion is not part of AG qd.

        Parameters
        ----------
        q : (..., n)
            Coordinates, rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        AG : (..., 6, nv), or tuple of (..., 6, nv)
            In kg m^2, kg m or kg.

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
        rates = (q, qd, q2d, *higher)
        return compute(self, "centroidal_momentum_matrix", rates, base=base, method=method, out=out, threads=threads)

    @typed(overloads.OfPosition[Array])
    def center_of_mass(
        self,
        q: Named,
        qd: Named | None = None,
        q2d: Named | None = None,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The centre of mass c of the robot in the inertial frame, and its velocity, acceleration, ...

        ``c = sum of m_i c_i / sum of m_i`` over the bodies that move; links fixed to the ground are not among them.

        Parameters
        ----------
        q : (..., n)
            Coordinates, rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        c : (..., 3), or tuple of (..., 3)
            In m, m/s, ...

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
        rates = (q, qd, q2d, *higher)
        return compute(self, "center_of_mass", rates, base=base, method=method, out=out, threads=threads)

    @typed(overloads.OfVelocity[Array])
    def generalized_momentum(
        self,
        q: Named,
        qd: Named,
        q2d: Named | None = None,
        q3d: Named | None = None,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The generalized momentum p = M qd and its rates; the armature that acts is included.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        p : (..., nv), or tuple of (..., nv)
            In N m s for revolute and N s for prismatic coordinates.

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
        return compute(
            self, "generalized_momentum", (q, qd, q2d, q3d, *higher), base=base, method=method, out=out, threads=threads
        )

    @typed(overloads.OfVelocity[Any])
    def kinetic_energy(
        self,
        q: Named,
        qd: Named,
        q2d: Named | None = None,
        q3d: Named | None = None,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The kinetic energy T = 1/2 qd . M qd and its rates; the armature that acts is included.

        Parameters
        ----------
        q, qd : (..., n)
            Coordinates and velocities: rad or m, per s.
        q2d, q3d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        T : (...), or tuple of (...)
            In J.

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
        rates = (q, qd, q2d, q3d, *higher)
        return compute(self, "kinetic_energy", rates, base=base, method=method, out=out, threads=threads)

    @typed(overloads.OfPosition[Any])
    def potential_energy(
        self,
        q: Named,
        qd: Named | None = None,
        q2d: Named | None = None,
        *higher: Named,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The potential energy U(q) of gravity, and of the springs that act, and its rates: Ud = qd . dU/dq, ...

        ``U = -sum m_i g . c_i``, zero for masses at the inertial origin; springs are slack at their rest position.

        Parameters
        ----------
        q : (..., n)
            Coordinates, rad or m.
        qd, q2d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        U : (...), or tuple of (...)
            In J.

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
        return compute(
            self, "potential_energy", (q, qd, q2d, *higher), base=base, method=method, out=out, threads=threads
        )

    @typed(overloads.OfAcceleration)
    def base_wrench(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named | None = None,
        q4d: Named | None = None,
        *higher: Named,
        wrench: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The reaction wrench of the ground on the robot, F = (moment; force), and its rates.

        ``F = hd + U^T M U G + U^T W``: the rate of the momentum, minus gravity and minus the loads -W, about the
        inertial origin in inertial axes. A mechanism is dynamically balanced if F is constant.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative.
        wrench : optional
            As in `inverse_dynamics`.
        base, method, out, threads : optional
            See `Robot`.

        Returns
        -------
        F : (..., 6), or tuple of (..., 6)
            In N m and N.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("planar2r").base_wrench([0, 0], [0, 0], [0, 0])[[2, 4]].round(6)
        array([29.43, 19.62])
        """
        return compute(
            self,
            "base_wrench",
            (q, qd, q2d, q3d, q4d, *higher),
            wrench=wrench,
            base=base,
            method=method,
            out=out,
            threads=threads,
        )

    @typed(overloads.WrenchOfLoad)
    def wrench(
        self,
        q: Named,
        qd: Named | None = None,
        q2d: Named | None = None,
        *higher: Named,
        body: str,
        force: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        frame: LoadFrame = "world",
        point: ArrayLike | None = None,
        base: Rates | None = None,
    ) -> Results:
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
        return wrench_of_load(self.mechanism, (q, qd, q2d, *higher), base, body, force, torque, frame, point)
