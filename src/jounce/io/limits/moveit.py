"""MoveIt's ``joint_limits.yaml``: position, velocity, acceleration, jerk and effort of joints by name."""

from collections.abc import Collection, Mapping

from jounce.core.errors import JounceError
from jounce.io.entries import Entry
from jounce.model.stated_limits import StatedLimit, limit_error

OUTER_KEYS = ("/**", "ros__parameters", "robot_description_planning")  # keys that may stand above the limits
MOVEIT_KINDS = ("velocity", "acceleration", "jerk", "effort")
LIMIT_KEYS = {"min_position": "lower", "max_position": "upper"} | {f"max_{kind}": kind for kind in MOVEIT_KINDS}
KNOWN_KEYS = (
    *(*LIMIT_KEYS, "angle_wraparound", "max_deceleration", "min_velocity"),
    *(f"has_{kind}_limits" for kind in ("position", "deceleration", *MOVEIT_KINDS, "soft")),
    *("k_position", "k_velocity", "soft_lower_limit", "soft_upper_limit"),
)


def read_limits(document: Entry, sliding: Collection[str]) -> Mapping[str, Mapping[str, StatedLimit]] | None:
    """What a file states of each joint, less what ``has_..: false`` denies; None if it is no file of MoveIt.

    Angles may have tags, ``max_velocity: !degrees 180``, except those of joints that slide.
    """
    for key in OUTER_KEYS:
        if isinstance(document.value, Mapping) and key in document.value:
            document = document.get(key)
    if not isinstance(document.value, Mapping) or "joint_limits" not in document.value:
        return None
    joints = document.get("joint_limits").members()
    return {name: _joint_limits(entry, name not in sliding) for name, entry in joints.items()}


def _joint_limits(entry: Entry, is_turning: bool) -> Mapping[str, StatedLimit]:
    stated = {}
    for theirs, key in LIMIT_KEYS.items():
        flag = entry.get(f"has_{theirs.partition('_')[2]}_limits", True)
        if theirs in entry.keys((), KNOWN_KEYS).value and flag.value is not False:
            if flag.value is not True:
                raise flag.error("true or false")
            value = entry.get(theirs)
            stated[key] = value.angle() if is_turning and key != "effort" else value.number()
    if error := limit_error(**stated):
        raise JounceError(f"{entry.place}: {entry.what}: {error}")
    return stated
