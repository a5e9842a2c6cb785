"""Positions and velocities of balls, planar and free joints as a caller gives them, checked, as numbers of q.

By joint name a position is the numbers of its kind, a rotation matrix or a pose, and a velocity is one vector. The
layout of a whole floating robot, its base first, is the motion of the base and the state of the joints behind it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from jounce.arguments.poses import POSE_TOLERANCE, check_pose
from jounce.core import named_entries
from jounce.core.errors import JounceError
from jounce.core.scalars import Array, asarray, is_numeric
from jounce.dynamics.quantities import Quantity
from jounce.model.mechanism import Mechanism
from jounce.model.positions import Position, multiscrew_joints, whole_position_count
from jounce.spatial.groups import FREE
from jounce.spatial.lie import pose

MIN_ROTATION_NORM = (
    1e-6  # of a quaternion, or of a cosine and a sine: a shorter one has lost too many digits to be a rotation
)


def numbers_by_name(mechanism: Mechanism, given: Any) -> Any:
    """A position by joint name, with the numbers of joints of several screws one by one under their own names."""
    return _split_joints(mechanism, given, lambda x: x.names, _position_numbers)


def velocities_by_name(mechanism: Mechanism, given: Any) -> Any:
    """A rate of the position by joint name, with the velocities of such joints one by one."""
    return _split_joints(mechanism, given, lambda x: mechanism.coordinates[x.coordinates], _velocity_numbers)


def _split_joints(
    mechanism: Mechanism,
    given: Any,
    names_of: Callable[[Position], Sequence[str]],
    numbers_of: Callable[[Position, Any], Array],
) -> Any:
    joints = {x.name: x for x in multiscrew_joints(mechanism).values()}
    if not joints:
        return given
    found: dict[Any, Any] = {}
    for name, value in named_entries.read_entries(given).items():
        if (joint := joints.get(name)) is None:
            found[name] = value
        else:
            numbers = numbers_of(joint, value)
            found |= {label: numbers[..., k] for k, label in enumerate(names_of(joint))}
    return found


def _position_numbers(joint: Position, value: Any) -> Array:
    """The numbers of a joint, (..., k), from these, from a rotation matrix or from a pose."""
    x, own = asarray(value, repr(joint.name)), joint.group
    if x.shape[-2:] in ((3, 3), (4, 4)):
        C = pose(x, np.zeros((*x.shape[:-2], 3, 1))) if x.shape[-1] == 3 else x
        check_pose(C, f"joint {joint.name!r}")
        numbers = own.numbers(np.asarray(C, dtype=float))
        left = np.abs(own.pose(numbers) - C).max(initial=0.0)
        if left > POSE_TOLERANCE:
            raise JounceError(f"joint {joint.name!r} is a {own.name} joint, which the pose misses by {left:.2g}")
        return numbers
    if x.shape[-1:] != (len(own.positions),):
        expected = f"(..., {len(own.positions)}): {', '.join(own.positions)}; or a pose (..., 4, 4)"
        raise JounceError(f"joint {joint.name!r} has shape {x.shape}; expected {expected}")
    return x


def _velocity_numbers(joint: Position, value: Any) -> Array:
    x, names = asarray(value, repr(joint.name)), joint.group.velocities
    if x.shape[-1:] != (len(names),):
        raise JounceError(f"joint {joint.name!r} has shape {x.shape}; expected (..., {len(names)}): {', '.join(names)}")
    return x


def check_positions(mechanism: Mechanism, q: Array) -> Array:
    """q; raise `JounceError` where a quaternion, or a cosine and a sine, is too short to say a rotation."""
    if not is_numeric(q):
        return q
    for joint in multiscrew_joints(mechanism).values():
        turn = q[..., joint.turn]
        norms = np.sqrt((turn * turn).sum(axis=-1))
        if (norms < MIN_ROTATION_NORM).any():
            what = ", ".join(joint.group.positions[len(joint.group.places) :])
            came = f"q: {what} of joint {joint.name!r} have the length {np.nanmin(norms):.2g}"
            raise JounceError(f"{came}; expected 1, as those of every rotation")
    return q


def separate_base(
    mechanism: Mechanism,
    given: Sequence[Any],
    base: Any,
    row: Quantity,
    pose_of_base: Callable[[Array], Array] = FREE.pose,
) -> tuple[Sequence[Any], tuple[Any, ...] | None]:
    """The state behind the base, and the motion (C, V, ...) of the base, of a whole floating robot's q, v, ...

    A state is whole where q has nq numbers and the motion of the base is not given. `pose_of_base` takes the seven
    numbers with which q begins.
    """
    if not mechanism.floats or base is not None or not given or isinstance(given[0], Mapping):
        return given, base
    whole, of_base = whole_position_count(mechanism), len(FREE.positions)
    count = row.takes.coordinates(len(given))
    q = asarray(given[0], "q")
    if q.shape[-1:] != (whole,):
        return given, base
    rates = [x if x is None else asarray(x, "a rate of q") for x in given[1:count]]
    for k, x in enumerate(rates, 1):
        if x is not None and x.shape[-1:] != (mechanism.nv,):
            expected = f"({mechanism.nv},), as q has all {whole} numbers"
            raise JounceError(f"rate {k} of q has shape {x.shape}; expected {expected}")
    moved = (pose_of_base(q[..., :of_base]), *(x[..., :6] for x in rates if x is not None))
    return [q[..., of_base:], *(x if x is None else x[..., 6:] for x in rates), *given[count:]], moved
