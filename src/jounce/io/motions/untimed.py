"""Read tables without times: poses at rest with measured torques, or way points.

`read_poses` is the door of poses, which may be the holds of a log with times, too; `read_untimed_rows` that of way
points. The number of a row stands for its time, so that what takes the columns of a log takes these.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from jounce.core.cures import Remedy, option_name
from jounce.core.errors import JounceError, locate_errors
from jounce.io import tables
from jounce.io.motions import logs
from jounce.io.remainders import remainder_name
from jounce.io.table_format import Chunk, Columns
from jounce.model.mechanism import Mechanism
from jounce.motion.poses import Poses
from jounce.motion.table import poses_from_columns
from jounce.motion.table_columns import (
    TIME,
    ColumnMatch,
    ColumnOptions,
    find_approach_columns,
    has_times,
    match_columns,
)

MIN_SAMPLE_ROWS = 200  # without times: a log has as many rows within seconds, and nobody waits for as many poses
MAX_SAMPLE_SHARE = 0.02  # of the range of a joint, from row to row: poses at random differ by a third of it


def is_untimed(path: Path, mechanism: Mechanism, options: ColumnOptions) -> bool:
    """Return whether a source is a table without a column of times."""
    suffix = path.suffix.lower()
    if suffix not in tables.TABLE_READERS or not path.is_file():
        return False
    with locate_errors(path):
        is_read_by_rows = suffix in tables.ROW_FORMATS
        header = tables.ROW_FORMATS[suffix].names(path) if is_read_by_rows else [*tables.read_rows(path).columns]
        return not has_times(header, mechanism, options)


class PoseMatching(logs.ColumnMatching):
    """Selects the columns of poses at rest: those of a motion, with times or without."""

    timed: bool
    approach: Mapping[str, str]

    def __call__(self, header: Sequence[str]) -> list[str]:
        """Return the columns of the poses, without times of an untimed table."""
        with locate_errors(self.place):
            self.timed = has_times(header, self.mechanism, self.options)
            self.approach = find_approach_columns(header, self.mechanism, self.options)
        given = [name for name in header if name not in self.approach.values()]
        names = super().__call__(given if self.timed else [*given, TIME])
        return [*(names if self.timed else names_without_time(names)), *self.approach.values()]


def names_without_time(names: Sequence[str]) -> list[str]:
    """Return the columns to read of a table without times."""
    return [name for name in names if name not in (TIME, remainder_name(TIME))]


def read_poses(
    source: Path | Mapping[str, Any], mechanism: Mechanism, options: ColumnOptions, holds: bool | None, place: str
) -> Poses:
    """Return the poses at rest of a table: its rows if it has no times, or the holds of a log.

    `holds` says which of both is expected, if a caller knows.
    """
    matching = PoseMatching(mechanism, options, 0, place)
    with logs.cell_cure():
        rows, words = _read_rows(source, matching)
        _check_holds(matching.timed, holds, place)
        good = logs.order_good_rows(rows if matching.timed else _number_rows(rows), matching, words)
    assert matching.match is not None  # every reader selects columns before it returns rows
    places = None if matching.timed else [words(int(rows.places[i])) for i in good.numbers]
    poses = poses_from_columns(good.columns, matching.match, mechanism, place, approach=matching.approach, rows=places)
    if not matching.timed and holds is None:
        _refuse_samples(poses.q, place)
    return replace(poses, notes=(*good.notes, *poses.notes))


def _check_holds(timed: bool, holds: bool | None, place: str) -> None:
    """Raise `JounceError` of a table whose times are not as expected."""
    if timed and holds is False:
        cure = Remedy("holds=True takes the stretches of the log in which all joints rest", "")
        raise JounceError(f"{place}: it has times, and a table of poses at rest has none: leave them out; or {cure}")
    if not timed and holds is True:
        raise JounceError(
            f"{place}: it has no times, and holds are stretches of time; if each row is a pose at rest, leave"
            f" {option_name('holds')} out"
        )


def _refuse_samples(q: np.ndarray, place: str) -> None:
    """Raise `JounceError` of rows (N, n) without times that are samples of a motion."""
    steps, reach = np.median(np.abs(np.diff(q, axis=0)), axis=0), np.ptp(q, axis=0)
    if len(q) < MIN_SAMPLE_ROWS or (steps > MAX_SAMPLE_SHARE * reach).any() or not reach.any():
        return
    cure = Remedy("keep one row per pose, or state by holds=False that each row is one", "keep one row per pose")
    came = f"{len(q)} rows without times move by less than {MAX_SAMPLE_SHARE:.0%} of their range from row to row"
    raise JounceError(f"{place}: {came}, as samples of a motion do; add the column of times of a log, or {cure}")


class UntimedMatching(logs.ColumnMatching):
    """Selects the columns of a table without times.

    Its match has a column of times, t, that is not among the columns to read.
    """

    def __call__(self, header: Sequence[str]) -> list[str]:
        """Return the columns of the positions."""
        with locate_errors(self.place):
            if has_times(header, self.mechanism, self.options):
                raise JounceError(
                    f"the table has a column of times; {option_name('duration')} and {option_name('tolerance')} are for"
                    " way points without times: leave them out"
                )
            self.match = match_columns([TIME, *header], self.mechanism, self.options, self.highest)
        return [name for name in self.match.names if name != TIME]


def read_untimed_rows(
    source: Path | Mapping[str, Any], mechanism: Mechanism, options: ColumnOptions, place: str
) -> tuple[Columns, ColumnMatch, tuple[str, ...]]:
    """Return the columns of a table without times, their match, and notes.

    The source is a path or named arrays. The columns are as in the table, with the numbers of rows as times, so that
    whatever takes the columns of a log takes these.
    """
    matching = UntimedMatching(mechanism, options, 0, place)
    with logs.cell_cure():
        rows, words = _read_rows(source, matching)
        match = matching.match
        assert match is not None  # every reader selects columns before it returns rows
        numbered = _number_rows(rows)
        columns, _, notes = logs.clean_rows(numbered, match, lambda i: words(int(rows.places[i])), options.skip)
    return columns, match, notes


def _read_rows(source: Path | Mapping[str, Any], matching: logs.ColumnMatching) -> tuple[Chunk, Callable[[int], str]]:
    """Return the rows of a source, and words for a row."""
    if isinstance(source, Path):
        return tables.read_rows(source, matching), partial(tables.describe_place, source)
    return logs.array_rows(source, matching, matching.place), partial(logs.row_words, matching.place)


def _number_rows(rows: Chunk) -> Chunk:
    """Return rows whose numbers stand for their times, which nothing depends on."""
    count = len(rows.places) - 1
    numbers = {TIME: np.arange(float(count)), remainder_name(TIME): np.zeros(count)}
    return replace(rows, columns={**rows.columns, **numbers})
