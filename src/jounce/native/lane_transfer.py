"""Between arrays of states and vectors of lanes, in LLVM IR: rows are transposed in registers, odd ends lane by lane.

In scratch memory a block of states is one vector for each scalar of a state.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from jounce.native.ir import Writer


def define_transposes(ir: Writer) -> None:
    """``@load_rows(row, scratch, width)``, ``@store_rows(row, scratch, width, table)``: rows one behind the other.

    What is stored in column j is the vector of number ``table[j]``. Rows shorter than a vector are moved as whole
    vectors, which reach into the rows behind: these must exist, and are stored later.
    """
    for name, table in (("load_rows", ""), ("store_rows", ", ptr %table")):
        with ir.function(f"internal void @{name}(ptr %row, ptr %scratch, i64 %width{table})"):
            last = ir.let(f"sub i64 %width, {ir.lanes}")
            more = ir.let(f"add i64 %width, {ir.lanes - 1}")
            groups = ir.let(f"sdiv i64 {more}, {ir.lanes}")
            with ir.loop(groups) as group:  # the last group of columns ends with the row
                wanted = ir.let(f"mul i64 {group}, {ir.lanes}")
                ends = ir.call("llvm.smin.i64", "i64", wanted, last)
                column = ir.call("llvm.smax.i64", "i64", ends, "0")
                starts = (ir.let(f"add i64 {ir.let(f'mul i64 %width, {lane}')}, {column}") for lane in range(ir.lanes))
                rows, columns = [ir.at("%row", x) for x in starts], list(_columns(ir, column, bool(table)))
                source, target = (columns, rows) if table else (rows, columns)
                for vector, place in zip(transpose(ir, [ir.load(x) for x in source]), target, strict=True):
                    ir.store(vector, place)


def _columns(ir: Writer, column: str, by_table: bool) -> Iterator[str]:
    first = ir.at("%table", column, "i64") if by_table else ir.at("%scratch", column, ir.V)
    for j in range(ir.lanes):
        if by_table:
            yield ir.at("%scratch", ir.let(f"load i64, ptr {ir.at(first, j, 'i64')}"), ir.V)
        else:
            yield ir.at(first, j, ir.V)


def transpose(ir: Writer, rows: Sequence[str]) -> list[str]:
    """Vectors of columns from vectors of rows: blocks off the diagonal exchanged, of ever smaller size.

    For n lanes these are log2(n) rounds of n shuffles (J. O. Eklundh, A fast computer method for matrix transposing,
    IEEE Transactions on Computers C-21, 1972).
    """
    size = ir.lanes
    rows = list(rows)
    while size > 1:
        size //= 2
        for i in range(ir.lanes):
            if i & size:
                continue
            low, high = rows[i], rows[i + size]
            first = [j if not j & size else ir.lanes + j - size for j in range(ir.lanes)]
            second = [j + size if not j & size else ir.lanes + j for j in range(ir.lanes)]
            rows[i], rows[i + size] = (_shuffle(ir, low, high, order) for order in (first, second))
    return rows


def _shuffle(ir: Writer, low: str, high: str, order: Sequence[int]) -> str:
    mask = f"<{ir.lanes} x i32> <{', '.join(f'i32 {j}' for j in order)}>"
    return ir.let(f"shufflevector {ir.V} {low}, {ir.V} {high}, {mask}")


def define_lanes(ir: Writer) -> None:
    """``@load_lanes`` and ``@store_lanes``: some lanes of a block, between scratch memory and an array of any strides.

    ``(first, scratch, slabs, rows, columns, step, apart, down, across, count)``: a state is `slabs` matrices, one
    step from the state before it; matrices are ``apart``, rows ``down`` and columns ``across`` from each other, in
    bytes. Lanes beyond the count are filled with the last state. A table of vectors comes last where rows are stored.
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
        number = ir.let(f"load i64, ptr {ir.at('%table', _number(ir, *entry), 'i64')}")
        value = ir.let(f"load double, ptr {ir.at(ir.at('%scratch', number, ir.V), lane)}, align 8")
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
