"""`jounce retime`: the fastest motion along a path under all limits of a robot."""

from pathlib import Path
from typing import Any

import click

from jounce.cli.limits import DIFFERENCES, KEPT_RATE, LIMITS, load_with_motion, select_rows
from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options, write_motion
from jounce.cli.output import align_columns, check_distinct, print_summary
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options
from jounce.core.errors import shorten

EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce retime iiwa14 slower.csv --limits iiwa14 -o fast.csv

\b
OUT holds t and NAME.q, NAME.qd, ... NAME.q4d, as `jounce motion` writes them.
With --rate `jounce check --rate` finds every limit of OUT kept.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="The fastest motion along a path, within all limits.")
@add_robot_options
@add_motion_options
@LIMITS
@KEPT_RATE
@DIFFERENCES
@click.option("-o", "--output", required=True, type=PATH, help="Table to write: .csv or .npz.")
@click.option("--margin", default=0.01, help="Share of each limit that is left.")
@click.option(
    "--smooth/--no-smooth",
    default=True,
    help="Keep accelerations continuous; --no-smooth lets them jump, and is faster where all limits are of velocity,"
    " acceleration and effort.",
)
@click.option("--picture", type=PATH, help="Speed along the path with its limits: .png, .svg or .pdf.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def retime(
    robot: RobotRequest, motion: MotionRequest, limits: Path | None, rate: float | None, differences: int, output: Path,
    margin: float, smooth: bool, picture: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Write the fastest motion of ROBOT along the path of MOTION, from rest to rest, within all limits."""
    from jounce.figures import canvas
    from jounce.io import tables

    tables.check_writable(output)
    check_distinct(output, motion.path)
    if picture is not None:
        canvas.check_writable(picture)
    arm, given = load_with_motion(robot, motion, limits, 0 if rate is None else 1)
    found = arm.retime(given, margin, smooth, rate=rate, differences=differences)
    fast = select_rows(found.motion, rate, motion.step)
    write_motion(output, fast, arm.joint_names)
    if picture is not None:
        from jounce.figures.path_speed import draw_path_speed

        canvas.save(draw_path_speed(arm, given, found), picture)
    summary = {
        "robot": arm.name, "motion": str(motion.path), "source": given.source, "margin": margin, "rate": rate,
        "given": given.duration, "duration": found.duration, "binding": [part._asdict() for part in found.binding],
        "jumps": found.jumps, "notes": [*given.notes, *found.notes],
        "output": str(output), "picture": None if picture is None else str(picture), "states": len(fast.times),
    }  # fmt: skip
    print_summary(summary, _format_summary, as_json)


def _format_summary(summary: dict[str, Any]) -> str:
    rows: list[tuple[str, ...]] = [("decides", "limit", "|from [s]", "|to [s]")]
    for stretch in summary["binding"]:
        limit = stretch["limit"].replace("_", " ")
        rows.append((stretch["joint"], limit, f"{stretch['start']:.4f}", f"{stretch['stop']:.4f}"))
    along = f"{shorten(summary['robot'])} along {summary['motion']}"
    pictured = f", drawn to {summary['picture']}" if summary["picture"] else ""
    jumps = [f"accelerations and efforts jump {summary['jumps']} times"] if summary["jumps"] else []
    return "\n".join([
        f"{along}: {summary['given']:.6g} s -> {summary['duration']:.6g} s with a margin of {summary['margin']:.3g}",
        f"{summary['states']} rows written to {summary['output']}{pictured}",
        *jumps,
        *summary["notes"],
        "",
        *align_columns(rows),
    ])  # fmt: skip
