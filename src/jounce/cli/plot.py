"""`jounce plot`: the curves of a table as a picture."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.output import print_result
from jounce.cli.robot_options import PATH, ROBOT_NAME, RobotRequest
from jounce.core.errors import JounceError, join_names

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject
    from jounce.figures.panels import DrawnRun

Names = dict[str, dict[str, None]]  # of joints, by panel, each once and in order
EPILOG = """\b
Examples:
  jounce run iiwa14 paper -o forces.csv
  jounce plot forces.csv -o forces.svg --robot iiwa14
  jounce plot forces.csv -o wrist.png --joint joint7 --quantity Q2d
  jounce plot forces.csv -o start.png --between 0 0.5
  jounce run iiwa14 paper-wrench -o loaded.csv
  jounce plot forces.csv loaded.csv -o both.pdf --quantity Q --width page
"""


@click.command(epilog=EPILOG, short_help="Plot the curves of a table.")
@click.argument("tables", metavar="TABLE...", nargs=-1, required=True, type=PATH)
@click.option("-o", "--output", required=True, type=PATH, help="Output picture: .png, .svg or .pdf.")
@click.option("--robot", type=ROBOT_NAME, help="Robot of the tables, for order, units and limits of its joints.")
@click.option("--base", metavar="BASE", help="floating: its base moves freely. fixed: weld free joints at zero.")
@click.option("--joint", "joints", multiple=True, metavar="NAME", help="Draw this joint only; may be repeated.")
@click.option(
    "--quantity", "quantities", multiple=True, metavar="Q", help="Draw this quantity only: Q, Qd, q, ...; repeatable."
)
@click.option("--between", type=float, nargs=2, metavar="S S", help="Draw the rows between these times only.")
@click.option("--side-by-side", is_flag=True, help="Draw several tables next to each other instead of over each other.")
@click.option(
    "--width",
    metavar="column|page|MM",
    help="Exact width of the picture: a column (88.9 mm) or page (181.9 mm) of the IEEE's journals, or a number of mm.",
)
@click.option("--on-error", type=click.Choice(["stop", "skip"]), default="stop", help="Bad rows: stop, or skip them.")
@click.option("--json", "as_json", is_flag=True, help="Print what was drawn as JSON.")
def plot(
    tables: Sequence[Path],
    output: Path,
    robot: Path | None,
    base: str | None,
    joints: Sequence[str],
    quantities: Sequence[str],
    between: tuple[float, float] | None,
    side_by_side: bool,
    width: str | None,
    on_error: str,
    as_json: bool,
) -> None:
    """Draw the columns of each TABLE over time: forces that `run` wrote, or a motion that `motion` wrote.

    One row per quantity, one curve per joint. Curves too small to be seen next to the others have their own column; so
    do prismatic joints, which --robot identifies. --robot also marks what is beyond a limit. Several
    tables are laid over each other, in axes of their own for each joint.
    """
    from jounce.figures import canvas
    from jounce.figures.curves import draw_curves, overlay_runs, parse_width
    from jounce.figures.panels import make_run, select_rows
    from jounce.io.motions import is_analytic
    from jounce.io.motions.writing import MEASURED
    from jounce.io.tables import read

    inches = None if width is None else parse_width(width)
    canvas.check_writable(output)
    if base is not None and robot is None:
        raise JounceError("--base needs --robot, the robot whose joints it welds")
    mechanism = None if robot is None else RobotRequest(robot, {} if base is None else {"base": base}).load().mechanism
    for table in tables:
        if is_analytic(table):
            raise JounceError(f"{table} is no table; `jounce motion ROBOT {table} -o OUT` makes one to be drawn")
    runs = [
        make_run(
            select_rows(read(table, None, on_error == "skip", [MEASURED]), str(table), between),
            *(str(table), joints, quantities, mechanism),
        )
        for table in tables
    ]
    if len(runs) == 1:
        runs = [replace(runs[0], title="")]
    apart = side_by_side or len(runs) == 1
    figure = draw_curves(runs, width=inches) if apart else overlay_runs(runs, inches)
    canvas.save(figure, output, canvas.LOOK if inches is None else canvas.PRINT)
    states = [len(run.panels[0].channel.times) for run in runs]
    shown, exceeded = _find_shown(runs)

    def data() -> "JsonObject":
        named = {"panels": _name_lists(shown), "exceeded": _name_lists(exceeded)}
        return {"tables": [str(table) for table in tables], "output": str(output), "states": states, **named}

    print_result(lambda: _lines(shown, exceeded, states, output), data, as_json)


def _find_shown(runs: "Sequence[DrawnRun]") -> tuple[Names, Names]:
    """The joints of each panel, in order, and those of them that are beyond a limit."""
    from jounce.figures.curves import find_violations

    shown, exceeded = Names(), Names()
    for run in runs:
        for panel in run.panels:
            symbol, joints = panel.channel.symbol, panel.channel.names
            shown.setdefault(symbol, {}).update(dict.fromkeys(joints))
            if names := [name for name in joints if find_violations(panel, name).any()]:
                exceeded.setdefault(symbol, {}).update(dict.fromkeys(names))
    return shown, exceeded


def _name_lists(found: Names) -> dict[str, list[str]]:
    return {label: list(names) for label, names in found.items()}


def _lines(shown: Names, exceeded: Names, states: Sequence[int], output: Path) -> list[str]:
    from jounce.model.coordinates import BASE_FORCES

    names = {joint for joints in shown.values() for joint in joints}
    of = [f"{count} joint{'s' * (count > 1)}"] if (count := len(names - {*BASE_FORCES})) else []
    of += ["the base"] if names & {*BASE_FORCES} else []
    counts = " and ".join(f"{n} state{'s' * (n > 1)}" for n in states)
    line = f"{', '.join(shown)} of {' and '.join(of)}, {counts}, drawn to {output}"
    return [line, *(f"beyond a limit: {label} of {join_names(found)}" for label, found in exceeded.items())]
