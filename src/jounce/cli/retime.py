"""`jounce retime`: the fastest motion along a path under all limits of a robot."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.limits import DIFFERENCES, KEPT_RATE, LIMITS, load_with_motion, select_rows
from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options, write_motion
from jounce.cli.output import align_columns, check_distinct, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options
from jounce.core.errors import shorten

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject

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
        from jounce.figures.limit_pictures import draw_path_speed

        canvas.save(draw_path_speed(arm, given, found), picture)
    notes = [*given.notes, *found.notes]

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "source": given.source, "margin": margin, "rate": rate,
            "given": given.duration, "duration": found.duration, "binding": [part._asdict() for part in found.binding],
            "jumps": found.jumps, "notes": notes, "output": str(output),
            "picture": None if picture is None else str(picture), "states": len(fast.times),
        }  # fmt: skip

    def lines() -> list[str]:
        rows: list[tuple[str, ...]] = [("decides", "limit", "|from [s]", "|to [s]")]
        for part in found.binding:
            rows.append((part.joint, part.limit.replace("_", " "), f"{part.start:.4f}", f"{part.stop:.4f}"))
        along, pictured = f"{shorten(arm.name)} along {motion.path}", f", drawn to {picture}" if picture else ""
        return [
            f"{along}: {given.duration:.6g} s -> {found.duration:.6g} s with a margin of {margin:.3g}",
            f"{len(fast.times)} rows written to {output}{pictured}",
            *([f"accelerations and efforts jump {found.jumps} times"] if found.jumps else []),
            *notes,
            "",
            *align_columns(rows),
        ]

    print_result(lines, data, as_json)
