"""Limits that callers give: numbers of all coordinates, arrays, or by joint name."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError, listed, one_of, quoted
from jounce.core.scalars import asarray, is_numeric
from jounce.model.coordinates import leading_joints, limit_place
from jounce.model.kinds import EFFORT_KINDS, ENDS, FORCES, KEYS, MOTION_KINDS
from jounce.model.mechanism import Mechanism
from jounce.model.stated import Stated, limits_with


def with_limits(mechanism: Mechanism, given: Mapping[str, object], of: object = None) -> Mechanism:
    """The mechanism with some limits in place of its own; `of` says which force its effort limits bound."""
    stated = {one_of("limit", key, KEYS): value for key, value in given.items() if value is not None}
    changes: dict[int, dict[str, Stated]] = {}
    for key, value in stated.items():
        for i, number in _by_joint(mechanism, key, value).items():
            changes.setdefault(i, {})[key] = number
    return replace(mechanism, limits=limits_with(mechanism, changes, _forces(stated, of)))


def _by_joint(mechanism: Mechanism, key: str, given: object) -> dict[int, Stated]:
    """What is given for a kind of limit, by the index of the joint variable."""
    each, leaders = _limited(mechanism, key)
    if isinstance(given, Mapping):
        stated = {limit_place(mechanism, name, key): _number(key, value, name) for name, value in given.items()}
        motors = [mechanism.joints[i] for i in leaders]
        for i in stated:
            if each == "motor" and mechanism.joints[i] not in motors:
                raise JounceError(
                    f"{key} of joint {quoted(mechanism.joints[i])}: it has no motor, so that nothing would check this"
                    f" limit; expected one of {listed(motors)}, or robot.closed(actuated=[...]) with it"
                )
        return stated
    numbers, count = np.asarray(asarray(given, key)), len(leaders)
    pairs = key not in ENDS
    if not is_numeric(numbers) or numbers.shape not in [(), (count,), *[(count, 2)] * pairs]:
        more = f", ({count}, 2) for (lower, upper)" if pairs else ""
        expected = f"one number, ({count},) one per {each}{more}, or a mapping {{joint: number}}"
        raise JounceError(f"{key} has shape {numbers.shape}; expected {expected}")
    numbers = numbers if numbers.ndim else np.full(count, numbers)
    return dict(zip(leaders, numbers.tolist(), strict=True))


def _limited(mechanism: Mechanism, key: str) -> tuple[str, list[int]]:
    """What a kind of limit is stated for, coordinates or motors, and their joint variables in this order."""
    c = mechanism.closure
    if c is None or key in (*ENDS, *MOTION_KINDS):
        return "coordinate", leading_joints(mechanism)
    order = c.independent if sorted(c.actuated) == sorted(c.independent) else c.actuated
    every = leading_joints(mechanism.tree)
    return "motor", [every[j] for j in order]


def _number(key: str, given: object, joint: object) -> Stated:
    number = np.asarray(asarray(given, key))
    if not is_numeric(number) or number.shape not in [(), *[(2,)] * (key not in ENDS)]:
        pair = "" if key in ENDS else " or two, (lower, upper)"
        raise JounceError(f"{key} of joint {quoted(joint)} is {quoted(given)}; expected a number{pair}")
    return number.tolist()


def _forces(stated: Mapping[str, object], of: object) -> dict[str, str]:
    """Which forces effort limits bound: those that are stated, or that `of` names."""
    efforts = [key for key in stated if key in EFFORT_KINDS]
    said: Mapping[str, object] = (
        of if isinstance(of, Mapping) else dict.fromkeys(efforts, FORCES[0] if of is None else of)
    )
    if of is not None and not said:
        kinds = ", ".join(EFFORT_KINDS)
        raise JounceError(f"of={quoted(of)} says which force effort limits bound; expected one of {kinds}")
    return dict.fromkeys(efforts, FORCES[0]) | {
        one_of("effort limit", kind, EFFORT_KINDS): one_of("force of a limit", force, FORCES)
        for kind, force in said.items()
    }
