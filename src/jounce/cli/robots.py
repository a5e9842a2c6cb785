"""`jounce robots`: the bundled robots, and the sources of their data."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.output import align_columns
from jounce.cli.robot_options import ROBOT_NAME
from jounce.core.errors import unknown_name_error

if TYPE_CHECKING:
    from jounce.io.bundled import BundledRobot

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
        data: Any = [_plain_data(one) for one in BUNDLED.values()]
        text = _table(data)
    else:
        name = str(robot)
        if name not in BUNDLED:
            raise unknown_name_error("bundled robot", name, BUNDLED)
        data = _plain_data(BUNDLED[name]) | {"notices": read_notices(name)}
        text = "\n\n".join([_table([data]), *data["notices"].values()]).rstrip()
    click.echo(json.dumps(data, indent=2) if as_json else text)


def _plain_data(robot: "BundledRobot") -> dict[str, Any]:
    return {key: value for key, value in vars(robot).items() if key != "build"}


def _table(robots: list[dict[str, Any]]) -> str:
    head = ("robot", "joints", "bodies", "mass kg", "what", "licence", "source")
    rows = [
        (r["name"], str(r["n"]), str(r["nb"]), f"{r['mass']:.5g}", r["kind"], r["licence"], r["source"]) for r in robots
    ]
    return "\n".join(align_columns([head, *rows]))
