"""ElasticRobot: a robot whose links hang on its motors by springs. The conventions are those of `Robot`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any

from jounce.actuators import dynamics, variable
from jounce.actuators.along import ElasticAlong, motors_along
from jounce.actuators.dynamics import Accelerations, Energy
from jounce.core.errors import JounceError
from jounce.core.typing import Array, ArrayLike, Method, MotorQuantity, Named, Out, Rates, Results
from jounce.dynamics import electrical
from jounce.dynamics.quantities import QUANTITIES
from jounce.dynamics.stretch import elasticity_of
from jounce.engine.dispatch import compute
from jounce.engine.generic import as_tuple, results_into
from jounce.model.elasticity import Elasticity
from jounce.motion.motion import Motion
from jounce.native.kernel import Kernel
from jounce.robot import overloads
from jounce.robot.overloads import typed
from jounce.robot.robot import Robot

if TYPE_CHECKING:
    from jounce.limits.check import Check
    from jounce.limits.slowdown import Slowdown
    from jounce.model.limits import Limits

POSITIONS, TORQUES = QUANTITIES["motor_positions"], QUANTITIES["motor_torques"]


@dataclass(frozen=True)
class ElasticRobot:
    """A robot with elastic joints: motor positions, motor torques, and their inverse. `Robot.elastic` makes one.

    theta are the positions of the motors seen from the links, tau the torques of the motors seen from there: rotor
    angles over gear ratios, motor torques times gear ratios. By Spong's model, with stiffness K and rotor inertia B,

    * ``K (theta - q) = Q``: the springs exert the forces Q of the links' inverse dynamics,
    * ``B theta2d + F_m(thetad) + K (theta - q) = tau``, F_m the damping and friction of the motors.

    Conventions are those of `Robot`: names, batches, scalar types, rates, `wrench`, `method`, `out`, `threads`. A joint
    of infinite stiffness is rigid, theta = q.

    Attributes
    ----------
    robot : Robot
        The links: its inverse dynamics is Q, without what acts on the motors. Its mechanism holds the springs and
        motors, so that `jounce.codegen`, `jounce.casadi_function` and `jounce.symbolic` of it know the quantities
        "motor_positions" and "motor_torques".

    Examples
    --------
    >>> import jounce
    >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
    >>> arm.inverse_dynamics([0, 0], [0, 0], [0, 0], [0, 0], [0, 0])  # at rest the springs carry the links
    array([29.43,  9.81])
    """

    robot: Robot

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise JounceError(f"ElasticRobot() expects a Robot, got {type(self.robot).__name__}; try robot.elastic")
        if self.robot.mechanism.elasticity is None:
            raise JounceError(f"{self.robot.name}: its joints are rigid; robot.elastic(stiffness) makes them elastic")

    @property
    def elasticity(self) -> Elasticity:
        """The springs and motors, one per coordinate: `stiffness`, `rotor`, ..., see `Elasticity`."""
        return elasticity_of(self.robot.mechanism)

    @cached_property
    def _plant(self) -> Robot:
        return Robot(dynamics.with_rigid_rotors(self.robot.mechanism))

    def _check_at_rest(self, what: str, base: Rates | None = None) -> None:
        """Raise `JounceError` where a base moves that a method does not take."""
        if base is not None or self.robot.mechanism.base:
            raise JounceError(
                f"{what}: the base of {self.robot.name!r} moves; expected one at rest. motor_positions and"
                " inverse_dynamics of joints with one motor each take base="
            )

    @typed(overloads.OfMotorPositions)
    def motor_positions(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named | None = None,
        q4d: Named | None = None,
        *higher: Named,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The motor positions theta of a motion of the links, and their rates thetad, theta2d, ...

        ``theta = q + Q / K``.

        Parameters
        ----------
        q, qd, q2d : (..., n)
            Coordinates, velocities and accelerations of the links: rad or m, per s, per s^2.
        q3d, q4d, *higher : (..., n), optional
            Further rates, each for one more time derivative of theta.
        wrench : (..., nb, 6) or dict, or a tuple of them, optional
            As in `Robot.inverse_dynamics`, with as many rates as theta.
        stiffness : (..., k) or mapping, or a tuple of them, optional
            The stiffness S of the k joints with two motors, in their order or by name, with as many rates as theta.
        base : tuple, optional
            The pose C and the twist V, Vd, ... of the base, as in `Robot.inverse_dynamics`; a floating robot needs it.
        method, out, threads : optional
            See `Robot`.

        Returns
        -------
        theta : (..., n), or tuple of (..., n)
            In rad or m, per s, ...

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or `wrench` has fewer rates than theta.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> theta, thetad = arm.motor_positions([0, 0], [1, 0], [0, 0], [0, 0])
        >>> theta.round(6), thetad.round(6)
        (array([0.036788, 0.01635 ]), array([1., 0.]))
        """
        rates = (q, qd, q2d, q3d, q4d, *higher)
        if self.elasticity.pairs or stiffness is not None:
            self._check_at_rest("motor_positions of joints with two motors", base)
            return variable.compute(self.robot, POSITIONS.name, rates, stiffness, wrench, method, out)
        return compute(
            self.robot, POSITIONS.name, rates, wrench=wrench, base=base, method=method, out=out, threads=threads
        )

    @typed(overloads.OfSnap)
    def inverse_dynamics(
        self,
        q: Named,
        qd: Named,
        q2d: Named,
        q3d: Named,
        q4d: Named,
        *higher: Named,
        wrench: Rates | None = None,
        stiffness: Rates | None = None,
        base: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
        threads: int = 1,
    ) -> Results:
        """The motor torques tau of a motion of the links, and their rates taud, tau2d, ...

        ``tau = Q + B theta2d + F_m(thetad)`` with ``theta = q + Q / K``, which takes Q2d and thus q4d.

        Parameters
        ----------
        q, qd, q2d, q3d, q4d : (..., n)
            Coordinates of the links and their rates: rad or m, per s, ...
        *higher : (..., n), optional
            Further rates, each for one more time derivative of tau.
        wrench : tuple of (..., nb, 6) or dict, optional
            As in `Robot.inverse_dynamics`, with two more rates than tau: (W, Wd, W2d) for tau.
        stiffness : tuple of (..., k) or mapping, optional
            The stiffness of the k joints with two motors, with two more rates than tau: (S, Sd, S2d) for tau.
        base : tuple, optional
            The pose C and the twist V, Vd, ... of the base, as many terms as there are of q, qd, ...; a floating robot
            needs it.
        method, out, threads : optional
            See `Robot`.

        Returns
        -------
        tau : (..., n), or tuple of (..., n)
            In N m for revolute and N for prismatic coordinates, per s, ...

        Raises
        ------
        JounceError
            If an array has a wrong shape, a rate is skipped, or `wrench` has too few rates.

        References
        ----------
        M. W. Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109 (1987).

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> tau, taud = arm.inverse_dynamics([0, 0], [0, 0], [1, 1], [0, 0], [0, 0], [0, 0])
        >>> tau.round(6), taud.round(6)
        (array([36.53, 12.91]), array([0., 0.]))
        """
        rates = (q, qd, q2d, q3d, q4d, *higher)
        if self.elasticity.pairs or stiffness is not None:
            self._check_at_rest("inverse_dynamics of joints with two motors", base)
            return variable.compute(self.robot, TORQUES.name, rates, stiffness, wrench, method, out)
        return compute(
            self.robot, TORQUES.name, rates, wrench=wrench, base=base, method=method, out=out, threads=threads
        )

    def forward_dynamics(
        self,
        q: Named,
        qd: Named,
        theta: Named,
        thetad: Named,
        tau: Named,
        *,
        wrench: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
    ) -> Accelerations:
        """The accelerations of links and motors that motor torques cause.

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
            As in `Robot.inverse_dynamics`.
        method : {"kernel", "recursion", "closed_form"}, optional
            Of the links' forward dynamics, see `Robot`.
        out : tuple of arrays, optional
            Two arrays (..., n) to write q2d and theta2d into.

        Returns
        -------
        Accelerations
            A named pair: `q2d` and `theta2d`, (..., n) each.

        Raises
        ------
        JounceError
            If an array has a wrong shape, a name is unknown, or the mass matrix is singular.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> rest, theta = [0, 0], arm.motor_positions([0, 0], [0, 0], [0, 0])
        >>> arm.forward_dynamics(rest, rest, theta, rest, [29.43 + 0.1, 9.81]).theta2d.round(9) + 0.0
        array([1., 0.])
        """
        self._check_at_rest("forward_dynamics")
        found = dynamics.accelerations(self._plant, (q, qd, theta, thetad, tau), wrench, method)
        return Accelerations(*results_into(found, out))

    def feedback_linearization(
        self,
        q: Named,
        qd: Named,
        theta: Named,
        thetad: Named,
        q4d: Named,
        *,
        wrench: Rates | None = None,
        method: Method | None = None,
        out: Out = None,
    ) -> Any:
        """The motor torques tau that give the links a wanted snap q4d, from the measured state.

        q2d and q3d follow from the forces of the springs, ``Q = K (theta - q)`` and ``Qd = K (thetad - qd)``; tau is
        that of `inverse_dynamics`. With ``q4d = q4d_ref + k3 (q3d_ref - q3d) + ...`` the tracking error obeys a linear
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
            (W, Wd, W2d), as in `Robot.inverse_dynamics`.
        method : {"kernel", "recursion", "closed_form"}, optional
            See `Robot`.
        out : array, optional
            (..., n), to write tau into.

        Returns
        -------
        tau : (..., n)
            In N m, or N for coordinates in m.

        Raises
        ------
        JounceError
            If a joint is rigid, an array has a wrong shape, or the mass matrix is singular.

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
        self._check_at_rest("feedback_linearization")
        tau = dynamics.linearizing_torques(self.robot, (q, qd, theta, thetad, q4d), wrench, method)
        return results_into((tau,), out)

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
        self._check_at_rest("damping_error")
        return dynamics.damping_error(self.robot, rates, wrench)

    def currents(self, *rates: Named, wrench: Rates | None = None, stiffness: Rates | None = None) -> Results:
        """The currents i of the motors for a motion of the links, and their rates.

        ``i = tau / (r k)`` with the gear ratio r and the torque constant k.

        Parameters
        ----------
        *rates : (..., n)
            q, qd, q2d, q3d, q4d, and more for rates of i, as in `inverse_dynamics`.
        wrench, stiffness : optional
            See `inverse_dynamics`.

        Returns
        -------
        i : (..., n), or tuple of (..., n)
            In A, per s, ...; NaN for motors that state no torque constant.

        Raises
        ------
        JounceError
            As in `inverse_dynamics`, or if no motor states its torque constant.

        Examples
        --------
        >>> import jounce
        >>> motor = jounce.Motor(gear=100, inertia=1e-5, constant=0.05, resistance=0.5)
        >>> arm = jounce.load("planar2r").elastic(800, motors=motor)
        >>> arm.currents(*[[0, 0]] * 5)
        array([5.886, 1.962])
        """
        self._check_at_rest("currents")
        tau = self.inverse_dynamics(*rates, wrench=wrench, stiffness=stiffness)
        return results_into(electrical.currents(self.elasticity, as_tuple(tau)), None)

    def voltages(self, *rates: Named, wrench: Rates | None = None, stiffness: Rates | None = None) -> Results:
        """The voltages u of the motors for a motion of the links, and their rates.

        ``u = R i + L di/dt + k r thetad`` takes the rate of the motor torque and thus q5d, unless no motor has an
        inductance.

        Parameters
        ----------
        *rates : (..., n)
            q, qd, q2d, q3d, q4d, q5d, and more for rates of u, as in `inverse_dynamics`.
        wrench, stiffness : optional
            See `inverse_dynamics`; with the rates that taud takes.

        Returns
        -------
        u : (..., n), or tuple of (..., n)
            In V, per s, ...; NaN for motors that state no torque constant or no resistance.

        Raises
        ------
        JounceError
            As in `inverse_dynamics`, or if no motor states constant and resistance, or a rate is missing.

        Examples
        --------
        >>> import jounce
        >>> motor = jounce.Motor(gear=100, inertia=1e-5, constant=0.05, resistance=0.5, inductance=1e-3)
        >>> arm = jounce.load("planar2r").elastic(800, motors=motor)
        >>> arm.voltages(*[[0, 0]] * 6)
        array([2.943, 0.981])
        """
        self._check_at_rest("voltages")
        tau = self.inverse_dynamics(*rates, wrench=wrench, stiffness=stiffness)
        torques = as_tuple(tau)
        positions = self._positions_with(torques, rates, wrench, stiffness)
        found = electrical.voltages(self.elasticity, positions, torques)
        if not found:
            raise JounceError(f"voltages of {self.robot.name!r} take the rate of tau, hence one rate of q more")
        return results_into(found, None)

    def _positions_with(
        self, torques: Sequence[Array], rates: Sequence[Named], wrench: Rates | None, stiffness: Rates | None
    ) -> tuple[Array, ...]:
        """theta, thetad, ... with one rate more than the torques."""
        fewer = len(rates) - (TORQUES.rates - POSITIONS.rates) + 1  # tau to order r, theta to order r + 1
        terms = [x[: len(torques) + 1] if isinstance(x, tuple) else x for x in (wrench, stiffness)]
        found: Any = self.motor_positions(*rates[:fewer], wrench=terms[0], stiffness=terms[1])
        return tuple(found)

    def along(
        self,
        motion: Motion,
        t: ArrayLike | None = None,
        order: int = 0,
        *,
        stiffness: Rates | None = None,
        method: Method | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> ElasticAlong:
        """Motor positions and torques along a motion of the links, with the wrenches that it holds.

        Parameters
        ----------
        motion : Motion
            From `jounce.load_motion` or a constructor of `Motion`; tau takes q4d.
        t : (N,), optional
            Times in s, any within the motion; by default ``motion.times``.
        order : int, optional
            The highest rate of the torques: 1 gives tau and taud.
        stiffness : (N, k) or mapping, or a tuple of them, optional
            The stiffness S of the k joints with two motors: constant, or a tuple (S, Sd, S2d, ...) at the times.
        method, progress : optional
            As in `Robot.forces_along`.

        Returns
        -------
        ElasticAlong
            Frozen: the times `t`, the `rates` q, qd, ..., the `positions` theta, thetad, theta2d, ... and the `torques`
            tau, ..., tuples of (N, m); `currents`, `voltages`; `deviations` and `breaks` of the torques.

        Raises
        ------
        JounceError
            If the motion has too few rates for the order or is not this robot's, a time is outside of it, or springs
            cannot carry a force or have a stiffness, with the joint, the time and the bound.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("iiwa14").elastic(1e4, rotor=0.4)
        >>> [tau] = arm.along(jounce.load_motion("paper", arm.robot)).torques
        >>> tau.shape
        (10000, 7)
        """
        return motors_along(self.robot, motion, t, order, stiffness, method, progress)

    def with_limits(self, source: "str | PathLike[str] | Limits | None" = None, /, **limits: Any) -> "ElasticRobot":
        """The robot with some of its limits replaced, of motors too; see `Robot.with_limits`.

        Parameters
        ----------
        source, **limits : optional
            As in `Robot.with_limits`: ``motor_velocity=2.0``, ``motor_torque={"joint1": 80}``, ...

        Returns
        -------
        ElasticRobot

        Raises
        ------
        JounceError
            As in `Robot.with_limits`.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1).with_limits(motor_torque=40)
        >>> arm.robot.limits.motor_torque
        array([40., 40.])
        """
        return ElasticRobot(self.robot.with_limits(source, **limits))

    def check(self, motion: Motion) -> "Check":
        """Every limit along a motion of the links, those of motors among them; see `Robot.check`.

        Parameters
        ----------
        motion : Motion
            The motion; a limit of motor torques takes q4d.

        Returns
        -------
        Check

        Raises
        ------
        JounceError
            As in `Robot.check`.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1).with_limits(motor_torque=40)
        >>> arm.check(jounce.Motion.fourier([0, 0], [[0.1, 0.2]], [[0, 0]], 2.0, 3.0)).ok
        True
        """
        return self.robot.check(motion)

    def slowdown(self, motion: Motion) -> "Slowdown":
        """The largest factor of speed at which a motion keeps all limits, those of motors too; see `Robot.slowdown`.

        Parameters
        ----------
        motion : Motion
            The motion.

        Returns
        -------
        Slowdown

        Raises
        ------
        JounceError
            As in `Robot.slowdown`, and if a motor cannot keep its limit at rest.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1).with_limits(motor_velocity=0.2)
        >>> arm.slowdown(jounce.Motion.fourier([0, 0], [[0.1, 0.2]], [[0, 0]], 2.0, 3.0)).binding.limit
        'motor_velocity'
        """
        return self.robot.slowdown(motion)

    def energy(self, q: Named, qd: Named, theta: Named, thetad: Named) -> Energy:
        """The energies of links, rotors and springs.

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
            If an array has a wrong shape or a name is unknown.

        Examples
        --------
        >>> import jounce
        >>> arm = jounce.load("planar2r").elastic([800, 600], rotor=0.1)
        >>> energy = arm.energy([0, 0], [0, 0], [0.1, 0], [1, 0])
        >>> energy.rotors.round(9), energy.springs.round(9)
        (np.float64(0.05), np.float64(4.0))
        """
        self._check_at_rest("energy")
        return dynamics.energy(self.robot, (q, qd, theta, thetad))

    def compile(
        self, quantity: MotorQuantity = "motor_torques", order: int = 0, wrench: bool = False, *, base: bool = False
    ) -> Kernel[Any]:
        """Compile motor torques or motor positions to native code before the first call.

        Parameters
        ----------
        quantity : str, optional
            "motor_torques" or "motor_positions"; ``arm.robot.compile`` takes the quantities of the links too.
        order : int, optional
            The highest rate.
        wrench : bool, optional
            Whether wrenches W, Wd, ... follow the coordinates' rates in its calls.
        base : bool, optional
            Whether the motion of the base, C, V, Vd, ..., follows in its calls; it always does if the robot floats.

        Returns
        -------
        Kernel
            To call as ``kernel(q, qd, q2d, q3d, q4d)`` on float64 arrays, see `Robot.compile`.

        Raises
        ------
        JounceError
            As in `Robot.compile`.

        Examples
        --------
        >>> import jounce, numpy as np
        >>> kernel = jounce.load("planar2r").elastic([800, 600], rotor=0.1).compile()
        >>> kernel(*np.zeros((5, 2)))
        array([29.43,  9.81])
        """
        return self.robot.compile(quantity, order, wrench, moving_base=base)
