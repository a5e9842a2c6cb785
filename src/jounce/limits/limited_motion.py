"""A limited motion holds what limits bound along a motion, at any times.

`validate_limits` is the door: it refuses a robot without limits, motors without the data that their limits take, and a
motion of other joints, and returns a `LimitedMotion`. `LimitedMotion.channels` evaluates the states at some times once,
and gives by kind of limit the quantity that is bounded: q to q4d, Q to Q2d, power, and what motors do, with
derivatives, units and bounds. `LIMIT_KINDS` says which rate of the channel a kind bounds. Where the motion knows more
rates than limits take (`needed_orders`), two more derivatives are computed (`orders`), for interpolation in between.

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
    compute_at_speed,
    compute_gravity,
    drives_coordinates,
    drop_base,
    effort_quantity,
    joint_limits,
    joint_names,
    joint_rates,
    joint_units,
    scatter_columns,
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
    """A robot along a motion, and the kinds of limits that bound any joint, which are `limits`.

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
        """The time from the start of the motion to its end."""
        return self.motion.start, self.motion.stop

    def window(self, kind: str) -> Span:
        """The times between which a kind of limit is known well."""
        return self.windows.get(kind, self.whole)

    def select_kinds(self, kinds: Collection[str]) -> "LimitedMotion":
        """The same motion and some of the kinds; for the same ones again, with what is computed of them already."""
        kept = tuple(kind for kind in self.kinds if kind in kinds)
        if kept not in self._selections:
            self._selections[kept] = replace(self, kinds=kept)
        return self._selections[kept]

    @cached_property
    def _selections(self) -> dict[tuple[str, ...], "LimitedMotion"]:
        return {}

    def given_times(self, t: Any, factor: float) -> Any:
        """The times in this motion of times, numbers or arrays, at a factor of its speed."""
        return self.motion.start + (t - self.motion.start) * factor

    def scaled(self, factor: float) -> "LimitedMotion":
        """The motion `factor` times as long."""
        at = self.given_times
        windows = {kind: (at(start, factor), at(stop, factor)) for kind, (start, stop) in self.windows.items()}
        return replace(self, motion=self.motion.scaled(factor), windows=windows)

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of the joints, whose values are columns."""
        return joint_names(self.robot.mechanism)

    def names(self, kind: str) -> tuple[str, ...]:
        """The names of what limits bound: the joints, or of positions the extents of joints of several screws."""
        return positions.extent_names(self.robot.mechanism.tree) if kind == "position" else self.joints

    def name(self, kind: str, joint: int) -> str:
        """The name of one of them."""
        return self.names(kind)[joint]

    @cached_property
    def scales(self) -> Mapping[str, Scale]:
        """The scales of the ratios to the limits."""
        return {kind: build_scale(self.limits.bounds(kind), kind) for kind in self.kinds}

    @cached_property
    def efforts(self) -> Quantity:
        """The row of the forces that effort limits bound."""
        return effort_quantity(self.robot.mechanism)

    @cached_property
    def follow(self) -> bool:
        """Whether the motion of joints that follow others in closed loops is limited, or enters a power."""
        m = self.robot.mechanism
        others = list(m.closure.dependent) if m.closure else []
        kinds = [kind for kind in self.kinds if kind in (*LIMIT_KINDS.motion, "power", "stall_effort")]
        return any(np.isfinite(self.limits.bounds(kind)[:, others]).any() for kind in kinds)

    @property
    def forces(self) -> bool:
        """Whether any limit bounds forces, power or motors."""
        return any(LIMIT_KINDS[kind].of != "q" for kind in self.kinds)

    @cached_property
    def motion_order(self) -> int:
        """The highest rate of q that limits take; higher ones only serve interpolation between times."""
        return max(motion_order(self.robot, kind) for kind in self.kinds)

    @cached_property
    def force_rates(self) -> Mapping[str, int]:
        """The highest rate of Q that each kind of limit of forces, power or motors takes."""
        return {
            kind: motion_order(self.robot, kind) - along.Q_RATE_ORDER
            for kind in self.kinds
            if LIMIT_KINDS[kind].of != "q"
        }

    @cached_property
    def needed_orders(self) -> Mapping[str, int]:
        """The quantities that limits take, and of each the highest rate."""
        needed: dict[str, int] = {}
        for kind in self.kinds:
            for name, order in required_quantities(self.robot, kind).items():
                needed[name] = max(needed.get(name, 0), order)
        return needed

    @cached_property
    def orders(self) -> Mapping[str, int]:
        """The same quantities, and of each the highest rate used: the second where the motion knows enough."""
        known = self.motion.highest
        return {
            name: HERMITE_DERIVATIVES
            if known is None
            else max(least, min(HERMITE_DERIVATIVES, known - self.row(name).takes.rates + 1))
            for name, least in self.needed_orders.items()
        }

    def row(self, name: str) -> Quantity:
        """The row of a quantity, for the springs and motors of the robot."""
        return _find_row(self.robot, name)

    @property
    def force_order(self) -> int:
        """The highest rate of Q that is used."""
        own = DEFAULT_QUANTITY.takes.rates
        return max(order + self.row(name).takes.rates - own for name, order in self.orders.items())

    @property
    def rate_order(self) -> int:
        """The highest rate of q that is used."""
        known = self.motion.highest
        ways = [LIMIT_KINDS[kind].rate for kind in self.kinds if LIMIT_KINDS[kind].of == "q"]
        smooth = max((k + HERMITE_DERIVATIVES for k in ways), default=0)
        order = smooth if known is None else max([*ways, min(smooth, known)])
        return max(order, self.force_order + along.Q_RATE_ORDER) if self.forces else order

    def channels(self, t: np.ndarray, side: Side = "right") -> dict[str, Channel]:
        """The quantities that are bounded, by kind, with derivatives and bounds, at times (N,).

        What a kind bounds is the rate `LIMIT_KINDS[kind].derivative` of its channel, the last one that has bounds.
        """
        with closed_path.name_errors_by_time(t), hermite.limit_rounding_warnings(self.motion_order):
            states = self.states(t, self.orders, self.rate_order, side)
            joints = joint_rates(self.robot, states.rates, states.near, self.follow)
            found = self._motion_rates(joints)
            if self.forces:
                values = {
                    name: compute_at_speed(self.robot, states, self.row(name), k) for name, k in self.orders.items()
                }
                found |= self._motor_rates(values) | self._force_rates(values, joints, states)
        return {kind: self._headings[kind].channel(t, tuple(rates)) for kind, rates in found.items()}

    def _motion_rates(self, joints: Rates) -> dict[str, Sequence[np.ndarray]]:
        """By kind of limit of the motion, what it bounds and its derivatives."""
        found: dict[str, Sequence[np.ndarray]] = {
            kind: joints[k : k + HERMITE_DERIVATIVES + 1]
            for k, kind in enumerate(LIMIT_KINDS.motion)
            if kind in self.kinds
        }
        m = self.robot.mechanism
        if "position" in found and positions.extent_names(m) != m.coordinates:
            found["position"] = joints[:1]  # swings, ... whose rates are not the velocities
        return found

    def _motor_rates(self, values: Mapping[str, list[np.ndarray]]) -> dict[str, Sequence[np.ndarray]]:
        """By kind of limit of motors, the quantity of which it bounds a rate, and its rates."""
        m = self.robot.mechanism
        return {
            kind: scatter_columns(m, self.motor_values(kind, values), DEFAULT_QUANTITY)
            for kind in LIMIT_KINDS.motor
            if kind in self.kinds
        }

    def _force_rates(
        self, values: Mapping[str, list[np.ndarray]], joints: Rates, states: MotionStates
    ) -> dict[str, Sequence[np.ndarray]]:
        """By kind of limit of forces, the quantity of which it bounds a rate, and its rates."""
        kinds = [kind for kind in self.kinds if LIMIT_KINDS[kind].force]
        if not kinds:
            return {}
        m, whole, without = self.robot.mechanism, values[self.efforts.name], self.limits.without_gravity
        forces = {False: scatter_columns(m, whole, self.efforts)}  # by whether gravity is left out
        order = len(forces[False]) - 1
        if any(kind in without for kind in kinds):
            weight = scatter_columns(m, compute_gravity(self.robot, states, order), self.efforts)
            forces[True] = [Q - g for Q, g in zip(forces[False], weight, strict=True)]
        of = {gone: Series.of(Q) for gone, Q in forces.items()}
        qd, slope = Series.of(joints[1:]), self.limits.effort_slope
        return {kind: LIMIT_KINDS[kind].law(of[kind in without], qd, slope).upto(order) for kind in kinds}

    def bounded(self, kind: str, t: np.ndarray, values: np.ndarray) -> Channel:
        """A channel of values (N, n) of what a kind bounds at times (N,), with its bounds and without rates."""
        heading, k = self._headings[kind], LIMIT_KINDS[kind].derivative
        units = tuple(channel.divide_by_seconds(unit, k) for unit in heading.units)
        return Channel(rate_name(heading.symbol, k), heading.names, units, t, (values,), bounds=heading.bounds[k:])

    @cached_property
    def _headings(self) -> Mapping[str, "_Heading"]:
        units = joint_units(self.robot.mechanism)
        return {kind: _name_columns(self, kind, units) for kind in self.kinds}

    def rates(self, t: np.ndarray, order: int, side: Side = "right") -> Rates:
        """The rates of the joints up to an order, (N, joints) each."""
        near = closed_path.continue_positions(self.robot, self.motion, t, side)
        with closed_path.name_errors_by_time(t):
            return joint_rates(self.robot, self.motion(t, order, side), near, self.follow)

    def states(self, t: np.ndarray, orders: Mapping[str, int], rates: int, side: Side = "right") -> MotionStates:
        """What quantities take up to an order each, and at least some rates of q."""
        rows = [(self.row(name), order) for name, order in orders.items()]
        return MotionStates.sample(self.robot, self.motion, t, rows, side, rates)

    def motor_values(self, kind: str, values: Mapping[str, list[np.ndarray]]) -> list[np.ndarray]:
        """What a limit of motors bounds, with rates, of positions and torques; 0 for motors without data."""
        e = self.robot.mechanism.elasticity
        assert e is not None  # else `known_kinds` has no limits of motors
        if LIMIT_KINDS[kind].data:
            both = elastic.electrical_outputs(e, values.get("motor_positions", ()), values["motor_torques"])
            return [np.nan_to_num(x) for x in both[LIMIT_KINDS[kind].of == "u"] or ()]
        return values[next(iter(LIMIT_KINDS[kind].takes))]

    def values(self, t: np.ndarray, side: Side = "right") -> dict[str, np.ndarray]:
        """The quantities alone."""
        return {kind: found.rates[LIMIT_KINDS[kind].derivative] for kind, found in self.channels(t, side).items()}


class _Heading(NamedTuple):
    """What a channel says at any times: its symbol, columns and bounds."""

    symbol: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    bounds: Rates

    def channel(self, t: np.ndarray, rates: Rates) -> Channel:
        """The channel of rates (N, n) at times (N,)."""
        return Channel(self.symbol, self.names, self.units, t, rates, bounds=self.bounds)


def _name_columns(b: LimitedMotion, kind: str, units: Sequence[str]) -> _Heading:
    """The symbol of the quantity of which a kind of limit bounds a rate, its columns, and the bounds of its rates."""
    row, limits = LIMIT_KINDS[kind], b.limits.bounds(kind)
    first = row.rate - row.derivative
    of = b.limits.of(kind) if kind in LIMIT_KINDS.effort else row.of + " at stall" * row.line
    free = np.full_like(limits, np.inf) * [[-1], [1]]
    return _Heading(
        rate_name(f"({of})" if " " in of else of, first),
        b.names(kind),
        tuple(derivative_unit(row.of, first, unit) for unit in units),
        (*[free] * row.derivative, limits),
    )


def known_kinds(robot: Engine, limits: Limits) -> tuple[str, ...]:
    """The kinds of limits that are checked along a motion: those of motors only where joints are elastic."""
    return tuple(kind for kind in limits.kinds if not LIMIT_KINDS[kind].takes or robot.mechanism.elasticity is not None)


def required_quantities(robot: Engine, kind: str) -> Mapping[str, int]:
    """The quantities that a kind of limit takes, with the highest rate of each; none for limits of the motion."""
    row, e = LIMIT_KINDS[kind], robot.mechanism.elasticity
    if row.of == "q":
        return {}
    if row.force:
        return {effort_quantity(robot.mechanism).name: row.rate}
    return {**row.takes} | ({"motor_torques": 1} if kind == "motor_voltage" and e and e.is_inductive else {})


def motion_order(robot: Engine, kind: str) -> int:
    """The highest rate of q that enters what a kind of limit bounds."""
    rows = required_quantities(robot, kind)
    return max(
        (_find_row(robot, name).takes.rates - 1 + order for name, order in rows.items()), default=LIMIT_KINDS[kind].rate
    )


def _find_row(robot: Engine, name: str) -> Quantity:
    return find_row(name, requests.count_more_rates(robot.mechanism, name))


def required_order(robot: Engine) -> int:
    """The highest rate of Q that a motion must carry for the limits of a robot: q to q2d for 0, q to q4d for 2."""
    kinds = known_kinds(robot, joint_limits(robot.mechanism))
    return max([0, *(motion_order(robot, kind) - along.Q_RATE_ORDER for kind in kinds)])


# Checks of a robot along a motion.
LIMITS_CURE = Remedy(
    "robot.with_limits(effort=..., velocity=...) states some, robot.with_limits(NAME) published ones of an arm",
    "--limits FILE states some, --limits ARM published ones of an arm",
)
MOTOR_CURE = Remedy("; robot.elastic(motors={joint: jounce.Motor(...)}) states it", "; state it in its file")


def validate_limits(robot: Engine, motion: object) -> LimitedMotion:
    """A robot along a motion, checked, with the limits of its coordinates; a robot without any is refused."""
    path, limits = along.check_motion(robot.mechanism, motion), joint_limits(robot.mechanism)
    kinds = known_kinds(robot, limits)
    if not kinds and not contact_limits.are_limited(robot.mechanism):
        if limits.kinds:
            came = f"robot {robot.name!r} states no limits of rigid joints, only {join_names(limits.kinds)}"
            raise JounceError(f"{came}{Remedy('; robot.elastic(stiffness) makes its joints elastic')}")
        raise JounceError(f"robot {robot.name!r} states no limits; {LIMITS_CURE}")
    check_motor_data(robot, kinds)
    _check_stiffness(robot, kinds)
    check_gravity(robot.mechanism, limits, kinds)
    b = LimitedMotion(robot, path, limits, kinds)
    return replace(b, windows=find_windows(b))


def check_motor_data(robot: Engine, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where currents or voltages of a motor are limited that states no data for them."""
    limits, e, places = joint_limits(robot.mechanism), robot.mechanism.elasticity, robot.mechanism.independent_places
    for kind in kinds:
        limited = np.isfinite(limits.bounds(kind)[:, list(places)]).any(axis=0)
        for j in np.flatnonzero(limited).tolist():
            motor = e.motors[j] if e and e.motors else None
            if lacking := [name for name in LIMIT_KINDS[kind].data if motor is None or getattr(motor, name) is None]:
                raise JounceError(
                    f"joint {quote_value(robot.joint_names[j])} has a limit of {kind}, and its motor states no"
                    f" {' and no '.join(lacking)}{MOTOR_CURE}"
                )


def _check_stiffness(robot: Engine, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where motors are bounded whose rates may be infinite between the times that are checked."""
    e, of_motors = robot.mechanism.elasticity, [kind for kind in kinds if LIMIT_KINDS[kind].takes]
    if e and e.slack and of_motors:
        raise JounceError(
            f"joint {quote_value(robot.joint_names[e.slack[0]])}: its spring has no stiffness at rest, and its motor"
            f" moves infinitely fast where no force acts; limits of {join_names(of_motors)} need a"
            " CubicSpring with k above 0"
        )


def check_gravity(m: Mechanism, limits: Limits, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where limits bound motor forces less gravity, and motors are not at the coordinates."""
    without = [kind for kind in kinds if kind in limits.without_gravity]
    if without and not drives_coordinates(m):
        raise JounceError(
            f"{m.name!r}: limits of {join_names(without)} bound Q - Qgrav, which is not known for motors at other"
            f" joints than the coordinates {join_names(m.coordinates)}; state them for Q"
            f"{Remedy(' (of=), or name these joints by robot.closed(actuated=...)')}"
        )


# Deviations along measured motions, and between which times they are small.
Deviations = dict[str, np.ndarray]  # by kind, (N, joints); NaN where they are not known


def is_measured(motion: Motion) -> bool:
    """Whether positions, loads or a base along a motion have deviations."""
    curves = (motion.curve, *motion.loads.values(), *([motion.base_curve] if motion.base_curve else []))
    return any(curve.deviations(motion.times[:1], 0) is not None for curve in curves)


def compute_deviations(b: LimitedMotion, t: np.ndarray) -> Deviations:
    """Standard deviations at times (N,), without the kinds that are exact."""
    if not is_measured(b.motion):
        return {}
    rates = _rate_deviations(b, t, max([1, *(motion_order(b.robot, kind) for kind in b.kinds)]))
    off = rates[1] if rates else np.zeros((len(t), len(b.joints)))
    found = dict(zip(LIMIT_KINDS.motion, rates, strict=False)) | _force_deviations(b, t, off) | _motor_deviations(b, t)
    return {kind: found[kind] for kind in b.kinds if kind in found}


def _rate_deviations(b: LimitedMotion, t: np.ndarray, order: int) -> Sequence[np.ndarray]:
    """The deviations of what limits of positions, velocities, ... bound, (N, joints) each; none if q is exact.

    Of joints that follow others in closed loops, and of swings, they are what each rate of q makes of its own.
    """
    m, motion = b.robot.mechanism, b.motion
    rates = motion.deviations(t, order)
    if rates is None or (not m.closure and not positions.multiscrew_joints(m.tree)):
        return rates or ()
    highest = max([1, *(LIMIT_KINDS[kind].rate for kind in b.kinds if LIMIT_KINDS[kind].of == "q")])
    meaning = partial(compute_states, motion.several)
    true, total = b.rates(t, highest), np.zeros((highest + 1, len(t), len(b.joints)))
    near = closed_path.continue_positions(b.robot, motion, t)
    for moved in perturb_rates(motion.curve, t, highest, meaning):
        close = near if near is None else loop_closure.close_loops(m, moved[0], near, backends.closing_step(b.robot))
        found = joint_rates(b.robot, moved, close, b.follow)
        total += np.square([x - y for x, y in zip(found, true, strict=True)])
    return tuple(np.sqrt(total))


def _force_deviations(b: LimitedMotion, t: np.ndarray, off: np.ndarray) -> Deviations:
    """The deviations of efforts with rates, power and stall efforts, from those of velocities, `off` (N, joints)."""
    kinds = [kind for kind in b.kinds if LIMIT_KINDS[kind].force]
    if not kinds:
        return {}
    along = _sample_deviations(b, t, b.efforts, max(LIMIT_KINDS[kind].rate for kind in kinds))
    spread, Q = (scatter_columns(b.robot.mechanism, x, b.efforts) for x in along)
    if not spread:
        return {}
    found = {kind: spread[LIMIT_KINDS[kind].rate] for kind in kinds}
    if "power" in b.kinds:
        parts = b.rates(t, 1)[1] * spread[0], Q[0] * off, spread[0] * off  # the last where both are off
        found["power"] = np.sqrt(np.sum(np.square(parts), axis=0))
    if "stall_effort" in b.kinds:
        found["stall_effort"] = np.hypot(spread[0], b.limits.effort_slope * off)
    return found


def _motor_deviations(b: LimitedMotion, t: np.ndarray) -> Deviations:
    """The deviations of motors; those of voltages are sums over their parts, an upper bound."""
    found = {}
    for kind in LIMIT_KINDS.motor:
        if kind in b.kinds:
            spread = {
                name: _sample_deviations(b, t, b.row(name), k)[0]
                for name, k in required_quantities(b.robot, kind).items()
            }
            if all(spread.values()):
                of_motor = b.motor_values(kind, spread)[LIMIT_KINDS[kind].rate]
                [found[kind]] = scatter_columns(b.robot.mechanism, [np.abs(of_motor)], DEFAULT_QUANTITY)
    return found


def _sample_deviations(
    b: LimitedMotion, t: np.ndarray, row: Quantity, order: int
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The deviations of a quantity with its rates, none where it is exact, and the quantity."""
    parts = list(along.compute_pieces(b.robot, b.motion, t, order, row=row))
    of_rates = [part.deviations or () for part in parts], [part.forces for part in parts]
    spread, values = (tuple(map(np.concatenate, zip(*rates, strict=True))) for rates in of_rates)
    return drop_base(b.robot.mechanism, spread, row), drop_base(b.robot.mechanism, values, row)


def find_windows(b: LimitedMotion) -> dict[str, Span]:
    """The times between which each kind is known well, of the kinds that are not known well along the whole motion."""
    times = b.motion.times
    t = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), reliability.MAX_WINDOW_TIMES)).astype(int))]
    found = {kind: reliability.find_window(t, off) for kind, off in compute_deviations(b, t).items()}
    return {kind: span for kind, span in found.items() if span != (t[0], t[-1])}
