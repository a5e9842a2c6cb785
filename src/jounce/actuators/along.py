"""Motor positions and torques along a motion.

They follow from the state of the links, unless springs have dampers or joints two motors. Deflections of dampers are
integrated, and tau then takes one rate of Q less than without a damper.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jounce.actuators import damping
from jounce.arguments.elasticity import convert_stiffness
from jounce.arguments.rates import check_order, find_rates
from jounce.arguments.requests import check_existence
from jounce.core.cures import Remedy
from jounce.core.display import HtmlDisplay
from jounce.core.errors import JounceError, quote_value
from jounce.core.typing import ArrayLike
from jounce.dynamics import elastic, electrical
from jounce.dynamics.joint_springs import elasticity_of, with_stiffness
from jounce.dynamics.quantities import QUANTITIES, Quantity, find_row
from jounce.engine.along import Along, ForceBreak, Progress, forces_along
from jounce.engine.engine import Engine
from jounce.engine.motion_channels import quantity_units
from jounce.model.coordinates import coordinate_units
from jounce.model.elasticity import Elasticity, motor_names
from jounce.model.mechanism import Mechanism
from jounce.model.spring_deflection import UnreachableError
from jounce.motion.channel import Channel, Rates, print_channels
from jounce.motion.motion import Motion
from jounce.spatial.series import column_series

REST_SPEED_SHARE = (
    1e-6  # of the largest velocity of links, or of motors: what is slower rests, to the rounding of its rates
)
_POSITION_ROW, _TORQUE_ROW = QUANTITIES["motor_positions"], QUANTITIES["motor_torques"]
_ELECTRIC_ROWS = ("motor_currents", "motor_voltages")


@dataclass(frozen=True, eq=False, repr=False)
class ElasticAlong(HtmlDisplay):
    """Motor positions and torques along a motion, and the states that they belong to. `Robot.motors_along` makes one.

    It holds channels; `t`, `rates`, `positions`, `torques`, ... are the arrays in them.

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
        """Motor positions theta, thetad, theta2d, ..., (N, n) each, seen from the links: rad or m, per s, ..."""
        return self.motors[0].rates

    @property
    def torques(self) -> Rates:
        """Motor torques tau, taud, ..., (N, n) each: N m, or N for coordinates in m, per s, ..."""
        return self.motors[1].rates

    @property
    def deviations(self) -> Rates | None:
        """Standard deviations of the torques that follow from those of q, qd, ...; None where these are exact."""
        return self.motors[1].deviations

    @property
    def breaks(self) -> tuple[ForceBreak, ...]:
        """Times at which tau or one of its rates jumps or does not exist, with order, jump and causes."""
        return tuple(found for found in self.motors[1].breaks if isinstance(found, ForceBreak))

    @property
    def currents(self) -> Rates | None:
        """Currents i, id, ... in A, per s, ..., (N, n) each, NaN for motors without a torque constant, or None."""
        return self._find("i")

    @property
    def voltages(self) -> Rates | None:
        """Voltages u, ud, ... in V, per s, ..., (N, n) each, NaN for motors without a torque constant, or None.

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
        return print_channels("ElasticAlong", self.channels, self.notes)


def motors_along(
    robot: Engine,
    motion: Motion,
    t: ArrayLike | None = None,
    order: int = 0,
    stiffness: Any = None,
    method: str | None = None,
    progress: Progress | None = None,
) -> ElasticAlong:
    """Motor positions, and motor torques up to an order, along a motion of a robot with elastic joints."""
    moves = isinstance(motion, Motion) and motion.base_curve is not None
    check_existence(robot.mechanism, _POSITION_ROW.name, moves or robot.mechanism.floats, "motors_along")
    m, e, options = robot.mechanism, elasticity_of(robot.mechanism), (method, progress)
    if not e.pairs:
        convert_stiffness(m, stiffness, 1)  # none, or an error
    if (e.dampers and e.level is None) or e.pairs:
        links, theta, tau = _integrate_motors(robot, motion, t, check_order(order), stiffness, *options)
        notes = _describe_ends(robot, motion, links, theta[1])
        torque = motor_channel(m, _TORQUE_ROW, links.t, tau, breaks=links.breaks)
        return ElasticAlong(links.coordinates, motor_channels(m, theta, torque), notes)
    try:
        rows = [find_row(row.name, e.more_rates) for row in (_POSITION_ROW, _TORQUE_ROW)]
        found = forces_along(robot, motion, t, order, *options, rows[1])
        highest = len(found.rates) - rows[0].takes.rates
        theta = forces_along(robot, motion, found.t, highest, method, None, rows[0]).forces
    except UnreachableError:
        _integrate_motors(robot, motion, t, check_order(order), None, *options)  # which reports the time
        raise
    _check_stiffness_between(robot.mechanism, found.t, theta[0] - found.rates[0])
    notes = _describe_ends(robot, motion, found, theta[1])
    torque = motor_channel(m, _TORQUE_ROW, found.t, found.forces, found.deviations, found.breaks)
    return ElasticAlong(found.coordinates, motor_channels(m, theta, torque), notes)


def motor_channels(m: Mechanism, theta: Rates, torque: Channel) -> tuple[Channel, ...]:
    """theta and tau, and of motors that state their data i and u."""
    e, t = elasticity_of(m), torque.times
    found = [motor_channel(m, _POSITION_ROW, t, theta), torque]
    for name, rates in zip(_ELECTRIC_ROWS, electrical.outputs(e, theta, torque.rates), strict=True):
        if rates:
            found.append(motor_channel(m, QUANTITIES[name], t, rates))
    return tuple(found)


def motor_channel(
    m: Mechanism,
    row: Quantity,
    t: np.ndarray,
    rates: Rates,
    deviations: Rates | None = None,
    breaks: tuple[ForceBreak, ...] = (),
) -> Channel:
    """What motors do, one or two of each joint, at times (N,)."""
    e, units = elasticity_of(m), quantity_units(m, row)
    of_motors = tuple(units[j] for j in e.joints_of_motors)
    return Channel(row.gives.symbol, motor_names(e, m.coordinates), of_motors, t, rates, deviations, (), breaks)


def _describe_ends(robot: Engine, motion: Motion, links: Along, thetad: np.ndarray) -> tuple[str, ...]:
    """The motor that moves fastest at an end of a motion where all links rest: its velocity jumps there."""
    m, qd, found = robot.mechanism, np.abs(links.rates[1]), list[tuple[float, int, float, str]]()
    for t, verb in ((motion.start, "start"), (motion.stop, "stop")):
        for i in np.flatnonzero(links.t == t).tolist():
            speed = np.abs(thetad[i])
            if qd[i].max() <= REST_SPEED_SHARE * qd.max() and speed.max() > REST_SPEED_SHARE * np.abs(thetad).max():
                found.append((float(speed.max()), int(speed.argmax()), t, verb))
    if not found:
        return ()
    speed, j, t, verb = max(found)
    joint = motor_names(elasticity_of(m), m.coordinates)[j]
    unit = f"{coordinate_units(m)[m.coordinates.index(joint)]}/s" if joint in m.coordinates else "rad/s or m/s"
    return (
        f"the motor of {joint} would have to {verb} at {speed:.2g} {unit} at t = {t:.6g} s, where the links rest and"
        " their jerk is not zero; plan a motion whose q3d is 0 at both ends, as polynomials of degree 7 have it:"
        f" {Remedy('motion.blended(time)', '--blend S')} replaces breaks between the ends alone",
    )


def _check_stiffness_between(m: Mechanism, t: np.ndarray, deflections: np.ndarray) -> None:
    """Raise `JounceError` where a spring without stiffness at rest turns round between two times."""
    order = np.argsort(t)
    for j in elasticity_of(m).slack:
        signs = np.sign(deflections[order, j])
        turned = np.flatnonzero(signs[:-1] * signs[1:] < 0)
        if turned.size:
            before, after = t[order][turned[0] : turned[0] + 2]
            raise JounceError(
                f"joint {quote_value(m.coordinates[j])}: the force of its spring crosses zero between t = {before:g} s"
                f" and {after:g} s, where the spring has no stiffness and its motor would move infinitely fast; give"
                " CubicSpring a k above 0"
            )


def voltage_order(e: Elasticity, known: int | None) -> int:
    """The rate of the torques that voltages take: the first with inductances, if rates of q are known so far."""
    return int(e.is_inductive and (known is None or known >= 5 + e.more_rates))


def _integrate_motors(
    robot: Engine,
    motion: Motion,
    t: ArrayLike | None,
    order: int,
    stiffness: Any,
    method: str | None,
    progress: Progress | None,
) -> tuple[Along, Rates, Rates]:
    """The forces of the links along a motion, and the motor positions and torques (N, m) from forces of all times."""
    m, e = robot.mechanism, elasticity_of(robot.mechanism)
    shift = 1 if len(e.dampers) == m.n else 2
    links = forces_along(robot, motion, t, order + shift, method, progress)
    q, Q = column_series(links.rates), column_series([force[:, -m.n :] for force in links.forces])
    inputs = with_stiffness(m, column_series(_stiffness_over_time(robot, stiffness, len(links.t), order + 3)))
    try:
        inputs = replace(inputs, deflections=damping.integrate_deflections(robot, motion, links.t, method))
        theta, phi = elastic.motor_positions(m, q, lambda _: Q, inputs)
        tau = elastic.motor_torques(m, q, theta, phi)
        found = [[x[..., 0] for x in series.upto(k)] for series, k in ((theta, order + 2), (tau, order))]
    except UnreachableError as error:
        raise JounceError(f"{error}, at t = {links.t[error.state]:g} s") from None
    breaks = tuple(ForceBreak(b.t, max(b.order - shift, -1), None, b.causes) for b in links.breaks)
    efforts = replace(links.efforts, breaks=breaks)
    return replace(links, efforts=efforts), tuple(found[0]), tuple(found[1])


def _stiffness_over_time(robot: Engine, given: Any, times: int, count: int) -> list[np.ndarray]:
    """S, Sd, ... (N, k) at the times; one number, row or mapping alone is constant."""
    m = robot.mechanism
    if not elasticity_of(m).pairs:
        return []
    if given is not None and find_rates(given) is None:
        (constant,) = convert_stiffness(m, given, 1)
        if constant.ndim == 1:
            return [np.tile(constant * (k == 0), (times, 1)) for k in range(count)]
    S = convert_stiffness(m, given, count)
    for term in S:
        if term.shape[:-1] != (times,):
            raise JounceError(
                f"stiffness has shape {term.shape}; expected ({times}, {term.shape[-1]}), as many as times"
            )
    return S
