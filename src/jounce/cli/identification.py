"""`jounce identify`, `payload` and `stiffness`: parameters of a robot from logs of measured torques.

`identify` finds inertial parameters and friction, from a log to a robot file. `payload` finds mass, centre of mass and
inertia of a load, from logs with it and without it. `stiffness` finds that of elastic joints, from a log of motors and
links. Each checks what it is to write before it reads, loads its logs, and prints what was found with its deviations;
warnings that are not among the notes of a result are passed on (`collect_notes`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import check_distinct, print_result
from jounce.cli.robot_options import (
    MOTION_NAME,
    PATH,
    RobotRequest,
    add_robot_options_without_drives,
    parse_drive_terms,
    values_by_joint,
)
from jounce.core.errors import JounceError, collect_warnings, warn

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject
    from jounce.identification import Identification, Payload
    from jounce.motion import Motion
    from jounce.robot import Robot


T = TypeVar("T", bound="Identification | Payload")
DEFAULT_TERMS = "damping,friction,stribeck,offset,load_friction"
IDENTIFY_EPILOG = """\b
Example, with the torques of a model as measured ones:
  jounce run iiwa14 paper --order 0 --rates -o log.csv
  jounce identify iiwa14 log.csv --torques '{joint}.Q' -o found.yaml

\b
MOTION is a log: a table with a column t, one column of positions per joint
and one of measured torques, tau_JOINT, JOINT.tau or named by --torques. If it
is a folder, all tables and bags in it are logs of one fit.
ROBOT is a first guess, such as the CAD model: what the log does not determine
stays near to it. OUT is a robot file for `jounce run OUT ... --drives all`:
its bodies can exist, and its drives have the friction found. Deviations are
those of the data alone; parameters that they do not determine are listed.
"""


@click.command(
    cls=MotionCommand, epilog=IDENTIFY_EPILOG, short_help="Identify inertial parameters and friction from a log."
)
@add_robot_options_without_drives
@add_motion_options
@click.option("-o", "--output", required=True, type=PATH, help="Robot file to write: .yaml or .json.")
@click.option(
    "--drives",
    "terms",
    default=DEFAULT_TERMS,
    metavar="TERMS",
    help="Drive terms to identify: all, none, or a list, as of --drives of `jounce run`.",
)
@click.option("--span", type=float, nargs=2, metavar="S S", help="Use samples between these times; others test it.")
@click.option(
    "--test",
    "tests",
    type=PATH,
    multiple=True,
    metavar="LOG",
    help="Log that only tests the result: its name in the folder MOTION, or another path. Repeatable.",
)
@click.option(
    "--band",
    type=float,
    metavar="HZ",
    help="Highest frequency of the forces to use; default: nearly all the model's power is below.",
)
@click.option(
    "--eps",
    type=float,
    metavar="SPEED",
    help="Smoothing velocity of friction, rad/s or m/s; default: per joint, by the data.",
)
@click.option(
    "--deviation", "deviations", type=float, metavar="N", help="Standard deviation of the torques; default: residuals."
)
@click.option("--prior", type=float, default=0.3, help="Relative deviation of the robot's own data.")
@click.option(
    "--delay", type=float, metavar="S", help="By how much torques come after positions; default: found, if certain."
)
@click.option("--table", type=PATH, help="Write the parameters with deviations: .csv.")
@click.option("--plot", type=PATH, help="Measured and predicted torques as a picture: .png, .svg or .pdf.")
@click.option("--report", type=PATH, help="Page with torques, what is left of them, its spectra, parameters: .html.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def identify(
    robot: RobotRequest,
    motion: MotionRequest,
    output: Path,
    terms: str,
    tests: tuple[Path, ...],
    table: Path | None,
    plot: Path | None,
    report: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Identify ROBOT from MOTION, a log with measured torques or a folder of them: inertial parameters and friction."""
    from jounce.figures import canvas
    from jounce.io import files
    from jounce.robot import saving

    saving.check_writable(output)
    logs, tested, ignored = _find_logs(motion.path, tests)
    for path in filter(None, (output, table, plot, report)):
        check_distinct(path, motion.path, robot.path, motion.read, *logs.values())
    if table is not None:
        if table.suffix.lower() != ".csv":
            raise JounceError(f"{table}: unknown type of table {table.suffix!r} for --table; available: .csv")
        files.check_writable(table)
    if plot is not None:
        canvas.check_writable(plot)
    if report is not None:
        from jounce._report import page  # imported here to keep start-up fast

        page.check_writable(report)
        page.check_installed()
    arm = robot.load()
    motions = {name: replace(motion, path=path).load(arm, 0) for name, path in logs.items()}
    given = motions.get("", motions)
    found = collect_notes(lambda: arm.identify(given, drives=parse_drive_terms(terms), test=tested, **options))
    saving.save(found.robot, output)
    if table is not None:
        _write_table(found, table)
    if plot is not None:
        _draw(found, plot)
    if report is not None:
        page.report(found.robot, found, None, None, (), motion.path.name).save(report)
    notes = (*ignored, *(f"{name}: {note}" if name else note for name, log in motions.items() for note in log.notes))
    print_identification(found, motion.path, notes, output, as_json, table=table, plot=plot, report=report)


def collect_notes(identify: Callable[[], T]) -> T:
    """What an identification finds; warnings that are not among its notes, which are printed, are passed on."""
    with collect_warnings() as warnings:
        found = identify()
    for text in warnings:
        if text not in found.notes:
            warn(text)
    return found


def print_identification(
    found: "Identification", log: Path, notes: tuple[str, ...], output: Path, as_json: bool, **written: Path | None
) -> None:
    """Print what was identified from a log, and the files that were written besides the robot."""
    files = {"output": output, **written}

    def lines() -> list[str]:
        made = [f"{what} written to {files[key]}" for key, what in WRITTEN.items() if files.get(key)]
        return [*(note for note in notes if note not in found.notes), *str(found).splitlines(), "", *made]

    print_result(lines, lambda: _identification_json(found, log, notes, files), as_json)


def _find_logs(motion: Path, tests: tuple[Path, ...]) -> tuple[dict[str, Path], list[str], tuple[str, ...]]:
    """The paths of the logs by name, "" of the only one; the names of those that only test, and notes."""
    from jounce.io.motions import list_logs
    from jounce.io.motions.logs import is_bag

    notes: tuple[str, ...] = ()
    tested, logs = [], {motion.name if tests else "": motion}
    if motion.is_dir() and not is_bag(motion):
        found, notes = list_logs(motion)
        logs = {path.name: path for path in found}
    for path in tests:
        known = {log.resolve(): name for name, log in logs.items()}
        outside = str(path) if path.name in logs else path.name
        name = str(path) if str(path) in logs else known.get(path.resolve(), outside)
        tested.append(name)
        logs.setdefault(name, path)
    return logs, tested, notes


def _write_table(found: "Identification", table: Path) -> None:
    """Write the parameters as a table of texts and numbers; deviations may be infinite."""
    import numpy as np

    from jounce.io import files, tables

    rows = [asdict(row) for row in found.table]
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    with files.write_whole(table) as part:
        tables.CSV.write(part, [columns | {"seen": columns["seen"].astype(int)}])


def _draw(found: "Identification", picture: Path) -> None:
    from jounce.figures import canvas
    from jounce.figures.measured_forces import draw_measured_forces

    canvas.save(draw_measured_forces(found), picture)


def _identification_json(
    found: "Identification", log: Path, notes: tuple[str, ...], files: Mapping[str, Path | None]
) -> "JsonObject":
    joints = found.robot.mechanism.joints
    return {
        "robot": found.robot.name, "motion": str(log), **{what: path and str(path) for what, path in files.items()},
        "samples": found.samples, "span": list(found.span), "band": found.band, "cell": found.cell,
        "cells": found.cells, "logs": [{k: x for k, x in asdict(of).items() if k != "rows"} for of in found.logs],
        "delay": found.delay, "rank": found.rank, "condition": found.condition, "unseen": list(found.unseen),
        "parameters": [asdict(row) for row in found.table],
        "drives": {name: dict(zip(joints, x.tolist(), strict=True)) for name, x in vars(found.robot.drives).items()},
        "residuals": [asdict(row) for row in found.residuals],
        "notes": [*notes, *found.notes], "assumed": found.assumption,
    }  # fmt: skip


WRITTEN = {"output": "robot", "table": "parameters", "plot": "torques", "report": "page"}
PAYLOAD_EPILOG = """\b
Example, with the torques of a model as measured ones, hence no load:
  jounce run iiwa14 paper --order 0 --rates -o log.csv
  jounce payload iiwa14 log.csv --torques '{joint}.Q'

\b
MOTION is a log with the load, WITHOUT one of the same robot without it, both
tables as `jounce identify` reads them; `jounce excite --payload` finds their
motion. Without a second log ROBOT is taken as it is: the file that
`jounce identify` wrote. The load is described in the frame of its body or
link: name the flange by --body, and the last lines are what a Franka, a UR
and an iiwa take. Deviations are those of the logs; column "body" holds the
nearest body that can exist.
"""


@click.command(cls=MotionCommand, epilog=PAYLOAD_EPILOG, short_help="Identify the payload of a robot from logs.")
@add_robot_options_without_drives
@add_motion_options
@click.argument("without", type=MOTION_NAME, required=False)
@click.option("-o", "--output", type=PATH, help="Robot file with the load to write: .yaml or .json.")
@click.option("--body", metavar="NAME", help="Body or link that carries the load; default: the last body.")
@click.option(
    "--drives",
    "terms",
    default=DEFAULT_TERMS,
    metavar="TERMS",
    help="Drive terms that each log has its own of: all, none, or a list as of `jounce identify`.",
)
@click.option("--mass", type=float, metavar="KG", help="Known mass of the load: calibrate torques by it, per joint.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def payload(
    robot: RobotRequest,
    motion: MotionRequest,
    without: Path | None,
    output: Path | None,
    body: str | None,
    terms: str,
    mass: float | None,
    as_json: bool,
) -> None:
    """Identify the load that ROBOT carries in MOTION, a log with measured torques, and not in the log WITHOUT."""
    from jounce.robot import saving

    if output is not None:
        saving.check_writable(output)
        check_distinct(output, motion.path, without, robot.path, motion.read)
    arm = robot.load()
    logs = [log.load(arm, 0) for log in (motion, *([replace(motion, path=without)] if without else []))]
    found = collect_notes(lambda: arm.payload(*logs, body=body, drives=parse_drive_terms(terms), mass=mass))
    if output is not None:
        saving.save(found.robot, output)
    written = [] if output is None else ["", f"robot written to {output}"]
    lines = [*str(found).splitlines(), *written]
    print_result(lambda: lines, lambda: _payload_json(found, motion.path, without, output), as_json)


def _payload_json(found: "Payload", log: Path, without: Path | None, output: Path | None) -> "JsonObject":

    def pair(what: str, x: float, spread: float) -> dict[str, float]:
        return {what: float(x), "deviation": float(spread)}

    names = found.robot.joint_names
    of_joints = found.factors and zip(names, *(x[-len(names) :] for x in found.factors), strict=True)
    return {
        "robot": found.robot.name, "motion": str(log), "without": without and str(without),
        "output": output and str(output), "frame": found.frame, "mass": found.mass, "com": found.com.tolist(),
        "inertia": found.inertia.tolist(),
        "parameters": [asdict(row) for row in found.table],
        "unseen": list(found.unseen), "mismatch": found.mismatch,
        "factors": of_joints and {name: pair("value", c, s) for name, c, s in of_joints},
        "halves": [pair("mass", m, s) for m, s in found.halves], "settings": found.settings, "notes": list(found.notes),
        "assumed": found.assumption,
    }  # fmt: skip


IRRELEVANT_NOTES = ("other columns", "derivatives are trustworthy")  # each motion has columns of the other
STIFFNESS_EPILOG = """\b
Example, of motors and links along a motion, as in a log:
  jounce motors iiwa14 paper --stiffness 9000 --rotor 1e-6 --rates -o log.csv
  jounce stiffness iiwa14 log.csv --motors {joint}.theta --rotor 1 -o k.yaml

\b
MOTION is a log of links and motors, at the same times: a table as `jounce
identify` reads it, with a column of the position of each motor. Torques are
those that the springs carry, as sensors behind the gears measure them; those
of the model serve at joints without a column. OUT is a robot with elastic
joints for `jounce motors`.
"""


@click.command(
    cls=MotionCommand, epilog=STIFFNESS_EPILOG, short_help="Identify the stiffness of elastic joints from a log."
)
@add_robot_options_without_drives
@add_motion_options
@click.option("-o", "--output", required=True, type=PATH, help="Robot file to write: .yaml or .json.")
@click.option(
    "--motors", "pattern", default="theta_{joint}", metavar="PATTERN", help="Names of the columns of motor positions."
)
@click.option(
    "--gear",
    multiple=True,
    metavar="[JOINT=]N",
    help="Motor over joint speed, where columns are angles of motors in front of gears; may be repeated.",
)
@click.option(
    "--rotor",
    multiple=True,
    metavar="[JOINT=]B",
    help="Inertia of the rotors seen from the links in kg m^2 or kg, if ROBOT states none; may be repeated.",
)
@click.option(
    "--delay", type=float, metavar="S", help="By how much torques come after positions; default: found, if certain."
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def stiffness(
    robot: RobotRequest,
    motion: MotionRequest,
    output: Path,
    pattern: str,
    gear: Sequence[str],
    rotor: Sequence[str],
    delay: float | None,
    as_json: bool,
) -> None:
    """Identify the stiffness of the joints of ROBOT from MOTION, a log of positions of motors and links."""
    from jounce.robot import saving

    saving.check_writable(output)
    check_distinct(output, motion.path, robot.path, motion.read)
    arm = robot.load()
    gears, rotors = (values_by_joint(*given, arm.joint_names) for given in (("--gear", gear), ("--rotor", rotor)))
    links = motion.load(arm, 0)
    motors = _load_motors(motion, arm, pattern)
    found = collect_notes(lambda: arm.identify_stiffness(links, motors, gear=gears or 1.0, rotor=rotors, delay=delay))
    saving.save(found.robot, output)
    notes = dict.fromkeys(note for note in (*links.notes, *motors.notes) if not note.startswith(IRRELEVANT_NOTES))
    print_identification(found, motion.path, tuple(notes), output, as_json)


def _load_motors(motion: MotionRequest, arm: "Robot", pattern: str) -> "Motion":
    """The motion of the motors, of which no rates are taken.

    Motors in front of gears turn far without being in degrees: angles without a unit are in rad, and are compared with
    those of the links later.
    """
    options = motion.options | {"columns": pattern, "allow_noise": True}
    if options["angles"] is None:
        try:
            return replace(motion, options=options | {"angles": "rad"}).load(arm, 0)
        except JounceError:
            pass  # columns may state their unit, and what else is wrong is said below
    try:
        return replace(motion, options=options).load(arm, 0)
    except JounceError as error:
        raise JounceError(str(error).replace("--columns", "--motors")) from None
