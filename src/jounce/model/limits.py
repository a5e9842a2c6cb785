"""Limits of the joint variables, their forces and their motors: two-sided bounds, infinite where none is stated."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, one_of, quoted
from jounce.core.scalars import Array, asarray, is_numeric
from jounce.core.typing import Floats

MOTION_KINDS = ("position", "velocity", "acceleration", "jerk", "snap")  # bounds of q, qd, q2d, q3d, q4d
EFFORT_KINDS = ("effort", "effort_rate", "second_effort_rate")  # bounds of Q, Qd, Q2d
MOTOR_KINDS = {  # of motors behind elastic joints, seen from the links, with the unit of joints in rad and in m
    "motor_position": ("rad", "m"),
    "motor_velocity": ("rad/s", "m/s"),
    "motor_torque": ("N m", "N"),
    "motor_current": ("A", "A"),
    "motor_voltage": ("V", "V"),
}
LINE = ("stall_effort", "no_load_velocity")  # of the effort that falls with speed: where it ends on both axes
KINDS = (*MOTION_KINDS, *EFFORT_KINDS, "power", LINE[0], *MOTOR_KINDS)
STATED_KINDS = (*KINDS, LINE[1])  # rows of a table; the last one bounds nothing by itself
KEYS = ("lower", "upper", *STATED_KINDS[1:])  # of files and callers: positions have two
ONE_SIDED = ("effort", "motor_position", "motor_torque")  # whose two bounds may have the same sign
FORCES = ("Q", "Q - Qgrav")  # what an effort limit may bound

_FORCE = {"rad": "N m", "m": "N"}

Stated = float | Sequence[float]  # one number for both directions, or (lower, upper)


@dataclass(frozen=True, eq=False, repr=False)
class Limits:
    """The limits of the joint variables, their forces and their motors, infinite where none is stated.

    They do not enter Q.

    They are kept per joint variable. Of joints that follow others, the motion is limited, but the effort is not: what
    they exert adds to the force of their leader, and only its limit has a meaning.

    Each attribute is the bound in the positive direction; the other one is its negative, unless the limit is two-sided:
    `bounds` gives both.

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
    table : (16, 2, nb)
        All of them: for each of the sixteen kinds the lower and the upper bounds.

    Examples
    --------
    >>> import jounce
    >>> limits = jounce.load("panda").limits
    >>> limits.effort[:2]
    array([87., 87.])
    >>> limits.bounds("effort")[:, 0]
    array([-87.,  87.])
    """

    table: Floats
    without_gravity: tuple[str, ...] = ()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Limits):
            return NotImplemented
        return self.without_gravity == other.without_gravity and np.array_equal(self.table, other.table)

    def __hash__(self) -> int:
        return hash((self.without_gravity, (self.table + 0.0).tobytes()))

    def __repr__(self) -> str:
        return f"<Limits of {self.table.shape[-1]} joint variables: {', '.join(self.kinds) or 'none stated'}>"

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds that bound any joint variable."""
        return tuple(kind for kind in KINDS if np.isfinite(self.bounds(kind)).any())

    def bounds(self, kind: str) -> Floats:
        """The lower and upper bounds of a kind.

        Parameters
        ----------
        kind : str
            "position", "velocity", "acceleration", "jerk", "snap", "effort", "effort_rate", "second_effort_rate",
            "power", "stall_effort", "no_load_velocity", "motor_position", "motor_velocity", "motor_torque",
            "motor_current" or "motor_voltage".

        Returns
        -------
        (2, nb) array
            SI units, infinite where nothing is stated.

        Raises
        ------
        JounceError
            If the kind is unknown.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").limits.bounds("effort")[:, 0]
        array([-87.,  87.])
        """
        return self.table[STATED_KINDS.index(one_of("limit", kind, STATED_KINDS))]

    @property
    def lower(self) -> Floats:
        """The smallest position, rad or m."""
        return self.bounds("position")[0]

    @property
    def upper(self) -> Floats:
        """The largest position, rad or m."""
        return self.bounds("position")[1]

    @property
    def velocity(self) -> Floats:
        """The largest velocity, rad/s or m/s."""
        return self.bounds("velocity")[1]

    @property
    def acceleration(self) -> Floats:
        """The largest acceleration, rad/s^2 or m/s^2."""
        return self.bounds("acceleration")[1]

    @property
    def jerk(self) -> Floats:
        """The largest jerk, rad/s^3 or m/s^3."""
        return self.bounds("jerk")[1]

    @property
    def snap(self) -> Floats:
        """The largest snap, rad/s^4 or m/s^4."""
        return self.bounds("snap")[1]

    @property
    def effort(self) -> Floats:
        """The largest moment or force, N m or N."""
        return self.bounds("effort")[1]

    @property
    def effort_rate(self) -> Floats:
        """The largest rate of the moment or force, N m/s or N/s."""
        return self.bounds("effort_rate")[1]

    @property
    def second_effort_rate(self) -> Floats:
        """The largest second rate of the moment or force, N m/s^2 or N/s^2."""
        return self.bounds("second_effort_rate")[1]

    @property
    def power(self) -> Floats:
        """The largest drive power, W."""
        return self.bounds("power")[1]

    @property
    def stall_effort(self) -> Floats:
        """Where the line of an effort that falls with speed ends at rest, N m or N."""
        return self.bounds("stall_effort")[1]

    @property
    def no_load_velocity(self) -> Floats:
        """Where this line ends without effort, rad/s or m/s."""
        return self.bounds("no_load_velocity")[1]

    @property
    def effort_slope(self) -> Floats:
        """By how much the effort falls with speed, stall_effort / no_load_velocity, N m s or N s/m; else 0."""
        stated = np.isfinite(self.stall_effort)
        return np.where(stated, self.stall_effort, 0) / np.where(stated, self.no_load_velocity, 1)

    @property
    def motor_position(self) -> Floats:
        """The largest position of the motor, rad or m."""
        return self.bounds("motor_position")[1]

    @property
    def motor_velocity(self) -> Floats:
        """The largest velocity of the motor, rad/s or m/s."""
        return self.bounds("motor_velocity")[1]

    @property
    def motor_torque(self) -> Floats:
        """The largest torque of the motor, N m or N."""
        return self.bounds("motor_torque")[1]

    @property
    def motor_current(self) -> Floats:
        """The largest current of the motor, A."""
        return self.bounds("motor_current")[1]

    @property
    def motor_voltage(self) -> Floats:
        """The largest voltage of the motor, V."""
        return self.bounds("motor_voltage")[1]

    def of(self, kind: str) -> str:
        """Which force an effort limit bounds, with its rates.

        Parameters
        ----------
        kind : str
            "effort", "effort_rate" or "second_effort_rate".

        Returns
        -------
        str
            "Q" or "Q - Qgrav".

        Raises
        ------
        JounceError
            If the kind is unknown.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").with_limits("panda").limits.of("effort_rate")
        'Q - Qgrav'
        """
        one_of("effort limit", kind, EFFORT_KINDS)
        return FORCES[kind in self.without_gravity]

    def stated(self, i: int) -> dict[str, float | list[float | None]]:
        """The finite limits of one joint variable, as robot files have them.

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
        found: dict[str, float | list[float | None]] = {}
        for key in KEYS:
            lower, upper = (float(x) for x in self.bounds(_kind(key))[:, i])
            if key in ("lower", "upper"):
                end = lower if key == "lower" else upper
                found |= {key: end} if np.isfinite(end) else {}
            elif np.isfinite([lower, upper]).any():
                ends = [x if np.isfinite(x) else None for x in (lower, upper)]
                found[key] = upper if lower == -upper else ends
        return found

    def select(self, joints: Sequence[int]) -> "Limits":
        """The limits of some of the joint variables.

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


def unlimited(nb: int) -> Limits:
    """No limits of nb joint variables."""
    table = np.full((len(STATED_KINDS), 2, nb), np.inf)
    table[:, 0] = -np.inf
    return Limits(table)


def limits_of_joints(stated: Sequence[Mapping[str, Stated]], without_gravity: Sequence[str] = ()) -> Limits:
    """The limits that are stated of each joint variable, checked where they are read."""
    table = unlimited(len(stated)).table
    for i, joint in enumerate(stated):
        for key, value in joint.items():
            _set(table[..., i], key, value)
    return Limits(table + 0.0, tuple(without_gravity))  # no -0.0 among data


def limit_error(**stated: Stated) -> str | None:
    """What keeps numbers from being the limits of a joint variable, or None."""
    lower, upper = float(stated.get("lower", -np.inf)), float(stated.get("upper", np.inf))  # type: ignore[arg-type]
    if not (-np.inf <= lower <= upper <= np.inf) or lower == np.inf or upper == -np.inf:
        return f"lower and upper limit are {lower:g} and {upper:g}; expected lower <= upper"
    line = {key: float(np.max(stated.get(key, np.inf))) for key in LINE}
    if len(set(np.isfinite([*line.values()]))) > 1:
        words = " and ".join(f"{key} is {value:g}" for key, value in line.items())
        return (
            f"{words}; expected both, of the line effort / stall_effort + velocity / no_load_velocity = 1, or neither"
        )
    for key, value in stated.items():
        if key in ("lower", "upper"):
            continue
        if key in LINE:
            if not np.max(value) > 0 or (np.ndim(value) and value[0] != -value[1]):  # type: ignore[index]
                return f"{key} is {value}; expected one number above 0, for both directions"
        elif np.ndim(value) == 0:
            if not value >= 0:  # type: ignore[operator]
                return f"limit of {key} is {value:g}; expected 0 or more"
        elif key in ONE_SIDED and not value[0] <= value[1]:  # type: ignore[index]
            return f"limits of {key} are {value[0]:g} and {value[1]:g}; expected lower <= upper"  # type: ignore[index]
        elif key not in ONE_SIDED and not value[0] <= 0 <= value[1]:  # type: ignore[index]
            return f"limits of {key} are {value[0]:g} and {value[1]:g}; expected lower <= 0 <= upper"  # type: ignore[index]
    return None


def checked_limits(given: object, nb: int) -> Limits:
    """Limits of nb joint variables: those of another robot, or a mapping of arrays (nb,), two-sided ones (nb, 2)."""
    if isinstance(given, Limits):
        if given.table.shape[-1] != nb:
            raise JounceError(f"limits are of {given.table.shape[-1]} joint variables; expected {nb}")
        return replace(given, table=given.table.copy())
    stated = {} if given is None else given
    if not isinstance(stated, Mapping):
        raise JounceError(f"limits is of type {type(given).__name__}; expected a mapping of {', '.join(KEYS)}")
    arrays = {one_of("limit", key, KEYS): _numbers(array, key, nb) for key, array in stated.items()}
    joints: list[Mapping[str, Any]] = [{key: array[i] for key, array in arrays.items()} for i in range(nb)]
    for i, joint in enumerate(joints):
        if error := limit_error(**joint):
            raise JounceError(f"limits of joint {i}: {error}")
    return limits_of_joints(joints)


def _numbers(array: Array, key: str, nb: int) -> np.ndarray:
    numbers = np.asarray(asarray(array, key))
    shapes = [(nb,)] if key in ("lower", "upper") else [(nb,), (nb, 2)]
    if numbers.shape not in shapes or not is_numeric(numbers):
        words = " or ".join(map(str, shapes))
        raise JounceError(f"limits: {key} has shape {numbers.shape}; expected numbers {words}, one per joint")
    return numbers


def limits_with(limits: Limits, changes: Mapping[int, Mapping[str, Stated]], names: Sequence[str]) -> Limits:
    """The limits with those of some joint variables, by their index, in place of the old ones; `names` are theirs."""
    table = limits.table.copy()
    for i, joint in changes.items():
        for key, value in joint.items():
            _set(table[..., i], key, value)
        if np.isinf(np.max(joint.get(LINE[0], 0))):  # which takes the line away
            table[STATED_KINDS.index(LINE[1]), :, i] = -np.inf, np.inf
        lower, upper = table[0, :, i]
        line = {key: table[STATED_KINDS.index(key), 1, i] for key in LINE}
        given = {key: value for key, value in joint.items() if key not in ("lower", "upper")}
        if error := limit_error(**line | given | {"lower": lower, "upper": upper}):
            raise JounceError(f"joint {quoted(names[i])}: {error}")
    return replace(limits, table=table + 0.0)


def unit_of(kind: str, coordinate: str) -> str:
    """The unit of a kind of limit of a coordinate in rad or m."""
    if kind == "power":
        return "W"
    if kind in MOTOR_KINDS:
        return MOTOR_KINDS[kind][coordinate == "m"]
    if kind in LINE:
        return _FORCE[coordinate] if kind == LINE[0] else f"{coordinate}/s"
    base, names = (coordinate, MOTION_KINDS) if kind in MOTION_KINDS else (_FORCE[coordinate], EFFORT_KINDS)
    order = names.index(kind)
    return base + (f"/s^{order}" if order > 1 else "/s" * order)


def in_words(kind: str, of: str | None) -> str:
    """A kind of limit in words, and the force that it bounds unless that is Q."""
    return kind.replace("_", " ") + (f" of {of}" if of == FORCES[1] else "")


def _kind(key: str) -> str:
    return "position" if key in ("lower", "upper") else key


def _set(table: np.ndarray, key: str, value: Stated) -> None:
    """Write what is stated under a key into a table (kinds, 2) of one joint variable."""
    row = table[STATED_KINDS.index(_kind(key))]
    if key in ("lower", "upper"):
        row[int(key == "upper")] = value
    else:
        row[:] = value if np.ndim(value) else (-value, value)  # type: ignore[operator]
