"""A motion and how its table is read: one group of options of the help, which a file keeps for --read too."""

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.robot_options import MOTION_NAME, PATH, Decorator
from jounce.core.errors import JounceError, join_names, locate_errors, warn
from jounce.core.progress import stage

if TYPE_CHECKING:
    from jounce.io.entries import Entry
    from jounce.motion import Motion
    from jounce.robot import Robot


TYPED_WORDS = "jounce.typed_words"  # the words of a command line after the command, by this key of a context's `meta`


class _TableReadingOption(click.Option):
    """An option of how a table is read."""


class MotionCommand(click.Command):
    """A command on a motion, whose help has the options of how a table is read in a group of their own."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Keep the words of the command line too, for another command that takes the same ones."""
        ctx.meta[TYPED_WORDS] = list(args)
        return super().parse_args(ctx, args)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options of the command alone, then the group."""
        for title, is_of_table in (("Options", False), ("How a table is read", True)):
            options = [option for option in self.get_params(ctx) if isinstance(option, click.Option)]
            group = [option for option in options if isinstance(option, _TableReadingOption) is is_of_table]
            with formatter.section(title):
                formatter.write_dl([record for option in group if (record := option.get_help_record(ctx))])


def _read_defaults(ctx: click.Context, _: click.Parameter, path: Path | None) -> Path | None:
    """Make the options of a file defaults of the command, so that its command line wins."""
    if path is not None:
        ctx.default_map = {**read_options(path, ctx.command), **(ctx.default_map or {})}
    return path


OPTION_FILES = (".yaml", ".yml")
_option = partial(click.option, cls=_TableReadingOption)
TABLE_OPTIONS: tuple[Decorator, ...] = (
    _option(
        "--read", metavar="FILE", type=PATH, is_eager=True, callback=_read_defaults,
        help="YAML file with options of this group, 'bandwidth: 20'; those of the command line win.",
    ),
    _option(
        "--bandwidth", type=float, metavar="HZ",
        help="Bandwidth of the smoothing of samples in HZ; default: as far as the motion exceeds the noise.",
    ),
    _option("--allow-noise", is_flag=True, help="Accept samples even if noise dominates the highest rate."),
    _option("--degree", type=int, metavar="K", help="Interpolate samples by a spline of degree 5 or 7 instead."),
    _option("--intervals", type=int, metavar="N", help="Least-squares fit of such a spline with N intervals."),
    _option(
        "--as", "as_", type=click.Choice(["samples", "commands"]),
        help="Read rows as commands of a controller, one per period, which are taken as they are; default: samples."
    ),
    _option("--time", metavar="COLUMN", help="Name of the time column; default: t, time or timestamp."),
    _option(
        "--columns", metavar="PATTERN",
        help="Pattern of the joints' column names, such as 'q_{joint}' or 'q{number}'."
    ),
    _option(
        "--torques", metavar="PATTERN",
        help="Names of the columns of measured torques, such as 'tau{number}'; default: tau_JOINT, JOINT.tau, ..."
    ),
    _option("--angles", type=click.Choice(["rad", "deg"]), help="Unit of angles and their rates in the table."),
    _option(
        "--unwrap", is_flag=True,
        help="Take off the whole turns of angles that wrap, 0 to 360 degrees or -pi to pi, and follow them on."
    ),
    _option("--time-unit", type=click.Choice(["s", "ms", "us", "ns"]), help="Unit of times in the table."),
    _option(
        "--rename", metavar="OLD=NEW",
        help="What names begin with in the table and in the robot: fer_=panda_ makes panda_joint1 of fer_joint1."
    ),
    _option(
        "--on-error", type=click.Choice(["stop", "skip"]),
        help="Bad rows: stop at the first, by default, or leave them out; `run` and others write them to"
        " OUT.skipped.csv."
    ),
    _option(
        "--measured", type=click.Choice(["links", "motors"]),
        help="Whose positions they are: of links (default), or of motors behind elastic joints, over gear ratios.",
    ),
    _option("--topic", metavar="NAME", help="Topic to read from a ROS bag that has several."),
    _option(
        "--blend", type=float, metavar="S", help="Replace breaks of planned motions by C^4 blends of S seconds."
    ),
    _option(
        "--step", type=float, metavar="S", help="Time between rows in s; default: the motion's own rows, or 1 ms."
    ),
)  # fmt: skip


@dataclass(frozen=True)
class MotionRequest:
    """A motion by its path or name, with the options of `jounce.load_motion`; a command loads it for its robot.

    `read` is the file of --read, if there is one.
    """

    path: Path
    options: dict[str, Any]
    blend: float | None
    step: float | None
    read: Path | None

    def load(self, robot: "Robot", order: int) -> "Motion":
        """Load the motion, with the rates that forces up to an order need."""
        from jounce.robot.motions import load_motion

        try:
            given = {name: value for name, value in self.options.items() if value is not None}
            found = load_motion(self.path, robot, order, **given)
        except JounceError:
            if _is_options_file(self.path):
                why = "options of how a table is read, not a motion"
                raise JounceError(f"{self.path}: {why}; give the table as MOTION, and this file by --read") from None
            raise
        found = found if self.blend is None else found.blended(self.blend, max(4, order + 2))
        return found if self.step is None else found.with_step(self.step)


def write_motion(output: Path, motion: "Motion", joints: Sequence[str], order: int | None = None) -> None:
    """Write a motion as a table with its rates up to an order, by default q4d or the last that is known."""
    from jounce.io import tables
    from jounce.io.motions import writing

    if motion.presence is not None:
        warn(f"{output}: a table has no columns for stances; motion.with_stances([...]) states them when it is read")
    known = 4 if motion.highest is None else motion.highest
    with stage("rates of the motion") as show:

        def shown() -> Iterator[Any]:
            done = 0
            for piece in writing.motion_pieces(motion, joints, min(4, known) if order is None else order):
                yield piece
                done += len(piece["t"])
                show(done, len(motion.times))

        tables.write_pieces(output, shown(), missing=[writing.MEASURED])


def add_motion_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Add the argument MOTION and its options to a `MotionCommand`, which gets them as one `MotionRequest`."""
    return click.argument("motion", type=MOTION_NAME)(_add_options(verb))


def add_optional_motion_options(verb: Callable[..., None]) -> Callable[..., None]:
    """`add_motion_options` of a command that does without a motion too: it gets None then."""
    return click.argument("motion", type=MOTION_NAME, required=False)(_add_options(verb))


def _add_options(verb: Callable[..., None]) -> Callable[..., None]:
    @wraps(verb)
    @click.pass_context
    def asked(ctx: click.Context, /, motion: Path | None, read: Path | None, **others: Any) -> None:
        options = {option.name: others.pop(option.name) for option in _options_by_key(ctx.command).values()}
        if motion is not None:
            blend, step = options.pop("blend"), options.pop("step")
            verb(motion=MotionRequest(motion, options, blend, step, read), **others)
        elif given := [name for name, value in {"read": read, **options}.items() if value]:
            raise JounceError(f"--{given[0].replace('_', '-')} needs a MOTION")
        else:
            verb(motion=None, **others)

    command: Callable[..., None] = asked
    for option in reversed(TABLE_OPTIONS):
        command = option(command)
    return command


def _options_by_key(command: click.Command) -> dict[str, click.Option]:
    """The options that a file of --read may have, by their names without dashes."""
    options = [option for option in command.params if isinstance(option, _TableReadingOption) and option.name != "read"]
    return {option.opts[0][2:]: option for option in options}


def read_options(path: Path, command: click.Command) -> dict[str, Any]:
    """The values of the options in a file, by parameter of the command; every key, type and value is checked."""
    from jounce.io import entries
    from jounce.motion.spline import Spline, select_smoothing

    options = _options_by_key(command)
    entry = entries.read(path, "the file of --read")
    if isinstance(entry.value, dict) and {"joints", "joint_names"} & {*entry.value}:
        raise JounceError(f"{path}: a motion, not options of how a table is read; give it as MOTION, without --read")
    given = entry.keys((), list(options)).members()
    values = {str(options[key].name): _check_value(value, options[key]) for key, value in given.items()}
    with locate_errors(path):
        degree, intervals, bandwidth, as_ = map(values.get, ("degree", "intervals", "bandwidth", "as_"))
        way = select_smoothing(degree, intervals, bandwidth, values.get("allow_noise", False), as_)
        if isinstance(way, Spline):
            way.check(sys.maxsize, "--read")  # its degree; how many samples there are is not known yet
    return values


def _is_options_file(path: Path) -> bool:
    """Whether what came as a motion is a file of --read."""
    try:
        return path.suffix.lower() in OPTION_FILES and bool(read_options(path, click.get_current_context().command))
    except JounceError:
        return False


_OPTION_VALUES: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "text": ("a text", lambda x: isinstance(x, str)),
    "boolean": ("true or false", lambda x: isinstance(x, bool)),
    "integer": ("an integer > 0", lambda x: type(x) is int and x > 0),
    "float": ("a finite number > 0", lambda x: type(x) in (int, float) and 0 < x < math.inf),
}


def _check_value(entry: "Entry", option: click.Option) -> Any:
    if isinstance(option.type, click.Choice):
        expected, is_valid = join_names(option.type.choices), option.type.choices.__contains__
    else:
        expected, is_valid = _OPTION_VALUES[option.type.name]
    if not is_valid(entry.value):
        raise entry.error(expected)
    return entry.value
