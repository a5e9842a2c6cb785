"""`jounce run`: the drive forces and their rates along a motion, from table to table."""

from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import print_result
from jounce.cli.robot_options import RobotRequest, add_robot_options
from jounce.cli.summaries import (
    OUTPUT,
    RunRequest,
    StreamRequest,
    add_stream_options,
    compute_rows,
    find_largest_values,
    results_in_words,
    results_json,
)

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject
    from jounce.robot import Robot
    from jounce.stream.run import RunSummary

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
    from jounce.stream.jobs import ForceJob
    from jounce.stream.run import table_suffix

    arm = robot.load()
    form = None if stream.reduce else table_suffix(output)
    job = ForceJob(arm, stream.reading(motion), form, order, method, with_rates)
    request = RunRequest(job, motion, output, stream, "inverse dynamics")
    found = compute_rows(request, job, output, lambda: motion.load(arm, order))
    broken = _find_broken(found, arm)
    print_result(lambda: _lines(request, found, broken), lambda: _json(request, found, broken), as_json)


class WorstRow(NamedTuple):
    """The limit that the rows of all motions break most."""

    motion: str
    joint: str
    limit: str
    t: float
    ratio: float


def _find_broken(found: "RunSummary", robot: "Robot") -> WorstRow | None:
    from jounce.model.positions import extent_names

    broken = [(of.broken, name) for name, of in found.results.items() if of.broken]
    if not broken:
        return None
    worst, motion = max(broken)
    names = extent_names(robot.mechanism) if worst.kind == "position" else robot.joint_names
    return WorstRow(motion, names[worst.joint], worst.kind, worst.t, worst.ratio)


def _json(request: RunRequest, found: "RunSummary", broken: WorstRow | None) -> "JsonObject":
    of_limit = None if broken is None else broken._asdict()
    return results_json(request, found) | {"order": request.job.order, "broken_limit": of_limit}


def _lines(request: RunRequest, found: "RunSummary", broken: WorstRow | None) -> list[str]:
    values = find_largest_values(request, found)
    names = list(next(iter(values.largest.values())))
    more = []
    if broken is not None:
        ratio = f"{broken.ratio:.4g} times" if isfinite(broken.ratio) else "infinitely"
        came = f"{broken.limit.replace('_', ' ')} of {broken.joint} at t = {broken.t:.6g} s"
        more = [f"limit broken: {came} is {ratio} its limit; jounce check lists all limits"]
    return results_in_words(request, found, names, values.table(len(found.results) > 1), *more)
