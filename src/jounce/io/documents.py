"""Robots in YAML or JSON: parsed once, then read in the format that their keys identify."""

from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path

from jounce.core.errors import JounceError, join_names, unknown_name_error
from jounce.io import denavit_hartenberg, entries
from jounce.io.entries import Entry
from jounce.io.native import reading
from jounce.model.mechanism import Mechanism

ROBOT_FORMATS: dict[
    str, tuple[str, Callable[[Entry, object, str | None], Mechanism]]
] = {  # by the key that no other one has
    "bodies": ("jounce's own format", reading.read),
    "dh": ("a Denavit-Hartenberg table", denavit_hartenberg.read),
}


def read(path: Path, gravity: object = None, base: str | None = None) -> Mechanism:
    """The mechanism of a file, under its own gravity unless another is given; only jounce's own format can float."""
    robot = entries.read(path, "the robot")
    keys = list(robot.members())
    for key, (_, reader) in ROBOT_FORMATS.items():
        if key in keys:
            return reader(robot, gravity, base)
    if "joint_screw_coord" in keys:
        cure = "examples/skidy_to_jounce.py in jounce's sources converts it to jounce's own format"
        raise JounceError(f"{robot.place}: a description for skidy, which jounce does not read; {cure}")
    for key in keys:
        if get_close_matches(key, ROBOT_FORMATS, n=1):
            raise JounceError(f"{robot.get(key).place}: {unknown_name_error('key', key, ROBOT_FORMATS, 'the robot')}")
    formats = ", ".join(f"{key!r} ({words})" for key, (words, _) in ROBOT_FORMATS.items())
    came = join_names(keys) or "none"
    raise JounceError(f"{robot.place}: the robot has no key that identifies its format, {formats}; its keys: {came}")
