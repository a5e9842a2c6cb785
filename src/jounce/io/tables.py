"""Tables: named columns of numbers in CSV and NPZ files, every cell checked when read, all digits kept when written."""

import csv
from collections.abc import Callable, Mapping, Sequence
from io import BytesIO, StringIO
from pathlib import Path
from typing import TypeVar
from zipfile import ZipFile

import numpy as np

from jounce import names
from jounce.errors import JounceError, one_line
from jounce.io import files
from jounce.io.files import finite, read_bytes
from jounce.rates import rate_name

Columns = dict[str, np.ndarray]
Handler = TypeVar("Handler")


def read(path: Path) -> Columns:
    """The columns of a table: finite numbers, all of one length, at least one row."""
    return _by_suffix(path, READERS)(path, read_bytes(path))


def checked(place: object, columns: Mapping[str, np.ndarray]) -> Columns:
    """Columns as `read` gives them, of arrays that come from elsewhere."""
    if not columns or not max(array.size for array in columns.values()):
        raise JounceError(f"{place}: nothing in it; expected named columns of numbers")
    rows = next(iter(columns.values())).shape[:1]
    for name, array in columns.items():
        if array.shape != rows or array.ndim != 1 or array.dtype.kind not in "fiu":
            came = f"{array.dtype} of shape {array.shape}"
            raise JounceError(f"{place}: column {name!r} is {came}; expected numbers of shape {rows or '(N,)'}")
    _check_finite(place, columns)
    return {name: array.astype(float) for name, array in columns.items()}


def check_writable(path: Path) -> None:
    """Raise `JounceError` where `write` could not write, before any work is done for it."""
    _by_suffix(path, WRITERS)
    files.check_writable(path)


def write(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write a table whole: no half of it is ever seen."""
    writer = _by_suffix(path, WRITERS)
    _check_finite(path, columns)
    with files.written_whole(path) as part:
        writer(part, columns)


def of_rates(t: np.ndarray, names: Sequence[str], symbol: str, rates: Sequence[np.ndarray]) -> Columns:
    """The columns t and ``NAME.Q, NAME.Qd, ...`` of a quantity with its rates, each (N, n)."""
    columns = {"t": t}
    for j, name in enumerate(names):
        columns |= {f"{name}.{rate_name(symbol, k)}": rate[:, j] for k, rate in enumerate(rates)}
    return columns


def _check_finite(place: object, columns: Mapping[str, np.ndarray]) -> None:
    for name, array in columns.items():
        bad = np.flatnonzero(~np.isfinite(array))
        if bad.size:
            i = int(bad[0])
            raise JounceError(f"{place}: column {name!r} holds {array[i]} in row {i} from 0; expected finite numbers")


def _read_csv(path: Path, content: bytes) -> Columns:
    try:
        reader = csv.reader(StringIO(content.decode("utf-8-sig"), newline=""), skipinitialspace=True, strict=True)
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(map(str.strip, row))]
    except (UnicodeDecodeError, csv.Error) as error:
        raise JounceError(f"{path}: not a CSV table: {one_line(error)}") from None
    if not rows:
        raise JounceError(f"{path}: nothing in it; expected a row of column names and rows of numbers")
    header = [rows[0][1][0].lstrip("# "), *rows[0][1][1:]]  # numpy.savetxt marks its header with #
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        marks = "semicolons" if ";" in header[0] else "tabs"
        raise JounceError(f"{path}: columns are separated by {marks}; expected commas")
    if all(finite(name) is not None for name in header):
        raise JounceError(f"{path}: no row of column names above the numbers")
    repeated = [name for name in dict.fromkeys(header) if header.count(name) > 1]
    if repeated:
        raise JounceError(f"{path}: column {repeated[0]!r} stands {header.count(repeated[0])} times; expected once")
    for line, row in rows[1:]:
        if len(row) != len(header):
            raise JounceError(f"{path}:{line}: {len(row)} cells; expected {len(header)}, one for each column")
    if len(rows) == 1:
        raise JounceError(f"{path}: no rows of numbers under the column names")
    numbers = [[_number(cell, f"{path}:{line}", header[j]) for j, cell in enumerate(row)] for line, row in rows[1:]]
    return dict(zip(header, np.array(numbers).T.copy(), strict=True))


def _number(cell: str, place: str, column: str) -> float:
    number = finite(cell)
    if number is None:
        raise JounceError(f"{place}: column {column!r} holds {cell!r}; expected a finite number")
    return number


def _read_npz(path: Path, content: bytes) -> Columns:
    columns: Columns = {}
    name = None
    try:
        with ZipFile(BytesIO(content)) as archive:
            for member in archive.namelist():
                name = member.removesuffix(".npy")
                array = np.lib.format.read_array(BytesIO(archive.read(member)), allow_pickle=False)
                columns |= {name: array} if array.dtype.names is None else names.entries(array)  # a table of its own
    except Exception as error:  # damaged archives raise whatever their decoder stumbles over
        where = "" if name is None else f" column {name!r}:"
        raise JounceError(f"{path}: not an NPZ table:{where} {one_line(error)}") from None
    return checked(path, columns)


def _write_csv(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(np.stack(list(columns.values()), axis=1).tolist())  # repr of a double: it reads back the same


def _write_npz(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    with ZipFile(path, "w") as archive:  # as numpy.savez, which takes no column named "file"
        for name, array in columns.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


READERS: dict[str, Callable[[Path, bytes], Columns]] = {".csv": _read_csv, ".npz": _read_npz}
WRITERS: dict[str, Callable[[Path, Mapping[str, np.ndarray]], None]] = {".csv": _write_csv, ".npz": _write_npz}


def _by_suffix(path: Path, known: Mapping[str, Handler]) -> Handler:
    if path.suffix.lower() not in known:
        raise JounceError(f"{path}: unknown type of table {path.suffix!r}; there are: {', '.join(known)}")
    return known[path.suffix.lower()]
