"""`jounce plot`, `report`, `view` and `demo`: pictures and pages.

`plot` draws the curves of a table. `report` writes a page that any browser opens from disk. `view` serves the robot,
with sliders, until Ctrl-C ends it. `demo` runs the iiwa example of the paper, end to end, and draws its pictures.
"""

import os
import signal
import sys
import webbrowser
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import count
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

import click

from jounce.cli.commands import Command, split_names
from jounce.cli.limits import LIMITS, load_with_motion
from jounce.cli.motion_options import MotionRequest, add_motion_options, add_optional_motion_options
from jounce.cli.output import align_columns, check_distinct, print_result
from jounce.cli.robot_options import PATH, ROBOT_NAME, RobotRequest, add_robot_options
from jounce.core.errors import JounceError, escape_text, join_names, shorten, unknown_name_error
from jounce.core.progress import stage
from jounce.figures import canvas

if TYPE_CHECKING:
    from jounce._report.paper_example import Deviation, Example, StepErrors
    from jounce.core.typing import JsonObject
    from jounce.figures.panels import DrawnRun


Names = dict[str, dict[str, None]]  # of joints, by panel, each once and in order
PLOT_EPILOG = """\b
Examples:
  jounce run iiwa14 paper -o forces.csv
  jounce plot forces.csv -o forces.svg --robot iiwa14
  jounce plot forces.csv -o wrist.png --joint joint7 --quantity Q2d
  jounce plot forces.csv -o start.png --between 0 0.5
  jounce run iiwa14 paper-wrench -o loaded.csv
  jounce plot forces.csv loaded.csv -o both.pdf --quantity Q --width page
"""


@click.command(cls=Command, epilog=PLOT_EPILOG, short_help="Plot the curves of a table.")
@click.argument("tables", metavar="TABLE...", nargs=-1, required=True, type=PATH)
@click.option("-o", "--output", required=True, type=PATH, help="Output picture: .png, .svg or .pdf.")
@click.option("--robot", type=ROBOT_NAME, help="Robot of the tables; gives the order, units and limits of the joints.")
@click.option("--base", metavar="BASE", help="floating: the base moves freely. fixed: weld free joints at zero.")
@click.option("--joint", "joints", multiple=True, callback=split_names, metavar="NAMES", help="Draw these joints only.")
@click.option(
    "--quantity",
    "quantities",
    multiple=True,
    callback=split_names,
    metavar="NAMES",
    help="Draw these quantities only: Q, Qd, q, ....",
)
@click.option("--between", type=float, nargs=2, metavar="S S", help="Draw the rows between these times only.")
@click.option("--side-by-side", is_flag=True, help="Draw several tables next to each other instead of over each other.")
@click.option(
    "--width",
    metavar="column|page|MM",
    help="Exact width: a column (88.9 mm) or a page (181.9 mm) of an IEEE journal, or a number of mm.",
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

    There is one row per quantity and one curve per joint. Curves too small to be seen next to the others have their own
    column. With --robot, prismatic joints have their own column too, and values beyond a limit are marked. Several
    tables are laid over each other, in one set of axes per joint.
    """
    from jounce.figures import canvas
    from jounce.figures.curves import draw_curves, overlay_runs, parse_width
    from jounce.figures.panels import make_run, select_rows
    from jounce.io.motions import is_analytic, writing
    from jounce.io.tables import read

    inches = None if width is None else parse_width(width)
    canvas.check_writable(output)
    if base is not None and robot is None:
        raise JounceError("--base needs --robot: the base is that of this robot")
    mechanism = None
    if robot is not None:
        mechanism = RobotRequest(robot, {} if base is None else {"base": base}).load().mechanism
    for table in tables:
        if is_analytic(table):
            raise JounceError(f"{table} is not a table; make one with `jounce motion ROBOT {table} -o OUT`")
    runs = [
        make_run(
            select_rows(read(table, None, on_error == "skip", [writing.MEASURED]), str(table), between),
            *(str(table), joints, quantities, mechanism),
        )
        for table in tables
    ]
    # A single table needs no title, and its joints share axes.
    if len(runs) == 1:
        runs = [replace(runs[0], title="")]
    has_own_axes = side_by_side or len(runs) == 1
    figure = draw_curves(runs, width=inches) if has_own_axes else overlay_runs(runs, inches)
    canvas.save(figure, output, canvas.LOOK if inches is None else canvas.PRINT)
    states = [len(run.panels[0].channel.times) for run in runs]
    shown, exceeded = _find_shown(runs)

    def data() -> "JsonObject":
        named = {"panels": _name_lists(shown), "exceeded": _name_lists(exceeded)}
        return {"tables": [str(table) for table in tables], "output": str(output), "states": states, **named}

    print_result(lambda: _plot_lines(shown, exceeded, states, output), data, as_json)


def _find_shown(runs: "Sequence[DrawnRun]") -> tuple[Names, Names]:
    """Return the joints of each panel, and the joints beyond a limit."""
    from jounce.figures.curves import find_violations

    shown, exceeded = Names(), Names()
    for run in runs:
        for panel in run.panels:
            symbol, joints = panel.channel.symbol, panel.channel.names
            shown.setdefault(symbol, {}).update(dict.fromkeys(joints))
            violating = [name for name in joints if find_violations(panel, name).any()]
            if len(violating) > 0:
                exceeded.setdefault(symbol, {}).update(dict.fromkeys(violating))
    return shown, exceeded


def _name_lists(names_by_label: Names) -> dict[str, list[str]]:
    return {label: list(names) for label, names in names_by_label.items()}


def _plot_lines(shown: Names, exceeded: Names, states: Sequence[int], output: Path) -> list[str]:
    """Describe what was drawn, and the joints beyond a limit."""
    from jounce.model import coordinates

    names = {joint for joints in shown.values() for joint in joints}
    base_names = {*coordinates.BASE_FORCES}
    number = len(names - base_names)
    parts = []
    if number > 0:
        parts.append("1 joint" if number == 1 else f"{number} joints")
    if not names.isdisjoint(base_names):
        parts.append("the base")
    counts = " and ".join("1 state" if n == 1 else f"{n} states" for n in states)
    line = f"{', '.join(shown)} of {' and '.join(parts)}, {counts}, drawn to {output}"
    return [
        line,
        *(f"beyond a limit: {label} of {join_names(names_beyond)}" for label, names_beyond in exceeded.items()),
    ]


MESHES = click.option(
    "--meshes", metavar="FOLDER", multiple=True, type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Further folder with meshes, in addition to the folder of ROBOT and its packages. Repeatable.",
)  # fmt: skip
REPORT_EPILOG = """\b
Example:
  jounce report iiwa14 paper --limits iiwa14 --step 0.01 -o report.html

\b
PAGE is one file of about 6 MB that any browser opens from disk, without a
network.
"""


@click.command(
    cls=Command, epilog=REPORT_EPILOG, short_help="Write a page with the moving robot, its curves and limits."
)
@add_robot_options
@add_motion_options
@LIMITS
@click.option("-o", "--output", metavar="PAGE", required=True, type=PATH, help="Output page: .html.")
@click.option("--order", default=2, type=click.IntRange(0, 2), help="Highest time derivative of Q on the page.")
@click.option("--json", "as_json", is_flag=True, help="Print a summary of the page as JSON.")
@MESHES
def report(
    robot: RobotRequest,
    motion: MotionRequest,
    limits: Path | None,
    output: Path,
    order: int,
    as_json: bool,
    meshes: tuple[Path, ...],
) -> None:
    """Write a page about MOTION of ROBOT.

    It shows the moving robot, q to q4d, Q, Qd, Q2d, limits and the slow-down factor. A URDF is drawn with its meshes
    and shapes, other robots with capsules between their joints.
    """
    from jounce import _report
    from jounce._report.page import check_installed, check_writable
    from jounce.io.visuals import URDF_SUFFIX

    check_writable(output)
    check_distinct(output, motion.path)
    check_installed()
    arm, path = load_with_motion(robot, motion, limits, order)
    visuals = robot.path if robot.path.suffix.lower() == URDF_SUFFIX else None
    page = _report.report(arm, path, order, visuals, meshes, motion.path.name)
    page.save(output)
    # The page has no check where the robot has no limits, and no slow-down where no factor exists.
    check, slow, size = page.check, page.slowdown, output.stat().st_size
    worst = None if check is None else check.worst

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "states": len(path.times), "order": order,
            "output": str(output), "bytes": size,
            "ok": None if check is None else check.ok, "verdict": None if check is None else check.verdict,
            "judged": None if check is None else check.judged, "worst": None if worst is None else str(worst),
            "factor": None if slow is None else slow.factor,
            "largest": None if slow is None else slow.largest, "notes": list(path.notes),
        }  # fmt: skip

    def lines() -> list[str]:
        verdict = check.words if check is not None else "the robot has no limits"
        verdicts = [f"{shorten(arm.name)} along {motion.path}, {len(path.times)} states: {verdict}"]
        if worst is not None:
            verdicts.append(f"worst: {worst}")
        if slow is not None:
            reserve = f", {slow.words}" if slow.binding is None else ""
            verdicts.append(f"slow-down factor: {slow.factor:.6g}{reserve}")
        return [*verdicts, *path.notes, f"page of {size / 1e6:.1f} MB written to {output}"]

    print_result(lines, data, as_json)


DISPLAY_VARIABLES = ("DISPLAY", "WAYLAND_DISPLAY")  # one of them is set where windows can be shown
VIEW_EPILOG = """\b
Examples:
  jounce view panda
  jounce view iiwa14 paper-wrench --port 9000

\b
Ctrl-C ends the server. Only browsers on this machine can open the page.
"""


@click.command(cls=Command, epilog=VIEW_EPILOG, short_help="Show a robot in the browser, with sliders.")
@add_robot_options
@add_optional_motion_options
@click.option("--port", type=click.IntRange(0, 65535), help="Port of the server; default: a free one from 8080 on.")
@click.option("--no-open", is_flag=True, help="Print the address only; a terminal session else opens the page.")
@MESHES
def view(
    robot: RobotRequest, motion: MotionRequest | None, port: int | None, no_open: bool, meshes: tuple[Path, ...]
) -> None:
    """Show ROBOT in the browser, with sliders or along MOTION.

    Sliders set the positions of a robot at rest. A URDF is drawn with its meshes and shapes, other robots with their
    joints. The page also shows Q and its curves along the motion, frames and wrenches.
    """
    from jounce._report import scene, viewer
    from jounce._report.scene import record_track

    scene.check_installed()
    arm = robot.load()
    path = None if motion is None else motion.load(arm, 0)
    track = None if path is None else record_track(arm, path)
    # Ctrl-C ends the waiting, so that the server closes in order.
    stopped = Event()
    previous_handler = signal.signal(signal.SIGINT, lambda *_: stopped.set())
    try:
        with viewer.serve_robot(arm, robot.path, track, port, meshes) as shown:
            for note in (*shown.scene.notes, *(path.notes if path is not None else ())):
                click.echo(escape_text(note))
            click.echo(f"{escape_text(arm.name)} is shown at {shown.address}; Ctrl-C ends it")
            if not no_open and has_desktop_terminal():
                webbrowser.open(shown.address)
            viewer.run(shown, stopped.wait)
    finally:
        signal.signal(signal.SIGINT, previous_handler)
    click.echo("ended")


def has_desktop_terminal() -> bool:
    """Whether output goes to a terminal of a desktop.

    Elsewhere nobody sees a page, or a browser of text would take the terminal.
    """
    has_display = sys.platform in ("win32", "darwin") or any(os.environ.get(name) for name in DISPLAY_VARIABLES)
    return sys.stdout.isatty() and has_display


DEMO_EPILOG = """\b
Example:
  jounce demo -o paper --states 1000 --format png
"""


def _check_formats(ctx: click.Context, option: click.Parameter, texts: Sequence[str]) -> list[str]:
    """Return the formats of pictures, each once."""
    names = split_names(ctx, option, texts)
    for name in names:
        if name not in canvas.PICTURE_FORMATS:
            raise unknown_name_error("format of pictures", name, canvas.PICTURE_FORMATS)
    return list(dict.fromkeys(names))


@click.command(cls=Command, epilog=DEMO_EPILOG, short_help="Run the example of the paper, and draw its pictures.")
@click.option(
    "-o", "--output", default=Path("jounce-demo"), type=PATH, help="Output folder; it is created if it does not exist."
)
@click.option("--states", default=10_000, type=click.IntRange(100, 1_000_000), help="Number of states during the 5 s.")
@click.option(
    "--format",
    "formats",
    multiple=True,
    metavar="FORMATS",
    default=canvas.PICTURE_FORMATS,
    callback=_check_formats,
    help="Formats of the pictures.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def demo(output: Path, states: int, formats: Sequence[str], as_json: bool) -> None:
    """Run the paper's example: the KUKA iiwa along a motion of cosines, with and without a wrench at its end.

    The forces and their rates are written as tables. The pictures show q, Q, Qd and Q2d with numerical differentiation,
    the error of differentiation over its step, and the paper's figure of Q: its points, the curves of the authors'
    code, which meet the points, and the formulas with and without the wrench.
    """
    from jounce._report import paper_example
    from jounce._report.paper_example import deviations, gallery
    from jounce.figures import canvas
    from jounce.io import files, tables
    from jounce.io.motions import writing

    canvas.check_installed()
    files.make_folder(output)
    # Progress: two tables, one study of steps, the timing of each method, and five pictures per format.
    steps, total = count(1), 3 + len(paper_example.methods()) + 5 * len(formats)
    with stage("the paper's example") as show:

        def advance() -> None:
            show(next(steps), total)

        # The same motion without and with the wrench, each with its table of forces.
        examples = {}
        for name, motion in (("forces", "paper"), ("forces-wrench", "paper-wrench")):
            example = examples[name] = paper_example.example(motion, states)
            names = [f"{joint}.Q" for joint in example.robot.joint_names]
            forces = writing.column_channel(names, example.t, example.forces)
            tables.write(output / f"{name}.csv", {"t": example.t} | forces.to_columns())
            advance()
        # How good differentiation is, and what sets the paper's figure apart from its formulas.
        alone, loaded = examples.values()
        errors, causes = paper_example.step_errors(alone.robot), deviations(alone, loaded)
        advance()
        # Seconds per evaluation of each method: in a batch, and alone.
        times = {}
        for method, *times_in_s in paper_example.time_methods(alone):
            times[method] = times_in_s
            advance()
        pictures = gallery(alone, loaded, errors)
        for name, draw in pictures.items():
            figure = draw()
            for kind in formats:
                canvas.save(figure, output / f"{name}.{kind}")
                advance()
    summary = DemoSummary(
        states=states,
        peaks={"without W": _peaks(alone), "with W": _peaks(loaded)},
        differences=_differences(alone, errors),
        figure=causes,
        milliseconds={method: [1e3 * x for x in times_in_s] for method, times_in_s in times.items()},
        milliseconds_of_the_paper=paper_example.PAPER_MS,
        folder=str(output),
        tables=[f"{name}.csv" for name in examples],
        pictures=list(pictures),
        formats=list(formats),
    )
    print_result(lambda: _demo_lines(summary), lambda: asdict(summary), as_json)


@dataclass(frozen=True)
class DemoSummary:
    """The results of the demo by name: peaks of Q, Qd, Q2d, differences, times in ms, and files."""

    states: int
    peaks: Mapping[str, list[float]]
    differences: Mapping[str, list[float | None]]
    figure: "Mapping[str, Deviation]"
    milliseconds: Mapping[str, list[float]]
    milliseconds_of_the_paper: float
    folder: str
    tables: list[str]
    pictures: list[str]
    formats: list[str]


def _peaks(example: "Example") -> list[float]:
    return [float(abs(Q).max()) for Q in example.forces]


def _differences(alone: "Example", errors: "Sequence[StepErrors]") -> dict[str, list[float | None]]:
    """Return the largest relative errors of Qd and Q2d by differentiation scheme."""
    errors_by_scheme: dict[str, list[float | None]] = {
        f"central over the samples, h = {alone.t[1]:.2g} s": list(alone.differences())
    }
    for name in errors[1].of_scheme:
        errors_by_scheme[f"{name}, at its best step"] = [
            float(errors_of_rate.of_scheme[name].min()) if name in errors_of_rate.of_scheme else None
            for errors_of_rate in errors
        ]
    return errors_by_scheme | {"two exact paths compared": [errors_of_rate.exact for errors_of_rate in errors]}


def _demo_lines(summary: DemoSummary) -> list[str]:
    """Return the lines of the demo: a table for each comparison."""
    peaks = [(name, *(f"{peak:.6g}" for peak in row)) for name, row in summary.peaks.items()]
    differences = [
        (name, *("-" if share is None else f"{share:.1e}" for share in row))
        for name, row in summary.differences.items()
    ]
    times = [(name, *(f"{ms:.3g} ms" for ms in row)) for name, row in summary.milliseconds.items()]
    causes = [
        (name, *(f"{x:.3g} ({share:.1%})" for x, share in zip(row.largest, row.shares, strict=True)),
         f"{row.from_figure:.2g}")
        for name, row in summary.figure.items()
    ]  # fmt: skip
    return [
        f"The iiwa of Müller & Kumar, Section 6.2: {summary.states} states over 5 s; W: its end exerts 10 sin(pi t)",
        "",
        *align_columns([("largest", "|Q| N m", "|Qd| N m/s", "|Q2d| N m/s^2"), *peaks]),
        "",
        "Rates by numerical differentiation: largest error, as a share of the largest value",
        *align_columns([("", "Qd", "Q2d"), *differences]),
        "",
        "Time of one evaluation of Q, Qd and Q2d",
        *align_columns([("", "in a batch", "alone"), *times]),
        f"The paper reports {summary.milliseconds_of_the_paper} ms, on an Intel Core i9-7960X.",
        "",
        "The paper's figure of Q has the wrench W, which the text does not mention, and inertias without",
        "Steiner's theorem: largest difference from the formulas without W, and of Q from the figure",
        *align_columns([("", "Q N m", "Qd N m/s", "Q2d N m/s^2", "figure N m"), *causes]),
        "",
        f"In {summary.folder}: {', '.join(summary.tables)}",
        f"and as {', '.join(summary.formats)}: {', '.join(summary.pictures)}",
    ]
