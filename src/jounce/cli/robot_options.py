"""Arguments and options of robots shared by all commands: a file or a bundled name, with shell completion."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from jounce.core.errors import JounceError, quote_value

if TYPE_CHECKING:
    from jounce.robot import Robot


class FileOrName(click.ParamType):  # type: ignore[type-arg] # generic for mypy alone
    """A path or a bundled name; the reader finds out which of them exists."""

    def __init__(self, kind: str, names: Callable[[], Iterable[str]]) -> None:
        self.name, self.names = kind, names

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """The path; a bundled name is one too."""
        return Path(value)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """The names that begin so, and the shell's own completion of files."""
        names = [CompletionItem(name) for name in self.names() if name.startswith(incomplete)]
        return [*names, CompletionItem(incomplete, type="file")]


def _robots() -> Iterable[str]:
    from jounce.io.bundled import BUNDLED

    return BUNDLED


def _motions() -> Iterable[str]:
    from jounce.io.motions import BUNDLED_MOTIONS

    return BUNDLED_MOTIONS


PATH = click.Path(path_type=Path)
ROBOT_NAME = FileOrName("robot", _robots)
MOTION_NAME = FileOrName("motion", _motions)


@dataclass(frozen=True)
class RobotRequest:
    """A robot by its path or name, with the options of `jounce.load`; a command loads it after checking all else."""

    path: Path
    options: dict[str, Any]

    def load(self) -> "Robot":
        """The robot."""
        from jounce.robot.loading import load

        return load(self.path, **self.options)


def parse_drive_terms(given: str) -> Any:
    """Drive terms of an option: True for all, False for none, or names between commas."""
    return {"all": True, "none": False}.get(given, [name.strip() for name in given.split(",")])


def _split_pairs(option: str, given: Sequence[str]) -> dict[str, str]:
    """Names and their values, each given as NAME=VALUE."""
    found: dict[str, str] = {}
    for text in given:
        name, _, value = text.rpartition("=")
        if not name:
            raise JounceError(
                f"{option} {quote_value(text)}; expected {'JOINT' if option == '--lock' else 'NAME'}=VALUE"
            )
        if name in found:
            second = f"{option} {quote_value(text)} sets {quote_value(name)} a second time"
            raise JounceError(f"{second}; the first is {quote_value(found[name])}")
        found[name] = value
    return found


def _parse_locks(_: click.Context, __: click.Parameter, given: Sequence[str]) -> dict[str, float | None]:
    from jounce.core.foreign import parse_finite

    numbers = {name: parse_finite(value) for name, value in _split_pairs("--lock", given).items()}
    for text, number in zip(given, numbers.values(), strict=True):
        if number is None:
            raise JounceError(f"--lock {quote_value(text)}; expected a finite number, rad or m")
    return numbers


def _parse_drive_terms(_: click.Context, __: click.Parameter, given: str | None) -> Any:
    return given if given is None else parse_drive_terms(given)


Decorator = Callable[[Callable[..., None]], Callable[..., None]]
DRIVES_OPTION = click.option(
    "--drives", metavar="TERMS", callback=_parse_drive_terms,
    help="Drive terms in Q: all, or a list of armature, damping, friction, stribeck, spring, offset, load_friction.",
)  # fmt: skip
ROBOT_OPTIONS: tuple[Decorator, ...] = (
    click.argument("robot", type=ROBOT_NAME),
    click.option("--base", metavar="BASE", help="floating: the base moves freely. fixed: weld free joints at zero."),
    click.option("--root", metavar="LINK", help="Use this link as the base: only the links that it carries are kept."),
    click.option(
        "--lock", multiple=True, metavar="JOINT=VALUE", callback=_parse_locks,
        help="Lock a joint at a value in rad or m; may be repeated.",
    ),
    DRIVES_OPTION,
    click.option("--gravity", nargs=3, type=float, metavar="X Y Z", help="Gravity in m/s^2; default: the robot's own."),
    click.option(
        "--xacro-arg", "xacro_args", multiple=True, metavar="NAME=VALUE",
        callback=lambda _, __, given: _split_pairs("--xacro-arg", given),
        help="Argument of a .xacro file; may be repeated.",
    ),
    click.option("--massless-tips", is_flag=True, help="Joints that move no mass are meant: their limits are judged."),
)  # fmt: skip


def add_robot_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Add the argument ROBOT and its options to a command, which gets them as one `robot`, an `RobotRequest`."""
    return _add_options(verb, ROBOT_OPTIONS)


def add_robot_options_without_drives(verb: Callable[..., None]) -> Callable[..., None]:
    """`add_robot_options` of a verb on which drive trains have no effect."""
    return _add_options(verb, [option for option in ROBOT_OPTIONS if option is not DRIVES_OPTION])


def _add_options(verb: Callable[..., None], options: Sequence[Decorator]) -> Callable[..., None]:
    def asked(robot: Path, **others: Any) -> None:
        names = ("base", "root", "lock", "drives", "gravity", "xacro_args", "massless_tips")
        given = {name: others.pop(name) for name in names if name in others}
        verb(
            robot=RobotRequest(robot, {name: value for name, value in given.items() if value not in (None, {}, False)}),
            **others,
        )

    command: Callable[..., None] = wraps(verb)(asked)
    for option in reversed(options):
        command = option(command)
    return command


def values_by_joint(option: str, given: Sequence[str], joints: Sequence[str]) -> dict[str, float] | None:
    """The numbers of an option by joint: VALUE is of all joints, JOINT=VALUE of one; None without any."""
    from jounce.core.foreign import parse_finite

    found: dict[str, float] = {}
    named: dict[str, float] = {}
    for text in given:
        name, _, value = text.rpartition("=")
        number = parse_finite(value)
        if number is None:
            raise JounceError(f"{option} {quote_value(text)}; expected a number, or JOINT=NUMBER")
        if name in named or (not name and found):
            raise JounceError(
                f"{option} {quote_value(text)} is the second for {quote_value(name) if name else 'all joints'}"
            )
        if name:
            named[name] = number
        else:
            found = dict.fromkeys(joints, number)
    return (found | named) or None
