"""Tables: named columns of numbers in files, every cell checked when read, written at full precision."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np

from jounce.core.errors import JounceError
from jounce.io import files, jsonlines, mat
from jounce.io.columns import About, Columns, Select, check_finite
from jounce.io.csv import Csv
from jounce.io.npz import Npz
from jounce.io.parquet import Parquet, pyarrow
from jounce.io.rows import Format, Pieces

Known = TypeVar("Known")
CSV, NPZ, PARQUET = Csv(), Npz(), Parquet()
ROW_FORMATS: Mapping[str, Format] = {".parquet": PARQUET, ".csv": CSV, ".npz": NPZ, ".tsv": CSV, ".txt": CSV}
TABLE_READERS: Mapping[str, Callable[[Path, Select | None], Iterator[Columns]]] = {
    ".csv": CSV.pieces,
    ".npz": NPZ.pieces,
    ".tsv": CSV.pieces,
    ".txt": CSV.pieces,
    ".mat": mat.pieces,
    ".jsonl": jsonlines.pieces,
    ".ndjson": jsonlines.pieces,
    ".parquet": PARQUET.pieces,
}
TABLE_WRITERS: dict[str, Format] = {".csv": CSV, ".npz": NPZ, ".parquet": PARQUET}


def format_of(path: Path) -> Format:
    """The format by which a file is read by rows."""
    return _by_suffix(path, ROW_FORMATS, "read by rows are")


def place(path: Path, at: int) -> str:
    """A place in a file in words."""
    return format_of(path).place(path, at)


def read(path: Path, select: Select | None = None) -> Columns:
    """The columns of a table, all or those selected by name: finite numbers, all of one length, at least one row."""
    parts = list(pieces(path, select))
    return {name: np.concatenate([part.pop(name) for part in parts]) for name in list(parts[0])}


def pieces(path: Path, select: Select | None = None) -> Iterator[Columns]:
    """Yield a table in pieces of some rows, each checked before it is yielded."""
    return _by_suffix(path, TABLE_READERS)(path, select)


def check_writable(path: Path) -> None:
    """Raise `JounceError` if `write` could not write, before any work is done."""
    _by_suffix(path, TABLE_WRITERS)
    files.check_writable(path)
    if path.suffix.lower() == ".parquet":
        pyarrow(path)


def write(path: Path, columns: Mapping[str, np.ndarray], about: About | None = None) -> None:
    """Write a table; a partial file is never seen."""
    write_pieces(path, [columns], about)


def write_pieces(path: Path, pieces: Pieces, about: About | None = None, missing: bool = False) -> None:
    """Write a table from pieces of some rows, each checked first; a partial file is never seen.

    Numbers may be `missing`, NaN, where results of closed robots have no certain digits.
    CSV and Parquet tables hold one piece at a time in memory, NPZ tables all of them.
    """
    writer = _by_suffix(path, TABLE_WRITERS)
    with files.written_whole(path) as part:
        writer.write(part, _finite(path, pieces, missing), about)


def _finite(path: Path, pieces: Pieces, missing: bool) -> Iterator[Mapping[str, np.ndarray]]:
    rows = 0
    for columns in pieces:
        check_finite(path, columns, rows, missing)
        yield columns
        rows += len(next(iter(columns.values())))


def _by_suffix(path: Path, known: Mapping[str, Known], available: str = "available") -> Known:
    if path.suffix.lower() not in known:
        raise JounceError(f"{path}: unknown type of table {path.suffix!r}; {available}: {', '.join(known)}")
    return known[path.suffix.lower()]
