"""Reads the motions of logs: of tables in files, of named arrays, and of ROS 1 and 2 bags.

`read_table`, `read_arrays` and `read_bag` are the doors. Of a table only the columns that belong to the motion are
read. A bag, of rosbag2, MCAP or .bag files, holds a JointTrajectory, or the samples of JointState messages.

Rows of logs are taken as they come: what can be decided is done and noted in one line; what would be guessed is refused
with its cure. ISO 8601 stamps are seconds, UTC where they state no zone. Rows without any position are left out. Stamps
of samples scatter: neighbours that changed places, and rows out of order by less than the time between rows, are
sorted. Measured torques may be missing. Other bad rows are refused, or left out on request. Readers of tables by parts
take the same steps, chunk by chunk.
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
from typing import Any

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
from jounce.io.remainders import remainder_name, split_names
from jounce.io.table_format import CellError, Chunk, Columns, check_columns, leave_out_rows, number_rows, select_columns
from jounce.model.mechanism import Mechanism
from jounce.motion.joint_matching import match_joints
from jounce.motion.motion import Motion
from jounce.motion.ros import read_joint_states
from jounce.motion.spline import Smoothing, Spline, refuse_smoothing
from jounce.motion.table import find_origin, motion_from_columns
from jounce.motion.table_columns import TIME, ColumnMatch, ColumnOptions, match_columns


class ColumnMatching:
    """Selects the columns of a motion once the column names of a table are known, and remembers the selection."""

    def __init__(self, mechanism: Mechanism, options: ColumnOptions, highest: int, place: str) -> None:
        self.given = mechanism, options, highest
        self.place = place
        self.found: ColumnMatch | None = None

    def __call__(self, header: Sequence[str]) -> list[str]:
        """The columns of the motion, and what doubles leave of the times."""
        with locate_errors(self.place):
            self.found = match_columns(header, *self.given)
        return [*self.found.names, remainder_name(self.found.sources[TIME])]


def read_table(
    path: Path, mechanism: Mechanism, highest: int, way: Smoothing | Spline, options: ColumnOptions
) -> Motion:
    """The motion of a table in a file."""
    matching = ColumnMatching(mechanism, options, highest, str(path))
    with _cell_cure():
        rows = tables.read_rows(path, matching)
        return _build_motion(rows, matching, highest, way, partial(tables.describe_place, path))


def read_arrays(
    given: Mapping[str, Any],
    mechanism: Mechanism,
    highest: int,
    way: Smoothing | Spline,
    options: ColumnOptions,
    place: str,
) -> Motion:
    """Return the motion of named arrays; other entries may be anything."""
    matching = ColumnMatching(mechanism, options, highest, place)
    arrays, refused = {}, {}
    for name, values in given.items():
        try:
            found = np.asarray(asarray(values, f"column {quote_value(name)}"))
            arrays[name] = integers if (integers := np.asarray(values)).dtype.kind in "iu" else found
        except JounceError as error:
            arrays[name], refused[name] = np.empty(0), error
    with _cell_cure():
        columns = select_columns(arrays, matching) if arrays else {}
        for name in split_names(columns)[0]:
            if name in refused:
                raise CellError(f"{place}: {refused[name]}")
        rows = number_rows(check_columns(place, columns))
        return _build_motion(rows, matching, highest, way, lambda at: f"{place}: row {at} from 0")


def _build_motion(
    rows: Chunk, matching: ColumnMatching, highest: int, way: Smoothing | Spline, where: Callable[[int], str]
) -> Motion:
    """The motion of rows, of which `where` names the place in messages."""
    found, skip = matching.found, matching.given[1].skip
    assert found is not None  # every reader selects
    with locate_errors(matching.place):
        rows = read_stamps(rows, found)
    columns, kept, notes = clean_rows(rows, found, lambda i: where(int(rows.places[i])), skip)
    time = found.sources[TIME]
    left = remainder_name(time)
    origin = find_origin(float(columns[time][0]), float(columns[left][0]), found.factors[TIME])
    if origin:
        columns = {**columns, time: origin.since(columns[time], columns[left])}
    order, problems, of_order = order_rows(columns, found)
    _, of_stamps = leave_out_rows(problems, len(kept), lambda i: where(int(rows.places[kept[i]])), skip)
    if of_order or problems:
        columns = {name: x[order] for name, x in columns.items()}
    motion = motion_from_columns(columns, found, matching.given[0], highest, matching.place, way, origin)
    return replace(motion, notes=(*notes, *of_stamps, *of_order, *torque_notes(columns, found), *motion.notes))


@contextmanager
def _cell_cure() -> Iterator[None]:
    """Within this context, the error for a cell that is not a number says which options select other columns."""
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


def read_stamps(rows: Chunk, found: ColumnMatch) -> Chunk:
    """The rows with ISO 8601 stamps as seconds since 1970, and what doubles leave of these where that is asked for."""
    time = found.sources[TIME]
    left, columns, texts = remainder_name(time), dict(rows.columns), dict(rows.texts)
    for place, text in rows.texts.items():
        if place[1] != time or (stamp := _parse_stamp(text)) is None:
            continue
        if found.factors[TIME] != 1:
            came = f"column {quote_value(time)} holds ISO 8601 stamps, {quote_value(text)}, which are in seconds"
            raise JounceError(f"{came}; leave {option_name('time_unit')} out")
        columns[time][place[0]] = high = float(stamp)
        if left in columns:
            columns[left][place[0]] = float(stamp - Decimal(high))
        del texts[place]
    return replace(rows, texts=texts)


def _parse_stamp(text: str) -> Decimal | None:
    if (stamp := ISO_STAMP.fullmatch(text)) is None:
        return None
    try:
        whole = datetime.fromisoformat(f"{stamp[1]}T{stamp[2]}{stamp[4] or 'Z'}").timestamp()
    except ValueError:  # no such day or hour
        return None
    return Decimal(whole) + Decimal(f"0.{stamp[3] or 0}")


def find_empty_rows(rows: Chunk, found: ColumnMatch, problems: Iterable[int]) -> list[int]:
    """Those of the rows with problems that have all cells, and no number but a time."""
    columns = [rows.columns[name] for name in {*found.sources.values()} - {found.sources[TIME]}]
    return [i for i in problems if i not in rows.broken and all(np.isnan(x[i]) for x in columns)]


def describe_empty_rows(count: int, rows: int) -> tuple[str, ...]:
    """A note of rows that are left out."""
    return (f"{count} of {rows} rows state no position; left out",) if count else ()


def clean_rows(
    rows: Chunk, found: ColumnMatch, where: Callable[[int], str], skip: bool
) -> tuple[Columns, np.ndarray, tuple[str, ...]]:
    """The columns of the good rows, the numbers (N,) of these, and notes; `where` names a row in messages."""
    count, problems = len(rows.places) - 1, rows.problems(dict.fromkeys(found.sources.values()))
    empty = find_empty_rows(rows, found, problems)
    if len(empty) == count:
        raise JounceError(f"{where(0)}: no position in this row, nor in any other; expected numbers")
    good, notes = leave_out_rows({i: problems[i] for i in problems.keys() - {*empty}}, count, where, skip)
    good[empty] = False
    columns = rows.columns if good.all() else {name: x[good] for name, x in rows.columns.items()}
    return columns, np.flatnonzero(good), describe_empty_rows(len(empty), count) + notes


def order_rows(
    columns: Mapping[str, np.ndarray], found: ColumnMatch
) -> tuple[np.ndarray, dict[int, tuple[str, str]], tuple[str, ...]]:
    """The numbers (N,) of the good rows in the order of time, what is wrong with the stamps of others, and notes."""
    time = found.sources[TIME]
    t = columns[time]
    if (np.diff(t) > 0).all():
        return np.arange(len(t)), {}, ()
    kept = _find_increasing(t)
    others = np.setdiff1d(np.arange(len(t)), kept)
    before, passed = np.searchsorted(kept, others), np.searchsorted(t[kept], t[others])  # of those kept, how many
    late = before > passed
    beside = t[kept[np.where(late, before - 1, before).clip(max=len(kept) - 1)]]
    away = np.abs(t[others] - beside)
    near = (np.abs(before - passed) <= 1) | (away < MAX_DISORDER * float(np.median(np.diff(np.sort(t)))))
    is_order = found.sampled and 2 * len(kept) >= len(t)  # half of the rows have changed places at most
    moved = near & is_order & ~np.isin(t[others], t[kept])
    order = np.append(kept, others[moved])
    order = order[np.argsort(t[order], kind="stable")]
    twice = np.append(False, np.diff(t[order]) == 0)
    wrong = {
        i: f"{float(t[i])!r} {'follows' if is_late else 'comes before'} {x!r}"
        for i, is_late, x in zip(others[~moved].tolist(), late[~moved], beside[~moved].tolist(), strict=True)
    } | {i: f"{float(t[i])!r} follows {float(t[i])!r}" for i in order[twice].tolist()}
    size = away[moved].max(initial=0) * found.factors[TIME]
    notes = (f"{moved.sum()} of {len(t)} rows out of order by up to {size:.2g} s; sorted by their stamps",)
    problems = {i: (time, f"does not increase: {words}") for i, words in wrong.items()}
    return order[~twice], problems, notes if moved.any() else ()


def _find_increasing(t: np.ndarray) -> np.ndarray:
    """The rows (K,) of the longest part of t that increases, by patience sorting (Fredman, Discrete Math. 11, 1975)."""
    ends, rows, previous = list[float](), list[int](), list[int]()
    for i, x in enumerate(t.tolist()):
        k = bisect_left(ends, x)
        previous.append(rows[k - 1] if k else -1)
        if ends[k : k + 1] != [x]:  # of equal ones the first
            ends[k : k + 1], rows[k : k + 1] = [x], [i]
    chain = [rows[-1]]
    while previous[chain[-1]] >= 0:
        chain.append(previous[chain[-1]])
    return np.array(chain[::-1])


def torque_notes(columns: Mapping[str, np.ndarray], found: ColumnMatch) -> tuple[str, ...]:
    """A note of measured torques that are missing."""
    lost = {joint: np.count_nonzero(~np.isfinite(columns[name])) for joint, name in found.torques.items()}
    rows = len(columns[found.sources[TIME]])
    counts = [f"{count} of {rows} of {joint}" for joint, count in lost.items() if count]
    return (f"measured torques missing, left out there: {join_names(counts)}",) if counts else ()


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
    """The motion in a bag: of the given topic, or of the only topic with a motion."""
    if not source.is_dir():
        files.check_readable(source)
    with _open_bag(source) as bag:
        topics = {c.topic: c.msgtype for c in bag.connections if c.msgtype in (JOINT_STATE, *TRAJECTORIES)}
        if topic is not None and topic not in topics:
            raise JounceError(f"{source}: {unknown_name_error('topic', topic, topics)}")
        if topic is None and len(topics) != 1:
            kinds = f"JointTrajectory or JointState in it: {join_names(topics) or 'none'}"
            raise JounceError(f"{source}: topics of type {kinds}; select one with {Remedy('topic=', '--topic NAME')}")
        chosen = topic if topic is not None else next(iter(topics))
        connections = [c for c in bag.connections if c.topic == chosen]
        messages = [bag.deserialize(raw, c.msgtype) for c, _, raw in bag.messages(connections)]
    place = f"{source}: {chosen}"
    if topics[chosen] == JOINT_STATE:
        if not messages:
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
