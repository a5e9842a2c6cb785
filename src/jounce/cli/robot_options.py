"""The argument ROBOT and the options of robots that all commands share."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from jounce.cli.commands import RobotOption, split_names
from jounce.core.errors import JounceError, quote_value

if TYPE_CHECKING:
    from jounce.robot import Robot


class FileOrName(click.ParamType):  # type: ignore[type-arg] # generic for mypy alone
    """A path or a bundled name; the reader decides which one exists."""

    def __init__(self, kind: str, names: Callable[[], Iterable[str]]) -> None:
        self.name, self.names = kind, names

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Return the path; a bundled name is a path too."""
        return Path(value)

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the names and files that complete the text."""
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
    """A robot by its path or name, with the options of `jounce.load`.

    The command loads it after checking its outputs.
    """

    path: Path
    options: dict[str, Any]
    others: "OtherJoints | None" = None

    def load(self) -> "Robot":
        """Load the robot."""
        from jounce.robot.loading import load

        robot = load(self.path, **self.options)
        if self.others is None:
            return robot
        locks = self.options.get("lock", {}) | self.others.find_locks(robot)
        return load(self.path, **self.options | {"lock": locks})


OTHERS = "others"  # the joint of --lock others=VALUE: all joints of which the table has no column


@dataclass(frozen=True)
class OtherJoints:
    """The value at which joints without a column are locked."""

    value: float
    motion: Path | None
    columns: dict[str, Any]

    def find_locks(self, robot: "Robot") -> dict[str, float]:
        """Return the joints without a column, with their value."""
        from jounce.io import tables
        from jounce.motion.table_columns import ColumnOptions, find_absent_joints

        if self.motion is None:
            raise JounceError(f"--lock {OTHERS}={self.value:g} needs a MOTION: it locks the joints without a column")
        if self.motion.suffix.lower() not in tables.ROW_FORMATS:
            came = f"--lock {OTHERS}={self.value:g}: {self.motion} is no table"
            raise JounceError(f"{came}; expected {', '.join(tables.ROW_FORMATS)}: lock joints by their names")
        header = tables.select_format(self.motion).names(self.motion)
        absent = find_absent_joints(list(header), robot.mechanism, ColumnOptions(**self.columns))
        return dict.fromkeys(absent, self.value)


def parse_drive_terms(names: Sequence[str]) -> Any:
    """Return the drive terms of an option: True for all, False for none, or names."""
    if len(names) == 1 and names[0] in ("all", "none"):
        return names[0] == "all"
    return list(names)


def _split_pairs(option: str, texts: Sequence[str]) -> dict[str, str]:
    """Split texts NAME=VALUE into names and values."""
    values: dict[str, str] = {}
    for text in texts:
        name, _, value = text.rpartition("=")
        if not name:
            what = "JOINT" if option == "--lock" else "NAME"
            raise JounceError(f"{option} {quote_value(text)}; expected {what}=VALUE")
        if name in values:
            second = f"{option} {quote_value(text)} sets {quote_value(name)} a second time"
            raise JounceError(f"{second}; the first is {quote_value(values[name])}")
        values[name] = value
    return values


def _parse_locks(_: click.Context, __: click.Parameter, texts: Sequence[str]) -> dict[str, float | None]:
    from jounce.core.foreign import parse_finite

    numbers = {name: parse_finite(value) for name, value in _split_pairs("--lock", texts).items()}
    for text, number in zip(texts, numbers.values(), strict=True):
        if number is None:
            raise JounceError(f"--lock {quote_value(text)}; expected a finite number, rad or m")
    return numbers


def _parse_drive_terms(ctx: click.Context, option: click.Parameter, texts: Sequence[str]) -> Any:
    return parse_drive_terms(split_names(ctx, option, texts)) if len(texts) > 0 else None


Decorator = Callable[[Callable[..., None]], Callable[..., None]]
_option = partial(click.option, cls=RobotOption)
DRIVES_OPTION = _option(
    "--drives", metavar="TERMS", multiple=True, callback=_parse_drive_terms,
    help="Drive terms in Q: all, or a list of armature, damping, friction, stribeck, spring, offset, load_friction.",
)  # fmt: skip
ROBOT_OPTIONS: tuple[Decorator, ...] = (
    click.argument("robot", type=ROBOT_NAME),
    _option("--base", metavar="BASE", help="floating, or fixed: weld free joints at zero."),
    _option("--root", metavar="LINK", help="Start at this link, which becomes the base."),
    _option(
        "--lock", multiple=True, metavar="JOINT=VALUE", callback=_parse_locks,
        help="Lock a joint at a value in rad or m; others=VALUE locks all joints without a column. Repeatable.",
    ),
    DRIVES_OPTION,
    _option("--gravity", nargs=3, type=float, metavar="X Y Z", help="Gravity in m/s^2; default: the robot's own."),
    _option(
        "--xacro-arg", "xacro_args", multiple=True, metavar="NAME=VALUE",
        callback=lambda _, __, given: _split_pairs("--xacro-arg", given),
        help="Argument of a .xacro file. Repeatable.",
    ),
    _option("--loops", metavar="FILE", type=PATH, help="File of the loops of a URDF or .xacro file."),
    _option("--massless-tips", is_flag=True, help="Accept joints that move no mass."),
    _option(
        "--no-transmissions", is_flag=True,
        help="Give each joint a motor of its own.",
    ),
)  # fmt: skip


def add_robot_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Add the argument ROBOT and its options to a command.

    The command receives them as one argument `robot`, a `RobotRequest`.
    """
    return _add_options(verb, ROBOT_OPTIONS)


def add_robot_options_without_drives(verb: Callable[..., None]) -> Callable[..., None]:
    """Add the argument ROBOT and its options, except --drives, to a command."""
    return _add_options(verb, [option for option in ROBOT_OPTIONS if option is not DRIVES_OPTION])


def _add_options(verb: Callable[..., None], options: Sequence[Decorator]) -> Callable[..., None]:
    def command_with_robot(robot: Path, **arguments: Any) -> None:
        others = _take_others(arguments)
        names = ("base", "root", "lock", "drives", "gravity", "xacro_args", "loops", "massless_tips")
        options_by_name = {name: arguments.pop(name) for name in names if name in arguments}
        stated_options = {name: value for name, value in options_by_name.items() if value not in (None, {}, False)}
        if arguments.pop("no_transmissions", False):
            stated_options["transmissions"] = False
        verb(robot=RobotRequest(robot, stated_options, others), **arguments)

    command: Callable[..., None] = wraps(verb)(command_with_robot)
    for option in reversed(options):
        command = option(command)
    return command


def _take_others(arguments: dict[str, Any]) -> OtherJoints | None:
    """Take the lock of all other joints from the arguments.

    Return None without such a lock.
    """
    locks = arguments.get("lock", {})
    if OTHERS not in locks:
        return None
    arguments["lock"] = {name: value for name, value in locks.items() if name != OTHERS}
    columns = {name: arguments[name] for name in ("time", "torques", "rename") if arguments.get(name) is not None}
    return OtherJoints(locks[OTHERS], arguments.get("motion"), columns | {"pattern": arguments.get("columns")})


def values_by_joint(option: str, texts: Sequence[str], joints: Sequence[str]) -> dict[str, float] | None:
    """Return the numbers of an option by joint, or None.

    VALUE is for all joints, JOINT=VALUE for one joint, which takes precedence.
    """
    from jounce.core.foreign import parse_finite

    values_of_all: dict[str, float] = {}
    values_of_one: dict[str, float] = {}
    for text in texts:
        name, _, value = text.rpartition("=")
        number = parse_finite(value)
        if number is None:
            raise JounceError(f"{option} {quote_value(text)}; expected a number, or JOINT=NUMBER")
        # Each joint, and all joints together, may have one value.
        if name in values_of_one or (not name and values_of_all):
            whose = quote_value(name) if name else "all joints"
            raise JounceError(f"{option} {quote_value(text)} is the second value for {whose}")
        if name:
            values_of_one[name] = number
        else:
            values_of_all = dict.fromkeys(joints, number)
    return (values_of_all | values_of_one) or None
