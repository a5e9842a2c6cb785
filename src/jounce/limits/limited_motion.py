"""A limited motion evaluates what limits bound, at any times.

`validate_limits` is the door: it refuses a robot without limits, motors without the data that their limits take, and a
motion of other joints, and returns a `LimitedMotion`. `LimitedMotion.channels` evaluates the states at some times once,
and gives by kind of limit the quantity that is bounded: q to q4d, Q to Q2d, power, what motors do, and sums over all
joints, with derivatives, units and bounds. Each kind has its own columns: the joints, or the robot of a sum.
`LIMIT_KINDS` says which rate of the channel a kind bounds. Where the motion knows more rates than limits take
(`needed_orders`), two more derivatives are computed (`orders`), for interpolation in between.

Along measured motions the values have standard deviations, `compute_deviations`: those of rates of q are the motion's
own, those of forces follow from them, and those of voltages are sums over their parts, an upper bound. Once for each
motion, `find_windows` judges by them between which times each kind is known well.

A `LimitedMotion` is frozen: fewer kinds (`select_kinds`), another speed (`scaled`) and windows make another one.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from jounce.arguments import requests
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.dynamics import elastic, loop_closure
from jounce.dynamics.quantities import DEFAULT_QUANTITY, Quantity, find_row
from jounce.engine import along, backends, closed_path, contact_limits
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates, Side
from jounce.limits.joints import (
    column_names,
    column_owner,
    compute_at_speed,
    compute_gravity,
    drives_coordinates,
    drop_base,
    effort_quantity,
    has_motors,
    joint_limits,
    joint_names,
    joint_rates,
    joint_units,
    power_factors,
    scatter_columns,
    scatter_sizes,
)
from jounce.limits.ratios import Scale, build_scale
from jounce.model import positions
from jounce.model.limits import LIMIT_KINDS, Limits, derivative_unit
from jounce.model.mechanism import Mechanism
from jounce.motion import channel, hermite, reliability
from jounce.motion.base import compute_states, perturb_rates
from jounce.motion.channel import Channel, Rates, Span
from jounce.motion.motion import Motion
from jounce.spatial.series import Series, rate_name

HERMITE_DERIVATIVES = 2  # used where they are known: a quintic between samples takes two at each end


@dataclass(frozen=True, eq=False)
class LimitedMotion:
    """A robot along a motion, and the limits that bound it.

    The limits are those of the table `limits`, and `kinds` are those that are checked.

    `windows` are the times between which each kind is known well; kinds without one are along the whole motion.
    Rates of forces jump at `switches`, where limits of contacts begin or end to be active.
    """

    robot: Engine
    motion: Motion
    limits: Limits
    kinds: tuple[str, ...]
    windows: Mapping[str, Span] = field(default_factory=dict)
    switches: tuple[float, ...] = ()

    @property
    def whole(self) -> Span:
        """Return the time from the start of the motion to its end."""
        return self.motion.start, self.motion.stop

    def window(self, kind: str) -> Span:
        """Return the times between which a kind of limit is known well."""
        return self.windows.get(kind, self.whole)

    def select_kinds(self, kinds: Collection[str]) -> "LimitedMotion":
        """Return the same motion with some of the kinds.

        For the same ones again it is the same object, with what is computed of them already.
        """
        selected = tuple(kind for kind in self.kinds if kind in kinds)
        if selected not in self._selections:
            self._selections[selected] = replace(self, kinds=selected)
        return self._selections[selected]

    @cached_property
    def _selections(self) -> dict[tuple[str, ...], "LimitedMotion"]:
        """Return the selections that were made so far, by their kinds."""
        return {}

    def given_times(self, t: Any, factor: float) -> Any:
        """Return the times in this motion of times at another speed.

        The other speed is a factor of the motion's own. Times are numbers or arrays.
        """
        return self.motion.start + (t - self.motion.start) * factor

    def scaled(self, factor: float) -> "LimitedMotion":
        """Return the motion `factor` times as long."""
        stretch = self.given_times
        windows = {
            kind: (stretch(start, factor), stretch(stop, factor)) for kind, (start, stop) in self.windows.items()
        }
        return replace(self, motion=self.motion.scaled(factor), windows=windows)

    @property
    def joints(self) -> tuple[str, ...]:
        """Return the names of the joints, whose values are columns."""
        return joint_names(self.robot.mechanism)

    def names(self, kind: str) -> tuple[str, ...]:
        """Return the names of the columns of a kind."""
        return column_names(self.robot.mechanism, kind)

    def name(self, kind: str, joint: int) -> str:
        """Return the name of one of the columns."""
        return self.names(kind)[joint]

    def owner(self, kind: str, joint: int) -> str:
        """Return whose limit a column is, in words."""
        return column_owner(self.robot.mechanism, kind, joint)

    def unit(self, kind: str, joint: int) -> str:
        """Return the unit of one of the columns."""
        return LIMIT_KINDS[kind].unit(joint_units(self.robot.mechanism)[joint])

    @cached_property
    def scales(self) -> Mapping[str, Scale]:
        """Return the scales of the ratios to the limits, by kind."""
        return {kind: build_scale(self.limits.bounds(kind), kind) for kind in self.kinds}

    @cached_property
    def efforts(self) -> Quantity:
        """Return the row of the forces that effort limits bound."""
        return effort_quantity(self.robot.mechanism)

    @cached_property
    def follow(self) -> bool:
        """Whether limits take joints that follow others in closed loops.

        Limits bound the motion of these joints, or a power that takes it.
        """
        m = self.robot.mechanism
        dependent = [] if m.closure is None else list(m.closure.dependent)
        if m.closure is not None and any("velocity" in power_factors(m, kind) for kind in self.kinds):
            return True
        kinds = [kind for kind in self.kinds if kind in (*LIMIT_KINDS.motion, "power", "stall_effort")]
        return any(np.isfinite(self.limits.bounds(kind)[:, dependent]).any() for kind in kinds)

    @property
    def forces(self) -> bool:
        """Whether any limit bounds forces, power or motors."""
        return any(LIMIT_KINDS[kind].of != "q" for kind in self.kinds)

    @cached_property
    def motion_order(self) -> int:
        """Return the highest rate of q that limits take.

        Higher ones only serve interpolation between times.
        """
        return max(motion_order(self.robot, kind) for kind in self.kinds)

    @cached_property
    def force_rates(self) -> Mapping[str, int]:
        """Return the highest rate of Q that each kind takes.

        The kinds are those of limits of forces, power or motors.
        """
        return {
            kind: motion_order(self.robot, kind) - along.Q_RATE_ORDER
            for kind in self.kinds
            if LIMIT_KINDS[kind].of != "q"
        }

    @cached_property
    def needed_orders(self) -> Mapping[str, int]:
        """Return the quantities that limits take, and of each the highest rate."""
        needed: dict[str, int] = {}
        for kind in self.kinds:
            for name, order in required_quantities(self.robot, kind).items():
                needed[name] = max(needed.get(name, 0), order)
        return needed

    @cached_property
    def orders(self) -> Mapping[str, int]:
        """Return the quantities that limits take, with the highest rate used.

        It is the second where the motion knows enough, for interpolation, and never below what limits take.
        """
        highest, orders = self.motion.highest, {}
        for name, least in self.needed_orders.items():
            orders[name] = HERMITE_DERIVATIVES
            if highest is not None:
                # The k-th rate of a quantity takes k more rates of q than the quantity.
                known_order = highest - self.row(name).takes.rates + 1
                orders[name] = max(least, min(HERMITE_DERIVATIVES, known_order))
        return orders

    @property
    def takes_motors(self) -> bool:
        """Whether limits take what motors behind elastic joints do."""
        return any(name != self.efforts.name for name in self.needed_orders)

    def row(self, name: str) -> Quantity:
        """Return the row of a quantity.

        Springs and motors of the robot may take more rates.
        """
        return _find_row(self.robot, name)

    @property
    def force_order(self) -> int:
        """Return the highest rate of Q that is used."""
        rates_of_Q = DEFAULT_QUANTITY.takes.rates
        return max(order + self.row(name).takes.rates - rates_of_Q for name, order in self.orders.items())

    @property
    def rate_order(self) -> int:
        """Return the highest rate of q that is used."""
        highest = self.motion.highest
        limited = [LIMIT_KINDS[kind].rate for kind in self.kinds if LIMIT_KINDS[kind].of == "q"]
        # Two more rates serve interpolation, as far as the motion knows them.
        order = max((k + HERMITE_DERIVATIVES for k in limited), default=0)
        if highest is not None:
            order = max([*limited, min(order, highest)])
        return max(order, self.force_order + along.Q_RATE_ORDER) if self.forces else order

    def channels(self, t: np.ndarray, side: Side = "right") -> dict[str, Channel]:
        """Evaluate the quantities that are bounded at times (N,).

        Channels are by kind, with derivatives and bounds. What a kind bounds is the rate `LIMIT_KINDS[kind].derivative`
        of its channel, the last one that has bounds.
        """
        with closed_path.name_errors_by_time(t), hermite.limit_rounding_warnings(self.motion_order):
            states = self.states(t, self.orders, self.rate_order, side)
            joints = joint_rates(self.robot, states.rates, states.near, self.follow)
            rates_by_kind = self._motion_rates(joints)
            if self.forces:
                # Each quantity once, for all kinds that take it.
                values = {
                    name: compute_at_speed(self.robot, states, self.row(name), k) for name, k in self.orders.items()
                }
                rates_by_kind |= self._motor_rates(values) | self._force_rates(values, joints, states)
                rates_by_kind |= self._total_rates(values, joints)
        return {kind: self._headings[kind].channel(t, tuple(rates)) for kind, rates in rates_by_kind.items()}

    def _motion_rates(self, joints: Rates) -> dict[str, Sequence[np.ndarray]]:
        """Return what each kind of motion limit bounds, with derivatives."""
        rates_by_kind: dict[str, Sequence[np.ndarray]] = {
            kind: joints[k : k + HERMITE_DERIVATIVES + 1]
            for k, kind in enumerate(LIMIT_KINDS.motion)
            if kind in self.kinds
        }
        m = self.robot.mechanism
        # The derivatives of swings, and of other extents of joints of several screws, are not the velocities.
        if "position" in rates_by_kind and positions.extent_names(m) != m.coordinates:
            rates_by_kind["position"] = joints[:1]
        return rates_by_kind

    def _motor_rates(self, values: Mapping[str, list[np.ndarray]]) -> dict[str, Sequence[np.ndarray]]:
        """Return the quantity and rates of each kind of motor limit.

        The kind bounds one of the rates.
        """
        m = self.robot.mechanism
        return {
            kind: scatter_columns(m, self.motor_values(kind, values), DEFAULT_QUANTITY)
            for kind in LIMIT_KINDS.motor
            if kind in self.kinds
        }

    def _force_rates(
        self, values: Mapping[str, list[np.ndarray]], joints: Rates, states: MotionStates
    ) -> dict[str, Sequence[np.ndarray]]:
        """Return the quantity and rates of each kind of force limit.

        The kind bounds one of the rates.
        """
        kinds = [kind for kind in self.kinds if LIMIT_KINDS[kind].force]
        if len(kinds) == 0:
            return {}
        m, without_gravity = self.robot.mechanism, self.limits.without_gravity
        forces = scatter_columns(m, values[self.efforts.name], self.efforts)
        order = len(forces) - 1
        # Q - Qgrav is computed only where a limit bounds it.
        net_forces = forces
        if any(kind in without_gravity for kind in kinds):
            weight = scatter_columns(m, compute_gravity(self.robot, states, order), self.efforts)
            net_forces = [Q - g for Q, g in zip(forces, weight, strict=True)]
        # As series, laws such as Q qd yield their rates by the product rule.
        Q_series, net_series = Series.of(forces), Series.of(net_forces)
        qd, slope = Series.of(joints[1:]), self.limits.effort_slope
        return {
            kind: LIMIT_KINDS[kind].law(net_series if kind in without_gravity else Q_series, qd, slope).upto(order)
            for kind in kinds
        }

    def _total_rates(self, values: Mapping[str, list[np.ndarray]], joints: Rates) -> dict[str, Sequence[np.ndarray]]:
        """Return the sums over all joints that limits bound.

        They are those of the motors, with their rates by the product rule.
        """
        sums: dict[str, Sequence[np.ndarray]] = {}
        for kind in (kind for kind in self.kinds if LIMIT_KINDS[kind].is_total):
            factors = power_factors(self.robot.mechanism, kind)
            first, second = (self.factor_rates(factor, values, joints) for factor in factors)
            products = (Series.of(first) * Series.of(second)).upto(min(len(first), len(second)) - 1)
            sums[kind] = [x.sum(axis=1, keepdims=True) for x in products]
        return sums

    def factor_rates(self, kind: str, values: Mapping[str, list[np.ndarray]], joints: Rates) -> Sequence[np.ndarray]:
        """Return what a kind bounds of all joints, with its rates.

        Efforts are those of motors, without what a motion lacks at passive joints.
        """
        m, rate = self.robot.mechanism, LIMIT_KINDS[kind].rate
        if LIMIT_KINDS[kind].of == "q":
            return joints[rate:]
        if LIMIT_KINDS[kind].takes:
            return scatter_columns(m, self.motor_values(kind, values), DEFAULT_QUANTITY)[rate:]
        forces = scatter_columns(m, values[self.efforts.name], self.efforts)[rate:]
        return [x * has_motors(m) for x in forces]

    def bounded(self, kind: str, t: np.ndarray, values: np.ndarray) -> Channel:
        """Return a channel of what a kind bounds, without rates.

        The values are (N, n) at times (N,), and the bounds are those of the kind.
        """
        heading, k = self._headings[kind], LIMIT_KINDS[kind].derivative
        units = tuple(channel.divide_by_seconds(unit, k) for unit in heading.units)
        return Channel(rate_name(heading.symbol, k), heading.names, units, t, (values,), bounds=heading.bounds[k:])

    @cached_property
    def _headings(self) -> Mapping[str, "_Heading"]:
        """Return the headings of the channels, made once."""
        units = joint_units(self.robot.mechanism)
        return {kind: _name_columns(self, kind, units[: len(self.names(kind))]) for kind in self.kinds}

    def rates(self, t: np.ndarray, order: int, side: Side = "right") -> Rates:
        """Evaluate the rates of the joints up to an order.

        Each is (N, joints).
        """
        near = closed_path.continue_positions(self.robot, self.motion, t, side)
        with closed_path.name_errors_by_time(t):
            return joint_rates(self.robot, self.motion(t, order, side), near, self.follow)

    def states(self, t: np.ndarray, orders: Mapping[str, int], rates: int, side: Side = "right") -> MotionStates:
        """Sample what quantities take up to an order each.

        The states have at least as many rates of q as `rates` says.
        """
        rows = [(self.row(name), order) for name, order in orders.items()]
        return MotionStates.sample(self.robot, self.motion, t, rows, side, rates)

    def motor_values(self, kind: str, values: Mapping[str, list[np.ndarray]]) -> list[np.ndarray]:
        """Return what a limit of motors bounds, with rates.

        The values follow from positions and torques, and are 0 for motors without data.
        """
        e = self.robot.mechanism.elasticity
        assert e is not None  # else `known_kinds` has no limits of motors
        # Positions and torques are quantities themselves; currents and voltages follow from them by data of the motor.
        if len(LIMIT_KINDS[kind].data) == 0:
            return values[next(iter(LIMIT_KINDS[kind].takes))]
        currents, voltages = elastic.electrical_outputs(e, values.get("motor_positions", ()), values["motor_torques"])
        outputs = voltages if LIMIT_KINDS[kind].of == "u" else currents
        return [] if outputs is None else [np.nan_to_num(x) for x in outputs]

    def values(self, t: np.ndarray, side: Side = "right") -> dict[str, np.ndarray]:
        """Evaluate what limits bound, by kind, without derivatives."""
        channels = self.channels(t, side)
        return {kind: channel.rates[LIMIT_KINDS[kind].derivative] for kind, channel in channels.items()}


class _Heading(NamedTuple):
    """What a channel has at any times: its symbol, columns and bounds."""

    symbol: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    bounds: Rates

    def channel(self, t: np.ndarray, rates: Rates) -> Channel:
        """Return the channel of rates (N, n) at times (N,)."""
        return Channel(self.symbol, self.names, self.units, t, rates, bounds=self.bounds)


def _name_columns(b: LimitedMotion, kind: str, units: Sequence[str]) -> _Heading:
    """Return the heading of a kind of limit.

    It is that of the quantity of which the kind bounds a rate; lower rates have no bounds.
    """
    row, limits = LIMIT_KINDS[kind], b.limits.bounds(kind)
    first = row.rate - row.derivative
    symbol = row.of
    if kind in LIMIT_KINDS.effort:
        symbol = b.limits.of(kind)
    elif row.line:
        symbol += " at stall"
    unbounded = np.full_like(limits, np.inf) * [[-1], [1]]
    return _Heading(
        rate_name(f"({symbol})" if " " in symbol else symbol, first),
        b.names(kind),
        tuple(derivative_unit(row.of, first, unit) for unit in units),
        (*[unbounded] * row.derivative, limits),
    )


def known_kinds(robot: Engine, limits: Limits) -> tuple[str, ...]:
    """Return the kinds of limits that are checked along a motion.

    Those of motors are checked only where joints are elastic.
    """
    return tuple(kind for kind in limits.kinds if not LIMIT_KINDS[kind].takes or robot.mechanism.elasticity is not None)


def required_quantities(robot: Engine, kind: str) -> Mapping[str, int]:
    """Return the quantities that a kind of limit takes.

    The highest rate of each is its value. Limits of the motion take none.
    """
    row, e = LIMIT_KINDS[kind], robot.mechanism.elasticity
    if row.of == "q":
        return {}
    if row.is_total:
        of_factors = [required_quantities(robot, factor) for factor in power_factors(robot.mechanism, kind)]
        return {name: max(x.get(name, 0) for x in of_factors) for x in of_factors for name in x}
    if row.force:
        return {effort_quantity(robot.mechanism).name: row.rate}
    quantities = dict(row.takes)
    # The voltage of an inductance takes the rate of the current.
    if kind == "motor_voltage" and e is not None and e.is_inductive:
        quantities["motor_torques"] = 1
    return quantities


def motion_order(robot: Engine, kind: str) -> int:
    """Return the highest rate of q in a limited value."""
    rows = required_quantities(robot, kind)
    return max(
        (_find_row(robot, name).takes.rates - 1 + order for name, order in rows.items()), default=LIMIT_KINDS[kind].rate
    )


def _find_row(robot: Engine, name: str) -> Quantity:
    """Return the row of a quantity.

    Springs and motors of a robot may take more rates.
    """
    return find_row(name, requests.count_more_rates(robot.mechanism, name))


def required_order(robot: Engine) -> int:
    """Return the highest rate of Q that limits take.

    A motion must carry q to q2d for the order 0, q to q4d for 2.
    """
    kinds = known_kinds(robot, joint_limits(robot.mechanism))
    return max([0, *(motion_order(robot, kind) - along.Q_RATE_ORDER for kind in kinds)])


# Checks of a robot along a motion.
LIMITS_CURE = Remedy(
    "; use robot.with_limits(NAME), published limits of an arm, or robot.with_limits(effort=..., velocity=...)",
    "; use --limits ARM, published limits of an arm, or --limits FILE",
)
MOTOR_CURE = Remedy("; robot.elastic(motors={joint: jounce.Motor(...)}) states it", "; state it in its file")


def validate_limits(robot: Engine, motion: object) -> LimitedMotion:
    """Check a robot along a motion, and return both with limits.

    The limits are those of the coordinates. A robot without any limits is refused.
    """
    path, limits = along.check_motion(robot.mechanism, motion), joint_limits(robot.mechanism)
    kinds = known_kinds(robot, limits)
    if len(kinds) == 0 and not contact_limits.are_limited(robot.mechanism):
        if len(limits.kinds) > 0:
            came = f"robot {robot.name!r} has no limits of rigid joints, only {join_names(limits.kinds)}"
            raise JounceError(f"{came}{Remedy('; robot.elastic(stiffness) makes its joints elastic')}")
        raise JounceError(f"robot {robot.name!r} has no limits{LIMITS_CURE}")
    check_motor_data(robot, kinds)
    _check_stiffness(robot, kinds)
    check_gravity(robot.mechanism, limits, kinds)
    b = LimitedMotion(robot, path, limits, kinds)
    return replace(b, windows=find_windows(b))


def check_motor_data(robot: Engine, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where a limited motor states no data.

    Limits of currents and voltages take data.
    """
    limits, e, places = joint_limits(robot.mechanism), robot.mechanism.elasticity, robot.mechanism.independent_places
    for kind in kinds:
        # A sum over all joints takes the data of every motor.
        limited = np.arange(len(places))
        if not LIMIT_KINDS[kind].is_total:
            limited = np.flatnonzero(np.isfinite(limits.bounds(kind)[:, list(places)]).any(axis=0))
        for j in limited.tolist():
            motor = None if e is None or len(e.motors) == 0 else e.motors[j]
            lacking = [name for name in LIMIT_KINDS[kind].data if motor is None or getattr(motor, name) is None]
            if len(lacking) > 0:
                joint = f"joint {quote_value(robot.joint_names[j])}"
                limited_motor = f"{joint} has a limit of {kind}, and its motor"
                if LIMIT_KINDS[kind].is_total:
                    limited_motor = f"the robot has a limit of {kind}, and the motor of {joint}"
                raise JounceError(f"{limited_motor} states no {' and no '.join(lacking)}{MOTOR_CURE}")


def _check_stiffness(robot: Engine, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where a limited motor may move infinitely fast between times.

    A spring without stiffness at rest lets it.
    """
    e, forces_of_links = robot.mechanism.elasticity, effort_quantity(robot.mechanism).name
    motor_kinds = [kind for kind in kinds if required_quantities(robot, kind).keys() - {forces_of_links}]
    if e is not None and len(e.slack) > 0 and len(motor_kinds) > 0:
        raise JounceError(
            f"joint {quote_value(robot.joint_names[e.slack[0]])}: its spring has no stiffness at rest, and its motor"
            f" moves infinitely fast where no force acts; limits of {join_names(motor_kinds)} need a"
            " CubicSpring with k above 0"
        )


def check_gravity(m: Mechanism, limits: Limits, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where limits bound motor forces less gravity elsewhere.

    Gravity forces are those of the coordinates: motors have to be there.
    """
    without = [kind for kind in kinds if kind in limits.without_gravity]
    if len(without) > 0 and not drives_coordinates(m):
        raise JounceError(
            f"{m.name!r}: limits of {join_names(without)} bound Q - Qgrav, which is not known for motors at other"
            f" joints than the coordinates {join_names(m.coordinates)}; state them for Q"
            f"{Remedy(' (of=), or name these joints by robot.closed(actuated=...)')}"
        )


# Deviations along measured motions, and between which times they are small.
Deviations = dict[str, np.ndarray]  # by kind, (N, joints); NaN where they are not known


def is_measured(motion: Motion) -> bool:
    """Whether positions, loads or a base along a motion have deviations."""
    curves = [motion.curve, *motion.loads.values()]
    if motion.base_curve is not None:
        curves.append(motion.base_curve)
    return any(curve.deviations(motion.times[:1], 0) is not None for curve in curves)


def compute_deviations(b: LimitedMotion, t: np.ndarray) -> Deviations:
    """Compute standard deviations at times (N,), without the kinds that are exact."""
    if not is_measured(b.motion):
        return {}
    rates = _rate_deviations(b, t, max([1, *(motion_order(b.robot, kind) for kind in b.kinds)]))
    # Power and stall efforts take velocities, which are exact where only loads or a base are measured.
    off = rates[1] if len(rates) > 0 else np.zeros((len(t), len(b.joints)))
    by_kind = dict(zip(LIMIT_KINDS.motion, rates, strict=False))
    by_kind |= _force_deviations(b, t, off) | _motor_deviations(b, t)
    by_kind |= _total_deviations(b, t, off)
    return {kind: by_kind[kind] for kind in b.kinds if kind in by_kind}


def _rate_deviations(b: LimitedMotion, t: np.ndarray, order: int) -> Sequence[np.ndarray]:
    """Compute the deviations of q, qd, ... of all joints.

    Each is (N, joints); an exact q has no deviations. Joints that follow others in closed loops, and swings, have what
    each rate of q makes of its own deviation.
    """
    m, motion = b.robot.mechanism, b.motion
    rates = motion.deviations(t, order)
    if rates is None:
        return ()
    if m.closure is None and len(positions.multiscrew_joints(m.tree)) == 0:
        return rates
    # Propagation of independent errors: move each coordinate by its deviation, close the loops, and add the squares
    # of what moves: (rates, N, joints).
    highest = max([1, *(LIMIT_KINDS[kind].rate for kind in b.kinds if LIMIT_KINDS[kind].of == "q")])
    meaning = partial(compute_states, motion.several)
    unmoved, total = b.rates(t, highest), np.zeros((highest + 1, len(t), len(b.joints)))
    near = closed_path.continue_positions(b.robot, motion, t)
    for moved in perturb_rates(motion.curve, t, highest, meaning):
        close = None
        if near is not None:
            close = loop_closure.close_loops(m, moved[0], near, backends.closing_step(b.robot))
        joints = joint_rates(b.robot, moved, close, b.follow)
        total += np.square([x - y for x, y in zip(joints, unmoved, strict=True)])
    return tuple(np.sqrt(total))


def _force_deviations(b: LimitedMotion, t: np.ndarray, off: np.ndarray) -> Deviations:
    """Compute the deviations of efforts with rates, power and stall efforts.

    `off` (N, joints) are those of velocities.
    """
    kinds = [kind for kind in b.kinds if LIMIT_KINDS[kind].force]
    if len(kinds) == 0:
        return {}
    sampled = _sample_deviations(b, t, b.efforts, max(LIMIT_KINDS[kind].rate for kind in kinds))
    m, (deviations, forces) = b.robot.mechanism, sampled
    spread, Q = scatter_sizes(m, deviations, b.efforts), scatter_columns(m, forces, b.efforts)
    if len(spread) == 0:
        return {}
    by_kind = {kind: spread[LIMIT_KINDS[kind].rate] for kind in kinds}
    # Errors of a product: qd dQ, Q dqd and, where both are off, dQ dqd.
    if "power" in b.kinds:
        parts = b.rates(t, 1)[1] * spread[0], Q[0] * off, spread[0] * off  # the last where both are off
        by_kind["power"] = np.sqrt(np.sum(np.square(parts), axis=0))
    if "stall_effort" in b.kinds:
        by_kind["stall_effort"] = np.hypot(spread[0], b.limits.effort_slope * off)
    return by_kind


def _motor_deviations(b: LimitedMotion, t: np.ndarray) -> Deviations:
    """Compute the deviations of motors.

    Those of voltages are sums over their parts, an upper bound.
    """
    by_kind = {}
    for kind in LIMIT_KINDS.motor:
        if kind in b.kinds:
            # What motors do is linear in the quantities: the law of the values holds for deviations.
            spread = {
                name: _sample_deviations(b, t, b.row(name), k)[0]
                for name, k in required_quantities(b.robot, kind).items()
            }
            if all(len(rates) > 0 for rates in spread.values()):
                of_motor = b.motor_values(kind, spread)[LIMIT_KINDS[kind].rate]
                [by_kind[kind]] = scatter_columns(b.robot.mechanism, [np.abs(of_motor)], DEFAULT_QUANTITY)
    return by_kind


def _total_deviations(b: LimitedMotion, t: np.ndarray, off: np.ndarray) -> Deviations:
    """Compute the deviations of sums over all joints.

    `off` (N, joints) are those of velocities. Errors of joints and factors depend on each other: their sizes are added,
    an upper bound.
    """
    by_kind = {}
    for kind in (kind for kind in b.kinds if LIMIT_KINDS[kind].is_total):
        factors = power_factors(b.robot.mechanism, kind)
        sampled = {
            name: _sample_deviations(b, t, b.row(name), order)
            for name, order in required_quantities(b.robot, kind).items()
        }
        if not all(len(spread) > 0 for spread, _ in sampled.values()):
            continue
        spread, values = ({name: x[side] for name, x in sampled.items()} for side in (0, 1))
        joints, joints_off = b.rates(t, 1), (np.zeros_like(off), off)
        A, B = (np.abs(b.factor_rates(factor, values, joints)[0]) for factor in factors)
        dA, dB = (np.abs(b.factor_rates(factor, spread, joints_off)[0]) for factor in factors)
        by_kind[kind] = (A * dB + dA * B + dA * dB).sum(axis=1, keepdims=True)
    return by_kind


def _sample_deviations(
    b: LimitedMotion, t: np.ndarray, row: Quantity, order: int
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Compute the deviations of a quantity with its rates, and the quantity.

    A quantity that is exact has no deviations.
    """
    parts = list(along.compute_pieces(b.robot, b.motion, t, order, options=along.ForceOptions(row=row)))
    # Each part has its rates at some of the times: join the times of each rate.
    deviations = [() if part.deviations is None else part.deviations for part in parts]
    values = [part.forces for part in parts]
    joined = (tuple(map(np.concatenate, zip(*rates, strict=True))) for rates in (deviations, values))
    joined_deviations, joined_values = joined
    return drop_base(b.robot.mechanism, joined_deviations, row), drop_base(b.robot.mechanism, joined_values, row)


def find_windows(b: LimitedMotion) -> dict[str, Span]:
    """Find the times between which each kind is known well.

    Kinds that are known well along the whole motion have none.
    """
    times = b.motion.times
    t = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), reliability.MAX_WINDOW_TIMES)).astype(int))]
    windows = {kind: reliability.find_window(t, off) for kind, off in compute_deviations(b, t).items()}
    return {kind: span for kind, span in windows.items() if span != (t[0], t[-1])}
