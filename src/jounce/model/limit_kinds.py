"""The kinds of limits, a row each: with_limits, files, checks, slow-downs, retiming and excitation follow from them.

Index: `LIMIT_KINDS`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

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
        """Whether it bounds the force of a joint, a rate of it, its power, or what the line leaves of it."""
        return self.of in ("Q", "P")

    @property
    def derivative(self) -> int:
        """Which derivative it is in the series that is evaluated: each rate of q is a series of its own."""
        return self.rate * (self.of != "q")

    def unit(self, coordinate: str) -> str:
        """The unit of the bounds of a coordinate in rad or m."""
        return derivative_unit(self.of, self.rate, coordinate)


LIMIT_KINDS: Mapping[str, LimitKind] = {
    row.name: row
    for row in (
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
        LimitKind(
            "motor_voltage", "u", takes={"motor_positions": 1, "motor_torques": 0}, data=("constant", "resistance")
        ),
        LimitKind("no_load_velocity", "q", 1, line=True),  # the last one bounds nothing by itself
    )
}
STALL_LINE_KINDS = tuple(row.name for row in LIMIT_KINDS.values() if row.line)  # force at rest, velocity without force
MOTION_KINDS = tuple(
    row.name for row in LIMIT_KINDS.values() if row.of == "q" and not row.line
)  # of q, qd, q2d, q3d, q4d
EFFORT_KINDS = tuple(row.name for row in LIMIT_KINDS.values() if row.of == "Q" and not row.line)  # of Q, Qd, Q2d
MOTOR_KINDS = tuple(row.name for row in LIMIT_KINDS.values() if row.takes)  # behind elastic joints, seen from the links
LIMIT_PLACES: Mapping[str, tuple[int, int | slice]] = {  # in a table (kinds, 2), by the name of a bound
    key: (k, slice(None) if len(row.keys) == 1 else row.keys.index(key))
    for k, row in enumerate(LIMIT_KINDS.values())
    for key in row.keys
}
LIMIT_KEYS = tuple(LIMIT_PLACES)


def derivative_unit(symbol: str, rate: int, coordinate: str) -> str:
    """The unit of a time derivative of what limits bound, of a coordinate in rad or m."""
    return BOUNDED_UNITS[symbol][coordinate == "m"] + (f"/s^{rate}" if rate > 1 else "/s" * rate)


def kind_units(kind: str) -> str:
    """The units of a kind of limit in words: N m or N, W."""
    return " or ".join(dict.fromkeys(map(LIMIT_KINDS[kind].unit, ("rad", "m"))))


def describe_kind(kind: str, of: str | None) -> str:
    """A kind of limit in words, and the force that it bounds unless that is Q."""
    return kind.replace("_", " ") + (f" of {of}" if of == BOUNDED_FORCES[1] else "")
