"""A whole run: the plan, its parts, the output, and a summary of them."""

import csv
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from jounce.core.errors import JounceError
from jounce.engine.along import Progress, check_motion
from jounce.io import files, tables
from jounce.io.columns import Columns
from jounce.io.motions.writing import MEASURED, table_metadata
from jounce.motion import Motion
from jounce.stream import publish
from jounce.stream.aggregates import Aggregate, add, join_tallies, reduce_aggregates, reported_limits, tally
from jounce.stream.input_parts import InputPlan, make_plan
from jounce.stream.job import InputPart, Job
from jounce.stream.limit_checks import add_limits, check_motion_limits, table_of
from jounce.stream.lock import hold_lock
from jounce.stream.outputs import block_columns, compute_motion
from jounce.stream.records import Record
from jounce.stream.runner import Runner, Show, read_records, run, run_here

SKIPPED_HEADER = b"file,row,column,problem"  # of a table of rows that are left out


@dataclass(frozen=True)
class Summary:
    """What a run has computed, of one motion or of many.

    `aggregates` are plain data by motion, `computed` is the number of parts that no earlier run had finished, and
    `skipped` the number of rows that are left out.
    """

    aggregates: Mapping[str, Aggregate]
    notes: Sequence[str]
    warnings: Sequence[str] = ()
    parts: int = 1
    computed: int = 1
    skipped: int = 0

    @property
    def rows(self) -> int:
        """The number of rows of all motions."""
        return sum(found["rows"] for found in self.aggregates.values())


def stream(
    job: Job,
    source: Path,
    output: Path | None,
    reduce: Sequence[str] = (),
    runner: Runner = run_here,
    show: Show | None = None,
) -> Summary:
    """Compute what a job asks for of a table, or of all tables in a folder, and write the output.

    With `reduce` the output is a table of aggregates; otherwise one of rows, or of limits. Without an output nothing is
    kept.
    """
    output = None if output is None else resolve_output(output)
    check_output(job, source, output)
    plan = make_plan(job, source, job.highest)
    if output is None:
        with tempfile.TemporaryDirectory() as folder:
            computed = run(plan, Path(folder), runner, show)
            return _summary(plan, read_records(plan, Path(folder)), computed)
    if _is_folder(job, output) and publish.is_published(plan, output):
        return _summary(plan, publish.published_records(output), 0)
    work = publish.work_folder(output)
    with hold_lock(work, output):
        try:
            computed = run(plan, work, runner, show)
        except BaseException:
            publish.remove_empty(work)
            raise
        _write_skipped(skipped_path(output), plan.task.match.names, read_records(plan, work))
        summary = _summary(plan, read_records(plan, work), computed)
        _write(plan, summary, work, reduce, output)
        publish.remove_work(work)
        return summary


def stream_motion(job: Job, motion: Motion, name: str, output: Path | None, show: Progress | None = None) -> Summary:
    """Compute what a job asks for of a motion in memory, its only part, and write the output."""
    if job.subject == "limits":
        limits = {name: check_motion_limits(job.robot, motion, len(motion.times))}
        if output is not None:
            _write_table(output, table_of(limits), job)
        return Summary(limits, _notes(limits))
    path, found = check_motion(job.robot.mechanism, motion), dict[str, Aggregate]()

    def pieces() -> Iterator[Columns]:
        limits = reported_limits(job)
        for block in compute_motion(job, path, show):
            add(found, name, tally(block, slice(None), limits))
            yield block_columns(block)

    assert output is not None  # whoever asks for rows states where to
    missing = MEASURED if job.robot.mechanism.closure is None else ""
    tables.write_pieces(output, pieces(), table_metadata(job.robot.mechanism, job.order), [missing])
    return Summary(found, _notes(found))


def check_output(job: Job, source: Path, output: Path | None) -> None:
    """Raise `JounceError` if the output cannot be written, before any work is done."""
    if output is None:
        return
    if _is_folder(job, output):
        publish.check_folder(output)
    else:
        tables.check_writable(output)
    made, given = output.resolve(), source.resolve()
    if made == given or (source.is_dir() and given in made.parents):
        raise JounceError(f"{output}: the output is the input, or in its folder; choose another path")
    left_out = skipped_path(output)
    if job.reading.skip and left_out.exists() and not _is_ours(left_out):
        raise JounceError(f"{left_out}: bad rows are written there, and it is not of an earlier run; move it away")


def resolve_output(output: Path) -> Path:
    """The path of an output, where a link leads: the link stays, and results lie on the disk that it points to."""
    return output.resolve() if output.is_symlink() else output


def table_suffix(output: Path) -> str:
    """The type of the tables that an output is made of: a path without a suffix is a folder of Parquet tables."""
    return output.suffix.lower() or ".parquet"


def skipped_path(output: Path) -> Path:
    """The table of the rows that are left out."""
    path = resolve_output(output)
    return path.with_name(f"{path.name}.skipped.csv")


def _is_folder(job: Job, output: Path) -> bool:
    return job.form is not None and not output.suffix


def _summary(plan: InputPlan, found: Iterable[Record], computed: int) -> Summary:
    warnings: dict[str, None] = {}
    skipped = 0

    def aggregates() -> Iterator[tuple[InputPart, Mapping[str, Aggregate]]]:
        nonlocal skipped
        for part, record in zip(plan.parts, found, strict=True):
            warnings.update(dict.fromkeys(record.notes))
            skipped += len(record.skipped)
            yield part, record.aggregates

    joined = join_tallies(aggregates(), add_limits if plan.task.job.subject == "limits" else add)
    if not joined:
        raise JounceError("no row of the input is good: nothing is written but the table of rows that are left out")
    return Summary(joined, _notes(joined, plan.notes), tuple(warnings), len(plan.parts), computed, skipped)


def _notes(found: Mapping[str, Aggregate], first: Sequence[str] = ()) -> tuple[str, ...]:
    """The notes of all motions, each once, after those of their table."""
    return tuple(dict.fromkeys([*first, *(note for of in found.values() for note in of["notes"])]))


def _write(plan: InputPlan, summary: Summary, work: Path, reduce: Sequence[str], output: Path) -> None:
    if plan.task.job.subject == "limits":
        _write_table(output, table_of(summary.aggregates), plan.task.job)
    elif plan.task.job.form is None:
        _write_table(output, reduce_aggregates(summary.aggregates, reduce), plan.task.job)
    elif _is_folder(plan.task.job, output):
        publish.publish_folder(plan, work, read_records(plan, work), output)
    else:
        publish.publish_file(plan, work, plan.task.job.form, output)


def _write_table(output: Path, columns: Columns, job: Job) -> None:
    """Write a table of few rows; numbers in it may be infinite or missing."""
    with files.write_whole(output) as path:
        tables.TABLE_WRITERS[table_suffix(output)].write(
            path, [columns], table_metadata(job.robot.mechanism, job.order)
        )


def _write_skipped(path: Path, columns: Sequence[str], found: Iterable[Record]) -> None:
    """Write the rows that are left out, with all their cells as texts; without any, that of an earlier run goes."""
    rows = (row for record in found for row in record.skipped)
    first = next(rows, None)
    if first is None:
        if _is_ours(path):
            path.unlink()
        return
    with files.write_whole(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["file", "row", "column", "problem", *columns])
        for row in chain([first], rows):
            writer.writerow(
                [row.file, row.row, row.column, row.problem, *(row.cells.get(name, "") for name in columns)]
            )


def _is_ours(path: Path) -> bool:
    """Whether a file is a table of rows that an earlier run left out."""
    return path.is_file() and path.read_bytes()[: len(SKIPPED_HEADER)] == SKIPPED_HEADER
