"""Robot: the class that users hold. Every method is one call."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import TYPE_CHECKING, Any, Self

from jounce.arguments import loops as loop_arguments
from jounce.arguments.contacts import with_contacts
from jounce.arguments.joint_data import with_limits
from jounce.core.cures import option_value
from jounce.core.display import HtmlDisplay
from jounce.core.equality import are_equal
from jounce.core.errors import JounceError, door, join_names
from jounce.core.typing import (
    Array,
    ArrayLike,
    Base,
    Convention,
    Coupling,
    DriveTerms,
    JointType,
    Library,
    LimitValues,
    Method,
    Named,
    Rates,
    Results,
)
from jounce.model import body_parameters, coordinates, positions, screws
from jounce.model.drive_trains import Drives, select_terms, warn_of_idle, with_eps
from jounce.model.limits import Limits
from jounce.model.mechanism import GRAVITY, structure_key
from jounce.robot.applications import Applications
from jounce.robot.available import list_available
from jounce.robot.methods import Methods
from jounce.robot.quantity_methods import QuantityMethods

if TYPE_CHECKING:
    from jounce.actuators.motors import ElasticAlong, Energy
    from jounce.checks.audit import Finding
    from jounce.dynamics.base_parameters import BaseParameters
    from jounce.engine.along import Along
    from jounce.io.models.states import RobotState
    from jounce.limits.explanation import Explanation
    from jounce.limits.retime import Retiming
    from jounce.limits.slowdown import Slowdown
    from jounce.limits.verdicts import Check
    from jounce.model.contacts import Contact
    from jounce.model.elasticity import Elasticity, Motor, SpringLaw
    from jounce.model.loops import Loop
    from jounce.motion import Motion


@door
@dataclass(frozen=True, eq=False, repr=False)
class Robot(Applications, Methods, QuantityMethods, HtmlDisplay):
    """A robot: its mechanism, and the quantities of its equations of motion along a motion.

    `jounce.load` makes one from a file, the constructors `Robot.from_...` from numbers or from other libraries' models.

    Conventions of every method:

    * SI units. Twists, screws and wrenches are (angular; linear).
    * Leading axes are batch axes and broadcast; the coordinate axis is last. Scalars are real and of any type: float
      arrays of NumPy, arrays of JAX, or object arrays of CasADi SX, SymPy or other symbols.
    * A state may name its coordinates: a dict, a data frame or series, or a structured array is matched by joint name.
      Results are always arrays, in the order of `joint_names`.
    * Balls, planar and free joints have velocities of their own, twists in the axes of the body. q has more numbers
      than its rates: for a ball a quaternion (x, y, z, w), for a free joint place and quaternion, for a planar joint
      place, cosine and sine. By joint name they are these numbers, a rotation matrix or a pose.
    * q is required; each further rate you give returns one more time derivative, up to order 100. With none to spare
      the result is a plain array, otherwise a tuple: the quantity, its rate, ...
    * ``base=(C, V, Vd, ...)`` is the motion of the base: its pose C (..., 4, 4), base to inertial frame, its twist V
      (..., 6) in its own axes about its origin, and the rates of these components, as many terms as q has. Robots that
      float require it: their forces, matrices and Jacobians have nv = 6 + n rows or columns, those of the base first,
      Q the wrench (moment; force) that acts on it, in its axes. Without base=, q may have all nq numbers, place and
      quaternion of the base first, and its rates nv. For other robots nv = n, and the base is the ground, at rest
      unless given. Where it does not enter, as in the mass matrix, it may be left out.
    * Missing values (masked by NumPy, or NA of pandas) are NaN, and so are results that depend on them.
    * ``method`` selects the method: "kernel" is native code, the default for NumPy arrays of float64, and for arrays of
      JAX on the CPU, if it is available; "recursion" is the default otherwise; "closed_form" and "paper" are
      independent checks. All agree. The first call compiles native code, which is kept on disk for later processes.
    * ``out`` is the NumPy array, or tuple of arrays, to write the results into; ``threads`` is the number of threads
      among which native code splits a batch.

    Where joints are elastic, all quantities are those of the links, as of other robots: Q is what the springs carry.
    Torques and positions of the motors are `motor_torques`, `motor_positions`, ...

    Robots are equal if all their data are equal: names, tree and numbers.

    Errors: every method raises `JounceError` for a wrong shape or type, a number that is not finite or out of range, a
    skipped rate, a wrench with fewer rates than the result takes, an unknown name, or an invalid `out`. Sections
    `Raises` state what else a method refuses.

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
        return are_equal(self.mechanism, other.mechanism) if isinstance(other, Robot) else NotImplemented

    def __hash__(self) -> int:
        return hash(structure_key(self.mechanism))

    def __dir__(self) -> list[str]:
        return list_available(self.mechanism, super().__dir__())

    def __repr__(self) -> str:
        floats = ", floating" if self.mechanism.floats else ""
        springs = ", elastic joints" if self.mechanism.elasticity else ""
        q = f", q of {positions.count(self.mechanism)} numbers" if positions.multiscrew_joints(self.mechanism) else ""
        return f"<Robot {self.name!r}: {self.n} coordinates{q}, {len(self.body_names)} bodies{floats}{springs}>"

    @property
    def gravity(self) -> Array:
        """The gravitational acceleration in the inertial frame, m/s^2."""
        return self.mechanism.gravity

    @property
    def limits(self) -> Limits:
        """The limits of the nc joint variables and of their forces.

        They are in SI units, see `Limits`; `with_limits` sets them.

        A limit that is not stated is infinite. Limits do not enter Q.
        """
        return self.mechanism.limits

    @property
    def drives(self) -> Drives:
        """The drive trains with their parameters, (nc,) each.

        Parameters are `armature`, `damping`, `friction`, ..., see `Drives`.

        They are those of the nc joint variables, in SI units. They enter Q where `with_drives` or
        ``load(..., drives=True)`` selects them.
        """
        return self.mechanism.drives

    @property
    def elasticity(self) -> "Elasticity | None":
        """The springs and motors of elastic joints, one per coordinate.

        Parameters are `stiffness`, `rotor`, ..., see `Elasticity`.

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
        owners: Sequence[int] | None = None,
        G: ArrayLike | None = None,
        g: ArrayLike | None = None,
        limits: Limits | Mapping[str, ArrayLike] | None = None,
        drives: Drives | Mapping[str, ArrayLike] | None = None,
        base: ArrayLike | None = None,
        base_name: str = "base",
        name: str = "robot",
    ) -> Self:
        """Make a robot from body-fixed data.

        Body i moves relative to its parent p by ``C_i = C_p B_i exp(X_i theta_i)`` with joint variables
        ``theta = G q + g``. A joint may have several screws: a ball the turns about three axes through a point, a
        planar joint the turn about a normal and the slides along two axes across it, a free joint the turns and slides
        along three axes. It moves by H with ``H' = H wedge(X nu)``; q has its position as numbers, see `nq`.

        Parameters
        ----------
        B : (nb, 4, 4)
            Pose of body i in the frame of its parent body at theta_i = 0.
        X : (nc, 6)
            Joint screws in the body frames, (xi; eta), one per body without `owners`: revolute (e; x cross e), helical
            of pitch h (e; x cross e + h e), prismatic (0; e), with a unit vector e and a point x on the axis.
        M : (nb, 6, 6)
            Inertia matrix in the frame of body i, see `inertia_matrix`.
        parent : (nb,), optional
            Index of the parent body, below i; -1 is the ground, or the base if the robot floats. By default a serial
            chain.
        names : (nb,), optional
            Names of the bodies.
        gravity : (3,), optional
            Gravitational acceleration in the inertial frame, m/s^2.
        joint_names : (n,), optional
            Names of the coordinates. With `G` the joints are joint1, joint2, ...: a coordinate of one of these names
            has the limits of this joint, and must move it.
        owners : (nc,), optional
            Index of the body that each screw moves, in order: three times that of a body on a ball.
        G, g : (nc, n) and (nc,), optional
            Constants of joints that follow others; theta = q by default.
        limits : mapping, optional
            `lower`, `upper`, `velocity`, `effort`, ... of theta, (nc,), or (nc, 2) for two sides; infinite if left out.
        drives : mapping, optional
            Those of `Drives`, of theta, (nc,) each: `armature`, `damping`, `friction`, ...; default 0, eps 0.05,
            `stribeck_velocity` and `load_eps` 0.1.
        base : (6, 6), optional
            Inertia matrix of the base in its own frame, if the robot floats; otherwise the robot stands on the ground.
        base_name : str, optional
            Name of the base.
        name : str, optional
            Name of the robot.

        Returns
        -------
        Robot

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

        And on a ball, whose position is a quaternion (x, y, z, w):

        >>> ball = jounce.Robot.from_screws([np.eye(4)], np.eye(6)[:3], [M], owners=[0, 0, 0])
        >>> ball.nq, ball.gravity_forces([0, np.sin(np.pi / 4), 0, np.cos(np.pi / 4)]).round(6) + 0.0
        (4, array([0.  , 9.81, 0.  ]))
        """
        options = screws.ScrewOptions(
            names=names, gravity=gravity, joint_names=joint_names, owners=owners, G=G, g=g, limits=limits,
            drives=drives, base=base, base_name=base_name, name=name,
        )  # fmt: skip
        return cls(coordinates.check_coordinate_names(screws.from_screws(B, X, M, parent, options)))

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
        """Make a robot from spatial data.

        All data are in the inertial frame at theta = 0.

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

        Examples
        --------
        >>> import numpy as np, jounce
        >>> M = jounce.inertia_matrix(1.0, [0.1, 0, 0], 0.01 * np.eye(3))
        >>> robot = jounce.Robot.from_spatial_screws([np.eye(4)], [[0, 0, 0, 0, 0, 1]], [M])  # a vertical slide
        >>> robot.inverse_dynamics([0.3], [0.0], [1.0])
        array([10.81])
        """
        options = screws.ScrewOptions(
            names=names, gravity=gravity, joint_names=joint_names, G=G, g=g, limits=limits, drives=drives, base=base,
            base_name=base_name, name=name,
        )  # fmt: skip
        return cls(coordinates.check_coordinate_names(screws.from_spatial_screws(A, Y, M, parent, options)))

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
        """Make a serial robot from a Denavit-Hartenberg table.

        "standard": ``T_i = Rot_z(theta_i) Trans_z(d_i) Trans_x(a_i) Rot_x(alpha_i)``; frame i is at the end of link i,
        the axis of joint i is z of frame i - 1.

        "modified" (Craig's): ``T_i = Rot_x(alpha_i) Trans_x(a_i) Rot_z(theta_i) Trans_z(d_i)``; frame i is on the axis
        of joint i, its z axis; row i holds what Craig calls a_{i-1}, alpha_{i-1}, d_i, theta_i.

        The joint variable is added to theta_i, of a prismatic joint to d_i. **Body i has frame i**: inertias, wrenches
        and poses are those of this frame, which differs between the conventions.

        Parameters
        ----------
        table : (n, 4), or n mappings
            Rows **a, alpha, d, theta**, in this order, which is not that of every book; in m and rad. Or mappings,
            ``{"theta": 0, "d": 0.1, "a": 0, "alpha": 1.2}``, with ``"type": "prismatic"`` for a prismatic joint.
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
        rows = screws.DhTable(table, convention, types=types, degrees=degrees, base=base, tool=tool)
        options = screws.ScrewOptions(
            names=names, gravity=gravity, joint_names=joint_names, G=G, g=g, limits=limits, drives=drives, name=name
        )
        return cls(coordinates.check_coordinate_names(screws.from_dh(rows, M, options)))

    @classmethod
    def from_pinocchio(
        cls, model: Any, *, gravity: ArrayLike | None = None, base: Base | None = None, root: str | None = None
    ) -> Self:
        """Make a robot from a Pinocchio model, with the same names.

        Its Q is that of ``pinocchio.rnea(model, data, q, v, a)``.

        Coordinates have the order of Pinocchio's v and the names of its joints; mimic joints follow their leader. But:
        a joint without bounds has its angle in q, not a cosine and a sine; composite, universal, translation and
        sphericalZYX joints are chains, ``NAME_1``, ``NAME_2``, ...; spherical, planar and free-flyer joints are balls,
        planar and free joints, with Pinocchio's numbers in q; bodies are in the order of joints depth first,
        Pinocchio's own for a URDF. Armature (where it is 0, the rotor's inertia times the gear ratio squared), damping
        and friction become drives, see `with_drives`: Pinocchio's rnea always includes armature and never the others.
        Bodies, operational frames and sensors may be named wherever a body may.

        Parameters
        ----------
        model : pinocchio.Model
            A model of numbers.
        gravity : (3,), optional
            Gravitational acceleration, m/s^2; that of the model by default.
        base : str, optional
            "floating": the body that the free-flyer moves is the base, and floats. "fixed" welds free-flyers on the
            ground at zero, with a `JounceWarning`. By default a free-flyer that carries all other joints is refused.
        root : str, optional
            A body or frame that becomes the base, fixed or floating: only the bodies that it carries are kept.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If it is no model of Pinocchio, has a free joint, no joint moves, or a number is not finite.

        Examples
        --------
        >>> import jounce, pinocchio
        >>> model = pinocchio.buildSampleModelManipulator()
        >>> robot = jounce.Robot.from_pinocchio(model)
        >>> robot.joint_names == tuple(model.names)[1:]
        True
        """
        from jounce.io.models import pinocchio  # imported here to keep start-up fast

        return cls(pinocchio.mechanism(model, gravity, base, root))

    @classmethod
    def from_mujoco(
        cls, model: Any, *, gravity: ArrayLike | None = None, base: Base | None = None, root: str | None = None
    ) -> Self:
        """Make a robot from a MuJoCo model in memory.

        `jounce.load` makes one from an MJCF file.

        Coordinates are MuJoCo's joint variables (rad, m), in its order; joints that an active equality constraint ties
        to another follow it exactly, by a ratio or a polynomial, and are not coordinates. Loops of the model are closed
        by its motors; what these leave loose is passive. Fixed tendons are rotors that follow, with their drive trains;
        motors on them move one joint, or several together, see `with_transmission`. Bodies without a joint merge into
        those that carry them, named sites become merged links. If a body has several joints, all but the last move
        massless links, named BODY:JOINT. Features that the model's flags disable are ignored.

        Parameters
        ----------
        model : mujoco.MjModel
            The model; it is read, not kept.
        gravity : (3,), optional
            Gravitational acceleration, m/s^2; that of the model by default.
        base, root : str, optional
            ``base="floating"``: the body on the free joint is the base, and floats; ``base="fixed"`` welds free joints
            at the model's placement. `root` names a body that becomes the base, floating or fixed to the ground. Balls
            and other free joints have MuJoCo's numbers in q, but for the order x, y, z, w of quaternions.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If it is no model of MuJoCo, needs `base` or `root`, no joint moves, or a number is not finite.

        Warns
        -----
        JounceWarning
            For terms of MuJoCo's inverse dynamics that jounce ignores: other equality constraints, spatial tendons,
            gravity compensation, nonlinear springs and dampers, fluids; and for welded joints.

        Examples
        --------
        >>> import jounce, mujoco
        >>> body = "<body name='arm'><joint name='tilt' axis='0 1 0'/><geom size='0.1' pos='0 0 1'/></body>"
        >>> model = mujoco.MjModel.from_xml_string(f"<mujoco model='m'><worldbody>{body}</worldbody></mujoco>")
        >>> jounce.Robot.from_mujoco(model)
        <Robot 'm': 1 coordinates, 1 bodies>
        """
        from jounce.io.models import mujoco  # imported here to keep start-up fast

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
        """Convert vectors of Pinocchio or MuJoCo to a state.

        The result is the state of the robot, and its forces; joints are matched by name.

        A base that floats has a pose C, a twist V and its rate Vd from its joint. Of the vectors of this joint,
        Pinocchio has the quaternion as (x, y, z, w) and the velocity as (linear; angular) in the axes of the body:
        ``V = (v[3:6]; v[:3])``, ``Vd = (a[3:6]; a[:3])``. MuJoCo has the quaternion as (w, x, y, z), and the linear
        velocity and force in world axes: with the rotation R of the base, ``V = (v[3:6]; R^T v[:3])`` and
        ``Vd = (a[3:6]; R^T a[:3] - v[3:6] x R^T v[:3])``. Free joints behind the base are converted alike; balls and
        planar joints have the same numbers in another order. Joints that turn freely have a cosine and a sine in
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
            The model whose vectors they are, in its order; joints that move none of the robot's bodies are ignored.

        Returns
        -------
        RobotState
            For ``robot.inverse_dynamics(*state.rates, base=state.base)``. Its Q are the forces, if given: the wrench
            (moment; force) on a floating base first, in its axes; forces of joints that follow others are added to
            these.

        Raises
        ------
        JounceError
            If a shape is wrong, a quaternion is not of unit norm, the model lacks a joint of the robot, or has another,
            such as a locked one, that moves its bodies, or a joint is not where those that it follows place it, within
            0.01.

        Examples
        --------
        >>> import jounce, pinocchio
        >>> model = pinocchio.buildSampleModelHumanoid()
        >>> robot = jounce.Robot.from_pinocchio(model, base="floating")
        >>> state = robot.state_from("pinocchio", pinocchio.neutral(model), model=model)
        >>> state.q.shape, state.base[0].shape
        ((28,), (4, 4))
        """
        from jounce.io.models import states  # imported here to keep start-up fast

        return states.state_from(self.mechanism, states.read_model_layout(library, model), (q, v, a), forces)

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
        """Convert a state to vectors of Pinocchio or MuJoCo.

        It is the inverse of `state_from`, and converts forces too.

        Parameters
        ----------
        library : {"pinocchio", "mujoco"}
            Whose vectors they become.
        q, qd, q2d : (..., n), optional
            Coordinates, velocities and accelerations; q has nq numbers.
        Q : (..., nv), optional
            Generalized forces, the wrench on the base first if the robot floats.
        base : tuple, optional
            C, V, Vd of the base of a robot that floats, as many as there are of q, qd and q2d. Forces of MuJoCo alone
            need C, or q with free joints, those of Pinocchio none.
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
            If a shape is wrong, the pose is missing or invalid, or the model's joints are not those of the robot.

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
        from jounce.io.models import states  # imported here to keep start-up fast

        vectors = states.state_to(self.mechanism, states.read_model_layout(library, model), (q, qd, q2d), base, Q)
        return vectors[0] if len(vectors) == 1 else vectors

    def with_drives(self, terms: DriveTerms = True, eps: float | None = None) -> Self:
        """Return the robot with the selected drive terms in its forces.

        Terms are damping, friction and others.

        ``Q_theta = armature theta'' + damping theta' + (friction + stribeck exp(-(theta' / stribeck_velocity)^2))
        tanh(theta' / eps) + stiffness (theta - rest) + offset`` of the joint variables theta = G q + g; Q gains
        ``G^T Q_theta`` and M ``G^T diag(armature) G``, with exact rates. Of this Q, `load_friction` adds a share:
        ``load_friction tanh(theta' / eps) (Q^2 + load_eps^2)^1/2``.

        Parameters
        ----------
        terms : bool, str or iterable of str, optional
            "armature", "damping", "friction", "stribeck", "spring", "offset", "load_friction"; True: all, False: none.
        eps : float, optional
            Smoothing velocity of Coulomb friction, rad/s or m/s; by default that of each joint.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If a term is unknown, `eps` is not positive, or a term of the motors is selected where joints are elastic.

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
        # Springs and offsets act between links; all other terms belong to the motors.
        motor_terms = set(select_terms(terms)) - {"spring", "offset"}
        if self.mechanism.elasticity is not None and len(motor_terms) > 0:
            raise JounceError(
                f"{self.name} has elastic joints: {join_names(sorted(motor_terms))} would act on the links, not on the"
                " motors; select drive terms before elastic()"
            )
        if "spring" in select_terms(terms):
            positions.check_single_screws(self.mechanism, "springs of drives", self.drives.stiffness)
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
        total_power: float | Sequence[float] | None = None,
        total_electrical_power: float | Sequence[float] | None = None,
        of: str | Mapping[str, str] | None = None,
    ) -> Self:
        """Return the robot with some of its limits replaced.

        There are limits of q to q4d, of Q, Qd, Q2d, of the power qd Q, of motors, and of the whole robot.

        They come from a file, from the published table of an arm, or as numbers, which win: one for all coordinates, an
        array (n,), or a mapping {joint: number}. Except for `lower` and `upper` of the position, (lower, upper) in
        place of a number, (n, 2) of (n,), gives a limit two sides, and so do the (2, nb) of `Limits.bounds`. Infinity
        takes a limit away. What is left out stays.
        Closed loops: forces and power are limited at the motors, in the order of `actuator_forces` if these are not at
        the coordinates.

        Parameters
        ----------
        source : str, path or Limits, optional
            A YAML or JSON file of limits, MoveIt's joint_limits.yaml among them; the name of an arm whose limits are
            published: "panda", "fr3", "ur3e", "ur5", "ur5e", "ur10e", "iiwa7", "iiwa14", "xarm6", "xarm7", for joints
            with its names behind any prefix; or the limits of a robot with the same joints.
        lower, upper, velocity, acceleration, jerk, snap : number, array or mapping, optional
            Bounds of q, qd, q2d, q3d, q4d: rad or m, per s, ... Positions of a ball "b" are bounded by `upper` of
            "b.swing", a cone about the z axis of its frame, and of "b.angle", that of the whole turn, and by `lower`
            and `upper` of its twist about z, "b.twist"; free joints have x, y and z too, and planar ones x, y, angle.
        effort, effort_rate, second_effort_rate : number, array or mapping, optional
            Bounds of Q, Qd, Q2d: N m or N, per s, per s^2.
        power : number, array or mapping, optional
            Bound of qd Q, W.
        stall_effort, no_load_velocity : number, array or mapping, optional
            Q that falls with speed, as drives have it: Q / stall_effort + qd / no_load_velocity <= 1 in either
            direction, where a line of the data sheet ends at rest, N m or N, and without load, rad/s or m/s.
        motor_position, motor_velocity, motor_torque : number, array or mapping, optional
            Bounds of theta, thetad, tau of motors of elastic joints, seen from the links: rad or m, per s, N m or N.
        motor_current, motor_voltage : number, array or mapping, optional
            Bounds of the currents and voltages of these motors, A and V.
        total_power : number or (lower, upper), optional
            Bound of the mechanical power that all motors deliver together, W: the sum of qd Q, with the drive terms
            that act in Q and without what a floating base takes; in closed loops and of coupled drives that of the
            motors. Behind elastic joints it is the sum of thetad tau, which rotors and their friction are part of.
            What one motor takes back another one may use: braking joints count as negative.
        total_electrical_power : number or (lower, upper), optional
            Bound of the electrical power of all motors of elastic joints, W: the sum of current times voltage, with the
            losses of windings. Every motor states its constant and its resistance.
        of : str or mapping, optional
            Which force the effort limits given here bound, with its rates: "Q", the default, or "Q - Qgrav"; a mapping
            selects some.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If a joint, kind or arm is unknown, a file cannot be read, a lower limit is above the upper one, a number is
            negative, or a force is limited at a joint of a closed robot without a motor.

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
        bounds = {
            "lower": lower, "upper": upper, "velocity": velocity, "acceleration": acceleration, "jerk": jerk,
            "snap": snap, "effort": effort, "effort_rate": effort_rate, "second_effort_rate": second_effort_rate,
            "power": power, "stall_effort": stall_effort, "no_load_velocity": no_load_velocity,
            "motor_position": motor_position, "motor_velocity": motor_velocity, "motor_torque": motor_torque,
            "motor_current": motor_current, "motor_voltage": motor_voltage,
            "total_power": total_power, "total_electrical_power": total_electrical_power,
        }  # fmt: skip
        from jounce.io.limit_files import limits_from  # imported here to keep start-up fast

        mechanism = self.mechanism
        if source is not None:
            mechanism = replace(mechanism, limits=limits_from(mechanism, source))
        return type(self)(with_limits(mechanism, bounds, of))

    @property
    def inertial_parameters(self) -> Array:
        """The inertial parameters of all bodies, (10 nb,).

        Q is linear in them: Q = `regressor` @ them.

        Per body, in the order of `body_names`: m, mcx, mcy, mcz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz, with the first moment
        m c and the inertia tensor I about the origin of the body frame, in its axes, as Pinocchio has them; kg, kg m,
        kg m^2.
        """
        return body_parameters.inertial_parameters(self.mechanism)

    def with_inertial_parameters(self, p: ArrayLike) -> Self:
        """Return the robot with other inertial parameters, such as identified ones.

        Parameters
        ----------
        p : (10 nb,)
            As `inertial_parameters`. Any finite numbers are taken: `audit` finds what no distribution of mass has.

        Returns
        -------
        Robot

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r")
        >>> robot.with_inertial_parameters(2 * robot.inertial_parameters).gravity_forces([0, 0])
        array([58.86, 19.62])
        """
        return type(self)(body_parameters.with_inertial_parameters(self.mechanism, p))

    def base_parameters(self) -> "BaseParameters":
        """The base inertial parameters.

        They are the fewest combinations of `inertial_parameters` that determine Q.

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
        from jounce.dynamics.base_parameters import base_parameters  # imported here to keep start-up fast

        return base_parameters(self.mechanism)

    def locked(self, values: Mapping[str, Any]) -> Self:
        """Return the robot with some joints locked.

        The bodies of locked joints merge into the bodies that carry them.

        The loops of a closed robot stay closed: joints that follow the locked ones move to where these hold them.

        Parameters
        ----------
        values : mapping
            {joint: rad or m}. Of a closed robot, independent coordinates. Balls, planar and free joints at their
            numbers in q.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If a joint is unknown or follows another, a value is not finite, no joint remains, or loops do not close.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("iiwa14").locked({"joint3": 0.0, "joint7": 0.5}).n
        5
        """
        return type(self)(loop_arguments.with_locked(self.mechanism, values))

    def audit(self) -> "tuple[Finding, ...]":
        """Check the model data for physically impossible or suspicious values.

        It finds inertias that are not positive semidefinite or break the triangle inequality, placeholders, massless
        bodies, a singular mass matrix, values off by powers of 1000, missing effort and velocity limits, odd gravity.

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
        from jounce.checks.audit import audit  # imported here to keep start-up fast

        return audit(self.mechanism)

    def forces_along(
        self,
        motion: "Motion",
        t: ArrayLike | None = None,
        order: int = 2,
        *,
        method: Method | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> "Along":
        """Compute the generalized forces Q and their rates along a motion.

        The wrenches and the base of the motion act. Forces are those of `inverse_dynamics`, computed piece by piece to
        save memory.

        Parameters
        ----------
        motion : Motion
            From `jounce.load_motion` or a constructor of `Motion`. A robot that floats needs one with a base: columns
            ``base.x, ...`` of a table, or `Motion.with_base`. The base of a fixed robot is the ground that carries it.
        t : (N,), optional
            Times in s within the motion; by default ``motion.times``: of samples or file, or about 1 ms apart.
        order : int, optional
            The highest rate of the forces: 2 gives Q, Qd, Q2d.
        method : str, optional
            See `Robot`.
        progress : callable, optional
            Called as ``progress(done, total)``, in states, after each piece; an exception that it raises ends it.

        Returns
        -------
        Along
            Frozen: the times `t`, the `rates` q, qd, ..., tuples of (N, n), and the `forces` Q, Qd, ..., tuples of
            (N, nv), the wrench on a base that floats first; their standard `deviations` where the motion is fitted to
            measurements; the `breaks` where a rate of Q jumps; the terms C, V, Vd, ... of the `base`.

        Raises
        ------
        JounceError
            If the motion has too few rates or is not this robot's, a time is outside of it, or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("iiwa14")
        >>> motion = jounce.load_motion("paper", robot)
        >>> Q, Qd, Q2d = robot.forces_along(motion).forces
        >>> Q2d.shape
        (10000, 7)
        """
        from jounce.engine import along  # imported here to keep start-up fast

        return along.forces_along(self, motion, t, order, options=along.ForceOptions(method, progress))

    def check(
        self,
        motion: "Motion | Named | Sequence[Mapping[str, ArrayLike]]",
        rate: float | None = None,
        differences: int = 3,
        *,
        duration: float | None = None,
        tolerance: float | None = None,
    ) -> "Check":
        """Check a motion against every limit of the robot.

        The check covers the times between samples too, or commands of a controller.

        Between samples quintic polynomials through q, qd, ... and Q, Qd, Q2d find the peaks, which are then evaluated
        exactly. At a break of the motion both sides are checked; where a lower rate jumps, the value is infinite.
        Limits of contacts are kept if any wrenches keep them: judged are those whose largest ratio to a limit is least.

        Of measured motions, each kind of limit counts as it is where its standard deviation is at most ten times its
        median; elsewhere, which is towards the ends, where a value lies two deviations or more from its limit.

        At a `rate` limits bound backward differences of the positions at k / rate, the first from rest: v_k = (q_k -
        q_k-1) rate, a_k = (v_k - v_k-1) rate, ..., and (Q_k - Q_k-1) rate with the forces Q_k at q_k, v_k, a_k.

        Parameters
        ----------
        motion : Motion
            As for `forces_along`; with wrenches, these act. Tables read with `as_="commands"` have a rate of their own.
            Or way points and their `duration`, as `Motion.waypoints` takes them.
        rate : float, optional
            Rate of the controller that takes the motion, Hz: see `Motion.sampled`.
        differences : int, optional
            Order of the last difference that it takes: 1 to 4, 3 for jerk, as libfranka does.
        duration, tolerance : float, optional
            Of way points, s and rad or m: see `Motion.waypoints`.

        Returns
        -------
        Check
            The `verdict`: "kept", "broken", or "undecided" if no limit is broken as far as samples decide, with the
            share of time that they do, `judged`; `ok`, which is True if kept; the `worst` limit, and the `table` of all
            with worst value, ratio, time, margin and violations.

        Raises
        ------
        JounceError
            If the robot has no limits, the motion is that of other joints, or a rate that a limit needs is not known.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r").with_limits(effort=[40, 9], velocity=1)
        >>> motion = jounce.Motion.trapezoidal([[0, 0], [1, 1]], 0.5, 2.0)
        >>> found = robot.check(motion)
        >>> found.ok, found.worst.joint, found.worst.limit, round(found.worst.ratio, 4)
        (False, 'joint2', 'effort', 1.7567)
        """
        from jounce.engine.along import check_motion  # imported here to keep start-up fast
        from jounce.limits.check import check
        from jounce.motion import joint_matching

        path = joint_matching.take_points(self.mechanism, motion, duration, tolerance)
        return check(self, path if rate is None else check_motion(self.mechanism, path).sampled(rate, differences))

    def explain(
        self,
        motion: "Motion",
        controller: str | None = None,
        *,
        rate: float | None = None,
        differences: int = 3,
        start: ArrayLike | None = None,
    ) -> "Explanation":
        """Explain why a controller stops a motion.

        The result names the limits and joints that commands break, the times and the causes.

        The differences of the commands are judged as by `check` with a rate. Causes are recognised by the commands
        around each moment: late or repeated ones, rounding, a start that is not at rest where the robot is, a jump of a
        derivative, a torque rate that no kinematic limit prevents, a motion that is too fast.

        Parameters
        ----------
        motion : Motion
            A plan, or a table that is read with `as_="commands"`, whose torques, if it has any, are commands too.
        controller : {"franka"}, optional
            Its rate and differences are used, and the public limits of its arm, Panda or FR3 by the names of joints.
        rate, differences : float, int, optional
            In place of a controller, for the limits of this robot: see `check`.
        start : (n,), optional
            The measured positions at which the robot rests before the first command, rad or m.

        Returns
        -------
        Explanation
            The `trips`, each with joint, limit, time and cause; `cures` by `slowdown` and `retime`, with their results;
            `unpredicted` is what such differences do not show.

        Raises
        ------
        JounceError
            If the controller is unknown, or neither or both of controller and rate are given; and as `check` does.

        References
        ----------
        libfranka, include/franka/rate_limiting.h and src/rate_limiting.cpp. Franka Control Interface documentation,
        "Robot and interface specifications".

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("panda", lock={"panda_finger_joint1": 0.0})
        >>> rest_to_rest = [[q, 0, 0, 10 * d, -15 * d, 6 * d] for q, d in zip([0, 0, 0, -2, 0, 2, 0], [1.5] * 7)]
        >>> motion = jounce.Motion.polynomial(rest_to_rest, 1.0)
        >>> trip = robot.explain(motion, "franka").trips[0]
        >>> trip.joint, trip.limit, trip.cause
        ('panda_joint2', 'acceleration', 'too fast')
        """
        from jounce.limits.explanation import explain, select_controller

        if controller is not None and rate is None:
            known, arm = select_controller(controller, self.joint_names)
            return explain(self.with_limits(arm), motion, known.rate, known.differences, start, known)
        if controller is not None or rate is None:
            raise JounceError(f"expected either {option_value('controller', 'franka')} or {option_value('rate', 1000)}")
        return explain(self, motion, rate, differences, start)

    def slowdown(
        self, motion: "Motion", rate: float | None = None, differences: int = 3, *, up_to_limits: bool = False
    ) -> "Slowdown":
        """Find the largest factor of speed that keeps every limit.

        It is at most 1, and every smaller factor keeps the limits too.

        A motion that `check` finds kept is returned as it is: the same object, with `factor` 1, `binding` None, and how
        much faster it could be as `largest`. So is one whose `verdict` is "undecided". `up_to_limits=True` makes
        motions faster too.

        ``q_c(t) = q(c t)`` takes ``Q_c = S + c V + c^2 D``: static, viscous and inertial forces. Every limit is a
        polynomial inequality in c at each time; between samples the factor is refined by exact evaluation. Wrenches
        given over time go with the path. Coulomb friction is no polynomial; with it, factors are tried one by one.

        Of a measured motion the factor is the largest of those tried at which `check` finds every limit kept, by two
        standard deviations. Limits that its samples decide at no speed stay undecided, and the notes name them.

        At a `rate` limits bound the differences of the commands, as in `check` with this rate, which finds every limit
        of the result kept. Factors are tried from 1 down in steps of a twentieth until one keeps them, and the last
        step is bisected; slower ones are not tried. Motions that consist of commands are judged at their own rate, and
        the result consists of commands too.

        Parameters
        ----------
        motion : Motion
            As for `forces_along`.
        rate, differences : float, int, optional
            Rate of the controller that takes the motion, Hz, and order of the last difference: see `check`.
        up_to_limits : bool, optional
            Whether a motion that keeps its limits becomes as fast as they allow.

        Returns
        -------
        Slowdown
            The `factor`, the `binding` (joint, limit, time), the `motion` at it, the `largest` feasible factor, and
            `notes`.

        Raises
        ------
        JounceError
            If no factor helps: a position beyond its limit, a static torque above its limit, a break where a lower
            rate of a limited quantity jumps; with `up_to_limits`, if nothing limits the speed; and as `check` does.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("planar2r").with_limits(effort=[60, 15])
        >>> slow = robot.slowdown(jounce.Motion.trapezoidal([[0, 0], [1, 1]], 2.0, 10.0))
        >>> round(slow.factor, 4), slow.binding.joint, slow.binding.limit
        (0.4159, 'joint2', 'effort')
        >>> robot.slowdown(slow.motion).motion is slow.motion
        True
        """
        from jounce.limits.slowdown import slowdown  # imported here to keep start-up fast

        return slowdown(self, motion, rate, differences, up_to_limits)

    def retime(
        self,
        motion: "Motion | Named | Sequence[Mapping[str, ArrayLike]]",
        margin: float = 0.01,
        smooth: bool = True,
        *,
        rate: float | None = None,
        differences: int = 3,
        tolerance: float | None = None,
    ) -> "Retiming":
        """Find the fastest motion along the path of a motion.

        It keeps all limits of the robot.

        Every finite limit counts: velocity, acceleration, jerk and snap, Q, Qd and Q2d (or Q - Qgrav with its rates),
        and power, of the whole robot too; position limits are those of the path. Wrenches go with the path. The time
        law is C^5: the result is as smooth as the motion, up to q5d. Velocity and acceleration at the ends of the
        motion remain.

        An interior-point method finds the spline x(sigma), the square of the speed along the path, each of its
        iterates within the limits; rows are added where a limit is exceeded between the points of the path.

        With `smooth=False` accelerations and forces may jump: reachability analysis finds the shortest duration of all
        under limits of velocity, acceleration and effort, in a fraction of the time. The jumps are `motion.breaks`.

        The time law keeps the limits of derivatives. Differences that a controller takes at a `rate` are means of those
        of q, and stay within the same limits where the motion begins and ends at rest; those of Q need not. The result
        is checked with the rate, and where a limit is broken the whole is slowed down until all are kept, at the
        expense of the margin and of the duration.

        Parameters
        ----------
        motion : Motion
            Of this robot. Below the highest rate of q that a limit takes none may jump: a torque rate takes q3d, so
            that q2d must be continuous; `Motion.blended` makes it so. Or way points, as `Motion.waypoints` takes them.
        margin : float, optional
            Share of each limit that is left.
        smooth : bool, optional
            Whether accelerations and forces are continuous; False needs limits without jerk, snap, Qd, Q2d and power,
            and forces without friction and damping.
        rate, differences : float, int, optional
            Rate of the controller that takes the motion, Hz, and order of the last difference: `check` with them finds
            every limit of the result kept.
        tolerance : float, optional
            Of way points, rad or m: straight lines whose corners are rounded within it, see `Motion.waypoints`.

        Returns
        -------
        Retiming
            Frozen: the `motion`, its `duration` in s, and `binding`: which limit of which joint decides, and when. Of
            measured motions `notes` name the limits that the result does not surely keep: deviations are left out.

        Raises
        ------
        JounceError
            If the path does not move, leaves the position limits, or its static torque exceeds an effort limit; if
            limits are missing, or a rate that one takes is not continuous; if Coulomb friction acts at joints that
            follow others in closed loops, or turns over too fast to be resolved; if motors are limited behind springs
            that are not linear or have dampers, or their power together where Coulomb friction acts in them; with
            `smooth=False`, if a limit is of higher order or not linear.

        References
        ----------
        Bobrow, Dubowsky & Gibson (1985): Time-optimal control of robotic manipulators along specified paths. Verscheure
        et al. (2009): Time-optimal path tracking for robots, a convex optimization approach. Pham & Pham (2018): A new
        approach to time-optimal path parameterization based on reachability analysis.

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

        >>> jounce.load("ur5").retime(motion, smooth=False).duration < faster.duration
        True
        """
        from jounce.limits.retime import retime  # imported here to keep start-up fast
        from jounce.motion import joint_matching

        path = joint_matching.take_points(self.mechanism, motion, None, tolerance, any_duration=True)
        return retime(self, path, margin, smooth, rate, differences)

    def elastic(
        self, stiffness: Named | None = None, rotor: Named | None = None, damping: Named | None = None,
        spring: "SpringLaw | Mapping[str, SpringLaw] | None" = None, coupling: Coupling = "spong",
        motors: "Motor | Mapping[str, Motor] | None" = None, *, damping_terms: int = 4,
    ) -> Self:  # fmt: skip
        """Return the robot with elastic joints.

        Each link hangs on its motor by a spring.

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
            The motors, one for all joints or {joint: motor}: gears, rotors, carriers, friction, electrical side.
        damping_terms : int, optional
            Number of terms of the series of dampers at one instant; each after the first takes one more rate of q.

        Returns
        -------
        Robot
            With the methods of any robot, which are those of the links, and `motor_positions`, `motor_torques`,
            `motor_commands`, `motor_currents`, `motor_voltages`, `elastic_forward_dynamics`, `feedback_linearization`,
            `motors_along`.

        Raises
        ------
        JounceError
            If a stiffness or rotor is zero, negative or NaN, a joint is unknown, an elastic joint has no rotor, or a
            coupled rotor no carrier.

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
        from jounce.arguments.joint_data import (  # imported here to keep start-up fast
            ElasticParameters,
            with_elasticity,
        )

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
        passive: Sequence[str] | None = None,
    ) -> Self:
        """Return the robot with its loops closed.

        Its actuated joints move it.

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
            frame_a, [0, 0, 1] by default. By default the loops that the robot's file states. "ground" in place of a
            frame holds the other one where it is at the start. Loops through the ground make the pose of a base that
            floats six coordinates of the tree, base_roll, base_pitch, base_yaw, base_x, base_y and base_z.
        actuated : list of str, optional
            The joints with motors. By default those of a robot whose loops are closed already.
        coordinates : list of str, optional
            The independent coordinates, by default the actuated joints; passive ones are added.
        start : (N,) or mapping, optional
            Positions, rad or m, near closed loops, which decide on the branch; joints that are left out are at 0.
        weights : (k,) or mapping, optional
            Weights of the squares of redundant motors' forces, whose sum is least; 1 by default.
        passive : list of str, optional
            Independent coordinates that springs move, or nothing, of which it warns. `actuator_forces` ends with what
            their motion lacks, and `passive_accelerations` computes it.

        Returns
        -------
        Robot
            With `n` independent coordinates; its `mechanism.tree` has its loops open.

        Raises
        ------
        JounceError
            If a name is unknown, loops cannot be closed, or coordinates or motors do not determine the motion.
        UncertainError
            A kind of JounceError, by methods of the closed robot: near singular positions, where errors exceed 1e-6.

        References
        ----------
        A. Müller, S. Kumar: Closed-form time derivatives of the equations of motion of rigid body systems, Multibody
        Syst. Dyn. 53 (2021), outlook. A. Müller, S. Kumar, T. Kordik, arXiv 2507.14274 (2025).

        Examples
        --------
        >>> import jounce
        >>> tree = jounce.Robot(jounce.load("fivebar").mechanism.tree)
        >>> robot = tree.closed([("left_tip", "right_tip")], ["left_shoulder", "right_shoulder"], start=[2, -1, 1, 1])
        >>> robot.n, tree.n
        (2, 4)
        """
        stated = loop_arguments.ClosureParameters(
            loops=loops, actuated=actuated, coordinates=coordinates, start=start, weights=weights, passive=passive
        )
        return type(self)(loop_arguments.with_loops(self.mechanism, stated))

    def with_transmission(
        self, matrix: ArrayLike, motors: "Sequence[str] | Mapping[str, Motor | None]",
        joints: Sequence[str] | None = None, offset: Named = 0.0,
    ) -> Self:  # fmt: skip
        """Return the robot with motors that move joints together.

        Examples are wrists with parallel shafts, differentials and cables.

        Positions of the motors are ``phi = A q + phi0``, their torques ``A^-T Q``: `coordinates` and `actuator_forces`
        with rates. ``robot.closed()`` has the motors as coordinates, ``closed(coordinates=[...])`` joints again, and
        `weights` of `closed` are for redundant motors. Motions are of the coordinates. Limits of motors are stated
        by their names; those of joints count too, forces being Q, which the motors make together.

        Parameters
        ----------
        matrix : (k, n)
            The ratios A, of rank n.
        motors : list of str or mapping
            Names of k motors, or {name: Motor}, whose gear, inertia, damping and friction become drive terms. Each is
            the joint of a massless rotor, which turns by phi.
        joints : list of str, optional
            Names of n coordinates, by default all.
        offset : number, (k,) or mapping, optional
            Positions phi0 of the motors where the joints are at 0; 0 by default.

        Returns
        -------
        Robot
            In the coordinates of this robot; its `mechanism.tree` has those of the motors too.

        Raises
        ------
        JounceError
            If the matrix is singular or not (k, n), a name is unknown or used twice, or the robot has loops, contacts,
            elastic joints or joints of several screws.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").with_transmission([[1, 0], [1, 1]], ["shoulder", "elbow"])
        >>> arm.coordinates([0.1, 0.2])[2:].round(3), arm.actuator_forces([0, 0], [0, 0], [0, 0])
        (array([0.1, 0.3]), array([19.62,  9.81]))
        """
        from jounce.arguments.transmissions import with_transmission  # imported here to keep start-up fast

        return type(self)(with_transmission(self.mechanism, matrix, motors, joints, offset))

    def contacts(self, contacts: "Sequence[Contact]") -> Self:
        """Return the robot on contacts.

        Their wrenches balance the base, which no motor drives.

        Its `inverse_dynamics` is ``Q - A^T f`` with the wrenches f of the ground, `contact_wrenches`, and their
        Jacobian A: six rows that vanish, to rounding, and the torques of the joints. Of all f that balance the base it
        takes the one with the least ``f^T W f``, with the weights W of the contacts, within their limits. Matrices,
        momenta, poses and twists are those of this robot; forward dynamics and similar quantities are not available.

        The motion must leave the contacts where they are: `forces_along` refuses one whose feet slide, a call for given
        rates does not look at it.

        Parameters
        ----------
        contacts : list of Contact
            Points, lines and planes on bodies, or on links merged into bodies; none leaves all contacts.

        Returns
        -------
        Robot

        Raises
        ------
        JounceError
            If the robot does not float, a frame is unknown, or the contacts balance no position.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> robot = jounce.load("g1", base="floating")
        >>> feet = [f"{side}_ankle_roll_link" for side in ("left", "right")]
        >>> stand = robot.contacts([jounce.Contact(foot, "plane", place=(0.035, 0, -0.037)) for foot in feet])
        >>> still = np.zeros(robot.n)
        >>> Q = stand.inverse_dynamics(still, still, still, base=(np.eye(4), np.zeros(6), np.zeros(6)))
        >>> bool(abs(Q[:6]).max() < 1e-10)
        True
        """
        return type(self)(with_contacts(self.mechanism, contacts))

    def project(self, motion: "Motion", base: ArrayLike | None = None) -> "Motion":
        """Return the nearest motion that keeps the robot's contacts in place.

        Contacts stay where they are at its start.

        ``q + A^T mu`` with the rows A of the contacts in the given joints is to first order the least sum of squares of
        their changes, in rad and m; the base follows from the contacts. These stay at all times, to 1e-12 rad or sizes
        of the robot, and all rates are exact derivatives. `Motion.notes` and `Motion.residual` have the largest
        changes.

        Parameters
        ----------
        motion : Motion
            Of the joints, with or without a base.
        base : (4, 4), optional
            Pose of the base at the start. By default that of the motion or, if it has none, the one that puts the first
            contact, a line or plane, at the inertial frame.

        Returns
        -------
        Motion
            With a base. Standard deviations are still those of the given joints.

        Raises
        ------
        JounceError
            If the contacts cannot stay, or hardly depend on the joints, as those of straight legs do.

        Examples
        --------
        >>> import jounce
        >>> robot = jounce.load("g1", base="floating")
        >>> stand = robot.contacts([jounce.Contact("left_ankle_roll_link", "plane", place=(0.035, 0, -0.037))])
        >>> motion = stand.project(jounce.Motion.polynomial([[0.1, 0.2]] * robot.n, 1.0))
        >>> Q = stand.forces_along(motion, order=0).forces[0]
        >>> bool(abs(Q[:, :6]).max() < 1e-10)
        True
        """
        from jounce.engine.contact_projection import project  # imported here to keep start-up fast

        return project(self, motion, base)

    def next_switch(self, *rates: Named, base: Rates | None = None, wrench: Rates | None = None) -> tuple[float, str]:
        """Predict when a limit of the contacts becomes active or inactive.

        The result names the limit: friction, sole, or a normal force.

        The first zero of the series ``sum_k x^(k) t^k / k!`` of what is left of each limit, ``x = -C f``, or of the
        multiplier of an active one, both from the rates that are given.

        Parameters
        ----------
        *rates : (n,)
            q, qd, q2d, q3d and higher rates of one state; the prediction is of the order of those after q2d.
        base, wrench : optional
            As for `contact_wrenches`.

        Returns
        -------
        tuple of float and str
            In what time, s, and the limit; (inf, "") where none is predicted.

        Raises
        ------
        JounceError
            If no contact has limits, they do not balance the state, or rates are missing.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> dog = jounce.load("solo12", base="floating")
        >>> feet = [f"{leg}_FOOT" for leg in ("FL", "FR", "HL", "HR")]
        >>> stand = dog.contacts([jounce.Contact(foot, "point", normal=(0, 0, 1), friction=0.5) for foot in feet])
        >>> still, none, jerk = np.tile([0, 0.8, -1.6], 4), np.zeros(6), np.eye(6)[3]
        >>> rates, base = (still, *np.zeros((3, 12))), (np.eye(4), none, none, 2 * jerk)
        >>> when, which = stand.next_switch(*rates, base=base)
        >>> round(when, 4), which
        (1.1697, "friction along x of 'FL_FOOT'")
        """
        from jounce.engine import contact_motion  # imported here to keep start-up fast

        return contact_motion.predict_switch(self, rates, base, wrench)

    def motors_along(
        self,
        motion: "Motion | Named | Sequence[Mapping[str, ArrayLike]]",
        t: ArrayLike | None = None,
        order: int = 0,
        *,
        stiffness: Rates | None = None,
        method: Method | None = None,
        progress: Callable[[int, int], object] | None = None,
        duration: float | None = None,
        tolerance: float | None = None,
    ) -> "ElasticAlong":
        """Compute positions and torques of the motors along a motion.

        The motors are behind elastic joints; the wrenches of the motion act.

        Parameters
        ----------
        motion : Motion
            As for `forces_along`; tau takes q4d. Or way points and their `duration`, as `Motion.waypoints` takes them.
        t, method, progress : optional
            As in `forces_along`.
        order : int, optional
            The highest rate of the torques: 1 gives tau and taud.
        stiffness : (N, k) or mapping, or a tuple of them, optional
            The stiffness S of the k joints with two motors: constant, or a tuple (S, Sd, S2d, ...) at the times.
        duration, tolerance : float, optional
            Of way points, s and rad or m: see `Motion.waypoints`.

        Returns
        -------
        ElasticAlong
            Frozen: the times `t`, the `rates` q, qd, ..., the `positions` theta, thetad, theta2d, ... and the `torques`
            tau, ..., tuples of (N, m); `currents`, `voltages`; `deviations` and `breaks` of the torques; `notes`.

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
        from jounce.actuators.motors import motors_along  # imported here to keep start-up fast
        from jounce.motion import joint_matching

        path = joint_matching.take_points(self.mechanism, motion, duration, tolerance)
        return motors_along(self, path, t, order, stiffness, method, progress)

    def elastic_energy(self, q: Named, qd: Named, theta: Named, thetad: Named) -> "Energy":
        """Return the energies of links, rotors and springs of elastic joints.

        Without wrenches, the rate of their sum is the motors' power less friction: ``thetad . (tau - F_m(thetad))``.

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
            If the joints are rigid.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> energy = arm.elastic_energy([0, 0], [0, 0], [0.1, 0], [1, 0])
        >>> energy.rotors.round(9), energy.springs.round(9)
        (np.float64(0.05), np.float64(4.0))
        """
        from jounce.actuators.motors import energy  # imported here to keep start-up fast

        return energy(self, (q, qd, theta, thetad))

    def damping_error(self, *rates: Named, wrench: Rates | None = None) -> Array:
        """Estimate the error of motor positions that dampers leave.

        It is that at one instant: the last term of a series.

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
        from jounce.actuators.motors import damping_error  # imported here to keep start-up fast

        return damping_error(self, rates, wrench)
