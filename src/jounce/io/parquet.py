"""Parquet tables, by pyarrow: numbers at full precision, units and what they are of in the metadata of the schema."""

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jounce.io.columns import About, Columns, Select, checked
from jounce.io.spans.chunk import Span
from jounce.io.spans.parquet import chunks, names, opened, pyarrow

GROUP = 1 << 17  # rows of a group that is written
NAMESPACE = b"jounce"  # of the metadata of a table


def pieces(path: Path, select: Select | None = None) -> Iterator[Columns]:
    """Yield the table of a file in pieces of some rows."""
    header = names(path)
    wanted = header if select is None else list(select(header))
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
    arrow, writer = pyarrow(path), None
    try:
        for columns in pieces:
            table = arrow.table({name: _array(arrow, column) for name, column in columns.items()})
            if writer is None:
                schema = _described(arrow, table.schema, about)
                texts = [name for name, column in columns.items() if column.dtype.kind == "U"]
                writer = arrow.parquet.ParquetWriter(
                    path, schema, compression="none", use_dictionary=texts, write_statistics=["t", *texts]
                )
            writer.write_table(table.cast(schema), GROUP)
    finally:
        if writer is not None:
            writer.close()


def join(path: Path, parts: Iterable[Path]) -> None:
    """Write the tables of several files, whose columns are the same, as one."""
    arrow, writer = pyarrow(path), None
    try:
        for part in parts:
            with opened(part) as file:
                if writer is None:
                    texts = [field.name for field in file.schema_arrow if arrow.types.is_dictionary(field.type)]
                    writer = arrow.parquet.ParquetWriter(
                        path, file.schema_arrow, compression="none", use_dictionary=texts,
                        write_statistics=["t", *texts],
                    )  # fmt: skip
                for i in range(file.num_row_groups):
                    writer.write_table(file.read_row_group(i), GROUP)
    finally:
        if writer is not None:
            writer.close()


def _array(arrow: Any, column: np.ndarray) -> Any:
    if column.dtype.kind == "U":
        values, codes = np.unique(column, return_inverse=True)
        return arrow.DictionaryArray.from_arrays(arrow.array(codes.astype(np.int32)), arrow.array(values.tolist()))
    return arrow.array(np.ascontiguousarray(column))


def _described(arrow: Any, schema: Any, about: About | None) -> Any:
    """The schema with the unit of each column, and with what the table is of."""
    if about is None:
        return schema
    units = {name: unit for name in schema.names if (unit := about.unit(name))}
    fields = [field.with_metadata({"unit": units[field.name]}) if field.name in units else field for field in schema]
    return arrow.schema(fields, {NAMESPACE: json.dumps({**about.data, "units": units}).encode()})
