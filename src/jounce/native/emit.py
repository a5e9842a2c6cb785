"""A program as LLVM IR: a loop over blocks of states, in the calling convention of NumPy's generalized ufuncs.

``@states(args, dimensions, steps, data)``: args are the arrays of inputs and outputs, dimensions the number of states,
steps the strides of the arrays from state to state, then those within a state.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from jounce.dynamics.computation import Port, Signature
from jounce.native import functions, lanes, plan, pool
from jounce.native.ir import Writer
from jounce.native.jit import Target
from jounce.program.operations import LEAVES, OPERATIONS, VectorFunction
from jounce.program.program import Program

PIECE = 4000  # steps in a row: the time that LLVM takes for code without a branch grows faster than its length


@dataclass(frozen=True)
class Block:
    """What works on one block of states: the text of ``@block(in, out, bodies)``, and where it leaves its results."""

    define: Callable[[Writer], None]
    places: Sequence[Sequence[int]]  # by result, the number of the vector of each scalar
    of_bodies: int = 0  # vectors that it works in besides


def module_text(block: Block, signature: Signature, target: Target) -> str:
    """The module of a kernel whose block works in scratch memory."""
    ir = Writer(target)
    for define in functions.DEFINITIONS.values():
        define(ir)
    lanes.define_transposes(ir)
    lanes.define_lanes(ir)
    block.define(ir)
    for k, places in enumerate(block.places):
        ir.table(f"places.{k}", [*places, *[places[-1]] * ir.lanes])  # read by whole vectors
    _define_blocks(ir, signature)
    size = plan.call_size(signature, block.of_bodies, target.lanes)
    define_states = _define_on_stack if size <= plan.STACK else pool.define_on_heap
    define_states(ir, size)
    return ir.text()


def straight(program: Program, signature: Signature) -> Block:
    """A program in a straight line. Results of a port that are equal, as many zeros of matrices, are stored once."""
    numbers: dict[tuple[int, int], int] = {}  # of vectors, by the port and the step of the program
    places = [
        [numbers.setdefault((k, program.outputs[j]), len(numbers)) for j in range(port.start, port.end)]
        for k, port in enumerate(signature.outputs)
    ]
    return Block(lambda ir: _define_straight(ir, program, signature, numbers), places)


def _define_straight(
    ir: Writer, program: Program, signature: Signature, numbers: Mapping[tuple[int, int], int]
) -> None:
    def add_zeros(total: str, port: Port) -> str:
        for j in range(port.start, port.end):
            total = ir.op("fma", ir.load(ir.at("%in", j, ir.V)), ir.vector(0.0), total)
        return total

    with ir.function("internal void @block(ptr %in, ptr %out, ptr %bodies)"):
        never = ir.let("icmp eq ptr %in, null")
        masks = list(nan_masks(ir, signature, add_zeros))
        results = defaultdict(list)  # by step, to which vectors and with which mask
        for (k, i), number in numbers.items():
            results[i].append((number, masks[k]))
        for i, value in emit_steps(ir, program, lambda i: ir.load(ir.at("%in", i, ir.V))):
            for number, mask in results[i]:  # at once, so that no register waits
                ir.store(ir.op("add", value, mask), ir.at("%out", number, ir.V))
            if i % PIECE == PIECE - 1:
                ir.do(f"br i1 {never}, label %done, label %piece{i}")
                ir.label(f"piece{i}")
        ir.do("br label %done")
        ir.label("done")
        ir.do("ret void")


def emit_steps(ir: Writer, program: Program, read: Callable[[int], str]) -> Iterator[tuple[int, str]]:
    """Write the steps of a program in their order; each and the name of its value as soon as it is written."""
    steps, called = program.steps, _called(program)
    pairs = sorted({(called[i].name, steps[i].operands[0]) for i in called if called[i].result is not None})
    results = ir.let(f"alloca [{2 * max(1, len(pairs))} x {ir.V}], align 64")
    values: dict[int, str] = {}

    def value(i: int) -> str:
        step = steps[i]
        if step.kind == "constant":
            return ir.vector(step.value)
        if i not in values:
            if step.kind == "input":
                values[i] = read(int(step.value))
            elif (function := called.get(i)) is None:
                values[i] = ir.op(step.kind, *(value(j) for j in step.operands))
            elif function.result is None:
                values[i] = ir.let(f"call {ir.V} @{function.name}({ir.V} {value(step.operands[0])})")
            else:
                j = 2 * pairs.index((function.name, step.operands[0])) + function.result
                values[i] = ir.load(ir.at(results, j, ir.V))
        return values[i]

    for j, (name, operand) in enumerate(pairs):  # first, while no other value must be saved over the call
        ir.do(f"call void @{name}({ir.V} {value(operand)}, ptr {ir.at(results, 2 * j, ir.V)})")
    for i in called:
        if called[i].result is None:
            value(i)
    for i in range(len(steps)):
        yield i, value(i)


def _called(program: Program) -> dict[int, VectorFunction]:
    """The steps that call functions of vectors, and which."""
    rows = ((i, OPERATIONS[step.kind]) for i, step in enumerate(program.steps) if step.kind not in LEAVES)
    return {i: row.function for i, row in rows if row.function is not None}


def nan_masks(ir: Writer, signature: Signature, add: Callable[[str, Port], str]) -> Iterator[str]:
    """For each order of the outputs 0, or NaN where an input that it depends on is not finite.

    ``add(total, port)`` adds 0 times each scalar of an input.
    """
    total = ir.vector(0.0)
    for order in range(len(signature.outputs)):
        for port in signature.inputs:
            if port.first_order == order:
                total = add(total, port)
        yield total


def _define_blocks(ir: Writer, signature: Signature) -> None:
    """``@blocks(args, dimensions, steps, memory)``: the loop over blocks of states.

    Rows that lie one behind the other go through registers, others lane by lane. A result may lie exactly over an array
    of states, which NumPy then does not copy.
    """
    ports, given = [*signature.inputs, *signature.outputs], len(signature.inputs)
    widths = [port.size for port in ports]
    behind = max((-((width - ir.lanes) // width) for width in widths if width < ir.lanes), default=0)
    with ir.function("internal void @blocks(ptr %args, ptr %dimensions, ptr %steps, ptr %in)"):
        ir.label("start")
        out = ir.at("%in", signature.inputs[-1].end + ir.lanes, ir.V)
        bodies = ir.at(out, signature.outputs[-1].end + ir.lanes, ir.V)
        scratch = [ir.at("%in", port.start, ir.V) for port in signature.inputs]
        scratch += [out] * len(signature.outputs)
        arrays = list(_arrays(ir, [port.shape for port in ports]))
        dense = "true"
        for array, port in zip(arrays, ports, strict=True):
            for stride, expected in zip((array.step, *array.within), _dense_strides(port.shape), strict=True):
                if stride != "0":
                    dense = ir.let(f"and i1 {dense}, {ir.let(f'icmp eq i64 {stride}, {expected}')}")
        for result, width in zip(arrays[given:], widths[given:], strict=True):
            if width < ir.lanes:  # stored reaching into rows behind: not where these are states yet to be read
                for array in arrays[:given]:
                    dense = ir.let(f"and i1 {dense}, {ir.let(f'icmp ne ptr {result.pointer}, {array.pointer}')}")
        count = ir.let("load i64, ptr %dimensions")
        ir.do(f"br i1 {ir.let(f'icmp sgt i64 {count}, 0')}, label %some, label %done")
        ir.label("some")
        blocks = ir.let(f"sdiv i64 {ir.let(f'add i64 {count}, {ir.lanes - 1}')}, {ir.lanes}")
        with ir.loop(blocks) as block:
            first = ir.let(f"mul i64 {block}, {ir.lanes}")
            left = ir.let(f"sub i64 {count}, {first}")
            lanes = ir.call("llvm.smin.i64", "i64", left, str(ir.lanes))
            enough = ir.let(f"icmp sge i64 {left}, {ir.lanes + behind}")
            quick = ir.let(f"and i1 {dense}, {enough}")
            places = [ir.at(x.pointer, ir.let(f"mul i64 {first}, {x.step}"), "i8") for x in arrays]
            tables = [""] * given + [f", ptr @places.{k}" for k in range(len(signature.outputs))]
            moved = list(zip(ports, arrays, places, scratch, tables, strict=True))
            for way, part in (("load", moved[:given]), ("store", moved[given:])):
                if way == "store":
                    ir.do(f"call void @block(ptr %in, ptr {out}, ptr {bodies})")
                ir.do(f"br i1 {quick}, label %{way}.rows, label %{way}.lanes")
                ir.label(f"{way}.rows")
                for port, _, place, there, table in part:
                    ir.do(f"call void @{way}_rows(ptr {place}, ptr {there}, i64 {port.size}{table})")
                ir.do(f"br label %{way}.done")
                ir.label(f"{way}.lanes")
                for port, x, place, there, table in part:
                    integers = (*_in_three_axes(port.shape), x.step, *x.within, lanes)
                    listed = ", ".join(f"i64 {i}" for i in integers)
                    ir.do(f"call void @{way}_lanes(ptr {place}, ptr {there}, {listed}{table})")
                ir.do(f"br label %{way}.done")
                ir.label(f"{way}.done")
        ir.do("br label %done")
        ir.label("done")
        ir.do("ret void")


def _define_on_stack(ir: Writer, size: int) -> None:
    """``@states`` with its scratch memory on the stack."""
    with ir.function("void @states(ptr %args, ptr %dimensions, ptr %steps, ptr %pool)"):
        scratch = ir.let(f"alloca [{size} x i8], align {pool.ALIGNMENT}")
        ir.do(f"call void @blocks(ptr %args, ptr %dimensions, ptr %steps, ptr {scratch})")
        ir.do("ret void")


@dataclass(frozen=True)
class _Array:
    """An array that a caller passes: where it begins, and its strides in bytes, from state to state and within one."""

    pointer: str
    step: str
    within: tuple[str, ...]


def _arrays(ir: Writer, shapes: list[tuple[int, ...]]) -> Iterator[_Array]:
    inner = len(shapes)
    for k, shape in enumerate(shapes):
        pointer = ir.let(f"load ptr, ptr {ir.at('%args', k, 'ptr')}")
        step, *within = (
            ir.let(f"load i64, ptr {ir.at('%steps', j, 'i64')}") for j in (k, *range(inner, inner + len(shape)))
        )
        inner += len(shape)
        yield _Array(pointer, step, (*["0"] * (3 - len(shape)), *within))


def _in_three_axes(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The slabs, rows and columns of a state: a vector is one row, a scalar a vector of one."""
    return (*(1,) * (3 - len(shape)), *shape)


def _dense_strides(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The strides, from state to state and within one, of states that lie one behind the other."""
    slabs, rows, columns = _in_three_axes(shape)
    return 8 * slabs * rows * columns, 8 * rows * columns, 8 * columns, 8
