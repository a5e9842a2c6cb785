"""Divides tables of motions, or all tables in a folder, into parts.

Parts are spans of files that are read independently. A part is any span of rows where each row states all that its
results need, and whole motions otherwise. Tables of any size are divided without being read as a whole.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from jounce.core.errors import JounceError, join_names, locate_errors, quote_value
from jounce.engine.engine import Engine
from jounce.io.motions.episodes import episode_column, list_episodes, list_tables, match_episodes
from jounce.io.motions.logs import read_stamps
from jounce.io.remainders import remainder_name
from jounce.io.table_format import Span
from jounce.io.tables import ROW_FORMATS, select_format
from jounce.io.tables import describe_place as place_in_words
from jounce.model import positions
from jounce.motion import body_columns
from jounce.motion.spline import Smoothing, Spline, refuse_smoothing
from jounce.motion.table import DEFAULT_COLUMN_OPTIONS, TimeOrigin, find_origin
from jounce.motion.table_columns import DEVIATION, TIME, ColumnMatch, ColumnOptions, follower_columns
from jounce.spatial.series import rate_name

MOTION_COLUMN = "motion"  # the column that names the motion of each row, but of data sets with episodes
MAX_PART_CELLS = 1 << 23  # 64 MB of numbers, little of the memory of a worker
MIN_LARGE_TABLE_BYTES = 1 << 28  # 256 MB; smaller tables are read as a whole unless parts are asked for
FIT_MEMORY_RATIO = 60  # bytes of memory per byte of a table whose samples are fitted: 52 to 61 were measured
ASSUMED_MEMORY_BYTES = 1 << 33  # where the system reports none: 8 GB, as most machines have
IGNORED_PREFIXES = (".", "_")  # what names of files begin with that are no data


@dataclass(frozen=True)
class Reading:
    """The options of reading: columns, and how curves follow from samples.

    `blend` and `step` are those of `Motion.blended` and `Motion.with_step`.
    """

    options: ColumnOptions = DEFAULT_COLUMN_OPTIONS
    way: Smoothing | Spline | None = None
    blend: float | None = None
    step: float | None = None

    @property
    def skip(self) -> bool:
        """Whether bad rows are left out and recorded.

        Otherwise the first one ends the run.
        """
        return self.options.skip


class RowNeeds(Protocol):
    """The needs of a row's results: the robot, the reading, the rates of q.

    They decide on the parts of a table.
    """

    @property
    def robot(self) -> Engine:
        """The robot whose motions are read."""

    @property
    def reading(self) -> Reading:
        """The options of reading the table."""

    @property
    def highest(self) -> int:
        """The highest rate of q that the results take."""

    @property
    def has_memory(self) -> bool:
        """Whether results depend on the rows before."""


@dataclass(frozen=True, eq=False)
class TableLayout:
    """The columns that all tables of the input have.

    `match` names the columns of the motion. If `independent`, each row states all that its results need; otherwise
    parts are whole motions. If `named`, a column names the motion of each row, or each table is a motion of its own;
    `motion_column` is that column, if it is there.
    """

    robot: Engine
    reading: Reading
    highest: int
    match: ColumnMatch
    independent: bool
    named: bool
    motion_column: str = MOTION_COLUMN


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
    """The parts of the input in order, and its layout."""

    layout: TableLayout
    parts: tuple[InputPart, ...]
    notes: tuple[str, ...] = ()


def divide_tables(needs: RowNeeds, source: Path) -> TableParts:
    """Return the parts of a table, or of a folder's tables.

    Each table in a folder is a motion, unless a column names motions.
    """
    paths, notes = _files(source)
    # Match the columns of all tables, which have to be alike; tables that are not readable are empty parts.
    readable_paths = [path for path in paths if not needs.reading.skip or _is_readable(path)]
    if len(readable_paths) == 0:
        readable_paths = paths
    first_path, *other_paths = readable_paths
    if source.is_dir() and first_path.suffix == ".parquet":
        # Episodes have to be in one table each.
        is_of_episodes = episode_column(select_format(first_path).names(first_path)) is not None
        list_episodes(source, readable_paths if is_of_episodes else [])
    match, motion_column = _match(needs, first_path)
    other_matches = [_match(needs, path) for path in other_paths]
    for path, (other_match, other_column) in zip(other_paths, other_matches, strict=True):
        _check_alike((first_path, match, motion_column), (path, other_match, other_column))
    is_independent = _is_independent(needs, match)
    if is_independent:
        way = Smoothing() if needs.reading.way is None else needs.reading.way
        refuse_smoothing(way, str(first_path), "all rates are in the table")
    # Divide each table into spans.
    parts: list[InputPart] = []
    for path in paths:
        motion = None if motion_column is not None else path.stem
        spans = list(_spans(path, match, is_independent, motion_column)) if path in readable_paths else [Span(0, 0)]
        origin = _origin(path, match, spans[0]) if path in readable_paths else None
        status = path.stat()
        size_and_time = status.st_size, status.st_mtime_ns
        parts += [InputPart(len(parts) + i, path, span, motion, size_and_time, origin) for i, span in enumerate(spans)]
    # Times of large stamps are since the first row of their table.
    origins = [part.origin for part in parts if part.origin is not None]
    origin_notes: tuple[str, ...] = ()
    if len(origins) > 0:
        origin_notes = origins[0].notes if len(paths) == 1 else ("times are since the first row of each table",)
    has_names = motion_column is not None or source.is_dir()
    layout = TableLayout(
        needs.robot, needs.reading, needs.highest, match, is_independent, has_names, motion_column or MOTION_COLUMN
    )
    return TableParts(layout, tuple(parts), (*origin_notes, *match.notes, *notes))


def _origin(path: Path, match: ColumnMatch, span: Span) -> TimeOrigin | None:
    """Return the first stamp of a table, where it is large."""
    table, time = select_format(path), match.sources[TIME]
    names = [time, remainder_name(time)]
    # Rows that cannot be read are reported with their part.
    with suppress(JounceError):
        row = table.next_row(path, span.start)
        for chunk in () if row is None else table.chunks(path, names, None, row):
            high, low = (float(read_stamps(chunk, match).columns[name][0]) for name in names)
            return find_origin(high, low, match.factors[TIME])
    return None


def is_by_parts(needs: RowNeeds, source: Path) -> bool:
    """Return whether a table is read by parts without being asked.

    It holds several motions, or is large and states all rates. What cannot be read is left to the readers of whole
    tables, and their messages.
    """
    if source.suffix.lower() not in ROW_FORMATS:
        return False
    try:
        match, motion_column = _match(needs, source)
        if motion_column is not None:
            return True
        return _is_independent(needs, match) and select_format(source).size(source) > MIN_LARGE_TABLE_BYTES
    except JounceError:
        return False


def _files(source: Path) -> tuple[list[Path], tuple[str, ...]]:
    """Return the table, or the tables of a folder, and a note.

    The note lists other files of the folder.
    """
    if not source.is_dir():
        select_format(source)
        return [source], ()
    data_tables = list_tables(source)
    if data_tables is not None:
        return data_tables, ()
    paths = sorted(path for path in source.iterdir() if not path.name.startswith(IGNORED_PREFIXES))
    tables = [path for path in paths if path.is_file() and path.suffix.lower() in ROW_FORMATS]
    if len(tables) == 0:
        raise JounceError(f"{source}: no table in this folder; read by rows are: {', '.join(ROW_FORMATS)}")
    other_names = [path.name for path in paths if path not in tables]
    return tables, (f"other files, ignored: {join_names(other_names)}",) if len(other_names) > 0 else ()


def _is_readable(path: Path) -> bool:
    """Return whether the names of the columns can be read.

    A file without them is one empty part, which is left out and recorded.
    """
    try:
        return len(select_format(path).names(path)) > 0
    except JounceError:
        return False


def _match(needs: RowNeeds, path: Path) -> tuple[ColumnMatch, str | None]:
    """Return the columns of a table's motion.

    The column that names motions follows, None without one.
    """
    names = select_format(path).names(path)
    is_named = MOTION_COLUMN in names and MOTION_COLUMN not in needs.robot.joint_names
    others = [name for name in names if name != MOTION_COLUMN or not is_named]
    motion_column = MOTION_COLUMN if is_named else episode_column(names)
    with locate_errors(path):
        match = match_episodes(path, others, needs.robot.mechanism, needs.reading.options, needs.highest)
    return match, motion_column


def _check_alike(first: tuple[Path, ColumnMatch, str | None], other: tuple[Path, ColumnMatch, str | None]) -> None:
    """Raise `JounceError` where tables of a folder have different columns.

    Each is given by its path, the columns of its motion, and the column that names motions.
    """
    (first_path, first_match, first_column), (path, match, motion_column) = first, other
    first_names, names = {*first_match.sources.values()}, {*match.sources.values()}
    missing, extra = sorted(first_names - names), sorted(names - first_names)
    if first_column is not None and motion_column is None:
        missing.append(first_column)
    if motion_column is not None and first_column is None:
        extra.append(motion_column)
    differences = []
    if len(missing) > 0:
        differences.append(f"has no column {join_names(map(quote_value, missing), 3)}")
    if len(extra) > 0:
        differences.append(f"has a column {join_names(map(quote_value, extra), 3)} more")
    if len(differences) > 0:
        came = " and ".join(differences)
        raise JounceError(f"{path}: {came} than {first_path.name}; expected the same columns in all tables of a folder")


def _is_independent(needs: RowNeeds, match: ColumnMatch) -> bool:
    """Return whether every row states all that its results need."""
    m, reading, sources = needs.robot.mechanism, needs.reading, list(match.sources)
    if needs.has_memory or reading.blend or reading.step or match.sampled:
        return False
    # Wrenches and poses of a base that are sampled are fitted over time, as are deviations.
    if body_columns.are_wrenches_sampled(body_columns.select_wrench_columns(sources, m)):
        return False
    base_columns = list(body_columns.select_base_columns(sources, m))
    if len(base_columns) > 0 and body_columns.are_poses_sampled(base_columns):
        return False
    if any(name.endswith(DEVIATION) for name in sources):
        return False
    # Some numbers go on from the row before: loops, unless every row states all joints, signs of quaternions, turns.
    followers = follower_columns(m, sources, match.sampled)
    has_open_branch = m.takes_dependent and len(followers) < m.tree.n - m.n
    if has_open_branch or len(positions.multiscrew_joints(m)) > 0 or match.unwrap:
        return False
    # The highest rate may be a difference between rows, unless it is stated.
    highest = rate_name("q", needs.highest)
    return all(f"{joint}.{highest}" in sources for joint in m.coordinates)


def _spans(path: Path, match: ColumnMatch, is_independent: bool, motion_column: str | None) -> Iterator[Span]:
    """Yield the spans of the parts of a table.

    They are of rows that do not depend on each other, or of whole motions.
    """
    table = select_format(path)
    table.check_numbers(path, match.names)
    spans = table.spans(path, MAX_PART_CELLS)
    if len(spans) == 0:
        raise JounceError(f"{path}: no rows of numbers under the column names")
    if is_independent:
        yield from spans
        return
    # A part has as many motions as fit into a span, and one at least.
    whole, start = Span(spans[0].start, spans[-1].stop), spans[0].start
    largest_size, share = max(span.stop - span.start for span in spans), len(match.names) / len(table.names(path))
    for run in [whole] if motion_column is None else runs(path, spans, motion_column):
        _check_memory(path, run, whole, share)
        if run.start > start and run.stop - start > largest_size:
            yield Span(start, run.start)
            start = run.start
    yield Span(start, whole.stop)


def runs(path: Path, spans: Sequence[Span], motion_column: str = MOTION_COLUMN) -> Iterator[Span]:
    """Yield the spans of the motions that a column names.

    A motion whose rows do not follow each other is refused.
    """
    name, start, former_names = None, spans[0].start, set[str]()
    for span in spans:
        for chunk in select_format(path).chunks(path, [], motion_column, span):
            assert chunk.motions is not None
            # Rows that are not broken and have another motion than the row before.
            whole_rows = np.delete(np.arange(len(chunk.motions)), list(chunk.broken))
            motions = chunk.motions[whole_rows]
            is_change = np.append(True, motions[1:] != motions[:-1])[: len(whole_rows)]
            for i in whole_rows[is_change].tolist():
                place, next_name = int(chunk.places[i]), str(chunk.motions[i])
                # A motion may go on from the chunk before.
                if next_name == name:
                    continue
                if next_name in former_names:
                    raise JounceError(
                        f"{place_in_words(path, place)}: motion {quote_value(next_name)} begins a second time; its"
                        " samples need a fit as a whole: sort the rows by motion"
                    )
                if name is not None:
                    yield Span(start, place)
                name, start = next_name, place
                former_names.add(next_name)
    yield Span(start, spans[-1].stop)


def _check_memory(path: Path, span: Span, whole: Span, share: float) -> None:
    """Raise `JounceError` where a motion does not fit into memory.

    `share` is the share of the columns that are read.
    """
    table = select_format(path)
    needed = FIT_MEMORY_RATIO * share * table.size(path) * (span.stop - span.start) / (whole.stop - whole.start)
    memory = _memory()
    if needed > memory:
        raise JounceError(
            f"{place_in_words(path, span.start)}: the motion that begins here takes {needed / 1e9:.3g} GB to fit,"
            f" and there are {memory / 1e9:.3g} GB: state its rates in columns NAME.q, NAME.qd, ..., or divide it into"
            " several motions"
        )


def _memory() -> int:
    """Return the bytes of memory of this machine."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):  # not every system has these names
        return ASSUMED_MEMORY_BYTES
