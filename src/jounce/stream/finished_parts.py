"""Keeps finished parts of a run until the output is made.

A part is finished when its file of results is there. This file appears as a whole, after the table of rows if there is
one. Another run uses the part only if it has the key of that run and its table has the stated checksum.

The output is made of the tables of all parts (`publish_folder`, `publish_file`): it appears as a whole, and replaces no
files of others.
"""

import json
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from jounce.core import temporary_files
from jounce.core.errors import JounceError, join_names
from jounce.core.typing import JsonObject
from jounce.engine.along import BreakCause, DescribedBreak
from jounce.engine.hidden_vibrations import HiddenVibration
from jounce.io import files
from jounce.io.motions.part_rows import Skipped
from jounce.io.motions.table_parts import InputPart
from jounce.io.tables import TABLE_WRITERS
from jounce.limits.samples import Sample
from jounce.limits.verdicts import read_check
from jounce.motion.extremes import Extremes, Peak
from jounce.stream.jobs import Job, MotionFacts, MotionResult, digest

CONTINUATION = "finished parts are kept, and the same command continues after them"


@dataclass(frozen=True)
class FinishedPart:
    """The results of a computed part.

    `results` are by motion, in the order of the input. `checksum` is that of the table of rows, empty without any rows.
    """

    number: int
    key: str
    results: Mapping[str, MotionResult]
    checksum: str = ""
    skipped: Sequence[Skipped] = ()
    warnings: Sequence[str] = ()

    @property
    def rows(self) -> int:
        """The number of computed rows."""
        return sum(result.rows for result in self.results.values())


def rows_folder(work: Path) -> Path:
    """Return the folder of the tables of rows."""
    return work / "rows"


def rows_path(work: Path, part: InputPart, form: str) -> Path:
    """Return the path of the table of rows of a part."""
    return rows_folder(work) / f"part-{part.number:06d}{form}"


def results_path(work: Path, part: InputPart) -> Path:
    """Return the path of the results of a part."""
    return work / f"part-{part.number:06d}.json"


@contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """Yield a path to write to; the file appears as a whole.

    The path is in the same folder as the file.
    """
    temporary = temporary_files.temporary_path(path.parent)
    try:
        with files.write_errors(path, f"; {CONTINUATION}"):
            yield temporary
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_finished(work: Path, part: InputPart, finished: FinishedPart) -> None:
    """Write the results of a part."""
    with write_atomically(results_path(work, part)) as path:
        path.write_text(line_of(finished), encoding="utf-8")


def find_finished(work: Path, part: InputPart, job: Job) -> FinishedPart | None:
    """Return the results of a part in the work folder, or None.

    It is None if they are missing, damaged or of another run.
    """
    try:
        finished = parse_line(results_path(work, part).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        return None
    if finished is None or finished.key != job.part_key(part):
        return None
    return finished


def is_finished(job: Job, part: InputPart, work: Path) -> bool:
    """Whether a part needs no work.

    It has results of this run, and the table of its rows is unchanged.
    """
    table = None if job.form is None else rows_path(work, part, job.form)
    return is_whole(find_finished(work, part, job), table, job.reading.skip)


def is_whole(finished: FinishedPart | None, table: Path | None, skip: bool) -> bool:
    """Whether there are results with an unchanged table of rows.

    Rows that were skipped are accepted with `skip` only.
    """
    if finished is None or (finished.skipped and not skip):
        return False
    try:
        return table is None or finished.rows == 0 or files.checksum(table) == finished.checksum
    except OSError:
        return False


def line_of(finished: FinishedPart) -> str:
    """Return a finished part and its digest as a line of JSON."""
    data = asdict(finished)
    return json.dumps({"digest": digest(data), "part": data})


def parse_line(line: str) -> FinishedPart | None:
    """Read a finished part from a line of JSON; None if damaged."""
    try:
        content = json.loads(line)
        data = content["part"]
        if content["digest"] != digest(data):
            return None
        results = {name: _read_result(result) for name, result in data["results"].items()}
        skipped = tuple(Skipped(**row) for row in data["skipped"])
        return FinishedPart(**data | {"results": results, "skipped": skipped, "warnings": tuple(data["warnings"])})
    except (ValueError, KeyError, TypeError):
        return None


def _read_result(data: JsonObject) -> MotionResult:
    """Read the result of a motion from plain data."""
    facts, check = data["facts"], data["check"]
    # JSON has lists where the classes have tuples, and dictionaries where they have objects.
    breaks = tuple(
        DescribedBreak(**data_of_one | {
            "missing": tuple(data_of_one["missing"]),
            "causes": {joint: BreakCause(*cause) for joint, cause in data_of_one["causes"].items()},
        })
        for data_of_one in facts["breaks"]
    )  # fmt: skip
    hidden = tuple(HiddenVibration(**data_of_one) for data_of_one in facts["hidden"])
    peaks = {
        joint: {name: _read_extremes(*numbers) for name, numbers in numbers_by_name.items()}
        for joint, numbers_by_name in data["peaks"].items()
    }
    return MotionResult(
        data["rows"],
        tuple(data["span"]),
        MotionFacts(facts["source"], facts["residual"], tuple(facts["notes"]), breaks, hidden),
        peaks,
        data["broken"] and Sample(*data["broken"]),
        check and read_check(check),
    )


def _read_extremes(largest: Sequence[float], certain: Sequence[float], squares: float) -> Extremes:
    return Extremes(Peak(*largest), Peak(*certain), squares)


# The output of a run.
RUN_FILES = re.compile(r"part-\d{6}\.(parquet|csv|npz|json)|_jounce\.jsonl")  # names of tables and results of parts
RESULTS_FILE = "_jounce.jsonl"  # the results of all parts, in a folder of tables


def check_folder(output: Path) -> None:
    """Raise `JounceError` if a folder of tables cannot be written.

    It must not hold files other than those of an earlier run.
    """
    if not output.exists():
        files.check_writable(output)
        return
    if not output.is_dir():
        raise JounceError(
            f"{output}: exists and is not a folder; choose a file of type {', '.join(TABLE_WRITERS)}, or a folder"
        )
    own_names = {RESULTS_FILE, *(f"part-{part.number:06d}.parquet" for part in read_published(output))}
    foreign = sorted(path.name for path in output.iterdir() if path.name not in own_names)
    if len(foreign) > 0:
        raise JounceError(
            f"{output}: holds files that are not of an earlier run ({join_names(foreign, 3)}); choose another folder,"
            " or move them away"
        )


def read_published(output: Path) -> list[FinishedPart]:
    """Return the finished parts whose tables are in a folder.

    The list is empty if the folder is not the output of a run.
    """
    try:
        lines = (output / RESULTS_FILE).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return []
    parsed_parts = map(parse_line, lines)
    return [finished for finished in parsed_parts if finished is not None]


def is_published(job: Job, parts: Sequence[InputPart], output: Path) -> bool:
    """Whether a folder holds the whole output of a run, by checksums."""
    published = {part.number: part for part in read_published(output)}
    return len(published) == len(parts) and all(
        published[part.number].key == job.part_key(part)
        and is_whole(published[part.number], output / f"part-{part.number:06d}.parquet", job.reading.skip)
        for part in parts
        if part.number in published
    )


def publish_folder(parts: Sequence[InputPart], work: Path, finished: Iterable[FinishedPart], output: Path) -> None:
    """Move the tables of all parts to a folder, with their results."""
    rows = rows_folder(work)
    expected = {RESULTS_FILE, *(rows_path(work, part, ".parquet").name for part in parts)}
    for path in _run_files(rows):
        # An earlier run had more parts, of another input.
        if path.name not in expected:
            path.unlink(missing_ok=True)
    foreign = sorted(path.name for path in rows.iterdir() if path.name not in expected)
    if len(foreign) > 0:
        raise JounceError(f"{rows}: holds files that are not of this run ({join_names(foreign, 3)}); move them away")
    # The work folder takes the place of the output in one step; the earlier output is removed last.
    old = temporary_files.temporary_path(output.parent)
    try:
        with files.write_errors(output):
            with (rows / RESULTS_FILE).open("w", encoding="utf-8") as file:
                file.writelines(f"{line_of(part)}\n" for part in finished)
            if output.exists():
                output.rename(old)
            rows.rename(output)
    finally:
        shutil.rmtree(old, ignore_errors=True)


def publish_file(parts: Sequence[InputPart], work: Path, form: str, output: Path) -> None:
    """Join the tables of all parts to one table."""
    paths = [rows_path(work, part, form) for part in parts]
    try:
        with files.write_whole(output) as path:
            TABLE_WRITERS[form].join(path, [table for table in paths if table.exists()])
    except JounceError as error:  # most of all, the disk is full
        raise JounceError(f"{error}; {CONTINUATION}") from None


def remove_work(work: Path) -> None:
    """Remove the work folder, except files of others in it."""
    with suppress(OSError):
        for path in (rows_folder(work), work):
            if path.exists():
                temporary_files.remove_abandoned(path)
                for file in _run_files(path):
                    file.unlink(missing_ok=True)
                path.rmdir()


def remove_empty(work: Path) -> None:
    """Remove a work folder without finished parts."""
    with suppress(OSError):
        rows_folder(work).rmdir()
        work.rmdir()


def _run_files(folder: Path) -> Iterator[Path]:
    """Yield the files of a run in a work folder.

    They include temporary files of workers that died, also on other machines.
    """
    return (
        path
        for path in list(folder.iterdir())
        if RUN_FILES.fullmatch(path.name) or temporary_files.PART_NAME.fullmatch(path.name)
    )
