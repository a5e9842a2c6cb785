"""MoveIt's ``joint_limits.yaml``: position, velocity, acceleration, jerk and effort of joints by name."""

from collections.abc import Mapping

from jounce.core.errors import JounceError
from jounce.io.entries import Entry
from jounce.model.stated import Stated, limit_error

ABOVE = ("/**", "ros__parameters", "robot_description_planning")  # keys that may stand above the limits
KINDS = ("velocity", "acceleration", "jerk", "effort")
KEYS = {"min_position": "lower", "max_position": "upper"} | {f"max_{kind}": kind for kind in KINDS}


def limits(document: Entry) -> Mapping[str, Mapping[str, Stated]] | None:
    """What a file states of each joint, less what ``has_..: false`` denies; None if it is no file of MoveIt."""
    for key in ABOVE:
        if isinstance(document.value, Mapping) and key in document.value:
            document = document.get(key)
    if not isinstance(document.value, Mapping) or "joint_limits" not in document.value:
        return None
    return {name: _joint(entry) for name, entry in document.get("joint_limits").members().items()}


def _joint(entry: Entry) -> Mapping[str, Stated]:
    stated = {
        key: entry.get(theirs).number()
        for theirs, key in KEYS.items()
        if theirs in entry.keys((), _known()).value and _counts(entry, theirs.partition("_")[2])
    }
    if error := limit_error(**stated):
        raise JounceError(f"{entry.place}: {entry.what}: {error}")
    return stated


def _counts(entry: Entry, kind: str) -> bool:
    flag = entry.get(f"has_{kind}_limits", True)
    if not isinstance(flag.value, bool):
        raise flag.error("true or false")
    return flag.value


def _known() -> tuple[str, ...]:
    flags = [f"has_{kind}_limits" for kind in ("position", "deceleration", *KINDS)]
    return (*KEYS, *flags, "angle_wraparound", "max_deceleration", "min_velocity", "has_soft_limits", "k_position",
            "k_velocity", "soft_lower_limit", "soft_upper_limit")  # fmt: skip
