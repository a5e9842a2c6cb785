"""The robot that a verb is asked about: the argument ROBOT, and the options that say how it is loaded."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.names import ROBOT
from jounce.errors import JounceError, quoted

if TYPE_CHECKING:
    from jounce.robot import Robot

ALL = "all"  # drives


@dataclass(frozen=True)
class Asked:
    """A robot by its path or name, with the options of `jounce.load`; a verb loads it once all else is in order."""

    path: Path
    options: dict[str, Any]

    def load(self) -> "Robot":
        """The robot."""
        from jounce.io.loading import load

        return load(self.path, **self.options)


OPTIONS = (
    click.argument("robot", type=ROBOT),
    click.option("--base", metavar="fixed", help="fixed: weld floating, planar, spherical joints at zero."),
    click.option("--root", metavar="LINK", help="Start at a link: what it carries remains."),
    click.option("--lock", multiple=True, metavar="JOINT=VALUE", help="Hold a joint, rad or m; may be repeated."),
    click.option("--drives", metavar="TERMS", help="In Q too: all, or of armature,damping,friction,spring."),
    click.option("--gravity", nargs=3, type=float, metavar="X Y Z", help="In m/s^2; the robot's own if left out."),
    click.option("--xacro-arg", "xacro_args", multiple=True, metavar="NAME=VALUE", help="Of a .xacro file."),
)


def on_robot(verb: Callable[..., None]) -> Callable[..., None]:
    """The verb with the argument ROBOT and its options, which it gets as one `robot`, an `Asked`."""

    @wraps(verb)
    def asked(
        robot: Path,
        base: str | None,
        root: str | None,
        lock: Sequence[str],
        drives: str | None,
        gravity: tuple[float, float, float] | None,
        xacro_args: Sequence[str],
        **others: Any,
    ) -> None:
        given = {
            "base": base,
            "root": root,
            "lock": _held(lock) or None,
            "drives": None if drives is None else drives == ALL or drives.split(","),
            "gravity": gravity,
            "xacro_args": _pairs("--xacro-arg", xacro_args) or None,
        }
        verb(robot=Asked(robot, {name: value for name, value in given.items() if value is not None}), **others)

    for option in reversed(OPTIONS):
        asked = option(asked)
    return asked


def _pairs(option: str, given: Sequence[str]) -> dict[str, str]:
    """Names and their values, each given as NAME=VALUE."""
    found: dict[str, str] = {}
    for text in given:
        name, _, value = text.rpartition("=")
        if not name:
            raise JounceError(f"{option} {quoted(text)}; expected {'JOINT' if option == '--lock' else 'NAME'}=VALUE")
        if name in found:
            second = f"{option} {quoted(text)} is a second value of {quoted(name)}"
            raise JounceError(f"{second}; the first is {quoted(found[name])}")
        found[name] = value
    return found


def _held(given: Sequence[str]) -> dict[str, float]:
    from jounce._scalars import finite

    numbers = {name: finite(value) for name, value in _pairs("--lock", given).items()}
    for text, number in zip(given, numbers.values(), strict=True):
        if number is None:
            raise JounceError(f"--lock {quoted(text)}; expected a finite number, rad or m")
    return {name: number for name, number in numbers.items() if number is not None}
