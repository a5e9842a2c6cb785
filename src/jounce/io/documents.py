"""Robots in YAML or JSON: parsed once, then read in the format that their keys identify."""

from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path

from jounce.core.errors import JounceError, listed, no_such
from jounce.io import denavit_hartenberg, entries, skidy
from jounce.io.entries import Entry
from jounce.io.native import reading
from jounce.model.mechanism import Mechanism


def _standing(read: Callable[[Entry, object], Mechanism]) -> Callable[[Entry, object, str | None], Mechanism]:
    """The reader of a format that does not state the inertia of a base."""

    def read_standing(robot: Entry, gravity: object, base: str | None) -> Mechanism:
        if base == "floating":
            raise JounceError(
                f"{robot.path}: base='floating' needs the inertia of the base, which this format does not state; "
                "a URDF or MJCF file states it, or jounce's own format with 'base'"
            )
        return read(robot, gravity)

    return read_standing


FORMATS: dict[str, tuple[str, Callable[[Entry, object, str | None], Mechanism]]] = {  # by the key that no other one has
    "bodies": ("jounce's own format", reading.read),
    "dh": ("a Denavit-Hartenberg table", _standing(denavit_hartenberg.read)),
    "joint_screw_coord": ("skidy's", _standing(skidy.read)),
}


def read(path: Path, gravity: object = None, base: str | None = None) -> Mechanism:
    """The mechanism of a file, under its own gravity unless another is given; only jounce's own format can float."""
    robot = entries.read(path, "the robot")
    keys = list(robot.members())
    for key, (_, reader) in FORMATS.items():
        if key in keys:
            return reader(robot, gravity, base)
    for key in keys:
        if get_close_matches(key, FORMATS, n=1):
            raise JounceError(f"{robot.get(key).place}: {no_such('key', key, FORMATS, 'the robot')}")
    formats = ", ".join(f"{key!r} ({words})" for key, (words, _) in FORMATS.items())
    came = listed(keys) or "none"
    raise JounceError(f"{robot.place}: the robot has no key that identifies its format, {formats}; its keys: {came}")
