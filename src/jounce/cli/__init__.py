"""The command `jounce`: one verb a file; what jounce raises becomes one line and exit code 2."""

import errno
import warnings
from typing import Any

import click

from jounce import JounceError, __version__
from jounce.cli.convert import convert
from jounce.cli.info import info
from jounce.cli.run import run


class _Refusal(click.ClickException):
    exit_code = 2


class _Verbs(click.Group):
    def invoke(self, ctx: click.Context) -> Any:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: click.echo(f"Warning: {message}", err=True)
            try:
                return super().invoke(ctx)
            except JounceError as error:
                raise _Refusal(str(error)) from error
            except OSError as error:  # of the terminal, or a full disk behind it; click sees to a closed pipe
                if error.errno == errno.EPIPE:
                    raise
                raise _Refusal(error.strerror or str(error)) from error


@click.group(cls=_Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="jounce")
def main() -> None:
    """Higher-order inverse dynamics: a robot and a motion in, drive forces and their exact time derivatives out."""


main.add_command(run)
main.add_command(info)
main.add_command(convert)
