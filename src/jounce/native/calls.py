"""Write kernels in the calling convention of NumPy's generalized ufuncs: arrays in, arrays out.

``@states(args, dimensions, steps, data)``: args are the arrays of inputs and outputs, dimensions the number of states,
steps the strides of the arrays from state to state, then those within a state.

`write_modules` is the door: it writes what moves states in and results out around the ``@block`` of a form. In scratch
memory a block of states is one vector for each scalar of a state. Rows that lie one behind the other are transposed in
registers (`define_transposes`), odd ends and other strides go lane by lane (`define_lanes`). Short code has a second
module for one state alone, whose vectors have one lane.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

from jounce.dynamics.computation import Port, Signature
from jounce.native import memory_layout, scratch_pool, vector_functions
from jounce.native.ir import BlockCode, Writer
from jounce.native.jit import Target

MAX_UNROLLED_COPIES, COPIES_PER_TURN = 64, 8  # of results of one state: LLVM's time grows as the square of a block
FETCHED_AHEAD = 8  # doubles: the cache line to be written next, which a processor on its own fetches too late
MAX_UNROLLED_TILES = 2  # of short rows, those of arms: the loop itself takes a fifth of the time of so few


@dataclass(frozen=True)
class _Array:
    """An array that a caller passes: where it begins, and its strides in bytes, from state to state and within one."""

    pointer: str
    step: str
    within: tuple[str, ...]


def write_modules(block: BlockCode, signature: Signature, target: Target) -> list[str]:
    """Return the modules of a kernel, which are to be linked.

    They define ``@states``, and for short code ``@state``, which computes one state alone.
    """
    size = block.at_once * memory_layout.block_size(signature, block.of_bodies, target.lanes)
    if not block.short:
        return [_write_module(block, signature, target, size, "states")]
    # Vectors of one lane are numbers: the same form writes the code for one state.
    scalars = replace(target, lanes=1)
    return [
        _write_module(block, signature, target, size, "states", "state"),
        _write_module(block, signature, scalars, size, "state"),
        *_write_wide_module(block, target),
    ]


def _write_wide_module(block: BlockCode, target: Target) -> Iterator[str]:
    """Yield the module of vectors that code for one state calls.

    Most forms have none.
    """
    if block.define_wide is not None:
        ir = Writer(target)
        block.define_wide(ir)
        yield ir.text()


def _write_module(
    block: BlockCode, signature: Signature, target: Target, size: int, name: str, of_one: str | None = None
) -> str:
    """Return a module that defines the function `name` of states.

    With `of_one`, it leaves one state alone to the function of this name, in another module. Both take scratch memory
    of one size, as they give it back to one pool.
    """
    ir = Writer(target)
    define_lanes(ir)
    block.define(ir)
    # Only those functions of vectors are defined that the code calls.
    for called, define in vector_functions.DEFINITIONS.items():
        if any(f"@{called}(" in line for line in ir.lines):
            define(ir)
    # Tables say where in scratch memory each number of a result is. Places are counted from the results, or, where
    # results are scattered in working memory, from the bodies behind them.
    first = signature.outputs[-1].end if block.results_in_bodies else 0
    results = [[first + place for place in places] for places in block.places]
    for k, places in enumerate(results):
        ir.table(f"places.{k}", [place * ir.lanes for place in places])
    if target.lanes > 1:
        define_transposes(ir, signature)
        _define_blocks(ir, signature, block)
    else:
        _define_state(ir, signature, results)
    # From the outside in: the choice between one state and more, scratch memory, the loop over blocks, the block.
    define_call = _define_on_stack if size <= memory_layout.MAX_STACK_BYTES else scratch_pool.define_on_heap
    define_call(ir, size, "@call" if of_one else f"@{name}")
    if of_one:
        _define_choice(ir, name, of_one)
    if name == "states":
        ir.table("scratch", [size], "dso_local")
        _define_bound(ir)
    return ir.text()


def _define_choice(ir: Writer, name: str, of_one: str) -> None:
    """Define a function of states that calls another one for one state.

    A vector for each number of a single state would take longer.
    """
    arguments = "(ptr %args, ptr %dimensions, ptr %steps, ptr %pool)"
    ir.declared[f"declare void @{of_one}(ptr, ptr, ptr, ptr)"] = None
    with ir.function(f"void @{name}{arguments}"):
        is_one_state = ir.let(f"icmp eq i64 {ir.let('load i64, ptr %dimensions')}, 1")
        ir.do(f"br i1 {is_one_state}, label %one, label %more")
        for label, called in (("one", of_one), ("more", "call")):
            ir.label(label)
            ir.do(f"call void @{called}{arguments}")
            ir.do("ret void")


def _define_bound(ir: Writer) -> None:
    """Define ``@bound(call)``, which is ``@states`` of four arguments in memory.

    Each argument that Python passes takes time.
    """
    with ir.function("void @bound(ptr %call)"):
        arguments = [ir.let(f"load ptr, ptr {ir.at('%call', j, 'ptr')}") for j in range(4)]
        ir.do(f"call void @states({', '.join(f'ptr {x}' for x in arguments)})")


def _define_blocks(ir: Writer, signature: Signature, code: BlockCode) -> None:
    """Define ``@blocks(args, dimensions, steps, memory)``: the loop over groups of blocks of states.

    A group is loaded, computed and stored before the next one, so that a result may lie exactly over an array of
    states: NumPy then makes no copy. Rows that lie one behind the other go through registers, others lane by lane.
    """
    ports, input_count = [*signature.inputs, *signature.outputs], len(signature.inputs)
    with ir.function("internal void @blocks(ptr %args, ptr %dimensions, ptr %steps, ptr %in)"):
        out, bodies = _scratch_offsets(ir, signature)
        # An input is moved to its own vectors; a result is gathered from the places that its table lists.
        scratch = [ir.at("%in", port.start, ir.V) for port in signature.inputs] + [out] * len(signature.outputs)
        arrays = list(_read_arrays(ir, [port.shape for port in ports]))
        # Rows can be transposed where the numbers of a state and the states themselves lie one behind the other, in all
        # arrays. A stride of 0, of one state for the whole batch, goes lane by lane.
        dense = _is_dense(ir, arrays, ports)
        for array, port in zip(arrays, ports, strict=True):
            dense = ir.let(f"and i1 {dense}, {ir.let(f'icmp eq i64 {array.step}, {8 * port.size}')}")
        count = ir.let("load i64, ptr %dimensions")
        size = memory_layout.block_size(signature, code.of_bodies, ir.lanes)
        tables = [""] * input_count + [f", ptr @places.{k}" for k in range(len(signature.outputs))]
        # Once per group of `at_once` blocks:
        with ir.loop_over_blocks(count, ir.lanes * code.at_once) as group:
            # The states from `first` on that are left, and the blocks of this group, of which the last may be smaller.
            first = ir.let(f"mul i64 {group}, {ir.lanes * code.at_once}")
            states = ir.let(f"sub i64 {count}, {first}")
            whole = ir.let(f"sdiv i64 {ir.let(f'add i64 {states}, {ir.lanes - 1}')}, {ir.lanes}")
            blocks = ir.call("llvm.smin.i64", "i64", whole, str(code.at_once))
            for way, part in (("load", slice(input_count)), ("store", slice(input_count, None))):
                # The computation of the group comes between loading and storing.
                if way == "store":
                    ir.do(f"call void @block(ptr %in, ptr {out}, ptr {bodies}, i64 {blocks})")
                # Once per block of as many states as there are lanes:
                with ir.loop(blocks) as block:
                    states_before = ir.let(f"mul i64 {block}, {ir.lanes}")
                    states_left = ir.let(f"sub i64 {states}, {states_before}")
                    lanes = ir.call("llvm.smin.i64", "i64", states_left, str(ir.lanes))
                    is_full = ir.let(f"icmp sge i64 {states_left}, {ir.lanes}")
                    state = ir.let(f"add i64 {first}, {states_before}")
                    offset = ir.let(f"mul i64 {block}, {size}")
                    # Of each array: its port, where its first state of this block is, and where its vectors are.
                    moves = [
                        (
                            port,
                            array,
                            ir.at(array.pointer, ir.let(f"mul i64 {state}, {array.step}"), "i8"),
                            ir.at(vectors, offset, "i8"),
                            table,
                        )
                        for port, array, vectors, table in list(zip(ports, arrays, scratch, tables, strict=True))[part]
                    ]
                    # A full block of dense rows is transposed in registers.
                    ir.do(f"br i1 {ir.let(f'and i1 {dense}, {is_full}')}, label %{way}.rows, label %{way}.lanes")
                    ir.label(f"{way}.rows")
                    for port, _, row, vectors, table in moves:
                        ir.do(f"call void @{way}_rows.{port.size}(ptr {row}, ptr {vectors}{table})")
                    ir.do(f"br label %{way}.done")
                    # Any other block is moved number by number.
                    ir.label(f"{way}.lanes")
                    for port, array, row, vectors, table in moves:
                        arguments = _lane_arguments(array, port, lanes)
                        ir.do(f"call void @{way}_lanes(ptr {row}, ptr {vectors}, {arguments}{table})")
                    ir.do(f"br label %{way}.done")
                    ir.label(f"{way}.done")


def _define_state(ir: Writer, signature: Signature, places: Sequence[Sequence[int]]) -> None:
    """Define ``@blocks`` of one state alone, in vectors of one lane."""
    ports, input_count = [*signature.inputs, *signature.outputs], len(signature.inputs)
    with ir.function("internal void @blocks(ptr %args, ptr %dimensions, ptr %steps, ptr %in)"):
        out, bodies = _scratch_offsets(ir, signature)
        arrays = list(_read_arrays(ir, [port.shape for port in ports]))
        ir.do(f"br i1 {_is_dense(ir, arrays, ports)}, label %dense, label %strided")
        # Dense arrays: loads and stores at fixed offsets. The computation is written twice, a call in each branch.
        ir.label("dense")
        for array, port in zip(arrays, signature.inputs, strict=False):
            for j in range(port.size):
                ir.store(ir.load(ir.at(array.pointer, j)), ir.at("%in", port.start + j))
        ir.do(f"call void @block(ptr %in, ptr {out}, ptr {bodies}, i64 1)")
        for k, (array, numbers) in enumerate(zip(arrays[input_count:], places, strict=True)):
            _copy_results(ir, numbers, f"@places.{k}", out, array.pointer)
        ir.do("ret void")
        # Arrays of any strides, as a block with one lane.
        ir.label("strided")
        for array, port in zip(arrays, signature.inputs, strict=False):
            vectors = ir.at("%in", port.start)
            ir.do(f"call void @load_lanes(ptr {array.pointer}, ptr {vectors}, {_lane_arguments(array, port, '1')})")
        ir.do(f"call void @block(ptr %in, ptr {out}, ptr {bodies}, i64 1)")
        for k, (array, port) in enumerate(zip(arrays[input_count:], signature.outputs, strict=True)):
            arguments = _lane_arguments(array, port, "1")
            ir.do(f"call void @store_lanes(ptr {array.pointer}, ptr {out}, {arguments}, ptr @places.{k})")


def _copy_results(ir: Writer, numbers: Sequence[int], table: str, out: str, to: str) -> None:
    """Copy the results of one state into their array.

    Many results take a loop over the table of their places, a few are copied one by one.
    """
    looped = 0
    if len(numbers) > MAX_UNROLLED_COPIES:
        looped = len(numbers) // COPIES_PER_TURN * COPIES_PER_TURN
    if looped > 0:
        with ir.loop(str(looped // COPIES_PER_TURN)) as turn:
            first = ir.let(f"mul i64 {turn}, {COPIES_PER_TURN}")
            places, results = ir.at(table, first, "i64"), ir.at(to, first)
            for j in range(COPIES_PER_TURN):
                place = ir.let(f"load i64, ptr {ir.at(places, j, 'i64')}")
                ir.store(ir.load(ir.at(out, place)), ir.at(results, j))
    # The rest, or all of a few.
    for j, number in enumerate(numbers[looped:], looped):
        ir.store(ir.load(ir.at(out, number)), ir.at(to, j))


def _scratch_offsets(ir: Writer, signature: Signature) -> tuple[str, str]:
    """Return the addresses of results and bodies in scratch memory."""
    out = ir.at("%in", signature.inputs[-1].end, ir.V)
    return out, ir.at(out, signature.outputs[-1].end, ir.V)


def _lane_arguments(array: _Array, port: Port, count: str) -> str:
    """Return the integers that moving lane by lane takes."""
    return ", ".join(f"i64 {i}" for i in (*_pad_to_three_axes(port.shape), array.step, *array.within, count))


def _define_on_stack(ir: Writer, size: int, name: str) -> None:
    """Define a function of states with its scratch memory on the stack."""
    with ir.function(f"void {name}(ptr %args, ptr %dimensions, ptr %steps, ptr %pool)"):
        scratch = ir.let(f"alloca [{size} x i8], align {scratch_pool.BUFFER_ALIGNMENT}")
        ir.do(f"call void @blocks(ptr %args, ptr %dimensions, ptr %steps, ptr {scratch})")


def _read_arrays(ir: Writer, shapes: list[tuple[int, ...]]) -> Iterator[_Array]:
    """Yield the arrays of a call, whose states have these shapes."""
    # NumPy lists the strides from state to state of all arrays, then the strides within a state, array after array.
    first_within = len(shapes)
    for k, shape in enumerate(shapes):
        pointer = ir.let(f"load ptr, ptr {ir.at('%args', k, 'ptr')}")
        places = (k, *range(first_within, first_within + len(shape)))
        step, *within = (ir.let(f"load i64, ptr {ir.at('%steps', j, 'i64')}") for j in places)
        first_within += len(shape)
        yield _Array(pointer, step, (*["0"] * (3 - len(shape)), *within))


def _pad_to_three_axes(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the slabs, rows and columns of a state: a vector is one row."""
    return (*(1,) * (3 - len(shape)), *shape)


def _is_dense(ir: Writer, arrays: Sequence[_Array], ports: Sequence[Port]) -> str:
    """Return whether the numbers of a state are contiguous in all arrays.

    The answer is a value of the code, known at run time.
    """
    dense = "true"
    for array, port in zip(arrays, ports, strict=True):
        _, rows, columns = extents = _pad_to_three_axes(port.shape)
        for extent, stride, expected in zip(extents, array.within, (8 * rows * columns, 8 * columns, 8), strict=True):
            # The stride of an axis with one entry may be any number.
            if extent > 1:
                dense = ir.let(f"and i1 {dense}, {ir.let(f'icmp eq i64 {stride}, {expected}')}")
    return dense


def define_transposes(ir: Writer, signature: Signature) -> None:
    """Define the moves of contiguous rows of N numbers.

    They are ``@load_rows.N(row, scratch)`` and ``@store_rows.N(row, scratch, table)``, for each width N of an array.
    What is stored in column j is the vector that lies ``table[j]`` doubles into scratch memory.
    """
    for width in sorted({port.size for port in signature.inputs}):
        with ir.function(f"internal void @load_rows.{width}(ptr %row, ptr %scratch)"):
            for column, size in _tiles(ir, width):
                # A tile of `size` columns of all rows, (lanes, size), becomes `size` vectors of `lanes` states. Where
                # rows are shorter than a vector, pieces of every size-th row are joined to whole vectors first.
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
                # After the transpose, vector i holds the rows i, i + size, ..., each a piece of `size` numbers.
                for lane, row in enumerate(rows):
                    start = lane - lane % size
                    ir.store(ir.shuffle([vectors[lane % size]], range(start, start + size)), row, size)
                for row in rows:
                    ir.prefetch(ir.at(row, FETCHED_AHEAD))


def _tiles(ir: Writer, width: int) -> Iterator[tuple[str, int]]:
    """Yield the first column and the size of each tile of rows.

    A tile is as wide as a vector, or as the largest power of two in a short row. The last tile ends with the row, and
    may overlap the one before. Many tiles are written once, in a loop.
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
    """Return the addresses of a column in the rows of a block."""
    first = ir.at("%row", column)
    return [ir.at(first, lane * width) for lane in range(ir.lanes)]


def _transpose(ir: Writer, rows: Sequence[str]) -> list[str]:
    """Transpose the square blocks of some vectors.

    There are as many lanes as vectors. Off the diagonal, ever smaller blocks change places: for n vectors, log2(n)
    rounds of n shuffles (J. O. Eklundh, A fast computer method for matrix transposing, IEEE Transactions on
    Computers C-21, 1972).
    """
    size, rows = len(rows), list(rows)
    while size > 1:
        size //= 2
        for i in range(len(rows)):
            if i & size:
                continue
            # The right half of the upper row and the left half of the lower one change places, in each block of 2 size
            # lanes. Lanes of the lower row are numbered after those of the upper one.
            pair = rows[i], rows[i + size]
            first = [j if not j & size else ir.lanes + j - size for j in range(ir.lanes)]
            second = [j + size if not j & size else ir.lanes + j for j in range(ir.lanes)]
            rows[i], rows[i + size] = (ir.shuffle(pair, order) for order in (first, second))
    return rows


def _join(ir: Writer, pieces: Sequence[str], size: int) -> str:
    """Return one vector of pieces of `size` lanes, joined in pairs."""
    while len(pieces) > 1:
        pieces = [ir.shuffle(pair, range(2 * size), size) for pair in zip(pieces[::2], pieces[1::2], strict=True)]
        size *= 2
    return pieces[0]


def define_lanes(ir: Writer) -> None:
    """Define the moves of single lanes to and from strided arrays.

    They are ``@load_lanes`` and ``@store_lanes``, for some lanes of a block. ``(first, scratch, slabs, rows,
    columns, step, apart, down, across, count)``: a state is `slabs` matrices, one step from the state before it;
    matrices are ``apart``, rows ``down`` and columns ``across`` from each other, in bytes. Lanes beyond the count
    are filled with the last state. A table as above comes last where rows are stored.
    """
    integers = ("slabs", "rows", "columns", "step", "apart", "down", "across", "count")
    arguments = f"ptr %first, ptr %scratch, {', '.join(f'i64 %{name}' for name in integers)}"
    with ir.function(f"internal void @load_lanes({arguments})"):
        last_lane = ir.let("sub i64 %count, 1")
        # All lanes of each vector hold the last state; then the lanes before it get their own states.
        with _loops(ir, "slabs", "rows", "columns") as entry:
            value = ir.let(f"load double, ptr {_place(ir, last_lane, *entry)}, align 1")
            ir.store(ir.splat(value), ir.at("%scratch", _number(ir, *entry), ir.V))
        with (
            ir.only_if(ir.let(f"icmp ne i64 {last_lane}, 0"), "more", "done"),
            _loops(ir, "slabs", "rows", "columns") as entry,
            ir.loop(last_lane) as lane,
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
    """Write nested loops; yield their indices.

    Their counts are arguments of these names.
    """
    with ExitStack() as stack:
        yield [stack.enter_context(ir.loop(f"%{count}")) for count in counts]


def _number(ir: Writer, slab: str, row: str, column: str) -> str:
    """Return the number of an entry in the order of axes."""
    rows = ir.let(f"add i64 {ir.let(f'mul i64 {slab}, %rows')}, {row}")
    return ir.let(f"add i64 {ir.let(f'mul i64 {rows}, %columns')}, {column}")


def _place(ir: Writer, lane: str, slab: str, row: str, column: str) -> str:
    """Return the address of an entry of the state in a lane."""
    place = ir.let(f"mul i64 {lane}, %step")
    for i, stride in ((slab, "apart"), (row, "down"), (column, "across")):
        place = ir.let(f"add i64 {place}, {ir.let(f'mul i64 {i}, %{stride}')}")
    return ir.at("%first", place, "i8")
