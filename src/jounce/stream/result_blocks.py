"""Blocks of results of a part: of its rows as they are, or of whole motions, whose rates follow from samples."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from jounce.core.errors import JounceError, locate_errors, quote_value
from jounce.dynamics.quantities import DEFAULT_QUANTITY
from jounce.engine.closed_path import continue_rows
from jounce.engine.force_deviations import with_vibration_notes
from jounce.io.columns import Columns
from jounce.io.motions.log_rows import order_rows, torque_notes
from jounce.io.table_format import leave_out_rows
from jounce.io.tables import describe_place, select_format
from jounce.motion import loads, poses
from jounce.motion.base import evaluate_base
from jounce.motion.motion import Motion
from jounce.motion.spline import Smoothing
from jounce.motion.table import ALL_RATES_SOURCE, motion_from_columns
from jounce.motion.table_columns import TIME
from jounce.motion.units import check_units, refuse_unit_changes
from jounce.motion.wraps import Turning, refuse_wraps
from jounce.spatial.series import rate_name
from jounce.stream.job import InputPart, Task
from jounce.stream.outputs import Output, OutputBlock, Rates, Wrenches, add_common_columns, compute_motion, compute_rows
from jounce.stream.records import Skipped
from jounce.stream.row_reader import GoodRows, MotionRun, read_rows

MAX_UNIT_CHECK_ROWS = 4096  # of a table, from its start: enough to recognise degrees and milliseconds
# What is known of motions whose rows state all rates:
STATED: Mapping[str, Any] = {"source": ALL_RATES_SOURCE, "residual": None, "notes": [], "breaks": [], "hidden": []}


def compute_blocks(
    task: Task, part: InputPart, skipped: list[Skipped]
) -> Iterator[tuple[list[MotionRun], OutputBlock]]:
    """The results of a part: the motions that rows belong to, and the rows."""
    if task.independent:
        for number, rows in enumerate(read_rows(task, part, skipped)):
            yield rows.runs, _compute_block(task, part, rows, check=number == 0)
        return
    for name, motion in read_motions(task, part, skipped):
        for block in compute_motion(task.job, motion):
            shown = add_common_columns(block, motion, task.job.robot.joint_names, list(task.match.torques))
            yield [MotionRun(name, 0, len(block.t))], shown


def _compute_block(task: Task, part: InputPart, rows: GoodRows, check: bool) -> OutputBlock:
    """The results of rows that state all rates; with `check`, units of the first motion are looked at."""
    job, match = task.job, task.match
    si = {
        name: rows.columns[source] if match.factors[name] == 1 else rows.columns[source] * match.factors[name]
        for name, source in match.sources.items()
    }
    rates = [[si[f"{j}.{rate_name('q', k)}"] for j in job.robot.joint_names] for k in range(job.highest + 1)]
    if check:
        first = slice(0, min(rows.runs[0].stop, MAX_UNIT_CHECK_ROWS))
        q, qd = (np.stack([x[first] for x in columns], axis=1) for columns in rates[:2])
        stated = match.angles_stated, match.time_stated
        check_units(si[TIME][first], q, qd, job.robot.mechanism, stated, str(part.path))
    states = tuple(np.stack(columns, axis=1) for columns in rates)
    for here in (slice(run.start, run.stop) for run in rows.runs):
        refuse_unit_changes(si[TIME][here], states[0][here], job.robot.mechanism, str(part.path))
        refuse_wraps(si[TIME][here], states[0][here], Turning.of_robot(job.robot.mechanism), str(part.path))
    positions = _closed_positions(task, part, si, rows.runs, states)
    outputs = [
        output._replace(rates=tuple(map(np.asfortranarray, output.rates)))  # by columns, as they are written
        for output in compute_rows(
            job, si[TIME], states, _row_wrenches(task, part, si), _base_rates(task, part, si), positions
        )
    ]
    _check_finite(part, rows, outputs, missing=job.robot.mechanism.closure is not None)
    of_base = poses.select_base_columns(list(si), job.robot.mechanism) if job.with_rates else ()
    return OutputBlock(si[TIME], outputs, {name: si[name] for name in of_base}, {}, states, STATED)


def _closed_positions(
    task: Task, part: InputPart, si: Mapping[str, np.ndarray], runs: list[MotionRun], rates: Rates
) -> np.ndarray | None:
    """All coordinates of a closed robot, from the rows that state them, checked for jumps within each motion."""
    m = task.job.robot.mechanism
    if m.closure is None or not m.takes_dependent:
        return None
    found = np.stack([si[f"{name}.q"] for name in m.closure.coordinates], axis=1)
    with locate_errors(str(part.path)):
        for run in runs:
            here = slice(run.start, run.stop)
            found[here] = continue_rows(task.job.robot, si[TIME][here], [rate[here] for rate in rates[:3]], found[here])
    return found


def _row_wrenches(task: Task, part: InputPart, si: Mapping[str, np.ndarray]) -> Wrenches:
    """W, Wd, ... by body, from columns that state all of them."""
    columns = {name: si[name] for name in loads.select_wrench_columns(list(si), task.job.robot.mechanism)}
    if not columns:
        return None
    rows = np.arange(len(si[TIME]), dtype=float)  # in place of times, which begin again with each motion
    order = task.job.highest - (DEFAULT_QUANTITY.takes.rates - 1)
    curves, _ = loads.build_wrenches(rows, columns, task.job.robot.mechanism, order, Smoothing(), str(part.path))
    of_bodies = {body: curve.rates(rows, order) for body, curve in curves.items()}
    return tuple({body: rates[k] for body, rates in of_bodies.items()} for k in range(order + 1))


def _base_rates(task: Task, part: InputPart, si: Mapping[str, np.ndarray]) -> Rates | None:
    """C, V, Vd, ... of the base, from columns that state all of its rates."""
    columns = {name: si[name] for name in poses.select_base_columns(list(si), task.job.robot.mechanism)}
    rows = np.arange(len(si[TIME]), dtype=float)  # in place of times, which begin again with each motion
    curve, _ = poses.curve_from_columns(rows, columns, Smoothing(), task.job.highest, str(part.path))
    return None if curve is None else evaluate_base(curve, rows, task.job.highest)


def _check_finite(part: InputPart, rows: GoodRows, outputs: list[Output], missing: bool) -> None:
    """Raise `JounceError` where results are infinite, or NaN where none may be `missing`."""
    for output in outputs:
        for k, values in enumerate(output.rates):
            bad = np.isinf(values) if missing else ~np.isfinite(values)
            if bad.any():
                i, j = np.argwhere(bad)[0]
                came = f"{output.names[j]}.{rate_name(output.symbol, k)} is {values[i, j]}"
                where = describe_place(part.path, int(rows.places[i]))
                raise JounceError(f"{where}: {came}; expected a state whose results are finite numbers")


def read_motions(task: Task, part: InputPart, skipped: list[Skipped]) -> Iterator[tuple[str, Motion]]:
    """The motions of a part, each with its name, read as a whole."""
    name, pieces = "", list[tuple[Columns, np.ndarray]]()
    for rows in read_rows(task, part, skipped):
        for run in rows.runs:
            if pieces and run.motion != name:
                yield from _fit_motion(task, part, name, pieces, skipped)
                pieces = []
            name, here = run.motion, slice(run.start, run.stop)
            pieces.append(({column: x[here] for column, x in rows.columns.items()}, rows.places[here]))
    if pieces:
        yield from _fit_motion(task, part, name, pieces, skipped)


def _fit_motion(
    task: Task, part: InputPart, name: str, pieces: list[tuple[Columns, np.ndarray]], skipped: list[Skipped]
) -> Iterator[tuple[str, Motion]]:
    """The motion of samples with the places of their rows; one that cannot be had of them is refused, or left out."""
    job, where = task.job, f"{part.path}: motion {quote_value(name)}" if name else str(part.path)
    columns = {column: np.concatenate([piece[column] for piece, _ in pieces]) for column in pieces[0][0]}
    reading, table, places = job.reading, select_format(part.path), np.concatenate([at for _, at in pieces]).tolist()
    try:
        order, problems, notes = order_rows(columns, task.match)
        leave_out_rows(problems, len(places), lambda i: table.place(part.path, places[i]), reading.skip)
        for i, (column, problem) in sorted(problems.items()):
            cells = {source: repr(float(x[i])) for source, x in columns.items()}
            number = table.number(part.path, places[i], table.FIRST)
            skipped.append(Skipped(str(part.path), number, column, problem, cells))
        columns = {column: x[order] for column, x in columns.items()}
        way = reading.way or Smoothing()
        found = motion_from_columns(columns, task.match, job.robot.mechanism, job.highest, where, way, part.origin)
        found = replace(found, notes=(*notes, *torque_notes(columns, task.match), *found.notes))
        found = with_vibration_notes(found, job.robot)
        with locate_errors(where):
            found = found if reading.blend is None else found.blended(reading.blend, max(4, job.highest))
            found = found if reading.step is None else found.with_step(reading.step)
    except JounceError as error:
        if not reading.skip:
            raise
        row = table.number(part.path, places[0], table.FIRST)
        skipped.append(Skipped(str(part.path), row, "", f"the motion that begins here: {error}"))
        return
    yield name, found
