"""What is computed of rows and of whole motions: forces, or what the motors of elastic joints do."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jounce.actuators.along import motors_along, order_of_voltages
from jounce.core.errors import UncertainError, warn
from jounce.dynamics import electrical
from jounce.dynamics.quantities import FORCES, Quantity, row_of
from jounce.dynamics.stretch import elasticity_of
from jounce.engine import digits
from jounce.engine.along import force_breaks, pieces_along
from jounce.engine.closed_path import on_tree
from jounce.engine.dispatch import compute
from jounce.engine.engine import Engine
from jounce.engine.generic import as_tuple
from jounce.io.columns import Columns
from jounce.io.motions.writing import BREAK, MEASURED, break_marks, named, of_base
from jounce.model.coordinates import force_names
from jounce.model.elasticity import motor_names
from jounce.motion import Motion
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
    """Some rows of the output: their times, quantities with their rates, and further columns."""

    t: np.ndarray
    outputs: list[Output]
    others: Columns


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


def along(job: Job, motion: Motion, torques: Sequence[str]) -> Iterator[Block]:
    """The quantities along a whole motion at its own times, in blocks of rows; `torques` are joints measured."""
    robot, order = job.robot, job.order
    if job.of_motors:
        order = order_of_voltages(elasticity_of(robot.mechanism), motion.highest)
        whole = motors_along(robot, motion, order=order, method=job.method)
        marks = [(found.t, max(found.order, 0)) for found in whole.breaks]
        off = whole.deviations or tuple(map(np.zeros_like, whole.torques))
        found = _of_motors(job.robot, whole.positions, whole.torques, off)
        yield Block(whole.t, found, _others(job, motion, torques, marks, whole.t))
        return
    marks = [(found.t, max(found.order, 0)) for found in force_breaks(robot, motion, motion.times, order, job.method)]
    for piece in pieces_along(robot, motion, motion.times, order, job.method):
        off = piece.deviations or tuple(map(np.zeros_like, piece.forces))
        outputs = [Output(FORCES.symbol, force_names(robot.mechanism), piece.forces, off)]
        if job.with_rates:
            of_q = motion.deviations(piece.t, len(piece.rates) - 1) or tuple(map(np.zeros_like, piece.rates))
            outputs.insert(0, Output("q", robot.joint_names, piece.rates, of_q))
        base = of_base(motion, piece.t, len(piece.rates) - 1) if job.with_rates else {}
        yield Block(piece.t, outputs, base | _others(job, motion, torques, marks, piece.t))


def columns_of(block: Block) -> Columns:
    """The columns of a block by name."""
    found: Columns = {"t": block.t}
    for output in block.outputs:
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


def _others(
    job: Job, motion: Motion, torques: Sequence[str], marks: Sequence[tuple[float, int]], t: np.ndarray
) -> Columns:
    """The columns of measured torques, NaN where one is missing, and of breaks, -1 where there is no break."""
    found: Columns = {}
    for j, name in enumerate(job.robot.joint_names):
        if name in torques and motion.torques is not None:
            at, values = motion.torques
            found[f"{name}.Q{MEASURED}"] = np.interp(t, at, values[:, j])
    return found | {BREAK: break_marks(motion, marks, t).get(BREAK, np.full(len(t), -1.0))}
