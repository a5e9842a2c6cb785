"""Runs a job on a motion, or by parts on large tables.

1. The input is divided into parts (`divide_tables`).
2. Each part that the work folder has not finished yet is computed: its rows are written, then its results.
3. The results of all parts are merged in the order of the input, and the output is made of the tables of their rows.

A run that is killed at any time leaves finished parts; the next one goes on after them, and ends with the same bytes.
"""

import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np

from jounce.core import errors, temporary_files
from jounce.core.errors import JounceError
from jounce.engine.along import Progress
from jounce.io import files, tables
from jounce.io.motions import part_rows, table_parts, writing
from jounce.io.motions.part_rows import Skipped
from jounce.io.motions.table_parts import InputPart, TableLayout, TableParts
from jounce.io.table_format import Columns
from jounce.io.tables import TABLE_WRITERS
from jounce.limits.verdicts import Check, tabulate_limits
from jounce.motion import extremes
from jounce.motion.extremes import PeaksByJoint
from jounce.motion.motion import Motion
from jounce.stream import finished_parts
from jounce.stream.finished_parts import FinishedPart
from jounce.stream.jobs import Block, Job, MotionResult, RowJob, add_result

# A runner computes parts, in any order, into a work folder:
Runner = Callable[[Job, TableLayout, Sequence[InputPart], Path], Generator[FinishedPart]]
Show = Callable[[int, int, int], object]  # takes the finished size, the size of all parts, and the rows computed


@dataclass(frozen=True)
class RunSummary:
    """The results of a run, of one motion or of many.

    `results` are by motion, `computed` is the number of parts that no earlier run had finished, and `skipped` the
    number of rows that are left out.
    """

    results: Mapping[str, MotionResult]
    notes: Sequence[str] = ()
    warnings: Sequence[str] = ()
    parts: int = 1
    computed: int = 1
    skipped: int = 0

    @property
    def rows(self) -> int:
        """The number of rows of all motions."""
        return sum(result.rows for result in self.results.values())

    @property
    def peaks(self) -> dict[str, tuple[int, PeaksByJoint]]:
        """The number of rows and the peaks of each motion."""
        return {name: (result.rows, result.peaks) for name, result in self.results.items()}

    @property
    def checks(self) -> dict[str, Check]:
        """The checks of motions, of a run that checks limits."""
        return {name: result.check for name, result in self.results.items() if result.check}


def run_motion(job: RowJob, motion: Motion, name: str, output: Path | None, show: Progress | None = None) -> RunSummary:
    """Compute a job on a motion in memory.

    Its rows are written if there is an output.
    """
    results: dict[str, MotionResult] = {}
    missing = writing.MEASURED if job.robot.mechanism.closure is None else ""
    blocks = _gather(job.compute_motion(name, motion, show), results)
    if output is None:
        for _ in blocks:  # results are merged while blocks pass by
            pass
        return RunSummary(results, collect_notes(results))
    pieces = (writing.table_columns([*block.channels, *block.further]) for block in blocks)
    tables.write_pieces(output, pieces, writing.table_metadata(job.robot.mechanism, job.order), [missing])
    return RunSummary(results, collect_notes(results))


def run_tables(
    job: Job,
    source: Path,
    output: Path | None,
    reduce: Sequence[str] = (),
    runner: Runner | None = None,
    show: Show | None = None,
) -> RunSummary:
    """Compute a job on a table or a folder of tables.

    With `reduce` the output is a table of peaks and root mean squares; otherwise it is a table of rows, or of limits.
    Without an output nothing is kept.
    """
    output = None if output is None else part_rows.resolve_output(output)
    check_output(job, source, output)
    divided = table_parts.divide_tables(job, source)
    if divided.layout.independent:
        job = job.with_columns(divided.layout.match)
    # Without an output the parts live in a temporary folder, as for a check.
    if output is None:
        with tempfile.TemporaryDirectory() as folder:
            computed = _compute_missing(job, divided, Path(folder), runner or run_here, show)
            return _summarize(divided, _read_finished(job, divided, Path(folder)), computed)
    # The very same run has ended before: its output has all results.
    if _is_folder(job, output) and finished_parts.is_published(job, divided.parts, output):
        return _summarize(divided, finished_parts.read_published(output), 0)
    work = work_folder(output)
    with files.hold_lock(work, output):
        try:
            computed = _compute_missing(job, divided, work, runner or run_here, show)
        except BaseException:
            # Finished parts stay for the next run; a folder without any is of no use.
            finished_parts.remove_empty(work)
            raise
        skipped = chain.from_iterable(finished.skipped for finished in _read_finished(job, divided, work))
        part_rows.write_skipped(part_rows.skipped_path(output), divided.layout.match.names, skipped)
        summary = _summarize(divided, _read_finished(job, divided, work), computed)
        # The output is a table of limits, a table of aggregates, a folder of tables, or one table of all rows.
        if not isinstance(job, RowJob):
            write_table(output, tabulate_limits(summary.checks), job)
        elif job.form is None:
            write_table(output, extremes.tabulate_peaks(summary.peaks, reduce), job)
        elif _is_folder(job, output):
            finished_parts.publish_folder(divided.parts, work, _read_finished(job, divided, work), output)
        else:
            finished_parts.publish_file(divided.parts, work, job.form, output)
        finished_parts.remove_work(work)
        return summary


def run_here(job: Job, layout: TableLayout, parts: Sequence[InputPart], work: Path) -> Generator[FinishedPart]:
    """Compute parts one after the other in this process."""
    for part in parts:
        yield compute_part(job, layout, part, work)


def compute_part(job: Job, layout: TableLayout, part: InputPart, work: Path) -> FinishedPart:
    """Compute a part, and write its results into the work folder.

    They depend on the arguments and on the file of the part only.
    """
    skipped: list[Skipped] = []
    results: dict[str, MotionResult] = {}
    with errors.collect_warnings() as warnings_of_part:
        blocks = _gather(job.compute_part(layout, part, skipped), results, str(part.path))
        checksum = _write_rows(job, layout, part, work, blocks)
    key, warnings = job.part_key(part), tuple(dict.fromkeys(warnings_of_part))
    finished = FinishedPart(part.number, key, results, checksum, tuple(skipped), warnings)
    finished_parts.write_finished(work, part, finished)
    return finished


def work_folder(output: Path) -> Path:
    """Return the work folder of an output."""
    return output.with_name(f"{output.name}.unfinished")


def check_output(job: Job, source: Path, output: Path | None) -> None:
    """Raise `JounceError` if the output cannot be written."""
    if output is None:
        return
    if _is_folder(job, output):
        finished_parts.check_folder(output)
    else:
        tables.check_writable(output)
    output_path, source_path = output.resolve(), source.resolve()
    if output_path == source_path or (source.is_dir() and source_path in output_path.parents):
        raise JounceError(f"{output}: the output is the input, or inside its folder; choose another path")
    if job.reading.skip:
        part_rows.check_skipped(part_rows.skipped_path(output))


def table_suffix(output: Path) -> str:
    """Return the type of the tables that an output consists of.

    A path without a suffix is a folder of Parquet tables.
    """
    return output.suffix.lower() or ".parquet"


def collect_notes(results: Mapping[str, MotionResult], first: Sequence[str] = ()) -> tuple[str, ...]:
    """Collect the notes of all motions after those of their table.

    Each note is there once.
    """
    return tuple(dict.fromkeys([*first, *(note for result in results.values() for note in result.facts.notes)]))


def _is_folder(job: Job, output: Path) -> bool:
    """Whether the output is a folder of tables of rows."""
    return job.form is not None and not output.suffix


def _gather(blocks: Iterable[Block], results: dict[str, MotionResult], place: str = "") -> Iterator[Block]:
    """Yield blocks unchanged, and merge their results meanwhile."""
    for block in blocks:
        with errors.locate_errors(place):
            for name, result in block.results:
                add_result(results, name, result)
        yield block


def _write_rows(job: Job, layout: TableLayout, part: InputPart, work: Path, blocks: Iterable[Block]) -> str:
    """Write the rows of blocks, and return the checksum of the table.

    It is empty if there are no rows.
    """
    pieces = (_part_columns(layout, block) for block in blocks if block.channels)
    first = next(pieces, None)
    if first is None:
        return ""
    # Results are merged while blocks pass by: they have to, even where no rows are kept.
    if job.form is None:
        for _ in pieces:
            pass
        return ""
    with finished_parts.write_atomically(finished_parts.rows_path(work, part, job.form)) as path:
        TABLE_WRITERS[job.form].write(
            path, chain([first], pieces), writing.table_metadata(job.robot.mechanism, job.order)
        )
        return files.checksum(path)


def _part_columns(layout: TableLayout, block: Block) -> Columns:
    """Return the columns of a block.

    Where a table holds several motions, the first column names them.
    """
    columns = writing.table_columns([*block.channels, *block.further])
    if not layout.named:
        return columns
    names = [name for name, _ in block.results]
    return {table_parts.MOTION_COLUMN: np.repeat(names, [result.rows for _, result in block.results])} | columns


def _compute_missing(job: Job, divided: TableParts, work: Path, runner: Runner, show: Show | None) -> int:
    """Compute all parts that are not finished, and return their number."""
    for path in (work, finished_parts.rows_folder(work)):
        files.make_folder(path)
        temporary_files.remove_abandoned(path)
    missing = [part for part in divided.parts if not finished_parts.is_finished(job, part, work)]
    sizes = {part.number: part.size for part in divided.parts}
    total_size = sum(sizes.values())
    finished_size, rows = total_size - sum(part.size for part in missing), 0
    # Whatever ends this run closes the runner, and so ends the work on a cluster too.
    with closing(runner(job, divided.layout, missing, work)) as finished:
        for part in finished:
            finished_size, rows = finished_size + sizes[part.number], rows + part.rows
            if show is not None:
                show(finished_size, total_size, rows)
    return len(missing)


def _read_finished(job: Job, divided: TableParts, work: Path) -> Iterator[FinishedPart]:
    """Yield all parts in the order of the input."""
    for part in divided.parts:
        finished = finished_parts.find_finished(work, part, job)
        assert finished is not None
        yield finished


def _summarize(divided: TableParts, finished: Iterable[FinishedPart], computed: int) -> RunSummary:
    """Merge the results of all parts."""
    results: dict[str, MotionResult] = {}
    warnings: dict[str, None] = {}
    skipped = 0
    for part, finished_part in zip(divided.parts, finished, strict=True):
        warnings.update(dict.fromkeys(finished_part.warnings))
        skipped += len(finished_part.skipped)
        with errors.locate_errors(tables.describe_place(part.path, part.span.start)):
            for name, result in finished_part.results.items():
                add_result(results, name, result)
    if len(results) == 0:
        raise JounceError("all rows of the input are bad: only the table of skipped rows is written")
    notes = collect_notes(results, divided.notes)
    return RunSummary(results, notes, tuple(warnings), len(divided.parts), computed, skipped)


def write_table(output: Path, columns: Columns, job: Job) -> None:
    """Write a table of few rows; numbers may be infinite or missing."""
    with files.write_whole(output) as path:
        metadata = writing.table_metadata(job.robot.mechanism, job.order)
        TABLE_WRITERS[table_suffix(output)].write(path, [columns], metadata)
