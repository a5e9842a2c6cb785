"""Running a plan: parts with valid records are kept, all others computed, here or elsewhere."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

from jounce._parts import remove_abandoned
from jounce.stream.parts import compute
from jounce.stream.plan import Part, Plan, Task
from jounce.stream.records import Record, find, make_folder

Runner = Callable[[Task, Sequence[Part], Path], Iterable[Record]]  # computes parts, in any order, into a folder
Show = Callable[[int, int, int], object]  # of the size that is done, of that of all, and of the rows computed so far


def here(task: Task, parts: Sequence[Part], folder: Path) -> Iterator[Record]:
    """Compute parts one after the other in this process."""
    for part in parts:
        yield compute(task, part, folder)


def run(plan: Plan, folder: Path, runner: Runner = here, show: Show | None = None) -> list[Part]:
    """Compute all parts of a plan that have no valid record in the work folder; returns those that were computed."""
    job = plan.task.job
    make_folder(folder)
    remove_abandoned(folder)
    missing = [part for part in plan.parts if find(folder, part, job.form, job.reading.skip) is None]
    sizes = {part.number: part.size for part in plan.parts}
    total, done, rows = sum(sizes.values()), sum(sizes.values()) - sum(part.size for part in missing), 0
    for record in runner(plan.task, missing, folder):
        done, rows = done + sizes[record.number], rows + record.rows
        if show is not None:
            show(done, total, rows)
    return missing


def records(plan: Plan, folder: Path) -> Iterator[Record]:
    """The records of all parts, in the order of the input, each read when its turn comes."""
    for part in plan.parts:
        found = find(folder, part, None, True)
        assert found is not None  # `run` computed it
        yield found
