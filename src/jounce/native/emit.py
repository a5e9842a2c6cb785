"""What all forms of native code share: the code of a block of states, steps as LLVM IR, the check of inputs."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from jounce.dynamics.computation import Port, Signature
from jounce.native.ir import Writer
from jounce.native.pieces import vector_calls
from jounce.program.program import Program


@dataclass(frozen=True)
class BlockCode:
    """The code for blocks of states: the text of ``@block(in, out, bodies, count)``, and the positions of its results.

    It computes `count` blocks, at most as many as are `at_once`, `memory_layout.block_size` behind each other.
    """

    define: Callable[[Writer], None]
    places: Sequence[Sequence[int]]  # by result, the number of the vector of each scalar
    of_bodies: int = 0  # vectors that it works in besides
    short: bool = False  # whether a state alone has code of its own, which takes as long to compile again
    at_once: int = 1  # blocks
    define_wide: Callable[[Writer], None] | None = None  # what code for a state alone calls, in vectors all the same
    results_in_bodies: bool = False  # where places are counted from


@dataclass(frozen=True)
class JointStep:
    """A traced step, and where its inputs and outputs are: an offset in scalars in the memory of that name."""

    program: Program
    reads: tuple[tuple[str, int], ...]
    writes: tuple[tuple[str, int], ...]

    @property
    def memory(self) -> list[str]:
        """The names of the memory that it takes."""
        return sorted({memory for memory, _ in (*self.reads, *self.writes)})


def emit_steps(ir: Writer, program: Program, read: Callable[[int], str]) -> list[str]:
    """Write the steps of a program, as those of a joint are; the names of their values."""
    called, names, circles = vector_calls(program), list[str](), dict[int, str]()
    for i, step in enumerate(program.steps):
        operands = [names[j] for j in step.operands]
        if step.kind == "constant":
            names.append(ir.vector(step.value))
        elif step.kind == "input":
            names.append(read(int(step.value)))
        elif (function := called.get(i)) is None:
            names.append(ir.op(step.kind, *operands))
        elif function.result is None:
            names.append(ir.let(f"call {ir.V} @{function.name}({ir.V} {operands[0]})"))
        else:  # a sine or a cosine, of an angle that is taken twice
            if step.operands[0] not in circles:
                place = circles[step.operands[0]] = ir.let(f"alloca [2 x {ir.V}], align {8 * ir.lanes}")
                ir.do(f"call void @sincos({ir.V} {operands[0]}, {ir.V} {operands[0]}, ptr {place}, ptr {place})")
            names.append(ir.load(ir.at(circles[step.operands[0]], function.result, ir.V)))
    return names


def define_step(ir: Writer, name: str, step: JointStep, memory: Sequence[str]) -> None:
    """A step as a function of parts of memory: vectors, and constants, which are single numbers."""

    def read(i: int) -> str:
        part, place = step.reads[i]
        if part == "constants":
            return ir.splat(ir.let(f"load double, ptr {ir.at('%constants', place)}"))
        return ir.load(ir.at(f"%{part}", place, ir.V))

    with ir.function(f"internal void @{name}({pointers(*(f'%{part}' for part in memory))}) {ir.aligned}"):
        values = emit_steps(ir, step.program, read)
        for (part, place), i in zip(step.writes, step.program.outputs, strict=True):
            ir.store(values[i], ir.at(f"%{part}", place, ir.V))


def pointers(*names: str) -> str:
    """Arguments of a step."""
    return ", ".join(f"ptr {name}" for name in names)


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
