"""What is computed of rows and of whole motions: forces, or what the motors of elastic joints do."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from jounce.actuators.along import motors_along, order_of_voltages
from jounce.core.errors import UncertainError, warn
from jounce.dynamics import electrical
from jounce.dynamics.quantities import FORCES, Quantity, row_of
from jounce.dynamics.stretch import elasticity_of
from jounce.engine import digits
from jounce.engine.along import ForceBreak, Progress, force_breaks, pieces_along
from jounce.engine.closed_path import on_tree
from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine
from jounce.engine.generic import as_tuple
from jounce.io.columns import Columns
from jounce.io.motions.writing import BREAK_COLUMN, MEASURED, break_marks, measured, named, of_base, of_joints
from jounce.model.coordinates import force_names
from jounce.model.elasticity import motor_names
from jounce.model.positions import extent
from jounce.motion import Motion
from jounce.motion.motion import Break
from jounce.spatial.series import rate_name
from jounce.stream.job import Job

Rates = tuple[np.ndarray, ...]
Wrenches = tuple[Mapping[str, np.ndarray], ...] | None


class Output(NamedTuple):
    """A quantity with its rates (N, m) of joints or motors: the columns ``NAME.Q, NAME.Qd, ...``."""

    symbol: str
    names: Sequence[str]
    rates: Rates
    deviations: Rates | None = None


class Block(NamedTuple):
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


def of_rows(
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
            warn(digits.describe(job.robot.mechanism, error.names, times, len(t)))
            return error.results

    given = rates[: job.highest + 1]
    own = [Output("q", job.robot.joint_names, given)] if job.with_rates else []
    given = on_tree(given, position)
    if not job.of_motors:
        return [*own, Output(FORCES.symbol, force_names(job.robot.mechanism), certain(FORCES, W))]
    more = elasticity_of(job.robot.mechanism).more_rates
    rows = [row_of(name, more) for name in ("motor_positions", "motor_torques")]
    terms = [W and W[: len(given) - row.rates + row.wrench_rates] for row in rows]
    theta, tau = (certain(row, term) for row, term in zip(rows, terms, strict=True))
    return _of_motors(job.robot, theta, tau, None)


def along(job: Job, motion: Motion, show: Progress | None = None) -> Iterator[Block]:
    """The quantities along a whole motion at its own times, in blocks of rows."""
    robot, order = job.robot, job.order
    if job.of_motors:
        order = order_of_voltages(elasticity_of(robot.mechanism), motion.highest)
        whole = motors_along(robot, motion, order=order, method=job.method, progress=show)
        found = _of_motors(robot, whole.positions, whole.torques, whole.deviations)
        about = _about(motion, whole.breaks, robot.joint_names, ["tau", "taud"][: order + 1])
        yield Block(whole.t, found, {}, _others(robot, motion, whole.breaks, whole.t), (), about)
        return
    forces, breaks = force_names(robot.mechanism), force_breaks(robot, motion, motion.times, order, job.method)
    about = _about(motion, breaks, forces, FORCES.names(order))
    for piece in pieces_along(robot, motion, motion.times, order, job.method, show):
        outputs, base = [Output(FORCES.symbol, forces, piece.forces, piece.deviations)], Columns()
        if job.with_rates:
            highest = len(piece.rates) - 1
            if motion.several:
                base = of_joints(motion, robot.joint_names, piece.t, highest)
            else:
                outputs.insert(0, Output("q", robot.joint_names, piece.rates, motion.deviations(piece.t, highest)))
            base |= of_base(motion, piece.t, highest)
        states = extent(robot.mechanism, piece.rates[0]), *piece.rates[1:]
        yield Block(piece.t, outputs, base, _others(robot, motion, breaks, piece.t), states, about)


def alike(block: Block, motion: Motion, joints: Sequence[str], torques: Sequence[str]) -> Block:
    """A block with the columns of all motions of a table, of which some may have no breaks, deviations or `torques`."""
    others = {BREAK_COLUMN: np.full(len(block.t), -1.0)} | block.others
    if motion.torques is not None:
        at, values = motion.torques
        columns = {name: values[:, j] for j, name in enumerate(joints) if name in torques}
        others = {f"{name}.Q{MEASURED}": np.interp(block.t, at, column) for name, column in columns.items()} | others
    outputs = [
        output._replace(deviations=output.deviations or tuple(map(np.zeros_like, output.rates)))
        if output.symbol in ("q", FORCES.symbol, "tau")
        else output
        for output in block.outputs
    ]
    return block._replace(outputs=outputs, others=others)


def columns_of(block: Block) -> Columns:
    """The columns of a block by name."""
    found: Columns = {"t": block.t}
    for k, output in enumerate(block.outputs):
        found |= block.base if k == len(block.outputs) - 1 else {}
        found |= named(output.symbol, output.names, output.rates, output.deviations)
    return found | block.others


def _of_motors(robot: Engine, theta: Rates, tau: Rates, off: Rates | None) -> list[Output]:
    """theta, thetad, tau and, of motors that state their data, current and voltage."""
    e = elasticity_of(robot.mechanism)
    names = motor_names(e, robot.joint_names)
    found = [Output("theta", names, theta[:2]), Output("tau", names, tau[:1], off and off[:1])]
    for symbol, rates in zip("iu", electrical.outputs(e, theta, tau), strict=True):
        if rates:
            stated = [j for j in range(len(names)) if not np.isnan(rates[0][:, j]).all()]
            found.append(Output(symbol, [names[j] for j in stated], (rates[0][:, stated],)))
    return found


def _others(robot: Engine, motion: Motion, breaks: Sequence[ForceBreak], t: np.ndarray) -> Columns:
    """The columns of measured torques and of breaks, of motions that have some."""
    marks = [(found.t, max(found.order, 0)) for found in breaks]
    return measured(motion, robot.joint_names, t) | break_marks(motion, marks, t)


def _about(motion: Motion, breaks: Sequence[ForceBreak], rows: Sequence[str], names: Sequence[str]) -> dict[str, Any]:
    """What rows do not hold of a motion, as plain data: where its rates come from, notes, and breaks of forces."""
    return {
        "source": motion.source,
        "residual": None if motion.residual is None else float(motion.residual.max()),
        "notes": list(motion.notes),
        "breaks": [_break_data(found, rows, names) for found in breaks],
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
