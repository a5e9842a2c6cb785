"""Rows of any length through registers: every number comes to its place, and nothing else is read or written."""

import ctypes
import mmap
import sys

import numpy as np
import pytest

from jounce.native.calls import MAX_UNROLLED_TILES
from jounce.program.program import Tape
from support.natives import WAYS, native, signature, target

WIDTHS = (1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 29, 35)
LARGEST_BLOCK = 8  # states
UNTOUCHED = 7.5  # what results are written amid
PAGE = mmap.PAGESIZE


def sources(width):
    """By result, which number of a row it is; -1 is a constant zero."""
    return np.random.default_rng(width).integers(-1, width, 2 * width)


@pytest.fixture(scope="module", params=WAYS)
def picking_function(request):
    """A function that picks numbers of rows, many of them repeatedly: of each row twice as many as it has."""
    tape = Tape()
    rows = [tape.variables(width) for width in WIDTHS]
    picked = [row[i] if i >= 0 else 0 for row, width in zip(rows, WIDTHS, strict=True) for i in sources(width)]
    given = tuple((2 * width,) for width in WIDTHS)
    taken = tuple((width,) for width in WIDTHS)
    return native(tape.program(picked), signature(taken, given, (0,) * len(WIDTHS)), request.param)


@pytest.mark.parametrize("way", WAYS)
def test_there_are_rows_with_and_without_a_loop(way):
    tiles = [width / target(way).lanes for width in WIDTHS]
    assert min(tiles) <= 1 < MAX_UNROLLED_TILES < max(tiles)


@pytest.mark.parametrize("count", range(1, 2 * LARGEST_BLOCK + 2))
def test_numbers_come_to_their_places_and_nowhere_else(picking_function, count):
    rng = np.random.default_rng(count)
    rows = [rng.normal(size=(count, width)) for width in WIDTHS]
    around = [np.full((count + 20, 2 * width), UNTOUCHED) for width in WIDTHS]
    picking_function(*rows, out=tuple(x[10:-10] for x in around))
    for x, row, width in zip(around, rows, WIDTHS, strict=True):
        np.testing.assert_array_equal(x[10:-10], np.pad(row, ((0, 0), (0, 1)))[:, sources(width)])
        assert (x[:10] == UNTOUCHED).all()
        assert (x[-10:] == UNTOUCHED).all()


@pytest.mark.skipif(sys.platform == "win32", reason="memory is protected by mprotect")
def test_memory_before_and_behind_the_rows_is_not_touched(picking_function):
    """Were it touched, the process would end."""
    count, protect = 2 * LARGEST_BLOCK, ctypes.CDLL(None).mprotect
    protect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
    kept = []

    def at_edge(width, end):
        """An array of states at an edge of memory that is not to be touched."""
        size, pages = 8 * count * width, -(-8 * count * width // PAGE)
        memory = mmap.mmap(-1, (pages + 2) * PAGE)
        address = ctypes.addressof(ctypes.c_char.from_buffer(memory))
        for edge in (0, pages + 1):
            assert protect(address + edge * PAGE, PAGE, 0) == 0
        kept.append(memory)
        offset = (pages + 1) * PAGE - size if end else PAGE
        return np.frombuffer(memory, count=count * width, offset=offset).reshape(count, width)

    for end in (False, True):
        rows, results = ([at_edge(k * width, end) for width in WIDTHS] for k in (1, 2))
        for row in rows:
            row[...] = np.random.default_rng(0).normal(size=row.shape)
        picking_function(*rows, out=tuple(results))
        for x, row, width in zip(results, rows, WIDTHS, strict=True):
            np.testing.assert_array_equal(x, np.pad(row, ((0, 0), (0, 1)))[:, sources(width)])
