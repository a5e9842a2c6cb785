"""`jounce check` and `explain`: the verdict on a motion by the limits of a robot, and why a controller stops it.

`check` judges every limit along a motion, or along many that are read by parts, and prints those nearest to their
bounds. `explain` says which limits commands break at which times, for which cause, and what cures it: as command lines
that can be run. The exit code of both is that of the verdict (`EXIT_CODES`).
"""

import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from jounce.cli.limits import DIFFERENCES, LIMITS, draw_ratios, load_robot, load_with_motion
from jounce.cli.motion_options import TYPED_WORDS, MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import align_columns, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options
from jounce.cli.summaries import (
    UNCERTAIN_MARK,
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
MAX_LIMITS_SHOWN = 20  # those nearest to their bounds: a table that fits a terminal; --json has all
CHECK_EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce check iiwa14 slower.csv --limits iiwa14 -o ratio.svg

\b
Values between samples count. The exit code is 1 if a limit is broken, and 3
if none is but one is undecided: a limit within two standard deviations of
measured samples, joints that move no mass (--massless-tips states that they
are meant), limits of 0, or inertias that no body can have.
MOTION may be a folder of tables, or a table of many motions.
"""
RATE = click.option("--rate", type=float, metavar="HZ", help="Judge commands at the rate of a controller.")


@click.command(cls=MotionCommand, epilog=CHECK_EPILOG, short_help="Every limit of a robot along a motion.")
@add_robot_options
@add_motion_options
@LIMITS
@click.option("-o", "--picture", type=PATH, help="Ratios over time as a picture: .png, .svg or .pdf.")
@click.option("--table", type=PATH, help="Write the limits of every motion as a table: .csv, .npz or .parquet.")
@RATE
@DIFFERENCES
@add_stream_options_without_reduce
@click.option("--json", "as_json", is_flag=True, help="Print every limit as JSON.")
def check(
    robot: RobotRequest,
    motion: MotionRequest,
    limits: Path | None,
    picture: Path | None,
    table: Path | None,
    rate: float | None,
    differences: int,
    stream: StreamRequest,
    as_json: bool,
) -> None:
    """Check MOTION of ROBOT against its limits of position, speed, acceleration, torque, torque rate and others."""
    from jounce.limits.limited_motion import required_order
    from jounce.stream.jobs import CheckJob

    if picture is not None:
        from jounce.figures import canvas

        canvas.check_writable(picture)
    arm = load_robot(robot, limits)
    job = CheckJob(arm, stream.reading(motion), None, required_order(arm))
    request = RunRequest(job, motion, table, stream, "limits")
    by_parts = request.is_by_parts
    if picture is not None and by_parts:
        raise JounceError("-o draws one motion that is read as a whole; --table writes the limits of many")
    if rate is not None and (picture is not None or by_parts):
        raise JounceError("--rate judges one motion that is read as a whole, without -o; --as commands judges many")
    if by_parts:
        found = request.run_by_parts()
    else:
        found = request.run_whole(lambda: _check_whole(request, arm, rate, differences, picture))
    of = Verdicts.of(found)
    print_result(
        lambda: _check_lines(request, found, of, picture), lambda: _check_json(request, found, of, picture), as_json
    )
    raise SystemExit(EXIT_CODES[of.whole])


def _check_whole(
    request: RunRequest, arm: "Robot", rate: float | None, differences: int, picture: Path | None
) -> "RunSummary":
    """The check of a motion, or of its commands at the rate of a controller, with its table and its picture."""
    from jounce.limits.verdicts import tabulate_limits
    from jounce.stream.jobs import summarize_check
    from jounce.stream.run import RunSummary, collect_notes, write_table

    with stage(request.label):
        motion = request.motion.load(arm, request.job.order)
        if rate is not None:
            motion = motion.sampled(rate, differences)
        results = {request.motion.path.stem: summarize_check(request.job, motion, arm.check(motion))}
    found = RunSummary(results, collect_notes(results))
    if request.output is not None:
        write_table(request.output, tabulate_limits(found.checks), request.job)
    if picture is not None:
        draw_ratios(arm, motion, picture)
    return found


@dataclass(frozen=True)
class Verdicts:
    """The verdict on all motions, those on which it is another than kept, the worst of each limit, what is judged."""

    whole: "Verdict"
    broken: list[str]
    undecided: list[str]
    worst: "list[tuple[str, CheckedLimit]]"
    judged: dict[str, float]

    @classmethod
    def of(cls, found: "RunSummary") -> "Verdicts":
        """Those of the checks of all motions."""
        from jounce.limits.verdicts import combine_verdicts, least_judged, worst_limits

        checks = found.checks
        verdicts = {name: check.verdict for name, check in checks.items()}
        broken, undecided = ([name for name, of in verdicts.items() if of == bad] for bad in ("broken", "undecided"))
        whole = combine_verdicts(verdicts.values())
        return cls(whole, broken, undecided, worst_limits(checks), least_judged(checks.values()))


def _check_json(request: RunRequest, found: "RunSummary", verdicts: Verdicts, picture: Path | None) -> "JsonObject":
    limits = [asdict(row) | {"verdict": row.verdict, "motion": name} for name, row in verdicts.worst]
    return common_json(request, found) | {
        "picture": None if picture is None else str(picture), "ok": verdicts.whole == "kept",
        "verdict": verdicts.whole, "judged": verdicts.judged, "broken": verdicts.broken,
        "undecided": verdicts.undecided, "limits": limits,
    }  # fmt: skip


def _check_lines(request: RunRequest, found: "RunSummary", verdicts: Verdicts, picture: Path | None) -> list[str]:
    rows = sorted(verdicts.worst, key=lambda of: -of[1].ratio)
    shown, more = rows[:MAX_LIMITS_SHOWN], len(rows) - MAX_LIMITS_SHOWN
    marked, doubted = any(row.certain for _, row in shown), any(row.undecided for _, row in rows)
    columns = [True] * 6 + [marked] * 2 + [True] * 2 + [doubted, len(found.results) > 1]
    table = [HEADS, *(_cells(row, motion) for motion, row in shown)]
    robot, (first, last) = shorten(request.job.robot.name), request.span(found)
    return [
        f"{robot} along {request.motion.path}, t = {first:g} .. {last:g} s: {_describe_verdicts(found, verdicts)}",
        *notes_in_words(request, found),
        *([f"limits written to {request.output}"] if request.output else []),
        "",
        *align_columns([tuple(compress(row, columns)) for row in table]),
        *([f"and {more} more; --json lists them"] if more > 0 else []),
        *([UNCERTAIN_MARK] if marked else []),
        *hidden_in_words([one for of in found.results.values() for one in of.facts.hidden]),
        *([f"ratios drawn to {picture}"] if picture else []),
    ]


def _cells(row: "CheckedLimit", motion: str) -> tuple[str, ...]:
    """The cells of a limit in the table, below `HEADS`."""
    mark = " *" if row.certain else ""
    certain = (f"{abs(row.certain[0]):.6g}", f"{row.certain[1]:.4f}") if row.certain else ("", "")
    deviation = f" +- {row.deviation:.2g}" if row.deviation else ""
    return (
        row.words, row.joint, f"{abs(row.value):.6g}{mark}", f"{abs(row.bound):.6g}", row.unit, f"{row.t:.4f}",
        *certain, f"{abs(row.ratio):.6g}{deviation}", spans_in_words(row.violations) or "-",
        spans_in_words(row.undecided) or "-", motion or "-",
    )  # fmt: skip


def _describe_verdicts(found: "RunSummary", verdicts: Verdicts) -> str:
    """The verdict on one motion, or on many."""
    from jounce.limits.verdicts import describe_judged, describe_verdict

    count = len(found.results)
    if count == 1:
        return describe_verdict([row.verdict for _, row in verdicts.worst], verdicts.judged)
    bad = {"broken": verdicts.broken, "undecided": verdicts.undecided}
    counts = [f"{name} in {len(motions)}" for name, motions in bad.items() if motions]
    some, every = "limits are " + " and ".join(counts), "every limit is kept in"
    verdict = f"{some} of {count} motions" if counts else f"{every} all {count} motions"
    return "; ".join([verdict, *describe_judged(verdicts.judged, "judged of each motion, at least")])


def spans_in_words(spans: "Sequence[Span]", most: int = 2) -> str:
    """When a limit is broken: the first spans, and how many more."""
    shown = [f"{start:.4f} .. {stop:.4f}" if stop > start else f"{start:.4f}" for start, stop in spans[:most]]
    more = f" and {len(spans) - most} more" if len(spans) > most else ""
    return ", ".join(shown) + more


MAX_TRIPS_SHOWN = 12  # the first stops the robot; --json has all
EXPLAIN_EPILOG = """\b
Example:
  jounce excite ur5 --starts 1 -o excite.csv
  jounce explain ur5 excite.csv --rate 500

\b
Give --controller franka for a Panda or FR3, and --as commands for tables of
commands. The exit code is that of check: 0 kept, 1 broken, 3 undecided.
"""


@click.command(
    cls=MotionCommand, epilog=EXPLAIN_EPILOG, short_help="Why a controller stops a motion, and what cures it."
)
@add_robot_options
@add_motion_options
@LIMITS
@click.option("--controller", metavar="NAME", help="Controller whose public rules and limits are used: franka.")
@RATE
@DIFFERENCES
@click.option("--start", metavar="Q1,Q2,...", help="Measured position, rad or m, at which the robot rests before.")
@click.option("--json", "as_json", is_flag=True, help="Print the explanation as JSON.")
def explain(
    robot: RobotRequest, motion: MotionRequest, limits: Path | None, controller: str | None, rate: float | None,
    differences: int, start: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Explain which limits of ROBOT the commands of MOTION break, when and for which cause, and what cures it."""
    if controller is not None and limits is not None:
        raise JounceError("--controller has limits of its own; leave out --limits, or give --rate in its place")
    arm, path = load_with_motion(robot, motion, limits, 1)
    try:
        begin = None if start is None else [float(x) for x in start.split(",")]
    except ValueError:
        raise JounceError(f"--start is {start!r}; expected numbers with commas between them") from None
    found = arm.explain(path, controller, rate=rate, differences=differences, start=begin)
    # The call of Python becomes the command line.
    commands = [_repeat_command(cure.method, arm, motion.path) for cure in found.cures]

    def data() -> "JsonObject":
        cures = [
            {key: value for key, value in asdict(cure).items() if key != "call"} | {"command": command}
            for cure, command in zip(found.cures, commands, strict=True)
        ]
        about = {"robot": arm.name, "motion": str(motion.path), "controller": controller, "ok": found.verdict == "kept"}
        return about | asdict(found) | {"cures": cures}

    def lines() -> list[str]:
        return _explanation_lines(f"{shorten(arm.name)} along {motion.path}", found, commands)

    print_result(lines, data, as_json)
    raise SystemExit(EXIT_CODES[found.verdict])


def _repeat_command(verb: str, arm: "Robot", motion: Path) -> str:
    """The command line of another verb on the same robot, motion and limits, at the same rate."""
    from jounce.limits.explanation import select_controller

    context = click.get_current_context()
    typed = context.command.make_parser(context).parse_args(list(context.meta[TYPED_WORDS]))[0]
    words, left_out = ["jounce", verb], {"controller", "start", "as_json"}
    if name := typed.get("controller"):
        known, limits = select_controller(name, arm.joint_names)
        left_out |= {"differences"}
        typed |= {"limits": limits, "rate": f"{known.rate:g}"}
    for parameter in context.command.params:
        value, key = typed.get(str(parameter.name)), parameter.opts[0]
        if value is None or parameter.name in left_out:
            continue
        if isinstance(parameter, click.Argument):
            words.append(value)
        elif parameter.is_flag:  # type: ignore[attr-defined] # an option
            words.append(key)
        else:
            for given in value if parameter.multiple else [value]:
                words += [key, *([given] if isinstance(given, str) else given)]
    return shlex.join([*words, "-o", f"{motion.stem}-{verb}.csv"])


def _explanation_lines(head: str, found: "Explanation", commands: Sequence[str]) -> list[str]:
    trips, words = found.trips, found.words
    first: list[str] = []
    if trips:
        one = trips[0]
        words = f"the {one.limit} of {one.joint} is broken at {1e3 * one.t:.6g} ms: {one.words}"
        rows: list[tuple[str, ...]] = [
            ("at t", "until", "joint", "limit", "value", "bound", "unit", "worst ratio", "cause")
        ]
        for of in trips[:MAX_TRIPS_SHOWN]:
            start, stop, value, bound, ratio = (f"{x:.6g}" for x in (of.t, of.stop, of.value, of.bound, of.ratio))
            cause = f"{of.cause}: {of.words}"
            rows.append((start, stop, of.joint, of.limit, value, bound, of.unit, ratio, cause))
        more = len(trips) - MAX_TRIPS_SHOWN
        first = ["", *align_columns(rows), *([f"and {more} more moments; --json lists them"] if more > 0 else []), ""]
    effects = {True: "cures it", False: "does not cure it"}
    cures = []
    for cure, command in zip(found.cures, commands, strict=True):
        cures.append(f"{cure.method} {effects[cure.works]}: {cure.words}")
        if cure.works:
            cures.append(f"  {command}")
    unpredicted = (f"not predicted: {what}" for what in found.unpredicted)
    return [f"{head}: {words}", *found.notes, *first, *cures, *unpredicted]
