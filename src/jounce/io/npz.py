"""NPZ tables: an archive with an array for each column, as `numpy.savez` writes it.

What an archive states is judged before it is used, and nothing is mapped to memory:

1. `_open_table` reads the first bytes of every member: the kind and shape of an array, whose size must be that of the
   member, and the names of its columns.
2. Columns are selected by name, and refused unless they are numbers, or texts of a fixed length where these are read.
3. Cells are read. Cells of stored members have places in the file, so that a chunk of rows is read at a time.
   Compressed members are inflated as a whole, to no more bytes than they state.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from io import BufferedIOBase, BytesIO
from itertools import chain, islice
from pathlib import Path
from struct import unpack_from
from typing import Any, BinaryIO, cast
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from jounce.core.errors import JounceError, one_line, quote_value, shorten
from jounce.io import files
from jounce.io.remainders import split_names, with_remainders
from jounce.io.table_format import (
    CELLS_PER_CHUNK,
    MAX_INFLATED_BYTES,
    CellError,
    Chunk,
    Pieces,
    Select,
    Span,
    TableFormat,
    TableMetadata,
    check_distinct,
    number_rows,
)

# Of the fixed part of a ZIP member's header, which ends in two lengths: of its name, and of what follows the name.
LOCAL_HEADER_BYTES = 30
MAX_ARRAY_HEADER_BYTES = 1 << 14  # of an array; NumPy itself refuses headers of more than 10,000 characters
MAX_COLUMNS = 1 << 16  # of a table, since a shape states any number of them in a few bytes
CHUNK_BYTES = 8 * CELLS_PER_CHUNK  # of rows that are read at a time, or of a member that is read as a whole
MAX_CODE_POINT = 0x10FFFF  # of characters
NUMBERS, TEXTS = "fiu", "US"  # kinds of cells, as NumPy abbreviates them


@dataclass(frozen=True, eq=False)
class Member:
    """An array of an archive, as its headers state it."""

    entry: ZipInfo
    kind: np.dtype
    shape: tuple[int, ...]  # vectors (N, 1) and (1, N), as MATLAB has them, are (N,)
    fortran: bool
    start: int  # of its cells, in bytes of the member

    @property
    def size(self) -> int:
        """The bytes that all cells take."""
        return math.prod(self.shape) * self.kind.itemsize

    @property
    def row_bytes(self) -> int:
        """The bytes that one row takes."""
        return math.prod(self.shape[1:]) * self.kind.itemsize

    def arrange(self, cells: bytes | bytearray) -> np.ndarray:
        """Return the array of some rows, or all.

        `cells` are the bytes of their cells in the order of the member.
        """
        array = np.frombuffer(cells, self.kind)
        return array.reshape((-1, *self.shape[1:]), order="F" if self.fortran else "C")


@dataclass(frozen=True, eq=False)
class NpzColumn:
    """A column: a member, or a field or column of one."""

    member: Member
    kind: np.dtype  # of a cell
    shape: tuple[int, ...]
    field: str | None = None
    index: int | None = None

    @property
    def is_number(self) -> bool:
        """Whether the cells are numbers."""
        return self.kind.kind in NUMBERS

    @property
    def is_readable(self) -> bool:
        """Whether the cells are numbers or texts that take bytes."""
        return self.kind.kind in NUMBERS + TEXTS and self.kind.itemsize > 0

    @property
    def holds(self) -> str:
        """The kind of the cells in words."""
        return "Python objects" if self.kind.hasobject else shorten(str(self.kind))

    def cells(self, rows: np.ndarray) -> np.ndarray:
        """Return the cells of the column from rows of its member."""
        field_rows = rows if self.field is None else rows[self.field]
        return field_rows if self.index is None else field_rows[:, self.index]


class Npz(TableFormat):
    """Archives, which are read in bounded memory unless they are compressed."""

    def columns(self, path: Path) -> dict[str, str]:
        return {name: "" if column.is_number else column.holds for name, column in _vectors(path).items()}

    def size(self, path: Path) -> int:
        columns = _vectors(path).values()
        return sum(column.shape[0] * column.kind.itemsize for column in columns if column.is_readable)

    def spans(self, path: Path, cells: int) -> list[Span]:
        """Return the spans of the rows.

        All readable columns have as many rows.
        """
        with _open_table(path) as table:
            columns = {name: column for name, column in table.vectors().items() if column.is_readable}
            if len(columns) == 0:
                raise JounceError(f"{path}: no columns of numbers; expected named columns of numbers")
            first = next(iter(columns))
            table.check_inflated_size([columns[first].member])
        (rows,), step = columns[first].shape, max(1, cells // len(columns))
        for name, column in columns.items():
            if column.shape != (rows,):
                came = f"{rows} rows in column {quote_value(first)}, {column.shape[0]} in {quote_value(name)}"
                raise JounceError(f"{path}: {came}; expected as many in all")
        return [Span(start, min(start + step, rows)) for start in range(0, rows, step)]

    def chunks(self, path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
        names, bases = split_names(names)
        with _open_table(path) as table:
            selected_names = names if texts is None else [*names, texts]
            if table.check_columns(names, texts) < span.stop:
                raise JounceError(f"{path}: the table lost rows while it was read; expected {span.stop}")
            # A member may hold several columns, and is read once for each chunk of rows.
            members = table.members(selected_names)
            read = table.row_reader(members)
            step = max(1, CHUNK_BYTES // sum(member.row_bytes for member in members))
            for start in range(span.start, span.stop, step):
                part = range(start, min(start + step, span.stop))
                rows = {member: read(member, part) for member in members}
                cells = {name: table.columns[name].cells(rows[table.columns[name].member]) for name in selected_names}
                motions = None if texts is None else _as_texts(path, texts, cells[texts])
                yield Chunk(_as_numbers(cells, names, bases), motions, np.arange(part.start, part.stop + 1))

    def whole(self, path: Path, select: Select | None = None) -> Chunk:
        """Return all rows.

        Their bytes are checked by the sums in the archive.
        """
        with _open_table(path) as table:
            names, bases = split_names(table.columns if select is None else select(list(table.columns)))
            table.check_columns(names, None)
            members = table.members(names)
            table.check_inflated_size(members)
            rows = {member: table.read_member(member) for member in members}
            cells = {name: table.columns[name].cells(rows[table.columns[name].member]) for name in names}
        return number_rows(_as_numbers(cells, names, bases))

    def write(self, path: Path, pieces: Pieces, about: TableMetadata | None = None) -> None:
        """Write a table as numpy.savez does, column by column.

        All pieces are held until the last has come.
        """
        parts = list(pieces)
        with ZipFile(path, "w") as archive:
            for name in parts[0]:
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    column = np.concatenate([part[name] for part in parts])
                    np.lib.format.write_array(member, column, allow_pickle=False)

    def join(self, path: Path, parts: Iterable[Path]) -> None:
        """Write the tables of several files as one.

        Their columns are the same; one column of one file is in memory at a time.
        """
        # The header of a column states the rows of all files, and a type that holds the cells of all.
        tables = {part: _vectors(part) for part in parts}
        with ZipFile(path, "w") as archive:
            for name in next(iter(tables.values())):
                columns = [table[name] for table in tables.values()]
                dtype = np.result_type(*(column.kind for column in columns))
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    shape = (sum(column.shape[0] for column in columns),)
                    np.lib.format.write_array_header_2_0(
                        member, {"shape": shape, "fortran_order": False, "descr": dtype.str}
                    )
                    for part in tables:
                        with _open_table(part) as table:
                            cells = table.read_member(table.columns[name].member)
                        member.write(np.ascontiguousarray(cells, dtype).tobytes())


@dataclass(frozen=True, eq=False)
class NpzTable:
    """An archive that is open for reading."""

    path: Path
    file: BinaryIO
    archive: ZipFile
    columns: dict[str, NpzColumn]

    def vectors(self) -> dict[str, NpzColumn]:
        """Return the columns without arrays that are no columns; at least one."""
        columns = {name: x for name, x in self.columns.items() if len(x.shape) == 1 and x.shape[0] > 0}
        if len(columns) == 0:
            raise JounceError(f"{self.path}: no columns or no rows; expected named columns of numbers")
        return columns

    def members(self, names: Iterable[str]) -> list[Member]:
        """Return the members that hold columns, each once."""
        return list(dict.fromkeys(self.columns[name].member for name in names))

    def check_columns(self, names: Sequence[str], texts: str | None) -> int:
        """Return the length of columns of numbers, and of one of texts.

        Raises `JounceError` if the columns are of other kinds, or not all of one length.
        """
        selected_names = names if texts is None else [*names, texts]
        columns = {name: self.columns[name] for name in selected_names}
        if all(math.prod(column.shape) == 0 for column in columns.values()):
            raise JounceError(f"{self.path}: no columns or no rows; expected named columns of numbers")
        # (N,) of the first column; () where it is a single number, which no column may be.
        shape = next(iter(columns.values())).shape[:1]
        for name, column in columns.items():
            is_readable = column.is_readable if name == texts else column.is_number
            if len(column.shape) != 1 or column.shape != shape or not is_readable:
                came = f"{column.holds} of shape {column.shape}"
                kind = "texts, column.astype(str)," if name == texts else "numbers"
                expected_shape = shape if len(shape) > 0 else "(N,)"
                raise CellError(
                    f"{self.path}: column {quote_value(name)} holds {came}; expected {kind} of shape {expected_shape}"
                )
        return shape[0]

    def check_inflated_size(self, members: Iterable[Member]) -> None:
        """Raise `JounceError` if compressed members do not fit into memory.

        Their sizes are those that they state.
        """
        stated_bytes = sum(member.size for member in members if member.entry.compress_type != ZIP_STORED)
        if stated_bytes > MAX_INFLATED_BYTES:
            came = f"compressed columns of {stated_bytes} bytes; expected at most {MAX_INFLATED_BYTES}"
            raise JounceError(f"{self.path}: {came}, or columns that are not compressed, as numpy.savez writes them")

    def row_reader(self, members: Sequence[Member]) -> Callable[[Member, range], np.ndarray]:
        """Return the function that reads some rows of a member.

        Compressed members are inflated here, once; cells of others are read from the file.
        """
        self.check_inflated_size(members)
        inflated = {x: self.read_member(x) for x in members if x.entry.compress_type != ZIP_STORED}
        first_cells = {x: self._find_cells(x) for x in members if x not in inflated}

        def read(member: Member, part: range) -> np.ndarray:
            if member in inflated:
                return inflated[member][part.start : part.stop]
            # In the order of C the rows of a part stand together.
            if not member.fortran:
                place = first_cells[member] + part.start * member.row_bytes
                return member.arrange(self._read_bytes(member, place, len(part) * member.row_bytes))
            # In the order of Fortran they are a piece of each column.
            cell, columns = member.kind.itemsize, range(math.prod(member.shape[1:]))
            places = (first_cells[member] + (j * member.shape[0] + part.start) * cell for j in columns)
            return member.arrange(b"".join(self._read_bytes(member, place, len(part) * cell) for place in places))

        return read

    def read_member(self, member: Member) -> np.ndarray:
        """Return all rows of a member.

        The archive checks the bytes when it reads the last ones.
        """
        cells = bytearray(member.size)
        with _reader_errors(self.path, member.entry), self.archive.open(member.entry) as stream:
            stream.read(member.start)
            for start in range(0, member.size, CHUNK_BYTES):
                piece = memoryview(cells)[start : start + CHUNK_BYTES]
                if cast(BufferedIOBase, stream).readinto(piece) < len(piece):
                    raise ValueError("the member ends before its last cell")
        return member.arrange(cells)

    def _find_cells(self, member: Member) -> int:
        """Return the place of the first cell of a stored member."""
        header = self._read_bytes(member, member.entry.header_offset, LOCAL_HEADER_BYTES)
        lengths = unpack_from("<HH", header, LOCAL_HEADER_BYTES - 4)
        return member.entry.header_offset + LOCAL_HEADER_BYTES + sum(lengths) + member.start

    def _read_bytes(self, member: Member, place: int, count: int) -> bytes:
        """Return some bytes of the file, which are cells of a member."""
        self.file.seek(place)
        content = self.file.read(count)
        if len(content) < count:
            with _reader_errors(self.path, member.entry):
                raise ValueError("the file ends before its last cell; was it written to while it was read?")
        return content


def _vectors(path: Path) -> dict[str, NpzColumn]:
    with _open_table(path) as table:
        return table.vectors()


@contextmanager
def _open_table(path: Path) -> Iterator[NpzTable]:
    """Open a table for reading.

    What it states of its columns is judged; none of them is inflated.
    """
    with files.open_file(path) as file, ExitStack() as stack:
        with _reader_errors(path):
            archive = stack.enter_context(ZipFile(file))
            # Members that share bytes could be far larger than the file.
            entries = archive.infolist()
            if sum(entry.compress_size for entry in entries) > path.stat().st_size:
                raise ValueError("its members are larger than the file")
        divided = (_divide(_read_header(path, archive, entry)) for entry in entries)
        # No more columns are made than may be: a header of few bytes states any number.
        columns = list(islice(chain.from_iterable(divided), MAX_COLUMNS + 1))
        if len(columns) > MAX_COLUMNS:
            raise JounceError(f"{path}: more than {MAX_COLUMNS} columns; expected named columns of numbers")
        check_distinct(path, [name for name, _ in columns])
        yield NpzTable(path, file, archive, dict(columns))


def _read_header(path: Path, archive: ZipFile, entry: ZipInfo) -> Member:
    """Return what a member states of its array.

    Raises `JounceError` if the member is not as large as its array takes.
    """
    with _reader_errors(path, entry):
        # Other compressions inflate to any size at once.
        if entry.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
            raise ValueError(f"compression {entry.compress_type}; expected that of numpy.savez_compressed, or none")
        with archive.open(entry) as stream:
            head = BytesIO(stream.read(MAX_ARRAY_HEADER_BYTES))
        version = np.lib.format.read_magic(head)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, kind = read(head)
        # Names of fields in version 3 are UTF-8, and were read as Latin-1.
        if version == (3, 0) and kind.names is not None:
            kind.names = tuple(name.encode("latin-1").decode() for name in kind.names)
        if kind.subdtype is not None:
            raise ValueError(f"cells of type {shorten(str(kind))}; expected cells that are no arrays")
        if any(length < 0 for length in shape):
            raise ValueError(f"shape {shape}; expected no negative lengths")
        # (N, 1) and (1, N), as MATLAB has vectors -> (N,).
        if len(shape) == 2 and 1 in shape:
            shape = (math.prod(shape),)
        # The member ends with the last cell, and what is not compressed takes as many bytes in the file.
        member = Member(entry, kind, tuple(map(int, shape)), fortran, head.tell())
        if not kind.hasobject and member.start + member.size != entry.file_size:
            more = "more follows the array" if member.start + member.size < entry.file_size else "it ends too early"
            raise ValueError(f"{more}: {entry.file_size} bytes; expected {member.start + member.size}")
        if entry.compress_type == ZIP_STORED and entry.file_size != entry.compress_size:
            raise ValueError(f"{entry.compress_size} bytes are stored; expected {entry.file_size}")
    return member


def _divide(member: Member) -> Iterator[tuple[str, NpzColumn]]:
    """Yield the columns of a member by name.

    A vector is NAME, an array (N, k) is NAME[0], NAME[1], ...; a structured array has the columns of all fields.
    """
    name = _column_name(member.entry)
    fields: list[tuple[str | None, str, Any]] = [(None, name, member.kind)]
    if member.kind.fields is not None:
        field_names = () if member.kind.names is None else member.kind.names
        fields = [(field, field, member.kind[field]) for field in field_names]
    for field, stem, cell in fields:
        # The size of Python objects is not known, so that they are no numbers and not divided.
        kind = np.dtype(object) if member.kind.hasobject else cell.base
        shape = member.shape + cell.shape
        if len(shape) == 2 and all(shape) and not kind.hasobject:
            for j in range(shape[1]):
                yield f"{stem}[{j}]", NpzColumn(member, kind, shape[:1], field, j)
        else:
            yield stem, NpzColumn(member, kind, shape, field)


def _column_name(entry: ZipInfo) -> str:
    return entry.filename.removesuffix(".npy")


@contextmanager
def _reader_errors(path: Path, entry: ZipInfo | None = None) -> Iterator[None]:
    """Turn errors within this context into `JounceError` of a column.

    Damaged archives make decoders raise errors of any type.
    """
    try:
        yield
    except Exception as error:
        column = "" if entry is None else f" column {quote_value(_column_name(entry))}:"
        raise JounceError(f"{path}: not an NPZ table:{column} {one_line(error)}") from None


def _as_numbers(cells: Mapping[str, np.ndarray], names: Sequence[str], bases: Sequence[str]) -> dict[str, np.ndarray]:
    """Return columns as float64, with the remainders of some of them."""
    return with_remainders({name: np.ascontiguousarray(cells[name], float) for name in names}, bases, cells)


def _as_texts(path: Path, name: str, cells: np.ndarray) -> np.ndarray:
    """Return a column of texts.

    Their code points are checked, as NumPy does not.
    """
    try:
        texts = cells.astype(str)
        native_texts = np.ascontiguousarray(texts, texts.dtype.newbyteorder("="))
        if native_texts.view(np.uint32).max(initial=0) > MAX_CODE_POINT:
            raise ValueError("code points beyond those of Unicode")
    except ValueError as error:  # bytes that are not ASCII, too
        raise CellError(f"{path}: column {quote_value(name)} holds {one_line(error)}; expected texts") from None
    return native_texts
