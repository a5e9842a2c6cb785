"""Reads and writes Parquet tables by pyarrow.

Numbers are at full precision; units and plain data are in the metadata of the schema. The entries of a column of lists
of numbers, NAME, are columns NAME[0], NAME[1], ...: as many as its first row has.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import chain
from os import fsencode
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jounce.core.errors import JounceError, one_line, optional_import, quote_value
from jounce.io import files
from jounce.io.remainders import split_names, with_remainders
from jounce.io.table_format import (
    MAX_INFLATED_BYTES,
    Chunk,
    Pieces,
    Select,
    Span,
    TableFormat,
    TableMetadata,
    check_distinct,
    rows_per_chunk,
)

if TYPE_CHECKING:
    from pyarrow.parquet import ParquetFile

ROWS_PER_GROUP = 1 << 17  # enough for fast reading, few enough to hold a group in memory
METADATA_KEY = b"jounce"  # of the schema, under which the unit of each column stands


class Parquet(TableFormat):
    """Tables in row groups, each read in chunks of rows."""

    def columns(self, path: Path) -> dict[str, str]:
        columns = list[tuple[str, str]]()
        with _open_table(path) as file:
            types = import_pyarrow(path).types
            number_tests = (types.is_floating, types.is_integer, types.is_decimal)

            def is_number(kind: Any) -> bool:
                return any(is_kind(kind) for is_kind in number_tests)

            for field in file.schema_arrow:
                length = _list_length(types, file, field)
                if length > 0 and is_number(field.type.value_type):
                    columns += [(_entry_name(field.name, i), "") for i in range(length)]
                else:
                    columns.append((str(field.name), "" if is_number(field.type) else str(field.type)))
        check_distinct(path, [name for name, _ in columns])
        return dict(columns)

    def size(self, path: Path) -> int:
        count = len(self.names(path))
        with _open_table(path) as file:
            return int(file.metadata.num_rows) * count * 8

    def spans(self, path: Path, cells: int) -> list[Span]:
        columns = len(self.names(path))
        with _open_table(path) as file:
            about = file.metadata
            counts = [about.row_group(i).num_rows for i in range(about.num_row_groups)]
        # Row groups are read as a whole: small ones that follow each other are one span.
        spans: list[Span] = []
        for stop in np.cumsum(counts).tolist():
            first = spans[-1].stop if len(spans) > 0 else 0
            if len(spans) > 0 and (stop - spans[-1].start) * columns <= cells:
                spans[-1] = Span(spans[-1].start, stop)
            elif stop > first:
                spans.append(Span(first, stop))
        return spans

    def chunks(self, path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
        names, bases = split_names(names)
        with _open_table(path) as file:
            # Entries of lists are read with their column, once.
            arrow, schema = import_pyarrow(path), file.schema_arrow
            if texts is not None and texts not in schema.names:
                raise JounceError(
                    f"{path}: column {quote_value(texts)} is an entry of lists; expected a column of names"
                )
            plain_names = [name for name in names if name in schema.names]
            lists = dict.fromkeys(name.rpartition("[")[0] for name in names if name not in schema.names)
            lengths = {column: _list_length(arrow.types, file, schema.field(column)) for column in lists}
            selected_names = dict.fromkeys([*plain_names, *lists, *([] if texts is None else [texts])])
            for first, batch in _read_batches(file, list(selected_names), span):
                cells, broken = _list_cells(arrow, batch, lengths)
                cells |= {name: _float_cells(batch.column(name)) for name in plain_names}
                columns = {name: cells[name] for name in names}
                columns = with_remainders(columns, bases, {name: _exact_cells(batch.column(name)) for name in bases})
                motions = None if texts is None else _text_cells(path, batch.column(texts))
                yield Chunk(columns, motions, np.arange(first, first + batch.num_rows + 1), broken=broken)

    def whole(self, path: Path, select: Select | None = None) -> Chunk:
        """Return all rows, unless they take far too much memory.

        Equal cells are stored once, so that a small file may hold any number of rows: they may not take much more
        memory than the file has bytes.
        """
        header = self.names(path)
        names, _ = split_names(header if select is None else select(header))
        with _open_table(path) as file:
            stated_bytes = int(file.metadata.num_rows) * len(names) * 8
        most_bytes = path.stat().st_size + MAX_INFLATED_BYTES
        if stated_bytes > most_bytes:
            came = f"{len(names)} columns of {stated_bytes} bytes in memory; expected at most {most_bytes}"
            raise JounceError(f"{path}: {came}: divide the table, or state all rates, so that it is read by parts")
        return super().whole(path, select)

    def write(self, path: Path, pieces: Pieces, about: TableMetadata | None = None) -> None:
        """Write a table piece by piece.

        Texts are a dictionary of few values.
        """
        arrow, schema = import_pyarrow(path), None

        def tables() -> Iterator[Any]:
            nonlocal schema
            for columns in pieces:
                table = arrow.table({name: _arrow_array(arrow, column) for name, column in columns.items()})
                # All pieces have the schema of the first.
                schema = _add_metadata(arrow, table.schema, about) if schema is None else schema
                yield table.cast(schema)

        _write_groups(arrow, path, tables())

    def join(self, path: Path, parts: Iterable[Path]) -> None:
        def tables() -> Iterator[Any]:
            for part in parts:
                with _open_table(part) as file:
                    for i in range(file.num_row_groups):
                        yield file.read_row_group(i)

        _write_groups(import_pyarrow(path), path, tables())


def import_pyarrow(path: object) -> Any:
    """Return the package pyarrow with its module pyarrow.parquet.

    Where it is missing, the error says how to install it.
    """
    with optional_import(f"{path}: Parquet needs pyarrow", "tables"):
        import pyarrow
        import pyarrow.parquet
    return pyarrow


@contextmanager
def _open_table(path: Path) -> "Iterator[ParquetFile]":
    """Open a table; within this context errors of its reader become `JounceError`."""
    files.check_readable(path)
    arrow = import_pyarrow(path)
    try:
        with arrow.OSFile(fsencode(path)) as content, arrow.parquet.ParquetFile(content, pre_buffer=True) as file:
            yield file
    except (arrow.ArrowException, OSError, UnicodeDecodeError, MemoryError) as error:
        raise JounceError(f"{path}: not a Parquet table, or a damaged one: {one_line(error)}") from None


def _read_batches(file: "ParquetFile", names: Sequence[str], span: Span) -> "Iterator[tuple[int, Any]]":
    """Yield the batches of a span with their first rows' numbers."""
    stop = 0
    for i in range(file.metadata.num_row_groups):
        start, stop = stop, stop + file.metadata.row_group(i).num_rows
        if stop <= span.start or start >= span.stop:
            continue
        # Of the batches of a row group at the ends of the span only some rows are its own.
        for batch in file.iter_batches(
            rows_per_chunk(len(names)), row_groups=[i], columns=list(names), use_threads=False
        ):
            begin, end = max(span.start - start, 0), min(span.stop - start, batch.num_rows)
            if begin < end:
                yield start + begin, batch.slice(begin, end - begin)
            start += batch.num_rows


def _list_length(types: Any, file: "ParquetFile", field: Any) -> int:
    """Return the length of the lists in a column, 0 of other columns.

    It is that of the first list where the type of the column does not state it.
    """
    if types.is_fixed_size_list(field.type):
        return int(field.type.list_size)
    if not (types.is_list(field.type) or types.is_large_list(field.type)):
        return 0
    for batch in file.iter_batches(1, columns=[field.name], use_threads=False):
        [first] = batch.column(0)
        return len(first) if first.is_valid else 0
    return 0


def _entry_name(column: str, entry: int) -> str:
    """Return the name of an entry of the lists in a column."""
    return f"{column}[{entry}]"


def _list_cells(arrow: Any, batch: Any, lengths: Mapping[str, int]) -> tuple[dict[str, np.ndarray], dict[int, str]]:
    """Return the cells of lists, and what is wrong with rows.

    `lengths` are those of the lists in some columns. Other lengths are wrong; cells of missing lists are NaN.
    """
    cells, broken = dict[str, np.ndarray](), dict[int, str]()
    for column, length in lengths.items():
        array = batch.column(column)
        counts = np.full(len(array), length)
        if not arrow.types.is_fixed_size_list(array.type):
            counts = array.value_lengths().fill_null(length).to_numpy(zero_copy_only=False)
        is_missing = array.is_null().to_numpy(zero_copy_only=False)
        is_whole = ~is_missing & (counts == length)
        values = np.full((len(array), length), np.nan)
        values[is_whole] = _float_cells(array.filter(arrow.array(is_whole)).flatten()).reshape(-1, length)
        cells |= {_entry_name(column, i): x for i, x in enumerate(values.T)}
        for i in np.flatnonzero(~is_missing & (counts != length)).tolist():
            broken[i] = f"column {quote_value(column)} has {counts[i]} entries; expected {length}, as in the first row"
    return cells, broken


def _float_cells(column: Any) -> np.ndarray:
    """Return the cells as float64; missing ones are NaN."""
    return np.asarray(column.cast("float64", safe=False).to_numpy(zero_copy_only=False))


def _exact_cells(column: Any) -> np.ndarray:
    """Return the cells as integers if all are, else as float64."""
    is_integer = "int" in str(column.type) and column.null_count == 0
    return np.asarray(column.to_numpy()) if is_integer else _float_cells(column)


def _text_cells(path: Path, column: Any) -> np.ndarray:
    """Return the cells of a column of texts, none missing."""
    if column.null_count > 0:
        raise JounceError(f"{path}: the column of motions has {column.null_count} empty cells; expected a name in each")
    return np.asarray(column.cast("string").to_numpy(zero_copy_only=False).astype(str))


def _write_groups(arrow: Any, path: Path, tables: Iterable[Any]) -> None:
    """Write tables one below the other, in groups of many rows.

    Each group is written while the next one is computed.
    """
    pending, rows, writing = list[Any](), 0, Future[None]()
    writing.set_result(None)
    following = iter(tables)
    first = next(following)
    texts = [field.name for field in first.schema if arrow.types.is_dictionary(field.type)]
    options = {"compression": "none", "use_dictionary": texts, "write_statistics": ["t", *texts]}
    with (
        arrow.OSFile(fsencode(path), "wb") as file,  # which takes names of any bytes, and none for addresses
        arrow.parquet.ParquetWriter(file, first.schema, **options) as writer,
        ThreadPoolExecutor(1) as thread,
    ):
        for table in chain([first], following):
            pending, rows = [*pending, table], rows + len(table)
            # A group waits for the one before, so that two are in memory at most.
            if rows >= ROWS_PER_GROUP:
                writing.result()
                group = arrow.concat_tables(pending).unify_dictionaries()
                writing = thread.submit(writer.write_table, group, ROWS_PER_GROUP)
                pending, rows = [], 0
        writing.result()
        if len(pending) > 0:
            writer.write_table(arrow.concat_tables(pending).unify_dictionaries(), ROWS_PER_GROUP)


def _arrow_array(arrow: Any, column: np.ndarray) -> Any:
    """Return a column as an array of pyarrow.

    Texts become codes of a dictionary.
    """
    if column.dtype.kind != "U":
        return arrow.array(np.ascontiguousarray(column))
    # Equal texts follow each other: only the first of each run is compared.
    run_starts = np.flatnonzero(np.concatenate([[True], column[1:] != column[:-1]]))
    values, codes = np.unique(column[run_starts], return_inverse=True)
    code_of_row = np.repeat(codes.astype(np.int32), np.diff(np.append(run_starts, len(column))))
    return arrow.DictionaryArray.from_arrays(arrow.array(code_of_row), arrow.array(values.tolist()))


def _add_metadata(arrow: Any, schema: Any, about: TableMetadata | None) -> Any:
    """Return a schema with the units of its columns, and plain data."""
    if about is None:
        return schema
    units = {name: about.unit(name) for name in schema.names if about.unit(name) != ""}
    fields = [field.with_metadata({"unit": units[field.name]}) if field.name in units else field for field in schema]
    return arrow.schema(fields, {METADATA_KEY: json.dumps({**about.data, "units": units}).encode()})
