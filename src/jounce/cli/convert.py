"""`jounce convert`: a robot from any file that jounce reads into one of its own format."""

import json
from pathlib import Path

import click

from jounce.cli.names import ROBOT
from jounce.errors import JounceError

EPILOG = """\b
Example:
  jounce convert iiwa14 -o arm.yaml

\b
OUT holds names, tree, screws, inertias, limits, frames and gravity, in SI
units. Nothing is lost: what is read from it is the same to the last bit.
"""


@click.command(epilog=EPILOG, short_help="A robot as a YAML or JSON file.")
@click.argument("robot", type=ROBOT)
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="File to write: .yaml, .yml or .json."
)
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def convert(robot: Path, output: Path, as_json: bool) -> None:
    """Write ROBOT, a file (.urdf, .yaml, .json) or a bundled one's name, as a YAML or JSON file for people to edit."""
    from jounce.io.loading import load
    from jounce.io.saving import check_writable, save

    check_writable(output)
    if output.resolve() == robot.resolve():
        raise JounceError(f"{output}: is the robot itself; expected another file to write into")
    arm = load(robot)
    save(arm, output)
    m = arm.mechanism
    summary = {
        "robot": arm.name, "source": str(robot), "output": str(output), "n": m.n, "nb": m.nb, "frames": len(m.frames)
    }  # fmt: skip
    words = f"{arm.name}: {m.n} coordinates, {m.nb} bodies, {len(m.frames)} merged links written to {output}"
    click.echo(json.dumps(summary, indent=2) if as_json else words)
