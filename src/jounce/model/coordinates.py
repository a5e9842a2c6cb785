"""Coordinates q and joint variables theta of a mechanism: ``theta = G q + g`` and what follows from it.

Forces and matrices of the joint variables become those of the coordinates by G^T (the principle of virtual work), as
arrays and as time series alike. Limits are kept of joint variables: `coordinate_limits` are those of the coordinates,
and `change_limits` changes some, by the names of either.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from jounce.core.errors import JounceError, check_choice, join_names, quote_value
from jounce.core.scalars import Array, concatenate, is_numeric
from jounce.model import positions
from jounce.model.limits import (
    BOUNDED_FORCES,
    LIMIT_KINDS,
    POSITION_ENDS,
    Limits,
    StatedLimit,
    derivative_unit,
    limit_error,
    no_limits,
    positive_bounds,
    set_bound,
)
from jounce.model.mechanism import Mechanism
from jounce.spatial import groups
from jounce.spatial.series import Series

T = TypeVar("T", Array, Series)
BASE_FORCES = tuple(f"base.{component}" for component in ("mx", "my", "mz", "fx", "fy", "fz"))
MAX_UNLIMITED_ANGLE = 8 * np.pi  # rad: four turns, further than joints without limits are taken to go
MIN_DEGREES_ANGLE = 6.3  # rad, just above a turn: only larger angles are taken for degrees


def joint_variables(mechanism: Mechanism, q: Series) -> Series:
    """Return theta = G q + g with its rates: (..., n, 1) to (..., nc, 1).

    Values are 0 at joints of several screws, rates their velocities.
    """
    if not positions.multiscrew_joints(mechanism):
        return mechanism.G @ q + mechanism.g[:, None]
    # q has nq numbers, its rates n: (nc, n) @ (n, nq) picks the numbers of joints of one screw.
    G = mechanism.G @ positions.single_positions(mechanism)
    return Series(lambda k: mechanism.G @ q[k] if k else G @ q[0] + mechanism.g[:, None])


def joint_columns(mechanism: Mechanism) -> Array:
    """Return the integers (n, nv) from velocities to rates of coordinates.

    The velocities begin with the twist of a floating base.
    """
    return np.eye(mechanism.nv, dtype=int)[-mechanism.n :]


@lru_cache(maxsize=64)
def velocity_map(mechanism: Mechanism) -> Array:
    """Return the matrix (nc + 6, nv) to the velocities of joints.

    The six rows of a floating base come first; other robots have (nc, n).
    """
    if not mechanism.floats:
        return mechanism.G
    base = np.eye(6, mechanism.nv, dtype=int)
    return concatenate([base, mechanism.G @ joint_columns(mechanism)], axis=-2)


def velocity_rows(mechanism: Mechanism, body: int) -> list[int]:
    """Return the rows of `velocity_map` of the joint of a body."""
    if mechanism.floats and body == 0:
        return list(range(6))
    return [6 * mechanism.floats + j for j in mechanism.columns[body]]


def body_screws(mechanism: Mechanism, body: int) -> Array:
    """Return the screws (6, k) of the joint that moves a body.

    Those of a base that floats are the unit matrix.
    """
    if mechanism.floats and body == 0:
        return np.eye(6, dtype=int)
    return mechanism.X[list(mechanism.columns[body])].T


def generalized_forces(mechanism: Mechanism, Q: T) -> T:
    """Return G^T Q of forces or momenta of joint variables: (..., nc, k) to (..., n, k)."""
    return mechanism.G.T @ Q


def generalized_matrix(mechanism: Mechanism, M: T) -> T:
    """Return G^T M G of a matrix of joint variables: (..., nc, nc) to (..., n, n)."""
    return mechanism.G.T @ M @ mechanism.G


def leading_joints(mechanism: Mechanism) -> list[int]:
    """Return the joint of the name of each coordinate.

    Without one it is the first joint that follows the coordinate.
    """
    places = {joint: i for i, joint in enumerate(mechanism.joints)}
    return [
        places[name] if name in places else int(np.flatnonzero(column)[0])
        for name, column in zip(mechanism.coordinates, mechanism.G.T, strict=True)
    ]


def check_coordinate_names(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism if names of coordinates and joints agree.

    No coordinate may be named after a joint that it does not move. Such a coordinate would take the limits of the
    joint.
    """
    m, places = mechanism, {joint: i for i, joint in enumerate(mechanism.joints)}
    for name, column in zip(m.coordinates, m.G.T, strict=True) if is_numeric(m.G) else ():
        if name in places and not column[places[name]]:
            moved = join_names([quote_value(m.joints[i]) for i in np.flatnonzero(column)])
            raise JounceError(
                f"coordinate {quote_value(name)} moves {moved} and not the joint of its name, whose limits it takes;"
                " rename it by joint_names, such as 'q1', or exchange the columns of G"
            )
    return mechanism


def joint_places(mechanism: Mechanism) -> dict[str, int]:
    """Return the joint variable of each name of joints and coordinates."""
    # A name of several kinds is that of a joint first, then of what limits bound, then of a coordinate.
    tree = mechanism.tree
    leaders = leading_joints(tree)
    by_coordinate = dict(zip(tree.coordinates, leaders, strict=True))
    by_extent = dict(zip(positions.extent_names(tree), leaders, strict=True))
    return by_coordinate | by_extent | {joint: i for i, joint in enumerate(mechanism.joints)}


def limit_place(mechanism: Mechanism, name: str, key: str) -> int:
    """Return the joint variable at which a limit is kept.

    It is found by the name of a joint.

    Raises `JounceError` if the joint has no such limit: limits of the position of a joint of several screws bound no
    single number of it.
    """
    places = joint_places(mechanism)
    bounds_position = key in POSITION_ENDS
    for joint in positions.multiscrew_joints(mechanism).values():
        # Positions are limited by the names of their extents, rates and forces by those of velocities.
        velocities, extents = mechanism.tree.coordinates[joint.coordinates], joint.extents
        if bounds_position:
            limited_names, other_names = extents, {*velocities}
        else:
            limited_names, other_names = velocities, {*extents} - {*velocities}
        if name == joint.name or name in other_names:
            kind = f"a {joint.group.name} joint, with limits of {join_names(limited_names)}"
            raise JounceError(f"joint {quote_value(name)} has no {key} limit: {joint.name!r} is {kind}")
    return places[check_choice("joint", name, places)]


def units(mechanism: Mechanism) -> list[str]:
    """Return rad or m, the unit of each coordinate."""
    return ["rad" if np.any(X[:3]) else "m" for X in mechanism.X[leading_joints(mechanism)]]


def position_units(mechanism: Mechanism) -> list[str]:
    """Return rad, m or 1, the unit of each number of q.

    The numbers of a floating base are left out.
    """
    # From the last joint to the first, since a joint has more numbers than velocities: n entries become nq.
    units_of_q = units(mechanism)
    for joint in reversed(positions.list_multiscrew_joints(mechanism)):
        places = len(joint.group.places)
        units_of_q[joint.coordinates] = ["m"] * places + ["1"] * (len(joint.names) - places)
    return units_of_q


def force_names(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names of the nv entries of Q.

    They are the wrench on the base of a robot that floats, and the coordinates.
    """
    return (*(BASE_FORCES if mechanism.floats else ()), *mechanism.coordinates)


def force_units(mechanism: Mechanism) -> list[str]:
    """Return N m or N, the unit of each entry of Q."""
    of_coordinates = [derivative_unit("Q", 0, unit) for unit in units(mechanism)]
    of_base = ["N m"] * 3 + ["N"] * 3 if mechanism.floats else []
    return [*of_base, *of_coordinates]


def limits(mechanism: Mechanism) -> Limits:
    """Return the limits of the n coordinates.

    A joint variable that one coordinate moves bounds the motion of this coordinate, whether it leads or follows; one
    that several move does not. Effort, power and motor are those of the leading joint: what the others exert adds to Q.
    """
    table, leaders = no_limits(mechanism.n).table, leading_joints(mechanism)
    for i, row in enumerate(mechanism.G):
        moving_coordinates = np.flatnonzero(row)
        if len(moving_coordinates) != 1:
            continue
        [j] = moving_coordinates
        for k, kind in enumerate(LIMIT_KINDS[name] for name in LIMIT_KINDS.of_joints):
            bounds = mechanism.limits.table[k, :, i]
            # theta = G_ij q + g_i: bounds of the position are shifted and scaled, those of rates are scaled; a negative
            # ratio exchanges them. Forces of the leading joint are scaled by G_ij, its no-load velocity by 1 / G_ij.
            if kind.name in LIMIT_KINDS.motion:
                offset = 0.0 if kind.rate else float(mechanism.g[i])
                lower, upper = sorted((bounds - offset) / row[j])
            elif i == leaders[j]:
                lower, upper = sorted(bounds * {"Q": row[j], "q": 1 / row[j]}.get(kind.of, 1.0))
            else:
                continue
            # Of several joints that one coordinate moves, the tightest bound counts.
            table[k, 0, j], table[k, 1, j] = max(table[k, 0, j], lower), min(table[k, 1, j], upper)
    return replace(mechanism.limits, table=table)


def shared_coordinates(mechanism: Mechanism) -> tuple[int, ...]:
    """Return the coordinates that motors elsewhere move together.

    They are places among those of the tree. Without loops, the force of all motors on such a coordinate is known.
    """
    c = mechanism.closure
    if c is None or len(mechanism.loops) > 0:
        return ()
    return tuple(j for j in c.independent if j not in c.actuated)


def following_efforts(mechanism: Mechanism) -> list[str]:
    """Return the joints whose effort limits bound nothing.

    They follow others, or motors move them together in loops.
    """
    limits, leaders, c = mechanism.limits, leading_joints(mechanism.tree), mechanism.closure
    if c is not None:
        leaders = [leaders[j] for j in (*c.actuated, *shared_coordinates(mechanism))]
    kinds = [kind.name for kind in LIMIT_KINDS.values() if kind.of == "Q"]
    has_effort_limit = np.any([np.isfinite(limits.bounds(kind)).any(axis=0) for kind in kinds], axis=0)
    return [joint for i, joint in enumerate(mechanism.joints) if has_effort_limit[i] and i not in leaders]


def likely_positions(mechanism: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds (nc,) of the joint variables: limits, or some turns without them."""
    widest = np.where(mechanism.X[:, :3].any(axis=1), MAX_UNLIMITED_ANGLE, np.inf)
    lower, upper = mechanism.limits.lower, mechanism.limits.upper
    return np.where(np.isfinite(lower), lower, -widest), np.where(np.isfinite(upper), upper, widest)


def change_limits(
    mechanism: Mechanism, changes: Mapping[int, Mapping[str, StatedLimit]], forces: Mapping[str, str]
) -> Limits:
    """Return the limits with changes of some joint variables, by their index.

    Effort limits that change bound Q, unless `forces` says otherwise.
    """
    limits, names = mechanism.limits, mechanism.joints
    table = limits.table.copy()
    for i, joint in {**changes, **_turn_limits(mechanism, changes)}.items():
        for key, value in joint.items():
            set_bound(table[..., i], key, value)
        if np.isinf(np.max(joint.get(LIMIT_KINDS.stall_line[0], 0))):
            set_bound(table[..., i], LIMIT_KINDS.stall_line[1], np.inf)  # which takes the line away
        # A new bound is checked with the old ones that it belongs to: lower with upper, and both ends of a line.
        old_bounds = {key: float(positive_bounds(table, key)[i]) for key in (*POSITION_ENDS, *LIMIT_KINDS.stall_line)}
        error = limit_error(**{**old_bounds, **joint})
        if error is not None:
            raise JounceError(f"joint {quote_value(names[i])}: {error}")
    # Which force each kind bounds: as before, Q where the kind changes, and what the caller states.
    changed_kinds = [kind for kind in LIMIT_KINDS.effort if any(kind in joint for joint in changes.values())]
    bounded_forces = {kind: limits.of(kind) for kind in LIMIT_KINDS.effort}
    bounded_forces |= dict.fromkeys(changed_kinds, BOUNDED_FORCES[0])
    bounded_forces |= dict(forces)
    without_gravity = [kind for kind in LIMIT_KINDS.effort if bounded_forces[kind] == BOUNDED_FORCES[1]]
    return Limits(table + 0.0, tuple(without_gravity), limits.totals)


def _turn_limits(
    mechanism: Mechanism, changes: Mapping[int, Mapping[str, StatedLimit]]
) -> dict[int, Mapping[str, StatedLimit]]:
    """Return the changes of turns of joints of several screws, checked.

    Swings and angles have no sign: an upper bound alone stands for both.
    """
    one_sided: dict[int, Mapping[str, StatedLimit]] = {}
    for body, joint in positions.multiscrew_joints(mechanism).items():
        for i, name, what in zip(mechanism.columns[body], joint.extents, joint.group.extents, strict=True):
            ends: Mapping[str, Any] = {end: x for end, x in changes.get(i, {}).items() if end in POSITION_ENDS}
            largest = np.max(np.abs([x for x in ends.values() if np.isfinite(x)]), initial=0)
            # Places are limited as any position is, and an infinite lower bound takes a limit away.
            if len(ends) == 0 or ends == {"lower": -np.inf} or what in joint.group.positions:
                continue
            if largest > np.pi:
                raise JounceError(f"joint {quote_value(name)}: a limit of {largest:g} rad; a {what} is never beyond pi")
            if what in ("swing", "angle") and joint.group is not groups.PLANAR:
                upper = ends.get("upper", np.nan)
                if not upper >= 0 or ends.get("lower", -upper) != -upper:
                    raise JounceError(
                        f"joint {quote_value(name)}: expected upper alone, of 0 to pi: a {what} has no sign"
                    )
                one_sided[i] = {**changes[i], "lower": -upper}
    return one_sided
