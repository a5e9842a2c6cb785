"""Limits bound the joint variables, their forces and their motors: two-sided, infinite where none is stated.

`LIMIT_KINDS` is the index: a row for each kind of limit, which says what it bounds, in which unit, and under which keys
it is stated. `Robot.with_limits`, files, checks, slow-downs, retiming and excitation follow from these rows. `Limits`
holds the bounds of a robot in one table, (kinds, 2, joint variables), which its attributes read. Kinds that bound a sum
over all joints are stated once for the robot, and `Limits.totals` holds their bounds.

Callers and files state a number or two by the keys. `limit_error` says what is wrong with those of one joint variable,
`limits_of_joints` and `check_limits` make the table of them; `coordinates.change_limits` changes that of a robot.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, check_choice
from jounce.core.scalars import Array, asarray, is_numeric
from jounce.core.typing import Floats
from jounce.spatial.series import rate_name

BOUNDED_UNITS = {  # of what limits bound, by its symbol: of joints in rad and in m
    "q": ("rad", "m"),
    "Q": ("N m", "N"),
    "P": ("W", "W"),
    "theta": ("rad", "m"),
    "tau": ("N m", "N"),
    "i": ("A", "A"),
    "u": ("V", "V"),
}
BOUNDED_FORCES = ("Q", "Q - Qgrav")  # what an effort limit may bound
POSITION_ENDS = ("lower", "upper")  # the names of the two bounds of positions


@dataclass(frozen=True)
class LimitKind:
    """A kind of limit: which value of each joint it bounds."""

    name: str
    of: str  # the symbol of what it bounds
    rate: int = 0  # which time derivative of it
    any_sign: bool = False  # whether both bounds may have the same sign
    line: bool = False  # whether it is an end of the line of an effort that falls with speed
    takes: Mapping[str, int] = field(default_factory=dict)  # of motors: the quantities that it takes, to which rate
    data: tuple[str, ...] = ()  # of motors: which of their data
    law: Callable[[Any, Any, Any], Any] = lambda Q, qd, slope: Q  # of forces: what it bounds; `slope` is that of a line
    # Of the whole robot: two kinds, whose values are multiplied joint by joint and summed; none of limits of joints.
    factors: tuple[str, ...] = ()
    elastic_factors: tuple[str, ...] = ()  # those in their place where motors are behind springs

    @property
    def keys(self) -> tuple[str, ...]:
        """The names of its bounds, of callers and in files."""
        return POSITION_ENDS if self.name == "position" else (self.name,)

    @property
    def symbol(self) -> str:
        """The name of what it bounds: q, qd, ..., Q, ..."""
        return rate_name(self.of, self.rate) + " at stall" * self.line

    @property
    def force(self) -> bool:
        """Whether it bounds the force of a joint, its rates or power.

        The force that falls with speed is one of them.
        """
        return self.of in ("Q", "P") and not self.is_total

    @property
    def is_total(self) -> bool:
        """Whether it bounds a sum over all joints."""
        return len(self.factors) > 0

    @property
    def derivative(self) -> int:
        """The derivative of the evaluated series that it bounds.

        Each rate of q is a series of its own.
        """
        return self.rate * (self.of != "q")

    def unit(self, coordinate: str) -> str:
        """Return the unit of bounds of a coordinate in rad or m."""
        return derivative_unit(self.of, self.rate, coordinate)

    @property
    def units(self) -> str:
        """The units of its bounds in words: N m or N, W."""
        return " or ".join(dict.fromkeys(map(self.unit, ("rad", "m"))))

    def describe(self, force: str | None = None) -> str:
        """Return the kind in words, with its force unless that is Q."""
        return self.name.replace("_", " ") + (f" of {force}" if force == BOUNDED_FORCES[1] else "")


class LimitKinds(dict[str, LimitKind]):
    """All kinds of limits by name, in the order of `Limits`.

    Attributes
    ----------
    motion : tuple of str
        The kinds that bound q, qd, q2d, q3d, q4d.
    effort : tuple of str
        Those that bound Q, Qd, Q2d.
    motor : tuple of str
        Those of motors behind elastic joints, seen from the links.
    stall_line : tuple of str
        The ends of the line of an effort that falls with speed: force at rest, velocity without force.
    of_joints, totals : tuple of str
        Those that bound a number of each joint, and those that bound a sum over all joints of the robot.
    bound_names : tuple of str
        The names of all bounds of joints, by which callers and files state them.
    """

    def __init__(self, *rows: LimitKind) -> None:
        super().__init__({row.name: row for row in rows})
        self.motion = tuple(row.name for row in rows if row.of == "q" and not row.line)
        self.effort = tuple(row.name for row in rows if row.of == "Q" and not row.line)
        self.motor = tuple(row.name for row in rows if row.takes and not row.is_total)
        self.stall_line = tuple(row.name for row in rows if row.line)
        self.of_joints = tuple(row.name for row in rows if not row.is_total)
        self.totals = tuple(row.name for row in rows if row.is_total)
        self.bound_names = tuple(key for row in rows if not row.is_total for key in row.keys)


LIMIT_KINDS = LimitKinds(
    LimitKind("position", "q"),
    LimitKind("velocity", "q", 1),
    LimitKind("acceleration", "q", 2),
    LimitKind("jerk", "q", 3),
    LimitKind("snap", "q", 4),
    LimitKind("effort", "Q", any_sign=True),
    LimitKind("effort_rate", "Q", 1),
    LimitKind("second_effort_rate", "Q", 2),
    LimitKind("power", "P", law=lambda Q, qd, slope: Q * qd),
    LimitKind("stall_effort", "Q", line=True, law=lambda Q, qd, slope: Q + slope * qd),
    LimitKind("motor_position", "theta", any_sign=True, takes={"motor_positions": 0}),
    LimitKind("motor_velocity", "theta", 1, takes={"motor_positions": 1}),
    LimitKind("motor_torque", "tau", any_sign=True, takes={"motor_torques": 0}),
    LimitKind("motor_current", "i", takes={"motor_torques": 0}, data=("constant",)),
    LimitKind("motor_voltage", "u", takes={"motor_positions": 1, "motor_torques": 0}, data=("constant", "resistance")),
    LimitKind("no_load_velocity", "q", 1, line=True),  # the last one of joints bounds nothing by itself
    # Kinds of the whole robot follow those of joints, whose places are those in the table.
    LimitKind(
        "total_power",
        "P",
        factors=("effort", "velocity"),
        elastic_factors=("motor_torque", "motor_velocity"),
    ),
    LimitKind(
        "total_electrical_power",
        "P",
        takes={"motor_positions": 1, "motor_torques": 0},
        data=("constant", "resistance"),
        factors=("motor_current", "motor_voltage"),
    ),
)
LIMIT_PLACES: Mapping[str, tuple[int, int | slice]] = {  # in a table (kinds, 2), by the name of a bound
    key: (k, slice(None) if len(row.keys) == 1 else row.keys.index(key))
    for k, row in enumerate(LIMIT_KINDS.values())
    if not row.is_total
    for key in row.keys
}
UNBOUNDED = (-np.inf, np.inf)


def derivative_unit(symbol: str, rate: int, coordinate: str) -> str:
    """Return the unit of a derivative of a bounded quantity.

    The coordinate is in rad or m.
    """
    return BOUNDED_UNITS[symbol][coordinate == "m"] + (f"/s^{rate}" if rate > 1 else "/s" * rate)


class Bound(property):
    """An attribute of limits: the bound in the positive direction of each joint variable."""

    def __init__(self, key: str) -> None:
        row = next(row for row in LIMIT_KINDS.values() if key in row.keys)
        super().__init__(lambda limits: positive_bounds(limits.table, key))
        size = "smallest" if key == POSITION_ENDS[0] else "largest"
        self.__doc__ = f"The {size} {row.name.replace('_', ' ')}, {row.units}."

    def __get__(self, limits: Any, owner: type | None = None) -> Floats:  # type: ignore[override]  # not of classes
        return super().__get__(limits, owner)


@dataclass(frozen=True, eq=False, repr=False)
class Limits:
    """The limits of the joint variables, their forces and their motors.

    Where none is stated, they are infinite.

    They do not enter Q. Of joints that follow others, the motion is limited, but the effort is not: what they exert
    adds to the force of their leader, and only its limit has a meaning. Each attribute is the bound in the positive
    direction; the other one is its negative, unless the limit is two-sided: `bounds` gives both.

    Attributes
    ----------
    lower, upper : (nb,)
        Position, rad or m.
    velocity, acceleration, jerk, snap : (nb,)
        Rates of the joint variable: rad/s or m/s, per s, ...
    effort, effort_rate, second_effort_rate : (nb,)
        Q, Qd and Q2d: N m or N, per s, per s^2.
    power : (nb,)
        Drive power qd Q, W.
    stall_effort, no_load_velocity : (nb,)
        Q that falls with speed, Q / stall_effort + qd / no_load_velocity <= 1 in either direction: N m or N, rad/s or
        m/s.
    motor_position, motor_velocity, motor_torque : (nb,)
        The motor behind an elastic joint, seen from the link: rad or m, per s, N m or N.
    motor_current, motor_voltage : (nb,)
        The same motor: A and V.
    without_gravity : tuple of str
        Those of "effort", "effort_rate", "second_effort_rate" that bound Q - Qgrav and its rates instead of Q.
    total_power, total_electrical_power : float
        The power of all motors together, W, mechanical and electrical.
    table : (16, 2, nb)
        All those of joints: for each of the sixteen kinds the lower and the upper bounds.
    totals : tuple of (lower, upper)
        Those of the whole robot: of each kind both bounds.

    Examples
    --------
    >>> import jounce
    >>> limits = jounce.load("panda").limits
    >>> limits.effort[:2]
    array([87., 87.])
    """

    table: Floats
    without_gravity: tuple[str, ...] = ()
    totals: tuple[tuple[float, float], ...] = (UNBOUNDED,) * len(LIMIT_KINDS.totals)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Limits):
            return NotImplemented
        same_words = (self.without_gravity, self.totals) == (other.without_gravity, other.totals)
        return same_words and np.array_equal(self.table, other.table)

    def __hash__(self) -> int:
        return hash((self.without_gravity, self.totals, (self.table + 0.0).tobytes()))

    def __repr__(self) -> str:
        return f"<Limits of {self.table.shape[-1]} joint variables: {', '.join(self.kinds) or 'none stated'}>"

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds that bound any joint variable."""
        return tuple(
            kind for kind in LIMIT_KINDS if kind != LIMIT_KINDS.stall_line[1] and np.isfinite(self.bounds(kind)).any()
        )

    def bounds(self, kind: str) -> Floats:
        """Return the lower and upper bounds of a kind.

        Parameters
        ----------
        kind : str
            "position", "velocity", "effort" or another attribute of these limits.

        Returns
        -------
        (2, nb) array
            SI units, infinite where nothing is stated; (2, 1) of a kind of the whole robot.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").limits.bounds("effort")[:, 0]
        array([-87.,  87.])
        """
        if kind in LIMIT_KINDS.totals:
            return np.array(self.totals[LIMIT_KINDS.totals.index(kind)])[:, None]
        return self.table[[*LIMIT_KINDS].index(check_choice("limit", kind, LIMIT_KINDS))]

    lower, upper = map(Bound, POSITION_ENDS)
    velocity, acceleration, jerk, snap = map(Bound, LIMIT_KINDS.motion[1:])
    effort, effort_rate, second_effort_rate = map(Bound, LIMIT_KINDS.effort)
    power, stall_effort, no_load_velocity = map(Bound, ("power", *LIMIT_KINDS.stall_line))
    motor_position, motor_velocity, motor_torque, motor_current, motor_voltage = map(Bound, LIMIT_KINDS.motor)

    @property
    def total_power(self) -> float:
        """The largest power that all motors deliver together, W."""
        return float(self.bounds("total_power")[1, 0])

    @property
    def total_electrical_power(self) -> float:
        """The largest electrical power that all motors take, W."""
        return float(self.bounds("total_electrical_power")[1, 0])

    @property
    def effort_slope(self) -> Floats:
        """The slope by which effort falls with speed, or 0.

        It is in N m s or N s/m. It is stall_effort / no_load_velocity.
        """
        falls = np.isfinite(self.stall_effort)
        return np.where(falls, self.stall_effort, 0) / np.where(falls, self.no_load_velocity, 1)

    def of(self, kind: str) -> str:
        """Return the force that an effort limit bounds, with its rates.

        Parameters
        ----------
        kind : str
            "effort", "effort_rate" or "second_effort_rate".

        Returns
        -------
        str
            "Q" or "Q - Qgrav".

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").with_limits("panda").limits.of("effort_rate")
        'Q - Qgrav'
        """
        check_choice("effort limit", kind, LIMIT_KINDS.effort)
        return BOUNDED_FORCES[kind in self.without_gravity]

    def stated(self, i: int) -> dict[str, float | list[float | None]]:
        """Return the finite limits of a joint variable, as in files.

        Parameters
        ----------
        i : int
            The number of the joint variable.

        Returns
        -------
        dict
            {limit: number for both directions, or [lower, upper], None for an infinite one}.

        Raises
        ------
        IndexError
            If there is no such joint variable.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").limits.stated(0)
        {'lower': -2.8973, 'upper': 2.8973, 'velocity': 2.175, 'effort': 87.0}
        """
        return _state_ends(
            {key: np.atleast_1d(self.table[(*place, i)]).tolist() for key, place in LIMIT_PLACES.items()}
        )

    @property
    def stated_totals(self) -> dict[str, float | list[float | None]]:
        """The finite limits of the whole robot, as in files."""
        return _state_ends({kind: list(ends) for kind, ends in zip(LIMIT_KINDS.totals, self.totals, strict=True)})

    def with_totals(self, stated: Mapping[str, float | Sequence[float]]) -> "Limits":
        """Return the limits with some of the whole robot changed.

        They are checked where they are read: `Robot.with_limits` checks those of a caller.

        Parameters
        ----------
        stated : mapping
            {limit: number for both directions, or (lower, upper)}, W.

        Returns
        -------
        Limits

        Raises
        ------
        ValueError
            If two ends are more or fewer.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").limits.with_totals({"total_power": (-200, 500)}).total_power
        500.0
        """
        ends = dict(zip(LIMIT_KINDS.totals, self.totals, strict=True))
        for kind, value in stated.items():
            lower, upper = value if isinstance(value, Sequence) else (-value, value)
            ends[kind] = float(lower) + 0.0, float(upper) + 0.0  # no -0.0 among data
        return replace(self, totals=tuple(ends.values()))

    def without(self, places: Iterable[tuple[str, int]]) -> "Limits":
        """Return the limits without some of them.

        Parameters
        ----------
        places : iterable of (str, int)
            Each a kind, and the number of the joint variable, 0 of the whole robot.

        Returns
        -------
        Limits

        Raises
        ------
        IndexError
            If there is no such joint variable.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").limits.without([("effort", 0)]).effort[:2]
        array([inf, 87.])
        """
        table, totals = self.table.copy(), list(self.totals)
        for kind, i in places:
            if kind in LIMIT_KINDS.totals:
                totals[LIMIT_KINDS.totals.index(kind)] = UNBOUNDED
            else:
                table[[*LIMIT_KINDS].index(kind), :, i] = UNBOUNDED
        return replace(self, table=table, totals=tuple(totals))

    def select(self, joints: Sequence[int]) -> "Limits":
        """Return the limits of some of the joint variables.

        Parameters
        ----------
        joints : sequence of int
            Their numbers, in the order of the result.

        Returns
        -------
        Limits

        Raises
        ------
        IndexError
            If there is no such joint variable.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").limits.select([6, 0]).effort
        array([12., 87.])
        """
        return replace(self, table=self.table[..., joints])


def _state_ends(ends_by_key: Mapping[str, list[float]]) -> dict[str, float | list[float | None]]:
    """Return the finite limits, as in files."""
    limits: dict[str, float | list[float | None]] = {}
    for key, ends in ends_by_key.items():
        if np.isfinite(ends).any():
            # One number stands for both directions.
            is_symmetric = len(ends) == 1 or ends[0] == -ends[1]
            both_ends = [x if np.isfinite(x) else None for x in ends]
            limits[key] = ends[-1] if is_symmetric else both_ends
    return limits


def no_limits(nb: int) -> Limits:
    """Return the limits of nb joint variables without any: all are infinite."""
    table = np.full((len(LIMIT_KINDS.of_joints), 2, nb), np.inf)
    table[:, 0] = -np.inf
    return Limits(table)


def positive_bounds(table: Floats, key: str) -> Floats:
    """Return the bounds of a name in a table (kinds, 2, ...).

    They are the upper bounds, but for the lower ones of "lower".
    """
    kind, side = LIMIT_PLACES[key]
    return table[kind, side if isinstance(side, int) else 1]


StatedLimit = float | Sequence[float]  # one number for both directions, or (lower, upper)


def limits_of_joints(stated: Sequence[Mapping[str, StatedLimit]], without_gravity: Sequence[str] = ()) -> Limits:
    """Return the limits of joint variables that state them by key.

    They are checked where they are read.
    """
    table = no_limits(len(stated)).table
    for i, joint in enumerate(stated):
        for key, value in joint.items():
            set_bound(table[..., i], key, value)
    return Limits(table + 0.0, tuple(without_gravity))  # no -0.0 among data


def limit_error(**stated: StatedLimit) -> str | None:
    """Return why numbers are no valid limits of a joint, or None."""
    lower, upper = float(stated.get("lower", -np.inf)), float(stated.get("upper", np.inf))  # type: ignore[arg-type]
    if not (-np.inf <= lower <= upper <= np.inf) or lower == np.inf or upper == -np.inf:
        return f"lower and upper limit are {lower:g} and {upper:g}; expected lower <= upper"
    # The two ends of the line of an effort that falls with speed go together.
    line = {key: float(np.max(stated.get(key, np.inf))) for key in LIMIT_KINDS.stall_line}
    if len(set(np.isfinite([*line.values()]))) > 1:
        words = " and ".join(f"{key} is {value:g}" for key, value in line.items())
        line_law = "effort / stall_effort + velocity / no_load_velocity = 1"
        return f"{words}; expected both, of the line {line_law}, or neither"
    bounds: Mapping[str, Any] = {key: value for key, value in stated.items() if key not in POSITION_ENDS}
    for key, value in bounds.items():
        # Bounds are one number for both directions, or (lower, upper).
        if key in LIMIT_KINDS.stall_line:
            if not np.max(value) > 0 or (np.ndim(value) and value[0] != -value[1]):
                return f"{key} is {value}; expected one number above 0, for both directions"
        elif np.ndim(value) == 0:
            if not value >= 0:
                return f"limit of {key} is {value:g}; expected 0 or more"
        else:
            lower, upper = value[0], value[1]
            if LIMIT_KINDS[key].any_sign:
                expected, is_valid = "lower <= upper", lower <= upper
            else:
                expected, is_valid = "lower <= 0 <= upper", lower <= 0 <= upper
            if not is_valid:
                return f"limits of {key} are {lower:g} and {upper:g}; expected {expected}"
    return None


def check_limits(limits: object, nb: int) -> Limits:
    """Return limits of nb joint variables, checked.

    They are those of another robot, or a mapping of arrays (nb,), two-sided ones (nb, 2).
    """
    if isinstance(limits, Limits):
        if limits.table.shape[-1] != nb:
            raise JounceError(f"limits are of {limits.table.shape[-1]} joint variables; expected {nb}")
        return replace(limits, table=limits.table.copy())
    by_key = {} if limits is None else limits
    if not isinstance(by_key, Mapping):
        raise JounceError(f"limits is of type {type(limits).__name__}; expected a mapping of {', '.join(LIMIT_PLACES)}")
    arrays = {check_choice("limit", key, LIMIT_PLACES): _check_numbers(array, key, nb) for key, array in by_key.items()}
    joints: list[Mapping[str, Any]] = [{key: array[i] for key, array in arrays.items()} for i in range(nb)]
    for i, joint in enumerate(joints):
        error = limit_error(**joint)
        if error is not None:
            raise JounceError(f"limits of joint {i}: {error}")
    return limits_of_joints(joints)


def _check_numbers(array: Array, key: str, nb: int) -> np.ndarray:
    """Return numbers (nb,), or (nb, 2) of kinds that have two sides."""
    numbers = np.asarray(asarray(array, key))
    shapes = [(nb,)] if key in POSITION_ENDS else [(nb,), (nb, 2)]
    if numbers.shape not in shapes or not is_numeric(numbers):
        words = " or ".join(map(str, shapes))
        raise JounceError(f"limits: {key} has shape {numbers.shape}; expected numbers {words}, one per joint")
    return numbers


def set_bound(table: Floats, key: str, value: StatedLimit) -> None:
    """Write a bound into a table (kinds, 2) of a joint variable."""
    kind, side = LIMIT_PLACES[key]
    table[kind, side] = value if isinstance(side, int) or np.ndim(value) else (-value, value)  # type: ignore[operator]
