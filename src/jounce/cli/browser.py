"""`jounce report` and `view`: a robot along a motion in a browser, from one file or from a server on this machine.

`report` writes a page that any browser opens from disk. `view` serves the robot, with sliders, until Ctrl-C ends it.
"""

import signal
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

import click

from jounce.cli.limits import LIMITS, load_with_motion
from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options, add_optional_motion_options
from jounce.cli.output import check_distinct, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options
from jounce.core.errors import escape_text, shorten

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject


MESHES = click.option(
    "--meshes", metavar="FOLDER", multiple=True, type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Folder in which meshes may be, besides that of ROBOT and its packages; may be repeated.",
)  # fmt: skip
REPORT_EPILOG = """\b
Example:
  jounce report iiwa14 paper --limits iiwa14 --step 0.01 -o report.html

\b
PAGE is one file of about 6 MB that any browser opens from disk; it asks no
server for anything.
"""


@click.command(
    cls=MotionCommand, epilog=REPORT_EPILOG, short_help="A page with the moving robot, its curves and limits."
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
    """Make a page about MOTION of ROBOT: the robot that moves, q to q4d, Q, Qd, Q2d, limits, slow-down factor.

    A URDF is shown by its meshes and shapes, other robots by capsules between their joints.
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
    worst, size = page.check and page.check.worst, output.stat().st_size

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "states": len(path.times), "order": order,
            "output": str(output), "bytes": size,
            "ok": page.check and page.check.ok, "verdict": page.check and page.check.verdict,
            "judged": page.check and page.check.judged, "worst": worst and str(worst),
            "factor": page.slowdown and page.slowdown.factor,
            "largest": page.slowdown and page.slowdown.largest, "notes": list(path.notes),
        }  # fmt: skip

    def lines() -> list[str]:
        verdict = page.check.words if page.check else "states no limits"
        found = [f"{shorten(arm.name)} along {motion.path}, {len(path.times)} states: {verdict}"]
        found += [f"worst: {worst}"] if worst else []
        if page.slowdown:
            reserve = f", {page.slowdown.words}" if page.slowdown.binding is None else ""
            found.append(f"slow-down factor: {page.slowdown.factor:.6g}{reserve}")
        return [*found, *path.notes, f"page of {size / 1e6:.1f} MB written to {output}"]

    print_result(lines, data, as_json)


VIEW_EPILOG = """\b
Examples:
  jounce view panda
  jounce view iiwa14 paper-wrench --port 9000

\b
Ctrl-C ends it. Only browsers on this machine see it.
"""


@click.command(cls=MotionCommand, epilog=VIEW_EPILOG, short_help="Show a robot in the browser, with sliders.")
@add_robot_options
@add_optional_motion_options
@click.option("--port", type=click.IntRange(0, 65535), help="Port of the server; default: a free one from 8080 on.")
@MESHES
def view(robot: RobotRequest, motion: MotionRequest | None, port: int | None, meshes: tuple[Path, ...]) -> None:
    """Show ROBOT in the browser, at rest at the positions of its sliders, or along MOTION.

    A URDF is shown by its meshes and shapes, other robots by their joints. Q, its curves along the motion, frames and
    wrenches are shown too.
    """
    from jounce._report import scene, viewer
    from jounce._report.scene import record_track

    scene.check_installed()
    arm = robot.load()
    moves = None if motion is None else motion.load(arm, 0)
    along = None if moves is None else record_track(arm, moves)
    stopped = Event()
    before = signal.signal(signal.SIGINT, lambda *_: stopped.set())
    try:
        with viewer.serve_robot(arm, robot.path, along, port, meshes) as served:
            for note in (*served.scene.notes, *(moves.notes if moves else ())):
                click.echo(escape_text(note))
            click.echo(f"{escape_text(arm.name)} is shown at {served.address}; Ctrl-C ends it")
            viewer.run(served, stopped.wait)
    finally:
        signal.signal(signal.SIGINT, before)
    click.echo("ended")
