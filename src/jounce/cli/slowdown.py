"""`jounce slowdown`: the fastest uniform pace at which a motion keeps every limit."""

from pathlib import Path
from typing import Any

import click

from jounce.cli.limits import LIMITS, load_with_motion
from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options, write_motion
from jounce.cli.output import check_distinct, print_summary
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options
from jounce.core.errors import shorten

EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce check iiwa14 slower.csv --limits iiwa14

\b
OUT holds t and NAME.q, NAME.qd, ... NAME.q4d of the motion at this pace.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="The pace at which a motion keeps every limit.")
@add_robot_options
@add_motion_options
@LIMITS
@click.option("-o", "--output", type=PATH, help="Table of the slower motion: .csv or .npz.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def slowdown(
    robot: RobotRequest, motion: MotionRequest, limits: Path | None, output: Path | None, as_json: bool
) -> None:
    """Find the largest factor of speed at which MOTION of ROBOT keeps all limits, and every smaller one does too."""
    from jounce.io import tables

    if output is not None:
        tables.check_writable(output)
        check_distinct(output, motion.path)
    arm, path = load_with_motion(robot, motion, limits)
    slow = arm.slowdown(path)
    if output is not None:
        write_motion(output, slow.motion, arm.joint_names)
    summary = {
        "robot": arm.name, "motion": str(motion.path), "factor": slow.factor, "largest": slow.largest,
        "binding": slow.binding._asdict(), "duration": [path.duration, slow.motion.duration],
        "notes": [*path.notes, *slow.notes], "output": None if output is None else str(output),
    }  # fmt: skip
    print_summary(summary, _format_summary, as_json)


def _format_summary(summary: dict[str, Any]) -> str:
    factor, binding = summary["factor"], summary["binding"]
    before, after = summary["duration"]
    kept = "it may be faster" if factor > 1 else "it must be slower" if factor < 1 else "it just keeps its limits"
    head = f"{shorten(summary['robot'])} along {summary['motion']}: {kept}, {factor:.6g} times the speed"
    largest = summary["largest"]
    gap = (
        [f"limits are kept again up to {largest:.6g} times the speed, but not by all factors between"]
        if largest is not None and largest > factor * (1 + 1e-9)
        else []
    )
    limit = binding["limit"].replace("_", " ")
    return "\n".join([
        head,
        f"{before:.6g} s become {after:.6g} s; bound by the {limit} of {binding['joint']} at t = {binding['t']:.6g} s",
        *gap,
        *summary["notes"],
        *([f"q to q4d written to {summary['output']}"] if summary["output"] else []),
    ])  # fmt: skip
