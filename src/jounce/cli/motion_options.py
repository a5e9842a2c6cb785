"""The argument MOTION, and the options of how its table is read.

`jounce help tables` shows these options; a file for --read can keep them.
"""

import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.commands import TableOption
from jounce.cli.robot_options import MOTION_NAME, PATH, Decorator
from jounce.core.errors import JounceError, join_names, locate_errors, quote_value, warn
from jounce.core.progress import stage

if TYPE_CHECKING:
    from jounce.io.entries import Entry
    from jounce.motion import Motion
    from jounce.motion.poses import Poses
    from jounce.robot import Robot


def _read_defaults(ctx: click.Context, _: click.Parameter, path: Path | None) -> Path | None:
    """Make the options of a file defaults of the command.

    Options on the command line thus take precedence.
    """
    if path is not None:
        ctx.default_map = {**read_options(path, ctx.command), **(ctx.default_map or {})}
    return path


class _Pattern(click.ParamType):  # type: ignore[type-arg] # generic for mypy alone
    """A pattern of columns.

    In a file for --read it may be a mapping from joints to columns.
    """

    name = "pattern"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the pattern or the mapping."""
        return value


class _Renaming(click.ParamType):  # type: ignore[type-arg] # generic for mypy alone
    """A renaming OLD=NEW; in a file for --read a pair of a mapping."""

    name = "renaming"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        """Return what is renamed, and its new name."""
        if isinstance(value, tuple):
            return value
        old, _, new = value.partition("=")
        if old == "" or new == "" or "=" in new:
            raise JounceError(f"--rename {quote_value(value)}; expected OLD=NEW for a column, OLD*=NEW* for a prefix")
        return old, new


class _Numbers(click.ParamType):  # type: ignore[type-arg] # generic for mypy alone
    """Numbers of joints: one for all, in their order, JOINT=NUMBER, or a file."""

    name = "numbers"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return a number, a list, or a mapping by joint."""
        option = "" if param is None else param.opts[0]
        if not isinstance(value, str):  # of a file for --read, checked already
            return value
        if Path(value).suffix.lower() in NUMBER_FILES:
            return _read_numbers(Path(value), option)
        numbers = [_parse_number(word, option) for word in value.split(",")]
        names = [name for name, _ in numbers]
        if not any(names):
            values = [number for _, number in numbers]
            return values if len(values) > 1 else values[0]
        if not all(names) or len({*names}) < len(names):
            raise JounceError(f"{option} {quote_value(value)}; expected JOINT=NUMBER for each joint, once")
        return dict(numbers)


def _parse_number(word: str, option: str) -> tuple[str, float]:
    """Return the joint, "" without one, and the number of a word."""
    from jounce.core.foreign import parse_finite

    name, _, text = word.strip().rpartition("=")
    number = parse_finite(text)
    if number is None:
        expected = "expected a number, numbers separated by commas, JOINT=NUMBER, or a file of them"
        raise JounceError(f"{option} {quote_value(word)}; {expected}: {', '.join(NUMBER_FILES)}")
    return name, number


def _read_numbers(path: Path, option: str) -> Any:
    """Return the numbers in a file: of a table its only column, or its only row by joint."""
    from jounce.io import entries, tables

    if path.suffix.lower() != ".csv":
        entry = entries.read(path, f"the file of {option}")
        if not _is_numbers(entry.value):
            raise entry.error(NUMBERS_EXPECTED)
        return entry.value
    columns = tables.read(path)
    if len(columns) == 1:
        [column] = columns.values()
        return column.tolist()
    if any(len(column) != 1 for column in columns.values()):
        raise JounceError(f"{path}: {len(columns)} columns; expected one of numbers, or one row of numbers by joint")
    return {name: float(column[0]) for name, column in columns.items()}


def _is_numbers(value: Any) -> bool:
    """Whether a value is a number, or holds numbers alone."""
    values = [*value.values()] if isinstance(value, dict) else value
    numbers = values if isinstance(values, list) else [values]
    return len(numbers) > 0 and all(type(x) in (int, float) and math.isfinite(x) for x in numbers)


NUMBER_FILES = (".yaml", ".yml", ".json", ".csv")
NUMBERS_EXPECTED = "a number, a list of numbers in the order of the joints, or a mapping from joints to numbers"
POSE_OPTIONS = (  # of poses too
    *("time", "columns", "torques", "torque_constants", "gear_ratios", "angles", "rename", "time_unit", "unwrap"),
    "on_error",
)
OPTION_FILES = (".yaml", ".yml")
_option = partial(click.option, cls=TableOption)
TABLE_OPTIONS: tuple[Decorator, ...] = (
    _option(
        "--read", metavar="FILE", type=PATH, is_eager=True, callback=_read_defaults,
        help="Read options of this group from a YAML file, such as 'bandwidth: 20'."
        " Command-line options take precedence.",
    ),
    _option(
        "--bandwidth", type=float, metavar="HZ",
        help="Bandwidth of the smoothing of samples; default: chosen from the noise in the samples.",
    ),
    _option("--allow-noise", is_flag=True, help="Accept samples even if noise dominates the highest rate."),
    _option("--degree", type=int, metavar="K", help="Interpolate samples with a spline of degree 5 or 7."),
    _option("--intervals", type=int, metavar="N", help="Fit a spline with N intervals by least squares."),
    _option(
        "--as", "as_", type=click.Choice(["samples", "commands"]),
        help="What rows are: samples, which are smoothed (default), or commands of a controller, which are not."
    ),
    _option("--time", metavar="COLUMN", help="Name of the time column; default: t, time or timestamp."),
    _option(
        "--columns", metavar="PATTERN", type=_Pattern(),
        help="Pattern of the columns of joints, such as 'q_{joint}' or 'q{number}'."
    ),
    _option(
        "--torques", metavar="PATTERN",
        help="Pattern of the columns of measured torques, such as 'tau{number}'; default: tau_JOINT, JOINT.tau, ..."
    ),
    _option(
        "--torque-constants", metavar="VALUES", type=_Numbers(),
        help="Read currents in A as torques, by constants in N m/A: a number, numbers in joint order with commas,"
        " JOINT=NUMBER,..., or a file of them (.yaml, .json, .csv)."
    ),
    _option(
        "--gear-ratios", metavar="VALUES", type=_Numbers(),
        help="Gear ratios of motors for --torque-constants: torque = constant * ratio * current; default: 1."
    ),
    _option("--angles", type=click.Choice(["rad", "deg"]), help="Unit of angles and their rates in the table."),
    _option(
        "--unwrap", is_flag=True,
        help="Remove the jumps of angles that wrap at 0 and 360 degrees, or at -pi and pi."
    ),
    _option("--time-unit", type=click.Choice(["s", "ms", "us", "ns"]), help="Unit of times in the table."),
    _option(
        "--rename", metavar="OLD=NEW", multiple=True, type=_Renaming(),
        help="Rename a column, OLD=NEW, or a prefix, OLD*=NEW*: 'fer_*=panda_*' reads fer_joint1 as panda_joint1."
        " Repeatable.",
    ),
    _option(
        "--on-error", type=click.Choice(["stop", "skip"]),
        help="Bad rows: stop at the first (default), or skip them. run, motors and check write skipped rows to"
        " OUT.skipped.csv."
    ),
    _option(
        "--measured", type=click.Choice(["links", "motors"]),
        help="Whether the columns hold link positions (default) or motor positions, divided by the gear ratio.",
    ),
    _option("--topic", metavar="NAME", help="Topic to read from a ROS bag with several topics."),
    _option("--episode", metavar="N", type=click.IntRange(0), help="Episode to read from a LeRobot data set."),
    _option(
        "--duration", type=float, metavar="S",
        help="Duration in s of the motion along way points: MOTION has positions of joints and no times.",
    ),
    _option(
        "--tolerance", type=float, metavar="RAD|M",
        help="Join way points by straight lines, with corners rounded within this distance, the largest of any joint."
        " Default: a smooth path through all points.",
    ),
    _option(
        "--blend", type=float, metavar="S", help="Replace breaks of planned motions by C^4 blends of S seconds."
    ),
    _option(
        "--step", type=float, metavar="S", help="Time between rows in s; default: the motion's own rows, or 1 ms."
    ),
)  # fmt: skip


@dataclass(frozen=True)
class MotionRequest:
    """A motion by its path or name, with the options of `jounce.load_motion`.

    The command loads it for its robot. `read` is the file of --read, if there is one.
    """

    path: Path
    options: dict[str, Any]
    blend: float | None
    step: float | None
    read: Path | None

    def load(self, robot: "Robot", order: int, path_duration: float | None = None) -> "Motion":
        """Load the motion with the rates needed for forces of an order.

        Way points without a stated duration have that of a path, if there is one.
        """
        from jounce.motion.table_columns import UntimedError
        from jounce.robot.motions import load_motion

        try:
            options = {name: value for name, value in self.options.items() if value not in (None, ())}
            try:
                motion = load_motion(self.path, robot, order, **options)
            except UntimedError:
                if path_duration is None:
                    raise
                motion = load_motion(self.path, robot, order, **{**options, "duration": path_duration})
        except JounceError:
            # A file of options in the place of the motion is a likely mistake, with a cure of its own.
            if _is_options_file(self.path):
                kind = "options of how a table is read, not a motion"
                raise JounceError(f"{self.path}: {kind}; give a table as MOTION, and this file with --read") from None
            raise
        motion = motion if self.blend is None else motion.blended(self.blend, max(4, order + 2))
        return motion if self.step is None else motion.with_step(self.step)

    def load_log(self, robot: "Robot", holds: bool) -> "Motion | Poses":
        """Load a log with measured torques: a motion, or poses at rest.

        Poses are the rows of a table without times, or the holds of a log.
        """
        from jounce.io.motions.untimed import is_untimed
        from jounce.motion.table_columns import ColumnOptions
        from jounce.robot.motions import load_poses

        given = {**self.options, "blend": self.blend, "step": self.step}
        given = {name: value for name, value in given.items() if value not in (None, (), False)}
        columns = {name: given[name] for name in POSE_OPTIONS if name in given}
        named = {"columns": "pattern"}  # what options of columns are called there
        stated = {named.get(name, name): value for name, value in columns.items() if name != "on_error"}
        untimed = is_untimed(self.path, robot.mechanism, ColumnOptions(**stated))
        if not holds and not untimed:
            return self.load(robot, 0)
        for name in sorted(given.keys() - columns.keys()):
            option = f"--{name.rstrip('_').replace('_', '-')}"
            raise JounceError(f"{self.path}: {option} is for motions, and these are poses at rest; leave it out")
        return load_poses(self.path, robot, holds=None if untimed else True, **columns)


def write_motion(output: Path, motion: "Motion", joints: Sequence[str], order: int | None = None) -> None:
    """Write a motion as a table with rates up to an order.

    The default is q4d, or the highest known rate if it is lower.
    """
    from jounce.io import tables
    from jounce.io.motions import writing

    if motion.presence is not None:
        warn(f"{output}: the stances of the motion are not written; use motion.with_stances([...]) after reading")
    highest_known = 4 if motion.highest is None else motion.highest
    with stage("rates of the motion") as show:

        def reported_pieces() -> Iterator[Any]:
            rows_written = 0
            for piece in writing.motion_pieces(motion, joints, min(4, highest_known) if order is None else order):
                yield piece
                rows_written += len(piece["t"])
                show(rows_written, len(motion.times))

        tables.write_pieces(output, reported_pieces(), missing=[writing.MEASURED])


def add_motion_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Add the argument MOTION and its options to a command.

    The command receives them as one `MotionRequest`.
    """
    return click.argument("motion", type=MOTION_NAME)(_add_options(verb))


def add_optional_motion_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Add an optional argument MOTION and its options to a command.

    The command receives None if there is no motion.
    """
    return click.argument("motion", type=MOTION_NAME, required=False)(_add_options(verb))


def _add_options(verb: Callable[..., None]) -> Callable[..., None]:
    @wraps(verb)
    @click.pass_context
    def run_with_motion(ctx: click.Context, /, motion: Path | None, read: Path | None, **arguments: Any) -> None:
        # Options of tables are collected in the request; the others go on to the command.
        options = {option.name: arguments.pop(option.name) for option in _options_by_key(ctx.command).values()}
        if motion is not None:
            blend, step = options.pop("blend"), options.pop("step")
            verb(motion=MotionRequest(motion, options, blend, step, read), **arguments)
            return
        given_names = [name for name, value in {"read": read, **options}.items() if value not in (None, False, ())]
        if len(given_names) > 0:
            raise JounceError(f"--{given_names[0].replace('_', '-')} needs a MOTION")
        verb(motion=None, **arguments)

    command: Callable[..., None] = run_with_motion
    for option in reversed(TABLE_OPTIONS):
        command = option(command)
    return command


def _options_by_key(command: click.Command) -> dict[str, click.Option]:
    """Return the options of a file for --read, by their names without dashes."""
    options = [option for option in command.params if isinstance(option, TableOption) and option.name != "read"]
    return {option.opts[0][2:]: option for option in options}


def read_options(path: Path, command: click.Command) -> dict[str, Any]:
    """Return the values of a file of options, by parameter.

    Every key, type and value is checked.
    """
    from jounce.io import entries
    from jounce.motion.spline import Spline, select_smoothing

    options = _options_by_key(command)
    entry = entries.read(path, "the file of --read")
    if isinstance(entry.value, dict) and {"joints", "joint_names"} & {*entry.value}:
        raise JounceError(f"{path}: a motion, not options of how a table is read; give it as MOTION, not with --read")
    entries_by_key = entry.keys((), list(options)).members()
    values = {str(options[key].name): _check_value(value, options[key]) for key, value in entries_by_key.items()}
    with locate_errors(path):
        degree, intervals, bandwidth, as_ = map(values.get, ("degree", "intervals", "bandwidth", "as_"))
        smoothing = select_smoothing(degree, intervals, bandwidth, values.get("allow_noise", False), as_)
        if isinstance(smoothing, Spline):
            # Only the degree can be checked: the number of samples is not known yet.
            smoothing.check(sys.maxsize, "--read")
    return values


def _is_options_file(path: Path) -> bool:
    """Whether the path of a motion is a file for --read."""
    try:
        return path.suffix.lower() in OPTION_FILES and bool(read_options(path, click.get_current_context().command))
    except JounceError:
        return False


def _is_mapping_of_texts(x: Any) -> bool:
    return isinstance(x, dict) and len(x) > 0 and all(isinstance(text, str) for pair in x.items() for text in pair)


_OPTION_VALUES: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "pattern": (
        "a pattern such as 'q{number}', or a mapping from joints to columns",
        lambda x: isinstance(x, str) or _is_mapping_of_texts(x),
    ),
    "renaming": ("a mapping from names in the table to names of the robot", _is_mapping_of_texts),
    "numbers": (NUMBERS_EXPECTED, _is_numbers),
    "text": ("a text", lambda x: isinstance(x, str)),
    "boolean": ("true or false", lambda x: isinstance(x, bool)),
    "integer range": ("an integer, 0 or more", lambda x: type(x) is int and x >= 0),
    "integer": ("an integer > 0", lambda x: type(x) is int and x > 0),
    "float": ("a finite number > 0", lambda x: type(x) in (int, float) and 0 < x < math.inf),
}


def _check_value(entry: "Entry", option: click.Option) -> Any:
    """Return the value of an entry if the option accepts it."""
    if isinstance(option.type, click.Choice):
        expected, is_valid = join_names(option.type.choices), option.type.choices.__contains__
    else:
        expected, is_valid = _OPTION_VALUES[option.type.name]
    if not is_valid(entry.value):
        raise entry.error(expected)
    return tuple(entry.value.items()) if option.multiple else entry.value
