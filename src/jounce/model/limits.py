"""Limits of the joint variables, their forces and their motors: two-sided bounds, infinite where none is stated."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jounce.core.errors import check_choice
from jounce.core.typing import Floats
from jounce.model.limit_kinds import (
    BOUNDED_FORCES,
    EFFORT_KINDS,
    LIMIT_KINDS,
    LIMIT_PLACES,
    MOTION_KINDS,
    MOTOR_KINDS,
    POSITION_ENDS,
    STALL_LINE_KINDS,
    kind_units,
)


class Bound(property):
    """An attribute of limits: what is stated under a name of each joint variable, in the positive direction."""

    def __init__(self, key: str) -> None:
        row = next(row for row in LIMIT_KINDS.values() if key in row.keys)
        super().__init__(lambda limits: positive_bounds(limits.table, key))
        size = "smallest" if key == POSITION_ENDS[0] else "largest"
        self.__doc__ = f"The {size} {row.name.replace('_', ' ')}, {kind_units(row.name)}."

    def __get__(self, limits: Any, owner: type | None = None) -> Floats:  # type: ignore[override]  # not of classes
        return super().__get__(limits, owner)


@dataclass(frozen=True, eq=False, repr=False)
class Limits:
    """The limits of the joint variables, their forces and their motors, infinite where none is stated.

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
    table : (16, 2, nb)
        All of them: for each of the sixteen kinds the lower and the upper bounds.

    Examples
    --------
    >>> import jounce
    >>> limits = jounce.load("panda").limits
    >>> limits.effort[:2]
    array([87., 87.])
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
        return tuple(
            kind for kind in LIMIT_KINDS if kind != STALL_LINE_KINDS[1] and np.isfinite(self.bounds(kind)).any()
        )

    def bounds(self, kind: str) -> Floats:
        """The lower and upper bounds of a kind.

        Parameters
        ----------
        kind : str
            "position", "velocity", "effort" or another attribute of these limits.

        Returns
        -------
        (2, nb) array
            SI units, infinite where nothing is stated.

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").limits.bounds("effort")[:, 0]
        array([-87.,  87.])
        """
        return self.table[[*LIMIT_KINDS].index(check_choice("limit", kind, LIMIT_KINDS))]

    lower, upper = map(Bound, POSITION_ENDS)
    velocity, acceleration, jerk, snap = map(Bound, MOTION_KINDS[1:])
    effort, effort_rate, second_effort_rate = map(Bound, EFFORT_KINDS)
    power, stall_effort, no_load_velocity = map(Bound, ("power", *STALL_LINE_KINDS))
    motor_position, motor_velocity, motor_torque, motor_current, motor_voltage = map(Bound, MOTOR_KINDS)

    @property
    def effort_slope(self) -> Floats:
        """By how much the effort falls with speed, stall_effort / no_load_velocity, N m s or N s/m; else 0."""
        stated = np.isfinite(self.stall_effort)
        return np.where(stated, self.stall_effort, 0) / np.where(stated, self.no_load_velocity, 1)

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

        Examples
        --------
        >>> import jounce
        >>> jounce.load("panda").with_limits("panda").limits.of("effort_rate")
        'Q - Qgrav'
        """
        check_choice("effort limit", kind, EFFORT_KINDS)
        return BOUNDED_FORCES[kind in self.without_gravity]

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
        for key, place in LIMIT_PLACES.items():
            ends = np.atleast_1d(self.table[(*place, i)]).tolist()
            if np.isfinite(ends).any():
                alike = len(ends) == 1 or ends[0] == -ends[1]
                found[key] = ends[-1] if alike else [x if np.isfinite(x) else None for x in ends]
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


def no_limits(nb: int) -> Limits:
    """No limits of nb joint variables."""
    table = np.full((len(LIMIT_KINDS), 2, nb), np.inf)
    table[:, 0] = -np.inf
    return Limits(table)


def positive_bounds(table: Floats, key: str) -> Floats:
    """What a table (kinds, 2, ...) has under a name: the upper bounds, and the lower ones of "lower"."""
    kind, side = LIMIT_PLACES[key]
    return table[kind, side if isinstance(side, int) else 1]
