"""Read messages of ROS, as data or as objects: JointTrajectory and JointState.

A JointTrajectory may be alone, or within what MoveIt plans.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from jounce.core.cures import Remedy
from jounce.core.errors import JounceError, join_names, quote_value
from jounce.core.named_entries import refuse_names
from jounce.core.scalars import is_finite
from jounce.motion.constructors import MotionParts, from_trajectory_points

POINT_FIELDS = ("positions", "velocities", "accelerations")
TIME_FIELD = "time_from_start"
IGNORED_FIELDS = ("multi_dof_joint_trajectory",)  # poses of bodies, which jounce does not read
MAX_STAMP = 2**63  # s or ns: messages have 32 bits for either
MAX_MESSAGE_DEPTH = 8  # of messages within messages: a plan of MoveIt has its trajectory two or three deep
TIME_FIELDS = (("sec", "secs"), ("nanosec", "nsecs"))  # of ROS 2 and ROS 1


def from_joint_trajectory(message: Any, skip: bool = False) -> MotionParts:
    """Return the curve of a JointTrajectory, with joints in its order.

    Points that are not later than those before are refused, or left out on request.
    """
    trajectories = list(find_trajectories(message))
    if len(trajectories) != 1:
        came = f"{len(trajectories)} trajectories" if len(trajectories) > 0 else "no joint_names and points"
        raise JounceError(f"{came} in {quote_value(message)}; expected one JointTrajectory, or a plan that contains it")
    [trajectory] = trajectories
    names = _get_list(trajectory, "joint_names")
    points = _get_list(trajectory, "points")
    if len(names) == 0 or not all(isinstance(name, str) for name in names):
        raise JounceError(f"joint_names is {quote_value(names)}; expected names of joints")
    t = np.array([_read_seconds(point, f"point {i}") for i, point in enumerate(points)])
    rates = [_read_rates(point, names, f"point {i}") for i, point in enumerate(points)]
    # Planners write their last point twice: nothing is between two points that are equal, their times included.
    repeated = [i for i in range(1, len(t)) if t[i] == t[i - 1] and _are_equal(rates[i], rates[i - 1])]
    late = [i for i in range(1, len(t)) if not t[i] > t[:i].max() and i not in repeated]
    if len(late) > 0 and not skip:
        i = late[0]
        came = f"time_from_start does not increase: {t[i - 1]:.17g} is followed by {t[i]:.17g}, entries {i - 1} and {i}"
        cure = Remedy("on_error='skip' of jounce.load_motion leaves it out", "--on-error skip leaves it out")
        raise JounceError(f"{came}; {cure}")
    left_out = {*repeated, *late}
    points_left = [x for i, x in enumerate(rates) if i not in left_out]
    parts = from_trajectory_points(np.delete(t, sorted(left_out)), points_left, names)
    notes = [
        f"point{'s' * (len(numbers) > 1)} {join_names(map(str, numbers), most=8)}: {why}; left out"
        for numbers, why in ((repeated, "equal to the one before, also in time"), (late, "not later than those before"))
        if len(numbers) > 0
    ]
    return parts._replace(notes=(*parts.notes, *notes))


def _are_equal(rates: Sequence[np.ndarray], others: Sequence[np.ndarray]) -> bool:
    return len(rates) == len(others) and all(np.array_equal(a, b) for a, b in zip(rates, others, strict=True))


def find_trajectories(message: Any) -> Iterator[Any]:
    """Yield the JointTrajectory messages in a message.

    They are itself, or in its fields, as a plan of MoveIt has one.
    """
    # Aliases of YAML make a tree of any size of a few lines: each object is looked at once.
    waiting, seen_objects = [(message, 0)], set()
    while len(waiting) > 0:
        part, depth = waiting.pop()
        if id(part) in seen_objects:
            continue
        seen_objects.add(id(part))
        if _has_field(part, "joint_names") and _has_field(part, "points"):
            yield part
        elif depth < MAX_MESSAGE_DEPTH:
            fields = [(value, depth + 1) for name, value in _message_fields(part) if name not in IGNORED_FIELDS]
            waiting += fields


def is_joint_state(message: Any) -> bool:
    """Return whether a message is a JointState, one sample of a log."""
    return all(_has_field(message, name) for name in ("header", "name", "position"))


def read_joint_states(messages: Sequence[Any], place_of: Callable[[int], str]) -> dict[str, np.ndarray]:
    """Return the columns of a log of JointState messages.

    They are t since the first stamp, positions by the names of joints, and efforts as measured torques. Stamps
    are subtracted as integers of nanoseconds: doubles of seconds since 1970 step by 2.4e-7 s. `place_of` names a
    message in errors.
    """
    names = _get_list(messages[0], "name")
    if len(names) == 0 or not all(isinstance(name, str) for name in names):
        raise JounceError(f"{place_of(0)}: name is {quote_value(names)}; expected names of joints")
    for name, count in Counter(names).items():
        if count > 1:
            raise JounceError(
                f"{place_of(0)}: joint {quote_value(name)} occurs {count} times; expected every joint once"
            )
    rows = [_read_joint_state(message, names, place_of(number)) for number, message in enumerate(messages)]
    stamps, positions, efforts = zip(*rows, strict=True)
    columns = {"t": np.array([(stamp - stamps[0]) / 10**9 for stamp in stamps])}
    columns |= dict(zip(names, np.array(positions, dtype=float).T, strict=True))
    # Messages without efforts have an empty list of them.
    if all(len(effort) == len(names) for effort in efforts):
        of_joints = zip(names, np.array(efforts, dtype=float).T, strict=True)
        columns |= {f"{name}.effort": values for name, values in of_joints}
    return columns


def _read_joint_state(message: Any, names: list[Any], place: str) -> tuple[int, list[Any], list[Any]]:
    """Return the stamp of a message in ns, positions and efforts.

    Positions are of joints of these names, and so are efforts, if there are any.
    """
    if not is_joint_state(message):
        raise JounceError(f"{place} is {quote_value(message)}; expected a JointState, as those before it")
    joints, position, effort = (_get_list(message, field) for field in ("name", "position", "effort"))
    if joints != names or len(position) != len(names):
        came = f"is of {join_names(map(str, joints))}, with {len(position)} positions"
        raise JounceError(f"{place} {came}; expected all messages of the joints {join_names(names)}")
    for field, values in (("position", position), ("effort", effort)):
        if not all(isinstance(x, float) or is_finite(x) for x in values):
            raise JounceError(f"{place}: {field} is {quote_value(values)}; expected numbers")
    return _read_nanoseconds(message, place), position, effort


def _read_nanoseconds(message: Any, place: str) -> int:
    """Return the stamp in the header of a message, in ns.

    It has integers of seconds and nanoseconds.
    """
    stamp = _get_field(_get_field(message, "header"), "stamp")
    parts = [
        next((_get_field(stamp, name) for name in names if _has_field(stamp, name)), None) for names in TIME_FIELDS
    ]
    whole = [int(part) for part in parts if isinstance(part, int | np.integer) and not isinstance(part, bool)]
    if len(whole) < len(parts) or max(map(abs, whole)) > MAX_STAMP:
        raise JounceError(f"{place}: stamp is {quote_value(stamp)}; expected integers {{sec: ..., nanosec: ...}}")
    seconds, nanoseconds = whole
    return seconds * 10**9 + nanoseconds


def _message_fields(message: Any) -> list[tuple[Any, Any]]:
    """Return the names and values of the fields of a message."""
    if isinstance(message, Mapping):
        return list(message.items())
    # Lists of messages have fields by number; lists of numbers, which may be long, have none.
    if isinstance(message, list | tuple):
        return list(enumerate(message)) if any(isinstance(part, Mapping | list) for part in message[:1]) else []
    slots = getattr(message, "__slots__", None) or getattr(message, "__dict__", None) or ()
    names = [str(name).lstrip("_") for name in slots] if type(message).__module__ != "builtins" else []
    return [(name, getattr(message, name)) for name in names if _has_field(message, name)]


def _has_field(message: Any, name: str) -> bool:
    """Return whether a message, of any type, has a field."""
    try:
        return name in message if isinstance(message, Mapping) else hasattr(message, name)
    except Exception:  # whatever a foreign type raises
        return False


def _get_field(message: Any, name: str) -> Any:
    """Return a field of a message, None without it."""
    return message.get(name) if isinstance(message, Mapping) else getattr(message, name, None)


def _get_list(message: Any, name: str) -> list[Any]:
    """Return a field of a message as a list, empty without it."""
    value = _get_field(message, name)
    try:
        if isinstance(value, str | Mapping):
            raise TypeError
        return [] if value is None else list(value)
    except Exception:  # what a foreign type raises
        raise JounceError(f"{name} is {quote_value(value)}; expected a list") from None


def _read_seconds(point: Any, what: str) -> float:
    """Return time_from_start of a point in seconds.

    It has seconds and nanoseconds, or is a number of seconds.
    """
    start = _get_field(point, TIME_FIELD)
    if is_finite(start):
        return float(start)
    # The fields have other names in ROS 1 and in ROS 2; one of the two may be missing.
    parts = [next((_get_field(start, name) for name in names if _has_field(start, name)), 0) for names in TIME_FIELDS]
    has_fields = any(_has_field(start, name) for names in TIME_FIELDS for name in names)
    if not has_fields or not all(map(is_finite, parts)):
        raise JounceError(
            f"{what}: time_from_start is {quote_value(start)}; expected {{sec: ..., nanosec: ...}} or seconds"
        )
    return float(parts[0]) + 1e-9 * float(parts[1])


def _read_rates(point: Any, names: list[str], what: str) -> list[np.ndarray]:
    """Return the positions, velocities, accelerations of a point.

    They end before the first of these that it does not have.
    """
    rates: list[np.ndarray] = []
    for k, name in enumerate(POINT_FIELDS):
        refuse_names(_get_field(point, name), f"{what}: {name}")
        numbers = _get_list(point, name)
        if len(numbers) == 0 and k > 0:
            break
        if len(numbers) != len(names) or not all(map(is_finite, numbers)):
            expected = f"{len(names)} finite numbers: {join_names(names)}"
            raise JounceError(f"{what}: {name} is {quote_value(numbers)}; expected {expected}")
        rates.append(np.array(numbers, dtype=float))
    return rates
