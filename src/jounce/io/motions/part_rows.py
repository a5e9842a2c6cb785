"""Read the rows of a part of a table.

Good rows come in runs of one motion each, and as states of a robot. Bad rows are refused, or left out and recorded as
`Skipped`. There are four doors:

1. `read_rows` gives rows chunk by chunk; the next chunk is read while one is computed.
2. `read_motions` gives whole motions, whose rates follow from all of their samples.
3. `read_stretches` gives stretches of motions in rows that state all rates. What happens between two rows is in one of
   the stretches: each begins with the last row of the one before, and the last stretch of a part ends at the first row
   behind the part.
4. `compute_rows` computes rows that state all rates, each alone, whatever the rows next to it are: chunk by chunk their
   `RowStates`, and what a law computes of these.

`write_skipped` writes the rows that are left out to a table next to an output.
"""

import csv
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from contextvars import copy_context
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jounce.core.errors import JounceError, UncertainError, locate_errors, quote_value, warn
from jounce.dynamics.quantities import DEFAULT_QUANTITY, Quantity
from jounce.engine import certain_digits, closed_path, generic_methods
from jounce.engine.along import with_vibration_notes
from jounce.engine.engine import Engine
from jounce.engine.plan import compute
from jounce.io import files
from jounce.io.motions import writing
from jounce.io.motions.logs import (
    describe_empty_rows,
    find_empty_rows,
    find_equal_end,
    order_rows,
    read_stamps,
    torque_notes,
)
from jounce.io.motions.table_parts import InputPart, TableLayout
from jounce.io.remainders import remainder_name
from jounce.io.table_format import ROW_CURE, Chunk, Columns, Span, leave_out_rows
from jounce.io.tables import describe_place, select_format
from jounce.motion import body_columns, units
from jounce.motion.base import evaluate_base
from jounce.motion.channel import Channel, Rates
from jounce.motion.motion import Motion
from jounce.motion.spline import Smoothing
from jounce.motion.table import motion_from_columns
from jounce.motion.table_columns import TIME
from jounce.motion.wraps import Turning, refuse_wraps
from jounce.spatial.series import rate_name


class MotionRun(NamedTuple):
    """Rows of one motion that follow each other.

    They go from `start` to `stop` in the columns.
    """

    motion: str
    start: int
    stop: int


class GoodRows(NamedTuple):
    """Good rows of a chunk.

    `columns` have the names of the table; `places` are those of the rows in the file.
    """

    columns: Columns
    runs: list[MotionRun]
    places: np.ndarray


@dataclass(frozen=True)
class Skipped:
    """A row that is left out.

    It is the first row of a motion that is left out, or of rows that cannot be read.
    """

    file: str
    row: int  # its number, or that of its line
    column: str  # the column that is wrong, "" where it is the row as a whole
    problem: str
    cells: Mapping[str, str] = field(default_factory=dict)


def read_rows(layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[GoodRows]:
    """Yield the good rows of a part, chunk by chunk.

    Bad rows are added to `skipped`.
    """
    table, skip, place = select_format(part.path), layout.reading.skip, part.span.start
    try:
        # Names are read first, which raises the right error for a file that cannot be read at all.
        table.names(part.path)
        last_row = row_before(layout, part)
        texts = layout.motion_column if part.motion is None else None
        for chunk in read_ahead(_chunks(layout, part, layout.match.names, texts, part.span)):
            place = int(chunk.places[-1])
            rows = _check_rows(layout, part, chunk, last_row, skipped)
            if len(rows.runs) > 0:
                last_row = rows.runs[-1].motion, float(rows.columns[layout.match.sources[TIME]][-1])
                yield rows
    # A file that is damaged in the middle loses the rows from there on.
    except JounceError as error:
        if not skip:
            raise
        number = table.number(part.path, place, table.FIRST)
        skipped.append(Skipped(str(part.path), number, "", f"the rows of this part from here on: {error}"))


def _chunks(layout: TableLayout, part: InputPart, names: list[str], texts: str | None, span: Span) -> Iterator[Chunk]:
    """Yield chunks of a table, with times since the part's origin."""
    time = layout.match.sources[TIME]
    remainder = remainder_name(time)
    selected_names = names if part.origin is None else [*names, remainder]
    for chunk in select_format(part.path).chunks(part.path, selected_names, texts, span):
        with locate_errors(part.path):
            chunk = read_stamps(chunk, layout.match)
        # Large stamps lose digits as doubles: the origin is subtracted from them and their remainders.
        if part.origin is not None:
            columns = {name: x for name, x in chunk.columns.items() if name != remainder}
            columns[time] = part.origin.since(columns[time], chunk.columns[remainder])
            chunk = replace(chunk, columns=columns)
        yield chunk


def read_ahead(chunks: Iterator[Chunk]) -> Iterator[Chunk]:
    """Yield chunks, each read while the one before is computed."""
    # Errors of the thread are in the words of the command that runs.
    context = copy_context()

    def read_next() -> Chunk | None:
        return context.run(lambda: next(chunks, None))

    with ThreadPoolExecutor(1) as reader:
        chunk = reader.submit(read_next).result()
        while chunk is not None:
            next_chunk = reader.submit(read_next)
            yield chunk
            chunk = next_chunk.result()


def row_before(layout: TableLayout, part: InputPart) -> tuple[str, float] | None:
    """Return the motion and the time of the row before a part.

    Return None where there is no such row that may belong to the first motion of the part.
    """
    table, time = select_format(part.path), layout.match.sources[TIME]
    span = table.row_before(part.path, part.span.start) if layout.independent else None
    if span is None:
        return None
    texts = layout.motion_column if part.motion is None else None
    # What is wrong with the row is reported with the part before.
    with suppress(JounceError):
        for chunk in _chunks(layout, part, [time], texts, span):
            motion = part.motion if chunk.motions is None else str(chunk.motions[-1])
            t = float(chunk.columns[time][-1])
            is_good = len(chunk.broken) == 0 and np.isfinite(t)
            return (motion or "", t) if is_good else None
    return None


def _check_rows(
    layout: TableLayout, part: InputPart, chunk: Chunk, last_row: tuple[str, float] | None, skipped: list[Skipped]
) -> GoodRows:
    """Return the good rows of a chunk.

    `last_row` are the motion and the time of the row before. Bad rows are refused, or added to `skipped`.
    """
    # Cells have to be numbers, but for those of measured torques. Rows without any number but a time are no fault.
    problems = chunk.problems(dict.fromkeys(layout.match.sources.values()))
    empty_rows = find_empty_rows(chunk, layout.match, problems)
    is_good = np.ones(len(chunk.places) - 1, dtype=bool)
    for note in describe_empty_rows(len(empty_rows), len(is_good)):
        warn(f"{part.path}: {note}")
    # Last rows of a motion that repeat the one before say nothing new. Those of samples are left out with their motion.
    for run in () if layout.match.sampled else _runs(part, chunk.motions, len(is_good)):
        equal_count, notes = find_equal_end({name: x[run.start : run.stop] for name, x in chunk.columns.items()})
        empty_rows = [*empty_rows, *range(run.stop - equal_count, run.stop)]
        for note in notes:
            warn(f"{part.path}: {note}")
    is_good[[*problems, *empty_rows]] = False
    problems = {i: problem for i, problem in problems.items() if i not in {*empty_rows}}
    # Times have to increase; those of samples are sorted later, for a motion as a whole.
    if not layout.match.sampled:
        problems |= _find_late_rows(layout, part, chunk, is_good, last_row)
    # Numbers of lines are counted on from the last bad row.
    table = select_format(part.path)
    known_row = table.FIRST
    for i in sorted(problems):
        column, problem = problems[i]
        place = int(chunk.places[i])
        known_row = place, table.number(part.path, place, known_row)
        if not layout.reading.skip:
            came = problem if column == "" else f"column {quote_value(column)} {problem}"
            raise JounceError(f"{table.row(part.path, known_row[1])}: {came}; {ROW_CURE}")
        cells = {name: chunk.texts.get((i, name), repr(float(x[i]))) for name, x in chunk.columns.items()}
        skipped.append(Skipped(str(part.path), known_row[1], column, problem, cells))
    # Columns of which no row is left out are not copied.
    if len(problems) == 0 and len(empty_rows) == 0:
        return GoodRows(chunk.columns, _runs(part, chunk.motions, len(is_good)), chunk.places[:-1])
    is_good[list(problems)] = False
    motions = None if chunk.motions is None else chunk.motions[is_good]
    columns = {name: column[is_good] for name, column in chunk.columns.items()}
    return GoodRows(columns, _runs(part, motions, int(is_good.sum())), chunk.places[:-1][is_good])


def _find_late_rows(
    layout: TableLayout, part: InputPart, chunk: Chunk, is_good: np.ndarray, last_row: tuple[str, float] | None
) -> dict[int, tuple[str, str]]:
    """Return the good rows whose time does not increase.

    A time has to be later than all times before it in its motion. Each row has its column and what is wrong.
    """
    late_rows: dict[int, tuple[str, str]] = {}
    name = layout.match.sources[TIME]
    good_rows = np.flatnonzero(is_good)
    times = chunk.columns[name][good_rows]
    for run in _runs(part, None if chunk.motions is None else chunk.motions[good_rows], len(good_rows)):
        t = times[run.start : run.stop]
        # The first run of a chunk may go on from the row before.
        continues = last_row is not None and last_row[0] == run.motion and run.start == 0
        time_before = last_row[1] if last_row is not None and continues else -np.inf
        times_before = np.concatenate([[-np.inf], np.maximum.accumulate(t)[:-1]])
        # fmax leaves out NaN: the time before may be missing.
        latest = np.fmax(times_before, time_before)
        for i in np.flatnonzero(t <= latest).tolist():
            late_rows[int(good_rows[run.start + i])] = (
                name,
                f"does not increase: {t[i]:.17g} follows {latest[i]:.17g}",
            )
    return late_rows


def _runs(part: InputPart, motions: np.ndarray | None, count: int) -> list[MotionRun]:
    """Return the runs of rows of one motion each.

    `motions` (count,) has the name of each row.
    """
    if motions is None:
        return [MotionRun(part.motion or "", 0, count)] if count > 0 else []
    cuts = [0, *(np.flatnonzero(motions[1:] != motions[:-1]) + 1).tolist(), count]
    return [MotionRun(str(motions[i]), i, j) for i, j in itertools.pairwise(cuts) if i < j]


def read_motions(layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[tuple[str, Motion]]:
    """Yield the motions of a part by name, read as a whole."""
    # Runs of one motion are collected until another motion begins.
    name, pieces = "", list[tuple[Columns, np.ndarray]]()
    for rows in read_rows(layout, part, skipped):
        for run in rows.runs:
            if len(pieces) > 0 and run.motion != name:
                yield from _fit_motion(layout, part, name, pieces, skipped)
                pieces = []
            name, run_rows = run.motion, slice(run.start, run.stop)
            pieces.append(({column: x[run_rows] for column, x in rows.columns.items()}, rows.places[run_rows]))
    if len(pieces) > 0:
        yield from _fit_motion(layout, part, name, pieces, skipped)


def _fit_motion(
    layout: TableLayout, part: InputPart, name: str, pieces: list[tuple[Columns, np.ndarray]], skipped: list[Skipped]
) -> Iterator[tuple[str, Motion]]:
    """Yield the motion of samples, whose rows have places in the file.

    A motion that cannot be fitted is refused, or left out and added to `skipped`.
    """
    label = str(part.path) if name == "" else f"{part.path}: motion {quote_value(name)}"
    columns = {column: np.concatenate([piece[column] for piece, _ in pieces]) for column in pieces[0][0]}
    places = np.concatenate([piece_places for _, piece_places in pieces]).tolist()
    reading, table = layout.reading, select_format(part.path)
    try:
        # Rows are sorted by their stamps, where these scatter little; others are bad rows.
        order, problems, notes = order_rows(columns, layout.match)
        leave_out_rows(problems, len(places), lambda i: table.place(part.path, places[i]), reading.skip)
        for i, (column, problem) in sorted(problems.items()):
            cells = {source: repr(float(x[i])) for source, x in columns.items()}
            number = table.number(part.path, places[i], table.FIRST)
            skipped.append(Skipped(str(part.path), number, column, problem, cells))
        columns = {column: x[order] for column, x in columns.items()}
        # The curve is fitted to the samples, then blended, and sampled at a step, where this is requested.
        way = Smoothing() if reading.way is None else reading.way
        motion = motion_from_columns(columns, layout.match, layout.robot.mechanism, label, way=way, origin=part.origin)
        motion = replace(motion, notes=(*notes, *torque_notes(columns, layout.match), *motion.notes))
        motion = with_vibration_notes(motion, layout.robot)
        with locate_errors(label):
            if reading.blend is not None:
                motion = motion.blended(reading.blend, max(4, layout.highest))
            if reading.step is not None:
                motion = motion.with_step(reading.step)
    except JounceError as error:
        if not reading.skip:
            raise
        row = table.number(part.path, places[0], table.FIRST)
        skipped.append(Skipped(str(part.path), row, "", f"the motion that begins here: {error}"))
        return
    yield name, motion


MAX_STRETCH_ROWS = 8000  # read at a time, as some of a check takes time with the square of their number


def read_stretches(layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[tuple[str, int, Motion]]:
    """Yield stretches of motions: name, number of rows, motion.

    Each stretch begins with the last row of the one before, which does not count among its rows.
    """
    # The motion of the last row, its cells, and whether it is a motion of one row so far.
    last_motion: str | None = None
    last_cells: Columns = {}
    is_single_row = False
    for rows, is_own in _read_with_next(layout, part, skipped):
        for run in _cut_runs(rows.runs):
            columns = {name: x[run.start : run.stop] for name, x in rows.columns.items()}
            count = run.stop - run.start
            # A run goes on with the motion, or is another one. The row behind the part belongs to the next part then.
            if last_motion == run.motion:
                columns = {name: np.concatenate([last_cells[name], x]) for name, x in columns.items()}
            elif not is_own:
                break
            elif is_single_row and last_motion is not None:
                raise _too_short(part, last_motion)
            has_one_row = len(next(iter(columns.values()))) == 1
            is_single_row = has_one_row and (last_motion is not None or not _is_continued(layout, part, run.motion))
            if not has_one_row:
                m, place = layout.robot.mechanism, str(part.path)
                motion = motion_from_columns(columns, layout.match, m, place, way=Smoothing(), origin=part.origin)
                yield run.motion, count if is_own else 0, motion
            last_motion, last_cells = run.motion, {name: x[-1:] for name, x in columns.items()}
    if is_single_row and last_motion is not None:
        raise _too_short(part, last_motion)


def _is_continued(layout: TableLayout, part: InputPart, motion: str) -> bool:
    """Return whether the row before a part is of a motion.

    The part before then checks the motion up to the first row of this one. A bad row, which is left out, may be of any
    motion: it does not end the run.
    """
    row = row_before(layout, part)
    may_continue = layout.reading.skip if row is None else row[0] == motion
    return part.span.start > 0 and may_continue


def _cut_runs(runs: list[MotionRun]) -> Iterator[MotionRun]:
    """Yield runs of at most `MAX_STRETCH_ROWS` rows."""
    for run in runs:
        for start in range(run.start, run.stop, MAX_STRETCH_ROWS):
            yield MotionRun(run.motion, start, min(start + MAX_STRETCH_ROWS, run.stop))


def _read_with_next(layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[tuple[GoodRows, bool]]:
    """Yield the rows of a part, then the next row, if any.

    The flag is whether the rows are those of the part.
    """
    for rows in read_rows(layout, part, skipped):
        yield rows, True
    next_row = select_format(part.path).next_row(part.path, part.span.stop) if part.size > 0 else None
    if next_row is not None:
        for rows in read_rows(layout, replace(part, span=next_row), []):
            yield rows, False


def _too_short(part: InputPart, motion: str) -> JounceError:
    return JounceError(f"{part.path}: motion {motion!r} has one row; expected two or more, to check between them")


# The table of rows that are left out.
SKIPPED_HEADER = b"file,row,column,problem"  # of a table of rows that are left out


def resolve_output(output: Path) -> Path:
    """Return the path of an output, where a link leads.

    The link stays, and results lie on the disk that it points to.
    """
    return output.resolve() if output.is_symlink() else output


def skipped_path(output: Path) -> Path:
    """Return the path of the table of rows that are left out."""
    path = resolve_output(output)
    return path.with_name(f"{path.name}.skipped.csv")


def check_skipped(path: Path) -> None:
    """Raise `JounceError` if a table of skipped rows would replace another file.

    A table of an earlier run may be replaced.
    """
    if path.exists() and not _is_ours(path):
        raise JounceError(f"{path}: bad rows are written there, and it is not of an earlier run; move it away")


def write_skipped(path: Path, columns: Sequence[str], rows: Iterator[Skipped]) -> None:
    """Write the rows that are left out, with all their cells.

    Without any, the table of an earlier run is removed.
    """
    first_row = next(rows, None)
    if first_row is None:
        if _is_ours(path):
            path.unlink()
        return
    with files.write_whole(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["file", "row", "column", "problem", *columns])
        for row in chain([first_row], rows):
            writer.writerow([row.file, row.row, row.column, row.problem, *(row.cells.get(x, "") for x in columns)])


def _is_ours(path: Path) -> bool:
    """Return whether a file is a table of skipped rows."""
    return path.is_file() and path.read_bytes()[: len(SKIPPED_HEADER)] == SKIPPED_HEADER


MAX_UNIT_CHECK_ROWS = 4096  # of a table, from its start: enough to recognise degrees and milliseconds
ColumnsByName = Mapping[str, np.ndarray]
Wrenches = tuple[ColumnsByName, ...]


class RowStates(NamedTuple):
    """States at times (N,).

    `rates` are q, qd, ...; `wrench` W, Wd, ... by body; `base` C, V, ...; `position` all coordinates of a closed robot.
    `base_columns` are the columns of the base as the table states them.
    """

    t: np.ndarray
    rates: Rates
    wrench: Wrenches | None
    base: Rates | None
    position: np.ndarray | None
    base_columns: tuple[Channel, ...]

    def compute(self, robot: Engine, row: Quantity, method: str | None) -> Rates:
        """Return a quantity and its rates at all states.

        Rows without certain digits are NaN; a warning counts them.
        """
        # The quantity takes as many rates of wrenches as of q, for its order.
        W = None
        if self.wrench is not None:
            W = self.wrench[: len(self.rates) - row.takes.rates + row.takes.wrench_rates]
        rates = closed_path.with_tree_positions(self.rates, self.position)
        try:
            return generic_methods.as_tuple(compute(robot, row.name, rates, wrench=W, base=self.base, method=method))
        except UncertainError as error:
            times = [self.t[rows] for rows in error.uncertain]
            warn(certain_digits.describe_uncertain(robot.mechanism, error.names, times, len(self.t)))
            return error.results


def compute_rows(
    layout: TableLayout,
    part: InputPart,
    skipped: list[Skipped],
    highest: int,
    law: Callable[[RowStates], Sequence[Channel]],
) -> Iterator[tuple[list[MotionRun], RowStates, list[Channel]]]:
    """Yield the rows of a part, with what a law computes.

    They come chunk by chunk. Each chunk has its motions, its states up to a rate of q, and the channels of the law.
    """
    for number, rows in enumerate(read_rows(layout, part, skipped)):
        states = _read_states(layout, part, rows, highest, is_first=number == 0)
        channels = [_arrange_columns(channel) for channel in law(states)]
        _check_finite(part, rows, channels, missing=layout.robot.mechanism.closure is not None)
        yield rows.runs, states, channels


def _read_states(layout: TableLayout, part: InputPart, rows: GoodRows, highest: int, is_first: bool) -> RowStates:
    """Return the states in rows, in SI units.

    The units of the first motion of a part are checked.
    """
    match, m = layout.match, layout.robot.mechanism
    si = {
        name: rows.columns[source] if match.factors[name] == 1 else rows.columns[source] * match.factors[name]
        for name, source in match.sources.items()
    }
    t, joints = si[TIME], layout.robot.joint_names
    rates = [[si[f"{joint}.{rate_name('q', k)}"] for joint in joints] for k in range(highest + 1)]
    if is_first:
        first_rows = slice(0, min(rows.runs[0].stop, MAX_UNIT_CHECK_ROWS))
        q, qd = (np.stack([x[first_rows] for x in columns], axis=1) for columns in rates[:2])
        units.check_units(t[first_rows], q, qd, m, (match.angles_stated, match.time_stated), str(part.path))
    # Columns (N,) of the joints -> (N, n) for each rate of q.
    states = tuple(np.stack(columns, axis=1) for columns in rates)
    for run in rows.runs:
        run_rows = slice(run.start, run.stop)
        units.refuse_unit_changes(t[run_rows], states[0][run_rows], m, str(part.path))
        refuse_wraps(t[run_rows], states[0][run_rows], Turning.of_robot(m), str(part.path))
    base_columns = {name: si[name] for name in body_columns.select_base_columns(list(si), m)}
    base_channels: tuple[Channel, ...] = ()
    if len(base_columns) > 0:
        values = np.stack(list(base_columns.values()), axis=1)
        base_channels = (writing.column_channel(list(base_columns), t, (values,)),)
    return RowStates(
        t,
        states,
        _row_wrenches(layout, part, si, highest),
        _base_rates(part, base_columns, t, highest),
        _closed_positions(layout, part, si, rows.runs, states),
        base_channels,
    )


def _closed_positions(
    layout: TableLayout, part: InputPart, si: ColumnsByName, runs: list[MotionRun], rates: Rates
) -> np.ndarray | None:
    """Return all coordinates (N, tree) of a closed robot, None for others.

    Rows state them; jumps within a motion are refused.
    """
    m = layout.robot.mechanism
    if m.closure is None or not m.takes_dependent:
        return None
    positions = np.stack([si[f"{name}.q"] for name in m.closure.coordinates], axis=1)
    with locate_errors(str(part.path)):
        for run in runs:
            run_rows = slice(run.start, run.stop)
            run_rates = [rate[run_rows] for rate in rates[:3]]
            positions[run_rows] = closed_path.continue_rows(
                layout.robot, si[TIME][run_rows], run_rates, positions[run_rows]
            )
    return positions


def _row_wrenches(layout: TableLayout, part: InputPart, si: ColumnsByName, highest: int) -> Wrenches | None:
    """Return W, Wd, ... by body, from columns that state all."""
    columns = {name: si[name] for name in body_columns.select_wrench_columns(list(si), layout.robot.mechanism)}
    if len(columns) == 0:
        return None
    # Rows stand in place of times, which begin again with each motion.
    rows = np.arange(len(si[TIME]), dtype=float)
    order = highest - (DEFAULT_QUANTITY.takes.rates - 1)
    curves, _ = body_columns.build_wrenches(rows, columns, layout.robot.mechanism, order, Smoothing(), str(part.path))
    # Rates by body -> bodies by rate.
    rates_of_body = {body: curve.rates(rows, order) for body, curve in curves.items()}
    return tuple({body: rates[k] for body, rates in rates_of_body.items()} for k in range(order + 1))


def _base_rates(part: InputPart, columns: ColumnsByName, t: np.ndarray, highest: int) -> Rates | None:
    """Return C, V, Vd, ... of the base, from columns of all rates."""
    # Rows stand in place of times, which begin again with each motion.
    rows = np.arange(len(t), dtype=float)
    curve, _ = body_columns.curve_from_columns(rows, columns, Smoothing(), highest, str(part.path))
    return None if curve is None else evaluate_base(curve, rows, highest)


def _arrange_columns(channel: Channel) -> Channel:
    """Return a channel with numbers column by column, as written."""
    return channel.map(np.asfortranarray)


def _check_finite(part: InputPart, rows: GoodRows, channels: Sequence[Channel], missing: bool) -> None:
    """Raise `JounceError` where results are infinite, or NaN.

    NaN passes where results may be `missing`.

    """
    for channel in channels:
        for name, values in zip(channel.rate_names, channel.rates, strict=True):
            is_bad = np.isinf(values) if missing else ~np.isfinite(values)
            if is_bad.any():
                i, j = np.argwhere(is_bad)[0]
                row_words = describe_place(part.path, int(rows.places[i]))
                raise JounceError(
                    f"{row_words}: {channel.names[j]}.{name} is {values[i, j]}; expected a state whose results are"
                    " finite numbers"
                )
