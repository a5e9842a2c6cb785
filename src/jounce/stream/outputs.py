"""What is computed of rows and of whole motions: forces, or what the motors of elastic joints do."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from jounce.actuators.along import motors_along, voltage_order
from jounce.core.errors import UncertainError, warn
from jounce.dynamics import electrical
from jounce.dynamics.joint_springs import elasticity_of
from jounce.dynamics.quantities import DEFAULT_QUANTITY, Quantity, find_row
from jounce.engine import certain_digits
from jounce.engine.along import Q_RATE_ORDER, ForceBreak, Progress, compute_pieces, find_force_breaks
from jounce.engine.closed_path import with_tree_positions
from jounce.engine.engine import Engine
from jounce.engine.generic_methods import as_tuple
from jounce.engine.hidden_vibrations import find_hidden_vibrations
from jounce.engine.plan import compute
from jounce.io.columns import Columns
from jounce.io.motions.writing import (
    BREAK_COLUMN,
    MEASURED,
    base_columns,
    break_marks,
    joint_columns,
    measured_columns,
    named_columns,
)
from jounce.model.coordinates import force_names
from jounce.model.elasticity import motor_names
from jounce.model.positions import position_extents
from jounce.motion import Motion
from jounce.motion.motion import Break
from jounce.motion.reliability import MAX_WINDOW_TIMES, find_window
from jounce.spatial.series import rate_name
from jounce.stream.job import Job

Rates = tuple[np.ndarray, ...]
Wrenches = tuple[Mapping[str, np.ndarray], ...] | None
Span = tuple[float, float]


class Output(NamedTuple):
    """A quantity with its rates (N, m) of joints or motors: the columns ``NAME.Q, NAME.Qd, ...``.

    `windows` are the times between which each rate is known well; none where all of them are along the whole motion.
    """

    symbol: str
    names: Sequence[str]
    rates: Rates
    deviations: Rates | None = None
    windows: Sequence[Span] = ()


class OutputBlock(NamedTuple):
    """Some rows of the output: their times, quantities with their rates, columns of the base and further ones.

    `states` are what limits of positions bound, with the rates of q that forces belong to, and `about` is plain data of
    the motion as a whole.
    """

    t: np.ndarray
    outputs: list[Output]
    base: Columns
    others: Columns
    states: Rates
    about: Mapping[str, Any]


def compute_rows(
    job: Job, t: np.ndarray, rates: Rates, W: Wrenches, base: Rates | None = None, position: np.ndarray | None = None
) -> list[Output]:
    """The quantities at states that do not depend on each other; those of closed robots with all positions (N,).

    A warning counts rows without certain digits, which are NaN.
    """

    def certain(row: Quantity, W: Wrenches) -> Rates:
        try:
            return as_tuple(compute(job.robot, row.name, given, wrench=W, base=base, method=job.method))
        except UncertainError as error:
            times = [t[where] for where in error.uncertain]
            warn(certain_digits.describe_uncertain(job.robot.mechanism, error.names, times, len(t)))
            return error.results

    given = rates[: job.highest + 1]
    own = [Output("q", job.robot.joint_names, given)] if job.with_rates else []
    given = with_tree_positions(given, position)
    if not job.of_motors:
        names = force_names(job.robot.mechanism)
        return [*own, Output(DEFAULT_QUANTITY.gives.symbol, names, certain(DEFAULT_QUANTITY, W))]
    more = elasticity_of(job.robot.mechanism).more_rates
    rows = [find_row(name, more) for name in ("motor_positions", "motor_torques")]
    terms = [W and W[: len(given) - row.takes.rates + row.takes.wrench_rates] for row in rows]
    theta, tau = (certain(row, term) for row, term in zip(rows, terms, strict=True))
    return [*own, *_motor_outputs(job.robot, theta, tau, None)]


def compute_motion(job: Job, motion: Motion, show: Progress | None = None) -> Iterator[OutputBlock]:
    """The quantities along a whole motion at its own times, in blocks of rows."""
    robot, order = job.robot, job.order
    if job.of_motors:
        order = voltage_order(elasticity_of(robot.mechanism), motion.highest)
        whole = motors_along(robot, motion, order=order, method=job.method, progress=show)
        found = _motor_outputs(robot, whole.positions, whole.torques, whole.deviations)
        if job.with_rates:
            rates, deviations = motion(whole.t, job.highest), motion.deviations(whole.t, job.highest)
            found = [Output("q", robot.joint_names, rates, deviations), *found]
        about = _describe_motion(motion, whole.breaks, robot.joint_names, ["tau", "taud"][: order + 1])
        about["notes"] += whole.notes
        yield OutputBlock(whole.t, found, {}, _further_columns(robot, motion, whole.breaks, whole.t), (), about)
        return
    forces, breaks = force_names(robot.mechanism), find_force_breaks(robot, motion, motion.times, order, job.method)
    about = _describe_motion(motion, breaks, forces, DEFAULT_QUANTITY.names(order))
    about["hidden"] = find_hidden_vibrations(robot, motion, order)
    windows = find_windows(motion, order + Q_RATE_ORDER)
    for piece in compute_pieces(robot, motion, motion.times, order, job.method, show):
        Q = Output(DEFAULT_QUANTITY.gives.symbol, forces, piece.forces, piece.deviations, windows[Q_RATE_ORDER:])
        outputs, base = [Q], Columns()
        if job.with_rates:
            highest = len(piece.rates) - 1
            if motion.several:
                base = joint_columns(motion, robot.joint_names, piece.t, highest)
            else:
                outputs.insert(0, Output("q", robot.joint_names, piece.rates, motion.deviations(piece.t, highest)))
            base |= base_columns(motion, piece.t, highest)
        states = position_extents(robot.mechanism, piece.rates[0]), *piece.rates[1:]
        yield OutputBlock(piece.t, outputs, base, _further_columns(robot, motion, breaks, piece.t), states, about)


def find_windows(motion: Motion, order: int) -> list[Span]:
    """By rate of q up to an order, the times between which it is known well, and what loads and the base add to Q.

    Q and its rates are known as well as the highest rates that they take, whose deviations are most of theirs.
    """
    times = motion.times
    t = times[np.unique(np.linspace(0, len(times) - 1, min(len(times), MAX_WINDOW_TIMES)).astype(int))]
    curves = [(motion.curve, 0), *((load, Q_RATE_ORDER) for load in motion.loads.values())]
    curves += [(motion.base_curve, 0)] if motion.base_curve else []
    spans = [[(motion.start, motion.stop)] for _ in range(order + 1)]
    for curve, first in curves:
        off = curve.deviations(t, order - first) if order >= first else None
        rates = curve.rates(t, order - first) if off else ()
        for of, x, deviations in zip(spans[first:], rates, off or (), strict=False):
            of.append(find_window(t, deviations, x))
    return [(max(start for start, _ in of), min(stop for _, stop in of)) for of in spans]


def add_common_columns(
    block: OutputBlock, motion: Motion, joints: Sequence[str], torques: Sequence[str]
) -> OutputBlock:
    """A block with the columns of all motions of a table, of which some may have no breaks, deviations or `torques`."""
    others = {BREAK_COLUMN: np.full(len(block.t), -1.0)} | block.others
    if motion.torques is not None:
        at, values = motion.torques
        columns = {name: values[:, j] for j, name in enumerate(joints) if name in torques}
        others = {f"{name}.Q{MEASURED}": np.interp(block.t, at, column) for name, column in columns.items()} | others
    outputs = [
        output._replace(deviations=output.deviations or tuple(map(np.zeros_like, output.rates)))
        if output.symbol in ("q", DEFAULT_QUANTITY.gives.symbol, "tau")
        else output
        for output in block.outputs
    ]
    return block._replace(outputs=outputs, others=others)


def block_columns(block: OutputBlock) -> Columns:
    """The columns of a block by name."""
    found: Columns = {"t": block.t}
    for k, output in enumerate(block.outputs):
        found |= block.base if k == len(block.outputs) - 1 else {}
        found |= named_columns(output.symbol, output.names, output.rates, output.deviations)
    return found | block.others


def _motor_outputs(robot: Engine, theta: Rates, tau: Rates, off: Rates | None) -> list[Output]:
    """theta, thetad, tau and, of motors that state their data, current and voltage."""
    e = elasticity_of(robot.mechanism)
    names = motor_names(e, robot.joint_names)
    found = [Output("theta", names, theta[:2]), Output("tau", names, tau[:1], off and off[:1])]
    for symbol, rates in zip("iu", electrical.outputs(e, theta, tau), strict=True):
        if rates:
            stated = [j for j in range(len(names)) if not np.isnan(rates[0][:, j]).all()]
            found.append(Output(symbol, [names[j] for j in stated], (rates[0][:, stated],)))
    return found


def _further_columns(robot: Engine, motion: Motion, breaks: Sequence[ForceBreak], t: np.ndarray) -> Columns:
    """The columns of measured torques and of breaks, of motions that have some."""
    marks = [(found.t, max(found.order, 0)) for found in breaks]
    return measured_columns(motion, robot.joint_names, t) | break_marks(motion, marks, t)


def _describe_motion(
    motion: Motion, breaks: Sequence[ForceBreak], rows: Sequence[str], names: Sequence[str]
) -> dict[str, Any]:
    """What rows do not hold of a motion, as plain data: where its rates come from, notes, and breaks of forces."""
    return {
        "source": motion.source,
        "residual": None if motion.residual is None else float(motion.residual.max()),
        "notes": list(motion.notes),
        "breaks": [_break_data(found, rows, names) for found in breaks],
        "hidden": [],
    }


def _break_data(found: ForceBreak, rows: Sequence[str], names: Sequence[str]) -> dict[str, Any]:
    """A break: the rate of Q that jumps, by how much, and the joints and rates that cause it."""
    return {
        "t": found.t,
        "jumps": names[found.order] if found.order >= 0 else None,
        "by": None if found.jump is None else dict(zip(rows, found.jump.tolist(), strict=True)),
        "missing": list(names[found.order + 1 :]),
        "causes": {
            str(cause.joint): {"rate": rate_name(_symbol(cause), cause.order), "by": cause.jump}
            for cause in found.causes
        },
    }


def _symbol(cause: Break) -> str:
    """q, W or, of the base, the entry that jumps: x of base.x."""
    return str(cause.joint).rpartition(".")[2] if cause.symbol == "base" else cause.symbol
