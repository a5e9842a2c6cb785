"""Reads and writes tables: named columns of numbers in files.

Every cell is checked when it is read; numbers are written at full precision.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np

from jounce.core.errors import JounceError, warn
from jounce.io import files, whole_tables
from jounce.io.csv import Csv
from jounce.io.npz import Npz
from jounce.io.parquet import Parquet, import_pyarrow
from jounce.io.table_format import (
    Chunk,
    Columns,
    Pieces,
    Select,
    TableFormat,
    TableMetadata,
    check_finite,
    leave_out_rows,
)

Known = TypeVar("Known")


CSV, NPZ, PARQUET = Csv(), Npz(), Parquet()
ROW_FORMATS: Mapping[str, TableFormat] = {".parquet": PARQUET, ".csv": CSV, ".npz": NPZ, ".tsv": CSV, ".txt": CSV}
TABLE_READERS: Mapping[str, Callable[[Path, Select | None], Chunk]] = {
    **{suffix: form.whole for suffix, form in ROW_FORMATS.items()},
    **{".mat": whole_tables.read_mat, ".jsonl": whole_tables.read_json_lines, ".ndjson": whole_tables.read_json_lines},
}
TABLE_WRITERS: dict[str, TableFormat] = {".csv": CSV, ".npz": NPZ, ".parquet": PARQUET}


def select_format(path: Path) -> TableFormat:
    """Return the format by which a file is read by rows."""
    return _select_by_suffix(path, ROW_FORMATS, "read by rows are")


def describe_place(path: Path, at: int) -> str:
    """Return a place in a file, as messages name it."""
    suffix = path.suffix.lower()
    if suffix in ROW_FORMATS:
        return ROW_FORMATS[suffix].place(path, at)
    return f"{path}: row {at} from 0" if suffix == ".mat" else f"{path}:{at}"


def read(path: Path, select: Select | None = None, skip: bool = False, missing: Iterable[str] = ()) -> Columns:
    """Return the columns of a table, all or those selected by name.

    They are finite numbers, all of one length, with at least one row. With `skip`, rows with other cells are left out,
    with a warning. Columns that end in one of `missing` may hold NaN.
    """

    def row_words(i: int) -> str:
        return describe_place(path, int(rows.places[i]))

    rows = read_rows(path, select)
    problems = rows.problems(name for name in rows.columns if not name.endswith(tuple(missing)))
    is_good, notes = leave_out_rows(problems, len(rows.places) - 1, row_words, skip)
    for note in notes:
        warn(note)
    # Without bad rows the columns are not copied.
    if len(problems) == 0:
        return rows.columns
    return {name: x[is_good] for name, x in rows.columns.items()}


def read_rows(path: Path, select: Select | None = None) -> Chunk:
    """Return all rows of the columns that are selected by name.

    Cells may be of any kind.
    """
    return _select_by_suffix(path, TABLE_READERS)(path, select)


def check_writable(path: Path) -> None:
    """Raise `JounceError` if `write` could not write, before any work is done."""
    _select_by_suffix(path, TABLE_WRITERS)
    files.check_writable(path)
    if path.suffix.lower() == ".parquet":
        import_pyarrow(path)


def write(path: Path, columns: Mapping[str, np.ndarray], about: TableMetadata | None = None) -> None:
    """Write a table; a partial file is never seen."""
    write_pieces(path, [columns], about)


def write_pieces(path: Path, pieces: Pieces, about: TableMetadata | None = None, missing: Iterable[str] = ()) -> None:
    """Write a table from pieces of some rows, each checked first.

    A partial file is never seen. In columns that end in one of `missing`, numbers may be NaN: measured torques, results
    without certain digits.
    """
    writer = _select_by_suffix(path, TABLE_WRITERS)
    with files.write_whole(path) as part:
        writer.write(part, _check_pieces(path, pieces, tuple(missing)), about)


def _check_pieces(path: Path, pieces: Pieces, missing: tuple[str, ...]) -> Iterator[Mapping[str, np.ndarray]]:
    """Yield pieces of a table, each checked to be finite."""
    rows = 0
    for columns in pieces:
        check_finite(path, columns, rows, missing)
        yield columns
        rows += len(next(iter(columns.values())))


def _select_by_suffix(path: Path, by_suffix: Mapping[str, Known], available: str = "available") -> Known:
    """Return the entry for the type of a file.

    `available` begins the list of types in the error.
    """
    if path.suffix.lower() not in by_suffix:
        raise JounceError(f"{path}: unknown type of table {path.suffix!r}; {available}: {', '.join(by_suffix)}")
    return by_suffix[path.suffix.lower()]
