"""MAT tables of MATLAB, by SciPy: matrices are columns NAME[0], NAME[1], ..., fields are STRUCT.FIELD.

What a file states is judged before SciPy reads it, which allocates what is stated: the sizes of compressed variables,
and that no array, in structures at any depth, has more cells than bytes. Texts, cells and objects are
not read, since no column is made of them.
"""

import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from itertools import count
from pathlib import Path
from struct import iter_unpack, unpack_from
from typing import Any
from zlib import decompressobj

import numpy as np

from jounce.core.errors import JounceError, one_line
from jounce.io.columns import Select, check_columns, check_distinct, flatten, select_columns
from jounce.io.files import read_bytes
from jounce.io.table_format import MAX_INFLATED_BYTES, Chunk, number_rows

FILE_HEADER_BYTES = 128  # of version 5, at whose end the byte order stands
TAG_BYTES = 8  # of an element: its type and its size
ARRAY, COMPRESSED = 14, 15  # types of elements
ARRAY_CLASS = 11  # the byte of an array with its class if numbers are big-endian, three before it if they are not
MAX_ARRAY_HEADER_BYTES = 1 << 12  # of the class, dimensions and name of an array; MATLAB's names have 63 characters
STRUCTURE = 2  # the class of structures
INTEGERS = tuple(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))
READ_CLASSES = ("double", "single", "logical", *INTEGERS, "struct")


def read_rows(path: Path, select: Select | None = None) -> Chunk:
    """All rows of the selected columns."""
    from scipy.io import loadmat, matlab, whosmat  # half a second to import, and only for such files

    file: Any = BytesIO(read_bytes(path))  # which is read no further than it goes, and does not change meanwhile
    with _reader_errors(path):
        version, _ = matlab.matfile_version(file)
        if version == 1:
            _check_elements(path, file.getbuffer())
        file.seek(0)
        variables = whosmat(file)
        check_distinct(path, [name for name, *_ in variables])
        wanted = [name for name, _, kind in variables if kind in READ_CLASSES]
        file.seek(0)
        content = loadmat(file, simplify_cells=True, variable_names=wanted)
    arrays = dict(_arrays({name: content[name] for name in wanted if name in content}, ""))
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


def _check_elements(path: Path, content: memoryview) -> None:
    """Check the sizes that the variables of a file of version 5 state, and the arrays of structures."""
    order = "<" if bytes(content[FILE_HEADER_BYTES - 2 : FILE_HEADER_BYTES]) == b"IM" else ">"
    place, inflated = FILE_HEADER_BYTES, 0
    while place + TAG_BYTES <= len(content):
        kind, size = unpack_from(f"{order}2I", content, place)
        place += TAG_BYTES
        if place + size > len(content):
            raise ValueError(f"it has {len(content)} bytes; expected {place + size}")
        array = content[place : place + size]
        place += size
        if kind == COMPRESSED:
            packed, array = array, memoryview(decompressobj().decompress(array, TAG_BYTES + MAX_ARRAY_HEADER_BYTES))
            _, size = unpack_from(f"{order}2I", array)
            inflated += size
            if inflated > MAX_INFLATED_BYTES:
                came = f"compressed variables of {inflated} bytes; expected at most {MAX_INFLATED_BYTES}"
                raise JounceError(f"{path}: {came}, or variables that are not compressed, as save -v6 writes them")
            if _is_structure(array[TAG_BYTES:]):  # the arrays within it are checked too
                array = memoryview(decompressobj().decompress(packed, TAG_BYTES + size))
            array = array[TAG_BYTES:]
        _check_array(array, size, order)


def _is_structure(array: memoryview) -> bool:
    return len(array) > ARRAY_CLASS and STRUCTURE in (array[ARRAY_CLASS], array[ARRAY_CLASS - 3])


def _check_array(array: memoryview, size: int, order: str) -> None:
    """Check that an array, and those within it, state no more bytes or cells than they have.

    `array` are its bytes, of which it states that there are `size`, or the first ones with its dimensions and name.
    """
    place = 0
    for number in count():
        if place + TAG_BYTES > len(array):
            return
        kind, length = unpack_from(f"{order}2I", array, place)
        begin, following = place + TAG_BYTES, place + TAG_BYTES + length + -length % TAG_BYTES
        if kind >> 16:  # a small element: its size and content stand in its tag
            begin, following, kind, length = place + 4, place + TAG_BYTES, kind & 0xFFFF, kind >> 16
        content = array[begin : begin + length]
        if begin + length > size or (number in (1, 2) and length > MAX_ARRAY_HEADER_BYTES // 4):
            raise ValueError(f"{length} bytes within an array of {size}")
        if number == 1:  # its dimensions
            cells = math.prod(abs(x) for (x,) in iter_unpack(f"{order}i", content[: len(content) // 4 * 4]))
            if cells > size:
                raise ValueError(f"{cells} cells in an array of {size} bytes")
        if kind == ARRAY:
            _check_array(content, length, order)
        place = following


def _arrays(content: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, np.ndarray]]:
    """The arrays of numbers by name; those of one number have no axes."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _arrays(value, f"{prefix}{name}.")
        elif isinstance(value, np.ndarray | np.generic | int | float) and np.asarray(value).dtype.kind in "biuf":
            yield f"{prefix}{name}", np.asarray(value)
