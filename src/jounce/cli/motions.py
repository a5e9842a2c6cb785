"""`jounce motion`, `slowdown`, `retime` and `excite`: motions, written as tables.

`motion` writes a motion with its rates, to inspect and to run. `slowdown` finds the fastest uniform pace, not above its
own, at which a motion keeps every limit. `retime` finds the fastest motion along the path of a motion, from rest to
rest. `excite` finds the motion within all limits that determines the parameters of the robot best.
"""

from dataclasses import asdict, replace
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.limits import DIFFERENCES, LIMITS, draw_ratios, load_robot, load_with_motion
from jounce.cli.motion_options import OPTION_FILES, MotionCommand, MotionRequest, add_motion_options, write_motion
from jounce.cli.output import align_columns, check_distinct, print_result
from jounce.cli.robot_options import (
    PATH,
    RobotRequest,
    add_robot_options,
    add_robot_options_without_drives,
    parse_drive_terms,
)
from jounce.cli.summaries import LargestValues, hidden_in_words
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
OUT contains t and NAME.q, NAME.qd, ... NAME.q4d; the samples NAME.q_sample
and the standard deviations NAME.q_sd, ..., if MOTION has them; and, if it has
breaks, the column break: the order of the derivative that jumps between the
previous row and this one.
"""


@click.command(
    cls=MotionCommand, epilog=MOTION_EPILOG, short_help="Write a motion with its rates, q to q4d, as a table."
)
@add_robot_options_without_drives
@add_motion_options
@click.option("-o", "--output", required=True, type=PATH, help="Output table: .csv or .npz.")
@click.option("--order", default=4, type=click.IntRange(0), help="Highest time derivative of q.")
@click.option("--save-read", type=PATH, metavar="FILE", help="Save how the table is read, for --read: .yaml.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def motion(
    robot: RobotRequest, motion: MotionRequest, output: Path, order: int, save_read: Path | None, as_json: bool
) -> None:
    """Write MOTION of ROBOT with its rates as a table that `jounce run` reads and `jounce plot` draws."""
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
    arm = robot.load()
    path = motion.load(arm, max(order - 2, 0))
    write_motion(output, path, arm.joint_names, order)
    if save_read is not None:
        write_options(save_read, motion)
    unit = writing.table_metadata(arm.mechanism, 0).unit
    windows = motion_channels.find_windows(path, order, Q_RATE_ORDER)
    peaks = find_motion_extremes(path, arm.joint_names, order, windows)
    values = LargestValues.of({motion.path.stem: peaks}, unit)
    hidden = find_hidden_vibrations(arm, path, order, "q")
    breaks = [found for found in path.breaks_to(order) if found.symbol != "contact"]
    first, last = float(path.times[0]), float(path.times[-1])
    residual = None if path.residual is None else float(path.residual.max())

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "source": path.source, "residual": residual,
            "notes": list(path.notes), "breaks": [found._asdict() for found in breaks],
            "hidden_vibrations": [asdict(one) for one in hidden], **values.json(),
            "output": str(output), "save_read": None if save_read is None else str(save_read),
            "states": len(path.times), "t": [first, last], "order": order,
        }  # fmt: skip

    def lines() -> list[str]:
        off = "" if residual is None else f", at most {residual:.2g} from what it is made of"
        count = len(breaks)
        return [
            f"{shorten(arm.name)} along {motion.path}: {len(path.times)} rows, t = {first:g} .. {last:g} s",
            path.source + off,
            *path.notes,
            *([f"{count} break{'s' * (count > 1)}; --json lists them, --blend replaces them"] if count else []),
            f"q to {rate_name('q', order)} written to {output}",
            *([f"options written to {save_read}, for --read"] if save_read else []),
            *(["", *values.table()] if values.largest else []),
            *hidden_in_words(hidden),
        ]

    print_result(lines, data, as_json)


def check_options_writable(path: Path) -> None:
    """Raise `JounceError` if options could not be written to a file, before any work is done."""
    from jounce.io import files

    if path.suffix.lower() not in OPTION_FILES:
        raise JounceError(f"{path}: unknown type of file {path.suffix!r} for --save-read; available: .yaml, .yml")
    files.check_writable(path)


def write_options(path: Path, motion: MotionRequest) -> None:
    """Write the options of a motion that differ from their defaults to a file that --read takes."""
    from jounce.io import files, robot_writing

    options = motion.options | {"blend": motion.blend, "step": motion.step}
    data = {name.rstrip("_").replace("_", "-"): value for name, value in options.items() if value not in (None, False)}
    with files.write_whole(path) as part:
        part.write_text(robot_writing.dump_yaml(data, flow=False), encoding="utf-8", newline="\n")


SLOWDOWN_EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce check iiwa14 slower.csv --limits iiwa14

\b
OUT holds t and NAME.q, NAME.qd, ... NAME.q4d of the motion at this pace. A
motion that keeps its limits stays as it is, and how much faster it could be
is printed; --up-to-limits makes it as fast. With --rate, and for --as
commands at the rate of the table, `jounce check --rate` finds every limit of
OUT kept.
"""
KEPT_RATE = click.option(
    "--rate", type=float, metavar="HZ",
    help="Keep limits as check --rate judges them, by differences of commands; OUT has a row per command.",
)  # fmt: skip


@click.command(cls=MotionCommand, epilog=SLOWDOWN_EPILOG, short_help="The pace at which a motion keeps every limit.")
@add_robot_options
@add_motion_options
@LIMITS
@KEPT_RATE
@DIFFERENCES
@click.option("--up-to-limits", is_flag=True, help="Make a motion faster too, as fast as its limits allow.")
@click.option("-o", "--output", type=PATH, help="Table of the slower motion: .csv or .npz.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def slowdown(
    robot: RobotRequest, motion: MotionRequest, limits: Path | None, rate: float | None, differences: int,
    up_to_limits: bool, output: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Find the largest factor of speed, at most 1, at which MOTION of ROBOT keeps all limits.

    Every smaller factor keeps them too; with --rate, and of measured samples, the factors that were tried do. Limits
    that samples decide at no speed are named.
    """
    from jounce.io import tables
    from jounce.motion.commands import find_commands

    if output is not None:
        tables.check_writable(output)
        check_distinct(output, motion.path)
    arm, path = load_with_motion(robot, motion, limits, 0 if rate is None else 1)
    if (commands := find_commands(path.curve)) and rate is None:
        rate = commands.rate
    slow = arm.slowdown(path, rate, differences, up_to_limits=up_to_limits)
    if output is not None:
        write_motion(output, select_rows(slow.motion, rate, None), arm.joint_names)
    before, after = path.duration, slow.motion.duration
    notes = [*path.notes, *slow.notes]

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "verdict": slow.verdict, "factor": slow.factor,
            "largest": slow.largest, "binding": slow.binding and slow.binding._asdict(), "duration": [before, after],
            "notes": notes, "rate": rate, "output": None if output is None else str(output),
        }  # fmt: skip

    def lines() -> list[str]:
        head = f"{shorten(arm.name)} along {motion.path}"
        written = [f"q to q4d written to {output}"] if output else []
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
    """The motion with the rows of a table: one per command at a rate, else in even steps, or its own."""
    import numpy as np

    if rate is not None:
        t = motion.sampled(rate).times
        return replace(motion, grid=np.unique(t.clip(max=motion.stop)))
    return motion if step is None else motion.with_step(step)


RETIME_EPILOG = """\b
Example:
  jounce slowdown iiwa14 paper --limits iiwa14 --step 0.02 -o slower.csv
  jounce retime iiwa14 slower.csv --limits iiwa14 -o fast.csv

\b
OUT holds t and NAME.q, NAME.qd, ... NAME.q4d, as `jounce motion` writes them.
With --rate `jounce check --rate` finds every limit of OUT kept.
"""


@click.command(
    cls=MotionCommand, epilog=RETIME_EPILOG, short_help="The fastest motion along a path, within all limits."
)
@add_robot_options
@add_motion_options
@LIMITS
@KEPT_RATE
@DIFFERENCES
@click.option("-o", "--output", required=True, type=PATH, help="Table to write: .csv or .npz.")
@click.option("--margin", default=0.01, help="Share of each limit that is left.")
@click.option(
    "--smooth/--no-smooth",
    default=True,
    help="Keep accelerations continuous; --no-smooth lets them jump, and is faster where all limits are of velocity,"
    " acceleration and effort.",
)
@click.option("--picture", type=PATH, help="Speed along the path with its limits: .png, .svg or .pdf.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def retime(
    robot: RobotRequest, motion: MotionRequest, limits: Path | None, rate: float | None, differences: int, output: Path,
    margin: float, smooth: bool, picture: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Write the fastest motion of ROBOT along the path of MOTION, from rest to rest, within all limits."""
    from jounce.figures import canvas
    from jounce.io import tables

    tables.check_writable(output)
    check_distinct(output, motion.path)
    if picture is not None:
        canvas.check_writable(picture)
    arm, given = load_with_motion(robot, motion, limits, 0 if rate is None else 1)
    found = arm.retime(given, margin, smooth, rate=rate, differences=differences)
    fast = select_rows(found.motion, rate, motion.step)
    write_motion(output, fast, arm.joint_names)
    if picture is not None:
        from jounce.figures.limit_pictures import draw_path_speed

        canvas.save(draw_path_speed(arm, given, found), picture)
    notes = [*given.notes, *found.notes]

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "motion": str(motion.path), "source": given.source, "margin": margin, "rate": rate,
            "given": given.duration, "duration": found.duration, "binding": [part._asdict() for part in found.binding],
            "jumps": found.jumps, "notes": notes, "output": str(output),
            "picture": None if picture is None else str(picture), "states": len(fast.times),
        }  # fmt: skip

    def lines() -> list[str]:
        rows: list[tuple[str, ...]] = [("decides", "limit", "|from [s]", "|to [s]")]
        for part in found.binding:
            rows.append((part.joint, part.limit.replace("_", " "), f"{part.start:.4f}", f"{part.stop:.4f}"))
        along, pictured = f"{shorten(arm.name)} along {motion.path}", f", drawn to {picture}" if picture else ""
        return [
            f"{along}: {given.duration:.6g} s -> {found.duration:.6g} s with a margin of {margin:.3g}",
            f"{len(fast.times)} rows written to {output}{pictured}",
            *([f"accelerations and efforts jump {found.jumps} times"] if found.jumps else []),
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
OUT.csv, .npz or .parquet holds t and NAME.q, NAME.qd, ... NAME.q4d; OUT.yaml
or .json the offsets, amplitudes and frequencies of the series.

\b
Nothing but its limits keeps the robot from obstacles and from itself: check
the motion before it runs, or narrow the ranges of positions by --limits.
"""


@click.command(epilog=EXCITE_EPILOG, short_help="A motion that excites the parameters of a robot, within all limits.")
@add_robot_options_without_drives
@LIMITS
@click.option("-o", "--output", required=True, type=PATH, help="Table or YAML file of the motion to write.")
@click.option("--period", metavar="S", default=10.0, help="Period of the Fourier series in s.")
@click.option("--periods", metavar="N", default=1, help="Number of periods.")
@click.option("--harmonics", metavar="N", default=5, help="Harmonics of the Fourier series.")
@click.option(
    "--drives",
    "terms",
    metavar="TERMS",
    help="Drive terms to identify too: all, or a list of armature, damping, friction, stribeck, spring, offset.",
)
@click.option(
    "--reach",
    metavar="RAD",
    default=pi,
    show_default="pi",
    help="Range to either side of 0 for revolute joints without position limits.",
)
@click.option("--margin", default=0.01, help="Share of each limit that is left.")
@click.option("--payload", is_flag=True, help="Determine a load, for `jounce payload`, instead of the robot itself.")
@click.option("--body", metavar="NAME", help="Body or link that carries the load of --payload; default: the last body.")
@click.option("--starts", metavar="N", default=5, help="Number of random starts.")
@click.option("--seed", default=0, help="Seed of the random starts.")
@click.option("--step", type=float, metavar="S", help="Time between rows in s; default: 1 ms.")
@click.option("--picture", type=PATH, help="Ratios to all limits over time: .png, .svg or .pdf.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def excite(
    robot: RobotRequest,
    limits: Path | None,
    output: Path,
    terms: str | None,
    payload: bool,
    body: str | None,
    step: float | None,
    picture: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Find the Fourier series of the joints of ROBOT that determines its parameters best, within all limits.

    It starts and ends at rest, so that it may be repeated. ROBOT needs limits: its own, or --limits.
    """
    from jounce.figures import canvas
    from jounce.io import files, tables
    from jounce.io.entries import DOCUMENT_SUFFIXES
    from jounce.io.motions import terms as analytic

    if body is not None and not payload:
        raise JounceError(f"--body {quote_value(body)} needs --payload: it names the body that carries the load")
    in_terms = output.suffix.lower() in DOCUMENT_SUFFIXES
    (files if in_terms else tables).check_writable(output)
    check_distinct(output, robot.path, limits)
    if picture is not None:
        canvas.check_writable(picture)
    arm = load_robot(robot, limits)
    columns = False if terms is None else parse_drive_terms(terms)
    with stage("starts of the search") as show:
        found = arm.excite(drives=columns, payload=payload and (body or True), progress=show, **options)
    motion = found.motion if step is None else found.motion.with_step(step)
    if in_terms:
        analytic.write(output, motion, arm.joint_names)
    else:
        write_motion(output, motion, arm.joint_names)
    if picture is not None:
        draw_ratios(arm, motion, picture)

    def data() -> "JsonObject":
        return {
            "robot": arm.name, "source": motion.source, "duration": motion.duration,
            "criterion": found.criterion, "condition": found.condition,
            "parameters": list(found.parameters), "unseen": list(found.unseen),
            "limits": [vars(row) | {"violations": list(row.violations)} for row in found.limits],
            "notes": list(found.notes), "output": str(output), "picture": None if picture is None else str(picture),
            "states": len(motion.times),
        }  # fmt: skip

    def lines() -> list[str]:
        drawn = f", ratios to limits drawn to {picture}" if picture else ""
        what = "series" if in_terms else f"{len(motion.times)} rows"
        return [f"{shorten(arm.name)}: {what} written to {output}{drawn}", *str(found).splitlines()]

    print_result(lines, data, as_json)
