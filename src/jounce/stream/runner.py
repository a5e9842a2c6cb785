"""Running a plan: parts with valid records are kept, all others are computed, here or elsewhere."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from pathlib import Path

from jounce.core.temporary_files import remove_abandoned
from jounce.io.files import make_folder
from jounce.stream.input_parts import InputPlan
from jounce.stream.job import InputPart, Task
from jounce.stream.parts import compute
from jounce.stream.records import Record, find_record, is_valid, rows_folder, rows_path

Runner = Callable[[Task, Sequence[InputPart], Path], Generator[Record]]  # computes parts, in any order, into a folder
Show = Callable[[int, int, int], object]  # takes the finished size, that of all parts, and the rows computed


def run_here(task: Task, parts: Sequence[InputPart], folder: Path) -> Generator[Record]:
    """Compute parts one after the other in this process."""
    for part in parts:
        yield compute(task, part, folder)


def run(plan: InputPlan, folder: Path, runner: Runner = run_here, show: Show | None = None) -> int:
    """Compute all parts of a plan that have no valid record in the work folder; returns their number."""
    for path in (folder, rows_folder(folder)):
        make_folder(path)
        remove_abandoned(path)
    missing = [part for part in plan.parts if not is_done(plan.task, part, folder)]
    sizes = {part.number: part.size for part in plan.parts}
    total = sum(sizes.values())
    done, rows = total - sum(part.size for part in missing), 0
    with closing(runner(plan.task, missing, folder)) as found:  # whatever ends the run ends it elsewhere too
        for record in found:
            done, rows = done + sizes[record.number], rows + record.rows
            if show is not None:
                show(done, total, rows)
    return len(missing)


def read_records(plan: InputPlan, folder: Path) -> Iterator[Record]:
    """The records of all parts in the order of the input, each read when its turn comes."""
    for part in plan.parts:
        found = find_record(folder, part)
        assert found is not None  # `run` computed it
        yield found


def is_done(task: Task, part: InputPart, folder: Path) -> bool:
    """Whether a part has a valid record in the work folder."""
    job = task.job
    table = None if job.form is None else rows_path(folder, part, job.form)
    return is_valid(find_record(folder, part), table, job.reading.skip)
