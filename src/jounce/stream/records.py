"""Records of finished parts: what was computed, and the checksum of the table of rows. Both appear as a whole."""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from jounce._parts import part_in
from jounce.errors import JounceError, one_line
from jounce.stream.job import digest
from jounce.stream.plan import Part

BLOCK = 1 << 20  # bytes that are read at a time


@dataclass(frozen=True)
class Skipped:
    """A row that is left out: its file and place, the column that is wrong and how, and its cells."""

    place: str
    column: str
    problem: str
    cells: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Record:
    """What was computed of a part.

    `aggregates` are plain data by motion, in the order of the input. `checksum` is that of the table of rows, empty
    where there is none. `notes` are warnings.
    """

    number: int
    key: str
    rows: int
    checksum: str
    aggregates: Mapping[str, Any]
    skipped: Sequence[Skipped] = ()
    notes: Sequence[str] = ()


def rows_path(folder: Path, part: Part, form: str) -> Path:
    """The path of the table of rows of a part."""
    return folder / f"part-{part.number:06d}{form}"


def record_path(folder: Path, part: Part) -> Path:
    """The path of the record of a part."""
    return folder / f"part-{part.number:06d}.json"


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """Yield a path in the work folder to write to; the file appears when all is in it."""
    temporary = part_in(path.parent)
    try:
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise JounceError(
            f"{path}: cannot be written: {error.strerror or one_line(error)}; finished parts are kept, and the same"
            " command continues after them"
        ) from None
    finally:
        temporary.unlink(missing_ok=True)


def keep(folder: Path, part: Part, record: Record) -> None:
    """Write the record of a part."""
    data = asdict(record)
    with written(record_path(folder, part)) as path:
        path.write_text(json.dumps({"digest": digest(data), "record": data}))


def find(folder: Path, part: Part, form: str | None, skip: bool) -> Record | None:
    """The record of a part that was finished by this run or by one before it; None if it has to be computed.

    A record is valid if its key is that of the part, and the checksums are those of the files.
    """
    try:
        kept = json.loads(record_path(folder, part).read_bytes())
        data = kept["record"]
        if kept["digest"] != digest(data) or data["key"] != part.key or (data["skipped"] and not skip):
            return None
        if form is not None and data["rows"] and checksum(rows_path(folder, part, form)) != data["checksum"]:
            return None
        return Record(**data | {"skipped": tuple(Skipped(**row) for row in data["skipped"])})
    except (OSError, ValueError, KeyError, TypeError):
        return None


def checksum(path: Path) -> str:
    """The checksum of a file."""
    found = sha256()
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            found.update(block)
    return found.hexdigest()


def make_folder(path: Path) -> None:
    """Make the work folder."""
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise JounceError(f"{path}: cannot be created: {os.strerror(error.errno or 0)}") from None
