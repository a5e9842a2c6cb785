"""Motors move the links through springs: their positions and torques along a motion.

`motors_along` is the door. What motors do follows from the state of the links, unless springs have dampers or joints
two motors. Deflections of dampers are integrated, and tau then takes one rate of Q less than without a damper. At one
state, `energy` gives the energies of links, rotors and springs, and `damping_error` what the series of dampers leave
out.

Problem of a damper in parallel to a spring: phi(delta) + D delta' = Q, integrated over time along a motion.

Algorithm: between samples Q is the quintic Hermite polynomial of Q, Qd, Q2d. A linear spring then has the exact
solution ``delta(t + h) = e^-z delta(t) + h/D sum_j c_j I_j(z)`` with z = K h / D, the coefficients c_j of Q in u from 0
to 1, and ``I_j = integral of e^(-z (1 - u)) u^j``. Other springs take the Radau IIA method of order 9 [1] on the same
polynomials, which is L-stable: time constants D / K may be far below the step. Deflections start from the series of the
damper, which a robot at rest has exactly. All steps are halved until deflections no longer change; breaks of the motion
are ends of steps, as no polynomial passes them.

Failure: `JounceError` where a deflection leaves the range of its spring, and where the last halving still changes it.

[1] E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd edition, 1996, section IV.8.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from jounce.arguments import joint_data, requests
from jounce.arguments.rates import check_order, convert_rates, find_rates, split_rates
from jounce.core import scalars
from jounce.core.cures import Remedy
from jounce.core.display import HtmlDisplay
from jounce.core.errors import JounceError, quote_value
from jounce.core.scalars import Array
from jounce.core.typing import ArrayLike
from jounce.dynamics import elastic, joint_springs
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES, Quantity, find_row
from jounce.dynamics.recursion.joints import take_rows
from jounce.engine import along, motion_channels
from jounce.engine.along import Along, ForceBreak, Progress
from jounce.engine.engine import Engine, with_mechanism
from jounce.engine.motion_states import MotionStates, Side
from jounce.engine.plan import compute
from jounce.model import coordinates
from jounce.model.elasticity import Elasticity, motor_names
from jounce.model.mechanism import Mechanism, cast_model
from jounce.model.spring_deflection import UnreachableError
from jounce.model.springs import CubicSpring, DampedSpring, Spring
from jounce.motion import channel, hermite
from jounce.motion.channel import Channel, Rates
from jounce.motion.motion import Motion
from jounce.spatial.series import column_series

REST_SPEED_SHARE = (
    1e-6  # of the largest velocity of links, or of motors: what is slower rests, to rounding of its rates
)
_POSITION_ROW, _TORQUE_ROW = QUANTITIES["motor_positions"], QUANTITIES["motor_torques"]
_ELECTRIC_ROWS = ("motor_currents", "motor_voltages")


@dataclass(frozen=True, eq=False, repr=False)
class ElasticAlong(HtmlDisplay):
    """Motor positions and torques along a motion, with states of the links.

    `Robot.motors_along` makes one. It holds channels; `t`, `rates`, `positions`, `torques`, ... are the arrays in them.

    Attributes
    ----------
    links : tuple of Channel
        q of the links with its rates.
    motors : tuple of Channel
        theta and tau of the motors with their rates, deviations and breaks, and i and u of those with a torque
        constant.
    notes : tuple of str
        Which motor would have to start or stop at a speed where the links rest, in words.

    Examples
    --------
    >>> import jounce
    >>> arm = jounce.load("iiwa14").elastic(1e4, rotor=0.4)
    >>> along = arm.motors_along(jounce.load_motion("paper", arm), [0.0, 1.0])
    >>> theta, thetad, theta2d = along.positions
    >>> along.torques[0].shape
    (2, 7)
    """

    links: tuple[Channel, ...]
    motors: tuple[Channel, ...]
    notes: tuple[str, ...] = ()

    @property
    def t(self) -> np.ndarray:
        """Times (N,) in s."""
        return self.links[0].times

    @property
    def rates(self) -> Rates:
        """q, qd, ..., q4d, ... of the motion, (N, n) each: rad or m, per s, ...; at a break those after it."""
        return tuple(x for channel in self.links for x in channel.rates)

    @property
    def positions(self) -> Rates:
        """Motor positions theta, thetad, theta2d, ..., seen from the links: (N, n) each, rad or m, per s, ..."""
        return self.motors[0].rates

    @property
    def torques(self) -> Rates:
        """Motor torques tau, taud, ..., (N, n) each: N m, or N for coordinates in m, per s, ..."""
        return self.motors[1].rates

    @property
    def deviations(self) -> Rates | None:
        """Standard deviations of the torques of measured motions; None of exact ones."""
        return self.motors[1].deviations

    @property
    def breaks(self) -> tuple[ForceBreak, ...]:
        """Times at which tau or a rate jumps or does not exist: with order, jump and causes."""
        return tuple(found for found in self.motors[1].breaks if isinstance(found, ForceBreak))

    @property
    def currents(self) -> Rates | None:
        """Currents i, id, ..., or None: (N, n) each, in A, per s, ..., NaN for motors without a torque constant."""
        return self._find("i")

    @property
    def voltages(self) -> Rates | None:
        """Voltages u, ud, ..., or None: (N, n) each, in V, per s, ..., NaN for motors without a torque constant.

        They take a rate of tau more than currents, unless there is no inductance.
        """
        return self._find("u")

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All channels: those of the links, then those of the motors."""
        return *self.links, *self.motors

    def _find(self, symbol: str) -> Rates | None:
        return next((channel.rates for channel in self.motors if channel.symbol == symbol), None)

    def __repr__(self) -> str:
        return channel.print_channels("ElasticAlong", self.channels, self.notes)


def motors_along(
    robot: Engine,
    motion: Motion,
    t: ArrayLike | None = None,
    order: int = 0,
    stiffness: Any = None,
    method: str | None = None,
    progress: Progress | None = None,
) -> ElasticAlong:
    """Compute motor positions, and torques up to an order, along a motion.

    The robot has elastic joints. The parameters are those of `Robot.motors_along`, one by one.
    """
    moves = isinstance(motion, Motion) and motion.base_curve is not None
    requests.check_existence(robot.mechanism, _POSITION_ROW.name, moves or robot.mechanism.floats, "motors_along")
    m, e = robot.mechanism, joint_springs.elasticity_of(robot.mechanism)
    # Only joints with two motors take a stiffness over time: a stiffness for others is an error.
    if len(e.pairs) == 0:
        joint_data.convert_stiffness(m, stiffness, 1)
    # Deflections of dampers depend on the motion before a time, and pairs of motors on their stiffness over time.
    if (len(e.dampers) > 0 and e.level is None) or len(e.pairs) > 0:
        links = _link_forces(robot, motion, t, check_order(order), method, progress)
        links, theta, tau = _integrate_motors(robot, motion, links, check_order(order), stiffness, method)
        notes = _describe_ends(robot, motion, links, theta[1])
        torque = motor_channel(m, _TORQUE_ROW, links.t, tau, breaks=links.breaks)
        return ElasticAlong(links.coordinates, motor_channels(m, theta, torque), notes)
    # Else motors follow from the state at each time: quantities of the robot, as forces are.
    try:
        rows = [find_row(row.name, e.more_rates) for row in (_POSITION_ROW, _TORQUE_ROW)]
        torque_options = along.ForceOptions(method, progress, rows[1])
        torques = along.forces_along(robot, motion, t, order, options=torque_options)
        # Positions with as many rates as the rates of the links let them have.
        highest = len(torques.rates) - rows[0].takes.rates
        position_options = along.ForceOptions(method, row=rows[0])
        theta = along.forces_along(robot, motion, torques.t, highest, options=position_options).forces
    except UnreachableError:
        # The same by forces of all times reports the time at which no deflection carries the force.
        links = _link_forces(robot, motion, t, check_order(order), method, progress)
        _integrate_motors(robot, motion, links, check_order(order), None, method)
        raise
    _check_stiffness_between(robot.mechanism, torques.t, theta[0] - torques.rates[0])
    notes = _describe_ends(robot, motion, torques, theta[1])
    torque = motor_channel(m, _TORQUE_ROW, torques.t, torques.forces, torques.deviations, torques.breaks)
    return ElasticAlong(torques.coordinates, motor_channels(m, theta, torque), notes)


def motor_channels(m: Mechanism, theta: Rates, torque: Channel) -> tuple[Channel, ...]:
    """Return the channels theta and tau, with i and u if possible."""
    e, t = joint_springs.elasticity_of(m), torque.times
    channels = [motor_channel(m, _POSITION_ROW, t, theta), torque]
    for name, rates in zip(_ELECTRIC_ROWS, elastic.electrical_outputs(e, theta, torque.rates), strict=True):
        if rates is not None:
            channels.append(motor_channel(m, QUANTITIES[name], t, rates))
    return tuple(channels)


def motor_channel(
    m: Mechanism,
    row: Quantity,
    t: np.ndarray,
    rates: Rates,
    deviations: Rates | None = None,
    breaks: tuple[ForceBreak, ...] = (),
) -> Channel:
    """Return the channel of a quantity of motors: one or two per joint, at times (N,)."""
    e, units = joint_springs.elasticity_of(m), motion_channels.quantity_units(m, row)
    of_motors = tuple(units[j] for j in e.joints_of_motors)
    return Channel(row.gives.symbol, motor_names(e, m.coordinates), of_motors, t, rates, deviations, (), breaks)


def _describe_ends(robot: Engine, motion: Motion, links: Along, thetad: np.ndarray) -> tuple[str, ...]:
    """Return a note on the fastest motor where links rest.

    Its velocity jumps there.
    """
    m, qd, jumps = robot.mechanism, np.abs(links.rates[1]), list[tuple[float, int, float, str]]()
    for t, verb in ((motion.start, "start"), (motion.stop, "stop")):
        # The ends may be among the times, once or twice.
        for i in np.flatnonzero(links.t == t).tolist():
            speed = np.abs(thetad[i])
            if qd[i].max() <= REST_SPEED_SHARE * qd.max() and speed.max() > REST_SPEED_SHARE * np.abs(thetad).max():
                jumps.append((float(speed.max()), int(speed.argmax()), t, verb))
    if len(jumps) == 0:
        return ()
    speed, j, t, verb = max(jumps)
    joint = motor_names(joint_springs.elasticity_of(m), m.coordinates)[j]
    unit = f"{coordinates.units(m)[m.coordinates.index(joint)]}/s" if joint in m.coordinates else "rad/s or m/s"
    return (
        f"the motor of {joint} would have to {verb} at {speed:.2g} {unit} at t = {t:.6g} s, where the links rest but"
        " their jerk is not zero; plan a motion with q3d = 0 at both ends, such as polynomials of degree 7;"
        f" {Remedy('motion.blended(time)', '--blend S')} replaces breaks between the ends alone",
    )


def _check_stiffness_between(m: Mechanism, t: np.ndarray, deflections: np.ndarray) -> None:
    """Raise `JounceError` where a spring without stiffness at rest turns round.

    Between two times its motor would move infinitely fast, which no time shows.
    """
    order = np.argsort(t)
    for j in joint_springs.elasticity_of(m).slack:
        signs = np.sign(deflections[order, j])
        turned = np.flatnonzero(signs[:-1] * signs[1:] < 0)
        if turned.size > 0:
            before, after = t[order][turned[0] : turned[0] + 2]
            raise JounceError(
                f"joint {quote_value(m.coordinates[j])}: the force of its spring crosses zero between t = {before:g} s"
                f" and {after:g} s, where the spring has no stiffness and its motor would move infinitely fast; give"
                " CubicSpring a k above 0"
            )


def voltage_order(e: Elasticity, known: int | None) -> int:
    """Return the rate of the torques that voltages take.

    The first with inductances, if enough rates of q are known.
    """
    return int(e.is_inductive and (known is None or known >= 5 + e.more_rates))


def _more_force_rates(m: Mechanism) -> int:
    """Return how many rates of Q more than of tau are needed: theta2d takes Q2d of springs.

    The deflection of a damper is integrated, so that its second rate takes Qd alone.
    """
    return 1 if len(joint_springs.elasticity_of(m).dampers) == m.n else 2


def _link_forces(
    robot: Engine, motion: Motion, t: ArrayLike | None, order: int, method: str | None, progress: Progress | None
) -> Along:
    """Compute the forces of the links with the rates that torques take."""
    options = along.ForceOptions(method, progress)
    return along.forces_along(robot, motion, t, order + _more_force_rates(robot.mechanism), options=options)


def _integrate_motors(
    robot: Engine, motion: Motion, links: Along, order: int, stiffness: Any, method: str | None
) -> tuple[Along, Rates, Rates]:
    """Compute motor positions and torques (N, m) from forces at all times.

    Returns also these forces, with the breaks of the torques.
    """
    m = robot.mechanism
    # q and Q with their rates as series in time, of all times at once, and the springs with their stiffness over time.
    q, Q = column_series(links.rates), column_series([force[:, -m.n :] for force in links.forces])
    inputs = joint_springs.with_stiffness(
        m, column_series(_stiffness_over_time(robot, stiffness, len(links.t), order + 3))
    )
    # Positions theta = q + delta(Q) and torques tau = Q + B theta2d, with the deflections of dampers integrated.
    try:
        inputs = replace(inputs, deflections=integrate_deflections(robot, motion, links.t, method))
        theta, phi = elastic.motor_positions(m, q, lambda _: Q, inputs)
        tau = elastic.motor_torques(m, q, theta, phi)
        positions, torques = ([x[..., 0] for x in series.upto(k)] for series, k in ((theta, order + 2), (tau, order)))
    except UnreachableError as error:
        raise JounceError(f"{error}, at t = {links.t[error.state]:g} s") from None
    # A break of a rate of Q is one of a lower rate of tau.
    lower = _more_force_rates(m)
    breaks = tuple(ForceBreak(b.t, max(b.order - lower, -1), None, b.causes) for b in links.breaks)
    efforts = replace(links.efforts, breaks=breaks)
    return replace(links, efforts=efforts), tuple(positions), tuple(torques)


def _stiffness_over_time(robot: Engine, stiffness: Any, times: int, count: int) -> list[np.ndarray]:
    """Return S, Sd, ... of joints with two motors at the times: (N, k).

    One number, row or mapping alone is constant.
    """
    m = robot.mechanism
    if len(joint_springs.elasticity_of(m).pairs) == 0:
        return []
    if stiffness is not None and find_rates(stiffness) is None:
        (constant,) = joint_data.convert_stiffness(m, stiffness, 1)
        if constant.ndim == 1:
            return [np.tile(constant * (k == 0), (times, 1)) for k in range(count)]
    S = joint_data.convert_stiffness(m, stiffness, count)
    for term in S:
        if term.shape[:-1] != (times,):
            raise JounceError(
                f"stiffness has shape {term.shape}; expected ({times}, {term.shape[-1]}), as many as times"
            )
    return S


# Deflections of springs with dampers.
_DOWNWARD_TERMS = 60  # of the recursion downward, where z < 6: it then neglects less than 6^60 / 60! = 1e-35
_RADAU_STAGES = 5  # of the Runge-Kutta method, which has order 9: above that of the quintics of Q
_MAX_STAGE_STEPS = 20  # of Newton's method for the stages, which converges quadratically
_STAGE_TOLERANCE = 1e-15  # relative change of the stages that ends Newton's method: rounding
_FIRST_DAMPER_STEPS = 200  # of a motion, which resolve most motions
_MAX_DAMPER_HALVINGS = 8  # of the steps: the error, which goes with their sixth power, is then 3e14 times smaller
_DEFLECTION_TOLERANCE = 1e-12  # relative change by halved steps: the error that is left is a small part of it
_MAX_DEFLECTION_CHANGE = 1e-8  # relative, by the last halving: resolved motions leave less than a tenth of it as error
Sides = tuple[Sequence[np.ndarray], Sequence[np.ndarray]]  # Q, Qd, Q2d (N, n) just before and just after times
Sampled = Callable[[np.ndarray], Sides]


def integrate_deflections(robot: Engine, motion: Motion, t: np.ndarray, method: Any) -> dict[int, np.ndarray]:
    """Integrate the deflections (N, 1, 1) of springs with dampers, by coordinate."""
    laws = {
        j: law
        for j, law in enumerate(joint_springs.elasticity_of(robot.mechanism).springs)
        if isinstance(law, DampedSpring)
    }
    if len(laws) == 0:
        return {}
    joints = list(laws)
    sampled = _sample_forces(robot, motion, joints, method)
    # The first steps: even ones, ended at the times that are asked for and at breaks of Q, Qd, Q2d.
    breaks = [b.t for b in motion.breaks_to(DEFAULT_QUANTITY.takes.rates + 1) if motion.start < b.t < t.max()]
    even = np.linspace(motion.start, max(float(t.max()), motion.start), _FIRST_DAMPER_STEPS + 1)
    grid = np.unique(np.concatenate([even, t, breaks]))
    start = _initial_deflections(robot, motion, laws, method)
    known = _solve(list(laws.values()), grid, sampled, start)
    before = np.inf
    for _ in range(_MAX_DAMPER_HALVINGS):
        # Solve again with a time halfway between neighbours, and compare at the old times.
        finer = np.unique(np.concatenate([grid, (grid[1:] + grid[:-1]) / 2]))
        better = _solve(list(laws.values()), finer, sampled, start)
        change = np.abs(better[np.searchsorted(finer, grid)] - known).max(axis=0)
        grid, known = finer, better
        # Ends of springs are checked on the finer grid, which passes them first.
        _check_ends(robot, laws, grid, known)
        size = np.abs(known).max(axis=0)
        resolved = change <= _MAX_DEFLECTION_CHANGE * size
        # Done where nothing changes, or where changes are small and no longer fall: rounding is what is left.
        close = change <= _DEFLECTION_TOLERANCE * size
        if (close | (resolved & (change > before / 2))).all():
            break
        before = change
    if not resolved.all():
        i = int(np.argmin(resolved))
        raise JounceError(
            f"joint {quote_value(robot.joint_names[joints[i]])}: the deflection of the spring with a damper is not"
            f" resolved by {len(grid) - 1} steps; the last halving changed it by {change[i] / size[i]:.1g} of its size;"
            " give more times t, which become steps"
        )
    deflections = known[np.searchsorted(grid, t)]
    return {j: deflections[:, i : i + 1, None] for i, j in enumerate(joints)}


def _check_ends(robot: Engine, laws: dict[int, DampedSpring], t: np.ndarray, known: np.ndarray) -> None:
    """Raise `JounceError` where a deflection (N, k) has left its spring: NaN after that."""
    for i, (j, law) in enumerate(laws.items()):
        beyond_ends = np.flatnonzero(np.isnan(known[:, i]))
        if beyond_ends.size > 0:
            low, high = law.spring.range
            raise JounceError(
                f"joint {quote_value(robot.joint_names[j])}: the spring with a damper is deflected beyond its ends,"
                f" {low:g} to {high:g}, at t = {t[beyond_ends[0]]:g} s"
            )


def _sample_forces(robot: Engine, motion: Motion, joints: Sequence[int], method: Any) -> Sampled:
    """Return a function of times: Q, Qd, Q2d (N, k) of some joints on both sides.

    They differ at breaks of the motion: just before, and just after the times.
    """

    def both_sides(t: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        before, after = (
            [rate[:, joints] for rate in _joint_forces(robot, motion, t, side, method)] for side in along.SIDES
        )
        return before, after

    return both_sides


def _joint_forces(robot: Engine, motion: Motion, t: np.ndarray, side: Side, method: Any) -> list[np.ndarray]:
    """Return Q, Qd, Q2d (N, n) of the joints."""
    states = MotionStates.sample(robot, motion, t, [(DEFAULT_QUANTITY, 2)], side)
    return [rate[:, -robot.n :] for rate in states.compute(robot, DEFAULT_QUANTITY.name, method)]


def _initial_deflections(robot: Engine, motion: Motion, laws: dict[int, DampedSpring], method: Any) -> np.ndarray:
    """Return the deflections at the start by the series of the damper: (k,).

    A robot at rest has these exactly.
    """
    t = np.array([motion.start])
    rates = _joint_forces(robot, motion, t, "right", method)
    Q, deflections = column_series(rates), []
    for j, law in laws.items():
        sums = joint_springs.expand_damped_deflection(law.spring, law.damping, take_rows(Q, j, j + 1), len(rates))
        # A series that does not converge says nothing: the spring alone serves, and the integration forgets the start.
        try:
            joint_springs.check_series(sums, law.time_constant)
        except JounceError:
            sums = sums[:2]
        deflections.append(sums[-1][0][0, 0, 0])
    return np.array(deflections)


def _solve(laws: Sequence[DampedSpring], t: np.ndarray, Q: Sampled, start: np.ndarray) -> np.ndarray:
    """Return the deflections (N, k) of springs with dampers at times.

    Runs once per halving of the steps.
    """
    sides = Q(t)
    deflections = []
    for i, law in enumerate(laws):
        before, after = ([rate[:, i : i + 1] for rate in side] for side in sides)
        forces = (before, after)
        spring = law.spring
        # Linear springs have the exact solution.
        if isinstance(spring, CubicSpring) and spring.k3 == 0:
            K, D = np.array([spring.k]), np.array([law.damping])
            deflections.append(integrate_linear(K, D, t, forces, start[i : i + 1])[:, 0])
        else:
            deflections.append(integrate_nonlinear(spring, law.damping, t, forces, float(start[i])))
    return np.stack(deflections, axis=1)


def exponential_integrals(z: np.ndarray, count: int) -> np.ndarray:
    """Return I_j(z) for j < count: (count, ...).

    I_j is the integral of e^(-z (1 - u)) u^j over 0 .. 1. The recursion ``z I_j + j I_(j - 1) = 1`` is stable downward
    where j > z, and upward where j < z.
    """
    # Downward from 0, far beyond the count, for z below it: I_j from I_(j + 1). Larger z are cut, and not used.
    down, small_z = np.zeros_like(z), np.minimum(z, count)
    low: list[np.ndarray] = []
    for j in reversed(range(_DOWNWARD_TERMS)):
        down = (1 - small_z * down) / (j + 1)
        low.insert(0, down)
    # Upward from I_0 = (1 - e^-z) / z for z above the count; z = 0 divides by 0, and is not used.
    with np.errstate(divide="ignore", invalid="ignore"):
        up = -np.expm1(-z) / z
        high = [up]
        for j in range(1, count):
            up = (1 - j * up) / z
            high.append(up)
    return np.where(z < count, np.stack(low[:count]), np.stack(high))


def integrate_linear(K: np.ndarray, D: np.ndarray, t: np.ndarray, Q: Sides, start: np.ndarray) -> np.ndarray:
    """Return deflections of linear springs with dampers: (N, n), at times t (N,).

    K and D are (n,), and `start` (n,) are the deflections at the first time.
    """
    # The quintic of Q over each step, from just after its start to just before its end, as coefficients of u^j:
    # (6, steps, n).
    before, after = Q
    h = np.diff(t)[:, None]
    c = hermite.hermite_coefficients([rate[:-1] for rate in after], [rate[1:] for rate in before], h)[::-1]
    # delta(t + h) = e^-z delta(t) + h/D sum_j c_j I_j(z): only the recursion runs step by step.
    z = K * h / D
    driven = h / D * np.einsum("jik,jik->ik", c, exponential_integrals(z, len(c)))
    deflections, decay = [start], np.exp(-z)
    for factor, forced in zip(decay, driven, strict=True):
        deflections.append(factor * deflections[-1] + forced)
    return np.stack(deflections)


def integrate_nonlinear(spring: Spring, D: float, t: np.ndarray, Q: Sides, start: float) -> np.ndarray:
    """Return deflections of one spring with a damper: (N,), at times t (N,).

    Q is that of its joint, (N, 1). Deflections are NaN once they have left the range of the spring.
    """
    # Q at the nodes of each step, by its quintic: (steps, nodes).
    nodes, A = _radau()
    before, after = Q
    h = np.diff(t)[:, None]
    ends = [rate[:-1] for rate in after], [rate[1:] for rate in before]
    forces = np.hstack([hermite.interpolate_hermite(*ends, h, np.full_like(h, u), 0)[0] for u in nodes])
    deflections, (low, high) = [start], spring.range
    for step, force in zip(h[:, 0] / D, forces, strict=True):
        if not low <= deflections[-1] <= high:
            break
        # Newton's method for the deflections x at the stages, x = x0 + (h / D) A (Q - phi(x)), from x0 at the start.
        stages = np.full(len(nodes), deflections[-1])
        for _ in range(_MAX_STAGE_STEPS):
            phi = spring._derivatives(stages)
            residual = stages - deflections[-1] - step * A @ (force - phi[0])
            change = np.linalg.solve(np.eye(len(nodes)) + step * A * phi[1], residual)
            stages = stages - change
            if np.abs(change).max() <= _STAGE_TOLERANCE * np.abs(stages).max():
                break
        # The last stage is the end of the step.
        deflections.append(float(stages[-1]))
    all_times = np.full(len(t), np.nan)
    all_times[: len(deflections)] = deflections
    return np.where((low <= all_times) & (all_times <= high), all_times, np.nan)


@cache
def _radau() -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes and the matrix of a Radau IIA method.

    Its last stage is the end of the step.
    """
    # The nodes are the roots of P_s - P_(s - 1), Legendre's polynomials on 0 .. 1; the matrix integrates polynomials
    # through the stages exactly: A V = W with V = nodes^k, W = nodes^(k + 1) / (k + 1).
    polynomial = np.zeros(_RADAU_STAGES + 1)
    polynomial[-2:] = -1, 1
    nodes = (np.polynomial.legendre.legroots(polynomial) + 1) / 2
    nodes[-1] = 1
    powers = np.arange(_RADAU_STAGES)
    return nodes, nodes[:, None] ** (powers + 1) / (powers + 1) @ np.linalg.inv(nodes[:, None] ** powers)


# Energies at one state.
_PLANT = QUANTITIES["elastic_forward_dynamics"]
STATE = replace(_PLANT, takes=replace(_PLANT.takes, rates=4))  # q, qd, theta, thetad, no forces


class Energy(NamedTuple):
    """The energies of a robot with elastic joints, (...) each, in J."""

    kinetic: Array  # of the links
    rotors: Array
    potential: Array  # of gravity, and of springs that are parallel to the joints
    springs: Array  # between motors and links

    @property
    def total(self) -> Array:
        """Their sum."""
        return self.kinetic + self.rotors + self.potential + self.springs


def energy(robot: Engine, given: Sequence[Any]) -> Energy:
    """Compute the energies in a state q, qd, theta, thetad."""
    _check_elastic(robot, "elastic_energy")
    given, whole = split_rates(robot.mechanism, given)
    names = STATE.takes.motors[:4]
    q, qd, theta, thetad = arrays = scalars.broadcast(convert_rates(robot.mechanism, given, STATE), [1] * 4, names)
    m, positions = cast_model(robot.mechanism, arrays), q if whole is None else whole
    # Motors behind rigid joints have the velocity of the link, whatever theta says.
    e, joints = joint_springs.elasticity_of(m), joint_springs.elasticity_of(m).joints_of_motors
    rigid = joint_springs.elasticity_of(robot.mechanism).of_motors.is_rigid * 1
    v, delta = thetad + rigid * (qd[..., joints] - thetad), (theta - q[..., joints])[..., None]
    rotors = (e.of_motors.rotor * v * v).sum(-1) * 0.5
    # Rotors that turn with the links have more of it than their speed against the links.
    if e.level is not None:
        rotors = rotors + elastic.spin_energy(m, column_series([q, qd]), column_series([theta, thetad]))[0][..., 0, 0]
    return Energy(
        compute(robot, "kinetic_energy", (positions, qd)),
        rotors,
        compute(robot, "potential_energy", (positions,)),
        joint_springs.spring_energy(m, delta)[..., 0, 0],
    )


def damping_error(robot: Engine, given: Sequence[Any], wrench: Any) -> Array:
    """Return the last term of the series of dampers.

    Motor positions with one term less differ by it.
    """
    _check_elastic(robot, "damping_error")
    e = joint_springs.elasticity_of(robot.mechanism)
    if len(e.dampers) == 0:
        raise JounceError(f"{robot.name}: no joint has a damper; robot.elastic(..., damping=...) states one")
    laws = [replace(law, terms=law.terms - 1) if isinstance(law, DampedSpring) else law for law in e.springs]
    fewer = with_mechanism(robot, replace(robot.mechanism, elasticity=replace(e, springs=tuple(laws))))
    both = [compute(x, "motor_positions", given, wrench=wrench) for x in (robot, fewer)]
    theta, other = (x[0] if isinstance(x, tuple) else x for x in both)
    return abs(theta - other)


def _check_elastic(robot: Engine, what: str) -> None:
    """Raise `JounceError` if joints are rigid or the base moves."""
    reason = STATE.obstacle(robot.mechanism)
    if reason:
        raise JounceError(f"{what} of {robot.name!r}{reason}")
    if robot.mechanism.floats:
        raise JounceError(f"{what}: the base of {robot.name!r} moves; expected one at rest")
