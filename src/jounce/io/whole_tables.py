"""Reads tables as a whole: JSON lines, and MAT files of MATLAB.

`read_json_lines`: rows are objects, one per line; lists in them are columns NAME[0], NAME[1], ...

`read_mat`, by SciPy: matrices are columns NAME[0], NAME[1], ..., fields are STRUCT.FIELD. SciPy allocates what a file
states, and crashes where elements are missing. What a file states is therefore judged before: the sizes of compressed
variables, and that no array, in structures at any depth, has more cells than bytes or lacks elements. Texts, cells and
objects are not read, since no column is made of them.
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
    """Return all rows of a file; places are numbers of lines.

    Objects within a row are columns NAME.FIELD. The first row has the names of the columns.
    """
    with files.open_file(path) as file:
        rows = ((number, _parse_row(path, number, line)) for number, line in enumerate(file, start=1) if line.strip())
        first = next(rows, None)
        if first is None:
            raise JounceError(f"{path}: the table is empty; expected one JSON object per line, a number for each name")
        names, bases = split_names(first[1] if select is None else select(list(first[1])))
        # Parsed rows take some kB each: they become columns piece by piece.
        all_rows = chain([first], rows)
        pieces = iter(lambda: list(islice(all_rows, ROWS_PER_JSON_PIECE)), [])
        chunks = [_read_piece(piece, names, bases) for piece in pieces]
    return join_chunks(chunks)


def _read_piece(piece: list[tuple[int, JsonObject]], names: list[str], bases: list[str]) -> Chunk:
    """Return the chunk of some rows with the numbers of their lines."""
    cells: dict[str, list[Any]] = {name: [row.get(name) for _, row in piece] for name in names}
    columns: dict[str, np.ndarray] = {}
    texts: dict[tuple[int, str], str] = {}
    for name, values in cells.items():
        columns[name] = np.array([float(x) if is_finite(x) else np.nan for x in values])
        texts |= {(i, name): str(x) for i, x in enumerate(values) if not is_finite(x)}
    for name in bases:
        columns[remainder_name(name)] = text_remainders(list(map(str, cells[name])), columns[name])
    # A row without one of the columns is broken; the first missing name is reported.
    broken = {}
    for i, (_, row) in enumerate(piece):
        missing = next((name for name in names if name not in row), None)
        if missing is not None:
            broken[i] = f"no {quote_value(missing)} in this row; it has: {join_names(row)}"
    places = np.array([number for number, _ in piece] + [piece[-1][0] + 1])
    return Chunk(columns, None, places, texts, broken)


class _WrittenNumber(float):
    """A number that remembers how it is written."""

    __slots__ = ("text",)

    def __init__(self, text: str) -> None:
        self.text = text

    def __str__(self) -> str:
        return self.text


def _parse_row(path: Path, number: int, line: bytes) -> JsonObject:
    """Return the cells of a line by name."""
    try:
        row = json.loads(line, parse_float=_WrittenNumber)
        if not isinstance(row, dict):
            raise ValueError(f"{quote_value(row)} is not an object")
        return dict(_flatten_row(row, ""))
    except (ValueError, RecursionError) as error:
        raise JounceError(f"{path}:{number}: not a line of JSON: {one_line(error)}") from None


def _flatten_row(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield the cells of a value: NAME.FIELD of objects, NAME[0], ... of lists."""
    if isinstance(value, dict):
        for key, member in value.items():
            yield from _flatten_row(member, key if name == "" else f"{name}.{key}")
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield from _flatten_row(item, f"{name}[{i}]")
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
    """Return all rows of the selected columns of a MAT file."""
    from scipy.io import loadmat, matlab, whosmat  # half a second to import, and only for such files

    # The file may change meanwhile: its content is read once, judged, and then given to SciPy.
    content = files.read_bytes(path)
    with _reader_errors(path):
        version, _ = matlab.matfile_version(cast(Any, BytesIO(content)))
        file: Any = BytesIO(_inflate(path, content) if version == 1 else content)
        variables = whosmat(file)
        check_distinct(path, [name for name, *_ in variables])
        names = [name for name, _, kind in variables if kind in READ_CLASSES]
        file.seek(0)
        values = loadmat(file, simplify_cells=True, variable_names=names)
    arrays = dict(_arrays({name: values[name] for name in names if name in values}, ""))
    # Among columns of several rows a single number is no column.
    if any(array.ndim > 0 for array in arrays.values()):
        arrays = {name: array for name, array in arrays.items() if array.ndim > 0}
    columns = flatten({name: np.atleast_1d(array) for name, array in arrays.items()})
    return number_rows(check_columns(path, select_columns(columns, select)))


@contextmanager
def _reader_errors(path: Path) -> Iterator[None]:
    """Turn errors within this context into `JounceError`.

    Damaged files make their reader raise errors of any type.
    """
    try:
        with warnings.catch_warnings():
            # SciPy warns of variables that it reads wrong, or not at all.
            warnings.filterwarnings("error", module=r"scipy\.io")
            yield
    except JounceError:
        raise
    except NotImplementedError:
        raise JounceError(f"{path}: MAT file of version 7.3; save it in MATLAB with -v7") from None
    except Exception as error:
        raise JounceError(f"{path}: not a MAT file: {one_line(error) or type(error).__name__}") from None


def _inflate(path: Path, content: bytes) -> bytes:
    """Return a file of version 5 without compression, checked.

    Its variables are inflated to no more bytes than they state.
    """
    # A file is a header and variables; each variable has a tag, its type and size, before its bytes.
    order = "<" if content[FILE_HEADER_BYTES - 2 : FILE_HEADER_BYTES] == b"IM" else ">"
    place, inflated_bytes, parts = FILE_HEADER_BYTES, 0, [content[:FILE_HEADER_BYTES]]
    while place + TAG_BYTES <= len(content):
        kind, size = unpack_from(f"{order}2I", content, place)
        begin, place = place, place + TAG_BYTES + size
        if place > len(content):
            raise ValueError(f"it has {len(content)} bytes; expected {place}")
        part = content[begin:place]
        if kind == COMPRESSED:
            # The tag of the variable itself, which is compressed too, states the inflated size.
            decoder = decompressobj()
            tag = decoder.decompress(part[TAG_BYTES:], TAG_BYTES)
            _, size = unpack_from(f"{order}2I", tag)
            inflated_bytes += size
            if inflated_bytes > MAX_INFLATED_BYTES:
                came = f"compressed variables of {inflated_bytes} bytes; expected at most {MAX_INFLATED_BYTES}"
                raise JounceError(f"{path}: {came}, or variables that are not compressed, as save -v6 writes them")
            # One byte more than stated shows a variable that is longer.
            part = tag + decoder.decompress(decoder.unconsumed_tail, size + 1)
            if len(part) != TAG_BYTES + size:
                raise ValueError(f"a compressed variable has not the {size} bytes that it states")
        _check_array(memoryview(part)[TAG_BYTES:], order)
        parts.append(part)
    return b"".join(parts)


def _check_array(array: memoryview, order: str) -> None:
    """Raise `ValueError` if an array states more than it has.

    It may not state more bytes or cells than it has, nor may arrays within it.
    """
    # An array is a list of elements: flags, dimensions, name, then numbers or other arrays.
    place, class_of_array, least_elements = 0, 0, 0
    for number in count():
        if place + TAG_BYTES > len(array):
            if number < least_elements:
                raise ValueError(
                    f"{number} elements within an array of class {class_of_array}; expected {least_elements}"
                )
            return
        # Elements begin at multiples of the size of a tag.
        kind, length = unpack_from(f"{order}2I", array, place)
        begin, next_place = place + TAG_BYTES, place + TAG_BYTES + length + -length % TAG_BYTES
        # The size and content of a small element stand in its tag.
        if kind >> 16 != 0:
            begin, next_place, kind, length = place + 4, place + TAG_BYTES, kind & 0xFFFF, kind >> 16
        content = array[begin : begin + length]
        if len(content) < length:
            raise ValueError(f"{length} bytes within an array of {len(array)}")
        if kind not in DATA_TYPES and (kind != ARRAY or class_of_array in PLAIN_CLASSES):
            raise ValueError(f"an element of type {kind} within an array of class {class_of_array}")
        # The flags, whose type SciPy does not read, state the class, and so how many elements follow.
        if number == 0:
            flags = next(_integers(content, order), 0)
            class_of_array = flags & 0xFF
            if class_of_array in PLAIN_CLASSES:
                is_sparse, is_complex = class_of_array == SPARSE, (flags & COMPLEX) != 0
                least_elements = LEAST_ELEMENTS + 2 * is_sparse + is_complex
        # The dimensions state the cells, each of which takes a byte at least unless the array is sparse.
        if number == 1 and class_of_array != SPARSE and kind in (INT32, UINT32):
            cells = math.prod(map(abs, _integers(content, order)))
            if cells > len(array):
                raise ValueError(f"{cells} cells in an array of {len(array)} bytes")
        if kind == ARRAY:
            _check_array(content, order)
        place = next_place


def _integers(content: memoryview, order: str) -> Iterator[int]:
    """Return the whole 32-bit integers of an element."""
    return (x for (x,) in iter_unpack(f"{order}i", content[: len(content) // 4 * 4]))


def _arrays(content: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays of numbers by name.

    A single number has no axes.
    """
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _arrays(value, f"{prefix}{name}.")
        elif isinstance(value, np.ndarray | np.generic | int | float) and np.asarray(value).dtype.kind in "biuf":
            yield f"{prefix}{name}", np.asarray(value)
