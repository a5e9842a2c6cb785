"""The kinds of limits, a row each: with_limits, files, checks, slow-downs, retiming and excitation follow from them.

Index: `KINDS`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from jounce.spatial.series import rate_name

UNITS = {  # of what limits bound, by its symbol: of joints in rad and in m
    "q": ("rad", "m"),
    "Q": ("N m", "N"),
    "P": ("W", "W"),
    "theta": ("rad", "m"),
    "tau": ("N m", "N"),
    "i": ("A", "A"),
    "u": ("V", "V"),
}
FORCES = ("Q", "Q - Qgrav")  # what an effort limit may bound
ENDS = ("lower", "upper")  # the names of the two bounds of positions


@dataclass(frozen=True)
class Kind:
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
        return ENDS if self.name == "position" else (self.name,)

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
        return unit_of(self.of, self.rate, coordinate)


KINDS: Mapping[str, Kind] = {
    row.name: row
    for row in (
        Kind("position", "q"),
        Kind("velocity", "q", 1),
        Kind("acceleration", "q", 2),
        Kind("jerk", "q", 3),
        Kind("snap", "q", 4),
        Kind("effort", "Q", any_sign=True),
        Kind("effort_rate", "Q", 1),
        Kind("second_effort_rate", "Q", 2),
        Kind("power", "P", law=lambda Q, qd, slope: Q * qd),
        Kind("stall_effort", "Q", line=True, law=lambda Q, qd, slope: Q + slope * qd),
        Kind("motor_position", "theta", any_sign=True, takes={"motor_positions": 0}),
        Kind("motor_velocity", "theta", 1, takes={"motor_positions": 1}),
        Kind("motor_torque", "tau", any_sign=True, takes={"motor_torques": 0}),
        Kind("motor_current", "i", takes={"motor_torques": 0}, data=("constant",)),
        Kind("motor_voltage", "u", takes={"motor_positions": 1, "motor_torques": 0}, data=("constant", "resistance")),
        Kind("no_load_velocity", "q", 1, line=True),  # the last one bounds nothing by itself
    )
}
LINE = tuple(row.name for row in KINDS.values() if row.line)  # force at rest, velocity without force
MOTION_KINDS = tuple(row.name for row in KINDS.values() if row.of == "q" and not row.line)  # of q, qd, q2d, q3d, q4d
EFFORT_KINDS = tuple(row.name for row in KINDS.values() if row.of == "Q" and not row.line)  # of Q, Qd, Q2d
MOTOR_KINDS = tuple(row.name for row in KINDS.values() if row.takes)  # behind elastic joints, seen from the links
PLACES: Mapping[str, tuple[int, int | slice]] = {  # in a table (kinds, 2), by the name of a bound
    key: (k, slice(None) if len(row.keys) == 1 else row.keys.index(key))
    for k, row in enumerate(KINDS.values())
    for key in row.keys
}
KEYS = tuple(PLACES)


def unit_of(symbol: str, rate: int, coordinate: str) -> str:
    """The unit of a time derivative of what limits bound, of a coordinate in rad or m."""
    return UNITS[symbol][coordinate == "m"] + (f"/s^{rate}" if rate > 1 else "/s" * rate)


def units_of(kind: str) -> str:
    """The units of a kind of limit in words: N m or N, W."""
    return " or ".join(dict.fromkeys(map(KINDS[kind].unit, ("rad", "m"))))


def in_words(kind: str, of: str | None) -> str:
    """A kind of limit in words, and the force that it bounds unless that is Q."""
    return kind.replace("_", " ") + (f" of {of}" if of == FORCES[1] else "")
