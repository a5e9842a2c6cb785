"""The command `jounce`: an error of jounce becomes one line and exit code 2.

A defect ends with exit code 2 too, below its traceback. Exit codes 1 and 3 are those of verdicts alone (`SystemExit`).
"""

import errno
import sys
import traceback
import warnings
from functools import partial
from io import TextIOWrapper
from typing import IO, Any

import click

from jounce.cli.commands import help_command
from jounce.cli.forces import live, motors, run
from jounce.cli.identification import identify, payload, stiffness
from jounce.cli.kernels import cache, codegen
from jounce.cli.motions import excite, motion, retime, slowdown
from jounce.cli.output import ProgressLine, show_progress, style_text
from jounce.cli.pages import demo, plot, report, view
from jounce.cli.robot_files import compare, convert, info, robots
from jounce.cli.verdicts import check, explain
from jounce.core.cures import running_command
from jounce.core.errors import JounceError, escape_text, one_line
from jounce.core.version import __version__

EPILOG = """\b
Example:
  jounce run iiwa14 paper
  jounce run iiwa14 paper -o forces.csv
  jounce plot forces.csv -o forces.png

\b
Shell completion: for bash, add this line to its start-up file,
  eval "$(_JOUNCE_COMPLETE=bash_source jounce)"
For zsh and fish, use zsh_source and fish_source instead.
"""


class _Refusal(click.ClickException):
    exit_code = 2

    def show(self, file: IO[Any] | None = None) -> None:
        click.echo(f"{style_text('Error', fg='red', bold=True)}: {self.format_message()}", file=file, err=True)


class Defect(_Refusal):
    """An exception that no code of jounce foresees, with its traceback."""

    def __init__(self, error: Exception) -> None:
        super().__init__(f"{type(error).__name__}: {one_line(error)}: a defect of jounce; report it with these lines")
        self.trace = "".join(traceback.format_exception(error)).splitlines()

    def show(self, file: IO[Any] | None = None) -> None:
        """Print the traceback, and the line of an error below it."""
        for line in self.trace:
            click.echo(escape_text(line), file=file, err=True)
        super().show(file)


class _Interruption(click.ClickException):
    """Ctrl-C in a command that another program calls."""

    exit_code = 130

    def __init__(self) -> None:
        super().__init__("Aborted!")

    def show(self, file: IO[Any] | None = None) -> None:
        click.echo(f"\n{self.format_message()}", file=file, err=True)


def _warn(line: ProgressLine | None, message: Warning | str, *_: Any, **__: Any) -> None:
    if line is not None:
        line.clear()
    click.echo(f"{style_text('Warning', fg='yellow', bold=True)}: {escape_text(str(message))}", err=True)


def _is_stop(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error: NumPy's loops over objects end in a SystemError."""
    while error is not None and not isinstance(error, KeyboardInterrupt | SystemExit):
        error = error.__cause__ or error.__context__
    return error is not None


class _Commands(click.Group):
    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Find the command; from here on, messages name its options."""
        resolved = super().resolve_command(ctx, args)
        options = resolved[1].params if resolved[1] is not None else []
        typed_words = ["jounce", str(resolved[0]), *resolved[2]]
        ctx.with_resource(running_command((name for option in options for name in option.opts), typed_words))
        return resolved

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands in groups, by what they are for."""
        width = max(map(len, self.commands))
        limit = formatter.width - 6 - width
        for title, commands in GROUPS.items():
            with formatter.section(title):
                rows = [(str(command.name).ljust(width), command.get_short_help_str(limit)) for command in commands]
                formatter.write_dl(rows)

    def main(self, *args: Any, **options: Any) -> Any:
        """Run the command; what the output cannot encode is escaped."""
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):
                stream.reconfigure(errors="backslashreplace")
        return super().main(*args, **options)

    def invoke(self, ctx: click.Context) -> Any:
        with show_progress() as line, warnings.catch_warnings():
            warnings.showwarning = partial(_warn, line)
            # NumPy warns of overflow; values that are not finite are refused anyway.
            warnings.simplefilter("ignore", RuntimeWarning)
            try:
                return super().invoke(ctx)
            except KeyboardInterrupt:
                raise _Interruption from None
            except JounceError as error:
                raise _Refusal(str(error)) from error
            except MemoryError as error:
                raise _Refusal(f"out of memory: {one_line(error) or 'use fewer states'}") from error
            except OSError as error:
                # The terminal fails, or a full disk behind it; click handles a closed pipe.
                if error.errno == errno.EPIPE:
                    raise
                raise _Refusal(error.strerror or str(error)) from error
            except (click.ClickException, click.exceptions.Exit, click.Abort):
                raise
            except Exception as error:
                if _is_stop(error):
                    raise
                raise Defect(error) from error


@click.group(
    cls=_Commands, epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"], "show_default": True}
)
@click.version_option(__version__, prog_name="jounce")
def main() -> None:
    """Higher-order inverse dynamics: a robot and a motion in, drive forces and their exact time derivatives out."""


GROUPS = {
    "Start here": (info, run, plot, report, view),
    "Limits": (check, slowdown, retime, explain, motors),
    "From logs": (motion, identify, payload, stiffness, excite, live),
    "Code": (codegen, convert, compare),
    "More": (robots, cache, demo, help_command),
}
for group in GROUPS.values():
    for verb in group:
        main.add_command(verb)
