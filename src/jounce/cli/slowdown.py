"""`jounce slowdown`: the fastest uniform pace, not above its own, at which a motion keeps every limit."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.limits import DIFFERENCES, KEPT_RATE, LIMITS, load_with_motion, select_rows
from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options, write_motion
from jounce.cli.output import check_distinct, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options
from jounce.core.errors import shorten

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject

EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce check iiwa14 slower.csv --limits iiwa14

\b
OUT holds t and NAME.q, NAME.qd, ... NAME.q4d of the motion at this pace. A
motion that keeps its limits stays as it is, and how much faster it could be
is printed; --up-to-limits makes it as fast. With --rate, and for --as
commands at the rate of the table, `jounce check --rate` finds every limit of
OUT kept.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="The pace at which a motion keeps every limit.")
@add_robot_options
@add_motion_options
@LIMITS
@KEPT_RATE
@DIFFERENCES
@click.option("--up-to-limits", is_flag=True, help="Make a motion faster too, as fast as its limits allow.")
@click.option("-o", "--output", type=PATH, help="Table of the slower motion: .csv or .npz.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def slowdown(
    robot: RobotRequest, motion: MotionRequest, limits: Path | None, rate: float | None, differences: int,
    up_to_limits: bool, output: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Find the largest factor of speed, at most 1, at which MOTION of ROBOT keeps all limits.

    Every smaller factor keeps them too; with --rate, and of measured samples, the factors that were tried do. Limits
    that samples decide at no speed are named.
    """
    from jounce.io import tables
    from jounce.motion.commands import find_commands

    if output is not None:
        tables.check_writable(output)
        check_distinct(output, motion.path)
    arm, path = load_with_motion(robot, motion, limits, 0 if rate is None else 1)
    if (commands := find_commands(path.curve)) and rate is None:
        rate = commands.rate
    slow = arm.slowdown(path, rate, differences, up_to_limits=up_to_limits)
    if output is not None:
        write_motion(output, select_rows(slow.motion, rate, None), arm.joint_names)
    before, after = path.duration, slow.motion.duration
    notes = [*path.notes, *slow.notes]

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "verdict": slow.verdict, "factor": slow.factor,
            "largest": slow.largest, "binding": slow.binding and slow.binding._asdict(), "duration": [before, after],
            "notes": notes, "rate": rate, "output": None if output is None else str(output),
        }  # fmt: skip

    def lines() -> list[str]:
        head = f"{shorten(arm.name)} along {motion.path}"
        written = [f"q to q4d written to {output}"] if output else []
        if slow.binding is None:
            return [f"{head}: {slow.words}", *notes, *written]
        change = "it must be slower" if slow.factor < 1 else "it becomes faster"
        bound = f"the {slow.binding.limit.replace('_', ' ')} of {slow.binding.joint} at t = {slow.binding.t:.6g} s"
        return [
            f"{head}: {change}, {slow.factor:.6g} times the speed",
            f"{before:.6g} s become {after:.6g} s; bound by {bound}",
            *notes,
            *written,
        ]

    print_result(lines, data, as_json)
