"""Parquet tables, by pyarrow: numbers at full precision, units and what they are of in the metadata of the schema."""

import json
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from os import fsencode
from pathlib import Path
from typing import Any

import numpy as np

from jounce.io.columns import About, Columns, Select, checked
from jounce.io.remainders import split_names
from jounce.io.spans.chunk import Span
from jounce.io.spans.parquet import check_numbers, chunks, names, opened, pyarrow

GROUP = 1 << 17  # rows of a group that is written
NAMESPACE = b"jounce"  # of the metadata of a table


def pieces(path: Path, select: Select | None = None) -> Iterator[Columns]:
    """Yield the table of a file in pieces of some rows."""
    header = names(path)
    wanted = header if select is None else list(select(header))
    check_numbers(path, split_names(wanted)[0])
    with opened(path) as file:
        rows = file.metadata.num_rows
    found = False
    for chunk in chunks(path, wanted, None, Span(0, rows)):
        found = True
        yield checked(path, chunk.columns)
    if not found:
        yield checked(path, {})


def write(path: Path, pieces: Iterable[Mapping[str, np.ndarray]], about: About | None = None) -> None:
    """Write a table piece by piece; texts are a dictionary of few values."""
    arrow, schema = pyarrow(path), None

    def tables() -> Iterator[Any]:
        nonlocal schema
        for columns in pieces:
            table = arrow.table({name: _array(arrow, column) for name, column in columns.items()})
            schema = _described(arrow, table.schema, about) if schema is None else schema
            yield table.cast(schema)

    _write_groups(arrow, path, tables())


def join(path: Path, parts: Iterable[Path]) -> None:
    """Write the tables of several files, whose columns are the same, as one."""

    def tables() -> Iterator[Any]:
        for part in parts:
            with opened(part) as file:
                for i in range(file.num_row_groups):
                    yield file.read_row_group(i)

    _write_groups(pyarrow(path), path, tables())


def _write_groups(arrow: Any, path: Path, tables: Iterable[Any]) -> None:
    """Write tables one below the other, in groups of many rows."""
    pending, rows = list[Any](), 0
    following = iter(tables)
    first = next(following)
    texts = [field.name for field in first.schema if arrow.types.is_dictionary(field.type)]
    options = {"compression": "none", "use_dictionary": texts, "write_statistics": ["t", *texts]}
    with (
        arrow.OSFile(fsencode(path), "wb") as file,  # which takes names of any bytes, and none for addresses
        arrow.parquet.ParquetWriter(file, first.schema, **options) as writer,
    ):
        for table in chain([first], following):
            pending, rows = [*pending, table], rows + len(table)
            if rows >= GROUP:
                writer.write_table(arrow.concat_tables(pending).unify_dictionaries(), GROUP)
                pending, rows = [], 0
        if pending:
            writer.write_table(arrow.concat_tables(pending).unify_dictionaries(), GROUP)


def _array(arrow: Any, column: np.ndarray) -> Any:
    if column.dtype.kind != "U":
        return arrow.array(np.ascontiguousarray(column))
    firsts = np.flatnonzero(np.concatenate([[True], column[1:] != column[:-1]]))  # of runs of equal texts
    values, codes = np.unique(column[firsts], return_inverse=True)
    every = np.repeat(codes.astype(np.int32), np.diff(np.append(firsts, len(column))))
    return arrow.DictionaryArray.from_arrays(arrow.array(every), arrow.array(values.tolist()))


def _described(arrow: Any, schema: Any, about: About | None) -> Any:
    """The schema with the unit of each column, and with what the table is of."""
    if about is None:
        return schema
    units = {name: unit for name in schema.names if (unit := about.unit(name))}
    fields = [field.with_metadata({"unit": units[field.name]}) if field.name in units else field for field in schema]
    return arrow.schema(fields, {NAMESPACE: json.dumps({**about.data, "units": units}).encode()})
