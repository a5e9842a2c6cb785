"""A program as LLVM IR: ``@block(in, out, bodies)``, which works on a block of states in scratch memory."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, zip_longest

from jounce.dynamics.computation import Port, Signature
from jounce.native.ir import Writer
from jounce.program.operations import LEAVES, OPERATIONS, VectorFunction
from jounce.program.program import Program

MAX_STEPS_COMPILED_TWICE = 6000  # for vectors and for one state: each compiles in some tenths of a second
STEPS_PER_BRANCH = 4000  # as the time that LLVM takes for code without a branch grows faster than its length


@dataclass(frozen=True)
class BlockCode:
    """The code for one block of states: the text of ``@block(in, out, bodies)``, and the positions of its results."""

    define: Callable[[Writer], None]
    places: Sequence[Sequence[int]]  # by result, the number of the vector of each scalar
    of_bodies: int = 0  # vectors that it works in besides
    short: bool = False  # whether a state alone has code of its own, which takes as long to compile again


def straight_block(program: Program, signature: Signature) -> BlockCode:
    """A program in a straight line. Results of a port that are equal, as many zeros of matrices, are stored once."""
    numbers: dict[tuple[int, int], int] = {}  # numbers of vectors, by port and step of the program
    places = [
        [numbers.setdefault((k, program.outputs[j]), len(numbers)) for j in range(port.start, port.end)]
        for k, port in enumerate(signature.outputs)
    ]
    short = len(program.steps) <= MAX_STEPS_COMPILED_TWICE
    return BlockCode(lambda ir: _define_straight(ir, program, signature, numbers), places, short=short)


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
            if i % STEPS_PER_BRANCH == STEPS_PER_BRANCH - 1:
                ir.do(f"br i1 {never}, label %done, label %piece{i}")
                ir.label(f"piece{i}")
        ir.do("br label %done")
        ir.label("done")


def emit_steps(ir: Writer, program: Program, read: Callable[[int], str]) -> Iterator[tuple[int, str]]:
    """Write the steps of a program in their order; each and the name of its value as soon as it is written."""
    steps, called = program.steps, _vector_calls(program)
    pairs = _pairs_of_angles(program, called)
    places = {i: j for j, i in enumerate(dict.fromkeys(chain.from_iterable(pairs)))}
    results = ir.let(f"alloca [{2 * max(1, len(places))} x {ir.V}], align 64")
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
                j = 2 * places[step.operands[0]] + function.result
                values[i] = ir.load(ir.at(results, j, ir.V))
        return values[i]

    for pair in pairs:  # first, while no other value must be saved over the call
        angles = ", ".join(f"{ir.V} {value(i)}" for i in pair)
        there = ", ".join(f"ptr {ir.at(results, 2 * places[i], ir.V)}" for i in pair)
        ir.do(f"call void @sincos({angles}, {there})")
    for i in called:
        if called[i].result is None:
            value(i)
    for i in range(len(steps)):
        yield i, value(i)


def _pairs_of_angles(program: Program, called: Mapping[int, VectorFunction]) -> list[tuple[int, int]]:
    """The steps of which sines or cosines are taken, in pairs of which none waits for the other; an odd one twice."""
    depths: list[int] = []  # of steps, how many sines or cosines are taken one after the other before
    angles = defaultdict[int, dict[int, None]](dict)  # by depth
    for i, step in enumerate(program.steps):
        depths.append(max((depths[j] for j in step.operands), default=0))
        if i in called and called[i].result is not None:
            angles[depths[i]][step.operands[0]] = None
            depths[i] += 1
    levels = map(list, angles.values())
    return [pair for level in levels for pair in zip_longest(level[::2], level[1::2], fillvalue=level[-1])]


def _vector_calls(program: Program) -> dict[int, VectorFunction]:
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
