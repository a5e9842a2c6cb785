"""`jounce payload`: mass, centre of mass and inertia of a load, from logs with it and without it."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.identify import DEFAULT, collect_notes
from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import check_distinct, print_result
from jounce.cli.robot_options import MOTION_NAME, PATH, RobotRequest, parse_drive_terms
from jounce.cli.robot_options import add_robot_options_without_drives as add_robot_options

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject
    from jounce.identification import Payload

EPILOG = """\b
Example, with the torques of a model as measured ones, hence no load:
  jounce run iiwa14 paper --order 0 --rates -o log.csv
  jounce payload iiwa14 log.csv --torques '{joint}.Q'

\b
MOTION is a log with the load, WITHOUT one of the same robot without it, both
tables as `jounce identify` reads them; `jounce excite --payload` finds their
motion. Without a second log ROBOT is taken as it is: the file that
`jounce identify` wrote. The load is described in the frame of its body or
link: name the flange by --body, and the last lines are what a Franka, a UR
and an iiwa take. Deviations are those of the logs; column "body" holds the
nearest body that can exist.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="Identify the payload of a robot from logs.")
@add_robot_options
@add_motion_options
@click.argument("without", type=MOTION_NAME, required=False)
@click.option("-o", "--output", type=PATH, help="Robot file with the load to write: .yaml or .json.")
@click.option("--body", metavar="NAME", help="Body or link that carries the load; default: the last body.")
@click.option(
    "--drives",
    "terms",
    default=DEFAULT,
    metavar="TERMS",
    help="Drive terms that each log has its own of: all, none, or a list as of `jounce identify`.",
)
@click.option("--mass", type=float, metavar="KG", help="Known mass of the load: calibrate torques by it, per joint.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def payload(
    robot: RobotRequest,
    motion: MotionRequest,
    without: Path | None,
    output: Path | None,
    body: str | None,
    terms: str,
    mass: float | None,
    as_json: bool,
) -> None:
    """Identify the load that ROBOT carries in MOTION, a log with measured torques, and not in the log WITHOUT."""
    from jounce.robot import saving

    if output is not None:
        saving.check_writable(output)
        check_distinct(output, motion.path, without, robot.path, motion.read)
    arm = robot.load()
    logs = [log.load(arm, 0) for log in (motion, *([replace(motion, path=without)] if without else []))]
    found = collect_notes(lambda: arm.payload(*logs, body=body, drives=parse_drive_terms(terms), mass=mass))
    if output is not None:
        saving.save(found.robot, output)
    written = [] if output is None else ["", f"robot written to {output}"]
    lines = [*str(found).splitlines(), *written]
    print_result(lambda: lines, lambda: _json(found, motion.path, without, output), as_json)


def _json(found: "Payload", log: Path, without: Path | None, output: Path | None) -> "JsonObject":

    def pair(what: str, x: float, spread: float) -> dict[str, float]:
        return {what: float(x), "deviation": float(spread)}

    names = found.robot.joint_names
    of_joints = found.factors and zip(names, *(x[-len(names) :] for x in found.factors), strict=True)
    return {
        "robot": found.robot.name, "motion": str(log), "without": without and str(without),
        "output": output and str(output), "frame": found.frame, "mass": found.mass, "com": found.com.tolist(),
        "inertia": found.inertia.tolist(),
        "parameters": [asdict(row) for row in found.table],
        "unseen": list(found.unseen), "mismatch": found.mismatch,
        "factors": of_joints and {name: pair("value", c, s) for name, c, s in of_joints},
        "halves": [pair("mass", m, s) for m, s in found.halves], "settings": found.settings, "notes": list(found.notes),
        "assumed": found.assumption,
    }  # fmt: skip
