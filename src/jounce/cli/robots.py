"""`jounce robots`: the bundled robots, and the sources of their data."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.output import SafeLine, align_columns, print_result
from jounce.cli.robot_options import ROBOT_NAME
from jounce.core.errors import unknown_name_error

if TYPE_CHECKING:
    pass

EPILOG = """\b
Example:
  jounce robots
  jounce robots panda
  jounce info panda
"""


@click.command(epilog=EPILOG, short_help="List the bundled robots.")
@click.argument("robot", type=ROBOT_NAME, required=False)
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def robots(robot: Path | None, as_json: bool) -> None:
    """List the bundled robots by the names that all commands accept, or show the full licence of ROBOT."""
    from jounce.io.bundled import BUNDLED, read_notices

    if robot is None:
        shown, notices = list(BUNDLED.values()), {}
    else:
        name = str(robot)
        if name not in BUNDLED:
            raise unknown_name_error("bundled robot", name, BUNDLED)
        shown, notices = [BUNDLED[name]], read_notices(name)

    def lines() -> list[str]:
        head = ("robot", "joints", "bodies", "mass kg", "what", "licence", "source")
        rows = [(r.name, str(r.n), str(r.nb), f"{r.mass:.5g}", r.kind, r.licence, r.source) for r in shown]
        texts = "\n\n".join(["", *notices.values()]).rstrip().splitlines()
        return [*align_columns([head, *rows]), *map(SafeLine, texts[1:])]

    data = [{key: value for key, value in vars(one).items() if key != "build"} for one in shown]
    print_result(lines, lambda: data if robot is None else data[0] | {"notices": notices}, as_json)
