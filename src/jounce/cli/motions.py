"""`jounce motion`, `slowdown`, `retime` and `excite`: motions, written as tables.

`motion` writes a motion with its rates, to inspect and to run. `slowdown` finds the largest factor of speed, at most 1,
at which a motion keeps every limit. `retime` finds the fastest motion along the path of a motion, from rest to
rest. `excite` finds the motion within all limits that determines the parameters of the robot best.

Each command checks first that its outputs can be written, then computes, writes and prints. `data` and `lines` make the
two forms of what is printed; only one of them is called.
"""

from dataclasses import asdict, replace
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.commands import Command, split_names
from jounce.cli.limits import DIFFERENCES, LIMITS, PICTURE_OF_RATIOS, draw_ratios, load_robot, load_with_motion
from jounce.cli.motion_options import OPTION_FILES, MotionRequest, add_motion_options, write_motion
from jounce.cli.output import align_columns, check_distinct, print_result
from jounce.cli.robot_options import (
    PATH,
    RobotRequest,
    add_robot_options,
    add_robot_options_without_drives,
    parse_drive_terms,
)
from jounce.cli.summaries import VERBOSE, LargestValues, vibrations_in_words
from jounce.core.errors import JounceError, quote_value, shorten
from jounce.core.progress import stage

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject
    from jounce.motion import Motion


MOTION_EPILOG = """\b
Example:
  jounce motion iiwa14 paper -o motion.csv --step 0.01
  jounce plot motion.csv -o motion.svg
  jounce run iiwa14 motion.csv -o forces.csv

\b
OUT contains t and NAME.q, NAME.qd, ... NAME.q4d. If MOTION consists of
samples, OUT also contains them, NAME.q_sample, and the standard deviations
NAME.q_sd, .... If a derivative jumps, OUT has a column break: the order of
the lowest derivative that jumped since the previous row, or -1.
"""


@click.command(cls=Command, epilog=MOTION_EPILOG, short_help="Write a motion with its rates, q to q4d, as a table.")
@add_robot_options_without_drives
@add_motion_options
@click.option("-o", "--output", required=True, type=PATH, help="Output table: .csv or .npz.")
@click.option("--order", default=4, type=click.IntRange(0), help="Highest time derivative of q.")
@click.option(
    "--save-read", type=PATH, metavar="FILE", help="Save the options of how the table is read, for --read: .yaml."
)
@VERBOSE
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def motion(
    robot: RobotRequest, motion: MotionRequest, output: Path, order: int, save_read: Path | None, verbose: bool,
    as_json: bool,
) -> None:  # fmt: skip
    """Write MOTION of ROBOT with its rates as a table.

    `jounce run` reads this table, and `jounce plot` draws it.
    """
    from jounce.engine import motion_channels
    from jounce.engine.along import Q_RATE_ORDER
    from jounce.engine.hidden_vibrations import find_hidden_vibrations
    from jounce.io import tables
    from jounce.io.motions import writing
    from jounce.motion.extremes import find_motion_extremes
    from jounce.spatial.series import rate_name

    tables.check_writable(output)
    check_distinct(output, motion.path)
    if save_read is not None:
        check_options_writable(save_read)
        check_distinct(save_read, motion.path, robot.path, motion.read)
    # A motion that forces of an order need has rates of q up to two orders more.
    arm = robot.load()
    path = motion.load(arm, max(order - 2, 0))
    write_motion(output, path, arm.joint_names, order)
    if save_read is not None:
        write_options(save_read, motion)
    # The summary states the largest values where they are known well, and what the samples would hide.
    unit = writing.table_metadata(arm.mechanism, 0).unit
    windows = motion_channels.find_windows(path, order, Q_RATE_ORDER)
    peaks = find_motion_extremes(path, arm.joint_names, order, windows)
    values = LargestValues.of({motion.path.stem: peaks}, unit)
    hidden = find_hidden_vibrations(arm, path, order, "q")
    # Stances of contacts change the forces, and no rate of q.
    breaks = [jump for jump in path.breaks_to(order) if jump.symbol != "contact"]
    first, last = float(path.times[0]), float(path.times[-1])
    residual = None if path.residual is None else float(path.residual.max())

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "source": path.source, "residual": residual,
            "notes": list(path.notes), "breaks": [jump._asdict() for jump in breaks],
            "hidden_vibrations": [asdict(vibration) for vibration in hidden], **values.json(),
            "output": str(output), "save_read": None if save_read is None else str(save_read),
            "states": len(path.times), "t": [first, last], "order": order,
        }  # fmt: skip

    def lines() -> list[str]:
        deviation = "" if residual is None else f", at most {residual:.2g} from the original"
        count = len(breaks)
        noun = "break" if count == 1 else "breaks"
        return [
            f"{shorten(arm.name)} along {motion.path}: {len(path.times)} rows, t = {first:g} .. {last:g} s",
            path.source + deviation,
            *path.notes,
            *([f"{count} {noun}; --json lists them, --blend replaces them"] if count else []),
            f"q to {rate_name('q', order)} written to {output}",
            *([f"options written to {save_read}, for --read"] if save_read is not None else []),
            *(["", *values.table()] if len(values.largest) > 0 else []),
            *vibrations_in_words(hidden, verbose),
        ]

    print_result(lines, data, as_json)


def check_options_writable(path: Path) -> None:
    """Raise `JounceError` if options cannot be written to a file."""
    from jounce.io import files

    if path.suffix.lower() not in OPTION_FILES:
        raise JounceError(f"{path}: unknown type of file {path.suffix!r} for --save-read; available: .yaml, .yml")
    files.check_writable(path)


def write_options(path: Path, motion: MotionRequest) -> None:
    """Write the options of a motion to a file for --read.

    Options that have their default values are left out.
    """
    from jounce.io import files, robot_writing

    # Names of parameters become names of options: as_ is --as, time_unit is --time-unit.
    options = motion.options | {"rename": dict(motion.options["rename"]), "blend": motion.blend, "step": motion.step}
    data = {
        name.rstrip("_").replace("_", "-"): value
        for name, value in options.items()
        if value is not None and value is not False and value != {}  # the episode 0 stays
    }
    with files.write_whole(path) as part:
        part.write_text(robot_writing.dump_yaml(data, flow=False), encoding="utf-8", newline="\n")


SLOWDOWN_EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce check iiwa14 slower.csv --limits iiwa14

\b
OUT holds t and NAME.q, NAME.qd, ... NAME.q4d of the slower motion. If MOTION
keeps all limits, it stays as it is, and the factor by which it could be
faster is printed; --up-to-limits applies this factor. With --rate, `jounce
check --rate` finds that OUT keeps every limit. With --as commands, the rate
is that of the table.
"""
KEPT_RATE = click.option(
    "--rate", type=float, metavar="HZ",
    help="Rate of the controller: limits apply to differences of commands; OUT has one row per command.",
)  # fmt: skip


@click.command(cls=Command, epilog=SLOWDOWN_EPILOG, short_help="Slow a motion down until it keeps every limit.")
@add_robot_options
@add_motion_options
@LIMITS
@KEPT_RATE
@DIFFERENCES
@click.option("--up-to-limits", is_flag=True, help="Speed the motion up too, as far as its limits allow.")
@click.option("-o", "--output", type=PATH, help="Table of the slower motion: .csv or .npz.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def slowdown(
    robot: RobotRequest, motion: MotionRequest, limits: Path | None, rate: float | None, differences: int,
    up_to_limits: bool, output: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Find the speed factor at which MOTION of ROBOT keeps all limits.

    The factor is the largest one up to 1. Every smaller factor keeps the limits too. With --rate, and for measured
    samples, this holds for the factors that were tried. Limits that the samples leave undecided at every speed are
    named.
    """
    from jounce.io import tables
    from jounce.motion.commands import find_commands

    if output is not None:
        tables.check_writable(output)
        check_distinct(output, motion.path)
    arm, path = load_with_motion(robot, motion, limits, 0 if rate is None else 1)
    # Commands have the rate of their table.
    commands = find_commands(path.curve)
    if commands is not None and rate is None:
        rate = commands.rate
    slow = arm.slowdown(path, rate, differences, up_to_limits=up_to_limits)
    if output is not None:
        write_motion(output, select_rows(slow.motion, rate, None), arm.joint_names)
    before, after = path.duration, slow.motion.duration
    notes = [*path.notes, *slow.notes]

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "verdict": slow.verdict, "factor": slow.factor,
            "largest": slow.largest, "binding": None if slow.binding is None else slow.binding._asdict(),
            "duration": [before, after],
            "notes": notes, "rate": rate, "output": None if output is None else str(output),
        }  # fmt: skip

    def lines() -> list[str]:
        head = f"{shorten(arm.name)} along {motion.path}"
        written = [f"q to q4d written to {output}"] if output is not None else []
        if slow.binding is None:
            return [f"{head}: {slow.words}", *notes, *written]
        change = "it must be slower" if slow.factor < 1 else "it becomes faster"
        bound = f"the {slow.binding.limit.replace('_', ' ')} of {slow.binding.joint} at t = {slow.binding.t:.6g} s"
        return [
            f"{head}: {change}, {slow.factor:.6g} times the speed",
            f"{before:.6g} s become {after:.6g} s; bound by {bound}",
            *notes,
            *written,
        ]

    print_result(lines, data, as_json)


def select_rows(motion: "Motion", rate: float | None, step: float | None) -> "Motion":
    """Return the motion at the times of the rows of a table.

    They are those of commands at a rate, or even steps, or else the motion's own.
    """
    import numpy as np

    if rate is not None:
        t = motion.sampled(rate).times
        # The last command may come after the end, where the motion rests.
        return replace(motion, grid=np.unique(t.clip(max=motion.stop)))
    return motion if step is None else motion.with_step(step)


RETIME_EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce retime iiwa14 slower.csv --limits iiwa14 -o fast.csv

\b
OUT holds t and NAME.q, NAME.qd, ... NAME.q4d, as `jounce motion` writes them.
With --rate, `jounce check --rate` finds that OUT keeps every limit. MOTION
may be a table of way points without times (--tolerance rounds its corners).
"""


@click.command(cls=Command, epilog=RETIME_EPILOG, short_help="Find the fastest motion along a path within all limits.")
@add_robot_options
@add_motion_options
@LIMITS
@KEPT_RATE
@DIFFERENCES
@click.option("-o", "--output", required=True, type=PATH, help="Table to write: .csv or .npz.")
@click.option("--margin", default=0.01, help="Share of each limit that is left free.")
@click.option(
    "--smooth/--no-smooth",
    default=True,
    help="Keep accelerations continuous. With --no-smooth they may jump, which is faster if only velocity, acceleration"
    " and effort are limited.",
)
@click.option("--picture", type=PATH, help="Draw the speed along the path with its limits: .png, .svg or .pdf.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def retime(
    robot: RobotRequest, motion: MotionRequest, limits: Path | None, rate: float | None, differences: int, output: Path,
    margin: float, smooth: bool, picture: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Write the fastest motion of ROBOT along the path of MOTION.

    It keeps all limits, and starts and ends at rest.
    """
    from jounce.figures import canvas
    from jounce.io import tables
    from jounce.motion import joint_matching

    tables.check_writable(output)
    check_distinct(output, motion.path)
    if picture is not None:
        canvas.check_writable(picture)
    arm, original = load_with_motion(robot, motion, limits, 0 if rate is None else 1, joint_matching.PATH_DURATION)
    # The path of way points has a duration only if one is stated.
    is_path = joint_matching.is_along_points(original) and motion.options["duration"] is None
    given = None if is_path else original.duration
    retiming = arm.retime(original, margin, smooth, rate=rate, differences=differences)
    fast = select_rows(retiming.motion, rate, motion.step)
    write_motion(output, fast, arm.joint_names)
    if picture is not None:
        from jounce.figures.limit_pictures import draw_path_speed

        canvas.save(draw_path_speed(arm, original, retiming), picture)
    notes = [*original.notes, *retiming.notes]

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "source": original.source, "margin": margin, "rate": rate,
            "given": given, "duration": retiming.duration,
            "binding": [stretch._asdict() for stretch in retiming.binding],
            "jumps": retiming.jumps, "notes": notes, "output": str(output),
            "picture": None if picture is None else str(picture), "states": len(fast.times),
        }  # fmt: skip

    def lines() -> list[str]:
        # One row per stretch of the path, with the joint and the limit that decide the speed there.
        rows: list[tuple[str, ...]] = [("decides", "limit", "|from [s]", "|to [s]")]
        for stretch in retiming.binding:
            rows.append((stretch.joint, stretch.limit.replace("_", " "), f"{stretch.start:.4f}", f"{stretch.stop:.4f}"))
        before = "" if given is None else f"{given:.6g} s -> "
        head, drawn = f"{shorten(arm.name)} along {motion.path}", f", drawn to {picture}" if picture is not None else ""
        return [
            f"{head}: {before}{retiming.duration:.6g} s with a margin of {margin:.3g}",
            *([original.source] if is_path else []),
            f"{len(fast.times)} rows written to {output}{drawn}",
            *([f"accelerations and efforts jump {retiming.jumps} times"] if retiming.jumps > 0 else []),
            *notes,
            "",
            *align_columns(rows),
        ]

    print_result(lines, data, as_json)


EXCITE_EPILOG = """\b
Example:
  jounce excite ur5 --starts 1 -o excite.csv
  jounce check ur5 excite.csv

\b
OUT.csv, .npz or .parquet holds t and NAME.q, NAME.qd, ... NAME.q4d. OUT.yaml
or .json holds the offsets, amplitudes and frequencies of the series.

\b
Collisions with obstacles and of the robot with itself are not checked: check
the motion before it runs, or narrow the position limits with --limits.
"""


@click.command(cls=Command, epilog=EXCITE_EPILOG, short_help="Find a motion that excites the parameters of a robot.")
@add_robot_options_without_drives
@LIMITS
@click.option("-o", "--output", required=True, type=PATH, help="Output: a table, or a .yaml or .json file.")
@click.option("--period", metavar="S", default=10.0, help="Period of the Fourier series in s.")
@click.option("--periods", metavar="N", default=1, help="Number of periods.")
@click.option("--harmonics", metavar="N", default=5, help="Harmonics of the Fourier series.")
@click.option(
    "--drives",
    "terms",
    multiple=True,
    callback=split_names,
    metavar="TERMS",
    help="Drive terms to identify too: all, or a list of armature, damping, friction, stribeck, spring, offset.",
)
@click.option(
    "--reach",
    metavar="RAD",
    default=pi,
    show_default="pi",
    help="Largest position, to either side of 0, of revolute joints without position limits.",
)
@click.option("--margin", default=0.01, help="Share of each limit that is left free.")
@click.option("--payload", is_flag=True, help="Excite a load, for `jounce payload`, instead of the robot itself.")
@click.option("--body", metavar="NAME", help="Body or link that carries the load of --payload; default: the last body.")
@click.option("--starts", metavar="N", default=5, help="Number of random starts.")
@click.option("--seed", default=0, help="Seed of the random starts.")
@click.option("--step", type=float, metavar="S", help="Time between rows in s; default: 1 ms.")
@PICTURE_OF_RATIOS
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def excite(
    robot: RobotRequest,
    limits: Path | None,
    output: Path,
    terms: tuple[str, ...],
    payload: bool,
    body: str | None,
    step: float | None,
    picture: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Find the motion of ROBOT that determines its parameters best.

    The motion is a Fourier series of the joints within all limits. It starts and ends at rest, so that it can be
    repeated. ROBOT needs limits, in its file or by --limits.
    """
    from jounce.figures import canvas
    from jounce.io import files, tables
    from jounce.io.entries import DOCUMENT_SUFFIXES
    from jounce.io.motions import terms as analytic

    if body is not None and not payload:
        raise JounceError(f"--body {quote_value(body)} needs --payload: it names the body that carries the load")
    # The suffix decides whether the series itself is written, or its values as a table.
    writes_terms = output.suffix.lower() in DOCUMENT_SUFFIXES
    (files if writes_terms else tables).check_writable(output)
    check_distinct(output, robot.path, limits)
    if picture is not None:
        canvas.check_writable(picture)
    arm = load_robot(robot, limits)
    drive_terms = False if len(terms) == 0 else parse_drive_terms(terms)
    # `payload` takes the name of a body, or True for the last one.
    carrier: str | bool = payload
    if payload and body not in (None, ""):
        carrier = body
    with stage("starts of the search") as show:
        excitation = arm.excite(drives=drive_terms, payload=carrier, progress=show, **options)
    motion = excitation.motion if step is None else excitation.motion.with_step(step)
    if writes_terms:
        analytic.write(output, motion, arm.joint_names)
    else:
        write_motion(output, motion, arm.joint_names)
    if picture is not None:
        draw_ratios(arm, motion, picture)

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "source": motion.source, "duration": motion.duration,
            "criterion": excitation.criterion, "condition": excitation.condition,
            "parameters": list(excitation.parameters), "unseen": list(excitation.unseen),
            "limits": [vars(row) | {"violations": list(row.violations)} for row in excitation.limits],
            "notes": list(excitation.notes), "output": str(output),
            "picture": None if picture is None else str(picture),
            "states": len(motion.times),
        }  # fmt: skip

    def lines() -> list[str]:
        drawn = f", ratios to limits drawn to {picture}" if picture is not None else ""
        content = "series" if writes_terms else f"{len(motion.times)} rows"
        return [f"{shorten(arm.name)}: {content} written to {output}{drawn}", *str(excitation).splitlines()]

    print_result(lines, data, as_json)
