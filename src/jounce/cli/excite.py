"""`jounce excite`: the motion within all limits that determines the parameters of a robot best."""

from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.limits import LIMITS, draw_ratios, load_robot
from jounce.cli.motion_options import write_motion
from jounce.cli.output import check_distinct, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options_without_drives, parse_drive_terms
from jounce.core.errors import JounceError, quote_value, shorten
from jounce.core.progress import stage

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject

EPILOG = """\b
Example:
  jounce excite ur5 --starts 1 -o excite.csv
  jounce check ur5 excite.csv

\b
OUT.csv, .npz or .parquet holds t and NAME.q, NAME.qd, ... NAME.q4d; OUT.yaml
or .json the offsets, amplitudes and frequencies of the series.

\b
Nothing but its limits keeps the robot from obstacles and from itself: check
the motion before it runs, or narrow the ranges of positions by --limits.
"""


@click.command(epilog=EPILOG, short_help="A motion that excites the parameters of a robot, within all limits.")
@add_robot_options_without_drives
@LIMITS
@click.option("-o", "--output", required=True, type=PATH, help="Table or YAML file of the motion to write.")
@click.option("--period", metavar="S", default=10.0, help="Period of the Fourier series in s.")
@click.option("--periods", metavar="N", default=1, help="Number of periods.")
@click.option("--harmonics", metavar="N", default=5, help="Harmonics of the Fourier series.")
@click.option(
    "--drives",
    "terms",
    metavar="TERMS",
    help="Drive terms to identify too: all, or a list of armature, damping, friction, stribeck, spring, offset.",
)
@click.option(
    "--reach",
    metavar="RAD",
    default=pi,
    show_default="pi",
    help="Range to either side of 0 for revolute joints without position limits.",
)
@click.option("--margin", default=0.01, help="Share of each limit that is left.")
@click.option("--payload", is_flag=True, help="Determine a load, for `jounce payload`, instead of the robot itself.")
@click.option("--body", metavar="NAME", help="Body or link that carries the load of --payload; default: the last body.")
@click.option("--starts", metavar="N", default=5, help="Number of random starts.")
@click.option("--seed", default=0, help="Seed of the random starts.")
@click.option("--step", type=float, metavar="S", help="Time between rows in s; default: 1 ms.")
@click.option("--picture", type=PATH, help="Ratios to all limits over time: .png, .svg or .pdf.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def excite(
    robot: RobotRequest,
    limits: Path | None,
    output: Path,
    terms: str | None,
    payload: bool,
    body: str | None,
    step: float | None,
    picture: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Find the Fourier series of the joints of ROBOT that determines its parameters best, within all limits.

    It starts and ends at rest, so that it may be repeated. ROBOT needs limits: its own, or --limits.
    """
    from jounce.figures import canvas
    from jounce.io import files, tables
    from jounce.io.entries import DOCUMENT_SUFFIXES
    from jounce.io.motions import terms as analytic

    if body is not None and not payload:
        raise JounceError(f"--body {quote_value(body)} needs --payload: it names the body that carries the load")
    in_terms = output.suffix.lower() in DOCUMENT_SUFFIXES
    (files if in_terms else tables).check_writable(output)
    check_distinct(output, robot.path, limits)
    if picture is not None:
        canvas.check_writable(picture)
    arm = load_robot(robot, limits)
    columns = False if terms is None else parse_drive_terms(terms)
    with stage("starts of the search") as show:
        found = arm.excite(drives=columns, payload=payload and (body or True), progress=show, **options)
    motion = found.motion if step is None else found.motion.with_step(step)
    if in_terms:
        analytic.write(output, motion, arm.joint_names)
    else:
        write_motion(output, motion, arm.joint_names)
    if picture is not None:
        draw_ratios(arm, motion, picture)

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "source": motion.source, "duration": motion.duration,
            "criterion": found.criterion, "condition": found.condition,
            "parameters": list(found.parameters), "unseen": list(found.unseen),
            "limits": [vars(row) | {"violations": list(row.violations)} for row in found.limits],
            "notes": list(found.notes), "output": str(output), "picture": None if picture is None else str(picture),
            "states": len(motion.times),
        }  # fmt: skip

    def lines() -> list[str]:
        drawn = f", ratios to limits drawn to {picture}" if picture else ""
        what = "series" if in_terms else f"{len(motion.times)} rows"
        return [f"{shorten(arm.name)}: {what} written to {output}{drawn}", *str(found).splitlines()]

    print_result(lines, data, as_json)
