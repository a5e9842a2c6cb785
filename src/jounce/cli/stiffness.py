"""`jounce stiffness`: the stiffness of elastic joints from a log of motors and links, to a robot file."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.identify import collect_notes, print_identification
from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options
from jounce.cli.motors import values_by_joint
from jounce.cli.output import check_distinct
from jounce.cli.robot_options import PATH, RobotRequest
from jounce.cli.robot_options import add_robot_options_without_drives as add_robot_options
from jounce.core.errors import JounceError

if TYPE_CHECKING:
    from jounce.motion import Motion
    from jounce.robot import Robot

IRRELEVANT_NOTES = ("other columns", "derivatives are trustworthy")  # each motion has columns of the other

EPILOG = """\b
Example, of motors and links along a motion, as in a log:
  jounce motors iiwa14 paper --stiffness 9000 --rotor 1e-6 --rates -o log.csv
  jounce stiffness iiwa14 log.csv --motors {joint}.theta --rotor 1 -o k.yaml

\b
MOTION is a log of links and motors, at the same times: a table as `jounce
identify` reads it, with a column of the position of each motor. Torques are
those that the springs carry, as sensors behind the gears measure them; those
of the model serve at joints without a column. OUT is a robot with elastic
joints for `jounce motors`.
"""


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="Identify the stiffness of elastic joints from a log.")
@add_robot_options
@add_motion_options
@click.option("-o", "--output", required=True, type=PATH, help="Robot file to write: .yaml or .json.")
@click.option(
    "--motors", "pattern", default="theta_{joint}", metavar="PATTERN", help="Names of the columns of motor positions."
)
@click.option(
    "--gear",
    multiple=True,
    metavar="[JOINT=]N",
    help="Motor over joint speed, where columns are angles of motors in front of gears; may be repeated.",
)
@click.option(
    "--rotor",
    multiple=True,
    metavar="[JOINT=]B",
    help="Inertia of the rotors seen from the links in kg m^2 or kg, if ROBOT states none; may be repeated.",
)
@click.option(
    "--delay", type=float, metavar="S", help="By how much torques come after positions; default: found, if certain."
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def stiffness(
    robot: RobotRequest,
    motion: MotionRequest,
    output: Path,
    pattern: str,
    gear: Sequence[str],
    rotor: Sequence[str],
    delay: float | None,
    as_json: bool,
) -> None:
    """Identify the stiffness of the joints of ROBOT from MOTION, a log of positions of motors and links."""
    from jounce.robot import saving

    saving.check_writable(output)
    check_distinct(output, motion.path, robot.path, motion.read)
    arm = robot.load()
    gears, rotors = (values_by_joint(*given, arm.joint_names) for given in (("--gear", gear), ("--rotor", rotor)))
    links = motion.load(arm, 0)
    motors = _load_motors(motion, arm, pattern)
    found = collect_notes(lambda: arm.identify_stiffness(links, motors, gear=gears or 1.0, rotor=rotors, delay=delay))
    saving.save(found.robot, output)
    notes = dict.fromkeys(note for note in (*links.notes, *motors.notes) if not note.startswith(IRRELEVANT_NOTES))
    print_identification(found, motion.path, tuple(notes), output, as_json)


def _load_motors(motion: MotionRequest, arm: "Robot", pattern: str) -> "Motion":
    """The motion of the motors, of which no rates are taken.

    Motors in front of gears turn far without being in degrees: angles without a unit are in rad, and are compared with
    those of the links later.
    """
    options = motion.options | {"columns": pattern, "allow_noise": True}
    if options["angles"] is None:
        try:
            return replace(motion, options=options | {"angles": "rad"}).load(arm, 0)
        except JounceError:
            pass  # columns may state their unit, and what else is wrong is said below
    try:
        return replace(motion, options=options).load(arm, 0)
    except JounceError as error:
        raise JounceError(str(error).replace("--columns", "--motors")) from None
