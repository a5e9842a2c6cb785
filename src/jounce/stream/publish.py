"""The output of a run, made of the tables of all parts: it appears as a whole, and replaces no files of others."""

import re
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from jounce.core.errors import JounceError, join_names
from jounce.core.temporary_files import PART_NAME, remove_abandoned, temporary_path
from jounce.io import files
from jounce.io.motions.table_parts import InputPart
from jounce.io.tables import TABLE_WRITERS
from jounce.stream.job import Job
from jounce.stream.work_folder import (
    CONTINUATION,
    FinishedPart,
    is_whole,
    line_of,
    parse_line,
    rows_folder,
    rows_path,
)

RUN_FILES = re.compile(r"part-\d{6}\.(parquet|csv|npz|json)|_jounce\.jsonl")  # names of tables and results of parts
RESULTS_FILE = "_jounce.jsonl"  # the results of all parts, in a folder of tables


def check_folder(output: Path) -> None:
    """Raise `JounceError` if a folder of tables cannot be written, or holds files that are not of such a run."""
    if not output.exists():
        files.check_writable(output)
        return
    if not output.is_dir():
        raise JounceError(
            f"{output}: exists and is not a folder; state a file of type {', '.join(TABLE_WRITERS)}, or a folder"
        )
    known = {RESULTS_FILE, *(f"part-{part.number:06d}.parquet" for part in read_published(output))}
    foreign = sorted(path.name for path in output.iterdir() if path.name not in known)
    if foreign:
        raise JounceError(
            f"{output}: holds files that are not of an earlier run ({join_names(foreign, 3)}); choose another folder,"
            " or move them away"
        )


def read_published(output: Path) -> list[FinishedPart]:
    """The finished parts whose tables are in a folder; empty where it is not the output of a run."""
    try:
        lines = (output / RESULTS_FILE).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return []
    return [found for line in lines if (found := parse_line(line)) is not None]


def is_published(job: Job, parts: Sequence[InputPart], output: Path) -> bool:
    """Whether a folder holds the whole output of a run, by its checksums."""
    found = {part.number: part for part in read_published(output)}
    return len(found) == len(parts) and all(
        found[part.number].key == job.part_key(part)
        and is_whole(found[part.number], output / f"part-{part.number:06d}.parquet", job.reading.skip)
        for part in parts
        if part.number in found
    )


def publish_folder(parts: Sequence[InputPart], work: Path, finished: Iterable[FinishedPart], output: Path) -> None:
    """Move the tables of all parts to a folder, with their results."""
    rows = rows_folder(work)
    expected = {RESULTS_FILE, *(rows_path(work, part, ".parquet").name for part in parts)}
    for path in _run_files(rows):
        if path.name not in expected:  # it belongs to an earlier input
            path.unlink(missing_ok=True)
    if foreign := sorted(path.name for path in rows.iterdir() if path.name not in expected):
        raise JounceError(f"{rows}: holds files that are not of this run ({join_names(foreign, 3)}); move them away")
    old = temporary_path(output.parent)
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
    """Join the tables of all parts to one."""
    tables = [rows_path(work, part, form) for part in parts]
    try:
        with files.write_whole(output) as path:
            TABLE_WRITERS[form].join(path, [table for table in tables if table.exists()])
    except JounceError as error:  # most of all, the disk is full
        raise JounceError(f"{error}; {CONTINUATION}") from None


def remove_work(work: Path) -> None:
    """Remove the work folder; what is in it of others stays."""
    with suppress(OSError):
        for path in (rows_folder(work), work):
            if path.exists():
                remove_abandoned(path)
                for file in _run_files(path):
                    file.unlink(missing_ok=True)
                path.rmdir()


def remove_empty(work: Path) -> None:
    """Remove a work folder in which no part is finished."""
    with suppress(OSError):
        rows_folder(work).rmdir()
        work.rmdir()


def _run_files(folder: Path) -> Iterator[Path]:
    """The tables and results in a work folder, and what workers that died, on other machines too, were writing."""
    return (path for path in list(folder.iterdir()) if RUN_FILES.fullmatch(path.name) or PART_NAME.fullmatch(path.name))
