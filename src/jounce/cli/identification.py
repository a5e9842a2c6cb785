"""`jounce identify`, `payload` and `stiffness`: parameters of a robot from logs of measured torques.

`identify` finds inertial parameters and friction, from a log to a robot file. `payload` finds mass, centre of mass and
inertia of a load, from logs with the load and without it. `stiffness` finds the stiffness of elastic joints, from a log
of motors and links. Each command checks its outputs before it reads, loads its logs, and prints the result with its
deviations; warnings that are not among the notes of a result are passed on (`collect_notes`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from jounce.cli.commands import Command, split_names
from jounce.cli.motion_options import MotionRequest, add_motion_options
from jounce.cli.output import check_distinct, print_result
from jounce.cli.robot_options import (
    MOTION_NAME,
    PATH,
    RobotRequest,
    add_robot_options_without_drives,
    parse_drive_terms,
    values_by_joint,
)
from jounce.core.errors import JounceError, collect_warnings, join_names, warn

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject
    from jounce.identification import Identification, Payload
    from jounce.motion import Motion
    from jounce.motion.poses import Poses
    from jounce.robot import Robot


HOLDS_HELP = "Use only the stretches in which all joints rest."
T = TypeVar("T", bound="Identification | Payload")
AS_GIVEN = click.option("--torques-as-given", is_flag=True, help="Accept torques of any scale.")
DEFAULT_TERMS = ("damping", "friction", "stribeck", "offset", "load_friction")
IDENTIFY_EPILOG = """\b
Example, with the torques of a model as measured ones:
  jounce run iiwa14 paper --order 0 --rates -o log.csv
  jounce identify iiwa14 log.csv --torques '{joint}.Q' -o found.yaml

\b
MOTION is a log: a table with a column t and, for each joint, a column of
positions and a column of measured torques, tau_JOINT, JOINT.tau or named by
--torques. Tables and bags in a folder, and episodes, are logs of one fit.
Rows of a table without times are poses at rest, as --holds takes from a log.
ROBOT is a first guess, such as the CAD model: parameters that the log does
not determine stay near it. OUT is a robot file for `jounce run OUT ...
--drives all`: the identified inertias are physically consistent, and the
identified friction is included. Deviations are those of the data alone;
parameters that the data do not determine are listed.
"""


@click.command(
    cls=Command,
    former={"--plot": "--picture"},
    epilog=IDENTIFY_EPILOG,
    short_help="Identify inertial parameters and friction from a log.",
)
@add_robot_options_without_drives
@add_motion_options
@click.option("-o", "--output", required=True, type=PATH, help="Robot file to write: .yaml or .json.")
@click.option(
    "--drives",
    "terms",
    multiple=True,
    callback=split_names,
    default=DEFAULT_TERMS,
    metavar="TERMS",
    help="Drive terms to identify: all, none, or a list as for `jounce run --drives`.",
)
@click.option(
    "--span",
    type=float,
    nargs=2,
    metavar="S S",
    help="Use samples between these times; the others validate the result.",
)
@click.option(
    "--test",
    "tests",
    type=PATH,
    multiple=True,
    metavar="LOG",
    help="Log used for validation only: a file in the folder MOTION, or any path. Repeatable.",
)
@click.option(
    "--band",
    type=float,
    metavar="HZ",
    help="Use torques up to this frequency; default: the band that contains almost all predicted power.",
)
@click.option(
    "--eps",
    type=float,
    metavar="SPEED",
    help="Smoothing velocity of friction, rad/s or m/s; default: estimated from the log, per joint.",
)
@click.option(
    "--deviation",
    "deviations",
    type=float,
    metavar="N",
    help="Standard deviation of the torques; default: estimated from the residuals.",
)
@click.option("--holds", is_flag=True, help=HOLDS_HELP)
@click.option("--prior", type=float, default=0.3, help="Relative standard deviation of the parameters of ROBOT.")
@click.option(
    "--delay",
    type=float,
    metavar="S",
    help="Delay of the torque signal relative to position, in s; default: estimated from the log.",
)
@AS_GIVEN
@click.option("--table", type=PATH, help="Write the parameters with deviations: .csv.")
@click.option("--picture", type=PATH, help="Draw measured and predicted torques: .png, .svg or .pdf.")
@click.option("--report", type=PATH, help="Write a page with torques, residuals, spectra and parameters: .html.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def identify(
    robot: RobotRequest,
    motion: MotionRequest,
    output: Path,
    terms: tuple[str, ...],
    tests: tuple[Path, ...],
    holds: bool,
    table: Path | None,
    picture: Path | None,
    report: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Identify inertial parameters and friction of ROBOT from MOTION.

    MOTION is a log with measured torques, or a folder of logs.
    """
    from jounce.figures import canvas
    from jounce.io import files
    from jounce.motion.poses import Poses
    from jounce.robot import saving

    # All outputs are checked first, since a fit may take minutes.
    saving.check_writable(output)
    logs, tested, ignored = _find_logs(motion, tests)
    for path in filter(None, (output, table, picture, report)):
        check_distinct(path, motion.path, robot.path, motion.read, *(log.path for log in logs.values()))
    if table is not None:
        if table.suffix.lower() != ".csv":
            raise JounceError(f"{table}: unknown type of table {table.suffix!r} for --table; available: .csv")
        files.check_writable(table)
    if picture is not None:
        canvas.check_writable(picture)
    if report is not None:
        from jounce._report import page  # imported here to keep start-up fast

        page.check_writable(report)
        page.check_installed()
    # A single log has no name: it is passed as it is.
    arm = robot.load()
    motions = {name: log.load_log(arm, holds) for name, log in logs.items()}
    logged = _choose_logs(motions)
    if report is not None:
        page.refuse_poses(isinstance(logged, Poses))
    identification = collect_notes(
        lambda: arm.identify(logged, drives=parse_drive_terms(terms), test=tested, **options)
    )
    saving.save(identification.robot, output)
    if table is not None:
        _write_table(identification, table)
    if picture is not None:
        _draw(identification, picture)
    if report is not None:
        page.report(identification.robot, identification, None, None, (), motion.path.name).save(report)
    notes = (*ignored, *(f"{name}: {note}" if name else note for name, log in motions.items() for note in log.notes))
    print_identification(
        identification, motion.path, notes, output, as_json, table=table, picture=picture, report=report
    )


def _choose_logs(logs: "Mapping[str, Motion | Poses]") -> "Motion | Poses | dict[str, Motion]":
    """Return logs by name, or the only one."""
    from jounce.motion import Motion

    motions = {name: log for name, log in logs.items() if isinstance(log, Motion)}
    if "" not in logs and len(motions) == len(logs):
        return motions
    if len(logs) > 1:
        came = f"{join_names(logs)} are {len(logs)} logs, some of them of poses at rest"
        raise JounceError(f"{came}; expected one: join tables of poses, and identify from motions apart from poses")
    return next(iter(logs.values()))


def collect_notes(identify: Callable[[], T]) -> T:
    """Return the result of an identification, and pass its warnings on.

    Warnings that are among the notes of the result are printed with them.
    """
    with collect_warnings() as warnings:
        result = identify()
    for text in warnings:
        if text not in result.notes:
            warn(text)
    return result


def print_identification(
    identification: "Identification",
    log: Path,
    notes: tuple[str, ...],
    output: Path,
    as_json: bool,
    **further_files: Path | None,
) -> None:
    """Print an identification, with the files that were written."""
    files = {"output": output, **further_files}

    def lines() -> list[str]:
        file_lines = [f"{what} written to {files[key]}" for key, what in WRITTEN.items() if files.get(key) is not None]
        return [
            *(note for note in notes if note not in identification.notes),
            *str(identification).splitlines(),
            "",
            *file_lines,
        ]

    print_result(lines, lambda: _identification_json(identification, log, notes, files), as_json)


def _find_logs(
    motion: MotionRequest, tests: tuple[Path, ...]
) -> tuple[dict[str, MotionRequest], list[str], tuple[str, ...]]:
    """Return the logs by name, the names of validation logs, and notes.

    A single log has the name "". Each episode of a data set is a log, unless one of them is selected.
    """
    from jounce.io.motions import list_logs
    from jounce.io.motions.episodes import list_episodes
    from jounce.io.motions.logs import is_bag

    notes: tuple[str, ...] = ()
    tested, logs = [], {motion.path.name if tests else "": motion}
    is_selected = motion.options["episode"] is not None
    episodes = {} if is_selected else list_episodes(motion.path)
    if len(episodes) > 1:
        logs = {f"episode {k}": replace(motion, options=motion.options | {"episode": k}) for k in sorted(episodes)}
    elif motion.path.is_dir() and not is_bag(motion.path) and not is_selected and len(episodes) == 0:
        paths, notes = list_logs(motion.path)
        logs = {path.name: replace(motion, path=path) for path in paths}
    # A log of --test is one of the folder, by its name or path, or a further one, which must not take another's name.
    for path in tests:
        names_by_path = {log.path.resolve(): name for name, log in logs.items()}
        unique_name = str(path) if path.name in logs else path.name
        name = str(path) if str(path) in logs else names_by_path.get(path.resolve(), unique_name)
        tested.append(name)
        logs.setdefault(name, replace(motion, path=path))
    return logs, tested, notes


def _write_table(identification: "Identification", table: Path) -> None:
    """Write the parameters as a table; deviations may be infinite."""
    import numpy as np

    from jounce.io import files, tables

    rows = [asdict(row) for row in identification.table]
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    with files.write_whole(table) as part:
        tables.CSV.write(part, [columns | {"seen": columns["seen"].astype(int)}])


def _draw(identification: "Identification", picture: Path) -> None:
    from jounce.figures import canvas
    from jounce.figures.measured_forces import draw_measured_forces

    canvas.save(draw_measured_forces(identification), picture)


def _identification_json(
    result: "Identification", log: Path, notes: tuple[str, ...], files: Mapping[str, Path | None]
) -> "JsonObject":
    joints = result.robot.mechanism.joints
    return {
        "robot": result.robot.name, "motion": str(log),
        **{key: None if path is None else str(path) for key, path in files.items()},
        **_sampling_json(result), "rank": result.rank, "condition": result.condition, "unseen": list(result.unseen),
        "undetermined": list(result.undetermined), "parameters": [asdict(row) for row in result.table],
        "drives": {name: dict(zip(joints, x.tolist(), strict=True)) for name, x in vars(result.robot.drives).items()},
        "residuals": [asdict(row) for row in result.residuals],
        "notes": list(dict.fromkeys([*notes, *result.notes])), "assumed": result.assumption,
    }  # fmt: skip


def _sampling_json(result: "Identification") -> "JsonObject":
    """Return the samples and times of the data: poses at rest have none."""
    if result.at_rest:
        names = ("samples", "span", "band", "cell", "cells", "logs", "delay")
        return {"poses": result.samples, **dict.fromkeys(names)}
    return {
        "poses": None, "samples": result.samples, "span": list(result.span), "band": result.band, "cell": result.cell,
        "cells": result.cells,
        "logs": [{k: x for k, x in asdict(log_result).items() if k != "rows"} for log_result in result.logs],
        "delay": result.delay,
    }  # fmt: skip


WRITTEN = {"output": "robot", "table": "parameters", "picture": "torques", "report": "page"}
PAYLOAD_EPILOG = """\b
Example, with the torques of a model as measured ones, hence no load:
  jounce run iiwa14 paper --order 0 --rates -o log.csv
  jounce payload iiwa14 log.csv --torques '{joint}.Q'

\b
MOTION is a log with the load, WITHOUT a log of the same robot without the
load. Both are tables as for `jounce identify`, of motions or of poses at
rest, which determine mass and centre of mass; `jounce excite --payload`
finds a motion for them. If there is no second log, ROBOT must be accurate:
the file that `jounce identify` wrote. The load is described in the frame of
its body or link: name the flange by --body, and the last lines are the
settings for a Franka, a UR and an iiwa. Deviations are those of the logs. The
column "body" holds the nearest physically consistent body.
"""


@click.command(cls=Command, epilog=PAYLOAD_EPILOG, short_help="Identify the payload of a robot from logs.")
@add_robot_options_without_drives
@add_motion_options
@click.argument("without", type=MOTION_NAME, required=False)
@click.option("-o", "--output", type=PATH, help="Robot file with the load to write: .yaml or .json.")
@click.option("--body", metavar="NAME", help="Body or link that carries the load; default: the last body.")
@click.option(
    "--drives",
    "terms",
    multiple=True,
    callback=split_names,
    default=DEFAULT_TERMS,
    metavar="TERMS",
    help="Drive terms to identify separately in each log: all, none, or a list as for `jounce identify`.",
)
@click.option(
    "--mass", type=float, metavar="KG", help="Known mass of the load; the torques are calibrated by it, per joint."
)
@click.option("--holds", is_flag=True, help=HOLDS_HELP)
@AS_GIVEN
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def payload(
    robot: RobotRequest,
    motion: MotionRequest,
    without: Path | None,
    output: Path | None,
    body: str | None,
    terms: tuple[str, ...],
    mass: float | None,
    holds: bool,
    torques_as_given: bool,
    as_json: bool,
) -> None:
    """Identify the load that ROBOT carries in MOTION but not in WITHOUT.

    Both are logs with measured torques.
    """
    from jounce.robot import saving

    if output is not None:
        saving.check_writable(output)
        check_distinct(output, motion.path, without, robot.path, motion.read)
    arm = robot.load()
    logs = [motion.load_log(arm, holds)]
    if without is not None:
        logs.append(replace(motion, path=without).load_log(arm, holds))
    options = {"body": body, "drives": parse_drive_terms(terms), "mass": mass, "torques_as_given": torques_as_given}
    result = collect_notes(lambda: arm.payload(*logs, **options))
    if output is not None:
        saving.save(result.robot, output)
    output_lines = [] if output is None else ["", f"robot written to {output}"]
    lines = [*str(result).splitlines(), *output_lines]
    print_result(lambda: lines, lambda: _payload_json(result, motion.path, without, output), as_json)


def _payload_json(result: "Payload", log: Path, without: Path | None, output: Path | None) -> "JsonObject":
    """Return a payload as plain data."""

    def pair(key: str, x: float, deviation: float) -> dict[str, float]:
        return {key: float(x), "deviation": float(deviation)}

    # Factors of the base, if there are any, come before those of the joints.
    names = result.robot.joint_names
    factors = None
    if result.factors is not None:
        values, deviations = (x[-len(names) :] for x in result.factors)
        factors = {name: pair("value", c, s) for name, c, s in zip(names, values, deviations, strict=True)}
    return {
        "robot": result.robot.name, "motion": str(log), "without": None if without is None else str(without),
        "output": None if output is None else str(output), "frame": result.frame, "mass": result.mass,
        "com": result.com.tolist(), "inertia": None if result.at_rest else result.inertia.tolist(),
        "parameters": [asdict(row) for row in result.table],
        "unseen": list(result.unseen), "mismatch": result.mismatch,
        "factors": factors,
        "halves": [pair("mass", m, s) for m, s in result.halves], "settings": result.settings,
        "notes": list(result.notes),
        "assumed": result.assumption,
    }  # fmt: skip


IRRELEVANT_NOTES = ("other columns", "derivatives are trustworthy")  # each motion has columns of the other
STIFFNESS_EPILOG = """\b
Example, of motors and links along a motion, as in a log:
  jounce motors iiwa14 paper --stiffness 9000 --rotor 1e-6 --rates -o log.csv
  jounce stiffness iiwa14 log.csv --motors {joint}.theta --rotor 1 -o k.yaml

\b
MOTION is a log of links and motors at the same times: a table as for `jounce
identify`, with a column for the position of each motor, or by --deflections
for the deflection of each spring, link less gear. Torques are those of the
springs, as measured behind the gears; joints without a column of torques use
the torques of the model. With --deflections, some joint needs a column. OUT
is a robot with elastic joints for `jounce motors`.
"""


@click.command(cls=Command, epilog=STIFFNESS_EPILOG, short_help="Identify the stiffness of elastic joints from a log.")
@add_robot_options_without_drives
@add_motion_options
@click.option("-o", "--output", required=True, type=PATH, help="Robot file to write: .yaml or .json.")
@click.option("--motors", metavar="PATTERN", help="Pattern of the columns of motor positions; default: theta_{joint}.")
@click.option(
    "--deflections",
    metavar="PATTERN",
    help="Pattern of the columns of spring deflections, link less gear, in place of motors: '{joint}.deflection'.",
)
@click.option(
    "--gear",
    multiple=True,
    metavar="[JOINT=]N",
    help="Gear ratio, motor over joint speed, if the columns hold angles of motors in front of the gears. Repeatable.",
)
@click.option(
    "--rotor",
    multiple=True,
    metavar="[JOINT=]B",
    help="Rotor inertia reflected to the link, in kg m^2 or kg; default: the armature in ROBOT. Repeatable.",
)
@click.option(
    "--delay",
    type=float,
    metavar="S",
    help="Delay of the torque signal relative to position, in s; default: estimated from the log.",
)
@AS_GIVEN
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def stiffness(
    robot: RobotRequest,
    motion: MotionRequest,
    output: Path,
    motors: str | None,
    deflections: str | None,
    gear: Sequence[str],
    rotor: Sequence[str],
    delay: float | None,
    torques_as_given: bool,
    as_json: bool,
) -> None:
    """Identify the joint stiffness of ROBOT from MOTION.

    MOTION is a log of links, and of motors or deflections.
    """
    from jounce.robot import saving

    saving.check_writable(output)
    check_distinct(output, motion.path, robot.path, motion.read)
    arm = robot.load()
    gears, rotors = (values_by_joint(*words, arm.joint_names) for words in (("--gear", gear), ("--rotor", rotor)))
    links = motion.load(arm, 0)
    if motors is not None and deflections is not None:
        raise JounceError("both --motors and --deflections are given; expected one of them")
    if deflections is None:
        springs: dict[str, Any] = {"motors": _load_positions(motion, arm, "--motors", motors or "theta_{joint}")}
    else:
        springs = {"deflections": _load_positions(motion, arm, "--deflections", deflections)}
    options: dict[str, Any] = {"rotor": rotors, "delay": delay, "torques_as_given": torques_as_given}
    result = collect_notes(lambda: arm.identify_stiffness(links, **springs, gear=gears or 1.0, **options))
    saving.save(result.robot, output)
    all_notes = (*links.notes, *(note for spring in springs.values() for note in spring.notes))
    notes = dict.fromkeys(note for note in all_notes if not note.startswith(IRRELEVANT_NOTES))
    print_identification(result, motion.path, tuple(notes), output, as_json)


def _load_positions(motion: MotionRequest, arm: "Robot", option: str, pattern: str) -> "Motion":
    """Return the motion of motors or deflections, whose rates are not used.

    Motors in front of gears turn far, which looks like degrees: angles without a unit are taken as rad. They are
    compared with the angles of the links later.
    """
    # Noise does not matter: only positions are used.
    options = motion.options | {"columns": pattern, "allow_noise": True}
    if options["angles"] is None:
        try:
            return replace(motion, options=options | {"angles": "rad"}).load(arm, 0)
        except JounceError:
            # Columns may state their own unit. Other errors are raised again below.
            pass
    try:
        return replace(motion, options=options).load(arm, 0)
    except JounceError as error:
        raise JounceError(str(error).replace("--columns", option)) from None
