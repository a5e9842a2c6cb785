"""A robot along a motion, checked: joints match, limits are stated, and the values that they bound are known."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.engine.along import check_motion
from jounce.engine.contact_limits import are_limited
from jounce.engine.engine import Engine
from jounce.limits.deviations import find_windows
from jounce.limits.joints import drives_coordinates, joint_limits
from jounce.limits.limited_motion import LimitedMotion, known_kinds
from jounce.model.limit_kinds import LIMIT_KINDS
from jounce.model.limits import Limits
from jounce.model.mechanism import Mechanism

LIMITS_CURE = Remedy(
    "robot.with_limits(effort=..., velocity=...) states some, robot.with_limits(NAME) published ones of an arm",
    "--limits FILE states some, --limits ARM published ones of an arm",
)
MOTOR_CURE = Remedy("; robot.elastic(motors={joint: jounce.Motor(...)}) states it", "; state it in its file")


def validate_limits(robot: Engine, motion: object) -> LimitedMotion:
    """A robot along a motion, checked, with the limits of its coordinates; a robot without any is refused."""
    path, limits = check_motion(robot.mechanism, motion), joint_limits(robot.mechanism)
    kinds = known_kinds(robot, limits)
    if not kinds and not are_limited(robot.mechanism):
        if limits.kinds:
            came = f"robot {robot.name!r} states no limits of rigid joints, only {join_names(limits.kinds)}"
            raise JounceError(f"{came}{Remedy('; robot.elastic(stiffness) makes its joints elastic')}")
        raise JounceError(f"robot {robot.name!r} states no limits; {LIMITS_CURE}")
    check_motor_data(robot, kinds)
    _check_stiffness(robot, kinds)
    check_gravity(robot.mechanism, limits, kinds)
    b = LimitedMotion(robot, path, limits, kinds)
    return replace(b, windows=find_windows(b))


def check_motor_data(robot: Engine, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where currents or voltages of a motor are limited that states no data for them."""
    limits, e, places = joint_limits(robot.mechanism), robot.mechanism.elasticity, robot.mechanism.independent_places
    for kind in kinds:
        limited = np.isfinite(limits.bounds(kind)[:, list(places)]).any(axis=0)
        for j in np.flatnonzero(limited).tolist():
            motor = e.motors[j] if e and e.motors else None
            if lacking := [name for name in LIMIT_KINDS[kind].data if motor is None or getattr(motor, name) is None]:
                raise JounceError(
                    f"joint {quote_value(robot.joint_names[j])} has a limit of {kind}, and its motor states no"
                    f" {' and no '.join(lacking)}{MOTOR_CURE}"
                )


def _check_stiffness(robot: Engine, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where motors are bounded whose rates may be infinite between the times that are checked."""
    e, of_motors = robot.mechanism.elasticity, [kind for kind in kinds if LIMIT_KINDS[kind].takes]
    if e and e.slack and of_motors:
        raise JounceError(
            f"joint {quote_value(robot.joint_names[e.slack[0]])}: its spring has no stiffness at rest, and its motor"
            f" moves infinitely fast where no force acts; limits of {join_names(of_motors)} need a"
            " CubicSpring with k above 0"
        )


def check_gravity(m: Mechanism, limits: Limits, kinds: Sequence[str]) -> None:
    """Raise `JounceError` where limits bound motor forces less gravity, and motors are not at the coordinates."""
    without = [kind for kind in kinds if kind in limits.without_gravity]
    if without and not drives_coordinates(m):
        raise JounceError(
            f"{m.name!r}: limits of {join_names(without)} bound Q - Qgrav, which is not known for motors at other"
            f" joints than the coordinates {join_names(m.coordinates)}; state them for Q"
            f"{Remedy(' (of=), or name these joints by robot.closed(actuated=...)')}"
        )
