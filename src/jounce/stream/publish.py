"""The output of a run, made of the results of all parts: it appears as a whole, and replaces no files of others."""

import re
import shutil
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from jounce.core.errors import JounceError, join_names
from jounce.core.temporary_files import PART_NAME, remove_abandoned, temporary_path
from jounce.io import files
from jounce.io.tables import TABLE_WRITERS
from jounce.stream.input_parts import InputPlan
from jounce.stream.records import CONTINUATION, Record, is_valid, line_of, parse_record, rows_folder, rows_path

RUN_FILES = re.compile(r"part-\d{6}\.(parquet|csv|npz|json)|_jounce\.jsonl")  # names of tables and records
RECORDS_FILE = "_jounce.jsonl"  # the records of all parts, in a folder of tables


def work_folder(output: Path) -> Path:
    """The folder of the results of parts until the output is made of them."""
    return output.with_name(f"{output.name}.unfinished")


def check_folder(output: Path) -> None:
    """Raise `JounceError` if a folder of tables cannot be written, or holds files that are not of such a run."""
    if not output.exists():
        files.check_writable(output)
        return
    if not output.is_dir():
        raise JounceError(
            f"{output}: exists and is not a folder; state a file of type {', '.join(TABLE_WRITERS)}, or a folder"
        )
    known = {RECORDS_FILE, *(f"part-{record.number:06d}.parquet" for record in published_records(output))}
    foreign = sorted(path.name for path in output.iterdir() if path.name not in known)
    if foreign:
        raise JounceError(
            f"{output}: holds files that are not of an earlier run ({join_names(foreign, 3)}); choose another folder,"
            " or move them away"
        )


def published_records(output: Path) -> list[Record]:
    """The records of the tables in a folder; empty where it is not the output of a run."""
    try:
        lines = (output / RECORDS_FILE).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return []
    return [record for line in lines if (record := parse_record(line)) is not None]


def is_published(plan: InputPlan, output: Path) -> bool:
    """Whether a folder holds the whole output of a plan, by its checksums."""
    found = {record.number: record for record in published_records(output)}
    return len(found) == len(plan.parts) and all(
        found[part.number].key == part.key
        and is_valid(found[part.number], output / f"part-{part.number:06d}.parquet", plan.task.job.reading.skip)
        for part in plan.parts
        if part.number in found
    )


def publish_folder(plan: InputPlan, folder: Path, records: Iterable[Record], output: Path) -> None:
    """Move the tables of all parts to a folder, with their records."""
    rows = rows_folder(folder)
    expected = {RECORDS_FILE, *(rows_path(folder, part, ".parquet").name for part in plan.parts)}
    for path in _run_files(rows):
        if path.name not in expected:  # it belongs to an earlier plan
            path.unlink(missing_ok=True)
    if foreign := sorted(path.name for path in rows.iterdir() if path.name not in expected):
        raise JounceError(f"{rows}: holds files that are not of this run ({join_names(foreign, 3)}); move them away")
    old = temporary_path(output.parent)
    try:
        with files.write_errors(output):
            with (rows / RECORDS_FILE).open("w", encoding="utf-8") as file:
                file.writelines(f"{line_of(record)}\n" for record in records)
            if output.exists():
                output.rename(old)
            rows.rename(output)
    finally:
        shutil.rmtree(old, ignore_errors=True)


def publish_file(plan: InputPlan, folder: Path, form: str, output: Path) -> None:
    """Join the tables of all parts to one."""
    tables = [rows_path(folder, part, form) for part in plan.parts]
    try:
        with files.write_whole(output) as path:
            TABLE_WRITERS[form].join(path, [table for table in tables if table.exists()])
    except JounceError as error:  # most of all, the disk is full
        raise JounceError(f"{error}; {CONTINUATION}") from None


def remove_work(folder: Path) -> None:
    """Remove the work folder; what is in it of others stays."""
    with suppress(OSError):
        for path in (rows_folder(folder), folder):
            if path.exists():
                remove_abandoned(path)
                for file in _run_files(path):
                    file.unlink(missing_ok=True)
                path.rmdir()


def remove_empty(folder: Path) -> None:
    """Remove a work folder in which no part is finished."""
    with suppress(OSError):
        rows_folder(folder).rmdir()
        folder.rmdir()


def _run_files(folder: Path) -> Iterator[Path]:
    """The tables and records in a work folder, and what workers that died, on other machines too, were writing."""
    return (path for path in list(folder.iterdir()) if RUN_FILES.fullmatch(path.name) or PART_NAME.fullmatch(path.name))
