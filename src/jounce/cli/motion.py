"""`jounce motion`: a motion as a table of q to q4d, to inspect and to run."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.motion_options import OPTION_FILES, MotionCommand, MotionRequest, add_motion_options, write_motion
from jounce.cli.output import check_distinct, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options_without_drives
from jounce.cli.summaries import LargestValues, hidden_in_words
from jounce.core.errors import JounceError, shorten

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject


EPILOG = """\b
Example:
  jounce motion iiwa14 paper -o motion.csv --step 0.01
  jounce plot motion.csv -o motion.svg
  jounce run iiwa14 motion.csv -o forces.csv

\b
OUT contains t and NAME.q, NAME.qd, ... NAME.q4d; the samples NAME.q_sample
and the standard deviations NAME.q_sd, ..., if MOTION has them; and, if it has
breaks, the column break: the order of the derivative that jumps between the
previous row and this one.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="Write a motion with its rates, q to q4d, as a table.")
@add_robot_options_without_drives
@add_motion_options
@click.option("-o", "--output", required=True, type=PATH, help="Output table: .csv or .npz.")
@click.option("--order", default=4, type=click.IntRange(0), help="Highest time derivative of q.")
@click.option("--save-read", type=PATH, metavar="FILE", help="Save how the table is read, for --read: .yaml.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def motion(
    robot: RobotRequest, motion: MotionRequest, output: Path, order: int, save_read: Path | None, as_json: bool
) -> None:
    """Write MOTION of ROBOT with its rates as a table that `jounce run` reads and `jounce plot` draws."""
    from jounce.engine.along import Q_RATE_ORDER
    from jounce.engine.hidden_vibrations import find_hidden_vibrations
    from jounce.engine.motion_channels import find_windows
    from jounce.io import tables
    from jounce.io.motions.writing import table_metadata
    from jounce.motion.extremes import find_motion_extremes
    from jounce.spatial.series import rate_name

    tables.check_writable(output)
    check_distinct(output, motion.path)
    if save_read is not None:
        check_options_writable(save_read)
        check_distinct(save_read, motion.path, robot.path, motion.read)
    arm = robot.load()
    path = motion.load(arm, max(order - 2, 0))
    write_motion(output, path, arm.joint_names, order)
    if save_read is not None:
        write_options(save_read, motion)
    unit = table_metadata(arm.mechanism, 0).unit
    windows = find_windows(path, order, Q_RATE_ORDER)
    peaks = find_motion_extremes(path, arm.joint_names, order, windows)
    values = LargestValues.of({motion.path.stem: peaks}, unit)
    hidden = find_hidden_vibrations(arm, path, order, "q")
    breaks = [found for found in path.breaks_to(order) if found.symbol != "contact"]
    first, last = float(path.times[0]), float(path.times[-1])
    residual = None if path.residual is None else float(path.residual.max())

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "source": path.source, "residual": residual,
            "notes": list(path.notes), "breaks": [found._asdict() for found in breaks],
            "hidden_vibrations": [asdict(one) for one in hidden], **values.json(),
            "output": str(output), "save_read": None if save_read is None else str(save_read),
            "states": len(path.times), "t": [first, last], "order": order,
        }  # fmt: skip

    def lines() -> list[str]:
        off = "" if residual is None else f", at most {residual:.2g} from what it is made of"
        count = len(breaks)
        return [
            f"{shorten(arm.name)} along {motion.path}: {len(path.times)} rows, t = {first:g} .. {last:g} s",
            path.source + off,
            *path.notes,
            *([f"{count} break{'s' * (count > 1)}; --json lists them, --blend replaces them"] if count else []),
            f"q to {rate_name('q', order)} written to {output}",
            *([f"options written to {save_read}, for --read"] if save_read else []),
            *(["", *values.table()] if values.largest else []),
            *hidden_in_words(hidden),
        ]

    print_result(lines, data, as_json)


def check_options_writable(path: Path) -> None:
    """Raise `JounceError` if options could not be written to a file, before any work is done."""
    from jounce.io import files

    if path.suffix.lower() not in OPTION_FILES:
        raise JounceError(f"{path}: unknown type of file {path.suffix!r} for --save-read; available: .yaml, .yml")
    files.check_writable(path)


def write_options(path: Path, motion: MotionRequest) -> None:
    """Write the options of a motion that differ from their defaults to a file that --read takes."""
    from jounce.io import files, robot_writing

    options = motion.options | {"blend": motion.blend, "step": motion.step}
    data = {name.rstrip("_").replace("_", "-"): value for name, value in options.items() if value not in (None, False)}
    with files.write_whole(path) as part:
        part.write_text(robot_writing.dump_yaml(data, flow=False), encoding="utf-8", newline="\n")
