"""Read tables as a whole: JSON lines, and MAT files of MATLAB.

`read_json_lines`: rows are objects, one per line; lists in them are columns NAME[0], NAME[1], ...

`read_mat`, by SciPy: matrices are columns NAME[0], NAME[1], ..., fields are STRUCT.FIELD. What a file states is judged
before SciPy reads it, which allocates what is stated: the sizes of compressed variables, and that no array, in
structures at any depth, has more cells than bytes, or lacks elements, at which SciPy crashes. Texts, cells and objects
are not read, since no column is made of them.
"""

import json
import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from itertools import chain, count, islice
from pathlib import Path
from struct import iter_unpack, unpack_from
from typing import Any, cast
from zlib import decompressobj

import numpy as np

from jounce.core.errors import JounceError, join_names, one_line, quote_value
from jounce.core.scalars import is_finite
from jounce.core.typing import JsonObject
from jounce.io import files
from jounce.io.remainders import remainder_name, split_names, text_remainders
from jounce.io.table_format import (
    MAX_INFLATED_BYTES,
    Chunk,
    Select,
    check_columns,
    check_distinct,
    flatten,
    join_chunks,
    number_rows,
    select_columns,
)

ROWS_PER_JSON_PIECE = 1 << 12  # few enough for parsed rows, which take some kB each, to fit in memory


def read_json_lines(path: Path, select: Select | None = None) -> Chunk:
    """All rows of a file, whose places are the numbers of lines; objects within a row are columns NAME.FIELD."""
    with files.open_file(path) as file:
        rows = ((number, _parse_row(path, number, line)) for number, line in enumerate(file, start=1) if line.strip())
        first = next(rows, None)
        if first is None:
            raise JounceError(f"{path}: the table is empty; expected one JSON object per line, a number for each name")
        names, bases = split_names(first[1] if select is None else select(list(first[1])))
        every, found = chain([first], rows), list[Chunk]()
        while piece := list(islice(every, ROWS_PER_JSON_PIECE)):
            found.append(_read_piece(piece, names, bases))
    return join_chunks(found)


def _read_piece(piece: list[tuple[int, JsonObject]], names: list[str], bases: list[str]) -> Chunk:
    cells: dict[str, list[Any]] = {name: [row.get(name) for _, row in piece] for name in names}
    columns = {name: np.array([float(x) if is_finite(x) else np.nan for x in of]) for name, of in cells.items()}
    for name in bases:
        columns[remainder_name(name)] = text_remainders(list(map(str, cells[name])), columns[name])
    texts = {(i, name): str(x) for name, of in cells.items() for i, x in enumerate(of) if not is_finite(x)}
    absent = {i: name for i, (_, row) in enumerate(piece) for name in reversed(names) if name not in row}
    broken = {i: f"no {quote_value(x)} in this row; it has: {join_names(piece[i][1])}" for i, x in absent.items()}
    return Chunk(columns, None, np.array([number for number, _ in piece] + [piece[-1][0] + 1]), texts, broken)


class _WrittenNumber(float):
    """A number that remembers how it is written."""

    __slots__ = ("text",)

    def __init__(self, text: str) -> None:
        self.text = text

    def __str__(self) -> str:
        return self.text


def _parse_row(path: Path, number: int, line: bytes) -> JsonObject:
    try:
        row = json.loads(line, parse_float=_WrittenNumber)
        if not isinstance(row, dict):
            raise ValueError(f"{quote_value(row)} is not an object")
        return dict(_flatten_row(row, ""))
    except (ValueError, RecursionError) as error:
        raise JounceError(f"{path}:{number}: not a line of JSON: {one_line(error)}") from None


def _flatten_row(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flatten_row(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        for i, inner in enumerate(value):
            yield from _flatten_row(inner, f"{name}[{i}]")
    else:
        yield name, value


FILE_HEADER_BYTES = 128  # of version 5, at whose end the byte order stands
TAG_BYTES = 8  # of an element: its type and its size
INT32, UINT32, ARRAY, COMPRESSED = 5, 6, 14, 15  # types of elements
DATA_TYPES = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18))  # of numbers and texts
PLAIN_CLASSES = range(4, 16)  # of texts and numbers, which hold no other arrays
LEAST_ELEMENTS = 4  # of such an array: flags, dimensions, name, numbers; sparse ones have two more, complex ones one
COMPLEX = 0x800  # a flag
SPARSE = 5  # the class of arrays that have fewer bytes than cells
INTEGERS = tuple(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))
READ_CLASSES = ("double", "single", "logical", *INTEGERS, "struct")


def read_mat(path: Path, select: Select | None = None) -> Chunk:
    """All rows of the selected columns."""
    from scipy.io import loadmat, matlab, whosmat  # half a second to import, and only for such files

    content = files.read_bytes(path)  # the file may change meanwhile
    with _reader_errors(path):
        version, _ = matlab.matfile_version(cast(Any, BytesIO(content)))
        file: Any = BytesIO(_inflate(path, content) if version == 1 else content)
        variables = whosmat(file)
        check_distinct(path, [name for name, *_ in variables])
        wanted = [name for name, _, kind in variables if kind in READ_CLASSES]
        file.seek(0)
        found = loadmat(file, simplify_cells=True, variable_names=wanted)
    arrays = dict(_arrays({name: found[name] for name in wanted if name in found}, ""))
    if any(array.ndim for array in arrays.values()):  # among columns of several rows a number is none
        arrays = {name: array for name, array in arrays.items() if array.ndim}
    columns = flatten({name: np.atleast_1d(array) for name, array in arrays.items()})
    return number_rows(check_columns(path, select_columns(columns, select)))


@contextmanager
def _reader_errors(path: Path) -> Iterator[None]:
    """Within this context, errors become `JounceError`: damaged files make their reader raise errors of any type."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("error", module=r"scipy\.io")  # of variables that are read wrong, or not at all
            yield
    except JounceError:
        raise
    except NotImplementedError:
        raise JounceError(f"{path}: MAT file of version 7.3; save it in MATLAB with -v7") from None
    except Exception as error:
        raise JounceError(f"{path}: not a MAT file: {one_line(error) or type(error).__name__}") from None


def _inflate(path: Path, content: bytes) -> bytes:
    """Inflate the variables of a file of version 5 to as many bytes as they state, and check what they state."""
    order = "<" if content[FILE_HEADER_BYTES - 2 : FILE_HEADER_BYTES] == b"IM" else ">"
    place, inflated, parts = FILE_HEADER_BYTES, 0, [content[:FILE_HEADER_BYTES]]
    while place + TAG_BYTES <= len(content):
        kind, size = unpack_from(f"{order}2I", content, place)
        begin, place = place, place + TAG_BYTES + size
        if place > len(content):
            raise ValueError(f"it has {len(content)} bytes; expected {place}")
        part = content[begin:place]
        if kind == COMPRESSED:
            decoder = decompressobj()
            tag = decoder.decompress(part[TAG_BYTES:], TAG_BYTES)
            _, size = unpack_from(f"{order}2I", tag)
            inflated += size
            if inflated > MAX_INFLATED_BYTES:
                came = f"compressed variables of {inflated} bytes; expected at most {MAX_INFLATED_BYTES}"
                raise JounceError(f"{path}: {came}, or variables that are not compressed, as save -v6 writes them")
            part = tag + decoder.decompress(decoder.unconsumed_tail, size + 1)
            if len(part) != TAG_BYTES + size:
                raise ValueError(f"a compressed variable has not the {size} bytes that it states")
        _check_array(memoryview(part)[TAG_BYTES:], order)
        parts.append(part)
    return b"".join(parts)


def _check_array(array: memoryview, order: str) -> None:
    """Check that an array, and those within it, state no more bytes or cells than they have."""
    place, of_class, least = 0, 0, 0
    for number in count():
        if place + TAG_BYTES > len(array):
            if number < least:
                raise ValueError(f"{number} elements within an array of class {of_class}; expected {least}")
            return
        kind, length = unpack_from(f"{order}2I", array, place)
        begin, following = place + TAG_BYTES, place + TAG_BYTES + length + -length % TAG_BYTES
        if kind >> 16:  # a small element: its size and content stand in its tag
            begin, following, kind, length = place + 4, place + TAG_BYTES, kind & 0xFFFF, kind >> 16
        content = array[begin : begin + length]
        if len(content) < length:
            raise ValueError(f"{length} bytes within an array of {len(array)}")
        if kind not in DATA_TYPES and (kind != ARRAY or of_class in PLAIN_CLASSES):
            raise ValueError(f"an element of type {kind} within an array of class {of_class}")
        if number == 0:  # its flags, of which SciPy reads no type
            flags = next(_integers(content, order), 0)
            of_class = flags & 0xFF
            if of_class in PLAIN_CLASSES:
                least = LEAST_ELEMENTS + 2 * (of_class == SPARSE) + bool(flags & COMPLEX)
        if number == 1 and of_class != SPARSE and kind in (INT32, UINT32):
            cells = math.prod(map(abs, _integers(content, order)))
            if cells > len(array):
                raise ValueError(f"{cells} cells in an array of {len(array)} bytes")
        if kind == ARRAY:
            _check_array(content, order)
        place = following


def _integers(content: memoryview, order: str) -> Iterator[int]:
    """The whole 32-bit integers of an element."""
    return (x for (x,) in iter_unpack(f"{order}i", content[: len(content) // 4 * 4]))


def _arrays(content: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, np.ndarray]]:
    """The arrays of numbers by name; those of one number have no axes."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _arrays(value, f"{prefix}{name}.")
        elif isinstance(value, np.ndarray | np.generic | int | float) and np.asarray(value).dtype.kind in "biuf":
            yield f"{prefix}{name}", np.asarray(value)
