"""Limits that callers and files state: a number or two by the names of their bounds, checked, and as data."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, check_choice, quote_value
from jounce.core.scalars import Array, asarray, is_numeric
from jounce.core.typing import Floats
from jounce.model.limit_kinds import (
    BOUNDED_FORCES,
    EFFORT_KINDS,
    LIMIT_KINDS,
    LIMIT_PLACES,
    POSITION_ENDS,
    STALL_LINE_KINDS,
)
from jounce.model.limits import Limits, no_limits, positive_bounds
from jounce.model.mechanism import Mechanism
from jounce.model.positions import multiscrew_joints
from jounce.spatial.groups import PLANAR

StatedLimit = float | Sequence[float]  # one number for both directions, or (lower, upper)


def limits_of_joints(stated: Sequence[Mapping[str, StatedLimit]], without_gravity: Sequence[str] = ()) -> Limits:
    """The limits that are stated of each joint variable, checked where they are read."""
    table = no_limits(len(stated)).table
    for i, joint in enumerate(stated):
        for key, value in joint.items():
            _set_bound(table[..., i], key, value)
    return Limits(table + 0.0, tuple(without_gravity))  # no -0.0 among data


def limit_error(**stated: StatedLimit) -> str | None:
    """What keeps numbers from being the limits of a joint variable, or None."""
    lower, upper = float(stated.get("lower", -np.inf)), float(stated.get("upper", np.inf))  # type: ignore[arg-type]
    if not (-np.inf <= lower <= upper <= np.inf) or lower == np.inf or upper == -np.inf:
        return f"lower and upper limit are {lower:g} and {upper:g}; expected lower <= upper"
    line = {key: float(np.max(stated.get(key, np.inf))) for key in STALL_LINE_KINDS}
    if len(set(np.isfinite([*line.values()]))) > 1:
        words = " and ".join(f"{key} is {value:g}" for key, value in line.items())
        line_law = "effort / stall_effort + velocity / no_load_velocity = 1"
        return f"{words}; expected both, of the line {line_law}, or neither"
    bounds: Mapping[str, Any] = {key: value for key, value in stated.items() if key not in POSITION_ENDS}
    for key, value in bounds.items():
        if key in STALL_LINE_KINDS:
            if not np.max(value) > 0 or (np.ndim(value) and value[0] != -value[1]):
                return f"{key} is {value}; expected one number above 0, for both directions"
        elif np.ndim(value) == 0:
            if not value >= 0:
                return f"limit of {key} is {value:g}; expected 0 or more"
        elif not (value[0] <= value[1] if LIMIT_KINDS[key].any_sign else value[0] <= 0 <= value[1]):
            expected = "lower <= upper" if LIMIT_KINDS[key].any_sign else "lower <= 0 <= upper"
            return f"limits of {key} are {value[0]:g} and {value[1]:g}; expected {expected}"
    return None


def check_limits(given: object, nb: int) -> Limits:
    """Limits of nb joint variables: those of another robot, or a mapping of arrays (nb,), two-sided ones (nb, 2)."""
    if isinstance(given, Limits):
        if given.table.shape[-1] != nb:
            raise JounceError(f"limits are of {given.table.shape[-1]} joint variables; expected {nb}")
        return replace(given, table=given.table.copy())
    stated = {} if given is None else given
    if not isinstance(stated, Mapping):
        raise JounceError(f"limits is of type {type(given).__name__}; expected a mapping of {', '.join(LIMIT_PLACES)}")
    arrays = {check_choice("limit", key, LIMIT_PLACES): _check_numbers(array, key, nb) for key, array in stated.items()}
    joints: list[Mapping[str, Any]] = [{key: array[i] for key, array in arrays.items()} for i in range(nb)]
    for i, joint in enumerate(joints):
        if error := limit_error(**joint):
            raise JounceError(f"limits of joint {i}: {error}")
    return limits_of_joints(joints)


def _check_numbers(array: Array, key: str, nb: int) -> np.ndarray:
    numbers = np.asarray(asarray(array, key))
    shapes = [(nb,)] if key in POSITION_ENDS else [(nb,), (nb, 2)]
    if numbers.shape not in shapes or not is_numeric(numbers):
        words = " or ".join(map(str, shapes))
        raise JounceError(f"limits: {key} has shape {numbers.shape}; expected numbers {words}, one per joint")
    return numbers


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
            _set_bound(table[..., i], key, value)
        if np.isinf(np.max(joint.get(STALL_LINE_KINDS[0], 0))):
            _set_bound(table[..., i], STALL_LINE_KINDS[1], np.inf)  # which takes the line away
        known = {key: float(positive_bounds(table, key)[i]) for key in (*POSITION_ENDS, *STALL_LINE_KINDS)}
        if error := limit_error(**{**known, **joint}):
            raise JounceError(f"joint {quote_value(names[i])}: {error}")
    changed = [kind for kind in EFFORT_KINDS if any(kind in joint for joint in changes.values())]
    of = {kind: limits.of(kind) for kind in EFFORT_KINDS} | dict.fromkeys(changed, BOUNDED_FORCES[0]) | dict(forces)
    return Limits(table + 0.0, tuple(kind for kind in EFFORT_KINDS if of[kind] == BOUNDED_FORCES[1]))


def _turn_limits(
    mechanism: Mechanism, changes: Mapping[int, Mapping[str, StatedLimit]]
) -> dict[int, Mapping[str, StatedLimit]]:
    """Those of the changes that are of turns of joints of several screws, checked; swings are bounded on one side."""
    found: dict[int, Mapping[str, StatedLimit]] = {}
    for body, joint in multiscrew_joints(mechanism).items():
        for i, name, what in zip(mechanism.columns[body], joint.extents, joint.group.extents, strict=True):
            stated: Mapping[str, Any] = {end: x for end, x in changes.get(i, {}).items() if end in POSITION_ENDS}
            most = np.max(np.abs([x for x in stated.values() if np.isfinite(x)]), initial=0)
            if not stated or stated == {"lower": -np.inf} or what in joint.group.positions:
                continue
            if most > np.pi:
                raise JounceError(f"joint {quote_value(name)}: a limit of {most:g} rad; a {what} is never beyond pi")
            if what in ("swing", "angle") and joint.group is not PLANAR:
                upper = stated.get("upper", np.nan)
                if not upper >= 0 or stated.get("lower", -upper) != -upper:
                    raise JounceError(
                        f"joint {quote_value(name)}: expected upper alone, of 0 to pi: a {what} has no sign"
                    )
                found[i] = {**changes[i], "lower": -upper}
    return found


def _set_bound(table: Floats, key: str, value: StatedLimit) -> None:
    """Write what is stated under a key into a table (kinds, 2) of one joint variable."""
    kind, side = LIMIT_PLACES[key]
    table[kind, side] = value if isinstance(side, int) or np.ndim(value) else (-value, value)  # type: ignore[operator]
