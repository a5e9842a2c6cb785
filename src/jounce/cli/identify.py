"""`jounce identify`: inertial parameters and friction from measured torques, from a log to a robot file."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from jounce.cli.motion_options import MotionCommand, MotionRequest, add_motion_options
from jounce.cli.output import check_distinct, print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options_without_drives, parse_drive_terms
from jounce.core.errors import JounceError, collect_warnings, warn

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject
    from jounce.identification import Identification, Payload

T = TypeVar("T", bound="Identification | Payload")
DEFAULT = "damping,friction,stribeck,offset,load_friction"

EPILOG = """\b
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


@click.command(cls=MotionCommand, epilog=EPILOG, short_help="Identify inertial parameters and friction from a log.")
@add_robot_options_without_drives
@add_motion_options
@click.option("-o", "--output", required=True, type=PATH, help="Robot file to write: .yaml or .json.")
@click.option(
    "--drives",
    "terms",
    default=DEFAULT,
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

    print_result(lines, lambda: _json(found, log, notes, files), as_json)


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


def _json(found: "Identification", log: Path, notes: tuple[str, ...], files: Mapping[str, Path | None]) -> "JsonObject":
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
