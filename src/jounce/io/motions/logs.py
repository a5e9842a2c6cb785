"""Reads the motions of logs.

Logs are tables in files, named arrays, and ROS 1 and 2 bags.

`read_table`, `read_arrays` and `read_bag` are the doors. Of a table only the columns that belong to the motion are
read. A bag, of rosbag2, MCAP or .bag files, holds a JointTrajectory, or the samples of JointState messages.

Rows of logs are taken as they come: what can be decided is done and noted in one line; what would be guessed is refused
with its cure. The steps, which readers of tables by parts take too, chunk by chunk:

1. `read_stamps`: ISO 8601 stamps are seconds, UTC where they state no zone.
2. `clean_rows`: rows without any position are left out. Measured torques may be missing. Other bad rows are refused, or
   left out on request.
3. `order_rows`: last rows that repeat the one before, also in time, are left out. Stamps of samples scatter: neighbours
   that changed places, and rows out of order by less than the time between rows, are sorted.
"""

import re
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from decimal import Decimal
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jounce.core.cures import Remedy, join_cures, option_name
from jounce.core.errors import (
    JounceError,
    join_names,
    locate_errors,
    one_line,
    optional_import,
    quote_value,
    unknown_name_error,
)
from jounce.core.scalars import asarray
from jounce.io import files, tables
from jounce.io.motions.episodes import find_episode, match_episodes
from jounce.io.remainders import remainder_name, split_names
from jounce.io.table_format import (
    CellError,
    Chunk,
    Columns,
    check_columns,
    join_chunks,
    leave_out_rows,
    number_rows,
    select_columns,
)
from jounce.model.mechanism import Mechanism
from jounce.motion.joint_matching import match_joints
from jounce.motion.motion import Motion
from jounce.motion.ros import read_joint_states
from jounce.motion.spline import Smoothing, Spline, refuse_smoothing
from jounce.motion.table import TimeOrigin, find_origin, motion_from_columns
from jounce.motion.table_columns import (
    TIME,
    ColumnMatch,
    ColumnOptions,
    UntimedError,
)


class ColumnMatching:
    """Selects the columns of a motion by a table's column names.

    It remembers the selection, as readers call it once the names are known.
    """

    def __init__(self, mechanism: Mechanism, options: ColumnOptions, highest: int, place: str) -> None:
        self.mechanism, self.options, self.highest = mechanism, options, highest
        self.place = place
        self.match: ColumnMatch | None = None

    def __call__(self, header: Sequence[str]) -> list[str]:
        """Return the columns of the motion, and the remainder of the times."""
        try:
            self.match = match_episodes(Path(self.place), header, self.mechanism, self.options, self.highest)
        except UntimedError as error:
            # Callers who take way points know positions without times by the type of the error.
            raise UntimedError(f"{self.place}: {error}") from None
        except JounceError as error:
            raise JounceError(f"{self.place}: {error}") from None
        return [*self.match.names, remainder_name(self.match.sources[TIME])]


def row_words(place: str, row: int) -> str:
    """Return the words for a row of named arrays."""
    return f"{place}: row {row} from 0"


def read_table(
    path: Path, mechanism: Mechanism, highest: int, way: Smoothing | Spline, options: ColumnOptions
) -> Motion:
    """Return the motion of a table in a file."""
    found = find_episode(path, options.episode)
    path = path if found is None else found.path
    matching = ColumnMatching(mechanism, options, highest, str(path))
    with cell_cure():
        if found is None:
            rows = tables.read_rows(path, matching)
        else:
            names = matching(tables.PARQUET.names(path))
            tables.PARQUET.check_numbers(path, split_names(names)[0])
            rows = join_chunks(list(tables.PARQUET.chunks(path, names, None, found.span)))
        return _build_motion(rows, matching, way, partial(tables.describe_place, path))


def read_arrays(
    entries: Mapping[str, Any],
    mechanism: Mechanism,
    highest: int,
    way: Smoothing | Spline,
    options: ColumnOptions,
    place: str,
) -> Motion:
    """Return the motion of named arrays; other entries may be anything."""
    if options.episode is not None:
        raise JounceError(f"{place}: {option_name('episode')} is for files of LeRobot's data sets; leave it out")
    matching = ColumnMatching(mechanism, options, highest, place)
    with cell_cure():
        return _build_motion(array_rows(entries, matching, place), matching, way, partial(row_words, place))


def array_rows(entries: Mapping[str, Any], matching: ColumnMatching, place: str) -> Chunk:
    """Return the rows of named arrays."""
    # Entries that are no arrays are refused only if they are columns of the motion. Integers keep all their digits.
    arrays, refusals = {}, {}
    for name, values in entries.items():
        try:
            array = np.asarray(asarray(values, f"column {quote_value(name)}"))
            exact_array = np.asarray(values)
            arrays[name] = exact_array if exact_array.dtype.kind in "iu" else array
        except JounceError as error:
            arrays[name], refusals[name] = np.empty(0), error
    columns = select_columns(arrays, matching) if len(arrays) > 0 else {}
    for name in split_names(columns)[0]:
        if name in refusals:
            raise CellError(f"{place}: {refusals[name]}")
    return number_rows(check_columns(place, columns))


def _build_motion(
    rows: Chunk, matching: ColumnMatching, way: Smoothing | Spline, place_words: Callable[[int], str]
) -> Motion:
    """Return the motion of rows.

    `place_words` names the place of a row in messages.
    """
    good, match = order_good_rows(rows, matching, place_words), matching.match
    assert match is not None  # every reader selects columns before it returns rows
    motion = motion_from_columns(good.columns, match, matching.mechanism, matching.place, way=way, origin=good.origin)
    return replace(motion, notes=(*good.notes, *motion.notes))


class OrderedRows(NamedTuple):
    """The rows that are taken, in the order of time."""

    columns: Columns
    origin: TimeOrigin | None  # of the times
    numbers: np.ndarray  # (N,) of the rows, among all rows of the table
    notes: tuple[str, ...]


def order_good_rows(rows: Chunk, matching: ColumnMatching, place_words: Callable[[int], str]) -> OrderedRows:
    """Return the rows of a log that are taken: stamps are read, bad rows refused or left out, others ordered."""
    match, skip = matching.match, matching.options.skip
    # Every reader selects columns before it returns rows.
    assert match is not None
    with locate_errors(matching.place):
        rows = read_stamps(rows, match)
    columns, good_rows, notes = clean_rows(rows, match, lambda i: place_words(int(rows.places[i])), skip)
    # Times are since the first stamp, where doubles lose digits of stamps.
    time = match.sources[TIME]
    remainder = remainder_name(time)
    origin = find_origin(float(columns[time][0]), float(columns[remainder][0]), match.factors[TIME])
    if origin is not None:
        columns = {**columns, time: origin.since(columns[time], columns[remainder])}
    order, problems, order_notes = order_rows(columns, match)
    _, skip_notes = leave_out_rows(
        problems, len(good_rows), lambda i: place_words(int(rows.places[good_rows[i]])), skip
    )
    if len(order_notes) > 0 or len(problems) > 0:
        columns = {name: x[order] for name, x in columns.items()}
    return OrderedRows(
        columns, origin, good_rows[order], (*notes, *skip_notes, *order_notes, *torque_notes(columns, match))
    )


@contextmanager
def cell_cure() -> Iterator[None]:
    """Add the cure to errors of cells within this context.

    It names the options that select other columns.
    """
    try:
        yield
    except CellError as error:
        ways: list[Remedy | str] = [
            option_name("time"),
            option_name("columns"),
            Remedy("lock= of jounce.load", "--lock JOINT=VALUE"),
        ]
        raise JounceError(f"{error}; or select columns with {join_cures(ways)}") from None


# The steps that rows take: stamps, rows that are left out, their order.
MAX_DISORDER = 1.0  # times between rows, by which stamps that scatter may go back
ISO_STAMP = re.compile(r"\s*(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)(?:[.,](\d+))?\s*(Z|[+-]\d\d:?\d\d)?\s*")


def read_stamps(rows: Chunk, match: ColumnMatch) -> Chunk:
    """Return the rows with ISO 8601 stamps as seconds since 1970.

    The remainders of the doubles are computed too, where they are among the columns.
    """
    time = match.sources[TIME]
    remainder, columns, texts = remainder_name(time), dict(rows.columns), dict(rows.texts)
    for (row, name), text in rows.texts.items():
        stamp = _parse_stamp(text) if name == time else None
        if stamp is None:
            continue
        if match.factors[TIME] != 1:
            came = f"column {quote_value(time)} holds ISO 8601 stamps, {quote_value(text)}, which are in seconds"
            raise JounceError(f"{came}; leave {option_name('time_unit')} out")
        # The arrays are those of the chunk, NaN where cells are texts.
        columns[time][row] = high = float(stamp)
        if remainder in columns:
            columns[remainder][row] = float(stamp - Decimal(high))
        del texts[row, name]
    return replace(rows, texts=texts)


def _parse_stamp(text: str) -> Decimal | None:
    """Return the seconds since 1970 of an ISO 8601 stamp.

    Return None for other texts.
    """
    stamp = ISO_STAMP.fullmatch(text)
    if stamp is None:
        return None
    try:
        whole = datetime.fromisoformat(f"{stamp[1]}T{stamp[2]}{stamp[4] or 'Z'}").timestamp()
    except ValueError:  # no such day or hour
        return None
    return Decimal(whole) + Decimal(f"0.{stamp[3] or 0}")


def find_empty_rows(rows: Chunk, match: ColumnMatch, problems: Iterable[int]) -> list[int]:
    """Return the rows with problems that have no number but a time.

    Rows that lack cells are not among them.
    """
    columns = [rows.columns[name] for name in {*match.sources.values()} - {match.sources[TIME]}]
    return [i for i in problems if i not in rows.broken and all(np.isnan(x[i]) for x in columns)]


def describe_empty_rows(count: int, rows: int) -> tuple[str, ...]:
    """Return a note of rows that are left out, if any."""
    return (f"{count} of {rows} rows state no position; left out",) if count > 0 else ()


def clean_rows(
    rows: Chunk, match: ColumnMatch, row_words: Callable[[int], str], skip: bool
) -> tuple[Columns, np.ndarray, tuple[str, ...]]:
    """Return the columns of the good rows, their numbers (N,), and notes.

    `row_words` names a row in messages.
    """
    count, problems = len(rows.places) - 1, rows.problems(dict.fromkeys(match.sources.values()))
    empty_rows = find_empty_rows(rows, match, problems)
    if len(empty_rows) == count:
        raise JounceError(f"{row_words(0)}: no position in this row, nor in any other; expected numbers")
    bad_rows = {i: problems[i] for i in problems.keys() - {*empty_rows}}
    is_good, notes = leave_out_rows(bad_rows, count, row_words, skip)
    is_good[empty_rows] = False
    columns = rows.columns if is_good.all() else {name: x[is_good] for name, x in rows.columns.items()}
    return columns, np.flatnonzero(is_good), describe_empty_rows(len(empty_rows), count) + notes


def order_rows(
    columns: Mapping[str, np.ndarray], match: ColumnMatch
) -> tuple[np.ndarray, dict[int, tuple[str, str]], tuple[str, ...]]:
    """Return the good rows (N,) in the order of time.

    Problems, by row, and notes follow: what is wrong with the stamps of other rows, and how many were sorted.
    """
    time = match.sources[TIME]
    t = columns[time]
    if (np.diff(t) > 0).all():
        return np.arange(len(t)), {}, ()
    # Planners write their last row twice: nothing is between rows that are equal, their times included.
    equal_count, equal_notes = find_equal_end(columns)
    if equal_count > 0:
        shorter = {name: x[:-equal_count] for name, x in columns.items()}
        order, problems, notes = order_rows(shorter, match)
        return order, problems, (*equal_notes, *notes)
    # Most rows increase; the others, a few, may have changed places with neighbours.
    increasing = _find_increasing(t)
    other_rows = np.setdiff1d(np.arange(len(t)), increasing)
    # How many of the increasing rows stand before each other row in the table, and how many in time.
    count_above, count_earlier = np.searchsorted(increasing, other_rows), np.searchsorted(t[increasing], t[other_rows])
    is_late = count_above > count_earlier
    # The time of the neighbour that is out of order with the row, and how far it is away.
    neighbours = increasing[np.where(is_late, count_above - 1, count_above).clip(max=len(increasing) - 1)]
    neighbour_times = t[neighbours]
    distances = np.abs(t[other_rows] - neighbour_times)
    typical_step = float(np.median(np.diff(np.sort(t))))
    is_near = (np.abs(count_above - count_earlier) <= 1) | (distances < MAX_DISORDER * typical_step)
    # Stamps scatter only in samples, and where half of the rows at most have changed places.
    may_sort = match.sampled and 2 * len(increasing) >= len(t)
    is_moved = is_near & may_sort & ~np.isin(t[other_rows], t[increasing])
    # The rows that moved take their places in time; of rows of equal times the first stays.
    order = np.append(increasing, other_rows[is_moved])
    order = order[np.argsort(t[order], kind="stable")]
    is_repeated = np.append(False, np.diff(t[order]) == 0)
    words: dict[int, str] = {}
    for i, late, x in zip(
        other_rows[~is_moved].tolist(), is_late[~is_moved], neighbour_times[~is_moved].tolist(), strict=True
    ):
        words[i] = f"{float(t[i])!r} {'follows' if late else 'comes before'} {x!r}"
    for i in order[is_repeated].tolist():
        words[i] = f"{float(t[i])!r} follows {float(t[i])!r}"
    problems = {i: (time, f"does not increase: {came}") for i, came in words.items()}
    largest = distances[is_moved].max(initial=0) * match.factors[TIME]
    note = f"{is_moved.sum()} of {len(t)} rows out of order by up to {largest:.2g} s; sorted by their stamps"
    return order[~is_repeated], problems, (note,) if is_moved.any() else ()


def find_equal_end(columns: Mapping[str, np.ndarray]) -> tuple[int, tuple[str, ...]]:
    """Return how many last rows repeat the one before, and a note."""
    unchanged = [(x[1:] == x[:-1]) | (np.isnan(x[1:]) & np.isnan(x[:-1])) for x in columns.values()]
    changes = np.flatnonzero(~np.logical_and.reduce(unchanged))
    rows = len(unchanged[0]) + 1
    count = rows - 2 - int(changes[-1]) if len(changes) > 0 else rows - 1
    note = f"the last {count} of {rows} rows: equal to the one before, also in time; left out"
    return count, (note,) if count > 0 else ()


def _find_increasing(t: np.ndarray) -> np.ndarray:
    """Return the rows (K,) of the longest part of t that increases.

    They are found by patience sorting (Fredman, Discrete Math. 11, 1975).
    """
    # ends[k] is the smallest time at which an increasing part of k + 1 rows ends, rows[k] its row; previous[i] is the
    # row before row i in the longest part that ends there.
    ends, rows, previous = list[float](), list[int](), list[int]()
    for i, x in enumerate(t.tolist()):
        k = bisect_left(ends, x)
        previous.append(rows[k - 1] if k > 0 else -1)
        # Of rows of equal times the first is taken.
        if ends[k : k + 1] != [x]:
            ends[k : k + 1], rows[k : k + 1] = [x], [i]
    # The longest part, backwards from its end.
    longest = [rows[-1]]
    while previous[longest[-1]] >= 0:
        longest.append(previous[longest[-1]])
    return np.array(longest[::-1])


def torque_notes(columns: Mapping[str, np.ndarray], match: ColumnMatch) -> tuple[str, ...]:
    """Return a note of measured torques that are missing, if any."""
    missing_counts = {joint: np.count_nonzero(~np.isfinite(columns[name])) for joint, name in match.torques.items()}
    rows = len(columns[match.sources[TIME]])
    words = [f"{count} of {rows} of {joint}" for joint, count in missing_counts.items() if count > 0]
    return (f"measured torques missing, left out there: {join_names(words)}",) if len(words) > 0 else ()


# Bags of ROS.
BAG_SUFFIXES = (".mcap", ".bag", ".db3")
JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORIES = ("trajectory_msgs/msg/JointTrajectory", "moveit_msgs/msg/DisplayTrajectory",
                "moveit_msgs/msg/RobotTrajectory")  # fmt: skip


def is_bag(source: Path) -> bool:
    """Return whether a path is a bag: a file of such a type, or a folder written by ROS 2."""
    try:
        return source.suffix.lower() in BAG_SUFFIXES or (source / "metadata.yaml").is_file()
    except OSError:  # a name longer than the file system takes
        return False


def read_bag(
    source: Path, mechanism: Mechanism, highest: int, way: Smoothing | Spline, options: ColumnOptions, topic: str | None
) -> Motion:
    """Return the motion in a bag.

    It is of the given topic, or of the only topic with a motion.
    """
    if not source.is_dir():
        files.check_readable(source)
    with _open_bag(source) as bag:
        # Topics that hold motions, with their types.
        topics = {c.topic: c.msgtype for c in bag.connections if c.msgtype in (JOINT_STATE, *TRAJECTORIES)}
        if topic is not None and topic not in topics:
            raise JounceError(f"{source}: {unknown_name_error('topic', topic, topics)}")
        if topic is None and len(topics) != 1:
            topic_names = join_names(topics) if len(topics) > 0 else "none"
            kinds = f"JointTrajectory or JointState in it: {topic_names}"
            raise JounceError(f"{source}: topics of type {kinds}; select one with {Remedy('topic=', '--topic NAME')}")
        chosen = topic if topic is not None else next(iter(topics))
        connections = [c for c in bag.connections if c.topic == chosen]
        messages = [bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages(connections)]
    place = f"{source}: {chosen}"
    if topics[chosen] == JOINT_STATE:
        if len(messages) == 0:
            raise JounceError(f"{place} has no messages")
        columns = read_joint_states(messages, lambda i: f"{place}: message {i}")
        return read_arrays(columns, mechanism, highest, way, options, place)
    reason = "its trajectory points are exact"
    refuse_smoothing(way, place, reason)
    options.refuse(place, reason)
    if len(messages) != 1:
        raise JounceError(f"{place} has {len(messages)} trajectories; expected one")
    with locate_errors(place):
        return match_joints(Motion.from_joint_trajectory(messages[0]), mechanism)


@contextmanager
def _open_bag(source: Path) -> Iterator[Any]:
    """Open a bag for reading.

    Within this context errors of its reader become `JounceError`.
    """
    with optional_import(f"{source}: bags of ROS need rosbags", "ros"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    try:
        with AnyReader([source], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            yield bag
    except JounceError:
        raise
    except Exception as error:  # damaged bags make their reader raise errors of any type
        raise JounceError(
            f"{source}: not a bag of ROS: {one_line(error) or quote_value(type(error).__name__)}"
        ) from None
