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
    """theta = G q + g: (..., n, 1) to (..., nc, 1); 0 at joints of several screws, whose rates are their velocities."""
    if not positions.multiscrew_joints(mechanism):
        return mechanism.G @ q + mechanism.g[:, None]
    G = mechanism.G @ positions.single_positions(mechanism)
    return Series(lambda k: mechanism.G @ q[k] if k else G @ q[0] + mechanism.g[:, None])


def joint_columns(mechanism: Mechanism) -> Array:
    """(n, nv) integers: the rates of the coordinates from the velocities, which follow the twist of a floating base."""
    return np.eye(mechanism.nv, dtype=int)[-mechanism.n :]


@lru_cache(maxsize=64)
def velocity_map(mechanism: Mechanism) -> Array:
    """The velocities of all joints, those of a floating base first, from those of the robot: (nc + 6, nv)."""
    if not mechanism.floats:
        return mechanism.G
    base = np.eye(6, mechanism.nv, dtype=int)  # the twist of the base leads
    return concatenate([base, mechanism.G @ joint_columns(mechanism)], axis=-2)


def velocity_rows(mechanism: Mechanism, body: int) -> list[int]:
    """The rows of `velocity_map` that belong to the joint of a body."""
    if mechanism.floats and body == 0:
        return list(range(6))
    return [6 * mechanism.floats + j for j in mechanism.columns[body]]


def body_screws(mechanism: Mechanism, body: int) -> Array:
    """(6, k): the screws of the joint that moves a body; the unit matrix of a base that floats."""
    if mechanism.floats and body == 0:
        return np.eye(6, dtype=int)
    return mechanism.X[list(mechanism.columns[body])].T


def generalized_forces(mechanism: Mechanism, Q: T) -> T:
    """G^T Q of forces or momenta of the joint variables: (..., nc, k) to (..., n, k)."""
    return mechanism.G.T @ Q


def generalized_matrix(mechanism: Mechanism, M: T) -> T:
    """G^T M G of a matrix of the joint variables: (..., nc, nc) to (..., n, n)."""
    return mechanism.G.T @ M @ mechanism.G


def leading_joints(mechanism: Mechanism) -> list[int]:
    """Return for each coordinate the joint with its name, or the first joint that follows it."""
    places = {joint: i for i, joint in enumerate(mechanism.joints)}
    return [
        places[name] if name in places else int(np.flatnonzero(column)[0])
        for name, column in zip(mechanism.coordinates, mechanism.G.T, strict=True)
    ]


def check_coordinate_names(mechanism: Mechanism) -> Mechanism:
    """The mechanism, refused where a coordinate is named as a joint that it does not move: it would take its limits."""
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
    """The joint variable that each name of a joint, or else of a coordinate, belongs to."""
    tree = mechanism.tree
    leaders = [
        dict(zip(names, leading_joints(tree), strict=True))
        for names in (tree.coordinates, positions.extent_names(tree))
    ]
    return leaders[0] | leaders[1] | {joint: i for i, joint in enumerate(mechanism.joints)}


def limit_place(mechanism: Mechanism, name: str, key: str) -> int:
    """The joint variable that a limit is kept at, by the name of a joint; raise `JounceError` if it has none of it.

    Limits of the position of a joint of several screws bound no single number of it.
    """
    places = joint_places(mechanism)
    for joint in positions.multiscrew_joints(mechanism).values():
        own, extents = mechanism.tree.coordinates[joint.coordinates], joint.extents
        if name in ((*own, joint.name) if key in POSITION_ENDS else (*{*extents} - {*own}, joint.name)):
            kind = f"a {joint.group.name} joint, with limits of {join_names(extents if key in POSITION_ENDS else own)}"
            raise JounceError(f"joint {quote_value(name)} has no {key} limit: {joint.name!r} is {kind}")
    return places[check_choice("joint", name, places)]


def units(mechanism: Mechanism) -> list[str]:
    """rad or m: the unit of each coordinate."""
    return ["rad" if np.any(X[:3]) else "m" for X in mechanism.X[leading_joints(mechanism)]]


def position_units(mechanism: Mechanism) -> list[str]:
    """rad, m or 1: the unit of each number of q, without those of a base that floats."""
    found = units(mechanism)
    for joint in reversed(positions.list_multiscrew_joints(mechanism)):
        places = len(joint.group.places)
        found[joint.coordinates] = ["m"] * places + ["1"] * (len(joint.names) - places)
    return found


def force_names(mechanism: Mechanism) -> tuple[str, ...]:
    """The names of the nv entries of Q: the wrench on the base of a robot that floats, and the coordinates."""
    return (*(BASE_FORCES if mechanism.floats else ()), *mechanism.coordinates)


def force_units(mechanism: Mechanism) -> list[str]:
    """N m or N: the unit of each of the nv entries of Q."""
    own = [derivative_unit("Q", 0, unit) for unit in units(mechanism)]
    return [*(["N m"] * 3 + ["N"] * 3 if mechanism.floats else []), *own]


def limits(mechanism: Mechanism) -> Limits:
    """The limits of the n coordinates.

    A joint variable that one coordinate moves bounds the motion of this coordinate, whether it leads or follows; one
    that several move does not. Effort, power and motor are those of the leading joint: what the others exert adds to Q.
    """
    table, leaders = no_limits(mechanism.n).table, leading_joints(mechanism)
    for i, row in enumerate(mechanism.G):
        moved = np.flatnonzero(row)
        if len(moved) != 1:
            continue
        [j] = moved
        for k, kind in enumerate(LIMIT_KINDS.values()):
            bounds = mechanism.limits.table[k, :, i]
            if kind.name in LIMIT_KINDS.motion:
                offset = 0.0 if kind.rate else float(mechanism.g[i])
                lower, upper = sorted((bounds - offset) / row[j])
            elif i == leaders[j]:
                lower, upper = sorted(bounds * {"Q": row[j], "q": 1 / row[j]}.get(kind.of, 1.0))
            else:
                continue
            table[k, 0, j], table[k, 1, j] = max(table[k, 0, j], lower), min(table[k, 1, j], upper)
    return replace(mechanism.limits, table=table)


def following_efforts(mechanism: Mechanism) -> list[str]:
    """The joints whose effort limits bound no motor: they follow others, or motors move them together."""
    limits, leaders, c = mechanism.limits, leading_joints(mechanism.tree), mechanism.closure
    leaders = [leaders[j] for j in c.actuated] if c else leaders
    kinds = [kind.name for kind in LIMIT_KINDS.values() if kind.of == "Q"]
    stated = [any(np.isfinite(limits.bounds(kind)[:, i]).any() for kind in kinds) for i in range(len(mechanism.joints))]
    return [joint for i, joint in enumerate(mechanism.joints) if stated[i] and i not in leaders]


def likely_positions(mechanism: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """Bounds (nc,) of the joint variables: their limits, and some turns for those that turn without any."""
    widest = np.where(mechanism.X[:, :3].any(axis=1), MAX_UNLIMITED_ANGLE, np.inf)
    lower, upper = mechanism.limits.lower, mechanism.limits.upper
    return np.where(np.isfinite(lower), lower, -widest), np.where(np.isfinite(upper), upper, widest)


def change_limits(
    mechanism: Mechanism, changes: Mapping[int, Mapping[str, StatedLimit]], forces: Mapping[str, str]
) -> Limits:
    """The limits with those of some joint variables, by their index, in place of the old ones.

    Effort limits that change bound Q, unless `forces` says otherwise.
    """
    limits, names = mechanism.limits, mechanism.joints
    table = limits.table.copy()
    for i, joint in {**changes, **_turn_limits(mechanism, changes)}.items():
        for key, value in joint.items():
            set_bound(table[..., i], key, value)
        if np.isinf(np.max(joint.get(LIMIT_KINDS.stall_line[0], 0))):
            set_bound(table[..., i], LIMIT_KINDS.stall_line[1], np.inf)  # which takes the line away
        known = {key: float(positive_bounds(table, key)[i]) for key in (*POSITION_ENDS, *LIMIT_KINDS.stall_line)}
        if error := limit_error(**{**known, **joint}):
            raise JounceError(f"joint {quote_value(names[i])}: {error}")
    changed = [kind for kind in LIMIT_KINDS.effort if any(kind in joint for joint in changes.values())]
    of = (
        {kind: limits.of(kind) for kind in LIMIT_KINDS.effort}
        | dict.fromkeys(changed, BOUNDED_FORCES[0])
        | dict(forces)
    )
    return Limits(table + 0.0, tuple(kind for kind in LIMIT_KINDS.effort if of[kind] == BOUNDED_FORCES[1]))


def _turn_limits(
    mechanism: Mechanism, changes: Mapping[int, Mapping[str, StatedLimit]]
) -> dict[int, Mapping[str, StatedLimit]]:
    """Those of the changes that are of turns of joints of several screws, checked; swings are bounded on one side."""
    found: dict[int, Mapping[str, StatedLimit]] = {}
    for body, joint in positions.multiscrew_joints(mechanism).items():
        for i, name, what in zip(mechanism.columns[body], joint.extents, joint.group.extents, strict=True):
            stated: Mapping[str, Any] = {end: x for end, x in changes.get(i, {}).items() if end in POSITION_ENDS}
            most = np.max(np.abs([x for x in stated.values() if np.isfinite(x)]), initial=0)
            if not stated or stated == {"lower": -np.inf} or what in joint.group.positions:
                continue
            if most > np.pi:
                raise JounceError(f"joint {quote_value(name)}: a limit of {most:g} rad; a {what} is never beyond pi")
            if what in ("swing", "angle") and joint.group is not groups.PLANAR:
                upper = stated.get("upper", np.nan)
                if not upper >= 0 or stated.get("lower", -upper) != -upper:
                    raise JounceError(
                        f"joint {quote_value(name)}: expected upper alone, of 0 to pi: a {what} has no sign"
                    )
                found[i] = {**changes[i], "lower": -upper}
    return found
