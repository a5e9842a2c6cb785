"""The function of a part: its rows are read, computed and written, and a record is kept of them."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from jounce.core.errors import collect_warnings, locate_errors
from jounce.io.columns import Columns
from jounce.io.motions.writing import table_metadata
from jounce.io.tables import TABLE_WRITERS
from jounce.stream.aggregates import Aggregate, add, reported_limits, tally
from jounce.stream.job import MOTION_COLUMN, InputPart, Task
from jounce.stream.limit_checks import check_part_limits
from jounce.stream.outputs import block_columns
from jounce.stream.records import Record, Skipped, checksum, rows_path, write_atomically, write_record
from jounce.stream.result_blocks import compute_blocks


def compute(task: Task, part: InputPart, folder: Path) -> Record:
    """Compute a part of the input: its rows and its record are written into the work folder.

    The result depends on nothing but the arguments and the file that the part is of.
    """
    skipped: list[Skipped] = []
    aggregates: dict[str, Aggregate] = {}
    with collect_warnings() as caught:
        if task.job.subject == "limits":
            aggregates = check_part_limits(task, part, skipped)
            total = ""
        else:
            total = _write(task, part, folder, _pieces(task, part, aggregates, skipped))
    rows = sum(found["rows"] for found in aggregates.values())
    record = Record(part.number, part.key, rows, total, aggregates, tuple(skipped), tuple(dict.fromkeys(caught)))
    write_record(folder, part, record)
    return record


def _pieces(task: Task, part: InputPart, aggregates: dict[str, Aggregate], skipped: list[Skipped]) -> Iterator[Columns]:
    """The rows of the output, whose aggregates are gathered meanwhile."""
    limits = reported_limits(task.job)
    for runs, block in compute_blocks(task, part, skipped):
        with locate_errors(part.path):
            for run in runs:
                add(aggregates, run.motion, tally(block, slice(run.start, run.stop), limits))
        names = np.repeat([run.motion for run in runs], [run.stop - run.start for run in runs])
        yield ({MOTION_COLUMN: names} if task.named else {}) | block_columns(block)


def _write(task: Task, part: InputPart, folder: Path, pieces: Iterator[Columns]) -> str:
    """Write the rows of a part; returns the checksum of the table, empty without any rows."""
    form, first = task.job.form, next(pieces, None)
    if form is None:
        for _ in pieces:
            pass
        return ""
    if first is None:
        return ""
    with write_atomically(rows_path(folder, part, form)) as path:
        TABLE_WRITERS[form].write(
            path, chain([first], pieces), table_metadata(task.job.robot.mechanism, task.job.order)
        )
        return checksum(path)
