"""Limits that callers give: numbers of all coordinates, arrays, or by joint name."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from jounce.arguments.names import values_by_name
from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, check_choice, join_names, quote_value
from jounce.core.scalars import asarray, is_numeric
from jounce.model.coordinates import change_limits, leading_joints, limit_place
from jounce.model.limits import BOUNDED_FORCES, EFFORT_KINDS, LIMIT_KEYS, MOTION_KINDS, POSITION_ENDS, StatedLimit
from jounce.model.mechanism import Mechanism

ACTUATED = Remedy(", or robot.closed(actuated=[...]) with it")


def with_limits(mechanism: Mechanism, given: Mapping[str, object], of: object = None) -> Mechanism:
    """The mechanism with some limits in place of its own; `of` says which force its effort limits bound."""
    stated = {check_choice("limit", key, LIMIT_KEYS): value for key, value in given.items() if value is not None}
    changes: dict[int, dict[str, StatedLimit]] = {}
    for key, value in stated.items():
        for i, number in _limits_by_joint(mechanism, key, values_by_name(value)).items():
            changes.setdefault(i, {})[key] = number
    return replace(mechanism, limits=change_limits(mechanism, changes, _bounded_forces(stated, of)))


def _limits_by_joint(mechanism: Mechanism, key: str, given: object) -> dict[int, StatedLimit]:
    """What is given for a kind of limit, by the index of the joint variable."""
    each, leaders = _limited_joints(mechanism, key)
    if isinstance(given, Mapping):
        stated = {limit_place(mechanism, name, key): _limit_value(key, value, name) for name, value in given.items()}
        motors = [mechanism.joints[i] for i in leaders]
        for i in stated:
            if each == "motor" and mechanism.joints[i] not in motors:
                raise JounceError(
                    f"{key} of joint {quote_value(mechanism.joints[i])}: it has no motor, so that nothing would check"
                    f" this limit; expected one of {join_names(motors)}{ACTUATED}"
                )
        return stated
    numbers, count = np.asarray(asarray(given, key)), len(leaders)
    pairs = key not in POSITION_ENDS
    if not is_numeric(numbers) or numbers.shape not in [(), (count,), *[(count, 2)] * pairs]:
        more = f", ({count}, 2) for (lower, upper)" if pairs else ""
        expected = f"one number, ({count},) one per {each}{more}, or a mapping {{joint: number}}"
        raise JounceError(f"{key} has shape {numbers.shape}; expected {expected}")
    numbers = numbers if numbers.ndim else np.full(count, numbers)
    return dict(zip(leaders, numbers.tolist(), strict=True))


def _limited_joints(mechanism: Mechanism, key: str) -> tuple[str, list[int]]:
    """What a kind of limit is stated for, coordinates or motors, and their joint variables in this order."""
    c = mechanism.closure
    if c is None or key in (*POSITION_ENDS, *MOTION_KINDS):
        return "coordinate", leading_joints(mechanism)
    order = c.independent if sorted(c.actuated) == sorted(c.independent) else c.actuated
    every = leading_joints(mechanism.tree)
    return "motor", [every[j] for j in order]


def _limit_value(key: str, given: object, joint: object) -> StatedLimit:
    number = np.asarray(asarray(given, key))
    if not is_numeric(number) or number.shape not in [(), *[(2,)] * (key not in POSITION_ENDS)]:
        pair = "" if key in POSITION_ENDS else " or two, (lower, upper)"
        raise JounceError(f"{key} of joint {quote_value(joint)} is {quote_value(given)}; expected a number{pair}")
    return number.tolist()


def _bounded_forces(stated: Mapping[str, object], of: object) -> dict[str, str]:
    """Which forces effort limits bound: those that are stated, or that `of` names."""
    efforts = [key for key in stated if key in EFFORT_KINDS]
    said: Mapping[str, object] = (
        of if isinstance(of, Mapping) else dict.fromkeys(efforts, BOUNDED_FORCES[0] if of is None else of)
    )
    if of is not None and not said:
        kinds = ", ".join(EFFORT_KINDS)
        raise JounceError(f"of={quote_value(of)} says which force effort limits bound; expected one of {kinds}")
    return dict.fromkeys(efforts, BOUNDED_FORCES[0]) | {
        check_choice("effort limit", kind, EFFORT_KINDS): check_choice("force of a limit", force, BOUNDED_FORCES)
        for kind, force in said.items()
    }
