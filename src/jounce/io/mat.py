"""MAT tables of MATLAB, by SciPy: matrices are columns NAME[0], NAME[1], ..., fields are STRUCT.FIELD.

What a file states is judged before SciPy reads it, which allocates what is stated: the sizes of compressed variables,
and that no array, in structures at any depth, has more cells than bytes. Texts, cells and objects are
not read, since no column is made of them.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from struct import iter_unpack, unpack, unpack_from
from typing import Any, BinaryIO, cast
from zlib import decompressobj

import numpy as np

from jounce.core.errors import JounceError, one_line
from jounce.io.columns import Select, check_columns, check_distinct, flatten, select_columns
from jounce.io.files import open_file
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

    with open_file(path) as opened:
        file = cast(Any, opened)
        with _reader_errors(path):
            version, _ = matlab.matfile_version(file)
            if version == 1:
                _check_elements(path, opened)
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
        yield
    except JounceError:
        raise
    except NotImplementedError:
        raise JounceError(f"{path}: MAT file of version 7.3; save it in MATLAB with -v7") from None
    except Exception as error:
        raise JounceError(f"{path}: not a MAT file: {one_line(error) or type(error).__name__}") from None


def _check_elements(path: Path, file: BinaryIO) -> None:
    """Check the sizes that the variables of a file of version 5 state, and the cells of structures."""
    file.seek(0)
    order = "<" if file.read(FILE_HEADER_BYTES)[-2:] == b"IM" else ">"
    inflated, size = 0, path.stat().st_size
    while len(tag := file.read(TAG_BYTES)) == TAG_BYTES:
        kind, length = unpack(f"{order}2I", tag)
        following = file.tell() + length
        if following > size:
            raise ValueError(f"it has {size} bytes; expected {following}")
        content: Any = file
        if kind == COMPRESSED:
            content = _Inflated(file, length)
            _, length = unpack(f"{order}2I", content.read(TAG_BYTES))
            inflated += length
        if inflated > MAX_INFLATED_BYTES:
            came = f"compressed variables of {inflated} bytes; expected at most {MAX_INFLATED_BYTES}"
            raise JounceError(f"{path}: {came}, or variables that are not compressed, as save -v6 writes them")
        head = content.read(min(length, MAX_ARRAY_HEADER_BYTES))
        if len(head) > ARRAY_CLASS and STRUCTURE in (head[ARRAY_CLASS], head[ARRAY_CLASS - 3]):
            head += content.read(length - len(head))  # the arrays within it are checked too
        _check_array(memoryview(head), length, order)
        file.seek(following)


class _Inflated:
    """The inflated bytes of a compressed variable, as many as are read."""

    def __init__(self, file: BinaryIO, length: int) -> None:
        self._content, self._decoder = file.read(length), decompressobj()

    def read(self, count: int) -> bytes:
        """The next bytes."""
        found = self._decoder.decompress(self._content, count) if count else b""
        self._content = self._decoder.unconsumed_tail
        return found


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
