"""`jounce motors`: positions, velocities and torques of the motors behind elastic joints along a motion."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.breaks import break_data, breaks_in_words
from jounce.cli.motions import AskedMotion, of_motion
from jounce.cli.options import Asked, on_robot
from jounce.cli.output import check_distinct, progress, straight_columns, tell
from jounce.cli.streaming import OUTPUT, AskedStream, is_asked, on_stream, tell_results
from jounce.core.errors import JounceError, quoted, shortened

if TYPE_CHECKING:
    from jounce.actuators.along import ElasticAlong
    from jounce.io.columns import Columns
    from jounce.motion import Motion

    Peaks = dict[str, dict[str, tuple[float, float]]]  # by motor and symbol: the largest value and its deviation

HIGHEST = 2  # the rate of Q that torques of motors take

EPILOG = """\b
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
@OUTPUT
@on_stream
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def motors(
    robot: Asked,
    motion: AskedMotion,
    stiffness: Sequence[str],
    rotor: Sequence[str],
    output: Path,
    stream: AskedStream,
    as_json: bool,
) -> None:
    """Compute positions, velocities and torques of the motors of ROBOT, whose joints are elastic, along MOTION."""
    from jounce.actuators.along import order_of_voltages
    from jounce.dynamics.stretch import elasticity_of
    from jounce.io import tables
    from jounce.io.motions.writing import about
    from jounce.model.coordinates import coordinate_units
    from jounce.model.elasticity import motor_names
    from jounce.stream.job import Job
    from jounce.stream.plan import is_by_parts
    from jounce.stream.results import form_of

    asked = is_asked(stream, motion, output)
    if not asked:
        tables.check_writable(output)
        check_distinct(output, motion.path)
    links = robot.load()
    arm = links.elastic(
        _by_joint("--stiffness", stiffness, links.joint_names), _by_joint("--rotor", rotor, links.joint_names)
    )
    job = Job("motors", arm, 0, stream.reading(motion), None if stream.reduce else form_of(output))
    if asked or is_by_parts(job, motion.path):
        tell_results(job, motion, output, stream, "motors", as_json)
        return
    path, e = motion.load(arm, HIGHEST), elasticity_of(arm.mechanism)
    names = motor_names(e, links.joint_names)
    with progress("motors") as show:
        along = arm.motors_along(path, order=order_of_voltages(e, path.highest), progress=show)
    columns, peaks = _table(along, path, names)
    tables.write(output, columns, about(arm.mechanism, HIGHEST))
    units = [coordinate_units(arm.mechanism)[j] for j in e.joints_of_motors]
    summary = {
        "robot": arm.name,
        "motion": str(motion.path),
        "source": path.source,
        "residual": None if path.residual is None else float(path.residual.max()),
        "notes": list(path.notes),
        "output": str(output),
        "states": len(path.times),
        "t": [float(path.times[0]), float(path.times[-1])],
        "breaks": [
            break_data(found, links.joint_names, ["tau", "taud"][: len(along.torques)]) for found in along.breaks
        ],
        "peaks": {name: {symbol: x for symbol, (x, _) in found.items()} for name, found in peaks.items()},
        "deviations": {name: {symbol: x for symbol, (_, x) in found.items()} for name, found in peaks.items()},
        "units": dict(zip(names, units, strict=True)),
    }
    tell(summary, _in_words, as_json)


def _by_joint(option: str, given: Sequence[str], joints: Sequence[str]) -> dict[str, float] | None:
    """The numbers of an option by joint: VALUE is of all joints, JOINT=VALUE of one; None without any."""
    from jounce.core.scalars import finite

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


def _table(along: "ElasticAlong", motion: "Motion", names: Sequence[str]) -> "tuple[Columns, Peaks]":
    """The columns of what the motors do along a motion, and the largest values with their deviations."""
    import numpy as np

    from jounce.io.motions.writing import break_marks, measured, named
    from jounce.motion.bands import surest_peaks

    found: dict[str, tuple[np.ndarray, ...]] = {"theta": along.positions[:2], "tau": along.torques[:1]}
    found |= {symbol: x[:1] for symbol, x in (("i", along.currents), ("u", along.voltages)) if x}
    columns: Columns = {"t": along.t}
    peaks: Peaks = {name: {} for name in names}
    for symbol, rates in found.items():
        spreads = along.deviations[:1] if symbol == "tau" and along.deviations else None
        stated = [j for j in range(len(names)) if not np.isnan(rates[0][:, j]).any()]
        columns |= named(
            symbol,
            [names[j] for j in stated],
            [x[:, stated] for x in rates],
            spreads and [x[:, stated] for x in spreads],
        )
        for k, values in enumerate(rates):
            largest, off = surest_peaks(values, spreads[k] if spreads else np.zeros_like(values))
            for j in stated:
                peaks[names[j]][symbol + "d" * k] = float(largest[j]), float(off[j])
    marks = [(b.t, max(b.order, 0)) for b in along.breaks]
    return columns | measured(motion, names, along.t) | break_marks(motion, marks, along.t), peaks


def _in_words(summary: dict[str, Any]) -> str:
    first, last = summary["t"]
    symbols = list(dict.fromkeys(symbol for peaks in summary["peaks"].values() for symbol in peaks))
    rows: list[tuple[str, ...]] = [("largest", *symbols)]
    for name, peaks in summary["peaks"].items():
        unit = summary["units"][name]
        units = {"theta": unit, "thetad": f"{unit}/s", "tau": "N m" if unit == "rad" else "N", "i": "A", "u": "V"}
        spreads = {symbol: f" ± {float(f'{x:.2g}'):g}" for symbol, x in summary["deviations"][name].items() if x}
        cells = {symbol: f"{x:.6g}{spreads.get(symbol, '')} {units[symbol]}" for symbol, x in peaks.items()}
        rows.append((name, *(cells.get(symbol, "-") for symbol in symbols)))
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
