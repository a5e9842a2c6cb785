"""Between arrays of states and vectors of lanes, in LLVM IR: rows are transposed in registers, odd ends lane by lane.

In scratch memory a block of states is one vector for each scalar of a state.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from jounce.dynamics.computation import Signature
from jounce.native.ir import Writer

FETCHED_AHEAD = 8  # doubles: the cache line to be written next, which a processor on its own fetches too late
MAX_UNROLLED_TILES = 2  # of short rows, those of arms: the loop itself takes a fifth of the time of so few


def define_transposes(ir: Writer, signature: Signature) -> None:
    """``@load_rows.N(row, scratch)``, ``@store_rows.N(row, scratch, table)``: rows of N numbers, one behind the other.

    What is stored in column j is the vector that lies ``table[j]`` doubles into scratch memory.
    """
    for width in sorted({port.size for port in signature.inputs}):
        with ir.function(f"internal void @load_rows.{width}(ptr %row, ptr %scratch)"):
            for column, size in _tiles(ir, width):
                pieces = [ir.load(row, size) for row in _rows(ir, column, width)]
                first = ir.at("%scratch", column, ir.V)
                for j, vector in enumerate(_transpose(ir, [_join(ir, pieces[i::size], size) for i in range(size)])):
                    ir.store(vector, ir.at(first, j, ir.V))
    for width in sorted({port.size for port in signature.outputs}):
        with ir.function(f"internal void @store_rows.{width}(ptr %row, ptr %scratch, ptr %table)"):
            for column, size in _tiles(ir, width):
                rows, first = _rows(ir, column, width), ir.at("%table", column, "i64")
                offsets = [ir.let(f"load i64, ptr {ir.at(first, j, 'i64')}") for j in range(size)]
                vectors = _transpose(ir, [ir.load(ir.at("%scratch", offset)) for offset in offsets])
                for lane, row in enumerate(rows):
                    start = lane - lane % size
                    ir.store(ir.shuffle([vectors[lane % size]], range(start, start + size)), row, size)
                for row in rows:
                    ir.prefetch(ir.at(row, FETCHED_AHEAD))


def _tiles(ir: Writer, width: int) -> Iterator[tuple[str, int]]:
    """The first column and the size of each tile of rows: as wide as a vector, or as short rows allow.

    The last tile ends with the row, and may overlap the one before. Many tiles are written once, in a loop.
    """
    size = min(ir.lanes, 2 ** (width.bit_length() - 1))
    starts = range(0, width, size)
    if len(starts) <= MAX_UNROLLED_TILES:
        for start in starts:
            yield str(min(start, width - size)), size
    else:
        with ir.loop(str(len(starts))) as tile:
            yield ir.call("llvm.smin.i64", "i64", ir.let(f"mul i64 {tile}, {size}"), str(width - size)), size


def _rows(ir: Writer, column: str, width: int) -> list[str]:
    """Where the rows of a block have a column."""
    first = ir.at("%row", column)
    return [ir.at(first, lane * width) for lane in range(ir.lanes)]


def _transpose(ir: Writer, rows: Sequence[str]) -> list[str]:
    """Transpose square blocks, as many lanes as there are vectors: off the diagonal, ever smaller ones change places.

    For n vectors these are log2(n) rounds of n shuffles (J. O. Eklundh, A fast computer method for matrix transposing,
    IEEE Transactions on Computers C-21, 1972).
    """
    size, rows = len(rows), list(rows)
    while size > 1:
        size //= 2
        for i in range(len(rows)):
            if i & size:
                continue
            pair = rows[i], rows[i + size]
            first = [j if not j & size else ir.lanes + j - size for j in range(ir.lanes)]
            second = [j + size if not j & size else ir.lanes + j for j in range(ir.lanes)]
            rows[i], rows[i + size] = (ir.shuffle(pair, order) for order in (first, second))
    return rows


def _join(ir: Writer, pieces: Sequence[str], size: int) -> str:
    while len(pieces) > 1:
        pieces = [ir.shuffle(pair, range(2 * size), size) for pair in zip(pieces[::2], pieces[1::2], strict=True)]
        size *= 2
    return pieces[0]


def define_lanes(ir: Writer) -> None:
    """``@load_lanes`` and ``@store_lanes``: some lanes of a block, between scratch memory and an array of any strides.

    ``(first, scratch, slabs, rows, columns, step, apart, down, across, count)``: a state is `slabs` matrices, one
    step from the state before it; matrices are ``apart``, rows ``down`` and columns ``across`` from each other, in
    bytes. Lanes beyond the count are filled with the last state. A table as above comes last where rows are stored.
    """
    integers = ("slabs", "rows", "columns", "step", "apart", "down", "across", "count")
    arguments = f"ptr %first, ptr %scratch, {', '.join(f'i64 %{name}' for name in integers)}"
    with ir.function(f"internal void @load_lanes({arguments})"):
        others = ir.let("sub i64 %count, 1")
        with _loops(ir, "slabs", "rows", "columns") as entry:
            value = ir.let(f"load double, ptr {_place(ir, others, *entry)}, align 1")
            ir.store(ir.splat(value), ir.at("%scratch", _number(ir, *entry), ir.V))
        with (
            ir.only_if(ir.let(f"icmp ne i64 {others}, 0"), "more", "done"),
            _loops(ir, "slabs", "rows", "columns") as entry,
            ir.loop(others) as lane,
        ):
            value = ir.let(f"load double, ptr {_place(ir, lane, *entry)}, align 1")
            vector = ir.at("%scratch", _number(ir, *entry), ir.V)
            ir.do(f"store double {value}, ptr {ir.at(vector, lane)}, align 8")
    with (
        ir.function(f"internal void @store_lanes({arguments}, ptr %table)"),
        _loops(ir, "slabs", "rows", "columns") as entry,
        ir.loop("%count") as lane,
    ):
        offset = ir.let(f"load i64, ptr {ir.at('%table', _number(ir, *entry), 'i64')}")
        value = ir.let(f"load double, ptr {ir.at(ir.at('%scratch', offset), lane)}, align 8")
        ir.do(f"store double {value}, ptr {_place(ir, lane, *entry)}, align 1")


@contextmanager
def _loops(ir: Writer, *counts: str) -> Iterator[list[str]]:
    """Loops within each other over as many entries as arguments of these names say."""
    with ExitStack() as stack:
        yield [stack.enter_context(ir.loop(f"%{count}")) for count in counts]


def _number(ir: Writer, slab: str, row: str, column: str) -> str:
    rows = ir.let(f"add i64 {ir.let(f'mul i64 {slab}, %rows')}, {row}")
    return ir.let(f"add i64 {ir.let(f'mul i64 {rows}, %columns')}, {column}")


def _place(ir: Writer, lane: str, slab: str, row: str, column: str) -> str:
    place = ir.let(f"mul i64 {lane}, %step")
    for i, stride in ((slab, "apart"), (row, "down"), (column, "across")):
        place = ir.let(f"add i64 {place}, {ir.let(f'mul i64 {i}, %{stride}')}")
    return ir.at("%first", place, "i8")
