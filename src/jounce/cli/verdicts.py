"""`jounce check` and `explain`: the verdict on a motion by the limits of a robot, and why a controller stops it.

`check` judges every limit along a motion, or along many that are read by parts, and prints the limits nearest to their
bounds. `explain` lists the limits that commands break, with times and causes, and prints the command lines that cure
them. The exit code of both is that of the verdict (`EXIT_CODES`).
"""

import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.commands import TYPED_WORDS, Command
from jounce.cli.limits import DIFFERENCES, LIMITS, PICTURE_OF_RATIOS, draw_ratios, load_robot, load_with_motion
from jounce.cli.motion_options import MotionRequest, add_motion_options
from jounce.cli.output import align_columns, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options
from jounce.cli.summaries import (
    UNCERTAIN_MARK,
    VERBOSE,
    RunRequest,
    StreamRequest,
    add_stream_options_without_reduce,
    common_json,
    hidden_in_words,
    notes_in_words,
)
from jounce.core.errors import JounceError, shorten
from jounce.core.progress import stage

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject
    from jounce.limits.explanation import Explanation
    from jounce.limits.verdicts import CheckedLimit, Verdict
    from jounce.motion.channel import Span
    from jounce.robot import Robot
    from jounce.stream.run import RunSummary


EXIT_CODES = {"kept": 0, "broken": 1, "undecided": 3}  # of verdicts; 2 is that of errors
HEADS = (
    "limit", "joint", "|worst|", "bound", "unit", "at t", "|certain|", "at t", "ratio", "broken at t", "undecided at t",
    "motion",
)  # fmt: skip
MAX_LIMITS_SHOWN = 20  # the limits nearest to their bounds: a table that fits a terminal; --json lists all
CHECK_EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce check iiwa14 slower.csv --limits iiwa14 --picture ratio.svg

\b
Limits are checked between samples too. The exit code is 1 if a limit is
broken, and 3 if no limit is broken but one is undecided: measured samples
within two standard deviations of the limit, joints that move no mass
(--massless-tips accepts them), limits of 0, or physically inconsistent
inertias. MOTION may be a folder of tables, or a table of many motions.
"""
RATE = click.option("--rate", type=float, metavar="HZ", help="Judge commands at the rate of a controller.")


@click.command(
    cls=Command,
    former={"--table": "-o"},
    epilog=CHECK_EPILOG,
    short_help="Check every limit of a robot along a motion.",
)
@add_robot_options
@add_motion_options
@LIMITS
@click.option("-o", "--output", type=PATH, help="Write the limits of every motion as a table: .csv, .npz or .parquet.")
@PICTURE_OF_RATIOS
@RATE
@DIFFERENCES
@add_stream_options_without_reduce
@VERBOSE
@click.option("--json", "as_json", is_flag=True, help="Print every limit as JSON.")
def check(
    robot: RobotRequest,
    motion: MotionRequest,
    limits: Path | None,
    output: Path | None,
    picture: Path | None,
    rate: float | None,
    differences: int,
    stream: StreamRequest,
    verbose: bool,
    as_json: bool,
) -> None:
    """Check MOTION of ROBOT against all limits: position, velocity, acceleration, torque, torque rate and others."""
    from jounce.figures import canvas
    from jounce.limits.limited_motion import required_order
    from jounce.stream.jobs import CheckJob

    if output is not None and output.suffix.lower().removeprefix(".") in canvas.PICTURE_FORMATS:
        raise JounceError(f"{output}: -o writes a table, .csv, .npz or .parquet; draw the ratios by --picture {output}")
    if picture is not None:
        canvas.check_writable(picture)
    arm = load_robot(robot, limits)
    job = CheckJob(arm, stream.reading(motion), None, required_order(arm))
    request = RunRequest(job, motion, output, stream, "limits", verbose)
    by_parts = request.is_by_parts
    # Pictures and differences of commands need the whole motion in memory.
    if picture is not None and by_parts:
        raise JounceError(
            "--picture draws a single motion that is read as a whole; use -o with a table for many motions"
        )
    if rate is not None and (picture is not None or by_parts):
        raise JounceError(
            "--rate checks a single motion that is read as a whole, without --picture; use --as commands for many"
        )
    if by_parts:
        summary = request.run_by_parts()
    else:
        summary = request.run_whole(lambda: _check_whole(request, arm, rate, differences, picture))
    verdicts = Verdicts.of(summary)
    print_result(
        lambda: _check_lines(request, summary, verdicts, picture),
        lambda: _check_json(request, summary, verdicts, picture),
        as_json,
    )
    raise SystemExit(EXIT_CODES[verdicts.whole])


def _check_whole(
    request: RunRequest, arm: "Robot", rate: float | None, differences: int, picture: Path | None
) -> "RunSummary":
    """Check a motion in memory, and write its table and picture.

    With a rate, the commands that a controller of this rate receives are checked.
    """
    from jounce.limits.verdicts import tabulate_limits
    from jounce.stream.jobs import summarize_check
    from jounce.stream.run import RunSummary, collect_notes, write_table

    with stage(request.label):
        motion = request.motion.load(arm, request.job.order)
        if rate is not None:
            motion = motion.sampled(rate, differences)
        results = {request.motion.path.stem: summarize_check(request.job, motion, arm.check(motion))}
    summary = RunSummary(results, collect_notes(results))
    if request.output is not None:
        write_table(request.output, tabulate_limits(summary.checks), request.job)
    if picture is not None:
        draw_ratios(arm, motion, picture)
    return summary


@dataclass(frozen=True)
class Verdicts:
    """The verdicts on all motions: `whole` on all together, with the names of the motions that are not kept.

    `worst` holds each limit where it is nearest to its bound, with the name of the motion; `judged` the shares of the
    times that could be judged.
    """

    whole: "Verdict"
    broken: list[str]
    undecided: list[str]
    worst: "list[tuple[str, CheckedLimit]]"
    judged: dict[str, float]

    @classmethod
    def of(cls, summary: "RunSummary") -> "Verdicts":
        """Collect the verdicts of the checks of all motions."""
        from jounce.limits.verdicts import combine_verdicts, least_judged, worst_limits

        checks = summary.checks
        verdicts = {name: check.verdict for name, check in checks.items()}
        broken, undecided = (
            [name for name, verdict in verdicts.items() if verdict == kind] for kind in ("broken", "undecided")
        )
        whole = combine_verdicts(verdicts.values())
        return cls(whole, broken, undecided, worst_limits(checks), least_judged(checks.values()))


def _check_json(request: RunRequest, summary: "RunSummary", verdicts: Verdicts, picture: Path | None) -> "JsonObject":
    limits = [asdict(row) | {"verdict": row.verdict, "motion": name} for name, row in verdicts.worst]
    return common_json(request, summary) | {
        "picture": None if picture is None else str(picture), "ok": verdicts.whole == "kept",
        "verdict": verdicts.whole, "judged": verdicts.judged, "broken": verdicts.broken,
        "undecided": verdicts.undecided, "limits": limits,
    }  # fmt: skip


def _check_lines(request: RunRequest, summary: "RunSummary", verdicts: Verdicts, picture: Path | None) -> list[str]:
    # The limits nearest to their bounds come first.
    rows = sorted(verdicts.worst, key=lambda row: -row[1].ratio)
    shown, hidden_count = rows[:MAX_LIMITS_SHOWN], len(rows) - MAX_LIMITS_SHOWN
    # Columns that would be empty are left out: certain values, undecided times, names of motions.
    has_uncertain, has_undecided = any(row.certain for _, row in shown), any(row.undecided for _, row in rows)
    columns = [True] * 6 + [has_uncertain] * 2 + [True] * 2 + [has_undecided, len(summary.results) > 1]
    table = [HEADS, *(_cells(row, motion) for motion, row in shown)]
    robot, (first, last) = shorten(request.job.robot.name), request.span(summary)
    return [
        f"{robot} along {request.motion.path}, t = {first:g} .. {last:g} s: {_describe_verdicts(summary, verdicts)}",
        *notes_in_words(request, summary),
        *([f"limits written to {request.output}"] if request.output is not None else []),
        "",
        *align_columns([tuple(compress(row, columns)) for row in table]),
        *([f"and {hidden_count} more; --json lists them"] if hidden_count > 0 else []),
        *([UNCERTAIN_MARK] if has_uncertain else []),
        *hidden_in_words(summary, request.verbose),
        *([f"ratios drawn to {picture}"] if picture is not None else []),
    ]


def _cells(row: "CheckedLimit", motion: str) -> tuple[str, ...]:
    """Return the cells of a limit in the table, below `HEADS`."""
    mark = " *" if row.certain else ""
    certain = (f"{abs(row.certain[0]):.6g}", f"{row.certain[1]:.4f}") if row.certain else ("", "")
    deviation = f" +- {row.deviation:.2g}" if row.deviation else ""
    return (
        row.words, row.joint, f"{abs(row.value):.6g}{mark}", f"{abs(row.bound):.6g}", row.unit, f"{row.t:.4f}",
        *certain, f"{abs(row.ratio):.6g}{deviation}", spans_in_words(row.violations) or "-",
        spans_in_words(row.undecided) or "-", motion or "-",
    )  # fmt: skip


def _describe_verdicts(summary: "RunSummary", verdicts: Verdicts) -> str:
    """Describe the verdict on one motion, or on many."""
    from jounce.limits.verdicts import describe_judged, describe_verdict

    count = len(summary.results)
    if count == 1:
        return describe_verdict([row.verdict for _, row in verdicts.worst], verdicts.judged)
    names_by_verdict = {"broken": verdicts.broken, "undecided": verdicts.undecided}
    counts = [f"{name} in {len(motions)}" for name, motions in names_by_verdict.items() if motions]
    some, every = "limits are " + " and ".join(counts), "every limit is kept in"
    verdict = f"{some} of {count} motions" if counts else f"{every} all {count} motions"
    return "; ".join([verdict, *describe_judged(verdicts.judged, "judged of each motion, at least")])


def spans_in_words(spans: "Sequence[Span]", max_shown: int = 2) -> str:
    """List the first spans of time, and count the others."""
    shown = [f"{start:.4f} .. {stop:.4f}" if stop > start else f"{start:.4f}" for start, stop in spans[:max_shown]]
    more = f" and {len(spans) - max_shown} more" if len(spans) > max_shown else ""
    return ", ".join(shown) + more


MAX_TRIPS_SHOWN = 12  # the first stops the robot; --json lists all
EXPLAIN_EPILOG = """\b
Example:
  jounce excite ur5 --starts 1 -o excite.csv
  jounce explain ur5 excite.csv --rate 500

\b
Use --controller franka for a Panda or FR3, and --as commands for tables of
commands. Exit codes are those of check: 0 kept, 1 broken, 3 undecided.
"""


@click.command(
    cls=Command, epilog=EXPLAIN_EPILOG, short_help="Explain why a controller stops a motion, and how to cure it."
)
@add_robot_options
@add_motion_options
@LIMITS
@click.option("--controller", metavar="NAME", help="Use the published rules and limits of this controller: franka.")
@RATE
@DIFFERENCES
@click.option("--start", metavar="Q1,Q2,...", help="Position at which the robot rests before the motion, rad or m.")
@click.option("--json", "as_json", is_flag=True, help="Print the explanation as JSON.")
def explain(
    robot: RobotRequest, motion: MotionRequest, limits: Path | None, controller: str | None, rate: float | None,
    differences: int, start: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Explain which limits of ROBOT the commands of MOTION break.

    Each moment is listed with its cause, followed by the command lines that cure it.
    """
    if controller is not None and limits is not None:
        raise JounceError("--controller uses its own limits; leave out --limits, or use --rate instead of --controller")
    arm, path = load_with_motion(robot, motion, limits, 1)
    try:
        start_position = None if start is None else [float(x) for x in start.split(",")]
    except ValueError:
        raise JounceError(f"--start is {start!r}; expected numbers with commas between them") from None
    explanation = arm.explain(path, controller, rate=rate, differences=differences, start=start_position)
    # In Python a cure is a call; here it is a command line.
    commands = [_repeat_command(cure.method, arm, motion.path) for cure in explanation.cures]

    def data() -> "JsonObject":
        cures = [
            {key: value for key, value in asdict(cure).items() if key != "call"} | {"command": command}
            for cure, command in zip(explanation.cures, commands, strict=True)
        ]
        head = {
            "robot": arm.name,
            "motion": str(motion.path),
            "controller": controller,
            "ok": explanation.verdict == "kept",
        }
        return head | asdict(explanation) | {"cures": cures}

    def lines() -> list[str]:
        return _explanation_lines(f"{shorten(arm.name)} along {motion.path}", explanation, commands)

    print_result(lines, data, as_json)
    raise SystemExit(EXIT_CODES[explanation.verdict])


def _repeat_command(verb: str, arm: "Robot", motion: Path) -> str:
    """Return the command line of another verb with the same options."""
    from jounce.limits.explanation import select_controller

    context = click.get_current_context()
    typed = context.command.make_parser(context).parse_args(list(context.meta[TYPED_WORDS]))[0]
    words, left_out = ["jounce", verb], {"controller", "start", "as_json"}
    controller = typed.get("controller")
    if controller is not None:
        # Other verbs have no controllers: its limits and its rate take its place.
        known, limits = select_controller(controller, arm.joint_names)
        left_out |= {"differences"}
        typed |= {"limits": limits, "rate": f"{known.rate:g}"}
    # Options keep the words that were typed, so that no default is written out.
    for parameter in context.command.params:
        value, key = typed.get(str(parameter.name)), parameter.opts[0]
        if value is None or parameter.name in left_out:
            continue
        if isinstance(parameter, click.Argument):
            words.append(value)
        elif parameter.is_flag:  # type: ignore[attr-defined] # an option
            words.append(key)
        else:
            for words_of_value in value if parameter.multiple else [value]:
                words += [key, *([words_of_value] if isinstance(words_of_value, str) else words_of_value)]
    return shlex.join([*words, "-o", f"{motion.stem}-{verb}.csv"])


def _explanation_lines(head: str, explanation: "Explanation", commands: Sequence[str]) -> list[str]:
    """Return the lines of an explanation: the first trip in words, a table of trips, and the cures."""
    trips, words = explanation.trips, explanation.words
    table: list[str] = []
    if len(trips) > 0:
        # The first trip is the one at which the controller stops the robot.
        earliest = trips[0]
        words = f"{earliest.joint} exceeds its {earliest.limit} limit at {1e3 * earliest.t:.6g} ms"
        if earliest.cause != "too fast":
            words += f": {earliest.words}"
        rows: list[tuple[str, ...]] = [
            ("at t", "until", "joint", "limit", "value", "bound", "unit", "worst ratio", "cause")
        ]
        for trip in trips[:MAX_TRIPS_SHOWN]:
            start, stop, value, bound, ratio = (
                f"{x:.6g}" for x in (trip.t, trip.stop, trip.value, trip.bound, trip.ratio)
            )
            cause = f"{trip.cause}: {trip.words}"
            rows.append((start, stop, trip.joint, trip.limit, value, bound, trip.unit, ratio, cause))
        hidden_count = len(trips) - MAX_TRIPS_SHOWN
        table = [
            "",
            *align_columns(rows),
            *([f"and {hidden_count} more moments; --json lists them"] if hidden_count > 0 else []),
            "",
        ]
    effects = {True: "cures it", False: "does not cure it"}
    cures = []
    for cure, command in zip(explanation.cures, commands, strict=True):
        cures.append(f"{cure.method} {effects[cure.works]}: {cure.words}")
        if cure.works:
            cures.append(f"  {command}")
    unpredicted = (f"not predicted: {what}" for what in explanation.unpredicted)
    return [f"{head}: {words}", *explanation.notes, *table, *cures, *unpredicted]
