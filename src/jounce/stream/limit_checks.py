"""Limits along the motions of a part, between rows too, and the worst of all parts."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from math import inf

import numpy as np

from jounce.core.errors import JounceError
from jounce.engine.engine import Engine
from jounce.engine.hidden_vibrations import find_hidden_vibrations
from jounce.io.columns import Columns
from jounce.io.tables import select_format
from jounce.limits.check import check
from jounce.limits.limited_motion import required_order
from jounce.limits.verdicts import combine_verdicts, join_spans
from jounce.motion.motion import Motion
from jounce.motion.spline import Smoothing
from jounce.motion.table import motion_from_columns
from jounce.stream.aggregates import Aggregate, order_error
from jounce.stream.job import MOTION_COLUMN, InputPart, Task
from jounce.stream.records import Skipped
from jounce.stream.result_blocks import read_motions
from jounce.stream.row_reader import GoodRows, MotionRun, read_rows, row_before

SPAN_NAMES = ("violations", "undecided")
TEXT_COLUMNS = (MOTION_COLUMN, "joint", "limit", "of", "unit", "verdict")  # columns of a table of limits
NUMBER_COLUMNS = ("value", "bound", "ratio", "margin", "t", "deviation")
MAX_STRETCH_ROWS = 8000  # checked at a time, as some of a check takes time with the square of their number


def check_part_limits(task: Task, part: InputPart, skipped: list[Skipped]) -> dict[str, Aggregate]:
    """The limits of the motions of a part. Rows that state all rates are checked up to the first row behind it."""
    found: dict[str, Aggregate] = {}
    wholes = ((name, len(motion.times), motion) for name, motion in read_motions(task, part, skipped))
    for name, count, motion in _stretches(task, part, skipped) if task.independent else wholes:
        add_limits(found, name, check_motion_limits(task.job.robot, motion, count))
    return found


def add_limits(known: dict[str, Aggregate], name: str, more: Aggregate) -> None:
    """Join the limits of a stretch of a motion to those of the stretches before."""
    if name not in known:
        known[name] = more
        return
    joined = known[name]
    if more["t"][0] < joined["t"][1]:
        raise order_error(name, joined, more)
    spent = [of["t"][1] - of["t"][0] for of in (joined, more)]
    joined["judged"] = {
        kind: (share * spent[0] + more["judged"][kind] * spent[1]) / (sum(spent) or 1)
        for kind, share in joined["judged"].items()
    }
    joined["rows"] += more["rows"]
    joined["t"] = [joined["t"][0], more["t"][1]]
    joined["notes"] = list(dict.fromkeys([*joined["notes"], *more["notes"]]))
    for i, (row, other) in enumerate(zip(joined["limits"], more["limits"], strict=True)):
        spans = {name: [[*span] for span in join_spans(row[name] + other[name])] for name in SPAN_NAMES}
        worse = other if infinite_if_none(other["ratio"]) > infinite_if_none(row["ratio"]) else row
        joined["limits"][i] = worse | spans | {"verdict": combine_verdicts([row["verdict"], other["verdict"]])}


def table_of(found: Mapping[str, Aggregate]) -> Columns:
    """A table with a row per motion and limit; numbers that are infinite are so."""
    rows = [{MOTION_COLUMN: motion} | row for motion, of in found.items() for row in of["limits"]]
    texts: Columns = {name: np.array([row[name] or "" for row in rows], dtype=str) for name in TEXT_COLUMNS}
    numbers: Columns = {
        name: np.array(
            [np.nan if name == "deviation" and row[name] is None else infinite_if_none(row[name]) for row in rows]
        )
        for name in NUMBER_COLUMNS
    }
    return texts | numbers


def infinite_if_none(x: float | None) -> float:
    """A number of a row of limits, in which None stands for infinity, as in JSON."""
    return inf if x is None else x


def check_motion_limits(robot: Engine, motion: Motion, rows: int) -> Aggregate:
    """The aggregate of the limits along a motion of a number of rows."""
    found = check(robot, motion)
    limits = [
        {key: None if isinstance(x, float) and np.isinf(x) else x for key, x in asdict(row).items()}
        | {name: [list(span) for span in getattr(row, name)] for name in SPAN_NAMES}
        | {"verdict": row.verdict}
        for row in found.table
    ]
    about = {"rows": rows, "t": [motion.start, motion.stop], "notes": [*motion.notes, *found.notes]}
    about["hidden"] = find_hidden_vibrations(robot, motion, required_order(robot))
    return about | {"limits": limits, "judged": dict(found.judged)}


def _stretches(task: Task, part: InputPart, skipped: list[Skipped]) -> Iterator[tuple[str, int, Motion]]:
    """Stretches of motions with the number of their rows: each begins with the last row of the one before."""
    before: tuple[str, Columns] | None = None  # a motion and its last row so far
    alone = False  # whether that row is the only one
    for rows, ours in _read_with_next(task, part, skipped):
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
            alone = one and (before is not None or not _is_continued(task, part, run.motion))
            if not one:
                mechanism, highest, place = task.job.robot.mechanism, task.job.highest, str(part.path)
                motion = motion_from_columns(columns, task.match, mechanism, highest, place, Smoothing(), part.origin)
                yield run.motion, count if ours else 0, motion
            before = run.motion, {name: x[-1:] for name, x in columns.items()}
    if alone and before:
        raise _too_short(part, before[0])


def _is_continued(task: Task, part: InputPart, motion: str) -> bool:
    """Whether the row before a part is of a motion, which the part before then checks up to the first row of this one.

    A bad row, which is left out, may be of any motion: it does not end the run.
    """
    known = row_before(task, part)
    return part.span.start > 0 and (known[0] == motion if known else task.job.reading.skip)


def _cut_runs(runs: list[MotionRun]) -> Iterator[MotionRun]:
    """Runs of at most `MAX_STRETCH_ROWS` rows."""
    for run in runs:
        for start in range(run.start, run.stop, MAX_STRETCH_ROWS):
            yield MotionRun(run.motion, start, min(start + MAX_STRETCH_ROWS, run.stop))


def _read_with_next(task: Task, part: InputPart, skipped: list[Skipped]) -> Iterator[tuple[GoodRows, bool]]:
    """The rows of a part, and the row behind it, if there is one, which is not its own."""
    for rows in read_rows(task, part, skipped):
        yield rows, True
    behind = select_format(part.path).next_row(part.path, part.span.stop) if part.size else None
    if behind is not None:
        for rows in read_rows(task, replace(part, span=behind), []):
            yield rows, False


def _too_short(part: InputPart, motion: str) -> JounceError:
    return JounceError(f"{part.path}: motion {motion!r} has one row; expected two or more, to check between them")
