"""`jounce motors`: positions, velocities and torques of the motors behind elastic joints along a motion."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import align_columns, print_result
from jounce.cli.robot_options import RobotRequest, add_robot_options
from jounce.cli.summaries import (
    OUTPUT,
    RunRequest,
    StreamRequest,
    add_stream_options,
    compute_rows,
    find_largest_values,
    format_with_deviation,
    results_in_words,
    results_json,
)
from jounce.core.errors import JounceError, quote_value

if TYPE_CHECKING:
    from jounce.stream.run import RunSummary

MOTOR_FORCE_ORDER = 2  # rates of Q that motor torques need: tau = B theta2d + Q, theta = q + Q / K

EPILOG = """\b
Example:
  jounce motors iiwa14 paper --stiffness 10000 --rotor 0.5 -o motors.csv

\b
OUT holds t and, seen from the links,
  NAME.theta, NAME.thetad  position and velocity of a motor: rad or m, per s
  NAME.tau                 its torque: N m, or N
  NAME.i, NAME.u           its current and voltage, A and V, if the file
                           states constant, resistance and inductance
and the standard deviations NAME.tau_sd, if the motion is smoothed. A joint
with two motors has NAME_1 and NAME_2. A column break marks times at which tau
jumps or does not exist, as in the output of jounce run.

\b
The motion needs q to q4d. A rotor's inertia is that seen from the link: its
own times the gear ratio squared; the default is the armature of the file.
Damping and friction that --drives selects act on the motors.
"""


@click.command(
    cls=MotionCommand, epilog=EPILOG, short_help="Positions and torques of the motors of elastic joints along a motion."
)
@add_robot_options
@add_motion_options
@click.option(
    "--stiffness",
    multiple=True,
    metavar="[JOINT=]K",
    help="Stiffness of the springs in N m/rad or N/m: of all joints, or of one; may be repeated. Default: the file's.",
)
@click.option(
    "--rotor",
    multiple=True,
    metavar="[JOINT=]B",
    help="Inertia of the rotors seen from the links in kg m^2 or kg: of all joints, or of one; may be repeated.",
)
@OUTPUT
@click.option("--rates", "with_rates", is_flag=True, help="Write q, qd, ... of the links too.")
@add_stream_options
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def motors(
    robot: RobotRequest,
    motion: MotionRequest,
    stiffness: Sequence[str],
    rotor: Sequence[str],
    output: Path,
    with_rates: bool,
    stream: StreamRequest,
    as_json: bool,
) -> None:
    """Compute positions, velocities and torques of the motors of ROBOT, whose joints are elastic, along MOTION."""
    from jounce.stream.jobs import MotorJob
    from jounce.stream.run import table_suffix

    links = robot.load()
    arm = links.elastic(
        values_by_joint("--stiffness", stiffness, links.joint_names),
        values_by_joint("--rotor", rotor, links.joint_names),
    )
    form = None if stream.reduce else table_suffix(output)
    job = MotorJob(arm, stream.reading(motion), form, with_rates=with_rates)
    request = RunRequest(job, motion, output, stream, "motors")
    found = compute_rows(request, job, output, lambda: motion.load(arm, MOTOR_FORCE_ORDER))
    print_result(lambda: _lines(request, found), lambda: results_json(request, found), as_json)


def values_by_joint(option: str, given: Sequence[str], joints: Sequence[str]) -> dict[str, float] | None:
    """The numbers of an option by joint: VALUE is of all joints, JOINT=VALUE of one; None without any."""
    from jounce.core.foreign import parse_finite

    found: dict[str, float] = {}
    named: dict[str, float] = {}
    for text in given:
        name, _, value = text.rpartition("=")
        number = parse_finite(value)
        if number is None:
            raise JounceError(f"{option} {quote_value(text)}; expected a number, or JOINT=NUMBER")
        if name in named or (not name and found):
            raise JounceError(
                f"{option} {quote_value(text)} is the second for {quote_value(name) if name else 'all joints'}"
            )
        if name:
            named[name] = number
        else:
            found = dict.fromkeys(joints, number)
    return (found | named) or None


def _lines(request: RunRequest, found: "RunSummary") -> list[str]:
    values = find_largest_values(request, found)
    symbols = list(dict.fromkeys(symbol for peaks in values.largest.values() for symbol in peaks))
    rows: list[tuple[str, ...]] = [("largest", *symbols)]
    for name, peaks in values.largest.items():
        cells = {
            symbol: f"{format_with_deviation(peak.value, peak.deviation)} {values.units[name][symbol]}"
            for symbol, (_, peak) in peaks.items()
        }
        rows.append((name, *(cells.get(symbol, "-") for symbol in symbols)))
    return results_in_words(request, found, symbols, align_columns(rows))
