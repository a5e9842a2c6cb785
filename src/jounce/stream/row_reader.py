"""Rows of a part as they are read: bad ones are refused or left out, the others come in runs of one motion each."""

import itertools
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from jounce.core.errors import JounceError, locate_errors, quote_value, warn
from jounce.io.columns import Columns
from jounce.io.motions.log_rows import describe_empty_rows, find_empty_rows, read_stamps
from jounce.io.remainders import remainder_name
from jounce.io.table_format import ROW_CURE, Chunk, Span
from jounce.io.tables import select_format
from jounce.motion.table_columns import TIME
from jounce.stream.job import MOTION_COLUMN, InputPart, Task
from jounce.stream.records import Skipped


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


def read_rows(task: Task, part: InputPart, skipped: list[Skipped]) -> Iterator[GoodRows]:
    """The good rows of a part, chunk by chunk; bad ones are added to `skipped`."""
    table, skip, place = select_format(part.path), task.job.reading.skip, part.span.start
    try:
        table.names(part.path)  # raises the right error for a file that cannot be read at all
        last = row_before(task, part)
        texts = MOTION_COLUMN if part.motion is None else None
        for chunk in read_ahead(_chunks(task, part, task.match.names, texts, part.span)):
            place = int(chunk.places[-1])
            rows = _check_rows(task, part, chunk, last, skipped)
            if rows.runs:
                last = rows.runs[-1].motion, float(rows.columns[task.match.sources[TIME]][-1])
                yield rows
    except JounceError as error:
        if not skip:
            raise
        number = table.number(part.path, place, table.FIRST)
        skipped.append(Skipped(str(part.path), number, "", f"the rows of this part from here on: {error}"))


def _chunks(task: Task, part: InputPart, names: list[str], texts: str | None, span: Span) -> Iterator[Chunk]:
    """Chunks of a table, whose times are since the origin of the part."""
    time = task.match.sources[TIME]
    left = remainder_name(time)
    asked = [*names, *([left] if part.origin else [])]
    for chunk in select_format(part.path).chunks(part.path, asked, texts, span):
        with locate_errors(part.path):
            chunk = read_stamps(chunk, task.match)
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


def row_before(task: Task, part: InputPart) -> tuple[str, float] | None:
    """The motion and the time of the row before a part, if there is one that may belong to its first motion."""
    table, time = select_format(part.path), task.match.sources[TIME]
    span = table.row_before(part.path, part.span.start) if task.independent else None
    try:
        for chunk in _chunks(task, part, [time], MOTION_COLUMN if part.motion is None else None, span) if span else ():
            motion = part.motion if chunk.motions is None else str(chunk.motions[-1])
            t = float(chunk.columns[time][-1])
            return None if chunk.broken or not np.isfinite(t) else (motion or "", t)
    except JounceError:  # the part before reports it
        pass
    return None


def _check_rows(
    task: Task, part: InputPart, chunk: Chunk, last: tuple[str, float] | None, skipped: list[Skipped]
) -> GoodRows:
    """The rows of a chunk without the bad ones."""
    problems = chunk.problems(dict.fromkeys(task.match.sources.values()))  # measured torques may be missing
    good, empty = np.ones(len(chunk.places) - 1, dtype=bool), find_empty_rows(chunk, task.match, problems)
    for note in describe_empty_rows(len(empty), len(good)):
        warn(f"{part.path}: {note}")
    good[[*problems, *empty]] = False
    problems = {i: problem for i, problem in problems.items() if i not in {*empty}}
    if not task.match.sampled:  # samples are sorted as a whole
        problems |= _find_late_rows(task, part, chunk, good, last)
    table = select_format(part.path)
    known = table.FIRST
    for i in sorted(problems):
        column, problem = problems[i]
        place = int(chunk.places[i])
        known = place, table.number(part.path, place, known)
        if not task.job.reading.skip:
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
    task: Task, part: InputPart, chunk: Chunk, good: np.ndarray, last: tuple[str, float] | None
) -> dict[int, tuple[str, str]]:
    """Good rows whose time does not follow that of the rows before them in their motion."""
    found: dict[int, tuple[str, str]] = {}
    name = task.match.sources[TIME]
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
