"""`jounce motors`: positions, velocities and torques of the motors behind elastic joints along a motion."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.breaks import break_data, breaks_in_words
from jounce.cli.motions import AskedMotion, of_motion
from jounce.cli.options import Asked, on_robot
from jounce.cli.output import progress, straight_columns, tell
from jounce.errors import JounceError, quoted, shortened

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np

    from jounce.actuators.elastic import ElasticRobot
    from jounce.io.columns import Columns
    from jounce.motion import Motion
    from jounce.robot.along import ForceBreak

    Peaks = dict[str, tuple[np.ndarray, np.ndarray]]  # by name: the largest values (n,) and their deviations

HIGHEST = 2  # the rate of Q that torques of motors take

EPILOG = """\b
Example:
  jounce motors iiwa14 paper --stiffness 10000 --rotor 0.5 -o motors.csv

\b
OUT holds t and, seen from the links,
  NAME.theta, NAME.thetad  position and velocity of the motor, rad or m, per s
  NAME.tau                 torque of the motor, N m, or N
and their standard deviations, NAME.theta_sd, ..., if the motion is smoothed.
It has a column break, if tau jumps or does not exist, as jounce run has.

\b
The motion needs q to q4d. A rotor's inertia is that seen from the link: its
own times the gear ratio squared; the default is the armature of the file.
Damping and friction that --drives selects act on the motors.
"""


@click.command(epilog=EPILOG, short_help="Positions and torques of the motors of elastic joints along a motion.")
@on_robot
@of_motion
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
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Output table: .csv or .npz.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def motors(
    robot: Asked,
    motion: AskedMotion,
    stiffness: Sequence[str],
    rotor: Sequence[str],
    output: Path,
    as_json: bool,
) -> None:
    """Compute positions, velocities and torques of the motors of ROBOT, whose joints are elastic, along MOTION."""
    from jounce.dynamics.quantities import QUANTITIES
    from jounce.io import tables
    from jounce.model.coordinates import coordinate_units
    from jounce.robot.along import force_breaks

    tables.check_writable(output)
    if output.resolve() == motion.path.resolve():
        raise JounceError(f"{output}: the output file is the input file; choose another path")
    links = robot.load()
    arm = links.elastic(
        _by_joint("--stiffness", stiffness, links.joint_names), _by_joint("--rotor", rotor, links.joint_names)
    )
    path = motion.load(arm.robot, HIGHEST)
    breaks = force_breaks(arm.robot, path, path.times, 0, None, QUANTITIES["motor_torques"])
    peaks = _write(arm, path, breaks, output)
    summary = {
        "robot": arm.robot.name,
        "motion": str(motion.path),
        "source": path.source,
        "residual": None if path.residual is None else float(path.residual.max()),
        "notes": list(path.notes),
        "output": str(output),
        "states": len(path.times),
        "t": [float(path.times[0]), float(path.times[-1])],
        "breaks": [break_data(found, arm.robot.joint_names, ["tau"]) for found in breaks],
        "peaks": _by_name(peaks, 0, arm.robot.joint_names),
        "deviations": _by_name(peaks, 1, arm.robot.joint_names),
        "units": dict(zip(arm.robot.joint_names, coordinate_units(arm.robot.mechanism), strict=True)),
    }
    tell(summary, _in_words, as_json)


def _by_joint(option: str, given: Sequence[str], joints: Sequence[str]) -> dict[str, float] | None:
    """The numbers of an option by joint: VALUE is of all joints, JOINT=VALUE of one; None without any."""
    from jounce._scalars import finite

    found: dict[str, float] = {}
    named: dict[str, float] = {}
    for text in given:
        name, _, value = text.rpartition("=")
        number = finite(value)
        if number is None:
            raise JounceError(f"{option} {quoted(text)}; expected a number, or JOINT=NUMBER")
        if name in named or (not name and found):
            raise JounceError(f"{option} {quoted(text)} is the second for {quoted(name) if name else 'all joints'}")
        if name:
            named[name] = number
        else:
            found = dict.fromkeys(joints, number)
    return (found | named) or None


def _write(arm: "ElasticRobot", motion: "Motion", breaks: "Sequence[ForceBreak]", output: Path) -> "Peaks":
    """Write what the motors do along a motion, each piece when it is computed; the largest values are returned."""
    import numpy as np

    from jounce.dynamics.quantities import QUANTITIES
    from jounce.io import tables
    from jounce.io.motions.writing import break_marks, measured, named
    from jounce.motion.bands import surest_peaks
    from jounce.robot.along import pieces_along

    robot, rows = arm.robot, {"motor_positions": 1, "motor_torques": 0}
    joints, marks = robot.joint_names, [(found.t, max(found.order, 0)) for found in breaks]
    peaks: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}

    def pieces() -> "Iterator[Columns]":
        parts = (
            pieces_along(robot, motion, motion.times, order, None, show, QUANTITIES[name])
            for name, order in rows.items()
        )
        for of_rows in zip(*parts, strict=True):
            t = of_rows[0].t
            columns: Columns = {"t": t}
            for (name, order), piece in zip(rows.items(), of_rows, strict=True):
                columns |= named(QUANTITIES[name].symbol, joints, piece.forces, piece.deviations)
                spreads = piece.deviations or tuple(map(np.zeros_like, piece.forces))
                for symbol, values, spread in zip(QUANTITIES[name].names(order), piece.forces, spreads, strict=True):
                    peaks.setdefault(symbol, []).append(surest_peaks(values, spread))
            yield columns | measured(motion, joints, t) | break_marks(motion, marks, t)

    with progress("motors") as show:
        tables.write_pieces(output, pieces())
    return {symbol: surest_peaks(*map(np.stack, zip(*found, strict=True))) for symbol, found in peaks.items()}


def _by_name(peaks: "Peaks", which: int, joints: Sequence[str]) -> dict[str, dict[str, float]]:
    return {joint: {name: float(pair[which][j]) for name, pair in peaks.items()} for j, joint in enumerate(joints)}


def _in_words(summary: dict[str, Any]) -> str:
    first, last = summary["t"]
    rows: list[tuple[str, ...]] = [("largest", "theta", "thetad", "tau")]
    for joint, peaks in summary["peaks"].items():
        unit = summary["units"][joint]
        units = {"theta": unit, "thetad": f"{unit}/s", "tau": "N m" if unit == "rad" else "N"}
        cells = []
        for name, value in peaks.items():
            spread = summary["deviations"][joint][name]
            cells.append(f"{value:.6g}" + (f" ± {float(f'{spread:.2g}'):g}" if spread else "") + f" {units[name]}")
        rows.append((joint, *cells))
    along = f"{shortened(summary['robot'])} along {summary['motion']}"
    residual = "" if summary["residual"] is None else f", largest residual {summary['residual']:.2g}"
    return "\n".join([
        f"{along}: {summary['states']} states, t = {first:g} .. {last:g} s",
        summary["source"] + residual,
        *summary["notes"],
        *breaks_in_words(summary["breaks"]),
        f"{', '.join(rows[0][1:])} written to {summary['output']}",
        "",
        *straight_columns(rows),
    ])  # fmt: skip
