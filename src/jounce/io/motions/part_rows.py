"""Read the rows of a part of a table: good ones in runs of one motion each, and as states of a robot.

Bad rows are refused, or left out and recorded as `Skipped`. There are four doors: `read_rows` gives rows chunk by
chunk, the next one read while one is computed; `read_motions` whole motions, whose rates follow from all of their
samples; `read_stretches` stretches of motions in rows that state all rates. What happens between two rows is in one of
the stretches: each begins with the last row of the one before, and the last one of a part ends at the first row behind
it. `compute_rows` computes rows that state all rates, each alone, whatever the rows next to it are: chunk by chunk
their `RowStates`, and what a law computes of these.

`write_skipped` writes the rows that are left out to a table next to an output.
"""

import csv
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
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
from jounce.io.motions.logs import describe_empty_rows, find_empty_rows, order_rows, read_stamps, torque_notes
from jounce.io.motions.table_parts import MOTION_COLUMN, InputPart, TableLayout
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
    """Rows of one motion that follow each other: from `start` to `stop` in the columns."""

    motion: str
    start: int
    stop: int


class GoodRows(NamedTuple):
    """Good rows: their columns as the table names them, the runs of motions, and the places of rows in the file."""

    columns: Columns
    runs: list[MotionRun]
    places: np.ndarray


@dataclass(frozen=True)
class Skipped:
    """A row that is left out: its file, its number or that of its line, the column that is wrong and how, its cells.

    Of a motion that is left out, or of rows that cannot be read, it is the first row.
    """

    file: str
    row: int
    column: str
    problem: str
    cells: Mapping[str, str] = field(default_factory=dict)


def read_rows(layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[GoodRows]:
    """The good rows of a part, chunk by chunk; bad ones are added to `skipped`."""
    table, skip, place = select_format(part.path), layout.reading.skip, part.span.start
    try:
        table.names(part.path)  # raises the right error for a file that cannot be read at all
        last = row_before(layout, part)
        texts = MOTION_COLUMN if part.motion is None else None
        for chunk in read_ahead(_chunks(layout, part, layout.match.names, texts, part.span)):
            place = int(chunk.places[-1])
            rows = _check_rows(layout, part, chunk, last, skipped)
            if rows.runs:
                last = rows.runs[-1].motion, float(rows.columns[layout.match.sources[TIME]][-1])
                yield rows
    except JounceError as error:
        if not skip:
            raise
        number = table.number(part.path, place, table.FIRST)
        skipped.append(Skipped(str(part.path), number, "", f"the rows of this part from here on: {error}"))


def _chunks(layout: TableLayout, part: InputPart, names: list[str], texts: str | None, span: Span) -> Iterator[Chunk]:
    """Chunks of a table, whose times are since the origin of the part."""
    time = layout.match.sources[TIME]
    left = remainder_name(time)
    asked = [*names, *([left] if part.origin else [])]
    for chunk in select_format(part.path).chunks(part.path, asked, texts, span):
        with locate_errors(part.path):
            chunk = read_stamps(chunk, layout.match)
        if part.origin:
            columns = {name: x for name, x in chunk.columns.items() if name != left}
            columns[time] = part.origin.since(columns[time], chunk.columns[left])
            chunk = replace(chunk, columns=columns)
        yield chunk


def read_ahead(chunks: Iterator[Chunk]) -> Iterator[Chunk]:
    """Chunks, each of which is read while the one before is computed and written."""
    context = copy_context()  # errors of the thread are in the words of the command that runs

    def read_next() -> Chunk | None:
        return context.run(lambda: next(chunks, None))

    with ThreadPoolExecutor(1) as reader:
        following = reader.submit(read_next)
        while (chunk := following.result()) is not None:
            following = reader.submit(read_next)
            yield chunk


def row_before(layout: TableLayout, part: InputPart) -> tuple[str, float] | None:
    """The motion and the time of the row before a part, if there is one that may belong to its first motion."""
    table, time = select_format(part.path), layout.match.sources[TIME]
    span = table.row_before(part.path, part.span.start) if layout.independent else None
    try:
        for chunk in (
            _chunks(layout, part, [time], MOTION_COLUMN if part.motion is None else None, span) if span else ()
        ):
            motion = part.motion if chunk.motions is None else str(chunk.motions[-1])
            t = float(chunk.columns[time][-1])
            return None if chunk.broken or not np.isfinite(t) else (motion or "", t)
    except JounceError:  # the part before reports it
        pass
    return None


def _check_rows(
    layout: TableLayout, part: InputPart, chunk: Chunk, last: tuple[str, float] | None, skipped: list[Skipped]
) -> GoodRows:
    """The rows of a chunk without the bad ones."""
    problems = chunk.problems(dict.fromkeys(layout.match.sources.values()))  # measured torques may be missing
    good, empty = np.ones(len(chunk.places) - 1, dtype=bool), find_empty_rows(chunk, layout.match, problems)
    for note in describe_empty_rows(len(empty), len(good)):
        warn(f"{part.path}: {note}")
    good[[*problems, *empty]] = False
    problems = {i: problem for i, problem in problems.items() if i not in {*empty}}
    if not layout.match.sampled:  # samples are sorted as a whole
        problems |= _find_late_rows(layout, part, chunk, good, last)
    table = select_format(part.path)
    known = table.FIRST
    for i in sorted(problems):
        column, problem = problems[i]
        place = int(chunk.places[i])
        known = place, table.number(part.path, place, known)
        if not layout.reading.skip:
            came = f"column {quote_value(column)} {problem}" if column else problem
            raise JounceError(f"{table.row(part.path, known[1])}: {came}; {ROW_CURE}")
        cells = {name: chunk.texts.get((i, name), repr(float(x[i]))) for name, x in chunk.columns.items()}
        skipped.append(Skipped(str(part.path), known[1], column, problem, cells))
    if not problems and not empty:
        return GoodRows(chunk.columns, _runs(part, chunk.motions, len(good)), chunk.places[:-1])
    good[list(problems)] = False
    motions = None if chunk.motions is None else chunk.motions[good]
    columns = {name: column[good] for name, column in chunk.columns.items()}
    return GoodRows(columns, _runs(part, motions, int(good.sum())), chunk.places[:-1][good])


def _find_late_rows(
    layout: TableLayout, part: InputPart, chunk: Chunk, good: np.ndarray, last: tuple[str, float] | None
) -> dict[int, tuple[str, str]]:
    """Good rows whose time does not follow that of the rows before them in their motion."""
    found: dict[int, tuple[str, str]] = {}
    name = layout.match.sources[TIME]
    at = np.flatnonzero(good)
    times = chunk.columns[name][at]
    for run in _runs(part, None if chunk.motions is None else chunk.motions[at], len(at)):
        t = times[run.start : run.stop]
        before = np.maximum.accumulate(t)[:-1]
        first = last[1] if last and last[0] == run.motion and run.start == 0 else -np.inf
        latest = np.fmax(np.concatenate([[-np.inf], before]), first)  # the time before may be missing
        for i in np.flatnonzero(t <= latest).tolist():
            found[int(at[run.start + i])] = name, f"does not increase: {t[i]:.17g} follows {latest[i]:.17g}"
    return found


def _runs(part: InputPart, motions: np.ndarray | None, count: int) -> list[MotionRun]:
    if motions is None:
        return [MotionRun(part.motion or "", 0, count)] if count else []
    cuts = [0, *(np.flatnonzero(motions[1:] != motions[:-1]) + 1).tolist(), count]
    return [MotionRun(str(motions[i]), i, j) for i, j in itertools.pairwise(cuts) if i < j]


def read_motions(layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[tuple[str, Motion]]:
    """The motions of a part, each with its name, read as a whole."""
    name, pieces = "", list[tuple[Columns, np.ndarray]]()
    for rows in read_rows(layout, part, skipped):
        for run in rows.runs:
            if pieces and run.motion != name:
                yield from _fit_motion(layout, part, name, pieces, skipped)
                pieces = []
            name, here = run.motion, slice(run.start, run.stop)
            pieces.append(({column: x[here] for column, x in rows.columns.items()}, rows.places[here]))
    if pieces:
        yield from _fit_motion(layout, part, name, pieces, skipped)


def _fit_motion(
    layout: TableLayout, part: InputPart, name: str, pieces: list[tuple[Columns, np.ndarray]], skipped: list[Skipped]
) -> Iterator[tuple[str, Motion]]:
    """The motion of samples with the places of their rows; one that cannot be had of them is refused, or left out."""
    where = f"{part.path}: motion {quote_value(name)}" if name else str(part.path)
    columns = {column: np.concatenate([piece[column] for piece, _ in pieces]) for column in pieces[0][0]}
    reading, table, places = layout.reading, select_format(part.path), np.concatenate([at for _, at in pieces]).tolist()
    try:
        order, problems, notes = order_rows(columns, layout.match)
        leave_out_rows(problems, len(places), lambda i: table.place(part.path, places[i]), reading.skip)
        for i, (column, problem) in sorted(problems.items()):
            cells = {source: repr(float(x[i])) for source, x in columns.items()}
            number = table.number(part.path, places[i], table.FIRST)
            skipped.append(Skipped(str(part.path), number, column, problem, cells))
        columns = {column: x[order] for column, x in columns.items()}
        way = reading.way or Smoothing()
        found = motion_from_columns(
            columns, layout.match, layout.robot.mechanism, layout.highest, where, way, part.origin
        )
        found = replace(found, notes=(*notes, *torque_notes(columns, layout.match), *found.notes))
        found = with_vibration_notes(found, layout.robot)
        with locate_errors(where):
            found = found if reading.blend is None else found.blended(reading.blend, max(4, layout.highest))
            found = found if reading.step is None else found.with_step(reading.step)
    except JounceError as error:
        if not reading.skip:
            raise
        row = table.number(part.path, places[0], table.FIRST)
        skipped.append(Skipped(str(part.path), row, "", f"the motion that begins here: {error}"))
        return
    yield name, found


MAX_STRETCH_ROWS = 8000  # read at a time, as some of a check takes time with the square of their number


def read_stretches(layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[tuple[str, int, Motion]]:
    """Stretches of motions with the number of their rows: each begins with the last row of the one before."""
    before: tuple[str, Columns] | None = None  # a motion and its last row so far
    alone = False  # whether that row is the only one
    for rows, ours in _read_with_next(layout, part, skipped):
        for run in _cut_runs(rows.runs):
            columns = {name: x[run.start : run.stop] for name, x in rows.columns.items()}
            count = run.stop - run.start
            if before and before[0] == run.motion:
                columns = {name: np.concatenate([before[1][name], x]) for name, x in columns.items()}
            elif not ours:
                break
            elif alone and before:
                raise _too_short(part, before[0])
            one = len(next(iter(columns.values()))) == 1
            alone = one and (before is not None or not _is_continued(layout, part, run.motion))
            if not one:
                m, place = layout.robot.mechanism, str(part.path)
                motion = motion_from_columns(columns, layout.match, m, layout.highest, place, Smoothing(), part.origin)
                yield run.motion, count if ours else 0, motion
            before = run.motion, {name: x[-1:] for name, x in columns.items()}
    if alone and before:
        raise _too_short(part, before[0])


def _is_continued(layout: TableLayout, part: InputPart, motion: str) -> bool:
    """Whether the row before a part is of a motion, which the part before then checks up to the first row of this one.

    A bad row, which is left out, may be of any motion: it does not end the run.
    """
    known = row_before(layout, part)
    return part.span.start > 0 and (known[0] == motion if known else layout.reading.skip)


def _cut_runs(runs: list[MotionRun]) -> Iterator[MotionRun]:
    """Runs of at most `MAX_STRETCH_ROWS` rows."""
    for run in runs:
        for start in range(run.start, run.stop, MAX_STRETCH_ROWS):
            yield MotionRun(run.motion, start, min(start + MAX_STRETCH_ROWS, run.stop))


def _read_with_next(layout: TableLayout, part: InputPart, skipped: list[Skipped]) -> Iterator[tuple[GoodRows, bool]]:
    """The rows of a part, and the row behind it, if there is one, which is not its own."""
    for rows in read_rows(layout, part, skipped):
        yield rows, True
    behind = select_format(part.path).next_row(part.path, part.span.stop) if part.size else None
    if behind is not None:
        for rows in read_rows(layout, replace(part, span=behind), []):
            yield rows, False


def _too_short(part: InputPart, motion: str) -> JounceError:
    return JounceError(f"{part.path}: motion {motion!r} has one row; expected two or more, to check between them")


# The table of rows that are left out.
SKIPPED_HEADER = b"file,row,column,problem"  # of a table of rows that are left out


def resolve_output(output: Path) -> Path:
    """The path of an output, where a link leads: the link stays, and results lie on the disk that it points to."""
    return output.resolve() if output.is_symlink() else output


def skipped_path(output: Path) -> Path:
    """The table of the rows that are left out."""
    path = resolve_output(output)
    return path.with_name(f"{path.name}.skipped.csv")


def check_skipped(path: Path) -> None:
    """Raise `JounceError` if a table of rows that are left out would replace a file of another kind."""
    if path.exists() and not _is_ours(path):
        raise JounceError(f"{path}: bad rows are written there, and it is not of an earlier run; move it away")


def write_skipped(path: Path, columns: Sequence[str], rows: Iterator[Skipped]) -> None:
    """Write the rows that are left out, with all their cells as texts; without any, that of an earlier run goes."""
    first = next(rows, None)
    if first is None:
        if _is_ours(path):
            path.unlink()
        return
    with files.write_whole(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["file", "row", "column", "problem", *columns])
        for row in chain([first], rows):
            writer.writerow([row.file, row.row, row.column, row.problem, *(row.cells.get(x, "") for x in columns)])


def _is_ours(path: Path) -> bool:
    """Whether a file is a table of rows that an earlier run left out."""
    return path.is_file() and path.read_bytes()[: len(SKIPPED_HEADER)] == SKIPPED_HEADER


MAX_UNIT_CHECK_ROWS = 4096  # of a table, from its start: enough to recognise degrees and milliseconds
ColumnsByName = Mapping[str, np.ndarray]
Wrenches = tuple[ColumnsByName, ...]


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
        rates = closed_path.with_tree_positions(self.rates, self.position)
        try:
            return generic_methods.as_tuple(compute(robot, row.name, rates, wrench=W, base=self.base, method=method))
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
        units.check_units(t[first], q, qd, m, (match.angles_stated, match.time_stated), str(part.path))
    states = tuple(np.stack(columns, axis=1) for columns in rates)
    for here in (slice(run.start, run.stop) for run in rows.runs):
        units.refuse_unit_changes(t[here], states[0][here], m, str(part.path))
        refuse_wraps(t[here], states[0][here], Turning.of_robot(m), str(part.path))
    of_base = {name: si[name] for name in body_columns.select_base_columns(list(si), m)}
    return RowStates(
        t,
        states,
        _row_wrenches(layout, part, si, highest),
        _base_rates(part, of_base, t, highest),
        _closed_positions(layout, part, si, rows.runs, states),
        (writing.column_channel(list(of_base), t, (np.stack(list(of_base.values()), axis=1),)),) if of_base else (),
    )


def _closed_positions(
    layout: TableLayout, part: InputPart, si: ColumnsByName, runs: list[MotionRun], rates: Rates
) -> np.ndarray | None:
    """All coordinates of a closed robot, from the rows that state them, checked for jumps within each motion."""
    m = layout.robot.mechanism
    if m.closure is None or not m.takes_dependent:
        return None
    found = np.stack([si[f"{name}.q"] for name in m.closure.coordinates], axis=1)
    with locate_errors(str(part.path)):
        for run in runs:
            here = slice(run.start, run.stop)
            found[here] = closed_path.continue_rows(
                layout.robot, si[TIME][here], [rate[here] for rate in rates[:3]], found[here]
            )
    return found


def _row_wrenches(layout: TableLayout, part: InputPart, si: ColumnsByName, highest: int) -> Wrenches | None:
    """W, Wd, ... by body, from columns that state all of them."""
    columns = {name: si[name] for name in body_columns.select_wrench_columns(list(si), layout.robot.mechanism)}
    if not columns:
        return None
    rows = np.arange(len(si[TIME]), dtype=float)  # in place of times, which begin again with each motion
    order = highest - (DEFAULT_QUANTITY.takes.rates - 1)
    curves, _ = body_columns.build_wrenches(rows, columns, layout.robot.mechanism, order, Smoothing(), str(part.path))
    of_bodies = {body: curve.rates(rows, order) for body, curve in curves.items()}
    return tuple({body: rates[k] for body, rates in of_bodies.items()} for k in range(order + 1))


def _base_rates(part: InputPart, columns: ColumnsByName, t: np.ndarray, highest: int) -> Rates | None:
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
