"""`jounce report`: a page about a robot along a motion."""

from pathlib import Path

import click

from jounce.cli.limits import LIMITS, load_with_motion
from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import check_distinct, print_summary
from jounce.cli.robot_options import MESHES, PATH, RobotRequest, add_robot_options
from jounce.core.errors import shorten
from jounce.core.typing import JsonObject

EPILOG = """\b
Example:
  jounce report iiwa14 paper --limits iiwa14 --step 0.01 -o report.html

\b
PAGE is one file of about 6 MB that any browser opens from disk; it asks no
server for anything.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="A page with the moving robot, its curves and limits.")
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
    worst = page.check and page.check.worst
    summary = {
        "robot": arm.name, "motion": str(motion.path), "states": len(path.times), "order": order,
        "output": str(output), "bytes": output.stat().st_size,
        "ok": page.check and page.check.ok, "verdict": page.check and page.check.verdict,
        "judged": page.check and page.check.judged, "worst": worst and str(worst),
        "factor": page.slowdown and page.slowdown.factor,
        "largest": page.slowdown and page.slowdown.largest, "notes": list(path.notes),
    }  # fmt: skip
    verdict = page.check.words if page.check else "states no limits"
    reserve = page.slowdown.words if page.slowdown and page.slowdown.binding is None else ""
    print_summary(summary, lambda of: _format_summary(of, verdict, reserve), as_json)


def _format_summary(summary: JsonObject, verdict: str, reserve: str) -> str:
    head = f"{shorten(summary['robot'])} along {summary['motion']}, {summary['states']} states"
    worst = [f"worst: {summary['worst']}"] if summary["worst"] else []
    factor = [f"slow-down factor: {summary['factor']:.6g}{reserve and ', ' + reserve}"] if summary["factor"] else []
    written = f"page of {summary['bytes'] / 1e6:.1f} MB written to {summary['output']}"
    return "\n".join([f"{head}: {verdict}", *worst, *factor, *summary["notes"], written])
