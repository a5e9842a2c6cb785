"""`save`: a robot into a file."""

import os
from collections.abc import Callable
from pathlib import Path

from jounce.core.errors import JounceError, door
from jounce.engine.engine import Engine
from jounce.io import files, robot_writing
from jounce.model.mechanism import Mechanism


@door
def save(robot: Engine, path: str | os.PathLike[str]) -> None:
    """Write a robot to a YAML or JSON file.

    The format is jounce's own.

    The file is lossless: `jounce.load` restores names, limits, frames, and every array to the last bit. The drive terms
    in Q are not saved: ``jounce.load(..., drives=True)`` selects them.

    Parameters
    ----------
    robot : Robot
        A robot of numbers.
    path : str or path
        Path of a .yaml, .yml or .json file; an existing file is replaced as a whole.

    Raises
    ------
    JounceError
        If the robot contains symbols, the suffix is another, or the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile, jounce
    >>> robot = jounce.load("planar2r", L1=1.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     jounce.save(robot, pathlib.Path(folder, "arm.yaml"))
    ...     same = jounce.load(pathlib.Path(folder, "arm.yaml"))
    >>> (same.mechanism.M == robot.mechanism.M).all()
    np.True_
    """
    if not isinstance(robot, Engine):
        raise JounceError(f"save() expects a jounce.Robot, got {type(robot).__name__}; try jounce.load")
    if not isinstance(path, str | os.PathLike):
        raise JounceError(f"save() expects a path, got {type(path).__name__}")
    target = files.expand_path(path)
    check_writable(target)
    content = ROBOT_WRITERS[target.suffix.lower()](robot.mechanism)
    with files.write_whole(target) as part:
        part.write_text(content, encoding="utf-8", newline="\n")


Writer = Callable[[Mechanism], str]
ROBOT_WRITERS: dict[str, Writer] = {
    ".yaml": robot_writing.yaml_text,
    ".yml": robot_writing.yaml_text,
    ".json": robot_writing.json_text,
}


def check_writable(path: Path) -> None:
    """Raise `JounceError` if `save` cannot write to a path."""
    if path.suffix.lower() not in ROBOT_WRITERS:
        suffixes = ", ".join(ROBOT_WRITERS)
        raise JounceError(f"{path}: unknown type of robot file to write {path.suffix!r}; available: {suffixes}")
    files.check_writable(path)
