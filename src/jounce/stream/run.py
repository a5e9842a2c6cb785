"""A run: a job on a motion in memory, or on tables larger than memory, part by part, here or on a cluster.

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

# Computes parts, in any order, into a work folder:
Runner = Callable[[Job, TableLayout, Sequence[InputPart], Path], Generator[FinishedPart]]
Show = Callable[[int, int, int], object]  # takes the finished size, that of all parts, and the rows computed


@dataclass(frozen=True)
class RunSummary:
    """What a run has computed, of one motion or of many.

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
        return sum(found.rows for found in self.results.values())

    @property
    def peaks(self) -> dict[str, tuple[int, PeaksByJoint]]:
        """The number of rows and the peaks of each motion."""
        return {name: (of.rows, of.peaks) for name, of in self.results.items()}

    @property
    def checks(self) -> dict[str, Check]:
        """The checks of motions, of a run that checks limits."""
        return {name: of.check for name, of in self.results.items() if of.check}


def run_motion(job: RowJob, motion: Motion, name: str, output: Path, show: Progress | None = None) -> RunSummary:
    """Compute what a job asks for of a motion in memory, and write its rows."""
    results: dict[str, MotionResult] = {}
    missing = writing.MEASURED if job.robot.mechanism.closure is None else ""
    blocks = _gather(job.compute_motion(name, motion, show), results)
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
    """Compute what a job asks for of a table, or of all tables in a folder, and write the output.

    With `reduce` the output is a table of peaks and root mean squares; otherwise one of rows, or of limits. Without an
    output nothing is kept.
    """
    output = None if output is None else part_rows.resolve_output(output)
    check_output(job, source, output)
    found = table_parts.divide_tables(job, source)
    if found.layout.independent:
        job = job.with_columns(found.layout.match)
    if output is None:
        with tempfile.TemporaryDirectory() as folder:
            computed = _compute_missing(job, found, Path(folder), runner or run_here, show)
            return _summarize(found, _read_finished(job, found, Path(folder)), computed)
    if _is_folder(job, output) and finished_parts.is_published(job, found.parts, output):
        return _summarize(found, finished_parts.read_published(output), 0)
    work = work_folder(output)
    with files.hold_lock(work, output):
        try:
            computed = _compute_missing(job, found, work, runner or run_here, show)
        except BaseException:
            finished_parts.remove_empty(work)
            raise
        skipped = chain.from_iterable(of.skipped for of in _read_finished(job, found, work))
        part_rows.write_skipped(part_rows.skipped_path(output), found.layout.match.names, skipped)
        summary = _summarize(found, _read_finished(job, found, work), computed)
        if not isinstance(job, RowJob):
            write_table(output, tabulate_limits(summary.checks), job)
        elif job.form is None:
            write_table(output, extremes.tabulate_peaks(summary.peaks, reduce), job)
        elif _is_folder(job, output):
            finished_parts.publish_folder(found.parts, work, _read_finished(job, found, work), output)
        else:
            finished_parts.publish_file(found.parts, work, job.form, output)
        finished_parts.remove_work(work)
        return summary


def run_here(job: Job, layout: TableLayout, parts: Sequence[InputPart], work: Path) -> Generator[FinishedPart]:
    """Compute parts one after the other in this process."""
    for part in parts:
        yield compute_part(job, layout, part, work)


def compute_part(job: Job, layout: TableLayout, part: InputPart, work: Path) -> FinishedPart:
    """Compute a part of the input: its rows and its results are written into the work folder.

    They depend on nothing but the arguments and the file that the part is of.
    """
    skipped: list[Skipped] = []
    results: dict[str, MotionResult] = {}
    with errors.collect_warnings() as caught:
        blocks = _gather(job.compute_part(layout, part, skipped), results, str(part.path))
        total = _write_rows(job, layout, part, work, blocks)
    key, warnings = job.part_key(part), tuple(dict.fromkeys(caught))
    found = FinishedPart(part.number, key, results, total, tuple(skipped), warnings)
    finished_parts.write_finished(work, part, found)
    return found


def work_folder(output: Path) -> Path:
    """The folder of what is computed of parts until the output is made of it."""
    return output.with_name(f"{output.name}.unfinished")


def check_output(job: Job, source: Path, output: Path | None) -> None:
    """Raise `JounceError` if the output cannot be written, before any work is done."""
    if output is None:
        return
    if _is_folder(job, output):
        finished_parts.check_folder(output)
    else:
        tables.check_writable(output)
    made, given = output.resolve(), source.resolve()
    if made == given or (source.is_dir() and given in made.parents):
        raise JounceError(f"{output}: the output is the input, or in its folder; choose another path")
    if job.reading.skip:
        part_rows.check_skipped(part_rows.skipped_path(output))


def table_suffix(output: Path) -> str:
    """The type of the tables that an output is made of: a path without a suffix is a folder of Parquet tables."""
    return output.suffix.lower() or ".parquet"


def collect_notes(results: Mapping[str, MotionResult], first: Sequence[str] = ()) -> tuple[str, ...]:
    """The notes of all motions, each once, after those of their table."""
    return tuple(dict.fromkeys([*first, *(note for of in results.values() for note in of.facts.notes)]))


def _is_folder(job: Job, output: Path) -> bool:
    return job.form is not None and not output.suffix


def _gather(blocks: Iterable[Block], results: dict[str, MotionResult], place: str = "") -> Iterator[Block]:
    """Blocks as they are, whose results are merged meanwhile."""
    for block in blocks:
        with errors.locate_errors(place):
            for name, result in block.results:
                add_result(results, name, result)
        yield block


def _write_rows(job: Job, layout: TableLayout, part: InputPart, work: Path, blocks: Iterable[Block]) -> str:
    """Write the rows of blocks; returns the checksum of the table, empty without any rows."""
    pieces = (_part_columns(layout, block) for block in blocks if block.channels)
    first = next(pieces, None)
    if first is None:
        return ""
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
    """The columns of a block, the first of which names the motion of each row."""
    columns = writing.table_columns([*block.channels, *block.further])
    if not layout.named:
        return columns
    names = [name for name, _ in block.results]
    return {table_parts.MOTION_COLUMN: np.repeat(names, [result.rows for _, result in block.results])} | columns


def _compute_missing(job: Job, found: TableParts, work: Path, runner: Runner, show: Show | None) -> int:
    """Compute all parts that the work folder has not finished; returns their number."""
    for path in (work, finished_parts.rows_folder(work)):
        files.make_folder(path)
        temporary_files.remove_abandoned(path)
    missing = [part for part in found.parts if not finished_parts.is_finished(job, part, work)]
    sizes = {part.number: part.size for part in found.parts}
    total = sum(sizes.values())
    done, rows = total - sum(part.size for part in missing), 0
    with closing(runner(job, found.layout, missing, work)) as finished:  # whatever ends the run ends it elsewhere too
        for part in finished:
            done, rows = done + sizes[part.number], rows + part.rows
            if show is not None:
                show(done, total, rows)
    return len(missing)


def _read_finished(job: Job, found: TableParts, work: Path) -> Iterator[FinishedPart]:
    """All parts in the order of the input, each read when its turn comes."""
    for part in found.parts:
        finished = finished_parts.find_finished(work, part, job)
        assert finished is not None  # it was computed
        yield finished


def _summarize(found: TableParts, finished: Iterable[FinishedPart], computed: int) -> RunSummary:
    """Merge the results of all parts."""
    results: dict[str, MotionResult] = {}
    warnings: dict[str, None] = {}
    skipped = 0
    for part, of in zip(found.parts, finished, strict=True):
        warnings.update(dict.fromkeys(of.warnings))
        skipped += len(of.skipped)
        with errors.locate_errors(tables.describe_place(part.path, part.span.start)):
            for name, result in of.results.items():
                add_result(results, name, result)
    if not results:
        raise JounceError("no row of the input is good: nothing is written but the table of rows that are left out")
    notes = collect_notes(results, found.notes)
    return RunSummary(results, notes, tuple(warnings), len(found.parts), computed, skipped)


def write_table(output: Path, columns: Columns, job: Job) -> None:
    """Write a table of few rows; numbers in it may be infinite or missing."""
    with files.write_whole(output) as path:
        about = writing.table_metadata(job.robot.mechanism, job.order)
        TABLE_WRITERS[table_suffix(output)].write(path, [columns], about)
