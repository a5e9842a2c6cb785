"""The parts of a table of motions, or of all tables in a folder: spans of files that are read independently.

A part is any span of rows where each row states all that its results need, and whole motions otherwise. Tables of any
size are divided without being read as a whole.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from jounce.core.errors import JounceError, join_names, locate_errors, quote_value
from jounce.engine.engine import Engine
from jounce.io.motions.logs import read_stamps
from jounce.io.remainders import remainder_name
from jounce.io.table_format import Span
from jounce.io.tables import ROW_FORMATS, select_format
from jounce.io.tables import describe_place as place_in_words
from jounce.model import positions
from jounce.motion import body_columns
from jounce.motion.spline import Smoothing, Spline, refuse_smoothing
from jounce.motion.table import DEFAULT_COLUMN_OPTIONS, TimeOrigin, find_origin
from jounce.motion.table_columns import DEVIATION, TIME, ColumnMatch, ColumnOptions, follower_columns, match_columns
from jounce.spatial.series import rate_name

MOTION_COLUMN = "motion"  # the column that names the motion of each row
MAX_PART_CELLS = 1 << 23  # 64 MB of numbers, little of the memory of a worker
MIN_LARGE_TABLE_BYTES = 1 << 28  # 256 MB; smaller tables are read as a whole unless parts are asked for
FIT_MEMORY_RATIO = 60  # bytes of memory per byte of a table whose samples are fitted: 52 to 61 were measured
ASSUMED_MEMORY_BYTES = 1 << 33  # where the system reports none: 8 GB, as most machines have
IGNORED_PREFIXES = (".", "_")  # what names of files begin with that are no data


@dataclass(frozen=True)
class Reading:
    """How the input is read: its columns, and how curves follow from samples.

    `blend` and `step` are those of `Motion.blended` and `Motion.with_step`.
    """

    options: ColumnOptions = DEFAULT_COLUMN_OPTIONS
    way: Smoothing | Spline | None = None
    blend: float | None = None
    step: float | None = None

    @property
    def skip(self) -> bool:
        """Whether bad rows are left out and recorded instead of ending the run."""
        return self.options.skip


class RowNeeds(Protocol):
    """What decides on the parts of a table: the robot, how it is read, and what results of a row need."""

    @property
    def robot(self) -> Engine:
        """The robot whose motions are read."""

    @property
    def reading(self) -> Reading:
        """How the table is read."""

    @property
    def highest(self) -> int:
        """The highest rate of q that the results take."""

    @property
    def has_memory(self) -> bool:
        """Whether results depend on the rows before."""


@dataclass(frozen=True, eq=False)
class TableLayout:
    """The columns that all tables of the input have, and how motions are read from them.

    `match` names the columns of the motion. If `independent`, each row states all that its results need; otherwise
    parts are whole motions. If `named`, a column names the motion of each row, or each table is a motion of its own.
    """

    robot: Engine
    reading: Reading
    highest: int
    match: ColumnMatch
    independent: bool
    named: bool


@dataclass(frozen=True)
class InputPart:
    """A piece of the input: whole motions, or any rows where these state all rates.

    `motion` is the name of the motion of all rows, None if a column names it. `written` are the size of the
    file and the time of its last change, ns. Times are since `origin`, the first stamp of the file, if there is one.
    """

    number: int
    path: Path
    span: Span
    motion: str | None
    written: tuple[int, int]
    origin: TimeOrigin | None = None

    @property
    def size(self) -> int:
        """The rows of the part, or the bytes of a CSV table."""
        return self.span.stop - self.span.start


@dataclass(frozen=True, eq=False)
class TableParts:
    """The parts of the input in order, and the layout of its tables."""

    layout: TableLayout
    parts: tuple[InputPart, ...]
    notes: tuple[str, ...] = ()


def divide_tables(needs: RowNeeds, source: Path) -> TableParts:
    """The parts of a table, or of all tables in a folder, of which each is a motion unless a column names motions."""
    paths, notes = _files(source)
    # Match the columns of all tables, which have to be alike; tables that are not readable are empty parts.
    whole = [path for path in paths if not needs.reading.skip or _is_readable(path)] or paths
    matches = [_match(needs, path) for path in whole]
    (first, named), *others = matches
    for path, (other, names) in zip(whole[1:], others, strict=True):
        _check_alike(whole[0], path, first, other, named, names)
    independent = _is_independent(needs, first)
    if independent:
        refuse_smoothing(needs.reading.way or Smoothing(), str(whole[0]), "all rates are in the table")
    # Divide each table into spans.
    parts: list[InputPart] = []
    for path in paths:
        stem = None if named else path.stem
        spans = list(_spans(path, first, independent, named)) if path in whole else [Span(0, 0)]
        origin = _origin(path, first, spans[0]) if path in whole else None
        about = path.stat()
        written = about.st_size, about.st_mtime_ns
        parts += [InputPart(len(parts) + i, path, span, stem, written, origin) for i, span in enumerate(spans)]
    origins = [part.origin for part in parts if part.origin]
    stamps: tuple[str, ...] = ()
    if origins:
        stamps = origins[0].notes if len(paths) == 1 else ("times are since the first row of each table",)
    layout = TableLayout(needs.robot, needs.reading, needs.highest, first, independent, named or source.is_dir())
    return TableParts(layout, tuple(parts), (*stamps, *first.notes, *notes))


def _origin(path: Path, found: ColumnMatch, span: Span) -> TimeOrigin | None:
    """The first stamp of a table, where it is large."""
    table, time = select_format(path), found.sources[TIME]
    asked = [time, remainder_name(time)]
    try:
        row = table.next_row(path, span.start)
        for chunk in table.chunks(path, asked, None, row) if row else ():
            high, low = (float(read_stamps(chunk, found).columns[name][0]) for name in asked)
            return find_origin(high, low, found.factors[TIME])
    except JounceError:  # rows that cannot be read are reported with their part
        pass
    return None


def is_by_parts(needs: RowNeeds, source: Path) -> bool:
    """Whether a table is read by parts without being asked: it holds several motions, or is large and states all rates.

    What cannot be read is left to those who read tables as a whole, and their messages.
    """
    if source.suffix.lower() not in ROW_FORMATS:
        return False
    try:
        found, named = _match(needs, source)
        return named or (_is_independent(needs, found) and select_format(source).size(source) > MIN_LARGE_TABLE_BYTES)
    except JounceError:
        return False


def _files(source: Path) -> tuple[list[Path], tuple[str, ...]]:
    if not source.is_dir():
        select_format(source)
        return [source], ()
    there = sorted(path for path in source.iterdir() if not path.name.startswith(IGNORED_PREFIXES))
    found = [path for path in there if path.is_file() and path.suffix.lower() in ROW_FORMATS]
    if not found:
        raise JounceError(f"{source}: no table in this folder; read by rows are: {', '.join(ROW_FORMATS)}")
    others = [path.name for path in there if path not in found]
    return found, (f"other files, ignored: {join_names(others)}",) if others else ()


def _is_readable(path: Path) -> bool:
    """Whether the names of the columns can be read; of a file without them one empty part is left out and recorded."""
    try:
        return bool(select_format(path).names(path))
    except JounceError:
        return False


def _match(needs: RowNeeds, path: Path) -> tuple[ColumnMatch, bool]:
    """The columns of the motion in a table, and whether one names motions."""
    names = select_format(path).names(path)
    named = MOTION_COLUMN in names and MOTION_COLUMN not in needs.robot.joint_names
    of_motion = [name for name in names if name != MOTION_COLUMN or not named]
    with locate_errors(path):
        return match_columns(of_motion, needs.robot.mechanism, needs.reading.options, needs.highest), named


def _check_alike(first: Path, path: Path, known: ColumnMatch, other: ColumnMatch, named: bool, names: bool) -> None:
    """Raise `JounceError` where the tables of a folder have not the same columns."""
    missing = sorted({*known.sources.values()} - {*other.sources.values()}) + [MOTION_COLUMN] * (named and not names)
    extra = sorted({*other.sources.values()} - {*known.sources.values()}) + [MOTION_COLUMN] * (names and not named)
    if missing or extra:
        differ = f"has no column {join_names(map(quote_value, missing), 3)}" if missing else ""
        differ += " and " * bool(missing and extra)
        differ += f"has a column {join_names(map(quote_value, extra), 3)} more" if extra else ""
        raise JounceError(f"{path}: {differ} than {first.name}; expected the same columns in all tables of a folder")


def _is_independent(needs: RowNeeds, found: ColumnMatch) -> bool:
    """Whether every row of the input states all that its results need."""
    m, reading, sources = needs.robot.mechanism, needs.reading, list(found.sources)
    if needs.has_memory or reading.blend or reading.step or found.sampled:
        return False
    of_base = body_columns.select_base_columns(sources, m)
    if body_columns.are_wrenches_sampled(body_columns.select_wrench_columns(sources, m)) or (
        of_base and body_columns.are_poses_sampled(list(of_base))
    ):
        return False
    if any(name.endswith(DEVIATION) for name in sources):
        return False
    # What goes on from the row before: loops, unless every row states all joints, signs of quaternions, and turns.
    continued = m.takes_dependent and len(follower_columns(m, sources, found.sampled)) < m.tree.n - m.n
    if continued or positions.multiscrew_joints(m) or found.unwrap:
        return False
    highest = rate_name("q", needs.highest)  # which may be a difference between rows
    return all(f"{joint}.{highest}" in sources for joint in m.coordinates)


def _spans(path: Path, found: ColumnMatch, independent: bool, named: bool) -> Iterator[Span]:
    """The spans of the parts of a table: of rows that do not depend on each other, or of whole motions."""
    table = select_format(path)
    table.check_numbers(path, found.names)
    spans = table.spans(path, MAX_PART_CELLS)
    if not spans:
        raise JounceError(f"{path}: no rows of numbers under the column names")
    if independent:
        yield from spans
        return
    whole, start = Span(spans[0].start, spans[-1].stop), spans[0].start
    most, share = max(span.stop - span.start for span in spans), len(found.names) / len(table.names(path))
    for run in runs(path, spans) if named else [whole]:
        _check_memory(path, run, whole, share)
        if run.start > start and run.stop - start > most:
            yield Span(start, run.start)
            start = run.start
    yield Span(start, whole.stop)


def runs(path: Path, spans: Sequence[Span]) -> Iterator[Span]:
    """The spans of the motions of a table, which a column names; rows of a motion that stand apart are refused."""
    name, start, seen = None, spans[0].start, set[str]()
    for span in spans:
        for chunk in select_format(path).chunks(path, [], MOTION_COLUMN, span):
            assert chunk.motions is not None
            whole = np.delete(np.arange(len(chunk.motions)), list(chunk.broken))
            motions = chunk.motions[whole]
            for i in whole[np.append(True, motions[1:] != motions[:-1])[: len(whole)]].tolist():
                place, other = int(chunk.places[i]), str(chunk.motions[i])
                if other == name:
                    continue
                if other in seen:
                    raise JounceError(
                        f"{place_in_words(path, place)}: motion {quote_value(other)} begins a second time; its samples"
                        " need a fit as a whole: sort the rows by motion"
                    )
                if name is not None:
                    yield Span(start, place)
                name, start = other, place
                seen.add(other)
    yield Span(start, spans[-1].stop)


def _check_memory(path: Path, span: Span, whole: Span, share: float) -> None:
    """Raise `JounceError` where a motion does not fit into memory; `share` is that of the columns that are read."""
    table = select_format(path)
    needed = FIT_MEMORY_RATIO * share * table.size(path) * (span.stop - span.start) / (whole.stop - whole.start)
    if needed > (there := _memory()):
        raise JounceError(
            f"{place_in_words(path, span.start)}: the motion that begins here takes {needed / 1e9:.3g} GB to fit,"
            f" and there are {there / 1e9:.3g} GB: state its rates in columns NAME.q, NAME.qd, ..., or divide it into"
            " several motions"
        )


def _memory() -> int:
    """The bytes of memory of this machine."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # not every system has these names
        return ASSUMED_MEMORY_BYTES
