"""`jounce run`: the drive forces and their rates along a motion, from table to table."""

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import print_summary
from jounce.cli.robot_options import RobotRequest, add_robot_options
from jounce.cli.summaries import (
    OUTPUT,
    StreamRequest,
    add_stream_options,
    compute_results,
    results_in_words,
    tabulate_largest,
)

if TYPE_CHECKING:
    from jounce.robot import Robot

EPILOG = """\b
Example, the robot and the motion of the paper:
  jounce run iiwa14 paper -o forces.csv

\b
MOTION is a table with a column t and, matched by joint name in any order,
  either one column per joint    samples; rates come from a spline
  or NAME.q, NAME.qd, NAME.q2d,  used unchanged; order 2 needs q to q4d,
     NAME.q3d, NAME.q4d          order 0 needs q to q2d
  of balls, planar and free joints NAME.qx, ..., with rates NAME.qxd, ... or
     velocities NAME.wx, ...
and, if wrenches act, BODY.mx .. BODY.fz: the wrench that the body exerts, in
  its own axes, as samples or with rates BODY.fxd, BODY.fx2d ...
or a YAML file with analytic terms for each joint, whose rates are exact:
  time: {start: 0, stop: 5, count: 1001}
  joints:
    joint1: {offset: 0.5, cosines: [{amplitude: 1, frequency: 2, phase: 0}]}
    joint2: {polynomial: [0, 0.1, 0.2]}

\b
OUT holds t and NAME.Q, NAME.Qd, NAME.Q2d, with all their digits; with --base
floating base.mx.Q .. base.fz.Q too, the wrench on the base; of smoothed
samples NAME.Q_sd, ... too, their standard deviations. The largest values are
printed with theirs (±) and their times; values that do not stand out of their
band of 95 % are no candidates, and one in an uncertain end of a log has a *
and the largest certain one below. A line per joint states the vibration that
the samples would not show. OUT has a column break, if Q or a
rate of it jumps: the order of what jumps since the row before, else -1.

\b
MOTION may be a folder of tables, or one whose column motion names the motion
of each row, of any size: they are read by parts, in bounded memory, and the
same command continues a run that was stopped.
"""


@click.command(
    cls=MotionCommand, epilog=EPILOG, short_help="Compute Q, Qd, Q2d along a motion and write them as a table."
)
@add_robot_options
@add_motion_options
@OUTPUT
@click.option("--order", default=2, type=click.IntRange(0), help="Highest time derivative of Q.")
@click.option("--rates", "with_rates", is_flag=True, help="Write q, qd, ... too.")
@click.option(
    "--method", default=None, help="Method: kernel (native code, the default), recursion, closed_form or paper."
)
@add_stream_options
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def run(
    robot: RobotRequest,
    motion: MotionRequest,
    output: Path,
    order: int,
    with_rates: bool,
    method: str | None,
    stream: StreamRequest,
    as_json: bool,
) -> None:
    """Compute Q, Qd, Q2d along MOTION for ROBOT, a file or the name of a bundled robot."""
    from jounce.stream.job import Job
    from jounce.stream.whole_run import table_suffix

    arm = robot.load()
    form = None if stream.reduce else table_suffix(output)
    job = Job("forces", arm, order, stream.reading(motion), form, method, with_rates)
    found, summary = compute_results(job, motion, output, stream, "inverse dynamics", lambda: motion.load(arm, order))
    worst, name = max((of["broken"], name) for name, of in found.aggregates.items())
    summary |= {"order": order, "broken_limit": _limit(worst, name, arm) if worst else None}
    print_summary(summary, _format_summary, as_json)


def _limit(worst: list[Any], motion: str, robot: "Robot") -> dict[str, Any]:
    """The limit that is broken most at the rows, as plain data."""
    from jounce.model.positions import extent_names

    ratio, kind, joint, t = worst
    return {
        "motion": motion,
        "joint": (extent_names(robot.mechanism) if kind == "position" else robot.joint_names)[joint],
        "limit": kind,
        "t": t,
        "ratio": ratio if isfinite(ratio) else None,
    }


def _limit_in_words(found: dict[str, Any] | None) -> list[str]:
    if found is None:
        return []
    ratio = "infinitely" if found["ratio"] is None else f"{found['ratio']:.4g} times"
    came = f"{found['limit'].replace('_', ' ')} of {found['joint']} at t = {found['t']:.6g} s"
    return [f"limit broken: {came} is {ratio} its limit; jounce check lists all limits"]


def _format_summary(summary: dict[str, Any]) -> str:
    names = list(next(iter(summary["peaks"].values())))
    return results_in_words(summary, names, tabulate_largest(summary), *_limit_in_words(summary["broken_limit"]))
