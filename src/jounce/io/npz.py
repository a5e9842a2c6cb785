"""NPZ tables: an archive with an array for each column, as `numpy.savez` writes it.

What an archive states is judged before it is used, and nothing is mapped to memory:

1. `_open_table` reads the first bytes of every member: the kind and shape of an array, whose size must be that of the
   member, and the names of its columns.
2. Columns are selected by name, and refused unless they are numbers, or texts of a fixed length where these are read.
3. Cells are read. Those of stored members are found in the file, so that a chunk of rows is read at a time. Compressed
   members are inflated as a whole, to no more bytes than they state.
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

# of the fixed part of a ZIP member's header, which ends in two lengths: of its name, and of what follows that
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
        """The bytes that its cells take."""
        return math.prod(self.shape) * self.kind.itemsize

    @property
    def row_bytes(self) -> int:
        """The bytes that one row takes."""
        return math.prod(self.shape[1:]) * self.kind.itemsize

    def arrange(self, cells: bytes | bytearray) -> np.ndarray:
        """The array of some rows, or all, from the bytes of their cells in the order of the member."""
        found = np.frombuffer(cells, self.kind)
        return found.reshape((-1, *self.shape[1:]), order="F" if self.fortran else "C")


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
        """Whether the cells are numbers or texts, as many as their bytes."""
        return self.kind.kind in NUMBERS + TEXTS and self.kind.itemsize > 0

    @property
    def holds(self) -> str:
        """What the cells are, in words."""
        return "Python objects" if self.kind.hasobject else shorten(str(self.kind))

    def cells(self, rows: np.ndarray) -> np.ndarray:
        """The cells of the column in rows of its member."""
        own = rows if self.field is None else rows[self.field]
        return own if self.index is None else own[:, self.index]


class Npz(TableFormat):
    """Archives, which are read in bounded memory unless they are compressed."""

    def columns(self, path: Path) -> dict[str, str]:
        return {name: "" if column.is_number else column.holds for name, column in _vectors(path).items()}

    def size(self, path: Path) -> int:
        columns = _vectors(path).values()
        return sum(column.shape[0] * column.kind.itemsize for column in columns if column.is_readable)

    def spans(self, path: Path, cells: int) -> list[Span]:
        """The spans of the rows, as many as columns have whose sizes are judged."""
        with _open_table(path) as table:
            columns = {name: column for name, column in table.vectors().items() if column.is_readable}
            if not columns:
                raise JounceError(f"{path}: no columns of numbers; expected named columns of numbers")
            first, *others = columns
            table.check_inflated_size([columns[first].member])
        (rows,), step = columns[first].shape, max(1, cells // len(columns))
        for name in others:
            if columns[name].shape != (rows,):
                came = f"{rows} rows in column {quote_value(first)}, {columns[name].shape[0]} in {quote_value(name)}"
                raise JounceError(f"{path}: {came}; expected as many in all")
        return [Span(start, min(start + step, rows)) for start in range(0, rows, step)]

    def chunks(self, path: Path, names: Sequence[str], texts: str | None, span: Span) -> Iterator[Chunk]:
        names, bases = split_names(names)
        with _open_table(path) as table:
            wanted = [*names, *([] if texts is None else [texts])]
            if table.check_columns(names, texts) < span.stop:
                raise JounceError(f"{path}: the table lost rows while it was read; expected {span.stop}")
            members = table.members(wanted)
            read = table.row_reader(members)
            step = max(1, CHUNK_BYTES // sum(member.row_bytes for member in members))
            for start in range(span.start, span.stop, step):
                part = range(start, min(start + step, span.stop))
                rows = {member: read(member, part) for member in members}
                cells = {name: table.columns[name].cells(rows[table.columns[name].member]) for name in wanted}
                motions = None if texts is None else _as_texts(path, texts, cells[texts])
                yield Chunk(_as_numbers(cells, names, bases), motions, np.arange(part.start, part.stop + 1))

    def whole(self, path: Path, select: Select | None = None) -> Chunk:
        """All rows, whose bytes are checked by the sums in the archive."""
        with _open_table(path) as table:
            names, bases = split_names(table.columns if select is None else select(list(table.columns)))
            table.check_columns(names, None)
            members = table.members(names)
            table.check_inflated_size(members)
            rows = {member: table.read_member(member) for member in members}
            cells = {name: table.columns[name].cells(rows[table.columns[name].member]) for name in names}
        return number_rows(_as_numbers(cells, names, bases))

    def write(self, path: Path, pieces: Pieces, about: TableMetadata | None = None) -> None:
        """Write a table as numpy.savez does, column by column: all pieces are held until the last has come."""
        parts = list(pieces)
        with ZipFile(path, "w") as archive:
            for name in parts[0]:
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    column = np.concatenate([part[name] for part in parts])
                    np.lib.format.write_array(member, column, allow_pickle=False)

    def join(self, path: Path, parts: Iterable[Path]) -> None:
        """Write the tables of several files, whose columns are the same, as one; a column of a file at a time."""
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
        """The columns without arrays that are no columns; at least one."""
        found = {name: x for name, x in self.columns.items() if len(x.shape) == 1 and x.shape[0]}
        if not found:
            raise JounceError(f"{self.path}: no columns or no rows; expected named columns of numbers")
        return found

    def members(self, names: Iterable[str]) -> list[Member]:
        """The members that hold columns, each once."""
        return list(dict.fromkeys(self.columns[name].member for name in names))

    def check_columns(self, names: Sequence[str], texts: str | None) -> int:
        """Check columns of numbers, and one of texts, which are all of one length; return it."""
        wanted = {name: self.columns[name] for name in [*names, *([] if texts is None else [texts])]}
        if not any(math.prod(column.shape) for column in wanted.values()):
            raise JounceError(f"{self.path}: no columns or no rows; expected named columns of numbers")
        rows = next(iter(wanted.values())).shape[:1]
        for name, column in wanted.items():
            is_readable = column.is_readable if name == texts else column.is_number
            if len(column.shape) != 1 or column.shape != rows or not is_readable:
                came = f"{column.holds} of shape {column.shape}"
                expected = f"{'texts, column.astype(str),' if name == texts else 'numbers'} of shape {rows or '(N,)'}"
                raise CellError(f"{self.path}: column {quote_value(name)} holds {came}; expected {expected}")
        return rows[0]

    def check_inflated_size(self, members: Iterable[Member]) -> None:
        """Check that what compressed members state is little enough to be held in memory."""
        stated = sum(member.size for member in members if member.entry.compress_type != ZIP_STORED)
        if stated > MAX_INFLATED_BYTES:
            came = f"compressed columns of {stated} bytes; expected at most {MAX_INFLATED_BYTES}"
            raise JounceError(f"{self.path}: {came}, or columns that are not compressed, as numpy.savez writes them")

    def row_reader(self, members: Sequence[Member]) -> Callable[[Member, range], np.ndarray]:
        """Return the function that reads some rows of a member; compressed members are inflated here."""
        self.check_inflated_size(members)
        inflated = {x: self.read_member(x) for x in members if x.entry.compress_type != ZIP_STORED}
        begins = {x: self._find_cells(x) for x in members if x not in inflated}

        def read(member: Member, part: range) -> np.ndarray:
            if member in inflated:
                return inflated[member][part.start : part.stop]
            if not member.fortran:
                place = begins[member] + part.start * member.row_bytes
                return member.arrange(self._read_bytes(member, place, len(part) * member.row_bytes))
            cell, columns = member.kind.itemsize, range(math.prod(member.shape[1:]))
            places = (begins[member] + (j * member.shape[0] + part.start) * cell for j in columns)
            return member.arrange(b"".join(self._read_bytes(member, place, len(part) * cell) for place in places))

        return read

    def read_member(self, member: Member) -> np.ndarray:
        """All rows of a member; the archive checks the bytes when it reads the last ones."""
        cells = bytearray(member.size)
        with _reader_errors(self.path, member.entry), self.archive.open(member.entry) as stream:
            stream.read(member.start)
            for start in range(0, member.size, CHUNK_BYTES):
                piece = memoryview(cells)[start : start + CHUNK_BYTES]
                if cast(BufferedIOBase, stream).readinto(piece) < len(piece):
                    raise ValueError("the member ends before its last cell")
        return member.arrange(cells)

    def _find_cells(self, member: Member) -> int:
        """The place of the first cell of a stored member, in bytes of the file."""
        header = self._read_bytes(member, member.entry.header_offset, LOCAL_HEADER_BYTES)
        lengths = unpack_from("<HH", header, LOCAL_HEADER_BYTES - 4)
        return member.entry.header_offset + LOCAL_HEADER_BYTES + sum(lengths) + member.start

    def _read_bytes(self, member: Member, place: int, count: int) -> bytes:
        self.file.seek(place)
        found = self.file.read(count)
        if len(found) < count:
            with _reader_errors(self.path, member.entry):
                raise ValueError("the file ends before its last cell; was it written to while it was read?")
        return found


def _vectors(path: Path) -> dict[str, NpzColumn]:
    with _open_table(path) as table:
        return table.vectors()


@contextmanager
def _open_table(path: Path) -> Iterator[NpzTable]:
    """Open a table for reading; what it states of its columns is judged, and none of them is inflated."""
    with files.open_file(path) as file, ExitStack() as stack:
        with _reader_errors(path):
            archive = stack.enter_context(ZipFile(file))
            entries = archive.infolist()
            if sum(entry.compress_size for entry in entries) > path.stat().st_size:
                raise ValueError("its members are larger than the file")
        divided = (_divide(_read_header(path, archive, entry)) for entry in entries)
        columns = list(islice(chain.from_iterable(divided), MAX_COLUMNS + 1))
        if len(columns) > MAX_COLUMNS:
            raise JounceError(f"{path}: more than {MAX_COLUMNS} columns; expected named columns of numbers")
        check_distinct(path, [name for name, _ in columns])
        yield NpzTable(path, file, archive, dict(columns))


def _read_header(path: Path, archive: ZipFile, entry: ZipInfo) -> Member:
    """Read what a member states of its array, and check that it is as large as this takes."""
    with _reader_errors(path, entry):
        if entry.compress_type not in (ZIP_STORED, ZIP_DEFLATED):  # others inflate to any size at once
            raise ValueError(f"compression {entry.compress_type}; expected that of numpy.savez_compressed, or none")
        with archive.open(entry) as stream:
            head = BytesIO(stream.read(MAX_ARRAY_HEADER_BYTES))
        version = np.lib.format.read_magic(head)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, kind = read(head)
        if version == (3, 0) and kind.names is not None:  # which are UTF-8, and were read as Latin-1
            kind.names = tuple(name.encode("latin-1").decode() for name in kind.names)
        if kind.subdtype is not None:
            raise ValueError(f"cells of type {shorten(str(kind))}; expected cells that are no arrays")
        if any(length < 0 for length in shape):
            raise ValueError(f"shape {shape}; expected no negative lengths")
        if len(shape) == 2 and 1 in shape:
            shape = (math.prod(shape),)
        member = Member(entry, kind, tuple(map(int, shape)), fortran, head.tell())
        if not kind.hasobject and member.start + member.size != entry.file_size:
            more = "more follows the array" if member.start + member.size < entry.file_size else "it ends too early"
            raise ValueError(f"{more}: {entry.file_size} bytes; expected {member.start + member.size}")
        if entry.compress_type == ZIP_STORED and entry.file_size != entry.compress_size:
            raise ValueError(f"{entry.compress_size} bytes are stored; expected {entry.file_size}")
    return member


def _divide(member: Member) -> Iterator[tuple[str, NpzColumn]]:
    """The columns of a member by name: NAME of a vector, NAME[0], ... of an array (N, k), and those of all fields."""
    name = _column_name(member.entry)
    fields: list[tuple[str | None, str, Any]] = [(None, name, member.kind)]
    if member.kind.fields is not None:
        fields = [(field, field, member.kind[field]) for field in member.kind.names or ()]
    for field, of, cell in fields:
        kind = np.dtype(object) if member.kind.hasobject else cell.base
        shape = member.shape + cell.shape
        if len(shape) == 2 and all(shape) and not kind.hasobject:  # the size of objects is not known
            for j in range(shape[1]):
                yield f"{of}[{j}]", NpzColumn(member, kind, shape[:1], field, j)
        else:
            yield of, NpzColumn(member, kind, shape, field)


def _column_name(entry: ZipInfo) -> str:
    return entry.filename.removesuffix(".npy")


@contextmanager
def _reader_errors(path: Path, entry: ZipInfo | None = None) -> Iterator[None]:
    """Within this context, errors become `JounceError` of a column: damaged archives make decoders raise any type."""
    try:
        yield
    except Exception as error:
        where = "" if entry is None else f" column {quote_value(_column_name(entry))}:"
        raise JounceError(f"{path}: not an NPZ table:{where} {one_line(error)}") from None


def _as_numbers(cells: Mapping[str, np.ndarray], names: Sequence[str], bases: Sequence[str]) -> dict[str, np.ndarray]:
    """Columns as float64, with the remainders of some of them."""
    return with_remainders({name: np.ascontiguousarray(cells[name], float) for name in names}, bases, cells)


def _as_texts(path: Path, name: str, cells: np.ndarray) -> np.ndarray:
    """A column of texts, whose code points NumPy does not check."""
    try:
        texts = cells.astype(str)
        found = np.ascontiguousarray(texts, texts.dtype.newbyteorder("="))
        if found.view(np.uint32).max(initial=0) > MAX_CODE_POINT:
            raise ValueError("code points beyond those of Unicode")
    except ValueError as error:  # bytes that are not ASCII, too
        raise CellError(f"{path}: column {quote_value(name)} holds {one_line(error)}; expected texts") from None
    return found
