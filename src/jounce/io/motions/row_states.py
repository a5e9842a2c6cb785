"""Rows that state all rates as states of a robot: each is computed alone, whatever the rows next to it are."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from jounce.core.errors import JounceError, UncertainError, locate_errors, warn
from jounce.dynamics.quantities import DEFAULT_QUANTITY, Quantity
from jounce.engine import certain_digits
from jounce.engine.closed_path import continue_rows, with_tree_positions
from jounce.engine.engine import Engine
from jounce.engine.generic_methods import as_tuple
from jounce.engine.plan import compute
from jounce.io.motions.part_rows import GoodRows, MotionRun, Skipped, read_rows
from jounce.io.motions.table_parts import InputPart, TableLayout
from jounce.io.motions.writing import column_channel
from jounce.io.tables import describe_place
from jounce.motion import body_columns
from jounce.motion.base import evaluate_base
from jounce.motion.channel import Channel, Rates
from jounce.motion.spline import Smoothing
from jounce.motion.table_columns import TIME
from jounce.motion.units import check_units, refuse_unit_changes
from jounce.motion.wraps import Turning, refuse_wraps
from jounce.spatial.series import rate_name

MAX_UNIT_CHECK_ROWS = 4096  # of a table, from its start: enough to recognise degrees and milliseconds

Columns = Mapping[str, np.ndarray]
Wrenches = tuple[Columns, ...]


class RowStates(NamedTuple):
    """States at times (N,): q, qd, ..., W, Wd, ... by body, C, V, ... of a base, and all coordinates of closed robots.

    `base_columns` are those of the base as the table states them.
    """

    t: np.ndarray
    rates: Rates
    wrench: Wrenches | None
    base: Rates | None
    position: np.ndarray | None
    base_columns: tuple[Channel, ...]

    def compute(self, robot: Engine, row: Quantity, method: str | None) -> Rates:
        """A quantity and its rates at all states; a warning counts rows without certain digits, which are NaN."""
        W = self.wrench and self.wrench[: len(self.rates) - row.takes.rates + row.takes.wrench_rates]
        rates = with_tree_positions(self.rates, self.position)
        try:
            return as_tuple(compute(robot, row.name, rates, wrench=W, base=self.base, method=method))
        except UncertainError as error:
            times = [self.t[where] for where in error.uncertain]
            warn(certain_digits.describe_uncertain(robot.mechanism, error.names, times, len(self.t)))
            return error.results


def compute_rows(
    layout: TableLayout,
    part: InputPart,
    skipped: list[Skipped],
    highest: int,
    law: Callable[[RowStates], Sequence[Channel]],
) -> Iterator[tuple[list[MotionRun], RowStates, list[Channel]]]:
    """The rows of a part, chunk by chunk: their motions, states up to a rate of q, and what a law computes of these."""
    for number, rows in enumerate(read_rows(layout, part, skipped)):
        states = _read_states(layout, part, rows, highest, is_first=number == 0)
        channels = [_arrange_columns(channel) for channel in law(states)]
        _check_finite(part, rows, channels, missing=layout.robot.mechanism.closure is not None)
        yield rows.runs, states, channels


def _read_states(layout: TableLayout, part: InputPart, rows: GoodRows, highest: int, is_first: bool) -> RowStates:
    """The states in rows; the units of the first motion of a part are looked at."""
    match, m = layout.match, layout.robot.mechanism
    si = {
        name: rows.columns[source] if match.factors[name] == 1 else rows.columns[source] * match.factors[name]
        for name, source in match.sources.items()
    }
    t, joints = si[TIME], layout.robot.joint_names
    rates = [[si[f"{joint}.{rate_name('q', k)}"] for joint in joints] for k in range(highest + 1)]
    if is_first:
        first = slice(0, min(rows.runs[0].stop, MAX_UNIT_CHECK_ROWS))
        q, qd = (np.stack([x[first] for x in columns], axis=1) for columns in rates[:2])
        check_units(t[first], q, qd, m, (match.angles_stated, match.time_stated), str(part.path))
    states = tuple(np.stack(columns, axis=1) for columns in rates)
    for here in (slice(run.start, run.stop) for run in rows.runs):
        refuse_unit_changes(t[here], states[0][here], m, str(part.path))
        refuse_wraps(t[here], states[0][here], Turning.of_robot(m), str(part.path))
    of_base = {name: si[name] for name in body_columns.select_base_columns(list(si), m)}
    return RowStates(
        t,
        states,
        _row_wrenches(layout, part, si, highest),
        _base_rates(part, of_base, t, highest),
        _closed_positions(layout, part, si, rows.runs, states),
        (column_channel(list(of_base), t, (np.stack(list(of_base.values()), axis=1),)),) if of_base else (),
    )


def _closed_positions(
    layout: TableLayout, part: InputPart, si: Columns, runs: list[MotionRun], rates: Rates
) -> np.ndarray | None:
    """All coordinates of a closed robot, from the rows that state them, checked for jumps within each motion."""
    m = layout.robot.mechanism
    if m.closure is None or not m.takes_dependent:
        return None
    found = np.stack([si[f"{name}.q"] for name in m.closure.coordinates], axis=1)
    with locate_errors(str(part.path)):
        for run in runs:
            here = slice(run.start, run.stop)
            found[here] = continue_rows(layout.robot, si[TIME][here], [rate[here] for rate in rates[:3]], found[here])
    return found


def _row_wrenches(layout: TableLayout, part: InputPart, si: Columns, highest: int) -> Wrenches | None:
    """W, Wd, ... by body, from columns that state all of them."""
    columns = {name: si[name] for name in body_columns.select_wrench_columns(list(si), layout.robot.mechanism)}
    if not columns:
        return None
    rows = np.arange(len(si[TIME]), dtype=float)  # in place of times, which begin again with each motion
    order = highest - (DEFAULT_QUANTITY.takes.rates - 1)
    curves, _ = body_columns.build_wrenches(rows, columns, layout.robot.mechanism, order, Smoothing(), str(part.path))
    of_bodies = {body: curve.rates(rows, order) for body, curve in curves.items()}
    return tuple({body: rates[k] for body, rates in of_bodies.items()} for k in range(order + 1))


def _base_rates(part: InputPart, columns: Columns, t: np.ndarray, highest: int) -> Rates | None:
    """C, V, Vd, ... of the base, from columns that state all of its rates."""
    rows = np.arange(len(t), dtype=float)  # in place of times, which begin again with each motion
    curve, _ = body_columns.curve_from_columns(rows, columns, Smoothing(), highest, str(part.path))
    return None if curve is None else evaluate_base(curve, rows, highest)


def _arrange_columns(channel: Channel) -> Channel:
    """The channel with its numbers column by column, as they are written."""
    return channel.map(np.asfortranarray)


def _check_finite(part: InputPart, rows: GoodRows, channels: Sequence[Channel], missing: bool) -> None:
    """Raise `JounceError` where results are infinite, or NaN where none may be `missing`."""
    for channel in channels:
        for name, values in zip(channel.rate_names, channel.rates, strict=True):
            bad = np.isinf(values) if missing else ~np.isfinite(values)
            if bad.any():
                i, j = np.argwhere(bad)[0]
                where = describe_place(part.path, int(rows.places[i]))
                raise JounceError(
                    f"{where}: {channel.names[j]}.{name} is {values[i, j]}; expected a state whose results are finite"
                    " numbers"
                )
