"""`jounce run`, `motors` and `live`: forces of joints or motors, from table to table.

`run` computes the drive forces and their rates. `motors` computes positions, velocities and torques of the motors
behind elastic joints. Both write rows, of a motion as a whole or by parts (`compute_rows`), and sum up the largest
values of all motions, with their deviations and times, as JSON (`results_json`) or in words (`results_in_words`).
`live` estimates rates and forces from samples as they come, and writes one row per sample with the broken limits.
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

from jounce.cli.commands import Command, split_names
from jounce.cli.limits import LIMITS, load_robot
from jounce.cli.motion_options import MotionRequest, add_motion_options
from jounce.cli.output import align_columns, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options, values_by_joint
from jounce.cli.summaries import (
    MAX_NOTES_SHOWN,
    VERBOSE,
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


OUTPUT = click.option(
    "-o", "--output", type=PATH,
    help="Output: .csv, .npz, .parquet, or a folder. Default: none, the summary alone is printed.",
)  # fmt: skip
REDUCE = click.option(
    "--reduce", metavar="KINDS", multiple=True, callback=split_names,
    help="Write aggregates per motion and joint instead of rows: peak, rms, or peak,rms.",
)  # fmt: skip
MAX_BREAKS_SHOWN = 4  # more would hide the results; --json lists all


def add_stream_options(verb: Callable[..., None]) -> Callable[..., None]:
    """Add --reduce and --cluster to a command.

    The command receives them as one argument `stream`, a `StreamRequest`.
    """
    return REDUCE(add_stream_options_without_reduce(verb))


RUN_EPILOG = """\b
Example, the robot and the motion of the paper:
  jounce run iiwa14 paper
  jounce run iiwa14 paper -o forces.csv

\b
OUT holds t and NAME.Q, NAME.Qd, NAME.Q2d, with all digits. With --base
floating it also holds base.mx.Q .. base.fz.Q, the wrench on the base. For
smoothed samples it also holds NAME.Q_sd, ..., the standard deviations.
If Q or a derivative jumps, OUT has a column break: the order of the lowest
derivative that jumped since the previous row, or -1.

\b
The largest values are printed with their standard deviations (±) and times.
Maxima smaller than their 95 % uncertainty are omitted. A * marks a maximum
near an end of the log, where it is uncertain; the largest reliable value is
on the next line.
"""


@click.command(
    cls=Command, epilog=RUN_EPILOG, short_help="Compute Q, Qd, Q2d along a motion and write them as a table."
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
@VERBOSE
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def run(
    robot: RobotRequest,
    motion: MotionRequest,
    output: Path | None,
    order: int,
    with_rates: bool,
    method: str | None,
    stream: StreamRequest,
    verbose: bool,
    as_json: bool,
) -> None:
    """Compute Q, Qd, Q2d along MOTION for ROBOT.

    ROBOT is a file or the name of a bundled robot.
    """
    from jounce.stream.jobs import ForceJob

    arm = robot.load()
    form = output_form(output, stream)
    job = ForceJob(arm, stream.reading(motion), form, order, method, with_rates)
    request = RunRequest(job, motion, output, stream, "inverse dynamics", verbose)
    summary = compute_rows(request, job, output, lambda: motion.load(arm, order))
    broken = _find_broken(summary, arm)
    print_result(lambda: _run_lines(request, summary, broken), lambda: _run_json(request, summary, broken), as_json)


class WorstRow(NamedTuple):
    """The limit with the largest ratio among the rows of all motions."""

    motion: str
    joint: str
    limit: str
    t: float
    ratio: float


def _find_broken(summary: "RunSummary", robot: "Robot") -> WorstRow | None:
    """Return the limit that is broken most, or None."""
    from jounce.model import positions

    worst_rows = [(result.broken, name) for name, result in summary.results.items() if result.broken is not None]
    if len(worst_rows) == 0:
        return None
    # Samples are ordered by their ratios.
    worst, motion = max(worst_rows)
    # Positions are limited per extent, of which joints of several screws have more than one.
    names = positions.extent_names(robot.mechanism) if worst.kind == "position" else robot.joint_names
    return WorstRow(motion, names[worst.joint], worst.kind, worst.t, worst.ratio)


def _run_json(request: RunRequest, summary: "RunSummary", broken: WorstRow | None) -> "JsonObject":
    of_limit = None if broken is None else broken._asdict()
    return results_json(request, summary) | {"order": request.job.order, "broken_limit": of_limit}


def _run_lines(request: RunRequest, summary: "RunSummary", broken: WorstRow | None) -> list[str]:
    values = find_largest_values(request, summary)
    names = list(next(iter(values.largest.values())))
    limit_lines = []
    if broken is not None:
        excess = f"{broken.ratio:.4g} times" if isfinite(broken.ratio) else "infinitely"
        limit = f"{broken.limit.replace('_', ' ')} of {broken.joint} at t = {broken.t:.6g} s"
        limit_lines = [f"limit broken: {limit} is {excess} its limit; jounce check lists all limits"]
    return results_in_words(request, summary, names, values.table(len(summary.results) > 1), *limit_lines)


def output_form(output: Path | None, stream: StreamRequest) -> str | None:
    """Return the type of the tables of rows, or None without rows."""
    from jounce.stream.run import table_suffix

    if output is None:
        if len(stream.reduce) > 0:
            raise JounceError("--reduce writes a table of aggregates; give its path with -o")
        return None
    return None if len(stream.reduce) > 0 else table_suffix(output)


def compute_rows(request: RunRequest, job: "RowJob", output: Path | None, load: "Callable[[], Motion]") -> "RunSummary":
    """Compute the rows of a job and write them.

    The motion is loaded as a whole by `load`, or read by parts.
    """
    from jounce.stream.run import run_motion

    if request.is_by_parts:
        return request.run_by_parts()

    def compute() -> "RunSummary":
        with stage(request.label) as show:
            return run_motion(job, load(), request.motion.path.stem, output, show)

    return request.run_whole(compute)


def find_largest_values(request: RunRequest, summary: "RunSummary") -> LargestValues:
    """Return the largest values of all motions of a run."""
    from jounce.io.motions import writing

    unit = writing.table_metadata(request.job.robot.mechanism, request.job.order).unit
    return LargestValues.of({name: result.peaks for name, result in summary.results.items()}, unit)


def results_json(request: RunRequest, summary: "RunSummary") -> "JsonObject":
    """Return the JSON summary of commands that write rows."""
    values, motions = find_largest_values(request, summary), summary.results
    # By joint and quantity, without the names of the motions.
    largest = {joint: {name: peak for name, (_, peak) in peaks.items()} for joint, peaks in values.largest.items()}
    breaks = [(name, described) for name, result in motions.items() for described in result.facts.breaks]
    return common_json(request, summary) | {
        "source": _sources(summary),
        "residual": _largest_residual(motions),
        "blend": request.motion.blend,
        "breaks": [_break_json(described) | {"motion": name} for name, described in breaks],
        "reduced": list(request.stream.reduce),
        "peaks": {joint: {name: peak.value for name, peak in peaks.items()} for joint, peaks in largest.items()},
        "deviations": {
            joint: {name: peak.deviation for name, peak in peaks.items()} for joint, peaks in largest.items()
        },
        **values.json(),
    }


def _break_json(described: "DescribedBreak") -> "JsonObject":
    return asdict(described) | {"causes": {joint: cause._asdict() for joint, cause in described.causes.items()}}


def _sources(summary: "RunSummary") -> str:
    sources = dict.fromkeys(result.facts.source for result in summary.results.values())
    return "; ".join(list(sources)[:MAX_NOTES_SHOWN])


def _largest_residual(motions: "Mapping[str, MotionResult]") -> float | None:
    return max(
        (result.facts.residual for result in motions.values() if result.facts.residual is not None), default=None
    )


def results_in_words(
    request: RunRequest, summary: "RunSummary", names: Sequence[str], table: Sequence[str], *more: str
) -> list[str]:
    """Describe the results of a run, with its largest values.

    The lines `more` stand before the line on the output.
    """
    robot, (first, last), count = shorten(request.job.robot.name), request.span(summary), len(summary.results)
    many = f" in {count} motions" if count > 1 else ""
    # Blends leave the motion on purpose; a fit leaves residuals.
    kind = "at most {:.2g} from it" if request.motion.blend else "largest residual {:.2g}"
    largest = _largest_residual(summary.results)
    residual = "" if largest is None else f", {kind.format(largest)}"
    kinds = f"{', '.join(request.stream.reduce)} of " if request.stream.reduce else ""
    return [
        f"{robot} along {request.motion.path}: {summary.rows} states{many}, t = {first:g} .. {last:g} s",
        _sources(summary) + residual,
        *notes_in_words(request, summary),
        *breaks_in_words([described for result in summary.results.values() for described in result.facts.breaks]),
        *more,
        *([] if request.output is None else [f"{kinds}{', '.join(names)} written to {request.output}"]),
        "",
        *table,
        *hidden_in_words(summary, request.verbose),
    ]


def breaks_in_words(breaks: "Sequence[DescribedBreak]") -> list[str]:
    """Describe the first breaks, one per line, and count the others."""
    lines = []
    for described in breaks[:MAX_BREAKS_SHOWN]:
        # Joints whose same rate jumps are named together.
        joints: dict[str, list[str]] = {}
        for joint, cause in described.causes.items():
            joints.setdefault(cause.rate, []).append(joint)
        causes = " and ".join(f"{rate} of {join_names(names)}" for rate, names in joints.items()) or "a contact's limit"
        missing = described.missing
        effects = []
        if described.jumps:
            effects.append(f"{described.jumps} jumps")
        if len(missing) > 0:
            verb = "does" if len(missing) == 1 else "do"
            effects.append(f"{', '.join(missing)} {verb} not exist")
        lines.append(f"break at t = {described.t:.9g} s: {causes} jumps; {', '.join(effects)}")
    hidden_count = len(breaks) - MAX_BREAKS_SHOWN
    if hidden_count > 0:
        noun = "break" if hidden_count == 1 else "breaks"
        lines.append(f"and {hidden_count} more {noun}; --json lists them, --blend replaces them")
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
The motion needs q to q4d. The rotor inertia is reflected to the link: the
inertia of the rotor times the gear ratio squared. Its default is the armature
in the file. Damping and friction of --drives act on the motors.
"""


@click.command(
    cls=Command,
    epilog=MOTORS_EPILOG,
    short_help="Torques of the motors of elastic joints along a motion.",
)
@add_robot_options
@add_motion_options
@click.option(
    "--stiffness",
    multiple=True,
    metavar="[JOINT=]K",
    help="Stiffness of all joints, or of one, in N m/rad or N/m. Repeatable. Default: the stiffness in the file.",
)
@click.option(
    "--rotor",
    multiple=True,
    metavar="[JOINT=]B",
    help="Rotor inertia of all joints, or of one, reflected to the link, in kg m^2 or kg. Repeatable.",
)
@OUTPUT
@click.option("--rates", "with_rates", is_flag=True, help="Write q, qd, ... of the links too.")
@add_stream_options
@VERBOSE
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def motors(
    robot: RobotRequest,
    motion: MotionRequest,
    stiffness: Sequence[str],
    rotor: Sequence[str],
    output: Path | None,
    with_rates: bool,
    stream: StreamRequest,
    verbose: bool,
    as_json: bool,
) -> None:
    """Compute positions and torques of the motors of elastic joints along MOTION."""
    from jounce.stream.jobs import MotorJob

    links = robot.load()
    arm = links.elastic(
        values_by_joint("--stiffness", stiffness, links.joint_names),
        values_by_joint("--rotor", rotor, links.joint_names),
    )
    form = output_form(output, stream)
    job = MotorJob(arm, stream.reading(motion), form, with_rates=with_rates)
    request = RunRequest(job, motion, output, stream, "motors", verbose)
    summary = compute_rows(request, job, output, lambda: motion.load(arm, MOTOR_FORCE_ORDER))
    print_result(lambda: _motors_lines(request, summary), lambda: results_json(request, summary), as_json)


def _motors_lines(request: RunRequest, summary: "RunSummary") -> list[str]:
    """Describe the results of a run of motors, with its largest values."""
    values = find_largest_values(request, summary)
    symbols = list(dict.fromkeys(symbol for peaks in values.largest.values() for symbol in peaks))
    rows: list[tuple[str, ...]] = [("largest", *symbols)]
    for name, peaks in values.largest.items():
        cells = {
            symbol: f"{format_with_deviation(peak.value, peak.deviation)} {values.units[name][symbol]}"
            for symbol, (_, peak) in peaks.items()
        }
        rows.append((name, *(cells.get(symbol, "-") for symbol in symbols)))
    return results_in_words(request, summary, symbols, align_columns(rows))


FIRST_ROWS = 20  # their median spacing is the default of --dt
EXIT_ROWS_LEFT_OUT = 3  # the output is incomplete; an undecided check ends with the same code
LIVE_COLUMNS = ("q", "qd", "q2d", "q3d", "q4d", "Q", "Qd", "Q2d", "Q_sd", "Qd_sd", "Q2d_sd")
LIVE_EPILOG = """\b
Example, a motion as it would come from a robot:
  jounce motion iiwa14 paper --step 0.002 -o samples.csv
  jounce live iiwa14 samples.csv --limits iiwa14

\b
SAMPLES has a column t and one column per joint, NAME or NAME.q. For each row
one row is written: t, NAME.q .. NAME.q4d, NAME.Q, NAME.Qd, NAME.Q2d, the
standard deviations NAME.Q_sd ..., whether all joints are trusted, and the
limits that are broken by more than two standard deviations. With lag 0, Q2d
is too noisy for feedback. A Q2d smaller than its deviation is left empty.
Unusable rows are skipped with a warning, and the exit code is then 3. Three
increasing times in a row before the last time start a new clock.
"""


@click.command(cls=Command, epilog=LIVE_EPILOG, short_help="Rates, forces and broken limits of samples as they come.")
@add_robot_options
@click.argument("samples", type=click.Path(path_type=Path, allow_dash=True), default="-")
@LIMITS
@click.option("--dt", type=float, metavar="S", help="Time between samples; default: estimated from the first rows.")
@click.option("--bandwidth", type=float, metavar="HZ", help="Bandwidth of the motion; default: the likeliest of nine.")
@click.option("--lag", type=float, default=0.02, metavar="S", help="Delay of the rates relative to the samples.")
@click.option("--columns", metavar="PATTERN", help="Names of the joints' columns, such as 'q_{joint}'.")
@click.option("--follow", is_flag=True, help="At the end of the file, wait for new rows.")
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
    """Estimate rates and forces of ROBOT from SAMPLES as they come.

    SAMPLES are CSV or JSON lines from a file or a pipe (-).
    """
    from jounce.live.estimator import LiveRates
    from jounce.live.samples import read_lines, read_samples

    arm = load_robot(robot, limits)
    with click.open_file(str(samples), encoding="utf-8-sig") as source:
        rows = read_samples(read_lines(source, follow and str(samples) != "-"), arm.mechanism, columns)
        # Rows that are read ahead to estimate their spacing are not lost: they are chained before the others.
        first = list(islice(rows, FIRST_ROWS if dt is None else 0))
        if dt is None:
            dt = _usual_spacing([t for t, _ in first])
        left_out = _write_live_rows(arm, LiveRates(arm, dt, bandwidth, lag), chain(first, rows), as_json)
    if left_out > 0:
        warn("1 row is left out" if left_out == 1 else f"{left_out} rows are left out")
        raise SystemExit(EXIT_ROWS_LEFT_OUT)


def _usual_spacing(times: list[float]) -> float:
    """Return the median spacing of the first rows.

    Spacings that are not positive are left out, as are their rows later.
    """
    spacings = sorted(later - before for before, later in pairwise(times) if later > before)
    if len(spacings) == 0:
        came = "fewer than two rows of samples"
        if len(times) > 1:
            came = f"the times of the first {len(times)} rows do not increase: {times[0]} and {times[1]} s"
        raise JounceError(f"{came}; give the time between samples with --dt")
    return spacings[len(spacings) // 2]


def _write_live_rows(arm: "Robot", live: "LiveRates", rows: "Iterable[tuple[float, np.ndarray]]", as_json: bool) -> int:
    """Write one row per sample, and count the samples left out."""
    from jounce.live.forces import find_broken, judged_limits

    judged = judged_limits(arm)
    unjudged = [kind.replace("_", " ") for kind in judged.limits.kinds if kind not in judged.kinds]
    if len(unjudged) > 0:
        warn(f"limits of {join_names(unjudged)} are not checked live; use jounce check")
    names = [f"{joint}.{name}" for name in LIVE_COLUMNS for joint in arm.joint_names]
    table = csv.writer(sys.stdout, lineterminator="\n")
    if not as_json:
        table.writerow(["t", *names, "trusted", "broken"])
    # The first call compiles native code: no sample has to wait for it.
    live.forces()
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
        # Rates are behind the samples by the lag: at first they are of a time before the first sample.
        if not isfinite(live.t):
            continue
        forces, deviations = live.forces(), live.deviations
        broken = find_broken(arm, judged, rates, deviations, forces)
        arrays = (*rates, *forces[:3], *forces.deviations)
        # Numbers that are not known well enough are NaN; both formats write nothing in their place.
        numbers = [x if isfinite(x) else None for array in arrays for x in array.tolist()]
        trusted = bool(live.trust.good.all())
        if as_json:
            values = {"t": live.t, **dict(zip(names, numbers, strict=True)), "trusted": trusted}
            sys.stdout.write(json.dumps(values | {"broken": [exceeded._asdict() for exceeded in broken]}) + "\n")
        else:
            broken_limits = "; ".join(f"{exceeded.limit.replace('_', ' ')} of {exceeded.joint}" for exceeded in broken)
            table.writerow([live.t, *numbers, int(trusted), broken_limits])
        # Whoever reads a pipe gets each row at once.
        sys.stdout.flush()
    return left_out
