"""`jounce plot`: the curves of a table as a picture."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from jounce.cli.options import ROBOT, Asked
from jounce.cli.output import tell
from jounce.errors import JounceError

EPILOG = """\b
Examples:
  jounce run iiwa14 paper -o forces.csv
  jounce plot forces.csv -o forces.svg --robot iiwa14
  jounce plot forces.csv -o wrist.png --joint joint7 --quantity Q2d
  jounce plot forces.csv -o start.png --between 0 0.5
  jounce run iiwa14 paper-wrench -o loaded.csv
  jounce plot forces.csv loaded.csv -o both.pdf --quantity Q
"""


@click.command(epilog=EPILOG, short_help="Plot the curves of a table.")
@click.argument("tables", metavar="TABLE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Output picture: .png, .svg or .pdf."
)
@click.option("--robot", type=ROBOT, help="Robot of the tables, for order, units and limits of its joints.")
@click.option("--base", metavar="fixed", help="fixed: weld floating, planar, spherical joints of the robot at zero.")
@click.option("--joint", "joints", multiple=True, metavar="NAME", help="Draw this joint only; may be repeated.")
@click.option(
    "--quantity", "quantities", multiple=True, metavar="Q", help="Draw this quantity only: Q, Qd, q, ...; repeatable."
)
@click.option("--between", type=float, nargs=2, metavar="S S", help="Draw the rows between these times only.")
@click.option("--json", "as_json", is_flag=True, help="Print what was drawn as JSON.")
def plot(
    tables: Sequence[Path],
    output: Path,
    robot: Path | None,
    base: str | None,
    joints: Sequence[str],
    quantities: Sequence[str],
    between: tuple[float, float] | None,
    as_json: bool,
) -> None:
    """Draw the columns of each TABLE over time: forces that `run` wrote, or a motion that `motion` wrote.

    One row per quantity, one curve per joint. Curves too small to be seen next to the others have their own column; so
    do prismatic joints, which --robot tells from revolute ones. Several tables are drawn side by side, with the same
    scales.
    """
    from jounce.figures import canvas
    from jounce.figures.curves import over_time
    from jounce.figures.table import rows_between, run_of
    from jounce.io import files
    from jounce.io.motions import is_analytic
    from jounce.io.tables import read

    canvas.check_format(output)
    files.check_writable(output)
    canvas.check_installed()
    if base is not None and robot is None:
        raise JounceError("--base needs --robot, the robot whose joints it welds")
    mechanism = None if robot is None else Asked(robot, {} if base is None else {"base": base}).load().mechanism
    for table in tables:
        if is_analytic(table):
            raise JounceError(f"{table} is no table; `jounce motion ROBOT {table} -o OUT` makes one to be drawn")
    runs = [run_of(rows_between(read(table), str(table), between), str(table), joints, quantities, mechanism)
            for table in tables]  # fmt: skip
    if len(runs) == 1:
        runs = [replace(runs[0], title="")]
    canvas.save(over_time(runs), output)
    shown: dict[str, dict[str, None]] = {}  # the joints of each panel, in order
    for run in runs:
        for panel in run.panels:
            shown.setdefault(panel.label, {}).update(dict.fromkeys(panel.curves))
    summary = {
        "tables": [str(table) for table in tables],
        "output": str(output),
        "states": [len(run.t) for run in runs],
        "panels": {label: list(names) for label, names in shown.items()},
    }
    tell(summary, _in_words, as_json)


def _in_words(summary: dict[str, Any]) -> str:
    shown = ", ".join(summary["panels"])
    count = len({joint for joints in summary["panels"].values() for joint in joints})
    states = " and ".join(f"{states} state{'s' * (states > 1)}" for states in summary["states"])
    return f"{shown} of {count} joint{'s' * (count > 1)}, {states}, drawn to {summary['output']}"
