"""`jounce run`: the drive forces and their rates along a motion, from table to table."""

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.breaks import break_data, breaks_in_words
from jounce.cli.motions import AskedMotion, of_motion
from jounce.cli.options import Asked, on_robot
from jounce.cli.output import check_distinct, progress, straight_columns, tell
from jounce.cli.streaming import OUTPUT, AskedStream, is_asked, on_stream, tell_results
from jounce.core.errors import shortened

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy as np

    from jounce.engine.along import ForceBreak
    from jounce.io.columns import Columns
    from jounce.limits.samples import Sample
    from jounce.motion import Motion
    from jounce.robot import Robot

EPILOG = """\b
Example, the robot and the motion of the paper:
  jounce run iiwa14 paper -o forces.csv

\b
MOTION is a table with a column t and, matched by joint name in any order,
  either one column per joint    samples; rates come from a spline
  or NAME.q, NAME.qd, NAME.q2d,  used unchanged; order 2 needs q to q4d,
     NAME.q3d, NAME.q4d          order 0 needs q to q2d
and, if wrenches act, BODY.mx .. BODY.fz: the wrench that the body exerts, in
  its own axes, as samples or with rates BODY.fxd, BODY.fx2d ...
or a YAML file with analytic terms for each joint, whose rates are exact:
  time: {start: 0, stop: 5, count: 1001}
  joints:
    joint1: {offset: 0.5, cosines: [{amplitude: 1, frequency: 2, phase: 0}]}
    joint2: {polynomial: [0, 0.1, 0.2]}

\b
OUT holds t and NAME.Q, NAME.Qd, NAME.Q2d, with all their digits; with --base
floating base.mx.Q .. base.fz.Q too, the wrench on the base; of smoothed
samples NAME.Q_sd, ... too, their standard deviations. The largest values are
printed with theirs (±); values that do not stand out of their band of 95 %,
as at the ends of a fit, are no candidates. OUT has a column break, if Q or a
rate of it jumps: the order of what jumps since the row before, else -1.

\b
MOTION may be a folder of tables, or one whose column motion names the motion
of each row, of any size: they are read by parts, in bounded memory, and the
same command continues a run that was stopped.
"""


@click.command(epilog=EPILOG, short_help="Compute Q, Qd, Q2d along a motion and write them as a table.")
@on_robot
@of_motion
@OUTPUT
@click.option("--order", default=2, show_default=True, type=click.IntRange(0), help="Highest time derivative of Q.")
@click.option("--rates", "with_rates", is_flag=True, help="Write q, qd, ... too.")
@click.option(
    "--method", default=None, help="Method: kernel (native code, the default), recursion, closed_form or paper."
)
@on_stream
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def run(
    robot: Asked,
    motion: AskedMotion,
    output: Path,
    order: int,
    with_rates: bool,
    method: str | None,
    stream: AskedStream,
    as_json: bool,
) -> None:
    """Compute Q, Qd, Q2d along MOTION for ROBOT, a file or the name of a bundled robot."""
    from jounce.dynamics.quantities import FORCES
    from jounce.engine.along import checked_motion, force_breaks
    from jounce.io import tables
    from jounce.model.coordinates import force_names, force_units
    from jounce.stream.job import Job
    from jounce.stream.plan import is_by_parts
    from jounce.stream.results import form_of

    asked = is_asked(stream, motion, output)
    if not asked:
        tables.check_writable(output)
        check_distinct(output, motion.path)
    arm = robot.load()
    form = None if stream.reduce else form_of(output)
    job = Job("forces", arm, order, stream.reading(motion), form, method, with_rates)
    if asked or is_by_parts(job, motion.path):
        tell_results(job, motion, output, stream, "inverse dynamics", as_json)
        return
    path = checked_motion(arm.mechanism, motion.load(arm, order))
    breaks = force_breaks(arm, path, path.times, order, method)
    peaks, spreads, worst = _write_forces(arm, path, order, method, with_rates, breaks, output)
    names, rows = FORCES.names(order), force_names(arm.mechanism)
    summary = {
        "robot": arm.name,
        "motion": str(motion.path),
        "source": path.source,
        "residual": None if path.residual is None else float(path.residual.max()),
        "blend": motion.blend,
        "notes": list(path.notes),
        "output": str(output),
        "states": len(path.times),
        "t": [float(path.times[0]), float(path.times[-1])],
        "order": order,
        "broken_limit": _limit(worst, arm.joint_names),
        "breaks": [break_data(found, rows, names) for found in breaks],
        "peaks": {
            joint: dict(zip(names, largest.tolist(), strict=True)) for joint, largest in zip(rows, peaks.T, strict=True)
        },
        "deviations": {
            joint: dict(zip(names, spread.tolist(), strict=True)) for joint, spread in zip(rows, spreads.T, strict=True)
        },
        "units": dict(zip(rows, force_units(arm.mechanism), strict=True)),
    }
    tell(summary, _in_words, as_json)


def _write_forces(
    robot: "Robot",
    motion: "Motion",
    order: int,
    method: str | None,
    with_rates: bool,
    breaks: "Sequence[ForceBreak]",
    output: Path,
) -> "tuple[np.ndarray, np.ndarray, Sample | None]":
    """Write the forces and their rates along a motion, each piece when it is computed.

    Returns the largest of them that stand out of their bands, (.., n), their standard deviations, and the worst limit.
    """
    import numpy as np

    from jounce.dynamics.quantities import FORCES
    from jounce.engine.along import pieces_along
    from jounce.io import tables
    from jounce.io.motions.writing import about, break_marks, measured, named, of_base
    from jounce.limits.samples import worst_sample
    from jounce.model.coordinates import coordinate_limits, force_names
    from jounce.motion.bands import surest_peaks

    joints, limits = robot.joint_names, coordinate_limits(robot.mechanism)
    marks = [(found.t, max(found.order, 0)) for found in breaks]
    peaks: list[tuple[np.ndarray, np.ndarray]] = []  # of each piece, with their deviations
    samples: list[Sample | None] = []

    def pieces() -> "Iterator[Columns]":
        for piece in pieces_along(robot, motion, motion.times, order, method, show):
            forces = np.stack(piece.forces, axis=1)
            spread = np.zeros_like(forces) if piece.deviations is None else np.stack(piece.deviations, axis=1)
            peaks.append(surest_peaks(forces, spread))
            samples.append(worst_sample(limits, piece.t, piece.rates, piece.forces))
            columns: Columns = {"t": piece.t}
            if with_rates:
                columns |= named("q", joints, piece.rates, motion.deviations(piece.t, len(piece.rates) - 1))
                columns |= of_base(motion, piece.t, len(piece.rates) - 1)
            columns |= named(FORCES.symbol, force_names(robot.mechanism), piece.forces, piece.deviations)
            yield columns | measured(motion, joints, piece.t) | break_marks(motion, marks, piece.t)

    with progress("inverse dynamics") as show:
        closed = robot.mechanism.closure is not None
        tables.write_pieces(output, pieces(), about(robot.mechanism, order), missing=closed)
    largest, spreads = surest_peaks(*map(np.stack, zip(*peaks, strict=True)))
    return largest, spreads, max((sample for sample in samples if sample is not None), default=None)


def _limit(worst: "Sample | None", joints: Sequence[str]) -> dict[str, Any] | None:
    """The limit that is broken most at the samples, as plain data."""
    if worst is None or worst.ratio <= 1:
        return None
    ratio = worst.ratio if isfinite(worst.ratio) else None
    return {"joint": joints[worst.joint], "limit": worst.kind, "t": worst.t, "ratio": ratio}


def _limit_in_words(found: dict[str, Any] | None) -> list[str]:
    if found is None:
        return []
    ratio = "infinitely" if found["ratio"] is None else f"{found['ratio']:.4g} times"
    came = f"{found['limit'].replace('_', ' ')} of {found['joint']} at t = {found['t']:.6g} s"
    return [f"limit broken: {came} is {ratio} its limit; jounce check tells of all limits"]


def _in_words(summary: dict[str, Any]) -> str:
    first, last = summary["t"]
    names = list(next(iter(summary["peaks"].values())))
    per = ["", " /s", *(f" /s^{k}" for k in range(2, len(names)))]
    rows = [("largest", "unit", *(f"|{name}|{unit}" for name, unit in zip(names, per, strict=False)))]
    for joint, peaks in summary["peaks"].items():
        spreads = summary["deviations"][joint]
        cells = (
            f"{peaks[name]:.6g}" + (f" ± {float(f'{spreads[name]:.2g}'):g}" if spreads[name] else "") for name in names
        )
        rows.append((joint, summary["units"][joint], *cells))
    kind = "at most {:.2g} from it" if summary["blend"] else "largest residual {:.2g}"
    residual = "" if summary["residual"] is None else f", {kind.format(summary['residual'])}"
    along = f"{shortened(summary['robot'])} along {summary['motion']}"
    return "\n".join([
        f"{along}: {summary['states']} states, t = {first:g} .. {last:g} s",
        summary["source"] + residual,
        *summary["notes"],
        *breaks_in_words(summary["breaks"]),
        *_limit_in_words(summary["broken_limit"]),
        f"{', '.join(names)} written to {summary['output']}",
        "",
        *straight_columns(rows),
    ])  # fmt: skip
