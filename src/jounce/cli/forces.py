"""`jounce run`, `motors` and `live`: forces of joints, or of the motors behind them, from table to table.

`run` computes the drive forces and their rates. `motors` computes positions, velocities and torques of the motors
behind elastic joints. Both write rows, of a motion as a whole or by parts (`compute_rows`), and sum up the largest
values of all motions, with their deviations and times, as JSON (`results_json`) or in words (`results_in_words`).
`live` estimates rates, forces and broken limits of samples as they come, a row each.
"""

import csv
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from itertools import chain, islice, pairwise
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from jounce.cli.limits import LIMITS, load_robot
from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import align_columns, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options, values_by_joint
from jounce.cli.summaries import (
    MAX_NOTES_SHOWN,
    LargestValues,
    RunRequest,
    StreamRequest,
    add_stream_options_without_reduce,
    common_json,
    format_with_deviation,
    hidden_in_words,
    notes_in_words,
)
from jounce.core.errors import JounceError, join_names, shorten, warn
from jounce.core.progress import stage

if TYPE_CHECKING:
    import numpy as np

    from jounce.core.typing import JsonObject
    from jounce.engine.along import DescribedBreak
    from jounce.live.estimator import LiveRates
    from jounce.motion import Motion
    from jounce.robot import Robot
    from jounce.stream.jobs import MotionResult, RowJob
    from jounce.stream.run import RunSummary


OUTPUT = click.option("-o", "--output", required=True, type=PATH, help="Output: .csv, .npz, .parquet, or a folder.")
REDUCE = click.option(
    "--reduce", metavar="KINDS", help="Write aggregates per motion and joint instead of rows: peak, rms, or peak,rms."
)
MAX_BREAKS_SHOWN = 4  # as of notes: --json has all


def add_stream_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Add --reduce and --cluster to a command, which gets them as one `stream`, an `StreamRequest`."""
    return REDUCE(add_stream_options_without_reduce(verb))


RUN_EPILOG = """\b
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
    cls=MotionCommand, epilog=RUN_EPILOG, short_help="Compute Q, Qd, Q2d along a motion and write them as a table."
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
    print_result(lambda: _run_lines(request, found, broken), lambda: _run_json(request, found, broken), as_json)


class WorstRow(NamedTuple):
    """The limit that the rows of all motions break most."""

    motion: str
    joint: str
    limit: str
    t: float
    ratio: float


def _find_broken(found: "RunSummary", robot: "Robot") -> WorstRow | None:
    from jounce.model import positions

    broken = [(of.broken, name) for name, of in found.results.items() if of.broken]
    if not broken:
        return None
    worst, motion = max(broken)
    names = positions.extent_names(robot.mechanism) if worst.kind == "position" else robot.joint_names
    return WorstRow(motion, names[worst.joint], worst.kind, worst.t, worst.ratio)


def _run_json(request: RunRequest, found: "RunSummary", broken: WorstRow | None) -> "JsonObject":
    of_limit = None if broken is None else broken._asdict()
    return results_json(request, found) | {"order": request.job.order, "broken_limit": of_limit}


def _run_lines(request: RunRequest, found: "RunSummary", broken: WorstRow | None) -> list[str]:
    values = find_largest_values(request, found)
    names = list(next(iter(values.largest.values())))
    more = []
    if broken is not None:
        ratio = f"{broken.ratio:.4g} times" if isfinite(broken.ratio) else "infinitely"
        came = f"{broken.limit.replace('_', ' ')} of {broken.joint} at t = {broken.t:.6g} s"
        more = [f"limit broken: {came} is {ratio} its limit; jounce check lists all limits"]
    return results_in_words(request, found, names, values.table(len(found.results) > 1), *more)


def compute_rows(request: RunRequest, job: "RowJob", output: Path, load: "Callable[[], Motion]") -> "RunSummary":
    """Compute the rows of a job of a motion that is loaded as a whole, or by parts, and write them."""
    from jounce.stream.run import run_motion

    if request.is_by_parts:
        return request.run_by_parts()

    def compute() -> "RunSummary":
        with stage(request.label) as show:
            return run_motion(job, load(), request.motion.path.stem, output, show)

    return request.run_whole(compute)


def find_largest_values(request: RunRequest, found: "RunSummary") -> LargestValues:
    """The largest values of all motions of a run."""
    from jounce.io.motions import writing

    unit = writing.table_metadata(request.job.robot.mechanism, request.job.order).unit
    return LargestValues.of({name: of.peaks for name, of in found.results.items()}, unit)


def results_json(request: RunRequest, found: "RunSummary") -> "JsonObject":
    """What the JSON of commands that write rows says, with the largest values of all motions."""
    values, motions = find_largest_values(request, found), found.results
    largest = {joint: {name: peak for name, (_, peak) in of.items()} for joint, of in values.largest.items()}
    breaks = [(name, at) for name, of in motions.items() for at in of.facts.breaks]
    return common_json(request, found) | {
        "source": _sources(found),
        "residual": _largest_residual(motions),
        "blend": request.motion.blend,
        "breaks": [_break_json(at) | {"motion": name} for name, at in breaks],
        "reduced": list(request.stream.reduce),
        "peaks": {joint: {name: peak.value for name, peak in of.items()} for joint, of in largest.items()},
        "deviations": {joint: {name: peak.deviation for name, peak in of.items()} for joint, of in largest.items()},
        **values.json(),
    }


def _break_json(found: "DescribedBreak") -> "JsonObject":
    return asdict(found) | {"causes": {joint: cause._asdict() for joint, cause in found.causes.items()}}


def _sources(found: "RunSummary") -> str:
    return "; ".join(list(dict.fromkeys(of.facts.source for of in found.results.values()))[:MAX_NOTES_SHOWN])


def _largest_residual(motions: "Mapping[str, MotionResult]") -> float | None:
    return max((of.facts.residual for of in motions.values() if of.facts.residual is not None), default=None)


def results_in_words(
    request: RunRequest, found: "RunSummary", names: Sequence[str], table: Sequence[str], *more: str
) -> list[str]:
    """What is computed of rows, with further lines and a table of the largest values."""
    robot, (first, last), count = shorten(request.job.robot.name), request.span(found), len(found.results)
    many = f" in {count} motions" if count > 1 else ""
    kind = "at most {:.2g} from it" if request.motion.blend else "largest residual {:.2g}"
    largest = _largest_residual(found.results)
    residual = "" if largest is None else f", {kind.format(largest)}"
    kinds = f"{', '.join(request.stream.reduce)} of " if request.stream.reduce else ""
    return [
        f"{robot} along {request.motion.path}: {found.rows} states{many}, t = {first:g} .. {last:g} s",
        _sources(found) + residual,
        *notes_in_words(request, found),
        *breaks_in_words([at for of in found.results.values() for at in of.facts.breaks]),
        *more,
        f"{kinds}{', '.join(names)} written to {request.output}",
        "",
        *table,
        *hidden_in_words([one for of in found.results.values() for one in of.facts.hidden]),
    ]


def breaks_in_words(breaks: "Sequence[DescribedBreak]") -> list[str]:
    """Describe the first breaks, one per line, and the number of all."""
    lines = []
    for found in breaks[:MAX_BREAKS_SHOWN]:
        joints: dict[str, list[str]] = {}
        for joint, cause in found.causes.items():
            joints.setdefault(cause.rate, []).append(joint)
        causes = " and ".join(f"{rate} of {join_names(names)}" for rate, names in joints.items()) or "a contact's limit"
        missing = found.missing
        then = [f"{found.jumps} jumps"] if found.jumps else []
        then += [f"{', '.join(missing)} do{'es' * (len(missing) == 1)} not exist"] if missing else []
        lines.append(f"break at t = {found.t:.9g} s: {causes} jumps; {', '.join(then)}")
    rest = len(breaks) - MAX_BREAKS_SHOWN
    if rest > 0:
        lines.append(f"and {rest} more break{'s' * (rest > 1)}; --json lists them, --blend replaces them")
    return lines


MOTOR_FORCE_ORDER = 2  # rates of Q that motor torques need: tau = B theta2d + Q, theta = q + Q / K
MOTORS_EPILOG = """\b
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
    cls=MotionCommand,
    epilog=MOTORS_EPILOG,
    short_help="Positions and torques of the motors of elastic joints along a motion.",
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
    print_result(lambda: _motors_lines(request, found), lambda: results_json(request, found), as_json)


def _motors_lines(request: RunRequest, found: "RunSummary") -> list[str]:
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


FIRST_ROWS = 20  # whose median spacing is dt, unless it is given
EXIT_ROWS_LEFT_OUT = 3  # what is written is not all that was asked for, as an undecided check is
LIVE_COLUMNS = ("q", "qd", "q2d", "q3d", "q4d", "Q", "Qd", "Q2d", "Q_sd", "Qd_sd", "Q2d_sd")
LIVE_EPILOG = """\b
Example, a motion as it would come from a robot:
  jounce motion iiwa14 paper --step 0.002 -o samples.csv
  jounce live iiwa14 samples.csv --limits iiwa14

\b
SAMPLES has a column t and one per joint, or NAME.q. Each row gives one of t,
NAME.q .. NAME.q4d, NAME.Q, NAME.Qd, NAME.Q2d, their deviations NAME.Q_sd ...,
whether all joints are trusted, and the limits that are broken by more than
two deviations. Without a lag Q2d serves no feedback; a Q2d that is smaller
than its deviation is left empty. Rows that cannot be used are left out with a
warning, and the exit code is 3 then. Three rows in a row whose times are not
after the last one, but increase, start a new clock.
"""


@click.command(epilog=LIVE_EPILOG, short_help="Rates, forces and broken limits of samples as they come.")
@add_robot_options
@click.argument("samples", type=click.Path(path_type=Path, allow_dash=True), default="-")
@LIMITS
@click.option("--dt", type=float, metavar="S", help="Spacing of samples; default: that of the first rows.")
@click.option("--bandwidth", type=float, metavar="HZ", help="Bandwidth of the motion; default: the likeliest of nine.")
@click.option("--lag", type=float, default=0.02, metavar="S", help="Time by which rates are behind the samples.")
@click.option("--columns", metavar="PATTERN", help="Names of the joints' columns, such as 'q_{joint}'.")
@click.option("--follow", is_flag=True, help="Wait at the end of a file, and go on as it grows.")
@click.option("--json", "as_json", is_flag=True, help="Write a JSON object per row.")
def live(
    robot: RobotRequest,
    samples: Path,
    limits: Path | None,
    dt: float | None,
    bandwidth: float | None,
    lag: float,
    columns: str | None,
    follow: bool,
    as_json: bool,
) -> None:
    """Estimate rates and forces of ROBOT from SAMPLES as they come, CSV or JSON lines of a file or a pipe (-)."""
    from jounce.live.estimator import LiveRates
    from jounce.live.samples import read_lines, read_samples

    arm = load_robot(robot, limits)
    with click.open_file(str(samples), encoding="utf-8-sig") as source:
        rows = read_samples(read_lines(source, follow and str(samples) != "-"), arm.mechanism, columns)
        first = list(islice(rows, FIRST_ROWS if dt is None else 0))
        if dt is None:
            dt = _usual_spacing([t for t, _ in first])
        left_out = _write_live_rows(arm, LiveRates(arm, dt, bandwidth, lag), chain(first, rows), as_json)
    if left_out:
        warn("1 row is left out" if left_out == 1 else f"{left_out} rows are left out")
        raise SystemExit(EXIT_ROWS_LEFT_OUT)


def _usual_spacing(times: list[float]) -> float:
    """The median spacing of the first rows, without those whose time does not increase, which are left out."""
    spacings = sorted(later - before for before, later in pairwise(times) if later > before)
    if not spacings:
        came = "fewer than two rows of samples"
        if len(times) > 1:
            came = f"the stamps of the first {len(times)} rows do not increase: {times[0]} and {times[1]} s"
        raise JounceError(f"{came}; state the spacing of samples by --dt")
    return spacings[len(spacings) // 2]


def _write_live_rows(arm: "Robot", live: "LiveRates", rows: "Iterable[tuple[float, np.ndarray]]", as_json: bool) -> int:
    """Write a row per sample; return how many are left out."""
    from jounce.live.forces import find_broken, judged_limits

    judged = judged_limits(arm)
    if left := [kind.replace("_", " ") for kind in judged.limits.kinds if kind not in judged.kinds]:
        warn(f"limits of {join_names(left)} are not judged live; jounce check judges them")
    names = [f"{joint}.{name}" for name in LIVE_COLUMNS for joint in arm.joint_names]
    table = csv.writer(sys.stdout, lineterminator="\n")
    if not as_json:
        table.writerow(["t", *names, "trusted", "broken"])
    live.forces()  # compiles its code before samples come
    left_out = 0
    for t, q in rows:
        if not isfinite(t):
            left_out += 1
            continue
        try:
            rates = live.update(q, t)
        except JounceError as error:
            warn(str(error))
            left_out += 1
            continue
        if not isfinite(live.t):  # before the first sample
            continue
        forces, deviations = live.forces(), live.deviations
        broken = find_broken(arm, judged, rates, deviations, forces)
        parts = (*rates, *forces[:3], *forces.deviations)
        numbers = [x if isfinite(x) else None for part in parts for x in part.tolist()]
        trusted = bool(live.trust.good.all())
        if as_json:
            values = {"t": live.t, **dict(zip(names, numbers, strict=True)), "trusted": trusted}
            sys.stdout.write(json.dumps(values | {"broken": [found._asdict() for found in broken]}) + "\n")
        else:
            said = "; ".join(f"{found.limit.replace('_', ' ')} of {found.joint}" for found in broken)
            table.writerow([live.t, *numbers, int(trusted), said])
        sys.stdout.flush()
    return left_out
