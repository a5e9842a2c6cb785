"""The limits of joints bound a motion: those of coordinates, and of joints that follow them.

Columns are coordinates of the tree: of closed robots those that follow others in loops too. Forces of a closed robot
bound those that are actuated, whether the motion is given in their coordinates or in others; they are zero elsewhere.
`joint_rates` and `scatter_columns` give the columns of rates and of quantities, `compute_at_speed` and
`compute_gravity` the quantities of the joints at states.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jounce.dynamics.loops import closure_of
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES, Quantity
from jounce.engine import closed_path, generic_methods
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates
from jounce.engine.plan import compute
from jounce.model import coordinates, positions
from jounce.model.limits import LIMIT_KINDS, Limits
from jounce.model.mechanism import Mechanism


def joint_names(m: Mechanism) -> tuple[str, ...]:
    """The names of the columns."""
    return m.tree.coordinates


def joint_units(m: Mechanism) -> list[str]:
    """The units of the columns, rad or m."""
    return coordinates.units(m.tree)


def joint_limits(m: Mechanism) -> Limits:
    """The limits of the columns; efforts and motors of joints without a motor have none."""
    limits = coordinates.limits(m.tree)
    if m.closure is None:
        return limits
    return _without_forces(limits, [j for j in range(m.tree.n) if j not in m.closure.actuated])


def limits_of_coordinates(m: Mechanism) -> Limits:
    """The limits of the coordinates: forces are limited where motors are at all of them, as Q is of motors then."""
    if m.closure is None:
        return joint_limits(m)
    limits = joint_limits(m).select(list(m.independent_places))
    return limits if drives_coordinates(m) else _without_forces(limits, range(m.n))


def _without_forces(limits: Limits, columns: Sequence[int]) -> Limits:
    """The limits without those of forces and motors of some columns."""
    table, forces = limits.table.copy(), [k for k, kind in enumerate(LIMIT_KINDS) if kind not in LIMIT_KINDS.motion]
    table[np.ix_(forces, [0], columns)], table[np.ix_(forces, [1], columns)] = -np.inf, np.inf
    return replace(limits, table=table)


def drives_coordinates(m: Mechanism) -> bool:
    """Whether the motors are at the coordinates of a robot, so that Q are their forces."""
    return m.closure is None or sorted(m.closure.actuated) == sorted(m.closure.independent)


def effort_quantity(m: Mechanism) -> Quantity:
    """The row of the forces that effort limits bound."""
    return DEFAULT_QUANTITY if drives_coordinates(m) else QUANTITIES["actuator_forces"]


def quantity_columns(m: Mechanism, row: Quantity) -> Sequence[int]:
    """The columns of a quantity, which are motors or coordinates."""
    if m.closure is None:
        return range(m.n)
    return m.closure.force_places if "motors" in row.gives.shape else m.closure.independent


def drop_base(m: Mechanism, found: Any, row: Quantity) -> list[np.ndarray]:
    """A quantity and its rates without the entries of a base, which no limit bounds."""
    return [x[..., -len(quantity_columns(m, row)) :] for x in generic_methods.as_tuple(found)]


def scatter_columns(m: Mechanism, found: Sequence[np.ndarray], row: Quantity) -> list[np.ndarray]:
    """Columns of all joints from those of a quantity."""
    if m.closure is None:
        return list(found)
    return [_place_columns(x, quantity_columns(m, row), m.tree.n) for x in found]


def joint_rates(
    robot: Engine, rates: Sequence[np.ndarray], position: np.ndarray | None, needed: bool = True
) -> tuple[np.ndarray, ...]:
    """q, qd, ... of all joints; where those that follow others are not needed, these are zero.

    The first term is what position limits bound, such as the swing of a ball in the place of its coordinates.
    """
    m = robot.mechanism
    if position is None:
        found = tuple(rates)
    elif not needed:
        found = tuple(_place_columns(x, closure_of(m).independent, m.tree.n) for x in rates)
    else:
        found = generic_methods.as_tuple(
            compute(robot, "coordinates", closed_path.with_tree_positions(tuple(rates), position))
        )
    return positions.extents(m.tree, found[0]), *found[1:]


def _place_columns(x: np.ndarray, places: Sequence[int], count: int) -> np.ndarray:
    whole = np.zeros((*x.shape[:-1], count))
    whole[..., list(places)] = x
    return whole


def compute_at_speed(
    robot: Engine, states: MotionStates, row: Quantity, order: int, c: float = 1.0
) -> list[np.ndarray]:
    """A quantity of the joints and its rates up to an order at c times the speed."""
    return drop_base(robot.mechanism, states.upto(row, order).scaled(c).compute(robot, row.name), row)


def compute_gravity(robot: Engine, states: MotionStates, order: int) -> list[np.ndarray]:
    """The gravity forces of the joints and their rates."""
    row = QUANTITIES["gravity_forces"]
    return drop_base(robot.mechanism, replace(states.upto(row, order), wrench=None).compute(robot, row.name), row)
