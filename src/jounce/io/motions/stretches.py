"""Stretches of motions in rows that state all rates: what happens between two rows is in one of them.

Each begins with the last row of the one before, and the last one of a part ends at the first row behind it.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jounce.core.errors import JounceError
from jounce.io.columns import Columns
from jounce.io.motions.part_rows import GoodRows, MotionRun, read_rows, row_before
from jounce.io.motions.skipped_rows import Skipped
from jounce.io.motions.table_parts import InputPart, TableLayout
from jounce.io.tables import select_format
from jounce.motion.motion import Motion
from jounce.motion.spline import Smoothing
from jounce.motion.table import motion_from_columns

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
