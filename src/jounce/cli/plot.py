"""`jounce plot`: the curves of a table as a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from jounce.cli.output import tell

EPILOG = """\b
Example:
  jounce run iiwa14 paper -o forces.csv
  jounce plot forces.csv -o forces.svg
  jounce plot forces.csv -o wrist.png --joint joint7 --quantity Q2d
"""


@click.command(epilog=EPILOG, short_help="Plot the curves of a table.")
@click.argument("table", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Output picture: .png, .svg or .pdf."
)
@click.option("--joint", "joints", multiple=True, metavar="NAME", help="Plot this joint only; may be repeated.")
@click.option(
    "--quantity",
    "quantities",
    multiple=True,
    metavar="Q",
    help="Plot this quantity only: Q, Qd, q, ...; may be repeated.",
)
@click.option("--json", "as_json", is_flag=True, help="Print what was drawn as JSON.")
def plot(table: Path, output: Path, joints: Sequence[str], quantities: Sequence[str], as_json: bool) -> None:
    """Draw the columns of TABLE over time: forces that `run` wrote, or a motion that `motion` wrote.

    One row per quantity, one curve per joint; curves too small to be seen next to the others have a second column.
    """
    from jounce.figures import canvas
    from jounce.figures.curves import over_time
    from jounce.figures.table import breaks_of, panels
    from jounce.io import files, tables

    canvas.check_format(output)
    files.check_writable(output)
    canvas.check_installed()
    columns = tables.read(table)
    drawn = panels(columns, str(table), joints, quantities)
    canvas.save(over_time(columns["t"], drawn, breaks=breaks_of(columns)), output)
    states = len(columns["t"])
    summary = {
        "table": str(table),
        "output": str(output),
        "states": states,
        "panels": {panel.label: list(panel.curves) for panel in drawn},
    }
    tell(summary, _in_words, as_json)


def _in_words(summary: dict[str, Any]) -> str:
    shown = ", ".join(label.split()[0] for label in summary["panels"])
    count, states = len({joint for joints in summary["panels"].values() for joint in joints}), summary["states"]
    size = f"{count} joint{'s' * (count > 1)}, {states} state{'s' * (states > 1)}"
    return f"{shown} of {size}, drawn to {summary['output']}"
