"""Records of finished parts: what was computed, with the checksum of the table of rows."""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from jounce.core.temporary_files import temporary_path
from jounce.io.files import write_errors
from jounce.stream.job import InputPart, digest

CHECKSUM_BLOCK_BYTES = 1 << 20  # read at a time: tables of any size are checked in little memory
CONTINUATION = "finished parts are kept, and the same command continues after them"


@dataclass(frozen=True)
class Skipped:
    """A row that is left out: its file, its number or that of its line, the column that is wrong and how, its cells.

    Of a motion that is left out, or of rows that cannot be read, it is the first row.
    """

    file: str
    row: int
    column: str
    problem: str
    cells: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Record:
    """What was computed of a part.

    `aggregates` are plain data by motion, in the order of the input. `checksum` is that of the table of rows, empty
    without any rows. `notes` are warnings.
    """

    number: int
    key: str
    rows: int
    checksum: str
    aggregates: Mapping[str, Any]
    skipped: Sequence[Skipped] = ()
    notes: Sequence[str] = ()


def rows_folder(folder: Path) -> Path:
    """The folder of the tables of rows in the work folder."""
    return folder / "rows"


def rows_path(folder: Path, part: InputPart, form: str) -> Path:
    """The path of the table of rows of a part."""
    return rows_folder(folder) / f"part-{part.number:06d}{form}"


def record_path(folder: Path, part: InputPart) -> Path:
    """The path of the record of a part."""
    return folder / f"part-{part.number:06d}.json"


@contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """Yield a path to write to in the folder of a path; the file appears when all is in it."""
    temporary = temporary_path(path.parent)
    try:
        with write_errors(path, f"; {CONTINUATION}"):
            yield temporary
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_record(folder: Path, part: InputPart, record: Record) -> None:
    """Write the record of a part."""
    with write_atomically(record_path(folder, part)) as path:
        path.write_text(line_of(record), encoding="utf-8")


def line_of(record: Record) -> str:
    """A record and its digest as a line of JSON."""
    data = vars(record) | {"skipped": [vars(row) for row in record.skipped]}
    return json.dumps({"digest": digest(data), "record": data})


def parse_record(line: str) -> Record | None:
    """The record in a line of JSON; None if it is damaged."""
    try:
        kept = json.loads(line)
        data = kept["record"]
        if kept["digest"] != digest(data):
            return None
        return Record(**data | {"skipped": tuple(Skipped(**row) for row in data["skipped"])})
    except (ValueError, KeyError, TypeError):
        return None


def find_record(folder: Path, part: InputPart) -> Record | None:
    """The record of a part in the work folder; None if it is missing, damaged or of another run."""
    try:
        record = parse_record(record_path(folder, part).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        return None
    return record if record and record.key == part.key else None


def is_valid(record: Record | None, table: Path | None, skip: bool) -> bool:
    """Whether a part needs no work: the table of its rows is as it was, and no row was left out but by `skip`."""
    if record is None or (record.skipped and not skip):
        return False
    try:
        return table is None or not record.rows or checksum(table) == record.checksum
    except OSError:
        return False


def checksum(path: Path) -> str:
    """The checksum of a file."""
    found = sha256()
    with path.open("rb") as file:
        while block := file.read(CHECKSUM_BLOCK_BYTES):
            found.update(block)
    return found.hexdigest()
