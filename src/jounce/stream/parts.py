"""The function of a part: its rows are read, computed and written, and a record is kept of them."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from jounce.core.errors import at, collected_warnings
from jounce.io.columns import Columns
from jounce.io.motions.writing import about
from jounce.io.tables import TABLE_WRITERS
from jounce.stream.blocks import blocks
from jounce.stream.job import MOTION_COLUMN, Part, Task
from jounce.stream.limits import checked_limits
from jounce.stream.outputs import columns_of
from jounce.stream.records import Record, Skipped, checksum, keep, rows_path, written
from jounce.stream.tally import Aggregate, add, limits_of, tally


def compute(task: Task, part: Part, folder: Path) -> Record:
    """Compute a part of the input: its rows and its record are written into the work folder.

    The result depends on nothing but the arguments and the file that the part is of.
    """
    skipped: list[Skipped] = []
    aggregates: dict[str, Aggregate] = {}
    with collected_warnings() as caught:
        if task.job.subject == "limits":
            aggregates = checked_limits(task, part, skipped)
            total = ""
        else:
            total = _write(task, part, folder, _pieces(task, part, aggregates, skipped))
    rows = sum(found["rows"] for found in aggregates.values())
    record = Record(part.number, part.key, rows, total, aggregates, tuple(skipped), tuple(dict.fromkeys(caught)))
    keep(folder, part, record)
    return record


def _pieces(task: Task, part: Part, aggregates: dict[str, Aggregate], skipped: list[Skipped]) -> Iterator[Columns]:
    """The rows of the output, whose aggregates are gathered meanwhile."""
    limits = limits_of(task.job)
    for runs, block in blocks(task, part, skipped):
        with at(part.path):
            for run in runs:
                add(aggregates, run.motion, tally(block, slice(run.start, run.stop), limits))
        names = np.repeat([run.motion for run in runs], [run.stop - run.start for run in runs])
        yield ({MOTION_COLUMN: names} if task.named else {}) | columns_of(block)


def _write(task: Task, part: Part, folder: Path, pieces: Iterator[Columns]) -> str:
    """Write the rows of a part; returns the checksum of the table, empty without any rows."""
    form, first = task.job.form, next(pieces, None)
    if form is None:
        for _ in pieces:
            pass
        return ""
    if first is None:
        return ""
    with written(rows_path(folder, part, form)) as path:
        TABLE_WRITERS[form].write(path, chain([first], pieces), about(task.job.robot.mechanism, task.job.order))
        return checksum(path)
