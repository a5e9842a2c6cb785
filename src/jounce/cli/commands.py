"""Commands, and their help by sections and topics.

The options of robots and of tables are the same in many commands. The help of a command shows its own options first,
then those of the robot; the options of tables are in `jounce help tables`. An option that takes one value is refused
where it is given twice: click would drop the first value in silence. Former names of options are refused with the names
of today. `jounce help` shows the topics that several commands share.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import click

from jounce.core.errors import JounceError, quote_value, unknown_name_error

TYPED_WORDS = "jounce.typed_words"  # key in the `meta` of a context: the words of the command line after the command
TABLES_LINE = "How a table is read (--rename, --angles, --bandwidth, ...): jounce help tables"


class RobotOption(click.Option):
    """An option of the robot, which most commands share."""


class TableOption(click.Option):
    """An option of how the table of a motion is read."""


class Command(click.Command):
    """A command with sections in its help.

    `former` maps former options to those of today.
    """

    def __init__(self, *args: Any, former: Mapping[str, str] | None = None, **options: Any) -> None:
        super().__init__(*args, **options)
        self.former = dict(former or {})

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Refuse former and repeated options, and keep the typed words."""
        ctx.meta[TYPED_WORDS] = list(args)
        for word in args:
            name = word.partition("=")[0]
            if name in self.former:
                raise JounceError(f"{name} is now {self.former[name]}: jounce {self.name} --help")
        if not ctx.resilient_parsing:
            self._refuse_repetition(ctx, args)
        return super().parse_args(ctx, args)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options of the command, then those of the robot.

        Options of tables have one line, which names their topic.
        """
        options = [option for option in self.get_params(ctx) if isinstance(option, click.Option)]
        own = [option for option in options if not isinstance(option, RobotOption | TableOption)]
        of_robot: list[click.Option] = [option for option in options if isinstance(option, RobotOption)]
        for title, section in (("Options", own), ("Robot", of_robot)):
            if len(section) > 0:
                with formatter.section(title):
                    write_options(section, ctx, formatter)
        if any(isinstance(option, TableOption) for option in options):
            formatter.write_paragraph()
            formatter.write_text(TABLES_LINE)

    def _refuse_repetition(self, ctx: click.Context, args: list[str]) -> None:
        """Raise an error if an option of one value is given twice: click would drop the first value."""
        _, _, order = self.make_parser(ctx).parse_args(args=list(args))
        counts = Counter(
            option.opts[-1]
            for option in order
            if isinstance(option, click.Option) and not (option.multiple or option.is_flag or option.count)
        )
        for name, count in counts.items():
            if count > 1:
                raise JounceError(f"{name} is given {count} times; expected it once")


def write_options(options: list[click.Option], ctx: click.Context, formatter: click.HelpFormatter) -> None:
    """Write the names of options, with what they do."""
    records = [option.get_help_record(ctx) for option in options]
    formatter.write_dl([record for record in records if record is not None])


def split_names(_: click.Context, option: click.Parameter, texts: Sequence[str]) -> tuple[str, ...]:
    """Return the names of an option.

    They are separated by commas or given one by one.
    """
    names: list[str] = []
    for text in texts:
        names_of_text = [name.strip() for name in text.split(",")]
        if "" in names_of_text:
            raise JounceError(f"{option.opts[-1]} {quote_value(text)}; expected names with commas between them")
        names += names_of_text
    return tuple(names)


TABLES, QUANTITY_NAMES = "tables", "quantities"
TABLES_TEXT = """\b
MOTION is a table: .csv, .tsv, .txt, .npz, .mat, .parquet or JSON lines, or a
ROS bag. It has a column of times and, matched by joint name in any order,
  either one column per joint    samples; rates come from a spline
  or NAME.q, NAME.qd, NAME.q2d,  used unchanged; order 2 needs q to q4d,
     NAME.q3d, NAME.q4d          order 0 needs q to q2d
  of balls, planar and free joints NAME.qx, ..., with rates NAME.qxd, ... or
     velocities NAME.wx, ...
and, if wrenches act, BODY.mx .. BODY.fz: the wrench that the body exerts, in
its own axes, as samples or with rates BODY.fxd, BODY.fx2d ...
Torques are columns tau_NAME, NAME.tau, NAME_tau, NAME.effort, ...; currents,
with --torque-constants, are current_NAME, NAME.current, ...

\b
Or MOTION is a YAML file with analytic terms for each joint, whose rates are
exact:
  time: {start: 0, stop: 5, count: 1001}
  joints:
    joint1: {offset: 0.5, cosines: [{amplitude: 1, frequency: 2, phase: 0}]}
    joint2: {polynomial: [0, 0.1, 0.2]}

\b
Times are t, time or timestamp. Units stand in the heading of a column, or in
an option:
  joint1 [deg]  joint1 (deg)  joint1_deg    or --angles deg
  t [ms]  time(us)  timestamp_ms            or --time-unit ms

\b
Other names are mapped by options, or in a file for --read:
  --rename base=shoulder_pan_joint          one column
  --rename 'fer_*=panda_*'                  a prefix, in tau_fer_joint1 too
  --columns 'q{number}'                     q1, q2, ... in the robot's order
  columns: {joint1: base, joint2: elbow}    in the file: joint: column

\b
MOTION may be a folder of tables, or one table of any size with a column
motion that names the motion of each row, or a LeRobot data set, of which
--episode N selects a motion. Such input is read by parts, in bounded memory,
and the same command continues a run that was stopped.
"""
QUANTITIES_TEXT = """\
Quantities for `jounce codegen --outputs`, each with its rates; the first is
the default:

{outputs}

BODY is a body or a merged link; FRAME is {frames},
default the first. For vectors, NAME.vjp and NAME.jvp are the products of the
derivatives by all inputs with weights or a direction.
"""
HELP_EPILOG = """\b
Example:
  jounce help tables
  jounce help quantities
  jounce help run
"""


@click.command("help", cls=Command, epilog=HELP_EPILOG, short_help="Show how tables are read, or help of a command.")
@click.argument("topic", required=False)
@click.pass_context
def help_command(ctx: click.Context, topic: str | None) -> None:
    """Show the help of TOPIC: tables, quantities or a command.

    tables is how the table of a motion is read, quantities are those of generated code.
    """
    assert ctx.parent is not None
    commands = ctx.parent.command.commands  # type: ignore[attr-defined] # a group
    if topic is None:
        click.echo(ctx.parent.get_help())
    elif topic == TABLES:
        click.echo(_tables_help(ctx, commands["run"]))
    elif topic == QUANTITY_NAMES:
        click.echo(_quantities_help())
    elif topic in commands:
        command = commands[topic]
        with click.Context(command, info_name=topic, parent=ctx.parent) as command_context:
            click.echo(command.get_help(command_context))
    else:
        raise unknown_name_error("topic", topic, [TABLES, QUANTITY_NAMES, *commands])


def _tables_help(ctx: click.Context, command: click.Command) -> str:
    """Return how tables are read, with the options for it."""
    formatter = ctx.make_formatter()
    for paragraph in TABLES_TEXT.split("\n\n"):
        formatter.write_text(paragraph)
        formatter.write_paragraph()
    with formatter.section("Options of run, motion, check and all other commands on a MOTION"):
        write_options([option for option in command.params if isinstance(option, TableOption)], ctx, formatter)
    return formatter.getvalue().rstrip()


def _quantities_help() -> str:
    """Return the quantities of generated code by their names for --outputs."""
    from jounce.dynamics.kinematics import SCREW_FRAMES
    from jounce.dynamics.quantities import QUANTITIES

    rows = QUANTITIES.values()
    names = [row.name + ":BODY" * row.of_bodies + "[:FRAME]" * bool(row.gives.frames) for row in rows]
    outputs = fill(", ".join(names), 76, initial_indent="  ", subsequent_indent="  ", break_on_hyphens=False)
    return QUANTITIES_TEXT.format(outputs=outputs, frames=" or ".join(SCREW_FRAMES)).rstrip()
