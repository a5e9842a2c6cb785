"""The limits of joints bound a motion: those of coordinates, and of joints that follow them.

Columns are coordinates of the tree: of closed robots those that follow others in loops too. Forces of a closed robot
are those of joints with motors, whether the motion is given in their coordinates or in others. Where motors move joints
together without loops, forces of the coordinates are those too that all motors exert on them, ``F^T tau``, which limits
of these joints bound; elsewhere they are zero.
`joint_rates` and `scatter_columns` give the columns of rates and of quantities, `compute_at_speed` and
`compute_gravity` the quantities of the joints at states.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from jounce.core.errors import quote_value
from jounce.dynamics.loops import closure_of
from jounce.dynamics.quantities import DEFAULT_QUANTITY, QUANTITIES, Quantity
from jounce.engine import closed_path, generic_methods
from jounce.engine.engine import Engine
from jounce.engine.motion_states import MotionStates
from jounce.engine.plan import compute
from jounce.model import coordinates, positions
from jounce.model.limits import LIMIT_KINDS, Limits
from jounce.model.mechanism import Mechanism
from jounce.model.transmissions import with_followers

WHOLE_ROBOT = "robot"  # the name of the column of a sum over all joints


def joint_names(m: Mechanism) -> tuple[str, ...]:
    """Return the names of the columns."""
    return m.tree.coordinates


def joint_units(m: Mechanism) -> list[str]:
    """Return the units of the columns, rad or m."""
    return coordinates.units(m.tree)


def joint_limits(m: Mechanism) -> Limits:
    """Return the limits of the columns.

    Efforts and motors of joints without a force have none.
    """
    limits = coordinates.limits(m.tree)
    if m.closure is None:
        return limits
    with_force = (*m.closure.actuated, *coordinates.shared_coordinates(m))
    return _without_forces(limits, [j for j in range(m.tree.n) if j not in with_force])


def limits_of_coordinates(m: Mechanism) -> Limits:
    """Return the limits of the coordinates.

    Forces are limited where motors are at all of the coordinates, as Q is of motors then.
    """
    if m.closure is None:
        return joint_limits(m)
    limits = joint_limits(m).select(list(m.independent_places))
    return limits if drives_coordinates(m) else _without_forces(limits, range(m.n))


def _without_forces(limits: Limits, columns: Sequence[int]) -> Limits:
    """Return the limits without those of forces and motors of some columns."""
    table = limits.table.copy()
    forces = [k for k, kind in enumerate(LIMIT_KINDS.of_joints) if kind not in LIMIT_KINDS.motion]
    # (kinds, 2, columns): lower and upper bounds.
    table[np.ix_(forces, [0], columns)], table[np.ix_(forces, [1], columns)] = -np.inf, np.inf
    return replace(limits, table=table)


def drives_coordinates(m: Mechanism) -> bool:
    """Whether the motors are at the coordinates of a robot.

    Then Q are their forces.
    """
    return m.closure is None or sorted(m.closure.actuated) == sorted(m.closure.independent)


def column_names(m: Mechanism, kind: str) -> tuple[str, ...]:
    """Return the names of what limits of a kind bound.

    They are the joints, or of positions the extents of joints of several screws; of sums over joints the robot.
    """
    if LIMIT_KINDS[kind].is_total:
        return (WHOLE_ROBOT,)
    return positions.extent_names(m.tree) if kind == "position" else joint_names(m)


def column_owner(m: Mechanism, kind: str, column: int) -> str:
    """Return whose limit a column is, in words."""
    return "the robot" if LIMIT_KINDS[kind].is_total else f"joint {quote_value(column_names(m, kind)[column])}"


def has_motors(m: Mechanism) -> np.ndarray:
    """Return which of the columns have a motor."""
    return np.isin(np.arange(m.tree.n), range(m.tree.n) if m.closure is None else m.closure.actuated)


def power_factors(m: Mechanism, kind: str) -> tuple[str, ...]:
    """Return the kinds whose values make the power of the whole robot.

    Where joints are elastic motors are behind springs, and theirs count. Other kinds have none.
    """
    row = LIMIT_KINDS[kind]
    return row.elastic_factors if m.elasticity is not None and len(row.elastic_factors) > 0 else row.factors


def effort_quantity(m: Mechanism) -> Quantity:
    """Return the row of the forces that effort limits bound."""
    return DEFAULT_QUANTITY if drives_coordinates(m) else QUANTITIES["actuator_forces"]


def quantity_columns(m: Mechanism, row: Quantity) -> Sequence[int]:
    """Return the columns of a quantity, which are motors or coordinates."""
    if m.closure is None:
        return range(m.n)
    return m.closure.force_places if "motors" in row.gives.shape else m.closure.independent


def drop_base(m: Mechanism, rates: Any, row: Quantity) -> list[np.ndarray]:
    """Return a quantity and its rates without those of a base.

    No limit bounds these entries.
    """
    return [x[..., -len(quantity_columns(m, row)) :] for x in generic_methods.as_tuple(rates)]


def scatter_columns(m: Mechanism, rates: Sequence[np.ndarray], row: Quantity) -> list[np.ndarray]:
    """Return columns of all joints from those of a quantity.

    Those of coordinates that motors move together come from all motors.
    """
    if m.closure is None:
        return list(rates)
    if len(_shared_columns(m, row)) == 0:
        return [_place_columns(x, quantity_columns(m, row), m.tree.n) for x in rates]
    return [x @ _columns_of_motors(m) for x in rates]


def scatter_sizes(m: Mechanism, sizes: Sequence[np.ndarray], row: Quantity) -> list[np.ndarray]:
    """Return columns of all joints from sizes of a quantity, as deviations.

    Sizes of several motors add up, since their signs are not known.
    """
    if m.closure is None or len(_shared_columns(m, row)) == 0:
        return scatter_columns(m, sizes, row)
    return [x @ np.abs(_columns_of_motors(m)) for x in sizes]


def _shared_columns(m: Mechanism, row: Quantity) -> Sequence[int]:
    """Return the columns that all motors move together, of forces of motors."""
    return coordinates.shared_coordinates(m) if "motors" in row.gives.shape else ()


def _motor_ratios(m: Mechanism) -> np.ndarray:
    """Return F (k, n), by which motors move with coordinates."""
    return np.asarray(with_followers(m).G[list(closure_of(m).actuated)], dtype=float)


@lru_cache(maxsize=64)
def _columns_of_motors(m: Mechanism) -> np.ndarray:
    """Return the matrix (k, N) from forces of motors to columns: 1 for a motor, F^T for coordinates."""
    shared = coordinates.shared_coordinates(m)
    places = [closure_of(m).independent.index(j) for j in shared]
    columns = _place_columns(np.eye(len(closure_of(m).actuated)), closure_of(m).actuated, m.tree.n)
    columns[:, list(shared)] = _motor_ratios(m)[:, places]
    return columns


@lru_cache(maxsize=64)
def motors_of_coordinates(m: Mechanism) -> np.ndarray:
    """Return the matrix (n, k) from forces of coordinates to those of motors.

    tau = W^-1 F (F^T W^-1 F)^-1 Q is the least tau that makes Q; redundant motors share it by their weights W.
    """
    F = _motor_ratios(m)
    weighted = F / closure_of(m).weights[:, None]
    return np.linalg.solve(weighted.T @ F, weighted.T)


def columns_of_coordinates(m: Mechanism) -> np.ndarray:
    """Return the matrix (n, N) from forces of coordinates to columns."""
    if m.closure is None:
        return np.eye(m.n)
    if drives_coordinates(m):
        return _place_columns(np.eye(m.n), m.closure.independent, m.tree.n)
    return motors_of_coordinates(m) @ _columns_of_motors(m)


def joint_rates(
    robot: Engine, rates: Sequence[np.ndarray], position: np.ndarray | None, needed: bool = True
) -> tuple[np.ndarray, ...]:
    """Return q, qd, ... of all joints.

    Where joints that follow others are not needed, theirs are zero. The first term is what position limits bound, such
    as the swing of a ball in the place of its coordinates.
    """
    m = robot.mechanism
    # Without a position no joint follows others. With one, it is that of the tree, whose joints it makes follow.
    if position is None:
        joints = tuple(rates)
    elif not needed:
        joints = tuple(_place_columns(x, closure_of(m).independent, m.tree.n) for x in rates)
    else:
        tree_rates = closed_path.with_tree_positions(tuple(rates), position)
        joints = generic_methods.as_tuple(compute(robot, "coordinates", tree_rates))
    return positions.extents(m.tree, joints[0]), *joints[1:]


def _place_columns(x: np.ndarray, places: Sequence[int], count: int) -> np.ndarray:
    """Return columns with those of x in their places.

    The others, up to `count`, are zero.
    """
    whole = np.zeros((*x.shape[:-1], count))
    whole[..., list(places)] = x
    return whole


def compute_at_speed(
    robot: Engine, states: MotionStates, row: Quantity, order: int, c: float = 1.0
) -> list[np.ndarray]:
    """Compute a quantity of the joints at c times the speed.

    Its rates go up to an order.
    """
    return drop_base(robot.mechanism, states.upto(row, order).scaled(c).compute(robot, row.name), row)


def compute_gravity(robot: Engine, states: MotionStates, order: int) -> list[np.ndarray]:
    """Compute the gravity forces of the joints and their rates."""
    row = QUANTITIES["gravity_forces"]
    return drop_base(robot.mechanism, replace(states.upto(row, order), wrench=None).compute(robot, row.name), row)
